/* Transmittance maps sampled by the code of examples/shaders/ against sps_tmap_query, and the statements of
   docs/shadow_maps.md about maps. As C this runs transmittance_map.h; as C++ with SAMPLING_GLSL or SAMPLING_HLSL
   defined it runs transmittance_map.glsl or .hlsl. */

#include "check.h"

#if defined(SAMPLING_GLSL) || defined(SAMPLING_HLSL)
#include "shading_languages.h"
#else
#include "shaders/transmittance_map.h"

/* The shaders' uniform block and buffers. */
static tmap tmap_bound;

static void bind(const float *texels, const float *others[3], const uint32_t *starts) {
    tmap_bound.texels = texels, tmap_bound.starts = starts;
    tmap_bound.surfaces = others[0], tmap_bound.fronts = others[1], tmap_bound.planes = others[2];
}
#endif

/* As bound. */
static const float *texels, *surfaces, *fronts, *planes;
static const uint32_t *starts;

/* The same map with other texels. */
static void bind_texels(const float *list) {
    const float *others[3] = {surfaces, fronts, planes};
    texels = list;
    bind(texels, others, starts);
}

/* -------------------------------------------------------------------------------------------------------- the scene */

enum { WIDTH = 23, HEIGHT = 17, SIDE = 19, EVEN = 40, SOFT = 30, OPAQUE = 5, GLASS = 4, POINTS = 1000 };

typedef enum light_kind { SPOT, SUN, SIX_FACES, SPOT_BY_MATRIX, SUN_BY_MATRIX, KINDS } light_kind;

/* Gas in two sets of particles, some of them dense, opaque triangles and translucent ones, all within 4 of the origin
   along each axis. The light is outside, or, with six faces, amid it; some of the gas and of the query points lie
   before near_depth. */
typedef struct fixture {
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_scene scene;
    sps_particles sets[2];
    sps_mesh meshes[2];
    sps_particle even[EVEN], soft[SOFT];
    sps_triangle opaque[OPAQUE], glass[GLASS];
    light_kind kind;
    double matrix[16];
} fixture;

static int read_particles(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

static int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    memcpy(out, (const sps_triangle *)user + first, count * sizeof *out);
    return 0;
}

static void scatter(check_random *random, sps_particle *list, int count) {
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) list[i].position[k] = (float)(6 * check_next(random) - 3);
        list[i].radius = (float)(0.4 + 0.9 * check_next(random));
        list[i].optical_depth = (float)((i % 10 == 0 ? 8 : 1) * check_next(random));
    }
}

static void scatter_triangles(check_random *random, sps_triangle *list, int count) {
    for (int i = 0; i < count; ++i) {
        double middle[3];
        for (int k = 0; k < 3; ++k) middle[k] = 5 * check_next(random) - 2.5;
        for (int corner = 0; corner < 3; ++corner)
            for (int k = 0; k < 3; ++k)
                list[i].position[corner][k] = (float)(middle[k] + 3.5 * (check_next(random) - 0.5));
    }
}

static void fixture_fill(fixture *f) {
    check_random random = {77};
    scatter(&random, f->even, EVEN);
    scatter(&random, f->soft, SOFT);
    scatter_triangles(&random, f->opaque, OPAQUE);
    scatter_triangles(&random, f->glass, GLASS);
    for (int i = 0; i < 2; ++i) {
        f->sets[i].read_fn = read_particles;
        f->meshes[i].read_fn = read_triangles;
    }
    f->sets[0].user = f->even, f->sets[0].count = EVEN;
    f->sets[1].user = f->soft, f->sets[1].count = SOFT, f->sets[1].soft = 1;
    f->meshes[0].user = f->opaque, f->meshes[0].triangle_count = OPAQUE;
    f->meshes[1].user = f->glass, f->meshes[1].triangle_count = GLASS, check_translucent(&f->meshes[1], 0.6);
    f->scene.particles = f->sets, f->scene.particle_set_count = 2;
    f->scene.meshes = f->meshes, f->scene.mesh_count = 2;
}

/* Row-major; the world is rotated by some angle and moved 8 in front of the light; perspective as in OpenGL, from 2 to
   20, and orthographic as in Direct3D, 7 by 6 world units and 16 deep. */
static void fill_matrix(double m[16], int perspective) {
    const double c = cos(0.4), s = sin(0.4), x = perspective ? 2.2 : 2 / 7.0, y = perspective ? 2.9 : 2 / 6.0;
    const double view[3][4] = {{c, s, 0, 0.2}, {-s, c, 0, 0.1}, {0, 0, 1, 8}};
    for (int i = 0; i < 4; ++i) {
        const double one = i == 3;
        m[i] = x * view[0][i], m[4 + i] = y * view[1][i];
        m[8 + i] = perspective ? (22 * view[2][i] - 80 * one) / 18 : view[2][i] / 16;
        m[12 + i] = perspective ? view[2][i] : one;
    }
}

