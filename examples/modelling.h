/* SPDX-License-Identifier: MIT OR Unlicense

modelling.h: what the scene programs build their pictures from: noise, densities, polygon shapes, metaballs,
marching cubes, thickness of meshes, smoke puffs and a tree.
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

/* -------------------------------------------------------------------------------------------- metaballs */

/* A number for every point in space, say a density; its surface at a level is what ex_shape_field makes a mesh of. */
typedef double (*ex_field_fn)(void *user, ex_vec p);

/* A ball whose field falls from `strength` at its centre to 0 at `radius`. Fields of balls that meet add up, and so
   their surfaces flow into each other. [after Wyvill, McPheeters & Wyvill 1986] */
typedef struct ex_metaball {
    ex_vec center;
    double radius, strength;
} ex_metaball;

typedef struct ex_metaballs {
    const ex_metaball *balls;
    int count;
} ex_metaballs;

/* A cubic in the squared distance: no root to take, and the first two derivatives end at 0 too, so no rim shows. */
static inline double ex_metaball_value(const ex_metaball *ball, ex_vec p) {
    const ex_vec d = ex_vec_sub(p, ball->center);
    const double rest = 1 - ex_vec_dot(d, d) / (ball->radius * ball->radius);
    return rest > 0 ? ball->strength * rest * rest * rest : 0;
}

/* ex_field_fn, with ex_metaballs as `user`. */
static inline double ex_metaballs_value(void *user, ex_vec p) {
    const ex_metaballs *all = (const ex_metaballs *)user;
    double sum = 0;
    for (int i = 0; i < all->count; ++i) sum += ex_metaball_value(&all->balls[i], p);
    return sum;
}

/* sps_volume.eval_fn, with ex_metaballs as `user`. */
static inline int ex_metaballs_eval(void *user, size_t count, const double *positions, float *out) {
    for (size_t i = 0; i < count; ++i, positions += 3)
        out[i] = (float)ex_metaballs_value(user, ex_vec_of(positions[0], positions[1], positions[2]));
    return 0;
}

/* --------------------------------------------------------------------------------------- marching cubes */

/* A field at the corners of cubic cells: the field less the level, so that it is positive inside. */
typedef struct ex_samples {
    double *values; /* x fastest */
    int size[3];    /* corners along x, y, z */
    ex_vec low;
    double step;
} ex_samples;

static inline double *ex_samples_at(const ex_samples *samples, const int at[3]) {
    const size_t row = (size_t)at[2] * (size_t)samples->size[1] + (size_t)at[1];
    return samples->values + row * (size_t)samples->size[0] + at[0];
}

/* The corners on the box's own faces are made to lie outside: a surface that would leave the box is closed there. */
static inline ex_samples ex_samples_take(ex_field_fn field, void *user, double level, ex_vec low, ex_vec high,
                                         int cells) {
    const double side[3] = {high.x - low.x, high.y - low.y, high.z - low.z};
    ex_samples s;
    int at[3];
    s.low = low, s.step = fmax(side[0], fmax(side[1], side[2])) / cells;
    for (int i = 0; i < 3; ++i) s.size[i] = 1 + (int)fmax(ceil(side[i] / s.step - 1e-6), 1);
    s.values = (double *)ex_allocate((size_t)s.size[0] * (size_t)s.size[1] * (size_t)s.size[2], sizeof *s.values);
    for (at[2] = 0; at[2] < s.size[2]; ++at[2])
        for (at[1] = 0; at[1] < s.size[1]; ++at[1])
            for (at[0] = 0; at[0] < s.size[0]; ++at[0]) {
                const ex_vec offset = ex_vec_scale(ex_vec_of(at[0], at[1], at[2]), s.step);
                const double value = field(user, ex_vec_add(low, offset)) - level;
                int border = 0;
                for (int i = 0; i < 3; ++i) border |= at[i] == 0 || at[i] == s.size[i] - 1;
                *ex_samples_at(&s, at) = border ? -fabs(value) : value;
            }
    return s;
}

