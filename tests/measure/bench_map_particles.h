/* bench_map_particles.h: maps of many particles: those of a texel's size against a plain loop, and updates. Times are
   the least of five, taken in turns with one worker. */

#ifndef BENCH_MAP_PARTICLES_H
#define BENCH_MAP_PARTICLES_H

#include "measuring.h"
#include "densities.h"
#include "particles.h"

enum { PLAIN_SIDE = 512, PLAIN_PLANES = 8 };

/* The view of these maps: parallel to z, 2.2 wide, planes from 3.5 to 6.5 in front of a light at z = 5. */
static void plain_view(sps_tmap_light *light, sps_tmap_settings *settings) {
    memset(light, 0, sizeof *light), memset(settings, 0, sizeof *settings);
    light->width = light->height = PLAIN_SIDE;
    light->camera.position[2] = 5, light->camera.up[1] = 1, light->camera.ortho_height = 2.2;
    settings->technique = SPS_TMAP_OPACITY, settings->near_depth = 3.5, settings->far_depth = 6.5;
}

static sps_particle *plain_particles(size_t count, double radius, uint32_t seed) {
    sps_particle *list = (sps_particle *)ex_allocate(count, sizeof *list);
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) list[i].position[k] = (float)(2 * ex_random(&seed) - 1);
        list[i].radius = (float)(radius * (0.5 + ex_random(&seed)));
        list[i].optical_depth = 0.01f;
    }
    return list;
}

/* One chord into a texel's planes. */
static void plain_insert(float *texel, float u0, float u1, float depth) {
    const int first = (int)fmaxf(u0 * PLAIN_PLANES, 0), last = (int)fminf(u1 * PLAIN_PLANES, PLAIN_PLANES - 1);
    float before = 0;
    for (int k = first; k <= last; ++k) {
        const float share = k < last ? ((float)(k + 1) / PLAIN_PLANES - u0) / (u1 - u0) : 1;
        texel[k] += depth * (share - before);
        before = share;
    }
}

/* What one would write: for each particle, for each texel of its box. Particles between texels' centres are lost. */
static void plain_map(const sps_particle *list, size_t count, float *map) {
    const float pixel = 2.2f / PLAIN_SIDE, last = PLAIN_SIDE - 1;
    memset(map, 0, sizeof(float) * PLAIN_SIDE * PLAIN_SIDE * PLAIN_PLANES);
    for (size_t i = 0; i < count; ++i) {
        const float r = list[i].radius, t = 1.5f - list[i].position[2];
        const float x = (list[i].position[0] + 1.1f) / pixel - 0.5f, y = (1.1f - list[i].position[1]) / pixel - 0.5f;
        const int x0 = (int)ceilf(fmaxf(x - r / pixel, 0)), x1 = (int)floorf(fminf(x + r / pixel, last));
        const int y0 = (int)ceilf(fmaxf(y - r / pixel, 0)), y1 = (int)floorf(fminf(y + r / pixel, last));
        for (int row = y0; row <= y1; ++row)
            for (int column = x0; column <= x1; ++column) {
                const float dx = ((float)column - x) * pixel, dy = ((float)row - y) * pixel;
                const float square = r * r - dx * dx - dy * dy, half = square > 0 ? sqrtf(square) : 0;
                if (half > 0)
                    plain_insert(map + ((size_t)row * PLAIN_SIDE + (size_t)column) * PLAIN_PLANES, (t - half) / 3,
                                 (t + half) / 3, 0.01f * half / r);
            }
    }
    for (size_t i = 0; i < PLAIN_SIDE * PLAIN_SIDE; ++i)
        for (size_t k = 1; k < PLAIN_PLANES; ++k) map[i * PLAIN_PLANES + k] += map[i * PLAIN_PLANES + k - 1];
}

/* The library's time over the plain loop's. */
static double small_particles_ratio(const ex_session *session, const char *program, double radius) {
    enum { COUNT = 1000000 };
    sps_particle *list = plain_particles(COUNT, radius, 1);
    float *map = (float *)ex_allocate((size_t)PLAIN_SIDE * PLAIN_SIDE * PLAIN_PLANES, sizeof(float));
    const sps_particles particles = {.count = COUNT, .read_fn = ex_particles_read, .user = list};
    const sps_scene scene = {.particles = &particles, .particle_set_count = 1};
    double own = HUGE_VAL, plainly = HUGE_VAL;
    sps_tmap_light light;
    sps_tmap_settings settings;
    plain_view(&light, &settings);
    for (int turn = 0; turn < 5; ++turn) {
        const double start = ex_now(NULL);
        sps_tmap_destroy(ex_tmap_build(session, program, &light, &settings, &scene));
        const double middle = ex_now(NULL);
        plain_map(list, COUNT, map);
        own = fmin(own, middle - start), plainly = fmin(plainly, ex_now(NULL) - middle);
    }
    free(list), free(map);
    return own / plainly;
}

/* The time to replace 5 % of the particles over that of a map made anew. */
static double update_ratio(const ex_session *session, const char *program, sps_tmap_technique technique) {
    enum { COUNT = 100000 };
    sps_particle *list = plain_particles(COUNT, 0.03, 1), *others = plain_particles(COUNT / 20, 0.03, 2);
    const sps_particles all = {.count = COUNT, .read_fn = ex_particles_read, .user = list};
    const sps_particles some[2] = {{.count = COUNT / 20, .read_fn = ex_particles_read, .user = list},
                                   {.count = COUNT / 20, .read_fn = ex_particles_read, .user = others}};
    const sps_scene scene = {.particles = &all, .particle_set_count = 1};
    const sps_scene parts[2] = {{.particles = &some[0], .particle_set_count = 1},
                                {.particles = &some[1], .particle_set_count = 1}};
    double anew = HUGE_VAL, update = HUGE_VAL;
    sps_tmap_light light;
    sps_tmap_settings settings;
    plain_view(&light, &settings);
    settings.technique = technique;
    for (int turn = 0; turn < 5; ++turn) {
        const double start = ex_now(NULL);
        sps_tmap *map = ex_tmap_build(session, program, &light, &settings, &scene);
        const double made = ex_now(NULL);
        ex_stop_unless_ok(sps_tmap_update(map, &parts[0], &parts[1]), program, session);
        anew = fmin(anew, made - start), update = fmin(update, ex_now(NULL) - made);
        sps_tmap_destroy(map);
    }
    free(list), free(others);
    return update / anew;
}

#endif /* BENCH_MAP_PARTICLES_H */
