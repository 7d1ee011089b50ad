/* How the library shades gas where the caller leaves it open: sheets where slabs serve light and camera, a table where
   none do, and a table for further lights that can share a sweep. Plan and render agree; the caller can force either.
 */

#include "check.h"

enum { SIDE = 40, COUNT = 4 * SIDE * SIDE };
static float image_a[COUNT], image_b[COUNT];
static sps_context *context;
static sps_tmap_settings table;

static const char in_gas[] = "a table: the light is in the gas";
static const char by_camera[] = "a table: no slabs serve both the light and so wide a camera";
static const char of_points[] = "tables that an area light's points share: no slabs serve it; steps show";
static const char shared[] = "a table: the light shares the sweep of another";

/* --- scenes --- */

static const sps_transfer_point points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                            {0.5f, {0.9f, 0.6f, 0.3f}, 6, {0, 0, 0}}};
static const sps_transfer tissue = {points, 2, NULL, NULL, 0};

enum { GAS, TISSUE, SWARM, KINDS };

/* Something about the origin, without a light. */
static void start(check_scene *s, int kind) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 1.5, 2, 5);
    check_perspective(&s->view.camera, 0.5);
    if (kind == SWARM)
        check_color(check_add_swarm(s, 0.5)->albedo, 0.8, 0.7, 0.9);
    else
        check_color(check_add_puff(s, 3)->albedo, 0.9, 0.8, 0.7);
    if (kind == TISSUE) s->volume[0].transfer = &tissue, s->volume[0].shading = SPS_SHADING_SURFACE;
}

/* --- plan and render --- */

typedef struct outcome {
    sps_plan_report plan;
    sps_stats_report stats;
} outcome;

static outcome render_with(sps_context *with, const check_scene *s, float *image) {
    outcome o;
    CHECK_OK(with, sps_plan(with, &s->scene, &s->view, &o.plan));
    check_render(with, s, image);
    sps_get_stats(with, &o.stats);
    return o;
}

/* Plans and renders. `sheets` and `tables`: the numbers of lights that shade by either, in both. `reason`: the plan's
   for its maps; NULL: any. */
static outcome check_chosen(const check_scene *s, int sheets, int tables, const char *reason, float *image) {
    const outcome o = render_with(context, s, image);
    const sps_pass_report *pass = o.plan.pass;
    const int sweeps = sheets > 0 ? sheets : s->view.camera.field_of_view > 2.17 ? 4 : 1; /* corners at cos 0.35 */
    if (!CHECK((int)(o.stats.tables_made + o.stats.tables_held) == tables) ||
        !CHECK((o.stats.light_fragments + o.stats.light_samples > 0) == (sheets > 0)))
        printf("    %d tables\n", (int)o.stats.tables_made);
    if (!CHECK(pass[SPS_PASS_LIGHT_SHEETS].runs == sheets) || !CHECK(pass[SPS_PASS_LIGHT_MAPS].runs == tables) ||
        !CHECK(o.plan.sweep_count == sweeps))
        printf("    sheets %d, maps %d, sweeps %d\n", pass[SPS_PASS_LIGHT_SHEETS].runs, pass[SPS_PASS_LIGHT_MAPS].runs,
               o.plan.sweep_count);
    CHECK(o.stats.bytes <= o.plan.bytes);
    CHECK((pass[SPS_PASS_LIGHT_MAPS].bytes > 0) == (pass[SPS_PASS_LIGHT_MAPS].runs > 0));
    if (reason && !CHECK(strcmp(pass[SPS_PASS_LIGHT_MAPS].reason, reason) == 0))
        printf("    %s\n", pass[SPS_PASS_LIGHT_MAPS].reason);
    return o;
}

/* --- lights that no slabs serve --- */

/* Beside the reference: a pixel's mean is off from the ray through its middle by a 24th of the square of its width,
   0.07, times the curvature: ripples of a wavelength of 0.8, (2 pi / 0.8)^2, make 1.3 %. A tenth of all pixels is at a
   surface's edge, where they differ by a sixth: the root of a tenth, times that. Of the rims of 50 particles, 22 pixels
   each, any pixel has one or two, at which half a pixel makes a fifth of a particle's depth: a tenth, root mean square,
   of a quarter of the light, as one particle has of what is brightest. */
