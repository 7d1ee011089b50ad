/* Emission by value: transfer functions whose points emit. Against closed forms, against gas whose emission is
   proportional to its value, and against random paths. */

#include "check.h"
#include "flames.h"

enum { RINGS = 64, FLOOR = 40, SIDE = 24, BOX = 6, FINE = 33, MIDDLE = 4 * 4 }; /* MIDDLE: of 3 x 3 pixels */

static sps_context *context;
static float rgba[4 * RINGS * RINGS], other[4 * RINGS * RINGS];

/* --- closed forms --- */

/* A box of even values, filled by `points`. */
static void even_box(check_scene *s, const sps_transfer *transfer, float *value) {
    check_clear(s, 3, 3);
    check_orthographic(&s->view.camera, 0.3);
    sps_volume *volume = check_add_volume(s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_constant, volume->user = value;
    volume->transfer = transfer;
}

/* Extinction and emission rise together with the value, so that a ray through an even box shows emission / extinction *
   (1 - exp(-depth)) whatever the kernels do at its faces. Kernels ripple by 0.4 %, twice that at these faces' rims. */
static void test_box(void) {
    sps_transfer_point points[2] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 4, {3, 2, 1}}};
    const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    check_scene s;
    float value = 0.5f;
    even_box(&s, &transfer, &value);
    for (int filling = SPS_FILLING_AUTO; filling <= SPS_FILLING_GATHER; ++filling)
        for (int clear = 0; clear < 2; ++clear) {
            const double depth = clear ? 0 : 4, seen = clear ? 1 : -expm1(-depth) / depth;
            points[1].extinction = (float)depth;
            s.view.filling = (sps_filling)filling;
            if (!check_render(context, &s, rgba)) return;
            for (int c = 0; c < 3; ++c)
                CHECK_CASE("Volumes", "box that emits by value, each way of filling", "closed form; relative",
                           fabs((double)rgba[MIDDLE + c] / ((3 - c) * seen) - 1), 4e-3, "kernels' ripple");
            CHECK_NEAR((double)rgba[MIDDLE + 3], -expm1(-depth), 4e-3);
        }
}

/* Emission does not depend on the value where points say so, is interpolated between them and constant beyond; by
   callback likewise. Of nothing, there is none. The box is two units deep. */
static int peak(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) out[i].emission[1] = values[i] > 0.25f && values[i] < 0.75f ? 2 : 0;
    return 0;
}

static void test_values(void) {
    static const sps_transfer_point points[3] = {
        {0, {0, 0, 0}, 0, {4, 4, 4}}, {0.5f, {0, 0, 0}, 0, {4, 4, 4}}, {1, {0, 0, 0}, 0, {6, 4, 8}}};
    static const struct {
        float value, seen[3];
    } rows[] = {{0, {0, 0, 0}}, {0.25f, {4, 4, 4}}, {0.75f, {5, 4, 6}}, {2, {6, 4, 8}}};
    const sps_transfer by_points = {points, 3, NULL, NULL, 0}, by_callback = {NULL, 0, peak, NULL, 0};
    check_scene s;
    float value;
    even_box(&s, &by_points, &value);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i) {
        value = rows[i].value;
        if (!check_render(context, &s, rgba) || !check_march(context, &s, 0.25, other, NULL)) return;
        /* kernels, which end 2.15 voxels from their centres, reach 1.65 voxels of 1 / 12 beyond each face; the
           reference's end at 3.25 */
        for (int c = 0; c < 3; ++c) {
            CHECK_NEAR((double)rgba[MIDDLE + c], (2 + 1.65 / 12) * (double)rows[i].seen[c],
                       1.65 / 12 * (double)rows[i].seen[c]);
            CHECK_NEAR((double)other[MIDDLE + c], (2 + 2.75 / 12) * (double)rows[i].seen[c],
                       2.75 / 12 * (double)rows[i].seen[c]);
        }
    }
    value = 0.5f;
    s.volume[0].transfer = &by_callback;
    if (!check_render(context, &s, rgba)) return;
    CHECK_NEAR((double)rgba[MIDDLE + 1], 4, 0.6); /* at the faces, less than two voxels have values of the peak */
    CHECK(rgba[MIDDLE] <= 0 && rgba[MIDDLE + 2] <= 0 && rgba[MIDDLE + 3] <= 0);
}

/* Vectors and single values look up the same: nothing for 0, lines between entries, the last entry beyond it. Entries
   differ by up to 1, so that floats are off by 2048 * 2^-24 at most in place, and by as much in emission. */
static void test_table(void) {
    static spsi_glow_table glow;
    check_random random = {11};
    spsi_material material;
    memset(&material, 0, sizeof material);
    material.glow = &glow, material.table_scale = 0.5f * SPSI_TABLE_SIZE;
    for (int i = 0; i <= SPSI_TABLE_SIZE; ++i)
        for (int c = 0; c < 3; ++c) glow[i][c] = (float)check_next(&random);
    for (int n = 0; n < 500; ++n) {
        const float value = n < 4 ? 0.8f * (float)n : (float)(2.2 * check_next(&random));
        float lanes[SPSI_LANES];
        double single[4];
        spsi_v out[3];
        spsi_classify_emission(&material, spsi_set(value), out);
        spsi_emission_at_value(&material, (double)value, single);
        for (int c = 0; c < 3; ++c) {
            spsi_store(lanes, out[c]);
            CHECK_NEAR((double)lanes[SPSI_LANES - 1], n == 0 ? 0 : single[c], 2.5e-4);
        }
    }
}

