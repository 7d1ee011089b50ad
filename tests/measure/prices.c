/* prices: what accuracy costs. Twelve scenes, in each of which every knob is turned by itself, and then the one that
   pays most, again and again: error against the truth, and time beside that of the same scene at `medium`.
   prices FOLDER          prints Markdown, and writes prices.csv and pictures into the folder
   prices FOLDER SCENE    that scene alone, by its name there: slab, blob, ball, ... See price_scenes.h
   prices FOLDER quick    the scenes that have a closed form; of the knobs, quality and slab
   prices FOLDER bounds   how far apart the bounds of sps_reference are, and which errors they leave to pictures
   prices default         the README's table: six scenes in the default mode, against random paths
   prices FOLDER headline one picture at three grades, with the error and the time of each, as price.png
   With SPLATSHADOW_DATA=folder, where the scans lie, these too. */

#define BENCH_PROGRAM "prices"
#include "measuring.h"
#include "particles.h"
#include "scans.h"
#include "shapes.h"
#include "picture.h"
#include "chart.h"
#include "bench_scenes.h"
#include "price_scenes.h"
#include "price_bounds.h"

/* ================================================================================================== knobs */

/* Something that trades time for error. Values go from cheap to exact; `fits`: whether a scene has what it turns. */
typedef struct knob {
    const char *name;
    int (*fits)(const frame *f);
    void (*turn)(frame *f, int value);
    int count;
    const char *words[10];
} knob;

static int has_gas(const frame *f) { return f->scene.volume_count > 0 || f->scene.particle_set_count > 0; }
static int has_volume(const frame *f) { return f->scene.volume_count > 0; }
static int has_light(const frame *f) { return f->scene.light_count > 0; }
static int has_smooth_gas(const frame *f) { return has_volume(f) && !f->volume.transfer; }
static int has_shadows(const frame *f) { return has_light(f) && has_gas(f); }
static int is_extended(const frame *f) { return has_light(f) && f->light.angular_diameter > 0; }
static int has_maps(const frame *f) { return has_shadows(f) && !is_extended(f); }
static int is_scattering(const frame *f) { return f->view.scattering == SPS_SCATTERING_MULTIPLE; }

static void turn_quality(frame *f, int value) {
    static const sps_quality values[] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH, SPS_QUALITY_ULTRA};
    f->view.quality = values[value];
}

static void turn_slab(frame *f, int value) {
    static const double values[] = {16, 8, 4, 2, 1, 0.5, 0.25};
    f->view.slab_thickness = values[value];
}

static void turn_filling(frame *f, int value) { f->view.filling = value ? SPS_FILLING_GATHER : SPS_FILLING_SPLAT; }

static void turn_tolerance(frame *f, int value) {
    static const float values[] = {0.1f, 0.02f, 0.005f};
    f->view.tolerance = values[value];
}

static void turn_shadow_size(frame *f, int value) { f->view.shadow_resolution = 64 << value; }
static void turn_samples(frame *f, int value) { f->light.samples = 4 << (2 * value); }

static void turn_table(frame *f, int value) {
    f->light.shadow_source = SPS_SHADOW_TABLE;
    f->light.shadow_map_resolution = 64 << value;
}

static void turn_map(frame *f, int value) {
    static const sps_tmap_settings maps[] = {{.technique = SPS_TMAP_OPACITY, .components = 16},
                                             {.technique = SPS_TMAP_OPACITY, .components = 64},
                                             {.technique = SPS_TMAP_DEEP_OPACITY, .components = 16},
                                             {.technique = SPS_TMAP_FOURIER, .components = 16},
                                             {.technique = SPS_TMAP_COMPRESSED, .components = 32},
                                             {.technique = SPS_TMAP_COMPRESSED, .epsilon = 0.003f},
                                             {.technique = SPS_TMAP_DEEP}};
    f->light.shadow_map = &maps[value]; /* beside a table the library refuses it, so that no trial has both */
    f->light.shadow_map_resolution = 256;
}

static void turn_scattering(frame *f, int value) {
    static const sps_scattering values[] = {SPS_SCATTERING_SINGLE, SPS_SCATTERING_FORWARD, SPS_SCATTERING_CONVOLUTION,
                                            SPS_SCATTERING_AUTO};
    f->view.scattering = values[value];
}

static void turn_scatter_size(frame *f, int value) { f->view.scattering_resolution = 16 << value; }

static const knob knobs[] = {
    {"quality", has_gas, turn_quality, 4, {"draft", "medium", "high", "ultra"}},
    {"slab", has_gas, turn_slab, 7, {"16", "8", "4", "2", "1", "0.5", "0.25"}},
    {"shadow_resolution", has_shadows, turn_shadow_size, 5, {"64", "128", "256", "512", "1024"}},
    {"filling", has_volume, turn_filling, 2, {"splat", "gather"}},
    {"tolerance", has_smooth_gas, turn_tolerance, 3, {"0.1", "0.02", "0.005"}},
    {"samples", is_extended, turn_samples, 4, {"4", "16", "64", "256"}},
    {"table", has_maps, turn_table, 4, {"64", "128", "256", "512"}},
    {"map of 256 texels",
     has_maps,
     turn_map,
     7,
     {"opacity 16", "opacity 64", "deep opacity 16", "Fourier 16", "compressed 32", "compressed 0.003", "deep"}},
    {"scattering", is_scattering, turn_scattering, 4, {"off", "forward", "convolution", "auto"}},
    {"scattering_resolution", is_scattering, turn_scatter_size, 4, {"16", "32", "64", "128"}},
};
enum { KNOBS = sizeof knobs / sizeof *knobs, AS_IT_IS = -1 };

