/* common.h: what the example programs share. Nothing here belongs to the library: it is the part that an engine has
   already. Each program includes this file first, with SPLATSHADOW_IMPLEMENTATION defined before it.

   Contents (search for the tag): >>memory, >>figures, >>files, >>grid (volumes), >>voxel-file, >>particles, >>builder,
   >>obj (meshes), >>transfer, >>picture (PNG, PFM), >>clock (time, progress), >>pool (threads), >>session, >>measuring
   (for programs that print figures), >>scene-main.

   Functions that can fail return 0 when all went well; otherwise they fill `error`, one line that names the file.
   EX_NO_PNG, if defined, leaves stb_image_write and the functions that need it out. */

#ifndef EX_COMMON_H
#define EX_COMMON_H

#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L /* clock_gettime, isatty, sysconf, fseeko in a strict C99 build */
#endif
#ifndef SPLATSHADOW_H
#include "splatshadow.h"
#endif

#include <errno.h>
#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#ifndef EX_NO_PNG
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#include "stb_image_write.h"
#endif

typedef struct ex_error {
    char text[1024];
} ex_error;

#ifdef __GNUC__
#define EX_PRINTF __attribute__((format(printf, 2, 3))) /* the compiler checks arguments against the format */
#else
#define EX_PRINTF
#endif

/* Fills the error; returns 1, so that a caller can return it on. Names of files and the like may hold newlines and
   what a terminal takes for a command: these become question marks, so that an error is one line. */
static inline int ex_fail(ex_error *error, const char *format, ...) EX_PRINTF;
static inline int ex_fail(ex_error *error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->text, sizeof error->text, format, arguments);
    va_end(arguments);
    for (char *at = error->text; *at; ++at)
        if ((unsigned char)*at < ' ' || *at == 127) *at = '?';
    return 1;
}

typedef struct ex_quote {
    char text[64];
} ex_quote;

/* The beginning of a text that may hold anything, as printable characters. */
static inline ex_quote ex_quoted(const char *text) {
    ex_quote quote;
    const size_t most = sizeof quote.text - 1, length = strlen(text);
    for (size_t i = 0; i < most && i < length; ++i) quote.text[i] = text[i] >= ' ' && text[i] <= '~' ? text[i] : '?';
    quote.text[length < most ? length : most] = '\0';
    if (length > most) memcpy(quote.text + most - 3, "...", 3);
    return quote;
}

/* ================================================================================================= >>memory */

/* A program of this size has nothing sensible to do without memory, so these never return NULL. */
static inline void *ex_allocate(size_t count, size_t item_size) {
    void *memory = calloc(count ? count : 1, item_size);
    if (memory) return memory;
    fprintf(stderr, "out of memory (%zu items of %zu bytes)\n", count, item_size);
    exit(1);
}

/* Makes room for one more item after `count`; the array may move. */
static inline void *ex_grow(void *array, size_t count, size_t *capacity, size_t item_size) {
    if (count < *capacity) return array;
    const size_t larger = *capacity ? *capacity * 2 : 64;
    void *moved = larger > SIZE_MAX / item_size ? NULL : realloc(array, larger * item_size);
    if (!moved) {
        fprintf(stderr, "out of memory (%zu items of %zu bytes)\n", larger, item_size);
        exit(1);
    }
    *capacity = larger;
    return moved;
}

/* ================================================================================================ >>figures */

/* The value below which a share of all lie. Reorders them, as far as it takes to find it [Hoare 1961]. */
static inline double ex_percentile(double *values, size_t count, double share) {
    const size_t wanted = (size_t)(share * (double)(count - 1) + 0.5);
    size_t low = 0, high = count - 1;
    while (low < high) {
        const double pivot = values[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (values[i] < pivot) ++i;
            while (pivot < values[j]) --j;
            if (i >= j) break;
            const double swapped = values[i];
            values[i++] = values[j], values[j--] = swapped;
        }
        if (wanted <= j)
            high = j;
        else
            low = j + 1;
    }
    return values[wanted];
}

/* ================================================================================================== >>files */

/* Opens a regular file for reading and says how long it is; NULL on failure. */
static inline FILE *ex_open(const char *path, uint64_t *size, ex_error *error) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    if (!file) {
        ex_fail(error, "%s: %s", path, strerror(errno));
        return NULL;
    }
    if (fstat(fileno(file), &info) != 0 || !S_ISREG(info.st_mode)) {
        ex_fail(error, "%s: not a regular file", path);
        fclose(file);
        return NULL;
    }
    *size = (uint64_t)info.st_size;
    return file;
}

/* Whether a file of this name could be written: told before a long render, not after it. */
static inline int ex_check_writable(const char *path, ex_error *error) {
    char folder[4096];
    struct stat info;
    const char *slash = strrchr(path, '/');
    if (stat(path, &info) == 0) {
        if (S_ISDIR(info.st_mode)) return ex_fail(error, "%s: cannot be written: it is a directory", path);
        if (access(path, W_OK) != 0) return ex_fail(error, "%s: cannot be written: %s", path, strerror(errno));
        return 0;
    }
    if (errno != ENOENT) return ex_fail(error, "%.300s: cannot be written: %s", path, strerror(errno));
    const size_t length = slash ? (size_t)(slash - path) + 1 : 1;
    if (length >= sizeof folder) return ex_fail(error, "%.64s...: the name is too long", path);
    memcpy(folder, slash ? path : ".", length);
    folder[length] = '\0';
    if (!*path || access(folder, W_OK) != 0)
        return ex_fail(error, "%s: cannot be written: %s", path, *path ? strerror(errno) : "the name is empty");
    return 0;
}

/* Whether two names are of one regular file, or would be; what is no file (a terminal, a pipe) may well serve twice. */
static inline int ex_same_file(const char *left, const char *right) {
    struct stat a, b;
    const int there = stat(left, &a) == 0;
    if (there != (stat(right, &b) == 0)) return 0;
    return there ? S_ISREG(a.st_mode) && a.st_dev == b.st_dev && a.st_ino == b.st_ino : strcmp(left, right) == 0;
}

/* Reads at most `most` bytes from the start of a file, puts a 0 byte behind them, and says how many bytes the file
   holds. The caller frees the text. */
static inline int ex_read_start(const char *path, size_t most, char **text, size_t *length, uint64_t *held,
                                ex_error *error) {
    FILE *file = ex_open(path, held, error);
    if (!file) return 1;
    *length = *held < most ? (size_t)*held : most;
    *text = (char *)ex_allocate(*length + 1, 1);
    const size_t got = fread(*text, 1, *length, file);
    fclose(file);
    if (got == *length) return 0;
    free(*text);
    *text = NULL;
    return ex_fail(error, "%s: reading failed after %zu of %zu bytes", path, got, *length);
}

/* The whole file with a 0 byte behind it; freed by the caller. Blanks stand for the mark of UTF-8 that some editors
   put before the first line. */
static inline int ex_read_text(const char *path, char **text, size_t *length, ex_error *error) {
    uint64_t held = 0;
    if (ex_read_start(path, SIZE_MAX / 2, text, length, &held, error)) return 1;
    if (*length >= 3 && memcmp(*text, "\xef\xbb\xbf", 3) == 0) memset(*text, ' ', 3);
    if (*length == held) return 0;
    free(*text);
    *text = NULL;
    return ex_fail(error, "%s: too large", path);
}

/* Cuts the next line off: returns its start with a 0 for its newline, NULL after the last one. */
static inline char *ex_next_line(char **rest, const char *end) {
    char *line = *rest;
    if (line >= end) return NULL;
    char *newline = (char *)memchr(line, '\n', (size_t)(end - line));
    if (newline) *newline = '\0';
    *rest = newline ? newline + 1 : line + (end - line);
    return line;
}

