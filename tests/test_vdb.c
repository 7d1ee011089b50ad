/* OpenVDB files, which examples/vdb.h reads: made here byte by byte, and by OpenVDB's own library where it is installed
   (in long tests; tests/vdb_writer.cpp). Values are those that were written, bit for bit; the box has the active
   voxels; voxels lie where the map says; and whatever is wrong ends in one line that names the file. */

#include "check.h"
#include "packed_files.h"
#include "vdb.h"
#include "sparse_model.h"
#include "command_line.h"

#define FORMAT ex_vdb
#define NAME   "t.vdb"
#include "sparse_files.h"

enum { ZIP = 1, ACTIVE_ONLY = 2, BLOSC = 4 };

/* -------------------------------------------------------------------------------------------------- what is written */

/* How a file is written. */
typedef struct recipe {
    int version, compression, half;
    blosc_style blosc;
    int unpacked; /* data are stored as not worth packing */
    const char *map;
    double numbers[18];
    int number_count;
    const char *grid_class;
} recipe;

/* ------------------------------------------------------------------------------------------------------ the writer */

static void put_text(file_bytes *file, const char *text) {
    put_integer(file, strlen(text), 4);
    put(file, text, strlen(text));
}

static void put_data(file_bytes *file, const recipe *r, const unsigned char *data, size_t size, size_t count) {
    file_bytes packed = {0};
    if (!(r->compression & (ZIP | BLOSC))) {
        put(file, data, size);
        return;
    }
    if (count == 0 && r->half) return;
    mark(file, "packed");
    if (r->unpacked || size == 0) {
        put_integer(file, 0 - (uint64_t)size, 8);
        put(file, data, size);
        return;
    }
    if (r->compression & BLOSC)
        put_blosc(&packed, data, size, &r->blosc);
    else
        put_zlib(&packed, data, size);
    put_integer(file, packed.count, 8);
    for (int i = 0; i < packed.mark_count; ++i) {
        file->count += packed.marks[i].at;
        mark(file, packed.marks[i].name);
        file->count -= packed.marks[i].at;
    }
    put(file, packed.data, packed.count);
    file_free(&packed);
}

/* A node's values: how inactive ones are stored, then the data. */
static void put_values(file_bytes *file, const model *m, const recipe *r, int slots, const unsigned char *mask,
                       const float *values) {
    const float inactive = 0.75f, second = 0.375f;
    file_bytes data = {0};
    size_t count = 0;
    mark(file, "way");
    put_integer(file, (uint64_t)m->way, 1);
    if (m->way == 2 || m->way == 4 || m->way == 5) put_float(file, inactive);
    if (m->way == 5) put_float(file, second);
    if (m->way >= 3 && m->way <= 5) {
        unsigned char selected[4096] = {0};
        for (int i = 0; i < slots; ++i)
            if (i % 3) selected[i / 8] = (unsigned char)(selected[i / 8] | 1 << i % 8);
        put(file, selected, (size_t)slots / 8);
    }
    for (int i = 0; i < slots; ++i) {
        if ((r->compression & ACTIVE_ONLY) && m->way != 6 && !(mask[i / 8] >> i % 8 & 1)) continue;
        if (r->half)
            put_half(&data, values[i]);
        else
            put_float(&data, values[i]);
        ++count;
    }
    put_data(file, r, data.data, data.count, count);
    file_free(&data);
}

/* Leaves are collected in the order in which they are found. */
typedef struct leaf_order {
    int list[8], count;
} leaf_order;

/* An upper (level 1) or a lower node (level 0), with what is below it. */
static void put_node(file_bytes *file, const model *m, const recipe *r, const int origin[3], int level,
                     leaf_order *order) {
    static float values[2][32768];
    static unsigned char masks[2][2][4096]; /* children, active slots */
    const int log2 = level ? 5 : 4, slots = 1 << 3 * log2, edge = level ? 128 : 8, side = (1 << log2) - 1;
    memset(masks[level], 0, sizeof masks[level]);
    for (int n = 0; n < slots; ++n) {
        const int at[3] = {origin[0] + (n >> 2 * log2) * edge, origin[1] + (n >> log2 & side) * edge,
                           origin[2] + (n & side) * edge};
        const tile *found = find_tile(m, at, level);
        const int divided = is_divided(m, at, edge, level);
        values[level][n] = divided ? 0 : found ? found->value : inactive_value(m, n);
        if (divided || (found && found->active))
            masks[level][!divided][n / 8] = (unsigned char)(masks[level][!divided][n / 8] | 1 << n % 8);
    }
    mark(file, level ? "upper" : "lower");
    put(file, masks[level][0], (size_t)slots / 8), put(file, masks[level][1], (size_t)slots / 8);
    put_values(file, m, r, slots, masks[level][1], values[level]);
    for (int n = 0; n < slots; ++n) {
        const int at[3] = {origin[0] + (n >> 2 * log2) * edge, origin[1] + (n >> log2 & side) * edge,
                           origin[2] + (n & side) * edge};
        if (!(masks[level][0][n / 8] >> n % 8 & 1)) continue;
        if (level) {
            put_node(file, m, r, at, 0, order);
            continue;
        }
        for (int i = 0; i < m->leaf_count; ++i) {
            unsigned char mask[64];
            if (!contains(m->leaves[i], at, 8)) continue;
            leaf_mask(i, mask);
            mark(file, "mask");
            put(file, mask, 64);
            order->list[order->count++] = i;
        }
    }
}

static void put_place(file_bytes *file, const int at[3]) {
    for (int a = 0; a < 3; ++a) put_integer(file, (uint32_t)at[a], 4);
}

