/* The volume files that examples/volume_file.h reads: for every format, type and byte order, the voxels, their
   placement and their values are those that were written; and any invalid header ends in one line that names the file.
 */

#include "check.h"
#include "volume_file.h"
#include "color_volume.h"
#include "command_line.h"
#include "deflate.h"
#include <dirent.h>

/* ---------------------------------------------------------------------------------------------------- writing files */

enum { X = 3, Y = 4, Z = 5, VOXELS = X * Y * Z, FILE_MAX = 4096 };

/* A file under construction. */
typedef struct bytes {
    unsigned char data[FILE_MAX];
    size_t count;
} bytes;

static void put(bytes *file, const void *data, size_t size) {
    if (!CHECK(file->count + size <= FILE_MAX)) return;
    memcpy(file->data + file->count, data, size);
    file->count += size;
}

static void put_text(bytes *file, const char *text) { put(file, text, strlen(text)); }

/* A half float, of numbers that it holds exactly. */
static uint64_t half_of(double number) {
    int exponent;
    const double mantissa = frexp(fabs(number), &exponent); /* 0.5 to 1 */
    const uint64_t sign = number < 0 ? 0x8000 : 0;
    return number == 0 ? 0 : sign | (uint64_t)(exponent + 14) << 10 | ((uint64_t)(mantissa * 2048) & 1023);
}

/* Appends a number in a type and a byte order; by shifting, so that the machine's own order does not matter. */
static void put_number(bytes *file, double number, ex_type type, int big_endian) {
    unsigned char out[8];
    const size_t size = ex_type_size(type);
    uint64_t bits = ex_type_is_float(type) ? 0 : number < 0 ? (uint64_t)(int64_t)number : (uint64_t)number;
    if (type == EX_F32) {
        const float narrow = (float)number;
        uint32_t narrow_bits;
        memcpy(&narrow_bits, &narrow, sizeof narrow_bits);
        bits = narrow_bits;
    } else if (type == EX_F64) {
        memcpy(&bits, &number, sizeof bits);
    } else if (type == EX_F16) {
        bits = half_of(number);
    }
    for (size_t i = 0; i < size; ++i) out[big_endian ? size - 1 - i : i] = (unsigned char)(bits >> 8 * i & 255);
    put(file, out, size);
}

static void put_number_at(bytes *file, size_t at, double number, ex_type type, int big_endian) {
    const size_t count = file->count;
    file->count = at;
    put_number(file, number, type, big_endian);
    file->count = count;
}

/* The stored number of each voxel: spread over the type's range, including its ends, and different for each. */
static double number_of(ex_type type, int x, int y, int z) {
    const int n = (z * Y + y) * X + x;
    const double bits = 8 * (double)ex_type_size(type);
    const double low = type == EX_I8 || type == EX_I16 || type == EX_I32 ? -pow(2, bits - 1) : 0;
    if (ex_type_is_float(type)) return n * 0.75 - 9;
    if (type == EX_U64) return ldexp(n, 58);
    if (type == EX_I64) return ldexp(n - VOXELS / 2, 58);
    return low + floor((pow(2, bits) - 1) * n / (VOXELS - 1) + 0.5);
}

static void put_voxels(bytes *file, ex_type type, int big_endian, int x_slowest) {
    for (int n = 0; n < VOXELS; ++n) {
        const int x = x_slowest ? n / (Y * Z) : n % X, y = x_slowest ? n / Z % Y : n / X % Y,
                  z = x_slowest ? n % Z : n / (X * Y);
        put_number(file, number_of(type, x, y, z), type, big_endian);
    }
}

static void put_packed(bytes *file, wrapping kind, const bytes *plain) {
    file->count += deflate_all(kind, plain->data, plain->count, file->data + file->count, FILE_MAX - file->count);
}

static void put_packed_voxels(bytes *file, wrapping kind, ex_type type, int big_endian) {
    static bytes plain;
    plain.count = 0;
    put_voxels(&plain, type, big_endian, 0);
    put_packed(file, kind, &plain);
}

/* A rotated, scaled and mirrored placement: centre of the first voxel, steps along x, y, z. All are powers of two or
   sums of these, so that text and floats represent them exactly. */
static const double world_origin[3] = {-3, 0.5, 7}, world_step[3][3] = {{0, 0.25, 0}, {-0.5, 0, 0}, {0, 0, -2}};

static void write_nrrd(bytes *file, ex_type type, int big_endian, const char *encoding, const char *data_file) {
    static const char *const types[] = {"uchar", "signed char", "ushort", "short",     "uint",
                                        "int",   "float",       "double", "ulonglong", "int64"};
    char text[600];
    snprintf(text, sizeof text,
             "NRRD0004\n# written by a test\ntype: %s\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 4 5\n"
             "space directions: (0,0.25,0) (-0.5,0,0) (0, 0, -2)\nkinds: domain domain domain\nendian: %s\n"
             "encoding: %s\nspace origin: (-3,0.5,7)\nkey:=value: of a user\n",
             types[type], big_endian ? "big" : "little", encoding);
    file->count = 0;
    put_text(file, text);
    if (data_file) {
        snprintf(text, sizeof text, "data file: %s\n", data_file);
        put_text(file, text);
        return;
    }
    put_text(file, "\n");
    if (strcmp(encoding, "raw") == 0)
        put_voxels(file, type, big_endian, 0);
    else
        put_packed_voxels(file, GZIP, type, big_endian);
}

static void write_meta(bytes *file, ex_type type, int big_endian, int packed, const char *data_file) {
    static const char *const types[] = {"UCHAR", "CHAR",  "USHORT", "SHORT",      "UINT",
                                        "INT",   "FLOAT", "DOUBLE", "ULONG_LONG", "LONG_LONG"};
    char text[600];
    snprintf(text, sizeof text,
             "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = %s\nCompressedData = %s\n"
             "TransformMatrix = 0 1 0 -1 0 0 0 0 -1\nOffset = -3 0.5 7\nCenterOfRotation = 0 0 0\n"
             "AnatomicalOrientation = RAI\nElementSpacing = 0.25 0.5 2\nDimSize = 3 4 5\nElementType = MET_%s\n"
             "ElementDataFile = %s\n",
             big_endian ? "True" : "False", packed ? "True" : "False", types[type], data_file ? data_file : "LOCAL");
    file->count = 0;
    put_text(file, text);
    if (!data_file && !packed) put_voxels(file, type, big_endian, 0);
    if (!data_file && packed) put_packed_voxels(file, ZLIB, type, big_endian);
}

static const double nifti_codes[] = {2, 256, 512, 4, 768, 8, 16, 64, 1280, 1024};

/* 352 bytes, with all of sform; voxels follow. */
static void write_nifti(bytes *file, ex_type type, int big_endian) {
    const double dim[5] = {3, X, Y, Z, 1};
    memset(file, 0, sizeof *file);
    file->count = 352;
    put_number_at(file, 0, 348, EX_I32, big_endian);
    for (size_t i = 0; i < 5; ++i) put_number_at(file, 40 + 2 * i, dim[i], EX_I16, big_endian);
    put_number_at(file, 70, nifti_codes[type], EX_I16, big_endian);
    put_number_at(file, 72, 8 * (double)ex_type_size(type), EX_I16, big_endian);
    for (size_t i = 0; i < 4; ++i) put_number_at(file, 76 + 4 * i, 1, EX_F32, big_endian);
    put_number_at(file, 108, 352, EX_F32, big_endian);
    put_number_at(file, 254, 1, EX_I16, big_endian);
    for (size_t i = 0; i < 3; ++i) {
        for (size_t a = 0; a < 3; ++a) put_number_at(file, 280 + 16 * i + 4 * a, world_step[a][i], EX_F32, big_endian);
        put_number_at(file, 292 + 16 * i, world_origin[i], EX_F32, big_endian);
    }
    memcpy(file->data + 344, "n+1", 4);
    put_voxels(file, type, big_endian, 0);
}

/* 544 bytes: the same numbers, in other types and elsewhere. */
static void write_nifti_2(bytes *file, ex_type type, int big_endian) {
    const double dim[5] = {3, X, Y, Z, 1};
    memset(file, 0, sizeof *file);
    file->count = 544;
    put_number_at(file, 0, 540, EX_I32, big_endian);
    memcpy(file->data + 4, "n+2\0\r\n\032\n", 8);
    put_number_at(file, 12, nifti_codes[type], EX_I16, big_endian);
    put_number_at(file, 14, 8 * (double)ex_type_size(type), EX_I16, big_endian);
    for (size_t i = 0; i < 5; ++i) put_number_at(file, 16 + 8 * i, dim[i], EX_I64, big_endian);
    for (size_t i = 0; i < 4; ++i) put_number_at(file, 104 + 8 * i, 1, EX_F64, big_endian);
    put_number_at(file, 168, 544, EX_I64, big_endian);
    put_number_at(file, 348, 1, EX_I32, big_endian);
    for (size_t i = 0; i < 3; ++i) {
        for (size_t a = 0; a < 3; ++a) put_number_at(file, 400 + 32 * i + 8 * a, world_step[a][i], EX_F64, big_endian);
        put_number_at(file, 424 + 32 * i, world_origin[i], EX_F64, big_endian);
    }
    put_voxels(file, type, big_endian, 0);
}

/* A .hdr file without the four bytes of extensions; the voxels go to the .img file, of which three bytes are skipped.
 */
static void write_pair(bytes *file, ex_type type, int big_endian, int version) {
    static bytes image;
    if (version == 1) {
        write_nifti(file, type, big_endian);
        file->count = 348;
        put_number_at(file, 108, 3, EX_F32, big_endian);
        memcpy(file->data + 344, "ni1", 4);
    } else {
        write_nifti_2(file, type, big_endian);
        file->count = 540;
        put_number_at(file, 168, 3, EX_I64, big_endian);
        memcpy(file->data + 4, "ni2", 4);
    }
    image.count = 0;
    put_text(&image, "abc");
    put_voxels(&image, type, big_endian, 0);
    write_file(version == 1 ? "a.img" : "b.img", image.data, image.count);
}

static void pack_file(bytes *file) {
    static bytes plain;
    plain = *file;
    file->count = 0;
    put_packed(file, GZIP, &plain);
}

