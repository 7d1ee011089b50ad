/* nvdb.h: reads a grid of a NanoVDB file.
   Reference: nanovdb/NanoVDB.h and nanovdb/io/IO.h of OpenVDB; versions 32.3 and later of that layout.
   Read are grids of float, half, Fp4, Fp8, Fp16 and FpN, in segments or bare; plain, or packed by zip or by Blosc with
   LZ4. Not read are other types, and files of big-endian machines. */

#ifndef EX_NVDB_H
#define EX_NVDB_H

#include "inflate.h"
#include "sparse_grid.h"

enum { EX_NVDB_PLAIN = 0, EX_NVDB_ZIP = 1, EX_NVDB_BLOSC = 2 }; /* how a grid is packed */
enum { EX_NVDB_FLOAT = 1, EX_NVDB_HALF = 9, EX_NVDB_FP4 = 13, EX_NVDB_FP8, EX_NVDB_FP16, EX_NVDB_FPN };
enum { EX_NVDB_GRIDS_MAX = 4096 };

/* Bytes of parts of a grid. The numbers of all types read here are at the same places, except within leaves. */
enum {
    EX_NVDB_META = 176,
    EX_NVDB_HEADER = 672,
    EX_NVDB_TREE = 64,
    EX_NVDB_ROOT = 64,
    EX_NVDB_ROOT_TILE = 32,
    EX_NVDB_LEAF = 96, /* before its values */
    EX_NVDB_UPPER_TABLE = 8256,
    EX_NVDB_LOWER_TABLE = 1088
};

static const char *const ex_nvdb_types[] = {
    "unknown", "float",  "double",  "int16",     "int32",       "int64",      "vec3f",  "vec3d",   "mask",
    "half",    "uint32", "bool",    "rgba8",     "fp4",         "fp8",        "fp16",   "fpN",     "vec4f",
    "vec4d",   "index",  "onindex", "indexmask", "onindexmask", "pointindex", "vec3u8", "vec3u16", "uint8"};

static const char *const ex_nvdb_classes[] = {"unknown",    "level set", "fog volume", "staggered", "point index",
                                              "point data", "topology",  "voxels",     "index",     "tensor"};

static inline int ex_nvdb_is_read(uint32_t type) {
    return type == EX_NVDB_FLOAT || type == EX_NVDB_HALF || (type >= EX_NVDB_FP4 && type <= EX_NVDB_FPN);
}

static inline const char *ex_nvdb_name(const char *const *names, size_t count, uint32_t number) {
    return names[number < count ? number : 0];
}

static inline const char *ex_nvdb_type_name(uint32_t type) {
    return ex_nvdb_name(ex_nvdb_types, sizeof ex_nvdb_types / sizeof *ex_nvdb_types, type);
}

/* ------------------------------------------------------------------------------------------------------ leaves */

/* Bytes of a leaf's values. `flags` has the number of bits of an FpN leaf, as a logarithm. */
static inline size_t ex_nvdb_leaf_bytes(int type, unsigned flags) {
    const size_t bits = type == EX_NVDB_FLOAT ? 32
                        : type == EX_NVDB_FP4 ? 4
                        : type == EX_NVDB_FP8 ? 8
                        : type == EX_NVDB_FPN ? (size_t)1 << (flags >> 5)
                                              : 16;
    return bits * EX_LEAF_VOXELS / 8;
}

