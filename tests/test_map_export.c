/* Maps exported as textures: where each number stands in each layout, what each format keeps, empty texels, cube maps
   as hardware reads them, and Beer shadow maps as engines define them. */

#include "check.h"

#include "map_scene.h"

enum { BYTES = 4 << 20 };

static unsigned char exported[BYTES], again[BYTES];

static sps_tmap_export_settings wanted(sps_export_format format, sps_export_layout layout) {
    sps_tmap_export_settings settings;
    memset(&settings, 0, sizeof settings);
    settings.format = format, settings.layout = layout;
    return settings;
}

static int export_into(sps_tmap *map, const sps_tmap_export_settings *settings, sps_tmap_texture *texture) {
    memset(exported, 0xcd, sizeof exported);
    return CHECK_OK(map->context, sps_tmap_export(map, settings, exported, sizeof exported, texture)) &&
           CHECK(texture->bytes <= sizeof exported) &&
           CHECK(texture->bytes == sizeof exported || exported[texture->bytes] == 0xcd);
}

/* A half as IEEE 754 defines it. */
static double half_value(unsigned bits) {
    const int exponent = (int)(bits >> 10 & 31);
    const double fraction = (bits & 1023) / 1024.0,
                 size = exponent ? ldexp(1 + fraction, exponent - 15) : ldexp(fraction, -14);
    return bits & 0x8000 ? -size : size;
}

/* What a texture returns for an element. */
static double fetched(sps_export_format format, size_t place) {
    float single;
    uint16_t number;
    memcpy(&single, exported + 4 * place, sizeof single);
    memcpy(&number, exported + 2 * place, sizeof number);
    return format == SPS_EXPORT_FLOAT     ? (double)single
           : format == SPS_EXPORT_HALF    ? half_value(number)
           : format == SPS_EXPORT_UNORM16 ? number / 65535.0
                                          : exported[place] / 255.0;
}

static double decoded(const sps_tmap_texture *texture, sps_export_format format, size_t place, int k) {
    const sps_export_constants *c = &texture->constants;
    return (double)c->offset[k] + (double)c->scale[k] * fetched(format, place);
}

/* Components of a map's texel, its front last. */
static double component(const sps_tmap *map, size_t texel, int k) {
    const int n = check_settings_of(map).components;
    return (double)(k < n ? sps_tmap_texels(map)[texel * (size_t)n + (size_t)k] : sps_tmap_fronts(map)[texel]);
}

/* ---------------------------------------------------------------------------------------------------------- layouts */

/* Place of component k of a texel, told in words: slices stand one below the other; so do layers, each RGBA; an atlas
   has tiles in rows. */
static size_t place_of(const sps_tmap_texture *t, sps_export_layout layout, const sps_tmap *map, const int at[3],
                       int k) {
    const int width = map->grid.rays[0].width, height = map->grid.rays[0].height, count = t->constants.components;
    const int per_face = layout == SPS_EXPORT_SLICES ? count : (count + 3) / 4;
    const int layer = at[2] * per_face + (layout == SPS_EXPORT_SLICES ? k : k / 4);
    if (layout == SPS_EXPORT_SLICES) return (size_t)((layer * height + at[1]) * width + at[0]);
    if (layout == SPS_EXPORT_ARRAY) return (size_t)(4 * ((layer * height + at[1]) * width + at[0]) + k % 4);
    const int x = layer % t->constants.columns * width + at[0], y = layer / t->constants.columns * height + at[1];
    return (size_t)(4 * (y * t->width + x) + k % 4);
}

/* Each number of each texel stands where it should, and nothing else does: oblong maps and cubes, with fronts and
   without. */