/* The header is padded to a multiple of 64 bytes, as by NumPy. */
static void write_npy(bytes *file, ex_type type, int big_endian, int version, int fortran) {
    static const char *const types[] = {"u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8", "u8", "i8", "f2"};
    const size_t start = version == 1 ? 10 : 12;
    char text[200];
    const int length = snprintf(text, sizeof text, "{'descr': '%c%s', 'fortran_order': %s, 'shape': (5, 4, 3), }",
                                ex_type_size(type) == 1 ? '|'
                                : big_endian            ? '>'
                                                        : '<',
                                types[type], fortran ? "True" : "False");
    const size_t filled = (start + (size_t)length + 1 + 63) / 64 * 64 - start;
    file->count = 0;
    put(file, "\x93NUMPY", 6);
    put_number(file, version, EX_U8, 0);
    put_number(file, 0, EX_U8, 0);
    put_number(file, (double)filled, version == 1 ? EX_U16 : EX_U32, 0);
    put_text(file, text);
    for (size_t i = (size_t)length; i + 1 < filled; ++i) put_text(file, " ");
    put_text(file, "\n");
    put_voxels(file, type, big_endian, fortran);
}

/* An array in a zip file, after something else. */
static void write_npz(bytes *file, ex_type type, int big_endian, int method) {
    static bytes plain;
    write_npy(&plain, type, big_endian, 1, 0);
    const zip_member members[2] = {{"readme.txt", "what it is", 10, 0}, {"dir/a.npy", plain.data, plain.count, method}};
    file->count = zip_all(members, 2, file->data, FILE_MAX);
}

/* The formats of the tests below, and the file name of each. */
typedef enum format {
    NRRD,
    NRRD_GZIP,
    NHDR,
    NHDR_GZIP,
    MHA,
    MHA_ZLIB,
    MHD,
    MHD_ZLIB,
    NIFTI,
    NIFTI_GZIP,
    NIFTI_2,
    NIFTI_2_GZIP,
    PAIR_1,
    PAIR_2,
    NPY_1,
    NPY_2,
    NPY_3,
    NPY_FORTRAN,
    NPZ_STORED,
    NPZ,
    FORMAT_COUNT
} format;

static const char *const format_names[] = {"a.nrrd", "b.nrrd", "a.nhdr",   "b.nhdr", "a.mha",    "b.mha", "a.mhd",
                                           "b.mhd",  "a.nii",  "a.nii.gz", "b.nii",  "b.nii.gz", "a.hdr", "b.hdr",
                                           "a.npy",  "b.npy",  "c.npy",    "d.npy",  "a.npz",    "b.npz"};

/* Whether the header is in one file and the voxels in another. */
static int is_detached(format which) {
    return which == NHDR || which == NHDR_GZIP || which == MHD || which == MHD_ZLIB || which == PAIR_1 ||
           which == PAIR_2;
}

static int is_packed(format which) {
    return which == NRRD_GZIP || which == NHDR_GZIP || which == MHA_ZLIB || which == MHD_ZLIB || which == NIFTI_GZIP ||
           which == NIFTI_2_GZIP || which == NPZ || which == NPZ_STORED;
}

/* Only NumPy has halves. */
static int has_type(format which, ex_type type) { return type != EX_F16 || which >= NPY_1; }

/* The file itself; detached data go to a.raw or another file. */
static void write_format(bytes *file, format which, ex_type type, int big_endian) {
    static bytes detached;
    detached.count = 0;
    put_voxels(&detached, type, big_endian, 0);
    if (which == NHDR || which == MHD) write_file("a.raw", detached.data, detached.count);
    detached.count = 0;
    put_packed_voxels(&detached, which == MHD_ZLIB ? ZLIB : GZIP, type, big_endian);
    if (which == NHDR_GZIP) write_file("a.raw.gz", detached.data, detached.count);
    if (which == MHD_ZLIB) write_file("a.zraw", detached.data, detached.count);
    if (which == NRRD || which == NHDR) write_nrrd(file, type, big_endian, "raw", which == NHDR ? "a.raw" : NULL);
    if (which == NRRD_GZIP) write_nrrd(file, type, big_endian, "gzip", NULL);
    if (which == NHDR_GZIP) write_nrrd(file, type, big_endian, "gz", "a.raw.gz");
    if (which == MHA || which == MHD) write_meta(file, type, big_endian, 0, which == MHD ? "a.raw" : NULL);
    if (which == MHA_ZLIB || which == MHD_ZLIB)
        write_meta(file, type, big_endian, 1, which == MHD_ZLIB ? "a.zraw" : NULL);
    if (which == NIFTI || which == NIFTI_GZIP) write_nifti(file, type, big_endian);
    if (which == NIFTI_2 || which == NIFTI_2_GZIP) write_nifti_2(file, type, big_endian);
    if (which == NIFTI_GZIP || which == NIFTI_2_GZIP) pack_file(file);
    if (which == PAIR_1 || which == PAIR_2) write_pair(file, type, big_endian, which == PAIR_1 ? 1 : 2);
    if (which >= NPY_1 && which <= NPY_FORTRAN)
        write_npy(file, type, big_endian, which == NPY_FORTRAN ? 1 : which - NPY_1 + 1, which == NPY_FORTRAN);
    if (which >= NPZ_STORED) write_npz(file, type, big_endian, which == NPZ ? 8 : 0);
    write_file(format_names[which], file->data, file->count);
}

/* ---------------------------------------------------------------------------------------------------- reading files */

/* Reads a header and its voxels from the tests' folder; the caller frees the grid, which is empty after a failure. */
static int read_volume(const char *name, ex_volume_file *file, ex_grid *grid, ex_error *error) {
    char path[200];
    memset(grid, 0, sizeof *grid);
    error->text[0] = '\0';
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return ex_volume_file_read(file, path, error) || ex_grid_load(grid, &file->voxels, error);
}

/* The same; a failure counts. */
static int must_read(const char *name, ex_volume_file *file, ex_grid *grid) {
    ex_error error;
    if (CHECK(read_volume(name, file, grid, &error) == 0)) return 1;
    printf("    %s\n", error.text);
    return 0;
}

static int has_size(const int size[3]) { return size[0] == X && size[1] == Y && size[2] == Z; }

/* The stored numbers, before any scaling; floats hold all of them exactly, except for those of 32 bits, which are
   rounded. */
static int has_numbers(const ex_grid *grid, ex_type type) {
    ex_grid plain = *grid;
    float row[X];
    plain.zero = 0, plain.unit = 1, plain.least = -FLT_MAX, plain.most = FLT_MAX;
    for (int z = 0; z < Z; ++z)
        for (int y = 0; y < Y; ++y) {
            ex_grid_row(&plain, 0, y, z, X, row);
            for (int x = 0; x < X; ++x)
                if (row[x] != (float)number_of(type, x, y, z)) return 0;
        }
    return 1;
}

static int is_placed(const ex_volume_file *file, const double origin[3], const double step[3][3], double tolerance) {
    for (int i = 0; i < 3; ++i) {
        if (!(fabs(file->origin[i] - origin[i]) <= tolerance)) return 0;
        for (int a = 0; a < 3; ++a)
            if (!(fabs(file->step[a][i] - step[a][i]) <= tolerance)) return 0;
    }
    return 1;
}

