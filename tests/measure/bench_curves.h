/* bench_curves.h: how bench.c's times grow with what there is to do: tables in Markdown, and charts. Include after
   bench_scenes.h and chart.h. */

#ifndef BENCH_CURVES_H
#define BENCH_CURVES_H

/* ================================================================================================== curves */

enum { CURVES = 3, PLACES = 6 }; /* at most */

typedef struct curve {
    const char *name;
    double seconds[PLACES];
} curve;

/* Times of a few kinds of frame, at a few places. */
typedef struct plot {
    const char *heading, *file, *title, *x_name;
    const char *input; /* what there is more of from place to place */
    int from_zero;     /* 1: the first place has nothing of it, and what is added to its time is what grows */
    int places, curves;
    double x[PLACES], inputs[PLACES];
    curve of[CURVES];
} plot;

/* Above this exponent a time counts as growing faster than its input, and not as noise. */
#define FAST 1.1

/* The exponent with which a time grows from the place before; 0 where there is none. */
static double growth(const plot *p, const curve *c, int place) {
    if (place <= p->from_zero) return 0;
    const double less = p->from_zero ? c->seconds[0] : 0;
    const double ratio = (c->seconds[place] - less) / (c->seconds[place - 1] - less);
    return ratio > 0 ? log(ratio) / log(p->inputs[place] / p->inputs[place - 1]) : 0;
}

static void print_place(const plot *p, int place) {
    printf("| %g |", p->x[place]);
    for (int i = 0; i < p->curves; ++i) {
        const double exponent = growth(p, &p->of[i], place);
        printf(" %.*f |", p->of[i].seconds[place] < 0.1 ? 1 : 0, 1e3 * p->of[i].seconds[place]);
        if (place <= p->from_zero)
            printf(" |");
        else
            printf(" %.2f%s |", exponent, exponent > FAST ? " **fast**" : "");
    }
    printf("\n");
}

static void print_remarks(const plot *p) {
    int fast = 0;
    for (int i = 0; i < p->curves; ++i)
        for (int k = 0; k < p->places; ++k) {
            if (!(growth(p, &p->of[i], k) > FAST)) continue;
            if (!fast++) printf("Faster than the number of %s:", p->input);
            printf("%s %s from %g to %g", fast > 1 ? ";" : "", p->of[i].name, p->x[k - 1], p->x[k]);
        }
    if (fast)
        printf(".\n");
    else
        printf("Nothing grows faster than the number of %s.\n", p->input);
}

static void print_plot(const plot *p) {
    printf("\n### %s\n\n![%s](%s.png)\n\n| %s |", p->heading, p->heading, p->file, p->x_name);
    for (int i = 0; i < p->curves; ++i) printf(" %s, ms | growth |", p->of[i].name);
    printf("\n|---|");
    for (int i = 0; i < p->curves; ++i) printf("---|---|");
    printf("\n");
    for (int k = 0; k < p->places; ++k) print_place(p, k);
    printf("\n");
    print_remarks(p);
    fflush(stdout);
}

/* A line as steep as the input grows, from the end of the highest curve down. */
static void draw_slope(ex_canvas *canvas, const ex_chart *chart, const plot *p, const unsigned color) {
    const int last = p->inputs[p->places - 1] > p->inputs[0] ? p->places - 1 : 0, first = p->places - 1 - last;
    double top = 0;
    for (int i = 0; i < p->curves; ++i) top = fmax(top, 1e3 * p->of[i].seconds[last]);
    const double slope = log(p->inputs[last] / p->inputs[first]) / log(p->x[last] / p->x[first]);
    const double low = fmax(chart->y[0], top * p->inputs[first] / p->inputs[last]);
    ex_canvas_line(canvas, ex_chart_x(chart, p->x[last]), ex_chart_y(chart, top),
                   ex_chart_x(chart, p->x[last] * pow(low / top, 1 / slope)), ex_chart_y(chart, low), 1, color);
}

