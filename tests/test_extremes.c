/* Hard cases, each with its required outcome: an error that names the cause, a closed form, the reference by ray
   marching, or the same picture as a simpler scene. */

#include "check.h"
#include <float.h>

enum { SIDE = 17, PIXELS = SIDE * SIDE };

static float rgba[4 * PIXELS], depth[PIXELS], other[4 * PIXELS];
static const double infinite = HUGE_VAL;

static double not_a_number(void) { return infinite - infinite; }

/* ---------------------------------------------------------------------------------------------------------- helpers */

/* Every pixel is finite, not negative, not above `most`, not denormal, with coverage 0..1; distances are above 0. */
static int sane(const float *pixels, int count, double most) {
    for (int i = 0; i < 4 * count; ++i) {
        const double value = (double)pixels[i];
        if (!(value >= 0) || !(value <= (i % 4 == 3 ? 1 : most)) || (value > 0 && value < (double)FLT_MIN)) {
            printf("    pixel %d, channel %d: %g\n", i / 4, i % 4, value);
            return 0;
        }
    }
    return 1;
}

/* Renders in a fresh context, with distances; keeps the result and the sentence. */
static char sentence[256];

static sps_result render_fresh(const check_scene *s, float *pixels) {
    sps_context *context = check_context(NULL);
    sps_image image;
    sps_result result;
    memset(&image, 0, sizeof image);
    image.rgba = pixels;
    image.depth = depth;
    result = sps_render(context, &s->scene, &s->view, &image);
    snprintf(sentence, sizeof sentence, "%s", sps_error(context));
    sps_destroy(context);
    return result;
}

#define RENDERS(s, pixels)                                                                                             \
    do {                                                                                                               \
        if (!CHECK(render_fresh((s), (pixels)) == SPS_OK)) printf("    %s\n", sentence);                               \
    } while (0)

static const float *middle(const float *pixels) { return pixels + 4 * (SIDE / 2 * SIDE + SIDE / 2); }
static double optical_depth(const float *pixel) { return -log1p(-(double)pixel[3]); }

/* The largest difference from the reference, divided by the reference's largest radiance. Under sanitizers, of some
   rows in the middle. */
static double reference_error(const check_scene *s, const float *pixels) {
    const int first = check_memory_only() ? SIDE / 2 : 0, rows = check_memory_only() ? SIDE / 8 : SIDE;
    const size_t count = (size_t)(4 * SIDE * rows);
    sps_context *context = check_context(NULL);
    check_scene part = *s;
    double most = 0;
    part.view.region[1] = first, part.view.region[2] = SIDE, part.view.region[3] = rows;
    check_march(context, &part, 0.5, other, NULL);
    sps_destroy(context);
    for (size_t i = 0; i < count; ++i) most = fmax(most, (double)other[i]);
    return check_largest(pixels + 4 * SIDE * first, other, count) / most;
}

static float one_value = 1;

/* The cube -1..1 of n^3 voxels of value 1, seen along -z: the image covers its middle half. Constant grids are constant
   to 0.2 % at HIGH, so every optical depth below has that error, and so has alpha for optical depths around 1. */
static sps_volume *uniform_build(check_scene *s, int n, double extinction) {
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    s->view.quality = SPS_QUALITY_HIGH;
    volume = check_add_volume(s, n, n, n, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_constant;
    volume->user = &one_value;
    volume->extinction = (float)extinction;
    return volume;
}

/* Values without symmetry. */
static int read_bumps(void *user, const int lo[3], const int size[3], float *out) {
    const double scale = *(const double *)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i)
                *out++ = (float)(scale * ((lo[0] + i) * 7 + (lo[1] + j) * 3 + (lo[2] + k) * 5 + (lo[0] + i) % 4));
    return 0;
}

/* A scene of everything, small: a gas of bumps, a floor, a directional and a point light, perspective. */
typedef struct mixed {
    check_scene s;
    check_triangles triangles;
    sps_transfer transfer;
    sps_transfer_point points[2];
    sps_lobe lobe;
    double bumps, matrix[16];
} mixed;

static void mixed_build(mixed *m) {
    const double origin[3] = {-9, -1.3, -9}, u[3] = {18, 0, 0}, v[3] = {0, 0.5, 15};
    sps_volume *volume;
    memset(m, 0, sizeof *m);
    check_clear(&m->s, SIDE, SIDE);
    check_set3(m->s.view.camera.position, 0.5, 1.1, 5);
    check_perspective(&m->s.view.camera, 0.45);
    m->s.view.shadow_resolution = 60;
    m->bumps = 0.01;
    m->lobe.asymmetry = 0.5f, m->lobe.weight = 1;
    volume = check_add_volume(&m->s, 9, 8, 7, check_box(-0.9, -0.8, -0.7, 0.9, 0.8, 0.7));
    volume->read_fn = read_bumps;
    volume->user = &m->bumps;
    volume->extinction = 1;
    volume->lobes = &m->lobe;
    volume->lobe_count = 1;
    check_color(volume->albedo, 0.6, 0.8, 0.9);
    check_color(volume->emission, 0.1, 0.05, 0);
    check_add_quad(&m->triangles, origin, u, v);
    check_add_mesh(&m->s, &m->triangles, 0.7);
    check_add_directional(&m->s, 0.4, -1, -0.5, 2);
    check_add_point(&m->s, 1, 4, 3, 20);
    check_color(m->s.scene.ambient, 0.1, 0.1, 0.2);
    m->points[0].value = 0.2f, m->points[1].value = 0.9f, m->points[1].extinction = 4;
    check_color(m->points[1].albedo, 0.9, 0.6, 0.3);
    m->transfer.points = m->points;
    m->transfer.point_count = 2;
}

static void mixed_free(mixed *m) { check_free_triangles(&m->triangles); }

/* ------------------------------------------------------------------------------------------- arguments out of range */

/* Sets an enumeration to a number that it does not have. */
static void put_int(void *field, int value) { memcpy(field, &value, sizeof value); }

/* Fields out of range, numbered from 0: each function spoils the n-th and returns the text that the sentence must
   contain, "FIELD is VALUE"; if it has fewer, it decreases n by their number and returns NULL. */
#define SPOIL(statement, text)                                                                                         \
    if ((*n)-- == 0) {                                                                                                 \
        statement;                                                                                                     \
        return text;                                                                                                   \
    }

static const char *spoil_volume(mixed *m, int *n) {
    const float inf_f = (float)infinite, nan_f = (float)not_a_number();
    sps_volume *v = m->s.volume;
    SPOIL(v->start_canary = 1, "volume[0].start_canary is 1;")
    SPOIL(v->end_canary = 1, "volume[0].end_canary is 1;")
    SPOIL(memset(v, 0xa5, sizeof *v), "volume[0].start_canary is 2.7791e+09;") /* pointers are wild, too */
    SPOIL(v->size[0] = -1, "volume[0].size is -1;")
    SPOIL(v->size[2] = 65537, "volume[0].size is 65537;")
    SPOIL(v->crop[1] = -1, "volume[0].crop is -1;")
    SPOIL(v->crop[5] = v->size[2] + 1, "volume[0].crop is ")
    SPOIL(v->crop[0] = 1, "volume[0].crop is 1;") /* above the high face, 0 */
    SPOIL(v->border = -1, "volume[0].border is -1;")
    SPOIL(v->border = 65537, "volume[0].border is 65537;")
    SPOIL(v->range_levels = 4, "volume[0].range_levels is 4;")
    SPOIL(v->range_levels = -1, "volume[0].range_levels is -1;")
    SPOIL(v->placement.origin[1] = not_a_number(), "volume[0].placement.origin[1] is nan;")
    SPOIL(v->placement.axis[1][2] = infinite, "volume[0].placement.axis[1][2] is inf;")
    SPOIL(memcpy(v->placement.axis[1], v->placement.axis[0], 24), "volume[0].placement's determinant is 0;")
    SPOIL(v->eval_fn = check_eval_constant, "volume[0].read_fn and eval_fn are both set;")
    SPOIL(v->read_fn = NULL, "volume[0].read_fn and eval_fn are both NULL;")
    SPOIL(v->extinction = -1, "volume[0].extinction is -1;")
    SPOIL(v->extinction = 2e18f, "volume[0].extinction is 2e+18;")
    SPOIL(v->extinction = nan_f, "volume[0].extinction is nan;")
    SPOIL(v->albedo[0] = 1.5f, "volume[0].albedo is 1.5;")
    SPOIL(v->albedo[1] = -0.5f, "volume[0].albedo is -0.5;")
    SPOIL(v->albedo[2] = 2, "volume[0].albedo is 2;")
    SPOIL(v->albedo[2] = nan_f, "volume[0].albedo is nan;")
    SPOIL(v->emission[0] = -1, "volume[0].emission is -1;")
    SPOIL(v->emission[1] = inf_f, "volume[0].emission is inf;")
    SPOIL(v->lobe_count = -1, "volume[0].lobe_count is -1;")
    SPOIL(v->lobe_count = 9, "volume[0].lobe_count is 9;")
    SPOIL(v->lobes = NULL, "volume[0].lobe_count is 1;")
    SPOIL(m->lobe.asymmetry = 1, "volume[0].lobes[0].asymmetry is 1;")
    SPOIL(m->lobe.asymmetry = nan_f, "volume[0].lobes[0].asymmetry is nan;")
    SPOIL(m->lobe.weight = 0, "volume[0].lobes[0].weight is 0;")
    SPOIL(m->lobe.weight = inf_f, "volume[0].lobes[0].weight is inf;")
    SPOIL(put_int(&v->shading, 2), "volume[0].shading is 2;")
    SPOIL(v->gradient_full = -0.5f, "volume[0].gradient_full is -0.5;")
    SPOIL(v->specular = 1.5f, "volume[0].specular is 1.5;")
    SPOIL(v->shininess = nan_f, "volume[0].shininess is nan;")
    SPOIL(v->shininess = 2e4f, "volume[0].shininess is 20000;")
    SPOIL((v->transfer = &m->transfer, m->transfer.points = NULL),
          "volume[0].transfer.points and eval_fn are both NULL;")
    SPOIL((v->transfer = &m->transfer, m->transfer.point_count = 0), "volume[0].transfer.point_count is 0;")
    SPOIL((v->transfer = &m->transfer, m->points[0].value = 0.9f), "volume[0].transfer.points[1].value is 0.9;")
    SPOIL((v->transfer = &m->transfer, m->points[0].value = -1), "volume[0].transfer.points[0].value is -1;")
    SPOIL((v->transfer = &m->transfer, m->points[1].value = nan_f), "volume[0].transfer.points[1].value is nan;")
    SPOIL((v->transfer = &m->transfer, m->points[1].albedo[1] = 2), "volume[0].transfer.points[1].albedo is 2;")
    SPOIL((v->transfer = &m->transfer, m->points[1].extinction = -2), "volume[0].transfer.points[1].extinction is -2;")
    SPOIL((v->transfer = &m->transfer, m->points[0].extinction = nan_f),
          "volume[0].transfer.points[0].extinction is nan;")
    SPOIL((v->transfer = &m->transfer, m->points[1].extinction = inf_f),
          "volume[0].transfer.points[1].extinction is inf;")
    SPOIL((v->transfer = &m->transfer, m->transfer.value_max = -1), "volume[0].transfer.value_max is -1;")
    return NULL;
}

