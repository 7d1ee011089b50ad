/* The same scene has the same bits for any number of workers, any region, any context and any order of calls. */

#include "mixed_scene.h"
#include <pthread.h>
#include <unistd.h>

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
        if (variant == 4) m.s.volume[0].extinction = 60, m.s.view.slab_thickness = 0.5; /* tiles finish early */
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
    test_shuffled_workers(&m, RENDER);
    test_shuffled_workers(&small, REFERENCE);
    test_real_threads(&m);
    if (!check_memory_only()) test_same_counts(&m);
    test_regions();
    if (!check_memory_only()) test_two_contexts();
#if !SANITIZED
    test_stack(&m);
#endif
    mixed_free(&m);
    mixed_free(&small);
    return check_report();
}
