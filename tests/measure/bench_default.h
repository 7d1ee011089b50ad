/* bench_default.h: how much the default mode takes beside single scattering, and what else a frame should not pay for,
   as rows of one table in Markdown; and frames by which builds compare. Include after bench_goals.h and puffs.h. */

#ifndef BENCH_DEFAULT_H
#define BENCH_DEFAULT_H

enum { ALTERNATIONS = 7 };

/* ================================================================================================== scenes */

/* The quick start of the header, and three clouds. */
typedef enum default_scene { QUICK, GREY, COLORED, GROUND } default_scene;

static int ground_read(void *user, size_t first, size_t count, sps_triangle *out) {
    static const float corners[4][3] = {{-9, -0.8f, 5}, {9, -0.8f, 5}, {9, -0.8f, -9}, {-9, -0.8f, -9}};
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < 3; ++k)
            memcpy(out[i].position[k], corners[k == 0 ? 0 : first + i + k], sizeof corners[0]);
    return 0;
}

static int quick_density(void *user, size_t count, const double *p, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, p += 3) out[i] = (float)exp(-16 * ex_dot(p, p));
    return 0;
}

static int fractal_cloud(void *user, size_t count, const double *p, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, p += 3) {
        const double depth = 0.72 - sqrt(ex_dot(p, p) + p[1] * p[1]);
        out[i] = (float)ex_clamp(6 * (depth + 0.35 * ex_fractal(ex_vec_of(3 * p[0], 3 * p[1], 3 * p[2]), 5)), 0, 1);
    }
    return 0;
}

/* A column that grows wider upwards. */
static int fractal_plume(void *user, size_t count, const double *p, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, p += 3) {
        const double depth = 0.3 + 0.12 * p[1] - sqrt(p[0] * p[0] + p[2] * p[2]);
        out[i] = (float)ex_clamp(4 * (depth + 0.25 * ex_fractal(ex_vec_of(4 * p[0], 4 * p[1], 4 * p[2]), 4)), 0, 1);
    }
    return 0;
}

/* A gas in the box from -half to half, and a sun. Voxels are kept, and so is the ground, which is left out at first. */
static void gas_frame(frame *f, int (*density)(void *, size_t, const double *, float *), const int size[3],
                      const double half[3], int width, int height) {
    static const double sun[3] = {1, -1, -0.5};
    frame_begin(f, width, height);
    for (int i = 0; i < 3; ++i) {
        f->volume.size[i] = size[i];
        f->volume.placement.origin[i] = -half[i], f->volume.placement.axis[i][i] = 2 * half[i];
        f->mesh.albedo[i] = 0.3f + 0.1f * (float)i;
        f->scene.ambient[i] = f->scene.background[i] = 0.1f * (float)(i + 1);
    }
    f->volume.eval_fn = density, f->volume.concurrent = 1, f->volume.revision = 1;
    f->mesh.triangle_count = 2, f->mesh.read_fn = ground_read, f->mesh.revision = 1;
    f->scene.mesh_count = 0;
    memcpy(f->light.direction, sun, sizeof sun);
    f->view.camera.position[1] = 1.2, f->view.camera.position[2] = 5, f->view.camera.field_of_view = 0.5;
    f->view.scattering = SPS_SCATTERING_AUTO;
}

static void default_frame(frame *f, default_scene scene, int pixels) {
    static const int sizes[2][3] = {{64, 64, 64}, {128, 128, 128}};
    static const double half[3] = {1, 1, 1};
    gas_frame(f, scene == QUICK ? quick_density : fractal_cloud, sizes[scene != QUICK], half, pixels, pixels);
    f->scene.mesh_count = scene == QUICK || scene == GROUND;
    for (int i = 0; i < 3; ++i) {
        f->volume.albedo[i] = scene == QUICK ? 0.7f + 0.1f * (float)i : scene == GREY ? 1 : 1 - 0.04f * (float)i;
        f->light.color[i] = scene == QUICK ? 9 - (float)i : scene == GREY ? 3 : 3 - 0.2f * (float)i;
        if (scene == GREY) f->scene.ambient[i] = f->scene.background[i] = 0.2f;
    }
    f->volume.extinction = scene == QUICK ? 6 : 30;
    if (scene != QUICK) return;
    f->volume.revision = f->mesh.revision = 0, f->volume.concurrent = 0;
    f->view.camera.position[2] = 4, f->view.camera.field_of_view = 0.6;
    for (int i = 0; i < 3; ++i) f->scene.ambient[i] = 0, f->mesh.albedo[i] = i < 2 ? 0.3f : 0.2f;
}