/* Every format, type and byte order: size, type, numbers and placement. NPY has no placement. */
static void test_every_type(void) {
    static const double nowhere[3] = {0, 0, 0}, unit[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static bytes file;
    for (int which = 0; which < FORMAT_COUNT; ++which)
        for (int type = EX_U8; type <= EX_F16 && has_type((format)which, (ex_type)type); ++type)
            for (int big_endian = 0; big_endian < 2; ++big_endian) {
                const int placed = which < NPY_1;
                ex_volume_file header;
                ex_grid grid;
                write_format(&file, (format)which, (ex_type)type, big_endian);
                if (must_read(format_names[which], &header, &grid)) {
                    const int good =
                        CHECK(has_size(grid.size)) && CHECK((int)grid.type == type) &&
                        CHECK(has_numbers(&grid, (ex_type)type)) &&
                        CHECK(is_placed(&header, placed ? world_origin : nowhere, placed ? world_step : unit, 0));
                    if (!good) printf("    %s of %s\n", format_names[which], ex_type_names[type]);
                }
                ex_grid_free(&grid);
            }
}

/* The box puts the voxels' centres where the header says. */
static void test_placement_of_box(void) {
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    write_format(&file, NRRD, EX_U8, 0);
    if (!must_read("a.nrrd", &header, &grid)) return;
    const sps_placement box = ex_volume_file_placement(&header);
    for (int n = 0; n < VOXELS; ++n) {
        const int at[3] = {n % X, n / X % Y, n / (X * Y)};
        for (int i = 0; i < 3; ++i) {
            double by_box = box.origin[i], by_header = world_origin[i];
            for (int a = 0; a < 3; ++a) {
                by_box += box.axis[a][i] * (at[a] + 0.5) / grid.size[a];
                by_header += world_step[a][i] * at[a];
            }
            CHECK_NEAR(by_box, by_header, 1e-14); /* round-off of a few sums below 16 */
        }
    }
    ex_grid_free(&grid);
}

/* -------------------------------------------------------------------------------------------------------- placement */

/* Rotates a vector by a unit quaternion (w, v): v' = x + 2 w (v x x) + 2 v x (v x x). */
static void rotate(const double q[4], const double x[3], double out[3]) {
    const double *v = q + 1;
    const double once[3] = {v[1] * x[2] - v[2] * x[1], v[2] * x[0] - v[0] * x[2], v[0] * x[1] - v[1] * x[0]};
    const double twice[3] = {v[1] * once[2] - v[2] * once[1], v[2] * once[0] - v[0] * once[2],
                             v[0] * once[1] - v[1] * once[0]};
    for (int i = 0; i < 3; ++i) out[i] = x[i] + 2 * q[0] * once[i] + 2 * twice[i];
}

/* Writes the numbers of a quaternion's placement: of kind 0, 1 or 2 below. */
static void write_quaternion(bytes *file, int version, int kind, const double q[4], const double pixdim[3]) {
    static const size_t places[2][4] = {{76, 252, 256, 268},
                                        {104, 344, 352, 376}}; /* pixdim, qform, quatern, qoffset */
    const size_t *at = places[version - 1], size = version == 1 ? 4 : 8;
    const ex_type real = version == 1 ? EX_F32 : EX_F64, code = version == 1 ? EX_I16 : EX_I32;
    if (version == 1)
        write_nifti(file, EX_U8, 1);
    else
        write_nifti_2(file, EX_U8, 1);
    put_number_at(file, at[1], kind < 2, code, 1);
    put_number_at(file, at[1] + ex_type_size(code), 0, code, 1);
    put_number_at(file, at[0], kind == 1 ? -1 : 1, real, 1);
    for (size_t a = 0; a < 3; ++a) {
        put_number_at(file, at[0] + size * (1 + a), pixdim[a], real, 1);
        put_number_at(file, at[2] + size * a, q[a + 1], real, 1);
        put_number_at(file, at[3] + size * a, world_origin[a], real, 1);
    }
    write_file("q.nii", file->data, file->count);
}

/* NIfTI's other placements: a quaternion, whose handedness is in pixdim[0], or spacing alone. */
static void test_nifti_placement(void) {
    static const double q[4] = {0.5, 0.7, -0.1, 0.5}, pixdim[3] = {0.25, 0.5, 2}; /* q has length 1 */
    static const double zero[3] = {0, 0, 0};
    static bytes file;
    for (int version = 1; version <= 2; ++version)
        for (int kind = 0; kind < 3; ++kind) { /* right-handed, left-handed, no quaternion */
            double step[3][3];
            ex_volume_file header;
            ex_grid grid;
            write_quaternion(&file, version, kind, q, pixdim);
            for (size_t a = 0; a < 3; ++a) {
                double along[3] = {0, 0, 0};
                along[a] = a == 2 && kind == 1 ? -pixdim[a] : pixdim[a];
                if (kind < 2)
                    rotate(q, along, step[a]);
                else
                    memcpy(step[a], along, sizeof along);
            }
            /* The file's floats have errors of 3e-8 of 0.7; w = sqrt(1 - v^2) of 5e-8 times v / w; both doubled by a
               step of 2 */
            if (must_read("q.nii", &header, &grid))
                CHECK(is_placed(&header, kind < 2 ? world_origin : zero, step, 1e-6));
            ex_grid_free(&grid);
        }
}

/* Headers that are complete, or nearly so */
#define NRRD_HEAD   "NRRD0004\ndimension: 3\n"
#define NRRD_REST   "sizes: 2 1 1\ntype: uint8\nencoding: raw\n"
#define NRRD_PACKED "sizes: 2 1 1\ntype: uint8\nencoding: gzip\n"
#define COLOR_HEAD  "NRRD0004\ndimension: 4\nsizes: 3 1 1 2\ntype: uint8\nencoding: raw\n"
#define META_HEAD   "NDims = 3\nDimSize = 2 1 1\nElementType = MET_UCHAR\n"

static void write_text(const char *name, const char *text) { write_file(name, text, strlen(text)); }

/* Spacing alone, in the text formats; and MetaImage's other names for the same fields. */
static void test_spacing(void) {
    static const double nowhere[3] = {0, 0, 0}, spacing[3][3] = {{0.25, 0, 0}, {0, 3, 0}, {0, 0, -1}};
    static const struct {
        const char *name, *text;
        int placed; /* at world_origin */
    } files[] = {
        {"s.nrrd", "NRRD0001\ndimension: 3\ntype: uint8\nsizes: 2 1 1\nspacings: 0.25 3 -1\nencoding: RAW\n\nab", 0},
        {"s.mha",
         "NDims = 3\nDimSize = 2 1 1\nElementType = MET_UCHAR\nElementSpacing = 0.25 3 -1\n"
         "ElementDataFile = LOCAL\nab",
         0},
        {"t.mha",
         "NDims = 3\r\nDimSize = 2 1 1\r\nElementType = MET_UCHAR\r\nElementSpacing = 0.25 3 -1\r\n\r\n"
         "Position = -3 0.5 7\r\nOrientation = 1 0 0 0 1 0 0 0 1\r\nElementDataFile = LOCAL\r\nab",
         1}};
    for (size_t i = 0; i < sizeof files / sizeof *files; ++i) {
        ex_volume_file header;
        ex_grid grid;
        write_text(files[i].name, files[i].text);
        if (must_read(files[i].name, &header, &grid)) {
            CHECK(is_placed(&header, files[i].placed ? world_origin : nowhere, spacing, 0));
            CHECK(memcmp(grid.data, "ab", 2) == 0);
        }
        ex_grid_free(&grid);
    }
}

/* Voxels that are not at the beginning of their file. */
static void test_skipping(void) {
    static const char *const headers[] = {NRRD_HEAD NRRD_REST "byte skip: 3\ndata file: skip.raw\n",
                                          NRRD_HEAD NRRD_REST "line skip: 1\ndatafile: ./skip.raw\n\n",
                                          NRRD_HEAD NRRD_REST "lineskip: 0\nbyteskip: -1\ndata file: end.raw",
                                          NRRD_HEAD NRRD_REST "line skip: 1\nbyte skip: 1\n\n12\n3ab",
                                          META_HEAD "HeaderSize = 3\nElementDataFile = skip.raw\n",
                                          META_HEAD "HeaderSize = -1\nElementDataFile = end.raw\n"};
    write_text("skip.raw", "12\nab and more");
    write_text("end.raw", "12\nab");
    for (size_t i = 0; i < sizeof headers / sizeof *headers; ++i) {
        const char *name = headers[i][1] == 'R' ? "skip.nhdr" : "skip.mhd";
        ex_volume_file header;
        ex_grid grid;
        write_text(name, headers[i]);
        if (must_read(name, &header, &grid) && !CHECK(memcmp(grid.data, "ab", 2) == 0)) printf("    %s\n", headers[i]);
        ex_grid_free(&grid);
    }
}

/* ----------------------------------------------------------------------------------------------------------- values */

/* Checks the values of a file of two voxels. */
static void check_values(const ex_volume_file *header, const double range[2], float first, float second) {
    ex_voxel_file voxels = header->voxels;
    ex_grid grid;
    ex_error error;
    float got[2];
    memcpy(voxels.range, range, sizeof voxels.range);
    if (CHECK(ex_grid_load(&grid, &voxels, &error) == 0)) {
        ex_grid_row(&grid, 0, 0, 0, 2, got);
        /* A division and, for scaled numbers, the slope's */
        CHECK_NEAR((double)got[0], (double)first, 2e-7 * fabs((double)first));
        CHECK_NEAR((double)got[1], (double)second, 2e-7 * fabs((double)second));
    }
    ex_grid_free(&grid);
}

/* Two voxels as a NIfTI file, which is the format that can scale. */
static void write_two(const char *name, ex_type type, double a, double b, const double scale[2]) {
    static bytes file;
    static const double size[3] = {2, 1, 1};
    write_nifti(&file, type, 0);
    for (size_t i = 0; i < 3; ++i) put_number_at(&file, 42 + 2 * i, size[i], EX_I16, 0);
    put_number_at(&file, 112, scale[0], EX_F32, 0);
    put_number_at(&file, 116, scale[1], EX_F32, 0);
    file.count = 352;
    put_number(&file, a, type, 0);
    put_number(&file, b, type, 0);
    write_file(name, file.data, file.count);
}

/* The values of stored numbers: by type, by NIfTI's scale, and by a range. */
static void test_values(void) {
    static const struct {
        ex_type type;
        double stored[2], scale[2], range[2];
        float values[2];
    } cases[] = {/* unsigned: all of the type */
                 {EX_U8, {51, 255}, {0, 0}, {0, 0}, {0.2f, 1}},
                 {EX_U8, {51, 255}, {1, 0}, {0, 0}, {0.2f, 1}},
                 {EX_U16, {13107, 0}, {0, 9}, {0, 0}, {0.2f, 0}},
                 {EX_U32, {4294967295.0, 1 << 20}, {0, 0}, {0, 0}, {1, 1048576 / 4294967295.0f}},
                 /* signed: what there is */
                 {EX_I8, {-100, 27}, {0, 0}, {0, 0}, {0, 1}},
                 {EX_I16, {3000, -1024}, {0, 0}, {0, 0}, {1, 0}},
                 {EX_I32, {-2147483648.0, 2147483647.0}, {0, 0}, {0, 0}, {0, 1}},
                 {EX_I16, {7, 7}, {0, 0}, {0, 0}, {0, 0}},
                 /* scaled: likewise; a falling scale turns them round */
                 {EX_U8, {10, 110}, {0.5, -1024}, {0, 0}, {0, 1}},
                 {EX_U8, {10, 110}, {-0.5, 0}, {0, 0}, {1, 0}},
                 /* floats: as they stand, below 0 nothing */
                 {EX_F32, {-3, 0.125}, {0, 0}, {0, 0}, {0, 0.125f}},
                 {EX_F64, {1e300, 70}, {0, 0}, {0, 0}, {FLT_MAX, 70}},
                 {EX_F32, {2, 10}, {0.5, -3}, {0, 0}, {0, 2}},
                 /* a range: its ends, after scaling */
                 {EX_U8, {20, 220}, {0, 0}, {70, 120}, {0, 1}},
                 {EX_U8, {20, 220}, {0, 0}, {-30, 270}, {1 / 6.0f, 5 / 6.0f}},
                 {EX_I16, {-1000, 500}, {0, 0}, {-1000, 2000}, {0, 0.5f}},
                 {EX_I16, {24, 1524}, {1, -1024}, {-1000, 2000}, {0, 0.5f}},
                 {EX_I16, {2024, 3524}, {0.5, -1012}, {-500, 1000}, {1 / 3.0f, 5 / 6.0f}},
                 {EX_F32, {-0.5, 0.25}, {0, 0}, {0.5, -0.5}, {1, 0.25f}}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const int failed = check_failed;
        ex_volume_file header;
        ex_grid grid;
        write_two("two.nii", cases[i].type, cases[i].stored[0], cases[i].stored[1], cases[i].scale);
        if (must_read("two.nii", &header, &grid))
            check_values(&header, cases[i].range, cases[i].values[0], cases[i].values[1]);
        ex_grid_free(&grid);
        if (check_failed > failed) printf("    case %d: %s\n", (int)i, ex_type_names[cases[i].type]);
    }
}

/* The range by which blocks are skipped is that of the values: minimum and maximum over the same voxels. NaN is left
   for the library. */
static void test_ranges_of_blocks(void) {
    static const double none[2] = {0, 0};
    static const int lo[3] = {0, 0, 0}, size[3] = {2, 1, 1};
    ex_volume_file header;
    ex_grid grid;
    float range[2], values[2];
    write_two("two.nii", EX_I16, -1024, 3071, none);
    if (must_read("two.nii", &header, &grid)) {
        ex_grid_range(&grid, lo, size, range);
        CHECK(range[0] == 0 && range[1] == 1);
    }
    ex_grid_free(&grid);
    write_two("two.nii", EX_F32, sqrt(-1.0), 1, none);
    if (must_read("two.nii", &header, &grid)) {
        ex_grid_row(&grid, 0, 0, 0, 2, values);
        CHECK(values[0] != values[0] && values[1] == 1);
        ex_grid_range(&grid, lo, size, range);
        CHECK(range[0] == 0 && range[1] == 1e18f);
    }
    ex_grid_free(&grid);
}

/* Lines are skipped before unpacking, bytes after it. */
static void test_packed_skipping(void) {
    static const struct {
        const char *name, *header;
    } cases[] = {{"skip.nrrd", NRRD_HEAD NRRD_PACKED "byte skip: 3\n\n"},
                 {"skip.nrrd", NRRD_HEAD NRRD_PACKED "byte skip: 3\nline skip: 2\n\none\ntwo\n"},
                 {"skip.nhdr", NRRD_HEAD NRRD_PACKED "byte skip: 3\nline skip: 2\ndata file: skip.gz\n"},
                 {"skip.mha", META_HEAD "CompressedData = True\nElementDataFile = LOCAL\n"},
                 {"skip.mhd", META_HEAD "CompressedData = True\nHeaderSize = 8\nElementDataFile = skip.gz\n"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        static bytes file, plain;
        const int is_meta = cases[i].name[5] == 'm', is_detached_here = strstr(cases[i].header, "skip.gz") != NULL;
        ex_volume_file header;
        ex_grid grid;
        file.count = plain.count = 0;
        put_text(&plain, is_meta ? "ab" : "12\nab");
        put_text(&file, is_detached_here ? "one\ntwo\n" : cases[i].header);
        put_packed(&file, is_meta && !is_detached_here ? ZLIB : GZIP, &plain); /* MetaImage takes both */
        write_file(is_detached_here ? "skip.gz" : cases[i].name, file.data, file.count);
        if (is_detached_here) write_text(cases[i].name, cases[i].header);
        if (must_read(cases[i].name, &header, &grid)) CHECK(memcmp(grid.data, "ab", 2) == 0);
        ex_grid_free(&grid);
    }
}

/* MetaImage's scale, and its other word for the spacing. */
static void test_scaled_meta(void) {
    static const double none[2] = {0, 0}, range[2] = {0, 100}, nowhere[3] = {0, 0, 0};
    static const double step[3][3] = {{2, 0, 0}, {0, 3, 0}, {0, 0, 4}}, other[3][3] = {{5, 0, 0}, {0, 6, 0}, {0, 0, 7}};
    ex_volume_file header;
    ex_grid grid;
    write_text("s.mha", META_HEAD "ElementToIntensityFunctionSlope = 0.5\nElementToIntensityFunctionOffset = -10\n"
                                  "ElementSize = 2 3 4\nElementDataFile = LOCAL\n\x14\x78");
    if (must_read("s.mha", &header, &grid)) { /* 20 and 120 mean 0 and 50 */
        check_values(&header, range, 0, 0.5f);
        check_values(&header, none, 0, 1);
        CHECK(is_placed(&header, nowhere, step, 0));
    }
    ex_grid_free(&grid);
    write_text("s.mha", META_HEAD "ElementToIntensityFunctionOffset = -20\nElementSpacing = 5 6 7\n"
                                  "ElementSize = 2 3 4\nElementDataFile = LOCAL\n\x14\x78");
    if (must_read("s.mha", &header, &grid)) {
        check_values(&header, range, 0, 1);
        CHECK(is_placed(&header, nowhere, other, 0));
    }
    ex_grid_free(&grid);
}

/* Two voxels of three bytes, 1 2 3 and 4 5 6, with a header, or in a NPY or NIfTI file. */
static void write_colors(const char *name, const char *header, int planes) {
    static const char dictionary[] = "{'descr':'|u1','fortran_order':False,'shape':(2,1,1,3)}";
    static bytes file;
    file.count = 0;
    if (header) put_text(&file, header);
    if (strcmp(name, "c.npy") == 0) {
        put(&file, "\x93NUMPY\1\0", 8);
        put_number(&file, sizeof dictionary - 1, EX_U16, 0);
        put_text(&file, dictionary);
    }
    if (strcmp(name, "c.nii") == 0) {
        static const double dim[3] = {1, 1, 2};
        write_nifti(&file, EX_U8, 0);
        file.count = 352;
        for (size_t i = 0; i < 3; ++i) put_number_at(&file, 42 + 2 * i, dim[i], EX_I16, 0);
        put_number_at(&file, 70, 128, EX_I16, 0), put_number_at(&file, 72, 24, EX_I16, 0);
    }
    put(&file, planes ? "\1\4\2\5\3\6" : "\1\2\3\4\5\6", 6);
    write_file(name, file.data, file.count);
}

/* Every format that has them, as triples or as three planes. They are refused where a volume is expected. */
static void test_colors(void) {
    static const char planes[] = "NRRD0005\ndimension: 4\nsizes: 1 1 2 3\ntype: uint8\nencoding: raw\n"
                                 "kinds: space space space list\n\n";
    static const char channels[] = "NDims = 3\nDimSize = 1 1 2\nElementType = MET_UCHAR\n"
                                   "ElementNumberOfChannels = 3\nElementDataFile = LOCAL\n";
    static const struct {
        const char *name, *header;
    } cases[] = {{"c.nrrd", COLOR_HEAD "kinds: RGB-color domain domain domain\n\n"},
                 {"c.nrrd", COLOR_HEAD "kinds: vector space space space\nspacings: nan 1 1 1\n\n"},
                 {"c.nrrd", COLOR_HEAD "space directions: none (1,0,0) (0,1,0) (0,0,1)\n\n"},
                 {"c.nrrd", planes},
                 {"c.mha", channels},
                 {"c.npy", NULL},
                 {"c.nii", NULL}};
    static const int lo[3] = {0, 0, 1}, one[3] = {1, 1, 1}, zero[3] = {0, 0, 0}, all[3] = {1, 1, 2};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char path[200];
        float got[6];
        ex_volume_file header;
        ex_color_grid colors;
        ex_grid grid;
        ex_error error;
        write_colors(cases[i].name, cases[i].header, cases[i].header == planes);
        snprintf(path, sizeof path, "%s/%s", folder, cases[i].name);
        CHECK(read_volume(cases[i].name, &header, &grid, &error) != 0 && strstr(error.text, "--emission-volume"));
        if (!CHECK(ex_volume_file_read(&header, path, &error) == 0 && header.voxels.components == 3) ||
            !CHECK(ex_color_grid_load(&colors, &header.voxels, &error) == 0)) {
            printf("    %s\n", error.text);
            continue;
        }
        CHECK(colors.size[0] == 1 && colors.size[1] == 1 && colors.size[2] == 2);
        ex_color_grid_read(&colors, zero, all, got);
        for (int k = 0; k < 6; ++k) CHECK_NEAR((double)got[k], (k + 1) / 255.0, 1e-8); /* a float below 1/32 */
        ex_color_grid_read(&colors, lo, one, got);
        CHECK_NEAR((double)got[2], 6 / 255.0, 1e-8);
        ex_color_grid_free(&colors);
    }
}

/* One number per voxel is no color, also where it has an axis of its own. */
static void test_no_colors(void) {
    ex_color_grid colors;
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    write_text("c.nrrd", NRRD_HEAD NRRD_REST "\nab");
    if (must_read("c.nrrd", &header, &grid))
        CHECK(ex_color_grid_load(&colors, &header.voxels, &error) != 0 && strstr(error.text, "one number per voxel"));
    ex_grid_free(&grid);
    write_text("c.nrrd", "NRRD0005\ndimension: 4\nsizes: 1 2 1 1\ntype: uint8\nencoding: raw\n"
                         "kinds: stub space space space\n\nab");
    if (must_read("c.nrrd", &header, &grid)) CHECK(header.voxels.components == 1 && grid.size[0] == 2);
    ex_grid_free(&grid);
}

/* Booleans are 0 and 1, NaN and infinity of halves stay so, and the smallest halves are right. */
static void test_other_types(void) {
    static const uint16_t halves[] = {0x0001, 0x03ff, 0x0400, 0x3c00, 0x7bff, 0x8000, 0x3555};
    static const double values[] = {0x1p-24, 0x3ffp-24, 0x1p-14, 1, 65504, 0, 0x555p-12};
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    float row[2];
    for (size_t i = 0; i < sizeof halves / sizeof *halves; ++i)
        CHECK((double)ex_half_value(halves[i]) == values[i] &&
              (double)ex_half_value((uint16_t)(halves[i] ^ 0x8000u)) == -values[i]);
    CHECK(ex_half_value(0x7c00) == INFINITY && ex_half_value(0xfc00) == -INFINITY);
    CHECK(ex_half_value(0x7c01) != ex_half_value(0x7c01));
    file.count = 0;
    put(&file, "\x93NUMPY\1\0\x37\0", 10);
    put_text(&file, "{'descr':'|b1','fortran_order':False,'shape':(1,1,2)  }");
    put(&file, "\0\1", 2);
    write_file("b.npy", file.data, file.count);
    if (must_read("b.npy", &header, &grid)) {
        ex_grid_row(&grid, 0, 0, 0, 2, row);
        CHECK(row[0] == 0 && row[1] == 1);
    }
    ex_grid_free(&grid);
}

/* What a header says about its coordinates. */
static void test_spaces(void) {
    static const struct {
        const char *name, *text, *space;
    } files[] = {{"s.nrrd", NRRD_HEAD NRRD_REST "space: right-anterior-superior\n\nab", "RAS"},
                 {"s.nrrd", NRRD_HEAD NRRD_REST "space: LPS\n\nab", "LPS"},
                 {"s.nrrd", NRRD_HEAD NRRD_REST "space: scanner-xyz\n\nab", "scanner-xyz"},
                 {"s.nrrd", NRRD_HEAD NRRD_REST "\nab", ""},
                 {"s.mha", META_HEAD "AnatomicalOrientation = RAI\nElementDataFile = LOCAL\nab", "LPS"},
                 {"s.mha", META_HEAD "AnatomicalOrientation = ???\nElementDataFile = LOCAL\nab", ""}};
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    for (size_t i = 0; i < sizeof files / sizeof *files; ++i) {
        write_text(files[i].name, files[i].text);
        if (must_read(files[i].name, &header, &grid)) CHECK(strcmp(header.space, files[i].space) == 0);
        ex_grid_free(&grid);
    }
    for (int placed = 0; placed < 2; ++placed) {
        write_nifti(&file, EX_U8, 0);
        put_number_at(&file, 254, placed, EX_I16, 0);
        write_file("s.nii", file.data, file.count);
        if (must_read("s.nii", &header, &grid)) CHECK(strcmp(header.space, placed ? "RAS" : "") == 0);
        ex_grid_free(&grid);
    }
}

/* The bound on memory, for every format: what is unpacked, and what is packed. */
static void test_memory(void) {
    static bytes file;
    for (int which = 0; which < FORMAT_COUNT; ++which) {
        char path[200];
        ex_volume_file header;
        ex_grid grid;
        ex_error error;
        write_format(&file, (format)which, EX_U16, 0);
        snprintf(path, sizeof path, "%s/%s", folder, format_names[which]);
        if (!CHECK(ex_volume_file_read(&header, path, &error) == 0)) continue;
        header.voxels.max_bytes = 2 * VOXELS - 1;
        CHECK(ex_grid_load(&grid, &header.voxels, &error) != 0 && strstr(error.text, "; --max-bytes allows 119"));
        header.voxels.max_bytes = FILE_MAX;
        CHECK(ex_grid_load(&grid, &header.voxels, &error) == 0);
        ex_grid_free(&grid);
    }
}

/* ----------------------------------------------------------------------------------------------------------- errors */

/* Whether a failure printed one line that begins with the folder of the test, and so with a file. */
static int is_complaint(const ex_error *error) {
    const size_t length = strlen(error->text);
    return length > strlen(folder) && strncmp(error->text, folder, strlen(folder)) == 0 &&
           is_printable(error->text, length);
}

/* Reads an arbitrary header. Either its voxels must fit its file, or an error must be printed. */
static int survives(const char *name, size_t held) {
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    int good;
    if (read_volume(name, &header, &grid, &error)) {
        good = CHECK(is_complaint(&error)) && CHECK(!grid.data && !grid.ranges);
        if (!good) printf("    %s\n", error.text);
        return 0;
    }
    CHECK(ex_grid_bytes(grid.size, grid.type) <= held);
    ex_grid_free(&grid);
    return 1;
}

/* Files truncated at any byte: one that holds its voxels has too few of them, wherever it ends. */
static void test_truncated(void) {
    static bytes file;
    for (int which = 0; which < FORMAT_COUNT; ++which) {
        char path[200];
        write_format(&file, (format)which, EX_U16, 1);
        snprintf(path, sizeof path, "%s/%s", folder, format_names[which]);
        for (size_t length = file.count; length-- > 0;) {
            if (!CHECK(truncate(path, (off_t)length) == 0)) return;
            if (survives(format_names[which], FILE_MAX) && !is_detached((format)which))
                if (!CHECK(!"read from a file that is cut off")) printf("    %s, %zu\n", format_names[which], length);
        }
    }
}

/* Changes a byte of a file in place, which is much faster than writing the file again. */
static void patch_file(const char *name, size_t at, unsigned char byte) {
    char path[200];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "r+b");
    if (!CHECK(file != NULL)) return;
    CHECK(fseek(file, (long)at, SEEK_SET) == 0 && fputc(byte, file) == byte);
    CHECK(fclose(file) == 0);
}

