/* A scene that uses everything, and the calls that tests repeat with it. */

#ifndef MIXED_SCENE_H
#define MIXED_SCENE_H

#include "check.h"

/* ------------------------------------------------------------------------------------- a scene that uses everything */

enum { WIDTH = 75, HEIGHT = 71, PIXELS = WIDTH * HEIGHT, FLOATS = 5 * PIXELS }; /* odd, with 2 x 2 tiles */

enum { SMALL_WIDTH = 21, SMALL_HEIGHT = 13 }; /* for scenes that are rendered hundreds of times */

enum { IMAGE_ROWS = 5 };

typedef enum called { RANGE, READ, EVAL, TRIANGLES, BACKGROUND, TRANSFER, SHADE, IMAGE, CALLED_COUNT } called;

/* A gas by read_fn and range_fn, a classified volume by eval_fn and a transfer callback, a mesh, another one with a
   shade_fn, a background callback, a light along the view and one against it, which throws an image, so that both
   compositing orders run. Counts its callbacks, and fails one. */
typedef struct mixed {
    check_scene s;
    sps_transfer transfer;
    check_triangles triangles;
    sps_projector projector;
    long calls, fail_at; /* of all callbacks together, counted from 1 */
    long of[CALLED_COUNT];
    double threshold; /* below which the transfer function shows nothing */
} mixed;

static inline int called_now(mixed *m, called which) {
    m->of[which] += 1;
    return ++m->calls == m->fail_at;
}

static inline int mixed_range(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)lo;
    (void)size;
    out[0] = 0;
    out[1] = 1;
    return called_now((mixed *)user, RANGE);
}

static inline int mixed_read(void *user, const int lo[3], const int size[3], float *out) {
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) {
                const int x = lo[0] + i, y = lo[1] + j, z = lo[2] + k;
                *out++ = (float)((x * 7 + y * 3 + z * 5) % 11) / 11;
            }
    return called_now((mixed *)user, READ);
}

/* An off-centre blob. */
static inline int mixed_eval(void *user, size_t count, const double *p, float *out) {
    for (size_t i = 0; i < count; ++i, p += 3)
        out[i] = (float)exp(-6 * ((p[0] - 0.2) * (p[0] - 0.2) + p[1] * p[1] + (p[2] + 0.1) * (p[2] + 0.1)));
    return called_now((mixed *)user, EVAL);
}

static inline int mixed_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    mixed *m = (mixed *)user;
    for (size_t i = 0; i < count; ++i) {
        check_color(out[i].albedo, 0.9, 0.5 * (double)values[i], 0.3);
        out[i].extinction = (double)values[i] > m->threshold ? 9 : 0;
    }
    return called_now(m, TRANSFER);
}

static inline int mixed_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    mixed *m = (mixed *)user;
    memcpy(out, m->triangles.list + first, count * sizeof *out);
    return called_now(m, TRIANGLES);
}

static inline int mixed_background(void *user, size_t count, const float *directions, float *rgb) {
    for (size_t i = 0; i < count; ++i)
        check_color(rgb + 3 * i, 0.2, 0.3, 0.4 + 0.1 * fabs((double)directions[3 * i + 1]));
    return called_now((mixed *)user, BACKGROUND);
}

static inline int mixed_image(void *user, size_t count, const float *uv, float *rgb) {
    for (size_t i = 0; i < count; ++i, uv += 2, rgb += 3) check_color(rgb, (double)uv[0], (double)uv[1], 0.5);
    return called_now((mixed *)user, IMAGE);
}

/* A light against the view, whose image reaches beyond the scene on one side. */
static inline void mixed_add_projector(mixed *m) {
    sps_light *light = check_add_point(&m->s, -1, 3, -5, 30);
    check_set3(light->direction, 1, -3, 5);
    light->projector = &m->projector;
    m->projector.width = 6;
    m->projector.height = IMAGE_ROWS;
    m->projector.sample_fn = mixed_image;
    m->projector.user = m;
    m->projector.left = m->projector.bottom = -0.3;
    m->projector.right = m->projector.top = 0.1;
}

