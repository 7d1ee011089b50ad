/* A polygon dart in a target of three volumetric rings on pegs, before a volumetric plate. The dart's shadow runs over
   the rings, and all of them cast shadows on the plate. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

/* A ring in front of the plate, held by four pegs. Each ring is a volume of its own and so has its own color. */
typedef struct ring {
    double radius, height;
    sps_transfer_point paint[2];
    sps_transfer look;
} ring;

static double ring_distance(const ring *r, ex_vec p) {
    double distance = ex_ring_distance(p, ex_vec_of(0, 0, r->height), ex_vec_of(0, 0, 1), r->radius, 0.085);
    for (int k = 0; k < 4; ++k) {
        const double angle = EX_PI * (0.5 * k + 0.25);
        const ex_vec head = ex_vec_of(r->radius * cos(angle), r->radius * sin(angle), r->height);
        distance = fmin(distance, ex_rod_distance(p, head, ex_vec_of(head.x, head.y, -0.05), 0.035, 0.035));
    }
    return distance;
}

static int ring_value(void *user, size_t count, const double *positions, float *out) {
    for (size_t i = 0; i < count; ++i, positions += 3)
        out[i] = (float)ex_solid(ring_distance((const ring *)user, ex_vec_of(positions[0], positions[1], positions[2])),
                                 0.06);
    return 0;
}

static void set_ring(sps_volume *volume, ring *r, double radius, double height, const float color[3]) {
    const double reach = radius + 0.15;
    r->radius = radius, r->height = height;
    for (int i = 0; i < 2; ++i) memcpy(r->paint[i].albedo, color, sizeof r->paint[i].albedo);
    r->paint[0].value = 0.15f, r->paint[1].value = 0.5f, r->paint[1].extinction = 120;
    r->look.points = r->paint, r->look.point_count = 2;
    ex_volume_box(volume, ex_vec_of(-reach, -reach, -0.05), ex_vec_of(reach, reach, height + 0.15), (int)(104 * reach));
    volume->eval_fn = ring_value, volume->concurrent = 1, volume->user = r;
    volume->transfer = &r->look;
    volume->shading = SPS_SHADING_SURFACE;
    volume->specular = 0.3f;
}

/* sps_volume.eval_fn: upright boards with dark joints and grain. */
static int plate_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double board = p.x / 0.52 + 0.5, joint = fabs(board - floor(board + 0.5));
        const double tone = ex_hash((int)floor(board), 3, 8) % 100 * 0.0015 - 0.07;
        const double grain = 0.09 * ex_fractal(ex_vec_of(9 * p.x, 1.1 * p.y + 7 * floor(board), 9 * p.z), 3);
        const double solid =
            ex_solid(ex_box_distance(p, ex_vec_of(0, 0, -0.08), ex_vec_of(1.82, 1.82, 0.08), 0.05), 0.075);
        out[i] = (float)(solid * ex_clamp(0.75 + tone + grain - 0.25 * (1 - ex_ramp(0, 0.045, joint)), 0.4, 1));
    }
    return 0;
}

static void set_plate(sps_volume *plate) {
    static const sps_transfer_point wood[3] = {{0.20f, {0.30f, 0.19f, 0.10f}, 0, {0, 0, 0}},
                                               {0.50f, {0.26f, 0.15f, 0.08f}, 90, {0, 0, 0}},
                                               {0.95f, {0.72f, 0.52f, 0.32f}, 120, {0, 0, 0}}};
    static const sps_transfer look = {wood, 3, NULL, NULL, 0};
    ex_volume_box(plate, ex_vec_of(-1.95, -1.95, -0.22), ex_vec_of(1.95, 1.95, 0.06), 150);
    plate->eval_fn = plate_value, plate->concurrent = 1;
    plate->transfer = &look;
    plate->shading = SPS_SHADING_SURFACE;
}

/* Needle, barrel, shaft and four flights, along `axis` from the tip of the needle. */
static void build_dart(ex_mesh *mesh, ex_vec tip, ex_vec axis) {
    static const float steel[3] = {0.55f, 0.56f, 0.60f}, brass[3] = {0.60f, 0.40f, 0.12f},
                       blue[3] = {0.08f, 0.26f, 0.62f};
    static const double barrel[16] = {0.015, 0.38, 0.055, 0.46, 0.078, 0.60, 0.068, 0.72,
                                      0.078, 0.84, 0.068, 0.96, 0.075, 1.06, 0.03,  1.16};
    const ex_lathe lathe = {barrel, 8, tip, axis};
    const ex_vec side = ex_vec_perpendicular(axis), other = ex_vec_cross(axis, side);
    ex_shape_cylinder(mesh, ex_vec_add(tip, ex_vec_scale(axis, 0.4)), tip, 0.022, 0, steel);
    ex_shape_lathe(mesh, &lathe, 40, brass, NULL);
    ex_shape_cylinder(mesh, ex_vec_add(tip, ex_vec_scale(axis, 1.14)), ex_vec_add(tip, ex_vec_scale(axis, 2.0)), 0.028,
                      0.022, steel);
    for (int i = 0; i < 4; ++i) {
        const double angle = EX_PI * (0.5 * i + 0.15);
        const ex_vec out =
            ex_vec_scale(ex_vec_add(ex_vec_scale(side, cos(angle)), ex_vec_scale(other, sin(angle))), 0.30);
        const ex_vec a = ex_vec_add(tip, ex_vec_scale(axis, 1.45)), d = ex_vec_add(tip, ex_vec_scale(axis, 2.05));
        ex_shape_quad(mesh, a, ex_vec_add(ex_vec_add(tip, ex_vec_scale(axis, 1.70)), out),
                      ex_vec_add(ex_vec_add(tip, ex_vec_scale(axis, 2.12)), out), d, blue);
    }
}

int main(int argc, char **argv) {
    static const float red[3] = {0.66f, 0.06f, 0.04f}, cream[3] = {0.74f, 0.66f, 0.50f};
    const sps_light sun = ex_sun(ex_vec_of(-0.75, -0.62, -1.0), 4.2);
    const sps_view view = ex_view(ex_vec_of(-3.9, 1.4, 6.0), ex_vec_of(0.28, 0.0, 0.5), 35);
    sps_scene scene = ex_scene(&sun);
    ring rings[3];
    sps_volume volumes[4];
    ex_mesh dart = {0};
    memset(rings, 0, sizeof rings);
    memset(volumes, 0, sizeof volumes);
    for (int i = 0; i < 3; ++i)
        set_ring(&volumes[i], &rings[i], 1.25 - 0.42 * i, 0.40 + 0.28 * i, i == 1 ? cream : red);
    set_plate(&volumes[3]);
    build_dart(&dart, ex_vec_of(0.10, 0.05, 0.85), ex_vec_unit(ex_vec_of(0.40, 0.25, 1)));
    const sps_mesh mesh = ex_shape_mesh(&dart);
    scene.volumes = volumes, scene.volume_count = 4;
    scene.meshes = &mesh, scene.mesh_count = 1;
    /* Classified voxels are hardly larger than pixels. */
    const int status = ex_scene_program(argc, argv, "dart.png", &scene, &view, EX_SAMPLE_ALL);
    ex_mesh_free(&dart);
    return status;
}
