/* volume_file.h: reads the headers of NRRD, MetaImage, NIfTI-1 and NPY files: how many voxels there are, their type,
   where they are stored, and where they lie in the world. ex_grid_load of volume.h then reads the voxels.

   Supported are three dimensions and one number per voxel, stored as in memory: not compressed, not as text. World
   coordinates are those of the file; no patient coordinate system (LPS, RAS) is converted to another.

   The formats are described at https://teem.sourceforge.net/nrrd/format.html, https://itk.org/Wiki/MetaIO,
   https://nifti.nimh.nih.gov/nifti-1 and https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html. */

#ifndef EX_VOLUME_FILE_H
#define EX_VOLUME_FILE_H

#include "volume_header.h"

/* -------------------------------------------------------------------------------------------------- NRRD */

/* clang-format off */
static const ex_header_type ex_nrrd_types[] = {
    {"signed char", EX_I8}, {"int8", EX_I8}, {"int8_t", EX_I8}, {"uchar", EX_U8}, {"unsigned char", EX_U8},
    {"uint8", EX_U8}, {"uint8_t", EX_U8}, {"short", EX_I16}, {"short int", EX_I16}, {"signed short", EX_I16},
    {"signed short int", EX_I16}, {"int16", EX_I16}, {"int16_t", EX_I16}, {"ushort", EX_U16},
    {"unsigned short", EX_U16}, {"unsigned short int", EX_U16}, {"uint16", EX_U16}, {"uint16_t", EX_U16},
    {"int", EX_I32}, {"signed int", EX_I32}, {"int32", EX_I32}, {"int32_t", EX_I32}, {"uint", EX_U32},
    {"unsigned int", EX_U32}, {"uint32", EX_U32}, {"uint32_t", EX_U32}, {"float", EX_F32}, {"double", EX_F64},
    {NULL, EX_U8}};
/* clang-format on */

static inline int ex_nrrd_type(ex_header *header, const char *field, char *value) {
    return ex_header_set_type(header, field, value, ex_nrrd_types);
}

static inline int ex_nrrd_encoding(ex_header *header, const char *field, char *value) {
    return strcasecmp(value, "raw") == 0 ? 0 : ex_header_fail(header, field, value, "is not supported: only raw is");
}

static inline int ex_nrrd_endian(ex_header *header, const char *field, char *value) {
    header->file->voxels.big_endian = strcasecmp(value, "big") == 0;
    if (header->file->voxels.big_endian || strcasecmp(value, "little") == 0) return 0;
    return ex_header_fail(header, field, value, "is neither little nor big");
}

/* Parses `count` vectors: (x,y,z) (x,y,z). */
static inline int ex_nrrd_vectors(const ex_header *header, const char *field, const char *value, int count,
                                  double (*out)[3]) {
    const char *at = value;
    for (int i = 0; i < count; ++i) {
        int length = 0;
        const int got = sscanf(at, " ( %lf , %lf , %lf )%n", &out[i][0], &out[i][1], &out[i][2], &length);
        if (got != 3 || length == 0) return ex_header_fail(header, field, value, "is not (x,y,z) for each vector");
        for (int k = 0; k < 3; ++k)
            if (!(fabs(out[i][k]) <= EX_COORDINATE_MAX))
                return ex_header_fail(header, field, value, "has a number out of range");
        at += length;
    }
    return *at ? ex_header_fail(header, field, value, "has too many vectors, or something else") : 0;
}

static inline int ex_nrrd_directions(ex_header *header, const char *field, char *value) {
    header->placed_by = field;
    return ex_nrrd_vectors(header, field, value, 3, header->direction);
}

static inline int ex_nrrd_origin(ex_header *header, const char *field, char *value) {
    return ex_nrrd_vectors(header, field, value, 1, &header->file->origin);
}

static inline int ex_nrrd_lines_to_skip(ex_header *header, const char *field, char *value) {
    double lines;
    if (ex_header_integer(header, field, value, 0, 1e6, &lines)) return 1;
    header->lines_to_skip = (int)lines;
    return 0;
}

