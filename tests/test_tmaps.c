/* Transmittance maps: particles, voxels and triangles against sums and integrals in double precision, in maps of every
   technique, then failures, and images whose gas shades by maps. The result of each technique for one ray is tested by
   test_transmittance. Tolerances are derived where they are used, from
   CHORD    a ball's chord is a polynomial in floats of some 16 operations, 6e-8 each, of numbers up to 1: its squared
            half length per radius is off by 1e-6, which is 1e-6 / (2 share) of the share s, and 1e-3 where s is 0;
   U        u is a float, accurate to 6e-8 of the range at either end of an interval and at the query point;
   RIPPLE   a constant grid's optical depth is constant to 0.2 % only (kernels as for high quality), and the kernel's
            share of a slab is good to 2e-4 at both ends: 0.24 %. */

#include "check.h"
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#define CHORD  1e-6
#define U      2e-7
#define RIPPLE 0.0024
#define DARK   ((double)1e15f)

enum { SIDE = 9, MOST = 256, TECHNIQUES = SPS_TMAP_BEER }; /* without the default */

static float one = 1;

/* ---------------------------------------------------------------------------------------------------------- fixture */

/* Views of the light: all except for the last two look along -z from (0,0,10) at texels of size 1 in the plane z = 0.
 */
enum { ORTHO, SPOT, ORTHO_MATRIX, SPOT_MATRIX, ORTHO_TURNED, SPOT_TURNED, ROUND, WAYS };

typedef struct crowd {
    sps_particle list[MOST];
    size_t count;
    long calls, fail_at;
} crowd;

typedef struct fixture {
    sps_tmap_light light;
    double matrix[16];
    sps_tmap_settings settings;
    check_scene s; /* volumes and meshes */
    sps_particles sets[2];
    crowd crowds[2];
    check_triangles triangles[2];
    check_field field;
} fixture;

static int read_crowd(void *user, size_t first, size_t count, sps_particle *out) {
    crowd *c = (crowd *)user;
    memcpy(out, c->list + first, count * sizeof *out);
    return ++c->calls == c->fail_at ? 7 : 0;
}

static void see(fixture *f, int way, int side) {
    f->light.width = f->light.height = side;
    check_set3(f->light.camera.position, 0, 0, 10);
    check_set3(f->light.camera.up, 0, 1, 0);
    memset(f->matrix, 0, sizeof f->matrix);
    check_orthographic(&f->light.camera, SIDE);
    check_perspective(&f->light.camera, way == SPOT || way == SPOT_TURNED ? 2 * atan(SIDE / 20.0) : 0);
    f->light.omnidirectional = way == ROUND;
    if (way == ORTHO_TURNED || way == SPOT_TURNED) check_set3(f->light.camera.position, 6, -5, 6.2);
    if (way == ROUND) check_set3(f->light.camera.position, 0.5, -0.25, 1);
    f->matrix[0] = f->matrix[5] = way == ORTHO_MATRIX ? 2.0 / SIDE : 20.0 / SIDE;
    f->matrix[10] = -0.1; /* clip depth -1 is the plane z = 10 */
    f->matrix[14] = way == ORTHO_MATRIX ? 0 : -1;
    f->matrix[15] = way == ORTHO_MATRIX ? 1 : 10;
    f->light.camera.world_to_clip = NULL;
    if (way == ORTHO_MATRIX || way == SPOT_MATRIX) check_matrix(&f->light.camera, f->matrix);
}

static void begin(fixture *f, int technique) {
    memset(f, 0, sizeof *f);
    check_clear(&f->s, 0, 0);
    see(f, ORTHO, SIDE);
    f->settings.technique = (sps_tmap_technique)technique;
    f->settings.far_depth = 20;
    for (int i = 0; i < 2; ++i) f->sets[i].read_fn = read_crowd, f->sets[i].user = &f->crowds[i];
    f->sets[1].soft = 1;
    f->s.scene.particles = f->sets;
}

static void end(fixture *f) {
    for (int i = 0; i < 2; ++i) check_free_triangles(&f->triangles[i]);
}

static void add(fixture *f, int set, double x, double y, double z, double radius, double depth) {
    crowd *c = &f->crowds[set];
    sps_particle *p = &c->list[c->count++];
    p->position[0] = (float)x, p->position[1] = (float)y, p->position[2] = (float)z;
    p->radius = (float)radius, p->optical_depth = (float)depth;
}

/* None has a radius of less than 1.5 texels, even where a spot's are widest: smaller ones are weighted
   (test_small_particles). */
static void scatter(fixture *f, int set, int count, double reach, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < count; ++i) {
        const double x = check_next(&random), y = check_next(&random), z = check_next(&random);
        add(f, set, reach * (2 * x - 1), reach * (2 * y - 1), 2 * reach * (2 * z - 1), 3.4 + check_next(&random),
            0.4 * check_next(&random));
    }
}

static void complete(fixture *f) {
    f->s.scene.particle_set_count = 0;
    for (int i = 0; i < 2; ++i) {
        f->sets[i].count = f->crowds[i].count;
        if (f->crowds[i].count > 0) f->s.scene.particle_set_count = i + 1;
    }
}

/* Returns NULL on failure, with the error in the context. */
static sps_tmap *build(fixture *f, sps_context *context) {
    sps_tmap *map = NULL;
    complete(f);
    if (sps_tmap_create(context, &f->light, &f->settings, &map) != SPS_OK) return NULL;
    if (sps_tmap_add(map, &f->s.scene) == SPS_OK && sps_tmap_finish(map) == SPS_OK) return map;
    sps_tmap_destroy(map);
    return NULL;
}

static sps_tmap *must_build(fixture *f, sps_context *context) {
    sps_tmap *map = build(f, context);
    if (!CHECK(map != NULL)) printf("    technique %d: %s\n", (int)f->settings.technique, sps_error(context));
    return map;
}

static double query_at(const sps_tmap *map, const double point[3]) {
    float depth = -1;
    sps_tmap_query(map, 1, point, &depth, NULL);
    return (double)depth;
}

static double query(const sps_tmap *map, double x, double y, double z) {
    const double point[3] = {x, y, z};
    return query_at(map, point);
}

static double through(const sps_tmap *map, double x, double y, double z) {
    const double point[3] = {x, y, z};
    float transmittance = -1;
    sps_tmap_query(map, 1, point, NULL, &transmittance);
    return (double)transmittance;
}

/* A point on the ray of a texel; only its position comes from the map's own rays. */
static void on_ray(const sps_tmap *map, int face, int x, int y, double t, double point[3]) {
    spsi_ray_point(&map->rays[face], x, y, t, point);
}

/* A rectangle across z. */
static void add_square(fixture *f, int mesh, double x0, double x1, double y, double z) {
    const double corner[3] = {x0, -y, z}, u[3] = {x1 - x0, 0, 0}, v[3] = {0, 2 * y, 0};
    check_add_quad(&f->triangles[mesh], corner, u, v);
}

static sps_mesh *add_mesh(fixture *f, int mesh, double transmittance) {
    sps_mesh *m = check_add_mesh(&f->s, &f->triangles[mesh], 0.5);
    check_translucent(m, transmittance);
    return m;
}

/* ---------------------------------------------------------------------------------------------------- exact answers */

typedef struct answer {
    double depth, slack; /* slack: tolerance for floats */
} answer;

/* The ray from the light through a point: its origin, its unit direction, the point's depth along the axis, and the
   length of the ray per unit of depth. `from`: where light begins on the ray. */
typedef struct ray {
    double origin[3], direction[3], t, length, from;
} ray;

static void ray_to(const fixture *f, const double point[3], ray *r) {
    double forward[3], offset[3];
    for (int i = 0; i < 3; ++i) {
        forward[i] = f->light.camera.target[i] - f->light.camera.position[i];
        offset[i] = point[i] - f->light.camera.position[i];
    }
    vec_normalise(forward);
    if (f->light.omnidirectional) {
        for (int i = 0; i < 3; ++i) forward[i] = 0;
        r->t = 0;
        for (int i = 0; i < 3; ++i) r->t = fmax(r->t, fabs(offset[i]));
        r->length = vec_length(offset) / r->t;
    }
    r->from = 0;
    memcpy(r->origin, f->light.camera.position, sizeof r->origin);
    memcpy(r->direction, offset, sizeof offset);
    if (f->light.omnidirectional) {
        vec_normalise(r->direction);
    } else if (f->light.camera.field_of_view > 0 ||
               (f->light.camera.world_to_clip && f->light.camera.world_to_clip[14] < 0)) {
        vec_normalise(r->direction);
        r->t = vec_dot(offset, forward);
        r->length = vec_length(offset) / r->t;
    } else {
        r->from = -HUGE_VAL;
        r->t = vec_dot(offset, forward);
        r->length = 1;
        memcpy(r->direction, forward, sizeof forward);
        for (int i = 0; i < 3; ++i) r->origin[i] = point[i] - r->t * forward[i];
    }
}

/* The share of a chord before s, 0..1. */
static double chord_share(int soft, double s) {
    s = fmin(fmax(s, 0), 1);
    return soft ? s * s * (3 - 2 * s) : s;
}

static void add_particle_answer(const fixture *f, const ray *r, const sps_particles *set, const sps_particle *p,
                                answer *sum) {
    const double radius = (double)p->radius, end = r->t >= f->settings.far_depth ? HUGE_VAL : r->t * r->length;
    const double range = (f->settings.far_depth - f->settings.near_depth) * r->length;
    double offset[3], along, square, half, depth = (double)p->optical_depth;
    for (int i = 0; i < 3; ++i) offset[i] = (double)p->position[i] - r->origin[i];
    along = vec_dot(offset, r->direction);
    square = vec_dot(offset, offset) - along * along;
    half = square < radius * radius ? sqrt(radius * radius - square) : 0;
    if (set->is_extinction) depth *= radius * (set->soft ? 4.0 / 3 : 2);
    {
        const double share = half / radius, blur = CHORD * (1 + vec_length(offset) / (20 * radius));
        if (square > radius * radius * (1 + 2 * blur)) return;
        sum->slack += depth * fmin(blur / fmax(share, 1e-9), sqrt(2 * blur));
        if (!(half > 0)) return;
        depth *= set->soft ? share * share * share : share;
    }
    const double begins = (r->from - along + half) / (2 * half), ends = (end - along + half) / (2 * half);
    const double part = chord_share(set->soft, ends) - chord_share(set->soft, begins);
    sum->depth += depth * fmax(part, 0);
    sum->slack += 1e-6 * depth + depth / (2 * half) * 1.5 * range * U;
}

/* Optical depth of all particles between the light and a point. */
static answer exact_particles(const fixture *f, const double point[3]) {
    answer sum = {0, 1e-6};
    ray r;
    ray_to(f, point, &r);
    if (r.t < f->settings.near_depth) return sum;
    for (int i = 0; i < 2; ++i)
        for (size_t k = 0; k < f->crowds[i].count; ++k)
            add_particle_answer(f, &r, &f->sets[i], &f->crowds[i].list[k], &sum);
    return sum;
}

static double normal_share(double x) { return 0.5 * erfc(-x / sqrt(2.0)); }

/* -------------------------------------------------------------------------------------------------------- particles */

