/* Light through volumes against exact answers: slabs, blobs, emission, lights of every kind; and scenes without a
   closed form against sps_reference. Tolerances are derived where they are used, from
   RIPPLE    a constant grid's optical depth is constant to 0.2 % only (kernel of 0.65 voxels cut at 2.5, as for high
             and ultra quality; test_ripple sums it up);
   ROUNDING  floats: 6e-8 for each operation, so for n sheets added up 6e-8 n of the sum at most. A slab whose
             extinction depends on z alone needs no more than that along an eye's ray: the in-sheet closed forms are
             exact for it at any number of sheets and any tilt, because both optical depths are linear in one another
             there;
   TEXELS    per voxel, 4 for ultra. The light's depth comes from texels, and between them straight lines stand for its
             bend at the slab's faces: bends of slope t over 2.5 * 0.65 voxels, so t / 1.6 / 4^2 / 8 of a voxel's
             depth. */

#include "check.h"

#define RIPPLE    0.002
#define ROUNDING  6e-8
#define ISOTROPIC (0.25 / PI)

enum { PIXELS_MOST = 64 * 64 };
static float image_a[4 * PIXELS_MOST], image_b[4 * PIXELS_MOST], image_c[4 * PIXELS_MOST];
static float depth_a[PIXELS_MOST], depth_b[PIXELS_MOST];
static sps_context *context;
static float one = 1;

/* ---------------------------------------------------------------------------------------------------------- helpers */

/* An orthographic camera that looks along `way` towards the origin. */
static void aim(check_scene *s, const double way[3], double height) {
    const double length = sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
    for (int i = 0; i < 3; ++i) s->view.camera.position[i] = -10 * way[i] / length;
    check_set3(s->view.camera.up, 0, 1, 0);
    if (fabs(way[0]) + fabs(way[2]) < 0.01 * length) check_set3(s->view.camera.up, 1, 0, 0);
    check_orthographic(&s->view.camera, height);
}

/* The value of a channel that is farthest from `exact` over all pixels. */
static double farthest(const float *image, int pixels, int channel, double exact) {
    double worst = exact;
    for (int i = 0; i < pixels; ++i) {
        const double value = (double)image[4 * i + channel];
        if (!(fabs(value - exact) <= fabs(worst - exact))) worst = value;
    }
    return worst;
}

static double largest_of(const float *image, size_t floats) {
    double most = 0;
    for (size_t i = 0; i < floats; ++i) most = fmax(most, (double)image[i]);
    return most;
}

/* A slab of voxels of 0.1 around the origin: side x side x layers, value 1, optical depth tau along z; rays end late.
 */
static sps_volume *add_slab(check_scene *s, int side, int layers, double tau) {
    const double w = 0.05 * side, h = 0.05 * layers;
    sps_volume *volume = check_add_volume(s, side, side, layers, check_box(-w, -w, -h, w, w, h));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)(tau / (0.1 * layers));
    s->view.quality = SPS_QUALITY_ULTRA;
    return volume;
}

/* Radiance of a slab towards the eye per unit of albedo, phase function and irradiance. te, tl: its optical depth along
   the eye's and the light's ray; `same`: light enters through the face that the eye sees. */
static double slab_radiance(double te, double tl, int same) {
    const double d = fabs(te - tl);
    if (same) return te * -expm1(-te - tl) / (te + tl);
    return te * exp(-fmin(te, tl)) * (d > 1e-9 ? -expm1(-d) / d : 1);
}

/* The change of slab_radiance if either optical depth has a relative error of `share`. */
static double slab_slack(double te, double tl, int same, double share) {
    const double exact = slab_radiance(te, tl, same);
    return fabs(slab_radiance(te * (1 + share), tl, same) - exact) +
           fabs(slab_radiance(te, tl * (1 + share), same) - exact);
}

/* ---------------------------------------------------------------------------------------------- absorption in slabs */

/* Line integral through a lattice of unit kernels at (x,y), each cut at `reach` voxels and divided by what it keeps. */
static double lattice_sum(double x, double y, double reach) {
    const double variance = 0.65 * 0.65, kept = -expm1(-0.5 * reach * reach / variance);
    double sum = 0;
    for (int j = -3; j <= 4; ++j)
        for (int i = -3; i <= 4; ++i) {
            const double square = (x - i) * (x - i) + (y - j) * (y - j);
            if (square < reach * reach) sum += exp(-0.5 * square / variance) / (2 * PI * variance * kept);
        }
    return sum;
}

/* One voxel of a constant grid, enlarged and splatted: its ripple is that of the lattice, and no more. Straight through
   whole kernels only their footprints matter: 1e-5 for the floats of exp and of alpha, 2e-7 / 1.5e-2. */
static void test_ripple(void) {
    static const sps_quality qualities[4] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH,
                                             SPS_QUALITY_ULTRA};
    for (int n = 0; n < 4; ++n) {
        const double reach = n == 0 ? 2.8 * 0.65 : n == 1 ? 3.3 * 0.65 : 2.5;
        double worst = 0, ripple = 0;
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 21, 21);
        check_orthographic(&s.view.camera, 0.1 * 21 / 20.5);
        s.view.quality = qualities[n];
        s.view.filling = SPS_FILLING_SPLAT;
        volume = check_add_volume(&s, 15, 13, 15, check_box(-0.75, -0.65, -0.75, 0.75, 0.65, 0.75));
        volume->read_fn = check_read_constant;
        volume->user = &one;
        volume->extinction = 0.01f;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 441; ++i) {
            const double x = (i % 21 - 10) / 20.5, y = (10 - i / 21) / 20.5, sum = lattice_sum(x, y, reach);
            worst = fmax(worst, fabs(-log1p(-(double)image_a[4 * i + 3]) / 0.015 - sum));
            ripple = fmax(ripple, fabs(sum - 1));
        }
        if (!CHECK_NEAR(worst, 0, 1e-5 + 2e-7 / 1.5e-2)) printf("    quality %d\n", (int)qualities[n]);
        if (n >= 2) CHECK(ripple <= RIPPLE);
    }
}

/* exp(-tau / cos) through a slab, upright and tilted, for any number of sheets. */
static void test_slab_transmittance(void) {
    static const int sheets[6] = {1, 2, 7, 64, 512, 4096}, tilts[4] = {0, 17, 40, 60};
    for (int n = 0; n < 6; ++n)
        for (int t = 0; t < (sheets[n] > 64 ? 2 : 4); ++t) {
            const double angle = tilts[t] * PI / 180, way[3] = {sin(angle), 0, -cos(angle)}, tau = 1.3 / cos(angle);
            check_scene s;
            check_clear(&s, 5, 3);
            aim(&s, way, 0.23);
            add_slab(&s, sheets[n] > 64 ? 19 : 35, 6, 1.3);
            s.view.slab_thickness = 6.0 / sheets[n];
            check_color(s.scene.background, 2, 1, 0.5);
            if (!check_render(context, &s, image_a)) return;
            if (!CHECK_NEAR(farthest(image_a, 15, 0, 2 * exp(-tau)), 2 * exp(-tau),
                            2 * exp(-tau) * tau * (RIPPLE + sheets[n] * ROUNDING)) ||
                !CHECK_CASE("Transport", "uniform slab, 1 to 4096 sheets, upright and tilted by up to 60 degrees",
                            "coverage 1 - exp(-depth / cosine)",
                            fabs(farthest(image_a, 15, 3, 1 - exp(-tau)) - (1 - exp(-tau))),
                            exp(-tau) * tau * (RIPPLE + sheets[n] * ROUNDING) + ROUNDING,
                            "a constant grid's ripple, 0.2 % of the depth; round-off of each sheet"))
                printf("    %d sheets, tilt %d\n", sheets[n], tilts[t]);
        }
}

/* A box seen at every tilt: through its middle the path is the lesser of thickness / cos and width / sin. */
static void test_box_at_all_tilts(void) {
    for (int tilt = 0; tilt <= 90; tilt += 10) {
        const double angle = tilt * PI / 180, way[3] = {cos(angle), 0, -sin(angle)};
        const double path = fmin(cos(angle) > 1e-9 ? 1.5 / cos(angle) : 9, sin(angle) > 1e-9 ? 4.9 / sin(angle) : 9);
        const double tau = 0.8 * path;
        check_scene s;
        sps_volume *box;
        check_clear(&s, 3, 3);
        aim(&s, way, 0.1);
        box = check_add_volume(&s, 15, 13, 49, check_box(-0.75, -0.65, -2.45, 0.75, 0.65, 2.45));
        s.view.quality = SPS_QUALITY_ULTRA;
        box->read_fn = check_read_constant;
        box->user = &one;
        box->extinction = 0.8f;
        if (!check_render(context, &s, image_a)) return;
        if (!CHECK_CASE("Transport", "box tilted by 0 to 90 degrees", "coverage by the lesser of both paths",
                        fabs(farthest(image_a, 9, 3, 1 - exp(-tau)) - (1 - exp(-tau))), exp(-tau) * tau * RIPPLE + 1e-6,
                        "ripple"))
            printf("    tilt %d\n", tilt);
    }
}

/* ---------------------------------------------------------------------------------------------- scattering in slabs */

typedef struct slab_case {
    double tau, albedo, eye_tilt, light_angle, azimuth; /* degrees; light_angle: between the ways of eye and light */
    int sheets;
} slab_case;

static void slab_ways(const slab_case *c, double eye[3], double light[3]) {
    const double a = c->eye_tilt * PI / 180, b = (c->eye_tilt - c->light_angle) * PI / 180;
    const double turn = c->azimuth * PI / 180;
    check_set3(eye, sin(a), 0, -cos(a));
    check_set3(light, sin(b) * cos(turn), sin(b) * sin(turn), -cos(b));
}

/* The width in voxels of a slab of six layers that eye and light cross from face to face. Kernels reach 0.25 beyond
   every face and form a uniform slab from 0.25 inside the sides; the image and the light's texels need 0.11 more. */
static int wide_enough(const double eye[3], const double light[3]) {
    const double face = 0.3 + 0.25, lit_face = light[2] < 0 ? face : -face;
    double most = 0;
    for (int end = -1; end <= 1; end += 2)
        for (int i = 0; i < 2; ++i) {
            const double at = eye[i] / eye[2] * end * face, from = at + light[i] / light[2] * (lit_face - end * face);
            most = fmax(most, fmax(fabs(at), fabs(from)));
        }
    return (int)ceil((most + 0.25 + 0.11) / 0.05);
}