/* The ends of the axes are an old way to specify the spacing. Refused, so that the spacing is not silently wrong. */
static inline int ex_nrrd_axis_ends(ex_header *header, const char *field, char *value) {
    return ex_header_fail(header, field, value, "is not supported: only spacings and space directions are");
}

/* clang-format off */
static const ex_header_field ex_nrrd_fields[] = {
    {"dimension", ex_header_dimension, 1},
    {"sizes", ex_header_size, 1},
    {"type", ex_nrrd_type, 1},
    {"encoding", ex_nrrd_encoding, 1},
    {"endian", ex_nrrd_endian, 0},
    {"spacings", ex_header_spacing, 0},
    {"space directions", ex_nrrd_directions, 0},
    {"space origin", ex_nrrd_origin, 0},
    {"space dimension", ex_header_dimension, 0},
    {"data file", ex_header_data_file, 0},
    {"line skip", ex_nrrd_lines_to_skip, 0},
    {"byte skip", ex_header_bytes_to_skip, 0},
    {"axis mins", ex_nrrd_axis_ends, 0},
    {"axis maxs", ex_nrrd_axis_ends, 0},
    {"space", NULL, 0}, {"space units", NULL, 0}, {"measurement frame", NULL, 0}, {"thicknesses", NULL, 0},
    {"centers", NULL, 0}, {"centerings", NULL, 0}, {"kinds", NULL, 0}, {"labels", NULL, 0}, {"units", NULL, 0},
    {"sample units", NULL, 0}, {"content", NULL, 0}, {"number", NULL, 0}, {"block size", NULL, 0},
    {"min", NULL, 0}, {"max", NULL, 0}, {"old min", NULL, 0}, {"old max", NULL, 0},
    {NULL, NULL, 0}};
/* clang-format on */

/* Reads `field: value`. Comments and `key:=value`, which any program may add, are skipped. */
static inline int ex_nrrd_line(ex_header *header, char *line) {
    int known;
    char *colon = strchr(line, ':');
    if (line[0] == '#' || (colon && colon[1] == '=')) return 0;
    if (!colon) return ex_fail(header->error, "%s: no field: '%s'", header->path, ex_quoted(line).text);
    *colon = '\0';
    if (ex_header_read_field(header, ex_nrrd_fields, line, ex_trim(colon + 1), &known)) return 1;
    return known ? 0 : ex_fail(header->error, "%s: unknown field '%s'", header->path, ex_quoted(line).text);
}

/* Moves the offset of the voxels past the header and the lines to skip. */
static inline int ex_nrrd_skip_lines(ex_header *header) {
    ex_voxel_file *voxels = &header->file->voxels;
    uint64_t held;
    uint64_t from = header->detached ? 0 : header->end;
    FILE *file = ex_open(voxels->path, &held, header->error);
    if (!file) return 1;
    int failed = fseeko(file, (off_t)from, SEEK_SET) != 0;
    for (int lines = header->lines_to_skip; lines > 0 && !failed; ++from) {
        const int byte = fgetc(file);
        lines -= byte == '\n';
        failed = byte == EOF;
    }
    fclose(file);
    if (failed) return ex_fail(header->error, "%s: line skip: the file has fewer lines", voxels->path);
    voxels->offset += from;
    return 0;
}

/* The fields end at an empty line. The voxels follow, unless a data file is named. */
static inline int ex_nrrd_read(ex_header *header, char *text, size_t length) {
    char *rest = text, *line = ex_next_line(&rest, text + length);
    if (!line || strncmp(line, "NRRD000", 7) != 0)
        return ex_fail(header->error, "%s: not a NRRD file: it does not start with NRRD000", header->path);
    while ((line = ex_next_line(&rest, text + length)) != NULL && *(line = ex_trim(line)))
        if (ex_nrrd_line(header, line)) return 1;
    header->end = (size_t)(rest - text);
    if (ex_header_check_required(header, ex_nrrd_fields)) return 1;
    if (!header->detached && !line)
        return ex_fail(header->error, "%s: data file: there is none, and no empty line ends the header", header->path);
    if (ex_type_size(header->file->voxels.type) > 1 && !ex_header_has(header, ex_nrrd_fields, "endian"))
        return ex_fail(header->error, "%s: endian: the header has no such field", header->path);
    return ex_nrrd_skip_lines(header);
}