/* ================================================================================================= trials */

/* A setting that was rendered: the value of each knob, or AS_IT_IS. */
typedef struct trial {
    int at[KNOBS];
    /* Of the error in radiance: root mean square without the truth's own, 99th percentile of its size, and mean. */
    double rms, high, bias;
    /* Of a new context's first frame, and the least of some more, voxels and tables held; as if the machine were always
       as fast as while the first trial was rendered. */
    double first, seconds;
    double bytes; /* that the context holds then */
} trial;

enum { TRIALS = 600, FRAMES = 4, GRADES_MOST = 8 };

typedef struct price {
    const price_scene *scene;
    ex_session session, beside; /* of trials; and of the scene as it is, whose frames take turns with theirs */
    double pace;                /* seconds that one of these took while the first trial was rendered; 0: before it */
    priced *priced;
    frame shown;                        /* the setting, and its picture */
    double mean;                        /* radiance of the truth */
    trial *trials;                      /* the first one is the scene as it is, at medium */
    int trial_count;                    /* trials that were refused are left out */
    const trial *of_grade[GRADES_MOST]; /* NULL: refused */
    double end;                         /* the time from which on no path goes on */
} price;

/* The truth's own mean square error is taken out, down to the standard error of what it is here: a mean of `count`
   squares of Gaussian errors is off by sqrt(2 / count) of itself. */
static void compare(const price *p, trial *t) {
    const sampled *truth = &p->priced->truth;
    const double noise = p->priced->noise * p->priced->noise;
    const size_t side = (size_t)truth->frame.view.width, count = 3 * side * side;
    double *sizes = (double *)ex_allocate(count, sizeof *sizes), squares = 0, sum = 0;
    for (size_t i = 0; i < count; ++i) {
        const double found = (double)p->shown.rgba[4 * sampled_place(truth, i / 3) + i % 3];
        const double off = found - (double)truth->frame.rgba[4 * (i / 3) + i % 3];
        sizes[i] = fabs(off), squares += off * off, sum += off;
    }
    t->rms = sqrt(fmax(squares / (double)count - noise, noise * sqrt(2 / (double)count)));
    t->bias = sum / (double)count;
    t->high = ex_percentile(sizes, count, 0.99);
    free(sizes);
}

static void turn_all(price *p, const int at[KNOBS]) {
    float *rgba = p->shown.rgba;
    p->shown = p->priced->frame;
    p->shown.rgba = rgba;
    p->shown.scene.volumes = &p->shown.volume, p->shown.scene.meshes = &p->shown.mesh;
    p->shown.scene.lights = &p->shown.light;
    for (int k = 0; k < KNOBS; ++k)
        if (at[k] != AS_IT_IS) knobs[k].turn(&p->shown, at[k]);
}

/* Renders a trial's frames, in a context that holds nothing from others, in turns with the scene as it is: how fast the
   machine is changes from minute to minute. The least times count: what else it does only adds to them. */
static void render_trial(price *p, trial *t) {
    const double enough = 0.4;
    double spent = 0, beside = HUGE_VAL;
    sps_stats_report stats;
    ex_session_end(&p->session);
    ex_session_measure(&p->session, program, WORKERS);
    t->first = render_seconds(&p->session, &p->shown, &p->shown.view);
    t->seconds = HUGE_VAL;
    for (int frames = 0; frames < FRAMES && spent < enough; ++frames) {
        const double one = render_seconds(&p->beside, &p->priced->frame, &p->priced->frame.view);
        const double other = render_seconds(&p->session, &p->shown, &p->shown.view);
        beside = fmin(beside, one), t->seconds = fmin(t->seconds, other);
        spent += one + other;
    }
    if (!(p->pace > 0)) p->pace = beside;
    t->first *= p->pace / beside, t->seconds *= p->pace / beside;
    sps_get_stats(p->session.context, &stats);
    t->bytes = (double)stats.bytes;
}

/* The trial of a setting, rendered if it is new; NULL if the library refuses it. */
static const trial *try_setting(price *p, const int at[KNOBS]) {
    trial *t = p->trials + p->trial_count;
    sps_plan_report plan;
    for (int n = 0; n < p->trial_count; ++n)
        if (memcmp(p->trials[n].at, at, sizeof t->at) == 0) return p->trials + n;
    turn_all(p, at);
    if (p->trial_count == TRIALS) return NULL;
    if (sps_plan(p->session.context, &p->shown.scene, &p->shown.view, &plan) != SPS_OK) return NULL;
    memcpy(t->at, at, sizeof t->at);
    render_trial(p, t);
    compare(p, t);
    p->trial_count += 1;
    return t;
}