static const double room[KINDS] = {0.013, 0.05, 0.03};

/* Some rows in the middle of a picture against sps_reference, which knows neither sheets nor tables: the root mean
   square of their difference, of the largest radiance. */
static double off_reference(const check_scene *start_from, const float *image) {
    enum { LEFT = 10, TOP = 18, ACROSS = 20, ROWS = 4 };
    static float exact[4 * ACROSS * ROWS];
    double square = 0, most = 0;
    check_scene s = *start_from;
    s.scene.volumes = s.volume, s.scene.lights = s.light;
    s.view.region[0] = LEFT, s.view.region[1] = TOP, s.view.region[2] = ACROSS, s.view.region[3] = ROWS;
    if (!check_march(context, &s, 0.75, exact, NULL)) return HUGE_VAL;
    for (int i = 0; i < 4 * ACROSS * ROWS; ++i) {
        const int at = 4 * (SIDE * (TOP + i / (4 * ACROSS)) + LEFT) + i % (4 * ACROSS);
        if (i % 4 == 3) continue;
        square += pow((double)image[at] - (double)exact[i], 2) / (3 * ACROSS * ROWS);
        most = fmax(most, (double)exact[i]);
    }
    return sqrt(square) / most;
}

/* A lamp in whatever there is needs no setting. The picture is that of a table, to the bit. In the second round it is
   at a voxel's very centre. */
static void test_lamp_within(void) {
    for (int n = 0; n < 2 * KINDS; ++n) {
        double off;
        check_scene s;
        const int kind = n / 2, centred = n % 2;
        start(&s, kind);
        check_add_point(&s, centred ? 0 : 0.31, 0, centred ? 0 : -0.2, 3);
        check_chosen(&s, 0, 1, in_gas, image_a);
        s.light[0].shadow_map = &table;
        check_chosen(&s, 0, 1, "lights have a shadow_map or SPS_SHADOW_TABLE", image_b);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && check_mean(image_a, COUNT) > 0.01);
        s.light[0].shadow_map = NULL;
        s.light[0].shadow_source = SPS_SHADOW_TABLE;
        check_chosen(&s, 0, 1, "lights have a shadow_map or SPS_SHADOW_TABLE", image_b);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        off = off_reference(&s, image_a);
        if (!CHECK(off < room[kind])) printf("    %d: %g of the largest beside the reference\n", n, off);
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        check_fails(context, &s, image_b, SPS_ERROR_UNSUPPORTED, "light[0] is inside or too close to the ");
    }
}

/* What decides is the box of the volume, which is known before reading: a lamp in its empty corner has a table, and by
   force sheets, which see that nothing is there. */
static void test_empty_corner(void) {
    check_scene s;
    start(&s, GAS);
    s.volume[0].placement = check_box(-3, -3, -3, 3, 3, 3);
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 75;
    check_add_point(&s, 2.8, 2.8, 2.8, 30);
    check_chosen(&s, 0, 1, in_gas, image_a);
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    check_render(context, &s, image_b);
    CHECK(check_rms(image_a, image_b, COUNT) < 0.01 * check_mean(image_b, COUNT));
}

/* From close by, with 120 degrees, slabs half-way to a light from the side graze rays at the image's edge. */
static void test_wide_camera(void) {
    for (int kind = GAS; kind < SWARM; ++kind) {
        check_scene s;
        start(&s, kind);
        check_set3(s.view.camera.position, 0, 0, 0.9);
        check_perspective(&s.view.camera, 2.0944);
        check_add_directional(&s, 1, 0, 0.2, 2);
        check_chosen(&s, 0, 1, by_camera, image_a);
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        check_fails(context, &s, image_b, SPS_ERROR_UNSUPPORTED, "narrow it, or set shadow_source or no_shadow on");
    }
}

/* A cube's half edges about its centre. */
static double cube(const void *user, const double p[3]) {
    const double *at = (const double *)user;
    int inside = 1;
    for (int i = 0; i < 3; ++i) inside &= fabs(p[i] - at[i]) <= at[3 + i];
    return inside;
}

