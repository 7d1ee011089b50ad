/* SPDX-License-Identifier: MIT OR Unlicense

modelling.h: what the scene programs build their pictures from: noise, polygon shapes, densities and a tree.
Include after common.h. Everything is deterministic: the same program makes the same picture.
World axes: x to the right, y up, z towards the viewer. Colours are linear. */

#ifndef EX_MODELLING_H
#define EX_MODELLING_H

#define EX_PI 3.14159265358979323846

/* ---------------------------------------------------------------------------------------------- vectors */

typedef struct ex_vec {
    double x, y, z;
} ex_vec;

static inline ex_vec ex_vec_of(double x, double y, double z) {
    const ex_vec r = {x, y, z};
    return r;
}
static inline ex_vec ex_vec_add(ex_vec a, ex_vec b) { return ex_vec_of(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline ex_vec ex_vec_sub(ex_vec a, ex_vec b) { return ex_vec_of(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline ex_vec ex_vec_scale(ex_vec a, double s) { return ex_vec_of(a.x * s, a.y * s, a.z * s); }
static inline double ex_vec_dot(ex_vec a, ex_vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline double ex_vec_length(ex_vec a) { return sqrt(ex_vec_dot(a, a)); }
static inline ex_vec ex_vec_cross(ex_vec a, ex_vec b) {
    return ex_vec_of(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline ex_vec ex_vec_unit(ex_vec a) {
    const double length = ex_vec_length(a);
    return length > 0 ? ex_vec_scale(a, 1 / length) : a;
}
/* Some unit vector square to `a`. */
static inline ex_vec ex_vec_square_to(ex_vec a) {
    return ex_vec_unit(ex_vec_cross(a, fabs(a.y) < 0.9 * ex_vec_length(a) ? ex_vec_of(0, 1, 0) : ex_vec_of(1, 0, 0)));
}
static inline double ex_clamp(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
static inline double ex_mix(double a, double b, double t) { return a + (b - a) * t; }
/* 0 below `low`, 1 above `high`, smooth in between. */
static inline double ex_ramp(double low, double high, double x) {
    const double t = ex_clamp((x - low) / (high - low), 0, 1);
    return t * t * (3 - 2 * t);
}

/* ------------------------------------------------------------------------------------------------ noise */

/* Scrambles a lattice point into 32 bits: multiply and fold, which is all that a noise lattice needs. */
static inline uint32_t ex_hash(int x, int y, int z) {
    uint32_t h = (uint32_t)x * 0x8DA6B343u + (uint32_t)y * 0xD8163841u + (uint32_t)z * 0xCB1AB31Fu;
    h = (h ^ (h >> 15)) * 0x2C9277B5u;
    h = (h ^ (h >> 13)) * 0x5F356495u;
    return h ^ (h >> 16);
}

/* 0..1 from a running counter. */
static inline double ex_random(uint32_t *state) { return ex_hash((int)(*state)++, 71, 5) / 4294967296.0; }

/* The lattice point's gradient (three 10-bit parts of its hash) times the offset from it. */
static inline double ex_lattice_slope(int x, int y, int z, double dx, double dy, double dz) {
    const uint32_t h = ex_hash(x, y, z);
    return (h % 1024 / 511.5 - 1) * dx + (h / 1024 % 1024 / 511.5 - 1) * dy + (h / 1048576 % 1024 / 511.5 - 1) * dz;
}

/* Gradient noise: 0 at lattice points, second derivatives continuous, mostly within -1..1. */
static inline double ex_noise(ex_vec p) {
    const double fx = floor(p.x), fy = floor(p.y), fz = floor(p.z), part[3] = {p.x - fx, p.y - fy, p.z - fz};
    double fade[3], sum = 0;
    for (int i = 0; i < 3; ++i) fade[i] = part[i] * part[i] * part[i] * (part[i] * (part[i] * 6 - 15) + 10);
    for (int c = 0; c < 8; ++c) {
        const int i = c & 1, j = c >> 1 & 1, k = c >> 2;
        const double weight = (i ? fade[0] : 1 - fade[0]) * (j ? fade[1] : 1 - fade[1]) * (k ? fade[2] : 1 - fade[2]);
        sum += weight * ex_lattice_slope((int)fx + i, (int)fy + j, (int)fz + k, part[0] - i, part[1] - j, part[2] - k);
    }
    return 1.5 * sum;
}

/* Octaves of noise, each at double frequency and half strength; the lattices are shifted so that their zeros part. */
static inline double ex_fractal(ex_vec p, int octaves) {
    double sum = 0, strength = 1;
    for (int i = 0; i < octaves; ++i, strength *= 0.5) {
        sum += strength * ex_noise(p);
        p = ex_vec_of(2 * p.x + 3.7, 2 * p.y + 1.3, 2 * p.z + 5.1);
    }
    return sum;
}

/* The same with absolute values: creases where the noise passes zero, as between eddies. */
static inline double ex_turbulence(ex_vec p, int octaves) {
    double sum = 0, strength = 1;
    for (int i = 0; i < octaves; ++i, strength *= 0.5) {
        sum += strength * fabs(ex_noise(p));
        p = ex_vec_of(2 * p.x + 3.7, 2 * p.y + 1.3, 2 * p.z + 5.1);
    }
    return sum;
}

/* -------------------------------------------------------------------------------------------- densities */

/* Signed distances: negative inside. */
static inline double ex_box_distance(ex_vec p, ex_vec center, ex_vec half, double rounding) {
    const ex_vec q = ex_vec_of(fabs(p.x - center.x) - half.x + rounding, fabs(p.y - center.y) - half.y + rounding,
                               fabs(p.z - center.z) - half.z + rounding);
    const double inside = fmin(fmax(q.x, fmax(q.y, q.z)), 0);
    return ex_vec_length(ex_vec_of(fmax(q.x, 0), fmax(q.y, 0), fmax(q.z, 0))) + inside - rounding;
}
/* A ring around `axis` (unit): `major` from the centre to the middle of the rod, `minor` the rod's radius. */
static inline double ex_ring_distance(ex_vec p, ex_vec center, ex_vec axis, double major, double minor) {
    const ex_vec d = ex_vec_sub(p, center);
    const double along = ex_vec_dot(d, axis), around = ex_vec_length(ex_vec_sub(d, ex_vec_scale(axis, along)));
    return sqrt((around - major) * (around - major) + along * along) - minor;
}
/* A rod from a to b with round ends whose radius goes from radius_a to radius_b. */
static inline double ex_rod_distance(ex_vec p, ex_vec a, ex_vec b, double radius_a, double radius_b) {
    const ex_vec ab = ex_vec_sub(b, a), ap = ex_vec_sub(p, a);
    const double t = ex_clamp(ex_vec_dot(ap, ab) / ex_vec_dot(ab, ab), 0, 1);
    return ex_vec_length(ex_vec_sub(ap, ex_vec_scale(ab, t))) - ex_mix(radius_a, radius_b, t);
}
/* 1 inside, 0 outside, over a band `width` wide about the surface. A band of some voxels carries a gradient. */
static inline double ex_solid(double distance, double width) {
    return 1 - ex_ramp(-0.5 * width, 0.5 * width, distance);
}

/* The box low..high, with `voxels` along its longest side and cubic voxels. */
static inline void ex_volume_box(sps_volume *volume, ex_vec low, ex_vec high, int voxels) {
    const double side[3] = {high.x - low.x, high.y - low.y, high.z - low.z};
    const double voxel = fmax(side[0], fmax(side[1], side[2])) / voxels;
    for (int i = 0; i < 3; ++i) {
        volume->size[i] = (int)ceil(side[i] / voxel - 1e-6);
        volume->placement.axis[i][i] = volume->size[i] * voxel;
    }
    volume->placement.origin[0] = low.x, volume->placement.origin[1] = low.y, volume->placement.origin[2] = low.z;
}

/* --------------------------------------------------------------------------------------- polygon shapes */

static inline void ex_color(float out[3], double r, double g, double b) {
    out[0] = (float)r, out[1] = (float)g, out[2] = (float)b;
}
static inline void ex_store(float out[3], ex_vec v) { ex_color(out, v.x, v.y, v.z); }

/* Appends one triangle. The array doubles whenever its count is a power of two, so no capacity is kept. */
static inline void ex_shape_triangle(ex_mesh *mesh, const sps_triangle *triangle) {
    const size_t count = mesh->triangle_count;
    size_t capacity = count;
    if ((count & (count - 1)) == 0)
        mesh->triangles = (sps_triangle *)ex_grow(mesh->triangles, count, &capacity, sizeof *triangle);
    mesh->triangles[mesh->triangle_count++] = *triangle;
}

/* Makes `out` deliver the shapes that were added to `mesh`, which stays where it is until the scene is rendered. */
static inline void ex_shape_use(ex_mesh *mesh, sps_mesh *out) {
    out->triangle_count = mesh->triangle_count;
    out->read_fn = ex_mesh_read, out->user = mesh;
    out->has_normals = out->has_colors = 1;
}

/* Turned by `angle` about the y axis, then moved to `origin`. */
static inline sps_placement ex_turned(double angle, ex_vec origin) {
    const double c = cos(angle), s = sin(angle);
    const sps_placement r = {{origin.x, origin.y, origin.z}, {{c, 0, -s}, {0, 1, 0}, {s, 0, c}}};
    return r;
}

/* A curved surface over u,v in 0..1. It is called a little beside every vertex too, for the normals. */
typedef ex_vec (*ex_surface_fn)(const void *shape, double u, double v);
/* Colour at u,v, given the shape's own. */
typedef void (*ex_paint_fn)(const float own[3], double u, double v, float out[3]);

static inline void ex_surface_corner(sps_triangle *t, int corner, ex_surface_fn surface, const void *shape, double u,
                                     double v) {
    const double step = 1e-4, m = ex_clamp(u, 1e-3, 1 - 1e-3); /* off the poles, where v has no direction */
    const ex_vec du = ex_vec_sub(surface(shape, m + step, v), surface(shape, m - step, v));
    const ex_vec dv = ex_vec_sub(surface(shape, m, v + step), surface(shape, m, v - step));
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
                paint(color, u, v, t.color[c]);
            else
                memcpy(t.color[c], color, sizeof t.color[c]);
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

/* Surface of revolution: `profile` holds pairs (radius, height along the axis). End a call where a crease is wanted. */
typedef struct ex_lathe {
    const double *profile;
    int count;
    ex_vec base, axis; /* axis: unit */
} ex_lathe;

static inline ex_vec ex_lathe_point(const void *shape, double u, double v) {
    const ex_lathe *l = (const ex_lathe *)shape;
    const double angle = 2 * EX_PI * (v - floor(v)); /* 1 falls on 0, so the seam is watertight */
    const double radius = fmax(ex_curve(l->profile, l->count, 2, 0, u), 0),
                 height = ex_curve(l->profile, l->count, 2, 1, u);
    const ex_vec side = ex_vec_square_to(l->axis), other = ex_vec_cross(l->axis, side);
    const ex_vec around = ex_vec_add(ex_vec_scale(side, radius * cos(angle)), ex_vec_scale(other, radius * sin(angle)));
    return ex_vec_add(l->base, ex_vec_add(ex_vec_scale(l->axis, height), around));
}

static inline void ex_shape_lathe(ex_mesh *mesh, const ex_lathe *lathe, int columns, const float color[3],
                                  ex_paint_fn paint) {
    const int fine = paint ? 16 : 6; /* paint is kept per vertex only */
    ex_shape_surface(mesh, ex_lathe_point, lathe, lathe->count > 2 ? fine * (lathe->count - 1) : 1, columns, color,
                     paint);
}

/* A cylinder from a to b, closed; other radii make a cone, its tip where the radius is 0. */
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

/* A bent tube: `points` holds x, y, z, radius; the curve should stay about square to `side` (unit). */
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

/* One flat four-sided face, corners in order. */
static inline void ex_shape_quad(ex_mesh *mesh, ex_vec a, ex_vec b, ex_vec c, ex_vec d, const float color[3]) {
    const ex_vec corners[2][3] = {{a, b, c}, {a, c, d}};
    for (int i = 0; i < 2; ++i) {
        sps_triangle t;
        memset(&t, 0, sizeof t); /* normals of zero: the triangle's own */
        for (int k = 0; k < 3; ++k) {
            ex_store(t.position[k], corners[i][k]);
            memcpy(t.color[k], color, sizeof t.color[k]);
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

/* ------------------------------------------------------------------------------------------- a mushroom */

/* Pale dots in rows around the cap; u runs from the rim to the top. */
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

/* A mushroom on a foot at `base`, leaning along `axis`; the cap as wide as twice `cap`. */
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

/* ----------------------------------------------------------------------------------------------- a tree */

enum { EX_TREE_RODS = 1024, EX_TREE_CLUMPS = 256 };
#define EX_TREE_LEAF 0.30 /* value of leaves, about: low, as the skin of the wood passes through it */
#define EX_TREE_WOOD 1.0  /* value of wood */

typedef struct ex_tree {
    struct {
        ex_vec a, b;
        double radius_a, radius_b;
    } rods[EX_TREE_RODS];
    struct {
        ex_vec center;
        double radius;
    } clumps[EX_TREE_CLUMPS];
    int rod_count, clump_count;
    uint32_t random;
} ex_tree;

static inline ex_vec ex_tree_bend(ex_tree *tree, ex_vec direction, double amount) {
    const double x = ex_random(&tree->random) - 0.5, y = ex_random(&tree->random) - 0.5,
                 z = ex_random(&tree->random) - 0.5;
    return ex_vec_unit(ex_vec_add(direction, ex_vec_scale(ex_vec_of(x, y, z), 2 * amount)));
}

static inline void ex_tree_leaves(ex_tree *tree, ex_vec center, double radius) {
    if (tree->clump_count == EX_TREE_CLUMPS) return;
    tree->clumps[tree->clump_count].center = center;
    tree->clumps[tree->clump_count++].radius = radius;
}

static inline void ex_tree_rod(ex_tree *tree, ex_vec a, ex_vec b, double radius_a, double radius_b) {
    if (tree->rod_count == EX_TREE_RODS) return;
    tree->rods[tree->rod_count].a = a, tree->rods[tree->rod_count].b = b;
    tree->rods[tree->rod_count].radius_a = radius_a, tree->rods[tree->rod_count].radius_b = radius_b;
    ++tree->rod_count;
}

/* One branch as three tapering rods that wander; returns its tip and turns `direction` to where the tip points. */
static inline ex_vec ex_tree_branch(ex_tree *tree, ex_vec base, ex_vec *direction, double length, double radius) {
    for (int i = 0; i < 3; ++i) {
        *direction = ex_tree_bend(tree, *direction, 0.22);
        const ex_vec tip = ex_vec_add(base, ex_vec_scale(*direction, length / 3));
        ex_tree_rod(tree, base, tip, radius * (1 - 0.12 * i), radius * (1 - 0.12 * (i + 1)));
        base = tip;
    }
    return base;
}

/* Grows a branch and, from its tip, three thinner ones that spread evenly around it, `levels` deep. */
static inline void ex_tree_grow(ex_tree *tree, ex_vec base, ex_vec direction, double length, double radius,
                                int levels) {
    const ex_vec tip = ex_tree_branch(tree, base, &direction, length, radius);
    if (levels <= 1) ex_tree_leaves(tree, tip, length * (0.85 + 0.3 * ex_random(&tree->random)));
    if (levels == 0) return;
    const ex_vec side = ex_vec_square_to(direction), other = ex_vec_cross(direction, side);
    const double start = 2 * EX_PI * ex_random(&tree->random);
    for (int i = 0; i < 3; ++i) {
        const double angle = start + 2 * EX_PI * i / 3 + 0.6 * (ex_random(&tree->random) - 0.5);
        const double spread = 0.75 + 0.35 * ex_random(&tree->random), shrink = 0.66 + 0.14 * ex_random(&tree->random);
        ex_vec aim = ex_vec_add(
            direction,
            ex_vec_scale(ex_vec_add(ex_vec_scale(side, cos(angle)), ex_vec_scale(other, sin(angle))), spread));
        aim.y = 0.62 * aim.y + 0.12; /* branches reach out more than up, but do not hang */
        ex_tree_grow(tree, tip, ex_vec_unit(aim), length * shrink, radius * 0.62, levels - 1);
    }
}

/* Leaves of a clump at p: a flat noisy ellipsoid; its grain opens holes and spreads values over the greens. */
static inline double ex_clump_value(ex_vec p, ex_vec center, double radius, double voxel) {
    const ex_vec d = ex_vec_sub(p, center);
    const double far = ex_vec_length(ex_vec_of(d.x, 1.7 * d.y, d.z));
    if (far > 1.5 * radius) return 0;
    const double grain = ex_noise(ex_vec_scale(p, 0.16 / voxel));
    const double distance =
        far - radius * (0.82 + 0.28 * ex_noise(ex_vec_scale(p, 2.5 / radius))) - 2.2 * voxel * grain;
    return EX_TREE_LEAF * (1 + 0.15 * grain) * ex_solid(distance, 3 * voxel);
}

/* Raises the values of the voxels in a box around `center` to what one rod (or clump) of the tree gives there. */
static inline void ex_tree_raise(const ex_tree *tree, int rod, int clump, const sps_volume *volume, float *values) {
    const double voxel = volume->placement.axis[0][0] / volume->size[0];
    const ex_vec a = rod >= 0 ? tree->rods[rod].a : tree->clumps[clump].center, b = rod >= 0 ? tree->rods[rod].b : a;
    const double reach = 3 * voxel + (rod >= 0 ? tree->rods[rod].radius_a : 1.5 * tree->clumps[clump].radius);
    const double ends[2][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}};
    int low[3], high[3];
    for (int i = 0; i < 3; ++i) {
        const double first = (fmin(ends[0][i], ends[1][i]) - reach - volume->placement.origin[i]) / voxel;
        const double last = (fmax(ends[0][i], ends[1][i]) + reach - volume->placement.origin[i]) / voxel;
        low[i] = (int)ex_clamp(first, 0, volume->size[i]), high[i] = (int)ex_clamp(last, 0, volume->size[i]);
    }
    for (int z = low[2]; z < high[2]; ++z)
        for (int y = low[1]; y < high[1]; ++y)
            for (int x = low[0]; x < high[0]; ++x) {
                const ex_vec p = ex_vec_of(volume->placement.origin[0] + (x + 0.5) * voxel,
                                           volume->placement.origin[1] + (y + 0.5) * voxel,
                                           volume->placement.origin[2] + (z + 0.5) * voxel);
                float *out = values + ((size_t)z * (size_t)volume->size[1] + (size_t)y) * (size_t)volume->size[0] + x;
                double value;
                if (rod >= 0)
                    value = EX_TREE_WOOD *
                            ex_solid(ex_rod_distance(p, a, b, tree->rods[rod].radius_a, tree->rods[rod].radius_b),
                                     1.0 * voxel);
                else
                    value = ex_clump_value(p, a, tree->clumps[clump].radius, voxel);
                if (value > (double)*out) *out = (float)value;
            }
}

/* Makes `grid` the voxels of `volume` with the whole tree in them. */
static inline void ex_tree_fill(const ex_tree *tree, const sps_volume *volume, ex_grid *grid) {
    memcpy(grid->size, volume->size, sizeof grid->size);
    grid->type = EX_F32;
    grid->data =
        ex_allocate((size_t)volume->size[0] * (size_t)volume->size[1] * (size_t)volume->size[2], sizeof(float));
    for (int i = 0; i < tree->clump_count; ++i) ex_tree_raise(tree, -1, i, volume, (float *)grid->data);
    for (int i = 0; i < tree->rod_count; ++i) ex_tree_raise(tree, i, -1, volume, (float *)grid->data);
    ex_grid_measure(grid);
}

/* -------------------------------------------------------------------------------------------- the scene */

/* A warm light that travels along `direction`. */
static inline void ex_sun(sps_light *sun, ex_vec direction, double strength) {
    sun->kind = SPS_LIGHT_DIRECTIONAL;
    sun->direction[0] = direction.x, sun->direction[1] = direction.y, sun->direction[2] = direction.z;
    ex_color(sun->color, strength, 0.92 * strength, 0.78 * strength);
}

/* A backdrop, the first of the two colours that `user` holds below, the second above. */
static inline int ex_backdrop(void *user, size_t count, const float *directions, float *out_rgb) {
    const float(*ends)[3] = (const float(*)[3])user;
    for (size_t i = 0; i < count; ++i) {
        const double t = ex_ramp(-0.8, 0.3, (double)directions[3 * i + 1]);
        for (int c = 0; c < 3; ++c)
            out_rgb[3 * i + (size_t)c] = (float)ex_mix((double)ends[0][c], (double)ends[1][c], t);
    }
    return 0;
}

/* Volumes, meshes, one light, weak bluish ambient light and a grey backdrop. */
static inline void ex_scene_set(sps_scene *scene, const sps_volume *volumes, int volume_count, const sps_mesh *meshes,
                                int mesh_count, const sps_light *sun) {
    static float grey[2][3] = {{0.34f, 0.36f, 0.38f}, {0.11f, 0.14f, 0.19f}};
    scene->volumes = volumes, scene->volume_count = volume_count;
    scene->meshes = meshes, scene->mesh_count = mesh_count;
    scene->lights = sun, scene->light_count = 1;
    ex_color(scene->ambient, 0.13, 0.15, 0.18);
    scene->background_fn = ex_backdrop, scene->background_user = grey;
}

/* A camera for a picture of 480 x 360 at high quality; `degrees` is the vertical field of view. */
static inline void ex_view_set(sps_view *view, ex_vec position, ex_vec target, double degrees) {
    view->position[0] = position.x, view->position[1] = position.y, view->position[2] = position.z;
    view->target[0] = target.x, view->target[1] = target.y, view->target[2] = target.z;
    view->up[1] = 1;
    view->field_of_view = degrees * EX_PI / 180;
    view->width = 480, view->height = 360;
    view->quality = SPS_QUALITY_HIGH;
}

/* ex_scene_main, with NAME.png for a picture that --out does not name: the default goes before the caller's options,
   of which the last one counts. */
static inline int ex_scene_show(int argc, char **argv, const char *name, const sps_scene *scene, const sps_view *view) {
    char option[] = "--out", file[64];
    char **arguments = (char **)ex_allocate((size_t)argc + 3, sizeof *arguments);
    snprintf(file, sizeof file, "%s.png", name);
    arguments[0] = argv[0], arguments[1] = option, arguments[2] = file;
    for (int i = 1; i < argc; ++i) arguments[i + 2] = argv[i];
    const int status = ex_scene_main(argc + 2, arguments, scene, view, 1);
    free(arguments);
    return status;
}

#endif /* EX_MODELLING_H */