/* Renders the case and compares all pixels with the closed form. */
static void check_slab_case(const slab_case *c) {
    check_scene s;
    double eye[3], light[3], te, tl, unit, exact, tolerance;
    const int upright = c->eye_tilt <= 0 && (c->light_angle <= 0 || c->light_angle >= 180);
    sps_volume *slab;
    slab_ways(c, eye, light);
    check_clear(&s, 3, 3);
    aim(&s, eye, 0.17);
    slab = add_slab(&s, wide_enough(eye, light), 6, c->tau);
    check_color(slab->albedo, c->albedo, c->albedo, c->albedo);
    check_add_directional(&s, light[0], light[1], light[2], 3);
    s.view.slab_thickness = 6.0 / c->sheets;
    te = c->tau / fabs(eye[2]);
    tl = c->tau / fabs(light[2]);
    unit = c->albedo * 3 * ISOTROPIC;
    exact = unit * slab_radiance(te, tl, eye[2] * light[2] > 0);
    tolerance = unit * slab_slack(te, tl, eye[2] * light[2] > 0, RIPPLE + c->sheets * ROUNDING) + 1e-4 * exact;
    /* the texels' straight lines: a voxel is a sixth of tl; nothing bends where light and eye are upright */
    if (upright)
        s.view.shadow_resolution = 24;
    else
        tolerance += exact * tl / 6 / 1.6 / 128;
    if (!check_render(context, &s, image_a)) return;
    if (!CHECK_CASE("Transport", "slab lit from the front, from behind and at a slant, 1 to 4096 sheets",
                    "closed form of light that scatters once, relative",
                    fabs(farthest(image_a, 9, 1, exact) / exact - 1), tolerance / exact,
                    "ripple of the eye's and of the light's depth; straight lines between texels"))
        printf("    depth %g, %d sheets, eye at %g, light at %g, turned by %g\n", c->tau, c->sheets, c->eye_tilt,
               c->light_angle, c->azimuth);
}

/* Rays that graze the slab (within 30 degrees) leave it at its sides, where there is no closed form. The 1e-4 of the
   answer is for rays that end at a transmittance of 5e-5, and for round-off. */
static void test_slab_scattering_angles(void) {
    static const double eyes[2] = {10, 45};
    for (int e = 0; e < 2; ++e)
        for (int angle = 0; angle <= 180; angle += 20)
            for (int n = 0; n < 2; ++n) {
                static const int sheets[2] = {1, 7};
                const slab_case c = {1.7, 0.8, eyes[e], (double)angle, 0, sheets[n]};
                if (fabs(cos((eyes[e] - angle) * PI / 180)) > 0.6) check_slab_case(&c);
            }
}

static void test_slab_scattering_sheets(void) {
    static const int sheets[6] = {1, 2, 7, 64, 512, 4096};
    static const double depths[3] = {1e-3, 1, 9};
    for (int n = 0; n < 6; ++n)
        for (int d = 0; d < (sheets[n] > 64 ? 1 : 3); ++d)
            for (int back = 0; back < 2; ++back) {
                const slab_case upright = {sheets[n] > 64 ? 2 : depths[d], 1, 0, back ? 180.0 : 0.0, 0, sheets[n]};
                const slab_case oblique = {depths[d], 1, 20, back ? 160.0 : 50.0, 35, sheets[n]};
                check_slab_case(&upright);
                if (sheets[n] < 64 || (sheets[n] == 64 && d == 1 && back)) check_slab_case(&oblique);
            }
}

/* A front-lit slab of albedo 1 reflects half of the light (with equal depths of eye and light), for any number of
   sheets: sheets that scatter tau instead of 1 - exp(-tau) would reflect a multiple. If it is nearly solid, only the
   outermost tails of kernels matter, which are not a slab: there only the bound is checked. */
static void test_slab_energy(void) {
    static const int sheets[4] = {1, 3, 10, 100};
    for (int n = 0; n < 4; ++n) {
        const slab_case thick = {50, 1, 0, 0, 0, sheets[n]};
        check_scene s;
        const double way[3] = {0, 0, -1};
        check_slab_case(&thick);
        CHECK((double)image_a[0] * PI < 3); /* below a white surface */
        check_clear(&s, 7, 7);
        aim(&s, way, 0.17);
        check_color(add_slab(&s, 11, 6, 1e8)->albedo, 1, 1, 1);
        check_add_directional(&s, 0, 0, -1, 3);
        s.view.slab_thickness = 6.0 / sheets[n];
        if (!check_render(context, &s, image_a)) return;
        CHECK_CASE("Extremes", "optical depth 1e8, albedo 1", "coverage is 1", 1 - farthest(image_a, 49, 3, 1), 0,
                   "a float's 1 exactly");
        for (int i = 0; i < 49; ++i) {
            CHECK_CASE("Extremes", "optical depth 1e8, albedo 1, lit", "no more light than scatters once",
                       (double)image_a[4 * i], 3 * ISOTROPIC, "a bound: irradiance / 4 pi");
            CHECK(image_a[4 * i] > 0);
        }
    }
}

/* Optical depths of 1e-8 are not lost, although 1 - 1e-8 is 1 in a float. */
static void test_thin_sheets(void) {
    check_scene s;
    const double way[3] = {0, 0, -1}, tau = 2000 * 1e-8;
    check_clear(&s, 3, 3);
    aim(&s, way, 0.1);
    add_slab(&s, 13, 10, tau);
    s.view.slab_thickness = 10.0 / 2000;
    check_render(context, &s, image_a);
    CHECK_CASE("Extremes", "2000 sheets of optical depth 1e-8", "coverage 2e-5, relative",
               fabs(farthest(image_a, 9, 3, tau) / tau - 1), RIPPLE + 2000 * ROUNDING,
               "ripple; round-off of 2000 sheets");
}

/* Below dense gas no sun arrives on a ground, in however many chunks of slabs the gas is cut after the first sheets
   that let nothing pass. Light ends where 1e-7 of it is left. */
static void test_dark_below(void) {
    enum { PIXELS = 32 };
    const double corner[3] = {-3, -1.4, 3}, u[3] = {6, 0, 0}, v[3] = {0, 0, -6};
    for (int size = 100; size <= 800; size *= 2) {
        check_triangles ground;
        check_scene s;
        sps_volume *gas;
        memset(&ground, 0, sizeof ground);
        check_clear(&s, PIXELS, PIXELS);
        s.view.quality = SPS_QUALITY_MEDIUM, s.view.shadow_resolution = size;
        gas = check_add_volume(&s, 40, 40, 40, check_box(-1, -1, -1, 1, 1, 1));
        gas->read_fn = check_read_constant, gas->user = &one, gas->extinction = 60;
        check_add_directional(&s, 0.2, -1, -0.1, 1);
        check_add_quad(&ground, corner, u, v);
        check_add_mesh(&s, &ground, 1);
        /* between gas and ground, which is in the shadow there */
        check_set3(s.view.camera.position, 0.28, -1.2, -0.14);
        check_set3(s.view.camera.target, 0.28, -1.4, -0.14), check_set3(s.view.camera.up, 0, 0, 1);
        check_orthographic(&s.view.camera, 1);
        if (!check_render(context, &s, image_a)) return;
        CHECK(fabs(farthest(image_a, PIXELS * PIXELS, 0, 0)) <= 1e-6);
        check_free_triangles(&ground);
    }
}

/* ------------------------------------------------------------------------------------------------------------ blobs */

static double gaussian(const void *user, const double p[3]) {
    const double width = *(const double *)user;
    return exp(-(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) / (2 * width * width));
}

/* A blob of 5 voxels' width in a box of 4.5 widths each way; smoothing by the kernel makes it wider and lower. */
static void add_blob(check_scene *s, check_field *field, double *width, double extinction) {
    sps_volume *volume;
    *width = 0.5;
    volume = check_add_volume(s, 45, 45, 45, check_box(-2.25, -2.25, -2.25, 2.25, 2.25, 2.25));
    field->value_fn = gaussian;
    field->user = width;
    volume->eval_fn = check_eval_field;
    volume->user = field;
    volume->extinction = (float)extinction;
    s->view.quality = SPS_QUALITY_ULTRA;
}

/* Optical depth of the smoothed blob beyond distance z from its middle, on a ray that passes it at distance b. */
static double blob_depth(double extinction, double b, double z) {
    const double wide = sqrt(0.5 * 0.5 + 0.065 * 0.065), peak = extinction * pow(0.5 / wide, 3);
    return peak * exp(-b * b / (2 * wide * wide)) * wide * sqrt(PI / 2) * erfc(z / (wide * sqrt(2.0)));
}

/* No ripple in a smooth field; the effects of the cut (0.2 % of the mass is moved inwards) and of the section's
   polynomial (2e-4) are below RIPPLE. The near plane cuts the blob: erf. */
static void test_blob(void) {
    static const double cuts[4] = {-3, -0.4, 0, 0.3};
    for (int n = 0; n < 4; ++n)
        for (int coarse = 0; coarse < 2; ++coarse) {
            const double way[3] = {0.3, -0.2, -1};
            check_scene s;
            check_field field;
            double width;
            check_clear(&s, 19, 15);
            aim(&s, way, 1.5);
            add_blob(&s, &field, &width, 1.5);
            s.view.near_distance = 10 + cuts[n];
            s.view.slab_thickness = coarse ? 3 : 0.5;
            if (!check_render(context, &s, image_a)) return;
            for (int i = 0; i < 19 * 15; ++i) {
                const double x = (i % 19 - 9) * 0.1, y = (i / 19 - 7) * 0.1;
                const double tau = blob_depth(1.5, sqrt(x * x + y * y), cuts[n]);
                if (!CHECK_CASE("Transport", "Gaussian blob, cut by the near plane or not", "erf of the cut",
                                fabs((double)image_a[4 * i + 3] - (1 - exp(-tau))), 1.5 * RIPPLE * exp(-tau) + 1e-6,
                                "the kernel's cut moves 0.2 % of its mass"))
                    printf("    near plane at %g, pixel %d %d, slab %g\n", cuts[n], i % 19, i / 19,
                           s.view.slab_thickness);
            }
        }
}

/* Pixels of three voxels: footprints are widened to half a pixel, and keep their integral. What is gathered is in
   test_filling.c. */