static void plume_frame(frame *f, sps_scattering scattering) {
    static const int size[3] = {96, 160, 96};
    static const double half[3] = {0.6, 1, 0.6};
    gas_frame(f, fractal_plume, size, half, 640, 360);
    f->scene.mesh_count = 1;
    f->volume.extinction = 12;
    for (int i = 0; i < 3; ++i) f->volume.albedo[i] = 0.9f - 0.03f * (float)i, f->light.color[i] = 3;
    f->view.scattering = scattering;
}

#define ORBIT (2 * EX_PI / 60) /* from frame to frame: once round in 60 */

/* The bonsai as a gas; without the scan the colored cloud, which its rows then name. */
static const char *bonsai_gas(frame *f, ex_grid *grid) {
    const int missing = bonsai_load(grid);
    if (missing)
        default_frame(f, COLORED, 512), f->view.scattering = SPS_SCATTERING_SINGLE;
    else
        bonsai_frame(f, grid);
    return missing ? "colored cloud in place of the bonsai" : "bonsai as a gas";
}

/* =============================================================================== default / single scattering */

/* What differs from frame to frame: nothing, the context, the sun, or the camera a little, or round the gas. */
typedef enum change { STILL, FRESH, TURN, MOVE, ROUND } change;

typedef struct pair {
    const char *name;
    default_scene scene;
    int pixels, workers;
    change change;
    goal goal;
    double to_cells, to_paths; /* goals of errors, %; 0: not measured */
} pair;

static const pair pairs[] = {
    {"quick start, 256^2", QUICK, 256, 1, FRESH, {2, 1.5}, 1, 1},
    {"quick start, 64^2", QUICK, 64, 1, FRESH, {4, 2}, 0, 0},
    {"grey cloud, made anew", GREY, 512, WORKERS, TURN, {1.7, 1.4}, 0.81, 1.51},
    {"colored cloud, made anew", COLORED, 512, WORKERS, TURN, {2, 1.5}, 0.76, 1.44},
    {"colored cloud over a ground, made anew", GROUND, 512, WORKERS, TURN, {2.5, 1.8}, 0.64, 1.24},
    {"grey cloud, cached", GREY, 512, WORKERS, MOVE, {1.2, 1.08}, 0, 0},
    {"colored cloud, cached", COLORED, 512, WORKERS, MOVE, {1.3, 1.08}, 0, 0},
    {"colored cloud over a ground, cached", GROUND, 512, WORKERS, MOVE, {1.5, 1.08}, 0, 0},
};
enum { PAIRS = sizeof pairs / sizeof *pairs };

static void contender_change(contender *c, frame *f, change by) {
    c->fresh = by == FRESH;
    c->turning = by == TURN ? &f->light : NULL, c->turning_count = 1;
    c->moving = by == MOVE ? &c->view.camera.position[0] : NULL;
    c->orbit = by == ROUND ? ORBIT : 0;
}

/* The default beside single scattering; or `by_workers`, by one worker beside two. */
static void pair_row(const pair *p, int by_workers, int repeats) {
    frame frames[2];
    ex_session sessions[2];
    contender c[2];
    char what[120];
    for (int i = 0; i < 2; ++i) {
        default_frame(&frames[i], p->scene, p->pixels);
        if (i == 1 && !by_workers) frames[i].view.scattering = SPS_SCATTERING_SINGLE;
        ex_session_measure(&sessions[i], program, by_workers ? 1 + i : p->workers);
        contender_set(&c[i], &sessions[i], &frames[i], 0);
        contender_change(&c[i], &frames[i], p->change);
    }
    race(c, 2, repeats);
    snprintf(what, sizeof what, "%s: %s", p->name, by_workers ? "1 worker / 2 workers" : "default / single");
    goal_ratio(what, c[0].seconds, c[1].seconds, by_workers ? workers_goal : p->goal);
    for (int i = 0; i < 2; ++i) ex_session_end(&sessions[i]), frame_end(&frames[i]);
}

