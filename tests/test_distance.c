/* Gas far away: voxels from 4 pixels down to 1/64 of one, gathered or splatted, keep their mass, their coverage and
   their light, in pictures, maps and cells, and nothing jumps as a camera recedes. All against closed forms. */

#include "check.h"

enum { SIDE = 24, GRID = 16 };
static float image[4 * SIDE * SIDE];
static sps_context *context;

static const float one_value = 1;

/* --- layers --- */

/* An endless layer, for this picture, of an optical depth of 1. `pixels`: edge of a voxel. */
static sps_volume *add_layer(check_scene *s, int layers, double pixels) {
    const int across = (int)(1.7 * s->view.width / pixels);
    const double half = across * pixels / 2, thick = layers * pixels;
    sps_volume *volume =
        check_add_volume(s, across, across, layers, check_box(-half, -half, -thick / 2, half, half, thick / 2));
    volume->read_fn = check_read_constant;
    volume->user = (void *)(size_t)&one_value;
    volume->extinction = (float)(1 / thick);
    check_color(volume->albedo, 0.8, 0.8, 0.8);
    return volume;
}

/* Coverage is 1 - exp(-t). A sun of irradiance pi, single scattering: 0.8 / 4 (1 - exp(-2 t)) / 2 on the eye's side,
   0.8 / 4 t exp(-t) behind. Voxels' sums are exact but for the kernel's ripple, exp(-2 pi^2 0.65^2) = 2.4e-4 along each
   axis, and cut kernels', 0.4 %. In a slab of optical depth d, light is taken as linear: the curvature that is missing
   is d^2 / 12 of it. A level's voxel is a Gaussian with a deviation of 0.19 pixels or more, where that is least, so
   that a slab of half a pixel has d <= erf(0.25 / 0.19 / sqrt(2)) = 0.8 in one slab at worst, by symmetry the middle
   one; d^2 / 12 of what it sends, 0.8 of all, in both light and eye, of opposite signs for half of it: 0.01. */
static void check_layer(int layers, double pixels, int quality, int filling, int behind) {
    const double lit = behind ? 0.2 * exp(-1.0) : 0.1 * (1 - exp(-2.0)), covered = 1 - exp(-1.0);
    const float *middle = image + 4 * (4 * 8 + 4);
    check_scene s;
    check_clear(&s, 8, 8);
    check_set3(s.view.camera.position, 0, 0, 200);
    check_orthographic(&s.view.camera, 8);
    s.view.quality = (sps_quality)quality;
    s.view.filling = (sps_filling)filling;
    add_layer(&s, layers, pixels);
    check_add_directional(&s, 0, 0, behind ? 1 : -1, 3.14159265358979);
    if (!check_render(context, &s, image)) return;
    if (figures())
        printf("layer of %d, voxels of %.4f pixels, quality %d, filling %d, from %s: %+.3f %%, light %+.3f %%\n",
               layers, pixels, quality, filling, behind ? "behind" : "before", 100 * ((double)middle[3] / covered - 1),
               100 * ((double)middle[0] / lit - 1));
    if (!CHECK_CASE("Extremes", "layers of voxels from 0.7 to 1/64 of a pixel", "1 - exp(-1) of coverage",
                    fabs((double)middle[3] / covered - 1), 0.005, "kernels that are cut at 3.3 deviations") ||
        !CHECK_CASE("Extremes", "layers of voxels from 0.7 to 1/64 of a pixel, lit from before and behind",
                    "closed forms of single scattering", fabs((double)middle[0] / lit - 1), 0.01,
                    "light is linear within a slab"))
        printf("    layer of %d, voxels of %g pixels, quality %d, filling %d, behind %d\n", layers, pixels, quality,
               filling, behind);
}

static void test_layers(void) {
    static const double pixels[] = {0.7, 0.35, 0.3, 0.2, 0.15, 0.1, 0.06, 1.0 / 32, 1.0 / 64};
    for (int n = 0; n < 9; ++n)
        for (int layers = 1; layers <= 4; layers += 3)
            for (int kind = 0; kind < 8; ++kind) {
                if (pixels[n] < 0.06 && (kind > 1 || layers > 1)) continue; /* millions of voxels */
                check_layer(layers, pixels[n], 1 + kind % 4, kind < 4 ? SPS_FILLING_AUTO : kind % 2 + 1, kind % 2);
            }
}

/* Texels many voxels wide: a light has more rays in each before it takes a coarser level than the eye, on which the
   layer would be wider, and shade what the eye sees of it. As in check_layer. */
