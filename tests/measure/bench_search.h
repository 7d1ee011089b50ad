/* bench_search.h: searches for the cheapest setting that has no more than an error. Include after bench_scenes.h. */

#ifndef BENCH_SEARCH_H
#define BENCH_SEARCH_H

#define SEARCH_SIZE 512 /* pixels along both sides of the picture whose error counts */

/* =================================================================================================== knobs */

/* Something that trades time for error. Values go from exact to cheap. */
typedef struct knob {
    const char *name;
    void (*turn)(frame *f, double value);
    const char *const *words; /* what to call the values; NULL: by themselves */
    int count;
    double values[8];
} knob;

/* A smaller picture, which is then enlarged. */
static void turn_pixels(frame *f, double value) { frame_resize(f, (int)value, (int)value); }

/* The voxels of a volume that has an eval_fn. */
static void turn_voxels(frame *f, double value) {
    for (int i = 0; i < 3; ++i) f->volume.size[i] = (int)value;
    f->volume.revision = (uint64_t)value;
}

static void turn_slab(frame *f, double value) { f->view.slab_thickness = value; }
static void turn_shadow_size(frame *f, double value) { f->view.shadow_resolution = (int)value; }
static void turn_quality(frame *f, double value) { f->view.quality = (sps_quality)(int)value; }
static void turn_tolerance(frame *f, double value) { f->view.tolerance = (float)value; }

static const char *const quality_words[] = {"high", "medium", "draft"};

enum { KNOB_PIXELS, KNOB_VOXELS, KNOB_SLAB, KNOB_QUALITY, KNOB_SHADOW_SIZE, KNOB_TOLERANCE, KNOBS };

/* What a search may leave as it is. */
enum { ALL_PIXELS = 1 << KNOB_PIXELS, SAME_VOXELS = 1 << KNOB_VOXELS };

static const knob knobs[KNOBS] = {
    {"pixels", turn_pixels, NULL, 4, {SEARCH_SIZE, 256, 128, 64}},
    {"voxels", turn_voxels, NULL, 5, {128, 96, 64, 48, 32}},
    {"slab", turn_slab, NULL, 6, {0.5, 1, 2, 4, 8, 16}},
    {"quality", turn_quality, quality_words, 3, {SPS_QUALITY_HIGH, SPS_QUALITY_MEDIUM, SPS_QUALITY_DRAFT}},
    {"shadow_resolution", turn_shadow_size, NULL, 5, {512, 256, 128, 96, 64}},
    {"tolerance", turn_tolerance, NULL, 3, {0, 0.02, 0.1}},
};

/* ================================================================================================ pictures */

typedef struct enlarge_task {
    const frame *from, *to; /* square */
} enlarge_task;

/* Where a pixel's centre lies among those of the smaller picture: the pixel before it, and the share of the next. */
static int enlarge_place(int at, int from, int to, float *share) {
    const double place = fmin(fmax((at + 0.5) * from / to - 0.5, 0), from - 1);
    const int before = place < from - 2 ? (int)place : from - 2;
    *share = (float)(place - before);
    return before;
}

static void enlarge_row(void *data, int y, int worker) {
    const enlarge_task *task = (const enlarge_task *)data;
    const int small = task->from->view.width, large = task->to->view.width;
    float down, across;
    const float *row = task->from->rgba + 4 * (size_t)small * (size_t)enlarge_place(y, small, large, &down);
    float *to = task->to->rgba + 4 * (size_t)large * (size_t)y;
    (void)worker;
    for (int x = 0; x < large; ++x, to += 4) {
        const float *a = row + 4 * enlarge_place(x, small, large, &across), *b = a + 4 * small;
        for (int c = 0; c < 4; ++c) {
            const float above = a[c] + across * (a[c + 4] - a[c]), below = b[c] + across * (b[c + 4] - b[c]);
            to[c] = above + down * (below - above);
        }
    }
}

/* ================================================================================================ searches */

/* The error of a picture, against what the search compares with. */
typedef double (*error_fn)(const void *truth, const frame *f);

static double blob_error(const void *truth, const frame *f) {
    return image_error(f->rgba, (const double *)truth, SEARCH_SIZE, NULL);
}

static double marched_error(const void *t, const frame *f) { return sampled_error((const sampled *)t, f); }

/* A setting that was tried: an index into each knob's values. */
typedef struct attempt {
    int at[KNOBS];
    double seconds, error;
} attempt;

enum { ATTEMPTS = 2000 }; /* at most */

typedef struct search {
    ex_session *session;
    frame *frame;   /* the settings, and a picture of as many pixels as they say */
    frame enlarged; /* the same picture in full size */
    error_fn error_of;
    const void *truth;
    int of[KNOBS], count; /* the knobs that are turned */
    double bound;         /* of the error */
    attempt *attempts;
    int attempt_count;
    int at[KNOBS]; /* the best setting so far */
} search;

