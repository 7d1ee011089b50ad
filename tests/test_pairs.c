/* Pairs of features. Errors in the interaction of two features are not seen in tests of either, so every compatible
   pair of levels of two features (random_scene.h has their names) occurs in at least one small scene, which is compared
   with sps_reference. The table below has the number of pairs for each two features; the test checks it, so that it
   documents the coverage.

   A greedy covering array, from a fixed seed, chooses the scenes: each begins with a pair that has not occurred, and
   chooses for every other feature the level that adds most new pairs [Cohen et al. 1997, "The AETG system"]. A scene
   that is refused, or in which nothing is seen, does not count, and others are tried. The quick test takes the first
   few, which have most of the pairs; the long one also pairs features whose references take long, and fails if a pair
   is left. What a scene may be off by beyond the bounds of all has causes and bounds of its own (scene_reasons).
   Incompatible pairs are in scene_exclusions, with reasons, apart from those of a feature that is absent: a field, a
   source and a placement need a volume; a source of shadows, a side and other lights need a light. With PAIRS_ALL in
   the environment, every scene's errors and levels are printed. Each scene is also compared with itself: one channel
   with a grey scene, and colors and distances with those of other calls.

   sps_reference has light from cell to cell, SPS_SCATTERING_MULTIPLE, only as random paths, which are noisy. So it is
   not a feature of the table, but is paired with each level of every feature by scenes of its own: their mean is that
   of paths, as in soak. A scene whose mean would pass with light scattered once does not count. Levels that cells do
   not know are in cells_exclusions. CHECK_FIGURES prints both means of every scene. */

#include "random_scene.h"

enum { VOXELS = 8, ATTEMPTS = 40, QUICK = 6, QUICK_CELLS = 3 }; /* QUICK...: scenes of the quick test */

/* Balls of a pixel or two keep their mass, which the reference's rays through the middles of pixels do not: in the long
   test, which has scenes where nothing else is seen, they are wider. */
static int pixels(const int levels[]) { return !check_long() ? 28 : levels[PARTICLES] ? 56 : 32; }

/* Features of two levels besides those of random_scene.h: whether the scene has them. */
typedef enum extra {
    PANES = FEATURES, /* the mesh lets light pass */
    IMAGES,           /* lights throw images */
    CONES,            /* lamps are spotlights */
    TOLERANT,         /* tolerance is set */
    TWO_COLORS,       /* all colors agree in two channels, the same ones */
    CROPS,            /* volumes are cut by faces of voxels */
    ALL_FEATURES
} extra;

static const char *const extra_names[ALL_FEATURES - FEATURES] = {"panes",     "images",     "cones",
                                                                 "tolerance", "two colors", "crops"};

/* Levels that are paired. Area lights, images, cones and panes are left to soak, tests of their own and the long test:
   the reference samples each by 16 points at every place, or has to be refined, which would take this test minutes.
   coverage_samples has a comparison of its own with each scene that has polygons. */
static int pair_levels(int f) {
    if (f >= FEATURES) return f >= TOLERANT || check_long() ? 2 : 1;
    return f == LIGHT && !check_long() ? LIGHT_DISC : level_count(f);
}

/* Numbers of compatible pairs of levels, those of the long test included. */
static const int table[FEATURES][FEATURES] = {
    /*              vol fie sou pla sec mes par lig sha sid oth cam nea sur out */
    /* volume       */ {0},
    /* field        */ {30},
    /* source       */ {18, 15},
    /* placement    */ {30, 25, 15},
    /* second       */ {35, 25, 15, 25},
    /* mesh         */ {56, 40, 24, 40, 40},
    /* particles    */ {28, 20, 12, 20, 20, 32},
    /* light        */ {56, 40, 24, 40, 40, 64, 32},
    /* shadow       */ {49, 35, 21, 35, 35, 56, 28, 35},
    /* side         */ {21, 15, 9, 15, 15, 24, 12, 21, 21},
    /* others       */ {35, 25, 15, 25, 25, 40, 20, 35, 35, 15},
    /* camera       */ {49, 35, 21, 35, 35, 56, 28, 56, 49, 21, 35},
    /* near         */ {14, 10, 6, 10, 10, 16, 8, 16, 14, 6, 10, 14},
    /* surroundings */ {21, 15, 9, 15, 15, 24, 12, 23, 21, 9, 15, 21, 6},
    /* output       */ {28, 20, 12, 20, 20, 32, 16, 32, 28, 12, 20, 28, 8, 12},
    /* world        */ {28, 20, 12, 20, 20, 32, 13, 32, 28, 12, 20, 28, 8, 12, 16},
};

