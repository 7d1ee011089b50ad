/* The vector section against plain C: each operation lane by lane against arithmetic, the vector functions against the
   C library in double precision, and whole pictures against those of this very program compiled with SPS_NO_SIMD.

   One binary has one width. So the pictures of the other come from a second program: this file, which the test has the
   system's C compiler translate with SPS_NO_SIMD, and which, called with a file's name, writes its pictures there. The
   operations of narrower vectors are tested by programs of this file, too: VECTORS_ONLY leaves out all else. */

#include "check.h"

/* The folder of the header that this program was compiled with: mutants.sh and the Makefile have several. */
#ifndef CHECK_HEADERS
#define CHECK_HEADERS "."
#endif

enum { WIDTH = 70, HEIGHT = 45, FLOATS = 5 * WIDTH * HEIGHT, SCENES = 7 };

/* ------------------------------------------------------------------------------------------------------- operations */

static check_random numbers = {7};

static float between(double low, double high) { return (float)(low + (high - low) * check_next(&numbers)); }

static int same_bits(float a, float b) { return memcmp(&a, &b, sizeof a) == 0; }

/* Four vectors of inputs, and the result of one operation on the first three. */
typedef struct lanes {
    float a[SPSI_LANES], b[SPSI_LANES], c[SPSI_LANES], out[SPSI_LANES];
} lanes;

static void lanes_fill(lanes *l) {
    for (int i = 0; i < SPSI_LANES; ++i) {
        l->a[i] = between(-9, 9);
        l->b[i] = between(-9, 9);
        l->c[i] = between(-9, 9);
    }
}

#define CHECK_LANES(operation, expected)                                                                               \
    do {                                                                                                               \
        const spsi_v a = spsi_load(l.a), b = spsi_load(l.b), c = spsi_load(l.c);                                       \
        spsi_store(l.out, (operation));                                                                                \
        for (int i = 0; i < SPSI_LANES; ++i) {                                                                         \
            const float x = l.a[i], y = l.b[i], z = l.c[i];                                                            \
            (void)y, (void)z;                                                                                          \
            if (!CHECK(same_bits(l.out[i], (expected)))) printf("    " #operation " lane %d\n", i);                    \
        }                                                                                                              \
        (void)a, (void)b, (void)c;                                                                                     \
    } while (0)

static void test_arithmetic(void) {
    for (int n = 0; n < 20; ++n) {
        lanes l;
        lanes_fill(&l);
        CHECK_LANES(a, x);
        CHECK_LANES(spsi_add(a, b), x + y);
        CHECK_LANES(spsi_sub(a, b), x - y);
        CHECK_LANES(spsi_mul(a, b), x * y);
        CHECK_LANES(spsi_div(a, b), x / y);
        CHECK_LANES(spsi_min(a, b), x < y ? x : y);
        CHECK_LANES(spsi_max(a, b), x > y ? x : y);
        CHECK_LANES(spsi_abs(a), fabsf(x));
        CHECK_LANES(spsi_sqrt(spsi_mul(a, a)), sqrtf(x * x));
        CHECK_LANES(spsi_clamp(a, spsi_set(-2), spsi_set(3)), x < -2 ? -2 : x > 3 ? 3 : x);
        CHECK_LANES(spsi_select(spsi_less(a, b), b, c), x < y ? y : z);
        CHECK_LANES(spsi_select(spsi_and(spsi_less(a, b), spsi_less(b, c)), a, c), x < y && y < z ? x : z);
    }
}

/* Fused or not: half a unit in the last place of the product, and of the sum. */
static void test_fused(void) {
    for (int n = 0; n < 50; ++n) {
        lanes l;
        lanes_fill(&l);
        spsi_store(l.out, spsi_fma(spsi_load(l.a), spsi_load(l.b), spsi_load(l.c)));
        for (int i = 0; i < SPSI_LANES; ++i) {
            const double product = (double)l.a[i] * (double)l.b[i], exact = product + (double)l.c[i];
            CHECK_NEAR((double)l.out[i], exact, 6e-8 * (fabs(product) + fabs(exact)));
        }
    }
}

static void test_masks(void) {
    float ramp[SPSI_LANES];
    spsi_store(ramp, spsi_iota());
    for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(ramp[i], (float)i));
    for (int n = 0; n <= SPSI_LANES; ++n)
        CHECK(spsi_bits(spsi_less(spsi_iota(), spsi_set((float)n))) == (int)((1u << n) - 1));
    CHECK(spsi_bits(spsi_less(spsi_set(1), spsi_set(1))) == 0);
    CHECK(spsi_bits(spsi_less(spsi_set(SPSI_INFINITY - SPSI_INFINITY), spsi_set(1))) == 0); /* NaN is not less */
}

