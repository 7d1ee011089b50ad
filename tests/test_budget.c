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

/* --------------------------------------------------------------------------------------------------------- failures */

static void test_failures(void) {
    check_scene s;
    start(&s);
    s.light[0].angular_diameter = 0.2;
    s.view.budget_error = 0.5;
    CHECK(check_failing(&s, 0, check_long() ? 0 : 4, image, exact) > 10);
    CHECK(check_failing(&s, 1, 2, image, exact) > 3);
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
    RUN(test_failures);
    RUN(test_little);
    return check_report();
}
