/* Volumes at every scale: small and large on screen, of flat and sheared voxels, under lamps amid gas and rotating
   lights; and pairs of features that other tests do not combine. Comparisons with sps_reference have the bound of the
   quality for any scene: MEDIUM of the picture's mean, rms, for gas at medium, SHADED for classified and shaded
   volumes, whose kernels are cut at 3.3 standard deviations and whose slabs are 0.7 of a voxel. Each error that a test
   is about changes its picture by several times that; otherwise the bound is derived on the spot. */

#include "check.h"

#define ISOTROPIC (0.25 / PI)
#define MEDIUM    0.01
#define SHADED    0.06

enum { PIXELS_MOST = 96 * 96 };
static float image_a[4 * PIXELS_MOST], image_b[4 * PIXELS_MOST], image_c[4 * PIXELS_MOST], image_d[4 * PIXELS_MOST];
static float depth_a[PIXELS_MOST], depth_b[PIXELS_MOST];
static sps_context *context;
static float one = 1;

/* ---------------------------------------------------------------------------------------------------------- helpers */

typedef struct difference {
    double rms, bias; /* of the mean of the reference's radiance */
} difference;

static difference compare(const float *image, const float *exact, int pixels) {
    difference result = {0, 0};
    double mean = 0;
    for (int i = 0; i < 4 * pixels; ++i) {
        const double apart = (double)image[i] - (double)exact[i];
        if (i % 4 == 3) continue;
        mean += (double)exact[i];
        result.bias += apart;
        result.rms += apart * apart;
    }
    result.rms = sqrt(result.rms * 3 * pixels) / mean;
    result.bias /= mean;
    return result;
}

/* Renders a scene into image_a and marches it into image_b. */
static difference against_reference(const check_scene *s, double step) {
    const difference failed = {HUGE_VAL, HUGE_VAL};
    if (!check_render(context, s, image_a) || !check_march(context, s, step, image_b, NULL)) return failed;
    return compare(image_a, image_b, (int)check_pixel_count(&s->view));
}

/* A difference as a case, both its rms and its bias. */
#define WITHIN(difference, rms_most, bias_most, name, why, what)                                                       \
    check_within(                                                                                                      \
        CHECK_CASE("Found in review", name, "brute force, rms of the mean", (difference).rms, rms_most, why) &         \
            CHECK_CASE("Found in review", name ", mean", "brute force, their mean", fabs((difference).bias),           \
                       bias_most, why),                                                                                \
        &(difference), what)

static void check_within(int good, const difference *d, const char *what) {
    if (!good || figures())
        printf("    %s: rms %.2f %%, bias %+.2f %% of the mean\n", what, 100 * d->rms, 100 * d->bias);
}

/* A ball of radius 0.36 around the origin whose value rises from 0 to 1 within 0.1 of its rim. */
static double ball(const void *user, const double p[3]) {
    const double r = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    (void)user;
    return fmin(1, fmax(0, (0.36 - r) / 0.1));
}

/* A ball with bumps, of values 0 to 1 throughout. */
static double bumps(const void *user, const double p[3]) {
    const double r = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    (void)user;
    return fmax(0, (1 - 2.2 * r) * (1 + 0.4 * sin(9 * p[0] + 1) * sin(8 * p[1]) * cos(10 * p[2])));
}

/* A volume of n[0] x n[1] x n[2] voxels with the values of a formula; `field` must outlive it. */
static sps_volume *add_field(check_scene *s, check_field *field, double (*value)(const void *, const double *),
                             const int n[3], sps_placement placement) {
    sps_volume *volume = check_add_volume(s, n[0], n[1], n[2], placement);
    field->value_fn = value;
    field->user = NULL;
    memcpy(field->size, n, sizeof field->size);
    field->placement = placement;
    volume->read_fn = check_read_field;
    volume->user = field;
    return volume;
}

