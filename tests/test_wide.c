/* Very wide cameras: images that slabs of one direction cannot serve are cut into parts. Against the reference, against
   narrower cameras, across the seams; regions, workers and plans. */

#include "check.h"

enum { SIDE = 48, COUNT = 4 * SIDE * SIDE, PARTICLES = 80 };
static float image_a[COUNT], image_b[COUNT], depth_a[COUNT], depth_b[COUNT];
static sps_context *context;
static check_triangles ground;

/* Pixels of a picture's side. */
static int side;

/* Rows from the top that are compared: some of all four parts of an image. */
static int rows(void) { return check_long() ? side : (7 * side + 5) / 10; }

/* --- scenes around the eye --- */

static double waves(const void *user, const double p[3]) {
    (void)user;
    return 0.6 + 0.2 * (sin(3 * p[0]) + sin(3 * p[1] + 1) + sin(3 * p[2] + 2));
}

static const check_field wave_field = {waves, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
static const sps_transfer_point points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                            {0.5f, {0.9f, 0.6f, 0.3f}, 0, {0, 0, 0}},
                                            {1.2f, {0.4f, 0.6f, 0.9f}, 2, {0, 0, 0}}};
static const sps_transfer tissue = {points, 3, NULL, NULL, 0};
static sps_particle swarm[PARTICLES];

static void add_swarm(check_scene *s) {
    static sps_particles set;
    check_random random = {3};
    for (int i = 0; i < PARTICLES; ++i) {
        const double turn = 6.2831853 * check_next(&random), height = 2 * check_next(&random) - 1;
        const double distance = 1 + check_next(&random), across = sqrt(1 - height * height);
        swarm[i].position[0] = (float)(distance * across * cos(turn));
        swarm[i].position[1] = (float)(distance * across * sin(turn));
        swarm[i].position[2] = (float)(distance * height);
        swarm[i].radius = 0.4f, swarm[i].optical_depth = 0.5f;
    }
    memset(&set, 0, sizeof set);
    set.count = PARTICLES, set.read_fn = check_read_particles, set.user = swarm, set.soft = 1;
    check_color(set.albedo, 0.8, 0.7, 0.9);
    s->scene.particles = &set, s->scene.particle_set_count = 1;
}

enum { GAS, TISSUE, SWARM, MIXED, KINDS };
static const char *const names[] = {"gas", "surface", "particles", "gas and ground"};

