/* A grid of few leaves and tiles, as tests write it into files, and what a reader must make of it. It shares nothing
   with the readers but the struct that they fill. Include after check.h and sparse_grid.h. */

#ifndef SPARSE_MODEL_H
#define SPARSE_MODEL_H

/* A cube of voxels with one value. */
typedef struct tile {
    int at[3];
    float value;
    int active;
} tile;

/* A grid: leaves at multiples of 8; tiles of 8, 128 and 4096 voxels along an edge. */
typedef struct model {
    int leaves[8][3];
    int leaf_count;
    tile tiles[3][4];
    int tile_counts[3];
    float background;
    int way;  /* how inactive values differ, 0..6; as .vdb files tell them apart */
    int bits; /* values of leaves are multiples of a step with this many bits; 0: any */
} model;

/* The first leaf has voxels here and there, the second has all, others have one. */
static inline int voxel_is_active(int leaf, int n) { return leaf == 0 ? n * 7 % 5 < 2 : leaf == 1 || n == 85; }
static inline float voxel_value(int leaf, int n) { return 0.5f + (float)(n * 37 % 509 + leaf) / 64; }

/* The number that stands for a value, of a model whose leaves have steps: the value is 1/4 and that many eighths. */
static inline int voxel_code(const model *m, int n) { return (int)((unsigned)(n * 40503) % (1u << m->bits)); }

/* The value of an inactive slot of a node. */
static inline float inactive_value(const model *m, int n) {
    const float others[7] = {m->background,
                             -m->background,
                             0.75f,
                             n % 3 ? m->background : -m->background,
                             n % 3 ? m->background : 0.75f,
                             n % 3 ? 0.375f : 0.75f,
                             (float)(n % 997) / 64};
    return others[m->way];
}

static inline int contains(const int at[3], const int cube[3], int edge) {
    for (int a = 0; a < 3; ++a)
        if (at[a] < cube[a] || at[a] >= cube[a] + edge) return 0;
    return 1;
}

static inline int place_in(const int at[3], int edge, int slot, int log2) {
    int n = 0;
    for (int a = 0; a < 3; ++a) n = n << log2 | (at[a] & (edge - 1)) / slot;
    return n;
}

/* Whether a cube has a leaf, or a tile of a level below `level`. */
static inline int is_divided(const model *m, const int cube[3], int edge, int level) {
    for (int i = 0; i < m->leaf_count; ++i)
        if (contains(m->leaves[i], cube, edge)) return 1;
    for (int k = 0; k < level; ++k)
        for (int i = 0; i < m->tile_counts[k]; ++i)
            if (contains(m->tiles[k][i].at, cube, edge)) return 1;
    return 0;
}

static const tile *find_tile(const model *m, const int at[3], int level) {
    static const int edges[3] = {8, 128, 4096};
    for (int i = 0; i < m->tile_counts[level]; ++i)
        if (contains(at, m->tiles[level][i].at, edges[level])) return &m->tiles[level][i];
    return NULL;
}

/* The value of a voxel, and whether it is active. */
static inline float expected(const model *m, const int at[3], int *active) {
    static const int edges[3] = {128, 4096, 0}, slots[3] = {8, 128, 4096}, log2s[3] = {4, 5, 0};
    *active = 0;
    for (int i = 0; i < m->leaf_count; ++i) {
        if (!contains(at, m->leaves[i], 8)) continue;
        const int n = place_in(at, 8, 1, 3);
        *active = voxel_is_active(i, n);
        if (m->bits) return 0.25f + (float)voxel_code(m, n) / 8;
        return *active ? voxel_value(i, n) : inactive_value(m, n);
    }
    for (int level = 0; level < 3; ++level) {
        const tile *found = find_tile(m, at, level);
        if (found) {
            *active = found->active;
            return found->value;
        }
        if (level == 2) break;
        int cube[3];
        for (int a = 0; a < 3; ++a) cube[a] = at[a] & ~(edges[level] - 1);
        if (is_divided(m, cube, edges[level], level + 1))
            return inactive_value(m, place_in(at, edges[level], slots[level], log2s[level]));
    }
    return m->background;
}

static inline void leaf_mask(int leaf, unsigned char mask[64]) {
    memset(mask, 0, 64);
    for (int n = 0; n < 512; ++n)
        if (voxel_is_active(leaf, n)) mask[n / 8] = (unsigned char)(mask[n / 8] | 1 << n % 8);
}