static void test_layouts(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 5 * 4 * 3; ++n) {
        const int technique = SPS_TMAP_OPACITY + n % 5, round = n / 5 % 2, fronts = n / 10 % 2;
        const sps_export_layout layout = (sps_export_layout)(n / 20);
        sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, layout);
        sps_tmap_texture t;
        fixture f;
        begin_little(&f, technique);
        if (round) see(&f, ROUND, SIDE);
        if (!round) f.light.width = 13, see(&f, SPOT, SIDE), f.light.width = 13;
        if (fronts) f.settings.near_depth = 1.5;
        settings.keep_empty = 1;
        sps_tmap *map = must_build(&f, context);
        const int count = check_settings_of(map).components + (sps_tmap_fronts(map) != NULL);
        const int width = map->grid.rays[0].width, faces = map->grid.face_count;
        CHECK(!sps_tmap_fronts(map) == !fronts);
        if (!export_into(map, &settings, &t)) continue;
        CHECK(t.constants.components == count && t.clamped == 0 && t.channels == (layout == SPS_EXPORT_SLICES ? 1 : 4));
        const int tiles = faces * (layout == SPS_EXPORT_SLICES ? count : (count + 3) / 4);
        if (layout == SPS_EXPORT_ATLAS)
            CHECK(t.layers == 1 && t.width == width * t.constants.columns &&
                  t.width / width * (t.height / SIDE) >= tiles);
        else
            CHECK(t.layers == tiles && t.width == width && t.height == SIDE && t.constants.columns == 1);
        CHECK(t.bytes == (size_t)(4 * t.width * t.height * t.layers * t.channels));
        double sum = 0, all = 0, wrong = 0;
        for (size_t i = 0; i < t.bytes / 4; ++i) all += fabs(fetched(SPS_EXPORT_FLOAT, i));
        for (int i = 0; i < faces * SIDE * width; ++i)
            for (int k = 0; k < count; ++k) {
                const int at[3] = {i % width, i / width % SIDE, i / width / SIDE};
                const double value = fetched(SPS_EXPORT_FLOAT, place_of(&t, layout, map, at, k));
                wrong = fmax(wrong, fabs(value - component(map, (size_t)i, k)));
                sum += fabs(value);
            }
        CHECK(wrong <= 0);
        CHECK_NEAR(sum, all, 1e-12 * all);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------------------------- formats */

/* All halves are themselves; between two, the nearer, and of equally near ones the even. */
static void test_halves(void) {
    for (unsigned bits = 0; bits < 0x7c00; ++bits) {
        const double value = half_value(bits), next = bits < 0x7bff ? half_value(bits + 1) : value;
        const float middle = (float)(0.5 * (value + next));
        CHECK(spsi_to_half((float)value) == bits && (bits == 0 || spsi_to_half((float)-value) == (bits | 0x8000)));
        if (bits == 0x7bff) break;
        CHECK(spsi_to_half(middle) == bits + (bits & 1));
        CHECK(spsi_to_half(nextafterf(middle, 0)) == bits && spsi_to_half(nextafterf(middle, 1e9f)) == bits + 1);
    }
    CHECK(spsi_to_half(65505) == 0x7bff && spsi_to_half(1e30f) == 0x7bff && spsi_to_half(-1e30f) == 0xfbff);
}

/* A half is off by at most 2^-11 of itself, or 2^-25; unorm by half a step of the component's extent, and by the
   rounding of its scale. What exceeds the limit is clamped and counted: no more, no less. */