/* The gradient at a corner, in values per cell: central differences, one-sided on the box's faces. */
static inline ex_vec ex_samples_gradient(const ex_samples *samples, const int at[3]) {
    double slope[3];
    for (int i = 0; i < 3; ++i) {
        int before[3] = {at[0], at[1], at[2]}, after[3] = {at[0], at[1], at[2]};
        before[i] -= at[i] > 0, after[i] += at[i] < samples->size[i] - 1;
        slope[i] = (*ex_samples_at(samples, after) - *ex_samples_at(samples, before)) / (after[i] - before[i]);
    }
    return ex_vec_of(slope[0], slope[1], slope[2]);
}

/* A cell's corners are numbered by bits: 1 the upper x, 2 the upper y, 4 the upper z. Its edges go up an axis from a
   corner: 3 * corner + axis, where only 12 of the 24 numbers are edges. */
static inline int ex_cell_edge(int corner, int other) { return 3 * (corner & other) + ((corner ^ other) >> 1); }

/* The cell's faces that an edge lies in, a bit for each of the six. */
static inline int ex_edge_faces(int edge) {
    int faces = 0;
    for (int axis = 0; axis < 3; ++axis)
        if (axis != edge % 3) faces |= 1 << (2 * axis + (edge / 3 >> axis & 1));
    return faces;
}

/* For each edge that the surface crosses, the edge that follows along the surface's border on the cell's faces; -1 for
   the others. A walk round each face, counter-clockwise from outside of the cell, enters and leaves runs of inside
   corners, and the border joins each entry to the exit of the same run. Every edge is walked once either way, so the
   borders close to loops, counter-clockwise from outside of the surface. Where inside corners face each other across
   a face, they are parted; the neighbour sees the same face and does the same. */
static inline void ex_cell_borders(int inside, int follower[24]) {
    for (int i = 0; i < 24; ++i) follower[i] = -1;
    for (int face = 0; face < 6; ++face) {
        const int axis = face / 2, upper = face & 1, base = upper << axis;
        const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
        const int ring[4] = {base, base | (upper ? u : v), base | u | v, base | (upper ? v : u)};
        int entry = -1;
        for (int i = 0; i < 8; ++i) { /* twice round, as a run may begin anywhere */
            const int from = ring[i & 3], to = ring[(i + 1) & 3];
            if ((inside >> from & 1) == (inside >> to & 1)) continue;
            if (inside >> to & 1)
                entry = ex_cell_edge(from, to);
            else if (entry >= 0)
                follower[entry] = ex_cell_edge(from, to);
        }
    }
}

/* Takes the loop that goes through `start` out of the borders; gives how many edges it has, 3 to 7, or 0. */
static inline int ex_cell_loop(int follower[24], int start, int loop[12]) {
    int count = 0;
    for (int edge = start; follower[edge] >= 0;) {
        const int next = follower[edge];
        loop[count++] = edge;
        follower[edge] = -1;
        edge = next;
    }
    return count;
}

/* Where in the loop a fan of triangles can start without a diagonal that lies in a face of the cell: the neighbour
   could have the same diagonal, and four triangles would meet there. All loops that occur have such a place; -1 for
   none. */
static inline int ex_loop_apex(const int loop[12], int count) {
    for (int apex = 0; apex < count; ++apex) {
        int shared = 0;
        for (int i = 2; i < count - 1; ++i)
            shared |= ex_edge_faces(loop[apex]) & ex_edge_faces(loop[(apex + i) % count]);
        if (!shared) return apex;
    }
    return -1;
}

/* Where the surface crosses an edge, and which way is out. The same bits in all four cells round the edge; kept off the
   edge's ends a little, so that no triangle shrinks to nothing. */
