/* Light at points: sps_light_probes against closed forms, sums over directions and pictures of all six sides; what each
   array has where points, lights and polygons are odd; errors, cancelling, memory, workers. */

#include "check.h"

enum { MOST = 64, LIGHTS = 8, SIDE = 16 };
static float sky[3 * MOST], l0[3 * MOST], l1[9 * MOST], transmittance[3 * LIGHTS * MOST];
static sps_context *context;
static check_scene s;
static check_triangles faces;
static const float one = 1;

static sps_probe_arrays all_arrays(void) {
    sps_probe_arrays out;
    memset(&out, 0, sizeof out);
    out.transmittance = transmittance, out.sky = sky, out.l0 = l0, out.l1 = l1;
    return out;
}

/* So that what a call does not write shows. */
static void fill_arrays(float with) {
    for (int n = 0; n < 3 * LIGHTS * MOST; ++n) transmittance[n] = with;
    for (int n = 0; n < 9 * MOST; ++n) l1[n] = with;
    for (int n = 0; n < 3 * MOST; ++n) sky[n] = l0[n] = with;
}

static int probe(size_t count, const double *points) {
    fill_arrays(-7);
    const sps_probe_arrays out = all_arrays();
    return CHECK_OK(context, sps_light_probes(context, &s.scene, &s.view, count, points, &out));
}

static float *through(size_t point, int light) {
    return transmittance + 3 * (point * (size_t)s.scene.light_count + (size_t)light);
}

/* ------------------------------------------------------------------------------------------------------------ scenes
 */

static double radius = 0.8;

/* Gas of value 1 up to `radius`, with a rim of 1/30. */
static int eval_ball(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i)
        out[i] = (float)fmin(1, fmax(0, (radius - vec_length(positions + 3 * i)) * 30 + 0.5));
    return 0;
}

static sps_volume *add_ball(double extinction, double albedo) {
    sps_volume *ball = check_add_volume(&s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
    ball->eval_fn = eval_ball;
    ball->extinction = (float)extinction;
    check_color(ball->albedo, albedo, albedo, albedo);
    radius = 0.8;
    return ball;
}

/* A square across y, of half width `half`, with an albedo, as the only mesh. */
static sps_mesh *add_square(double y, double half, double albedo) {
    const double corner[3] = {-half, y, -half}, u[3] = {2 * half, 0, 0}, v[3] = {0, 0, 2 * half};
    faces.count = 0;
    check_add_quad(&faces, corner, u, v);
    s.mesh[0].triangle_count = faces.count;
    s.mesh[0].read_fn = check_read_triangles;
    s.mesh[0].user = &faces;
    check_color(s.mesh[0].albedo, albedo, albedo, albedo);
    s.scene.mesh_count = 1;
    return s.mesh;
}

/* ------------------------------------------------------------------------------------------------------ closed forms
 */

/* A ball of gas, seen from its centre: e^(-1.6) to a sun, a lamp outside and the sky. Voxels and cells smooth it: a
   variance of v in each coordinate, as far as the ball is round, takes v / R of a radius. Kernels have 0.65 voxels, a
   grid's samples h 1/24 to 1/12 of an edge squared, and its interpolation 1/6, of half an edge or of an edge: together
   0.0007 to 0.0028, so that up to 0.7 % more light passes, and less than 0.4 % at medium quality. A ray along an axis
   meets a rim of whole voxels, half of one off, 1/40. Draft's kernels have ripples of 0.5 %, which the lamp inside
   shows. */
static void test_ball(void) {
    static const double points[] = {0, 0, 0, 0, 0, 3, 0, 3, 0};
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_MEDIUM; ++quality) {
        check_clear(&s, 8, 8);
        s.view.quality = (sps_quality)quality;
        s.view.scattering_resolution = quality == SPS_QUALITY_DRAFT ? 24 : 48;
        add_ball(2, 0);
        check_add_directional(&s, 0.3, -1, 0.2, 1);
        check_add_point(&s, 0, 0, 2, 1);
        check_add_point(&s, 0, 0.4, 0, 1);
        if (!probe(3, points)) continue;
        if (figures())
            printf("ball: sun %.5f lamp %.5f sky %.5f\n", (double)*through(0, 0), (double)*through(0, 1),
                   (double)sky[0]);
        CHECK_NEAR((double)*through(0, 0), exp(-1.6), 0.05 * exp(-1.6));
        CHECK_NEAR((double)*through(0, 1), exp(-1.6), 0.05 * exp(-1.6));
        CHECK_NEAR((double)*through(0, 2), exp(-0.8), 0.006 * exp(-0.8));
        CHECK_NEAR((double)*through(1, 1), 1, 0);
        CHECK_NEAR((double)*through(2, 0), 1, 0);
        CHECK_NEAR((double)sky[0], exp(-1.6), (quality == SPS_QUALITY_DRAFT ? 0.008 : 0.004) * exp(-1.6));
        CHECK(sky[0] == sky[1] && sky[0] == sky[2] && l0[0] == 0 && l1[0] == 0);
    }
}

/* E2 of the slab's depth, and the mean transmittance below a square slab of finite width, by midpoints in direction. */
static double slab_sky(double depth, double high, double low, double half) {
    const int rings = 4000, turns = 64;
    double sum = 0;
    for (int i = 0; i < rings; ++i)
        for (int k = 0; k < turns; ++k) {
            const double up = (i + 0.5) / rings, aside = sqrt(1 - up * up), turn = 2 * PI * (k + 0.5) / turns;
            const double most = half / fmax(fabs(aside * cos(turn)), fabs(aside * sin(turn)));
            const double way = fmin(high / up, most) - fmin(low / up, most);
            sum += exp(-depth / (high - low) * way) / (rings * turns);
        }
    return 0.5 * (1 + sum);
}

