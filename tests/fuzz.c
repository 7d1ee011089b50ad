/* Random scenes: fuzz SEED COUNT renders COUNT of them, the same ones for the same SEED on every machine, and checks
   what fuzz.h says. Prints the scene's number and result if something is wrong. */

#include "fuzz.h"

/* The same scene by seven workers in a shuffled order, in a context that is used for everything. */
static void compare_workers(const scenery *x, long number, sps_context *used) {
    static float again[4 * PIXELS_MAX];
    sps_result result;
    memcpy(again, rgba, sizeof again);
    result = render_scenery(used, x, 0);
    if (!CHECK(result == SPS_OK) || !CHECK(memcmp(again, rgba, sizeof again) == 0))
        report(number, "seven workers", result, used);
}

/* Exports the map in one of all formats and layouts into memory of just its size: floats are finite. */
static int export_sane(sps_tmap *map, long number) {
    const int lists = map->technique->lists > 0, empty = map->settings.components == 0 && !lists;
    sps_tmap_export_settings settings = {0, SPS_EXPORT_GAS, SPS_EXPORT_FLOAT, SPS_EXPORT_ARRAY, 0, 0, 0, 0, 0};
    sps_tmap_texture texture;
    if (empty && !sps_tmap_surfaces(map)) return 1;
    settings.content = lists ? SPS_EXPORT_ENGINE_BEER : empty ? SPS_EXPORT_SURFACES : SPS_EXPORT_GAS;
    settings.format = (sps_export_format)(empty ? 0 : number % 4);
    settings.layout = (sps_export_layout)(number / 4 % (map->grid.face_count > 1 ? 4 : 3));
    settings.keep_empty = number % 3 == 0;
    if (sps_tmap_export(map, &settings, NULL, 0, &texture) != SPS_OK || texture.bytes > 1u << 28) return 0;
    float *texels = (float *)malloc(texture.bytes);
    int good = texels && sps_tmap_export(map, &settings, texels, texture.bytes, &texture) == SPS_OK;
    for (size_t i = 0; i < texture.bytes / 4 && good && settings.format == SPS_EXPORT_FLOAT; ++i)
        good = fabsf(texels[i]) <= FLT_MAX;
    for (int k = 0; k < 68; ++k)
        good &= texture.constants.scale[k] > 0 && fabsf(texture.constants.offset[k]) <= FLT_MAX;
    free(texels);
    return good;
}

/* A map of the scene. */
static void fuzz_map(scenery *x, long number) {
    check_hooks hooks;
    sps_tmap_light light;
    sps_tmap_settings wanted;
    sps_tmap *map = NULL;
    memset(&hooks, 0, sizeof hooks);
    sps_context *context = check_context(&hooks);
    random_map_of(x, &light, &wanted);
    const sps_result result = make_map(context, x, &light, &wanted, &map);
    check_map_outcome(map, number, result, context);
    if (result == SPS_OK && !CHECK(export_sane(map, number))) report(number, "export", result, context);
    sps_tmap_destroy(map);
    sps_destroy(context);
    if (!CHECK(hooks.live == 0 && hooks.live_blocks == 0)) printf("    scene %ld leaks by its map\n", number);
}

/* One scene: plan, render in a fresh context, render in the used one, and march. */
static void fuzz(long number, sps_context *used) {
    check_hooks hooks;
    scenery x;
    random_scenery(&x);
    memset(&hooks, 0, sizeof hooks);
    sps_context *context = check_context(&hooks);
    sps_result result = render_as_planned(context, &hooks, &x, number, NULL);
    if (result == SPS_OK && steady(&x) && x.s.view.width > 0 && x.s.view.height > 0) {
        for (int i = 0; i < VOLUMES; ++i) x.s.volume[i].revision = 0; /* the used context holds other voxels */
        compare_workers(&x, number, used);
    }
    if (one_in(6) && small_enough_to_march(&x)) {
        result = render_scenery(context, &x, 1);
        check_outcome(&x, number, "reference", result, context);
        x.s.view.scattering = SPS_SCATTERING_SINGLE;
        result = bound_scenery(context, &x);
        check_outcome(&x, number, "bounds", result, context);
    }
    sps_destroy(context);
    if (!CHECK(hooks.live == 0 && hooks.live_blocks == 0)) printf("    scene %ld leaks\n", number);
    fuzz_map(&x, number);
    free_scenery(&x);
}

/* A third argument is the number of the first scene: each has its own random numbers, so that one can be run alone. */
int main(int count, char **arguments) {
    const uint64_t seed = count > 1 ? strtoul(arguments[1], NULL, 10) : 1;
    const long scenes = count > 2 ? strtol(arguments[2], NULL, 10) : 300;
    const long first = count > 3 ? strtol(arguments[3], NULL, 10) : 0;
    check_hooks hooks;
    sps_context *used;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = 7;
    used = check_context(&hooks);
    for (long i = first; i < first + scenes; ++i) {
        numbers.state = (seed * 1000003u + (uint64_t)i) * 0x9e3779b97f4a7c15u;
        hooks.order = numbers.state;
        check_next(&numbers);
        fuzz(i, used);
    }
    sps_destroy(used);
    CHECK(hooks.live == 0);
    return check_report();
}