static void test_rounding(void) {
    static const float hard[] = {0,           0.5f,         -0.5f,        1.5f,     -1.5f,     2.5f,
                                 0.49999997f, -0.49999997f, 1e6f,         -1e6f,    8388607,   -8388607,
                                 8388606.5f,  1e-30f,       -1e-30f,      16777216, -16777216, 1e9f,
                                 -1e9f,       0.99999994f,  -0.99999994f, 3,        -3};
    for (size_t k = 0; k < sizeof hard / sizeof *hard + 500; ++k) {
        const float x = k < sizeof hard / sizeof *hard ? hard[k] : between(-1e5, 1e5);
        float out[SPSI_LANES];
        spsi_store(out, spsi_floor(spsi_set(x)));
        if (!CHECK(!(out[0] < floorf(x)) && !(out[0] > floorf(x))))
            printf("    floor of %.9g is %.9g\n", (double)x, (double)out[0]);
        if (fabsf(x) > 4e6f) continue; /* adding a half is exact below */
        spsi_store(out, spsi_round(spsi_set(x)));
        if (!CHECK(fabsf(out[0] - x) <= 0.5f && !(out[0] < floorf(out[0])) && !(out[0] > floorf(out[0]))))
            printf("    nearest to %.9g is %.9g\n", (double)x, (double)out[0]);
    }
    for (int n = -126; n < 128; ++n) {
        float out[SPSI_LANES];
        spsi_store(out, spsi_pow2(spsi_set((float)n)));
        CHECK(same_bits(out[0], (float)ldexp(1, n)));
    }
}

static void test_quads(void) {
    float grid[7 * 11], x[SPSI_LANES], y[SPSI_LANES], out[4][SPSI_LANES];
    spsi_v quad[4];
    for (int i = 0; i < 77; ++i) grid[i] = (float)i;
    for (int i = 0; i < SPSI_LANES; ++i) x[i] = (float)(i * 5 % 10), y[i] = (float)(i * 3 % 6);
    spsi_lookup_quad(grid, 11, spsi_load(x), spsi_load(y), quad);
    for (int k = 0; k < 4; ++k) {
        spsi_store(out[k], quad[k]);
        for (int i = 0; i < SPSI_LANES; ++i)
            CHECK(same_bits(out[k][i], x[i] + (float)(k % 2) + 11 * (y[i] + (float)(k / 2))));
    }
}

static void test_fours(void) {
    float table[4 * 50], entry[SPSI_LANES], out[SPSI_LANES];
    spsi_v four[4];
    for (int i = 0; i < 200; ++i) table[i] = (float)i;
    for (int i = 0; i < SPSI_LANES; ++i) entry[i] = (float)(i * 7 % 50);
    spsi_lookup_four(table, spsi_load(entry), four);
    for (int c = 0; c < 4; ++c) {
        spsi_store(out, four[c]);
        for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(out[i], 4 * entry[i] + (float)c));
    }
}

/* Where a bound is NaN, the number is the result: the second argument in all builds, whichever the first is. */
static void test_unordered(void) {
    const spsi_v nan = spsi_set(SPSI_INFINITY - SPSI_INFINITY), number = spsi_set(-3);
    for (int i = 0; i < SPSI_LANES; ++i) {
        CHECK(same_bits(spsi_lane(spsi_min(nan, number), i), -3));
        CHECK(same_bits(spsi_lane(spsi_max(nan, number), i), -3));
        CHECK(same_bits(spsi_lane(spsi_select(spsi_less(nan, number), nan, number), i), -3));
        CHECK(same_bits(spsi_lane(spsi_select(spsi_less(number, nan), nan, number), i), -3));
    }
}

