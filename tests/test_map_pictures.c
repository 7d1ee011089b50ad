/* Images whose gas and polygons are lit by transmittance maps. */

#include "map_scene.h"

/* ---------------------------------------------------------------------------------------- images that shade by maps */

enum { WIDE = 32, HIGH = 24, PIXELS = WIDE * HIGH };

static float image_a[4 * PIXELS], image_b[4 * PIXELS], image_c[4 * PIXELS];

static double small_blob(const void *user, const double p[3]) { return exp(-8 * vec_dot(p, p)) + 0 * !user; }

/* A blob over a plane, seen from the side and above. */
typedef struct picture {
    check_scene s;
    check_field field;
    check_triangles floor;
    sps_tmap_settings settings;
    crowd balls;
    sps_particles set;
} picture;

static void begin_picture(picture *p, int width, int height, int voxels) {
    static const double origin[3] = {-4, -1.2, -4}, u[3] = {8, 0, 0}, v[3] = {0, 0, 8};
    sps_volume *volume;
    memset(p, 0, sizeof *p);
    check_clear(&p->s, width, height);
    check_set3(p->s.view.camera.position, 1, 3, 7);
    check_perspective(&p->s.view.camera, 0.45);
    p->s.view.quality = SPS_QUALITY_DRAFT; /* smaller depth maps; the settings for gas are explicit */
    p->s.view.slab_thickness = 1;
    p->s.view.shadow_resolution = 2 * voxels;
    volume = check_add_volume(&p->s, voxels, voxels, voxels, check_box(-1, -1, -1, 1, 1, 1));
    p->field.value_fn = small_blob;
    p->field.user = p;
    p->settings.technique = SPS_TMAP_DEEP;
    volume->eval_fn = check_eval_field, volume->user = &p->field;
    volume->extinction = 5;
    check_color(volume->albedo, 0.9, 0.7, 0.5);
    check_add_quad(&p->floor, origin, u, v);
    check_add_mesh(&p->s, &p->floor, 0.8);
    p->set.read_fn = read_crowd;
    p->set.user = &p->balls;
    check_color(p->set.albedo, 0.5, 0.6, 0.9);
    p->s.scene.particles = &p->set;
}

static void add_picture_particles(picture *p, int count) {
    check_random random = {19};
    for (int i = 0; i < count; ++i) {
        sps_particle *one_particle = &p->balls.list[i];
        for (int k = 0; k < 3; ++k) one_particle->position[k] = (float)(2 * check_next(&random) - 1);
        one_particle->radius = (float)(0.15 + 0.2 * check_next(&random));
        one_particle->optical_depth = 0.6f;
    }
    p->balls.count = p->set.count = (size_t)count;
    p->s.scene.particle_set_count = 1;
}

static sps_light *lit_by_map(picture *p, sps_light *light) {
    light->shadow_map = &p->settings;
    return light;
}

/* A deep map agrees with the sheets, from slabs in other positions. The error of both is that of linear interpolation
   between the planes of slabs: for a slab of 0.5 voxels, 0.042, an eighth of its square times the steepest slope of
   extinction, 12: at most 0.26 % of the light in a pixel. Slopes rise as much as they fall along a ray, so that it
   nearly cancels: a mean of 2e-5 of the brightest radiance was measured, and 5e-5 is required. Voxels are splatted:
   samples lie elsewhere in maps, and test_filling.c bounds what that changes. Balls have rims, where
   slopes are not bounded: a slab's thickness to the power of 1.5 for uniform ones, less for thinner slabs. */
static void test_map_against_sheets(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        double difference[2], most = 0;
        for (int fine = 0; fine < 2; ++fine) {
            picture p;
            sps_light *light;
            begin_picture(&p, WIDE, HIGH, 24);
            if (n == 3) add_picture_particles(&p, 20), p.s.scene.volume_count = 0;
            p.s.view.slab_thickness = fine ? 0.25 : 0.5;
            p.s.view.filling = SPS_FILLING_SPLAT;
            light =
                n == 1 ? check_add_point(&p.s, 2, 4, 1, 20) : check_add_directional(&p.s, -1, -2, n == 2 ? 2 : -0.5, 3);
            check_render(context, &p.s, image_a);
            lit_by_map(&p, light);
            check_render(context, &p.s, image_b);
            difference[fine] = check_rms(image_a, image_b, 4 * PIXELS);
            most = brightest_of(image_a, PIXELS);
            CHECK(check_largest(image_a, image_b, 4 * PIXELS) < (n == 3 ? 0.01 : 0.0026) * most);
            CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
            check_free_triangles(&p.floor);
        }
        if (!CHECK(most > 0.1 && difference[0] < (n == 3 ? 4e-4 : 5e-5) * most))
            printf("    case %d: %g of %g\n", n, difference[0], most);
        if (n == 3) CHECK(difference[1] < 0.5 * difference[0]);
    }
    sps_destroy(context);
}

