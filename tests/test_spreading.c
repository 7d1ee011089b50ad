/* Light that spreads sideways, sheet by sheet: beams against Fermi-Eyges theory and against random walks, energy, light
   that keeps to its rays against SPS_SCATTERING_FORWARD; then whole pictures: beams in fog, floors and plates in them,
   lamps within gas, what is held, and what fails. */

#include "check.h"

enum { SIDE = 24, PIXELS = SIDE * SIDE, COUNT = 4 * PIXELS };
static float image_a[COUNT], image_b[COUNT], image_c[COUNT];
static sps_context *context;
static check_triangles faces;
static const float one = 1;
static sps_lobe lobe = {0.85f, 1};

static double sum_of(const float *image) {
    double sum = 0;
    for (int i = 0; i < COUNT; ++i) sum += i % 4 < 3 ? (double)image[i] : 0;
    return sum;
}

static int same(const float *a, const float *b) { return memcmp(a, b, COUNT * sizeof *a) == 0; }

/* --- sheets alone --- */

enum { WIDE = 144, TEXELS = WIDE * WIDE };

/* Sheets of an even gas across a bundle of parallel rays, or of a cone of them. */
typedef struct trial {
    int sheets, mirrored;
    double depth, scattered; /* of all sheets: optical depth, and what of it scatters */
    double square;           /* mean squared sine of an event's angle */
    double back;             /* 1 - P[1] */
    double reach;            /* thickness of all sheets, in texels of the last plane */
    double start;  /* of the cone: distance of the first plane from its tip, in that of the last; 1: no cone */
    double uneven; /* of the gas, from texel to texel */
    int both;      /* 1: every sheet spreads along columns and rows */
    int broad;     /* 1: the light covers all texels; 0: the middle one */
} trial;

static trial trial_of(int sheets, double depth) {
    trial t;
    memset(&t, 0, sizeof t);
    t.sheets = sheets;
    t.depth = t.scattered = depth;
    t.square = 0.2, t.reach = 30, t.start = 1;
    return t;
}

/* Light behind all sheets: its flux, way and width. */
typedef struct beam {
    double flux, way, square;
    double half; /* radius that holds half of the light within `reach` texels */
} beam;

static void carry(const trial *t, float *flux) {
    static float depth[TEXELS], scattered[TEXELS], turned[TEXELS], back[TEXELS], source[TEXELS], open[TEXELS];
    static float reach[TEXELS];
    static float memory[(2 * SPSI_SPREAD_BEAMS * SPSI_SPREAD_PARTS + 6) * TEXELS + 2 * WIDE +
                        (3 * WIDE + 4 * SPSI_SPREAD_STEP) * SPSI_LANES];
    spsi_rays rays;
    spsi_spread_light light;
    spsi_spread_sheet sheet = {depth, scattered, turned, back, source, open, reach, 1, 3, 0};
    check_random random = {3};
    memset(&light, 0, sizeof light);
    for (int i = 0; i < 2; ++i) light.size[i] = light.pitch[i] = WIDE;
    light.mirrored = t->mirrored;
    CHECK(spsi_spread_light_floats(&light) * sizeof(float) == sizeof memory);
    memset(&rays, 0, sizeof rays);
    spsi_spread_light_begin(&light, &rays, memory);
    for (int n = 0; n < t->sheets; ++n) {
        const double begin = t->start + (1 - t->start) * n / t->sheets, end = begin + (1 - t->start) / t->sheets;
        sheet.growth = (float)(begin / end);
        sheet.is_last = n == t->sheets - 1;
        sheet.sides = sheet.is_last || t->both ? 3 : 1 << (n & 1);
        for (int i = 0; i < TEXELS; ++i) {
            const double share = (1 + t->uneven * (2 * check_next(&random) - 1)) / t->sheets;
            depth[i] = (float)(t->depth * share);
            scattered[i] = (float)(t->scattered * share);
            turned[i] = 1.5f * (float)t->square * scattered[i];
            back[i] = (float)t->back * scattered[i];
            source[i] = t->broad || i == TEXELS / 2 + WIDE / 2;
            open[i] = 1;
            reach[i] = (float)(t->reach / t->sheets / end);
        }
        spsi_spread_step(&light, &sheet);
    }
    for (int i = 0; i < TEXELS; ++i) {
        const float narrow = light.part[SPSI_SPREAD_NARROW][0][SPSI_SPREAD_FLUX][i];
        flux[i] = narrow + light.part[SPSI_SPREAD_WIDE][0][SPSI_SPREAD_FLUX][i];
        flux[TEXELS + i] = narrow * light.depth[i] + light.part[SPSI_SPREAD_WIDE][0][SPSI_SPREAD_WAY][i];
    }
}

/* Radius up to which squares hold half of all light, squares in texels, sorted into rings of a quarter texel. */
static beam beam_of(const trial *t) {
    static float flux[2 * TEXELS];
    static double rings[4 * WIDE];
    double inside = 0;
    beam b;
    memset(&b, 0, sizeof b);
    memset(rings, 0, sizeof rings);
    carry(t, flux);
    for (int i = 0; i < TEXELS; ++i) {
        const double x = i % WIDE - WIDE / 2, y = i / WIDE - WIDE / 2, value = (double)flux[i];
        b.flux += value;
        b.way += (double)flux[TEXELS + i];
        b.square += value * (x * x + y * y);
        for (int k = 0; k < 16; ++k) { /* texels are squares */
            const double radius = hypot(x + (k % 4 - 1.5) / 4, y + (k / 4 - 1.5) / 4);
            if (radius > t->reach) continue;
            inside += value / 16;
            rings[(int)(4 * radius)] += value / 16;
        }
    }
    for (double sum = 0; sum < 0.5 * inside; b.half += 0.25) sum += rings[(int)(4 * b.half)];
    return b;
}

/* The mean squared displacement of all light, in units of the thickness: with b = h s, the integral of B = 2 / (3 b) (1
   - exp(-b x))^2, twice, x from 0 to 1. For few events that is q s / 3. */