static const char *spoil_mesh_and_lights(mixed *m, int *n) {
    const double nan = not_a_number();
    sps_light *sun = m->s.light, *lamp = m->s.light + 1;
    sps_mesh *mesh = m->s.mesh;
    SPOIL(mesh->start_canary = 7, "mesh[0].start_canary is 7;")
    SPOIL(mesh->end_canary = 7, "mesh[0].end_canary is 7;")
    SPOIL(memset(mesh, 0xa5, sizeof *mesh), "mesh[0].start_canary is 2.7791e+09;")
    SPOIL(mesh->triangle_count = (size_t)1 << 31, "mesh[0].triangle_count is 2.14748e+09;")
    SPOIL(mesh->read_fn = NULL, "mesh[0].read_fn is NULL;")
    SPOIL(mesh->albedo[0] = 2, "mesh[0].albedo is 2;")
    SPOIL(mesh->albedo[2] = -1, "mesh[0].albedo is -1;")
    SPOIL(mesh->placement.origin[0] = infinite, "mesh[0].placement.origin[0] is inf;")
    SPOIL(mesh->placement.axis[0][0] = 1, "mesh[0].placement's determinant is 0;") /* only one axis: flat */
    SPOIL(lamp->start_canary = 7, "light[1].start_canary is 7;")
    SPOIL(lamp->end_canary = 7, "light[1].end_canary is 7;")
    SPOIL(put_int(&lamp->kind, 4), "light[1].kind is 4;")
    SPOIL(lamp->position[0] = nan, "light[1].position is nan;")
    SPOIL(lamp->position[2] = infinite, "light[1].position is inf;")
    SPOIL(lamp->color[0] = -1, "light[1].color is -1;")
    SPOIL(lamp->color[1] = -1, "light[1].color is -1;")
    SPOIL(lamp->color[2] = (float)infinite, "light[1].color is inf;")
    SPOIL(memset(sun->direction, 0, sizeof sun->direction), "light[0].direction is 0;")
    SPOIL(sun->direction[1] = nan, "light[0].direction is nan;")
    SPOIL(sun->direction[1] = infinite, "light[0].direction is inf;")
    return NULL;
}

static const char *spoil_scene_and_view(mixed *m, int *n) {
    const double nan = not_a_number();
    sps_scene *scene = &m->s.scene;
    sps_view *view = &m->s.view;
    SPOIL(scene->start_canary = 7, "scene.start_canary is 7;")
    SPOIL(scene->end_canary = 7, "scene.end_canary is 7;")
    SPOIL(scene->volume_count = -1, "scene.volume_count is -1;")
    SPOIL(scene->volumes = NULL, "scene.volume_count is 1;")
    SPOIL(scene->mesh_count = -1, "scene.mesh_count is -1;")
    SPOIL(scene->meshes = NULL, "scene.mesh_count is 1;")
    SPOIL(scene->light_count = -1, "scene.light_count is -1;")
    SPOIL(scene->lights = NULL, "scene.light_count is 2;")
    SPOIL(scene->ambient[0] = -1, "scene.ambient is -1;")
    SPOIL(scene->ambient[2] = 2e18f, "scene.ambient is 2e+18;")
    SPOIL(scene->background[0] = (float)nan, "scene.background is nan;")
    SPOIL(scene->background[1] = -1, "scene.background is -1;")
    SPOIL(view->start_canary = 7, "view.start_canary is 7;")
    SPOIL(view->end_canary = 7, "view.end_canary is 7;")
    SPOIL(view->width = -1, "view.width is -1;")
    SPOIL(view->width = 0, "view.width is 0;")
    SPOIL(view->height = 0, "view.height is 0;")
    SPOIL(view->height = 16385, "view.height is 16385;")
    SPOIL(view->camera.position[1] = infinite, "view.camera.position is inf;")
    SPOIL(view->camera.target[1] = infinite, "view.camera.target is inf;")
    SPOIL(view->camera.up[2] = nan, "view.camera.up is nan;")
    SPOIL(memcpy(view->camera.target, view->camera.position, sizeof view->camera.target),
          "view.camera.position and camera.target")
    SPOIL(view->camera.field_of_view = -0.1, "view.camera.field_of_view is -0.1;")
    SPOIL(view->camera.field_of_view = 3.2, "view.camera.field_of_view is 3.2;")
    SPOIL((view->camera.field_of_view = 0, view->camera.ortho_height = -1), "view.camera.ortho_height is -1;")
    SPOIL((view->camera.field_of_view = 0, view->camera.ortho_height = nan), "view.camera.ortho_height is nan;")
    SPOIL(view->camera.field_of_view = nan, "view.camera.field_of_view is nan;")
    SPOIL(view->camera.field_of_view = 0, "view.camera has neither field_of_view nor ortho_height nor world_to_clip;")
    SPOIL(view->camera.ortho_height = 1, "view.camera has field_of_view and ortho_height;")
    SPOIL(view->camera.ortho_height = nan, "view.camera has field_of_view and ortho_height;")
    SPOIL(view->camera.world_to_clip = m->matrix, "view.camera has field_of_view and world_to_clip;")
    SPOIL((view->camera.field_of_view = 0, view->camera.ortho_height = 2, view->camera.world_to_clip = m->matrix),
          "view.camera has ortho_height and world_to_clip;")
    SPOIL((view->camera.ortho_height = 2, view->camera.world_to_clip = m->matrix),
          "view.camera has field_of_view and world_to_clip;")
    SPOIL(view->near_distance = -1, "view.near_distance is -1;")
    SPOIL(view->near_distance = infinite, "view.near_distance is inf;")
    SPOIL((view->region[2] = 1, view->region[3] = 0), "view.region is 0,0,1,0;")
    SPOIL((view->region[2] = 1, view->region[3] = SIDE + 1), "view.region is 0,0,1,18; it must lie inside 17 x 17")
    SPOIL((view->region[0] = -1, view->region[2] = view->region[3] = 1), "view.region is -1,0,1,1;")
    SPOIL((view->region[0] = SIDE, view->region[2] = view->region[3] = 1), "view.region is 17,0,1,1;")
    SPOIL((view->region[1] = 2147483647, view->region[2] = view->region[3] = 2147483647), "view.region")
    SPOIL(view->region[2] = -1, "view.region is 0,0,-1,0;")
    SPOIL(view->region[3] = 5, "view.region is 0,0,0,5;")
    SPOIL(view->region[0] = 2, "view.region is 2,0,0,0;")
    SPOIL(put_int(&view->quality, 5), "view.quality is 5;")
    SPOIL(view->slab_thickness = -1, "view.slab_thickness is -1;")
    SPOIL(view->slab_thickness = nan, "view.slab_thickness is nan;")
    SPOIL(view->slab_thickness = 1e-9, "view.slab_thickness is 1e-09;") /* more than 2^20 slabs */
    SPOIL(view->shadow_resolution = -1, "view.shadow_resolution is -1;")
    SPOIL(view->shadow_resolution = 16385, "view.shadow_resolution is 16385;")
    return NULL;
}
#undef SPOIL

static const char *spoil(mixed *m, int n) {
    const char *text = spoil_volume(m, &n);
    if (!text) text = spoil_mesh_and_lights(m, &n);
    return text ? text : spoil_scene_and_view(m, &n);
}

/* The reference has no slabs; everything else is as in sps_render. */
static void check_refused(mixed *m, const char *text) {
    sps_context *context = check_context(NULL);
    sps_plan_report report;
    sps_image image;
    sps_result results[3];
    int changed = 0;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    for (int i = 0; i < 4 * PIXELS; ++i) rgba[i] = (float)-i;
    for (int call = 0; call < 3; ++call) {
        if (call == 1 && (strstr(text, "slab_thickness is 1e-09") || results[0] != SPS_ERROR_ARGUMENT))
            continue; /* no marching to NaN */
        if (call == 0) results[call] = sps_render(context, &m->s.scene, &m->s.view, &image);
        if (call == 1) results[call] = check_reference(context, &m->s.scene, &m->s.view, 1, &image);
        if (call == 2) results[call] = sps_plan(context, &m->s.scene, &m->s.view, &report);
        if (!CHECK(results[call] == SPS_ERROR_ARGUMENT) ||
            (call == 0 &&
             !CHECK_CASE("Extremes",
                         "zero direction, negative intensity, asymmetry 1, NaN, infinity, in some eighty fields",
                         "an error that names the field and its value", strstr(sps_error(context), text) == NULL, 0,
                         "exact")) ||
            !CHECK(check_error_info(context, SPS_ERROR_ARGUMENT)))
            printf("    call %d: wanted \"%s\", got %d: %s\n", call, text, (int)results[call], sps_error(context));
    }
    for (int i = 0; i < 4 * PIXELS; ++i) changed += !(rgba[i] == (float)-i);
    if (!CHECK_CASE("Extremes", "the image after such an error", "untouched", changed, 0, "exact"))
        printf("    the image was written with a wrong %s\n", text);
    sps_destroy(context);
}

static void test_arguments(void) {
    int n = 0;
    for (;; ++n) {
        mixed m;
        const char *text;
        mixed_build(&m);
        text = spoil(&m, n);
        if (text) check_refused(&m, text);
        mixed_free(&m);
        if (!text) break;
    }
    CHECK(n > 80);
}

static int triangles_fail(void *user, size_t first, size_t count, sps_triangle *out) {
    (void)user;
    (void)first;
    (void)count;
    (void)out;
    return 9;
}

/* Number of failures of each object: the data name the same object as the sentence. */
static void test_error_objects(void) {
    static const struct {
        const char *text;
        sps_object object;
    } starts[] = {{"volume[0].", SPS_OBJECT_VOLUME}, {"mesh[0].", SPS_OBJECT_MESH}, {"light[0].", SPS_OBJECT_LIGHT},
                  {"light[1].", SPS_OBJECT_LIGHT},   {"scene.", SPS_OBJECT_SCENE},  {"view.", SPS_OBJECT_VIEW}};
    int seen[6] = {0};
    for (int n = 0;; ++n) {
        sps_context *context = check_context(NULL);
        sps_error_info info;
        sps_image image;
        mixed m;
        const char *text;
        memset(&image, 0, sizeof image);
        image.rgba = rgba;
        mixed_build(&m);
        text = spoil(&m, n);
        if (text) sps_plan(context, &m.s.scene, &m.s.view, NULL);
        if (text) sps_render(context, &m.s.scene, &m.s.view, &image);
        sps_get_error(context, &info);
        for (int i = 0; i < 6 && text; ++i) {
            if (strncmp(info.sentence, starts[i].text, strlen(starts[i].text)) != 0) continue;
            seen[i] += CHECK(info.object == starts[i].object && info.result == SPS_ERROR_ARGUMENT);
            CHECK(info.index == (i < 3 ? 0 : i == 3 ? 1 : -1));
        }
        mixed_free(&m);
        sps_destroy(context);
        if (!text) break;
    }
    for (int i = 0; i < 6; ++i) CHECK(seen[i] > 2);
}