static void draw_plot(const plot *p, const char *folder) {
    static const ex_mark marks[CURVES] = {EX_MARK_DISC, EX_MARK_SQUARE, EX_MARK_CROSS};
    static const unsigned colors[CURVES] = {0x1060c0, 0xc04010, 0x108040};
    ex_canvas canvas = ex_canvas_begin(560, 330, 1);
    ex_chart chart = {48, 28, 320, 256, {0, 0}, {0, 0}, p->title, p->x_name, p->from_zero};
    ex_error error;
    for (int i = 0; i < p->curves; ++i)
        for (int k = 0; k < p->places; ++k) ex_chart_reach(&chart, p->x[k], 1e3 * p->of[i].seconds[k]);
    ex_chart_widen(&chart);
    ex_chart_frame(&canvas, &chart);
    if (!p->from_zero) {
        draw_slope(&canvas, &chart, p, 0x909090);
        ex_canvas_line(&canvas, 385, 43 + 15 * p->curves, 405, 43 + 15 * p->curves, 1, 0x909090);
        ex_canvas_text(&canvas, 413, 40 + 15 * p->curves, "as the input grows", 0x000000);
    }
    for (int i = 0; i < p->curves; ++i) {
        double points[PLACES][2];
        for (int k = 0; k < p->places; ++k) points[k][0] = p->x[k], points[k][1] = 1e3 * p->of[i].seconds[k];
        ex_chart_curve(&canvas, &chart, (const double(*)[2])points, p->places, marks[i], colors[i]);
        ex_chart_key(&canvas, 385, 40 + 15 * i, p->of[i].name, marks[i], colors[i]);
    }
    ex_stop_if(ex_canvas_write(&canvas, folder, p->file, &error), program, &error);
    ex_canvas_end(&canvas);
}

/* ================================================================================================== scenes */

/* The frames that image size and slabs are measured with. */
typedef struct curve_scenes {
    ex_session session;
    ex_grid smoke, bonsai;
    frame frames[CURVES];
    const char *names[CURVES];
    int count;
} curve_scenes;

static void curve_scenes_begin(curve_scenes *s) {
    memset(s, 0, sizeof *s);
    ex_session_measure(&s->session, program, WORKERS);
    blob_frame(&s->frames[s->count], 128, 512);
    s->names[s->count++] = "blob 128^3";
    if (!smoke_load(&s->smoke)) {
        smoke_ground_frame(&s->frames[s->count], &s->smoke, 512);
        s->names[s->count++] = "smoke";
    }
    if (!bonsai_load(&s->bonsai)) {
        bonsai_frame(&s->frames[s->count], &s->bonsai);
        s->frames[s->count].volume.shading = SPS_SHADING_SURFACE;
        s->names[s->count++] = "bonsai";
    }
}

static void curve_scenes_end(curve_scenes *s) {
    for (int i = 0; i < s->count; ++i) frame_end(&s->frames[i]);
    ex_grid_free(&s->smoke), ex_grid_free(&s->bonsai);
    ex_session_end(&s->session);
}

/* One curve over pixels along a side (`size` 1), or over slabs. */
static void measure_view(curve_scenes *s, int scene, int size, plot *p) {
    frame frames[PLACES];
    contender c[PLACES];
    for (int k = 0; k < p->places; ++k) {
        frame_copy(&frames[k], &s->frames[scene]);
        if (size)
            frame_resize(&frames[k], (int)p->x[k], (int)p->x[k]);
        else
            frames[k].view.slab_thickness = p->x[k];
        contender_set(&c[k], &s->session, &frames[k], 0);
    }
    race(c, p->places, 3);
    p->of[scene].name = s->names[scene];
    for (int k = 0; k < p->places; ++k) {
        p->of[scene].seconds[k] = c[k].seconds;
        frame_end(&frames[k]);
    }
}

static void curve_views(const char *folder) {
    plot size = {.heading = "Image size",
                 .file = "speed_size",
                 .title = "milliseconds a frame, medium",
                 .x_name = "pixels along a side",
                 .input = "pixels",
                 .places = 5,
                 .x = {128, 256, 512, 1024, 2048}};
    plot slab = {.heading = "Thickness of slabs",
                 .file = "speed_slab",
                 .title = "milliseconds a frame of 512 x 512",
                 .x_name = "thickness of slabs, voxels",
                 .input = "slabs",
                 .places = 6,
                 .x = {8, 4, 2, 1, 0.5, 0.25}};
    curve_scenes scenes;
    curve_scenes_begin(&scenes);
    size.curves = slab.curves = scenes.count;
    for (int k = 0; k < size.places; ++k) size.inputs[k] = size.x[k] * size.x[k];
    for (int k = 0; k < slab.places; ++k) slab.inputs[k] = 1 / slab.x[k];
    for (int i = 0; i < scenes.count; ++i) measure_view(&scenes, i, 1, &size), measure_view(&scenes, i, 0, &slab);
    print_plot(&size), draw_plot(&size, folder);
    print_plot(&slab), draw_plot(&slab, folder);
    curve_scenes_end(&scenes);
}