static double square_of(const trial *t) {
    const double b = 0.75 * t->square * t->scattered;
    return 4 / (3 * b) * (1 + 2 * expm1(-b) / b - expm1(-2 * b) / (2 * b));
}

/* A thin beam's flux, way and second moment are those of theory, for any number of sheets: all three are exact, but for
   what leaves the grid by its sides and for floats. */
static void test_beam(void) {
    for (int n = 0; n < 8; ++n) {
        trial t = trial_of(n < 7 ? 16 << n : 1, 2);
        beam b;
        if (n % 2) t.scattered = 1.5;
        b = beam_of(&t);
        CHECK_NEAR(b.flux, exp(t.scattered - 2) - exp(-2), 2e-5);
        CHECK_NEAR(b.way / b.flux, 2, 1e-4);
        CHECK_CASE("Scattering", "lateral spread of a beam, in 1 and 16 to 1024 sheets", "Fermi-Eyges theory, relative",
                   fabs(t.reach * t.reach * square_of(&t) * exp(t.scattered - 2) / b.square - 1), 0.001,
                   "floats, and the series");
        if (figures())
            printf("%d sheets: flux %.6f, rms %.4f of %.4f texels\n", t.sheets, b.flux, sqrt(b.square / b.flux),
                   sqrt(t.reach * t.reach * square_of(&t) * exp(t.scattered - 2) / (exp(t.scattered - 2) - exp(-2))));
    }
}

/* Below a texel, too. */
static void test_narrow_beam(void) {
    for (int n = 0; n < 3; ++n) {
        trial t = trial_of(64, 1);
        beam b;
        t.reach = n == 0 ? 2 : n == 1 ? 0.5 : 0.02;
        b = beam_of(&t);
        CHECK_NEAR(b.square, t.reach * t.reach * square_of(&t), 1e-4 * b.square + 1e-9);
    }
}

/* In a cone of rays, where texels grow with the distance: light displaced there is the same as without a cone. */
static void test_cone(void) {
    for (int n = 0; n < 3; ++n) {
        trial t = trial_of(128, 1);
        beam b;
        t.start = n == 0 ? 0.5 : n == 1 ? 0.1 : 0;
        t.square = 0.05;
        b = beam_of(&t);
        CHECK_NEAR(b.flux, 1 - exp(-1), 1e-5);
        CHECK_NEAR(b.square, t.reach * t.reach * square_of(&t),
                   0.02 * b.square); /* forgetting, midway through sheets: b / 128 */
        if (figures()) printf("cone from %g: %.4f of %.4f\n", t.start, b.square, t.reach * t.reach * square_of(&t));
    }
}

/* The same against random walks: the radius that holds half of the light within 45 degrees of the beam. */
static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* Radii at which light that has scattered passes the end of the gas, less than `depth`, sorted; their number. */
static int walk(double g, double depth, int count, double *radius) {
    check_random random = {11};
    int found = 0;
    for (int i = 0; i < count; ++i) {
        double p[3] = {0, 0, 0}, d[3] = {0, 0, 1};
        for (int turns = 0; p[2] >= 0; ++turns) {
            const double way = -log(1 - check_next(&random)), u = check_next(&random), turn = 2 * PI * u;
            const double s = (1 - g * g) / (1 - g + 2 * g * check_next(&random)), c = (1 + g * g - s * s) / (2 * g);
            double across[2][3];
            if (p[2] + way * d[2] >= depth) {
                vec_along(p, d, (depth - p[2]) / d[2], p);
                if (turns > 0 && hypot(p[0], p[1]) < depth) radius[found++] = hypot(p[0], p[1]);
                break;
            }
            vec_along(p, d, way, p);
            vec_basis(d, across[0], across[1]);
            for (int k = 0; k < 3; ++k)
                d[k] = c * d[k] + sqrt(fmax(1 - c * c, 0)) * (cos(turn) * across[0][k] + sin(turn) * across[1][k]);
            vec_normalise(d);
        }
    }
    qsort(radius, (size_t)found, sizeof *radius, by_size);
    return found;
}

/* One Gaussian's is 1.8 times that of walks where light is thrown far forward, since most events turn little. */
static void test_walks(void) {
    static const double g[] = {0.95, 0.9, 0.85, 0.75, 0.5}, depth[] = {0.5, 1, 2, 4};
    static double radius[20000];
    for (int i = 0; i < 20; ++i) {
        const int count = walk(g[i / 4], depth[i % 4], 20000, radius);
        const double w = radius[count / 2];
        double half;
        trial t = trial_of(64, depth[i % 4]);
        t.square = 2 * (1 - g[i / 4] * g[i / 4]) / 3;
        t.back = 1 - g[i / 4];
        t.reach = 48;
        half = beam_of(&t).half / 48 * depth[i % 4];
        if (figures())
            printf("g %g, depth %g: half within %.4f, random walks %.4f: %+.1f %%\n", g[i / 4], depth[i % 4], half, w,
                   100 * (half / w - 1));
        CHECK_CASE("Scattering", "half of a beam's halo, asymmetry 0.5 to 0.95, depth 0.5 to 4",
                   "random walks' radius, relative", fabs(half / w - 1), 0.2,
                   "two Gaussians for the tail of Henyey and Greenstein's lobe; texels of 1/48");
    }
}

/* Nothing is lost or made in gas that absorbs nothing, however uneven, however wide kernels are: neither in a beam nor
   between sides that send back what leaves. The flux of `broad` light is what even gas would have, in each texel. */