/* A failure's data, which are cleared by a call that succeeds. */
static void test_error_info(void) {
    sps_context *context = check_context(NULL);
    sps_error_info info;
    sps_image image;
    mixed m;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    mixed_build(&m);
    m.s.volume[0].transfer = &m.transfer;
    m.points[1].extinction = -2;
    CHECK(sps_render(context, &m.s.scene, &m.s.view, &image) == SPS_ERROR_ARGUMENT);
    sps_get_error(context, &info);
    CHECK_CASE("Found in review", "errors as data", "object, index, field and value",
               !(info.object == SPS_OBJECT_VOLUME && info.index == 0 && info.value == -2) ||
                   strcmp(info.field, "transfer.points[1].extinction") != 0,
               0, "exact");
    m.points[1].extinction = 2;
    memcpy(m.s.volume[0].placement.axis[1], m.s.volume[0].placement.axis[0], 3 * sizeof(double));
    CHECK(sps_render(context, &m.s.scene, &m.s.view, &image) == SPS_ERROR_ARGUMENT);
    sps_get_error(context, &info);
    CHECK(strcmp(info.field, "placement") == 0); /* the object of the determinant */
    mixed_free(&m);
    mixed_build(&m);
    m.s.mesh[0].read_fn = triangles_fail;
    CHECK(sps_render(context, &m.s.scene, &m.s.view, &image) == SPS_ERROR_CALLBACK);
    sps_get_error(context, &info);
    CHECK(info.result == SPS_ERROR_CALLBACK && info.object == SPS_OBJECT_MESH && info.value == 9);
    CHECK(strcmp(info.field, "read_fn") == 0);
    m.s.mesh[0].read_fn = check_read_triangles;
    CHECK_OK(context, sps_render(context, &m.s.scene, &m.s.view, &image));
    sps_get_error(context, &info);
    CHECK(info.result == SPS_OK && info.object == SPS_OBJECT_NONE && info.index == -1 && !*info.field);
    CHECK(info.value == 0 && !*info.sentence);
    CHECK(sps_render(context, &m.s.scene, NULL, &image) == SPS_ERROR_ARGUMENT);
    sps_get_error(context, &info);
    CHECK(info.object == SPS_OBJECT_CALL && info.index == -1 && strcmp(info.field, "view") == 0);
    CHECK(strcmp(info.sentence, "view is NULL; it must not be") == 0);
    sps_get_error(NULL, &info);
    CHECK(info.result == SPS_ERROR_ARGUMENT && info.object == SPS_OBJECT_CALL && strcmp(info.field, "context") == 0);
    CHECK(strcmp(info.sentence, sps_error(NULL)) == 0);
    sps_get_error(context, NULL); /* nothing to fill */
    sps_destroy(context);
    mixed_free(&m);
}

static void test_image_argument(void) {
    sps_context *context = check_context(NULL);
    sps_image image;
    mixed m;
    mixed_build(&m);
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    image.row_pixels = SIDE - 1;
    CHECK(sps_render(context, &m.s.scene, &m.s.view, &image) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "image.row_pixels is 16;") != NULL);
    CHECK(check_error_info(context, SPS_ERROR_ARGUMENT));
    for (int n = 0; n < 3; ++n) { /* sizes in bytes that do not fit into a number */
        image.row_pixels = n == 0 ? SIZE_MAX - 31 : n == 1 ? SIZE_MAX / 16 : (size_t)PTRDIFF_MAX / 16 / SIDE + 1;
        CHECK(sps_render(context, &m.s.scene, &m.s.view, &image) == SPS_ERROR_ARGUMENT);
        CHECK(strncmp(sps_error(context), "image.row_pixels is ", 20) == 0);
    }
    image.row_pixels = 0;
    CHECK(check_reference(context, &m.s.scene, &m.s.view, 0, &image) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "step is 0;") != NULL);
    CHECK(check_reference(context, &m.s.scene, &m.s.view, not_a_number(), &image) == SPS_ERROR_ARGUMENT);
    CHECK(check_reference(context, &m.s.scene, &m.s.view, infinite, &image) == SPS_ERROR_ARGUMENT);
    sps_destroy(context);
    mixed_free(&m);
}

/* A matrix that is flat, or at infinity, or has an element, each in turn, that is no number. */
static void test_matrix_arguments(void) {
    for (int n = 0; n < 18; ++n) {
        double matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
        mixed m;
        mixed_build(&m);
        check_matrix(&m.s.view.camera, matrix);
        char sentence[64] = "view.camera.world_to_clip cannot be inverted";
        if (n < 16)
            matrix[n] = not_a_number(), snprintf(sentence, sizeof sentence, "view.camera.world_to_clip[%d] is nan;", n);
        if (n == 16) matrix[0] = 0;  /* flat */
        if (n == 17) matrix[15] = 0; /* orthographic, at infinity */
        check_refused(&m, sentence);
        mixed_free(&m);
    }
}

/* Two equal axes make a placement flat in any orientation, though round-off may leave a determinant of 1e-17 or so
   instead of 0; the outcome must not depend on the compiler. */
static void test_flat_placements(void) {
    check_random random = {3};
    for (int n = 0; n < 50; ++n) {
        check_scene s;
        sps_volume *volume = uniform_build(&s, 4, 1);
        for (int i = 0; i < 9; ++i) volume->placement.axis[i / 3][i % 3] = check_next(&random) - 0.5;
        memcpy(volume->placement.axis[n % 3], volume->placement.axis[(n + 1) % 3], 3 * sizeof(double));
        if (!CHECK(render_fresh(&s, rgba) == SPS_ERROR_ARGUMENT) || !CHECK(strstr(sentence, "volume[0].placement")))
            printf("    placement %d\n", n);
    }
}

/* 65 volumes are too many if they hold voxels, and allowed if they do not. */
static void test_too_many_volumes(void) {
    static sps_volume volumes[65];
    check_scene s;
    for (int i = 0; i < 65; ++i) volumes[i] = *uniform_build(&s, 4, 1);
    s.scene.volumes = volumes;
    s.scene.volume_count = 65;
    CHECK(render_fresh(&s, rgba) == SPS_ERROR_ARGUMENT && strstr(sentence, "scene.volume_count is 65;"));
    volumes[7].size[1] = 0;
    RENDERS(&s, rgba);
}

/* 65 sets of particles are too many if all hold some. */
static void test_too_many_sets(void) {
    static sps_particles sets[65];
    check_scene s;
    uniform_build(&s, 4, 1);
    for (int i = 0; i < 65; ++i) sets[i] = *check_add_swarm(&s, 0.1), s.scene.particle_set_count = 0;
    s.scene.particles = sets;
    s.scene.particle_set_count = 65;
    CHECK(render_fresh(&s, rgba) == SPS_ERROR_ARGUMENT && strstr(sentence, "scene.particle_set_count is 65;"));
    sets[7].count = 0;
    RENDERS(&s, rgba);
}

static int range_fails(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)user;
    (void)lo;
    (void)size;
    out[0] = out[1] = 0;
    return 1;
}

/* The maximum size has 2^33 blocks: the first one is read, and its failure is reported. */
static void test_largest_volume(void) {
    check_scene s;
    sps_volume *volume = uniform_build(&s, 65536, 1);
    volume->range_fn = range_fails;
    CHECK(render_fresh(&s, rgba) == SPS_ERROR_CALLBACK);
}

/* --------------------------------------------------------------------------------------------------------- bad data */

/* The value `bad` at voxels (37,5,2) and, if `twice`, (3,33,1); 0.5 elsewhere. */
typedef struct spoilt {
    double bad;
    int twice;
} spoilt;

static float spoilt_value(const spoilt *s, int x, int y, int z) {
    if ((x == 37 && y == 5 && z == 2) || (s->twice && x == 3 && y == 33 && z == 1)) return (float)s->bad;
    return 0.5f;
}

static int read_spoilt(void *user, const int lo[3], const int size[3], float *out) {
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i)
                *out++ = spoilt_value((const spoilt *)user, lo[0] + i, lo[1] + j, lo[2] + k);
    return 0;
}

/* The box is 40 by 35 by 3 units, one per voxel. */
static int eval_spoilt(void *user, size_t count, const double *p, float *out) {
    for (size_t i = 0; i < count; ++i, p += 3)
        out[i] = spoilt_value((const spoilt *)user, (int)floor(p[0]), (int)floor(p[1]), (int)floor(p[2]));
    return 0;
}

static void spoilt_build(check_scene *s, spoilt *user, int procedural) {
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 20, 17, 50);
    check_set3(s->view.camera.target, 20, 17, 0);
    check_orthographic(&s->view.camera, 40);
    volume = check_add_volume(s, 40, 35, 3, check_box(0, 0, 0, 40, 35, 3));
    if (procedural)
        volume->eval_fn = eval_spoilt;
    else
        volume->read_fn = read_spoilt;
    volume->user = user;
    volume->extinction = 0.5f;
    check_color(volume->albedo, 0.8, 0.8, 0.8);
    check_add_directional(s, 0.2, 0.1, -1, 2);
}

static void count_messages(void *user, const char *text) { *(long *)user += text[0] != 0; }

/* Replaced: the picture of zeros in their place, a count, and one message. */
static void check_replaced(check_scene *s, spoilt *user) {
    sps_stats_report stats;
    sps_config config;
    sps_context *context;
    sps_image image;
    const double bad = user->bad;
    long messages = 0;
    memset(&config, 0, sizeof config);
    memset(&image, 0, sizeof image);
    config.message_fn = count_messages;
    config.message_user = &messages;
    context = sps_create(&config, NULL);
    image.rgba = rgba;
    s->scene.replace_invalid = 1;
    user->twice = 1;
    CHECK_OK(context, sps_render(context, &s->scene, &s->view, &image));
    sps_get_stats(context, &stats);
    CHECK(stats.values_replaced == 2);
    CHECK(messages == 1); /* sps_config: "one line: errors, replaced data" */
    user->bad = 0;
    s->scene.replace_invalid = 0;
    RENDERS(s, other);
    CHECK_CASE("Extremes", "the same voxels with replace_invalid", "the picture of zeros in their place",
               memcmp(rgba, other, sizeof rgba) != 0, 0, "same bits");
    user->bad = bad;
    sps_destroy(context);
}

enum { MESSAGES = 512 };
static void keep_messages(void *user, const char *text) {
    strncat((char *)user, text, MESSAGES - 1 - strlen((char *)user));
}

/* Invalid voxels and particles are counted apart. */
static void test_bad_of_both(void) {
    spoilt user = {not_a_number(), 0};
    char text[MESSAGES] = "";
    check_scene s;
    sps_config config;
    sps_image image;
    sps_context *by;
    memset(&config, 0, sizeof config), memset(&image, 0, sizeof image);
    config.message_fn = keep_messages, config.message_user = text;
    by = sps_create(&config, NULL);
    spoilt_build(&s, &user, 0);
    user.twice = 1;
    sps_particle *swarm = (sps_particle *)check_add_swarm(&s, 0.1)->user;
    swarm[7].radius = swarm[9].position[1] = (float)not_a_number();
    s.scene.replace_invalid = 1;
    image.rgba = rgba;
    CHECK_OK(by, sps_render(by, &s.scene, &s.view, &image));
    if (!CHECK(strstr(text, "2 values of volumes were") && strstr(text, "2 particles were"))) printf("    %s\n", text);
    sps_destroy(by);
}

