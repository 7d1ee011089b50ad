/* volume_file.h: reads the headers of NRRD, MetaImage, NIfTI, NPY and NPZ files: how many voxels there are, their type,
   where and how they are stored, and where they lie in the world. ex_grid_load of volume.h then reads the voxels, or
   ex_color_grid_load of color_volume.h where each has three numbers.

   Supported are three dimensions, and one or three numbers per voxel, as in memory or packed by deflate. World
   coordinates are those of the file; no patient coordinate system (LPS, RAS) is converted to another.

   Not read: text, bzip2, other packings, voxels in several files, series, Analyze 7.5, zip64.

   The formats are described at https://teem.sourceforge.net/nrrd/format.html, https://itk.org/Wiki/MetaIO,
   https://nifti.nimh.nih.gov (1 and 2) and https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html. */

#ifndef EX_VOLUME_FILE_H
#define EX_VOLUME_FILE_H

#include "volume_header.h"
#include "zip.h"

/* -------------------------------------------------------------------------------------------------- NRRD */

/* clang-format off */
static const ex_header_type ex_nrrd_types[] = {
    {"signed char", EX_I8}, {"int8", EX_I8}, {"int8_t", EX_I8}, {"uchar", EX_U8}, {"unsigned char", EX_U8},
    {"uint8", EX_U8}, {"uint8_t", EX_U8}, {"short", EX_I16}, {"short int", EX_I16}, {"signed short", EX_I16},
    {"signed short int", EX_I16}, {"int16", EX_I16}, {"int16_t", EX_I16}, {"ushort", EX_U16},
    {"unsigned short", EX_U16}, {"unsigned short int", EX_U16}, {"uint16", EX_U16}, {"uint16_t", EX_U16},
    {"int", EX_I32}, {"signed int", EX_I32}, {"int32", EX_I32}, {"int32_t", EX_I32}, {"uint", EX_U32},
    {"unsigned int", EX_U32}, {"uint32", EX_U32}, {"uint32_t", EX_U32}, {"longlong", EX_I64}, {"long long", EX_I64},
    {"long long int", EX_I64}, {"signed long long", EX_I64}, {"signed long long int", EX_I64}, {"int64", EX_I64},
    {"int64_t", EX_I64}, {"ulonglong", EX_U64}, {"unsigned long long", EX_U64}, {"unsigned long long int", EX_U64},
    {"uint64", EX_U64}, {"uint64_t", EX_U64}, {"float", EX_F32}, {"double", EX_F64}, {NULL, EX_U8}};

/* Kinds of axes in space, or unknown ones; kinds that are the components of a voxel; and components of other colors. */
static const char *const ex_nrrd_space_kinds[] = {"domain", "space", "???", "none", NULL};
static const char *const ex_nrrd_component_kinds[] = {"list", "point", "vector", "covariant-vector", "normal", "stub",
    "scalar", "complex", "2-vector", "3-color", "RGB-color", "RGB-colour", "4-color", "RGBA-color", "3-vector",
    "3-gradient", "3-normal", "4-vector", "quaternion", "2D-symmetric-matrix", "2D-masked-symmetric-matrix",
    "2D-matrix", "2D-masked-matrix", "3D-symmetric-matrix", "3D-masked-symmetric-matrix", "3D-matrix",
    "3D-masked-matrix", NULL};
/* clang-format on */

static inline int ex_nrrd_type(ex_header *header, const char *field, char *value) {
    return ex_header_set_type(header, field, value, ex_nrrd_types);
}

static inline int ex_nrrd_encoding(ex_header *header, const char *field, char *value) {
    const int is_gzip = strcasecmp(value, "gzip") == 0 || strcasecmp(value, "gz") == 0;
    if (is_gzip) header->file->voxels.storage = EX_STORED_GZIP;
    if (is_gzip || strcasecmp(value, "raw") == 0) return 0;
    return ex_header_fail(header, field, value, "is not supported: only raw and gzip are");
}

static inline int ex_nrrd_endian(ex_header *header, const char *field, char *value) {
    header->file->voxels.big_endian = strcasecmp(value, "big") == 0;
    if (header->file->voxels.big_endian || strcasecmp(value, "little") == 0) return 0;
    return ex_header_fail(header, field, value, "is neither little nor big");
}