static void test_pixel_filter(void) {
    const double way[3] = {0.3, -0.2, -1}, wide = 0.5 * 0.5 + 0.15 * 0.15;
    check_scene s;
    check_field field;
    double width;
    check_clear(&s, 9, 7);
    aim(&s, way, 2.1);
    s.view.filling = SPS_FILLING_SPLAT;
    add_blob(&s, &field, &width, 1.5);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 63; ++i) {
        const double x = (i % 9 - 4) * 0.3, y = (i / 9 - 3) * 0.3;
        const double tau = 1.5 * 0.125 * sqrt(2 * PI) / wide * exp(-(x * x + y * y) / (2 * wide));
        CHECK_NEAR((double)image_a[4 * i + 3], 1 - exp(-tau), 1.5 * RIPPLE * exp(-tau) + 1e-6);
    }
}

/* The share of a voxel that a ball of radius 1 around the origin fills, by 8^3 points. */
static double ball_share(const void *user, const double p[3]) {
    const double edge = *(const double *)user;
    int inside = 0;
    for (int i = 0; i < 512; ++i) {
        double square = 0;
        for (int c = 0; c < 3; ++c) {
            const double at = p[c] + ((i >> 3 * c & 7) - 3.5) / 8 * edge;
            square += at * at;
        }
        inside += square < 1;
    }
    return inside / 512.0;
}

/* A ball's chords, in perspective: 2 sqrt(1 - b^2) on a ray that passes the centre at distance b. Voxels and kernel
   smooth that by s^2 = edge^2 (1/12 + 0.65^2) along each axis, an error of s^2 / 2 of the chord's Laplacian, and at
   most 2e-4 of the fourth order up to b = 0.7. Points are accurate to half their spacing at either end in the worst
   case: 2 / 16 of a voxel. */
static void test_ball_chords(void) {
    const double edge = 1.0 / 12, square = edge * edge * (1.0 / 12 + 0.65 * 0.65), pitch = 2 * tan(0.17) / 15;
    int seen = 0;
    check_scene s;
    check_field field;
    sps_volume *ball;
    check_clear(&s, 15, 15);
    check_set3(s.view.camera.position, 0, 0, 5);
    check_perspective(&s.view.camera, 0.34);
    s.view.quality = SPS_QUALITY_ULTRA;
    ball = check_add_volume(&s, 26, 26, 26,
                            check_box(-13 * edge, -13 * edge, -13 * edge, 13 * edge, 13 * edge, 13 * edge));
    field.value_fn = ball_share;
    field.user = &edge;
    ball->eval_fn = check_eval_field;
    ball->user = &field;
    ball->extinction = 0.9f;
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 225; ++i) {
        const double x = (i % 15 - 7) * pitch, y = (i / 15 - 7) * pitch;
        const double b = 5 * sqrt((x * x + y * y) / (1 + x * x + y * y)), half = sqrt(1 - fmin(b * b, 1));
        const double chord = 2 * half - square * (1 / (half * half * half) + 1 / half), tau = 0.9 * chord;
        if (b > 0.7) continue;
        ++seen;
        if (!CHECK_CASE("Transport", "chords of a ball, in perspective", "coverage by 2 sqrt(1 - b^2)",
                        fabs((double)image_a[4 * i + 3] - -expm1(-tau)),
                        exp(-tau) * (tau * RIPPLE + 0.9 * (2 * edge / 16 + 2e-4)) + 1e-6,
                        "ripple; the ball's voxels hold shares by points, 1/16 of a voxel apart"))
            printf("    at distance %g\n", b);
    }
    CHECK(seen > 50);
}

/* Thin objects do not flicker: the total optical depth of all pixels, times a pixel's area, is that of the medium at
   any position between pixels. Footprints become Gaussians of half a pixel, whose sum over pixels one apart varies by
   2 exp(-2 pi^2 / 4) = 1.44 % in x and in y, and cutting them at 2.5 / 0.65 widths is compensated except for the step
   at the rim, 6e-4 of the peak on a lattice, less than 1e-3 of the total. */
static void test_thin_things_stay(void) {
    const double way[3] = {0.4, -0.3, -1}, depth = 0.02 * 0.02 * 0.02 * 50;
    for (int n = 0; n < 12; ++n) {
        double sum = 0, pitch;
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 15, 15);
        aim(&s, way, 1.5);
        pitch = s.view.camera.ortho_height / 15;
        /* one voxel, and a wire of twelve */
        volume = check_add_volume(&s, 1, 1, n & 1 ? 12 : 1, check_box(0, 0, 0, 0.02, 0.02, n & 1 ? 0.24 : 0.02));
        volume->placement.origin[0] = pitch * n / 12;
        volume->placement.origin[1] = pitch * (n * 5 % 12) / 12;
        volume->read_fn = check_read_constant;
        volume->user = &one;
        volume->extinction = 50;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 225; ++i) sum -= log1p(-(double)image_a[4 * i + 3]) * pitch * pitch;
        if (!CHECK_CASE("What users of other renderers complain of", "flicker of a voxel or a wire thinner than pixels",
                        "the sum over pixels stays as it moves, relative", fabs(sum / (n & 1 ? 12 : 1) / depth - 1),
                        2 * 0.0144 + 1e-3, "Gaussians of half a pixel add up to 1 within 1.44 % along x and y"))
            printf("    place %d\n", n);
    }
}

/* ------------------------------------------------------------------------------------------- several media, sources */

/* Two slabs, in either order; the light comes from the eye's side or from behind. */
static void test_two_slabs(void) {
    for (int way = 0; way < 4; ++way) {
        const double tau[2] = {0.6, 1.4}, albedo[2] = {0.9, 0.3}, eye[3] = {0, 0, -1};
        const int front = way & 1, back = !front, lit_from_front = way >> 1;
        const double unit = 2 * ISOTROPIC, behind = lit_from_front ? exp(-2 * tau[front]) : exp(-tau[front]);
        const double exact = unit * (albedo[front] * slab_radiance(tau[front], tau[front], lit_from_front) *
                                         (lit_from_front ? 1 : exp(-tau[back])) +
                                     behind * albedo[back] * slab_radiance(tau[back], tau[back], lit_from_front));
        check_scene s;
        check_clear(&s, 3, 3);
        aim(&s, eye, 0.2);
        for (int i = 0; i < 2; ++i) {
            const double z = i == front ? 1 : -1;
            sps_volume *slab = add_slab(&s, 21, 5, tau[i]);
            slab->placement.origin[2] += z;
            check_color(slab->albedo, albedo[i], albedo[i], albedo[i]);
        }
        check_add_directional(&s, 0, 0, lit_from_front ? -1 : 1, 2);
        if (!check_render(context, &s, image_a)) return;
        /* derivative of the answer by the logarithm of each depth: at most the depth (2.0 in all) times the answer */
        if (!CHECK_CASE("Transport", "two slabs in either order, lit from either side", "closed form, relative",
                        fabs(farthest(image_a, 9, 0, exact) / exact - 1), 2 * 2.0 * RIPPLE,
                        "ripple of a depth of 2, for eye and light"))
            printf("    case %d\n", way);
        CHECK_NEAR(farthest(image_a, 9, 3, 1 - exp(-2.0)), 1 - exp(-2.0), exp(-2.0) * 2 * RIPPLE);
    }
}

/* emission / extinction * (1 - exp(-tau)), down to extinction 0, where it is emission * length. */
static void test_emission(void) {
    static const double depths[5] = {0, 1e-6, 0.01, 1, 40};
    for (int n = 0; n < 5; ++n)
        for (int sheets = 1; sheets <= 64; sheets *= 8) {
            const double angle = 0.5, way[3] = {sin(angle), 0, -cos(angle)}, length = 0.6 / cos(angle);
            const double tau = depths[n] / cos(angle), exact = 3 * length * (tau > 0 ? -expm1(-tau) / tau : 1);
            check_scene s;
            sps_volume *slab;
            check_clear(&s, 5, 3);
            aim(&s, way, 0.23);
            slab = add_slab(&s, 29, 6, depths[n]);
            check_color(slab->emission, 3, 1, 0);
            s.view.slab_thickness = 6.0 / sheets;
            if (!check_render(context, &s, image_a)) return;
            if (!CHECK_CASE("Transport", "emission of a slab of depth 0 to 40, 1 to 64 sheets",
                            "emission / extinction (1 - exp(-depth)), or times length at 0, relative",
                            fabs(farthest(image_a, 15, 0, exact) / exact - 1), RIPPLE + sheets * ROUNDING + 5e-5,
                            "ripple; rays end at 5e-5; round-off") ||
                !CHECK_NEAR(farthest(image_a, 15, 1, exact / 3), exact / 3,
                            exact / 3 * (RIPPLE + 64 * ROUNDING + 5e-5)))
                printf("    depth %g, %d sheets\n", depths[n], sheets);
            CHECK(farthest(image_a, 15, 2, 0) == 0);
        }
}

static int sky(void *user, size_t count, const float *directions, float *rgb) {
    (void)user;
    for (size_t i = 0; i < 3 * count; ++i) rgb[i] = 2 + directions[i];
    return 0;
}

/* A background that depends on direction, seen through a slab in perspective: exp(-tau / cos) of it. */
static void test_background(void) {
    check_scene s;
    double pitch;
    check_clear(&s, 9, 7);
    add_slab(&s, 41, 4, 0.7);
    check_set3(s.view.camera.position, 0, 0, 2);
    check_perspective(&s.view.camera, 0.8);
    s.scene.background_fn = sky;
    pitch = 2 * tan(0.4) / 7;
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 63; ++i) {
        const double x = (i % 9 - 4) * pitch, y = (3 - i / 9) * pitch, length = sqrt(1 + x * x + y * y);
        const double through = exp(-0.7 * length), way[3] = {x / length, y / length, -1 / length};
        for (int c = 0; c < 3; ++c)
            CHECK_CASE("Transport", "background of a direction's color through a slab", "exp(-depth / cosine) of it",
                       fabs((double)image_a[4 * i + c] - through * (2 + way[c])),
                       through * (2 + way[c]) * 0.7 * length * RIPPLE + 1e-6, "ripple");
    }
}

/* Ambient light, unshadowed: albedo * ambient * coverage. */
static void test_ambient(void) {
    const double way[3] = {0.4, 0.1, -1}, tau = 1.1 * sqrt(1.17);
    check_scene s;
    sps_volume *slab;
    check_clear(&s, 5, 3);
    aim(&s, way, 0.2);
    slab = add_slab(&s, 25, 6, 1.1);
    check_color(slab->albedo, 1, 0.5, 0.25);
    check_color(s.scene.ambient, 0.7, 0.7, 2);
    if (!check_render(context, &s, image_a)) return;
    for (int c = 0; c < 3; ++c) {
        static const double sent[3] = {0.7, 0.35, 0.5};
        const double exact = sent[c] * (1 - exp(-tau));
        CHECK_NEAR(farthest(image_a, 15, c, exact), exact, exact * RIPPLE + ROUNDING);
    }
}

