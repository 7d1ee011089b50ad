/* Effects that a scene does not call for cost it nothing: the lists of tests/measure/effects_scenes.h at a small size. What
   is compared is counted, never timed. */

#include "check.h"
#include "measure/effects_scenes.h"

enum {
    SMALL_VOXELS = 20,
    SMALL_WIDTH = 40,
    SMALL_HEIGHT = SMALL_WIDTH * 3 / 4,
    FLOATS = 4 * SMALL_WIDTH * SMALL_HEIGHT
};

/* What the last frame of a stage did. */
typedef struct outcome {
    sps_plan_report plan;
    sps_stats_report stats;
    float rgba[FLOATS], depth[SMALL_WIDTH * SMALL_HEIGHT];
    long allocations; /* from the context's beginning */
    size_t peak;
} outcome;

static ex_stage stage;

/* Plans and renders the stage; counts are 0 after a failure. */
static void render_stage(sps_context *context, outcome *out) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = out->rgba;
    if (stage.wants_depth) image.depth = out->depth;
    for (int frame = 0; frame == 0 || frame < stage.frames; ++frame) {
        CHECK_OK(context, sps_plan(context, &stage.scene, &stage.view, &out->plan));
        CHECK_OK(context, sps_render(context, &stage.scene, &stage.view, &image));
    }
    sps_get_stats(context, &out->stats);
}

static void set_stage(ex_change common, ex_change change) {
    ex_stage_set(&stage, SMALL_VOXELS, SMALL_WIDTH, common, change);
}

/* In a context of its own. */
static void measure(ex_change common, ex_change change, outcome *out) {
    check_hooks hooks;
    sps_context *context;
    memset(&hooks, 0, sizeof hooks);
    memset(out, 0, sizeof *out);
    context = check_context(&hooks);
    set_stage(common, change);
    render_stage(context, out);
    out->allocations = hooks.allocations, out->peak = hooks.peak;
    sps_destroy(context);
    CHECK(hooks.live == 0);
}

static int same_bits(const outcome *a, const outcome *b) { return memcmp(a->rgba, b->rgba, sizeof a->rgba) == 0; }

static int same_memory(const outcome *a, const outcome *b) {
    return a->allocations == b->allocations && a->peak == b->peak && a->stats.bytes == b->stats.bytes &&
           a->stats.bytes_peak == b->stats.bytes_peak;
}

/* Each effect shows, its pass runs only with it, and a context that has rendered it does no more for a scene without it
   than a new one. Allocations are not compared there: what is held is used again. */
static void test_left_out(void) {
    static outcome without, with, after;
    for (int i = 0; i < EX_COUNT(ex_effects); ++i) {
        const ex_effect *effect = &ex_effects[i];
        sps_context *context = check_context(NULL);
        int good = 1;
        measure(effect->common, NULL, &without);
        set_stage(effect->common, effect->with);
        render_stage(context, &with);
        good &= CHECK(stage.wants_depth || !same_bits(&without, &with));
        if (effect->pass >= 0)
            good &= CHECK(without.plan.pass[effect->pass].runs == 0 && without.plan.pass[effect->pass].bytes == 0 &&
                          with.plan.pass[effect->pass].runs > 0);
        set_stage(effect->common, NULL);
        render_stage(context, &after);
        without.stats.allocations = after.stats.allocations;
        good &= CHECK(ex_same_counts(&without.stats, &after.stats) && same_bits(&without, &after));
        if (!good) printf("    %s\n", effect->name);
        sps_destroy(context);
    }
}

/* What is set although nothing needs it: nothing is spent where the library can know. Otherwise the picture has the
   same bits, or is rounded otherwise, by a half ulp of 1 in each of 16 sums and products: those of the few layers,
   weights or points by which the ways of computing it differ. */
static void test_not_needed(void) {
    static outcome never, set;
    for (int i = 0; i < EX_COUNT(ex_unneeded_effects); ++i) {
        const ex_unneeded *effect = &ex_unneeded_effects[i];
        int good = 1;
        if (effect->expectation == EX_OTHER) continue;
        measure(effect->common, NULL, &never);
        measure(effect->common, effect->set, &set);
        if (effect->expectation == EX_ROUNDING)
            good &= CHECK_NEAR(check_largest(never.rgba, set.rgba, FLOATS), 0, effect->allowed);
        else
            good &= CHECK(same_bits(&never, &set));
        if (effect->expectation == EX_UNTOUCHED) {
            good &= CHECK(ex_same_plans(&never.plan, &set.plan));
            good &= CHECK(ex_same_counts(&never.stats, &set.stats));
            good &= CHECK(same_memory(&never, &set));
        }
        if (!good) printf("    %s\n", effect->name);
    }
}

/* What is left out because it is known does not change a bit, and less is called and made. */
static void test_known(void) {
    static outcome all, less;
    for (int i = 0; i < EX_COUNT(ex_savings); ++i) {
        measure(ex_savings[i].common, NULL, &all);
        measure(ex_savings[i].common, ex_savings[i].set, &less);
        if (!CHECK(same_bits(&all, &less) &&
                   less.stats.read_calls + less.stats.triangle_calls < all.stats.read_calls + all.stats.triangle_calls))
            printf("    %s\n", ex_savings[i].name);
        CHECK(less.stats.tables_made == 0 && less.stats.cells == 0);
    }
}

static void add_both(ex_stage *s) {
    ex_add_mesh_behind(s);
    ex_add_sail(s);
}

/* A light has a depth map only if an opaque polygon, be it the last one, reaches into its way through the gas. */
static void test_depth_maps(void) {
    static const ex_change changes[4] = {ex_add_mesh_behind, ex_add_clear_pane, ex_add_sail, add_both};
    static outcome out;
    for (int i = 0; i < 4; ++i) {
        sps_context *context = check_context(NULL);
        set_stage(NULL, changes[i]);
        render_stage(context, &out);
        CHECK((context->buffers[SPSI_BUFFER_DEPTH_MAPS].size > sizeof(float)) == (i >= 2));
        sps_destroy(context);
    }
}

int main(void) {
    RUN(test_left_out);
    RUN(test_not_needed);
    RUN(test_known);
    RUN(test_depth_maps);
    return check_report();
}