/* Something on all sides of the eye, under a sun. */
static void start(check_scene *s, int kind, double angle) {
    const double origin[3] = {-9, -0.6, -9}, u[3] = {18, 0, 0}, v[3] = {0, 0, 18};
    side = check_long() || kind == SWARM ? SIDE : 24;
    check_clear(s, side, side);
    check_set3(s->view.camera.position, 0.05, 0.1, 0);
    check_set3(s->view.camera.target, 0.25, 0.2, -1);
    check_perspective(&s->view.camera, angle);
    check_add_directional(s, 1, -2, 0.3, 3);
    check_color(s->scene.background, 0.1, 0.2, 0.3);
    if (kind == SWARM) {
        add_swarm(s);
        return;
    }
    {
        sps_volume *volume = check_add_volume(s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
        volume->eval_fn = check_eval_field;
        volume->user = (void *)(size_t)&wave_field;
        volume->extinction = 1.5;
        check_color(volume->albedo, 0.9, 0.8, 0.7);
        check_color(volume->emission, 0.05, 0, 0.02);
        if (kind == TISSUE) volume->transfer = &tissue, volume->shading = SPS_SHADING_SURFACE;
    }
    if (kind != MIXED) return;
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(s, &ground, 0.5);
}

static sps_plan_report plan_of(const check_scene *s) {
    sps_plan_report plan;
    CHECK_OK(context, sps_plan(context, &s->scene, &s->view, &plan));
    return plan;
}

/* --- how right they are --- */

/* Root mean square change of the error from one pixel to the next: across the seam in the middle, or elsewhere. */
static double error_step(int at_seam) {
    double sum = 0;
    int count = 0;
    for (int y = 0; y < rows(); ++y)
        for (int x = 1; x < side; ++x)
            for (int c = 0; c < 3; ++c) {
                const int i = 4 * (y * side + x) + c;
                const double here = (double)image_a[i] - (double)image_b[i];
                const double before = (double)image_a[i - 4] - (double)image_b[i - 4];
                if ((x == side / 2) == at_seam) sum += (here - before) * (here - before), ++count;
            }
    return sqrt(sum / count);
}

/* 109 degrees in one sweep, 160 and 170 in four. Pixels in the middle are tan(85) / tan(54.4) = 8.2 times as wide, so
   that errors may grow by as much. No seam: errors of two parts are independent, so that at the seam they differ by
   sqrt(2) times the error of one sweep. Gas, whose errors do not depend on pixels, is within 0.2 % at any angle, and
   changes by no more than that, half a step of a display. */
static void test_against_reference(void) {
    static const double angles[] = {1.9, 2.793, 2.967, 3.1};
    for (int kind = check_long() ? GAS : TISSUE; kind < KINDS; ++kind) { /* gas is in the last kind, too */
        const int smooth = kind == GAS || kind == MIXED;
        double off_one = 0;
        for (int n = 0; n < (smooth && check_long() ? 4 : 3); ++n) {
            check_scene s;
            double mean, off, elsewhere, seam;
            int count;
            if (!check_long() && n == 1) continue; /* the angle between the others */
            start(&s, kind, angles[n]);
            count = 4 * side * rows();
            CHECK(plan_of(&s).sweep_count == (n ? 4 : 1));
            s.view.region[2] = side, s.view.region[3] = rows();
            if (!check_render_depth(context, &s, image_a, depth_a)) continue;
            check_march(context, &s, kind == TISSUE ? 0.35 : 0.5, image_b, depth_b);
            mean = check_mean(image_b, (size_t)count), off = check_rms(image_a, image_b, (size_t)count) / mean;
            elsewhere = error_step(0) / mean, seam = error_step(1) / mean;
            if (figures())
                printf("%s, %.0f degrees: rms %.5f of the mean, error's step %.5f, at the seam %.5f\n", names[kind],
                       angles[n] * 57.29578, off, elsewhere, seam);
            if (n == 0) off_one = off;
            CHECK(mean > 0.05);
            if (n > 0)
                CHECK_CASE("Extremes", "170 degrees, in four parts", "error / that of 109 degrees in one sweep",
                           off / off_one, 8.2, "pixels in the middle are that much wider");
            if (n < 3) CHECK(seam <= 1.5 * fmax(off_one, elsewhere));
            if (n && smooth)
                CHECK(off < 0.002 && seam < 0.002 && check_rms(depth_a, depth_b, (size_t)count / 4) < 0.01);
        }
    }
}

/* Any angle from corner to corner, under a sun along the view, which slabs of one direction could serve up to 2.94: the
   image is cut where its corners' rays would cross them at less than 0.35, and errors stay as small as below that. */
static void test_any_angle(void) {
    static const double corners[] = {2.3, 2.5, 2.9};
    for (int kind = GAS; kind < KINDS; ++kind)
        for (int n = 0; n < 3 && (kind == GAS || (kind == MIXED && check_long())); ++n) {
            check_scene s;
            int count;
            start(&s, kind, 2 * atan(tan(0.5 * corners[n]) * sqrt(0.5)));
            count = 4 * side * rows();
            check_set3(s.light[0].direction, 0.2, 0.1, -1);
            s.view.region[2] = side, s.view.region[3] = rows();
            CHECK(plan_of(&s).sweep_count == (n ? 4 : 1));
            if (!check_render(context, &s, image_a)) continue;
            check_march(context, &s, 0.5, image_b, NULL);
            CHECK_CASE("Extremes", "cameras of 132 to 166 degrees from corner to corner", "the reference",
                       check_rms(image_a, image_b, (size_t)count) / check_mean(image_b, (size_t)count), 0.005,
                       "slabs are crossed at a cosine of 0.35 or more");
        }
}

/* The middle of a picture of 170 degrees, where four parts meet, is a picture of 125 degrees in one sweep. An error of
   second order is 4/3 of what halving the slabs changes; the two differ by the sum of theirs at most, and by round-off.
 */
static void test_middle(void) {
    for (int kind = GAS; kind < KINDS; ++kind) {
        static float image[2][2][4 * 32 * 32];
        double error[2];
        if (kind == TISSUE)
            continue; /* its gradients' error does not fall with the slabs, but is of the pixels' width */
        for (int wide = 0; wide < 2; ++wide) {
            for (int fine = 0; fine < 2; ++fine) {
                check_scene s;
                start(&s, kind, wide ? 2.967 : 2 * atan(32.0 / 192 * tan(0.5 * 2.967)));
                s.light[0].shadow_source = SPS_SHADOW_TABLE;
                s.view.width = s.view.height = wide ? 192 : 32;
                s.view.slab_thickness = fine ? 0.25 : 0.5;
                s.view.region[2] = s.view.region[3] = 32;
                if (wide) s.view.region[0] = s.view.region[1] = 80;
                CHECK(plan_of(&s).sweep_count == (wide ? 4 : 1));
                check_render(context, &s, image[wide][fine]);
            }
            error[wide] = 4.0 / 3 * check_rms(image[wide][0], image[wide][1], 4 * 32 * 32);
        }
        if (figures())
            printf("%s: differ by %.6f, errors %.6f and %.6f\n", names[kind],
                   check_rms(image[0][0], image[1][0], 4 * 32 * 32), error[0], error[1]);
        CHECK(check_rms(image[0][0], image[1][0], 4 * 32 * 32) <= error[0] + error[1] + 1e-5);
    }
}

/* --- cuts --- */

/* Cameras off their axis are cut where rays are perpendicular to the image, if that is inside; and no more than needed:
   a wide strip into two. */
static void test_matrices(void) {
    static const double edges[][4] = {
        {-20, 20, -0.5, 0.5}, {-0.5, 0.5, -20, 20}, {-3, 40, -9, 30}, {0.5, 60, -0.5, 0.5}};
    static const int sweeps[] = {2, 2, 4, 1};
    const int few = check_long() ? 32 : 14, count = 4 * few * few;
    for (int n = 0; n < 4; ++n) {
        const double *e = edges[n], w = e[1] - e[0], h = e[3] - e[2];
        const double matrix[16] = {2 / w, 0, (e[0] + e[1]) / w, 0, 0, 2 / h, (e[2] + e[3]) / h, 0, 0, 0, -1, -0.1, 0, 0,
                                   -1,    0};
        double off, mean;
        check_scene s;
        start(&s, GAS, 0);
        s.view.width = s.view.height = few;
        check_matrix(&s.view.camera, matrix);
        CHECK(plan_of(&s).sweep_count == sweeps[n]);
        check_render(context, &s, image_a);
        check_march(context, &s, 0.5, image_b, NULL);
        off = check_rms(image_a, image_b, (size_t)count), mean = check_mean(image_b, (size_t)count);
        if (!CHECK(off < 0.002 * mean)) printf("    camera %d: off by %g of %g\n", n, off, mean);
    }
}

/* Images of few pixels are cut, too, between any of them. */
static void test_few_pixels(void) {
    for (int n = 0; n < 12; ++n) {
        check_scene s;
        start(&s, GAS, 3.1);
        s.view.width = 1 + n % 4, s.view.height = 1 + n / 4 % 3;
        check_render(context, &s, image_a);
        check_march(context, &s, 0.5, image_b, NULL);
        for (int i = 0; i < 4 * s.view.width * s.view.height; ++i) CHECK_NEAR(image_a[i], (double)image_b[i], 0.005);
    }
}

static int count_rows(void *user, size_t count, const float *directions, float *out_rgb) {
    *(int *)user += 1;
    for (size_t i = 0; i < 3 * count; ++i) out_rgb[i] = 0.5f + 0.5f * directions[i];
    return 0;
}

static const int region[4] = {41, 33, 77, 61};
static float whole[4 * 150 * 130], part[4 * 77 * 61], part_depth[77 * 61], whole_depth[150 * 130];

/* A region is that part of the whole to the bit, with a background by rows. A region within one part takes one sweep.
 */
static void test_region(void) {
    for (int kind = GAS; kind < KINDS; ++kind) {
        sps_stats_report stats;
        int rows = 0;
        uint64_t slabs;
        check_scene s;
        start(&s, kind, 2.967);
        s.view.width = 150, s.view.height = 130;
        s.scene.background_fn = count_rows, s.scene.background_user = &rows;
        check_render_depth(context, &s, whole, whole_depth);
        sps_get_stats(context, &stats);
        CHECK(rows == 130 && stats.background_calls == 130);
        slabs = stats.slabs;
        memcpy(s.view.region, region, sizeof region);
        check_render_depth(context, &s, part, part_depth);
        for (int y = 0; y < region[3]; ++y) {
            const int from = (region[1] + y) * 150 + region[0];
            CHECK(memcmp(part + 4 * y * region[2], whole + 4 * from, 16 * (size_t)region[2]) == 0);
            CHECK(memcmp(part_depth + y * region[2], whole_depth + from, 4 * (size_t)region[2]) == 0);
        }
        CHECK(plan_of(&s).sweep_count == 4);
        s.view.region[2] = s.view.region[3] = 32; /* columns 41 to 72 of 150, rows 33 to 64 of 130 */
        CHECK(plan_of(&s).sweep_count == 1);
        check_render(context, &s, part);
        sps_get_stats(context, &stats);
        CHECK(stats.slabs < 0.5 * (double)slabs);
        for (int y = 0; y < 32; ++y) CHECK(memcmp(part + 4 * y * 32, whole + 4 * ((33 + y) * 150 + 41), 16 * 32) == 0);
    }
}

/* One worker and three; the plan is a bound of what is held. */
static void test_workers(void) {
    for (int kind = GAS; kind < KINDS; ++kind) {
        for (int workers = 0; workers <= 3; workers += 3) {
            check_hooks hooks;
            sps_context *with;
            sps_plan_report plan;
            check_scene s;
            start(&s, kind, 2.967);
            s.view.width = 110, s.view.height = 96;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = workers;
            with = check_context(&hooks);
            CHECK_OK(with, sps_plan(with, &s.scene, &s.view, &plan));
            check_render_depth(with, &s, workers ? whole : (float *)memset(whole, 0, sizeof whole), whole_depth);
            CHECK(hooks.peak <= plan.bytes);
            if (!workers) memcpy(part, whole, sizeof part);
            if (workers) CHECK(memcmp(part, whole, sizeof part) == 0);
            sps_destroy(with);
        }
    }
}

/* 128 pixels are four tiles and four parts. Tiles that become opaque count once, in the part that they belong to, and
   the four parts are as much work together as each by itself, as a region. */
static void test_tiles(void) {
    for (int dense = 0; dense < 2; ++dense) {
        sps_stats_report stats;
        uint64_t shaded = 0, whole_shaded;
        check_scene s;
        start(&s, GAS, 2.967);
        s.view.width = s.view.height = 128;
        s.volume[0].extinction = dense ? 500 : 1;
        check_render(context, &s, whole);
        sps_get_stats(context, &stats);
        CHECK(stats.tiles_finished == (uint64_t)(4 * dense));
        whole_shaded = stats.pixels_shaded;
        s.view.region[2] = s.view.region[3] = 64;
        for (int n = 0; n < 4; ++n) {
            s.view.region[0] = n % 2 * 64, s.view.region[1] = n / 2 * 64;
            check_render(context, &s, part);
            sps_get_stats(context, &stats);
            shaded += stats.pixels_shaded;
        }
        CHECK(shaded == whole_shaded && shaded > 0);
    }
}

/* Shadows are made once for all parts. */
static void test_shadows_once(void) {
    sps_stats_report stats, narrow;
    sps_plan_report plan;
    check_scene s;
    start(&s, MIXED, 2.967);
    plan = plan_of(&s);
    CHECK(plan.pass[SPS_PASS_LIGHT_MAPS].runs == 1 && plan.pass[SPS_PASS_SHADOW_RAYS].runs == 1);
    CHECK(plan.pass[SPS_PASS_EYE_SHEETS].runs == 4);
    CHECK(strstr(plan.pass[SPS_PASS_EYE_SHEETS].reason, "one sweep for each part of an image too wide for one"));
    check_render(context, &s, image_a);
    sps_get_stats(context, &stats);
    CHECK(stats.tables_made == 1 && stats.shadow_rays == stats.pixels_of_polygons);
    check_perspective(&s.view.camera, 1.9);
    check_render(context, &s, image_a);
    sps_get_stats(context, &narrow);
    CHECK(narrow.shadow_rays == narrow.pixels_of_polygons && narrow.slabs < stats.slabs);
}

/* What a budget tries before it chooses leaves nothing behind: the picture is that of the settings that it chose, also
   where some of these cut the image into parts and others do not. */
static void test_budget(void) {
    for (int n = 0; n < 4; ++n) {
        const double turn = 2.399963 * (28 + 3 * n); /* suns all around the axis, from behind the eye */
        sps_context *other = check_context(NULL);
        sps_stats_report stats;
        check_scene s;
        start(&s, GAS, 2.55);
        check_set3(s.view.camera.position, 0.05, 0.1, 0.4);
        check_set3(s.light[0].direction, cos(turn), -0.4 - 0.15 * n, sin(turn));
        s.view.budget_error = 0.2;
        check_render(other, &s, image_a);
        sps_get_stats(other, &stats);
        sps_destroy(other);
        s.view.budget_error = 0;
        s.view.quality = stats.budget.quality, s.view.slab_thickness = stats.budget.slab_thickness;
        s.view.tolerance = stats.budget.tolerance, s.view.scattering_resolution = stats.budget.scattering_resolution;
        check_render(context, &s, image_b);
        CHECK(check_same(&s, image_a, image_b));
    }
}

int main(void) {
    context = check_context(NULL);
    RUN(test_against_reference);
    RUN(test_any_angle);
    RUN_LONG(test_middle);
    RUN(test_matrices);
    RUN(test_few_pixels);
    RUN(test_region);
    RUN_LONG(test_workers);
    RUN(test_tiles);
    RUN(test_shadows_once);
    RUN(test_budget);
    check_free_triangles(&ground);
    sps_destroy(context);
    return check_report();
}
