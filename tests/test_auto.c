/* SPS_SCATTERING_AUTO: its bound holds for the optical depth of all kinds of gas, and for what scatters again; what it
   decides is the picture of one of the other two, bit for bit; the plan says so. It is the default. */

#include "check.h"

enum { SIDE = 12, PIXELS = SIDE * SIDE, COUNT = 4 * PIXELS };
static float image_a[COUNT], image_b[COUNT];
static sps_context *context;
static const float one = 1;

enum { PUFF, TURNED, SHEARED, SWARM, HARD_SWARM, EXTINCTIONS, DUST, CLASSIFIED, TWO, KINDS };
static const char *const kinds[] = {"puff",        "turned box", "sheared box", "soft balls",    "balls",
                                    "extinctions", "dust",       "classified",  "puff and balls"};
static const sps_transfer_point points[] = {{0, {0.3f, 0.3f, 0.3f}, 0, {0, 0, 0}},
                                            {0.2f, {0.3f, 0.3f, 0.3f}, 4, {0, 0, 0}},
                                            {0.5f, {0.8f, 0.3f, 0.3f}, 1, {0, 0, 0}},
                                            {1, {0.3f, 0.3f, 0.3f}, 2, {0, 0, 0}}};
static const sps_transfer tissue = {points, 4, NULL, NULL, 0};

static void add_box(check_scene *s, int kind) {
    sps_placement placement;
    sps_volume *volume;
    memset(&placement, 0, sizeof placement);
    check_set3(placement.origin, -0.5, -1, -0.4);
    check_set3(placement.axis[0], 1, kind == TURNED ? 0.8 : 0, kind == TURNED ? 0.5 : 0);
    check_set3(placement.axis[1], kind == TURNED ? -0.8 : 0.9, 1, 0);
    check_set3(placement.axis[2], kind == TURNED ? -0.5 : 0.3, 0, 1);
    volume = check_add_volume(s, 12, 10, 14, placement);
    volume->read_fn = check_read_constant;
    volume->user = (void *)(size_t)&one;
    volume->extinction = 1.5f;
}

static void start(check_scene *s, int kind, double strength) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 0, 0, 5);
    check_perspective(&s->view.camera, 0.5);
    if (kind == PUFF || kind == CLASSIFIED || kind == TWO) check_add_puff(s, 2 * strength)->revision = 1;
    if (kind == CLASSIFIED) s->volume[0].transfer = &tissue, s->volume[0].extinction = (float)strength;
    if (kind == TURNED || kind == SHEARED) add_box(s, kind), s->volume[0].extinction *= (float)strength;
    if (kind == SWARM || kind == HARD_SWARM || kind == EXTINCTIONS || kind == TWO || kind == DUST) {
        sps_particles *swarm = check_add_swarm(s, 0.2 * strength);
        swarm->soft = kind != HARD_SWARM, swarm->is_extinction = kind == EXTINCTIONS;
        check_color(swarm->albedo, 0.5, 0.5, 0.5);
        if (kind == DUST)
            for (int i = 0; i < (int)swarm->count; ++i) ((sps_particle *)swarm->user)[i].radius = 0.004f;
    }
    for (int i = 0; i < s->scene.volume_count; ++i) check_color(s->volume[i].albedo, 0.5, 0.5, 0.5);
    check_add_directional(s, 0.5, -0.8, -0.4, 2);
    s->view.scattering = SPS_SCATTERING_AUTO;
    s->view.scattering_resolution = 8;
}

/* The optical depth that a bound stands for. */
static double depth_of(double bound, double albedo) { return -log1p(-bound / (1 + bound) / albedo); }

static double bound_of(const check_scene *s) {
    sps_stats_report stats;
    check_render(context, s, image_a);
    sps_get_stats(context, &stats);
    return stats.scattering_bound;
}

/* The largest optical depth of pixels, from many sides. */
static double deepest(const check_scene *s) {
    double most = 0;
    check_scene seen = *s;
    seen.scene.volumes = seen.volume, seen.scene.lights = seen.light;
    seen.view.scattering = SPS_SCATTERING_SINGLE, seen.view.quality = SPS_QUALITY_HIGH;
    for (int n = 0; n < (check_long() ? 30 : 4); ++n) {
        check_set3(seen.view.camera.position, 5 * sin(0.7 * n), 5 * cos(1.1 * n) * (n % 3 - 1), 5 * cos(0.7 * n));
        check_render(context, &seen, image_b);
        for (int i = 3; i < COUNT; i += 4) most = fmax(most, -log1p(-fmin((double)image_b[i], 1 - 1e-7)));
    }
    return most;
}

/* No way is deeper than the bound, which is not more than a few times as deep: the root of 3, and bricks of 12 voxels
   where 25 are all there are. Between pixels dust is missed. */