static void put_tree(file_bytes *file, const model *m, const recipe *r, leaf_order *order) {
    int roots[8][3];
    const int count = find_roots(m, roots);
    mark(file, "buffers"), put_integer(file, 1, 4);
    mark(file, "background"), put_float(file, m->background);
    mark(file, "root tiles"), put_integer(file, (uint64_t)m->tile_counts[2], 4);
    mark(file, "root children"), put_integer(file, (uint64_t)count, 4);
    for (int i = 0; i < m->tile_counts[2]; ++i) {
        mark(file, "root tile"), put_place(file, m->tiles[2][i].at);
        put_float(file, m->tiles[2][i].value), put_integer(file, (uint64_t)m->tiles[2][i].active, 1);
    }
    for (int i = 0; i < count; ++i) {
        mark(file, i ? "second child" : "first child"), put_place(file, roots[i]);
        put_node(file, m, r, roots[i], 1, order);
    }
}

static void put_leaves(file_bytes *file, const model *m, const recipe *r, const leaf_order *order) {
    for (int i = 0; i < order->count; ++i) {
        const int leaf = order->list[i];
        unsigned char mask[64];
        float values[512];
        leaf_mask(leaf, mask);
        for (int n = 0; n < 512; ++n)
            values[n] = voxel_is_active(leaf, n) ? voxel_value(leaf, n) : inactive_value(m, n);
        mark(file, "leaf");
        put(file, mask, 64);
        mark(file, "leaf values");
        put_values(file, m, r, 512, mask, values);
    }
}

static void put_metadata(file_bytes *file, const recipe *r) {
    mark(file, "metadata"), put_integer(file, r->grid_class ? 4 : 3, 4);
    mark(file, "meta name"), put_text(file, "file_bbox_max"), put_text(file, "vec3i");
    mark(file, "meta size"), put_integer(file, 12, 4), put_zeros(file, 12); /* a lie */
    put_text(file, "of another program"), put_text(file, "unheard-of"), put_integer(file, 5, 4), put(file, "12345", 5);
    if (r->grid_class) put_text(file, "class"), put_text(file, "string"), put_text(file, r->grid_class);
    put_text(file, "name"), put_text(file, "string"), put_text(file, "not this one");
}

static void put_start(file_bytes *file, const recipe *r, int grids) {
    put(file, " BDV\0\0\0\0", 8);
    mark(file, "version"), put_integer(file, (uint64_t)r->version, 4), put_integer(file, 10, 4);
    put_integer(file, 0, 4);
    mark(file, "offsets"), put_integer(file, 1, 1);
    put(file, "00000000-0000-0000-0000-000000000000", 36);
    mark(file, "file metadata"), put_integer(file, 1, 4), put_text(file, "creator"), put_text(file, "string");
    put_text(file, "a test");
    mark(file, "grids"), put_integer(file, (uint64_t)grids, 4);
}

/* A grid, or an instance of another, which has no tree. */
static void put_grid(file_bytes *file, const model *m, const recipe *r, const char *name, const char *parent) {
    leaf_order order = {{0}, 0};
    mark(file, "name"), put_text(file, name);
    mark(file, "type"), put_text(file, r->half ? "Tree_float_5_4_3_HalfFloat" : "Tree_float_5_4_3");
    mark(file, "parent"), put_text(file, parent);
    mark(file, "places");
    const size_t places = file->count;
    put_zeros(file, 24);
    put_zeros(file, 3); /* what a reader must not look at */
    set_integer(file, places, file->count, 8);
    mark(file, "compression"), put_integer(file, (uint64_t)r->compression, 4);
    put_metadata(file, r);
    mark(file, "map"), put_text(file, r->map);
    mark(file, "numbers");
    for (int i = 0; i < r->number_count; ++i) put_double(file, r->numbers[i]);
    if (!*parent) {
        put_tree(file, m, r, &order);
        put_zeros(file, 5);
        set_integer(file, places + 8, file->count, 8);
        mark(file, "blocks");
        put_leaves(file, m, r, &order);
    }
    set_integer(file, places + 16, file->count, 8);
}

static recipe plain_recipe(void) {
    recipe r;
    memset(&r, 0, sizeof r);
    r.version = 224;
    r.blosc.item = 4, r.blosc.shuffled = 1;
    r.map = "UniformScaleMap", r.number_count = 15;
    for (int i = 0; i < 15; ++i) r.numbers[i] = 0.5;
    return r;
}

static void write_one(file_bytes *file, const model *m, const recipe *r) {
    file_free(file);
    put_start(file, r, 1);
    put_grid(file, m, r, "density", "");
}

/* ------------------------------------------------------------------------------------------------------------ tests */

/* Every version, compression, way of storing inactive values, and both precisions. */
static void test_every_way(void) {
    model m = plain_model();
    file_bytes file = {0};
    for (int compression = 0; compression < 8; ++compression)
        for (int way = 0; way < 7; ++way)
            for (int half = 0; half < 2; ++half) {
                recipe r = plain_recipe();
                if (!check_long() && (compression / 2 + way + half) % (check_memory_only() ? 4 : 2)) continue;
                r.version = 222 + (compression + way) % 3;
                r.compression = compression, r.half = half;
                m.way = way, m.background = way == 0 ? 0 : 0.125f;
                write_one(&file, &m, &r);
                save(&file);
                const int failed = check_failed;
                check_open(&m, NULL);
                if (check_failed > failed) printf("    compression %d, way %d, half %d\n", compression, way, half);
            }
    file_free(&file);
}

/* Every kind of Blosc buffer: shuffled or not, in streams or not, in several blocks, copied; and data that were not
   packed. */
static void test_blosc(void) {
    static const blosc_style styles[] = {{1, 0, 0, 0, 4}, {1, 0, 1, 0, 4},    {0, 0, 0, 0, 4},   {0, 1, 0, 0, 4},
                                         {1, 1, 0, 0, 4}, {1, 0, 0, 512, 4},  {1, 0, 0, 600, 4}, {1, 0, 1, 700, 4},
                                         {1, 0, 0, 0, 2}, {1, 0, 0, 1024, 8}, {1, 0, 0, 0, 1},   {1, 0, 1, 0, 3},
                                         {1, 0, 0, 36, 4}};
    model m = plain_model();
    file_bytes file = {0};
    for (size_t i = 0; i < sizeof styles / sizeof *styles; ++i)
        for (int unpacked = 0; unpacked < 2; ++unpacked) {
            if (check_memory_only() && (size_t)unpacked != i % 2) continue;
            recipe r = plain_recipe();
            m.way = 6, r.compression = BLOSC, r.blosc = styles[i], r.unpacked = unpacked;
            write_one(&file, &m, &r);
            save(&file);
            const int failed = check_failed;
            check_open(&m, NULL);
            if (check_failed > failed) printf("    style %d\n", (int)i);
        }
    file_free(&file);
}

