/* A sparse cloud: 535 puffs of radius 16 in 1000^3 voxels, of which 0.9 % are set; or 555. */

#ifndef PUFFS_H
#define PUFFS_H

#include <math.h>
#include <stdint.h>

enum { PUFFS = 535, PUFFS_WIDE = 555, RADIUS = 16, CLOUD = 1000 };

static double puffs[PUFFS_WIDE][3];
static int puff_count = PUFFS;

static void puffs_place(void) {
    uint32_t seed = 1;
    for (int i = 0; i < 3 * PUFFS_WIDE; ++i) {
        seed = seed * 1664525u + 1013904223u;
        puffs[i / 3][i % 3] = RADIUS + (CLOUD - 2 * RADIUS) * (double)seed / 4294967296.0;
    }
}

/* One puff's voxels within a block. */
static void puff_read(const double *centre, const int lo[3], const int size[3], float *values) {
    int low[3], high[3];
    for (int k = 0; k < 3; ++k) {
        low[k] = (int)fmax(floor(centre[k]) - RADIUS - lo[k], 0);
        high[k] = (int)fmin(floor(centre[k]) + RADIUS + 1 - lo[k], size[k]);
    }
    for (int z = low[2]; z < high[2]; ++z)
        for (int y = low[1]; y < high[1]; ++y)
            for (int x = low[0]; x < high[0]; ++x) {
                const double dx = lo[0] + x + 0.5 - centre[0], dy = lo[1] + y + 0.5 - centre[1];
                const double dz = lo[2] + z + 0.5 - centre[2];
                const double inside = 1 - (dx * dx + dy * dy + dz * dz) / (RADIUS * RADIUS);
                if (inside > 0) values[(z * size[1] + y) * size[0] + x] += (float)inside;
            }
}

static int cloud_read(void *user, const int lo[3], const int size[3], float *values) {
    (void)user;
    for (int i = 0; i < puff_count; ++i) puff_read(puffs[i], lo, size, values);
    return 0;
}

static inline int cloud_range(void *user, const int lo[3], const int size[3], float range[2]) {
    (void)user;
    for (int i = 0; i < puff_count; ++i) {
        int meets = 1;
        for (int k = 0; k < 3; ++k) meets &= puffs[i][k] + RADIUS > lo[k] && puffs[i][k] - RADIUS < lo[k] + size[k];
        if (meets) range[1] = PUFFS;
    }
    return 0;
}

#endif /* PUFFS_H */
