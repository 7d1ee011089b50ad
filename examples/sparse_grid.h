/* sparse_grid.h: a tree of voxels as .vdb and .nvdb files have it, with the callbacks through which the library reads
   it. Only the tree is in memory; leaves, 8^3 voxels each, are read and unpacked when a block needs them.

   A tree has three levels of nodes: upper (32^3 slots of 128^3 voxels), lower (16^3 slots of 8^3) and leaves. A slot
   without a child is a tile: one value for all its voxels. Within a node, z runs fastest and x slowest. */

#ifndef EX_SPARSE_GRID_H
#define EX_SPARSE_GRID_H

#include "blosc.h"
#include "volume.h"

#ifndef __wasm__
#include <pthread.h>
#else /* one thread, and no header of others */
typedef int pthread_mutex_t;
static inline void pthread_mutex_init(pthread_mutex_t *mutex, const void *attributes) { (void)attributes, *mutex = 0; }
static inline void pthread_mutex_lock(pthread_mutex_t *mutex) { *mutex += 1; }
static inline void pthread_mutex_unlock(pthread_mutex_t *mutex) { *mutex -= 1; }
static inline void pthread_mutex_destroy(const pthread_mutex_t *mutex) { (void)mutex; }
#endif

enum { EX_LEAF_VOXELS = 512, EX_LOWER_SLOTS = 4096, EX_UPPER_SLOTS = 32768 };
enum { EX_LEAF_BITS = 3, EX_LOWER_BITS = 7, EX_UPPER_BITS = 12 }; /* log2 of voxels along an edge */
enum { EX_SPARSE_NAME_MAX = 256 };
#define EX_SPARSE_RANGE_LEVELS 3     /* sps_volume.range_levels: range_fn is cheap for 64^3 and for 512^3 voxels */
#define EX_SPARSE_EDGE_MAX     65536 /* voxels that the library takes along an axis */
#define EX_SPARSE_HIGHEST      1e18f /* the value that bounds a leaf: no larger one is valid */

/* What a slot of a node or of the root refers to: 0: nothing, so that it has the background's value; the number of a
   child plus 1; or EX_SLOT_TILE and the number of a value. */
#define EX_SLOT_TILE 0x80000000u

typedef struct ex_sparse_node {
    uint32_t *slots;
    float high; /* bounds the values within it */
} ex_sparse_node;

typedef struct ex_sparse_nodes {
    ex_sparse_node *list;
    size_t count, capacity;
} ex_sparse_nodes;

/* A slot of the root, which covers 4096^3 voxels. */
typedef struct ex_sparse_root {
    int32_t origin[3];
    uint32_t slot;
} ex_sparse_root;

typedef struct ex_sparse {
    char path[EX_PATH_MAX];
    char name[EX_SPARSE_NAME_MAX], grid_class[64], type[64];
    FILE *file;            /* read by pread, so that several workers may read at once */
    uint64_t file_size;    /* bytes that can be fetched */
    unsigned char *memory; /* instead of the file: a grid that was packed as a whole */
    uint64_t bytes, max_bytes;
    int low[3], size[3];  /* the box of active voxels, in indices */
    double step[3][3];    /* from one voxel to the next along x, y, z, in the world */
    double origin[3];     /* the centre of voxel 0,0,0 */
    uint64_t voxel_count; /* active voxels, with those of tiles */
    float background;
    double zero, unit, least, most; /* as those of ex_grid */
    ex_sparse_root *roots;
    size_t root_count, root_capacity;
    ex_sparse_nodes upper, lower;
    uint64_t *leaves; /* where each begins in the file */
    size_t leaf_count, leaf_capacity;
    float *tiles;
    size_t tile_count, tile_capacity;
    int64_t lo[3], hi[3];   /* while the tree is built: the box so far, both ends inclusive */
    int shift[3], cells[3]; /* voxel 0,0,0 of the box within the table; the table's size */
    uint32_t *table;        /* the root's slots that the box meets, x fastest */
    uint32_t compression;   /* how leaves are stored: see vdb.h and nvdb.h */
    int kind;
    int (*decode)(const struct ex_sparse *grid, uint64_t at, float out[EX_LEAF_VOXELS], ex_error *error);
    pthread_mutex_t mutex; /* guards what follows: the first failure while reading */
    int has_failed;
    ex_error failure;
} ex_sparse;