/* `without`: knobs that are left as they are, ALL_PIXELS, SAME_VOXELS, or both. The frame has SEARCH_SIZE pixels. */
static void search_begin(search *s, ex_session *session, frame *f, int without, error_fn error_of, const void *truth) {
    memset(s, 0, sizeof *s);
    s->session = session, s->frame = f, s->error_of = error_of, s->truth = truth;
    frame_copy(&s->enlarged, f);
    for (int k = 0; k < KNOBS; ++k)
        if (!(without >> k & 1)) s->of[s->count++] = k;
    s->attempts = (attempt *)ex_allocate(ATTEMPTS, sizeof(attempt));
}

static void search_end(search *s) {
    frame_end(&s->enlarged);
    free(s->attempts);
}

static void search_turn(const search *s, const int at[KNOBS]) {
    for (int i = 0; i < s->count; ++i) knobs[s->of[i]].turn(s->frame, knobs[s->of[i]].values[at[i]]);
}

/* Renders as the knobs stand. Returns the seconds that it took, with enlarging. */
static double search_render(search *s) {
    enlarge_task task = {s->frame, &s->enlarged};
    const double start = ex_now(NULL);
    render_seconds(s->session, s->frame, &s->frame->view);
    if (s->frame->view.width < SEARCH_SIZE) ex_parallel_for(&s->session->pool, SEARCH_SIZE, enlarge_row, &task);
    return ex_now(NULL) - start;
}

static double search_error(const search *s) {
    return s->error_of(s->truth, s->frame->view.width < SEARCH_SIZE ? &s->enlarged : s->frame);
}

/* Whether no knob of a setting is turned farther towards cheap than in another. */
static int search_within(const search *s, const int at[KNOBS], const int other[KNOBS]) {
    for (int i = 0; i < s->count; ++i)
        if (at[i] > other[i]) return 0;
    return 1;
}

/* Whether a setting is not worth trying: one that is cheaper in every knob took longer than the best, or one that is
   more exact in every knob has far too much error. */
static int search_hopeless(const search *s, const int at[KNOBS], double best) {
    for (int n = 0; n < s->attempt_count; ++n) {
        const attempt *a = &s->attempts[n];
        if (a->seconds > 1.2 * best && search_within(s, at, a->at)) return 1;
        if (a->error > 2 * s->bound && search_within(s, a->at, at)) return 1;
    }
    return 0;
}

/* Tries a setting unless it is known or hopeless. The first frame may have to read voxels, in up to a tenth of a
   second; one that takes several times as long as the best besides is not worth another. Returns NULL if it is not
   tried. */
static const attempt *search_try(search *s, const int at[KNOBS], double best) {
    attempt *a = &s->attempts[s->attempt_count];
    for (int n = 0; n < s->attempt_count; ++n)
        if (memcmp(s->attempts[n].at, at, sizeof s->attempts[n].at) == 0) return &s->attempts[n];
    if (s->attempt_count == ATTEMPTS || search_hopeless(s, at, best)) return NULL;
    s->attempt_count += 1;
    memcpy(a->at, at, sizeof a->at);
    search_turn(s, at);
    a->seconds = search_render(s);
    a->error = search_error(s);
    if (a->seconds < 3 * best + 0.1) a->seconds = search_render(s);
    return a;
}

/* Tries all values of two knobs, or of one if both are the same, and keeps the fastest that has no more than the error
   allowed, `best` seconds so far. Times are noisy: what is hardly faster is not kept. */
static void search_pair(search *s, int i, int k, double *best) {
    int at[KNOBS];
    memcpy(at, s->at, sizeof at);
    for (int m = 0; m < knobs[s->of[i]].count; ++m)
        for (int n = 0; n < (i == k ? 1 : knobs[s->of[k]].count); ++n) {
            at[k] = n, at[i] = m;
            const attempt *a = search_try(s, at, *best);
            if (!a || !(a->error <= s->bound) || !(a->seconds < 0.98 * *best)) continue;
            *best = a->seconds;
            memcpy(s->at, at, sizeof at);
        }
}

/* One knob at a time, then two at a time, since a thicker slab may allow for what thinner ones do not. Begins with the
   best setting so far, or the most exact one where that has more error than the bound. Searches of other bounds go on
   with the same attempts. Returns whether any setting has the bound. */
static int search_run(search *s, double bound) {
    static const int exact[KNOBS];
    const attempt *a;
    double best;
    s->bound = bound;
    a = search_try(s, s->at, HUGE_VAL);
    if (!a || !(a->error <= bound)) memcpy(s->at, exact, sizeof exact);
    a = search_try(s, s->at, HUGE_VAL);
    if (!a || !(a->error <= bound)) return 0;
    best = a->seconds;
    for (int k = 0; k < s->count; ++k) search_pair(s, k, k, &best);
    for (int i = 0; i < s->count; ++i)
        for (int k = i + 1; k < s->count; ++k) search_pair(s, i, k, &best);
    return 1;
}

