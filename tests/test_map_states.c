/* Transmittance maps: settings, states, lookups and constants for shaders, refusals, and extremes. */

#include "map_scene.h"
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

/* ---------------------------------------------------------------------------------------------- states and refusals */

static void check_refused(fixture *f, const char *text) {
    sps_context *context = sps_create(NULL, NULL);
    sps_error_info info;
    sps_tmap *map = build(f, context);
    if (!CHECK(map == NULL && strstr(sps_error(context), text) != NULL))
        printf("    wanted \"%s\", got \"%s\"\n", text, sps_error(context));
    sps_get_error(context, &info);
    CHECK(check_error_info(context, info.result) && info.result != SPS_OK);
    if (strncmp(text, "light.", 6) == 0) CHECK(info.object == SPS_OBJECT_TMAP_LIGHT && info.index == -1);
    if (strncmp(text, "settings.", 9) == 0) CHECK(info.object == SPS_OBJECT_TMAP_SETTINGS && info.index == -1);
    sps_tmap_destroy(map);
    check_renders(context);
    sps_destroy(context);
}

/* Zeroed settings, except for the range, are deep opacity with cubics in 8 components, in a separate map and in a
   light's; sps_tmap_get_info reports that. More components may be requested, and planes be set. */
static void test_default_technique(void) {
    static const float planes[4] = {0.1f, 0.3f, 0.6f, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3; ++n) { /* as it is; with more components; with planes */
        sps_tmap_settings resolved;
        sps_tmap *maps[2];
        for (int i = 0; i < 2; ++i) {
            fixture f;
            begin_little(&f, i ? SPS_TMAP_DEEP_OPACITY : SPS_TMAP_DEFAULT);
            f.settings.cubic = i;
            if (n > 0) f.settings.components = n == 1 ? 11 : 6;
            if (n == 2) f.settings.planes = planes;
            maps[i] = must_build(&f, context);
            end(&f);
        }
        if (!maps[0] || !maps[1]) break;
        resolved = check_settings_of(maps[0]);
        CHECK(resolved.technique == SPS_TMAP_DEEP_OPACITY && resolved.cubic == 1);
        CHECK(resolved.components == (n == 0 ? 8 : n == 1 ? 11 : 6));
        CHECK(check_bytes_of(maps[0]) == check_bytes_of(maps[1]));
        CHECK(memcmp(sps_tmap_texels(maps[0]), sps_tmap_texels(maps[1]),
                     SIDE * SIDE * (size_t)resolved.components * sizeof(float)) == 0);
        for (int i = 0; i < 200; ++i)
            CHECK_NEAR(query(maps[0], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i),
                       query(maps[1], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i), 0);
        for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
    }
    sps_destroy(context);
}

/* Invalid settings, each with its error sentence. */
static void test_settings(void) {
    static const struct {
        const char *text;
        int technique, components;
    } counts[] = {{"settings.components is 1; a deep map has 0", SPS_TMAP_DEEP, 1},
                  {"settings.components is 2; a compressed map has 4, 6 .. 64", SPS_TMAP_COMPRESSED, 2},
                  {"settings.components is 1; a depth map has 0", SPS_TMAP_DEPTH, 1},
                  {"settings.components is 66; an opacity map has 1, 2 .. 65", SPS_TMAP_OPACITY, 66},
                  {"settings.components is -1; an opacity", SPS_TMAP_OPACITY, -1},
                  {"settings.components is 2; a deep opacity map has 3, 4 .. 65", SPS_TMAP_DEEP_OPACITY, 2},
                  {"settings.components is 6; a Fourier map has 3, 5 .. 65", SPS_TMAP_FOURIER, 6},
                  {"settings.components is 67; a Fourier", SPS_TMAP_FOURIER, 67},
                  {"settings.components is 6; a moment map has 5 or 7", SPS_TMAP_MOMENT, 6},
                  {"settings.components is 9; a moment", SPS_TMAP_MOMENT, 9},
                  {"settings.components is 5; a compressed map has 4, 6 .. 64", SPS_TMAP_COMPRESSED, 5},
                  {"settings.components is 4; a Beer map has 3", SPS_TMAP_BEER, 4},
                  {"settings.components is 2; a deep opacity map has 3, 4 .. 65", SPS_TMAP_DEFAULT, 2}};
    static const char *const texts[] = {
        "settings.technique is 10",  "settings.technique is 15",    "settings.epsilon is 0.51",
        "settings.epsilon is nan",   "settings.surface_bias is -1", "settings.start_canary is",
        "settings.end_canary is",    "settings.far_depth is 0",     "settings.far_depth is 2",
        "settings.near_depth is -1", "settings.far_depth is 2e+15", "settings.far_depth is nan"};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; ++i) {
        fixture f;
        begin(&f, counts[i].technique);
        f.settings.components = counts[i].components;
        check_refused(&f, counts[i].text);
    }
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        fixture f;
        begin(&f, SPS_TMAP_FOURIER);
        if (i == 0) f.settings.technique = (sps_tmap_technique)(SPS_TMAP_DEPTH + 1);
        if (i == 1) f.settings.technique = (sps_tmap_technique)15;
        if (i == 2) f.settings.epsilon = 0.51f;
        if (i == 3) f.settings.epsilon = (float)(HUGE_VAL - HUGE_VAL);
        if (i == 4) f.settings.surface_bias = -1;
        if (i == 5) f.settings.start_canary = 1;
        if (i == 6) f.settings.end_canary = 1;
        if (i >= 7) f.settings.far_depth = i == 7 ? 0 : i == 10 ? 2e15 : i == 11 ? HUGE_VAL - HUGE_VAL : 2;
        if (i == 8 || i == 9) f.settings.near_depth = i == 8 ? 2 : -1;
        check_refused(&f, texts[i]);
    }
    {
        fixture f; /* two of them are for texel_range */
        begin(&f, SPS_TMAP_FOURIER);
        f.settings.texel_range = 1, f.settings.components = 3;
        check_refused(&f, "settings.components is 3; a Fourier map with texel_range has 5, 7 .. 65");
    }
}

/* Planes must increase from above 0 to 1; they are copied and used. */
static void test_planes(void) {
    static const float wrong[5][3] = {
        {0, 0.5f, 1}, {0.5f, 0.5f, 1}, {0.5f, 0.4f, 1}, {0.2f, 0.5f, 0.9f}, {0.2f, 1.5f, 1}};
    static const char *const texts[5] = {"settings.planes[0] is 0;", "settings.planes[1] is 0.5;",
                                         "settings.planes[1] is 0.4;", "settings.planes[2] is 0.9;",
                                         "settings.planes[1] is 1.5;"};
    check_hooks hooks;
    sps_context *context;
    memset(&hooks, 0, sizeof hooks);
    context = check_context(&hooks);
    for (int technique = SPS_TMAP_OPACITY; technique <= SPS_TMAP_DEEP_OPACITY; ++technique) {
        float planes[3] = {0.25f, 0.5f, 1};
        sps_tmap_settings resolved;
        fixture f;
        sps_tmap *map = NULL, *other = NULL;
        size_t live;
        begin(&f, technique);
        f.settings.components = technique == SPS_TMAP_OPACITY ? 3 : 5;
        for (int i = 0; i < 5; ++i) {
            f.settings.planes = wrong[i];
            check_refused(&f, texts[i]);
        }
        add(&f, 0, 0, 0, 1, 2, 3); /* u 0.35 .. 0.55 */
        f.settings.planes = planes;
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        live = hooks.live;
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &other));
        sps_tmap_destroy(other);
        CHECK(hooks.live == live);
        planes[0] = planes[1] = 7;
        resolved = check_settings_of(map);
        CHECK(resolved.planes && resolved.planes != planes && resolved.planes[1] <= 0.5f);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK_OK(context, sps_tmap_finish(map));
        if (technique == SPS_TMAP_OPACITY) {
            CHECK_NEAR(query(map, 0, 0, 5), 0, 0);
            CHECK_NEAR(query(map, 0, 0, 0), 2.25, 1e-5);
            CHECK_NEAR(query(map, 0, 0, 2.5), 1.125, 1e-5); /* half the way from plane to plane */
        } else { /* the particle's own range: planes are at 1/4, 1/2 and 1 of it */
            const double before[3] = {0, 0, 5};
            float bracket[2] = {7, 7};
            sps_tmap_bounds(map, 1, before, &bracket[0], &bracket[1]);
            CHECK(bracket[0] <= 0 && bracket[1] <= 0.7501f); /* up to the first plane, which has all before it */
            CHECK_NEAR(query(map, 0, 0, 2), 0.75, 1e-5);
            CHECK_NEAR(query(map, 0, 0, 1), 1.5, 1e-5);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
    CHECK(hooks.live == 0 && hooks.live_blocks == 0);
}

