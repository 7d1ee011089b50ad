/* A lamp in the midst of a cloud on the ground, within a ring of standing stones: stones and denser lumps of the cloud
   cast shafts of shadow outwards, through the cloud and over the ground. The lamp has a shadow table of six faces: no
   slicing direction suits a light that gas surrounds. */

#include "particles.h"
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { STONES = 11 };

static const ex_vec lamp_place = {0.1, 0.62, 0};

/* sps_volume.eval_fn: turbulent gas that thins out upwards and towards the rim, with denser lumps around the hollow in
   which the lamp stands. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double hollow = ex_ramp(-0.3, 1.0, ex_vec_length(ex_vec_sub(p, lamp_place)));
        const double around = sqrt(p.x * p.x + p.z * p.z);
        out[i] = 0;
        if (around > 4.6) continue;
        const double eddies = ex_turbulence(ex_vec_of(1.1 * p.x, 1.8 * p.y + 3, 1.1 * p.z), 4);
        const double lump = ex_noise(ex_vec_of(1.3 * p.x + 7.7, 1.6 * p.y, 1.3 * p.z + 2.2)) + 0.35 * eddies;
        const double dense = 4 * ex_ramp(0.40, 0.75, lump) * ex_ramp(0.35, 0.6, around) * ex_ramp(2.2, 1.1, around);
        const double thin = (0.35 + 0.8 * eddies * eddies) * exp(-0.7 * p.y);
        out[i] = (float)(hollow * (thin + dense) * ex_ramp(4.6, 3.0, around + 0.8 * eddies) * ex_ramp(2.0, 1.4, p.y));
    }
    return 0;
}

static void set_cloud(sps_volume *cloud) {
    static const sps_lobe lobes[2] = {{0.45f, 0.7f}, {-0.2f, 0.3f}};
    ex_volume_box(cloud, ex_vec_of(-4.4, 0, -4.4), ex_vec_of(4.4, 2, 4.4), 96);
    cloud->eval_fn = cloud_value, cloud->concurrent = 1;
    cloud->extinction = 0.6f;
    ex_color(cloud->albedo, 0.96, 0.95, 0.93);
    cloud->lobes = lobes, cloud->lobe_count = 2;
}

/* The flame, a ball that glows and hardly shades. */
static void set_flame(sps_particles *flame, sps_particle *ball) {
    const double depth = 0.02;
    ball->radius = 0.12f, ball->optical_depth = (float)depth;
    ex_store(ball->position, lamp_place);
    flame->count = 1, flame->read_fn = ex_particles_read, flame->user = ball;
    flame->soft = 1;
    ex_color(flame->emission, 6 / depth, 4 / depth, 2 / depth);
}

/* A standing stone with a face towards the middle, narrower at its top. */
static void add_stone(ex_mesh *mesh, double angle, double width, double height) {
    static const float rock[3] = {0.40f, 0.38f, 0.35f};
    const ex_vec out = ex_vec_of(sin(angle), 0, cos(angle)), across = ex_vec_of(out.z, 0, -out.x);
    ex_vec low[4], high[4];
    for (int k = 0; k < 4; ++k) {
        const double side = (k == 1 || k == 2 ? 0.5 : -0.5) * width, depth = (k >= 2 ? 0.12 : -0.12);
        low[k] = ex_vec_add(ex_vec_scale(out, 1.5 + depth), ex_vec_scale(across, side));
        high[k] = ex_vec_add(ex_vec_scale(out, 1.5 + 0.7 * depth), ex_vec_scale(across, 0.75 * side));
        high[k].y = height * (k == 1 ? 0.92 : 1);
    }
    for (int k = 0; k < 4; ++k) ex_shape_quad(mesh, low[k], low[(k + 1) & 3], high[(k + 1) & 3], high[k], rock);
    ex_shape_quad(mesh, high[0], high[1], high[2], high[3], rock);
}

/* The ground, and a ring of stones, one of which is missing towards the eye. */
static void build_stones(ex_mesh *mesh) {
    static const float earth[3] = {0.20f, 0.20f, 0.15f};
    uint32_t random = 12;
    ex_shape_quad(mesh, ex_vec_of(-30, 0, -30), ex_vec_of(-30, 0, 30), ex_vec_of(30, 0, 30), ex_vec_of(30, 0, -30),
                  earth);
    for (int i = 0; i < STONES; ++i) {
        const double angle = 2 * EX_PI * (i + 0.3 * ex_random(&random)) / STONES;
        const double width = 0.28 + 0.16 * ex_random(&random), height = 0.75 + 0.55 * ex_random(&random);
        if (i > 0) add_stone(mesh, angle, width, height);
    }
}

static void set_lamp(sps_light *lamp, const sps_tmap_settings *table) {
    memset(lamp, 0, sizeof *lamp);
    lamp->kind = SPS_LIGHT_POINT;
    lamp->position[0] = lamp_place.x, lamp->position[1] = lamp_place.y, lamp->position[2] = lamp_place.z;
    ex_color(lamp->color, 20, 11.5, 5);
    lamp->shadow_map = table, lamp->shadow_map_resolution = 96;
}

int main(int argc, char **argv) {
    static const sps_tmap_settings table = {0}; /* zeros: a shadow table */
    static float night[2][3] = {{0.012f, 0.017f, 0.030f}, {0.020f, 0.030f, 0.055f}};
    sps_light lamp;
    sps_view view = ex_view(ex_vec_of(0.6, 5.5, 7.2), ex_vec_of(0, 0.1, 0), 32);
    sps_scene scene = ex_scene(&lamp);
    sps_volume cloud = {0};
    sps_particle ball;
    sps_particles flame = {0};
    ex_mesh stones = {0};
    view.width = 640, view.height = 480, view.quality = SPS_QUALITY_MEDIUM, view.slab_thickness = 3;
    set_lamp(&lamp, &table);
    set_cloud(&cloud);
    set_flame(&flame, &ball);
    build_stones(&stones);
    const sps_mesh mesh = ex_shape_mesh(&stones);
    scene.volumes = &cloud, scene.volume_count = 1;
    scene.particles = &flame, scene.particle_set_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0.010, 0.014, 0.025);
    scene.background_user = night;
    const int status = ex_scene_program(argc, argv, "lamp.png", &scene, &view, EX_SAMPLE_EDGES);
    ex_mesh_free(&stones);
    return status;
}
