/* volume_header.h: what the formats of volume_file.h have in common: fields with names, numbers in text, a placement.
 */

#ifndef EX_VOLUME_HEADER_H
#define EX_VOLUME_HEADER_H

#include "volume.h"

#include <ctype.h>
#include <strings.h>

/* What a header says. */
typedef struct ex_volume_file {
    ex_voxel_file voxels;
    double origin[3];  /* the center of the first voxel */
    double step[3][3]; /* from one voxel to the next along x, y, z */
    /* The directions that the world's coordinates have in a patient, as the file names them: "RAS" is right, anterior,
       superior. "": unknown. Nothing is converted. */
    char space[64];
} ex_volume_file;

enum { EX_HEADER_MAX = 1 << 20, EX_NPY_HEADER_MAX = 1 << 16 }; /* bytes; real headers have a few hundred */

/* NRRD's axes in the order of the file; one may be the components of each voxel. */
typedef struct ex_header_axes {
    int count;                                   /* 0: not known yet */
    double size[4], spacing[4], direction[4][3]; /* spacing NaN: none */
    int has_direction[4], is_component[4];
} ex_header_axes;

/* The state of reading a header. */
typedef struct ex_header {
    const char *path;
    ex_volume_file *file;
    double spacing[3], direction[3][3]; /* file->step is their product */
    const char *placed_by;              /* the field that specified them, for errors; NULL: none */
    uint64_t seen;                      /* one bit per row of the format's table of fields */
    size_t end;                         /* bytes of the header */
    int lines_to_skip;                  /* lines before the voxels */
    int detached;                       /* 1: the voxels are in another file */
    ex_header_axes axes;
    const char *array; /* the one to read, of several in the file; NULL: the only one */
    ex_error *error;
} ex_header;

/* Reads the value of a field, or fails with a line that names the file and the field. May change the value. */
typedef int (*ex_header_fn)(ex_header *header, const char *field, char *value);

typedef struct ex_header_field {
    const char *name;
    ex_header_fn read; /* NULL: the field is ignored */
    int required;
} ex_header_field;

typedef struct ex_header_type {
    const char *name;
    ex_type type;
} ex_header_type;

static inline int ex_header_fail(const ex_header *header, const char *field, const char *value, const char *why) {
    return ex_fail(header->error, "%s: %s: '%s' %s", header->path, field, ex_quoted(value).text, why);
}

static inline const char *ex_skip_spaces(const char *text) {
    while (*text == ' ' || *text == '\t') ++text;
    return text;
}

/* Whether two names are the same except for case and blanks: NRRD has both "data file" and "datafile". */
static inline int ex_header_same_name(const char *left, const char *right) {
    for (;;) {
        while (*left == ' ') ++left;
        while (*right == ' ') ++right;
        if (tolower((unsigned char)*left) != tolower((unsigned char)*right)) return 0;
        if (!*left) return 1;
        ++left, ++right;
    }
}

/* Finds a field by its name and reads its value. `known` becomes 0 if there is no such field. */
static inline int ex_header_read_field(ex_header *header, const ex_header_field *fields, const char *name, char *value,
                                       int *known) {
    *known = 0;
    for (int i = 0; fields[i].name; ++i) {
        if (!ex_header_same_name(fields[i].name, name)) continue;
        *known = 1;
        if (header->seen >> i & 1)
            return ex_header_fail(header, fields[i].name, value, "is a second value of this field");
        header->seen |= (uint64_t)1 << i;
        return fields[i].read ? fields[i].read(header, fields[i].name, value) : 0;
    }
    return 0;
}

static inline int ex_header_has(const ex_header *header, const ex_header_field *fields, const char *name) {
    for (int i = 0; fields[i].name; ++i)
        if (strcmp(fields[i].name, name) == 0) return (int)(header->seen >> i & 1);
    return 0;
}

static inline int ex_header_check_required(const ex_header *header, const ex_header_field *fields) {
    for (int i = 0; fields[i].name; ++i)
        if (fields[i].required && !ex_header_has(header, fields, fields[i].name))
            return ex_fail(header->error, "%s: %s: the header has no such field", header->path, fields[i].name);
    return 0;
}

/* Parses exactly `count` numbers with blanks between them, each within `lo`..`hi`. */
static inline int ex_header_numbers(const ex_header *header, const char *field, const char *value, int count, double lo,
                                    double hi, double *out) {
    const char *at = value;
    for (int i = 0; i < count; ++i) {
        char *end;
        out[i] = strtod(at, &end);
        if (end == at) return ex_header_fail(header, field, value, "has too few numbers");
        if (!(out[i] >= lo && out[i] <= hi)) return ex_header_fail(header, field, value, "has a number out of range");
        at = end;
    }
    if (*at) return ex_header_fail(header, field, value, "has too many numbers, or something else");
    return 0;
}

static inline int ex_header_integer(const ex_header *header, const char *field, const char *value, double lo, double hi,
                                    double *out) {
    if (ex_header_numbers(header, field, value, 1, lo, hi, out)) return 1;
    return *out == floor(*out) ? 0 : ex_header_fail(header, field, value, "is not a whole number");
}

