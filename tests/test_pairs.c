/* Pairs of features. Errors in the interaction of two features are not seen in tests of either, so every compatible
   pair of levels of two features (random_scene.h has their names) occurs in at least one small scene, which is compared
   with sps_reference. The table below has the number of pairs for each two features; the test checks it, so that it
   documents the coverage.

   A greedy covering array, from a fixed seed, chooses the scenes: each begins with a pair that has not occurred, and
   chooses for every other feature the level that adds most new pairs [Cohen et al. 1997, "The AETG system"]. A scene
   that is refused, or in which nothing is seen, does not count, and others are tried. The test fails if a pair is left.
   Incompatible pairs are in scene_exclusions, with reasons, apart from those of a feature that is absent: a field, a
   source and a placement need a volume; a source of shadows, a side and other lights need a light. With PAIRS_ALL in
   the environment, every scene's errors and levels are printed. */

#include "random_scene.h"

enum { VOXELS = 8, PIXELS = 32, ATTEMPTS = 40 };

/* Levels that are paired. Lights with an extent are left to soak and test_penumbrae: the reference samples each by 16
   points at every place, which would take this test minutes. */
static int pair_levels(int f) { return f == LIGHT ? LIGHT_WIDE_SUN : level_count(f); }

/* Numbers of compatible pairs of levels. */
static const int table[FEATURES][FEATURES] = {
    /*              vol fie sou pla sec mes par lig sha sid oth cam nea sur out */
    /* volume       */ {0},
    /* field        */ {30},
    /* source       */ {18, 15},
    /* placement    */ {30, 25, 15},
    /* second       */ {35, 25, 15, 25},
    /* mesh         */ {56, 40, 24, 40, 40},
    /* particles    */ {28, 20, 12, 20, 20, 32},
    /* light        */ {35, 25, 15, 25, 25, 40, 20},
    /* shadow       */ {49, 35, 21, 35, 35, 56, 28, 27},
    /* side         */ {21, 15, 9, 15, 15, 24, 12, 12, 21},
    /* others       */ {35, 25, 15, 25, 25, 40, 20, 20, 35, 15},
    /* camera       */ {49, 35, 21, 35, 35, 56, 28, 35, 49, 21, 35},
    /* near         */ {14, 10, 6, 10, 10, 16, 8, 10, 14, 6, 10, 14},
    /* surroundings */ {21, 15, 9, 15, 15, 24, 12, 14, 21, 9, 15, 21, 6},
    /* output       */ {28, 20, 12, 20, 20, 32, 16, 20, 28, 12, 20, 28, 8, 12},
    /* world        */ {28, 20, 12, 20, 20, 32, 13, 20, 28, 12, 20, 28, 8, 12, 16},
};

typedef struct pairs {
    unsigned char seen[FEATURES][LEVELS_MAX][FEATURES][LEVELS_MAX];
    check_random random;
    long scenes, refused, dark;
} pairs;

/* The feature that another one depends on; its level 0 means that it is absent. */
static int needs(int f) {
    if (f == FIELD || f == SOURCE || f == PLACEMENT) return VOLUME;
    if (f == SHADOW || f == SIDE || f == OTHERS) return LIGHT;
    return -1;
}

static int goes_together(int f, int level, int g, int other) {
    if (f == g || scene_excluded(f, level, g, other)) return 0;
    return !(needs(f) == g && other == 0) && !(needs(g) == f && level == 0);
}

static int matters(const int levels[FEATURES], int f) { return needs(f) < 0 || levels[needs(f)] > 0; }

/* Finds a pair that has not occurred yet; returns 0 if there is none. */
static int first_missing(const pairs *p, int levels[FEATURES]) {
    for (int f = 0; f < FEATURES; ++f)
        for (int a = 0; a < pair_levels(f); ++a)
            for (int g = 0; g < f; ++g)
                for (int b = 0; b < pair_levels(g); ++b)
                    if (goes_together(f, a, g, b) && !p->seen[f][a][g][b]) {
                        levels[f] = a;
                        levels[g] = b;
                        return 1;
                    }
    return 0;
}

/* Number of new pairs that a level would make with those chosen (level -1: not chosen); -1 if incompatible. */
static int gain(const pairs *p, const int levels[FEATURES], int f, int level) {
    int count = 0;
    for (int g = 0; g < FEATURES; ++g) {
        if (levels[g] < 0) continue;
        if (scene_excluded(f, level, g, levels[g]) || (needs(g) == f && level == 0)) return -1;
        count += goes_together(f, level, g, levels[g]) && !p->seen[f][level][g][levels[g]];
    }
    return count;
}

