/* The result of each technique for one ray, against the exact optical depth of analytic columns: sums of intervals in
   double precision, implemented independently here. CHECK_TABLE=1 in the environment prints the error of each technique
   for each column. */

#include "check.h"

enum { MOST = 200, COLUMNS = 12, STRIDE = SPSI_LANES + 3, SAMPLES = 500 };

static const double half_ulp = 6e-8; /* of a float, relative: 2^-24 */
static const double pi = 3.14159265358979323846;

typedef struct column {
    const char *name;
    int count;
    spsi_interval list[MOST];
} column;

static column columns[COLUMNS];
static check_random numbers = {5};

static double between(double low, double high) { return low + (high - low) * check_next(&numbers); }

static void column_add(column *c, double u0, double u1, double depth, double soft) {
    spsi_interval *s = &c->list[c->count++];
    s->u0 = (float)u0, s->u1 = (float)u1, s->depth = (float)depth, s->soft = (float)soft;
}

static column *column_begin(int i, const char *name) {
    columns[i].name = name;
    columns[i].count = 0;
    return &columns[i];
}

static void column_fill_random(column *c, int count, double depth) {
    for (int i = 0; i < count; ++i) {
        const double u0 = between(0.05, 0.8);
        column_add(c, u0, u0 + between(0, 0.15), depth * check_next(&numbers), i % 2);
    }
}

static void columns_fill(void) {
    column *c = column_begin(0, "uniform");
    column_add(c, 0.1, 0.9, 3, 0);
    c = column_begin(1, "two slabs");
    column_add(c, 0.2, 0.3, 1, 0);
    column_add(c, 0.6, 0.75, 2, 0);
    c = column_begin(2, "sheet");
    column_add(c, 0.43, 0.43, 1.5, 0);
    c = column_begin(3, "Gaussian");
    for (int i = 0; i < 64; ++i) {
        const double z = (i + 0.5) / 32 - 1;
        column_add(c, 0.5 + 0.4 * (z - 1.0 / 64), 0.5 + 0.4 * (z + 1.0 / 64), 0.12 * exp(-4.5 * z * z), 0);
    }
    c = column_begin(4, "staircase");
    for (int i = 0; i < 8; ++i) column_add(c, 0.11 + 0.1 * i, 0.11 + 0.1 * i, 0.3, 0);
    c = column_begin(5, "opaque cap");
    column_add(c, 0.2, 0.5, 0.8, 0);
    column_add(c, 0.7, 0.7, 1e18, 0);
    column_begin(6, "empty");
    c = column_begin(7, "even particle");
    column_add(c, 0.37, 0.52, 1.2, 0);
    c = column_begin(8, "soft particle");
    column_add(c, 0.37, 0.52, 1.2, 1);
    c = column_begin(9, "outlier");
    for (int i = 0; i < 20; ++i) column_add(c, 0.7 + 0.01 * i, 0.71 + 0.01 * i, 0.1, 0);
    column_add(c, 0.02, 0.025, 0.01, 1);
    column_fill_random(column_begin(10, "random"), 200, 0.03);
    c = column_begin(11, "dense random");
    column_fill_random(c, 100, 1);
    for (int i = 0; i < 100; ++i) {
        const double u = between(0.05, 0.9);
        column_add(c, u, i % 3 ? u + pow(10, between(-8, -2)) : u, pow(10, between(-6, 1)), i % 2);
    }
}

/* ------------------------------------------------------------------------------------------------- the exact answer */

/* The share of a whole soft chord in its first s. */
static double chord_share(double s) { return s * s * (3 - 2 * s); }

/* If the light is inside a soft one, only its last part counts: s from 1 - soft on. At u = 1 all of it lies before. */
static double exact_share(const spsi_interval *s, double u) {
    const double u0 = (double)s->u0, u1 = (double)s->u1, t = u1 > u0 ? (u - u0) / (u1 - u0) : u >= u0;
    const double first = 1 - (double)s->soft;
    if (u >= 1 || t >= 1) return 1;
    if (t <= 0) return 0;
    if (!(s->soft > 0)) return t;
    return (chord_share(first + (1 - first) * t) - chord_share(first)) / (1 - chord_share(first));
}

static double exact_depth(const column *c, double u) {
    double sum = 0;
    for (int i = 0; i < c->count; ++i) sum += fmin((double)c->list[i].depth, 1e15) * exact_share(&c->list[i], u);
    return fmin(sum, 1e15);
}

/* Linear between nodes; the later one if two share one u. */
static double curve_at(const spsi_node *nodes, int count, double u) {
    int i = 0;
    while (i < count && (double)nodes[i].u <= u) ++i;
    if (i == 0) return 0;
    if (i == count) return (double)nodes[count - 1].value;
    return (double)nodes[i - 1].value + ((double)nodes[i].value - (double)nodes[i - 1].value) *
                                            (u - (double)nodes[i - 1].u) /
                                            ((double)nodes[i].u - (double)nodes[i - 1].u);
}

static float sample(int i) { return (float)i / SAMPLES; }

/* ---------------------------------------------------------------------------------------------------------- harness */

static spsi_node curve[SPSI_CURVE_NODES(MOST, SPSI_SOFT_MOST) + 1];
static spsi_interval scratch[SPSI_CURVE_SCRATCH(MOST) + 1], sorted[MOST];

#define CURVE_ERROR 1e-4 /* of T, per piece of soft intervals */

static int curve_build_of(const column *c, double error) {
    int count, pieces = 1;
    memcpy(sorted, c->list, (size_t)c->count * sizeof *sorted);
    spsi_intervals_sort(sorted, (size_t)c->count, scratch);
    for (int i = 0; i < c->count; ++i)
        if (c->list[i].soft > 0) pieces = SPSI_SOFT_MOST;
    memset(&scratch[SPSI_CURVE_SCRATCH(c->count)], 0x5a, sizeof *scratch);
    memset(&curve[SPSI_CURVE_NODES(c->count, pieces)], 0x5a, sizeof *curve);
    count = spsi_curve_build(sorted, c->count, error, scratch, curve);
    CHECK(count <= SPSI_CURVE_NODES(c->count, pieces));
    CHECK(((unsigned char *)&scratch[SPSI_CURVE_SCRATCH(c->count)])[3] == 0x5a);
    CHECK(((unsigned char *)&curve[SPSI_CURVE_NODES(c->count, pieces)])[3] == 0x5a);
    return count;
}

static int curve_build(const column *c) { return curve_build_of(c, CURVE_ERROR); }

static sps_tmap_settings settings_of(sps_tmap_technique technique, int components) {
    sps_tmap_settings settings;
    memset(&settings, 0, sizeof settings);
    settings.technique = technique;
    settings.components = components;
    return settings;
}

/* Sums of one lane beside others: neighbours get other intervals, or none. Component k of a lane is at
   sums[k * STRIDE + lane]. */
static void sums_clear(const sps_tmap_settings *settings, float *sums) {
    (void)settings;
    for (int i = 0; i < STRIDE * SPSI_TMAP_COMPONENTS; ++i) sums[i] = 0;
}

static spsi_intervals spread(const spsi_interval *s, int lane) {
    float u0[SPSI_LANES], u1[SPSI_LANES], depth[SPSI_LANES];
    spsi_intervals v;
    for (int i = 0; i < SPSI_LANES; ++i) {
        u0[i] = i % 3 ? 0.25f : 0.9f, u1[i] = i % 3 ? 0.26f : 1, depth[i] = i % 3 == 1 ? 0 : 2;
        if (i == lane) u0[i] = s->u0, u1[i] = s->u1, depth[i] = s->depth;
    }
    v.u0 = spsi_load(u0), v.u1 = spsi_load(u1), v.depth = spsi_load(depth);
    v.soft = s->soft;
    return v;
}

static void pick(const sps_tmap_settings *settings, const float *sums, int lane, float *texel) {
    for (int k = 0; k < settings->components; ++k) texel[k] = sums[k * STRIDE + lane];
    if (spsi_techniques[settings->technique].finish) spsi_techniques[settings->technique].finish(settings, texel);
}