static inline char *ex_skip_blanks(char *text) {
    while (*text == ' ' || *text == '\t' || *text == '\r') ++text;
    return text;
}

/* Turns items from a file's byte order into the machine's, or back, in place. */
static inline void ex_byte_order(void *data, size_t count, size_t item_size, int big_endian) {
    const uint16_t one = 1;
    unsigned char first_byte;
    memcpy(&first_byte, &one, 1);
    if ((first_byte == 0) == (big_endian != 0)) return;
    unsigned char *item = (unsigned char *)data;
    for (size_t i = 0; i < count; ++i, item += item_size) {
        for (size_t a = 0, b = item_size - 1; a < b; ++a, --b) {
            const unsigned char swapped = item[a];
            item[a] = item[b], item[b] = swapped;
        }
    }
}

/* Raw and PFM files are little endian. */
static inline void ex_little_endian(void *data, size_t count, size_t item_size) {
    ex_byte_order(data, count, item_size, 0);
}

/* =================================================================================================== >>grid */

typedef enum ex_type { EX_U8 = 0, EX_I8, EX_U16, EX_I16, EX_U32, EX_I32, EX_F32, EX_F64 } ex_type;

/* In the order of ex_type. */
static const char *const ex_type_names[] = {"u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64", NULL};

static inline size_t ex_type_size(ex_type type) {
    static const size_t sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
    return sizes[type];
}

static inline int ex_type_is_float(ex_type type) { return type == EX_F32 || type == EX_F64; }

enum { EX_GRID_BLOCK = 32 }; /* voxels along the edge of a block whose range is known */

/* A volume in memory as it was read, x fastest. A stored number s stands for the value (s - zero) / unit; what lies
   outside of least..most counts as these. `ranges` holds min and max by block. */
typedef struct ex_grid {
    int size[3];
    ex_type type;
    double zero, unit;
    float least, most;
    void *data;
    int blocks[3];
    float *ranges;
} ex_grid;

#define EX_CONVERT(stored_type, real)                                                                                  \
    do {                                                                                                               \
        const stored_type *stored = (const stored_type *)grid->data + first;                                           \
        const real zero = (real)grid->zero, unit = (real)grid->unit;                                                   \
        const real least = (real)grid->least, most = (real)grid->most;                                                 \
        for (size_t i = 0; i < count; ++i) {                                                                           \
            const real value = ((real)stored[i] - zero) / unit;                                                        \
            out[i] = (float)(value < least ? least : value > most ? most : value);                                     \
        }                                                                                                              \
    } while (0)

/* The values of `count` voxels from the one with number `first` on. NaN stays NaN. */
static inline void ex_grid_values(const ex_grid *grid, size_t first, size_t count, float *out) {
    switch (grid->type) {
    case EX_U8: EX_CONVERT(uint8_t, float); break;
    case EX_I8: EX_CONVERT(int8_t, float); break;
    case EX_U16: EX_CONVERT(uint16_t, float); break;
    case EX_I16: EX_CONVERT(int16_t, float); break;
    case EX_U32: EX_CONVERT(uint32_t, double); break; /* 32 bits are more than a float holds */
    case EX_I32: EX_CONVERT(int32_t, double); break;
    case EX_F32: EX_CONVERT(float, float); break;
    case EX_F64: EX_CONVERT(double, double); break;
    }
}
#undef EX_CONVERT

/* The values of `count` voxels from (x,y,z) along x. */
static inline void ex_grid_row(const ex_grid *grid, int x, int y, int z, int count, float *out) {
    const size_t row = (size_t)z * (size_t)grid->size[1] + (size_t)y;
    ex_grid_values(grid, row * (size_t)grid->size[0] + (size_t)x, (size_t)count, out);
}

/* sps_volume.read_fn over an ex_grid. */
static inline int ex_grid_read(void *user, const int lo[3], const int size[3], float *out) {
    const ex_grid *grid = (const ex_grid *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y, out += size[0]) ex_grid_row(grid, lo[0], lo[1] + y, lo[2] + z, size[0], out);
    return 0;
}

/* Widens `range` by a row. A value that the library refuses makes it as wide as can be: then the block is read,
   and the library gets to see the value. */
static inline void ex_range_add(float range[2], const float *values, int count) {
    for (int i = 0; i < count; ++i) {
        if (!(values[i] >= 0.0f && values[i] <= 1e18f)) {
            range[0] = 0.0f, range[1] = 1e18f;
            return;
        }
        if (values[i] < range[0]) range[0] = values[i];
        if (values[i] > range[1]) range[1] = values[i];
    }
}

static inline void ex_grid_measure_block(const ex_grid *grid, int bx, int by, int bz, float range[2]) {
    float row[EX_GRID_BLOCK];
    const int at[3] = {bx * EX_GRID_BLOCK, by * EX_GRID_BLOCK, bz * EX_GRID_BLOCK};
    int end[3];
    for (int a = 0; a < 3; ++a) end[a] = at[a] + EX_GRID_BLOCK < grid->size[a] ? at[a] + EX_GRID_BLOCK : grid->size[a];
    range[0] = FLT_MAX, range[1] = 0.0f;
    for (int z = at[2]; z < end[2]; ++z)
        for (int y = at[1]; y < end[1]; ++y) {
            ex_grid_row(grid, at[0], y, z, end[0] - at[0], row);
            ex_range_add(range, row, end[0] - at[0]);
        }
}

/* Fills `ranges`; to be called once when the data are complete. */
static inline void ex_grid_measure(ex_grid *grid) {
    for (int a = 0; a < 3; ++a) grid->blocks[a] = (grid->size[a] + EX_GRID_BLOCK - 1) / EX_GRID_BLOCK;
    const size_t count = (size_t)grid->blocks[0] * (size_t)grid->blocks[1] * (size_t)grid->blocks[2];
    grid->ranges = (float *)ex_allocate(count, 2 * sizeof(float));
    float *range = grid->ranges;
    for (int z = 0; z < grid->blocks[2]; ++z)
        for (int y = 0; y < grid->blocks[1]; ++y)
            for (int x = 0; x < grid->blocks[0]; ++x, range += 2) ex_grid_measure_block(grid, x, y, z, range);
}

/* sps_volume.range_fn over an ex_grid: bounds over all measured blocks that the asked one touches. */
static inline int ex_grid_range(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    const ex_grid *grid = (const ex_grid *)user;
    int from[3], to[3];
    for (int a = 0; a < 3; ++a) {
        from[a] = lo[a] / EX_GRID_BLOCK;
        to[a] = (lo[a] + size[a] - 1) / EX_GRID_BLOCK;
    }
    out_min_max[0] = FLT_MAX, out_min_max[1] = 0.0f;
    for (int z = from[2]; z <= to[2]; ++z)
        for (int y = from[1]; y <= to[1]; ++y) {
            const size_t row = ((size_t)z * (size_t)grid->blocks[1] + (size_t)y) * (size_t)grid->blocks[0];
            for (int x = from[0]; x <= to[0]; ++x) {
                const float *range = grid->ranges + 2 * (row + (size_t)x);
                if (range[0] < out_min_max[0]) out_min_max[0] = range[0];
                if (range[1] > out_min_max[1]) out_min_max[1] = range[1];
            }
        }
    return 0;
}

/* Bytes that such a grid takes; 0 if that is more than can be addressed. */
static inline uint64_t ex_grid_bytes(const int size[3], ex_type type) {
    uint64_t bytes = ex_type_size(type);
    for (int a = 0; a < 3; ++a) {
        if (size[a] < 1 || bytes > (uint64_t)SIZE_MAX / (uint64_t)size[a]) return 0;
        bytes *= (uint64_t)size[a];
    }
    return bytes;
}