/* LZ4 blocks that give other bytes than they should, or reach out of them. The good one has each kind of length. */
static void test_lz4(void) {
    static const struct {
        unsigned char in[24];
        size_t in_size, size;
        int good;
    } blocks[] = {{{0x1f, 'a', 1, 0, 2, 0x10, 'b'}, 7, 23, 1},
                  {{0x1f, 'a', 1, 0, 2, 0x10, 'b'}, 7, 22, 0},
                  {{0x1f, 'a', 1, 0, 2, 0x10, 'b'}, 7, 24, 0},
                  {{0x1f, 'a', 1, 0, 2, 0x10}, 6, 23, 0},  /* a literal is missing */
                  {{0x10, 'a', 0, 0, 0x10, 'b'}, 6, 6, 0}, /* nothing back */
                  {{0x10, 'a', 2, 0, 0x10, 'b'}, 6, 6, 0}, /* before the start */
                  {{0x10, 'a', 0, 1, 0x10, 'b'}, 6, 6, 0}, /* far before it */
                  {{0x10, 'a', 1}, 3, 5, 0},               /* half of a distance */
                  {{0x1f, 'a', 1, 0}, 4, 20, 0},           /* the length goes on */
                  {{0xf0, 255, 255}, 3, 600, 0},           /* so does this one */
                  {{0xff}, 1, 20, 0},
                  {{0x40, 'a', 'b', 'c'}, 4, 4, 0},
                  {{0}, 1, 0, 1},
                  {{0}, 0, 0, 1}};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; ++i) {
        unsigned char *in = (unsigned char *)malloc(blocks[i].in_size + 1), *out = (unsigned char *)malloc(32);
        if (!in || !out) exit(1);
        memcpy(in + 1, blocks[i].in, blocks[i].in_size); /* sanitizers see the end */
        if (!CHECK(ex_lz4(in + 1, blocks[i].in_size, out, blocks[i].size) == !blocks[i].good))
            printf("    block %d\n", (int)i);
        if (i == 0) CHECK(memcmp(out, "aaaaaaaaaaaaaaaaaaaaaab", 23) == 0);
        free(in), free(out);
    }
}

/* All halves. */
static void test_halves(void) {
    int wrong = 0;
    for (unsigned bits = 0; bits < 65536; ++bits) {
        const unsigned char bytes[2] = {(unsigned char)(bits & 255), (unsigned char)(bits >> 8)};
        const int exponent = (int)(bits >> 10 & 31);
        const double fraction = bits & 1023, sign = bits >> 15 ? -1 : 1;
        const double exact = exponent ? sign * ldexp(1024 + fraction, exponent - 25) : sign * ldexp(fraction, -24);
        const double value = (double)ex_get_f16(bytes);
        wrong += exponent < 31     ? value != exact || signbit(value) != signbit(sign)
                 : fraction == 0.0 ? value != sign * HUGE_VAL
                                   : value == value;
    }
    CHECK(wrong == 0);
}

/* Tiles of every level, active or not, between leaves. */
static void test_tiles(void) {
    file_bytes file = {0};
    recipe r = plain_recipe();
    const model m = tiled_model();
    r.compression = ACTIVE_ONLY | BLOSC;
    write_one(&file, &m, &r);
    save(&file);
    check_tiles(&m);
    file_free(&file);
}

/* Where there is no leaf, blocks of any size are exactly 0, and tiles are exact. */
static void test_ranges(void) {
    const struct {
        int lo[3], size[3];
        float high;
    } cases[] = {{{0, 0, 0}, {8208, 16, 16}, 1e18f}, {{64, 0, 0}, {512, 16, 16}, 0}, {{16, 0, 0}, {8, 16, 8}, 0},
                 {{32, 0, 0}, {64, 8, 8}, 0},        {{8112, 0, 0}, {96, 8, 8}, 6},  {{600, 0, 0}, {4000, 8, 8}, 0},
                 {{15, 0, 0}, {1, 1, 1}, 1e18f},     {{16, 8, 0}, {1, 1, 8}, 0}};
    model m = plain_model();
    recipe r = plain_recipe();
    file_bytes file = {0};
    ex_sparse grid;
    ex_error error;
    const tile far = {{8064, -128, 0}, 6, 1};
    m.tiles[1][0] = far, m.tile_counts[1] = 1;
    write_one(&file, &m, &r);
    save(&file);
    if (!CHECK(open_file(&grid, NULL, &error) == 0)) printf("    %s\n", error.text);
    CHECK(grid.low[0] == -16 && grid.low[1] == -128 && grid.low[2] == 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        float range[2];
        int lo[3];
        memcpy(lo, cases[i].lo, sizeof lo);
        lo[1] += 120; /* the leaves begin here */
        ex_sparse_range(&grid, lo, cases[i].size, range);
        if (!CHECK(range[0] == 0 && range[1] == cases[i].high)) printf("    case %d: %g\n", (int)i, (double)range[1]);
    }
    ex_sparse_free(&grid), file_free(&file);
}

