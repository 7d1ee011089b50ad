/* Transmittance maps: particles, voxels and triangles against sums and integrals in double precision, in maps of every
   technique, then what may go wrong, and images whose gas shades by maps. What each technique makes of one ray is
   tested by test_transmittance. Tolerances are derived where they stand; the parts they are made of:
   CHORD    a ball's chord is a polynomial in floats of some 16 operations, 6e-8 each, of numbers up to 1: its squared
            half length per radius is off by 1e-6, which is 1e-6 / (2 share) of the share s, and 1e-3 where s is 0;
   U        u is a float, good to 6e-8 of the range at either end of a stretch and at the place that is asked about;
   RIPPLE   a constant grid's optical depth is constant to 0.2 % only (kernels as for high quality), and the kernel's
            share of a slab is good to 2e-4 at both ends: 0.24 %. */

#include "check.h"

#define PI     3.14159265358979323846
#define CHORD  1e-6
#define U      2e-7
#define RIPPLE 0.0024

enum { SIDE = 9, MOST = 256, TECHNIQUES = SPS_TMAP_BEER + 1 };

static const double squared_voxel = 0.65 * 0.65; /* variance of the kernel */
static float one = 1;

/* ------------------------------------------------------------------------------------------------------- fixture */

/* Ways to see: all but the last two look along -z from (0,0,10) at texels of size 1 in the plane z = 0. */
enum { ORTHO, SPOT, ORTHO_MATRIX, SPOT_MATRIX, ORTHO_TURNED, SPOT_TURNED, ROUND, WAYS };

typedef struct crowd {
    sps_particle list[MOST];
    size_t count;
    long calls, fail_at;
} crowd;

typedef struct fixture {
    sps_view light;
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
    check_set3(f->light.position, 0, 0, 10);
    check_set3(f->light.up, 0, 1, 0);
    memset(f->matrix, 0, sizeof f->matrix);
    f->light.ortho_height = SIDE;
    f->light.field_of_view = way == SPOT || way == SPOT_TURNED ? 2 * atan(SIDE / 20.0) : 0;
    f->settings.omnidirectional = way == ROUND;
    if (way == ORTHO_TURNED || way == SPOT_TURNED) check_set3(f->light.position, 6, -5, 6.2);
    if (way == ROUND) check_set3(f->light.position, 0.5, -0.25, 1);
    f->matrix[0] = f->matrix[5] = way == ORTHO_MATRIX ? 2.0 / SIDE : 20.0 / SIDE;
    f->matrix[10] = -0.1; /* clip depth -1 is the plane z = 10 */
    f->matrix[14] = way == ORTHO_MATRIX ? 0 : -1;
    f->matrix[15] = way == ORTHO_MATRIX ? 1 : 10;
    f->light.world_to_clip = way == ORTHO_MATRIX || way == SPOT_MATRIX ? f->matrix : NULL;
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

/* None is smaller than a texel, also where a spot's are widest. */
static void scatter(fixture *f, int set, int count, double reach, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < count; ++i) {
        const double x = check_next(&random), y = check_next(&random), z = check_next(&random);
        add(f, set, reach * (2 * x - 1), reach * (2 * y - 1), 2 * reach * (2 * z - 1), 1.7 + check_next(&random),
            0.4 * check_next(&random));
    }
}

static void complete(fixture *f) {
    f->s.scene.particles_count = 0;
    for (int i = 0; i < 2; ++i) {
        f->sets[i].count = f->crowds[i].count;
        if (f->crowds[i].count > 0) f->s.scene.particles_count = i + 1;
    }
}

/* NULL: failed; the context knows why. */
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

/* A point on the ray of a texel; the map's own rays say only where it is, not what is there. */
static void on_ray(const sps_tmap *map, int face, int x, int y, double t, double point[3]) {
    spsi_ray_point(&map->rays[face], x, y, t, point);
}

/* A square of half width w about the origin across z, or about any axis, moved by `at`; every point of it is the
   mesh's. */