/* ================================================================================================== errors */

enum { WALKED_SIDE = 30, WALKED_PATHS = 256, FINE_CELLS = 96 };

/* The root mean square error against random paths at some of the frame's pixels, over their mean radiance. What the
   paths' own standard errors, `noise`, add to it is taken off. */
static double paths_error(ex_session *session, const frame *f, double *noise) {
    sampled t;
    double squares = 0;
    sampled_begin(&t, f, f->view.width / WALKED_SIDE | 1);
    const int side = t.frame.view.width;
    float *error = (float *)ex_allocate((size_t)(side * side), 3 * sizeof *error);
    walk_seconds(session, &t.frame, WALKED_PATHS, error);
    for (int i = 0; i < 3 * side * side; ++i) squares += pow((double)error[i], 2) / (3 * side * side);
    const double mean = frame_mean(&t.frame), rms = sqrt(fmax(pow(sampled_error(&t, f), 2) - squares, 0));
    *noise = sqrt(squares) / mean;
    free(error);
    sampled_end(&t);
    return rms / mean;
}

/* Errors of a pair's default, of its mean radiance: to cells that are finer, and to paths. Goals are half of what it
   was before cells were chosen by what they must resolve, where that was above 1 %. */
static void error_rows(const pair *p) {
    ex_session session;
    frame f, fine;
    char what[120], beside[48];
    double noise;
    ex_session_measure(&session, program, WORKERS);
    default_frame(&f, p->scene, p->pixels);
    frame_copy(&fine, &f);
    fine.view.scattering = SPS_SCATTERING_MULTIPLE, fine.view.scattering_resolution = FINE_CELLS;
    render_seconds(&session, &f, &f.view);
    render_seconds(&session, &fine, &fine.view);
    snprintf(what, sizeof what, "%s: error to %d cells", p->name, FINE_CELLS);
    goal_row(what, 100 * frames_rms(&f, &fine) / frame_mean(&fine), " %", "", (goal){p->to_cells, 0});
    const double to_paths = paths_error(&session, &f, &noise);
    snprintf(beside, sizeof beside, "paths' own %.2f %%", 100 * noise);
    goal_row("... to random paths", 100 * to_paths, " %", beside, (goal){p->to_paths, 0});
    frame_end(&fine), frame_end(&f);
    ex_session_end(&session);
}

/* =================================================================================================== tasks */

/* Seconds of what parallel_for_fn was given: all, the longest task of each call, and calls of 8 tasks or more. */
typedef struct task_times {
    double all, longest, many;
} task_times;

/* sps_config.parallel_for_fn: runs tasks one after another, and times each. */
static void time_tasks(void *user, int count, sps_task_fn task, void *data) {
    task_times *times = (task_times *)user;
    double longest = 0, all = 0;
    for (int i = 0; i < count; ++i) {
        const double start = ex_now(NULL);
        task(data, i, 0);
        const double took = ex_now(NULL) - start;
        all += took, longest = fmax(longest, took);
    }
    times->all += all, times->longest += longest;
    if (count >= 8) times->many += all;
}

/* How many workers can share what a frame that makes cells anew does beyond the next one, which has them cached: its
   work in calls, over that of the longest task of each. The second figure also counts what is outside of calls. */
static void tasks_rows(const pair *p) {
    task_times now, added = {0, 0, 0};
    double seconds = 0;
    const sps_config config = {
        .parallel_for_fn = time_tasks, .parallel_user = &now, .worker_count = 8, .clock_fn = ex_now};
    ex_session session = {.context = sps_create(&config, NULL)};
    frame f;
    char what[120], beside[120];
    default_frame(&f, p->scene, p->pixels);
    f.volume.revision = f.mesh.revision = 1;
    for (int i = -2; i < 2 * ALTERNATIONS; ++i) {
        const int sign = i % 2 ? -1 : 1;
        if (sign > 0) f.light.direction[0] += 1e-3;
        memset(&now, 0, sizeof now);
        const double took = render_seconds(&session, &f, &f.view);
        if (i < 0) continue;
        seconds += sign * took;
        added.all += sign * now.all, added.longest += sign * now.longest, added.many += sign * now.many;
    }
    snprintf(what, sizeof what, "%s: work of tasks / of each call's longest", p->name);
    snprintf(beside, sizeof beside, "%.0f %% in calls of 8 or more", 100 * added.many / seconds);
    goal_row(what, added.all / added.longest, "", beside, (goal){-8, 0});
    goal_row("... and work outside of calls", seconds / (seconds - added.all + added.longest), "", "", no_goal);
    sps_destroy(session.context);
    frame_end(&f);
}

