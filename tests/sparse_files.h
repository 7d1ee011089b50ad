/* Shared by tests of files of sparse grids: such a file is written, opened as FORMAT (an ex_sparse_format, named NAME),
   and compared with the model. Define both; include after packed_files.h, sparse_model.h and command_line.h. */

#ifndef SPARSE_FILES_H
#define SPARSE_FILES_H

#define ALLOWED 400000000u /* bytes of memory that these files may take */

static char where[200];

static inline void save(const file_bytes *file) {
    write_file(NAME, file->data, file->count);
    snprintf(where, sizeof where, "%s/" NAME, folder);
}

static inline int open_file(ex_sparse *grid, const char *name, ex_error *error) {
    const double range[2] = {0, 0};
    error->text[0] = 0;
    const int failed = ex_sparse_open(&FORMAT, grid, where, name, ALLOWED, error);
    if (!failed) ex_sparse_scale(grid, range, 0);
    return failed;
}

/* What is said of a file that cannot be opened: one line, which names it. */
static inline int complains(const char *name, const char *words) {
    ex_sparse grid;
    ex_error error;
    const int failed = open_file(&grid, name, &error);
    ex_sparse_free(&grid);
    if (!words) return CHECK(!failed) || (printf("    %s\n", error.text), 0);
    if (CHECK(failed && is_printable(error.text, strlen(error.text)) &&
              strncmp(error.text, where, strlen(where)) == 0 && strstr(error.text, words)))
        return 1;
    printf("    '%s' instead of '%s'\n", failed ? error.text : "opened", words);
    return 0;
}

/* A wrong value of a field of a file, and what must be said; NULL: nothing. */
typedef struct wrong_field {
    const char *mark;
    size_t after, size;
    uint64_t value;
    const char *words;
} wrong_field;

static inline void check_wrong_field(file_bytes *file, const wrong_field *wrong) {
    set_integer(file, mark_at(file, wrong->mark) + wrong->after, wrong->value, wrong->size);
    save(file);
    if (!complains(NULL, wrong->words)) printf("    %s = %llu\n", wrong->mark, (unsigned long long)wrong->value);
}

/* Opens a grid of the file, and compares all of it with the model, whose leaves are near 0. */
static inline void check_open(const model *m, const char *name) {
    ex_sparse grid;
    ex_error error;
    int lo[3], hi[3];
    const uint64_t voxels = find_box(m, 20, lo, hi);
    if (CHECK(open_file(&grid, name, &error) == 0)) {
        int same = grid.voxel_count == voxels;
        for (int a = 0; a < 3; ++a) same &= grid.low[a] == lo[a] && grid.size[a] == hi[a] - lo[a] + 1;
        CHECK(same);
        CHECK(compare_all(&grid, m) == 0);
        CHECK(!grid.has_failed);
    } else {
        printf("    %s\n", error.text);
    }
    ex_sparse_free(&grid);
}

/* Compares a file of tiled_model with it, in blocks everywhere, half of them near leaves. */
static inline void check_tiles(const model *m) {
    const int low[3] = {-16, -128, -4096}, high[3] = {8191, 4095, 383};
    uint64_t voxels = 512 + (1ull << 21) + (1ull << 36) + 512 + 1;
    check_random random = {5};
    int wrong = 0, empty = 0;
    ex_sparse grid;
    ex_error error;
    if (!CHECK(open_file(&grid, "density", &error) == 0)) printf("    %s\n", error.text);
    for (int a = 0; a < 3; ++a) CHECK(grid.low[a] == low[a] && grid.size[a] == high[a] - low[a] + 1);
    for (int n = 0; n < 512; ++n) voxels += (uint64_t)voxel_is_active(0, n);
    CHECK(grid.voxel_count == voxels);
    for (int i = 0; i < 300; ++i) {
        int lo[3], size[3];
        const int near = i % 2;
        for (int a = 0; a < 3; ++a) {
            size[a] = 1 + (int)(39 * check_next(&random));
            lo[a] = (int)(check_next(&random) * (near ? 300 : grid.size[a] - size[a])) + near * (-20 - low[a]);
            if (lo[a] < 0) lo[a] = 0;
        }
        float range[2];
        wrong += compare_block(&grid, m, lo, size);
        ex_sparse_range(&grid, lo, size, range);
        empty += range[1] == 0;
    }
    CHECK(wrong == 0 && empty > 50);
    ex_sparse_free(&grid);
}

/* Opens the file: voxel centres lie where this map puts whole indices. */
static inline void check_map(double step[3][3], const double origin[3]) {
    ex_sparse grid;
    ex_error error;
    if (!CHECK(open_file(&grid, NULL, &error) == 0)) printf("    %s\n", error.text);
    const sps_placement p = ex_sparse_placement(&grid);
    for (int k = 0; k < 3; ++k) {
        double place = p.origin[k], exact = origin[k]; /* the centre of the box's voxel 1,2,3 */
        for (int a = 0; a < 3; ++a) {
            place += p.axis[a][k] * (1.5 + a) / grid.size[a];
            exact += step[a][k] * (grid.low[a] + 1 + a);
        }
        CHECK_NEAR(place, exact, 1e-12); /* a dozen roundings of numbers up to 100 */
    }
    ex_sparse_free(&grid);
}

/* The file is a level set, which only --fog reads. */
static inline void check_level_set(void) {
    ex_sparse grid;
    ex_error error;
    CHECK(open_file(&grid, NULL, &error) == 0 && strcmp(grid.grid_class, "level set") == 0);
    CHECK(ex_sparse_check(&grid, 0, &error) && strstr(error.text, "--fog reads it"));
    CHECK(ex_sparse_check(&grid, 1, &error) == 0);
    ex_sparse_free(&grid);
}

#endif /* SPARSE_FILES_H */
