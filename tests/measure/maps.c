/* maps: transmittance maps against each other, in the setting of Giulietti's thesis (DigiPen 2013, chapter 4): 2500
   particles of smoke, one spot light, a map of 512 x 512, a picture of 1024 x 768, 6, 8, 16 and 24 numbers a texel.
   There the truth was each technique's own run with 24; here it is the exact deep map.
   maps formats             the table of formats alone
   maps CHARTS PICTURES     Markdown to stdout; curves and a sheet of differences into the folder CHARTS, all pictures
                            into the folder PICTURES; both folders must be there */

#include "measuring.h"
#include "picture.h"
#include "puff.h"
#include "scene.h"
#include "shapes.h"
#include "chart.h"
#include "map_formats.h"

static const char program[] = "maps";

/* =============================================================================================== measuring */

/* Every `stride`th number of two lists. */
static spread spread_of(const float *values, const float *exact, size_t count, size_t stride) {
    double *differences = (double *)ex_allocate(count, sizeof(double)), sum = 0;
    spread result = {0, 0, 0};
    for (size_t i = 0; i < count; ++i) {
        differences[i] = fabs((double)values[i * stride] - (double)exact[i * stride]);
        sum += differences[i] * differences[i];
        result.largest = fmax(result.largest, differences[i]);
    }
    result.rms = sqrt(sum / (double)count);
    result.high = ex_percentile(differences, count, 0.99);
    free(differences);
    return result;
}

static sps_tmap *build_map(const ex_session *session, const set_up *s, const sps_tmap_settings *settings,
                           double *seconds) {
    const double start = ex_now(NULL);
    sps_tmap *map = ex_tmap_build(session, program, &s->light_view, settings, &s->occluders);
    *seconds = ex_now(NULL) - start;
    return map;
}

/* Transmittance at all points. */
static void query_map(ex_session *session, const set_up *s, const sps_tmap *map, float *out, double *seconds) {
    const double start = ex_now(NULL);
    ex_tmap_query(session, map, POINTS, s->points, NULL, out);
    *seconds = ex_now(NULL) - start;
}

/* Transmittances of gas with the light turned about the scene by so many steps. */
static void query_turned(ex_session *session, set_up *s, const sps_tmap_settings *settings, int steps, float *out) {
    const sps_camera camera = s->light_view.camera;
    double seconds;
    turn_light(s, steps);
    sps_tmap *map = build_map(session, s, settings, &seconds);
    ex_tmap_query(session, map, GAS_POINTS, s->points, NULL, out);
    sps_tmap_destroy(map);
    s->light_view.camera = camera;
}

/* The picture; settings NULL: shadows by slabs, without a map. The map's range of depths is left to the library. */
static void render(const ex_session *session, set_up *s, const sps_tmap_settings *settings, float *rgba,
                   double *seconds) {
    sps_tmap_settings own;
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    if (settings) own = *settings, own.near_depth = own.far_depth = 0;
    s->light.shadow_map = settings ? &own : NULL;
    s->light.shadow_map_resolution = settings ? s->map_size : 0;
    const double start = ex_now(NULL);
    ex_stop_unless_ok(sps_render(session->context, &s->scene, &s->view, &image), program, session);
    *seconds = ex_now(NULL) - start;
    s->light.shadow_map = NULL;
}

/* ================================================================================================ controls */

/* Layouts that others have and the library does not, made from the exact map's lists of even intervals. */

/* A texel's list: u0, u1, optical depth and 0 each, in order of u0. */
typedef struct column {
    const float *list;
    int count;
} column;

static column column_of(const sps_tmap *map, size_t texel) {
    const uint32_t *starts = sps_tmap_starts(map) + texel;
    const column c = {sps_tmap_texels(map) + 4 * (size_t)starts[0], (int)(starts[1] - starts[0])};
    return c;
}

static double depth_before(const column *c, double u) {
    double sum = 0;
    for (int i = 0; i < c->count && (double)c->list[4 * i] <= u; ++i) {
        const double u0 = (double)c->list[4 * i], u1 = (double)c->list[4 * i + 1];
        sum += (double)c->list[4 * i + 2] * (u < u1 ? (u - u0) / (u1 - u0) : 1);
    }
    return sum;
}

/* Where the last interval ends, and how much of the way there is gas. */
static double column_end(const column *c, double *occupied) {
    double end = 0;
    *occupied = 0;
    for (int i = 0; i < c->count; ++i) {
        const double u0 = (double)c->list[4 * i], u1 = (double)c->list[4 * i + 1];
        *occupied += fmax(u1 - fmax(u0, end), 0);
        end = fmax(end, u1);
    }
    return end;
}

/* n numbers a texel: u of its first occluder, and n - 1 layers from there on over a thickness that is the same for all
   texels, straight lines between [Yuksel & Keyser 2008; Giulietti 2013]; or, where n is 0, the engines' Beer map: the
   mean extinction over what is occupied, from the first occluder on, up to all of it. */
static double control_depth(const column *c, int n, double thickness, double u) {
    const double first = c->count > 0 ? (double)c->list[0] : 0, at = fmax(u - first, 0);
    double occupied;
    if (c->count == 0) return 0;
    column_end(c, &occupied);
    if (n == 0) return fmin(at / fmax(occupied, 1e-6), 1) * depth_before(c, 2);
    const double layer = fmin(floor(at / thickness * (n - 1)), n - 1), step = thickness / (n - 1);
    const double low = depth_before(c, first + layer * step), high = depth_before(c, first + (layer + 1) * step);
    return layer > 0 || at > 0 ? (layer > 0 ? low : 0) + ((high - (layer > 0 ? low : 0)) * (at / step - layer)) : 0;
}

/* Transmittance of gas at a point: the four texels about it. n < 0: the truth. */
static double control_through(const set_up *s, const sps_tmap *map, const double at[4], int n, double thickness) {
    const int x = (int)floor(at[0]), y = (int)floor(at[1]), last = s->map_size - 1;
    double sum = 0;
    for (int i = 0; i < 4; ++i) {
        const int column_x = (int)fmin(fmax(x + i % 2, 0), last), row = (int)fmin(fmax(y + i / 2, 0), last);
        const column c = column_of(map, (size_t)row * (size_t)s->map_size + (size_t)column_x);
        const double weight = (1 - fabs(at[0] - x - i % 2)) * (1 - fabs(at[1] - y - i / 2));
        sum += weight * (n < 0 ? depth_before(&c, at[3]) : control_depth(&c, n, thickness, at[3]));
    }
    return exp(-sum);
}

