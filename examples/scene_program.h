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

/* What a picture is averaged from. */
typedef enum ex_sampling {
    EX_SAMPLE_EDGES = 0, /* 4 x 4 samples of polygons' edges per pixel; all else is sampled once, or filtered */
    /* A picture of twice the size, with 2 x 2 samples of edges per pixel. Also smooths the hard shadows of polygons on
       each other, fine textures, and classified volumes whose voxels are hardly larger than pixels, and takes about
       three times as long. */
    EX_SAMPLE_ALL
} ex_sampling;

/* Changes the large picture before it is made small. If there is one, image.depth is rendered, too, and edges are not
   sampled, so that each pixel has the depth of one surface. */
typedef struct ex_finish {
    void (*apply_fn)(void *user, const sps_view *view, const sps_image *image);
    void *user;
} ex_finish;

/* Scenes that one view shows side by side. */
typedef struct ex_panels {
    const sps_scene *scenes;
    int count;
    ex_sampling sampling;
    const ex_finish *finish; /* of a single panel that samples all; may be NULL */
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
    out->panels = *panels;
    out->panels.scenes = out->scenes, out->panels.count = 2 * panels->count;
    return softened ? 0 : ex_fail(error, "--soft: there is no directional light");
}

static inline void ex_softened_free(ex_softened *softened) {
    free(softened->scenes);
    free(softened->lights);
}

/* The view of a panel of the picture. --width is that of all panels. */
static inline sps_view ex_scene_view(const sps_view *view, int panels, const ex_scene_options *options) {
    sps_view sized = *view;
    if (options->width) {
        sized.width = options->width > panels ? options->width / panels : 1;
        sized.height = (int)((double)view->height * sized.width / view->width + 0.5);
    }
    if (sized.height < 1) sized.height = 1;
    sized.coverage_samples = 4;
    if (options->quality) sized.quality = (sps_quality)options->quality;
    return sized;
}

/* The same as it is rendered. */
static inline sps_view ex_scene_rendered_view(const ex_panels *panels, const sps_view *view,
                                              const ex_scene_options *options) {
    sps_view rendered = ex_scene_view(view, panels->count, options);
    if (panels->sampling == EX_SAMPLE_EDGES) return rendered;
    rendered.width *= 2, rendered.height *= 2;
    rendered.coverage_samples = panels->finish ? 0 : 2;
    return rendered;
}

/* Renders all panels into one picture. */
static inline int ex_scene_render_panels(sps_context *context, const ex_panels *panels, const sps_view *view,
                                         const sps_image *picture, ex_error *error) {
    for (int i = 0; i < panels->count; ++i) {
        sps_image image = *picture;
        image.rgba += (size_t)i * (size_t)view->width * 4;
        if (sps_render(context, &panels->scenes[i], view, &image) != SPS_OK)
            return ex_fail(error, "%s", sps_error(context));
    }
    if (panels->finish) panels->finish->apply_fn(panels->finish->user, view, picture);
    return 0;
}

/* Begins a session, and a picture of that size, whose rgba is to be freed. */
static inline int ex_scene_begin(const ex_scene_options *options, int width, int height, ex_session *session,
                                 sps_image *picture, ex_error *error) {
    if (ex_session_begin(session, options->threads, error)) return 1;
    memset(picture, 0, sizeof *picture);
    picture->rgba = (float *)ex_allocate((size_t)width * (size_t)height, 4 * sizeof(float));
    picture->row_pixels = (size_t)width;
    return 0;
}

/* Renders the picture, makes it small if it is large, and writes it. */
static inline int ex_scene_render(const ex_panels *panels, const sps_view *view, const ex_scene_options *options,
                                  ex_error *error) {
    const sps_view rendered = ex_scene_rendered_view(panels, view, options);
    const int shrink = panels->sampling == EX_SAMPLE_ALL ? 2 : 1;
    const int width = panels->count * rendered.width, height = rendered.height;
    const size_t pixels = (size_t)width * (size_t)height;
    ex_session session;
    sps_image image;
    if (ex_scene_begin(options, width, height, &session, &image, error)) return 1;
    if (panels->finish) image.depth = (float *)ex_allocate(pixels, sizeof(float));
    const double start = ex_now(NULL);
    int failed = ex_scene_render_panels(session.context, panels, &rendered, &image, error);
    const double seconds = ex_now(NULL) - start;
    ex_session_end(&session);
    if (!failed) {
        if (shrink == 2) ex_halve(image.rgba, width, height, 4, image.rgba);
        failed = ex_write_png(options->out, image.rgba, width / shrink, height / shrink, error);
    }
    if (!failed) printf("%s: %d x %d in %.2f s\n", options->out, width / shrink, height / shrink, seconds);
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

/* The rest of a scene program: reads --out FILE.png --width W --threads N --quality Q --soft DEGREES
   (ex_panels_program), and renders the picture. `name` is the file without --out, and the view's width that without
   --width. Returns the exit status. */
static inline int ex_scene_program(int argc, char **argv, const char *name, const sps_scene *scene,
                                   const sps_view *view, ex_sampling sampling) {
    const ex_panels panel = {scene, 1, sampling, NULL};
    return ex_panels_program(argc, argv, name, &panel, view);
}

#endif /* EX_SCENE_PROGRAM_H */
