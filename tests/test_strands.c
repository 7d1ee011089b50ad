/* Strands as occluders of transmittance maps: their total optical depth at any width, angle and place, their edges,
   bends and depths, in all techniques and views; and what is refused. Sums are exact but for floats: a texel's share is
   off by a few roundings of edges up to 64 texels away, 4e-6 each, at random. Over a texel of a strand .05 wide, 4e-5;
   TOTAL allows ten times that. */

#include "check.h"

#define TOTAL 4e-4

enum { SIDE = 64, MOST = 20000 };

typedef struct strands {
    sps_strands set;
    sps_scene scene;
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_strand_point points[MOST];
    long calls, fail_at;
} strands;

static int read_points(void *user, size_t first, size_t count, sps_strand_point *out) {
    strands *s = (strands *)user;
    for (size_t i = 0; i < count; ++i) CHECK(out[i].begins == 0 && out[i].width == 0); /* zeroed */
    memcpy(out, s->points + first, count * sizeof *out);
    return ++s->calls == s->fail_at ? 7 : 0;
}

/* Light from (0, 0, 10) along -z; texels of size 1 in the plane z = 0, whose centres are half numbers. */
static void begin(strands *s, int technique) {
    memset(s, 0, sizeof *s);
    s->set.read_fn = read_points, s->set.user = s;
    s->scene.strands = &s->set, s->scene.strand_set_count = 1;
    s->light.width = s->light.height = SIDE;
    check_set3(s->light.camera.position, 0, 0, 10), s->light.camera.up[1] = 1;
    s->light.camera.ortho_height = SIDE;
    s->settings.technique = (sps_tmap_technique)technique, s->settings.far_depth = 20;
    s->settings.epsilon = technique == SPS_TMAP_COMPRESSED ? 1e-6f : 0;
}

static void add(strands *s, double x, double y, double z, double width, double depth) {
    sps_strand_point *p = &s->points[s->set.point_count++];
    p->position[0] = (float)x, p->position[1] = (float)y, p->position[2] = (float)z;
    p->width = (float)width, p->optical_depth = (float)depth;
}

static sps_tmap *build(strands *s, sps_context *context) {
    sps_tmap *map = NULL;
    if (sps_tmap_create(context, &s->light, &s->settings, &map) != SPS_OK) return NULL;
    if (sps_tmap_add(map, &s->scene) == SPS_OK && sps_tmap_finish(map) == SPS_OK) return map;
    sps_tmap_destroy(map);
    return NULL;
}

static sps_tmap *must_build(strands *s, sps_context *context) {
    sps_tmap *map = build(s, context);
    if (!CHECK(map != NULL)) printf("    technique %d: %s\n", (int)s->settings.technique, sps_error(context));
    return map;
}

static double query(const sps_tmap *map, double x, double y, double z) {
    const double at[3] = {x, y, z};
    float depth = -1;
    CHECK(sps_tmap_query(map, 1, at, &depth, NULL) == SPS_OK);
    return (double)depth;
}

/* Sum over all texels of the optical depth behind everything. */
static double total(const sps_tmap *map) {
    double sum = 0;
    for (size_t i = 0; i < spsi_light_grid_texels(&map->grid); ++i) sum += spsi_tmap_texel_depth(map, i, 1);
    return sum;
}

static void tangle(strands *s, int count, uint64_t seed) {
    check_random random = {seed};
    for (int i = 0; i < count; ++i) {
        double at[3];
        for (int k = 0; k < 3; ++k) at[k] = 60 * check_next(&random) - 30;
        const double width = 0.05 + 0.4 * check_next(&random);
        for (int k = 0; k < 2; ++k) {
            s->points[s->set.point_count].begins = k == 0;
            add(s, at[0] + k * (8 * check_next(&random) - 4), at[1] + k * (8 * check_next(&random) - 4),
                0.3 * at[2] + k, width, 0.04);
        }
    }
}

/* ----------------------------------------------------------------------------------------------------------- totals */

