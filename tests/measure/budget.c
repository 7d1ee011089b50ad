/* budget: what budgets promise and what they keep, in the twelve scenes of price_scenes.h.
   budget fit     prints, rung by rung, the error and the rates from which the tables of >>budget are made, and these
   budget check   from four cameras that the tables do not know: seconds and errors, expected and measured
   A scene's name after that, or `balls` after fit: that one alone. With SPLATSHADOW_DATA=folder, where the scans lie,
   these too. */

#define SPLATSHADOW_IMPLEMENTATION
#define BENCH_PROGRAM "budget"
#include "measuring.h"
#include "particles.h"
#include "scans.h"
#include "shapes.h"
#include "bench_scenes.h"
#include "price_scenes.h"

/* A scene without settings of its own, and how its picture compares with a truth. */
typedef struct trial {
    priced *priced;
    frame shown;
    double mean; /* radiance of the truth */
} trial;

static void set_mean(trial *t) {
    const frame *truth = &t->priced->truth.frame;
    const size_t count = (size_t)truth->view.width * (size_t)truth->view.height;
    t->mean = 0;
    for (size_t i = 0; i < 4 * count; ++i)
        if (i % 4 != 3) t->mean += (double)truth->rgba[i] / (3 * (double)count);
}

/* Returns non-zero if the scene needs data that is not there. */
static int trial_begin(trial *t, const price_scene *scene, ex_session *session) {
    memset(t, 0, sizeof *t);
    t->priced = (priced *)ex_allocate(1, sizeof *t->priced);
    memset(t->priced, 0, sizeof *t->priced);
    if (scene->build(t->priced, session)) {
        free(t->priced);
        return 1;
    }
    frame *f = &t->priced->frame;
    f->view.quality = SPS_QUALITY_DEFAULT, f->view.slab_thickness = 0, f->view.tolerance = 0,
    f->view.scattering_resolution = 0;
    f->light.samples = 0;
    set_mean(t);
    frame_copy(&t->shown, f);
    return 0;
}

/* Finds the truth from where the camera is now. */
static void find_truth(trial *t, ex_session *session) {
    const frame *f = &t->priced->frame;
    const int again = f->view.scattering == SPS_SCATTERING_MULTIPLE;
    sampled_end(&t->priced->truth);
    t->priced->noise = 0;
    if (t->priced->exact)
        exact_truth(t->priced, t->priced->exact);
    else
        marched_truth(t->priced, session, again ? 13 : 9,
                      again                      ? 2
                      : t->shown.volume.transfer ? 0.25
                                                 : 0.5,
                      again ? 2400 : 0);
    set_mean(t);
    t->shown.view.camera = f->view.camera;
}

static void trial_end(trial *t) {
    frame_end(&t->shown);
    priced_end(t->priced), free(t->priced);
}

/* Whether a pixel lies within two of a point light: towards that, radiance has no bound, as irradiance along a ray
   that passes it at distance d adds up to pi / d. */
static int meets_lamp(const frame *f, int x, int y) {
    const sps_camera *camera = &f->view.camera;
    if (f->scene.light_count == 0 || f->light.kind != SPS_LIGHT_POINT) return 0;
    const ex_vec from = ex_vec_of(camera->position[0], camera->position[1], camera->position[2]);
    const ex_vec to = ex_vec_of(camera->target[0], camera->target[1], camera->target[2]);
    const ex_vec lamp = ex_vec_of(f->light.position[0], f->light.position[1], f->light.position[2]);
    const ex_vec ahead = ex_vec_unit(ex_vec_sub(to, from)), way = ex_vec_sub(lamp, from);
    const ex_vec right = ex_vec_unit(ex_vec_cross(ahead, ex_vec_of(camera->up[0], camera->up[1], camera->up[2])));
    const double scale = 0.5 * PRICE_SIZE / (tan(0.5 * camera->field_of_view) * ex_vec_dot(way, ahead));
    const double across = 0.5 * (PRICE_SIZE - 1) + scale * ex_vec_dot(way, right);
    const double down = 0.5 * (PRICE_SIZE - 1) - scale * ex_vec_dot(way, ex_vec_cross(right, ahead));
    return fabs(x - across) < 2 && fabs(y - down) < 2;
}