static const sps_placement unit_box = {{-0.5, -0.5, -0.5}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

static sps_transfer_point skin_points[3] = {{0.3f, {0.8f, 0.8f, 0.8f}, 0, {0, 0, 0}},
                                            {0.5f, {0.8f, 0.8f, 0.8f}, 20, {0, 0, 0}},
                                            {1, {0.8f, 0.8f, 0.8f}, 20, {0, 0, 0}}};
static sps_transfer skin = {skin_points, 3, NULL, NULL, 0};

static sps_transfer_point layer_points[4] = {{0.2f, {0.8f, 0.5f, 0.3f}, 0, {0, 0, 0}},
                                             {0.35f, {0.8f, 0.5f, 0.3f}, 8, {0, 0, 0}},
                                             {0.6f, {0.8f, 0.7f, 0.6f}, 1, {0, 0, 0}},
                                             {0.9f, {0.9f, 0.9f, 0.9f}, 12, {0, 0, 0}}};
static sps_transfer layers = {layer_points, 4, NULL, NULL, 0};

/* --------------------------------------------------------------------------------------------- seen small and large */

/* A shaded ball of 20 voxels at a quarter to four pixels per voxel, of which half is enough where there are many: its
   mean is within 1 % of the reference's at each. Where pixels are 4 voxels wide, texels are as wide as half a pixel at
   medium: of the 10 pixels that show the ball, 2 at its terminator may be off by half of what they show. */
static void test_image_sizes(void) {
    static const int n[3] = {20, 20, 20};
    for (int pixels = 5; pixels <= 80; pixels *= 2)
        for (int quality = SPS_QUALITY_MEDIUM; quality <= SPS_QUALITY_ULTRA; ++quality) {
            check_scene s;
            check_field field;
            sps_volume *volume;
            difference found;
            char what[64];
            check_clear(&s, pixels, pixels);
            s.view.region[1] = pixels < 80 || check_long() ? 0 : pixels / 4;
            s.view.region[2] = pixels;
            s.view.region[3] = (pixels < 40 || (pixels < 80 && check_long()) ? pixels : pixels / 2) - s.view.region[1];
            volume = add_field(&s, &field, ball, n, unit_box);
            volume->transfer = &skin;
            volume->shading = SPS_SHADING_SURFACE;
            check_add_directional(&s, -0.8, -0.4, -0.5, 3);
            s.view.quality = (sps_quality)quality;
            snprintf(what, sizeof what, "%g pixels a voxel, quality %d", pixels / 20.0, quality);
            if (quality == SPS_QUALITY_MEDIUM)
                if (!check_march(context, &s, check_long() ? 0.25 : 0.4, image_b, NULL)) return;
            if (!check_render(context, &s, image_a)) return;
            found = compare(image_a, image_b, pixels * s.view.region[3]);
            WITHIN(found, 0.1 + (pixels == 5 && quality == SPS_QUALITY_MEDIUM ? 0.5 * sqrt(0.2) : 0), 0.01,
                   "surface of 1/4 to 4 pixels a voxel", "the mean to 1 %; of 10 pixels, 2 at the terminator by half",
                   what);
        }
}

/* Flat voxels, upright and sheared as by a gantry's tilt, seen at 45 degrees to their planes: errors are at most 1.5
   times those of cubes of the same breadth. */
static void test_flat_voxels(void) {
    static const int flat[3][3] = {{40, 40, 40}, {40, 40, 5}, {40, 40, 4}};
    const int side = check_long() ? 36 : 16;
    double cubes[2] = {0, 0}; /* by quality */
    for (int i = 0; i < 3; ++i) {
        check_scene s;
        check_field field;
        sps_volume *volume;
        sps_placement placement = unit_box;
        if (i == 2) placement.axis[2][0] = tan(PI / 6), placement.origin[0] -= 0.5 * tan(PI / 6);
        check_clear(&s, side, side);
        check_set3(s.view.camera.position, 2, 0.3, 2);
        check_orthographic(&s.view.camera, 1.1);
        volume = add_field(&s, &field, ball, flat[i], placement);
        volume->transfer = &layers;
        check_add_directional(&s, -0.2, -0.8, -0.5, 3);
        if (!check_march(context, &s, i == 0 ? 0.5 : 0.4, image_b, NULL)) return;
        for (int high = 0; high < 2; ++high) {
            difference d;
            s.view.quality = high ? SPS_QUALITY_HIGH : SPS_QUALITY_MEDIUM;
            if (!check_render(context, &s, image_a)) return;
            d = compare(image_a, image_b, side * side);
            if (i == 0) cubes[high] = d.rms;
            WITHIN(d, i == 0 ? SHADED : 1.5 * cubes[high], 0.02, "classified flat voxels, 1:1:8, and 1:1:10 sheared",
                   "1.5 times the error of cubes of their breadth",
                   i == 0   ? "cubes"
                   : i == 1 ? "1:1:8"
                            : "1:1:10, sheared");
        }
    }
}

/* A wide camera inside a classified volume. Its corner rays cross slabs that face its axis at a cosine c. Slabs are a
   voxel thick here: the bounds, with 2.5 voxels of margin on either side, need 15. Below c = 0.35, the image has four
   parts with slabs of their own. A surface is then as sharp as in the middle: coverage to 0.01 (as in random_scene.h),
   which would otherwise be 0.06 and 0.08 at the lower two. */
static void test_grazing_rays(void) {
    static const int n[3] = {10, 10, 10};
    for (int i = 0; i < 3; ++i) {
        const double cosine = i == 0 ? 0.5 : i == 1 ? 0.2 : 0.15, tangent = sqrt((1 / (cosine * cosine) - 1) / 2);
        sps_plan_report plan;
        check_field field;
        check_scene s;
        double sum = 0;
        check_clear(&s, 33, 33);
        check_set3(s.view.camera.position, 0.05, 0.02, -0.15);
        check_set3(s.view.camera.target, 0.05, 0.02, -1);
        check_perspective(&s.view.camera, 2 * atan(tangent * 33 / 32));
        add_field(&s, &field, bumps, n, unit_box)->transfer = &layers;
        s.view.slab_thickness = 1;
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        CHECK(i ? plan.sweep_count == 4 : abs(plan.slab_count - 15) <= 1);
        s.view.slab_thickness = 0;
        if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.3, image_b, NULL)) return;
        for (int k = 3; k < 4 * 33 * 33; k += 4)
            sum += (double)(image_a[k] - image_b[k]) * (double)(image_a[k] - image_b[k]);
        if (!CHECK(sqrt(sum / (33 * 33)) <= 0.01) || figures())
            printf("    cosine %g: coverage off by %.4f\n", cosine, sqrt(sum / (33 * 33)));
    }
}

/* An eye amid classified matter, and a sun that turns away from its axis: slabs, across the half-way vector, are half
   as thick where the corner ray that is farthest from that vector has a cosine below 0.35 with it. Otherwise, their
   number follows what the box measures along the vector, and what rays cross of a voxel: 10 % at steps of 2 degrees. */
static void test_grazing_corners(void) {
    static const int n[3] = {10, 10, 10};
    double last = 0;
    int halved = 0;
    for (int degrees = 0; degrees <= 94; degrees += 2) {
        const double angle = degrees * PI / 180, tangent = tan(0.55), normal[2] = {sin(angle / 2), cos(angle / 2)};
        double cosine = 1;
        sps_plan_report plan;
        check_field field;
        check_scene s;
        check_clear(&s, 33, 33);
        check_set3(s.view.camera.position, 0.05, 0.02, -0.15);
        check_set3(s.view.camera.target, 0.05, 0.02, -1);
        check_perspective(&s.view.camera, 2 * atan(tangent * 33 / 32));
        add_field(&s, &field, bumps, n, unit_box)->transfer = &layers;
        check_add_directional(&s, sin(angle), 0, -cos(angle), 1);
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        s.view.slab_thickness = 1;
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        for (int side = -1; side <= 1; side += 2)
            cosine = fmin(cosine, (side * tangent * normal[0] + normal[1]) / sqrt(1 + 2 * tangent * tangent));
        CHECK(plan.sweep_count == 1);
        if (cosine < 0.35) plan.slab_count /= 2, ++halved;
        if (degrees > 0) CHECK_NEAR(plan.slab_count, last, 0.1 * last);
        last = plan.slab_count;
    }
    CHECK(halved == 12); /* from 72 degrees on */
}

/* --------------------------------------------------------------------------------------------------- lamps, turning */

/* A lamp amid thin gas that fills a slab of half a unit, moved by a tenth of a pixel at a time: each pixel's radiance
   is phase * extinction * (the angle that the ray's path through the slab subtends at the lamp) / its distance q from
   the ray, which is at least 0.28364 pixels. The slab's soft faces change an angle by 0.4 %, its ripple by 0.2 %. The
   sum over the image must follow that of the closed forms to 0.2 %: varying errors would flicker. */