/* A point light in front of a thin slab: phase * intensity * integral of extinction / distance^2. The smooth faces of
   the slab change that by the second moment of the kernel, (0.065 / 2)^2 / 2 * 6 < 0.4 %; sampling it in the middle of
   a sheet of 0.025 has a much smaller error; the medium's own depth of 1e-3 dims by at most that. */
static void test_point_light(void) {
    check_scene s;
    sps_volume *slab;
    const double way[3] = {0, 0, -1};
    check_clear(&s, 9, 9);
    aim(&s, way, 0.9);
    slab = add_slab(&s, 21, 6, 1e-3);
    check_color(slab->albedo, 1, 1, 1);
    check_add_point(&s, 1.2, -0.9, 2.5, 7);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 81; ++i) {
        const double x = (i % 9 - 4) * 0.1 - 1.2, y = (4 - i / 9) * 0.1 + 0.9, b = sqrt(x * x + y * y);
        const double exact = 7 * ISOTROPIC * (1e-3 / 0.6) * (atan(2.8 / b) - atan(2.2 / b)) / b;
        CHECK_CASE("Transport", "point light before a thin slab", "integral of intensity / distance^2, relative",
                   fabs((double)image_a[4 * i] / exact - 1), RIPPLE + 0.004 + 1e-3,
                   "ripple; soft faces, 0.4 %; the slab's own depth");
    }
}

/* A light exactly at the centre of a voxel: refused with shadows, finite without. Along a ray at the distance q the
   integral of 1 / r^2 is at most pi / q, of which the slab's own half unit accounts for at least 2 atan(0.25 / q) / q;
   q is at least 0.28364 pixels (>>shading). Kernels reach 4.5 voxels to either side, so that of 1, 3 or 9 sheets one
   has its middle at the light. A single sheet spreads the slab over all of its 0.9, which leaves at most 0.5 / 0.9 of
   the minimum; 0.9 is for the slab's rim, 5 % lower within 1.6 kernel widths of its side, and the tilt. */
static void test_light_inside(void) {
    static const double slabs[3] = {9, 3, 1};
    for (int n = 0; n < 6; ++n) {
        check_scene s;
        sps_image image;
        const double way[3] = {n < 3 ? 0.2 : 0, 0, -1};
        sps_volume *slab;
        memset(&image, 0, sizeof image);
        image.rgba = image_a;
        check_clear(&s, 9, 9);
        aim(&s, way, 1);
        slab = add_slab(&s, 11, 5, 1);
        check_color(slab->albedo, 1, 1, 1);
        check_add_point(&s, 0, 0, 0, 1);
        check_force_sheets(&s);
        s.view.slab_thickness = slabs[n % 3];
        CHECK(sps_render(context, &s.scene, &s.view, &image) == SPS_ERROR_UNSUPPORTED);
        s.light[0].no_shadow = 1;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 81; ++i) {
            const double x = i % 9 - 4, y = i / 9 - 4, q = fmax(sqrt(x * x + y * y), 0.28364) / 9;
            const double most = ISOTROPIC * 2 * (1 + RIPPLE) * PI / q;
            const double least = ISOTROPIC * 2 * 2 * atan(0.25 / q) / q * exp(-1.0) * 0.9 * 0.5 / (n % 3 ? 0.5 : 0.9);
            if (!CHECK_CASE("Transport", "light exactly at the centre of a voxel", "within bounds of 1 / distance^2",
                            fmax((double)image_a[4 * i] / most, least / (double)image_a[4 * i]), 1,
                            "the larger of radiance / upper bound and lower bound / radiance"))
                printf("    slabs of %g voxels, pixel %d: %g, of %g to %g\n", slabs[n % 3], i, (double)image_a[4 * i],
                       least, most);
        }
    }
}

/* The same gas in more and smaller voxels, splatted or as the scene calls for, and in thicker and thinner slabs, at
   each quality: its optical depth stays, except for the ripple of that quality (test_ripple). Rays through the middle
   see no side: those of the largest voxels, 1/8 wide, are blurred by up to 2.5 of these, of a half width of 1. */
static void test_voxel_spacing(void) {
    static const int sides[3] = {16, 33, 64};
    static const double slabs[4] = {0, 0.3, 1, 5}, ripple[4] = {0.015, 0.004, RIPPLE, RIPPLE};
    for (int n = 0; n < 3 * 4 * 4 * 2; ++n) {
        const int quality = n / 2 % 4, side = sides[n / 32];
        const double way[3] = {0.2, 0.1, -1}, tau = 1.5 * sqrt(1.05), exact = 1 - exp(-tau);
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 5, 5);
        aim(&s, way, 0.4);
        volume = check_add_volume(&s, side, side, side, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = check_read_constant, volume->user = &one, volume->extinction = 0.75f;
        s.view.quality = (sps_quality)(SPS_QUALITY_DRAFT + quality);
        s.view.slab_thickness = slabs[n / 8 % 4];
        if (n % 2) s.view.filling = SPS_FILLING_SPLAT;
        if (!check_render(context, &s, image_a)) return;
        if (!CHECK_CASE("What users of other renderers complain of",
                        "opacity that changes with voxel spacing or step: 16^3 to 64^3 voxels, slabs of 0.3 to 5",
                        "coverage 1 - exp(-depth)", fabs(farthest(image_a, 25, 3, exact) - exact),
                        exp(-tau) * tau * ripple[quality] + 1e-6, "ripple of each quality"))
            printf("    %d voxels, quality %d, slab %g\n", side, quality, s.view.slab_thickness);
    }
}

/* --------------------------------------------------------------------------------------------------- a lively scene */

static double two_blobs(const void *user, const double p[3]) {
    const double a[3] = {p[0] + 0.25, p[1] - 0.1, p[2] + 0.15}, b[3] = {p[0] - 0.35, p[1] + 0.3, p[2] - 0.2};
    (void)user;
    return exp(-9 * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2])) +
           0.6 * exp(-16 * (b[0] * b[0] + b[1] * b[1] + b[2] * b[2]));
}

static check_field blobs_field;

/* 24^3 voxels over (-1,-1,-1)..(1,1,1): smooth, without symmetry. */
static sps_volume *add_blobs(check_scene *s, double extinction) {
    sps_volume *volume = check_add_volume(s, 24, 24, 24, check_box(-1, -1, -1, 1, 1, 1));
    blobs_field.value_fn = two_blobs;
    volume->eval_fn = check_eval_field;
    volume->user = &blobs_field;
    volume->extinction = (float)extinction;
    check_color(volume->albedo, 0.9, 0.9, 0.9);
    s->view.quality = SPS_QUALITY_HIGH;
    return volume;
}

/* Returns the blobs' values by index, as in the box of add_blobs, so that they stay in their voxels when the box moves
   or rotates. */
static void hold_blobs(check_scene *s) {
    static float values[24 * 24 * 24];
    static check_array array;
    check_field field = blobs_field;
    const int lo[3] = {0, 0, 0}, size[3] = {24, 24, 24};
    field.placement = check_box(-1, -1, -1, 1, 1, 1);
    memcpy(field.size, size, sizeof size);
    check_read_field(&field, lo, size, values);
    array.values = values;
    memcpy(array.size, size, sizeof size);
    s->volume[0].eval_fn = NULL;
    s->volume[0].read_fn = check_read_array;
    s->volume[0].user = &array;
}

/* Blobs in perspective, a sun from the side. */
static void lively(check_scene *s, int width, int height) {
    check_clear(s, width, height);
    add_blobs(s, 4);
    check_set3(s->view.camera.position, 0.5, 1, 4);
    check_perspective(&s->view.camera, 0.42);
    check_add_directional(s, 1, -0.8, -0.5, 3);
}

/* Separate pictures of each light add up to that of all: shadowing ones have sweeps of their own. */
static void test_lights_add(void) {
    static float sum[4 * 32 * 24];
    double most;
    check_scene s;
    memset(sum, 0, sizeof sum);
    lively(&s, 32, 24);
    check_color(check_add_point(&s, 2, 3, 1, 1)->color, 9, 1, 0);
    check_color(check_add_directional(&s, -1, 0.3, 1, 1)->color, 0, 1, 2);
    check_add_directional(&s, 0.1, -1, 0.2, 0.5)->no_shadow = 1;
    s.view.quality = SPS_QUALITY_DEFAULT;
    if (!check_render(context, &s, image_a)) return;
    most = largest_of(image_a, sizeof sum / sizeof *sum);
    for (int i = 0; i < 4; ++i) {
        s.scene.lights = &s.light[i];
        s.scene.light_count = 1;
        if (!check_render(context, &s, image_b)) return;
        for (size_t k = 0; k < sizeof sum / sizeof *sum; ++k) sum[k] = k % 4 == 3 ? image_b[k] : sum[k] + image_b[k];
    }
    /* The last light has no shadow, so by itself its sheets are perpendicular to the view: its error in slab thickness,
       including coverage, differs by second order; 1e-3 of the brightest pixel here, as test_convergence shows for
       slabs of a voxel. */
    CHECK_NEAR(check_largest(image_a, sum, sizeof sum / sizeof *sum), 0, 1e-3 * most);
    CHECK(most > 0.1);
}

/* Two volumes in one place equal one with the sum of their densities; colors mix by extinction. */
static void test_overlapping_volumes(void) {
    check_scene s;
    lively(&s, 32, 24);
    s.volume[0].extinction = 1.5f;
    add_blobs(&s, 2.5);
    if (!check_render(context, &s, image_a)) return;
    lively(&s, 32, 24);
    if (!check_render(context, &s, image_b)) return;
    CHECK_NEAR(check_largest(image_a, image_b, 4 * 32 * 24), 0, 1e-5); /* sums in another order, values up to 1 */
}

/* A grid of equal values has the same bits, read or evaluated. The evaluated one has its own context, whose memory has
   no other values: values that are not evaluated would be wrong. */