/* Each map: voxel centres lie where it puts whole indices. */
static void test_maps(void) {
    static const double s = 0.70710678118654752440;
    static const struct {
        const char *name;
        int count;
        double numbers[18], step[3][3], origin[3];
    } maps[] = {{"UniformScaleMap", 15, {0.5, 0.5, 0.5, 9}, {{0.5, 0, 0}, {0, 0.5, 0}, {0, 0, 0.5}}, {0, 0, 0}},
                {"ScaleMap", 15, {0.5, -2, 3, 9}, {{0.5, 0, 0}, {0, -2, 0}, {0, 0, 3}}, {0, 0, 0}},
                {"TranslationMap", 3, {4, 5, -6}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {4, 5, -6}},
                {"UniformScaleTranslateMap", 18, {4, 5, -6, 2, 2, 2, 9}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}, {4, 5, -6}},
                {"ScaleTranslateMap", 18, {4, 5, -6, 2, 3, 7, 9}, {{2, 0, 0}, {0, 3, 0}, {0, 0, 7}}, {4, 5, -6}},
                {"AffineMap",
                 16,
                 {0.5, 1, 2, 0, 0, 3, 1, 0, -1, 0, 4, 0, 7, 8, 9, 1},
                 {{0.5, 1, 2}, {0, 3, 1}, {-1, 0, 4}},
                 {7, 8, 9}},
                {"UnitaryMap",
                 16,
                 {s, s, 0, 0, -s, s, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
                 {{s, s, 0}, {-s, s, 0}, {0, 0, 1}},
                 {0, 0, 0}}};
    const model m = plain_model();
    file_bytes file = {0};
    for (size_t i = 0; i < sizeof maps / sizeof *maps; ++i) {
        recipe r = plain_recipe();
        double step[3][3];
        r.map = maps[i].name, r.number_count = maps[i].count;
        memcpy(r.numbers, maps[i].numbers, sizeof r.numbers), memcpy(step, maps[i].step, sizeof step);
        write_one(&file, &m, &r);
        save(&file);
        check_map(step, maps[i].origin);
    }
    file_free(&file);
}

/* Which grid is read: by its name, `density`, or the first; instances have the tree of another, in a map of their own.
 */
static void test_choice(void) {
    file_bytes file = {0};
    recipe r = plain_recipe(), other = plain_recipe();
    model m = plain_model(), small = plain_model();
    static const struct {
        const char *name, *chosen;
        double step;
        uint64_t voxels;
    } choices[] = {{NULL, "density[0]", 0.5, 1},
                   {"density", "density[0]", 0.5, 1},
                   {"density[0]", "density[0]", 0.5, 1},
                   {"density[1]", "density[1]", 2, 0},
                   {"heat", "heat", 2, 0},
                   {"copy", "copy", 2, 1},
                   {"", "", 0.5, 0}};
    small.leaf_count = 1, small.leaves[0][0] = 64;
    other.numbers[0] = other.numbers[1] = other.numbers[2] = 2;
    r.compression = ACTIVE_ONLY, other.compression = ZIP; /* an instance's own compression says nothing */
    put_start(&file, &r, 5);
    put_grid(&file, &m, &other, "heat", "");
    put_grid(&file, &m, &r, "", "");
    put_grid(&file, &small, &r, "density\0360", "");
    put_grid(&file, &m, &other, "density\0361", "");
    put_grid(&file, &m, &other, "copy", "density\0360");
    save(&file);
    for (size_t i = 0; i < sizeof choices / sizeof *choices; ++i) {
        ex_sparse grid;
        ex_error error;
        if (CHECK(open_file(&grid, choices[i].name, &error) == 0)) {
            CHECK(strcmp(grid.name, choices[i].chosen) == 0);
            CHECK(grid.step[0][0] == choices[i].step);
            CHECK((grid.leaf_count == 1) == (choices[i].voxels == 1));
            CHECK(compare_all(&grid, choices[i].voxels ? &small : &m) == 0);
        } else {
            printf("    %s\n", error.text);
        }
        ex_sparse_free(&grid);
    }
    complains("none", "no grid none: --list-grids");
    complains("density\0361", "no grid");
    file_free(&file);
    put_start(&file, &r, 2);
    put_grid(&file, &m, &r, "first", "");
    put_grid(&file, &m, &r, "copy", "missing");
    save(&file);
    complains("copy", "grid copy is an instance of missing, which is not such a grid");
    ex_sparse grid;
    ex_error error;
    CHECK(open_file(&grid, NULL, &error) == 0 && strcmp(grid.name, "first") == 0);
    ex_sparse_free(&grid), file_free(&file);
}

/* A level set is a fog: 1 inside, 1/2 on the surface, 0 outside. A range replaces the meaning of numbers. */
static void test_values(void) {
    file_bytes file = {0};
    model m = plain_model();
    recipe r = plain_recipe();
    ex_sparse grid;
    ex_error error;
    m.background = 3, m.way = 3, r.grid_class = "level set";
    write_one(&file, &m, &r);
    save(&file);
    check_level_set();
    CHECK(open_file(&grid, NULL, &error) == 0);
    const double none[2] = {0, 0}, range[2] = {1, 5};
    const int first[3] = {0, 0, 0}, size[3] = {8, 8, 8};
    float out[512], high, bounds[2];
    for (int fog = 0; fog < 2; ++fog) {
        ex_sparse_scale(&grid, fog ? none : range, fog);
        CHECK(ex_sparse_read(&grid, first, size, out) == 0);
        for (int i = 0; i < 512; ++i) {
            const int at[3] = {grid.low[0] + i % 8, grid.low[1] + i / 8 % 8, grid.low[2] + i / 64};
            int active;
            const float stored = expected(&m, at, &active), value = fog ? (3 - stored) / 6 : (stored - 1) / 4;
            const float exact = value < 0 ? 0 : value > 1 ? 1 : value;
            CHECK_NEAR((double)out[i], (double)exact, 1e-6); /* a few roundings of numbers up to 1 */
        }
        ex_sparse_range(&grid, first, size, bounds);
        CHECK(bounds[1] >= 1);
        CHECK(ex_sparse_highest(&grid, &high, &error) == 0 && high == 1);
        grid.zero = 0, grid.unit = 1;
    }
    ex_sparse_free(&grid);
    r.grid_class = "fog volume";
    write_one(&file, &m, &r);
    save(&file);
    CHECK(open_file(&grid, NULL, &error) == 0 && ex_sparse_check(&grid, 0, &error) == 0);
    CHECK(ex_sparse_check(&grid, 1, &error) && strstr(error.text, "is not a level set: --fog says nothing"));
    float most = 0;
    for (int n = 0; n < 512; ++n) most = fmaxf(most, voxel_value(1, n));
    CHECK(ex_sparse_highest(&grid, &high, &error) == 0 && high == most);
    ex_sparse_free(&grid), file_free(&file);
}

