/* vdb.h: reads a grid of an OpenVDB file.
   Reference: OpenVDB's io/Archive.cc, io/Compression.h and tree/ (openvdb.org); file versions 222, 223 and 224.
   Read are float grids of the standard tree, stored as 32 or 16 bits, not packed or by zip or by Blosc with LZ4, in any
   affine map; and instances of other grids. Not read are other types (vectors, doubles, points), frustum maps, and
   files that were written as a stream, without places of their grids. */

#ifndef EX_VDB_H
#define EX_VDB_H

#include "inflate.h"
#include "sparse_grid.h"

enum { EX_VDB_OLDEST = 222, EX_VDB_NEWEST = 224, EX_VDB_TEXT_MAX = 4096 };
enum { EX_VDB_ZIP = 1, EX_VDB_ACTIVE_ONLY = 2, EX_VDB_BLOSC = 4 }; /* compression */

/* How the values of voxels that are not active are stored. */
enum {
    EX_VDB_ONE = 0,       /* they are the background */
    EX_VDB_MINUS = 1,     /* minus the background */
    EX_VDB_OTHER = 2,     /* a number that follows */
    EX_VDB_BOTH = 3,      /* a mask selects the background, or minus the background */
    EX_VDB_SELECTED = 4,  /* the background, or a number that follows */
    EX_VDB_TWO = 5,       /* one of two numbers that follow */
    EX_VDB_ALL_VALUES = 6 /* all values follow */
};

/* -------------------------------------------------------------------------------------------- values of a node */

/* Room for unpacking a node, and what its values' header says. */
typedef struct ex_vdb_values {
    size_t slots;              /* number of the node's slots */
    const unsigned char *mask; /* its active slots */
    unsigned char *selected;   /* mask of inactive slots with the second value */
    unsigned char *packed, *plain;
    size_t room;              /* bytes of `packed`; `plain` has 4 bytes a slot */
    int way;                  /* in which inactive values are stored */
    float inactive[2];        /* the values of inactive slots */
    size_t count, item, size; /* stored values, bytes of one, bytes of the packed data */
    int is_packed;
} ex_vdb_values;

static inline size_t ex_vdb_room(size_t slots) { return 8 * slots + 1024; }

static inline size_t ex_vdb_popcount(const unsigned char *mask, size_t slots) {
    size_t count = 0;
    for (size_t i = 0; i < slots / 8; i += 8) {
        uint64_t bits = ex_get_u64(mask + i);
        bits -= bits >> 1 & 0x5555555555555555u;
        bits = (bits & 0x3333333333333333u) + (bits >> 2 & 0x3333333333333333u);
        bits = (bits + (bits >> 4)) & 0x0f0f0f0f0f0f0f0fu;
        count += (size_t)(bits * 0x0101010101010101u >> 56);
    }
    return count;
}

static inline int ex_vdb_bit(const unsigned char *mask, size_t i) { return mask[i / 8] >> i % 8 & 1; }

/* Reads the size before packed data. One that is not above 0 is minus the size of data that were not worth packing. */
static inline int ex_vdb_packed_size(ex_cursor *c, ex_vdb_values *v) {
    const size_t plain = v->count * v->item;
    uint64_t size = 0;
    char why[100];
    v->size = plain, v->is_packed = 0;
    if (!(c->grid->compression & (EX_VDB_ZIP | EX_VDB_BLOSC))) return 0;
    if (v->count == 0 && v->item == 2) return 0; /* OpenVDB writes nothing at all */
    if (ex_cursor_u64(c, &size)) return 1;
    if (size > INT64_MAX || size == 0) {
        if (0 - size == plain) return 0;
        snprintf(why, sizeof why, "%llu bytes that are not packed instead of %zu", (unsigned long long)(0 - size),
                 plain);
        return ex_cursor_fail(c, why);
    }
    v->size = (size_t)size, v->is_packed = 1;
    if (size <= v->room && size <= 2 * plain + 1024) return 0;
    snprintf(why, sizeof why, "%llu packed bytes for %zu", (unsigned long long)size, plain);
    return ex_cursor_fail(c, why);
}