/* A grid of zeros, whose stored numbers are its values. */
static inline void ex_grid_begin(ex_grid *grid, const int size[3], ex_type type) {
    memset(grid, 0, sizeof *grid);
    memcpy(grid->size, size, sizeof grid->size);
    grid->type = type;
    grid->unit = 1;
    grid->most = FLT_MAX;
    grid->data = ex_allocate((size_t)ex_grid_bytes(size, type), 1);
}

static inline void ex_grid_free(ex_grid *grid) {
    free(grid->data);
    free(grid->ranges);
    memset(grid, 0, sizeof *grid);
}

/* ============================================================================================= >>voxel-file */

enum { EX_PATH_MAX = 4096 };

/* Where in a file the voxels are, and what they stand for. */
typedef struct ex_voxel_file {
    char path[EX_PATH_MAX];
    uint64_t offset;         /* bytes before the first voxel */
    int at_end;              /* 1: instead of that, the voxels are the last thing in the file */
    int may_go_on;           /* 1: other things may follow the voxels */
    int size[3];             /* voxels along x, y, z */
    ex_type type;            /* of the stored numbers */
    int big_endian;          /* byte order of the stored numbers */
    int x_slowest;           /* 1: z runs fastest in the file and x slowest, instead of the other way round */
    double slope, intercept; /* a number s stands for slope * s + intercept; slope 0: for itself */
    double range[2];         /* what of that becomes value 0 and value 1; both 0: by type, see ex_voxel_file_scale */
} ex_voxel_file;

/* A little-endian file of nothing but voxels. */
static inline int ex_voxel_file_raw(ex_voxel_file *file, const char *path, const int size[3], ex_type type,
                                    ex_error *error) {
    memset(file, 0, sizeof *file);
    if (strlen(path) >= sizeof file->path) return ex_fail(error, "%.64s...: the name is too long", path);
    memcpy(file->path, path, strlen(path) + 1);
    memcpy(file->size, size, sizeof file->size);
    file->type = type;
    return 0;
}

/* Finds the first voxel and goes there. */
static inline int ex_voxel_file_seek(const ex_voxel_file *from, FILE *file, uint64_t held, ex_error *error) {
    const uint64_t needed = ex_grid_bytes(from->size, from->type);
    const uint64_t before = !from->at_end ? from->offset : held > needed ? held - needed : 0;
    if (needed > 0 && held >= before && held - before >= needed && (from->may_go_on || held - before == needed)) {
        if (fseeko(file, (off_t)before, SEEK_SET) == 0) return 0;
        return ex_fail(error, "%s: byte %llu: %s", from->path, (unsigned long long)before, strerror(errno));
    }
    char behind[48] = "";
    if (before > 0) snprintf(behind, sizeof behind, ", behind the first %llu", (unsigned long long)before);
    return ex_fail(error, "%s: the file holds %llu bytes, but size %d,%d,%d and type %s call for %llu%s", from->path,
                   (unsigned long long)held, from->size[0], from->size[1], from->size[2], ex_type_names[from->type],
                   (unsigned long long)needed, behind);
}

/* Turns an order with z fastest into one with x fastest. */
static inline void ex_grid_reverse_axes(ex_grid *grid) {
    const size_t width = (size_t)grid->size[0], height = (size_t)grid->size[1], depth = (size_t)grid->size[2];
    const size_t item = ex_type_size(grid->type);
    char *turned = (char *)ex_allocate(width * height * depth, item), *out = turned;
    for (size_t z = 0; z < depth; ++z)
        for (size_t y = 0; y < height; ++y)
            for (size_t x = 0; x < width; ++x, out += item)
                memcpy(out, (const char *)grid->data + ((x * height + y) * depth + z) * item, item);
    free(grid->data);
    grid->data = turned;
}

/* The smallest and the largest stored number. */
static inline void ex_grid_extremes(const ex_grid *grid, double out[2]) {
    const size_t count = (size_t)grid->size[0] * (size_t)grid->size[1] * (size_t)grid->size[2];
    ex_grid plain = *grid;
    float values[1024];
    plain.zero = 0, plain.unit = 1, plain.least = -FLT_MAX, plain.most = FLT_MAX;
    out[0] = DBL_MAX, out[1] = -DBL_MAX;
    for (size_t first = 0, step = 0; first < count; first += step) {
        step = count - first < 1024 ? count - first : 1024;
        ex_grid_values(&plain, first, step, values);
        for (size_t i = 0; i < step; ++i) {
            out[0] = fmin(out[0], (double)values[i]);
            out[1] = fmax(out[1], (double)values[i]);
        }
    }
}

/* Says what stored numbers stand for. With a range: its two ends are the values 0 and 1. Without one: floats are values
   as they stand; unsigned integers are 0..1 over all that their type holds; signed integers, and those with a slope,
   over what the file holds, since nothing else tells where they begin and end. */
static inline void ex_grid_scale(ex_grid *grid, const ex_voxel_file *from) {
    const double slope = from->slope != 0 ? from->slope : 1, intercept = from->slope != 0 ? from->intercept : 0;
    const int is_signed = grid->type == EX_I8 || grid->type == EX_I16 || grid->type == EX_I32;
    grid->most = 1;
    if (from->range[0] != from->range[1]) {
        grid->zero = (from->range[0] - intercept) / slope;
        grid->unit = (from->range[1] - from->range[0]) / slope;
    } else if (ex_type_is_float(grid->type)) {
        grid->zero = -intercept / slope;
        grid->unit = 1 / slope;
        grid->most = FLT_MAX;
    } else if (is_signed || slope != 1 || intercept != 0) {
        double extremes[2];
        ex_grid_extremes(grid, extremes);
        grid->zero = extremes[slope < 0];
        grid->unit = extremes[slope > 0] - grid->zero;
        if (grid->unit == 0) grid->unit = 1; /* all voxels are the same: all 0 */
    } else {
        grid->zero = 0;
        grid->unit = ldexp(1, 8 * (int)ex_type_size(grid->type)) - 1;
    }
}

static inline int ex_grid_load(ex_grid *grid, const ex_voxel_file *from, ex_error *error) {
    uint64_t held = 0;
    size_t got = 0;
    memset(grid, 0, sizeof *grid);
    FILE *file = ex_open(from->path, &held, error);
    if (!file) return 1;
    int failed = ex_voxel_file_seek(from, file, held, error);
    const size_t needed = (size_t)ex_grid_bytes(from->size, from->type);
    if (!failed) {
        ex_grid_begin(grid, from->size, from->type);
        got = fread(grid->data, 1, needed, file);
        if (got != needed) failed = ex_fail(error, "%s: reading failed after %zu bytes", from->path, got);
    }
    fclose(file);
    if (failed) {
        ex_grid_free(grid);
        return 1;
    }
    ex_byte_order(grid->data, needed / ex_type_size(grid->type), ex_type_size(grid->type), from->big_endian);
    if (from->x_slowest) ex_grid_reverse_axes(grid);
    ex_grid_scale(grid, from);
    ex_grid_measure(grid);
    return 0;
}

/* ============================================================================================== >>particles */

