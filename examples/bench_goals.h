/* bench_goals.h: what bench.c measures against the project's goals of speed, as one table in Markdown. Include after
   bench_scenes.h. */

#ifndef BENCH_GOALS_H
#define BENCH_GOALS_H

#define GOAL_SIZE 512 /* pixels along both sides of most pictures */

/* ==================================================================================================== rows */

/* One row. `error` below 0: none. Bounds that are not finite are none. */
static void goal_row(const char *what, double value, const char *unit, double error, double low, double high) {
    const int none = !(low > -DBL_MAX || high < DBL_MAX);
    printf("| %s | %.3g%s%s |", what, value, *unit ? " " : "", unit);
    if (error >= 0)
        printf(" %.5f |", error);
    else
        printf(" |");
    if (none)
        printf(" | |\n");
    else
        printf(" %s %g%s%s |", high < DBL_MAX ? "<=" : ">=", high < DBL_MAX ? high : low, *unit ? " " : "", unit);
    if (value > high)
        printf(" missed by %.0f %% |\n", 100 * (value / high - 1));
    else if (value < low)
        printf(" missed by %.0f %% |\n", 100 * (1 - value / low));
    else if (!none)
        printf(" met |\n");
    fflush(stdout);
}

static void goal_time(const char *what, double seconds, double error, double bound) {
    goal_row(what, seconds, "s", error, -HUGE_VAL, bound);
}

static void goal_ratio(const char *what, double ratio, double bound) {
    goal_row(what, ratio, "", -1, -HUGE_VAL, bound);
}

static void goal_workers(const char *what, double one, double two) {
    goal_row(what, one / two, "", -1, 1.93, HUGE_VAL);
}

/* ================================================================================================== searches */

/* Something that trades time for error. Values go from exact to cheap. */
typedef struct knob {
    const char *name;
    void (*turn)(frame *f, double value);
    const char *const *words; /* what to call the values; NULL: by themselves */
    int count;
    double values[8];
} knob;

/* The voxels of a volume that has an eval_fn. */
static void turn_voxels(frame *f, double value) {
    for (int i = 0; i < 3; ++i) f->volume.size[i] = (int)value;
    f->volume.revision = (uint64_t)value;
}

static void turn_slab(frame *f, double value) { f->view.slab = value; }
static void turn_shadow_size(frame *f, double value) { f->view.shadow_size = (int)value; }
static void turn_quality(frame *f, double value) { f->view.quality = (sps_quality)(int)value; }
static void turn_lookup_threshold(frame *f, double value) { f->view.lookup_threshold = (float)value; }
static void turn_tolerance(frame *f, double value) { f->view.tolerance = (float)value; }

static const char *const quality_words[] = {"high", "medium", "draft"};

/* A search of a volume whose voxels are given leaves the first one out. */
static const knob knobs[] = {
    {"voxels", turn_voxels, NULL, 5, {128, 96, 64, 48, 32}},
    {"slab", turn_slab, NULL, 6, {0.5, 1, 2, 4, 8, 16}},
    {"quality", turn_quality, quality_words, 3, {SPS_QUALITY_HIGH, SPS_QUALITY_MEDIUM, SPS_QUALITY_DRAFT}},
    {"shadow_size", turn_shadow_size, NULL, 5, {512, 256, 128, 96, 64}},
    {"lookup_threshold", turn_lookup_threshold, NULL, 4, {0, 0.01, 0.03, 0.1}},
    {"tolerance", turn_tolerance, NULL, 3, {0, 0.02, 0.1}},
};
enum { KNOBS = sizeof knobs / sizeof *knobs };

/* The error of a picture, against what the search compares with. */
typedef double (*error_fn)(const void *truth, const frame *f);

/* What is known of a setting. */
typedef struct attempt {
    double seconds, error; /* seconds 0: not tried; infinite: worse than the first search's bound */
} attempt;

typedef struct search {
    ex_session *session;
    frame *frame;
    error_fn error_of;
    const void *truth;
    int first;             /* knob */
    double bound, loosest; /* error: of this search, and of the first one with these attempts */
    attempt *attempts;
    int at[KNOBS]; /* the best setting so far: an index into each knob's values */
} search;

static void search_begin(search *s, ex_session *session, frame *f, int first, error_fn error_of, const void *truth) {
    size_t count = 1;
    memset(s, 0, sizeof *s);
    s->session = session, s->frame = f, s->first = first, s->error_of = error_of, s->truth = truth;
    for (int k = first; k < KNOBS; ++k) count *= (size_t)knobs[k].count;
    s->attempts = (attempt *)ex_allocate(count, sizeof(attempt));
    memset(s->attempts, 0, count * sizeof(attempt));
}

