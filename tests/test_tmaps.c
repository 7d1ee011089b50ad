/* Transmittance maps: columns of particles against their chords summed in double precision, what each technique
   promises, and what may go wrong. */

#include "check.h"

enum { SIDE = 9, MANY = 200, MOST = MANY + 8 };

/* A light that looks along -z at a square of `SIDE` texels of size 1 about the origin; depth 0 is the plane z = 10. */
typedef struct fixture {
    sps_view light;
    sps_tmap_settings settings;
    sps_scene scene;
    sps_particles particles;
    sps_particle list[MOST];
    long calls, fail_at;
} fixture;

static int read_list(void *user, size_t first, size_t count, sps_particle *out) {
    fixture *f = (fixture *)user;
    memcpy(out, f->list + first, count * sizeof *out);
    return ++f->calls == f->fail_at ? 7 : 0;
}

static void fixture_begin(fixture *f, sps_tmap_technique technique, int components) {
    memset(f, 0, sizeof *f);
    f->light.width = f->light.height = SIDE;
    check_set3(f->light.position, 0, 0, 10);
    check_set3(f->light.up, 0, 1, 0);
    f->light.ortho_height = SIDE;
    f->settings.technique = technique;
    f->settings.components = components;
    f->settings.near_depth = 0, f->settings.far_depth = 20;
    f->particles.read_fn = read_list;
    f->particles.user = f;
}

static void fixture_add(fixture *f, double x, double y, double z, double radius, double depth) {
    sps_particle *p = &f->list[f->particles.count++];
    p->position[0] = (float)x, p->position[1] = (float)y, p->position[2] = (float)z;
    p->radius = (float)radius, p->optical_depth = (float)depth;
}

/* Particles that all lie well inside of the map and of its range of depths, none smaller than a texel. */
static void fixture_scatter(fixture *f, int count) {
    check_random random = {11};
    for (int i = 0; i < count; ++i)
        fixture_add(f, 6 * check_next(&random) - 3, 6 * check_next(&random) - 3, 12 * check_next(&random) - 6,
                    0.8 + check_next(&random), 0.2 * check_next(&random));
}

static sps_tmap *fixture_build(fixture *f, sps_context *context) {
    sps_tmap *map = NULL;
    if (sps_tmap_create(context, &f->light, &f->settings, &map) != SPS_OK) return NULL;
    f->scene.particles = &f->particles;
    f->scene.particles_count = 1;
    if (sps_tmap_add(map, &f->scene) == SPS_OK && sps_tmap_finish(map) == SPS_OK) return map;
    sps_tmap_destroy(map);
    return NULL;
}

static double query(const sps_tmap *map, double x, double y, double z) {
    const double position[3] = {x, y, z};
    float depth = -1;
    sps_tmap_query(map, 1, position, &depth, NULL);
    return (double)depth;
}

/* Optical depth along the column (x, y) from the light down to z. */
static double exact_depth(const fixture *f, double x, double y, double z) {
    double sum = 0;
    for (size_t i = 0; i < f->particles.count; ++i) {
        const sps_particle *p = &f->list[i];
        const double dx = x - (double)p->position[0], dy = y - (double)p->position[1], r = (double)p->radius;
        const double square = r * r - dx * dx - dy * dy, half = square > 0 ? sqrt(square) : 0;
        const double share = ((double)p->position[2] + half - z) / (2 * half);
        if (half > 0) sum += (double)p->optical_depth * half / r * fmin(fmax(share, 0), 1);
    }
    return sum;
}

/* ----------------------------------------------------------------------------------------------- exact answers */

/* Depths in the map are floats of 0..1, good to 6e-8; over a stretch of 1/10 of the range and more that is 6e-7 of its
   optical depth, and sums of up to 200 add up. Where a stretch is short, 1e-3 of its length is lost: 1e-4 of 0.2. */
