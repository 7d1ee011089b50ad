/* Small pictures: lights' sheets and slabs that are as fine as pixels call for, not as voxels do; what a picture's size
   does not change; and errors against the means of a large picture's pixels. */

#include "check.h"

enum { GRID = 64, LARGE = 240, COUNT = 4 * LARGE * LARGE };
static float large[COUNT], image_a[COUNT], image_b[COUNT];
static float lumps[GRID * GRID * GRID], one = 1;
static sps_context *context;
static check_triangles faces;

static const sps_transfer_point skin_points[3] = {{0.2f, {0.8f, 0.6f, 0.4f}, 0, {0, 0, 0}},
                                                  {0.3f, {0.8f, 0.6f, 0.4f}, 30, {0, 0, 0}},
                                                  {1, {0.9f, 0.9f, 0.9f}, 30, {0, 0, 0}}};
static const sps_transfer skin = {skin_points, 3, NULL, NULL, 0};

/* --- the plan --- */

enum { VOXELS = 200 };

/* A cube of edge 2, kernels apart, seen and lit along z. Splatted, it reaches as far as its kernels; a level of what is
   gathered reaches up to 2.7 pixels farther, which slabs and texels have to cover. */
static sps_volume *start_cube(check_scene *s, int size) {
    sps_volume *volume;
    check_clear(s, size, size);
    check_orthographic(&s->view.camera, 3);
    volume = check_add_volume(s, VOXELS, VOXELS, VOXELS, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = 1;
    check_color(volume->albedo, 1, 1, 1);
    check_add_directional(s, 0, 0, -1, 1);
    check_force_sheets(s);
    s->view.filling = SPS_FILLING_SPLAT;
    return volume;
}

static const double voxel = 2.0 / VOXELS, extent = 2 + 5 * 2.0 / VOXELS;

/* Rounding up adds up to one slab, and up to a pair of texels to two of border on either side. */
static void check_plan(const check_scene *s, double texel, double slab) {
    sps_plan_report plan;
    if (!CHECK_OK(context, sps_plan(context, &s->scene, &s->view, &plan))) return;
    if (!CHECK_NEAR(plan.shadow_width, extent / texel + 4 + 1, 1 + 1e-6) ||
        !CHECK_NEAR(plan.slab_count, extent / slab + 0.5, 0.5 + 1e-6))
        printf("    %d pixels, quality %d\n", s->view.height, (int)s->view.quality);
}

/* Texels are no finer than a share of a pixel, but there are 12 across the gas; slabs no thinner than another share,
   but there are 16. At high quality and beyond, those of classified volumes are as fine as voxels call for. So are
   those that the caller sets, as far as texels go: slabs are then no thicker than 8 of them. */
static void test_pixels(void) {
    static const struct {
        double share, thick, texels, slab; /* in pixels, and in voxels */
    } expected[2][5] = {{{0, 0, 0, 0}, {0.9, 1, 0.75, 2}, {0.6, 0.5, 1, 1}, {0.3, 0.25, 2, 0.5}, {0.3, 0.125, 4, 0.25}},
                        {{0, 0, 0, 0}, {0.5, 0.3, 1, 1.4}, {0.5, 0.3, 1.25, 0.7}, {0, 0, 2, 0.4}, {0, 0, 4, 0.2}}};
    for (int size = 4; size <= 1024; size *= 2)
        for (int n = 2; n < 10; ++n) {
            const int classified = n % 2, quality = n / 2;
            const double pixel = 3.0 / size, own = voxel * expected[classified][quality].slab;
            const double least = voxel / expected[classified][quality].texels;
            const double texel = fmin(fmax(least, expected[classified][quality].share * pixel), extent / 12);
            const double slab = fmax(own, fmin(expected[classified][quality].thick * pixel, extent / 16));
            check_scene s;
            sps_volume *volume = start_cube(&s, size);
            if (classified) volume->transfer = &skin;
            s.view.quality = (sps_quality)quality;
            check_plan(&s, texel, slab);
            s.view.slab_thickness = 1.5;
            check_plan(&s, texel, 1.5 * voxel);
            s.view.slab_thickness = 0;
            s.view.shadow_resolution = 504;
            check_plan(&s, extent / 499, fmax(own, fmin(slab, 8 * extent / 500)));
        }
}

/* The nearest part of the gas decides; what is nearer than the near plane is not seen, and an eye amid gas has pixels
   of any size before it. */
static void test_nearest(void) {
    const double distance = 10, across = 2 * tan(0.15) / 30;
    for (int n = 0; n < 4; ++n) {
        const double nearest = n == 0 ? distance - 0.5 * extent : n == 1 ? 9.8 : n == 2 ? 0 : 0.5;
        const double pixel = nearest * across;
        check_scene s;
        start_cube(&s, 30);
        check_perspective(&s.view.camera, 0.3);
        s.view.camera.position[2] = n < 2 ? distance : 0.9;
        if (n == 1) s.view.near_distance = 9.8;
        if (n == 3) s.view.near_distance = 0.5;
        check_plan(&s, fmax(voxel, 0.6 * pixel), fmax(voxel, 0.5 * pixel));
    }
}

static int planned_width(const check_scene *s) {
    sps_plan_report plan;
    CHECK_OK(context, sps_plan(context, &s->scene, &s->view, &plan));
    return plan.shadow_width;
}

/* Sheets of gas have as many texels as it has voxels, up to 4096 on the longer side, which its kernels make y here. */
static void test_most_texels(void) {
    for (int n = 0; n < 2; ++n) {
        sps_plan_report plan;
        check_scene s;
        start_cube(&s, 4096);
        check_orthographic(&s.view.camera, 1);
        s.volume[0].size[0] = n ? 8000 : 3001; /* odd: rounding to a pair of texels goes either way */
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        if (n == 0) CHECK_NEAR(plan.shadow_width, 3001 + 5 + 5, 1);
        if (n == 1) CHECK(plan.shadow_height == 4096);
    }
}

/* Polygons may show the gas's shadow nearer to the eye than the gas: all along the light's way as long as that is in
   the image. */
static void test_polygons(void) {
    static const double corner[3] = {-9, -2, -9}, u[3] = {0, 0, 18}, v[3] = {18, 0, 0};
    static const double ways[4][3] = {{0.3, -0.2, -1}, {0.6, -0.2, 0.5}, {0, -0.02, 1}, {1, -0.1, 0.001}};
    faces.count = 0;
    check_add_quad(&faces, corner, u, v);
    for (int n = 0; n < 4; ++n) {
        int gas, both, sharp;
        check_scene s;
        start_cube(&s, 30);
        check_perspective(&s.view.camera, 0.3);
        memcpy(s.light[0].direction, ways[n], sizeof ways[n]);
        gas = planned_width(&s);
        check_add_mesh(&s, &faces, 0.5);
        both = planned_width(&s);
        s.view.width = s.view.height = 1000;
        sharp = planned_width(&s);
        if (!CHECK(n == 0   ? both == gas
                   : n == 1 ? both > gas && both < sharp
                   : n == 2 ? both == sharp
                            : both - gas <= 2))
            printf("    way %d: %d texels, without polygons %d, in a large picture %d\n", n, both, gas, sharp);
    }
}

/* --- pictures --- */

static void start_lumps(check_scene *s, int size, int kind) {
    static check_array array = {lumps, {GRID, GRID, GRID}, 0, 0};
    sps_volume *volume;
    check_clear(s, size, size);
    check_set3(s->view.camera.position, 1.2, 0.9, 4);
    check_orthographic(&s->view.camera, 1.8);
    volume = check_add_volume(s, GRID, GRID, GRID, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_array;
    volume->user = &array;
    volume->revision = 1;
    volume->extinction = 6;
    check_color(volume->albedo, 0.9, 0.8, 0.7);
    if (kind > 0) volume->transfer = &skin;
    if (kind > 1) volume->shading = SPS_SHADING_SURFACE;
    check_add_directional(s, 1, -1, -0.6, 3);
    check_force_sheets(s);
}

/* Root mean square difference from the means of the large picture's pixels. */
static double preview_error(const float *image, int size) {
    const int times = LARGE / size;
    double sum = 0;
    for (int i = 0; i < size * size; ++i)
        for (int c = 0; c < 3; ++c) {
            double mean = 0;
            for (int n = 0; n < times * times; ++n) {
                const int x = i % size * times + n % times, y = i / size * times + n / times;
                mean += (double)large[4 * (y * LARGE + x) + c] / (times * times);
            }
            sum += pow((double)image[4 * i + c] - mean, 2) / (3 * size * size);
        }
    return sqrt(sum);
}

/* A small picture is off by what its pixels miss; half a pixel of blur in shadows, and what slabs of a fraction of one
   miss, add to that as independent errors do, of at most half of it: sqrt(1 + 1/4). Where texels or slabs become those
   of pixels, nothing jumps: there the two are alike, to a tenth. At high quality, shadows are blurred by a quarter of a
   pixel, slabs half as thick: of errors that grow with their squares, a quarter is left, sqrt(1 + 1/64). At draft, gas
   has slabs twice as thick and texels 1.5 times as wide: four times, sqrt(1 + 4). Its texels follow pixels of 1.5
   voxels and more, so that it is only alike as long as slabs are those of voxels, which they are up to 2. Tables are
   made from the levels that small pictures read, with one ray per texel. */
static void test_errors(void) {
    static const int sizes[10] = {8, 12, 16, 20, 24, 30, 40, 48, 60, 80};
    for (int n = 0; n < 6; ++n) {
        const int kind = n < 3 ? n : 0, high = n == 3, draft = n == 4;
        const double allowed = sqrt(1 + (high ? 1.0 / 64 : draft ? 4 : 0.25));
        sps_plan_report plan;
        check_scene s;
        start_lumps(&s, LARGE, kind);
        if (n == 5) s.light[0].shadow_source = SPS_SHADOW_TABLE;
        s.view.quality = SPS_QUALITY_HIGH;
        if (!check_render(context, &s, large)) return;
        s.view.quality = high ? SPS_QUALITY_HIGH : draft ? SPS_QUALITY_DRAFT : SPS_QUALITY_MEDIUM;
        s.view.width = s.view.height = 2 * LARGE;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan)); /* texels of voxels, of the gas that was read */
        for (int i = 0; i < 10; i += check_long() ? 1 : 2) {
            const double voxels = 1.8 / sizes[i] * GRID / 2; /* in a pixel */
            double error, exact;
            s.view.width = s.view.height = sizes[i];
            s.view.slab_thickness = 0, s.view.shadow_resolution = 0;
            if (!check_render(context, &s, image_a)) return;
            s.view.slab_thickness = high ? 0.5 : draft ? 2 : kind > 0 ? 0.7 : 1;
            s.view.shadow_resolution = spsi_imax(plan.shadow_width, plan.shadow_height);
            if (!check_render(context, &s, image_b)) return;
            error = preview_error(image_a, sizes[i]);
            exact = preview_error(image_b, sizes[i]);
            if (!CHECK(error <= allowed * exact) || !CHECK(voxels > (draft ? 2 : 2.7) || error <= 1.1 * exact))
                printf("    kind %d, %d pixels: %g, with texels of voxels %g\n", n, sizes[i], error, exact);
            if (figures())
                printf("kind %d, %2d pixels of %.2f voxels: error %.5f, with texels and slabs of voxels %.5f\n", n,
                       sizes[i], voxels, error, exact);
        }
    }
}