static void search_end(search *s) { free(s->attempts); }

static void search_turn(const search *s, const int at[KNOBS]) {
    for (int k = s->first; k < KNOBS; ++k) knobs[k].turn(s->frame, knobs[k].values[at[k]]);
}

static attempt *search_attempt(const search *s, const int at[KNOBS]) {
    size_t index = 0;
    for (int k = s->first; k < KNOBS; ++k) index = index * (size_t)knobs[k].count + (size_t)at[k];
    return s->attempts + index;
}

/* Tries a setting unless it is known. The first frame may have to read voxels; one that takes several times as long as
   the best is not worth another. */
static const attempt *search_try(search *s, const int at[KNOBS], double best) {
    attempt *a = search_attempt(s, at);
    if (a->seconds > 0) return a;
    search_turn(s, at);
    a->seconds = render_seconds(s->session, s->frame, &s->frame->view);
    a->error = s->error_of(s->truth, s->frame);
    if (!(a->error <= s->loosest)) a->seconds = HUGE_VAL;
    if (a->seconds < 3 * best) a->seconds = render_seconds(s->session, s->frame, &s->frame->view);
    return a;
}

/* Tries all values of two knobs, or of one if both are the same, and keeps the fastest that has no more than the error
   allowed. Times are noisy: what is hardly faster is not kept. */
static void search_pair(search *s, int i, int k) {
    int at[KNOBS];
    memcpy(at, s->at, sizeof at);
    double best = search_try(s, at, HUGE_VAL)->seconds;
    for (int m = 0; m < knobs[i].count; ++m)
        for (int n = 0; n < (i == k ? 1 : knobs[k].count); ++n) {
            at[k] = n, at[i] = m;
            const attempt *a = search_try(s, at, best);
            if (!(a->error <= s->bound) || !(a->seconds < 0.98 * best)) continue;
            best = a->seconds;
            memcpy(s->at, at, sizeof at);
        }
}

/* From the most exact setting, one knob at a time, then two at a time, since a thicker slab may allow for what thinner
   ones do not. Searches of stricter bounds go on with the same attempts. Returns whether any setting has the bound. */
static int search_run(search *s, double bound) {
    memset(s->at, 0, sizeof s->at);
    s->bound = bound;
    if (!(s->loosest > 0)) s->loosest = bound;
    if (!(search_try(s, s->at, HUGE_VAL)->error <= bound)) return 0;
    for (int k = s->first; k < KNOBS; ++k) search_pair(s, k, k);
    for (int i = s->first; i < KNOBS; ++i)
        for (int k = i + 1; k < KNOBS; ++k) search_pair(s, i, k);
    return 1;
}

static void search_words(const search *s, char *text, size_t size) {
    size_t used = 0;
    for (int k = s->first; k < KNOBS && used < size; ++k) {
        const knob *of = knobs + k;
        char value[32];
        snprintf(value, sizeof value, "%g", of->values[s->at[k]]);
        used += (size_t)snprintf(text + used, size - used, "%s %s%s", of->name, of->words ? of->words[s->at[k]] : value,
                                 k + 1 < KNOBS ? ", " : "");
    }
}

/* The row of a search: its best setting, timed again. */
static void goal_search(search *s, const char *name, double bound, double seconds) {
    char setting[200], what[300];
    contender c;
    if (!search_run(s, bound)) {
        printf("| %s, error <= %g | | | <= %g s | not reached |\n", name, bound, seconds);
        return;
    }
    search_turn(s, s->at);
    contender_set(&c, s->session, s->frame, 0);
    race(&c, 1, REPEATS);
    search_words(s, setting, sizeof setting);
    snprintf(what, sizeof what, "%s, error <= %g: %s", name, bound, setting);
    goal_time(what, c.seconds, s->error_of(s->truth, s->frame), seconds);
}

/* ==================================================================================================== bonsai */

/* Root mean square difference from the most exact picture of ours. The reference itself would have to march steps of an
   eighth of a voxel to be more exact, in a minute. */