/* --------------------------------------------------------------------------------------------- MetaImage */

static const ex_header_type ex_meta_types[] = {{"MET_CHAR", EX_I8},    {"MET_UCHAR", EX_U8},   {"MET_SHORT", EX_I16},
                                               {"MET_USHORT", EX_U16}, {"MET_INT", EX_I32},    {"MET_UINT", EX_U32},
                                               {"MET_FLOAT", EX_F32},  {"MET_DOUBLE", EX_F64}, {NULL, EX_U8}};

static inline int ex_meta_type(ex_header *header, const char *field, char *value) {
    return ex_header_set_type(header, field, value, ex_meta_types);
}

static inline int ex_meta_object(ex_header *header, const char *field, char *value) {
    return strcmp(value, "Image") == 0 ? 0 : ex_header_fail(header, field, value, "is not supported: only Image is");
}

static inline int ex_meta_bool(const ex_header *header, const char *field, const char *value, int *out) {
    *out = strcasecmp(value, "True") == 0;
    if (*out || strcasecmp(value, "False") == 0) return 0;
    return ex_header_fail(header, field, value, "is neither True nor False");
}

static inline int ex_meta_binary(ex_header *header, const char *field, char *value) {
    int binary;
    if (ex_meta_bool(header, field, value, &binary)) return 1;
    return binary ? 0 : ex_header_fail(header, field, value, "means text, which is not supported");
}

static inline int ex_meta_compressed(ex_header *header, const char *field, char *value) {
    int compressed;
    if (ex_meta_bool(header, field, value, &compressed)) return 1;
    return compressed ? ex_header_fail(header, field, value, "is not supported: only uncompressed voxels are") : 0;
}

static inline int ex_meta_byte_order(ex_header *header, const char *field, char *value) {
    return ex_meta_bool(header, field, value, &header->file->voxels.big_endian);
}

static inline int ex_meta_channels(ex_header *header, const char *field, char *value) {
    double channels;
    if (ex_header_integer(header, field, value, 1, 1e9, &channels)) return 1;
    return channels == 1 ? 0 : ex_header_fail(header, field, value, "is not supported: only one number per voxel is");
}

static inline int ex_meta_origin(ex_header *header, const char *field, char *value) {
    return ex_header_coordinates(header, field, value, 3, header->file->origin);
}

/* The first three numbers are the direction of the x axis. */
static inline int ex_meta_matrix(ex_header *header, const char *field, char *value) {
    header->placed_by = field;
    return ex_header_coordinates(header, field, value, 9, header->direction[0]);
}

static inline int ex_meta_data_file(ex_header *header, const char *field, char *value) {
    return strcmp(value, "LOCAL") == 0 ? 0 : ex_header_data_file(header, field, value);
}

/* clang-format off */
static const ex_header_field ex_meta_fields[] = {
    {"ObjectType", ex_meta_object, 0},
    {"NDims", ex_header_dimension, 1},
    {"DimSize", ex_header_size, 1},
    {"ElementType", ex_meta_type, 1},
    {"ElementDataFile", ex_meta_data_file, 1},
    {"ElementSpacing", ex_header_spacing, 0},
    {"TransformMatrix", ex_meta_matrix, 0}, {"Rotation", ex_meta_matrix, 0}, {"Orientation", ex_meta_matrix, 0},
    {"Offset", ex_meta_origin, 0}, {"Position", ex_meta_origin, 0}, {"Origin", ex_meta_origin, 0},
    {"BinaryData", ex_meta_binary, 0},
    {"BinaryDataByteOrderMSB", ex_meta_byte_order, 0}, {"ElementByteOrderMSB", ex_meta_byte_order, 0},
    {"CompressedData", ex_meta_compressed, 0},
    {"ElementNumberOfChannels", ex_meta_channels, 0},
    {"HeaderSize", ex_header_bytes_to_skip, 0},
    {NULL, NULL, 0}};