/* Each bit of the header flipped, and each byte replaced by characters that are special in text. */
static void test_flipped(void) {
    static const unsigned char bytes_of_note[] = {0, '\n', ' ', '-', '9', ':', '=', '(', '\'', 0xff};
    static bytes file;
    int readable = 0, broken = 0;
    for (int which = 0; which < FORMAT_COUNT; ++which) {
        write_format(&file, (format)which, EX_I16, 0);
        const size_t voxels = VOXELS * sizeof(int16_t);
        const size_t header = is_detached((format)which) || is_packed((format)which) ? file.count : file.count - voxels;
        const size_t kinds = is_packed((format)which) && !is_detached((format)which) ? 8 : 8 + sizeof bytes_of_note;
        const int repeats =
            is_packed((format)which) || which == PAIR_1 || which == PAIR_2; /* another format's header */
        for (size_t at = 0; at < header; at += repeats && !check_long() ? 3 : 1) {
            const unsigned char kept = file.data[at];
            for (size_t k = 0; k < kinds; ++k) {
                if (!check_long() && (at + k) % (check_memory_only() ? 4 : 2)) continue;
                patch_file(format_names[which], at, k < 8 ? (unsigned char)(kept ^ 1 << k) : bytes_of_note[k - 8]);
                if (survives(format_names[which], file.count > voxels ? FILE_MAX : voxels))
                    ++readable;
                else
                    ++broken;
            }
            patch_file(format_names[which], at, kept);
        }
    }
    CHECK(readable > 500 && broken > 500); /* comments, padding; sizes, names */
}