static void test_bad_values(void) {
    const double bad[] = {not_a_number(), infinite, -infinite, -1, -1e-20, 1e30, 1.1e18};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i)
        for (int procedural = 0; procedural < 2; ++procedural) {
            spoilt user = {bad[i], 0};
            check_scene s;
            spoilt_build(&s, &user, procedural);
            for (int n = 0; n < 4 * PIXELS; ++n) rgba[n] = -1;
            CHECK_CASE("Extremes", "voxels of NaN, infinity, -infinity, -1, 1e30", "an error that names the voxel",
                       render_fresh(&s, rgba) != SPS_ERROR_DATA || !strstr(sentence, "voxel 37,5,2"), 0, "exact");
            CHECK(strstr(sentence, "volume[0].value is") != NULL);
            CHECK(rgba[0] == -1 && rgba[4 * PIXELS - 1] == -1);
            check_replaced(&s, &user);
        }
}

/* If a range callback returns no valid range, the error is found in the values themselves. */
static int range_of_nothing(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)lo;
    (void)size;
    out[0] = out[1] = (float)*(const double *)user;
    return 0;
}

static void test_bad_range(void) {
    double bad = not_a_number();
    check_scene s;
    for (int i = 0; i < 2; ++i) {
        sps_volume *volume = uniform_build(&s, 16, 0.5);
        double saved = bad;
        volume->range_fn = range_of_nothing;
        volume->user = &bad;
        volume->read_fn = read_bumps;
        if (i == 0) CHECK(render_fresh(&s, rgba) == SPS_ERROR_DATA); /* NaN * bumps */
        bad = infinite;
        if (i == 1) CHECK(render_fresh(&s, rgba) == SPS_ERROR_DATA);
        bad = saved;
    }
}

static void test_bad_triangles(void) {
    static const char *const names[3] = {"position", "normal", "albedo"};
    static const char *const values[3][3] = {{"nan", "inf", "-inf"}, {"nan", "inf", "-inf"}, {"nan", "1.5", "-inf"}};
    const float bad[] = {(float)not_a_number(), (float)infinite, -(float)infinite};
    for (int i = 0; i < 9; ++i) {
        char wanted[64];
        mixed m;
        sps_triangle *t;
        mixed_build(&m);
        t = &m.triangles.list[1];
        m.s.mesh[0].has_normals = m.s.mesh[0].has_albedos = 1;
        if (i / 3 == 0) t->position[2][1] = bad[i % 3];
        if (i / 3 == 1) t->normal[1][0] = bad[i % 3];
        if (i / 3 == 2) t->albedo[1][0] = i % 3 == 1 ? 1.5f : bad[i % 3];
        for (int n = 0; n < 4 * PIXELS; ++n) rgba[n] = -1;
        CHECK(render_fresh(&m.s, rgba) == SPS_ERROR_DATA);
        snprintf(wanted, sizeof wanted, "mesh[0].triangle[1].%s is %s;", names[i / 3], values[i / 3][i % 3]);
        if (!CHECK_CASE("Extremes", "NaN or infinity in a triangle", "an error that names triangle and field",
                        strstr(sentence, wanted) == NULL, 0, "exact"))
            printf("    wanted \"%s\", got %s\n", wanted, sentence);
        CHECK(rgba[0] == -1);
        m.s.mesh[0].has_normals = m.s.mesh[0].has_albedos = 0; /* not read then */
        if (i / 3 > 0 && !(check_memory_only() && i % 3)) RENDERS(&m.s, rgba);
        mixed_free(&m);
    }
}

/* Triangles without area are skipped and counted; a duplicate is seen once. */
static void test_degenerate_triangles(void) {
    const double a[3] = {0, 0, 2}, b[3] = {0.5, 0.1, 2}, c[3] = {1, 0.2, 2};
    mixed m;
    sps_stats_report stats;
    sps_context *context = check_context(NULL);
    mixed_build(&m);
    RENDERS(&m.s, other);
    check_add_corners(&m.triangles, a, a, a);
    check_add_corners(&m.triangles, a, b, b);
    check_add_corners(&m.triangles, a, b, c); /* a line, or a sliver because of float round-off */
    *check_add_triangle(&m.triangles) = m.triangles.list[0];
    m.s.mesh[0].triangle_count = m.triangles.count;
    check_render(context, &m.s, rgba);
    sps_get_stats(context, &stats);
    CHECK(stats.triangles_degenerate >= 2 && stats.triangles + stats.triangles_degenerate == 6);
    CHECK_CASE("Extremes", "triangles without area, and one repeated", "the picture without them",
               memcmp(rgba, other, sizeof rgba) != 0, 0, "same bits");
    sps_destroy(context);
    mixed_free(&m);
}

static int background_bad(void *user, size_t count, const float *directions, float *rgb) {
    (void)directions;
    for (size_t i = 0; i < 3 * count; ++i) rgb[i] = i == 4 ? (float)*(const double *)user : 0.5f;
    return 0;
}

static int transfer_bad(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)values;
    for (size_t i = 0; i < count; ++i) out[i].extinction = (float)*(const double *)user;
    return 0;
}

static void test_bad_callbacks(void) {
    double bad[] = {not_a_number(), infinite, -1};
    for (int i = 0; i < 3; ++i) {
        mixed m;
        mixed_build(&m);
        m.s.scene.background_fn = background_bad;
        m.s.scene.background_user = &bad[i];
        CHECK(render_fresh(&m.s, rgba) == SPS_ERROR_DATA && strstr(sentence, "scene.background_fn's color is"));
        m.s.scene.background_fn = NULL;
        m.s.volume[0].transfer = &m.transfer;
        m.transfer.points = NULL;
        m.transfer.point_count = 0;
        m.transfer.eval_fn = transfer_bad;
        m.transfer.user = &bad[i];
        CHECK(render_fresh(&m.s, rgba) == SPS_ERROR_DATA);
        CHECK(strstr(sentence, "volume[0].transfer.eval_fn(0).extinction is ") != NULL);
        mixed_free(&m);
    }
}

/* The value that a failing callback returns is reported, with the callback's name. */
static int read_fails(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    (void)lo;
    (void)size;
    (void)out;
    return 7;
}

static int eval_fails(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    (void)count;
    (void)positions;
    (void)out;
    return 8;
}

static int background_fails(void *user, size_t count, const float *directions, float *rgb) {
    (void)user;
    (void)count;
    (void)directions;
    (void)rgb;
    return 10;
}

static int transfer_fails(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    (void)count;
    (void)values;
    (void)out;
    return 11;
}

static void test_failing_callbacks(void) {
    static const char *const sentences[6] = {
        "volume[0].read_fn failed: it returned 7",    "volume[0].range_fn failed: it returned 1",
        "volume[0].eval_fn failed: it returned 8",    "mesh[0].read_fn failed: it returned 9",
        "scene.background_fn failed: it returned 10", "volume[0].transfer.eval_fn failed: it returned 11"};
    for (int i = 0; i < 6; ++i) {
        mixed m;
        mixed_build(&m);
        if (i == 0) m.s.volume[0].read_fn = read_fails;
        if (i == 1) m.s.volume[0].range_fn = range_fails;
        if (i == 2) m.s.volume[0].read_fn = NULL, m.s.volume[0].eval_fn = eval_fails;
        if (i == 3) m.s.mesh[0].read_fn = triangles_fail;
        if (i == 4) m.s.scene.background_fn = background_fails;
        if (i == 5) {
            m.s.volume[0].transfer = &m.transfer;
            memset(&m.transfer, 0, sizeof m.transfer);
            m.transfer.eval_fn = transfer_fails;
        }
        CHECK(render_fresh(&m.s, rgba) == SPS_ERROR_CALLBACK);
        if (!CHECK(strcmp(sentence, sentences[i]) == 0)) printf("    wanted \"%s\", got %s\n", sentences[i], sentence);
        mixed_free(&m);
    }
}

/* ------------------------------------------------------------------------------------------- values and extinctions */

/* Values that would make denormal numbers are invisible; large values differ from small ones only by a factor. */
static void test_large_and_small_values(void) {
    const double values[] = {1e-29, 1e-10, 1e10, 1e18};
    check_scene s;
    sps_volume *volume = uniform_build(&s, 16, 0.5);
    float value = 1e-40f;
    int seen = 0;
    RENDERS(&s, other);
    volume->user = &value;
    volume->extinction = 1e18f;
    volume->emission[0] = 1;
    RENDERS(&s, rgba);
    for (int i = 0; i < 4 * PIXELS; ++i) seen += !(rgba[i] == 0);
    CHECK_CASE("Extremes", "denormal voxels, extinction 1e18", "nothing is seen", seen, 0, "they count as 0");
    volume->emission[0] = 0;
    for (size_t i = 0; i < sizeof values / sizeof *values; ++i) {
        value = (float)values[i];
        volume->extinction = (float)(0.5 / values[i]);
        if (!(volume->extinction <= 1e18f)) volume->extinction = 1e18f;
        RENDERS(&s, rgba);
        if (!CHECK(sane(rgba, PIXELS, 1))) printf("    value %g\n", values[i]);
        /* float round-off in value, extinction and their products: a few times 1e-7 */
        if (volume->extinction < 1e18f)
            CHECK_CASE("Extremes", "values of 1e-10 to 1e18", "the picture of the same extinction by value 1",
                       check_largest(rgba, other, 4 * PIXELS), 2e-6, "a few roundings of floats");
    }
}

/* The ripple of a constant grid's optical depths at each quality, as in the header's table. */
static void test_optical_depths(void) {
    static const double depths[] = {1e-8, 1e-3, 1, 20, 80, 1e3, 2e8, 1e18}, ripple[] = {0, 0.015, 0.004, 0.002, 0.002};
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_ULTRA; ++quality)
        for (size_t i = 0; i < sizeof depths / sizeof *depths; ++i) {
            check_scene s;
            sps_volume *volume = uniform_build(&s, 16, depths[i] / 2);
            const double exact = -expm1(-depths[i]);
            s.view.quality = (sps_quality)quality;
            check_orthographic(&s.view.camera, 1);
            check_color(volume->albedo, 0.5, 0.6, 0.7);
            check_add_directional(&s, 0.3, 0.2, -1, 3);
            RENDERS(&s, rgba);
            /* scattered once, so at most irradiance * albedo / 4 pi */
            if (!CHECK(sane(rgba, PIXELS, 3 * 0.7 / (4 * 3.14159))) ||
                !CHECK_CASE("Extremes", "optical depths of 1e-8 to 1e18 at each quality", "coverage 1 - exp(-depth)",
                            fabs((double)middle(rgba)[3] - exact),
                            ripple[quality] * fmin(exact, depths[i] * exp(-depths[i])) + 5e-7 * exact,
                            "ripple of each quality; round-off"))
                printf("    depth %g, quality %d\n", depths[i], quality);
            CHECK(middle(rgba)[2] > middle(rgba)[0] && middle(rgba)[0] > 0);
        }
}