/* Chords from every side: particles cross near_depth, far_depth and the light's plane, and one contains the light. */
static void test_particles(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4 * WAYS; ++n) {
        const int way = n / 4, soft = n % 2;
        fixture f;
        sps_tmap *map;
        check_random random = {99};
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, way == ROUND ? 33 : SIDE);
        f.settings.near_depth = 1, f.settings.far_depth = 17;
        f.sets[soft].is_extinction = n / 2 % 2;
        scatter(&f, soft, 60, 6, 11);
        add(&f, soft, f.light.camera.position[0] + 0.5, f.light.camera.position[1], f.light.camera.position[2] - 0.25,
            2, 0.7);
        map = must_build(&f, context);
        for (int i = 0; i < 1500 && map; ++i) {
            const int side = f.light.width, x = (int)(side * check_next(&random)),
                      y = (int)(side * check_next(&random));
            const double t = i % 9 == 0 ? 25 : 19 * check_next(&random);
            double point[3];
            answer exact;
            on_ray(map, way == ROUND ? i % 6 : 0, x, y, t, point);
            exact = exact_particles(&f, point);
            if (!CHECK_NEAR(query_at(map, point), exact.depth, exact.slack))
                printf("    way %d soft %d texel %d %d t %g\n", way, soft, x, y, t);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The same with literal numbers: halves, wholes, zeros. */
static void test_plain_numbers(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    add(&f, 0, 0, 0, 1, 2, 3);
    map = must_build(&f, context);
    CHECK_NEAR(query(map, 0, 0, 3.5), 0, 0);
    CHECK_NEAR(query(map, 0, 0, 1), 1.5, 1e-5);
    CHECK_NEAR(query(map, 0, 0, -5), 3, 1e-6);
    CHECK_NEAR(query(map, 1, 0, -5), 3 * sqrt(3.0) / 2, 3e-6);
    CHECK_NEAR(query(map, 0.5, 0, -5), 0.5 * (3 + 3 * sqrt(3.0) / 2), 3e-6); /* between two texels */
    CHECK_NEAR(query(map, 30, 0, -5), 0, 0);
    CHECK_NEAR(query(map, 4.4, 0, -5), query(map, 4, 0, -5), 0); /* the outer half of the last texel is its own */
    sps_tmap_destroy(map);
    f.crowds[0].count = 0;
    for (int soft = 0; soft < 2; ++soft) { /* a light at the centre of a particle sees half of it */
        see(&f, SPOT, SIDE);
        f.crowds[0].count = f.crowds[1].count = 0;
        add(&f, soft, 0, 0, 10, 2, 4);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 2, 2e-6);
        CHECK_NEAR(query(map, 0, 0, 12), 0, 0); /* behind the light */
        sps_tmap_destroy(map);
        f.crowds[soft].count = 0;
        add(&f, soft, 0, 0, 13, 2, 4); /* entirely behind it */
        add(&f, soft, 0, 0, 0, 0, 1e18);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 0, 0);
        CHECK(sps_tmap_starts(map)[SIDE * SIDE] == 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Between texels the result is bilinear in those of four texels at the point's own depth; it is clamped for half a
   texel beyond the outermost texels' centres, and 0 outside. */
static void test_between_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    check_random random = {3};
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    scatter(&f, 0, 40, 4, 21);
    scatter(&f, 1, 40, 4, 22);
    map = must_build(&f, context);
    for (int i = 0; i < 600 && map; ++i) {
        const double x = 10.4 * (check_next(&random) - 0.5), y = 10.4 * (check_next(&random) - 0.5);
        const double z = 10 - 20 * check_next(&random), fx = x - floor(x), fy = y - floor(y);
        double sum = 0, slack = 0;
        for (int k = 0; k < 4; ++k) {
            const double point[3] = {fmin(fmax(floor(x) + k % 2, -4), 4), fmin(fmax(floor(y) + k / 2, -4), 4), z};
            const answer exact = exact_particles(&f, point);
            const double weight = (k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy);
            sum += weight * exact.depth, slack += weight * exact.slack;
        }
        if (fabs(x) > 4.5 || fabs(y) > 4.5) sum = slack = 0;
        CHECK_NEAR(query(map, x, y, z), sum, slack);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* A particle smaller than a texel becomes a ball of 3/4 of a texel, R, of the same mass; and up to a radius of one
   texel, wherever it lies between texels, its chords add up to its mass, 2/3 pi r^2 depth, or 2/5 if it is soft. Point
   samples alone would have 0.21 to 1.47 of it (test_sampling). What remains are CHORD's 1e-3 at up to four rims, of a
   sum of at least 1.17 in the map and in its weight. From 1.5 texels on chords are unchanged (test_particles). */
static void test_small_particles(void) {
    static const double radii[4] = {0.01, 0.5, 0.9, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int soft = n % 2;
        const double r = radii[n / 2], depth = r < SPSI_BALL_LEAST ? 0.0009 : 0.1; /* denser ones keep what they stop */
        const double whole = depth * r * r * PI * (soft ? 2.0 / 5 : 2.0 / 3);
        for (int i = 0; i < 256; ++i) {
            const double px = (i % 16 + 0.5) / 16, py = (i / 16 + 0.5) / 16;
            double sum = 0, point[3];
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_OPACITY);
            f.settings.components = 2;
            f.sets[soft].is_extinction = i / 2 % 2;
            see(&f, i % 2 ? ORTHO : ORTHO_TURNED, SIDE);
            map = build(&f, context);
            on_ray(map, 0, 4, 4, 10, point);
            vec_along(point, map->rays[0].a, px, point);
            vec_along(point, map->rays[0].b, py, point);
            sps_tmap_destroy(map);
            add(&f, soft, point[0], point[1], point[2], r,
                depth / (f.sets[soft].is_extinction ? r * (soft ? 4.0 / 3 : 2) : 1));
            map = must_build(&f, context);
            for (int k = 0; k < SIDE * SIDE && map; ++k) sum += (double)sps_tmap_texels(map)[2 * k + 1];
            CHECK_CASE("Found in review", "particles below a texel, wherever they lie in it", "their mass, relative",
                       fabs(sum / whole - 1), 0.007,
                       "chords to 1e-3 at four rims, of a sum of 1.17, in map and weight");
            sps_tmap_destroy(map);
        }
    }
    sps_destroy(context);
}

/* The same around a light, at cubes' edges and corners: texels count by their solid angle, those on an edge for half of
   it in either face. The weights and the measurement use the same sum. */
static void test_small_particles_around(void) {
    enum { FACE = 33 };
    sps_context *context = sps_create(NULL, NULL);
    check_random random = {61};
    for (int n = 0; n < 240; ++n) {
        const int axis = n % 3, soft = n / 3 % 2, near_edge = n % 5 > 0, near_corner = n % 5 > 2;
        const double pitch = 2.0 / (FACE - 1), radius = 4 * pitch * (0.02 + 0.98 * check_next(&random));
        const double side[2] = {near_edge ? 1 + 6 * pitch * (check_next(&random) - 0.5) : check_next(&random),
                                near_corner ? 1 + 6 * pitch * (check_next(&random) - 0.5)
                                            : 2 * check_next(&random) - 1};
        const double sign = n % 2 ? 4 : -4, depth = radius < 4 * pitch ? 0.0009 : 1;
        double offset[3], sum = 0, exact;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        f.settings.components = 1;
        see(&f, ROUND, FACE);
        offset[axis] = sign, offset[(axis + 1) % 3] = sign * side[0], offset[(axis + 2) % 3] = sign * side[1];
        add(&f, soft, f.light.camera.position[0] + offset[0], f.light.camera.position[1] + offset[1],
            f.light.camera.position[2] + offset[2], radius, depth);
        map = must_build(&f, context);
        for (int i = 0; i < 6 * FACE * FACE && map; ++i) {
            const int x = i % FACE, y = i / FACE % FACE;
            const double u = x * pitch - 1, v = y * pitch - 1;
            const double part = (x % (FACE - 1) ? 1 : 0.5) * (y % (FACE - 1) ? 1 : 0.5);
            sum += (double)sps_tmap_texels(map)[i] * part * pitch * pitch * pow(1 + u * u + v * v, -1.5);
        }
        exact = depth * PI * radius * radius * (soft ? 2.0 / 5 : 2.0 / 3) / vec_dot(offset, offset);
        if (!CHECK_NEAR(sum, exact, 0.007 * exact)) printf("    at %g %g\n", side[0], side[1]);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------------------------- volumes */

/* A box of uniform gas, rotated about z and x by an angle. */
static sps_volume *add_box(fixture *f, int n, double half, double angle, double extinction) {
    const double c = cos(angle), s = sin(angle);
    const double axes[3][3] = {{c, s, 0}, {-s * c, c * c, s}, {s * s, -c * s, c}};
    sps_volume *volume = check_add_volume(&f->s, n, n, n, check_box(0, 0, 0, 1, 1, 1));
    for (int k = 0; k < 3; ++k)
        for (int i = 0; i < 3; ++i) {
            volume->placement.axis[k][i] = 2 * half * axes[k][i];
            volume->placement.origin[i] -= half * axes[k][i];
        }
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)extinction;
    return volume;
}

static double transfer_at(const sps_transfer *transfer, double value) {
    const sps_transfer_point *p = transfer->points;
    if (value <= (double)p[0].value) return (double)p[0].extinction;
    for (int i = 1; i < transfer->point_count; ++i)
        if (value <= (double)p[i].value) {
            const double part = (value - (double)p[i - 1].value) / ((double)p[i].value - (double)p[i - 1].value);
            return (double)p[i - 1].extinction + part * ((double)p[i].extinction - (double)p[i - 1].extinction);
        }
    return (double)p[transfer->point_count - 1].extinction;
}

/* The sum of a row of kernels that begins at a face, `at` voxels behind that. It is not exactly a Gaussian's integral:
   voxels are points, with a variance smaller than that of their cells by 1/12. */
static double face_at(double at) {
    static float table[8 * 64 + 2];
    const double x = fmin(fmax(at + 4, 0), 7.99) * 64;
    const int i = (int)x;
    if (!(table[8 * 64] > 0))
        for (int k = 0; k < 8 * 64 + 2; ++k)
            for (int n = 0; n < 9; ++n)
                table[k] += (float)(exp(-0.5 * pow((k / 64.0 - 4.5 - n) / 0.65, 2)) / (0.65 * sqrt(2 * PI)));
    return (double)table[i] + (x - i) * ((double)table[i + 1] - (double)table[i]);
}

/* Extinction of the fixture's boxes at a point: a lattice of kernels is uniform inside, and fades out at its faces. */
static double boxes_at(const fixture *f, const double point[3]) {
    double sum = 0;
    for (int i = 0; i < f->s.scene.volume_count; ++i) {
        const sps_volume *volume = &f->s.volume[i];
        double value = 1, offset[3];
        vec_along(point, volume->placement.origin, -1, offset);
        for (int k = 0; k < 3; ++k) {
            const double *axis = volume->placement.axis[k], n = volume->size[k];
            const double at = vec_dot(offset, axis) / vec_dot(axis, axis) * n;
            value *= face_at(fmin(at, n - at));
        }
        sum += volume->transfer ? transfer_at(volume->transfer, value) : value * (double)volume->extinction;
    }
    return sum;
}

/* Along a ray to a point by the midpoint rule, in steps of 0.02; all gas is within 5 of the origin. */
static double exact_boxes(const fixture *f, const ray *r, double end) {
    const double middle = -vec_dot(r->origin, r->direction), low = fmax(middle - 5, r->from);
    const double high = fmin(middle + 5, end);
    const int steps = (int)ceil((high - low) / 0.02);
    double sum = 0;
    for (int i = 0; i < steps; ++i) {
        double point[3];
        vec_along(r->origin, r->direction, low + (i + 0.5) * (high - low) / steps, point);
        sum += boxes_at(f, point) * (high - low) / steps;
    }
    return sum;
}

typedef struct box_case {
    int way;
    double slab; /* voxels */
    double angle;
    int classified, second;
} box_case;

static void check_boxes(const fixture *f, const sps_tmap *map, double slab, double slope, double density) {
    check_random random = {31};
    for (int i = 0; i < 250; ++i) {
        const int side = f->light.width, middle = side / 2;
        const int x = middle + (int)(side * 0.35 * (check_next(&random) - 0.5));
        const int y = middle + (int)(side * 0.35 * (check_next(&random) - 0.5));
        const double t = 4 + 12 * check_next(&random);
        double point[3], exact, whole;
        ray r;
        on_ray(map, 0, x, y, t, point);
        ray_to(f, point, &r);
        exact = exact_boxes(f, &r, t * r.length);
        whole = exact_boxes(f, &r, HUGE_VAL);
        /* straight lines between slabs: of a curve with such a slope, or of any that rises no faster than `density` */
        if (!CHECK_NEAR(query_at(map, point), exact,
                        RIPPLE * whole + r.length * fmin(slab * slab / 8 * slope, slab / 4 * density) + 1e-5))
            printf("    way %d slab %g texel %d %d t %g whole %g\n",
                   f->light.camera.world_to_clip ? 2 : f->settings.cubic, slab, x, y, t, whole);
    }
}

/* Uniform boxes, one and two that overlap, classified ones, upright and rotated, seen by every light, in slabs from a
   quarter of a voxel to one that contains everything. A box's density rises no faster than a Gaussian of 0.65 voxels at
   its faces, once for each face that a ray meets at one point: two if it is rotated. */
static void test_boxes(void) {
    static const sps_transfer_point points[3] = {{0.2f, {0, 0, 0}, 0}, {0.7f, {0, 0, 0}, 1}, {1.2f, {0, 0, 0}, 1.2f}};
    static const box_case cases[] = {
        {ORTHO, 0.25, 0, 0, 0},      {ORTHO, 1, 0, 0, 0},         {ORTHO, 2, 0, 0, 0},
        {ORTHO, 4, 0, 0, 0},         {ORTHO, 1000, 0, 0, 0},      {ORTHO, 0.5, 0.5, 0, 0},
        {SPOT, 0.5, 0, 0, 0},        {SPOT, 0.5, 0.4, 0, 0},      {ORTHO_TURNED, 0.5, 0, 0, 0},
        {SPOT_TURNED, 0.5, 0, 0, 0}, {ORTHO_MATRIX, 1, 0, 0, 0},  {SPOT_MATRIX, 1, 0, 0, 0},
        {ORTHO, 0.5, 0.3, 0, 1},     {SPOT_TURNED, 0.5, 0, 0, 1}, {ORTHO, 0.4, 0, 1, 0},
        {SPOT, 0.4, 0.3, 1, 0},      {ORTHO, 0.4, 0, 1, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (size_t n = 0; n < sizeof cases / sizeof *cases; ++n) {
        const box_case *c = &cases[n];
        const double edge = 0.25, slab = fmin(c->slab * edge, 12), steepest = 2 / (sqrt(2 * PI) * 0.65 * edge);
        sps_transfer transfer;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        memset(&transfer, 0, sizeof transfer);
        transfer.points = points, transfer.point_count = 3;
        see(&f, c->way, 54);
        f.settings.near_depth = 2;
        f.light.quality = SPS_QUALITY_HIGH;
        f.light.slab = c->slab;
        if (c->classified)
            add_box(&f, 20, 2.5, c->angle, 0)->transfer = &transfer;
        else
            add_box(&f, 20, 2.5, c->angle, 0.8);
        if (c->second) add_box(&f, 12, 1.5, 0.7, 0.5);
        map = must_build(&f, context);
        {
            const int failed = check_failed;
            if (map) check_boxes(&f, map, slab, steepest * (c->classified ? 2 : 0.8 + 0.5 * c->second), 1.3);
            if (check_failed > failed) printf("    case %d\n", (int)n);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A box of voxels that are about as fine as texels, and fill the map: every texel has the optical depth of its ray. */
static void test_fine_voxels(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int spot = 0; spot < 2; ++spot) {
        enum { MANY = 80 };
        fixture f;
        sps_volume *volume;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, spot ? SPOT : ORTHO, MANY);
        f.light.quality = SPS_QUALITY_HIGH;
        volume = add_box(&f, MANY, 8, 0, 0.1);
        volume->size[2] = 4;
        volume->placement.axis[2][2] = 8, volume->placement.origin[2] = -4;
        map = must_build(&f, context);
        for (int i = 0; i < MANY * MANY && map; ++i) {
            double point[3];
            on_ray(map, 0, i % MANY, i / MANY, 20, point);
            {
                const double dx = spot ? point[0] / 20 : 0, dy = spot ? point[1] / 20 : 0;
                const double exact = 0.8 * sqrt(1 + dx * dx + dy * dy);
                if (!CHECK_NEAR(query_at(map, point), exact, RIPPLE * exact))
                    printf("    texel %d %d\n", i % MANY, i / MANY);
            }
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

static double blob(const void *user, const double p[3]) { return exp(-0.5 * vec_dot(p, p)) + 0 * !user; }

/* The maximum sum of kernels from beyond a cut, in standard deviations, at any position between voxels. */
static double beyond_cut(double cut) {
    double most = 0;
    for (int place = 0; place < 17 * 17; ++place) {
        double sum = 0;
        for (int i = 0; i < 13 * 13; ++i) {
            const double dx = i % 13 - 6 - place % 17 / 16.0, dy = i / 13 - 6 - place / 17 / 16.0;
            const double square = (dx * dx + dy * dy) / (0.65 * 0.65);
            sum += square > cut * cut ? exp(-0.5 * square) / (2 * PI * 0.65 * 0.65) : 0;
        }
        most = fmax(most, sum);
    }
    return most;
}

/* A box of voxels from an array in a map of one component, which has the total depth of its gas. */
static sps_volume *begin_voxels(fixture *f, check_array *array, int quality) {
    sps_volume *volume;
    begin(f, SPS_TMAP_OPACITY);
    f->settings.components = 1;
    f->light.quality = (sps_quality)quality;
    volume = add_box(f, array->size[0], array->size[0] / 2.0, 0, 1);
    volume->read_fn = check_read_array, volume->user = array;
    return volume;
}

/* "Exact" maps of volumes are as exact as their kernels: quality cuts these where a footprint has lost the share
   e = exp(-cut^2 / 2) of its mass, and rescales the rest to compensate. So a ray loses what comes from beyond the cut,
   at most the sum of such kernels times the fullest column of voxels, and gains e of its own: the map and the field
   f(p) are no farther apart, except for 4e-4, the error of the closed form of kernels. A checkered gas, and isolated
   voxels, are the most uneven cases. */
static void test_cut_kernels(void) {
    enum { VOXELS = 12 };
    static const double cuts[5] = {3.3, 2.8, 3.3, 2.5 / 0.65, 2.5 / 0.65};
    static float values[VOXELS * VOXELS * VOXELS];
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int quality = 1 + n % 4;
        const double raised = expm1(0.5 * cuts[quality] * cuts[quality]), beyond = beyond_cut(cuts[quality]);
        double column[VOXELS * VOXELS] = {0}, fullest = 0;
        check_random random = {99};
        check_array array = {values, {VOXELS, VOXELS, VOXELS}, 0, 0};
        fixture f;
        sps_tmap *map;
        begin_voxels(&f, &array, quality);
        for (int i = 0; i < VOXELS * VOXELS * VOXELS; ++i) {
            const int chequer = i % VOXELS / 2 + i / VOXELS % VOXELS / 2;
            values[i] = n < 4 ? (chequer % 2 ? 8.0f : 0.0f) : check_next(&random) < 0.02 ? 8.0f : 0;
            column[i % (VOXELS * VOXELS)] += (double)values[i];
        }
        for (int i = 0; i < VOXELS * VOXELS; ++i) fullest = fmax(fullest, column[i]);
        map = must_build(&f, context);
        for (int texel = 0; texel < SIDE * SIDE && map; ++texel) {
            const double x = texel % SIDE - 4, y = 4 - texel / SIDE;
            double exact = 0;
            for (int i = 0; i < VOXELS * VOXELS; ++i) {
                const double dx = i % VOXELS - 5.5 - x, dy = i / VOXELS - 5.5 - y;
                exact += column[i] * exp(-0.5 * (dx * dx + dy * dy) / (0.65 * 0.65)) / (2 * PI * 0.65 * 0.65);
            }
            if (!CHECK_CASE("Found in review", "volumes in exact maps, at each quality", "the sum of uncut kernels",
                            fabs((double)sps_tmap_texels(map)[texel] - exact),
                            beyond * fullest + (1 / raised + 4e-4) * exact,
                            "what the quality's cut leaves out of the fullest column"))
                printf("    quality %d\n", quality);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Maps cut the kernels of classified volumes where they cut those of a gas, not where a light's sheets do: a voxel
   contributes to a ray 2.12 voxels away at medium, whose kernels end at 2.15, but not at draft, where they end at
   1.82. A texel has the kernel's integral along its ray, 0.21 or 0.0018, or nothing. Half of that decides between the
   two: the sum over a classified slab's parts is not exact. */
static void test_classified_kernels(void) {
    const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0}, {1, {1, 1, 1}, 1}};
    const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    static float values[10 * 10 * 10];
    sps_context *context = sps_create(NULL, NULL);
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_MEDIUM; ++quality) {
        check_array array = {values, {10, 10, 10}, 0, 0};
        fixture f;
        sps_tmap *map;
        values[555] = 1;
        begin_voxels(&f, &array, quality)->transfer = &transfer;
        map = must_build(&f, context);
        if (!map) return;
        for (int i = 0; i < 2; ++i) { /* the texels at (0,0) and (2,2) */
            const double square = i ? 4.5 : 0.5, kernel = exp(-0.5 * square / (0.65 * 0.65)) / (2 * PI * 0.65 * 0.65);
            const int is_cut = i && quality == SPS_QUALITY_DRAFT;
            CHECK_NEAR((double)sps_tmap_texels(map)[i ? 2 * SIDE + 6 : 4 * SIDE + 4], is_cut ? 0 : kernel,
                       0.5 * kernel);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A Gaussian of variance 1, sampled at voxels of 0.25 and convolved with kernels, is one of variance 1 + 0.65^2 / 16
   and the same mass; its integral along any ray is an error function. Errors: interpolation between slabs, by the
   density's steepest slope, e^-1/2; and the box's end at 4 standard deviations, beyond which 4e-4 is left. */
static void test_blob(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < ROUND; ++way) {
        const double variance = 1 + 0.65 * 0.65 / 16, deviation = sqrt(variance), slab = 0.125;
        check_random random = {8};
        fixture f;
        sps_tmap *map;
        sps_volume *volume;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, 54);
        f.light.quality = SPS_QUALITY_HIGH;
        volume = add_box(&f, 32, 4, way % 2 ? 0.6 : 0, 1);
        f.field.value_fn = blob;
        f.field.user = &f;
        volume->read_fn = NULL, volume->eval_fn = check_eval_field, volume->user = &f.field;
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3], along, square, exact;
            ray r;
            on_ray(map, 0, (int)(54 * check_next(&random)), (int)(54 * check_next(&random)),
                   5 + 10 * check_next(&random), point);
            ray_to(&f, point, &r);
            along = -vec_dot(r.origin, r.direction);
            square = vec_dot(r.origin, r.origin) - along * along;
            exact = sqrt(2 * PI) / variance * exp(-0.5 * square / variance);
            CHECK_NEAR(query_at(map, point), exact * normal_share((r.t * r.length - along) / deviation),
                       RIPPLE * exact + 4e-4 + slab * slab / 8 * exp(-0.5) * r.length);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------------- polygons */

/* Opaque surfaces in every technique: nothing before, everything behind, beginning at the bias, which is two texels'
   width by default; a fraction if only some of the four texels are covered. */
static void test_opaque(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4 * (TECHNIQUES + 1); ++n) {
        const int given = n % 2, spot = n / 2 % 2;
        const double bias = given ? 0.01 : spot ? 2.5 : 2; /* t - 10 = 2 t / 10 at 12.5 */
        fixture f;
        sps_tmap *map;
        begin(&f, n < 4 * TECHNIQUES ? 1 + n / 4 : SPS_TMAP_DEPTH);
        see(&f, spot ? SPOT : ORTHO, SIDE);
        if (given) f.settings.surface_bias = bias;
        if (given) add_square(&f, 0, -30, -0.5, 30, -6); /* behind the first surface, which counts */
        add_square(&f, 0, -30, -0.5, 30, 0);
        if (!given) add_square(&f, 0, -30, -0.5, 30, -6);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        if (map) {
            const double behind = spot ? 1.5 : 1; /* the position of diverged rays at z = -5 */
            CHECK_NEAR(query(map, -1, 0, 1e-3), 0, 0);
            CHECK_NEAR(query(map, -1, 0, -0.99 * bias), 0, 1e-15); /* the logarithm of a sum of weights */
            CHECK_NEAR(query(map, -1.5, 0, -1.01 * bias), DARK, 0);
            CHECK_NEAR(through(map, -1.5, 0, -1.01 * bias), 0, 0);
            CHECK_NEAR(query(map, spot ? -31 : -2, 0, -300), DARK, 0);
            CHECK_NEAR(query(map, -0.25 * behind, 0, -5), -log(0.75), 1e-6);
            CHECK_NEAR(through(map, -0.25 * behind, 0, -5), 0.75, 1e-6);
            CHECK_NEAR(query(map, 0.001, 0, -9), 0, 1e-15);
            CHECK(sps_tmap_surfaces(map) && sps_tmap_surfaces(map)[3] < 0.51f && sps_tmap_surfaces(map)[4] > 1);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A depth map holds a float per texel, the first opaque surface, and no gas: what lies between light and surface, gas
   or a sheet that lets light pass, does not count. Without opaque surfaces it holds nothing. */
static void test_depth_maps(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int opaque = 0; opaque < 2; ++opaque) {
        fixture f;
        sps_tmap *map;
        sps_tmap_info info;
        size_t empty;
        begin(&f, SPS_TMAP_DEPTH);
        map = must_build(&f, context);
        empty = check_bytes_of(map);
        sps_tmap_destroy(map);
        f.settings.surface_bias = 0.01;
        add(&f, 0, 0, 0, 3, 1, 5);
        add(&f, 1, 0, 0, 3, 1, 5);
        add_square(&f, 0, -30, 30, 30, 1);
        add_mesh(&f, 0, 0.3);
        add_square(&f, 1, -30, 30, 30, 0);
        add_mesh(&f, 1, opaque ? 0 : 0.7);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0.1), 0, 1e-15); /* the logarithm of a sum of weights */
        CHECK_NEAR(query(map, 0, 0, -0.1), opaque ? DARK : 0, 0);
        CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.item_floats == 0 && info.float_count == 0);
        CHECK(check_bytes_of(map) == empty + (opaque ? sizeof(float) * SIDE * SIDE : 0));
        CHECK(!sps_tmap_surfaces(map) == !opaque);
        for (int i = 0; i < SIDE * SIDE && opaque; ++i) CHECK_NEAR((double)sps_tmap_surfaces(map)[i], 0.5, 1e-7);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A compressed map of a number of nodes has at most so many in each texel, and no bracket: 0 .. the darkest. */
static void test_few_nodes(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int most = 2; most <= 32; most *= 4) {
        fixture f;
        sps_tmap *map;
        int full = 0;
        begin(&f, SPS_TMAP_COMPRESSED);
        scatter(&f, 0, 60, 3, 61);
        scatter(&f, 1, 60, 3, 62);
        f.settings.components = 2 * most;
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map; ++i) {
            const int nodes = (int)(sps_tmap_starts(map)[i + 1] - sps_tmap_starts(map)[i]);
            CHECK(nodes <= most);
            full += nodes == most;
        }
        if (most < 32) CHECK(full > 5);
        for (int i = 0; i < 50 && map; ++i) {
            const double at[3] = {-2 + 0.08 * i, 0.5, -9};
            float least = 7, high = 7;
            CHECK(sps_tmap_bracket(map, 1, at, &least, &high) == SPS_OK);
            CHECK_NEAR((double)least, 0, 0);
            CHECK_NEAR((double)high / DARK, 1, 1e-6);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* If texels are not square, the bias is that of their longer side. */
static void test_bias_of_oblong_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const int spot = n / 2;
        const double bias = spot ? 15 : 6; /* two texels of 3; of a spot 0.3 t: t - 10 = 2 * 0.3 t */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, spot ? SPOT_MATRIX : ORTHO_MATRIX, SIDE);
        f.matrix[n % 2 ? 0 : 5] /= 3;
        add_square(&f, 0, -90, 90, 90, 0);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, -0.99 * bias), 0, 1e-15);
        CHECK_NEAR(query(map, 0, 0, -1.01 * bias), DARK, 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Polygons behind a light in perspective shade nothing in front of it, and those that extend from behind it to its
   front shade by the part in front. */
static void test_behind_the_light(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const double across[3] = {0, 60, 0}, along[3] = {0, 0, 40}, corner[3] = {-2.5, -30, -5};
        const int opaque = n % 2;
        const double left = opaque ? 0 : 0.5;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, n / 2 ? SPOT_MATRIX : SPOT, SIDE);
        f.settings.surface_bias = 0.01;
        add_square(&f, 0, -30, 30, 30, 10.5);
        add_square(&f, 0, -30, 30, 30, 14);
        check_add_quad(&f.triangles[0], corner, across, along);
        add_mesh(&f, 0, opaque ? 0 : 0.5);
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map; ++i) { /* a ray meets the upright square where x = -2.5 */
            const int x = i % SIDE;
            const double t = 8 + i % 7, at = 10 * 2.5 / (SIDE / 2 - x), shaded = x < SIDE / 2 && at < 15;
            double point[3];
            float passes;
            on_ray(map, 0, x, i / SIDE, t, point);
            sps_tmap_query(map, 1, point, NULL, &passes);
            if (!shaded || fabs(t - at) > 0.1) CHECK_NEAR((double)passes, shaded && t > at ? left : 1, 1e-7);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Surfaces before near_depth count at it, and those just before far_depth shade points behind that; so do translucent
   ones. */
static void test_surfaces_at_the_ends(void) {
    sps_context *context = sps_create(NULL, NULL);
    { /* without a surface, nothing shades at any depth */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        f.settings.near_depth = 5, f.settings.far_depth = 6;
        add_square(&f, 0, -4, -2, 2, 4.5);
        add_mesh(&f, 0, 0);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 3, 0, 2.5), 0, 0);
        CHECK_NEAR(query(map, 3, 0, -1e6), 0, 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    for (int spot = 0; spot < 2; ++spot)
        for (int opaque = 0; opaque < 2; ++opaque) {
            const double dark = opaque ? DARK : log(2.0);
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_DEEP);
            see(&f, spot ? SPOT : ORTHO, SIDE);
            f.settings.near_depth = 5, f.settings.far_depth = 15.5;
            f.settings.surface_bias = 1;
            add_square(&f, 0, -30, 0, 30, 8);
            add_square(&f, 0, 0, 30, 30, -5);
            add_mesh(&f, 0, opaque ? 0 : 0.5);
            map = must_build(&f, context);
            CHECK_NEAR(query(map, -1.5, 0, 5.5), 0, 0); /* before near_depth */
            CHECK_NEAR(query(map, -1.5, 0, 3.9), dark, 1e-7);
            CHECK_NEAR(query(map, -4, 0, -50), dark, 1e-7);
            CHECK_NEAR(query(map, 2, 0, -4.9), 0, 0);
            CHECK_NEAR(query(map, 2, 0, -5.4), opaque ? 0 : dark, 1e-7);
            CHECK_NEAR(query(map, 2, 0, -5.9), opaque ? 0 : dark, 1e-7); /* within the bias, behind far_depth */
            CHECK_NEAR(query(map, 2, 0, -6.1), dark, 1e-7);
            CHECK_NEAR(query(map, 3, 0, -50), dark, 1e-7);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* A sheet of transmittance 1/2 has T = 1/2, two of 1/4 a sixteenth, one of 1 no shadow: exactly at any point for lists,
   at planes for opacity maps, and behind everything for all techniques that are exact there. -log T is a float. */
static void test_translucent(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 3; ++n) {
            static const double transmittance[3] = {0.5, 0.25, 1}, passes[3] = {0.5, 0.0625, 1};
            const double t = passes[n];
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            if (technique == SPS_TMAP_OPACITY) f.settings.components = 4;
            f.settings.epsilon = 1e-6f;
            add_square(&f, 0, -30, 30, 30, 0);
            if (n == 1) add_square(&f, 0, -30, 30, 30, 0);
            add_mesh(&f, 0, transmittance[n]);
            map = must_build(&f, context);
            CHECK(sps_tmap_surfaces(map) == NULL);
            CHECK_NEAR(query(map, 0, 0, 9), 0, n == 2 ? 1e-15 : 0.1); /* series ring by 9 % of it */
            CHECK_NEAR(through(map, 1, 0.5, -10), t, 2e-6 * t);
            CHECK_NEAR(query(map, 1, 0.5, -10), -log(t), 2e-6);
            if (technique <= SPS_TMAP_COMPRESSED || technique == SPS_TMAP_OPACITY ||
                technique == SPS_TMAP_DEEP_OPACITY) {
                CHECK_NEAR(through(map, 1, 0.5, 0), t, 2e-6 * t); /* at the sheet itself: u = 1/2 is a plane, too */
                CHECK_NEAR(query(map, 1, 0.5, 5), 0, 0);
            }
            if (n == 2 && technique <= SPS_TMAP_COMPRESSED) CHECK(sps_tmap_starts(map)[SIDE * SIDE] == 0);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* A sheet in the plane t = 2 + 2 x, which crosses the light's own: the ray whose x is X t meets it at t = 2 / (1 - 2
   X). Corners lie on both sides of the light, one far behind it. */
static void test_across_the_light(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const double corner[3] = {-20, -25, 10 + 38}, u[3] = {40, 0, -80}, v[3] = {0, 50, 0}; /* z = 8 - 2 x */
        const int opaque = n % 2, round = n / 2;
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, round ? ROUND : SPOT, SIDE);
        check_set3(f.light.camera.position, 0, 0, 10);
        f.settings.surface_bias = 1e-4;
        check_add_quad(&f.triangles[0], corner, u, v);
        add_mesh(&f, 0, opaque ? 0 : 0.5);
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE && map && !round; ++i) {
            const double exact = 2 / (1 - 2 * (i % SIDE - 4) * 0.1) / 20; /* u */
            const uint32_t *starts = sps_tmap_starts(map);
            CHECK(starts[i + 1] - starts[i] == (opaque ? 0 : 1));
            CHECK_NEAR((double)(opaque ? sps_tmap_surfaces(map)[i] : sps_tmap_texels(map)[4 * starts[i]]), exact, U);
        }
        for (int i = 0; i < 800 && map; ++i) { /* the shadow begins at the sheet, in directions all around the light */
            double point[3], t;
            on_ray(map, round ? i % 6 : 0, i / 6 % SIDE, i / 54 % SIDE, 18.0 * (i % 97 + 1) / 97, point);
            t = 10 - point[2] - 2 * point[0];
            if (fabs(t - 2) > 0.001)
                CHECK_NEAR(through(map, point[0], point[1], point[2]), t < 2 ? 1 : opaque ? 0 : 0.5, 1e-7);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A net of triangles with shared corners, some of which lie exactly at the centres of texels. */
static void add_net(fixture *f, const double origin[3], const double u[3], const double v[3], int n, double jitter) {
    check_random random = {77};
    double point[20][20][3], normal[3];
    vec_cross(u, v, normal);
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
            const int inner = i > 0 && j > 0 && i < n && j < n;
            const double rise = inner ? jitter * check_next(&random) : 0, slide = inner && (i + j) % 2 ? jitter : 0;
            for (int k = 0; k < 3; ++k)
                point[j][i][k] = origin[k] + (i + slide * 0.7) / n * u[k] + (j - slide * 0.3) / n * v[k] +
                                 rise * normal[k] / vec_length(normal);
        }
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            check_add_corners(&f->triangles[0], point[j][i], point[j][i + 1], point[j + 1][i + 1]);
            if (i % 2)
                check_add_corners(&f->triangles[0], point[j][i], point[j + 1][i + 1], point[j + 1][i]);
            else
                check_add_corners(&f->triangles[0], point[j + 1][i], point[j][i], point[j + 1][i + 1]);
        }
}

/* Every ray meets a closed net once, even exactly through edges and corners; triangles without area have no effect. */
static void test_watertight(void) {
    static const double nowhere[2][3] = {{-1, -1, 1}, {3, 2, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < WAYS; ++way)
        for (int jitter = 0; jitter < 2; ++jitter) {
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_DEEP);
            see(&f, way, way == ROUND ? 17 : 67);
            if (way == ROUND) {
                check_set3(f.light.camera.position, 0, 0, 0);
                for (int face = 0; face < 6; ++face) { /* a cube whose edges are the rays that faces share */
                    double origin[3] = {0, 0, 0}, u[3] = {0, 0, 0}, v[3] = {0, 0, 0};
                    origin[face / 2] = face % 2 ? -4 : 4;
                    origin[(face / 2 + 1) % 3] = origin[(face / 2 + 2) % 3] = -4;
                    u[(face / 2 + 1) % 3] = v[(face / 2 + 2) % 3] = 8;
                    add_net(&f, origin, u, v, 8, jitter * 0.25);
                }
            } else {
                const double w = way == SPOT_TURNED ? 120 : 18;
                const double origin[3] = {-w / 2, -w / 2, 0}, u[3] = {w, 0, 0}, v[3] = {0, w, 0};
                add_net(&f, origin, u, v, 18, jitter * 0.3);
            }
            for (int i = 0; i < 3; ++i) check_add_corners(&f.triangles[0], nowhere[0], nowhere[0], nowhere[1]);
            add_mesh(&f, 0, 0.5);
            map = must_build(&f, context);
            for (int i = 0; map && i < f.light.width * f.light.height * map->face_count; ++i)
                if (!CHECK(sps_tmap_starts(map)[i + 1] - sps_tmap_starts(map)[i] == 1))
                    printf("    way %d texel %d jitter %d\n", way, i, jitter);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------- all of it in every technique */

/* A rotated blob, uniform and soft particles, a translucent sheet, and an opaque one below half of that. */
static void begin_mixed(fixture *f, int technique) {
    const double slope[2][3] = {{30, 0, 9}, {0, 30, 4}}, corner[3] = {-15, -15, -8}, shelf[3] = {0, 40, 0};
    const double edge[3] = {0.3, -20, -6}, across[3] = {20, 0, -2};
    begin(f, technique);
    f->light.width = 21, f->light.height = 17;
    scatter(f, 0, 12, 4, 5);
    scatter(f, 1, 12, 4, 6);
    f->field.value_fn = blob;
    f->field.user = f;
    {
        sps_volume *volume = add_box(f, 12, 4, 0.6, 0.7);
        volume->read_fn = NULL, volume->eval_fn = check_eval_field, volume->user = &f->field;
    }
    check_add_quad(&f->triangles[0], corner, slope[0], slope[1]);
    check_add_quad(&f->triangles[1], edge, across, shelf);
    add_mesh(f, 0, 0.6);
    add_mesh(f, 1, 0);
}

/* Properties of each technique: T = exp(-depth), no depth below 0, and its bracket contains its own result and the deep
   map's. Sums of the 25 intervals that a ray meets, and of the planes, are floats: 1e-5 of the depth; so is u: the
   densest gas here, a particle of 0.4 across 3.4, has at most 5 per u, and no query comes near the sheet, which might
   count as before or behind. A compressed map's T is within epsilon of the deep map's. */
static void check_technique(const sps_tmap *map, const sps_tmap *deep, float epsilon) {
    const int technique = (int)map->settings.technique;
    int bracketed = 0;
    for (int i = 0; i < 21 * 17 * 24; i += technique == SPS_TMAP_MOMENT ? 5 : 1) {
        double point[3];
        float depth, passes, least, most, exact, exact_passes;
        on_ray(map, 0, i % 21, i / 21 % 17, 20 * ((i / 21 / 17) + 0.37) / 24, point);
        sps_tmap_query(map, 1, point, &depth, &passes);
        sps_tmap_query(deep, 1, point, &exact, &exact_passes);
        sps_tmap_bracket(map, 1, point, &least, &most);
        const double slack = 1e-5 * (1 + fabs((double)exact)) + 10 * U;
        if (!CHECK(depth >= 0 && depth <= 1e15f && passes >= 0 && passes <= 1)) printf("    technique %d\n", technique);
        CHECK_NEAR((double)passes, exp(-(double)depth), 2e-6 * (double)passes + 1e-37);
        CHECK((double)least <= (double)depth + slack && (double)depth <= (double)most + slack);
        if (!CHECK_CASE("Shadows", "brackets of every kind of map against exact columns", "contain the exact depth",
                        fmax((double)least - (double)exact, (double)exact - (double)most), slack,
                        "sums of 25 intervals in floats, 1e-5; u"))
            printf("    technique %d: %g .. %g, exact %g\n", technique, (double)least, (double)most, (double)exact);
        if (technique == SPS_TMAP_DEEP) CHECK(least >= depth && most <= depth);
        if (technique == SPS_TMAP_COMPRESSED)
            CHECK_CASE("Shadows", "compressed map against exact columns", "transmittance",
                       fabs((double)passes - (double)exact_passes), (double)epsilon + 2e-7,
                       "epsilon, as promised; floats");
        bracketed += most < 1e14f && most > least;
    }
    if (technique == SPS_TMAP_OPACITY || technique == SPS_TMAP_DEEP_OPACITY || technique == SPS_TMAP_MOMENT)
        CHECK(bracketed > 500);
}

static void test_techniques(void) {
    static const float epsilons[3] = {0.1f, 0, 0.0005f};
    sps_context *context = sps_create(NULL, NULL);
    for (int way = ORTHO; way <= SPOT; ++way)
        for (int n = 0; n < TECHNIQUES + 5; ++n) {
            const int technique = n < TECHNIQUES       ? 1 + n
                                  : n < TECHNIQUES + 2 ? SPS_TMAP_COMPRESSED
                                                       : n - TECHNIQUES + 2;
            const float epsilon =
                technique == SPS_TMAP_COMPRESSED ? epsilons[n < TECHNIQUES ? 1 : 2 * (n - TECHNIQUES)] : 0;
            fixture f;
            sps_tmap *deep, *map;
            begin_mixed(&f, SPS_TMAP_DEEP);
            see(&f, way, 21);
            f.light.height = 17;
            deep = must_build(&f, context);
            f.settings.technique = (sps_tmap_technique)technique;
            f.settings.epsilon = epsilon;
            if (n >= TECHNIQUES + 2) f.settings.cubic = f.settings.texel_range = 1;
            map = must_build(&f, context);
            if (map && deep) check_technique(map, deep, epsilon > 0 ? epsilon : 0.01f);
            sps_tmap_destroy(map);
            sps_tmap_destroy(deep);
            end(&f);
        }
    sps_destroy(context);
}

/* Soft particles are curves, which the polyline approximates within epsilon, too, thin or thick, alone or one inside
   another; 0.001 is the minimum promised for these, with a bracket that contains the true value for any epsilon, and is
   no wider than epsilon on either side. */
static void test_soft_compressed(void) {
    static const double depths[5] = {0.05, 0.8, 6, 50, 3000};
    static const float epsilons[4] = {0.2f, 0, 0.001f, 1e-8f};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 40; ++n) {
        const double epsilon = n / 5 % 4 == 1 ? 0.01 : fmax((double)epsilons[n / 5 % 4], 0.001);
        fixture f;
        sps_tmap *deep, *map;
        begin(&f, SPS_TMAP_DEEP);
        add(&f, 1, 0, 0, 0, 6, depths[n % 5]);
        for (int i = 0; i < 6 && n >= 20; ++i) add(&f, 1, 0.2 * i, 0.1 * i, i, 2 + 0.3 * i, depths[(n + i) % 5]);
        deep = must_build(&f, context);
        f.settings.technique = SPS_TMAP_COMPRESSED;
        f.settings.epsilon = epsilons[n / 5 % 4];
        map = must_build(&f, context);
        for (int i = 0; i < 700 && map && deep; ++i) {
            const double point[3] = {i % 7 - 3.0, i % 3 * 1.0, 9 - 18.0 * i / 700};
            const double exact = through(deep, point[0], point[1], point[2]);
            float least, most;
            sps_tmap_bracket(map, 1, point, &least, &most);
            if (!CHECK_NEAR(through(map, point[0], point[1], point[2]), exact, epsilon + 2e-7))
                printf("    epsilon %g\n", epsilon);
            if (!CHECK(exact <= exp(-(double)least) + 2e-7 && exact >= exp(-(double)most) - 2e-7) ||
                !CHECK(exp(-(double)least) - exp(-(double)most) <= 2 * epsilon + 4e-7))
                printf("    epsilon %g\n", (double)f.settings.epsilon);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* Particles cut by near_depth, far_depth or the light, soft and uniform, thin and thick. */
static void begin_cut(fixture *f, int way, int technique, double depth) {
    begin(f, technique);
    see(f, way, SIDE);
    f->settings.near_depth = 0.5, f->settings.far_depth = 17;
    for (int soft = 0; soft < 2; ++soft) {
        add(f, soft, f->light.camera.position[0] + 0.7, f->light.camera.position[1] + 0.3,
            f->light.camera.position[2] - 0.4, 2, depth);
        add(f, soft, f->light.camera.position[0] - 1, f->light.camera.position[1], f->light.camera.position[2] - 1, 3.5,
            0.4 * depth);
        add(f, soft, f->light.camera.position[0], f->light.camera.position[1] - 1, f->light.camera.position[2] - 17, 4,
            depth);
        add(f, soft, 1, 1, 0, 2.2, 0.3 * depth);
    }
}

/* The deep map of such particles is exact (test_particles), so brackets and epsilon are compared with it. Sums of nine
   intervals are floats, and so is u: depths are accurate to 1e-6 of the total, at most 9.6, and where an interval may
   begin before or behind, to its depth within U of a range of 16.5, 1.5 U 16.5 / (2 0.75) of it. */
static void test_cut_particles(void) {
    static const int techniques[6] = {SPS_TMAP_COMPRESSED,   SPS_TMAP_COMPRESSED, SPS_TMAP_OPACITY,
                                      SPS_TMAP_DEEP_OPACITY, SPS_TMAP_MOMENT,     SPS_TMAP_MOMENT};
    static const int components[6] = {0, 0, 16, 16, 5, 7};
    static const int ways[3] = {ORTHO, SPOT, ROUND};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3 * 3 * 6; ++n) {
        const double depth = n % 3 == 0 ? 0.3 : n % 3 == 1 ? 3 : 40;
        const int way = ways[n / 3 % 3], which = n / 9;
        fixture f;
        sps_tmap *deep, *map;
        begin_cut(&f, way, SPS_TMAP_DEEP, depth);
        deep = must_build(&f, context);
        f.settings.technique = (sps_tmap_technique)techniques[which];
        f.settings.components = components[which];
        f.settings.epsilon = which == 1 ? 0.001f : 0.01f;
        map = must_build(&f, context);
        for (int i = 0; i < SIDE * SIDE * 20 && map && deep; ++i) {
            const double slack = 9.6 * depth * (1e-6 + 17 * U);
            double point[3], exact;
            float least, most;
            on_ray(map, way == ROUND ? i % 6 : 0, i % SIDE, i / SIDE % SIDE,
                   0.5 + 16.5 * (i / (SIDE * SIDE) + 0.01) / 19, point);
            exact = query_at(deep, point);
            sps_tmap_bracket(map, 1, point, &least, &most);
            if (!CHECK_CASE("Found in review", "soft particles cut by near_depth, far_depth or the light",
                            "brackets contain the exact depth", fmax((double)least - exact, exact - (double)most),
                            slack, "sums of nine intervals in floats; u to its last place"))
                printf("    technique %d way %d depth %g: %g .. %g, exact %g\n", techniques[which], way, depth,
                       (double)least, (double)most, exact);
            if (techniques[which] == SPS_TMAP_COMPRESSED)
                CHECK_CASE("Found in review", "the same particles in a compressed map", "transmittance to epsilon",
                           fabs(through(map, point[0], point[1], point[2]) - exp(-exact)),
                           (double)f.settings.epsilon + 2e-7, "epsilon, as promised; floats");
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* A texel's Fourier coefficients and moments are those of the exact curve, cut or not: sums of its steps, at each
   step's middle, where what a step h of u leaves out is (2 pi k h)^2 / 24, 3e-5 for 12 harmonics and 4000 steps; what
   lies before u = 0 or behind u = 1 is there. */
static void test_cut_sums(void) {
    enum { STEPS = 4000, HARMONICS = 12 };
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 6; ++n) {
        const int way = n % 2 ? SPOT : ORTHO, moments = n / 2 == 1;
        fixture f;
        sps_tmap *deep, *map;
        begin_cut(&f, way, SPS_TMAP_DEEP, 3);
        deep = must_build(&f, context);
        f.settings.technique = moments ? SPS_TMAP_MOMENT : SPS_TMAP_FOURIER;
        f.settings.texel_range = n / 2 == 2;
        f.settings.components = moments ? 7 : 2 * HARMONICS + 1 + 2 * f.settings.texel_range;
        map = must_build(&f, context);
        for (int texel = 0; texel < SIDE * SIDE && map && deep; ++texel) {
            const int range = f.settings.texel_range;
            const float *made = sps_tmap_texels(map) + (size_t)texel * (size_t)f.settings.components;
            const double first = range ? (double)made[0] : 0, length = range ? (double)made[1] - first : 1;
            double sums[2 * HARMONICS + 1] = {0}, before = 0, whole;
            for (int i = -1; i <= STEPS; ++i) { /* the first and the last are the parts before and behind */
                const double u = first + length * fmin((double)(i + 1), (double)STEPS) / STEPS;
                const double at = i < 0 ? 0 : i == STEPS ? 1 : (i + 0.5) / STEPS;
                double point[3], depth;
                on_ray(map, 0, texel % SIDE, texel / SIDE, 0.5 + 16.5 * (i == STEPS ? 2 : u - (u >= 1) * 1e-6), point);
                depth = query_at(deep, point);
                for (int k = 0; k < 2 * HARMONICS + 1; ++k)
                    sums[k] += (depth - before) * (moments ? pow(2 * at - 1, k)
                                                   : k % 2 ? 2 * cos(PI * (k + 1) * at)
                                                           : 2 * sin(PI * k * at));
                before = depth;
            }
            whole = before;
            for (int k = 1; k < f.settings.components - 2 * range && whole > 0; ++k)
                if (!CHECK_NEAR((double)made[2 * range + k], moments ? sums[k] / whole : sums[k],
                                (moments ? 1 : 2 * whole) * 1e-4))
                    printf("    technique %d way %d texel %d component %d\n", (int)f.settings.technique, way, texel, k);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(deep);
    }
    sps_destroy(context);
}

/* Texels are where an engine expects them: rows from the top, faces in order, lists by their starts. */
static void test_texels(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_BEER);
    add(&f, 0, -4, 4, 0, 1.6, 1); /* top left */
    add(&f, 0, 4, -3, 0, 1.6, 2); /* right, last row but one */
    map = must_build(&f, context);
    CHECK_NEAR((double)sps_tmap_texels(map)[2], 1, 1e-6);
    CHECK_NEAR((double)sps_tmap_texels(map)[3 * (7 * SIDE + 8) + 2], 2, 1e-6);
    sps_tmap_destroy(map);
    begin(&f, SPS_TMAP_DEEP);
    see(&f, ROUND, SIDE);
    for (int face = 0; face < 6; ++face) {
        double point[3];
        memcpy(point, f.light.camera.position, sizeof point);
        point[face / 2] += face % 2 ? -5 : 5;
        add(&f, 0, point[0], point[1], point[2], 2, 1 + face);
    }
    map = must_build(&f, context);
    for (int face = 0; face < 6 && map; ++face) {
        const uint32_t *starts = sps_tmap_starts(map) + face * SIDE * SIDE + SIDE * SIDE / 2;
        const float *interval = sps_tmap_texels(map) + 4 * starts[0];
        CHECK(starts[1] - starts[0] == 1);
        CHECK_NEAR((double)interval[0], 3.0 / 20, U);
        CHECK_NEAR((double)interval[1], 7.0 / 20, U);
        CHECK_NEAR((double)interval[2], 1 + face, 1e-5);
        CHECK_NEAR((double)interval[3], 0, 0);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------------------ order */

static size_t float_count(const sps_tmap *map) {
    const size_t texels = (size_t)map->rays[0].width * (size_t)map->rays[0].height * (size_t)map->face_count;
    if (map->technique->lists)
        return (map->settings.technique == SPS_TMAP_DEEP ? 4 : 2) * (size_t)sps_tmap_starts(map)[texels];
    return texels * (size_t)map->settings.components;
}

static int same_map(const sps_tmap *a, const sps_tmap *b) {
    const size_t texels = (size_t)a->rays[0].width * (size_t)a->rays[0].height * (size_t)a->face_count;
    if (float_count(a) != float_count(b) || !sps_tmap_surfaces(a) != !sps_tmap_surfaces(b)) return 0;
    if (memcmp(sps_tmap_texels(a), sps_tmap_texels(b), float_count(a) * sizeof(float)) != 0) return 0;
    if (sps_tmap_surfaces(a) && memcmp(sps_tmap_surfaces(a), sps_tmap_surfaces(b), texels * sizeof(float)) != 0)
        return 0;
    return !sps_tmap_starts(a) || memcmp(sps_tmap_starts(a), sps_tmap_starts(b), (texels + 1) * sizeof(uint32_t)) == 0;
}

/* The same bits for any number of workers, on every run, and for a scene added in several calls. */
static void test_same_bits(void) {
    static const int workers[5] = {0, 0, 1, 2, 7};
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            check_hooks hooks[6];
            sps_context *contexts[6];
            sps_tmap *maps[6];
            for (int w = 0; w < 6; ++w) {
                fixture f;
                memset(&hooks[w], 0, sizeof hooks[w]);
                maps[w] = NULL, contexts[w] = NULL;
                if (check_memory_only() && w > 0 && w < 4) continue;
                hooks[w].worker_count = w < 5 ? workers[w] : 2;
                hooks[w].order = (uint64_t)w;
                contexts[w] = check_context(&hooks[w]);
                begin_mixed(&f, technique);
                f.s.volume[0].size[0] = f.s.volume[0].size[1] = f.s.volume[0].size[2] = 6;
                if (round) see(&f, ROUND, 7);
                if (!round && technique % 3 == 2) f.light.width = 67, f.light.height = 65; /* four tiles */
                f.settings.texel_range = technique == SPS_TMAP_FOURIER && round;
                if (w < 5) {
                    maps[w] = must_build(&f, contexts[w]);
                } else { /* in pieces */
                    sps_scene part;
                    complete(&f);
                    CHECK_OK(contexts[w], sps_tmap_create(contexts[w], &f.light, &f.settings, &maps[w]));
                    part = f.s.scene;
                    part.mesh_count = 1, part.particle_set_count = 0;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    part = f.s.scene;
                    part.volume_count = 0, part.mesh_count = 0, part.particle_set_count = 1;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    part.particles += 1, part.meshes += 1, part.mesh_count = 1;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    CHECK_OK(contexts[w], sps_tmap_finish(maps[w]));
                }
                end(&f);
                if (!CHECK(maps[w] && maps[0] && same_map(maps[0], maps[w])))
                    printf("    technique %d, %d workers, case %d\n", technique, hooks[w].worker_count, w);
            }
            for (int w = 0; w < 6; ++w) {
                sps_tmap_destroy(maps[w]);
                sps_destroy(contexts[w]);
                CHECK(hooks[w].live == 0 && hooks[w].live_blocks == 0);
            }
        }
}

/* A set without particles leaves compressed maps as they are, soft or not. */
static void test_empty_soft_set(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *uniform, *soft;
    fixture f;
    begin(&f, SPS_TMAP_COMPRESSED);
    scatter(&f, 1, 20, 5, 4);
    f.sets[1].soft = 0;
    uniform = must_build(&f, context);
    f.sets[0].soft = 1;
    soft = must_build(&f, context);
    CHECK(uniform && soft && same_map(uniform, soft));
    sps_tmap_destroy(uniform);
    sps_tmap_destroy(soft);
    sps_destroy(context);
}

/* A Beer map has where a texel's gas begins, where it ends, and all of its depth; it is a deep opacity map of one
   plane: the same bits. One even particle is exact anywhere; two sheets at the ends of the range, and one alone, count
   where they are. */
static void test_beer(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        fixture f;
        sps_tmap *maps[2];
        for (int i = 0; i < 2; ++i) {
            begin_mixed(&f, i ? SPS_TMAP_DEEP_OPACITY : SPS_TMAP_BEER);
            if (n % 2) see(&f, ROUND, SIDE);
            if (n >= 2) f.s.scene.mesh_count = f.s.scene.volume_count = 0, f.crowds[1].count = 0;
            if (n >= 2) f.crowds[0].count = 1, f.crowds[0].list[0].radius = 2.5f;
            f.settings.components = 3;
            maps[i] = must_build(&f, context);
            if (i == 0) end(&f);
        }
        CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
        for (int i = 0; i < SIDE * SIDE && maps[0] && n >= 2; ++i)
            for (int k = 0; k <= 20; ++k) {
                double point[3];
                answer exact;
                on_ray(maps[0], n % 2 ? i % 6 : 0, i % SIDE, i / SIDE, 20 * k / 20.0, point);
                exact = exact_particles(&f, point);
                CHECK_CASE("Found in review", "Beer maps of one even particle", "its optical depth",
                           fabs(query_at(maps[0], point) - exact.depth), exact.slack + 1e-5 * exact.depth,
                           "chords to 1e-3 at rims, as everywhere");
            }
        for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
        end(&f);
    }
    for (int n = 0; n < 3; ++n) { /* sheets: at z 0, alone; at 9.9 and at 9.9 and -9.9 */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        add_square(&f, 0, -30, 30, 30, n ? 9.9 : 0);
        if (n == 2) add_square(&f, 0, -30, 30, 30, -9.9);
        add_mesh(&f, 0, 0.5);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, n ? 9.95 : 0.05), 0, 0);
        CHECK_NEAR(query(map, 0, 0, -9.95), (n < 2 ? 1 : 2) * log(2), 1e-6);
        if (n < 2) CHECK_NEAR(query(map, 0, 0, n ? 9.85 : -0.05), log(2), 1e-6);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Shuffled particles: the same bits from lists, which are sorted, and the same up to the round-off of sums of 25
   floats. */
static void test_shuffled(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        check_random random = {17};
        fixture f;
        sps_tmap *maps[2];
        begin_mixed(&f, technique);
        maps[0] = must_build(&f, context);
        for (int i = 0; i < 24; ++i) {
            crowd *c = &f.crowds[i % 2];
            const int a = i / 2, b = (int)(12 * check_next(&random));
            const sps_particle kept = c->list[a];
            c->list[a] = c->list[b], c->list[b] = kept;
        }
        maps[1] = must_build(&f, context);
        if (maps[0] && maps[1] && maps[0]->technique->lists && !CHECK(same_map(maps[0], maps[1])))
            printf("    technique %d\n", technique);
        for (size_t i = 0; maps[0] && maps[1] && !maps[0]->technique->lists && i < float_count(maps[0]); ++i) {
            const size_t n = (size_t)maps[0]->settings.components;
            const float *texel = sps_tmap_texels(maps[0]) + i / n * n;
            double scale = 0;
            for (size_t k = 0; k < n; ++k) scale = fmax(scale, fabs((double)texel[k]));
            CHECK_NEAR((double)sps_tmap_texels(maps[1])[i], (double)texel[i % n], 50 * 6e-8 * scale);
        }
        sps_tmap_destroy(maps[0]);
        sps_tmap_destroy(maps[1]);
        end(&f);
    }
    sps_destroy(context);
}

/* -------------------------------------------------------------------------------------------------------- six faces */

/* Two points on either side of a cube's edge, or all three at a corner, 1e-9 apart: faces share their rays, so each
   technique has the same result except for float round-off, as the ray has different coordinates: a chord's CHORD of 4
   texels' 30 particles; techniques with line slopes of up to 30 (Beer) or roots (moments) amplify that. Deep
   maps are also compared with the exact sum. */
static void check_seams(const fixture *f, const sps_tmap *map, double slack, int exact_is_known) {
    check_random random = {41};
    const int n = f->light.width - 1;
    for (int i = 0; i < 600; ++i) {
        const int a = i % 3, b = (a + 1) % 3, c = (a + 2) % 3; /* the edge runs along c */
        const double sign[2] = {i / 3 % 2 ? 1.0 : -1.0, i / 6 % 2 ? 1.0 : -1.0}, t = 0.5 + 18 * check_next(&random);
        const int k = (int)((n + 1) * check_next(&random));
        const double along = i % 10 == 0 ? (i % 20 ? 1 : -1) : -1 + 2.0 * k / n;
        double one_side[3], other[3];
        one_side[a] = sign[0] * t, one_side[b] = sign[1] * t * (1 - 1e-9), one_side[c] = along * t * (1 - 1e-9);
        other[a] = sign[0] * t * (1 - 1e-9), other[b] = sign[1] * t, other[c] = along * t * (1 - 1e-9);
        vec_along(f->light.camera.position, one_side, 1, one_side);
        vec_along(f->light.camera.position, other, 1, other);
        CHECK_NEAR(query_at(map, one_side), query_at(map, other), slack);
        if (exact_is_known) {
            const answer exact = exact_particles(f, one_side);
            CHECK_NEAR(query_at(map, one_side), exact.depth, exact.slack + 1e-6);
        }
    }
}

/* Particles smaller than a texel are widened to the same size by all faces. */
static void test_seams_of_fine_particles(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    begin(&f, SPS_TMAP_DEEP);
    see(&f, ROUND, 17);
    scatter(&f, 0, 200, 3, 52);
    for (int i = 0; i < 200; ++i) f.crowds[0].list[i].radius = 0.02f, f.crowds[0].list[i].optical_depth = 60;
    map = must_build(&f, context);
    if (map) check_seams(&f, map, 1e-3, 0);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

static void test_seams(void) {
    static const double slack[TECHNIQUES + 1] = {0, 1e-3, 1e-3, 1e-3, 1e-3, 2e-3, 1e-2, 1e-3};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        fixture f;
        sps_tmap *map;
        begin(&f, technique);
        see(&f, ROUND, 17);
        scatter(&f, 0, 30, 7, 51);
        for (int i = 0; i < 30; ++i) f.crowds[0].list[i].radius += 1;
        if (technique == SPS_TMAP_DEEP) f.settings.near_depth = 0.25;
        map = must_build(&f, context);
        if (map) check_seams(&f, map, slack[technique], technique == SPS_TMAP_DEEP);
        CHECK_NEAR(query_at(map, f.light.camera.position), 0, 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A light in the middle of uniform gas, and off-centre: in every direction, the ray's own optical depth, as for other
   boxes; the slab that contains the light counts from the light's position, at most a quarter of a slab off. */
static void test_gas_around(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2; ++n) {
        const double slab = n % 2 ? 0.25 : 0.125, slope = 0.8 * 2 / (sqrt(2 * PI) * 0.65 * 0.25);
        check_random random = {61};
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, ROUND, 17);
        if (n == 0) check_set3(f.light.camera.position, 0, 0, 0);
        f.settings.far_depth = 8;
        f.light.quality = SPS_QUALITY_HIGH;
        f.light.slab = slab / 0.25;
        add_box(&f, 20, 2.5, n * 0.5, 0.8);
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            const int edge = i % 4 == 0; /* a quarter of the rays are those that faces share */
            double point[3], exact;
            ray r;
            on_ray(map, i % 6, edge ? 16 : (int)(17 * check_next(&random)), (int)(17 * check_next(&random)),
                   6 * check_next(&random), point);
            ray_to(&f, point, &r);
            exact = exact_boxes(&f, &r, r.t * r.length);
            CHECK_NEAR(query_at(map, point), exact,
                       r.length * (RIPPLE * 0.8 * 5 + slab * slab / 8 * slope + slab / 4 * 0.8) + 1e-5);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------------- memory */

/* A smaller mixed scene, for many repetitions. */
static void begin_little(fixture *f, int technique) {
    begin_mixed(f, technique);
    f->light.width = f->light.height = SIDE;
    f->s.volume[0].size[0] = f->s.volume[0].size[1] = f->s.volume[0].size[2] = 5;
    f->crowds[0].count = f->crowds[1].count = 4;
}

/* Destroys a map. Returns the bytes that this frees, without the link before each allocation. */
static size_t freed_by(sps_tmap *map, const check_hooks *hooks) {
    const size_t live = hooks->live;
    const long blocks = hooks->live_blocks;
    sps_tmap_destroy(map);
    return live - hooks->live - (size_t)(blocks - hooks->live_blocks) * SPSI_LINK_BYTES;
}

/* Every technique holds the bytes that it reports; if a texel's size is fixed, it reports them from the beginning,
   except for surfaces, which depend on the occluders. */
static void test_bytes(void) {
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 4, opaque = n % 2, round = n / 2 % 2;
        check_hooks hooks;
        sps_context *context;
        fixture f;
        sps_tmap *map = NULL;
        size_t before, bytes;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin_little(&f, technique);
        if (round) see(&f, ROUND, SIDE);
        if (!opaque) check_translucent(&f.s.mesh[1], 0.3);
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        before = check_bytes_of(map);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK(check_bytes_of(map) == before);
        CHECK_OK(context, sps_tmap_finish(map));
        bytes = check_bytes_of(map);
        if (technique > SPS_TMAP_COMPRESSED)
            CHECK(bytes == before + (opaque ? 4u : 0u) * SIDE * SIDE * (round ? 6 : 1));
        else
            CHECK(bytes ==
                  before + sizeof(float) * (float_count(map) + (opaque ? (size_t)(SIDE * SIDE * (round ? 6 : 1)) : 0)));
        CHECK_NEAR((double)freed_by(map, &hooks), (double)bytes, 0);
        sps_destroy(context);
        CHECK(hooks.live == 0 && hooks.live_blocks == 0);
        end(&f);
    }
}

/* Maps made from lists, half of them empty: the map has exactly their size, however they grew from band to band of 64
   rows. */
static void test_bytes_of_half_empty_maps(void) {
    for (int n = 0; n < 9; ++n) {
        const int technique = n < 3 ? SPS_TMAP_DEEP : SPS_TMAP_COMPRESSED, half = n % 3; /* upper, lower, neither */
        const size_t item = technique == SPS_TMAP_DEEP ? sizeof(spsi_interval) : sizeof(spsi_node);
        enum { TALL = 200, TEXELS = TALL * TALL };
        size_t before, bytes;
        check_hooks hooks;
        sps_context *context;
        fixture f;
        sps_tmap *map = NULL;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin(&f, technique);
        f.settings.components = n < 6 ? 0 : 8;
        see(&f, ORTHO, TALL);
        scatter(&f, 0, half < 2 ? 9 : 0, 1, 5);
        for (size_t i = 0; i < f.crowds[0].count; ++i) {
            f.crowds[0].list[i].position[1] += half ? -2.6f : 2.6f;
            f.crowds[0].list[i].radius = 1.5f;
        }
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        before = check_bytes_of(map);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK_OK(context, sps_tmap_finish(map));
        bytes = check_bytes_of(map);
        {
            const uint32_t *starts = sps_tmap_starts(map), count = starts[TEXELS], middle = starts[TEXELS / 2];
            CHECK(half == 2 ? count == 0 : count > 5000 && middle == (half ? 0 : count));
            if (!CHECK_CASE("Found in review", "bytes of lists of maps that are half empty", "exactly their items",
                            fabs((double)bytes - (double)(before + item * (count > 0 ? count : 1))), 0,
                            "exact; no allocation is of 0 bytes"))
                printf("    technique %d: %g bytes of %g items\n", technique, (double)(bytes - before), (double)count);
        }
        CHECK_NEAR((double)freed_by(map, &hooks), (double)bytes, 0);
        sps_destroy(context);
        CHECK(hooks.live == 0);
    }
}

/* A budget reduces a default number of components step by step, down to the technique's minimum, and reserves room for
   surfaces, which are not known yet, if possible; an explicit number is not changed. */
static void test_budget_of_components(void) {
    static const int least[TECHNIQUES + 1] = {0, 0, 0, 1, 3, 3, 5, 3}, step[TECHNIQUES + 1] = {0, 0, 0, 1, 1, 2, 2, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_OPACITY; technique <= TECHNIQUES; ++technique)
        for (int ranged = 0; ranged < (technique == SPS_TMAP_FOURIER ? 2 : 1); ++ranged) {
            const int fewest = least[technique] + 2 * ranged;
            size_t empty;
            int usual;
            sps_tmap_settings resolved;
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            f.settings.texel_range = ranged;
            map = must_build(&f, context);
            resolved = check_settings_of(map);
            usual = resolved.components;
            empty = check_bytes_of(map) - (size_t)(SIDE * SIDE * 4 * usual);
            sps_tmap_destroy(map);
            for (int n = usual + 1; n >= 0; --n) {
                f.settings.byte_budget = empty + (size_t)(SIDE * SIDE * 4 * n);
                f.settings.components = 0;
                map = build(&f, context);
                if (n < fewest) {
                    CHECK(!map && strstr(sps_error(context), "settings.byte_budget is "));
                } else if (CHECK(map != NULL)) {
                    resolved = check_settings_of(map);
                    CHECK(resolved.components <= n && resolved.components >= fewest && resolved.components <= usual);
                    CHECK(resolved.components + step[technique] > n - 1 || n > usual);
                    CHECK(resolved.components < n || resolved.components == fewest);
                    CHECK(check_bytes_of(map) <= f.settings.byte_budget);
                }
                sps_tmap_destroy(map);
                f.settings.components = usual;
                map = build(&f, context);
                CHECK(!map == (n < usual));
                sps_tmap_destroy(map);
            }
        }
    sps_destroy(context);
}

/* Lists and surfaces, whose size depends on the occluders, are refused when it is known, with the number of bytes
   needed. */
static void test_budget_of_lists(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        size_t bytes;
        fixture f;
        sps_tmap *map;
        begin_little(&f, technique);
        map = must_build(&f, context);
        bytes = check_bytes_of(map);
        f.settings.components = map->settings.components;
        sps_tmap_destroy(map);
        for (int n = 0; n < 4; ++n) {
            const size_t less[4] = {0, 1, 300, bytes / 8};
            f.settings.byte_budget = bytes - less[n];
            map = build(&f, context);
            if (n == 0) {
                CHECK(map && check_bytes_of(map) == bytes);
            } else {
                const char *takes = strstr(sps_error(context), "the map takes ");
                CHECK_CASE("Found in review", "byte budgets that lists exceed", "an error that says what they take",
                           map || !strstr(sps_error(context), "settings.byte_budget is ") || !takes, 0, "exact");
                if (takes && !CHECK(atof(takes + 14) > (double)f.settings.byte_budget))
                    printf("    technique %d: %s, of %g\n", technique, sps_error(context), (double)bytes);
            }
            sps_tmap_destroy(map);
        }
        end(&f);
    }
    sps_destroy(context);
}

/* The context is still usable. */
static void check_renders(sps_context *context) {
    static float rgba[4 * 64];
    check_scene s;
    check_clear(&s, 8, 8);
    check_add_directional(&s, 0, 0, -1, 1);
    check_add_volume(&s, 3, 3, 3, check_box(-1, -1, -1, 1, 1, 1))->eval_fn = check_eval_constant;
    s.volume[0].user = &one;
    s.volume[0].extinction = 1;
    if (check_render(context, &s, rgba)) CHECK(rgba[4 * 36 + 3] > 0.5f);
}

/* Each allocation fails in turn: an error, no leak, and the context is usable. A failure of sps_tmap_add leaves the map
   unchanged. */
static void test_allocations(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int last = 0, n = 1; !last; ++n) {
            check_hooks hooks;
            sps_context *context;
            fixture f;
            sps_tmap *map = NULL, *again;
            sps_result result;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = 2;
            context = check_context(&hooks);
            begin_little(&f, technique);
            complete(&f);
            hooks.fail_at = hooks.allocations + n;
            result = sps_tmap_create(context, &f.light, &f.settings, &map);
            if (result == SPS_OK) {
                result = sps_tmap_add(map, &f.s.scene);
                if (result == SPS_OK)
                    result = sps_tmap_finish(map);
                else if (CHECK_OK(context, sps_tmap_add(map, &f.s.scene)) && CHECK_OK(context, sps_tmap_finish(map))) {
                    again = must_build(&f, context);
                    CHECK(again && same_map(map, again));
                    sps_tmap_destroy(again);
                    sps_tmap_destroy(map);
                    map = NULL;
                }
            } else {
                CHECK(map == NULL);
            }
            last = hooks.allocations < hooks.fail_at;
            CHECK(result == (last ? SPS_OK : SPS_ERROR_MEMORY));
            sps_tmap_destroy(map);
            hooks.fail_at = 0;
            if (n % 5 == 1) check_renders(context);
            again = must_build(&f, context);
            CHECK(again != NULL);
            sps_tmap_destroy(again);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            end(&f);
        }
}

/* A memory limit is an error until it is large enough, and is never exceeded. */
static void test_memory_limit(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3) {
        int built = 0, refused = 0;
        for (size_t limit = 100000; !built; limit += limit / 4) {
            check_hooks hooks;
            sps_context *context;
            fixture f;
            sps_tmap *map;
            memset(&hooks, 0, sizeof hooks);
            hooks.memory_limit = limit;
            context = check_context(&hooks);
            begin_little(&f, technique);
            map = build(&f, context);
            if (map)
                ++built;
            else
                refused += strstr(sps_error(context), "memory_limit") != NULL;
            CHECK(hooks.peak <= limit);
            sps_tmap_destroy(map);
            sps_destroy(context);
            CHECK(hooks.live == 0);
            end(&f);
            if (!CHECK(limit < (size_t)1 << 30)) break;
        }
        CHECK(refused > 0);
    }
}

/* ---------------------------------------------------------------------------------------------- states and refusals */

static void check_refused(fixture *f, const char *text) {
    sps_context *context = sps_create(NULL, NULL);
    sps_error_info info;
    sps_tmap *map = build(f, context);
    if (!CHECK(map == NULL && strstr(sps_error(context), text) != NULL))
        printf("    wanted \"%s\", got \"%s\"\n", text, sps_error(context));
    sps_get_error(context, &info);
    CHECK(check_error_info(context, info.result) && info.result != SPS_OK);
    if (strncmp(text, "light.", 6) == 0) CHECK(info.object == SPS_OBJECT_TMAP_LIGHT && info.index == -1);
    if (strncmp(text, "settings.", 9) == 0) CHECK(info.object == SPS_OBJECT_TMAP_SETTINGS && info.index == -1);
    sps_tmap_destroy(map);
    check_renders(context);
    sps_destroy(context);
}

/* Zeroed settings, except for the range, are deep opacity with cubics in 8 components, in a separate map and in a
   light's; sps_tmap_get_info reports that. More components may be requested, and planes be set. */
static void test_default_technique(void) {
    static const float planes[4] = {0.1f, 0.3f, 0.6f, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3; ++n) { /* as it is; with more components; with planes */
        sps_tmap_settings resolved;
        sps_tmap *maps[2];
        for (int i = 0; i < 2; ++i) {
            fixture f;
            begin_little(&f, i ? SPS_TMAP_DEEP_OPACITY : SPS_TMAP_DEFAULT);
            f.settings.cubic = i;
            if (n > 0) f.settings.components = n == 1 ? 11 : 6;
            if (n == 2) f.settings.planes = planes;
            maps[i] = must_build(&f, context);
            end(&f);
        }
        if (!maps[0] || !maps[1]) break;
        resolved = check_settings_of(maps[0]);
        CHECK(resolved.technique == SPS_TMAP_DEEP_OPACITY && resolved.cubic == 1);
        CHECK(resolved.components == (n == 0 ? 8 : n == 1 ? 11 : 6));
        CHECK(check_bytes_of(maps[0]) == check_bytes_of(maps[1]));
        CHECK(memcmp(sps_tmap_texels(maps[0]), sps_tmap_texels(maps[1]),
                     SIDE * SIDE * (size_t)resolved.components * sizeof(float)) == 0);
        for (int i = 0; i < 200; ++i)
            CHECK_NEAR(query(maps[0], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i),
                       query(maps[1], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i), 0);
        for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
    }
    sps_destroy(context);
}

/* Invalid settings, each with its error sentence. */
static void test_settings(void) {
    static const struct {
        const char *text;
        int technique, components;
    } counts[] = {{"settings.components is 1; a deep map has 0", SPS_TMAP_DEEP, 1},
                  {"settings.components is 2; a compressed map has 4, 6 .. 64", SPS_TMAP_COMPRESSED, 2},
                  {"settings.components is 1; a depth map has 0", SPS_TMAP_DEPTH, 1},
                  {"settings.components is 66; an opacity map has 1, 2 .. 65", SPS_TMAP_OPACITY, 66},
                  {"settings.components is -1; an opacity", SPS_TMAP_OPACITY, -1},
                  {"settings.components is 2; a deep opacity map has 3, 4 .. 65", SPS_TMAP_DEEP_OPACITY, 2},
                  {"settings.components is 6; a Fourier map has 3, 5 .. 65", SPS_TMAP_FOURIER, 6},
                  {"settings.components is 67; a Fourier", SPS_TMAP_FOURIER, 67},
                  {"settings.components is 6; a moment map has 5 or 7", SPS_TMAP_MOMENT, 6},
                  {"settings.components is 9; a moment", SPS_TMAP_MOMENT, 9},
                  {"settings.components is 5; a compressed map has 4, 6 .. 64", SPS_TMAP_COMPRESSED, 5},
                  {"settings.components is 4; a Beer map has 3", SPS_TMAP_BEER, 4},
                  {"settings.components is 2; a deep opacity map has 3, 4 .. 65", SPS_TMAP_DEFAULT, 2}};
    static const char *const texts[] = {
        "settings.technique is 10",  "settings.technique is 15",    "settings.epsilon is 0.51",
        "settings.epsilon is nan",   "settings.surface_bias is -1", "settings.start_canary is",
        "settings.end_canary is",    "settings.far_depth is 0",     "settings.far_depth is 2",
        "settings.near_depth is -1", "settings.far_depth is 2e+15", "settings.far_depth is nan"};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; ++i) {
        fixture f;
        begin(&f, counts[i].technique);
        f.settings.components = counts[i].components;
        check_refused(&f, counts[i].text);
    }
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        fixture f;
        begin(&f, SPS_TMAP_FOURIER);
        if (i == 0) f.settings.technique = (sps_tmap_technique)(SPS_TMAP_DEPTH + 1);
        if (i == 1) f.settings.technique = (sps_tmap_technique)15;
        if (i == 2) f.settings.epsilon = 0.51f;
        if (i == 3) f.settings.epsilon = (float)(HUGE_VAL - HUGE_VAL);
        if (i == 4) f.settings.surface_bias = -1;
        if (i == 5) f.settings.start_canary = 1;
        if (i == 6) f.settings.end_canary = 1;
        if (i >= 7) f.settings.far_depth = i == 7 ? 0 : i == 10 ? 2e15 : i == 11 ? HUGE_VAL - HUGE_VAL : 2;
        if (i == 8 || i == 9) f.settings.near_depth = i == 8 ? 2 : -1;
        check_refused(&f, texts[i]);
    }
    {
        fixture f; /* two of them are for texel_range */
        begin(&f, SPS_TMAP_FOURIER);
        f.settings.texel_range = 1, f.settings.components = 3;
        check_refused(&f, "settings.components is 3; a Fourier map with texel_range has 5, 7 .. 65");
    }
}

/* Planes must increase from above 0 to 1; they are copied and used. */
static void test_planes(void) {
    static const float wrong[5][3] = {
        {0, 0.5f, 1}, {0.5f, 0.5f, 1}, {0.5f, 0.4f, 1}, {0.2f, 0.5f, 0.9f}, {0.2f, 1.5f, 1}};
    static const char *const texts[5] = {"settings.planes[0] is 0;", "settings.planes[1] is 0.5;",
                                         "settings.planes[1] is 0.4;", "settings.planes[2] is 0.9;",
                                         "settings.planes[1] is 1.5;"};
    check_hooks hooks;
    sps_context *context;
    memset(&hooks, 0, sizeof hooks);
    context = check_context(&hooks);
    for (int technique = SPS_TMAP_OPACITY; technique <= SPS_TMAP_DEEP_OPACITY; ++technique) {
        float planes[3] = {0.25f, 0.5f, 1};
        sps_tmap_settings resolved;
        fixture f;
        sps_tmap *map = NULL, *other = NULL;
        size_t live;
        begin(&f, technique);
        f.settings.components = technique == SPS_TMAP_OPACITY ? 3 : 5;
        for (int i = 0; i < 5; ++i) {
            f.settings.planes = wrong[i];
            check_refused(&f, texts[i]);
        }
        add(&f, 0, 0, 0, 1, 2, 3); /* u 0.35 .. 0.55 */
        f.settings.planes = planes;
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        live = hooks.live;
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &other));
        sps_tmap_destroy(other);
        CHECK(hooks.live == live);
        planes[0] = planes[1] = 7;
        resolved = check_settings_of(map);
        CHECK(resolved.planes && resolved.planes != planes && resolved.planes[1] <= 0.5f);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK_OK(context, sps_tmap_finish(map));
        if (technique == SPS_TMAP_OPACITY) {
            CHECK_NEAR(query(map, 0, 0, 5), 0, 0);
            CHECK_NEAR(query(map, 0, 0, 0), 2.25, 1e-5);
            CHECK_NEAR(query(map, 0, 0, 2.5), 1.125, 1e-5); /* half the way from plane to plane */
        } else { /* the particle's own range: planes are at 1/4, 1/2 and 1 of it */
            const double before[3] = {0, 0, 5};
            float bracket[2] = {7, 7};
            sps_tmap_bracket(map, 1, before, &bracket[0], &bracket[1]);
            CHECK(bracket[0] <= 0 && bracket[1] <= 0);
            CHECK_NEAR(query(map, 0, 0, 2), 0.75, 1e-5);
            CHECK_NEAR(query(map, 0, 0, 1), 1.5, 1e-5);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
    CHECK(hooks.live == 0 && hooks.live_blocks == 0);
}

/* Views and scenes. */
static void test_scenes(void) {
    static const char *const texts[] = {"light.width is 0",
                                        "light.height is 0",
                                        "light.width is 16385",
                                        "light.camera.field_of_view is 4",
                                        "same point",
                                        "cannot be inverted",
                                        "light.width is 9; it must equal",
                                        "light.end_canary",
                                        "light.camera.position is nan",
                                        "light.slab is -1",
                                        "position is nan",
                                        "radius is -1",
                                        "optical_depth is inf",
                                        "particles[0].end_canary",
                                        "particles[0].read_fn is NULL",
                                        "mesh[0].transmittance is 1.5",
                                        "mesh[0].transmittance is -0.5",
                                        "mesh[0].transmittance is nan",
                                        "mesh[1].read_fn is NULL",
                                        "volume[0].extinction is -1",
                                        "volume[0].size is -1",
                                        "scene.mesh_count is -1",
                                        "scene.volume_count is 1",
                                        "mesh[0].triangle[1].position is nan",
                                        "volume[0].placement's determinant is 0",
                                        "scene.end_canary",
                                        "light.start_canary is 3",
                                        "light.quality is 5",
                                        "light.slab is 1e-09; it makes more than 2^20 slabs",
                                        "light.camera has neither",
                                        "light.camera has field_of_view and ortho_height",
                                        "light.camera.up is inf"};
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        const float nan = (float)(HUGE_VAL - HUGE_VAL);
        fixture f;
        begin_little(&f, SPS_TMAP_OPACITY);
        if (i == 0) f.light.width = 0;
        if (i == 1) f.light.height = 0;
        if (i == 2) f.light.width = 16385;
        if (i == 3) check_perspective(&f.light.camera, 4);
        if (i == 4) check_set3(f.light.camera.target, 0, 0, 10);
        if (i == 5) memset(f.matrix, 0, sizeof f.matrix), check_matrix(&f.light.camera, f.matrix);
        if (i == 6) f.light.omnidirectional = 1, f.light.height = 8;
        if (i == 7) f.light.end_canary = 1;
        if (i == 8) f.light.camera.position[1] = (double)nan;
        if (i == 9) f.light.slab = -1;
        if (i == 10) f.crowds[0].list[1].position[1] = nan;
        if (i == 11) f.crowds[0].list[2].radius = -1;
        if (i == 12) f.crowds[1].list[0].optical_depth = (float)HUGE_VAL;
        if (i == 13) f.sets[0].end_canary = 1;
        if (i == 14) f.sets[0].read_fn = NULL;
        if (i >= 15 && i <= 17) f.s.mesh[0].transmittance[i - 15] = i == 15 ? 1.5f : i == 16 ? -0.5f : nan;
        if (i == 18) f.s.mesh[1].read_fn = NULL;
        if (i == 19) f.s.volume[0].extinction = -1;
        if (i == 20) f.s.volume[0].size[1] = -1;
        if (i == 21) f.s.scene.mesh_count = -1;
        if (i == 22) f.s.scene.volumes = NULL;
        if (i == 23) f.triangles[0].list[1].position[2][0] = nan;
        if (i == 24) memset(f.s.volume[0].placement.axis[1], 0, 3 * sizeof(double));
        if (i == 25) f.s.scene.end_canary = 1;
        if (i == 26) f.light.start_canary = 3;
        if (i == 27) f.light.quality = (sps_quality)5;
        if (i == 28) f.light.slab = 1e-9;
        if (i == 29) f.light.camera.ortho_height = 0;
        if (i == 30) f.light.camera.field_of_view = 1;
        if (i == 31) f.light.camera.up[1] = HUGE_VAL;
        check_refused(&f, texts[i]);
        end(&f);
    }
}

/* replace_invalid treats particles with NaN as if they were absent. */
static void test_replaced(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f, whole;
    sps_tmap *maps[2];
    sps_stats_report stats;
    begin_mixed(&whole, SPS_TMAP_DEEP);
    begin_mixed(&f, SPS_TMAP_DEEP);
    add(&f, 1, 0, 0, 0, 2, HUGE_VAL);
    f.s.scene.replace_invalid = 1;
    maps[0] = must_build(&whole, context);
    maps[1] = must_build(&f, context);
    sps_get_stats(context, &stats);
    CHECK(stats.values_replaced == 1);
    CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
    for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
    end(&f);
    end(&whole);
    sps_destroy(context);
}

/* A flag of one of several scenes applies to the map, whichever comes first; without it, invalid data are refused. */
static void test_replaced_of_several(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) { /* bit 0: the scene without a flaw asks, bit 1: it comes first */
        fixture f, bad;
        sps_stats_report stats;
        sps_tmap *map = NULL;
        begin(&f, SPS_TMAP_OPACITY);
        begin(&bad, SPS_TMAP_OPACITY);
        add(&f, 0, 0, 0, 0, 2, 1);
        add(&bad, 1, 0, 0, 0, 2, HUGE_VAL);
        complete(&f), complete(&bad);
        f.s.scene.replace_invalid = n & 1;
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        CHECK_OK(context, sps_tmap_add(map, n & 2 ? &f.s.scene : &bad.s.scene));
        CHECK_OK(context, sps_tmap_add(map, n & 2 ? &bad.s.scene : &f.s.scene));
        CHECK(sps_tmap_finish(map) == (n & 1 ? SPS_OK : SPS_ERROR_DATA));
        sps_get_stats(context, &stats);
        if (n & 1)
            CHECK_CASE("Found in review", "replace_invalid of one of several scenes in a map", "applies to all of them",
                       stats.values_replaced != 1, 0, "exact");
        sps_tmap_destroy(map);
        end(&f);
        end(&bad);
    }
    sps_destroy(context);
}

/* Particles that span too many tiles to be listed by tile: the same results as the sum of chords. 5 x 4 tiles of
   60 particles, 1200, are more than 8 (60 + 20). */
static void test_crowded_tiles(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = 0; technique < 2; ++technique) {
        check_random random = {15};
        fixture f;
        sps_tmap *map;
        begin(&f, technique ? SPS_TMAP_BEER : SPS_TMAP_DEEP);
        f.light.width = 300, f.light.height = 200;
        for (int i = 0; i < 60; ++i)
            add(&f, i % 2, check_next(&random), check_next(&random), 4 * check_next(&random), 8 + check_next(&random),
                0.2 * check_next(&random));
        map = must_build(&f, context);
        CHECK(context->buffers[SPSI_BUFFER_BALL_LIST].data == NULL);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, 0, (int)(300 * check_next(&random)), (int)(200 * check_next(&random)),
                   technique ? 20 : 20 * check_next(&random), point);
            exact = exact_particles(&f, point);
            CHECK_CASE("Found in review", "map particles wider than eight tiles", "the sum of chords",
                       fabs(query_at(map, point) - exact.depth), exact.slack + 1e-5 * exact.depth,
                       "chords to 1e-3 at rims, as everywhere; sums of floats");
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A query's result does not depend on the other points of the call, nor on whether texels are looked up a vector at a
   time, which those of very large maps are not: the same bits. */
static void test_company(void) {
    enum { POINTS = 3 * 16 + 5 }; /* some vectors of any width, and a part of one */
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 4, round = n % 2, variant = n / 2 % 2;
        float together[2][POINTS], apart[2][POINTS], alone[2];
        double points[3 * POINTS];
        check_random random = {(uint64_t)n + 5};
        sps_context *context = sps_create(NULL, NULL);
        sps_tmap *map;
        fixture f;
        begin_mixed(&f, technique);
        if (round) see(&f, ROUND, 2 * SIDE);
        f.settings.cubic = f.settings.texel_range = variant;
        map = must_build(&f, context);
        for (int i = 0; i < 3 * POINTS; ++i) points[i] = 14 * check_next(&random) - 7;
        if (map) {
            int same = 1;
            sps_tmap_query(map, POINTS, points, together[0], together[1]);
            for (int i = 0; i < POINTS; ++i) {
                sps_tmap_query(map, 1, points + 3 * i, &alone[0], &alone[1]);
                same &= memcmp(&alone[0], &together[0][i], sizeof(float)) == 0 &&
                        memcmp(&alone[1], &together[1][i], sizeof(float)) == 0;
            }
            CHECK(same);
            map->has_vectors = 0;
            sps_tmap_query(map, POINTS, points, apart[0], apart[1]);
            CHECK(memcmp(apart, together, sizeof apart) == 0);
            sps_tmap_destroy(map);
        }
        sps_destroy(context);
        end(&f);
    }
}

/* The results around a point, within the float round-off of its position. */
static void answers_about(const sps_tmap *map, const double point[3], double range[2]) {
    const double apart = 2e-5;
    range[0] = 1, range[1] = 0;
    for (int n = 0; n < 7; ++n) {
        double at[3];
        float through;
        memcpy(at, point, sizeof at);
        if (n < 6) at[n / 2] += n % 2 ? apart : -apart;
        sps_tmap_query(map, 1, at, NULL, &through);
        range[0] = fmin(range[0], (double)through), range[1] = fmax(range[1], (double)through);
    }
}

/* A vector of points in floats, as looked up for pictures. */
static void check_lookup(const sps_tmap *map, const double (*points)[3]) {
    float lanes[3][SPSI_LANES], depths[SPSI_LANES];
    spsi_v q[3];
    for (int i = 0; i < SPSI_LANES; ++i) {
        double offset[3], rays[3];
        vec_along(points[i], map->rays[0].origin, -1, offset);
        spsi_to_rays(&map->rays[0], offset, rays);
        rays[2] -= map->settings.near_depth;
        for (int k = 0; k < 3; ++k) lanes[k][i] = (float)(map->face_count > 1 ? offset[k] : rays[k]);
    }
    for (int k = 0; k < 3; ++k) q[k] = spsi_load(lanes[k]);
    spsi_store(depths, spsi_tmap_lookup(map, q));
    for (int i = 0; i < SPSI_LANES; ++i) {
        const double through = exp(-(double)depths[i]);
        double range[2];
        answers_about(map, points[i], range);
        /* and the round-off of optical depths up to 16, in T */
        if (!CHECK(through >= range[0] - 2e-6 && through <= range[1] + 2e-6))
            printf("    %s at %g %g %g: %g, not %g .. %g\n", map->technique->name, points[i][0], points[i][1],
                   points[i][2], through, range[0], range[1]);
    }
}

/* The shadow on a picture's gas agrees with sps_tmap_query, even beyond the map's edges, behind the light, before
   near_depth, and where faces meet. */
static void test_lookups(void) {
    static const int ways[] = {ORTHO, SPOT, SPOT_TURNED, ROUND};
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int way = ways[n % 4];
        check_random random = {(uint64_t)n + 77};
        sps_context *context = sps_create(NULL, NULL);
        sps_tmap *map;
        fixture f;
        begin(&f, 1 + n / 4);
        see(&f, way, 13);
        scatter(&f, 0, 20, 3, 61);
        scatter(&f, 1, 20, 3, 62);
        f.settings.near_depth = way == ROUND ? 0.75 : 5;
        f.settings.far_depth = way == ROUND ? 9 : 18;
        map = must_build(&f, context);
        for (int run = 0; run < 400 / SPSI_LANES + 1 && map; ++run) {
            double points[SPSI_LANES][3];
            for (int i = 0; i < SPSI_LANES; ++i) {
                const int kind = (run + i) % 8, axis = i % 3;
                for (int k = 0; k < 3; ++k) points[i][k] = 16 * check_next(&random) - 8;
                if (kind == 0) points[i][2] = 9 + 6 * check_next(&random); /* around the light, except for ROUND */
                if (way != ROUND || kind > 2) continue;
                for (int k = 0; k < 3; ++k) /* close to it, or on an edge or a corner of the cube */
                    points[i][k] = kind == 0                ? f.light.camera.position[k] + check_next(&random) - 0.5
                                   : kind == 1 && k == axis ? f.light.camera.position[k] + 0.5 * points[i][0]
                                                            : f.light.camera.position[k] + (k % 2 ? 2.5 : -2.5);
            }
            check_lookup(map, (const double(*)[3])points);
        }
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* A position that is not finite is outside every map. */
static void test_no_numbers(void) {
    const double infinite = HUGE_VAL, bad[] = {infinite, -infinite, infinite - infinite};
    for (int way = 0; way < WAYS; ++way)
        for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
            sps_context *context = sps_create(NULL, NULL);
            sps_tmap *map;
            fixture f;
            begin_little(&f, technique);
            see(&f, way, SIDE);
            map = must_build(&f, context);
            for (int n = 0; n < 3 * 7 && map; ++n) {
                float depth = 7, through = 7, least = 7, most = 7;
                double at[3] = {0.1, 0.2, -0.3};
                for (int k = 0; k < 3; ++k)
                    if ((n % 7 + 1) >> k & 1) at[k] = bad[n / 7];
                sps_tmap_query(map, 1, at, &depth, &through);
                sps_tmap_bracket(map, 1, at, &least, &most);
                if (!CHECK(!(fabsf(depth) > 0) && through >= 1 && !(fabsf(least) > 0) && !(fabsf(most) > 0)))
                    printf("    technique %d at %g %g %g\n", technique, at[0], at[1], at[2]);
            }
            sps_tmap_destroy(map);
            sps_destroy(context);
            end(&f);
        }
}

/* A face that does not exist, no map, or an unfinished one: an error, and nothing is written. */
static void check_unanswered(const sps_tmap *map, int face) {
    static const double at[3] = {0, 0, -5};
    static const float at_floats[3] = {0, 0, -5};
    float numbers[2] = {7, 7};
    double matrix[16] = {7}, bias[2] = {7, 7};
    sps_tmap_constants constants;
    constants.row_x[0] = 7;
    if (face == 0) {
        CHECK(sps_tmap_query(map, 1, at, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_query(map, 0, NULL, NULL, NULL) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_query_floats(map, 1, at_floats, 0, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_bracket(map, 1, at, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
    }
    CHECK(sps_tmap_get_projection(map, face, matrix, bias) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_constants(map, face, &constants) == SPS_ERROR_ARGUMENT);
    CHECK(numbers[0] == 7 && numbers[1] == 7 && matrix[0] == 7 && bias[0] == 7 && bias[1] == 7);
    CHECK(constants.row_x[0] == 7);
}

/* Largest difference of two answers, relative to the first if that is above 1. */
static double farthest_apart(const float *a, const float *b, int count) {
    double apart = 0;
    for (int i = 0; i < count; ++i)
        apart = fmax(apart, fabs((double)a[i] - (double)b[i]) / fmax(1, fabs((double)a[i])));
    return apart;
}

/* Positions in floats, packed, interleaved in a vertex, and unaligned: the same answers as for doubles, except for
   round-off where the compiler fuses multiply and add differently in the two: a dozen operations, 6e-8 each. */
static void test_float_positions(void) {
    enum { COUNT = 3 * 16 + 5 };
    sps_context *context = sps_create(NULL, NULL);
    static const size_t strides[4] = {0, 12, 32, 13};
    for (int n = 0; n < 4; ++n) {
        const size_t step = strides[n] ? strides[n] : 12;
        char vertices[COUNT * 32 + 1];
        double positions[3 * COUNT];
        float expected[2][COUNT], found[2][COUNT];
        check_random random = {7};
        sps_tmap *map;
        fixture f;
        begin_little(&f, SPS_TMAP_DEFAULT);
        map = must_build(&f, context);
        memset(vertices, 0x7f, sizeof vertices); /* large numbers between them */
        for (int i = 0; i < COUNT; ++i) {
            float at[3];
            for (int k = 0; k < 3; ++k) at[k] = (float)(8 * check_next(&random) - 4);
            for (int k = 0; k < 3; ++k) positions[3 * i + k] = (double)at[k];
            memcpy(vertices + (n == 3) + (size_t)i * step, at, sizeof at);
        }
        CHECK(sps_tmap_query(map, COUNT, positions, expected[0], expected[1]) == SPS_OK);
        CHECK(sps_tmap_query_floats(map, COUNT, (const float *)(const void *)(vertices + (n == 3)), strides[n],
                                    found[0], found[1]) == SPS_OK);
        CHECK(fmax(farthest_apart(expected[0], found[0], COUNT), farthest_apart(expected[1], found[1], COUNT)) <=
                  1e-6 &&
              expected[1][0] < 1);
        memset(found, 0, sizeof found);
        CHECK(sps_tmap_query_floats(map, COUNT, (const float *)(const void *)(vertices + (n == 3)), strides[n], NULL,
                                    found[1]) == SPS_OK);
        CHECK(farthest_apart(expected[1], found[1], COUNT) <= 1e-6 && !(found[0][0] > 0));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* The sizes in sps_tmap_get_info for every technique: the number of floats is that of an upload, and bytes are those
   and little else (test_bytes has them exactly). */
static void test_info(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            const int lists = technique <= SPS_TMAP_COMPRESSED;
            const size_t texels = round ? 6 * SIDE * SIDE : 7 * SIDE;
            sps_tmap_info info[2];
            fixture f;
            sps_tmap *map;
            begin_little(&f, technique);
            if (round) see(&f, ROUND, SIDE);
            if (!round) f.light.height = 7;
            complete(&f);
            CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
            CHECK(sps_tmap_get_info(map, &info[0]) == SPS_OK);
            CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
            CHECK_OK(context, sps_tmap_finish(map));
            CHECK(sps_tmap_get_info(map, &info[1]) == SPS_OK);
            for (int i = 0; i < 2; ++i) {
                CHECK(info[i].width == SIDE && info[i].height == (round ? SIDE : 7));
                CHECK(info[i].face_count == (round ? 6 : 1) && info[i].texel_count == texels);
                CHECK(info[i].is_finished == i && info[i].settings.technique == (sps_tmap_technique)technique);
                CHECK(info[i].settings.far_depth == f.settings.far_depth);
                CHECK(info[i].item_floats == (technique == SPS_TMAP_DEEP ? 4
                                              : lists                    ? 2
                                                                         : info[i].settings.components));
                if (!lists) CHECK(info[i].float_count == texels * (size_t)info[i].item_floats);
            }
            if (lists) {
                CHECK(info[0].float_count == 0);
                CHECK(info[1].float_count == sps_tmap_starts(map)[texels] * (size_t)info[1].item_floats);
            }
            CHECK(info[1].bytes >= info[1].float_count * sizeof(float));
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* The block has the layout of std140: vectors of four floats at multiples of 16 bytes, then numbers of 4 bytes. */
#define AT(member, offset) typedef char at_##member[offsetof(sps_tmap_constants, member) == (offset) ? 1 : -1]
AT(row_x, 0);
AT(row_y, 16);
AT(row_w, 32);
AT(row_distance, 48);
AT(technique, 64);
AT(components, 68);
AT(has_range, 72);
AT(has_planes, 76);
AT(cubic, 80);
AT(has_surfaces, 84);
AT(width, 88);
AT(height, 92);
AT(near_depth, 96);
AT(far_depth, 100);
AT(bias, 104);
AT(bias_per_distance, 108);
AT(face, 112);
AT(face_count, 116);
typedef char size_of_constants[sizeof(sps_tmap_constants) == 128 ? 1 : -1];

static void check_row(const float row[4], const double exact[4]) {
    for (int i = 0; i < 4; ++i) CHECK_NEAR((double)row[i], exact[i], 6e-8 * fabs(exact[i]));
}

/* Constants are the projection of a face, rounded to floats, and the settings. test_sampling looks maps up by them. */
static void test_constants(void) {
    static const float planes[6] = {0.1f, 0.2f, 0.4f, 0.6f, 0.8f, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int technique = n < 4 ? SPS_TMAP_OPACITY : SPS_TMAP_FOURIER;
        fixture f;
        sps_tmap *map;
        begin_little(&f, technique);
        see(&f, n % 4 == 3 ? ROUND : n % 4 == 2 ? ORTHO : SPOT_TURNED, SIDE);
        f.settings.near_depth = 0.25;
        if (technique == SPS_TMAP_OPACITY && n % 2) f.settings.planes = planes, f.settings.components = 6;
        f.settings.cubic = n % 4 == 1, f.settings.texel_range = n == 6;
        if (n == 2) f.s.scene.mesh_count = 0;
        map = must_build(&f, context);
        for (int face = 0; face < (n % 4 == 3 ? 6 : 1) && map; ++face) {
            double m[16], bias[2];
            sps_tmap_constants c;
            CHECK(sps_tmap_get_projection(map, face, m, bias) == SPS_OK);
            CHECK(sps_tmap_get_constants(map, face, &c) == SPS_OK);
            check_row(c.row_x, m), check_row(c.row_y, m + 4), check_row(c.row_distance, m + 8);
            check_row(c.row_w, m + 12);
            CHECK_NEAR((double)c.bias, bias[0], 6e-8 * bias[0]);
            CHECK_NEAR((double)c.bias_per_distance, bias[1], 6e-8 * bias[1]);
            CHECK(c.technique == technique && c.components == map->settings.components);
            CHECK(c.has_planes == (technique == SPS_TMAP_OPACITY && n % 2) && c.cubic == (n % 4 == 1));
            CHECK(c.has_range == (n == 6) && c.has_surfaces == (n != 2));
            CHECK(c.width == SIDE && c.height == SIDE && c.near_depth == 0.25f && c.far_depth == 20);
            CHECK(c.face == face && c.face_count == (n % 4 == 3 ? 6 : 1) && c.padding_0 == 0 && c.padding_1 == 0);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* X / W, Y / W, D and W of a world point. */
static void project(const double m[16], const double point[3], double out[4]) {
    for (int i = 0; i < 4; ++i)
        out[i] = m[4 * i] * point[0] + m[4 * i + 1] * point[1] + m[4 * i + 2] * point[2] + m[4 * i + 3];
    out[0] /= out[3], out[1] /= out[3];
}

/* Texels of size 1 at z = 0, ten from the light, whose middle is texel (4, 4); the tolerance is round-off alone. */
static void test_projection(void) {
    const double at[2][3] = {{2.5, -1, 0}, {2.5, -1, 5}}, rounding = 1e-12;
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *map;
    fixture f;
    double m[16], bias[2] = {7, 7}, q[4];
    for (int way = ORTHO; way <= SPOT_MATRIX; ++way)
        for (int own_bias = 0; own_bias < 2; ++own_bias) {
            const int spot = way == SPOT || way == SPOT_MATRIX;
            begin(&f, SPS_TMAP_BEER);
            see(&f, way, SIDE);
            f.settings.surface_bias = own_bias * 0.3;
            map = must_build(&f, context);
            if (!map) continue;
            sps_tmap_get_projection(map, 0, m, bias);
            for (int i = 0; i < 2; ++i) {
                const double size = spot && i ? 0.5 : 1; /* of a texel there */
                project(m, at[i], q);
                CHECK_NEAR(q[0], 4 + 2.5 / size, rounding);
                CHECK_NEAR(q[1], 4 + 1 / size, rounding);
                CHECK_NEAR(q[2], i ? 5 : 10, rounding);
                CHECK_NEAR(q[3], spot ? q[2] : 1, rounding);
            }
            CHECK_NEAR(bias[0], own_bias ? 0.3 : spot ? 0 : 2, rounding);
            CHECK_NEAR(bias[1], own_bias || !spot ? 0 : 0.2, rounding);
            check_unanswered(map, 1);
            check_unanswered(map, -1);
            sps_tmap_destroy(map);
        }
    sps_destroy(context);
}

/* Six faces: the centres of the outermost texels lie on the cube's edges. */
static int messages_told;
static char last_message[256];

static void take_message(void *user, const char *text) {
    (void)user;
    messages_told += 1;
    snprintf(last_message, sizeof last_message, "%s", text);
}

/* Gas beyond a map's depths is counted and reported: particles that reach beyond either end, but not behind the light.
 */
static void test_outside(void) {
    static const double depths[5][2] = {{0, 20}, {0, 10.5}, {9.5, 20}, {9.5, 10.5}, {0, 5}};
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int n = 0; n < 20; ++n) {
        const int way = n / 5 % 2 ? SPOT : ORTHO, voxels = n / 10;
        fixture f;
        sps_stats_report stats;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, way, SIDE);
        f.settings.near_depth = depths[n % 5][0], f.settings.far_depth = depths[n % 5][1];
        add(&f, 0, 0, 0, 0, 2, 1);
        add(&f, 1, 1, 1, 0, 2, 1);
        if (way == SPOT) add(&f, 0, 0, 0, 10, 2, 1); /* it contains the light, which loses nothing at near_depth 0 */
        if (voxels) add_box(&f, 4, 1, 0, 1);
        messages_told = 0;
        map = must_build(&f, context);
        sps_get_stats(context, &stats);
        CHECK(stats.particles_outside == (n % 5 == 0 ? 0u : way == SPOT && (n % 5 == 2 || n % 5 == 3) ? 3u : 2u));
        CHECK_CASE("Found in review", "gas before near_depth or behind far_depth", "a message says so",
                   messages_told != (n % 5 > 0), 0, "exact");
        CHECK(n % 5 == 0 || (strstr(last_message, "voxels") != NULL) == voxels);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Particles seen by several of six faces count once, and messages mention only what there is. */
static void test_outside_around(void) {
    static const double toward[4][3] = {{1, 1, 1}, {1, -1, 0.2}, {0, 0, -1}, {-1, 0.1, 0}};
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int n = 0; n < 10; ++n) { /* far from the light and about it; voxels alone */
        fixture f;
        sps_stats_report stats;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, ROUND, SIDE);
        if (n < 8) {
            const double *to = toward[n % 4], far_away = n < 4 ? 25 : 15;
            add(&f, 0, 0.5 + far_away * to[0], -0.25 + far_away * to[1], 1 + far_away * to[2], n < 4 ? 4 : 14, 1);
        } else {
            add_box(&f, 4, 22, 0, 1);
        }
        if (n == 9) f.settings.far_depth = 60;
        messages_told = 0;
        map = must_build(&f, context);
        sps_get_stats(context, &stats);
        if (!CHECK(stats.particles_outside == (n < 8))) printf("    case %d: %d\n", n, (int)stats.particles_outside);
        CHECK(messages_told == (n < 9));
        CHECK(n == 9 || strstr(last_message, n < 8 ? " counts there: 1 of the particles"
                                                   : " counts there: the box about all voxels"));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A light amid voxels lights everything outside its single view: message_fn is told of `omnidirectional`, unless that
   is set, the light is outside the voxels, or its rays are parallel and pass all of them. */
static void test_light_amid(void) {
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int way = 0; way < WAYS; ++way)
        for (int inside = 0; inside < 2; ++inside) {
            const int one_view = way != ROUND && way != ORTHO && way != ORTHO_MATRIX && way != ORTHO_TURNED;
            fixture f;
            begin(&f, SPS_TMAP_OPACITY);
            see(&f, way, SIDE);
            f.settings.far_depth = 200;
            add_box(&f, 4, inside ? 60 : 0.2, 0, 1);
            messages_told = 0;
            last_message[0] = 0;
            sps_tmap_destroy(must_build(&f, context));
            CHECK((strstr(last_message, "omnidirectional") != NULL) == (one_view && inside));
            end(&f);
        }
    sps_destroy(context);
}

/* A surface before near_depth shades everything behind it and behind near_depth. */
static void test_surface_before_near(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int spot = 0; spot < 2; ++spot)
        for (int glass = 0; glass < 2; ++glass) {
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_OPACITY);
            see(&f, spot ? SPOT : ORTHO, SIDE);
            f.settings.near_depth = 5, f.settings.far_depth = 15, f.settings.surface_bias = 0.5;
            add_square(&f, 0, -30, 30, 30, 7); /* 3 before the light, 2 before near_depth */
            add_mesh(&f, 0, glass ? 0.5 : 0);
            map = must_build(&f, context);
            if (!glass) CHECK_NEAR(query(map, 0, 0, 4.99), DARK, 1e-7);
            CHECK_CASE("Found in review", "surfaces before near_depth, opaque and translucent",
                       "shade all that is behind", fabs(query(map, 0, 0, -6) - (glass ? log(2.0) : DARK)), 1e-7,
                       "floats");
            CHECK_NEAR(query(map, 0, 0, 5.01), 0, 0);
            if (!glass) CHECK_NEAR((double)sps_tmap_surfaces(map)[SIDE * SIDE / 2], -0.2, 1e-6);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

static void test_projection_round(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *map;
    fixture f;
    double m[16], bias[2], q[4];
    begin(&f, SPS_TMAP_BEER);
    see(&f, ROUND, SIDE);
    map = must_build(&f, context);
    for (int face = 0; face < 6 && map; ++face) {
        const int axis = face / 2;
        double at[3];
        memcpy(at, f.light.camera.position, sizeof at);
        at[axis] += face % 2 ? -2 : 2;
        at[(axis + 1) % 3] += 2;
        at[(axis + 2) % 3] -= 1;
        sps_tmap_get_projection(map, face, m, bias);
        project(m, at, q);
        CHECK_NEAR(q[0], SIDE - 1, 1e-12);
        CHECK_NEAR(q[1], 0.25 * (SIDE - 1), 1e-12);
        CHECK_NEAR(q[2], 2, 1e-12);
        sps_tmap_get_projection(map, face ^ 1, m, NULL);
        project(m, at, q);
        CHECK_NEAR(q[3], -2, 1e-12);
        CHECK_NEAR(bias[0], 0, 0);
        CHECK_NEAR(bias[1], 4.0 / (SIDE - 1), 1e-12);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* clip = projection * camera of a spot at `from` that looks at (0,0,0) and sees 0.4 on either side of its axis per unit
   of depth; row-major, or column-major as in many maths libraries. */
static void spot_matrix(const double from[3], int by_columns, double matrix[16]) {
    double axes[3][3], rows[4][4];
    for (int i = 0; i < 3; ++i) axes[2][i] = -from[i];
    vec_normalise(axes[2]);
    vec_basis(axes[2], axes[0], axes[1]);
    for (int i = 0; i < 4; ++i) {
        const double *axis = axes[i < 3 ? i : 2], scale = i < 2 ? 2.5 : 1;
        for (int k = 0; k < 3; ++k) rows[i][k] = scale * axis[k];
        rows[i][3] = -scale * vec_dot(axis, from) - (i == 2 ? 1 : 0);
    }
    for (int i = 0; i < 16; ++i) matrix[i] = by_columns ? rows[i % 4][i / 4] : rows[i / 4][i % 4];
}

/* A matrix that was not transposed is refused, and the sentence says why (see test_matrices.c). For a view that is too
   wide by itself, the sentence says to narrow it, and mentions no matrix. */
static void test_untransposed(void) {
    static const double from[3][3] = {{7, -3, 1}, {1, 7, 2}, {4, 6, -1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 9; ++n) { /* row-major, by columns, none but a wide angle */
        double matrix[16];
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        add_box(&f, 4, 1, 0, 1);
        memcpy(f.light.camera.position, from[n / 3], sizeof f.light.camera.position);
        spot_matrix(from[n / 3], n % 3 == 1, matrix);
        if (n % 3 < 2) check_matrix(&f.light.camera, matrix);
        if (n % 3 == 2) check_perspective(&f.light.camera, 3.05);
        map = build(&f, context);
        CHECK((map != NULL) == (n % 3 == 0));
        CHECK((strstr(sps_error(context), "narrow the light's view") != NULL) == (n % 3 == 2));
        if (!CHECK_CASE("Found in review", "a light's matrix that was not transposed", "the error says so",
                        (strstr(sps_error(context), "looks transposed: it must be row-major") != NULL) != (n % 3 == 1),
                        0, "exact"))
            printf("    %d: %s\n", n, sps_error(context));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A light whose target is its own position probably needs an omnidirectional map: the sentence names the setting. With
   that, or with a matrix, the target is not used. */
static void test_looks_nowhere(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) { /* as a spot; parallel; all round; by a matrix */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        if (n == 3) see(&f, SPOT_MATRIX, SIDE);
        add_box(&f, 4, 12, 0, 0.1);
        memcpy(f.light.camera.target, f.light.camera.position, sizeof f.light.camera.target);
        if (n == 0) check_perspective(&f.light.camera, 1);
        f.light.omnidirectional = n == 2;
        map = build(&f, context);
        CHECK((map != NULL) == (n >= 2));
        if (n < 2) CHECK(strstr(sps_error(context), "light.omnidirectional is 1, all round") != NULL);
        if (n == 2) CHECK(query(map, 0, 0, 5) > 0.1 && query(map, 5, 0, 10) > 0.1 && query(map, 0, -5, 11) > 0.1);
        if (n == 3) CHECK(query(map, 0, 0, 5) > 0.1);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

static void leave(int number) {
    (void)number;
    _exit(3);
}

/* Destroying a context before its maps is an error that SPS_ASSERT catches; here in a separate process. */
static void test_context_before_maps(void) {
    for (int kept = 0; kept < 2; ++kept) {
        sps_context *context = sps_create(NULL, NULL);
        fixture f;
        sps_tmap *map;
        int status = -1;
        pid_t child;
        begin(&f, SPS_TMAP_BEER);
        map = must_build(&f, context);
        fflush(stdout);
        child = fork();
        if (child == 0) {
            signal(SIGABRT, leave);
            if (!freopen("/dev/null", "w", stderr)) _exit(4);
            if (!kept) sps_tmap_destroy(map);
            sps_destroy(context);
            _exit(0);
        }
        CHECK(child > 0 && waitpid(child, &status, 0) == child);
        CHECK_CASE("Found in review", "context destroyed before its map", "an assertion",
                   !WIFEXITED(status) || WEXITSTATUS(status) != (kept ? 3 : 0), 0, "exact");
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* Calls on a map in the wrong state. */
static void test_states(void) {
    const double points[6] = {0, 0, -5, 1, 1, -5};
    float depths[2] = {7, 7}, passes[2] = {7, 7}, least[2] = {7, 7}, most[2] = {7, 7};
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap_settings resolved;
    sps_tmap_info info;
    sps_tmap *map = (sps_tmap *)(void *)&resolved;
    fixture f;
    begin_little(&f, SPS_TMAP_OPACITY);
    complete(&f);
    CHECK(sps_tmap_create(NULL, &f.light, &f.settings, &map) == SPS_ERROR_ARGUMENT && map == NULL);
    CHECK(sps_tmap_create(context, NULL, &f.settings, &map) == SPS_ERROR_ARGUMENT &&
          strstr(sps_error(context), "NULL"));
    CHECK(sps_tmap_create(context, &f.light, NULL, &map) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_create(context, &f.light, &f.settings, NULL) == SPS_ERROR_ARGUMENT);
    CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
    check_unanswered(map, 0);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.is_finished == 0 && info.width == SIDE);
    CHECK(!sps_tmap_texels(map) && !sps_tmap_starts(map) && !sps_tmap_surfaces(map));
    CHECK(sps_tmap_add(map, NULL) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "scene"));
    CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
    CHECK_OK(context, sps_tmap_finish(map));
    CHECK(sps_tmap_finish(map) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "finished"));
    CHECK(sps_tmap_add(map, &f.s.scene) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "finished"));
    CHECK(sps_tmap_query(map, 2, points, depths, NULL) == SPS_OK);
    CHECK(sps_tmap_query(map, 2, points, NULL, passes) == SPS_OK);
    CHECK(sps_tmap_bracket(map, 2, points, least, NULL) == SPS_OK);
    CHECK(sps_tmap_bracket(map, 2, points, NULL, most) == SPS_OK);
    CHECK(depths[0] > 0 && passes[0] < 1 && least[0] <= depths[0] && most[0] >= depths[0]);
    CHECK(sps_tmap_starts(map) == NULL && sps_tmap_texels(map));
    CHECK(sps_tmap_query(map, 0, NULL, NULL, NULL) == SPS_OK && sps_tmap_bracket(map, 0, NULL, NULL, NULL) == SPS_OK);
    CHECK(sps_tmap_query_floats(map, 0, NULL, 0, NULL, NULL) == SPS_OK);
    const float answers[4] = {depths[0], passes[0], least[0], most[0]};
    CHECK(sps_tmap_query(map, 1, NULL, depths, passes) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_query_floats(map, 1, NULL, 0, depths, passes) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_bracket(map, 1, NULL, least, most) == SPS_ERROR_ARGUMENT);
    CHECK(depths[0] == answers[0] && passes[0] == answers[1] && least[0] == answers[2] && most[0] == answers[3]);
    CHECK(*sps_error(context) != 0); /* of sps_tmap_add: queries leave it alone */
    check_unanswered(NULL, 0);
    check_unanswered(map, 1);
    check_unanswered(map, -1);
    CHECK(sps_tmap_get_constants(map, 0, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_info(NULL, &info) == SPS_ERROR_ARGUMENT && info.width == SIDE);
    CHECK(sps_tmap_get_info(map, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.is_finished == 1);
    resolved = check_settings_of(map);
    CHECK(resolved.components == 8 && resolved.epsilon > 0.009f && resolved.far_depth >= 20);
    CHECK(sps_tmap_finish(NULL) == SPS_ERROR_ARGUMENT);
    CHECK(!sps_tmap_texels(NULL) && !sps_tmap_starts(NULL) && !sps_tmap_surfaces(NULL));
    sps_tmap_destroy(NULL);
    sps_tmap_destroy(map);
    end(&f);
    sps_destroy(context);
}

/* Providers that count their calls together, and fail at one of them. */
static struct {
    long calls, fail_at, progress, cancel_at;
    fixture *f;
} provider;

static int provider_counts(void) { return ++provider.calls == provider.fail_at ? 7 : 0; }

static int failing_particles(void *user, size_t first, size_t count, sps_particle *out) {
    read_crowd(user, first, count, out);
    return provider_counts();
}

static int failing_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    check_read_triangles(user, first, count, out);
    return provider_counts();
}

static int failing_voxels(void *user, size_t count, const double *positions, float *out) {
    check_eval_field(user, count, positions, out);
    return provider_counts();
}

static int failing_range(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)user, (void)lo, (void)size;
    out[0] = 0, out[1] = 1;
    return provider_counts();
}

static int failing_progress(void *user, float fraction) {
    (void)user;
    CHECK(fraction >= 0 && fraction <= 1);
    return ++provider.progress == provider.cancel_at;
}

static int rising_progress(void *user, float fraction) {
    float *seen = (float *)user; /* the last value, and the number of values between reading and the end */
    CHECK(fraction >= seen[0] && fraction <= 1);
    if (fraction > seen[0] && fraction > 0.2f && fraction < 1) seen[1] += 1;
    seen[0] = fraction;
    return 0;
}

/* Progress rises from face to face and from one band of rows to the next, and ends at 1. */
static void test_progress(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            float seen[2] = {0, 0};
            sps_config config;
            sps_context *context;
            fixture f;
            memset(&config, 0, sizeof config);
            config.progress_fn = rising_progress;
            config.clock_fn = check_hasty_clock;
            config.progress_user = seen;
            context = sps_create(&config, NULL);
            begin_little(&f, technique);
            if (round) see(&f, ROUND, 5);
            if (!round) f.light.width = 3, f.light.height = 200;
            sps_tmap_destroy(must_build(&f, context));
            CHECK_CASE("Found in review", "progress of maps that are made from lists",
                       "told for every band and face; ends at 1", !(seen[1] > (round ? 4 : 2) && seen[0] >= 1), 0,
                       "exact");
            sps_destroy(context);
            end(&f);
        }
}

/* Every call of every callback fails in turn, then every call of progress_fn cancels: a failed map cannot be queried,
   and the context is still usable. */
static void test_callbacks(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3)
        for (int cancels = 0; cancels < 2; ++cancels)
            for (int last = 0, n = 1; !last; ++n) {
                sps_config config;
                sps_context *context;
                fixture f;
                sps_tmap *map = NULL;
                sps_result result;
                memset(&config, 0, sizeof config);
                memset(&provider, 0, sizeof provider);
                config.progress_fn = failing_progress;
                config.clock_fn = check_hasty_clock;
                context = sps_create(&config, NULL);
                begin_little(&f, technique);
                f.sets[0].read_fn = f.sets[1].read_fn = failing_particles;
                f.s.mesh[0].read_fn = f.s.mesh[1].read_fn = failing_triangles;
                f.s.volume[0].eval_fn = failing_voxels, f.s.volume[0].range_fn = failing_range;
                complete(&f);
                CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
                CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
                CHECK(provider.calls == 0);
                if (cancels)
                    provider.cancel_at = n;
                else
                    provider.fail_at = n;
                result = sps_tmap_finish(map);
                last = cancels ? provider.progress < n : provider.calls < n;
                CHECK(result == (last ? SPS_OK : cancels ? SPS_ERROR_CANCELLED : SPS_ERROR_CALLBACK));
                if (!last) {
                    CHECK(strstr(sps_error(context), cancels ? "cancelled by progress_fn" : "failed: it returned 7"));
                    CHECK(!sps_tmap_texels(map) && !(query(map, 0, 0, -9) > 0));
                    CHECK(sps_tmap_finish(map) == SPS_ERROR_ARGUMENT);
                    CHECK(sps_tmap_add(map, &f.s.scene) == SPS_ERROR_ARGUMENT);
                }
                provider.cancel_at = provider.fail_at = 0;
                check_renders(context);
                sps_tmap_destroy(map);
                sps_destroy(context);
                end(&f);
                if (last) CHECK(n > (cancels ? 3 : 5));
            }
}

/* --------------------------------------------------------------------------------------------------------- extremes */

/* Finite numbers only, and T = exp(-depth), at random points in and around a map. */
static void check_sane(const sps_tmap *map, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < 150 && map; ++i) {
        double point[3];
        float depth, passes, least, most;
        for (int k = 0; k < 3; ++k)
            point[k] = map->view.camera.position[k] +
                       (i % 5 ? 1.2 : 1e3) * map->settings.far_depth * (2 * check_next(&random) - 1);
        sps_tmap_query(map, 1, point, &depth, &passes);
        sps_tmap_bracket(map, 1, point, &least, &most);
        if (!CHECK(depth >= 0 && depth <= 1e15f && passes >= 0 && passes <= 1 && least >= 0 && most <= 1e15f))
            printf("    technique %d depth %g\n", (int)map->settings.technique, (double)depth);
        CHECK_NEAR((double)passes, exp(-(double)depth), 2e-6 * (double)passes + 1e-37);
        CHECK((double)least <= (double)depth * 1.00001 + 1e-5 && (double)depth <= (double)most * 1.00001 + 1e-5);
    }
}

/* Faintest and densest gas: behind all of it, results are right up to the round-off of a chord and a sum of two. */
static void test_depths(void) {
    static const double depths[5] = {1e-8, 1e-3, 1e8, 1e18, 0};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 5 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 5;
        const double exact = fmin(depths[n % 5], 1e15);
        fixture f;
        sps_tmap *map;
        begin(&f, technique);
        if (technique == SPS_TMAP_COMPRESSED) f.settings.components = 16; /* exact behind everything */
        add(&f, 0, 0, 0, 1, 2, depths[n % 5]);
        add(&f, 1, 0, 0, -1, 2, 0);
        map = must_build(&f, context);
        if (technique != SPS_TMAP_COMPRESSED || exact > 1e-4) /* T is a float: 6e-8 of depth */
            CHECK_NEAR(query(map, 0, 0, -10), technique == SPS_TMAP_COMPRESSED && exact > 100 ? DARK : exact,
                       (technique == SPS_TMAP_COMPRESSED ? 2e-4 : 2e-6) * exact);
        CHECK_NEAR(query(map, 4, 4, -10), 0, 1e-15);
        check_sane(map, 7);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Sizes that are not multiples of a tile, a vector, or anything. */
static void test_sizes(void) {
    static const int sizes[6][2] = {{1, 1}, {67, 65}, {130, 3}, {3, 130}, {64, 64}, {65, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 7 * 6; ++n) {
        static const int techniques[6] = {SPS_TMAP_DEEP,   SPS_TMAP_DEEP_OPACITY, SPS_TMAP_FOURIER,
                                          SPS_TMAP_MOMENT, SPS_TMAP_COMPRESSED,   SPS_TMAP_BEER};
        const int size = n / 6;
        check_random random = {23};
        fixture f;
        sps_tmap *map;
        begin(&f, techniques[n % 6]);
        if (size == 6)
            see(&f, ROUND, 1);
        else
            f.light.width = sizes[size][0], f.light.height = sizes[size][1];
        if (f.light.height == 1) check_orthographic(&f.light.camera, 1);
        scatter(&f, 0, 30, 6, 71);
        scatter(&f, 1, 30, 6, 72);
        for (int i = 0; i < 60; ++i) f.crowds[i % 2].list[i / 2].radius += size == 6 ? 20 : size == 0 ? 7 : 2;
        map = must_build(&f, context);
        for (int i = 0; i < 200 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, size == 6 ? i % 6 : 0, (int)(f.light.width * check_next(&random)),
                   (int)(f.light.height * check_next(&random)), i % 3 ? 20 * check_next(&random) : 20, point);
            exact = exact_particles(&f, point);
            if (n % 6 == 0 || (i % 3 == 0 && techniques[n % 6] != SPS_TMAP_COMPRESSED))
                if (!CHECK_NEAR(query_at(map, point), exact.depth, exact.slack + 1e-5 * exact.depth))
                    printf("    size %d technique %d\n", size, techniques[n % 6]);
        }
        check_sane(map, 9);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Ranges of almost no width, or far from all gas, which is then entirely before or behind. */
static void test_ranges(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 5; ++n) {
            static const double ranges[5][2] = {
                {10, 1 + 1e-12}, {0.1, 5}, {100, 2}, {12, 1 + 1e-12}, {1e-3, 1 + 1e-12}};
            const double near_depth = ranges[n][0], far_depth = near_depth * ranges[n][1];
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            f.settings.near_depth = near_depth, f.settings.far_depth = far_depth;
            add(&f, 0, 0, 0, 0, 1.5, 2); /* depths 8.5 .. 11.5 */
            add(&f, 1, 0, 0, 0, 1.5, 0.5);
            add_square(&f, 0, -30, 30, 30, 1);
            add_mesh(&f, 0, 0.8);
            map = must_build(&f, context);
            CHECK_NEAR(query(map, 0, 0, 10 - 0.99 * near_depth), 0, 0);
            CHECK_NEAR(through(map, 0, 0, 10 - fmax(far_depth, 12)), 0.8 * exp(-2.5),
                       technique == SPS_TMAP_COMPRESSED ? 0.01 : 1e-5); /* its T is off by epsilon at most */
            if (technique == SPS_TMAP_DEEP && n != 1 && n != 4) {
                /* at near_depth: all that lies before. The middle of the chord, for n = 0, to 6e-8 of its 10. */
                const double before = n == 0 ? 1.25 : 2.5;
                CHECK_NEAR(query(map, 0, 0, 10 - near_depth), before - log(0.8), n == 2 ? 1e-6 : 3e-6);
            }
            check_sane(map, 13);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

static void test_nothing(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 4; ++n) {
            fixture f;
            sps_tmap *map;
            begin_little(&f, technique);
            if (n < 2) f.s.scene.volume_count = f.s.scene.mesh_count = 0, f.crowds[0].count = f.crowds[1].count = 0;
            if (n == 1) see(&f, ROUND, 5);
            if (n >= 2) check_set3(f.light.camera.target, 0, 0, 20); /* looks away */
            if (n == 3) check_perspective(&f.light.camera, 0.5);
            map = must_build(&f, context);
            check_sane(map, 3);
            CHECK_NEAR(query(map, 0, 0, n == 2 ? 10 : n == 3 ? 15 : -5), n == 2 ? query(map, 0, 0, 10) : 0, 1e-15);
            if (n < 2) CHECK_NEAR(through(map, 0, 0, -5), 1, 1e-15);
            if (n < 2) CHECK(sps_tmap_surfaces(map) == NULL);
            if (n < 2 && technique <= SPS_TMAP_COMPRESSED) CHECK(sps_tmap_starts(map)[n ? 150 : SIDE * SIDE] == 0);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* Scaled worlds, and ones far from the origin: the same results. Particles' positions are floats, so far away they are
   rounded to 1/16; the exact result uses the rounded positions. */
static void test_worlds(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const double scale = n % 4 == 1 ? 1e-3 : n % 4 == 2 ? 1e3 : 1, shift = n % 4 == 3 ? 1e6 : 0;
        check_random random = {33};
        fixture f, plain;
        sps_tmap *map, *same;
        begin_mixed(&plain, SPS_TMAP_DEEP);
        begin_mixed(&f, SPS_TMAP_DEEP);
        see(&f, n / 4 ? SPOT : ORTHO, SIDE);
        see(&plain, n / 4 ? SPOT : ORTHO, SIDE);
        for (int i = 0; i < 24; ++i) {
            sps_particle *p = &f.crowds[i % 2].list[i / 2];
            p->radius *= (float)scale;
            for (int k = 0; k < 3; ++k) p->position[k] = (float)((double)p->position[k] * scale + shift);
        }
        for (int k = 0; k < 3; ++k) {
            f.light.camera.position[k] = f.light.camera.position[k] * scale + shift;
            f.light.camera.target[k] += shift;
            for (int m = 0; m < 2; ++m) {
                f.s.mesh[m].placement.origin[k] = shift;
                f.s.mesh[m].placement.axis[k][k] = scale;
            }
            f.s.volume[0].placement.origin[k] = f.s.volume[0].placement.origin[k] * scale + shift;
            for (int a = 0; a < 3; ++a) f.s.volume[0].placement.axis[a][k] *= scale;
        }
        f.light.camera.ortho_height *= scale, f.settings.far_depth *= scale;
        f.s.volume[0].read_fn = plain.s.volume[0].read_fn = check_read_constant;
        f.s.volume[0].eval_fn = plain.s.volume[0].eval_fn = NULL;
        f.s.volume[0].user = plain.s.volume[0].user = &one;
        f.s.volume[0].extinction = (float)(0.1 / scale), plain.s.volume[0].extinction = 0.1f;
        if (shift > 0) f.crowds[0].count = f.crowds[1].count = plain.crowds[0].count = plain.crowds[1].count = 0;
        map = must_build(&f, context);
        same = must_build(&plain, context);
        for (int i = 0; i < 300 && map && same; ++i) {
            const int x = (int)(SIDE * check_next(&random)), y = (int)(SIDE * check_next(&random));
            const double t = 19.9 * check_next(&random);
            double point[3], other[3];
            on_ray(map, 0, x, y, t * scale, point);
            on_ray(same, 0, x, y, t, other);
            /* floats of places, 1e-7 of 10, at the rims of 24 chords; of slabs, where 1e6 has lost 10 digits of a
             * double */
            CHECK_NEAR(through(map, point[0], point[1], point[2]), through(same, other[0], other[1], other[2]), 1e-3);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(same);
        end(&f);
        end(&plain);
    }
    sps_destroy(context);
}

/* Particles far from the world's origin, against chords. */
static void test_far_away(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int way = ORTHO; way <= SPOT; ++way) {
        check_random random = {37};
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, SIDE);
        scatter(&f, 0, 40, 5, 91);
        for (int k = 0; k < 3; ++k) {
            f.light.camera.position[k] += 1e6, f.light.camera.target[k] += 1e6;
            for (int i = 0; i < 40; ++i) f.crowds[0].list[i].position[k] += 1e6f;
        }
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, 0, (int)(SIDE * check_next(&random)), (int)(SIDE * check_next(&random)),
                   20 * check_next(&random), point);
            exact =
                exact_particles(&f, point); /* by squares of 1e6, which leave 1e-4 of doubles: 4 times CHORD's 1e-3 */
            CHECK_NEAR(query_at(map, point), exact.depth, exact.slack + 4e-3);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The longest map, and the widest spot: right for particles; volumes are refused, with a cosine in the sentence. */
static void test_wide(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    size_t empty;
    begin(&f, SPS_TMAP_BEER);
    map = must_build(&f, context);
    empty = check_bytes_of(map) - SIDE * SIDE * 12;
    sps_tmap_destroy(map);
    f.light.width = 16384, f.light.height = 1;
    check_orthographic(&f.light.camera, 0.001);
    add(&f, 0, 5, 0, 0, 2, 3);
    map = must_build(&f, context);
    CHECK(map && check_bytes_of(map) == empty + 16384 * 12);
    CHECK_NEAR(query(map, 5, 0, -10), 3, 3e-6);
    CHECK_NEAR(query(map, 6.0005, 0, -10), 3 * sqrt(1 - 1.0005 * 1.0005 / 4), 1e-5);
    CHECK_NEAR(query(map, -7.9, 0, -10), 0, 0);
    sps_tmap_destroy(map);
    begin(&f, SPS_TMAP_DEEP);
    see(&f, SPOT, 151);
    check_perspective(&f.light.camera, 3);
    scatter(&f, 0, 60, 6, 77);
    for (int i = 0; i < 60; ++i) f.crowds[0].list[i].radius += 2; /* 0.75 texels, 0.187 t, at 20 */
    map = must_build(&f, context);
    for (int i = 0; i < 600 && map; ++i) {
        double point[3];
        answer exact;
        on_ray(map, 0, i * 7 % 151, i * 31 % 151, i % 19 + 0.5, point);
        exact = exact_particles(&f, point);
        CHECK_NEAR(query_at(map, point), exact.depth,
                   5 * exact.slack); /* positions of near ones are floats of up to 10 radii */
    }
    sps_tmap_destroy(map);
    add_box(&f, 4, 1, 0, 1);
    map = build(&f, context);
    CHECK(!map && strstr(sps_error(context), "light.camera's outermost rays' cosine with its axis is 0.0") &&
          strstr(sps_error(context), "0.1"));
    check_perspective(&f.light.camera, 2);
    f.light.height = 9, f.light.width = 9;
    map = must_build(&f, context);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* Slabs are for volumes: neither a distant particle, nor many that are much smaller than voxels, change them. */
static void test_stray(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *maps[3];
    for (int n = 0; n < 3; ++n) {
        fixture f;
        begin(&f, SPS_TMAP_DEEP);
        add_box(&f, 8, 2, 0.3, 0.5);
        if (n == 1) add(&f, 0, 0, 0, -3e7, 1, 1); /* behind far_depth, and 1e8 voxels away */
        for (int i = 0; i < 20 && n == 2; ++i) add(&f, 0, 300, 0, 0.001 * i, 1e-5, 1);
        maps[n] = must_build(&f, context);
    }
    for (int i = 0; i < 200 && maps[0] && maps[1] && maps[2]; ++i)
        for (int n = 1; n < 3; ++n)
            CHECK_NEAR(query(maps[n], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i),
                       query(maps[0], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i), 0);
    if (maps[0] && maps[2]) CHECK(check_bytes_of(maps[0]) == check_bytes_of(maps[2]));
    for (int n = 0; n < 3; ++n) sps_tmap_destroy(maps[n]);
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------- images that shade by maps */

enum { WIDE = 32, HIGH = 24, PIXELS = WIDE * HIGH };

static float image_a[4 * PIXELS], image_b[4 * PIXELS], image_c[4 * PIXELS];

static double small_blob(const void *user, const double p[3]) { return exp(-8 * vec_dot(p, p)) + 0 * !user; }

/* A blob over a plane, seen from the side and above. */
typedef struct picture {
    check_scene s;
    check_field field;
    check_triangles floor;
    sps_tmap_settings settings;
    crowd balls;
    sps_particles set;
} picture;

static void begin_picture(picture *p, int width, int height, int voxels) {
    static const double origin[3] = {-4, -1.2, -4}, u[3] = {8, 0, 0}, v[3] = {0, 0, 8};
    sps_volume *volume;
    memset(p, 0, sizeof *p);
    check_clear(&p->s, width, height);
    check_set3(p->s.view.camera.position, 1, 3, 7);
    check_perspective(&p->s.view.camera, 0.45);
    p->s.view.quality = SPS_QUALITY_DRAFT; /* smaller depth maps; the settings for gas are explicit */
    p->s.view.slab = 1;
    p->s.view.shadow_size = 2 * voxels;
    volume = check_add_volume(&p->s, voxels, voxels, voxels, check_box(-1, -1, -1, 1, 1, 1));
    p->field.value_fn = small_blob;
    p->field.user = p;
    p->settings.technique = SPS_TMAP_DEEP;
    volume->eval_fn = check_eval_field, volume->user = &p->field;
    volume->extinction = 5;
    check_color(volume->albedo, 0.9, 0.7, 0.5);
    check_add_quad(&p->floor, origin, u, v);
    check_add_mesh(&p->s, &p->floor, 0.8);
    p->set.read_fn = read_crowd;
    p->set.user = &p->balls;
    check_color(p->set.albedo, 0.5, 0.6, 0.9);
    p->s.scene.particles = &p->set;
}

static void add_picture_particles(picture *p, int count) {
    check_random random = {19};
    for (int i = 0; i < count; ++i) {
        sps_particle *one_particle = &p->balls.list[i];
        for (int k = 0; k < 3; ++k) one_particle->position[k] = (float)(2 * check_next(&random) - 1);
        one_particle->radius = (float)(0.15 + 0.2 * check_next(&random));
        one_particle->optical_depth = 0.6f;
    }
    p->balls.count = p->set.count = (size_t)count;
    p->s.scene.particle_set_count = 1;
}

static sps_light *lit_by_map(picture *p, sps_light *light) {
    light->shadow_map = &p->settings;
    return light;
}

static double brightest(const float *image, int pixels) {
    double most = 0;
    for (int i = 0; i < 4 * pixels; ++i)
        if (i % 4 < 3) most = fmax(most, (double)image[i]);
    return most;
}

/* A deep map agrees with the sheets, from slabs in other positions. The error of both is that of linear interpolation
   between the planes of slabs: for a slab of 0.5 voxels, 0.042, an eighth of its square times the steepest slope of
   extinction, 12: at most 0.26 % of the light in a pixel. Slopes rise as much as they fall along a ray, so that it
   nearly cancels: a mean of 2e-5 of the brightest radiance was measured, and 5e-5 is required. Voxels are splatted:
   samples lie elsewhere in maps, and test_filling.c bounds what that changes. Balls have rims, where
   slopes are not bounded: a slab's thickness to the power of 1.5 for uniform ones, less for thinner slabs. */
static void test_map_against_sheets(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        double difference[2], most = 0;
        for (int fine = 0; fine < 2; ++fine) {
            picture p;
            sps_light *light;
            begin_picture(&p, WIDE, HIGH, 24);
            if (n == 3) add_picture_particles(&p, 20), p.s.scene.volume_count = 0;
            p.s.view.slab = fine ? 0.25 : 0.5;
            p.s.view.filling = SPS_FILLING_SPLAT;
            light =
                n == 1 ? check_add_point(&p.s, 2, 4, 1, 20) : check_add_directional(&p.s, -1, -2, n == 2 ? 2 : -0.5, 3);
            check_render(context, &p.s, image_a);
            lit_by_map(&p, light);
            check_render(context, &p.s, image_b);
            difference[fine] = check_rms(image_a, image_b, 4 * PIXELS);
            most = brightest(image_a, PIXELS);
            CHECK(check_largest(image_a, image_b, 4 * PIXELS) < (n == 3 ? 0.01 : 0.0026) * most);
            CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
            check_free_triangles(&p.floor);
        }
        if (!CHECK(most > 0.1 && difference[0] < (n == 3 ? 4e-4 : 5e-5) * most))
            printf("    case %d: %g of %g\n", n, difference[0], most);
        if (n == 3) CHECK(difference[1] < 0.5 * difference[0]);
    }
    sps_destroy(context);
}

/* Every technique makes an image, and those that keep most detail come close to the deep map's. */
static void test_pictures(void) {
    static const double error[TECHNIQUES + 1] = {0, 0, 4e-3, 2e-2, 1e-2, 3e-2, 2e-2, 5e-2};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        picture p;
        sps_plan_report plan;
        begin_picture(&p, WIDE, HIGH, 9);
        add_picture_particles(&p, 6);
        p.settings.technique = (sps_tmap_technique)technique;
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4)); /* inside */
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plan));
        check_render(context, &p.s, technique != SPS_TMAP_DEEP ? image_b : image_a);
        for (int i = 0; i < 4 * PIXELS && technique != SPS_TMAP_DEEP; ++i)
            if (!(fabsf(image_b[i]) <= 100)) {
                CHECK(fabsf(image_b[i]) <= 100);
                break;
            }
        if (technique != SPS_TMAP_DEEP) {
            const double rms = check_rms(image_a, image_b, 4 * PIXELS);
            if (!CHECK_CASE("Found in review", "pictures by every kind of map",
                            "that by a deep map, rms of the brightest", rms / brightest(image_a, PIXELS),
                            error[technique], "by kind"))
                printf("    technique %d: %g\n", technique, rms);
        }
        check_free_triangles(&p.floor);
    }
    sps_destroy(context);
}

/* A light inside the gas is refused without a map, and agrees with the reference with one. Kernels' ripple is a quarter
   of a per cent, interpolation between slabs less; but close to the light, where its irradiance grows as 1 / r^2, there
   is one sample per slab: 5 % of the brightest in the four pixels around the light, 0.5 % in the mean of 432. */
/* A light's own map is fitted to the gas, and leaves a Fourier series a twentieth of the range free at either end,
   unless each texel has its own range. */
static void test_fitted_range(void) {
    sps_context *context = sps_create(NULL, NULL);
    double depths[4][2];
    for (int n = 0; n < 4; ++n) {
        picture p;
        const sps_tmap *map;
        begin_picture(&p, WIDE, HIGH, 9);
        p.settings.technique = n == 0 ? SPS_TMAP_OPACITY : SPS_TMAP_FOURIER;
        p.settings.texel_range = n == 2;
        lit_by_map(&p, n == 3 ? check_add_point(&p.s, 0.2, 6, 0.1, 20) : check_add_directional(&p.s, 0, -1, 0, 3));
        check_render(context, &p.s, image_a);
        map = (const sps_tmap *)context->buffers[SPSI_BUFFER_LIGHT_TMAPS].data; /* as the render left it */
        depths[n][0] = map->settings.near_depth, depths[n][1] = map->settings.far_depth;
        check_free_triangles(&p.floor);
    }
    {
        const double length = depths[0][1] - depths[0][0];
        CHECK(length > 1.9 && length < 3.5); /* the blob's voxels, 2 across, and kernels' reach, 2.5 voxels of 2/9 */
        CHECK_CASE("Found in review", "guard band of a Fourier map's fitted range", "a twentieth at either end",
                   fmax(fabs(depths[1][0] - (depths[0][0] - 0.05 * length)),
                        fabs(depths[1][1] - (depths[0][1] + 0.05 * length))),
                   1e-9, "doubles");
        CHECK_NEAR(depths[2][0], depths[0][0], 1e-9);
        CHECK_NEAR(depths[2][1], depths[0][1], 1e-9);
        CHECK(depths[3][1] - depths[3][0] > 1.1 * 1.9);
    }
    sps_destroy(context);
}

/* Six faces of default size agree with large ones: texels are as wide as voxels where gas is farthest, at which an
   opacity map of 64 planes resolves a blob of that width to one per cent. */
static void test_default_size(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2; ++n) {
        picture p;
        sps_light *light;
        begin_picture(&p, WIDE, HIGH, 16);
        p.s.view.shadow_size = 0;
        p.s.view.quality = SPS_QUALITY_MEDIUM;
        p.settings.technique = SPS_TMAP_OPACITY, p.settings.components = 64;
        light = check_add_point(&p.s, 0.3, 0.45, -0.2, 0.5);
        light->shadow_map_size = n * 128;
        lit_by_map(&p, light);
        check_render(context, &p.s, n ? image_b : image_a);
        {
            const sps_tmap *map = (const sps_tmap *)context->buffers[SPSI_BUFFER_LIGHT_TMAPS].data;
            const double voxel = 2.0 / 16, farthest = 1.45; /* kernels reach at most 2.5 voxels farther */
            CHECK(map->face_count == 6);
            CHECK(n ? map->rays[0].width == 128
                    : map->rays[0].width >= 2 * farthest / voxel &&
                          map->rays[0].width <= 2 * (farthest / voxel + 2.5) + 1);
        }
        check_free_triangles(&p.floor);
    }
    CHECK_CASE("Found in review", "six faces of default size", "those of 128 texels, rms of the brightest",
               check_rms(image_a, image_b, 4 * PIXELS) / brightest(image_b, PIXELS), 0.01,
               "64 planes resolve a blob as wide as a voxel to 1 %");
    sps_destroy(context);
}

static void test_light_inside(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    sps_light *light;
    sps_image image;
    double sum = 0, count = 0, most, worst = 0;
    begin_picture(&p, 24, 18, 16);
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    p.s.scene.mesh_count = 0;
    light = check_add_point(&p.s, 0.3, 0.45, -0.2, 0.5);
    p.s.view.slab = 0.5;
    p.s.view.quality = SPS_QUALITY_HIGH;
    light->shadow_map_size = 32;
    light->shadow_source = SPS_SHADOW_SHEETS;
    CHECK(sps_render(context, &p.s.scene, &p.s.view, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "shadow_source") != NULL);
    light->shadow_source = SPS_SHADOW_AUTO;
    lit_by_map(&p, light);
    check_render(context, &p.s, image_a);
    check_march(context, &p.s, 0.25, image_b, NULL);
    most = brightest(image_b, 24 * 18);
    for (int i = 0; i < 4 * 24 * 18; ++i) {
        const double off = fabs((double)image_a[i] - (double)image_b[i]);
        worst = fmax(worst, off), sum += off * off, count += 1;
    }
    CHECK(most > 0.02);
    CHECK_CASE("What users of other renderers complain of", "light inside the medium, by a map",
               "brute force, rms of the brightest", sqrt(sum / count) / most, 0.005,
               "ripple of 0.25 %, and lines between slabs as much");
    CHECK(worst < 0.05 * most);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Renders only the lights of `mask`, and returns the number of sweeps planned for them. */
static int render_lights(sps_context *context, picture *p, int mask, float *image) {
    sps_plan_report plan;
    for (int i = 0; i < 4; ++i)
        for (int c = 0; c < 3; ++c) p->s.light[i].color[c] = (float)(mask >> i & 1);
    CHECK(sps_plan(context, &p->s.scene, &p->s.view, &plan) == SPS_OK);
    check_render(context, &p->s, image);
    return plan.sweep_count;
}

/* The maximum difference between one image and the sum of two others, in red, and that of their means. */
static void off_sum(const float *whole, const float *a, const float *b, double off[2]) {
    double sum = 0, worst = 0;
    for (int i = 0; i < 4 * PIXELS; i += 4) {
        const double d = (double)whole[i] - ((double)a[i] + (double)b[i]);
        worst = fmax(worst, fabs(d)), sum += d;
    }
    off[0] = worst, off[1] = fabs(sum) / PIXELS;
}

/* Lights add up, with maps or sheets, in a scene of gas and polygons, and of balls in the end. Those with maps share
   one sweep, and their picture is the sum of their own up to round-off: about 30 additions per pixel (slabs and
   lights), each off by at most 6e-8 of the sum and by half of that in the mean. A light with sheets carries the others
   in its sweep; these are then looked up in its slabs instead of those that face the eye: each is off by at most 1 % of
   the light, and a fiftieth of that in the mean (as in test_map_against_sheets, in slabs twice as thick). */
static void test_lights_together(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    double off[2];
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 1));
    lit_by_map(&p, check_add_directional(&p.s, 1, -1, -0.5, 1));
    check_add_directional(&p.s, -0.2, -1, -2, 1);
    check_add_directional(&p.s, 0.2, -0.5, 1, 1); /* towards the eye: its sweep is composited back to front */
    p.s.light[3].shadow_source = SPS_SHADOW_SHEETS;
    CHECK(render_lights(context, &p, 1, image_a) == 1 && render_lights(context, &p, 2, image_b) == 1);
    CHECK(render_lights(context, &p, 3, image_c) == 1);
    CHECK(brightest(image_a, PIXELS) > 0.05 && brightest(image_b, PIXELS) > 0.05);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest(image_c, PIXELS));
    CHECK(render_lights(context, &p, 4, image_a) == 1 && render_lights(context, &p, 7, image_b) == 1);
    off_sum(image_b, image_c, image_a, off);
    CHECK_NEAR(off[0], 0, 0.01 * brightest(image_b, PIXELS));
    CHECK_NEAR(off[1], 0, 2e-4 * brightest(image_b, PIXELS));
    CHECK(render_lights(context, &p, 8, image_a) == 1 && render_lights(context, &p, 15, image_c) == 2);
    off_sum(image_c, image_b, image_a, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest(image_c, PIXELS)); /* the last light's own sweep is the same as alone */
    CHECK(render_lights(context, &p, 1, image_b) == 1 && render_lights(context, &p, 9, image_c) == 1);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 0.01 * brightest(image_c, PIXELS));
    CHECK_NEAR(off[1], 0, 2e-4 * brightest(image_c, PIXELS));
    add_picture_particles(&p, 30);
    CHECK(render_lights(context, &p, 1, image_a) == 1 && render_lights(context, &p, 2, image_b) == 1);
    CHECK(render_lights(context, &p, 3, image_c) == 1);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest(image_c, PIXELS));
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* A light far from its gas has one face, or six on request, which need more memory and make the same picture. Slabs are
   off by 0.26 % either way (test_map_against_sheets). Between texels of a face, 0.036 wide at the gas, optical depth is
   off by 1/8 of that squared times its maximum curvature, 16 * 3.1: 0.8 %. */
static void test_omnidirectional_light(void) {
    sps_stats_report stats[4];
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_point(&p.s, 2, 4, 1, 20))->shadow_map_size = 256;
    for (int i = 3; i >= 0; --i) { /* with 8 numbers per texel, and with lists */
        sps_context *context = sps_create(NULL, NULL);
        p.settings.technique = i < 2 ? SPS_TMAP_DEEP : SPS_TMAP_OPACITY;
        p.s.light[0].shadow_map_omnidirectional = i % 2;
        check_render(context, &p.s, i % 2 ? image_b : image_a);
        sps_get_stats(context, &stats[i]);
        sps_destroy(context);
    }
    CHECK(stats[3].bytes_peak > stats[2].bytes_peak + 4 * 256 * 256 * 8 * sizeof(float)); /* and not 5: bands differ */
    CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
    CHECK_NEAR(check_largest(image_a, image_b, 4 * PIXELS), 0, (2 * 0.0026 + 0.008) * brightest(image_a, PIXELS));
    check_free_triangles(&p.floor);
}

/* A light's zeroed settings are those of a table, in its plan as well. */
static void test_default_picture(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_plan_report plans[2];
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
    for (int i = 0; i < 2; ++i) {
        memset(&p.settings, 0, sizeof p.settings);
        if (i) p.settings.technique = SPS_TMAP_TABLE;
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plans[i]));
        check_render(context, &p.s, i ? image_b : image_a);
    }
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && brightest(image_a, PIXELS) > 0.05);
    CHECK(plans[0].pass[SPS_PASS_LIGHT_MAPS].bytes == plans[1].pass[SPS_PASS_LIGHT_MAPS].bytes);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Polygons alone need one sweep for any number of lights, and no maps, nor are any planned. */
static void test_lights_on_polygons(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_plan_report plan[2];
    picture p;
    double off[2];
    begin_picture(&p, WIDE, HIGH, 16);
    p.s.scene.volume_count = 0;
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 1));
    check_add_directional(&p.s, 1, -1, -0.5, 1);
    check_add_directional(&p.s, -0.2, -1, -2, 1);
    check_add_directional(&p.s, 0.3, -1, 0.2, 1);
    CHECK(render_lights(context, &p, 5, image_a) == 1 && render_lights(context, &p, 10, image_b) == 1);
    CHECK(render_lights(context, &p, 15, image_c) == 1);
    for (int i = 0; i < 2; ++i, p.s.light[0].shadow_map = NULL)
        CHECK(sps_plan(context, &p.s.scene, &p.s.view, &plan[i]) == SPS_OK);
    CHECK(plan[0].bytes == plan[1].bytes);
    off_sum(image_c, image_a, image_b, off);
    CHECK(brightest(image_a, PIXELS) > 0.05);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest(image_c, PIXELS));
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Lights that are black, or cast no shadows, need no map. */
static void test_needless_maps(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    check_add_directional(&p.s, -1, -2, -0.5, 2);
    lit_by_map(&p, check_add_point(&p.s, 2, 4, 1, 20))->no_shadow = 1;
    check_render(context, &p.s, image_a);
    p.s.light[1].shadow_map = NULL;
    check_render(context, &p.s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* The same bits for any number of workers, and for a region as part of the whole, with any map; voxels that are held
   from one call to the next are used by maps and images alike. */
static void test_picture_bits(void) {
    static const int workers[4] = {0, 1, 2, 7};
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3)
        for (int w = 0; w < 4; ++w) {
            check_hooks hooks;
            sps_context *context;
            picture p;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = workers[w], hooks.order = (uint64_t)w;
            context = check_context(&hooks);
            begin_picture(&p, 16, 12, 8);
            p.s.scene.mesh_count = 0;
            add_picture_particles(&p, 6);
            p.settings.technique = (sps_tmap_technique)technique;
            lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
            lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_size = 20;
            check_render(context, &p.s, w ? image_b : image_a);
            CHECK(w == 0 || memcmp(image_a, image_b, 4 * 16 * 12 * sizeof(float)) == 0);
            p.s.view.region[0] = 5, p.s.view.region[1] = 3, p.s.view.region[2] = 7, p.s.view.region[3] = 6;
            check_render(context, &p.s, image_c);
            for (int y = 0; y < 6; ++y)
                CHECK(memcmp(image_c + 4 * 7 * y, image_a + 4 * (16 * (3 + y) + 5), 4 * 7 * sizeof(float)) == 0);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            check_free_triangles(&p.floor);
        }
}

static void test_held_voxels(void) {
    sps_context *context = sps_create(NULL, NULL), *fresh = sps_create(NULL, NULL);
    picture p;
    fixture f;
    sps_tmap *maps[2];
    sps_stats_report stats;
    begin_picture(&p, WIDE, HIGH, 12);
    check_add_directional(&p.s, -1, -2, -0.5, 3);
    check_render(context, &p.s, image_a);
    p.s.volume[0].revision = 5;
    check_render(context, &p.s, image_b);
    begin(&f, SPS_TMAP_MOMENT);
    f.s.volume[0] = p.s.volume[0];
    f.s.scene.volume_count = 1;
    maps[0] = must_build(&f, context);
    sps_get_stats(context, &stats);
    CHECK(stats.eval_calls == 0 && stats.voxels_relevant > 0);
    maps[1] = must_build(&f, fresh);
    CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
    check_render(context, &p.s, image_c);
    sps_get_stats(context, &stats);
    CHECK(stats.eval_calls == 0);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && memcmp(image_a, image_c, sizeof image_a) == 0);
    sps_tmap_destroy(maps[0]);
    sps_tmap_destroy(maps[1]);
    check_free_triangles(&p.floor);
    sps_destroy(context);
    sps_destroy(fresh);
}

/* What the next test lends to a call. */
static float lent_planes[3];
static double lent_matrix[16];

/* Spoils it as soon as the call reads voxels. */
static double spoiling_blob(const void *user, const double p[3]) {
    for (int i = 0; i < 3; ++i) lent_planes[i] = 0.25f;
    memset(lent_matrix, 0, sizeof lent_matrix);
    return small_blob(user, p);
}

/* Planes and a camera's matrix are read before anything else is, and not again. */
static void test_picture_settings_are_copied(void) {
    static const float planes[3] = {0.4f, 0.6f, 1};
    static const double matrix[16] = {0.4, 0, 0, 0, 0, 0.4, 0, 0, 0, 0, -0.1, 0, 0, 0, 0, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int spoilt = 0; spoilt < 2; ++spoilt) {
        picture p;
        begin_picture(&p, 16, 16, 12);
        memcpy(lent_planes, planes, sizeof planes);
        memcpy(lent_matrix, matrix, sizeof matrix);
        memset(&p.s.view.camera, 0, sizeof p.s.view.camera);
        p.s.view.camera.world_to_clip = lent_matrix;
        p.settings.technique = SPS_TMAP_OPACITY;
        p.settings.planes = lent_planes, p.settings.components = 3;
        if (spoilt) p.field.value_fn = spoiling_blob;
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        check_render(context, &p.s, spoilt ? image_b : image_a);
        check_free_triangles(&p.floor);
    }
    CHECK(lent_matrix[0] <= 0 && brightest(image_a, 16 * 16) > 0.1);
    CHECK(memcmp(image_a, image_b, 16 * 16 * 4 * sizeof(float)) == 0);
    sps_destroy(context);
}

/* A light's invalid settings, and a mesh's transmittance, are refused by name. */
static void test_picture_refusals(void) {
    static const char *const texts[] = {"light[0].shadow_map.technique is 9; SPS_TMAP_DEPTH holds no gas",
                                        "light[0].shadow_map.components is 2",
                                        "light[0].shadow_map_omnidirectional is 1",
                                        "light[0].shadow_map.far_depth is 3",
                                        "light[0].shadow_map.surface_bias is 1",
                                        "light[0].shadow_map_size is -1",
                                        "light[0].shadow_map_size is 16385",
                                        "light[0].shadow_map.byte_budget is 99",
                                        "light[0].shadow_map.planes[0] is 0",
                                        "light[0].shadow_map.end_canary",
                                        "mesh[0].transmittance is -1"};
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        const sps_result expected = i == 7 ? SPS_ERROR_MEMORY : SPS_ERROR_ARGUMENT;
        static const float planes[9] = {0};
        sps_context *context = sps_create(NULL, NULL);
        sps_image image;
        sps_plan_report plan;
        picture p;
        begin_picture(&p, 8, 6, 8);
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        p.settings.technique = SPS_TMAP_OPACITY;
        if (i == 0) p.settings.technique = SPS_TMAP_DEPTH;
        if (i == 1) p.settings.technique = SPS_TMAP_BEER, p.settings.components = 2;
        if (i == 2) p.s.light[0].shadow_map_omnidirectional = 1;
        if (i == 3) p.settings.far_depth = 3;
        if (i == 4) p.settings.surface_bias = 1;
        if (i == 5 || i == 6) p.s.light[0].shadow_map_size = i == 5 ? -1 : 16385;
        if (i == 7) p.settings.byte_budget = 99;
        if (i == 8) p.settings.planes = planes, p.settings.components = 9;
        if (i == 9) p.settings.end_canary = 1;
        if (i == 10) p.s.mesh[0].transmittance[1] = -1;
        memset(&image, 0, sizeof image);
        image.rgba = image_c;
        image_c[0] = -5;
        CHECK(sps_render(context, &p.s.scene, &p.s.view, &image) == expected);
        CHECK(check_error_info(context, expected));
        if (!CHECK(strstr(sps_error(context), texts[i]) != NULL)) printf("    %s: %s\n", texts[i], sps_error(context));
        CHECK(image_c[0] <= -5);
        if (i >= 8) {
            CHECK(sps_plan(context, &p.s.scene, &p.s.view, &plan) == expected && plan.sweep_count == 0);
            CHECK(strstr(sps_error(context), texts[i]) != NULL);
            CHECK(check_reference(context, &p.s.scene, &p.s.view, 0.5, &image) == expected);
        }
        check_renders(context);
        check_free_triangles(&p.floor);
        sps_destroy(context);
    }
}

static double half_blob(const void *user, const double p[3]) { return p[0] > 0 ? small_blob(user, p) : 0; }

/* The plan for maps made from lists includes their bands of 64 rows and the numbers of intervals of these, whose tiles
   have room beside them; lists themselves and what is fitted to them are not planned. Six faces around a light, so that
   the map has the requested size; half of the gas is empty. */
static void test_planned_lists(void) {
    for (int n = 0; n < 6; ++n) {
        const int technique = n < 2 ? SPS_TMAP_DEEP : SPS_TMAP_COMPRESSED, side = n % 2 ? 90 : 64;
        const size_t texels = 6 * (size_t)(side * side);
        size_t held, planned;
        check_hooks hooks;
        sps_context *context;
        sps_plan_report plan;
        picture p;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin_picture(&p, 8, 6, 8);
        p.field.value_fn = half_blob;
        p.s.scene.mesh_count = 0;
        p.settings.technique = (sps_tmap_technique)technique;
        p.settings.components = n < 4 ? 0 : 8;
        lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_size = side;
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plan));
        planned = plan.pass[SPS_PASS_LIGHT_MAPS].bytes;
        if (check_render(context, &p.s, image_c)) {
            const spsi_buffer *buffers = context->buffers;
            held = buffers[SPSI_BUFFER_TMAP_VOLUMES].size + buffers[SPSI_BUFFER_LIGHT_TMAPS].size;
            held += buffers[SPSI_BUFFER_CURSORS].size;
            held += (texels + 1) * sizeof(uint32_t);
            CHECK_CASE("Found in review", "bytes of maps that are made from lists", "held / planned",
                       (double)held / (double)planned, 1, "a bound");
        }
        check_free_triangles(&p.floor);
        sps_destroy(context);
    }
}

/* Each allocation of an image with maps fails in turn. */
static void test_picture_allocations(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 4)
        for (int last = 0, n = 1; !last; ++n) {
            check_hooks hooks;
            sps_context *context;
            sps_image image;
            sps_result result;
            picture p;
            memset(&hooks, 0, sizeof hooks);
            context = check_context(&hooks);
            begin_picture(&p, 8, 6, 6);
            p.s.scene.mesh_count = 0;
            add_picture_particles(&p, 3);
            p.settings.technique = (sps_tmap_technique)technique;
            lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_size = 9;
            memset(&image, 0, sizeof image);
            image.rgba = image_c;
            hooks.fail_at = hooks.allocations + n;
            result = sps_render(context, &p.s.scene, &p.s.view, &image);
            last = hooks.allocations < hooks.fail_at;
            CHECK(result == (last ? SPS_OK : SPS_ERROR_MEMORY));
            hooks.fail_at = 0;
            CHECK_OK(context, sps_render(context, &p.s.scene, &p.s.view, &image));
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            check_free_triangles(&p.floor);
        }
}

int main(void) {
    RUN(test_particles);
    RUN(test_plain_numbers);
    RUN(test_between_texels);
    RUN(test_small_particles);
    RUN(test_small_particles_around);
    RUN(test_boxes);
    RUN(test_fine_voxels);
    RUN(test_blob);
    RUN(test_cut_kernels);
    RUN(test_classified_kernels);
    RUN(test_opaque);
    RUN(test_depth_maps);
    RUN(test_few_nodes);
    RUN(test_beer);
    RUN(test_bias_of_oblong_texels);
    RUN(test_behind_the_light);
    RUN(test_surfaces_at_the_ends);
    RUN(test_translucent);
    RUN(test_across_the_light);
    RUN(test_watertight);
    RUN(test_techniques);
    RUN(test_soft_compressed);
    RUN(test_cut_particles);
    if (!check_memory_only()) RUN(test_cut_sums);
    RUN(test_texels);
    RUN(test_same_bits);
    RUN(test_empty_soft_set);
    RUN(test_shuffled);
    RUN(test_seams);
    RUN(test_seams_of_fine_particles);
    RUN(test_gas_around);
    RUN(test_bytes);
    RUN(test_bytes_of_half_empty_maps);
    RUN(test_budget_of_components);
    RUN(test_budget_of_lists);
    RUN(test_allocations);
    RUN(test_memory_limit);
    RUN(test_default_technique);
    RUN(test_settings);
    RUN(test_planes);
    RUN(test_scenes);
    RUN(test_replaced);
    RUN(test_replaced_of_several);
    RUN(test_crowded_tiles);
    RUN(test_company);
    RUN(test_lookups);
    RUN(test_no_numbers);
    RUN(test_float_positions);
    RUN(test_info);
    RUN(test_constants);
    RUN(test_projection);
    RUN(test_projection_round);
    RUN(test_outside);
    RUN(test_outside_around);
    RUN(test_light_amid);
    RUN(test_surface_before_near);
    RUN(test_states);
    RUN(test_untransposed);
    RUN(test_looks_nowhere);
    RUN(test_context_before_maps);
    RUN(test_progress);
    RUN(test_callbacks);
    RUN(test_depths);
    RUN(test_sizes);
    RUN(test_ranges);
    RUN(test_nothing);
    RUN(test_worlds);
    RUN(test_far_away);
    RUN(test_wide);
    RUN(test_stray);
    RUN(test_map_against_sheets);
    RUN(test_pictures);
    RUN(test_fitted_range);
    RUN(test_default_size);
    RUN(test_light_inside);
    RUN(test_lights_together);
    RUN(test_omnidirectional_light);
    RUN(test_default_picture);
    RUN(test_lights_on_polygons);
    RUN(test_needless_maps);
    RUN(test_picture_bits);
    RUN(test_held_voxels);
    RUN(test_picture_settings_are_copied);
    RUN(test_picture_refusals);
    RUN(test_planned_lists);
    RUN(test_picture_allocations);
    return check_report();
}