typedef struct pairs {
    unsigned char seen[ALL_FEATURES][LEVELS_MAX][ALL_FEATURES][LEVELS_MAX];
    check_random random;
    long scenes, refused, dark;
} pairs;

/* The feature that another one depends on; its level 0 means that it is absent. */
static int needs(int f) {
    if (f == FIELD || f == SOURCE || f == PLACEMENT || f == CROPS) return VOLUME;
    if (f == SHADOW || f == SIDE || f == OTHERS || f == IMAGES || f == CONES) return LIGHT;
    if (f == PANES) return MESH;
    return -1;
}

/* Suns have no cones. Slabs hardly ever serve a lamp at the gas's rim: soak has the few scenes where they do. */
static int is_excluded(int f, int level, int g, int other) {
    const int light = f == LIGHT ? level : other, cones = f == CONES ? level : other;
    if (f == LIGHT && g == SHADOW) return is_excluded(g, other, f, level);
    if (f == SHADOW && g == LIGHT && level == SHADOW_SLABS && other == LIGHT_NEAR) return 1;
    if ((f == CONES && g == LIGHT) || (f == LIGHT && g == CONES))
        return cones && (light == LIGHT_SUN || light == LIGHT_WIDE_SUN);
    return f < FEATURES && g < FEATURES && scene_excluded(f, level, g, other) != NULL;
}

static int goes_together(int f, int level, int g, int other) {
    if (f == g || is_excluded(f, level, g, other)) return 0;
    return !(needs(f) == g && other == 0) && !(needs(g) == f && level == 0);
}

static int matters(const int *levels, int f) { return needs(f) < 0 || levels[needs(f)] > 0; }

