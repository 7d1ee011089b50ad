/* Scenes of transmittance maps, and sums and integrals in double precision of what lies in them. Tolerances are derived
   where they are used, from
   CHORD    a ball's chord is a polynomial in floats of some 16 operations, 6e-8 each, of numbers up to 1: its squared
            half length per radius is off by 1e-6, which is 1e-6 / (2 share) of the share s, and 1e-3 where s is 0;
   U        u is a float, accurate to 6e-8 of the range at either end of an interval and at the query point;
   RIPPLE   a constant grid's optical depth is constant to 0.2 % only (kernels as for high quality), and the kernel's
            share of a slab is good to 2e-4 at both ends: 0.24 %. */

#ifndef MAP_SCENE_H
#define MAP_SCENE_H

#include "check.h"

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

static inline int read_crowd(void *user, size_t first, size_t count, sps_particle *out) {
    crowd *c = (crowd *)user;
    memcpy(out, c->list + first, count * sizeof *out);
    return ++c->calls == c->fail_at ? 7 : 0;
}

static inline void see(fixture *f, int way, int side) {
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

static inline void begin(fixture *f, int technique) {
    memset(f, 0, sizeof *f);
    check_clear(&f->s, 0, 0);
    see(f, ORTHO, SIDE);
    f->settings.technique = (sps_tmap_technique)technique;
    f->settings.far_depth = 20;
    for (int i = 0; i < 2; ++i) f->sets[i].read_fn = read_crowd, f->sets[i].user = &f->crowds[i];
    f->sets[1].soft = 1;
    f->s.scene.particles = f->sets;
}

static inline void end(fixture *f) {
    for (int i = 0; i < 2; ++i) check_free_triangles(&f->triangles[i]);
}

static inline void add(fixture *f, int set, double x, double y, double z, double radius, double depth) {
    crowd *c = &f->crowds[set];
    sps_particle *p = &c->list[c->count++];
    p->position[0] = (float)x, p->position[1] = (float)y, p->position[2] = (float)z;
    p->radius = (float)radius, p->optical_depth = (float)depth;
}

/* None has a radius of less than 1.5 texels, even where a spot's are widest: smaller ones are weighted
   (test_small_particles). */
static inline void scatter(fixture *f, int set, int count, double reach, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < count; ++i) {
        const double x = check_next(&random), y = check_next(&random), z = check_next(&random);
        add(f, set, reach * (2 * x - 1), reach * (2 * y - 1), 2 * reach * (2 * z - 1), 3.4 + check_next(&random),
            0.4 * check_next(&random));
    }
}

static inline void complete(fixture *f) {
    f->s.scene.particle_set_count = 0;
    for (int i = 0; i < 2; ++i) {
        f->sets[i].count = f->crowds[i].count;
        if (f->crowds[i].count > 0) f->s.scene.particle_set_count = i + 1;
    }
}

/* Returns NULL on failure, with the error in the context. */
static inline sps_tmap *build(fixture *f, sps_context *context) {
    sps_tmap *map = NULL;
    complete(f);
    if (sps_tmap_create(context, &f->light, &f->settings, &map) != SPS_OK) return NULL;
    if (sps_tmap_add(map, &f->s.scene) == SPS_OK && sps_tmap_finish(map) == SPS_OK) return map;
    sps_tmap_destroy(map);
    return NULL;
}

static inline sps_tmap *must_build(fixture *f, sps_context *context) {
    sps_tmap *map = build(f, context);
    if (!CHECK(map != NULL)) printf("    technique %d: %s\n", (int)f->settings.technique, sps_error(context));
    return map;
}

static inline double query_at(const sps_tmap *map, const double point[3]) {
    float depth = -1;
    sps_tmap_query(map, 1, point, &depth, NULL);
    return (double)depth;
}

static inline double query(const sps_tmap *map, double x, double y, double z) {
    const double point[3] = {x, y, z};
    return query_at(map, point);
}

static inline double through(const sps_tmap *map, double x, double y, double z) {
    const double point[3] = {x, y, z};
    float transmittance = -1;
    sps_tmap_query(map, 1, point, NULL, &transmittance);
    return (double)transmittance;
}

/* A point on the ray of a texel; only its position comes from the map's own rays. */
static inline void on_ray(const sps_tmap *map, int face, int x, int y, double t, double point[3]) {
    spsi_ray_point(&map->grid.rays[face], x, y, t, point);
}