/* Parses `count` vectors: (x,y,z) (x,y,z). With `given`, a vector may be `none`. */
static inline int ex_nrrd_vectors(const ex_header *header, const char *field, const char *value, int count,
                                  double (*out)[3], int *given) {
    const char *at = value;
    for (int i = 0; i < count; ++i) {
        int length = 0;
        const int got = sscanf(at, " ( %lf , %lf , %lf )%n", &out[i][0], &out[i][1], &out[i][2], &length);
        const char *word = ex_skip_spaces(at);
        const int is_none = given && strncmp(word, "none", 4) == 0 && strchr(" \t", word[4]) != NULL;
        if (given) given[i] = !is_none;
        if (is_none) length = (int)(word - at) + 4;
        if (!is_none && (got != 3 || length == 0))
            return ex_header_fail(header, field, value, "is not (x,y,z) for each vector");
        for (int k = 0; k < 3 && !is_none; ++k)
            if (!(fabs(out[i][k]) <= EX_COORDINATE_MAX))
                return ex_header_fail(header, field, value, "has a number out of range");
        at += length;
    }
    return *ex_skip_spaces(at) ? ex_header_fail(header, field, value, "has too many vectors, or something else") : 0;
}

/* Axes can only be counted once their number is known. */
static inline int ex_nrrd_needs_dimension(const ex_header *header, const char *field, const char *value) {
    if (header->axes.count > 0) return 0;
    return ex_header_fail(header, field, value, "comes before the dimension");
}

static inline int ex_nrrd_dimension(ex_header *header, const char *field, char *value) {
    double dimension;
    if (ex_header_integer(header, field, value, 0, 1e9, &dimension)) return 1;
    if (dimension != 3 && dimension != 4)
        return ex_header_fail(header, field, value,
                              "is not supported: only 3 dimensions are, and components as a fourth one");
    header->axes.count = (int)dimension;
    return 0;
}

static inline int ex_nrrd_sizes(ex_header *header, const char *field, char *value) {
    if (ex_nrrd_needs_dimension(header, field, value)) return 1;
    return ex_header_numbers(header, field, value, header->axes.count, -1e18, 1e18, header->axes.size);
}

/* NaN: this axis has no spacing. */
static inline int ex_nrrd_spacings(ex_header *header, const char *field, char *value) {
    const char *at = value;
    header->placed_by = field;
    if (ex_nrrd_needs_dimension(header, field, value)) return 1;
    for (int i = 0; i < header->axes.count; ++i) {
        char *end;
        double *spacing = &header->axes.spacing[i];
        *spacing = strtod(at, &end);
        if (end == at) return ex_header_fail(header, field, value, "has too few numbers");
        if (fabs(*spacing) > EX_COORDINATE_MAX)
            return ex_header_fail(header, field, value, "has a number out of range");
        if (*spacing == 0) return ex_header_fail(header, field, value, "has a 0");
        at = end;
    }
    return *at ? ex_header_fail(header, field, value, "has too many numbers, or something else") : 0;
}

static inline int ex_nrrd_directions(ex_header *header, const char *field, char *value) {
    header->placed_by = field;
    if (ex_nrrd_needs_dimension(header, field, value)) return 1;
    if (ex_nrrd_vectors(header, field, value, header->axes.count, header->axes.direction, header->axes.has_direction))
        return 1;
    for (int i = 0; i < header->axes.count; ++i) header->axes.is_component[i] |= !header->axes.has_direction[i];
    return 0;
}

static inline int ex_nrrd_is_kind(const char *const *kinds, const char *word) {
    while (*kinds && strcasecmp(*kinds, word) != 0) ++kinds;
    return *kinds != NULL;
}

/* One word per axis. */
static inline int ex_nrrd_kinds(ex_header *header, const char *field, char *value) {
    const char *at = value;
    if (ex_nrrd_needs_dimension(header, field, value)) return 1;
    for (int i = 0; i < header->axes.count; ++i) {
        char word[32];
        int length = 0;
        if (sscanf(at, " %31s%n", word, &length) != 1)
            return ex_header_fail(header, field, value, "has fewer words than there are dimensions");
        if (ex_nrrd_is_kind(ex_nrrd_component_kinds, word))
            header->axes.is_component[i] = 1;
        else if (!ex_nrrd_is_kind(ex_nrrd_space_kinds, word))
            return ex_header_fail(header, field, word, "is not supported");
        at += length;
    }
    return *ex_skip_spaces(at) ? ex_header_fail(header, field, value, "has more words than there are dimensions") : 0;
}