static void test_deep(void) {
    fixture f;
    sps_context *context = sps_create(NULL);
    fixture_begin(&f, SPS_TMAP_DEEP, 0);
    fixture_add(&f, 0, 0, 1, 2, 3);
    sps_tmap *map = fixture_build(&f, context);
    if (CHECK(map != NULL)) {
        CHECK_NEAR(query(map, 0, 0, 3.5), 0, 0);
        CHECK_NEAR(query(map, 0, 0, 1), 1.5, 1e-5);
        CHECK_NEAR(query(map, 0, 0, -5), 3, 1e-6);
        CHECK_NEAR(query(map, 1, 0, -5), 3 * sqrt(3.0) / 2, 1e-6);
        CHECK_NEAR(query(map, 0.5, 0, -5), 0.5 * (3 + 3 * sqrt(3.0) / 2), 1e-6); /* between two texels */
        CHECK_NEAR(query(map, 30, 0, -5), 0, 0);
    }
    sps_tmap_destroy(map);
    for (int side = SIDE; side <= 45;
         side += 36) { /* a band of rows, or several; texels' centres are where both have them */
        fixture_begin(&f, SPS_TMAP_DEEP, 0);
        f.light.width = f.light.height = side;
        fixture_scatter(&f, MANY);
        map = fixture_build(&f, context);
        for (int i = 0; i < 600 && map; ++i) {
            const double x = i % 7 - 3, y = (i / 7 % 31 - 15) * (side == SIDE ? 0 : 0.2), z = 9 - 18.0 * i / 600;
            CHECK_NEAR(query(map, x, y, z), exact_depth(&f, x, y, z), 2e-4);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Exact at the planes, and between them within what the planes before and after say. */
static void test_opacity(void) {
    static const int planes[] = {1, 4, 16, 64};
    sps_context *context = sps_create(NULL);
    for (size_t k = 0; k < sizeof planes / sizeof *planes; ++k) {
        fixture f;
        fixture_begin(&f, SPS_TMAP_OPACITY, planes[k]);
        fixture_scatter(&f, MANY);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        for (int i = 0; i < 400; ++i) {
            const double x = i % 7 - 3, y = i / 7 % 7 - 3, u = (i + 0.5) / 400, step = 1.0 / planes[k];
            const double before = floor(u / step) * step, depth = query(map, x, y, 10 - 20 * u);
            CHECK(depth >= exact_depth(&f, x, y, 10 - 20 * before) - 2e-4);
            CHECK(depth <= exact_depth(&f, x, y, 10 - 20 * (before + step)) + 2e-4);
            CHECK_NEAR(query(map, x, y, 10 - 20 * (before + step)), exact_depth(&f, x, y, 10 - 20 * (before + step)),
                       2e-4);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The series of one stretch, written out: its integral up to u. */
static double fourier_of_one(double u0, double u1, double depth, int harmonics, double u) {
    const double pi = 3.14159265358979323846;
    double sum = depth * u;
    for (int k = 1; k <= harmonics; ++k) {
        const double w = 2 * pi * k, a = depth * 2 * (sin(w * u1) - sin(w * u0)) / (w * (u1 - u0));
        const double b = depth * 2 * (cos(w * u0) - cos(w * u1)) / (w * (u1 - u0));
        sum += (a * sin(w * u) + b * (1 - cos(w * u))) / w;
    }
    return fmin(fmax(sum, 0), depth);
}

/* One particle gives its series, everything is exact at the end, and the error falls with the number of harmonics: a
   chord's extinction jumps at both ends, so that optical depth's coefficients fall as 1 / k^2, and the squares of those
   left out as 1 / n^3, to an eighth at each doubling. Half is asked of the first doublings already. */
static void test_fourier(void) {
    static const int harmonics[] = {1, 2, 4, 8, 16, 32};
    sps_context *context = sps_create(NULL);
    double last = HUGE_VAL;
    for (size_t k = 0; k < sizeof harmonics / sizeof *harmonics; ++k) {
        fixture f;
        double sum = 0;
        fixture_begin(&f, SPS_TMAP_FOURIER, 1 + 2 * harmonics[k]);
        fixture_add(&f, 0, 0, 1, 2, 3);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        for (int i = 1; i < 100; ++i) /* floats of components up to 6, summed with 1 / k */
            CHECK_NEAR(query(map, 0, 0, 10 - 0.2 * i), fourier_of_one(7.0 / 20, 11.0 / 20, 3, harmonics[k], 0.01 * i),
                       5e-6);
        sps_tmap_destroy(map);
        f.particles.count = 0;
        fixture_scatter(&f, MANY);
        map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        for (int i = 0; i < 490; ++i) {
            const double x = i % 7 - 3, y = i / 7 % 7 - 3, z = 9 - 18 * i / 490.0;
            const double error = query(map, x, y, z) - exact_depth(&f, x, y, z);
            sum += error * error;
            if (i < 49) CHECK_NEAR(query(map, x, y, -10), exact_depth(&f, x, y, -10), 2e-4);
        }
        if (k > 0 && !CHECK(sum < 0.5 * last)) printf("    %d harmonics: %g after %g\n", harmonics[k], sum, last);
        last = sum;
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* One even stretch is exact, two clumps are one from the first's beginning to the second's end, and what lies behind is
   all of both. */
static void test_beer(void) {
    sps_context *context = sps_create(NULL);
    for (int clumps = 1; clumps <= 2; ++clumps) {
        fixture f;
        fixture_begin(&f, SPS_TMAP_BEER, 3);
        fixture_add(&f, 0, 0, 5, 1, 3);
        if (clumps == 2) fixture_add(&f, 0, 0, -3, 1, 1);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        for (int i = 0; i <= 100; ++i) {
            const double z = 10 - 0.2 * i, last = clumps == 1 ? 4 : -4;
            const double spread = (clumps == 1 ? 3 : 4) * fmin(fmax((6 - z) / (6 - last), 0), 1);
            CHECK_NEAR(query(map, 0, 0, z), spread, 1e-5);
        }
        CHECK_NEAR(query(map, 3, 0, -10), 0, 0); /* an empty texel */
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A spot: rays part, and depths run along the axis. The light inside of a particle sees what lies before it alone. */
static void test_perspective(void) {
    sps_context *context = sps_create(NULL);
    fixture f;
    fixture_begin(&f, SPS_TMAP_DEEP, 0);
    f.light.field_of_view = 1;
    fixture_add(&f, 0, 0, 2, 1, 2);
    sps_tmap *map = fixture_build(&f, context);
    if (CHECK(map != NULL)) {
        CHECK_NEAR(query(map, 0, 0, 2), 1, 1e-5);
        CHECK_NEAR(query(map, 0, 0, -5), 2, 1e-5);
        CHECK_NEAR(query(map, 0, 0, 12), 0, 0); /* behind the light */
    }
    sps_tmap_destroy(map);
    f.particles.count = 0;
    fixture_add(&f, 0, 0, 10, 2, 4);
    map = fixture_build(&f, context);
    if (CHECK(map != NULL)) CHECK_NEAR(query(map, 0, 0, 0), 2, 1e-5);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* A particle smaller than a texel is spread over a ball of 3/4 of a texel: wherever it lies, it meets a texel. What its
   chords at the texels' centres add up to, of 2/3 pi r^2 = 1.178, is least in a texel's middle, 1, and most between
   two, 2 sqrt(1 - 4/9) = 1.491: -15 % and +27 %. */
static void test_small_particles(void) {
    sps_context *context = sps_create(NULL);
    for (int i = 0; i < 9; ++i) {
        fixture f;
        double sum = 0;
        fixture_begin(&f, SPS_TMAP_OPACITY, 2);
        fixture_add(&f, 0.25 * (i % 3), 0.25 * (i / 3), 0, 0.01, 1000);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        for (int k = 0; k < SIDE * SIDE; ++k) sum += (double)sps_tmap_texels(map)[2 * k + 1];
        CHECK_NEAR(sum, 1000 * 0.01 * 0.01 * 2 / 3 * 3.14159265, 0.27 * 1000 * 0.01 * 0.01 * 2 / 3 * 3.14159265);
        CHECK(sum > 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------------- what is promised */

static int components_of(int technique) {
    static const int components[] = {0, 0, 1, 8, 8, 9, 8, 5, 16, 3};
    return components[technique];
}

/* The sampling code of docs/manual.md, for one texel. */
static float sample_opacity(const float *texel, int n, float u) {
    float at = u * (float)n;
    int plane = (int)at < n - 1 ? (int)at : n - 1;
    float before = plane > 0 ? texel[plane - 1] : 0;
    return before + (at - (float)plane) * (texel[plane] - before);
}

static float sample_fourier(const float *texel, int n, float u) {
    float sum = 0.5f * texel[0] * u;
    for (int k = 1; 2 * k < n; ++k) {
        float w = 6.28318531f * (float)k;
        sum += (texel[2 * k - 1] * sinf(w * u) + texel[2 * k] * (1 - cosf(w * u))) / w;
    }
    return fminf(fmaxf(sum, 0), 0.5f * texel[0]);
}

static float sample_beer(const float *texel, float u) { return fminf(fmaxf(u - texel[0], 0) * texel[1], texel[2]); }

static void test_texels(void) {
    sps_context *context = sps_create(NULL);
    for (int technique = SPS_TMAP_OPACITY; technique <= SPS_TMAP_BEER; ++technique) {
        const int n = components_of(technique);
        fixture f;
        fixture_begin(&f, (sps_tmap_technique)technique, n);
        fixture_scatter(&f, MANY);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL && sps_tmap_texels(map) != NULL)) continue;
        for (int i = 0; i < 300; ++i) {
            const int x = i % SIDE, y = i / SIDE % SIDE;
            const float u = ((float)i + 0.5f) / 300, *texel = sps_tmap_texels(map) + (y * SIDE + x) * n;
            const float sampled = technique == SPS_TMAP_BEER      ? sample_beer(texel, u)
                                  : technique == SPS_TMAP_FOURIER ? sample_fourier(texel, n, u)
                                                                  : sample_opacity(texel, n, u);
            CHECK_NEAR(query(map, x - 4, 4 - y, 10 - 20 * (double)u), (double)sampled, 1e-5);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Same bits for any number of workers; shuffled particles give the same to the rounding of sums of floats. */
static void test_order(void) {
    static const int workers[] = {0, 1, 2, 7};
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique) {
        static float first[500], depths[500];
        static double positions[1500];
        check_random random = {5};
        for (int i = 0; i < 1500; ++i) positions[i] = (i % 3 == 2 ? 18 : 8) * (check_next(&random) - 0.5);
        for (int w = 0; w < 5; ++w) {
            check_hooks hooks = {w < 4 ? workers[w] : 2, (uint64_t)w, 0, 0, 0, 0, 0, 0, 0};
            sps_context *context = check_context(&hooks);
            fixture f;
            fixture_begin(&f, (sps_tmap_technique)technique, components_of(technique));
            f.light.width = f.light.height = 50;
            fixture_scatter(&f, MANY);
            for (int i = 0; w == 4 && i < MANY; ++i) {
                const int other = (int)(check_next(&random) * MANY);
                const sps_particle kept = f.list[i];
                f.list[i] = f.list[other], f.list[other] = kept;
            }
            sps_tmap *map = fixture_build(&f, context);
            if (CHECK(map != NULL)) sps_tmap_query(map, 500, positions, w == 0 ? first : depths, NULL);
            if (w > 0 && w < 4) CHECK(memcmp(first, depths, sizeof first) == 0);
            for (int i = 0; i < 500 && w == 4; ++i) CHECK_NEAR((double)depths[i], (double)first[i], 1e-5);
            sps_tmap_destroy(map);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
        }
    }
}

static void test_extremes(void) {
    sps_context *context = sps_create(NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique) {
        static const double depths[] = {1e-8, 1, 1e8, 1e18};
        fixture f;
        for (size_t i = 0; i < sizeof depths / sizeof *depths; ++i) {
            fixture_begin(&f, (sps_tmap_technique)technique, components_of(technique));
            f.light.width = f.light.height = 1;
            f.light.ortho_height = 1;
            fixture_add(&f, 0, 0, 0, 1, depths[i]);
            fixture_add(&f, 0, 0, 1, 0, 1e18); /* of radius 0: nothing */
            sps_tmap *map = fixture_build(&f, context);
            if (!CHECK(map != NULL)) continue;
            CHECK_NEAR(query(map, 0, 0, -10), fmin(depths[i], 1e15), 1e-5 * depths[i]);
            CHECK_NEAR(query(map, 0, 0, 9.999), 0, 1e-2 * depths[i]);
            sps_tmap_destroy(map);
        }
        fixture_begin(&f, (sps_tmap_technique)technique, components_of(technique));
        sps_tmap *map = fixture_build(&f, context); /* empty */
        if (CHECK(map != NULL)) CHECK_NEAR(query(map, 0, 0, -5), 0, 0);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------- what fails */

static void test_memory(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_BEER; ++technique)
        for (long n = 1;; ++n) {
            check_hooks hooks = {2, 3, 0, 0, 0, 0, 0, 0, 0};
            sps_context *context = check_context(&hooks);
            const size_t before = hooks.live;
            fixture f;
            fixture_begin(&f, (sps_tmap_technique)technique, components_of(technique));
            fixture_scatter(&f, 20);
            hooks.fail_at = hooks.allocations + n;
            sps_tmap *map = fixture_build(&f, context);
            const int failed = map == NULL;
            if (failed) CHECK(strstr(sps_error(context), "memory") != NULL);
            if (!failed && technique != SPS_TMAP_DEEP)
                CHECK(sps_tmap_bytes(map) > (size_t)(SIDE * SIDE * components_of(technique)) * sizeof(float) &&
                      sps_tmap_bytes(map) <= hooks.live - before);
            sps_tmap_destroy(map);
            hooks.fail_at = 0;
            map = fixture_build(&f, context); /* the context goes on */
            CHECK(map != NULL);
            sps_tmap_destroy(map);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            if (!failed) break;
        }
}

static void check_refused(fixture *f, const char *text) {
    sps_context *context = sps_create(NULL);
    sps_tmap *map = fixture_build(f, context);
    if (!CHECK(map == NULL && strstr(sps_error(context), text) != NULL))
        printf("    wanted \"%s\", got \"%s\"\n", text, sps_error(context));
    sps_tmap_destroy(map);
    sps_destroy(context);
}

static void test_refusals(void) {
    static const char *const texts[] = {"components is 4",
                                        "components is 0",
                                        "components is 1",
                                        "components is 66",
                                        "technique is 9",
                                        "far_depth is 0",
                                        "width is 0",
                                        "field_of_view is 4",
                                        "same point",
                                        "position is nan",
                                        "radius is -1",
                                        "optical_depth is inf",
                                        "read_fn failed: it returned 7",
                                        "canary"};
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        fixture f;
        fixture_begin(&f, SPS_TMAP_FOURIER, 5);
        fixture_scatter(&f, 3);
        if (i == 0) f.settings.components = 4;
        if (i == 1) f.settings.technique = SPS_TMAP_OPACITY, f.settings.components = 0;
        if (i == 2) f.settings.technique = SPS_TMAP_DEEP, f.settings.components = 1;
        if (i == 3) f.settings.technique = SPS_TMAP_OPACITY, f.settings.components = 66;
        if (i == 4) f.settings.technique = (sps_tmap_technique)9;
        if (i == 5) f.settings.far_depth = 0;
        if (i == 6) f.light.width = 0;
        if (i == 7) f.light.field_of_view = 4;
        if (i == 8) check_set3(f.light.target, 0, 0, 10);
        if (i == 9) f.list[1].position[1] = (float)(HUGE_VAL - HUGE_VAL);
        if (i == 10) f.list[2].radius = -1;
        if (i == 11) f.list[0].optical_depth = (float)HUGE_VAL;
        if (i == 12) f.fail_at = 1;
        if (i == 13) f.particles.end_canary = 1;
        check_refused(&f, texts[i]);
    }
}

static void test_states(void) {
    sps_context *context = sps_create(NULL);
    sps_tmap *map = NULL;
    fixture f;
    fixture_begin(&f, SPS_TMAP_OPACITY, 4);
    fixture_scatter(&f, 3);
    CHECK(sps_tmap_create(context, &f.light, &f.settings, &map) == SPS_OK);
    CHECK_NEAR(query(map, 0, 0, -5), 0, 0); /* not finished */
    CHECK(sps_tmap_texels(map) == NULL);
    CHECK(sps_tmap_add(map, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_finish(map) == SPS_OK);
    CHECK(sps_tmap_finish(map) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_add(map, &f.scene) == SPS_ERROR_ARGUMENT);
    sps_tmap_destroy(map);
    sps_tmap_destroy(NULL);
    CHECK(sps_tmap_create(NULL, &f.light, &f.settings, &map) == SPS_ERROR_ARGUMENT && map == NULL);
    CHECK(sps_tmap_create(context, NULL, &f.settings, &map) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_finish(NULL) == SPS_ERROR_ARGUMENT && sps_tmap_bytes(NULL) == 0);
    sps_destroy(context);
}

int main(void) {
    test_deep();
    test_opacity();
    test_fourier();
    test_beer();
    test_perspective();
    test_small_particles();
    test_texels();
    test_order();
    test_extremes();
    test_memory();
    test_refusals();
    test_states();
    return check_report();
}
