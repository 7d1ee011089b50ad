/* mesh.h: triangles in memory, built corner by corner or loaded from a Wavefront OBJ file, and their normals. */

#ifndef EX_MESH_H
#define EX_MESH_H

#include "files.h"
#include "vectors.h"

/* ---------------------------------------------------------------------------------------- putting a mesh together */

/* Triangles with a normal at each corner. */
typedef struct ex_mesh {
    sps_triangle *triangles;
    size_t triangle_count;
    double lo[3], hi[3]; /* bounds; lo > hi without triangles */
} ex_mesh;

typedef struct ex_corner {
    size_t position; /* index */
    size_t normal;   /* index, or EX_NOT_GIVEN: to be computed */
    size_t uv;       /* index, or EX_NOT_GIVEN: 0 */
} ex_corner;
#define EX_NOT_GIVEN ((size_t)-1)

/* A mesh under construction. Zero-initialize it. */
typedef struct ex_builder {
    float *positions, *normals, *uvs; /* packed triples; the third number of a texture coordinate is not used */
    ex_corner *corners;               /* three per triangle */
    size_t position_count, position_capacity, normal_count, normal_capacity, uv_count, uv_capacity;
    size_t corner_count, corner_capacity;
} ex_builder;

/* Appends three numbers to a list of packed triples. Returns the index of the new triple. */
static inline size_t ex_add_triple(float **list, size_t *count, size_t *capacity, double x, double y, double z) {
    *list = (float *)ex_grow(*list, *count, capacity, 3 * sizeof(float));
    float *triple = *list + 3 * *count;
    triple[0] = (float)x, triple[1] = (float)y, triple[2] = (float)z;
    return (*count)++;
}

static inline size_t ex_add_position(ex_builder *builder, double x, double y, double z) {
    return ex_add_triple(&builder->positions, &builder->position_count, &builder->position_capacity, x, y, z);
}

static inline size_t ex_add_normal(ex_builder *builder, double x, double y, double z) {
    return ex_add_triple(&builder->normals, &builder->normal_count, &builder->normal_capacity, x, y, z);
}

static inline size_t ex_add_uv(ex_builder *builder, double u, double v) {
    return ex_add_triple(&builder->uvs, &builder->uv_count, &builder->uv_capacity, u, v, 0);
}

static inline void ex_add_corner(ex_builder *builder, ex_corner corner) {
    builder->corners =
        (ex_corner *)ex_grow(builder->corners, builder->corner_count, &builder->corner_capacity, sizeof(ex_corner));
    builder->corners[builder->corner_count++] = corner;
}

static inline void ex_add_triangle(ex_builder *builder, size_t a, size_t b, size_t c) {
    const size_t positions[3] = {a, b, c};
    for (int i = 0; i < 3; ++i) {
        const ex_corner corner = {positions[i], EX_NOT_GIVEN, EX_NOT_GIVEN};
        ex_add_corner(builder, corner);
    }
}

static inline void ex_add_quad(ex_builder *builder, size_t a, size_t b, size_t c, size_t d) {
    ex_add_triangle(builder, a, b, c);
    ex_add_triangle(builder, a, c, d);
}

