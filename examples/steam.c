/* Steam over a glass of tea on a table before a wall, as in figure 8 of Ebert and Parent, who give times for four ways
   to shade it. Above: without shadows; with shadows on surfaces only, not in the steam; with all shadows, by a shadow
   table; with all shadows, by rays (sps_reference). Below: the steam as it rises, 30 frames from picture to picture.
   Prints the times of the four ways, and what they are in proportion to each other. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { UNSHADOWED = 0, ON_SURFACES, BY_TABLE, BY_RAYS, WAYS };
enum { GLASS = 0, TEA, ROOM, MESHES };

/* ================================================================================================= the steam */

#define TEA_HEIGHT 0.62

/* sps_volume.eval_fn; `user` is the number of the frame. Every point moves through turbulence along a helix, downwards,
   so that the steam seems to rise and to curl. It widens with height, and fades away. */
static int steam_value(void *user, size_t count, const double *positions, float *out) {
    const double frame = *(const int *)user, angle = 0.05 * frame;
    const ex_vec drift = ex_vec_of(0.25 * cos(angle), -0.016 * frame, 0.25 * sin(angle));
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double height = p.y - TEA_HEIGHT, bend = 0.12 * height * ex_noise(ex_vec_of(0, 1.1 * (p.y + drift.y), 5));
        const double around = sqrt((p.x - bend) * (p.x - bend) + p.z * p.z) / (0.27 + 0.16 * fmax(height - 0.3, 0));
        out[i] = 0;
        if (height < 0 || around > 1) continue;
        const double eddies = ex_turbulence(ex_vec_add(ex_vec_of(2.6 * p.x, 1.5 * p.y, 2.6 * p.z), drift), 4);
        const double wisps = pow(ex_clamp(1.45 * eddies, 0, 1), 2.6);
        out[i] = (float)(wisps * ex_ramp(1, 0.45, around) * ex_ramp(0, 0.08, height) * ex_ramp(1.6, 0.2, height));
    }
    return 0;
}

static void set_steam(sps_volume *steam, int *frame) {
    static const sps_lobe lobes[2] = {{0.4f, 0.5f}, {-0.4f, 0.5f}};
    ex_volume_box(steam, ex_vec_of(-0.65, TEA_HEIGHT, -0.65), ex_vec_of(0.65, 2.25, 0.65), 96);
    steam->eval_fn = steam_value, steam->concurrent = 1, steam->user = frame;
    steam->extinction = 7;
    ex_color(steam->albedo, 0.98, 0.98, 0.98);
    steam->lobes = lobes, steam->lobe_count = 2;
}

/* ================================================================================================== the room */

/* A drinking glass, with an outer and an inner wall, a thick bottom, and a rim. */
static void build_glass(ex_mesh *mesh) {
    static const float clear[3] = {0.04f, 0.045f, 0.045f};
    static const double foot[4] = {0, 0.005, 0.30, 0.005}, outer[8] = {0.30, 0.005, 0.325, 0.3, 0.36, 0.7, 0.40, 1.0},
                        rim[4] = {0.40, 1.0, 0.375, 1.0}, inner[8] = {0.375, 1.0, 0.335, 0.7, 0.30, 0.3, 0.28, 0.07},
                        bottom[4] = {0.28, 0.07, 0, 0.07};
    const ex_lathe parts[5] = {{foot, 2, {0, 0, 0}, {0, 1, 0}},
                               {outer, 4, {0, 0, 0}, {0, 1, 0}},
                               {rim, 2, {0, 0, 0}, {0, 1, 0}},
                               {inner, 4, {0, 0, 0}, {0, 1, 0}},
                               {bottom, 2, {0, 0, 0}, {0, 1, 0}}};
    for (int i = 0; i < 5; ++i) ex_shape_lathe(mesh, &parts[i], 64, clear, NULL);
}