/* Every value of every knob by itself, of the first knobs. */
static void try_singles(price *p, int count) {
    for (int k = 0; k < count; ++k)
        for (int value = 0; knobs[k].fits(&p->priced->frame) && value < knobs[k].count; ++value) {
            int at[KNOBS];
            for (int i = 0; i < KNOBS; ++i) at[i] = AS_IT_IS;
            at[k] = value;
            try_setting(p, at);
        }
}

enum { TURNED = 3 };

/* What is recommended for a use: the values of some knobs by their names; of the last ones where gas is smooth alone,
   since coarse slabs and shadows ruin what is classified. */
typedef struct grade {
    const char *name;
    struct {
        const char *knob, *word;
    } turned[TURNED], smooth[TURNED];
} grade;

static const grade grades[] = {
    {"look through",
     {{"quality", "draft"}, {"samples", "4"}},
     {{"slab", "8"}, {"tolerance", "0.1"}, {"shadow_resolution", "64"}}},
    {"preview", {{"quality", "draft"}, {"samples", "4"}}, {{"slab", "4"}, {"tolerance", "0.1"}}},
    {"game asset, bake", {{"quality", "draft"}, {"samples", "16"}}, {{"tolerance", "0.02"}}},
    {"picture", {{"quality", "medium"}, {"samples", "16"}}, {{"tolerance", "0.02"}}},
    {"film still", {{"quality", "high"}, {"samples", "64"}}, {{"tolerance", "0.005"}}},
    {"measurement", {{"quality", "ultra"}, {"samples", "256"}, {"slab", "0.5"}}, {{NULL, NULL}}},
};
enum { GRADES = sizeof grades / sizeof *grades };

static void turn_by_name(const frame *f, const char *name, const char *word, int at[KNOBS]) {
    for (int k = 0; name && k < KNOBS; ++k)
        for (int value = 0; !strcmp(knobs[k].name, name) && knobs[k].fits(f) && value < knobs[k].count; ++value)
            if (!strcmp(knobs[k].words[value], word)) at[k] = value;
}

/* The setting of a grade, without the knobs that a scene has not. */
static void grade_setting(const grade *g, const frame *f, int at[KNOBS]) {
    for (int k = 0; k < KNOBS; ++k) at[k] = AS_IT_IS;
    for (int i = 0; i < TURNED; ++i) {
        turn_by_name(f, g->turned[i].knob, g->turned[i].word, at);
        if (!f->volume.transfer) turn_by_name(f, g->smooth[i].knob, g->smooth[i].word, at);
    }
}

static void print_grade(const grade *g) {
    printf("| %s |", g->name);
    for (int i = 0; i < TURNED && g->turned[i].knob; ++i)
        printf("%s %s %s", i ? "," : "", g->turned[i].knob, g->turned[i].word);
    for (int i = 0; i < TURNED && g->smooth[i].knob; ++i)
        printf("%s %s %s", i ? "," : "; smooth gas:", g->smooth[i].knob, g->smooth[i].word);
    printf(" |");
}

/* What one more turn brings: towards exact, how much the error falls for the time that it takes; towards cheap, how
   much the time falls for the error that it makes. Logarithms, so that halving counts alike anywhere; below a twentieth
   nothing counts, since times are noisy. */
static double worth(const trial *from, const trial *to, int exact) {
    const double gain = exact ? log(from->rms / to->rms) : log(from->seconds / to->seconds);
    const double loss = exact ? log(to->seconds / from->seconds) : log(to->rms / from->rms);
    return gain > 0.05 ? gain / fmax(loss, 0.02) : 0;
}

/* From the scene as it is, one turn after the other of the knob that brings most, until the scene has had its time. */
static void try_path(price *p, int exact) {
    enum { TURNS = 6, SECONDS = 15 };
    const trial *from = p->trials;
    p->end = ex_now(NULL) + SECONDS;
    for (int turn = 0; turn < TURNS; ++turn) {
        const trial *best = NULL;
        double most = 0;
        for (int k = 0; k < KNOBS; ++k)
            for (int value = 0; knobs[k].fits(&p->priced->frame) && value < knobs[k].count; ++value) {
                int at[KNOBS];
                memcpy(at, from->at, sizeof at);
                if (at[k] != AS_IT_IS && abs(value - at[k]) != 1) continue;
                if (ex_now(NULL) > p->end) return;
                at[k] = value;
                const trial *to = try_setting(p, at);
                if (to && worth(from, to, exact) > most) most = worth(from, to, exact), best = to;
            }
        if (!best) return;
        from = best;
    }
}

static int compare_seconds(const void *a, const void *b) {
    const double left = ((const trial *)a)->seconds, right = ((const trial *)b)->seconds;
    return (left > right) - (left < right);
}

/* The trials of which none is both faster and more exact, fastest first. The caller frees them. */
static trial *front_of(const price *p, int *count) {
    trial *front = (trial *)ex_allocate((size_t)p->trial_count, sizeof *front);
    double least = HUGE_VAL;
    memcpy(front, p->trials, (size_t)p->trial_count * sizeof *front);
    qsort(front, (size_t)p->trial_count, sizeof *front, compare_seconds);
    *count = 0;
    for (int i = 0; i < p->trial_count; ++i)
        if (front[i].rms < least) least = front[i].rms, front[(*count)++] = front[i];
    return front;
}