/* Reads the header of a node's values. The cursor is then at the data. */
static inline int ex_vdb_values_begin(ex_cursor *c, ex_vdb_values *v) {
    const float background = c->grid->background;
    unsigned char bytes[8], way;
    char why[64];
    if (ex_cursor_bytes(c, &way, 1)) return 1;
    if (way > EX_VDB_ALL_VALUES) {
        snprintf(why, sizeof why, "%d is no way of storing inactive values", way);
        return ex_cursor_fail(c, why);
    }
    v->way = way;
    v->inactive[0] = way == EX_VDB_ONE ? background : -background, v->inactive[1] = background;
    const size_t numbers = way == EX_VDB_TWO ? 2 : way == EX_VDB_OTHER || way == EX_VDB_SELECTED;
    if (ex_cursor_bytes(c, bytes, 4 * numbers)) return 1;
    for (size_t i = 0; i < numbers; ++i) v->inactive[i] = ex_get_f32(bytes + 4 * i);
    const int has_mask = way == EX_VDB_BOTH || way == EX_VDB_SELECTED || way == EX_VDB_TWO;
    if (has_mask && ex_cursor_bytes(c, v->selected, v->slots / 8)) return 1;
    if (!has_mask) memset(v->selected, 0, v->slots / 8);
    const int active_only = c->grid->compression & EX_VDB_ACTIVE_ONLY && way != EX_VDB_ALL_VALUES;
    v->count = active_only ? ex_vdb_popcount(v->mask, v->slots) : v->slots;
    v->item = c->grid->kind == 16 ? 2 : 4;
    return ex_vdb_packed_size(c, v);
}

/* Reads and unpacks the data after the header, and fills in inactive values. */
static inline int ex_vdb_values_end(ex_cursor *c, ex_vdb_values *v, float *out) {
    const ex_sparse *grid = c->grid;
    const size_t plain = v->count * v->item;
    size_t next = 0;
    if (ex_cursor_bytes(c, v->is_packed ? v->packed : v->plain, v->size)) return 1;
    if (v->is_packed && grid->compression & EX_VDB_BLOSC) {
        if (ex_blosc(grid->path, v->packed, v->size, v->plain, plain, c->error)) return 1;
    } else if (v->is_packed) {
        if (ex_inflate(grid->path, EX_PACKED_ZLIB, v->packed, v->size, v->plain, plain, NULL, c->error)) return 1;
    }
    for (size_t i = 0; i < v->slots; ++i) {
        if (v->count < v->slots && !ex_vdb_bit(v->mask, i))
            out[i] = v->inactive[ex_vdb_bit(v->selected, i)];
        else
            out[i] = v->item == 2 ? ex_get_f16(v->plain + 2 * next) : ex_get_f32(v->plain + 4 * next), ++next;
    }
    return 0;
}

/* ex_sparse.decode: a leaf is a mask and values. */
static inline int ex_vdb_decode(const ex_sparse *grid, uint64_t at, float out[EX_LEAF_VOXELS], ex_error *error) {
    unsigned char window[2560], mask[64], selected[64], plain[4 * EX_LEAF_VOXELS], packed[8 * EX_LEAF_VOXELS + 1024];
    ex_cursor c = {grid, at, 0, 0, sizeof window, window, "a leaf", error};
    ex_vdb_values v = {EX_LEAF_VOXELS, mask, selected, packed, plain, sizeof packed, 0, {0, 0}, 0, 0, 0, 0};
    return ex_cursor_bytes(&c, mask, sizeof mask) || ex_vdb_values_begin(&c, &v) || ex_vdb_values_end(&c, &v, out);
}

/* ------------------------------------------------------------------------------------------------- the header */

/* Reads a text with its length before it. */
static inline int ex_vdb_text(ex_cursor *c, char *out, size_t room) {
    uint32_t length;
    char why[64];
    if (ex_cursor_u32(c, &length)) return 1;
    if (length >= room) {
        snprintf(why, sizeof why, "a text of %u bytes: at most %zu are supported", length, room - 1);
        return ex_cursor_fail(c, why);
    }
    if (ex_cursor_bytes(c, out, length)) return 1;
    out[length] = '\0';
    return 0;
}

/* Skips metadata but for the class. OpenVDB's own count of voxels and box may be missing or out of date. */
static inline int ex_vdb_metadata(ex_cursor *c, char *grid_class, size_t room) {
    char name[EX_VDB_TEXT_MAX], type[EX_VDB_TEXT_MAX], why[64];
    uint32_t count, size;
    if (ex_cursor_u32(c, &count)) return 1;
    snprintf(why, sizeof why, "%u entries of metadata", count);
    if (count > ex_cursor_left(c) / 12) return ex_cursor_fail(c, why);
    for (uint32_t i = 0; i < count; ++i) {
        if (ex_vdb_text(c, name, sizeof name) || ex_vdb_text(c, type, sizeof type)) return 1;
        if (grid_class && strcmp(name, "class") == 0 && strcmp(type, "string") == 0) {
            if (ex_vdb_text(c, grid_class, room)) return 1;
        } else if (ex_cursor_u32(c, &size) || ex_cursor_skip(c, size)) {
            return 1;
        }
    }
    return 0;
}