static inline void mixed_add_volumes(mixed *m) {
    sps_volume *gas = check_add_volume(&m->s, 11, 9, 13, check_box(-0.9, -0.6, -0.8, 0.5, 0.5, 0.7));
    sps_volume *solid = check_add_volume(&m->s, 9, 10, 8, check_box(-0.6, -0.7, -0.7, 0.9, 0.6, 0.6));
    gas->read_fn = mixed_read;
    gas->range_fn = mixed_range;
    gas->extinction = 0.8f;
    gas->placement.axis[0][1] = 0.2; /* sheared */
    check_color(gas->albedo, 0.6, 0.8, 0.9);
    check_color(gas->emission, 0.1, 0, 0.05);
    solid->eval_fn = mixed_eval;
    solid->transfer = &m->transfer;
    solid->shading = SPS_SHADING_SURFACE;
    solid->specular = 0.4f;
    gas->user = solid->user = m;
}

static inline void mixed_add_mesh(mixed *m) {
    const double origin[3] = {-1, -0.5, 0.1}, u[3] = {1.9, 0.1, 0}, v[3] = {0.2, 0.7, -0.6};
    const double u_small[3] = {0.1, 0, 0}, v_small[3] = {0, 0.07, 0.03};
    sps_mesh *mesh;
    check_add_quad(&m->triangles, origin, u, v);
    for (int i = 0; i < 149; ++i) { /* two batches of triangles */
        const double at[3] = {-0.9 + 0.15 * (i % 13), -0.8 + 0.12 * (i / 13), 0.02 * (i % 7)};
        check_add_quad(&m->triangles, at, u_small, v_small);
    }
    mesh = check_add_mesh(&m->s, &m->triangles, 0.7);
    mesh->read_fn = mixed_triangles;
    mesh->user = m;
}

static inline int mixed_shade(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    for (size_t i = 0; i < count; ++i) {
        const double wave = 0.5 + 0.4 * sin(20 * points[i].uv[0]) * sin(20 * points[i].uv[1]);
        check_color(out[i].albedo, wave, 0.5, 1 - wave);
        check_color(out[i].emission, 0, 0.1 * wave, 0);
    }
    return called_now((mixed *)user, SHADE);
}

/* Half of the triangles of the other mesh, moved. */
static inline void mixed_add_textured_mesh(mixed *m) {
    sps_mesh *mesh = check_add_mesh(&m->s, &m->triangles, 0.6);
    for (size_t i = 0; i < 6 * m->triangles.count; ++i)
        m->triangles.list[i / 6].uv[i / 2 % 3][i % 2] = m->triangles.list[i / 6].position[i / 2 % 3][i % 2];
    mesh->triangle_count = m->triangles.count / 2;
    mesh->read_fn = mixed_triangles;
    mesh->shade_fn = mixed_shade;
    mesh->user = mesh->shade_user = m;
    mesh->placement = check_box(0.3, -0.2, 0.35, 1.2, 0.8, 1.35);
}

static inline void mixed_build(mixed *m) {
    memset(m, 0, sizeof *m);
    check_clear(&m->s, WIDTH, HEIGHT);
    check_set3(m->s.view.camera.position, 0.4, 0.5, 4);
    check_perspective(&m->s.view.camera, 0.6);
    m->s.view.shadow_resolution = 60;
    m->s.view.scattering = SPS_SCATTERING_FORWARD;
    m->threshold = 0.3;
    m->transfer.eval_fn = mixed_transfer;
    m->transfer.user = m;
    mixed_add_volumes(m);
    mixed_add_mesh(m);
    mixed_add_textured_mesh(m);
    check_add_directional(&m->s, 0.5, -0.6, -1, 2);
    mixed_add_projector(m);
    check_color(m->s.scene.ambient, 0.1, 0.12, 0.15);
    m->s.scene.background_fn = mixed_background;
    m->s.scene.background_user = m;
}

static inline void mixed_build_small(mixed *m) {
    mixed_build(m);
    m->s.view.width = SMALL_WIDTH;
    m->s.view.height = SMALL_HEIGHT;
    m->s.view.quality = SPS_QUALITY_DRAFT;
}

static inline void mixed_free(mixed *m) { check_free_triangles(&m->triangles); }

/* The calls that tests repeat. A plan has no image; the bytes of its report take its place. */
typedef enum kind { RENDER, REFERENCE, PLAN, KINDS } kind;