static void test_lamp(void) {
    static const int n[3] = {31, 31, 10};
    double before = 0, exact_before = 0;
    for (int frame = 0; frame < 8; ++frame) {
        check_scene s;
        sps_volume *volume;
        double lamp[3] = {0.03, -0.02, 0.011}, sum = 0, exact_sum = 0, most = 0, exact_most = 0;
        lamp[0] += 0.1 * frame / 33, lamp[1] += 0.06 * frame / 33, lamp[2] += 0.02 * frame;
        check_clear(&s, 33, 33);
        volume = check_add_volume(&s, n[0], n[1], n[2], check_box(-0.775, -0.775, -0.25, 0.775, 0.775, 0.25));
        volume->read_fn = check_read_constant, volume->user = &one;
        volume->extinction = 1e-3f;
        check_color(volume->albedo, 1, 1, 1);
        check_add_point(&s, lamp[0], lamp[1], lamp[2], 1)->no_shadow = 1;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 33 * 33; ++i) {
            const double x = (i % 33 - 16) / 33.0 - lamp[0], y = (16 - i / 33) / 33.0 - lamp[1];
            const double q = fmax(sqrt(x * x + y * y), 0.28364 / 33);
            const double exact = ISOTROPIC * 1e-3 * (atan((0.25 - lamp[2]) / q) + atan((0.25 + lamp[2]) / q)) / q;
            sum += (double)image_a[4 * i];
            exact_sum += exact;
            most = fmax(most, (double)image_a[4 * i]);
            exact_most = fmax(exact_most, exact);
        }
        if (!CHECK_CASE("Found in review", "lamp within gas, brightest pixel", "closed form",
                        fabs(most / exact_most - 1), 0.03,
                        "soft faces, 0.4 %; ripple, 0.2 %; parts of slabs at the lamp"))
            printf("    brightest pixel, frame %d\n", frame);
        if (frame > 0 && !CHECK_CASE("Transport", "airlight of thin gas about a lamp that moves by tenths of a pixel",
                                     "the closed form's sum, from frame to frame",
                                     fabs(sum / before * (exact_before / exact_sum) - 1), 0.002, "ripple"))
            printf("    sum of the image, frame %d\n", frame);
        before = sum, exact_before = exact_sum;
    }
}

/* A lamp above a floor, both of any size: the same picture. Squares of its distances are far below the least float. The
   scale is a power of two, so that rounding is the same. */
static void test_tiny_lamp(void) {
    const double scales[2] = {1, ldexp(1, -75)};
    for (int n = 0; n < 2; ++n) {
        const double scale = scales[n];
        const double origin[3] = {-scale, -scale, 0}, u[3] = {2 * scale, 0, 0}, v[3] = {0, 2 * scale, 0};
        check_triangles floor_of = {0};
        check_scene s;
        check_clear(&s, 24, 24);
        check_set3(s.view.camera.position, 0, 0, 3 * scale);
        check_orthographic(&s.view.camera, 1.8 * scale);
        check_add_quad(&floor_of, origin, u, v);
        check_add_mesh(&s, &floor_of, 0.8);
        check_add_point(&s, 0.2 * scale, 0.1 * scale, 0.3 * scale, 1)->falloff = SPS_FALLOFF_NONE;
        check_render(context, &s, n ? image_b : image_a);
        check_free_triangles(&floor_of);
    }
    CHECK(check_largest(image_a, image_b, 4 * 24 * 24) == 0);
}

/* A light that rotates through a right angle to the view, where slabs flip and the numbers of texels change: from frame
   to frame the picture's error changes by less than the reference itself. */
static void test_turning_light(void) {
    static const int n[3] = {14, 14, 14};
    const int side = check_long() ? 40 : 28;
    float *image[2] = {image_a, image_c}, *exact[2] = {image_b, image_d};
    for (int frame = 0; frame < 6; ++frame) {
        const double angle = (87.4 + 1.07 * frame) * PI / 180;
        const int now = frame & 1, pixels = side * side;
        double error = 0, change = 0;
        check_scene s;
        check_field field;
        sps_volume *volume;
        check_clear(&s, side, side);
        check_set3(s.view.camera.position, 0, 0.4, 2.2);
        check_perspective(&s.view.camera, 0.55);
        volume = add_field(&s, &field, ball, n, unit_box);
        volume->transfer = &skin;
        volume->shading = SPS_SHADING_SURFACE;
        check_add_directional(&s, sin(angle), -0.3, -cos(angle), 3);
        if (!check_render(context, &s, image[now]) || !check_march(context, &s, 0.5, exact[now], NULL)) return;
        for (int i = 0; i < 4 * pixels && frame > 0; ++i) {
            const double own = (double)exact[now][i] - (double)exact[!now][i];
            const double moved = (double)image[now][i] - (double)image[!now][i] - own;
            if (i % 4 == 3) continue;
            error += moved * moved;
            change += own * own;
        }
        if ((frame > 0 &&
             !CHECK_CASE("Found in review", "light that turns through a right angle to the view, classified gas",
                         "the error's change / the picture's change, rms", sqrt(error / change), 1,
                         "a bound: errors jump by less than the picture moves")) ||
            figures())
            printf("    frame %d: the error's change is %.2f of the reference's\n", frame, sqrt(error / change));
    }
}

/* ------------------------------------------------------------------------------------------------ pairs of features */

/* A constant grid is constant to 0.2 %: a transfer function that begins 0.5 % above its value shows nothing of it, one
   that begins 0.5 % below shows all of it, and the steep onset must not be smoothed away. */