/* A column's finished texel, of any technique that has texels and gas in them. */
static void build(const sps_tmap_settings *settings, const column *c, float *texel) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    static float sums[STRIDE * SPSI_TMAP_COMPONENTS];
    const int lane = SPSI_LANES / 2;
    int untouched = 1;
    sums_clear(settings, sums);
    for (int i = 0; i < c->count; ++i) {
        const spsi_intervals v = spread(&c->list[i], lane);
        technique->insert(settings, sums, STRIDE, &v);
    }
    for (int k = 0; k < settings->components; ++k) /* nothing written beside the vector */
        for (int i = SPSI_LANES; i < STRIDE; ++i) untouched &= !(sums[k * STRIDE + i] < 0 || sums[k * STRIDE + i] > 0);
    CHECK(untouched);
    pick(settings, sums, lane, texel);
}

/* Optical depth before u in a list of a technique. */
static float items_depth(sps_tmap_technique technique, const void *list, uint32_t count, float u) {
    const sps_tmap_settings settings = {.technique = technique};
    const spsi_texel texel = {list, count};
    float depth;
    spsi_techniques[technique].depths(&settings, &texel, 1, &u, &depth);
    return depth;
}

static float list_depth(const spsi_interval *list, uint32_t count, float u) {
    return items_depth(SPS_TMAP_DEEP, list, count, u);
}

/* Optical depth before u in one texel. */
static float texel_depth(const sps_tmap_settings *settings, const float *values, float u) {
    const spsi_texel texel = {values, 0};
    float depth;
    spsi_techniques[settings->technique].depths(settings, &texel, 1, &u, &depth);
    return depth;
}

static void texel_bracket(const sps_tmap_settings *settings, const float *values, float u, float bracket[2]) {
    const spsi_texel texel = {values, 0};
    spsi_techniques[settings->technique].bracket(settings, &texel, u, bracket);
}

static double ask(const sps_tmap_settings *settings, const float *texel, double u) {
    return (double)texel_depth(settings, texel, (float)u);
}

/* ------------------------------------------------------------------------------------------------- vector functions */

static void test_turn(void) {
    double worst = 0, worst_sine = 0;
    for (int n = 0; n < 200000; ++n) {
        float c[SPSI_LANES], s[SPSI_LANES];
        const float u = (float)(n < 100000 ? between(-1, 1) : pow(10, between(-9, 3)));
        const double angle = 2 * pi * fmod((double)u, 1);
        spsi_v cosine, sine;
        spsi_cos_sin(spsi_set(u), &cosine, &sine);
        spsi_store(c, cosine), spsi_store(s, sine);
        worst = fmax(worst, fmax(fabs((double)c[0] - cos(angle)), fabs((double)s[0] - sin(angle))));
        if (fabs((double)u) < 0.25 && u < 0) worst_sine = fmax(worst_sine, fabs((double)s[0] / sin(angle) - 1));
    }
    /* polynomials accurate to 6e-9, and three roundings of half a unit each near 1 */
    if (!CHECK(worst <= 2e-7)) printf("    turn is off by %g\n", worst);
    if (!CHECK(worst_sine <= 2e-7)) printf("    its sine by %g of itself\n", worst_sine);
}

static void test_before(void) {
    const spsi_interval even = {0.25f, 0.75f, 1, 0}, soft = {0.25f, 0.75f, 1, 1}, sheet = {0.5f, 0.5f, 1, 0};
    CHECK_NEAR((double)spsi_interval_fraction(&even, 0.375f), 0.25, 0);
    CHECK_NEAR((double)spsi_interval_fraction(&soft, 0.375f), 0.0625 * 2.5, 0);
    CHECK_NEAR((double)spsi_interval_fraction(&even, 0.75f), 1, 0);
    CHECK_NEAR((double)spsi_interval_fraction(&sheet, 0.5f), 1, 0);
    CHECK_NEAR((double)spsi_interval_fraction(&sheet, 0.49999997f), 0, 0);
    for (int n = 0; n < 4000; ++n) { /* and the vector's; whole and cut, with ends outside and inside 0..1 */
        const float soft_one = n % 4 == 3 ? (float)(0.25 + 0.75 * check_next(&numbers)) : (float)(n % 2);
        const float u0 = (float)between(n % 3 ? 0 : -1, 1);
        const float u1 = u0 + (n % 5 ? (float)check_next(&numbers) * ((n % 11 ? 1 : 2) - u0) : 0);
        const float u = n % 13 == 0 ? 1 : n % 7 ? (float)check_next(&numbers) : u0;
        const spsi_interval s = {u0, u1, 1, soft_one};
        spsi_intervals v;
        float share[SPSI_LANES];
        v.u0 = spsi_set(u0), v.u1 = spsi_set(u1), v.depth = spsi_set(1), v.soft = soft_one;
        spsi_store(share, spsi_intervals_before(&v, spsi_set(u)));
        /* two roundings of the position s, then the share, whose slope in s is at most 1.5, or 2 in the rest of a
           chord, and which is computed from numbers up to 6 with six roundings, divided by 1 or, for a part, up to 2.5
         */
        if (u < 1)
            CHECK_NEAR((double)share[0], exact_share(&s, (double)u),
                       (soft_one > 0 && soft_one < 1 ? 24 : 8) * half_ulp);
        CHECK_NEAR((double)list_depth(&s, 1, u), exact_share(&s, (double)u),
                   (soft_one > 0 && soft_one < 1 ? 24 : 8) * half_ulp);
    }
}

static void test_sort(void) {
    static spsi_interval list[5000], other[5000], room[2501];
    for (int n = 0; n < 30; ++n) {
        const uint32_t count = n < 6 ? (uint32_t)n : (uint32_t)between(2, 5000);
        double sum = 0, sum_sorted = 0;
        int good = 1;
        for (uint32_t i = 0; i < count; ++i) {
            const spsi_interval s = {(float)(int)between(0, 300) / 300, (float)(int)between(0, 3), (float)between(0, 9),
                                     (float)(i % 2)};
            list[i] = s;
            other[count - 1 - i] = s;
            sum += floor((double)s.depth * 1024);
        }
        memset(&room[count / 2], 0x5a, sizeof *room);
        spsi_intervals_sort(list, count, room);
        spsi_intervals_sort(other, count, room);
        CHECK(((unsigned char *)&room[count / 2])[3] == 0x5a);
        for (uint32_t i = 0; i < count; ++i) {
            good &= i == 0 || list[i - 1].u0 <= list[i].u0;
            sum_sorted += floor((double)list[i].depth * 1024);
        }
        CHECK(good);
        CHECK_NEAR(sum_sorted, sum, 0);
        CHECK(memcmp(list, other, count * sizeof *list) == 0); /* in any order of insertion */
    }
}

/* ---------------------------------------------------------------------------------------------------- lists, curves */

static void test_deep(void) {
    for (int n = 0; n < COLUMNS; ++n) {
        const column *c = &columns[n];
        curve_build(c); /* sorts */
        for (int i = 0; i <= SAMPLES; ++i) {
            const double exact = exact_depth(c, (double)sample(i));
            /* the share's float roundings: at most 8 half units, see test_before; the result's */
            CHECK_NEAR((double)list_depth(sorted, (uint32_t)c->count, sample(i)), exact,
                       9 * half_ulp * exact);
        }
    }
}

static int has_soft(const column *c) {
    for (int i = 0; i < c->count; ++i)
        if (c->list[i].soft > 0) return 1;
    return 0;
}

/* Error of T of a curve's chords. */
static double soft_error(const column *c) { return has_soft(c) ? CURVE_ERROR : 0; }

