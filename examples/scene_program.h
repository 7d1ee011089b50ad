/* scene_program.h: what a scene program does with its scene: reads options, renders, writes the picture. */

#ifndef EX_SCENE_PROGRAM_H
#define EX_SCENE_PROGRAM_H

#include "arguments.h"
#include "picture.h"
#include "session.h"

typedef struct ex_scene_options {
    const char *out;
    int width, threads, quality;
    int softens; /* 1: there is an option --soft */
    int soft;    /* degrees; 0: not given */
} ex_scene_options;

static inline int ex_scene_options_read(int argc, char **argv, ex_scene_options *options, ex_error *error) {
    for (int i = 1; i < argc; i += 2) {
        const char *name = argv[i], *value = i + 1 < argc ? argv[i + 1] : "";
        int wrong = 0;
        if (strcmp(name, "--out") == 0)
            options->out = value, wrong = *value == '\0';
        else if (strcmp(name, "--width") == 0)
            wrong = ex_whole_number(value, 1, 8192, &options->width);
        else if (strcmp(name, "--threads") == 0)
            wrong = ex_whole_number(value, 1, 1024, &options->threads);
        else if (strcmp(name, "--quality") == 0)
            wrong = (options->quality = ex_find_name(ex_quality_names, value)) < 0;
        else if (options->softens && strcmp(name, "--soft") == 0)
            wrong = ex_whole_number(value, 1, 114, &options->soft);
        else
            return ex_fail(error, "unknown option '%s'; there are --out FILE.png --width W --threads N --quality Q%s",
                           name, options->softens ? " --soft DEGREES" : "");
        if (wrong) return ex_fail(error, "%s: '%s' will not do", name, value);
    }
    return ex_check_writable(options->out, error);
}

/* Changes the large picture before it is made small. If there is one, image.depth is rendered, too. */
typedef struct ex_finish {
    void (*apply_fn)(void *user, const sps_view *view, const sps_image *image);
    void *user;
} ex_finish;

/* Scenes that one view shows side by side. */
typedef struct ex_panels {
    const sps_scene *scenes;
    int count;
    const ex_finish *finish; /* of a single panel; may be NULL */
} ex_panels;

/* For --soft: twice as many panels, each beside itself under suns of another extent. */
typedef struct ex_softened {
    ex_panels panels;
    sps_scene *scenes;
    sps_light *lights; /* of the scenes that are softened */
} ex_softened;

/* Fails without a directional light. Free the result in either case. */
static inline int ex_soften(ex_softened *out, const ex_panels *panels, int degrees, ex_error *error) {
    size_t light_count = 0;
    int softened = 0;
    for (int i = 0; i < panels->count; ++i) light_count += (size_t)panels->scenes[i].light_count;
    out->scenes = (sps_scene *)ex_allocate(2 * (size_t)panels->count, sizeof *out->scenes);
    out->lights = (sps_light *)ex_allocate(light_count, sizeof *out->lights);
    sps_light *light = out->lights;
    for (int i = 0; i < panels->count; ++i) {
        const sps_scene *hard = &panels->scenes[i];
        out->scenes[2 * i] = out->scenes[2 * i + 1] = *hard;
        out->scenes[2 * i + 1].lights = light;
        for (int k = 0; k < hard->light_count; ++k, ++light) {
            *light = hard->lights[k];
            if (light->kind != SPS_LIGHT_DIRECTIONAL) continue;
            light->angular_diameter = degrees * 3.14159265358979 / 180;
            softened = 1;
        }
    }
    out->panels.scenes = out->scenes, out->panels.count = 2 * panels->count, out->panels.finish = NULL;
    return softened ? 0 : ex_fail(error, "--soft: there is no directional light");
}

static inline void ex_softened_free(ex_softened *softened) {
    free(softened->scenes);
    free(softened->lights);
}

