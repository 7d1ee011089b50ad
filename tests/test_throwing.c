/* Callbacks that leave a call by an exception in C++, and by longjmp in C, which they must not do. Then nothing is
   left to rely on but that sps_destroy returns all memory. Every kind of callback leaves at many of its calls. */

#include "check.h"

#include <setjmp.h>

typedef enum kind {
    ALLOC,
    PARALLEL_FOR,
    PROGRESS,
    MESSAGE,
    CLOCK,
    VOXELS, /* read_fn, range_fn, eval_fn of volumes */
    RANGE,
    EVAL,
    TRANSFER,
    TRIANGLES,
    SHADE,
    PARTICLES,
    SAMPLE,
    BACKGROUND,
    KINDS
} kind;

static const char *const kind_names[KINDS] = {
    "alloc_fn",       "parallel_for_fn",   "progress_fn",         "message_fn",         "clock_fn",
    "volume.read_fn", "volume.range_fn",   "volume.eval_fn",      "transfer.eval_fn",   "mesh.read_fn",
    "mesh.shade_fn",  "particles.read_fn", "projector.sample_fn", "scene.background_fn"};

typedef enum call { RENDER, RENDER_AGAIN, REFERENCE, PLAN, MAP, CALLS } call;

/* What callbacks share: which of them leaves, and when. */
static struct {
    kind leaves;
    long at, calls; /* of that kind, from 1; 0: none */
    long all[KINDS];
    jmp_buf way_out;
    check_hooks hooks;
} state;

static check_triangles triangles;
static float pixels[4 * 64 * 64];
static check_field puff = {check_puff, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

static void called(kind which) {
    state.all[which] += 1;
    if (which != state.leaves || ++state.calls != state.at) return;
#ifdef __cplusplus
    throw which;
#else
    longjmp(state.way_out, 1);
#endif
}

static void *alloc(void *user, size_t size) {
    called(ALLOC);
    return check_alloc(user, size);
}

static void parallel_for(void *user, int count, sps_task_fn task, void *data) {
    (void)user;
    for (int i = 0; i < count; ++i) {
        if (i == count / 2) called(PARALLEL_FOR);
        task(data, i, i % 2);
    }
}

static int progress(void *user, float fraction) {
    (void)user, (void)fraction;
    called(PROGRESS);
    return 0;
}

static void message(void *user, const char *text) {
    (void)user, (void)text;
    called(MESSAGE);
}

static double clock_of(void *user) {
    called(CLOCK);
    return check_hasty_clock(user);
}

static int read_voxels(void *user, const int lo[3], const int size[3], float *out) {
    called(VOXELS);
    return check_read_constant(user, lo, size, out);
}

static int range_of(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    (void)user, (void)lo, (void)size;
    called(RANGE);
    out_min_max[0] = out_min_max[1] = *(float *)user;
    return 0;
}

static int eval_voxels(void *user, size_t count, const double *positions, float *out) {
    called(EVAL);
    return check_eval_field(user, count, positions, out);
}

static int eval_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    (void)user;
    called(TRANSFER);
    for (size_t i = 0; i < count; ++i) out[i].albedo[0] = 0.5f, out[i].extinction = values[i];
    return 0;
}

static int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    called(TRIANGLES);
    return check_read_triangles(user, first, count, out);
}

static int shade(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user, (void)count, (void)points, (void)out;
    called(SHADE);
    return 0;
}

static int read_particles(void *user, size_t first, size_t count, sps_particle *out) {
    called(PARTICLES);
    return check_read_particles(user, first, count, out);
}

static int sample(void *user, size_t count, const float *uv, float *out) {
    (void)user;
    called(SAMPLE);
    for (size_t i = 0; i < 3 * count; ++i) out[i] = uv[i / 3 * 2];
    return 0;
}

static int background(void *user, size_t count, const float *directions, float *out) {
    (void)user;
    called(BACKGROUND);
    for (size_t i = 0; i < 3 * count; ++i) out[i] = directions[i] * directions[i];
    return 0;
}

/* Something that calls every callback: three volumes, of which one emits nothing but messages, particles, a textured
   and a translucent mesh; a slide, a sun with a table, a sun with sheets, an area light. */