static double second_integral(double depth) {
    double sum = 0;
    for (int i = 0; i < 10000; ++i) sum += exp(-depth / ((i + 0.5) / 10000)) / 10000;
    return sum;
}

/* Below a wide slab, (1 + E2) / 2. Its width lets in what slab_sky says, below 1/120 of the sphere; but cells of 0.8
   let gas reach almost to the point, so that the truth is between. 512 rays resolve the integrand to about two of them.
 */
static void test_slab(void) {
    static const double points[] = {0, -1.5, 0, 0, 1.5, 0};
    for (int i = 0; i < 2; ++i) {
        const double depth = i ? 2 : 0.5, wide = slab_sky(depth, 2, 1, 64), exact = 0.5 * (1 + second_integral(depth));
        check_clear(&s, 8, 8);
        s.view.quality = SPS_QUALITY_ULTRA;
        s.view.scattering_resolution = 192;
        sps_volume *slab = check_add_volume(&s, 32, 4, 32, check_box(-64, -0.5, -64, 64, 0.5, 64));
        slab->eval_fn = check_eval_constant;
        slab->user = (void *)(size_t)&one;
        slab->extinction = (float)depth;
        check_color(s.scene.ambient, 1, 2, 0);
        if (!probe(2, points)) continue;
        if (figures()) printf("slab: %.5f %.5f exact %.5f, finite %.5f\n", (double)sky[0], (double)sky[3], exact, wide);
        for (int n = 0; n < 2; ++n) {
            CHECK((double)sky[3 * n] > exact - 0.004 && (double)sky[3 * n] < wide + 0.004);
            CHECK_NEAR((double)l0[3 * n], (double)sky[3 * n], 1e-5); /* black gas under this sky */
            CHECK_NEAR((double)l0[3 * n + 1], 2 * (double)sky[3 * n], 2e-5);
            CHECK(l0[3 * n + 2] == 0);
        }
        CHECK(l1[1] < -0.1f && l1[9 + 1] > 0.1f && l1[3 + 1] < -0.2f);
    }
}

/* White gas under a white sky does not show, inside, outside and beyond, whatever its lobes. Cells are solved for the
   difference, so that only rounding of extinction and its parts is left. */
static void test_furnace(void) {
    static const double points[] = {0, 0, 0, 0.4, 0.2, 0.1, 1.1, 0, 0, 3, 1, 2};
    static const sps_lobe lobes[2] = {{0.7f, 1}, {-0.2f, 0.5f}};
    for (int i = 0; i < 6; ++i) {
        check_clear(&s, 8, 8);
        s.view.quality = SPS_QUALITY_DRAFT;
        s.view.scattering = i % 2 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        sps_volume *gas = check_add_puff(&s, 6);
        check_color(gas->albedo, 1, 1, 1);
        gas->lobes = lobes, gas->lobe_count = i / 2;
        check_color(s.scene.ambient, 1, 0.5, 0.25);
        if (!probe(4, points)) continue;
        for (int n = 0; n < 4; ++n) {
            for (int c = 0; c < 3; ++c) CHECK_NEAR((double)l0[3 * n + c], (double)s.scene.ambient[c], 2e-6);
            for (int k = 0; k < 9; ++k) CHECK_NEAR((double)l1[9 * n + k], 0, 2e-6);
        }
        CHECK(sky[0] < 0.1f && sky[9] > 0.98f);
    }
}

/* A plane that fills half of all directions, lit by a sun: L0 is half of its radiance, L1 a quarter towards it. It has
   no radiance where the sun does not shine, and two sides. At most one ray in 128, of two halves, may be on the wrong
   side. */
static void test_plane(void) {
    static const double points[] = {0, 1, 0, 0.3, 2, 0.2, 0, -1, 0};
    check_clear(&s, 8, 8);
    add_square(0, 1e4, 0.5);
    check_color(s.mesh[0].albedo, 0.5, 0.6, 0.7);
    check_add_directional(&s, 0, -2, 0, PI);
    if (!probe(3, points)) return;
    for (int n = 0; n < 2; ++n) {
        CHECK_NEAR((double)l0[3 * n], 0.25, 0.25 / 64);
        CHECK_NEAR((double)l0[3 * n + 1], 0.3, 0.3 / 64);
        CHECK_NEAR((double)l1[9 * n + 1], -0.125, 0.002);
        CHECK_NEAR((double)l1[9 * n + 3 + 1], -0.15, 0.002);
        CHECK_NEAR((double)l1[9 * n], 0, 0.01);
        CHECK_NEAR((double)l1[9 * n + 2], 0, 0.01);
        CHECK_NEAR((double)sky[3 * n], 0.5, 1.0 / 64);
        CHECK(*through((size_t)n, 0) == 1);
    }
    CHECK(l0[6] == 0 && l1[18 + 1] == 0 && *through(2, 0) == 0);
    CHECK_NEAR((double)sky[6], 0.5, 1.0 / 64);
    check_color(s.scene.ambient, 1, 1, 1); /* the plane reflects it, the sky brings it */
    check_color(s.light[0].color, 0, 0, 0);
    if (!probe(3, points)) return;
    for (int n = 0; n < 3; ++n) CHECK_NEAR((double)l0[3 * n], 0.75, 1.0 / 128);
    CHECK(*through(0, 0) == 1 && *through(2, 0) == 0); /* a black light, too */
}