/* Every technique makes an image, and those that keep most detail come close to the deep map's. */
static void test_pictures(void) {
    static const double error[TECHNIQUES + 1] = {0, 0, 4e-3, 2e-2, 1e-2, 3e-2, 2e-2, 5e-2};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        picture p;
        sps_plan_report plan;
        begin_picture(&p, WIDE, HIGH, 9);
        add_picture_particles(&p, 6);
        p.settings.technique = (sps_tmap_technique)technique;
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4)); /* inside */
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plan));
        check_render(context, &p.s, technique != SPS_TMAP_DEEP ? image_b : image_a);
        for (int i = 0; i < 4 * PIXELS && technique != SPS_TMAP_DEEP; ++i)
            if (!(fabsf(image_b[i]) <= 100)) {
                CHECK(fabsf(image_b[i]) <= 100);
                break;
            }
        if (technique != SPS_TMAP_DEEP) {
            const double rms = check_rms(image_a, image_b, 4 * PIXELS);
            if (!CHECK_CASE("Found in review", "pictures by every kind of map",
                            "that by a deep map, rms of the brightest", rms / brightest_of(image_a, PIXELS),
                            error[technique], "by kind"))
                printf("    technique %d: %g\n", technique, rms);
        }
        check_free_triangles(&p.floor);
    }
    sps_destroy(context);
}

/* A light inside the gas is refused without a map, and agrees with the reference with one. Kernels' ripple is a quarter
   of a per cent, interpolation between slabs less; but close to the light, where its irradiance grows as 1 / r^2, there
   is one sample per slab: 5 % of the brightest in the four pixels around the light, 0.5 % in the mean of 432. */
/* A light's own map is fitted to the gas, and leaves a Fourier series a twentieth of the range free at either end,
   unless each texel has its own range. */
static void test_fitted_range(void) {
    sps_context *context = sps_create(NULL, NULL);
    double depths[4][2];
    for (int n = 0; n < 4; ++n) {
        picture p;
        const spsi_shadow_table *map;
        begin_picture(&p, WIDE, HIGH, 9);
        p.settings.technique = n == 0 ? SPS_TMAP_OPACITY : SPS_TMAP_FOURIER;
        p.settings.texel_range = n == 2;
        lit_by_map(&p, n == 3 ? check_add_point(&p.s, 0.2, 6, 0.1, 20) : check_add_directional(&p.s, 0, -1, 0, 3));
        check_render(context, &p.s, image_a);
        map = (const spsi_shadow_table *)context->buffers[SPSI_BUFFER_LIGHT_TMAPS].data; /* as the render left it */
        depths[n][0] = map->grid.near_depth, depths[n][1] = map->grid.far_depth;
        check_free_triangles(&p.floor);
    }
    {
        const double length = depths[0][1] - depths[0][0];
        CHECK(length > 1.9 && length < 3.5); /* the blob's voxels, 2 across, and kernels' reach, 2.5 voxels of 2/9 */
        CHECK_CASE("Found in review", "guard band of a Fourier map's fitted range", "a twentieth at either end",
                   fmax(fabs(depths[1][0] - (depths[0][0] - 0.05 * length)),
                        fabs(depths[1][1] - (depths[0][1] + 0.05 * length))),
                   1e-9, "doubles");
        CHECK_NEAR(depths[2][0], depths[0][0], 1e-9);
        CHECK_NEAR(depths[2][1], depths[0][1], 1e-9);
        CHECK(depths[3][1] - depths[3][0] > 1.1 * 1.9);
    }
    sps_destroy(context);
}

/* Six faces of default size agree with large ones: texels are as wide as voxels where gas is farthest, at which an
   opacity map of 64 planes resolves a blob of that width to one per cent. */