/* The root mean square error, relative to the mean, without what the truth itself is off by. */
static double error_of(const trial *t) {
    const sampled *truth = &t->priced->truth;
    const double noise = t->priced->noise * t->priced->noise;
    const int side = truth->frame.view.width, first = (PRICE_SIZE - (side - 1) * truth->stride - 1) / 2;
    const size_t count = 3 * (size_t)side * (size_t)side;
    double squares = 0;
    for (size_t i = 0; i < count; ++i) {
        const int pixel = (int)(i / 3), x = first + pixel % side * truth->stride,
                  y = first + pixel / side * truth->stride;
        if (meets_lamp(&t->shown, x, y)) continue;
        const double off = (double)t->shown.rgba[4 * (y * PRICE_SIZE + x) + (int)(i % 3)] -
                           (double)truth->frame.rgba[4 * (size_t)pixel + i % 3];
        squares += off * off;
    }
    return sqrt(fmax(squares / (double)count - noise, noise * sqrt(2 / (double)count))) / t->mean;
}

/* Renders, and says what was expected. Returns the seconds that it took; a negative number if it is refused. */
static double render(trial *t, ex_session *session, sps_stats_report *stats) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = t->shown.rgba;
    const sps_result result = sps_render(session->context, &t->shown.scene, &t->shown.view, &image);
    sps_get_stats(session->context, stats);
    if (result == SPS_ERROR_UNSUPPORTED) return -1;
    ex_stop_unless_ok(result, program, session);
    return stats->seconds_total;
}

/* ===================================================================================================== tables */

enum { SAMPLES_MOST = 200 };

/* What was found on each rung. */
static struct {
    double rates[SPSI_STAGE_COUNT][SPSI_PRESETS][SAMPLES_MOST];
    int count[SPSI_STAGE_COUNT][SPSI_PRESETS];
    double gas[2][SPSI_PRESETS], points[SPSI_POINT_PRESETS], cells[SPSI_CELL_PRESETS]; /* worst errors */
    double balls[SPSI_PRESETS];                                                        /* of optical depth 1 */
    double blur;                                                                       /* of half the size */
} found;

static void keep_rates(const ex_session *session, const spsi_setting *setting) {
    for (int stage = 0; stage < SPSI_STAGE_COUNT; ++stage) {
        const int grade = spsi_stage_preset((spsi_stage)stage, setting);
        const double rate = session->context->pace.rates[stage][grade];
        int *count = &found.count[stage][grade];
        if (rate > 0 && *count < SAMPLES_MOST) found.rates[stage][grade][(*count)++] = WORKERS * rate;
    }
}

/* The share of the pixels that gas covers, by its box as the library has it. */
static double covered_share(const ex_session *session) {
    const spsi_frame *f = (const spsi_frame *)session->context->buffers[SPSI_BUFFER_FRAME].data;
    return fmin(spsi_covered_pixels(f) / (PRICE_SIZE * PRICE_SIZE), 1);
}

/* Three frames of a setting: the first makes what the others hold. Prints its error, its time and its rates. */
static double fit_setting(trial *t, const char *name, const spsi_setting *setting) {
    ex_session session;
    sps_stats_report stats;
    double seconds = 0;
    ex_session_measure(&session, program, WORKERS);
    session.context->pace.only = setting;
    t->shown.view.budget_seconds = 1e9;
    for (int n = 0; n < 3 && (n == 0 || seconds < 2); ++n) {
        seconds = render(t, &session, &stats);
        if (n == 0) keep_rates(&session, setting);
    }
    keep_rates(&session, setting);
    const int gas = t->shown.scene.volume_count > 0 || t->shown.scene.particle_set_count > 0;
    const double error = error_of(t) * (gas ? sqrt(covered_share(&session)) : 1);
    printf("%-10s %d %d %d  %9.5f  %8.2f ms ", name, setting->gas, setting->points, setting->cells, error,
           1e3 * seconds);
    for (int stage = 0; stage < SPSI_STAGE_COUNT; ++stage)
        printf(" %8.3g",
               1e9 * WORKERS * session.context->pace.rates[stage][spsi_stage_preset((spsi_stage)stage, setting)]);
    printf("\n");
    ex_session_end(&session);
    return error;
}

