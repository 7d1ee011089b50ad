/* A landscape under clouds, drawn by a renderer of its own that looks shadows up in four cascades of transmittance
   maps, as an engine does. On the right half, each cascade has a color. */

#include "arguments.h"
#include "cascades.h"
#include "densities.h"
#include "picture.h"

enum { WIDTH = 480, HEIGHT = 270, TEXELS = 512 };

#define NEAREST  1.5
#define FARTHEST 60.0

/* Hills, up to 1.6 high. */
static double ground_height(double x, double z) {
    return 1.6 * ex_ramp(-0.5, 0.7, ex_fractal(ex_vec_of(0.11 * x, 0.3, 0.11 * z), 4));
}

/* sps_volume.eval_fn: clouds, 4 to 6 above the ground's lowest point. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(0.3 * positions[0], 0.3 * positions[1], 0.3 * positions[2]);
        const double layer = 1 - pow(positions[1] - 5, 2);
        out[i] = (float)(layer * ex_ramp(0.05, 0.4, ex_fractal(p, 3)));
    }
    return 0;
}

/* Where a ray from the eye first meets the ground; 0: nowhere. Steps are a fiftieth of the distance. */
static double find_ground(ex_vec eye, ex_vec way) {
    for (double t = NEAREST; t < FARTHEST; t *= 1.02) {
        double high = t, low = t / 1.02;
        const ex_vec p = ex_vec_add(eye, ex_vec_scale(way, t));
        if (p.y > ground_height(p.x, p.z)) continue;
        for (int i = 0; i < 12; ++i) {
            const double middle = 0.5 * (low + high);
            const ex_vec q = ex_vec_add(eye, ex_vec_scale(way, middle));
            *(q.y > ground_height(q.x, q.z) ? &low : &high) = middle;
        }
        return high;
    }
    return 0;
}

/* The ground's color in the sunlight that the maps let through. */
static void shade(const ex_cascades *cascades, ex_vec sun, double distance, ex_vec p, int tinted, float rgba[4]) {
    static const double tints[EX_CASCADES][3] = {{1, 0.5, 0.5}, {1, 1, 0.5}, {0.5, 1, 0.6}, {0.5, 0.7, 1}};
    static const double grass[3] = {0.12, 0.16, 0.05}, light[3] = {3.4, 3.1, 2.6}, sky[3] = {0.35, 0.5, 0.75};
    static const double haze[3] = {0.5, 0.62, 0.78};
    const double step = 1e-3, at[3] = {p.x, p.y, p.z}, hazy = 1 - exp(-0.012 * distance);
    const double slope_x = (ground_height(p.x + step, p.z) - ground_height(p.x - step, p.z)) / (2 * step);
    const double slope_z = (ground_height(p.x, p.z + step) - ground_height(p.x, p.z - step)) / (2 * step);
    const double lit = fmax(-ex_vec_dot(sun, ex_vec_unit(ex_vec_of(-slope_x, 1, -slope_z))), 0);
    const int cascade = ex_cascades_find(cascades, distance);
    float through = 1;
    sps_tmap_query(cascades->maps[cascade], 1, at, NULL, &through);
    for (int c = 0; c < 3; ++c) {
        const double color = grass[c] * (lit * (double)through * light[c] + sky[c]) * (tinted ? tints[cascade][c] : 1);
        rgba[c] = (float)ex_mix(color, haze[c], hazy);
    }
}

static void draw(const ex_cascades *cascades, const ex_outlook *eye, ex_vec sun, float *rgba) {
    for (int i = 0; i < WIDTH * HEIGHT; ++i, rgba += 4) {
        const double x = (2 * (i % WIDTH + 0.5) / WIDTH - 1) * eye->tangent[0];
        const double y = (1 - 2 * (i / WIDTH + 0.5) / HEIGHT) * eye->tangent[1];
        const ex_vec across = ex_vec_add(ex_vec_scale(eye->right, x), ex_vec_scale(eye->up, y));
        const ex_vec way = ex_vec_add(eye->forward, across);
        const double t = find_ground(eye->position, way);
        if (t > 0)
            shade(cascades, sun, t, ex_vec_add(eye->position, ex_vec_scale(way, t)), i % WIDTH > WIDTH / 2, rgba);
        else
            ex_color(rgba, 0.4, 0.55, 0.8);
    }
}

int main(int argc, char **argv) {
    static float rgba[WIDTH * HEIGHT * 4];
    const double range[2] = {NEAREST, FARTHEST};
    const ex_vec sun = ex_vec_unit(ex_vec_of(0.5, -1, 0.25)), forward = ex_vec_unit(ex_vec_of(0, -0.36, -1));
    ex_outlook eye = {{0, 2.9, 8}, forward, {1, 0, 0}, {0, 0, 0}, {0.62, 0.62 * HEIGHT / WIDTH}, {0, 1.6}};
    sps_volume clouds = {0};
    ex_cascades cascades;
    ex_error error;
    const char *out = ex_out_file(argc, argv, "cascades.png");
    if (!out) return EX_MISTAKEN;
    eye.up = ex_vec_cross(eye.right, eye.forward);
    ex_volume_box(&clouds, ex_vec_of(-50, 4, -60), ex_vec_of(50, 6, 14), 250);
    clouds.eval_fn = cloud_value, clouds.extinction = 4;
    const sps_scene scene = {.volumes = &clouds, .volume_count = 1};
    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), EX_FAILED;
    const sps_result result = ex_cascades_make(context, &scene, &eye, sun, range, TEXELS, &cascades);
    if (result != SPS_OK) puts(sps_error(context));
    if (result == SPS_OK) draw(&cascades, &eye, sun, rgba);
    ex_cascades_destroy(&cascades);
    sps_destroy(context);
    if (result != SPS_OK) return EX_FAILED;
    if (ex_write_picture(out, rgba, WIDTH, HEIGHT, &error)) return puts(error.text), EX_FAILED;
    return EX_OK;
}