/* Grids of the same name have numbers after it, which are shown in brackets. Returns the length without one. */
static inline size_t ex_vdb_show_suffix(char name[EX_SPARSE_NAME_MAX]) {
    char *mark = strchr(name, 30);
    const size_t length = strlen(name);
    if (!mark) return length;
    *mark = '[';
    if (length + 1 < EX_SPARSE_NAME_MAX) memcpy(name + length, "]", 2);
    return (size_t)(mark - name);
}

/* Bits of a number of a grid of this type; 0 if the type is not supported. */
static inline int ex_vdb_bits(const char *type) {
    return strcmp(type, "Tree_float_5_4_3") == 0 ? 32 : strcmp(type, "Tree_float_5_4_3_HalfFloat") == 0 ? 16 : 0;
}

static inline int ex_vdb_entry_read(ex_cursor *c, ex_sparse_entry *e) {
    memset(e, 0, sizeof *e);
    c->what = "the entry of a grid";
    if (ex_vdb_text(c, e->name, sizeof e->name) || ex_vdb_text(c, e->type, sizeof e->type) ||
        ex_vdb_text(c, e->parent, sizeof e->parent) || ex_cursor_u64(c, &e->start) || ex_cursor_u64(c, &e->blocks) ||
        ex_cursor_u64(c, &e->end))
        return 1;
    e->kind = ex_vdb_bits(e->type), e->is_read = e->kind > 0;
    e->plain = ex_vdb_show_suffix(e->name);
    ex_vdb_show_suffix(e->parent);
    const int rises = c->at <= e->start && e->start <= e->end &&
                      (e->parent[0] || (e->start <= e->blocks && e->blocks <= e->end)); /* an instance has no leaves */
    if (!rises || e->end > c->grid->file_size)
        return ex_fail(c->error, "%s: byte %llu: grid %s: places %llu, %llu, %llu do not rise within the file",
                       c->grid->path, (unsigned long long)c->at, ex_quoted(e->name).text, (unsigned long long)e->start,
                       (unsigned long long)e->blocks, (unsigned long long)e->end);
    c->at = e->end;
    return 0;
}

/* Reads the start of the file, and the entries of all grids, which the caller frees. */
static inline int ex_vdb_index(ex_cursor *c, ex_sparse_entries *entries) {
    unsigned char start[57];
    uint32_t count;
    char why[64];
    c->what = "the header";
    if (ex_cursor_bytes(c, start, sizeof start)) return 1;
    if (memcmp(start, " BDV\0\0\0\0", 8) != 0)
        return ex_fail(c->error, "%s: not an OpenVDB file: it does not start with ' BDV'", c->grid->path);
    const uint32_t version = ex_get_u32(start + 8);
    if (version < EX_VDB_OLDEST || version > EX_VDB_NEWEST)
        return ex_fail(c->error, "%s: file version %u is not supported: only 222, 223 and 224 are", c->grid->path,
                       version);
    if (start[20] == 0)
        return ex_fail(c->error, "%s: written as a stream, without the places of its grids: not supported",
                       c->grid->path);
    c->what = "the metadata of the file";
    if (ex_vdb_metadata(c, NULL, 0)) return 1;
    c->what = "the number of grids";
    if (ex_cursor_u32(c, &count)) return 1;
    snprintf(why, sizeof why, "%u, for which the file is too short", count);
    if (count > ex_cursor_left(c) / 36) return ex_cursor_fail(c, why);
    if (count == 0) return ex_fail(c->error, "%s: no grids", c->grid->path);
    if (count > c->grid->max_bytes / sizeof *entries->list) return ex_cursor_fail(c, "too many (--max-bytes)");
    for (uint32_t i = 0; i < count; ++i) {
        ex_sparse_entry e;
        if (ex_vdb_entry_read(c, &e)) return 1;
        ex_sparse_add(entries, &e);
    }
    return 0;
}

/* Puts the numbers of a map into the grid. OpenVDB's matrices multiply row vectors. */
static inline void ex_vdb_set_map(ex_sparse *grid, int is_matrix, const double *scale, const double *shift,
                                  const double *matrix) {
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i) {
            grid->step[a][i] = is_matrix ? matrix[4 * a + i] : a != i ? 0 : scale ? scale[i] : 1;
            grid->origin[i] = is_matrix ? matrix[12 + i] : shift ? shift[i] : 0;
        }
}

