/* cascades.h: transmittance maps of a sun, one behind the other along the view, so that texels are small near the eye.
   Each map's depth range holds only the ground that the view shows there. Clouds before that range count in full. */

#ifndef EX_CASCADES_H
#define EX_CASCADES_H

#include "vectors.h"

enum { EX_CASCADES = 4 };

/* A view in perspective: what its pixels see of ground between two heights. */
typedef struct ex_outlook {
    ex_vec position, forward, right, up; /* the last three: unit vectors */
    double tangent[2];                   /* half the view's width and height at distance 1 */
    double heights[2];                   /* lowest and highest ground */
} ex_outlook;

typedef struct ex_cascades {
    double ends[EX_CASCADES + 1]; /* distances from the eye along its axis */
    sps_tmap *maps[EX_CASCADES];
} ex_cascades;

/* The eight corners of a box about the ground that is seen from `from` to `to`. */
static inline void ex_outlook_corners(const ex_outlook *outlook, double from, double to, ex_vec corners[8]) {
    ex_vec low = ex_vec_of(HUGE_VAL, outlook->heights[0], HUGE_VAL);
    ex_vec high = ex_vec_of(-HUGE_VAL, outlook->heights[1], -HUGE_VAL);
    for (int i = 0; i < 8; ++i) {
        const double distance = i & 1 ? to : from, side = (i & 2 ? 1 : -1) * outlook->tangent[0];
        const double rise = (i & 4 ? 1 : -1) * outlook->tangent[1];
        const ex_vec across = ex_vec_add(ex_vec_scale(outlook->right, side), ex_vec_scale(outlook->up, rise));
        const ex_vec way = ex_vec_scale(ex_vec_add(outlook->forward, across), distance);
        const ex_vec p = ex_vec_add(outlook->position, way);
        low.x = fmin(low.x, p.x), low.z = fmin(low.z, p.z);
        high.x = fmax(high.x, p.x), high.z = fmax(high.z, p.z);
    }
    for (int i = 0; i < 8; ++i)
        corners[i] = ex_vec_of(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
}

/* Aims a square view along the sun's direction at these corners, with a texel to spare on each side. The view begins
   where the first of the ground may lie. */
static inline void ex_cascade_aim(const ex_vec corners[8], ex_vec sun, int texels, sps_tmap_light *light,
                                  sps_tmap_settings *settings) {
    const ex_vec right = ex_vec_perpendicular(sun), up = ex_vec_cross(right, sun);
    const ex_vec axes[3] = {right, up, sun};
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (int i = 0; i < 8; ++i)
        for (int k = 0; k < 3; ++k) {
            low[k] = fmin(low[k], ex_vec_dot(axes[k], corners[i]));
            high[k] = fmax(high[k], ex_vec_dot(axes[k], corners[i]));
        }
    const double side = fmax(high[0] - low[0], high[1] - low[1]) * texels / (texels - 2);
    const ex_vec middle =
        ex_vec_add(ex_vec_scale(right, 0.5 * (low[0] + high[0])), ex_vec_scale(up, 0.5 * (low[1] + high[1])));
    const ex_vec from = ex_vec_add(middle, ex_vec_scale(sun, low[2])), to = ex_vec_add(from, sun);
    memset(light, 0, sizeof *light);
    light->width = light->height = texels;
    light->camera.ortho_height = side;
    const ex_vec vectors[3] = {from, to, up};
    double *const fields[3] = {light->camera.position, light->camera.target, light->camera.up};
    for (int i = 0; i < 3; ++i) fields[i][0] = vectors[i].x, fields[i][1] = vectors[i].y, fields[i][2] = vectors[i].z;
    memset(settings, 0, sizeof *settings);
    settings->far_depth = high[2] - low[2];
}

static inline void ex_cascades_destroy(ex_cascades *cascades) {
    for (int i = 0; i < EX_CASCADES; ++i) sps_tmap_destroy(cascades->maps[i]);
    memset(cascades, 0, sizeof *cascades);
}

/* Makes the maps of a scene from `first` to `last`. The caller destroys them, if this fails, too. */
static inline sps_result ex_cascades_make(sps_context *context, const sps_scene *scene, const ex_outlook *outlook,
                                          ex_vec sun, const double range[2], int texels, ex_cascades *cascades) {
    memset(cascades, 0, sizeof *cascades);
    for (int i = 0; i <= EX_CASCADES; ++i) /* each cascade is as many times as long as the one before it */
        cascades->ends[i] = range[0] * pow(range[1] / range[0], (double)i / EX_CASCADES);
    for (int i = 0; i < EX_CASCADES; ++i) {
        ex_vec corners[8];
        sps_tmap_light light;
        sps_tmap_settings settings;
        ex_outlook_corners(outlook, cascades->ends[i], cascades->ends[i + 1], corners);
        ex_cascade_aim(corners, sun, texels, &light, &settings);
        sps_result result = sps_tmap_create(context, &light, &settings, &cascades->maps[i]);
        if (result == SPS_OK) result = sps_tmap_add(cascades->maps[i], scene);
        if (result == SPS_OK) result = sps_tmap_finish(cascades->maps[i]);
        if (result != SPS_OK) return result;
    }
    return SPS_OK;
}

/* The map for a distance from the eye along its axis; the nearest one for those outside. */
static inline int ex_cascades_find(const ex_cascades *cascades, double distance) {
    int i = 0;
    while (i < EX_CASCADES - 1 && distance >= cascades->ends[i + 1]) ++i;
    return i;
}

#endif /* EX_CASCADES_H */
