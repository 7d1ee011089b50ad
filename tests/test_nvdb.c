/* NanoVDB files, which examples/nvdb.h reads. Debian has no NanoVDB, so that files are made here, by a second writer
   that shares nothing with the reader: it was written from the format's description alone. Values are those that were
   written, bit for bit; and whatever is wrong ends in one line that names the file. */

#include "check.h"
#include "packed_files.h"
#include "nvdb.h"
#include "sparse_model.h"
#include "command_line.h"

#define FORMAT ex_nvdb
#define NAME   "t.nvdb"
#include "sparse_files.h"

/* --------------------------------------------------------------------------------------------------------- the writer
 */

enum { NONE = 0, ZIPPED = 1, BLOSCED = 2 };
enum { FLOAT_TYPE = 1, DOUBLE_TYPE = 2, HALF_TYPE = 9, FP4_TYPE = 13, FP8_TYPE = 14, FP16_TYPE = 15, FPN_TYPE = 16 };

/* How a file is written. */
typedef struct recipe {
    int type, codec, minor, grid_class;
    char magic;
    blosc_style blosc;
    double matrix[9], shift[3];
} recipe;

static recipe plain_recipe(void) {
    recipe r;
    memset(&r, 0, sizeof r);
    r.type = FLOAT_TYPE, r.minor = 7, r.grid_class = 2, r.magic = '0';
    r.blosc.item = 4, r.blosc.shuffled = 1, r.blosc.block = 1 << 18;
    for (int i = 0; i < 3; ++i) r.matrix[4 * i] = 0.5;
    return r;
}

/* Pads with zeros up to a place after `start`. */
static void pad(file_bytes *file, size_t start, size_t to) {
    if (CHECK(file->count <= start + to)) put_zeros(file, start + to - file->count);
}

static void put_value(file_bytes *file, const recipe *r, float value) {
    if (r->type == HALF_TYPE)
        put_half(file, value), put_integer(file, 0, 2);
    else
        put_float(file, value);
}

static void put_place(file_bytes *file, const int at[3]) {
    for (int a = 0; a < 3; ++a) put_integer(file, (uint32_t)at[a], 4);
}

/* Codes of a few bits, the lower first. */
static void put_codes(file_bytes *file, const model *m) {
    unsigned held = 0;
    int bits = 0;
    for (int n = 0; n < 512; ++n) {
        held |= (unsigned)voxel_code(m, n) << bits;
        for (bits += m->bits; bits >= 8; bits -= 8) put_integer(file, held & 255, 1), held >>= 8;
    }
}

static void put_leaf(file_bytes *file, const model *m, const recipe *r, int leaf) {
    const size_t start = file->count;
    unsigned char mask[64];
    int log2 = 0;
    while (1 << log2 < m->bits) ++log2;
    leaf_mask(leaf, mask);
    mark(file, "leaf");
    put_place(file, m->leaves[leaf]);
    put_integer(file, 7 | 7 << 8 | 7 << 16, 3), put_integer(file, (uint64_t)log2 << 5, 1);
    put(file, mask, 64);
    if (m->bits) put_float(file, 0.25f), put_float(file, 0.125f);
    pad(file, start, 96);
    if (m->bits) {
        put_codes(file, m);
        return;
    }
    for (int n = 0; n < 512; ++n) {
        const float value = voxel_is_active(leaf, n) ? voxel_value(leaf, n) : inactive_value(m, n);
        if (r->type == HALF_TYPE)
            put_half(file, value);
        else
            put_float(file, value);
    }
}

/* Where nodes will be: first all upper ones, then all lower ones, then leaves. */
typedef struct layout {
    int origins[2][8][3]; /* lower nodes, and upper ones */
    size_t at[2][8];
    int counts[2];
    size_t leaves[8];
} layout;

/* Bytes of a node of each level. */
static const size_t node_bytes[2] = {1088 + 8 * 4096, 8256 + 8 * 32768};