/* Views and scenes. */
static void test_scenes(void) {
    static const char *const texts[] = {"light.width is 0",
                                        "light.height is 0",
                                        "light.width is 16385",
                                        "light.camera.field_of_view is 4",
                                        "same point",
                                        "cannot be inverted",
                                        "light.width is 9; it must equal",
                                        "light.end_canary",
                                        "light.camera.position is nan",
                                        "light.slab_thickness is -1",
                                        "position is nan",
                                        "radius is -1",
                                        "optical_depth is inf",
                                        "particles[0].end_canary",
                                        "particles[0].read_fn is NULL",
                                        "mesh[0].transmittance is 1.5",
                                        "mesh[0].transmittance is -0.5",
                                        "mesh[0].transmittance is nan",
                                        "mesh[1].read_fn is NULL",
                                        "volume[0].extinction is -1",
                                        "volume[0].size is -1",
                                        "scene.mesh_count is -1",
                                        "scene.volume_count is 1",
                                        "mesh[0].triangle[1].position is nan",
                                        "volume[0].placement's determinant is 0",
                                        "scene.end_canary",
                                        "light.start_canary is 3",
                                        "light.quality is 5",
                                        "light.slab_thickness is 1e-09; it makes more than 2^20 slabs",
                                        "light.camera has neither",
                                        "light.camera has field_of_view and ortho_height",
                                        "light.camera.up is inf",
                                        "light.border is 65; it must be 0..64",
                                        "light.border is -1; it must be",
                                        "light.border is 1; it must be 0..64, and 0 for six faces",
                                        "light.border is 2; with it, the map is wider than 16384 texels"};
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        const float nan = (float)(HUGE_VAL - HUGE_VAL);
        fixture f;
        begin_little(&f, SPS_TMAP_OPACITY);
        if (i == 0) f.light.width = 0;
        if (i == 1) f.light.height = 0;
        if (i == 2) f.light.width = 16385;
        if (i == 3) check_perspective(&f.light.camera, 4);
        if (i == 4) check_set3(f.light.camera.target, 0, 0, 10);
        if (i == 5) memset(f.matrix, 0, sizeof f.matrix), check_matrix(&f.light.camera, f.matrix);
        if (i == 6) f.light.omnidirectional = 1, f.light.height = 8;
        if (i == 7) f.light.end_canary = 1;
        if (i == 32 || i == 33) f.light.border = i == 32 ? 65 : -1;
        if (i == 34) see(&f, ROUND, SIDE), f.light.border = 1;
        if (i == 35) f.light.height = 16381, f.light.border = 2;
        if (i == 8) f.light.camera.position[1] = (double)nan;
        if (i == 9) f.light.slab_thickness = -1;
        if (i == 10) f.crowds[0].list[1].position[1] = nan;
        if (i == 11) f.crowds[0].list[2].radius = -1;
        if (i == 12) f.crowds[1].list[0].optical_depth = (float)HUGE_VAL;
        if (i == 13) f.sets[0].end_canary = 1;
        if (i == 14) f.sets[0].read_fn = NULL;
        if (i >= 15 && i <= 17) f.s.mesh[0].transmittance[i - 15] = i == 15 ? 1.5f : i == 16 ? -0.5f : nan;
        if (i == 18) f.s.mesh[1].read_fn = NULL;
        if (i == 19) f.s.volume[0].extinction = -1;
        if (i == 20) f.s.volume[0].size[1] = -1;
        if (i == 21) f.s.scene.mesh_count = -1;
        if (i == 22) f.s.scene.volumes = NULL;
        if (i == 23) f.triangles[0].list[1].position[2][0] = nan;
        if (i == 24) memset(f.s.volume[0].placement.axis[1], 0, 3 * sizeof(double));
        if (i == 25) f.s.scene.end_canary = 1;
        if (i == 26) f.light.start_canary = 3;
        if (i == 27) f.light.quality = (sps_quality)5;
        if (i == 28) f.light.slab_thickness = 1e-9;
        if (i == 29) f.light.camera.ortho_height = 0;
        if (i == 30) f.light.camera.field_of_view = 1;
        if (i == 31) f.light.camera.up[1] = HUGE_VAL;
        check_refused(&f, texts[i]);
        end(&f);
    }
}

/* replace_invalid treats particles with NaN as if they were absent. */
static void test_replaced(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f, whole;
    sps_tmap *maps[2];
    sps_stats_report stats;
    begin_mixed(&whole, SPS_TMAP_DEEP);
    begin_mixed(&f, SPS_TMAP_DEEP);
    add(&f, 1, 0, 0, 0, 2, HUGE_VAL);
    f.s.scene.replace_invalid = 1;
    maps[0] = must_build(&whole, context);
    maps[1] = must_build(&f, context);
    sps_get_stats(context, &stats);
    CHECK(stats.values_replaced == 1);
    CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
    for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
    end(&f);
    end(&whole);
    sps_destroy(context);
}

/* A flag of one of several scenes applies to the map, whichever comes first; without it, invalid data are refused. */
static void test_replaced_of_several(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) { /* bit 0: the scene without a flaw asks, bit 1: it comes first */
        fixture f, bad;
        sps_stats_report stats;
        sps_tmap *map = NULL;
        begin(&f, SPS_TMAP_OPACITY);
        begin(&bad, SPS_TMAP_OPACITY);
        add(&f, 0, 0, 0, 0, 2, 1);
        add(&bad, 1, 0, 0, 0, 2, HUGE_VAL);
        complete(&f), complete(&bad);
        f.s.scene.replace_invalid = n & 1;
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        CHECK_OK(context, sps_tmap_add(map, n & 2 ? &f.s.scene : &bad.s.scene));
        CHECK_OK(context, sps_tmap_add(map, n & 2 ? &bad.s.scene : &f.s.scene));
        CHECK(sps_tmap_finish(map) == (n & 1 ? SPS_OK : SPS_ERROR_DATA));
        sps_get_stats(context, &stats);
        if (n & 1)
            CHECK_CASE("Found in review", "replace_invalid of one of several scenes in a map", "applies to all of them",
                       stats.values_replaced != 1, 0, "exact");
        sps_tmap_destroy(map);
        end(&f);
        end(&bad);
    }
    sps_destroy(context);
}

/* Particles that span too many tiles to be listed by tile: the same results as the sum of chords. 5 x 4 tiles of
   60 particles, 1200, are more than 8 (60 + 20). */
static void test_crowded_tiles(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = 0; technique < 2; ++technique) {
        check_random random = {15};
        fixture f;
        sps_tmap *map;
        begin(&f, technique ? SPS_TMAP_BEER : SPS_TMAP_DEEP);
        f.light.width = 300, f.light.height = 200;
        for (int i = 0; i < (check_memory_only() ? 15 : 60); ++i)
            add(&f, i % 2, check_next(&random), check_next(&random), 4 * check_next(&random), 8 + check_next(&random),
                0.2 * check_next(&random));
        map = must_build(&f, context);
        CHECK(context->buffers[SPSI_BUFFER_SPHERE_LIST].data == NULL);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, 0, (int)(300 * check_next(&random)), (int)(200 * check_next(&random)),
                   technique ? 20 : 20 * check_next(&random), point);
            exact = exact_particles(&f, point);
            CHECK_CASE("Found in review", "map particles wider than eight tiles", "the sum of chords",
                       fabs(query_at(map, point) - exact.depth), exact.slack + 1e-5 * exact.depth,
                       "chords to 1e-3 at rims, as everywhere; sums of floats");
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* A query's result does not depend on the other points of the call, nor on whether texels are looked up a vector at a
   time, which those of very large maps are not: the same bits. */
static void test_company(void) {
    enum { POINTS = 3 * 16 + 5 }; /* some vectors of any width, and a part of one */
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 4, round = n % 2, variant = n / 2 % 2;
        float together[2][POINTS], alone[2];
        double points[3 * POINTS];
        check_random random = {(uint64_t)n + 5};
        sps_context *context = sps_create(NULL, NULL);
        sps_tmap *map;
        fixture f;
        begin_mixed(&f, technique);
        if (round) see(&f, ROUND, 2 * SIDE);
        f.settings.cubic = f.settings.texel_range = variant;
        map = must_build(&f, context);
        for (int i = 0; i < 3 * POINTS; ++i) points[i] = 14 * check_next(&random) - 7;
        if (map) {
            int same = 1;
            sps_tmap_query(map, POINTS, points, together[0], together[1]);
            for (int i = 0; i < POINTS; ++i) {
                sps_tmap_query(map, 1, points + 3 * i, &alone[0], &alone[1]);
                same &= memcmp(&alone[0], &together[0][i], sizeof(float)) == 0 &&
                        memcmp(&alone[1], &together[1][i], sizeof(float)) == 0;
            }
            CHECK(same);
            sps_tmap_destroy(map);
        }
        sps_destroy(context);
        end(&f);
    }
}

/* The results around a point: within the float round-off of its position, and up to a plane's distance along its ray,
   since tables are linear between planes. */
