/* volume.h: a volume in memory, the callbacks through which the library reads it, and loading it from a file. */

#ifndef EX_VOLUME_H
#define EX_VOLUME_H

#include "files.h"
#include "inflate.h"

/* ----------------------------------------------------------------------------------------------- a grid in memory */

typedef enum ex_type {
    EX_U8 = 0,
    EX_I8,
    EX_U16,
    EX_I16,
    EX_U32,
    EX_I32,
    EX_F32,
    EX_F64,
    EX_U64,
    EX_I64,
    EX_F16
} ex_type;

/* In the order of ex_type. */
static const char *const ex_type_names[] = {"u8",  "i8",  "u16", "i16", "u32", "i32",
                                            "f32", "f64", "u64", "i64", "f16", NULL};

static inline size_t ex_type_size(ex_type type) {
    static const size_t sizes[] = {1, 1, 2, 2, 4, 4, 4, 8, 8, 8, 2};
    return sizes[type];
}

static inline int ex_type_is_float(ex_type type) { return type == EX_F32 || type == EX_F64 || type == EX_F16; }

static inline int ex_type_is_signed(ex_type type) {
    return type == EX_I8 || type == EX_I16 || type == EX_I32 || type == EX_I64;
}

/* A half has a sign, 5 bits of exponent and 10 of mantissa. Moved to where a float has them, they mean 2^112 times
   less; multiplication by a power of two is exact. The largest exponent means infinity and NaN in both. */
static inline float ex_half_value(uint16_t half) {
    const uint32_t size = (uint32_t)(half & 0x7fff) << 13, bits = size >= 31u << 23 ? size | 255u << 23 : size;
    float value;
    memcpy(&value, &bits, sizeof value);
    if (bits == size) value *= 0x1p112f;
    return half >> 15 ? -value : value;
}

enum { EX_GRID_BLOCK = 32 }; /* voxels along the edge of a block that has a range */

/* A volume in memory, in the type of its file, x fastest. A stored number s means the value (s - zero) / unit, clamped
   to least..most. `ranges` holds the minimum and the maximum value of each block. (The library's sps_grid is enough for
   arrays that are in memory anyway: it has fewer types, does not clamp, and looks at all voxels to find a range.) */
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

static inline void ex_grid_halves(const ex_grid *grid, size_t first, size_t count, float *out) {
    const uint16_t *stored = (const uint16_t *)grid->data + first;
    const float zero = (float)grid->zero, unit = (float)grid->unit;
    for (size_t i = 0; i < count; ++i) {
        const float value = (ex_half_value(stored[i]) - zero) / unit;
        out[i] = value < grid->least ? grid->least : value > grid->most ? grid->most : value;
    }
}

/* Converts `count` voxels to values, from voxel number `first` on. NaN stays NaN. */
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
    case EX_U64: EX_CONVERT(uint64_t, double); break;
    case EX_I64: EX_CONVERT(int64_t, double); break;
    case EX_F16: ex_grid_halves(grid, first, count, out); break;
    }
}
#undef EX_CONVERT

/* Converts `count` voxels to values, from (x,y,z) along x. */
static inline void ex_grid_row(const ex_grid *grid, int x, int y, int z, int count, float *out) {
    const size_t row = (size_t)z * (size_t)grid->size[1] + (size_t)y;
    ex_grid_values(grid, row * (size_t)grid->size[0] + (size_t)x, (size_t)count, out);
}

/* sps_volume.read_fn over an ex_grid, which it only reads: the volume may be `concurrent`. */
static inline int ex_grid_read(void *user, const int lo[3], const int size[3], float *out) {
    const ex_grid *grid = (const ex_grid *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y, out += size[0]) ex_grid_row(grid, lo[0], lo[1] + y, lo[2] + z, size[0], out);
    return 0;
}

/* Widens `range` by a row of values. A value that the library refuses makes the range as wide as possible: then the
   library reads the block and reports the value. */
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