static void find_nodes(const model *m, layout *l) {
    l->counts[1] = find_roots(m, l->origins[1]);
    l->counts[0] = 0;
    for (int i = 0; i < l->counts[1]; ++i)
        for (int n = 0; n < 32768; ++n) {
            const int *o = l->origins[1][i];
            const int at[3] = {o[0] + (n >> 10) * 128, o[1] + (n >> 5 & 31) * 128, o[2] + (n & 31) * 128};
            if (l->counts[0] < 8 && is_divided(m, at, 128, 1)) memcpy(l->origins[0][l->counts[0]++], at, sizeof at);
        }
}

static size_t place_nodes(const model *m, const recipe *r, layout *l, size_t at) {
    for (int level = 1; level >= 0; --level)
        for (int i = 0; i < l->counts[level]; ++i, at += node_bytes[level]) l->at[level][i] = at;
    for (int i = 0; i < m->leaf_count; ++i) {
        l->leaves[i] = at;
        at += 96 + (size_t)(m->bits ? m->bits : r->type == HALF_TYPE ? 16 : 32) * 64;
    }
    return at;
}

/* The place of the node or leaf at a corner; 0 if there is none. */
static size_t child_at(const model *m, const layout *l, int level, const int at[3]) {
    for (int i = 0; level > 0 && i < l->counts[0]; ++i)
        if (memcmp(l->origins[0][i], at, sizeof l->origins[0][i]) == 0) return l->at[0][i];
    for (int i = 0; level == 0 && i < m->leaf_count; ++i)
        if (memcmp(m->leaves[i], at, sizeof m->leaves[i]) == 0) return l->leaves[i];
    return 0;
}

static void put_node(file_bytes *file, const model *m, const recipe *r, const layout *l, int level, int number) {
    static unsigned char masks[2][4096]; /* active slots, children */
    const int log2 = level ? 5 : 4, slots = 1 << 3 * log2, edge = level ? 128 : 8, side = (1 << log2) - 1;
    const int *o = l->origins[level][number];
    const size_t start = file->count;
    file_bytes table = {0};
    memset(masks, 0, sizeof masks);
    for (int n = 0; n < slots; ++n) {
        const int at[3] = {o[0] + (n >> 2 * log2) * edge, o[1] + (n >> log2 & side) * edge, o[2] + (n & side) * edge};
        const tile *found = find_tile(m, at, level);
        const size_t child = child_at(m, l, level, at);
        if (child || (found && found->active))
            masks[child != 0][n / 8] = (unsigned char)(masks[child != 0][n / 8] | 1 << n % 8);
        if (child)
            put_integer(&table, child - l->at[level][number], 8);
        else
            put_value(&table, r, found ? found->value : inactive_value(m, n)), put_integer(&table, 0, 4);
    }
    mark(file, level ? "upper" : "lower");
    put_place(file, o), put_place(file, o), put_integer(file, 0, 8);
    put(file, masks[0], (size_t)slots / 8), put(file, masks[1], (size_t)slots / 8);
    pad(file, start, level ? 8256 : 1088);
    mark(file, level ? "upper table" : "lower table");
    put(file, table.data, table.count);
    file_free(&table);
}

static void put_root_entry(file_bytes *file, const int at[3], uint64_t child, int active) {
    uint64_t key = 0;
    for (int a = 0; a < 3; ++a) key = key << 21 | (uint32_t)at[a] >> 12;
    mark(file, child ? "root child" : "root tile");
    put_integer(file, key, 8), put_integer(file, child, 8), put_integer(file, (uint64_t)active, 4);
}

/* The header of a grid: 672 bytes. Its map is there twice, the first time rounded to floats; here a lie. */
static void put_grid_header(file_bytes *file, const recipe *r, const char *name, size_t size) {
    const size_t start = file->count;
    mark(file, "grid magic");
    put(file, r->magic == '0' ? "NanoVDB0" : "NanoVDB1", 8), put_integer(file, ~0ull, 8);
    mark(file, "grid version");
    put_integer(file, 32u << 21 | (unsigned)r->minor << 10 | 3, 4), put_integer(file, 0, 4);
    put_integer(file, 0, 4), put_integer(file, 1, 4);
    mark(file, "grid size"), put_integer(file, size, 8);
    put(file, name, strlen(name));
    pad(file, start, 296);
    for (int i = 0; i < 22; ++i) put_float(file, 77);
    mark(file, "map");
    for (int i = 0; i < 9; ++i) put_double(file, r->matrix[i]);
    for (int i = 0; i < 9; ++i) put_double(file, 99);
    for (int i = 0; i < 3; ++i) put_double(file, r->shift[i]);
    pad(file, start, 632);
    put_integer(file, (uint64_t)r->grid_class, 4);
    mark(file, "grid type"), put_integer(file, (uint64_t)r->type, 4);
    pad(file, start, 672);
}