/* ---------------------------------------------------------------------------------------------- building a tree */

static inline int ex_sparse_begin(ex_sparse *grid, const char *path, uint64_t max_bytes, ex_error *error) {
    memset(grid, 0, sizeof *grid);
    pthread_mutex_init(&grid->mutex, NULL);
    grid->unit = 1, grid->most = (double)FLT_MAX, grid->max_bytes = max_bytes;
    for (int a = 0; a < 3; ++a) grid->lo[a] = INT64_MAX, grid->hi[a] = INT64_MIN;
    if (strlen(path) >= sizeof grid->path) return ex_fail(error, "%.64s...: the name is too long", path);
    memcpy(grid->path, path, strlen(path) + 1);
    grid->file = ex_open(path, &grid->file_size, error);
    return grid->file == NULL;
}

static inline void ex_sparse_free(ex_sparse *grid) {
    if (grid->path[0]) pthread_mutex_destroy(&grid->mutex);
    for (size_t i = 0; i < grid->upper.count; ++i) free(grid->upper.list[i].slots);
    for (size_t i = 0; i < grid->lower.count; ++i) free(grid->lower.list[i].slots);
    free(grid->upper.list), free(grid->lower.list), free(grid->roots), free(grid->leaves), free(grid->tiles);
    free(grid->table), free(grid->memory);
    if (grid->file) fclose(grid->file);
    memset(grid, 0, sizeof *grid);
}

/* Counts memory that is about to be allocated, and fails beyond the limit. */
static inline int ex_sparse_count(ex_sparse *grid, uint64_t bytes, ex_error *error) {
    if (bytes > grid->max_bytes || grid->bytes > grid->max_bytes - bytes)
        return ex_fail(error, "%s: the grid takes more memory than the %llu bytes that are allowed (--max-bytes)",
                       grid->path, (unsigned long long)grid->max_bytes);
    grid->bytes += bytes;
    return 0;
}

/* Copies bytes of the file, or of what was unpacked from it. */
static inline int ex_sparse_fetch(const ex_sparse *grid, uint64_t at, size_t size, unsigned char *out,
                                  ex_error *error) {
    if (at > grid->file_size || size > grid->file_size - at)
        return ex_fail(error, "%s: byte %llu: the file ends before %zu more bytes", grid->path, (unsigned long long)at,
                       size);
    if (grid->memory) {
        memcpy(out, grid->memory + at, size);
        return 0;
    }
    for (size_t got = 0; got < size;) {
        const ssize_t step = pread(fileno(grid->file), out + got, size - got, (off_t)(at + got));
        if (step < 0 && errno == EINTR) continue;
        if (step <= 0)
            return ex_fail(error, "%s: byte %llu: reading failed: %s", grid->path, (unsigned long long)(at + got),
                           step < 0 ? strerror(errno) : "the file became shorter");
        got += (size_t)step;
    }
    return 0;
}

static inline void ex_sparse_widen(ex_sparse *grid, const int64_t lo[3], int64_t edge) {
    for (int a = 0; a < 3; ++a) {
        if (lo[a] < grid->lo[a]) grid->lo[a] = lo[a];
        if (lo[a] + edge - 1 > grid->hi[a]) grid->hi[a] = lo[a] + edge - 1;
    }
}

/* Widens the box by the active voxels of a leaf, whose mask has 64 bytes, and counts them. Each byte is a row along z,
   and eight of them are a plane of constant x. */
static inline void ex_sparse_add_mask(ex_sparse *grid, const int64_t origin[3], const unsigned char mask[64]) {
    unsigned char along_z = 0, along_y = 0, along_x = 0;
    for (int i = 0; i < 64; ++i) {
        if (!mask[i]) continue;
        along_z = (unsigned char)(along_z | mask[i]);
        along_y = (unsigned char)(along_y | 1 << i % 8);
        along_x = (unsigned char)(along_x | 1 << i / 8);
        for (unsigned bits = mask[i]; bits; bits &= bits - 1) ++grid->voxel_count;
    }
    const unsigned char along[3] = {along_x, along_y, along_z};
    for (int a = 0; a < 3 && along_z; ++a) {
        int first = 0, last = 7;
        while (!(along[a] >> first & 1)) ++first;
        while (!(along[a] >> last & 1)) --last;
        if (origin[a] + first < grid->lo[a]) grid->lo[a] = origin[a] + first;
        if (origin[a] + last > grid->hi[a]) grid->hi[a] = origin[a] + last;
    }
}

