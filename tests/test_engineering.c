/* Properties of every picture: failures of any hook leak nothing, memory stays within the plan, and the same scene has
   the same bits for any number of workers, any region, any context and any order of calls. Also the messages of the
   command line, build/render. */

#include "check.h"
#include "command_line.h"
#include "splatshadow.h" /* once more, below its own implementation */
#include <pthread.h>
#include <unistd.h>

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

static int called_now(mixed *m, called which) {
    m->of[which] += 1;
    return ++m->calls == m->fail_at;
}

static int mixed_range(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)lo;
    (void)size;
    out[0] = 0;
    out[1] = 1;
    return called_now((mixed *)user, RANGE);
}

static int mixed_read(void *user, const int lo[3], const int size[3], float *out) {
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) {
                const int x = lo[0] + i, y = lo[1] + j, z = lo[2] + k;
                *out++ = (float)((x * 7 + y * 3 + z * 5) % 11) / 11;
            }
    return called_now((mixed *)user, READ);
}

/* An off-centre blob. */
static int mixed_eval(void *user, size_t count, const double *p, float *out) {
    for (size_t i = 0; i < count; ++i, p += 3)
        out[i] = (float)exp(-6 * ((p[0] - 0.2) * (p[0] - 0.2) + p[1] * p[1] + (p[2] + 0.1) * (p[2] + 0.1)));
    return called_now((mixed *)user, EVAL);
}

static int mixed_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    mixed *m = (mixed *)user;
    for (size_t i = 0; i < count; ++i) {
        check_color(out[i].color, 0.9, 0.5 * (double)values[i], 0.3);
        out[i].extinction = (double)values[i] > m->threshold ? 9 : 0;
    }
    return called_now(m, TRANSFER);
}

static int mixed_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    mixed *m = (mixed *)user;
    memcpy(out, m->triangles.list + first, count * sizeof *out);
    return called_now(m, TRIANGLES);
}

static int mixed_background(void *user, size_t count, const float *directions, float *rgb) {
    for (size_t i = 0; i < count; ++i)
        check_color(rgb + 3 * i, 0.2, 0.3, 0.4 + 0.1 * fabs((double)directions[3 * i + 1]));
    return called_now((mixed *)user, BACKGROUND);
}

static int mixed_image(void *user, size_t count, const float *uv, float *rgb) {
    for (size_t i = 0; i < count; ++i, uv += 2, rgb += 3) check_color(rgb, (double)uv[0], (double)uv[1], 0.5);
    return called_now((mixed *)user, IMAGE);
}

