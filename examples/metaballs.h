/* metaballs.h: metaballs, and marching cubes, which turn any field into a mesh. */

#ifndef EX_METABALLS_H
#define EX_METABALLS_H

#include "shapes.h"

/* ------------------------------------------------------------------------------------------------------ metaballs */

/* A number for every point in space, for example a density. ex_shape_field makes a mesh of its surface at a level. */
typedef double (*ex_field_fn)(void *user, ex_vec p);

/* A ball whose field falls from `strength` at its center to 0 at `radius`. The fields of several balls add up, so that
   their surfaces flow into each other. [after Wyvill, McPheeters & Wyvill 1986] */
typedef struct ex_metaball {
    ex_vec center;
    double radius, strength;
} ex_metaball;

typedef struct ex_metaballs {
    const ex_metaball *balls;
    int count;
} ex_metaballs;

/* A cubic in the squared distance: it needs no square root, and its first two derivatives reach 0 at the radius, so
   that no rim shows. */
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

/* ------------------------------------------------------------------------------------------------- marching cubes */

/* The field minus the level at the corners of cubic cells: positive inside. */
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

/* Corners on the faces of the box count as outside, so that a surface that would leave the box is closed there. */
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

/* The surface leaves a cell along curves on the cell's faces: its border. For each edge of the cell that the surface
   crosses, this finds the next one along the border; -1 for the other edges. A walk around each face, counter-clockwise
   as seen from outside the cell, enters and leaves runs of inside corners, and the border connects each entry to the
   exit of the same run. Each edge is walked once in either direction, so the borders form closed loops,
   counter-clockwise as seen from outside the surface. Inside corners that are diagonal on a face are separated; the
   neighboring cell sees the same face and does the same. */
static inline void ex_cell_borders(int inside, int follower[24]) {
    for (int i = 0; i < 24; ++i) follower[i] = -1;
    for (int face = 0; face < 6; ++face) {
        const int axis = face / 2, upper = face & 1, base = upper << axis;
        const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
        const int ring[4] = {base, base | (upper ? u : v), base | u | v, base | (upper ? v : u)};
        int entry = -1;
        for (int i = 0; i < 8; ++i) { /* two rounds, since a run may begin anywhere */
            const int from = ring[i & 3], to = ring[(i + 1) & 3];
            if ((inside >> from & 1) == (inside >> to & 1)) continue;
            if (inside >> to & 1)
                entry = ex_cell_edge(from, to);
            else if (entry >= 0)
                follower[entry] = ex_cell_edge(from, to);
        }
    }
}

/* Removes the loop through `start` from the borders. Returns its number of edges, 3 to 7, or 0. */
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

/* Finds where a fan of triangles can start so that no diagonal lies in a face of the cell: the neighboring cell could
   have the same diagonal, and four triangles would share it. Every loop that occurs has such a place; -1 otherwise. */
static inline int ex_loop_apex(const int loop[12], int count) {
    for (int apex = 0; apex < count; ++apex) {
        int shared = 0;
        for (int i = 2; i < count - 1; ++i)
            shared |= ex_edge_faces(loop[apex]) & ex_edge_faces(loop[(apex + i) % count]);
        if (!shared) return apex;
    }
    return -1;
}

/* The point where the surface crosses an edge, and its normal. All four cells around the edge get the same bits. The
   point stays off the ends of the edge, so that no triangle degenerates. */
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
            memset(t.uv, 0, sizeof t.uv);
            for (int c = 0; c < 3; ++c) {
                ex_samples_crossing(samples, cell, loop[fan[c] % count], t.position[c], t.normal[c]);
                memcpy(t.albedo[c], color, sizeof t.albedo[c]);
            }
            ex_shape_triangle(mesh, &t);
        }
    }
}

/* Marching cubes: adds the surface on which the field equals `level`; higher values are inside. The surface is closed,
   its triangles are counter-clockwise as seen from outside, its normals point against the gradient. The box low..high
   is divided into cubic cells, `cells` of them along its longest side; a surface that would leave the box is closed
   just inside it. [Lorensen & Cline 1987; triangles come from borders on the faces of a cell instead of a table] */
static inline void ex_shape_field(ex_mesh *mesh, ex_field_fn field, void *user, double level, ex_vec low, ex_vec high,
                                  int cells, const float color[3]) {
    ex_samples samples = ex_samples_take(field, user, level, low, high, cells);
    int cell[3];
    for (cell[2] = 0; cell[2] < samples.size[2] - 1; ++cell[2])
        for (cell[1] = 0; cell[1] < samples.size[1] - 1; ++cell[1])
            for (cell[0] = 0; cell[0] < samples.size[0] - 1; ++cell[0]) ex_samples_cell(&samples, cell, color, mesh);
    free(samples.values);
}

#endif /* EX_METABALLS_H */
