/* shapes.h: polygon shapes: parametric surfaces, surfaces of revolution, tubes, boxes, a mushroom. */

#ifndef EX_SHAPES_H
#define EX_SHAPES_H

#include "densities.h"
#include "mesh.h"

/* Appends one triangle. The array doubles whenever its count is a power of two, so that no capacity is stored. */
static inline void ex_shape_triangle(ex_mesh *mesh, const sps_triangle *triangle) {
    const size_t count = mesh->triangle_count;
    size_t capacity = count;
    if ((count & (count - 1)) == 0)
        mesh->triangles = (sps_triangle *)ex_grow(mesh->triangles, count, &capacity, sizeof *triangle);
    mesh->triangles[mesh->triangle_count++] = *triangle;
}

/* The sps_mesh that reads its triangles from `mesh`, which must stay where it is until the scene is rendered. */
static inline sps_mesh ex_shape_mesh(ex_mesh *mesh) {
    sps_mesh out;
    memset(&out, 0, sizeof out);
    out.triangle_count = mesh->triangle_count;
    out.read_fn = ex_mesh_read, out.user = mesh;
    out.has_normals = out.has_albedos = 1;
    return out;
}

/* Turned by `angle` about the y axis, then moved to `origin`. */
static inline sps_placement ex_turned(double angle, ex_vec origin) {
    const double c = cos(angle), s = sin(angle);
    const sps_placement r = {{origin.x, origin.y, origin.z}, {{c, 0, -s}, {0, 1, 0}, {s, 0, c}}};
    return r;
}

/* A point of a surface at u,v in 0..1. Also called close to each vertex, for the normals. */
typedef ex_vec (*ex_surface_fn)(const void *shape, double u, double v);
/* The color at u,v; `own` is the color of the shape. */
typedef void (*ex_paint_fn)(const float own[3], double u, double v, float out[3]);

static inline void ex_surface_corner(sps_triangle *t, int corner, ex_surface_fn surface, const void *shape, double u,
                                     double v) {
    const double step = 1e-4,
                 m = ex_clamp(u, 1e-3, 1 - 1e-3); /* off the poles, where the direction of v is undefined */
    const ex_vec du = ex_vec_sub(surface(shape, m + step, v), surface(shape, m - step, v));
    const ex_vec dv = ex_vec_sub(surface(shape, m, v + step), surface(shape, m, v - step));
    t->uv[corner][0] = (float)u, t->uv[corner][1] = (float)v;
    ex_store(t->position[corner], surface(shape, u, v));
    ex_store(t->normal[corner], ex_vec_unit(ex_vec_cross(du, dv)));
}

static inline void ex_shape_surface(ex_mesh *mesh, ex_surface_fn surface, const void *shape, int rows, int columns,
                                    const float color[3], ex_paint_fn paint) {
    static const int corners[2][3][2] = {{{0, 0}, {1, 0}, {1, 1}}, {{0, 0}, {1, 1}, {0, 1}}};
    for (int i = 0; i < rows * columns * 2; ++i) {
        sps_triangle t;
        for (int c = 0; c < 3; ++c) {
            const double u = (double)(i / 2 / columns + corners[i & 1][c][0]) / rows;
            const double v = (double)(i / 2 % columns + corners[i & 1][c][1]) / columns;
            ex_surface_corner(&t, c, surface, shape, u, v);
            if (paint)
                paint(color, u, v, t.albedo[c]);
            else
                memcpy(t.albedo[c], color, sizeof t.albedo[c]);
        }
        ex_shape_triangle(mesh, &t);
    }
}

/* A smooth curve through points of `width` numbers each (uniform Catmull-Rom; straight for two points), t in 0..1. */
static inline double ex_curve(const double *points, int count, int width, int which, double t) {
    const double at = ex_clamp(t, 0, 1) * (count - 1), last = count - 2 > 0 ? count - 2 : 0;
    const int i = (int)fmin(floor(at), last);
    const double f = at - i, p1 = points[i * width + which], p2 = points[(i + 1) * width + which];
    const double p0 = i > 0 ? points[(i - 1) * width + which] : 2 * p1 - p2;
    const double p3 = i + 2 < count ? points[(i + 2) * width + which] : 2 * p2 - p1;
    const double m1 = 0.5 * (p2 - p0), m2 = 0.5 * (p3 - p1);
    return p1 + f * (m1 + f * (3 * (p2 - p1) - 2 * m1 - m2 + f * (2 * (p1 - p2) + m1 + m2)));
}