/* At the centre of a thin ball under a sun of irradiance 4 pi, L0 is albedo times depth times 1 - depth, to first order
   half of that twice. A lobe turns it into L1, towards the sun for a positive asymmetry. Bounds as above, of 48 cells.
 */
static void test_thin_ball(void) {
    static const double centre[3] = {0, 0, 0};
    for (int i = 0; i < 2; ++i) {
        const sps_lobe lobe = {i ? 0.7f : 0, 1};
        check_clear(&s, 8, 8);
        sps_volume *ball = add_ball(1e-4, 0.5);
        s.view.scattering_resolution = 48;
        check_color(ball->albedo, 0.5, 0.6, 1);
        ball->lobes = &lobe, ball->lobe_count = 1;
        check_add_directional(&s, 0, -1, 0, 4 * PI);
        if (!probe(1, centre)) continue;
        const double exact[3] = {0.5 * 8e-5, 0.6 * 8e-5, 8e-5};
        for (int c = 0; c < 3; ++c) {
            if (figures()) printf("thin ball: %.5g, exact %.5g\n", (double)l0[c], exact[c]);
            CHECK_NEAR((double)l0[c], exact[c], 0.005 * exact[c]);
            CHECK_NEAR((double)l1[3 * c + 1], i * 0.7 * exact[c], 0.005 * exact[c]);
            CHECK_NEAR((double)l1[3 * c], 0, 0.002 * exact[c]);
        }
    }
}

/* A small flame of intensity I: L0 is I / (4 pi d^2), and L1 is as long. The cone of rays about it has 128, of which a
   tenth meet it. */
static void test_flame(void) {
    static const double points[] = {0, 0, 5, 3, 40, -20};
    double intensity = 0;
    check_clear(&s, 8, 8);
    sps_volume *flame = check_add_volume(&s, 32, 32, 32, check_box(-0.3, -0.3, -0.3, 0.3, 0.3, 0.3));
    radius = 0.2;
    flame->eval_fn = eval_ball;
    check_color(flame->emission, 1, 2, 3);
    for (int i = 0; i < 32768; ++i) {
        const int voxel[3] = {i % 32, i / 32 % 32, i / 1024};
        double at[3];
        float value;
        for (int k = 0; k < 3; ++k) at[k] = -0.3 + 0.6 * (voxel[k] + 0.5) / 32;
        (void)eval_ball(NULL, 1, at, &value);
        intensity += (double)value * pow(0.6 / 32, 3);
    }
    for (int i = 0; i < 3; ++i) {
        s.view.quality = i ? SPS_QUALITY_MEDIUM : SPS_QUALITY_DRAFT;
        if (i == 2) { /* cells, from which emission flies: all of it still arrives, once */
            s.view.scattering = SPS_SCATTERING_MULTIPLE;
            flame->extinction = 1e-5f;
            check_color(flame->albedo, 1, 1, 1);
        }
        if (!probe(2, points)) continue;
        for (int n = 0; n < 2; ++n) {
            const double *at = points + 3 * n, away = vec_length(at), exact = intensity / (4 * PI * away * away);
            if (figures()) printf("flame: %.4f\n", (double)l0[3 * n] / exact);
            CHECK_NEAR((double)l0[3 * n], exact, 0.03 * exact);
            CHECK_NEAR((double)l0[3 * n + 2], 3 * (double)l0[3 * n], 1e-5 * exact);
            for (int k = 0; k < 3; ++k)
                CHECK_NEAR((double)l1[9 * n + k], -(double)l0[3 * n] * at[k] / away, 0.01 * exact);
            CHECK_NEAR((double)sky[3 * n], 1, 1e-6);
        }
    }
}

/* A lamp of intensity 1 in a thin ball of radius R, a from its middle, makes the gas scatter 2 pi (R + (R^2 - a^2) /
   (2 a) log((R + a) / (R - a))) times the extinction, as if from a point afar. Cells have the mean of 1 / r^2 to second
   order: the lamp's own has 8 of 4 pi R / edge, 110 here. A ray stands for 1/512 of the cone, two squared edges:
   whether one or two meet the lamp's column, 16 of 110, is 15 %; the mean over 12 places varies by a third of that. */
static void test_lamp(void) {
    static const double point[3] = {0, 0, 40};
    const double a = 0.35, whole = 0.8 + (0.64 - a * a) / (2 * a) * log((0.8 + a) / (0.8 - a));
    const double exact = 1e-4 * 0.5 * whole / (4 * PI * 1600);
    double mean = 0;
    for (int i = 0; i < 12; ++i) {
        check_clear(&s, 8, 8);
        s.view.quality = SPS_QUALITY_ULTRA;
        s.view.scattering_resolution = 24;
        add_ball(1e-4, 1);
        check_add_point(&s, a * cos(PI / 6 * i), a * sin(PI / 6 * i), 0, 1);
        if (!probe(1, point)) continue;
        if (figures()) printf("lamp: %.4f\n", (double)l0[0] / exact);
        CHECK_NEAR((double)l0[0], exact, 0.15 * exact);
        mean += (double)l0[0] / 12;
    }
    CHECK_NEAR(mean, exact, 0.05 * exact);
}

/* ------------------------------------------------------------------------------------------- pictures of all sides */