/* The first `count` of up to two vectors' numbers: nothing behind them is read or written, and other lanes are 0. */
static void test_first(void) {
    for (int count = 0; count <= 2 * SPSI_LANES; ++count) {
        float from[2 * SPSI_LANES], to[2 * SPSI_LANES], out[SPSI_LANES];
        for (int i = 0; i < 2 * SPSI_LANES; ++i) from[i] = i < count ? (float)(i + 1) : SPSI_INFINITY, to[i] = -1;
        spsi_store(out, spsi_load_first(from, count));
        for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(out[i], i < count ? (float)(i + 1) : 0));
        spsi_store_first(to, spsi_add(spsi_iota(), spsi_set(5)), count);
        for (int i = 0; i < 2 * SPSI_LANES; ++i)
            CHECK(same_bits(to[i], i < count && i < SPSI_LANES ? (float)(i + 5) : -1));
    }
}

/* Pairs of 16 bits, the largest of which are floats, too; one bit of 64, each of them set alone, and left out alone. */
static void test_words(void) {
    uint32_t pairs[77], bits[64][2];
    float x[SPSI_LANES], y[SPSI_LANES], out[2][SPSI_LANES];
    spsi_v pair[2];
    for (int i = 0; i < 77; ++i) pairs[i] = (uint32_t)(65535 - i) << 16 | (uint32_t)(40000 + i);
    for (int i = 0; i < SPSI_LANES; ++i) x[i] = (float)(i * 5 % 11), y[i] = (float)((i + 1) * 3 % 7);
    spsi_lookup_pair(pairs, 11, spsi_load(x), spsi_load(y), pair);
    for (int k = 0; k < 2; ++k) spsi_store(out[k], pair[k]);
    for (int i = 0; i < SPSI_LANES; ++i) {
        CHECK(same_bits(out[0][i], 40000 + x[i] + 11 * y[i]));
        CHECK(same_bits(out[1][i], 65535 - x[i] - 11 * y[i]));
    }
    for (int n = 0; n < 2 * 64 * 64; ++n) {
        const int at = n / 128, bit = n / 2 % 64, inverse = n % 2;
        int expected = 0;
        for (int i = 0; i < 64; ++i)
            for (int k = 0; k < 2; ++k) bits[i][k] = (i / 32 == k ? 1u << i % 32 : 0) ^ (inverse ? 0xffffffffu : 0);
        for (int i = 0; i < SPSI_LANES; ++i) {
            x[i] = (float)((at + i) % 64), y[i] = (float)((bit + i / 2) % 64);
            expected |= ((x[i] < y[i] || x[i] > y[i]) == inverse) << i;
        }
        CHECK(spsi_lookup_bit((const uint32_t(*)[2])bits, spsi_load(x), spsi_load(y)) == expected);
    }
}

static void test_four_floats(void) {
    static const float a[4] = {2, -3, 5, -7}, b[4] = {11, 13, -17, 19}, c[4] = {0.5f, -1, 2, -4};
    float table[4 * SPSI_LANES], out[4], sums[SPSI_LANES];
    spsi_four_store(out, spsi_four_mul(spsi_four_load(a), spsi_four_load(b)));
    for (int i = 0; i < 4; ++i) CHECK(same_bits(out[i], a[i] * b[i]));
    spsi_four_store(out, spsi_four_scale(3, spsi_four_load(b)));
    for (int i = 0; i < 4; ++i) CHECK(same_bits(out[i], 3 * b[i]));
    spsi_four_store(out, spsi_four_add(3, spsi_four_load(b), spsi_four_load(c)));
    for (int i = 0; i < 4; ++i) CHECK(same_bits(out[i], 3 * b[i] + c[i])); /* all of them whole halves */
    for (int i = 0; i < 4 * SPSI_LANES; ++i) table[i] = (float)(1 << i % 4) * (float)(i / 4 + 1);
    spsi_store(sums, spsi_sum_fours(table));
    for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(sums[i], 15 * (float)(i + 1)));
}