/* ex_sparse.decode. Values of the Fp types are multiples of a step above a minimum. */
static inline int ex_nvdb_decode(const ex_sparse *grid, uint64_t at, float out[EX_LEAF_VOXELS], ex_error *error) {
    unsigned char leaf[EX_NVDB_LEAF + 4 * EX_LEAF_VOXELS];
    const unsigned char *values = leaf + EX_NVDB_LEAF;
    if (ex_sparse_fetch(grid, at, EX_NVDB_LEAF, leaf, error)) return 1;
    if (grid->kind == EX_NVDB_FPN && leaf[15] >> 5 > 4)
        return ex_fail(error, "%s: byte %llu: a leaf has values of 2^%d bits", grid->path, (unsigned long long)at,
                       leaf[15] >> 5);
    const size_t bytes = ex_nvdb_leaf_bytes(grid->kind, leaf[15]);
    if (ex_sparse_fetch(grid, at + EX_NVDB_LEAF, bytes, leaf + EX_NVDB_LEAF, error)) return 1;
    const unsigned bits = (unsigned)(bytes * 8 / EX_LEAF_VOXELS);
    const float least = ex_get_f32(leaf + 80), step = ex_get_f32(leaf + 84);
    for (unsigned i = 0; i < EX_LEAF_VOXELS; ++i) {
        if (grid->kind == EX_NVDB_FLOAT) {
            out[i] = ex_get_f32(values + 4 * i);
        } else if (grid->kind == EX_NVDB_HALF) {
            out[i] = ex_get_f16(values + 2 * i);
        } else {
            const unsigned place = i * bits / 8, shift = i * bits % 8;
            const unsigned pair = values[place] | (bits == 16 ? (unsigned)values[place + 1] << 8 : 0);
            const float scaled = (float)(pair >> shift & ((1u << bits) - 1)) * step;
            out[i] = scaled + least;
        }
    }
    return 0;
}

/* --------------------------------------------------------------------------------------------------- the tree */

/* What is held while a tree is read. Nodes cannot be more than there is room for, so that none is read many times. */
typedef struct ex_nvdb_tree {
    ex_cursor *c;
    ex_sparse *grid;
    uint64_t start, size, visited; /* the grid's first byte and bytes; bytes of nodes read so far */
    unsigned char *tables[2];      /* an upper and a lower node */
} ex_nvdb_tree;

/* Moves to a node that is `step` bytes after another and has `bytes` bytes. */
static inline int ex_nvdb_move(ex_nvdb_tree *tree, uint64_t from, uint64_t step, uint64_t bytes, uint64_t *at) {
    const uint64_t end = tree->start + tree->size;
    tree->c->at = from;
    *at = from + step; /* a step may be negative, and wraps around */
    if (*at < tree->start || *at > end || bytes > end - *at)
        return ex_cursor_fail(tree->c, "it would not lie within the grid");
    tree->visited += bytes;
    if (tree->visited > tree->size) return ex_cursor_fail(tree->c, "nodes overlap");
    tree->c->at = *at;
    return 0;
}

static inline int ex_nvdb_leaf(ex_nvdb_tree *tree, uint64_t from, uint64_t step, const int64_t origin[3],
                               uint32_t *slot) {
    unsigned char head[EX_NVDB_LEAF];
    const int type = tree->grid->kind;
    uint64_t at;
    tree->c->what = "a leaf";
    if (ex_nvdb_move(tree, from, step, sizeof head, &at) || ex_cursor_bytes(tree->c, head, sizeof head)) return 1;
    if (type == EX_NVDB_FPN && head[15] >> 5 > 4) return ex_cursor_fail(tree->c, "more than 16 bits a value");
    const uint64_t bytes = ex_nvdb_leaf_bytes(type, head[15]);
    if (ex_nvdb_move(tree, at, sizeof head, bytes, &from)) return 1;
    ex_sparse_add_mask(tree->grid, origin, head + 16);
    return ex_sparse_add_leaf(tree->grid, at, slot, tree->c->error);
}