/* clang-format on */

/* Lines of `field = value`; ElementDataFile is the last one. Unknown fields belong to other programs. */
static inline int ex_meta_read(ex_header *header, char *text, size_t length) {
    char *rest = text, *line;
    int known;
    while (!ex_header_has(header, ex_meta_fields, "ElementDataFile") &&
           (line = ex_next_line(&rest, text + length)) != NULL) {
        char *equals = strchr(line, '=');
        if (!equals && !*ex_trim(line)) continue;
        if (!equals) return ex_fail(header->error, "%s: no field: '%s'", header->path, ex_quoted(line).text);
        *equals = '\0';
        if (ex_header_read_field(header, ex_meta_fields, ex_trim(line), ex_trim(equals + 1), &known)) return 1;
    }
    if (ex_header_check_required(header, ex_meta_fields)) return 1;
    header->end = (size_t)(rest - text);
    if (!header->detached) header->file->voxels.offset += header->end;
    return 0;
}

/* --------------------------------------------------------------------------------------------- NIfTI-1 */

/* By the code in `datatype` */
static const ex_header_type ex_nifti_types[] = {{"2", EX_U8},   {"256", EX_I8},  {"512", EX_U16},
                                                {"4", EX_I16},  {"768", EX_U32}, {"8", EX_I32},
                                                {"16", EX_F32}, {"64", EX_F64},  {NULL, EX_U8}};

/* Reads one of the header's numbers. */
static inline double ex_nifti_number(const ex_header *header, const char *bytes, size_t offset, ex_type type) {
    int16_t i16;
    int32_t i32;
    float f32;
    char copy[4];
    const size_t size = ex_type_size(type);
    memcpy(copy, bytes + offset, size);
    ex_byte_order(copy, 1, size, header->file->voxels.big_endian);
    if (type == EX_I16) return memcpy(&i16, copy, sizeof i16), (double)i16;
    if (type == EX_I32) return memcpy(&i32, copy, sizeof i32), (double)i32;
    return memcpy(&f32, copy, sizeof f32), (double)f32;
}

static inline int ex_nifti_fail(const ex_header *header, const char *field, double value, const char *why) {
    return ex_fail(header->error, "%s: %s: %g %s", header->path, field, value, why);
}

/* dim, datatype, bitpix */
static inline int ex_nifti_size(ex_header *header, const char *bytes) {
    double dim[8], type = ex_nifti_number(header, bytes, 70, EX_I16), bits = ex_nifti_number(header, bytes, 72, EX_I16);
    char text[64];
    for (size_t i = 0; i < 8; ++i) dim[i] = ex_nifti_number(header, bytes, 40 + 2 * i, EX_I16);
    if (!(dim[0] >= 3 && dim[0] <= 7))
        return ex_nifti_fail(header, "dim[0]", dim[0], "dimensions are not supported: only 3 are");
    for (int i = 4; i <= (int)dim[0]; ++i)
        if (dim[i] != 1)
            return ex_nifti_fail(header, "dim", dim[i], "along a fourth axis or beyond is not supported: only 1 is");
    snprintf(text, sizeof text, "%g %g %g", dim[1], dim[2], dim[3]);
    if (ex_header_set_size(header, "dim", text, dim + 1)) return 1;
    snprintf(text, sizeof text, "%g", type);
    if (ex_header_set_type(header, "datatype", text, ex_nifti_types)) return 1;
    if (bits != 8 * (double)ex_type_size(header->file->voxels.type))
        return ex_nifti_fail(header, "bitpix", bits, "does not match the datatype");
    return 0;
}

