/* Figures of the plan and of the statistics of a scene under two lights, by those of the scene under each: what lights
   do for themselves adds up, what is done for all is the same, and bounds are the larger. In any order of lists. */

#include "check.h"

#include <stddef.h>

enum { WIDTH = 40, HEIGHT = 28 };
static sps_context *context;
static float image[4 * WIDTH * HEIGHT];
static check_triangles floor_faces, pane_faces;

enum { BY_SHEETS, BY_TABLES, WIDE, SPREADING, THROWN, KINDS };
static const char *const kinds[] = {"suns by sheets", "lights by tables", "suns with an extent", "spreading", "images"};

typedef struct outcome {
    sps_plan_report plan;
    sps_stats_report stats;
} outcome;

static int white(void *user, size_t count, const float *uv, float *out) {
    (void)user, (void)uv;
    for (size_t i = 0; i < 3 * count; ++i) out[i] = 1;
    return 0;
}

static void add_light(check_scene *s, int kind, int second) {
    static sps_projector slides[2];
    sps_projector *slide = &slides[second];
    sps_light *light;
    if (kind == THROWN || (kind == BY_TABLES && second)) {
        light = check_add_point(s, second ? -2 : 1.5, 3, 2, 20);
        check_set3(light->direction, -light->position[0], -3, -2);
        light->outer_cone = 0.5;
        memset(slide, 0, sizeof *slide);
        slide->width = second ? 40 : 16, slide->height = second ? 20 : 8, slide->sample_fn = white;
        slide->left = slide->bottom = -0.5, slide->right = slide->top = 0.5;
        if (kind == THROWN) light->projector = slide;
    } else {
        light = check_add_directional(s, second ? 1 : -0.3, -1, second ? -0.2 : -0.7, 2);
    }
    light->shadow_source = kind == BY_TABLES ? SPS_SHADOW_TABLE : SPS_SHADOW_SHEETS;
    if (kind == WIDE) light->angular_diameter = second ? 0.1 : 0.05, light->samples = second ? 24 : 16;
}

static int values(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i)
        out[i] = 1 + 0.5f * sinf(0.4f * (float)(low[0] + i % size[0]));
    return 0;
}

/* Gas, opaque under suns by sheets, and a floor; under suns, a pane. */
static void start(check_scene *s, int kind) {
    static const double corner[3] = {-3, -1.2, -3}, along[3] = {0, 0, 6}, side[3] = {6, 0, 0};
    static const double low[3] = {-0.5, -1, 1.3}, right[3] = {2, 0, 0.3}, up[3] = {0, 2, 0};
    static const sps_lobe lobe = {0.8f, 1};
    sps_volume *gas;
    check_clear(s, WIDTH, HEIGHT);
    check_set3(s->view.camera.position, 0.5, 1, 5);
    check_perspective(&s->view.camera, 0.4);
    for (int n = 0; n < 2; ++n) { /* the second one far behind */
        const double z = n ? -9 : 0;
        gas = check_add_volume(s, n ? 12 : 40, n ? 10 : 28, n ? 8 : 24, check_box(-1, -0.8, z - 0.7, 1, 0.8, z + 0.7));
        gas->read_fn = values, gas->extinction = kind == BY_SHEETS ? 30 : 1.5f;
        gas->lobes = &lobe, gas->lobe_count = 1;
        check_color(gas->albedo, 0.9, 0.7, 0.4);
    }
    floor_faces.count = pane_faces.count = 0;
    check_add_quad(&floor_faces, corner, along, side);
    check_add_quad(&pane_faces, low, right, up);
    check_add_mesh(s, &floor_faces, 0.5);
    if (kind == BY_SHEETS || kind == WIDE)
        check_color(check_add_mesh(s, &pane_faces, 0.2)->transmittance, 0.5, 0.7, 0.9);
    s->view.scattering = kind == SPREADING ? SPS_SCATTERING_CONVOLUTION : SPS_SCATTERING_SINGLE;
    s->view.scattering_resolution = 12;
    s->view.tolerance = 0.2f;
    if (kind == WIDE) s->view.filling = SPS_FILLING_SPLAT;
    if (kind == BY_SHEETS) check_perspective(&s->view.camera, 0.1);
}