/* Mean radiance over the sphere and L1 of the green channel, from six pictures. */
static int cube(const double point[3], double mean[3], double vector[3]) {
    static float rgba[4 * SIDE * SIDE];
    const sps_image image = {rgba, NULL, 0};
    double all = 0;
    memset(mean, 0, 3 * sizeof *mean);
    memset(vector, 0, 3 * sizeof *vector);
    for (int n = 0; n < 6; ++n) {
        double forward[3] = {0, 0, 0}, right[3], up[3];
        forward[n / 2] = n % 2 ? 1 : -1;
        vec_basis(forward, right, up);
        s.view.width = s.view.height = SIDE;
        memset(&s.view.camera, 0, sizeof s.view.camera);
        s.view.camera.field_of_view = PI / 2;
        for (int k = 0; k < 3; ++k) {
            s.view.camera.position[k] = point[k];
            s.view.camera.target[k] = point[k] + forward[k];
            s.view.camera.up[k] = up[k];
        }
        vec_cross(forward, up, right);
        if (!CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image))) return 0;
        for (int i = 0; i < SIDE * SIDE; ++i) {
            const double x = 2 * (i % SIDE + 0.5) / SIDE - 1, y = 1 - 2 * (i / SIDE + 0.5) / SIDE;
            const double solid = pow(1 + x * x + y * y, -1.5);
            all += solid;
            for (int c = 0; c < 3; ++c) mean[c] += solid * (double)rgba[4 * i + c];
            for (int k = 0; k < 3; ++k)
                vector[k] +=
                    solid / sqrt(1 + x * x + y * y) * (double)rgba[4 * i + 1] * (forward[k] + x * right[k] + y * up[k]);
        }
    }
    for (int c = 0; c < 3; ++c) mean[c] /= all, vector[c] /= all;
    return 1;
}

/* L0 and L1 are those of pictures of all six sides whose background is the ambient light. Errors are relative to L0:
   128 rays, half of them in gas, and cells of a twelfth of the gas (a lobe changes faster) give 1.5 and 2.5 %. With a
   floor three times as bright as the mean, two rays on the wrong side of the horizon are 4 %. */
static void compare(const char *name, double tolerance, size_t count, const double *points) {
    double worst = 0, aside = 0;
    for (size_t n = 0; n < count; ++n) {
        double mean[3], vector[3];
        memcpy(s.scene.background, s.scene.ambient, sizeof s.scene.background);
        if (!cube(points + 3 * n, mean, vector) || !probe(1, points + 3 * n)) return;
        if (figures())
            printf("%s %d: %.4f %.4f %.4f, pictures %.4f %.4f %.4f\n", name, (int)n, (double)l0[0], (double)l0[1],
                   (double)l0[2], mean[0], mean[1], mean[2]);
        if (figures())
            printf("    L1 %.4f %.4f %.4f, pictures %.4f %.4f %.4f\n", (double)l1[3], (double)l1[4], (double)l1[5],
                   vector[0], vector[1], vector[2]);
        for (int c = 0; c < 3; ++c) worst = fmax(worst, fabs((double)l0[c] / mean[c] - 1));
        for (int k = 0; k < 3; ++k) aside = fmax(aside, fabs((double)l1[3 + k] - vector[k]) / mean[1]);
    }
    if (figures()) printf("%s: %.4f, %.4f\n", name, worst, aside);
    if (!CHECK_NEAR(worst, 0, tolerance) || !CHECK_NEAR(aside, 0, tolerance)) printf("    %s\n", name);
}

static void test_pictures(void) {
    static const double points[] = {0.1, -0.2, 0.15, 0.6, 0.5, -0.4, -0.3, 1.4, 0.9};
    static const sps_lobe lobes[2] = {{0.5f, 1}, {0.8f, 1}};
    for (int i = 0; i < 12; ++i) {
        const int lobe = i % 3, floor = i >= 6;
        static const char *const names[] = {"single",   "single, lobe .5",   "single, lobe .8",
                                            "multiple", "multiple, lobe .5", "multiple, lobe .8"};
        if (!check_long() && i != 3 && i != 11) continue;
        check_clear(&s, 8, 8);
        s.view.scattering = i % 6 > 2 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        s.view.scattering_resolution = check_long() ? 0 : 24;
        sps_volume *gas = check_add_puff(&s, 4);
        gas->revision = 1;
        check_color(gas->albedo, 0.8, 0.9, 1);
        if (lobe) gas->lobes = &lobes[lobe - 1], gas->lobe_count = 1;
        check_add_directional(&s, 0.4, -1, -0.3, 6);
        sps_light *disc = check_add_light(&s, SPS_LIGHT_DISC, 4);
        check_set3(disc->position, 1.5, 0.5, 1);
        disc->axes[0][0] = disc->axes[1][2] = 0.2;
        disc->samples = 4;
        check_color(s.scene.ambient, 0.1, 0.2, 0.3);
        if (floor) add_square(-1, 6, 0.5)->revision = 1;
        compare(names[i % 6], floor ? 0.04 : lobe ? 0.025 : 0.015, check_long() ? 3 : 2, points);
    }
}

/* Thin gas of extinction 1e-3 in a box of half width 1, around a lamp of intensity 1 at x = `lamp`: a path from `point`
   in a unit direction passes the lamp at distance q, and gets the integral of 1 / (q^2 + s^2). */