/* A plane's slope is exact in bilinear look-ups, within the texels' range, and so are its ends outside of it; numbers
   of one lane and of all. */
static void test_lookups(void) {
    float grid[7 * 11], out[SPSI_LANES];
    spsi_v three[2][3];
    const double vector[3] = {1, -2, 4};
    int whole[SPSI_LANES];
    for (int i = 0; i < 77; ++i) grid[i] = (float)(4 * (i % 11) - 8 * (i / 11));
    for (int n = 0; n < 14 * 10 * 4; ++n) {
        float x[SPSI_LANES], y[SPSI_LANES];
        for (int i = 0; i < SPSI_LANES; ++i) x[i] = (float)((n + i) % 56) / 4 - 1.5f, y[i] = (float)(n / 14) / 4 - 1.5f;
        spsi_store(out, spsi_bilinear(grid, 11, 7, spsi_load(x), spsi_load(y)));
        for (int i = 0; i < SPSI_LANES; ++i) {
            const double right = fmin(fmax((double)x[i], 0), 10), down = fmin(fmax((double)y[i], 0), 6);
            CHECK_NEAR((double)out[i], 4 * right - 8 * down, 0);
        }
    }
    spsi_set3(vector, three[0]);
    for (int k = 0; k < 3; ++k) three[1][k] = spsi_add(spsi_iota(), spsi_set((float)k));
    spsi_store(out, spsi_dot_v(three[0], three[1])); /* i - 2 (i + 1) + 4 (i + 2) */
    for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(out[i], (float)(3 * i + 6)));
    spsi_store(out, spsi_mix(spsi_set(8), spsi_iota(), spsi_set(0.25f)));
    for (int i = 0; i < SPSI_LANES; ++i) CHECK(same_bits(out[i], 6 + (float)i / 4));
    spsi_store_int(whole, spsi_sub(spsi_iota(), spsi_set(3)));
    for (int i = 0; i < SPSI_LANES; ++i) CHECK(whole[i] == i - 3 && same_bits(spsi_lane(spsi_iota(), i), (float)i));
    CHECK(same_bits(spsi_one(spsi_add(spsi_iota(), spsi_set(7))), 7) && SPSI_ALL_LANES == (1 << SPSI_LANES) - 1);
    for (int i = 0; i < 31; ++i) CHECK(spsi_lowest_bit(1 << i) == i && spsi_lowest_bit(-(1 << i)) == i);
}

/* -------------------------------------------------------------------------------------------------------- functions */

static double exp_of(double x) {
    float out[SPSI_LANES];
    spsi_store(out, spsi_exp(spsi_set((float)x)));
    return (double)out[0];
}

/* As its comment says: a relative error of 2e-7 from -86 to 88, and exactly 0 below. */
static void test_exp(void) {
    double worst = 0, at = 0;
    for (int i = 0; i <= 400000; ++i) {
        const float x = (float)(-86 + 174.0 * i / 400000);
        const double exact = exp((double)x), error = fabs(exp_of((double)x) - exact) / exact;
        if (error > worst) worst = error, at = (double)x;
    }
    if (!CHECK_CASE("Extremes", "exp in vectors, from -86 to 88", "relative error", worst, 2e-7,
                    "a polynomial to 1e-7, and its roundings"))
        printf("    exp is off by %g of itself at %g\n", worst, at);
    for (int i = 0; i < 60; ++i) { /* towards 0 from both sides */
        const double x = ldexp(1, -i);
        CHECK_NEAR(exp_of(-(double)(float)x), exp(-(double)(float)x), 2e-7);
        CHECK_NEAR(exp_of((double)(float)x), exp((double)(float)x), 2e-7 * exp(x));
    }
    CHECK_NEAR(exp_of(0), 1, 0);
    CHECK_CASE("Extremes", "exp of less than -86", "0, and never a denormal number",
               exp_of(-86.001) + exp_of(-1e3) + exp_of(-1e30) + exp_of(-HUGE_VAL), 0, "exact");
    CHECK(exp_of(100) > 1e38 && exp_of(1e30) <= (double)FLT_MAX); /* clamped to the end of the range */
}

