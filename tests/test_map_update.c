/* sps_tmap_update: particles taken out of finished maps and added to them, against maps made anew. */

#include "check.h"

#include "map_scene.h"

static const struct {
    int technique, components, cubic;
} kinds[] = {{SPS_TMAP_OPACITY, 8, 0}, {SPS_TMAP_OPACITY, 1, 0}, {SPS_TMAP_OPACITY, 12, 1},
             {SPS_TMAP_FOURIER, 9, 0}, {SPS_TMAP_MOMENT, 5, 0},  {SPS_TMAP_MOMENT, 7, 0}};

enum { KINDS = sizeof kinds / sizeof *kinds };

static void begin_kind(fixture *f, int n) {
    begin(f, kinds[n].technique);
    f->settings.components = kinds[n].components, f->settings.cubic = kinds[n].cubic;
    f->settings.near_depth = 3; /* gas lies before it */
}

/* A scene of one even and one soft crowd. */
typedef struct crowds {
    sps_scene scene;
    sps_particles sets[2];
    crowd list[2];
} crowds;

static void crowds_begin(crowds *c) {
    memset(c, 0, sizeof *c);
    for (int i = 0; i < 2; ++i) c->sets[i].read_fn = read_crowd, c->sets[i].user = &c->list[i], c->sets[i].soft = i;
    c->scene.particles = c->sets, c->scene.particle_set_count = 2;
}

static void crowds_add(crowds *c, const fixture *f, int set, size_t i) {
    c->list[set].list[c->list[set].count++] = f->crowds[set].list[i];
    c->sets[set].count = c->list[set].count;
}

/* A particle's next place. */
static void move(sps_particle *p, check_random *random) {
    for (int k = 0; k < 3; ++k) p->position[k] = (float)(9 * check_next(random) - 4.5);
}

/* Sums of a texel: components, of moments those that are not yet divided by the first; the front last. */
static double sum_of(const sps_tmap *map, size_t texel, int k) {
    const int n = check_settings_of(map).components;
    const float *own = sps_tmap_texels(map) + texel * (size_t)n;
    if (k == n) return sps_tmap_fronts(map) ? (double)sps_tmap_fronts(map)[texel] : 0;
    return (double)own[k] * (check_settings_of(map).technique == SPS_TMAP_MOMENT && k > 0 ? (double)own[0] : 1);
}

/* The largest difference of two maps' sums, over the largest sum. */
static double apart(const sps_tmap *a, const sps_tmap *b) {
    double most = 0, largest = 0;
    for (size_t i = 0; i < spsi_light_grid_texels(&a->grid); ++i)
        for (int k = 0; k <= check_settings_of(a).components; ++k) {
            most = fmax(most, fabs(sum_of(a, i, k) - sum_of(b, i, k)));
            largest = fmax(largest, fabs(sum_of(b, i, k)));
        }
    return most / largest;
}

/* Moves every fourth particle, again and again. The map is that of the last places: to 1e-5 of the largest sum after
   one update, as floats allow: 40 terms of up to 3 times 6e-8 each; to 1e-4 after 200, whose roundings add like steps
   at random. Seen from all sides, beside voxels and panes, which stay. */