static void test_curve(void) {
    for (int n = 0; n < COLUMNS; ++n) {
        const column *c = &columns[n];
        const int count = curve_build(c);
        int good = 1;
        CHECK(c->count == 0 ? count == 0 : count > 0 && !(curve[0].value > 0));
        for (int i = 1; i < count; ++i) {
            good &= curve[i].u >= curve[i - 1].u && curve[i].value >= curve[i - 1].value;
            good &= curve[i].u > curve[i - 1].u || curve[i].value > curve[i - 1].value; /* none twice */
            good &= i < 2 || curve[i].u > curve[i - 2].u;
        }
        if (!CHECK(good)) printf("    %s\n", c->name);
        for (int i = 0; i <= 4 * SAMPLES; ++i) {
            const float u = i <= SAMPLES ? sample(i) : c->count ? c->list[i % c->count].u0 : 0;
            const double exact = exact_depth(c, (double)u), value = curve_at(curve, count, (double)u);
            /* roundings of a share and a piece, and of a node; only T is bounded within soft pieces */
            if (!has_soft(c) && !CHECK_NEAR(value, exact, 10 * half_ulp * exact))
                printf("    %s at %g\n", c->name, (double)u);
            if (!CHECK_NEAR(exp(-value), exp(-exact), 10 * half_ulp * exact * exp(-fmin(value, exact)) + soft_error(c)))
                printf("    %s at %g\n", c->name, (double)u);
        }
    }
}

/* Intervals cut by 0, by 1 or by the light make a curve that is exact at its ends, and planes have their shares
   exactly. A share is off by at most 24 half units (test_before), a sum by one more for each interval. */
static void test_cut(void) {
    for (int n = 0; n < 200; ++n) {
        const sps_tmap_settings planes = settings_of(SPS_TMAP_OPACITY, 7);
        float texel[7];
        double whole;
        column c;
        int count, good = 1;
        c.name = "cut", c.count = 0;
        for (int i = 0; i < 1 + n % 4; ++i) {
            const double middle = between(-0.1, 1.1), reach = pow(10, between(-2, 1));
            column_add(&c, fmin(middle - reach, 1), fmax(middle + reach, 0), pow(10, between(-2, 3)),
                       i % 3 == 2 ? between(0.05, 1)
                       : i % 3    ? 0
                                  : 1);
        }
        whole = exact_depth(&c, 1);
        count = curve_build(&c);
        for (int i = 0; i < count; ++i) good &= curve[i].u >= 0 && curve[i].u <= 1 && curve[i].value >= 0;
        CHECK(good && !(curve[0].value > 0));
        for (int i = 0; i <= 20; ++i) {
            const double exact = exact_depth(&c, i / 20.0), made = curve_at(curve, count, i / 20.0);
            CHECK_NEAR(exp(-made), exp(-exact), 40 * half_ulp * whole * exp(-fmin(made, exact)) + soft_error(&c));
        }
        CHECK_NEAR((double)curve[count - 1].value, whole, 40 * half_ulp * whole);
        build(&planes, &c, texel);
        for (int i = 0; i < 7; ++i)
            CHECK_NEAR((double)texel[i], exact_depth(&c, (double)((float)(i + 1) / 7)), 40 * half_ulp * whole);
    }
}

/* Nodes are at the ends of soft pieces, and exact there. Chords of T within an error e are half as many as even pieces
   for a whole soft interval of depth 12, which need sqrt(6 * 12 / (8 e)). */
static void test_curve_soft(void) {
    const int count = curve_build(&columns[8]);
    CHECK(count > 9 && count < 0.5 * sqrt(6.0 * 12 / (8 * CURVE_ERROR)));
    for (int i = 0; i < count; ++i) /* its share, the sum of that many pieces, and its own rounding */
        CHECK_NEAR((double)curve[i].value, exact_depth(&columns[8], (double)curve[i].u), 1.2 * 12 * half_ulp);
}

/* Two slabs, one inside the other, 1e12 times as dense over a length of 1e-12: the round-off of the slope must not be
   lost. */
static void test_curve_contrast(void) {
    column c;
    int count;
    c.count = 0;
    column_add(&c, 0, 1, 1, 0);
    column_add(&c, 1e-13, 1.1e-12, 1, 0);
    column_add(&c, 0, 1e-30, 1, 0);
    count = curve_build(&c);
    CHECK_NEAR((double)curve[count - 1].value, 3, 6 * half_ulp);
    CHECK_NEAR(curve_at(curve, count, 0.5), 2.5, 6 * half_ulp);
}

/* Sheets that share one u, where a slab ends and another begins, make one jump; gas of depth 0 makes no nodes. */
static void test_curve_merging(void) {
    column c;
    c.count = 0;
    column_add(&c, 0.25, 0.5, 1, 0);
    for (int i = 0; i < 4; ++i) column_add(&c, 0.5, 0.5, 1, i % 2);
    column_add(&c, 0.5, 0.75, 1, 0);
    column_add(&c, 0.6, 0.7, 0, 0);
    CHECK(curve_build(&c) == 4);
    CHECK_NEAR((double)curve[1].value, 1, 2 * half_ulp);
    CHECK_NEAR((double)curve[2].value, 5, 10 * half_ulp);
    CHECK(!(curve[1].u < curve[2].u) && curve[2].u < curve[3].u);
}

/* Optical depth at u, linear between two nodes. */
static double depth_on(const spsi_node ends[2], float u) {
    const double length = (double)ends[1].u - (double)ends[0].u, share = ((double)u - (double)ends[0].u) / length;
    return (double)ends[0].value + ((double)ends[1].value - (double)ends[0].value) * share;
}

/* Between cuts next to each other the line of T is within step^2 of the exponential, if there is a float between. */
static void test_cuts(void) {
    for (int n = 0; n < 400; ++n) {
        const double step = pow(10, between(-2, -0.3)), t0 = n % 3 ? 0 : between(0, 2);
        const float from = (float)between(0, 0.9), to = from + (float)pow(10, between(-6.5, -1.1));
        const spsi_node ends[2] = {{from, (float)t0}, {to, (float)(t0 + pow(10, between(-2, 3)))}};
        double worst = 0;
        spsi_cuts cuts;
        int count = 0, more = 1;
        cuts.end = 1;
        spsi_cuts_piece(&cuts, ends, 0);
        CHECK(!spsi_cuts_next(&cuts, step) && cuts.u >= from && cuts.u <= from);
        spsi_cuts_piece(&cuts, ends, 1);
        while (more && ++count < 3000) {
            const float u = cuts.u;
            const double a = cuts.through;
            CHECK_NEAR(a, exp(-depth_on(ends, u)), 1e-15);
            more = spsi_cuts_next(&cuts, step);
            if (!CHECK(cuts.u > u && (more ? cuts.u < to : !(cuts.u < to)))) break;
            for (int i = 1; i < 16; ++i) {
                const float at = u + (cuts.u - u) * (float)i / 16;
                const double t = ((double)at - (double)u) / ((double)cuts.u - (double)u);
                if (at > u && at < cuts.u) worst = fmax(worst, a + t * (cuts.through - a) - exp(-depth_on(ends, at)));
            }
        }
        CHECK(count <= 1 + 2 / step);
        if (!CHECK(worst <= step * step * (1 + 1e-9))) printf("    %g off, %g allowed\n", worst, step * step);
    }
}

static spsi_node compressed[2 * (SPSI_CURVE_NODES(MOST, SPSI_SOFT_MOST)) + 9000];

static double compressed_depth(int nodes, float u) {
    return (double)items_depth(SPS_TMAP_COMPRESSED, compressed, (uint32_t)nodes, u);
}

/* |T - T'| at u, and the exact T. */
static double compressed_error(int nodes, int count, float u) {
    const double depth = compressed_depth(nodes, u);
    return fabs(exp(-depth) - exp(-curve_at(curve, count, (double)u)));
}