/* Reads the map from indices to the world. Numbers that follow from others are skipped. */
static inline int ex_vdb_map(ex_cursor *c, ex_sparse *grid) {
    static const struct {
        const char *name;
        int count, scale, shift, matrix; /* numbers; where the parts are among them, -1: nowhere */
    } maps[] = {{"UniformScaleMap", 15, 0, -1, -1},  {"ScaleMap", 15, 0, -1, -1},
                {"TranslationMap", 3, -1, 0, -1},    {"UniformScaleTranslateMap", 18, 3, 0, -1},
                {"ScaleTranslateMap", 18, 3, 0, -1}, {"AffineMap", 16, -1, -1, 0},
                {"UnitaryMap", 16, -1, -1, 0}};
    unsigned char bytes[8 * 18];
    double numbers[18] = {0};
    char name[EX_SPARSE_NAME_MAX];
    size_t kind = 0;
    c->what = "the map of the grid";
    if (ex_vdb_text(c, name, sizeof name)) return 1;
    while (kind < sizeof maps / sizeof *maps && strcmp(maps[kind].name, name) != 0) ++kind;
    if (kind == sizeof maps / sizeof *maps)
        return ex_fail(c->error, "%s: grid %s: its map is a %s, which is not supported: only affine ones are",
                       grid->path, ex_quoted(grid->name).text, ex_quoted(name).text);
    if (ex_cursor_bytes(c, bytes, 8 * (size_t)maps[kind].count)) return 1;
    for (int i = 0; i < maps[kind].count; ++i) numbers[i] = ex_get_f64(bytes + 8 * i);
    if (maps[kind].matrix == 0 && (numbers[3] != 0 || numbers[7] != 0 || numbers[11] != 0 || numbers[15] != 1))
        return ex_cursor_fail(c, "the matrix is not affine");
    ex_vdb_set_map(grid, maps[kind].matrix == 0, maps[kind].scale < 0 ? NULL : numbers + maps[kind].scale,
                   maps[kind].shift < 0 ? NULL : numbers + maps[kind].shift, numbers);
    return ex_sparse_check_map(grid, c->error);
}

/* Reads what stands before the tree: compression, metadata, map. */
static inline int ex_vdb_grid_header(ex_cursor *c, ex_sparse *grid, const ex_sparse_entry *e) {
    char why[64];
    c->at = e->start, c->what = "the header of the grid";
    if (ex_cursor_u32(c, &grid->compression)) return 1;
    snprintf(why, sizeof why, "compression %u is not supported", grid->compression);
    if (grid->compression > 7) return ex_cursor_fail(c, why);
    grid->grid_class[0] = '\0';
    return ex_vdb_metadata(c, grid->grid_class, sizeof grid->grid_class) || ex_vdb_map(c, grid);
}

/* --------------------------------------------------------------------------------------------------- the tree */

/* What is held while a tree is read. */
typedef struct ex_vdb_tree {
    ex_cursor *c;
    ex_sparse *grid;
    ex_vdb_values values;
    float *numbers[2];       /* the values of an upper and of a lower node */
    unsigned char *masks[2]; /* children, and active slots, of each */
    unsigned char *leaves;   /* the leaves' masks, 64 bytes each */
    size_t leaf_count, capacity;
} ex_vdb_tree;

static inline int ex_vdb_tree_begin(ex_vdb_tree *tree, ex_cursor *c, ex_sparse *grid) {
    const size_t slots = EX_UPPER_SLOTS;
    memset(tree, 0, sizeof *tree);
    if (ex_sparse_count(grid, ex_vdb_room(slots) + 16 * slots, c->error)) return 1;
    tree->c = c, tree->grid = grid;
    tree->values.selected = (unsigned char *)ex_allocate(slots / 8, 1);
    tree->values.room = ex_vdb_room(slots);
    tree->values.packed = (unsigned char *)ex_allocate(tree->values.room, 1);
    tree->values.plain = (unsigned char *)ex_allocate(slots, sizeof(float));
    for (int i = 0; i < 2; ++i) {
        const size_t own = i ? EX_LOWER_SLOTS : EX_UPPER_SLOTS;
        tree->numbers[i] = (float *)ex_allocate(own, sizeof(float));
        tree->masks[i] = (unsigned char *)ex_allocate(own / 4, 1);
    }
    return 0;
}