static void goals_bonsai_times(frame *f, ex_session *one, ex_session *two) {
    contender c[4];
    frame splatted;
    sampled t;
    frame_copy(&splatted, f);
    splatted.view.filling = SPS_FILLING_SPLAT;
    sampled_march(&t, two, f, 7, 0.25);
    contender_set(&c[0], one, f, 0);
    contender_set(&c[1], two, f, 1);
    contender_set(&c[2], two, &splatted, 0);
    contender_set(&c[3], two, f, 0);
    race(c, 4, REPEATS);
    goal_time("bonsai scan, 256^3, a surface, medium, shadowed", c[3].seconds, sampled_error(&t, f), 0.2);
    goal_time("... splatted", c[2].seconds, sampled_error(&t, &splatted), HUGE_VAL);
    goal_ratio("... shadowed / unshadowed, time", c[3].seconds / c[1].seconds, 1.5);
    goal_workers("... 1 worker / 2 workers, time", c[0].seconds, c[3].seconds);
    sampled_end(&t);
    frame_end(&splatted);
}

/* A small picture of the same view, beside a larger one. */
static void goals_preview(const frame *f, ex_session *two) {
    static const int sizes[2][2] = {{40, 30}, {640, 480}};
    frame frames[2];
    contender c[2];
    for (int i = 0; i < 2; ++i) {
        frame_copy(&frames[i], f);
        frame_resize(&frames[i], sizes[i][0], sizes[i][1]);
        contender_set(&c[i], two, &frames[i], 0);
    }
    race(c, 2, REPEATS);
    goal_ratio("bonsai, 40 x 30 / 640 x 480, time", c[0].seconds / c[1].seconds, 0.1);
    for (int i = 0; i < 2; ++i) frame_end(&frames[i]);
}

/* What a first frame takes to read, classify and store voxels: the median of new contexts. */
static double reading_seconds(const frame *f) {
    enum { ROUNDS = 5 };
    double seconds[ROUNDS];
    for (int r = 0; r < ROUNDS; ++r) {
        ex_session session;
        sps_stats_report stats;
        ex_session_measure(&session, program, WORKERS);
        render_seconds(&session, f, &f->view);
        sps_get_stats(session.context, &stats);
        seconds[r] = stats.seconds_gather;
        ex_session_end(&session);
    }
    return ex_percentile(seconds, ROUNDS, 0.5);
}

static void goals_reading(const frame *f, const ex_grid *grid) {
    sps_grid bytes;
    frame small;
    memset(&bytes, 0, sizeof bytes);
    bytes.voxels = grid->data, bytes.format = SPS_VOXEL_U8, bytes.scale = 1 / 255.0f;
    memcpy(bytes.size, grid->size, sizeof bytes.size);
    frame_copy(&small, f);
    frame_resize(&small, 64, 64);
    goal_time("bonsai: 256^3 bytes read and classified, by a read_fn and known ranges", reading_seconds(&small), -1,
              HUGE_VAL);
    small.volume.read_fn = sps_grid_read, small.volume.range_fn = sps_grid_range, small.volume.user = &bytes;
    goal_time("... by sps_grid_read", reading_seconds(&small), -1, 0.1);
    frame_end(&small);
}

static void goals_bonsai(void) {
    ex_grid grid;
    ex_session one, two;
    frame f;
    if (bonsai_load(&grid)) return;
    ex_session_measure(&one, program, 1);
    ex_session_measure(&two, program, WORKERS);
    bonsai_frame(&f, &grid);
    f.volume.shading = SPS_SHADING_SURFACE;
    goals_bonsai_times(&f, &one, &two);
    goals_preview(&f, &two);
    goals_reading(&f, &grid);
    frame_end(&f);
    ex_session_end(&two);
    ex_session_end(&one);
    ex_grid_free(&grid);
}

/* ======================================================================================================== gas */

static double blob_error(const void *truth, const frame *f) {
    return image_error(f->rgba, (const double *)truth, GOAL_SIZE, NULL);
}

static double marched_error(const void *t, const frame *f) { return sampled_error((const sampled *)t, f); }

/* Time and error at medium, and the gain of a second worker. */
static void goals_medium(const char *name, const frame *f, ex_session *one, ex_session *two, error_fn error_of,
                         const void *against) {
    contender c[2];
    char what[120];
    contender_set(&c[0], one, f, 0);
    contender_set(&c[1], two, f, 0);
    race(c, 2, REPEATS);
    snprintf(what, sizeof what, "%s, medium", name);
    goal_time(what, c[1].seconds, error_of(against, f), HUGE_VAL);
    goal_workers("... 1 worker / 2 workers, time", c[0].seconds, c[1].seconds);
}