/* Texel x and y, distance and u of a point. */
static void place_of(const sps_tmap_settings *range, const double matrix[16], const double *point, double at[4]) {
    double q[4];
    for (int i = 0; i < 4; ++i)
        q[i] =
            matrix[4 * i] * point[0] + matrix[4 * i + 1] * point[1] + matrix[4 * i + 2] * point[2] + matrix[4 * i + 3];
    at[0] = q[0] / q[3], at[1] = q[1] / q[3], at[2] = q[2];
    at[3] = fmin(fmax((q[2] - range->near_depth) / (range->far_depth - range->near_depth), 0), 1);
}

/* Fills in what the set-up knows of the exact map's lists and of controls. Surfaces shade all alike, so they leave the
   same share of each error. */
static void measure_controls(set_up *s, const sps_tmap *map) {
    const size_t texels = (size_t)s->map_size * (size_t)s->map_size;
    double matrix[16], thickness = 0, unused;
    size_t covered = 0;
    sps_tmap_get_projection(map, 0, matrix, NULL);
    for (size_t i = 0; i < texels; ++i) {
        const column c = column_of(map, i);
        covered += c.count > 0;
        if (c.count > 0) thickness = fmax(thickness, column_end(&c, &unused) - (double)c.list[0]);
    }
    s->covered = (double)covered / (double)texels;
    for (int i = 0; i < GAS_POINTS; ++i) {
        double at[4], own;
        place_of(&s->range, matrix, s->points + 3 * i, at);
        const double truth = control_through(s, map, at, -1, 0), lit = fmin((double)s->exact[i] / truth, 1);
        own = control_through(s, map, at, counts[COUNTS - 1], thickness);
        for (int which = 0; which < COUNTS; ++which) {
            const double through = control_through(s, map, at, counts[which], thickness);
            s->thesis_rms[which] += pow(lit * (through - truth), 2) / GAS_POINTS;
            s->thesis_own[which] += pow(lit * (through - own), 2) / GAS_POINTS;
        }
        s->beer_rms += pow(lit * (control_through(s, map, at, 0, 0) - truth), 2) / GAS_POINTS;
    }
    for (int which = 0; which < COUNTS; ++which)
        s->thesis_rms[which] = sqrt(s->thesis_rms[which]), s->thesis_own[which] = sqrt(s->thesis_own[which]);
    s->beer_rms = sqrt(s->beer_rms);
}

/* Points, and transmittances by the exact map there. */
static void make_exact_values(ex_session *session, set_up *s) {
    double seconds;
    scatter_points(s);
    sps_tmap *map = build_map(session, s, &s->range, &seconds);
    s->exact = (float *)ex_allocate(POINTS, sizeof(float));
    query_map(session, s, map, s->exact, &seconds);
    sps_tmap_destroy(map);
}

/* Transmittances by the exact map, the controls made from its lists, and the picture made with it. */
static void make_exact(ex_session *session, set_up *s, float *slabs_rgba) {
    double build, query, mapped;
    sps_tmap *map = build_map(session, s, &s->range, &build);
    s->exact = (float *)ex_allocate(POINTS, sizeof(float));
    s->exact_rgba = (float *)ex_allocate((size_t)WIDTH * HEIGHT, 4 * sizeof(float));
    query_map(session, s, map, s->exact, &query);
    for (int i = 0; i < POINTS; ++i) s->shade += i < GAS_POINTS ? (double)s->exact[i] / GAS_POINTS : 0;
    s->exact_bytes = ex_tmap_bytes(map);
    s->exact_turned = (float *)ex_allocate(GAS_POINTS, 2 * sizeof(float));
    for (int k = 0; k < 2; ++k)
        query_turned(session, s, &s->range, 2 * k - 1, s->exact_turned + (size_t)k * GAS_POINTS);
    measure_controls(s, map);
    sps_tmap_destroy(map);
    render(session, s, &s->range, s->exact_rgba, &mapped);
    render(session, s, NULL, slabs_rgba, &s->slabs_seconds);
    s->slabs_apart = spread_of(slabs_rgba, s->exact_rgba, (size_t)WIDTH * HEIGHT, 4);
}

static void print_exact(const set_up *s) {
    printf("\n## %c%s: %s\n\n", s->name[0] - 'a' + 'A', s->name + 1, s->words);
    printf(
        "The exact map takes %.1f MB; gas covers %.0f %% of the map's texels; mean transmittance at the points in the "
        "gas is %.3f.\nWithout a map, with shadows by slabs, the picture differs by %.5f rms, %.5f at the 99th "
        "percentile, %.3f at most.\n\n",
        1e-6 * s->exact_bytes, 100 * s->covered, s->shade, s->slabs_apart.rms, s->slabs_apart.high,
        s->slabs_apart.largest);
}

/* Rms of the error's second difference as the light turns by two steps; `values`: in the middle. */
static double flicker_of(ex_session *session, set_up *s, const sps_tmap_settings *settings, const float *values) {
    float *turned = (float *)ex_allocate(GAS_POINTS, 2 * sizeof(float));
    double sum = 0;
    for (int k = 0; k < 2; ++k) query_turned(session, s, settings, 2 * k - 1, turned + (size_t)k * GAS_POINTS);
    for (int i = 0; i < GAS_POINTS; ++i) {
        double bend = -2 * ((double)values[i] - (double)s->exact[i]);
        for (int k = 0; k < 2; ++k)
            bend += (double)turned[k * GAS_POINTS + i] - (double)s->exact_turned[k * GAS_POINTS + i];
        sum += bend * bend;
    }
    free(turned);
    return sqrt(sum / GAS_POINTS);
}

/* Fills in all but the render time. `own` holds the transmittances of this technique's largest map, which comes first.
   The picture is left out where rgba is NULL. */