static void test_default_size(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2; ++n) {
        picture p;
        sps_light *light;
        begin_picture(&p, WIDE, HIGH, 16);
        p.s.view.shadow_resolution = 0;
        p.s.view.quality = SPS_QUALITY_MEDIUM;
        p.settings.technique = SPS_TMAP_OPACITY, p.settings.components = 64;
        light = check_add_point(&p.s, 0.3, 0.45, -0.2, 0.5);
        light->shadow_map_resolution = n * 128;
        lit_by_map(&p, light);
        check_render(context, &p.s, n ? image_b : image_a);
        {
            const spsi_shadow_table *map = (const spsi_shadow_table *)context->buffers[SPSI_BUFFER_LIGHT_TMAPS].data;
            const double voxel = 2.0 / 16, farthest = 1.45; /* kernels reach at most 2.5 voxels farther */
            CHECK(map->grid.face_count == 6);
            CHECK(n ? map->grid.rays[0].width == 128
                    : map->grid.rays[0].width >= 2 * farthest / voxel &&
                          map->grid.rays[0].width <= 2 * (farthest / voxel + 2.5) + 1);
        }
        check_free_triangles(&p.floor);
    }
    CHECK_CASE("Found in review", "six faces of default size", "those of 128 texels, rms of the brightest",
               check_rms(image_a, image_b, 4 * PIXELS) / brightest_of(image_b, PIXELS), 0.01,
               "64 planes resolve a blob as wide as a voxel to 1 %");
    sps_destroy(context);
}

static void test_light_inside(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    sps_light *light;
    sps_image image;
    double sum = 0, count = 0, most, worst = 0;
    begin_picture(&p, 24, 18, 16);
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    p.s.scene.mesh_count = 0;
    light = check_add_point(&p.s, 0.3, 0.45, -0.2, 0.5);
    p.s.view.slab_thickness = 0.5;
    p.s.view.quality = SPS_QUALITY_HIGH;
    light->shadow_map_resolution = 32;
    light->shadow_source = SPS_SHADOW_SHEETS;
    CHECK(sps_render(context, &p.s.scene, &p.s.view, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "shadow_source") != NULL);
    light->shadow_source = SPS_SHADOW_AUTO;
    lit_by_map(&p, light);
    check_render(context, &p.s, image_a);
    check_march(context, &p.s, 0.25, image_b, NULL);
    most = brightest_of(image_b, 24 * 18);
    for (int i = 0; i < 4 * 24 * 18; ++i) {
        const double off = fabs((double)image_a[i] - (double)image_b[i]);
        worst = fmax(worst, off), sum += off * off, count += 1;
    }
    CHECK(most > 0.02);
    CHECK_CASE("What users of other renderers complain of", "light inside the medium, by a map",
               "brute force, rms of the brightest", sqrt(sum / count) / most, 0.005,
               "ripple of 0.25 %, and lines between slabs as much");
    CHECK(worst < 0.05 * most);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Renders only the lights of `mask`, and returns the number of sweeps planned for them. */
static int render_lights(sps_context *context, picture *p, int mask, float *image) {
    sps_plan_report plan;
    for (int i = 0; i < 4; ++i)
        for (int c = 0; c < 3; ++c) p->s.light[i].color[c] = (float)(mask >> i & 1);
    CHECK(sps_plan(context, &p->s.scene, &p->s.view, &plan) == SPS_OK);
    check_render(context, &p->s, image);
    return plan.sweep_count;
}

/* The maximum difference between one image and the sum of two others, in red, and that of their means. */
static void off_sum(const float *whole, const float *a, const float *b, double off[2]) {
    double sum = 0, worst = 0;
    for (int i = 0; i < 4 * PIXELS; i += 4) {
        const double d = (double)whole[i] - ((double)a[i] + (double)b[i]);
        worst = fmax(worst, fabs(d)), sum += d;
    }
    off[0] = worst, off[1] = fabs(sum) / PIXELS;
}

/* Lights add up, with maps or sheets, in a scene of gas and polygons, and of balls in the end. Those with maps share
   one sweep, and their picture is the sum of their own up to round-off: about 30 additions per pixel (slabs and
   lights), each off by at most 6e-8 of the sum and by half of that in the mean. A light with sheets carries the others
   in its sweep; these are then looked up in its slabs instead of those that face the eye: each is off by at most 1 % of
   the light, and a fiftieth of that in the mean (as in test_map_against_sheets, in slabs twice as thick). */
static void test_lights_together(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    double off[2];
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 1));
    lit_by_map(&p, check_add_directional(&p.s, 1, -1, -0.5, 1));
    check_add_directional(&p.s, -0.2, -1, -2, 1);
    check_add_directional(&p.s, 0.2, -0.5, 1, 1); /* towards the eye: its sweep is composited back to front */
    p.s.light[3].shadow_source = SPS_SHADOW_SHEETS;
    CHECK(render_lights(context, &p, 1, image_a) == 1 && render_lights(context, &p, 2, image_b) == 1);
    CHECK(render_lights(context, &p, 3, image_c) == 1);
    CHECK(brightest_of(image_a, PIXELS) > 0.05 && brightest_of(image_b, PIXELS) > 0.05);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest_of(image_c, PIXELS));
    CHECK(render_lights(context, &p, 4, image_a) == 1 && render_lights(context, &p, 7, image_b) == 1);
    off_sum(image_b, image_c, image_a, off);
    CHECK_NEAR(off[0], 0, 0.01 * brightest_of(image_b, PIXELS));
    CHECK_NEAR(off[1], 0, 2e-4 * brightest_of(image_b, PIXELS));
    CHECK(render_lights(context, &p, 8, image_a) == 1 && render_lights(context, &p, 15, image_c) == 2);
    off_sum(image_c, image_b, image_a, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest_of(image_c, PIXELS)); /* the last light's own sweep is the same as alone */
    CHECK(render_lights(context, &p, 1, image_b) == 1 && render_lights(context, &p, 9, image_c) == 1);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 0.01 * brightest_of(image_c, PIXELS));
    CHECK_NEAR(off[1], 0, 2e-4 * brightest_of(image_c, PIXELS));
    add_picture_particles(&p, 30);
    CHECK(render_lights(context, &p, 1, image_a) == 1 && render_lights(context, &p, 2, image_b) == 1);
    CHECK(render_lights(context, &p, 3, image_c) == 1);
    off_sum(image_c, image_a, image_b, off);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest_of(image_c, PIXELS));
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* A light far from its gas has one face, or six on request, which need more memory and make the same picture. Slabs are
   off by 0.26 % either way (test_map_against_sheets). Between texels of a face, 0.036 wide at the gas, optical depth is
   off by 1/8 of that squared times its maximum curvature, 16 * 3.1: 0.8 %. */
