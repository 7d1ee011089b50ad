/* Reading voxels by one worker and by several, on other threads or on the calling one: the same bricks, which are
   computed independently here, the same errors and counts; callbacks are called where the volume says; whatever fails
   or is cancelled leaves nothing behind. */

#include "check.h"

#include <pthread.h>

/* Three blocks wide, two high and two deep. */
enum { NX = 70, NY = 43, NZ = 45, VOXELS = NX * NY * NZ, BLOCKS = 12, SIDE = 16, COUNT = 4 * SIDE * SIDE };

/* A gas that is read, one that is evaluated, and a classified volume that has ranges. */
typedef enum kind { GAS, EVALUATED, CLASSIFIED, KINDS } kind;

static float values[VOXELS];
static float pixels_a[COUNT], pixels_b[COUNT];

/* --- the volume --- */

/* What happens when a block is asked for. Calls are counted by their thread: 0: the calling one; 1: another one. */
typedef struct source {
    int read_codes[BLOCKS], range_codes[BLOCKS]; /* what callbacks return */
    float low, high;                             /* range_fn: what it says of each block, if low is not 0 */
    pthread_t caller;
    int reads[2], ranges[2];
} source;

static void count_call(const source *from, int *calls) {
    __atomic_fetch_add(&calls[!pthread_equal(pthread_self(), from->caller)], 1, __ATOMIC_SEQ_CST);
}

static int block_of(int x, int y, int z) { return (z / 32 * 2 + y / 32) * 3 + x / 32; }

/* The block whose first voxel, or the first one of its margin, is at `lo`. */
static int block_at(const int lo[3]) { return block_of(lo[0] + 3, lo[1] + 3, lo[2] + 3); }

static const float *row_of(int x, int y, int z) { return values + ((size_t)z * NY + (size_t)y) * NX + (size_t)x; }

static int read_some(void *user, const int lo[3], const int size[3], float *out) {
    source *from = (source *)user;
    count_call(from, from->reads);
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y, out += size[0])
            memcpy(out, row_of(lo[0], lo[1] + y, lo[2] + z), (size_t)size[0] * sizeof *out);
    return from->read_codes[block_at(lo)];
}

static int range_some(void *user, const int lo[3], const int size[3], float out[2]) {
    source *from = (source *)user;
    count_call(from, from->ranges);
    out[0] = 0, out[1] = 1;
    if (from->low < 0 || from->low > 0) out[0] = from->low, out[1] = from->high;
    (void)size;
    return from->range_codes[block_at(lo)];
}

/* The volume's box is NX, NY, NZ wide. */
static int eval_some(void *user, size_t count, const double *positions, float *out) {
    source *from = (source *)user;
    const int block = block_of((int)positions[0], (int)positions[1], (int)positions[2]);
    count_call(from, from->reads);
    for (size_t i = 0; i < count; ++i, positions += 3)
        out[i] = *row_of((int)positions[0], (int)positions[1], (int)positions[2]);
    return from->read_codes[block];
}

/* Mostly nothing, five balls, single voxels, and values that are too small to matter. */
static void make_values(void) {
    check_random random = {3};
    for (int n = 0; n < VOXELS; ++n) {
        const double x = n % NX, y = n / NX % NY, z = n / (NX * NY), one = check_next(&random);
        values[n] = one < 0.0005 ? 0.975f : one < 0.02 ? 0.275f : one < 0.03 ? 1e-31f : one < 0.04 ? 1e-29f : 0;
        for (int ball = 0; ball < 5; ++ball) {
            const double dx = x - 14 * ball - 3, dy = y - 9 * ball, dz = z - 40 + 9 * ball;
            if (dx * dx + dy * dy + dz * dz < 49) values[n] = 0.025f + 0.05f * (float)(n % 19);
        }
    }
}

/* A table's entries are 1/2048 apart; values are farther than that from 0.3, from which on there is extinction. */
static const sps_transfer_point look_points[] = {{0.3f, {0.9f, 0.8f, 0.7f}, 0, {0, 0, 0}},
                                                 {0.5f, {0.9f, 0.5f, 0.3f}, 0.4f, {0, 0, 0}},
                                                 {1, {0.2f, 0.3f, 0.4f}, 0, {0, 0, 0}}};
static const sps_transfer look = {look_points, 3, NULL, NULL, 0};