static inline void ex_vdb_tree_end(ex_vdb_tree *tree) {
    for (int i = 0; i < 2; ++i) free(tree->numbers[i]), free(tree->masks[i]);
    free(tree->values.selected), free(tree->values.packed), free(tree->values.plain), free(tree->leaves);
}

/* Reads the mask of a leaf, whose place in the file is found later. */
static inline int ex_vdb_leaf(ex_vdb_tree *tree, const int64_t origin[3], uint32_t *slot) {
    ex_sparse *grid = tree->grid;
    if (ex_sparse_count(grid, 64, tree->c->error) || ex_sparse_add_leaf(grid, 0, slot, tree->c->error)) return 1;
    tree->leaves = (unsigned char *)ex_grow(tree->leaves, tree->leaf_count, &tree->capacity, 64);
    unsigned char *mask = tree->leaves + 64 * tree->leaf_count++;
    tree->c->what = "the mask of a leaf";
    if (ex_cursor_bytes(tree->c, mask, 64)) return 1;
    ex_sparse_add_mask(grid, origin, mask);
    return 0;
}

/* Reads an upper or a lower node, with all below it. */
static inline int ex_vdb_node(ex_vdb_tree *tree, int is_lower, const int64_t origin[3], uint32_t *slot) {
    ex_sparse *grid = tree->grid;
    ex_sparse_nodes *nodes = is_lower ? &grid->lower : &grid->upper;
    const size_t slots = is_lower ? EX_LOWER_SLOTS : EX_UPPER_SLOTS;
    const int bits = is_lower ? EX_LEAF_BITS : EX_LOWER_BITS, log2 = is_lower ? 4 : 5;
    const unsigned char *children = tree->masks[is_lower], *active = children + slots / 8;
    if (ex_sparse_add_node(grid, nodes, slots, slot, tree->c->error)) return 1;
    tree->c->what = is_lower ? "a lower node" : "an upper node";
    if (ex_cursor_bytes(tree->c, tree->masks[is_lower], slots / 4)) return 1;
    tree->values.slots = slots, tree->values.mask = active;
    if (ex_vdb_values_begin(tree->c, &tree->values) ||
        ex_vdb_values_end(tree->c, &tree->values, tree->numbers[is_lower]))
        return 1;
    for (size_t i = 0; i < slots; ++i) {
        const int has_child = ex_vdb_bit(children, i), is_active = ex_vdb_bit(active, i);
        const float value = tree->numbers[is_lower][i];
        if (!has_child && !is_active && ex_same_bits(value, grid->background)) continue; /* most are so */
        const size_t side = ((size_t)1 << log2) - 1, at[3] = {i >> 2 * log2, i >> log2 & side, i & side};
        uint32_t below = 0;
        int64_t corner[3];
        for (int a = 0; a < 3; ++a) corner[a] = origin[a] + ((int64_t)at[a] << bits);
        if (!has_child)
            below = ex_sparse_add_tile(grid, corner, bits, value, is_active);
        else if (is_lower ? ex_vdb_leaf(tree, corner, &below) : ex_vdb_node(tree, 1, corner, &below))
            return 1;
        nodes->list[*slot - 1].slots[i] = below;
    }
    return 0;
}

/* Reads the place of an entry of the root. Entries rise, first along x; OpenVDB stores leaves in that order. */
static inline int ex_vdb_root_place(ex_cursor *c, int is_first, int32_t at[3]) {
    int32_t before[3];
    unsigned char bytes[12];
    memcpy(before, at, sizeof before);
    if (ex_cursor_bytes(c, bytes, sizeof bytes)) return 1;
    for (int a = 0; a < 3; ++a) {
        const uint32_t stored = ex_get_u32(bytes + 4 * a);
        memcpy(&at[a], &stored, sizeof stored);
        if (stored & 4095) return ex_cursor_fail(c, "the place of an entry is not a multiple of 4096");
    }
    const int step = at[0] != before[0] ? 0 : at[1] != before[1] ? 1 : 2;
    return !is_first && at[step] <= before[step] ? ex_cursor_fail(c, "the places of entries do not rise") : 0;
}

static inline int ex_vdb_root_tile(ex_vdb_tree *tree, int is_first, int32_t at[3]) {
    unsigned char bytes[5];
    tree->c->what = "a tile of the root";
    if (ex_vdb_root_place(tree->c, is_first, at) || ex_cursor_bytes(tree->c, bytes, sizeof bytes)) return 1;
    const int64_t origin[3] = {at[0], at[1], at[2]};
    ex_sparse_add_root(tree->grid, at,
                       ex_sparse_add_tile(tree->grid, origin, EX_UPPER_BITS, ex_get_f32(bytes), bytes[4] != 0));
    return 0;
}

