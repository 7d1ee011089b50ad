/* Budgets: what is chosen for seconds and for errors, what is said of it before, and that pictures are what these
   settings show. Time is that of a clock that the tests turn themselves. */

#include "check.h"

enum { SIZE = 24, COUNT = 4 * SIZE * SIZE };
static float image[COUNT], exact[COUNT];

/* A puff that is lit from the side, large enough for its voxels and texels to be larger than pixels call for. */
static void start(check_scene *s) {
    sps_volume *gas;
    check_clear(s, SIZE, SIZE);
    check_orthographic(&s->view.camera, 1.2);
    gas = check_add_puff(s, 3);
    check_color(gas->albedo, 0.9, 0.8, 0.7);
    check_add_directional(s, 0.4, -1, -0.5, 3);
    s->view.scattering = SPS_SCATTERING_SINGLE;
}

static sps_budget_report budget_of(const sps_context *context) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    return stats.budget;
}

/* ---------------------------------------------------------------------------------------------------------- a clock */

/* Each look at it takes a while, and by `more` longer than the last, so that a frame takes as many as it looks at its
   clock. */
typedef struct clock_of_tests {
    double now, each, more;
} clock_of_tests;

static double look_at_clock(void *user) {
    clock_of_tests *clock = (clock_of_tests *)user;
    clock->each += clock->more;
    return clock->now += clock->each;
}

/* What message_fn was told last. */
static char told[256];

static void keep_message(void *user, const char *text) {
    (void)user;
    SPS_SNPRINTF(told, sizeof told, "%s", text);
}

static sps_context *timed_context(clock_of_tests *clock) {
    sps_config config;
    memset(&config, 0, sizeof config);
    config.clock_fn = look_at_clock, config.clock_user = clock;
    config.message_fn = keep_message;
    return sps_create(&config, NULL);
}

/* ----------------------------------------------------------------------------------------------------- bad budgets */

static void test_refused(void) {
    sps_context *context = check_context(NULL);
    static const double bad[] = {-1, -1e-300, HUGE_VAL, NAN};
    check_scene s;
    for (int i = 0; i < 4; ++i) {
        start(&s);
        s.view.budget_seconds = bad[i];
        check_fails(context, &s, image, SPS_ERROR_ARGUMENT, "view.budget_seconds");
        s.view.budget_seconds = 0, s.view.budget_error = bad[i];
        check_fails(context, &s, image, SPS_ERROR_ARGUMENT, "view.budget_error");
        CHECK(strstr(sps_error(context), "positive and finite") != NULL);
    }
    start(&s);
    s.view.budget_seconds = s.view.budget_error = 1;
    check_fails(context, &s, image, SPS_ERROR_ARGUMENT, "set one of both");
    for (int i = 0; i < 4; ++i) {
        static const char *const words[] = {"view.quality is 3; the budget", "view.slab_thickness is 2; the budget",
                                            "view.tolerance is 0.5; the budget",
                                            "view.scattering_resolution is 32; the budget"};
        start(&s);
        s.view.budget_error = 0.1;
        if (i == 0) s.view.quality = SPS_QUALITY_HIGH;
        if (i == 1) s.view.slab_thickness = 2;
        if (i == 2) s.view.tolerance = 0.5f;
        if (i == 3) s.view.scattering_resolution = 32;
        check_fails(context, &s, image, SPS_ERROR_ARGUMENT, words[i]);
    }
    start(&s);
    s.view.budget_error = 0.1;
    CHECK_OK(context, check_try(context, &s, image));
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------------- errors */

/* Renders what a budget has chosen, set by hand, in a fresh context. */
static void render_chosen(const check_scene *s, const sps_budget_report *chosen, float *rgba) {
    check_scene by_hand = *s;
    by_hand.scene.volumes = by_hand.volume, by_hand.scene.lights = by_hand.light, by_hand.scene.meshes = by_hand.mesh;
    by_hand.view.budget_error = by_hand.view.budget_seconds = 0;
    by_hand.view.quality = chosen->quality;
    by_hand.view.slab_thickness = chosen->slab_thickness;
    by_hand.view.tolerance = chosen->tolerance;
    by_hand.view.scattering_resolution = chosen->scattering_resolution;
    for (int i = 0; i < by_hand.scene.light_count; ++i)
        if (by_hand.light[i].angular_diameter > 0) by_hand.light[i].samples = chosen->samples;
    check_render_plain(&by_hand, rgba);
}

/* The picture is that of the setting which the statistics name, what is expected is within the budget, and a smaller
   budget is never expected to be cheaper. */
static void check_errors(const check_scene *start_from, const double *errors, int count) {
    check_scene s = *start_from;
    double last = 0;
    s.scene.volumes = s.volume, s.scene.lights = s.light, s.scene.meshes = s.mesh;
    for (int i = 0; i < count; ++i) {
        sps_context *context = check_context(NULL);
        sps_budget_report chosen;
        s.view.budget_error = errors[i];
        CHECK_OK(context, check_try(context, &s, image));
        chosen = budget_of(context);
        CHECK(chosen.is_met && chosen.error <= errors[i] && chosen.error > 0 && chosen.seconds >= last);
        last = chosen.seconds;
        render_chosen(&s, &chosen, exact);
        if (!CHECK(check_same(&s, image, exact)))
            printf("    error %g: quality %d, slab %g, samples %d, scattering_resolution %d\n", errors[i],
                   (int)chosen.quality, chosen.slab_thickness, chosen.samples, chosen.scattering_resolution);
        sps_destroy(context);
    }
}

/* The rungs, from the cheapest on: what is too little for any takes the lowest. */
static void test_rungs(void) {
    static const int samples[] = {4, 16, 64, 256};
    static const double errors[] = {0.5, 0.15, 0.06, 0.03};
    static const sps_transfer_point steps[2] = {{0.1f, {0.8f, 0.6f, 0.4f}, 0, {0, 0, 0}},
                                                {0.5f, {0.8f, 0.6f, 0.4f}, 30, {0, 0, 0}}};
    static const sps_transfer looks = {steps, 2, NULL, NULL, 0};
    sps_context *context = check_context(NULL);
    sps_plan_report plan;
    check_scene s;
    start(&s);
    for (int i = 0; i < 3; ++i) s.volume[0].size[i] = 400;
    s.view.width = s.view.height = 512;
    s.view.budget_seconds = 1e-9;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.budget.quality == SPS_QUALITY_DRAFT && plan.budget.slab_thickness == 8 && plan.budget.tolerance > 0);
    s.volume[0].transfer = &looks;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.budget.quality == SPS_QUALITY_DRAFT && plan.budget.slab_thickness == 0 && !(plan.budget.tolerance > 0));
    s.volume[0].transfer = NULL;
    s.light[0].angular_diameter = 0.2;
    s.view.budget_seconds = 0;
    for (int i = 0; i < 4; ++i) {
        s.view.budget_error = errors[i];
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.budget.samples == samples[i] && plan.light_points == samples[i]);
    }
    sps_destroy(context);
}