static void fixture_aim(fixture *f, light_kind kind) {
    f->kind = kind;
    check_set3(f->light.camera.position, 0.3, -0.2, kind == SIX_FACES ? 0.4 : 9);
    check_set3(f->light.camera.target, -0.4, 0.5, 0);
    check_set3(f->light.camera.up, 0.2, 1, 0.1);
    f->light.width = kind == SIX_FACES ? SIDE : WIDTH;
    f->light.height = kind == SIX_FACES ? SIDE : HEIGHT;
    check_orthographic(&f->light.camera, 6);
    check_perspective(&f->light.camera, kind == SPOT ? 0.7 : 0);
    f->settings.near_depth = kind == SIX_FACES ? 0.9 : 5.5;
    f->settings.far_depth = kind == SIX_FACES ? 4.5 : 13;
    f->light.omnidirectional = kind == SIX_FACES;
    if (kind < SPOT_BY_MATRIX) return;
    fill_matrix(f->matrix, kind == SPOT_BY_MATRIX);
    check_matrix(&f->light.camera, f->matrix);
    if (kind == SUN_BY_MATRIX)
        f->settings.near_depth += 16, f->settings.far_depth += 16, f->settings.surface_bias = 0.4;
}

static sps_tmap *fixture_build(const fixture *f, sps_context *context) {
    sps_tmap *map = NULL;
    if (CHECK_OK(context, sps_tmap_create(context, &f->light, &f->settings, &map)) &&
        CHECK_OK(context, sps_tmap_add(map, &f->scene)) && CHECK_OK(context, sps_tmap_finish(map)))
        return map;
    sps_tmap_destroy(map);
    return NULL;
}

/* ------------------------------------------------------------------------------------------- constants for a shader */

/* An engine that has drawn the map itself, with its own clip matrix, passes the same constants. */
static void check_own_matrix(const fixture *f, const double matrix[16]) {
    const double *m = f->light.camera.world_to_clip, *w = m + 12;
    for (int i = 0; i < 4; ++i) {
        const double own[3] = {((m[i] + w[i]) * f->light.width - w[i]) / 2,
                               ((w[i] - m[4 + i]) * f->light.height - w[i]) / 2, w[i]};
        CHECK_NEAR(matrix[i], own[0], 1e-12 * WIDTH);
        CHECK_NEAR(matrix[4 + i], own[1], 1e-12 * WIDTH);
        CHECK_NEAR(matrix[12 + i], own[2], 1e-12);
    }
}

static void hand_over(const sps_tmap *map, const fixture *f) {
    const sps_tmap_settings s = check_settings_of(map);
    sps_tmap_constants constants;
    double matrix[16];
    CHECK(sizeof tmap_bound >= sizeof constants && sps_tmap_get_constants(map, 0, &constants) == SPS_OK);
    memcpy((void *)&tmap_bound, &constants, sizeof constants); /* as into a uniform block */
    starts = sps_tmap_starts(map), surfaces = sps_tmap_surfaces(map), fronts = sps_tmap_fronts(map), planes = s.planes;
    bind_texels(sps_tmap_texels(map));
    CHECK(tmap_bound.technique_id == (int)s.technique && tmap_bound.components == s.components);
    CHECK(tmap_bound.has_range == (s.technique == SPS_TMAP_DEEP_OPACITY || s.technique == SPS_TMAP_BEER ||
                                   (s.technique == SPS_TMAP_FOURIER && s.texel_range)));
    CHECK(tmap_bound.has_planes == (planes != NULL) && tmap_bound.cubic == s.cubic);
    CHECK(tmap_bound.has_surfaces == (surfaces != NULL) && tmap_bound.has_fronts == (fronts != NULL));
    CHECK(tmap_bound.border == f->light.border);
    CHECK(tmap_bound.width == f->light.width + 2 * f->light.border);
    CHECK(tmap_bound.height == f->light.height + 2 * f->light.border);
    CHECK(tmap_bound.face == 0 && tmap_bound.face_count == (f->light.omnidirectional ? 6 : 1));
    sps_tmap_get_projection(map, 0, matrix, NULL);
    if (f->light.camera.world_to_clip) check_own_matrix(f, matrix);
}

/* A point given in world space. */
static tmap_place locate(const fixture *f, const double position[3]) {
    tmap_vec3 p;
    const double *origin = f->light.camera.position;
    if (!f->light.omnidirectional) {
        p.x = (float)position[0], p.y = (float)position[1], p.z = (float)position[2];
        return tmap_project(tmap_bound, p);
    }
    p.x = (float)(position[0] - origin[0]), p.y = (float)(position[1] - origin[1]);
    p.z = (float)(position[2] - origin[2]);
    return tmap_project_to_cube(tmap_bound, p);
}

/* ------------------------------------------------------------------------------------------- against sps_tmap_query */