static void test_depths(void) {
    for (int kind = 0; kind < KINDS; ++kind) {
        double depth, bound;
        check_scene s;
        start(&s, kind, 0.7);
        depth = deepest(&s);
        bound = depth_of(bound_of(&s), kind == CLASSIFIED ? (double)0.8f : 0.5);
        if (figures()) printf("%s: depth %.3f, bound %.3f\n", kinds[kind], depth, bound);
        if (!CHECK(bound >= 0.99 * depth) || !CHECK(kind == DUST || (depth > 0.05 && bound < 7 * depth)))
            printf("    %s\n", kinds[kind]);
    }
}

static void add_cube(check_scene *s, float extinction) {
    sps_volume *volume = check_add_volume(s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_constant;
    volume->user = (void *)(size_t)&one;
    volume->extinction = extinction;
    check_color(volume->albedo, 0.5, 0.5, 0.5);
}

/* Every eighth plane is dense. */
static int read_planes(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) out[i] = (lo[0] + i % size[0]) % 8 == 5 ? 1 : 0.1f;
    return 0;
}

/* The deepest way through a cube is its diagonal, which the bound exceeds by as much as kernels reach beyond: two
   voxels on either side of 40. Two cubes are twice as deep. A classified one counts as the most that values up to its
   own have. */
static void test_cube(void) {
    double single;
    check_scene s;
    start(&s, KINDS, 0);
    add_cube(&s, 1);
    single = depth_of(bound_of(&s), 0.5);
    if (figures()) printf("cube: %.4f of %.4f\n", single, 2 * sqrt(3.0));
    CHECK(single >= 2 * sqrt(3.0) && single <= 2 * sqrt(3.0) * 44 / 40 * 1.0001);
    add_cube(&s, 0.5f);
    CHECK_NEAR(depth_of(bound_of(&s), 0.5), 1.5 * single, 1e-3 * single);
    start(&s, KINDS, 0);
    add_cube(&s, 1);
    s.volume[0].transfer = &tissue;
    CHECK_NEAR(depth_of(bound_of(&s), (double)0.8f), 4 * single, 4e-3 * single);
    start(&s, KINDS, 0);
    add_cube(&s, 1);
    s.volume[0].read_fn = read_planes;
    CHECK(depth_of(bound_of(&s), 0.5) > 0.9 * single); /* bricks are wider than a cell */
}

/* Particles are as deep as they say, whether they say it as a depth or as a density; many in one place add up. */
static void test_particles(void) {
    for (int soft = 0; soft < 2; ++soft) {
        static const double along[] = {2, 4.0 / 3};
        sps_particle particle[2] = {{{0, 0, 0}, 0.5f, 0.3f, {0, 0, 0}}, {{0, 0, 0}, 0.5f, 0.3f, {0, 0, 0}}};
        sps_particles *set;
        double single;
        check_scene s;
        start(&s, SWARM, 1);
        set = (sps_particles *)(size_t)s.scene.particles;
        set->count = 1, set->user = particle, set->soft = soft;
        single = depth_of(bound_of(&s), 0.5);
        if (figures()) printf("particle: %.4f of 0.3\n", single);
        CHECK(single >= 0.3 && single <= 0.3 * sqrt(3.0) * (soft ? 1.1 : 1.0001));
        particle[0].optical_depth = (float)(0.3 / along[soft] / 0.5), set->is_extinction = 1;
        CHECK_NEAR(depth_of(bound_of(&s), 0.5), single, 1e-5);
        particle[1] = particle[0], set->count = 2;
        CHECK_NEAR(depth_of(bound_of(&s), 0.5), 2 * single, 1e-5);
        for (int k = 0; k < 3; ++k) particle[0].position[k] = 9;
        set->is_extinction = 0;
        for (int i = 0; i < 2; ++i) particle[i].radius = 1e-3f, particle[i].optical_depth = 0.3f;
        CHECK(depth_of(bound_of(&s), 0.5) <=
              2 * 0.3 * sqrt(3.0) * 2); /* tiny ones, in two planes of cells each at most */
    }
}

/* Many large particles are added to coarse cells: the bound is no less than that of a few, and not much more. */
static void test_many_particles(void) {
    enum { MANY = 600 };
    static sps_particle particle[MANY];
    check_random random = {9};
    double depth[2];
    sps_particles *set;
    check_scene s;
    start(&s, SWARM, 1);
    set = (sps_particles *)(size_t)s.scene.particles;
    for (int i = 0; i < MANY; ++i) {
        for (int k = 0; k < 3; ++k) particle[i].position[k] = (float)(2 * check_next(&random) - 1);
        particle[i].radius = 0.8f;
        particle[i].optical_depth = 0.6f / MANY;
    }
    set->user = particle, set->soft = 0;
    for (int n = 0; n < 2; ++n) {
        set->count = n ? MANY : SPSI_BOUND_FEW;
        depth[n] = depth_of(bound_of(&s), 0.5) / (double)set->count;
    }
    if (figures()) printf("a particle of many: %.3g, of few: %.3g\n", depth[1], depth[0]);
    CHECK(depth[1] > 0.9 * depth[0] && depth[1] < 2 * depth[0]);
}