static inline void ex_samples_crossing(const ex_samples *samples, const int cell[3], int edge, float position[3],
                                       float normal[3]) {
    const int corner = edge / 3, axis = edge % 3;
    const int from[3] = {cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2)};
    const int to[3] = {from[0] + (axis == 0), from[1] + (axis == 1), from[2] + (axis == 2)};
    const double a = *ex_samples_at(samples, from), b = *ex_samples_at(samples, to);
    const double t = ex_clamp(a / (a - b), 1e-3, 1 - 1e-3);
    const ex_vec at =
        ex_vec_of(from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]), from[2] + t * (to[2] - from[2]));
    const ex_vec slope = ex_vec_add(ex_vec_scale(ex_samples_gradient(samples, from), 1 - t),
                                    ex_vec_scale(ex_samples_gradient(samples, to), t));
    ex_store(position, ex_vec_add(samples->low, ex_vec_scale(at, samples->step)));
    ex_store(normal, ex_vec_scale(ex_vec_unit(slope), -1));
}

static inline void ex_samples_cell(const ex_samples *samples, const int cell[3], const float color[3], ex_mesh *mesh) {
    int inside = 0, follower[24], loop[12];
    for (int c = 0; c < 8; ++c) {
        const int at[3] = {cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2)};
        inside |= (*ex_samples_at(samples, at) > 0) << c;
    }
    if (inside == 0 || inside == 255) return;
    ex_cell_borders(inside, follower);
    for (int start = 0; start < 24; ++start) {
        const int count = ex_cell_loop(follower, start, loop), apex = ex_loop_apex(loop, count);
        for (int i = 1; i < count - 1; ++i) {
            const int fan[3] = {apex, apex + i, apex + i + 1};
            sps_triangle t;
            for (int c = 0; c < 3; ++c) {
                ex_samples_crossing(samples, cell, loop[fan[c] % count], t.position[c], t.normal[c]);
                memcpy(t.color[c], color, sizeof t.color[c]);
            }
            ex_shape_triangle(mesh, &t);
        }
    }
}

/* Marching cubes: adds the surface on which the field is at `level`, with what is above it inside: closed, triangles
   counter-clockwise from outside, normals against the field's gradient. The box low..high is cut into cubic cells,
   `cells` of them along its longest side; what would leave the box is closed just inside of it. [Lorensen & Cline 1987;
   the triangles of a cell come from its borders on the cell's faces instead of a table] */
static inline void ex_shape_field(ex_mesh *mesh, ex_field_fn field, void *user, double level, ex_vec low, ex_vec high,
                                  int cells, const float color[3]) {
    ex_samples samples = ex_samples_take(field, user, level, low, high, cells);
    int cell[3];
    for (cell[2] = 0; cell[2] < samples.size[2] - 1; ++cell[2])
        for (cell[1] = 0; cell[1] < samples.size[1] - 1; ++cell[1])
            for (cell[0] = 0; cell[0] < samples.size[0] - 1; ++cell[0]) ex_samples_cell(&samples, cell, color, mesh);
    free(samples.values);
}

/* ------------------------------------------------------------------------- thickness of a closed mesh */

/* The rays of a view that has a position, a target and an `up` across them; neither matrix nor region. */
typedef struct ex_camera {
    ex_vec eye, right, up, forward;
    double scale; /* pixels to the side per unit of x / z; orthographic: of x */
    int perspective, width, height;
} ex_camera;

static inline ex_camera ex_camera_of(const sps_view *view) {
    ex_camera c;
    c.eye = ex_vec_of(view->position[0], view->position[1], view->position[2]);
    c.forward = ex_vec_unit(ex_vec_sub(ex_vec_of(view->target[0], view->target[1], view->target[2]), c.eye));
    c.right = ex_vec_unit(ex_vec_cross(c.forward, ex_vec_of(view->up[0], view->up[1], view->up[2])));
    c.up = ex_vec_cross(c.right, c.forward);
    c.perspective = view->field_of_view > 0;
    c.width = view->width, c.height = view->height;
    c.scale = c.perspective ? 0.5 * c.height / tan(0.5 * view->field_of_view)
                            : c.height / (view->ortho_height > 0 ? view->ortho_height : 1);
    return c;
}

/* x to the right, y up, z away from the eye. */
static inline ex_vec ex_camera_space(const ex_camera *camera, const float position[3]) {
    const ex_vec d = ex_vec_sub(ex_vec_of((double)position[0], (double)position[1], (double)position[2]), camera->eye);
    return ex_vec_of(ex_vec_dot(d, camera->right), ex_vec_dot(d, camera->up), ex_vec_dot(d, camera->forward));
}