static void test_energy(void) {
    static float flux[2 * TEXELS];
    for (int n = 0; n < 6; ++n) {
        trial t = trial_of(n == 3 ? 1 : 24, n == 4 ? 12 : 1.5);
        double sum = 0, least = HUGE_VAL;
        t.reach = n == 1 ? 600 : n == 2 ? 1e6 : 30;
        t.uneven = n == 5 ? 0 : 0.9;
        t.mirrored = t.broad = 1;
        carry(&t, flux);
        for (int i = 0; i < TEXELS; ++i) {
            sum += (double)flux[i];
            least = fmin(least, (double)flux[i]);
            if (n == 5) CHECK_NEAR((double)flux[i], 1 - exp(-1.5), 1e-5);
        }
        CHECK(least >= 0);
        if (n != 5) { /* what has come straight is still there: it depends on each texel's gas */
            trial none = t;
            double straight = 0;
            check_random random = {3};
            static double all[TEXELS];
            memset(all, 0, sizeof all);
            for (int k = 0; k < none.sheets; ++k)
                for (int i = 0; i < TEXELS; ++i)
                    all[i] += none.depth * (1 + t.uneven * (2 * check_next(&random) - 1)) / t.sheets;
            for (int i = 0; i < TEXELS; ++i) straight += exp(-all[i]);
            CHECK_CASE("Scattering", "energy of a beam between sides that send back, in uneven gas of albedo 1",
                       "scattered and straight add up to 1", fabs((sum + straight) / TEXELS - 1), 1e-5, "floats");
        }
    }
}

/* Where no face adjoins, light leaves by all four sides alike, and nothing comes in. */
static void test_sides(void) {
    static float flux[2 * TEXELS];
    const int middle = WIDE / 2, last = WIDE - 1;
    trial t = trial_of(24, 1.5);
    double edges[4], inner;
    t.both = t.broad = 1;
    t.reach = 10;
    carry(&t, flux);
    inner = (double)flux[middle * WIDE + middle];
    edges[0] = (double)flux[middle * WIDE], edges[1] = (double)flux[middle * WIDE + last];
    edges[2] = (double)flux[middle], edges[3] = (double)flux[last * WIDE + middle];
    CHECK_NEAR(inner, 1 - exp(-1.5), 1e-5);
    for (int i = 0; i < 4; ++i) {
        if (figures()) printf("side %d: %.4f of %.4f\n", i, edges[i], inner);
        CHECK(edges[i] < 0.5 * inner && edges[i] > 0.25 * inner);
        CHECK_NEAR(edges[i], edges[0], 1e-5);
    }
}

/* --- pictures --- */

/* A box of even gas, seen from the side, that a thin beam crosses from left to right. */
static void start(check_scene *s, double extinction) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 0, 0, 5);
    check_orthographic(&s->view.camera, 2);
    check_add_volume(s, 32, 32, 32, check_box(-1, -1, -1, 1, 1, 1));
    s->volume[0].read_fn = check_read_constant;
    s->volume[0].user = (void *)(size_t)&one;
    s->volume[0].extinction = (float)extinction;
    s->volume[0].lobes = &lobe, s->volume[0].lobe_count = 1;
    s->volume[0].revision = 1;
    check_color(s->volume[0].albedo, 1, 1, 1);
    s->view.scattering = SPS_SCATTERING_CONVOLUTION;
    s->view.scattering_resolution = 24;
    faces.count = 0;
}

static sps_light *add_spot(check_scene *s) {
    sps_light *spot = check_add_point(s, -4, 0, 0, 300);
    check_set3(spot->direction, 1, 0, 0);
    spot->inner_cone = 0.04, spot->outer_cone = 0.06;
    return spot;
}

static const spsi_spread *spread_of(const sps_context *by, int light) {
    return (const spsi_spread *)by->buffers[SPSI_BUFFER_CELL_GRID].data + light;
}

/* Flux of a light through a surface at a point, without its color and falloff. */
static double flux_at(const sps_context *by, int light, double x, double y, double z, double *depth) {
    const spsi_spread *spread = spread_of(by, light);
    const double point[3] = {x, y, z};
    const int sheets = spread->sheet_count;
    float lanes[2][SPSI_LANES];
    spsi_spread near = *spread;
    spsi_v at[3], passed;
    spsi_spread_place place;
    near.sheet_count = 1 << 30; /* no nearer than the point */
    spsi_spread_coordinates(&near, point, at);
    near.sheet_count = sheets;
    spsi_spread_find(&near, at, &place);
    spsi_spread_flux(&near, 0, &place, &passed);
    spsi_store(lanes[0], spsi_spread_lookup(&near, near.onward, &place));
    spsi_store(lanes[1], passed);
    if (depth) *depth = (double)lanes[1][0];
    return (double)lanes[0][0];
}

/* What goes on behind an optical depth of t of which s scatters, of asymmetry g: two streams lose 3/4 (1 - g) s / (1 +
   3/4 (1 - g) s) of what is not absorbed. */
static double onward(double t, double s, double g) { return exp(s - t) / (1 + 0.75 * (1 - g) * s) - exp(-t); }

/* What a sun sends through even gas: in the middle, where the sides are far, it is what theory says without sides. */
static void test_sun(void) {
    static const double albedo[] = {1, 0.6};
    for (int n = 0; n < 2; ++n)
        for (int k = 0; k < 3; ++k) {
            const double x = -0.6 + 0.6 * k, t = 2 * (x + 1), a = albedo[n];
            double depth;
            check_scene s;
            lobe.asymmetry = 0.97f;
            start(&s, 2);
            check_color(s.volume[0].albedo, a, a, a);
            check_add_directional(&s, 1, 0, 0, 3);
            check_render(context, &s, image_a);
            CHECK_CASE("Scattering", "a sun through gas of asymmetry 0.97",
                       "two streams: what is neither absorbed nor turned back",
                       fabs(flux_at(context, 0, x, 0.03, 0.02, &depth) - onward(t, a * t, 0.97)), 0.01,
                       "theory has no sides, which are far; texels");
            CHECK_NEAR(depth, t, 0.05); /* the box fades out within a voxel: 2 / 32 times an extinction of 2, halved */
            lobe.asymmetry = 0.85f;
        }
}