static const char *const kind_names[KINDS] = {"render", "reference", "plan"};

static inline sps_result run(sps_context *context, const mixed *m, kind which, float *pixels) {
    sps_plan_report report;
    sps_image image;
    sps_result result;
    memset(&image, 0, sizeof image);
    image.rgba = pixels;
    image.depth = pixels + 4 * PIXELS;
    if (which == RENDER) return sps_render(context, &m->s.scene, &m->s.view, &image);
    if (which == REFERENCE) return check_reference(context, &m->s.scene, &m->s.view, 4, &image);
    result = sps_plan(context, &m->s.scene, &m->s.view, &report);
    if (result == SPS_OK) pixels[0] = (float)report.read_calls + 100 * (float)report.slab_count;
    return result;
}

static inline void fill(float *pixels) {
    for (int i = 0; i < FLOATS; ++i) pixels[i] = (float)(-1 - i);
}

static inline int untouched(const float *pixels) {
    for (int i = 0; i < FLOATS; ++i)
        if (!(pixels[i] == (float)(-1 - i))) return 0;
    return 1;
}

static inline int same(const float *a, const float *b) { return memcmp(a, b, FLOATS * sizeof(float)) == 0; }

/* The result of a fresh context without hooks. */
static inline void run_fresh(const mixed *m, kind which, float *pixels) {
    sps_context *context = check_context(NULL);
    fill(pixels);
    CHECK_OK(context, run(context, m, which, pixels));
    sps_destroy(context);
}

static inline size_t bytes_held(const sps_context *context) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    return stats.bytes;
}

/* --------------------------------------------------------------------------------------------------------- failures */

static float pixels_after[FLOATS], pixels_fresh[FLOATS];

/* ----------------------------------------------------------------------------------------------------------- memory */

/* Makes change number n to the scene; returns 0 if there are no more. */
static inline int vary(mixed *m, int variant) {
    sps_view *view = &m->s.view;
    switch (variant) {
    case 0: return 1;
    case 1: m->s.scene.mesh_count = 0; return 1;
    case 2: m->s.scene.volume_count = 0; return 1;
    case 3: m->s.scene.light_count = 0; return 1;
    case 4: m->s.scene.volume_count = 1; return 1;
    case 5: view->quality = SPS_QUALITY_ULTRA; return 1;
    case 6: view->quality = SPS_QUALITY_DRAFT; return 1;
    case 7: view->shadow_resolution = 0; return 1;
    case 8: view->shadow_resolution = 1; return 1;
    case 9: check_orthographic(&view->camera, 3); return 1;
    case 10: view->region[0] = 9, view->region[1] = 5, view->region[2] = 7, view->region[3] = 5; return 1;
    case 11: view->no_shadows = 1; return 1;
    case 12: m->s.volume[0].size[0] = 70, m->s.volume[0].size[1] = 37; return 1;
    case 13: m->s.volume[1].size[0] = 33, m->s.volume[1].size[1] = 33, m->s.volume[1].size[2] = 33; return 1;
    case 14:
        m->s.volume[0].size[0] = m->s.volume[0].size[1] = m->s.volume[0].size[2] = 1, m->s.scene.light_count = 1;
        return 1;
    case 15: check_set3(m->s.light[1].position, 3, 0.2, 1.5); return 1;
    case 16: m->s.light[0].no_shadow = 1; return 1;
    case 17: view->slab_thickness = 0.1; return 1;
    case 18: m->s.volume[1].shading = SPS_SHADING_GAS; return 1;
    case 19: m->s.scene.light_count = 1, m->s.scene.volume_count = 0, view->shadow_resolution = 9; return 1;
    case 20: view->slab_thickness = 50; return 1;
    case 21: m->s.scene.volume_count = 0, m->s.light[1].position[2] = 0; return 1; /* six depth maps */
    case 22: view->width = WIDTH, view->height = HEIGHT; return 1;
    case 23: m->s.mesh[1].shade_fn = NULL; return 1;
    case 24: m->s.mesh[0].shade_fn = mixed_shade, m->s.mesh[0].shade_user = m; return 1;
    default: return 0;
    }
}

#endif /* MIXED_SCENE_H */