static void add_square(fixture *f, int mesh, double x0, double x1, double y, double z) {
    const double corner[3] = {x0, -y, z}, u[3] = {x1 - x0, 0, 0}, v[3] = {0, 2 * y, 0};
    check_add_quad(&f->triangles[mesh], corner, u, v);
}

static sps_mesh *add_mesh(fixture *f, int mesh, double transparency) {
    sps_mesh *m = check_add_mesh(&f->s, &f->triangles[mesh], 0.5);
    m->transparency = (float)transparency;
    return m;
}

/* -------------------------------------------------------------------------------------------------- exact answers */

typedef struct answer {
    double depth, slack; /* slack: how far floats may be off */
} answer;

/* The ray from the light through a point: its beginning, its unit direction, the point's depth along the axis, and the
   length of the ray per unit of that. `from`: where along the ray light begins. */
typedef struct ray {
    double origin[3], direction[3], t, length, from;
} ray;

static void ray_to(const fixture *f, const double point[3], ray *r) {
    double forward[3], offset[3];
    for (int i = 0; i < 3; ++i) {
        forward[i] = f->light.target[i] - f->light.position[i];
        offset[i] = point[i] - f->light.position[i];
    }
    spsi_normalise(forward);
    if (f->settings.omnidirectional) {
        for (int i = 0; i < 3; ++i) forward[i] = 0;
        r->t = 0;
        for (int i = 0; i < 3; ++i) r->t = fmax(r->t, fabs(offset[i]));
        r->length = spsi_length(offset) / r->t;
    }
    r->from = 0;
    memcpy(r->origin, f->light.position, sizeof r->origin);
    memcpy(r->direction, offset, sizeof offset);
    if (f->settings.omnidirectional) {
        spsi_normalise(r->direction);
    } else if (f->light.field_of_view > 0 || (f->light.world_to_clip && f->light.world_to_clip[14] < 0)) {
        spsi_normalise(r->direction);
        r->t = spsi_dot(offset, forward);
        r->length = spsi_length(offset) / r->t;
    } else {
        r->from = -HUGE_VAL;
        r->t = spsi_dot(offset, forward);
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
    double offset[3], along, square, half, depth = (double)p->optical_depth, part, first;
    for (int i = 0; i < 3; ++i) offset[i] = (double)p->position[i] - r->origin[i];
    along = spsi_dot(offset, r->direction);
    square = spsi_dot(offset, offset) - along * along;
    half = square < radius * radius ? sqrt(radius * radius - square) : 0;
    if (set->is_extinction) depth *= radius * (set->soft ? 4.0 / 3 : 2);
    {
        const double share = half / radius, blur = CHORD * (1 + spsi_length(offset) / (20 * radius));
        if (square > radius * radius * (1 + 2 * blur)) return;
        sum->slack += depth * fmin(blur / fmax(share, 1e-9), sqrt(2 * blur));
        if (!(half > 0)) return;
        depth *= set->soft ? share * share * share : share;
    }
    first = chord_share(set->soft, (r->from - along + half) / (2 * half));
    part = chord_share(set->soft, (end - along + half) / (2 * half)) - first;
    sum->depth += depth * fmax(part, 0);
    sum->slack += 1e-6 * depth + depth / (2 * half) * 1.5 * range * U;
    /* a soft chord that is cut, at either end of the range or at the light, is made of eight even pieces: 1.2 % */
    if (set->soft && (along - half < f->settings.near_depth * r->length ||
                      along + half > f->settings.far_depth * r->length))
        sum->slack += 0.012 * depth;
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

/* ------------------------------------------------------------------------------------------------------ particles */

/* Chords from every side: particles cross near_depth and far_depth and the light's plane, and one holds the light. */
static void test_particles(void) {
    sps_context *context = sps_create(NULL);
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
        add(&f, soft, f.light.position[0] + 0.5, f.light.position[1], f.light.position[2] - 0.25, 2, 0.7);
        map = must_build(&f, context);
        for (int i = 0; i < 1500 && map; ++i) {
            const int side = f.light.width, x = (int)(side * check_next(&random)), y = (int)(side * check_next(&random));
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

/* The same in plain numbers, where nothing but the answer itself is computed: halves, wholes, nothing. */
static void test_plain_numbers(void) {
    sps_context *context = sps_create(NULL);
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
    for (int soft = 0; soft < 2; ++soft) { /* the light in the middle of a particle sees half of it */
        see(&f, SPOT, SIDE);
        f.crowds[0].count = f.crowds[1].count = 0;
        add(&f, soft, 0, 0, 10, 2, 4);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 2, 2e-6);
        CHECK_NEAR(query(map, 0, 0, 12), 0, 0); /* behind the light */
        sps_tmap_destroy(map);
        f.crowds[soft].count = 0;
        add(&f, soft, 0, 0, 13, 2, 4); /* wholly behind it */
        add(&f, soft, 0, 0, 0, 0, 1e18f);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, 0), 0, 0);
        CHECK(sps_tmap_starts(map)[SIDE * SIDE] == 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Between texels the answer is bilinear in those of four texels at the point's own depth; beyond the outermost texels'
   centres the last of them goes on for half a texel, and there is nothing outside of that. */
static void test_between_texels(void) {
    sps_context *context = sps_create(NULL);
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

/* A particle smaller than a texel becomes a ball of 3/4 of a texel, R, of the same mass. Wherever it lies, its chords
   add up to depth (r / R)^2 times the sum of sqrt(1 - d^2 / R^2) over the texels within R, or of the cubes of these.
   Over all places the mean of that is the mass, 2/3 pi r^2 depth or 2/5. Even ones come to least where they are 0.3232
   off both ways, just out of reach of the next texel, sqrt(1 - 0.3714) = 0.793 of the 1.178 that they should, and to
   most midway between two, 2 sqrt(1 - 4 / 9) = 1.491: 33 % less to 27 % more. The mean over a grid of 16 x 16 places:
   square roots that begin inside of a cell make it one of order 1.5, 16^-1.5 / 2 = 0.8 %. */
static void test_small_particles(void) {
    sps_context *context = sps_create(NULL);
    for (int soft = 0; soft < 2; ++soft) {
        const double whole = 1000 * 0.01 * 0.01 * PI * (soft ? 2.0 / 5 : 2.0 / 3);
        double mean = 0;
        for (int i = 0; i < 256; ++i) {
            const double px = (i % 16 + 0.5) / 16, py = (i / 16 + 0.5) / 16;
            double sum = 0, exact = 0;
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_OPACITY);
            f.settings.components = 2;
            see(&f, i % 2 ? ORTHO : ORTHO_TURNED, SIDE);
            {
                double point[3];
                sps_tmap *empty = build(&f, context);
                on_ray(empty, 0, 4, 4, 10, point);
                spsi_along(point, empty->rays[0].a, px, point);
                spsi_along(point, empty->rays[0].b, py, point);
                sps_tmap_destroy(empty);
                add(&f, soft, point[0], point[1], point[2], 0.01, 1000);
            }
            map = must_build(&f, context);
            for (int k = 0; k < SIDE * SIDE && map; ++k) sum += (double)sps_tmap_texels(map)[2 * k + 1];
            for (int k = 0; k < 16; ++k) {
                const double dx = px + 1 - k % 4, dy = py + 1 - k / 4, share = 1 - (dx * dx + dy * dy) / 0.5625;
                if (share > 0) exact += 1000 * 0.0001 / 0.5625 * pow(share, soft ? 1.5 : 0.5);
            }
            CHECK_NEAR(sum, exact, 4 * 0.18 * 2e-3); /* the particle's place is a float: 1e-6, at four rims */
            if (!soft) CHECK(sum > 0.67 * whole && sum < 1.27 * whole);
            mean += sum / 256;
            sps_tmap_destroy(map);
        }
        CHECK_NEAR(mean, whole, 0.008 * whole);
    }
    sps_destroy(context);
}

int main(void) {
    RUN(test_particles);
    RUN(test_plain_numbers);
    RUN(test_between_texels);
    RUN(test_small_particles);
    return check_report();
}