typedef struct wrong {
    const char *name, *text, *words;
} wrong;

#define NPY_HEAD "\x93NUMPY\1"

static void check_wrong(const wrong *list, size_t count) {
    for (size_t i = 0; i < count; ++i) {
        ex_volume_file header;
        ex_grid grid;
        ex_error error;
        write_text(list[i].name, list[i].text);
        CHECK(read_volume(list[i].name, &header, &grid, &error) != 0);
        if (!CHECK(is_complaint(&error)) || !CHECK(strstr(error.text, list[i].words) != NULL))
            printf("    '%s' is not in: %s\n", list[i].words, error.text);
    }
}

/* Each line names the field, and the rule that it breaks. */
static void test_wrong_nrrd(void) {
    static const wrong list[] = {
        {"w.nrrd", "", "w.nrrd: not a NRRD file"},
        {"w.nrrd", "P6 2 2 255\n", "w.nrrd: not a NRRD file"},
        {"w.nrrd", NRRD_HEAD "sizes: 2 1\n\n", "sizes: '2 1' has too few numbers"},
        {"w.nrrd", NRRD_HEAD "sizes: 2 1 1 1\n\n", "sizes: '2 1 1 1' has too many numbers"},
        {"w.nrrd", NRRD_HEAD "type: uint8\nencoding: raw\nsizes: 2 1 0\n\n",
         "sizes: '2 1 0' is not three whole numbers within 1..65536"},
        {"w.nrrd", NRRD_HEAD "type: uint8\nencoding: raw\nsizes: 2 1 65537\n\n",
         "sizes: '2 1 65537' is not three whole numbers"},
        {"w.nrrd", NRRD_HEAD "type: uint8\nencoding: raw\nsizes: 2 -1 -1\n\n",
         "sizes: '2 -1 -1' is not three whole numbers"},
        {"w.nrrd", NRRD_HEAD "sizes: nan 1 1\n\n", "sizes: 'nan 1 1' has a number out of range"},
        {"w.nrrd", NRRD_HEAD "type: int128\n\n", "type: 'int128' is not supported: only integers of up to 64"},
        {"w.nrrd", NRRD_HEAD "type: block\n\n", "type: 'block' is not supported"},
        {"w.nrrd", NRRD_HEAD "encoding: bzip2\n\n", "encoding: 'bzip2' is not supported: only raw and gzip are"},
        {"w.nrrd", NRRD_HEAD "encoding: hex\n\n", "encoding: 'hex' is not supported: only raw and gzip are"},
        {"w.nrrd", NRRD_HEAD "encoding: text\n\n", "encoding: 'text' is not supported: only raw and gzip are"},
        {"w.nrrd", NRRD_HEAD "endian: middle\n\n", "endian: 'middle' is neither little nor big"},
        {"w.nrrd", NRRD_HEAD "sizes: 1 1 1\ntype: short\nencoding: raw\n\nab", "endian: the header has no such field"},
        {"w.nrrd", NRRD_HEAD "bogus: 1\n\n", "w.nrrd: unknown field 'bogus'"},
        {"w.nrrd", NRRD_HEAD "no field at all\n\n", "w.nrrd: no field: 'no field at all'"},
        {"w.nrrd", NRRD_HEAD "space origin: (1,2,nan)\n\n", "space origin: '(1,2,nan)' has a number out of range"},
        {"w.nrrd", NRRD_HEAD "space origin: (1,2,3) 4\n\n", "space origin: '(1,2,3) 4' has too many vectors"},
        {"w.nrrd", NRRD_HEAD "byte skip: -2\n\n", "byte skip: '-2' has a number out of range"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "line skip: 9\n\nab", "w.nrrd: line skip: the file has fewer lines"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "byte skip: 1000000000000\n\nab", "w.nrrd: the file holds"},
        {"w.nrrd", NRRD_HEAD NRRD_REST, "w.nrrd: data file: there is none, and no empty line"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "\na", "size 2,1,1 and type u8 call for 2, after the first"},
        {"w.nhdr", NRRD_HEAD "data file: missing.raw\n", "w.nhdr: data file: 'missing.raw' No such file"},
        {"w.nhdr", NRRD_HEAD "data file: \n", "w.nhdr: data file: '' is not the name of a file"},
        {"w.nhdr", NRRD_HEAD "data file: LIST\na\nb\n", "w.nhdr: data file: 'LIST' is more than one file"},
        {"w.nhdr", NRRD_HEAD "data file: slice%03d.raw 1 9 1\n", "is more than one file"},
        {"w.nhdr", NRRD_HEAD NRRD_REST "data file: .\n", "not a regular file"},
        {"w.nhdr", NRRD_HEAD "data \033[31mfile: .\n", "unknown field 'data ?[31mfile'"},
        {"w.nrrd", NRRD_HEAD "type: uint8\nencoding: raw\nsizes: 65536 65536 65536\n\nab",
         "size 65536,65536,65536 and type u8 call for 281474976710656"},
        {"w.nrrd", NRRD_HEAD "type: uint8\nencoding: gzip\nsizes: 65536 65536 65536\n\nab",
         "size 65536,65536,65536 and type u8 take 281474976710656 bytes in memory; --max-bytes allows 4000000000"}};
    check_wrong(list, sizeof list / sizeof *list);
}