/* The range that contains every possible result of a floating-point evaluation. */
typedef struct span {
    double low, high;
} span;

/* The error of optical depth `depth` due to an error of transmittance by `error`, with T clamped to `least`. */
static span span_of_through(double depth, double error, double least) {
    span s;
    const double through = exp(-depth), low = fmax(through - error, least);
    s.low = -log(fmin(through + error, 1));
    s.high = low > 0 ? -log(low) : 1e15;
    return s;
}

/* Moments are solved for with a nearly singular matrix. In floats the result is exact for a matrix whose elements are
   off by about its size times 6e-8 [Wilkinson 1968]; the effect on the result is found by perturbing them: three times
   the maximum of eight tries. */
static span span_of_moments(int texel, float u, double depth) {
    const float *kept = texels;
    check_random random = {(uint64_t)texel + 1};
    double most = 0;
    span s;
    for (int i = 0; i < 8; ++i) {
        float moved[9];
        for (int k = 0; k < tmap_bound.components; ++k) {
            const double error = 3e-7 * (check_next(&random) < 0.5 ? -1 : 1);
            moved[k] = (float)((double)kept[texel * tmap_bound.components + k] + (k > 0 ? error : 0));
        }
        bind_texels(moved);
        most = fmax(most, fabs((double)tmap_moment_depth(tmap_bound, 0, tmap_bound.components, u) - depth));
    }
    bind_texels(kept);
    s.low = depth - 3 * most, s.high = depth + 3 * most;
    return s;
}

/* One texel at one u. Sums of up to 17 terms, angles of up to 50 radians with a relative error of 6e-8, each term less
   than the total: 2e-6 of that. Lines between nodes of T: three roundings. */
static span span_of_texel(int texel, float u) {
    const double depth = (double)tmap_gas_depth(tmap_bound, texel, u),
                 whole = (double)tmap_gas_depth(tmap_bound, texel, 1);
    span s;
    if (tmap_bound.technique_id == SPS_TMAP_COMPRESSED) return span_of_through(depth, 3e-7, 0);
    if (tmap_bound.technique_id == SPS_TMAP_MOMENT) return span_of_moments(texel, u, depth);
    s.low = s.high = depth;
    if (tmap_bound.technique_id == SPS_TMAP_DEPTH) return s;
    s.low -= 2e-6 * whole, s.high += 2e-6 * whole;
    return s;
}

/* All results between u - 8e-7 and u + 8e-7: depths are up to 30, with one rounding, and sums of three products of up
   to 12, over a range of 4 that is nearer, or of 8.5. Over so little, curves are straight, or jump. */
static span span_about(int texel, float u) {
    span s = span_of_texel(texel, u);
    for (int i = -1; i <= 1; i += 2) {
        const span other = span_of_texel(texel, fminf(fmaxf(u + (float)i * 8e-7f, 0), 1));
        s.low = fmin(s.low, other.low), s.high = fmax(s.high, other.high);
    }
    return s;
}

static double overlap(double x, int texel) { return fmax(1 - fabs(x - texel), 0); }

/* The allowed results of the code at a point. Texel coordinates are sums of three products of up to 12 in units of at
   most 5 texels, each accurate to 6e-8: 2e-5. A point whose u is this close to a surface may be before or behind it. */
static span span_of_transmittance(const tmap_place *p) {
    const double bias = (double)((tmap_bound.bias + tmap_bound.bias_per_distance * p->distance) /
                                 (tmap_bound.far_depth - tmap_bound.near_depth));
    const double beyond = (double)p->u; /* possibly of far_depth: surfaces may lie there */
    const float u = fminf(p->u, 1);
    span depth = {0, 0}, lit = {0, 0}, s;
    for (int i = 0; i < 4; ++i) {
        const int x = (int)floorf(p->x) + i % 2, y = (int)floorf(p->y) + i / 2;
        const int row = p->face * tmap_bound.height + tmap_clamp_int(y, 0, tmap_bound.height - 1);
        const int texel = row * tmap_bound.width + tmap_clamp_int(x, 0, tmap_bound.width - 1);
        const double weight = overlap((double)p->x, x) * overlap((double)p->y, y), less = fmax(weight - 4e-5, 0);
        const double front = fronts ? (double)fronts[texel] : 0;
        const span one = span_about(texel, u);
        const double surface = surfaces ? (double)surfaces[texel] + bias : 1e30;
        depth.low += less * (front + fmax(one.low, 0)), depth.high += (weight + 4e-5) * (front + one.high);
        lit.low += surface - 1e-6 < beyond ? 0 : less;
        lit.high += surface + 1e-6 < beyond ? 0 : weight + 4e-5;
        if (i == 3 && lit.low > 1 - 2e-4) lit.low = lit.high = 1;
    }
    s.low = lit.low * exp(-depth.high) - 3e-7, s.high = lit.high * exp(-depth.low) + 3e-7;
    return s;
}