/* sps_particles.read_fn over a list of them. */
static inline int ex_particles_read(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

/* Particles from a file of 32-bit floats, five each. */
typedef struct ex_particles {
    sps_particle *list;
    size_t count;
    double lo[3], hi[3]; /* bounds of those that are finite; lo > hi without any */
} ex_particles;

static inline void ex_particles_measure(ex_particles *particles) {
    for (int a = 0; a < 3; ++a) particles->lo[a] = DBL_MAX, particles->hi[a] = -DBL_MAX;
    for (size_t i = 0; i < particles->count; ++i) {
        const sps_particle *p = particles->list + i;
        for (int a = 0; a < 3; ++a) {
            const double at = (double)p->position[a], radius = (double)p->radius;
            if (!(fabs(at) <= 1e15 && radius > 0 && radius <= 1e15)) continue; /* the library will say so */
            particles->lo[a] = fmin(particles->lo[a], at - radius);
            particles->hi[a] = fmax(particles->hi[a], at + radius);
        }
    }
}

static inline int ex_particles_load(ex_particles *particles, const char *path, ex_error *error) {
    uint64_t held = 0;
    memset(particles, 0, sizeof *particles);
    FILE *file = ex_open(path, &held, error);
    if (!file) return 1;
    if (held % sizeof(sps_particle) != 0 || held > SIZE_MAX / 2) {
        fclose(file);
        return ex_fail(error, "%s: the file holds %llu bytes, which is no multiple of a particle's 20", path,
                       (unsigned long long)held);
    }
    particles->count = (size_t)held / sizeof(sps_particle);
    particles->list = (sps_particle *)ex_allocate(particles->count + 1, sizeof(sps_particle));
    const size_t got = fread(particles->list, sizeof(sps_particle), particles->count, file);
    fclose(file);
    if (got != particles->count) {
        free(particles->list);
        memset(particles, 0, sizeof *particles);
        return ex_fail(error, "%s: reading failed after %zu particles", path, got);
    }
    ex_little_endian(particles->list, 5 * particles->count, sizeof(float));
    ex_particles_measure(particles);
    return 0;
}

static inline void ex_particles_free(ex_particles *particles) {
    free(particles->list);
    memset(particles, 0, sizeof *particles);
}

/* ================================================================================================ >>builder */

/* Triangles with a normal at each corner. */
typedef struct ex_mesh {
    sps_triangle *triangles;
    size_t triangle_count;
    double lo[3], hi[3]; /* bounds; lo > hi without triangles */
} ex_mesh;

typedef struct ex_corner {
    size_t position; /* index */
    size_t normal;   /* index, or EX_NO_NORMAL: to be computed */
} ex_corner;
#define EX_NO_NORMAL ((size_t)-1)

/* A mesh while it is being put together. All zero is an empty one. */
typedef struct ex_builder {
    float *positions, *normals; /* packed triples */
    ex_corner *corners;         /* three a triangle */
    size_t position_count, position_capacity, normal_count, normal_capacity, corner_count, corner_capacity;
} ex_builder;

static inline size_t ex_add_position(ex_builder *builder, double x, double y, double z) {
    builder->positions =
        (float *)ex_grow(builder->positions, builder->position_count, &builder->position_capacity, 3 * sizeof(float));
    float *position = builder->positions + 3 * builder->position_count;
    position[0] = (float)x, position[1] = (float)y, position[2] = (float)z;
    return builder->position_count++;
}

static inline size_t ex_add_normal(ex_builder *builder, double x, double y, double z) {
    builder->normals =
        (float *)ex_grow(builder->normals, builder->normal_count, &builder->normal_capacity, 3 * sizeof(float));
    float *normal = builder->normals + 3 * builder->normal_count;
    normal[0] = (float)x, normal[1] = (float)y, normal[2] = (float)z;
    return builder->normal_count++;
}

static inline void ex_add_corner(ex_builder *builder, size_t position, size_t normal) {
    builder->corners =
        (ex_corner *)ex_grow(builder->corners, builder->corner_count, &builder->corner_capacity, sizeof(ex_corner));
    builder->corners[builder->corner_count].position = position;
    builder->corners[builder->corner_count].normal = normal;
    ++builder->corner_count;
}

static inline void ex_add_triangle(ex_builder *builder, size_t a, size_t b, size_t c) {
    ex_add_corner(builder, a, EX_NO_NORMAL);
    ex_add_corner(builder, b, EX_NO_NORMAL);
    ex_add_corner(builder, c, EX_NO_NORMAL);
}

static inline void ex_add_quad(ex_builder *builder, size_t a, size_t b, size_t c, size_t d) {
    ex_add_triangle(builder, a, b, c);
    ex_add_triangle(builder, a, c, d);
}

static inline void ex_builder_free(ex_builder *builder) {
    free(builder->positions);
    free(builder->normals);
    free(builder->corners);
    memset(builder, 0, sizeof *builder);
}

typedef struct ex_weld_item {
    float position[3];
    size_t index;
} ex_weld_item;

static inline int ex_weld_compare(const void *left, const void *right) {
    const ex_weld_item *a = (const ex_weld_item *)left, *b = (const ex_weld_item *)right;
    for (int i = 0; i < 3; ++i)
        if (a->position[i] != b->position[i]) return a->position[i] < b->position[i] ? -1 : 1;
    return 0;
}

/* The number of the point in space that each position stands for: files often repeat positions along seams. */
static inline size_t *ex_weld(const ex_builder *builder, size_t *point_count) {
    const size_t count = builder->position_count;
    ex_weld_item *items = (ex_weld_item *)ex_allocate(count, sizeof *items);
    size_t *points = (size_t *)ex_allocate(count, sizeof *points);
    for (size_t i = 0; i < count; ++i) {
        memcpy(items[i].position, builder->positions + 3 * i, sizeof items[i].position);
        items[i].index = i;
    }
    qsort(items, count, sizeof *items, ex_weld_compare);
    *point_count = 0;
    for (size_t i = 0; i < count; ++i) {
        if (i > 0 && ex_weld_compare(&items[i - 1], &items[i]) != 0) ++*point_count;
        points[items[i].index] = *point_count;
    }
    if (count > 0) ++*point_count;
    free(items);
    return points;
}

/* Corners sorted by the point they meet at: those of point p are list[first[p]] .. list[first[p + 1] - 1]. */
typedef struct ex_star {
    size_t *points, *first, *list;
} ex_star;

static inline ex_star ex_star_make(const ex_builder *builder) {
    ex_star star;
    size_t point_count = 0;
    star.points = ex_weld(builder, &point_count);
    star.first = (size_t *)ex_allocate(point_count + 2, sizeof *star.first);
    star.list = (size_t *)ex_allocate(builder->corner_count, sizeof *star.list);
    /* A counting sort; counts stand two places up, so that after filling, first[p] is where p starts. */
    for (size_t i = 0; i < builder->corner_count; ++i) ++star.first[star.points[builder->corners[i].position] + 2];
    for (size_t p = 2; p < point_count + 2; ++p) star.first[p] += star.first[p - 1];
    for (size_t i = 0; i < builder->corner_count; ++i)
        star.list[star.first[star.points[builder->corners[i].position] + 1]++] = i;
    return star;
}

static inline void ex_star_free(ex_star *star) {
    free(star->points);
    free(star->first);
    free(star->list);
}

static inline double ex_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Twice the area of a triangle, along its normal. */
static inline void ex_area_vector(const ex_builder *builder, size_t triangle, double out[3]) {
    double edge[2][3];
    const ex_corner *corner = builder->corners + 3 * triangle;
    const float *a = builder->positions + 3 * corner[0].position;
    for (int e = 0; e < 2; ++e) {
        const float *b = builder->positions + 3 * corner[e + 1].position;
        for (int i = 0; i < 3; ++i) edge[e][i] = (double)b[i] - (double)a[i];
    }
    out[0] = edge[0][1] * edge[1][2] - edge[0][2] * edge[1][1];
    out[1] = edge[0][2] * edge[1][0] - edge[0][0] * edge[1][2];
    out[2] = edge[0][0] * edge[1][1] - edge[0][1] * edge[1][0];
}

/* The mean normal, weighted by area, of the triangles at this corner that turn from its own by less than the crease
   angle. Zero for a triangle without area: the library then takes the triangle's own. */
static inline void ex_smooth_normal(const ex_builder *builder, const ex_star *star, size_t corner, double crease_cosine,
                                    float out[3]) {
    double own[3], sum[3];
    ex_area_vector(builder, corner / 3, own);
    memcpy(sum, own, sizeof sum);
    const double own_length = sqrt(ex_dot(own, own));
    const size_t point = star->points[builder->corners[corner].position];
    for (size_t i = star->first[point]; i < star->first[point + 1]; ++i) {
        double other[3];
        if (star->list[i] / 3 == corner / 3) continue;
        ex_area_vector(builder, star->list[i] / 3, other);
        if (ex_dot(own, other) < crease_cosine * own_length * sqrt(ex_dot(other, other))) continue;
        for (int a = 0; a < 3; ++a) sum[a] += other[a];
    }
    const double length = sqrt(ex_dot(sum, sum));
    for (int a = 0; a < 3; ++a) out[a] = length > 0.0 ? (float)(sum[a] / length) : 0.0f;
}

static inline void ex_mesh_measure(ex_mesh *mesh) {
    for (int a = 0; a < 3; ++a) mesh->lo[a] = DBL_MAX, mesh->hi[a] = -DBL_MAX;
    for (size_t t = 0; t < mesh->triangle_count; ++t)
        for (int c = 0; c < 3; ++c)
            for (int a = 0; a < 3; ++a) {
                const double p = (double)mesh->triangles[t].position[c][a];
                if (p < mesh->lo[a]) mesh->lo[a] = p;
                if (p > mesh->hi[a]) mesh->hi[a] = p;
            }
}

/* Turns what was added into triangles, with normals where none were given, and frees the builder. Edges that turn by
   more than crease_degrees stay sharp; 60 suits most models. */
static inline void ex_mesh_build(ex_mesh *mesh, ex_builder *builder, double crease_degrees) {
    const double crease_cosine = cos(crease_degrees * 3.14159265358979 / 180.0);
    ex_star star = ex_star_make(builder);
    mesh->triangle_count = builder->corner_count / 3;
    mesh->triangles = (sps_triangle *)ex_allocate(mesh->triangle_count, sizeof *mesh->triangles);
    for (size_t i = 0; i < 3 * mesh->triangle_count; ++i) {
        sps_triangle *triangle = mesh->triangles + i / 3;
        const ex_corner corner = builder->corners[i];
        memcpy(triangle->position[i % 3], builder->positions + 3 * corner.position, 3 * sizeof(float));
        if (corner.normal != EX_NO_NORMAL)
            memcpy(triangle->normal[i % 3], builder->normals + 3 * corner.normal, 3 * sizeof(float));
        else
            ex_smooth_normal(builder, &star, i, crease_cosine, triangle->normal[i % 3]);
    }
    ex_star_free(&star);
    ex_builder_free(builder);
    ex_mesh_measure(mesh);
}

/* sps_mesh.read_fn over an ex_mesh; has_normals is to be 1. */
static inline int ex_mesh_read(void *user, size_t first, size_t count, sps_triangle *out) {
    const ex_mesh *mesh = (const ex_mesh *)user;
    memcpy(out, mesh->triangles + first, count * sizeof *out);
    return 0;
}

static inline void ex_mesh_free(ex_mesh *mesh) {
    free(mesh->triangles);
    memset(mesh, 0, sizeof *mesh);
}

/* ==================================================================================================== >>obj */

#define EX_COORDINATE_MAX 1e15 /* what the library takes */

/* Three numbers after "v" or "vn"; what follows them (w, a colour) is not read. Gives what is wrong, or NULL. */
static inline const char *ex_obj_triple(char *text, double out[3]) {
    for (int i = 0; i < 3; ++i) {
        char *end;
        out[i] = strtod(text, &end);
        if (end == text) return "not three numbers";
        if (!(fabs(out[i]) <= EX_COORDINATE_MAX)) return "a number that is not within 1e15";
        text = end;
    }
    return NULL;
}

/* Resolves a 1-based index, or one that counts back from the latest. */
static inline int ex_obj_index(char **text, size_t count, size_t *out) {
    char *end;
    const long long index = strtoll(*text, &end, 10);
    if (end == *text) return 1;
    *text = end;
    if (index > 0 && (unsigned long long)index <= count) {
        *out = (size_t)index - 1;
        return 0;
    }
    if (index < 0 && (unsigned long long)-(index + 1) < count) {
        *out = count - 1 - (size_t) - (index + 1);
        return 0;
    }
    return 1;
}

/* One corner of a face: v, v/vt, v//vn or v/vt/vn. */
static inline int ex_obj_corner(char **text, const ex_builder *builder, ex_corner *corner) {
    corner->normal = EX_NO_NORMAL;
    if (ex_obj_index(text, builder->position_count, &corner->position)) return 1;
    if (**text == '/') {
        ++*text;
        if (**text != '/') {
            char *end;
            strtoll(*text, &end, 10); /* the texture coordinate: not used */
            if (end == *text) return 1;
            *text = end;
        }
        if (**text == '/') {
            ++*text;
            if (ex_obj_index(text, builder->normal_count, &corner->normal)) return 1;
        }
    }
    return **text != '\0' && **text != ' ' && **text != '\t' && **text != '\r';
}

/* A face of three corners or more, as a fan round its first. */
static inline int ex_obj_face(char *text, ex_builder *builder) {
    ex_corner first = {0, 0}, previous = {0, 0}, corner = {0, 0};
    int corner_count = 0;
    for (text = ex_skip_blanks(text); *text && *text != '#'; text = ex_skip_blanks(text)) {
        if (ex_obj_corner(&text, builder, &corner)) return 1;
        if (corner_count == 0) first = corner;
        if (corner_count >= 2) {
            ex_add_corner(builder, first.position, first.normal);
            ex_add_corner(builder, previous.position, previous.normal);
            ex_add_corner(builder, corner.position, corner.normal);
        }
        previous = corner;
        ++corner_count;
    }
    return corner_count < 3;
}

/* Positions, normals and faces; all else that the format knows is passed over. Gives what is wrong, or NULL. */
static inline const char *ex_obj_line(char *line, ex_builder *builder) {
    double triple[3];
    const char *wrong = NULL;
    line = ex_skip_blanks(line);
    if (line[0] == 'v' && (line[1] == ' ' || line[1] == '\t')) {
        wrong = ex_obj_triple(line + 1, triple);
        if (!wrong) ex_add_position(builder, triple[0], triple[1], triple[2]);
    } else if (line[0] == 'v' && line[1] == 'n' && (line[2] == ' ' || line[2] == '\t')) {
        wrong = ex_obj_triple(line + 2, triple);
        if (!wrong) ex_add_normal(builder, triple[0], triple[1], triple[2]);
    } else if (line[0] == 'f' && (line[1] == ' ' || line[1] == '\t')) {
        if (ex_obj_face(line + 1, builder)) wrong = "not a face, or an index that is not there";
    }
    return wrong;
}

/* Reads a Wavefront OBJ file. crease_degrees as in ex_mesh_build. */
static inline int ex_mesh_load(ex_mesh *mesh, const char *path, double crease_degrees, ex_error *error) {
    ex_builder builder;
    const char *wrong = NULL;
    char *text = NULL, *line;
    size_t length = 0;
    int line_number = 0, failed = 0;
    memset(mesh, 0, sizeof *mesh);
    memset(&builder, 0, sizeof builder);
    if (ex_read_text(path, &text, &length, error)) return 1;
    char *rest = text;
    while (!wrong && (line = ex_next_line(&rest, text + length)) != NULL) {
        ++line_number;
        wrong = ex_obj_line(line, &builder);
    }
    if (wrong)
        failed = ex_fail(error, "%s:%d: %s: '%s'", path, line_number, wrong, ex_quoted(line).text);
    else if (builder.corner_count == 0)
        failed = ex_fail(error, "%s: no faces", path);
    if (failed)
        ex_builder_free(&builder);
    else
        ex_mesh_build(mesh, &builder, crease_degrees);
    free(text);
    return failed;
}

/* =============================================================================================== >>transfer */

typedef struct ex_transfer {
    sps_transfer_point *points;
    size_t point_count;
} ex_transfer;

static inline void ex_transfer_free(ex_transfer *transfer) {
    free(transfer->points);
    memset(transfer, 0, sizeof *transfer);
}

/* `value r g b extinction`, with room for a comment behind it. */
static inline int ex_transfer_line(char *text, sps_transfer_point *point) {
    float *fields[5] = {&point->value, &point->color[0], &point->color[1], &point->color[2], &point->extinction};
    for (int i = 0; i < 5; ++i) {
        char *end;
        const double number = strtod(text, &end), most = i >= 1 && i <= 3 ? 1.0 : 1e18; /* r, g, b: 0..1 */
        if (end == text || !(number >= 0.0 && number <= most)) return 1;
        *fields[i] = (float)number;
        text = end;
    }
    text = ex_skip_blanks(text);
    return *text != '\0' && *text != '#';
}

/* Reads a transfer function: one point a line, values rising; # starts a comment, blank lines are passed over. */
static inline int ex_transfer_load(ex_transfer *transfer, const char *path, ex_error *error) {
    char *text = NULL, *line;
    size_t length = 0, capacity = 0;
    int line_number = 0, failed = 0;
    memset(transfer, 0, sizeof *transfer);
    if (ex_read_text(path, &text, &length, error)) return 1;
    char *rest = text;
    while (!failed && (line = ex_next_line(&rest, text + length)) != NULL) {
        ++line_number;
        line = ex_skip_blanks(line);
        if (*line == '\0' || *line == '#') continue;
        transfer->points =
            (sps_transfer_point *)ex_grow(transfer->points, transfer->point_count, &capacity, sizeof *transfer->points);
        sps_transfer_point *point = transfer->points + transfer->point_count;
        if (ex_transfer_line(line, point))
            failed = ex_fail(error, "%s:%d: not `value r g b extinction`, or out of range: '%s'", path, line_number,
                             ex_quoted(line).text);
        else if (transfer->point_count > 0 && !(point->value > point[-1].value))
            failed = ex_fail(error, "%s:%d: values must rise from line to line", path, line_number);
        ++transfer->point_count;
    }
    if (!failed && transfer->point_count == 0) failed = ex_fail(error, "%s: no lines with values", path);
    free(text);
    if (failed) ex_transfer_free(transfer);
    return failed;
}

/* ================================================================================================ >>picture */

/* Averages 2x2 pixels into one; an odd last row or column is dropped. `out` may be the same as `in`. */
static inline void ex_halve(const float *in, int width, int height, int channels, float *out) {
    const size_t row = (size_t)width * (size_t)channels, step = (size_t)channels;
    for (int y = 0; y < height / 2; ++y)
        for (int x = 0; x < width / 2; ++x) {
            const float *from = in + 2 * (size_t)y * row + 2 * (size_t)x * step;
            for (size_t c = 0; c < step; ++c, ++from)
                *out++ = 0.25f * (from[0] + from[step] + from[row] + from[row + step]);
        }
}

/* Linear radiance to an 8-bit sRGB code; what is not a number is black. */
static inline unsigned char ex_srgb_code(float linear) {
    if (!(linear > 0.0f)) return 0;
    if (linear >= 1.0f) return 255;
    const float code = linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
    return (unsigned char)(255.0f * code + 0.5f);
}

/* A file that is being written. The first failure stands; closing belongs to it, since a full disk may show only
   when the last buffer goes out. */
typedef struct ex_output {
    FILE *file;
    const char *path;
    int failure; /* errno of the first failure, 0 without one */
} ex_output;

static inline int ex_output_begin(ex_output *output, const char *path, ex_error *error) {
    output->path = path;
    output->failure = 0;
    output->file = fopen(path, "wb");
    return output->file ? 0 : ex_fail(error, "%s: cannot be written: %s", path, strerror(errno));
}

static inline void ex_output_note(ex_output *output, int failed) {
    if (failed && !output->failure) output->failure = errno ? errno : EIO;
}

static inline void ex_output_bytes(ex_output *output, const void *data, size_t size) {
    errno = 0;
    ex_output_note(output, fwrite(data, 1, size, output->file) != size);
}

static inline int ex_output_end(ex_output *output, ex_error *error) {
    errno = 0;
    ex_output_note(output, fclose(output->file) != 0);
    if (!output->failure) return 0;
    return ex_fail(error, "%s: writing failed: %s", output->path, strerror(output->failure));
}

#ifndef EX_NO_PNG
static inline void ex_png_bytes(void *output, void *data, int size) {
    ex_output_bytes((ex_output *)output, data, (size_t)size);
}

/* RGB of an RGBA image as it stands (premultiplied, over its background), times `exposure`, clamped. */
static inline int ex_write_png(const char *path, const float *rgba, int width, int height, float exposure,
                               ex_error *error) {
    const size_t count = (size_t)width * (size_t)height;
    ex_output output;
    if (ex_output_begin(&output, path, error)) return 1;
    unsigned char *codes = (unsigned char *)ex_allocate(count, 3);
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) codes[3 * i + c] = ex_srgb_code(exposure * rgba[4 * i + c]);
    const int encoded = stbi_write_png_to_func(ex_png_bytes, &output, width, height, 3, codes, 3 * width);
    free(codes);
    if (!encoded) errno = ENOMEM; /* the only failure that the encoder has */
    ex_output_note(&output, !encoded);
    return ex_output_end(&output, error);
}
#endif