static void start(check_scene *s, kind which, source *from, int concurrent) {
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 0.5 * NX, 0.5 * NY, 200);
    check_set3(s->view.camera.target, 0.5 * NX, 0.5 * NY, 0);
    check_orthographic(&s->view.camera, NX);
    volume = check_add_volume(s, NX, NY, NZ, check_box(0, 0, 0, NX, NY, NZ));
    volume->extinction = 0.1f;
    volume->user = from, volume->concurrent = concurrent;
    if (which == EVALUATED)
        volume->eval_fn = eval_some;
    else
        volume->read_fn = read_some;
    if (which == CLASSIFIED) volume->range_fn = range_some, volume->transfer = &look;
    memset(from, 0, sizeof *from);
    from->caller = pthread_self();
}

/* --- workers --- */

typedef struct crew {
    sps_task_fn task;
    void *data;
    int count, workers, next;
} crew;

typedef struct hand {
    crew *all;
    int worker;
} hand;

static void *work(void *user) {
    const hand *self = (const hand *)user;
    for (;;) {
        const int index = __atomic_fetch_add(&self->all->next, 1, __ATOMIC_SEQ_CST);
        if (index >= self->all->count) return NULL;
        self->all->task(self->all->data, index, self->worker);
    }
}

/* sps_config.parallel_for_fn: all tasks on new threads, none on the calling one. */
static void on_other_threads(void *user, int count, sps_task_fn task, void *data) {
    crew all = {task, data, count, *(const int *)user, 0};
    pthread_t threads[8];
    hand hands[8];
    for (int w = 0; w < all.workers; ++w) {
        hands[w].all = &all, hands[w].worker = w;
        if (pthread_create(&threads[w], NULL, work, &hands[w])) abort();
    }
    for (int w = 0; w < all.workers; ++w) pthread_join(threads[w], NULL);
}

/* A context with that many workers: 0: no parallel_for_fn, otherwise threads, or, with `order` above 0, in an odd
   order on the calling thread. */
static sps_context *begin(int *workers, int order, check_hooks *hooks) {
    sps_config config;
    memset(hooks, 0, sizeof *hooks);
    hooks->worker_count = *workers, hooks->order = (uint64_t)order;
    config = check_config(hooks);
    if (*workers > 0 && order == 0) config.parallel_for_fn = on_other_threads, config.parallel_user = workers;
    return sps_create(&config, NULL);
}

static void end(sps_context *context, const check_hooks *hooks) {
    sps_destroy(context);
    CHECK(hooks->live == 0);
}

static const int crews[] = {0, 1, 2, 7}; /* workers */

/* --- bricks --- */

static unsigned char wanted[VOXELS];
static float most[VOXELS];

/* The largest of the values within a voxel, or, of `from`, within that many. */
static float most_near(const float *from, int n, int reach) {
    const int x = n % NX, y = n / NX % NY, z = n / (NX * NY);
    float found = 0;
    for (int k = spsi_imax(0, z - reach); k <= spsi_imin(NZ - 1, z + reach); ++k)
        for (int j = spsi_imax(0, y - reach); j <= spsi_imin(NY - 1, y + reach); ++j)
            for (int i = spsi_imax(0, x - reach); i <= spsi_imin(NX - 1, x + reach); ++i)
                found = spsi_fmax(found, from[(k * NY + j) * NX + i]);
    return found;
}

/* Marks the voxels that a kind of volume keeps: not 0, and, if it is classified, within two voxels of a place where a
   value up to the largest of its neighbours has extinction. */
static void want(kind which) {
    for (int n = 0; n < VOXELS; ++n) most[n] = which == CLASSIFIED ? most_near(values, n, 1) : 1;
    for (int n = 0; n < VOXELS; ++n)
        wanted[n] = values[n] >= 1e-30f && (which != CLASSIFIED || most_near(most, n, 2) > 0.3f);
}

/* Whether the brick at `base` holds what it should, from z, y, x = 0 up, if it is number *at of the context's list,
   which is stepped over; or, if it has nothing, is left out. */