static void build(check_scene *s, call which) {
    static const sps_tmap_settings list = {0, SPS_TMAP_DEEP};
    static float one = 1;
    static sps_projector slide;
    static sps_transfer transfer;
    const double corner[3] = {-2, -1.1, 1}, u[3] = {4, 0, 0}, v[3] = {0, 0.5, -3};
    check_clear(s, which == RENDER_AGAIN ? 40 : 16, 16);
    check_orthographic(&s->view.camera, 2.6);
    s->view.quality = SPS_QUALITY_DRAFT;
    s->view.scattering = which == REFERENCE ? SPS_SCATTERING_SINGLE : SPS_SCATTERING_MULTIPLE;
    s->view.scattering_resolution = 6;
    check_add_puff(s, 3)->eval_fn = eval_voxels;
    s->volume[0].user = &puff;
    s->volume[0].revision = which == RENDER_AGAIN ? 2 : 1;
    for (int i = 1; i < 3; ++i) {
        sps_volume *box = check_add_volume(s, 36, 4, 4, check_box(-0.5, -1, 0.2 * i, 1, -0.4, 0.2 * i + 0.5));
        box->read_fn = read_voxels, box->range_fn = range_of, box->user = &one;
        box->extinction = 1;
        box->revision = s->volume[0].revision;
    }
    for (int i = 0; i < 3; ++i) check_color(s->volume[i].albedo, 0.7, 0.6, 0.5);
    memset(&transfer, 0, sizeof transfer);
    transfer.eval_fn = eval_transfer;
    s->volume[2].transfer = &transfer;
    check_add_swarm(s, 0.4)->read_fn = read_particles;
    triangles.count = 0;
    check_add_quad(&triangles, corner, u, v);
    for (int i = 0; i < 2; ++i) check_add_mesh(s, &triangles, 0.5)->read_fn = read_triangles;
    s->mesh[0].shade_fn = shade;
    s->mesh[1].placement = check_box(0, 1, 0, 0.3, 2, 0.3);
    check_translucent(&s->mesh[1], 0.5);
    check_add_directional(s, 0.3, -1, -0.4, 3)->shadow_source = SPS_SHADOW_TABLE;
    s->light[0].shadow_map_resolution = 24;
    check_add_directional(s, 0.2, -0.5, -1, 2)->shadow_source = SPS_SHADOW_SHEETS;
    if (which != REFERENCE) s->light[1].angular_diameter = 0.1, s->light[1].samples = 8;
    memset(&slide, 0, sizeof slide);
    slide.width = slide.height = 8, slide.sample_fn = sample;
    slide.left = slide.bottom = -1, slide.right = slide.top = 1;
    check_add_point(s, 0, 2, 2, 5)->projector = &slide;
    check_set3(s->light[2].direction, 0, -1, -1);
    check_add_directional(s, -0.3, -1, -0.2, 1)->shadow_map = &list;
    s->scene.background_fn = background;
    s->view.shadow_resolution = 16;
}

/* Makes the call, and returns its result; the map, if it is one, is left in *map. */
static sps_result make(sps_context *context, call which, sps_tmap *volatile *map) {
    check_scene s;
    sps_image image = {pixels, NULL, 0};
    sps_reference_settings settings;
    sps_plan_report report;
    build(&s, which);
    memset(&settings, 0, sizeof settings);
    settings.step = 4, settings.samples = 1;
    if (which == RENDER || which == RENDER_AGAIN) return sps_render(context, &s.scene, &s.view, &image);
    if (which == REFERENCE) return sps_reference(context, &s.scene, &s.view, &settings, &image);
    if (which == MAP) {
        const sps_tmap_light light = check_light_of(&s.view);
        sps_tmap_settings list;
        memset(&list, 0, sizeof list);
        list.technique = SPS_TMAP_DEEP;
        list.near_depth = 9.9, list.far_depth = 10.1; /* gas lies beyond: a message */
        sps_tmap_create(context, &light, &list, (sps_tmap **)(size_t)map);
        if (*map && !sps_tmap_add(*map, &s.scene)) return sps_tmap_finish(*map);
        return SPS_ERROR_MEMORY;
    }
    sps_plan(context, NULL, &s.view, &report); /* an error: a message */
    return sps_plan(context, &s.scene, &s.view, &report);
}

/* After a callback has left a call, every kind of call is refused, again and again. */
static void refused(sps_context *context, sps_tmap *map) {
    check_scene s;
    for (int n = 0; n < 2; ++n)
        for (int which = 0; which < CALLS; ++which) {
            sps_tmap *volatile none = NULL;
            if (which != MAP) CHECK(make(context, (call)which, &none) == SPS_ERROR_CALLBACK);
            if (which == MAP) CHECK(make(context, MAP, &none) == SPS_ERROR_MEMORY && !none);
            CHECK(strstr(sps_error(context), "threw or jumped out of an earlier call"));
        }
    build(&s, MAP);
    if (map) CHECK(sps_tmap_add(map, &s.scene) == SPS_ERROR_CALLBACK && sps_tmap_finish(map) == SPS_ERROR_CALLBACK);
}

/* Makes a call that a callback leaves at its at-th call of that kind, and destroys what there is. KINDS: none leaves.
 */