static void check_compressed(const column *c, float epsilon) {
    const int count = curve_build(c), nodes = spsi_curve_compress(curve, count, epsilon, compressed);
    double worst = 0;
    int good = 1;
    CHECK(nodes <= spsi_compressed_most(count, epsilon));
    CHECK(count == 0 ? nodes == 0 : nodes > 0 && compressed[0].value >= 1);
    for (int i = 1; i < nodes; ++i) {
        good &= compressed[i].u >= compressed[i - 1].u && compressed[i].value <= compressed[i - 1].value;
        good &= compressed[i].value >= 0 && (i < 2 || compressed[i].u > compressed[i - 2].u);
    }
    if (!CHECK(good)) printf("    %s\n", c->name);
    for (int i = 0; i <= 4 * SAMPLES; ++i) {
        const float u = (float)i / (4 * SAMPLES);
        const double through = exp(-compressed_depth(nodes, u));
        worst = fmax(worst, compressed_error(nodes, count, u));
        /* for the column itself, the error of soft pieces is added; T falls no faster than depth rises */
        good &= fabs(through - exp(-exact_depth(c, (double)u))) <= (double)epsilon + soft_error(c) + 1e-6;
    }
    if (!CHECK(good)) printf("    %s: more off from the column than from its curve\n", c->name);
    for (int i = 0; i < count; ++i) { /* at each bend, next to it, and between it and the next */
        const float next = curve[i + 1 < count ? i + 1 : i].u;
        worst = fmax(worst, compressed_error(nodes, count, curve[i].u));
        worst = fmax(worst, compressed_error(nodes, count, nextafterf(curve[i].u, -1)));
        worst = fmax(worst, compressed_error(nodes, count, nextafterf(curve[i].u, 2)));
        for (int k = 1; k < 8; ++k)
            worst = fmax(worst, compressed_error(nodes, count, curve[i].u + (next - curve[i].u) * (float)k / 8));
    }
    /* the result's own rounding: t e^-t half a unit, at most e^-1 */
    if (!CHECK(worst <= (double)epsilon + 0.37 * half_ulp))
        printf("    %s: %g off, %g asked for\n", c->name, worst, (double)epsilon);
}

static void test_compressed(void) {
    static const float epsilons[] = {0.5f, 0.1f, 0.01f, 0.001f, 1e-5f};
    static column steep;
    for (int e = 0; e < 5; ++e)
        for (int n = 0; n < COLUMNS; ++n) check_compressed(&columns[n], epsilons[e]);
    for (int n = 0; n < 60; ++n) {
        steep.name = "steep";
        steep.count = 0;
        for (int i = 0; i < 8; ++i) {
            const double u = i ? (double)steep.list[i - 1].u1 : 0.3 * check_next(&numbers);
            column_add(&steep, u, u + pow(10, between(-8, -1)), pow(10, between(-3, 2)), i % 2);
        }
        check_compressed(&steep, epsilons[n % 5]);
    }
}

/* Soft intervals keep epsilon, too, as they are cut into enough pieces and a quarter of it is reserved for them; so do
   deep ones, whose light is gone after a small part of them. 1e-6 is for round-off. */
static void check_soft(const column *c, float epsilon) {
    const int count = curve_build_of(c, 0.25 * (double)epsilon);
    const int nodes = spsi_curve_compress(curve, count, 0.75f * epsilon, compressed);
    double worst = 0;
    for (int i = 0; i <= 16 * SAMPLES; ++i) {
        const float u = (float)i / (16 * SAMPLES);
        const double depth = compressed_depth(nodes, u);
        worst = fmax(worst, fabs(exp(-depth) - exp(-exact_depth(c, (double)u))));
    }
    if (!CHECK(worst <= (double)epsilon + 1e-6))
        printf("    %g off, %g asked for, %d nodes\n", worst, (double)epsilon, count);
}

static void test_compressed_soft(void) {
    static const float epsilons[] = {0.1f, 0.01f, 0.001f};
    static const double depths[] = {0.01, 0.5, 3, 7.9, 8.1, 20, 300, 1e6};
    static column c;
    for (int e = 0; e < 3; ++e) {
        for (int n = 0; n < 8; ++n) {
            c.count = 0;
            column_add(&c, 0.2, 0.7, depths[n], 1);
            check_soft(&c, epsilons[e]);
            column_add(&c, 0.21, 0.5, depths[n], 1);
            column_add(&c, 0.6, 0.9, 0.3, 1);
            check_soft(&c, epsilons[e]);
            for (int cut = 0; cut < 16; ++cut) { /* by 0, by 1, by the light */
                const double middle = -0.1 + 1.2 / 15 * cut;
                c.count = 0;
                column_add(&c, middle - 0.3, middle + 0.3, depths[n], 1);
                check_soft(&c, epsilons[e]);
                column_add(&c, -0.02, 0.1 + 0.1 * cut, depths[(n + 3) % 8], 0.05 + 0.06 * cut);
                check_soft(&c, epsilons[e]);
            }
        }
        for (int n = 0; n < 10; ++n) {
            c.count = 0;
            for (int i = 0; i < 40; ++i) {
                const double u = 0.7 * check_next(&numbers);
                column_add(&c, u, u + 0.02 + 0.25 * check_next(&numbers), 0.4 * check_next(&numbers), i % 5 > 0);
            }
            check_soft(&c, epsilons[e]);
        }
    }
}

/* A long smooth column needs few nodes: pieces of even steps of sqrt(T) have an error of an eighth of the square of
   twice a step; so T from 1 to e^-3 within 0.01 to both sides needs (1 - e^-1.5) / sqrt(4 * 0.01) = 3.9 of them; a
   quarter of the error is reserved, nodes lie on cuts, and there is one before and one behind. */
static void test_compressed_size(void) {
    const int count = curve_build(&columns[0]), nodes = spsi_curve_compress(curve, count, 0.01f, compressed);
    if (!CHECK(nodes <= 9)) printf("    %d nodes\n", nodes);
    CHECK_NEAR(compressed_depth(nodes, 1), 3, 3e-6); /* e^3 half units */
}

/* ---------------------------------------------------------------------------------------------------------- opacity */

/* Roundings of `count` sums and of shares, see test_before; only of intervals before u. */
static double sum_rounding(const column *c, double exact) { return (c->count + 10) * half_ulp * exact; }

static void check_planes(const column *c, sps_tmap_settings *settings) {
    float texel[SPSI_TMAP_COMPONENTS], bracket[2];
    double last = 0;
    build(settings, c, texel);
    CHECK_NEAR(ask(settings, texel, 0), 0, 0);
    for (int i = 0; i < settings->components; ++i) {
        const float u = settings->planes ? settings->planes[i] : (float)(i + 1) / (float)settings->components;
        const double exact = exact_depth(c, (double)u);
        if (!CHECK_NEAR(ask(settings, texel, (double)u), exact, sum_rounding(c, exact)))
            printf("    %s, plane %d of %d\n", c->name, i, settings->components);
    }
    for (int i = 0; i <= SAMPLES; ++i) {
        const double exact = exact_depth(c, (double)sample(i)), value = ask(settings, texel, (double)sample(i));
        texel_bracket(settings, texel, sample(i), bracket);
        if (!CHECK_CASE("Found in review", "opacity and deep opacity maps of 1 to 65 planes",
                        "brackets contain the exact depth",
                        fmax((double)bracket[0] - exact, exact - (double)bracket[1]), sum_rounding(c, exact),
                        "a sum of floats"))
            printf("    %s: %g is not in %g .. %g\n", c->name, exact, (double)bracket[0], (double)bracket[1]);
        CHECK(value >= (double)bracket[0] && value <= (double)bracket[1]);
        CHECK(value >= last * (1 - half_ulp)); /* never decreases, even as a cubic, except for round-off */
        last = value;
    }
}

static void test_opacity(void) {
    static const float planes[] = {0.05f, 0.2f, 0.21f, 0.43f, 0.430001f, 0.7f, 1};
    static const int counts[] = {1, 2, 3, 8, 65};
    for (int n = 0; n < COLUMNS; ++n)
        for (int cubic = 0; cubic < 2; ++cubic) {
            sps_tmap_settings settings = settings_of(SPS_TMAP_OPACITY, 7);
            settings.cubic = cubic;
            settings.planes = planes;
            check_planes(&columns[n], &settings);
            settings.planes = NULL;
            for (int k = 0; k < 5; ++k) {
                settings.components = counts[k];
                check_planes(&columns[n], &settings);
                settings.technique = SPS_TMAP_DEEP_OPACITY;
            }
            settings.technique = SPS_TMAP_OPACITY;
        }
}