static int check_brick(const sps_context *context, const int base[3], int *at) {
    const spsi_brick *brick = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data + *at;
    int count = 0, low[3] = {8, 8, 8}, high[3] = {-1, -1, -1}, good = 1;
    for (int n = 0; n < 512 && good; ++n) {
        const int step[3] = {n % 8, n / 8 % 8, n / 64};
        const int x = base[0] + step[0], y = base[1] + step[1], z = base[2] + step[2], voxel = (z * NY + y) * NX + x;
        const spsi_segment *segment;
        if (x >= NX || y >= NY || z >= NZ || !wanted[voxel]) continue;
        for (int k = 0; k < 3; ++k) low[k] = spsi_imin(low[k], step[k]), high[k] = spsi_imax(high[k], step[k]);
        good = *at < context->brick_count && count < brick->count;
        if (!good) continue;
        segment = spsi_segment_at(context, brick->segment);
        good = segment->place[brick->first + count] == n &&
               memcmp(&segment->value[brick->first + count], &values[voxel], sizeof(float)) == 0;
        count += 1;
    }
    if (count == 0) return good;
    *at += 1;
    for (int k = 0; k < 3; ++k)
        good &= brick->base[k] == base[k] && brick->low[k] == low[k] && brick->high[k] == high[k];
    return good && brick->count == count && brick->lattice == 0;
}

/* Bricks are in the order of their blocks, and in blocks by z, y, x; so are voxels in them. Loads of vectors at the end
   of a segment find zeros. */
static void check_bricks(const sps_context *context) {
    int at = 0, wrong = 0;
    for (int block = 0; block < BLOCKS; ++block)
        for (int n = 0; n < 64; ++n) {
            const int base[3] = {block % 3 * 32 + n % 4 * 8, block / 3 % 2 * 32 + n / 4 % 4 * 8,
                                 block / 6 * 32 + n / 16 * 8};
            wrong += !check_brick(context, base, &at);
        }
    if (!CHECK(wrong == 0 && at == context->brick_count && at > 50))
        printf("    %d bricks are wrong, %d of %d\n", wrong, at, context->brick_count);
    for (int i = 0; i < context->segment_count; ++i) {
        const spsi_segment *segment = spsi_segment_at(context, i);
        for (int k = segment->used; k < segment->used + SPSI_PADDING; ++k)
            wrong += segment->place[k] != 0 || segment->value[k] != 0;
    }
    CHECK(wrong == 0);
}

static void test_bricks(void) {
    for (int which = 0; which < KINDS; ++which) {
        want((kind)which);
        for (int n = 0; n < 4 * 2 * 2; ++n) {
            int workers = crews[n % 4];
            check_hooks hooks;
            check_scene s;
            source from;
            sps_context *context = begin(&workers, n / 4 % 2 * 5, &hooks);
            start(&s, (kind)which, &from, n / 8);
            if (check_render(context, &s, n == 0 ? pixels_a : pixels_b)) check_bricks(context);
            CHECK(n == 0 || check_same(&s, pixels_a, pixels_b));
            end(context, &hooks);
        }
    }
}

/* Two volumes, two frames of which the second has fewer voxels, and its segments what was left of the first. */
static void test_second_frame(void) {
    for (int n = 0; n < 4; ++n) {
        int workers = crews[n];
        check_hooks hooks;
        check_scene s;
        source from;
        sps_context *context = begin(&workers, 0, &hooks);
        start(&s, GAS, &from, 1);
        s.volume[1] = s.volume[0], s.scene.volume_count = 2;
        CHECK(check_render(context, &s, pixels_a));
        start(&s, CLASSIFIED, &from, 1);
        want(CLASSIFIED);
        if (check_render(context, &s, pixels_a)) check_bricks(context);
        end(context, &hooks);
    }
}

/* --- errors and counts --- */

/* What a render leaves. */
typedef struct outcome {
    sps_result result;
    sps_error_info info;
    sps_stats_report stats;
} outcome;

static outcome render(check_scene *s, int workers, int order) {
    check_hooks hooks;
    outcome o;
    sps_context *context = begin(&workers, order, &hooks);
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = pixels_b;
    o.result = sps_render(context, &s->scene, &s->view, &image);
    sps_get_error(context, &o.info);
    sps_get_stats(context, &o.stats);
    CHECK(hooks.live == o.stats.bytes);
    end(context, &hooks);
    return o;
}

static int same_counts(const sps_stats_report *a, const sps_stats_report *b) {
    return a->range_calls == b->range_calls && a->read_calls == b->read_calls && a->eval_calls == b->eval_calls &&
           a->blocks_skipped == b->blocks_skipped && a->voxels_read == b->voxels_read &&
           a->values_replaced == b->values_replaced;
}