/* A light against the view, whose image reaches beyond the scene on one side. */
static void mixed_add_projector(mixed *m) {
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

static void mixed_add_volumes(mixed *m) {
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

static void mixed_add_mesh(mixed *m) {
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

static int mixed_shade(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    for (size_t i = 0; i < count; ++i) {
        const double wave = 0.5 + 0.4 * sin(20 * points[i].uv[0]) * sin(20 * points[i].uv[1]);
        check_color(out[i].color, wave, 0.5, 1 - wave);
        check_color(out[i].emission, 0, 0.1 * wave, 0);
    }
    return called_now((mixed *)user, SHADE);
}

/* Half of the triangles of the other mesh, moved. */
static void mixed_add_textured_mesh(mixed *m) {
    sps_mesh *mesh = check_add_mesh(&m->s, &m->triangles, 0.6);
    for (size_t i = 0; i < 6 * m->triangles.count; ++i)
        m->triangles.list[i / 6].uv[i / 2 % 3][i % 2] = m->triangles.list[i / 6].position[i / 2 % 3][i % 2];
    mesh->triangle_count = m->triangles.count / 2;
    mesh->read_fn = mixed_triangles;
    mesh->shade_fn = mixed_shade;
    mesh->user = mesh->shade_user = m;
    mesh->placement = check_box(0.3, -0.2, 0.35, 1.2, 0.8, 1.35);
}

static void mixed_build(mixed *m) {
    memset(m, 0, sizeof *m);
    check_clear(&m->s, WIDTH, HEIGHT);
    check_set3(m->s.view.camera.position, 0.4, 0.5, 4);
    check_perspective(&m->s.view.camera, 0.6);
    m->s.view.shadow_size = 60;
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

static void mixed_build_small(mixed *m) {
    mixed_build(m);
    m->s.view.width = SMALL_WIDTH;
    m->s.view.height = SMALL_HEIGHT;
    m->s.view.quality = SPS_QUALITY_DRAFT;
}

static void mixed_free(mixed *m) { check_free_triangles(&m->triangles); }

/* The calls that tests repeat. A plan has no image; the bytes of its report take its place. */
typedef enum kind { RENDER, REFERENCE, PLAN, KINDS } kind;
static const char *const kind_names[KINDS] = {"render", "reference", "plan"};

static sps_result run(sps_context *context, const mixed *m, kind which, float *pixels) {
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

static void fill(float *pixels) {
    for (int i = 0; i < FLOATS; ++i) pixels[i] = (float)(-1 - i);
}

static int untouched(const float *pixels) {
    for (int i = 0; i < FLOATS; ++i)
        if (!(pixels[i] == (float)(-1 - i))) return 0;
    return 1;
}

static int same(const float *a, const float *b) { return memcmp(a, b, FLOATS * sizeof(float)) == 0; }

/* The result of a fresh context without hooks. */
static void run_fresh(const mixed *m, kind which, float *pixels) {
    sps_context *context = check_context(NULL);
    fill(pixels);
    CHECK_OK(context, run(context, m, which, pixels));
    sps_destroy(context);
}

static size_t bytes_held(const sps_context *context) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    return stats.bytes;
}

/* --------------------------------------------------------------------------------------------------------- failures */

/* The common part of all failure tests: the call returns `expected`, and the image is untouched; with `again`, the
   cause is removed, and the next call has the fresh bits; the hooks then hold nothing. Returns 0 if the call did not
   fail. */
typedef struct failure {
    mixed *m;
    kind which;
    sps_result expected;
    check_hooks *hooks;
    const float *fresh;
} failure;

static float pixels_after[FLOATS], pixels_fresh[FLOATS];

static int fails_cleanly(const failure *f, sps_context *context, long *cause, int again) {
    sps_result result;
    fill(pixels_after);
    result = run(context, f->m, f->which, pixels_after);
    if (result == SPS_OK) {
        CHECK(same(pixels_after, f->fresh));
        sps_destroy(context);
        return 0;
    }
    CHECK_CASE("Engineering", "allocator, callbacks and progress that fail at every call in turn",
               "an error, and the image untouched", result != f->expected || !untouched(pixels_after), 0, "exact");
    CHECK(sps_error(context)[0] != 0);
    CHECK_CASE("What users of other renderers complain of", "allocator hooks without a context pointer",
               "each context's own hooks hold its bytes", fabs((double)bytes_held(context) - (double)f->hooks->live), 0,
               "exact");
    *cause = 0;
    if (again) {
        fill(pixels_after);
        CHECK_OK(context, run(context, f->m, f->which, pixels_after));
        CHECK_CASE("Engineering", "the next call after such a failure", "the same picture",
                   !same(pixels_after, f->fresh), 0, "same bits");
        CHECK(sps_error(context)[0] == 0);
    }
    sps_destroy(context);
    CHECK(f->hooks->live == 0 && f->hooks->live_blocks == 0);
    return 1;
}

static void test_every_allocation(mixed *m, kind which, long least) {
    long n;
    run_fresh(m, which, pixels_fresh);
    for (n = 1; n < 1000; ++n) {
        check_hooks hooks;
        failure f = {m, which, SPS_ERROR_MEMORY, &hooks, pixels_fresh};
        sps_context *context;
        memset(&hooks, 0, sizeof hooks);
        hooks.fail_at = n;
        context = check_context(&hooks);
        if (n == 1) {
            CHECK(context == NULL && hooks.live == 0);
            continue;
        }
        if (!fails_cleanly(&f, context, &hooks.fail_at, 1)) break;
    }
    if (!CHECK(n - 1 >= least)) printf("    %s allocates %ld times only\n", kind_names[which], n - 1);
}

/* The same after the context has rendered something smaller, so that buffers grow and the list of bricks moves. */
static void test_growing_allocations(mixed *m) {
    long n;
    run_fresh(m, RENDER, pixels_fresh);
    for (n = 1; n < 1000; ++n) {
        check_hooks hooks;
        failure f = {m, RENDER, SPS_ERROR_MEMORY, &hooks, pixels_fresh};
        sps_context *context;
        const int whole = m->s.view.region[2];
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        m->s.scene.volume_count = 1;
        m->s.scene.light_count = m->s.scene.mesh_count = 0;
        m->s.view.region[2] = m->s.view.region[3] = 8;
        CHECK_OK(context, run(context, m, RENDER, pixels_after));
        m->s.scene.volume_count = m->s.scene.light_count = 2;
        m->s.scene.mesh_count = 2;
        m->s.view.region[2] = m->s.view.region[3] = whole;
        hooks.fail_at = hooks.allocations + n;
        if (!fails_cleanly(&f, context, &hooks.fail_at, 1)) break;
    }
    CHECK(n > 8);
}

static void test_every_callback(mixed *m, kind which, long least) {
    long n;
    run_fresh(m, which, pixels_fresh);
    for (n = 1; n < 2000; ++n) {
        check_hooks hooks;
        failure f = {m, which, SPS_ERROR_CALLBACK, &hooks, pixels_fresh};
        memset(&hooks, 0, sizeof hooks);
        m->calls = 0;
        m->fail_at = n;
        if (!fails_cleanly(&f, check_context(&hooks), &m->fail_at, check_long() || n % 3 == 1)) break;
    }
    m->fail_at = 0;
    if (!CHECK(n - 1 >= least)) printf("    %s calls back %ld times only\n", kind_names[which], n - 1);
}

typedef struct progress {
    long calls, cancel_at;
    float last, leap; /* leap: the largest rise from call to call */
    int fell, outside;
} progress;

static int progress_cancel(void *user, float fraction) {
    progress *p = (progress *)user;
    if (p->calls > 0 && fraction < p->last) p->fell = 1;
    if (!(fraction >= 0 && fraction <= 1)) p->outside = 1;
    if (p->calls > 0) p->leap = fmaxf(p->leap, fraction - p->last);
    p->last = fraction;
    return ++p->calls == p->cancel_at;
}

static sps_context *progress_context(check_hooks *hooks, progress *p) {
    sps_config config;
    memset(hooks, 0, sizeof *hooks);
    config = check_config(hooks);
    config.progress_fn = progress_cancel;
    config.clock_fn = check_hasty_clock;
    config.progress_user = p;
    return sps_create(&config, NULL);
}

/* The long tests try every call of progress_fn, others fewer and fewer: most are between two tiles or rows. */
static void test_every_cancellation(mixed *m, kind which, long least) {
    long n;
    run_fresh(m, which, pixels_fresh);
    for (n = 1; n < 2000; n += check_long() ? 1 : 1 + n / (check_memory_only() ? 2 : 8)) {
        check_hooks hooks;
        failure f = {m, which, SPS_ERROR_CANCELLED, &hooks, pixels_fresh};
        progress p;
        memset(&p, 0, sizeof p);
        p.cancel_at = n;
        if (!fails_cleanly(&f, progress_context(&hooks, &p), &p.cancel_at, 1)) break;
    }
    if (!CHECK(n - 1 >= least)) printf("    %s tells its progress %ld times only\n", kind_names[which], n - 1);
}

static void test_progress(mixed *m, kind which) {
    check_hooks hooks;
    progress p;
    sps_context *context;
    memset(&p, 0, sizeof p);
    context = progress_context(&hooks, &p);
    for (int again = 0; again < 2; ++again) { /* the second call begins at 0 again */
        p.calls = 0;
        p.last = -1;
        CHECK_OK(context, run(context, m, which, pixels_after));
        CHECK(p.calls >= 2 && !p.fell && !p.outside);
        CHECK(p.last == 1);
    }
    sps_destroy(context);
}

/* The reference reports each row of a picture of any shape: reading and each of 40 or 8 rows are at most 0.3 of it. */
static void test_progress_of_rows(mixed *m) {
    const int width = m->s.view.width, height = m->s.view.height;
    for (int n = 0; n < 2; ++n) {
        check_hooks hooks;
        progress p;
        sps_context *context;
        memset(&p, 0, sizeof p);
        context = progress_context(&hooks, &p);
        m->s.view.width = n ? 40 : 8, m->s.view.height = n ? 8 : 40;
        CHECK_OK(context, run(context, m, REFERENCE, pixels_after));
        CHECK(!p.fell && !p.outside && p.leap < 0.3f && p.last == 1);
        sps_destroy(context);
    }
    m->s.view.width = width, m->s.view.height = height;
}

/* A failure of each kind, one after another in one context, each with one message. */
static void count_messages(void *user, const char *text) {
    *(long *)user += text[0] != 0 && strchr(text, '\n') == NULL;
}

static void test_messages(mixed *m) {
    long messages = 0;
    sps_config config;
    sps_context *context;
    memset(&config, 0, sizeof config);
    config.message_fn = count_messages;
    config.message_user = &messages;
    context = sps_create(&config, NULL);
    for (int i = 1; i <= 4; ++i) {
        m->calls = 0;
        m->fail_at = i;
        CHECK(run(context, m, RENDER, pixels_after) == SPS_ERROR_CALLBACK);
        CHECK(messages == i);
    }
    m->fail_at = 0;
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    CHECK(messages == 4);
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------------- memory */

/* The allocator's peak and the planned bytes of one scene in a fresh context. */
static void measure(const mixed *m, int workers, size_t *planned, size_t *peak) {
    sps_plan_report report;
    sps_stats_report stats;
    check_hooks hooks;
    sps_context *context;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = workers;
    context = check_context(&hooks);
    *planned = 0;
    if (CHECK_OK(context, sps_plan(context, &m->s.scene, &m->s.view, &report))) *planned = report.bytes;
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    sps_get_stats(context, &stats);
    CHECK(stats.bytes == hooks.live && stats.bytes_peak == hooks.peak);
    *peak = hooks.peak;
    sps_destroy(context);
}

static void test_memory_limit(const mixed *m) {
    size_t planned, peak, step, limit;
    sps_result last = SPS_ERROR_MEMORY;
    measure(m, 0, &planned, &peak);
    step = peak / (check_long() ? 20 : check_memory_only() ? 5 : 10);
    run_fresh(m, RENDER, pixels_fresh);
    for (limit = step; limit <= planned + peak; limit += step) {
        check_hooks hooks;
        sps_context *context;
        memset(&hooks, 0, sizeof hooks);
        hooks.memory_limit = limit;
        context = check_context(&hooks);
        fill(pixels_after);
        last = run(context, m, RENDER, pixels_after);
        CHECK_CASE("What users of other renderers complain of", "unbounded memory: limits from too little to enough",
                   "peak / memory_limit", (double)hooks.peak / (double)limit, 1, "a bound");
        if (last == SPS_OK)
            CHECK(same(pixels_after, pixels_fresh));
        else
            CHECK(last == SPS_ERROR_MEMORY && untouched(pixels_after) && strstr(sps_error(context), "memory_limit"));
        if (limit >= planned || limit >= peak)
            CHECK(last == SPS_OK);
        else if (limit < peak / 2)
            CHECK(last == SPS_ERROR_MEMORY);
        sps_destroy(context);
        CHECK(hooks.live == 0);
    }
}

/* A limit of exactly the planned bytes, and one of less than the context itself needs. */
static void test_memory_exact(const mixed *m) {
    size_t planned, peak;
    check_hooks hooks;
    sps_context *context;
    measure(m, 0, &planned, &peak);
    memset(&hooks, 0, sizeof hooks);
    hooks.memory_limit = planned;
    context = check_context(&hooks);
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    sps_destroy(context);
    hooks.memory_limit = 10;
    context = check_context(&hooks);
    CHECK(context == NULL && hooks.live == 0);
    sps_destroy(context);
}

/* Makes change number n to the scene; returns 0 if there are no more. */
static int vary(mixed *m, int variant) {
    sps_view *view = &m->s.view;
    switch (variant) {
    case 0: return 1;
    case 1: m->s.scene.mesh_count = 0; return 1;
    case 2: m->s.scene.volume_count = 0; return 1;
    case 3: m->s.scene.light_count = 0; return 1;
    case 4: m->s.scene.volume_count = 1; return 1;
    case 5: view->quality = SPS_QUALITY_ULTRA; return 1;
    case 6: view->quality = SPS_QUALITY_DRAFT; return 1;
    case 7: view->shadow_size = 0; return 1;
    case 8: view->shadow_size = 1; return 1;
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
    case 17: view->slab = 0.1; return 1;
    case 18: m->s.volume[1].shading = SPS_SHADING_GAS; return 1;
    case 19: m->s.scene.light_count = 1, m->s.scene.volume_count = 0, view->shadow_size = 9; return 1;
    case 20: view->slab = 50; return 1;
    case 21: m->s.scene.volume_count = 0, m->s.light[1].position[2] = 0; return 1; /* six depth maps */
    case 22: view->width = WIDTH, view->height = HEIGHT; return 1;
    case 23: m->s.mesh[1].shade_fn = NULL; return 1;
    case 24: m->s.mesh[0].shade_fn = mixed_shade, m->s.mesh[0].shade_user = m; return 1;
    default: return 0;
    }
}

static void test_planned_bytes(void) {
    for (int variant = 0, more = 1; more; ++variant) {
        if (check_memory_only() && variant % 3 == 0) continue; /* test_context_reused renders these */
        for (int workers = 0; workers <= (variant % 3 ? 0 : 7); workers += 7) {
            mixed m;
            size_t planned, peak;
            mixed_build_small(&m);
            more = vary(&m, variant);
            measure(&m, workers, &planned, &peak);
            if (!CHECK_CASE("Engineering", "bytes of a render, in some forty scenes, by no workers and by 7",
                            "peak / planned", (double)peak / (double)planned, 1, "a bound"))
                printf("    variant %d, %d workers: peak %.0f, planned %.0f\n", variant, workers, (double)peak,
                       (double)planned);
            if (!CHECK(planned < 6 * peak + 200000)) /* the bound is useful */
                printf("    variant %d, %d workers: peak %.0f, planned %.0f\n", variant, workers, (double)peak,
                       (double)planned);
            mixed_free(&m);
        }
    }
}

/* One context for all scenes in turn: each call's plan bounds the memory held, and the images are the fresh ones. */
static void test_context_reused(void) {
    sps_context *context = check_context(NULL);
    for (int variant = 0;; ++variant) {
        sps_plan_report report;
        sps_stats_report stats;
        mixed m;
        mixed_build_small(&m);
        if (!vary(&m, variant)) {
            mixed_free(&m);
            break;
        }
        if (check_memory_only() && variant % 3) {
            mixed_free(&m);
            continue;
        }
        CHECK_OK(context, sps_plan(context, &m.s.scene, &m.s.view, &report));
        fill(pixels_after);
        CHECK_OK(context, run(context, &m, RENDER, pixels_after));
        sps_get_stats(context, &stats);
        if (!CHECK(stats.bytes <= report.bytes)) printf("    variant %d\n", variant);
        run_fresh(&m, RENDER, pixels_fresh);
        if (!CHECK(same(pixels_after, pixels_fresh))) printf("    variant %d\n", variant);
        mixed_free(&m);
    }
    sps_destroy(context);
}

/* -------------------------------------------------------------------------------------------------------- same bits */

typedef struct thread_job {
    sps_task_fn task;
    void *task_data;
    int count, worker, workers;
} thread_job;

static void *thread_main(void *user) {
    const thread_job *job = (const thread_job *)user;
    for (int i = job->worker; i < job->count; i += job->workers) job->task(job->task_data, i, job->worker);
    return NULL;
}

/* Threads that really run in parallel, created for each loop. */
static void thread_parallel_for(void *user, int count, sps_task_fn task, void *task_data) {
    const int workers = *(const int *)user;
    pthread_t threads[16];
    thread_job jobs[16];
    for (int w = 0; w < workers; ++w) {
        const thread_job job = {task, task_data, count, w, workers};
        jobs[w] = job;
        if (pthread_create(&threads[w], NULL, thread_main, &jobs[w])) abort();
    }
    for (int w = 0; w < workers; ++w) pthread_join(threads[w], NULL);
}

static void test_shuffled_workers(const mixed *m, kind which) {
    run_fresh(m, which, pixels_fresh);
    for (int workers = 1; workers <= 7; workers += workers == 1 ? 1 : 5) {
        const uint64_t orders = workers < 7 || which != RENDER || check_memory_only() ? 1 : check_long() ? 6 : 3;
        for (uint64_t order = 0; order < orders; ++order) { /* each tile by several workers */
            check_hooks hooks;
            sps_context *context;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = workers;
            hooks.order = order;
            context = check_context(&hooks);
            fill(pixels_after);
            CHECK_OK(context, run(context, m, which, pixels_after));
            if (!CHECK_CASE("Engineering", "1, 2 and 7 workers in any order, and all of it again", "the same picture",
                            !same(pixels_after, pixels_fresh), 0, "same bits"))
                printf("    %s, %d workers\n", kind_names[which], workers);
            CHECK(hooks.loops > 0);
            CHECK_OK(context, run(context, m, which, pixels_after));
            CHECK(same(pixels_after, pixels_fresh));
            sps_destroy(context);
        }
    }
}

static void test_real_threads(const mixed *m) {
    run_fresh(m, RENDER, pixels_fresh);
    for (int workers = 2; workers <= 7; workers += 5) {
        sps_config config;
        sps_context *context;
        memset(&config, 0, sizeof config);
        config.parallel_for_fn = thread_parallel_for;
        config.parallel_user = &workers;
        config.worker_count = workers;
        context = sps_create(&config, NULL);
        fill(pixels_after);
        CHECK_OK(context, run(context, m, RENDER, pixels_after));
        CHECK(same(pixels_after, pixels_fresh));
        sps_destroy(context);
    }
}

/* Statistics do not depend on workers either. */
static void test_same_counts(const mixed *m) {
    sps_stats_report one, seven;
    for (int pass = 0; pass < 2; ++pass) {
        check_hooks hooks;
        sps_context *context;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = pass ? 7 : 0;
        context = check_context(&hooks);
        CHECK_OK(context, run(context, m, RENDER, pixels_after));
        sps_get_stats(context, pass ? &seven : &one);
        sps_destroy(context);
    }
    CHECK(one.eye_fragments == seven.eye_fragments && one.eye_fragments > 0);
    CHECK(one.light_fragments == seven.light_fragments && one.light_fragments > 0);
    CHECK(one.light_footprints == seven.light_footprints && one.light_footprints > 0);
    CHECK(one.eye_footprints == seven.eye_footprints && one.eye_footprints > 0);
    CHECK(one.eye_footprints == seven.eye_footprints && one.light_footprints == seven.light_footprints);
    CHECK(one.pixels_shaded == seven.pixels_shaded && one.pixels_shaded > 0);
    CHECK(one.tiles_finished == seven.tiles_finished);
}

/* A region, written to its place in a buffer of the whole image's width, equals the whole image there and leaves the
   rest of the buffer untouched. */
static void check_region(const mixed *m, const int region[4], const float *whole, const char *what) {
    const int at = region[1] * WIDTH + region[0];
    sps_context *context = check_context(NULL);
    sps_view view = m->s.view;
    sps_image image;
    int wrong = 0, strayed = 0;
    memcpy(view.region, region, sizeof view.region);
    image.rgba = pixels_after + 4 * at;
    image.depth = pixels_after + 4 * PIXELS + at;
    image.row_pixels = WIDTH;
    fill(pixels_after);
    if (CHECK_OK(context, sps_render(context, &m->s.scene, &view, &image)))
        for (int i = 0; i < FLOATS; ++i) {
            const int pixel = i < 4 * PIXELS ? i / 4 : i - 4 * PIXELS, x = pixel % WIDTH, y = pixel / WIDTH;
            const int in = x >= region[0] && y >= region[1] && x < region[0] + region[2] && y < region[1] + region[3];
            if (in)
                wrong += memcmp(&pixels_after[i], &whole[i], sizeof(float)) != 0;
            else
                strayed += !(pixels_after[i] == (float)(-1 - i));
        }
    if (!CHECK(wrong == 0) || !CHECK(strayed == 0))
        printf("    %s, region %d,%d,%d,%d: %d numbers differ, %d strayed\n", what, region[0], region[1], region[2],
               region[3], wrong, strayed);
    sps_destroy(context);
}

static void check_regions(const mixed *m, const char *what) {
    static const int regions[][4] = {{0, 0, WIDTH, HEIGHT}, {0, 0, 1, 1},   {WIDTH - 1, HEIGHT - 1, 1, 1},
                                     {13, 7, 40, 11},       {63, 63, 2, 2}, {0, 64, WIDTH, 1},
                                     {64, 0, 1, HEIGHT}};
    run_fresh(m, RENDER, pixels_fresh);
    for (size_t i = 0; i < sizeof regions / sizeof *regions; ++i) check_region(m, regions[i], pixels_fresh, what);
}

static void test_regions(void) {
    for (int variant = 0; variant < 5; ++variant) {
        static const char *const names[] = {"all", "with the eye", "against the eye", "orthographic", "dense, fine"};
        mixed m;
        if (check_memory_only() && variant > 0) continue;
        mixed_build(&m);
        if (variant == 1 || variant == 2) m.s.scene.light_count = 1;
        if (variant == 2) check_set3(m.s.light[0].direction, 0.3, -0.8, 1);
        if (variant == 3) check_orthographic(&m.s.view.camera, 2.1);
        if (variant == 4) m.s.volume[0].extinction = 60, m.s.view.slab = 0.5; /* tiles finish early */
        check_regions(&m, names[variant]);
        mixed_free(&m);
    }
}

/* Two contexts, alternating and in two threads. */
typedef struct twin {
    mixed m;
    sps_context *context;
    float pixels[FLOATS], fresh[FLOATS];
    int failed;
} twin;

static void *twin_main(void *user) {
    twin *t = (twin *)user;
    for (int i = 0; i < 3; ++i)
        t->failed |= run(t->context, &t->m, RENDER, t->pixels) != SPS_OK || !same(t->pixels, t->fresh);
    return NULL;
}

static void test_two_contexts(void) {
    static twin twins[2];
    pthread_t threads[2];
    for (int i = 0; i < 2; ++i) {
        mixed_build_small(&twins[i].m);
        vary(&twins[i].m, i == 0 ? 9 : 12);
        run_fresh(&twins[i].m, RENDER, twins[i].fresh);
        fill(twins[i].pixels);
        twins[i].context = check_context(NULL);
    }
    for (int i = 0; i < 4; ++i) {
        twin *t = &twins[i % 2];
        CHECK_OK(t->context, run(t->context, &t->m, RENDER, t->pixels));
        CHECK(same(t->pixels, t->fresh));
    }
    for (int i = 0; i < 2; ++i) CHECK(pthread_create(&threads[i], NULL, twin_main, &twins[i]) == 0);
    for (int i = 0; i < 2; ++i) pthread_join(threads[i], NULL);
    for (int i = 0; i < 2; ++i) {
        CHECK_CASE("Engineering", "two contexts in two threads at once", "each its own picture", twins[i].failed, 0,
                   "same bits");
        sps_destroy(twins[i].context);
        mixed_free(&twins[i].m);
    }
}

/* ------------------------------------------------------------------------------------------------------ kept voxels */

/* Renders in the shared context, and returns whether voxels were read; the image must be that of a fresh context. */
static int renders_reading(sps_context *context, const mixed *m, int line) {
    sps_stats_report stats;
    fill(pixels_after);
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    sps_get_stats(context, &stats);
    run_fresh(m, RENDER, pixels_fresh);
    if (!CHECK(same(pixels_after, pixels_fresh))) printf("    in the call at line %d\n", line);
    CHECK((stats.voxels_read > 0) == (stats.read_calls + stats.eval_calls > 0));
    return stats.voxels_read > 0;
}

#define RENDERS_READING(context, m) renders_reading((context), (m), __LINE__)

/* The small scene with voxels that may be kept (revision 0: must not), and the context that should keep them. */
static sps_context *keeping_build(mixed *m, uint64_t revision) {
    mixed_build_small(m);
    m->s.volume[0].revision = m->s.volume[1].revision = revision;
    return check_context(NULL);
}

static void keeping_free(mixed *m, sps_context *context) {
    sps_destroy(context);
    mixed_free(m);
}

static void test_revision(void) {
    sps_plan_report report;
    mixed m;
    sps_context *context = keeping_build(&m, 0);
    CHECK(RENDERS_READING(context, &m));
    CHECK(RENDERS_READING(context, &m)); /* revision 0: never kept */
    m.s.volume[0].revision = m.s.volume[1].revision = 5;
    CHECK(RENDERS_READING(context, &m));
    CHECK(!RENDERS_READING(context, &m));
    CHECK_OK(context, sps_plan(context, &m.s.scene, &m.s.view, &report));
    CHECK(report.voxels_read == 0 && report.read_calls == 0 && report.eval_calls == 0 && report.range_calls == 0);
    CHECK(report.pass[SPS_PASS_GATHER].runs == 0);
    CHECK(!RENDERS_READING(context, &m));
    m.s.volume[0].revision = 6;
    CHECK(RENDERS_READING(context, &m));
    CHECK(!RENDERS_READING(context, &m));
    m.s.volume[0].size[0] = 10;
    CHECK(RENDERS_READING(context, &m));
    keeping_free(&m, context);
}

/* Changes that do not need voxels to be read again, and changes that do: in either case the image is the fresh one. */
static void test_revision_and_looks(void) {
    mixed m;
    sps_context *context = keeping_build(&m, 1);
    CHECK(RENDERS_READING(context, &m));
    m.s.view.camera.position[0] = -0.7;
    m.s.volume[0].extinction = 0.3f;
    m.s.volume[0].placement.origin[1] = -0.7; /* read_fn does not depend on the placement */
    m.s.light[0].direction[0] = 0.1;
    CHECK(!RENDERS_READING(context, &m));
    m.s.volume[1].placement.origin[1] = -0.9; /* eval_fn does */
    CHECK(RENDERS_READING(context, &m));
    m.threshold = 0.6;
    RENDERS_READING(context, &m);
    m.threshold = 0.1;
    CHECK(RENDERS_READING(context, &m)); /* more of the values show */
    keeping_free(&m, context);
}

/* Transfer functions by points: the same shape stretched over twice the range of values shows fewer or more voxels,
   although the same entries of the table have extinction. */
static void test_revision_and_points(void) {
    static const sps_transfer_point narrow[] = {{0.2f, {1, 1, 1}, 0}, {0.4f, {1, 1, 1}, 9}};
    static const sps_transfer_point wide[] = {{0.4f, {1, 1, 1}, 0}, {0.8f, {1, 1, 1}, 9}};
    mixed m;
    sps_context *context = keeping_build(&m, 1);
    m.s.volume[0] = m.s.volume[1];
    m.s.scene.volume_count = 1;
    m.s.volume[0].size[0] = m.s.volume[0].size[1] = m.s.volume[0].size[2] = 24;
    m.transfer.eval_fn = NULL;
    m.transfer.point_count = 2;
    m.transfer.points = wide;
    CHECK(RENDERS_READING(context, &m));
    m.transfer.points = narrow;
    RENDERS_READING(context, &m);
    m.transfer.points = wide;
    RENDERS_READING(context, &m);
    keeping_free(&m, context);
}

/* A gas in place of a classified volume with the same provider, size and revision, and back. */
static void test_revision_and_kind(void) {
    mixed m;
    sps_context *context = keeping_build(&m, 1);
    RENDERS_READING(context, &m);
    m.s.volume[1].transfer = NULL;
    m.s.volume[1].extinction = 2;
    RENDERS_READING(context, &m);
    m.s.volume[1].transfer = &m.transfer;
    RENDERS_READING(context, &m);
    m.s.scene.volume_count = 1;
    RENDERS_READING(context, &m);
    m.s.scene.volume_count = 2;
    RENDERS_READING(context, &m);
    keeping_free(&m, context);
}

/* A call that fails half-way through the voxels leaves none behind that would be reused. */
static void test_revision_and_failure(void) {
    mixed m;
    sps_context *context = keeping_build(&m, 1);
    CHECK(RENDERS_READING(context, &m));
    m.s.volume[0].revision = 2;
    m.calls = 0;
    m.fail_at = 36; /* beyond the calls for the transfer function's table: among the layers of the second volume */
    CHECK(run(context, &m, RENDER, pixels_after) == SPS_ERROR_CALLBACK);
    m.fail_at = 0;
    m.s.volume[0].revision = 1;
    CHECK(RENDERS_READING(context, &m));
    keeping_free(&m, context);
}

/* ---------------------------------------------------------------------------------------------------- the interface */

static void test_null_arguments(const mixed *m) {
    sps_context *context = check_context(NULL);
    sps_plan_report report, zero;
    sps_stats_report stats;
    sps_image image, no_pixels;
    memset(&image, 0, sizeof image);
    memset(&no_pixels, 0, sizeof no_pixels);
    memset(&zero, 0, sizeof zero);
    image.rgba = pixels_after;
    fill(pixels_after);
    sps_destroy(NULL);
    sps_get_stats(context, NULL);
    memset(&stats, 1, sizeof stats);
    sps_get_stats(NULL, &stats);
    CHECK(stats.bytes == 0 && stats.slabs == 0);
    CHECK(sps_error(NULL)[0] != 0);
    CHECK(sps_render(NULL, &m->s.scene, &m->s.view, &image) == SPS_ERROR_ARGUMENT);
    CHECK(check_reference(NULL, &m->s.scene, &m->s.view, 1, &image) == SPS_ERROR_ARGUMENT);
    CHECK(sps_plan(NULL, &m->s.scene, &m->s.view, &report) == SPS_ERROR_ARGUMENT);
    CHECK(sps_render(context, NULL, &m->s.view, &image) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    CHECK(sps_render(context, &m->s.scene, NULL, &image) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    CHECK(sps_render(context, &m->s.scene, &m->s.view, NULL) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    CHECK(sps_render(context, &m->s.scene, &m->s.view, &no_pixels) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    CHECK(check_reference(context, NULL, NULL, 1, NULL) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    CHECK(sps_plan(context, &m->s.scene, &m->s.view, NULL) == SPS_ERROR_ARGUMENT && sps_error(context)[0]);
    memset(&report, 1, sizeof report);
    CHECK(sps_plan(context, NULL, &m->s.view, &report) == SPS_ERROR_ARGUMENT);
    CHECK(memcmp(&report, &zero, sizeof zero) == 0); /* zeroed unless SPS_OK */
    CHECK(untouched(pixels_after));
    sps_destroy(context);
}

static sps_error_info refusal; /* of the last config that was refused; SPS_OK if none was */

static int refused(const sps_config *config) {
    sps_context *context = sps_create(config, &refusal);
    sps_context *again = sps_create(config, NULL); /* `why` is optional */
    CHECK((context == NULL) == (again == NULL) && (context == NULL) == (refusal.result != SPS_OK));
    sps_destroy(again);
    sps_destroy(context);
    return context == NULL;
}

/* Whether the last config was refused because of this field and value. */
static int refused_for(sps_result result, const char *field, double value) {
    char start[64];
    snprintf(start, sizeof start, "config.%s is ", field);
    return refusal.result == result && refusal.object == SPS_OBJECT_CONFIG && refusal.index == -1 &&
           strcmp(refusal.field, field) == 0 && refusal.value == value &&
           strncmp(refusal.sentence, start, strlen(start)) == 0;
}

static void test_configs(void) {
    check_hooks hooks;
    sps_config config;
    memset(&hooks, 0, sizeof hooks);
    memset(&config, 0, sizeof config);
    CHECK(!refused(&config) && !refused(NULL));
    CHECK(refusal.object == SPS_OBJECT_NONE && refusal.index == -1 && !*refusal.sentence);
    config.start_canary = 1;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "start_canary", 1));
    config.start_canary = 0, config.end_canary = 2;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "end_canary", 2));
    config.end_canary = 0, config.alloc_fn = check_alloc;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "free_fn", 0));
    config.alloc_fn = NULL, config.free_fn = check_free;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "alloc_fn", 0));
    config.free_fn = NULL, config.worker_count = -1;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "worker_count", -1));
    config.worker_count = 1025;
    CHECK(refused(&config) && refused_for(SPS_ERROR_ARGUMENT, "worker_count", 1025));
    config.worker_count = 1024; /* unused without parallel_for_fn */
    CHECK(!refused(&config));
    config.memory_limit = sizeof(sps_context) - 1;
    CHECK(refused(&config) && refused_for(SPS_ERROR_MEMORY, "memory_limit", (double)(sizeof(sps_context) - 1)));
    config.memory_limit += 1;
    CHECK(!refused(&config));
    config.alloc_fn = check_alloc, config.free_fn = check_free, config.alloc_user = &hooks;
    hooks.fail_at = 1;
    CHECK(sps_create(&config, &refusal) == NULL && refusal.result == SPS_ERROR_MEMORY);
    CHECK(refusal.object == SPS_OBJECT_NONE && strncmp(refusal.sentence, "memory: ", 8) == 0);
}

