/* Scenes, maps and files that are decoded from bytes: every file of tests/seeds/, or those that are named. With FUZZER
   defined, `make fuzz` draws the bytes instead. The first byte is a letter that says what the rest is (see `targets`
   below, and fuzz_files.h): scenes come from fuzz.h, which also says what holds for them. In addition, memory or a
   provider may fail, or the caller may cancel, at any time, and afterwards the same context renders the same scene, and
   another one, to the same bits as a new one. */

#include "fuzz_files.h"
#include "fuzz.h"

#include <dirent.h>
#include <inttypes.h>

enum { PATIENCE = 600 };

/* --------------------------------------------------------------------------------------------- a context and trouble
 */

typedef enum trouble_kind { NO_TROUBLE = 0, NO_MEMORY, CANCELLING, FAILING_CALL, LITTLE_MEMORY, TROUBLES } trouble_kind;

typedef struct trouble {
    trouble_kind kind;
    long at; /* number of the allocation or call that fails, or the limit of memory */
} trouble;

typedef struct trial {
    check_hooks hooks;
    check_cancel cancel;
    float fraction; /* of the call that is done */
    int patience;   /* calls of progress_fn after which all is given up, so that no scene takes long; 0: none */
    sps_context *context;
} trial;

/* sps_config.progress_fn: a call's fractions do not decrease. */
static int watch_progress(void *user, float fraction) {
    trial *t = (trial *)user;
    if (!CHECK(fraction >= t->fraction && fraction <= 1))
        printf("    progress of %g after %g\n", (double)fraction, (double)t->fraction);
    t->fraction = fraction;
    return check_cancel_at(&t->cancel, fraction);
}

/* sps_config.message_fn: a line. */
static void watch_message(void *user, const char *text) {
    (void)user;
    if (!CHECK(*text && !strchr(text, '\n') && strlen(text) < 256)) printf("    %s\n", text);
}

static void trial_begin(trial *t, int workers, const trouble *wrong) {
    memset(t, 0, sizeof *t);
    t->hooks.worker_count = workers;
    if (wrong && wrong->kind == LITTLE_MEMORY) t->hooks.memory_limit = (size_t)wrong->at;
    sps_config config = check_config(&t->hooks);
    config.progress_fn = watch_progress, config.progress_user = t;
    config.clock_fn = check_hasty_clock;
    config.message_fn = watch_message;
    t->context = sps_create(&config, NULL);
    CHECK(t->context || t->hooks.memory_limit);
}

static void trial_end(trial *t) {
    sps_destroy(t->context);
    if (!CHECK(t->hooks.live == 0 && t->hooks.live_blocks == 0)) printf("    a leak\n");
    if (t->hooks.memory_limit) CHECK(t->hooks.peak <= t->hooks.memory_limit);
}

/* From now on, until it is called without trouble. */
static void set_trouble(trial *t, const trouble *wrong) {
    const trouble_kind kind = wrong ? wrong->kind : NO_TROUBLE;
    t->cancel.calls = 0;
    t->fraction = 0;
    t->cancel.at = kind == CANCELLING ? wrong->at : t->patience;
    t->hooks.fail_at = kind == NO_MEMORY ? t->hooks.allocations + wrong->at : 0;
    provider_fails_at = kind == FAILING_CALL ? provider_calls + wrong->at : 0;
}

static trouble random_trouble(void) {
    trouble wrong;
    wrong.kind = (trouble_kind)below(TROUBLES);
    wrong.at = 1 + below(one_in(2) ? 256 : 12);
    if (wrong.kind == LITTLE_MEMORY) wrong.at *= 4000;
    return wrong;
}

/* What a failure may be, if the scene by itself leads to `expected`. */
static int may_fail(const trouble *wrong, sps_result expected, sps_result result) {
    static const sps_result results[] = {SPS_OK, SPS_ERROR_MEMORY, SPS_ERROR_CANCELLED, SPS_ERROR_CALLBACK,
                                         SPS_ERROR_MEMORY};
    return result == expected || result == results[wrong->kind];
}

/* ---------------------------------------------------------------------------------------------- pictures of scenes */

/* What a good scene looks like in a new context, it must look like in any. */
enum { GOOD_SIDE = 6, GOOD_NUMBERS = 4 * GOOD_SIDE * GOOD_SIDE };