/* Two lights of which the second may shade by a table where that is as fine as its sheets would be, which it is not on
   the finest rung: all that is planned is what is planned for that setting without a budget. */
static void test_choices(void) {
    static const double seconds[] = {1e-9, 1e9};
    sps_context *context = check_context(NULL);
    check_scene s;
    start(&s);
    for (int i = 0; i < 3; ++i) s.volume[0].size[i] = 80;
    check_add_directional(&s, -0.4, -1, -0.5, 3);
    for (int n = 0; n < 2; ++n) {
        sps_plan_report chosen, by_hand;
        s.view.budget_seconds = seconds[n];
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &chosen));
        s.view.budget_seconds = 0;
        s.view.quality = chosen.budget.quality, s.view.slab_thickness = chosen.budget.slab_thickness;
        s.view.tolerance = chosen.budget.tolerance;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &by_hand));
        s.view.quality = SPS_QUALITY_DEFAULT, s.view.slab_thickness = 0, s.view.tolerance = 0;
        for (int pass = 0; pass < SPS_PASS_COUNT; ++pass) CHECK(chosen.pass[pass].runs == by_hand.pass[pass].runs);
        CHECK(chosen.sweep_count == by_hand.sweep_count && chosen.sweep_count == 1 + n);
    }
    sps_destroy(context);
}

/* Seen four times as small, what gas is off by counts four times as much before black; more than once, beside a box
   that is wider than the picture. */
static void test_covered(void) {
    sps_context *context = check_context(NULL);
    sps_plan_report near_by, far_off;
    check_scene s;
    start(&s);
    s.view.width = s.view.height = 240;
    s.view.budget_error = 1e-9;
    check_orthographic(&s.view.camera, 3);
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &near_by));
    check_orthographic(&s.view.camera, 12);
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &far_off));
    CHECK_NEAR(far_off.budget.error / near_by.budget.error, 4, 0.1); /* a pixel of 50 and of 200 */
    sps_destroy(context);
}

static void test_errors(void) {
    static const double errors[] = {0.5, 0.3, 0.1, 0.02, 0.01}, soft[] = {0.5, 0.2, 0.12};
    static const double again[] = {0.5, 0.3};
    check_scene s;
    start(&s);
    check_errors(&s, errors, check_memory_only() ? 3 : 5);
    s.light[0].angular_diameter = 0.2;
    check_errors(&s, soft, check_memory_only() ? 2 : 3);
    s.light[0].angular_diameter = 0;
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    check_errors(&s, again, check_memory_only() ? 1 : 2);
}

/* Pictures keep within what was expected, beside sps_reference, and are expected to be at most `most` times as far off
   as they are. The last budget makes them better than the first, if any setting is better than what that one buys. */
static void check_kept(const check_scene *start_from, double step, const double errors[3], double most) {
    sps_context *context = check_context(NULL);
    const int count = 4 * start_from->view.width * start_from->view.height;
    double mean = 0, first = 0;
    sps_quality quality = SPS_QUALITY_DEFAULT;
    check_scene s = *start_from;
    s.scene.volumes = s.volume, s.scene.lights = s.light;
    check_march(context, &s, step, exact, NULL);
    for (int i = 0; i < count; ++i) mean += i % 4 < 3 ? (double)exact[i] / (0.75 * count) : 0;
    for (int n = 0; n < 3; ++n) {
        double squares = 0, found;
        s.view.budget_error = errors[n];
        check_render(context, &s, image);
        for (int i = 0; i < count; ++i)
            squares += i % 4 < 3 ? pow((double)image[i] - (double)exact[i], 2) / (0.75 * count) : 0;
        found = sqrt(squares) / mean;
        if (!CHECK_NEAR(found, 0, budget_of(context).error)) printf("    budget %g\n", errors[n]);
        if (!CHECK(budget_of(context).error <= most * found))
            printf("    budget %g: %g expected, %g found\n", errors[n], budget_of(context).error, found);
        if (n == 0) first = found, quality = budget_of(context).quality;
        if (n == 2 && quality < SPS_QUALITY_HIGH) CHECK(found < 0.6 * first && budget_of(context).quality > quality);
    }
    sps_destroy(context);
}

/* In steps of half a voxel: between these and steps of a 32nd, errors differ by 0.0001 at most. Denser gas is off by
   more, and expected to be: its middle, in steps of 1/8 voxel. The table has twice the worst of its scenes, and this
   one, a puff of 25 voxels, is nearly the worst: 1.4 to 2.3 times. Twice that is allowed. */
static void test_kept(void) {
    static const double errors[] = {0.3, 0.05, 0.02};
    check_scene s;
    start(&s);
    check_kept(&s, 0.5, errors, 2 * 2.3);
    s.volume[0].extinction = 20;
    s.view.width = s.view.height = SIZE / 3;
    check_orthographic(&s.view.camera, 0.4);
    if (!check_memory_only()) check_kept(&s, 0.125, errors, 2 * 2.3);
}

/* Balls that shade each other and themselves, in steps of 0.14 radii: half as long ones differ by 0.0014 of the mean at
   most. What is expected is for the worst of the list's scenes, and 8 to 11.4 times what these are off by. Twice that
   is allowed. */
static void test_balls_kept(void) {
    static const double errors[] = {0.9, 0.35, 0.12};
    for (int n = 0; n < (check_memory_only() ? 1 : 4); ++n) {
        sps_particles *balls;
        check_scene s;
        start(&s);
        s.scene.volume_count = 0;
        balls = check_add_swarm(&s, n == 1 ? 1.2 : 0.3);
        balls->is_extinction = n == 1, balls->soft = n % 2;
        check_color(balls->albedo, 0.9, 0.8, 0.7);
        if (n == 3) {
            s.light[0].kind = SPS_LIGHT_POINT;
            s.light[0].position[1] = 1.5;
        }
        check_kept(&s, 0.2, errors, 2 * 11.4);
    }
}

/* What is expected grows as the power 0.75 of the depth of balls along their diameters: where they scatter light that
   casts shadows, and by those that do. */
static void test_depth_of_balls(void) {
    sps_context *context = check_context(NULL);
    double expected[6];
    for (int n = 0; n < 6; ++n) {
        sps_particles sets[2];
        check_scene s;
        start(&s);
        s.scene.volume_count = 0;
        sets[0] = *check_add_swarm(&s, n == 0 ? 0.3 : 0.6);
        sets[1] = sets[0]; /* the same balls, dark, but for n == 5 */
        s.scene.particles = sets, s.scene.particle_set_count = n < 4 ? 1 : 2;
        check_color(sets[0].albedo, 0.9, 0.8, 0.7);
        if (n == 2) sets[0].is_extinction = sets[0].soft = 1; /* 0.6 * 4 / 3 * 0.25 = 0.2 */
        if (n == 3) s.light[0].no_shadow = 1;
        if (n == 4) sets[1].is_extinction = 1; /* 0.3 */
        if (n == 5) check_color(sets[1].albedo, 0.1, 0.1, 0.1), sets[1].is_extinction = 1;
        s.view.budget_seconds = 1e-9; /* the lowest rung */
        check_render(context, &s, image);
        expected[n] = budget_of(context).error;
        CHECK(budget_of(context).slab_thickness == 8);
    }
    /* with what gas of any kind is expected to be off by, as expected[3] is, by squares */
    for (int n = 0; n < 6; ++n)
        if (n != 3) expected[n] = sqrt(expected[n] * expected[n] - expected[3] * expected[3]);
    CHECK_NEAR(expected[1], pow(2, 0.75) * expected[0], 1e-6);
    CHECK_NEAR(expected[2], expected[0] * pow(2. / 3, 0.75), 1e-6);
    CHECK_NEAR(expected[4], expected[1], 1e-6);
    CHECK_NEAR(expected[5], expected[0] * pow((0.36 + 0.09) / (0.6 + 0.3) / 0.3, 0.75), 1e-6);
    sps_destroy(context);
}