/* Lights' sheets are gathered as the plan says, with one ray per texel. What is classified has one sample in each slab.
   Voxels of a level are 0.54 texels wide at least, by their variance of 1/8, and steps are 0.8 of them: slabs of 0.5
   pixels, texels of 0.6 have two. Chunks of slabs are sampled as a whole, and one slab on either side. */
static void test_samples(void) {
    for (int classified = 0; classified < 2; ++classified) {
        sps_plan_report plan;
        sps_stats_report stats;
        check_scene s;
        double most;
        sps_volume *volume = start_cube(&s, 12);
        for (int k = 0; k < 3; ++k) volume->size[k] = GRID;
        if (classified) volume->transfer = &skin;
        volume->extinction = 0.1f; /* no ray ends */
        s.view.filling = SPS_FILLING_AUTO;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        if (!check_render(context, &s, image_a)) return;
        sps_get_stats(context, &stats);
        most = plan.shadow_width * (double)plan.shadow_height * (classified ? 1 : 2);
        most *= (plan.slab_count + SPSI_CHUNK - 1) / SPSI_CHUNK * (SPSI_CHUNK + 2);
        CHECK(plan.light_gathered == 1 && stats.slabs <= (uint64_t)plan.slab_count);
        if (!CHECK(stats.light_samples > 0 && (double)stats.light_samples <= most))
            printf("    %d: %g samples of %d texels, %d slabs\n", classified, (double)stats.light_samples,
                   plan.shadow_width * plan.shadow_height, plan.slab_count);
    }
}