static double share_of(double v) {
    float out[SPSI_LANES];
    spsi_store(out, spsi_kernel_fraction(spsi_set((float)v)));
    return (double)out[0];
}

/* Increasing from 0 to 1, odd about one half, close to that of the cut Gaussian. Round-off: each of seven steps rounds
   twice, by 6e-8 of coefficients that add up to 37, so 4e-6. */
static void test_kernel_share(void) {
    const double cut = SPSI_CUT, whole = erf(cut / sqrt(2.0));
    double before = 0, fell = 0, worst = 0, odd = 0;
    CHECK_NEAR(share_of(-1), 0, 4e-6);
    CHECK_NEAR(share_of(1), 1, 4e-6);
    CHECK(share_of(-7) == share_of(-1) && share_of(7) == share_of(1) && share_of(1e30) == share_of(1));
    CHECK(share_of(0) == 0.5);
    for (int i = -20000; i <= 20000; ++i) {
        const double v = i / 20000.0, share = share_of(v);
        fell = fmax(fell, before - share);
        before = share;
        odd = fmax(odd, fabs(share + share_of(-v) - 1));
        worst = fmax(worst, fabs(share - (0.5 + 0.5 * erf(v * cut / sqrt(2.0)) / whole)));
    }
    CHECK_NEAR(fell, 0, 4e-6);
    CHECK_NEAR(odd, 0, 4e-6);
    CHECK_NEAR(worst, 0, 2.1e-4);
}

static double mean_between(double a, double b) {
    float out[SPSI_LANES];
    spsi_store(out, spsi_mean_transmittance(spsi_set((float)a), spsi_set((float)b)));
    return (double)out[0];
}

/* Against expm1 for depths behind and across of 1e-12 to 1e15. The quotient loses two bits just above d = 0.25, so
   2e-7 of the exponential becomes 8e-7; another 2e-7 for the exponential in front, and the rounding of the steps. */
static void test_mean_transmittance(void) {
    for (int i = -1; i < 28; ++i)
        for (int k = -1; k < 55; ++k) {
            const float a = i < 0 ? 0 : (float)pow(10, i - 12), d = k < 0 ? 0 : (float)pow(10, 0.5 * k - 12), b = a + d;
            const double real = (double)b - (double)a;
            double exact = exp(-(double)a) * (real > 0 ? -expm1(-real) / real : 1);
            if (a > 86) exact = 0;
            CHECK_NEAR(mean_between((double)a, (double)b), exact, 1.2e-6 * exact + 1e-37);
            CHECK(same_bits((float)mean_between((double)a, (double)b), (float)mean_between((double)b, (double)a)));
        }
    for (int i = 0; i < 1000; ++i) { /* around the change from series to quotient */
        const double d = 0.2 + 1e-4 * i, real = (double)(float)d;
        CHECK_NEAR(mean_between(0, d), -expm1(-real) / real, 1.2e-6);
    }
}

static void test_phase(void) {
    for (int i = -99; i <= 99; i += 11)
        for (int k = -20; k <= 20; ++k) {
            const double g = (double)((float)i / 100), c = (double)((float)k / 20), q = 1 + g * g - 2 * g * c;
            float out[SPSI_LANES];
            spsi_store(out, spsi_lobe_phase((float)g, spsi_set((float)c)));
            /* q is the difference of numbers up to 4, so it has 4 * 6e-8 * 2 of error, and at least (1 - |g|)^2 */
            CHECK_NEAR((double)out[0], (1 - g * g) / (4 * PI * q * sqrt(q)),
                       (1e-6 + 7e-7 / q) * (1 - g * g) / (4 * PI * q * sqrt(q)));
        }
}