static int outside(const tmap_place *p) {
    const float edge = (float)tmap_bound.border - 0.5f;
    return !(p->u >= 0 && p->x >= edge && p->y >= edge && p->x <= (float)tmap_bound.width - 1 - edge &&
             p->y <= (float)tmap_bound.height - 1 - edge);
}

/* Statistics of random points. */
typedef struct tally {
    int outside, between, seen, dark;
    double slack; /* widths of spans, summed */
} tally;

/* Whether both transmittances are right at a point of the map. */
typedef int (*judge_fn)(const tmap_place *p, double sampled, double query, tally *points);

static int judge_between(const tmap_place *p, double sampled, double query, tally *points) {
    const span s = span_of_transmittance(p);
    points->slack += s.high - s.low;
    points->between += query > 0.02 && query < 0.98;
    return query >= s.low && query <= s.high && sampled >= s.low && sampled <= s.high;
}

/* Behind far_depth, up to three times as far from the centre of the scene. Texel coordinates are off by three times as
   much there, 6e-5, weights by 1.2e-4, and that of the largest optical depth, 30, is 4e-3 of T. */
static int judge_beyond(const tmap_place *p, double sampled, double query, tally *points) {
    if (p->u < 1.01f) return 1;
    const span s = span_of_transmittance(p);
    if (s.high - s.low > 1e-2) return 1; /* at a surface's own depth, or at the map's edge */
    ++points->seen;
    points->dark += query <= 0;
    return fabs(sampled - query) <= 4e-3;
}

/* Checks random points within `reach` of the centre along each axis. Outside the map both transmittances are 1. */
static tally check_points(const char *name, const fixture *f, const sps_tmap *map, uint64_t seed, double reach,
                          judge_fn judge) {
    check_random random = {seed};
    tally points = {0, 0, 0, 0, 0};
    for (int i = 0; i < POINTS; ++i) {
        double position[3];
        float query;
        for (int k = 0; k < 3; ++k) position[k] = (double)(float)(reach * (2 * check_next(&random) - 1));
        sps_tmap_query(map, 1, position, NULL, &query);
        const tmap_place p = locate(f, position);
        const double sampled = (double)tmap_transmittance(tmap_bound, p);
        const int is_outside = outside(&p);
        points.outside += is_outside;
        if (!CHECK(is_outside ? sampled == 1 && query == 1 : judge(&p, sampled, (double)query, &points)))
            printf("    %s, light %d: face %d x %g y %g u %g: sampled %.8g, query %.8g\n", name, (int)f->kind, p.face,
                   (double)p.x, (double)p.y, (double)p.u, sampled, (double)query);
    }
    return points;
}

/* At random points the code agrees with sps_tmap_query except for round-off, which may be at most 5e-4 on average over
   all points on the map. At least one in five points is neither lit nor dark. */
static void check_map(const char *name, const fixture *f, const sps_tmap *map) {
    hand_over(map, f);
    const tally near = check_points(name, f, map, 5, 4, judge_between);
    const tally far = check_points(name, f, map, 6, 12, judge_beyond);
    if (!CHECK(near.slack < 5e-4 * (double)POINTS && near.outside < POINTS / 2 &&
               (near.between > POINTS / 5 || tmap_bound.technique_id == SPS_TMAP_DEPTH)))
        printf("    %s, light %d: slack %g, %d partly lit, %d outside\n", name, (int)f->kind,
               near.slack / (double)POINTS, near.between, near.outside);
    if (!CHECK(far.seen > 20 && (!surfaces || far.dark > 0)))
        printf("    %s, light %d: of %d points behind far_depth %d are dark\n", name, (int)f->kind, far.seen, far.dark);
}

/* --------------------------------------------------------------------------------------------------- all techniques */

typedef struct variant {
    const char *name;
    sps_tmap_technique technique;
    int components, cubic, has_planes, texel_range;
} variant;