static void test_omnidirectional_light(void) {
    sps_stats_report stats[4];
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_point(&p.s, 2, 4, 1, 20))->shadow_map_resolution = 256;
    for (int i = 3; i >= 0; --i) { /* with 8 numbers per texel, and with lists */
        sps_context *context = sps_create(NULL, NULL);
        p.settings.technique = i < 2 ? SPS_TMAP_DEEP : SPS_TMAP_OPACITY;
        p.s.light[0].shadow_map_omnidirectional = i % 2;
        check_render(context, &p.s, i % 2 ? image_b : image_a);
        sps_get_stats(context, &stats[i]);
        sps_destroy(context);
    }
    CHECK(stats[3].bytes_peak > stats[2].bytes_peak + 4 * 256 * 256 * 8 * sizeof(float)); /* and not 5: bands differ */
    CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
    CHECK_NEAR(check_largest(image_a, image_b, 4 * PIXELS), 0, (2 * 0.0026 + 0.008) * brightest_of(image_a, PIXELS));
    check_free_triangles(&p.floor);
}

/* A light's zeroed settings are those of a table, in its plan as well. */
static void test_default_picture(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_plan_report plans[2];
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
    for (int i = 0; i < 2; ++i) {
        memset(&p.settings, 0, sizeof p.settings);
        if (i) p.settings.technique = SPS_TMAP_TABLE;
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plans[i]));
        check_render(context, &p.s, i ? image_b : image_a);
    }
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && brightest_of(image_a, PIXELS) > 0.05);
    CHECK(plans[0].pass[SPS_PASS_LIGHT_MAPS].bytes == plans[1].pass[SPS_PASS_LIGHT_MAPS].bytes);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Polygons alone need one sweep for any number of lights, and no maps, nor are any planned. */