/* The best setting's time again, a median, and its error. */
static attempt search_best(search *s) {
    double seconds[REPEATS];
    attempt best;
    memcpy(best.at, s->at, sizeof best.at);
    search_turn(s, s->at);
    search_render(s);
    for (int r = 0; r < REPEATS; ++r) seconds[r] = search_render(s);
    best.seconds = ex_percentile(seconds, REPEATS, 0.5);
    best.error = search_error(s);
    return best;
}

static void search_words(const search *s, char *text, size_t size) {
    size_t used = 0;
    for (int i = 0; i < s->count && used < size; ++i) {
        const knob *of = knobs + s->of[i];
        char value[32];
        snprintf(value, sizeof value, "%g", of->values[s->at[i]]);
        used += (size_t)snprintf(text + used, size - used, "%s %s%s", of->name, of->words ? of->words[s->at[i]] : value,
                                 i + 1 < s->count ? ", " : "");
    }
}

/* ================================================================================ the cheapest of each error */

enum { BOUNDS = 5 };
static const double bounds[BOUNDS] = {0.0001, 0.0003, 0.001, 0.003, 0.01};

/* The row of one bound. `last`: that of the row before, of 0 seconds if it has none; one setting has one time. */
static void search_row(search *s, double bound, attempt *last) {
    const double before = last->seconds;
    char setting[200];
    if (!search_run(s, bound)) {
        printf("| %g | not reached | | | |\n", bound);
        last->seconds = 0;
        return;
    }
    if (!(before > 0) || memcmp(last->at, s->at, sizeof last->at) != 0) *last = search_best(s);
    search_words(s, setting, sizeof setting);
    printf("| %g | %.5f | %.1f | ", bound, last->error, 1e3 * last->seconds);
    if (before > 0) printf("%.2f", last->seconds / before);
    printf(" | %s |\n", setting);
    fflush(stdout);
}

/* A table in Markdown: for each error the cheapest setting that has no more, and its time as a share of the row before;
   last the scene without its volume in full size, whose time only fewer pixels can undercut. */
static void search_table(search *s, const char *name) {
    frame bare;
    contender c;
    attempt last;
    memset(&last, 0, sizeof last);
    printf("\n### %s\n\n| error at most | error | ms | of the row before | cheapest setting |\n"
           "|---|---|---|---|---|\n",
           name);
    for (int i = 0; i < BOUNDS; ++i) search_row(s, bounds[i], &last);
    frame_copy(&bare, s->frame);
    frame_resize(&bare, SEARCH_SIZE, SEARCH_SIZE);
    bare.scene.volume_count = 0;
    contender_set(&c, s->session, &bare, 0);
    race(&c, 1, REPEATS);
    printf("| without the volume | | %.1f | | all pixels |\n", 1e3 * c.seconds);
    frame_end(&bare);
}

/* Against sps_reference at every stride-th pixel. */
static void search_marched(const char *name, frame *f, int stride, double step) {
    ex_session session;
    sampled t;
    search s;
    ex_session_measure(&session, program, WORKERS);
    sampled_march(&t, &session, f, stride, step);
    search_begin(&s, &session, f, SAME_VOXELS, marched_error, &t);
    search_table(&s, name);
    search_end(&s), sampled_end(&t), ex_session_end(&session);
}

static void search_blob(void) {
    const blob shape = {BLOB_WIDTH, BLOB_EXTINCTION};
    ex_session session;
    search s;
    frame f;
    ex_session_measure(&session, program, WORKERS);
    double *exact = blob_exact(&session, shape, SEARCH_SIZE);
    blob_frame(&f, 128, SEARCH_SIZE);
    search_begin(&s, &session, &f, 0, blob_error, exact);
    search_table(&s, "Blob over a plane");
    search_end(&s), frame_end(&f), free(exact), ex_session_end(&session);
}

static void bench_cheapest(void) {
    ex_grid grid;
    frame f;
    printf("## Cheapest settings\n\n512 x 512 pixels, 2 workers, cached voxels. The search varies every setting, then "
           "every pair, and lists the\ncheapest setting for each error. Smaller pictures are enlarged linearly; time "
           "and error include this. The\nreference is the closed form for the blob, and `sps_reference` at every 5th "
           "to 17th pixel in each direction\nelsewhere. Errors are rms in radiance.\n");
    search_blob();
    if (!smoke_load(&grid)) {
        smoke_ground_frame(&f, &grid, SEARCH_SIZE);
        search_marched("Smoke over a ground", &f, 5, 1);
        frame_end(&f), ex_grid_free(&grid);
    }
    full_frame(&f, SEARCH_SIZE);
    search_marched("256<sup>3</sup> voxels full of gas", &f, 17, 1);
    frame_end(&f);
    if (!bonsai_load(&grid)) {
        bonsai_frame(&f, &grid);
        f.volume.shading = SPS_SHADING_SURFACE;
        search_marched("Bonsai, a surface", &f, 7, 0.25);
        frame_end(&f), ex_grid_free(&grid);
    }
}

#endif /* BENCH_SEARCH_H */