/* What no setting keeps is refused before anything is rendered, with the least that is known; sps_plan says the same
   and does not fail. */
static void test_unmet(void) {
    clock_of_tests clock = {0, 1e-6, 0};
    sps_context *context = timed_context(&clock);
    sps_plan_report plan;
    check_scene s;
    char words[128];
    start(&s);
    s.view.budget_error = 1e-9;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(!plan.budget.is_met && plan.budget.error > 1e-9 && plan.budget.error < 0.1);
    CHECK(plan.budget.quality == SPS_QUALITY_ULTRA);
    SPS_SNPRINTF(words, sizeof words, "view.budget_error is 1e-09; the least that is expected here is %g",
                 plan.budget.error);
    check_fails(context, &s, image, SPS_ERROR_UNSUPPORTED, words);
    s.view.budget_error = 1.01 * plan.budget.error;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.budget.is_met);
    s.view.budget_error = 0;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(!plan.budget.is_met && !(plan.budget.seconds > 0) && plan.budget.quality == SPS_QUALITY_DEFAULT);
    sps_destroy(context);
}

/* Settings that a light has are kept, and their error is part of what is expected. */
static void test_own_samples(void) {
    sps_context *context = check_context(NULL);
    sps_plan_report plan;
    double last = 0;
    check_scene s;
    start(&s);
    s.light[0].angular_diameter = 0.2;
    s.view.budget_error = 1e-9;
    for (int samples = 256; samples >= 1; samples /= 4) {
        s.light[0].samples = samples;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.budget.samples == 0 && plan.light_points == samples && plan.budget.error > last);
        last = plan.budget.error;
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------------------- time */

/* More seconds buy less error, until there is nothing left to buy; too few are said, and taken by the cheapest setting.
   Without frames of its own the context goes by start values. */
static void test_seconds(void) {
    clock_of_tests clock = {0, 0, 0};
    sps_context *context = timed_context(&clock);
    double last = HUGE_VAL;
    sps_budget_report chosen;
    sps_plan_report plan;
    check_scene s;
    start(&s);
    s.view.budget_seconds = 1e-9;
    told[0] = 0;
    check_render(context, &s, image);
    chosen = budget_of(context);
    CHECK(!chosen.is_met && chosen.seconds > 1e-9 && chosen.quality == SPS_QUALITY_DRAFT);
    CHECK(strstr(told, "view.budget_seconds is 1e-09; the setting that is used") != NULL);
    for (double seconds = 1e-4; seconds < 1000; seconds *= 2) {
        s.view.budget_seconds = seconds;
        told[0] = 0;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.budget.error <= last && (!plan.budget.is_met || plan.budget.seconds <= seconds));
        CHECK(!told[0]);
        last = plan.budget.error;
    }
    CHECK(plan.budget.is_met && plan.budget.quality == SPS_QUALITY_ULTRA && plan.budget.slab_thickness <= 0.25);
    check_render(context, &s, image);
    chosen = budget_of(context);
    CHECK(chosen.quality == plan.budget.quality && chosen.is_met);
    sps_destroy(context);
}

/* A frame teaches the context what its stages take: the second expects what the first took, by a clock that depends on
   nothing but how often it is looked at. The counts of looks differ by those of reading voxels, a few. */
static void test_learning(void) {
    clock_of_tests clock = {0, 1e-2, 0};
    sps_context *context = timed_context(&clock);
    sps_stats_report stats;
    sps_budget_report first;
    check_scene s;
    start(&s);
    s.volume[0].revision = 1;
    s.view.budget_error = 0.05;
    for (int n = 0; n < 3; ++n) {
        check_render(context, &s, image);
        sps_get_stats(context, &stats);
        if (n == 0) first = stats.budget;
    }
    CHECK(first.seconds > clock.each && first.seconds < 0.2 * stats.seconds_total);
    CHECK_NEAR(stats.budget.seconds, stats.seconds_total, 0.3 * stats.seconds_total);
    /* what took so long is known of this rung, and expected of all others in proportion */
    s.view.budget_error = 0, s.view.budget_seconds = 0.01 * stats.seconds_total;
    check_render(context, &s, image);
    CHECK(!budget_of(context).is_met && budget_of(context).quality == SPS_QUALITY_DRAFT);
    sps_destroy(context);
}

/* The coarsest setting is the cheapest, whatever start values are in proportion: those of other scenes, by which these
   balls would take less at high quality than at draft. */
static void test_order(void) {
    clock_of_tests clock = {0, 1e-3, 0};
    sps_context *context = timed_context(&clock);
    check_scene s;
    start(&s);
    s.scene.volume_count = 0;
    check_color(check_add_swarm(&s, 0.3)->albedo, 0.9, 0.8, 0.7);
    s.view.shadow_resolution = 64;
    s.view.budget_seconds = 1e-9;
    for (int n = 0; n < 2; ++n) {
        check_render(context, &s, image);
        CHECK(!budget_of(context).is_met);
        CHECK(budget_of(context).quality == SPS_QUALITY_DRAFT && budget_of(context).slab_thickness == 8);
    }
    sps_destroy(context);
}

/* Flat voxels are splatted in thick slabs, however slow that is: a frame that shows it, by a clock of which a frame's
   looks take several times what start values have for it, says nothing of thinner slabs, which are tried next. In the
   first scene the eye's sheets and the light's are splatted, in the second one the light's alone. */
static void test_splatted(void) {
    for (int n = 0; n < 2; ++n) {
        clock_of_tests clock = {0, 1e-3, 0};
        sps_context *context = timed_context(&clock);
        sps_stats_report stats;
        check_scene s;
        start(&s);
        s.volume[0].placement.axis[1][1] *= 0.1, s.volume[0].placement.origin[1] *= 0.1;
        if (n == 0) check_set3(s.view.camera.position, 2, 2, 3);
        s.view.budget_seconds = 1e-9;
        check_render(context, &s, image);
        sps_get_stats(context, &stats);
        CHECK(stats.light_footprints > 0 && stats.light_samples == 0 && (stats.eye_samples == 0) == (n == 0));
        CHECK(!budget_of(context).is_met && budget_of(context).slab_thickness == 8);
        check_render(context, &s, image);
        CHECK(!budget_of(context).is_met && budget_of(context).slab_thickness < 8);
        CHECK(budget_of(context).seconds < 0.5 * stats.seconds_total); /* by start values, not by that frame's rates */
        sps_destroy(context);
    }
}