/* Two segments with a bend, at all widths, angles and places within a texel, in every technique. */
static void test_totals(void) {
    static const double widths[] = {0.05, 0.3, 1, 2.7, 20};
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    double worst = 0;
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique)
        for (int n = 0; n < 5 * 9 * 5; ++n) {
            const double width = widths[n % 5], angle = n / 5 % 9 * SPSI_PI / 8, place = n / 45 * 0.21;
            if (technique != SPS_TMAP_OPACITY && n % 7 != technique % 7) continue;
            begin(&s, technique);
            add(&s, place - 10 * cos(angle), 2 * place - 10 * sin(angle), 1, width, 0.5);
            add(&s, place, 2 * place, 0, width, 0.5);
            add(&s, place + 10 * cos(angle + 0.7), 2 * place + 10 * sin(angle + 0.7), -2, width, 0.5);
            sps_tmap *map = must_build(&s, context);
            const double off = fabs(total(map) / (0.5 * 20 * width) - 1);
            worst = fmax(worst, off);
            if (!CHECK(off < TOTAL)) printf("    technique %d, width %g, angle %g: %g\n", technique, width, angle, off);
            sps_tmap_destroy(map);
        }
    if (figures()) printf("total optical depth within %.2g\n", worst);
    CHECK_CASE("Found in review", "strands .05 to 20 texels wide at any angle and place, bent", "total optical depth",
               worst, TOTAL, "floats");
    sps_destroy(context);
}