/* Gas in a part of its box, seen and lit from beside it. Slabs half-way between the directions of light and of the eye
   towards the gas do not serve the first three, and slabs about the camera's axis do. In the last two, neither serves
   what has been read, but slabs for the whole box do, by which sheets were planned: all render. Errors at medium
   quality are within 3 %, as in soak. */
static void test_other_directions(void) {
    static const struct {
        double gas[6], eye[3], target[3], angle, light[3];
        int kind; /* 0: none, 1: directional, 2: point */
    } views[] = {
        {{-0.28, -0.28, 0.25, 0.5, 0.42, 0.58}, {0.17, -1.2, -0.08}, {-0.4, 0.99, 0.14}, 2.47, {0, 0, 0}, 0},
        {{-0.56, 0.51, -0.22, 0.39, 0.32, 0.52}, {-0.43, -0.65, -0.62}, {-0.07, 0.58, 0.52}, 1.21, {1.5, 0.8, -1.9}, 1},
        {{-0.35, -0.24, -0.27, 0.35, 0.53, 0.29},
         {0.53, -0.37, -1.05},
         {-0.41, -0.25, -0.74},
         0.67,
         {-1.3, 1.4, -1.9},
         2},
        {{0.54, 0.18, 0.06, 0.46, 0.24, 0.52}, {1.01, -0.62, 0.46}, {-0.68, -0.39, -0.8}, 1.22, {1.91, 1.54, -1.26}, 2},
        {{0.27, 0.15, 0.02, 0.48, 0.58, 0.45}, {1.21, 0.74, -0.65}, {0.52, -0.35, -0.59}, 1.43, {-1.9, 1.58, 0.24}, 2}};
    for (size_t n = 0; n < sizeof views / sizeof *views; ++n) {
        const double *l = views[n].light;
        check_field field;
        check_scene s;
        memset(&field, 0, sizeof field);
        field.value_fn = cube, field.user = views[n].gas;
        start(&s, GAS);
        s.volume[0].user = &field;
        memcpy(s.view.camera.position, views[n].eye, sizeof views[n].eye);
        memcpy(s.view.camera.target, views[n].target, sizeof views[n].target);
        check_perspective(&s.view.camera, views[n].angle);
        if (views[n].kind == 1) check_add_directional(&s, l[0], l[1], l[2], 3);
        if (views[n].kind == 2) check_add_point(&s, l[0], l[1], l[2], 9);
        if (views[n].kind == 0) check_color(s.scene.ambient, 1, 1, 1);
        check_chosen(&s, views[n].kind > 0, 0, NULL, image_a);
        check_march(context, &s, 0.5, image_b, NULL);
        if (!CHECK(check_rms(image_a, image_b, COUNT) < 0.03 * check_mean(image_b, COUNT)) ||
            !CHECK(check_mean(image_b, COUNT) > 1e-3))
            printf("    view %d: off by %g of %g\n", (int)n, check_rms(image_a, image_b, COUNT),
                   check_mean(image_b, COUNT));
    }
}

/* A wall of gas beside the camera fills its box, all of it before the eye and none of it in the middle of the picture:
   slabs across the way to its middle, 73 degrees from the camera's axis, do not serve the rays at the other edge. Slabs
   about the axis do, for all of the image, and for a sun. */
static void test_wall(void) {
    for (int sun = 0; sun < 2; ++sun) {
        float value = 1;
        check_scene s;
        start(&s, GAS);
        s.volume[0].placement = check_box(0.4, -2, -1, 4, 2, -0.6);
        s.volume[0].size[0] = s.volume[0].size[1] = 40, s.volume[0].size[2] = 4;
        s.volume[0].eval_fn = check_eval_constant, s.volume[0].user = &value;
        check_set3(s.view.camera.position, 0, 0, 0);
        check_set3(s.view.camera.target, 0, 0, -1);
        check_perspective(&s.view.camera, 1.4);
        if (sun) check_add_directional(&s, 0.3, -0.2, -1, 3);
        check_color(s.scene.ambient, 1, 1, 1);
        check_chosen(&s, sun, 0, NULL, image_a);
        check_march(context, &s, 0.25, image_b, NULL);
        CHECK(check_rms(image_a, image_b, COUNT) < 0.01 * check_mean(image_b, COUNT) &&
              check_mean(image_b, COUNT) > 0.01);
    }
}