/* ================================================================================================= output */

static void setting_words(const int at[KNOBS], char *text, size_t size) {
    size_t used = 0;
    text[0] = 0;
    for (int k = 0; k < KNOBS && used < size; ++k)
        if (at[k] != AS_IT_IS)
            used += (size_t)snprintf(text + used, size - used, "%s%s %s", used ? ", " : "", knobs[k].name,
                                     knobs[k].words[at[k]]);
    if (!used) snprintf(text, size, "as it is");
}

static void write_rows(FILE *csv, const price *p) {
    for (int n = 0; n < p->trial_count; ++n) {
        const trial *t = p->trials + n;
        char words[300];
        setting_words(t->at, words, sizeof words);
        fprintf(csv, "%s,\"%s\",%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.3g,%.4g,%.0f\n", p->scene->file, words, t->rms,
                t->rms / p->mean, t->high, t->bias, p->priced->noise, t->seconds, t->seconds / p->trials->seconds,
                t->first, t->bytes);
    }
}

/* The cheapest trial that keeps within an error relative to the mean; NULL if none does. */
static const trial *cheapest(const price *p, double error) {
    const trial *best = NULL;
    for (int n = 0; n < p->trial_count; ++n)
        if (p->trials[n].rms <= error * p->mean && (!best || p->trials[n].seconds < best->seconds))
            best = p->trials + n;
    return best;
}

static const double wanted[] = {0.1, 0.03, 0.01, 0.003, 0.001, 0.0003};
enum { WANTED = sizeof wanted / sizeof *wanted };

static void print_wanted(const price *p) {
    printf("\n| wanted | error | bias | time | MB | cheapest setting |\n|---|---|---|---|---|---|\n");
    for (int i = 0; i < WANTED; ++i) {
        const trial *best = cheapest(p, wanted[i]), *next = i + 1 < WANTED ? cheapest(p, wanted[i + 1]) : NULL;
        char words[300];
        if (!best) {
            printf("| %g %% | not reached | | | | |\n", 100 * wanted[i]);
            return;
        }
        if (best == next) continue; /* the same for less error */
        setting_words(best->at, words, sizeof words);
        printf("| %g %% | %.3g %% | %+.2g %% | %.2f | %.1f | %s |\n", 100 * wanted[i], 100 * best->rms / p->mean,
               100 * best->bias / p->mean, best->seconds / p->trials->seconds, 1e-6 * best->bytes, words);
    }
}

/* The only knob that a trial turns; AS_IT_IS: none, or several. */
static int only_knob(const trial *t) {
    int turned = 0, last = AS_IT_IS;
    for (int k = 0; k < KNOBS; ++k)
        if (t->at[k] != AS_IT_IS) turned += 1, last = k;
    return turned == 1 ? last : AS_IT_IS;
}

/* The knob that pays most, turned by itself. */
static void print_first(const price *p, int exact) {
    const trial *best = NULL;
    double most = 0;
    for (int n = 1; n < p->trial_count; ++n)
        if (only_knob(p->trials + n) != AS_IT_IS && worth(p->trials, p->trials + n, exact) > most)
            most = worth(p->trials, p->trials + n, exact), best = p->trials + n;
    if (!best) {
        printf(" none |");
        return;
    }
    const int k = only_knob(best);
    printf(" %s %s: error x %.2f, time x %.2f |", knobs[k].name, knobs[k].words[best->at[k]],
           best->rms / p->trials->rms, best->seconds / p->trials->seconds);
}

/* How steep each knob is by itself: its values beside the scene as it is. */
static void print_knobs(const price *p) {
    printf("\n| knob | value | error | 99 %% of pixels within | bias | time | first frame | MB |\n"
           "|---|---|---|---|---|---|---|---|\n");
    for (int n = 0; n < p->trial_count; ++n) {
        const trial *t = p->trials + n;
        const int k = only_knob(t);
        if (k == AS_IT_IS && n > 0) continue;
        printf("| %s | %s | %.3g %% | %.3g %% | %+.2g %% | %.2f | %.2f | %.1f |\n", n ? knobs[k].name : "",
               n ? knobs[k].words[t->at[k]] : "as it is", 100 * t->rms / p->mean, 100 * t->high / p->mean,
               100 * t->bias / p->mean, t->seconds / p->trials->seconds, t->first / p->trials->seconds,
               1e-6 * t->bytes);
    }
}

/* ================================================================================================ pictures */

enum { CHART_WIDTH = 300, CHART_HEIGHT = 230, CHARTS_ACROSS = 4 };