/* A grid that begins at place 0 of `file`. */
static void put_grid(file_bytes *file, const model *m, const recipe *r, const char *name) {
    layout l;
    find_nodes(m, &l);
    const int entries = l.counts[1] + m->tile_counts[2];
    const size_t root = 672 + 64, size = place_nodes(m, r, &l, root + 64 + 32 * (size_t)entries);
    put_grid_header(file, r, name, size);
    put_integer(file, l.leaves[0] - 672, 8), put_integer(file, l.at[0][0] - 672, 8);
    put_integer(file, l.at[1][0] - 672, 8);
    mark(file, "root step"), put_integer(file, root - 672, 8);
    pad(file, 0, root);
    put_zeros(file, 24);
    mark(file, "root entries"), put_integer(file, (uint64_t)entries, 4);
    mark(file, "background"), put_value(file, r, m->background);
    pad(file, 0, root + 64);
    for (int i = l.counts[1]; i-- > 0;) { /* in any order */
        put_root_entry(file, l.origins[1][i], l.at[1][i] - root, 0);
        pad(file, 0, root + 64 + 32 * (size_t)(l.counts[1] - i));
    }
    for (int i = 0; i < m->tile_counts[2]; ++i) {
        put_root_entry(file, m->tiles[2][i].at, 0, m->tiles[2][i].active);
        put_value(file, r, m->tiles[2][i].value);
        pad(file, 0, root + 64 + 32 * (size_t)(l.counts[1] + i + 1));
    }
    for (int level = 1; level >= 0; --level)
        for (int i = 0; i < l.counts[level]; ++i) put_node(file, m, r, &l, level, i);
    for (int i = 0; i < m->leaf_count; ++i) put_leaf(file, m, r, i);
    CHECK(file->count == size);
}

static void put_packed(file_bytes *file, const recipe *r, const unsigned char *data, size_t size) {
    file_bytes packed = {0};
    if (r->codec == NONE) {
        put(file, data, size);
        return;
    }
    if (r->codec == ZIPPED)
        put_zlib(&packed, data, size);
    else
        put_blosc(&packed, data, size, &r->blosc);
    mark(file, "packed size"), put_integer(file, packed.count, 8);
    mark(file, "packed"), put(file, packed.data, packed.count);
    file_free(&packed);
}

/* A segment with grids of one model each. */
static void put_segment(file_bytes *file, const model *models, const recipe *r, const char *const *names, int count) {
    size_t sizes[4];
    mark(file, "magic"), put(file, r->magic == '0' ? "NanoVDB0" : "NanoVDB2", 8);
    mark(file, "version"), put_integer(file, 32u << 21 | (unsigned)r->minor << 10, 4);
    mark(file, "grids"), put_integer(file, (uint64_t)count, 2);
    mark(file, "codec"), put_integer(file, (uint64_t)r->codec, 2);
    for (int i = 0; i < count; ++i) {
        const size_t start = file->count;
        sizes[i] = start;
        mark(file, "entry"), put_zeros(file, 16), put_zeros(file, 16);
        mark(file, "entry type"), put_integer(file, (uint64_t)r->type, 4);
        pad(file, start, 136);
        mark(file, "name size"), put_integer(file, strlen(names[i]) + 1, 4);
        pad(file, start, 176);
        mark(file, "name"), put(file, names[i], strlen(names[i]) + 1);
    }
    for (int i = 0; i < count; ++i) {
        file_bytes grid = {0};
        const size_t start = file->count;
        put_grid(&grid, &models[i], r, names[i]);
        for (int k = 0; k < grid.mark_count && r->codec == NONE; ++k) {
            file->count = start + grid.marks[k].at;
            mark(file, grid.marks[k].name);
        }
        file->count = start;
        put_packed(file, r, grid.data, grid.count);
        set_integer(file, sizes[i], grid.count, 8);
        set_integer(file, sizes[i] + 8, file->count - start, 8);
        file_free(&grid);
    }
}