/* Writes channels first_channel .. first_channel + channels - 1 (3: 'PF', 1: 'Pf') of an RGBA image as PFM: linear,
   little endian, bottom row first. */
static inline int ex_write_pfm(const char *path, const float *rgba, int width, int height, int first_channel,
                               int channels, ex_error *error) {
    ex_output output;
    char header[64];
    if (ex_output_begin(&output, path, error)) return 1;
    const size_t row_count = (size_t)width * (size_t)channels;
    float *row = (float *)ex_allocate(row_count, sizeof *row);
    snprintf(header, sizeof header, "%s\n%d %d\n-1.0\n", channels == 3 ? "PF" : "Pf", width, height);
    ex_output_bytes(&output, header, strlen(header));
    for (int y = height - 1; y >= 0 && !output.failure; --y) {
        const float *from = rgba + 4 * (size_t)y * (size_t)width + first_channel;
        for (size_t i = 0; i < row_count; ++i) row[i] = from[4 * (i / (size_t)channels) + i % (size_t)channels];
        ex_little_endian(row, row_count, sizeof *row);
        ex_output_bytes(&output, row, row_count * sizeof *row);
    }
    free(row);
    return ex_output_end(&output, error);
}

/* ================================================================================================== >>clock */

/* Seconds since some moment; never runs back. sps_config.clock_fn. */
static inline double ex_now(void *unused) {
    struct timespec now;
    (void)unused;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The progress line: on a terminal only, and only for what takes longer than a second. */
typedef struct ex_progress {
    double start, shown; /* seconds */
    int terminal, visible;
} ex_progress;

static inline void ex_progress_begin(ex_progress *progress) {
    memset(progress, 0, sizeof *progress);
    progress->terminal = isatty(2);
    progress->start = progress->shown = ex_now(NULL);
}

/* sps_config.progress_fn. */
static inline int ex_progress_show(void *user, float fraction) {
    ex_progress *progress = (ex_progress *)user;
    if (!progress->terminal) return 0;
    const double now = ex_now(NULL);
    if (now - progress->start < 1.0 || now - progress->shown < 0.1) return 0;
    progress->shown = now;
    progress->visible = 1;
    fprintf(stderr, "\rrendering %3d %%, %.0f s ", (int)(100.0f * fraction), now - progress->start);
    fflush(stderr);
    return 0;
}

static inline void ex_progress_end(ex_progress *progress) {
    if (progress->visible) fputs("\r\033[K", stderr);
    progress->visible = 0;
}

/* =================================================================================================== >>pool */

/* Threads that wait for loops to share. A frame has hundreds of short loops, so a thread that runs out of work first
   looks out for the next loop for some microseconds, and only then goes to sleep; and the caller never waits for a
   thread that has not begun to take part. One loop at a time. */
typedef struct ex_pool {
    int worker_count; /* who can take part at once, the calling thread (worker 0) included */
    struct ex_worker *workers;
    double spin_seconds;
    pthread_mutex_t mutex;
    pthread_cond_t wake, done;
    sps_task_fn task; /* this and the next two change only while `open` is 0 and `inside` is 0 */
    void *task_data;
    int count;
    int next;                      /* atomic, as are all below: the next index to hand out */
    int open;                      /* 1 while a loop may be joined */
    int inside;                    /* threads, but for the caller, that may be at the loop */
    int generation, quit;          /* a new generation is a new loop, or the end */
    int sleeping, caller_sleeping; /* who has to be woken */
} ex_pool;

typedef struct ex_worker {
    ex_pool *pool;
    pthread_t thread;
    int id;
} ex_worker;

static inline int ex_atomic_get(int *value) { return __atomic_load_n(value, __ATOMIC_SEQ_CST); }
static inline void ex_atomic_set(int *value, int to) { __atomic_store_n(value, to, __ATOMIC_SEQ_CST); }
static inline int ex_atomic_add(int *value, int by) { return __atomic_fetch_add(value, by, __ATOMIC_SEQ_CST); }

static inline void ex_spin_pause(void) {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#endif
}

/* Looks at a value until it is (wanted = 1) or is no longer (wanted = 0) `expected`, for a short time. */
static inline void ex_spin(const ex_pool *pool, int *value, int expected, int wanted) {
    if (pool->spin_seconds <= 0.0) return;
    const double end = ex_now(NULL) + pool->spin_seconds;
    do
        for (int i = 0; i < 16; ++i) {
            if ((ex_atomic_get(value) == expected) == wanted) return;
            ex_spin_pause();
        }
    while (ex_now(NULL) < end);
}

static inline void ex_pool_take(ex_pool *pool, int worker) {
    for (;;) {
        const int index = ex_atomic_add(&pool->next, 1);
        if (index >= pool->count) return;
        pool->task(pool->task_data, index, worker);
    }
}

/* A thread counts itself in before it looks whether a loop is open, and the caller closes the loop before it looks
   at the count: so either the caller waits for the thread, or the thread sees that the loop is closed. */
static inline void ex_pool_join(ex_pool *pool, int worker) {
    ex_atomic_add(&pool->inside, 1);
    if (ex_atomic_get(&pool->open)) ex_pool_take(pool, worker);
    if (ex_atomic_add(&pool->inside, -1) == 1 && ex_atomic_get(&pool->caller_sleeping)) {
        pthread_mutex_lock(&pool->mutex);
        pthread_cond_signal(&pool->done);
        pthread_mutex_unlock(&pool->mutex);
    }
}

static inline void *ex_worker_main(void *data) {
    const ex_worker *self = (const ex_worker *)data;
    ex_pool *pool = self->pool;
    int seen = 0;
    for (;;) {
        ex_spin(pool, &pool->generation, seen, 0);
        if (ex_atomic_get(&pool->generation) == seen) {
            pthread_mutex_lock(&pool->mutex);
            ex_atomic_add(&pool->sleeping, 1);
            while (ex_atomic_get(&pool->generation) == seen) pthread_cond_wait(&pool->wake, &pool->mutex);
            ex_atomic_add(&pool->sleeping, -1);
            pthread_mutex_unlock(&pool->mutex);
        }
        seen = ex_atomic_get(&pool->generation);
        if (ex_atomic_get(&pool->quit)) return NULL;
        ex_pool_join(pool, self->id);
    }
}

static inline void ex_pool_announce(ex_pool *pool) {
    ex_atomic_add(&pool->generation, 1);
    if (ex_atomic_get(&pool->sleeping) == 0) return;
    pthread_mutex_lock(&pool->mutex);
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->mutex);
}