static void test_constant_is_procedural(void) {
    const slab_case c = {1.7, 0.8, 25, 40, 20, 7};
    check_hooks hooks;
    sps_context *other;
    check_scene s;
    double eye[3], light[3];
    slab_ways(&c, eye, light);
    check_clear(&s, 7, 5);
    aim(&s, eye, 1.9);
    check_color(add_slab(&s, 17, 6, c.tau)->albedo, 0.8, 0.5, 0.2);
    check_add_directional(&s, light[0], light[1], light[2], 3);
    if (!check_render(context, &s, image_a)) return;
    s.volume[0].read_fn = NULL;
    s.volume[0].eval_fn = check_eval_constant;
    memset(&hooks, 0, sizeof hooks);
    other = check_context(&hooks);
    if (check_render(other, &s, image_b))
        CHECK_CASE("Transport", "equal voxels, read or evaluated", "same bits",
                   memcmp(image_a, image_b, 4 * 35 * sizeof(float)) != 0, 0, "exact");
    CHECK(image_a[4 * 17] > 0.01f);
    sps_destroy(other);
}

/* -------------------------------------------------------------------------------------------------------- placement */

/* The slab 0 <= z <= 0.6 of the world, wide in x and y, by voxels of some other shape. Rays and light are along z but
   for a small tilt, so that the sides do not show. */
static void check_placed_slab(const char *name, const int size[3], const sps_placement *placement) {
    const double eye[3] = {0.1, 0.05, -1}, tau = 1.2 * sqrt(1.0125), exact = 3 * ISOTROPIC * slab_radiance(tau, 1.2, 1);
    check_scene s;
    sps_volume *slab;
    check_clear(&s, 5, 3);
    aim(&s, eye, 0.012);
    slab = check_add_volume(&s, size[0], size[1], size[2], *placement);
    slab->read_fn = check_read_constant;
    slab->user = &one;
    slab->extinction = 2;
    check_color(slab->albedo, 1, 1, 1);
    check_add_directional(&s, 0, 0, -1, 3);
    s.view.quality = SPS_QUALITY_ULTRA;
    s.view.slab_thickness = 0.25; /* that of ultra quality, however wide pixels are */
    s.view.shadow_resolution = 100;
    for (int splat = 0; splat < 2; ++splat) {
        s.view.filling = splat ? SPS_FILLING_SPLAT : SPS_FILLING_AUTO;
        if (!check_render(context, &s, image_a)) return;
        if (!CHECK_NEAR(farthest(image_a, 15, 0, exact), exact,
                        3 * ISOTROPIC * slab_slack(tau, 1.2, 1, RIPPLE) + 5e-4 * exact) ||
            !CHECK_CASE("Extremes", "voxels 50:50:1, 1:1:50, 1:50:1.67, sheared, mirrored", "coverage of the same slab",
                        fabs(farthest(image_a, 15, 3, 1 - exp(-tau)) - (1 - exp(-tau))),
                        exp(-tau) * tau * RIPPLE + ROUNDING, "ripple"))
            printf("    %s\n", name);
    }
}

static void test_placements(void) {
    sps_placement p = check_box(-1, -1, -0.3, 1, 1, 0.3);
    static const int cubes[3] = {20, 20, 6}, flat[3] = {5, 5, 75}, tall[3] = {150, 60, 3}, wide[3] = {150, 9, 9};
    check_placed_slab("cubic voxels", cubes, &p);
    check_placed_slab("voxels 50:50:1", flat, &p);
    p = check_box(-0.3, -0.12, -0.3, 0.3, 0.12, 0.3);
    check_placed_slab("voxels 1:1:50", tall, &p);
    p = check_box(-3, -9, -0.3, 3, 9, 0.3);
    check_placed_slab("voxels 1:50:1.67", wide, &p);
    p = check_box(-1, -1, -0.3, 1, 1, 0.3);
    p.axis[2][0] = 0.7; /* sheared: its faces are still z = -0.3 and 0.3 */
    p.axis[2][1] = -0.4;
    p.axis[0][1] = 0.9;
    p.origin[0] = -1.35;
    p.origin[1] = -1.25;
    check_placed_slab("sheared", cubes, &p);
    check_set3(p.axis[0], -1.2, 1.6, 0); /* turned about z, its box upside down and mirrored */
    check_set3(p.axis[1], 1.6, 1.2, 0);
    check_set3(p.axis[2], 0, 0, -0.6);
    check_set3(p.origin, -0.2, -1.4, 0.3);
    check_placed_slab("turned and mirrored", cubes, &p);
}

/* Rotating everything, including camera and lights, does not change the image except for round-off and for the
   positions of the light's texels, whose size is a quarter of a voxel: (1/4)^2 / 8 of the second difference of optical
   depth along the light, which is at most 4 * 1.2 * 2 * 9 per unit^2 or 0.6 per voxel^2, so 0.005 of a lit sample,
   0.002 of a pixel. */
static void test_turned_scene(void) {
    static const double turn[3][3] = {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}};
    check_scene s;
    double most;
    lively(&s, 24, 20);
    s.view.quality = SPS_QUALITY_ULTRA;
    if (!check_render(context, &s, image_a)) return;
    most = largest_of(image_a, 4 * 480);
    for (int pass = 0; pass < 6; ++pass) {
        double *vectors[6], old[3];
        sps_volume *v = &s.volume[0];
        vectors[0] = v->placement.origin, vectors[1] = v->placement.axis[0], vectors[2] = v->placement.axis[1];
        vectors[3] = v->placement.axis[2], vectors[4] = s.view.camera.position, vectors[5] = s.light[0].direction;
        memcpy(old, vectors[pass], sizeof old);
        for (int i = 0; i < 3; ++i) vectors[pass][i] = turn[i][0] * old[0] + turn[i][1] * old[1] + turn[i][2] * old[2];
    }
    check_set3(s.view.camera.up, turn[0][1], turn[1][1], turn[2][1]);
    hold_blobs(&s); /* eval_fn would see turned positions */
    if (!check_render(context, &s, image_b)) return;
    CHECK_NEAR(check_largest(image_a, image_b, 4 * 480), 0, 0.002 * most);
}

/* ---------------------------------------------------------------------------------------------------------- cameras */

/* Rays of a distant camera diverge by at most 1e-4 radians: points move by 1e-4 * 2 units, or 2.4e-3 voxels, and the
   image changes by that times its steepest change per voxel, a third of its maximum here. */
static void test_orthographic_limit(void) {
    check_scene s;
    double most;
    lively(&s, 24, 24);
    check_set3(s.view.camera.position, 0, 0, 1e4);
    check_perspective(&s.view.camera, 2 * atan(1e-4));
    if (!check_render(context, &s, image_a)) return;
    check_set3(s.view.camera.position, 0, 0, 20);
    check_orthographic(&s.view.camera, 2);
    if (!check_render(context, &s, image_b)) return;
    most = largest_of(image_b, 4 * 576);
    CHECK_CASE("Extremes", "perspective of 1e-4 radians, a distant eye", "the orthographic picture, of the brightest",
               check_largest(image_a, image_b, 4 * 576) / most, 2.4e-3 / 3 + 1e-5 / most,
               "rays move by 2.4e-3 voxels, a third of the maximum changes per voxel");
}

/* Rows of a view matrix (right, up, back) and its translation. */
static void view_rows(const sps_view *view, double rows[3][4]) {
    double length = 0;
    for (int i = 0; i < 3; ++i) rows[2][i] = view->camera.position[i] - view->camera.target[i];
    vec_normalise(rows[2]);
    vec_cross(view->camera.up, rows[2], rows[0]);
    length = vec_length(rows[0]);
    for (int i = 0; i < 3; ++i) rows[0][i] /= length;
    vec_cross(rows[2], rows[0], rows[1]);
    for (int k = 0; k < 3; ++k) rows[k][3] = -vec_dot(rows[k], view->camera.position);
}

/* Clip matrices as engines make them: 0 GL perspective, 1 D3D reversed and infinite, 2 GL orthographic,
   3 D3D orthographic, 4 as 0 but scaled as a whole, which changes nothing. */
static void engine_matrix(const sps_view *view, int style, double m[16]) {
    double rows[3][4];
    const double aspect = (double)view->width / view->height, f = 1 / tan(0.5 * view->camera.field_of_view);
    const double high = 1, low = 0.1, far = 50; /* orthographic: 2 / 2, its image's height */
    const int flat = style == 2 || style == 3;
    view_rows(view, rows);
    for (int i = 0; i < 4; ++i) {
        const double last = i == 3 ? 1 : 0;
        m[i] = rows[0][i] * (flat ? high : f) / aspect;
        m[4 + i] = rows[1][i] * (flat ? high : f);
        m[8 + i] =
            style == 0 || style == 4 ? (rows[2][i] * (far + low) + 2 * far * low * last) / (low - far) : low * last;
        if (style == 2) m[8 + i] = (2 * rows[2][i] + (far + low) * last) / (low - far);
        if (style == 3) m[8 + i] = (rows[2][i] + low * last) / (low - far);
        m[12 + i] = flat ? last : -rows[2][i];
    }
    for (int i = 0; i < 16 && style == 4; ++i) m[i] *= 0.37;
}

/* A view along no axis, for matrices to match. */
static void lively_aslant(check_scene *s) {
    lively(s, 25, 16);
    check_set3(s->view.camera.up, 0.2, 1, 0.1);
    check_set3(s->view.camera.target, 0.1, 0, -0.1);
}

/* Both kinds of camera have the same rays in double precision; images differ by float round-off. */
static void test_engine_matrices(void) {
    for (int style = 0; style < 5; ++style) {
        check_scene s;
        double matrix[16];
        lively_aslant(&s);
        engine_matrix(&s.view, style, matrix);
        if (style == 2 || style == 3) check_orthographic(&s.view.camera, 2);
        const sps_camera plain = s.view.camera;
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        check_matrix(&s.view.camera, matrix);
        if (!check_render_depth(context, &s, image_b, depth_b)) return;
        if (!CHECK_NEAR(check_largest(image_a, image_b, 4 * 400), 0, 2e-5)) printf("    style %d\n", style);
        CHECK(largest_of(image_a, 4 * 400) > 0.1);
        const double start = style == 2 ? 0.1 : style == 3 ? 0.1 - (50 - 0.1) : 0; /* from the eye to clip depth -1 */
        for (int i = 0; i < 400; ++i)
            if (image_a[4 * i + 3] > 0.01f && !CHECK_NEAR((double)depth_a[i], (double)depth_b[i] + start, 1e-3))
                printf("    style %d, pixel %d\n", style, i);
        s.view.near_distance = vec_length(s.view.camera.position) - start; /* through the middle of the volume */
        if (!check_render(context, &s, image_b)) return;
        s.view.camera = plain;
        s.view.near_distance += start;
        if (!check_render(context, &s, image_c)) return;
        if (!CHECK_NEAR(check_largest(image_b, image_c, 4 * 400), 0, 2e-5)) printf("    style %d, cut\n", style);
        CHECK(check_largest(image_a, image_b, 4 * 400) > 0.01);
    }
}

