/* Two puffs of smoke over level ground, 2500 particles each: one fresh, one carried away by the wind. They shade each
   other and the ground by a Fourier opacity map of 15 components. */

#include "puff.h"
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { PARTICLES = 2 * EX_PUFF_PARTICLES };

/* One puff that has just risen, and one that has drifted for a while. */
static void fill_puffs(sps_particle *particles) {
    const ex_puff fresh = {{-1.15, 1.05, 0.2}, 1.0, 0.09, 0.24, 0.13, 4},
                  old = {{-1.5, 1.15, -0.2}, 1.0, 0.10, 0.25, 0.08, 9};
    const ex_wind wind = {{1.15, 0.03, 0.05}, 0, 1, 0.25, 1.1, 0.26, 5};
    ex_puff_fill(&fresh, EX_PUFF_PARTICLES, particles);
    ex_puff_fill(&old, EX_PUFF_PARTICLES, particles + EX_PUFF_PARTICLES);
    ex_puff_blow(&wind, 2.2, 40, EX_PUFF_PARTICLES, particles + EX_PUFF_PARTICLES);
}

static void set_smoke(sps_particles *smoke, sps_particle *particles) {
    static const sps_lobe lobes[2] = {{0.45f, 0.7f}, {-0.25f, 0.3f}};
    smoke->count = PARTICLES, smoke->read_fn = ex_particles_read, smoke->user = particles;
    smoke->soft = 1;
    ex_color(smoke->albedo, 0.93, 0.91, 0.89);
    smoke->lobes = lobes, smoke->lobe_count = 2;
}

int main(int argc, char **argv) {
    static sps_particle particles[PARTICLES];
    static const float earth[3] = {0.115f, 0.105f, 0.08f};
    const sps_view view = ex_view(ex_vec_of(0.6, 2.6, 7.8), ex_vec_of(0.3, 0.75, 0), 29);
    sps_light sun = ex_sun(ex_vec_of(0.9, -1.3, -0.35), 13);
    sps_scene scene = ex_scene(&sun);
    sps_tmap_settings map = {0};
    sps_particles smoke = {0};
    ex_mesh ground = {0};
    fill_puffs(particles);
    set_smoke(&smoke, particles);
    ex_shape_quad(&ground, ex_vec_of(-30, 0, -30), ex_vec_of(-30, 0, 10), ex_vec_of(30, 0, 10), ex_vec_of(30, 0, -30),
                  earth);
    const sps_mesh mesh = ex_shape_mesh(&ground);
    map.technique = SPS_TMAP_FOURIER, map.components = 15;
    sun.shadow_map = &map, sun.shadow_map_resolution = 512;
    scene.particles = &smoke, scene.particle_set_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    ex_color(scene.ambient, 0.16, 0.20, 0.27);
    const int status = ex_scene_program(argc, argv, "puff.png", &scene, &view, EX_SAMPLE_EDGES);
    ex_mesh_free(&ground);
    return status;
}