/* The points of an area light that no slabs serve share tables: five at medium quality, or one, if its penumbrae could
   not be told from sharp shadows: within half a texel of a 25th of the box's width, which is 3.5 units from corner to
   corner. A sun of 0.005 radians blurs by 0.0173 units, half of 0.035; one of 0.02 by 0.069. A disc amid the gas may be
   of any size. Sheets that are asked for are refused. */
static void test_extents(void) {
    static const double suns[] = {0.005, 0.02};
    check_scene s;
    start(&s, GAS);
    check_set3(s.view.camera.position, 0, 0, 0.9);
    check_perspective(&s.view.camera, 2.0944);
    check_add_directional(&s, 1, 0, 0.2, 2);
    for (int i = 0; i < 2; ++i) {
        s.light[0].angular_diameter = suns[i];
        check_chosen(&s, 0, i ? 5 : 1, i ? of_points : by_camera, image_a);
    }
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    check_fails(context, &s, image_a, SPS_ERROR_UNSUPPORTED, "or set shadow_source or no_shadow on light[0]");
    start(&s, GAS);
    check_add_point(&s, 0.1, 0, 0.1, 3);
    s.light[0].kind = SPS_LIGHT_DISC;
    for (int i = 0; i < 2; ++i) {
        s.light[0].axes[0][0] = s.light[0].axes[1][1] = i ? 40 : 1e-3;
        s.light[0].shadow_source = SPS_SHADOW_AUTO;
        check_chosen(&s, 0, 5, of_points, image_a);
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        check_fails(context, &s, image_a, SPS_ERROR_UNSUPPORTED, "move it away, or set shadow_source or no_shadow on");
    }
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    check_chosen(&s, 0, 5, "lights have a shadow_map or SPS_SHADOW_TABLE", image_a);
}

/* --- lights that share a sweep --- */

static void add_two(check_scene *s, int kind) {
    start(s, kind);
    check_add_directional(s, 0.5, -1, -0.4, 3);
    check_add_point(s, -1.5, 3, 1.2, 30);
}

/* The first light keeps its sheets, the second takes a table; both together are within 0.5 % of two lights by sheets.
 */
static void test_two_lights(void) {
    for (int kind = GAS; kind < KINDS; ++kind) {
        check_scene s;
        double off;
        add_two(&s, kind);
        check_chosen(&s, kind == TISSUE ? 2 : 1, kind != TISSUE,
                     kind == TISSUE ? "no light that casts shadows has a shadow_map or a table" : shared, image_a);
        check_force_sheets(&s);
        check_chosen(&s, 2, 0, NULL, image_b);
        off = off_reference(&s, image_b);
        if (!CHECK(off < room[kind])) printf("    kind %d: %g of the largest beside the reference\n", kind, off);
        off = check_rms(image_a, image_b, COUNT) / check_mean(image_b, COUNT);
        if (!CHECK(kind == TISSUE ? off <= 0 : off > 0 && off < 0.005)) printf("    kind %d: off by %g\n", kind, off);
        s.light[1].shadow_source = SPS_SHADOW_TABLE;
        check_chosen(&s, 1, 1, NULL, image_b);
        CHECK((memcmp(image_a, image_b, sizeof image_a) == 0) == (kind != TISSUE));
    }
}

/* Lights before the first by sheets do not count; lights of another kind neither take a table nor make others do. */
static void test_order(void) {
    check_scene s;
    add_two(&s, GAS);
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    check_chosen(&s, 1, 1, "lights have a shadow_map or SPS_SHADOW_TABLE", image_a);
    s.light[0].shadow_source = SPS_SHADOW_AUTO;
    s.light[0].no_shadow = 1;
    check_chosen(&s, 1, 0, NULL, image_a);
    s.light[0].no_shadow = 0;
    s.light[1].shadow_map_omnidirectional = 1; /* six faces take longer than a sweep */
    check_chosen(&s, 2, 0, NULL, image_a);
    s.light[1].shadow_map_omnidirectional = 0;
    s.light[1].shadow_source = SPS_SHADOW_SHEETS;
    check_chosen(&s, 2, 0, NULL, image_a);
    s.light[1].shadow_source = SPS_SHADOW_AUTO;
    s.light[1].kind = SPS_LIGHT_DISC;
    s.light[1].axes[0][0] = s.light[1].axes[1][1] = 0.3;
    check_chosen(&s, 2, 0, NULL, image_a);
    check_add_point(&s, 0, 0, 0, 3);
    check_chosen(&s, 2, 1, in_gas, image_a);
    s.scene.light_count = 2;
    s.view.no_shadows = 1;
    check_chosen(&s, 0, 0, NULL, image_a);
}

