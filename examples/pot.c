/* A polygon pot inside a translucent volumetric cube. The pot casts shadows on itself, through the haze of the cube,
   and on the table; the cube dims everything behind it. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

/* sps_volume.eval_fn: haze with slightly denser veils. */
static int haze_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double edge = ex_box_distance(p, ex_vec_of(0, 1.05, 0), ex_vec_of(1.3, 1.05, 1.3), 0.12);
        out[i] = (float)(ex_solid(edge, 0.06) * (0.8 + 0.25 * ex_turbulence(ex_vec_scale(p, 1.7), 3)));
    }
    return 0;
}

static void set_haze(sps_volume *haze) {
    ex_volume_box(haze, ex_vec_of(-1.36, -0.02, -1.36), ex_vec_of(1.36, 2.16, 1.36), 64);
    haze->eval_fn = haze_value, haze->concurrent = 1;
    haze->extinction = 0.6f;
    ex_color(haze->albedo, 0.80, 0.92, 0.98);
}

static void build_pot(ex_mesh *mesh) {
    static const float glaze[3] = {0.42f, 0.11f, 0.04f}, knob[3] = {0.70f, 0.45f, 0.14f};
    static const ex_vec up = {0, 1, 0}, across = {0, 0, 1};
    static const double body[18] = {0.34, 0.0,  0.52, 0.05, 0.70, 0.25, 0.74, 0.48, 0.66,
                                    0.70, 0.48, 0.84, 0.40, 0.90, 0.42, 0.95, 0.38, 0.95};
    static const double lid[10] = {0.40, 0.94, 0.34, 1.00, 0.20, 1.06, 0.08, 1.09, 0.0, 1.10};
    static const double top[10] = {0.05, 1.08, 0.05, 1.12, 0.11, 1.19, 0.07, 1.26, 0.0, 1.27};
    static const double spout[20] = {0.55, 0.30, 0,    0.17, 0.80, 0.38, 0,    0.14, 0.93, 0.58,
                                     0,    0.10, 1.00, 0.78, 0,    0.08, 1.14, 0.90, 0,    0.09};
    static const double handle[24] = {-0.55, 0.76, 0, 0.055, -0.80, 0.84, 0, 0.055, -1.02, 0.74, 0, 0.06,
                                      -1.02, 0.48, 0, 0.06,  -0.86, 0.30, 0, 0.055, -0.66, 0.24, 0, 0.05};
    const ex_lathe parts[3] = {{body, 9, {0, 0, 0}, up}, {lid, 5, {0, 0, 0}, up}, {top, 5, {0, 0, 0}, up}};
    const ex_tube tubes[2] = {{spout, 5, across}, {handle, 6, across}};
    for (int i = 0; i < 3; ++i) ex_shape_lathe(mesh, &parts[i], 96, i == 2 ? knob : glaze, NULL);
    for (int i = 0; i < 2; ++i) ex_shape_tube(mesh, &tubes[i], glaze);
}

/* Stone tiles in two shades. */
static void build_table(ex_mesh *mesh) {
    static const float shades[2][3] = {{0.15f, 0.13f, 0.12f}, {0.07f, 0.065f, 0.065f}};
    for (int z = -4; z < 4; ++z)
        for (int x = -4; x < 4; ++x)
            ex_shape_box(mesh, ex_vec_of(0.7 * x, -0.16, 0.7 * z), ex_vec_of(0.7 * (x + 1), -0.03, 0.7 * (z + 1)),
                         shades[(x + z) & 1]);
}

int main(int argc, char **argv) {
    static float dusk[2][3] = {{0.05f, 0.06f, 0.08f}, {0.01f, 0.015f, 0.03f}};
    const sps_light sun = ex_sun(ex_vec_of(1.0, -0.85, 0.25), 12);
    sps_view view = ex_view(ex_vec_of(2.6, 1.9, 5.8), ex_vec_of(0.1, 0.80, 0), 31);
    sps_scene scene = ex_scene(&sun);
    sps_volume haze = {0};
    ex_mesh pot = {0}, table = {0};
    ex_color(scene.ambient, 0.06, 0.07, 0.09);
    scene.background_user = dusk;
    set_haze(&haze);
    build_pot(&pot);
    build_table(&table);
    sps_mesh meshes[2] = {ex_shape_mesh(&pot), ex_shape_mesh(&table)};
    meshes[0].placement = ex_turned(0.5, ex_vec_of(-0.1, 0, 0.35));
    scene.volumes = &haze, scene.volume_count = 1;
    scene.meshes = meshes, scene.mesh_count = 2;
    /* The pot's hard shadow on polygons would show steps. */
    const int status = ex_scene_program(argc, argv, "pot.png", &scene, &view, EX_SAMPLE_ALL);
    ex_mesh_free(&pot);
    ex_mesh_free(&table);
    return status;
}