static void write_one(file_bytes *file, const model *m, const recipe *r) {
    static const char *const names[] = {"density"};
    file_free(file);
    put_segment(file, m, r, names, 1);
}

/* ------------------------------------------------------------------------------------------------------------ tests */

/* Every type and packing. */
static void test_every_type(void) {
    static const struct {
        int type, bits;
    } types[] = {{FLOAT_TYPE, 0}, {HALF_TYPE, 0}, {FP4_TYPE, 4}, {FP8_TYPE, 8}, {FP16_TYPE, 16},
                 {FPN_TYPE, 1},   {FPN_TYPE, 2},  {FPN_TYPE, 4}, {FPN_TYPE, 8}, {FPN_TYPE, 16}};
    file_bytes file = {0};
    for (size_t i = 0; i < sizeof types / sizeof *types; ++i)
        for (int codec = NONE; codec <= BLOSCED; ++codec) {
            model m = plain_model();
            recipe r = plain_recipe();
            if (codec > 0 && i > 1 && !check_long()) continue;
            r.type = types[i].type, m.bits = types[i].bits, r.codec = codec;
            m.way = codec * 3, m.background = codec == 0 ? 0 : 0.125f;
            r.magic = i % 2 ? '2' : '0', r.minor = 3 + (int)i % 5;
            write_one(&file, &m, &r);
            save(&file);
            const int failed = check_failed;
            check_open(&m, NULL);
            if (check_failed > failed) printf("    type %d, codec %d\n", r.type, codec);
        }
    file_free(&file);
}

/* Tiles of every level, active or not. */
static void test_tiles(void) {
    file_bytes file = {0};
    const recipe r = plain_recipe();
    const model m = tiled_model();
    write_one(&file, &m, &r);
    save(&file);
    check_tiles(&m);
    file_free(&file);
}

/* The map's rows are the world's axes. */
static void test_map(void) {
    static const double matrix[9] = {0.5, 3, -1, 1, 0.25, 0, 2, 1, 4}, shift[3] = {7, 8, 9};
    file_bytes file = {0};
    const model m = plain_model();
    recipe r = plain_recipe();
    double step[3][3];
    memcpy(r.matrix, matrix, sizeof matrix), memcpy(r.shift, shift, sizeof shift);
    for (int n = 0; n < 9; ++n) step[n % 3][n / 3] = matrix[n];
    write_one(&file, &m, &r);
    save(&file);
    check_map(step, shift);
    file_free(&file);
}

/* Several segments and grids: by name, `density`, or the first. Bare grids, without segments. */
static void test_choice(void) {
    static const char *const names[] = {"heat", "smoke", "density"}, *const last[] = {"late"};
    file_bytes file = {0};
    model models[3] = {plain_model(), plain_model(), plain_model()};
    recipe r = plain_recipe();
    models[1].leaf_count = 2, models[2].leaf_count = 1;
    for (int bare = 0; bare < 2; ++bare) {
        for (int i = 0; i < 3; ++i) {
            file_bytes grid = {0};
            r.magic = bare ? (i ? '1' : '0') : '2';
            put_grid(&grid, &models[i], &r, names[i]);
            if (bare) put(&file, grid.data, grid.count);
            file_free(&grid);
        }
        if (!bare) {
            put_segment(&file, models, &r, names, 2);
            r.codec = ZIPPED;
            put_segment(&file, models + 2, &r, names + 2, 1);
            r.codec = BLOSCED;
            put_segment(&file, models, &r, last, 1);
            r.codec = NONE;
        }
        save(&file);
        check_open(&models[2], NULL);
        check_open(&models[2], "density");
        check_open(&models[1], "smoke");
        check_open(&models[0], "heat");
        if (!bare) check_open(&models[0], "late");
        complains("none", "no grid none: --list-grids");
        file_free(&file);
    }
}