static void test_steep_onset(void) {
    for (int shows = 0; shows < 2; ++shows) {
        const float onset = shows ? 0.995f : 1.005f;
        const sps_transfer_point steep[3] = {
            {onset, {1, 1, 1}, 0, {0, 0, 0}}, {onset * 1.001f, {1, 1, 1}, 1, {0, 0, 0}}, {2, {1, 1, 1}, 1, {0, 0, 0}}};
        const sps_transfer transfer = {steep, 3, NULL, NULL, 0};
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 9, 9);
        check_orthographic(&s.view.camera, 0.5);
        s.view.quality = SPS_QUALITY_HIGH;
        volume = check_add_volume(&s, 20, 20, 20, unit_box);
        volume->read_fn = check_read_constant, volume->user = &one;
        volume->transfer = &transfer;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 81; ++i) {
            /* the value falls by 0.5 % 2.576 * 0.65 voxels before either face, and where ripple adds 0.2 % to it, by
               0.7 % 2.457 * 0.65 before; a slab of 0.4 is shown or not as a whole */
            const double least = shows ? -expm1(-1 + 2 * (0.65 * 2.576 + 0.4) / 20) : 0;
            const double most = shows ? -expm1(-1 + 2 * (0.65 * 2.457 - 0.4) / 20) : 0;
            if (!CHECK_CASE("Found in review", "constant value 0.5 % below or above a steep onset",
                            "coverage between two closed forms",
                            fmax(least - (double)image_a[4 * i + 3], (double)image_a[4 * i + 3] - most), 0,
                            "bounds hold ripple and a slab at either face"))
                printf("    onset %g, pixel %d: coverage %g\n", (double)onset, i, (double)image_a[4 * i + 3]);
        }
    }
}

/* Two gases side by side that differ only in their lobes: the phase functions are 4 and 1/9 of isotropic along the
   view, and each keeps its own. Thin, so that a pixel is phase * optical depth to 1 %. */
static void test_lobes_alone(void) {
    static const sps_lobe lobes[2] = {{0.5f, 1}, {-0.5f, 1}};
    check_scene s;
    check_clear(&s, 16, 8);
    check_orthographic(&s.view.camera, 1);
    for (int i = 0; i < 2; ++i) {
        sps_volume *gas = check_add_volume(&s, 10, 10, 10, check_box(i ? 0 : -1, -0.5, -0.5, i ? 1 : 0, 0.5, 0.5));
        gas->read_fn = check_read_constant, gas->user = &one;
        gas->extinction = 0.005f;
        check_color(gas->albedo, 1, 1, 1);
        gas->lobes = &lobes[i], gas->lobe_count = 1;
    }
    check_add_directional(&s, 0, 0, 1, 1)->no_shadow = 1; /* towards the eye */
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 2; ++i) {
        const double g = i ? -0.5 : 0.5, phase = ISOTROPIC * (1 - g * g) / pow(1 + g * g - 2 * g * 1, 1.5);
        CHECK_CASE("Found in review", "two gases that differ in their lobes only", "each its phase function, relative",
                   fabs((double)image_a[4 * (16 * 4 + 3 + 9 * i)] / (phase * 0.005) - 1), 0.01,
                   "a depth of 0.005 and the ripple of medium quality");
    }
}

/* Slabs and texels are those of the finest voxels, in whichever volume and along whichever axis. */
static void test_finest_counts(void) {
    int slabs[4], texels[4];
    for (int i = 0; i < 4; ++i) {
        const int fine[3] = {i == 2 ? 48 : 24, i == 3 ? 48 : 24, i < 2 ? 48 : 24};
        sps_plan_report plan;
        check_scene s;
        check_clear(&s, 32, 32);
        s.view.slab_thickness = 1;
        for (int n = 0; n < 2; ++n) {
            const int is_fine = (n == 0) == (i != 1);
            sps_volume *gas =
                check_add_volume(&s, is_fine ? fine[0] : 8, is_fine ? fine[1] : 8, is_fine ? fine[2] : 8, unit_box);
            gas->read_fn = check_read_constant, gas->user = &one, gas->extinction = 1;
            check_color(gas->albedo, 1, 1, 1);
        }
        check_add_directional(&s, 1, -1, -1, 1);
        check_set3(s.view.camera.position, 5, 5,
                   5); /* each axis the same, for the eye, the light and the slabs' normal */
        check_set3(s.light[0].direction, -1, -1, -1);
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        slabs[i] = plan.slab_count, texels[i] = plan.shadow_width * plan.shadow_height;
        /* along (1,1,1) / sqrt 3 the fine volume's voxel extends sqrt((2 / 24^2 + 1 / 48^2) / 3), the other's 1 / 8;
           the box with its margins of 2.5 coarse voxels extends (1 + 5 / 8) sqrt 3 */
        CHECK_NEAR(slabs[i], 1.625 * sqrt(3.0) / sqrt((2.0 / (24 * 24) + 1.0 / (48 * 48)) / 3), 1.01);
        CHECK_CASE("Found in review",
                   "slabs and texels where the finest voxels are the last volume's, or along one axis",
                   "the same numbers", abs(slabs[i] - slabs[0]) + abs(texels[i] - texels[0]), 0, "exact");
    }
}

/* Gas in long voxels at an angle in the picture, so thin (1 : 9.6) that rows of pixels cannot share factors: their
   exponents reach 3.85^2 / 2 / (1 - r^2), 170, beyond floats, where r^2 = 0.957 is the square of the correlation of x
   and y within a footprint. The thinnest are a pixel wide (0.65 * 0.28 / 12 units), so that no filter widens them. */
static void test_slender_voxels(void) {
    static const int n[3] = {12, 12, 12};
    check_scene s;
    check_field field;
    sps_volume *gas;
    difference found;
    sps_placement placement = unit_box;
    check_set3(placement.axis[0], 1.6, 1.6, 0);
    check_set3(placement.axis[1], 0.7, 1.15, 0);
    check_set3(placement.origin, -1.15, -1.375, -0.5);
    check_clear(&s, 40, 36);
    check_orthographic(&s.view.camera, 0.55);
    gas = add_field(&s, &field, bumps, n, placement);
    gas->extinction = 3;
    check_color(gas->albedo, 0.9, 0.9, 0.9);
    check_add_directional(&s, -0.3, -0.8, -0.6, 3);
    s.view.quality = SPS_QUALITY_HIGH;
    if (!check_long()) s.view.region[1] = 12, s.view.region[2] = 40, s.view.region[3] = 12; /* rows in the middle */
    found = against_reference(&s, 0.3);
    WITHIN(found, MEDIUM, MEDIUM, "strongly sheared voxels, 1:9.6 in the picture", "that of cubes at medium quality",
           "slender");
}

/* The value of a large box of voxels of value 1, `at` voxels before its face: the sum of the layers around there. */
static double face_value(double at) {
    const int last = (int)floor(fmax(at, 0)) + 4;
    double sum = 0;
    for (int layer = last > 9 ? last - 9 : 0; layer <= last; ++layer) {
        const double u = (at - layer - 0.5) / 0.65;
        sum += exp(-0.5 * u * u) / (0.65 * sqrt(2 * PI));
    }
    return sum;
}