/* vox_offset, scl_slope, scl_inter. A slope that is 0 or not finite means no scaling. */
static inline int ex_nifti_values(ex_header *header, const char *bytes) {
    ex_voxel_file *voxels = &header->file->voxels;
    const double offset = ex_nifti_number(header, bytes, 108, EX_F32);
    if (!(offset >= 352 && offset <= 1e15 && offset == floor(offset)))
        return ex_nifti_fail(header, "vox_offset", offset, "is not a whole number from 352 on");
    voxels->offset = (uint64_t)offset;
    voxels->slope = ex_nifti_number(header, bytes, 112, EX_F32);
    voxels->intercept = ex_nifti_number(header, bytes, 116, EX_F32);
    if (!(fabs(voxels->slope) <= DBL_MAX)) voxels->slope = 0;
    if (voxels->slope != 0 && !(fabs(voxels->intercept) <= DBL_MAX))
        return ex_nifti_fail(header, "scl_inter", voxels->intercept, "is not finite");
    return 0;
}

/* sform: a matrix with one row per world coordinate. */
static inline void ex_nifti_sform(ex_header *header, const char *bytes) {
    header->placed_by = "srow";
    for (size_t i = 0; i < 3; ++i) {
        for (size_t a = 0; a < 3; ++a)
            header->direction[a][i] = ex_nifti_number(header, bytes, 280 + 16 * i + 4 * a, EX_F32);
        header->file->origin[i] = ex_nifti_number(header, bytes, 280 + 16 * i + 12, EX_F32);
    }
}

/* qform: a rotation as a unit quaternion, whose first number follows from the other three. */
static inline void ex_nifti_qform(ex_header *header, const char *bytes) {
    double q[4], sum = 0;
    header->placed_by = "quatern";
    for (size_t i = 1; i < 4; ++i) {
        q[i] = ex_nifti_number(header, bytes, 252 + 4 * i, EX_F32);
        sum += q[i] * q[i];
        header->file->origin[i - 1] = ex_nifti_number(header, bytes, 264 + 4 * i, EX_F32);
    }
    q[0] = sqrt(fmax(1 - sum, 0));
    const double length = sqrt(q[0] * q[0] + sum); /* above 1 because of rounding, or of a bad file */
    for (int i = 0; i < 4; ++i) q[i] /= length;
    /* Column `a` of the rotation matrix of a unit quaternion */
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        header->direction[a][a] = 1 - 2 * (q[1 + b] * q[1 + b] + q[1 + c] * q[1 + c]);
        header->direction[a][b] = 2 * (q[1 + a] * q[1 + b] + q[0] * q[1 + c]);
        header->direction[a][c] = 2 * (q[1 + a] * q[1 + c] - q[0] * q[1 + b]);
    }
}

/* sform is preferred to qform; without either, only the spacing is known. */
static inline int ex_nifti_placement(ex_header *header, const char *bytes) {
    const int has_qform = ex_nifti_number(header, bytes, 252, EX_I16) > 0;
    const int has_sform = ex_nifti_number(header, bytes, 254, EX_I16) > 0;
    if (has_sform) {
        ex_nifti_sform(header, bytes);
    } else {
        if (has_qform) ex_nifti_qform(header, bytes);
        for (size_t a = 0; a < 3; ++a) {
            const double spacing = fabs(ex_nifti_number(header, bytes, 80 + 4 * a, EX_F32));
            if (!(spacing <= EX_COORDINATE_MAX)) return ex_nifti_fail(header, "pixdim", spacing, "is out of range");
            header->spacing[a] = spacing > 0 ? spacing : 1; /* 0: unknown */
        }
        if (has_qform && ex_nifti_number(header, bytes, 76, EX_F32) < 0) header->spacing[2] *= -1; /* "qfac" */
    }
    for (int i = 0; i < 3; ++i)
        if (!(fabs(header->file->origin[i]) <= EX_COORDINATE_MAX))
            return ex_nifti_fail(header, has_sform ? "srow" : "qoffset", header->file->origin[i], "is out of range");
    return 0;
}

