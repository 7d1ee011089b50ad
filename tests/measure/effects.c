/* effects: what each effect costs, that a scene without it costs nothing of it, that an effect which is set although
   nothing needs it leaves the picture as it is, and what skips by a bound leave out. Prints Markdown. */

#include "measuring.h"
#include "effects_scenes.h"
#include <time.h>

static const char program[] = "effects";

enum { VOXELS = 64, WIDTH = 256, ROUNDS = 15 };

static int failures;

/* =============================================================================================== measuring */

/* A stage, and what its last frame did, in a context of its own with one worker. */
typedef struct trial {
    ex_stage stage;
    ex_session session;
    sps_plan_report plan;
    sps_stats_report stats;
    float *rgba, *depth;
    double seconds; /* least of a race */
} trial;

static size_t trial_pixels(const trial *t) { return (size_t)t->stage.view.width * (size_t)t->stage.view.height; }

/* Returns the processor time, since nobody else's work is part of it. */
static double trial_render(trial *t) {
    sps_image image = {.rgba = t->rgba, .depth = t->stage.wants_depth ? t->depth : NULL};
    const clock_t start = clock();
    ex_stop_unless_ok(sps_render(t->session.context, &t->stage.scene, &t->stage.view, &image), program, &t->session);
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

/* Plans and renders a stage that has been set. */
static void trial_run(trial *t) {
    t->rgba = (float *)ex_allocate(trial_pixels(t), 4 * sizeof(float));
    t->depth = (float *)ex_allocate(trial_pixels(t), sizeof(float));
    ex_session_measure(&t->session, program, 1);
    for (int frame = 0; frame == 0 || frame < t->stage.frames; ++frame) {
        ex_stop_unless_ok(sps_plan(t->session.context, &t->stage.scene, &t->stage.view, &t->plan), program,
                          &t->session);
        trial_render(t);
    }
    sps_get_stats(t->session.context, &t->stats);
}

static void trial_begin(trial *t, ex_change common, ex_change change) {
    ex_stage_set(&t->stage, VOXELS, WIDTH, common, change);
    trial_run(t);
}

static void trial_end(trial *t) {
    ex_session_end(&t->session);
    free(t->rgba);
    free(t->depth);
}

/* Times both in turns, a b b a. The least of each is taken: whatever else the machine does only adds to it. */
static double trial_race(trial *a, trial *b) {
    a->seconds = b->seconds = HUGE_VAL;
    for (int round = 0; round < 2 * ROUNDS; ++round) {
        trial *next = (round + round / 2) % 2 ? b : a;
        next->seconds = fmin(next->seconds, trial_render(next));
    }
    return b->seconds / a->seconds;
}

static int trial_same_bits(const trial *a, const trial *b) {
    return memcmp(a->rgba, b->rgba, 4 * sizeof(float) * trial_pixels(a)) == 0;
}

static double trial_difference(const trial *a, const trial *b) {
    double largest = 0;
    for (size_t i = 0; i < 4 * trial_pixels(a); ++i)
        largest = fmax(largest, fabs((double)a->rgba[i] - (double)b->rgba[i]));
    return largest;
}

/* ================================================================================================ printing */

static void print_count(double count) {
    if (count < 10000)
        printf("%.0f", count);
    else if (count < 1e6)
        printf("%.0f k", 1e-3 * count);
    else
        printf("%.1f M", 1e-6 * count);
}

static void print_change(const char *name, double before, double after, int *listed) {
    printf("%s%s ", (*listed)++ ? ", " : "", name);
    print_count(before);
    printf(" → ");
    print_count(after);
}

/* Passes that do not run as often in both. */
static void print_passes(const trial *a, const trial *b) {
    int listed = 0;
    for (int i = 0; i < SPS_PASS_COUNT; ++i) {
        const int before = a->plan.pass[i].runs, after = b->plan.pass[i].runs;
        if (after == before) continue;
        printf("%s%s", listed++ ? ", " : "", sps_pass_name((sps_pass)i));
        if (before > 0) printf(" %d → %d", before, after);
    }
    if (a->plan.color_channels != b->plan.color_channels)
        print_change("channels of color", a->plan.color_channels, b->plan.color_channels, &listed);
    printf(" | ");
}

/* Counts that differ by more than a fiftieth. */
static void print_counts(const trial *a, const trial *b, ex_counter_kind kind) {
    int listed = 0;
    for (int i = 0; i < EX_COUNT(ex_counters); ++i) {
        const double before = (double)ex_counted(&a->stats, i), after = (double)ex_counted(&b->stats, i);
        if (ex_counters[i].kind == kind && fabs(after - before) > 0.02 * before)
            print_change(ex_counters[i].name, before, after, &listed);
    }
    printf(" | ");
}

static void print_costs(trial *a, trial *b) {
    print_counts(a, b, EX_WORK);
    print_counts(a, b, EX_CALLS_OF);
    printf("%.2f → %.2f | ", 1e-6 * (double)a->stats.bytes_peak, 1e-6 * (double)b->stats.bytes_peak);
    printf("%.2f |\n", trial_race(a, b));
}

/* ============================================================================================= the tables */

static void print_effects(void) {
    int apart = 0, passes = 0;
    printf("## With and without\n\n");
    printf("Left of each arrow is the scene without the effect, right of it the scene with it. Counts that differ by "
           "less than\n2 %% are left out. Passes are planned ones. MB is peak memory without the image. "
           "Time is with / without.\n\n");
    printf("| effect | set by | passes | counts | calls | MB at most | time |\n|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < EX_COUNT(ex_effects); ++i) {
        const ex_effect *effect = &ex_effects[i];
        trial without, with;
        trial_begin(&without, effect->common, NULL);
        trial_begin(&with, effect->common, effect->with);
        if (effect->pass >= 0) {
            apart += without.plan.pass[effect->pass].runs == 0 && with.plan.pass[effect->pass].runs > 0;
            passes += 1;
        }
        printf("| %s | %s | ", effect->name, effect->field);
        print_passes(&without, &with);
        print_costs(&without, &with);
        trial_end(&without);
        trial_end(&with);
    }
    failures += apart < passes;
    printf("\nOf %d effects, %d have a pass of their own. It is left out without the effect in %d of %d.\n\n",
           EX_COUNT(ex_effects), passes, apart, passes);
}

/* Effects that the library recognises as unneeded. */
static void print_recognised(void) {
    int same = 0, count = 0;
    printf("## Set, not needed, and recognised\n\n");
    printf("Each scene is compared with the scene that never had the effect: calls, passes, counts, bytes, "
           "allocations, and the pictures bit by bit. Time is set / never set.\n\n");
    printf("| what is set | what is done | picture | time |\n|---|---|---|---|\n");
    for (int i = 0; i < EX_COUNT(ex_unneeded_effects); ++i) {
        const ex_unneeded *effect = &ex_unneeded_effects[i];
        trial never, set;
        if (effect->expectation != EX_UNTOUCHED) continue;
        trial_begin(&never, effect->common, NULL);
        trial_begin(&set, effect->common, effect->set);
        const int work = ex_same_counts(&never.stats, &set.stats) && ex_same_plans(&never.plan, &set.plan) &&
                         never.stats.bytes_peak == set.stats.bytes_peak;
        const int bits = trial_same_bits(&never, &set);
        printf("| %s | %s | %s | %.2f |\n", effect->name, work ? "the same" : "**not the same**",
               bits ? "the same bits" : "**not the same**", trial_race(&never, &set));
        same += work && bits, count += 1;
        trial_end(&never);
        trial_end(&set);
    }
    failures += same < count;
    printf("\n%d of %d cost nothing and leave the picture unchanged.\n\n", same, count);
}

/* The difference of the pictures, and what it may be. Returns whether it is no more. */
static int print_expectation(const ex_unneeded *effect, const trial *never, const trial *set) {
    const double difference = trial_difference(never, set);
    const int bits = trial_same_bits(never, set);
    const int kept = effect->expectation == EX_SAME_BITS  ? bits
                     : effect->expectation == EX_ROUNDING ? difference <= effect->allowed
                                                          : 1;
    printf(bits ? "0" : "%.2g", difference);
    if (effect->expectation == EX_ROUNDING) printf(", rounding at most %.2g", effect->allowed);
    printf("%s | ", kept ? "" : " **too much**");
    return kept;
}

/* Effects that cost something although they are not needed, or work that is left out. */
static void print_costly(const ex_unneeded *list, int length) {
    int kept = 0, count = 0, others = 0;
    printf("| what is set | difference | passes | counts | calls | MB at most | time |\n");
    printf("|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < length; ++i) {
        trial never, set;
        if (list[i].expectation == EX_UNTOUCHED) continue;
        trial_begin(&never, list[i].common, NULL);
        trial_begin(&set, list[i].common, list[i].set);
        printf("| %s%s%s | ", list[i].name, *list[i].why ? ": " : "", list[i].why);
        kept += print_expectation(&list[i], &never, &set);
        print_passes(&never, &set);
        print_costs(&never, &set);
        count += 1, others += list[i].expectation == EX_OTHER;
        trial_end(&never);
        trial_end(&set);
    }
    failures += kept < count;
    printf("\nThe picture is unchanged, to the bit or within rounding, in %d of %d.", kept - others, count - others);
    if (others) printf(" The last %d pictures differ by the error of slabs and sheets.", others);
    printf("\n\n");
}

/* ================================================================================================== bounds */

static int smooth_read(void *user, const int lo[3], const int size[3], float *out) {
    const double voxel = 2.0 / *(const int *)user;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j)
            for (int i = lo[0]; i < lo[0] + size[0]; ++i) {
                const double p[3] = {(i + 0.5) * voxel - 1, (j + 0.5) * voxel - 1, (k + 0.5) * voxel - 1};
                const double value = exp(-8 * ex_dot(p, p));
                *out++ = value < 1e-3 ? 0 : (float)value;
            }
    return 0;
}