/* Linear data are reproduced, with even and uneven planes; and where extinction changes smoothly, cubics are closer. */
static void test_cubic(void) {
    static const float planes[] = {0.05f, 0.2f, 0.21f, 0.43f, 0.6f, 0.95f, 1};
    float texel[SPSI_TMAP_COMPONENTS];
    double worst[2] = {0, 0};
    sps_tmap_settings settings = settings_of(SPS_TMAP_OPACITY, 7);
    settings.cubic = 1;
    for (int given = 0; given < 2; ++given) {
        settings.planes = given ? planes : NULL;
        for (int i = 0; i < 7; ++i) texel[i] = 3 * (given ? planes[i] : (float)(i + 1) / 7);
        for (int i = 0; i <= SAMPLES; ++i) /* planes are rounded, and so are 3 times these */
            CHECK_NEAR(ask(&settings, texel, (double)sample(i)), 3 * (double)sample(i), 3 * 4 * half_ulp);
    }
    { /* Steffen's slopes are a parabola's if secants differ by less than a factor of 2: exact between inner planes */
        static const float uneven[] = {0.5f, 0.6f, 0.75f, 0.8f, 1};
        settings.planes = uneven;
        settings.components = 5;
        for (int i = 0; i < 5; ++i) texel[i] = uneven[i] * uneven[i];
        for (int i = 1; i < 64; ++i) { /* values are rounded, and slopes over 0.05 of them */
            const double u = 0.6 + 0.15 * i / 64;
            CHECK_NEAR(ask(&settings, texel, u), (double)(float)u * (double)(float)u, half_ulp * (2 + 2 / 0.05 * 0.15));
        }
        settings.planes = NULL;
    }
    settings = settings_of(SPS_TMAP_OPACITY, 16);
    for (int cubic = 0; cubic < 2; ++cubic) {
        settings.cubic = cubic;
        build(&settings, &columns[3], texel);
        for (int i = 0; i <= SAMPLES; ++i)
            worst[cubic] = fmax(worst[cubic], fabs(ask(&settings, texel, (double)sample(i)) -
                                                   exact_depth(&columns[3], (double)sample(i))));
    }
    /* straight lines: h^2 / 8 of the slope of extinction, which is at most 3.08 / (0.334 * 0.4)^2 * 0.242 */
    CHECK(worst[0] <= 1.1 / 256 / 8 * 3.08 * 0.242 / (0.1333 * 0.1333));
    CHECK(worst[1] < 0.5 * worst[0]);
}

/* ---------------------------------------------------------------------------------------------------------- Fourier */

/* The mean of cos(w (u - middle)) over an interval; by its series in w half where the closed form cancels. */
static double spread_of(const spsi_interval *s, double w) {
    const double x = 0.5 * w * ((double)s->u1 - (double)s->u0);
    if (x < 1e-3) return s->soft > 0 ? 1 - x * x / 10 : 1 - x * x / 6;
    return s->soft > 0 ? 3 * (sin(x) - x * cos(x)) / (x * x * x) : sin(x) / x;
}

static void fourier_exact(const column *c, int n, double *a, double *b) {
    for (int k = 0; k <= n; ++k) {
        a[k] = b[k] = 0;
        for (int i = 0; i < c->count; ++i) {
            const double w = 2 * pi * k, m = 0.5 * ((double)c->list[i].u0 + (double)c->list[i].u1);
            const double size = 2 * fmin((double)c->list[i].depth, 1e15) * (k ? spread_of(&c->list[i], w) : 1);
            a[k] += size * cos(w * m), b[k] += size * sin(w * m);
        }
    }
}

/* The angle 2 pi m of a middle rounded to floats is off by 2 pi half a unit, and harmonic k by k times that; so is each
   of two turns, by up to 2e-7 and two roundings; the soft spread by 1.5 times that below x = 2 or so. */
static double harmonic_rounding(int k) { return 1e-6 + k * (2 * pi * half_ulp + 2 * (2e-7 + 2 * half_ulp)); }

static void check_fourier(const column *c, sps_tmap_settings *settings) {
    const int n = (settings->components - 1) / 2;
    float texel[SPSI_TMAP_COMPONENTS];
    double a[33] = {0}, b[33] = {0}, rounding = 0;
    build(settings, c, texel);
    fourier_exact(c, n, a, b);
    for (int k = 1; k <= n; ++k) {
        const double off = (harmonic_rounding(k) + c->count * half_ulp) * a[0];
        if (!CHECK_NEAR((double)texel[2 * k - 1], a[k], off) || !CHECK_NEAR((double)texel[2 * k], b[k], off))
            printf("    %s, harmonic %d\n", c->name, k);
        rounding += 3 * off / (2 * pi * k);
    }
    rounding += (c->count + 3) * half_ulp * a[0];
    for (int i = 0; i <= SAMPLES; ++i) {
        const double u = (double)sample(i);
        double sum = 0.5 * a[0] * u;
        for (int k = 1; k <= n; ++k)
            sum += (a[k] * sin(2 * pi * k * u) + b[k] * (1 - cos(2 * pi * k * u))) / (2 * pi * k);
        sum = fmin(fmax(sum, 0), fmin(0.5 * a[0], 1e15));
        if (!CHECK_NEAR(ask(settings, texel, u), sum, rounding)) printf("    %s at %g\n", c->name, u);
    }
    CHECK_NEAR(ask(settings, texel, 1), fmin(0.5 * a[0], 1e15), (c->count + 3) * half_ulp * a[0]);
}

static void test_fourier(void) {
    static const int counts[] = {3, 7, 65};
    for (int n = 0; n < COLUMNS; ++n)
        for (int k = 0; k < 3; ++k) {
            sps_tmap_settings settings = settings_of(SPS_TMAP_FOURIER, counts[k]);
            check_fourier(&columns[n], &settings);
        }
}

/* ---------------------------------------------------------------------------------------------------------- moments */

/* Legendre's nodes for polynomials up to degree 11. */
static double moment_exact(const spsi_interval *s, int k) {
    static const double x[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
    static const double w[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
    const double m = (double)s->u0 + (double)s->u1 - 1, h = (double)s->u1 - (double)s->u0;
    double sum = 0;
    for (int i = 0; i < 6; ++i) {
        const double at = i < 3 ? x[i] : -x[i - 3], weight = w[i % 3] / 2 * (s->soft > 0 ? 1.5 * (1 - at * at) : 1);
        sum += weight * pow(m + at * h, k);
    }
    return sum;
}

static void test_moment_sums(void) {
    for (int n = 0; n < COLUMNS; ++n) {
        const column *c = &columns[n];
        sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, 7);
        float texel[SPSI_TMAP_COMPONENTS];
        double whole = 0;
        build(&settings, c, texel);
        for (int i = 0; i < c->count; ++i) whole += fmin((double)c->list[i].depth, 1e15);
        CHECK_NEAR((double)texel[0], fmin(whole, 1e15), (c->count + 2) * half_ulp * whole);
        for (int k = 1; k < 7; ++k) {
            double sum = 0;
            for (int i = 0; i < c->count; ++i)
                sum += fmin((double)c->list[i].depth, 1e15) * moment_exact(&c->list[i], k) / whole;
            /* k roundings of a power of m, half as many of the spread, and of each sum */
            if (!CHECK_NEAR((double)texel[k], c->count ? sum : 0, (2 * k + 2 * c->count + 4) * half_ulp))
                printf("    %s, moment %d\n", c->name, k);
        }
    }
}

static void test_moment_bracket(void) {
    for (int components = 5; components <= 7; components += 2)
        for (int n = 0; n < COLUMNS; ++n) {
            const column *c = &columns[n];
            sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, components);
            float texel[SPSI_TMAP_COMPONENTS], bracket[2];
            build(&settings, c, texel);
            for (int i = 0; i <= SAMPLES; ++i) {
                const double exact = exact_depth(c, (double)sample(i)), off = sum_rounding(c, (double)texel[0]);
                const double value = ask(&settings, texel, (double)sample(i));
                texel_bracket(&settings, texel, sample(i), bracket);
                if (!CHECK((double)bracket[0] <= exact + off && (double)bracket[1] >= exact - off))
                    printf("    %s, %d: %g at %g is not in %g .. %g\n", c->name, components, exact, (double)sample(i),
                           (double)bracket[0], (double)bracket[1]);
                CHECK(value >= (double)bracket[0] && value <= (double)bracket[1]);
            }
            CHECK_NEAR(ask(&settings, texel, 1), exact_depth(c, 1), sum_rounding(c, exact_depth(c, 1)));
        }
}