static void draw_front(ex_canvas *canvas, int at, const price *p) {
    ex_chart chart = {at % CHARTS_ACROSS * CHART_WIDTH + 44,
                      at / CHARTS_ACROSS * CHART_HEIGHT + 26,
                      CHART_WIDTH - 60,
                      CHART_HEIGHT - 66,
                      {0, 0},
                      {0, 0},
                      p->scene->name,
                      "time",
                      0};
    int count;
    trial *front = front_of(p, &count);
    double(*points)[2] = (double(*)[2])ex_allocate((size_t)p->trial_count, sizeof *points);
    for (int n = 0; n < p->trial_count; ++n)
        ex_chart_reach(&chart, p->trials[n].seconds / p->trials->seconds, 100 * p->trials[n].rms / p->mean);
    ex_chart_widen(&chart);
    ex_chart_frame(canvas, &chart);
    for (int n = 0; n < p->trial_count; ++n) {
        const double x = ex_chart_x(&chart, p->trials[n].seconds / p->trials->seconds);
        const double y = ex_chart_y(&chart, 100 * p->trials[n].rms / p->mean);
        ex_canvas_line(canvas, x, y, x, y, 3, 0xa0a0a0);
    }
    for (int i = 0; i < count; ++i) {
        points[i][0] = front[i].seconds / p->trials->seconds;
        points[i][1] = 100 * front[i].rms / p->mean;
    }
    ex_chart_curve(canvas, &chart, (const double(*)[2])points, count, EX_MARK_DISC, 0x1060c0);
    free(front), free(points);
}

static void write_canvas(ex_canvas *canvas, const char *folder, const char *name) {
    ex_error error;
    ex_stop_if(ex_canvas_write(canvas, folder, name, &error), program, &error);
    ex_canvas_end(canvas);
}

static void draw_fronts(const price *prices, int count, const char *folder) {
    const int rows = (count + CHARTS_ACROSS - 1) / CHARTS_ACROSS;
    ex_canvas canvas = ex_canvas_begin(CHARTS_ACROSS * CHART_WIDTH, rows * CHART_HEIGHT, 1);
    for (int i = 0; i < count; ++i) draw_front(&canvas, i, prices + i);
    write_canvas(&canvas, folder, "accuracy_curves");
}

enum { ZOOM = 2, TILE = 108 }; /* pixels for each of the truth's; of a tile, with what is between */

/* The truth, enlarged, and what a grade's picture differs by from it: white and black are 5 % of the mean. No
   difference is one of the levels that a canvas is written in. */
static void draw_difference(ex_canvas *canvas, const price *p, const float *shown, int x0, int y0, const char *name) {
    const sampled *truth = &p->priced->truth;
    const int side = truth->frame.view.width;
    const double grey = (EX_CANVAS_LEVELS + 1) / 2 / (double)EX_CANVAS_LEVELS;
    for (int i = 0; i < side * ZOOM * side * ZOOM; ++i) {
        const int x = i % (side * ZOOM), y = i / (side * ZOOM), at = y / ZOOM * side + x / ZOOM;
        const size_t pixel = sampled_place(truth, (size_t)at);
        float *to = ex_canvas_pixel(canvas, x0 + x, y0 + y);
        for (int c = 0; to && c < 3; ++c) {
            const double exact = (double)truth->frame.rgba[4 * at + c];
            const double off = shown ? ((double)shown[4 * pixel + (size_t)c] - exact) / (0.05 * p->mean) : 0;
            to[c] = (float)(shown ? ex_linear_of(fmin(fmax(grey + 0.5 * off, 0), 1)) : fmin(0.4 * exact / p->mean, 1));
        }
    }
    ex_canvas_text(canvas, x0, y0 + side * ZOOM + 3, name, 0x000000);
}

/* A row of pictures: the truth, and the differences of each grade. */
static void draw_row(ex_canvas *canvas, price *p, int row) {
    int at[KNOBS];
    draw_difference(canvas, p, NULL, 0, row * (TILE + 12), p->scene->file);
    for (int g = 0; g < GRADES; ++g) {
        if (!p->of_grade[g]) continue;
        grade_setting(grades + g, &p->priced->frame, at);
        turn_all(p, at);
        render_seconds(&p->session, &p->shown, &p->shown.view);
        draw_difference(canvas, p, p->shown.rgba, (g + 1) * TILE, row * (TILE + 12), grades[g].name);
    }
}

/* The picture of a trial from x0 on, and its error and time beneath it. */
static void draw_shown(ex_canvas *canvas, const price *p, const trial *t, int x0) {
    char caption[64];
    for (int i = 0; i < PRICE_SIZE * PRICE_SIZE; ++i)
        memcpy(ex_canvas_pixel(canvas, x0 + i % PRICE_SIZE, i / PRICE_SIZE), p->shown.rgba + 4 * i, 3 * sizeof(float));
    snprintf(caption, sizeof caption, "%.2g percent off, %.0f ms", 100 * t->rms / p->mean, 1e3 * t->seconds);
    ex_canvas_text(canvas, x0 + 4, PRICE_SIZE + 3, caption, 0x000000);
}

/* ================================================================================================== scenes */