/* Checks that any number of workers, on any threads, fail as one does. Returns what they fail with. */
static outcome fail_alike(check_scene *s) {
    const outcome first = render(s, 0, 0);
    for (int n = 1; n < 8; ++n) {
        const outcome other = render(s, crews[n / 2], n % 2 * n);
        int good = CHECK(other.result == first.result && memcmp(&other.info, &first.info, sizeof first.info) == 0);
        good &= CHECK(same_counts(&first.stats, &other.stats));
        if (!good)
            printf("    %d workers: %s\n    instead of %s\n", crews[n / 2], other.info.sentence, first.info.sentence);
    }
    return first;
}

/* The first block that fails decides, also if later ones fail otherwise. */
static void test_failing_blocks(void) {
    for (int n = 0; n < KINDS * 2 * BLOCKS; ++n) {
        const int block = n % BLOCKS, concurrent = n / BLOCKS % 2;
        const kind which = (kind)(n / BLOCKS / 2);
        const int ranged = which == CLASSIFIED && block % 2;
        static const char *const fields[2][KINDS] = {{"read_fn", "eval_fn", "read_fn"}, {"", "", "range_fn"}};
        check_scene s;
        source from;
        outcome o;
        start(&s, which, &from, concurrent);
        (ranged ? from.range_codes : from.read_codes)[block] = 100 + block;
        for (int later = block + 1; later < BLOCKS; later += 2)
            from.read_codes[later] = 50, from.range_codes[later] = 51;
        o = fail_alike(&s);
        CHECK(o.result == SPS_ERROR_CALLBACK && o.info.object == SPS_OBJECT_VOLUME && o.info.index == 0);
        CHECK(strcmp(o.info.field, fields[ranged][which]) == 0 && (int)o.info.value == 100 + block);
        from.reads[0] = 0;
        CHECK(render(&s, 7, 0).result == SPS_ERROR_CALLBACK);
        CHECK(concurrent || (uint64_t)from.reads[0] == o.stats.read_calls + o.stats.eval_calls);
        CHECK(which == EVALUATED || o.stats.read_calls == (uint64_t)(block + !ranged));
        CHECK(which != CLASSIFIED || o.stats.range_calls == (uint64_t)(block + 1));
    }
}

/* Invalid values fail at the first one of the first block that has one, whatever fails later, or are replaced. */
static void test_invalid_values(void) {
    static const float bad[5] = {-1e-38f, 1.0001e18f, INFINITY, -INFINITY, NAN};
    check_random random = {8};
    for (int n = 0; n < (check_long() ? 40 : 20); ++n) {
        const int voxel = n == 0 ? 0 : n == 1 ? VOXELS - 1 : (int)(check_next(&random) * VOXELS);
        const int at[3] = {voxel % NX, voxel / NX % NY, voxel / (NX * NY)};
        const int block = block_of(at[0], at[1], at[2]);
        const float kept = values[voxel];
        char rule[64];
        check_scene s;
        source from;
        outcome o;
        start(&s, n % 2 ? GAS : EVALUATED, &from, n / 2 % 2);
        values[voxel] = bad[n % 5];
        for (int later = block + 1; later < BLOCKS; ++later) from.read_codes[later] = 50;
        o = fail_alike(&s);
        snprintf(rule, sizeof rule, "(voxel %d,%d,%d)", at[0], at[1], at[2]);
        CHECK(o.result == SPS_ERROR_DATA && strcmp(o.info.field, "value") == 0 && strstr(o.info.sentence, rule));
        memset(from.read_codes, 0, sizeof from.read_codes);
        s.scene.replace_invalid = 1;
        CHECK(fail_alike(&s).stats.values_replaced == 1);
        values[voxel] = kept;
    }
}

/* A range that is too narrow hides its block, one that is none hides nothing, for any number of workers. */
static void test_ranges(void) {
    static const float said[4][2] = {{1e-3f, 0.2f}, {0.9f, 0.1f}, {NAN, NAN}, {1, 1e19f}};
    for (int n = 0; n < 2 * 4; ++n) {
        check_scene s;
        source from;
        outcome o;
        start(&s, CLASSIFIED, &from, n / 4);
        from.low = said[n % 4][0], from.high = said[n % 4][1];
        o = fail_alike(&s);
        CHECK(o.result == SPS_OK && o.stats.range_calls == BLOCKS);
        CHECK(o.stats.read_calls == (n % 4 ? BLOCKS : 0) && o.stats.blocks_skipped == (n % 4 ? 0 : BLOCKS));
    }
}

/* --- threads --- */