/* As the bracket's comment says, it holds for moments that are off by 2e-6 each. The true value is the column's. */
static void test_moment_rounding(void) {
    for (int n = 0; n < COLUMNS; ++n) {
        const column *c = &columns[n];
        const double whole = exact_depth(c, 1), off = 2 * half_ulp * whole;
        double moments[7] = {0};
        if (c->count == 0 || whole >= 1e15) continue; /* capped, so not in proportion to the sums */
        for (int k = 1; k < 7; ++k)
            for (int i = 0; i < c->count; ++i)
                moments[k] += (double)c->list[i].depth * moment_exact(&c->list[i], k) / whole;
        for (int round = 0; round < 12; ++round) {
            const sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, 5 + 2 * (round % 2));
            float texel[SPSI_TMAP_COMPONENTS], bracket[2];
            int good = 1;
            texel[0] = (float)whole;
            for (int k = 1; k < settings.components; ++k)
                texel[k] = (float)(moments[k] + (round / 2 % 2 ? 1.9e-6 : -1.9e-6) * (round < 4 ? 1 : between(-1, 1)));
            for (int i = 0; i < 2 * SAMPLES; ++i) { /* half of them close to something */
                const double close = (double)c->list[i % c->count].u0 + between(-0.01, 0.01);
                const float u = i < SAMPLES ? sample(i) : (float)fmin(fmax(close, 0), 1);
                const double exact = exact_depth(c, (double)u);
                texel_bracket(&settings, texel, u, bracket);
                good &= (double)bracket[0] <= exact + off && (double)bracket[1] >= exact - off;
            }
            if (!CHECK(good)) printf("    %s, %d moments\n", c->name, settings.components - 1);
        }
    }
}

/* Numbers that are not the moments of any distribution have a result between 0 and the total. */
static void test_moment_nonsense(void) {
    for (int n = 0; n < 3000; ++n) {
        const sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, 5 + 2 * (n % 2));
        const double size = n % 5 ? 1 : 1e30;
        float texel[SPSI_TMAP_COMPONENTS], bracket[2];
        texel[0] = 2;
        for (int k = 1; k < 7; ++k) texel[k] = (float)(n % 7 ? between(-size, size) : between(0, 3) < 1 ? 1 : -1);
        for (int i = 0; i <= 8; ++i) {
            const double value = ask(&settings, texel, i / 8.0);
            texel_bracket(&settings, texel, (float)i / 8, bracket);
            CHECK(value >= 0 && value <= 2 && bracket[0] >= 0 && bracket[1] <= 2 && bracket[0] <= bracket[1]);
        }
    }
}

/* The polynomial ((x - z0) / (z - z0))^m is 1 at z, and its square has a mean of at most a (2 / |z - z0|)^2m over a
   mass at z0 and a share `a` within -1 .. 1: that is the maximum mass at z, and the bracket's width. A moment's
   round-off is multiplied by at most 2^2m / |z - z0|^2m, too. */
static void test_moment_step(void) {
    static const double biases[2] = {5e-7, 5e-6};
    for (int components = 5; components <= 7; components += 2) {
        sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, components);
        float texel[SPSI_TMAP_COMPONENTS];
        build(&settings, &columns[2], texel);
        for (int i = 0; i <= SAMPLES; ++i) {
            const double u = (double)sample(i), exact = exact_depth(&columns[2], u);
            const double share = biases[(components - 5) / 2] + 9 * half_ulp;
            const double width = share * pow(2 / fabs(2 * (u - 0.43) + 1e-30), components - 1);
            if (width < 0.5) CHECK_NEAR(ask(&settings, texel, u), exact, 1.5 * (width + half_ulp));
        }
    }
}

/* Six moments resolve three sheets; the same argument at and beside each. For uniform gas: bounds of
   Legendre's weights around the true value, and the middle is closer to it than a quarter of them. */
static void test_moment_points(void) {
    static const double at[3] = {0.2, 0.5, 0.85};
    column c;
    c.count = 0;
    for (int i = 0; i < 3; ++i) column_add(&c, at[i], at[i], 1, 0);
    {
        sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, 7);
        float texel[SPSI_TMAP_COMPONENTS];
        build(&settings, &c, texel);
        for (int i = 0; i <= SAMPLES; ++i) {
            const double u = (double)sample(i), z = 2 * u - 1;
            double product = 1;
            for (int k = 0; k < 3; ++k) product *= (z - 2 * at[k] + 1) * (z - 2 * at[k] + 1);
            /* prod (x - x_k)^2 is at most 7.3 in -1 .. 1, where the share of 5e-5 and rounding, 64 half units, lie */
            if (7.3 * (5e-5 + 64 * half_ulp) / product < 0.1)
                CHECK_NEAR(ask(&settings, texel, u), exact_depth(&c, u), 3 * 1.5 * 7.3 * 6e-5 / product + 1e-6);
        }
    }
}

static void test_moment_uniform(void) {
    column c;
    c.count = 0;
    column_add(&c, 0, 1, 1, 0);
    for (int components = 5; components <= 7; components += 2) {
        sps_tmap_settings settings = settings_of(SPS_TMAP_MOMENT, components);
        float texel[SPSI_TMAP_COMPONENTS];
        build(&settings, &c, texel);
        /* At the middle of a symmetric column, the middle of the bracket is exact by symmetry. */
        CHECK_NEAR(ask(&settings, texel, 0.5), 0.5, 1e-5);
        { /* Radau's weight at the end of n points is 1 / n^2. The bias is a share of less than all moved there;
             moments' rounding is multiplied by coefficients of a squared polynomial: at most (1 + root 2)^2m / n^2 in
             sum */
            static const double biases[2] = {5e-7, 5e-6};
            const double points = 0.5 * (components + 1);
            const double rounding = pow(1 + sqrt(2), components - 1) / (points * points) * 5 * half_ulp / 3;
            CHECK_NEAR(ask(&settings, texel, 0), 0.5 / (points * points),
                       0.5 * (biases[(components - 5) / 2] + rounding));
        }
        for (int i = 0; i <= SAMPLES; ++i) { /* Gauss-Legendre's largest weight is 4/9 of 1, or 0.326 */
            const double widest = components == 5 ? 4.0 / 9 : 0.327;
            CHECK_NEAR(ask(&settings, texel, (double)sample(i)), (double)sample(i), 0.5 * widest);
        }
    }
}

/* -------------------------------------------------------------------------------------------- few nodes */

/* The nodes that a compressed map of at most `most` keeps of a column, in `compressed`; returns their number. */
static int thin(const column *c, int most) {
    const int count = curve_build(c), made = spsi_curve_compress(curve, count, SPSI_THIN_EPSILON, compressed);
    return made > 0 ? spsi_nodes_thin(compressed, made, most, curve[count - 1].value) : 0;
}

static double thin_through(int nodes, double u) { return exp(-compressed_depth(nodes, (float)u)); }