static void goals_blob(void) {
    const blob shape = {BLOB_WIDTH, BLOB_EXTINCTION};
    ex_session one, two;
    search s;
    frame f;
    ex_session_measure(&one, program, 1);
    ex_session_measure(&two, program, WORKERS);
    double *exact = blob_exact(&two, shape, GOAL_SIZE);
    blob_frame(&f, 128, GOAL_SIZE);
    goals_medium("blob over a plane, 128^3", &f, &one, &two, blob_error, exact);
    search_begin(&s, &two, &f, 0, blob_error, exact);
    goal_search(&s, "...", 0.001, 0.03);
    goal_search(&s, "...", 0.0001, 0.12);
    search_end(&s);
    frame_end(&f);
    free(exact);
    ex_session_end(&two);
    ex_session_end(&one);
}

static void goals_smoke(void) {
    ex_grid grid;
    ex_session one, two;
    sampled t;
    search s;
    frame f;
    if (smoke_load(&grid)) return;
    ex_session_measure(&one, program, 1);
    ex_session_measure(&two, program, WORKERS);
    smoke_ground_frame(&f, &grid, GOAL_SIZE);
    sampled_march(&t, &two, &f, 5, 1);
    goals_medium("smoke over a ground, 111 x 222 x 112", &f, &one, &two, marched_error, &t);
    search_begin(&s, &two, &f, 1, marched_error, &t);
    goal_search(&s, "...", 0.003, 0.05);
    search_end(&s);
    sampled_end(&t);
    frame_end(&f);
    ex_session_end(&two);
    ex_session_end(&one);
    ex_grid_free(&grid);
}

static void goals_full(void) {
    ex_session session;
    contender c;
    sampled t;
    search s;
    frame f;
    ex_session_measure(&session, program, 1);
    full_frame(&f, GOAL_SIZE);
    sampled_march(&t, &session, &f, 17, 1);
    contender_set(&c, &session, &f, 0);
    race(&c, 1, REPEATS);
    goal_time("256^3 voxels full of gas, medium, 1 worker", c.seconds, sampled_error(&t, &f), 0.25);
    search_begin(&s, &session, &f, 1, marched_error, &t);
    goal_search(&s, "...", 0.001, 0.25);
    search_end(&s);
    sampled_end(&t);
    frame_end(&f);
    ex_session_end(&session);
}

static void goals_particles(void) {
    sps_particles particles;
    ex_session session;
    contender c;
    frame f;
    ex_session_measure(&session, program, WORKERS);
    particles_frame(&f, &particles, 1000000);
    contender_set(&c, &session, &f, 0);
    race(&c, 1, 3);
    goal_time("1 million particles, 1024 x 768, one shadowing light", c.seconds, -1, 0.5);
    frame_end(&f);
    free(particles.user);
    ex_session_end(&session);
}

/* =================================================================================================== the table */

static void bench_goals(void) {
    printf(
        "\n512 x 512 pixels, one directional light with shadows, 2 workers, voxels held from frame to frame, where a\n"
        "row does not say otherwise. Times are medians of frames that take turns. Errors are root mean squares in\n"
        "radiance: the blob's against its closed form, others against `sps_reference`: the bonsai's with steps of a\n"
        "quarter of a voxel at every 7th pixel in each direction, the smoke's with steps of 1 voxel at every 5th, that\n"
        "of 256^3 full of gas likewise at every 17th.\n\n"
        "| what | time, or ratio | error | goal | |\n|---|---|---|---|---|\n");
    goals_bonsai();
    goals_blob();
    goals_smoke();
    goals_full();
    goals_particles();
}

/* ================================================================================== the same by other builds */

/* Prints the name of a frame and its time in seconds, 1 worker, on one line. */
static void print_frame(const char *name, const frame *f) {
    ex_session session;
    contender c;
    ex_session_measure(&session, program, 1);
    contender_set(&c, &session, f, 0);
    race(&c, 1, 1);
    printf("%s %.4f\n", name, c.seconds);
    fflush(stdout);
    ex_session_end(&session);
}

/* A few frames, to compare builds: they take turns in the Makefile. */
static void bench_frames(void) {
    ex_grid grid;
    frame f;
    blob_frame(&f, 128, GOAL_SIZE);
    print_frame("blob", &f);
    frame_end(&f);
    if (!smoke_load(&grid)) {
        smoke_ground_frame(&f, &grid, GOAL_SIZE);
        print_frame("smoke", &f);
        frame_end(&f), ex_grid_free(&grid);
    }
    if (!bonsai_load(&grid)) {
        bonsai_frame(&f, &grid);
        f.volume.shading = SPS_SHADING_SURFACE;
        print_frame("bonsai", &f);
        frame_end(&f), ex_grid_free(&grid);
    }
}

#endif /* BENCH_GOALS_H */