/* Other threads call if the volume is concurrent, and only then; statistics count what callbacks do. */
static void test_threads(void) {
    for (int n = 0; n < KINDS * 2 * 4; ++n) {
        const int concurrent = n % 2, workers = crews[n / 2 % 4];
        const kind which = (kind)(n / 8);
        const int aside = concurrent && workers > 0;
        check_scene s;
        source from;
        outcome o;
        start(&s, which, &from, concurrent ? 1 + n : 0);
        o = render(&s, workers, 0);
        /* A frame with several blocks has several tasks; a single one may run on the calling thread. */
        if (workers == 1) continue;
        CHECK(o.result == SPS_OK && from.reads[!aside] == 0 && from.ranges[!aside] == 0);
        CHECK((uint64_t)from.reads[aside] == o.stats.read_calls + o.stats.eval_calls && from.reads[aside] > 0);
        CHECK((uint64_t)from.ranges[aside] == o.stats.range_calls && (from.ranges[aside] > 0) == (which == CLASSIFIED));
    }
}

/* The library's own callbacks may be called by workers; others unless the volume says so may not. */
static void test_own_callbacks(void) {
    for (int n = 0; n < 2 * 2 * 3 * 2; ++n) {
        const int said = n % 2, own_read = n / 2 % 2, ranges = n / 4 % 3; /* 0: none; 1: the library's; 2: another */
        spsi_lattice lattice;
        spsi_medium medium;
        sps_volume volume;
        memset(&volume, 0, sizeof volume);
        volume.concurrent = said ? -1 : 0;
        volume.read_fn = own_read ? sps_grid_read : read_some;
        volume.range_fn = ranges == 0 ? NULL : ranges == 1 ? sps_grid_range : range_some;
        if (n / 12) volume.read_fn = NULL, volume.eval_fn = eval_some;
        spsi_medium_build(&volume, 0, &lattice, &medium);
        CHECK((medium.given.concurrent != 0) == (said || (n / 12 == 0 && own_read && ranges < 2)));
    }
}

/* The reference reads the same values, without asking for ranges, and fails alike. */
static void test_reference(void) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = pixels_b;
    for (int n = 0; n < 2 * 2 * 4; ++n) {
        int workers = crews[n % 4], concurrent = n / 4 % 2, aside = concurrent && workers > 1;
        check_hooks hooks;
        check_scene s;
        source from;
        sps_error_info info;
        sps_context *context = begin(&workers, 0, &hooks);
        start(&s, n / 8 ? GAS : CLASSIFIED, &from, concurrent);
        CHECK(check_march(context, &s, 20, n % 8 ? pixels_b : pixels_a, NULL));
        CHECK(n % 8 == 0 || check_same(&s, pixels_a, pixels_b));
        CHECK(from.ranges[0] + from.ranges[1] == 0 && from.reads[aside] == BLOCKS && from.reads[!aside] == 0);
        from.read_codes[5] = 7, from.read_codes[6] = 8;
        CHECK(check_reference(context, &s.scene, &s.view, 20, &image) == SPS_ERROR_CALLBACK);
        sps_get_error(context, &info);
        CHECK(strcmp(info.field, "read_fn") == 0 && (int)info.value == 7);
        end(context, &hooks);
    }
}

/* So do maps, of the same size in bytes with the same texels. */
static void test_map(void) {
    static float texels[SIDE * SIDE * 8];
    for (int n = 0; n < 2 * 4; ++n) {
        int workers = crews[n % 4], aside = n / 4 && workers > 1;
        const size_t bytes = SIDE * SIDE * 4 * sizeof(float);
        check_hooks hooks;
        check_scene s;
        source from;
        sps_tmap *map;
        sps_tmap_light light;
        sps_tmap_settings settings;
        sps_context *context = begin(&workers, 0, &hooks);
        memset(&settings, 0, sizeof settings);
        settings.technique = SPS_TMAP_OPACITY, settings.components = 4, settings.near_depth = 100;
        settings.far_depth = 250;
        start(&s, CLASSIFIED, &from, n / 4);
        light = check_light_of(&s.view);
        if (!CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map))) continue;
        CHECK_OK(context, sps_tmap_add(map, &s.scene));
        if (CHECK_OK(context, sps_tmap_finish(map)) && n == 0) memcpy(texels, sps_tmap_texels(map), bytes);
        CHECK(memcmp(texels, sps_tmap_texels(map), bytes) == 0);
        CHECK(from.reads[aside] == BLOCKS && from.ranges[aside] == BLOCKS && from.reads[!aside] == 0);
        sps_tmap_destroy(map);
        end(context, &hooks);
    }
}

