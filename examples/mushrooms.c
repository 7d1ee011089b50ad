/* Three polygon mushrooms cast their shadows on a volumetric plate. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

/* sps_volume.eval_fn: a round stone plate with a raised rim. The grain changes the value, and by that the color; the
   relief changes the shape. */
static int plate_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const ex_vec p = ex_vec_of(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
        const double around = sqrt(p.x * p.x + p.z * p.z);
        const double grain = ex_fractal(ex_vec_scale(p, 2.3), 4), relief = 0.006 * ex_noise(ex_vec_scale(p, 9));
        const double disc = fmax(fabs(p.y + 0.11) - 0.075, around - 1.82);
        const double rim = ex_ring_distance(p, ex_vec_of(0, -0.06, 0), ex_vec_of(0, 1, 0), 1.80, 0.11);
        out[i] = (float)(ex_solid(fmin(disc, rim) + relief, 0.075) * ex_clamp(0.75 + 0.35 * grain, 0.45, 1));
    }
    return 0;
}

static void set_plate(sps_volume *plate) {
    static const sps_transfer_point stone[4] = {{0.12f, {0.50f, 0.48f, 0.44f}, 0, {0, 0, 0}},
                                                {0.45f, {0.48f, 0.46f, 0.42f}, 40, {0, 0, 0}},
                                                {0.70f, {0.66f, 0.59f, 0.49f}, 90, {0, 0, 0}},
                                                {1.00f, {0.88f, 0.79f, 0.64f}, 120, {0, 0, 0}}};
    static const sps_transfer look = {stone, 4, NULL, NULL, 0};
    ex_volume_box(plate, ex_vec_of(-2, -0.25, -2), ex_vec_of(2, 0.12, 2), 160);
    plate->eval_fn = plate_value, plate->concurrent = 1;
    plate->transfer = &look;
    plate->shading = SPS_SHADING_SURFACE;
    plate->specular = 0.1f;
}

static void build_mushrooms(ex_mesh *mesh) {
    static const float red[3] = {0.62f, 0.05f, 0.03f}, brown[3] = {0.36f, 0.17f, 0.07f},
                       ochre[3] = {0.68f, 0.36f, 0.08f};
    ex_shape_mushroom(mesh, ex_vec_of(-0.25, -0.04, -0.25), ex_vec_of(-0.06, 1, 0), 1.45, 0.82, red, ex_paint_dots);
    ex_shape_mushroom(mesh, ex_vec_of(0.85, -0.04, 0.25), ex_vec_of(0.16, 1, 0.06), 0.90, 0.50, ochre, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(-0.62, -0.04, 0.85), ex_vec_of(-0.14, 1, 0.12), 0.58, 0.36, brown, NULL);
}

int main(int argc, char **argv) {
    const sps_light sun = ex_sun(ex_vec_of(1.0, -1.15, -0.35), 4.4);
    const sps_view view = ex_view(ex_vec_of(0.5, 2.3, 5.9), ex_vec_of(0.0, 0.34, 0.05), 30);
    sps_scene scene = ex_scene(&sun);
    sps_volume plate = {0};
    ex_mesh mushrooms = {0};
    set_plate(&plate);
    scene.volumes = &plate, scene.volume_count = 1;
    build_mushrooms(&mushrooms);
    const sps_mesh mesh = ex_shape_mesh(&mushrooms);
    scene.meshes = &mesh, scene.mesh_count = 1;
    /* Classified voxels, and hard shadows on the mushrooms. */
    const int status = ex_scene_program(argc, argv, "mushrooms.png", &scene, &view, EX_SAMPLE_ALL);
    ex_mesh_free(&mushrooms);
    return status;
}