/* Wrong values of each field. */
static const wrong_field wrong_fields[] = {
    {"version", 0, 4, 221, "file version 221 is not supported: only 222, 223 and 224 are"},
    {"version", 0, 4, 225, "file version 225"},
    {"version", 0, 4, 4000000000u, "file version 4000000000"},
    {"version", 0, 4, 223, NULL},
    {"offsets", 0, 1, 0, "written as a stream"},
    {"file metadata", 0, 4, 0x7fffffff, "2147483647 entries of metadata"},
    {"file metadata", 4, 4, 5000, "a text of 5000 bytes: at most 4095"},
    {"grids", 0, 4, 0, "no grids"},
    {"grids", 0, 4, 0xffffffff, "4294967295, for which the file is too short"},
    {"name", 0, 4, 256, "a text of 256 bytes: at most 255"},
    {"name", 0, 4, 0xffffffff, "a text of 4294967295 bytes"},
    {"type", 4, 1, 'X', "grid density is of Xree_float_5_4_3, which is not supported"},
    {"places", 0, 8, 1, "places 1, "},
    {"places", 0, 8, 1ull << 63, "do not rise within the file"},
    {"places", 8, 8, 1, "do not rise within the file"},
    {"places", 16, 8, 1ull << 40, "do not rise within the file"},
    {"places", 16, 8, ~0ull, "do not rise within the file"},
    {"compression", 0, 4, 8, "compression 8 is not supported"},
    {"compression", 0, 4, 1, "bytes that are not packed instead of"},
    {"metadata", 0, 4, 0xffffffff, "4294967295 entries of metadata"},
    {"metadata", 0, 4, 4, "t.vdb"},
    {"meta size", 0, 4, 0xffffffff, "the file ends within it"},
    {"map", 4, 1, 'N', "its map is a NniformScaleMap, which is not supported"},
    {"numbers", 0, 8, 0, "its map makes voxels flat"},
    {"numbers", 8, 8, 0x7ff0000000000000u, "out of range"},
    {"numbers", 8, 8, 0x7ff8000000000000u, "out of range"},
    {"numbers", 16, 8, 0x7fe0000000000000u, "out of range"},
    {"buffers", 0, 4, 2, "leaves have more than one buffer"},
    {"root tiles", 0, 4, 0xffffffff, "the root has 4294967295 tiles and 2 children"},
    {"root children", 0, 4, 0x80000000u, "for which the file is too short"},
    {"root children", 0, 4, 0, "has no active voxels"},
    {"first child", 0, 4, 1, "is not a multiple of 4096"},
    {"second child", 0, 4, 0xffffe000u, "the places of entries do not rise"},
    {"second child", 0, 4, 0x00100000u, "has 1048594 voxels along x: at most 65536"},
    {"second child", 0, 4, 0x7ffff000u, "has 2147479570 voxels along x"},
    {"way", 0, 1, 7, "7 is no way of storing inactive values"},
    {"way", 0, 1, 255, "255 is no way"},
    {"mask", 0, 1, 255, "its mask is not the one that the tree has"},
    {"leaf", 5, 1, 255, "its mask is not the one that the tree has"},
    {"leaf values", 0, 1, 9, "9 is no way"}};

static void test_wrong(void) {
    const model m = plain_model();
    const recipe r = plain_recipe();
    file_bytes file = {0};
    for (size_t i = 0; i < sizeof wrong_fields / sizeof *wrong_fields; ++i) {
        write_one(&file, &m, &r);
        check_wrong_field(&file, &wrong_fields[i]);
    }
    write_one(&file, &m, &r);
    memcpy(file.data, "NanoVDB0", 8);
    save(&file);
    complains(NULL, "not an OpenVDB file");
    file_free(&file);
}

