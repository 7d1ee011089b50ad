/* Three panes of colored glass that stand in thin fog, with a spotlight behind them: colored shafts of light through
   the fog, and colored shadows on the ground, which mix where panes overlap. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { PANES = 3, MESHES = PANES + 1 };

/* sps_volume.eval_fn: thin fog with faint eddies. */
static int fog_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double eddies = ex_turbulence(ex_vec_scale(p, 1.3), 3);
        out[i] = (float)((0.6 + 0.9 * eddies) * ex_ramp(1.9, 1.3, p.y) * ex_ramp(-0.8, 0.3, p.z));
    }
    return 0;
}

static void set_fog(sps_volume *fog) {
    static const sps_lobe forward = {0.4f, 1};
    ex_volume_box(fog, ex_vec_of(-2.6, 0, -0.9), ex_vec_of(2.4, 1.9, 3.5), 64);
    fog->eval_fn = fog_value, fog->concurrent = 1;
    fog->extinction = 0.20f;
    ex_color(fog->albedo, 0.95, 0.95, 0.95);
    fog->lobes = &forward, fog->lobe_count = 1;
}

/* A pane about `middle` on the ground, turned about the vertical, and the frame around it. */
static void add_pane(ex_mesh *glass, ex_mesh *frames, ex_vec middle, double turn) {
    static const float clear[3] = {0.03f, 0.03f, 0.03f}, lead[3] = {0.07f, 0.07f, 0.08f};
    const ex_vec side = ex_vec_of(0.55 * cos(turn), 0, -0.55 * sin(turn)), up = ex_vec_of(0, 1.5, 0);
    const ex_vec left = ex_vec_sub(middle, side), right = ex_vec_add(middle, side);
    const ex_vec corners[4] = {left, right, ex_vec_add(right, up), ex_vec_add(left, up)};
    ex_shape_quad(glass, corners[0], corners[1], corners[2], corners[3], clear);
    for (int i = 0; i < 4; ++i) ex_shape_cylinder(frames, corners[i], corners[(i + 1) & 3], 0.022, 0.022, lead);
}

static void set_lamp(sps_light *lamp) {
    memset(lamp, 0, sizeof *lamp);
    lamp->kind = SPS_LIGHT_POINT;
    lamp->position[0] = 0.9, lamp->position[1] = 3.4, lamp->position[2] = -4.6;
    lamp->direction[0] = -0.9, lamp->direction[1] = -2.75, lamp->direction[2] = 4.6;
    lamp->inner_cone = 12 * EX_PI / 180, lamp->outer_cone = 15 * EX_PI / 180;
    ex_color(lamp->color, 520, 510, 490);
}

int main(int argc, char **argv) {
    static const float tints[PANES][3] = {{0.92f, 0.10f, 0.06f}, {0.10f, 0.82f, 0.12f}, {0.06f, 0.16f, 0.95f}};
    static const float stone[3] = {0.45f, 0.44f, 0.42f};
    static float night[2][3] = {{0.010f, 0.012f, 0.018f}, {0.020f, 0.026f, 0.040f}};
    ex_mesh parts[MESHES] = {{0}}; /* the panes; the ground, with all frames */
    sps_mesh meshes[MESHES];
    sps_light lamp;
    sps_view view = ex_view(ex_vec_of(-1.9, 3.0, 6.4), ex_vec_of(-0.1, 0.38, 0.9), 34);
    sps_scene scene = ex_scene(&lamp);
    sps_volume fog = {0};
    view.quality = SPS_QUALITY_MEDIUM;
    set_lamp(&lamp);
    set_fog(&fog);
    ex_shape_quad(&parts[PANES], ex_vec_of(-30, 0, -30), ex_vec_of(-30, 0, 30), ex_vec_of(30, 0, 30),
                  ex_vec_of(30, 0, -30), stone);
    for (int i = 0; i < PANES; ++i)
        add_pane(&parts[i], &parts[PANES], ex_vec_of(0.85 * (i - 1), 0, 0.35 * (1 - i)), 0.1 * (i - 1));
    for (int i = 0; i < MESHES; ++i) meshes[i] = ex_shape_mesh(&parts[i]);
    for (int i = 0; i < PANES; ++i) memcpy(meshes[i].transmittance, tints[i], sizeof tints[i]);
    scene.volumes = &fog, scene.volume_count = 1;
    scene.meshes = meshes, scene.mesh_count = MESHES;
    ex_color(scene.ambient, 0.02, 0.025, 0.035);
    scene.background_user = night;
    /* Hard shadows on polygons would show steps. */
    const int status = ex_scene_program(argc, argv, "panes.png", &scene, &view, EX_SAMPLE_ALL);
    for (int i = 0; i < MESHES; ++i) ex_mesh_free(&parts[i]);
    return status;
}