static inline void ex_pool_wait(ex_pool *pool) {
    ex_spin(pool, &pool->inside, 0, 1);
    if (ex_atomic_get(&pool->inside) == 0) return;
    pthread_mutex_lock(&pool->mutex);
    ex_atomic_set(&pool->caller_sleeping, 1);
    while (ex_atomic_get(&pool->inside) != 0) pthread_cond_wait(&pool->done, &pool->mutex);
    ex_atomic_set(&pool->caller_sleeping, 0);
    pthread_mutex_unlock(&pool->mutex);
}

/* sps_config.parallel_for_fn, with the pool as parallel_user. */
static inline void ex_parallel_for(void *user, int count, sps_task_fn task, void *task_data) {
    ex_pool *pool = (ex_pool *)user;
    if (count <= 1 || pool->worker_count == 1) {
        for (int i = 0; i < count; ++i) task(task_data, i, 0);
        return;
    }
    pool->task = task, pool->task_data = task_data, pool->count = count;
    ex_atomic_set(&pool->next, 0);
    ex_atomic_set(&pool->open, 1);
    ex_pool_announce(pool);
    ex_pool_take(pool, 0);
    ex_atomic_set(&pool->open, 0);
    ex_pool_wait(pool);
}

static inline int ex_processor_count(void) {
    const long online = sysconf(_SC_NPROCESSORS_ONLN);
    return online < 1 ? 1 : online > 1024 ? 1024 : (int)online;
}

