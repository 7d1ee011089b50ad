/* scans.h: real scans in the folder that SPLATSHADOW_DATA names, and the look of one. */

#ifndef EX_SCANS_H
#define EX_SCANS_H

#include "volume.h"

/* Loads a file without a header from the folder. */
static inline int ex_scan_load(ex_grid *grid, const char *name, const int size[3], ex_type type, ex_error *error) {
    const char *folder = getenv("SPLATSHADOW_DATA");
    char path[4096];
    ex_voxel_file file;
    if (!folder) return ex_fail(error, "SPLATSHADOW_DATA does not say where %s is", name);
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return ex_voxel_file_raw(&file, path, size, type, error) || ex_grid_load(grid, &file, error);
}

/* A bonsai in its pot: scanner's haze below 0.135, leaves, wood, soil, pot, stones. */
static const sps_transfer_point ex_bonsai_points[] = {
    {0.135f, {0.16f, 0.34f, 0.06f}, 0, {0, 0, 0}},  {0.15f, {0.20f, 0.42f, 0.08f}, 60, {0, 0, 0}},
    {0.26f, {0.30f, 0.45f, 0.10f}, 90, {0, 0, 0}},  {0.34f, {0.42f, 0.27f, 0.14f}, 200, {0, 0, 0}},
    {0.55f, {0.46f, 0.30f, 0.17f}, 300, {0, 0, 0}}, {0.70f, {0.34f, 0.25f, 0.18f}, 400, {0, 0, 0}},
    {0.76f, {0.55f, 0.24f, 0.14f}, 500, {0, 0, 0}}, {1.00f, {0.65f, 0.60f, 0.55f}, 500, {0, 0, 0}},
};

static const sps_transfer ex_bonsai_transfer = {ex_bonsai_points, sizeof ex_bonsai_points / sizeof *ex_bonsai_points,
                                                NULL, NULL, 0};

static inline int ex_bonsai_load(ex_grid *grid, ex_error *error) {
    static const int size[3] = {256, 256, 256};
    return ex_scan_load(grid, "bonsai_256x256x256_u8.raw", size, EX_U8, error);
}

/* The bonsai from (-1,0,-1) to (1,2,1). It borrows the grid. */
static inline void ex_bonsai_volume(sps_volume *volume, ex_grid *grid) {
    memcpy(volume->size, grid->size, sizeof volume->size);
    volume->placement.origin[0] = volume->placement.origin[2] = -1;
    for (int i = 0; i < 3; ++i) volume->placement.axis[i][i] = 2;
    volume->read_fn = ex_grid_read, volume->range_fn = ex_grid_range, volume->user = grid;
    volume->concurrent = 1;
    volume->transfer = &ex_bonsai_transfer;
}

#endif /* EX_SCANS_H */