/* The view of a panel at twice the size, which smooths the edges of polygons. --width is that of all panels. */
static inline sps_view ex_scene_large_view(const sps_view *view, int panels, const ex_scene_options *options) {
    sps_view large = *view;
    int width = view->width, height = view->height;
    if (options->width) {
        width = options->width > panels ? options->width / panels : 1;
        height = (int)((double)height * width / view->width + 0.5);
    }
    if (height < 1) height = 1;
    large.width = 2 * width, large.height = 2 * height;
    if (options->quality) large.quality = (sps_quality)options->quality;
    return large;
}

/* Renders all panels into the large picture. */
static inline int ex_scene_render_panels(sps_context *context, const ex_panels *panels, const sps_view *large,
                                         const sps_image *picture, ex_error *error) {
    for (int i = 0; i < panels->count; ++i) {
        sps_image image = *picture;
        image.rgba += (size_t)i * (size_t)large->width * 4;
        if (sps_render(context, &panels->scenes[i], large, &image) != SPS_OK)
            return ex_fail(error, "%s", sps_error(context));
    }
    if (panels->finish) panels->finish->apply_fn(panels->finish->user, large, picture);
    return 0;
}

/* Renders the large picture, makes it small, and writes it. */
static inline int ex_scene_render(const ex_panels *panels, const sps_view *view, const ex_scene_options *options,
                                  ex_error *error) {
    const sps_view large = ex_scene_large_view(view, panels->count, options);
    const int width = panels->count * large.width, height = large.height;
    const size_t pixels = (size_t)width * (size_t)height;
    ex_session session;
    sps_image image;
    if (ex_session_begin(&session, options->threads, error)) return 1;
    memset(&image, 0, sizeof image);
    image.rgba = (float *)ex_allocate(pixels, 4 * sizeof(float));
    image.row_pixels = (size_t)width;
    if (panels->finish) image.depth = (float *)ex_allocate(pixels, sizeof(float));
    const double start = ex_now(NULL);
    int failed = ex_scene_render_panels(session.context, panels, &large, &image, error);
    const double seconds = ex_now(NULL) - start;
    ex_session_end(&session);
    if (!failed) {
        ex_halve(image.rgba, width, height, 4, image.rgba);
        failed = ex_write_png(options->out, image.rgba, width / 2, height / 2, error);
    }
    if (!failed) printf("%s: %d x %d in %.2f s\n", options->out, width / 2, height / 2, seconds);
    free(image.rgba);
    free(image.depth);
    return failed;
}

/* The same as ex_scene_program for several scenes side by side; `view` is that of one. Without a `finish` there is also
   --soft DEGREES: each picture, and to its right the same under directional lights of this angular diameter. */
static inline int ex_panels_program(int argc, char **argv, const char *name, const ex_panels *panels,
                                    const sps_view *view) {
    ex_scene_options options = {name, 0, 0, 0, panels->finish == NULL, 0};
    ex_softened softened;
    ex_error error;
    int status = EX_OK;
    if (ex_scene_options_read(argc, argv, &options, &error)) {
        status = EX_MISTAKEN;
    } else if (options.soft) {
        if (ex_soften(&softened, panels, options.soft, &error))
            status = EX_MISTAKEN;
        else if (ex_scene_render(&softened.panels, view, &options, &error))
            status = EX_FAILED;
        ex_softened_free(&softened);
    } else if (ex_scene_render(panels, view, &options, &error)) {
        status = EX_FAILED;
    }
    if (status != EX_OK) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    return status;
}

/* The rest of a scene program: reads --out FILE.png --width W --threads N --quality Q, and without a
   `finish`, which may be NULL, --soft DEGREES (ex_panels_program), and renders the picture. `name` is the file without
   --out, and the view's width that without --width. Returns the exit status. */
static inline int ex_scene_program(int argc, char **argv, const char *name, const sps_scene *scene,
                                   const sps_view *view, const ex_finish *finish) {
    const ex_panels panel = {scene, 1, finish};
    return ex_panels_program(argc, argv, name, &panel, view);
}

#endif /* EX_SCENE_PROGRAM_H */