/* Fills `ranges`. Call it once the data are complete. */
static inline void ex_grid_measure(ex_grid *grid) {
    for (int a = 0; a < 3; ++a) grid->blocks[a] = (grid->size[a] + EX_GRID_BLOCK - 1) / EX_GRID_BLOCK;
    const size_t count = (size_t)grid->blocks[0] * (size_t)grid->blocks[1] * (size_t)grid->blocks[2];
    grid->ranges = (float *)ex_allocate(count, 2 * sizeof(float));
    float *range = grid->ranges;
    for (int z = 0; z < grid->blocks[2]; ++z)
        for (int y = 0; y < grid->blocks[1]; ++y)
            for (int x = 0; x < grid->blocks[0]; ++x, range += 2) ex_grid_measure_block(grid, x, y, z, range);
}

/* sps_volume.range_fn over an ex_grid, likewise: bounds over all measured blocks that the given box touches. */
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

/* The number of bytes of a grid's voxels; 0 if that is more than can be addressed. */
static inline uint64_t ex_grid_bytes(const int size[3], ex_type type) {
    uint64_t bytes = ex_type_size(type);
    for (int a = 0; a < 3; ++a) {
        if (size[a] < 1 || bytes > (uint64_t)SIZE_MAX / (uint64_t)size[a]) return 0;
        bytes *= (uint64_t)size[a];
    }
    return bytes;
}

/* Makes a grid of zeros whose stored numbers are its values. */
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

/* ----------------------------------------------------------------------------------------------- voxels in a file */

enum { EX_PATH_MAX = 4096 };

/* How the voxels are stored: as in memory, packed, or in a zip file, there as they are or packed. */
typedef enum ex_storage {
    EX_STORED_PLAIN = 0,
    EX_STORED_ZLIB,
    EX_STORED_GZIP,
    EX_STORED_ZIP,
    EX_STORED_DEFLATED
} ex_storage;

/* Where in a file the voxels are, and what they mean. */
typedef struct ex_voxel_file {
    char path[EX_PATH_MAX];
    uint64_t offset;         /* bytes before the first voxel, once unpacked */
    int at_end;              /* 1: the voxels are the last thing in the file, and `offset` does not count */
    int may_go_on;           /* 1: the file may be longer */
    ex_storage storage;      /* not plain: the next four lines say what is to be unpacked */
    uint64_t packed_at;      /* its first byte in the file */
    uint64_t packed_size;    /* its bytes; 0: all that follow */
    uint64_t unpacked_size;  /* in a zip file: the number of bytes unpacked */
    uint32_t crc;            /* in a zip file: their CRC-32 */
    double max_bytes;        /* the most that may be unpacked or allocated; 0: EX_MAX_BYTES */
    int size[3];             /* voxels along x, y, z */
    int components;          /* numbers per voxel: 1 or 3; 0 is 1 */
    int planes;              /* 1: all first components come first, then all second ones, then all third ones */
    ex_type type;            /* of the stored numbers */
    int big_endian;          /* byte order of the stored numbers */
    int x_slowest;           /* 1: in the file, z runs fastest and x slowest */
    double slope, intercept; /* a stored number s means slope * s + intercept; slope 0: just s */
    double range[2];         /* which of these numbers become the values 0 and 1; both 0: see ex_grid_scale */
} ex_voxel_file;

#define EX_MAX_BYTES 4e9

/* Describes a file without a header: little-endian voxels and nothing else. */
static inline int ex_voxel_file_raw(ex_voxel_file *file, const char *path, const int size[3], ex_type type,
                                    ex_error *error) {
    memset(file, 0, sizeof *file);
    if (strlen(path) >= sizeof file->path) return ex_fail(error, "%.64s...: the name is too long", path);
    memcpy(file->path, path, strlen(path) + 1);
    memcpy(file->size, size, sizeof file->size);
    file->type = type;
    return 0;
}

/* The size of the grid that holds all numbers: three components lie side by side along x. */
static inline void ex_voxel_file_size(const ex_voxel_file *from, int size[3]) {
    memcpy(size, from->size, 3 * sizeof *size);
    if (from->components > 1) size[0] *= from->components;
}