#define EX_SUBPIXELS  256.0       /* corners are rounded to so many steps a pixel, and all that follows is exact */
#define EX_SCREEN_MAX 536870912.0 /* steps: products of two differences still fit into 64 bits */

typedef struct ex_thickness {
    ex_camera camera;
    double near;        /* z from which on triangles count, so that none is further out than EX_SCREEN_MAX */
    const float *depth; /* where each ray ends; NULL: nowhere */
    double *sums;       /* for each pixel */
} ex_thickness;

/* A triangle in the camera's space. */
typedef struct ex_facet {
    ex_vec corner[3], normal;
    double nearest, furthest; /* z */
} ex_facet;

static inline ex_facet ex_facet_of(const ex_camera *camera, const sps_triangle *triangle) {
    ex_facet f;
    for (int i = 0; i < 3; ++i) f.corner[i] = ex_camera_space(camera, triangle->position[i]);
    f.normal = ex_vec_cross(ex_vec_sub(f.corner[1], f.corner[0]), ex_vec_sub(f.corner[2], f.corner[0]));
    f.nearest = fmax(fmin(f.corner[0].z, fmin(f.corner[1].z, f.corner[2].z)), 0);
    f.furthest = fmax(f.corner[0].z, fmax(f.corner[1].z, f.corner[2].z));
    return f;
}

/* Cuts off what is nearer than `near`; leaves 0, 3 or 4 corners. A cut edge is cut from its further end on, whichever
   triangle asks, so that neighbours get the same corner. */
static inline int ex_facet_cut(const ex_facet *facet, double near, ex_vec out[4]) {
    int count = 0;
    for (int i = 0; i < 3; ++i) {
        const ex_vec a = facet->corner[i], b = facet->corner[(i + 1) % 3];
        if (a.z >= near) out[count++] = a;
        if ((a.z >= near) == (b.z >= near)) continue;
        const ex_vec from = a.z >= near ? a : b, to = a.z >= near ? b : a;
        const double t = (from.z - near) / (from.z - to.z);
        out[count++] = ex_vec_of(ex_mix(from.x, to.x, t), ex_mix(from.y, to.y, t), near);
    }
    return count;
}

/* Where a point is in the image, in steps from its upper left corner. */
static inline void ex_thickness_project(const ex_camera *camera, ex_vec p, int64_t out[2]) {
    const double scale = camera->perspective ? camera->scale / p.z : camera->scale;
    const double x = (0.5 * camera->width + scale * p.x) * EX_SUBPIXELS;
    const double y = (0.5 * camera->height - scale * p.y) * EX_SUBPIXELS;
    out[0] = (int64_t)floor(ex_clamp(x, -EX_SCREEN_MAX, EX_SCREEN_MAX) + 0.5);
    out[1] = (int64_t)floor(ex_clamp(y, -EX_SCREEN_MAX, EX_SCREEN_MAX) + 0.5);
}

/* Which side of the edge a -> b a point lies on: positive within a triangle that goes clockwise in the image. Never 0:
   a point on the edge counts as a hair further to the right and, by a hair's square, further down, which gives it to
   exactly one of the two triangles at an edge, and to one of all those at a corner that surround it. */
static inline int64_t ex_side(const int64_t a[2], const int64_t b[2], const int64_t p[2]) {
    const int64_t dx = b[0] - a[0], dy = b[1] - a[1], side = dx * (p[1] - a[1]) - dy * (p[0] - a[0]);
    if (side != 0) return side;
    return dy < 0 || (dy == 0 && dx > 0) ? 1 : -1;
}

/* Adds, with a sign, how far along a pixel's ray the facet's plane is. Rounded corners can put a pixel beyond the
   facet's edge by a hair: nearest and furthest keep a facet seen edge-on from being met far away. */