/* The maxima of all fields together. */
static void test_largest_allowed(void) {
    check_scene s;
    float value = 1e18f;
    sps_volume *volume = uniform_build(&s, 16, 1e18);
    volume->user = &value;
    check_color(volume->albedo, 1, 1, 1);
    check_add_directional(&s, 0.3, 0.2, -1, 1e18);
    RENDERS(&s, rgba);
    CHECK(sane(rgba, PIXELS, 1e18));
    CHECK_CASE("Extremes", "every field at its maximum, 1e18", "coverage is 1", fabs((double)middle(rgba)[3] - 1), 0,
               "a float's 1 exactly");
    volume->extinction = 0;
    value = 1;
    check_color(volume->emission, 1e18, 1e18, 1e18);
    RENDERS(&s, rgba);
    CHECK_NEAR((double)middle(rgba)[0], 2e18, 0.003 * 2e18);
    CHECK(middle(rgba)[3] == 0);
}

/* Two thousand slabs of very thin gas add up to the same as one slab. */
static void test_many_thin_slabs(void) {
    check_scene s;
    uniform_build(&s, 16, 0.5);
    s.view.slab_thickness = 16.0 / 2000;
    RENDERS(&s, rgba);
    CHECK_NEAR(optical_depth(middle(rgba)), 1, 0.003);
    s.view.filling = SPS_FILLING_SPLAT; /* as slabs of any thickness can be */
    RENDERS(&s, rgba);
    CHECK_NEAR(optical_depth(middle(rgba)), 1, 0.003);
    s.view.slab_thickness = 1e3;
    RENDERS(&s, other);
    CHECK_NEAR(optical_depth(middle(other)), 1, 0.003);
    CHECK_NEAR(optical_depth(middle(other)), optical_depth(middle(rgba)), 0.001);
}

/* ---------------------------------------------------------------------------------------------- nearly empty scenes */

static int all_background(const float *pixels, float background) {
    for (int i = 0; i < 4 * PIXELS; ++i)
        if (!(pixels[i] == (i % 4 == 3 ? 0 : background))) return 0;
    return 1;
}

static void test_empty_scenes(void) {
    for (int i = 0; i < 6; ++i) {
        check_triangles none;
        check_scene s;
        sps_volume *volume = uniform_build(&s, 8, 1);
        float zero = 0;
        memset(&none, 0, sizeof none);
        check_color(s.scene.background, 0.3, 0.3, 0.3);
        if (i != 1) check_add_directional(&s, 0, 0.1, -1, 2);
        if (i == 0 || i == 1) s.scene.volume_count = 0, s.scene.volumes = NULL, s.scene.meshes = NULL;
        if (i == 1) s.scene.lights = NULL;
        if (i == 2) volume->size[2] = 0;
        if (i == 3) volume->user = &zero;
        if (i == 4) volume->extinction = 0;
        if (i == 5) s.scene.volume_count = 0, check_add_mesh(&s, &none, 0.5);
        for (int n = 0; n < PIXELS; ++n) depth[n] = -1;
        RENDERS(&s, rgba);
        if (!CHECK_CASE("Extremes", "no volumes, no lights, no triangles, value 0, extinction 0", "the background",
                        !all_background(rgba, 0.3f), 0, "exact") ||
            !CHECK(depth[0] > FLT_MAX && depth[PIXELS - 1] > FLT_MAX))
            printf("    empty scene %d\n", i);
    }
}

/* A view without pixels is an error, as is an image without a buffer. */
static void test_no_image(void) {
    check_scene s;
    uniform_build(&s, 8, 1);
    CHECK(render_fresh(&s, NULL) == SPS_ERROR_ARGUMENT);
    CHECK(strcmp(sentence, "image.rgba is NULL; it must not be") == 0);
    for (int i = 0; i < 3; ++i) {
        s.view.width = i == 0 ? 0 : SIDE;
        s.view.height = i == 1 ? 0 : SIDE;
        if (i == 2) s.view.width = s.view.height = 0;
        for (int n = 0; n < 4 * PIXELS; ++n) rgba[n] = -1;
        CHECK(render_fresh(&s, rgba) == SPS_ERROR_ARGUMENT);
        CHECK_CASE("Extremes", "an image of 0 x 0", "an error that names the field",
                   strcmp(sentence, i == 1 ? "view.height is 0; it must be 1..16384"
                                           : "view.width is 0; it must be 1..16384") != 0,
                   0, "exact");
        CHECK(rgba[0] == -1);
    }
}

/* A single pixel equals the middle one of nine of its size. */
static void test_one_pixel(void) {
    mixed m;
    float one[4];
    mixed_build(&m);
    m.s.view.width = m.s.view.height = 3;
    check_orthographic(&m.s.view.camera, 0.9);
    RENDERS(&m.s, rgba);
    m.s.view.width = m.s.view.height = 1;
    check_orthographic(&m.s.view.camera, 0.3);
    RENDERS(&m.s, one);
    CHECK_CASE("Extremes", "an image of 1 x 1", "the middle of 3 x 3", check_largest(one, rgba + 4 * 4, 4), 1e-5,
               "positions differ by float round-off");
    mixed_free(&m);
}

/* One voxel against the reference. Kernels cut at 2.5 voxels leave 5 % of their peak's 6e-4 out. */
static void test_one_voxel(void) {
    check_scene s;
    sps_volume *volume = uniform_build(&s, 1, 0.7);
    s.view.quality = SPS_QUALITY_ULTRA;
    check_orthographic(&s.view.camera, 9);
    check_color(volume->albedo, 0.9, 0.9, 0.9);
    check_add_directional(&s, 0.5, 0.3, -1, 3);
    RENDERS(&s, rgba);
    CHECK_CASE("Extremes", "a volume of one voxel", "brute force", reference_error(&s, rgba), 0.01,
               "the kernel's cut leaves 6e-4 of its peak out");
    CHECK(middle(rgba)[3] > 0.3f);
}

static void test_no_lights(void) {
    mixed m;
    mixed_build(&m);
    m.s.scene.light_count = 0;
    RENDERS(&m.s, rgba);
    CHECK(sane(rgba, PIXELS, 1));
    CHECK(middle(rgba)[0] > 0); /* ambient light and emission */
    m.s.light[0].color[0] = m.s.light[0].color[1] = m.s.light[0].color[2] = 0;
    m.s.scene.light_count = 1;
    RENDERS(&m.s, other);
    CHECK_CASE("Extremes", "no lights, and a black one", "the same picture, by ambient light and emission",
               memcmp(rgba, other, sizeof rgba) != 0, 0, "same bits");
    mixed_free(&m);
}

/* -------------------------------------------------------------------------------------------- shapes, sizes, places */

/* Voxels of edges 1:1:50, long across the view, where the middle of the one layer is the kernel's peak; long along the
   view; and sheared ones. */
static void test_uneven_voxels(void) {
    const double peak = 1 / (sqrt(2 * 3.14159265358979) * 0.65);
    for (int i = 0; i < 4; ++i) {
        check_scene s;
        sps_volume *volume = uniform_build(&s, 16, 0.5);
        const double exact = i < 2 ? peak : 1;
        if (i < 3) volume->size[0] = volume->size[1] = volume->size[2] = 50, volume->size[i] = 1;
        if (i < 2) volume->placement.axis[i][i] = 2, volume->placement.origin[i] = -1;
        if (i == 3) volume->placement.axis[2][0] = 0.8, volume->placement.origin[0] -= 0.4;
        RENDERS(&s, rgba);
        if (!CHECK_CASE("Extremes", "one layer of voxels 1:1:50, and sheared ones", "optical depth",
                        fabs(optical_depth(middle(rgba)) - exact), 0.005, "ripple of medium quality, 0.4 %"))
            printf("    case %d\n", i);
    }
}

/* The whole scene scaled by `scale` and moved by `shift`, with matching extinction and intensities. */
static void mixed_transform(mixed *m, double scale, double shift) {
    sps_volume *volume = m->s.volume;
    sps_mesh *mesh = m->s.mesh;
    for (int i = 0; i < 3; ++i) {
        volume->placement.origin[i] = volume->placement.origin[i] * scale + shift;
        mesh->placement.origin[i] = shift;
        mesh->placement.axis[i][i] = scale;
        m->s.view.camera.position[i] = m->s.view.camera.position[i] * scale + shift;
        m->s.view.camera.target[i] = m->s.view.camera.target[i] * scale + shift;
        m->s.light[1].position[i] = m->s.light[1].position[i] * scale + shift;
        m->s.light[1].color[i] *= (float)(scale * scale);
        volume->emission[i] /= (float)scale;
        for (int k = 0; k < 3; ++k) volume->placement.axis[i][k] *= scale;
    }
    volume->extinction /= (float)scale;
}

static void test_scales_and_origins(void) {
    const double cases[][2] = {{1024, 0}, {1.0 / 1024, 0}, {1e3, 0}, {1e-3, 0},
                               {1e6, 0},  {1e-6, 0},       {1, 1e6}, {1, 1e7}};
    mixed m;
    mixed_build(&m);
    RENDERS(&m.s, other);
    mixed_free(&m);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        mixed_build(&m);
        mixed_transform(&m, cases[i][0], cases[i][1]);
        RENDERS(&m.s, rgba);
        /* at 1e7, positions in double precision are accurate to 1e-9 of a voxel; the rest is floats as usual */
        if (!CHECK_CASE("What users of other renderers complain of",
                        "jitter far from the origin: at 1e6 and 1e7, and scales", "the same picture",
                        check_largest(rgba, other, 4 * PIXELS), 1e-4,
                        "doubles are accurate to 1e-9 of a voxel there; the rest is floats as usual"))
            printf("    scale %g, origin %g: off by %g\n", cases[i][0], cases[i][1],
                   check_largest(rgba, other, 4 * PIXELS));
        mixed_free(&m);
    }
}

/* The eye among coarse voxels, whose kernels are then integrated along each ray, where lengths occur to the sixth
   power. Scaling by powers of 2 changes no rounding except for comparisons with constants. */
static void test_scales_of_near_voxels(void) {
    static const int powers[] = {-40, -27, -13, 13, 23, 33};
    const sps_transfer_point points[2] = {{0.1f, {1, 1, 1}, 0, {0, 0, 0}}, {0.5f, {1, 1, 1}, 2, {0, 0, 0}}};
    for (int classified = 0; classified < 2; ++classified)
        for (size_t i = 0; i <= sizeof powers / sizeof *powers; ++i) {
            const double scale = i > 0 ? ldexp(1, powers[i - 1]) : 1;
            sps_transfer_point scaled[2];
            const sps_transfer transfer = {scaled, 2, NULL, NULL, 0};
            check_scene s;
            sps_volume *volume = uniform_build(&s, 8, 1 / scale);
            memcpy(scaled, points, sizeof points);
            scaled[1].extinction /= (float)scale;
            if (classified) volume->transfer = &transfer, volume->shading = SPS_SHADING_SURFACE;
            for (int k = 0; k < 3; ++k) {
                volume->placement.origin[k] *= scale, volume->placement.axis[k][k] *= scale;
                volume->albedo[k] = 0.8f;
            }
            check_add_directional(&s, 1, -1, -1, 3);
            check_set3(s.view.camera.position, 0.2 * scale, 0.3 * scale, 3 * scale);
            check_set3(s.view.camera.target, 0, 0, 0);
            check_perspective(&s.view.camera, 0.5);
            RENDERS(&s, i > 0 ? rgba : other);
            if (i > 0 && !CHECK_CASE("Extremes", "eye among coarse voxels, scaled by 2^-40 to 2^33", "the same picture",
                                     check_largest(rgba, other, 4 * PIXELS), 1e-4,
                                     "comparisons with constants alone depend on scale"))
                printf("    2^%d, classified %d: off by %g\n", powers[i - 1], classified,
                       check_largest(rgba, other, 4 * PIXELS));
        }
}