/* Where light keeps to its rays, pictures are those of FORWARD; where nothing scatters again, those of SINGLE. */
static void test_agreement(void) {
    for (int n = 0; n < 6; ++n) {
        check_scene s;
        double rest, most;
        start(&s, n < 2 ? 2 : 0.02);
        lobe.asymmetry = n < 2 ? 0.99f : 0.85f;
        if (n == 1) check_color(s.volume[0].albedo, 0.9, 0.6, 0.2);
        if (n > 2) check_color(s.volume[0].albedo, 0, 0, 0), s.volume[0].extinction = 2;
        if (n > 2) check_color(s.volume[0].emission, 0.3, 0.2, 0.1);
        if (n % 2)
            check_add_point(&s, 3, 4, 1, 30);
        else
            check_add_directional(&s, 1, -1, -0.7, 3);
        check_render(context, &s, image_a);
        s.view.scattering = n < 2 ? SPS_SCATTERING_FORWARD : SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        most = 0;
        for (int i = 0; i < COUNT; ++i) most = fmax(most, i % 4 < 3 ? (double)image_b[i] : 0);
        rest = check_largest(image_a, image_b, COUNT) / most;
        if (figures()) printf("agreement %d: %.4f\n", n, rest);
        if (n < 2) /* 0.06 (1 + c)^2 (1 - g) t is .01; sides: sqrt(q s / 3) is .07 wide; of light that goes on, a root
                      of 1 + 3/4 (1 - g) t, .015, does not return */
            CHECK_CASE("Scattering", "asymmetry 0.99, the largest", "as light that keeps to its rays, of the brightest",
                       rest, 0.065, "lost aside, 1 %, and back, 1.5 %; sides, which are 0.07 wide");
        if (n == 2) CHECK(rest < 0.1); /* optical depth of both ways: .04, and up to .06 */
        if (n > 2)
            CHECK_CASE("Scattering", "albedo 0, sideways", "that of scattering off", !same(image_a, image_b), 0,
                       "same bits");
        lobe.asymmetry = 0.85f;
    }
}

/* What turns aside is followed to where it goes, so that tables of what is scattered forward must not leave it out, as
   they do where it is lost: they hold more. */
static void test_nothing_lost_aside(void) {
    double sum[2] = {0, 0};
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        const spsi_forward *table;
        start(&s, 1);
        check_add_directional(&s, 1, -1, -0.7, 3);
        if (n == 1) s.view.scattering = SPS_SCATTERING_FORWARD;
        if (!check_render(context, &s, image_a)) return;
        table = (const spsi_forward *)context->buffers[SPSI_BUFFER_FORWARD].data;
        for (int i = 0; i < SPSI_FORWARD_SIZE * SPSI_FORWARD_SIZE; ++i) sum[n] += (double)table->level[0][i];
    }
    if (!CHECK(sum[0] > sum[1])) printf("    %g, where light is lost aside %g\n", sum[0], sum[1]);
}

/* A thin beam against random paths. Only light that has scattered is beside it. The dense one's paths are the noisiest.
 */
static void test_beam_paths(void) {
    for (int n = 0; n < (check_long() ? 2 : 1); ++n) {
        check_scene s;
        start(&s, n == 0 ? 0.7 : 1.5);
        add_spot(&s);
        check_paths(context, &s, n == 0 ? "beam" : "dense beam", 500, 0.25);
    }
}

/* A floor below gas receives what is left of light, straight and scattered; a plate keeps both off; a colored pane
   filters both. */
static void test_polygons(void) {
    static float bare[COUNT];
    for (int n = 0; n < 4; ++n) {
        const double floor[2][3] = {{8, 0, 0}, {0, 0, 8}}, origin[3] = {-4, -1.5, -4};
        const double plate[3] = {-3, n == 2 ? 1.5 : 0, -3}, side[2][3] = {{6, 0, 0}, {0, 0, 6}};
        check_triangles above;
        check_scene s;
        memset(&above, 0, sizeof above);
        start(&s, 1);
        lobe.asymmetry = 0.97f;
        check_add_quad(&faces, origin, floor[0], floor[1]);
        check_add_mesh(&s, &faces, 0.5);
        if (n >= 2) check_add_quad(&above, plate, side[0], side[1]), check_add_mesh(&s, &above, 0.5);
        if (n == 3) check_translucent(&s.mesh[1], 0), check_color(s.mesh[1].transmittance, 1, 0.5, 0.25);
        check_add_directional(&s, 0, -1, 0, 3);
        check_set3(s.view.camera.position, 0, -1.2, 4);
        check_set3(s.view.camera.target, 0, -1.5, 0);
        check_orthographic(&s.view.camera, 0.2);
        if (n == 0) s.volume[0].extinction = 0;
        check_render(context, &s, n == 0 ? bare : image_a);
        for (int c = 0; c < 3 && n > 0; ++c) {
            const int middle = 4 * (SIDE * SIDE / 2 + SIDE / 2) + c;
            const double share = (double)image_a[middle] / (double)bare[middle];
            const double straight = exp(-2), pane = (n == 3   ? 1.0 / (1 << c)
                                                     : n == 2 ? 0
                                                              : 1) *
                                                    (straight + onward(2, 2, 0.97));
            if (figures()) printf("floor %d: %.4f of %.4f\n", n, share, pane);
            CHECK_NEAR(share, pane, 0.03); /* what leaves by the sides, and panes are colored in steps */
        }
        check_free_triangles(&above);
        lobe.asymmetry = 0.85f;
    }
    check_free_triangles(&faces);
}

/* Displacement, squared, of light that has passed `before` and then `depth` of events, each of which turns it by h as
   above, in the last of these only, in units of their thickness: the integral of 2 B, B' = A - h B, A = 2/3 (1 - exp(-2
   h (before + x))), x from 0 to `depth`, over depth^2. */
static double square_behind(double h, double before, double depth) {
    const double once = -expm1(-h * depth) / h, twice = -expm1(-2 * h * depth) / (2 * h);
    return 4 / (3 * h) * (depth - once - exp(-2 * h * before) * (once - twice)) / (depth * depth);
}

static double normal_below(double x) { return 0.5 * erfc(-x / sqrt(2.0)); }