/* ============================================================================== a plume, with budgets of time */

/* Frames of an orbit that had as many seconds as single scattering took: how many kept that, within a tenth, and the
   mean of their errors to the same frames without a budget. */
static void budget_rows(ex_session sessions[3], double seconds) {
    enum { FRAMES = 60, LEARNING = 3 };
    frame budgeted, full;
    double error = 0;
    int kept = 0;
    plume_frame(&budgeted, SPS_SCATTERING_AUTO);
    plume_frame(&full, SPS_SCATTERING_AUTO);
    budgeted.view.quality = SPS_QUALITY_DEFAULT, budgeted.view.budget_seconds = seconds;
    for (int i = -LEARNING; i < FRAMES; ++i) {
        camera_orbit(&budgeted.view.camera, ORBIT);
        full.view.camera = budgeted.view.camera;
        const double took = render_seconds(&sessions[1], &budgeted, &budgeted.view);
        if (i < 0) continue;
        kept += took <= 1.1 * seconds;
        render_seconds(&sessions[2], &full, &full.view);
        error += frames_rms(&budgeted, &full) / frame_mean(&full) / FRAMES;
    }
    goal_row("... in single scattering's time: frames kept", kept, " of 60", "", (goal){-57, 0});
    goal_row("... mean error", 100 * error, " %", "", (goal){2, 0});
    frame_end(&full), frame_end(&budgeted);
}

static void plume_rows(void) {
    frame frames[2];
    ex_session sessions[3];
    contender c[2];
    for (int i = 0; i < 3; ++i) ex_session_measure(&sessions[i], program, WORKERS);
    for (int i = 0; i < 2; ++i) {
        plume_frame(&frames[i], i ? SPS_SCATTERING_SINGLE : SPS_SCATTERING_AUTO);
        contender_set(&c[i], &sessions[i], &frames[i], 0);
        c[i].orbit = ORBIT;
    }
    race(c, 2, ALTERNATIONS);
    goal_ratio("plume, orbit: default / single", c[0].seconds, c[1].seconds, no_goal);
    ex_session_end(&sessions[1]);
    ex_session_measure(&sessions[1], program, WORKERS);
    budget_rows(sessions, c[1].seconds);
    for (int i = 0; i < 2; ++i) frame_end(&frames[i]);
    for (int i = 0; i < 3; ++i) ex_session_end(&sessions[i]);
}

/* ================================================================================================= shadows */

static void surface_row(void) {
    ex_grid grid;
    ex_session session;
    contender c[2];
    frame f;
    if (bonsai_load(&grid)) return;
    ex_session_measure(&session, program, WORKERS);
    bonsai_frame(&f, &grid);
    f.volume.shading = SPS_SHADING_SURFACE;
    for (int i = 0; i < 2; ++i) contender_set(&c[i], &session, &f, i);
    race(c, 2, ALTERNATIONS);
    goal_ratio("bonsai, a surface: shadowed / unshadowed", c[0].seconds, c[1].seconds, (goal){1.5, 1.35});
    frame_end(&f), ex_grid_free(&grid);
    ex_session_end(&session);
}

/* Frames of one gas that differ by their lights. The light of MADE turns before each frame, so that its table is made
   anew; from HELD on tables are cached and the camera moves. */
enum { BARE, SHARP, SOFT, MADE, HELD, TWO, THREE, FOUR, LIGHT_KINDS };

typedef struct light_trial {
    sps_tmap_settings table;
    sps_light lights[4];
    frame frame;
    ex_session session; /* of its own: a context caches the tables of its last call */
} light_trial;