static double thin_glow(const double point[3], const double lamp[3]) {
    const int directions = 40000;
    double sum = 0;
    for (int n = 0; n < directions; ++n) {
        const double up = 1 - (2 * n + 1.0) / directions, aside = sqrt(1 - up * up), turn = 2.39996322972865332 * n;
        const double way[3] = {aside * cos(turn), aside * sin(turn), up};
        double end = HUGE_VAL, offset[3];
        for (int k = 0; k < 3; ++k) {
            offset[k] = lamp[k] - point[k];
            end = fmin(end, ((way[k] > 0 ? 1 : -1) - point[k]) / way[k]);
        }
        const double along = vec_dot(offset, way), q = sqrt(fmax(vec_dot(offset, offset) - along * along, 1e-12));
        sum += (atan((end - along) / q) + atan(along / q)) / q;
    }
    return 1e-3 / (4 * PI) * sum / directions;
}

/* A lamp anywhere between the corner and the middle of its cell, seen from four edges away. The eight cells at a corner
   send 12 % of the light. For these, the second order of spsi_sphere_square has 1 / (3/4 - 1/12) instead of 7.67 / 4,
   the mean of 1 / r^2 over a cube about the lamp: 2.7 % of all light is missing. Rim and 512 rays may take 2 % more. */
static void test_lamp_in_cell(void) {
    check_clear(&s, 8, 8);
    s.view.quality = SPS_QUALITY_ULTRA;
    s.view.scattering_resolution = 16;
    sps_volume *gas = check_add_volume(&s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
    gas->eval_fn = check_eval_constant, gas->user = (void *)(size_t)&one;
    gas->extinction = 1e-3f;
    check_color(gas->albedo, 1, 1, 1);
    sps_light *lamp = check_add_point(&s, 0, 0, 0, 1);
    for (int n = 0; n < 9; ++n) {
        const double at = n / 64.0, point[3] = {at + 0.5, at, at};
        check_set3(lamp->position, at, at, at);
        if (!probe(1, point)) continue;
        const double exact = thin_glow(point, lamp->position);
        if (figures()) printf("lamp at %.3f: %.4g, exact %.4g\n", at, (double)l0[0], exact);
        CHECK_NEAR((double)l0[0], exact, 0.047 * exact);
    }
}

/* Cells that a picture left are used by probes, and the other way round; pictures keep their bits. */
static void test_cache(void) {
    static const double point[3] = {0.2, 0.1, 0};
    static float rgba[2][4 * SIDE * SIDE];
    sps_image image = {rgba[0], NULL, 0};
    sps_stats_report stats;
    float first[3];
    check_clear(&s, SIDE, SIDE);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.scattering_resolution = 16;
    sps_volume *gas = check_add_puff(&s, 4);
    gas->revision = 7;
    check_color(gas->albedo, 0.8, 0.9, 1);
    check_add_directional(&s, 0.4, -1, -0.3, 6);
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    probe(1, point);
    sps_get_stats(context, &stats);
    CHECK(stats.cells == 0);
    memcpy(first, l0, sizeof first);
    image.rgba = rgba[1];
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    sps_get_stats(context, &stats);
    CHECK(stats.cells == 0 && memcmp(rgba[0], rgba[1], sizeof rgba[0]) == 0);
    gas->revision = 8;
    probe(1, point);
    sps_get_stats(context, &stats);
    CHECK(stats.cells > 0 && memcmp(first, l0, sizeof first) == 0);
    CHECK_OK(context, sps_render(context, &s.scene, &s.view, &image));
    sps_get_stats(context, &stats);
    CHECK(stats.cells == 0 && memcmp(rgba[0], rgba[1], sizeof rgba[0]) == 0);
}

/* ------------------------------------------------------------------------------------------------------ odd places */

/* Two grids on a line: the gas between dims what glows behind, whatever the order of volumes, and shadows it. */
static void test_two_grids(void) {
    static const double points[] = {-10, 0, 0, 60, 30, 0, 60, 0, 0};
    for (int i = 0; i < 2; ++i) {
        check_clear(&s, 8, 8);
        s.view.scattering_resolution = 24;
        for (int n = 0; n < 2; ++n) {
            sps_volume *ball = add_ball(2, 0);
            ball->size[0] = ball->size[1] = ball->size[2] = 20;
            if (n != i) continue;
            ball->extinction = 1e-6f;
            ball->placement.origin[0] += 60;
            ball->eval_fn = check_eval_constant;
            ball->user = (void *)(size_t)&one;
            check_color(ball->emission, 1, 1, 1);
        }
        check_add_directional(&s, 1, 0, 0, 1);
        if (!probe(3, points)) continue;
        /* 8 / (4 pi d^2), through a ball's middle, in rays that spread by 1/35 of its radius; its rim is soft */
        if (figures())
            printf("two grids: %.4g, %.4g; sun %.4f\n", (double)l0[0], (double)l0[3], (double)*through(2, 0));
        CHECK_NEAR((double)l0[0], exp(-3.2) * 8 / (4 * PI * 4900), 0.1 * exp(-3.2) * 8 / (4 * PI * 4900));
        CHECK_NEAR((double)l0[3], 8 / (4 * PI * 900), 0.02 * 8 / (4 * PI * 900));
        CHECK_NEAR((double)*through(2, 0), exp(-3.2), 0.06 * exp(-3.2));
        CHECK(*through(0, 0) == 1 && sky[0] < 1);
    }
}

/* Polygons between lights and points, without gas: opaque, colored, an edge through an area light, a light without
   shadows, and a solid from within. */
static void test_lights(void) {
    static const double points[] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 50, -1, 0};
    check_clear(&s, 8, 8);
    add_square(0, 2, 0.5);
    check_add_directional(&s, 0, -1, 0, 1);
    check_add_point(&s, 0.1, 2, 0, 1);
    check_add_point(&s, 0, 4, 0, 1)->no_shadow = 1;
    sps_light *disc = check_add_light(&s, SPS_LIGHT_DISC, 1);
    check_set3(disc->position, 4, 1, 0); /* from the first point, the square's edge cuts it in halves */
    disc->axes[0][1] = disc->axes[1][2] = 0.5;
    disc->samples = 256;
    if (!probe(4, points)) return;
    CHECK(*through(0, 0) == 0 && *through(0, 1) == 0 && *through(0, 2) == 1);
    CHECK_NEAR((double)*through(0, 3), 0.5, 0.03); /* 256 points, of which 16 lie on the edge, half of them on a side */
    for (int i = 0; i < 4; ++i) CHECK(*through(1, i) == 1 && *through(2, i) == 1 && *through(3, i) == 1);
    check_color(s.mesh[0].transmittance, 0.25, 0.5, 1);
    check_color(s.mesh[0].albedo, 0, 0, 0);
    check_color(s.scene.ambient, 1, 1, 1);
    if (!probe(4, points)) return;
    for (int c = 0; c < 3; ++c) {
        const double passes = 0.25 * (1 << c), seen = (double)(1 - sky[0]) / 0.75;
        CHECK_NEAR((double)through(0, 0)[c], passes, 1e-6);
        CHECK_NEAR((double)sky[c], 1 - seen * (1 - passes), 1e-5);
        CHECK_NEAR((double)l0[c], (double)sky[c], 1e-5);
    }
    CHECK(sky[0] < 0.8f && sky[9] > 0.99f);
}