/* Smooth gas that only absorbs, before a white background. */
static void smooth_alone(ex_stage *s) {
    s->clouds[0].read_fn = smooth_read;
    ex_absorb_unlit(s);
    ex_color(s->scene.background, 1, 1, 1);
}

/* The same above a floor that the sun lights, before a black one. */
static void smooth_above_floor(ex_stage *s) {
    s->clouds[0].read_fn = smooth_read;
    ex_absorb(s);
    ex_only_floor(s);
    ex_color(s->scene.background, 0, 0, 0);
}

/* The largest difference of optical depth: radiance is in proportion to exp(-optical depth). */
static double depth_difference(const trial *a, const trial *b) {
    double largest = 0;
    for (size_t i = 0; i < 4 * trial_pixels(a); i += 4)
        if (a->rgba[i] > 1e-6f) largest = fmax(largest, fabs(log((double)a->rgba[i] / (double)b->rgba[i])));
    return largest;
}

static void print_bound(const char *what, const char *unit, double bound, double found) {
    failures += !(found <= bound);
    printf("| %s | %s | %.3g | %.3g%s | ", what, unit, bound, found, found <= bound ? "" : " **too much**");
}

static void bound_tolerance(const char *name, ex_change common) {
    trial all, fewer;
    trial_begin(&all, common, NULL);
    trial_begin(&fewer, common, ex_tolerate);
    print_bound(name, "optical depth", (double)fewer.stats.eye_bound + (double)fewer.stats.light_bound,
                depth_difference(&all, &fewer));
    printf("%.2f |\n", trial_race(&all, &fewer));
    trial_end(&all);
    trial_end(&fewer);
}