/* A table that would need more than 256 entries on a side, or along the light, shows less than sheets. Where the caller
   sets the size of both it counts, too. */
static void test_capped(void) {
    static const int sizes[3][3] = {{300, 6, 6}, {6, 300, 6}, {150, 6, 6}};
    for (int n = 0; n < 5; ++n) {
        check_scene s;
        const int along = n % 3;
        float value = 1;
        start(&s, GAS);
        s.volume[0].eval_fn = check_eval_constant, s.volume[0].user = &value;
        for (int i = 0; i < 2; ++i) check_add_directional(&s, 0, -1, -1e-3 * i, 2);
        if (n < 3) memcpy(s.volume[0].size, sizes[along], sizeof sizes[along]);
        for (int k = 0; k < 3; ++k) s.volume[0].placement.axis[k][k] = n < 3 ? sizes[along][k] / 100.0 : 2;
        if (n == 3) s.view.shadow_resolution = 100; /* 2 units in 100 texels, and as many planes */
        if (n == 4) s.view.shadow_resolution = 100, s.light[1].shadow_map_resolution = 60;
        check_chosen(&s, n == 2 || n == 3 ? 1 : 2, n == 2 || n == 3, NULL, image_a);
    }
}

/* The least memory limit with which a scene's second light is planned to have a table. */
static size_t find_limit(const check_scene *s) {
    size_t low = 1 << 20, high = (size_t)1 << 30;
    while (high - low > 1) {
        check_hooks hooks;
        sps_plan_report plan;
        sps_context *limited;
        memset(&hooks, 0, sizeof hooks);
        hooks.memory_limit = low + (high - low) / 2;
        limited = check_context(&hooks);
        if (sps_plan(limited, &s->scene, &s->view, &plan) == SPS_OK && plan.sweep_count == 1)
            high = hooks.memory_limit;
        else
            low = hooks.memory_limit;
        sps_destroy(limited);
    }
    return high;
}

/* Where the limit leaves no room for the table there are sheets, and the scene that fits with a table stays within it:
   its pixels take more than the table. A second table needs more. What the context holds from before changes nothing.
 */
static void test_memory(void) {
    static float image[4 * 300 * 300];
    size_t limit[2];
    check_scene s;
    add_two(&s, GAS);
    s.view.width = s.view.height = 300;
    for (int n = 0; n < 2; ++n) {
        if (n) check_add_directional(&s, -0.5, -1, -0.4, 3);
        limit[n] = find_limit(&s);
        for (int less = 0; less < 2; ++less) {
            check_hooks hooks;
            sps_context *limited;
            outcome o;
            memset(&hooks, 0, sizeof hooks);
            hooks.memory_limit = limit[n] - (size_t)less;
            limited = check_context(&hooks);
            for (int again = 0; again < 2; ++again) {
                o = render_with(limited, &s, image);
                CHECK(o.plan.sweep_count == 1 + less && o.stats.tables_made == (uint64_t)(n + 1 - less));
            }
            CHECK(hooks.peak <= limit[n]);
            sps_destroy(limited);
        }
    }
    CHECK(limit[1] > limit[0] + 100000);
}

/* --- particles, and errors --- */