static inline uint64_t ex_voxel_file_bytes(const ex_voxel_file *from) {
    int size[3];
    ex_voxel_file_size(from, size);
    return ex_grid_bytes(size, from->type);
}

static inline int ex_voxel_file_short(const ex_voxel_file *from, uint64_t held, uint64_t before, ex_error *error) {
    char after[48] = "";
    if (before > 0) snprintf(after, sizeof after, ", after the first %llu", (unsigned long long)before);
    return ex_fail(error, "%s: the file holds %llu bytes, but size %d,%d,%d and type %s call for %llu%s", from->path,
                   (unsigned long long)held, from->size[0], from->size[1], from->size[2], ex_type_names[from->type],
                   (unsigned long long)ex_voxel_file_bytes(from), after);
}

static inline int ex_voxel_file_check_memory(const ex_voxel_file *from, uint64_t bytes, ex_error *error) {
    const double most = from->max_bytes > 0 ? from->max_bytes : EX_MAX_BYTES;
    if (bytes > 0 && (double)bytes <= most && bytes <= SIZE_MAX / 2) return 0;
    return ex_fail(error, "%s: size %d,%d,%d and type %s take %.0f bytes in memory; --max-bytes allows %.0f",
                   from->path, from->size[0], from->size[1], from->size[2], ex_type_names[from->type],
                   bytes > 0 ? (double)bytes : HUGE_VAL, most);
}

/* Reads voxels that are stored as in memory. *data is allocated, once the length of the file is known to be right. */
static inline int ex_voxel_file_read_plain(const ex_voxel_file *from, FILE *file, uint64_t held, void **data,
                                           ex_error *error) {
    const uint64_t needed = ex_voxel_file_bytes(from);
    const uint64_t before = !from->at_end ? from->offset : held > needed ? held - needed : 0;
    if (needed == 0 || held < before || held - before < needed || (!from->may_go_on && held - before != needed))
        return ex_voxel_file_short(from, held, before, error);
    if (ex_voxel_file_check_memory(from, needed, error)) return 1;
    if (fseeko(file, (off_t)before, SEEK_SET) != 0)
        return ex_fail(error, "%s: byte %llu: %s", from->path, (unsigned long long)before, strerror(errno));
    *data = ex_allocate((size_t)needed, 1);
    const size_t got = fread(*data, 1, (size_t)needed, file);
    return got == needed ? 0 : ex_fail(error, "%s: reading failed after %zu bytes", from->path, got);
}

/* Unpacks what is in memory to out, `total` bytes. MetaImage does not say whether its packed data are zlib or gzip. */
static inline int ex_voxel_file_inflate(const ex_voxel_file *from, const unsigned char *packed, size_t size,
                                        unsigned char *out, size_t total, ex_error *error) {
    const int is_gzip = from->storage == EX_STORED_GZIP || (size > 1 && packed[0] == 0x1f && packed[1] == 0x8b);
    const ex_packing packing = from->storage == EX_STORED_DEFLATED ? EX_PACKED_RAW
                               : is_gzip                           ? EX_PACKED_GZIP
                                                                   : EX_PACKED_ZLIB;
    if (from->storage != EX_STORED_ZIP) {
        if (ex_inflate(from->path, packing, packed, size, out, total, NULL, error)) return 1;
    } else {
        if (size != total)
            return ex_fail(error, "%s: zip: %zu bytes are stored for %zu of an array", from->path, size, total);
        memcpy(out, packed, size);
    }
    if (from->storage < EX_STORED_ZIP || ex_crc32(out, total) == from->crc) return 0;
    return ex_fail(error, "%s: zip: the data from byte %llu on have a wrong checksum", from->path,
                   (unsigned long long)from->packed_at);
}