#ifndef VECTORS_ONLY

/* Of all 65536 halves: sign, exponent and fraction as IEEE 754 has them; NaN has its sign and fraction, too. */
static void test_halves(void) {
    int wrong = 0;
    for (int n = 0; n < 65536; ++n) {
        const int exponent = n >> 10 & 31, fraction = n & 1023;
        const float value = spsi_half((uint16_t)n);
        const double size =
            exponent == 31 ? HUGE_VAL : ldexp(exponent ? 1024 + fraction : fraction, (exponent ? exponent : 1) - 25);
        if (exponent == 31 && fraction)
            wrong += value == value;
        else
            wrong += !same_bits(value, (float)(n >> 15 ? -size : size));
    }
    CHECK(wrong == 0);
    CHECK_NEAR(spsi_total(spsi_iota()), 0.5 * SPSI_LANES * (SPSI_LANES - 1), 0);
}

/* --------------------------------------------------------------------------------------------------------- narrower */

static const char *self; /* this program */

/* The operations of narrower vectors, and those of plain C: on a machine that has wide ones, no other short test runs
   them by themselves. Each is a second to compile, as functions that are not inline are left out. */
static void test_narrower(void) {
#if SPSI_LANES > 4 || !defined(SPSI_X86)
    static const struct {
        int lanes;
        const char *flags;
    } builds[] = {{8, "-mavx2 -mfma"}, {4, "-msse2"}, {1, "-DSPS_NO_SIMD"}};
    FILE *source = fopen(__FILE__, "rb");
    if (source) fclose(source);
    for (int n = 0; n < 3 && source && strlen(self) < 500; ++n) {
        static char command[2048], program[600];
        if (builds[n].lanes >= SPSI_LANES) continue;
#ifndef SPSI_X86
        if (builds[n].lanes > 1) continue;
#endif
        snprintf(program, sizeof program, "%s%s.narrow", strchr(self, '/') ? "" : "./", self);
        snprintf(command, sizeof command,
                 "cc -std=c99 -O1 -w %s -DVECTORS_ONLY -I'%s' -I. -x c '%s' -o '%s' -lm 2>/dev/null", builds[n].flags,
                 CHECK_HEADERS, __FILE__, program);
        if (system(command) == 0) {
            snprintf(command, sizeof command, "unset CHECK_ONLY; '%s' %d", program, builds[n].lanes);
            if (!CHECK(system(command) == 0)) printf("    built with %s\n", builds[n].flags);
        } else {
            printf("skipped: vectors of %d: no compiler called cc here\n", builds[n].lanes);
        }
        remove(program);
    }
#endif
}

/* --------------------------------------------------------------------------------------------------------- pictures */

static int read_bumps(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) {
                const double x = (lo[0] + i) * 0.5, y = (lo[1] + j) * 0.4, z = (lo[2] + k) * 0.3;
                *out++ = (float)(0.5 + 0.25 * sin(x + 0.5 * y) + 0.25 * cos(y - z));
            }
    return 0;
}

/* The n-th scene: gas; against the light; polygons within; a point light; classified as a surface; orthographic, thin
   slabs; the same with voxels of a pixel, whose footprints are narrow enough for two rows in a vector. Quality HIGH,
   where a kernel's last ring that one program may draw and the other not is 6e-4 of its peak. */