/* Sharp turns, doubled points, tapered ends and depths that differ: half a turn back covers all twice. */
static void test_shapes(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    begin(&s, SPS_TMAP_OPACITY);
    for (int i = 0; i < 12; ++i) add(&s, i % 2 ? 6.3 : -5.9, -8 + i * 1.1, 0, 5, 0.25);
    sps_tmap *map = must_build(&s, context);
    CHECK_NEAR(total(map), 0.25 * 5 * 11 * sqrt(12.2 * 12.2 + 1.1 * 1.1), TOTAL * 800);
    sps_tmap_destroy(map);
    begin(&s, SPS_TMAP_DEEP);
    add(&s, -7.3, 1, 0, 3, 0.2), add(&s, 2, 1, 0, 1, 0.6), add(&s, 2, 1, 0, 1, 0.6), add(&s, 2, 1.25, 0, 0, 0.6);
    map = must_build(&s, context);
    CHECK_NEAR(total(map), 0.4 * 2 * 9.3 + 0.6 * 0.5 * 0.25, TOTAL * 8);
    sps_tmap_destroy(map);
    begin(&s, SPS_TMAP_DEEP); /* as many short and wide segments, whose mitres would reach beyond them */
    for (int i = 0; i < 40; ++i) add(&s, 0.3 * i - 6, 0.2 * sin(2.0 * i), 0, 9, 0.1);
    map = must_build(&s, context);
    double length = 0;
    for (int i = 0; i < 39; ++i) length += hypot(0.3, 0.2 * (sin(2.0 * i + 2) - sin(2.0 * i)));
    CHECK_NEAR(total(map) / (0.1 * 9 * length), 1, TOTAL);
    sps_tmap_destroy(map);
    begin(&s, SPS_TMAP_DEEP); /* end-on, single, of no width or depth: nothing, and no error */
    add(&s, 0, 0, 5, 1, 1), add(&s, 0, 0, -5, 1, 1);
    add(&s, 3, 3, 0, 1, 1), s.points[2].begins = 1;
    add(&s, 9, 3, 0, 0, 1), s.points[3].begins = 1, add(&s, 9, 9, 0, 0, 1);
    add(&s, 9, 3, 0, 1, 0), s.points[5].begins = -3, add(&s, 9, 9, 0, 1, 0);
    map = must_build(&s, context);
    CHECK(total(map) == 0 && spsi_tmap_item_count(map) == 0);
    sps_tmap_destroy(map);
    begin(&s, SPS_TMAP_DEEP); /* no points, and no set */
    map = must_build(&s, context);
    CHECK(total(map) == 0);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* A ribbon 8.5 wide: opacity within, by share of the texel at its edges, nothing outside; it shadows what is behind. */
static void test_ribbon(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique) {
        begin(&s, technique);
        const double depth = -log1p(-0.4);
        add(&s, 0.25, -20, 0.7, 8.5, depth), add(&s, 0.25, 20, 0.7, 8.5, depth);
        sps_tmap *map = must_build(&s, context);
        for (int x = -8; x < 8; ++x) {
            const double share = x == -4 ? 1 : x > -4 && x < 4 ? 1 : x == 4 ? 0.5 : 0;
            if (!CHECK_NEAR(query(map, x + 0.5, 3.5, -10), share * depth, 1e-5)) printf("    at %d\n", x);
        }
        CHECK_NEAR(exp(-query(map, 0.5, 3.5, -10)), 1 - 0.4, 1e-5);
        CHECK_NEAR(query(map, 0.5, 19.5, -10) + query(map, 0.5, 20.5, -10), depth, 1e-5);
        CHECK(query(map, 0.5, 22.5, -10) == 0);
        const int steps = technique == SPS_TMAP_OPACITY || technique == SPS_TMAP_FOURIER ? 8 : 0;
        if (technique != SPS_TMAP_MOMENT && technique != SPS_TMAP_FOURIER)
            CHECK_NEAR(query(map, 0.5, 3.5, 0.8 + 20.0 / 8 * (steps > 0)), 0, 1e-5);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* An arc 6 wide, of 5 degrees a segment: everything that lies wholly within has the depth, once. */
static void test_bends(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    begin(&s, SPS_TMAP_DEEP);
    for (int i = 0; i < 37; ++i) add(&s, 15 * cos(i * SPSI_PI / 36), 15 * sin(i * SPSI_PI / 36) - 7, 0, 6, 0.5);
    sps_tmap *map = must_build(&s, context);
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x) {
            const double u = x + 0.5 - SIDE / 2, v = y + 0.5 - SIDE / 2, r = hypot(u, v + 7);
            const double depth = query(map, u, v, -10);
            /* half a texel's diagonal is .71, and chords lie within .02 of the arc */
            if (fabs(r - 15) < 3 - 0.73 && v > -6.2) CHECK_NEAR(depth, 0.5, 1e-5);
            CHECK(depth < 0.5 * (1 + 1e-5) && (depth == 0 || fabs(r - 15) < 3.73));
        }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------ depths and views */

/* A slope: light stops where a texel's ray meets the plane of the ribbon, in perspective too; none of it before. The
   map's far_depth is 20, so that floats place it to 2e-6. */
static void test_depths(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < 3; ++way) {
        begin(&s, SPS_TMAP_DEEP);
        if (way) s.light.camera.ortho_height = 0, s.light.camera.field_of_view = 2 * atan(3.2);
        s.light.omnidirectional = way == 2;
        add(&s, -12, 0, 5, 6, 0.3), add(&s, 12, 0, -5, 6, 0.3);
        sps_tmap *map = must_build(&s, context);
        const spsi_rays *rays = &map->grid.rays[way == 2 ? 5 : 0];
        for (int x = SIDE / 2 - 5; x < SIDE / 2 + 6; ++x) {
            double from[3], ray[3], at[3];
            memcpy(from, rays->origin, sizeof from);
            spsi_ray_direction(rays, x, SIDE / 2, ray);
            if (way == 0) spsi_along(from, rays->a, x, from), spsi_along(from, rays->b, SIDE / 2, from);
            if (way == 0) memcpy(ray, rays->c, sizeof ray);
            const double t = -(from[2] + 5.0 / 12 * from[0]) / (ray[2] + 5.0 / 12 * ray[0]);
            spsi_along(from, ray, t * (1 - 1e-5), at);
            CHECK(query(map, at[0], at[1], at[2]) < 1e-6);
            spsi_along(from, ray, t * (1 + 1e-5), at);
            if (!CHECK_NEAR(query(map, at[0], at[1], at[2]), 0.3, 1e-5)) printf("    way %d, texel %d\n", way, x);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A strand in the plane x-z, as its projection integrates: width / t across, by the length of (x / t). It passes beside
   the light and behind it; texels at the edges of a cube's faces count half, at corners a quarter. */
static void test_perspective(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < 3; ++way) {
        const double ends[2][2] = {{-9, way == 1 ? 14 : 4}, {7, -6}}, width = way == 2 ? 0.3 : 1.1;
        double sum = 0, area = 0;
        begin(&s, SPS_TMAP_OPACITY);
        s.settings.far_depth = 40;
        s.light.camera.ortho_height = 0, s.light.camera.field_of_view = 2 * atan(3.2);
        s.light.omnidirectional = way == 2;
        add(&s, ends[0][0], 0, ends[0][1], width, 0.3), add(&s, ends[1][0], 0, ends[1][1], width, 0.3);
        sps_tmap *map = must_build(&s, context);
        const int last = map->grid.rays[0].width - 1;
        for (size_t i = 0; i < spsi_light_grid_texels(&map->grid); ++i) {
            const int x = (int)(i % (size_t)(last + 1)), y = (int)(i / (size_t)(last + 1)) % (last + 1);
            const double part = (x == 0 || x == last ? 0.5 : 1) * (y == 0 || y == last ? 0.5 : 1);
            sum += spsi_tmap_texel_depth(map, i, 1) * (way == 2 ? part : 1);
        }
        const double scale = way == 2 ? last / 2.0 : SIDE / 6.4;
        for (int i = 0; i < 100000; ++i) {
            double ratio[2], far[2];
            for (int k = 0; k < 2; ++k) {
                const double x = ends[0][0] + (i + k) / 1e5 * (ends[1][0] - ends[0][0]);
                const double t = 10 - ends[0][1] - (i + k) / 1e5 * (ends[1][1] - ends[0][1]);
                far[k] = way == 2 ? fmax(fabs(x), t) : t; /* a cube's nearest axis */
                ratio[k] = (way == 2 && fabs(x) > t ? t : x) / far[k];
            }
            if (far[0] <= 0 || far[1] <= 0 || fabs(ratio[0]) > (way == 2 ? 1 : 3.2)) continue;
            if (fabs(ratio[1] - ratio[0]) > 1) continue; /* from one face to the next */
            area += scale * scale * fabs(ratio[1] - ratio[0]) * width * 0.5 * (1 / far[0] + 1 / far[1]);
        }
        if (figures()) printf("way %d: %.6g of %.6g\n", way, sum, 0.3 * area);
        CHECK_NEAR(sum / (0.3 * area), 1, way == 2 ? 0.02 : 0.005); /* the strand leaves the map within a texel */
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Along x, 15 aside at a distance of 10: seen at an angle, a ribbon that faces the light is wider by sqrt(1 + 1.5^2).
 */
static void test_aside(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    begin(&s, SPS_TMAP_DEEP);
    s.light.camera.ortho_height = 0, s.light.camera.field_of_view = 2 * atan(3.2);
    add(&s, -8, 15, 0, 1.3, 0.3), add(&s, 9, 15, 0, 1.3, 0.3);
    sps_tmap *map = must_build(&s, context);
    CHECK_NEAR(total(map) / (0.3 * 17 * 1.3 * sqrt(3.25)), 1, TOTAL);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* Balls before, between and after strands: optical depths add. */
static int read_balls(void *user, size_t first, size_t count, sps_particle *out) {
    (void)user, (void)first;
    for (size_t i = 0; i < count; ++i) {
        out[i].position[0] = 4 * (float)i - 6, out[i].position[2] = (float)i - 1;
        out[i].radius = 5, out[i].optical_depth = 0.3f;
    }
    return 0;
}

static void test_beside_particles(void) {
    static strands s;
    const sps_particles balls = {.count = 3, .read_fn = read_balls};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_OPACITY; ++technique) {
        sps_tmap *maps[3];
        for (int k = 0; k < 3; ++k) {
            begin(&s, technique);
            s.scene.particles = &balls, s.scene.particle_set_count = k != 1;
            if (k > 0) tangle(&s, 300, 9);
            maps[k] = must_build(&s, context);
        }
        for (int i = 0; i < 40; ++i) {
            const double x = 0.7 * i - 14.1, z = 0.5 * i - 10;
            const double sum = query(maps[0], x, 0.3, z) + query(maps[1], x, 0.3, z);
            CHECK_NEAR(query(maps[2], x, 0.3, z), sum, 2e-5);
        }
        const double both = total(maps[0]) + total(maps[1]);
        CHECK_NEAR(total(maps[2]) / both, 1, 1e-5);
        for (int k = 0; k < 3; ++k) sps_tmap_destroy(maps[k]);
    }
    sps_destroy(context);
}

/* Before near_depth it counts in full: apart, and for lists at u = 0. Behind far_depth it counts there. */
static void test_fronts(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique) {
        begin(&s, technique);
        s.settings.near_depth = 8, s.settings.far_depth = 12;
        add(&s, -9, 0.5, 7, 3, 0.25), add(&s, 9, 0.5, 7, 3, 0.25);
        add(&s, -9, 0.5, -7, 3, 0.5), s.points[2].begins = 1, add(&s, 9, 0.5, -7, 3, 0.5);
        sps_tmap *map = must_build(&s, context);
        CHECK(technique <= SPS_TMAP_COMPRESSED || sps_tmap_fronts(map) != NULL);
        CHECK_NEAR(query(map, 0.5, 0.5, 1.9999), 0.25, technique == SPS_TMAP_FOURIER ? 0.3 : 1e-3);
        CHECK_NEAR(query(map, 0.5, 0.5, -7), 0.75, 1e-4);
        sps_tmap_destroy(map);
        s.set.point_count = 2, s.settings.near_depth = 1;
        map = must_build(&s, context);
        CHECK(sps_tmap_fronts(map) == NULL);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------- many, and workers
 */

/* 10^4 strands against a count of those that each of 2000 rays meets. The rays' mean is the map's, whose texels blur
   it: a ray meets some 7 strands, so a mean of 2000 counts is off by 1 / sqrt(7 * 2000), .9 %; 4 times that. */
static void test_many(void) {
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    check_random random = {3};
    double counted = 0, mapped = 0;
    begin(&s, SPS_TMAP_OPACITY);
    tangle(&s, MOST / 2, 11);
    sps_tmap *map = must_build(&s, context);
    for (int n = 0; n < 2000; ++n) {
        const double x = 50 * check_next(&random) - 25, y = 50 * check_next(&random) - 25;
        mapped += query(map, x, y, -10);
        for (int i = 0; i < MOST; i += 2) {
            const float *a = s.points[i].position, *b = s.points[i + 1].position;
            const double dx = (double)(b[0] - a[0]), dy = (double)(b[1] - a[1]), square = dx * dx + dy * dy;
            const double px = x - (double)a[0], py = y - (double)a[1], along = px * dx + py * dy;
            const double across = fabs(px * dy - py * dx);
            if (along > 0 && along < square && 2 * across < (double)s.points[i].width * sqrt(square)) counted += 0.04;
        }
    }
    if (figures()) printf("10^4 strands: rays meet %.4g, map %.4g\n", counted / 2000, mapped / 2000);
    CHECK_NEAR(mapped / counted, 1, 0.036);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

static void test_workers(void) {
    static const int techniques[] = {SPS_TMAP_DEEP, SPS_TMAP_COMPRESSED, SPS_TMAP_DEEP_OPACITY, SPS_TMAP_FOURIER};
    static strands s;
    for (int n = 0; n < 4; ++n) {
        sps_tmap *maps[3];
        sps_context *contexts[3];
        sps_tmap_info info[3];
        check_hooks hooks[3];
        memset(hooks, 0, sizeof hooks);
        for (int k = 0; k < 3; ++k) {
            static const int workers[3] = {1, 2, 7};
            hooks[k].worker_count = workers[k], hooks[k].order = (uint64_t)k;
            contexts[k] = check_context(&hooks[k]);
            begin(&s, techniques[n]);
            s.settings.epsilon = 0;
            s.light.width = s.light.height = 130; /* of several tiles */
            tangle(&s, 500, 5);
            maps[k] = must_build(&s, contexts[k]);
            CHECK(sps_tmap_get_info(maps[k], &info[k]) == SPS_OK && info[k].float_count == info[0].float_count);
            CHECK(memcmp(sps_tmap_texels(maps[k]), sps_tmap_texels(maps[0]), info[0].float_count * sizeof(float)) == 0);
            if (k < 1) continue;
            sps_tmap_destroy(maps[k]);
            sps_destroy(contexts[k]);
        }
        sps_tmap_destroy(maps[0]);
        sps_destroy(contexts[0]);
    }
}

/* ----------------------------------------------------------------------------------------------------------- errors */

static void refused(sps_context *context, sps_result got, sps_result result, sps_object object, const char *field,
                    const char *text) {
    sps_error_info info;
    sps_get_error(context, &info);
    if (!CHECK(got == result && info.object == object && strcmp(info.field, field) == 0 &&
               strstr(info.sentence, text) && check_error_info(context, result)))
        printf("    %d, %d, \"%s\": %s\n", (int)got, (int)info.object, info.field, info.sentence);
}

/* Wrong points of a map, and the same ones left out. */
static void test_wrong_points(void) {
    static const struct {
        int field;
        float value;
        const char *name, *text;
    } wrong[] = {{0, (float)NAN, "point[5].position", "strands[1].point[5].position is nan"},
                 {2, 2e15f, "point[5].position", "within 1e15"},
                 {3, -1, "point[5].width", "0..1e15"},
                 {3, (float)NAN, "point[5].width", "nan"},
                 {4, -0.1f, "point[5].optical_depth", "0..1e18"},
                 {4, SPSI_INFINITY, "point[5].optical_depth", "inf"}}; /* an opacity of 1 */
    static strands s;
    sps_context *context = sps_create(NULL, NULL);
    for (size_t n = 0; n < sizeof wrong / sizeof *wrong; ++n) {
        sps_strands sets[2];
        begin(&s, SPS_TMAP_DEEP);
        for (int i = 0; i < 8; ++i) add(&s, i - 4, 0.5, 0, 1, 0.5);
        sps_strand_point *p = &s.points[5];
        if (wrong[n].field < 3) p->position[wrong[n].field] = wrong[n].value;
        if (wrong[n].field == 3) p->width = wrong[n].value;
        if (wrong[n].field == 4) p->optical_depth = wrong[n].value;
        memset(sets, 0, sizeof sets), sets[1] = s.set;
        s.scene.strands = sets, s.scene.strand_set_count = 2;
        CHECK(build(&s, context) == NULL);
        refused(context, SPS_ERROR_DATA, SPS_ERROR_DATA, SPS_OBJECT_STRANDS, wrong[n].name, wrong[n].text);
        s.scene.replace_invalid = 1;
        sps_tmap *map = must_build(&s, context);
        sps_stats_report stats;
        sps_get_stats(context, &stats);
        CHECK(stats.values_replaced == 1);
        CHECK_NEAR(total(map), 0.5 * 5, 1e-4); /* from 0 to 4 and from 6 to 7 */
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

static int cancel(void *user, float fraction) {
    (void)fraction;
    return --*(int *)user < 0;
}

/* A second passes between any two looks at it. */
static double passing(void *user) { return *(double *)user += 1; }

/* Fields, callbacks, counts, memory, a cancel; other calls, which do not take strands. */
static void test_errors(void) {
    static strands s;
    float rgba[4];
    const sps_image image = {rgba, NULL, 0};
    const sps_reference_settings brute = {.step = 1};
    sps_plan_report plan;
    sps_view view;
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *map;
    memset(&view, 0, sizeof view);
    view.width = view.height = 1, view.camera.position[2] = 9, view.camera.field_of_view = 1;
    begin(&s, SPS_TMAP_OPACITY), add(&s, 0, 0, 0, 1, 1), add(&s, 9, 0, 0, 1, 1);
    CHECK_OK(context, sps_tmap_create(context, &s.light, &s.settings, &map));
    s.set.start_canary = 1;
    refused(context, sps_tmap_add(map, &s.scene), SPS_ERROR_ARGUMENT, SPS_OBJECT_STRANDS, "start_canary", "strands[0]");
    s.set.start_canary = 0, s.set.end_canary = 1;
    refused(context, sps_tmap_add(map, &s.scene), SPS_ERROR_ARGUMENT, SPS_OBJECT_STRANDS, "end_canary", "zeroed");
    s.set.end_canary = 0, s.set.read_fn = NULL;
    refused(context, sps_tmap_add(map, &s.scene), SPS_ERROR_ARGUMENT, SPS_OBJECT_STRANDS, "read_fn", "NULL");
    s.set.read_fn = read_points, s.scene.strand_set_count = -1;
    refused(context, sps_tmap_add(map, &s.scene), SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, "strand_set_count", "-1");
    s.scene.strand_set_count = 1, s.scene.strands = NULL;
    refused(context, sps_tmap_add(map, &s.scene), SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, "strand_set_count", "strands");
    s.scene.strands = &s.set, s.set.point_count = ((size_t)1 << 29) + 1;
    CHECK_OK(context, sps_tmap_add(map, &s.scene));
    refused(context, sps_tmap_finish(map), SPS_ERROR_ARGUMENT, SPS_OBJECT_STRANDS, "point_count", "2^29");
    sps_tmap_destroy(map);
    s.set.point_count = 2, s.fail_at = 1, s.calls = 0;
    CHECK(build(&s, context) == NULL);
    refused(context, SPS_ERROR_CALLBACK, SPS_ERROR_CALLBACK, SPS_OBJECT_STRANDS, "read_fn", "returned 7");
    map = must_build(&s, context);
    refused(context, sps_tmap_update(map, NULL, &s.scene), SPS_ERROR_UNSUPPORTED, SPS_OBJECT_SCENE, "strand_set_count",
            "only particles");
    sps_tmap_destroy(map);
    refused(context, sps_render(context, &s.scene, &view, &image), SPS_ERROR_UNSUPPORTED, SPS_OBJECT_STRANDS,
            "point_count", "maps only");
    refused(context, sps_plan(context, &s.scene, &view, &plan), SPS_ERROR_UNSUPPORTED, SPS_OBJECT_STRANDS,
            "point_count", "maps only");
    refused(context, sps_reference(context, &s.scene, &view, &brute, &image), SPS_ERROR_UNSUPPORTED, SPS_OBJECT_STRANDS,
            "point_count", "maps only");
    s.set.point_count = 0;
    CHECK_OK(context, sps_render(context, &s.scene, &view, &image));
    sps_destroy(context);
}

/* Every allocation fails in turn, the memory limit does, and calls are cancelled at each turn; then it works. */
static void test_memory_and_cancel(void) {
    static strands s;
    int lasts = 1;
    begin(&s, SPS_TMAP_DEEP);
    tangle(&s, 5000, 4); /* three batches */
    for (long fail = 2; lasts; ++fail) {
        check_hooks hooks;
        memset(&hooks, 0, sizeof hooks);
        hooks.fail_at = fail;
        sps_context *context = check_context(&hooks);
        sps_tmap *map = build(&s, context);
        sps_error_info info;
        sps_get_error(context, &info);
        CHECK(map ? hooks.allocations < fail : info.result == SPS_ERROR_MEMORY);
        lasts = !map;
        sps_tmap_destroy(map);
        sps_destroy(context);
        CHECK(hooks.live == 0);
    }
    for (int turns = 0; turns < 6; ++turns) {
        sps_config config;
        int left = turns;
        double now = 0;
        memset(&config, 0, sizeof config);
        config.progress_fn = cancel, config.progress_user = &left;
        config.clock_fn = passing, config.clock_user = &now;
        config.memory_limit = turns == 5 ? 100000 : 0;
        if (turns == 5) config.progress_fn = NULL;
        sps_context *context = sps_create(&config, NULL);
        CHECK(build(&s, context) == NULL);
        sps_error_info info;
        sps_get_error(context, &info);
        CHECK(info.result == (turns == 5 ? SPS_ERROR_MEMORY : SPS_ERROR_CANCELLED));
        sps_destroy(context);
    }
}

/* ----------------------------------------------------------------------------------------------------------- figure */

static int read_small(void *user, size_t first, size_t count, sps_particle *out) {
    check_random random = {first + 1};
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) out[i].position[k] = (float)(500 * check_next(&random) - 250);
        out[i].radius = 0.5f, out[i].optical_depth = 0.01f;
    }
    return 0;
}

static int read_hairs(void *user, size_t first, size_t count, sps_strand_point *out) {
    check_random random = {first + 1};
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k)
            out[i].position[k] = i % 11 ? out[i - 1].position[k] + (float)(4 * check_next(&random) - 2)
                                        : (float)(500 * check_next(&random) - 250);
        out[i].width = 0.3f, out[i].optical_depth = 0.01f, out[i].begins = i % 11 == 0;
    }
    return 0;
}

/* The time of 10^6 segments of 2 texels beside 10^6 particles one texel wide; printed alone. */
static void print_time(void) {
    static strands s;
    const sps_particles small = {.count = 1000000, .read_fn = read_small};
    const sps_strands hairs = {.point_count = 1100000, .read_fn = read_hairs};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2; ++n) {
        begin(&s, SPS_TMAP_DEFAULT);
        s.light.width = s.light.height = 512, s.light.camera.ortho_height = 512;
        s.light.camera.position[2] = 260, s.settings.far_depth = 520;
        s.scene.particles = &small, s.scene.particle_set_count = !n, s.scene.strands = &hairs,
        s.scene.strand_set_count = n;
        const clock_t start = clock();
        sps_tmap_destroy(must_build(&s, context));
        printf("10^6 %s: %.2f s\n", n ? "segments" : "particles", (double)(clock() - start) / CLOCKS_PER_SEC);
    }
    sps_destroy(context);
}

int main(void) {
    RUN(test_totals);
    RUN(test_shapes);
    RUN(test_ribbon);
    RUN(test_bends);
    RUN(test_depths);
    RUN(test_perspective);
    RUN(test_aside);
    RUN(test_beside_particles);
    RUN(test_fronts);
    RUN(test_many);
    RUN(test_workers);
    RUN(test_wrong_points);
    RUN(test_errors);
    RUN(test_memory_and_cancel);
    if (figures()) print_time();
    return check_report();
}