/* Less scatters again than the bound says. */
static void test_share(void) {
    static const double strengths[] = {0.02, 0.1, 0.3};
    for (int n = 0; n < 3; ++n) {
        double sums[2] = {0, 0}, bound;
        check_scene s;
        start(&s, PUFF, strengths[n]);
        bound = bound_of(&s);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_a);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        check_render(context, &s, image_b);
        for (int i = 0; i < COUNT; ++i)
            if (i % 4 < 3) sums[0] += (double)image_a[i], sums[1] += (double)image_b[i];
        if (figures()) printf("strength %g: %.4f more, bound %.4f\n", strengths[n], sums[1] / sums[0] - 1, bound);
        CHECK(sums[1] / sums[0] - 1 < bound && sums[1] > sums[0]);
        CHECK(sums[1] / sums[0] - 1 > bound / 12);
    }
}

/* Either picture, bit for bit; below a tolerance of 1 %, unless another is set. */
static void test_decisions(void) {
    for (int n = 0; n < 7; ++n) {
        static const double strengths[] = {0.002, 0.3, 0.3, 0.3, 0.002, 0.002, 0.006};
        const int full = n == 1 || n == 3 || n == 4 || n == 6;
        double bound;
        check_scene s;
        start(&s, n < 4 || n == 6 ? PUFF : SWARM, strengths[n]);
        if (n == 2 || n == 3) s.view.scattering_tolerance = (float)bound_of(&s) * (n == 2 ? 1.01f : 0.99f);
        if (n == 4) check_color(s.scene.ambient, 1, 1, 1), s.view.scattering_tolerance = 1e-4f;
        bound = bound_of(&s);
        s.view.scattering = full ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        if (figures()) printf("decision %d: bound %.5f\n", n, bound);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        CHECK((bound > (s.view.scattering_tolerance > 0 ? (double)s.view.scattering_tolerance : 0.01)) == full);
    }
}

/* Nobody needs to ask for it: zeros have its picture, in gas that calls for MULTIPLE, that does not, and that scatters
   nothing. There, SINGLE's, even if the gas is dense, above a floor. */
static void test_default(void) {
    static const double strengths[] = {0.3, 0.002, 0.3};
    const double origin[3] = {-2, -1.5, -2}, u[3] = {4, 0, 0}, v[3] = {0, 0, 4};
    static check_triangles floor_faces;
    sps_view zeros;
    memset(&zeros, 0, sizeof zeros);
    CHECK(SPS_SCATTERING_AUTO == 0 && zeros.scattering == SPS_SCATTERING_AUTO);
    check_add_quad(&floor_faces, origin, u, v);
    for (int n = 0; n < 3; ++n) {
        static float image_c[COUNT];
        check_scene s;
        start(&s, PUFF, strengths[n]);
        if (n == 2) check_color(s.volume[0].albedo, 0, 0, 0), check_add_mesh(&s, &floor_faces, 0.5);
        check_render(context, &s, image_a);
        s.view.scattering = zeros.scattering;
        check_render(context, &s, image_b);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_c);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        CHECK((memcmp(image_a, image_c, sizeof image_a) == 0) == (n > 0));
    }
    check_free_triangles(&floor_faces);
}

/* With ambient light all that meets gas counts, whatever its albedo; without anything that scatters nothing does,
   unless there are polygons that gas keeps light from, or shines on. */
static void test_ambient(void) {
    const double origin[3] = {-2, -1.5, -2}, u[3] = {4, 0, 0}, v[3] = {0, 0, 4};
    static check_triangles floor_faces;
    double dark, lit;
    check_scene s;
    start(&s, PUFF, 0.3);
    check_color(s.volume[0].albedo, 0.01, 0, 0);
    dark = bound_of(&s);
    check_color(s.scene.ambient, 0.1, 0.1, 0.1);
    lit = bound_of(&s);
    CHECK_NEAR(depth_of(lit, 1), depth_of(dark, (double)0.01f), 1e-5);
    check_color(s.volume[0].albedo, 0, 0, 0);
    CHECK(bound_of(&s) == 0);
    check_add_quad(&floor_faces, origin, u, v);
    check_add_mesh(&s, &floor_faces, 0.5);
    CHECK_NEAR(depth_of(bound_of(&s), 1), depth_of(lit, 1), 1e-5); /* gas shadows the sky on the floor */
    check_color(s.scene.ambient, 0, 0, 0);
    CHECK(bound_of(&s) == 0);
    check_color(s.volume[0].albedo, 0.01, 0, 0);
    CHECK(bound_of(&s) == 1e6); /* the floor sends gas as much as the light does */
    {
        sps_context *by = check_context(NULL);
        sps_plan_report report;
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report)); /* that is known before gas is read */
        CHECK(report.scattering_bound == 1e6 && strstr(report.pass[SPS_PASS_CELLS].reason, "above") != NULL);
        sps_destroy(by);
    }
    check_color(s.volume[0].albedo, 0, 0, 0);
    check_color(s.volume[0].emission, 0.1, 0, 0);
    CHECK(bound_of(&s) == 1e6); /* gas lights the floor */
    s.scene.volume_count = 0;
    CHECK(bound_of(&s) == 0);
    check_free_triangles(&floor_faces);
}