static void measure(ex_session *session, set_up *s, trial *t, float *values, float *rgba, float *own) {
    const int is_largest = t == s->trials.list + s->trials.count - 1 || t[1].kind != t->kind;
    sps_tmap *map = build_map(session, s, &t->settings, &t->build);
    t->bytes = ex_tmap_bytes(map);
    query_map(session, s, map, values, &t->query);
    sps_tmap_destroy(map);
    if (is_largest) memcpy(own, values, GAS_POINTS * sizeof(float));
    t->flicker = flicker_of(session, s, &t->settings, values);
    t->own = spread_of(values, own, GAS_POINTS, 1).rms;
    t->gas = spread_of(values, s->exact, GAS_POINTS, 1);
    t->ground = spread_of(values + GAS_POINTS, s->exact + GAS_POINTS, GROUND_POINTS, 1);
    if (!rgba) return;
    render(session, s, &t->settings, rgba, &t->render);
    t->picture = spread_of(rgba, s->exact_rgba, (size_t)WIDTH * HEIGHT, 4);
}

/* Times once more, taken in turns, so that whatever else the machine does falls on each alike: the least counts, since
   nothing makes a program faster than it is. What takes long has been timed well enough by being run once. */
static void race(ex_session *session, set_up *s, float *values, float *rgba) {
    for (int turn = 0; turn < TURNS; ++turn) {
        double build, query, whole;
        render(session, s, NULL, rgba, &whole);
        s->slabs_seconds = fmin(s->slabs_seconds, whole);
        for (int i = 0; i < s->trials.count; ++i) {
            trial *t = &s->trials.list[i];
            if (t->build + t->query > LONG || !(t->render > 0)) continue;
            sps_tmap *map = build_map(session, s, &t->settings, &build);
            query_map(session, s, map, values, &query);
            sps_tmap_destroy(map);
            render(session, s, &t->settings, rgba, &whole);
            t->build = fmin(t->build, build), t->query = fmin(t->query, query), t->render = fmin(t->render, whole);
        }
    }
}

/* ================================================================================================ pictures */

/* Differences of what a screen would be sent, four times enlarged. */
static void enhance(const float *rgba, const float *exact, float *out) {
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 4; ++i) {
        const int apart = abs((int)ex_srgb_code(rgba[i]) - (int)ex_srgb_code(exact[i]));
        out[i] = (float)ex_linear_of(fmin(4 * apart / 255.0, 1));
    }
}

static void write_picture(const char *folder, const char *name, const float *rgba, int width, int height) {
    char path[4096];
    ex_error error;
    snprintf(path, sizeof path, "%s/%s.png", folder, name);
    for (char *at = path + strlen(folder) + 1; *at; ++at)
        if (*at == ' ' || *at == ',') *at = '_';
    ex_stop_if(ex_write_png(path, rgba, width, height, &error), program, &error);
}

enum { SHEET_COLUMNS = 4, SHEET_SHRINK = 4, CROP_X = 180, CROP_Y = 90, CROP_WIDTH = 600, CROP_HEIGHT = 520 };

/* A chart, or the sheet of pictures, for the document. */
static void write_chart(const char *folder, const char *name, ex_canvas *canvas) {
    ex_error error;
    ex_stop_if(ex_canvas_write(canvas, folder, name, &error), program, &error);
}

/* Puts the part of a picture that holds smoke and shadow at one of the sheet's places. */
static void add_to_sheet(ex_canvas *sheet, int place, const float *rgba, const char *name) {
    const int x = 4 + place % SHEET_COLUMNS * (CROP_WIDTH / SHEET_SHRINK + 6);
    const int y = 4 + place / SHEET_COLUMNS * (CROP_HEIGHT / SHEET_SHRINK + 16);
    float *part = (float *)ex_allocate((size_t)CROP_WIDTH * CROP_HEIGHT, 4 * sizeof(float));
    for (int row = 0; row < CROP_HEIGHT; ++row)
        memcpy(part + (size_t)row * CROP_WIDTH * 4, rgba + 4 * ((size_t)(row + CROP_Y) * WIDTH + CROP_X),
               CROP_WIDTH * 4 * sizeof(float));
    ex_canvas_picture(sheet, x, y, part, CROP_WIDTH, CROP_HEIGHT, SHEET_SHRINK, name);
    free(part);
}

/* Error in the gas over `x_of` a trial, one curve for each technique. */
static void draw_chart(ex_canvas *canvas, ex_chart *chart, const set_up *s, double (*x_of)(const trial *)) {
    for (int i = 0; i < s->trials.count; ++i)
        ex_chart_reach(chart, x_of(&s->trials.list[i]), s->trials.list[i].gas.rms);
    ex_chart_widen(chart);
    ex_chart_frame(canvas, chart);
    for (int k = 0; k < KINDS; ++k) {
        double points[COUNTS][2];
        int count = 0;
        for (int i = 0; i < s->trials.count; ++i) {
            const trial *t = &s->trials.list[i];
            if (t->kind != &kinds[k]) continue;
            points[count][0] = x_of(t), points[count++][1] = t->gas.rms;
        }
        ex_chart_curve(canvas, chart, (const double(*)[2])points, count, kinds[k].mark, kinds[k].color);
    }
}

static double megabytes_of(const trial *t) { return 1e-6 * t->bytes; }
static double milliseconds_of(const trial *t) { return 1e3 * (t->build + t->query); }

static void draw_keys(ex_canvas *canvas, int x, int y, int columns, int column_width) {
    for (int k = 0; k < KINDS; ++k)
        ex_chart_key(canvas, x + k % columns * column_width, y + k / columns * 15, kinds[k].name, kinds[k].mark,
                     kinds[k].color);
}

static void chart_time(const set_up *s, const char *folder) {
    ex_canvas canvas = ex_canvas_begin(720, 480, 1);
    char x_name[64];
    snprintf(x_name, sizeof x_name, "milliseconds to build and to answer %d points", POINTS);
    ex_chart chart = {48, 28, 480, 410, {0, 0}, {0, 0}, "", x_name, 0};
    chart.title = "puff: rms error of transmittance in the gas";
    draw_chart(&canvas, &chart, s, milliseconds_of);
    draw_keys(&canvas, 545, 40, 1, 0);
    write_chart(folder, "maps_time", &canvas);
    ex_canvas_end(&canvas);
}