/* Reads an upper or a lower node, with all below it. */
static inline int ex_nvdb_node(ex_nvdb_tree *tree, int is_lower, uint64_t from, uint64_t step, const int64_t origin[3],
                               uint32_t *slot) {
    ex_sparse *grid = tree->grid;
    ex_sparse_nodes *nodes = is_lower ? &grid->lower : &grid->upper;
    const size_t slots = is_lower ? EX_LOWER_SLOTS : EX_UPPER_SLOTS;
    const size_t table = is_lower ? EX_NVDB_LOWER_TABLE : EX_NVDB_UPPER_TABLE;
    const int bits = is_lower ? EX_LEAF_BITS : EX_LOWER_BITS, log2 = is_lower ? 4 : 5;
    unsigned char *node = tree->tables[is_lower];
    const unsigned char *active = node + 32, *children = active + slots / 8;
    uint64_t at;
    tree->c->what = is_lower ? "a lower node" : "an upper node";
    if (ex_nvdb_move(tree, from, step, table + 8 * slots, &at) || ex_cursor_bytes(tree->c, node, table + 8 * slots))
        return 1;
    if (ex_sparse_add_node(grid, nodes, slots, slot, tree->c->error)) return 1;
    for (size_t i = 0; i < slots; ++i) {
        const unsigned char *entry = node + table + 8 * i;
        const int has_child = children[i / 8] >> i % 8 & 1, is_active = active[i / 8] >> i % 8 & 1;
        const float value = grid->kind == EX_NVDB_HALF ? ex_get_f16(entry) : ex_get_f32(entry);
        if (!has_child && !is_active && ex_same_bits(value, grid->background)) continue; /* most are so */
        const size_t side = ((size_t)1 << log2) - 1, cell[3] = {i >> 2 * log2, i >> log2 & side, i & side};
        uint32_t below = 0;
        int64_t corner[3];
        for (int a = 0; a < 3; ++a) corner[a] = origin[a] + ((int64_t)cell[a] << bits);
        if (!has_child)
            below = ex_sparse_add_tile(grid, corner, bits, value, is_active);
        else if (is_lower ? ex_nvdb_leaf(tree, at, ex_get_u64(entry), corner, &below)
                          : ex_nvdb_node(tree, 1, at, ex_get_u64(entry), corner, &below))
            return 1;
        nodes->list[*slot - 1].slots[i] = below;
    }
    return 0;
}

/* Reads an entry of the root. Its key has the 20 upper bits of z, y and x. */
static inline int ex_nvdb_root_entry(ex_nvdb_tree *tree, uint64_t root, const unsigned char *entry) {
    const uint64_t key = ex_get_u64(entry), step = ex_get_u64(entry + 8);
    const unsigned char *value = entry + 20;
    int32_t at[3];
    int64_t origin[3];
    uint32_t slot;
    for (int a = 0; a < 3; ++a) {
        const uint32_t bits = (uint32_t)(key >> 21 * (2 - a)) << 12;
        memcpy(&at[a], &bits, sizeof bits);
        origin[a] = at[a];
    }
    if (step == 0)
        slot = ex_sparse_add_tile(tree->grid, origin, EX_UPPER_BITS,
                                  tree->grid->kind == EX_NVDB_HALF ? ex_get_f16(value) : ex_get_f32(value),
                                  ex_get_u32(entry + 16) != 0);
    else if (ex_nvdb_node(tree, 0, root, step, origin, &slot))
        return 1;
    ex_sparse_add_root(tree->grid, at, slot);
    return 0;
}