/* "right-anterior-superior" and its like are shortened to RAS. */
static inline int ex_nrrd_space(ex_header *header, const char *field, char *value) {
    static const char *const names[][2] = {{"right-anterior-superior", "RAS"},
                                           {"left-anterior-superior", "LAS"},
                                           {"left-posterior-superior", "LPS"},
                                           {"RAS", "RAS"},
                                           {"LAS", "LAS"},
                                           {"LPS", "LPS"}};
    (void)field;
    ex_header_set_space(header, value);
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i)
        if (strcasecmp(value, names[i][0]) == 0) ex_header_set_space(header, names[i][1]);
    return 0;
}

/* The axis of components: the only one that is not in space. -1: there is none. */
static inline int ex_nrrd_find_components(const ex_header *header, int *axis) {
    const ex_header_axes *axes = &header->axes;
    *axis = -1;
    for (int i = 0; i < axes->count; ++i) {
        if (!axes->is_component[i]) continue;
        if (*axis >= 0 || axes->count == 3)
            return ex_fail(header->error, "%s: kinds or space directions: fewer than three axes lie in space",
                           header->path);
        *axis = i;
    }
    if (axes->count == 4 && *axis < 0)
        return ex_fail(header->error,
                       "%s: dimension: 4, but neither kinds nor space directions say which is components",
                       header->path);
    return 0;
}

/* Sizes, spacings and directions, once all fields are read: those of the axes in space, and of the components. */
static inline int ex_nrrd_set_axes(ex_header *header) {
    const ex_header_axes *axes = &header->axes;
    char text[128];
    double sizes[3] = {0, 0, 0};
    int components;
    if (ex_nrrd_find_components(header, &components)) return 1;
    for (int i = 0, a = 0; i < axes->count; ++i) {
        if (i == components) continue;
        if (axes->has_direction[i] && axes->spacing[i] == axes->spacing[i])
            return ex_fail(header->error, "%s: spacings: axis %d has a space direction, too", header->path, i);
        sizes[a] = axes->size[i];
        if (axes->spacing[i] == axes->spacing[i]) header->spacing[a] = axes->spacing[i];
        if (axes->has_direction[i]) memcpy(header->direction[a], axes->direction[i], sizeof axes->direction[i]);
        ++a;
    }
    snprintf(text, sizeof text, axes->count == 3 ? "%g %g %g" : "%g %g %g %g", axes->size[0], axes->size[1],
             axes->size[2], axes->size[3]);
    if (ex_header_set_size(header, "sizes", text, sizes)) return 1;
    if (components < 0) return 0;
    if (components == 1 || components == 2)
        return ex_header_fail(header, "sizes", text, "has components between its axes, not first or last");
    header->file->voxels.planes = components == 3;
    return ex_header_set_components(header, "sizes", text, axes->size[components]);
}

static inline int ex_nrrd_origin(ex_header *header, const char *field, char *value) {
    return ex_nrrd_vectors(header, field, value, 1, &header->file->origin, NULL);
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
    {"dimension", ex_nrrd_dimension, 1},
    {"sizes", ex_nrrd_sizes, 1},
    {"type", ex_nrrd_type, 1},
    {"encoding", ex_nrrd_encoding, 1},
    {"endian", ex_nrrd_endian, 0},
    {"spacings", ex_nrrd_spacings, 0},
    {"space directions", ex_nrrd_directions, 0},
    {"space origin", ex_nrrd_origin, 0},
    {"space dimension", ex_header_dimension, 0},
    {"data file", ex_header_data_file, 0},
    {"line skip", ex_nrrd_lines_to_skip, 0},
    {"byte skip", ex_header_bytes_to_skip, 0},
    {"axis mins", ex_nrrd_axis_ends, 0},
    {"axis maxs", ex_nrrd_axis_ends, 0},
    {"space", ex_nrrd_space, 0}, {"kinds", ex_nrrd_kinds, 0}, {"space units", NULL, 0}, {"measurement frame", NULL, 0}, {"thicknesses", NULL, 0},
    {"centers", NULL, 0}, {"centerings", NULL, 0}, {"labels", NULL, 0}, {"units", NULL, 0},
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
    if (voxels->storage == EX_STORED_PLAIN)
        voxels->offset += from;
    else
        voxels->packed_at = from; /* lines are skipped before unpacking, bytes after it */
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
    if (header->file->voxels.storage != EX_STORED_PLAIN && header->file->voxels.at_end)
        return ex_fail(header->error, "%s: byte skip: -1 is not possible with gzip: it is unknown where the end is",
                       header->path);
    return ex_nrrd_set_axes(header) || ex_nrrd_skip_lines(header);
}