static void light_trial_begin(light_trial *t, const frame *from, int kind, contender *c) {
    static const double turns[4][2] = {{0, 0}, {1.2, 0}, {0, 1.1}, {1, 0.9}}; /* of x and z */
    memset(t, 0, sizeof *t);
    ex_session_measure(&t->session, program, WORKERS);
    t->table.technique = SPS_TMAP_TABLE;
    frame_copy(&t->frame, from);
    for (int i = 0; i < 4; ++i) {
        t->lights[i] = from->light;
        t->lights[i].direction[0] += turns[i][0], t->lights[i].direction[2] += turns[i][1];
        t->lights[i].shadow_map = kind >= MADE ? &t->table : NULL;
        t->lights[i].angular_diameter = kind == SOFT ? 10 * EX_PI / 180 : 0;
    }
    t->frame.scene.lights = t->lights, t->frame.scene.light_count = kind > HELD ? 1 + kind - HELD : 1;
    contender_set(c, &t->session, &t->frame, kind == BARE);
    c->moving = kind == MADE ? &t->lights[0].direction[0] : kind > MADE ? &c->view.camera.position[0] : NULL;
}

static void light_rows(void) {
    static light_trial trials[LIGHT_KINDS];
    static const struct {
        const char *name;
        int kind, of;
        goal goal;
    } rows[] = {{"sun of 10 degrees / sharp", SOFT, SHARP, {1.6, 1.4}},
                {"shadow table made anew / unshadowed", MADE, BARE, {1.8, 1.5}},
                {"shadow table cached / unshadowed", HELD, BARE, {1.15, 0}}};
    contender c[LIGHT_KINDS];
    ex_grid grid = {0};
    frame f;
    char what[120];
    const char *name = bonsai_gas(&f, &grid);
    for (int i = 0; i < LIGHT_KINDS; ++i) light_trial_begin(&trials[i], &f, i, &c[i]);
    race(c, LIGHT_KINDS, ALTERNATIONS);
    for (int i = 0; i < 3; ++i) {
        snprintf(what, sizeof what, "%s: %s", name, rows[i].name);
        goal_ratio(what, c[rows[i].kind].seconds, c[rows[i].of].seconds, rows[i].goal);
    }
    snprintf(what, sizeof what, "%s: each further light by table / one light", name);
    goal_ratio(what, (c[FOUR].seconds - c[HELD].seconds) / 3, c[HELD].seconds, (goal){0.3, 0.2});
    for (int i = SHARP; i <= HELD; i += HELD - SHARP)
        render_seconds(&trials[i].session, &trials[i].frame, &trials[i].frame.view);
    goal_row("... rms of one table's picture to that by sheets",
             100 * frames_rms(&trials[SHARP].frame, &trials[HELD].frame) / frame_mean(&trials[SHARP].frame), " %", "",
             no_goal);
    for (int i = 0; i < LIGHT_KINDS; ++i) ex_session_end(&trials[i].session), frame_end(&trials[i].frame);
    frame_end(&f), ex_grid_free(&grid);
}

/* =================================================================================================== the table */

static void bench_default(void) {
    printf(
        "\nRatios of medians of %d alternations, with both times; %d workers and `medium` unless a row says\n"
        "otherwise. Contexts are new in each frame of the quick start, which 1 worker renders. Clouds have 128^3\n"
        "voxels and 512 x 512 pixels: made anew, the sun turns; cached, the camera moves. The plume has\n"
        "96 x 160 x 96 voxels over a ground, and 640 x 360 pixels; frames of up to 1.1 times the budget are kept.\n"
        "Errors are rms, relative to mean radiance; goals are half of what they were, or 1 %%. Tasks are those of a\n"
        "frame that makes cells, less those of the next, which has them cached: for 8 workers, timed one by one.\n\n"
        "| what | | | goal | aim | |\n|---|---|---|---|---|---|\n",
        ALTERNATIONS, WORKERS);
    for (int i = 0; i < PAIRS; ++i) pair_row(&pairs[i], 0, ALTERNATIONS);
    for (int i = 0; i < PAIRS; ++i)
        if (pairs[i].to_cells > 0) error_rows(&pairs[i]);
    for (int i = 0; i <= 4; i += 4) {
        pair_row(&pairs[i], 1, ALTERNATIONS);
        tasks_rows(&pairs[i]);
    }
    plume_rows();
    surface_row();
    light_rows();
}

/* ================================================================================== the same by other builds */

/* Waits for turns.sh to say that it is this build's turn: a line on stdin, or its end. */
static void wait_turn(void) {
    int c;
    do c = getchar();
    while (c != '\n' && c != EOF);
}