static const variant variants[] = {
    {"deep", SPS_TMAP_DEEP, 0, 0, 0, 0},
    {"compressed", SPS_TMAP_COMPRESSED, 0, 0, 0, 0},
    {"opacity", SPS_TMAP_OPACITY, 0, 0, 0, 0},
    {"opacity, one plane", SPS_TMAP_OPACITY, 1, 0, 0, 0},
    {"opacity, cubic", SPS_TMAP_OPACITY, 11, 1, 0, 0},
    {"opacity, one plane, cubic", SPS_TMAP_OPACITY, 1, 1, 0, 0},
    {"opacity, planes given", SPS_TMAP_OPACITY, 8, 0, 1, 0},
    {"opacity, planes given, cubic", SPS_TMAP_OPACITY, 8, 1, 1, 0},
    {"deep opacity", SPS_TMAP_DEEP_OPACITY, 0, 0, 0, 0},
    {"deep opacity, planes given, cubic", SPS_TMAP_DEEP_OPACITY, 10, 1, 1, 0},
    {"Fourier", SPS_TMAP_FOURIER, 0, 0, 0, 0},
    {"Fourier, 8 harmonics", SPS_TMAP_FOURIER, 17, 0, 0, 0},
    {"Fourier, 4 harmonics, range", SPS_TMAP_FOURIER, 11, 0, 0, 1},
    {"Fourier, range", SPS_TMAP_FOURIER, 0, 0, 0, 1},
    {"4 moments", SPS_TMAP_MOMENT, 0, 0, 0, 0},
    {"6 moments", SPS_TMAP_MOMENT, 7, 0, 0, 0},
    {"compressed, 8 nodes", SPS_TMAP_COMPRESSED, 16, 0, 0, 0},
    {"Beer", SPS_TMAP_BEER, 0, 0, 0, 0},
    {"depth", SPS_TMAP_DEPTH, 0, 0, 0, 0},
};

static const variant *variant_of(const char *name) {
    const variant *v = variants;
    while (strcmp(v->name, name) != 0) ++v;
    return v;
}

static const float given_planes[8] = {0.15f, 0.3f, 0.34f, 0.4f, 0.55f, 0.77f, 0.8f, 1};

static void fixture_begin(fixture *f, const variant *v, light_kind kind) {
    memset(f, 0, sizeof *f);
    fixture_fill(f);
    f->settings.technique = v->technique;
    f->settings.components = v->components;
    f->settings.cubic = v->cubic;
    f->settings.planes = v->has_planes ? given_planes : NULL;
    f->settings.texel_range = v->texel_range;
    fixture_aim(f, kind);
}

static void test_techniques(void) {
    static fixture f;
    sps_context *context = sps_create(NULL, NULL);
    for (int kind = 0; kind < KINDS; ++kind)
        for (size_t i = 0; i < sizeof variants / sizeof *variants; ++i) {
            /* matrices do not depend on the technique: two are enough */
            if (kind >= SPOT_BY_MATRIX && variants[i].technique != SPS_TMAP_COMPRESSED) continue;
            fixture_begin(&f, &variants[i], (light_kind)kind);
            f.light.border = kind < SIX_FACES && i % 3 == 1 ? 2 : 0;
            sps_tmap *map = fixture_build(&f, context);
            if (map) check_map(variants[i].name, &f, map);
            sps_tmap_destroy(map);
        }
    sps_destroy(context);
}