static void test_wide_texels(void) {
    for (int behind = 0; behind < 2; ++behind) {
        const double lit = behind ? 0.2 * exp(-1.0) : 0.1 * (1 - exp(-2.0));
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 0, 200);
        check_orthographic(&s.view.camera, SIDE);
        add_layer(&s, 4, 1);
        check_add_directional(&s, 0, 0, behind ? 1 : -1, 3.14159265358979);
        s.view.shadow_resolution = 8;
        if (!check_render(context, &s, image)) return;
        CHECK_NEAR((double)image[4 * (SIDE / 2 * SIDE + SIDE / 2)], lit, 0.01 * lit);
    }
}

/* --- mass --- */

typedef enum shape { LONE, SHEET, CUBE, BLOB, LONG, SHAPES } shape;
static const char *const shape_names[] = {"a lone voxel", "a sheet", "a cube", "a blob", "a lone long voxel"};

/* Fills voxels. Returns their sum. */
static double fill(shape kind, float *values) {
    double sum = 0;
    for (int n = 0; n < GRID * GRID * GRID; ++n) {
        const double x = n % GRID - 7.5, y = n / GRID % GRID - 7.5, z = n / (GRID * GRID) - 7.5;
        const int lone = n == (7 * GRID + 8) * GRID + 7;
        values[n] = kind == BLOB ? (float)exp(-0.04 * (x * x + y * y + z * z)) : kind == SHEET ? z > 3 && z < 4 : 1;
        if (kind == LONE || kind == LONG) values[n] = (float)lone;
        sum += (double)values[n];
    }
    return sum;
}

/* A faint volume whose middle is at (x, y). The sum over pixels of -log(1 - coverage) is then, in closed form, the
   extinction times the sum of values times a voxel's volume: FAINT. */
#define FAINT 1e-4
static void start_volume(check_scene *s, shape kind, double pixels, double x, double y) {
    static float values[GRID * GRID * GRID];
    static check_array array = {values, {GRID, GRID, GRID}, 0, 0};
    const double half = GRID * pixels / 2, high = kind == LONG ? 4 * half : half, total = fill(kind, values);
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 0, 0, 200);
    check_orthographic(&s->view.camera, SIDE);
    check_add_volume(s, GRID, GRID, GRID, check_box(x - half, y - half, -high, x + half, y + half, high));
    s->volume[0].read_fn = check_read_array;
    s->volume[0].user = &array;
    s->volume[0].extinction = (float)(FAINT / (total * pixels * pixels * pixels * high / half));
}

/* Of a picture, as a share of that. */
static double mass_of(const check_scene *s) {
    double sum = 0;
    if (!check_render(context, s, image)) return 0;
    for (int i = 0; i < SIDE * SIDE; ++i) sum -= log1p(-(double)image[4 * i + 3]);
    return sum / FAINT;
}

/* Samples a distance apart take a wave of that length for more: a Gaussian of variance v, in squares of that distance,
   is off by 2 exp(-2 pi^2 v) along each axis. Footprints are divided by that, whose cosine is known to 2 % of 0.029;
   kernels that end at 3.3 deviations hold 0.4 % less, of which their pixels miss some and others have too much. A
   level's voxel has a variance of 1.59 * 0.125 / 4 or more, of which nine rays a third of a pixel apart make 0.447: off
   by 6e-4; two that swing, as good as four, 1.59 * 0.25: 0.0016; with 4 taps, which end at 2 voxels, 0.5 % more. */
static void check_mass(shape kind, double pixels, int quality, int filling) {
    static const double places[3][2] = {{0.05, 0.1}, {0.38, 0.43}, {0.72, 0.27}};
    for (int n = 0; n < 3; ++n) {
        double mass;
        check_scene s;
        start_volume(&s, kind, pixels, places[n][0], places[n][1]);
        s.view.quality = (sps_quality)quality;
        s.view.filling = (sps_filling)filling;
        mass = mass_of(&s);
        if (figures())
            printf("%s of %.4f pixels, quality %d, filling %d: %+.3f %%\n", shape_names[kind], pixels, quality, filling,
                   100 * (mass - 1));
        if (!CHECK_CASE("Extremes", "faint volumes of voxels from 1/2 to 1/64 of a pixel, and lone voxels",
                        "sum over pixels: that over voxels", fabs(mass - 1), 0.01,
                        "samples of what is hardly wider than they lie apart"))
            printf("    %s of %g pixels, quality %d, filling %d\n", shape_names[kind], pixels, quality, filling);
    }
}

