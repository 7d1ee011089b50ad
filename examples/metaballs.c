/* Metaballs: drops of gas that rise from a pool, separate and merge, and their shadows on a checkered floor. */

#include "metaballs.h"
#include "scene.h"
#include "scene_program.h"

/* The pool, three necks that rise from it, and drops above. Each: center, radius, strength. */
static const ex_metaball drops[] = {
    {{-0.95, -0.10, 0.05}, 0.95, 1.0}, {{0.10, -0.15, 0.30}, 1.05, 1.0}, {{1.10, -0.10, -0.05}, 0.90, 1.0},
    {{0.15, -0.10, -0.70}, 0.95, 1.0}, {{-0.95, 0.62, 0.00}, 0.58, 0.9}, {{-0.90, 1.12, -0.05}, 0.66, 1.2},
    {{0.12, 0.70, 0.05}, 0.62, 0.9},   {{0.20, 1.22, 0.00}, 0.50, 0.9},  {{0.12, 1.78, 0.00}, 0.82, 1.4},
    {{1.10, 0.55, 0.00}, 0.50, 0.9},   {{1.18, 1.22, 0.10}, 0.62, 1.4},  {{1.02, 1.98, -0.15}, 0.42, 1.4},
    {{-0.62, 2.12, 0.10}, 0.48, 1.4},  {{-1.62, 0.75, 0.40}, 0.36, 1.4}};

/* sps_volume.eval_fn. The sum of the fields is soft all the way to the centers; the ramp makes the drops even inside,
   with a narrow rim. */
static int gas_value(void *user, size_t count, const double *positions, float *out) {
    if (ex_metaballs_eval(user, count, positions, out)) return 1;
    for (size_t i = 0; i < count; ++i) out[i] = (float)ex_ramp(0.12, 0.55, (double)out[i]);
    return 0;
}

static void set_gas(sps_volume *gas, ex_metaballs *balls) {
    static const sps_lobe lobes[2] = {{0.5f, 0.6f}, {-0.2f, 0.4f}};
    ex_volume_box(gas, ex_vec_of(-2.1, 0, -1.7), ex_vec_of(2.1, 2.75, 1.4), 144);
    gas->eval_fn = gas_value, gas->concurrent = 1, gas->user = balls;
    gas->extinction = 9;
    ex_color(gas->albedo, 0.99, 0.80, 0.42);
    gas->lobes = lobes, gas->lobe_count = 2;
}

static void build_floor(ex_mesh *mesh) {
    static const float shades[2][3] = {{0.10f, 0.10f, 0.105f}, {0.028f, 0.034f, 0.045f}};
    for (int z = -10; z < 6; ++z)
        for (int x = -10; x < 10; ++x)
            ex_shape_quad(mesh, ex_vec_of(0.6 * x, -0.02, 0.6 * z), ex_vec_of(0.6 * x, -0.02, 0.6 * (z + 1)),
                          ex_vec_of(0.6 * (x + 1), -0.02, 0.6 * (z + 1)), ex_vec_of(0.6 * (x + 1), -0.02, 0.6 * z),
                          shades[(x + z) & 1]);
}

int main(int argc, char **argv) {
    const sps_light sun = ex_sun(ex_vec_of(1.0, -1.05, 0.3), 24);
    const sps_view view = ex_view(ex_vec_of(0.7, 3.3, 7.2), ex_vec_of(0.35, 0.92, 0), 30);
    sps_scene scene = ex_scene(&sun);
    ex_metaballs balls = {drops, sizeof drops / sizeof *drops};
    sps_volume gas = {0};
    ex_mesh floor_tiles = {0};
    set_gas(&gas, &balls);
    build_floor(&floor_tiles);
    const sps_mesh mesh = ex_shape_mesh(&floor_tiles);
    scene.volumes = &gas, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    const int status = ex_scene_program(argc, argv, "metaballs.png", &scene, &view, EX_SAMPLE_EDGES);
    ex_mesh_free(&floor_tiles);
    return status;
}
