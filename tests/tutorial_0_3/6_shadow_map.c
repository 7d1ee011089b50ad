/* Step 6 of docs/tutorial.md: a transmittance map for a renderer of its own, and its upload to where a shader reads it.
   cc -O3 -march=native -I. -I/usr/include/stb examples/tutorial/6_shadow_map.c -o 6_shadow_map -pthread -lm */

#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"
#include "picture.h"
#include "shaders/transmittance_map.h" /* the shader's code, in C */

enum { WIDTH = 320, HEIGHT = 240, STEPS = 64, TEXELS = 256, EXTINCTION = 7 };

/* sps_volume.eval_fn, and what the renderer below marches through: a cloud of density 0..1. */
static int cloud(void *user, size_t count, const double *xyz, float *density) {
    static const double puffs[5][4] = {{0, 1.2, 0, 0.55},
                                       {-0.7, 1.1, 0.2, 0.45},
                                       {0.75, 1.1, -0.1, 0.42},
                                       {0.2, 1.05, 0.7, 0.4},
                                       {-0.2, 1.1, -0.7, 0.4}};
    (void)user;
    for (size_t i = 0; i < count; ++i, xyz += 3) {
        const double folds = 0.07 * sin(11 * xyz[0] + 3 * xyz[1]) * sin(9 * xyz[1]) * sin(10 * xyz[2] + 2);
        double deepest = -1;
        for (int k = 0; k < 5; ++k)
            deepest = fmax(deepest, puffs[k][3] + folds -
                                        sqrt(pow(xyz[0] - puffs[k][0], 2) + pow(xyz[1] - puffs[k][1], 2) +
                                             pow(xyz[2] - puffs[k][2], 2)));
        density[i] = (float)fmin(fmax(deepest / 0.15, 0), 1);
    }
    return 0;
}

static sps_tmap *make_map(sps_context *context, const sps_scene *scene) {
    const sps_tmap_settings settings = {.far_depth = 6, .near_depth = 1}; /* tightly about the cloud */
    sps_tmap_light light = {.width = TEXELS, .height = TEXELS};
    sps_tmap *map = NULL;
    light.camera = (sps_camera){.position = {-2, 4, 1}, .target = {0, 1.2, 0}, .ortho_height = 3.6};
    if (sps_tmap_create(context, &light, &settings, &map)) return NULL;
    if (sps_tmap_add(map, scene) == SPS_OK && sps_tmap_finish(map) == SPS_OK) return map;
    return sps_tmap_destroy(map), NULL;
}

/* What glNamedBufferStorage and the like do: a copy in memory of the renderer's own. */
static float *upload_floats(const float *data, size_t count) {
    float *buffer = (float *)malloc(count * sizeof *data);
    return buffer ? (float *)memcpy(buffer, data, count * sizeof *data) : NULL;
}

/* The block of constants and the texels: all that a map has unless it has opaque surfaces, given planes or lists. */
static float *upload(const sps_tmap *map, tmap *bound) {
    sps_tmap_constants constants;
    sps_tmap_info info;
    if (sps_tmap_get_info(map, &info) || sps_tmap_get_constants(map, 0, &constants)) return NULL;
    float *texels = upload_floats(sps_tmap_texels(map), info.float_count);
    memset(bound, 0, sizeof *bound);
    memcpy(bound, &constants, sizeof constants);
    bound->texels = texels;
    printf("%d x %d texels of %d floats, %.1f MB\n", info.width, info.height, info.item_floats,
           1e-6 * (double)info.bytes);
    return texels;
}

/* The transmittance between the light and a place, as the shader looks it up. */
static double light_left(const tmap *bound, const double at[3]) {
    const tmap_vec3 place = {(float)at[0], (float)at[1], (float)at[2]};
    return (double)tmap_transmittance(*bound, tmap_project(*bound, place));
}

/* The same question to the library: the largest difference along a line through the cloud. */
static double difference(const sps_tmap *map, const tmap *bound) {
    double largest = 0;
    for (int i = 0; i < 1000; ++i) {
        const double at[3] = {0.003 * i - 1.5, 1.1, 0.1};
        float transmittance;
        if (sps_tmap_query(map, 1, at, NULL, &transmittance)) return 1;
        largest = fmax(largest, fabs((double)transmittance - light_left(bound, at)));
    }
    return largest;
}

static void add_light(float rgba[4], double share, double sunlight, double skylight) {
    static const double sun[3] = {1.1, 1.0, 0.85}, sky[3] = {0.3, 0.45, 0.7};
    for (int c = 0; c < 3; ++c) rgba[c] += (float)(share * (sunlight * sun[c] + skylight * sky[c]));
}

/* The renderer: marches through the cloud, from front to back, and on to the ground or the sky. */
static void draw_pixel(const tmap *bound, int x, int y, float rgba[4]) {
    const double eye[3] = {0, 1.7, 6.5}, begin = 4.8, step = 3.2 / STEPS;
    const double way[2] = {(x + 0.5 - WIDTH / 2) / HEIGHT * 0.62, (HEIGHT / 2 - y - 0.5) / HEIGHT * 0.62 - 0.14};
    double left = 1;
    for (int i = 0; i < STEPS; ++i) {
        const double t = begin + (i + 0.5) * step, at[3] = {eye[0] + t * way[0], eye[1] + t * way[1], eye[2] - t};
        float density = 0;
        cloud(NULL, 1, at, &density);
        if (!(density > 0)) continue;
        const double passes = exp(-EXTINCTION * (double)density * step);
        add_light(rgba, left * (1 - passes), 0.9 * light_left(bound, at), 0.2);
        left *= passes;
    }
    if (way[1] < 0) {
        const double t = -eye[1] / way[1], at[3] = {eye[0] + t * way[0], 0, eye[2] - t};
        add_light(rgba, left, 0.45 * light_left(bound, at), 0.2);
    } else {
        add_light(rgba, left, 0, 1);
    }
}

int main(int argc, char **argv) {
    static float rgba[HEIGHT][WIDTH][4];
    sps_volume gas = {.size = {120, 48, 120}, .eval_fn = cloud, .extinction = EXTINCTION};
    gas.placement = (sps_placement){{-1.5, 0.6, -1.5}, {{3, 0, 0}, {0, 1.2, 0}, {0, 0, 3}}};
    const sps_scene scene = {.volumes = &gas, .volume_count = 1};
    tmap bound;
    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;
    sps_tmap *map = make_map(context, &scene);
    if (!map) return puts(sps_error(context)), 1;
    float *texels = upload(map, &bound);
    if (!texels) return puts("out of memory"), 1;
    printf("shader and library differ by %.1g\n", difference(map, &bound));
    sps_tmap_destroy(map);
    sps_destroy(context); /* the renderer has a copy of all that it reads */

    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) draw_pixel(&bound, x, y, rgba[y][x]);
    free(texels);
    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "6_shadow_map.png", rgba[0][0], WIDTH, HEIGHT, &error))
        return puts(error.text), 1;
    return 0;
}
