/* An aeroplane above a layer of cumulus and its shadow on it, with light scattered once, forward, in every direction
   (SPS_SCATTERING_MULTIPLE), and by random paths (sps_reference), from left to right, with the time of each. The side
   of the aeroplane that the sun does not reach is lit by the clouds. */

#include "scene.h"
#include "shapes.h"
#include "ways.h"

/* A smooth maximum of how deep p is in each of the puffs about it, one per square of a grid, with a flat base. */
static double cloud_depth(ex_vec p) {
    const int across = (int)floor(p.x / 0.6), along = (int)floor(p.z / 0.6);
    double merged = 0;
    for (int k = 0; k < 25; ++k) {
        const int i = across + k % 5 - 2, j = along + k / 5 - 2;
        uint32_t random = ex_hash(i, j, 9);
        const double x = 0.6 * (i + ex_random(&random)), z = 0.6 * (j + ex_random(&random));
        const double radius = 0.40 + 0.16 * ex_random(&random);
        merged += exp(12 * (radius - ex_vec_length(ex_vec_of(p.x - x, 1.3 * p.y - 0.5 * radius, p.z - z))));
    }
    return log(merged + 1e-9) / 12 - 0.6 * ex_ramp(0.0, -0.25, p.y);
}

/* sps_volume.eval_fn: turbulence makes lumps of the puffs' surfaces. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double depth = cloud_depth(p);
        out[i] = 0;
        if (depth < -0.05) continue;
        out[i] = (float)ex_ramp(0, 0.12, depth + 0.08 - 0.28 * ex_turbulence(ex_vec_scale(p, 2.4), 4));
    }
    return 0;
}

static void set_clouds(sps_volume *clouds) {
    static const sps_lobe lobes[2] = {{0.8f, 0.85f}, {-0.1f, 0.15f}};
    ex_volume_box(clouds, ex_vec_of(-3.6, -0.25, -4.6), ex_vec_of(3.6, 0.85, 2.0), 168);
    clouds->eval_fn = cloud_value, clouds->concurrent = 1;
    clouds->revision = 1; /* all panels have the same voxels */
    clouds->extinction = 45;
    ex_color(clouds->albedo, 1, 1, 1);
    clouds->lobes = lobes, clouds->lobe_count = 2;
}

/* A wing or fin: a flat plate from a root to a tip, each given by its leading edge and its chord along x, and one more
   such plate beneath, so that it has a thickness. */
static void add_wing(ex_mesh *mesh, ex_vec root, double root_chord, ex_vec tip, double tip_chord, ex_vec thick,
                     const float color[3]) {
    const ex_vec a = ex_vec_sub(root, ex_vec_of(root_chord, 0, 0)), b = ex_vec_sub(tip, ex_vec_of(tip_chord, 0, 0));
    const ex_vec top[4] = {root, tip, b, a};
    ex_vec low[4];
    for (int i = 0; i < 4; ++i) low[i] = ex_vec_sub(top[i], thick);
    ex_shape_quad(mesh, top[0], top[1], top[2], top[3], color);
    ex_shape_quad(mesh, low[0], low[1], low[2], low[3], color);
    for (int i = 0; i < 4; ++i) ex_shape_quad(mesh, top[i], top[(i + 1) & 3], low[(i + 1) & 3], low[i], color);
}

/* An airliner about the origin; its nose looks along x. */
static void build_aeroplane(ex_mesh *mesh) {
    static const float white[3] = {0.78f, 0.79f, 0.80f}, grey[3] = {0.55f, 0.57f, 0.60f},
                       red[3] = {0.72f, 0.07f, 0.05f};
    static const double body[18] = {0.0,  -0.72, 0.03, -0.62, 0.07, -0.42, 0.085, -0.15, 0.085,
                                    0.15, 0.085, 0.42, 0.075, 0.56, 0.045, 0.66,  0.0,   0.70};
    static const double engine[10] = {0.0, -0.10, 0.028, -0.08, 0.036, 0.0, 0.034, 0.07, 0.0, 0.075};
    const ex_vec forward = ex_vec_of(1, 0, 0), thin = ex_vec_of(0, 0.02, 0);
    const ex_lathe fuselage = {body, 9, {0, 0, 0}, forward};
    ex_shape_lathe(mesh, &fuselage, 32, white, NULL);
    for (int side = -1; side <= 1; side += 2) {
        const ex_lathe jet = {engine, 5, {0.13, -0.075, 0.27 * side}, forward};
        add_wing(mesh, ex_vec_of(0.20, -0.03, 0.05 * side), 0.30, ex_vec_of(-0.20, 0.06, 0.78 * side), 0.09, thin,
                 grey);
        add_wing(mesh, ex_vec_of(-0.50, 0.02, 0), 0.16, ex_vec_of(-0.66, 0.05, 0.30 * side), 0.07, thin, grey);
        ex_shape_lathe(mesh, &jet, 20, red, NULL);
    }
    add_wing(mesh, ex_vec_of(-0.42, 0.04, 0.01), 0.24, ex_vec_of(-0.64, 0.32, 0.01), 0.11, ex_vec_of(0, 0, 0.02), red);
}

int main(int argc, char **argv) {
    static float sky[2][3] = {{0.030f, 0.065f, 0.13f}, {0.30f, 0.46f, 0.70f}}; /* below, the sea */
    sps_light sun = ex_sun(ex_vec_of(-0.7, -0.8, 0.55), 4.2);
    sps_view view = ex_view(ex_vec_of(0.7, 4.3, 4.6), ex_vec_of(-0.25, 0.75, -0.1), 31);
    sps_scene scene = ex_scene(&sun);
    sps_volume clouds = {0};
    ex_mesh aeroplane = {0};
    view.width = 200, view.height = 150, view.scattering_resolution = 112;
    set_clouds(&clouds);
    build_aeroplane(&aeroplane);
    sps_mesh mesh = ex_shape_mesh(&aeroplane);
    mesh.placement = ex_turned(0.45, ex_vec_of(0.5, 1.25, -0.55));
    for (int i = 0; i < 9; ++i) mesh.placement.axis[i / 3][i % 3] *= 1.9;
    mesh.revision = 1;
    ex_color(sun.color, 3.3, 3.1, 2.75);
    scene.volumes = &clouds, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0.05, 0.09, 0.16);
    scene.background_user = sky;
    const ex_ways ways = {&scene, 1, NULL, {.step = 4, .samples = 50, .seed = 1}, 48};
    const int status = ex_ways_program(argc, argv, "above_clouds.png", &ways, &view);
    ex_mesh_free(&aeroplane);
    return status;
}