static void test_formats(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 5 * 4 * 3; ++n) {
        const int technique = SPS_TMAP_OPACITY + n % 5, limited = n / 20;
        const sps_export_format format = (sps_export_format)(n / 5 % 4);
        static const double usual[4] = {1e30, 65504, 12, 6};
        sps_tmap_export_settings settings = wanted(format, SPS_EXPORT_ARRAY);
        const double limit = limited == 2 ? (double)0.7f : usual[format];
        sps_tmap_texture t;
        fixture f;
        uint64_t beyond = 0;
        begin_little(&f, technique);
        for (int i = 0; i < 4 && limited; ++i) f.crowds[1].list[i].optical_depth = i ? 20 : 1e5f;
        f.settings.near_depth = 1.5;
        sps_tmap *map = must_build(&f, context);
        settings.keep_empty = 1, settings.depth_limit = limited == 2 ? 0.7f : 0;
        if (!export_into(map, &settings, &t)) continue;
        const int count = t.constants.components, ranged = map->has_range;
        for (int i = 0; i < SIDE * SIDE; ++i)
            for (int k = 0; k < count; ++k) {
                const int at[3] = {i % SIDE, i / SIDE, 0};
                const int depth = k == count - 1 || technique == SPS_TMAP_MOMENT
                                      ? k == 0 || k == count - 1
                                      : technique != SPS_TMAP_FOURIER && k >= 2 * ranged;
                const double whole = component(map, (size_t)i, k), most = depth ? limit : usual[1 - (format != 1)];
                const double kept = fmax(fmin(whole, most), -most), scale = (double)t.constants.scale[k];
                const double made = decoded(&t, format, place_of(&t, SPS_EXPORT_ARRAY, map, at, k), k);
                const double off = format == SPS_EXPORT_FLOAT ? 0
                                   : format == SPS_EXPORT_HALF
                                       ? fabs(kept) / 2048 + 3e-8
                                       : scale * (format == SPS_EXPORT_UNORM8 ? 0.501 / 255 : 0.51 / 65535) +
                                             1.2e-7 * (fabs(kept) + scale);
                beyond += fabs(whole) > (double)(float)most;
                if (!CHECK_NEAR(made, kept, off))
                    printf("    technique %d format %d k %d\n", technique, (int)format, k);
                if (format < SPS_EXPORT_UNORM16) CHECK(t.constants.scale[k] == 1 && t.constants.offset[k] == 0);
            }
        CHECK(t.clamped == beyond);
        CHECK(limited == 0 || format == SPS_EXPORT_FLOAT || technique == SPS_TMAP_FOURIER || beyond > 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Surfaces are one channel; texels without one are farther than any point, and do not count as clamped. */
static void test_surfaces(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        const sps_export_format format = n % 2 ? SPS_EXPORT_HALF : SPS_EXPORT_FLOAT;
        sps_tmap_export_settings settings = wanted(format, n / 2 ? SPS_EXPORT_ATLAS : SPS_EXPORT_ARRAY);
        sps_tmap_texture t;
        fixture f;
        begin_little(&f, n / 2 ? SPS_TMAP_DEEP : SPS_TMAP_DEPTH);
        sps_tmap *map = must_build(&f, context);
        settings.content = SPS_EXPORT_SURFACES;
        if (!export_into(map, &settings, &t)) continue;
        CHECK(t.channels == 1 && t.layers == 1 && t.width == SIDE && t.height == SIDE && t.clamped == 0);
        int none = 0;
        for (int i = 0; i < SIDE * SIDE; ++i) {
            const double u = (double)sps_tmap_surfaces(map)[i], made = fetched(format, (size_t)i);
            none += u > 1e29;
            if (u > 1e29)
                CHECK(made >= 65504);
            else
                CHECK_NEAR(made, u, format == SPS_EXPORT_HALF ? fabs(u) / 2048 : 0);
        }
        CHECK(none > 0 && none < SIDE * SIDE);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* A cube map's surfaces are the map's own, and not means with texels that have none. */
static void test_surfaces_of_cubes(void) {
    sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_CUBE);
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap_texture t;
    fixture f;
    begin_little(&f, SPS_TMAP_DEPTH);
    see(&f, ROUND, SIDE);
    sps_tmap *map = must_build(&f, context);
    settings.content = SPS_EXPORT_SURFACES;
    if (export_into(map, &settings, &t))
        for (int i = 0; i < 6 * SIDE * SIDE; ++i) {
            int same = 0;
            for (int k = 0; k < 6 * SIDE * SIDE && !same; ++k)
                same = fetched(SPS_EXPORT_FLOAT, (size_t)i) == (double)sps_tmap_surfaces(map)[k];
            CHECK(same);
        }
    sps_tmap_destroy(map);
    sps_destroy(context);
    end(&f);
}

/* ----------------------------------------------------------------------------------------------------- empty texels */

/* An empty texel beside a ball has the mean range, or moments, of its neighbours with gas; optical depths and texels
 * with gas stay. */
static void test_empty(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_OPACITY; technique <= SPS_TMAP_BEER; ++technique) {
        const sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_SLICES);
        sps_tmap_texture t;
        fixture f;
        int borrowed = 0;
        begin(&f, technique);
        f.settings.texel_range = 1;
        add(&f, 0, 0.3, 0.2, 1, 1.9, 2);
        add(&f, 1, -2, 0.5, -3, 1.6, 1);
        sps_tmap *map = must_build(&f, context);
        const int n = check_settings_of(map).components, first = technique == SPS_TMAP_MOMENT;
        const int last = first ? n : map->has_range ? 2 : 0;
        if (!export_into(map, &settings, &t)) continue;
        for (int i = 0; i < SIDE * SIDE; ++i)
            for (int k = 0; k < n; ++k) {
                const int total = first ? 0 : technique == SPS_TMAP_FOURIER ? 2 : n - 1, x = i % SIDE, y = i / SIDE;
                const double own = component(map, (size_t)i, k);
                double sum = 0, some = 0;
                for (int d = 0; d < 9; ++d) {
                    const int there = (y + d / 3 - 1) * SIDE + x + d % 3 - 1;
                    if (x + d % 3 < 1 || x + d % 3 > SIDE || y + d / 3 < 1 || y + d / 3 > SIDE) continue;
                    if (component(map, (size_t)there, total) > 0) sum += component(map, (size_t)there, k), some += 1;
                }
                const int borrows = !(component(map, (size_t)i, total) > 0) && some > 0 && k >= first && k < last;
                CHECK_NEAR(fetched(SPS_EXPORT_FLOAT, (size_t)(k * SIDE * SIDE + i)), borrows ? sum / some : own,
                           borrows ? 1e-6 : 0);
                borrowed += borrows;
            }
        CHECK((borrowed > 0) == (last > 0));
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------------- cube maps */

/* The table of "Cube Map Texture Selection" in the OpenGL specification: for each face, the axes and signs of s and t.
 */
static const struct {
    int s, t;
    double s_sign, t_sign;
} selection[6] = {{2, 1, -1, -1}, {2, 1, 1, -1}, {0, 2, 1, 1}, {0, 2, 1, -1}, {0, 1, 1, -1}, {0, 1, -1, -1}};

/* A texel holds the optical depth of everything in the direction that hardware has for it. sps_tmap_query interpolates
   the same four texels: floats. */
static void test_cube(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int size = 1; size < 14; size += 4) {
        const sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_CUBE);
        sps_tmap_texture t;
        fixture f;
        double largest = 0;
        begin_little(&f, SPS_TMAP_OPACITY);
        see(&f, ROUND, size);
        f.s.scene.mesh_count = 1;
        sps_tmap *map = must_build(&f, context);
        if (!export_into(map, &settings, &t)) continue;
        CHECK(t.width == size && t.height == size && t.layers == 12 && t.channels == 4);
        for (int i = 0; i < 6 * size * size; ++i) {
            const int face = i / (size * size), x = i % size, y = i / size % size;
            double d[3], point[3];
            d[face / 2] = face % 2 ? -1 : 1;
            d[selection[face].s] = selection[face].s_sign * ((2 * x + 1.0) / size - 1);
            d[selection[face].t] = selection[face].t_sign * ((2 * y + 1.0) / size - 1);
            for (int k = 0; k < 3; ++k) point[k] = f.light.camera.position[k] + 19.999 * d[k];
            const double made = fetched(SPS_EXPORT_FLOAT, (size_t)(4 * (6 * size * size + i) + 3)); /* component 7 */
            if (size > 1) CHECK_NEAR(made, query_at(map, point), 2e-5);
            largest = fmax(largest, made);
        }
        CHECK(largest > 0.5);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------- engines' Beer maps */

/* Two balls on the axis, 150 each of 762 in all, with a total of 4: what engines store is .01333 per unit of length,
   where a map's own mean over the span is .00525. A third ball inside the first adds depth, not length. In other units,
   and in perspective, where distances are along the axis. Compressed: optical depth and lengths within epsilon. */
static void test_beer(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 12; ++n) {
        const int technique = n % 2 ? SPS_TMAP_COMPRESSED : SPS_TMAP_DEEP, spot = n / 2 % 2, inner = n / 4;
        sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_ARRAY);
        sps_tmap_texture t;
        fixture f;
        begin(&f, technique);
        see(&f, spot ? SPOT : ORTHO, SIDE);
        check_set3(f.light.camera.position, 0, 0, 1500);
        check_orthographic(&f.light.camera, 50);
        check_perspective(&f.light.camera, spot ? 0.1 : 0);
        f.settings.near_depth = 1000, f.settings.far_depth = 2500, f.settings.epsilon = 1e-6f;
        add(&f, 0, 0, 0, 381 - 75, 75, 2);
        add(&f, 0, 0, 0, -381 + 75, 75, inner == 2 ? 1 : 2);
        if (inner == 2) add(&f, 0, 0, 0, -381 + 75, 50, 1);
        settings.content = SPS_EXPORT_ENGINE_BEER;
        if (inner == 1) settings.distance_unit = 1e5, settings.extinction_unit = 100;
        sps_tmap *map = must_build(&f, context);
        if (!export_into(map, &settings, &t)) continue;
        const size_t middle = 4 * (SIDE * SIDE / 2);
        const double front = fetched(SPS_EXPORT_FLOAT, middle), extinction = fetched(SPS_EXPORT_FLOAT, middle + 1);
        CHECK(t.channels == 4 && t.layers == 1 && t.constants.components == 3);
        CHECK_NEAR(front, (1500 - 381) / (inner == 1 ? 1e5 : 1.0), (inner == 1 ? 1e-5 : 1) * 2e-3);
        CHECK_NEAR(extinction, 4.0 / 300 * (inner == 1 ? 100 : 1), (inner == 1 ? 100 : 1) * 4.0 / 300 * 2e-4);
        CHECK_NEAR(fetched(SPS_EXPORT_FLOAT, middle + 2), 4, 2e-4);
        CHECK(fetched(SPS_EXPORT_FLOAT, middle + 3) == 0);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* No gas: far_depth, no extinction, no depth. A pane alone: all numbers are finite. */
static void test_beer_of_nothing(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int pane = 0; pane < 2; ++pane) {
        sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_ARRAY);
        sps_tmap_texture t;
        fixture f;
        begin(&f, SPS_TMAP_DEEP);
        if (pane) add_square(&f, 0, -30, 30, 30, 4), add_mesh(&f, 0, 0.5);
        settings.content = SPS_EXPORT_ENGINE_BEER;
        sps_tmap *map = must_build(&f, context);
        if (!export_into(map, &settings, &t)) continue;
        CHECK_NEAR(fetched(SPS_EXPORT_FLOAT, 0), pane ? 6 : 20, 1e-5);
        CHECK_NEAR(fetched(SPS_EXPORT_FLOAT, 1), pane ? log(2.0) / 20e-6 : 0, pane ? 0.1 : 0);
        CHECK_NEAR(fetched(SPS_EXPORT_FLOAT, 2), pane ? log(2.0) : 0, 1e-6);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------- errors, memory */

static void check_refused(sps_tmap *map, const sps_tmap_export_settings *settings, sps_result result,
                          const char *text) {
    sps_tmap_texture t, before;
    memset(&t, 7, sizeof t), memset(&before, 7, sizeof before), memset(exported, 3, 100);
    CHECK(sps_tmap_export(map, settings, exported, sizeof exported, &t) == result);
    if (!CHECK(strstr(sps_error(map->context), text))) printf("    %s\n", sps_error(map->context));
    CHECK(memcmp(&t, &before, sizeof t) == 0 && exported[0] == 3 && exported[99] == 3);
}

static void test_errors(void) {
    static const char *const texts[] = {"export.content is 3",
                                        "export.format is 4",
                                        "export.layout is 4",
                                        "export.depth_limit is -1",
                                        "export.distance_unit is nan",
                                        "export.extinction_unit is -1",
                                        "export.start_canary",
                                        "export.end_canary",
                                        "export.layout is SPS_EXPORT_CUBE",
                                        "export.content is SPS_EXPORT_ENGINE_BEER",
                                        "export.content is SPS_EXPORT_SURFACES, which UNORM",
                                        "export.content is SPS_EXPORT_SURFACES, and"};
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap_texture t;
    fixture f;
    begin_little(&f, SPS_TMAP_BEER);
    f.s.scene.mesh_count = 1;
    sps_tmap *map = must_build(&f, context), *raw = NULL;
    for (int i = 0; i < (int)(sizeof texts / sizeof *texts); ++i) {
        sps_tmap_export_settings s = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_ARRAY);
        if (i == 0) s.content = (sps_export_content)3;
        if (i == 1) s.format = (sps_export_format)4;
        if (i == 2) s.layout = (sps_export_layout)4;
        if (i == 3) s.depth_limit = -1;
        if (i == 4) s.distance_unit = HUGE_VAL - HUGE_VAL;
        if (i == 5) s.extinction_unit = -1;
        if (i == 6) s.start_canary = 1;
        if (i == 7) s.end_canary = 1;
        if (i == 8) s.layout = SPS_EXPORT_CUBE;
        if (i == 9) s.content = SPS_EXPORT_ENGINE_BEER;
        if (i >= 10) s.content = SPS_EXPORT_SURFACES, s.format = i == 10 ? SPS_EXPORT_UNORM8 : SPS_EXPORT_HALF;
        check_refused(map, &s, i == 9 || i == 10 ? SPS_ERROR_UNSUPPORTED : SPS_ERROR_ARGUMENT, texts[i]);
    }
    const sps_tmap_export_settings s = wanted(SPS_EXPORT_UNORM8, SPS_EXPORT_ARRAY);
    CHECK(sps_tmap_export(NULL, &s, exported, sizeof exported, &t) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_export(map, NULL, exported, sizeof exported, &t) == SPS_ERROR_ARGUMENT);
    CHECK(sps_tmap_export(map, &s, exported, sizeof exported, NULL) == SPS_ERROR_ARGUMENT);
    CHECK_OK(context, sps_tmap_export(map, &s, NULL, 0, &t)); /* asks for the size */
    CHECK(t.bytes == 4 * SIDE * SIDE && t.clamped == 0 && t.constants.components >= 3);
    CHECK(sps_tmap_export(map, &s, exported, t.bytes - 1, &t) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "bytes is 323") != NULL);
    CHECK_OK(context, sps_tmap_export(map, &s, exported, t.bytes, &t));
    CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &raw));
    check_refused(raw, &s, SPS_ERROR_ARGUMENT, "is not finished");
    sps_tmap_destroy(raw);
    sps_tmap_destroy(map);
    f.settings.technique = SPS_TMAP_DEEP;
    map = must_build(&f, context);
    check_refused(map, &s, SPS_ERROR_UNSUPPORTED, "export.content is SPS_EXPORT_GAS");
    sps_tmap_destroy(map);
    f.settings.technique = SPS_TMAP_DEPTH;
    map = must_build(&f, context);
    check_refused(map, &s, SPS_ERROR_UNSUPPORTED, "export.content is SPS_EXPORT_GAS");
    sps_tmap_destroy(map);
    end(&f);
    sps_destroy(context);
}

