/* scene.h: the sun, the backdrop and the camera of the scene programs. */

#ifndef EX_SCENE_H
#define EX_SCENE_H

#include "vectors.h"

/* A warm light that travels along `direction`. */
static inline sps_light ex_sun(ex_vec direction, double strength) {
    sps_light sun;
    memset(&sun, 0, sizeof sun);
    sun.kind = SPS_LIGHT_DIRECTIONAL;
    sun.direction[0] = direction.x, sun.direction[1] = direction.y, sun.direction[2] = direction.z;
    ex_color(sun.color, strength, 0.92 * strength, 0.78 * strength);
    return sun;
}

/* sps_scene.background_fn: `user` holds two colors, one for below and one for above. */
static inline int ex_backdrop(void *user, size_t count, const float *directions, float *out_rgb) {
    const float(*ends)[3] = (const float(*)[3])user;
    for (size_t i = 0; i < count; ++i) {
        const double t = ex_ramp(-0.8, 0.3, (double)directions[3 * i + 1]);
        for (int c = 0; c < 3; ++c)
            out_rgb[3 * i + (size_t)c] = (float)ex_mix((double)ends[0][c], (double)ends[1][c], t);
    }
    return 0;
}

/* An empty scene under the sun, which it borrows, with weak bluish ambient light before a gray backdrop. */
static inline sps_scene ex_scene(const sps_light *sun) {
    static float gray[2][3] = {{0.34f, 0.36f, 0.38f}, {0.11f, 0.14f, 0.19f}};
    sps_scene scene;
    memset(&scene, 0, sizeof scene);
    scene.lights = sun, scene.light_count = 1;
    ex_color(scene.ambient, 0.13, 0.15, 0.18);
    scene.background_fn = ex_backdrop, scene.background_user = gray;
    return scene;
}

/* `degrees` is the vertical field of view. */
static inline sps_camera ex_camera_at(ex_vec position, ex_vec target, double degrees) {
    sps_camera camera;
    memset(&camera, 0, sizeof camera);
    camera.position[0] = position.x, camera.position[1] = position.y, camera.position[2] = position.z;
    camera.target[0] = target.x, camera.target[1] = target.y, camera.target[2] = target.z;
    camera.up[1] = 1;
    camera.field_of_view = degrees * EX_PI / 180;
    return camera;
}

/* The view of a picture of 480 x 360 at high quality. Light scatters once: these pictures are about something else, and
   ways.h sets what it compares. */
static inline sps_view ex_view(ex_vec position, ex_vec target, double degrees) {
    sps_view view;
    memset(&view, 0, sizeof view);
    view.camera = ex_camera_at(position, target, degrees);
    view.width = 480, view.height = 360;
    view.quality = SPS_QUALITY_HIGH;
    view.scattering = SPS_SCATTERING_SINGLE;
    return view;
}

#endif /* EX_SCENE_H */