/* Flux 0.8 behind the edge of a plate that covers y < 0, in gas of an extinction of 2 that begins 0.5 before it and
   ends at 1 on three sides: light of 0 < y < 1 spread by a Gaussian, [Eyges 1948], or by two, as >>spreading has them,
   since a lobe is not one: light whose every event was within peaks, three quarters of them, of a mean squared sine of
   2 (1 - g)^2, and the rest. Together they have the variance of all. Light that turns back and forth has a longer way,
   by 0.3 of 3/4 (1 - g) of the depth, here midway, and variance is as lengths squared and events. */
static double behind_edge(double y, double g) {
    const double before = 1, depth = 1.6, end = before + depth, all = 1 - exp(-end), peak = 0.75;
    const double angle[2] = {0.5 * (1 - g * g), 1.5 * (1 - g) * (1 - g)};
    const double narrow = exp((peak - 1) * end) - exp(-end), part[2] = {all - narrow, narrow};
    const double longer = 1 + 0.3 * 0.75 * (1 - g) * (before + 0.5 * depth);
    double square[2], sum = 0;
    square[1] = 0.64 * exp((peak - 1) * end) * square_behind(angle[1], peak * before, peak * depth);
    square[0] = 0.64 * pow(longer, 3) * square_behind(angle[0], before, depth) - square[1];
    for (int i = 0; i < 2; ++i) {
        const double width = sqrt(0.5 * square[i] / part[i]); /* along one of two axes */
        const double high = normal_below(y / width) - normal_below((y - 1) / width);
        sum += part[i] / all * high * (2 * normal_below(1 / width) - 1);
    }
    return sum * onward(end, end, g);
}

/* A plate across half of the light: behind its middle there is hardly any light, beside its edge light spreads. Kernels
   are added up from sheet to sheet, where events are more and fewer, so that their tail is longer than two Gaussians'.
   What that adds in the shade is at most a hundredth. Beside the plate it is missing, and so is light that leaves the
   gas by three sides before it is as far: a twentieth. */
static void test_plate(void) {
    const double origin[3] = {-0.5, -3, -3}, side[2][3] = {{0, 3, 0}, {0, 0, 6}};
    check_scene s;
    start(&s, 2);
    check_add_quad(&faces, origin, side[0], side[1]);
    check_add_mesh(&s, &faces, 0.5);
    check_add_directional(&s, 1, 0, 0, 3);
    check_render(context, &s, image_a);
    for (int k = 0; k < 5; ++k) {
        const double y = -0.8 + 0.4 * k, found = flux_at(context, 0, 0.3, y, 0, NULL), theory = behind_edge(y, 0.85);
        if (figures()) printf("plate %g: %g of %g\n", y, found, theory);
        CHECK_NEAR(found, theory, k < 2 ? 0.01 : 0.05);
    }
    CHECK(flux_at(context, 0, 0.3, -0.8, 0, NULL) < 0.02);
    CHECK(flux_at(context, 0, 0.3, -0.15, 0, NULL) > 0.05);
    CHECK(flux_at(context, 0, 0.3, 0.15, 0, NULL) > 2 * flux_at(context, 0, 0.3, -0.15, 0, NULL));
    CHECK(flux_at(context, 0, -0.7, -0.8, 0, NULL) > 0.3);
    { /* the plate receives what there is before it, which ends within a sheet */
        const double point[3] = {-0.5, -0.8, 0};
        float lanes[SPSI_LANES];
        spsi_v at[3];
        spsi_spread_place place;
        spsi_spread_coordinates(spread_of(context, 0), point, at);
        spsi_spread_find(spread_of(context, 0), at, &place);
        spsi_store(lanes, spsi_spread_lookup(spread_of(context, 0), spread_of(context, 0)->onward, &place));
        CHECK_NEAR((double)lanes[0], flux_at(context, 0, -0.56, -0.8, 0, NULL), 0.03);
    }
    check_free_triangles(&faces);
}

/* A lamp within even gas: the same on all sides, across the seams of its six faces, too. */
static void test_lamp_within(void) {
    const double exact = onward(1.2, 1.2, 0.85);
    double least = HUGE_VAL, most = 0, mean = 0;
    check_random random = {9};
    check_scene s;
    start(&s, 2);
    s.view.scattering_resolution = 48; /* texels across a face */
    check_add_point(&s, 0, 0, 0, 1);
    check_render(context, &s, image_a);
    CHECK(spread_of(context, 0)->map.face_count == SPSI_CUBE_FACES);
    for (int i = 0; i < 400; ++i) {
        double d[3] = {check_next(&random) - 0.5, check_next(&random) - 0.5, check_next(&random) - 0.5}, flux;
        if (i < 20) d[i % 3] = d[(i + 1) % 3]; /* on an edge */
        vec_normalise(d);
        flux = flux_at(context, 0, 0.6 * d[0], 0.6 * d[1], 0.6 * d[2], NULL);
        least = fmin(least, flux);
        most = fmax(most, flux);
        mean += i >= 20 ? flux / 380 : 0;
    }
    if (figures()) printf("lamp within: %.4f to %.4f of %.4f, %.4f on average\n", least, most, exact, mean);
    CHECK_CASE("Scattering", "lamp within even gas, across the seams of six faces", "theory, on all sides",
               fmax(fabs(least - exact), fabs(most - exact)), 0.05, "texels, 5 %; cells of 0.05 by 2 exp(-1.2)");
    /* Light is not lost between texels: errors have both signs, and a tenth of them is left on average. Lines between
       sheets of a depth of 0.1 are off by a square of it, by an 8th of a curvature of 0.6. */
    CHECK_NEAR(mean, exact, 0.005 + 0.001);
}

/* Thin gas scatters light once, as sps_reference has it, and again what of that meets gas: an albedo of 1 times an
   optical depth of 0.03 on at most 1.7 units. To the side, light that scatters twice, whose lobe has the square of the
   asymmetry, is 2.1 times as strong as light that scatters once. Pixels are off by 1 %. */