/* Radiance towards the eye of a box of 14 voxels, one unit, deep, with extinction sigma at value 1, lit sideways
   through an optical depth `light` at value 1: where the value is lower, so is the light's optical depth. */
static double sent_by_box(double sigma, double light) {
    const double step = 0.01;
    double sum = 0, before = 0;
    for (double at = -4; at < 18; at += step) {
        const double value = face_value(at + 0.5 * step) * face_value(14 - at - 0.5 * step);
        const double depth = sigma * value * step / 14;
        sum += depth * exp(-value * light - before - 0.5 * depth);
        before += depth;
    }
    return 0.9 * ISOTROPIC * sum;
}

/* Two classified volumes, one behind the other in the light, with different transfer functions: each dims by its own.
   These are straight lines from 0, so that soft faces absorb as much light as hard ones, and each pixel's radiance is
   an integral over one depth. Its error is the ripple of the light's and the eye's optical depth, and that of linear
   interpolation of the light's depth between the planes of slabs, which lie 0.57 voxels apart along the view: an eighth
   of their square times light * 0.242 / 0.65^2, 0.023 light, within two standard deviations of a face: in 5.2 of 14
   voxels. */
static void test_two_tables(void) {
    static const double sigmas[2] = {3, 0.75}, ripple = 0.002;
    sps_transfer_point points[2][2];
    sps_transfer transfer[2];
    memset(points, 0, sizeof points);
    memset(transfer, 0, sizeof transfer);
    for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2; ++k) check_color(points[i][k].albedo, 0.9, 0.9, 0.9);
        points[i][1].value = 2, points[i][1].extinction = (float)(2 * sigmas[i]);
        transfer[i].points = points[i], transfer[i].point_count = 2;
    }
    for (int order = 0; order < 2; ++order) {
        check_scene s;
        check_clear(&s, 40, 10);
        check_orthographic(&s.view.camera, 0.6);
        for (int i = 0; i < 2; ++i) {
            const double x = i == order ? 0.55 : -0.55;
            sps_volume *volume = check_add_volume(&s, 14, 14, 14, check_box(x - 0.5, -0.5, -0.5, x + 0.5, 0.5, 0.5));
            volume->read_fn = check_read_constant, volume->user = &one;
            volume->transfer = &transfer[i];
        }
        check_add_directional(&s, -1, 0, 0, 1);
        s.view.quality = SPS_QUALITY_HIGH;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 40; ++i) {
            const double x = (i - 19.5) * 0.06, first = sigmas[order], here = x > 0 ? first : sigmas[!order];
            const double light = x > 0 ? first * (1.05 - x) : first + here * (-0.05 - x);
            const double exact = sent_by_box(here, light);
            const double room = exact * (ripple * (here + light) + 0.023 * light * 5.2 / 14);
            if (fabs(fabs(x) - 0.55) > 0.5 - 2.5 / 14) continue;
            for (int row = 0; row < 10; ++row)
                if (!CHECK_CASE("Found in review", "two classified volumes one behind the other in the light",
                                "each dims by its own transfer function",
                                fabs((double)image_a[4 * (40 * row + i)] - exact), room,
                                "ripple; straight lines between planes of slabs, an eighth of their square"))
                    printf("    %s, x = %g\n", order ? "thin before dense" : "dense before thin", x);
        }
    }
}

/* A deep flat skin that faces the eye, lit at an angle: its radiance is the response of its surface times m / (1 + m),
   where m is the light's cosine, in closed form: r / pi m + specular (n + 8) / (8 pi) (n . h)^n m. */
static void test_highlight(void) {
    static const sps_transfer_point points[3] = {{0.2f, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                 {0.3f, {0.5f, 0.5f, 0.5f}, 40, {0, 0, 0}},
                                                 {1, {0.5f, 0.5f, 0.5f}, 40, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    for (int i = 0; i < 4; ++i) {
        const double angle = 0.25 * i, m = cos(angle), shininess = 24;
        const double shine = 0.6 * (shininess + 8) / (8 * PI) * pow(cos(0.5 * angle), shininess);
        const double exact = (0.5 / PI + shine) * m * m / (1 + m);
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 9, 9);
        check_orthographic(&s.view.camera, 0.2);
        s.view.quality = SPS_QUALITY_ULTRA;
        volume = check_add_volume(&s, 30, 30, 10, check_box(-1.5, -1.5, -1, 1.5, 1.5, 0));
        volume->read_fn = check_read_constant, volume->user = &one;
        volume->transfer = &transfer;
        volume->shading = SPS_SHADING_SURFACE;
        volume->specular = 0.6f, volume->shininess = (float)shininess;
        check_add_directional(&s, sin(angle), 0, -cos(angle), 1);
        if (!check_render(context, &s, image_a)) return;
        /* extinction begins within a voxel, 4 deep: the light's depth between texels and slabs is accurate to 1 % */
        if (!CHECK_CASE("Found in review", "highlight of a flat skin", "closed form, relative",
                        fabs((double)image_a[4 * 40] / exact - 1), 0.015,
                        "the light's depth between texels and slabs, 1 %"))
            printf("    at %g radians\n", angle);
    }
}

static double rim_extinction(double value) {
    return 8 * fmax(0, fmin(fmin(1, (value - 0.2) / 0.15), (0.7 - value) / 0.1));
}

/* Optical depth of two faces of a box of voxels of 0.05 units, and its tolerance. A value is accurate to 0.003, for
   ripple and the kernel's shares at both ends of a slab of 0.4 voxels, and to 0.068 * 0.4^3 of the third derivative:
   the error, in the middle of an outer part, of a parabola with the means of three slabs. Extinctions in the profile
   may be those of any value within that. Parts are a tenth of a voxel: where extinction bends, the middle of one is off
   by an eighth of its square times the change of slope: 53 per value at 0.2 and 0.35, 80 at 0.6 and 0.7, where values
   change by 0.43, 0.57, 0.59 and 0.54 per voxel. Upward bends subtract, downward bends add: at most 78 in either face.
 */
static double rims_of_box(double *room) {
    const double step = 0.001;
    double exact = 0;
    *room = 2 * 78 * 0.1 * 0.1 / 8 / 20;
    for (double at = -4; at < 4; at += step) {
        const double value = face_value(at + 0.5 * step), here = rim_extinction(value), u = at / 0.65;
        const double third = exp(-0.5 * u * u) * (u * u - 1) / sqrt(2 * PI) / (0.65 * 0.65 * 0.65);
        const double good = 0.003 + 0.068 * 0.4 * 0.4 * 0.4 * fabs(third);
        const double apart = fmax(fabs(rim_extinction(value + good) - here), fabs(rim_extinction(value - good) - here));
        exact += 2 * here * step / 20, *room += 2 * apart * step / 20;
    }
    return exact;
}

static const sps_transfer_point rim_points[4] = {{0.2f, {0.8f, 0.8f, 0.8f}, 0, {0, 0, 0}},
                                                 {0.35f, {0.8f, 0.8f, 0.8f}, 8, {0, 0, 0}},
                                                 {0.6f, {0.8f, 0.8f, 0.8f}, 8, {0, 0, 0}},
                                                 {0.7f, {0, 0, 0}, 0, {0, 0, 0}}};
static const sps_transfer rim = {rim_points, 4, NULL, NULL, 1};

/* Only the faces of a box are visible, where values fall from 1 to 0 outside: none of them may be missed, on any side.
   Coverage is that of two faces, in closed form. */
static void test_faces_of_volume(void) {
    double room;
    const double exact = rims_of_box(&room);
    for (int side = 0; side < 6; ++side) {
        double away[3] = {0, 0, 0};
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 20, 9);
        away[side / 2] = side % 2 ? -4 : 4;
        memcpy(s.view.camera.position, away, sizeof away);
        check_set3(s.view.camera.up, 0, side / 2 == 2, side / 2 < 2);
        check_orthographic(&s.view.camera, side / 2 == 0 ? 0.5 : 0.625);
        s.view.quality = SPS_QUALITY_HIGH;
        volume = check_add_volume(&s, 34, 20, 20, check_box(-0.85, -0.5, -0.5, 0.85, 0.5, 0.5));
        volume->read_fn = check_read_constant, volume->user = &one;
        volume->transfer = &rim;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 180; ++i) {
            const double depth = -log(1 - (double)image_a[4 * i + 3]);
            if (side < 2 && abs(2 * (i % 20) - 19) > 9) continue; /* beside what is narrower there */
            if (!CHECK_CASE("Found in review", "box of which only the faces are visible, from six sides",
                            "optical depth of two faces", fabs(depth - exact), room,
                            "ripple and a parabola's error in values; bends of extinction"))
                printf("    side %d, pixel %d\n", side, i);
        }
    }
}

