/* A walk around a cloud above the ground, lit by the sun and by a lamp in its midst. Both lights shade by shadow
   tables, which show what the lights see: the camera may move, and the tables are held from frame to frame. Renders 36
   frames, prints how long the first took and how long the others, and writes six of them side by side. */

#include "densities.h"
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { FRAMES = 36, PANELS = 6 };

static const double cloud_middle[3] = {0, 1.15, 0}, cloud_radius = 0.85;

/* sps_volume.eval_fn: a ball eroded by turbulence, with a hollow about the lamp. */
static int cloud_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p =
            ex_vec_of(positions[0] - cloud_middle[0], positions[1] - cloud_middle[1], positions[2] - cloud_middle[2]);
        const double distance = ex_vec_length(p), depth = cloud_radius - distance;
        out[i] = 0;
        if (depth < 0) continue;
        const double eroded = depth + 0.06 - 0.75 * ex_turbulence(ex_vec_scale(p, 2.1), 5);
        out[i] = (float)(ex_ramp(0, 0.25, eroded) * ex_ramp(0.1, 0.3, distance));
    }
    return 0;
}

static void set_cloud(sps_volume *cloud) {
    static const sps_lobe forward = {0.3f, 1};
    const double *m = cloud_middle, r = cloud_radius;
    ex_volume_box(cloud, ex_vec_of(m[0] - r, m[1] - r, m[2] - r), ex_vec_of(m[0] + r, m[1] + r, m[2] + r), 72);
    cloud->eval_fn = cloud_value, cloud->concurrent = 1;
    cloud->revision = 1; /* it never changes: voxels and tables are held */
    cloud->extinction = 14;
    ex_color(cloud->albedo, 0.97, 0.96, 0.95);
    cloud->lobes = &forward, cloud->lobe_count = 1;
}

static void set_lamp(sps_light *lamp) {
    memset(lamp, 0, sizeof *lamp);
    lamp->kind = SPS_LIGHT_POINT;
    memcpy(lamp->position, cloud_middle, sizeof lamp->position);
    ex_color(lamp->color, 2.4, 1.1, 0.35);
}

/* Frame n of a full turn. */
static sps_camera camera_of(int n) {
    const double angle = 2 * EX_PI * n / FRAMES;
    return ex_camera_at(ex_vec_of(6.4 * sin(angle), 2.9, 6.4 * cos(angle)), ex_vec_of(0, 0.75, 0), 27);
}

/* Seconds of the first frame and of all others, and the tables they made and held. */
typedef struct turn {
    double first, others;
    uint64_t made, held;
} turn;

/* Renders all frames: those of the picture into its panels, the others beside it. */
static int render_turn(ex_session *session, const sps_scene *scene, sps_view *view, const sps_image *picture, turn *out,
                       ex_error *error) {
    const size_t pixels = (size_t)view->width * (size_t)view->height;
    float *aside = (float *)ex_allocate(pixels, 4 * sizeof(float));
    int failed = 0;
    for (int n = 0; n < FRAMES && !failed; ++n) {
        const int panel = n * PANELS / FRAMES, shown = n * PANELS % FRAMES == 0;
        sps_image image = *picture;
        sps_stats_report stats;
        view->camera = camera_of(n);
        image.rgba = shown ? picture->rgba + (size_t)panel * (size_t)view->width * 4 : aside;
        image.row_pixels = shown ? picture->row_pixels : 0;
        const double start = ex_now(NULL);
        if (sps_render(session->context, scene, view, &image) != SPS_OK)
            failed = ex_fail(error, "%s", sps_error(session->context));
        *(n == 0 ? &out->first : &out->others) += ex_now(NULL) - start;
        sps_get_stats(session->context, &stats);
        out->made += stats.tables_made, out->held += stats.tables_held;
    }
    free(aside);
    return failed;
}

/* Renders the turn and writes the picture. */
static int make_picture(const sps_scene *scene, const sps_view *view, const ex_scene_options *options,
                        ex_error *error) {
    sps_view panel = ex_scene_view(view, PANELS, options);
    const int width = PANELS * panel.width, height = panel.height;
    ex_session session;
    sps_image picture;
    turn took = {0, 0, 0, 0};
    if (ex_scene_begin(options, width, height, &session, &picture, error)) return 1;
    int failed = render_turn(&session, scene, &panel, &picture, &took, error);
    ex_session_end(&session);
    if (!failed) failed = ex_write_png(options->out, picture.rgba, width, height, error);
    free(picture.rgba);
    if (failed) return 1;
    printf("%s: %d frames of %d x %d; the first, with %d tables made, in %.3f s; the others in %.3f s on average, "
           "with %d tables held\n",
           options->out, FRAMES, panel.width, panel.height, (int)took.made, took.first, took.others / (FRAMES - 1),
           (int)took.held / (FRAMES - 1));
    return 0;
}

int main(int argc, char **argv) {
    static const float earth[3] = {0.30f, 0.29f, 0.27f};
    ex_scene_options options = {"turntable.png", 0, 0, 0, 0, 0};
    sps_light lights[2] = {ex_sun(ex_vec_of(-0.5, -1.2, -0.3), 5)};
    sps_tmap_settings table = {0};
    sps_scene scene = ex_scene(lights);
    sps_view view = ex_view(ex_vec_of(0, 0, 0), ex_vec_of(0, 0, 1), 27); /* each frame sets the camera */
    sps_volume cloud = {0};
    ex_mesh ground = {0};
    ex_error error;
    int status = EX_OK;
    view.width = 160, view.height = 180, view.quality = SPS_QUALITY_MEDIUM;
    set_cloud(&cloud);
    ex_shape_quad(&ground, ex_vec_of(-400, 0, -400), ex_vec_of(-400, 0, 400), ex_vec_of(400, 0, 400),
                  ex_vec_of(400, 0, -400), earth);
    sps_mesh mesh = ex_shape_mesh(&ground);
    mesh.revision = 1;
    set_lamp(&lights[1]);
    table.technique = SPS_TMAP_TABLE;
    lights[0].shadow_map = lights[1].shadow_map = &table;
    scene.light_count = 2;
    scene.volumes = &cloud, scene.volume_count = 1;
    scene.meshes = &mesh, scene.mesh_count = 1;
    if (ex_scene_options_read(argc, argv, &options, &error))
        status = EX_MISTAKEN;
    else if (make_picture(&scene, &view, &options, &error))
        status = EX_FAILED;
    if (status != EX_OK) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    ex_mesh_free(&ground);
    return status;
}