/* A surface of revolution: `profile` holds pairs (radius, height along the axis). For a crease, make two of them. */
typedef struct ex_lathe {
    const double *profile;
    int count;
    ex_vec base, axis; /* axis: unit */
} ex_lathe;

static inline ex_vec ex_lathe_point(const void *shape, double u, double v) {
    const ex_lathe *l = (const ex_lathe *)shape;
    const double angle = 2 * EX_PI * (v - floor(v)); /* v = 1 equals v = 0, so the seam is watertight */
    const double radius = fmax(ex_curve(l->profile, l->count, 2, 0, u), 0),
                 height = ex_curve(l->profile, l->count, 2, 1, u);
    const ex_vec side = ex_vec_perpendicular(l->axis), other = ex_vec_cross(l->axis, side);
    const ex_vec around = ex_vec_add(ex_vec_scale(side, radius * cos(angle)), ex_vec_scale(other, radius * sin(angle)));
    return ex_vec_add(l->base, ex_vec_add(ex_vec_scale(l->axis, height), around));
}

static inline void ex_shape_lathe(ex_mesh *mesh, const ex_lathe *lathe, int columns, const float color[3],
                                  ex_paint_fn paint) {
    const int fine = paint ? 16 : 6; /* paint is stored per vertex */
    ex_shape_surface(mesh, ex_lathe_point, lathe, lathe->count > 2 ? fine * (lathe->count - 1) : 1, columns, color,
                     paint);
}

/* A closed cylinder from a to b, or a cone, where the radii differ. */
static inline void ex_shape_cylinder(ex_mesh *mesh, ex_vec a, ex_vec b, double radius_a, double radius_b,
                                     const float color[3]) {
    const double length = ex_vec_length(ex_vec_sub(b, a));
    const double side[4] = {radius_a, 0, radius_b, length}, low[4] = {0, 0, radius_a, 0},
                 high[4] = {radius_b, length, 0, length};
    const double *profiles[3] = {side, low, high};
    for (int i = 0; i < 3; ++i) {
        const ex_lathe lathe = {profiles[i], 2, a, ex_vec_unit(ex_vec_sub(b, a))};
        ex_shape_lathe(mesh, &lathe, 32, color, NULL);
    }
}

/* A bent tube: `points` holds x, y, z, radius. The curve should stay roughly perpendicular to `side` (unit). */
typedef struct ex_tube {
    const double *points;
    int count;
    ex_vec side;
} ex_tube;

static inline ex_vec ex_tube_center(const ex_tube *t, double u) {
    return ex_vec_of(ex_curve(t->points, t->count, 4, 0, u), ex_curve(t->points, t->count, 4, 1, u),
                     ex_curve(t->points, t->count, 4, 2, u));
}
static inline ex_vec ex_tube_point(const void *shape, double u, double v) {
    const ex_tube *t = (const ex_tube *)shape;
    const ex_vec along = ex_vec_sub(ex_tube_center(t, u + 1e-3), ex_tube_center(t, u - 1e-3));
    const double angle = 2 * EX_PI * (v - floor(v)), radius = ex_curve(t->points, t->count, 4, 3, u);
    const ex_vec other = ex_vec_unit(ex_vec_cross(t->side, along));
    return ex_vec_add(ex_tube_center(t, u),
                      ex_vec_add(ex_vec_scale(t->side, radius * cos(angle)), ex_vec_scale(other, radius * sin(angle))));
}
static inline void ex_shape_tube(ex_mesh *mesh, const ex_tube *tube, const float color[3]) {
    ex_shape_surface(mesh, ex_tube_point, tube, 8 * (tube->count - 1), 24, color, NULL);
}