/* --- memory, and cancelling --- */

/* sps_config.progress_fn: cancels the at-th call, and watches that calls are on one thread, with progress. */
typedef struct watch {
    long calls, at;
    pthread_t caller;
    float last;
    int wrong;
} watch;

static int watch_progress(void *user, float fraction) {
    watch *w = (watch *)user;
    w->wrong += !pthread_equal(pthread_self(), w->caller) || !(fraction >= w->last && fraction <= 1);
    w->last = fraction;
    return ++w->calls == w->at;
}

/* Any allocation fails, or any call of progress_fn cancels. */
static void test_failures(void) {
    for (int n = 0; n < 2 * 2 * 2; ++n) {
        if (!check_long() && (n / 4 + n / 2 + n) % 2) continue; /* any two of the three in every way */
        int workers = n % 2 ? 7 : 2, cancels = n / 2 % 2;
        check_scene s;
        source from;
        sps_result result = SPS_ERROR_MEMORY;
        start(&s, n / 4 ? CLASSIFIED : GAS, &from, n / 4);
        check_render_plain(&s, pixels_a);
        for (long at = 1; result != SPS_OK; at += cancels ? 1 + at / 8 : 1) {
            watch w = {0, cancels ? at : 0, pthread_self(), 0, 0};
            check_hooks hooks;
            sps_config config;
            sps_context *context;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = workers;
            config = check_config(&hooks);
            config.parallel_for_fn = on_other_threads, config.parallel_user = &workers;
            config.progress_fn = watch_progress, config.progress_user = &w;
            config.clock_fn = check_hasty_clock;
            context = sps_create(&config, NULL);
            if (!cancels) hooks.fail_at = hooks.allocations + at;
            result = check_try(context, &s, pixels_b);
            CHECK(result == SPS_OK || result == (cancels ? SPS_ERROR_CANCELLED : SPS_ERROR_MEMORY));
            hooks.fail_at = 0;
            w.at = 0, w.last = 0;
            CHECK(check_try(context, &s, pixels_b) == SPS_OK && check_same(&s, pixels_a, pixels_b));
            CHECK(w.wrong == 0 && w.calls > BLOCKS / 4);
            end(context, &hooks);
        }
    }
}

/* Blocks that are held at a time are planned: one, or four per worker, but no more than there are. */
static void test_planned(void) {
    size_t alone = 0;
    for (int n = 0; n < 4; ++n) {
        int workers = crews[n];
        check_hooks hooks;
        check_scene s;
        source from;
        sps_plan_report report;
        sps_context *context = begin(&workers, 1, &hooks);
        start(&s, GAS, &from, 1);
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
        if (n == 0) alone = report.pass[SPS_PASS_GATHER].bytes;
        CHECK(report.pass[SPS_PASS_GATHER].bytes == alone + (size_t)(workers < 2    ? 0
                                                                     : workers == 2 ? 7
                                                                                    : BLOCKS - 1) *
                                                                sizeof(spsi_voxels));
        CHECK(from.reads[0] + from.reads[1] == 0);
        CHECK(check_render(context, &s, pixels_b) && hooks.peak <= report.bytes);
        end(context, &hooks);
    }
}

/* Behind the last point of a transfer function its appearance goes on, up to any value_max. */
static void test_behind_the_last_point(void) {
    static const sps_transfer_point points[] = {{0.1f, {0.9f, 0.8f, 0.7f}, 0, {0, 0, 0}},
                                                {0.4f, {0.6f, 0.5f, 0.3f}, 0.3f, {0, 0, 0}},
                                                {1, {0.6f, 0.5f, 0.3f}, 0.3f, {0, 0, 0}}};
    sps_transfer ends_early = {points, 2, NULL, NULL, 1}, ends = {points, 3, NULL, NULL, 1};
    for (int i = 0; i < 2; ++i) {
        check_hooks hooks;
        check_scene s;
        source from;
        int workers = 1;
        sps_context *context = begin(&workers, 1, &hooks);
        start(&s, CLASSIFIED, &from, 1);
        s.volume[0].transfer = i ? &ends : &ends_early;
        check_color(s.scene.ambient, 1, 1, 1);
        check_render(context, &s, i ? pixels_b : pixels_a);
        end(context, &hooks);
    }
    CHECK(memcmp(pixels_a, pixels_b, sizeof pixels_a) == 0);
}