static void test_version_and_names(void) {
    CHECK(sps_version() == SPS_VERSION);
    for (int i = 0; i < SPS_PASS_COUNT; ++i) {
        CHECK(sps_pass_name((sps_pass)i)[0] != 0);
        for (int j = 0; j < i; ++j) CHECK(strcmp(sps_pass_name((sps_pass)i), sps_pass_name((sps_pass)j)) != 0);
    }
    CHECK(sps_pass_name(SPS_PASS_COUNT) != NULL);
}

static double ticking_clock(void *user) { return *(double *)user += 0.25; }

static void test_clock(const mixed *m) {
    sps_stats_report stats;
    sps_config config;
    sps_context *context = check_context(NULL);
    double now = 0;
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    sps_get_stats(context, &stats);
    CHECK(stats.seconds_total == 0 && stats.seconds_eye == 0);
    sps_destroy(context);
    memset(&config, 0, sizeof config);
    config.clock_fn = ticking_clock;
    config.clock_user = &now;
    context = sps_create(&config, NULL);
    CHECK_OK(context, run(context, m, RENDER, pixels_after));
    sps_get_stats(context, &stats);
    CHECK(stats.seconds_total > 0 && stats.seconds_total <= now);
    CHECK(stats.seconds_gather + stats.seconds_polygons + stats.seconds_bin + stats.seconds_light + stats.seconds_eye <=
          stats.seconds_total);
    sps_destroy(context);
}

/* A transmittance map of the scene, as the camera sees it. */
static sps_result finish_map(sps_context *context, const mixed *m) {
    sps_tmap_light light;
    sps_tmap_settings settings;
    sps_tmap *map;
    sps_result result;
    memset(&light, 0, sizeof light);
    memset(&settings, 0, sizeof settings);
    light.width = light.height = 8;
    light.camera = m->s.view.camera;
    settings.near_depth = 1;
    settings.far_depth = 8;
    if (!CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map))) return SPS_OK;
    CHECK_OK(context, sps_tmap_add(map, &m->s.scene));
    result = sps_tmap_finish(map);
    sps_tmap_destroy(map);
    return result;
}

/* Every call that takes long has its own time, even if a callback fails at once or later. Only sps_render has times of
   its parts. */
static void test_clock_of_calls(mixed *m) {
    enum { MAP = PLAN };
    sps_config config;
    sps_context *context;
    double now = 0;
    memset(&config, 0, sizeof config);
    config.clock_fn = ticking_clock;
    config.clock_user = &now;
    context = sps_create(&config, NULL);
    CHECK(now == 0);
    for (int which = RENDER; which <= MAP; ++which)
        for (int failing = 0; failing < 3; ++failing) {
            const double before = now;
            sps_stats_report stats;
            sps_result result;
            m->calls = 0;
            m->fail_at = failing;
            result = which == MAP ? finish_map(context, m) : run(context, m, (kind)which, pixels_after);
            CHECK(result == (failing ? SPS_ERROR_CALLBACK : SPS_OK));
            sps_get_stats(context, &stats);
            /* the clock's first and last ticks are the call's; those of sps_tmap_create and _add come before */
            if (!CHECK(stats.seconds_total > 0 && stats.seconds_total <= now - before - 0.25))
                printf("    call %d, failing %d: %g s of %g\n", which, failing, stats.seconds_total, now - before);
            CHECK(which == RENDER || stats.seconds_gather + stats.seconds_polygons + stats.seconds_tree +
                                             stats.seconds_shadow_rays + stats.seconds_bin + stats.seconds_light +
                                             stats.seconds_eye ==
                                         0);
        }
    m->fail_at = 0;
    sps_destroy(context);
}

/* Bytes of a list of particles, or of vectors for the workers if there are no rays, as a plan counts them. */
static size_t counted_bytes(sps_context *context, const spsi_rays *rays, size_t count, size_t size) {
    spsi_lists lists;
    context->counted = 0;
    context->counts_only = 1;
    if (rays) CHECK(spsi_lists_reserve(context, SPSI_BUFFER_EYE_BALLS, rays, count, &lists) == SPS_OK);
    if (!rays) CHECK(!spsi_vectors_reserve(context, SPSI_BUFFER_SAMPLES, (int)count, size));
    context->counts_only = 0;
    return context->counted;
}

/* Sizes in bytes that exceed a size_t cannot be reserved. What is only counted is not reserved, and no failure. */
static void test_sizes_overflow(void) {
    sps_context *context = check_context(NULL);
    const size_t each = sizeof(spsi_seen) + 2 * sizeof(int), starts = 3 * sizeof(int);
    spsi_rays rays;
    memset(&rays, 0, sizeof rays);
    rays.width = rays.height = 2; /* one tile: its list, that of wide particles, and the end */
    CHECK(counted_bytes(context, &rays, 5, 0) == 5 * each + starts);
    CHECK(counted_bytes(context, &rays, (SIZE_MAX - starts) / each + 1, 0) == SIZE_MAX); /* the first that exceeds it */
    CHECK(counted_bytes(context, &rays, SIZE_MAX / 2, 0) == SIZE_MAX);
    CHECK(counted_bytes(context, NULL, 3, 100) == 3 * 100 + SPSI_VECTOR_ALIGNMENT);
    CHECK(counted_bytes(context, NULL, 3, SIZE_MAX / 2) == SIZE_MAX);
    CHECK(context->stats.bytes == sizeof *context && !sps_error(context)[0]);
    sps_destroy(context);
}

/* Runs and counts tasks. Its clock advances by `step` each time that it is read. */
typedef struct task_count {
    double now, step;
    int ran[3000], wrong;
    long ticks;
} task_count;

static double stepping_clock(void *user) {
    task_count *t = (task_count *)user;
    return t->now += t->step;
}

static int count_tick(void *user, float fraction) {
    task_count *t = (task_count *)user;
    (void)fraction;
    t->ticks++;
    return 0;
}

static void count_task(void *data, int index, int worker) {
    task_count *t = (task_count *)data;
    t->ran[index]++;
    t->wrong += worker != 3;
}