static inline void ex_builder_free(ex_builder *builder) {
    free(builder->positions);
    free(builder->normals);
    free(builder->uvs);
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

/* Numbers the distinct positions, and returns the number of each: files often repeat positions along seams. */
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

/* Corners sorted by point: those that meet at point p are list[first[p]] .. list[first[p + 1] - 1]. */
typedef struct ex_star {
    size_t *points, *first, *list;
} ex_star;

static inline ex_star ex_star_make(const ex_builder *builder) {
    ex_star star;
    size_t point_count = 0;
    star.points = ex_weld(builder, &point_count);
    star.first = (size_t *)ex_allocate(point_count + 2, sizeof *star.first);
    star.list = (size_t *)ex_allocate(builder->corner_count, sizeof *star.list);
    /* A counting sort. Counts are stored two places up: after the list is filled, first[p] is where p starts. */
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

/* The mean normal, weighted by area, of the triangles at this corner whose normals differ from its own by less than the
   crease angle. Zero for a triangle without area, which tells the library to use the triangle's own. */
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

/* Makes triangles of what was added, computes missing normals, and frees the builder. Edges sharper than crease_degrees
   stay sharp; 60 suits most models. */
static inline void ex_mesh_build(ex_mesh *mesh, ex_builder *builder, double crease_degrees) {
    const double crease_cosine = cos(crease_degrees * 3.14159265358979 / 180.0);
    ex_star star = ex_star_make(builder);
    mesh->triangle_count = builder->corner_count / 3;
    mesh->triangles = (sps_triangle *)ex_allocate(mesh->triangle_count, sizeof *mesh->triangles);
    for (size_t i = 0; i < 3 * mesh->triangle_count; ++i) {
        sps_triangle *triangle = mesh->triangles + i / 3;
        const ex_corner corner = builder->corners[i];
        memcpy(triangle->position[i % 3], builder->positions + 3 * corner.position, 3 * sizeof(float));
        if (corner.uv != EX_NOT_GIVEN)
            memcpy(triangle->uv[i % 3], builder->uvs + 3 * corner.uv, sizeof triangle->uv[0]);
        if (corner.normal != EX_NOT_GIVEN)
            memcpy(triangle->normal[i % 3], builder->normals + 3 * corner.normal, 3 * sizeof(float));
        else
            ex_smooth_normal(builder, &star, i, crease_cosine, triangle->normal[i % 3]);
    }
    ex_star_free(&star);
    ex_builder_free(builder);
    ex_mesh_measure(mesh);
}

/* sps_mesh.read_fn over an ex_mesh. Set has_normals to 1. */
static inline int ex_mesh_read(void *user, size_t first, size_t count, sps_triangle *out) {
    const ex_mesh *mesh = (const ex_mesh *)user;
    memcpy(out, mesh->triangles + first, count * sizeof *out);
    return 0;
}

static inline void ex_mesh_free(ex_mesh *mesh) {
    free(mesh->triangles);
    memset(mesh, 0, sizeof *mesh);
}

/* --------------------------------------------------------------------------------------------------------- polygons */

enum { EX_FACE_CORNERS = 4096 }; /* time grows with the square of the number of corners */

/* A polygon that is cut into triangles, and what is left of it. Corners must be in one plane, or nearly so. */
typedef struct ex_face {
    int count;
    ex_corner corners[EX_FACE_CORNERS];
    double points[EX_FACE_CORNERS][2]; /* in a plane where the outline runs counterclockwise */
    int next[EX_FACE_CORNERS], previous[EX_FACE_CORNERS];
    char ears[EX_FACE_CORNERS]; /* what ex_face_ear says of each corner */
    int may_touch;              /* 1: triangles that other corners touch from outside are ears, too */
} ex_face;

/* Twice the area of a triangle; negative if it runs clockwise. */
static inline double ex_face_area(const ex_face *face, int a, int b, int c) {
    const double *p = face->points[a], *q = face->points[b], *r = face->points[c];
    return (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
}

static inline int ex_face_same(const ex_face *face, int a, int b) {
    return face->points[a][0] == face->points[b][0] && face->points[a][1] == face->points[b][1];
}

/* Projects along the axis that is nearest to Newell's normal. Leaving out a coordinate rounds nothing. */
static inline void ex_face_project(ex_face *face, const ex_builder *builder) {
    double normal[3] = {0, 0, 0};
    int axis = 0;
    for (int i = 0; i < face->count; ++i) {
        const float *p = builder->positions + 3 * face->corners[i].position;
        const float *q = builder->positions + 3 * face->corners[(i + 1) % face->count].position;
        for (int a = 0; a < 3; ++a) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            normal[a] += ((double)p[b] - (double)q[b]) * ((double)p[c] + (double)q[c]);
        }
    }
    for (int a = 1; a < 3; ++a)
        if (fabs(normal[a]) > fabs(normal[axis])) axis = a;
    for (int i = 0; i < face->count; ++i) {
        const float *p = builder->positions + 3 * face->corners[i].position;
        face->points[i][0] = (double)p[(axis + (normal[axis] < 0 ? 2 : 1)) % 3];
        face->points[i][1] = (double)p[(axis + (normal[axis] < 0 ? 1 : 2)) % 3];
    }
}

/* Whether the triangle of a corner and its neighbours may be cut off: 2 where the outline turns back on itself or
   stands still, which must go first; otherwise 1 or 0. */
static inline char ex_face_ear(const ex_face *face, int b) {
    const int a = face->previous[b], c = face->next[b];
    const double *p = face->points[a], *q = face->points[b], *r = face->points[c], area = ex_face_area(face, a, b, c);
    if (area == 0 && (q[0] - p[0]) * (r[0] - q[0]) + (q[1] - p[1]) * (r[1] - q[1]) <= 0) return 2;
    if (!(area > 0)) return 0;
    for (int i = face->next[c]; i != a; i = face->next[i]) {
        const double sides[3] = {ex_face_area(face, a, b, i), ex_face_area(face, b, c, i), ex_face_area(face, c, a, i)};
        const double least = fmin(sides[0], fmin(sides[1], sides[2]));
        if (least < 0 || (least == 0 && face->may_touch)) continue;
        if (!ex_face_same(face, i, a) && !ex_face_same(face, i, c)) return 0;
    }
    return 1;
}

/* Finds what is to be cut off, from a corner on; -1: nothing. */
static inline int ex_face_find(const ex_face *face, int corner) {
    int found = -1, at = corner;
    do {
        if (face->ears[at] == 2) return at;
        if (face->ears[at] && found < 0) found = at;
        at = face->next[at];
    } while (at != corner);
    return found;
}

static inline void ex_face_mark(ex_face *face, int corner) {
    int at = corner;
    do {
        face->ears[at] = ex_face_ear(face, at);
        at = face->next[at];
    } while (at != corner);
}

/* Adds the triangle of a corner and its neighbours, and takes the corner out. Returns the next one. */
static inline int ex_face_cut(ex_face *face, int corner, ex_builder *builder) {
    const int a = face->previous[corner], c = face->next[corner];
    ex_add_corner(builder, face->corners[a]);
    ex_add_corner(builder, face->corners[corner]);
    ex_add_corner(builder, face->corners[c]);
    face->next[a] = c, face->previous[c] = a;
    return c;
}

/* Adds a polygon of n corners as n - 2 triangles, by cutting off ears. A convex one becomes a fan around its first
   corner. What is left of one that intersects itself becomes a fan, too. Cutting a corner off changes what its
   neighbours are; and others, where corners touch, so that all are looked at again if nothing is left to cut off. That
   happens only a few times: time stays within a square. */
static inline void ex_face_add(ex_face *face, ex_builder *builder) {
    enum { MARKED_AGAIN = 16 };
    int at = 1, left = face->count, marked = 0;
    for (int i = 0; i < left; ++i) face->next[i] = (i + 1) % left, face->previous[i] = (i + left - 1) % left;
    face->may_touch = 0;
    ex_face_project(face, builder);
    ex_face_mark(face, at);
    while (left > 3) {
        const int ear = ex_face_find(face, at);
        if (ear >= 0) {
            at = ex_face_cut(face, ear, builder), --left;
            face->ears[at] = ex_face_ear(face, at);
            face->ears[face->previous[at]] = ex_face_ear(face, face->previous[at]);
        } else if (marked++ < MARKED_AGAIN) {
            ex_face_mark(face, at);
            if (ex_face_find(face, at) < 0 && face->may_touch++) break;
        } else {
            break;
        }
    }
    for (; left >= 3; --left) at = ex_face_cut(face, at, builder);
}

/* -------------------------------------------------------------------------------------------------- Wavefront OBJ */

/* Reads three numbers after "v", "vn" or "vt", where those from `least` on may be left out and are 0 then, and ignores
   what follows (w, a color). Returns what is wrong, or NULL. */
static inline const char *ex_obj_numbers(char *text, int least, double out[3]) {
    for (int i = 0; i < 3; ++i) {
        char *end;
        out[i] = strtod(text, &end);
        if (end == text && i >= least) continue;
        if (end == text) return least == 3 ? "not three numbers" : "not a number";
        if (!(fabs(out[i]) <= EX_COORDINATE_MAX)) return "a number that is not within 1e15";
        text = end;
    }
    return NULL;
}

/* Resolves an index: 1 is the first, -1 is the latest. */
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
    corner->normal = corner->uv = EX_NOT_GIVEN;
    if (ex_obj_index(text, builder->position_count, &corner->position)) return 1;
    if (**text == '/') {
        ++*text;
        if (**text != '/' && ex_obj_index(text, builder->uv_count, &corner->uv)) return 1;
        if (**text == '/') {
            ++*text;
            if (ex_obj_index(text, builder->normal_count, &corner->normal)) return 1;
        }
    }
    return **text != '\0' && **text != ' ' && **text != '\t' && **text != '\r';
}

/* Reads a face of three corners or more, and adds it. Returns what is wrong, or NULL. */
static inline const char *ex_obj_face(char *text, ex_builder *builder, ex_face *face) {
    face->count = 0;
    for (text = ex_skip_blanks(text); *text && *text != '#'; text = ex_skip_blanks(text)) {
        if (face->count == EX_FACE_CORNERS) return "a face of more than 4096 corners";
        if (ex_obj_corner(&text, builder, &face->corners[face->count++]))
            return "not a face, or an index that is not there";
    }
    if (face->count < 3) return "not a face, or an index that is not there";
    ex_face_add(face, builder);
    return NULL;
}

/* Whether a line begins with this word. */
static inline int ex_obj_begins(const char *line, const char *word) {
    const size_t length = strlen(word);
    return strncmp(line, word, length) == 0 && (line[length] == ' ' || line[length] == '\t');
}

/* Reads positions, normals, texture coordinates and faces, and skips everything else. Returns what is wrong, or NULL.
 */
static inline const char *ex_obj_line(char *line, ex_builder *builder, ex_face *face) {
    double numbers[3];
    const char *wrong = NULL;
    line = ex_skip_blanks(line);
    if (ex_obj_begins(line, "v")) {
        wrong = ex_obj_numbers(line + 1, 3, numbers);
        if (!wrong) ex_add_position(builder, numbers[0], numbers[1], numbers[2]);
    } else if (ex_obj_begins(line, "vn")) {
        wrong = ex_obj_numbers(line + 2, 3, numbers);
        if (!wrong) ex_add_normal(builder, numbers[0], numbers[1], numbers[2]);
    } else if (ex_obj_begins(line, "vt")) {
        wrong = ex_obj_numbers(line + 2, 1, numbers);
        if (!wrong) ex_add_uv(builder, numbers[0], numbers[1]);
    } else if (ex_obj_begins(line, "f")) {
        wrong = ex_obj_face(line + 1, builder, face);
    }
    return wrong;
}

/* Loads a Wavefront OBJ file. crease_degrees: see ex_mesh_build. */
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
    ex_face *face = (ex_face *)ex_allocate(1, sizeof *face);
    while (!wrong && (line = ex_next_line(&rest, text + length)) != NULL) {
        ++line_number;
        wrong = ex_obj_line(line, &builder, face);
    }
    if (wrong)
        failed = ex_fail(error, "%s:%d: %s: '%s'", path, line_number, wrong, ex_quoted(line).text);
    else if (builder.corner_count == 0)
        failed = ex_fail(error, "%s: no faces", path);
    if (failed)
        ex_builder_free(&builder);
    else
        ex_mesh_build(mesh, &builder, crease_degrees);
    free(face);
    free(text);
    return failed;
}

#endif /* EX_MESH_H */