/* A rectangle across z. */
static inline void add_square(fixture *f, int mesh, double x0, double x1, double y, double z) {
    const double corner[3] = {x0, -y, z}, u[3] = {x1 - x0, 0, 0}, v[3] = {0, 2 * y, 0};
    check_add_quad(&f->triangles[mesh], corner, u, v);
}

static inline sps_mesh *add_mesh(fixture *f, int mesh, double transmittance) {
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

static inline void ray_to(const fixture *f, const double point[3], ray *r) {
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
static inline double chord_share(int soft, double s) {
    s = fmin(fmax(s, 0), 1);
    return soft ? s * s * (3 - 2 * s) : s;
}

static inline void add_particle_answer(const fixture *f, const ray *r, const sps_particles *set, const sps_particle *p,
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
static inline answer exact_particles(const fixture *f, const double point[3]) {
    answer sum = {0, 1e-6};
    ray r;
    ray_to(f, point, &r);
    if (r.t < f->settings.near_depth) return sum;
    for (int i = 0; i < 2; ++i)
        for (size_t k = 0; k < f->crowds[i].count; ++k)
            add_particle_answer(f, &r, &f->sets[i], &f->crowds[i].list[k], &sum);
    return sum;
}

static inline double normal_share(double x) { return 0.5 * erfc(-x / sqrt(2.0)); }

/* ---------------------------------------------------------------------------------------------------------- volumes */

/* A box of uniform gas, rotated about z and x by an angle. */
static inline sps_volume *add_box(fixture *f, int n, double half, double angle, double extinction) {
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

static inline double blob(const void *user, const double p[3]) { return exp(-0.5 * vec_dot(p, p)) + 0 * !user; }

/* ------------------------------------------------------------------------------------- all of it in every technique */

/* A rotated blob, uniform and soft particles, a translucent sheet, and an opaque one below half of that. */
static inline void begin_mixed(fixture *f, int technique) {
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

/* ------------------------------------------------------------------------------------------------------------ order */

static inline size_t float_count(const sps_tmap *map) {
    const size_t texels =
        (size_t)map->grid.rays[0].width * (size_t)map->grid.rays[0].height * (size_t)map->grid.face_count;
    if (map->technique->lists)
        return (map->settings.technique == SPS_TMAP_DEEP ? 4 : 2) * (size_t)sps_tmap_starts(map)[texels];
    return texels * (size_t)map->settings.components;
}

static inline int same_map(const sps_tmap *a, const sps_tmap *b) {
    const size_t texels = (size_t)a->grid.rays[0].width * (size_t)a->grid.rays[0].height * (size_t)a->grid.face_count;
    if (float_count(a) != float_count(b) || !sps_tmap_surfaces(a) != !sps_tmap_surfaces(b) ||
        !sps_tmap_fronts(a) != !sps_tmap_fronts(b))
        return 0;
    if (memcmp(sps_tmap_texels(a), sps_tmap_texels(b), float_count(a) * sizeof(float)) != 0) return 0;
    if (sps_tmap_surfaces(a) && memcmp(sps_tmap_surfaces(a), sps_tmap_surfaces(b), texels * sizeof(float)) != 0)
        return 0;
    if (sps_tmap_fronts(a) && memcmp(sps_tmap_fronts(a), sps_tmap_fronts(b), texels * sizeof(float)) != 0) return 0;
    return !sps_tmap_starts(a) || memcmp(sps_tmap_starts(a), sps_tmap_starts(b), (texels + 1) * sizeof(uint32_t)) == 0;
}

/* ----------------------------------------------------------------------------------------------------------- memory */

/* A smaller mixed scene, for many repetitions. */
static inline void begin_little(fixture *f, int technique) {
    begin_mixed(f, technique);
    f->light.width = f->light.height = SIDE;
    f->s.volume[0].size[0] = f->s.volume[0].size[1] = f->s.volume[0].size[2] = 5;
    f->crowds[0].count = f->crowds[1].count = 4;
}

/* The context is still usable. */
static inline void check_renders(sps_context *context) {
    static float rgba[4 * 64];
    check_scene s;
    check_clear(&s, 8, 8);
    check_add_directional(&s, 0, 0, -1, 1);
    check_add_volume(&s, 3, 3, 3, check_box(-1, -1, -1, 1, 1, 1))->eval_fn = check_eval_constant;
    s.volume[0].user = &one;
    s.volume[0].extinction = 1;
    if (check_render(context, &s, rgba)) CHECK(rgba[4 * 36 + 3] > 0.5f);
}

#endif /* MAP_SCENE_H */