/* Whether a ray (x t, t), t > 0, intersects an ellipse: at the minimum of its quadratic form along the ray, or at the
   eye. */
static int ray_meets(const double q[2], const double c[3], double cut, double x) {
    const double determinant = c[0] * c[2] - c[1] * c[1];
    const double inverse[3] = {c[2] / determinant, -c[1] / determinant, c[0] / determinant};
    const double square = inverse[0] * x * x + 2 * inverse[1] * x + inverse[2];
    const double along = inverse[0] * x * q[0] + inverse[1] * (x * q[1] + q[0]) + inverse[2] * q[1];
    const double t = fmax(along / square, 0), u = q[0] - t * x, v = q[1] - t;
    return inverse[0] * u * u + 2 * inverse[1] * u * v + inverse[2] * v * v < cut * cut;
}

/* Kernels close to the eye's plane are culled only if no ray meets them; most such kernels are, since otherwise a light
   among voxels would take a minute. */
static void test_near_kernels_left_out(void) {
    check_random random = {9};
    int missed = 0, left_out = 0;
    for (int n = 0; n < 4000; ++n) {
        const int first = (int)(200 * check_next(&random)) - 100, last = first + 63;
        const double size = 0.02 + 0.2 * check_next(&random), lean = 2 * check_next(&random) - 1, cut = 3.3;
        /* pixels are 1/50 wide at distance 1; the ellipse's widths along x and t are within a factor of 10 */
        const double wide = 50 * size * (0.3 + 2 * check_next(&random)), deep = size;
        const double c[3] = {wide * wide, 0.9 * lean * wide * deep, deep * deep};
        const double q[2] = {150 * (2 * check_next(&random) - 1), 2 * check_next(&random) - 1};
        const spsi_extent extent = {(float)q[0], (float)q[1], (float)cut, (float)c[0], (float)c[1], (float)c[2]};
        const int reaches = spsi_extent_meets(&extent, first, last);
        int meets = 0;
        for (int x = first; x <= last; ++x) meets |= ray_meets(q, c, cut, x);
        CHECK(reaches || !meets);
        missed += !meets;
        left_out += !reaches;
    }
    CHECK(missed > 1000 && left_out > 0.8 * missed);
}

/* exp(-20 r^2) around (0.4, 0.4, 0.4), at the scale that `user` points to. */
static double ball_at(const void *user, const double position[3]) {
    const double scale = *(const double *)user;
    double square = 0;
    for (int i = 0; i < 3; ++i) square += (position[i] / scale - 0.4) * (position[i] / scale - 0.4);
    return exp(-20 * square);
}

/* A polygon may leave almost nothing of a ray's path through a slab, while its sheet holds round-off that grows with
   the world: their quotient must not become a value or a gradient. Some pixels were 8e30 at 1e7 and 1e8. */
static void test_scales_of_cut_surfaces(void) {
    enum { WIDTH = 48 };
    static const double scales[] = {1, 1e-6, 1e6, 1e7, 3e7, 1e8};
    static const double corners[4][3] = {{-0.5, -0.3, -0.6}, {0.6, -0.2, -0.5}, {0.5, -0.25, 0.6}, {-0.5, -0.3, 0.5}};
    static float picture[4 * WIDTH * WIDTH], first[4 * WIDTH * WIDTH];
    for (size_t i = 0; i < sizeof scales / sizeof *scales; ++i) {
        const double scale = scales[i];
        const sps_transfer_point points[3] = {{0.1f, {0.8f, 0.3f, 0.2f}, 0, {0, 0, 0}},
                                              {0.4f, {0.8f, 0.5f, 0.2f}, (float)(3 / scale), {0, 0, 0}},
                                              {1, {0.2f, 0.5f, 0.9f}, (float)(6 / scale), {0, 0, 0}}};
        const sps_transfer transfer = {points, 3, NULL, NULL, 0};
        check_field field = {ball_at, &scale, {0, 0, 0}, {{0, 0, 0}, {{0}}}};
        check_triangles triangles = {0};
        sps_context *context = check_context(NULL);
        check_scene s;
        sps_volume *volume;
        check_clear(&s, WIDTH, WIDTH);
        volume = check_add_volume(&s, 24, 24, 24, check_box(-scale, -scale, -scale, scale, scale, scale));
        volume->read_fn = NULL, volume->eval_fn = check_eval_field, volume->user = &field;
        volume->transfer = &transfer, volume->shading = SPS_SHADING_SURFACE;
        check_add_corners(&triangles, corners[0], corners[1], corners[2]);
        check_add_corners(&triangles, corners[0], corners[2], corners[3]);
        for (int n = 0; n < 2; ++n) {
            sps_mesh *mesh = check_add_mesh(&s, &triangles, 0.5);
            for (int k = 0; k < 3; ++k) mesh->placement.axis[k][k] = scale;
            mesh->placement.origin[1] = n * 0.8 * scale;
        }
        check_add_directional(&s, -0.5, -1, -0.4, 3);
        check_set3(s.view.camera.position, scale, 0.8 * scale, 4 * scale);
        check_set3(s.view.camera.target, 0, 0, 0);
        check_perspective(&s.view.camera, 0.6);
        CHECK(check_render(context, &s, i > 0 ? picture : first));
        CHECK(sane(i > 0 ? picture : first, WIDTH * WIDTH, 10));
        if (i > 0 && !CHECK_CASE("Extremes", "surface cut by polygons, scaled by 1e-6 to 1e8", "the same picture, rms",
                                 check_rms(picture, first, 4 * WIDTH * WIDTH), 1e-4,
                                 "round-off that grows with the world must not become a value"))
            printf("    %g: off by %g\n", scale, check_rms(picture, first, 4 * WIDTH * WIDTH));
        check_free_triangles(&triangles);
        sps_destroy(context);
    }
}

/* Distant invisible objects change nothing: a small triangle that comes first, or a backdrop as black as the
   background, behind a gas with its shadows. */
static void test_far_things(void) {
    static const double far_away[] = {1e3, 1e6, 1e9};
    for (int backdrop = 0; backdrop < 2; ++backdrop)
        for (size_t i = 0; i <= sizeof far_away / sizeof *far_away; ++i) {
            const double d = i > 0 ? far_away[i - 1] : 0;
            check_triangles triangles = {NULL, 0, 0, 0, 0};
            check_scene s;
            uniform_build(&s, 8, 1);
            for (int k = 0; k < 3; ++k) s.volume[0].albedo[k] = 0.8f;
            check_add_directional(&s, 1, -1, -1, 3);
            check_set3(s.view.camera.position, 0, 4, 10);
            check_perspective(&s.view.camera, 0.5);
            if (backdrop) {
                const double origin[3] = {-d, -d, -d}, u[3] = {2 * d, 0, 0}, v[3] = {0, 2 * d, 0};
                if (i > 0) check_add_quad(&triangles, origin, u, v);
            } else {
                const double origin[3] = {0, 1, d}, u[3] = {0.02, 0, 0}, v[3] = {0, 0.02, 0};
                const double floor[3] = {-4, -1.1, -4}, x[3] = {8, 0, 0}, z[3] = {0, 0, 8};
                if (i > 0) check_add_quad(&triangles, origin, u, v);
                check_add_quad(&triangles, floor, x, z);
                s.light[0].no_shadow = 1; /* depth maps are fitted to the meshes, and coarse if these lie far apart */
            }
            check_add_mesh(&s, &triangles, backdrop ? 0 : 0.5);
            RENDERS(&s, i > 0 ? rgba : other);
            for (int k = 3; k < 4 * PIXELS && backdrop; k += 4) rgba[k] = other[k]; /* it does count in alpha */
            if (i > 0 && !CHECK_CASE("Extremes", "invisible things as far as 1e9", "the picture without them",
                                     check_largest(rgba, other, 4 * PIXELS), 1e-6, "round-off"))
                printf("    %s at %g: off by %g\n", backdrop ? "backdrop" : "triangle", d,
                       check_largest(rgba, other, 4 * PIXELS));
            check_free_triangles(&triangles);
        }
}

/* The roof's shadow from a point light that moves away with increasing intensity becomes that of a directional light.
   Rays diverge by (width / distance), which moves an edge by 3 / distance of a pixel's 0.1: no edge is that close. */
static void test_far_point_lights(void) {
    static const double distances[] = {1e4, 1e5, 1e6, 1e7};
    for (size_t i = 0; i <= sizeof distances / sizeof *distances; ++i) {
        const double floor[3] = {-4, -1, -4}, x[3] = {8, 0, 0}, z[3] = {0, 0, 8};
        const double roof[3] = {-1.013, -0.6, -1.013}, u[3] = {2.03, 0, 0}, w[3] = {0, 0, 2.03};
        check_triangles triangles = {NULL, 0, 0, 0, 0};
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_set3(s.view.camera.position, 0, 8, 5);
        check_perspective(&s.view.camera, 0.9);
        check_add_quad(&triangles, floor, x, z);
        check_add_quad(&triangles, roof, u, w);
        check_add_mesh(&s, &triangles, 0.5);
        if (i > 0) {
            const double d = distances[i - 1];
            check_add_point(&s, -0.8 * d, 0.6 * d, 0, 3 * d * d);
        } else {
            check_add_directional(&s, 0.8, -0.6, 0, 3);
        }
        RENDERS(&s, i > 0 ? rgba : other);
        CHECK(sane(rgba, PIXELS, 1));
        if (i > 0 && !CHECK_CASE("Extremes", "point light at 1e4 to 1e7", "the directional light's picture, rms",
                                 check_rms(rgba, other, 4 * PIXELS), 100 / distances[i - 1] + 1e-5,
                                 "rays diverge by width / distance"))
            printf("    at %g: off by %g\n", distances[i - 1], check_rms(rgba, other, 4 * PIXELS));
        check_free_triangles(&triangles);
    }
}

/* A picture of ever smaller width: right until footprints would exceed the range of floats, and then refused. */
static void test_zoom(void) {
    int refused = 0;
    for (int power = 0; power >= -30; power -= 3) {
        check_scene s;
        sps_result result;
        uniform_build(&s, 8, 1);
        check_orthographic(&s.view.camera, pow(10, power));
        result = render_fresh(&s, rgba);
        if (result == SPS_OK) {
            CHECK(!refused);
            /* the pixels' own depth: 2, of kernels cut at 3.3 standard deviations */
            CHECK_CASE("Extremes", "pictures as narrow as floats allow, 1 to 1e-30", "optical depth 2, or refused",
                       fabs(optical_depth(middle(rgba)) - 2), 0.01, "kernels cut at 3.3 standard deviations");
        } else {
            CHECK(result == SPS_ERROR_UNSUPPORTED || result == SPS_ERROR_ARGUMENT);
            refused = 1;
        }
    }
    CHECK(refused);
}