/* 348 bytes of numbers at fixed offsets. The first number is 348, which reveals the byte order. */
static inline int ex_nifti_read(ex_header *header, char *bytes, size_t length) {
    if (length < 352) return ex_fail(header->error, "%s: only %zu bytes, but the header has 352", header->path, length);
    if (ex_nifti_number(header, bytes, 0, EX_I32) != 348) header->file->voxels.big_endian = 1;
    if (ex_nifti_number(header, bytes, 0, EX_I32) != 348)
        return ex_fail(header->error, "%s: sizeof_hdr: not the 348 of a NIfTI-1 file", header->path);
    if (memcmp(bytes + 344, "n+1", 4) != 0)
        return ex_header_fail(header, "magic", bytes + 344, "is not n+1 (header and voxels in one file)");
    return ex_nifti_size(header, bytes) || ex_nifti_values(header, bytes) || ex_nifti_placement(header, bytes);
}

/* --------------------------------------------------------------------------------------------------- NPY */

/* Without the byte order */
static const ex_header_type ex_npy_types[] = {{"u1", EX_U8},  {"i1", EX_I8},  {"u2", EX_U16},
                                              {"i2", EX_I16}, {"u4", EX_U32}, {"i4", EX_I32},
                                              {"f4", EX_F32}, {"f8", EX_F64}, {NULL, EX_U8}};

/* '|u1', '<f4', '>i2': byte order, kind, bytes */
static inline int ex_npy_descr(ex_header *header, const char *field, char *value) {
    const size_t length = strlen(value);
    if (length < 4 || (value[0] != '\'' && value[0] != '"') || value[length - 1] != value[0])
        return ex_header_fail(header, field, value, "is not supported: only plain types are");
    value[length - 1] = '\0';
    const char *type = value + 1 + (strchr("<>|=", value[1]) != NULL);
    if (ex_header_set_type(header, field, type, ex_npy_types)) return 1;
    header->file->voxels.big_endian = value[1] == '>';
    if (ex_type_size(header->file->voxels.type) == 1 || value[1] == '<' || value[1] == '>') return 0;
    return ex_header_fail(header, field, value + 1, "has no byte order");
}

/* The last index of the array is x, in either order: an array saved in C or in Fortran order is the same volume. */
static inline int ex_npy_order(ex_header *header, const char *field, char *value) {
    header->file->voxels.x_slowest = strcmp(value, "True") == 0;
    if (header->file->voxels.x_slowest || strcmp(value, "False") == 0) return 0;
    return ex_header_fail(header, field, value, "is neither True nor False");
}

/* (z, y, x) */
static inline int ex_npy_shape(ex_header *header, const char *field, char *value) {
    double sizes[3];
    int length = 0;
    if (sscanf(value, "( %lf , %lf , %lf )%n", &sizes[2], &sizes[1], &sizes[0], &length) != 3 || length == 0 ||
        value[length])
        return ex_header_fail(header, field, value, "is not (z, y, x): only 3 dimensions are supported");
    return ex_header_set_size(header, field, value, sizes);
}

static const ex_header_field ex_npy_fields[] = {
    {"descr", ex_npy_descr, 1}, {"fortran_order", ex_npy_order, 1}, {"shape", ex_npy_shape, 1}, {NULL, NULL, 0}};

/* Splits `'name': value` in place. Returns the comma or brace after the value; NULL if the text is malformed. */
static inline char *ex_npy_entry(char *text, char **name, char **value) {
    int depth = 0;
    const char quote = *text;
    if (quote != '\'' && quote != '"') return NULL;
    *name = text + 1;
    char *end = strchr(*name, quote);
    if (!end) return NULL;
    *end = '\0';
    end = ex_skip_blanks(end + 1);
    if (*end != ':') return NULL;
    *value = ++end;
    for (; *end && (depth > 0 || (*end != ',' && *end != '}')); ++end) depth += (*end == '(') - (*end == ')');
    return *end ? end : NULL;
}