static void test_lights_on_polygons(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_plan_report plan[2];
    picture p;
    double off[2];
    begin_picture(&p, WIDE, HIGH, 16);
    p.s.scene.volume_count = 0;
    lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 1));
    check_add_directional(&p.s, 1, -1, -0.5, 1);
    check_add_directional(&p.s, -0.2, -1, -2, 1);
    check_add_directional(&p.s, 0.3, -1, 0.2, 1);
    CHECK(render_lights(context, &p, 5, image_a) == 1 && render_lights(context, &p, 10, image_b) == 1);
    CHECK(render_lights(context, &p, 15, image_c) == 1);
    for (int i = 0; i < 2; ++i, p.s.light[0].shadow_map = NULL)
        CHECK(sps_plan(context, &p.s.scene, &p.s.view, &plan[i]) == SPS_OK);
    CHECK(plan[0].bytes == plan[1].bytes);
    off_sum(image_c, image_a, image_b, off);
    CHECK(brightest_of(image_a, PIXELS) > 0.05);
    CHECK_NEAR(off[0], 0, 1e-6 * brightest_of(image_c, PIXELS));
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* Lights that are black, or cast no shadows, need no map. */
static void test_needless_maps(void) {
    sps_context *context = sps_create(NULL, NULL);
    picture p;
    begin_picture(&p, WIDE, HIGH, 16);
    check_add_directional(&p.s, -1, -2, -0.5, 2);
    lit_by_map(&p, check_add_point(&p.s, 2, 4, 1, 20))->no_shadow = 1;
    check_render(context, &p.s, image_a);
    p.s.light[1].shadow_map = NULL;
    check_render(context, &p.s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    check_free_triangles(&p.floor);
    sps_destroy(context);
}

/* The same bits for any number of workers, and for a region as part of the whole, with any map; voxels that are held
   from one call to the next are used by maps and images alike. */
static void test_picture_bits(void) {
    static const int workers[4] = {0, 1, 2, 7};
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3)
        for (int w = 0; w < 4; ++w) {
            check_hooks hooks;
            sps_context *context;
            picture p;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = workers[w], hooks.order = (uint64_t)w;
            context = check_context(&hooks);
            begin_picture(&p, 16, 12, 8);
            p.s.scene.mesh_count = 0;
            add_picture_particles(&p, 6);
            p.settings.technique = (sps_tmap_technique)technique;
            lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
            lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_resolution = 20;
            check_render(context, &p.s, w ? image_b : image_a);
            CHECK(w == 0 || memcmp(image_a, image_b, 4 * 16 * 12 * sizeof(float)) == 0);
            p.s.view.region[0] = 5, p.s.view.region[1] = 3, p.s.view.region[2] = 7, p.s.view.region[3] = 6;
            check_render(context, &p.s, image_c);
            for (int y = 0; y < 6; ++y)
                CHECK(memcmp(image_c + 4 * 7 * y, image_a + 4 * (16 * (3 + y) + 5), 4 * 7 * sizeof(float)) == 0);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            check_free_triangles(&p.floor);
        }
}

static void test_held_voxels(void) {
    sps_context *context = sps_create(NULL, NULL), *fresh = sps_create(NULL, NULL);
    picture p;
    fixture f;
    sps_tmap *maps[2];
    sps_stats_report stats;
    begin_picture(&p, WIDE, HIGH, 12);
    check_add_directional(&p.s, -1, -2, -0.5, 3);
    check_render(context, &p.s, image_a);
    p.s.volume[0].revision = 5;
    check_render(context, &p.s, image_b);
    begin(&f, SPS_TMAP_MOMENT);
    f.s.volume[0] = p.s.volume[0];
    f.s.scene.volume_count = 1;
    maps[0] = must_build(&f, context);
    sps_get_stats(context, &stats);
    CHECK(stats.eval_calls == 0 && stats.voxels_relevant > 0);
    maps[1] = must_build(&f, fresh);
    CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
    check_render(context, &p.s, image_c);
    sps_get_stats(context, &stats);
    CHECK(stats.eval_calls == 0);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && memcmp(image_a, image_c, sizeof image_a) == 0);
    sps_tmap_destroy(maps[0]);
    sps_tmap_destroy(maps[1]);
    check_free_triangles(&p.floor);
    sps_destroy(context);
    sps_destroy(fresh);
}