/* A faint box is at the same distance as a dense one: its middle is 10 away. */
static void test_faint_distance(void) {
    static const double extinctions[] = {1e-12, 1e-9, 1e-7, 1e-3};
    sps_context *context = sps_create(NULL, NULL);
    for (size_t i = 0; i < sizeof extinctions / sizeof *extinctions; ++i) {
        check_scene s;
        uniform_build(&s, 16, extinctions[i]);
        if (!check_render_depth(context, &s, rgba, depth)) continue;
        CHECK_CASE("Extremes", "distance of gas of extinction 1e-12 to 1e-3", "the middle of the box",
                   fabs((double)depth[SIDE / 2 * SIDE + SIDE / 2] - 10), 0.01,
                   "its own depth of 0.002 moves it by 3e-4; a tenth of a slab");
    }
    sps_destroy(context);
}

/* Numbers at the limits of their ranges, where products overflow floats: capped, and never NaN or infinite. Sheets are
   a voxel thick, and of these a diagonal has 14, and kernels reach beyond either end by 2.5. */
static void test_caps(void) {
    for (int n = 0; n < 4; ++n) {
        mixed m;
        mixed_build(&m);
        if (n < 2) {
            m.s.volume[0].transfer = &m.transfer;
            m.s.volume[0].shading = SPS_SHADING_SURFACE;
            m.s.volume[0].gradient_full = n == 0 ? 1e-39f : 1e-30f;
        } else { /* a light of 1e18 just above the floor, or in a small gas */
            sps_light *light = check_add_point(&m.s, 0, n == 2 ? -1 + 1e-11 : 0, 0, 1e18);
            light->no_shadow = 1;
            if (n == 3) mixed_transform(&m, 1e-12, 0), check_color(light->color, 1e18, 1e18, 1e18);
        }
        RENDERS(&m.s, rgba);
        if (!CHECK_CASE("Extremes",
                        "a light of 1e18 at 1e-11 from a floor, or in a gas of 1e-12; gradient_full of 1e-39",
                        "finite, not negative", !sane(rgba, PIXELS, 1e33), 0, "exact"))
            printf("    case %d\n", n);
        /* As the reference, within 2 % of the largest, as all pictures here. Gas 0.2 beside the lamp curves by 6 /
           0.2^2 of itself, of which a pixel's mean is off by a 24th of the square of its width, 0.14. */
        if (n < 3 && !CHECK(reference_error(&m.s, rgba) < (n == 2 ? 0.12 : 0.02)))
            printf("    case %d, error %g\n", n, reference_error(&m.s, rgba));
        if (n == 3) { /* the reference has 1e44 in doubles */
            sps_context *by = check_context(NULL);
            static float marched[4 * PIXELS];
            check_march(by, &m.s, 1, marched, NULL);
            CHECK(sane(marched, PIXELS, (double)FLT_MAX));
            sps_destroy(by);
        }
        for (int i = 0; i < 3 * PIXELS && n == 3; ++i) {
            const double value = (double)rgba[4 * (i / 3) + i % 3];
            CHECK(value >= (double)SPSI_RADIANCE_MAX * 0.999 && value <= 19 * (double)SPSI_RADIANCE_MAX);
        }
        mixed_free(&m);
    }
}

/* ------------------------------------------------------------------------------------------------------- the camera */

/* A uniform cube of optical depth 2 in 16 voxels: from the middle, half of it is seen; from a face, all of it except
   for the half kernel that spills over it, which holds sigma / sqrt(2 pi) voxels; along a face, half the value. */
static void test_camera_inside(void) {
    const double spill = 0.65 / sqrt(2 * 3.14159265358979) * 2 / 16;
    for (int i = 0; i < 6; ++i) {
        const double z[] = {0, 1, 10}, length[] = {1, 2 - spill, 2};
        check_scene s;
        double exact = length[i % 3];
        if (check_memory_only() && i % 2) continue;
        uniform_build(&s, 16, 1);
        check_set3(s.view.camera.position, i % 3 == 2 ? 1 : 0, 0, z[i % 3]);
        check_set3(s.view.camera.target, i % 3 == 2 ? 1 : 0, 0, z[i % 3] - 1);
        check_orthographic(&s.view.camera, 0.1); /* pixels smaller than voxels */
        check_perspective(&s.view.camera, i < 2 ? 0.3 : i == 2 ? 0.05 : 0);
        s.view.quality = SPS_QUALITY_ULTRA;
        if (i % 3 == 2) exact *= 0.5;
        RENDERS(&s, rgba);
        CHECK(sane(rgba, PIXELS, 0));
        if (!CHECK_CASE("Extremes", "camera inside a cube, on its face, along its face", "optical depth",
                        fabs(optical_depth(middle(rgba)) - exact), 0.01 * exact,
                        "ripple, and half a kernel spills over the face"))
            printf("    camera %d, %s\n", i % 3, i < 3 ? "perspective" : "orthographic");
        check_add_directional(&s, 0.1, 0.2, -1, 2);
        check_color(s.volume[0].albedo, 1, 1, 1);
        RENDERS(&s, rgba);
        if (!CHECK(reference_error(&s, rgba) < 0.02))
            printf("    camera %d, lit, error %g\n", i, reference_error(&s, rgba));
    }
}

static void test_wide_camera(void) {
    check_scene s;
    uniform_build(&s, 16, 0.5);
    check_set3(s.view.camera.position, 0, 0, 1.5);
    check_perspective(&s.view.camera, 120 * 3.14159265 / 180);
    RENDERS(&s, rgba);
    CHECK(sane(rgba, PIXELS, 0));
    CHECK_CASE("Extremes", "field of view of 120 degrees", "optical depth in the middle",
               fabs(optical_depth(middle(rgba)) - 1), 0.01, "ripple of medium quality, 0.4 %, of eye and faces");
    CHECK(reference_error(&s, rgba) < 0.02);
    check_color(s.volume[0].albedo, 1, 1, 1);
    check_add_directional(&s, 1, 0, 0.2, 2)->no_shadow = 1;
    RENDERS(&s, rgba);
    CHECK(reference_error(&s, rgba) < 0.02);
    s.light[0].no_shadow = 0;
    RENDERS(&s, rgba);
    CHECK(reference_error(&s, rgba) < 0.02);
    check_force_sheets(&s);
    CHECK(render_fresh(&s, rgba) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sentence, "view.camera.field_of_view is 2.0944:") && strstr(sentence, "no_shadow on light[0]"));
}

/* 168 degrees from corner to corner is the limit for slabs across the view: beyond it, the image is cut into parts. A
   light that is to shade by sheets is refused. */
static void test_widest_camera(void) {
    for (int n = 0; n < 4; ++n) {
        const int lit = n & 1, matrix = n >> 1;
        double world_to_clip[16] = {0};
        check_scene s;
        uniform_build(&s, 16, 0.5);
        check_set3(s.view.camera.position, 0, 0, 0);
        check_set3(s.view.camera.target, 0, 0, -1);
        if (lit) check_add_directional(&s, 1, 0, 0.2, 2)->shadow_source = SPS_SHADOW_SHEETS;
        check_color(s.volume[0].albedo, 1, 1, 1);
        for (int wide = 0; wide < 2; ++wide) {
            const double angle = wide ? 2.9 : 2.8;
            world_to_clip[0] = world_to_clip[5] = 1 / tan(0.5 * angle);
            world_to_clip[10] = world_to_clip[11] = world_to_clip[14] = -1;
            if (matrix)
                check_matrix(&s.view.camera, world_to_clip);
            else
                check_perspective(&s.view.camera, angle);
            s.view.no_shadows = lit;
            RENDERS(&s, rgba);
            CHECK_CASE("Extremes", "168 degrees from corner to corner, and more", "brute force",
                       reference_error(&s, rgba), 0.02,
                       "ripple of medium quality, 0.4 %, for eye and light, a depth of up to 2");
            s.view.no_shadows = 0;
            if (!lit) continue;
            CHECK(render_fresh(&s, rgba) == SPS_ERROR_UNSUPPORTED);
            CHECK(strstr(sentence, matrix ? "view.camera.world_to_clip is too wide:"
                                          : "view.camera.field_of_view is 2.") != NULL);
            CHECK(strstr(sentence, "narrow it, or set shadow_source or no_shadow on light[0]") != NULL);
        }
    }
}

/* Up along the view, or zero: an axis is chosen, the same for both; the middle pixel's ray does not change. */
static void test_up(void) {
    mixed m;
    float kept[4];
    mixed_build(&m);
    RENDERS(&m.s, rgba);
    memcpy(kept, middle(rgba), sizeof kept);
    check_set3(m.s.view.camera.up, 0, 0, 0);
    RENDERS(&m.s, rgba);
    for (int i = 0; i < 3; ++i) m.s.view.camera.up[i] = 3 * (m.s.view.camera.position[i] - m.s.view.camera.target[i]);
    RENDERS(&m.s, other);
    CHECK_CASE("Extremes", "up parallel to the view, or 0", "an axis is chosen, the same for both",
               memcmp(rgba, other, sizeof rgba) != 0, 0, "same bits");
    CHECK(sane(rgba, PIXELS, 20));
    CHECK(check_largest(kept, middle(rgba), 4) < 0.01); /* slabs, texels and footprints differ */
    mixed_free(&m);
}

/* ------------------------------------------------------------------------------------------------------- the lights */

static void test_light_inside(void) {
    mixed m;
    sps_context *context = check_context(NULL);
    sps_plan_report report;
    sps_error_info info;
    char cosine[40];
    mixed_build(&m);
    check_set3(m.s.light[1].position, 0.1, 0.2, 0.1);
    check_force_sheets(&m.s);
    CHECK(render_fresh(&m.s, rgba) == SPS_ERROR_UNSUPPORTED);
    CHECK_CASE("Extremes", "light inside the gas that is to shade by sheets", "an error that names the light",
               !strstr(sentence,
                       "light[1] is inside or too close to the volumes: one of its rays meets the slabs at a cosine"),
               0, "exact");
    CHECK(sps_plan(context, &m.s.scene, &m.s.view, &report) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "light[1]") != NULL);
    sps_get_error(context, &info);
    snprintf(cosine, sizeof cosine, " at a cosine of %g,", info.value);
    CHECK(info.value < 0.1 && strstr(info.sentence, cosine) != NULL);
    CHECK(report.bytes == 0 && report.sweep_count == 0);
    m.s.light[1].no_shadow = 1;
    RENDERS(&m.s, rgba);
    CHECK(sane(rgba, PIXELS, 1e6));
    CHECK_OK(context, sps_plan(context, &m.s.scene, &m.s.view, &report));
    m.s.light[1].no_shadow = 0;
    m.s.scene.volume_count = 0; /* polygons have no such limit */
    RENDERS(&m.s, rgba);
    CHECK(sane(rgba, PIXELS, 1e6));
    sps_destroy(context);
    mixed_free(&m);
}