static void render_good(sps_context *context, float *pixels) {
    static float value = 0.7f;
    static const double corners[3][3] = {{-1, -1, -1}, {1, -1, -1}, {0, 1, -1}};
    check_scene s;
    check_triangles triangles;
    memset(&triangles, 0, sizeof triangles);
    check_clear(&s, GOOD_SIDE, GOOD_SIDE);
    sps_volume *volume = check_add_volume(&s, 4, 4, 4, check_box(-0.4, -0.4, -0.4, 0.4, 0.4, 0.4));
    volume->read_fn = check_read_constant, volume->user = &value, volume->extinction = 3;
    volume->emission[1] = 0.5f;
    check_add_corners(&triangles, corners[0], corners[1], corners[2]);
    check_add_mesh(&s, &triangles, 0.5);
    check_add_directional(&s, 0.5, -0.3, -1, 2);
    s.view.shadow_resolution = 16;
    check_render(context, &s, pixels);
    check_free_triangles(&triangles);
}

static void check_good(trial *t) {
    static float exact[GOOD_NUMBERS];
    static int rendered;
    float pixels[GOOD_NUMBERS];
    if (!rendered) {
        trial fresh;
        trial_begin(&fresh, 0, NULL);
        set_trouble(&fresh, NULL);
        render_good(fresh.context, exact);
        trial_end(&fresh);
        rendered = 1;
    }
    set_trouble(t, NULL);
    render_good(t->context, pixels);
    CHECK(memcmp(pixels, exact, sizeof exact) == 0);
}

/* The outcome of a scene in a new context. */
typedef struct expectation {
    sps_result result;
    int reference;
    float pixels[4 * (90 + TINY + 1)];
} expectation;

static void expect_same(trial *t, const scenery *x, const expectation *expected, const char *what) {
    set_trouble(t, NULL);
    const sps_result result = render_scenery(t->context, x, expected->reference);
    check_outcome(x, 0, what, result, t->context);
    if (!CHECK(result == expected->result)) report(0, what, result, t->context);
    if (result == SPS_OK && !CHECK(memcmp(rgba, expected->pixels, sizeof expected->pixels) == 0))
        report(0, what, result, t->context);
}

/* Something goes wrong, and then nothing does. */
static void try_trouble(const scenery *x, const expectation *expected, const trouble *wrong) {
    trial t;
    trial_begin(&t, one_in(2) ? 3 : 0, wrong);
    if (t.context) {
        set_trouble(&t, wrong);
        const sps_result result = render_scenery(t.context, x, expected->reference);
        check_outcome(x, 0, "trouble", result, t.context);
        if (steady(x) && !CHECK(may_fail(wrong, expected->result, result))) report(0, "trouble", result, t.context);
        if (steady(x) && result == SPS_OK && expected->result == SPS_OK)
            CHECK(memcmp(rgba, expected->pixels, sizeof expected->pixels) == 0);
        if (steady(x) && wrong->kind != LITTLE_MEMORY) expect_same(&t, x, expected, "after trouble");
        if (wrong->kind != LITTLE_MEMORY) check_good(&t);
    }
    trial_end(&t);
    set_trouble(&t, NULL);
}

/* By seven workers in a shuffled order, in a context that is used for everything. */
static void try_workers(scenery *x, const expectation *expected) {
    static trial used;
    uint64_t revisions[VOLUMES + MESHES]; /* the used context holds what others deliver */
    if (!used.context) trial_begin(&used, 7, NULL);
    used.hooks.order = numbers.state;
    for (int i = 0; i < VOLUMES; ++i) revisions[i] = x->s.volume[i].revision, x->s.volume[i].revision = 0;
    for (int i = 0; i < MESHES; ++i) revisions[VOLUMES + i] = x->s.mesh[i].revision, x->s.mesh[i].revision = 0;
    expect_same(&used, x, expected, "seven workers");
    for (int i = 0; i < VOLUMES; ++i) x->s.volume[i].revision = revisions[i];
    for (int i = 0; i < MESHES; ++i) x->s.mesh[i].revision = revisions[VOLUMES + i];
}

/* A region of a picture has the bits that it has in the whole. */
static void try_region(trial *t, const scenery *x, const expectation *whole) {
    scenery part = *x;
    sps_view *view = &part.s.view;
    if (view->region[2] != 0 || whole->result != SPS_OK) return;
    view->region[0] = below(view->width), view->region[2] = 1 + below(view->width - view->region[0]);
    view->region[1] = below(view->height), view->region[3] = 1 + below(view->height - view->region[1]);
    set_trouble(t, NULL);
    const sps_result result = render_scenery(t->context, &part, whole->reference);
    check_outcome(&part, 0, "region", result, t->context);
    CHECK(result == SPS_OK);
    for (int y = 0; y < view->region[3] && result == SPS_OK; ++y) {
        const size_t from = (size_t)((view->region[1] + y) * view->width + view->region[0]);
        const size_t row = 4 * (size_t)view->region[2];
        if (!CHECK(memcmp(rgba + (size_t)y * row, whole->pixels + 4 * from, row * sizeof *rgba) == 0))
            printf("    row %d of region %d,%d,%d,%d\n", y, view->region[0], view->region[1], view->region[2],
                   view->region[3]);
    }
}