static inline int ex_same_bits(float a, float b) {
    uint32_t bits[2];
    memcpy(&bits[0], &a, sizeof a);
    memcpy(&bits[1], &b, sizeof b);
    return bits[0] == bits[1];
}

/* The slot of a tile. Neighbours mostly have the same value, which is kept once. An active one of 2^bits voxels along
   an edge widens the box. */
static inline uint32_t ex_sparse_add_tile(ex_sparse *grid, const int64_t origin[3], int bits, float value, int active) {
    if (active) {
        ex_sparse_widen(grid, origin, (int64_t)1 << bits);
        grid->voxel_count += (uint64_t)1 << 3 * bits;
    }
    if (ex_same_bits(value, grid->background)) return 0;
    if (grid->tile_count == 0 || !ex_same_bits(value, grid->tiles[grid->tile_count - 1])) {
        grid->tiles = (float *)ex_grow(grid->tiles, grid->tile_count, &grid->tile_capacity, sizeof value);
        grid->tiles[grid->tile_count++] = value;
    }
    return EX_SLOT_TILE | (uint32_t)(grid->tile_count - 1);
}

/* Appends a node with empty slots and stores its own slot. */
static inline int ex_sparse_add_node(ex_sparse *grid, ex_sparse_nodes *nodes, size_t slots, uint32_t *slot,
                                     ex_error *error) {
    if (ex_sparse_count(grid, slots * sizeof(uint32_t) + sizeof(ex_sparse_node), error)) return 1;
    nodes->list = (ex_sparse_node *)ex_grow(nodes->list, nodes->count, &nodes->capacity, sizeof *nodes->list);
    nodes->list[nodes->count].slots = (uint32_t *)ex_allocate(slots, sizeof(uint32_t));
    nodes->list[nodes->count++].high = 0;
    *slot = (uint32_t)nodes->count;
    return 0;
}

static inline int ex_sparse_add_leaf(ex_sparse *grid, uint64_t at, uint32_t *slot, ex_error *error) {
    if (grid->leaf_count >= EX_SLOT_TILE - 1) return ex_fail(error, "%s: too many leaves", grid->path);
    if (ex_sparse_count(grid, sizeof at, error)) return 1;
    grid->leaves = (uint64_t *)ex_grow(grid->leaves, grid->leaf_count, &grid->leaf_capacity, sizeof at);
    grid->leaves[grid->leaf_count++] = at;
    *slot = (uint32_t)grid->leaf_count;
    return 0;
}

static inline void ex_sparse_add_root(ex_sparse *grid, const int32_t origin[3], uint32_t slot) {
    grid->roots = (ex_sparse_root *)ex_grow(grid->roots, grid->root_count, &grid->root_capacity, sizeof *grid->roots);
    memcpy(grid->roots[grid->root_count].origin, origin, sizeof grid->roots->origin);
    grid->roots[grid->root_count++].slot = slot;
}

/* What a stored number means. NaN stays NaN. */
static inline float ex_sparse_value(const ex_sparse *grid, float stored) {
    const float value = (stored - (float)grid->zero) / (float)grid->unit;
    return value < (float)grid->least ? (float)grid->least : value > (float)grid->most ? (float)grid->most : value;
}

/* The value of a slot that has no child. */
static inline float ex_sparse_tile(const ex_sparse *grid, uint32_t slot) {
    return ex_sparse_value(grid, slot ? grid->tiles[slot & ~EX_SLOT_TILE] : grid->background);
}

/* Bounds the values of a slot: exact for a tile, and as far as values may go for a leaf. */
static inline float ex_sparse_slot_high(const ex_sparse *grid, const ex_sparse_nodes *children, uint32_t slot) {
    if (slot && !(slot & EX_SLOT_TILE)) return children ? children->list[slot - 1].high : EX_SPARSE_HIGHEST;
    const float value = ex_sparse_tile(grid, slot);
    return value >= 0 && value <= EX_SPARSE_HIGHEST ? value : EX_SPARSE_HIGHEST;
}