/* ================================================================================================== voxels */

/* The blob by more and more voxels, of which about half are relevant: reading them, and frames that hold them. */
static void curve_voxels(const char *folder) {
    plot p = {.heading = "Voxels",
              .file = "speed_voxels",
              .title = "milliseconds, blob, 512 x 512",
              .x_name = "voxels along a side",
              .input = "voxels",
              .places = 4,
              .curves = 2,
              .x = {64, 128, 256, 512},
              .of = {{.name = "frame, voxels held"}, {.name = "reading them"}}};
    ex_session sessions[PLACES];
    frame frames[PLACES];
    contender c[PLACES];
    for (int k = 0; k < p.places; ++k) {
        p.inputs[k] = pow(p.x[k], 3);
        ex_session_measure(&sessions[k], program, WORKERS);
        blob_frame(&frames[k], (int)p.x[k], 512);
        p.of[1].seconds[k] = reading_seconds(&frames[k]);
        contender_set(&c[k], &sessions[k], &frames[k], 0);
    }
    race(c, p.places, 3);
    for (int k = 0; k < p.places; ++k) {
        p.of[0].seconds[k] = c[k].seconds;
        frame_end(&frames[k]);
        ex_session_end(&sessions[k]);
    }
    print_plot(&p), draw_plot(&p, folder);
}

/* ================================================================================================== lights */

enum { MOST_LIGHTS = 8 };

/* A frame with some lights of different directions, and a context of its own, which holds their tables. */
typedef struct lights_trial {
    sps_light lights[MOST_LIGHTS];
    frame frame;
    ex_session session;
} lights_trial;

static void lights_trial_begin(lights_trial *t, int count, sps_shadow_source source, contender *c) {
    ex_session_measure(&t->session, program, WORKERS);
    blob_frame(&t->frame, 128, 512);
    for (int i = 0; i < MOST_LIGHTS; ++i) {
        t->lights[i] = t->frame.light;
        t->lights[i].direction[0] = cos(0.7 * i) - 0.5, t->lights[i].direction[2] = sin(0.7 * i);
        t->lights[i].shadow_source = source;
    }
    t->frame.scene.lights = t->lights, t->frame.scene.light_count = count;
    contender_set(c, &t->session, &t->frame, 0);
}

static void curve_lights(const char *folder) {
    plot p = {.heading = "Lights",
              .file = "speed_lights",
              .title = "milliseconds a frame of 512 x 512, blob 128^3",
              .x_name = "lights",
              .input = "lights",
              .from_zero = 1,
              .places = 5,
              .curves = 3,
              .x = {0, 1, 2, 4, 8},
              .of = {{.name = "sheets"}, {.name = "tables, held"}, {.name = "tables, made anew"}}};
    static lights_trial trials[CURVES][PLACES];
    contender c[CURVES * PLACES];
    for (int i = 0; i < p.curves; ++i)
        for (int k = 0; k < p.places; ++k) {
            contender *of = &c[i * p.places + k];
            p.inputs[k] = p.x[k];
            lights_trial_begin(&trials[i][k], (int)p.x[k], i == 0 ? SPS_SHADOW_SHEETS : SPS_SHADOW_TABLE, of);
            of->moving = i == 1 ? &of->view.camera.position[0] : NULL;
            of->turning = i == 2 ? trials[i][k].lights : NULL, of->turning_count = (int)p.x[k];
        }
    race(c, p.curves * p.places, 3);
    for (int i = 0; i < p.curves; ++i)
        for (int k = 0; k < p.places; ++k) {
            p.of[i].seconds[k] = c[i * p.places + k].seconds;
            frame_end(&trials[i][k].frame);
            ex_session_end(&trials[i][k].session);
        }
    print_plot(&p), draw_plot(&p, folder);
}

/* ================================================================================================== the page */

static void bench_growth(const char *folder) {
    printf("\n## Curves\n\nFrames of 512 x 512 at `medium`, 2 workers, cached voxels. `build/speed.txt` has the "
           "figures.\n");
    curve_views(folder);
    curve_voxels(folder);
    curve_lights(folder);
}

#endif /* BENCH_CURVES_H */