/* An orthographic matrix whose depth decreases away from the viewer sees the same rays from their other ends. */
static void test_reversed_orthographic_matrix(void) {
    check_scene s;
    double matrix[16];
    lively_aslant(&s);
    engine_matrix(&s.view, 2, matrix);
    check_orthographic(&s.view.camera, 2);
    for (int k = 0; k < 3; ++k) s.view.camera.position[k] = 2 * s.view.camera.target[k] - s.view.camera.position[k];
    if (!check_render(context, &s, image_a)) return;
    for (int i = 8; i < 12; ++i) matrix[i] *= -1;
    check_matrix(&s.view.camera, matrix);
    if (!check_render(context, &s, image_b)) return;
    for (int i = 0; i < 400; ++i) {
        const int mirrored = i + 24 - 2 * (i % 25);
        if (!CHECK_NEAR(check_largest(image_a + 4 * mirrored, image_b + 4 * i, 4), 0, 2e-5))
            printf("    pixel %d\n", i);
    }
}

/* --------------------------------------------------------------------------------------------------- phase function */

static double phase_exact(const sps_lobe *lobes, int count, double cosine) {
    double sum = 0, weights = 0;
    for (int i = 0; i < count; ++i) {
        const double g = (double)lobes[i].asymmetry, w = (double)lobes[i].weight;
        sum += w * (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * cosine, 1.5));
        weights += w;
    }
    return sum / weights;
}

/* The implementation's own function, integrated over the sphere by 20000 midpoints in the angle, 60 of them in the peak
   of the sharpest lobe (width 0.01): accurate to 1e-5. Floats round 1 + g^2 - 2 g c, which is at least (1 - g)^2, by
   2e-7. */
static void test_phase_integral(void) {
    static const float asymmetries[6] = {0, 0.3f, -0.6f, 0.9f, -0.95f, 0.99f};
    for (int k = 0; k < 6; ++k) {
        const double gap = 1 - fabs((double)asymmetries[k]), rounding = 1e-6 + 1.5 * 2e-7 / (gap * gap);
        spsi_material material;
        double sum = 0;
        memset(&material, 0, sizeof material);
        material.lobe_count = 2;
        material.lobes[0].asymmetry = asymmetries[k];
        material.lobes[0].weight = 0.75f;
        material.lobes[1].asymmetry = 0.2f;
        material.lobes[1].weight = 0.25f;
        for (int i = 0; i < 20000; ++i) {
            const double angle = (i + 0.5) * PI / 20000;
            const float cosine = (float)cos(angle);
            float lanes[SPSI_LANES];
            spsi_store(lanes, spsi_phase(&material, spsi_set(cosine)));
            sum += (double)lanes[0] * 2 * PI * sin(angle) * PI / 20000;
            if (i % 500 == 0) {
                const double exact = phase_exact(material.lobes, 2, (double)cosine);
                CHECK_NEAR((double)lanes[0], exact, rounding * exact);
            }
        }
        CHECK_CASE("Transport", "phase functions of asymmetry -0.95 to 0.99", "integral over the sphere is 1",
                   fabs(sum - 1), 1e-5 + rounding, "midpoints; floats round 1 - g, worst at 0.99");
    }
}

/* The radiance of a thin slab at an angle is the phase function there (light that travels along the eye's rays comes
   back, cosine -1): eye and light are rotated, the slab is perpendicular to neither; 10 voxels with a total optical
   depth of 1e-4. */
static void test_phase_rendered(void) {
    static const sps_lobe lobes[2] = {{0.7f, 3}, {-0.4f, 1}};
    for (int angle = 0; angle <= 180; angle += 12) {
        const slab_case c = {1e-4, 1, 20, (double)angle, 0, 6};
        double eye[3], light[3], exact;
        check_scene s;
        sps_volume *slab;
        slab_ways(&c, eye, light);
        check_clear(&s, 3, 3);
        aim(&s, eye, 0.1);
        slab = add_slab(&s, 31, 6, c.tau);
        check_color(slab->albedo, 1, 1, 1);
        slab->lobes = lobes;
        s.view.shadow_resolution = 40;
        slab->lobe_count = 2;
        check_add_directional(&s, light[0], light[1], light[2], 2);
        exact = 2 * phase_exact(lobes, 2, -cos(angle * PI / 180)) * c.tau / -eye[2];
        if (!check_render(context, &s, image_a)) return;
        /* light that grazes the slab is dimmed by 1e-4 / cos, and the box limits that to 1e-3 */
        if (!CHECK_NEAR(farthest(image_a, 9, 0, exact), exact, exact * (RIPPLE + 1e-3)))
            printf("    angle %d\n", angle);
    }
}

/* Eye and light change places: radiance times the eye's cosine stays. */
static void test_reciprocity(void) {
    static const sps_lobe lobe[1] = {{0.6f, 1}};
    double seen[2] = {0, 0};
    for (int swapped = 0; swapped < 2; ++swapped) {
        const double ways[2][3] = {{sin(0.7), 0, -cos(0.7)}, {-sin(0.2), 0, -cos(0.2)}};
        check_scene s;
        sps_volume *slab;
        check_clear(&s, 3, 3);
        aim(&s, ways[swapped], 0.1);
        slab = add_slab(&s, 37, 6, 1.5);
        check_color(slab->albedo, 1, 1, 1);
        slab->lobes = lobe;
        slab->lobe_count = 1;
        check_add_directional(&s, ways[!swapped][0], 0, ways[!swapped][2], 1);
        if (!check_render(context, &s, image_a)) return;
        seen[swapped] = (double)image_a[16] * -ways[swapped][2] / -ways[!swapped][2] * -ways[!swapped][2];
    }
    CHECK_CASE("Transport", "eye and light change places", "radiance times the eye's cosine stays, relative",
               fabs(seen[1] / seen[0] - 1), 2 * RIPPLE, "each has a ripple of its own");
}

/* ----------------------------------------------------------------------------------------------- both orders, error */

/* Where view and light are perpendicular, slabs turn by a right angle from one compositing order to the other. The jump
   is due to the method's own error, so it is below the sum of both errors; and it shrinks with them. */
static void test_orders_agree(void) {
    double jump[2];
    for (int fine = 0; fine < 2; ++fine) {
        check_scene s;
        lively(&s, 16, 16);
        check_set3(s.view.camera.position, 0, 0, 10);
        check_orthographic(&s.view.camera, 2);
        s.view.slab_thickness = fine ? 2 : 4;
        s.view.shadow_resolution = 128;
        check_set3(s.light[0].direction, 0.8, -0.6, 1e-7);
        if (!check_render(context, &s, image_a)) return;
        s.light[0].direction[2] = -1e-7;
        if (!check_render(context, &s, image_b)) return;
        jump[fine] = check_rms(image_a, image_b, 4 * 256);
        if (fine) break;
        if (!check_march(context, &s, 0.5, image_c, NULL)) return;
        CHECK(jump[0] <= check_rms(image_a, image_c, 4 * 256) + check_rms(image_b, image_c, 4 * 256));
        CHECK(jump[0] > 0); /* else the orders were not both tried */
    }
    printf("orders at l.v = 0: jump %.2e at slabs of 4 voxels, %.2e at 2\n", jump[0], jump[1]);
    CHECK(jump[1] < 0.5 * jump[0]);
}

/* Errors apart from slab thickness: the cut removes 0.0045 of the kernel's variance of 0.42 square voxels, which on
   blobs 2.1 to 2.8 voxels wide is 0.0019 / width^2, at most 4e-4 of the optical depth; radiance changes by 0.7 of that.
   The sections' polynomial (2e-4, of both signs) averages out over the voxels of a ray. */
#define KERNEL_FLOOR 3e-4

/* The order p for which (coarse^p - finest^p) / (fine^p - finest^p) is `ratio`: errors against the finest slabs if true
   errors are proportional to thickness^p. */
static double order_of(double ratio, double coarse, double fine, double finest) {
    double low = 0, high = 8;
    for (int i = 0; i < 40; ++i) {
        const double p = 0.5 * (low + high), end = pow(finest, p);
        if ((pow(coarse, p) - end) / (pow(fine, p) - end) < ratio)
            low = p;
        else
            high = p;
    }
    return low;
}

/* Renders at slabs of 2, 1, 0.5, 0.25 voxels; errors against image_c, and against slabs of 0.125, which has no floor.
 */
static void check_orders(const char *name, check_scene *s, int pixels, double least_order) {
    static float finest[4 * 400];
    double most = largest_of(image_c, (size_t)(4 * pixels)), error[4], self[4], order[3];
    s->view.slab_thickness = 0.125;
    if (!check_render(context, s, finest)) return;
    for (int i = 0; i < 4; ++i) {
        s->view.slab_thickness = 2.0 / (1 << i);
        if (!check_render(context, s, image_a)) return;
        error[i] = check_rms(image_a, image_c, (size_t)(4 * pixels)) / most;
        self[i] = check_rms(image_a, finest, (size_t)(4 * pixels)) / most;
    }
    printf("%s: error %.2e %.2e %.2e %.2e against the reference;", name, error[0], error[1], error[2], error[3]);
    printf(" by itself %.2e %.2e %.2e %.2e, order", self[0], self[1], self[2], self[3]);
    for (int i = 0; i < 3; ++i) {
        order[i] = order_of(self[i] / self[i + 1], 2.0 / (1 << i), 1.0 / (1 << i), 0.125);
        printf(" %.2f", order[i]);
    }
    printf("\n");
    for (int i = 0; i < 4; ++i) CHECK(error[i] <= self[i] + KERNEL_FLOOR);
    for (int i = 0; i < 3; ++i) {
        CHECK_CASE("Engineering", "slabs of 2 to 0.25 voxels", "the error falls with the square of their thickness",
                   2 - order[i], 2 - least_order, "2 less the order; second order shows once slabs are thin");
        CHECK(error[i + 1] < 2 * KERNEL_FLOOR || log2(error[i] / error[i + 1]) >= least_order);
    }
}