/* A flat quadrilateral, corners in order around it, with texture coordinates (0,0), (1,0), (1,1), (0,1). */
static inline void ex_shape_quad(ex_mesh *mesh, ex_vec a, ex_vec b, ex_vec c, ex_vec d, const float color[3]) {
    const ex_vec corners[2][3] = {{a, b, c}, {a, c, d}};
    for (int i = 0; i < 2; ++i) {
        sps_triangle t;
        memset(&t, 0, sizeof t); /* normals of zero: the library uses the triangle's own */
        for (int k = 0; k < 3; ++k) {
            const int corner = k > 0 ? k + i : 0;
            t.uv[k][0] = corner == 1 || corner == 2, t.uv[k][1] = corner > 1;
            ex_store(t.position[k], corners[i][k]);
            memcpy(t.albedo[k], color, sizeof t.albedo[k]);
        }
        ex_shape_triangle(mesh, &t);
    }
}

static inline void ex_shape_box(ex_mesh *mesh, ex_vec low, ex_vec high, const float color[3]) {
    ex_vec p[8];
    for (int i = 0; i < 8; ++i)
        p[i] = ex_vec_of(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
    ex_shape_quad(mesh, p[0], p[1], p[3], p[2], color);
    ex_shape_quad(mesh, p[4], p[5], p[7], p[6], color);
    ex_shape_quad(mesh, p[0], p[1], p[5], p[4], color);
    ex_shape_quad(mesh, p[2], p[3], p[7], p[6], color);
    ex_shape_quad(mesh, p[0], p[2], p[6], p[4], color);
    ex_shape_quad(mesh, p[1], p[3], p[7], p[5], color);
}

/* ----------------------------------------------------------------------------------------------------- a mushroom */

/* Pale dots in rows around the cap. u runs from the rim to the top. */
static inline void ex_paint_dots(const float own[3], double u, double v, float out[3]) {
    double dot = ex_ramp(0.97, 0.99, u);
    for (int row = 0; row < 3; ++row) {
        const int around = 9 - 2 * row;
        const double turn = v * around + 0.37 * row, reach = 1 - (0.40 + 0.19 * row);
        const double across = (turn - floor(turn) - 0.5) / around * 2 * EX_PI * reach * 0.75, along = u - (1 - reach);
        const double size = 0.045 + 0.02 * (ex_hash((int)floor(turn) % around, row, 9) % 100 / 100.0);
        dot = fmax(dot, 1 - ex_ramp(size, size + 0.015, sqrt(across * across + along * along)));
    }
    ex_color(out, ex_mix((double)own[0], 0.80, dot), ex_mix((double)own[1], 0.75, dot),
             ex_mix((double)own[2], 0.64, dot));
}

/* Gills: narrow dark grooves from the stem to the rim. */
static inline void ex_paint_gills(const float own[3], double u, double v, float out[3]) {
    const double shade = 0.8 + 0.2 * cos(2 * EX_PI * 36 * v) - 0.3 * u;
    ex_color(out, shade * (double)own[0], shade * (double)own[1], shade * (double)own[2]);
}

/* A mushroom that grows from `base` along `axis`. `cap` is the radius of its cap. */
static inline void ex_shape_mushroom(ex_mesh *mesh, ex_vec base, ex_vec axis, double height, double cap,
                                     const float color[3], ex_paint_fn paint) {
    static const float cream[3] = {0.66f, 0.57f, 0.43f};
    const double k = cap, rim = height - 0.5 * k;
    const double top[] = {0.90 * k, rim - 0.02 * k, 0.99 * k, rim + 0.03 * k, 0.95 * k, rim + 0.20 * k,
                          0.75 * k, rim + 0.42 * k, 0.40 * k, rim + 0.56 * k, 0.0,      rim + 0.60 * k};
    const double under[] = {0.20 * k, rim + 0.16 * k, 0.55 * k, rim + 0.06 * k, 0.90 * k, rim - 0.02 * k};
    const double stem[] = {0.30 * k,      -0.1 * height, 0.28 * k,     0.06 * height, 0.19 * k,
                           0.35 * height, 0.17 * k,      0.7 * height, 0.20 * k,      rim + 0.2 * k};
    const ex_lathe parts[3] = {
        {top, 6, base, ex_vec_unit(axis)}, {under, 3, base, ex_vec_unit(axis)}, {stem, 5, base, ex_vec_unit(axis)}};
    ex_shape_lathe(mesh, &parts[0], paint ? 256 : 64, color, paint);
    ex_shape_lathe(mesh, &parts[1], 216, cream, ex_paint_gills);
    ex_shape_lathe(mesh, &parts[2], 32, cream, NULL);
}

#endif /* EX_SHAPES_H */