/* Dimensions, spacings, directions and kinds; and what is packed. */
static void test_wrong_nrrd_axes(void) {
    static const wrong list[] = {
        {"w.nrrd", "NRRD0004\n\n", "w.nrrd: dimension: the header has no such field"},
        {"w.nrrd", "NRRD0004\ndimension: 2\n\n", "w.nrrd: dimension: '2' is not supported: only 3 dimensions"},
        {"w.nrrd", "NRRD0004\ndimension: 5\n\n", "w.nrrd: dimension: '5' is not supported: only 3 dimensions"},
        {"w.nrrd", "NRRD0004\nsizes: 2 1 1\n\n", "w.nrrd: sizes: '2 1 1' comes before the dimension"},
        {"w.nrrd", "NRRD0004\nkinds: space\n\n", "w.nrrd: kinds: 'space' comes before the dimension"},
        {"w.nrrd", "NRRD0004\ndimension: 3.5\n\n", "dimension: '3.5' is not a whole number"},
        {"w.nrrd", NRRD_HEAD "dimension: 3\n\n", "dimension: '3' is a second value of this field"},
        {"w.nrrd", NRRD_HEAD NRRD_PACKED "byte skip: -1\n\nab", "w.nrrd: byte skip: -1 is not possible with gzip"},
        {"w.nrrd", NRRD_HEAD NRRD_PACKED "\nab", "w.nrrd: packed data: the end at byte 0"},
        {"w.nrrd", NRRD_HEAD NRRD_PACKED "\n", "w.nrrd: the file holds 63 bytes, but 0 packed ones begin at byte 63"},
        {"w.nrrd", NRRD_HEAD NRRD_PACKED "\n0123456789", "w.nrrd: packed data: no gzip header at byte 0"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "kinds: space space\n\nab", "kinds: 'space space' has fewer words than"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "kinds: space space space space\n\nab", "has more words than there are"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "kinds: space time space\n\nab", "kinds: 'time' is not supported"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "kinds: HSV-color space space\n\nab", "kinds: 'HSV-color' is not supported"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "kinds: list space space\n\nab", "fewer than three axes lie in space"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "space directions: none (0,1,0) (0,0,1)\n\nab", "fewer than three axes lie"},
        {"w.nrrd", COLOR_HEAD "\nabc", "dimension: 4, but neither kinds nor space directions say which"},
        {"w.nrrd", COLOR_HEAD "kinds: list vector space space\n\nabc", "fewer than three axes lie in space"},
        {"w.nrrd", COLOR_HEAD "kinds: space list space space\n\nabc", "has components between its axes"},
        {"w.nrrd", COLOR_HEAD "kinds: space space space list\n\nabc",
         "sizes: '3 1 1 2' is not supported: only 1 and 3"},
        {"w.nrrd", COLOR_HEAD "kinds: RGB-color space space space\n\nabcdef", "w.nrrd: 3 numbers per voxel are colors"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "spacings: 1 2 3\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\nab",
         "spacings: axis 0 has a space direction, too"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "spacings: nan nan 3\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\nab",
         "spacings: axis 2 has a space direction, too"},
        {"w.nrrd", NRRD_HEAD "spacings: 1 2\n\n", "spacings: '1 2' has too few numbers"},
        {"w.nrrd", NRRD_HEAD "spacings: 1 2 3 4\n\n", "spacings: '1 2 3 4' has too many numbers"},
        {"w.nrrd", NRRD_HEAD "spacings: 1 0 1\n\n", "spacings: '1 0 1' has a 0"},
        {"w.nrrd", NRRD_HEAD "spacings: 1 1e16 1\n\n", "spacings: '1 1e16 1' has a number out of range"},
        {"w.nrrd", NRRD_HEAD "space directions: (1,0,0) (0,1,0)\n\n", "space directions: '(1,0,0) (0,1,0)' is not (x"},
        {"w.nrrd", NRRD_HEAD "space directions: nones (1,0,0) (0,1,0)\n\n", "'nones (1,0,0) (0,1,0)' is not (x"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "space directions: (1,0,0) (0,1,0) (1,1,0)\n\nab",
         "space directions: the three axes lie in one plane"},
        {"w.nrrd", NRRD_HEAD NRRD_REST "space directions: (1e15,0,0) (0,1,0) (0,0,1)\n\nab",
         "space directions: the volume's edges are not within 1e15"},
        {"w.nrrd", NRRD_HEAD "axis mins: 0 0 0\n\n", "axis mins: '0 0 0' is not supported: only spacings"}};
    check_wrong(list, sizeof list / sizeof *list);
}

static void test_wrong_meta_and_npy(void) {
    static const wrong list[] = {
        {"w.mha", "", "w.mha: NDims: the header has no such field"},
        {"w.mha", "ObjectType = Mesh\n", "w.mha: ObjectType: 'Mesh' is not supported: only Image is"},
        {"w.mha", "NDims = 2\n", "NDims: '2' is not supported: only 3 dimensions"},
        {"w.mha", "DimSize = 2 1 x\n", "DimSize: '2 1 x' has too few numbers"},
        {"w.mha", "ElementType = MET_LONG\n", "ElementType: 'MET_LONG' is not supported"},
        {"w.mha", "CompressedDataSize = 0\n", "CompressedDataSize: '0' has a number out of range"},
        {"w.mha", "ElementSize = 1 0 1\n", "ElementSize: '1 0 1' has a 0"},
        {"w.mha", "ElementToIntensityFunctionSlope = 0\n",
         "ElementToIntensityFunctionSlope: '0' makes all voxels equal"},
        {"w.mha", "ElementToIntensityFunctionOffset = x\n",
         "ElementToIntensityFunctionOffset: 'x' has too few numbers"},
        {"w.mha", META_HEAD "CompressedData = True\nHeaderSize = -1\nElementDataFile = LOCAL\nab",
         "HeaderSize: -1 is not possible with compressed voxels"},
        {"w.mha", META_HEAD "CompressedData = True\nElementDataFile = LOCAL\nab",
         "packed data: no zlib header at byte 0"},
        {"w.mha", META_HEAD "CompressedData = True\nCompressedDataSize = 9\nElementDataFile = LOCAL\nab",
         "but 9 packed ones begin at byte 1"},
        {"w.mha", "CompressedData = perhaps\n", "CompressedData: 'perhaps' is neither True nor False"},
        {"w.mha", "BinaryData = False\n", "BinaryData: 'False' means text"},
        {"w.mha", "ElementByteOrderMSB = 1\n", "ElementByteOrderMSB: '1' is neither True nor False"},
        {"w.mha", "ElementNumberOfChannels = 2\n", "ElementNumberOfChannels: '2' is not supported: only 1 and 3"},
        {"w.mha", "ElementSpacing = 1 1 0\n", "ElementSpacing: '1 1 0' has a 0"},
        {"w.mha", "TransformMatrix = 1 0 0 0 1 0 0 0\n", "TransformMatrix: '1 0 0 0 1 0 0 0' has too few numbers"},
        {"w.mha", "Offset = 0 0 1e16\n", "Offset: '0 0 1e16' has a number out of range"},
        {"w.mha", "what is this\n", "w.mha: no field: 'what is this'"},
        {"w.mha", META_HEAD, "w.mha: ElementDataFile: the header has no such field"},
        {"w.mha", META_HEAD "TransformMatrix = 1 0 0 0 1 0 0 1 0\nElementDataFile = LOCAL\nab",
         "TransformMatrix: the three axes lie in one plane"},
        {"w.mha", META_HEAD "ElementDataFile = LOCAL\na", "size 2,1,1 and type u8 call for 2"},
        {"w.mha", META_HEAD "HeaderSize = 0.5\nElementDataFile = LOCAL\nab", "HeaderSize: '0.5' is not a whole number"},
        {"w.mhd", META_HEAD "ElementDataFile = LIST\na.raw\n", "w.mhd: ElementDataFile: 'LIST' is more than one file"},
        {"w.mhd", META_HEAD "ElementDataFile = missing.raw\n", "w.mhd: ElementDataFile: 'missing.raw' No such file"},
        {"w.npy", "", "w.npy: not an NPY file: it does not start with \\x93NUMPY"},
        {"w.npy", "\x93NUMPY\4\1aaaaaaa", "w.npy: version 4 is not supported"},
        {"w.npy", NPY_HEAD "\1\377\377{   }", "w.npy: header length: 65535 bytes, but the file has only"},
        {"w.npy",
         NPY_HEAD "\1\2\1"
                  "no dictionary",
         "w.npy: header length"},
        {"w.nii", "", "w.nii: only 0 bytes, but the header has 348 or 540"},
        {"w.nii.gz", "\x1f\x8b", "w.nii.gz: packed data: the end at byte 0"},
        {"w.npz", "PK", "w.npz: not a zip file: it has no list of members"},
        {"w.nrrd.gz", "\x1f\x8b", "w.nrrd.gz: compressed files are not supported: gunzip it first"}};
    check_wrong(list, sizeof list / sizeof *list);
}

