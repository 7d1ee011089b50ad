/* bench_goals.h: what bench.c measures against the project's goals of speed, as one table in Markdown. Include after
   bench_search.h. */

#ifndef BENCH_GOALS_H
#define BENCH_GOALS_H

/* ==================================================================================================== rows */

/* Bounds of a figure: 0 is none, below 0 its opposite is the least. What is accepted, and what is aimed at. */
typedef struct goal {
    double accept, aim;
} goal;

static const goal no_goal = {0, 0}, workers_goal = {-1.9, 0};

/* One row; `beside` is not judged. */
static void goal_row(const char *what, double value, const char *unit, const char *beside, goal g) {
    const double limits[2] = {g.accept, g.aim};
    double over[2]; /* above 1: missed, by that share of the limit */
    printf("| %s | %.3g%s | %s |", what, value, unit, beside);
    for (int i = 0; i < 2; ++i) {
        over[i] = limits[i] < 0 ? 2 - value / -limits[i] : value / limits[i];
        if (fabs(limits[i]) > 0)
            printf(" %s %g%s |", limits[i] < 0 ? ">=" : "<=", fabs(limits[i]), unit);
        else
            printf(" |");
    }
    if (!(fabs(g.accept) > 0))
        printf(" |\n");
    else if (over[0] > 1 && over[0] < HUGE_VAL)
        printf(" missed by %.0f %% |\n", 100 * (over[0] - 1));
    else if (over[0] > 1)
        printf(" missed |\n");
    else
        printf(" %s |\n", fabs(g.aim) > 0 && over[1] <= 1 ? "aim met" : "met");
    fflush(stdout);
}

/* Errors below 0: none. */
static void goal_time(const char *what, double seconds, double error, double bound) {
    char beside[32] = "";
    if (error >= 0) snprintf(beside, sizeof beside, "rms %.5f", error);
    goal_row(what, seconds, " s", beside, (goal){bound, 0});
}

/* Times of two, beside their ratio. */
static void goal_ratio(const char *what, double seconds, double of, goal g) {
    char beside[48];
    snprintf(beside, sizeof beside, "%.3g s, %.3g s", seconds, of);
    goal_row(what, seconds / of, "", beside, g);
}

static void goal_workers(const char *what, double one, double two) { goal_ratio(what, one, two, (goal){-1.93, 0}); }

/* The row of a search: its best setting, timed again. */
static void goal_search(search *s, const char *name, double bound, double seconds) {
    char setting[200], what[300];
    if (!search_run(s, bound)) {
        printf("| %s, error <= %g | | | <= %g s | | not reached |\n", name, bound, seconds);
        return;
    }
    const attempt best = search_best(s);
    search_words(s, setting, sizeof setting);
    snprintf(what, sizeof what, "%s, error <= %g: %s", name, bound, setting);
    goal_time(what, best.seconds, best.error, seconds);
}

/* ==================================================================================================== bonsai */

/* Root mean square difference from the most exact picture of ours. The reference itself would have to march steps of an
   eighth of a voxel to be more exact, in a minute. */
static void goals_bonsai_times(frame *f, ex_session *one, ex_session *two) {
    contender c[3];
    frame splatted;
    sampled t;
    frame_copy(&splatted, f);
    splatted.view.filling = SPS_FILLING_SPLAT;
    sampled_march(&t, two, f, 7, 0.25);
    contender_set(&c[0], one, f, 0);
    contender_set(&c[1], two, &splatted, 0);
    contender_set(&c[2], two, f, 0);
    race(c, 3, REPEATS);
    goal_time("bonsai scan, 256^3, a surface, medium, shadowed", c[2].seconds, sampled_error(&t, f), 0.2);
    goal_time("... splatted", c[1].seconds, sampled_error(&t, &splatted), 0);
    goal_workers("... 1 worker / 2 workers", c[0].seconds, c[2].seconds);
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
    goal_ratio("bonsai, 40 x 30 / 640 x 480", c[0].seconds, c[1].seconds, (goal){0.1, 0});
    for (int i = 0; i < 2; ++i) frame_end(&frames[i]);
}

static void goals_reading(const frame *f, const ex_grid *grid) {
    sps_grid bytes;
    frame small;
    memset(&bytes, 0, sizeof bytes);
    bytes.voxels = grid->data, bytes.format = SPS_VOXEL_U8, bytes.scale = 1 / 255.0f;
    memcpy(bytes.size, grid->size, sizeof bytes.size);
    frame_copy(&small, f);
    frame_resize(&small, 64, 64);
    goal_time("bonsai: 256^3 bytes read and classified, by a read_fn and known ranges", reading_seconds(&small), -1, 0);
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

/* Time and error at medium, and the gain of a second worker. */
static void goals_medium(const char *name, const frame *f, ex_session *one, ex_session *two, error_fn error_of,
                         const void *against) {
    contender c[2];
    char what[120];
    contender_set(&c[0], one, f, 0);
    contender_set(&c[1], two, f, 0);
    race(c, 2, REPEATS);
    snprintf(what, sizeof what, "%s, medium", name);
    goal_time(what, c[1].seconds, error_of(against, f), 0);
    goal_workers("... 1 worker / 2 workers", c[0].seconds, c[1].seconds);
}

static void goals_blob(void) {
    const blob shape = {BLOB_WIDTH, BLOB_EXTINCTION};
    ex_session one, two;
    search s;
    frame f;
    ex_session_measure(&one, program, 1);
    ex_session_measure(&two, program, WORKERS);
    double *exact = blob_exact(&two, shape, SEARCH_SIZE);
    blob_frame(&f, 128, SEARCH_SIZE);
    goals_medium("blob over a plane, 128^3", &f, &one, &two, blob_error, exact);
    search_begin(&s, &two, &f, ALL_PIXELS, blob_error, exact);
    goal_search(&s, "...", 0.0001, 0.12);
    goal_search(&s, "...", 0.001, 0.03);
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
    smoke_ground_frame(&f, &grid, SEARCH_SIZE);
    sampled_march(&t, &two, &f, 5, 1);
    goals_medium("smoke over a ground, 111 x 222 x 112", &f, &one, &two, marched_error, &t);
    search_begin(&s, &two, &f, ALL_PIXELS | SAME_VOXELS, marched_error, &t);
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
    full_frame(&f, SEARCH_SIZE);
    sampled_march(&t, &session, &f, 17, 1);
    contender_set(&c, &session, &f, 0);
    race(&c, 1, REPEATS);
    goal_time("256^3 voxels full of gas, medium, 1 worker", c.seconds, sampled_error(&t, &f), 0.25);
    search_begin(&s, &session, &f, ALL_PIXELS | SAME_VOXELS, marched_error, &t);
    goal_search(&s, "...", 0.001, 0.25);
    search_end(&s);
    sampled_end(&t);
    frame_end(&f);
    ex_session_end(&session);
}

/* =================================================================================================== the table */

static void bench_goals(void) {
    printf("\nUnless a row says otherwise: 512 x 512 pixels, one directional light with shadows, %d workers, cached\n"
           "voxels. Errors are rms in radiance: the blob's to its closed form, others to `sps_reference`. The bonsai\n"
           "has steps of a quarter of a voxel at every 7th pixel in each direction, smoke 1 voxel at every 5th, and\n"
           "256^3 voxels full of gas 1 voxel at every 17th.\n\n"
           "| what | | | goal | aim | |\n|---|---|---|---|---|---|\n",
           WORKERS);
    goals_bonsai();
    goals_blob();
    goals_smoke();
    goals_full();
}

#endif /* BENCH_GOALS_H */