/* Wrong values of packed data, which are found when leaves are read, if not before. */
static void test_wrong_packing(void) {
    static const struct {
        int compression;
        const char *mark;
        size_t after, size;
        uint64_t value;
        const char *words;
    } cases[] = {{BLOSC, "packed", 0, 8, 1ull << 50, "packed bytes for 131072"},
                 {BLOSC, "packed", 0, 8, 0, "0 bytes that are not packed instead of 131072"},
                 {BLOSC, "packed", 0, 8, 1ull << 63, "9223372036854775808 bytes that are not packed"},
                 {ZIP, "packed", 0, 8, 3, "t.vdb"},
                 {BLOSC, "packed", 0, 8, 3, "3 bytes are too few for a Blosc buffer"},
                 {BLOSC, "blosc", 0, 1, 9, "Blosc's format 9"},
                 {BLOSC, "blosc", 2, 1, 0, "codec BloscLZ is not supported: only LZ4 is"},
                 {BLOSC, "blosc", 2, 1, 4 << 5, "codec Zstandard"},
                 {BLOSC, "blosc", 2, 1, 32 | 4, "shuffled bits"},
                 {BLOSC, "blosc", 2, 1, 32 | 2, "cut off"},
                 {BLOSC, "blosc", 2, 1, 32 | 16 | 1, "an LZ4 block is damaged"},
                 {BLOSC, "blosc", 3, 1, 5, "an LZ4 block is damaged"},
                 {BLOSC, "blosc", 4, 4, 131073, "holds 131073 bytes instead of 131072"},
                 {BLOSC, "blosc", 8, 4, 0, "has blocks of 0"},
                 {BLOSC, "blosc", 8, 4, 200000, "has blocks of 200000"},
                 {BLOSC, "blosc", 8, 4, 1, "cut off"},
                 {BLOSC, "blosc", 12, 4, 17, "has 17 bytes, but the file gives it"},
                 {BLOSC, "blosc", 16, 4, 0xfffffff0u, "an LZ4 block is damaged"},
                 {BLOSC, "stream", 0, 4, 0xffffffffu, "an LZ4 block is damaged"},
                 {BLOSC, "stream", 0, 4, 3, "an LZ4 block is damaged"},
                 {BLOSC, "stream", 4, 1, 0xff, "an LZ4 block is damaged"}};
    model m = plain_model();
    file_bytes file = {0};
    m.way = 6;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        recipe r = plain_recipe();
        r.compression = cases[i].compression;
        write_one(&file, &m, &r);
        set_integer(&file, mark_at(&file, cases[i].mark) + cases[i].after, cases[i].value, cases[i].size);
        save(&file);
        if (!complains(NULL, cases[i].words)) printf("    case %d\n", (int)i);
    }
    recipe r = plain_recipe();
    r.compression = ACTIVE_ONLY | BLOSC, m.way = 0;
    write_one(&file, &m, &r);
    set_integer(&file, file.count - 28, 9, 1); /* the last leaf is a Blosc buffer of one number */
    save(&file);
    ex_sparse grid;
    ex_error error;
    CHECK(open_file(&grid, NULL, &error) == 0);
    const int first[3] = {0, 0, 0}, one[3] = {1, 1, 1}, in_last[3] = {-grid.low[0] + 1, -grid.low[1] + 2, 13};
    float value;
    CHECK(ex_sparse_read(&grid, first, one, &value) == 0 && !grid.has_failed);
    CHECK(ex_sparse_read(&grid, in_last, one, &value) && grid.has_failed);
    CHECK(strstr(grid.failure.text, "t.vdb: ") && strstr(grid.failure.text, "Blosc"));
    ex_sparse_free(&grid), file_free(&file);
}

/* Cuts the file off, and perhaps has it say so at `end`. Returns whether it is opened, or refused without its name. */
static int open_truncated(size_t size, size_t end, int says) {
    ex_sparse grid;
    ex_error error;
    FILE *file = fopen(where, "r+b");
    if (!CHECK(file && ftruncate(fileno(file), (off_t)size) == 0)) return 1;
    fseek(file, (long)end, SEEK_SET);
    for (int i = 0; says && i < 8; ++i) fputc((int)(size >> 8 * i & 255), file);
    fclose(file);
    const int opened = open_file(&grid, NULL, &error) == 0;
    ex_sparse_free(&grid);
    return opened || strncmp(error.text, where, strlen(where)) != 0;
}

/* A file that ends anywhere is refused; also if the entry of its grid says that it ends there. */
static void test_truncation(void) {
    const model m = plain_model();
    file_bytes file = {0};
    for (int compression = 2; compression < 7; compression += 4) {
        recipe r = plain_recipe();
        int opened = 0;
        r.compression = compression;
        write_one(&file, &m, &r);
        save(&file);
        const size_t step = check_memory_only() ? 97 : check_long() ? 1 : 37, end = mark_at(&file, "places") + 16;
        for (size_t n = file.count; n > 0; n -= n > 700 + step ? step : 1) {
            opened += open_truncated(n - 1, end, 0);
            if (n > mark_at(&file, "blocks")) opened += open_truncated(n - 1, end, 1);
        }
        CHECK(opened == 0);
    }
    file_free(&file);
}

/* Files with changed bytes are read or refused. */
static void test_damage(void) {
    model m = plain_model();
    file_bytes file = {0}, damaged = {0};
    check_random random = {9};
    int opened = 0, refused = 0;
    for (int i = 0; i < (check_long() ? 5000 : check_memory_only() ? 60 : 300); ++i) {
        recipe r = plain_recipe();
        ex_sparse grid;
        ex_error error;
        m.way = i / 8 % 7, r.compression = i % 8, r.half = i % 3 == 0;
        if (i % 50 == 0 || i < 8) write_one(&file, &m, &r);
        damaged.count = 0;
        put(&damaged, file.data, file.count);
        for (int k = 0; k < 1 + i % 4; ++k) {
            const double where_to = check_next(&random);
            const size_t at = (size_t)(where_to * where_to * where_to * (double)damaged.count);
            damaged.data[at] = (unsigned char)(256 * check_next(&random));
        }
        save(&damaged);
        if (open_file(&grid, NULL, &error) == 0) {
            const int first[3] = {0, 0, 0}, size[3] = {1, 1, 1};
            float value, high;
            ex_sparse_read(&grid, first, size, &value);
            ex_sparse_highest(&grid, &high, &error);
            ++opened;
        } else {
            ++refused;
            if (!CHECK(is_printable(error.text, strlen(error.text)))) printf("    %s\n", error.text);
        }
        ex_sparse_free(&grid);
    }
    CHECK(opened > 0 && refused > 0);
    file_free(&file), file_free(&damaged);
}

/* The limit of memory counts: 8 bytes for a leaf, and its mask while the file is opened. */
static void test_limit(void) {
    model m = plain_model();
    const recipe r = plain_recipe();
    file_bytes file = {0};
    ex_sparse grid;
    ex_error error;
    write_one(&file, &m, &r);
    save(&file);
    CHECK(open_file(&grid, NULL, &error) == 0);
    const uint64_t needed = grid.bytes;
    ex_sparse_free(&grid);
    CHECK(ex_sparse_open(&ex_vdb, &grid, where, NULL, needed, &error) == 0);
    ex_sparse_free(&grid);
    CHECK(ex_sparse_open(&ex_vdb, &grid, where, NULL, needed - 1, &error) && strstr(error.text, "--max-bytes"));
    ex_sparse_free(&grid);
    CHECK(ex_sparse_open(&ex_vdb, &grid, where, NULL, 0, &error));
    ex_sparse_free(&grid);
    m.leaf_count = 2;
    write_one(&file, &m, &r);
    save(&file);
    CHECK(open_file(&grid, NULL, &error) == 0);
    const uint64_t two = grid.bytes;
    ex_sparse_free(&grid);
    m.leaf_count = 1;
    write_one(&file, &m, &r);
    save(&file);
    CHECK(open_file(&grid, NULL, &error) == 0 && two - grid.bytes == 72);
    ex_sparse_free(&grid), file_free(&file);
}