/* --------------------------------------------------------------------------------------------- MetaImage */

static const ex_header_type ex_meta_types[] = {
    {"MET_CHAR", EX_I8},       {"MET_UCHAR", EX_U8},       {"MET_SHORT", EX_I16}, {"MET_USHORT", EX_U16},
    {"MET_INT", EX_I32},       {"MET_UINT", EX_U32},       {"MET_FLOAT", EX_F32}, {"MET_DOUBLE", EX_F64},
    {"MET_LONG_LONG", EX_I64}, {"MET_ULONG_LONG", EX_U64}, {NULL, EX_U8}};

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
    header->file->voxels.storage = compressed ? EX_STORED_ZLIB : EX_STORED_PLAIN;
    return 0;
}

static inline int ex_meta_compressed_size(ex_header *header, const char *field, char *value) {
    double bytes;
    if (ex_header_integer(header, field, value, 1, 1e15, &bytes)) return 1;
    header->file->voxels.packed_size = (uint64_t)bytes;
    return 0;
}

static inline int ex_meta_slope(ex_header *header, const char *field, char *value) {
    if (ex_header_numbers(header, field, value, 1, -1e18, 1e18, &header->file->voxels.slope)) return 1;
    return header->file->voxels.slope != 0 ? 0 : ex_header_fail(header, field, value, "makes all voxels equal");
}

static inline int ex_meta_intercept(ex_header *header, const char *field, char *value) {
    return ex_header_numbers(header, field, value, 1, -1e18, 1e18, &header->file->voxels.intercept);
}

/* The extent of a voxel is taken for the spacing where that is not given. */
static inline int ex_meta_element_size(ex_header *header, const char *field, char *value) {
    double kept[3];
    memcpy(kept, header->spacing, sizeof kept);
    if (ex_header_spacing(header, field, value)) return 1;
    memcpy(header->axes.spacing, header->spacing, sizeof kept);
    memcpy(header->spacing, kept, sizeof kept);
    return 0;
}

static inline int ex_meta_orientation(ex_header *header, const char *field, char *value) {
    (void)field;
    /* The letters say from where each axis comes; coordinates are always LPS. */
    if (*value && *value != '?') ex_header_set_space(header, "LPS");
    return 0;
}

static inline int ex_meta_byte_order(ex_header *header, const char *field, char *value) {
    return ex_meta_bool(header, field, value, &header->file->voxels.big_endian);
}

static inline int ex_meta_channels(ex_header *header, const char *field, char *value) {
    double channels;
    if (ex_header_integer(header, field, value, 1, 1e9, &channels)) return 1;
    return ex_header_set_components(header, field, value, channels);
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
    {"CompressedDataSize", ex_meta_compressed_size, 0},
    {"ElementSize", ex_meta_element_size, 0},
    {"ElementToIntensityFunctionSlope", ex_meta_slope, 0},
    {"ElementToIntensityFunctionOffset", ex_meta_intercept, 0},
    {"AnatomicalOrientation", ex_meta_orientation, 0},
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
    if (ex_header_has(header, ex_meta_fields, "ElementSize") &&
        !ex_header_has(header, ex_meta_fields, "ElementSpacing"))
        memcpy(header->spacing, header->axes.spacing, sizeof header->spacing);
    ex_voxel_file *voxels = &header->file->voxels;
    if (voxels->intercept != 0 && voxels->slope == 0) voxels->slope = 1;
    if (!header->detached) voxels->offset += header->end;
    if (voxels->storage == EX_STORED_PLAIN) return 0;
    if (voxels->at_end)
        return ex_fail(header->error, "%s: HeaderSize: -1 is not possible with compressed voxels", header->path);
    voxels->packed_at = voxels->offset;
    voxels->offset = 0;
    return 0;
}

/* ----------------------------------------------------------------------------------------------- NIfTI */

/* Codes of `datatype`; 128 is three bytes per voxel. */
static const ex_header_type ex_nifti_types[] = {{"2", EX_U8},    {"256", EX_I8},   {"512", EX_U16},  {"4", EX_I16},
                                                {"768", EX_U32}, {"8", EX_I32},    {"16", EX_F32},   {"64", EX_F64},
                                                {"128", EX_U8},  {"1024", EX_I64}, {"1280", EX_U64}, {NULL, EX_U8}};