/* Returns non-zero if the scene needs data that is not there. */
static int price_begin(price *p, const price_scene *scene) {
    memset(p, 0, sizeof *p);
    p->scene = scene, p->priced = (priced *)ex_allocate(1, sizeof *p->priced);
    memset(p->priced, 0, sizeof *p->priced);
    ex_session_measure(&p->session, program, WORKERS);
    if (scene->build(p->priced, &p->session)) {
        free(p->priced), ex_session_end(&p->session);
        return 1;
    }
    const frame *truth = &p->priced->truth.frame;
    const size_t count = (size_t)truth->view.width * (size_t)truth->view.height;
    for (size_t i = 0; i < 4 * count; ++i)
        if (i % 4 != 3) p->mean += (double)truth->rgba[i] / (3 * (double)count);
    frame_copy(&p->shown, &p->priced->frame);
    ex_session_measure(&p->beside, program, WORKERS);
    render_seconds(&p->beside, &p->priced->frame, &p->priced->frame.view);
    p->trials = (trial *)ex_allocate(TRIALS, sizeof *p->trials);
    return 0;
}

static void price_end(price *p) {
    free(p->trials), frame_end(&p->shown);
    priced_end(p->priced), free(p->priced);
}

static void price_end_sessions(price *p) { ex_session_end(&p->session), ex_session_end(&p->beside); }

static void measure(price *p, int quick) {
    int at[KNOBS];
    for (int k = 0; k < KNOBS; ++k) at[k] = AS_IT_IS;
    try_setting(p, at);
    p->trials->seconds = p->pace;
    for (int g = 0; g < GRADES; ++g) {
        grade_setting(grades + g, &p->priced->frame, at);
        p->of_grade[g] = try_setting(p, at);
    }
    try_singles(p, quick ? 2 : KNOBS);
    for (int exact = 0; !quick && exact < 2; ++exact) try_path(p, exact);
}

/* ==================================================================================================== page */

/* Of all scenes: the middle one, and the worst. */
static void print_spread(double *values, int count, const char *unit) {
    printf(" %.3g%s | %.3g%s |", ex_percentile(values, (size_t)count, 0.5), unit,
           ex_percentile(values, (size_t)count, 1), unit);
}

static void print_grades(const price *prices, int count) {
    printf(
        "\n| for | settings | error, middle scene | worst | bias, worst | time, middle scene | worst | first frame | "
        "worst |\n|---|---|---|---|---|---|---|---|---|\n");
    for (int g = 0; g < GRADES; ++g) {
        double errors[PRICE_SCENES], biases[PRICE_SCENES], times[PRICE_SCENES], firsts[PRICE_SCENES];
        int found = 0;
        for (int i = 0; i < count; ++i) {
            const trial *t = prices[i].of_grade[g];
            if (!t) continue;
            errors[found] = 100 * t->rms / prices[i].mean, biases[found] = 100 * fabs(t->bias) / prices[i].mean;
            times[found] = t->seconds / prices[i].trials->seconds;
            firsts[found++] = t->first / prices[i].trials->seconds;
        }
        if (!found) continue;
        print_grade(grades + g);
        print_spread(errors, found, " %");
        printf(" %.2g %% |", ex_percentile(biases, (size_t)found, 1));
        print_spread(times, found, "");
        print_spread(firsts, found, "");
        printf("\n");
    }
}

/* By which share of its time the scene as it is differs most from itself, named as the quality that it has. */
static double times_spread(const price *prices, int count) {
    double most = 0;
    for (int i = 0; i < count; ++i)
        for (int n = 1; n < prices[i].trial_count; ++n) {
            int at[KNOBS];
            for (int k = 0; k < KNOBS; ++k) at[k] = AS_IT_IS;
            turn_by_name(&prices[i].priced->frame, "quality", "medium", at);
            if (memcmp(prices[i].trials[n].at, at, sizeof at) == 0)
                most = fmax(most, fabs(prices[i].trials[n].seconds / prices[i].trials->seconds - 1));
        }
    return most;
}

/* The time of the cheapest setting for each error, scene by scene, and what to turn first. */
static void print_times(const price *prices, int count) {
    printf("\n| scene | medium | its error | 10 %% | 3 %% | 1 %% | 0.3 %% | 0.1 %% | 0.03 %% | first for less error | "
           "first for less time |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < count; ++i) {
        const price *p = prices + i;
        printf("| %s | %.3g ms | %.2g %% |", p->scene->name, 1e3 * p->trials->seconds, 100 * p->trials->rms / p->mean);
        for (int k = 0; k < WANTED; ++k) {
            const trial *best = cheapest(p, wanted[k]);
            if (best)
                printf(" %.2f |", best->seconds / p->trials->seconds);
            else
                printf(" |");
        }
        print_first(p, 1), print_first(p, 0);
        printf("\n");
    }
}

static void print_figures(const price *p) {
    printf("\n### %s\n\nTruth: %s", p->scene->name, p->scene->truth);
    if (p->priced->noise > 0)
        printf(", off by %.2g %% itself, which is taken out of the errors by squares",
               100 * p->priced->noise / p->mean);
    printf(". At `medium`: %.3g %% in %.1f ms.\n", 100 * p->trials->rms / p->mean, 1e3 * p->trials->seconds);
    print_wanted(p);
    print_knobs(p);
}

