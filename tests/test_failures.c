/* What a context keeps from call to call (voxels and their levels, triangles and their tree, shadow tables, light from
   cell to cell and from sheet to sheet, memory for a wide sun's beams), and a call in between that fails: an
   allocation, a provider, or a call of progress_fn that cancels, each of them in turn. Whatever was half made then, the
   next calls show what they would in a fresh context, for the scene that failed as well as for the one before. */

#include "check.h"

enum { WIDTH = 12, HEIGHT = 10, STATES = 2 };
typedef enum kept { VOXELS, TREE, TABLE, BEAMS, CELLS, SPREAD, ALL, KINDS } kept;
static const char *const names[KINDS] = {
    "voxels and levels", "tree", "table", "a wide sun's beams", "light in cells", "light in sheets", "all of them"};
typedef enum cause { ALLOCATION, CANCEL, PROVIDER, CAUSES } cause;
static const char *const causes[CAUSES] = {"allocations", "cancelled calls", "calls of providers"};

static float fresh[STATES][4 * WIDTH * HEIGHT], image[4 * WIDTH * HEIGHT];

/* ----------------------------------------------------------------------------------------------------------- scenes */

/* Calls of providers so far; the one that fails, 0: none. */
static struct { long calls, fail_at; } provider;

static int fails_now(void) { return ++provider.calls == provider.fail_at; }

/* A puff whose middle moves with the scene's state. */
typedef struct puff {
    double middle;
} puff;

static int eval_puff(void *user, size_t count, const double *positions, float *out) {
    const puff *p = (const puff *)user;
    for (size_t i = 0; i < count; ++i) {
        const double at[3] = {positions[3 * i] - p->middle, positions[3 * i + 1], positions[3 * i + 2]};
        out[i] = (float)check_puff(NULL, at);
    }
    return fails_now();
}

static int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    return check_read_triangles(user, first, count, out) || fails_now();
}

/* What scenes refer to, at the same address in every call, so that the context sees that it has not changed. */
static puff puffs[STATES] = {{0}, {0.2}};
static check_triangles floors[STATES];

/* The second state's floor is larger, so that its triangles need more memory. */
static void make_floors(void) {
    for (int state = 0; state < STATES; ++state) {
        const double corner[3] = {-2, -1.3, 0.5}, u[3] = {0, 1.5, -3}, v[3] = {4, 0, 0};
        check_add_quad(&floors[state], corner, u, v);
        for (int i = 0; i < 1 + 29 * state; ++i) {
            const double at[3] = {-0.5 + 0.1 * (i % 10), 0.7, -0.4 + 0.1 * (i / 10)}, side[3] = {0, 0.02, 0.09};
            const double other[3] = {0.09, 0, 0.02};
            check_add_quad(&floors[state], at, side, other);
        }
    }
}

/* Two meshes: a call may fail that has read the first one. */
static void add_floors(check_scene *s, int state) {
    for (int i = 0; i < 2; ++i) {
        sps_mesh *mesh = check_add_mesh(s, &floors[state], 0.7);
        mesh->placement = check_box(0.2 * i, 0, 0.1 * i, 1 + 0.2 * i, 1, 1 + 0.1 * i);
        mesh->read_fn = read_triangles;
        mesh->revision = 1 + (uint64_t)state;
    }
}

static void add_puff(check_scene *s, int state) {
    sps_volume *gas = check_add_puff(s, 4);
    gas->eval_fn = eval_puff;
    gas->user = &puffs[state];
    gas->revision = 1 + (uint64_t)state;
    check_color(gas->albedo, 0.8, 0.7, 0.6);
}

/* A scene of each kind in two states, which differ in what is kept: what the second one keeps of the first has to be
   made anew, in part or as a whole. Voxels stay, and are seen from afar, where levels of them are made. */
static void build(check_scene *s, kept kind, int state) {
    sps_light *sun;
    check_clear(s, WIDTH, HEIGHT);
    check_orthographic(&s->view.camera, kind != VOXELS ? 2.6 : state ? 16 : 0.8);
    s->view.filling = SPS_FILLING_GATHER;
    s->view.quality = kind == VOXELS ? SPS_QUALITY_MEDIUM : SPS_QUALITY_DRAFT;
    s->view.shadow_resolution = kind == VOXELS && state ? 64 : 16;
    sun = check_add_directional(s, 0.3, -1, -0.4, 3);
    sun->shadow_source = kind == TABLE || kind == ALL ? SPS_SHADOW_TABLE : SPS_SHADOW_SHEETS;
    sun->shadow_map_resolution = sun->shadow_source == SPS_SHADOW_TABLE ? 24 : 0;
    if (kind == BEAMS) sun->angular_diameter = 0.3, sun->samples = state ? 64 : 16;
    if (kind != TREE) add_puff(s, kind == VOXELS ? 0 : state);
    if (kind == TREE || kind == CELLS || kind == ALL) add_floors(s, state);
    if (kind == TREE) check_add_point(s, 0.4, 1.5, 0.3 * state, 3);
    if (kind == CELLS || kind == ALL) s->view.scattering = SPS_SCATTERING_MULTIPLE;
    if (kind == SPREAD) s->view.scattering = SPS_SCATTERING_CONVOLUTION;
    if (s->view.scattering) s->view.scattering_resolution = 8;
}