static void black_background(ex_stage *s) { ex_color(s->scene.background, 0, 0, 0); }

static double radiance_sum(const trial *t) {
    double sum = 0;
    for (size_t i = 0; i < 4 * trial_pixels(t); ++i) sum += i % 4 < 3 ? (double)t->rgba[i] : 0;
    return sum;
}

static void thin_alone(ex_stage *s) {
    ex_thin(s);
    black_background(s);
    s->view.scattering = SPS_SCATTERING_MULTIPLE;
}

/* The bound is above the default tolerance, which is raised. */
static void less_thin_alone(ex_stage *s) {
    thin_alone(s);
    s->clouds[0].extinction = 0.03f;
    s->view.scattering_tolerance = 0.3f;
}

static void bound_scattering(const char *name, ex_change common) {
    trial all, once;
    trial_begin(&all, common, NULL);
    trial_begin(&once, common, ex_scatter_auto);
    failures += once.stats.cells > 0;
    print_bound(name, "fraction of radiance", once.stats.scattering_bound,
                radiance_sum(&all) / radiance_sum(&once) - 1);
    printf("%.2f |\n", trial_race(&all, &once));
    trial_end(&all);
    trial_end(&once);
}

#define BALL_DEPTH 12.0

/* A uniform ball that only absorbs, seen in parallel before a white background. */
static void opaque_ball(ex_stage *s) {
    static sps_particle ball;
    ball.radius = 1, ball.optical_depth = (float)BALL_DEPTH;
    ex_add_swarm(s);
    s->swarm.user = &ball, s->swarm.count = 1;
    ex_color(s->swarm.albedo, 0, 0, 0);
    s->scene.volume_count = 0, s->scene.light_count = 0;
    ex_color(s->scene.background, 1, 1, 1);
    memset(&s->view.camera, 0, sizeof s->view.camera);
    s->view.camera.position[2] = 5, s->view.camera.up[1] = 1, s->view.camera.ortho_height = 2.2;
    s->view.slab_thickness = 0.05;
}