/* worker_count 0: one for each processor. With fewer threads to be had than asked for, the pool is smaller. */
static inline void ex_pool_begin(ex_pool *pool, int worker_count) {
    const int processors = ex_processor_count();
    if (worker_count < 1) worker_count = processors;
    memset(pool, 0, sizeof *pool);
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pthread_cond_init(&pool->done, NULL);
    /* About what sleeping and waking costs. With more threads than processors, looking out would only be in the way. */
    pool->spin_seconds = worker_count <= processors ? 20e-6 : 0.0;
    pool->workers = (ex_worker *)ex_allocate((size_t)worker_count, sizeof *pool->workers);
    for (pool->worker_count = 1; pool->worker_count < worker_count; ++pool->worker_count) {
        ex_worker *worker = pool->workers + pool->worker_count;
        worker->pool = pool;
        worker->id = pool->worker_count;
        if (pthread_create(&worker->thread, NULL, ex_worker_main, worker) != 0) break;
    }
}

static inline void ex_pool_end(ex_pool *pool) {
    ex_atomic_set(&pool->quit, 1);
    ex_pool_announce(pool);
    for (int i = 1; i < pool->worker_count; ++i) pthread_join(pool->workers[i].thread, NULL);
    free(pool->workers);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->wake);
    pthread_mutex_destroy(&pool->mutex);
}

/* ================================================================================================ >>session */

/* A context with threads, a clock and a progress line. Stays where it is between begin and end. */
typedef struct ex_session {
    ex_pool pool;
    ex_progress progress;
    sps_context *context;
} ex_session;