static inline void ex_sparse_bound_nodes(ex_sparse *grid, ex_sparse_nodes *nodes, size_t slots,
                                         const ex_sparse_nodes *children) {
    for (size_t i = 0; i < nodes->count; ++i) {
        ex_sparse_node *node = &nodes->list[i];
        node->high = 0;
        for (size_t k = 0; k < slots; ++k) {
            const float high = ex_sparse_slot_high(grid, children, node->slots[k]);
            if (high > node->high) node->high = high;
        }
    }
}

/* Sets what stored numbers mean, before the grid is read. With a range, its two ends become the values 0 and 1. A fog
   of a level set is 1 inside and 0 outside; between, it falls linearly across the band, and is 1/2 on the surface. */
static inline void ex_sparse_scale(ex_sparse *grid, const double range[2], int fog) {
    if (range[0] != range[1]) grid->zero = range[0], grid->unit = range[1] - range[0], grid->most = 1;
    if (fog) grid->zero = (double)grid->background, grid->unit = -2 * (double)grid->background, grid->most = 1;
    ex_sparse_bound_nodes(grid, &grid->lower, EX_LOWER_SLOTS, NULL);
    ex_sparse_bound_nodes(grid, &grid->upper, EX_UPPER_SLOTS, &grid->lower);
}

static inline int ex_sparse_compare_roots(const void *left, const void *right) {
    const ex_sparse_root *a = (const ex_sparse_root *)left, *b = (const ex_sparse_root *)right;
    for (int i = 0; i < 3; ++i)
        if (a->origin[i] != b->origin[i]) return a->origin[i] < b->origin[i] ? -1 : 1;
    return 0;
}

/* Finds the box and makes the root's table. */
static inline int ex_sparse_finish(ex_sparse *grid, ex_error *error) {
    int64_t base[3];
    size_t count = 1;
    if (grid->root_count > 0) qsort(grid->roots, grid->root_count, sizeof *grid->roots, ex_sparse_compare_roots);
    for (size_t i = 1; i < grid->root_count; ++i)
        if (ex_sparse_compare_roots(&grid->roots[i - 1], &grid->roots[i]) == 0)
            return ex_fail(error, "%s: grid %s: its root has two entries for %d,%d,%d", grid->path,
                           ex_quoted(grid->name).text, grid->roots[i].origin[0], grid->roots[i].origin[1],
                           grid->roots[i].origin[2]);
    if (grid->voxel_count == 0)
        return ex_fail(error, "%s: grid %s has no active voxels", grid->path, ex_quoted(grid->name).text);
    for (int a = 0; a < 3; ++a) {
        const int64_t size = grid->hi[a] - grid->lo[a] + 1;
        if (size > EX_SPARSE_EDGE_MAX)
            return ex_fail(error, "%s: grid %s has %lld voxels along %c: at most %d are supported", grid->path,
                           ex_quoted(grid->name).text, (long long)size, 'x' + a, EX_SPARSE_EDGE_MAX);
        base[a] = grid->lo[a] - (grid->lo[a] & 4095);
        grid->low[a] = (int)grid->lo[a], grid->size[a] = (int)size;
        grid->shift[a] = (int)(grid->lo[a] - base[a]);
        grid->cells[a] = ((grid->shift[a] + grid->size[a] - 1) >> EX_UPPER_BITS) + 1;
        count *= (size_t)grid->cells[a];
    }
    grid->table = (uint32_t *)ex_allocate(count, sizeof *grid->table);
    for (size_t i = 0; i < grid->root_count; ++i) {
        int64_t at[3];
        int inside = 1;
        for (int a = 0; a < 3; ++a) {
            at[a] = (grid->roots[i].origin[a] - base[a]) / 4096;
            inside &= grid->roots[i].origin[a] >= base[a] && at[a] < grid->cells[a];
        }
        if (inside) grid->table[(at[2] * grid->cells[1] + at[1]) * grid->cells[0] + at[0]] = grid->roots[i].slot;
    }
    free(grid->roots);
    grid->roots = NULL, grid->root_count = grid->root_capacity = 0;
    return 0;
}

/* Where the box lies. Voxel centres are at whole indices, so its faces are half a voxel further out. */
static inline sps_placement ex_sparse_placement(const ex_sparse *grid) {
    sps_placement placement;
    for (int i = 0; i < 3; ++i) {
        placement.origin[i] = grid->origin[i];
        for (int a = 0; a < 3; ++a) {
            placement.origin[i] += (grid->low[a] - 0.5) * grid->step[a][i];
            placement.axis[a][i] = grid->size[a] * grid->step[a][i];
        }
    }
    return placement;
}