static void test_mass(void) {
    static const double pixels[] = {0.5, 0.25, 0.18, 0.125, 0.09, 0.0625, 0.044, 1.0 / 32, 1.0 / 45, 1.0 / 64};
    for (int n = 0; n < 10; ++n)
        for (int kind = 0; kind < SHAPES; ++kind) {
            check_mass((shape)kind, pixels[n], SPS_QUALITY_MEDIUM, SPS_FILLING_AUTO);
            check_mass((shape)kind, pixels[n], n % 2 ? SPS_QUALITY_HIGH : SPS_QUALITY_ULTRA, SPS_FILLING_AUTO);
            check_mass((shape)kind, pixels[n], SPS_QUALITY_MEDIUM, SPS_FILLING_SPLAT);
            /* gathered, lone voxels of half a pixel and long ones have aliases, which AUTO avoids */
            if (kind != LONG && n > 1) check_mass((shape)kind, pixels[n], SPS_QUALITY_MEDIUM, SPS_FILLING_GATHER);
        }
}

/* Even gas in voxels of a size at which what is done for lone ones would beat with the pixels: ripples of kernels, and
   of what cut ones lack. */
static void test_even(void) {
    for (double pixels = 0.4; pixels < 1.2; pixels *= 1.07) {
        double low = 1, high = 0;
        check_scene s;
        check_clear(&s, 16, 16);
        check_set3(s.view.camera.position, 0.3, 0.1, 200);
        check_orthographic(&s.view.camera, 16);
        s.view.quality = SPS_QUALITY_HIGH;
        s.view.filling = SPS_FILLING_SPLAT;
        add_layer(&s, 2, pixels);
        if (!check_render(context, &s, image)) return;
        for (int i = 0; i < 16 * 16; ++i) {
            low = fmin(low, -log1p(-(double)image[4 * i + 3]));
            high = fmax(high, -log1p(-(double)image[4 * i + 3]));
        }
        if (!CHECK_CASE("Extremes", "even gas, splatted, of voxels from 0.4 to 1.2 pixels", "an even picture",
                        high - low, 0.008, "kernels' ripple, and 0.2 % of what they even out"))
            printf("    voxels of %g pixels: %g to %g\n", pixels, low, high);
    }
}

/* --- a camera that recedes --- */

/* Renders a blob under a sun. Sums coverage and light per solid angle, in voxels. */
static int sum_blob(double pixels, double extinction, double sums[2]) {
    const double angle = 0.3, edge = 2.0 / GRID, distance = edge * SIDE / (2 * tan(angle / 2) * pixels);
    check_scene s;
    start_volume(&s, BLOB, edge, 0, 0);
    check_set3(s.view.camera.position, 0.1 * distance, 0.05 * distance, distance);
    check_perspective(&s.view.camera, angle);
    s.volume[0].extinction = (float)extinction;
    check_color(s.volume[0].albedo, 0.8, 0.8, 0.8);
    check_add_directional(&s, 1, -1, -1, 3);
    sums[0] = sums[1] = 0;
    if (!check_render(context, &s, image)) return 0;
    for (int i = 0; i < SIDE * SIDE; ++i) {
        sums[0] += (double)image[4 * i + 3] / (pixels * pixels);
        sums[1] += (double)image[4 * i] / (pixels * pixels);
    }
    if (figures()) printf("voxels of %.4f pixels: %.5f %.5f\n", pixels, sums[0], sums[1]);
    return 1;
}

/* A blob of an optical depth of up to 0.3, from 4 pixels a voxel to 1/64, in 200 frames. Coverage and light change from
   frame to frame by no more than 0.5 %; over a frame's 2.8 % of distance, what the filter covers more of a dense blob
   as it shrinks is below 0.1 %. */
static void test_receding(void) {
    double before[2] = {0, 0}, most = 0;
    for (int frame = 0; frame < 200; ++frame) {
        const double pixels = 4 * pow(256, -frame / 199.0);
        double sums[2];
        if (!sum_blob(pixels, 0.25, sums)) return;
        for (int k = 0; k < 2 && frame > 70; ++k) { /* all of it is in the picture */
            const double step = fabs(sums[k] / before[k] - 1);
            most = fmax(most, step);
            if (!CHECK_CASE("Extremes", "a blob from which the camera recedes, 200 frames", "no steps of its light",
                            step, 0.005, "a level passes into the next along a factor of 1.4"))
                printf("    frame %d, voxels of %g pixels\n", frame, pixels);
        }
        memcpy(before, sums, sizeof before);
    }
    if (figures()) printf("receding: steps of %.3f %% at most\n", 100 * most);
}

