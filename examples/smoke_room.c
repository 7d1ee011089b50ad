/* A polygon desk in a room full of turbulent smoke. The light comes through the windows behind it, towards the eye, so
   the sheets are composited back to front. Window bars, desk and lamp cast shafts of shadow through the smoke. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

/* sps_volume.eval_fn. The room: x -2..2, y 0..2.6, z -2 (windows) .. 2 (open, where the viewer stands). */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double t = ex_turbulence(ex_vec_of(1.6 * p.x, 2.3 * p.y, 1.6 * p.z), 3);
        out[i] = (float)(0.15 + 1.9 * ex_ramp(0.20, 1.0, t));
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    static const sps_lobe forward = {0.35f, 1};
    ex_volume_box(smoke, ex_vec_of(-2, 0, -2), ex_vec_of(2, 2.6, 2), 64);
    smoke->eval_fn = smoke_value, smoke->concurrent = 1;
    smoke->extinction = 0.32f;
    ex_color(smoke->albedo, 0.92, 0.90, 0.86);
    smoke->lobes = &forward, smoke->lobe_count = 1;
}

/* Floor, ceiling, side walls, and a back wall of piers and bars with two tall windows. */
static void build_room(ex_mesh *mesh) {
    static const float wall[3] = {0.42f, 0.36f, 0.30f}, boards[2][3] = {{0.30f, 0.17f, 0.09f}, {0.25f, 0.14f, 0.07f}},
                       frame[3] = {0.30f, 0.28f, 0.26f};
    static const double piers[3][2] = {{-2.2, -1.45}, {-0.15, 0.15}, {1.45, 2.2}};
    for (int i = -5; i < 5; ++i)
        ex_shape_box(mesh, ex_vec_of(0.44 * i, -0.2, -2.2), ex_vec_of(0.44 * (i + 1), 0, 2.2), boards[i & 1]);
    ex_shape_box(mesh, ex_vec_of(-2.2, 2.6, -2.2), ex_vec_of(2.2, 2.8, 2.2), wall);
    ex_shape_box(mesh, ex_vec_of(-2.2, 0, -2.2), ex_vec_of(-2, 2.6, 2.2), wall);
    ex_shape_box(mesh, ex_vec_of(2, 0, -2.2), ex_vec_of(2.2, 2.6, 2.2), wall);
    for (int i = 0; i < 3; ++i)
        ex_shape_box(mesh, ex_vec_of(piers[i][0], 0, -2.12), ex_vec_of(piers[i][1], 2.6, -2), wall);
    ex_shape_box(mesh, ex_vec_of(-2, 0, -2.12), ex_vec_of(2, 0.55, -2), wall);
    ex_shape_box(mesh, ex_vec_of(-2, 2.35, -2.12), ex_vec_of(2, 2.6, -2), wall);
    for (int i = -1; i <= 1; i += 2) {
        ex_shape_box(mesh, ex_vec_of(0.8 * i - 0.03, 0.55, -2.08), ex_vec_of(0.8 * i + 0.03, 2.35, -2.02), frame);
        ex_shape_box(mesh, ex_vec_of(0.8 * i - 0.65, 1.42, -2.08), ex_vec_of(0.8 * i + 0.65, 1.48, -2.02), frame);
    }
}

/* The desk, with drawers on one side, a lamp and books. */
static void build_desk(ex_mesh *mesh) {
    static const float wood[3] = {0.36f, 0.18f, 0.08f}, brass[3] = {0.50f, 0.36f, 0.12f},
                       green[3] = {0.05f, 0.26f, 0.12f};
    static const float covers[3][3] = {{0.45f, 0.08f, 0.06f}, {0.08f, 0.16f, 0.36f}, {0.52f, 0.44f, 0.28f}};
    static const double shade[6] = {0.20, 0.36, 0.14, 0.48, 0.06, 0.52};
    const ex_lathe lamp = {shade, 3, {0.52, 0.80, -0.45}, {0, 1, 0}};
    ex_shape_box(mesh, ex_vec_of(-0.85, 0.72, -0.75), ex_vec_of(0.85, 0.79, 0.05), wood);
    ex_shape_box(mesh, ex_vec_of(0.30, 0.22, -0.70), ex_vec_of(0.78, 0.72, 0.0), wood);
    for (int i = 0; i < 4; ++i) {
        const double x = i & 1 ? 0.74 : -0.80, z = i & 2 ? -0.05 : -0.70;
        ex_shape_box(mesh, ex_vec_of(x, 0, z), ex_vec_of(x + 0.06, 0.72, z + 0.06), wood);
    }
    for (int i = 0; i < 3; ++i)
        ex_shape_box(mesh, ex_vec_of(-0.62 + 0.03 * i, 0.79 + 0.06 * i, -0.52),
                     ex_vec_of(-0.24 + 0.02 * i, 0.85 + 0.06 * i, -0.22 - 0.03 * i), covers[i]);
    ex_shape_cylinder(mesh, ex_vec_of(0.52, 0.79, -0.45), ex_vec_of(0.52, 0.82, -0.45), 0.13, 0.10, brass);
    ex_shape_cylinder(mesh, ex_vec_of(0.52, 0.80, -0.45), ex_vec_of(0.52, 1.32, -0.45), 0.02, 0.02, brass);
    ex_shape_lathe(mesh, &lamp, 48, green, NULL);
}

int main(int argc, char **argv) {
    static float dusk[2][3] = {{0.45f, 0.50f, 0.55f}, {0.62f, 0.74f, 0.86f}};
    const sps_light sun = ex_sun(ex_vec_of(-0.35, -0.62, 1.0), 18.5);
    sps_view view = ex_view(ex_vec_of(0.5, 1.5, 5.2), ex_vec_of(0.0, 1.12, 0), 36);
    sps_scene scene = ex_scene(&sun);
    sps_volume smoke = {0};
    ex_mesh room = {0};
    set_smoke(&smoke);
    build_room(&room);
    build_desk(&room);
    const sps_mesh mesh = ex_shape_mesh(&room);
    scene.volumes = &smoke, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0.09, 0.10, 0.12);
    scene.background_user = dusk;
    /* Hard shadows on polygons would show steps. */
    const int status = ex_scene_program(argc, argv, "smoke_room.png", &scene, &view, EX_SAMPLE_ALL);
    ex_mesh_free(&room);
    return status;
}