/* Checks the map from indices to the world. */
static inline int ex_sparse_check_map(const ex_sparse *grid, ex_error *error) {
    const double(*m)[3] = grid->step;
    for (int i = 0; i < 9; ++i)
        if (!(fabs(m[i / 3][i % 3]) <= EX_COORDINATE_MAX) || !(fabs(grid->origin[i % 3]) <= EX_COORDINATE_MAX))
            return ex_fail(error, "%s: grid %s: its map has a number that is out of range", grid->path,
                           ex_quoted(grid->name).text);
    const double volume = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                          m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                          m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    if (volume != 0) return 0;
    return ex_fail(error, "%s: grid %s: its map makes voxels flat", grid->path, ex_quoted(grid->name).text);
}

/* Refuses what cannot be shown, or not in the way that was asked. */
static inline int ex_sparse_check(const ex_sparse *grid, int fog, ex_error *error) {
    const int is_level_set = strcmp(grid->grid_class, "level set") == 0;
    const ex_quote quote = ex_quoted(grid->name);
    const char *name = quote.text;
    if (!(fabsf(grid->background) <= FLT_MAX))
        return ex_fail(error, "%s: grid %s: its background is not a finite number", grid->path, name);
    if (is_level_set && !fog)
        return ex_fail(error, "%s: grid %s is a level set, not a density: --fog reads it as a fog", grid->path, name);
    if (fog && !is_level_set)
        return ex_fail(error, "%s: grid %s is not a level set: --fog says nothing about it", grid->path, name);
    if (fog && !(grid->background > 0))
        return ex_fail(error, "%s: grid %s: its background %g is not a distance", grid->path, name,
                       (double)grid->background);
    return 0;
}

/* ------------------------------------------------------------------------------------------------- reading it */

/* The slot of a leaf's place in the table; of a leaf, or of the tile around it. */
static inline uint32_t ex_sparse_find(const ex_sparse *grid, const int at[3]) {
    const int *cells = grid->cells;
    const int root = ((at[2] >> 12) * cells[1] + (at[1] >> 12)) * cells[0] + (at[0] >> 12);
    uint32_t slot = grid->table[root];
    if (!slot || slot & EX_SLOT_TILE) return slot;
    slot = grid->upper.list[slot - 1].slots[(at[0] >> 7 & 31) << 10 | (at[1] >> 7 & 31) << 5 | (at[2] >> 7 & 31)];
    if (!slot || slot & EX_SLOT_TILE) return slot;
    return grid->lower.list[slot - 1].slots[(at[0] >> 3 & 15) << 8 | (at[1] >> 3 & 15) << 4 | (at[2] >> 3 & 15)];
}

static inline int ex_sparse_fail(ex_sparse *grid, const ex_error *why) {
    pthread_mutex_lock(&grid->mutex);
    if (!grid->has_failed) grid->failure = *why;
    grid->has_failed = 1;
    pthread_mutex_unlock(&grid->mutex);
    return 1;
}

/* Copies to a block what a cell of 8^3 voxels at `at` shares with it: values of its own, or one for all. */
static inline void ex_sparse_copy(const int at[3], const int first[3], const int size[3], const float *values,
                                  float one, float *out) {
    int from[3], to[3];
    for (int a = 0; a < 3; ++a) {
        from[a] = at[a] > first[a] ? at[a] : first[a];
        to[a] = at[a] + 8 < first[a] + size[a] ? at[a] + 8 : first[a] + size[a];
    }
    for (int z = from[2]; z < to[2]; ++z)
        for (int y = from[1]; y < to[1]; ++y) {
            float *row = out + ((size_t)(z - first[2]) * (size_t)size[1] + (size_t)(y - first[1])) * (size_t)size[0];
            for (int x = from[0]; x < to[0]; ++x)
                row[x - first[0]] = values ? values[(x & 7) << 6 | (y & 7) << 3 | (z & 7)] : one;
        }
}

/* sps_volume.read_fn over an ex_sparse. It changes nothing but the first failure, under a lock: the volume may be
   `concurrent`. */