/* Origins of the root's children, rising first along x. */
static inline int find_roots(const model *m, int roots[8][3]) {
    int count = 0;
    for (int x = -8192; x <= 8192; x += 4096)
        for (int y = -8192; y <= 8192; y += 4096)
            for (int z = -8192; z <= 8192; z += 4096) {
                const int at[3] = {x, y, z};
                if (count < 8 && is_divided(m, at, 4096, 2)) memcpy(roots[count++], at, sizeof at);
            }
    return count;
}

/* Leaves on both sides of 0. */
static inline model plain_model(void) {
    model m;
    memset(&m, 0, sizeof m);
    m.leaf_count = 3;
    const int places[3][3] = {{-16, -8, 0}, {-8, -8, 0}, {0, 0, 8}};
    memcpy(m.leaves, places, sizeof places);
    return m;
}

/* Tiles of every level, active or not, between the same leaves. */
static inline model tiled_model(void) {
    model m = plain_model();
    const tile lower[2] = {{{8, 0, 0}, 1.5f, 1}, {{24, 0, 0}, 2.25f, 0}}, upper = {{128, -128, 256}, 3.5f, 1};
    const tile roots[2] = {{{-8192, 0, 0}, 0.25f, 0}, {{4096, 0, -4096}, 4.5f, 1}};
    memcpy(m.tiles[0], lower, sizeof lower), m.tile_counts[0] = 2;
    m.tiles[1][0] = upper, m.tile_counts[1] = 1;
    memcpy(m.tiles[2], roots, sizeof roots), m.tile_counts[2] = 2;
    return m;
}

/* -------------------------------------------------------------------------------------------------------- comparing */

/* The box of active voxels within a cube around 0. */
static inline uint64_t find_box(const model *m, int reach, int lo[3], int hi[3]) {
    uint64_t count = 0;
    int at[3];
    for (int a = 0; a < 3; ++a) lo[a] = reach, hi[a] = -reach;
    for (at[0] = -reach; at[0] < reach; ++at[0])
        for (at[1] = -reach; at[1] < reach; ++at[1])
            for (at[2] = -reach; at[2] < reach; ++at[2]) {
                int active;
                expected(m, at, &active);
                count += (uint64_t)active;
                for (int a = 0; active && a < 3; ++a) {
                    if (at[a] < lo[a]) lo[a] = at[a];
                    if (at[a] > hi[a]) hi[a] = at[a];
                }
            }
    return count;
}

/* Compares a block with what was written, and with its bounds. Returns the number of differences. */
static inline int compare_block(ex_sparse *grid, const model *m, const int lo[3], const int size[3]) {
    static float block[40 * 40 * 40];
    float range[2], most = 0;
    int wrong = 0;
    const int count = size[0] * size[1] * size[2];
    memset(block, 255, sizeof block);
    if (ex_sparse_read(grid, lo, size, block)) return count;
    ex_sparse_range(grid, lo, size, range);
    for (int i = 0; i < count; ++i) {
        const int at[3] = {grid->low[0] + lo[0] + i % size[0], grid->low[1] + lo[1] + i / size[0] % size[1],
                           grid->low[2] + lo[2] + i / size[0] / size[1]};
        int active;
        float value = expected(m, at, &active);
        if (value < 0) value = 0;
        wrong += memcmp(&value, &block[i], sizeof value) != 0;
        if (value > most) most = value;
    }
    return wrong + !(range[0] <= 0 && range[1] >= most);
}

/* All of the box, in blocks of odd sizes. */
static inline int compare_all(ex_sparse *grid, const model *m) {
    const int steps[3] = {11, 38, 13};
    int at[3], wrong = 0;
    for (at[2] = 0; at[2] < grid->size[2]; at[2] += steps[2])
        for (at[1] = 0; at[1] < grid->size[1]; at[1] += steps[1])
            for (at[0] = 0; at[0] < grid->size[0]; at[0] += steps[0]) {
                int size[3];
                for (int a = 0; a < 3; ++a)
                    size[a] = grid->size[a] - at[a] < steps[a] ? grid->size[a] - at[a] : steps[a];
                wrong += compare_block(grid, m, at, size);
            }
    return wrong;
}

#endif /* SPARSE_MODEL_H */
