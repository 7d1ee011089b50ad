/* Step 7 of docs/tutorial.md: tables that are held while the camera moves, and lights that are mixed without rendering.
 */

#include "splatshadow.h"
#include "../picture.h"
#include <time.h>

enum { WIDTH = 320, HEIGHT = 240, LIGHTS = 3, FLOATS = WIDTH * HEIGHT * 4, FRAMES = 100 };

/* What is rendered once: a picture without lights, and one of each light alone, with a color of 1. */
typedef struct mixer {
    float base[FLOATS], light[LIGHTS][FLOATS];
} mixer;

/* sps_volume.eval_fn: smoke in two strands that wind around each other on a ring, one and a half times. */
static int knot(void *user, size_t count, const double *xyz, float *density) {
    (void)user;
    for (size_t i = 0; i < count; ++i, xyz += 3) {
        const double ring = atan2(xyz[2], xyz[0]), out = hypot(xyz[0], xyz[2]) - 0.85, up = xyz[1] - 0.75;
        const double c = 0.27 * cos(1.5 * ring), s = 0.27 * sin(1.5 * ring);
        const double away = fmin(hypot(out - c, up - s), hypot(out + c, up + s));
        const double ripple = sin(13 * xyz[0] + 9 * xyz[1]) * sin(14 * xyz[2] - 8 * xyz[1]) +
                              0.5 * sin(31 * xyz[1] + 20 * s) * sin(29 * xyz[0] + 4 * xyz[2]);
        density[i] = (float)fmin(fmax((0.19 + 0.035 * ripple - away) / 0.13, 0), 1);
    }
    return 0;
}

/* A spotlight on a ring above the smoke, which has a table: shadows that do not depend on the camera. */
static sps_light spotlight(double angle) {
    sps_light light = {.kind = SPS_LIGHT_POINT, .inner_cone = 0.3, .outer_cone = 0.5};
    light.position[0] = 3 * sin(angle), light.position[1] = 4.2, light.position[2] = 3 * cos(angle);
    for (int c = 0; c < 3; ++c) light.direction[c] = (c == 1 ? 0.4 : 0) - light.position[c];
    light.shadow_source = SPS_SHADOW_TABLE;
    return light;
}

/* The lights' colors at a time: two that swell and fade in turn, and a flame that flickers. */
static void colors_at(double t, float color[LIGHTS][3]) {
    static const float hue[LIGHTS][3] = {{110, 26, 10}, {12, 80, 28}, {18, 38, 150}};
    const double level[LIGHTS] = {0.9 + 0.1 * sin(47 * t) * sin(31 * t), 0.6 + 0.4 * sin(6.28 * t),
                                  0.6 - 0.4 * sin(6.28 * t)};
    for (int i = 0; i < LIGHTS; ++i)
        for (int c = 0; c < 3; ++c) color[i][c] = (float)level[i] * hue[i][c];
}

static double cpu_ms(void) { return 1e3 * (double)clock() / CLOCKS_PER_SEC; }

static int render(sps_context *context, const sps_scene *scene, const sps_view *view, float *rgba, const char *what) {
    const sps_image image = {.rgba = rgba};
    const double begin = cpu_ms();
    sps_stats_report stats;
    if (sps_render(context, scene, view, &image)) return puts(sps_error(context)), 1;
    sps_get_stats(context, &stats);
    printf("%s: %.0f ms, %d calls of knot, %d tables made, %d held\n", what, cpu_ms() - begin, (int)stats.eval_calls,
           (int)stats.tables_made, (int)stats.tables_held);
    return 0;
}

/* The picture without lights, and then each light alone, without all else that shines. */
static int render_parts(sps_context *context, const sps_scene *scene, const sps_view *view, mixer *m) {
    sps_scene part = *scene;
    part.light_count = 0;
    if (render(context, &part, view, m->base, "base")) return 1;
    for (int c = 0; c < 3; ++c) part.ambient[c] = part.background[c] = 0;
    for (int i = 0; i < LIGHTS; ++i) {
        sps_light one = scene->lights[i];
        one.color[0] = one.color[1] = one.color[2] = 1;
        part.lights = &one, part.light_count = 1;
        if (render(context, &part, view, m->light[i], "one light")) return 1;
    }
    return 0;
}