static inline int ex_sparse_read(void *user, const int lo[3], const int size[3], float *out) {
    ex_sparse *grid = (ex_sparse *)user;
    float values[EX_LEAF_VOXELS];
    int first[3], at[3];
    for (int a = 0; a < 3; ++a) first[a] = lo[a] + grid->shift[a];
    for (at[2] = first[2] & ~7; at[2] < first[2] + size[2]; at[2] += 8)
        for (at[1] = first[1] & ~7; at[1] < first[1] + size[1]; at[1] += 8)
            for (at[0] = first[0] & ~7; at[0] < first[0] + size[0]; at[0] += 8) {
                const uint32_t slot = ex_sparse_find(grid, at);
                const int is_leaf = slot && !(slot & EX_SLOT_TILE);
                ex_error error;
                if (is_leaf && grid->decode(grid, grid->leaves[slot - 1], values, &error))
                    return ex_sparse_fail(grid, &error);
                for (int i = 0; is_leaf && i < EX_LEAF_VOXELS; ++i) values[i] = ex_sparse_value(grid, values[i]);
                ex_sparse_copy(at, first, size, is_leaf ? values : NULL, is_leaf ? 0 : ex_sparse_tile(grid, slot), out);
            }
    return 0;
}

/* Bounds the values within a box, both ends inclusive, in the slots of one node; or of the root, whose cells are
   `cells`. 2^bits voxels along an edge are a slot. */
static inline float ex_sparse_bound(const ex_sparse *grid, const uint32_t *slots, int bits, const int from[3],
                                    const int to[3]) {
    const int is_root = bits == EX_UPPER_BITS, log2 = bits == EX_LOWER_BITS ? 5 : 4, edge = 1 << bits;
    const ex_sparse_nodes *children = is_root ? &grid->upper : bits == EX_LOWER_BITS ? &grid->lower : NULL;
    float high = 0;
    int at[3];
    for (at[2] = from[2] >> bits; at[2] <= to[2] >> bits; ++at[2])
        for (at[1] = from[1] >> bits; at[1] <= to[1] >> bits; ++at[1])
            for (at[0] = from[0] >> bits; at[0] <= to[0] >> bits && high < EX_SPARSE_HIGHEST; ++at[0]) {
                const int place = is_root ? (at[2] * grid->cells[1] + at[1]) * grid->cells[0] + at[0]
                                          : (at[0] << log2 | at[1]) << log2 | at[2];
                const uint32_t slot = slots[place];
                float bound = ex_sparse_slot_high(grid, children, slot);
                if (children && slot && !(slot & EX_SLOT_TILE) && bound > high) {
                    int first[3], last[3], whole = 1;
                    for (int a = 0; a < 3; ++a) {
                        const int start = at[a] << bits;
                        first[a] = from[a] > start ? from[a] - start : 0;
                        last[a] = to[a] < start + edge ? to[a] - start : edge - 1;
                        whole &= first[a] == 0 && last[a] == edge - 1;
                    }
                    if (!whole)
                        bound = ex_sparse_bound(grid, children->list[slot - 1].slots, is_root ? 7 : 3, first, last);
                }
                if (bound > high) high = bound;
            }
    return high;
}

/* sps_volume.range_fn over an ex_sparse, likewise. No leaf is read: what has one may hold any value. Where there is
   none, the bound is exact. */
static inline int ex_sparse_range(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    const ex_sparse *grid = (const ex_sparse *)user;
    int from[3], to[3];
    for (int a = 0; a < 3; ++a) from[a] = lo[a] + grid->shift[a], to[a] = from[a] + size[a] - 1;
    out_min_max[0] = 0;
    out_min_max[1] = ex_sparse_bound(grid, grid->table, EX_UPPER_BITS, from, to);
    return 0;
}

/* The largest value of the grid. All leaves are read. */
static inline int ex_sparse_highest(ex_sparse *grid, float *highest, ex_error *error) {
    float values[EX_LEAF_VOXELS];
    *highest = 0;
    for (size_t i = 0; i < grid->leaf_count; ++i) {
        if (grid->decode(grid, grid->leaves[i], values, error)) return 1;
        for (int k = 0; k < EX_LEAF_VOXELS; ++k) {
            const float value = ex_sparse_value(grid, values[k]);
            if (value > *highest) *highest = value;
        }
    }
    for (size_t i = 0; i <= grid->tile_count; ++i) {
        const float value = ex_sparse_value(grid, i < grid->tile_count ? grid->tiles[i] : grid->background);
        if (value > *highest) *highest = value;
    }
    return 0;
}