static void check_thin(check_scene *s) {
    enum { FROM = 4 * SIDE * 8, END = 4 * SIDE * 16 };
    double sum[2] = {0, 0};
    s->volume[0].extinction = 0.03f;
    check_render(context, s, image_a);
    s->view.scattering = SPS_SCATTERING_SINGLE;
    s->view.region[1] = FROM / (4 * SIDE), s->view.region[2] = SIDE, s->view.region[3] = (END - FROM) / (4 * SIDE);
    check_march(context, s, 0.75, image_b, NULL);
    for (int i = FROM; i < END; ++i)
        if (i % 4 < 3) sum[0] += (double)image_a[i], sum[1] += (double)image_b[i - FROM];
    if (figures()) printf("thin: %.4f of light that scatters once\n", sum[0] / sum[1]);
    CHECK(sum[0] > 0.99 * sum[1] && sum[0] < (1.01 + 2.1 * 0.03 * 1.7) * sum[1]);
}

/* A sum of lights is the sum of their pictures; tables and sheets, both orders of compositing, and parts of an image
   show the same light. */
static void test_sources(void) {
    for (int n = 0; n < 4; ++n) {
        double most = 0;
        check_scene s;
        start(&s, 2);
        s.volume[0].read_fn = NULL;
        check_add_puff(&s, 3);
        s.volume[0] = s.volume[1];
        s.scene.volume_count = 1;
        s.volume[0].lobes = &lobe, s.volume[0].lobe_count = 1;
        check_color(s.volume[0].albedo, 1, 0.9, 0.8);
        check_add_directional(&s, n % 2 ? -0.5 : 0.6, -1, n < 2 ? -0.5 : 0.8, 3);
        if (n > 0) check_add_point(&s, 2, 1, -1, 20);
        for (int i = 0; i < s.scene.light_count; ++i) s.light[i].shadow_source = SPS_SHADOW_SHEETS;
        check_render(context, &s, image_a);
        memset(image_b, 0, sizeof image_b);
        for (int i = 0; i < s.scene.light_count; ++i) { /* one by one, by tables */
            check_scene single = s;
            single.scene.volumes = single.volume;
            single.light[0] = s.light[i];
            single.light[0].shadow_source = SPS_SHADOW_TABLE;
            single.scene.lights = single.light;
            single.scene.light_count = 1;
            check_render(context, &single, image_c);
            for (int k = 0; k < COUNT; ++k) image_b[k] = k % 4 < 3 ? image_b[k] + image_c[k] : image_c[k];
        }
        for (int i = 0; i < COUNT; ++i) most = fmax(most, (double)image_b[i]);
        if (figures()) printf("sources %d: %.5f\n", n, check_largest(image_a, image_b, COUNT) / most);
        CHECK(check_largest(image_a, image_b, COUNT) < 0.01 * most); /* those of sheets and tables */
        if (n == 3 && !check_memory_only()) check_thin(&s);
    }
}

/* A box of `size` voxels along each axis, whose transfer function is not linear, under a sun, in 12 texels. */
static void start_classified(check_scene *s, int size) {
    static const sps_transfer_point points[] = {{0.4f, {1, 1, 1}, 0, {0, 0, 0}}, {0.6f, {1, 1, 1}, 4, {0, 0, 0}}};
    static sps_transfer transfer;
    transfer.points = points, transfer.point_count = 2;
    start(s, 1);
    s->volume[0].transfer = &transfer;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = size;
    check_add_directional(s, 1, 0, 0, 3);
    s->view.scattering_resolution = 12;
    s->view.slab_thickness = 0.7;
}

/* A layer of voxels smaller than texels passes the same light. */
static void test_classified(void) {
    double depth;
    check_scene s;
    lobe.asymmetry = 0.97f;
    start_classified(&s, 96);
    check_render(context, &s, image_a);
    lobe.asymmetry = 0.85f;
    CHECK_NEAR(flux_at(context, 0, 0, 0, 0, &depth), onward(4, 4, 0.97), 0.02);
    CHECK_NEAR(depth, 4, 0.15);
}

/* Classified voxels are sampled at least once each, as long as that is no more than four samples along a texel. */
static void test_samples(void) {
    for (int size = 20; size < 80; size += 6) {
        const spsi_frame *frame;
        const spsi_spread *spread;
        double texel;
        check_scene s;
        int fine;
        start_classified(&s, size);
        if (!check_render(context, &s, image_a)) return;
        frame = (const spsi_frame *)context->buffers[SPSI_BUFFER_FRAME].data, spread = spread_of(context, 0);
        texel = spsi_pixel_size_at(&spread->map.rays[0], 0); /* the same everywhere, of a sun */
        fine = spsi_spread_fineness(frame, spread);
        CHECK(texel / fine <= 2.0 / size || fine == 4);
        CHECK(texel / fine > 1.0 / size || fine == 1); /* and not more than twice */
    }
}

/* A wall behind a slab of 6 x 6 x 2 and albedo 1 that a sun crosses: irradiance by light that has scattered. Exact are
   3e6 random paths each, a wall 0.3 behind it, within 0.5 %. Two streams know neither sides nor directions: of light in
   all directions a slab without sides lets a quarter more pass, and sides as near take as much. */