static inline int ex_vdb_root_child(ex_vdb_tree *tree, int is_first, int32_t at[3]) {
    uint32_t slot;
    tree->c->what = "a child of the root";
    if (ex_vdb_root_place(tree->c, is_first, at)) return 1;
    const int64_t origin[3] = {at[0], at[1], at[2]};
    if (ex_vdb_node(tree, 0, origin, &slot)) return 1;
    ex_sparse_add_root(tree->grid, at, slot);
    return 0;
}

/* Finds where each leaf begins in the file. */
static inline int ex_vdb_leaves(ex_vdb_tree *tree) {
    unsigned char mask[64];
    tree->values.slots = EX_LEAF_VOXELS;
    tree->c->what = "a leaf";
    for (size_t i = 0; i < tree->leaf_count; ++i) {
        tree->grid->leaves[i] = tree->c->at;
        if (ex_cursor_bytes(tree->c, mask, sizeof mask)) return 1;
        if (memcmp(mask, tree->leaves + 64 * i, sizeof mask) != 0)
            return ex_cursor_fail(tree->c, "its mask is not the one that the tree has");
        tree->values.mask = tree->leaves + 64 * i;
        if (ex_vdb_values_begin(tree->c, &tree->values) || ex_cursor_skip(tree->c, tree->values.size)) return 1;
    }
    return 0;
}

static inline int ex_vdb_tree_read(ex_vdb_tree *tree, const ex_sparse_entry *e) {
    ex_cursor *c = tree->c;
    uint32_t buffers, tiles, children;
    int32_t at[3] = {0, 0, 0};
    unsigned char bytes[4];
    char why[96];
    c->what = "the tree";
    if (ex_cursor_u32(c, &buffers)) return 1;
    if (buffers != 1) return ex_cursor_fail(c, "leaves have more than one buffer: not supported");
    if (ex_cursor_bytes(c, bytes, sizeof bytes) || ex_cursor_u32(c, &tiles) || ex_cursor_u32(c, &children)) return 1;
    tree->grid->background = ex_get_f32(bytes);
    snprintf(why, sizeof why, "the root has %u tiles and %u children, for which the file is too short", tiles,
             children);
    if (tiles > ex_cursor_left(c) / 17 || children > ex_cursor_left(c) / 9000) return ex_cursor_fail(c, why);
    if (ex_sparse_count(tree->grid, ((uint64_t)tiles + children) * 2 * sizeof(ex_sparse_root), c->error)) return 1;
    for (uint32_t i = 0; i < tiles; ++i)
        if (ex_vdb_root_tile(tree, i == 0, at)) return 1;
    for (uint32_t i = 0; i < children; ++i)
        if (ex_vdb_root_child(tree, i == 0, at)) return 1;
    c->at = e->blocks;
    return ex_vdb_leaves(tree);
}

/* Reads the header of a grid, and the tree: its own, or that of the grid which it is an instance of. */
static inline int ex_vdb_load(ex_cursor *c, ex_sparse *grid, const ex_sparse_entries *entries,
                              const ex_sparse_entry *e) {
    ex_vdb_tree tree;
    if (ex_vdb_grid_header(c, grid, e)) return 1;
    if (e->parent[0]) {
        ex_sparse other = *grid;
        size_t i = 0;
        while (i < entries->count && strcmp(entries->list[i].name, e->parent) != 0) ++i;
        if (i == entries->count || entries->list[i].parent[0] || strcmp(entries->list[i].type, e->type) != 0)
            return ex_fail(c->error, "%s: grid %s is an instance of %s, which is not such a grid", grid->path,
                           ex_quoted(e->name).text, ex_quoted(e->parent).text);
        e = &entries->list[i];
        if (ex_vdb_grid_header(c, &other, e)) return 1;
        grid->compression = other.compression;
    }
    const int failed = ex_vdb_tree_begin(&tree, c, grid) || ex_vdb_tree_read(&tree, e);
    ex_vdb_tree_end(&tree);
    return failed || ex_sparse_finish(grid, c->error);
}

static const ex_sparse_format ex_vdb = {ex_vdb_index, ex_vdb_load, ex_vdb_decode};

#endif /* EX_VDB_H */
