/* Step 5 of docs/tutorial.md: a draft at once, then one tile after the other at a higher quality. */

#include "splatshadow.h"
#include "../picture.h"

enum { WIDTH = 384, HEIGHT = 256, TILE = 128, DRAFT = 4 }; /* TILE: a multiple of 64; DRAFT: pixels on a side */

/* The window of this program is a file: a viewer that watches it shows the picture as it comes. */
typedef struct window {
    const char *path;
    float rgba[HEIGHT][WIDTH][4];
} window;

static int show(const window *w, const char *what) {
    ex_error error;
    if (ex_write_picture(w->path, w->rgba[0][0], WIDTH, HEIGHT, &error)) return puts(error.text), 1;
    printf("%s\n", what);
    return 0;
}

/* sps_volume.eval_fn: a wreath of smoke, twisted strands on a ring. */
static int wreath(void *user, size_t count, const double *xyz, float *density) {
    (void)user;
    for (size_t i = 0; i < count; ++i, xyz += 3) {
        const double ring = atan2(xyz[2], xyz[0]), out = hypot(xyz[0], xyz[2]) - 0.7;
        const double around = atan2(xyz[1], out), away = hypot(out, xyz[1]);
        const double strand = 0.14 + 0.07 * sin(3 * around + 9 * ring) + 0.02 * sin(7 * around - 20 * ring);
        density[i] = (float)fmin(fmax((strand - away) / 0.06, 0), 1);
    }
    return 0;
}

/* The whole picture, in a sixteenth of the pixels, each of which fills a square of the window. */
static int draw_draft(sps_context *context, const sps_scene *scene, const sps_view *view, window *w) {
    static float small[HEIGHT / DRAFT][WIDTH / DRAFT][4];
    const sps_image image = {.rgba = small[0][0]};
    sps_view draft = *view;
    draft.width = WIDTH / DRAFT, draft.height = HEIGHT / DRAFT;
    draft.quality = SPS_QUALITY_DRAFT;
    if (sps_render(context, scene, &draft, &image)) return puts(sps_error(context)), 1;
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) memcpy(w->rgba[y][x], small[y / DRAFT][x / DRAFT], sizeof w->rgba[y][x]);
    return show(w, "draft");
}

/* A tile of the picture, straight into its place in the window. */
static int draw_tile(sps_context *context, const sps_scene *scene, const sps_view *view, window *w, int x, int y) {
    const sps_image image = {.rgba = w->rgba[y][x], .row_pixels = WIDTH};
    sps_view tile = *view;
    sps_stats_report stats;
    char what[100];
    tile.region[0] = x, tile.region[1] = y, tile.region[2] = tile.region[3] = TILE;
    if (sps_render(context, scene, &tile, &image)) return puts(sps_error(context)), 1;
    sps_get_stats(context, &stats);
    snprintf(what, sizeof what, "tile at %3d, %3d: %.2f M samples for the eye, %.2f M for the light; %.0f M fragments",
             x, y, 1e-6 * (double)stats.eye_samples, 1e-6 * (double)stats.light_samples,
             1e-6 * (double)(stats.eye_fragments + stats.light_fragments));
    return show(w, what);
}

int main(int argc, char **argv) {
    static const float corners[] = {-9, -0.6f, 5, 0, -0.6f, -20, 9, -0.6f, 5};
    static window w;
    w.path = argc > 1 ? argv[1] : "5_progressive.png";
    sps_volume smoke = {.size = {128, 48, 128}, .eval_fn = wreath, .extinction = 14, .albedo = {0.9f, 0.85f, 0.8f}};
    smoke.placement = (sps_placement){{-1, -0.375, -1}, {{2, 0, 0}, {0, 0.75, 0}, {0, 0, 2}}};
    smoke.revision = 1; /* the draft reads the voxels, all tiles use them */
    sps_indexed_mesh ground = {.vertex_count = 3, .positions = corners, .triangle_count = 1};
    sps_mesh mesh = {.triangle_count = 1, .read_fn = sps_indexed_mesh_read, .user = &ground, .revision = 1};
    mesh.albedo[0] = 0.25f, mesh.albedo[1] = 0.3f, mesh.albedo[2] = 0.35f;
    sps_light sun = {.direction = {0.8, -1, -0.3}, .color = {8, 7.5f, 7}};
    sps_scene scene = {.volumes = &smoke, .volume_count = 1, .meshes = &mesh, .mesh_count = 1};
    scene.lights = &sun, scene.light_count = 1;
    for (int c = 0; c < 3; ++c) scene.ambient[c] = 0.1f, scene.background[c] = 0.3f + 0.1f * (float)c;

    sps_view view = {.width = WIDTH, .height = HEIGHT, .quality = SPS_QUALITY_HIGH};
    view.scattering = SPS_SCATTERING_SINGLE;
    view.camera =
        (sps_camera){.position = {0, 2.2, 3.6}, .target = {0, -0.15, 0}, .field_of_view = 0.52, .up = {0, 1, 0}};
    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;
    if (draw_draft(context, &scene, &view, &w)) return 1;
    for (int y = 0; y < HEIGHT; y += TILE)
        for (int x = 0; x < WIDTH; x += TILE)
            if (draw_tile(context, &scene, &view, &w, x, y)) return 1;
    sps_destroy(context);
    return 0;
}
