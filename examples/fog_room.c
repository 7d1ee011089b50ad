/* A lamp under a shade, in a room full of fog, with light scattered once, forward, in every direction
   (SPS_SCATTERING_MULTIPLE), and by random paths (sps_reference), from left to right, with the time of each. The shade
   keeps the lamp from the ceiling and the upper walls: only fog lights these, and what stands in a shadow. */

#include "scene.h"
#include "shapes.h"
#include "ways.h"

static const ex_vec lamp_place = {0.1, 1.78, -0.1};

/* sps_volume.eval_fn. The room: x -2..2, y 0..2.6, z -2..2, open at z = 2, where the viewer stands. The warm air about
   the lamp is clear: light close to a point is so bright that random paths would take very many samples. */
static int fog_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double eddies = ex_turbulence(ex_vec_of(0.9 * p.x, 1.3 * p.y, 0.9 * p.z), 3);
        out[i] = (float)(ex_ramp(0.1, 1.1, ex_vec_length(ex_vec_sub(p, lamp_place))) * (0.75 + 0.6 * eddies));
    }
    return 0;
}

/* The depth of the room is an optical depth of about 1.2. */
static void set_fog(sps_volume *fog) {
    static const sps_lobe lobe = {0.6f, 1};
    ex_volume_box(fog, ex_vec_of(-2, 0, -2), ex_vec_of(2, 2.6, 2), 64);
    fog->eval_fn = fog_value, fog->concurrent = 1;
    fog->revision = 1; /* all panels have the same voxels */
    fog->extinction = 0.3f;
    ex_color(fog->albedo, 0.98, 0.98, 0.98);
    fog->lobes = &lobe, fog->lobe_count = 1;
}

static void build_room(ex_mesh *mesh) {
    static const float grey[3] = {0.72f, 0.71f, 0.69f}, red[3] = {0.72f, 0.14f, 0.08f}, blue[3] = {0.10f, 0.24f, 0.70f};
    ex_shape_box(mesh, ex_vec_of(-2.2, -0.2, -2.2), ex_vec_of(2.2, 0, 2.2), grey);
    ex_shape_box(mesh, ex_vec_of(-2.2, 2.6, -2.2), ex_vec_of(2.2, 2.8, 2.2), grey);
    ex_shape_box(mesh, ex_vec_of(-2.2, 0, -2.2), ex_vec_of(2.2, 2.6, -2), grey);
    ex_shape_box(mesh, ex_vec_of(-2.2, 0, -2), ex_vec_of(-2, 2.6, 2.2), red);
    ex_shape_box(mesh, ex_vec_of(2, 0, -2), ex_vec_of(2.2, 2.6, 2.2), blue);
}

/* The lamp's shade and cord; a vase on a box, a ball, and a mushroom. */
static void build_objects(ex_mesh *mesh) {
    static const float brass[3] = {0.55f, 0.40f, 0.16f}, white[3] = {0.80f, 0.79f, 0.76f},
                       green[3] = {0.16f, 0.42f, 0.20f}, ochre[3] = {0.72f, 0.46f, 0.14f};
    static const double vase[12] = {0.16, 0.0, 0.26, 0.22, 0.20, 0.46, 0.09, 0.62, 0.09, 0.74, 0.15, 0.82};
    static const double ball[14] = {0.0,   -0.34, 0.24, -0.24, 0.33, -0.08, 0.34,
                                    0.004, 0.33,  0.08, 0.24,  0.24, 0.0,   0.34};
    static const double shade[6] = {0.34, -0.12, 0.24, 0.10, 0.05, 0.20};
    const ex_lathe lathes[3] = {{shade, 3, lamp_place, {0, 1, 0}},
                                {vase, 6, {-0.95, 0.62, -0.75}, {0, 1, 0}},
                                {ball, 7, {0.25, 0.34, 0.75}, {0, 1, 0}}};
    const ex_vec cord = ex_vec_add(lamp_place, ex_vec_of(0, 0.18, 0));
    ex_shape_lathe(mesh, &lathes[0], 48, brass, NULL);
    ex_shape_cylinder(mesh, cord, ex_vec_of(cord.x, 2.6, cord.z), 0.05, 0.015, brass);
    ex_shape_box(mesh, ex_vec_of(-1.35, 0, -1.15), ex_vec_of(-0.55, 0.62, -0.35), white);
    ex_shape_lathe(mesh, &lathes[1], 48, green, NULL);
    ex_shape_lathe(mesh, &lathes[2], 48, white, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(1.15, 0, -0.5), ex_vec_of(0.05, 1, 0.05), 0.9, 0.5, ochre, NULL);
}

static sps_light lamp_of(const sps_tmap_settings *table) {
    sps_light lamp = {0};
    lamp.kind = SPS_LIGHT_POINT;
    lamp.position[0] = lamp_place.x, lamp.position[1] = lamp_place.y, lamp.position[2] = lamp_place.z;
    ex_color(lamp.color, 13, 11.4, 9.4);
    lamp.direction[1] = -1;
    lamp.inner_cone = 1.05, lamp.outer_cone = 1.2; /* past the inside of the shade, which would glare */
    lamp.shadow_map = table;
    return lamp;
}

int main(int argc, char **argv) {
    static const sps_tmap_settings table = {0}; /* zeros: a shadow table, since gas surrounds the lamp */
    const sps_light lamp = lamp_of(&table);
    sps_view view = ex_view(ex_vec_of(0, 1.35, 6.1), ex_vec_of(0, 1.24, 0), 35.5);
    sps_scene scene = ex_scene(&lamp);
    sps_volume fog = {0};
    ex_mesh room = {0};
    view.width = 200, view.height = 150, view.quality = SPS_QUALITY_MEDIUM;
    set_fog(&fog);
    build_room(&room);
    build_objects(&room);
    sps_mesh mesh = ex_shape_mesh(&room);
    mesh.revision = 1;
    scene.volumes = &fog, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0, 0, 0); /* it would pass through the walls */
    const ex_ways ways = {&scene, 1, NULL, {.step = 4, .samples = 300, .seed = 1}, 48};
    const int status = ex_ways_program(argc, argv, "fog_room.png", &ways, &view);
    ex_mesh_free(&room);
    return status;
}