static void fit_view(const char *name, trial *t) {
    const int again = t->shown.view.scattering == SPS_SCATTERING_MULTIPLE, soft = t->shown.light.angular_diameter > 0;
    const int looks = t->shown.volume.transfer != NULL;
    spsi_setting setting = {0, 0, 0, 0};
    for (int g = 0; g < SPSI_PRESETS && !soft && !again; ++g) {
        if (looks && g < 2) continue;
        setting.gas = g;
        found.gas[looks][g] = fmax(found.gas[looks][g], fit_setting(t, name, &setting));
    }
    setting.gas = 3;
    for (int g = 0; g < SPSI_POINT_PRESETS && soft; ++g) {
        setting.points = g;
        found.points[g] = fmax(found.points[g], fit_setting(t, name, &setting));
    }
    for (int g = 0; g < SPSI_CELL_PRESETS && again; ++g) {
        setting.cells = g;
        found.cells[g] = fmax(found.cells[g], fit_setting(t, name, &setting));
    }
}

/* What half the size, enlarged bilinearly, is off by beside the whole picture. */
static void fit_blur(const char *name, trial *t, ex_session *session) {
    const int half = PRICE_SIZE / 2;
    sps_view small = t->shown.view;
    frame enlarged;
    double squares = 0, mean = 0;
    small.budget_seconds = 0, small.quality = SPS_QUALITY_MEDIUM;
    render_seconds(session, &t->shown, &small);
    frame_copy(&enlarged, &t->shown);
    small.width = small.height = half;
    render_seconds(session, &enlarged, &small);
    for (int i = 0; i < 4 * PRICE_SIZE * PRICE_SIZE; ++i) {
        const double x = fmin(fmax(0.5 * (i / 4 % PRICE_SIZE) - 0.25, 0), half - 1);
        const double y = fmin(fmax(0.5 * (i / 4 / PRICE_SIZE) - 0.25, 0), half - 1);
        const int left = (int)fmin(x, half - 2), top = (int)fmin(y, half - 2);
        const float *at = enlarged.rgba + 4 * (top * half + left) + i % 4;
        const double upper = ex_mix((double)at[0], (double)at[4], x - left);
        const double lower = ex_mix((double)at[4 * half], (double)at[4 * half + 4], x - left);
        if (i % 4 == 3) continue;
        squares += pow(ex_mix(upper, lower, y - top) - (double)t->shown.rgba[i], 2);
        mean += (double)t->shown.rgba[i];
    }
    const double blur = sqrt(squares * 3 * PRICE_SIZE * PRICE_SIZE) / mean;
    printf("%-10s half the size: %.5f\n", name, blur);
    found.blur = fmax(found.blur, blur);
    frame_end(&enlarged);
}

/* From where the scene is seen, and from nearer and farther. */
static void fit_scene(const char *name, trial *t, ex_session *session) {
    static const double closer[] = {1, 0.75, 1.5};
    const sps_camera plain = t->priced->frame.view.camera;
    fit_blur(name, t, session);
    for (int n = 0; n < 3; ++n) {
        sps_camera *camera = &t->priced->frame.view.camera;
        *camera = plain;
        camera->ortho_height *= closer[n];
        for (int k = 0; k < 3; ++k)
            camera->position[k] = camera->target[k] + closer[n] * (camera->position[k] - camera->target[k]);
        if (n > 0) find_truth(t, session);
        fit_view(name, t);
    }
}

enum { BALLS = 150, BALLS_SIZE = 64 };

/* Balls of one size in a cube, before black, in the light of a sun or of a lamp over them. */
typedef struct balls_scene {
    sps_particle list[BALLS];
    sps_particles set;
    sps_light light;
    sps_scene scene;
    sps_view view;
} balls_scene;