/* A cube from within: its walls are as bright as they reflect the ambient light, and nothing else arrives. */
static void test_solid(void) {
    static const double points[] = {0, 0, 0, 0.4, 0.3, -0.2, 5, 5, 5};
    check_clear(&s, 8, 8);
    add_square(-0.5, 0.5, 0.25);
    for (int n = 0; n < 5; ++n) {
        const double corner[3] = {n == 1 ? 0.5 : -0.5, n == 0 ? 0.5 : -0.5, n == 3 ? 0.5 : -0.5};
        const double u[3] = {n == 1 || n == 2 ? 0 : 1, n == 1 || n == 2, 0}, v[3] = {0, n > 2, n < 3};
        check_add_quad(&faces, corner, u, v);
    }
    s.mesh[0].triangle_count = faces.count;
    check_add_directional(&s, 1, -1, 0.5, 100);
    check_color(s.scene.ambient, 4, 8, 0);
    if (!probe(3, points)) return;
    for (int n = 0; n < 2; ++n) {
        CHECK(*through((size_t)n, 0) == 0);
        for (int c = 0; c < 3; ++c) CHECK_NEAR((double)sky[3 * n + c], 0, 1e-6);
        CHECK_NEAR((double)l0[3 * n], 1, 1e-5);
        CHECK_NEAR((double)l0[3 * n + 1], 2, 1e-5);
        CHECK(l0[3 * n + 2] == 0);
    }
    CHECK(*through(2, 0) == 1 && sky[6] > 0.98f);
}

/* Nothing at all; positions that are no numbers, or far away, or in the middle of numbers at their limits. */
static void test_odd(void) {
    const double points[] = {0, 0, 0, (double)NAN, 0, 0, 0, HUGE_VAL, 0, 0, 0, 2e15, 1e14, 1e14, -1e14, 0.3, 0, 0};
    check_clear(&s, 8, 8);
    if (!probe(6, points)) return;
    for (int n = 0; n < 6; ++n) CHECK(sky[3 * n] == (n < 1 || n > 3 ? 1 : 0) && l0[3 * n] == 0 && l1[9 * n] == 0);
    sps_volume *gas = check_add_puff(&s, 1e18);
    check_color(gas->albedo, 1, 1, 1);
    check_color(gas->emission, 1e18, 1e18, 0);
    check_add_directional(&s, 1, 0, 0, 1e18);
    check_add_point(&s, 0, 0, 0, 1e18); /* at the first point */
    check_color(s.scene.ambient, 1e18, 0, 0);
    add_square(0, 1, 1); /* and on a polygon */
    for (int i = 0; i < 3; ++i) {
        s.view.quality = SPS_QUALITY_DRAFT;
        s.view.scattering = i ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        gas->extinction = i < 2 ? 1e18f : 1e-18f;
        if (!probe(6, points)) continue;
        for (int n = 0; n < 18; ++n) CHECK(sky[n] >= 0 && sky[n] <= 1 && l0[n] >= 0 && l0[n] <= FLT_MAX);
        for (int n = 0; n < 54; ++n) CHECK(fabsf(l1[n]) <= FLT_MAX);
        for (int n = 0; n < 36; ++n) CHECK(transmittance[n] >= 0 && transmittance[n] <= 1);
        for (int n = 3; n < 12; ++n) CHECK(sky[n] == 0 && l0[n] == 0);
        CHECK(sky[12] == 1 && *through(4, 0) == 1);
    }
}

/* --------------------------------------------------------------------------------------------------------- failures */