static inline int ex_header_coordinates(const ex_header *header, const char *field, const char *value, int count,
                                        double *out) {
    return ex_header_numbers(header, field, value, count, -EX_COORDINATE_MAX, EX_COORDINATE_MAX, out);
}

static inline int ex_header_set_size(ex_header *header, const char *field, const char *value, const double sizes[3]) {
    for (int a = 0; a < 3; ++a) {
        if (!(sizes[a] >= 1 && sizes[a] <= 65536 && sizes[a] == floor(sizes[a])))
            return ex_header_fail(header, field, value, "is not three whole numbers within 1..65536");
        header->file->voxels.size[a] = (int)sizes[a];
    }
    return 0;
}

/* Numbers per voxel. */
static inline int ex_header_set_components(ex_header *header, const char *field, const char *value, double count) {
    header->file->voxels.components = (int)fmin(fmax(count, 0), 100);
    if (count == 1 || count == 3) return 0;
    return ex_header_fail(header, field, value, "is not supported: only 1 and 3 numbers per voxel are");
}

static inline int ex_header_set_type(ex_header *header, const char *field, const char *value,
                                     const ex_header_type *types) {
    for (int i = 0; types[i].name; ++i)
        if (strcmp(types[i].name, value) == 0) {
            header->file->voxels.type = types[i].type;
            return 0;
        }
    return ex_header_fail(header, field, value,
                          "is not supported: only integers of up to 64 bits, half, float and double are");
}

static inline void ex_header_set_space(ex_header *header, const char *space) {
    const ex_quote quote = ex_quoted(space);
    memcpy(header->file->space, quote.text, sizeof quote.text);
}

static inline int ex_header_dimension(ex_header *header, const char *field, char *value) {
    double dimension;
    if (ex_header_integer(header, field, value, 0, 1e9, &dimension)) return 1;
    return dimension == 3 ? 0 : ex_header_fail(header, field, value, "is not supported: only 3 dimensions are");
}

static inline int ex_header_size(ex_header *header, const char *field, char *value) {
    double sizes[3];
    if (ex_header_numbers(header, field, value, 3, -1e18, 1e18, sizes)) return 1;
    return ex_header_set_size(header, field, value, sizes);
}

static inline int ex_header_spacing(ex_header *header, const char *field, char *value) {
    if (!header->placed_by) header->placed_by = field;
    if (ex_header_coordinates(header, field, value, 3, header->spacing)) return 1;
    for (int a = 0; a < 3; ++a)
        if (header->spacing[a] == 0) return ex_header_fail(header, field, value, "has a 0");
    return 0;
}

/* The file of the voxels, relative to the header. */
static inline int ex_header_data_file(ex_header *header, const char *field, char *value) {
    if (strncmp(value, "LIST", 4) == 0 || strchr(value, '%'))
        return ex_header_fail(header, field, value, "is more than one file, which is not supported");
    if (!*value) return ex_header_fail(header, field, value, "is not the name of a file");
    char *path = ex_path_beside(header->path, value);
    const int length = snprintf(header->file->voxels.path, EX_PATH_MAX, "%s", path);
    free(path);
    if (length >= EX_PATH_MAX) return ex_header_fail(header, field, value, "is too long");
    if (access(header->file->voxels.path, R_OK) != 0) return ex_header_fail(header, field, value, strerror(errno));
    header->detached = 1;
    return 0;
}

/* The number of bytes before the voxels; -1: the voxels are at the end of the file. */
static inline int ex_header_bytes_to_skip(ex_header *header, const char *field, char *value) {
    double bytes;
    if (ex_header_integer(header, field, value, -1, 1e15, &bytes)) return 1;
    header->file->voxels.at_end = bytes < 0;
    header->file->voxels.offset = bytes < 0 ? 0 : (uint64_t)bytes;
    return 0;
}

/* Combines spacing and directions, once all fields are read. */
static inline int ex_header_place(ex_header *header) {
    const double(*d)[3] = (const double(*)[3])header->direction;
    const char *field = header->placed_by ? header->placed_by : "placement";
    const double turn = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) +
                        d[0][1] * (d[1][2] * d[2][0] - d[1][0] * d[2][2]) +
                        d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
    if (turn == 0) return ex_fail(header->error, "%s: %s: the three axes lie in one plane", header->path, field);
    for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 3; ++i) {
            header->file->step[a][i] = d[a][i] * header->spacing[a];
            if (!(fabs(header->file->step[a][i]) * header->file->voxels.size[a] <= EX_COORDINATE_MAX))
                return ex_fail(header->error, "%s: %s: the volume's edges are not within 1e15", header->path, field);
        }
    return 0;
}

/* The placement of the volume's box, which extends half a voxel beyond the centers of the outermost voxels. */
static inline sps_placement ex_volume_file_placement(const ex_volume_file *file) {
    sps_placement placement;
    for (int i = 0; i < 3; ++i) {
        placement.origin[i] = file->origin[i];
        for (int a = 0; a < 3; ++a) {
            placement.origin[i] -= 0.5 * file->step[a][i];
            placement.axis[a][i] = file->step[a][i] * file->voxels.size[a];
        }
    }
    return placement;
}

#endif /* EX_VOLUME_HEADER_H */