/* Three scenes side by side, since all six would be a large file. */
static void chart_bytes(set_up *const *scenes, const char *name, const char *folder) {
    ex_canvas canvas = ex_canvas_begin(960, 385, 1);
    for (int i = 0; i < 3; ++i) {
        ex_chart chart = {48 + i * 312, 28, 250, 245, {0, 0}, {0, 0}, "", "megabytes", 0};
        char title[80];
        snprintf(title, sizeof title, "%s: rms error in the gas", scenes[i]->name);
        chart.title = title;
        draw_chart(&canvas, &chart, scenes[i], megabytes_of);
    }
    draw_keys(&canvas, 48, 322, 4, 228);
    write_chart(folder, name, &canvas);
    ex_canvas_end(&canvas);
}

/* ================================================================================================== tables */

static void print_errors(const set_up *s) {
    printf("```\n                      requested  has     MB | in the gas             own24   flicker | on the ground  "
           "| picture\n"
           "                                            | rms    p99    largest                  | rms    largest | "
           "rms     "
           "p99     "
           "largest\n");
    for (int i = 0; i < s->trials.count; ++i) {
        const trial *t = &s->trials.list[i];
        char wanted[16], has[16];
        snprintf(wanted, sizeof wanted, "%d", t->wanted), snprintf(has, sizeof has, "%d", t->settings.components);
        if (t->kind == &kinds[COMPRESSED])
            snprintf(wanted, sizeof wanted, "%g", (double)t->settings.epsilon), strcpy(has, "-");
        printf("%-25s %5s %4s %6.1f | %.4f %.4f %.4f  %.4f  %.1e | %.4f %.4f ", t->kind->name, wanted, has,
               1e-6 * t->bytes, t->gas.rms, t->gas.high, t->gas.largest, t->own, t->flicker, t->ground.rms,
               t->ground.largest);
        if (t->render > 0)
            printf(" | %.5f %.5f %.4f\n", t->picture.rms, t->picture.high, t->picture.largest);
        else
            printf(" |\n");
    }
    printf("```\n");
    fflush(stdout);
}

static void print_times(const set_up *s) {
    printf("```\n                      requested   build   query   both  render   (ms)   rms in the gas\n");
    printf("%-25s %5s  %6s  %6s %6s  %6.1f\n", "by slabs, no map", "-", "-", "-", "-", 1e3 * s->slabs_seconds);
    for (int i = 0; i < s->trials.count; ++i) {
        const trial *t = &s->trials.list[i];
        char wanted[16];
        snprintf(wanted, sizeof wanted, "%d", t->wanted);
        if (t->kind == &kinds[COMPRESSED]) snprintf(wanted, sizeof wanted, "%g", (double)t->settings.epsilon);
        char whole[16] = "-";
        if (t->render > 0) snprintf(whole, sizeof whole, "%.1f", 1e3 * t->render);
        printf("%-25s %5s  %6.1f  %6.1f %6.1f  %6s          %.4f\n", t->kind->name, wanted, 1e3 * t->build,
               1e3 * t->query, 1e3 * (t->build + t->query), whole, t->gas.rms);
    }
    printf("```\n");
}

/* The least error in the gas among maps that take no more memory than a map of this number of components. */
static const trial *best_within(const set_up *s, int components) {
    const int surfaces = s->core.triangle_count > 0; /* a float a texel, in every map */
    const double most = 4.0 * (components + surfaces) * s->map_size * s->map_size + 4096;
    const trial *best = NULL;
    for (int i = 0; i < s->trials.count; ++i) {
        const trial *t = &s->trials.list[i];
        if (t->bytes <= most && (!best || t->gas.rms < best->gas.rms)) best = t;
    }
    return best;
}

static void print_best(set_up *const *scenes) {
    printf("\n## The most accurate technique for each size\n\nThe smallest rms error in the medium among all maps of "
           "at most 6, 8, 16 or 24 floats per texel.\n\n| scene |");
    for (int which = 0; which < COUNTS; ++which) printf(" %d |", counts[which]);
    printf("\n|---|---|---|---|---|\n");
    for (int i = 0; i < SCENES; ++i) {
        printf("| %s |", scenes[i]->name);
        for (int which = 0; which < COUNTS; ++which) {
            char name[48];
            const trial *t = best_within(scenes[i], counts[which]);
            printf(" %s: %.4f |", t ? trial_name(t, name) : "none", t ? t->gas.rms : 0);
        }
        printf("\n");
    }
}

/* ================================================================================================== claims */

static double gas_error(const trial *t) { return t->gas.rms; }
static double picture_error(const trial *t) { return t->picture.rms; }
static double seconds_of(const trial *t) { return t->render; }

typedef double (*measure_fn)(const trial *t);

static int which_of(int wanted) {
    int which = 0;
    while (counts[which] != wanted) ++which;
    return which;
}

/* Deep opacity's error in the gas is that of the thesis's own layout; pictures and times are those of the library's. */
static double measured(const set_up *s, int kind_index, int wanted, measure_fn of) {
    if (kind_index == DEEP_OPACITY && of == gas_error) return s->thesis_rms[which_of(wanted)];
    return of(trial_of(&s->trials, kind_index, wanted));
}

/* What is measured of one technique, over what is measured of another or of the worst or best of others. */
static double deep_gain(const set_up *s, int wanted, int kind_index, measure_fn of) {
    (void)kind_index;
    return measured(s, OPACITY, wanted, of) / measured(s, DEEP_OPACITY, wanted, of);
}

/* The same of the library's layout, from each texel's first occluder to its last. */
static double library_gain(const set_up *s, int wanted, int kind_index, measure_fn of) {
    (void)kind_index;
    return of(trial_of(&s->trials, OPACITY, wanted)) / of(trial_of(&s->trials, DEEP_OPACITY, wanted));
}

static double fourier_over_most(const set_up *s, int wanted, int kind_index, measure_fn of) {
    (void)kind_index;
    return measured(s, FOURIER, wanted, of) /
           fmax(measured(s, OPACITY, wanted, of), measured(s, DEEP_OPACITY, wanted, of));
}