/* What may change from a picture to the next. Changes of data are announced by revisions. */
static void random_change(scenery *x) {
    const int what = below(6);
    sps_light *light = &x->s.light[0];
    if (what == 0) x->s.view.camera.position[below(3)] += 0.1;
    if (what == 1) light->position[below(3)] += 0.1, light->direction[below(3)] += 0.1;
    if (what == 2) light->color[1] += 0.5f;
    if (what == 3) x->s.view.filling = SPS_FILLING_GATHER, x->s.view.tolerance = 0.1f;
    if (what == 4) x->providers[0].seed += 99, x->grids[0].scale *= 0.9f;
    if (what == 5 && x->triangles[0].count > 0) x->triangles[0].list[0].position[0][0] += 0.1f;
    for (int i = 0; i < VOLUMES; ++i)
        if (what == 4 && x->s.volume[i].revision) x->s.volume[i].revision += 8;
    for (int i = 0; i < MESHES; ++i)
        if (what == 5 && x->s.mesh[i].revision) x->s.mesh[i].revision += 8;
}

/* After a change, a context that holds what it can renders the same bits as a new one. */
static void try_change(trial *t, scenery *x) {
    expectation expected;
    trial fresh;
    random_change(x);
    trial_begin(&fresh, 0, NULL);
    fresh.patience = PATIENCE;
    set_trouble(&fresh, NULL);
    expected.reference = 0;
    expected.result = render_scenery(fresh.context, x, 0);
    check_outcome(x, 0, "changed", expected.result, fresh.context);
    memcpy(expected.pixels, rgba, sizeof expected.pixels);
    trial_end(&fresh);
    if (expected.result != SPS_ERROR_CANCELLED) expect_same(t, x, &expected, "after a change");
}

static void try_pictures(int reference) {
    expectation expected;
    trial t;
    scenery x;
    const trouble wrong = random_trouble();
    random_scenery(&x);
    trial_begin(&t, 0, NULL);
    t.patience = PATIENCE;
    set_trouble(&t, NULL);
    if (!reference || small_enough_to_march(&x)) {
        expected.reference = reference;
        expected.result =
            reference ? render_scenery(t.context, &x, 1) : render_as_planned(t.context, &t.hooks, &x, 0, &t.fraction);
        check_outcome(&x, 0, "picture", expected.result, t.context);
        memcpy(expected.pixels, rgba, sizeof expected.pixels);
        t.patience = 0;
        if (expected.result != SPS_ERROR_CANCELLED) {
            if (steady(&x)) expect_same(&t, &x, &expected, "once more");
            if (steady(&x)) try_region(&t, &x, &expected);
            if (wrong.kind != NO_TROUBLE) try_trouble(&x, &expected, &wrong);
            if (steady(&x)) try_workers(&x, &expected);
            if (steady(&x) && !reference) try_change(&t, &x);
            check_good(&t);
        }
    }
    trial_end(&t);
    free_scenery(&x);
}

static void try_scene(const uint8_t *data, size_t size) {
    begin_bytes(data, size);
    try_pictures(0);
}

static void try_reference(const uint8_t *data, size_t size) {
    begin_bytes(data, size);
    try_pictures(1);
}

/* -----------------------------------------------------------------------------------------------------------------
 * maps */

/* A sum of a map's floats. None of them is a NaN, and lists are in order. */
static uint64_t map_checksum(const sps_tmap *map) {
    sps_tmap_info info;
    uint64_t sum = 0;
    int good = 1;
    const uint32_t *starts = sps_tmap_starts(map);
    const float *texels = sps_tmap_texels(map), *surfaces = sps_tmap_surfaces(map);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK && info.is_finished);
    for (size_t i = 0; i < info.float_count; ++i) {
        uint32_t bits;
        memcpy(&bits, &texels[i], sizeof bits);
        sum = sum * 31 + bits;
        good &= texels[i] == texels[i];
    }
    for (size_t i = 0; surfaces && i < info.texel_count; ++i) good &= surfaces[i] == surfaces[i];
    for (size_t i = 0; starts && i < info.texel_count; ++i) good &= starts[i] <= starts[i + 1];
    if (starts) good &= (size_t)starts[info.texel_count] * (size_t)info.item_floats == info.float_count;
    CHECK(good);
    return sum;
}