static inline int ex_nvdb_tree_read(ex_nvdb_tree *tree) {
    unsigned char head[EX_NVDB_ROOT];
    const uint64_t from = tree->start + EX_NVDB_HEADER;
    uint64_t step, root;
    char why[64];
    tree->c->what = "the tree";
    tree->c->at = from + 24;
    if (ex_cursor_u64(tree->c, &step)) return 1;
    tree->c->what = "the root";
    if (ex_nvdb_move(tree, from, step, sizeof head, &root) || ex_cursor_bytes(tree->c, head, sizeof head)) return 1;
    const uint32_t count = ex_get_u32(head + 24);
    const uint64_t left = tree->start + tree->size - tree->c->at;
    snprintf(why, sizeof why, "it has %u entries, for which the grid is too short", count);
    if (count > left / EX_NVDB_ROOT_TILE) return ex_cursor_fail(tree->c, why);
    tree->grid->background = tree->grid->kind == EX_NVDB_HALF ? ex_get_f16(head + 28) : ex_get_f32(head + 28);
    if (ex_sparse_count(tree->grid, (uint64_t)count * 2 * sizeof(ex_sparse_root), tree->c->error)) return 1;
    for (uint32_t i = 0; i < count; ++i) {
        unsigned char entry[EX_NVDB_ROOT_TILE];
        uint64_t at;
        tree->c->what = "an entry of the root";
        if (ex_nvdb_move(tree, root, EX_NVDB_ROOT + (uint64_t)i * sizeof entry, sizeof entry, &at) ||
            ex_cursor_bytes(tree->c, entry, sizeof entry) || ex_nvdb_root_entry(tree, root, entry))
            return 1;
    }
    return 0;
}

/* Reads the header of a grid that begins at `start` and has `size` bytes, and its tree. */
static inline int ex_nvdb_grid_read(ex_cursor *c, ex_sparse *grid, uint64_t start, uint64_t size) {
    unsigned char head[EX_NVDB_HEADER];
    ex_nvdb_tree tree = {c, grid, start, size, EX_NVDB_HEADER + EX_NVDB_TREE, {NULL, NULL}};
    char why[64];
    c->at = start, c->what = "the header of the grid";
    if (size < EX_NVDB_HEADER + EX_NVDB_TREE) return ex_cursor_fail(c, "the grid is too short for one");
    if (ex_cursor_bytes(c, head, sizeof head)) return 1;
    if (memcmp(head, "NanoVDB0", 8) != 0 && memcmp(head, "NanoVDB1", 8) != 0)
        return ex_cursor_fail(c, "it does not start with NanoVDB0 or NanoVDB1");
    snprintf(why, sizeof why, "the grid has %llu bytes instead of %llu", (unsigned long long)ex_get_u64(head + 32),
             (unsigned long long)size);
    if (ex_get_u64(head + 32) != size) return ex_cursor_fail(c, why);
    const uint32_t type = ex_get_u32(head + 636);
    snprintf(why, sizeof why, "the type is %u", type);
    if (type != (uint32_t)grid->kind) return ex_cursor_fail(c, why);
    snprintf(grid->grid_class, sizeof grid->grid_class, "%s",
             ex_nvdb_name(ex_nvdb_classes, sizeof ex_nvdb_classes / sizeof *ex_nvdb_classes, ex_get_u32(head + 632)));
    for (int i = 0; i < 3; ++i) {
        for (int a = 0; a < 3; ++a) grid->step[a][i] = ex_get_f64(head + 296 + 88 + 8 * (3 * i + a));
        grid->origin[i] = ex_get_f64(head + 296 + 232 + 8 * i);
    }
    if (ex_sparse_check_map(grid, c->error)) return 1;
    for (int i = 0; i < 2; ++i)
        tree.tables[i] = (unsigned char *)ex_allocate(
            i ? EX_NVDB_LOWER_TABLE + 8 * EX_LOWER_SLOTS : EX_NVDB_UPPER_TABLE + 8 * EX_UPPER_SLOTS, 1);
    const int failed = ex_nvdb_tree_read(&tree);
    free(tree.tables[0]), free(tree.tables[1]);
    return failed || ex_sparse_finish(grid, c->error);
}

/* ------------------------------------------------------------------------------------------------ whole files */

static inline int ex_nvdb_check_version(const ex_cursor *c, uint32_t version) {
    const unsigned major = version >> 21, minor = version >> 10 & 2047;
    if (major == 32 && minor >= 3) return 0;
    return ex_fail(c->error, "%s: NanoVDB version %u.%u is not supported: only 32.3 and later 32s are", c->grid->path,
                   major, minor);
}