static double fourier_over_least(const set_up *s, int wanted, int kind_index, measure_fn of) {
    (void)kind_index;
    return measured(s, FOURIER, wanted, of) /
           fmin(measured(s, OPACITY, wanted, of), measured(s, DEEP_OPACITY, wanted, of));
}

static double over_largest(const set_up *s, int wanted, int kind_index, measure_fn of) {
    return measured(s, kind_index, wanted, of) / measured(s, kind_index, counts[COUNTS - 1], of);
}

static double own_over_true(const set_up *s, int wanted, int kind_index, measure_fn of) {
    const trial *t = trial_of(&s->trials, kind_index, wanted);
    if (of != gas_error) return 0;
    if (kind_index == DEEP_OPACITY) return s->thesis_own[which_of(wanted)] / s->thesis_rms[which_of(wanted)];
    return t->own / t->gas.rms;
}

/* A finding of the thesis as a bound on a ratio. */
typedef struct claim {
    const char *words, *ratio; /* the number is how many a texel has */
    double (*figure)(const set_up *s, int wanted, int kind_index, measure_fn of);
    int wanted, kind_index;
    double low, high; /* it holds between these */
} claim;

enum {
    DEEP_BETTER_6,
    DEEP_BETTER_8,
    DEEP_EQUAL_16,
    DEEP_EQUAL_24,
    FOURIER_WORST_6,
    FOURIER_WORST_8,
    FOURIER_WORST_16,
    FOURIER_WORST_24,
    OPACITY_DONE_16,
    DEEP_DONE_16,
    OPACITY_GAINS,
    DEEP_GAINS,
    FOURIER_GAINS,
    OPACITY_OWN,
    DEEP_OWN,
    FOURIER_OWN,
    LIBRARY_6,
    LIBRARY_8,
    LIBRARY_16,
    LIBRARY_24,
    ERROR_CLAIMS
};

static const claim error_claims[ERROR_CLAIMS] = {
    [DEEP_BETTER_6] = {"6: deep opacity is more accurate than opacity", "opacity / deep", deep_gain, 6, 0, 1, HUGE_VAL},
    [DEEP_BETTER_8] = {"8: the same", "opacity / deep", deep_gain, 8, 0, 1, HUGE_VAL},
    [DEEP_EQUAL_16] = {"16: the two are practically equal", "opacity / deep, 0.8..1.25", deep_gain, 16, 0, 0.8, 1.25},
    [DEEP_EQUAL_24] = {"24: the same", "opacity / deep, 0.8..1.25", deep_gain, 24, 0, 0.8, 1.25},
    [FOURIER_WORST_6] = {"6: Fourier is the least accurate of the three", "Fourier / the worse", fourier_over_most, 6,
                         0, 1, HUGE_VAL},
    [FOURIER_WORST_8] = {"8: the same", "Fourier / the worse", fourier_over_most, 8, 0, 1, HUGE_VAL},
    [FOURIER_WORST_16] = {"16: the same", "Fourier / the worse", fourier_over_most, 16, 0, 1, HUGE_VAL},
    [FOURIER_WORST_24] = {"24: the same", "Fourier / the worse", fourier_over_most, 24, 0, 1, HUGE_VAL},
    [OPACITY_DONE_16] = {"opacity: 16 is as good as 24", "16 / 24, up to 1.25", over_largest, 16, OPACITY, 0, 1.25},
    [DEEP_DONE_16] = {"deep opacity: 16 is as good as 24", "16 / 24, up to 1.25", over_largest, 16, DEEP_OPACITY, 0,
                      1.25},
    [OPACITY_GAINS] = {"opacity: more numbers, less error", "6 / 24", over_largest, 6, OPACITY, 1, HUGE_VAL},
    [DEEP_GAINS] = {"deep opacity: the same", "6 / 24", over_largest, 6, DEEP_OPACITY, 1, HUGE_VAL},
    [FOURIER_GAINS] = {"Fourier: the same", "6 / 24", over_largest, 6, FOURIER, 1, HUGE_VAL},
    [OPACITY_OWN] = {"opacity, 8: its own 24 serves as the truth", "own / true, 0.8..1.25", own_over_true, 8, OPACITY,
                     0.8, 1.25},
    [DEEP_OWN] = {"deep opacity, 8: the same", "own / true, 0.8..1.25", own_over_true, 8, DEEP_OPACITY, 0.8, 1.25},
    [FOURIER_OWN] = {"Fourier, 8: the same", "own / true, 0.8..1.25", own_over_true, 8, FOURIER, 0.8, 1.25},
    [LIBRARY_6] = {"the library's layout, 6: more exact than opacity", "opacity / deep", library_gain, 6, 0, 1,
                   HUGE_VAL},
    [LIBRARY_8] = {"8: the same", "opacity / deep", library_gain, 8, 0, 1, HUGE_VAL},
    [LIBRARY_16] = {"16: the same", "opacity / deep", library_gain, 16, 0, 1, HUGE_VAL},
    [LIBRARY_24] = {"24: the same", "opacity / deep", library_gain, 24, 0, 1, HUGE_VAL},
};

enum { FOURIER_FASTEST_6, FOURIER_SLOWEST_16, OPACITY_FASTER_8, OPACITY_FASTER_16, TIME_CLAIMS };

static const claim time_claims[TIME_CLAIMS] = {
    [FOURIER_FASTEST_6] = {"6: Fourier is the fastest of the three", "Fourier / the faster", fourier_over_least, 6, 0,
                           0, 1},
    [FOURIER_SLOWEST_16] = {"16: Fourier is the slowest", "Fourier / the slower", fourier_over_most, 16, 0, 1,
                            HUGE_VAL},
    [OPACITY_FASTER_8] = {"8: opacity is faster than deep opacity, by a little", "opacity / deep, 0.8..1", deep_gain, 8,
                          0, 0.8, 1},
    [OPACITY_FASTER_16] = {"16: the same", "opacity / deep, 0.8..1", deep_gain, 16, 0, 0.8, 1},
};