/* In reverse order, all by worker 3. */
static void backwards(void *user, int count, sps_task_fn task, void *data) {
    (void)user;
    while (count-- > 0) task(data, count, 3);
}

/* Every third task only. */
static void a_third(void *user, int count, sps_task_fn task, void *data) {
    (void)user;
    for (int i = 0; i < count; i += 3) task(data, i, 3);
}

/* Each task is run once, whatever the clock does; and progress is reported once 0.01 s have passed, never if time
   stands still. A clock that advances by 0.0011 s lets 9 tasks begin in between, and any two rounds in a row do at
   least one task. Without a clock a round has 4 tasks per worker, and without progress_fn 1024 tasks. Tasks that
   parallel_for_fn leaves out are run all the same. */
static void test_rounds_of_tasks(void) {
    static const double steps[] = {0, 1e-9, 0.0011, 0.5, HUGE_VAL, NAN};
    for (int counts = 1; counts <= 3000; counts = counts * 3 + 7)
        for (int which = 0; which < 16; ++which) {
            task_count t;
            sps_config config;
            sps_context *context;
            const int way = which % 8, clocked = way < 6, lazy = which >= 8;
            memset(&t, 0, sizeof t);
            memset(&config, 0, sizeof config);
            if (clocked) config.clock_fn = stepping_clock, t.step = steps[way];
            if (way < 7) config.progress_fn = count_tick;
            config.parallel_for_fn = lazy ? a_third : backwards, config.worker_count = 4;
            config.clock_user = config.progress_user = &t;
            context = sps_create(&config, NULL);
            t.ticks = 0;
            spsi_parallel(context, counts, count_task, &t);
            for (int i = 0; i < 3000; ++i) CHECK(t.ran[i] == (i < counts));
            if (counts > 1 && !lazy) CHECK(t.wrong == 0);
            if (which < 2) CHECK(t.ticks == 0);
            if (which == 2 && counts > 1) CHECK(t.ticks >= counts / 10 && t.ticks <= counts / 9 + 4);
            if (way == 6) CHECK(t.ticks <= (counts + 15) / 16);
            if (way == 7) CHECK(t.ticks == 0);
            sps_destroy(context);
        }
}

/* The quick start in the header, without its indentation, equals examples/hello.c, and so does that in the README. */
static void note_task(void *data, int index, int worker) {
    int *note = (int *)data;
    (void)worker;
    note[1 + note[0]++] = index;
}

/* Every task has its turn, those that did most the time before first, to within an octave. */
static void test_turns(void) {
    enum { TASKS = 9 };
    static const uint32_t work[TASKS] = {0, 70, 3, 4000000000u, 900, 0, 65, 1, 2047};
    static const int order[TASKS] = {3, 8, 4, 1, 6, 2, 7, 0, 5};
    int note[1 + TASKS] = {0};
    uint32_t memory[TASKS * SPSI_TURN_BYTES / sizeof(uint32_t)];
    sps_context *context = sps_create(NULL, NULL);
    spsi_turns turns;
    spsi_turns_begin(&turns, TASKS, memory);
    for (int i = 0; i < TASKS; ++i) CHECK(turns.work[i] == 0);
    memcpy(turns.work, work, sizeof work);
    spsi_parallel_turns(context, &turns, note_task, note);
    CHECK(note[0] == TASKS && memcmp(note + 1, order, sizeof order) == 0);
    for (int i = 0; i < TASKS; ++i) CHECK(turns.work[i] == 0); /* of a task that says nothing of what it did */
    sps_destroy(context);
}

static void test_quick_start(void) {
    char *header = read_text("splatshadow.h"), *hello = read_text("examples/hello.c"), *readme = read_text("README.md");
    const char *line = header ? strstr(header, "QUICK START") : NULL;
    const char *rest = hello;
    int lines = 0;
    if (!header || !hello || !readme) {
        printf("skipped: quick start: run this in the top folder\n");
    } else if (CHECK(line != NULL)) {
        line = strstr(line, "\n\n") + 2;
        while (strncmp(line, "    ", 4) == 0 || *line == '\n') {
            const size_t length = (size_t)(strchr(line, '\n') - line) + 1, indent = *line == '\n' ? 0 : 4;
            if (*rest == 0) break; /* the blank line before the next section */
            if (!CHECK(strncmp(line + indent, rest, length - indent) == 0)) break;
            rest += length - indent;
            line += length;
            ++lines;
        }
        CHECK(*rest == 0);
        CHECK(lines > 10 && lines <= 30);
        CHECK(strstr(readme, hello) != NULL);
        for (line = strstr(hello, "\n    sps_"); line; line = strstr(line + 1, "\n    sps_")) {
            const char *fields = strstr(line, " = {"); /* by name there */
            CHECK(!fields || fields > strchr(line + 1, '\n') || fields[4] == '.');
        }
    }
    free(readme);
    free(header);
    free(hello);
}

/* Nothing is needed but a C compiler: the header includes the standard library, and what compilers come with. */
static void test_includes(void) {
    static const char allowed[] = "assert.h float.h math.h stddef.h stdint.h stdio.h stdlib.h string.h time.h "
                                  "emmintrin.h immintrin.h arm_neon.h ";
    char line[512], name[64];
    FILE *header = fopen("splatshadow.h", "r");
    int found = 0, others = 0;
    if (!header) {
        printf("skipped: includes of the header: run this in the top folder\n");
        return;
    }
    while (fgets(line, sizeof line, header))
        if (sscanf(line, "#include <%62[^>]", name) == 1 || sscanf(line, "#include \"%62[^\"]", name) == 1) {
            found += 1;
            strcat(name, " ");
            others += strstr(allowed, name) == NULL;
        }
    fclose(header);
    CHECK(found >= 8);
    CHECK_CASE("What users of other renderers complain of", "no CPU mode",
               "headers included besides the standard library's", others, 0, "exact; vectors are the compiler's");
}

/* ------------------------------------------------------------------------------------------------- the command line */

#define SMALL  "--width 5 --height 4 --scattering off " /* sufficient for most of these tests */
#define VOLUME "--volume two.raw --size 2,2,2 " SMALL   /* the same with something visible */

static void test_full_disk(void) {
    static const complaint full[] = {{VOLUME "--out /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--pfm /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--alpha-pfm /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--stats /dev/full", 2, "/dev/full: "},
                                     {VOLUME "--out a.png --stats /dev/full", 2, "No space left"},
                                     {VOLUME "--width 500 --pfm /dev/full", 2, "No space left"},
                                     {VOLUME "--plan >/dev/full", 2, "standard output: "},
                                     {"--help >/dev/full", 2, "standard output: "}};
    FILE *device = fopen("/dev/full", "wb");
    if (!device) {
        printf("skipped: a full disk: there is no /dev/full here\n");
        return;
    }
    fclose(device);
    CHECK_COMPLAINTS(full);
}

/* All four files at once, each of its expected size. */
static void test_files_written(void) {
    static const complaint all[] = {
        {VOLUME "--out a.png --pfm a.pfm --alpha-pfm b.pfm --stats a.json", 0, NULL},
        {VOLUME "--out missing/a.png", 2, "missing/a.png"},
    };
    char text[4000];
    CHECK_COMPLAINTS(all);
    CHECK(read_file("a.png", text, sizeof text) > 60 && memcmp(text, "\x89PNG\r\n\x1a\n", 8) == 0);
    CHECK(read_file("a.pfm", text, sizeof text) == 12 + 4 * 3 * 20 && memcmp(text, "PF\n5 4\n-1.0\n", 12) == 0);
    CHECK(read_file("b.pfm", text, sizeof text) == 12 + 4 * 20 && memcmp(text, "Pf\n5 4\n-1.0\n", 12) == 0);
    CHECK(read_file("a.json", text, sizeof text) > 60 && text[0] == '{' && strstr(text, "\"version\": 300\n}\n"));
}

/* Renders with the options in order from `first` on, or in reverse (step -1); returns whether this is that picture. */
static int same_picture(const char *const *list, int count, int first, int step, const char *same) {
    char options[1000] = "", picture[400];
    outcome got;
    for (int i = 0; i < count; ++i) {
        strcat(options, list[(first + step * i + count * count) % count]);
        strcat(options, " ");
    }
    got = run_render(options);
    memset(picture, 0, sizeof picture);
    read_file("order.pfm", picture, sizeof picture);
    if (CHECK(got.status == 0 && got.said[0] == 0) && CHECK(memcmp(picture, same, sizeof picture) == 0)) return 1;
    printf("    render %s\n    gives %d, and says: %s\n", options, got.status, got.said);
    return 0;
}

/* Two lights keep their order: a sum of floats depends on it. */
static void test_any_order(void) {
    static const char *const list[] = {"--volume two.raw",
                                       "--size 2,2,2",
                                       "--type u8",
                                       "--box -1,-1,-1,1,2,1",
                                       "--extinction 3",
                                       "--albedo 0.9,0.2,0.4",
                                       "--emission 0.1,0,0",
                                       "--phase 0.5,-0.3,0.2",
                                       "--mesh corner.obj",
                                       "--mesh-color 1,0.2,0",
                                       "--camera 1,2,5,0,0,0",
                                       "--up 1,1,0",
                                       "--fov 30",
                                       "--light directional,-1,-1,-1,2,2,2 --light point,9,9,9,50,40,30",
                                       "--ambient 0.1,0.1,0.2",
                                       "--background 0,0,0.1",
                                       "--region 0,1,5,3",
                                       "--width 5",
                                       "--height 4",
                                       "--coverage 3",
                                       "--slab 0.5",
                                       "--shadow-size 9",
                                       "--quality draft",
                                       "--scattering off",
                                       "--threads 1",
                                       "--pfm order.pfm"};
    const int count = sizeof list / sizeof *list;
    char picture[400];
    memset(picture, 0, sizeof picture);
    CHECK(run_render("--volume two.raw --size 2,2,2 --box -1,-1,-1,1,2,1 --extinction 3 --albedo 0.9,0.2,0.4 "
                     "--emission 0.1,0,0 --phase 0.5,-0.3,0.2 --mesh corner.obj --mesh-color 1,0.2,0 --width 5 "
                     "--height 4 --camera 1,2,5,0,0,0 --up 1,1,0 --fov 30 --light directional,-1,-1,-1,2,2,2 "
                     "--light point,9,9,9,50,40,30 --ambient 0.1,0.1,0.2 --background 0,0,0.1 --region 0,1,5,3 "
                     "--coverage 3 --slab 0.5 --shadow-size 9 --quality draft --scattering off --pfm order.pfm")
              .status == 0);
    CHECK(read_file("order.pfm", picture, sizeof picture) == 12 + 4 * 3 * 15);
    for (int first = 0; first < count; ++first) {
        if (!same_picture(list, count, first, 1, picture)) return;
        if (!same_picture(list, count, first, -1, picture)) return;
    }
}

/* Options before the first volume apply to the first, others to the volume that they follow; the same for meshes. */
static void test_owners(void) {
    static const complaint owners[] = {
        {"--size 2,2,2 --volume two.raw --volume two.raw --size 2,2,2 --plan >plan", 0, NULL},
        {"--size 2,2,2 --volume two.raw --volume two.raw --plan", 2, "--volume two.raw has no --size after it"},
        {"--volume two.raw --plan", 2, "--volume two.raw has no --size"},
        {"--size 2,2,1 --volume two.raw --size 2,2,2 --plan >plan", 0, NULL}, /* of two, the last */
        {"--mesh-color 1,0,0 --mesh corner.obj --plan >plan", 0, NULL},
        {"--size 2,2,2 --plan", 2, "--size: there is no --volume"},
        {"--mesh-color 1,0,0 --plan", 2, "--mesh-color: there is no --mesh"},
        {"--mesh-transmittance 1,0,0 --plan", 2, "--mesh-transmittance: there is no --mesh"}};
    CHECK_COMPLAINTS(owners);
}