static void test_moves(void) {
    static const int ways[3] = {ORTHO_TURNED, SPOT, ROUND};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 3 * KINDS; ++n) {
        static fixture f;
        static crowds out, in;
        check_random random = {(uint64_t)n + 9};
        begin_kind(&f, n / 3);
        see(&f, ways[n % 3], SIDE);
        scatter(&f, 0, 40, 3, 5), scatter(&f, 1, 40, 3, 6);
        add_box(&f, 6, 2, 0.3, 0.4);
        add_square(&f, 0, -3, 3, 3, 4), add_mesh(&f, 0, 0.7);
        sps_tmap *map = must_build(&f, context);
        for (int turn = 0; turn < (n % 3 == 0 ? 200 : 1) && map; ++turn) {
            crowds_begin(&out), crowds_begin(&in);
            for (int i = turn % 4; i < 80; i += 4) {
                crowds_add(&out, &f, i / 40, (size_t)(i % 40));
                move(&f.crowds[i / 40].list[i % 40], &random);
                crowds_add(&in, &f, i / 40, (size_t)(i % 40));
            }
            if (!CHECK_OK(context, sps_tmap_update(map, &out.scene, &in.scene))) break;
            if (turn != 0 && turn != 199) continue;
            sps_tmap *anew = must_build(&f, context);
            const double off = apart(map, anew);
            if (getenv("CHECK_FIGURES")) printf("kind %d way %d turn %d: %.2g\n", n / 3, n % 3, turn, off);
            if (!CHECK(off < (turn ? 1e-4 : 1e-5)))
                printf("    kind %d, way %d, turn %d: %g\n", n / 3, n % 3, turn, off);
            CHECK(!sps_tmap_fronts(anew) || sps_tmap_fronts(map));
            sps_tmap_destroy(anew);
        }
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Only removed, only added, neither, and everything removed: what is left is nothing, to 1e-5 of what there was. */
static void test_one_side(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < KINDS; ++n) {
        static fixture f, fewer;
        static crowds some;
        begin_kind(&f, n), begin_kind(&fewer, n);
        crowds_begin(&some);
        scatter(&f, 0, 20, 3, 5), scatter(&f, 1, 20, 3, 6);
        for (int i = 0; i < 40; ++i) {
            if (i % 3 == 0) crowds_add(&some, &f, i / 20, (size_t)(i % 20));
            crowd *rest = &fewer.crowds[i / 20];
            if (i % 3) rest->list[rest->count++] = f.crowds[i / 20].list[i % 20];
        }
        sps_tmap *all = must_build(&f, context), *few = must_build(&fewer, context), *map = must_build(&f, context);
        CHECK_OK(context, sps_tmap_update(map, NULL, NULL));
        CHECK(apart(map, all) < 1e-6);
        CHECK_OK(context, sps_tmap_update(map, &some.scene, NULL));
        CHECK(apart(map, few) < 1e-5);
        CHECK_OK(context, sps_tmap_update(map, NULL, &some.scene));
        CHECK(apart(map, all) < 1e-5);
        f.s.scene.particles = f.sets;
        complete(&f);
        CHECK_OK(context, sps_tmap_update(map, &f.s.scene, NULL));
        double largest = 0, left = 0;
        for (size_t i = 0; i < SIDE * SIDE; ++i)
            for (int k = 0; k <= kinds[n].components; ++k) {
                largest = fmax(largest, fabs(sum_of(all, i, k)));
                left = fmax(left, fabs(sum_of(map, i, k)));
                CHECK(kinds[n].technique != SPS_TMAP_OPACITY || k >= kinds[n].components || sum_of(map, i, k) >= 0);
            }
        CHECK(left < 1e-5 * largest);
        sps_tmap_destroy(map), sps_tmap_destroy(all), sps_tmap_destroy(few);
        end(&f), end(&fewer);
    }
    sps_destroy(context);
}

/* Fronts begin with an update, if the first gas before near_depth does. */
static void test_new_fronts(void) {
    static fixture f, after;
    static crowds in;
    sps_context *context = sps_create(NULL, NULL);
    begin_kind(&f, 0), begin_kind(&after, 0);
    f.settings.near_depth = after.settings.near_depth = 9;
    add(&f, 0, 0, 0, -3, 2, 1), add(&after, 0, 0, 0, -3, 2, 1), add(&after, 1, 1, 0, 5, 3, 1);
    crowds_begin(&in);
    crowds_add(&in, &after, 1, 0);
    sps_tmap *map = must_build(&f, context), *anew = must_build(&after, context);
    CHECK(!sps_tmap_fronts(map) && sps_tmap_fronts(anew));
    CHECK_OK(context, sps_tmap_update(map, NULL, &in.scene));
    CHECK(sps_tmap_fronts(map) && apart(map, anew) < 1e-6);
    sps_tmap_destroy(map), sps_tmap_destroy(anew);
    sps_destroy(context);
}

static void check_refused(sps_tmap *map, const sps_scene *removed, const sps_scene *added, sps_result result,
                          const char *text) {
    CHECK(sps_tmap_update(map, removed, added) == result);
    if (!CHECK(strstr(sps_error(map->context), text))) printf("    %s\n", sps_error(map->context));
}