static void test_behind_slab(void) {
    static const double g[] = {0.9, 0.75, 0}, depth[] = {1, 3, 6};
    static const double exact[3][3] = {{0.5856, 0.8103, 0.7222}, {0.5051, 0.6182, 0.4828}, {0.2188, 0.2708, 0.1933}};
    const double origin[3] = {-9, -9, 2.3}, side[2][3] = {{18, 0, 0}, {0, 18, 0}};
    for (int n = 0; n < 9; ++n) {
        double sum = 0, off;
        check_scene s;
        start(&s, depth[n % 3] / 2);
        for (int k = 0; k < 3; ++k) s.volume[0].size[k] = k < 2 ? 48 : 16;
        s.volume[0].placement = check_box(-3, -3, 0, 3, 3, 2);
        lobe.asymmetry = (float)g[n / 3];
        check_add_quad(&faces, origin, side[0], side[1]);
        check_add_mesh(&s, &faces, 1);
        check_add_directional(&s, 0, 0, 1, 1);
        check_set3(s.view.camera.position, 0, 0, 2.2), check_set3(s.view.camera.target, 0, 0, 3);
        check_orthographic(&s.view.camera, 0.6);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; i += 4) sum += (double)image_a[i] * PI / PIXELS;
        off = (sum - exp(-depth[n % 3])) / exact[n / 3][n % 3] - 1;
        if (figures()) printf("behind g %g, depth %g: %+.1f %%\n", g[n / 3], depth[n % 3], 100 * off);
        CHECK_CASE("Scattering", "a wall behind a slab of depth 1 to 6, sideways", "random paths, relative", fabs(off),
                   n < 6 ? 0.2 : 0.4, "two streams know neither sides nor directions; 40 % where g is 0");
        lobe.asymmetry = 0.85f;
    }
    check_free_triangles(&faces);
}

/* A cone's light on texels is its flux, 2 pi (w + r / 3) with the inner angle's 1 - cos, w, and the rim's, r, however
   few texels it meets; parts of a tenth of the cone lose or make the square of that. */
static void test_narrow_cones(void) {
    static const double outer[] = {0.06, 0.01, 1e-3, 1e-5, 1e-7};
    for (int n = 0; n < 10; ++n) {
        const spsi_rays *rays;
        double sum = 0, exact, normal[3];
        check_scene s;
        sps_light *spot;
        start(&s, 1);
        s.view.scattering_resolution = n < 5 ? 12 : 48;
        spot = add_spot(&s);
        spot->position[1] = 0.013, spot->position[2] = -0.017;
        spot->outer_cone = outer[n % 5], spot->inner_cone = 0.7 * outer[n % 5];
        check_render(context, &s, image_a);
        rays = &spread_of(context, 0)->map.rays[0];
        for (int i = 0; i < rays->width * rays->height; ++i) {
            const double x = i % rays->width, y = i / rays->width;
            double ray[3];
            spsi_ray_direction(rays, x, y, ray);
            sum += spsi_spread_cone(spread_of(context, 0)->light, rays, x, y, 1) / pow(vec_length(ray), 3);
        }
        vec_cross(rays->a, rays->b, normal);
        sum *= fabs(vec_dot(normal, rays->c));
        exact = 4 * PI * pow(sin(0.35 * outer[n % 5]), 2);
        exact += 4 * PI / 3 * (pow(sin(0.5 * outer[n % 5]), 2) - pow(sin(0.35 * outer[n % 5]), 2));
        if (figures()) printf("cone %g: %.5f of its flux\n", outer[n % 5], sum / exact);
        CHECK_CASE("Scattering", "a spotlight's cone of 1e-7 to 0.06 on texels", "its flux, relative",
                   fabs(sum / exact - 1), 0.02, "parts of a tenth of the cone, squared; texels' size by their middle");
    }
}

/* --- the rest --- */

/* All kinds of gas at once, small. */
static void start_mixed(check_scene *s) {
    static sps_particles *swarm;
    start(s, 1);
    s->view.quality = SPS_QUALITY_DRAFT;
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = 8;
    check_color(s->volume[0].albedo, 0.9, 0.8, 0.7);
    swarm = check_add_swarm(s, 0.3);
    check_color(swarm->albedo, 0.8, 0.9, 1);
    check_add_directional(s, 1, -1, -0.5, 2);
    add_spot(s);
    s->view.scattering_resolution = 8;
}

static void test_workers(void) {
    check_scene s;
    start_mixed(&s);
    check_workers(&s, image_a, image_b);
}

/* Held from call to call while nothing changes but the camera. */
static void test_held(void) {
    for (int n = 0; n < 7; ++n) {
        sps_context *by = check_context(NULL), *fresh = check_context(NULL);
        const sps_stats_report *stats = &by->stats;
        check_scene s;
        start_mixed(&s);
        s.scene.particle_set_count = 0;
        check_render(by, &s, image_a);
        CHECK(stats->cells > 0);
        if (n == 0) s.view.camera.position[0] = 1;
        if (n == 1) s.view.width = 12;
        if (n == 2) s.light[1].color[1] = 3;
        if (n == 3) s.volume[0].revision = 2, s.volume[0].extinction = 2;
        if (n == 4) s.view.scattering_resolution = 9;
        if (n == 5) lobe.asymmetry = 0.5f;
        if (n == 6) s.view.scattering = SPS_SCATTERING_MULTIPLE;
        memset(image_a, 0, sizeof image_a), memset(image_b, 0, sizeof image_b);
        check_render(by, &s, image_a);
        CHECK((stats->cells == 0) == (n < 2));
        check_render(fresh, &s, image_b);
        CHECK(same(image_a, image_b));
        s.view.scattering = SPS_SCATTERING_CONVOLUTION;
        check_render(by, &s, image_a);
        check_render(fresh, &s, image_b);
        CHECK(same(image_a, image_b));
        lobe.asymmetry = 0.85f;
        sps_destroy(by), sps_destroy(fresh);
    }
}

static void test_failures(void) {
    check_scene s;
    start_mixed(&s);
    CHECK(check_failing(&s, 0, 0, image_a, image_b) > 8);
    CHECK(check_failing(&s, 1, 0, image_a, image_b) > 8);
}

/* Scenes with nothing to spread, and numbers at the ends of their ranges: nothing but finite pixels that are not
   negative. */