/* The light at the eye, directly opposite behind the cube, and both at an angle, against the reference. */
static void test_light_and_eye(void) {
    static const double places[][3] = {{0, 0, 10}, {0, 0, -10}, {3, 4, 10}, {-10, 0, -1}};
    for (int i = 0; i < 8; ++i) {
        check_scene s;
        const double *p = places[i % 4];
        if (check_memory_only() && i % 2) continue;
        uniform_build(&s, 12, 0.4);
        s.view.quality = SPS_QUALITY_ULTRA;
        check_perspective(&s.view.camera, 0.25);
        s.volume[0].read_fn = read_bumps;
        one_value = 1;
        {
            static double bumps = 0.01;
            s.volume[0].user = &bumps;
        }
        check_color(s.volume[0].albedo, 0.9, 0.9, 0.9);
        if (i < 4)
            check_add_point(&s, p[0], p[1], p[2], 100);
        else
            check_add_directional(&s, -p[0], -p[1], -p[2], 2);
        RENDERS(&s, rgba);
        if (!CHECK_CASE("Extremes", "light at the eye, opposite, at an angle", "brute force", reference_error(&s, rgba),
                        0.01, "ultra quality: ripple of eye and light on the whole depth"))
            printf("    light %d\n", i);
    }
}

/* A light perpendicular to the view: the same bits for a cosine of +0 and -0, and the two compositing orders at 1e-7 to
   either side. Each is within 1 % of the reference at ULTRA, so they agree to 2 %. */
static void test_square_light(void) {
    static const double cosines[] = {0.0, -0.0, 1e-7, -1e-7};
    static float images[4][4 * PIXELS];
    static double bumps = 0.01;
    for (int i = 0; i < 4; ++i) {
        check_scene s;
        uniform_build(&s, 12, 0.4);
        s.view.quality = SPS_QUALITY_ULTRA;
        s.volume[0].read_fn = read_bumps;
        s.volume[0].user = &bumps;
        check_color(s.volume[0].albedo, 0.9, 0.9, 0.9);
        check_add_directional(&s, -1, -0.5, -cosines[i], 2); /* the eye's rays travel along -z */
        RENDERS(&s, images[i]);
        if (!CHECK_CASE("Extremes", "light perpendicular to the view: l.v = +0, -0, 1e-7, -1e-7", "brute force",
                        reference_error(&s, images[i]), 0.01,
                        "ultra quality: ripple of eye and light on the whole depth"))
            printf("    cosine %g\n", cosines[i]);
    }
    CHECK_CASE("Extremes", "l.v = +0 and -0", "the same picture", memcmp(images[0], images[1], sizeof images[0]) != 0,
               0, "same bits");
    CHECK(check_largest(images[0], images[2], 4 * PIXELS) < 1e-5);
    CHECK_CASE("Extremes", "l.v = 1e-7 and -1e-7, front to back and back to front", "nearly the same picture",
               check_largest(images[2], images[3], 4 * PIXELS), 0.02, "each is within 1 % of brute force");
    CHECK(check_largest(images[2], images[3], 4 * PIXELS) > 0); /* the orders do differ */
}

/* ------------------------------------------------------------------------------------------------------------ slabs */

/* 1e5 slabs through three voxels: a sum of that many floats is accurate to 1e5 half-units in the last place, 0.6 %. The
   other extreme is a single sheet of any thickness. */
static void test_slab_counts(void) {
    const double slabs[] = {7e-5, 1, 1e3, 1e9, 1e30, DBL_MAX};
    for (size_t i = 0; i < sizeof slabs / sizeof *slabs; ++i) {
        sps_context *context = check_context(NULL);
        sps_stats_report stats;
        check_scene s;
        sps_volume *volume = uniform_build(&s, 3, 0.5);
        volume->placement = check_box(-3.5, -3.5, -1, 3.5, 3.5, 1); /* the rim is far away */
        volume->size[0] = volume->size[1] = 7;
        check_color(volume->albedo, 0.5, 0.5, 0.5);
        check_add_directional(&s, 0.2, 0.1, -1, 2);
        s.view.width = s.view.height = 3;
        check_orthographic(&s.view.camera, 0.3);
        s.view.shadow_resolution = 16; /* only slabs matter; a light's sheets would take most of the time */
        s.view.slab_thickness = slabs[i];
        check_render(context, &s, rgba);
        sps_get_stats(context, &stats);
        if (i == 0) CHECK(stats.slabs >= 100000 && stats.slabs < (1 << 20));
        if (i > 1) CHECK(stats.slabs == 1);
        if (!CHECK_CASE("Extremes", "1e5 sheets, and one", "optical depth 1", fabs(optical_depth(rgba + 4 * 4) - 1),
                        0.01, "1e5 floats add up to 0.6 %; ripple 0.4 %") ||
            !CHECK(sane(rgba, 9, 0.2)))
            printf("    slabs of %g voxels\n", slabs[i]);
        sps_destroy(context);
    }
}

/* A dense sheet, one voxel thick, for any position of the slab planes and any rotation of the sheet. */
static void test_dense_sheet(void) {
    for (int i = 0; i < 8; ++i) {
        const double angle = i % 4 * 0.25, slab = i < 4 ? 0.5 : 3;
        check_scene s;
        sps_volume *volume = uniform_build(&s, 64, 5 * 64 / 2.0 * cos(angle));
        volume->size[2] = 1;
        volume->placement = check_box(-1, -1, 0, 1, 1, 2 / 64.0);
        volume->placement.origin[2] = 0.0123 * i;
        check_orthographic(&s.view.camera, 0.3);
        s.view.slab_thickness = slab;
        check_set3(s.view.camera.position, 10 * sin(angle), 0, 10 * cos(angle));
        RENDERS(&s, rgba);
        if (!CHECK_CASE("Extremes", "sheet of depth 5, one voxel thick, anywhere between slabs",
                        "exp(-5) passes, relative", fabs((1 - (double)middle(rgba)[3]) / exp(-5.0) - 1), 0.02,
                        "ripple of 0.4 % of 5"))
            printf("    angle %g, slab %g\n", angle, slab);
    }
}

/* A wire of single voxels along the diagonal: the sum of its kernels' line integrals, at every pixel. */
static int read_wire(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int j = 0; j < size[1]; ++j)
        for (int i = 0; i < size[0]; ++i) *out++ = (float)(lo[0] + i == lo[1] + j);
    return 0;
}

static double wire_depth(double x, double y) {
    double sum = 0;
    for (int i = 0; i < 20; ++i) {
        const double dx = (x - i - 0.5) / 0.65, dy = (y - i - 0.5) / 0.65;
        sum += exp(-0.5 * (dx * dx + dy * dy));
    }
    return sum / (2 * 3.14159265358979 * 0.65 * 0.65);
}

static void test_wire(void) {
    check_scene s;
    sps_volume *volume;
    double worst = 0;
    check_clear(&s, SIDE, SIDE);
    volume = check_add_volume(&s, 20, 20, 1, check_box(0, 0, 0, 20, 20, 1));
    volume->read_fn = read_wire;
    volume->user = &s;
    volume->extinction = 1;
    check_set3(s.view.camera.position, 10.2, 9.9, 30);
    check_set3(s.view.camera.target, 10.2, 9.9, 0);
    check_orthographic(&s.view.camera, 5);
    s.view.quality = SPS_QUALITY_ULTRA;
    RENDERS(&s, rgba);
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x) {
            const double pixel = 5.0 / (double)SIDE, wx = 10.2 + (x - SIDE / 2) * pixel,
                         wy = 9.9 - (y - SIDE / 2) * pixel;
            worst = fmax(worst, fabs(optical_depth(rgba + 4 * (y * SIDE + x)) - wire_depth(wx, wy)));
        }
    CHECK_CASE("Extremes", "wire of single voxels along the diagonal", "the sum of their kernels", worst, 0.005 * 0.38,
               "kernels end at 6e-4 of their peak, 0.38, and are rescaled to compensate");
}

/* ------------------------------------------------------------------------------------------------------- everything */

/* Products of tiny numbers are 0, not denormal. */
static void test_denormal_results(void) {
    const double extinctions[] = {1e-10, 30, 40, 44, 60};
    for (size_t i = 0; i < sizeof extinctions / sizeof *extinctions; ++i) {
        check_scene s;
        float value = i == 0 ? 1e-29f : 1;
        sps_volume *volume = uniform_build(&s, 16, extinctions[i]);
        volume->user = &value;
        check_orthographic(&s.view.camera, 3); /* beyond the rims */
        check_color(volume->albedo, 1e-6, 1e-3, 1);
        check_color(s.scene.background, 1e-6, 1e-3, 1);
        check_add_directional(&s, 0.3, 0.4, 1, 1e-3);
        check_add_directional(&s, 0.3, 0.4, -1, 1e-3);
        RENDERS(&s, rgba);
        if (!CHECK_CASE("Extremes", "exp underflows, products of tiny numbers",
                        "0, and never denormal, NaN or negative", !sane(rgba, PIXELS, 2), 0, "exact"))
            printf("    extinction %g\n", extinctions[i]);
    }
}

static void test_everything_is_sane(void) {
    for (int i = 0; i < 6; i += check_memory_only() ? 2 : 1) {
        mixed m;
        mixed_build(&m);
        if (i == 1) m.s.volume[0].extinction = 1e8f;
        if (i == 2) m.lobe.asymmetry = 0.99f;
        if (i == 3) m.lobe.asymmetry = -0.99f;
        if (i == 4) m.s.volume[0].transfer = &m.transfer, m.s.volume[0].shading = SPS_SHADING_SURFACE;
        if (i == 5) m.s.view.near_distance = 4.9;
        RENDERS(&m.s, rgba);
        if (!CHECK(sane(rgba, PIXELS, 5e4))) printf("    scene %d\n", i);
        mixed_free(&m);
    }
}

int main(void) {
    RUN(test_arguments);
    RUN(test_error_objects);
    RUN(test_error_info);
    RUN(test_image_argument);
    RUN(test_matrix_arguments);
    RUN(test_flat_placements);
    RUN(test_too_many_volumes);
    RUN(test_too_many_sets);
    RUN(test_largest_volume);
    RUN(test_bad_of_both);
    RUN(test_bad_values);
    RUN(test_bad_range);
    RUN(test_bad_triangles);
    RUN(test_degenerate_triangles);
    RUN(test_bad_callbacks);
    RUN(test_failing_callbacks);
    RUN(test_large_and_small_values);
    if (!check_memory_only()) RUN(test_optical_depths);
    RUN(test_largest_allowed);
    RUN(test_caps);
    RUN(test_many_thin_slabs);
    RUN(test_empty_scenes);
    RUN(test_no_image);
    RUN(test_one_pixel);
    RUN(test_one_voxel);
    RUN(test_no_lights);
    RUN(test_uneven_voxels);
    if (!check_memory_only()) RUN(test_scales_and_origins);
    RUN(test_scales_of_near_voxels);
    RUN(test_scales_of_cut_surfaces);
    RUN(test_near_kernels_left_out);
    RUN(test_far_things);
    RUN(test_far_point_lights);
    RUN(test_zoom);
    RUN(test_faint_distance);
    RUN(test_camera_inside);
    RUN(test_wide_camera);
    RUN(test_widest_camera);
    RUN(test_up);
    RUN(test_light_inside);
    RUN(test_light_and_eye);
    if (!check_memory_only()) RUN(test_square_light);
    if (!check_memory_only()) RUN(test_slab_counts);
    RUN(test_dense_sheet);
    RUN(test_wire);
    RUN(test_denormal_results);
    RUN(test_everything_is_sane);
    return check_report();
}