/* --- parts --- */

static void test_bits(void) {
    check_random random = {6};
    for (int n = 0; n < 1000; ++n) {
        uint64_t mask = 0;
        int count = 0;
        for (int i = 0; i < 64; ++i) {
            const int bit = n == 0 ? 0 : n == 1 ? 1 : check_next(&random) < 0.5;
            mask |= (uint64_t)bit << i, count += bit;
        }
        CHECK(spsi_bit_count(mask) == count);
    }
}

/* A vector's lanes hide what spsi_transfer_shows does not show, at the table's entries and between them: values up to
   which no entry has extinction, nor the next one. */
static void test_hidden(void) {
    static spsi_table table;
    static sps_context none;
    check_random random = {2};
    for (int n = 0; n < 60; ++n) {
        sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {0, {1, 1, 1}, 1, {0, 0, 0}}};
        sps_transfer transfer = {points, 2, NULL, NULL, 0};
        spsi_material material;
        memset(&material, 0, sizeof material);
        material.table = &table;
        points[0].value = n < 2 ? 0 : (float)check_next(&random);
        points[0].extinction = n == 1;
        points[1].value = points[0].value + (float)check_next(&random);
        transfer.value_max = n % 3 ? 1 : 0;
        if (!CHECK(spsi_transfer_tabulate(&none, &transfer, 0, &material) == SPS_OK) || !material.extinguishes)
            continue;
        int first = 0;
        while (!(table.entry[first][3] > 0)) ++first;
        for (int i = 0; i < 4 * SPSI_TABLE_SIZE; ++i) {
            const float value = (float)i * 0.3f / (float)SPSI_TABLE_SIZE;
            float lanes[SPSI_LANES];
            const int shows = (int)fminf(value * material.table_scale, SPSI_TABLE_SIZE - 1) + 1 >= first;
            for (int k = 0; k < SPSI_LANES; ++k) lanes[k] = value;
            if (!CHECK(spsi_transfer_shows(&material, value) == shows &&
                       spsi_hidden_bits(&material, spsi_load(lanes)) == (shows ? 0 : (1 << SPSI_LANES) - 1)))
                printf("    %d: value %g\n", n, (double)value);
        }
    }
}

static int range_nothing(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    (void)lo, (void)size;
    out_min_max[0] = out_min_max[1] = 0;
    return ++*(long *)user > 1000; /* enough: nothing ends this */
}

/* An empty volume of 2^48 voxels is asked about 2^21 times or more: planning and reading it end when told to. */
static void test_endless(void) {
    for (int n = 0; n < 2 * 4; ++n) {
        long asked = 0;
        watch w = {0, 5, pthread_self(), 0, 0};
        sps_config config;
        check_scene s;
        sps_plan_report plan;
        memset(&config, 0, sizeof config);
        config.progress_fn = watch_progress, config.progress_user = &w;
        config.clock_fn = check_hasty_clock;
        sps_context *context = sps_create(&config, NULL);
        check_clear(&s, 8, 8);
        sps_volume *volume = check_add_volume(&s, 65536, 65536, 65536, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = read_some, volume->range_fn = range_nothing, volume->user = &asked;
        volume->range_levels = n / 2, volume->extinction = 1;
        float rgba[4 * 8 * 8];
        sps_image image;
        memset(&image, 0, sizeof image);
        image.rgba = rgba;
        const sps_result result =
            n % 2 ? sps_render(context, &s.scene, &s.view, &image) : sps_plan(context, &s.scene, &s.view, &plan);
        if (!CHECK(result == SPS_ERROR_CANCELLED && asked < 200 && w.calls == 5))
            printf("    %d: result %d, %ld calls\n", n, (int)result, asked);
        sps_destroy(context);
    }
}

int main(void) {
    make_values();
    RUN(test_bits);
    RUN(test_hidden);
    RUN(test_bricks);
    RUN(test_second_frame);
    RUN(test_failing_blocks);
    RUN(test_invalid_values);
    RUN(test_ranges);
    RUN(test_threads);
    RUN(test_own_callbacks);
    RUN(test_reference);
    RUN(test_map);
    RUN(test_failures);
    RUN(test_planned);
    RUN(test_behind_the_last_point);
    RUN(test_endless);
    return check_report();
}