static void test_few_nodes(void) {
    for (int most = 2; most <= 32; most += 2)
        for (int n = 0; n < COLUMNS; ++n) {
            const int nodes = thin(&columns[n], most);
            double worst = 0;
            int good = nodes <= most && (nodes == 0 || compressed[0].value >= 1);
            for (int i = 0; i <= SAMPLES; ++i) {
                const double u = (double)sample(i);
                worst = fmax(worst, fabs(thin_through(nodes, u) - exp(-exact_depth(&columns[n], u))));
            }
            for (int i = 1; i < nodes; ++i)
                good &= compressed[i].u >= compressed[i - 1].u && compressed[i].value <= compressed[i - 1].value &&
                        compressed[i].value >= 0;
            if (!CHECK(good)) printf("    %s: nodes out of order\n", columns[n].name);
            /* both ends are kept: exact behind everything, to a float T; half a unit of 1 */
            CHECK_NEAR(thin_through(nodes, 1), exp(-exact_depth(&columns[n], 1)), 1e-7);
            /* one jump needs three nodes, the cap's slab and jump 2 + 1 and cuts of it: then only the error of cuts,
               1/4096, remains; eight jumps need 17 */
            if (n == 2 && most >= 4) CHECK_NEAR(worst, 0, 1e-7);
            if (n == 4 && most >= 18) CHECK_NEAR(worst, 0, 2e-7);
            /* k even steps of the root of T over all of it would be (1 / k)^2 / 2 off, for one slab; leaving out what
               costs least keeps areas, not errors, alike: where steps are uneven by 2, errors are by 4; two slabs have
               two ends more */
            if (n <= 1 && most >= 6)
                if (!CHECK(worst <= 4 * 0.5 / pow(most - 1 - 2 * n - 1, 2) + 1.0 / 4096))
                    printf("    %s: %g off with %d\n", columns[n].name, worst, most);
        }
}

enum { GRID = 96, NODES_MOST = 16 };

/* The minimum sum of squared errors, over all points of a grid, of straight lines between `most` points of a curve,
   including the first and the last: by dynamic programming. */
static double optimal_squares(const double *through, int most) {
    static double cost[GRID + 1][GRID + 1], best[NODES_MOST + 1][GRID + 1];
    for (int i = 0; i <= GRID; ++i)
        for (int j = i + 1; j <= GRID; ++j) {
            cost[i][j] = 0;
            for (int k = i + 1; k < j; ++k) {
                const double line = through[i] + (through[j] - through[i]) * (k - i) / (j - i);
                cost[i][j] += (line - through[k]) * (line - through[k]);
            }
        }
    for (int i = 0; i <= GRID; ++i) best[1][i] = i > 0 ? HUGE_VAL : 0;
    for (int n = 2; n <= most; ++n)
        for (int j = 0; j <= GRID; ++j) {
            best[n][j] = best[n - 1][j];
            for (int i = 0; i < j; ++i) best[n][j] = fmin(best[n][j], best[n - 1][i] + cost[i][j]);
        }
    return best[most][GRID];
}

/* Least area is not least squares, but comes close: over 40 columns like those of a puff of smoke the map's rms error
   is at most 1.5 times that of the best nodes, for 4, 6, 8 or 16 of them. There is no theorem; the test guards against
   the error of removing nodes during insertion, which was 2.5 times with 4. */
static void test_few_nodes_are_near_the_best(void) {
    static const int most[4] = {4, 6, 8, 16};
    for (int t = 0; t < 4; ++t) {
        check_random random = {2024};
        double made = 0, best = 0;
        for (int n = 0; n < 40; ++n) {
            double through[GRID + 1];
            column c;
            int nodes;
            c.name = "puff", c.count = 0;
            for (int i = 0; i < 12 + n; ++i) {
                const double u = 0.1 + 0.7 * check_next(&random), gap = u > 0.35 && u < 0.5 && n % 2 ? 0.2 : 0;
                column_add(&c, u + gap, u + gap + 0.03 + 0.05 * check_next(&random), 0.3 * check_next(&random), 0);
            }
            nodes = thin(&c, most[t]);
            for (int i = 0; i <= GRID; ++i) {
                const double first = (double)curve[0].u, last = (double)compressed[nodes - 1].u;
                const double u = first + (last - first) * i / GRID;
                through[i] = exp(-exact_depth(&c, u));
                made += pow(thin_through(nodes, u) - through[i], 2);
            }
            best += optimal_squares(through, most[t]);
        }
        if (!CHECK_CASE("Found in review", "compressed maps of 4 to 16 nodes", "rms / that of the best nodes",
                        sqrt(made / best), 1.5, "no theorem; nodes dropped as they come had 2.5"))
            printf("    %d nodes: rms %g, of the best nodes %g\n", most[t], sqrt(made / (40 * (GRID + 1))),
                   sqrt(best / (40 * (GRID + 1))));
    }
}

/* -------------------------------------------------------------------------------------------------------- insertion */

/* Every lane gets its own intervals; each lane must have the same result as alone. */
static void test_lanes(void) {
    static const sps_tmap_technique sums[] = {SPS_TMAP_OPACITY, SPS_TMAP_FOURIER, SPS_TMAP_MOMENT};
    static float together[STRIDE * SPSI_TMAP_COMPONENTS];
    for (int t = 0; t < 3; ++t) {
        const sps_tmap_settings settings = settings_of(sums[t], t < 2 ? 65 : 7);
        column lanes[SPSI_LANES];
        sums_clear(&settings, together);
        for (int lane = 0; lane < SPSI_LANES; ++lane) lanes[lane].name = "lane", lanes[lane].count = 0;
        for (int n = 0; n < 20; ++n) {
            float u0[SPSI_LANES], u1[SPSI_LANES], depth[SPSI_LANES];
            spsi_intervals v;
            v.soft = (float)(n % 2);
            for (int lane = 0; lane < SPSI_LANES; ++lane) {
                const spsi_interval *s = &lanes[lane].list[n];
                const double from = between(0, 0.9);
                column_add(&lanes[lane], from, n % 3 ? from + between(0, 0.1) : from, between(-1, 3), n % 2);
                u0[lane] = s->u0, u1[lane] = s->u1, depth[lane] = s->depth > 0 ? s->depth : 0;
                lanes[lane].list[n].depth = depth[lane];
            }
            v.u0 = spsi_load(u0), v.u1 = spsi_load(u1), v.depth = spsi_load(depth);
            spsi_techniques[settings.technique].insert(&settings, together, STRIDE, &v);
        }
        for (int lane = 0; lane < SPSI_LANES; ++lane) {
            float texel[SPSI_TMAP_COMPONENTS], alone[SPSI_TMAP_COMPONENTS];
            pick(&settings, together, lane, texel);
            build(&settings, &lanes[lane], alone);
            /* the same roundings, except for differences of planes, which begin elsewhere with other lanes' extents */
            for (int k = 0; k < settings.components; ++k)
                if (!CHECK_NEAR((double)texel[k], (double)alone[k], 20 * half_ulp * (1 + fabs((double)alone[k]))))
                    printf("    technique %d, component %d\n", (int)settings.technique, k);
        }
    }
}

/* The same in any order, except for roundings of sums: one each, of the total. */
static void test_order(void) {
    static const sps_tmap_technique sums[] = {SPS_TMAP_OPACITY, SPS_TMAP_FOURIER, SPS_TMAP_MOMENT};
    column shuffled = columns[10];
    for (int i = 0; i < shuffled.count; ++i) {
        const int k = (int)between(i, shuffled.count);
        const spsi_interval taken = shuffled.list[i];
        shuffled.list[i] = shuffled.list[k], shuffled.list[k] = taken;
    }
    for (int t = 0; t < 3; ++t) {
        const sps_tmap_settings settings = settings_of(sums[t], t == 0 ? 8 : t == 1 ? 15 : 7);
        float texel[SPSI_TMAP_COMPONENTS], other[SPSI_TMAP_COMPONENTS];
        const double most = 2 * exact_depth(&shuffled, 1) + 1;
        build(&settings, &columns[10], texel);
        build(&settings, &shuffled, other);
        for (int k = 0; k < settings.components; ++k)
            CHECK_NEAR((double)texel[k], (double)other[k], 2 * 200 * half_ulp * most);
    }
    { /* a curve's intervals are sorted first: the same bits */
        static spsi_node other[SPSI_CURVE_NODES(MOST, SPSI_SOFT_MOST)];
        const int count = curve_build(&columns[10]);
        memcpy(other, curve, (size_t)count * sizeof *curve);
        CHECK(curve_build(&shuffled) == count && memcmp(curve, other, (size_t)count * sizeof *curve) == 0);
    }
}

/* --------------------------------------------------------------------------------------------------------- extremes */

