/* ways.h: scenes with light scattered once, forward, forward and sideways (SPS_SCATTERING_CONVOLUTION), in every
   direction (SPS_SCATTERING_MULTIPLE) and by random paths (sps_reference), side by side, with the time of each. */

#ifndef EX_WAYS_H
#define EX_WAYS_H

#include "scene_program.h"

enum { EX_WAY_ONCE = 0, EX_WAY_FORWARD, EX_WAY_CONVOLUTION, EX_WAY_FULL, EX_WAY_PATHS, EX_WAYS };
enum { EX_WAYS_ROWS = 2 }; /* at most */

/* A row of panels for each scene, and a column for each way. */
typedef struct ex_ways {
    const sps_scene *scenes;
    int rows;
    const char *const *names; /* of the rows; NULL: none */
    sps_reference_settings paths;
    int path_width; /* pixels across a panel of random paths, at most: they take long, so it is rendered small */
} ex_ways;

/* Shows a picture enlarged, linear between the middles of its pixels. */
static inline void ex_enlarge(const float *small, int width, int height, const sps_view *view, const sps_image *out) {
    for (int y = 0; y < view->height; ++y)
        for (int x = 0; x < view->width; ++x) {
            const double u = ex_clamp((x + 0.5) * width / view->width - 0.5, 0, width - 1);
            const double v = ex_clamp((y + 0.5) * height / view->height - 0.5, 0, height - 1);
            const size_t left = (size_t)u, top = (size_t)v, right = u > (double)left ? 4 : 0, row = 4 * (size_t)width;
            const float *upper = small + top * row + 4 * left, *lower = upper + (v > (double)top ? row : 0);
            for (size_t c = 0; c < 4; ++c)
                out->rgba[4 * ((size_t)y * out->row_pixels + (size_t)x) + c] = (float)ex_mix(
                    ex_mix((double)upper[c], (double)upper[c + right], u - (double)left),
                    ex_mix((double)lower[c], (double)lower[c + right], u - (double)left), v - (double)top);
        }
}

static inline sps_result ex_ways_render_paths(sps_context *context, const ex_ways *ways, const sps_scene *scene,
                                              const sps_view *view, const sps_image *image) {
    sps_view few = *view;
    sps_image small = {0};
    few.width = view->width < ways->path_width ? view->width : ways->path_width;
    few.height = (view->height * few.width + view->width - 1) / view->width;
    small.rgba = (float *)ex_allocate((size_t)few.width * (size_t)few.height, 4 * sizeof(float));
    const sps_result result = sps_reference(context, scene, &few, &ways->paths, &small);
    ex_enlarge(small.rgba, few.width, few.height, view, image);
    free(small.rgba);
    return result;
}

static inline sps_result ex_ways_render_way(sps_context *context, const ex_ways *ways, const sps_scene *scene,
                                            const sps_view *view, int way, const sps_image *image) {
    static const sps_scattering kinds[EX_WAYS] = {SPS_SCATTERING_SINGLE, SPS_SCATTERING_FORWARD,
                                                  SPS_SCATTERING_CONVOLUTION, SPS_SCATTERING_MULTIPLE};
    sps_view seen = *view;
    if (way == EX_WAY_PATHS) return ex_ways_render_paths(context, ways, scene, view, image);
    seen.scattering = kinds[way];
    return sps_render(context, scene, &seen, image);
}

/* The voxels are read before any way is timed. */
static inline int ex_ways_render_panels(ex_session *session, const ex_ways *ways, const sps_view *view,
                                        const sps_image *picture, double seconds[EX_WAYS_ROWS][EX_WAYS],
                                        ex_error *error) {
    for (int i = -1; i < ways->rows * EX_WAYS; ++i) {
        const int row = i < 0 ? 0 : i / EX_WAYS, way = i < 0 ? EX_WAY_ONCE : i % EX_WAYS;
        sps_image image = *picture;
        const double start = ex_now(NULL);
        image.rgba += 4 * ((size_t)(row * view->height) * picture->row_pixels + (size_t)(way * view->width));
        if (ex_ways_render_way(session->context, ways, &ways->scenes[row], view, way, &image) != SPS_OK)
            return ex_fail(error, "%s", sps_error(session->context));
        seconds[row][way] = ex_now(NULL) - start;
    }
    return 0;
}

static inline int ex_ways_render(const ex_ways *ways, const sps_view *view, const ex_scene_options *options,
                                 ex_error *error) {
    static const char *const names[EX_WAYS] = {"once", "forward", "convolution", "full",
                                               "random paths (sps_reference)"};
    const sps_view panel = ex_scene_view(view, EX_WAYS, options);
    const int width = EX_WAYS * panel.width, height = ways->rows * panel.height;
    double seconds[EX_WAYS_ROWS][EX_WAYS];
    ex_session session;
    sps_image picture;
    if (ex_scene_begin(options, width, height, &session, &picture, error)) return 1;
    int failed = ex_ways_render_panels(&session, ways, &panel, &picture, seconds, error);
    ex_session_end(&session);
    if (!failed) failed = ex_write_png(options->out, picture.rgba, width, height, error);
    free(picture.rgba);
    if (failed) return 1;
    printf("%s: %d x %d, panels of %d x %d\n", options->out, width, height, panel.width, panel.height);
    for (int way = 0; way < EX_WAYS; ++way) {
        printf("  %-30s", names[way]);
        for (int row = 0; row < ways->rows; ++row) {
            if (ways->names) printf("%s %s", row ? "," : "", ways->names[row]);
            printf(" %6.2f s", seconds[row][way]);
        }
        printf("\n");
    }
    return 0;
}

/* The rest of such a scene program; options and exit status are those of ex_scene_program without --soft. */
static inline int ex_ways_program(int argc, char **argv, const char *name, const ex_ways *ways, const sps_view *view) {
    ex_scene_options options = {name, 0, 0, 0, 0, 0};
    ex_error error;
    int status = EX_OK;
    if (ex_scene_options_read(argc, argv, &options, &error))
        status = EX_MISTAKEN;
    else if (ex_ways_render(ways, view, &options, &error))
        status = EX_FAILED;
    if (status != EX_OK) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    return status;
}

#endif /* EX_WAYS_H */