static void scene_build(check_scene *s, check_triangles *triangles, sps_transfer *transfer, int n) {
    static const sps_transfer_point points[] = {{0.4f, {0.9f, 0.4f, 0.2f}, 0, {0, 0, 0}},
                                                {0.8f, {0.3f, 0.9f, 0.5f}, 9, {0, 0, 0}}};
    const double origin[3] = {-1.1, -0.9, 0.1}, u[3] = {2.2, 0.3, 0.2}, v[3] = {0.1, 1.1, -0.9};
    sps_volume *volume;
    check_clear(s, WIDTH, HEIGHT);
    check_set3(s->view.camera.position, 0.7, 0.9, 5);
    check_orthographic(&s->view.camera, 2.7);
    check_perspective(&s->view.camera, n >= 5 ? 0 : 0.5);
    s->view.quality = SPS_QUALITY_HIGH;
    s->view.shadow_resolution = 50;
    if (n >= 5) s->view.slab_thickness = 0.2;
    if (n == 6) s->view.filling = SPS_FILLING_SPLAT;
    volume = check_add_volume(s, n == 6 ? 26 : 13, n == 6 ? 24 : 12, n == 6 ? 22 : 11,
                              check_box(-0.9, -0.8, -0.7, 0.9, 0.8, 0.7));
    volume->read_fn = read_bumps;
    volume->extinction = 1.3f;
    volume->placement.axis[0][2] = 0.3;
    check_color(volume->albedo, 0.9, 0.8, 0.7);
    check_color(volume->emission, 0.1, 0.05, 0);
    transfer->points = points;
    transfer->point_count = 2;
    if (n == 4) volume->transfer = transfer, volume->shading = SPS_SHADING_SURFACE, volume->specular = 0.3f;
    if (n == 3)
        check_add_point(s, 1, 4, 2, 30);
    else
        check_add_directional(s, 0.4, -0.7, n == 1 ? 0.9 : -0.6, 3);
    if (n == 2) check_add_quad(triangles, origin, u, v), check_add_mesh(s, triangles, 0.7);
    check_color(s->scene.ambient, 0.1, 0.12, 0.15);
    check_color(s->scene.background, 0.2, 0.3, 0.4);
}

static float pictures[SCENES][FLOATS], plain[SCENES][FLOATS], optimised[SCENES][FLOATS];

static void render_pictures(void) {
    for (int n = 0; n < SCENES; ++n) {
        sps_context *context = check_context(NULL);
        check_triangles triangles;
        sps_transfer transfer;
        check_scene s;
        memset(&triangles, 0, sizeof triangles);
        memset(&transfer, 0, sizeof transfer);
        scene_build(&s, &triangles, &transfer, n);
        check_render_depth(context, &s, pictures[n], pictures[n] + 4 * WIDTH * HEIGHT);
        sps_destroy(context);
        check_free_triangles(&triangles);
    }
}

/* The second program. */
static int write_pictures(const char *path) {
    FILE *file = fopen(path, "wb");
    int written;
    if (!file) return 1;
    render_pictures();
    written = fwrite(pictures, sizeof pictures, 1, file) == 1;
    return fclose(file) != 0 || !written || check_failed != 0;
}

static int read_pictures(const char *path, float out[SCENES][FLOATS]) {
    FILE *file = fopen(path, "rb");
    int got;
    if (!file) return 0;
    got = fread(out, sizeof plain, 1, file) == 1;
    fclose(file);
    return got;
}

/* Compiles this file without vectors and at a level of optimisation, runs it, and reads its pictures. Returns 0, and
   says so, if there is no compiler or no source. SIMD_PLAIN in the environment is such a program, compiled before. */
static int plain_pictures(const char *self, const char *level, float out[SCENES][FLOATS]) {
    static const char *const compilers[] = {"cc", "gcc", "clang"};
    static char command[2048], program[600], output[600];
    const char *made = getenv("SIMD_PLAIN");
    int got = 0;
    FILE *source = fopen(__FILE__, "rb");
    if (source) fclose(source);
    if (source && strlen(self) < 500) {
        snprintf(program, sizeof program, "%s.plain", self);
        snprintf(output, sizeof output, "%s.plain.out", self);
        if (made && strcmp(level, "-O1") == 0) {
            snprintf(command, sizeof command, "'%s' '%s'", made, output);
            got = system(command) == 0 && read_pictures(output, out);
        }
        for (int i = 0; i < 3 && !got; ++i) {
            snprintf(command, sizeof command,
                     "%s -std=c99 %s -ffp-contract=off -DSPS_NO_SIMD -I. -x c '%s' -o '%s' -lm 2>/dev/null && "
                     "'%s' '%s'",
                     compilers[i], level, __FILE__, program, strchr(program, '/') ? program : "./simd.plain", output);
            got = system(command) == 0 && read_pictures(output, out);
        }
        remove(program);
        remove(output);
    }
    if (!got)
        printf("skipped: pictures against plain C: no compiler called cc, gcc or clang here, or no tests/ folder\n");
    return got;
}