/* --------------------------------------------------------------------------------------------------------- failures */

/* Renders a state, which must show what a fresh context shows. */
static int shows(sps_context *context, kept kind, int state) {
    check_scene s;
    build(&s, kind, state);
    return CHECK_OK(context, check_try(context, &s, image)) && CHECK(check_same(&s, image, fresh[state]));
}

static void render_fresh(kept kind) {
    for (int state = 0; state < STATES; ++state) {
        check_scene s;
        build(&s, kind, state);
        check_render_plain(&s, fresh[state]);
    }
    CHECK(memcmp(fresh[0], fresh[1], sizeof fresh[0]) != 0);
}

/* The first state, then the second, in which the n-th occasion fails, then both. Returns 0 if there is no n-th. */
static int fails_between(kept kind, cause why, long n) {
    static const sps_result results[CAUSES] = {SPS_ERROR_MEMORY, SPS_ERROR_CANCELLED, SPS_ERROR_CALLBACK};
    check_cancel cancel = {0, 0};
    check_hooks hooks;
    sps_config config;
    sps_context *context;
    sps_result result;
    check_scene s;
    memset(&hooks, 0, sizeof hooks);
    config = check_config(&hooks);
    config.progress_fn = check_cancel_at, config.progress_user = &cancel;
    config.clock_fn = check_hasty_clock;
    context = sps_create(&config, NULL);
    shows(context, kind, 0);
    if (why == ALLOCATION) hooks.fail_at = hooks.allocations + n;
    if (why == CANCEL) cancel.calls = 0, cancel.at = n;
    if (why == PROVIDER) provider.calls = 0, provider.fail_at = n;
    build(&s, kind, 1);
    result = check_try(context, &s, image);
    hooks.fail_at = cancel.at = provider.fail_at = 0;
    CHECK(result == SPS_OK || result == results[why]);
    if (!(shows(context, kind, (int)(n % 2)) && shows(context, kind, (int)(1 - n % 2))))
        printf("    %s, number %ld of %s\n", names[kind], n, causes[why]);
    sps_destroy(context);
    CHECK(hooks.live == 0);
    return result != SPS_OK;
}

/* A context does keep these: a scene again reads nothing and makes nothing, and what it shows is the same; the other
   state is read and made anew, but for voxels, which stay. */
static void test_held(void) {
    for (int kind = 0; kind < KINDS; ++kind) {
        sps_context *context = check_context(NULL);
        const int table = kind == ALL || kind == TABLE, followed = kind == CELLS || kind == SPREAD || kind == ALL;
        render_fresh((kept)kind);
        for (int n = 0; n < 3; ++n) {
            const long before = provider.calls;
            const uint64_t made = n != 1;
            sps_stats_report stats;
            shows(context, (kept)kind, n / 2);
            sps_get_stats(context, &stats);
            if (!CHECK((provider.calls > before) == (n == 0 || (n == 2 && kind != VOXELS))) ||
                !CHECK((stats.voxels_read > 0) == (provider.calls > before && kind != TREE)) ||
                !CHECK(stats.tables_made == made * (uint64_t)table && stats.tables_held == (1 - made) * (table > 0)) ||
                !CHECK((stats.cells > 0) == (followed && made)))
                printf("    %s, call %d: %ld calls, %d tables made, %d held\n", names[kind], n, provider.calls - before,
                       (int)stats.tables_made, (int)stats.tables_held);
        }
        sps_destroy(context);
    }
}

/* Most calls are between two tiles or rows, or for another block: fewer and fewer are tried. What is kept by itself is
   enough, except for the long tests. */
static void test_kept(void) {
    for (int kind = 0; kind < (check_long() ? KINDS : ALL); ++kind) {
        render_fresh((kept)kind);
        for (int why = 0; why < CAUSES; ++why) {
            long n = 1, tried = 0;
            for (; n < 20000 && fails_between((kept)kind, (cause)why, n); ++tried)
                n += check_long() ? 1 : why == ALLOCATION ? 1 + n / 8 : 1 + n / 2 * (kind == CELLS ? 2 : 1);
            CHECK(n < 20000 && (tried > 0) == (why != PROVIDER || kind != VOXELS)); /* voxels are not read again */
            if (figures()) printf("%s: %ld %s\n", names[kind], tried, causes[why]);
        }
    }
}

int main(void) {
    make_floors();
    RUN(test_held);
    RUN(test_kept);
    for (int state = 0; state < STATES; ++state) check_free_triangles(&floors[state]);
    return check_report();
}