/* The tea, a little narrower than the glass inside. */
static void build_tea(ex_mesh *mesh) {
    static const float brown[3] = {0.10f, 0.04f, 0.01f};
    static const double side[6] = {0.275, 0.075, 0.295, 0.3, 0.320, TEA_HEIGHT},
                        top[4] = {0.320, TEA_HEIGHT, 0, TEA_HEIGHT};
    const ex_lathe parts[2] = {{side, 3, {0, 0, 0}, {0, 1, 0}}, {top, 2, {0, 0, 0}, {0, 1, 0}}};
    for (int i = 0; i < 2; ++i) ex_shape_lathe(mesh, &parts[i], 64, brown, NULL);
}

static void build_room(ex_mesh *mesh) {
    static const float wall[3] = {0.075f, 0.085f, 0.11f}, wood[2][3] = {{0.30f, 0.16f, 0.08f}, {0.26f, 0.13f, 0.06f}};
    ex_shape_quad(mesh, ex_vec_of(-6, -2, -1.1), ex_vec_of(6, -2, -1.1), ex_vec_of(6, 6, -1.1), ex_vec_of(-6, 6, -1.1),
                  wall);
    for (int i = 0; i < 8; ++i)
        ex_shape_box(mesh, ex_vec_of(-4, -0.1, -0.9 + 0.32 * i), ex_vec_of(4, 0, -0.9 + 0.32 * (i + 1)), wood[i & 1]);
}

static void build_scene(ex_mesh parts[MESHES], sps_mesh meshes[MESHES]) {
    static const float glass[3] = {0.90f, 0.93f, 0.92f}, tea[3] = {0.80f, 0.42f, 0.12f};
    memset(parts, 0, MESHES * sizeof *parts);
    build_glass(&parts[GLASS]);
    build_tea(&parts[TEA]);
    build_room(&parts[ROOM]);
    for (int i = 0; i < MESHES; ++i) meshes[i] = ex_shape_mesh(&parts[i]);
    memcpy(meshes[GLASS].transmittance, glass, sizeof glass);
    memcpy(meshes[TEA].transmittance, tea, sizeof tea);
}

/* =============================================================================================== four ways */

/* Renders the steam without shadows in it, over surfaces with shadows. No light shades surfaces only, so that this is
   the sum of two pictures: of steam that scatters, under a light without shadows, among black surfaces; and of lit
   surfaces behind steam that only absorbs. */
static sps_result render_on_surfaces(sps_context *context, const sps_scene *scene, const sps_view *view,
                                     const sps_image *image) {
    const size_t pixels = (size_t)view->width * (size_t)view->height;
    sps_volume steam = scene->volumes[0];
    sps_mesh meshes[MESHES];
    sps_scene part = *scene;
    sps_view unshadowed = *view;
    sps_image surfaces = *image;
    surfaces.rgba = (float *)ex_allocate(pixels, 4 * sizeof(float));
    surfaces.row_pixels = 0;
    memset(steam.albedo, 0, sizeof steam.albedo);
    part.volumes = &steam;
    sps_result result = sps_render(context, &part, view, &surfaces);
    part.volumes = scene->volumes;
    part.meshes = meshes;
    part.background_fn = NULL; /* it has been added */
    for (int i = 0; i < MESHES; ++i) {
        meshes[i] = scene->meshes[i];
        meshes[i].has_albedos = 0;
        memset(meshes[i].albedo, 0, sizeof meshes[i].albedo);
    }
    unshadowed.no_shadows = 1;
    if (result == SPS_OK) result = sps_render(context, &part, &unshadowed, image);
    for (size_t i = 0; i < pixels && result == SPS_OK; ++i)
        for (size_t c = 0; c < 3; ++c)
            image->rgba[4 * (i / (size_t)view->width * image->row_pixels + i % (size_t)view->width) + c] +=
                surfaces.rgba[4 * i + c];
    free(surfaces.rgba);
    return result;
}

static sps_result render_way(sps_context *context, const sps_scene *scene, const sps_view *view, int way,
                             const sps_image *image) {
    static const sps_tmap_settings table = {0}; /* zeros: a shadow table */
    static const sps_reference_settings traced = {.step = 1};
    sps_light lamp = scene->lights[0];
    sps_scene shaded = *scene;
    sps_view seen = *view;
    seen.no_shadows = way == UNSHADOWED;
    shaded.lights = &lamp;
    if (way == BY_TABLE) lamp.shadow_map = &table, lamp.shadow_map_resolution = 64;
    if (way == ON_SURFACES) return render_on_surfaces(context, scene, view, image);
    if (way == BY_RAYS) return sps_reference(context, scene, view, &traced, image);
    return sps_render(context, &shaded, &seen, image);
}