/* The same arithmetic except for fused multiply-add: each number is the result of a few hundred roundings of 6e-8, so
   2e-5 of the largest; and, in one pixel of a thousand, of a ring of one kernel, 6e-4 of the contribution of one voxel
   of a dozen. */
static void check_picture(int n) {
    double most = 0, worst = 0;
    int differing = 0;
    for (int i = 0; i < 4 * WIDTH * HEIGHT; ++i) most = fmax(most, (double)plain[n][i]);
    for (int i = 0; i < 4 * WIDTH * HEIGHT; ++i) {
        const double difference = fabs((double)pictures[n][i] - (double)plain[n][i]) / most;
        worst = difference > worst ? difference : worst;
        differing += !(difference <= 2e-5);
    }
    if (!CHECK_CASE("Engineering", "vectors against plain C, -O1 here against -O0 or -O1", "the same picture", worst,
                    3e-4, "one ring of a kernel may be drawn or not, 6e-4 of a voxel in a dozen") ||
        !CHECK(differing <= 4 * WIDTH * HEIGHT / 1000))
        printf("    scene %d: off by %g of the largest; %d numbers off by more than 2e-5\n", n, worst, differing);
    differing = 0;
    for (int i = 0; i < WIDTH * HEIGHT; ++i) { /* distances, where there is something; a polygon's edge may jump */
        const double far = (double)plain[n][4 * WIDTH * HEIGHT + i];
        if (!(plain[n][4 * i + 3] > 0.01f)) continue;
        differing += !(fabs((double)pictures[n][4 * WIDTH * HEIGHT + i] - far) <= 1e-4 * far);
    }
    if (!CHECK(differing <= WIDTH * HEIGHT / 1000)) printf("    scene %d: %d distances differ\n", n, differing);
    CHECK(most > 0.1);
}

/* This program against plain C; and if it is plain C itself, low optimisation (none in test-long, which takes time)
   against high: the same arithmetic has the same bits. */
static void test_pictures(void) {
    render_pictures();
    if (!plain_pictures(self, check_long() ? "-O0" : "-O1", plain)) return;
    for (int n = 0; n < SCENES; ++n) check_picture(n);
    if (SPSI_LANES > 1 || !plain_pictures(self, "-O3", optimised)) return;
    for (int n = 0; n < SCENES; ++n)
        if (!CHECK_CASE("Engineering", "plain C at -O0 or -O1 against -O3", "the same picture",
                        memcmp(plain[n], optimised[n], sizeof plain[n]) != 0, 0, "same bits"))
            printf("    scene %d\n", n);
}

#endif /* VECTORS_ONLY */

static void test_operations(void) {
    RUN(test_arithmetic);
    RUN(test_fused);
    RUN(test_unordered);
    RUN(test_masks);
    RUN(test_first);
    RUN(test_rounding);
    RUN(test_quads);
    RUN(test_words);
    RUN(test_fours);
    RUN(test_four_floats);
    RUN(test_lookups);
    RUN(test_exp);
    RUN(test_kernel_share);
    RUN(test_mean_transmittance);
    RUN(test_phase);
}

#ifdef VECTORS_ONLY
/* Called with the number of lanes that its build is to have. */
int main(int count, char **arguments) {
    CHECK(count == 2 && atoi(arguments[1]) == SPSI_LANES);
    test_operations();
    return check_failed ? check_report() : 0;
}
#else
int main(int count, char **arguments) {
    if (count == 2) return write_pictures(arguments[1]);
    self = arguments[0];
    printf("%d lanes\n", SPSI_LANES);
    test_operations();
    RUN(test_halves);
    RUN(test_narrower);
    RUN(test_pictures);
    return check_report();
}
#endif