static inline void ex_thickness_add(const ex_thickness *all, const ex_facet *facet, int x, int y, double sign) {
    const ex_camera *c = &all->camera;
    const ex_vec ray =
        ex_vec_of((x + 0.5 - 0.5 * c->width) / c->scale, (0.5 * c->height - y - 0.5) / c->scale, c->perspective);
    const size_t pixel = (size_t)y * (size_t)c->width + (size_t)x;
    const double reach = ex_vec_dot(facet->normal, facet->corner[0]), across = ex_vec_dot(facet->normal, ray);
    const double met = c->perspective ? reach / across : (reach - across) / facet->normal.z;
    const double z = met == met ? ex_clamp(met, facet->nearest, facet->furthest) : facet->nearest;
    const double distance = c->perspective ? z * ex_vec_length(ray) : z;
    all->sums[pixel] += sign * (all->depth ? fmin(distance, (double)all->depth[pixel]) : distance);
}

/* All pixels whose centres lie in a triangle of the image. Back faces count positive, front faces negative. */
static inline void ex_thickness_fill(const ex_thickness *all, const ex_facet *facet, int64_t corner[3][2]) {
    const int size[2] = {all->camera.width, all->camera.height};
    const int64_t *a = corner[0], *b = corner[1], *c = corner[2];
    const int64_t area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    int first[2], last[2];
    if (area == 0) return;
    if (area < 0) b = corner[2], c = corner[1];
    for (int i = 0; i < 2; ++i) {
        const int64_t low = a[i] < b[i] ? (a[i] < c[i] ? a[i] : c[i]) : (b[i] < c[i] ? b[i] : c[i]);
        const int64_t high = a[i] > b[i] ? (a[i] > c[i] ? a[i] : c[i]) : (b[i] > c[i] ? b[i] : c[i]);
        first[i] = (int)ex_clamp(floor((double)low / EX_SUBPIXELS), 0, size[i]);
        last[i] = (int)ex_clamp(ceil((double)high / EX_SUBPIXELS), 0, size[i]);
    }
    for (int y = first[1]; y < last[1]; ++y)
        for (int x = first[0]; x < last[0]; ++x) {
            const int64_t p[2] = {(int64_t)((x + 0.5) * EX_SUBPIXELS), (int64_t)((y + 0.5) * EX_SUBPIXELS)};
            if (ex_side(a, b, p) > 0 && ex_side(b, c, p) > 0 && ex_side(c, a, p) > 0)
                ex_thickness_add(all, facet, x, y, area > 0 ? 1 : -1);
        }
}

/* The largest distance of a corner of the mesh from the eye. */
static inline double ex_thickness_reach(const ex_camera *camera, const ex_mesh *mesh) {
    double reach = 0;
    for (size_t t = 0; t < mesh->triangle_count; ++t)
        for (int c = 0; c < 3; ++c)
            reach = fmax(reach, ex_vec_length(ex_camera_space(camera, mesh->triangles[t].position[c])));
    return reach;
}

/* Adds to sums[y * width + x] how long that pixel's ray runs inside of a closed mesh: distances to where it comes out
   less those to where it goes in, in any order, since they are only added. Where the mesh covers itself, each layer
   counts. A ray starts at the eye, which may be inside, and ends at depth[y * width + x] (sps_image.depth; NULL:
   nowhere). Both come for free: what is cut off at an end adds as much as it takes, 0 or the depth. Triangles go
   counter-clockwise from outside, as ex_shape_field makes them. */
static inline void ex_mesh_thickness(const ex_mesh *mesh, const sps_view *view, const float *depth, double *sums) {
    ex_thickness all;
    all.camera = ex_camera_of(view);
    all.near = 0;
    all.depth = depth, all.sums = sums;
    if (all.camera.perspective)
        all.near = ex_thickness_reach(&all.camera, mesh) * all.camera.scale * EX_SUBPIXELS / EX_SCREEN_MAX;
    for (size_t t = 0; t < mesh->triangle_count; ++t) {
        const ex_facet facet = ex_facet_of(&all.camera, &mesh->triangles[t]);
        ex_vec cut[4];
        const int count = ex_facet_cut(&facet, all.near, cut);
        for (int i = 1; i < count - 1; ++i) {
            int64_t corner[3][2];
            ex_thickness_project(&all.camera, cut[0], corner[0]);
            ex_thickness_project(&all.camera, cut[i], corner[1]);
            ex_thickness_project(&all.camera, cut[i + 1], corner[2]);
            ex_thickness_fill(&all, &facet, corner);
        }
    }
}