/* Nothing opaque: no surfaces are passed. */
static void test_gas_alone(void) {
    static fixture f;
    sps_context *context = sps_create(NULL, NULL);
    fixture_begin(&f, variant_of("opacity"), SPOT);
    f.scene.mesh_count = 0;
    sps_tmap *map = fixture_build(&f, context);
    if (CHECK(map != NULL && sps_tmap_surfaces(map) == NULL)) check_map("gas alone", &f, map);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------- other claims of the page */

/* Uniformly distributed over a map of one face. */
static tmap_place random_place(check_random *random) {
    tmap_place p;
    p.face = 0, p.distance = 0, p.u = (float)check_next(random);
    p.x = (float)((WIDTH - 1) * check_next(random)), p.y = (float)((HEIGHT - 1) * check_next(random));
    return p;
}

/* Interpolates numbers of four texels, `stride` apart, as a texture's bilinear filter does. */
static double filtered_of(tmap_place p, const float *list, int stride) {
    double sum = 0;
    for (int i = 0; i < 4; ++i) {
        const int x = (int)floorf(p.x) + i % 2, y = (int)floorf(p.y) + i / 2;
        const int texel =
            tmap_clamp_int(y, 0, tmap_bound.height - 1) * tmap_bound.width + tmap_clamp_int(x, 0, tmap_bound.width - 1);
        sum += overlap((double)p.x, x) * overlap((double)p.y, y) * (double)list[texel * stride];
    }
    return sum;
}

static double filtered(tmap_place p, int component) {
    return filtered_of(p, texels + component, tmap_bound.components);
}

/* Even planes in a 3D texture of n slices, whose centres are at (i + 0.5) / n. */
static double filtered_opacity(tmap_place p) {
    const int n = tmap_bound.components;
    const double u = (double)p.u, slice = n * (fmax(u, 1.0 / n) - 0.5 / n) - 0.5;
    const int below = tmap_clamp_int((int)floor(slice), 0, n - 1), above = tmap_clamp_int(below + 1, 0, n - 1);
    const double t = slice - below;
    return fmin(n * u, 1) * ((1 - t) * filtered(p, below) + t * filtered(p, above));
}

static double filtered_fourier(tmap_place p) {
    float mixed[17];
    for (int k = 0; k < tmap_bound.components; ++k) mixed[k] = (float)filtered(p, k);
    const float *kept = texels;
    bind_texels(mixed);
    const double depth = (double)tmap_fourier_depth(tmap_bound, 0, tmap_bound.components, p.u);
    bind_texels(kept);
    return depth;
}

/* The shortcuts agree with the results of four texels: floats of up to 40, sums of 7. For a Fourier map this requires
   that none of the four series is clamped, which is the case for most. */
static void test_shortcuts(void) {
    static fixture f;
    for (int fourier = 0; fourier < 2; ++fourier) {
        sps_context *context = sps_create(NULL, NULL);
        check_random random = {21};
        int uncut = 0;
        fixture_begin(&f, variant_of(fourier ? "Fourier" : "opacity"), SUN);
        f.scene.mesh_count = 0;
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        hand_over(map, &f);
        for (int i = 0; i < POINTS; ++i) {
            const tmap_place p = random_place(&random);
            const double front = fronts ? filtered_of(p, fronts, 1) : 0;
            const double through = exp(-front - (fourier ? filtered_fourier(p) : filtered_opacity(p)));
            const int near_by = fabs(through - (double)tmap_transmittance(tmap_bound, p)) < 2e-5;
            uncut += near_by;
            if (!fourier) CHECK(near_by);
        }
        CHECK(uncut > POINTS / 2);
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* An interval's contribution to a texel of a technique by section 5 of the page, as floats. `made`: the texel, whose
   range is that of the interval if its extinction is constant, else narrower. */
static void insert_as_told(double u0, double u1, double depth, int soft, const float *made, double *out) {
    const int technique = tmap_bound.technique_id, n = tmap_bound.components - 2 * tmap_bound.has_range;
    if (tmap_bound.has_range) { /* from now on u counts between these */
        const double first = soft ? (double)made[0] : u0, last = soft ? (double)made[1] : u1;
        CHECK(first > u0 - 1e-6 && first < u0 + 0.15 * (u1 - u0) && last < u1 + 1e-6 && last > u1 - 0.15 * (u1 - u0));
        out[0] = first, out[1] = last, out += 2;
        u0 = (u0 - first) / (last - first), u1 = (u1 - first) / (last - first);
    }
    const double pi = 3.14159265358979323846, m = 0.5 * (u0 + u1), e = 0.5 * (u1 - u0);
    const double z = 2 * m - 1, h = 2 * e;
    for (int i = 0; i < n && technique != SPS_TMAP_FOURIER && technique != SPS_TMAP_MOMENT; ++i) {
        const double s = i == n - 1 ? 1 : fmin(fmax(((i + 1.0) / n - u0) / (u1 - u0), 0), 1); /* the last has all */
        out[i] = depth * (soft ? s * s * (3 - 2 * s) : s);
    }
    for (int k = 0; 2 * k < n && technique == SPS_TMAP_FOURIER; ++k) {
        const double x = 2 * pi * k * e;
        const double d = k == 0 ? 1 : soft ? 3 * (sin(x) - x * cos(x)) / (x * x * x) : sin(x) / x;
        if (k > 0) out[2 * k - 1] = 2 * depth * cos(2 * pi * k * m) * d;
        out[2 * k] = 2 * depth * sin(2 * pi * k * m) * d;
        if (k == 0) out[0] = 2 * depth;
    }
    if (technique != SPS_TMAP_MOMENT) return;
    out[0] = depth, out[1] = z, out[2] = z * z + h * h / 3, out[3] = z * z * z + z * h * h;
    out[4] = pow(z, 4) + 2 * z * z * h * h + pow(h, 4) / 5;
    for (int k = 1; k < n; ++k) /* the other formula agrees */
        CHECK_NEAR((pow(z + h, k + 1) - pow(z - h, k + 1)) / ((k + 1) * 2 * h), out[k], 1e-12);
}

/* One particle in front of one light, with each texel's chord computed by hand. u0 and u1 are floats, accurate to 3e-8,
   and the shortest chord used is 1/37 of the depth: 2e-6 for quotients by its length, 1e-5 with the library's own
   round-off of chords. */
static void test_insertion(void) {
    static const char *const names[] = {"opacity", "deep opacity", "Fourier", "Fourier, range", "4 moments", "Beer"};
    static fixture f;
    sps_particle ball;
    sps_context *context = sps_create(NULL, NULL);
    for (int i = 0; i < 12; ++i) {
        const int soft = i >= 6;
        const variant *v = variant_of(names[i % 6]);
        if (soft && (v->technique == SPS_TMAP_MOMENT || v->texel_range))
            continue; /* the page has moments of uniform intervals, and series of uncut ones */
        fixture_begin(&f, v, SUN);
        memset(&ball, 0, sizeof ball);
        ball.position[0] = 0.3f, ball.position[1] = -0.2f, ball.position[2] = 0.4f;
        ball.radius = 2, ball.optical_depth = 2;
        f.sets[soft].user = &ball, f.sets[soft].count = 1, f.sets[!soft].count = 0;
        f.scene.mesh_count = 0;
        check_set3(f.light.camera.target, 0.3, -0.2, 0);
        check_set3(f.light.camera.up, 0, 1, 0);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        hand_over(map, &f);
        for (int texel = 0; texel < WIDTH * HEIGHT; ++texel) {
            const double x = (texel % WIDTH - 0.5 * (WIDTH - 1)) * 6 / (double)HEIGHT;
            const double y = (texel / WIDTH - 0.5 * (HEIGHT - 1)) * 6 / (double)HEIGHT, square = 4 - x * x - y * y;
            const double half = sqrt(fmax(square, 0)), middle = 9 - 0.4, range = 13 - 5.5;
            double told[11];
            if (half < 0.1) continue;
            insert_as_told((middle - half - 5.5) / range, (middle + half - 5.5) / range,
                           2 * (soft ? pow(half / 2, 3) : half / 2), soft,
                           texels + (size_t)texel * (size_t)tmap_bound.components, told);
            for (int k = 0; k < tmap_bound.components; ++k)
                if (!CHECK_NEAR((double)texels[texel * tmap_bound.components + k], told[k],
                                1e-5 * fmax(fabs(told[k]), 1)))
                    printf("    %s, float %d\n", v->name, k);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A ball's half chords, in radii, summed over the centres of texels, relative to what they integrate to: 2/3 pi r^2, or
   2/5 pi r^2 where the ball is soft. Its centre is at x, y, from 0 to 1. */
static double sum_of_chords(double radius, int soft, double x, double y) {
    double sum = 0;
    for (int i = -1; i <= 2; ++i)
        for (int j = -1; j <= 2; ++j) {
            const double square = 1 - ((i - x) * (i - x) + (j - y) * (j - y)) / (radius * radius);
            if (square > 0) sum += soft ? pow(square, 1.5) : sqrt(square);
        }
    return sum / (3.14159265358979323846 * radius * radius * (soft ? 2 / 5.0 : 2 / 3.0));
}

/* How far point samples of small particles are off, as the page has it. */
static void test_small_sums(void) {
    char *page = read_text("docs/shadow_maps.md"), said[64];
    double least = HUGE_VAL, most = 0;
    for (int n = 0; n < 2 * 26; ++n)
        for (int i = 0; i < 101 * 101; ++i) {
            const double sum = sum_of_chords(0.75 + 0.01 * (n / 2), n % 2, i % 101 / 200.0, i / 101 / 200.0);
            least = fmin(least, sum), most = fmax(most, sum);
        }
    snprintf(said, sizeof said, "the sum is %.2f to %.2f of the right one", least, most);
    if (!CHECK(page && strstr(page, said))) printf("    %s\n", said);
    free(page);
}

/* --------------------------------------------------------------------------------------------------- half precision */

/* Rounds to 11 bits, to even, as storing in half precision does; larger numbers become the maximum. */
static float half_of(float x) {
    int exponent;
    frexp((double)x, &exponent);
    const double step = ldexp(1, exponent > -13 ? exponent - 11 : -24);
    return (float)fmin(fmax(nearbyint((double)x / step) * step, -65504), 65504);
}

/* The scene's gas alone, its optical depths times `factor`. */
static sps_tmap *build_gas(fixture *f, const variant *v, double factor, sps_context *context) {
    fixture_begin(f, v, SUN);
    f->scene.mesh_count = 0;
    for (int i = 0; i < EVEN; ++i) f->even[i].optical_depth *= (float)factor;
    for (int i = 0; i < SOFT; ++i) f->soft[i].optical_depth *= (float)factor;
    return fixture_build(f, context);
}

/* The optical depth of the scene's densest texel. */
static double greatest_depth(sps_context *context) {
    static fixture f;
    double greatest = 0;
    sps_tmap *map = build_gas(&f, variant_of("opacity, one plane"), 1, context);
    for (int i = 0; i < WIDTH * HEIGHT && map; ++i) greatest = fmax(greatest, (double)sps_tmap_texels(map)[i]);
    sps_tmap_destroy(map);
    return greatest;
}

/* The largest change of transmittance when the bound map's texels are rounded to half precision. */
static double change_in_halves(void) {
    static float rounded[WIDTH * HEIGHT * 17];
    const float *kept = texels;
    check_random random = {9};
    double most = 0;
    const int compressed = tmap_bound.technique_id == (int)SPS_TMAP_COMPRESSED; /* two floats per node */
    const int floats = compressed ? 2 * (int)starts[WIDTH * HEIGHT] : WIDTH * HEIGHT * tmap_bound.components;
    for (int i = 0; i < floats; ++i) rounded[i] = half_of(texels[i]);
    for (int i = 0; i < 20 * POINTS; ++i) {
        const tmap_place p = random_place(&random);
        bind_texels(kept);
        const double exact = (double)tmap_transmittance(tmap_bound, p);
        bind_texels(rounded);
        most = fmax(most, fabs((double)tmap_transmittance(tmap_bound, p) - exact));
    }
    return most;
}

/* The bounds that docs/shadow_maps.md has for each technique, where optical depths reach 3, 12 and 50. */
static void test_half(void) {
    static const double reach[3] = {3, 12, 50};
    static const struct {
        const char *name;
        double most[3];
        int fails; /* 1: the change is larger than that */
    } rows[] = {{"opacity", {5e-4, 5e-4, 5e-4}, 0},
                {"opacity, cubic", {5e-4, 5e-4, 5e-4}, 0},
                {"Fourier", {1e-3, 5e-3, 1e-2}, 0},
                {"Fourier, 8 harmonics", {1e-3, 5e-3, 1e-2}, 0},
                {"Beer", {1e-3, 5e-3, 1e-2}, 0},
                {"deep opacity", {2e-3, 5e-3, 2e-2}, 0},
                {"compressed, 8 nodes", {1e-3, 5e-3, 0.5}, 0},
                {"4 moments", {0.005, 0.02, 0.02}, 1},
                {"6 moments", {0.02, 0.02, 0.02}, 1}};
    static fixture f;
    sps_context *context = sps_create(NULL, NULL);
    const double unit = greatest_depth(context);
    for (size_t row = 0; row < sizeof rows / sizeof *rows; ++row)
        for (int i = 0; i < 3; ++i) {
            if (!check_long() && ((int)row + i) % 3) continue;
            sps_tmap *map = build_gas(&f, variant_of(rows[row].name), reach[i] / unit, context);
            if (!CHECK(map != NULL)) continue;
            hand_over(map, &f);
            const double change = change_in_halves();
            const int good = rows[row].fails ? CHECK(change > rows[row].most[i])
                                             : CHECK_CASE("Found in review", "maps in halves, optical depths up to 50",
                                                          "change of transmittance", change, rows[row].most[i],
                                                          "the bounds that docs/shadow_maps.md has");
            if (!good || figures())
                printf("    in halves, optical depth %g: %s %.2g\n", reach[i], rows[row].name, change);
            sps_tmap_destroy(map);
        }
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------- errors quoted from maps.md */

enum { SCENES = 6 };

/* One row of a table of errors: its name, its errors, and which of these are bold. Returns 0 after the last row. */
static int read_row(const char *row, char name[32], double errors[SCENES], int bold[SCENES]) {
    if (sscanf(row, "| %31[^|]|", name) != 1) return 0;
    name[strlen(name) - 1] = 0; /* the space before the bar */
    for (int i = 0; i < SCENES; ++i) {
        row = strchr(row + 1, '|');
        bold[i] = row[2] == '*';
        errors[i] = strtod(row + (bold[i] ? 4 : 1), NULL);
    }
    return 1;
}

/* The first row of the table of errors with 8 floats. */
static const char *find_rows(const char *page) {
    const char *table = page ? strstr(page, "| with 8 floats | puff | wind | clumps | shell | core | ball |") : NULL;
    return table ? strchr(strchr(table, '\n') + 1, '\n') + 1 : NULL;
}

/* The table of errors of shadow_maps.md is that of maps.md, and the smallest error of each scene is bold. */
static void test_quotes(void) {
    char *page = read_text("docs/shadow_maps.md"), *maps = read_text("docs/maps.md"), name[32], named[32];
    const char *row = find_rows(page), *exact = find_rows(maps);
    double errors[SCENES], measured[SCENES], least[SCENES] = {1, 1, 1, 1, 1, 1},
                                             least_bold[SCENES] = {1, 1, 1, 1, 1, 1};
    int bold[SCENES], none[SCENES], rows = 0, bolds = 0;
    if (CHECK(row && exact)) {
        for (; read_row(row, name, errors, bold);
             row = strchr(row, '\n') + 1, exact = strchr(exact, '\n') + 1, ++rows) {
            if (!CHECK(read_row(exact, named, measured, none) && strcmp(name, named) == 0)) break;
            for (int i = 0; i < SCENES; ++i) {
                if (!CHECK(errors[i] == measured[i])) printf("    %s, scene %d\n", name, i);
                least[i] = fmin(least[i], errors[i]);
                if (bold[i]) least_bold[i] = errors[i], ++bolds;
            }
        }
        CHECK(rows == 8 && bolds == SCENES);
        for (int i = 0; i < SCENES; ++i) CHECK(least_bold[i] == least[i]);
    }
    free(page), free(maps);
}

int main(void) {
    RUN(test_quotes);
    RUN(test_techniques);
    RUN(test_gas_alone);
    RUN(test_shortcuts);
    RUN(test_insertion);
    RUN(test_small_sums);
    RUN(test_half);
    return check_report();
}
