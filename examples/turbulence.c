/* A cloud in the sun: a procedural gas, merged from puffs and eroded by turbulence. The simplest of the scene programs. */

#include "densities.h"
#include "scene.h"
#include "scene_program.h"

/* sps_volume.eval_fn: five merged puffs, flat at the bottom. Turbulence erodes their edges. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    static const double puffs[5][4] = {{0.05, 0.20, 0.0, 0.95},
                                       {-0.85, -0.10, 0.15, 0.70},
                                       {0.80, -0.05, 0.05, 0.75},
                                       {-0.35, 0.0, 0.45, 0.70},
                                       {0.42, -0.15, 0.45, 0.66}};
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        double merged = 0; /* a smooth maximum of the depths of p in each puff, which makes no creases */
        for (int k = 0; k < 5; ++k)
            merged += exp(
                10 * (puffs[k][3] - ex_vec_length(ex_vec_sub(p, ex_vec_of(puffs[k][0], puffs[k][1], puffs[k][2])))));
        double depth = log(merged) / 10;
        depth -= 0.5 * ex_ramp(-0.35, -0.75, p.y);
        out[i] = 0;
        if (depth < -0.12) continue;
        depth += 0.14 - 0.72 * ex_turbulence(ex_vec_scale(p, 1.6), 6);
        out[i] = (float)ex_ramp(-0.02, 0.22, depth);
    }
    return 0;
}

static void set_cloud(sps_volume *cloud) {
    static const sps_lobe lobes[2] = {{0.6f, 0.6f}, {-0.3f, 0.4f}};
    ex_volume_box(cloud, ex_vec_of(-1.75, -0.95, -1.1), ex_vec_of(1.75, 1.15, 1.25), 176);
    cloud->eval_fn = cloud_value, cloud->concurrent = 1;
    cloud->extinction = 10;
    ex_color(cloud->albedo, 0.99, 0.99, 0.99);
    cloud->lobes = lobes, cloud->lobe_count = 2;
}

int main(int argc, char **argv) {
    static float sky[2][3] = {{0.36f, 0.47f, 0.60f}, {0.08f, 0.17f, 0.36f}};
    const sps_light sun = ex_sun(ex_vec_of(0.7, -1.0, -0.55), 20);
    const sps_view view = ex_view(ex_vec_of(0.3, -0.5, 6.5), ex_vec_of(0, 0, 0), 28);
    sps_scene scene = ex_scene(&sun);
    sps_volume cloud = {0};
    set_cloud(&cloud);
    scene.volumes = &cloud, scene.volume_count = 1;
    ex_color(scene.ambient, 0.15, 0.18, 0.24);
    scene.background_user = sky;
    return ex_scene_program(argc, argv, "turbulence.png", &scene, &view, EX_SAMPLE_EDGES);
}
