/* tree.h: a tree as a volume: rods of wood and clumps of leaves. */

#ifndef EX_TREE_H
#define EX_TREE_H

#include "densities.h"
#include "volume.h"

enum { EX_TREE_RODS = 1024, EX_TREE_CLUMPS = 256 };
#define EX_TREE_LEAF                                                                                                   \
    0.30 /* approximate value of leaves; low, since the value falls through it at the skin of the wood */
#define EX_TREE_WOOD 1.0 /* value of wood */

typedef struct ex_tree {
    struct {
        ex_vec a, b;
        double radius_a, radius_b;
    } rods[EX_TREE_RODS];
    struct {
        ex_vec center;
        double radius;
    } clumps[EX_TREE_CLUMPS];
    int rod_count, clump_count;
    uint32_t random;
} ex_tree;

static inline ex_vec ex_tree_bend(ex_tree *tree, ex_vec direction, double amount) {
    const double x = ex_random(&tree->random) - 0.5, y = ex_random(&tree->random) - 0.5,
                 z = ex_random(&tree->random) - 0.5;
    return ex_vec_unit(ex_vec_add(direction, ex_vec_scale(ex_vec_of(x, y, z), 2 * amount)));
}

static inline void ex_tree_leaves(ex_tree *tree, ex_vec center, double radius) {
    if (tree->clump_count == EX_TREE_CLUMPS) return;
    tree->clumps[tree->clump_count].center = center;
    tree->clumps[tree->clump_count++].radius = radius;
}

static inline void ex_tree_rod(ex_tree *tree, ex_vec a, ex_vec b, double radius_a, double radius_b) {
    if (tree->rod_count == EX_TREE_RODS) return;
    tree->rods[tree->rod_count].a = a, tree->rods[tree->rod_count].b = b;
    tree->rods[tree->rod_count].radius_a = radius_a, tree->rods[tree->rod_count].radius_b = radius_b;
    ++tree->rod_count;
}

/* Grows one branch of three tapering rods. Returns its tip; `direction` becomes the direction of the tip. */
static inline ex_vec ex_tree_branch(ex_tree *tree, ex_vec base, ex_vec *direction, double length, double radius) {
    for (int i = 0; i < 3; ++i) {
        *direction = ex_tree_bend(tree, *direction, 0.22);
        const ex_vec tip = ex_vec_add(base, ex_vec_scale(*direction, length / 3));
        ex_tree_rod(tree, base, tip, radius * (1 - 0.12 * i), radius * (1 - 0.12 * (i + 1)));
        base = tip;
    }
    return base;
}

/* Grows a branch and, from its tip, three thinner ones, spread evenly around it, down to `levels` levels. */
static inline void ex_tree_grow(ex_tree *tree, ex_vec base, ex_vec direction, double length, double radius,
                                int levels) {
    const ex_vec tip = ex_tree_branch(tree, base, &direction, length, radius);
    if (levels <= 1) ex_tree_leaves(tree, tip, length * (0.85 + 0.3 * ex_random(&tree->random)));
    if (levels == 0) return;
    const ex_vec side = ex_vec_perpendicular(direction), other = ex_vec_cross(direction, side);
    const double start = 2 * EX_PI * ex_random(&tree->random);
    for (int i = 0; i < 3; ++i) {
        const double angle = start + 2 * EX_PI * i / 3 + 0.6 * (ex_random(&tree->random) - 0.5);
        const double spread = 0.75 + 0.35 * ex_random(&tree->random), shrink = 0.66 + 0.14 * ex_random(&tree->random);
        ex_vec aim = ex_vec_add(
            direction,
            ex_vec_scale(ex_vec_add(ex_vec_scale(side, cos(angle)), ex_vec_scale(other, sin(angle))), spread));
        aim.y = 0.62 * aim.y + 0.12; /* branches reach out more than up, but do not droop */
        ex_tree_grow(tree, tip, ex_vec_unit(aim), length * shrink, radius * 0.62, levels - 1);
    }
}

/* The value of a clump of leaves at p: a flat noisy ellipsoid. The grain opens holes and varies the green. */
static inline double ex_clump_value(ex_vec p, ex_vec center, double radius, double voxel) {
    const ex_vec d = ex_vec_sub(p, center);
    const double far = ex_vec_length(ex_vec_of(d.x, 1.7 * d.y, d.z));
    if (far > 1.5 * radius) return 0;
    const double grain = ex_noise(ex_vec_scale(p, 0.16 / voxel));
    const double distance =
        far - radius * (0.82 + 0.28 * ex_noise(ex_vec_scale(p, 2.5 / radius))) - 2.2 * voxel * grain;
    return EX_TREE_LEAF * (1 + 0.15 * grain) * ex_solid(distance, 3 * voxel);
}

/* Raises the voxels around one rod (clump < 0) or one clump (rod < 0) to its value there, where that is higher. */
static inline void ex_tree_raise(const ex_tree *tree, int rod, int clump, const sps_volume *volume, float *values) {
    const double voxel = volume->placement.axis[0][0] / volume->size[0];
    const ex_vec a = rod >= 0 ? tree->rods[rod].a : tree->clumps[clump].center, b = rod >= 0 ? tree->rods[rod].b : a;
    const double reach = 3 * voxel + (rod >= 0 ? tree->rods[rod].radius_a : 1.5 * tree->clumps[clump].radius);
    const double ends[2][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}};
    int low[3], high[3];
    for (int i = 0; i < 3; ++i) {
        const double first = (fmin(ends[0][i], ends[1][i]) - reach - volume->placement.origin[i]) / voxel;
        const double last = (fmax(ends[0][i], ends[1][i]) + reach - volume->placement.origin[i]) / voxel;
        low[i] = (int)ex_clamp(first, 0, volume->size[i]), high[i] = (int)ex_clamp(last, 0, volume->size[i]);
    }
    for (int z = low[2]; z < high[2]; ++z)
        for (int y = low[1]; y < high[1]; ++y)
            for (int x = low[0]; x < high[0]; ++x) {
                const ex_vec p = ex_vec_of(volume->placement.origin[0] + (x + 0.5) * voxel,
                                           volume->placement.origin[1] + (y + 0.5) * voxel,
                                           volume->placement.origin[2] + (z + 0.5) * voxel);
                float *out = values + ((size_t)z * (size_t)volume->size[1] + (size_t)y) * (size_t)volume->size[0] + x;
                double value;
                if (rod >= 0)
                    value = EX_TREE_WOOD *
                            ex_solid(ex_rod_distance(p, a, b, tree->rods[rod].radius_a, tree->rods[rod].radius_b),
                                     1.0 * voxel);
                else
                    value = ex_clump_value(p, a, tree->clumps[clump].radius, voxel);
                if (value > (double)*out) *out = (float)value;
            }
}

/* Makes a grid of the size of `volume` and fills it with the tree. The caller frees it. */
static inline void ex_tree_fill(const ex_tree *tree, const sps_volume *volume, ex_grid *grid) {
    ex_grid_begin(grid, volume->size, EX_F32);
    for (int i = 0; i < tree->clump_count; ++i) ex_tree_raise(tree, -1, i, volume, (float *)grid->data);
    for (int i = 0; i < tree->rod_count; ++i) ex_tree_raise(tree, i, -1, volume, (float *)grid->data);
    ex_grid_measure(grid);
}

#endif /* EX_TREE_H */