/* What the next test lends to a call. */
static float lent_planes[3];

static double lent_matrix[16];

/* Spoils it as soon as the call reads voxels. */
static double spoiling_blob(const void *user, const double p[3]) {
    for (int i = 0; i < 3; ++i) lent_planes[i] = 0.25f;
    memset(lent_matrix, 0, sizeof lent_matrix);
    return small_blob(user, p);
}

/* Planes and a camera's matrix are read before anything else is, and not again. */
static void test_picture_settings_are_copied(void) {
    static const float planes[3] = {0.4f, 0.6f, 1};
    static const double matrix[16] = {0.4, 0, 0, 0, 0, 0.4, 0, 0, 0, 0, -0.1, 0, 0, 0, 0, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int spoilt = 0; spoilt < 2; ++spoilt) {
        picture p;
        begin_picture(&p, 16, 16, 12);
        memcpy(lent_planes, planes, sizeof planes);
        memcpy(lent_matrix, matrix, sizeof matrix);
        memset(&p.s.view.camera, 0, sizeof p.s.view.camera);
        p.s.view.camera.world_to_clip = lent_matrix;
        p.settings.technique = SPS_TMAP_OPACITY;
        p.settings.planes = lent_planes, p.settings.components = 3;
        if (spoilt) p.field.value_fn = spoiling_blob;
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        check_render(context, &p.s, spoilt ? image_b : image_a);
        check_free_triangles(&p.floor);
    }
    CHECK(lent_matrix[0] <= 0 && brightest_of(image_a, 16 * 16) > 0.1);
    CHECK(memcmp(image_a, image_b, 16 * 16 * 4 * sizeof(float)) == 0);
    sps_destroy(context);
}

/* A light's invalid settings, and a mesh's transmittance, are refused by name. */
static void test_picture_refusals(void) {
    static const char *const texts[] = {"light[0].shadow_map.technique is 9; SPS_TMAP_DEPTH holds no gas",
                                        "light[0].shadow_map.components is 2",
                                        "light[0].shadow_map_omnidirectional is 1",
                                        "light[0].shadow_map.far_depth is 3",
                                        "light[0].shadow_map.surface_bias is 1",
                                        "light[0].shadow_map_resolution is -1",
                                        "light[0].shadow_map_resolution is 16385",
                                        "light[0].shadow_map.byte_budget is 99",
                                        "light[0].shadow_map.planes[0] is 0",
                                        "light[0].shadow_map.end_canary",
                                        "mesh[0].transmittance is -1"};
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        const sps_result expected = i == 7 ? SPS_ERROR_MEMORY : SPS_ERROR_ARGUMENT;
        static const float planes[9] = {0};
        sps_context *context = sps_create(NULL, NULL);
        sps_image image;
        sps_plan_report plan;
        picture p;
        begin_picture(&p, 8, 6, 8);
        lit_by_map(&p, check_add_directional(&p.s, -1, -2, -0.5, 3));
        p.settings.technique = SPS_TMAP_OPACITY;
        if (i == 0) p.settings.technique = SPS_TMAP_DEPTH;
        if (i == 1) p.settings.technique = SPS_TMAP_BEER, p.settings.components = 2;
        if (i == 2) p.s.light[0].shadow_map_omnidirectional = 1;
        if (i == 3) p.settings.far_depth = 3;
        if (i == 4) p.settings.surface_bias = 1;
        if (i == 5 || i == 6) p.s.light[0].shadow_map_resolution = i == 5 ? -1 : 16385;
        if (i == 7) p.settings.byte_budget = 99;
        if (i == 8) p.settings.planes = planes, p.settings.components = 9;
        if (i == 9) p.settings.end_canary = 1;
        if (i == 10) p.s.mesh[0].transmittance[1] = -1;
        memset(&image, 0, sizeof image);
        image.rgba = image_c;
        image_c[0] = -5;
        CHECK(sps_render(context, &p.s.scene, &p.s.view, &image) == expected);
        CHECK(check_error_info(context, expected));
        if (!CHECK(strstr(sps_error(context), texts[i]) != NULL)) printf("    %s: %s\n", texts[i], sps_error(context));
        CHECK(image_c[0] <= -5);
        if (i >= 8) {
            CHECK(sps_plan(context, &p.s.scene, &p.s.view, &plan) == expected && plan.sweep_count == 0);
            CHECK(strstr(sps_error(context), texts[i]) != NULL);
            CHECK(check_reference(context, &p.s.scene, &p.s.view, 0.5, &image) == expected);
        }
        check_renders(context);
        check_free_triangles(&p.floor);
        sps_destroy(context);
    }
}