/* Dictionaries that a NPY file may not have, and one that it may. */
static void test_wrong_npy_dictionary(void) {
    static const struct {
        const char *dictionary, *words; /* NULL: good */
    } list[] = {{"{\"shape\":(1,1,2),'descr':'|u1', 'fortran_order':False}", NULL},
                {"(1, 2)", "the header is not a dictionary"},
                {"{}", "descr: the header has no such field"},
                {"{'descr': '|u1', 'fortran_order': False}", "shape: the header has no such field"},
                {"{'descr': '|u1', 'descr': '|u1'}", "descr: ''|u1'' is a second value of this field"},
                {"{'descr': '<u16'}", "descr: 'u16' is not supported"},
                {"{'descr': '|b2'}", "descr: 'b2' is not supported"},
                {"{'descr': 'u2'}", "descr: 'u2' has no byte order"},
                {"{'descr': [('r', '|u1')]}", "descr: '[('r', '|u1')]' is not supported"},
                {"{'descr': '|u1}", "descr: ''|u1' is not supported"},
                {"{'descr': '|u1'", "the header's dictionary is cut off or malformed"},
                {"{'fortran_order': 0}", "fortran_order: '0' is neither True nor False"},
                {"{'shape': (1, 2)}", "shape: '(1, 2)' is not (z, y, x) or (z, y, x, 3): only 3 dimensions"},
                {"{'shape': (1, 2, 3, 4)}", "shape: '(1, 2, 3, 4)' is not supported: only 1 and 3 numbers"},
                {"{'shape': (1, 2, 3, 4, 5)}", "shape: '(1, 2, 3, 4, 5)' is not (z, y, x)"},
                {"{'shape':(1,1,1,3),'descr':'|u1', 'fortran_order':True}", "fortran_order: colors are supported in C"},
                {"{'shape': (1, 2, 0)}", "shape: '(1, 2, 0)' is not three whole numbers"},
                {"{'shape': (1, 2, 3}", "the header's dictionary is cut off or malformed"},
                {"{'color': 1}", "unknown field 'color'"},
                {"{descr: 1}", "the header's dictionary is cut off or malformed"}};
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    for (size_t i = 0; i < sizeof list / sizeof *list; ++i) {
        file.count = 0;
        put(&file, NPY_HEAD "\0", 8);
        put_number(&file, (double)strlen(list[i].dictionary), EX_U16, 0);
        put_text(&file, list[i].dictionary);
        put_text(&file, "ab");
        write_file("w.npy", file.data, file.count);
        CHECK((read_volume("w.npy", &header, &grid, &error) != 0) == (list[i].words != NULL));
        if (list[i].words && (!CHECK(is_complaint(&error)) || !CHECK(strstr(error.text, list[i].words) != NULL)))
            printf("    '%s' is not in: %s\n", list[i].words, error.text);
        ex_grid_free(&grid);
    }
    file.count = 0; /* one byte more than there is */
    put(&file, NPY_HEAD "\0\6\0{'a'}", 15);
    write_file("w.npy", file.data, file.count);
    CHECK(read_volume("w.npy", &header, &grid, &error) != 0);
    CHECK(strstr(error.text, "w.npy: header length: 6 bytes, but the file has only 5") != NULL);
}

/* An invalid number in a NIfTI header, at its offset. */
static void test_wrong_nifti(void) {
    static const struct {
        size_t at;
        double number;
        ex_type type;
        const char *words;
    } list[] = {{0, 541, EX_I32, "sizeof_hdr: not the 348"},
                {40, 2, EX_I16, "dim[0]: 2 dimensions are not supported"},
                {40, 8, EX_I16, "dim[0]: 8 dimensions are not supported"},
                {42, 0, EX_I16, "dim: '0 4 5' is not three whole numbers"},
                {46, -5, EX_I16, "dim: '3 4 -5' is not three whole numbers"},
                {46, 6, EX_I16, "size 3,4,6 and type u8 call for 72, after the first 352"},
                {70, 2304, EX_I16, "datatype: '2304' is not supported"},
                {72, 16, EX_I16, "bitpix: 16 does not match the datatype"},
                {108, 348, EX_F32, "vox_offset: 348 is not a whole number from 352 on"},
                {108, 1e30, EX_F32, "vox_offset: 1e+30 is not a whole number"},
                {108, 353, EX_F32, "call for 60, after the first 353"},
                {280, 1e18, EX_F32, "srow: the volume's edges are not within 1e15"},
                {296, 0, EX_F32, "srow: the three axes lie in one plane"},
                {292, 1e16, EX_F32, "srow: 1e+16 is out of range"},
                {344, 'x', EX_U8, "magic: 'x+1' is not that of a file with header and voxels"}};
    static const double no_scale[2] = {2, 0};
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    for (size_t i = 0; i < sizeof list / sizeof *list; ++i) {
        write_nifti(&file, EX_U8, 0);
        put_number_at(&file, list[i].at, list[i].number, list[i].type, 0);
        write_file("w.nii", file.data, file.count);
        CHECK(read_volume("w.nii", &header, &grid, &error) != 0);
        if (!CHECK(is_complaint(&error)) || !CHECK(strstr(error.text, list[i].words) != NULL))
            printf("    '%s' is not in: %s\n", list[i].words, error.text);
    }
    write_nifti(&file, EX_U8, 0);
    put_number_at(&file, 40, 4, EX_I16, 0);
    put_number_at(&file, 48, 2, EX_I16, 0); /* a series of two */
    write_file("w.nii", file.data, file.count);
    CHECK(read_volume("w.nii", &header, &grid, &error) != 0 && strstr(error.text, "dim: 2 along a fourth axis"));
    write_two("w.nii", EX_U8, 1, 2, no_scale);
    if (must_read("w.nii", &header, &grid)) CHECK(header.voxels.slope == 2);
    ex_grid_free(&grid);
}

/* Pairs, NIfTI-2 and packed ones. */
static void test_wrong_nifti_files(void) {
    static const struct {
        const char *name, *magic, *words; /* magic NULL: Analyze 7.5 */
        int version;
    } list[] = {{"w.hdr", "n+1", "magic: 'n+1' says that the voxels are in the same file", 1},
                {"w.hdr", "ni1", "w.img: No such file", 1},
                {"w.hdr", NULL, "magic: '' is not that of NIfTI; Analyze 7.5 is not supported", 1},
                {"w.nii", "ni1", "magic: 'ni1' is not that of a file with header and voxels", 1},
                {"w.nii", "ni2", "magic: 'ni2' is not that of a file with header and voxels", 2},
                {"w.hdr", "n+2", "magic: 'n+2' says that the voxels are in the same file", 2},
                {"w.hdr", "ni2", "w.img: No such file", 2}};
    static bytes file;
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    for (size_t i = 0; i < sizeof list / sizeof *list; ++i) {
        const int is_first = list[i].version == 1;
        if (is_first)
            write_nifti(&file, EX_U8, 0);
        else
            write_nifti_2(&file, EX_U8, 0);
        memset(file.data + (is_first ? 344 : 4), 0, 4);
        if (list[i].magic) memcpy(file.data + (is_first ? 344 : 4), list[i].magic, 4);
        write_file(list[i].name, file.data, file.count);
        CHECK(read_volume(list[i].name, &header, &grid, &error) != 0);
        if (!CHECK(is_complaint(&error)) || !CHECK(strstr(error.text, list[i].words) != NULL))
            printf("    '%s' is not in: %s\n", list[i].words, error.text);
    }
    write_nifti_2(&file, EX_U8, 0);
    write_file("w.nii", file.data, 541);
    CHECK(read_volume("w.nii", &header, &grid, &error) != 0 &&
          strstr(error.text, "only 541 bytes, but the header has 544"));
    put_number_at(&file, 24, 1e10, EX_I64, 0); /* dim[1] */
    write_file("w.nii", file.data, file.count);
    CHECK(read_volume("w.nii", &header, &grid, &error) != 0 &&
          strstr(error.text, "dim: '1e+10 4 5' is not three whole"));
    write_nifti_2(&file, EX_U8, 0);
    put_number_at(&file, 176, 2, EX_F64, 0), put_number_at(&file, 184, -3, EX_F64, 0);
    write_file("w.nii", file.data, file.count);
    if (must_read("w.nii", &header, &grid)) CHECK(header.voxels.slope == 2 && header.voxels.intercept == -3);
    ex_grid_free(&grid);
    write_nifti_2(&file, EX_U8, 0);
    put_number_at(&file, 168, 543, EX_I64, 0);
    write_file("w.nii", file.data, file.count);
    CHECK(read_volume("w.nii", &header, &grid, &error) != 0 &&
          strstr(error.text, "543 is not a whole number from 544 on"));
}

static void check_zip(const unsigned char *data, size_t size, const char *words) {
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    write_file("w.npz", data, size);
    CHECK(read_volume("w.npz", &header, &grid, &error) != 0);
    if (!CHECK(is_complaint(&error)) || !CHECK(strstr(error.text, words) != NULL))
        printf("    '%s' is not in: %s\n", words, error.text);
}

/* A zip file with a number changed, and what is said then. Offsets count from the end for the last record, and from its
   entry in the list for a member. */
static void test_wrong_zip(void) {
    static const struct {
        int in_list; /* 1: an entry of the list, 0: the last record, 2: the member's own header */
        size_t at;
        double number;
        ex_type type;
        const char *words;
    } list[] = {{0, 16, 4294967295.0, EX_U32, "zip64, which is not supported"},
                {0, 10, 65535, EX_U16, "zip64, which is not supported"},
                {0, 4, 1, EX_U16, "an archive in several parts is not supported"},
                {0, 12, 4000, EX_U32, "the list of members is not in the file"},
                {0, 16, 1, EX_U32, "the list of members is cut off or malformed"},
                {0, 10, 2, EX_U16, "the list of members is cut off or malformed"},
                {0, 10, 0, EX_U16, "there is no .npy in it"},
                {1, 8, 1, EX_U16, "'a.npy' is encrypted"},
                {1, 10, 12, EX_U16, "'a.npy' is packed by method 12; only deflate"},
                {1, 24, 4294967295.0, EX_U32, "'a.npy' is zip64"},
                {1, 28, 300, EX_U16, "the list of members is cut off or malformed"},
                {1, 42, 1, EX_U32, "byte 1: no member begins here"},
                {1, 42, 99999, EX_U32, "byte 99999: a member is not in the file"},
                {1, 20, 99999, EX_U32, "byte 0: a member is not in the file"},
                {1, 16, 7, EX_U32, "the data from byte 39 on have a wrong checksum"},
                {1, 24, 9, EX_U32, "call for 60, after the first 128"},
                {2, 26, 60000, EX_U16, "byte 0: a member is not in the file"}};
    static bytes file, plain;
    ex_volume_file header;
    ex_grid grid;
    ex_error error;
    char path[200];
    write_npy(&plain, EX_U8, 0, 1, 0);
    for (size_t i = 0; i < sizeof list / sizeof *list; ++i) {
        const zip_member member = {"a.npy", plain.data, plain.count, 8};
        file.count = zip_all(&member, 1, file.data, FILE_MAX);
        const size_t last = file.count - 22, entry = last - 46 - strlen(member.name);
        put_number_at(&file,
                      (list[i].in_list == 0   ? last
                       : list[i].in_list == 1 ? entry
                                              : 0) +
                          list[i].at,
                      list[i].number, list[i].type, 0);
        check_zip(file.data, file.count, list[i].words);
    }
    const zip_member three[3] = {{"a.npy", plain.data, plain.count, 8}, {"b.npy", "no array", 8, 0}, {"c", "", 0, 0}};
    file.count = zip_all(three, 3, file.data, FILE_MAX);
    check_zip(file.data, file.count, "it has 2 arrays instead of one: a b");
    snprintf(path, sizeof path, "%s/w.npz", folder);
    CHECK(ex_volume_file_read_array(&header, path, "c", &error) != 0 &&
          strstr(error.text, "'c' is not in it; there are a b"));
    CHECK(ex_volume_file_read_array(&header, path, "b", &error) != 0 && strstr(error.text, "not an NPY file"));
    CHECK(ex_volume_file_read_array(&header, path, "a.npy", &error) == 0);
    if (CHECK(ex_volume_file_read_array(&header, path, "a", &error) == 0) &&
        CHECK(ex_grid_load(&grid, &header.voxels, &error) == 0)) {
        CHECK(has_numbers(&grid, EX_U8));
        ex_grid_free(&grid);
    }
}

