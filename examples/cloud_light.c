/* A cloud, with light scattered once, forward any number of times, with and without spreading sideways, in every
   direction (SPS_SCATTERING_MULTIPLE), and by random paths (sps_reference), from left to right, with the time of each.
   Above, the sun is behind the cloud and aside; below, it sets, and the sky is the greater part of the light. */

#include "densities.h"
#include "scene.h"
#include "ways.h"

enum { BEHIND = 0, SUNSET, ROWS };

/* sps_volume.eval_fn: a heap of puffs with a flat base. Turbulence makes lumps of their surface. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    static const double puffs[7][4] = {{-0.10, 0.30, 0.0, 0.52},  {-0.75, -0.02, 0.10, 0.42}, {0.68, 0.02, -0.05, 0.46},
                                       {0.22, -0.10, 0.40, 0.40}, {-0.38, -0.12, 0.38, 0.38}, {0.10, 0.62, -0.05, 0.33},
                                       {1.08, -0.18, 0.05, 0.26}};
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        double merged = 0; /* a smooth maximum of the depths of p in each puff */
        for (int k = 0; k < 7; ++k)
            merged += exp(
                14 * (puffs[k][3] - ex_vec_length(ex_vec_sub(p, ex_vec_of(puffs[k][0], puffs[k][1], puffs[k][2])))));
        const double depth = log(merged) / 14 - 0.6 * ex_ramp(-0.22, -0.5, p.y);
        out[i] = 0;
        if (depth < -0.05) continue;
        out[i] = (float)ex_ramp(0, 0.12, depth + 0.10 - 0.42 * ex_turbulence(ex_vec_scale(p, 2.2), 5));
    }
    return 0;
}

static void set_cloud(sps_volume *cloud) {
    static const sps_lobe lobes[2] = {{0.8f, 0.85f}, {-0.1f, 0.15f}};
    ex_volume_box(cloud, ex_vec_of(-1.25, -0.55, -0.65), ex_vec_of(1.4, 1.0, 0.85), 112);
    cloud->eval_fn = cloud_value, cloud->concurrent = 1;
    cloud->revision = 1; /* all panels have the same voxels */
    cloud->extinction = 24;
    ex_color(cloud->albedo, 1, 1, 1);
    cloud->lobes = lobes, cloud->lobe_count = 2;
}

int main(int argc, char **argv) {
    static float night[2][3] = {{0.030f, 0.050f, 0.105f}, {0.008f, 0.016f, 0.045f}};
    static float evening[2][3] = {{0.50f, 0.22f, 0.10f}, {0.06f, 0.09f, 0.20f}};
    static const char *const names[ROWS] = {"sun behind", "sunset"};
    sps_light suns[ROWS] = {ex_sun(ex_vec_of(-0.5, -0.5, 0.9), 5), ex_sun(ex_vec_of(1, -0.12, -0.35), 5)};
    sps_view view = ex_view(ex_vec_of(0.1, 0.1, 6.5), ex_vec_of(0.07, 0.14, 0), 17);
    sps_scene scenes[ROWS];
    sps_volume cloud = {0};
    view.width = 200, view.height = 140, view.quality = SPS_QUALITY_MEDIUM;
    set_cloud(&cloud);
    ex_color(suns[SUNSET].color, 5.5, 2.0, 0.6);
    for (int i = 0; i < ROWS; ++i) {
        scenes[i] = ex_scene(&suns[i]);
        scenes[i].volumes = &cloud, scenes[i].volume_count = 1;
        scenes[i].background_user = i == BEHIND ? night : evening;
    }
    ex_color(scenes[BEHIND].ambient, 0.012, 0.02, 0.045);
    ex_color(scenes[SUNSET].ambient, 0.08, 0.12, 0.21);
    const ex_ways ways = {scenes, ROWS, names, {.step = 4, .samples = 96, .seed = 1}, 50};
    return ex_ways_program(argc, argv, "cloud_light.png", &ways, &view);
}