static void test_finite(void) {
    for (int n = 0; n < 9; ++n) {
        check_scene s;
        start_mixed(&s);
        if (n == 0) s.scene.light_count = 0;
        if (n == 1) s.scene.volume_count = s.scene.particle_set_count = 0;
        if (n == 2) s.view.no_shadows = 1;
        if (n == 3) s.volume[0].extinction = 1e6f;
        if (n == 4) s.view.scattering_resolution = 1;
        if (n == 5) s.light[1].outer_cone = s.light[1].inner_cone = 0, s.light[1].position[0] = -1;
        if (n == 6) s.light[0].angular_diameter = 0.5;
        if (n == 7) lobe.asymmetry = -0.9f;
        if (n == 8) check_color(s.light[0].color, 1e18, 0, 1e-30);
        check_render(context, &s, image_a);
        for (int i = 0; i < COUNT; ++i) CHECK(image_a[i] >= 0 && image_a[i] < 1e38f);
        lobe.asymmetry = 0.85f;
    }
}

/* A million times as large or as small: the same picture, but for round-off. */
static void test_scaled(void) {
    for (int n = 0; n < 2; ++n) {
        const double scale = n == 0 ? 1e6 : 1e-6;
        check_scene s;
        start(&s, 1.5);
        add_spot(&s);
        check_render(context, &s, image_a);
        s.volume[0].placement = check_box(-scale, -scale, -scale, scale, scale, scale);
        s.volume[0].extinction = (float)(1.5 / scale);
        s.light[0].position[0] *= scale;
        for (int c = 0; c < 3; ++c) s.light[0].color[c] *= (float)(scale * scale);
        s.view.camera.position[2] *= scale;
        s.view.camera.ortho_height *= scale;
        check_render(context, &s, image_b);
        CHECK(check_largest(image_a, image_b, COUNT) < 1e-3 * sum_of(image_a) / PIXELS);
    }
}

/* Gas that has an albedo of each color, before a wall, is in each as gas that has this albedo in all. Floats: 1e-5 of
   the brightest. */
static void test_each_color(void) {
    static const float albedo[3] = {0.95f, 0.6f, 0.2f};
    const double corner[3] = {1.2, -2, -2}, along[3] = {0, 4, 0}, across[3] = {0.5, 0, 4};
    static float all[COUNT];
    for (int n = 0; n < 4; ++n) {
        double worst = 0, most = 0;
        check_scene s;
        lobe.asymmetry = 0.9f;
        start(&s, 2);
        check_add_quad(&faces, corner, along, across);
        check_add_mesh(&s, &faces, 0.8);
        check_orthographic(&s.view.camera, 4);
        check_set3(s.view.camera.position, -3, 0.5, 4);
        check_add_directional(&s, 1, -0.2, 0.1, 3);
        for (int c = 0; c < 3; ++c) s.volume[0].albedo[c] = albedo[n > 0 ? n - 1 : c];
        if (!check_render(context, &s, n > 0 ? image_a : all)) return;
        for (int i = 0; i < COUNT && n > 0; ++i) {
            if (i % 4 != n - 1) continue;
            worst = fmax(worst, fabs((double)image_a[i] - (double)all[i]));
            most = fmax(most, (double)all[i]);
        }
        CHECK(n == 0 || (most > 0.1 && worst < 1e-5 * most));
    }
    lobe.asymmetry = 0.85f;
}

/* Light of each light is held by itself: that of one to three equal ones, in bytes, grows evenly. Besides, chunks of
   sheets of 16 x 16 texels and more are worked on: of what gas takes, and of five values in a channel. */
static void test_bytes_of_each(void) {
    size_t bytes[3];
    for (int n = 0; n < 3; ++n) {
        sps_plan_report report;
        check_scene s;
        start_mixed(&s);
        s.scene.light_count = n + 1;
        for (int i = 1; i <= n; ++i) s.light[i] = s.light[0];
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
        bytes[n] = report.pass[SPS_PASS_SPREADING].bytes;
    }
    CHECK(bytes[1] > bytes[0] && bytes[2] - bytes[1] == bytes[1] - bytes[0]);
    CHECK(bytes[0] >= bytes[1] - bytes[0] + 7 * SPSI_CHUNK * 16 * 16 * sizeof(float));
}

static void test_plan(void) {
    for (int n = 0; n < 4; ++n) {
        sps_context *by = check_context(NULL);
        sps_plan_report report;
        sps_stats_report stats;
        check_scene s;
        start_mixed(&s);
        if (n == 1) s.view.no_shadows = 1;
        if (n == 2) s.view.scattering = SPS_SCATTERING_FORWARD;
        if (n == 3) s.light[1].position[0] = 0.5;
        CHECK_OK(by, sps_plan(by, &s.scene, &s.view, &report));
        CHECK(report.pass[SPS_PASS_SPREADING].runs == (n == 1 || n == 2 ? 0 : 2));
        CHECK(strcmp(sps_pass_name(SPS_PASS_SPREADING), "spreading") == 0);
        CHECK(report.pass[SPS_PASS_FORWARD].runs == (n != 1));
        check_render(by, &s, image_a);
        sps_get_stats(by, &stats);
        CHECK(stats.bytes_peak <= report.bytes);
        sps_destroy(by);
    }
}

static void test_refused(void) {
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    start_mixed(&s);
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    image.rgba = image_a;
    settings.step = 1;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "samples") != NULL);
}

int main(void) {
    context = check_context(NULL);
    RUN(test_beam);
    RUN(test_nothing_lost_aside);
    RUN(test_narrow_beam);
    RUN(test_cone);
    RUN(test_walks);
    RUN(test_energy);
    RUN(test_sides);
    RUN(test_sun);
    RUN(test_agreement);
    RUN_LONG(test_beam_paths);
    RUN(test_polygons);
    RUN(test_plate);
    RUN(test_lamp_within);
    RUN(test_sources);
    RUN(test_classified);
    RUN_LONG(test_samples);
    RUN(test_behind_slab);
    RUN(test_narrow_cones);
    RUN(test_workers);
    RUN(test_held);
    RUN(test_failures);
    RUN(test_finite);
    RUN(test_scaled);
    RUN(test_each_color);
    RUN(test_bytes_of_each);
    RUN(test_plan);
    RUN(test_refused);
    sps_destroy(context);
    return check_report();
}