/* ----------------------------------------------------------------------------------------------------- build/render */

#define LOOK "--extinction 4 --light directional,1,-1,-1,9,9,9 --width 20 --height 15 --scattering single "

/* One scan, raw with everything in options, and with a header: the same bits. */
static void test_pictures(void) {
    static const char *const ways[] = {"--volume a.nrrd ", "--volume a.nhdr ",
                                       "--volume a.mha ",  "--volume a.mhd ",
                                       "--volume a.nii ",  "--volume a.npy ",
                                       "--volume d.npy ",  "--size 3,4,5 --volume wrong.mhd ",
                                       "--volume b.nrrd ", "--volume a.nii.gz ",
                                       "--volume b.mhd ",  "--volume b.hdr ",
                                       "--volume b.npz ",  "--volume two.npz --grid density "};
    static char raw[FILE_MAX], other[FILE_MAX];
    static unsigned char packed[FILE_MAX];
    static bytes file;
    char options[500];
    for (int which = 0; which < FORMAT_COUNT; ++which) write_format(&file, (format)which, EX_U16, 0);
    write_npy(&file, EX_U16, 0, 1, 0);
    const zip_member arrays[2] = {{"other.npy", "no array", 8, 0}, {"density.npy", file.data, file.count, 8}};
    write_file("two.npz", packed, zip_all(arrays, 2, packed, sizeof packed));
    write_text("wrong.mhd", "NDims = 3\nDimSize = 9 9 9\nElementType = MET_USHORT\nElementDataFile = a.raw\n");
    snprintf(options, sizeof options, "--volume a.raw --size 3,4,5 --type u16 --box 0,0,0,2,1,3 " LOOK "--pfm raw.pfm");
    CHECK(run_render(options).status == 0);
    CHECK(read_file("raw.pfm", raw, sizeof raw) > 12 * 20 * 15);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; ++i) {
        snprintf(options, sizeof options, "%s --box 0,0,0,2,1,3 " LOOK "--pfm other.pfm", ways[i]);
        const outcome got = run_render(options);
        memset(other, 0, sizeof other);
        if (!CHECK(got.status == 0) || !CHECK(read_file("other.pfm", other, sizeof other) > 12 * 20 * 15) ||
            !CHECK(memcmp(raw, other, sizeof raw) == 0))
            printf("    render %s\n    %s\n", options, got.said);
    }
}

/* Placed by the header: the same picture from two formats, different from that of a default box; the default camera
   sees all of it. */
static void test_placed_pictures(void) {
    static char pictures[3][FILE_MAX];
    static const char *const ways[3] = {"--volume a.nrrd ", "--volume a.nii ", "--box 0,0,0,1,1,1 --volume a.nii "};
    char options[500];
    for (int i = 0; i < 3; ++i) {
        snprintf(options, sizeof options, "%s" LOOK "--alpha-pfm a.pfm", ways[i]);
        CHECK(run_render(options).status == 0);
        CHECK(read_file("a.pfm", pictures[i], sizeof pictures[i]) > 4 * 20 * 15);
    }
    CHECK(memcmp(pictures[0], pictures[1], sizeof pictures[0]) == 0);
    CHECK(memcmp(pictures[0], pictures[2], sizeof pictures[0]) != 0);
    const char *pixels = strstr(pictures[0], "-1.0\n");
    double sum = 0, rim = 0;
    if (!CHECK(pixels != NULL)) return;
    for (int i = 0; i < 20 * 15; ++i) {
        float coverage;
        memcpy(&coverage, pixels + 5 + 4 * i, sizeof coverage);
        sum += (double)coverage;
        if (i < 20 || i >= 20 * 14 || i % 20 == 0 || i % 20 == 19) rim += (double)coverage;
    }
    CHECK(sum > 10 && rim < 1e-3 * sum); /* of 300 pixels */
}

/* A NaN ends the render, or counts as 0: the picture is that of a file with a 0 there. */
static void test_replaced(void) {
    static const char *const names[] = {"--replace-invalid --volume nan.npy ", "--volume zero.npy "};
    static char pictures[2][FILE_MAX];
    for (int i = 0; i < 2; ++i) {
        static bytes file;
        char options[500];
        write_npy(&file, EX_F32, 0, 1, 0);
        put_number_at(&file, file.count - 4 * 31, i ? 0 : (double)NAN, EX_F32, 0);
        put_number_at(&file, file.count - 4 * 30, i ? 0 : HUGE_VAL, EX_F32, 0);
        write_file(i ? "zero.npy" : "nan.npy", file.data, file.count);
        snprintf(options, sizeof options, "%s" LOOK "--pfm other.pfm", names[i]);
        CHECK(run_render(options).status == 0);
        CHECK(read_file("other.pfm", pictures[i], sizeof pictures[i]) > 12 * 20 * 15);
    }
    CHECK(memcmp(pictures[0], pictures[1], sizeof pictures[0]) == 0);
    CHECK(run_render("--volume nan.npy " LOOK "--pfm other.pfm").status == 2);
}

static void test_complaints(void) {
    static const complaint list[] = {
        {"--volume a.nrrd --plan >plan", 0, NULL},
        {"--volume a.nrrd --size 3,4,6 --plan", 2, "size 3,4,6 and type u16 call for 144"},
        {"--volume a.nrrd --type f64 --plan", 2, "size 3,4,5 and type f64 call for 480"},
        {"--volume a.nrrd --type u8 --range 0,9 --plan >plan", 0, NULL},
        {"--volume a.nrrd --range 9,9 --plan", 2, "--range: '9,9' will not do: both ends are the same"},
        {"--volume a.raw --plan", 2, "--volume a.raw has no --size"},
        {"--volume a.mhd --out a.raw", 2, "--out a.raw is a file that --volume reads"},
        {"--volume none.nrrd --plan", 2, "none.nrrd: No such file"},
        {"--volume broken.nrrd --plan", 2, "broken.nrrd: encoding: 'bzip2' is not supported: only raw and gzip are"},
        {"--volume a.nrrd --max-bytes 119 --plan", 2, "take 120 bytes in memory; --max-bytes allows 119"},
        {"--volume a.nrrd --max-bytes 120 --plan >plan", 0, NULL},
        {"--max-bytes 0 --plan", 2, "--max-bytes: '0' is out of range"},
        {"--volume a.nrrd --volume a.nii --plan >plan", 0, "a.nrrd are LPS, those of "},
        {"--volume a.nrrd --volume a.mha --volume a.npy --plan >plan", 0, NULL},
        {"--volume a.nrrd --volume a.nii --box 0,0,0,1,1,1 --plan >plan", 0, NULL},
        {"--volume color.nrrd --plan", 2, "are colors, for --albedo-volume or --emission-volume"},
        {"--volume a.NRRD.gz --plan", 2, "a.NRRD.gz: No such file"},
        {"--volume a.nrrd --transfer high.txt --plan", 2, "u16 voxels stand for 0..1"},
        {"--volume f.nrrd --transfer high.txt --plan >plan", 0, NULL},
        {"--volume f.nrrd --range 0,1 --transfer high.txt --plan", 2, "f32 voxels stand for 0..1"}};
    static bytes file;
    write_nrrd(&file, EX_F32, 0, "raw", NULL);
    write_file("f.nrrd", file.data, file.count);
    write_text("broken.nrrd", NRRD_HEAD "encoding: bzip2\n\n");
    write_text("color.nrrd", COLOR_HEAD "kinds: RGB-color space space space\n\nabcdef");
    write_text("high.txt", "0 1 1 1 0\n70 1 1 1 0\n90 1 1 1 9\n");
    CHECK_COMPLAINTS(list);
}

static void test_render(void) {
    if (!render_is_built()) {
        printf("skipped: pictures of files: make build/tests/render\n");
        return;
    }
    test_pictures();
    test_placed_pictures();
    test_replaced();
    test_complaints();
}

/* Scans with headers, if there are any in SPLATSHADOW_DATA. */
static void test_real_scans(void) {
    const char *data = getenv("SPLATSHADOW_DATA");
    DIR *list = data ? opendir(data) : NULL;
    int count = 0;
    if (!list) return;
    for (struct dirent *entry; (entry = readdir(list)) != NULL;) {
        char path[4096];
        ex_volume_file header;
        ex_grid grid;
        ex_error error;
        if (!ex_volume_format_of(entry->d_name)) continue;
        snprintf(path, sizeof path, "%.2000s/%.1000s", data, entry->d_name);
        ++count;
        if (!CHECK(!ex_volume_file_read(&header, path, &error) && !ex_grid_load(&grid, &header.voxels, &error)))
            printf("    %s\n", error.text);
        else
            ex_grid_free(&grid);
    }
    closedir(list);
    if (count == 0) printf("skipped: real scans: no file in SPLATSHADOW_DATA has a header\n");
}

int main(void) {
    if (!CHECK(folder_begin())) return check_report();
    RUN(test_every_type);
    RUN(test_placement_of_box);
    RUN(test_nifti_placement);
    RUN(test_spacing);
    RUN(test_skipping);
    RUN(test_packed_skipping);
    RUN(test_values);
    RUN(test_scaled_meta);
    RUN(test_colors);
    RUN(test_no_colors);
    RUN(test_other_types);
    RUN(test_spaces);
    RUN(test_memory);
    RUN(test_ranges_of_blocks);
    RUN(test_truncated);
    RUN(test_flipped);
    RUN(test_wrong_nrrd);
    RUN(test_wrong_nrrd_axes);
    RUN(test_wrong_meta_and_npy);
    RUN(test_wrong_npy_dictionary);
    RUN(test_wrong_nifti);
    RUN(test_wrong_nifti_files);
    RUN(test_wrong_zip);
    RUN(test_render);
    RUN(test_real_scans);
    folder_end();
    return check_report();
}