static int claim_holds(const claim *c, const set_up *s, measure_fn of, double *ratio) {
    *ratio = c->figure(s, c->wanted, c->kind_index, of);
    return *ratio > c->low && *ratio <= c->high;
}

static void print_cell(const claim *c, const set_up *s, measure_fn of) {
    double ratio;
    const int holds = claim_holds(c, s, of, &ratio);
    printf(" %s %.2f |", holds ? "yes" : "**no**", ratio);
}

static void print_claims(set_up *const *scenes) {
    printf("\n## Findings of the thesis, scene by scene\n\nThe table shows whether each finding holds, and the ratio "
           "of errors that decides. Errors are rms in the medium; in the last column, of the picture. In the medium, "
           "deep opacity has the thesis's layout: u of the first occluder, and n - 1 layers behind it with a thickness "
           "common to all texels. The last column and the last four rows have the library's layout: u of the first and "
           "last occluder, and n - 2 planes between them.\n\n| finding | ratio of errors |");
    for (int i = 0; i < SCENES; ++i) printf(" %s |", scenes[i]->name);
    printf(" puff, picture |\n|---|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < ERROR_CLAIMS; ++i) {
        printf("| %s | %s |", error_claims[i].words, error_claims[i].ratio);
        for (int k = 0; k < SCENES; ++k) print_cell(&error_claims[i], scenes[k], gas_error);
        if (error_claims[i].figure == own_over_true)
            printf(" |");
        else
            print_cell(&error_claims[i], scenes[PUFF], picture_error);
        printf("\n");
    }
    printf("\n| finding | ratio of times | puff |\n|---|---|---|\n");
    for (int i = 0; i < TIME_CLAIMS; ++i) {
        printf("| %s | %s |", time_claims[i].words, time_claims[i].ratio);
        print_cell(&time_claims[i], scenes[PUFF], seconds_of);
        printf("\n");
    }
}

/* "in 5 of 6 scenes (not in core)" */
static void print_tally(int index, set_up *const *scenes) {
    const claim *c = &error_claims[index];
    int held = 0;
    double ratio;
    for (int i = 0; i < SCENES; ++i) held += claim_holds(c, scenes[i], gas_error, &ratio);
    printf("in %d of %d scenes", held, SCENES);
    if (held == 0 || held == SCENES) return;
    printf(held * 2 >= SCENES ? " (not in" : " (only in");
    for (int i = 0, named = 0; i < SCENES; ++i)
        if (claim_holds(c, scenes[i], gas_error, &ratio) != (held * 2 >= SCENES))
            printf("%s %s", named++ ? "," : "", scenes[i]->name);
    printf(")");
}

/* What follows says of this run what this run has found: a sentence that states a finding holds the figure that it
   speaks of, or is chosen by it. */

static double gas_error_of(const set_up *s, int kind_index, int wanted) {
    return trial_of(&s->trials, kind_index, wanted)->gas.rms;
}

static double gain_of(const set_up *s, int wanted) { return deep_gain(s, wanted, 0, gas_error); }

static void print_few_numbers(set_up *const *scenes) {
    int least = 0, most = 0;
    for (int i = 1; i < SCENES; ++i) {
        if (gain_of(scenes[i], 8) < gain_of(scenes[least], 8)) least = i;
        if (gain_of(scenes[i], 8) > gain_of(scenes[most], 8)) most = i;
    }
    printf("- **Few numbers: deep opacity beats opacity.** In the thesis's layout this holds with 6 numbers ");
    print_tally(DEEP_BETTER_6, scenes);
    printf(", with 8 ");
    print_tally(DEEP_BETTER_8, scenes);
    printf(". Layers begin where each ray meets the medium. With 8 the error of opacity is %.2f times that of deep "
           "opacity in %s, the best case, and %.2f times in %s, the worst. In the library's layout deep opacity is "
           "better with 6 ",
           gain_of(scenes[most], 8), scenes[most]->name, gain_of(scenes[least], 8), scenes[least]->name);
    print_tally(LIBRARY_6, scenes);
    printf(", with 8 ");
    print_tally(LIBRARY_8, scenes);
    printf(".\n");
}

/* The least and the greatest ratio of a claim over all scenes. */
static void range_of(int index, set_up *const *scenes, double range[2]) {
    range[0] = HUGE_VAL, range[1] = 0;
    for (int i = 0; i < SCENES; ++i) {
        double ratio;
        claim_holds(&error_claims[index], scenes[i], gas_error, &ratio);
        range[0] = fmin(range[0], ratio), range[1] = fmax(range[1], ratio);
    }
}

static void print_more_numbers(set_up *const *scenes) {
    double own[2], library[2];
    int shrinks = 0;
    for (int i = 0; i < SCENES; ++i) shrinks += fabs(gain_of(scenes[i], 24) - 1) < fabs(gain_of(scenes[i], 6) - 1);
    range_of(DEEP_EQUAL_24, scenes, own);
    range_of(LIBRARY_24, scenes, library);
    printf("- **More numbers: the two converge.** In the thesis's layout they are practically equal with 16 ");
    print_tally(DEEP_EQUAL_16, scenes);
    printf(", with 24 ");
    print_tally(DEEP_EQUAL_24, scenes);
    printf(
        ". With 24 the error of opacity is %.2f to %.2f times that of deep opacity, nearer to 1 than with 6 in %d of "
        "%d scenes. The cause is a layer thickness common to all texels. The library places planes over each "
        "texel's own range. There the error of opacity is %.2f to %.2f times that of deep opacity.\n",
        own[0], own[1], shrinks, SCENES, library[0], library[1]);
}

static void print_fourier(set_up *const *scenes) {
    const set_up *puff = scenes[PUFF];
    const double common = gas_error_of(puff, FOURIER, 8), range = gas_error_of(puff, FOURIER_TEXEL_RANGE, 8);
    printf("- **Fourier is the worst.** This holds with 6 ");
    print_tally(FOURIER_WORST_6, scenes);
    printf(", with 8 ");
    print_tally(FOURIER_WORST_8, scenes);
    printf(", with 16 ");
    print_tally(FOURIER_WORST_16, scenes);
    printf(", with 24 ");
    print_tally(FOURIER_WORST_24, scenes);
    printf(". The series has no window and spans the depth range of the medium. In puff with 8 its error is %.4f, "
           "against %.4f for opacity. A range per texel %s it to %.4f.\n",
           common, gas_error_of(puff, OPACITY, 8), range < common ? "lowers" : "raises", range);
}