static void check_answers(const sps_tmap_settings *settings, const column *c, const char *what) {
    const spsi_technique *technique = &spsi_techniques[settings->technique];
    static const float at[] = {0, 1e-45f, 1e-6f, 0.25f, 0.5f, 0.50000006f, 0.75f, 0.99999994f, 1};
    float texel[SPSI_TMAP_COMPONENTS], bracket[2];
    build(settings, c, texel);
    for (int k = 0; k < settings->components; ++k) CHECK(fabsf(texel[k]) <= 1e33f);
    for (int i = 0; i < 9; ++i) {
        const float depth = texel_depth(settings, texel, at[i]);
        int good = depth >= 0 && depth <= SPSI_DEPTH_MAX;
        if (technique->bracket) {
            texel_bracket(settings, texel, at[i], bracket);
            good &= bracket[0] >= 0 && bracket[0] <= depth && depth <= bracket[1] && bracket[1] <= SPSI_DEPTH_MAX;
        }
        if (!CHECK(good)) printf("    %s, %s: %g at %g\n", technique->name, what, (double)depth, (double)at[i]);
    }
}

static void check_all_techniques(const column *c, const char *what) {
    for (int t = SPS_TMAP_OPACITY; t <= SPS_TMAP_BEER; ++t) {
        const spsi_technique *technique = &spsi_techniques[t];
        for (int variant = 0; variant < 3; ++variant) {
            const int components = variant == 0 ? technique->usual : variant == 1 ? technique->least : technique->most;
            sps_tmap_settings settings = settings_of((sps_tmap_technique)t, components);
            settings.cubic = variant == 0;
            check_answers(&settings, c, what);
        }
    }
}

static void test_extremes(void) {
    static const double depths[] = {1e-30, 1e-8, 1, 90, 1e8, 1e15, 1e18};
    static const double ends[][2] = {{0, 0},     {1, 1},          {0, 1},           {0.5, 0.5},
                                     {0, 1e-45}, {0.99999994, 1}, {0.5, 0.50000006}};
    for (int d = 0; d < 7; ++d)
        for (int e = 0; e < 7; ++e)
            for (int soft = 0; soft < 2; ++soft) {
                column c;
                char what[64];
                c.name = what, c.count = 0;
                snprintf(what, sizeof what, "depth %g in %g .. %g, soft %d", depths[d], ends[e][0], ends[e][1], soft);
                column_add(&c, ends[e][0], ends[e][1], depths[d], soft);
                check_all_techniques(&c, what);
                check_compressed(&c, 0.01f);
                column_add(&c, 0.2, 0.7, depths[(d + 3) % 7], !soft);
                column_add(&c, ends[(e + 1) % 7][0], ends[(e + 1) % 7][1], depths[(d + 1) % 7], 0);
                spsi_intervals_sort(c.list, 3, scratch);
                check_all_techniques(&c, what);
                check_compressed(&c, 0.01f);
                CHECK((double)list_depth(c.list, 3, 1) <= 1e15 * (1 + half_ulp));
            }
    { /* faint gas keeps its depth in maps that store depth: relative roundings */
        static const sps_tmap_technique faint[] = {SPS_TMAP_OPACITY, SPS_TMAP_FOURIER, SPS_TMAP_MOMENT};
        column c;
        c.count = 0;
        column_add(&c, 0.2, 0.4, 1e-8, 1);
        for (int t = 0; t < 3; ++t) {
            const sps_tmap_settings settings = settings_of(faint[t], spsi_techniques[faint[t]].usual);
            float texel[SPSI_TMAP_COMPONENTS];
            build(&settings, &c, texel);
            CHECK_NEAR(ask(&settings, texel, 1), 1e-8, 1e-8 * 6 * half_ulp);
        }
    }
}

/* As documented at the public types. */
static void test_table(void) {
    static const char *names[] = {"no map",  "deep",   "compressed", "opacity",      "deep opacity",
                                  "Fourier", "moment", "Beer",       "shadow table", "depth"};
    static const int ranges[][4] = {{0, 0, 0, 0},   {0, 0, 0, 0}, {4, 64, 0, 0}, {1, 65, 8, 0},     {3, 65, 8, 1},
                                    {3, 65, 7, -1}, {5, 7, 5, 0}, {3, 3, 3, 1},  {8, 1024, 256, 0}, {0, 0, 0, 0}};
    const int count = (int)(sizeof spsi_techniques / sizeof *spsi_techniques);
    CHECK(count == SPS_TMAP_DEPTH + 1);
    for (int t = SPS_TMAP_DEEP; t < count; ++t) {
        const spsi_technique *p = &spsi_techniques[t];
        CHECK(p->name && strstr(p->name, names[t]));
        CHECK(p->least == ranges[t][0] && p->most == ranges[t][1] && p->usual == ranges[t][2] &&
              p->range == ranges[t][3]);
        CHECK((p->lists > 0) == (t <= SPS_TMAP_COMPRESSED));
        if (p->lists || t == SPS_TMAP_DEPTH) continue;
        CHECK(p->insert);
        CHECK((p->depths != NULL) == (t != SPS_TMAP_TABLE)); /* which is no map */
        CHECK(p->usual >= p->least && p->usual <= p->most && (p->usual - p->least) % p->step == 0);
        CHECK((p->most - p->least) % p->step == 0 && (p->most <= SPSI_TMAP_COMPONENTS || t == SPS_TMAP_TABLE));
    }
}

/* -------------------------------------------------------------------------------------------------------- the table */

static double table_error(const column *c, int t) {
    const spsi_technique *technique = &spsi_techniques[t];
    const sps_tmap_settings settings = settings_of((sps_tmap_technique)t, technique->usual);
    float texel[SPSI_TMAP_COMPONENTS];
    double worst = 0;
    int nodes = 0;
    if (t == SPS_TMAP_COMPRESSED)
        nodes = spsi_curve_compress(curve, curve_build(c), 0.01f, compressed);
    else if (t == SPS_TMAP_DEEP)
        curve_build(c);
    else
        build(&settings, c, texel);
    for (int i = 0; i <= 4 * SAMPLES; ++i) {
        const float u = (float)i / (4 * SAMPLES);
        const double depth = t == SPS_TMAP_DEEP ? (double)list_depth(sorted, (uint32_t)c->count, u)
                             : t == SPS_TMAP_COMPRESSED ? compressed_depth(nodes, u)
                                                        : ask(&settings, texel, (double)u);
        worst = fmax(worst, fabs(exp(-depth) - exp(-exact_depth(c, (double)u))));
    }
    return worst;
}

static void print_table(void) {
    printf("%-20s", "largest error of T");
    for (int n = 0; n < COLUMNS; ++n) printf(" %9.9s", columns[n].name);
    for (int t = SPS_TMAP_DEEP; t <= SPS_TMAP_BEER; ++t) {
        printf("\n%-20s", spsi_techniques[t].name);
        for (int n = 0; n < COLUMNS; ++n) printf(" %9.2g", table_error(&columns[n], t));
    }
    printf("\n");
}

int main(void) {
    columns_fill();
    RUN(test_turn);
    RUN(test_before);
    RUN(test_sort);
    RUN(test_deep);
    RUN(test_curve);
    RUN(test_curve_soft);
    RUN(test_cut);
    RUN(test_curve_contrast);
    RUN(test_curve_merging);
    RUN(test_cuts);
    RUN(test_compressed);
    RUN(test_compressed_soft);
    RUN(test_compressed_size);
    RUN(test_opacity);
    RUN(test_cubic);
    RUN(test_fourier);
    RUN(test_moment_sums);
    RUN(test_moment_bracket);
    RUN(test_moment_rounding);
    RUN(test_moment_nonsense);
    RUN(test_moment_step);
    RUN(test_moment_points);
    RUN(test_moment_uniform);
    RUN(test_few_nodes);
    RUN(test_few_nodes_are_near_the_best);
    RUN(test_lanes);
    RUN(test_order);
    RUN(test_extremes);
    RUN(test_table);
    if (getenv("CHECK_TABLE")) print_table();
    return check_report();
}