/* exp(-r^2 / 0.18). */
static int read_dense(void *user, size_t count, const double *points, float *values) {
    (void)user;
    for (size_t i = 0; i < count; ++i, points += 3)
        values[i] = (float)exp(-(points[0] * points[0] + points[1] * points[1] + points[2] * points[2]) / 0.18);
    return 0;
}

/* A scene of gas in a cube, without lights. */
static void start_cube(check_scene *s, int pixels, int voxels, int (*eval_fn)(void *, size_t, const double *, float *),
                       float extinction) {
    check_clear(s, pixels, pixels);
    check_add_volume(s, voxels, voxels, voxels, check_box(-1, -1, -1, 1, 1, 1));
    s->volume[0].eval_fn = eval_fn;
    s->volume[0].extinction = extinction;
    s->volume[0].revision = (uint64_t)voxels; /* the same gas in all frames */
    check_color(s->volume[0].albedo, 0.9, 0.9, 0.9);
    s->view.scattering = SPS_SCATTERING_SINGLE;
}

/* A dense one, of 64^3 voxels and an optical depth of 3 in the middle, in frames 1/256 of an octave apart, about the
   distance at which a level begins to fade in. It covers more the wider the filter is: by up to a half over the half
   octave that a level takes, in 128 parts, of which a frame has one. How thick slabs are, and whether the sun has a
   table, must not depend on how far levels reach. */
static void test_receding_dense(void) {
    for (int n = 0; n < 2; ++n) {
        double before[2] = {0, 0};
        for (int frame = 0; frame < 6; ++frame) {
            const double pixels = 0.048 * pow(2, -frame / 256.0);
            const double high = SIDE / (32 * pixels);
            double sums[2] = {0, 0};
            check_scene s;
            start_cube(&s, SIDE, 64, read_dense, 4);
            check_add_directional(&s, 1, -1, -0.4, 5);
            check_set3(s.view.camera.position, 1.5 * high, high, 4.7 * high);
            check_set3(s.view.camera.target, 0.3 * high / SIDE, 0, 0);
            check_orthographic(&s.view.camera, high);
            s.view.scattering_resolution = 16;
            if (n == 0) s.view.scattering = SPS_SCATTERING_AUTO;
            if (!check_render(context, &s, image)) return;
            for (int i = 0; i < SIDE * SIDE; ++i) {
                sums[0] += (double)image[4 * i + 3] * high * high;
                sums[1] += (double)image[4 * i] * high * high;
            }
            if (figures()) printf("%d: voxels of %.4f pixels: %.5f %.5f\n", n, pixels, sums[0], sums[1]);
            for (int k = 0; k < 2 && frame > 0; ++k)
                if (!CHECK_CASE("Extremes", "a dense blob where a level fades in", "no steps of its light",
                                fabs(sums[k] / before[k] - 1), 0.005, "1 of 128 parts of 0.5"))
                    printf("    voxels of %g pixels\n", pixels);
            memcpy(before, sums, sizeof before);
        }
    }
}

/* 1 to 1.5 within a ball of a radius of 0.9; nothing outside. */
static int read_ball(void *user, size_t count, const double *points, float *values) {
    (void)user;
    for (size_t i = 0; i < count; ++i, points += 3) {
        const double *p = points;
        const double square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        values[i] = square < 0.8 ? (float)(1 + 0.5 * sin(9 * p[0]) * sin(7 * p[1]) * sin(8 * p[2])) : 0;
    }
    return 0;
}

/* Light of a dense ball in perspective, in 32nds of the picture's width and times the square of the distance; -1 after
   a failure. */
static double ball_light(double distance, int pixels) {
    static float picture[4 * 128 * 128];
    double sum = 0;
    check_scene s;
    start_cube(&s, pixels, 48, read_ball, 12);
    check_add_directional(&s, 0.5, -1, -0.3, 3);
    check_set3(s.view.camera.position, 0, 0.3 * distance, distance);
    check_perspective(&s.view.camera, 0.8);
    if (!check_render(context, &s, picture)) return -1;
    for (int i = 0; i < pixels * pixels; ++i) sum += (double)picture[4 * i];
    return sum * distance * distance * 1024 / (pixels * pixels);
}