static void leave(call which, kind leaves, long at) {
    sps_config config;
    sps_context *context;
    sps_tmap *volatile map = NULL;
    volatile int left = 0;
    memset(&state, 0, sizeof state);
    config = check_config(&state.hooks);
    config.alloc_fn = alloc, config.progress_fn = progress, config.message_fn = message, config.clock_fn = clock_of;
    config.parallel_for_fn = parallel_for, config.worker_count = 2;
    state.leaves = KINDS;
    context = sps_create(&config, NULL);
    if (which == RENDER_AGAIN) make(context, RENDER, &map);
    memset(state.all, 0, sizeof state.all);
    state.leaves = leaves, state.at = at;
#ifdef __cplusplus
    try {
        CHECK_OK(context, make(context, which, &map));
    } catch (kind) { left = 1; }
#else
    if (setjmp(state.way_out) == 0)
        CHECK_OK(context, make(context, which, &map));
    else
        left = 1;
#endif
    state.leaves = KINDS;
    CHECK(left == (leaves != KINDS));
    if (left) refused(context, map);
    sps_tmap_destroy(map);
    sps_destroy(context);
    if (!CHECK_CASE("Engineering", "callbacks that throw, which they must not", "bytes left after sps_destroy",
                    (double)state.hooks.live, 0, "exact") ||
        !CHECK(state.hooks.live_blocks == 0))
        printf("    call %d, %s, %ld of them\n", (int)which, kind_names[leaves], at);
}

/* The first call of each kind leaves, and some later ones of callbacks that are called in the middle of work. */
static void test_throwing(void) {
    long times[KINDS] = {0};
    for (int which = 0; which < CALLS; ++which) {
        long counts[KINDS];
        leave((call)which, KINDS, 0);
        memcpy(counts, state.all, sizeof counts);
        for (int leaves = 0; leaves < KINDS; ++leaves)
            for (long at = 1; at <= counts[leaves] && (at == 1 || leaves <= CLOCK);
                 at += check_long() ? 1 + at / 8 : 15 * at) {
                leave((call)which, (kind)leaves, at);
                times[leaves] += 1;
            }
    }
    for (int leaves = 0; leaves < KINDS; ++leaves)
        if (!CHECK(times[leaves] >= 2)) printf("    %s: %ld\n", kind_names[leaves], times[leaves]);
}

/* A callback that calls into its own context gets an error, and so does the call that it interrupts; after that, the
   context can be used. message_fn does the same in turn, and is told once. */
static struct {
    sps_context *context;
    int calls, told;
    sps_result within;
} inner;

static int read_inner(void *user, const int lo[3], const int size[3], float *out) {
    sps_plan_report report;
    if (inner.calls++ == 0) inner.within = sps_plan(inner.context, NULL, NULL, &report);
    return check_read_constant(user, lo, size, out);
}

static void message_inner(void *user, const char *text) {
    sps_plan_report report;
    (void)user;
    inner.told += strstr(text, "called into its own context") != NULL;
    CHECK(sps_plan(inner.context, NULL, NULL, &report) == SPS_ERROR_CALLBACK);
}

static void test_calls_within(void) {
    static float one = 1;
    check_hooks hooks;
    check_scene s;
    sps_config config;
    sps_image image = {pixels, NULL, 0};
    memset(&hooks, 0, sizeof hooks), memset(&inner, 0, sizeof inner);
    config = check_config(&hooks);
    config.message_fn = message_inner;
    inner.context = sps_create(&config, NULL);
    check_clear(&s, 8, 8);
    check_orthographic(&s.view.camera, 2.6);
    check_add_volume(&s, 4, 4, 4, check_box(-1, -1, -1, 1, 1, 1))->read_fn = read_inner;
    s.volume[0].user = &one, s.volume[0].extinction = 1;
    CHECK(sps_render(inner.context, &s.scene, &s.view, &image) == SPS_ERROR_CALLBACK && inner.told == 1);
    CHECK(inner.within == SPS_ERROR_CALLBACK && strstr(sps_error(inner.context), "called into its own context"));
    CHECK_OK(inner.context, sps_render(inner.context, &s.scene, &s.view, &image));
    s.view.width = -1; /* an error that message_fn is told, which then causes the other one */
    CHECK(sps_render(inner.context, &s.scene, &s.view, &image) == SPS_ERROR_CALLBACK && inner.told == 2);
    s.view.width = 8;
    CHECK_OK(inner.context, sps_render(inner.context, &s.scene, &s.view, &image));
    sps_destroy(inner.context);
    CHECK(hooks.live == 0);
}

int main(void) {
    RUN(test_throwing);
    RUN(test_calls_within);
    check_free_triangles(&triangles);
    return check_report();
}
