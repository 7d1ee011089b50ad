/* sparse: memory of volumes, in bytes per set voxel, beyond what the same frame takes for a volume of one set voxel:
   gathered at about a voxel per pixel and at four voxels per pixel, and splatted; beside it the plan's bound of reading
   and of bricks.
   sparse cloud      535 puffs of radius 16 in 1000^3 voxels, of which 0.9 % are set
   sparse isolated   one set voxel in each 16^3 of 512^3
   sparse bonsai     the scan, with SPLATSHADOW_DATA=folder
   sparse levels     the cloud's 9.5 million voxels in 4000^3: calls of range_fn, and seconds of plan and reading,
                     without and with range_levels, in turns
   Without a name: all four. */

#define _POSIX_C_SOURCE 200809L
#include "splatshadow.h"
#include "puffs.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { WIDE = 4000, WIDE_FIRST = 1400, ROUNDS = 3 };
enum { APART = 16, ISOLATED = 512, BONSAI = 256 };

static int isolated_read(void *user, const int lo[3], const int size[3], float *values) {
    (void)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) {
        const int at[3] = {lo[0] + i % size[0], lo[1] + i / size[0] % size[1], lo[2] + i / (size[0] * size[1])};
        const uint32_t cell = (uint32_t)((at[2] / APART * 64 + at[1] / APART) * 64 + at[0] / APART);
        const uint32_t hash = (cell * 2654435761u) >> 16;
        const int place = (at[2] % APART * APART + at[1] % APART) * APART + at[0] % APART;
        values[i] = (int)(hash % (APART * APART * APART)) == place;
    }
    return 0;
}

static int one_read(void *user, const int lo[3], const int size[3], float *values) {
    const int at = *(const int *)user / 2;
    int inside = 1, place = 0;
    for (int k = 2; k >= 0; --k) {
        inside &= at >= lo[k] && at < lo[k] + size[k];
        place = place * size[k] + at - lo[k];
    }
    if (inside) values[place] = 1;
    return 0;
}

typedef struct measured {
    double voxels, bytes, planned, seconds;
    uint64_t samples;
} measured;