/* A look is equivalent to its lines: the same picture, with a mesh that lies beside it; later options override it. */
static void test_looks(void) {
    static const complaint good[] = {
        {SMALL "--volume two.raw --size 2,2,2 --transfer look.txt --shading surface --mesh corner.obj "
               "--light directional,-1,-1,-1,2,2,2 --light point,9,9,9,50,40,30 --pfm lines.pfm",
         0, NULL},
        {"--look looks/whole.txt --volume two.raw --pfm look.pfm", 0, NULL},
        {"--look looks/whole.txt --volume two.raw --width 6 --pfm wide.pfm", 0, NULL},
        {"--width 6 --look looks/whole.txt --volume two.raw --pfm narrow.pfm", 0, NULL},
        {"--look looks/empty.txt " VOLUME "--plan >plan", 0, NULL},
        {"--look looks/slide.txt --plan >plan", 0, NULL}};
    static const complaint bad[] = {
        {"--look missing.txt --plan", 2, "missing.txt: No such file"},
        {"--look looks/unknown.txt --plan", 2, "looks/unknown.txt:3: 'bogus' is not an option for a look"},
        {"--look looks/nested.txt --plan", 2, "looks/nested.txt:1: 'look' is not an option for a look"},
        {"--look looks/value.txt --plan", 2, "looks/value.txt:1: --size needs a value: X,Y,Z"},
        {"--look looks/flag.txt --plan", 2, "looks/flag.txt:1: --no-shadows takes no value: 'please'"},
        {"--look looks/range.txt --plan", 2, "looks/range.txt:2: --size: '2,2,0' is out of range"},
        {"--look looks/range.txt", 2, "looks/range.txt:2: --size: '2,2,0' is out of range"},
        {"--look looks/points.txt " VOLUME "--plan", 2, "looks/points.txt:2: --transfer-point: '0.1,0,0,0,0' will not"},
        {"--look looks/whole.txt --volume two.raw --transfer look.txt --plan", 2,
         "--transfer and --transfer-point of two.raw exclude"},
        {"--look looks/whole.txt --volume two.raw --albedo 1,1,1 --plan", 2,
         "--albedo and --transfer-point of two.raw exclude"},
        {"--look looks/whole.txt --volume two.raw --out looks/whole.txt", 2,
         "--out looks/whole.txt is a file that --look reads"},
        {"--look looks/whole.txt --volume two.raw --out looks/corner.obj", 2,
         "--out looks/corner.obj is a file that --mesh reads"},
        {"--look looks/slide.txt --out 'looks/dark, 1.ppm'", 2, "--out looks/dark, 1.ppm is a file that --light reads"},
        {"--transfer-point 0,1,1,1", 2, "--transfer-point: '0,1,1,1' is not value,r,g,b,extinction"},
        {"--transfer-point 0,1,1,2,0", 2, "out of range: r,g,b must be within 0..1"},
        {"--transfer-point -1,1,1,1,0", 2, "out of range: value and extinction must be within 0..1e+18"},
        {"--transfer-point 0,1,1,1,0 --plan", 2, "--transfer-point: there is no --volume"},
        {VOLUME "--transfer-point 2,1,1,1,0 --transfer-point 3,1,1,1,9 --plan", 2,
         "--transfer-point: a line's value is 2, and there are lines beyond it; u8 voxels stand for 0..1"}};
    static const char corner[] = "v -1 0 0\nv 2 0 0\nv 0 2 -1\nf 1 2 3\n", dark[] = "P6 1 1 255 \0\0\0";
    static const char whole[] =
        "# two voxels\r\nwidth 5 # pixels\n\n  height\t4\nscattering off\nsize 2,2,2\nmesh corner.obj\n"
        "transfer-point 0.1,0.9,0.5,0.2,0\ntransfer-point 1,0.9,0.5,0.2,8\nshading surface\n"
        "light directional,-1,-1,-1,2,2,2\nlight point,9,9,9,50,40,30";
    static const char projector[] = "light projector,0,0,5,0,0,-1,30,1,1,1,dark, 1.ppm\n";
    char path[200], lines[400], look[400];
    snprintf(path, sizeof path, "%s/looks", folder);
    CHECK(mkdir(path, 0777) == 0);
    write_file("looks/corner.obj", corner, strlen(corner));
    write_file("looks/whole.txt", whole, strlen(whole));
    write_file("looks/empty.txt", "#\n", 2);
    write_file("looks/dark, 1.ppm", dark, sizeof dark - 1);
    write_file("looks/slide.txt", projector, strlen(projector));
    write_file("looks/unknown.txt", "\n\nbogus 1\n", 10);
    write_file("looks/nested.txt", "look empty.txt\n", 15);
    write_file("looks/value.txt", "size # nothing\n", 15);
    write_file("looks/flag.txt", "no-shadows please\n", 18);
    write_file("looks/range.txt", "type u8\nsize 2,2,0\n", 19);
    write_file("looks/points.txt", "transfer-point 0.1,0,0,0,0\ntransfer-point 0.1,0,0,0,0\n", 54);
    CHECK_COMPLAINTS(good);
    CHECK_COMPLAINTS(bad);
    CHECK(read_file("lines.pfm", lines, sizeof lines) == 12 + 4 * 3 * 20);
    CHECK(read_file("look.pfm", look, sizeof look) == 12 + 4 * 3 * 20);
    CHECK(memcmp(lines, look, 12 + 4 * 3 * 20) == 0);
    CHECK(read_file("wide.pfm", look, sizeof look) == 12 + 4 * 3 * 24);
    CHECK(read_file("narrow.pfm", look, sizeof look) == 12 + 4 * 3 * 20);
}

/* Contradictory options. */
static void test_exclusions(void) {
    static const complaint both[] = {
        {SMALL "--fov 30 --ortho 2 --out a.png", 2, "--fov (perspective) and --ortho (orthographic) exclude"},
        {SMALL "--ortho 2 --fov 30 --out a.png", 2, "--fov (perspective) and --ortho (orthographic) exclude"},
        {VOLUME "--transfer look.txt --extinction 1 --out a.png", 2, "--extinction and --transfer of two.raw"},
        {"--albedo 0.8,0.8,0.8 --transfer look.txt " VOLUME "--out a.png", 2, "--albedo and --transfer of two.raw"},
        {VOLUME "--emission 0,0,0 --transfer look.txt --out a.png", 2, "--emission and --transfer of two.raw"},
        {VOLUME "--emission 1,1,1 --shading surface --out a.png", 2, "--emission and --shading surface of two.raw"},
        {VOLUME "--plan --reference >plan", 2, "--plan and --reference exclude"},
        {VOLUME "--transfer look.txt --phase 0.3 --shading surface --out a.png", 0, NULL},
        {VOLUME "--albedo 1,1,1 --extinction 9 --shading surface --out a.png", 0, NULL},
        {VOLUME "--transfer look.txt --volume two.raw --size 2,2,2 --extinction 5 --out a.png", 0, NULL},
        {VOLUME "--reference --quality high --shadow-size 9 --out a.png", 0, NULL}}; /* to compare one with the other */
    CHECK_COMPLAINTS(both);
}

/* Each line names the option and the invalid number. */
static void test_bad_values(void) {
    static const complaint bad[] = {
        {"--bogus", 2, "unknown option '--bogus'"},
        {"two.raw", 2, "unknown option 'two.raw'"},
        {"$(printf '\\033[31m')", 2, "unknown option '?[31m'"},
        {"--size", 2, "--size needs a value: X,Y,Z"},
        {"--size --plan", 2, "--size needs a value: X,Y,Z"},
        {"--size 2,2", 2, "--size: '2,2' is not X,Y,Z"},
        {"--size 2,2,2,2", 2, "--size: '2,2,2,2' is not X,Y,Z"},
        {"--size 2,2,2.0", 2, "--size: '2,2,2.0' is not X,Y,Z"},
        {"--size 2,2,0", 2, "--size: '2,2,0' is out of range: X,Y,Z must be within 1..65536"},
        {"--size 2,2,99999999999999999999", 2, "X,Y,Z must be within 1..65536"},
        {"--size ''", 2, "--size: '' is not X,Y,Z"},
        {"--size \"$(printf '2\\n2')\"", 2, "--size: '2?2' is not X,Y,Z"},
        {"--type u64", 2, "--type: 'u64' is not u8|i8|u16|i16|u32|i32|f32|f64"},
        {"--quality default", 2, "--quality: 'default' is not draft|medium|high|ultra"},
        {"--box 0,0,0,1,1,1e17", 2, "must be within -1e+15..1e+15"},
        {"--box 0,0,0,1,1,nan", 2, "--box: '0,0,0,1,1,nan' is not x0,y0,z0,x1,y1,z1"},
        {VOLUME "--box 0,0,0,1,0,1 --plan", 2, "--box of two.raw: no extent along y"},
        {"--extinction -1", 2, "--extinction: '-1' is out of range: S must be within 0..1e+18"},
        {"--extinction 1e999", 2, "--extinction: '1e999' is out of range: S must be within 0..1e+18"},
        {"--albedo 0.5,0.5,1.5", 2, "r,g,b must be within 0..1"},
        {"--mesh-transmittance 0.5,0.5,1.5", 2, "--mesh-transmittance: '0.5,0.5,1.5' is out of range"},
        {"--mesh-transmittance 0.5", 2, "--mesh-transmittance: '0.5' is not r,g,b"},
        {"--phase .5,.5", 2, "--phase: '.5,.5' is not g[,g2,w]"},
        {"--phase .5,.5,2", 2, "--phase: '.5,.5,2' is out of range: w must be within 0..1"},
        {"--phase 1", 2, "--phase: '1' is out of range: g and g2 must be within -0.99..0.99"},
        {"--phase .5,-1,0", 2, "g and g2 must be within -0.99..0.99"},
        {"--camera 0,0,0,0,0,0", 2, "--camera: '0,0,0,0,0,0' will not do: position and target are the same point"},
        {"--camera 0,0,0,0,0,1e16", 2, "must be within -1e+15..1e+15"},
        {"--fov 0", 2, "--fov: '0' is out of range: DEG must be within 0.001..177"},
        {"--ortho 1e16", 2, "--ortho: '1e16' is out of range: HEIGHT must be within 1e-15..1e+15"},
        {"--light sun,0,0,1,1,1,1", 2, "--light: 'sun,0,0,1,1,1,1' is not directional,dx,dy,dz,r,g,b | point,x"},
        {"--light point,0,0,1,1,1", 2, "--light: 'point,0,0,1,1,1' is not directional"},
        {"--light directional,0,0,0,1,1,1", 2, "'directional,0,0,0,1,1,1' will not do: the direction is zero"},
        {"--light directional,0,0,1,1,-1,1", 2, "out of range: r,g,b must be within 0..1e+18"},
        {"--light point,0,0,1e16,1,1,1", 2, "out of range: x,y,z must be within -1e+15..1e+15"},
        {"--width 0", 2, "--width: '0' is out of range: W must be within 1..16384"},
        {SMALL "--region 0,0,6,1 --out a.png", 2, "--region 0,0,6,1 is empty or not within the image of 5 x 4"},
        {SMALL "--region 0,0,0,0 --out a.png", 2, "--region 0,0,0,0 is empty"},
        {"--slab 0", 2, "--slab: '0' is out of range"},
        {"--threads 0", 2, "--threads: '0' is out of range: N must be within 1..1024"},
        {"--out ''", 2, "--out: '' is not FILE.png"},
        {VOLUME, 2, "nothing to write"}};
    CHECK_COMPLAINTS(bad);
}

/* Two balls, soft and by extinction: there is a picture, and the statistics count them. */
static void test_particles_option(void) {
    static const complaint all[] = {
        {"--particle-soft --particles balls.f32 --particle-phase 0.5 --particle-emission 1,0,0 --particle-extinction "
         "--particle-albedo 1,0.5,0 --width 20 --height 20 --alpha-pfm b.pfm --stats a.json",
         0, NULL},
        {"--particles balls.f32 --plan >plan", 0, NULL},
        {"--particle-soft --plan", 2, "--particle-soft: there is no --particles"},
        {"--particles balls.f32 --out balls.f32", 2, "--out balls.f32 is a file that --particles reads"},
        {"--particles balls.f32 --particle-albedo 2,0,0 --plan", 2, "--particle-albedo: '2,0,0' is out of range"}};
    static const float balls[10] = {0, 0, 0, 1, 3, 0.5f, 0.25f, 0, 0.5f, 2};
    char text[4000];
    float middle;
    write_file("balls.f32", balls, sizeof balls);
    CHECK_COMPLAINTS(all);
    CHECK(read_file("a.json", text, sizeof text) > 60 && strstr(text, "\"particles\": 2,"));
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "particle_calls   1"));
    CHECK(read_file("b.pfm", text, sizeof text) > 4 * 400);
    memcpy(&middle, strstr(text, "-1.0\n") + 5 + 4 * (10 * 20 + 10), sizeof middle);
    CHECK(middle > 0.9f && middle <= 1); /* three times 4/3 of a unit, at least */
}

/* Every kind of shadow makes a picture of its own, and so does every way to read a map; options for a map must fit the
   kind of map. */
static void test_shadow_option(void) {
    enum { KINDS = 14 };
    static const char *const kinds[KINDS] = {"sheets",       "deep",
                                             "compressed",   "compressed --map-components 16",
                                             "opacity",      "opacity --map-cubic",
                                             "deep-opacity", "deep-opacity --map-cubic",
                                             "fourier",      "fourier --map-texel-range",
                                             "moment",       "beer",
                                             "table",        "none"};
    static const complaint all[] = {
        {VOLUME "--shadow fourier --map-components 4 " SMALL "--light directional,0,0,-1,1,1,1 --out a.png", 2,
         "--map-components: light[0].shadow_map.components is 4; a Fourier map has 3, 5 .. 65"},
        {VOLUME "--map-size 8 --plan", 2, "--map-size says nothing about --shadow auto"},
        {VOLUME "--shadow deep --no-shadows --plan", 2, "--shadow deep says nothing with --no-shadows"},
        {VOLUME "--shadow deep --map-epsilon 0.1 --plan", 2, "--map-epsilon says nothing about --shadow deep"},
        {VOLUME "--shadow fourier --map-cubic --plan", 2, "--map-cubic says nothing about --shadow fourier"},
        {VOLUME "--map-cubic --shadow sheets --plan", 2, "--map-cubic says nothing about --shadow sheets"},
        {VOLUME "--map-texel-range --shadow moment --plan", 2, "--map-texel-range says nothing about --shadow moment"},
        {VOLUME "--table-size 8 --shadow sheets --plan", 2, "--table-size says nothing about --shadow sheets"},
        {VOLUME "--table-size 8 --plan >plan", 0, NULL},
        {VOLUME "--shadow samples --no-shadows --out a.png", 2, "--shadow samples says nothing with --no-shadows"},
        {VOLUME "--shadow samples --plan", 2, "--plan and --shadow samples exclude each other"},
        {VOLUME "--shadow samples --light directional,0,0,1,1,1,1 --light-angle 1 --out a.png", 0, NULL},
        {VOLUME "--shadow deep --table-size 8 --plan", 2, "--table-size says nothing about --shadow deep"},
        {VOLUME "--shadow table --map-size 8 --plan", 2, "--map-size says nothing about --shadow table"},
        {VOLUME "--shadow table --map-cubic --plan", 2, "--map-cubic says nothing about --shadow table"},
        {VOLUME "--shadow table --no-shadows --plan", 2, "--shadow table says nothing with --no-shadows"},
        {VOLUME "--shadow table --map-components 7 " SMALL "--light directional,0,0,-1,1,1,1 --out a.png", 2,
         "--map-components: light[0].shadow_map.components is 7; a shadow table has 8, 9 .. 1024"},
        {VOLUME "--shadow none --map-components 8 --plan", 2, "--map-components says nothing about --shadow none"},
        {VOLUME "--shadow none --light point,9,9,9,1,1,1 --light-size 1 --plan >plan", 0, NULL},
        {VOLUME "--shadow hairy --plan", 2, "--shadow: 'hairy' is not auto|sheets|deep"},
        {VOLUME "--light point,0.5,0.5,0.5,1,1,1 --shadow opacity --map-size 9 " SMALL "--out a.png", 0, NULL},
        {VOLUME "--shadow fourier --map-components 7 --light directional,0,0,-1,1,1,1 " SMALL "--out a.png", 0, NULL}};
    static char pictures[KINDS][400];
    for (int i = 0; i < KINDS; ++i) {
        char line[300];
        snprintf(line, sizeof line,
                 VOLUME SMALL "--extinction 15 --light directional,1,-1,-1,9,9,9 --shadow %s --pfm shadow.pfm",
                 kinds[i]);
        CHECK(run_render(line).status == 0);
        CHECK(read_file("shadow.pfm", pictures[i], sizeof pictures[i]) > 12);
        for (int k = 0; k < i; ++k)
            if (!CHECK(memcmp(pictures[k], pictures[i], sizeof pictures[i]) != 0))
                printf("    %s and %s give one picture\n", kinds[k], kinds[i]);
    }
    CHECK_COMPLAINTS(all);
}