static void answers_about(const sps_tmap *map, const double point[3], double plane, double range[2]) {
    const double apart = 2e-5;
    const spsi_rays *rays = &map->grid.rays[0];
    double ray[3], t;
    vec_along(point, rays->origin, -1, ray);
    t = vec_dot(ray, rays->inverse[2]);
    if (map->grid.face_count > 1) t = fmax(fabs(ray[0]), fmax(fabs(ray[1]), fabs(ray[2])));
    if (map->grid.face_count == 1 && !rays->perspective) memcpy(ray, rays->c, sizeof ray), t = 1;
    range[0] = 1, range[1] = 0;
    for (int n = 0; n < 9; ++n) {
        double at[3];
        float through;
        memcpy(at, point, sizeof at);
        if (n < 6) at[n / 2] += n % 2 ? apart : -apart;
        if (n > 6) vec_along(point, ray, (n == 7 ? plane : -plane) / t, at);
        sps_tmap_query(map, 1, at, NULL, &through);
        range[0] = fmin(range[0], (double)through), range[1] = fmax(range[1], (double)through);
    }
}

/* A vector of points in floats, as looked up for pictures. */
static void check_lookup(const sps_tmap *map, const spsi_shadow_table *table, const double (*points)[3]) {
    const double plane = (map->grid.far_depth - map->grid.near_depth) / table->planes;
    const double step = (double)table->end / 65535; /* of packed optical depths */
    float lanes[3][SPSI_LANES], depths[SPSI_LANES];
    spsi_v q[3];
    for (int i = 0; i < SPSI_LANES; ++i) {
        double offset[3], rays[3];
        vec_along(points[i], map->grid.rays[0].origin, -1, offset);
        spsi_to_rays(&map->grid.rays[0], offset, rays);
        rays[2] -= map->settings.near_depth;
        for (int k = 0; k < 3; ++k) lanes[k][i] = (float)(map->grid.face_count > 1 ? offset[k] : rays[k]);
    }
    for (int k = 0; k < 3; ++k) q[k] = spsi_load(lanes[k]);
    spsi_store(depths, spsi_shadow_table_lookup(table, q));
    for (int i = 0; i < SPSI_LANES; ++i) {
        const double through = exp(-(double)depths[i]);
        double range[2];
        answers_about(map, points[i], plane, range);
        /* and the round-off of optical depths up to 16, in T */
        if (!CHECK(through >= range[0] * (1 - step) - 2e-6 && through <= range[1] * (1 + step) + 2e-6))
            printf("    %s at %g %g %g: %g, not %g .. %g\n", map->technique->name, points[i][0], points[i][1],
                   points[i][2], through, range[0], range[1]);
    }
}

/* The map of a light, evaluated at a table's planes, as for pictures. */
static void evaluate(const sps_tmap *map, spsi_shadow_table *table) {
    sps_tmap own = *map;
    memset(table, 0, sizeof *table);
    table->grid = map->grid;
    table->planes = 256;
    table->end = SPSI_LIGHT_END;
    spsi_buffer_reserve(map->context, &table->pairs,
                        (size_t)spsi_shadow_table_blocks(&table->grid) * SPSI_SHADOW_TABLE_TEXELS * 256,
                        sizeof(uint32_t));
    own.table = table;
    for (size_t i = 0; i < spsi_light_grid_texels(&map->grid); ++i) {
        const spsi_texel texel = spsi_tmap_texel(map, i);
        spsi_shadow_table_evaluate(&own, i, &texel);
    }
}

/* The shadow on a picture's gas agrees with sps_tmap_query to a plane's distance, even beyond the map's edges, behind
   the light, before near_depth, and where faces meet. */
static void test_lookups(void) {
    static const int ways[] = {ORTHO, SPOT, SPOT_TURNED, ROUND};
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int way = ways[n % 4];
        check_random random = {(uint64_t)n + 77};
        sps_context *context = sps_create(NULL, NULL);
        spsi_shadow_table evaluated;
        sps_tmap *map;
        fixture f;
        begin(&f, 1 + n / 4);
        see(&f, way, 13);
        scatter(&f, 0, 20, 3, 61);
        scatter(&f, 1, 20, 3, 62);
        f.settings.near_depth = way == ROUND ? 0.75 : 5;
        f.settings.far_depth = way == ROUND ? 9 : 18;
        map = must_build(&f, context);
        sps_tmap alone; /* tables begin before all gas, and have no fronts */
        if (map) evaluate(map, &evaluated), alone = *map, alone.data.fronts.data = NULL;
        for (int run = 0; run < 400 / SPSI_LANES + 1 && map; ++run) {
            double points[SPSI_LANES][3];
            for (int i = 0; i < SPSI_LANES; ++i) {
                const int kind = (run + i) % 8, axis = i % 3;
                for (int k = 0; k < 3; ++k) points[i][k] = 16 * check_next(&random) - 8;
                if (kind == 0) points[i][2] = 9 + 6 * check_next(&random); /* around the light, except for ROUND */
                if (way != ROUND || kind > 2) continue;
                for (int k = 0; k < 3; ++k) /* close to it, or on an edge or a corner of the cube */
                    points[i][k] = kind == 0                ? f.light.camera.position[k] + check_next(&random) - 0.5
                                   : kind == 1 && k == axis ? f.light.camera.position[k] + 0.5 * points[i][0]
                                                            : f.light.camera.position[k] + (k % 2 ? 2.5 : -2.5);
            }
            check_lookup(&alone, &evaluated, (const double(*)[3])points);
        }
        if (map) spsi_buffer_release(context, &evaluated.pairs);
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* A position that is not finite is outside every map. */
static void test_no_numbers(void) {
    const double infinite = HUGE_VAL, bad[] = {infinite, -infinite, infinite - infinite};
    for (int way = 0; way < WAYS; ++way)
        for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
            sps_context *context = sps_create(NULL, NULL);
            sps_tmap *map;
            fixture f;
            begin_little(&f, technique);
            see(&f, way, SIDE);
            map = must_build(&f, context);
            for (int n = 0; n < 3 * 7 && map; ++n) {
                float depth = 7, through = 7, least = 7, most = 7;
                double at[3] = {0.1, 0.2, -0.3};
                for (int k = 0; k < 3; ++k)
                    if ((n % 7 + 1) >> k & 1) at[k] = bad[n / 7];
                sps_tmap_query(map, 1, at, &depth, &through);
                sps_tmap_bounds(map, 1, at, &least, &most);
                if (!CHECK(!(fabsf(depth) > 0) && through >= 1 && !(fabsf(least) > 0) && !(fabsf(most) > 0)))
                    printf("    technique %d at %g %g %g\n", technique, at[0], at[1], at[2]);
            }
            sps_tmap_destroy(map);
            sps_destroy(context);
            end(&f);
        }
}

