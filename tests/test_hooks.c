/* Any allocation, callback or cancellation may fail or end a call: nothing leaks, and memory stays within the plan. */

#include "mixed_scene.h"

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
    for (n = 1; n < 1000; n += check_memory_only() && n > 2 ? 2 : 1) {
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
    for (n = 1; n < 1000; n += check_memory_only() ? 3 : 1) {
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
    for (n = 1; n < 2000; n += check_long() ? 1 : 2) {
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

static void test_planned_bytes(void) {
    for (int variant = 0, more = 1; more; ++variant) {
        if (check_memory_only() && variant % 6 != 1) continue; /* test_context_reused renders others */
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

/* ------------------------------------------------------------------------------------------------- the command line */

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

int main(void) {
    mixed small;
    mixed_build_small(&small);
    test_failures(&small);
    test_planned_bytes();
    test_context_reused();
    mixed_free(&small);
    return check_report();
}