/* Frames whose light in cells is held teach nothing of what following it takes: it is expected to take that again. Of
   the hundred or fewer looks until then, each takes a thousandth longer than the last; time as in test_learning. */
static void test_held_rates(void) {
    clock_of_tests clock = {0, 1e-3, 1e-6};
    sps_context *context = timed_context(&clock);
    const double *rates = context->pace.rates[SPSI_STAGE_CELLS];
    sps_stats_report stats;
    double rate = 0;
    check_scene s;
    start(&s);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.budget_error = 0.5;
    for (int n = 0; n < 4; ++n) {
        s.volume[0].revision = 1 + (uint64_t)(n / 3);
        check_render(context, &s, image);
        sps_get_stats(context, &stats);
        CHECK((stats.cells > 0) == (n % 3 == 0));
        if (n == 0) rate = rates[0];
        CHECK(rate > 0);
        CHECK_NEAR(rates[0], rate, n < 3 ? 0 : 0.1 * rate);
    }
    CHECK_NEAR(stats.budget.seconds, stats.seconds_total, 0.3 * stats.seconds_total);
    sps_destroy(context);
}

/* A clock that jumps backwards, or is no clock, changes neither what is chosen for an error nor that time counts up. */
static void test_jumping_clock(void) {
    static const double jumps[] = {-3600, 0};
    sps_budget_report chosen[3];
    check_scene s;
    start(&s);
    s.view.budget_error = 0.3;
    for (int n = 0; n < 3; ++n) {
        clock_of_tests clock = {0, 0, 0};
        sps_context *context = timed_context(&clock);
        clock.each = n < 2 ? jumps[n] : NAN;
        check_render(context, &s, image);
        chosen[n] = budget_of(context);
        CHECK(chosen[n].is_met && chosen[n].seconds > 0 && chosen[n].quality == chosen[0].quality);
        CHECK(chosen[n].quality == SPS_QUALITY_DRAFT);
        sps_destroy(context);
    }
}

/* What rendering would refuse is not chosen, though it were the most exact: points of a rectangle that lie too near the
   gas for slabs, and slabs beyond number. */
static void test_refused_rungs(void) {
    sps_context *context = check_context(NULL);
    sps_plan_report plan;
    check_scene s;
    int chosen = 0;
    for (double height = 2.2; height < 5; height += 0.1) { /* at one of them, 4 points serve, and 256 do not */
        sps_light *light;
        start(&s);
        s.scene.light_count = 0;
        light = check_add_light(&s, SPS_LIGHT_RECTANGLE, 3);
        light->position[1] = height;
        light->axes[0][0] = light->axes[1][2] = 1;
        light->shadow_source = SPS_SHADOW_SHEETS;
        s.view.quality = SPS_QUALITY_DRAFT, light->samples = 4;
        if (check_try(context, &s, image) != SPS_OK) continue;
        s.view.quality = SPS_QUALITY_DEFAULT, light->samples = 0;
        s.view.budget_error = 0.5;
        chosen += CHECK_OK(context, check_try(context, &s, image));
        break;
    }
    CHECK(chosen == 1);
    start(&s);
    s.scene.light_count = 0;
    s.volume[0].size[0] = s.volume[0].size[1] = s.volume[0].size[2] = 16;
    s.volume[1] = s.volume[0];
    s.scene.volume_count = 2;
    s.volume[0].placement = check_box(-50, -50, -50, 50, 50, 50), s.volume[0].extinction = 0.01f;
    s.volume[1].placement = check_box(-0.001, -0.001, -0.001, 0.001, 0.001, 0.001);
    s.view.camera.position[2] = 300;
    check_orthographic(&s.view.camera, 0.0001);
    s.view.width = s.view.height = 8;
    s.view.budget_seconds = 1e6;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.slab_count > 100000 && plan.slab_count < 1 << 20);
    sps_destroy(context);
}

/* Gas beside the picture, whose shadow lies in it, is part of what is expected. */
static void test_out_of_sight(void) {
    sps_context *context = check_context(NULL);
    const double corner[3] = {-20, -0.5, 20}, u[3] = {40, 0, 0}, v[3] = {0, 0, -40};
    check_triangles floor;
    sps_plan_report plan;
    check_scene s;
    memset(&floor, 0, sizeof floor);
    check_add_quad(&floor, corner, u, v);
    start(&s);
    check_add_mesh(&s, &floor, 0.5);
    s.volume[0].placement = check_box(3, 3, -1, 5, 5, 1);
    check_set3(s.view.camera.position, 0, 10, 0);
    check_set3(s.view.camera.up, 0, 0, -1);
    check_orthographic(&s.view.camera, 2);
    s.view.budget_error = 1e-9;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(!plan.budget.is_met && plan.budget.error > 1e-9);
    check_free_triangles(&floor);
    sps_destroy(context);
}

/* A frame of one pixel teaches rates that hold for whole pictures, too: fixed costs are not those of pixels. */
static void test_small_frames(void) {
    clock_of_tests clock = {0, 1e-5, 0};
    sps_context *context = timed_context(&clock);
    check_scene s;
    start(&s);
    s.view.budget_error = 0.05;
    s.view.region[2] = s.view.region[3] = 1;
    for (int n = 0; n < 2; ++n) check_render(context, &s, image);
    s.view.region[2] = s.view.region[3] = 0;
    check_render(context, &s, image);
    CHECK(budget_of(context).seconds < 0.05); /* by the pixel, it would be a second */
    sps_destroy(context);
}

/* What is held from the last call is not expected to be made again: light in cells, a table. Beside these, reading and
   all of the picture take a tenth by start values. */
static void check_held(check_scene *s) {
    clock_of_tests clock = {0, 0, 0};
    sps_context *context = timed_context(&clock);
    double expected[3];
    s->view.filling = SPS_FILLING_SPLAT; /* nothing else is made to be held */
    for (int n = 0; n < 3; ++n) {
        s->volume[0].revision = 1 + (uint64_t)(n / 2);
        check_render(context, s, image);
        expected[n] = budget_of(context).seconds;
    }
    if (!CHECK(expected[1] < 0.2 * expected[0])) printf("    %g of %g s\n", expected[1], expected[0]);
    CHECK_NEAR(expected[2], expected[0], 0.01 * expected[0]);
    sps_destroy(context);
}

static void test_held(void) {
    check_scene s;
    start(&s);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.budget_error = 0.5;
    check_held(&s);
    start(&s);
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    s.light[0].shadow_map_resolution = 128;
    s.view.budget_error = 0.5;
    check_held(&s);
}

/* A setting of which something is held may be the cheapest of all: it is not taken for as dear as coarser ones that are
   known, nor are these taken for as cheap. */