/* A dense ball in perspective, where a level replaces another: far voxels need it before near ones allow it. At 6.786
   it sets in, whose reach may not change the light's texels. Frames are 1e-3 of the distance apart, 1/350 of the half
   octave in which the level fades in. It adds up to a third to the light: 0.1 % a frame, and no more than a few times
   as much where it is steep. At 3.7, where it hardly begins, a ball of 9 pixels is wider than in finer ones by a
   quarter of a pixel: 5.6 %, and as much as half of that for the level. */
static void test_receding_perspective(void) {
    static const double distances[] = {5.1443, 6.786, 6.976};
    const double found = ball_light(3.7, 32), exact = ball_light(3.7, 128);
    if (figures()) printf("perspective, distance 3.7: %.5f, in finer pixels %.5f\n", found, exact);
    CHECK(found > 0 && fabs(found / exact - 1) < 0.084);
    for (int n = 0; n < 3; ++n) {
        double before = 0;
        for (int frame = 0; frame < 5; ++frame) {
            const double distance = distances[n] * (1 + 1e-3 * (frame - 2)), sum = ball_light(distance, 32);
            if (figures()) printf("perspective, distance %.4f: %.5f\n", distance, sum);
            if (frame > 0 && !CHECK_CASE("Extremes", "a dense ball in perspective where a level replaces another",
                                         "no steps of its light", fabs(sum / before - 1), 0.005, "a part of a third"))
                printf("    distance %g\n", distance);
            before = sum;
        }
    }
}

/* --- maps, and cells --- */

/* Behind a layer of an optical depth of 1, a map's texels have 1. */
static void test_maps(void) {
    for (double pixels = 0.7; pixels > 0.05; pixels *= 0.7) {
        const double point[3] = {0.2, 0.3, -30};
        float depth = 0;
        sps_tmap_light light;
        sps_tmap_settings settings;
        sps_tmap *map = NULL;
        check_scene s;
        check_clear(&s, 16, 16);
        check_set3(s.view.camera.position, 0, 0, 50);
        check_orthographic(&s.view.camera, 16);
        add_layer(&s, 1, pixels);
        light = check_light_of(&s.view);
        memset(&settings, 0, sizeof settings);
        settings.far_depth = 100;
        if (CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map)) &&
            CHECK(!sps_tmap_add(map, &s.scene)) && CHECK(!sps_tmap_finish(map))) {
            sps_tmap_query(map, 1, point, &depth, NULL);
            if (!CHECK_CASE("Extremes", "maps of layers whose voxels are smaller than texels", "an optical depth of 1",
                            fabs((double)depth - 1), 0.005, "kernels that are cut at 3.3 deviations"))
                printf("    voxels of %g texels: %g\n", pixels, (double)depth);
        }
        sps_tmap_destroy(map);
    }
}

/* Light from cell to cell in a layer of an optical depth of 1 that is 40 pixels wide. Levels spread it over 2 pixels,
   as much as 2 * 40 * 2 / 40^2 = 10 % of its surface by its sides, by which half of what scatters again, a third of
   all, leaves in the rim alone: less than 5 % in the middle. What cells, a table and the eye see must be of one level.
 */
static void test_cells(void) {
    double light[2] = {0, 0};
    for (int splat = 0; splat < 2; ++splat) {
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 0, 200);
        check_orthographic(&s.view.camera, SIDE);
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        s.view.scattering_resolution = 44; /* finer cells than pixels show how thick levels are: 6 % with 256 */
        s.view.filling = splat ? SPS_FILLING_SPLAT : SPS_FILLING_AUTO;
        add_layer(&s, 1, 0.2);
        check_add_directional(&s, 0.3, 0.2, -1, 3);
        if (!check_render(context, &s, image)) return;
        light[splat] = (double)image[4 * (SIDE / 2 * SIDE + SIDE / 2)];
    }
    if (figures()) printf("cells: %g by levels, %g splatted\n", light[0], light[1]);
    CHECK_CASE("Extremes", "light from cell to cell in a layer of small voxels", "the same by levels as splatted",
               fabs(light[0] / light[1] - 1), 0.05, "more of a thicker layer's light leaves by its sides");
}

/* What a dense flame sends to a floor far from it does not depend on the size of pixels, in which the eye sees it as
   wide as 18 of its voxels. 0.5 %: cells hold the same, and
   a floor is interpolated between nine pixels of 0.6, over which its light changes by a third. */