/* The part of the image where the blobs are. */
enum { MIDDLE = 12 * 11 };
static void middle(check_scene *s) {
    s->view.region[0] = 4;
    s->view.region[1] = 3;
    s->view.region[2] = 12;
    s->view.region[3] = 11;
}

/* A smooth field, three texels per voxel. The reference's step of half a voxel is right to 1e-5: the midpoint rule on
   Gaussians more than 2 voxels wide has an error of exp(-2 (pi 2 / 0.5)^2), and a step of 0.15 has the same figures. */
static void test_convergence(void) {
    for (int back = 0; back < 2; ++back) {
        check_scene s;
        lively(&s, 20, 17);
        s.view.quality = SPS_QUALITY_ULTRA;
        if (back) check_set3(s.light[0].direction, 1, -0.4, 0.9);
        s.view.shadow_resolution = 120;
        middle(&s);
        if (!check_march(context, &s, 0.5, image_c, NULL)) return;
        check_orders(back ? "gas lit from behind" : "gas lit from the front", &s, MIDDLE, 1.8);
    }
}

static int soft_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const double v = (double)values[i];
        out[i].extinction = (float)(10 * v * v);
        check_color(out[i].albedo, 0.5 + 0.3 * sin(4 * v), 0.6, 0.9 - 0.4 * v);
    }
    return 0;
}

static void classified(check_scene *s, sps_transfer *transfer, sps_shading shading) {
    memset(transfer, 0, sizeof *transfer);
    transfer->eval_fn = soft_transfer;
    transfer->value_max = 1.5f;
    lively(s, 20, 17);
    middle(s);
    s->view.quality = SPS_QUALITY_ULTRA;
    s->volume[0].transfer = transfer;
    s->volume[0].shading = shading;
    s->volume[0].gradient_full =
        0.4f; /* twice the steepest change, 0.6 / 2.8 a voxel: the share of surface has no kink */
    s->view.shadow_resolution = 120;
}

/* As a gas: the mean value of a sheet is classified; second order for a smooth transfer function. */
static void test_transfer_gas(void) {
    check_scene s;
    sps_transfer transfer;
    classified(&s, &transfer, SPS_SHADING_GAS);
    if (!check_march(context, &s, 0.5, image_c, NULL)) return;
    check_orders("classified, as a gas", &s, MIDDLE, 1.8);
}

/* As a surface, splatted: slopes are differences over two pixels and two sheets. Over a quarter of a voxel to each side
   their error is (1/4)^2 / 6 * 3 / 2.1^2 = 0.7 % of the slope; half of the brightest light follows the slope, the mean
   pixel has a third of that. So pixels are a fifth as wide, and the reference's rays are the middle ones of every five
   by five. */
static void test_transfer_surface(void) {
    static float fine[4 * 25 * MIDDLE];
    check_scene s;
    sps_transfer transfer;
    double most, error;
    classified(&s, &transfer, SPS_SHADING_SURFACE);
    s.view.filling = SPS_FILLING_SPLAT;
    if (!check_march(context, &s, 0.5, image_c, NULL)) return;
    most = largest_of(image_c, 4 * MIDDLE);
    s.view.width *= 5;
    s.view.height *= 5;
    for (int i = 0; i < 4; ++i) s.view.region[i] *= 5;
    if (!check_render(context, &s, fine)) return;
    for (int i = 0; i < MIDDLE; ++i)
        memcpy(image_a + 4 * i, fine + 4 * ((5 * (i / 12) + 2) * 60 + 5 * (i % 12) + 2), 4 * sizeof(float));
    error = check_rms(image_a, image_c, 4 * MIDDLE) / most;
    printf("classified, as a surface: error %.2e\n", error);
    CHECK_NEAR(error, 0, KERNEL_FLOOR + 0.007 / 6);
    classified(&s, &transfer, SPS_SHADING_GAS); /* and it differs from a gas */
    if (!check_march(context, &s, 1, fine, NULL)) return;
    CHECK(check_rms(fine, image_c, 4 * MIDDLE) / most > 10 * (KERNEL_FLOOR + 0.007 / 6));
}

/* -------------------------------------------------------------------------------------- against the reference alone */

/* A camera inside the gas, without and with a near plane. */
static void test_camera_inside(void) {
    check_scene s;
    lively(&s, 16, 12);
    check_set3(s.view.camera.position, -0.2, 0.05, 0.3);
    check_set3(s.view.camera.target, 0.3, -0.3, -0.6);
    check_set3(s.light[0].direction, 0.3, -1, -0.8);
    check_perspective(&s.view.camera, 0.9);
    s.view.shadow_resolution = 100;
    if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.5, image_c, NULL)) return;
    printf("camera inside: error %.2e", check_rms(image_a, image_c, 4 * 192) / largest_of(image_c, 4 * 192));
    CHECK_CASE("What users of other renderers complain of", "camera inside the gas",
               "brute force, rms of the brightest", check_rms(image_a, image_c, 4 * 192) / largest_of(image_c, 4 * 192),
               2 * KERNEL_FLOOR, "the kernel's cut, 3e-4 of the brightest; slabs, as much");
    s.view.near_distance = 0.35; /* and with a near plane amid the gas */
    if (!check_render(context, &s, image_b) || !check_march(context, &s, 0.5, image_c, NULL)) return;
    printf(", behind a near plane %.2e\n", check_rms(image_b, image_c, 4 * 192) / largest_of(image_c, 4 * 192));
    CHECK_NEAR(check_rms(image_b, image_c, 4 * 192) / largest_of(image_c, 4 * 192), 0, 2 * KERNEL_FLOOR);
    CHECK(check_rms(image_a, image_b, 4 * 192) > 0.02);
}

/* Random voxels in odd numbers: anything flipped, swapped or off by half a voxel shows. Sharp features need thin slabs;
   errors are those of the cut kernel, which on single voxels are as large as a constant grid's ripple. */
static void test_alignment(void) {
    static float values[7 * 9 * 5];
    check_random random = {12345};
    check_array array;
    check_scene s;
    double most, aligned;
    memset(&array, 0, sizeof array);
    for (int i = 0; i < 7 * 9 * 5; ++i) values[i] = (float)pow(check_next(&random), 4);
    array.values = values;
    array.size[0] = 7, array.size[1] = 9, array.size[2] = 5;
    check_clear(&s, 21, 15);
    {
        sps_volume *volume = check_add_volume(&s, 7, 9, 5, check_box(-0.6, -0.8, -0.5, 0.8, 1, 0.6));
        volume->read_fn = check_read_array;
        volume->user = &array;
        volume->extinction = 3;
        check_color(volume->albedo, 0.9, 0.7, 0.5);
    }
    check_set3(s.view.camera.position, 1.5, 1, 4);
    check_perspective(&s.view.camera, 0.6);
    s.view.quality = SPS_QUALITY_ULTRA;
    check_add_directional(&s, 0.7, -1, -0.4, 3);
    if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.1, image_c, NULL)) return;
    most = largest_of(image_c, 4 * 315);
    aligned = check_rms(image_a, image_c, 4 * 315) / most;
    printf("alignment: error %.2e\n", aligned);
    CHECK_NEAR(aligned, 0, RIPPLE);
    for (int axis = 0; axis < 3; ++axis) { /* and this test would see it */
        s.volume[0].placement.origin[axis] += 0.1;
        if (!check_render(context, &s, image_b)) return;
        CHECK(check_rms(image_b, image_c, 4 * 315) / most > 8 * aligned);
        s.volume[0].placement.origin[axis] -= 0.1;
    }
}

/* ------------------------------------------------------------------------------------------------------------ depth */

/* Mean distance of a uniform slab: near face + 1 / extinction - length exp(-tau) / (1 - exp(-tau)). The kernel blurs
   both faces (second moment 0.065^2 / 2 times extinction), and a sheet's middle is used for its mean (thickness^2 / 12
   times extinction). */
static void test_depth(void) {
    for (int tilt = 0; tilt < 2; ++tilt) {
        const double angle = 0.6 * tilt, way[3] = {sin(angle), 0, -cos(angle)}, sigma = 2.5, length = 0.6 / cos(angle);
        const double tau = sigma * length, exact = 10 - length / 2 + 1 / sigma - length * exp(-tau) / (1 - exp(-tau));
        check_scene s;
        check_clear(&s, 3, 3);
        aim(&s, way, 1e-4);
        add_slab(&s, 35, 6, sigma * 0.6);
        s.view.slab_thickness = 0.5;
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        for (int i = 0; i < 9; ++i)
            CHECK_NEAR((double)depth_a[i], exact,
                       sigma * (0.065 * 0.065 / cos(angle) / cos(angle) + 0.05 * 0.05 / 12) + RIPPLE * length);
    }
    { /* nothing seen: infinitely far */
        check_scene s;
        check_clear(&s, 2, 2);
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        for (int i = 0; i < 4; ++i) CHECK((double)depth_a[i] > 1e300 && image_a[4 * i + 3] <= 0);
    }
}

/* ------------------------------------------------------------------------------------------------------- invariance */

/* Lengths multiplied by k, extinction and emission divided by it, intensity multiplied by its square: no pixel changes
   except for round-off, which is 1e-7 of a coordinate of some 100 sheets or pixels, and at steep places at most 1e-5 of
   the image. */
static void test_scaled_and_moved(void) {
    static const double scales[3] = {1e3, 1e-3, 1}, moves[3] = {0, 0, 1e6};
    for (int n = 0; n < 3; ++n) {
        check_scene s;
        lively(&s, 20, 16);
        check_color(s.volume[0].emission, 0.3, 0.2, 0.1);
        check_add_point(&s, 1, 3, 1.5, 4);
        s.view.quality = SPS_QUALITY_HIGH;
        hold_blobs(&s);
        if (n == 0 && !check_render(context, &s, image_a)) return;
        for (int i = 0; i < 3; ++i) {
            double *points[4];
            points[0] = &s.volume[0].placement.origin[i], points[1] = &s.view.camera.position[i];
            points[2] = &s.view.camera.target[i], points[3] = &s.light[1].position[i];
            for (int k = 0; k < 4; ++k) *points[k] = *points[k] * scales[n] + moves[n] * (i + 1);
            for (int k = 0; k < 3; ++k) s.volume[0].placement.axis[k][i] *= scales[n];
            s.volume[0].emission[i] /= (float)scales[n];
            s.light[1].color[i] *= (float)(scales[n] * scales[n]);
        }
        s.volume[0].extinction /= (float)scales[n];
        if (!check_render(context, &s, image_b)) return;
        if (!CHECK_CASE("Extremes", "scene scaled by 1e3 and 1e-3, and moved by 1e6",
                        "the same picture, of the brightest",
                        check_largest(image_a, image_b, 4 * 320) / largest_of(image_a, 4 * 320), 1e-4,
                        "floats round coordinates of some 100 sheets or pixels by 1e-7"))
            printf("    scale %g, moved by %g\n", scales[n], moves[n]);
    }
}