static void print_own_truth(set_up *const *scenes) {
    printf("- **A technique's own map with 24 serves as reference.** This holds for opacity maps of 8 ");
    print_tally(OPACITY_OWN, scenes);
    printf(", and for Fourier maps ");
    print_tally(FOURIER_OWN, scenes);
    printf(".\n");
}

static void print_speed(set_up *const *scenes) {
    const set_up *puff = scenes[PUFF];
    double ratio;
    const int fastest = claim_holds(&time_claims[FOURIER_FASTEST_6], puff, seconds_of, &ratio);
    const int slowest = claim_holds(&time_claims[FOURIER_SLOWEST_16], puff, seconds_of, &ratio);
    const double query = trial_of(&puff->trials, FOURIER, 6)->query;
    printf("- **Speed.** Fourier maps are fastest with 6: this %s here. They are slowest with 16: this %s. In the "
           "thesis they saved the sorting of particles, which none of the three needs here. With 6 a Fourier query "
           "takes %.2f times as long as an opacity query, and %.2f times as long as a deep opacity query.\n",
           fastest ? "holds" : "does not hold", slowest ? "holds" : "does not hold",
           query / trial_of(&puff->trials, OPACITY, 6)->query, query / trial_of(&puff->trials, DEEP_OPACITY, 6)->query);
}

/* Beer maps of the library spread gas from the first to the last occluder; engines take its mean over what is occupied.
 */
static void print_beer(set_up *const *scenes) {
    int better = 0;
    printf("- **Beer maps.** Engines keep the mean extinction over the occupied part of a ray, and so reach the total "
           "optical depth before the last occluder. The library spreads it over the texel's range. Rms "
           "errors in the medium, the library's first:");
    for (int i = 0; i < SCENES; ++i) {
        const double own = trial_of(&scenes[i]->trials, BEER, 6)->gas.rms;
        better += own < scenes[i]->beer_rms;
        printf("%s %s %.4f and %.4f", i > 0 ? "," : "", scenes[i]->name, own, scenes[i]->beer_rms);
    }
    printf(". The library's error is smaller in %d of %d scenes.\n", better, SCENES);
}

static void print_lists(set_up *const *scenes) {
    printf(
        "- **Size of lists.** Compressed and deep maps take almost no memory where there is no medium; all others take "
        "equal memory for every texel. So lists are larger than in the tables if a medium fills the map:\n\n"
        "| scene | covered texels | epsilon | floats per texel | floats per covered texel |\n|---|---|---|---|---|\n");
    for (int i = 0; i < SCENES; ++i) {
        const trial *t = trial_of(&scenes[i]->trials, COMPRESSED, 16);
        const double texels = (double)scenes[i]->map_size * scenes[i]->map_size;
        printf("| %s | %.0f %% | %g | %.1f | %.1f |\n", scenes[i]->name, 100 * scenes[i]->covered,
               (double)t->settings.epsilon, t->bytes / 4 / texels,
               (t->bytes / 4 - texels) / (scenes[i]->covered * texels) + 1);
    }
}

static void print_not_tried(set_up *const *scenes) {
    const trial *compressed = trial_of(&scenes[PUFF]->trials, COMPRESSED, 8);
    const trial *deep = trial_of(&scenes[PUFF]->trials, DEEP_OPACITY, 8);
    printf(
        "- **Not in the thesis.** In puff a compressed map with an epsilon of %g takes %.1f MB with an error of %.4f. "
        "A deep opacity map of 8 takes %.1f MB with an error of %.4f. The former takes %.2g times as long to build.\n",
        (double)compressed->settings.epsilon, 1e-6 * compressed->bytes, compressed->gas.rms, 1e-6 * deep->bytes,
        deep->gas.rms, compressed->build / deep->build);
}

static void print_words(set_up *const *scenes) {
    printf("\n## Findings\n\nEach of the first five items names a finding of the thesis and says whether it holds "
           "here.\n\n");
    print_few_numbers(scenes);
    print_more_numbers(scenes);
    print_fourier(scenes);
    print_own_truth(scenes);
    print_speed(scenes);
    print_beer(scenes);
    print_not_tried(scenes);
    print_lists(scenes);
}

static void print_controls(set_up *const *scenes) {
    printf("\n## Deep opacity: the thesis's layout and the library's\n\nRms errors in the medium, in this order: "
           "opacity, deep opacity in the thesis's layout, deep opacity in the library's.\n\n| scene |");
    for (int which = 0; which < COUNTS; ++which) printf(" %d |", counts[which]);
    printf("\n|---|---|---|---|---|\n");
    for (int i = 0; i < SCENES; ++i) {
        printf("| %s |", scenes[i]->name);
        for (int which = 0; which < COUNTS; ++which)
            printf(" %.4f, %.4f, %.4f |", gas_error_of(scenes[i], OPACITY, counts[which]), scenes[i]->thesis_rms[which],
                   gas_error_of(scenes[i], DEEP_OPACITY, counts[which]));
        printf("\n");
    }
}

/* ==================================================================================================== main */

/* Whether this one stands for its technique where not all of its pictures are rendered: that of 8. */
static int is_picture_sample(const trial *t) { return t->kind->technique == SPS_TMAP_BEER || t->wanted == 8; }