/* Chooses the remaining levels, feature by feature from a random one on. */
static void choose(pairs *p, int levels[FEATURES]) {
    const int start = draw_below(&p->random, FEATURES), stride = 1 + 2 * draw_below(&p->random, FEATURES / 2);
    for (int i = 0; i < FEATURES; ++i) {
        const int f = (start + i * stride) % FEATURES; /* all of them: 16 features, odd strides */
        const int count = pair_levels(f), from = draw_below(&p->random, count);
        int best = -1;
        if (levels[f] >= 0) continue;
        for (int k = 0; k < count; ++k) {
            const int level = (from + k) % count, gained = gain(p, levels, f, level);
            if (gained > best) best = gained, levels[f] = level;
        }
    }
}

static void mark(pairs *p, const int levels[FEATURES]) {
    for (int f = 0; f < FEATURES; ++f)
        for (int g = 0; g < FEATURES; ++g)
            if (f != g && matters(levels, f) && matters(levels, g)) p->seen[f][levels[f]][g][levels[g]] = 1;
}

static void print_report(const pairs *p, const int levels[FEATURES], const scene_report *r) {
    printf("%4ld %6.2f %% %6.2f %%  bias %6.2f %% %6.2f %%  coverage %.4f  depth %.4f  mean %.2g  own %.2f %%  seed "
           "%llu  ",
           p->scenes, 100 * r->medium.light, 100 * r->high.light, 100 * r->medium.bias, 100 * r->high.bias,
           r->medium.coverage, r->medium.depth, r->high.mean, 100 * r->own, (unsigned long long)p->random.state);
    print_levels(levels);
}

/* As measure_scene, but without a picture at high quality where the one at medium is good as it is: what is stated is
   then the medium one's, too. */
static scene_report measure_quickly(sps_context *context, random_scene *x) {
    static scene_picture medium;
    scene_report report;
    memset(&report, 0, sizeof report);
    x->s.view.quality = SPS_QUALITY_MEDIUM;
    set_points(x, SCENE_POINTS);
    report.result = scene_render(context, x, 0, &medium);
    if (report.result != SPS_OK) return report;
    x->s.view.quality = SPS_QUALITY_HIGH; /* of the reference */
    compare_with_reference(context, x, &medium, &medium, 0, &report);
    return scene_good(&report) ? report : measure_scene(context, x, 1);
}

/* Whether the scene could be judged. */
static int look(pairs *p, sps_context *context, const int levels[FEATURES]) {
    static random_scene x;
    scene_report r;
    int seen = 0;
    build_scene(&x, levels, p->random.state, VOXELS, PIXELS);
    r = check_long() ? measure_scene(context, &x, 1) : measure_quickly(context, &x);
    if (r.result == SPS_ERROR_UNSUPPORTED)
        ++p->refused;
    else if (CHECK_OK(context, r.result)) {
        seen = scene_shown(&r);
        p->dark += !seen;
    }
    if (getenv("PAIRS_ALL")) print_report(p, levels, &r);
    if (seen && !CHECK(scene_good(&r))) print_report(p, levels, &r);
    free_scene(&x);
    return seen;
}

static void test_table(void) {
    for (int f = 0; f < FEATURES; ++f)
        for (int g = 0; g < f; ++g) {
            int count = 0;
            for (int a = 0; a < pair_levels(f); ++a)
                for (int b = 0; b < pair_levels(g); ++b) count += goes_together(f, a, g, b);
            if (!CHECK(table[f][g] == count))
                printf("    %s and %s: %d\n", scene_features[f].name, scene_features[g].name, count);
        }
}

static void test_pairs(void) {
    static pairs p;
    sps_context *context = check_context(NULL);
    int levels[FEATURES], left, attempts = 0;
    p.random.state = 2;
    for (;;) {
        for (int f = 0; f < FEATURES; ++f) levels[f] = -1;
        left = first_missing(&p, levels);
        if (!left || attempts > ATTEMPTS) break;
        choose(&p, levels);
        ++p.scenes;
        attempts = look(&p, context, levels) ? (mark(&p, levels), 0) : attempts + 1;
    }
    printf("%ld scenes, of which %ld refused and %ld dark\n", p.scenes, p.refused, p.dark);
    if (!CHECK(!left)) print_levels(levels);
    sps_destroy(context);
}

int main(void) {
    RUN(test_table);
    RUN(test_pairs);
    return check_report();
}