static void test_held_apart(void) {
    clock_of_tests clock = {0, 0, 0};
    sps_context *context = timed_context(&clock);
    spsi_rates *pace = &context->pace;
    sps_budget_report chosen;
    sps_plan_report plan;
    check_scene s;
    start(&s);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.filling = SPS_FILLING_SPLAT;
    s.volume[0].revision = 1;
    s.view.budget_error = 0.2;
    check_render(context, &s, image);
    chosen = budget_of(context);
    CHECK(chosen.scattering_resolution > 24);
    memcpy(pace->rates, spsi_start_rates, sizeof pace->rates);
    memset(pace->rates[SPSI_STAGE_CACHED], 0, sizeof pace->rates[SPSI_STAGE_CACHED]);
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.budget.scattering_resolution == chosen.scattering_resolution &&
          plan.budget.seconds < 0.2 * chosen.seconds);
    for (int stage = 0; stage < SPSI_STAGE_COUNT; ++stage)
        for (int grade = 0; grade < SPSI_PRESETS; ++grade)
            pace->rates[stage][grade] = grade != spsi_stage_preset((spsi_stage)stage, &pace->setting) ? 0
                                        : stage == SPSI_STAGE_CELLS                                   ? 1e-5
                                                                                                      : 1e-9;
    s.view.budget_error = 0, s.view.budget_seconds = 1e-12;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.budget.scattering_resolution == chosen.scattering_resolution && plan.budget.quality == chosen.quality);
    sps_destroy(context);
}

/* -------------------------------------------------------------------------------------------------- steady choices */

/* Counts work instead of time: samples, shaded pixels and cells, each for a tenth of a microsecond times `slow`, and
   looks at it for as much, so that no stage takes nothing. */
typedef struct work_clock {
    const sps_context *context;
    double slow, looks;
} work_clock;

static double count_work(void *user) {
    work_clock *clock = (work_clock *)user;
    if (!clock->context) return 0;
    clock->looks += 1e-7 * clock->slow;
    const sps_stats_report *stats = &clock->context->stats;
    return clock->looks + clock->slow * 1e-7 *
                              (double)(stats->eye_samples + stats->light_samples + stats->pixels_shaded + stats->cells);
}

static sps_context *working_context(work_clock *clock) {
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.clock_fn = count_work, config.clock_user = clock;
    clock->context = NULL, clock->slow = 1, clock->looks = 0;
    context = sps_create(&config, NULL);
    clock->context = context;
    return context;
}

static int differ(const sps_budget_report *a, const sps_budget_report *b) {
    return a->quality != b->quality || a->slab_thickness < b->slab_thickness || a->slab_thickness > b->slab_thickness ||
           a->tolerance < b->tolerance || a->tolerance > b->tolerance || a->samples != b->samples ||
           a->scattering_resolution != b->scattering_resolution || a->width != b->width || a->height != b->height;
}

enum { LARGE = 32 };
static float large[4 * LARGE * LARGE];

/* A puff that a camera moves around, and what a frame of medium quality takes. */
static double start_moving(check_scene *s, sps_context *context) {
    sps_stats_report stats;
    start(s);
    s->view.width = s->view.height = LARGE;
    s->volume[0].revision = 1;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = 12;
    s->view.quality = SPS_QUALITY_MEDIUM;
    check_render(context, s, large);
    sps_get_stats(context, &stats);
    s->view.quality = SPS_QUALITY_DEFAULT;
    return stats.seconds_total;
}

/* Renders frame n, from a place of its own if `moves`. */
static sps_budget_report moving_frame(check_scene *s, sps_context *context, int n, int moves) {
    if (moves) s->view.camera.position[0] = 1e-3 * (n + 1);
    check_render(context, s, large);
    return budget_of(context);
}

/* What frames from the tenth on take is multiplied. One slow frame changes nothing; slow ones do when two have shown
   it, at once and then not for 20 frames, though seconds are missed, and nothing at all where nothing moves. Fast ones
   buy less error as soon as two have shown it, and the slowest setting 20 frames after that. */
static void test_left(void) {
    static const struct {
        int moves, ends; /* the frame from which on all is as before */
        double slow;
        int changes, first, second; /* how many in 60 frames, and where */
    } runs[] = {{1, 60, 1, 0, 0, 0}, {1, 11, 8, 0, 0, 0},     {1, 12, 8, 2, 12, 32},  {1, 60, 3, 1, 12, 0},
                {0, 60, 3, 0, 0, 0}, {1, 60, 0.2, 2, 12, 32}, {0, 60, 0.2, 2, 12, 32}};
    for (int k = 0; k < 7; ++k) {
        work_clock clock;
        sps_context *context = working_context(&clock);
        sps_budget_report last, now;
        int changes = 0, at[60] = {0};
        check_scene s;
        s.view.budget_seconds = 0;
        const double seconds = start_moving(&s, context);
        s.view.budget_seconds = 1.5 * seconds;
        for (int n = 0; n < 60; ++n) {
            clock.slow = n < 10 || n >= runs[k].ends ? 1 : runs[k].slow;
            now = moving_frame(&s, context, n, runs[k].moves);
            if (n > 3 && differ(&now, &last)) at[changes++] = n;
            if (n > 3 && differ(&now, &last) && runs[k].slow < 1) CHECK(now.error <= 0.9 * last.error);
            last = now;
        }
        if (!CHECK(changes == runs[k].changes && at[0] == runs[k].first && at[1] == runs[k].second))
            printf("    run %d: %d changes, at %d, %d\n", k, changes, at[0], at[1]);
        sps_destroy(context);
    }
}

/* Time that jitters by chance, as much as by half: at most one change in 20 frames, and the same whoever is asked in
   between, and though calls fail. */
static void test_steady(void) {
    sps_budget_report seen[2][100];
    for (int between = 0; between < 2; ++between) {
        work_clock clock;
        sps_context *context = working_context(&clock);
        uint32_t state = 5;
        int changed = 0, changes = 0;
        sps_plan_report plan;
        check_scene s;
        const double seconds = start_moving(&s, context);
        s.view.budget_seconds = 1.2 * seconds;
        for (int n = 0; n < 100; ++n) {
            state = state * 1664525u + 1013904223u;
            clock.slow = 0.7 + 0.8 * (double)(state >> 8) / 16777216;
            seen[between][n] = moving_frame(&s, context, n, 1);
            if (n > 3 && differ(&seen[between][n], &seen[between][n - 1])) {
                CHECK(changes == 0 || n - changed >= 20);
                changed = n, changes += 1;
            }
            if (!between) continue;
            CHECK(n < 4 || !differ(&plan.budget, &seen[1][n]));
            s.view.camera.position[0] = 1e-3 * (n + 2);
            CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
            s.view.near_distance = -1;
            check_fails(context, &s, large, SPS_ERROR_ARGUMENT, "view.near_distance");
            s.view.near_distance = 0;
            CHECK(!differ(&seen[0][n], &seen[1][n]));
        }
        CHECK(changes <= 5);
        sps_destroy(context);
    }
}

/* Another budget, size or scene begins anew; what is rendered without a budget neither depends on frames before it nor
   changes what follows. */