/* What is refused leaves the map as it was; what fails on the way leaves it to be destroyed. */
static void test_errors(void) {
    static fixture f;
    static crowds in;
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= SPS_TMAP_DEPTH; ++technique) {
        if (technique == SPS_TMAP_TABLE) continue;
        begin_little(&f, technique);
        f.settings.texel_range = 1;
        crowds_begin(&in);
        crowds_add(&in, &f, 0, 0);
        sps_tmap *map = must_build(&f, context);
        if (technique != SPS_TMAP_OPACITY && technique != SPS_TMAP_MOMENT)
            check_refused(map, NULL, &in.scene, SPS_ERROR_UNSUPPORTED, "settings.technique is one whose texels cannot");
        if (technique != SPS_TMAP_OPACITY) {
            CHECK(sps_tmap_texels(map) || technique == SPS_TMAP_DEPTH);
            sps_tmap_destroy(map);
            end(&f);
            continue;
        }
        sps_tmap *raw = NULL, *same = must_build(&f, context);
        sps_scene others = f.s.scene;
        others.mesh_count = 0;
        check_refused(map, &others, NULL, SPS_ERROR_UNSUPPORTED, "scene.volume_count is not 0");
        others.mesh_count = 1, others.volume_count = 0;
        check_refused(map, NULL, &others, SPS_ERROR_UNSUPPORTED, "scene.mesh_count is not 0");
        in.scene.end_canary = 1;
        check_refused(map, NULL, &in.scene, SPS_ERROR_ARGUMENT, "scene.end_canary");
        in.scene.end_canary = 0;
        CHECK(same_map(map, same));
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &raw));
        check_refused(raw, NULL, &in.scene, SPS_ERROR_ARGUMENT, "is not finished");
        in.list[0].fail_at = in.list[0].calls + 1;
        check_refused(map, NULL, &in.scene, SPS_ERROR_CALLBACK, "particles[0].read_fn");
        check_refused(map, NULL, &in.scene, SPS_ERROR_ARGUMENT, "is not finished");
        CHECK(!sps_tmap_texels(map));
        CHECK(sps_tmap_update(NULL, NULL, NULL) == SPS_ERROR_ARGUMENT);
        sps_tmap_destroy(map), sps_tmap_destroy(raw), sps_tmap_destroy(same);
        end(&f);
    }
    sps_destroy(context);
}

/* Any number of workers makes the same map; each allocation fails in turn, and nothing leaks. */
static void test_workers_and_memory(void) {
    static fixture f, after;
    static crowds out, in;
    check_hooks hooks, plain;
    memset(&plain, 0, sizeof plain);
    sps_context *alone = check_context(&plain);
    begin_kind(&f, 0), begin_kind(&after, 0);
    scatter(&f, 0, 30, 3, 5), scatter(&f, 1, 30, 3, 6);
    crowds_begin(&out), crowds_begin(&in);
    for (size_t i = 0; i < 10; ++i) crowds_add(&out, &f, 0, i), crowds_add(&in, &f, 1, i);
    sps_tmap *first = must_build(&f, alone);
    CHECK_OK(alone, sps_tmap_update(first, &out.scene, &in.scene));
    for (int n = 1; n < 6; ++n) {
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = n, hooks.order = (uint64_t)n;
        sps_context *context = check_context(&hooks);
        sps_tmap *map = must_build(&f, context);
        hooks.fail_at = n > 2 ? hooks.allocations + n - 2 : 0;
        const sps_result result = sps_tmap_update(map, &out.scene, &in.scene);
        if (hooks.fail_at == 0 && CHECK(result == SPS_OK)) CHECK(same_map(map, first));
        CHECK(result == (hooks.fail_at && hooks.allocations >= hooks.fail_at ? SPS_ERROR_MEMORY : SPS_OK));
        sps_tmap_destroy(map);
        sps_destroy(context);
        CHECK(hooks.live == 0 && hooks.live_blocks == 0);
    }
    sps_tmap_destroy(first);
    sps_destroy(alone);
}

int main(void) {
    RUN(test_moves);
    RUN(test_one_side);
    RUN(test_new_fronts);
    RUN(test_errors);
    RUN(test_workers_and_memory);
    return check_report();
}