static inline int ex_nvdb_add(ex_cursor *c, ex_sparse_entries *entries, ex_sparse_entry *e, uint32_t type) {
    if (entries->count == EX_NVDB_GRIDS_MAX) return ex_cursor_fail(c, "more than 4096 grids are not supported");
    snprintf(e->type, sizeof e->type, "%s", ex_nvdb_type_name(type));
    e->kind = (int)type, e->is_read = ex_nvdb_is_read(type), e->plain = strlen(e->name);
    ex_sparse_add(entries, e);
    return 0;
}

/* Reads the entry of one grid of a segment. */
static inline int ex_nvdb_entry_read(ex_cursor *c, ex_sparse_entry *e, uint32_t *type) {
    unsigned char meta[EX_NVDB_META];
    char why[64];
    memset(e, 0, sizeof *e);
    c->what = "the entry of a grid";
    if (ex_cursor_bytes(c, meta, sizeof meta)) return 1;
    const uint32_t length = ex_get_u32(meta + 136);
    e->size = ex_get_u64(meta), e->packed = ex_get_u64(meta + 8), *type = ex_get_u32(meta + 32);
    snprintf(why, sizeof why, "a name of %u bytes: at most %d are supported", length, EX_SPARSE_NAME_MAX);
    if (length == 0 || length > EX_SPARSE_NAME_MAX) return ex_cursor_fail(c, why);
    if (ex_cursor_bytes(c, e->name, length)) return 1;
    return e->name[length - 1] ? ex_cursor_fail(c, "the name does not end with a 0") : 0;
}

/* A segment: a header, an entry for each grid, the grids. */
static inline int ex_nvdb_segment(ex_cursor *c, ex_sparse_entries *entries) {
    static const char *const codecs[] = {"none", "zip", "Blosc"};
    unsigned char head[16];
    const size_t first = entries->count;
    c->what = "the header of a segment";
    if (ex_cursor_bytes(c, head, sizeof head)) return 1;
    if (memcmp(head, "NanoVDB0", 8) != 0 && memcmp(head, "NanoVDB2", 8) != 0)
        return ex_cursor_fail(c, "it does not start with NanoVDB0 or NanoVDB2");
    if (ex_nvdb_check_version(c, ex_get_u32(head + 8))) return 1;
    const unsigned count = head[12] | (unsigned)head[13] << 8, codec = head[14] | (unsigned)head[15] << 8;
    if (codec >= sizeof codecs / sizeof *codecs)
        return ex_fail(c->error, "%s: codec %u is not supported: only none, zip and Blosc are", c->grid->path, codec);
    for (unsigned i = 0; i < count; ++i) {
        ex_sparse_entry e;
        uint32_t type;
        if (ex_nvdb_entry_read(c, &e, &type)) return 1;
        e.codec = (int)codec;
        if (ex_nvdb_add(c, entries, &e, type)) return 1;
    }
    c->what = "the grids";
    for (size_t i = first; i < entries->count; ++i) {
        entries->list[i].start = c->at;
        if (codec == EX_NVDB_PLAIN && entries->list[i].packed != entries->list[i].size)
            return ex_cursor_fail(c, "two sizes of a grid that is not packed differ");
        if (ex_cursor_skip(c, entries->list[i].packed)) return 1;
    }
    return 0;
}

/* A bare grid: its own header comes first. */
static inline int ex_nvdb_bare(ex_cursor *c, ex_sparse_entries *entries) {
    unsigned char head[EX_NVDB_HEADER];
    const uint64_t at = c->at;
    ex_sparse_entry e;
    memset(&e, 0, sizeof e);
    c->what = "the header of a grid";
    if (ex_cursor_bytes(c, head, sizeof head)) return 1;
    if (memcmp(head, "NanoVDB0", 8) != 0 && memcmp(head, "NanoVDB1", 8) != 0)
        return ex_cursor_fail(c, "it does not start with NanoVDB0 or NanoVDB1");
    if (ex_nvdb_check_version(c, ex_get_u32(head + 16))) return 1;
    e.start = at, e.size = e.packed = ex_get_u64(head + 32), e.codec = EX_NVDB_PLAIN;
    memcpy(e.name, head + 40, sizeof e.name - 1);
    c->at = at;
    if (e.size < sizeof head) return ex_cursor_fail(c, "the grid is shorter than that");
    return ex_cursor_skip(c, e.size) || ex_nvdb_add(c, entries, &e, ex_get_u32(head + 636));
}