static void test_asked_anew(void) {
    static float plain[4 * LARGE * LARGE];
    work_clock clock;
    sps_context *context = working_context(&clock);
    const spsi_rates *pace = &context->pace;
    check_scene s;
    const double seconds = start_moving(&s, context);
    s.view.budget_seconds = 2 * seconds;
    for (int n = 0; n < 5; ++n) moving_frame(&s, context, n, 1);
    CHECK(pace->frames == 3);
    s.view.budget_seconds = 0;
    check_render(context, &s, large);
    check_render_plain(&s, plain);
    CHECK(check_same(&s, large, plain) && pace->frames == 3);
    for (int k = 0; k < 6; ++k) {
        s.view.budget_seconds = 2 * seconds;
        for (int n = 0; n < 4; ++n) moving_frame(&s, context, n, 1);
        CHECK(pace->frames == 3);
        if (k == 0) s.view.budget_seconds = 3 * seconds;
        if (k == 1) s.view.budget_scale_min = 0.9;
        if (k == 2) s.view.width -= 1;
        if (k == 3) s.view.region[2] = s.view.region[3] = 5, s.view.budget_scale_min = 0;
        if (k == 4) check_add_directional(&s, -0.4, -1, -0.5, 3);
        if (k == 5) s.scene.volume_count = 0;
        moving_frame(&s, context, 0, 1);
        CHECK(pace->frames == 1);
    }
    sps_destroy(context);
}

/* In a kept setting, what all stages of a tenth of the frame or more share scales the rates of other settings: not what
   one shows alone, nor a small one. */