/* All of one scene but the times. Pictures of every trial are made where the thesis has one, else of those of 8. */
static void run_scene(ex_session *session, set_up *s, int every, const char *folder, ex_canvas *sheet) {
    float *values = (float *)ex_allocate(POINTS, sizeof(float)), *own = (float *)ex_allocate(POINTS, sizeof(float));
    float *rgba = (float *)ex_allocate((size_t)WIDTH * HEIGHT, 4 * sizeof(float));
    char name[48], file[96];
    scatter_points(s);
    make_exact(session, s, rgba);
    snprintf(file, sizeof file, "%s_exact", s->name);
    write_picture(folder, file, s->exact_rgba, WIDTH, HEIGHT);
    snprintf(file, sizeof file, "%s_slabs", s->name);
    write_picture(folder, file, rgba, WIDTH, HEIGHT);
    if (sheet) add_to_sheet(sheet, 0, s->exact_rgba, "exact");
    for (int i = s->trials.count - 1; i >= 0; --i) {
        trial *t = &s->trials.list[i];
        const int is_sample = is_picture_sample(t), is_shown = every || is_sample;
        measure(session, s, t, values, is_shown ? rgba : NULL, own);
        if (!is_shown) continue;
        enhance(rgba, s->exact_rgba, rgba);
        snprintf(file, sizeof file, "%s_%s_x4", s->name, trial_name(t, name));
        write_picture(folder, file, rgba, WIDTH, HEIGHT);
        if (sheet && is_sample) add_to_sheet(sheet, 1 + (int)(t->kind - kinds), rgba, name);
    }
    free(rgba);
    free(values);
    free(own);
}

static void print_legend(void) {
    printf(
        "- requested, has: components per texel, as set and as the map has them: the next lower number that the "
        "technique can\n"
        "  have. Compressed maps have an epsilon instead.\n"
        "- in the gas, on the ground: error of transmittance at %d points in particles and at %d in their shadow.\n"
        "- own24: rms difference from this technique's own largest map, as measured in the thesis.\n"
        "- flicker: rms of the error's second difference as the light turns by 0.02 degrees a frame.\n"
        "- picture: error of linear radiance, relative to the picture made with the exact map. p99: 99th percentile. "
        "Empty\n"
        "  where no picture was rendered: except for the smoke (puff and wind), only maps of 8, Beer and depth maps "
        "have one.\n",
        GAS_POINTS, GROUND_POINTS);
}

static void print_head(void) {
    printf("# Transmittance maps compared\n\n"
           "`make maps` prints errors, sizes and times "
           "of every technique on six scenes. The reference is the exact deep map of equal\n"
           "resolution. The setup follows N. Giulietti's thesis (DigiPen, 2013). It rendered smoke with opacity, deep "
           "opacity and\n"
           "Fourier maps of 6, 8, 16 and 24 numbers per texel. Its reference was each technique's own map with 24.\n"
           "[shadow_maps.md](shadow_maps.md) has advice based on these figures.\n");
}

static void print_charts(void) {
    printf(
        "\n## Charts\n\n"
        "%d particles, one spotlight, maps of %d x %d texels (%d x %d except for puff and wind), pictures of %d x %d. "
        "Times\n"
        "are of %d processors of one machine; errors are equal on all machines, up to rounding.\n\n"
        "![Error over time](maps_time.png)\n![Error over bytes](maps_bytes.png)\n![Error over "
        "bytes](maps_bytes_hard.png)\n\n"
        "Differences of the puff's pictures in display values, "
        "amplified four times, with 8 numbers per texel or the next lower\nnumber available:\n\n"
        "![Differences](maps_differences.png)\n",
        PARTICLES, MAP_SIZE, MAP_SIZE, SMALL_MAP_SIZE, SMALL_MAP_SIZE, WIDTH, HEIGHT, ex_processor_count());
}

static void time_scene(ex_session *session, set_up *s) {
    float *values = (float *)ex_allocate(POINTS, sizeof(float));
    float *rgba = (float *)ex_allocate((size_t)WIDTH * HEIGHT, 4 * sizeof(float));
    race(session, s, values, rgba);
    free(rgba);
    free(values);
}

static void print_time_table(const set_up *s) {
    printf("\n## Times of %s\n\nThe shortest of %d runs, or one run if build and query take more than %g s, on all "
           "processors. A query is of %d points. The picture's time includes building its map.\n\n",
           s->name, TURNS + 1, LONG, POINTS);
    print_times(s);
}

/* Findings first, then the tables that show them, then all figures. */
static void print_all(const ex_session *session, set_up *const *scenes) {
    print_head();
    print_words(scenes);
    print_best(scenes);
    print_charts();
    print_claims(scenes);
    print_controls(scenes);
    printf("\n## Reading the tables\n\n");
    print_legend();
    for (int i = 0; i < SCENES; ++i) {
        print_exact(scenes[i]);
        print_errors(scenes[i]);
    }
    print_formats(session, program, scenes);
    print_time_table(scenes[PUFF]);
}

int main(int argc, char **argv) {
    set_up *scenes[SCENES];
    ex_session session;
    const int formats_alone = argc == 2 && strcmp(argv[1], "formats") == 0;
    const int sheet_rows = (1 + KINDS + SHEET_COLUMNS - 1) / SHEET_COLUMNS;
    if (argc != 3 && !formats_alone) {
        fprintf(stderr, "%s: give two folders: for charts, and for pictures; or say formats\n", argv[0]);
        return 2;
    }
    ex_canvas sheet = ex_canvas_begin(4 + SHEET_COLUMNS * (CROP_WIDTH / SHEET_SHRINK + 6),
                                      4 + sheet_rows * (CROP_HEIGHT / SHEET_SHRINK + 16), 1);
    ex_session_measure(&session, program, 0);
    for (int i = 0; i < SCENES; ++i) {
        scenes[i] = (set_up *)ex_allocate(1, sizeof *scenes[i]);
        set_up_begin(scenes[i], makers[i]);
        if (formats_alone) make_exact_values(&session, scenes[i]);
        if (formats_alone) continue;
        run_scene(&session, scenes[i], i == PUFF || i == WIND, argv[2], i == PUFF ? &sheet : NULL);
    }
    if (formats_alone) print_formats(&session, program, scenes);
    if (formats_alone) return 0;
    time_scene(&session, scenes[PUFF]);
    print_all(&session, scenes);
    chart_time(scenes[PUFF], argv[1]);
    chart_bytes(scenes + PUFF, "maps_bytes", argv[1]);
    chart_bytes(scenes + SHELL, "maps_bytes_hard", argv[1]);
    write_chart(argv[1], "maps_differences", &sheet);
    for (int i = 0; i < SCENES; ++i) set_up_end(scenes[i]), free(scenes[i]);
    ex_canvas_end(&sheet);
    ex_session_end(&session);
    return 0;
}