/* ------------------------------------------------------------------------------------------- fetching in order */

/* Reads a file from front to back through a window. */
typedef struct ex_cursor {
    const ex_sparse *grid;
    uint64_t at, start; /* the next byte, and the window's first */
    size_t held, room;
    unsigned char *window;
    const char *what; /* what is being read, for errors */
    ex_error *error;
} ex_cursor;

static inline int ex_cursor_fail(const ex_cursor *c, const char *why) {
    return ex_fail(c->error, "%s: byte %llu: %s: %s", c->grid->path, (unsigned long long)c->at, c->what, why);
}

static inline uint64_t ex_cursor_left(const ex_cursor *c) {
    return c->at < c->grid->file_size ? c->grid->file_size - c->at : 0;
}

static inline int ex_cursor_skip(ex_cursor *c, uint64_t bytes) {
    if (bytes > ex_cursor_left(c)) return ex_cursor_fail(c, "the file ends within it");
    c->at += bytes;
    return 0;
}

static inline int ex_cursor_bytes(ex_cursor *c, void *out, size_t size) {
    unsigned char *to = (unsigned char *)out;
    if (size > ex_cursor_left(c)) return ex_cursor_fail(c, "the file ends within it");
    while (size > 0) {
        if (c->at < c->start || c->at >= c->start + c->held) {
            if (size >= c->room) {
                if (ex_sparse_fetch(c->grid, c->at, size, to, c->error)) return 1;
                c->at += size;
                return 0;
            }
            const uint64_t left = ex_cursor_left(c);
            c->start = c->at, c->held = left < c->room ? (size_t)left : c->room;
            if (ex_sparse_fetch(c->grid, c->start, c->held, c->window, c->error)) return 1;
        }
        const size_t before = (size_t)(c->at - c->start), there = c->held - before;
        const size_t step = size < there ? size : there;
        memcpy(to, c->window + before, step);
        to += step, size -= step, c->at += step;
    }
    return 0;
}

static inline int ex_cursor_u32(ex_cursor *c, uint32_t *out) {
    unsigned char bytes[4];
    if (ex_cursor_bytes(c, bytes, sizeof bytes)) return 1;
    *out = ex_get_u32(bytes);
    return 0;
}

static inline int ex_cursor_u64(ex_cursor *c, uint64_t *out) {
    unsigned char bytes[8];
    if (ex_cursor_bytes(c, bytes, sizeof bytes)) return 1;
    *out = ex_get_u64(bytes);
    return 0;
}