/* Level sets are told by their class. */
static void test_class(void) {
    file_bytes file = {0};
    model m = plain_model();
    recipe r = plain_recipe();
    r.grid_class = 1, m.background = 2;
    write_one(&file, &m, &r);
    save(&file);
    check_level_set();
    file_free(&file);
}

/* Wrong values of each field. */
static const wrong_field wrong_fields[] = {
    {"magic", 0, 1, 'X', "not a NanoVDB file"},
    {"magic", 7, 1, '5', "it does not start with NanoVDB0 or NanoVDB2"},
    {"version", 0, 4, 32u << 21 | 2 << 10, "NanoVDB version 32.2 is not supported"},
    {"version", 0, 4, 31u << 21 | 7 << 10, "NanoVDB version 31.7"},
    {"version", 0, 4, 32u << 21 | 9 << 10, NULL},
    {"grids", 0, 2, 0, "the header of a segment"},
    {"grids", 0, 2, 65535, "t.nvdb"},
    {"codec", 0, 2, 3, "codec 3 is not supported"},
    {"codec", 0, 2, 1, "is longer than its entry says"},
    {"entry", 0, 8, 5, "two sizes of a grid that is not packed differ"},
    {"entry", 8, 8, ~0ull, "two sizes of a grid that is not packed differ"},
    {"entry type", 0, 4, 2, "grid density is of double, which is not supported"},
    {"entry type", 0, 4, 99, "grid density is of unknown"},
    {"entry type", 0, 4, 13, "the type is 1"},
    {"name size", 0, 4, 0, "a name of 0 bytes"},
    {"name size", 0, 4, 257, "a name of 257 bytes: at most 256"},
    {"name size", 0, 4, 0xffffffffu, "a name of 4294967295 bytes"},
    {"name size", 0, 4, 7, "the name does not end with a 0"},
    {"grid magic", 7, 1, '2', "it does not start with NanoVDB0 or NanoVDB1"},
    {"grid size", 0, 8, 5, "the grid has 5 bytes instead of"},
    {"grid type", 0, 4, 6, "the type is 6"},
    {"map", 0, 8, 0, "its map makes voxels flat"},
    {"map", 16, 8, 0x7ff0000000000000u, "out of range"},
    {"map", 144, 8, 0x7ff8000000000000u, "out of range"},
    {"root step", 0, 8, 1ull << 40, "the root: it would not lie within the grid"},
    {"root step", 0, 8, 0 - 5000ull, "the root: it would not lie within the grid"},
    {"root entries", 0, 4, 0xffffffffu, "it has 4294967295 entries"},
    {"root entries", 0, 4, 0, "no active voxels"},
    {"root child", 0, 8, 0xfffffull << 42 | 0xfffffull << 21, "its root has two entries for -4096,-4096,0"},
    {"root child", 5, 1, 255, "voxels along x: at most 65536"},
    {"root child", 8, 8, 1ull << 62, "an upper node: it would not lie within the grid"},
    {"upper", 4128, 1, 255, "a lower node: "},
    {"lower", 544, 1, 255, "a leaf: "},
    {"lower", 544 + 511, 1, 255, "a leaf: "},
    {"leaf", 15, 1, 255, NULL}};

static void test_wrong(void) {
    const model m = plain_model();
    file_bytes file = {0};
    for (size_t i = 0; i < sizeof wrong_fields / sizeof *wrong_fields; i += check_memory_only() ? 3 : 1) {
        const recipe r = plain_recipe();
        write_one(&file, &m, &r);
        check_wrong_field(&file, &wrong_fields[i]);
    }
    recipe r = plain_recipe();
    model fp = plain_model();
    r.type = FPN_TYPE, fp.bits = 4;
    write_one(&file, &fp, &r);
    set_integer(&file, mark_at(&file, "leaf") + 15, 5 << 5, 1);
    save(&file);
    complains(NULL, "more than 16 bits a value");
    for (int codec = ZIPPED; codec <= BLOSCED; ++codec) {
        r = plain_recipe(), r.codec = codec;
        write_one(&file, &m, &r);
        const size_t size = mark_at(&file, "packed size"), data = mark_at(&file, "packed");
        set_integer(&file, size, 1ull << 60, 8), save(&file);
        complains(NULL, "it is longer than its entry says");
        set_integer(&file, size, 5, 8), save(&file);
        complains(NULL, "t.nvdb");
        write_one(&file, &m, &r);
        set_integer(&file, data + (codec == ZIPPED ? 0 : 2), 0x45, 1), save(&file);
        complains(NULL, "t.nvdb");
        write_one(&file, &m, &r);
        set_integer(&file, mark_at(&file, "entry"), 1ull << 40, 8), save(&file);
        complains(NULL, "--max-bytes");
    }
    file_free(&file);
}