/* ------------------------------------------------------------------------------------------------------------ seams */

/* The largest difference between two pictures, relative to the brightest pixel. */
static double apart(const float *image, const float *other, int pixels) {
    double brightest = 0;
    for (int i = 0; i < 4 * pixels; ++i) brightest = fmax(brightest, (double)image[i]);
    return (double)check_largest(image, other, (size_t)(4 * pixels)) / brightest;
}

/* Gas that moves seams, but is too thin to be seen. */
static const sps_transfer_point faint_points[2] = {{0.3f, {0.8f, 0.8f, 0.8f}, 0, {0, 0, 0}},
                                                   {1, {0.8f, 0.8f, 0.8f}, 1e-6f, {0, 0, 0}}};
static const sps_transfer faint = {faint_points, 2, NULL, NULL, 0};

static int read_two_balls(void *user, size_t first, size_t count, sps_particle *out) {
    static const sps_particle balls[2] = {{{-0.2f, 0.25f, 0.2f}, 0.2f, 0.8f, {0, 0, 0}}, {{0.25f, -0.3f, -0.1f}, 0.3f, 1.2f, {0, 0, 0}}};
    (void)user;
    memcpy(out, balls + first, count * sizeof *out);
    return 0;
}

/* A ball of classified gas, of a surface or of gas, with particles and a polygon, and a copy of it `shift` slabs in
   front of it. Returns whether it was rendered. */
static int render_shifted(int kind, int shift, float *image) {
    static const int n[3] = {24, 24, 24};
    static const double corner[3] = {-0.6, -0.5, -0.3}, u[3] = {1, 0.2, 0.1}, v[3] = {0.1, 0.3, 0.8};
    check_scene s;
    check_field field;
    check_triangles triangles;
    sps_volume *volume, *copy;
    sps_particles balls;
    int good;
    check_clear(&s, 48, 48);
    volume = add_field(&s, &field, ball, n, unit_box);
    copy = add_field(&s, &field, ball, n, unit_box);
    copy->placement.origin[2] += shift * 0.5 / 24;
    if (kind < 2) {
        volume->transfer = &skin, copy->transfer = &faint;
        volume->shading = copy->shading = kind == 1 ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
    } else {
        volume->extinction = 10, copy->extinction = 1e-6f;
        check_color(volume->albedo, 0.8, 0.8, 0.8);
    }
    memset(&balls, 0, sizeof balls);
    balls.read_fn = read_two_balls, balls.count = 2, balls.soft = 1;
    check_color(balls.albedo, 0.5, 0.7, 0.9);
    s.scene.particles = &balls, s.scene.particle_set_count = 1;
    memset(&triangles, 0, sizeof triangles);
    check_add_quad(&triangles, corner, u, v);
    check_add_mesh(&s, &triangles, 0.6);
    check_add_directional(&s, -0.8, -0.1, -0.2, 3)->no_shadow = 1;
    s.view.quality = SPS_QUALITY_HIGH;
    s.view.slab_thickness = 0.5;
    good = check_render(context, &s, image);
    check_free_triangles(&triangles);
    return good;
}

/* The seams between chunks of 16 slabs are invisible: the chunks move while slabs stay in place. Slabs are counted in
   floats up to 64, which is 4e-6 of one, and kernels' sections are straight lines. An extinction of 20 absorbs 0.4 of
   the light per slab, so that 1e-5 of the picture is several of these at worst; 1e-7 of the copy is visible. */
static void test_chunk_seams(void) {
    for (int kind = 0; kind < 3; ++kind)
        for (int shift = 0; shift < 16; shift += 3)
            if (render_shifted(kind, shift, shift ? image_b : image_a) && shift > 0)
                if (!CHECK_CASE("Found in review", "seams between chunks of slabs, of classified volumes, too",
                                "invisible: the same picture as chunks move", apart(image_a, image_b, 48 * 48), 1e-5,
                                "slabs counted in floats, 4e-6 of one"))
                    printf("    kind %d, %d slabs\n", kind, shift);
}