static void print_page(const price *prices, int count) {
    printf("## Error and time by use\n\n%d scenes, %d x %d pixels, %d workers. Errors are rms in radiance, ", count,
           PRICE_SIZE, PRICE_SIZE, WORKERS);
    printf("relative to the mean of the\nreference. Times are relative to the scene at `medium` with cached voxels and "
           "shadow tables; the first frame is of a\nnew context, which makes them. Noise: two measurements of `medium` "
           "in each scene differ by up to %.0f %%.\n",
           100 * times_spread(prices, count));
    print_grades(prices, count);
    printf("\n## The cheapest setting for an error\n\nRelative time of the cheapest setting found. `prices.csv` has "
           "the settings.\n");
    print_times(prices, count);
    printf("\n![Error in percent against time](accuracy_curves.png)\n\nError in percent against time. Grey: all "
           "settings; blue: the Pareto front.\n\n"
           "![Differences](accuracy_differences.png)\n\nLeft: the reference. Others: differences from it in grey; "
           "white is 5 %% of the mean too bright, black 5 %% too dark.\n");
    printf("\n## All figures\n");
    for (int i = 0; i < count; ++i) print_figures(prices + i);
}

/* What bounds cost in a scene that has any, and what they say of its pictures at medium, high and ultra. */
static void print_bounds(price *p) {
    bounded b;
    bounded_begin(&b, p->priced);
    if (!bounded_measure(&b, &p->session)) {
        printf("| %s | %d | %.2g %% | %.2g %% | %.1f ms | %.1g %% |", p->scene->name, (int)(bounded_count(&b) / 3),
               100 * b.width / p->mean, 100 * b.high / p->mean, 3e3 * b.seconds / (double)bounded_count(&b),
               100 * bounded_outside(&b, &p->priced->truth) / p->mean);
        for (int quality = 1; quality <= 3; ++quality) { /* as turn_quality counts */
            double error[2];
            turn_quality(&p->shown, quality);
            render_seconds(&p->session, &p->shown, &p->shown.view);
            bounded_error(&b, p->shown.rgba, error);
            printf(" %.2g to %.2g %% |", 100 * error[0] / p->mean, 100 * error[1] / p->mean);
        }
        printf("\n");
    }
    bounded_end(&b);
}

static void print_all_bounds(price *prices, int count) {
    printf("\n## Bounds\n\n"
           "`sps_reference` with `lower` and `upper` brackets the exact radiance. The table shows the width of the "
           "bracket, on average\nand at the 99th percentile, relative to the mean, and the time per pixel, with steps of "
           "%g voxels. \"Truth outside by\" is\nthe largest distance of the tables' reference from the bracket: its own "
           "error. For each quality, the exact error lies\nbetween two figures: the rms distances from the bracket and "
           "from its farther bound. Area lights, multiple scattering and\nnormals have no bounds. "
           "`build/measure/prices FOLDER bounds` prints this table alone.\n\n"
           "| scene | pixels | apart | 99 %% within | time per pixel | truth outside by | error of `medium` | "
           "`high` | `ultra` |\n|---|---|---|---|---|---|---|---|---|\n",
           BOUND_STEP);
    for (int i = 0; i < count; ++i) {
        int at[KNOBS];
        for (int k = 0; k < KNOBS; ++k) at[k] = AS_IT_IS;
        turn_all(prices + i, at);
        ex_session_measure(&prices[i].session, program, WORKERS);
        print_bounds(prices + i);
        ex_session_end(&prices[i].session);
    }
}

/* One scene at three grades. */
static void headline(price *p, const char *folder) {
    static const char *const names[] = {"preview", "picture", "film still"};
    ex_canvas canvas = ex_canvas_begin(3 * PRICE_SIZE + 16, PRICE_SIZE + 14, 1);
    printf("| for | settings | error | time |\n|---|---|---|---|\n");
    for (int g = 0, n = 0; g < GRADES && n < 3; ++g) {
        int at[KNOBS];
        if (strcmp(grades[g].name, names[n]) != 0) continue;
        grade_setting(grades + g, &p->priced->frame, at);
        const trial *t = try_setting(p, at);
        if (!t) continue;
        draw_shown(&canvas, p, t, n++ * (PRICE_SIZE + 8));
        print_grade(grades + g);
        printf(" %.2g %% | %.0f ms |\n", 100 * t->rms / p->mean, 1e3 * t->seconds);
    }
    write_canvas(&canvas, folder, "price");
}

/* ---- the default mode ---- */

/* The median time of a scene's frames once all is cached; *first is that of the first one, in a new context. */
static double time_frames(frame *f, double *first) {
    enum { ROUNDS = 5 };
    double seconds[ROUNDS];
    ex_session session;
    ex_session_measure(&session, program, WORKERS);
    *first = render_seconds(&session, f, &f->view);
    for (int i = 0; i < ROUNDS; ++i) seconds[i] = render_seconds(&session, f, &f->view);
    ex_session_end(&session);
    return ex_percentile(seconds, ROUNDS, 0.5);
}