#define CAST   VOLUME "--extinction 15 --light directional,1,-1,-1,9,9,9 "
#define INSIDE "--light point,0.5,0.5,0.5,1,1,1 "

/* Renders both into shadow.pfm. */
static int same_shadows(const char *line_a, const char *line_b) {
    char a[400], b[400];
    CHECK(run_render(line_a).status == 0);
    const int size = read_file("shadow.pfm", a, sizeof a);
    CHECK(run_render(line_b).status == 0);
    return CHECK(size > 12 && read_file("shadow.pfm", b, sizeof b) == size) && memcmp(a, b, (size_t)size) == 0;
}

static int says(const char *file, const char *words) {
    static char text[8000];
    CHECK(read_file(file, text, sizeof text) > 0);
    return strstr(text, words) != NULL;
}

/* By default the first light has sheets, and one in the gas has a table, as large as it is to be; all have sheets where
   they are forced. Samples are those of the reference. */
static void test_chosen_option(void) {
    CHECK(run_render(CAST INSIDE "--stats stats.json --out a.png").status == 0);
    CHECK(says("stats.json", "\"tables_made\": 1,"));
    CHECK(run_render(CAST INSIDE "--plan >plan").status == 0);
    CHECK(says("plan", "a table: the light is in the gas") && says("plan", "tables_made      1\n"));
    CHECK(same_shadows(CAST INSIDE "--pfm shadow.pfm", CAST INSIDE "--shadow auto --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST INSIDE "--pfm shadow.pfm", CAST INSIDE "--table-size 8 --pfm shadow.pfm"));
    CHECK(run_render(CAST "--light directional,1,0,-1,9,9,9 --plan >plan").status == 0);
    CHECK(says("plan", "a table: the light shares the sweep of another"));
    CHECK(run_render(CAST "--light directional,1,0,-1,9,9,9 --shadow sheets --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      0\n") && says("plan", "sweep_count      2\n"));
    CHECK(same_shadows(CAST "--shadow samples --pfm shadow.pfm", CAST "--reference --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow samples --pfm shadow.pfm", CAST "--pfm shadow.pfm"));
}

/* The size of a table and its planes change the picture; plan and statistics count tables; --shadow none is
   --no-shadows. */
static void test_table_option(void) {
    CHECK(same_shadows(CAST "--shadow table --pfm shadow.pfm", CAST "--shadow table --threads 1 --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow table --pfm shadow.pfm", CAST "--shadow table --table-size 8 --pfm shadow.pfm"));
    CHECK(!same_shadows(CAST "--shadow table --pfm shadow.pfm",
                        CAST "--shadow table --map-components 9 --pfm shadow.pfm"));
    CHECK(same_shadows(CAST "--shadow none --pfm shadow.pfm", CAST "--no-shadows --pfm shadow.pfm"));
    CHECK(same_shadows(CAST "--shadow none --reference --pfm shadow.pfm",
                       CAST "--no-shadows --reference --pfm shadow.pfm"));
    CHECK(run_render(CAST "--light point,0.5,0.5,0.5,1,1,1 --shadow table --stats stats.json --out a.png").status == 0);
    CHECK(says("stats.json", "\"tables_made\": 2,") && says("stats.json", "\"tables_held\": 0,"));
    CHECK(run_render(CAST "--shadow table --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      1\n"));
    CHECK(run_render(CAST "--shadow deep --plan >plan").status == 0);
    CHECK(says("plan", "tables_made      0\n"));
    test_chosen_option();
}

/* Runs a line that writes extent.pfm, and compares it with the same picture of 5 x 4 pixels by the library. Floats
   differ by what the two programs' compilers make of a sum. */
static void check_same_pfm(const char *line, const float *rgba) {
    char file[400];
    float rows[3 * 20];
    CHECK(run_render(line).status == 0);
    if (!CHECK(read_file("extent.pfm", file, sizeof file) == 12 + sizeof rows)) return;
    memcpy(rows, file + 12, sizeof rows);
    for (int pixel = 0; pixel < 20; ++pixel)
        for (int c = 0; c < 3; ++c)
            CHECK_NEAR((double)rows[3 * ((3 - pixel / 5) * 5 + pixel % 5) + c], (double)rgba[4 * pixel + c], 1e-5);
}

/* The view of these tests: SMALL, and --mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5. */
static void start_corner(check_scene *s, check_triangles *corner) {
    static const double origin[3] = {-1, 0, 0}, right[3] = {2, 0, 0}, top[3] = {0, 2, -1};
    corner->count = 0;
    check_add_corners(corner, origin, right, top);
    check_clear(s, 5, 4);
    check_add_mesh(s, corner, 0.8);
    check_set3(s->view.camera.position, 0.5, 1, 4);
    check_set3(s->view.camera.target, 0.5, 1, -0.5);
    check_set3(s->view.camera.up, 0, 1, 0);
    check_perspective(&s->view.camera, 40 * PI / 180);
}

/* The share of a white background that corner.obj lets pass, of each color. */
static void test_translucent_mesh(void) {
    static const float passes[3] = {0.5f, 0.25f, 1};
    const int inside = 4 * (2 * 5 + 2);
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    float rgba[4 * 20];
    check_scene s;
    start_corner(&s, &triangles);
    memcpy(s.mesh[0].transmittance, passes, sizeof passes);
    for (int c = 0; c < 3; ++c) s.scene.background[c] = 1;
    check_render(context, &s, rgba);
    for (int c = 0; c < 3; ++c) CHECK_NEAR((double)rgba[inside + c], (double)passes[c], 1e-6); /* round-off */
    check_same_pfm(SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --mesh-transmittance 0.5,0.25,1 "
                         "--background 1,1,1 --pfm extent.pfm",
                   rgba);
    check_free_triangles(&triangles);
    sps_destroy(context);
}

#define THICK "--volume two.raw --size 2,2,2 --width 5 --height 4 --extinction 9 --light directional,1,-1,-1,9,9,9 "
#define FEW   "--scatter-size 8 --pfm shadow.pfm"

/* By default light scatters as often as the scene calls for; in the reference once if it has no paths, which it says,
   unless another option says so. */
static void test_scattering_option(void) {
    static const complaint all[] = {
        {THICK "--reference --out a.png", 0, "--reference without --samples: light scatters once (--scattering off)"},
        {THICK "--shadow samples --out a.png", 0, "--shadow samples without --samples: light scatters once"},
        {THICK "--reference --scattering off --out a.png", 0, NULL},
        {THICK "--reference --scattering forward --out a.png", 0, NULL},
        {THICK "--reference --samples 1 --out a.png", 0, NULL},
        {"--mesh corner.obj --width 5 --height 4 --reference --out a.png", 0, NULL}, /* there is no gas */
        {THICK "--reference --scattering auto --out a.png", 1, "--scattering: view.scattering is SPS_SCATTERING_AUTO"},
        {THICK "--reference --scattering full --out a.png", 1, "(--samples N, or --scattering off)"},
        {THICK "--scattering once --plan", 2, "--scattering: 'once' is not auto|off|ambient|forward|convolution|full"}};
    CHECK_COMPLAINTS(all);
    CHECK(same_shadows(THICK FEW, THICK "--scattering auto " FEW));
    CHECK(same_shadows(THICK FEW, THICK "--scattering full " FEW));
    CHECK(!same_shadows(THICK FEW, THICK "--scattering off " FEW));
    CHECK(same_shadows(THICK "--reference " FEW, THICK "--reference --scattering off " FEW));
    CHECK(!same_shadows(THICK "--reference " FEW, THICK "--reference --scattering forward " FEW));
}
#undef THICK
#undef FEW

#define LIT VOLUME "--reference --albedo 1,1,1 --extinction 9 --ambient 1,1,1 "

/* Paths of the reference; 0 of them is none. */
static void test_samples_option(void) {
    static const complaint all[] = {
        {"--reference --samples -1", 2, "--samples: '-1' is out of range: N must be within 0.."},
        {SMALL VOLUME "--samples 2", 2, "--samples says nothing without --reference"},
        {SMALL VOLUME "--shadow sheets --samples 2", 2, "--samples says nothing"}};
    CHECK_COMPLAINTS(all);
    CHECK(same_shadows(LIT "--pfm shadow.pfm", LIT "--samples 0 --pfm shadow.pfm"));
    CHECK(!same_shadows(LIT "--pfm shadow.pfm", LIT "--samples 9 --pfm shadow.pfm"));
}
#undef LIT

#define EDGES SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --ambient 1,1,1 --pfm extent.pfm "

/* Edges of corner.obj, sampled and not, by both renderers, against the library's pictures; 0 and 1 are the same. */
static void test_coverage_option(void) {
    static const complaint all[] = {{"--coverage 9", 2, "--coverage: '9' is out of range: N must be within 0..8"},
                                    {"--coverage -1", 2, "--coverage: '-1' is out of range: N must be within 0..8"},
                                    {"--coverage 2.5", 2, "--coverage: '2.5' is not N"},
                                    {EDGES "--coverage 8 --plan >sampled", 0, NULL},
                                    {EDGES "--coverage 4 --stats sampled.json", 0, NULL},
                                    {EDGES "--coverage 1 --plan >single", 0, NULL},
                                    {EDGES "--coverage 1 --stats single.json", 0, NULL}};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    float rgba[4][4 * 20];
    check_scene s;
    start_corner(&s, &triangles);
    for (int c = 0; c < 3; ++c) s.scene.ambient[c] = 1;
    for (int i = 0; i < 4; ++i) {
        const int samples = i & 1 ? 4 : 0, by_reference = i >> 1;
        char line[300];
        s.view.coverage_samples = samples;
        if (by_reference)
            check_march(context, &s, 0.5, rgba[i], NULL);
        else
            check_render(context, &s, rgba[i]);
        snprintf(line, sizeof line, EDGES "%s --coverage %d", by_reference ? "--reference" : "", samples);
        check_same_pfm(line, rgba[i]);
    }
    CHECK(memcmp(rgba[0], rgba[1], sizeof rgba[0]) != 0 && memcmp(rgba[2], rgba[3], sizeof rgba[2]) != 0);
    CHECK(same_shadows(VOLUME "--mesh corner.obj --pfm shadow.pfm",
                       VOLUME "--mesh corner.obj --coverage 1 --pfm shadow.pfm"));
    CHECK_COMPLAINTS(all);
    CHECK(says("sampled", "coverage_samples is set") && says("single", "coverage_samples is not set"));
    CHECK(says("single.json", "\"layers\": 0,") && !says("sampled.json", "\"layers\": 0,"));
    check_free_triangles(&triangles);
    sps_destroy(context);
}
#undef EDGES

/* A disc and a rectangle before the middle of corner.obj (0.5, 1, -0.5), and a sun, against the same lights in the
   library: W lies along x, which is perpendicular to --up and to the way from light to middle, and H along y. */
static void test_extents_as_placed(void) {
    static const char *const options[] = {"--light point,0.5,1,2,9,9,9 --light-size 0.9",
                                          "--light point,0.5,1,2,9,9,9 --light-size 2,0.6",
                                          "--light directional,0,-1,-1,3,3,3 --light-angle 60"};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    for (int i = 0; i < 3; ++i) {
        char line[300];
        float rgba[4 * 20];
        check_scene s;
        sps_light *light;
        start_corner(&s, &triangles);
        light = i < 2 ? check_add_point(&s, 0.5, 1, 2, 9) : check_add_directional(&s, 0, -1, -1, 3);
        light->samples = 7;
        if (i < 2) light->kind = i == 0 ? SPS_LIGHT_DISC : SPS_LIGHT_RECTANGLE;
        check_set3(light->axes[0], i == 0 ? 0.9 : 1, 0, 0);
        check_set3(light->axes[1], 0, i == 0 ? 0.9 : 0.3, 0);
        if (i == 2) light->angular_diameter = PI / 3;
        check_render(context, &s, rgba);
        snprintf(line, sizeof line,
                 SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 %s --light-samples 7 --pfm extent.pfm",
                 options[i]);
        check_same_pfm(line, rgba);
    }
    check_free_triangles(&triangles);
    sps_destroy(context);
}

/* A slide of three texels by two, none like another, as a PPM file, in the sRGB curve of its own formula. */
static void write_slide(const char *name, int most) {
    char head[40];
    unsigned char file[100];
    const int length = snprintf(head, sizeof head, "P6\n# three by two\n3 2\n%d\n", most);
    int at = length;
    memcpy(file, head, (size_t)length);
    for (int i = 0; i < 18; ++i) {
        const int code = 37 * i % 256 * (most > 255 ? 257 : 1);
        if (most > 255) file[at++] = (unsigned char)(code >> 8);
        file[at++] = (unsigned char)(code & 255);
    }
    write_file(name, file, (size_t)at);
}

/* sps_projector.sample_fn: the colors of write_slide. */
static int sample_slide(void *user, size_t count, const float *uv, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            const int x = (int)(3 * uv[2 * i]), y = (int)(2 * uv[2 * i + 1]);
            const double code = 37 * (3 * (3 * y + x) + c) % 256 / 255.0;
            out[3 * i + (size_t)c] = (float)(code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4));
        }
    return 0;
}

/* A light at (0.5, 1, 2) that throws an image of half a unit on either side of y = 1 at the distance 2.5. */
static sps_light *add_slide(check_scene *s, sps_projector *projector, int kind) {
    sps_light *light = check_add_point(s, 0.5, 1, 2, 9);
    memset(projector, 0, sizeof *projector);
    projector->width = 3, projector->height = 2;
    projector->sample_fn = sample_slide;
    projector->top = tan(0.5 * 50 * PI / 180), projector->bottom = -projector->top;
    projector->right = projector->top * 3 / 2, projector->left = -projector->right;
    check_set3(projector->up, 0, 1, 0);
    check_set3(light->direction, -0.6, 0, -2);
    light->projector = projector;
    if (kind == 0) return light;
    light->kind = kind == 1 ? SPS_LIGHT_DISC : SPS_LIGHT_RECTANGLE;
    light->samples = 7;
    projector->focus = 3;
    check_set3(light->axes[0], (kind == 1 ? 0.4 : 0.5) * 2 / sqrt(4.36), 0,
               (kind == 1 ? 0.4 : 0.5) * -0.6 / sqrt(4.36));
    check_set3(light->axes[1], 0, kind == 1 ? 0.4 : 0.1, 0);
    if (kind == 2) light->falloff = SPS_FALLOFF_NONE;
    return light;
}