/* Renders anew under the lights of that order: 0 or 1 alone, 2 both, 3 both in the other order. */
static int measure(int kind, int order, outcome *o) {
    static const int lists[4][2] = {{0, -1}, {1, -1}, {0, 1}, {1, 0}};
    check_scene s;
    int good;
    start(&s, kind);
    for (int i = 0; i < 2; ++i)
        if (lists[order][i] >= 0) add_light(&s, kind, lists[order][i]);
    context = check_context(NULL);
    good = CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &o->plan)) && check_render(context, &s, image);
    sps_get_stats(context, &o->stats);
    if (o->stats.layers == 0) CHECK(o->stats.bytes_peak <= o->plan.bytes); /* a bound without layers */
    sps_destroy(context);
    return good;
}

typedef enum relation {
    SUM,   /* each light's own */
    SWEPT, /* each sweep's own: lights by sheets have one each, those by tables share one */
    SAME,  /* for all lights */
    MOST   /* a bound or a size */
} relation;

static double figure(const outcome *o, size_t at, int size) {
    const char *p = (const char *)o + at;
    if (size < 0) return (double)*(const float *)(const void *)p;
    return size == 8 ? (double)*(const uint64_t *)(const void *)p : (double)*(const int *)(const void *)p;
}

#define FIGURE(part, name, is)                                                                                         \
    { #name, offsetof(outcome, part.name), (int)sizeof((outcome *)0)->part.name, is }
#define FLOAT_FIGURE(part, name, is)                                                                                   \
    { #name, offsetof(outcome, part.name), -4, is }

static const struct {
    const char *name;
    size_t at;
    int size; /* in bytes; negative: of a float */
    relation is;
} counted[] = {
    FIGURE(plan, sweep_count, SWEPT),     FIGURE(plan, color_channels, SAME),
    FIGURE(plan, slab_count, MOST),       FIGURE(plan, shadow_width, MOST),
    FIGURE(plan, shadow_height, MOST),    FIGURE(plan, light_points, MOST),
    FIGURE(plan, read_calls, SAME),       FIGURE(plan, triangle_calls, SAME),
    FIGURE(plan, projector_calls, SUM),   FIGURE(plan, voxels_read, SAME),
    FIGURE(stats, read_calls, SAME),      FIGURE(stats, triangle_calls, SAME),
    FIGURE(stats, projector_calls, SUM),  FIGURE(stats, voxels_read, SAME),
    FIGURE(stats, voxels_relevant, SAME), FIGURE(stats, bricks, SAME),
    FIGURE(stats, triangles, SAME),       FIGURE(stats, pixels_of_polygons, SAME),
    FIGURE(stats, layers, SAME),          FIGURE(stats, shadow_rays, SUM),
    FIGURE(stats, slabs, SWEPT),          FIGURE(stats, slabs_empty, SWEPT),
    FIGURE(stats, eye_footprints, SWEPT), FIGURE(stats, eye_fragments, SWEPT),
    FIGURE(stats, light_footprints, SUM), FIGURE(stats, light_fragments, SUM),
    FIGURE(stats, eye_samples, SWEPT),    FIGURE(stats, light_samples, SUM),
    FLOAT_FIGURE(stats, eye_bound, MOST), FLOAT_FIGURE(stats, light_bound, MOST),
    FIGURE(stats, tables_made, SUM),      FIGURE(stats, cells, SUM),
    FIGURE(stats, soft_texels, SUM),      FIGURE(stats, pixels_shaded, SWEPT),
    FIGURE(stats, tiles_finished, SWEPT),
};

static void test_two_lights(void) {
    static outcome o[4];
    static int seen[sizeof counted / sizeof *counted];
    for (int kind = 0; kind < KINDS; ++kind) {
        for (int order = 0; order < 4; ++order)
            if (!measure(kind, order, &o[order])) return;
        for (size_t i = 0; i < sizeof counted / sizeof *counted; ++i) {
            const int sums = counted[i].is == SUM || (counted[i].is == SWEPT && kind != BY_TABLES);
            double of[4], right;
            for (int order = 0; order < 4; ++order) of[order] = figure(&o[order], counted[i].at, counted[i].size);
            right = sums ? of[0] + of[1] : counted[i].is == MOST ? fmax(of[0], of[1]) : of[0];
            seen[i] |= right > 0;
            if (!CHECK(of[2] == right) || !CHECK(of[3] == right) || !CHECK(counted[i].is != SAME || of[1] == right))
                printf("    %s, %s: %g, %g, both %g, %g\n", kinds[kind], counted[i].name, of[0], of[1], of[2], of[3]);
        }
    }
    for (size_t i = 0; i < sizeof counted / sizeof *counted; ++i)
        if (!CHECK(seen[i])) printf("    %s is 0 everywhere\n", counted[i].name);
    check_free_triangles(&floor_faces), check_free_triangles(&pane_faces);
}

int main(void) {
    RUN(test_two_lights);
    return check_report();
}
