/* vdb: opening and reading a sparse cloud from OpenVDB files, against `gzip -t` of as many bytes; and the memory that
   the reader takes, in bytes per set voxel, after everything was read. The files are written here: stored, and with
   Blosc. */

#define _POSIX_C_SOURCE 200809L
#include "vdb.h"
#include "puffs.h"

#include <sys/resource.h>

#define CHECK(condition) ((condition) ? 1 : 0) /* tests/packed_files.h counts with it */
#include "../packed_files.h"

enum { LOWER = 128, BLOCK = 32 };

static double seconds_of(int who) {
    struct rusage used;
    getrusage(who, &used);
    return (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

/* The most memory so far, in bytes. */
static double memory_peak(void) {
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    return 1024.0 * (double)used.ru_maxrss;
}

/* ---------------------------------------------------------------------------------------------------- the writer */

static void put_text(file_bytes *file, const char *text) {
    put_integer(file, strlen(text), 4);
    put(file, text, strlen(text));
}

/* No active values, and background elsewhere. */
static void put_no_values(file_bytes *file, int compression) {
    put_integer(file, 0, 1);
    if (compression & EX_VDB_BLOSC) put_integer(file, 0, 8);
}

/* A leaf's mask, and values of its set voxels into `leaves`. Returns the number of set voxels. */
static int put_leaf(file_bytes *file, file_bytes *leaves, int compression, const float *voxels, const int at[3]) {
    static const blosc_style style = {1, 0, 0, 0, 4};
    unsigned char mask[64] = {0};
    float values[EX_LEAF_VOXELS];
    int count = 0;
    for (int n = 0; n < EX_LEAF_VOXELS; ++n) {
        const int x = at[0] + (n >> 6), y = at[1] + (n >> 3 & 7), z = at[2] + (n & 7);
        const float value = voxels[(z * LOWER + y) * LOWER + x];
        if (value <= 0) continue;
        mask[n / 8] = (unsigned char)(mask[n / 8] | 1 << n % 8);
        values[count++] = value;
    }
    if (count == 0) return 0;
    put(file, mask, sizeof mask), put(leaves, mask, sizeof mask), put_integer(leaves, 0, 1);
    const size_t bytes = (size_t)count * sizeof *values, before = leaves->count;
    if (compression & EX_VDB_BLOSC)
        put_integer(leaves, 0, 8), put_blosc(leaves, (unsigned char *)values, bytes, &style);
    if (compression & EX_VDB_BLOSC) set_integer(leaves, before, leaves->count - before - 8, 8);
    if (!(compression & EX_VDB_BLOSC)) put(leaves, values, bytes);
    return count;
}

/* A lower node. Its mask of children is known once they are written. */
static double put_lower(file_bytes *file, file_bytes *leaves, int compression, const int lo[3]) {
    static float voxels[LOWER * LOWER * LOWER];
    const int size[3] = {LOWER, LOWER, LOWER};
    const size_t start = file->count;
    double count = 0;
    memset(voxels, 0, sizeof voxels);
    cloud_read(NULL, lo, size, voxels);
    put_zeros(file, 1024);
    put_no_values(file, compression);
    for (int n = 0; n < EX_LOWER_SLOTS; ++n) {
        const int at[3] = {(n >> 8) * 8, (n >> 4 & 15) * 8, (n & 15) * 8};
        const int set = put_leaf(file, leaves, compression, voxels, at);
        if (set > 0) file->data[start + (size_t)n / 8] |= (unsigned char)(1 << n % 8);
        count += set;
    }
    return count;
}

/* Returns the number of set voxels. */
static double put_cloud(file_bytes *file, int compression) {
    file_bytes leaves = {0};
    double count = 0;
    put(file, " BDV\0\0\0\0", 8), put_integer(file, 224, 4), put_zeros(file, 8), put_integer(file, 1, 1);
    put(file, "00000000-0000-0000-0000-000000000000", 36);
    put_integer(file, 0, 4), put_integer(file, 1, 4);
    put_text(file, "density"), put_text(file, "Tree_float_5_4_3"), put_text(file, "");
    const size_t places = file->count;
    put_zeros(file, 24);
    set_integer(file, places, file->count, 8);
    put_integer(file, (uint64_t)(compression | EX_VDB_ACTIVE_ONLY), 4), put_integer(file, 0, 4);
    put_text(file, "UniformScaleMap");
    for (int i = 0; i < 15; ++i) put_double(file, 1);
    put_integer(file, 1, 4), put_float(file, 0), put_integer(file, 0, 4), put_integer(file, 1, 4), put_zeros(file, 12);
    const size_t upper = file->count;
    put_zeros(file, 8192);
    put_no_values(file, compression);
    for (int n = 0; n < EX_UPPER_SLOTS; ++n) {
        const int lo[3] = {(n >> 10) * LOWER, (n >> 5 & 31) * LOWER, (n & 31) * LOWER};
        if (lo[0] >= CLOUD || lo[1] >= CLOUD || lo[2] >= CLOUD) continue;
        file->data[upper + (size_t)n / 8] |= (unsigned char)(1 << n % 8);
        count += put_lower(file, &leaves, compression, lo);
    }
    set_integer(file, places + 8, file->count, 8);
    put(file, leaves.data, leaves.count);
    set_integer(file, places + 16, file->count, 8);
    file_free(&leaves);
    return count;
}

/* ------------------------------------------------------------------------------------------------------ measuring */

/* Reads all blocks that may hold something, as the library does. Returns the sum of all values. */
static double read_all(ex_sparse *grid, int *blocks) {
    static float values[BLOCK * BLOCK * BLOCK];
    double sum = 0;
    int at[3];
    for (at[2] = 0; at[2] < grid->size[2]; at[2] += BLOCK)
        for (at[1] = 0; at[1] < grid->size[1]; at[1] += BLOCK)
            for (at[0] = 0; at[0] < grid->size[0]; at[0] += BLOCK) {
                int size[3];
                float range[2];
                for (int a = 0; a < 3; ++a) size[a] = grid->size[a] - at[a] < BLOCK ? grid->size[a] - at[a] : BLOCK;
                ex_sparse_range(grid, at, size, range);
                if (range[1] == 0) continue;
                if (ex_sparse_read(grid, at, size, values)) printf("vdb: %s\n", grid->failure.text);
                for (int i = 0; i < size[0] * size[1] * size[2]; ++i) sum += (double)values[i];
                ++*blocks;
            }
    return sum;
}

/* Writes the file in a process of its own, so that this one's peak is the reader's. */
static double write_apart(const char *path, int compression) {
    char command[300];
    double count = 0;
    snprintf(command, sizeof command, "build/measure/vdb %s %d", path, compression);
    FILE *other = popen(command, "r");
    if (!other || fscanf(other, "%lf", &count) != 1) count = 0;
    if (other) pclose(other);
    return count;
}

static int measure(const char *name, const char *path, int compression) {
    const double range[2] = {0, 0}, voxels = write_apart(path, compression);
    char command[300];
    ex_sparse grid;
    ex_error error;
    int blocks = 0;
    snprintf(command, sizeof command, "gzip -1 -k -f %s && gzip -t %s.gz", path, path);
    if (voxels == 0 || system(command) != 0) return 1;
    snprintf(command, sizeof command, "gzip -t %s.gz", path);
    double start = seconds_of(RUSAGE_CHILDREN);
    if (system(command) != 0) return 1;
    const double gzip = seconds_of(RUSAGE_CHILDREN) - start, before = memory_peak();
    start = seconds_of(RUSAGE_SELF);
    if (ex_sparse_open(&ex_vdb, &grid, path, NULL, 4000000000u, &error)) return printf("vdb: %s\n", error.text), 1;
    ex_sparse_scale(&grid, range, 0);
    const double opening = seconds_of(RUSAGE_SELF) - start;
    start = seconds_of(RUSAGE_SELF);
    const double sum = read_all(&grid, &blocks), reading = seconds_of(RUSAGE_SELF) - start;
    printf("%-6s %9.0f voxels, %6.1f MB: opened in %.3f s, gzip -t %.3f s; %d blocks read in %.3f s; %.2f bytes per "
           "voxel (sum %.0f)\n",
           name, voxels, 1e-6 * (double)grid.file_size, opening, gzip, blocks, reading,
           (memory_peak() - before) / voxels, sum);
    ex_sparse_free(&grid);
    snprintf(command, sizeof command, "rm %s %s.gz", path, path);
    return system(command) != 0;
}

int main(int count, char **arguments) {
    static file_bytes file;
    if (count < 2) return system("build/measure/vdb stored") || system("build/measure/vdb blosc");
    if (count < 3) {
        const int is_packed = strcmp(arguments[1], "blosc") == 0;
        return measure(arguments[1], "build/cloud.vdb", is_packed ? EX_VDB_BLOSC : 0);
    }
    puffs_place();
    const double voxels = put_cloud(&file, atoi(arguments[2]));
    FILE *out = fopen(arguments[1], "wb");
    if (!out || fwrite(file.data, 1, file.count, out) != file.count || fclose(out) != 0) return 1;
    printf("%.0f\n", voxels);
    file_free(&file);
    return 0;
}
