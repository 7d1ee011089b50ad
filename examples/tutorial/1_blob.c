/* Step 1 of docs/tutorial.md: a blob of gas above a ground, what a plan says of it, and what was done. */

#include "splatshadow.h"
#include "../picture.h"

enum { WIDTH = 320, HEIGHT = 240 };

/* sps_volume.eval_fn: the density at the centers of `count` voxels, x y z each. */
static int blob(void *user, size_t count, const double *xyz, float *density) {
    const double *sharpness = (const double *)user;
    for (size_t i = 0; i < count; ++i, xyz += 3)
        density[i] = (float)exp(-*sharpness * (xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2]));
    return 0;
}

/* The passes that a render of this scene will run, and why it runs them or leaves them out. */
static int print_plan(sps_context *context, const sps_scene *scene, const sps_view *view) {
    sps_plan_report plan;
    if (sps_plan(context, scene, view, &plan)) return 1;
    for (int i = 0; i < SPS_PASS_COUNT; ++i)
        printf("%-16s %d  %s\n", sps_pass_name((sps_pass)i), plan.pass[i].runs, plan.pass[i].reason);
    printf("%d sweep, up to %d slabs, up to %.1f MB\n", plan.sweep_count, plan.slab_count, 1e-6 * (double)plan.bytes);
    return 0;
}

static void print_stats(const sps_context *context) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    printf("%llu voxels read, %llu of them relevant\n", (unsigned long long)stats.voxels_read,
           (unsigned long long)stats.voxels_relevant);
    printf("for the eye: %llu samples, %llu fragments\n", (unsigned long long)stats.eye_samples,
           (unsigned long long)stats.eye_fragments);
    printf("for the light: %llu samples, %llu fragments, %llu shadow rays\n", (unsigned long long)stats.light_samples,
           (unsigned long long)stats.light_fragments, (unsigned long long)stats.shadow_rays);
}

int main(int argc, char **argv) {
    static const float corners[] = {-9, -0.8f, 5, 9, -0.8f, 5, 9, -0.8f, -9, -9, -0.8f, -9};
    static const uint16_t indices[] = {0, 1, 2, 0, 2, 3};
    static float rgba[WIDTH * HEIGHT * 4];
    double sharpness = 16;
    sps_volume gas = {.size = {64, 64, 64}, .eval_fn = blob, .user = &sharpness};
    gas.placement = (sps_placement){{-1, -1, -1}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}}; /* the box from -1 to 1 */
    gas.extinction = 6; /* optical depth through the middle: 6 times the integral of the density, 0.44, is 2.7 */
    gas.albedo[0] = 0.7f, gas.albedo[1] = 0.8f, gas.albedo[2] = 0.9f;

    sps_indexed_mesh ground = {.vertex_count = 4, .positions = corners, .triangle_count = 2, .indices_u16 = indices};
    sps_mesh mesh = {.triangle_count = 2, .read_fn = sps_indexed_mesh_read, .user = &ground};
    mesh.albedo[0] = mesh.albedo[1] = 0.3f, mesh.albedo[2] = 0.2f;

    sps_light sun = {.direction = {1, -1, -0.5}, .color = {9, 8, 7}}; /* the way the light travels; irradiance */
    sps_scene scene = {.volumes = &gas, .volume_count = 1, .meshes = &mesh, .mesh_count = 1};
    scene.lights = &sun, scene.light_count = 1;
    scene.background[0] = 0.1f, scene.background[1] = 0.2f, scene.background[2] = 0.4f;

    sps_view view = {.width = WIDTH, .height = HEIGHT};
    view.scattering = SPS_SCATTERING_SINGLE; /* light scatters once; 0, the default: as often as the scene calls for */
    view.camera = (sps_camera){.position = {0, 1.2, 4}, .up = {0, 1, 0}, .field_of_view = 0.6}; /* target: 0, 0, 0 */
    sps_image image = {.rgba = rgba};

    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;
    if (print_plan(context, &scene, &view) || sps_render(context, &scene, &view, &image))
        return puts(sps_error(context)), 1;
    print_stats(context);
    sps_destroy(context);

    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "1_blob.png", rgba, WIDTH, HEIGHT, &error)) return puts(error.text), 1;
    return 0;
}