static void ends_later(ex_stage *s) { s->view.quality = SPS_QUALITY_ULTRA; }

static void bound_ends(void) {
    trial ends, later;
    double largest = 0;
    trial_begin(&ends, opaque_ball, NULL);
    trial_begin(&later, opaque_ball, ends_later);
    const double pitch = 2.2 / ends.stage.view.height;
    for (int y = 0; y < ends.stage.view.height; ++y)
        for (int x = 0; x < WIDTH; ++x) {
            const double dx = pitch * (x - 0.5 * (WIDTH - 1)), dy = pitch * (y - 0.5 * (ends.stage.view.height - 1));
            const double exact = exp(-BALL_DEPTH * sqrt(fmax(1 - dx * dx - dy * dy, 0)));
            const size_t at = (size_t)y * WIDTH + (size_t)x;
            largest = fmax(largest, fabs((double)ends.rgba[4 * at] - exact));
        }
    print_bound("rays end where gas is opaque, `medium`", "transmittance", 0.003, largest);
    printf("%.2f |\n", trial_race(&later, &ends));
    trial_end(&ends);
    trial_end(&later);
}

static void print_bounds(void) {
    printf("## Skips by a bound\n\n");
    printf("Time is with the skip / without it.\n\n");
    printf("| what is skipped | unit | bound | true difference | time |\n|---|---|---|---|---|\n");
    bound_tolerance("`tolerance` of 0.1, rays of the eye: `eye_bound`", smooth_alone);
    bound_tolerance("... and of a light: `eye_bound` + `light_bound`", smooth_above_floor);
    bound_scattering("`SPS_SCATTERING_AUTO`, thin gas: `scattering_bound`", thin_alone);
    bound_scattering("... gas 30 times as dense, `scattering_tolerance` 0.3", less_thin_alone);
    bound_ends();
    printf("\n");
}

int main(void) {
    print_effects();
    print_recognised();
    printf("## Set, not needed, and not recognised\n\n");
    print_costly(ex_unneeded_effects, EX_COUNT(ex_unneeded_effects));
    printf("## Left out because it is known\n\n");
    print_costly(ex_savings, EX_COUNT(ex_savings));
    print_bounds();
    return failures ? EX_FAILED : EX_OK;
}