/* Reads the entries of all grids, which the caller frees. Only a bare grid has a version at byte 16. */
static inline int ex_nvdb_index(ex_cursor *c, ex_sparse_entries *entries) {
    unsigned char start[20];
    c->what = "the header";
    if (ex_cursor_bytes(c, start, sizeof start)) return 1;
    c->at = 0;
    if (memcmp(start, "NanoVDB", 7) != 0)
        return ex_fail(c->error, "%s: not a NanoVDB file: it does not start with NanoVDB", c->grid->path);
    const int is_bare =
        start[7] == '1' || (start[7] == '0' && ex_get_u32(start + 8) >> 21 != 32 && ex_get_u32(start + 16) >> 21 == 32);
    while (ex_cursor_left(c) > 0)
        if (is_bare ? ex_nvdb_bare(c, entries) : ex_nvdb_segment(c, entries)) return 1;
    if (entries->count == 0) return ex_fail(c->error, "%s: no grids", c->grid->path);
    return 0;
}

/* Unpacks a whole grid into memory. Blosc's buffers follow each other, each after its size. */
static inline int ex_nvdb_unpack(ex_cursor *c, ex_sparse *grid, const ex_sparse_entry *e) {
    unsigned char *packed = NULL, *plain = NULL;
    uint64_t done = 0, end = e->start + e->packed, size = 0;
    int failed = 0;
    c->at = e->start, c->what = "a packed grid";
    if (ex_sparse_count(grid, e->size, c->error) || ex_sparse_count(grid, e->packed, c->error)) return 1;
    if (e->size / 1100 > e->packed) return ex_cursor_fail(c, "it is too short for what its entry says");
    plain = (unsigned char *)ex_allocate((size_t)e->size, 1);
    while (!failed && done < e->size) {
        const uint64_t left = e->size - done, most = (uint64_t)1 << 30;
        const size_t part = (size_t)(e->codec == EX_NVDB_BLOSC && left > most ? most : left);
        failed = ex_cursor_u64(c, &size);
        if (!failed && (c->at > end || size > end - c->at))
            failed = ex_cursor_fail(c, "it is longer than its entry says");
        if (failed) break;
        packed = (unsigned char *)ex_allocate((size_t)size, 1);
        failed = ex_cursor_bytes(c, packed, (size_t)size) ||
                 (e->codec == EX_NVDB_ZIP
                      ? ex_inflate(grid->path, EX_PACKED_ZLIB, packed, (size_t)size, plain, part, NULL, c->error)
                      : ex_blosc(grid->path, packed, (size_t)size, plain + done, part, c->error));
        free(packed);
        done += part;
    }
    if (failed) return free(plain), 1;
    grid->memory = plain, grid->file_size = e->size;
    c->start = c->held = 0;
    return 0;
}

static inline int ex_nvdb_load(ex_cursor *c, ex_sparse *grid, const ex_sparse_entries *entries,
                               const ex_sparse_entry *e) {
    (void)entries;
    if (e->codec == EX_NVDB_PLAIN) return ex_nvdb_grid_read(c, grid, e->start, e->size);
    return ex_nvdb_unpack(c, grid, e) || ex_nvdb_grid_read(c, grid, 0, e->size);
}

static const ex_sparse_format ex_nvdb = {ex_nvdb_index, ex_nvdb_load, ex_nvdb_decode};

#endif /* EX_NVDB_H */