/* Any number of workers, in any order, writes the same bytes; each allocation fails in turn, and leaves nothing behind.
 */
static void test_workers(void) {
    sps_tmap_texture first, t;
    for (int n = 0; n < 4; ++n) {
        const sps_tmap_export_settings settings = wanted(SPS_EXPORT_UNORM16, SPS_EXPORT_CUBE);
        check_hooks hooks;
        fixture f;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = n, hooks.order = (uint64_t)n;
        sps_context *context = check_context(&hooks);
        begin_little(&f, SPS_TMAP_DEEP_OPACITY);
        see(&f, ROUND, SIDE);
        sps_tmap *map = must_build(&f, context);
        if (!export_into(map, &settings, &t)) continue;
        if (n == 0) first = t, memcpy(again, exported, t.bytes);
        CHECK(memcmp(&first, &t, sizeof t) == 0 && memcmp(again, exported, t.bytes) == 0);
        sps_tmap_destroy(map);
        sps_destroy(context);
        CHECK(hooks.live == 0 && hooks.live_blocks == 0);
        end(&f);
    }
}

/* Without memory there is an error, and the texture stays as it was; with it, the same map is exported. */
static void test_memory(void) {
    sps_tmap_export_settings settings = wanted(SPS_EXPORT_FLOAT, SPS_EXPORT_ARRAY);
    check_hooks hooks;
    sps_tmap_texture t;
    fixture f;
    memset(&hooks, 0, sizeof hooks);
    sps_context *context = check_context(&hooks);
    begin_little(&f, SPS_TMAP_DEPTH);
    settings.content = SPS_EXPORT_SURFACES;
    sps_tmap *map = must_build(&f, context);
    hooks.fail_at = hooks.allocations + 1;
    check_refused(map, &settings, SPS_ERROR_MEMORY, "memory");
    hooks.fail_at = 0;
    export_into(map, &settings, &t);
    sps_tmap_destroy(map);
    sps_destroy(context);
    CHECK(hooks.live == 0 && hooks.live_blocks == 0);
    end(&f);
}