/* Many slots that share one child would take for ever. */
static void test_sharing(void) {
    const model m = plain_model();
    const recipe r = plain_recipe();
    file_bytes file = {0};
    write_one(&file, &m, &r);
    const size_t upper = mark_at(&file, "upper"), table = mark_at(&file, "upper table");
    const size_t lower = mark_at(&file, "lower") - upper;
    memset(file.data + upper + 4128, 255, 4096);
    for (size_t i = 0; i < 32768; ++i) set_integer(&file, table + 8 * i, lower, 8);
    save(&file);
    complains(NULL, "nodes overlap");
    file_free(&file);
}

/* A file that ends anywhere is refused. */
static void test_truncation(void) {
    const model m = plain_model();
    const recipe r = plain_recipe();
    file_bytes file = {0};
    int opened = 0;
    write_one(&file, &m, &r);
    save(&file);
    const size_t far = check_long() ? 97 : 3001;
    for (size_t n = file.count - 1;; n -= n > 1400 ? far : 1) {
        ex_sparse grid;
        ex_error error;
        if (!CHECK(truncate(where, (off_t)n) == 0)) break;
        opened += open_file(&grid, NULL, &error) == 0 || strncmp(error.text, where, strlen(where)) != 0;
        ex_sparse_free(&grid);
        if (n == 0) break;
    }
    CHECK(opened == 0);
    file_free(&file);
}

/* Files with changed bytes are read or refused. */
static void test_damage(void) {
    file_bytes file = {0};
    check_random random = {9};
    int opened = 0, refused = 0;
    model m = plain_model();
    for (int i = 0; i < (check_long() ? 1000 : check_memory_only() ? 20 : 80); ++i) {
        recipe r = plain_recipe();
        ex_sparse grid;
        ex_error error;
        r.codec = i % 10 == 9 ? ZIPPED + i % 2 : NONE, r.type = i % 2 ? FPN_TYPE : FLOAT_TYPE;
        m.bits = i % 2 ? 1 << i % 5 : 0;
        write_one(&file, &m, &r);
        const size_t parts[4] = {0, mark_at(&file, "entry"), i % 10 == 9 ? 200 : mark_at(&file, "root step"),
                                 i % 10 == 9 ? 200 : mark_at(&file, "leaf")};
        for (int k = 0; k < 1 + i % 3; ++k) {
            const size_t at = parts[i % 4] + (size_t)(check_next(&random) * 300);
            if (at < file.count) file.data[at] = (unsigned char)(256 * check_next(&random));
        }
        save(&file);
        if (open_file(&grid, NULL, &error) == 0) {
            float high;
            ex_sparse_highest(&grid, &high, &error);
            ++opened;
        } else {
            ++refused;
            if (!CHECK(is_printable(error.text, strlen(error.text)))) printf("    %s\n", error.text);
        }
        ex_sparse_free(&grid);
    }
    CHECK(opened > 0 && refused > 0);
    file_free(&file);
}

int main(void) {
    if (!folder_begin()) {
        printf("skipped: NanoVDB files: no folder can be made here\n");
        return check_report();
    }
    RUN(test_every_type);
    RUN(test_tiles);
    RUN(test_map);
    RUN(test_choice);
    RUN(test_class);
    RUN(test_wrong);
    RUN(test_sharing);
    RUN(test_truncation);
    RUN(test_damage);
    folder_end();
    return check_report();
}