/* The depth map of a light's polygons is no larger than a small picture calls for: at 1024^2, it alone has 12 bytes per
   texel. */
static void test_bytes(void) {
    static const double corner[3] = {0, 0.9, -3}, u[3] = {3, 0, 0}, v[3] = {0, 0, 6};
    faces.count = 0;
    check_add_quad(&faces, corner, u, v);
    for (int n = 0; n < 2; ++n) {
        sps_context *own = check_context(NULL);
        sps_stats_report stats;
        sps_plan_report plan;
        check_scene s;
        start_lumps(&s, n ? LARGE : 12, 0);
        check_add_mesh(&s, &faces, 0.5);
        CHECK_OK(own, sps_plan(own, &s.scene, &s.view, &plan));
        check_render(own, &s, image_a);
        sps_get_stats(own, &stats);
        CHECK(stats.bytes_peak <= plan.bytes);
        CHECK(n ? stats.bytes > 12 * 1024 * 1024 : stats.bytes < 12 * 1024 * 1024);
        sps_destroy(own);
    }
}

/* A region of a small picture is part of it, and workers make no difference, to the bit. */
static void test_region(void) {
    enum { SIZE = 20 };
    for (int kind = 0; kind < 3; ++kind) {
        check_scene s;
        start_lumps(&s, SIZE, kind);
        check_workers(&s, image_a, image_b);
        for (int i = 0; i < 4; ++i) s.view.region[i] = 5 + i;
        if (!check_render(context, &s, image_b)) return;
        for (int y = 0; y < s.view.region[3]; ++y)
            CHECK(memcmp(image_b + 4 * y * s.view.region[2], image_a + 4 * ((6 + y) * SIZE + 5),
                         4 * sizeof(float) * (size_t)s.view.region[2]) == 0);
    }
}

