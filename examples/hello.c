#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"
#include <math.h>
#include <stdio.h>
static int blob(void *user, size_t count, const double *xyz, float *density) {
    for (size_t i = 0; i < count; ++i, xyz += 3)
        density[i] = (float)exp(-16 * (xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2]));
    return (void)user, 0;
}
int main(void) {
    static const float corners[] = {-9, -0.8f, 5, 9, -0.8f, 5, 9, -0.8f, -9, -9, -0.8f, -9};
    static const uint16_t indices[] = {0, 1, 2, 0, 2, 3};
    static float rgba[256 * 256 * 4];
    sps_volume gas = {.size = {64, 64, 64}, .placement = {{-1, -1, -1}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}},
                      .eval_fn = blob, .extinction = 6, .albedo = {0.7f, 0.8f, 0.9f}};
    sps_indexed_mesh net = {.vertex_count = 4, .positions = corners, .triangle_count = 2, .indices_u16 = indices};
    sps_mesh mesh = {.triangle_count = 2, .read_fn = sps_indexed_mesh_read, .user = &net, .albedo = {.3, .3, .2}};
    sps_light sun = {.direction = {1, -1, -0.5}, .color = {9, 8, 7}};
    sps_scene scene = {.volumes = &gas, .volume_count = 1, .meshes = &mesh, .mesh_count = 1, .lights = &sun,
                       .light_count = 1, .background = {0.1f, 0.2f, 0.4f}};
    sps_camera camera = {.position = {0, 1.2, 4}, .up = {0, 1, 0}, .field_of_view = 0.6};
    sps_view view = {.width = 256, .height = 256, .camera = camera};
    sps_image image = {.rgba = rgba};
    sps_context *context = sps_create(NULL, NULL);
    if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
    printf("P3 256 256 255\n");
    for (int i = 0; i < 256 * 256 * 4; ++i)
        if (i % 4 != 3) printf("%d ", (int)(255 * pow(fmin(rgba[i], 1), 1 / 2.2)));
    return sps_destroy(context), 0;
}