/* A face that does not exist, no map, or an unfinished one: an error, and nothing is written. */
static void check_unanswered(const sps_tmap *map, int face) {
    static const double at[3] = {0, 0, -5};
    static const float at_floats[3] = {0, 0, -5};
    float numbers[2] = {7, 7};
    double matrix[16] = {7}, bias[2] = {7, 7};
    sps_tmap_constants constants;
    constants.row_x[0] = 7;
    if (face == 0) {
        CHECK(sps_tmap_query(map, 1, at, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_query(map, 0, NULL, NULL, NULL) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_query_floats(map, 1, at_floats, 0, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
        CHECK(sps_tmap_bounds(map, 1, at, numbers, numbers + 1) == SPS_ERROR_ARGUMENT);
    }
    CHECK(sps_tmap_get_projection(map, face, matrix, bias) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_constants(map, face, &constants) == SPS_ERROR_ARGUMENT);
    CHECK(numbers[0] == 7 && numbers[1] == 7 && matrix[0] == 7 && bias[0] == 7 && bias[1] == 7);
    CHECK(constants.row_x[0] == 7);
}

/* Largest difference of two answers, relative to the first if that is above 1. */
static double farthest_apart(const float *a, const float *b, int count) {
    double apart = 0;
    for (int i = 0; i < count; ++i)
        apart = fmax(apart, fabs((double)a[i] - (double)b[i]) / fmax(1, fabs((double)a[i])));
    return apart;
}

/* Positions in floats, packed, interleaved in a vertex, and unaligned: the same answers as for doubles, except for
   round-off where the compiler fuses multiply and add differently in the two: a dozen operations, 6e-8 each. */
static void test_float_positions(void) {
    enum { COUNT = 3 * 16 + 5 };
    sps_context *context = sps_create(NULL, NULL);
    static const size_t strides[4] = {0, 12, 32, 13};
    for (int n = 0; n < 4; ++n) {
        const size_t step = strides[n] ? strides[n] : 12;
        char vertices[COUNT * 32 + 1];
        double positions[3 * COUNT];
        float expected[2][COUNT], found[2][COUNT];
        check_random random = {7};
        sps_tmap *map;
        fixture f;
        begin_little(&f, SPS_TMAP_DEFAULT);
        map = must_build(&f, context);
        memset(vertices, 0x7f, sizeof vertices); /* large numbers between them */
        for (int i = 0; i < COUNT; ++i) {
            float at[3];
            for (int k = 0; k < 3; ++k) at[k] = (float)(8 * check_next(&random) - 4);
            for (int k = 0; k < 3; ++k) positions[3 * i + k] = (double)at[k];
            memcpy(vertices + (n == 3) + (size_t)i * step, at, sizeof at);
        }
        CHECK(sps_tmap_query(map, COUNT, positions, expected[0], expected[1]) == SPS_OK);
        CHECK(sps_tmap_query_floats(map, COUNT, (const float *)(const void *)(vertices + (n == 3)), strides[n],
                                    found[0], found[1]) == SPS_OK);
        CHECK(fmax(farthest_apart(expected[0], found[0], COUNT), farthest_apart(expected[1], found[1], COUNT)) <=
                  1e-6 &&
              expected[1][0] < 1);
        memset(found, 0, sizeof found);
        CHECK(sps_tmap_query_floats(map, COUNT, (const float *)(const void *)(vertices + (n == 3)), strides[n], NULL,
                                    found[1]) == SPS_OK);
        CHECK(farthest_apart(expected[1], found[1], COUNT) <= 1e-6 && !(found[0][0] > 0));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* The sizes in sps_tmap_get_info for every technique: the number of floats is that of an upload, and bytes are those
   and little else (test_bytes has them exactly). */
static void test_info(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            const int lists = technique <= SPS_TMAP_COMPRESSED;
            const size_t texels = round ? 6 * SIDE * SIDE : 7 * SIDE;
            sps_tmap_info info[2];
            fixture f;
            sps_tmap *map;
            begin_little(&f, technique);
            if (round) see(&f, ROUND, SIDE);
            if (!round) f.light.height = 7;
            complete(&f);
            CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
            CHECK(sps_tmap_get_info(map, &info[0]) == SPS_OK);
            CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
            CHECK_OK(context, sps_tmap_finish(map));
            CHECK(sps_tmap_get_info(map, &info[1]) == SPS_OK);
            for (int i = 0; i < 2; ++i) {
                CHECK(info[i].width == SIDE && info[i].height == (round ? SIDE : 7));
                CHECK(info[i].face_count == (round ? 6 : 1) && info[i].texel_count == texels);
                CHECK(info[i].is_finished == i && info[i].settings.technique == (sps_tmap_technique)technique);
                CHECK(info[i].settings.far_depth == f.settings.far_depth);
                CHECK(info[i].item_floats == (technique == SPS_TMAP_DEEP ? 4
                                              : lists                    ? 2
                                                                         : info[i].settings.components));
                if (!lists) CHECK(info[i].float_count == texels * (size_t)info[i].item_floats);
            }
            if (lists) {
                CHECK(info[0].float_count == 0);
                CHECK(info[1].float_count == sps_tmap_starts(map)[texels] * (size_t)info[1].item_floats);
            }
            CHECK(info[1].bytes >= info[1].float_count * sizeof(float));
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* The block has the layout of std140: vectors of four floats at multiples of 16 bytes, then numbers of 4 bytes. */
#define AT(member, offset) typedef char at_##member[offsetof(sps_tmap_constants, member) == (offset) ? 1 : -1]

AT(row_x, 0);
AT(row_y, 16);
AT(row_w, 32);
AT(row_distance, 48);
AT(technique, 64);
AT(components, 68);
AT(has_range, 72);
AT(has_planes, 76);
AT(cubic, 80);
AT(has_surfaces, 84);
AT(width, 88);
AT(height, 92);
AT(near_depth, 96);
AT(far_depth, 100);
AT(bias, 104);
AT(bias_per_distance, 108);
AT(face, 112);
AT(face_count, 116);
AT(has_fronts, 120);
AT(border, 124);

typedef char size_of_constants[sizeof(sps_tmap_constants) == 128 ? 1 : -1];

static void check_row(const float row[4], const double exact[4]) {
    for (int i = 0; i < 4; ++i) CHECK_NEAR((double)row[i], exact[i], 6e-8 * fabs(exact[i]));
}

/* Constants are the projection of a face, rounded to floats, and the settings. test_sampling looks maps up by them. */
static void test_constants(void) {
    static const float planes[6] = {0.1f, 0.2f, 0.4f, 0.6f, 0.8f, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const int technique = n < 4 ? SPS_TMAP_OPACITY : SPS_TMAP_FOURIER;
        fixture f;
        sps_tmap *map;
        begin_little(&f, technique);
        see(&f, n % 4 == 3 ? ROUND : n % 4 == 2 ? ORTHO : SPOT_TURNED, SIDE);
        f.settings.near_depth = 0.25;
        if (technique == SPS_TMAP_OPACITY && n % 2) f.settings.planes = planes, f.settings.components = 6;
        f.settings.cubic = n % 4 == 1, f.settings.texel_range = n == 6;
        if (n == 2) f.s.scene.mesh_count = 0;
        map = must_build(&f, context);
        for (int face = 0; face < (n % 4 == 3 ? 6 : 1) && map; ++face) {
            double m[16], bias[2];
            sps_tmap_constants c;
            CHECK(sps_tmap_get_projection(map, face, m, bias) == SPS_OK);
            CHECK(sps_tmap_get_constants(map, face, &c) == SPS_OK);
            check_row(c.row_x, m), check_row(c.row_y, m + 4), check_row(c.row_distance, m + 8);
            check_row(c.row_w, m + 12);
            CHECK_NEAR((double)c.bias, bias[0], 6e-8 * bias[0]);
            CHECK_NEAR((double)c.bias_per_distance, bias[1], 6e-8 * bias[1]);
            CHECK(c.technique == technique && c.components == map->settings.components);
            CHECK(c.has_planes == (technique == SPS_TMAP_OPACITY && n % 2) && c.cubic == (n % 4 == 1));
            CHECK(c.has_range == (n == 6) && c.has_surfaces == (n != 2));
            CHECK(c.width == SIDE && c.height == SIDE && c.near_depth == 0.25f && c.far_depth == 20);
            CHECK(c.face == face && c.face_count == (n % 4 == 3 ? 6 : 1) && c.border == 0);
            CHECK(c.has_fronts == (sps_tmap_fronts(map) != NULL));
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* X / W, Y / W, D and W of a world point. */
static void project(const double m[16], const double point[3], double out[4]) {
    for (int i = 0; i < 4; ++i)
        out[i] = m[4 * i] * point[0] + m[4 * i + 1] * point[1] + m[4 * i + 2] * point[2] + m[4 * i + 3];
    out[0] /= out[3], out[1] /= out[3];
}

/* Texels of size 1 at z = 0, ten from the light, whose middle is texel (4, 4); the tolerance is round-off alone. */
static void test_projection(void) {
    const double at[2][3] = {{2.5, -1, 0}, {2.5, -1, 5}}, rounding = 1e-12;
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *map;
    fixture f;
    double m[16], bias[2] = {7, 7}, q[4];
    for (int way = ORTHO; way <= SPOT_MATRIX; ++way)
        for (int own_bias = 0; own_bias < 2; ++own_bias) {
            const int spot = way == SPOT || way == SPOT_MATRIX;
            begin(&f, SPS_TMAP_BEER);
            see(&f, way, SIDE);
            f.settings.surface_bias = own_bias * 0.3;
            map = must_build(&f, context);
            if (!map) continue;
            sps_tmap_get_projection(map, 0, m, bias);
            for (int i = 0; i < 2; ++i) {
                const double size = spot && i ? 0.5 : 1; /* of a texel there */
                project(m, at[i], q);
                CHECK_NEAR(q[0], 4 + 2.5 / size, rounding);
                CHECK_NEAR(q[1], 4 + 1 / size, rounding);
                CHECK_NEAR(q[2], i ? 5 : 10, rounding);
                CHECK_NEAR(q[3], spot ? q[2] : 1, rounding);
            }
            CHECK_NEAR(bias[0], own_bias ? 0.3 : spot ? 0 : 2, rounding);
            CHECK_NEAR(bias[1], own_bias || !spot ? 0 : 0.2, rounding);
            check_unanswered(map, 1);
            check_unanswered(map, -1);
            sps_tmap_destroy(map);
        }
    sps_destroy(context);
}

/* Six faces: the centres of the outermost texels lie on the cube's edges. */
static int messages_told;

static char last_message[256];

static void take_message(void *user, const char *text) {
    (void)user;
    messages_told += 1;
    snprintf(last_message, sizeof last_message, "%s", text);
}

/* Gas beyond far_depth is counted and reported; gas before near_depth, which is exact, is not. */
static void test_outside(void) {
    static const double depths[5][2] = {{0, 20}, {0, 10.5}, {9.5, 20}, {9.5, 10.5}, {0, 5}};
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int n = 0; n < 20; ++n) {
        const int way = n / 5 % 2 ? SPOT : ORTHO, voxels = n / 10;
        fixture f;
        sps_stats_report stats;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, way, SIDE);
        f.settings.near_depth = depths[n % 5][0], f.settings.far_depth = depths[n % 5][1];
        add(&f, 0, 0, 0, 0, 2, 1);
        add(&f, 1, 1, 1, 0, 2, 1);
        if (way == SPOT) add(&f, 0, 0, 0, 10, 2, 1); /* it contains the light, which loses nothing at near_depth 0 */
        if (voxels) add_box(&f, 4, 1, 0, 1);
        messages_told = 0;
        map = must_build(&f, context);
        sps_get_stats(context, &stats);
        const int beyond = depths[n % 5][1] < 20;
        CHECK(stats.particles_outside == (beyond ? 2u : 0u));
        CHECK_CASE("Found in review", "gas behind far_depth", "a message says so", messages_told != beyond, 0, "exact");
        CHECK(!beyond || (strstr(last_message, "voxels") != NULL) == voxels);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Particles seen by several of six faces count once, and messages mention only what there is. */
static void test_outside_around(void) {
    static const double toward[4][3] = {{1, 1, 1}, {1, -1, 0.2}, {0, 0, -1}, {-1, 0.1, 0}};
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int n = 0; n < 10; ++n) { /* far from the light and about it; voxels alone */
        fixture f;
        sps_stats_report stats;
        sps_tmap *map;
        begin(&f, SPS_TMAP_OPACITY);
        see(&f, ROUND, SIDE);
        if (n < 8) {
            const double *to = toward[n % 4], far_away = n < 4 ? 25 : 15;
            add(&f, 0, 0.5 + far_away * to[0], -0.25 + far_away * to[1], 1 + far_away * to[2], n < 4 ? 4 : 14, 1);
        } else {
            add_box(&f, 4, 22, 0, 1);
        }
        if (n == 9) f.settings.far_depth = 60;
        messages_told = 0;
        map = must_build(&f, context);
        sps_get_stats(context, &stats);
        if (!CHECK(stats.particles_outside == (n < 8))) printf("    case %d: %d\n", n, (int)stats.particles_outside);
        CHECK(messages_told == (n < 9));
        CHECK(n == 9 || strstr(last_message, n < 8 ? " counts there: 1 of the particles"
                                                   : " counts there: the box about all voxels"));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A light amid voxels lights everything outside its single view: message_fn is told of `omnidirectional`, unless that
   is set, the light is outside the voxels, or its rays are parallel and pass all of them. */
static void test_light_amid(void) {
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = take_message;
    context = sps_create(&config, NULL);
    for (int way = 0; way < WAYS; ++way)
        for (int inside = 0; inside < 2; ++inside) {
            const int one_view = way != ROUND && way != ORTHO && way != ORTHO_MATRIX && way != ORTHO_TURNED;
            fixture f;
            begin(&f, SPS_TMAP_OPACITY);
            see(&f, way, SIDE);
            f.settings.far_depth = 200;
            add_box(&f, 4, inside ? 60 : 0.2, 0, 1);
            messages_told = 0;
            last_message[0] = 0;
            sps_tmap_destroy(must_build(&f, context));
            CHECK((strstr(last_message, "omnidirectional") != NULL) == (one_view && inside));
            end(&f);
        }
    sps_destroy(context);
}

/* A border moves texels' numbers, and nothing else. */
static void test_border_projection(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int way = 0; way < ROUND; ++way) {
        double places[2][4];
        const double point[3] = {0.7, -1.3, 2.1};
        for (int border = 0; border < 4; border += 3) {
            fixture f;
            double m[16];
            begin(&f, SPS_TMAP_BEER);
            see(&f, way, SIDE);
            f.light.border = border;
            sps_tmap *map = must_build(&f, context);
            CHECK(sps_tmap_get_projection(map, 0, m, NULL) == SPS_OK);
            project(m, point, places[border > 0]);
            sps_tmap_destroy(map);
        }
        for (int k = 0; k < 4; ++k) CHECK_NEAR(places[1][k], places[0][k] + (k < 2 ? 3 : 0), 1e-12);
    }
    sps_destroy(context);
}

/* Two tiles with a border of one texel are halves of a map of twice the width, also within half a texel of their seam,
   where a tile without a border lacks the neighbour's texels. Rays agree to 1e-15, chords to 1e-6 (CHORD), ranges and
   planes are the same: 1e-4 of optical depths of up to 12, of which moments are a root. The larger map's border changes
   only its own edges. Points outside the view of a tile are lit in it. */
static void test_border(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 2 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 2, border = n % 2;
        fixture f;
        sps_tmap *tiles[2], *whole;
        double most = 0;
        begin_mixed(&f, technique);
        f.light.width = 2 * SIDE, f.light.height = SIDE, f.light.border = 1;
        whole = must_build(&f, context);
        f.light.width = SIDE, f.light.border = border;
        for (int i = 0; i < 2; ++i) {
            f.light.camera.position[0] = f.light.camera.target[0] = (i - 0.5) * SIDE;
            tiles[i] = must_build(&f, context);
        }
        for (int i = 0; i < 400 && whole && tiles[0] && tiles[1]; ++i) {
            const double x = i < 200 ? 0.5 * (i % 2 ? 1 : -1) * (i / 200.0) : 8.9 * cos(i), y = 4.4 * sin(0.7 * i);
            const double z = 9 * cos(0.3 * i);
            const double off = query(tiles[x > 0], x, y, z) - query(whole, x, y, z);
            most = fmax(most, fabs(off));
            CHECK_NEAR(query(tiles[x > 0], x > 0 ? -1e-3 : 1e-3, y, z), 0, 0);
        }
        if (!CHECK(border ? most < 1e-4 : most > 1e-3)) printf("    technique %d: %g\n", technique, most);
        for (int i = 0; i < 2; ++i) sps_tmap_destroy(tiles[i]);
        sps_tmap_destroy(whole);
        end(&f);
    }
    sps_destroy(context);
}

/* A surface before near_depth shades everything behind it and behind near_depth. */
static void test_surface_before_near(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int spot = 0; spot < 2; ++spot)
        for (int glass = 0; glass < 2; ++glass) {
            fixture f;
            sps_tmap *map;
            begin(&f, SPS_TMAP_OPACITY);
            see(&f, spot ? SPOT : ORTHO, SIDE);
            f.settings.near_depth = 5, f.settings.far_depth = 15, f.settings.surface_bias = 0.5;
            add_square(&f, 0, -30, 30, 30, 7); /* 3 before the light, 2 before near_depth */
            add_mesh(&f, 0, glass ? 0.5 : 0);
            map = must_build(&f, context);
            if (!glass) CHECK_NEAR(query(map, 0, 0, 4.99), DARK, 1e-7);
            CHECK_CASE("Found in review", "surfaces before near_depth, opaque and translucent",
                       "shade all that is behind", fabs(query(map, 0, 0, -6) - (glass ? log(2.0) : DARK)), 1e-7,
                       "floats");
            CHECK_NEAR(query(map, 0, 0, 5.01), 0, 0);
            if (!glass) CHECK_NEAR((double)sps_tmap_surfaces(map)[SIDE * SIDE / 2], -0.2, 1e-6);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

static void test_projection_round(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *map;
    fixture f;
    double m[16], bias[2], q[4];
    begin(&f, SPS_TMAP_BEER);
    see(&f, ROUND, SIDE);
    map = must_build(&f, context);
    for (int face = 0; face < 6 && map; ++face) {
        const int axis = face / 2;
        double at[3];
        memcpy(at, f.light.camera.position, sizeof at);
        at[axis] += face % 2 ? -2 : 2;
        at[(axis + 1) % 3] += 2;
        at[(axis + 2) % 3] -= 1;
        sps_tmap_get_projection(map, face, m, bias);
        project(m, at, q);
        CHECK_NEAR(q[0], SIDE - 1, 1e-12);
        CHECK_NEAR(q[1], 0.25 * (SIDE - 1), 1e-12);
        CHECK_NEAR(q[2], 2, 1e-12);
        sps_tmap_get_projection(map, face ^ 1, m, NULL);
        project(m, at, q);
        CHECK_NEAR(q[3], -2, 1e-12);
        CHECK_NEAR(bias[0], 0, 0);
        CHECK_NEAR(bias[1], 4.0 / (SIDE - 1), 1e-12);
    }
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* clip = projection * camera of a spot at `from` that looks at (0,0,0) and sees 0.4 on either side of its axis per unit
   of depth; row-major, or column-major as in many maths libraries. */
static void spot_matrix(const double from[3], int by_columns, double matrix[16]) {
    double axes[3][3], rows[4][4];
    for (int i = 0; i < 3; ++i) axes[2][i] = -from[i];
    vec_normalise(axes[2]);
    vec_basis(axes[2], axes[0], axes[1]);
    for (int i = 0; i < 4; ++i) {
        const double *axis = axes[i < 3 ? i : 2], scale = i < 2 ? 2.5 : 1;
        for (int k = 0; k < 3; ++k) rows[i][k] = scale * axis[k];
        rows[i][3] = -scale * vec_dot(axis, from) - (i == 2 ? 1 : 0);
    }
    for (int i = 0; i < 16; ++i) matrix[i] = by_columns ? rows[i % 4][i / 4] : rows[i / 4][i % 4];
}

/* A matrix that was not transposed is refused, and the sentence says why (see test_matrices.c). For a view that is too
   wide by itself, the sentence says to narrow it, and mentions no matrix. */
static void test_untransposed(void) {
    static const double from[3][3] = {{7, -3, 1}, {1, 7, 2}, {4, 6, -1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 9; ++n) { /* row-major, by columns, none but a wide angle */
        double matrix[16];
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        add_box(&f, 4, 1, 0, 1);
        memcpy(f.light.camera.position, from[n / 3], sizeof f.light.camera.position);
        spot_matrix(from[n / 3], n % 3 == 1, matrix);
        if (n % 3 < 2) check_matrix(&f.light.camera, matrix);
        if (n % 3 == 2) check_perspective(&f.light.camera, 3.05);
        map = build(&f, context);
        CHECK((map != NULL) == (n % 3 == 0));
        CHECK((strstr(sps_error(context), "narrow the light's view") != NULL) == (n % 3 == 2));
        if (!CHECK_CASE("Found in review", "a light's matrix that was not transposed", "the error says so",
                        (strstr(sps_error(context), "seems transposed: it must be row-major") != NULL) != (n % 3 == 1),
                        0, "exact"))
            printf("    %d: %s\n", n, sps_error(context));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A light whose target is its own position probably needs an omnidirectional map: the sentence names the setting. With
   that, or with a matrix, the target is not used. */
static void test_looks_nowhere(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) { /* as a spot; parallel; all round; by a matrix */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        if (n == 3) see(&f, SPOT_MATRIX, SIDE);
        add_box(&f, 4, 12, 0, 0.1);
        memcpy(f.light.camera.target, f.light.camera.position, sizeof f.light.camera.target);
        if (n == 0) check_perspective(&f.light.camera, 1);
        f.light.omnidirectional = n == 2;
        map = build(&f, context);
        CHECK((map != NULL) == (n >= 2));
        if (n < 2) CHECK(strstr(sps_error(context), "light.omnidirectional is 1, all round") != NULL);
        if (n == 2) CHECK(query(map, 0, 0, 5) > 0.1 && query(map, 5, 0, 10) > 0.1 && query(map, 0, -5, 11) > 0.1);
        if (n == 3) CHECK(query(map, 0, 0, 5) > 0.1);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

static void leave(int number) {
    (void)number;
    _exit(3);
}

/* Destroying a context before its maps is an error that SPS_ASSERT catches; here in a separate process. */
static void test_context_before_maps(void) {
    for (int kept = 0; kept < 2; ++kept) {
        sps_context *context = sps_create(NULL, NULL);
        fixture f;
        sps_tmap *map;
        int status = -1;
        pid_t child;
        begin(&f, SPS_TMAP_BEER);
        map = must_build(&f, context);
        fflush(stdout);
        child = fork();
        if (child == 0) {
            signal(SIGABRT, leave);
            if (!freopen("/dev/null", "w", stderr)) _exit(4);
            if (!kept) sps_tmap_destroy(map);
            sps_destroy(context);
            _exit(0);
        }
        CHECK(child > 0 && waitpid(child, &status, 0) == child);
        CHECK_CASE("Found in review", "context destroyed before its map", "an assertion",
                   !WIFEXITED(status) || WEXITSTATUS(status) != (kept ? 3 : 0), 0, "exact");
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* Calls on a map in the wrong state. */
static void test_states(void) {
    const double points[6] = {0, 0, -5, 1, 1, -5};
    float depths[2] = {7, 7}, passes[2] = {7, 7}, least[2] = {7, 7}, most[2] = {7, 7};
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap_settings resolved;
    sps_tmap_info info;
    sps_tmap *map = (sps_tmap *)(void *)&resolved;
    fixture f;
    begin_little(&f, SPS_TMAP_OPACITY);
    complete(&f);
    CHECK(sps_tmap_create(NULL, &f.light, &f.settings, &map) == SPS_ERROR_ARGUMENT && map == NULL);
    CHECK(sps_tmap_create(context, NULL, &f.settings, &map) == SPS_ERROR_ARGUMENT &&
          strstr(sps_error(context), "NULL"));
    CHECK(sps_tmap_create(context, &f.light, NULL, &map) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_create(context, &f.light, &f.settings, NULL) == SPS_ERROR_ARGUMENT);
    CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
    check_unanswered(map, 0);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.is_finished == 0 && info.width == SIDE);
    CHECK(!sps_tmap_texels(map) && !sps_tmap_starts(map) && !sps_tmap_surfaces(map) && !sps_tmap_fronts(map));
    CHECK(sps_tmap_add(map, NULL) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "scene"));
    CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
    CHECK_OK(context, sps_tmap_finish(map));
    CHECK(sps_tmap_finish(map) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "finished"));
    CHECK(sps_tmap_add(map, &f.s.scene) == SPS_ERROR_ARGUMENT && strstr(sps_error(context), "finished"));
    CHECK(sps_tmap_query(map, 2, points, depths, NULL) == SPS_OK);
    CHECK(sps_tmap_query(map, 2, points, NULL, passes) == SPS_OK);
    CHECK(sps_tmap_bounds(map, 2, points, least, NULL) == SPS_OK);
    CHECK(sps_tmap_bounds(map, 2, points, NULL, most) == SPS_OK);
    CHECK(depths[0] > 0 && passes[0] < 1 && least[0] <= depths[0] && most[0] >= depths[0]);
    CHECK(sps_tmap_starts(map) == NULL && sps_tmap_texels(map));
    CHECK(sps_tmap_query(map, 0, NULL, NULL, NULL) == SPS_OK && sps_tmap_bounds(map, 0, NULL, NULL, NULL) == SPS_OK);
    CHECK(sps_tmap_query_floats(map, 0, NULL, 0, NULL, NULL) == SPS_OK);
    const float answers[4] = {depths[0], passes[0], least[0], most[0]};
    CHECK(sps_tmap_query(map, 1, NULL, depths, passes) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_query_floats(map, 1, NULL, 0, depths, passes) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_bounds(map, 1, NULL, least, most) == SPS_ERROR_ARGUMENT);
    CHECK(depths[0] == answers[0] && passes[0] == answers[1] && least[0] == answers[2] && most[0] == answers[3]);
    CHECK(*sps_error(context) != 0); /* of sps_tmap_add: queries leave it alone */
    check_unanswered(NULL, 0);
    check_unanswered(map, 1);
    check_unanswered(map, -1);
    CHECK(sps_tmap_get_constants(map, 0, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_info(NULL, &info) == SPS_ERROR_ARGUMENT && info.width == SIDE);
    CHECK(sps_tmap_get_info(map, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.is_finished == 1);
    resolved = check_settings_of(map);
    CHECK(resolved.components == 8 && resolved.epsilon > 0.009f && resolved.far_depth >= 20);
    CHECK(sps_tmap_finish(NULL) == SPS_ERROR_ARGUMENT);
    CHECK(!sps_tmap_texels(NULL) && !sps_tmap_starts(NULL) && !sps_tmap_surfaces(NULL) && !sps_tmap_fronts(NULL));
    sps_tmap_destroy(NULL);
    sps_tmap_destroy(map);
    end(&f);
    sps_destroy(context);
}

/* Providers that count their calls together, and fail at one of them. */
static struct {
    long calls, fail_at, progress, cancel_at;
    fixture *f;
} provider;

static int provider_counts(void) { return ++provider.calls == provider.fail_at ? 7 : 0; }

static int failing_particles(void *user, size_t first, size_t count, sps_particle *out) {
    read_crowd(user, first, count, out);
    return provider_counts();
}

static int failing_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    check_read_triangles(user, first, count, out);
    return provider_counts();
}

static int failing_voxels(void *user, size_t count, const double *positions, float *out) {
    check_eval_field(user, count, positions, out);
    return provider_counts();
}

static int failing_range(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)user, (void)lo, (void)size;
    out[0] = 0, out[1] = 1;
    return provider_counts();
}

static int failing_progress(void *user, float fraction) {
    (void)user;
    CHECK(fraction >= 0 && fraction <= 1);
    return ++provider.progress == provider.cancel_at;
}

static int rising_progress(void *user, float fraction) {
    float *seen = (float *)user; /* the last value, and the number of values between reading and the end */
    CHECK(fraction >= seen[0] && fraction <= 1);
    if (fraction > seen[0] && fraction > 0.2f && fraction < 1) seen[1] += 1;
    seen[0] = fraction;
    return 0;
}

/* Progress rises from face to face and from one band of rows to the next, and ends at 1. */
static void test_progress(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            float seen[2] = {0, 0};
            sps_config config;
            sps_context *context;
            fixture f;
            memset(&config, 0, sizeof config);
            config.progress_fn = rising_progress;
            config.clock_fn = check_hasty_clock;
            config.progress_user = seen;
            context = sps_create(&config, NULL);
            begin_little(&f, technique);
            if (round) see(&f, ROUND, 5);
            if (!round) f.light.width = 3, f.light.height = 200;
            sps_tmap_destroy(must_build(&f, context));
            CHECK_CASE("Found in review", "progress of maps that are made from lists",
                       "told for every band and face; ends at 1", !(seen[1] > (round ? 4 : 2) && seen[0] >= 1), 0,
                       "exact");
            sps_destroy(context);
            end(&f);
        }
}

/* Every call of every callback fails in turn, then every call of progress_fn cancels: a failed map cannot be queried,
   and the context is still usable. */
static void test_callbacks(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3)
        for (int cancels = 0; cancels < 2; ++cancels)
            for (int last = 0, n = 1; !last; ++n) {
                sps_config config;
                sps_context *context;
                fixture f;
                sps_tmap *map = NULL;
                sps_result result;
                memset(&config, 0, sizeof config);
                memset(&provider, 0, sizeof provider);
                config.progress_fn = failing_progress;
                config.clock_fn = check_hasty_clock;
                context = sps_create(&config, NULL);
                begin_little(&f, technique);
                f.sets[0].read_fn = f.sets[1].read_fn = failing_particles;
                f.s.mesh[0].read_fn = f.s.mesh[1].read_fn = failing_triangles;
                f.s.volume[0].eval_fn = failing_voxels, f.s.volume[0].range_fn = failing_range;
                complete(&f);
                CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
                CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
                CHECK(provider.calls == 0);
                if (cancels)
                    provider.cancel_at = n;
                else
                    provider.fail_at = n;
                result = sps_tmap_finish(map);
                last = cancels ? provider.progress < n : provider.calls < n;
                CHECK(result == (last ? SPS_OK : cancels ? SPS_ERROR_CANCELLED : SPS_ERROR_CALLBACK));
                if (!last) {
                    CHECK(strstr(sps_error(context), cancels ? "cancelled by progress_fn" : "failed: it returned 7"));
                    CHECK(!sps_tmap_texels(map) && !(query(map, 0, 0, -9) > 0));
                    CHECK(sps_tmap_finish(map) == SPS_ERROR_ARGUMENT);
                    CHECK(sps_tmap_add(map, &f.s.scene) == SPS_ERROR_ARGUMENT);
                }
                provider.cancel_at = provider.fail_at = 0;
                check_renders(context);
                sps_tmap_destroy(map);
                sps_destroy(context);
                end(&f);
                if (last) CHECK(n > (cancels ? 3 : 5));
            }
}

/* --------------------------------------------------------------------------------------------------------- extremes */

/* Finite numbers only, and T = exp(-depth), at random points in and around a map. */
static void check_sane(const sps_tmap *map, uint64_t seed) {
    check_random random;
    random.state = seed;
    for (int i = 0; i < 150 && map; ++i) {
        double point[3];
        float depth, passes, least, most;
        for (int k = 0; k < 3; ++k)
            point[k] = map->view.camera.position[k] +
                       (i % 5 ? 1.2 : 1e3) * map->settings.far_depth * (2 * check_next(&random) - 1);
        sps_tmap_query(map, 1, point, &depth, &passes);
        sps_tmap_bounds(map, 1, point, &least, &most);
        if (!CHECK(depth >= 0 && depth <= 1e15f && passes >= 0 && passes <= 1 && least >= 0 && most <= 1e15f))
            printf("    technique %d depth %g\n", (int)map->settings.technique, (double)depth);
        CHECK_NEAR((double)passes, exp(-(double)depth), 2e-6 * (double)passes + 1e-37);
        CHECK((double)least <= (double)depth * 1.00001 + 1e-5 && (double)depth <= (double)most * 1.00001 + 1e-5);
    }
}

/* Faintest and densest gas: behind all of it, results are right up to the round-off of a chord and a sum of two. */
static void test_depths(void) {
    static const double depths[5] = {1e-8, 1e-3, 1e8, 1e18, 0};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 5 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 5;
        const double exact = fmin(depths[n % 5], 1e15);
        fixture f;
        sps_tmap *map;
        begin(&f, technique);
        if (technique == SPS_TMAP_COMPRESSED) f.settings.components = 16; /* exact behind everything */
        add(&f, 0, 0, 0, 1, 2, depths[n % 5]);
        add(&f, 1, 0, 0, -1, 2, 0);
        map = must_build(&f, context);
        if (technique != SPS_TMAP_COMPRESSED || exact > 1e-4) /* T is a float: 6e-8 of depth */
            CHECK_NEAR(query(map, 0, 0, -10), technique == SPS_TMAP_COMPRESSED && exact > 100 ? DARK : exact,
                       (technique == SPS_TMAP_COMPRESSED ? 2e-4 : 2e-6) * exact);
        CHECK_NEAR(query(map, 4, 4, -10), 0, 1e-15);
        check_sane(map, 7);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Sizes that are not multiples of a tile, a vector, or anything. */
static void test_sizes(void) {
    static const int sizes[6][2] = {{1, 1}, {67, 65}, {130, 3}, {3, 130}, {64, 64}, {65, 1}};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 7 * 6; ++n) {
        static const int techniques[6] = {SPS_TMAP_DEEP,   SPS_TMAP_DEEP_OPACITY, SPS_TMAP_FOURIER,
                                          SPS_TMAP_MOMENT, SPS_TMAP_COMPRESSED,   SPS_TMAP_BEER};
        const int size = n / 6;
        check_random random = {23};
        fixture f;
        sps_tmap *map;
        begin(&f, techniques[n % 6]);
        if (size == 6)
            see(&f, ROUND, 1);
        else
            f.light.width = sizes[size][0], f.light.height = sizes[size][1];
        if (f.light.height == 1) check_orthographic(&f.light.camera, 1);
        scatter(&f, 0, 30, 6, 71);
        scatter(&f, 1, 30, 6, 72);
        for (int i = 0; i < 60; ++i) f.crowds[i % 2].list[i / 2].radius += size == 6 ? 20 : size == 0 ? 7 : 2;
        map = must_build(&f, context);
        for (int i = 0; i < 200 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, size == 6 ? i % 6 : 0, (int)(f.light.width * check_next(&random)),
                   (int)(f.light.height * check_next(&random)), i % 3 ? 20 * check_next(&random) : 20, point);
            exact = exact_particles(&f, point);
            if (n % 6 == 0 || (i % 3 == 0 && techniques[n % 6] != SPS_TMAP_COMPRESSED))
                if (!CHECK_NEAR(query_at(map, point), exact.depth, exact.slack + 1e-5 * exact.depth))
                    printf("    size %d technique %d\n", size, techniques[n % 6]);
        }
        check_sane(map, 9);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* Ranges of almost no width, or far from all gas, which is then entirely before or behind. */
static void test_ranges(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 5; ++n) {
            static const double ranges[5][2] = {
                {10, 1 + 1e-12}, {0.1, 5}, {100, 2}, {12, 1 + 1e-12}, {1e-3, 1 + 1e-12}};
            const double near_depth = ranges[n][0], far_depth = near_depth * ranges[n][1];
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            f.settings.near_depth = near_depth, f.settings.far_depth = far_depth;
            add(&f, 0, 0, 0, 0, 1.5, 2); /* depths 8.5 .. 11.5 */
            add(&f, 1, 0, 0, 0, 1.5, 0.5);
            add_square(&f, 0, -30, 30, 30, 1);
            add_mesh(&f, 0, 0.8);
            map = must_build(&f, context);
            CHECK_NEAR(query(map, 0, 0, 10 - 0.99 * near_depth), 0, 0);
            CHECK_NEAR(through(map, 0, 0, 10 - fmax(far_depth, 12)), 0.8 * exp(-2.5),
                       technique == SPS_TMAP_COMPRESSED ? 0.01 : 1e-5); /* its T is off by epsilon at most */
            if (technique == SPS_TMAP_DEEP && n != 1 && n != 4) {
                /* at near_depth: all that lies before. The middle of the chord, for n = 0, to 6e-8 of its 10. */
                const double before = n == 0 ? 1.25 : 2.5;
                CHECK_NEAR(query(map, 0, 0, 10 - near_depth), before - log(0.8), n == 2 ? 1e-6 : 3e-6);
            }
            check_sane(map, 13);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

static void test_nothing(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int n = 0; n < 4; ++n) {
            fixture f;
            sps_tmap *map;
            begin_little(&f, technique);
            if (n < 2) f.s.scene.volume_count = f.s.scene.mesh_count = 0, f.crowds[0].count = f.crowds[1].count = 0;
            if (n == 1) see(&f, ROUND, 5);
            if (n >= 2) check_set3(f.light.camera.target, 0, 0, 20); /* looks away */
            if (n == 3) check_perspective(&f.light.camera, 0.5);
            map = must_build(&f, context);
            check_sane(map, 3);
            CHECK_NEAR(query(map, 0, 0, n == 2 ? 10 : n == 3 ? 15 : -5), n == 2 ? query(map, 0, 0, 10) : 0, 1e-15);
            if (n < 2) CHECK_NEAR(through(map, 0, 0, -5), 1, 1e-15);
            if (n < 2) CHECK(sps_tmap_surfaces(map) == NULL);
            if (n < 2 && technique <= SPS_TMAP_COMPRESSED) CHECK(sps_tmap_starts(map)[n ? 150 : SIDE * SIDE] == 0);
            sps_tmap_destroy(map);
            end(&f);
        }
    sps_destroy(context);
}

/* Scaled worlds, and ones far from the origin: the same results. Particles' positions are floats, so far away they are
   rounded to 1/16; the exact result uses the rounded positions. */
static void test_worlds(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 8; ++n) {
        const double scale = n % 4 == 1 ? 1e-3 : n % 4 == 2 ? 1e3 : 1, shift = n % 4 == 3 ? 1e6 : 0;
        check_random random = {33};
        fixture f, plain;
        sps_tmap *map, *same;
        begin_mixed(&plain, SPS_TMAP_DEEP);
        begin_mixed(&f, SPS_TMAP_DEEP);
        see(&f, n / 4 ? SPOT : ORTHO, SIDE);
        see(&plain, n / 4 ? SPOT : ORTHO, SIDE);
        for (int i = 0; i < 24; ++i) {
            sps_particle *p = &f.crowds[i % 2].list[i / 2];
            p->radius *= (float)scale;
            for (int k = 0; k < 3; ++k) p->position[k] = (float)((double)p->position[k] * scale + shift);
        }
        for (int k = 0; k < 3; ++k) {
            f.light.camera.position[k] = f.light.camera.position[k] * scale + shift;
            f.light.camera.target[k] += shift;
            for (int m = 0; m < 2; ++m) {
                f.s.mesh[m].placement.origin[k] = shift;
                f.s.mesh[m].placement.axis[k][k] = scale;
            }
            f.s.volume[0].placement.origin[k] = f.s.volume[0].placement.origin[k] * scale + shift;
            for (int a = 0; a < 3; ++a) f.s.volume[0].placement.axis[a][k] *= scale;
        }
        f.light.camera.ortho_height *= scale, f.settings.far_depth *= scale;
        f.s.volume[0].read_fn = plain.s.volume[0].read_fn = check_read_constant;
        f.s.volume[0].eval_fn = plain.s.volume[0].eval_fn = NULL;
        f.s.volume[0].user = plain.s.volume[0].user = &one;
        f.s.volume[0].extinction = (float)(0.1 / scale), plain.s.volume[0].extinction = 0.1f;
        if (shift > 0) f.crowds[0].count = f.crowds[1].count = plain.crowds[0].count = plain.crowds[1].count = 0;
        map = must_build(&f, context);
        same = must_build(&plain, context);
        for (int i = 0; i < 300 && map && same; ++i) {
            const int x = (int)(SIDE * check_next(&random)), y = (int)(SIDE * check_next(&random));
            const double t = 19.9 * check_next(&random);
            double point[3], other[3];
            on_ray(map, 0, x, y, t * scale, point);
            on_ray(same, 0, x, y, t, other);
            /* floats of places, 1e-7 of 10, at the rims of 24 chords; of slabs, where 1e6 has lost 10 digits of a
             * double */
            CHECK_NEAR(through(map, point[0], point[1], point[2]), through(same, other[0], other[1], other[2]), 1e-3);
        }
        sps_tmap_destroy(map);
        sps_tmap_destroy(same);
        end(&f);
        end(&plain);
    }
    sps_destroy(context);
}

/* Particles far from the world's origin, against chords. */
static void test_far_away(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int way = ORTHO; way <= SPOT; ++way) {
        check_random random = {37};
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_DEEP);
        see(&f, way, SIDE);
        scatter(&f, 0, 40, 5, 91);
        for (int k = 0; k < 3; ++k) {
            f.light.camera.position[k] += 1e6, f.light.camera.target[k] += 1e6;
            for (int i = 0; i < 40; ++i) f.crowds[0].list[i].position[k] += 1e6f;
        }
        map = must_build(&f, context);
        for (int i = 0; i < 400 && map; ++i) {
            double point[3];
            answer exact;
            on_ray(map, 0, (int)(SIDE * check_next(&random)), (int)(SIDE * check_next(&random)),
                   20 * check_next(&random), point);
            exact =
                exact_particles(&f, point); /* by squares of 1e6, which leave 1e-4 of doubles: 4 times CHORD's 1e-3 */
            CHECK_NEAR(query_at(map, point), exact.depth, exact.slack + 4e-3);
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* The longest map, and the widest spot: right for particles; volumes are refused, with a cosine in the sentence. */
static void test_wide(void) {
    sps_context *context = sps_create(NULL, NULL);
    fixture f;
    sps_tmap *map;
    size_t empty;
    begin(&f, SPS_TMAP_BEER);
    map = must_build(&f, context);
    empty = check_bytes_of(map) - SIDE * SIDE * 12;
    sps_tmap_destroy(map);
    f.light.width = 16384, f.light.height = 1;
    check_orthographic(&f.light.camera, 0.001);
    add(&f, 0, 5, 0, 0, 2, 3);
    map = must_build(&f, context);
    CHECK(map && check_bytes_of(map) == empty + 16384 * 12);
    CHECK_NEAR(query(map, 5, 0, -10), 3, 3e-6);
    CHECK_NEAR(query(map, 6.0005, 0, -10), 3 * sqrt(1 - 1.0005 * 1.0005 / 4), 1e-5);
    CHECK_NEAR(query(map, -7.9, 0, -10), 0, 0);
    sps_tmap_destroy(map);
    begin(&f, SPS_TMAP_DEEP);
    see(&f, SPOT, 151);
    check_perspective(&f.light.camera, 3);
    scatter(&f, 0, 60, 6, 77);
    for (int i = 0; i < 60; ++i) f.crowds[0].list[i].radius += 2; /* 0.75 texels, 0.187 t, at 20 */
    map = must_build(&f, context);
    for (int i = 0; i < 600 && map; ++i) {
        double point[3];
        answer exact;
        on_ray(map, 0, i * 7 % 151, i * 31 % 151, i % 19 + 0.5, point);
        exact = exact_particles(&f, point);
        CHECK_NEAR(query_at(map, point), exact.depth,
                   5 * exact.slack); /* positions of near ones are floats of up to 10 radii */
    }
    sps_tmap_destroy(map);
    add_box(&f, 4, 1, 0, 1);
    map = build(&f, context);
    CHECK(!map && strstr(sps_error(context), "light.camera's outermost rays' cosine with its axis is 0.0") &&
          strstr(sps_error(context), "0.1"));
    check_perspective(&f.light.camera, 2);
    f.light.height = 9, f.light.width = 9;
    map = must_build(&f, context);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* Slabs are for volumes: neither a distant particle, nor many that are much smaller than voxels, change them. */
static void test_stray(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *maps[3];
    for (int n = 0; n < 3; ++n) {
        fixture f;
        begin(&f, SPS_TMAP_DEEP);
        add_box(&f, 8, 2, 0.3, 0.5);
        if (n == 1) add(&f, 0, 0, 0, -3e7, 1, 1); /* behind far_depth, and 1e8 voxels away */
        for (int i = 0; i < 20 && n == 2; ++i) add(&f, 0, 300, 0, 0.001 * i, 1e-5, 1);
        maps[n] = must_build(&f, context);
    }
    for (int i = 0; i < 200 && maps[0] && maps[1] && maps[2]; ++i)
        for (int n = 1; n < 3; ++n)
            CHECK_NEAR(query(maps[n], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i),
                       query(maps[0], i % 7 - 3, i % 5 - 2, 9 - 0.09 * i), 0);
    if (maps[0] && maps[2]) CHECK(check_bytes_of(maps[0]) == check_bytes_of(maps[2]));
    for (int n = 0; n < 3; ++n) sps_tmap_destroy(maps[n]);
    sps_destroy(context);
}

int main(void) {
    RUN(test_default_technique);
    RUN(test_settings);
    RUN(test_planes);
    RUN(test_scenes);
    RUN(test_replaced);
    RUN(test_replaced_of_several);
    RUN(test_crowded_tiles);
    RUN(test_company);
    RUN(test_lookups);
    RUN(test_no_numbers);
    RUN(test_float_positions);
    RUN(test_info);
    RUN(test_constants);
    RUN(test_projection);
    RUN(test_projection_round);
    RUN(test_outside);
    RUN(test_outside_around);
    RUN(test_light_amid);
    RUN(test_border_projection);
    RUN(test_border);
    RUN(test_surface_before_near);
    RUN(test_states);
    RUN(test_untransposed);
    RUN(test_looks_nowhere);
    RUN(test_context_before_maps);
    RUN(test_progress);
    RUN(test_callbacks);
    RUN(test_depths);
    RUN_LONG(test_sizes);
    RUN(test_ranges);
    RUN(test_nothing);
    RUN(test_worlds);
    RUN(test_far_away);
    RUN(test_wide);
    RUN(test_stray);
    return check_report();
}