/* A table does not depend on the picture, and is held; which lights have one does not, either. That is so where nothing
   is gathered by levels: what the eye sees of these, the table has to show, too. */
static void test_tables(void) {
    for (int scattering = 0; scattering < 2; ++scattering) {
        sps_context *own = check_context(NULL);
        sps_stats_report stats;
        check_scene s;
        start_lumps(&s, 60, 0);
        s.light[0].shadow_source = SPS_SHADOW_TABLE;
        if (scattering) s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 8;
        s.view.quality = SPS_QUALITY_DRAFT;
        s.view.filling = SPS_FILLING_SPLAT;
        check_render(own, &s, image_a);
        sps_get_stats(own, &stats);
        CHECK(stats.tables_made == 1);
        s.view.width = s.view.height = 8;
        check_render(own, &s, image_a);
        sps_get_stats(own, &stats);
        CHECK(stats.tables_made == 0 && stats.tables_held == 1 && stats.cells == 0);
        sps_destroy(own);
    }
}

/* A table too coarse for a large picture is not taken for a small one. */
static void test_choice(void) {
    for (int size = 8; size <= 800; size *= 10) {
        sps_plan_report plan;
        check_scene s;
        sps_volume *volume = start_cube(&s, size);
        for (int k = 0; k < 3; ++k) volume->size[k] = 300; /* a table has 256 texels at most */
        s.light[0].shadow_source = SPS_SHADOW_AUTO;
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK(plan.pass[SPS_PASS_LIGHT_SHEETS].runs == 1 && plan.pass[SPS_PASS_LIGHT_MAPS].runs == 0);
    }
}

/* The shadow of a polygon's edge on gas lies where it does in a large picture, to half a texel of its depth map, 3/20
   of a pixel, of the gas's light: the picture is 1.8 high, and 0.8 of it is lit gas. */
static void test_edge(void) {
    static const double corner[3] = {0, 0.9, -3}, u[3] = {3, 0, 0}, v[3] = {0, 0, 6};
    double means[2] = {0, 0};
    faces.count = 0;
    check_add_quad(&faces, corner, u, v);
    for (int n = 0; n < 2; ++n) {
        const int size = n ? LARGE : 12;
        check_scene s;
        start_lumps(&s, size, 0);
        check_set3(s.view.camera.position, 0, 0, 4);
        check_set3(s.light[0].direction, 0, -1, -0.1);
        s.volume[0].extinction = 0.05f;
        check_add_mesh(&s, &faces, 0);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < size * size; ++i) means[n] += (double)image_a[4 * i] / (size * size);
    }
    CHECK_NEAR(means[0], means[1], means[1] * 3.0 / 20 * 1.8 / 12 / (0.5 * 0.8));
}

int main(void) {
    context = check_context(NULL);
    check_lumps(lumps, GRID);
    for (int i = 0; i < 8; ++i) /* a plan knows no bounds but the box */
        lumps[(GRID - 1) * ((i & 1) + GRID * ((i >> 1 & 1) + GRID * (i >> 2)))] = 1e-4f;
    RUN(test_pixels);
    RUN(test_nearest);
    RUN(test_most_texels);
    RUN(test_polygons);
    RUN(test_samples);
    RUN(test_bytes);
    RUN(test_region);
    RUN(test_tables);
    RUN(test_choice);
    RUN(test_edge);
    if (!check_memory_only()) RUN(test_errors);
    check_free_triangles(&faces);
    sps_destroy(context);
    return check_report();
}