/* -------------------------------------------------------------------------------------------- OpenVDB's own library */

/* What vdb_writer.cpp says of a grid. */
typedef struct truth {
    int low[3], size[3];
    double places[4][3];
    uint64_t voxels;
    int count;
} truth;

static int read_all(FILE *file, void *out, size_t size) { return CHECK(fread(out, 1, size, file) == size); }

/* Reads a voxel, with those after it along x, which are wanted next. */
static float read_voxel(ex_sparse *grid, const int at[3], int *held) {
    static float row[40];
    static int first[3];
    if (*held <= at[0] - first[0] || at[0] < first[0] || at[1] != first[1] || at[2] != first[2]) {
        const int size[3] = {grid->size[0] - at[0] < 40 ? grid->size[0] - at[0] : 40, 1, 1};
        memcpy(first, at, sizeof first);
        *held = ex_sparse_read(grid, at, size, row) ? 0 : size[0];
        if (!CHECK(*held > 0)) return -1;
    }
    return row[at[0] - first[0]];
}

/* Compares a file of OpenVDB's with what OpenVDB says of it. */
static void check_theirs(const char *name, const char *wanted) {
    char path[300];
    truth t;
    ex_sparse grid;
    ex_error error;
    const double none[2] = {0, 0};
    int wrong = 0, held = 0, compared = 0;
    snprintf(path, sizeof path, "%s/%s.truth", folder, name);
    FILE *file = fopen(path, "rb");
    if (!CHECK(file != NULL)) return;
    const int whole = read_all(file, t.low, sizeof t.low) && read_all(file, t.size, sizeof t.size) &&
                      read_all(file, t.places, sizeof t.places) && read_all(file, &t.voxels, sizeof t.voxels) &&
                      read_all(file, &t.count, sizeof t.count);
    snprintf(path, sizeof path, "%s/%s.vdb", folder, name);
    if (CHECK(whole && ex_sparse_open(&ex_vdb, &grid, path, wanted, ALLOWED, &error) == 0)) {
        ex_sparse_scale(&grid, none, 0);
        grid.least = (double)-FLT_MAX;
        CHECK(grid.voxel_count == t.voxels);
        CHECK(memcmp(grid.low, t.low, sizeof t.low) == 0 && memcmp(grid.size, t.size, sizeof t.size) == 0);
        const sps_placement p = ex_sparse_placement(&grid);
        for (int i = 0; i < 4; ++i)
            for (int k = 0; k < 3; ++k) {
                double place = p.origin[k];
                for (int a = 0; a < 3; ++a) place += p.axis[a][k] * (0.5 + (a == i - 1)) / grid.size[a];
                CHECK_NEAR(place, t.places[i][k], 1e-6 * fmax(1, fabs(t.places[i][k])));
            }
        for (int i = 0; i < t.count; ++i) {
            int at[3];
            float value;
            if (fread(at, sizeof at, 1, file) != 1 || fread(&value, sizeof value, 1, file) != 1) break;
            ++compared;
            const float ours = read_voxel(&grid, at, &held);
            wrong += memcmp(&ours, &value, sizeof value) != 0;
        }
        CHECK(wrong == 0 && compared == t.count);
    } else {
        printf("    %s\n", error.text);
    }
    ex_sparse_free(&grid), fclose(file);
}

static void test_theirs(void) {
    static const char compiling[] =
        "c++ -std=c++17 -O0 -w tests/vdb_writer.cpp -o %s/writer -lopenvdb -ltbb -lImath-3_1 >%s/said 2>&1";
    char text[600], name[40];
    if (!check_long()) return;
    snprintf(text, sizeof text, compiling, folder, folder);
    if (system(text) != 0) {
        printf("skipped: files of OpenVDB's own library: install libopenvdb-dev libboost-dev\n");
        return;
    }
    snprintf(text, sizeof text, "%s/writer %s", folder, folder);
    if (!CHECK(system(text) == 0)) return;
    for (int i = 0; i < 112; ++i) {
        snprintf(name, sizeof name, "%s%d_%d", i % 2 ? "half" : "float", i / 14, i / 2 % 7);
        const int failed = check_failed;
        check_theirs(name, NULL);
        if (check_failed > failed) printf("    %s\n", name);
    }
    for (int i = 0; i < 7; ++i) {
        snprintf(name, sizeof name, "map%d", i);
        check_theirs(name, "density");
    }
    check_theirs("tiles", NULL);
    check_theirs("ball", NULL);
    check_theirs("several", "shared");
    snprintf(where, sizeof where, "%s/several.vdb", folder);
    ex_sparse grid;
    ex_error error;
    CHECK(ex_sparse_open(&ex_vdb, &grid, where, "wind", ALLOWED, &error) &&
          strstr(error.text, "is of Tree_vec3s_5_4_3"));
    ex_sparse_free(&grid);
    CHECK(ex_sparse_open(&ex_vdb, &grid, where, NULL, ALLOWED, &error) == 0 && strcmp(grid.name, "density[0]") == 0);
    ex_sparse_free(&grid);
}

/* ------------------------------------------------------------------------------------------------- the command line */

/* Two grids: a level set and a fog. */
static void write_level_set(file_bytes *file) {
    model m = plain_model();
    recipe r = plain_recipe();
    m.background = 3, m.way = 3;
    r.grid_class = "level set";
    file_free(file);
    put_start(file, &r, 2);
    put_grid(file, &m, &r, "ball", "");
    r.grid_class = "fog volume", m.way = 0, m.background = 0, r.compression = ACTIVE_ONLY;
    put_grid(file, &m, &r, "smoke", "");
}