static inline float ex_get_f32(const unsigned char *from) {
    const uint32_t bits = ex_get_u32(from);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline double ex_get_f64(const unsigned char *from) {
    const uint64_t bits = ex_get_u64(from);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* IEEE 754 half precision. */
static inline float ex_get_f16(const unsigned char *from) {
    const uint32_t half = (uint32_t)from[0] | (uint32_t)from[1] << 8, sign = half >> 15, fraction = half & 1023;
    const uint32_t exponent = half >> 10 & 31;
    uint32_t bits = sign << 31 | (exponent == 31 ? 255 : exponent + 112) << 23 | fraction << 13;
    float value;
    if (exponent == 0) value = ldexpf((float)fraction, -24), memcpy(&bits, &value, sizeof bits), bits |= sign << 31;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* ---------------------------------------------------------------------------------------------- files of grids */

/* What a file says about a grid before its data. */
typedef struct ex_sparse_entry {
    char name[EX_SPARSE_NAME_MAX], type[EX_SPARSE_NAME_MAX];
    size_t plain;                    /* characters of the name without the number of a second grid of this name */
    int kind, is_read;               /* how numbers are stored; 1: this type of grid is supported */
    uint64_t start;                  /* byte at which the grid begins */
    char parent[EX_SPARSE_NAME_MAX]; /* .vdb: it is an instance of that grid */
    uint64_t blocks, end;            /* .vdb: bytes at which its leaves and the next entry begin */
    uint64_t packed, size;           /* .nvdb: its bytes in the file, and when unpacked */
    int codec;                       /* .nvdb */
} ex_sparse_entry;

typedef struct ex_sparse_entries {
    ex_sparse_entry *list;
    size_t count, capacity;
} ex_sparse_entries;

/* A file format. index_fn reads the entries of all grids, load_fn one grid. */
typedef struct ex_sparse_format {
    int (*index_fn)(ex_cursor *c, ex_sparse_entries *entries);
    int (*load_fn)(ex_cursor *c, ex_sparse *grid, const ex_sparse_entries *entries, const ex_sparse_entry *e);
    int (*decode_fn)(const ex_sparse *grid, uint64_t at, float out[EX_LEAF_VOXELS], ex_error *error);
} ex_sparse_format;

static inline void ex_sparse_add(ex_sparse_entries *entries, const ex_sparse_entry *e) {
    entries->list =
        (ex_sparse_entry *)ex_grow(entries->list, entries->count, &entries->capacity, sizeof *entries->list);
    entries->list[entries->count++] = *e;
}

static inline int ex_sparse_is_named(const ex_sparse_entry *e, const char *name) {
    return strcmp(e->name, name) == 0 || (strlen(name) == e->plain && strncmp(e->name, name, e->plain) == 0);
}

static inline int ex_sparse_load(const ex_sparse_format *format, ex_cursor *c, ex_sparse *grid,
                                 const ex_sparse_entries *entries, const ex_sparse_entry *e) {
    snprintf(grid->name, sizeof grid->name, "%s", e->name);
    snprintf(grid->type, sizeof grid->type, "%.*s", (int)sizeof grid->type - 1, e->type);
    grid->kind = e->kind;
    grid->decode = format->decode_fn;
    if (!e->is_read)
        return ex_fail(c->error, "%s: grid %s is of %s, which is not supported: only float grids are", grid->path,
                       ex_quoted(e->name).text, ex_quoted(e->type).text);
    return format->load_fn(c, grid, entries, e);
}

/* Opens a grid by its name; name NULL: `density`, or else the first that can be read. The caller frees the grid, also
   after a failure. */
static inline int ex_sparse_open(const ex_sparse_format *format, ex_sparse *grid, const char *path, const char *name,
                                 uint64_t max_bytes, ex_error *error) {
    unsigned char window[16384];
    ex_sparse_entries entries = {NULL, 0, 0};
    const ex_sparse_entry *chosen = NULL;
    if (ex_sparse_begin(grid, path, max_bytes, error)) return 1;
    ex_cursor c = {grid, 0, 0, 0, sizeof window, window, "", error};
    int failed = format->index_fn(&c, &entries);
    for (size_t i = failed ? 0 : entries.count; i-- > 0;) {
        const ex_sparse_entry *e = &entries.list[i];
        const int is_wanted = ex_sparse_is_named(e, name ? name : "density");
        const int is_better = is_wanted || !chosen || !ex_sparse_is_named(chosen, "density");
        if (name ? is_wanted : e->is_read && is_better) chosen = e;
    }
    if (!failed && !chosen && name)
        failed = ex_fail(error, "%s: no grid %s: --list-grids lists what there is", path, ex_quoted(name).text);
    if (!failed) failed = ex_sparse_load(format, &c, grid, &entries, chosen ? chosen : entries.list);
    free(entries.list);
    return failed;
}

/* Calls `tell` for each grid of a file. If a grid cannot be read, `reason` says why, and its voxels and box are
   unknown. */
static inline int ex_sparse_list(const ex_sparse_format *format, const char *path, uint64_t max_bytes,
                                 void (*tell)(void *user, const ex_sparse *grid, const char *reason), void *user,
                                 ex_error *error) {
    unsigned char window[16384];
    ex_sparse_entries entries = {NULL, 0, 0};
    ex_sparse file;
    int failed = ex_sparse_begin(&file, path, max_bytes, error);
    ex_cursor start = {&file, 0, 0, 0, sizeof window, window, "", error};
    failed = failed || format->index_fn(&start, &entries);
    for (size_t i = 0; i < entries.count && !failed; ++i) {
        ex_sparse grid;
        ex_error why = {""};
        ex_cursor c = {&grid, 0, 0, 0, sizeof window, window, "", &why};
        failed = ex_sparse_begin(&grid, path, max_bytes, error);
        if (!failed) {
            if (!ex_sparse_load(format, &c, &grid, &entries, &entries.list[i])) why.text[0] = '\0';
            tell(user, &grid, entries.list[i].is_read ? why.text : "not a float grid");
        }
        ex_sparse_free(&grid);
    }
    free(entries.list);
    ex_sparse_free(&file);
    return failed;
}

#endif /* EX_SPARSE_GRID_H */
