/* A stone circle in ground fog. The fog is a closed polygon mesh with a color and an extinction: for each pixel, the
   distances of back faces minus those of front faces are the length of the ray inside it, up to the stones, the ground
   or the sky. The library renders what is behind the fog, and its distance (sps_image.depth). */

#include "metaballs.h"
#include "scene.h"
#include "scene_program.h"
#include "thickness.h"

enum { STONES = 11 };

/* A rough box with its lower end in the ground: its angle around the circle, the height of its center, its half size.
 */
typedef struct stone {
    double around, height;
    ex_vec half;
} stone;

/* The uprights, and the three lintels that are left. */
static const stone stones[STONES] = {
    {0.30, 0.42, {0.20, 1.00, 0.13}}, {0.85, 0.43, {0.19, 1.01, 0.14}}, {1.42, 0.41, {0.21, 0.99, 0.12}},
    {2.10, 0.27, {0.18, 0.78, 0.13}}, {2.75, 0.42, {0.20, 0.98, 0.14}}, {3.33, 0.42, {0.19, 1.00, 0.13}},
    {4.00, 0.04, {0.20, 0.54, 0.15}}, {5.10, 0.37, {0.18, 0.90, 0.13}}, {0.575, 1.53, {0.60, 0.12, 0.15}},
    {1.14, 1.53, {0.60, 0.12, 0.14}}, {3.04, 1.53, {0.60, 0.12, 0.15}}};

/* ex_field_fn: how deep p is inside a weathered stone. */
static double stone_field(void *user, ex_vec p) {
    const double worn = 0.05 * ex_fractal(ex_vec_scale(p, 3.5), 4);
    double deepest = -1;
    (void)user;
    for (int i = 0; i < STONES; ++i) {
        const stone *s = &stones[i];
        const double c = cos(s->around), k = sin(s->around);
        const ex_vec own = ex_vec_of(c * p.z - k * p.x, p.y - s->height, k * p.z + c * p.x - 1.75);
        deepest = fmax(deepest, -ex_box_distance(own, ex_vec_of(0, 0, 0), s->half, 0.07));
    }
    return deepest + worn;
}

static double ground_height(double x, double z) { return 0.16 * ex_fractal(ex_vec_of(0.4 * x, 2.2, 0.4 * z), 4) - 0.1; }

static ex_vec ground_point(const void *shape, double u, double v) {
    const double x = ex_mix(-9, 9, u), z = ex_mix(6, -12, v);
    (void)shape;
    return ex_vec_of(x, ground_height(x, z), z);
}

static void paint_ground(const float own[3], double u, double v, float out[3]) {
    const ex_vec p = ground_point(NULL, u, v);
    const double dry = ex_ramp(-0.6, 0.8, ex_fractal(ex_vec_scale(p, 1.3), 5));
    const double grain = 1 + 0.3 * ex_noise(ex_vec_scale(p, 12));
    for (int c = 0; c < 3; ++c) out[c] = (float)(grain * ex_mix((double)own[c], c == 2 ? 0.06 : 0.21 - 0.02 * c, dry));
}

/* ex_field_fn: a bank of billows on the ground, lower towards its rim; its hollows reach the ground. Its bottom is
   below the ground, where no ray arrives. */
static double fog_field(void *user, ex_vec p) {
    const double away = sqrt(p.x * p.x + (p.z + 1) * (p.z + 1));
    const double billows = ex_turbulence(ex_vec_of(0.7 * p.x, 1.1 * p.y, 0.7 * p.z), 4);
    (void)user;
    return 1.05 * billows - 0.05 - 1.2 * ex_ramp(2.6, 5.2, away) - p.y;
}

/* The look of the fog: its extinction per world unit, and its radiance where it is thick. */
typedef struct fog {
    ex_mesh mesh;
    double extinction;
    float glow[3];
} fog;

/* ex_finish.apply_fn: lays the fog over the picture. */
static void lay_fog(void *user, const sps_view *view, const sps_image *image) {
    const fog *f = (const fog *)user;
    const size_t pixels = (size_t)view->width * (size_t)view->height;
    double *lengths = (double *)ex_allocate(pixels, sizeof *lengths);
    ex_mesh_thickness(&f->mesh, view, image->depth, lengths);
    for (size_t i = 0; i < pixels; ++i) {
        const float through = (float)exp(-f->extinction * lengths[i]);
        for (int c = 0; c < 3; ++c) {
            float *color = image->rgba + 4 * i + c;
            *color = through * *color + (1 - through) * f->glow[c];
        }
    }
    free(lengths);
}

static void build_stones(ex_mesh *mesh) {
    static const float grey[3] = {0.33f, 0.32f, 0.30f}, grass[3] = {0.07f, 0.13f, 0.035f};
    ex_shape_field(mesh, stone_field, NULL, 0, ex_vec_of(-2.2, -0.5, -2.2), ex_vec_of(2.2, 1.8, 2.2), 150, grey);
    ex_shape_surface(mesh, ground_point, NULL, 200, 200, grass, paint_ground);
}

int main(int argc, char **argv) {
    static float dawn[2][3] = {{0.95f, 0.62f, 0.40f}, {0.30f, 0.42f, 0.58f}};
    const sps_light sun = ex_sun(ex_vec_of(1.0, -0.72, -0.85), 4.6);
    sps_view view = ex_view(ex_vec_of(1.2, 1.75, 7.0), ex_vec_of(0, 0.62, 0), 31);
    sps_scene scene = ex_scene(&sun);
    ex_mesh stone_circle = {0};
    fog ground_fog = {{NULL, 0, {0, 0, 0}, {0, 0, 0}}, 1.0, {0.66f, 0.62f, 0.57f}};
    const ex_finish finish = {lay_fog, &ground_fog};
    const ex_panels panel = {&scene, 1, EX_SAMPLE_ALL, &finish}; /* fog is laid over each pixel of a larger picture */
    build_stones(&stone_circle);
    ex_shape_field(&ground_fog.mesh, fog_field, NULL, 0, ex_vec_of(-5, -0.9, -6), ex_vec_of(5, 1.2, 4), 130,
                   ground_fog.glow);
    const sps_mesh mesh = ex_shape_mesh(&stone_circle);
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0.14, 0.17, 0.22);
    scene.background_user = dawn;
    const int status = ex_panels_program(argc, argv, "fog.png", &panel, &view);
    ex_mesh_free(&stone_circle);
    ex_mesh_free(&ground_fog.mesh);
    return status;
}