/* A plan reads particles, and chooses as the render does. */
static void test_particles_alike(void) {
    check_scene s;
    start(&s, SWARM);
    check_add_directional(&s, 0.5, -1, -0.4, 3);
    check_chosen(&s, 1, 0, "no light that casts shadows has a shadow_map or a table", image_a);
    check_add_point(&s, 0, 4, 0, 9);
    CHECK(check_chosen(&s, 1, 1, shared, image_a).plan.sweep_count == 1);
    check_color(check_add_puff(&s, 3)->albedo, 0.9, 0.8, 0.7);
    check_chosen(&s, 1, 1, shared, image_a);
    check_set3(s.light[1].position, 0, 0, 0); /* in the volume */
    check_chosen(&s, 1, 1, in_gas, image_a);
}

static double between(check_random *random, double low, double high) { return low + (high - low) * check_next(random); }

/* Gas in a part of its box, an eye, and up to three lights without extent, anywhere and of any direction: all is
   rendered, as it was planned. */
static void test_anywhere(void) {
    check_random random = {21};
    int tables = 0, parts = 0, sheets = 0;
    for (int n = 0; n < 250; ++n) {
        double gas[6];
        check_field field;
        check_scene s;
        outcome o;
        memset(&field, 0, sizeof field);
        start(&s, GAS);
        s.view.width = 13, s.view.height = 9;
        for (int i = 0; i < 3; ++i) {
            gas[3 + i] = between(&random, 0.2, 0.9), gas[i] = between(&random, gas[3 + i] - 1, 1 - gas[3 + i]);
            s.volume[0].size[i] = 12;
            s.view.camera.position[i] = between(&random, -1.6, 1.6);
            s.view.camera.target[i] = between(&random, -1, 1);
        }
        field.value_fn = cube, field.user = gas;
        s.volume[0].user = &field;
        check_perspective(&s.view.camera, between(&random, 0.3, 3.1));
        for (int i = (int)between(&random, 0, 4); i > 0; --i) {
            const double x = between(&random, -2, 2), y = between(&random, -2, 2), z = between(&random, -2, 2);
            if (i % 2)
                check_add_point(&s, x, y, z, 3);
            else
                check_add_directional(&s, x, y, z, 3);
        }
        o = render_with(context, &s, image_a);
        if (!CHECK((int)o.stats.tables_made == o.plan.pass[SPS_PASS_LIGHT_MAPS].runs) ||
            !CHECK((o.stats.light_fragments + o.stats.light_samples > 0) ==
                   (o.plan.pass[SPS_PASS_LIGHT_SHEETS].runs > 0)))
            printf("    scene %d: %d tables\n", n, (int)o.stats.tables_made);
        tables += o.stats.tables_made > 0, sheets += o.stats.light_fragments + o.stats.light_samples > 0;
        parts += o.plan.sweep_count > 1 && o.plan.pass[SPS_PASS_LIGHT_SHEETS].runs == 0;
    }
    CHECK(tables > 80 && sheets > 30 && parts > 10);
}

static void test_refused(void) {
    check_scene s;
    sps_tmap_settings fourier;
    memset(&fourier, 0, sizeof fourier);
    fourier.technique = SPS_TMAP_FOURIER;
    add_two(&s, GAS);
    s.light[1].shadow_source = (sps_shadow_source)3;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT,
                "light[1].shadow_source is 3; it must be an sps_shadow_source");
    s.light[1].shadow_source = SPS_SHADOW_SHEETS;
    s.light[1].shadow_map = &table;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT,
                "light[1].shadow_source is SPS_SHADOW_SHEETS, and shadow_map is");
    s.light[1].shadow_map = &fourier;
    s.light[1].shadow_source = SPS_SHADOW_TABLE;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT,
                "light[1].shadow_source is SPS_SHADOW_TABLE, and shadow_map is");
    s.light[1].shadow_map = &table;
    check_render(context, &s, image_a);
    s.light[1].shadow_source = SPS_SHADOW_AUTO;
    check_render(context, &s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
}

int main(void) {
    context = check_context(NULL);
    RUN(test_lamp_within);
    RUN(test_empty_corner);
    RUN(test_wide_camera);
    RUN(test_other_directions);
    RUN(test_wall);
    RUN(test_extents);
    RUN(test_two_lights);
    RUN(test_order);
    RUN(test_capped);
    RUN(test_memory);
    RUN(test_particles_alike);
    RUN(test_anywhere);
    RUN(test_refused);
    sps_destroy(context);
    return check_report();
}