/* Gas of two materials in two grids, polygons and lights of all kinds: every buffer has a use. */
static void everything(void) {
    static const sps_lobe lobe = {0.6f, 1};
    check_clear(&s, 8, 8);
    s.view.quality = SPS_QUALITY_DRAFT;
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.scattering_resolution = s.view.shadow_resolution = 8;
    for (int n = 0; n < 2; ++n) {
        sps_volume *gas = check_add_puff(&s, 4);
        gas->placement.origin[0] += 12 * n;
        gas->size[0] = gas->size[1] = gas->size[2] = 8;
        check_color(gas->albedo, 0.8, 0.9, 1);
        if (n) gas->eval_fn = check_eval_constant, gas->user = (void *)(size_t)&one;
        if (n)
            check_color(gas->emission, 1, 1, 0);
        else
            gas->lobes = &lobe, gas->lobe_count = 1;
    }
    add_square(-1.2, 3, 0.5);
    check_add_directional(&s, 0.3, -1, 0.2, 1);
    sps_light *disc = check_add_light(&s, SPS_LIGHT_DISC, 1);
    check_set3(disc->position, 0, 3, 0);
    disc->axes[0][0] = disc->axes[1][2] = 0.5;
    disc->samples = 4;
    check_color(s.scene.ambient, 0.1, 0.2, 0.3);
}

static const double some_points[] = {0, 0, 0, 0.3, 0.4, -0.2, 1, 2, 3, 11.5, 0, 0, 6, 0, 0, 0, -2, 0, 0, -1.19, 0};
enum { SOME = 7 };

static int untouched(void) {
    int same = 1;
    for (int n = 0; n < 3 * LIGHTS * MOST; ++n) same &= transmittance[n] == -7;
    for (int n = 0; n < 9 * MOST; ++n) same &= l1[n] == -7;
    for (int n = 0; n < 3 * MOST; ++n) same &= sky[n] == -7 && l0[n] == -7;
    return same;
}

static void refused(sps_result result, sps_object object, const char *field, size_t count, const double *points,
                    const sps_probe_arrays *out) {
    sps_error_info info;
    fill_arrays(-7);
    CHECK(sps_light_probes(context, &s.scene, &s.view, count, points, out) == result);
    sps_get_error(context, &info);
    if (!CHECK(info.result == result && info.object == object && strcmp(info.field, field) == 0 && *info.sentence))
        printf("    %s: %d %d %s\n", field, (int)info.result, (int)info.object, info.sentence);
    CHECK(untouched());
}

static void test_refused(void) {
    sps_probe_arrays out = all_arrays();
    everything();
    refused(SPS_ERROR_ARGUMENT, SPS_OBJECT_CALL, "out", SOME, some_points, NULL);
    refused(SPS_ERROR_ARGUMENT, SPS_OBJECT_CALL, "positions", SOME, NULL, &out);
    CHECK(sps_light_probes(NULL, &s.scene, &s.view, SOME, some_points, &out) == SPS_ERROR_ARGUMENT);
    CHECK(sps_light_probes(context, NULL, &s.view, SOME, some_points, &out) == SPS_ERROR_ARGUMENT);
    CHECK(sps_light_probes(context, &s.scene, NULL, SOME, some_points, &out) == SPS_ERROR_ARGUMENT);
    out.start_canary = 1;
    refused(SPS_ERROR_ARGUMENT, SPS_OBJECT_PROBE_ARRAYS, "start_canary", SOME, some_points, &out);
    CHECK(strncmp(sps_error(context), "out.start_canary is 1", 21) == 0);
    out.start_canary = 0, out.end_canary = 2;
    refused(SPS_ERROR_ARGUMENT, SPS_OBJECT_PROBE_ARRAYS, "end_canary", SOME, some_points, &out);
    out.end_canary = 0;
    s.view.scattering = SPS_SCATTERING_FORWARD;
    refused(SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, "scattering", SOME, some_points, &out);
    s.view.scattering = SPS_SCATTERING_CONVOLUTION;
    refused(SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, "scattering", 0, NULL, &out);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    s.view.quality = SPS_QUALITY_DEFAULT, s.view.scattering_resolution = 0;
    s.view.budget_seconds = 1;
    refused(SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, "budget_seconds", SOME, some_points, &out);
    s.view.budget_seconds = 0, s.view.budget_error = 0.1;
    refused(SPS_ERROR_UNSUPPORTED, SPS_OBJECT_VIEW, "budget_error", SOME, some_points, &out);
    s.view.budget_error = 0;
    s.scene.ambient[1] = -1;
    refused(SPS_ERROR_ARGUMENT, SPS_OBJECT_SCENE, "ambient", SOME, some_points, &out);
    s.scene.ambient[1] = 0;
    refused(SPS_ERROR_MEMORY, SPS_OBJECT_NONE, "", SIZE_MAX / 8, some_points, &out);
    fill_arrays(-7);
    CHECK_OK(context, sps_light_probes(context, &s.scene, &s.view, 0, NULL, &out));
    CHECK(untouched());
}