/* --- as gas --- */

static int render(const flames *f, float *out) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = out;
    return CHECK_OK(context, sps_render(context, &f->scene, &f->view, &image));
}

/* What a flame throws on haze or on a floor is what it throws as a gas: voxels' sums are the same numbers. Directly
   seen, a classified volume with several voxels per pixel is sampled; those pixels are left out. The ball is cropped,
   by which gas and classified emission lose the same. */
static void test_flame(void) {
    for (int n = 0; n < (check_long() ? 3 : 2); ++n) {
        flames *f =
            n == 0 ? flames_rings(RINGS, 0) : flames_floor(FLOOR, 1, 8, n == 1 ? FLAMES_ALONE : FLAMES_IN_SMOKE);
        sps_volume *flame = &f->volumes[0];
        sps_transfer_point points[2] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 0, {0, 0, 0}}};
        const sps_transfer transfer = {points, 2, NULL, NULL, 0};
        const int width = f->view.width, height = f->view.height;
        static const int crop[6] = {9, 5, 0, FLAME_SIDE, 27, FLAME_SIDE};
        double worst = 0, sums[2] = {0, 0};
        points[1].extinction = flame->extinction;
        for (int i = 0; i < 2; ++i) memcpy(points[i].albedo, flame->albedo, sizeof flame->albedo);
        memcpy(points[1].emission, flame->emission, sizeof flame->emission);
        if (n > 0) memcpy(flame->crop, crop, sizeof crop);
        if (!render(f, rgba)) return;
        flame->transfer = &transfer;
        if (!render(f, other)) return;
        for (int i = 0; i < width * height; ++i) {
            double point[3];
            if (n > 0) flames_floor_point(f, i % width, i / width, point);
            if (n > 0 ? flames_ball_before(f, point) : hypot(i % width - width / 2, i / width - height / 2) < 8)
                continue;
            for (int c = 0; c < 3; ++c) {
                worst = fmax(worst, fabs((double)other[4 * i + c] / (double)rgba[4 * i + c] - 1));
                sums[0] += (double)rgba[4 * i + c], sums[1] += (double)other[4 * i + c];
            }
        }
        if (n == 2) worst = fabs(sums[1] / sums[0] - 1);
        if (figures()) printf("flame %d: as gas within %g\n", n, worst);
        CHECK_CASE("Volumes", "light of a flame by value", "as that of a gas; relative", worst, n < 2 ? 1.5e-4 : 0.01,
                   "sharpening raises differences of 1e-4, threefold at most; in smoke, the mean: cells are 2 % off "
                   "themselves");
        free(f);
    }
}

/* More than 32768 voxels send their light in blocks of 2^3, each from where it emits, with the color of all eight.
   Layers of 1 emit as a gas does, those of 2 between them do not: a block would lie 1/6 of a voxel or more aside if
   values decided, which changes light by 1 % at 33 voxels. Blocks have voxels' first and second moments, so that the
   rest is of third order, below (1 / 33)^3. */
