#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"
#include <math.h>
#include <stdio.h>
static int blob(void *user, size_t count, const double *xyz, float *density) {
    for (size_t i = 0; i < count; ++i, xyz += 3)
        density[i] = (float)exp(-16 * (xyz[0] * xyz[0] + xyz[1] * xyz[1] + xyz[2] * xyz[2]));
    return user != NULL;
}
int main(void) {
    static float rgba[256 * 256 * 4];
    sps_volume gas = {0, {64, 64, 64}, {{-1, -1, -1}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}}};
    sps_light sun = {0, SPS_LIGHT_DIRECTIONAL, {1, -1, -1}, {0, 0, 0}, {9, 8, 7}};
    gas.eval_fn = blob, gas.extinction = 6;
    gas.albedo[0] = 0.7f, gas.albedo[1] = 0.8f, gas.albedo[2] = 0.9f;
    sps_scene scene = {0, &gas, 1, NULL, 0, &sun, 1};
    sps_view view = {0, 256, 256, {{0, 0, 4}, {0, 0, 0}, {0, 1, 0}, 0.6}};
    sps_image image = {rgba};
    sps_context *context = sps_create(NULL, NULL);
    if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
    printf("P3 256 256 255\n");
    for (int i = 0; i < 256 * 256 * 4; ++i)
        if (i % 4 != 3) printf("%d ", (int)(255 * pow(fmin(rgba[i], 1), 1 / 2.2)));
    return sps_destroy(context), 0;
}