/* Some of the first rows: their ratios. */
static void bench_single(void) {
    for (int i = 0; i < 3 * ALTERNATIONS; ++i) {
        static const int some[3] = {0, 4, 7};
        wait_turn();
        pair_row(&pairs[some[i / ALTERNATIONS]], 0, 1);
    }
}

/* A row without a ratio, which turns.sh works out. */
static void seconds_row(const char *name, double seconds, goal g) {
    printf("| %s | %.4f s | |", name, seconds);
    for (int i = 0; i < 2; ++i) {
        const double bound = i ? g.aim : g.accept;
        if (bound > 0)
            printf(" <= %g |", bound);
        else
            printf(" |");
    }
    printf(" |\n");
    fflush(stdout);
}

/* In each turn, renders two frames and prints the second's seconds. Ends the frame. */
static void frame_row(const char *name, frame *f, int workers, change by, goal g) {
    ex_session session;
    contender c;
    ex_session_measure(&session, program, workers);
    contender_set(&c, &session, f, 0);
    contender_change(&c, f, by);
    for (int i = 0; i < ALTERNATIONS; ++i) {
        wait_turn();
        race(&c, 1, 1);
        seconds_row(name, c.seconds, g);
    }
    frame_end(f);
    ex_session_end(&session);
}

static void bonsai_row(const char *name, int workers, goal g) {
    ex_grid grid;
    frame f;
    if (bonsai_load(&grid)) return;
    bonsai_frame(&f, &grid);
    f.volume.shading = SPS_SHADING_SURFACE;
    frame_row(name, &f, workers, STILL, g);
    ex_grid_free(&grid);
}

static void bench_frames(void) {
    ex_grid grid;
    frame f;
    blob_frame(&f, 128, SEARCH_SIZE);
    frame_row("blob, medium, 1 worker", &f, 1, STILL, no_goal);
    if (!smoke_load(&grid)) {
        smoke_ground_frame(&f, &grid, SEARCH_SIZE);
        frame_row("smoke, medium, 1 worker", &f, 1, STILL, no_goal);
        ex_grid_free(&grid);
    }
    bonsai_row("bonsai, medium, 1 worker", 1, no_goal);
}

static void sparse_row(const char *name, change by, goal g) {
    static const int size[3] = {CLOUD, CLOUD, CLOUD};
    static const double half[3] = {1, 1, 1};
    frame f;
    gas_frame(&f, NULL, size, half, 256, 256);
    f.volume.read_fn = cloud_read, f.volume.range_fn = cloud_range, f.volume.extinction = 25;
    for (int i = 0; i < 3; ++i) f.volume.albedo[i] = 0.8f, f.light.color[i] = 3;
    f.view.scattering = SPS_SCATTERING_SINGLE;
    frame_row(name, &f, WORKERS, by, g);
}

/* Frames that are compared with an older header's. */
static void bench_before(void) {
    sps_particles particles;
    frame f;
    plume_frame(&f, SPS_SCATTERING_SINGLE);
    frame_row("plume, orbit, single", &f, WORKERS, ROUND, (goal){0.6, 0});
    plume_frame(&f, SPS_SCATTERING_MULTIPLE);
    frame_row("plume, orbit, multiple", &f, WORKERS, ROUND, (goal){0.35, 0});
    bonsai_row("bonsai, a surface", WORKERS, (goal){0.75, 0});
    full_frame(&f, 512);
    frame_row("256^3 full of gas, 1 worker", &f, 1, STILL, (goal){0.55, 0});
    particles_frame(&f, &particles, 1000000);
    frame_row("1 million particles", &f, WORKERS, STILL, (goal){0.55, 0});
    free(particles.user);
    puffs_place();
    sparse_row("sparse cloud, first frame", FRESH, (goal){0.4, 0});
    sparse_row("sparse cloud, later", STILL, (goal){0.3, 0});
    default_frame(&f, QUICK, 256);
    frame_row("quick start, 256^2, 1 worker", &f, 1, FRESH, (goal){1, 0});
    default_frame(&f, GROUND, 512);
    frame_row("colored cloud over a ground, made anew, 1 worker", &f, 1, TURN, (goal){1, 0});
}

#endif /* BENCH_DEFAULT_H */