/* threads 0: one for each processor. */
static inline int ex_session_begin(ex_session *session, int threads, ex_error *error) {
    sps_config config;
    sps_error_info why;
    memset(&config, 0, sizeof config);
    ex_pool_begin(&session->pool, threads);
    ex_progress_begin(&session->progress);
    config.parallel_for_fn = ex_parallel_for, config.parallel_user = &session->pool;
    config.worker_count = session->pool.worker_count;
    config.progress_fn = ex_progress_show, config.progress_user = &session->progress;
    config.clock_fn = ex_now;
    session->context = sps_create(&config, &why);
    if (session->context) return 0;
    ex_pool_end(&session->pool);
    return ex_fail(error, "%s", why.sentence);
}

static inline void ex_session_end(ex_session *session) {
    ex_progress_end(&session->progress);
    sps_destroy(session->context);
    ex_pool_end(&session->pool);
}

/* ============================================================================================== >>measuring */

/* What programs that measure share. They have nothing to save: a failure ends them, with one line on stderr. */

static inline void ex_stop_if(int failed, const char *program, const ex_error *error) {
    if (!failed) return;
    fprintf(stderr, "%s: %s\n", program, error->text);
    exit(1);
}

/* The same for what the library returns. */
static inline void ex_stop_unless_ok(sps_result result, const char *program, const ex_session *session) {
    ex_error error;
    if (result != SPS_OK) ex_stop_if(ex_fail(&error, "%s", sps_error(session->context)), program, &error);
}

/* A session without a progress line, which figures would run into. */
static inline void ex_session_measure(ex_session *session, const char *program, int threads) {
    ex_error error;
    ex_stop_if(ex_session_begin(session, threads, &error), program, &error);
    session->progress.terminal = 0;
}

/* A finished transmittance map of what the light sees. */
static inline sps_tmap *ex_tmap_build(const ex_session *session, const char *program, const sps_view *light,
                                      const sps_tmap_settings *settings, const sps_scene *occluders) {
    sps_tmap *map;
    ex_stop_unless_ok(sps_tmap_create(session->context, light, settings, &map), program, session);
    ex_stop_unless_ok(sps_tmap_add(map, occluders), program, session);
    ex_stop_unless_ok(sps_tmap_finish(map), program, session);
    return map;
}

enum { EX_QUERY_BLOCK = 4096 }; /* points of one task */

typedef struct ex_query {
    const sps_tmap *map;
    size_t count;
    const double *positions;
    float *optical_depths, *transmittances;
} ex_query;

static inline void ex_query_block(void *data, int index, int worker) {
    const ex_query *query = (const ex_query *)data;
    const size_t first = (size_t)index * EX_QUERY_BLOCK, left = query->count - first;
    (void)worker;
    sps_tmap_query(query->map, left < EX_QUERY_BLOCK ? left : EX_QUERY_BLOCK, query->positions + 3 * first,
                   query->optical_depths ? query->optical_depths + first : NULL,
                   query->transmittances ? query->transmittances + first : NULL);
}

/* sps_tmap_query with all of the session's threads. */
static inline void ex_tmap_query(ex_session *session, const sps_tmap *map, size_t count, const double *positions,
                                 float *optical_depths, float *transmittances) {
    ex_query query = {map, count, positions, optical_depths, transmittances};
    ex_parallel_for(&session->pool, (int)((count + EX_QUERY_BLOCK - 1) / EX_QUERY_BLOCK), ex_query_block, &query);
}

/* ============================================================================================= >>scene-main */

#ifndef EX_NO_PNG
typedef struct ex_scene_options {
    const char *out;
    int width, threads, quality;
} ex_scene_options;

static inline int ex_whole_number(const char *text, int lo, int hi, int *out) {
    char *end;
    const long number = strtol(text, &end, 10);
    if (end == text || *end != '\0' || number < lo || number > hi) return 1;
    *out = (int)number;
    return 0;
}

/* The place of `name` in a list that ends with NULL; -1 if it is not there. */
static inline int ex_find_name(const char *const *names, const char *name) {
    for (int i = 0; names[i]; ++i)
        if (strcmp(names[i], name) == 0) return i;
    return -1;
}

/* In the order of sps_quality. */
static const char *const ex_quality_names[] = {"default", "draft", "medium", "high", "ultra", NULL};

static inline int ex_scene_options_read(int argc, char **argv, ex_scene_options *options, ex_error *error) {
    memset(options, 0, sizeof *options);
    for (int i = 1; i < argc; i += 2) {
        const char *name = argv[i], *value = i + 1 < argc ? argv[i + 1] : "";
        int wrong = 0;
        if (strcmp(name, "--out") == 0)
            options->out = value, wrong = *value == '\0';
        else if (strcmp(name, "--width") == 0)
            wrong = ex_whole_number(value, 1, 8192, &options->width);
        else if (strcmp(name, "--threads") == 0)
            wrong = ex_whole_number(value, 1, 1024, &options->threads);
        else if (strcmp(name, "--quality") == 0)
            wrong = (options->quality = ex_find_name(ex_quality_names, value)) < 0;
        else
            return ex_fail(error, "unknown option '%s'; there are --out FILE.png --width W --threads N --quality Q",
                           name);
        if (wrong) return ex_fail(error, "%s: '%s' will not do", name, value);
    }
    return options->out ? ex_check_writable(options->out, error) : ex_fail(error, "--out FILE.png is missing");
}

/* What a program does to the large picture before it is made small. Distances are rendered only for that. */
typedef struct ex_finish {
    void (*apply_fn)(void *user, const sps_view *view, const sps_image *image);
    void *user;
} ex_finish;

/* Renders at twice the size, for the edges of polygons, and writes the picture. `finish` may be NULL. */
static inline int ex_scene_render(const sps_scene *scene, const sps_view *view, const ex_scene_options *options,
                                  float exposure, const ex_finish *finish, ex_error *error) {
    ex_session session;
    sps_image image;
    sps_view large = *view;
    int width = view->width, height = view->height;
    if (options->width) height = (int)((double)height * options->width / width + 0.5), width = options->width;
    if (height < 1) height = 1;
    large.width = 2 * width, large.height = 2 * height;
    if (options->quality) large.quality = (sps_quality)options->quality;
    memset(&image, 0, sizeof image);
    if (ex_session_begin(&session, options->threads, error)) return 1;
    const size_t pixels = (size_t)large.width * (size_t)large.height;
    image.rgba = (float *)ex_allocate(pixels, 4 * sizeof(float));
    if (finish) image.depth = (float *)ex_allocate(pixels, sizeof(float));
    const double start = ex_now(NULL);
    int failed = sps_render(session.context, scene, &large, &image) != SPS_OK;
    if (failed) ex_fail(error, "%s", sps_error(session.context));
    if (finish && !failed) finish->apply_fn(finish->user, &large, &image);
    const double seconds = ex_now(NULL) - start;
    ex_session_end(&session);
    if (!failed) {
        ex_halve(image.rgba, large.width, large.height, 4, image.rgba);
        failed = ex_write_png(options->out, image.rgba, width, height, exposure, error);
    }
    if (!failed) printf("%s: %d x %d in %.2f s\n", options->out, width, height, seconds);
    free(image.rgba);
    free(image.depth);
    return failed;
}

/* All that the main of a scene program has left to do: reads --out FILE.png --width W --threads N --quality Q and
   makes the picture; the view gives the usual size. `finish` may be NULL. Returns main's status: 2 for options, 1 for a
   failed render. */
static inline int ex_scene_main(int argc, char **argv, const sps_scene *scene, const sps_view *view, float exposure,
                                const ex_finish *finish) {
    ex_scene_options options;
    ex_error error;
    int status = 0;
    if (ex_scene_options_read(argc, argv, &options, &error))
        status = 2;
    else if (ex_scene_render(scene, view, &options, exposure, finish, &error))
        status = 1;
    if (status) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    return status;
}
#endif

#endif /* EX_COMMON_H */