static void test_blocks(void) {
    static float voxels[FINE * FINE * FINE];
    static const sps_transfer_point points[3] = {
        {0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 0, {100, 60, 20}}, {2, {0, 0, 0}, 0, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    flames *f = flames_floor(8, 0.32, 4, FLAMES_ALONE);
    double worst = 0;
    for (int k = 0; k < 3; ++k) f->volumes[0].size[k] = f->grids[0].size[k] = FINE;
    f->grids[0].voxels = voxels;
    f->view.scattering_resolution = 4;
    for (int n = 0; n < 2; ++n) {
        for (int i = 0; i < FINE * FINE * FINE; ++i) voxels[i] = i / FINE % FINE % 2 ? 2 * (float)n : 1;
        if (n) f->volumes[0].transfer = &transfer;
        if (!render(f, n ? other : rgba)) return;
    }
    for (int i = 0; i < 8 * 8; ++i) {
        if (i / 8 > 0 && i / 8 < 7 && i % 8 > 0 && i % 8 < 7) continue; /* the box is seen there */
        for (int c = 0; c < 3; ++c) worst = fmax(worst, fabs((double)other[4 * i + c] / (double)rgba[4 * i + c] - 1));
    }
    if (figures()) printf("blocks: as gas within %g\n", worst);
    CHECK(worst < 3e-5);
    free(f);
}

/* --- against paths --- */

static double lump(const void *user, const double p[3]) {
    const double sharp = *(const double *)user;
    return exp(-sharp * (p[0] * p[0] + 2 * p[1] * p[1] + p[2] * p[2]));
}

/* A flame whose emission rises with the fourth power of its value, in smoke. */
static int fourth(void *user, size_t count, const float *values, sps_transfer_point *out) {
    const float *most = (const float *)user;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            out[i].emission[c] = most[c] * values[i] * values[i] * values[i] * values[i];
            out[i].albedo[c] = 0.8f - 0.2f * (float)c;
            out[i].extinction = 2 * values[i];
        }
    return 0;
}

static void test_paths(void) {
    static float most[3] = {12, 6, 2};
    static const double sharp = 3;
    static const sps_transfer transfer = {NULL, 0, fourth, most, 0};
    check_scene s;
    check_triangles ground;
    check_field field;
    memset(&ground, 0, sizeof ground), memset(&field, 0, sizeof field);
    field.value_fn = lump, field.user = &sharp;
    check_clear(&s, 24, 16);
    check_perspective(&s.view.camera, 0.25);
    sps_volume *volume = check_add_volume(&s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    volume->eval_fn = check_eval_field, volume->user = &field;
    volume->transfer = &transfer;
    check_add_puff(&s, 0.6);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    check_paths(context, &s, "flame by value in smoke", 16, 0.03);
    const double corner[3] = {-2, -0.9, -2}, u[3] = {0, 0, 4}, v[3] = {4, 0, 0};
    check_add_quad(&ground, corner, u, v);
    check_add_mesh(&s, &ground, 0.6);
    check_paths(context, &s, "flame by value in smoke over a ground", 16, 0.04);
    check_free_triangles(&ground);
}

/* Value of the box below at a distance from its middle along an axis, in voxels. */
static double box_profile(double x) {
    double sum = 0;
    for (int i = 0; i < BOX; ++i) sum += exp(-0.5 * pow((x - i - 0.5 + 0.5 * BOX) / SPSI_SIGMA, 2));
    return sum / (SPSI_SIGMA * sqrt(2 * SPSI_PI));
}

static int fourth_blue(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        out[i].emission[1] = 20 * values[i] * values[i] * values[i] * values[i];
        out[i].emission[2] = 2 * out[i].emission[1];
    }
    return 0;
}

/* Light of paths is that of the interpolated value. A box of 6^3 voxels, 12 times as far from the floor as it is wide,
   emits with the fourth power of its value, which is a product of three profiles; a gas emits with their first. Paths
   that begin at drawn points have the weight of emission / density, 1 at most and 0.5 in the mean: an error of 1.6 % at
   most in 64 * 64 of them, hence 5 %. Their means have no red. */
static void test_drawn(void) {
    static const sps_transfer transfer = {NULL, 0, fourth_blue, NULL, 0};
    flames *f = flames_floor(8, 4, 1, FLAMES_ALONE);
    sps_volume *box = &f->volumes[0];
    double sums[2][3] = {{0, 0, 0}, {0, 0, 0}}, first = 0, fourths = 0;
    for (double x = -0.5 * BOX - 4; x < 0.5 * BOX + 4; x += 0.01)
        first += box_profile(x), fourths += pow(box_profile(x), 4);
    for (int k = 0; k < 3; ++k) box->size[k] = f->grids[0].size[k] = BOX;
    for (int i = 0; i < BOX * BOX * BOX; ++i) f->flame[i] = 1;
    check_color(box->emission, 0, 20, 40);
    for (int n = 0; n < 2; ++n) {
        sps_reference_settings settings;
        sps_image image;
        memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
        settings.step = 1, settings.samples = 64, image.rgba = rgba;
        if (n == 1) box->transfer = &transfer;
        if (!CHECK_OK(context, sps_reference(context, &f->scene, &f->view, &settings, &image))) return;
        for (int i = 0; i < 8 * 8; ++i)
            for (int c = 0; c < 3; ++c) sums[n][c] += (double)rgba[4 * i + c];
    }
    for (int c = 1; c < 3; ++c) {
        if (figures()) printf("drawn: %g of %g\n", sums[1][c] / sums[0][c], pow(fourths / first, 3));
        CHECK_NEAR(sums[1][c] / sums[0][c], pow(fourths / first, 3), 0.05 * pow(fourths / first, 3));
    }
    free(f);
}

/* --- errors --- */

static void test_errors(void) {
    sps_transfer_point points[2] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 1, {0, 0, 0}}};
    sps_transfer transfer = {points, 2, NULL, NULL, 0};
    static const float wrong[] = {-1, 2e18f, NAN, INFINITY};
    check_scene s;
    float value = 0.5f;
    sps_error_info info;
    even_box(&s, &transfer, &value);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        points[1].emission[2] = wrong[i];
        check_fails(context, &s, rgba, SPS_ERROR_ARGUMENT, "transfer.points[1].emission");
        sps_get_error(context, &info);
        CHECK(strcmp(info.field, "transfer.points[1].emission") == 0 && (info.value == (double)wrong[i] || i == 2));
    }
}

int main(void) {
    context = sps_create(NULL, NULL);
    if (!CHECK(context)) return check_report();
    RUN(test_box);
    RUN(test_values);
    RUN(test_table);
    RUN(test_flame);
    RUN(test_blocks);
    RUN_LONG(test_paths);
    RUN(test_drawn);
    RUN(test_errors);
    sps_destroy(context);
    return check_report();
}
