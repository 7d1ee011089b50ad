/* A cloud made of polygons: marching cubes around metaballs, roughened by noise. The cloud and the trees cast their
   shadows on rolling country. */

#include "metaballs.h"
#include "scene.h"
#include "scene_program.h"

static const ex_metaball heaps[] = {
    {{0.10, 2.55, 0.00}, 1.15, 1.0},  {{-0.85, 2.30, 0.15}, 0.95, 1.0}, {{0.95, 2.35, -0.10}, 1.00, 1.0},
    {{-1.70, 2.15, 0.0}, 0.70, 1.0},  {{1.80, 2.15, 0.15}, 0.72, 1.0},  {{-0.30, 2.30, 0.65}, 0.80, 1.0},
    {{0.55, 2.25, 0.60}, 0.75, 1.0},  {{0.35, 3.05, 0.05}, 0.75, 1.0},  {{-0.45, 2.90, -0.1}, 0.70, 1.0},
    {{-0.20, 2.25, -0.7}, 0.85, 1.0}, {{0.80, 2.20, -0.7}, 0.75, 1.0}};

/* ex_field_fn. Turbulence makes billows: round where it is large, creased where it is zero. Flat at the bottom. */
static double cloud_field(void *user, ex_vec p) {
    const double heap = ex_metaballs_value(user, p);
    if (heap <= 0) return -1;
    const double billows = ex_turbulence(ex_vec_scale(p, 1.4), 4);
    return heap * (0.45 + 1.1 * billows) - 0.9 * ex_ramp(2.12, 1.75, p.y);
}

static void build_cloud(ex_mesh *mesh) {
    static const float white[3] = {0.86f, 0.86f, 0.86f};
    ex_metaballs balls = {heaps, sizeof heaps / sizeof *heaps};
    ex_shape_field(mesh, cloud_field, &balls, 0.22, ex_vec_of(-2.6, 1.5, -1.7), ex_vec_of(2.7, 4.0, 1.7), 150, white);
}

static double ground_height(double x, double z) { return 0.28 * ex_fractal(ex_vec_of(0.45 * x, 7.3, 0.45 * z), 3); }

/* ex_surface_fn: u across, v into the distance. */
static ex_vec ground_point(const void *shape, double u, double v) {
    const double x = ex_mix(-6, 6, u), z = ex_mix(4, -9, v);
    (void)shape;
    return ex_vec_of(x, ground_height(x, z), z);
}

/* ex_paint_fn: meadows and fields, by the level of coarse noise. */
static void paint_ground(const float own[3], double u, double v, float out[3]) {
    static const double shades[3][3] = {{0.13, 0.24, 0.05}, {0.20, 0.29, 0.08}, {0.34, 0.32, 0.12}};
    const ex_vec p = ground_point(NULL, u, v);
    const double at = ex_clamp(1 + 1.3 * ex_noise(ex_vec_of(0.8 * p.x, 0.5, 0.8 * p.z)), 0, 1.999);
    const double grain = 1 + 0.25 * ex_fractal(ex_vec_scale(p, 9), 3);
    const int k = (int)at;
    (void)own;
    ex_color(out, grain * ex_mix(shades[k][0], shades[k + 1][0], at - k),
             grain * ex_mix(shades[k][1], shades[k + 1][1], at - k),
             grain * ex_mix(shades[k][2], shades[k + 1][2], at - k));
}

static void build_country(ex_mesh *mesh) {
    static const float green[3] = {0.05f, 0.13f, 0.04f}, bark[3] = {0.16f, 0.10f, 0.06f};
    uint32_t random = 12;
    ex_shape_surface(mesh, ground_point, NULL, 160, 160, green, paint_ground);
    for (int i = 0; i < 400; ++i) {
        const double x = ex_mix(-5.5, 5.5, ex_random(&random)), z = ex_mix(2.6, -8, ex_random(&random));
        const double size = 0.10 + 0.08 * ex_random(&random), y = ground_height(x, z);
        if (ex_noise(ex_vec_of(0.5 * x, 3.5, 0.5 * z)) < 0.12) continue; /* trees stand in woods */
        ex_shape_cylinder(mesh, ex_vec_of(x, y - 0.05, z), ex_vec_of(x, y + size, z), 0.12 * size, 0.1 * size, bark);
        ex_shape_cylinder(mesh, ex_vec_of(x, y + 0.5 * size, z), ex_vec_of(x, y + 3 * size, z), 0.7 * size, 0, green);
    }
}

int main(int argc, char **argv) {
    static float sky[2][3] = {{0.60f, 0.72f, 0.84f}, {0.16f, 0.34f, 0.64f}};
    const sps_light sun = ex_sun(ex_vec_of(0.55, -1.0, -0.35), 2.9);
    const sps_view view = ex_view(ex_vec_of(0.6, 1.9, 8.2), ex_vec_of(0.1, 1.55, 0), 33);
    sps_scene scene = ex_scene(&sun);
    ex_mesh cloud = {0}, country = {0};
    build_cloud(&cloud);
    build_country(&country);
    const sps_mesh meshes[2] = {ex_shape_mesh(&cloud), ex_shape_mesh(&country)};
    scene.meshes = meshes, scene.mesh_count = 2;
    ex_color(scene.ambient, 0.22, 0.27, 0.35);
    scene.background_user = sky;
    const int status = ex_scene_program(argc, argv, "cloud_mesh.png", &scene, &view, EX_SAMPLE_EDGES);
    ex_mesh_free(&cloud);
    ex_mesh_free(&country);
    return status;
}
