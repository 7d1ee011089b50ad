/* Hard and soft shadows: a gate and a ball of smoke under a low sun and a lamp. On the left both are points; on the
   right the sun has an angular diameter of 10 degrees, and the lamp is a disc. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { HARD = 0, SOFT, PANELS };

/* sps_volume.eval_fn: a ball of smoke with creases. */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0] - 0.45, positions[1] - 0.72, positions[2]);
        const double creases = 0.16 * ex_turbulence(ex_vec_scale(p, 2.5), 4);
        out[i] = (float)ex_ramp(0.62, 0.5, ex_vec_length(p) + creases);
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    static const sps_lobe forward = {0.3f, 1};
    ex_volume_box(smoke, ex_vec_of(-0.2, 0.07, -0.65), ex_vec_of(1.1, 1.37, 0.65), 64);
    smoke->eval_fn = smoke_value, smoke->concurrent = 1;
    smoke->extinction = 7;
    ex_color(smoke->albedo, 0.95, 0.93, 0.90);
    smoke->lobes = &forward, smoke->lobe_count = 1;
}

/* The ground, and two posts with a beam across. */
static void build_gate(ex_mesh *mesh) {
    static const float sand[3] = {0.26f, 0.24f, 0.21f}, wood[3] = {0.36f, 0.16f, 0.07f};
    ex_shape_quad(mesh, ex_vec_of(-20, 0, -20), ex_vec_of(-20, 0, 10), ex_vec_of(20, 0, 10), ex_vec_of(20, 0, -20),
                  sand);
    for (int i = -1; i <= 1; i += 2)
        ex_shape_cylinder(mesh, ex_vec_of(-0.8, 0, 0.34 * i), ex_vec_of(-0.8, 1.5, 0.34 * i), 0.06, 0.06, wood);
    ex_shape_box(mesh, ex_vec_of(-0.86, 1.3, -0.52), ex_vec_of(-0.74, 1.42, 0.52), wood);
}

static void set_lights(sps_light lights[2], int soft) {
    lights[0] = ex_sun(ex_vec_of(1, -0.62, -0.08), 7);
    memset(&lights[1], 0, sizeof lights[1]);
    lights[1].kind = SPS_LIGHT_POINT;
    lights[1].position[0] = 2.4, lights[1].position[1] = 2.9, lights[1].position[2] = 1.6;
    ex_color(lights[1].color, 20, 30, 50);
    if (!soft) return;
    lights[0].angular_diameter = 10 * EX_PI / 180;
    lights[1].kind = SPS_LIGHT_DISC;
    lights[1].axes[0][0] = lights[1].axes[1][2] = 0.4; /* level, of radius 0.4 */
    lights[0].samples = lights[1].samples = 24;
}

int main(int argc, char **argv) {
    static float dusk[2][3] = {{0.30f, 0.27f, 0.25f}, {0.05f, 0.07f, 0.11f}};
    sps_light lights[PANELS][2];
    sps_scene scenes[PANELS];
    const ex_panels panels = {scenes, PANELS, EX_SAMPLE_ALL, NULL}; /* hard shadows on polygons would show steps */
    sps_view view = ex_view(ex_vec_of(0.4, 2.7, 5.4), ex_vec_of(0.35, 0.55, 0), 28);
    sps_volume smoke = {0};
    ex_mesh gate = {0};
    view.width = 320, view.height = 300, view.quality = SPS_QUALITY_MEDIUM;
    set_smoke(&smoke);
    build_gate(&gate);
    const sps_mesh mesh = ex_shape_mesh(&gate);
    for (int i = 0; i < PANELS; ++i) {
        set_lights(lights[i], i == SOFT);
        scenes[i] = ex_scene(lights[i]);
        scenes[i].light_count = 2;
        scenes[i].background_user = dusk;
        ex_color(scenes[i].ambient, 0.05, 0.06, 0.08);
        scenes[i].volumes = &smoke, scenes[i].volume_count = 1;
        scenes[i].meshes = &mesh, scenes[i].mesh_count = 1;
    }
    const int status = ex_panels_program(argc, argv, "penumbra.png", &panels, &view);
    ex_mesh_free(&gate);
    return status;
}
