/* Step 2 of docs/tutorial.md: bytes in memory, as a scanner writes them, through sps_grid and a transfer function. */

#include "splatshadow.h"
#include "../picture.h"

enum { WIDTH = 320, HEIGHT = 240, SIDE = 128 };

static uint8_t voxels[SIDE][SIDE][SIDE]; /* z, y, x: x runs fastest */

/* 1 inside, 0 outside, and a slope of two voxels between: a scanner's voxels are averages. `depth` is in voxels. */
static double inside(double depth) { return fmin(fmax(0.5 + 0.5 * depth, 0), 1); }

/* A ball of bone, which is a network of walls, in soft tissue that is cut open towards the viewer. */
static double tissue(double x, double y, double z) {
    const double r = sqrt(x * x + y * y + z * z);
    const double wall = sin(8 * x) * cos(8 * y) + sin(8 * y) * cos(8 * z) + sin(8 * z) * cos(8 * x);
    const double bone = inside(SIDE / 2 * (0.75 - r)) * inside(SIDE / 2 * (0.45 - fabs(wall)) / 12);
    const double soft = inside(SIDE / 2 * (0.9 - r)) * inside(SIDE / 2 * fmax(-x - 0.1, -z - 0.2));
    return fmax(0.85 * bone, 0.3 * soft);
}

static void make_scan(void) {
    for (int k = 0; k < SIDE; ++k)
        for (int j = 0; j < SIDE; ++j)
            for (int i = 0; i < SIDE; ++i) {
                const double unit = 2.0 / SIDE;
                voxels[k][j][i] =
                    (uint8_t)(255 * tissue((i + 0.5) * unit - 1, (j + 0.5) * unit - 1, (k + 0.5) * unit - 1));
            }
}

static void print_stats(const sps_context *context, const char *what) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    printf("%s: %llu blocks read, %llu skipped, %llu voxels relevant, %.1f M samples, %.1f M fragments for the eye\n",
           what, (unsigned long long)stats.read_calls, (unsigned long long)stats.blocks_skipped,
           (unsigned long long)stats.voxels_relevant, 1e-6 * (double)stats.eye_samples,
           1e-6 * (double)stats.eye_fragments);
}

int main(int argc, char **argv) {
    static float rgba[WIDTH * HEIGHT * 4];
    /* value, color, extinction, emission: a voxel is 2 / 128 wide, so that bone is opaque within one or two of them. */
    static const sps_transfer_point look[] = {{0.10f, {0.75f, 0.25f, 0.15f}, 0, {0, 0, 0}},
                                              {0.30f, {0.75f, 0.25f, 0.15f}, 5, {0, 0, 0}},
                                              {0.45f, {0.90f, 0.80f, 0.60f}, 60, {0, 0, 0}},
                                              {0.70f, {0.95f, 0.90f, 0.80f}, 250, {0, 0, 0}}};
    const sps_transfer transfer = {.points = look, .point_count = sizeof look / sizeof *look};
    make_scan();

    sps_grid grid = {.voxels = voxels, .format = SPS_VOXEL_U8, .size = {SIDE, SIDE, SIDE}};
    grid.scale = 1 / 255.0f; /* bytes become values 0..1, as `look` has them */
    sps_volume scan = {.size = {SIDE, SIDE, SIDE}, .placement = {{-1, -1, -1}, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}}};
    scan.read_fn = sps_grid_read, scan.range_fn = sps_grid_range, scan.user = &grid;
    scan.transfer = &transfer, scan.shading = SPS_SHADING_SURFACE;
    scan.specular = 0.15f;
    scan.revision = 1; /* to be raised whenever `voxels` change */

    sps_light lamp = {.direction = {0.7, -1, -0.8}, .color = {4, 3.9f, 3.7f}};
    sps_scene scene = {.volumes = &scan, .volume_count = 1, .lights = &lamp, .light_count = 1};
    for (int c = 0; c < 3; ++c) scene.ambient[c] = 0.12f, scene.background[c] = 0.02f;

    sps_view view = {.width = WIDTH, .height = HEIGHT, .scattering = SPS_SCATTERING_SINGLE};
    view.camera = (sps_camera){.position = {1.6, 1.5, 4}, .up = {0, 1, 0}, .field_of_view = 0.5};
    sps_image image = {.rgba = rgba};

    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), 1;
    if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
    print_stats(context, "first frame");
    lamp.direction[0] = -0.5; /* the light moves, the voxels are held */
    if (sps_render(context, &scene, &view, &image)) return puts(sps_error(context)), 1;
    print_stats(context, "second frame");
    sps_destroy(context);

    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "2_scan.png", rgba, WIDTH, HEIGHT, &error)) return puts(error.text), 1;
    return 0;
}
