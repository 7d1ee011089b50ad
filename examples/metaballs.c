/* Metaballs: a gas whose density is the sum of balls that flow into each other, over a chequered floor.
   cc -std=c99 -O3 -march=native -pthread -I. -I/usr/include/stb examples/metaballs.c -o metaballs -lm */

#define SPLATSHADOW_IMPLEMENTATION
#include "common.h"
#include "modelling.h"

/* A large drop that others bud off, down to the last one, which has come loose. */
static const ex_metaball drops[8] = {{{-0.55, 1.05, -0.10}, 1.15, 1.0}, {{0.35, 1.45, 0.05}, 0.85, 1.0},
                                     {{0.20, 0.62, 0.35}, 0.75, 1.0},   {{1.05, 1.05, -0.05}, 0.70, 1.0},
                                     {{-1.30, 0.55, 0.45}, 0.65, 1.0},  {{0.95, 1.90, -0.20}, 0.52, 1.1},
                                     {{1.62, 0.62, 0.25}, 0.45, 1.2},   {{-1.30, 1.85, 0.05}, 0.42, 1.2}};

static void set_gas(sps_volume *gas, ex_metaballs *balls) {
    static const sps_lobe forward = {0.3f, 1};
    balls->balls = drops, balls->count = sizeof drops / sizeof *drops;
    ex_volume_box(gas, ex_vec_of(-2.05, -0.15, -1.3), ex_vec_of(2.15, 2.50, 1.25), 112);
    gas->eval_fn = ex_metaballs_eval, gas->user = balls;
    gas->extinction = 9;
    ex_color(gas->albedo, 0.98, 0.86, 0.62);
    gas->lobes = &forward, gas->lobe_count = 1;
}

static void build_floor(ex_mesh *mesh) {
    static const float shades[2][3] = {{0.50f, 0.48f, 0.45f}, {0.16f, 0.19f, 0.23f}};
    for (int z = -7; z < 6; ++z)
        for (int x = -8; x < 8; ++x)
            ex_shape_quad(mesh, ex_vec_of(0.6 * x, -0.2, 0.6 * z), ex_vec_of(0.6 * x, -0.2, 0.6 * (z + 1)),
                          ex_vec_of(0.6 * (x + 1), -0.2, 0.6 * (z + 1)), ex_vec_of(0.6 * (x + 1), -0.2, 0.6 * z),
                          shades[(x + z) & 1]);
}

int main(int argc, char **argv) {
    ex_metaballs balls;
    ex_mesh mesh = {0};
    sps_volume gas = {0};
    sps_mesh floor_mesh = {0};
    sps_light sun = {0};
    sps_scene scene = {0};
    sps_view view = {0};
    set_gas(&gas, &balls);
    build_floor(&mesh);
    ex_shape_use(&mesh, &floor_mesh);
    ex_sun(&sun, ex_vec_of(1.0, -1.25, -0.55), 7);
    ex_scene_set(&scene, &gas, 1, &floor_mesh, 1, &sun);
    ex_view_set(&view, ex_vec_of(0.9, 2.6, 7.2), ex_vec_of(0.2, 0.82, 0), 30);
    const int status = ex_scene_show(argc, argv, "metaballs", &scene, &view);
    ex_mesh_free(&mesh);
    return status;
}