/* A projector by options, against the same one in the library: sharp, through a disc, and through a rectangle, whose W
   lies across the direction and --up. The light does not point at the middle of the scene, so that an extent that faced
   it would show. */
static void test_projector_as_placed(void) {
    static const char *const options[] = {"'projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide, 8.ppm'",
                                          "projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide16.ppm --light-size 0.4 "
                                          "--light-focus 3 --light-samples 7",
                                          "projector,0.5,1,2,-0.6,0,-2,50,9,9,9,slide16.ppm --light-size 1,0.2 "
                                          "--light-focus 3 --light-samples 7 --light-falloff none"};
    check_triangles triangles = {0};
    sps_context *context = check_context(NULL);
    write_slide("slide, 8.ppm", 255);
    write_slide("slide16.ppm", 65535);
    for (int i = 0; i < 3; ++i) {
        char line[300];
        float rgba[4 * 20];
        sps_projector projector;
        check_scene s;
        start_corner(&s, &triangles);
        add_slide(&s, &projector, i);
        check_render(context, &s, rgba);
        snprintf(line, sizeof line, SMALL "--mesh corner.obj --camera 0.5,1,4,0.5,1,-0.5 --light %s --pfm extent.pfm",
                 options[i]);
        check_same_pfm(line, rgba);
    }
    check_free_triangles(&triangles);
    sps_destroy(context);
}

/* A projector's options and files that are wrong. */
static void test_projector_options(void) {
#define THROW  "--light projector,0,0,5,0,0,-1,30,1,1,1,"
#define THROWN "--light projector,0,0,5,0,0,-1,30,1,1,1,slide16.ppm "
    static const complaint all[] = {
        {VOLUME THROWN "--plan >plan", 0, NULL},
        {VOLUME THROWN "--stats a.json", 0, NULL},
        {VOLUME THROWN "--shadow compressed --out a.png", 0, NULL},
        {"--light projector,0,0,5,0,0,-1,30,1,1,1", 2, "is not directional,dx,dy,dz,r,g,b"},
        {THROW, 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,5,0,0,-1,1,1,1,slide16.ppm", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,5,0,0,-1,3x,1,1,1,slide16.ppm", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light projector,0,0,1e16,0,0,-1,30,1,1,1,a", 2, "x,y,z must be within"},
        {"--light projector,0,0,5,0,0,-1e16,30,1,1,1,a", 2, "dx,dy,dz must be within"},
        {"--light projector,0,0,5,0,0,0,30,1,1,1,a", 2, "the direction is zero"},
        {"--light projector,0,0,5,0,0,-1,0,1,1,1,a", 2, "angle must be within 0.001..177"},
        {"--light projector,0,0,5,0,0,-1,178,1,1,1,a", 2, "angle must be within 0.001..177"},
        {"--light projector,0,0,5,0,0,-1,30,1,-1,1,a", 2, "r,g,b must be within 0..1e+18"},
        {THROW "no.ppm --plan", 2, "no.ppm: No such file"},
        {THROW ". --plan", 2, ".: not a regular file"},
        {THROW "two.raw --plan", 2, "two.raw: not a binary PPM file ('P6')"},
        {THROW "cut.ppm --plan", 2, "cut.ppm: the file ends amid its pixels"},
        {THROW "p3.ppm --plan", 2, "p3.ppm: not a binary PPM file ('P6')"},
        {THROW "zero.ppm --plan", 2, "zero.ppm: 0 x 2 pixels; there may be 1..4096 on a side"},
        {THROW "wide.ppm --plan", 2, "wide.ppm: 4097 x 1 pixels; there may be 1..4096 on a side"},
        {THROW "most.ppm --plan", 2, "most.ppm: not a binary PPM file ('P6')"},
        {THROWN "--out slide16.ppm", 2, "--out slide16.ppm is a file that --light reads"},
        {THROWN "--light-focus 3 --plan", 2,
         "--light-focus says nothing about --light projector,0,0,5,0,0,-1,30,1,1,1,"
         "slide16.ppm, which has no --light-size"},
        {"--light point,0,0,5,1,1,1 --light-size 1 --light-focus 3 --plan", 2,
         "--light-focus says nothing about --light point,0,0,5,1,1,1, which is not a projector"},
        {"--light-focus 0", 2, "--light-focus: '0' is out of range: D must be within 1e-15..1e+15"},
        {"--light-focus 1 --plan", 2, "--light-focus: there is no --light that it could be about"},
        {THROWN "--light-angle 3 --plan", 2, "give --light-size"},
        {THROWN "--light-size 1 --shadow deep --plan", 2, "exclude each other: a map holds the shadow of a point"},
        {"--light projector,0,0,5,1,2,3,30,1,1,1,slide16.ppm --light-size 1e15 --light-focus 1e-15 --plan", 2,
         "--light-focus: light[0].projector.focus is 1e-15; it must be 0, or within 1e15 and beyond the extent"},
        {"--light-falloff linear", 2, "--light-falloff: 'linear' is not inverse-square|none"},
        {"--light directional,0,0,1,1,1,1 --light-falloff none --plan", 2,
         "--light-falloff says nothing about --light directional,0,0,1,1,1,1: it has no position"},
        {VOLUME "--light point,3,4,2,1,1,1 --light-falloff inverse-square --pfm near.pfm", 0, NULL},
        {VOLUME "--light point,3,4,2,1,1,1 --pfm hard.pfm", 0, NULL}};
    char text[4000], other[400];
    write_file("cut.ppm", "P6 3 2 255 12345678901234567", 28);
    write_file("p3.ppm", "P3 1 1 255 1 1 1", 16);
    write_file("zero.ppm", "P6 0 2 255 ", 11);
    write_file("wide.ppm", "P6 4097 1 255 ", 14);
    write_file("most.ppm", "P6 1 1 70000 123456", 19);
    CHECK_COMPLAINTS(all);
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "projector_calls  2\n"));
    CHECK(read_file("a.json", text, sizeof text) > 60 && strstr(text, "\"projector_calls\": 2,"));
    CHECK(read_file("near.pfm", text, sizeof text) == read_file("hard.pfm", other, sizeof other));
    CHECK(memcmp(text, other, 12 + 4 * 3 * 20) == 0);
#undef THROW
#undef THROWN
}

/* Each extent makes a picture of its own, one of 0 that of a light without; what has no effect is a mistake. */
static void test_light_options(void) {
    enum { EXTENTS = 9, HARD = 2 };
    static const char *const extents[EXTENTS] = {"--light point,3,4,2,90,90,90",
                                                 "--light directional,-1,-1,-1,9,9,9",
                                                 "--light point,3,4,2,90,90,90 --light-size 1",
                                                 "--light-size 2,0.5 --light point,3,4,2,90,90,90",
                                                 "--light point,3,4,2,90,90,90 --light-size 0.5,2",
                                                 "--light point,3,4,2,90,90,90 --light-size 1 --light-samples 5",
                                                 "--light directional,-1,-1,-1,9,9,9 --light-angle 20",
                                                 "--light directional,-1,-1,-1,9,9,9 --light-angle 20 --quality high",
                                                 "--light point,3,4,2,90,90,90 --light-size 1 --light "
                                                 "directional,-1,-1,-1,9,9,9 --light-angle 20"};
    static const complaint all[] = {
        {VOLUME "--light point,3,4,2,9,9,9 --light-size 0,0 --light-samples 256 --pfm point.pfm", 0, NULL},
        {VOLUME "--light point,3,4,2,9,9,9 --pfm hard.pfm", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --light-samples 3 --reference --out a.png", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --no-shadows --out a.png", 0, NULL},
        {VOLUME "--light point,3,4,2,1,1,1 --light-size 1 --light-samples 3 --plan >plan", 0, NULL},
        {VOLUME "--light directional,0,0,-1,1,1,1 --light-angle 0 --out a.png", 0, NULL},
        {VOLUME "--light spot,3,4,2,-3,-4,-2,5,20,90,90,90 --light-size .2 --light-samples 3 --out a.png", 0, NULL},
        {"--light spot,1,2,3,0,0,0,5,20,1,1,1", 2, "the direction is zero"},
        {"--light spot,1,2,3,0,0,1,20,5,1,1,1", 2, "the inner angle must be less than the outer"},
        {"--light spot,1,2,3,0,0,1,5,200,1,1,1", 2, "inner,outer must be within 0..180"},
        {"--light spot,1,2,3,0,0,1e16,5,20,1,1,1", 2, "dx,dy,dz must be within"},
        {"--light spot,1,2,3,0,0,1,1,1,1", 2, "is not directional,dx,dy,dz,r,g,b"},
        {"--light-size 1 --plan", 2, "--light-size: there is no --light that it could be about"},
        {"--light-size -1", 2, "--light-size: '-1' is out of range: R | W,H must be within 0..1e+15"},
        {"--light-size 1,-1", 2, "--light-size: '1,-1' is out of range"},
        {"--light-size wide", 2, "--light-size: 'wide' is not R | W,H"},
        {"--light-size 1,2,3", 2, "--light-size: '1,2,3' is not R | W,H"},
        {"--light-size nan", 2, "--light-size: 'nan' is not R | W,H"},
        {"--light-angle -1", 2, "--light-angle: '-1' is out of range: DEG must be within 0..114"},
        {"--light-angle 115", 2, "--light-angle: '115' is out of range"},
        {"--light-angle 1,1", 2, "--light-angle: '1,1' is not DEG"},
        {"--light-samples 0", 2, "--light-samples: '0' is out of range: K must be within 1..256"},
        {"--light-samples 257", 2, "--light-samples: '257' is out of range"},
        {"--light-samples 1.5", 2, "--light-samples: '1.5' is not K"},
        {"--light directional,0,0,1,1,1,1 --light-size 1 --plan", 2,
         "--light-size says nothing about --light directional,0,0,1,1,1,1: give --light-angle"},
        {"--light point,0,0,1,1,1,1 --light-angle 1 --plan", 2,
         "--light-angle says nothing about --light point,0,0,1,1,1,1: give --light-size"},
        {"--light point,0,0,1,1,1,1 --light-samples 9 --plan", 2,
         "--light-samples says nothing about --light point,0,0,1,1,1,1, which has no --light-size"},
        {"--light directional,0,0,1,1,1,1 --light-samples 9 --plan", 2, "which has no --light-angle"},
        {"--light point,0,0,1,1,1,1 --light directional,0,0,1,1,1,1 --light-size 1 --plan", 2,
         "--light-size says nothing about --light directional,0,0,1,1,1,1"},
        {VOLUME "--light point,9,9,9,1,1,1 --light-size 1 --shadow deep --plan", 2,
         "--light-size of --light point,9,9,9,1,1,1 and --shadow deep exclude each other: a map holds the shadow"},
        {VOLUME "--shadow beer --map-size 9 --light directional,0,0,1,1,1,1 --light-angle 1 --plan", 2,
         "--light-angle of --light directional,0,0,1,1,1,1 and --shadow beer exclude each other"},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --out a.png", 0, NULL},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --shadow sheets --out a.png", 1,
         "--light point,.5,.5,.5,1,1,1: light[0]"},
        {VOLUME "--light point,.5,.5,.5,1,1,1 --light-size 1 --shadow sheets --out a.png", 1,
         "no_shadow on it (--shadow auto, --no-shadows and --reference have no such limit)"}};
    static char pictures[EXTENTS][400];
    char text[4000], other[400];
    for (int i = 0; i < EXTENTS; ++i) {
        char line[400];
        snprintf(line, sizeof line, VOLUME "--mesh corner.obj --extinction 15 %s --pfm extent.pfm --stats a.json",
                 extents[i]);
        CHECK(run_render(line).status == 0);
        CHECK(read_file("extent.pfm", pictures[i], sizeof pictures[i]) > 12);
        CHECK(read_file("a.json", text, sizeof text) > 12);
        CHECK((strstr(text, "\"soft_texels\": 0,") != NULL) == (i < HARD));
        for (int k = 0; k < i; ++k)
            if (!CHECK(memcmp(pictures[k], pictures[i], sizeof pictures[i]) != 0))
                printf("    %s and %s give one picture\n", extents[k], extents[i]);
    }
    CHECK_COMPLAINTS(all);
    CHECK(read_file("plan", text, sizeof text) > 60 && strstr(text, "light_points     3\n"));
    CHECK(read_file("point.pfm", text, sizeof text) == read_file("hard.pfm", other, sizeof other));
    CHECK(memcmp(text, other, 12 + 4 * 3 * 20) == 0);
    test_extents_as_placed();
    test_projector_as_placed();
    test_projector_options();
}

#define WIDE "--camera .5,.5,.5,.5,.5,0 --fov 170 --light directional,1,0,0.1,1,1,1 "

/* Errors that only the library detects name the option. */
static void test_library_errors(void) {
    static const complaint library[] = {
        {VOLUME "--slab 1e-6 --out a.png", 2, "--slab: view.slab is 1e-06; it makes more than 2^20 slabs"},
        {VOLUME "--slab 1e-6 --plan", 2, "--slab: view.slab is 1e-06"},
        {VOLUME "--box -1e15,0,0,1e15,1,1 --camera 1,2,3,0,0,0 --out a.png", 2, "--box of two.raw: "},
        {VOLUME "--box -1e15,0,0,1e15,1,1 --out a.png", 2, "--camera (not given, so that all of the scene is in view)"},
        {VOLUME "--ortho 1e-15 --camera 1e15,0,0,0,0,0 --out a.png", 1,
         "--box of two.raw: volume[0].placement's voxel edge"},
        {"--volume nan.raw --type f32 --size 1,1,1 " SMALL "--out a.png", 2, "--volume nan.raw: volume[0].value is "},
        {VOLUME INSIDE "--shadow sheets --out a.png", 1, "--light point,0.5,0.5,0.5,1,1,1: light[0]"},
        {VOLUME INSIDE "--shadow sheets --out a.png", 1, "(--shadow auto, --no-shadows and --reference have no such"},
        {VOLUME INSIDE "--out a.png", 0, NULL},
        {VOLUME WIDE "--shadow sheets --out a.png", 1, "--fov: view.camera.field_of_view is 2.96706: one of"},
        {VOLUME WIDE "--shadow sheets --out a.png", 1, "(--no-shadows and --reference have no such limit)"},
        {VOLUME WIDE "--out a.png", 0, NULL},
        {"--particles nan.f32 " SMALL "--out a.png", 2, "--particles nan.f32: particles[0].particle[0].radius is nan"},
        {VOLUME "--light point,0.5,0.5,0.5,1,1,1 --no-shadows --out a.png", 0, NULL}};
    const float not_a_number = (float)sqrt(-1.0), none[5] = {0, 0, 0, not_a_number, 1};
    write_file("nan.raw", &not_a_number, sizeof not_a_number);
    write_file("nan.f32", none, sizeof none);
    CHECK_COMPLAINTS(library);
}