/* Where the numbers are in the two versions of the header, and their types. */
typedef struct ex_nifti_layout {
    int length;            /* which is the first number of the header */
    const char *magics[2]; /* one file for header and voxels, and two files */
    size_t magic, datatype, bits, dim, pixdim, offset, slope, intercept, qform, sform, quatern, qoffset, srow;
    ex_type integer, real, offset_type, code;
} ex_nifti_layout;

static const ex_nifti_layout ex_nifti_layouts[2] = {
    {348, {"n+1", "ni1"}, 344, 70, 72, 40, 76, 108, 112, 116, 252, 254, 256, 268, 280, EX_I16, EX_F32, EX_F32, EX_I16},
    {540, {"n+2", "ni2"}, 4, 12, 14, 16, 104, 168, 176, 184, 344, 348, 352, 376, 400, EX_I64, EX_F64, EX_I64, EX_I32}};

/* A header in memory. */
typedef struct ex_nifti {
    ex_header *header;
    const char *bytes;
    const ex_nifti_layout *at;
} ex_nifti;

/* Reads the number with this index in a list at an offset. */
static inline double ex_nifti_number(const ex_nifti *nifti, size_t offset, size_t index, ex_type type) {
    union {
        char bytes[8];
        int16_t i16;
        int32_t i32;
        int64_t i64;
        float f32;
        double f64;
    } number;
    const size_t size = ex_type_size(type);
    memcpy(number.bytes, nifti->bytes + offset + index * size, size);
    ex_byte_order(number.bytes, 1, size, nifti->header->file->voxels.big_endian);
    switch (type) {
    case EX_I16: return number.i16;
    case EX_I32: return number.i32;
    case EX_I64: return (double)number.i64;
    case EX_F32: return (double)number.f32;
    default: return number.f64;
    }
}

static inline double ex_nifti_real(const ex_nifti *nifti, size_t offset, size_t index) {
    return ex_nifti_number(nifti, offset, index, nifti->at->real);
}

static inline int ex_nifti_fail(const ex_nifti *nifti, const char *field, double value, const char *why) {
    return ex_fail(nifti->header->error, "%s: %s: %g %s", nifti->header->path, field, value, why);
}

/* dim, datatype, bitpix */
static inline int ex_nifti_size(const ex_nifti *nifti) {
    const double type = ex_nifti_number(nifti, nifti->at->datatype, 0, EX_I16);
    const double bits = ex_nifti_number(nifti, nifti->at->bits, 0, EX_I16);
    ex_voxel_file *voxels = &nifti->header->file->voxels;
    double dim[8];
    char text[64];
    for (size_t i = 0; i < 8; ++i) dim[i] = ex_nifti_number(nifti, nifti->at->dim, i, nifti->at->integer);
    if (!(dim[0] >= 3 && dim[0] <= 7))
        return ex_nifti_fail(nifti, "dim[0]", dim[0], "dimensions are not supported: only 3 are");
    for (int i = 4; i <= (int)dim[0]; ++i)
        if (dim[i] != 1)
            return ex_nifti_fail(nifti, "dim", dim[i], "along a fourth axis or beyond is not supported: only 1 is");
    snprintf(text, sizeof text, "%g %g %g", dim[1], dim[2], dim[3]);
    if (ex_header_set_size(nifti->header, "dim", text, dim + 1)) return 1;
    snprintf(text, sizeof text, "%g", type);
    if (ex_header_set_type(nifti->header, "datatype", text, ex_nifti_types)) return 1;
    voxels->components = type == 128 ? 3 : 1;
    if (bits != 8 * (double)ex_type_size(voxels->type) * voxels->components)
        return ex_nifti_fail(nifti, "bitpix", bits, "does not match the datatype");
    return 0;
}

/* vox_offset, scl_slope, scl_inter. A slope that is 0 or not finite means no scaling. */
static inline int ex_nifti_values(const ex_nifti *nifti) {
    ex_voxel_file *voxels = &nifti->header->file->voxels;
    const double offset = ex_nifti_number(nifti, nifti->at->offset, 0, nifti->at->offset_type);
    const double least = nifti->header->detached ? 0 : nifti->at->length + 4;
    if (!(offset >= least && offset <= 1e15 && offset == floor(offset)))
        return ex_fail(nifti->header->error, "%s: vox_offset: %g is not a whole number from %g on", nifti->header->path,
                       offset, least);
    voxels->offset = (uint64_t)offset;
    voxels->slope = ex_nifti_real(nifti, nifti->at->slope, 0);
    voxels->intercept = ex_nifti_real(nifti, nifti->at->intercept, 0);
    if (!(fabs(voxels->slope) <= DBL_MAX)) voxels->slope = 0;
    if (voxels->slope != 0 && !(fabs(voxels->intercept) <= DBL_MAX))
        return ex_nifti_fail(nifti, "scl_inter", voxels->intercept, "is not finite");
    return 0;
}