/* ============================================================================================== the picture */

/* Renders the upper row, a way after the other, and the lower one, a frame after the other. */
static int render_panels(ex_session *session, sps_scene *scene, sps_volume *steam, const sps_view *view,
                         const sps_image *picture, double seconds[WAYS], ex_error *error) {
    for (int i = 0; i < 2 * WAYS; ++i) {
        const int row = i / WAYS, column = i % WAYS;
        sps_image image = *picture;
        const double start = ex_now(NULL);
        image.rgba += 4 * ((size_t)(row * view->height) * picture->row_pixels + (size_t)(column * view->width));
        *(int *)steam->user = row ? 30 * (column + 1) : 0;
        steam->revision = 1 + (uint64_t)i; /* each evaluates the steam */
        if (render_way(session->context, scene, view, row ? BY_TABLE : column, &image) != SPS_OK)
            return ex_fail(error, "%s", sps_error(session->context));
        if (row == 0) seconds[column] = ex_now(NULL) - start;
    }
    return 0;
}

static int make_picture(sps_scene *scene, sps_volume *steam, const sps_view *view, const ex_scene_options *options,
                        ex_error *error) {
    static const char *const names[WAYS] = {"no shadows", "shadows on surfaces only", "a shadow table",
                                            "rays (sps_reference)"};
    static const int minutes[WAYS] = {80, 101, 127, 1800}; /* of the paper */
    sps_view panel = ex_scene_view(view, WAYS, options);
    const int width = WAYS * panel.width, height = 2 * panel.height;
    double seconds[WAYS];
    ex_session session;
    sps_image picture;
    panel.coverage_samples = 2; /* sps_reference marches a ray through the steam for each */
    if (ex_scene_begin(options, width, height, &session, &picture, error)) return 1;
    int failed = render_panels(&session, scene, steam, &panel, &picture, seconds, error);
    ex_session_end(&session);
    if (!failed) failed = ex_write_png(options->out, picture.rgba, width, height, error);
    free(picture.rgba);
    if (failed) return 1;
    printf("%s: %d x %d, panels of %d x %d\n", options->out, width, height, panel.width, panel.height);
    for (int i = 0; i < WAYS; ++i)
        printf("  %-26s %8.2f s, %7.2f times the first (Ebert and Parent: %4d minutes, %5.2f)\n", names[i], seconds[i],
               seconds[i] / seconds[0], minutes[i], minutes[i] / 80.0);
    return 0;
}

int main(int argc, char **argv) {
    ex_scene_options options = {"steam.png", 0, 0, 0, 0, 0};
    sps_light lamp = ex_sun(ex_vec_of(0.5, -0.5, -1), 6.0);
    sps_view view = ex_view(ex_vec_of(-0.3, 1.7, 5.2), ex_vec_of(0.22, 1.0, 0), 25);
    sps_scene scene = ex_scene(&lamp);
    sps_volume steam = {0};
    ex_mesh parts[MESHES];
    sps_mesh meshes[MESHES];
    ex_error error;
    int frame = 0, status = EX_OK;
    view.width = 180, view.height = 200, view.quality = SPS_QUALITY_MEDIUM;
    set_steam(&steam, &frame);
    build_scene(parts, meshes);
    scene.volumes = &steam, scene.volume_count = 1;
    scene.meshes = meshes, scene.mesh_count = MESHES;
    if (ex_scene_options_read(argc, argv, &options, &error))
        status = EX_MISTAKEN;
    else if (make_picture(&scene, &steam, &view, &options, &error))
        status = EX_FAILED;
    if (status != EX_OK) fprintf(stderr, "%s: %s\n", argv[0], error.text);
    for (int i = 0; i < MESHES; ++i) ex_mesh_free(&parts[i]);
    return status;
}