static double half_blob(const void *user, const double p[3]) { return p[0] > 0 ? small_blob(user, p) : 0; }

/* The plan for maps made from lists includes their bands of 64 rows and the numbers of intervals of these, whose tiles
   have room beside them; lists themselves and what is fitted to them are not planned. Six faces around a light, so that
   the map has the requested size; half of the gas is empty. */
static void test_planned_lists(void) {
    for (int n = 0; n < 6; n += check_memory_only() ? 2 : 1) {
        const int technique = n < 2 ? SPS_TMAP_DEEP : SPS_TMAP_COMPRESSED, side = n % 2 ? 90 : 64;
        const size_t texels = 6 * (size_t)(side * side);
        size_t held, planned;
        check_hooks hooks;
        sps_context *context;
        sps_plan_report plan;
        picture p;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin_picture(&p, 8, 6, 8);
        p.field.value_fn = half_blob;
        p.s.scene.mesh_count = 0;
        p.settings.technique = (sps_tmap_technique)technique;
        p.settings.components = n < 4 ? 0 : 8;
        lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_resolution = side;
        CHECK_OK(context, sps_plan(context, &p.s.scene, &p.s.view, &plan));
        planned = plan.pass[SPS_PASS_LIGHT_MAPS].bytes;
        if (check_render(context, &p.s, image_c)) {
            const spsi_buffer *buffers = context->buffers;
            held = buffers[SPSI_BUFFER_TMAP_VOLUMES].size + buffers[SPSI_BUFFER_LIGHT_TMAPS].size;
            held += buffers[SPSI_BUFFER_CURSORS].size;
            held += (texels + 1) * sizeof(uint32_t);
            CHECK_CASE("Found in review", "bytes of maps that are made from lists", "held / planned",
                       (double)held / (double)planned, 1, "a bound");
        }
        check_free_triangles(&p.floor);
        sps_destroy(context);
    }
}

/* Each allocation of an image with maps fails in turn. */
static void test_picture_allocations(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 4)
        for (int last = 0, n = 1; !last; ++n) {
            check_hooks hooks;
            sps_context *context;
            sps_image image;
            sps_result result;
            picture p;
            memset(&hooks, 0, sizeof hooks);
            context = check_context(&hooks);
            begin_picture(&p, 8, 6, 6);
            p.s.scene.mesh_count = 0;
            add_picture_particles(&p, 3);
            p.settings.technique = (sps_tmap_technique)technique;
            lit_by_map(&p, check_add_point(&p.s, 0.2, 0.4, 0.1, 0.4))->shadow_map_resolution = 9;
            memset(&image, 0, sizeof image);
            image.rgba = image_c;
            hooks.fail_at = hooks.allocations + n;
            result = sps_render(context, &p.s.scene, &p.s.view, &image);
            last = hooks.allocations < hooks.fail_at;
            CHECK(result == (last ? SPS_OK : SPS_ERROR_MEMORY));
            hooks.fail_at = 0;
            CHECK_OK(context, sps_render(context, &p.s.scene, &p.s.view, &image));
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            check_free_triangles(&p.floor);
        }
}

int main(void) {
    RUN(test_map_against_sheets);
    RUN(test_pictures);
    RUN(test_fitted_range);
    RUN(test_default_size);
    RUN(test_light_inside);
    RUN(test_lights_together);
    if (!check_memory_only()) RUN(test_omnidirectional_light);
    RUN(test_default_picture);
    RUN(test_lights_on_polygons);
    RUN(test_needless_maps);
    RUN(test_picture_bits);
    RUN(test_held_voxels);
    RUN(test_picture_settings_are_copied);
    RUN(test_picture_refusals);
    RUN_LONG(test_planned_lists);
    RUN(test_picture_allocations);
    return check_report();
}