/* The plan knows as much as is held: from a second call on, of volumes. */
static void test_plan(void) {
    for (int n = 0; n < 4; ++n) {
        sps_context *by = check_context(NULL);
        sps_plan_report report;
        sps_stats_report stats;
        check_scene s;
        start(&s, n == 2 ? SWARM : PUFF, n == 1 ? 0.001 : 0.3);
        if (n == 3) check_color(s.volume[0].albedo, 0, 0, 0);
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.scattering_bound == (n == 3 ? 0 : -1) && report.pass[SPS_PASS_CELLS].runs == (n != 3));
        CHECK(strstr(report.pass[SPS_PASS_CELLS].reason, n == 3 ? "nothing scatters" : "not read yet") != NULL);
        check_render(by, &s, image_a);
        sps_get_stats(by, &stats);
        CHECK(stats.bytes_peak <= report.bytes);
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.scattering_bound == stats.scattering_bound);
        CHECK(report.pass[SPS_PASS_CELLS].runs == (n == 0 || n == 2));
        if (n == 0) CHECK(strstr(report.pass[SPS_PASS_CELLS].reason, "above") != NULL);
        if (n == 1) CHECK(strstr(report.pass[SPS_PASS_CELLS].reason, "within") != NULL);
        if (n == 1) CHECK(strstr(report.pass[SPS_PASS_FORWARD].reason, "within") != NULL);
        if (n == 3) CHECK(strstr(report.pass[SPS_PASS_FORWARD].reason, "nothing scatters") != NULL);
        CHECK((stats.cells > 0) == (n == 0 || n == 2));
        sps_destroy(by);
    }
}

/* The grid from which the bound is made is part of the plan. It is a fifth of all memory in this scene. */
static void test_memory_of_bound(void) {
    check_hooks hooks;
    sps_plan_report plan;
    check_scene s;
    memset(&hooks, 0, sizeof hooks);
    sps_context *by = check_context(&hooks);
    start(&s, TURNED, 1);
    s.scene.light_count = 0;
    check_color(s.scene.ambient, 1, 1, 1);
    s.view.scattering_resolution = 4, s.view.filling = SPS_FILLING_SPLAT;
    CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &plan));
    check_render(by, &s, image_a);
    if (!CHECK(hooks.peak <= plan.bytes)) printf("    %.0f of %.0f\n", (double)hooks.peak, (double)plan.bytes);
    sps_destroy(by);
}

static void test_refused(void) {
    static const float bad[] = {-0.1f, 1.1f, NAN};
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    start(&s, PUFF, 0.1);
    image.rgba = image_a;
    for (int i = 0; i < 3; ++i) {
        s.view.scattering_tolerance = bad[i];
        CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_ARGUMENT);
        CHECK(strstr(sps_error(context), "scattering_tolerance") != NULL);
    }
    s.view.scattering_tolerance = 0;
    settings.step = 1;
    for (int n = 0; n < 2; ++n) { /* the sentence has both ways out */
        s.view.scattering = n ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_AUTO;
        CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED);
        CHECK(strstr(sps_error(context), "settings.samples") && strstr(sps_error(context), "SPS_SCATTERING_SINGLE"));
    }
    settings.samples = 1;
    CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image));
    s.view.scattering = SPS_SCATTERING_AUTO; /* paths have all, whatever it says */
    image.rgba = image_b;
    CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image));
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    settings.samples = 0, s.view.scattering = SPS_SCATTERING_SINGLE;
    CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image));
    check_color(s.volume[0].albedo, 0, 0, 0), s.view.scattering = SPS_SCATTERING_AUTO; /* there is nothing to follow */
    CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image));
}

int main(void) {
    context = check_context(NULL);
    RUN(test_depths);
    RUN(test_cube);
    RUN(test_particles);
    RUN(test_many_particles);
    RUN(test_share);
    RUN(test_decisions);
    RUN(test_default);
    RUN(test_ambient);
    RUN(test_plan);
    RUN(test_memory_of_bound);
    RUN(test_refused);
    sps_destroy(context);
    return check_report();
}
