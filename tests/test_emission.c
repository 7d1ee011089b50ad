/* Emission by value: transfer functions whose points emit. Against closed forms, against gas whose emission is
   proportional to its value, and against random paths. */

#include "check.h"
#include "flames.h"

enum { RINGS = 64, FLOOR = 40, SIDE = 24, MIDDLE = 4 * 4 }; /* MIDDLE: of 3 x 3 pixels */

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
        if (!check_render(context, &s, rgba)) return;
        /* kernels, which end 2.15 voxels from their centres, reach 1.65 voxels of 1 / 12 beyond each face */
        for (int c = 0; c < 3; ++c)
            CHECK_NEAR((double)rgba[MIDDLE + c], (2 + 1.65 / 12) * (double)rows[i].seen[c],
                       1.65 / 12 * (double)rows[i].seen[c]);
    }
    value = 0.5f;
    s.volume[0].transfer = &by_callback;
    if (!check_render(context, &s, rgba)) return;
    CHECK_NEAR((double)rgba[MIDDLE + 1], 4, 0.6); /* at the faces, less than two voxels have values of the peak */
    CHECK(rgba[MIDDLE] <= 0 && rgba[MIDDLE + 2] <= 0 && rgba[MIDDLE + 3] <= 0);
}

/* --- as gas --- */

static int render(const flames *f, float *out) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = out;
    return CHECK_OK(context, sps_render(context, &f->scene, &f->view, &image));
}

/* What a flame throws on haze or on a floor is what it throws as a gas: voxels' sums are the same numbers. Directly
   seen, a classified volume with several voxels per pixel is sampled; those pixels are left out. */
static void test_flame(void) {
    for (int n = 0; n < (check_long() ? 3 : 2); ++n) {
        flames *f =
            n == 0 ? flames_rings(RINGS, 0) : flames_floor(FLOOR, 1, 8, n == 1 ? FLAMES_ALONE : FLAMES_IN_SMOKE);
        sps_volume *flame = &f->volumes[0];
        sps_transfer_point points[2] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 0, {0, 0, 0}}};
        const sps_transfer transfer = {points, 2, NULL, NULL, 0};
        const int width = f->view.width, height = f->view.height;
        double worst = 0, sums[2] = {0, 0};
        points[1].extinction = flame->extinction;
        for (int i = 0; i < 2; ++i) memcpy(points[i].albedo, flame->albedo, sizeof flame->albedo);
        memcpy(points[1].emission, flame->emission, sizeof flame->emission);
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
        CHECK_CASE("Volumes", "light of a flame by value", "as that of a gas; relative", worst, n < 2 ? 1e-4 : 0.01,
                   "in smoke, the mean: cells are filled from thinner slabs, and are 2 % off themselves");
        free(f);
    }
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
    check_run("box", test_box);
    check_run("values", test_values);
    check_run("flame", test_flame);
    check_run("paths", test_paths);
    check_run("errors", test_errors);
    sps_destroy(context);
    return check_report();
}