/* Reads and unpacks voxels. Bytes before them are unpacked, too, and removed. */
static inline int ex_voxel_file_read_packed(const ex_voxel_file *from, FILE *file, uint64_t held, void **data,
                                            ex_error *error) {
    const uint64_t needed = ex_voxel_file_bytes(from), left = held > from->packed_at ? held - from->packed_at : 0;
    const uint64_t size = from->packed_size ? from->packed_size : left;
    uint64_t total = from->offset <= UINT64_MAX / 2 && needed <= UINT64_MAX / 2 ? from->offset + needed : 0;
    if (size == 0 || size > left)
        return ex_fail(error, "%s: the file holds %llu bytes, but %llu packed ones begin at byte %llu", from->path,
                       (unsigned long long)held, (unsigned long long)size, (unsigned long long)from->packed_at);
    if (from->storage >= EX_STORED_ZIP) {
        if (needed == 0 || total > from->unpacked_size)
            return ex_voxel_file_short(from, from->unpacked_size, from->offset, error);
        total = from->unpacked_size;
    }
    if (ex_voxel_file_check_memory(from, needed ? total : 0, error)) return 1;
    if (ex_voxel_file_check_memory(from, size, error)) return 1;
    unsigned char *packed = (unsigned char *)ex_allocate((size_t)size, 1);
    int failed = fseeko(file, (off_t)from->packed_at, SEEK_SET) != 0 || fread(packed, 1, (size_t)size, file) != size;
    if (failed) {
        ex_fail(error, "%s: reading failed after byte %llu", from->path, (unsigned long long)from->packed_at);
    } else {
        *data = ex_allocate((size_t)total, 1);
        failed = ex_voxel_file_inflate(from, packed, (size_t)size, (unsigned char *)*data, (size_t)total, error);
        if (!failed) memmove(*data, (char *)*data + from->offset, (size_t)needed);
    }
    free(packed);
    return failed;
}

/* Reorders voxels from z fastest to x fastest. */
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

/* Chooses what stored numbers mean. With a range, its two ends become the values 0 and 1. Without one, floats are
   values already; unsigned integers become 0..1 over the whole range of their type; signed and scaled integers become
   0..1 over the numbers in the file, because scanners use only a part of those types. */
static inline void ex_grid_scale(ex_grid *grid, const ex_voxel_file *from) {
    const double slope = from->slope != 0 ? from->slope : 1, intercept = from->slope != 0 ? from->intercept : 0;
    const int is_signed = ex_type_is_signed(grid->type);
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
        if (grid->unit == 0) grid->unit = 1; /* all voxels are equal: all become 0 */
    } else {
        grid->zero = 0;
        grid->unit = ldexp(1, 8 * (int)ex_type_size(grid->type)) - 1;
    }
}

/* Reads all numbers, in the file's order of axes, as a grid that holds what ex_voxel_file_size says. */
static inline int ex_grid_load_numbers(ex_grid *grid, const ex_voxel_file *from, ex_error *error) {
    uint64_t held = 0;
    memset(grid, 0, sizeof *grid);
    FILE *file = ex_open(from->path, &held, error);
    if (!file) return 1;
    const int failed = from->storage == EX_STORED_PLAIN
                           ? ex_voxel_file_read_plain(from, file, held, &grid->data, error)
                           : ex_voxel_file_read_packed(from, file, held, &grid->data, error);
    fclose(file);
    if (failed) {
        ex_grid_free(grid);
        return 1;
    }
    ex_voxel_file_size(from, grid->size);
    grid->type = from->type;
    grid->unit = 1, grid->most = FLT_MAX;
    const size_t item = ex_type_size(from->type), count = (size_t)ex_voxel_file_bytes(from) / item;
    ex_byte_order(grid->data, count, item, from->big_endian);
    return 0;
}

/* Reads the voxels. Nothing is allocated before the length of the file is known to be right. */
static inline int ex_grid_load(ex_grid *grid, const ex_voxel_file *from, ex_error *error) {
    memset(grid, 0, sizeof *grid);
    if (from->components > 1)
        return ex_fail(error, "%s: %d numbers per voxel are colors, for --albedo-volume or --emission-volume",
                       from->path, from->components);
    if (ex_grid_load_numbers(grid, from, error)) return 1;
    if (from->x_slowest) ex_grid_reverse_axes(grid);
    ex_grid_scale(grid, from);
    ex_grid_measure(grid);
    return 0;
}

#endif /* EX_VOLUME_H */