/* All other calls that only read a map. */
static void read_map(const sps_tmap *map) {
    static const float points[8] = {0, 0.3f, -0.2f, 9, 1, -1, 0.5f, 9}; /* 16 bytes each */
    static const double same[6] = {0, (double)0.3f, (double)-0.2f, 1, -1, 0.5};
    double matrix[16], bias[2];
    float depths[4];
    sps_tmap_info info;
    sps_tmap_constants constants;
    CHECK(sps_tmap_query_floats(map, 2, points, 16, depths, NULL) == SPS_OK);
    CHECK(sps_tmap_query(map, 2, same, depths + 2, NULL) == SPS_OK);
    CHECK(memcmp(depths, depths + 2, 2 * sizeof *depths) == 0);
    CHECK(sps_tmap_get_info(map, &info) == SPS_OK);
    for (int face = 0; face < info.face_count; ++face)
        CHECK(sps_tmap_get_projection(map, face, matrix, bias) == SPS_OK &&
              sps_tmap_get_constants(map, face, &constants) == SPS_OK);
}

/* Makes the map again, where something goes wrong, and then not. */
static void try_map_trouble(const scenery *x, const sps_tmap_light *light, const sps_tmap_settings *wanted,
                            sps_result expected, uint64_t sum, const trouble *wrong) {
    trial t;
    trial_begin(&t, one_in(2) ? 3 : 0, wrong);
    for (int turn = 0; turn < 2 && t.context; ++turn) {
        sps_tmap *map = NULL;
        set_trouble(&t, turn == 0 ? wrong : NULL);
        const sps_result result = make_map(t.context, x, light, wanted, &map);
        const int good =
            turn == 0 || wrong->kind == LITTLE_MEMORY ? may_fail(wrong, expected, result) : result == expected;
        if (steady(x) && !CHECK(good)) report(0, "map again", result, t.context);
        if (steady(x) && result == SPS_OK && expected == SPS_OK) CHECK(map_checksum(map) == sum);
        sps_tmap_destroy(map);
    }
    if (t.context && wrong->kind != LITTLE_MEMORY) check_good(&t);
    trial_end(&t);
    set_trouble(&t, NULL);
}

static void try_map(const uint8_t *data, size_t size) {
    trial t;
    scenery x;
    sps_tmap_light light;
    sps_tmap_settings wanted;
    sps_tmap *map = NULL;
    begin_bytes(data, size);
    const trouble wrong = random_trouble();
    random_scenery(&x);
    random_map_of(&x, &light, &wanted);
    trial_begin(&t, 0, NULL);
    t.patience = PATIENCE;
    set_trouble(&t, NULL);
    const sps_result result = make_map(t.context, &x, &light, &wanted, &map);
    check_map_outcome(map, 0, result, t.context);
    const uint64_t sum = result == SPS_OK ? map_checksum(map) : 0;
    if (result == SPS_OK) read_map(map);
    sps_tmap_destroy(map);
    t.patience = 0;
    check_good(&t);
    trial_end(&t);
    if (result != SPS_ERROR_CANCELLED) try_map_trouble(&x, &light, &wanted, result, sum, &wrong);
    free_scenery(&x);
}

/* ------------------------------------------------------------------------------------------------------------- the
 * bytes */

static const struct {
    char letter;
    void (*try_bytes)(const uint8_t *data, size_t size);
} targets[] = {{'s', try_scene}, {'m', try_map}, {'r', try_reference}};

enum { TARGETS = sizeof targets / sizeof *targets };

/* Any bytes are something. */
static void try_input(const uint8_t *data, size_t size) {
    if (size == 0) return;
    for (int i = 0; i < TARGETS; ++i)
        if (data[0] == (uint8_t)targets[i].letter) targets[i].try_bytes(data + 1, size - 1);
#ifndef __cplusplus
    for (int i = 0; i < FILE_KINDS; ++i) {
        trial t;
        if (data[0] != (uint8_t)file_kinds[i].letter) continue;
        trial_begin(&t, 0, NULL);
        t.patience = PATIENCE;
        set_trouble(&t, NULL);
        try_file(&file_kinds[i], data + 1, size - 1, t.context);
        trial_end(&t);
    }
#endif
}

#ifdef FUZZER

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    try_input(data, size);
    if (check_failed) fflush(stdout), abort();
    return 0;
}

#else

static void replay(const char *path) {
    const int failed = check_failed;
    size_t size = 0;
    char *text = read_bytes(path, &size);
    if (!CHECK(text != NULL)) printf("    %s cannot be read\n", path);
    if (text) try_input((const uint8_t *)text, size);
    if (check_failed > failed) printf("    %s\n", path);
    free(text);
}

int main(int count, char **names) {
    char path[300];
    DIR *seeds = count > 1 ? NULL : opendir("tests/seeds");
    const struct dirent *entry;
    for (int i = 1; i < count; ++i) replay(names[i]);
    while (seeds && (entry = readdir(seeds)) != NULL) {
        if (entry->d_name[0] == '.') continue;
        snprintf(path, sizeof path, "tests/seeds/%s", entry->d_name);
        replay(path);
    }
    if (seeds) closedir(seeds);
    CHECK(count > 1 || seeds);
    return check_report();
}

#endif
