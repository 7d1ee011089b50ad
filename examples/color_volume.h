/* color_volume.h: a volume with three numbers per voxel, red, green and blue, in memory: the albedo or the emission of
   another volume. volume_file.h finds such files. */

#ifndef EX_COLOR_VOLUME_H
#define EX_COLOR_VOLUME_H

#include "volume.h"

/* The grid holds the three numbers side by side: it is three times as long along x. */
typedef struct ex_color_grid {
    int size[3]; /* in voxels */
    ex_grid grid;
} ex_color_grid;

/* Packs numbers that lie in three planes. */
static inline void ex_color_grid_pack(ex_grid *grid) {
    const size_t count = (size_t)grid->size[0] / 3 * (size_t)grid->size[1] * (size_t)grid->size[2];
    const size_t item = ex_type_size(grid->type);
    char *packed = (char *)ex_allocate(3 * count, item), *out = packed;
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c, out += item)
            memcpy(out, (const char *)grid->data + (c * count + i) * item, item);
    free(grid->data);
    grid->data = packed;
}

/* Reads a file with three numbers per voxel, which become values as those of ex_grid_load do: see ex_grid_scale. */
static inline int ex_color_grid_load(ex_color_grid *colors, const ex_voxel_file *from, ex_error *error) {
    memset(colors, 0, sizeof *colors);
    if (from->components != 3) return ex_fail(error, "%s: one number per voxel, but a color has three", from->path);
    if (ex_grid_load_numbers(&colors->grid, from, error)) return 1;
    if (from->planes) ex_color_grid_pack(&colors->grid);
    memcpy(colors->size, from->size, sizeof colors->size);
    ex_grid_scale(&colors->grid, from);
    return 0;
}

/* Three values of each voxel of a block, x fastest. */
static inline void ex_color_grid_read(const ex_color_grid *colors, const int lo[3], const int size[3], float *out) {
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y, out += 3 * size[0])
            ex_grid_row(&colors->grid, 3 * lo[0], lo[1] + y, lo[2] + z, 3 * size[0], out);
}

static inline void ex_color_grid_free(ex_color_grid *colors) {
    ex_grid_free(&colors->grid);
    memset(colors, 0, sizeof *colors);
}

#endif /* EX_COLOR_VOLUME_H */
