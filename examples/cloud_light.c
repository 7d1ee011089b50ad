/* A cloud, with light scattered once, forward any number of times, in every direction (SPS_SCATTERING_FULL), and by
   random paths (sps_reference), from left to right, with the time of each. Above, the sun is behind the cloud and
   aside; below, it sets, and the sky is the greater part of the light.
   cc -std=c99 -O3 -march=native -pthread -I. -I/usr/include/stb examples/cloud_light.c -o cloud_light -lm */

#define SPLATSHADOW_IMPLEMENTATION
#include "densities.h"
#include "scene.h"
#include "scene_program.h"

enum { ONCE = 0, FORWARD, FULL, BY_PATHS, WAYS };
enum { BEHIND = 0, SUNSET, ROWS };

/* sps_volume.eval_fn: a heap of puffs with a flat base. Turbulence makes lumps of their surface. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    static const double puffs[7][4] = {{-0.10, 0.30, 0.0, 0.52},  {-0.75, -0.02, 0.10, 0.42}, {0.68, 0.02, -0.05, 0.46},
                                       {0.22, -0.10, 0.40, 0.40}, {-0.38, -0.12, 0.38, 0.38}, {0.10, 0.62, -0.05, 0.33},
                                       {1.08, -0.18, 0.05, 0.26}};
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        double merged = 0; /* a smooth maximum of the depths of p in each puff */
        for (int k = 0; k < 7; ++k)
            merged += exp(
                14 * (puffs[k][3] - ex_vec_length(ex_vec_sub(p, ex_vec_of(puffs[k][0], puffs[k][1], puffs[k][2])))));
        const double depth = log(merged) / 14 - 0.6 * ex_ramp(-0.22, -0.5, p.y);
        out[i] = 0;
        if (depth < -0.05) continue;
        out[i] = (float)ex_ramp(0, 0.12, depth + 0.10 - 0.42 * ex_turbulence(ex_vec_scale(p, 2.2), 5));
    }
    return 0;
}

static void set_cloud(sps_volume *cloud) {
    static const sps_lobe lobes[2] = {{0.8f, 0.85f}, {-0.1f, 0.15f}};
    ex_volume_box(cloud, ex_vec_of(-1.25, -0.55, -0.65), ex_vec_of(1.4, 1.0, 0.85), 112);
    cloud->eval_fn = cloud_value;
    cloud->revision = 1; /* all panels have the same voxels */
    cloud->extinction = 24;
    ex_color(cloud->albedo, 1, 1, 1);
    cloud->lobes = lobes, cloud->lobe_count = 2;
}

/* Shows a picture enlarged, linear between the middles of its pixels. */
static void enlarge(const float *small, int width, int height, const sps_view *view, const sps_image *out) {
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

/* Paths through dense gas are long, so this renders few pixels, however large the panel is. */
static sps_result render_paths(sps_context *context, const sps_scene *scene, const sps_view *view,
                               const sps_image *image) {
    static const sps_reference_settings paths = {.step = 4, .samples = 96, .seed = 1};
    sps_view few = *view;
    sps_image small = {0};
    few.width = view->width < 50 ? view->width : 50;
    few.height = (view->height * few.width + view->width - 1) / view->width;
    small.rgba = (float *)ex_allocate((size_t)few.width * (size_t)few.height, 4 * sizeof(float));
    const sps_result result = sps_reference(context, scene, &few, &paths, &small);
    enlarge(small.rgba, few.width, few.height, view, image);
    free(small.rgba);
    return result;
}

static sps_result render_way(sps_context *context, const sps_scene *scene, const sps_view *view, int way,
                             const sps_image *image) {
    static const sps_scattering kinds[WAYS] = {SPS_SCATTERING_OFF, SPS_SCATTERING_FORWARD, SPS_SCATTERING_FULL};
    sps_view seen = *view;
    if (way == BY_PATHS) return render_paths(context, scene, view, image);
    seen.scattering = kinds[way];
    return sps_render(context, scene, &seen, image);
}

/* Renders a row for each sun, and a column for each way. The voxels are read before any is timed. */
static int render_panels(ex_session *session, const sps_scene scenes[ROWS], const sps_view *view,
                         const sps_image *picture, double seconds[ROWS][WAYS], ex_error *error) {
    for (int i = -1; i < ROWS * WAYS; ++i) {
        const int row = i < 0 ? 0 : i / WAYS, way = i < 0 ? ONCE : i % WAYS;
        sps_image image = *picture;
        const double start = ex_now(NULL);
        image.rgba += 4 * ((size_t)(row * view->height) * picture->row_pixels + (size_t)(way * view->width));
        if (render_way(session->context, &scenes[row], view, way, &image) != SPS_OK)
            return ex_fail(error, "%s", sps_error(session->context));
        seconds[row][way] = ex_now(NULL) - start;
    }
    return 0;
}

static int make_picture(const sps_scene scenes[ROWS], const sps_view *view, const ex_scene_options *options,
                        ex_error *error) {
    static const char *const names[WAYS] = {"once", "forward", "full", "random paths (sps_reference)"};
    const sps_view panel = ex_scene_view(view, WAYS, options);
    const int width = WAYS * panel.width, height = ROWS * panel.height;
    double seconds[ROWS][WAYS];
    ex_session session;
    sps_image picture;
    if (ex_scene_begin(options, width, height, &session, &picture, error)) return 1;
    int failed = render_panels(&session, scenes, &panel, &picture, seconds, error);
    ex_session_end(&session);
    if (!failed) failed = ex_write_png(options->out, picture.rgba, width, height, error);
    free(picture.rgba);
    if (failed) return 1;
    printf("%s: %d x %d, panels of %d x %d\n", options->out, width, height, panel.width, panel.height);
    for (int i = 0; i < WAYS; ++i)
        printf("  %-30s sun behind %6.2f s, sunset %6.2f s\n", names[i], seconds[BEHIND][i], seconds[SUNSET][i]);
    return 0;
}

int main(int argc, char **argv) {
    static float night[2][3] = {{0.030f, 0.050f, 0.105f}, {0.008f, 0.016f, 0.045f}};
    static float evening[2][3] = {{0.50f, 0.22f, 0.10f}, {0.06f, 0.09f, 0.20f}};
    ex_scene_options options = {"cloud_light.png", 0, 0, 0, 0, 0};
    sps_light suns[ROWS] = {ex_sun(ex_vec_of(-0.5, -0.5, 0.9), 5), ex_sun(ex_vec_of(1, -0.12, -0.35), 5)};
    sps_view view = ex_view(ex_vec_of(0.1, 0.1, 6.5), ex_vec_of(0.07, 0.14, 0), 17);
    sps_scene scenes[ROWS];
    sps_volume cloud = {0};
    ex_error error;
    int status = EX_OK;
    view.width = 200, view.height = 140, view.quality = SPS_QUALITY_MEDIUM;
    set_cloud(&cloud);
    ex_color(suns[SUNSET].color, 5.5, 2.0, 0.6);
    for (int i = 0; i < ROWS; ++i) {
        scenes[i] = ex_scene(&suns[i]);
        scenes[i].volumes = &cloud, scenes[i].volume_count = 1;
        scenes[i].background_user = i == BEHIND ? night : evening;
    }
    ex_color(scenes[BEHIND].ambient, 0.012, 0.02, 0.045);
    ex_color(scenes[SUNSET].ambient, 0.08, 0.12, 0.21);
    if (ex_scene_options_read(argc, argv, &options, &error))
        status = EX_MISTAKEN;
    else if (make_picture(scenes, &view, &options, &error))
        status = EX_FAILED;
    if (status != EX_OK) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    return status;
}