static int read_balls(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

static void balls_begin(balls_scene *b, double radius, double depth, int soft, int lamp) {
    uint32_t state = 9;
    memset(b, 0, sizeof *b);
    for (int i = 0; i < BALLS; ++i) {
        for (int k = 0; k < 3; ++k) b->list[i].position[k] = (float)(2 * ex_random(&state) - 1);
        b->list[i].radius = (float)radius, b->list[i].optical_depth = (float)depth;
    }
    b->set.count = BALLS, b->set.read_fn = read_balls, b->set.user = b->list, b->set.soft = soft;
    b->light.kind = lamp ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL;
    b->light.position[1] = 3;
    b->light.direction[0] = 1, b->light.direction[1] = -1, b->light.direction[2] = -0.5;
    for (int c = 0; c < 3; ++c) b->set.albedo[c] = 0.8f, b->light.color[c] = lamp ? 40 : 5;
    b->scene.particles = &b->set, b->scene.particle_set_count = 1;
    b->scene.lights = &b->light, b->scene.light_count = 1;
    b->view.width = b->view.height = BALLS_SIZE;
    b->view.camera.position[1] = 1, b->view.camera.position[2] = 5;
    b->view.camera.up[1] = 1, b->view.camera.field_of_view = 0.5;
    b->view.scattering = SPS_SCATTERING_SINGLE;
}

/* What a rung is off by, beside steps of 0.14 radii, as if balls filled the picture. */
static double balls_error(balls_scene *b, int grade, const float *exact) {
    static float rgba[4 * BALLS_SIZE * BALLS_SIZE];
    const spsi_setting setting = {grade, 0, 0, 0};
    double squares = 0, mean = 0, shown;
    ex_session session;
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    ex_session_measure(&session, program, WORKERS);
    session.context->pace.only = &setting;
    b->view.budget_seconds = 1e9;
    ex_stop_unless_ok(sps_render(session.context, &b->scene, &b->view, &image), program, &session);
    b->view.budget_seconds = 0;
    for (int i = 0; i < 4 * BALLS_SIZE * BALLS_SIZE; ++i) {
        const double off = (double)(rgba[i] - exact[i]);
        if (i % 4 < 3) squares += off * off, mean += (double)exact[i];
    }
    shown = spsi_covered_pixels((const spsi_frame *)session.context->buffers[SPSI_BUFFER_FRAME].data) /
            (BALLS_SIZE * BALLS_SIZE);
    ex_session_end(&session);
    return sqrt(squares * 3 * BALLS_SIZE * BALLS_SIZE) / mean * sqrt(fmin(shown, 1));
}

/* Balls of 2.5 to 20 pixels' radius. */
static void fit_balls(void) {
    static const double radii[] = {0.05, 0.15, 0.4}, depths[] = {0.1, 0.3, 1};
    static float exact[4 * BALLS_SIZE * BALLS_SIZE];
    for (int n = 0; n < 36; ++n) {
        const double radius = radii[n % 3], depth = depths[n / 3 % 3];
        const int soft = n / 9 % 2, lamp = n / 18;
        sps_reference_settings settings;
        ex_session session;
        balls_scene b;
        sps_image image;
        balls_begin(&b, radius, depth, soft, lamp);
        memset(&image, 0, sizeof image);
        image.rgba = exact;
        memset(&settings, 0, sizeof settings);
        settings.step = 0.2;
        ex_session_measure(&session, program, WORKERS);
        ex_stop_unless_ok(sps_reference(session.context, &b.scene, &b.view, &settings, &image), program, &session);
        ex_session_end(&session);
        printf("balls, radius %g, depth %g, %s, %s: ", radius, depth, soft ? "soft" : "even", lamp ? "lamp" : "sun");
        for (int g = 0; g < SPSI_PRESETS; ++g) {
            const double error = balls_error(&b, g, exact);
            found.balls[g] = fmax(found.balls[g], error / pow(depth, 0.75));
            printf(" %9.5f", error);
        }
        printf("\n");
    }
}

static void print_row(const char *name, const double *worst, int count) {
    printf("%s", name);
    for (int i = 0; i < count; ++i) printf("%s%.2g", i ? ", " : " {", 2 * worst[i]);
    printf("}\n");
}

static void print_tables(void) {
    printf("\nerrors, twice the worst:\n");
    print_row("gas", found.gas[0], SPSI_PRESETS);
    print_row("classified", found.gas[1], SPSI_PRESETS);
    print_row("balls of depth 1", found.balls, SPSI_PRESETS);
    print_row("points", found.points, SPSI_POINT_PRESETS);
    print_row("cells", found.cells, SPSI_CELL_PRESETS);
    print_row("half the size", &found.blur, 1);
    printf("\nrates, the middle ones:\n");
    for (int stage = 0; stage < SPSI_STAGE_COUNT; ++stage) {
        printf("{");
        for (int g = 0; g < SPSI_PRESETS; ++g) {
            const int count = found.count[stage][g];
            const double rate = count ? ex_percentile(found.rates[stage][g], (size_t)count, 0.5) : 0;
            printf("%s%.2ge-9", g ? ", " : "", 1e9 * rate);
        }
        printf("},\n");
    }
}

/* ====================================================================================================== check */

enum { CAMERAS = 4 };

/* Turns a camera about its target, upwards and around, and brings it nearer or farther. */
static void move_camera(sps_camera *camera, int n) {
    static const double around[CAMERAS] = {0.35, -0.5, 0.8, 0.1}, upwards[CAMERAS] = {0.1, 0.25, -0.05, 0.3};
    static const double closer[CAMERAS] = {1, 0.7, 1.5, 0.85};
    const int up = camera->up[1] > 0.5 || camera->up[1] < -0.5 ? 1 : 2, right = up == 1 ? 0 : 1,
              front = up == 1 ? 2 : 0;
    double way[3];
    for (int k = 0; k < 3; ++k) way[k] = camera->position[k] - camera->target[k];
    const double length = sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
    const double height = asin(way[up] / length), turned = atan2(way[right], way[front]) + around[n];
    const double higher = fmin(height + upwards[n], 1.4);
    camera->position[up] = camera->target[up] + closer[n] * length * sin(higher);
    camera->position[right] = camera->target[right] + closer[n] * length * cos(higher) * sin(turned);
    camera->position[front] = camera->target[front] + closer[n] * length * cos(higher) * cos(turned);
    camera->ortho_height *= closer[n];
}

/* What became of promises: frames, times within 30 %, the least and the most time for what was expected, errors within
   what was expected, and the largest share of that. */
typedef struct tally {
    int frames, in_time, in_error, refused;
    double fastest, slowest, worst;
} tally;

static void tally_add(tally *t, double ratio, double share) {
    if (t->frames == 0) t->fastest = HUGE_VAL;
    t->frames += 1;
    t->in_time += ratio < 1.3 && ratio > 1 / 1.3;
    t->in_error += share <= 1;
    t->fastest = fmin(t->fastest, ratio), t->slowest = fmax(t->slowest, ratio);
    t->worst = fmax(t->worst, share);
}

static void print_setting(const sps_budget_report *b) {
    static const char *const names[] = {"", "draft", "medium", "high", "ultra"};
    printf("%s, slab %.3g, tolerance %g", names[b->quality], b->slab_thickness, (double)b->tolerance);
    if (b->samples) printf(", samples %d", b->samples);
    if (b->scattering_resolution) printf(", scattering_resolution %d", b->scattering_resolution);
    printf("%s |\n", b->is_met ? "" : "; not met");
}

/* Two frames in a context that knows nothing: the second is the promise. */
static void check_budget(trial *t, const char *name, int camera, double seconds, double error, tally *all) {
    ex_session session;
    sps_stats_report stats;
    ex_session_measure(&session, program, WORKERS);
    t->shown.view.budget_seconds = seconds, t->shown.view.budget_error = error;
    double took = render(t, &session, &stats);
    if (took >= 0) took = render(t, &session, &stats);
    const sps_budget_report *b = &stats.budget;
    printf("| %s %d | ", name, camera + 1);
    if (seconds > 0)
        printf("%.3g ms | ", 1e3 * seconds);
    else
        printf("%g %% | ", 100 * error);
    if (took < 0) {
        all->refused += 1;
        printf("| | | | | refused: %.2g %% is the least |\n", 100 * b->error);
    } else {
        const double off = error_of(t), ratio = took / b->seconds;
        tally_add(all, ratio, off / b->error);
        printf("%.3g | %.3g | %.2f | %.2g %% | %.2g %% | ", 1e3 * b->seconds, 1e3 * took, ratio, 100 * b->error,
               100 * off);
        print_setting(b);
    }
    ex_session_end(&session);
}

/* From each camera: some shares of what medium takes there, and some errors. */
static void check_scene(const char *name, trial *t, ex_session *session, tally *all) {
    static const double shares[] = {0.4, 1, 4}, errors[] = {0.1, 0.03, 0.01};
    const sps_camera plain = t->priced->frame.view.camera;
    for (int n = 0; n < CAMERAS; ++n) {
        frame *f = &t->priced->frame;
        double medium = HUGE_VAL;
        f->view.camera = plain;
        move_camera(&f->view.camera, n);
        find_truth(t, session);
        t->shown.view = f->view;
        for (int i = 0; i < 3; ++i) medium = fmin(medium, render_seconds(session, &t->shown, &t->shown.view));
        for (int i = 0; i < 3; ++i) check_budget(t, name, n, shares[i] * medium, 0, all);
        for (int i = 0; i < 3; ++i) check_budget(t, name, n, 0, errors[i], all);
    }
}

static void print_tallies(const tally *tallies) {
    tally sum = {0, 0, 0, 0, HUGE_VAL, 0, 0};
    printf(
        "\n## Kept\n\n| scene | frames | time within 30 %% | time taken / expected | error within what was expected | "
        "largest error / expected | refused |\n|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < PRICE_SCENES; ++i) {
        const tally *t = tallies + i;
        if (t->frames + t->refused == 0) continue;
        printf("| %s | %d | %d | %.2f to %.2f | %d | %.2f | %d |\n", price_scenes[i].name, t->frames, t->in_time,
               t->fastest, t->slowest, t->in_error, t->worst, t->refused);
        sum.frames += t->frames, sum.in_time += t->in_time, sum.in_error += t->in_error, sum.refused += t->refused;
        sum.fastest = fmin(sum.fastest, t->fastest), sum.slowest = fmax(sum.slowest, t->slowest);
        sum.worst = fmax(sum.worst, t->worst);
    }
    printf("| all | %d | %d | %.2f to %.2f | %d | %.2f | %d |\n", sum.frames, sum.in_time, sum.fastest, sum.slowest,
           sum.in_error, sum.worst, sum.refused);
}

int main(int argc, char **argv) {
    const int checks = argc > 1 && !strcmp(argv[1], "check");
    static tally tallies[PRICE_SCENES];
    if (argc < 2) {
        fprintf(stderr, "%s fit|check [SCENE]\n", program);
        return EX_MISTAKEN;
    }
    if (checks)
        printf("## All figures\n\n| scene, camera | budget | expected, ms | took | ratio | error expected, at most | "
               "error | setting |\n|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < PRICE_SCENES; ++i) {
        ex_session session;
        trial t;
        if (argc > 2 && strcmp(argv[2], price_scenes[i].file)) continue;
        ex_session_measure(&session, program, WORKERS);
        if (!trial_begin(&t, &price_scenes[i], &session)) {
            if (checks)
                check_scene(price_scenes[i].file, &t, &session, &tallies[i]);
            else
                fit_scene(price_scenes[i].file, &t, &session);
            trial_end(&t);
        }
        ex_session_end(&session);
        fflush(stdout);
    }
    if (!checks && (argc < 3 || !strcmp(argv[2], "balls"))) fit_balls();
    if (checks)
        print_tallies(tallies);
    else
        print_tables();
    return EX_OK;
}