/* Errors name the file and the line in it, without control characters. */
static void test_bad_files(void) {
    static const complaint bad[] = {
        {"--mesh far.obj --plan", 2, "far.obj:2: a number that is not within 1e15: 'v 1e30 0 0'"},
        {"--mesh nan.obj --plan", 2, "nan.obj:1: a number that is not within 1e15: 'v nan 0 0'"},
        {"--mesh index.obj --plan", 2, "index.obj:4: not a face, or an index that is not there: 'f 1 2 4'"},
        {"--mesh binary --plan", 2, "binary: no faces"},
        {"--mesh missing.obj --plan", 2, "missing.obj: No such file"},
        {"--mesh . --plan", 2, ".: not a regular file"},
        {"--particles two.raw --plan", 2, "two.raw: the file holds 8 bytes, which is no multiple of a particle's 20"},
        {"--particles missing.f32 --plan", 2, "missing.f32: No such file"},
        {"--volume two.raw --size 3,2,2 --plan", 2, "two.raw: the file holds 8 bytes, but size 3,2,2 and type u8"},
        {"--volume two.raw --size 2,2,2 --type u16 --plan", 2, "the file holds 8 bytes"},
        {"--volume \"$(printf 'a\\033[2Jb\\nc')\" --size 1,1,1 --plan", 2, "a?[2Jb?c: No such file"},
        {VOLUME "--transfer binary --plan", 2,
         "binary:1: not `value r g b extinction`, or out of range: '"
         "?"
         "?"
         "[31mA?"},
        {VOLUME "--transfer long.txt --plan", 2, "'aaaaaaaaaaaa"},
        {VOLUME "--transfer falling.txt --plan", 2, "falling.txt:2: values must rise from line to line"},
        {VOLUME "--transfer empty.txt --plan", 2, "empty.txt: no lines with values"},
        {VOLUME "--transfer bytes.txt --plan >plan", 2,
         "bytes.txt: a line's value is 80, and there are lines beyond it"},
        {VOLUME "--transfer over.txt --plan >plan", 0, NULL},
        {VOLUME "--transfer marked.txt --mesh marked.obj --plan >plan", 0, NULL},
        {"--volume no --size 1,1,1 --out $(printf '%0300d' 7)", 2, "7: cannot be written: "}};
    static const char bytes[] = "0 1 1 1 0\n80 1 1 1 0\n255 1 1 1 9\n", over[] = "0.5 1 1 1 0\n1 1 1 1 5\n2 1 1 1 6\n";
    static const char marked[] = "\xef\xbb\xbf"
                                 "0 1 1 1 0\r\n1 1 1 1 5\r\n";
    static const char marked_mesh[] = "\xef\xbb\xbfv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n";
    static const char far[] = "v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", nan[] = "v nan 0 0\n";
    static const char index[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", falling[] = "1 1 1 1 1\n0 1 1 1 1\n";
    char line[3000];
    memset(line, 'a', sizeof line);
    write_file("far.obj", far, strlen(far));
    write_file("nan.obj", nan, strlen(nan));
    write_file("index.obj", index, strlen(index));
    write_file("binary", "\x90\033[31mA\x07\xff\0\1\n\2", 12);
    write_file("long.txt", line, sizeof line);
    write_file("falling.txt", falling, strlen(falling));
    write_file("empty.txt", "", 0);
    write_file("bytes.txt", bytes, strlen(bytes));
    write_file("over.txt", over, strlen(over));
    write_file("marked.txt", marked, strlen(marked));
    write_file("marked.obj", marked_mesh, strlen(marked_mesh));
    CHECK_COMPLAINTS(bad);
    CHECK(strlen(run_render(VOLUME "--transfer long.txt --plan").said) < 160);
}

/* Input files are not overwritten, and no file is written twice. */
static void test_precious_files(void) {
    static const complaint slips[] = {
        {"--mesh corner.obj " SMALL "--out corner.obj", 2, "--out corner.obj is a file that --mesh reads"},
        {VOLUME "--pfm ./two.raw", 2, "--pfm ./two.raw is a file that --volume reads"},
        {VOLUME "--transfer look.txt --stats link.txt", 2, "--stats link.txt is a file that --transfer reads"},
        {VOLUME "--out same --stats same", 2, "--out and --stats are the same file: same"},
        {VOLUME "--pfm a.pfm --alpha-pfm ./a.pfm", 2, "--pfm and --alpha-pfm are the same file: ./a.pfm"},
        {VOLUME "--out /dev/null --pfm /dev/null", 0, NULL},
        {"--mesh corner.obj --out corner.obj --plan >plan", 0, NULL}};
    static const char name[] = "/link.txt";
    char path[200];
    snprintf(path, sizeof path, "%s%s", folder, name);
    CHECK(symlink("look.txt", path) == 0);
    write_file("a.pfm", "", 0);
    CHECK_COMPLAINTS(slips);
}

/* Every option is in the help, by its usual name. */
static void test_help(void) {
    static const char *const words[] = {"--look FILE",
                                        "--volume FILE",
                                        "--size X,Y,Z",
                                        "--type u8|i8|u16|i16|u32|i32|f32|f64",
                                        "--range LOW,HIGH",
                                        "--box x0,y0,z0,x1,y1,z1",
                                        "--extinction S",
                                        "--albedo r,g,b",
                                        "--emission r,g,b",
                                        "--phase g[,g2,w]",
                                        "--transfer FILE",
                                        "--transfer-point value,r,g,b,extinction",
                                        "--shading gas|surface",
                                        "--mesh FILE.obj",
                                        "--mesh-color r,g,b",
                                        "--mesh-transmittance r,g,b",
                                        "--camera px,py,pz,tx,ty,tz",
                                        "--up x,y,z",
                                        "default 0,1,0",
                                        "--fov DEG",
                                        "--ortho HEIGHT",
                                        "--light directional,dx,dy,dz,r,g,b | point,x,y,z,r,g,b",
                                        "projector,x,y,z,dx,dy,dz,angle,r,g,b,FILE.ppm\n",
                                        "--light-size R | W,H",
                                        "--light-angle DEG",
                                        "--light-samples K",
                                        "--light-focus D",
                                        "--light-falloff inverse-square|none",
                                        "--ambient r,g,b",
                                        "--background r,g,b",
                                        "--width W",
                                        "--height H",
                                        "--region x,y,w,h",
                                        "--coverage N",
                                        "--slab VOXELS",
                                        "--shadow-size N",
                                        "--shadow auto|sheets|deep|compressed|opacity|deep-opacity|fourier|"
                                        "moment|beer|table|samples|none",
                                        "--map-components N",
                                        "--map-size N",
                                        "--table-size N",
                                        "--map-epsilon E",
                                        "--map-cubic",
                                        "--map-texel-range",
                                        "--quality draft|medium|high|ultra",
                                        "--no-shadows",
                                        "--reference",
                                        "--samples N",
                                        "--scattering auto|off|ambient|forward|convolution|full",
                                        "--threads N",
                                        "--out FILE.png",
                                        "--pfm FILE.pfm",
                                        "--alpha-pfm FILE.pfm",
                                        "--stats FILE.json",
                                        "--plan",
                                        "required",
                                        "\nVolumes. ",
                                        "\nMeshes, ",
                                        "\nView.",
                                        "\nLight. ",
                                        "\nRendering.",
                                        "\nResults. ",
                                        "--volume before them"};
    static char help[12000];
    CHECK(run_render("--help >help").status == 0);
    CHECK(read_file("help", help, sizeof help) > 1000);
    for (size_t i = 0; i < sizeof words / sizeof *words; ++i)
        if (!CHECK(strstr(help, words[i]) != NULL)) printf("    no '%s' in --help\n", words[i]);
    CHECK(!strstr(help, "usual") && !strstr(help, "needed") && !strstr(help, "latest"));
    for (char *line = strtok(help, "\n"); line; line = strtok(NULL, "\n")) CHECK(strlen(line) <= 120);
}

static void test_command_line(void) {
    static const unsigned char two[8] = {0, 50, 100, 150, 200, 250, 30, 90};
    static const char look[] = "# value r g b extinction\n0.1 0.9 0.5 0.2 0\n1 0.9 0.5 0.2 8 # dense\n";
    static const char corner[] = "v -1 0 0\nv 2 0 0\nv 0 2 -1\nf 1 2 3\n";
    if (!render_is_built() || !folder_begin()) {
        printf("skipped: the command line: run this in the top folder, after make build/tests/render\n");
        return;
    }
    write_file("two.raw", two, sizeof two);
    write_file("corner.obj", corner, strlen(corner));
    write_file("look.txt", look, strlen(look));
    test_full_disk();
    test_files_written();
    test_any_order();
    test_owners();
    test_looks();
    test_exclusions();
    test_bad_values();
    test_particles_option();
    test_shadow_option();
    test_table_option();
    test_light_options();
    test_translucent_mesh();
    test_coverage_option();
    test_samples_option();
    test_scattering_option();
    test_library_errors();
    test_bad_files();
    test_precious_files();
    test_help();
    folder_end();
}

static void test_failures(mixed *m) {
    test_every_allocation(m, RENDER, 16);
    test_every_allocation(m, REFERENCE, 9);
    test_every_allocation(m, PLAN, 2);
    test_growing_allocations(m);
    test_every_callback(m, RENDER, 33 + 1 + 1 + 8 + 2 + IMAGE_ROWS + SMALL_HEIGHT);
    test_every_callback(m, REFERENCE, 33 + 1 + 8 + 2 + IMAGE_ROWS + SMALL_HEIGHT);
    test_every_callback(m, PLAN, 33 + 1);
    test_every_cancellation(m, RENDER, 5);
    test_every_cancellation(m, REFERENCE, SMALL_HEIGHT + 1);
    test_progress(m, RENDER);
    test_progress(m, REFERENCE);
    test_progress_of_rows(m);
    test_messages(m);
    test_memory_limit(m);
    test_memory_exact(m);
}

static void test_revisions(void) {
    test_revision();
    test_revision_and_looks();
    test_revision_and_points();
    test_revision_and_kind();
    test_revision_and_failure();
}

/* ----------------------------------------------------------------------------------------------------- tasks' stack */

#if !SANITIZED
enum { STACK = 128 * 1024, UNTOUCHED = 0xa5 };

typedef struct deepest {
    unsigned char *stack;
    size_t most; /* bytes touched by a task's thread */
} deepest;

static void *one_task_main(void *user) {
    const thread_job *job = (const thread_job *)user;
    if (job->task) job->task(job->task_data, job->worker, 0);
    return NULL;
}

/* Runs each task in a thread of its own, whose stack was painted before: bytes that are still painted were not
   touched. */
static void parallel_on_painted(void *user, int count, sps_task_fn task, void *task_data) {
    deepest *d = (deepest *)user;
    for (int i = 0; i < count; ++i) {
        thread_job job = {task, task_data, count, i, count};
        pthread_attr_t attributes;
        pthread_t thread;
        size_t untouched = 0;
        memset(d->stack, UNTOUCHED, STACK);
        pthread_attr_init(&attributes);
        if (pthread_attr_setstack(&attributes, d->stack, STACK)) abort();
        if (pthread_create(&thread, &attributes, one_task_main, &job)) abort();
        pthread_join(thread, NULL);
        pthread_attr_destroy(&attributes);
        while (untouched < STACK && d->stack[untouched] == UNTOUCHED) ++untouched;
        if (STACK - untouched > d->most) d->most = STACK - untouched;
    }
}

/* Tasks use no more stack than the header says, for any kind of shadow of gas; a thread's own use of stack is
   subtracted. */
static void test_stack(mixed *m) {
    const size_t allowed = (SPSI_LANES > 8 ? 24 : 16) * 1024;
    void *memory = NULL;
    deepest d = {NULL, 0};
    sps_tmap_settings settings;
    sps_config config;
    size_t without;
    if (posix_memalign(&memory, 65536, STACK)) abort();
    d.stack = (unsigned char *)memory;
    parallel_on_painted(&d, 1, NULL, NULL);
    without = d.most;
    memset(&config, 0, sizeof config);
    config.parallel_for_fn = parallel_on_painted, config.parallel_user = &d, config.worker_count = 2;
    for (int technique = -1; technique <= SPS_TMAP_BEER; ++technique) {
        sps_context *context = sps_create(&config, NULL);
        memset(&settings, 0, sizeof settings);
        settings.technique = (sps_tmap_technique)(technique < 0 ? 0 : technique);
        settings.cubic = 1;
        for (int i = 0; i < m->s.scene.light_count; ++i) m->s.light[i].shadow_map = technique < 0 ? NULL : &settings;
        d.most = 0;
        CHECK(check_render(context, &m->s, pixels_fresh));
        if (!CHECK(d.most > without && d.most - without <= allowed))
            printf("    technique %d: %zu bytes of stack, and %zu are allowed\n", technique, d.most - without, allowed);
        if (getenv("CHECK_STACK")) printf("technique %d: %zu bytes of stack\n", technique, d.most - without);
        sps_destroy(context);
    }
    for (int i = 0; i < m->s.scene.light_count; ++i) m->s.light[i].shadow_map = NULL;
    free(memory);
}
#endif

int main(void) {
    mixed m, small;
    mixed_build(&m);
    mixed_build_small(&small);
    test_failures(&small);
    test_planned_bytes();
    test_context_reused();
    test_shuffled_workers(&m, RENDER);
    test_shuffled_workers(&small, REFERENCE);
    test_real_threads(&m);
    if (!check_memory_only()) test_same_counts(&m);
    test_regions();
    if (!check_memory_only()) test_two_contexts();
    test_revisions();
    test_null_arguments(&m);
    test_configs();
    test_version_and_names();
    test_rounds_of_tasks();
    test_turns();
    test_clock(&m);
    test_clock_of_calls(&small);
    test_sizes_overflow();
#if !SANITIZED
    test_stack(&m);
#endif
    test_quick_start();
    test_includes();
    if (!check_memory_only()) test_command_line(); /* which is no program with sanitizers */
    mixed_free(&m);
    mixed_free(&small);
    return check_report();
}