static double seconds_now(void *user) {
    struct timespec now;
    (void)user;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Memory that a context holds after a frame of a cube of `edge` voxels. */
static measured measure(const sps_volume *volume, int edge, int width, sps_filling filling) {
    static float rgba[4 * 1024 * 1024];
    const sps_scene scene = {.volumes = volume, .volume_count = 1, .ambient = {1, 1, 1}};
    const sps_view view = {.width = width,
                           .height = width,
                           .camera = {.position = {0, 0, 2.0 * edge}, .up = {0, 1, 0}, .ortho_height = edge},
                           .filling = filling,
                           .scattering = SPS_SCATTERING_SINGLE};
    const sps_config config = {.clock_fn = seconds_now};
    const sps_image image = {.rgba = rgba};
    sps_context *context = sps_create(&config, NULL);
    sps_plan_report plan;
    sps_stats_report stats;
    if (!context || sps_plan(context, &scene, &view, &plan) || sps_render(context, &scene, &view, &image)) {
        printf("sparse: %s\n", sps_error(context));
        exit(1);
    }
    sps_get_stats(context, &stats);
    sps_destroy(context);
    const measured m = {(double)stats.voxels_relevant, (double)stats.bytes, (double)plan.pass[SPS_PASS_GATHER].bytes,
                        stats.seconds_total, stats.eye_samples};
    return m;
}

static void report(const char *name, sps_volume volume, int edge) {
    static const struct {
        const char *name;
        int coarser;
        sps_filling filling;
    } frames[] = {{"gathered, a voxel per pixel", 1, SPS_FILLING_GATHER},
                  {"gathered, four voxels per pixel", 4, SPS_FILLING_GATHER},
                  {"splatted", 4, SPS_FILLING_SPLAT}};
    sps_volume one = volume;
    volume.size[0] = volume.size[1] = volume.size[2] = edge;
    volume.placement.axis[0][0] = volume.placement.axis[1][1] = volume.placement.axis[2][2] = edge;
    for (int k = 0; k < 3; ++k) volume.placement.origin[k] = -0.5 * edge;
    volume.extinction = 0.05f;
    volume.albedo[0] = volume.albedo[1] = volume.albedo[2] = 0.8f;
    one = volume;
    one.read_fn = one_read, one.range_fn = NULL, one.user = &edge;
    for (size_t i = 0; i < sizeof frames / sizeof *frames; ++i) {
        const int width = (edge + frames[i].coarser - 1) / frames[i].coarser;
        const measured all = measure(&volume, edge, width, frames[i].filling);
        const measured least = measure(&one, edge, width, frames[i].filling);
        printf("%-8s %8.0f voxels  %-32s %6.1f bytes per voxel, planned %6.0f; %.2f s%s\n", name, all.voxels,
               frames[i].name, (all.bytes - least.bytes) / all.voxels, all.planned / all.voxels, all.seconds,
               all.samples > 0 || frames[i].filling == SPS_FILLING_SPLAT ? "" : " (not gathered)");
    }
}

static int bonsai_read(const char *folder, sps_grid *grid) {
    char path[512];
    const size_t count = (size_t)BONSAI * BONSAI * BONSAI;
    void *voxels = malloc(count);
    snprintf(path, sizeof path, "%s/bonsai_256x256x256_u8.raw", folder);
    FILE *file = fopen(path, "rb");
    const int complete = voxels && file && fread(voxels, 1, count, file) == count;
    if (file) fclose(file);
    memset(grid, 0, sizeof *grid);
    grid->voxels = voxels;
    grid->size[0] = grid->size[1] = grid->size[2] = BONSAI;
    grid->format = SPS_VOXEL_U8;
    return complete;
}

/* The cloud somewhere in a much larger volume. */
static int wide_read(void *user, const int lo[3], const int size[3], float *values) {
    const int from[3] = {lo[0] - WIDE_FIRST, lo[1] - WIDE_FIRST, lo[2] - WIDE_FIRST};
    return cloud_read(user, from, size, values);
}

static int wide_range(void *user, const int lo[3], const int size[3], float range[2]) {
    const int from[3] = {lo[0] - WIDE_FIRST, lo[1] - WIDE_FIRST, lo[2] - WIDE_FIRST};
    return cloud_range(user, from, size, range);
}

/* Adds the seconds that a plan and the reading of a first frame take. */
static sps_stats_report levels_once(sps_volume volume, int levels, double seconds[2]) {
    static float rgba[4 * 64 * 64];
    const sps_scene scene = {.volumes = &volume, .volume_count = 1, .ambient = {1, 1, 1}};
    const sps_view view = {.width = 64,
                           .height = 64,
                           .camera = {.position = {0, 0, 2.0 * WIDE}, .up = {0, 1, 0}, .ortho_height = WIDE},
                           .quality = SPS_QUALITY_DRAFT,
                           .scattering = SPS_SCATTERING_SINGLE};
    const sps_config config = {.clock_fn = seconds_now};
    const sps_image image = {.rgba = rgba};
    sps_context *context = sps_create(&config, NULL);
    const double start = seconds_now(NULL);
    sps_plan_report plan;
    sps_stats_report stats;
    volume.range_levels = levels;
    if (!context || sps_plan(context, &scene, &view, &plan)) exit(1);
    seconds[0] += seconds_now(NULL) - start;
    if (sps_render(context, &scene, &view, &image)) exit(1);
    sps_get_stats(context, &stats);
    seconds[1] += stats.seconds_gather;
    sps_destroy(context);
    return stats;
}

static void report_levels(void) {
    sps_volume volume = {
        .size = {WIDE, WIDE, WIDE},
        .placement = {{-0.5 * WIDE, -0.5 * WIDE, -0.5 * WIDE}, {{WIDE, 0, 0}, {0, WIDE, 0}, {0, 0, WIDE}}},
        .read_fn = wide_read,
        .range_fn = wide_range,
        .extinction = 0.05f};
    double seconds[4][2] = {{0, 0}, {0, 0}, {0, 0}, {0, 0}};
    sps_stats_report stats[4];
    puff_count = PUFFS_WIDE;
    for (int n = 0; n < 4 * ROUNDS; ++n) stats[n % 4] = levels_once(volume, n % 4, seconds[n % 4]);
    for (int n = 0; n < 4; ++n)
        printf("levels %d  %8.0f voxels  %8.0f calls of range_fn; plan %.4f s (%.3f), reading %.4f s (%.3f)\n", n,
               (double)stats[n].voxels_relevant, (double)stats[n].range_calls, seconds[n][0] / ROUNDS,
               seconds[n][0] / seconds[0][0], seconds[n][1] / ROUNDS, seconds[n][1] / seconds[0][1]);
}

int main(int count, char **arguments) {
    const char *only = count > 1 ? arguments[1] : NULL, *folder = getenv("SPLATSHADOW_DATA");
    const sps_volume cloud = {.read_fn = cloud_read, .range_fn = cloud_range}, isolated = {.read_fn = isolated_read};
    sps_grid grid;
    const sps_volume bonsai = {.read_fn = sps_grid_read, .range_fn = sps_grid_range, .user = &grid};
    puffs_place();
    if (!only || !strcmp(only, "cloud")) report("cloud", cloud, CLOUD);
    if (!only || !strcmp(only, "isolated")) report("isolated", isolated, ISOLATED);
    if (!only || !strcmp(only, "levels")) report_levels();
    puff_count = PUFFS;
    if (folder && (!only || !strcmp(only, "bonsai")) && bonsai_read(folder, &grid)) {
        report("bonsai", bonsai, BONSAI);
        free((void *)(uintptr_t)grid.voxels);
    }
    return 0;
}