/* Finds a pair that has not occurred yet; returns 0 if there is none. */
static int first_missing(const pairs *p, int levels[ALL_FEATURES]) {
    for (int f = 0; f < ALL_FEATURES; ++f)
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
static int gain(const pairs *p, const int levels[ALL_FEATURES], int f, int level) {
    int count = 0;
    for (int g = 0; g < ALL_FEATURES; ++g) {
        if (levels[g] < 0) continue;
        if (is_excluded(f, level, g, levels[g]) || (needs(g) == f && level == 0)) return -1;
        count += goes_together(f, level, g, levels[g]) && !p->seen[f][level][g][levels[g]];
    }
    return count;
}

/* The numbers 0..count-1 in a random order. */
static void shuffle(check_random *random, int *order, int count) {
    for (int i = 0; i < count; ++i) {
        const int at = draw_below(random, i + 1);
        order[i] = order[at], order[at] = i;
    }
}

/* Chooses the remaining levels, feature by feature in a random order. */
static void choose(pairs *p, int levels[ALL_FEATURES]) {
    int order[ALL_FEATURES];
    shuffle(&p->random, order, ALL_FEATURES);
    for (int i = 0; i < ALL_FEATURES; ++i) {
        const int f = order[i];
        const int count = pair_levels(f), from = draw_below(&p->random, count);
        int best = -1;
        if (levels[f] >= 0) continue;
        for (int k = 0; k < count; ++k) {
            const int level = (from + k) % count, gained = gain(p, levels, f, level);
            if (gained > best) best = gained, levels[f] = level;
        }
    }
}

static void mark(pairs *p, const int levels[ALL_FEATURES]) {
    for (int f = 0; f < ALL_FEATURES; ++f)
        for (int g = 0; g < ALL_FEATURES; ++g)
            if (f != g && matters(levels, f) && matters(levels, g)) p->seen[f][levels[f]][g][levels[g]] = 1;
}

static void print_report(const pairs *p, const int levels[ALL_FEATURES], const scene_report *r) {
    printf("%4ld %6.2f %% %6.2f %%  bias %6.2f %% %6.2f %%  coverage %.4f  depth %.4f  mean %.2g  own %.2f %%  seed "
           "%llu  ",
           p->scenes, 100 * r->medium.light, 100 * r->high.light, 100 * r->medium.bias, 100 * r->high.bias,
           r->medium.coverage, r->medium.depth, r->high.mean, 100 * r->own, (unsigned long long)p->random.state);
    for (int f = FEATURES; f < ALL_FEATURES; ++f)
        if (levels[f]) printf("%s, ", extra_names[f - FEATURES]);
    print_levels(levels);
}

static void add_extras(random_scene *x, const int levels[ALL_FEATURES]) {
    check_random random = beside_scene(x->random.state, 7);
    if (levels[PANES]) make_panes(x, &random);
    if (levels[CONES]) narrow_all(x, &random);
    if (levels[IMAGES]) throw_all(x, &random);
    x->s.view.tolerance = levels[TOLERANT] ? 0.05f : 0;
    if (levels[TWO_COLORS]) equalize(x, &random);
    if (levels[CROPS]) crop_all(x, &random);
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

/* A picture with distances has the same colors, and its distances are those of light that scatters once. */
static void check_distances(sps_context *context, const random_scene *x, const scene_picture *picture) {
    static random_scene other;
    static scene_picture twice[2];
    const size_t count = check_pixel_count(&x->s.view);
    double worst = 0;
    if (x->levels[OUTPUT] == OUTPUT_REGION) return;
    other = *x;
    other.levels[OUTPUT] = OUTPUT_DEPTH;
    for (int once = 0; once < 2; ++once) {
        if (once) other.s.view.scattering = SPS_SCATTERING_SINGLE;
        if (!CHECK_OK(context, scene_render(context, &other, 0, &twice[once]))) return;
    }
    for (size_t i = 0; i < count; ++i)
        if (twice[0].rgba[4 * i + 3] > 0.01f)
            worst = fmax(worst, fabs((double)twice[0].depth[i] / (double)twice[1].depth[i] - 1));
    if (!CHECK(memcmp(twice[0].rgba, picture->rgba, 4 * count * sizeof(float)) == 0) || !CHECK(worst == 0))
        printf("    scattering %d, distances %g\n", (int)x->s.view.scattering, worst);
}

/* One channel of a picture in colors is that of a picture in which all channels are as that one: nothing takes another
   channel's values. Floats: 1e-6. Light between cells, which is followed until all channels have settled, and whose
   patches are those of the brightest: the most of the long test's scenes is 0.75 %, so 1 %. Cells serve the lights that
   bring most in all channels together, so only the first two are left then. Panes weigh some things by their mean of
   all channels: the depth of a layer that only some samples see, and the points of a light with an extent. So there are
   no such samples, and no check under such lights. A channel that panes keep off is left out: grey, they would be
   opaque, and shade by other maps. */
static void check_channel(const pairs *p, sps_context *context, const int levels[ALL_FEATURES]) {
    static const sps_scattering modes[4] = {SPS_SCATTERING_SINGLE, SPS_SCATTERING_FORWARD, SPS_SCATTERING_CONVOLUTION,
                                            SPS_SCATTERING_MULTIPLE};
    static random_scene x;
    static scene_picture pictures[2];
    const int weighed = levels[PANES] && levels[LIGHT] >= LIGHT_WIDE_SUN;
    int channel = (int)(p->scenes % 3);
    if (levels[VOLUME] == VOLUME_CURVE || levels[SURROUNDINGS] == SURROUNDINGS_SKY || levels[IMAGES]) return;
    for (int n = 0; n < (p->scenes % 2 || check_long() ? 4 : 3); ++n) {
        double sum = 0, squares = 0;
        for (int grey = 0; grey < (weighed ? 1 : 2); ++grey) {
            build_scene(&x, levels, p->random.state, VOXELS, pixels(levels));
            add_extras(&x, levels);
            x.s.view.quality = SPS_QUALITY_MEDIUM, x.s.view.scattering = modes[n];
            if (n == 3) x.s.view.scattering_resolution = 16;
            if (n == 3 && x.s.scene.light_count > 2) x.s.scene.light_count = 2;
            if (levels[PANES]) x.s.view.coverage_samples = 0;
            for (int i = 0; i < x.s.scene.mesh_count; ++i) x.s.mesh[i].has_albedos = 0;
            if (levels[PANES] && !(x.s.mesh[0].transmittance[channel] > 0)) channel = (channel + 1) % 3;
            for (int c = 0; c < 3 && grey; ++c) copy_channel(&x, channel, c);
            const sps_result result = scene_render(context, &x, 0, &pictures[grey]);
            const int count = scene_width(&x) * scene_height(&x);
            for (int i = 0; i < count && grey && result == SPS_OK; ++i) {
                const double light = (double)pictures[1].rgba[4 * i + channel];
                sum += light / count, squares += pow(light - (double)pictures[0].rgba[4 * i + channel], 2) / count;
            }
            if (result == SPS_OK && !grey) check_distances(context, &x, &pictures[0]);
            free_scene(&x);
            if (result != SPS_OK) return;
        }
        if (!weighed && !CHECK(sqrt(squares) <= (n < 3 ? 1e-6 : 0.01) * sum))
            printf("    channel %d, scattering %d: %.6f of %.4g\n", channel, n, sqrt(squares), sum);
    }
}

/* Whether the scene could be judged. */
static int look(pairs *p, sps_context *context, const int levels[ALL_FEATURES]) {
    static random_scene x;
    const int failed = check_failed;
    scene_report r;
    int seen = 0;
    build_scene(&x, levels, p->random.state, VOXELS, pixels(levels));
    add_extras(&x, levels);
    r = check_long() ? measure_scene(context, &x, 1) : measure_quickly(context, &x);
    if (r.result == SPS_ERROR_UNSUPPORTED)
        ++p->refused;
    else if (CHECK_OK(context, r.result)) {
        seen = scene_shown(&r);
        p->dark += !seen;
    }
    if (r.result == SPS_OK) check_channel(p, context, levels);
    if (r.result == SPS_OK) check_edges(context, &x, 2 + (int)(p->scenes % 3));
    if (seen) CHECK(scene_good(&r) || excuse(context, &x, &r));
    if (check_failed > failed || getenv("PAIRS_ALL")) print_report(p, levels, &r);
    free_scene(&x);
    return seen;
}

static void test_table(void) {
    for (int f = 0; f < FEATURES; ++f)
        for (int g = 0; g < f; ++g) {
            int count = 0;
            for (int a = 0; a < level_count(f); ++a)
                for (int b = 0; b < level_count(g); ++b) count += goes_together(f, a, g, b);
            if (!CHECK(table[f][g] == count))
                printf("    %s and %s: %d\n", scene_features[f].name, scene_features[g].name, count);
        }
}

static void test_pairs(void) {
    static pairs p;
    sps_context *context = check_context(NULL);
    int levels[ALL_FEATURES], left, attempts = 0;
    p.random.state = 2;
    for (;;) {
        for (int f = 0; f < ALL_FEATURES; ++f) levels[f] = -1;
        left = first_missing(&p, levels);
        if (!left || attempts > ATTEMPTS || (!check_long() && p.scenes == QUICK)) break;
        choose(&p, levels);
        ++p.scenes;
        attempts = look(&p, context, levels) ? (mark(&p, levels), 0) : attempts + 1;
    }
    printf("%ld scenes, of which %ld refused and %ld dark\n", p.scenes, p.refused, p.dark);
    if (check_long() && !CHECK(!left)) print_levels(levels);
    CHECK(p.refused + p.dark <= p.scenes / 4);
    sps_destroy(context);
}

/* --- light from cell to cell --- */

/* CELLS_PATHS: per pixel, of CELLS_PIXELS x CELLS_PIXELS. */
enum { CELLS_PIXELS = 12, CELLS_PATHS = 32 };

/* Light from cell to cell may be off by this share of a scene's mean, besides the paths' noise. */
#define CELLS_SHARE 0.05

/* The share of a scene's mean that light from cell to cell must make before paths are followed. The noise is some 2 to
   6 % of the mean, so scenes below the quick test's hardly ever count, and their paths take most of the time. */
static double cells_worth(void) { return check_long() ? CELLS_SHARE : 1.7 * CELLS_SHARE; }

static const struct {
    int feature, level;
    const char *reason;
} cells_exclusions[] = {
    {VOLUME, VOLUME_SURFACE, "paths reflect light from surfaces of volumes, cells do not"},
    {VOLUME, VOLUME_CURVE, "paths reflect light from surfaces of volumes, cells do not"},
    {SECOND, SECOND_SURFACE, "paths reflect light from surfaces of volumes, cells do not"},
    {SECOND, SECOND_TWO, "one of them may be a surface"},
};

/* As goes_together says, but levels of absent features go with all. */
static int cells_allow(int f, int level, int g, int other) {
    if (f == SURROUNDINGS && level != SURROUNDINGS_BLACK && g == MESH && hides_ambient(other)) return 0;
    if (g == SURROUNDINGS && other != SURROUNDINGS_BLACK && f == MESH && hides_ambient(level)) return 0;
    return !scene_excluded(f, level, g, other);
}

static int cells_know(int f, int level) {
    for (size_t i = 0; i < sizeof cells_exclusions / sizeof *cells_exclusions; ++i)
        if (cells_exclusions[i].feature == f && cells_exclusions[i].level == level) return 0;
    return 1;
}

typedef struct cells_cover {
    unsigned char seen[FEATURES][LEVELS_MAX];
    check_random random;
    long scenes, refused, pale;
} cells_cover;

static int first_unseen(const cells_cover *p, int levels[FEATURES]) {
    for (int f = 0; f < FEATURES; ++f)
        for (int a = 0; a < level_count(f); ++a)
            if (!p->seen[f][a] && cells_know(f, a)) {
                levels[f] = a;
                return 1;
            }
    return 0;
}

/* Whether a level goes with those chosen. What it needs, or what needs it, must be there. */
static int cells_compatible(const cells_cover *p, const int levels[FEATURES], int f, int level) {
    if (!cells_know(f, level)) return 0;
    for (int g = 0; g < FEATURES; ++g) {
        if (levels[g] < 0 || g == f) continue;
        if (!cells_allow(f, level, g, levels[g])) return 0;
        if (needs(g) == f && level == 0 && !p->seen[g][levels[g]]) return 0;
    }
    return 1;
}

/* Chooses the remaining levels in a random order: one that has not occurred, or else any. Returns 0 if there is none.
 */
static int choose_cells(cells_cover *p, int levels[FEATURES]) {
    int order[FEATURES];
    shuffle(&p->random, order, FEATURES);
    for (int i = 0; i < FEATURES; ++i) {
        const int f = order[i], count = level_count(f), from = draw_below(&p->random, count);
        int best = -1;
        if (levels[f] >= 0) continue;
        for (int k = 0; k < count; ++k) {
            const int level = (from + k) % count;
            const int gained = cells_compatible(p, levels, f, level) ? !p->seen[f][level] : -1;
            if (gained > best) best = gained, levels[f] = level;
        }
        if (best < 0) return 0;
    }
    return 1;
}

/* Renders, and takes the mean of all colors. */
static sps_result cells_render(sps_context *context, const check_scene *s, scene_picture *out, double *mean) {
    const size_t count = check_pixel_count(&s->view);
    sps_image image;
    sps_result result;
    memset(&image, 0, sizeof image);
    image.rgba = out->rgba;
    result = sps_render(context, &s->scene, &s->view, &image);
    *mean = 0;
    for (size_t i = 0; i < 4 * count && result == SPS_OK; ++i)
        if (i % 4 < 3) *mean += (double)out->rgba[i] / (3 * (double)count);
    return result;
}

/* The kind of image does not matter. */
static void check_cells_output(sps_context *context, const random_scene *x, const scene_picture *all) {
    static scene_picture image;
    if (x->levels[OUTPUT] != OUTPUT_DEPTH && x->levels[OUTPUT] != OUTPUT_ROWS) return;
    CHECK_OK(context, scene_render(context, x, 0, &image));
    CHECK(memcmp(image.rgba, all->rgba, 4 * check_pixel_count(&x->s.view) * sizeof(float)) == 0);
}

/* Whether the scene counts. */
static int look_at_cells(cells_cover *p, sps_context *context, const int levels[FEATURES]) {
    static random_scene x;
    static scene_picture once, all;
    const int failed = check_failed;
    sps_result result;
    double mean, single;
    int counts = 0;
    build_scene(&x, levels, p->random.state, VOXELS, pixels(levels));
    prepare_cells(&x, CELLS_PIXELS);
    if (!check_long()) x.s.view.quality = SPS_QUALITY_MEDIUM;
    x.s.view.scattering = SPS_SCATTERING_SINGLE;
    result = cells_render(context, &x.s, &once, &single);
    x.s.view.scattering = SPS_SCATTERING_MULTIPLE;
    if (result == SPS_OK) result = cells_render(context, &x.s, &all, &mean);
    if (result == SPS_ERROR_UNSUPPORTED)
        ++p->refused;
    else if (CHECK_OK(context, result)) {
        const double more = fabs(mean - single);
        char name[64];
        snprintf(name, sizeof name, "scene %ld, %+.0f %%", p->scenes, 100 * (mean / single - 1));
        if (mean >= SCENE_DARK && more >= cells_worth() * mean) {
            check_cells_output(context, &x, &all);
            counts = more > check_paths_of(context, &x.s, all.rgba, name, CELLS_PATHS, CELLS_SHARE);
        }
        p->pale += !counts;
    }
    if (check_failed > failed || (counts && getenv("PAIRS_ALL"))) {
        printf("seed %llu  ", (unsigned long long)p->random.state);
        print_levels(levels);
    }
    free_scene(&x);
    return counts;
}

static void test_cells(void) {
    static cells_cover p;
    sps_context *context = check_context(NULL);
    int levels[FEATURES], left, attempts = 0, counted = 0;
    p.random.state = 2;
    for (;;) {
        for (int f = 0; f < FEATURES; ++f) levels[f] = -1;
        left = first_unseen(&p, levels);
        if (!left || attempts > ATTEMPTS || (!check_long() && counted == QUICK_CELLS)) break;
        ++p.scenes, ++attempts;
        if (!choose_cells(&p, levels) || !look_at_cells(&p, context, levels)) continue;
        attempts = 0, ++counted;
        for (int f = 0; f < FEATURES; ++f)
            if (matters(levels, f)) p.seen[f][levels[f]] = 1;
    }
    printf("light from cell to cell: %ld scenes, of which %ld refused, and %ld where it does not matter\n", p.scenes,
           p.refused, p.pale);
    if (check_long() && !CHECK(!left)) print_levels(levels);
    CHECK(check_long() || counted == QUICK_CELLS);
    sps_destroy(context);
}

int main(void) {
    RUN(test_table);
    RUN(test_pairs);
    RUN(test_cells);
    return check_report();
}