/* The ball from outside, from its skin inwards or, in thick slabs, outwards, surrounded by empty voxels. A faint box
   around everything keeps slabs and the light's texels in place. */
static int render_padded(int from, int surface, int pad, sps_filling filling, float *image) {
    static const int coarse[3] = {12, 12, 12};
    const int n[3] = {24 + 2 * pad, 24 + 2 * pad, 24 + 2 * pad};
    const double half = 0.5 + pad / 24.0;
    check_scene s;
    check_field field, around;
    sps_volume *volume;
    check_clear(&s, 48, 48);
    volume = add_field(&s, &field, ball, n, check_box(-half, -half, -half, half, half, half));
    volume->transfer = &skin;
    volume->shading = surface ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
    volume = add_field(&s, &around, ball, coarse, check_box(-1, -1, -1, 1, 1, 1));
    around.placement = check_box(-0.1, -0.1, -0.1, 0.1, 0.1, 0.1); /* the ball's core, everywhere */
    volume->transfer = &faint;
    check_add_directional(&s, -0.8, -0.1, -0.2, 3)->no_shadow = from > 0;
    if (from > 0) {
        check_set3(s.view.camera.position, 0.1, 0.05, 0.28);
        check_set3(s.view.camera.target, from == 1 ? 0.3 : -0.2, 0, from == 1 ? 0 : 0.5);
        check_perspective(&s.view.camera, 1.2);
    }
    s.view.quality = SPS_QUALITY_HIGH;
    s.view.slab_thickness = from < 2 ? 0.5 : 4;
    s.view.filling = filling;
    return check_render(context, &s, image);
}

/* The seams between bricks are invisible, too, which padding moves. Sums of the same kernels in another order: 1e-5 of
   the picture. No voxel's centre lies within 0.009 of a voxel of the eye's plane, where round-off is divided by almost
   nothing. In fields, the same place in another brick may be rounded to the next 1/1024 of a voxel. Gradients of the
   skin, 2.4 voxels thick, change by no more than themselves within a voxel, so by 1/1024 at most, and by half of that
   in the mean of places. Where voxels are gathered, the field changes by 0.7 / 1024 at most, and what a slab absorbs by
   0.4 of that. */
static void test_brick_seams(void) {
    for (int kind = 0; kind < 7; ++kind) {
        const int from = kind % 6 / 2, surface = kind % 2;
        const sps_filling filling = kind < 6 ? SPS_FILLING_SPLAT : SPS_FILLING_GATHER;
        const double allowed = kind == 6 ? 0.4 * 0.7 / 1024 : surface ? 0.5 / 1024 : 1e-5;
        for (int pad = 0; pad < 8; pad += 1 + (pad > 0)) {
            if (!check_long() && pad > 0 && (pad / 2 + surface) % 2) continue; /* 1 and 5, or 3 and 7 */
            if (render_padded(from, surface, pad, filling, pad ? image_b : image_a) && pad > 0)
                if (!CHECK(apart(image_a, image_b, 48 * 48) <= allowed))
                    printf("    from %d, %s, padded by %d\n", from, surface ? "surface" : "gas", pad);
        }
    }
}

/* ------------------------------------------------------------------------------------------ cut and lit from behind */

/* Gas lit from behind is composited back to front: pictures and depths agree with the reference. */
static void test_back_to_front(void) {
    static const int n[3] = {16, 16, 16};
    const int side = check_long() ? 32 : 20;
    check_scene s;
    check_field field;
    sps_volume *gas;
    difference found;
    double worst = 0;
    check_clear(&s, side, side);
    check_set3(s.view.camera.position, 0.2, 0.3, 2);
    check_perspective(&s.view.camera, 0.5);
    gas = add_field(&s, &field, bumps, n, unit_box);
    gas->extinction = 6;
    check_color(gas->albedo, 0.9, 0.9, 0.9);
    check_add_directional(&s, 0.3, -0.2, 0.8, 3);
    s.view.quality = SPS_QUALITY_HIGH;
    if (!check_render_depth(context, &s, image_a, depth_a)) return;
    if (!check_march(context, &s, check_long() ? 0.25 : 0.4, image_b, depth_b)) return;
    found = compare(image_a, image_b, side * side);
    WITHIN(found, MEDIUM, MEDIUM, "gas lit from behind, back to front", "that of gas at medium quality",
           "back to front");
    for (int k = 0; k < side * side; ++k) /* at low coverage, cut kernels change the depth */
        if (image_b[4 * k + 3] > 0.05f) worst = fmax(worst, fabs((double)depth_a[k] - (double)depth_b[k]));
    CHECK_CASE("Found in review", "depth of gas lit from behind", "brute force's", worst, 0.5 / 16, "half a slab");
}

/* A box of uniform gas, |z| < 0.5, behind a near plane at z = 0.2, in closed form. c: a ray's cosine. */
typedef struct behind_near {
    double depth, radiance, distance;
} behind_near;

static behind_near exact_behind_near(double c, double eye, double sigma, int backlit) {
    const double way = 0.7, per_z = sigma * (backlit ? 1 / c - 1 : 1 / c + 1); /* optical depth per z of both paths */
    behind_near exact;
    exact.depth = sigma * way / c;
    /* from in front, light comes through 0.3 before it is at the near plane; from behind, through 0.7 */
    exact.radiance = ISOTROPIC * sigma / c * exp(-sigma * (backlit ? way : 0.3));
    exact.radiance *= per_z > 0 ? -expm1(-per_z * way) / per_z : way;
    exact.distance = (eye - 0.2) / c + way / c * (1 / exact.depth - 1 / expm1(exact.depth));
    return exact;
}

/* A near plane amid uniform gas in slabs of three voxels, of which it leaves a part, lit from the front and from behind
   (back to front): for parallel rays, for kernels in perspective, and for kernels so near that they are integrated
   along each pixel's ray; and the same gas classified, in parts of thin slabs. */