/* base + sum of color * picture; coverage is that of the base. */
static void mix(const mixer *m, const float color[LIGHTS][3], float *rgba) {
    for (int i = 0; i < FLOATS; i += 4) {
        memcpy(&rgba[i], &m->base[i], 4 * sizeof *rgba);
        for (int l = 0; l < LIGHTS; ++l)
            for (int c = 0; c < 3; ++c) rgba[i + c] += color[l][c] * m->light[l][i + c];
    }
}

int main(int argc, char **argv) {
    static const float corners[] = {-90, 0, 90, 90, 0, 90, 0, 0, -90};
    static float mixed[FLOATS], direct[FLOATS];
    static mixer m;
    sps_volume smoke = {.size = {140, 60, 140}, .eval_fn = knot, .extinction = 9, .albedo = {0.9f, 0.9f, 0.9f}};
    smoke.placement = (sps_placement){{-1.4, 0.15, -1.4}, {{2.8, 0, 0}, {0, 1.2, 0}, {0, 0, 2.8}}};
    smoke.revision = 1;
    sps_indexed_mesh ground = {.vertex_count = 3, .positions = corners, .triangle_count = 1};
    sps_mesh mesh = {.triangle_count = 1, .read_fn = sps_indexed_mesh_read, .user = &ground, .revision = 1};
    mesh.albedo[0] = mesh.albedo[1] = mesh.albedo[2] = 0.45f;
    sps_light lights[LIGHTS] = {spotlight(0.4), spotlight(2.5), spotlight(4.6)};
    sps_scene scene = {.volumes = &smoke, .volume_count = 1, .meshes = &mesh, .mesh_count = 1};
    scene.lights = lights, scene.light_count = LIGHTS;
    for (int c = 0; c < 3; ++c) scene.ambient[c] = 0.015f, scene.background[c] = 0.01f;

    sps_view view = {.width = WIDTH, .height = HEIGHT};
    view.scattering = SPS_SCATTERING_SINGLE; /* the same for all pictures: AUTO, 0, decides for each */
    view.camera =
        (sps_camera){.position = {1.2, 3.1, 4.6}, .target = {0, 0.45, 0}, .field_of_view = 0.62, .up = {0, 1, 0}};
    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;

    for (int i = 0; i < LIGHTS; ++i) lights[i].color[0] = lights[i].color[1] = lights[i].color[2] = 1;
    if (render(context, &scene, &view, direct, "first frame")) return 1;
    view.camera.position[0] = 0.6; /* only the camera moves */
    if (render(context, &scene, &view, direct, "camera moved")) return 1;
    sps_view preview = view;
    preview.width = WIDTH / 8, preview.height = HEIGHT / 8;
    preview.shadow_resolution = 64; /* a preview makes its own tables: keep them small */
    if (render(context, &scene, &preview, direct, "preview")) return 1;

    if (render_parts(context, &scene, &view, &m)) return 1;
    float color[LIGHTS][3];
    const double begin = cpu_ms();
    for (int i = 0; i < FRAMES; ++i) {
        colors_at((double)i / FRAMES, color);
        mix(&m, (const float(*)[3])color, mixed);
    }
    printf("%d frames mixed: %.2f ms each\n", FRAMES, (cpu_ms() - begin) / FRAMES);

    for (int i = 0; i < LIGHTS; ++i) memcpy(lights[i].color, color[i], sizeof color[i]);
    if (render(context, &scene, &view, direct, "the last one rendered")) return 1;
    float largest = 0;
    for (int i = 0; i < FLOATS; ++i) largest = fmaxf(largest, fabsf(mixed[i] - direct[i]));
    printf("largest difference: %.1g\n", (double)largest);
    sps_destroy(context);

    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "7_relight.png", mixed, WIDTH, HEIGHT, &error))
        return puts(error.text), 1;
    return 0;
}