/* Each array alone has the bits that it has beside the others; without any, nothing is written. */
static void test_arrays(void) {
    static float kept[4][9 * MOST];
    float *const arrays[4] = {transmittance, sky, l0, l1};
    const size_t floats[4] = {3 * 2 * SOME, 3 * SOME, 3 * SOME, 9 * SOME};
    everything();
    if (!probe(SOME, some_points)) return;
    for (int n = 0; n < 4; ++n) memcpy(kept[n], arrays[n], floats[n] * sizeof(float));
    for (int n = 0; n < 5; ++n) {
        sps_probe_arrays out = {
            0, n == 0 ? transmittance : NULL, n == 1 ? sky : NULL, n == 2 ? l0 : NULL, n == 3 ? l1 : NULL, 0};
        fill_arrays(-7);
        CHECK_OK(context, sps_light_probes(context, &s.scene, &s.view, SOME, some_points, &out));
        for (int i = 0; i < 4; ++i)
            CHECK(i == n ? memcmp(kept[i], arrays[i], floats[i] * sizeof(float)) == 0 : arrays[i][0] == -7);
        if (n < 4) CHECK(arrays[n][floats[n]] == -7); /* nothing beyond */
    }
}

/* The same bits for any number of workers; progress rises to 1 and cancels anywhere; any allocation may fail, and
   memory may end at any limit. Afterwards, the same call answers as before. */
static void test_workers(void) {
    static float kept[4][9 * MOST];
    const size_t floats[4] = {3 * 2 * SOME, 3 * SOME, 3 * SOME, 9 * SOME};
    float *const arrays[4] = {transmittance, sky, l0, l1};
    const sps_probe_arrays out = all_arrays();
    everything();
    if (!probe(SOME, some_points)) return;
    for (int n = 0; n < 4; ++n) memcpy(kept[n], arrays[n], floats[n] * sizeof(float));
    for (int workers = 1; workers < 8; workers += 3) {
        check_hooks hooks;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = workers, hooks.order = (uint64_t)workers;
        sps_context *own = check_context(&hooks);
        fill_arrays(-7);
        CHECK_OK(own, sps_light_probes(own, &s.scene, &s.view, SOME, some_points, &out));
        for (int n = 0; n < 4; ++n) CHECK(memcmp(kept[n], arrays[n], floats[n] * sizeof(float)) == 0);
        sps_destroy(own);
        CHECK(hooks.live == 0);
    }
}

static void fails(const sps_config *config, check_hooks *hooks, check_cancel *cancel, long at, sps_result result) {
    const sps_probe_arrays out = all_arrays();
    sps_context *own = sps_create(config, NULL);
    fill_arrays(-7);
    if (hooks) hooks->fail_at = hooks->allocations + at;
    if (cancel) cancel->calls = 0, cancel->at = at;
    CHECK(sps_light_probes(own, &s.scene, &s.view, SOME, some_points, &out) == result && untouched());
    if (hooks) hooks->fail_at = 0;
    if (cancel) cancel->at = 0;
    CHECK_OK(own, sps_light_probes(own, &s.scene, &s.view, SOME, some_points, &out));
    CHECK(!untouched());
    sps_destroy(own);
}

static float last_fraction;
static int rises = 1;

static int note_fraction(void *user, float fraction) {
    rises &= fraction >= last_fraction && fraction <= 1;
    last_fraction = fraction;
    return check_cancel_at(user, fraction);
}

static void test_failures(void) {
    check_hooks hooks;
    check_cancel cancel = {0, 0};
    const sps_probe_arrays out = all_arrays();
    const int each = check_long() ? 1 : 18;
    memset(&hooks, 0, sizeof hooks);
    sps_config config = check_config(&hooks);
    config.progress_fn = note_fraction, config.progress_user = &cancel, config.clock_fn = check_hasty_clock;
    everything();
    sps_context *own = sps_create(&config, NULL);
    const long before = hooks.allocations;
    CHECK_OK(own, sps_light_probes(own, &s.scene, &s.view, SOME, some_points, &out));
    CHECK(rises && last_fraction == 1);
    const long allocations = hooks.allocations - before, calls = cancel.calls;
    const size_t peak = hooks.peak;
    sps_destroy(own);
    if (figures()) printf("%ld allocations, %ld calls of progress_fn, %zu bytes\n", allocations, calls, peak);
    CHECK(allocations > 20 && calls > 20);
    config.progress_fn = check_cancel_at;
    for (long n = 1; n <= allocations; n += each) fails(&config, &hooks, NULL, n, SPS_ERROR_MEMORY);
    for (int n = 0; n < 24; n += each)
        fails(&config, NULL, &cancel, n == 18 ? calls : 1 + calls * n / 24, SPS_ERROR_CANCELLED);
    for (int n = 1; n < 24; n += each) { /* a limit may make tables smaller */
        config.memory_limit = hooks.peak = peak * (size_t)n / 24;
        own = sps_create(&config, NULL);
        hooks.peak = hooks.live;
        fill_arrays(-7);
        const sps_result result = sps_light_probes(own, &s.scene, &s.view, SOME, some_points, &out);
        CHECK(hooks.peak <= config.memory_limit && (result == SPS_ERROR_MEMORY ? untouched() : result == SPS_OK));
        CHECK(n > 1 || result == SPS_ERROR_MEMORY);
        sps_destroy(own);
    }
    CHECK(hooks.live == 0 && hooks.live_blocks == 0);
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_ball);
    RUN(test_slab);
    RUN(test_furnace);
    RUN(test_plane);
    RUN(test_thin_ball);
    RUN(test_flame);
    RUN(test_lamp);
    RUN_LONG(test_pictures);
    RUN(test_lamp_in_cell);
    RUN(test_cache);
    RUN(test_two_grids);
    RUN(test_lights);
    RUN(test_solid);
    RUN(test_odd);
    RUN(test_refused);
    RUN(test_arrays);
    RUN(test_workers);
    RUN(test_failures);
    sps_destroy(context);
    check_free_triangles(&faces);
    return check_report();
}