static int calls_left;

static int cancel(void *user, float fraction) {
    (void)user, (void)fraction;
    return calls_left-- == 0;
}

/* A cancelled export says so, and the map can be exported afterwards. */
static void test_cancel(void) {
    const sps_tmap_export_settings settings = wanted(SPS_EXPORT_UNORM16, SPS_EXPORT_ARRAY);
    sps_config config;
    sps_tmap_texture t;
    fixture f;
    int cancelled = 0;
    memset(&config, 0, sizeof config);
    config.progress_fn = cancel;
    sps_context *context = sps_create(&config, NULL);
    begin_little(&f, SPS_TMAP_OPACITY);
    calls_left = 1 << 30;
    sps_tmap *map = must_build(&f, context);
    for (int n = 0, last = 0; !last && n < 1000; ++n) {
        calls_left = n;
        const sps_result result = sps_tmap_export(map, &settings, exported, sizeof exported, &t);
        last = result == SPS_OK;
        if (!last) CHECK(result == SPS_ERROR_CANCELLED && ++cancelled);
    }
    CHECK(cancelled > 0);
    calls_left = 1 << 30;
    export_into(map, &settings, &t);
    sps_tmap_destroy(map);
    sps_destroy(context);
    end(&f);
}

int main(void) {
    RUN(test_layouts);
    RUN(test_halves);
    RUN(test_formats);
    RUN(test_surfaces);
    RUN(test_surfaces_of_cubes);
    RUN(test_empty);
    RUN(test_cube);
    RUN(test_beer);
    RUN(test_beer_of_nothing);
    RUN(test_errors);
    RUN(test_workers);
    RUN(test_memory);
    RUN(test_cancel);
    return check_report();
}