/* The picture of a file, by three threads, is that of the same voxels in a raw file, bit for bit. */
static void check_picture(const char *looks) {
    static const char view[] = "--box 0,0,0,3,2,2.5 --threads 3 --width 30 --height 30 --pfm";
    const model m = plain_model();
    static char pictures[2][12000];
    int lo[3], hi[3], at[3], sizes[2];
    file_bytes raw = {0};
    char options[300];
    find_box(&m, 20, lo, hi);
    for (at[2] = lo[2]; at[2] <= hi[2]; ++at[2])
        for (at[1] = lo[1]; at[1] <= hi[1]; ++at[1])
            for (at[0] = lo[0]; at[0] <= hi[0]; ++at[0]) {
                int active;
                put_float(&raw, expected(&m, at, &active));
            }
    write_file("dense", raw.data, raw.count);
    snprintf(options, sizeof options, "--volume dense --type f32 --size %d,%d,%d %s %s dense.pfm", hi[0] - lo[0] + 1,
             hi[1] - lo[1] + 1, hi[2] - lo[2] + 1, looks, view);
    CHECK(run_render(options).status == 0);
    snprintf(options, sizeof options, "--volume t.vdb --grid smoke %s %s sparse.pfm", looks, view);
    CHECK(run_render(options).status == 0);
    sizes[0] = read_file("dense.pfm", pictures[0], sizeof pictures[0]);
    sizes[1] = read_file("sparse.pfm", pictures[1], sizeof pictures[1]);
    CHECK(sizes[0] > 30 * 30 * 12 && sizes[0] == sizes[1] && memcmp(pictures[0], pictures[1], (size_t)sizes[0]) == 0);
    float middle;
    memcpy(&middle, pictures[1] + sizes[1] - 12 * (15 * 30 + 15), sizeof middle);
    CHECK(middle > 0);
    file_free(&raw);
}

static void test_render(void) {
    static const complaint list[] = {
        {"--volume t.vdb --grid smoke --plan >plan", 0, NULL},
        {"--volume t.vdb --grid smoke --range 0,9 --plan >plan", 0, NULL},
        {"--volume t.vdb --grid smoke --shading surface --plan >plan", 0, NULL},
        {"--volume t.vdb --grid ball --fog --plan >plan", 0, NULL},
        {"--volume t.vdb --grid smoke --box 0,0,0,1,2,3 --plan >plan", 0, NULL},
        {"--volume other --grid smoke --plan >plan", 0, NULL},
        {"--volume t.vdb --plan", 2, "grid ball is a level set, not a density: --fog reads it as a fog"},
        {"--volume t.vdb --grid smoke --fog --plan", 2, "grid smoke is not a level set"},
        {"--volume t.vdb --grid ball --fog --range 0,1 --plan", 2, "--fog and --range of t.vdb exclude each other"},
        {"--volume t.vdb --grid none --plan", 2, "no grid none"},
        {"--volume t.vdb --size 3,4,5 --plan", 2, "--size says nothing about t.vdb"},
        {"--volume t.vdb --type u8 --plan", 2, "--type says nothing about t.vdb"},
        {"--volume raw --size 1,1,1 --grid a --plan", 2, "--grid says nothing about raw, which is not an OpenVDB"},
        {"--volume raw --size 1,1,1 --fog --plan", 2, "--fog says nothing about raw"},
        {"--volume raw.vdb --plan", 2, "raw.vdb: not an OpenVDB or NanoVDB file"},
        {"--volume t.vdb --grid smoke --out t.vdb", 2, "is a file that --volume reads"},
        {"--volume bad.vdb --grid smoke --pfm out.pfm", 2, "bad.vdb: byte "},
        {"--list-grids", 2, "--list-grids: there is no --volume"},
        {"--volume raw --list-grids", 2, "raw is not an OpenVDB or NanoVDB file"}};
    static const char grids[] = "ball: Tree_float_5_4_3, class level set, 718 voxels, from -16,-8,0 to 1,2,13\n"
                                "smoke: Tree_float_5_4_3, class fog volume, 718 voxels, from -16,-8,0 to 1,2,13\n";
    file_bytes file = {0};
    static char listed[1000];
    if (!render_is_built()) {
        printf("skipped: pictures of OpenVDB files: make build/tests/render\n");
        return;
    }
    write_level_set(&file);
    save(&file);
    write_file("other", file.data, file.count), write_file("raw", "1", 1), write_file("raw.vdb", "1", 1);
    set_integer(&file, file.count - 5, 9, 1); /* the way of the last leaf */
    write_file("bad.vdb", file.data, file.count);
    CHECK_COMPLAINTS(list);
    check_picture("--extinction 2 --light directional,1,-2,-1,3,3,3");
    check_picture("--temperature 1500,1");
    const outcome filled = run_render("--volume t.vdb --grid smoke --range 1,0 --plan >plan");
    CHECK(filled.status == 0 && strstr(filled.said, "grid smoke: its background, 0, fills its box"));
    CHECK(run_render("--volume t.vdb --list-grids >listed").status == 0);
    read_file("listed", listed, sizeof listed);
    if (!CHECK(strcmp(listed, grids) == 0)) printf("    %s", listed);
    file_free(&file);
}

int main(void) {
    if (!folder_begin()) {
        printf("skipped: OpenVDB files: no folder can be made here\n");
        return check_report();
    }
    RUN(test_every_way);
    RUN(test_blosc);
    RUN(test_lz4);
    RUN(test_halves);
    RUN(test_tiles);
    RUN(test_ranges);
    RUN(test_maps);
    RUN(test_choice);
    RUN(test_values);
    RUN(test_wrong);
    RUN(test_wrong_packing);
    RUN(test_truncation);
    RUN(test_damage);
    RUN(test_limit);
    RUN(test_theirs);
    RUN(test_render);
    folder_end();
    return check_report();
}