static void test_far_flame(void) {
    static const double pixels[] = {1, 0.055}, origin[3] = {-40, -2, -40}, along[3] = {0, 0, 80}, side[3] = {80, 0, 0};
    double light[2] = {0, 0};
    for (int n = 0; n < 2; ++n) {
        check_triangles floor;
        check_scene s;
        start_volume(&s, BLOB, 0.033, 0, 0);
        s.volume[0].extinction = 20;
        for (int k = 0; k < 3; ++k) s.volume[0].emission[k] = 1;
        memset(&floor, 0, sizeof floor);
        check_add_quad(&floor, origin, along, side);
        check_add_mesh(&s, &floor, 0.5);
        check_set3(s.view.camera.position, 4, 200, 0), check_set3(s.view.camera.target, 4, 0, 0);
        check_set3(s.view.camera.up, 0, 0, 1);
        check_orthographic(&s.view.camera, 3 * 0.033 / pixels[n]);
        s.view.width = s.view.height = 3;
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        if (check_render(context, &s, image)) light[n] = (double)image[4 * 4];
        check_free_triangles(&floor);
    }
    if (figures()) printf("far flame: %g and %g\n", light[0], light[1]);
    CHECK_CASE("Extremes", "a floor lit by a dense flame whose voxels are 1/18 of a pixel", "that of one pixel a voxel",
               fabs(light[1] / light[0] - 1), 5e-3, "interpolation between pixels");
}

/* What was kept of other distances has no part in a picture. Voxels are kept, and the table of the last two, which are
   of one level; the others are not. */
static void test_kept(void) {
    static float again[4 * SIDE * SIDE];
    sps_context *own = check_context(NULL);
    sps_stats_report stats;
    for (int n = 0; n < 4; ++n) {
        static const double pixels[] = {0.06, 0.3, 0.1, 0.11};
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 0, 200);
        check_orthographic(&s.view.camera, 40 / pixels[n]);
        s.view.width = s.view.height = SIDE;
        start_volume(&s, BLOB, 1, 0, 0);
        check_orthographic(&s.view.camera, SIDE / pixels[n]);
        s.volume[0].extinction = 0.5f;
        s.volume[0].revision = 1;
        s.view.scattering = n % 2 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        check_color(s.volume[0].albedo, 0.8, 0.8, 0.8);
        check_add_directional(&s, 0, 0, -1, 3)->shadow_source = SPS_SHADOW_TABLE;
        check_render(own, &s, again);
        check_render_plain(&s, image);
        CHECK_CASE("Extremes", "a context that has rendered other distances, with tables and cells",
                   "that of a new one", memcmp(image, again, sizeof image) != 0, 0, "same bits");
        sps_get_stats(own, &stats);
        CHECK((stats.voxels_read > 0) == (n == 0) && (stats.tables_made > 0) == (n < 3) &&
              stats.tables_held == (uint64_t)(n / 3));
    }
    sps_destroy(own);
}

/* A small glowing volume behind the eye, by 1 to 4 pixels: voxels of a level reach further than it does, but nothing of
   it is seen. */
static void test_behind(void) {
    for (int n = 0; n < 5 * 3 * 4; ++n) {
        const double away = 1 + n / 15;
        double most = 0;
        check_scene s;
        check_clear(&s, 8, 8);
        add_layer(&s, 4, 0.1);
        s.volume[0].size[0] = s.volume[0].size[1] = 4;
        s.volume[0].placement = check_box(-0.2, -0.2, -0.2, 0.2, 0.2, 0.2);
        check_color(s.volume[0].emission, 1, 1, 1);
        check_set3(s.view.camera.position, 0, 0, -away);
        check_set3(s.view.camera.target, 0, 0, -100);
        check_orthographic(&s.view.camera, 8);
        s.view.quality = (sps_quality)(n % 5), s.view.filling = (sps_filling)(n / 5 % 3);
        check_render(context, &s, image);
        for (int i = 0; i < 4 * 8 * 8; ++i) most = fmax(most, (double)image[i]);
        CHECK(!(most > 0));
    }
}

int main(void) {
    context = check_context(NULL);
    RUN(test_layers);
    RUN(test_wide_texels);
    RUN(test_mass);
    RUN(test_even);
    RUN(test_receding);
    RUN(test_receding_dense);
    RUN(test_receding_perspective);
    RUN(test_maps);
    RUN(test_cells);
    RUN(test_far_flame);
    RUN(test_kept);
    RUN(test_behind);
    sps_destroy(context);
    return check_report();
}