/* sform: a matrix with one row per world coordinate. */
static inline void ex_nifti_sform(const ex_nifti *nifti) {
    nifti->header->placed_by = "srow";
    for (size_t i = 0; i < 3; ++i) {
        for (size_t a = 0; a < 3; ++a)
            nifti->header->direction[a][i] = ex_nifti_real(nifti, nifti->at->srow, 4 * i + a);
        nifti->header->file->origin[i] = ex_nifti_real(nifti, nifti->at->srow, 4 * i + 3);
    }
}

/* qform: a rotation as a unit quaternion, whose first number follows from the other three. */
static inline void ex_nifti_qform(const ex_nifti *nifti) {
    double q[4], sum = 0;
    ex_header *header = nifti->header;
    header->placed_by = "quatern";
    for (size_t i = 1; i < 4; ++i) {
        q[i] = ex_nifti_real(nifti, nifti->at->quatern, i - 1);
        sum += q[i] * q[i];
        header->file->origin[i - 1] = ex_nifti_real(nifti, nifti->at->qoffset, i - 1);
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
static inline int ex_nifti_placement(const ex_nifti *nifti) {
    ex_header *header = nifti->header;
    const int has_qform = ex_nifti_number(nifti, nifti->at->qform, 0, nifti->at->code) > 0;
    const int has_sform = ex_nifti_number(nifti, nifti->at->sform, 0, nifti->at->code) > 0;
    if (has_sform || has_qform) ex_header_set_space(header, "RAS");
    if (has_sform) {
        ex_nifti_sform(nifti);
    } else {
        if (has_qform) ex_nifti_qform(nifti);
        for (size_t a = 0; a < 3; ++a) {
            const double spacing = fabs(ex_nifti_real(nifti, nifti->at->pixdim, 1 + a));
            if (!(spacing <= EX_COORDINATE_MAX)) return ex_nifti_fail(nifti, "pixdim", spacing, "is out of range");
            header->spacing[a] = spacing > 0 ? spacing : 1; /* 0: unknown */
        }
        if (has_qform && ex_nifti_real(nifti, nifti->at->pixdim, 0) < 0) header->spacing[2] *= -1; /* "qfac" */
    }
    for (int i = 0; i < 3; ++i)
        if (!(fabs(header->file->origin[i]) <= EX_COORDINATE_MAX))
            return ex_nifti_fail(nifti, has_sform ? "srow" : "qoffset", header->file->origin[i], "is out of range");
    return 0;
}

/* The voxels of a .hdr file are in the .img file beside it. */
static inline int ex_nifti_find_image(ex_header *header) {
    char *path = header->file->voxels.path, *ending = path + strlen(path) - 4;
    memcpy(ending, strcmp(ending, ".HDR") == 0 ? ".IMG" : ".img", 4);
    header->detached = 1;
    return access(path, R_OK) == 0 ? 0 : ex_fail(header->error, "%s: %s: %s", header->path, path, strerror(errno));
}

/* The magic word tells whether the voxels are in the same file. */
static inline int ex_nifti_magic(const ex_nifti *nifti) {
    const char *magic = nifti->bytes + nifti->at->magic, *path = nifti->header->path;
    const char *const *magics = nifti->at->magics;
    const int is_pair = strcasecmp(path + strlen(path) - 4, ".hdr") == 0;
    char text[5] = "";
    if (memcmp(magic, magics[is_pair], 4) == 0) return is_pair && ex_nifti_find_image(nifti->header);
    memcpy(text, magic, 4);
    if (memcmp(magic, magics[!is_pair], 4) != 0 && is_pair)
        return ex_header_fail(nifti->header, "magic", text, "is not that of NIfTI; Analyze 7.5 is not supported");
    return ex_header_fail(nifti->header, "magic", text,
                          is_pair ? "says that the voxels are in the same file, so its name should end in .nii"
                                  : "is not that of a file with header and voxels (n+1, n+2)");
}

/* 348 or 540 bytes of numbers at fixed offsets. The first number is their count, which reveals the byte order. */
static inline int ex_nifti_read(ex_header *header, char *bytes, size_t length) {
    ex_nifti nifti = {header, bytes, NULL};
    const int is_pair = strcasecmp(header->path + strlen(header->path) - 4, ".hdr") == 0;
    if (length < 348)
        return ex_fail(header->error, "%s: only %zu bytes, but the header has 348 or 540", header->path, length);
    for (int i = 0; i < 4 && !nifti.at; ++i) {
        header->file->voxels.big_endian = i / 2;
        if (ex_nifti_number(&nifti, 0, 0, EX_I32) == ex_nifti_layouts[i % 2].length)
            nifti.at = &ex_nifti_layouts[i % 2];
    }
    if (!nifti.at)
        return ex_fail(header->error, "%s: sizeof_hdr: not the 348 of NIfTI-1 or the 540 of NIfTI-2", header->path);
    if (length < (size_t)nifti.at->length + (is_pair ? 0 : 4))
        return ex_fail(header->error, "%s: only %zu bytes, but the header has %d", header->path, length,
                       nifti.at->length + (is_pair ? 0 : 4));
    return ex_nifti_magic(&nifti) || ex_nifti_size(&nifti) || ex_nifti_values(&nifti) || ex_nifti_placement(&nifti);
}

/* .nii.gz: all of the file is packed. */
static inline int ex_nifti_read_packed(ex_header *header, char *bytes, size_t length) {
    unsigned char start[544];
    size_t got = 0;
    if (ex_inflate_start(header->path, EX_PACKED_GZIP, (const unsigned char *)bytes, length, start, sizeof start, &got,
                         header->error))
        return 1;
    header->file->voxels.storage = EX_STORED_GZIP;
    return ex_nifti_read(header, (char *)start, got);
}

/* --------------------------------------------------------------------------------------------------- NPY */

/* Without the byte order */
static const ex_header_type ex_npy_types[] = {
    {"u1", EX_U8},  {"i1", EX_I8},  {"u2", EX_U16}, {"i2", EX_I16}, {"u4", EX_U32}, {"i4", EX_I32}, {"u8", EX_U64},
    {"i8", EX_I64}, {"f2", EX_F16}, {"f4", EX_F32}, {"f8", EX_F64}, {"b1", EX_U8},  {NULL, EX_U8}};

/* '|u1', '<f4', '>i2': byte order, kind, bytes */
static inline int ex_npy_descr(ex_header *header, const char *field, char *value) {
    const size_t length = strlen(value);
    if (length < 4 || (value[0] != '\'' && value[0] != '"') || value[length - 1] != value[0])
        return ex_header_fail(header, field, value, "is not supported: only plain types are");
    value[length - 1] = '\0';
    const char *type = value + 1 + (strchr("<>|=", value[1]) != NULL);
    if (ex_header_set_type(header, field, type, ex_npy_types)) return 1;
    header->file->voxels.big_endian = value[1] == '>';
    if (strcmp(type, "b1") == 0) header->file->voxels.range[1] = 1; /* false and true are 0 and 1 */
    if (ex_type_size(header->file->voxels.type) == 1 || value[1] == '<' || value[1] == '>') return 0;
    return ex_header_fail(header, field, value + 1, "has no byte order");
}

/* The last index of the array is x, in either order: an array saved in C or in Fortran order is the same volume. */
static inline int ex_npy_order(ex_header *header, const char *field, char *value) {
    header->file->voxels.x_slowest = strcmp(value, "True") == 0;
    if (header->file->voxels.x_slowest || strcmp(value, "False") == 0) return 0;
    return ex_header_fail(header, field, value, "is neither True nor False");
}

/* (z, y, x), or (z, y, x, 3) for colors */
static inline int ex_npy_shape(ex_header *header, const char *field, char *value) {
    double sizes[3], components = 1;
    int length = 0;
    int got = sscanf(value, "( %lf , %lf , %lf )%n", &sizes[2], &sizes[1], &sizes[0], &length);
    if (length == 0)
        got = sscanf(value, "( %lf , %lf , %lf , %lf )%n", &sizes[2], &sizes[1], &sizes[0], &components, &length);
    if (got < 3 || length == 0 || value[length])
        return ex_header_fail(header, field, value,
                              "is not (z, y, x) or (z, y, x, 3): only 3 dimensions are supported");
    if (got == 4 && ex_header_set_components(header, field, value, components)) return 1;
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
    if (ex_header_check_required(header, ex_npy_fields)) return 1;
    if (!header->file->voxels.x_slowest || header->file->voxels.components < 3) return 0;
    return ex_fail(header->error, "%s: fortran_order: colors are supported in C order only", header->path);
}

/* A zip file of arrays. */
static inline int ex_npz_read(ex_header *header, char *bytes, size_t length) {
    ex_voxel_file *voxels = &header->file->voxels;
    ex_zip_member member;
    uint64_t held = 0;
    size_t got = 0;
    (void)bytes, (void)length;
    memset(&member, 0, sizeof member);
    if (ex_zip_find(header->path, header->array, ".npy", &member, header->error)) return 1;
    FILE *file = ex_open(header->path, &held, header->error);
    if (!file) return 1;
    const size_t most = EX_NPY_HEADER_MAX * (member.is_deflated ? 2 : 1); /* packing may make data a little longer */
    const size_t size = member.packed_size < most ? (size_t)member.packed_size : most;
    char *packed = (char *)ex_allocate(size, 1), *start = (char *)ex_allocate(EX_NPY_HEADER_MAX + 1, 1);
    int failed = fseeko(file, (off_t)member.at, SEEK_SET) != 0 || fread(packed, 1, size, file) != size;
    fclose(file);
    if (failed)
        ex_fail(header->error, "%s: reading failed after byte %llu", header->path, (unsigned long long)member.at);
    else if (member.is_deflated)
        failed = ex_inflate_start(header->path, EX_PACKED_RAW, (const unsigned char *)packed, size,
                                  (unsigned char *)start, EX_NPY_HEADER_MAX, &got, header->error);
    else
        memcpy(start, packed, got = size);
    failed = failed || ex_npy_read(header, start, got);
    free(packed);
    free(start);
    voxels->storage = member.is_deflated ? EX_STORED_DEFLATED : EX_STORED_ZIP;
    voxels->packed_at = member.at, voxels->packed_size = member.packed_size;
    voxels->unpacked_size = member.size, voxels->crc = member.crc;
    return failed;
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

static const ex_volume_format ex_volume_formats[] = {{".nrrd", ex_nrrd_read},
                                                     {".nhdr", ex_nrrd_read},
                                                     {".mhd", ex_meta_read},
                                                     {".mha", ex_meta_read},
                                                     {".nii", ex_nifti_read},
                                                     {".nii.gz", ex_nifti_read_packed},
                                                     {".hdr", ex_nifti_read},
                                                     {".npy", ex_npy_read},
                                                     {".npz", ex_npz_read},
                                                     {".gz", ex_compressed_read},
                                                     {NULL, NULL}};

/* The format of a file, by the ending of its name. NULL: raw voxels. */
static inline const ex_volume_format *ex_volume_format_of(const char *path) {
    for (const ex_volume_format *format = ex_volume_formats; format->ending; ++format) {
        const size_t length = strlen(path), ending = strlen(format->ending);
        if (length > ending && strcasecmp(path + length - ending, format->ending) == 0) return format;
    }
    return NULL;
}

/* Reads the header of a file whose name has one of these endings. `array` is the one to read where a file has several;
   NULL: there must be only one. */
static inline int ex_volume_file_read_array(ex_volume_file *file, const char *path, const char *array,
                                            ex_error *error) {
    static const int none[3] = {0, 0, 0};
    const ex_volume_format *format = ex_volume_format_of(path);
    ex_header header;
    char *text = NULL;
    size_t length = 0;
    uint64_t held = 0;
    memset(&header, 0, sizeof header);
    memset(file, 0, sizeof *file);
    if (!format) return ex_fail(error, "%s: unknown format", path);
    header.path = path, header.file = file, header.error = error, header.array = array;
    for (int a = 0; a < 3; ++a) header.spacing[a] = header.direction[a][a] = 1;
    for (int a = 0; a < 4; ++a) header.axes.spacing[a] = (double)NAN;
    if (ex_voxel_file_raw(&file->voxels, path, none, EX_U8, error)) return 1;
    file->voxels.may_go_on = 1;
    if (ex_read_start(path, EX_HEADER_MAX, &text, &length, &held, error)) return 1;
    const int failed = format->read(&header, text, length) || ex_header_place(&header);
    free(text);
    return failed;
}

static inline int ex_volume_file_read(ex_volume_file *file, const char *path, ex_error *error) {
    return ex_volume_file_read_array(file, path, NULL, error);
}

#endif /* EX_VOLUME_FILE_H */