/* ------------------------------------------------------------------------------------------- smoke puff */

enum { EX_PUFF_PARTICLES = 2500 }; /* what one puff takes to look like smoke */

/* A ball of particles whose edge turbulence has eaten into. */
typedef struct ex_puff {
    ex_vec center;
    double radius;            /* no particle reaches further */
    double smallest, largest; /* particles' radii; the small ones are at the edge */
    double optical_depth;     /* of each particle, along its diameter */
    uint32_t seed;
} ex_puff;

/* A point in the unit ball. */
static inline ex_vec ex_random_in_ball(uint32_t *random) {
    ex_vec p;
    do {
        p.x = 2 * ex_random(random) - 1;
        p.y = 2 * ex_random(random) - 1;
        p.z = 2 * ex_random(random) - 1;
    } while (ex_vec_dot(p, p) > 1);
    return p;
}

/* Draws points until one lies within what the turbulence leaves: two fifths of the radius at the least. */
static inline void ex_puff_fill(const ex_puff *puff, size_t count, sps_particle *out) {
    uint32_t random = ex_hash((int)puff->seed, 17, 3);                  /* seeds 1 and 2 start far apart */
    const ex_vec shift = ex_vec_scale(ex_random_in_ball(&random), 100); /* another puff, another turbulence */
    for (size_t i = 0; i < count; ++i) {
        ex_vec p;
        double inside;
        do {
            p = ex_random_in_ball(&random);
            const double billows = ex_turbulence(ex_vec_add(ex_vec_scale(p, 1.3), shift), 4);
            const double eaten = 0.6 * ex_clamp(1.2 - 1.6 * billows, 0, 1); /* creases, round in between */
            inside = 1 - eaten - ex_vec_length(p);
        } while (inside < 0);
        const double size = ex_ramp(0, 0.4, inside) * (0.6 + 0.4 * ex_random(&random));
        const double radius = ex_mix(puff->smallest, puff->largest, size);
        ex_store(out[i].position, ex_vec_add(puff->center, ex_vec_scale(p, puff->radius - radius)));
        out[i].radius = (float)radius;
        out[i].optical_depth = (float)puff->optical_depth;
    }
}

/* Wind over level ground, with eddies in it. */
typedef struct ex_wind {
    ex_vec velocity;         /* at `height` above the ground */
    double ground, height;   /* the ground's y; the height that `velocity` is for */
    double exponent;         /* of the power law of speed over height; 1/7 over open land, more over rough ground */
    double eddy_size, gusts; /* world units; speed of the eddies, about */
    uint32_t seed;
} ex_wind;

/* The curl of three noises: swirls that neither gather nor thin out what floats in them. [Bridson et al. 2007] */
static inline ex_vec ex_swirl(ex_vec p) {
    const double step = 1e-3;
    double slope[3][3]; /* of noise i along axis k */
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
            const ex_vec shift = ex_vec_of(31.4 * i, 15.9 * i, 26.5 * i);
            const ex_vec side = ex_vec_of(step * (k == 0), step * (k == 1), step * (k == 2)), q = ex_vec_add(p, shift);
            slope[i][k] = (ex_noise(ex_vec_add(q, side)) - ex_noise(ex_vec_sub(q, side))) / (2 * step);
        }
    return ex_vec_of(slope[2][1] - slope[1][2], slope[0][2] - slope[2][0], slope[1][0] - slope[0][1]);
}

static inline ex_vec ex_wind_velocity(const ex_wind *wind, ex_vec p) {
    const double share = pow(fmax(p.y - wind->ground, 0) / wind->height, wind->exponent);
    const ex_vec shift = ex_vec_of(wind->seed % 101, wind->seed % 103, wind->seed % 107);
    const ex_vec swirl = ex_swirl(ex_vec_add(ex_vec_scale(p, 1 / wind->eddy_size), shift));
    return ex_vec_add(ex_vec_scale(wind->velocity, share), ex_vec_scale(swirl, wind->gusts));
}