static void test_near_plane(void) {
    static const double eyes[3] = {2, 5, 2}, angles[3] = {0, 0.08, 0.2};
    static const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {2, {1, 1, 1}, 3, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    const double sigma = 1.5, ripple = 0.002, blur = 0.65 / 12;
    for (int n = 0; n < 12; ++n) {
        const int view = n / 2 % 3, classified = n / 6;
        const double eye = eyes[view], angle = angles[view], slab = (classified ? 0.4 : 3.0) / 12;
        check_scene s;
        sps_volume *gas;
        check_clear(&s, 8, 8);
        s.view.camera.position[2] = eye;
        check_orthographic(&s.view.camera, 0.4);
        check_perspective(&s.view.camera, angle);
        s.view.near_distance = eye - 0.2;
        s.view.quality = SPS_QUALITY_HIGH;
        s.view.slab_thickness = 12 * slab;
        gas = check_add_volume(&s, 24, 24, 12, check_box(-1, -1, -0.5, 1, 1, 0.5));
        gas->read_fn = check_read_constant, gas->user = &one;
        gas->extinction = (float)sigma;
        check_color(gas->albedo, 1, 1, 1);
        if (classified) gas->transfer = &transfer;
        check_add_directional(&s, 0, 0, n % 2 ? 1 : -1, 1);
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        for (int i = 0; i < 64; ++i) {
            const double pitch = 2 * tan(0.5 * angle) / 8, x = (i % 8 - 3.5) * pitch, y = (i / 8 - 3.5) * pitch;
            const behind_near exact = exact_behind_near(1 / sqrt(1 + x * x + y * y), eye, sigma, n % 2);
            const double left = exp(-exact.depth), in_and_out = sigma + exact.depth;
            /* A kernel in perspective is splatted as if rays were parallel throughout it, with the spacing at its
               middle: a share of 2 s / t is missing or too much at s before or behind that, which cancels except at a
               cut, where it amounts to twice the variance over t, of a unit of gas. */
            const double cut = view == 1 ? 2 * blur * blur / (eye - 0.2) * sigma : 0;
            /* Ripple is that of optical depths, on the way in and out. Since light and eye pass through the same gas,
               their attenuation does not depend on its distribution between the faces: soft faces and thick slabs only
               change distances. At the far face the visible light is s T(s) sigma, whose slope times half the variance
               of the kernel and of a slab is that change. */
            const double moved = 0.5 * (blur * blur + slab * slab / 12) * sigma * left * (1 + exact.depth);
            const int good = CHECK_NEAR((double)image_a[4 * i + 3], 1 - left, left * (exact.depth * ripple + cut)) &&
                             CHECK_CASE("Found in review", "near plane amid gas, lit from the front and from behind",
                                        "closed form", fabs((double)image_a[4 * i] - exact.radiance),
                                        exact.radiance * ((1 + in_and_out) * ripple + cut / exact.depth),
                                        "ripple of both ways; kernels in perspective at the cut") &&
                             CHECK_NEAR((double)depth_a[i], exact.distance, (moved + cut) / (1 - left) + ripple);
            if (!good)
                printf("    view %d, %s, %s, pixel %d\n", view, n % 2 ? "backlit" : "lit from in front",
                       classified ? "classified" : "gas", i);
        }
    }
}

/* A plate's shadow whose edge runs at an angle through thick slabs of thin gas. The plate lies at height 0.8 behind
   z = 0.514 with its edge along x, so that the shadow begins at z = 0.643 y and pixels see the lit gas in front of
   that. Each of a slab's four parts is lit as at its middle: so the lit length is right to half a part, and to two
   texels of the depth map, 1024 across at most 2.5 units. The gas's own attenuation is less than its optical depth on
   both paths. */
static void test_shadow_in_slab(void) {
    static const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 1e-3f, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    static const double corner[3] = {-3, 0.8, -3}, along[3] = {6, 0, 0}, back[3] = {0, 0, 3.0 + 0.45 / 0.7 * 0.8};
    const double sigma = 1e-3, ripple = 0.004, light[3] = {-0.7, -0.7, -0.45};
    const double steep = sqrt(0.5 + 0.5 * 0.45 / vec_length(light)); /* cosine between the view and the slabs' normal */
    for (int classified = 0; classified < 2; ++classified) {
        const double part = (classified ? 0.7 : 2) / 12 / steep / 4, texels = 2 * 2.5 / 1024 / 0.84;
        check_scene s;
        check_triangles triangles;
        sps_volume *gas;
        memset(&triangles, 0, sizeof triangles);
        check_clear(&s, 8, 24);
        check_orthographic(&s.view.camera, 0.5);
        gas = check_add_volume(&s, 12, 12, 12, unit_box);
        gas->read_fn = check_read_constant, gas->user = &one;
        gas->extinction = (float)sigma;
        check_color(gas->albedo, 1, 1, 1);
        if (classified) gas->transfer = &transfer;
        check_add_quad(&triangles, corner, along, back);
        check_add_mesh(&s, &triangles, 0.5);
        check_add_directional(&s, light[0], light[1], light[2], 1);
        s.view.slab_thickness = classified ? 0 : 2;
        if (check_render(context, &s, image_a))
            for (int i = 0; i < 8 * 24; ++i) {
                const double y = (11.5 - i / 8) * 0.5 / 24, lit = 0.5 - 0.45 / 0.7 * y;
                const double room = 0.5 * part + texels + lit * (ripple + 2.5 * sigma);
                if (!CHECK_CASE("Found in review", "edge of a plate's shadow through thick slabs", "the lit length",
                                fabs((double)image_a[4 * i] / (ISOTROPIC * sigma) - lit), room,
                                "half of a quarter of a slab; two texels; ripple"))
                    printf("    at height %g, %s\n", y, classified ? "classified" : "gas");
            }
        check_free_triangles(&triangles);
    }
}

int main(void) {
    context = check_context(NULL);
    RUN(test_image_sizes);
    RUN(test_flat_voxels);
    RUN(test_grazing_rays);
    RUN(test_grazing_corners);
    RUN(test_lamp);
    RUN(test_tiny_lamp);
    RUN(test_turning_light);
    RUN(test_steep_onset);
    RUN(test_lobes_alone);
    RUN(test_finest_counts);
    RUN(test_slender_voxels);
    RUN(test_two_tables);
    RUN(test_highlight);
    RUN(test_faces_of_volume);
    RUN(test_chunk_seams);
    RUN(test_brick_seams);
    RUN(test_back_to_front);
    RUN(test_near_plane);
    RUN(test_shadow_in_slab);
    sps_destroy(context);
    return check_report();
}