/* The mean of red, green and blue of the pixels that a truth has; of the truth itself if f is NULL. */
static double sampled_mean(const sampled *t, const frame *f) {
    const int side = t->frame.view.width, first = f ? (f->view.width - (side - 1) * t->stride - 1) / 2 : 0;
    double sum = 0;
    for (int i = 0; i < side * side; ++i) {
        const int x = first + i % side * t->stride, y = first + i / side * t->stride;
        const float *pixel = f ? f->rgba + 4 * (y * f->view.width + x) : t->frame.rgba + 4 * i;
        for (int c = 0; c < 3; ++c) sum += (double)pixel[c];
    }
    return sum / (3.0 * side * side);
}

/* A row of the README's table: a view that sets nothing, beside random paths and single scattering. */
static void print_default(const price_scene *scene) {
    enum { STRIDE = 9, PATHS = 1200 };
    ex_session session;
    double first, single_first;
    priced *p = (priced *)ex_allocate(1, sizeof *p);
    memset(p, 0, sizeof *p);
    ex_session_measure(&session, program, WORKERS);
    if (!scene->build(p, &session)) {
        const int width = p->frame.view.width, height = p->frame.view.height;
        const sps_camera camera = p->frame.view.camera;
        memset(&p->frame.view, 0, sizeof p->frame.view);
        p->frame.view.width = width, p->frame.view.height = height, p->frame.view.camera = camera;
        sampled_end(&p->truth);
        marched_truth(p, &session, STRIDE, p->frame.volume.transfer ? 0.25 : 0.5, PATHS);
        const double truth = sampled_mean(&p->truth, NULL), seconds = time_frames(&p->frame, &first);
        const double error = sampled_mean(&p->truth, &p->frame) / truth - 1;
        p->frame.view.scattering = SPS_SCATTERING_SINGLE;
        const double single = time_frames(&p->frame, &single_first);
        printf("| %s | %.0f ms | %.0f ms | %.0f ms | %+.2g %% ± %.1g %% |\n", scene->name, 1e3 * first, 1e3 * seconds,
               1e3 * single, 100 * error, 100 * p->noise / truth / p->truth.frame.view.width);
        priced_end(p);
    }
    ex_session_end(&session);
    free(p);
}

static int print_defaults(void) {
    printf("| scene | first frame | next frames | single scattering | brightness error |\n"
           "|---|---|---|---|---|\n");
    for (int i = 0; i < PRICE_SCENES; ++i)
        if (price_scenes[i].is_asset) print_default(price_scenes + i);
    return EX_OK;
}

static FILE *open_table(const char *folder) {
    char path[4096];
    snprintf(path, sizeof path, "%s/prices.csv", folder);
    FILE *csv = fopen(path, "w");
    if (csv)
        fprintf(csv, "scene,setting,rms,rms_of_mean,p99,bias,noise,seconds,time,first_frame,bytes\n");
    else
        fprintf(stderr, "%s: cannot write %s\n", program, path);
    return csv;
}

static const price_scene *find_scene(const char *name) {
    for (int i = 0; i < PRICE_SCENES; ++i)
        if (!strcmp(price_scenes[i].file, name)) return price_scenes + i;
    return NULL;
}

static int is_chosen(const price_scene *scene, const char *name) {
    return !name || !strcmp(name, "bounds") || !strcmp(scene->file, name) ||
           (!strcmp(name, "quick") && !strcmp(scene->truth, "closed form"));
}

int main(int argc, char **argv) {
    static price prices[PRICE_SCENES];
    const char *name = argc > 2 ? argv[2] : NULL;
    int count = 0, assets = 0;
    if (argc < 2) {
        fprintf(stderr, "%s FOLDER [SCENE]\n", program);
        return EX_MISTAKEN;
    }
    if (!strcmp(argv[1], "default")) return print_defaults();
    if (name && !strcmp(name, "headline")) {
        if (price_begin(prices, find_scene("smoke")) && price_begin(prices, find_scene("mixed"))) return EX_FAILED;
        headline(prices, argv[1]);
        price_end_sessions(prices);
        price_end(prices);
        return EX_OK;
    }
    FILE *csv = open_table(argv[1]);
    if (!csv) return EX_FAILED;
    ex_canvas differences = ex_canvas_begin((GRADES + 1) * TILE, PRICE_ASSETS * (TILE + 12), 1);
    for (int i = 0; i < PRICE_SCENES; ++i) {
        if (!is_chosen(price_scenes + i, name) || price_begin(prices + count, price_scenes + i)) continue;
        price *p = prices + count++;
        if (name && !strcmp(name, "bounds")) {
            price_end_sessions(p);
            continue;
        }
        measure(p, name && !strcmp(name, "quick"));
        write_rows(csv, p);
        if (p->scene->is_asset) draw_row(&differences, p, assets++);
        price_end_sessions(p);
    }
    fclose(csv);
    if (name && !strcmp(name, "bounds")) {
        print_all_bounds(prices, count);
        return EX_OK;
    }
    draw_fronts(prices, count, argv[1]);
    write_canvas(&differences, argv[1], "accuracy_differences");
    print_page(prices, count);
    if (!name) print_all_bounds(prices, count);
    for (int i = 0; i < count; ++i) price_end(prices + i);
    return EX_OK;
}