/* Lets the particles drift for a time, by midpoint steps; they keep their sizes and optical depths. */
static inline void ex_puff_blow(const ex_wind *wind, double seconds, int steps, size_t count, sps_particle *particles) {
    const double step = seconds / steps;
    for (size_t i = 0; i < count; ++i) {
        float *at = particles[i].position;
        ex_vec p = ex_vec_of((double)at[0], (double)at[1], (double)at[2]);
        for (int k = 0; k < steps; ++k) {
            const ex_vec half = ex_vec_add(p, ex_vec_scale(ex_wind_velocity(wind, p), 0.5 * step));
            p = ex_vec_add(p, ex_vec_scale(ex_wind_velocity(wind, half), step));
        }
        ex_store(at, p);
    }
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
    ex_grid_begin(grid, volume->size, EX_F32);
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

/* A camera for a picture of 480 x 360 at high quality; `degrees` is the vertical field of view. */
static inline void ex_view_set(sps_view *view, ex_vec position, ex_vec target, double degrees) {
    view->position[0] = position.x, view->position[1] = position.y, view->position[2] = position.z;
    view->target[0] = target.x, view->target[1] = target.y, view->target[2] = target.z;
    view->up[1] = 1;
    view->field_of_view = degrees * EX_PI / 180;
    view->width = 480, view->height = 360;
    view->quality = SPS_QUALITY_HIGH;
}

#ifndef EX_NO_PNG
/* A scene as most programs here have it, and the view of it. Stays where it is, since the scene points into it. */
typedef struct ex_stage {
    sps_volume volumes[4];
    ex_mesh shapes[2];  /* polygons as they are modelled */
    sps_mesh meshes[2]; /* the same for the library: a placement may be set, ex_stage_show sets the rest */
    sps_light sun;
    sps_scene scene;
    sps_view view;
    const ex_finish *finish; /* what is done to the picture after rendering; NULL: nothing */
} ex_stage;

/* The first so many of the volumes and meshes, the sun, weak bluish ambient light and a grey backdrop; all else is
   0. */
static inline void ex_stage_begin(ex_stage *stage, int volume_count, int mesh_count) {
    static float grey[2][3] = {{0.34f, 0.36f, 0.38f}, {0.11f, 0.14f, 0.19f}};
    memset(stage, 0, sizeof *stage);
    stage->scene.volumes = stage->volumes, stage->scene.volume_count = volume_count;
    stage->scene.meshes = stage->meshes, stage->scene.mesh_count = mesh_count;
    stage->scene.lights = &stage->sun, stage->scene.light_count = 1;
    ex_color(stage->scene.ambient, 0.13, 0.15, 0.18);
    stage->scene.background_fn = ex_backdrop, stage->scene.background_user = grey;
}

/* ex_scene_main, with NAME.png for a picture that --out does not name: the default goes before the caller's options,
   of which the last one counts. Frees the shapes. */
static inline int ex_stage_show(int argc, char **argv, const char *name, ex_stage *stage) {
    char option[] = "--out", file[64];
    char **arguments = (char **)ex_allocate((size_t)argc + 3, sizeof *arguments);
    snprintf(file, sizeof file, "%s.png", name);
    arguments[0] = argv[0], arguments[1] = option, arguments[2] = file;
    for (int i = 1; i < argc; ++i) arguments[i + 2] = argv[i];
    for (int i = 0; i < stage->scene.mesh_count; ++i) ex_shape_use(&stage->shapes[i], &stage->meshes[i]);
    const int status = ex_scene_main(argc + 2, arguments, &stage->scene, &stage->view, 1, stage->finish);
    for (int i = 0; i < stage->scene.mesh_count; ++i) ex_mesh_free(&stage->shapes[i]);
    free(arguments);
    return status;
}
#endif

#endif /* EX_MODELLING_H */