static void test_shared_changes(void) {
    enum { OWN = 2, OTHER = 4, STAGES = 3 };
    static const spsi_stage stages[STAGES] = {SPSI_STAGE_LIGHT, SPSI_STAGE_EYE, SPSI_STAGE_REST};
    static const struct {
        int steady, spare;
        double slow[STAGES], shared; /* factors of time; on other settings' rates */
    } cases[] = {{1, 0, {2, 3, 4}, 2},   {1, 0, {0.25, 0.5, 0.5}, 0.5}, {1, 0, {1, 3, 1}, 1}, {1, 0, {0.5, 3, 1}, 1},
                 {1, 0, {2, 2, 0.9}, 2}, {0, 0, {2, 3, 4}, 1},          {0, 1, {2, 3, 4}, 1}, {1, 1, {1, 3, 1}, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        static spsi_rates pace;
        double seconds[SPSI_STAGE_COUNT] = {0};
        memset(&pace, 0, sizeof pace);
        pace.setting.gas = OWN;
        for (int frame = 0; frame < 3; ++frame) {
            double total = 0;
            for (int k = 0; k < STAGES; ++k) {
                const double slow = frame == 0 ? 1 : cases[i].slow[k];
                pace.work.units[stages[k]] = 100;
                if (frame == 0) pace.rates[stages[k]][OTHER] = 5 + k;
                seconds[stages[k]] = slow * (k < 2 ? 1 : 0.1);
                total += seconds[stages[k]];
            }
            spsi_rates_store(&pace, seconds, total, frame > 0 && cases[i].steady, frame > 0 && cases[i].spare);
        }
        for (int k = 0; k < STAGES; ++k) {
            CHECK_NEAR(pace.rates[stages[k]][OWN], cases[i].slow[k] * (k < 2 ? 0.01 : 0.001), 1e-9);
            CHECK_NEAR(pace.rates[stages[k]][OTHER], cases[i].shared * (5 + k), 1e-9);
        }
        CHECK(pace.rates[SPSI_STAGE_CELLS][OTHER] <= 0); /* did not run */
    }
}

/* Margins: of two settings, the new one must have a tenth less error, or take a tenth less time. */
static void test_margins(void) {
    static const struct {
        int timed, still, wait, kept;
        double seconds[2], error[2]; /* of the setting that is held, and of the best */
    } cases[] = {{1, 0, 0, 1, {1, 1}, {0.1, 0.0901}},   {1, 0, 0, 0, {1, 1}, {0.1, 0.0899}},
                 {1, 0, 1, 1, {1, 1}, {0.1, 0.0899}},   {1, 0, 0, 0, {2.01, 1}, {0.1, 0.2}},
                 {1, 0, 1, 1, {2.01, 1}, {0.1, 0.2}},   {1, 1, 0, 1, {2.01, 1}, {0.1, 0.2}},
                 {1, 1, 0, 0, {2.01, 1}, {0.1, 0.099}}, {1, 1, 0, 0, {1, 1}, {0.1, 0.08}},
                 {0, 0, 0, 1, {1, 0.901}, {0.1, 0.1}},  {0, 0, 0, 0, {1, 0.899}, {0.1, 0.1}},
                 {0, 1, 0, 1, {1, 0.5}, {0.1, 0.1}},    {0, 0, 1, 1, {1, 0.5}, {0.1, 0.1}},
                 {0, 0, 1, 0, {1, 2}, {0.31, 0.1}},     {0, 1, 1, 0, {1, 2}, {0.31, 0.1}}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        static spsi_rates pace;
        spsi_candidate two[2];
        sps_view view;
        memset(&view, 0, sizeof view);
        memset(two, 0, sizeof two);
        if (cases[i].timed) view.budget_seconds = 2;
        if (!cases[i].timed) view.budget_error = 0.3;
        pace.wait = cases[i].wait;
        pace.shown[0] = 5, pace.shown[1] = cases[i].still ? 5 : 6;
        for (int k = 0; k < 2; ++k)
            two[k].exists = 1, two[k].seconds = cases[i].seconds[k], two[k].error = cases[i].error[k];
        if (!CHECK(spsi_budget_keeps(&pace, &view, &two[0], &two[1]) == cases[i].kept)) printf("    case %d\n", (int)i);
        pace.shown[0] = pace.shown[1] = 0; /* unknown: it may move */
        if (cases[i].timed && cases[i].still && cases[i].error[1] > 0.1)
            CHECK(!spsi_budget_keeps(&pace, &view, &two[0], &two[1]));
        for (int k = 0; k < 2 && cases[i].timed; ++k) { /* if the best misses, too, it must be a tenth faster */
            two[0].seconds = two[0].charge = 3, two[1].charge = k ? 2.71 : 2.69;
            pace.wait = 0;
            CHECK(spsi_budget_keeps(&pace, &view, &two[0], &two[1]) == k);
        }
        two[0].exists = 0; /* rendering would refuse it now */
        CHECK(!spsi_budget_keeps(&pace, &view, &two[0], &two[1]));
    }
}

/* Seconds are spared: a tenth, and as much again where a finer setting was not measured. In the second frame and from
   the fourth on, cells that will be held count half, or a quarter where nothing moves or to leave a miss for a setting
   that is a tenth faster; not if cells are made in each frame. */
static void test_spared(void) {
    static spsi_candidate list[SPSI_CANDIDATES];
    static spsi_rates pace;
    sps_view view;
    memset(&view, 0, sizeof view);
    for (int frames = 0; frames < 4; ++frames)
        for (int state = 0; state < 3; ++state) { /* moves, is still, misses */
            const int makes = frames % 2 == 1, most = frames == 3 && state > 0;
            memset(list, 0, sizeof list);
            list[0].seconds = 1, list[0].is_held = list[0].is_known = 1;
            list[1].seconds = 2, list[1].making = 0.5, list[1].is_known = 1;
            list[2].seconds = 2, list[2].making = 1.9;
            list[4].seconds = 2, list[4].making = 1.9, list[4].is_known = 1;
            list[0].error = 3, list[2].error = 2, list[3].error = 4, list[3].seconds = 1;
            pace.shown[0] = 5, pace.shown[1] = state == 1 ? 5 : 6;
            view.budget_seconds = state == 2 ? 0.99 : 1;
            spsi_candidates_charge(&pace, &view, frames, list);
            CHECK_NEAR(list[0].charge, 1.1, 1e-12);
            CHECK_NEAR(list[3].charge, 1.1, 1e-12);
            CHECK_NEAR(list[1].charge, 1.1 * (makes ? 1.5 : 2), 1e-12);
            CHECK_NEAR(list[4].charge, most ? 0.55 : makes ? 1.1 : 2.2, 1e-12);
            CHECK_NEAR(list[2].charge, list[4].charge / 1.1 * (frames == 3 ? 2 : 1.1), 1e-12);
            list[4].making = 1.09; /* as slow as what misses, within a tenth: not worth a quarter */
            spsi_candidates_charge(&pace, &view, frames, list);
            CHECK_NEAR(list[4].charge, most && state == 1 ? 1.001 : makes ? 1.1 : 2.2, 1e-12);
            list[0].making = 0.5;
            spsi_candidates_charge(&pace, &view, frames, list);
            CHECK_NEAR(list[1].charge, 2.2, 1e-12);
            list[0].making = 0, list[0].is_held = 0;
            spsi_candidates_charge(&pace, &view, frames, list);
            CHECK_NEAR(list[1].charge, 2.2, 1e-12);
        }
}

/* Cells that take two and a half times the budget to make, as an earlier budget has shown: in motion, they are not
   made; where nothing moves, they are. Then they are held in motion, too. */
static void test_made_when_still(void) {
    work_clock clock;
    sps_context *context = working_context(&clock);
    sps_budget_report now;
    sps_stats_report stats;
    check_scene s;
    start_moving(&s, context);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.budget_seconds = 0.03; /* a cell takes 1e-7 s; all else 1e-3 s */
    for (int n = 0; n < 3; ++n) now = moving_frame(&s, context, n, 1);
    CHECK(now.scattering_resolution == 48);
    s.volume[0].revision = 2;
    s.view.budget_seconds = 0.4 * 1e-7 * 48 * 48 * 48;
    for (int n = 0; n < 30; ++n) {
        now = moving_frame(&s, context, n, n < 10 || n > 20);
        sps_get_stats(context, &stats);
        CHECK(now.scattering_resolution == (n < 10 ? 24 : 48));
        if (n != 1 && n != 2) CHECK((stats.cells > 0) == (n == 0 || n == 10)); /* they may try another quality */
    }
    sps_destroy(context);
}

/* An error is kept in each frame, however fast the gas shrinks before black: finer settings come at once. */
static void test_error_promised(void) {
    work_clock clock;
    sps_context *context = working_context(&clock);
    int changes = 0;
    sps_budget_report last, now;
    check_scene s;
    start_moving(&s, context);
    s.view.budget_error = 0.12;
    for (int n = 0; n < 20; ++n) {
        check_orthographic(&s.view.camera, 2.5 * pow(1.12, n));
        now = moving_frame(&s, context, n, 1);
        CHECK(now.is_met && now.error <= 0.12);
        if (n > 0) changes += differ(&now, &last);
        last = now;
    }
    CHECK(changes >= 2);
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------- smaller pictures */

static void test_scale_refused(void) {
    sps_context *context = check_context(NULL);
    static const double bad[] = {-1, -1e-300, 1.000001, HUGE_VAL, NAN};
    check_scene s;
    for (int i = 0; i < 9; ++i) {
        start(&s);
        s.view.budget_seconds = 1;
        s.view.budget_scale_min = i < 5 ? bad[i] : 1;
        if (i == 5) s.view.budget_seconds = 0;
        if (i == 6) s.view.budget_seconds = 0, s.view.budget_error = 0.5;
        if (i == 7) s.view.region[2] = s.view.region[3] = SIZE;
        if (i < 8)
            check_fails(context, &s, image, SPS_ERROR_ARGUMENT, "up to 1 with budget_seconds and without region");
        else
            CHECK_OK(context, check_try(context, &s, image));
        if (i < 8) CHECK(strstr(sps_error(context), "view.budget_scale_min is ") != NULL);
    }
    sps_destroy(context);
}

enum { WIDE = 31, HIGH = 17, PITCH = 33, ROOM = PITCH * HIGH };

/* Renders into rows of PITCH pixels, of which the rest keeps its mark. */
static void render_marked(sps_context *context, const check_scene *s, size_t row_pixels, float *rgba, float *depth) {
    sps_image into;
    memset(&into, 0, sizeof into);
    into.rgba = rgba, into.depth = depth, into.row_pixels = row_pixels;
    for (int i = 0; i < 5 * ROOM; ++i) *(i < 4 * ROOM ? rgba + i : depth + i - 4 * ROOM) = -7;
    CHECK_OK(context, sps_render(context, &s->scene, &s->view, &into));
}

/* A picture that a budget shrinks has the bits of that size rendered by hand, at the top left, depths too; nothing else
   is written. Cameras of all kinds, edges of polygons, and gas that scatters more than once. */
static void test_shrunk(void) {
    static float small[5 * ROOM], by_hand[5 * ROOM];
    static const double matrix[16] = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, -1.1, 4, 0, 0, -1, 4};
    static const struct {
        double scale;
        int width, height;
    } sizes[] = {{0.5, 16, 9}, {1e-300, 1, 1}, {0.3, 10, 6}, {1, WIDE, HIGH}, {0, WIDE, HIGH}};
    check_triangles floor;
    const double corner[3] = {-2, -1, -1}, u[3] = {4, 0, 0}, v[3] = {0, 3, -1};
    memset(&floor, 0, sizeof floor);
    check_add_quad(&floor, corner, u, v);
    for (int n = 0; n < 15; ++n) {
        sps_context *context = check_context(NULL);
        sps_budget_report chosen;
        sps_plan_report plan;
        check_scene s, hand;
        const size_t row = n % 2 ? PITCH : 0;
        start(&s);
        s.view.width = WIDE, s.view.height = HIGH;
        if (n % 3 == 1) s.view.camera.ortho_height = 0, s.view.camera.field_of_view = 0.8;
        if (n % 3 == 2) s.view.camera.ortho_height = 0, s.view.camera.world_to_clip = matrix;
        if (n % 4 == 1) check_add_mesh(&s, &floor, 0.5), s.view.coverage_samples = 3;
        if (n % 4 == 3) s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.budget_seconds = 1e-9, s.view.budget_scale_min = sizes[n % 5].scale;
        render_marked(context, &s, row, small, small + 4 * ROOM);
        chosen = budget_of(context);
        CHECK(chosen.width == sizes[n % 5].width && chosen.height == sizes[n % 5].height);
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.budget.width == chosen.width && plan.budget.height == chosen.height);
        hand = s;
        hand.scene.volumes = hand.volume, hand.scene.lights = hand.light, hand.scene.meshes = hand.mesh;
        hand.view.budget_seconds = hand.view.budget_scale_min = 0;
        hand.view.width = chosen.width, hand.view.height = chosen.height;
        hand.view.quality = chosen.quality, hand.view.slab_thickness = chosen.slab_thickness;
        hand.view.tolerance = chosen.tolerance, hand.view.scattering_resolution = chosen.scattering_resolution;
        render_marked(context, &hand, row ? row : WIDE, by_hand, by_hand + 4 * ROOM);
        if (!CHECK(memcmp(small, by_hand, sizeof small) == 0)) printf("    case %d\n", n);
        sps_destroy(context);
    }
    check_free_triangles(&floor);
}