/* A magic string, the version, the length of the header, and a Python dictionary of three entries. */
static inline int ex_npy_read(ex_header *header, char *bytes, size_t length) {
    if (length >= 6 && length < 12 && memcmp(bytes, "\x93NUMPY", 6) == 0)
        return ex_fail(header->error, "%s: the header ends after %zu bytes", header->path, length);
    if (length < 12 || memcmp(bytes, "\x93NUMPY", 6) != 0)
        return ex_fail(header->error, "%s: not an NPY file: it does not start with \\x93NUMPY", header->path);
    const int version = (unsigned char)bytes[6];
    if (version < 1 || version > 3)
        return ex_fail(header->error, "%s: version %d is not supported: only 1, 2 and 3 are", header->path, version);
    size_t said = 0;
    const size_t start = version == 1 ? 10 : 12;
    for (size_t i = start; i-- > 8;) said = said << 8 | (unsigned char)bytes[i]; /* little endian */
    if (said > length - start)
        return ex_fail(header->error, "%s: header length: %zu bytes, but the file has only %zu", header->path, said,
                       length - start);
    bytes[start + said] = '\0';
    char *at = ex_trim(bytes + start), *name, *value, separator = *at;
    if (separator != '{') return ex_fail(header->error, "%s: the header is not a dictionary", header->path);
    while (separator != '}' && *(at = ex_skip_blanks(at + 1)) != '}') {
        int known;
        at = ex_npy_entry(at, &name, &value);
        if (!at) return ex_fail(header->error, "%s: the header's dictionary is cut off or malformed", header->path);
        separator = *at;
        *at = '\0';
        if (ex_header_read_field(header, ex_npy_fields, name, ex_trim(value), &known)) return 1;
        if (!known) return ex_fail(header->error, "%s: unknown field '%s'", header->path, ex_quoted(name).text);
    }
    header->file->voxels.offset = start + said;
    return ex_header_check_required(header, ex_npy_fields);
}

/* ----------------------------------------------------------------------------------------------- any file */

static inline int ex_compressed_read(ex_header *header, char *bytes, size_t length) {
    (void)bytes, (void)length;
    return ex_fail(header->error, "%s: compressed files are not supported: gunzip it first", header->path);
}

typedef struct ex_volume_format {
    const char *ending;
    int (*read)(ex_header *header, char *bytes, size_t length); /* may change the bytes */
} ex_volume_format;

static const ex_volume_format ex_volume_formats[] = {
    {".nrrd", ex_nrrd_read}, {".nhdr", ex_nrrd_read}, {".mhd", ex_meta_read},      {".mha", ex_meta_read},
    {".nii", ex_nifti_read}, {".npy", ex_npy_read},   {".gz", ex_compressed_read}, {NULL, NULL}};

/* The format of a file, by the ending of its name. NULL: raw voxels. */
static inline const ex_volume_format *ex_volume_format_of(const char *path) {
    for (const ex_volume_format *format = ex_volume_formats; format->ending; ++format) {
        const size_t length = strlen(path), ending = strlen(format->ending);
        if (length > ending && strcasecmp(path + length - ending, format->ending) == 0) return format;
    }
    return NULL;
}

/* Reads the header of a file whose name has one of these endings. */
static inline int ex_volume_file_read(ex_volume_file *file, const char *path, ex_error *error) {
    static const int none[3] = {0, 0, 0};
    const ex_volume_format *format = ex_volume_format_of(path);
    ex_header header;
    char *text = NULL;
    size_t length = 0;
    uint64_t held = 0;
    memset(&header, 0, sizeof header);
    memset(file, 0, sizeof *file);
    if (!format) return ex_fail(error, "%s: unknown format", path);
    header.path = path, header.file = file, header.error = error;
    for (int a = 0; a < 3; ++a) header.spacing[a] = header.direction[a][a] = 1;
    if (ex_voxel_file_raw(&file->voxels, path, none, EX_U8, error)) return 1;
    file->voxels.may_go_on = 1;
    if (ex_read_start(path, EX_HEADER_MAX, &text, &length, &held, error)) return 1;
    const int failed = format->read(&header, text, length) || ex_header_place(&header);
    free(text);
    return failed;
}

#endif /* EX_VOLUME_FILE_H */
