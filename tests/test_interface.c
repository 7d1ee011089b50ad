/* The interface: kept voxels and revisions, arguments that are NULL, configurations, clocks, tasks, the quick start. */

#include "mixed_scene.h"
#include "splatshadow.h" /* once more, below its own implementation */
#include <unistd.h>

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
    static const sps_transfer_point narrow[] = {{0.2f, {1, 1, 1}, 0, {0, 0, 0}}, {0.4f, {1, 1, 1}, 9, {0, 0, 0}}};
    static const sps_transfer_point wide[] = {{0.4f, {1, 1, 1}, 0, {0, 0, 0}}, {0.8f, {1, 1, 1}, 9, {0, 0, 0}}};
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
    size_t bytes = 0;
    spsi_lists lists;
    memset(context->planned, 0, sizeof context->planned);
    context->counted = &bytes;
    if (rays) CHECK(spsi_lists_reserve(context, SPSI_BUFFER_EYE_SPHERES, rays, count, &lists) == SPS_OK);
    if (!rays) CHECK(!spsi_vectors_reserve(context, SPSI_BUFFER_SAMPLES, (int)count, size));
    context->counted = NULL;
    return bytes < SIZE_MAX ? bytes - SPSI_LINK_BYTES : bytes;
}

/* Sizes in bytes that exceed a size_t cannot be reserved. What is only counted is not reserved, and no failure. */
static void test_sizes_overflow(void) {
    sps_context *context = check_context(NULL);
    const size_t each = sizeof(spsi_projected_sphere) + 2 * sizeof(int), starts = 3 * sizeof(int);
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
                                  "emmintrin.h immintrin.h arm_neon.h wasm_simd128.h ";
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

static void test_revisions(void) {
    test_revision();
    test_revision_and_looks();
    test_revision_and_points();
    test_revision_and_kind();
    test_revision_and_failure();
}

int main(void) {
    mixed m, small;
    mixed_build(&m);
    mixed_build_small(&small);
    test_revisions();
    test_null_arguments(&m);
    test_configs();
    test_version_and_names();
    test_rounds_of_tasks();
    test_clock(&m);
    test_clock_of_calls(&small);
    test_sizes_overflow();
    test_quick_start();
    test_includes();
    mixed_free(&m);
    mixed_free(&small);
    return check_report();
}