/* More seconds buy larger pictures, up to the whole; never one below the least. */
static void test_sizes(void) {
    sps_context *context = check_context(NULL);
    int seen[5] = {0};
    sps_plan_report plan;
    check_scene s;
    start(&s);
    s.view.width = 400, s.view.height = 300;
    s.view.budget_scale_min = 0.25;
    for (double seconds = 1e-5; seconds < 10; seconds *= 1.1) {
        s.view.budget_seconds = seconds;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        for (int k = 0; k < 5; ++k)
            if (plan.budget.width == (int)ceil(400 * pow(0.25, k / 4.0)))
                seen[k] += CHECK(plan.budget.height == (int)ceil(300 * pow(0.25, k / 4.0)));
        CHECK(!plan.budget.is_met || plan.budget.seconds <= seconds);
    }
    CHECK(seen[0] > 0 && seen[1] + seen[2] + seen[3] > 0 && seen[4] > 0);
    CHECK(plan.budget.width == 400 && plan.budget.height == 300);
    sps_destroy(context);
}

/* What enlarging is off by counts: nothing for the whole, and as the ratio of sizes less 1. */
static void test_blur(void) {
    sps_context *context = check_context(NULL);
    sps_plan_report plan[3];
    check_scene s;
    start(&s);
    s.scene.volume_count = 0;
    s.view.width = s.view.height = 400;
    s.view.budget_seconds = 1e-9;
    for (int n = 0; n < 3; ++n) {
        s.view.budget_scale_min = n == 0 ? 0 : n == 1 ? 0.5 : 0.2;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan[n]));
    }
    CHECK_NEAR(plan[0].budget.error, 0, 0);
    CHECK_NEAR(plan[1].budget.error, 0.11, 1e-9);
    CHECK_NEAR(plan[2].budget.error, 4 * 0.11, 1e-9);
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------------- failures */

static void test_failures(void) {
    check_scene s;
    start(&s);
    s.light[0].angular_diameter = 0.2;
    s.view.budget_error = 0.5;
    CHECK(check_failing(&s, 0, check_long() ? 0 : 4, image, exact) > 10);
    CHECK(check_failing(&s, 1, 2, image, exact) > 3);
    check_workers(&s, image, exact);
    s.light[0].angular_diameter = 0;
    s.view.budget_error = 0, s.view.budget_seconds = 1e-9, s.view.budget_scale_min = 0.6;
    for (int i = 0; i < COUNT; ++i) image[i] = exact[i] = 0; /* what is not written */
    CHECK(check_failing(&s, 0, check_long() ? 0 : 8, image, exact) > 10);
    check_workers(&s, image, exact);
}

/* Scenes that lack what ladders are about, and ones of a pixel: budgets of both kinds show what the reported settings
   show, and a slope, whose normal is (0, 1, 3), is as bright as theory has it. */
static void test_little(void) {
    sps_context *context = check_context(NULL);
    check_triangles floor;
    const double corner[3] = {-2, -1, -1}, u[3] = {4, 0, 0}, v[3] = {0, 3, -1};
    const double slope = 0.5 / PI * 3 * (1 + 3 * 0.5) / sqrt(10 * (0.4 * 0.4 + 1 + 0.5 * 0.5));
    check_scene s;
    memset(&floor, 0, sizeof floor);
    check_add_quad(&floor, corner, u, v);
    for (int n = 0; n < 6; ++n) {
        start(&s);
        if (n == 0) s.scene.volume_count = 0;
        if (n == 1) s.scene.volume_count = s.scene.light_count = 0;
        if (n == 2) s.scene.volume_count = 0, check_add_mesh(&s, &floor, 0.5);
        if (n == 3) s.view.width = s.view.height = 1;
        if (n == 4) s.scene.volume_count = 0, check_add_swarm(&s, 1);
        if (n == 5) check_add_mesh(&s, &floor, 0.5);
        s.view.budget_error = 0.5;
        CHECK_OK(context, check_try(context, &s, image));
        CHECK(budget_of(context).is_met);
        if (n < 3) CHECK(!(budget_of(context).error > 0)); /* nothing but what is exact */
        for (int timed = 0; timed < 2; ++timed) {
            const sps_budget_report chosen = budget_of(context);
            render_chosen(&s, &chosen, exact);
            if (!CHECK(check_same(&s, image, exact))) printf("    scene %d, %s\n", n, timed ? "seconds" : "error");
            for (int i = 0; i < COUNT && n < 3; ++i) /* a dozen roundings of 6e-8 */
                CHECK_NEAR((double)image[i], n < 2 ? 0 : i % 4 == 3 ? 1 : slope, 1e-6);
            s.view.budget_error = 0, s.view.budget_seconds = 1e-3;
            if (!timed) CHECK_OK(context, check_try(context, &s, image));
        }
    }
    check_free_triangles(&floor);
    sps_destroy(context);
}

int main(void) {
    RUN(test_refused);
    RUN(test_errors);
    RUN(test_rungs);
    RUN(test_choices);
    RUN(test_covered);
    RUN(test_kept);
    RUN(test_balls_kept);
    RUN(test_depth_of_balls);
    RUN(test_unmet);
    RUN(test_own_samples);
    RUN(test_seconds);
    RUN(test_learning);
    RUN(test_order);
    RUN(test_splatted);
    RUN(test_held_rates);
    RUN(test_jumping_clock);
    RUN(test_refused_rungs);
    RUN(test_out_of_sight);
    RUN(test_small_frames);
    RUN(test_held);
    RUN(test_held_apart);
    RUN(test_left);
    RUN(test_steady);
    RUN(test_asked_anew);
    RUN(test_shared_changes);
    RUN(test_margins);
    RUN(test_spared);
    RUN(test_made_when_still);
    RUN(test_error_promised);
    RUN(test_scale_refused);
    RUN(test_shrunk);
    RUN(test_sizes);
    RUN(test_blur);
    RUN(test_failures);
    RUN(test_little);
    return check_report();
}