static double mirrored_blobs(const void *user, const double p[3]) {
    const double q[3] = {-p[0], p[1], p[2]};
    return two_blobs(user, q);
}

/* x to -x in the scene, x to width - 1 - x in the image. */
static void test_mirrored(void) {
    check_scene s;
    lively(&s, 20, 16);
    if (!check_render(context, &s, image_a)) return;
    blobs_field.value_fn = mirrored_blobs;
    s.view.camera.position[0] *= -1;
    s.light[0].direction[0] *= -1;
    if (!check_render(context, &s, image_b)) return;
    for (int i = 0; i < 320; ++i) memcpy(image_c + 4 * i, image_b + 4 * (i / 20 * 20 + 19 - i % 20), 4 * sizeof(float));
    CHECK_CASE("Engineering", "mirrored scene", "the mirrored picture, of the brightest",
               check_largest(image_a, image_c, 4 * 320) / largest_of(image_a, 4 * 320), 1e-4,
               "floats round coordinates by 1e-7");
}

/* Without scattering there is exactly no radiance: a gas without albedo, and one with none in red and blue, for which
   the scattering passes do run. */
static void test_albedo_zero_is_black(void) {
    for (int green = 0; green < 2; ++green) {
        check_scene s;
        double most = 0;
        lively(&s, 20, 16);
        check_color(s.volume[0].albedo, 0, 0.5 * green, 0);
        check_color(s.scene.ambient, 1, 1, 1);
        check_add_directional(&s, 0.2, -1, 0, 2)->no_shadow = 1;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 320; ++i) {
            CHECK_CASE("Scattering", "albedo 0 in one channel or all, once", "no radiance at all",
                       fmax((double)image_a[4 * i], (double)image_a[4 * i + 2]), 0, "exact");
            most = fmax(most, (double)image_a[4 * i + 1]);
        }
        CHECK(green ? most > 0.1 : most <= 0);
        CHECK(largest_of(image_a, 4 * 320) > 0.5); /* its alpha */
    }
}

/* More of an absorber: no pixel gets brighter in any light, and alpha never decreases. */
static void test_absorber_never_brightens(void) {
    check_random random = {99};
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        sps_volume *black;
        lively(&s, 20, 16);
        check_set3(s.light[0].direction, check_next(&random) - 0.5, check_next(&random) - 0.5,
                   check_next(&random) - 0.5);
        check_color(s.scene.ambient, 0.1, 0.2, 0.3);
        check_color(s.scene.background, 0.3, 0.2, 0.1);
        black = add_blobs(&s, 1e-3);
        check_color(black->albedo, 0, 0, 0);
        s.view.quality = SPS_QUALITY_HIGH;
        if (!check_render(context, &s, image_a)) return;
        black->extinction = (float)(5 * check_next(&random));
        if (!check_render(context, &s, image_b)) return;
        for (int i = 0; i < 4 * 320; ++i)
            CHECK_CASE("Engineering", "more of an absorber", "no pixel is brighter or covers less",
                       (double)(image_b[i] - image_a[i]) * (i % 4 == 3 ? -1 : 1), 2e-6, "a few roundings of floats");
    }
}

/* --------------------------------------------------------------------------------------------------- long voxels */

enum { BLOBS = 3 };

/* Gaussian blobs that are sampled by voxels of 0.1, ten times as long along one axis. The kernels widen each to a
   variance of (0.65 edges)^2 more: samples of deviations of 1.2 edges or more show nothing else, to exp(-37). */
typedef struct blobs {
    double at[BLOBS][3], deviation[3], edge[3];
} blobs;

static double blobs_value(const void *user, const double p[3]) {
    const blobs *b = (const blobs *)user;
    double sum = 0;
    for (int n = 0; n < BLOBS; ++n) {
        double square = 0;
        for (int k = 0; k < 3; ++k) square += pow((p[k] - b->at[n][k]) / b->deviation[k], 2);
        sum += exp(-square / 2);
    }
    return sum;
}

/* The integral of the widened blobs along p + t way, t from 0 on. */
static double blobs_ahead(const blobs *b, const double p[3], const double way[3]) {
    double sum = 0;
    for (int n = 0; n < BLOBS; ++n) {
        double uu = 0, uw = 0, ww = 0, height = 1;
        for (int k = 0; k < 3; ++k) {
            const double wide = sqrt(pow(b->deviation[k], 2) + pow(0.65 * b->edge[k], 2));
            const double u = (p[k] - b->at[n][k]) / wide, w = way[k] / wide;
            height *= b->deviation[k] / wide;
            uu += u * u, uw += u * w, ww += w * w;
        }
        sum += height * exp((uw * uw / ww - uu) / 2) * sqrt(PI / 2 / ww) * erfc(uw / sqrt(2 * ww));
    }
    return sum;
}

/* The eye amid voxels of 1 : 10. Slabs are as thin as their short edges, as for cubes of these, if that is 1.4 times as
   thin or more. Light is then linear in at most 1.4 short edges, while blobs have a deviation of 2.6, and up to 1.7
   within of an optical depth of 2 * 0.14 per slab: linear light errs by the square of a slab's depth times the blob's
   curvature, (0.28)^2 / 8 * 3 blobs = 3 %. */
static void test_long_voxels(void) {
    for (int axis = 0; axis < 3; ++axis) {
        double sun[3] = {1, -1, -0.5}, square = 0, mean = 0;
        int size[3] = {24, 24, 24};
        blobs b = {{{0.2, 0.15, -0.1}, {-0.25, -0.1, 0.2}, {0.05, -0.3, 0.15}}, {0.25, 0.25, 0.25}, {0.1, 0.1, 0.1}};
        double high[3] = {1.2, 1.2, 1.2};
        check_scene s;
        sps_volume *volume;
        check_field field;
        memset(&field, 0, sizeof field);
        size[axis] = 12, high[axis] = 6, b.deviation[axis] = 1.2, b.edge[axis] = 1;
        for (int n = 0; n < BLOBS; ++n) b.at[n][axis] *= 4;
        check_clear(&s, 16, 16);
        volume = check_add_volume(&s, size[0], size[1], size[2],
                                  check_box(-high[0], -high[1], -high[2], high[0], high[1], high[2]));
        field.value_fn = blobs_value;
        field.user = &b;
        volume->eval_fn = check_eval_field;
        volume->user = &field;
        volume->extinction = 2;
        check_color(volume->albedo, 1, 1, 1);
        check_add_directional(&s, sun[0], sun[1], sun[2], 4 * PI);
        vec_normalise(sun);
        check_set3(s.view.camera.position, 0.1, 0.1, 0.2);
        check_set3(s.view.camera.target, -0.5, -0.3, -1);
        check_perspective(&s.view.camera, 0.9);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 16 * 16; ++i) {
            double from[3], way[3], exact = 0;
            const double back[3] = {-sun[0], -sun[1], -sun[2]};
            spsi_rays rays;
            memset(&rays, 0, sizeof rays);
            rays.width = rays.height = 16;
            spsi_rays_from_camera(&rays, &s.view.camera);
            spsi_ray_point(&rays, i % 16, i / 16, 0, from);
            spsi_ray_direction(&rays, i % 16, i / 16, way);
            vec_normalise(way);
            for (int n = 0; n < 400; ++n) { /* steps of 0.01 to 0.02, an eighth of the thinnest blob at most */
                double p[3], q[3], between;
                for (int k = 0; k < 3; ++k) {
                    q[k] = from[k] + (n + 1) * 0.015 * way[k];
                    p[k] = q[k] - 0.015 * way[k];
                }
                between = blobs_ahead(&b, p, way) - blobs_ahead(&b, q, way);
                for (int k = 0; k < 3; ++k) p[k] = 0.5 * (p[k] + q[k]);
                exact += 2 * between * exp(-2 * (blobs_ahead(&b, from, way) - blobs_ahead(&b, p, way))) *
                         exp(-2 * blobs_ahead(&b, p, back));
            }
            square += pow((double)image_a[4 * i] - exact, 2);
            mean += exact / 16;
        }
        CHECK_CASE("Found in review", "the eye amid voxels of 1 : 10, of medium quality",
                   "Gaussian blobs by closed forms", sqrt(square) / mean, 0.03,
                   "light is linear in slabs of 1.4 short edges");
    }
}

int main(void) {
    context = check_context(NULL);
    if (!CHECK(context != NULL)) return check_report();
    RUN(test_ripple);
    RUN(test_slab_transmittance);
    RUN(test_box_at_all_tilts);
    RUN(test_slab_scattering_angles);
    RUN(test_slab_scattering_sheets);
    RUN(test_slab_energy);
    RUN(test_thin_sheets);
    RUN_LONG(test_dark_below);
    RUN(test_blob);
    RUN_LONG(test_long_voxels);
    RUN(test_pixel_filter);
    RUN(test_ball_chords);
    RUN(test_thin_things_stay);
    RUN(test_two_slabs);
    RUN(test_emission);
    RUN(test_background);
    RUN(test_ambient);
    RUN(test_point_light);
    RUN(test_light_inside);
    RUN(test_voxel_spacing);
    RUN(test_lights_add);
    RUN(test_overlapping_volumes);
    RUN(test_constant_is_procedural);
    RUN(test_placements);
    RUN(test_turned_scene);
    RUN(test_orthographic_limit);
    RUN(test_engine_matrices);
    RUN(test_reversed_orthographic_matrix);
    RUN(test_phase_integral);
    RUN(test_phase_rendered);
    RUN(test_reciprocity);
    RUN(test_orders_agree);
    RUN_LONG(test_convergence);
    RUN(test_transfer_gas);
    RUN_LONG(test_transfer_surface);
    RUN(test_camera_inside);
    RUN(test_alignment);
    RUN(test_depth);
    RUN(test_scaled_and_moved);
    RUN(test_mirrored);
    RUN(test_albedo_zero_is_black);
    RUN(test_absorber_never_brightens);
    sps_destroy(context);
    return check_report();
}
