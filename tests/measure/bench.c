/* bench: how fast, and how exact for the time. Times are medians of frames that take turns, within one run, so that
   ratios hold on a machine of any speed; each figure stands on its own line with the project's target beside it.
   bench            everything; with SPLATSHADOW_DATA=folder, where the scans of bonsai and smoke lie, those too
   bench speed      without the tables of error against time
   bench default    what the default mode takes beside single scattering, and other ratios with goals, in Markdown
   bench goals      the project's goals of speed, as a table in Markdown
   bench curves DIR how time grows with image, slabs, voxels and lights: in Markdown, and as charts in the folder
   bench frames, bench single, bench before
                    rows that turns.sh asks for line by line, to compare builds: three frames, the default mode beside
                    single scattering, frames beside an older header's
   bench basics     the bonsai, splatting and empty space
   bench filling    splatting and gathering
   bench lights     sharp and soft shadows
   bench polygons   the tree of triangles, shadow rays, rasterising and textures alone
   bench edges      samples of polygons' edges: error and time; with SPLATSHADOW_DATA also of the teapot there
   bench scattering light scattered once, forward and in every direction: times
   bench paths      multiple scattering by random paths and by each grade, error against time
   bench maps       making and querying transmittance maps alone
   bench cheapest   for each of some errors the cheapest setting that has no more, in Markdown
   bench accuracy   the tables of error against time alone */

#include "bench_map_particles.h"
#include "measuring.h"
#include "particles.h"
#include "scans.h"
#include "shapes.h"
#include "picture.h"
#include "chart.h"
#include "bench_scenes.h"
#include "bench_search.h"
#include "bench_goals.h"
#include "bench_curves.h"
#include "puffs.h"
#include "bench_default.h"

#define TARGET_ERROR 0.001

/* ================================================================================================= figures */

/* One measured number. Bounds that are not finite are none. */
static void figure(const char *what, double value, const char *unit, double low, double high) {
    char target[48] = "";
    if (low > -DBL_MAX && high < DBL_MAX)
        snprintf(target, sizeof target, "%g..%g", low, high);
    else if (high < DBL_MAX)
        snprintf(target, sizeof target, "<= %.4g", high);
    else if (low > -DBL_MAX)
        snprintf(target, sizeof target, ">= %.4g", low);
    printf("  %-66s %9.4g %-4s %-10s", what, value, unit, target);
    if (value > high)
        printf(" missed by %.1f %%", 100 * (value / high - 1));
    else if (value < low)
        printf(" missed by %.1f %%", 100 * (1 - value / low));
    else if (*target)
        printf(" met");
    printf("\n");
    fflush(stdout);
}

static void at_most(const char *what, double value, const char *unit, double bound) {
    figure(what, value, unit, -HUGE_VAL, bound);
}

static void at_least(const char *what, double value, const char *unit, double bound) {
    figure(what, value, unit, bound, HUGE_VAL);
}

static void plain(const char *what, double value, const char *unit) { figure(what, value, unit, -HUGE_VAL, HUGE_VAL); }

/* ================================================================================================== bonsai */

/* Bytes of a context that has rendered the frame and nothing else; the share of its workers' tiles apart, which is
   told from the peaks with one worker and with two. */
static void bonsai_memory(const frame *f, sps_filling filling) {
    size_t peak[2];
    sps_view view = f->view;
    sps_plan_report plan;
    sps_stats_report stats;
    view.filling = filling;
    for (int i = 0; i < 2; ++i) {
        ex_session session;
        ex_session_measure(&session, program, 1 + i);
        render_seconds(&session, f, &view);
        sps_get_stats(session.context, &stats);
        peak[i] = stats.bytes_peak;
        /* after the render, since now the bounds of the voxels are known */
        ex_stop_unless_ok(sps_plan(session.context, &f->scene, &view, &plan), program, &session);
        ex_session_end(&session);
    }
    const double tile = (double)(peak[1] - peak[0]), image = f->view.width * (double)f->view.height;
    const double shadow = plan.shadow_width * (double)plan.shadow_height;
    const double held = 1e-6 * ((double)peak[0] - tile);
    const double allowed = 48 * (double)stats.voxels_relevant + 96 * (image + shadow);
    if (filling != SPS_FILLING_SPLAT) {
        plain("peak memory without workers' tiles, gathered", held, "MB");
        return;
    }
    printf("    allowed: 48 bytes for each of %.3f M voxels, 96 for each of %.0f pixels and %.0f x %.0f texels\n",
           1e-6 * (double)stats.voxels_relevant, image, (double)plan.shadow_width, (double)plan.shadow_height);
    at_most("peak memory without workers' tiles, splatted", held, "MB", 1e-6 * allowed);
    plain("and a tile of sheets for each worker", 1e-6 * tile, "MB");
}

static void bonsai_speed(frame *f, const char *name, sps_shading shading, ex_session *one, ex_session *two) {
    contender c[3];
    f->volume.shading = shading;
    contender_set(&c[0], two, f, 0);
    contender_set(&c[1], one, f, 0);
    contender_set(&c[2], one, f, 0);
    c[2].view.filling = SPS_FILLING_SPLAT;
    race(c, 3, REPEATS);
    printf(" shaded as %s\n", name);
    at_most("frame at medium, 512 x 512, 2 workers, voxels held", c[0].seconds, "s", 0.6);
    print_stages(&c[0].stats);
    plain("1 worker", c[1].seconds, "s");
    plain("1 worker, splatted: footprints instead of samples", c[2].seconds, "s");
    print_stages(&c[2].stats);
    at_least("fragments, sorting and shading included, on one core", 1e-9 * fragments_per_second(&c[2].stats), "G/s",
             3);
}

static void bench_bonsai(void) {
    ex_grid grid;
    ex_session one, two;
    sps_stats_report stats;
    frame f;
    printf("\nBonsai scan, 256^3 voxels, transfer function, one directional light\n");
    if (bonsai_load(&grid)) return;
    ex_session_measure(&one, program, 1);
    ex_session_measure(&two, program, WORKERS);
    bonsai_frame(&f, &grid);
    const double first = render_seconds(&two, &f, &f.view);
    sps_get_stats(two.context, &stats);
    figure("relevant voxels", 100 * (double)stats.voxels_relevant / (256.0 * 256 * 256), "%", 8, 15);
    plain("first frame, in which the voxels are read", first, "s");
    bonsai_speed(&f, "a surface", SPS_SHADING_SURFACE, &one, &two);
    bonsai_speed(&f, "a gas", SPS_SHADING_GAS, &one, &two);
    f.volume.shading = SPS_SHADING_SURFACE;
    bonsai_memory(&f, SPS_FILLING_SPLAT);
    bonsai_memory(&f, SPS_FILLING_AUTO);
    ex_session_end(&two);
    ex_session_end(&one);
    frame_end(&f);
    ex_grid_free(&grid);
}

/* ============================================================================ a block of voxels, and where it lies */

/* A cube of `edge` voxels in the middle of a volume of `size`^3; elsewhere 0. */
typedef struct block {
    int size, edge;
} block;

static int block_holds(const block *b, int at) {
    const int first = (b->size - b->edge) / 2;
    return at >= first && at < first + b->edge;
}

static int block_read(void *user, const int lo[3], const int size[3], float *out) {
    const block *b = (const block *)user;
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y)
            for (int x = lo[0]; x < lo[0] + size[0]; ++x) {
                const int inside = block_holds(b, x) && block_holds(b, y) && block_holds(b, z);
                *out++ = inside ? 1 + 0.125f * (float)((x ^ y ^ z) & 7) : 0;
            }
    return 0;
}

static int block_range(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    const block *b = (const block *)user;
    const int first = (b->size - b->edge) / 2;
    int meets = 1;
    for (int i = 0; i < 3; ++i) meets &= lo[i] < first + b->edge && lo[i] + size[i] > first;
    out_min_max[0] = 0, out_min_max[1] = meets ? 2.0f : 0.0f;
    return 0;
}

/* Voxels of edge 1 about the origin, seen from far enough that `pixels` of the image are one voxel. */
static void block_frame(frame *f, block *b, int width, double pixels, uint64_t revision) {
    static const double eye[3] = {1.2, 0.9, 2.4}, light[3] = {-1, -1.3, 0.4};
    frame_begin(f, width, width);
    for (int i = 0; i < 3; ++i) {
        f->volume.size[i] = b->size;
        f->volume.placement.origin[i] = -0.5 * b->size;
        f->volume.placement.axis[i][i] = b->size;
        f->volume.albedo[i] = 0.9f, f->light.color[i] = 3;
    }
    f->volume.read_fn = block_read, f->volume.range_fn = block_range, f->volume.user = b;
    f->volume.revision = revision;
    f->volume.extinction = 0.01f; /* so thin that no ray ends early */
    memcpy(f->light.direction, light, sizeof light);
    for (int i = 0; i < 3; ++i) f->view.camera.position[i] = 100 * eye[i];
    f->view.camera.ortho_height = width / pixels;
}

/* The shadow_resolution that gives a voxel this number of texels, by what `medium` plans for one. Two texels of border
   on each side are not among them. */
static int texels_for(const ex_session *session, const frame *f, int texels) {
    sps_plan_report plan;
    ex_stop_unless_ok(sps_plan(session->context, &f->scene, &f->view, &plan), program, session);
    const int longer = plan.shadow_width > plan.shadow_height ? plan.shadow_width : plan.shadow_height;
    return texels * (longer - 4) + 4;
}

static void bench_splatting(void) {
    static const double thickness[2] = {1, 4};
    block b = {64, 64};
    frame f;
    ex_session one;
    printf("\nSplatting: 64^3 voxels of 4 pixels, and of 4 texels of the shadow buffer\n");
    ex_session_measure(&one, program, 1);
    block_frame(&f, &b, 512, 4, 1);
    f.view.filling = SPS_FILLING_SPLAT;
    f.view.shadow_resolution = texels_for(&one, &f, 4);
    for (int i = 0; i < 2; ++i) {
        contender c;
        char what[80];
        f.view.slab_thickness = thickness[i];
        contender_set(&c, &one, &f, 0);
        race(&c, 1, REPEATS);
        snprintf(what, sizeof what, "fragments on one core, slabs of %g voxels", thickness[i]);
        at_least(what, 1e-9 * fragments_per_second(&c.stats), "G/s", 3);
        print_stages(&c.stats);
    }
    ex_session_end(&one);
    frame_end(&f);
}

/* The same voxels in volumes of two sizes: held from frame to frame, or read for each. */
static void bench_empty_space(void) {
    block blocks[2] = {{128, 60}, {256, 60}};
    printf("\nEmpty space: the same 60^3 voxels alone in 128^3 and in 256^3\n");
    for (int read = 0; read < 2; ++read) {
        frame frames[2];
        ex_session sessions[2];
        contender c[2];
        char what[80];
        for (int i = 0; i < 2; ++i) {
            ex_session_measure(&sessions[i], program, WORKERS);
            block_frame(&frames[i], &blocks[i], 512, 4, read ? 0 : 1);
            contender_set(&c[i], &sessions[i], &frames[i], 0);
        }
        race(c, 2, 9);
        snprintf(what, sizeof what, "256^3 / 128^3 time, voxels %s (%.3f s, %.3f s)",
                 read ? "read for every frame" : "held", c[1].seconds, c[0].seconds);
        figure(what, c[1].seconds / c[0].seconds, "", 0.85, 1.15);
        for (int i = 0; i < 2; ++i) ex_session_end(&sessions[i]), frame_end(&frames[i]);
    }
}

/* ========================================================================================== transmittance maps */

enum { MAP_QUERIES = 400000, MAP_SIZE = 512 };

/* What all maps of the table are made of, and where they are queried. Stays where it is: the scene points into it. */
typedef struct map_trial {
    sps_particles particles;
    sps_scene scene;
    sps_tmap_light light;
    double inserts; /* intervals of particles that meet the texels' rays: what every technique has to take in */
    double *positions;
    float *depths;
} map_trial;

static double map_insert_count(const ex_session *session, const map_trial *trial) {
    sps_tmap_settings settings; /* an exact map has them all in its lists */
    memset(&settings, 0, sizeof settings);
    settings.technique = SPS_TMAP_DEEP;
    settings.far_depth = 10;
    sps_tmap *map = ex_tmap_build(session, program, &trial->light, &settings, &trial->scene);
    const double count = sps_tmap_starts(map)[MAP_SIZE * MAP_SIZE];
    sps_tmap_destroy(map);
    return count;
}

static void map_trial_begin(map_trial *trial, const ex_session *session) {
    const size_t particle_count = 100000;
    memset(trial, 0, sizeof *trial);
    trial->particles.count = particle_count, trial->particles.read_fn = ex_particles_read;
    trial->particles.user = puff_build(particle_count);
    trial->scene.particles = &trial->particles, trial->scene.particle_set_count = 1;
    trial->light.width = trial->light.height = MAP_SIZE;
    trial->light.camera.position[2] = 5, trial->light.camera.up[1] = 1, trial->light.camera.field_of_view = 0.5;
    trial->positions = (double *)ex_allocate(MAP_QUERIES, 3 * sizeof(double));
    trial->depths = (float *)ex_allocate(MAP_QUERIES, sizeof(float));
    for (int i = 0; i < 3 * MAP_QUERIES; ++i) trial->positions[i] = (double)(i * 7919LL % 20011) / 10006 - 1;
    trial->inserts = map_insert_count(session, trial);
}

static void map_trial_end(map_trial *trial) {
    free(trial->particles.user);
    free(trial->positions);
    free(trial->depths);
}

typedef struct map_figures {
    double build, query; /* seconds, each the least of three */
    double megabytes;
} map_figures;

static map_figures map_measure(ex_session *session, map_trial *trial, const sps_tmap_settings *settings) {
    map_figures figures = {HUGE_VAL, HUGE_VAL, 0};
    for (int run = 0; run < 3; ++run) {
        const double start = ex_now(NULL);
        sps_tmap *map = ex_tmap_build(session, program, &trial->light, settings, &trial->scene);
        const double built = ex_now(NULL);
        ex_tmap_query(session, map, MAP_QUERIES, trial->positions, trial->depths, NULL);
        figures.build = fmin(figures.build, built - start);
        figures.query = fmin(figures.query, ex_now(NULL) - built);
        figures.megabytes = 1e-6 * ex_tmap_bytes(map);
        sps_tmap_destroy(map);
    }
    return figures;
}

typedef struct map_row {
    const char *name;
    sps_tmap_settings settings; /* without the range of depths, which is the same for all */
    double bound;               /* the target of seconds to build with WORKERS workers; 0: none */
} map_row;

static const map_row map_rows[] = {
    {"opacity, 8 planes", .settings = {.technique = SPS_TMAP_OPACITY, .components = 8}},
    {"the same, cubic", .settings = {.technique = SPS_TMAP_OPACITY, .components = 8, .cubic = 1}},
    {"deep opacity, 8", .settings = {.technique = SPS_TMAP_DEEP_OPACITY, .components = 8}},
    {"Fourier, 9", .settings = {.technique = SPS_TMAP_FOURIER, .components = 9}, .bound = 0.25},
    {"the same, texel_range", .settings = {.technique = SPS_TMAP_FOURIER, .components = 9, .texel_range = 1}},
    {"4 moments", .settings = {.technique = SPS_TMAP_MOMENT, .components = 5}},
    {"6 moments", .settings = {.technique = SPS_TMAP_MOMENT, .components = 7}},
    {"Beer", .settings = {.technique = SPS_TMAP_BEER, .components = 3}},
    {"compressed, 8 nodes", .settings = {.technique = SPS_TMAP_COMPRESSED, .components = 16}},
    {"compressed to 0.01", .settings = {.technique = SPS_TMAP_COMPRESSED, .epsilon = 0.01f}},
    {"deep, exact", .settings = {.technique = SPS_TMAP_DEEP}},
};

static void bench_map(const map_row *row, map_trial *trial, ex_session sessions[2]) {
    map_figures of[2]; /* with one worker and with WORKERS */
    sps_tmap_settings settings = row->settings;
    settings.near_depth = 3.5, settings.far_depth = 6.5;
    for (int i = 0; i < 2; ++i) of[i] = map_measure(&sessions[i], trial, &settings);
    printf("    %-26s %7.1f %8.3f %7.3f %6.2f %8.1f %8.1f %8.2f %8.2f\n", row->name, of[1].megabytes, of[0].build,
           of[1].build, of[0].build / of[1].build, 1e-6 * trial->inserts / of[0].build,
           1e-6 * trial->inserts / of[1].build, 1e-6 * MAP_QUERIES / of[0].query, 1e-6 * MAP_QUERIES / of[1].query);
    if (row->bound > 0) {
        char what[80];
        snprintf(what, sizeof what, "%s components, %d workers", row->name, WORKERS);
        at_most(what, of[1].build, "s", row->bound);
    }
}

/* `make bench` prints this once with vectors and once in plain C. */
static void bench_maps(void) {
    map_trial trial;
    ex_session sessions[2];
    for (int i = 0; i < 2; ++i) ex_session_measure(&sessions[i], program, i == 0 ? 1 : WORKERS);
    map_trial_begin(&trial, &sessions[1]);
    printf("\nTransmittance maps, %d x %d: %zu particles a few texels wide, %.2f M intervals to insert,\n"
           "1 and %d workers\n"
           "    %-26s %7s %16s %6s %17s %17s\n    %-26s %7s %8s %7s %6s %8s %8s %8s %8s\n",
           MAP_SIZE, MAP_SIZE, trial.particles.count, 1e-6 * trial.inserts, WORKERS, "", "", "build, s", "",
           "M inserts/s", "M queries/s", "", "MB", "1", "2", "ratio", "1", "2", "1", "2");
    for (size_t i = 0; i < sizeof map_rows / sizeof *map_rows; ++i) bench_map(&map_rows[i], &trial, sessions);
    map_trial_end(&trial);
    at_most("10^6 particles of 1.4 texels, opacity / plain loop", small_particles_ratio(&sessions[0], program, 0.006),
            "", 1.3);
    at_most("5 % of 10^5 particles replaced, opacity / made anew",
            update_ratio(&sessions[0], program, SPS_TMAP_OPACITY), "", 0.15);
    at_most("the same, Fourier", update_ratio(&sessions[0], program, SPS_TMAP_FOURIER), "", 0.15);
    at_most("the same, moments", update_ratio(&sessions[0], program, SPS_TMAP_MOMENT), "", 0.15);
    for (int i = 0; i < 2; ++i) ex_session_end(&sessions[i]);
}

typedef struct best_setting {
    double seconds, slab, error;
    int grid, shadow;
    sps_quality quality;
    sps_filling filling;
} best_setting;

static const char *const quality_names[] = {"", "draft", "medium", "high", "ultra"}; /* in the order of sps_quality */
static const char *const filling_names[] = {"", "splatted", "gathered"};             /* ... of sps_filling */

static const double curve_slabs[] = {8, 4, 3, 2, 1, 0.5};
static const int curve_shadows[] = {128, 256, 512};
enum { CURVE_SLABS = 6, CURVE_SHADOWS = 3 };

/* One setting: its three errors and its time, as a group of columns. */
static void print_setting(ex_session *session, const frame *f, const double *exact, const double *own,
                          best_setting *best) {
    contender c;
    double high;
    contender_set(&c, session, f, 0);
    if (f->view.slab_thickness < 3)
        c.seconds = render_seconds(session, f, &f->view); /* thicker slabs have warmed it up */
    else
        race(&c, 1, 3);
    const double error = image_error(f->rgba, exact, BLOB_SIZE, &high);
    printf(" | %7.5f %7.5f %7.5f %6.1f", error, high, image_error(f->rgba, own, BLOB_SIZE, NULL), 1e3 * c.seconds);
    fflush(stdout);
    if (error > TARGET_ERROR || c.seconds >= best->seconds) return;
    best->seconds = c.seconds, best->error = error, best->slab = f->view.slab_thickness,
    best->shadow = f->view.shadow_resolution;
    best->grid = f->volume.size[0], best->quality = f->view.quality, best->filling = f->view.filling;
}

static void print_curve(ex_session *session, frame *f, const double *exact, const double *own, best_setting *best) {
    printf("\n  %d^3 voxels, %s, kernels and ray termination as in %s\n       ", f->volume.size[0],
           filling_names[f->view.filling], quality_names[f->view.quality]);
    for (int k = 0; k < CURVE_SHADOWS; ++k) printf(" | shadow buffer %4d            ", curve_shadows[k]);
    printf("\n  slab ");
    for (int k = 0; k < CURVE_SHADOWS; ++k) printf(" | rmse    p99     own       ms ");
    for (int i = 0; i < CURVE_SLABS; ++i) {
        printf("\n  %4g ", curve_slabs[i]);
        for (int k = 0; k < CURVE_SHADOWS; ++k) {
            f->view.slab_thickness = curve_slabs[i], f->view.shadow_resolution = curve_shadows[k];
            print_setting(session, f, exact, own, best);
        }
    }
    printf("\n");
}

static double blur_error(const double *exact, const double *own) {
    double sum = 0;
    for (int i = 0; i < BLOB_SIZE * BLOB_SIZE; ++i) sum += (exact[i] - own[i]) * (exact[i] - own[i]);
    return sqrt(sum) / BLOB_SIZE;
}

/* Tables for one grid; gives the error of `medium` as it stands, against the field that it stands for. */
static double bench_curves(ex_session *session, const double *exact, int grid, best_setting *best) {
    frame f;
    contender medium;
    char what[80];
    double *own = blob_exact(session, blob_through_kernels(grid), BLOB_SIZE);
    blob_frame(&f, grid, BLOB_SIZE);
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_MEDIUM; ++quality)
        for (int filling = SPS_FILLING_SPLAT; filling <= SPS_FILLING_GATHER; ++filling) {
            f.view.quality = (sps_quality)quality, f.view.filling = (sps_filling)filling;
            print_curve(session, &f, exact, own, best);
        }
    f.view.slab_thickness = 0, f.view.shadow_resolution = 0, f.view.filling = SPS_FILLING_AUTO;
    contender_set(&medium, session, &f, 0);
    race(&medium, 1, 3);
    const double error = image_error(f.rgba, own, BLOB_SIZE, NULL);
    printf("\n");
    snprintf(what, sizeof what, "rmse of the kernels' blur alone, %d^3", grid);
    plain(what, blur_error(exact, own), "");
    snprintf(what, sizeof what, "medium as it stands, %d^3: rmse", grid);
    plain(what, image_error(f.rgba, exact, BLOB_SIZE, NULL), "");
    snprintf(what, sizeof what, "... against the blurred blob (own)");
    plain(what, error, "");
    snprintf(what, sizeof what, "... time");
    plain(what, medium.seconds, "s");
    frame_end(&f);
    free(own);
    return error;
}

/* The best setting once more, in a context that is new: what a program that renders one picture waits for. */
static void print_best(const best_setting *best) {
    frame f;
    ex_session session;
    sps_stats_report stats;
    char what[120];
    printf("\n");
    if (!(best->seconds < HUGE_VAL)) {
        printf("  no setting reaches an rmse of %g\n", TARGET_ERROR);
        return;
    }
    snprintf(what, sizeof what, "rmse %.5f: %d^3, slab %g, shadow %d, %s, %s", best->error, best->grid, best->slab,
             best->shadow, quality_names[best->quality], filling_names[best->filling]);
    at_most(what, best->seconds, "s", 0.05);
    ex_session_measure(&session, program, WORKERS);
    blob_frame(&f, best->grid, BLOB_SIZE);
    f.view.slab_thickness = best->slab, f.view.shadow_resolution = best->shadow;
    f.view.quality = best->quality, f.view.filling = best->filling;
    plain("... as the first frame of a new context, reading the voxels", render_seconds(&session, &f, &f.view), "s");
    sps_get_stats(session.context, &stats);
    print_stages(&stats);
    ex_session_end(&session);
    frame_end(&f);
}

/* Brute force at the first step, of ever smaller ones, that is no worse than `error`. It takes no pixel filter, so an
   image of fewer pixels is an even sample of the same picture, and its time can be scaled. */
static void bench_reference(ex_session *session, double error) {
    enum { SIZE = 64, GRID = 128 };
    frame f;
    sps_image image;
    double step = 16 * sqrt(2.0), reached, seconds;
    double *own = blob_exact(session, blob_through_kernels(GRID), SIZE);
    memset(&image, 0, sizeof image);
    blob_frame(&f, GRID, SIZE);
    image.rgba = f.rgba;
    do {
        step *= sqrt(0.5);
        const double start = ex_now(NULL);
        ex_stop_unless_ok(march(session, &f, step, &image), program, session);
        seconds = ex_now(NULL) - start;
        reached = image_error(f.rgba, own, SIZE, NULL);
        printf("    sps_reference, step %7.3f voxels: own rmse %.6f, %.2f s for %d x %d pixels\n", step, reached,
               seconds, SIZE, SIZE);
    } while (reached > error && seconds < 5);
    plain("sps_reference at that step, 512 x 512, scaled by pixels", seconds * BLOB_SIZE * BLOB_SIZE / (SIZE * SIZE),
          "s");
    frame_end(&f);
    free(own);
}

static void bench_accuracy(void) {
    enum { GRIDS = 3 };
    static const int grids[GRIDS] = {128, 64, 48};
    const blob plain_blob = {BLOB_WIDTH, BLOB_EXTINCTION};
    best_setting best = {HUGE_VAL, 0, 0, 0, 0, SPS_QUALITY_DEFAULT, SPS_FILLING_AUTO};
    double errors[GRIDS], largest = 0;
    ex_session session;
    ex_session_measure(&session, program, WORKERS);
    double *exact = blob_exact(&session, plain_blob, BLOB_SIZE);
    for (int i = 0; i < BLOB_SIZE * BLOB_SIZE; ++i) largest = fmax(largest, exact[i]);
    printf("\nA Gaussian blob over a plane, 512 x 512, 2 workers, voxels held, against closed forms\n"
           "  rmse, p99: root mean square and 99th percentile of the error in radiance (the largest is %.3f)\n"
           "  own: rmse against the closed form for the blob as the voxels' kernels blur it\n"
           "  ms: the median of 3 frames; a single frame where slabs are thinner than 3 voxels\n",
           largest);
    for (int i = 0; i < GRIDS; ++i) errors[i] = bench_curves(&session, exact, grids[i], &best);
    print_best(&best);
    printf("\n  Brute force at the own error of medium, 128^3 (%.6f)\n", errors[0]);
    bench_reference(&session, errors[0]);
    free(exact);
    ex_session_end(&session);
}

/* ======================================================================================== what is classified */

#define DENSE_GRID 32 /* voxels of unit size */
#define DENSE_SIZE 96 /* pixels */

typedef enum dense_shape { DENSE_BALL, DENSE_HALF_SPACE } dense_shape;

/* A ball of radius 12 whose edge is a voxel wide, or all that is below the middle: optical depth 3 per voxel. */
static int dense_read(void *user, const int lo[3], const int size[3], float *out) {
    const dense_shape shape = *(const dense_shape *)user;
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y)
            for (int x = lo[0]; x < lo[0] + size[0]; ++x) {
                const double at[3] = {x - 15.5, y - 15.5, z - 15.5};
                *out++ = shape == DENSE_HALF_SPACE ? (float)(at[2] < 0)
                                                   : (float)fmin(1, fmax(0, 12.5 - sqrt(ex_dot(at, at))));
            }
    return 0;
}

static void dense_frame(frame *f, dense_shape *shape, const sps_transfer *transfer, sps_shading shading) {
    static const double direction[3] = {1, -1, -1};
    frame_begin(f, DENSE_SIZE, DENSE_SIZE);
    for (int i = 0; i < 3; ++i) {
        f->volume.size[i] = DENSE_GRID;
        f->volume.placement.origin[i] = -0.5 * DENSE_GRID;
        f->volume.placement.axis[i][i] = DENSE_GRID;
        f->light.color[i] = (float)EX_PI;
    }
    f->volume.read_fn = dense_read, f->volume.user = shape, f->volume.revision = 1 + (uint64_t)*shape;
    f->volume.transfer = transfer, f->volume.shading = shading;
    memcpy(f->light.direction, direction, sizeof direction);
    f->view.camera.position[2] = 100;
    f->view.camera.ortho_height = *shape == DENSE_BALL ? 40 : 12;
}

/* Root mean square and largest difference from the reference over its brightest, and the dimmest and brightest of a
   surface that is even in the reference. */
static void dense_errors(const float *rgba, const float *reference, double errors[2], double range[2]) {
    double sum = 0, largest = 0, peak = 0;
    range[0] = HUGE_VAL, range[1] = 0;
    for (int i = 0; i < DENSE_SIZE * DENSE_SIZE; ++i) {
        const double value = (double)rgba[4 * i], exact = (double)reference[4 * i], error = fabs(value - exact);
        sum += error * error;
        largest = fmax(largest, error), peak = fmax(peak, exact);
        range[0] = fmin(range[0], value / exact), range[1] = fmax(range[1], value / exact);
    }
    errors[0] = sqrt(sum) / DENSE_SIZE / peak;
    errors[1] = largest / peak;
}

static void dense_reference(ex_session *session, dense_shape shape, const sps_transfer *transfer, float *out) {
    frame f;
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = out;
    dense_frame(&f, &shape, transfer, SPS_SHADING_SURFACE);
    ex_stop_unless_ok(march(session, &f, 0.25, &image), program, session);
    frame_end(&f);
}

/* One row: errors of the ball and its time, then the flat surface. */
static void print_classified(ex_session *session, const sps_transfer *transfer, const sps_quality quality,
                             sps_filling filling, float (*references)[4 * DENSE_SIZE * DENSE_SIZE]) {
    printf("  %-7s %-9s", quality_names[quality], filling_names[filling]);
    for (int s = DENSE_BALL; s <= DENSE_HALF_SPACE; ++s) {
        dense_shape shape = (dense_shape)s;
        double errors[2], range[2];
        frame f;
        contender c;
        dense_frame(&f, &shape, transfer, SPS_SHADING_SURFACE);
        f.view.quality = quality, f.view.filling = filling;
        contender_set(&c, session, &f, 0);
        race(&c, 1, 3);
        dense_errors(f.rgba, references[shape], errors, range);
        if (shape == DENSE_BALL)
            printf(" %6.2f %%  %6.1f %%  %6.1f", 100 * errors[0], 100 * errors[1], 1e3 * c.seconds);
        else
            printf("           %+6.1f %%  %+6.1f %%\n", 100 * (range[0] - 1), 100 * (range[1] - 1));
        frame_end(&f);
    }
}

static void bench_classified(void) {
    static const sps_transfer_point points[2] = {{0.05f, {1, 1, 1}, 0, {0, 0, 0}}, {0.4f, {1, 1, 1}, 3, {0, 0, 0}}};
    static float references[2][4 * DENSE_SIZE * DENSE_SIZE];
    const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    ex_session session;
    ex_session_measure(&session, program, WORKERS);
    for (int shape = DENSE_BALL; shape <= DENSE_HALF_SPACE; ++shape)
        dense_reference(&session, (dense_shape)shape, &transfer, references[shape]);
    printf("\nClassified volumes: optical depth 3 per voxel, shaded as a surface; against sps_reference at step 0.25\n"
           "                       a ball of radius 12             a flat surface, even in the reference\n"
           "                     rmse    largest      ms           dimmest  brightest\n");
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_ULTRA; ++quality)
        for (int filling = SPS_FILLING_SPLAT; filling <= SPS_FILLING_GATHER; ++filling)
            print_classified(&session, &transfer, (sps_quality)quality, (sps_filling)filling, references);
    ex_session_end(&session);
}

/* ================================================================================================ polygons */

static const float grey[3] = {0.5f, 0.5f, 0.5f};

static double hill(double x, double z) {
    double height = 0;
    for (int octave = 0; octave < 6; ++octave) {
        const double f = 0.6 * (1 << octave);
        height += 0.5 / f * sin(f * x + 1.3 * octave) * cos(f * z + 0.7 * octave + 0.4 * sin(f * x));
    }
    return height;
}

/* Hills over -5..5, 2 * cells^2 triangles. */
static void build_hills(ex_mesh *land, int cells) {
    for (int j = 0; j < cells; ++j)
        for (int i = 0; i < cells; ++i) {
            ex_vec p[4];
            for (int k = 0; k < 4; ++k) {
                p[k].x = 10.0 * (i + (k == 1 || k == 2)) / cells - 5;
                p[k].z = 10.0 * (j + (k >= 2)) / cells - 5;
                p[k].y = hill(p[k].x, p[k].z);
            }
            ex_shape_quad(land, p[0], p[1], p[2], p[3], grey);
        }
}

/* A thousand boxes on a ground that reaches to 5000 all round. */
static void build_town(ex_mesh *land) {
    uint32_t random = 1;
    ex_shape_quad(land, ex_vec_of(-5000, 0, -5000), ex_vec_of(5000, 0, -5000), ex_vec_of(5000, 0, 5000),
                  ex_vec_of(-5000, 0, 5000), grey);
    for (int n = 0; n < 1000; ++n) {
        const double x = 80.0 * (n % 32 - 16) + 20 * ex_random(&random), width = 20 + 30 * ex_random(&random);
        const double z = 80.0 * (n / 32 - 16) + 20 * ex_random(&random), depth = 20 + 30 * ex_random(&random);
        const double height = 10 + 60 * ex_random(&random);
        ex_shape_box(land, ex_vec_of(x, 0, z), ex_vec_of(x + width, height, z + depth), grey);
    }
}

/* 512 x 512 pixels of a land under a sun. */
static void land_frame(frame *f, ex_mesh *land, const double position[3], const double target[3]) {
    frame_begin(f, 512, 512);
    f->scene.volume_count = 0;
    f->mesh = ex_shape_mesh(land);
    for (int i = 0; i < 3; ++i) f->light.color[i] = 3;
    f->light.direction[0] = -1, f->light.direction[1] = -0.5, f->light.direction[2] = 0.4;
    memcpy(f->view.camera.position, position, sizeof f->view.camera.position);
    memcpy(f->view.camera.target, target, sizeof f->view.camera.target);
    f->view.camera.field_of_view = 1;
}

static int haze(void *user, const int lo[3], const int size[3], float *out) {
    (void)user, (void)lo;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) out[i] = 1;
    return 0;
}

/* Milliseconds of a stage, the least of a few frames. */
static double least_of(ex_session *session, const frame *f, int stage) {
    double least = HUGE_VAL;
    for (int i = 0; i < REPEATS; ++i) {
        sps_stats_report s;
        render_seconds(session, f, &f->view);
        sps_get_stats(session->context, &s);
        const double seconds[] = {s.seconds_tree, s.seconds_shadow_rays, s.seconds_polygons, s.seconds_textures};
        least = fmin(least, seconds[stage]);
    }
    return 1000 * least;
}

/* sps_mesh.shade_fn: the mesh's own colors. */
static int keep_colors(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user, (void)count, (void)points, (void)out;
    return 0;
}

/* Milliseconds for a million points of a shade_fn that does nothing. */
static double textures_of(ex_session *session, frame *f) {
    sps_stats_report s;
    f->mesh.shade_fn = keep_colors;
    const double least = least_of(session, f, 3);
    sps_get_stats(session->context, &s);
    f->mesh.shade_fn = NULL;
    return 1e6 * least / (double)s.surface_points;
}

enum { SOFT_POINTS = 16 };

/* Seconds that shadow rays take from a million points of surfaces that face the light: under a sharp sun, and under one
   of 10 degrees, with SOFT_POINTS rays from each. Frames take turns; the least of each counts. */
static void soft_rays_of(ex_session *session, frame *f, double least[2]) {
    least[0] = least[1] = HUGE_VAL;
    for (int i = 0; i < 2 * REPEATS; ++i) {
        const int soft = i & 1, points = soft ? SOFT_POINTS : 1;
        sps_stats_report s;
        f->light.angular_diameter = soft ? 10 * EX_PI / 180 : 0;
        f->light.samples = points;
        render_seconds(session, f, &f->view);
        sps_get_stats(session->context, &s);
        least[soft] = fmin(least[soft], 1e6 * points * s.seconds_shadow_rays / (double)s.shadow_rays);
    }
    f->light.angular_diameter = 0;
    f->light.samples = 0;
}

static void bench_soft_rays(const char *name, frame *f, ex_session sessions[2]) {
    for (int i = 0; i < 2; ++i) {
        double least[2];
        char what[96];
        soft_rays_of(&sessions[i], f, least);
        snprintf(what, sizeof what, "%s, %zu triangles: %d rays from a million points, %d worker%s", name,
                 f->mesh.triangle_count, SOFT_POINTS, i + 1, i ? "s" : "");
        plain(what, least[1], "s");
        plain("... / one ray from each, time", least[1] / least[0], "");
    }
}

static void bench_land(const char *name, ex_mesh *land, const double position[3], const double target[3], double bound,
                       ex_session sessions[2]) {
    frame f;
    char what[96];
    land_frame(&f, land, position, target);
    for (int stage = 0; stage < 3; ++stage) {
        static const char *const stages[] = {"tree", "262 k rays", "rasterised for the eye"};
        for (int i = 0; i < 2; ++i) {
            snprintf(what, sizeof what, "%s, %zu triangles: %s, %d worker%s", name, land->triangle_count, stages[stage],
                     i + 1, i ? "s" : "");
            at_most(what, least_of(&sessions[i], &f, stage), "ms", stage == 1 && i == 1 ? bound : HUGE_VAL);
        }
    }
    for (int i = 0; i < 2; ++i) {
        snprintf(what, sizeof what, "%s, %zu triangles: a million points for shade_fn, %d worker%s", name,
                 land->triangle_count, i + 1, i ? "s" : "");
        plain(what, textures_of(&sessions[i], &f), "ms");
    }
    bench_soft_rays(name, &f, sessions);
    { /* the depth map, over all of the land, by which polygons shade gas */
        const double bare = least_of(&sessions[1], &f, 2);
        f.scene.volume_count = 1;
        f.volume.read_fn = haze, f.volume.extinction = 1e-4f, f.volume.albedo[0] = 1;
        for (int i = 0; i < 3; ++i) {
            const double room = land->triangle_count == 12002 ? 5000 : 5;
            f.volume.size[i] = 4, f.volume.placement.origin[i] = -room, f.volume.placement.axis[i][i] = 2 * room;
        }
        snprintf(what, sizeof what, "%s, %zu triangles: a depth map for gas, 1024^2, 2 workers", name,
                 land->triangle_count);
        plain(what, least_of(&sessions[1], &f, 2) - bare, "ms");
    }
    frame_end(&f);
}

/* What shadows on polygons cost: the tree, kept while meshes' revisions stay; a ray for each pixel, a frame and light;
   and what there was to do already. */
static void bench_polygons(void) {
    const double above[3] = {0, 9, 0.1}, centre[3] = {0, 0, 0}, eye[3] = {4.5, 0.9, 4.5}, horizon[3] = {0, 0.6, 0};
    const double street[3] = {0, 1.7, 0}, far_away[3] = {1000, 1.7, 300};
    ex_session sessions[2];
    ex_mesh land = {0};
    printf("\npolygons, 512 x 512 pixels, one sun\n");
    for (int i = 0; i < 2; ++i) ex_session_measure(&sessions[i], program, i + 1);
    build_town(&land);
    bench_land("town at street level", &land, street, far_away, 10, sessions);
    ex_mesh_free(&land);
    for (int cells = 23; cells <= 708; cells = (int)(cells * 3.137)) {
        build_hills(&land, cells);
        const double bound = land.triangle_count < 100000 ? 10 : 40;
        bench_land("hills from above", &land, above, centre, bound, sessions);
        bench_land("hills at eye level", &land, eye, horizon, bound, sessions);
        ex_mesh_free(&land);
    }
    for (int i = 0; i < 2; ++i) ex_session_end(&sessions[i]);
}

/* =================================================================================================== edges */

/* The truth is rendered at this number of times the size, with 2 x 2 samples of edges in each of its pixels, none of
   which is where those of coverage_samples 8 are; and averaged. */
enum { EDGE_TRUTH = 8 };

/* A way to render edges: samples along a side of a pixel, and how many times as large before averaging. */
typedef struct edge_way {
    const char *name;
    int samples, times;
} edge_way;

static const edge_way edge_ways[] = {{"one sample", 1, 1},         {"coverage_samples 2", 2, 1},
                                     {"coverage_samples 4", 4, 1}, {"coverage_samples 8", 8, 1},
                                     {"twice the size", 1, 2},     {"4 times the size", 1, 4}};
enum { EDGE_WAYS = sizeof edge_ways / sizeof *edge_ways };

/* Averages n x n pixels into one, in place. */
static void frame_average(frame *f, int n) {
    const int width = f->view.width / n, height = f->view.height / n;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < 4; ++c) {
                double sum = 0;
                for (int i = 0; i < n * n; ++i)
                    sum += (double)f->rgba[4 * ((y * n + i / n) * f->view.width + x * n + i % n) + c];
                f->rgba[4 * (y * width + x) + c] = (float)(sum / (n * n));
            }
    f->view.width = width, f->view.height = height;
}

/* The root mean square differences of two pictures: of color, and of alpha. */
static void edge_errors(const frame *a, const frame *b, double rms[2]) {
    const size_t count = (size_t)a->view.width * (size_t)a->view.height;
    double sums[2] = {0, 0};
    for (size_t i = 0; i < 4 * count; ++i) sums[i % 4 == 3] += pow((double)a->rgba[i] - (double)b->rgba[i], 2);
    rms[0] = sqrt(sums[0] / (3 * (double)count)), rms[1] = sqrt(sums[1] / (double)count);
}

static void frame_at_times(frame *f, const frame *from, int times) {
    frame sized = *from;
    sized.view.width *= times, sized.view.height *= times;
    frame_copy(f, &sized);
}

/* Prints the rows of a scene: time is that of the frame, without averaging. */
static void bench_edges_of(const char *name, ex_session *session, const frame *from) {
    frame ways[EDGE_WAYS], truth;
    contender c[EDGE_WAYS];
    for (int i = 0; i < EDGE_WAYS; ++i) {
        frame_at_times(&ways[i], from, edge_ways[i].times);
        ways[i].view.coverage_samples = edge_ways[i].samples;
        contender_set(&c[i], session, &ways[i], 0);
    }
    race(c, EDGE_WAYS, REPEATS);
    frame_at_times(&truth, from, EDGE_TRUTH);
    truth.view.coverage_samples = 2;
    render_seconds(session, &truth, &truth.view);
    frame_average(&truth, EDGE_TRUTH);
    for (int i = 0; i < EDGE_WAYS; ++i) {
        double rms[2];
        frame_average(&ways[i], edge_ways[i].times);
        edge_errors(&ways[i], &truth, rms);
        printf("| %s | %s | %.4f | %.4f | %.2f |\n", i == 0 ? name : "", edge_ways[i].name, rms[0], rms[1],
               c[i].seconds / c[0].seconds);
        frame_end(&ways[i]);
    }
    frame_end(&truth);
}

static void build_mushrooms(ex_mesh *mesh) {
    static const float red[3] = {0.6f, 0.05f, 0.03f}, brown[3] = {0.36f, 0.17f, 0.07f}, ochre[3] = {0.7f, 0.4f, 0.1f};
    ex_shape_quad(mesh, ex_vec_of(-2, 0, -2), ex_vec_of(-2, 0, 2), ex_vec_of(2, 0, 2), ex_vec_of(2, 0, -2), grey);
    ex_shape_mushroom(mesh, ex_vec_of(-0.25, 0, -0.25), ex_vec_of(-0.06, 1, 0), 1.45, 0.82, red, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(0.85, 0, 0.25), ex_vec_of(0.16, 1, 0.06), 0.90, 0.50, ochre, NULL);
    ex_shape_mushroom(mesh, ex_vec_of(-0.62, 0, 0.85), ex_vec_of(-0.14, 1, 0.12), 0.58, 0.36, brown, NULL);
}

/* 320 x 240 pixels of a mesh, held, before a background. */
static void edge_frame(frame *f, ex_mesh *mesh, const double position[3], const double target[3]) {
    land_frame(f, mesh, position, target);
    f->view.width = 320, f->view.height = 240;
    f->view.camera.field_of_view = 0.52;
    f->mesh.revision = 1;
    f->light.direction[1] = -1.1;
    for (int c = 0; c < 3; ++c) f->scene.ambient[c] = 0.2f, f->scene.background[c] = 0.8f;
}

/* Three mushrooms, under lights with and without shadows, and in haze of optical depth 1 or so. */
static void bench_mushrooms(ex_session *session) {
    const double position[3] = {0.5, 2.3, 5.9}, target[3] = {0, 0.34, 0.05};
    ex_mesh mesh = {0};
    frame f;
    build_mushrooms(&mesh);
    edge_frame(&f, &mesh, position, target);
    f.light.no_shadow = 1;
    bench_edges_of("mushrooms, no shadows", session, &f);
    f.light.no_shadow = 0;
    bench_edges_of("mushrooms, hard shadows", session, &f);
    f.scene.volume_count = 1;
    f.volume.read_fn = haze, f.volume.extinction = 0.3f, f.volume.revision = 1;
    for (int i = 0; i < 3; ++i) {
        f.volume.size[i] = 32, f.volume.albedo[i] = 0.9f;
        f.volume.placement.origin[i] = i == 1 ? -0.2 : -2, f.volume.placement.axis[i][i] = i == 1 ? 2 : 4;
    }
    bench_edges_of("... and haze", session, &f);
    frame_end(&f);
    ex_mesh_free(&mesh);
}

static void bench_teapot(ex_session *session) {
    const double position[3] = {2, 5, 11}, target[3] = {0.2, 1.4, 0};
    const char *folder = getenv("SPLATSHADOW_DATA");
    char path[4096];
    ex_mesh mesh = {0};
    ex_error error;
    frame f;
    snprintf(path, sizeof path, "%s/utah_teapot.obj", folder ? folder : "");
    if (!folder) ex_fail(&error, "SPLATSHADOW_DATA does not say where utah_teapot.obj is");
    if (scan_failed(!folder || ex_mesh_load(&mesh, path, 60, &error), &error)) return;
    edge_frame(&f, &mesh, position, target);
    f.mesh.has_albedos = 0, f.mesh.albedo[0] = f.mesh.albedo[1] = f.mesh.albedo[2] = 0.5f;
    bench_edges_of("teapot, hard shadows", session, &f);
    frame_end(&f);
    ex_mesh_free(&mesh);
}

/* How far pictures are from the truth by samples of edges, and by rendering larger, and what that costs. */
static void bench_edges(void) {
    ex_session session;
    ex_session_measure(&session, program, WORKERS);
    printf("\nEdges of polygons, 320 x 240, 2 workers, against %d times the size with coverage_samples 2, averaged\n\n",
           EDGE_TRUTH);
    printf("| scene | rendered with | rms of color | rms of alpha | time / one sample |\n|---|---|---|---|---|\n");
    bench_mushrooms(&session);
    bench_teapot(&session);
    ex_session_end(&session);
}

/* =============================================================================================== penumbrae */

/* A frame under a sun of 10 degrees: time against a sharp sun, and what its points miss compared with 256 of them. The
   target is of the fewest points whose error is at most 0.005. */
static void bench_soft(const char *name, const frame *hard, double target) {
    enum { KINDS = 4 };
    static const int points[KINDS] = {4, 8, 16, 32};
    ex_session session;
    frame frames[1 + KINDS], exact = *hard;
    contender c[1 + KINDS];
    int met = 0;
    ex_session_measure(&session, program, WORKERS);
    for (int i = 0; i <= KINDS + 1; ++i) {
        frame *f = i <= KINDS ? &frames[i] : &exact;
        frame_copy(f, hard);
        f->light.angular_diameter = i > 0 ? 10 * EX_PI / 180 : 0;
        f->light.samples = i > KINDS ? 256 : i > 0 ? points[i - 1] : 0;
        if (i <= KINDS) contender_set(&c[i], &session, f, 0);
    }
    race(c, 1 + KINDS, REPEATS);
    render_seconds(&session, &exact, &exact.view);
    plain("sharp", c[0].seconds, "s");
    for (int i = 1; i <= KINDS; ++i) {
        const double error = frames_rms(&frames[i], &exact), ratio = c[i].seconds / c[0].seconds;
        char what[80];
        snprintf(what, sizeof what, "%s, %d points: rms error %.4f, time / sharp", name, points[i - 1], error);
        if (error <= 0.005 && !met)
            at_most(what, ratio, "", target);
        else
            plain(what, ratio, "");
        met |= error <= 0.005;
    }
    for (int i = 0; i <= KINDS; ++i) frame_end(&frames[i]);
    frame_end(&exact);
    ex_session_end(&session);
}

static void bench_penumbrae(void) {
    ex_grid grid;
    frame f;
    printf("\nPenumbrae: a sun of 10 degrees against a sharp one, 2 workers, voxels held\n");
    if (bonsai_load(&grid) == 0) {
        bonsai_frame(&f, &grid);
        f.volume.shading = SPS_SHADING_SURFACE;
        bench_soft("bonsai", &f, 1.6);
        frame_end(&f);
        ex_grid_free(&grid);
    }
    if (smoke_load(&grid) == 0) {
        smoke_frame(&f, &grid);
        bench_soft("smoke", &f, 1.5);
        frame_end(&f);
        ex_grid_free(&grid);
    }
}

/* ================================================================================================== paths */

/* How often light scatters, and whether the light in the cells is held. */
typedef enum grade { ONCE = 0, FORWARD, HELD_SPREAD, NEW_SPREAD, HELD_CELLS, NEW_CELLS, GRADES } grade;

static const char *const grade_names[GRADES] = {
    "once", "forward", "convolution, held", "convolution, made anew", "full, held", "full, made anew"};
static const double grade_targets[GRADES] = {1, 1.05, 1.3, 1.3, 1.1, 1.3};

/* The frame of a grade. Cells are held if all volumes and meshes have a revision. */
static void grade_set(contender *c, ex_session *session, frame *f, grade of) {
    static const sps_scattering scattering[GRADES] = {SPS_SCATTERING_SINGLE,      SPS_SCATTERING_FORWARD,
                                                      SPS_SCATTERING_CONVOLUTION, SPS_SCATTERING_CONVOLUTION,
                                                      SPS_SCATTERING_MULTIPLE,    SPS_SCATTERING_MULTIPLE};
    f->mesh.revision = of != NEW_SPREAD && of != NEW_CELLS;
    contender_set(c, session, f, 0);
    c->view.scattering = scattering[of];
}

/* Light scattered any number of times, against once: from both sides, since sheets take another pass over the gas for
   light from behind, and tables do not. */
static void bench_grades(ex_session sessions[GRADES]) {
    static const double directions[2][3] = {{-0.3, -0.6, -0.7}, {-0.3, -0.6, 0.7}};
    static const sps_lobe lobes[2] = {{0, 1}, {0.85f, 1}};
    printf("\nScattering: a blob of 128^3 voxels over a plane, 512 x 512, 2 workers\n\n");
    printf("| asymmetry | light | shadows | once, ms |");
    for (int k = FORWARD; k < GRADES; ++k) printf(" %s / once, target %g |", grade_names[k], grade_targets[k]);
    printf("\n|---|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < 8; ++i) {
        contender c[GRADES];
        frame frames[GRADES];
        for (int k = 0; k < GRADES; ++k) {
            frame *f = &frames[k];
            blob_frame(f, 128, 512);
            f->volume.lobes = &lobes[i / 4], f->volume.lobe_count = 1;
            memcpy(f->light.direction, directions[i % 2], sizeof f->light.direction);
            f->light.shadow_source = i / 2 % 2 ? SPS_SHADOW_TABLE : SPS_SHADOW_SHEETS;
            grade_set(&c[k], &sessions[k], f, (grade)k);
        }
        race(c, GRADES, REPEATS);
        printf("| %.2f | from %s | %s | %.1f |", (double)lobes[i / 4].asymmetry, i % 2 ? "behind" : "the front",
               i / 2 % 2 ? "a table that is held" : "sheets", 1000 * c[ONCE].seconds);
        for (int k = FORWARD; k < GRADES; ++k) printf(" %.2f |", c[k].seconds / c[ONCE].seconds);
        printf("\n");
        fflush(stdout);
        for (int k = 0; k < GRADES; ++k) frame_end(&frames[k]);
    }
}

/* The time to fill and light cells, and to follow light from cell to cell, in a blob as dense as a cloud. */
static void bench_cells(ex_session *session) {
    enum { SIZES = 4, PHASES = 3, ROUNDS = 3 };
    static const int sizes[SIZES] = {32, 48, 64, 96}, moments[PHASES] = {1, 4, 16};
    static const sps_lobe lobes[PHASES] = {{0, 1}, {0.2f, 1}, {0.85f, 1}};
    frame f;
    blob_frame(&f, 128, 64);
    f.volume.extinction = 40;
    f.mesh.revision = 0; /* cells are not held */
    printf("\nMaking cells: the blob with an optical depth of 35 through its middle, 2 workers, ms\n\n");
    printf("| asymmetry | moments | albedo |");
    for (int k = 0; k < SIZES; ++k) printf(" scattering_resolution %d |", sizes[k]);
    printf("\n|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < 2 * PHASES; ++i) {
        f.volume.lobes = &lobes[i / 2], f.volume.lobe_count = 1;
        f.volume.albedo[2] = i % 2 ? 0.9f : 1;
        printf("| %.2f | %d | %s |", (double)lobes[i / 2].asymmetry, moments[i / 2], i % 2 ? "colored" : "grey");
        for (int k = 0; k < SIZES; ++k) {
            double seconds[ROUNDS];
            sps_view view = f.view;
            view.scattering = SPS_SCATTERING_MULTIPLE, view.scattering_resolution = sizes[k];
            for (int r = 0; r < ROUNDS; ++r) {
                sps_stats_report stats;
                render_seconds(session, &f, &view);
                sps_get_stats(session->context, &stats);
                seconds[r] = stats.seconds_cells;
            }
            printf(" %.1f |", 1000 * ex_percentile(seconds, ROUNDS, 0.5));
            fflush(stdout);
        }
        printf("\n");
    }
    frame_end(&f);
}

static void bench_scattering(void) {
    ex_session sessions[GRADES];
    for (int k = 0; k < GRADES; ++k) ex_session_measure(&sessions[k], program, WORKERS);
    bench_grades(sessions);
    bench_cells(&sessions[0]);
    for (int k = 0; k < GRADES; ++k) ex_session_end(&sessions[k]);
}

/* --- random paths --- */

enum { PATHS_SIDE = 96, PATHS_MOST = 256, PATHS_VALUES = 3 * PATHS_SIDE * PATHS_SIDE };

/* A picture by the most paths, the standard errors of its pixels, and the time of the paths alone, without that to
   march light that scatters once. */
typedef struct walked {
    float rgba[4 * PATHS_SIDE * PATHS_SIDE], error[PATHS_VALUES];
    double seconds, mean, relative; /* error, of the mean radiance */
} walked;

/* The blob over a plane, in a sun and under a sky, with an optical depth of 9 through its middle. */
static void paths_frame(frame *f, const sps_lobe *lobe) {
    blob_frame(f, 64, PATHS_SIDE);
    for (int c = 0; c < 3; ++c) f->scene.ambient[c] = 0.5f;
    f->volume.extinction = 10;
    f->volume.lobes = lobe, f->volume.lobe_count = 1;
}

/* What the standard error of multiple scattering costs. */
static void bench_walks(ex_session *session, frame *f, walked *w) {
    const double once = walk_seconds(session, f, 0, NULL);
    printf("| marching light that scatters once | %.2f | | |\n", once);
    for (int samples = 4; samples <= PATHS_MOST; samples *= 4) {
        double squares = 0;
        w->seconds = walk_seconds(session, f, samples, w->error) - once, w->mean = 0;
        for (int k = 0; k < PATHS_VALUES; ++k) {
            w->mean += (double)f->rgba[k / 3 * 4 + k % 3] / PATHS_VALUES;
            squares += pow((double)w->error[k], 2) / PATHS_VALUES;
        }
        w->relative = sqrt(squares) / w->mean;
        printf("| %d paths a pixel besides | %.2f | %.2f %% | |\n", samples, w->seconds, 100 * w->relative);
        fflush(stdout);
    }
    memcpy(w->rgba, f->rgba, sizeof w->rgba);
}

/* The root mean square error of a grade, that of the paths taken off, and its time with light made anew; beside them
   the time of as many paths as have that error, which falls with the root of their number. */
static void bench_against_walks(ex_session *session, frame *f, const walked *w, const char *name,
                                sps_scattering scattering) {
    enum { ROUNDS = 5 };
    double seconds[ROUNDS], squares = 0, error;
    sps_view view = f->view;
    view.scattering = scattering;
    f->mesh.revision = 0;
    for (int r = 0; r < ROUNDS; ++r) seconds[r] = render_seconds(session, f, &view);
    for (int k = 0; k < PATHS_VALUES; ++k) {
        const int at = k / 3 * 4 + k % 3;
        squares += (pow((double)f->rgba[at] - (double)w->rgba[at], 2) - pow((double)w->error[k], 2)) / PATHS_VALUES;
    }
    error = sqrt(fmax(squares, 0)) / w->mean;
    printf("| %s | %.3f | %.2f %% | %.3g |\n", name, ex_percentile(seconds, ROUNDS, 0.5), 100 * error,
           w->seconds * pow(w->relative / error, 2));
    fflush(stdout);
}

static void bench_paths(void) {
    static const sps_lobe lobes[2] = {{0, 1}, {0.75f, 1}};
    static walked w;
    ex_session session;
    ex_session_measure(&session, program, WORKERS);
    for (int i = 0; i < 2; ++i) {
        frame f;
        paths_frame(&f, &lobes[i]);
        printf("\nMultiple scattering: a blob of 64^3 voxels, of asymmetry %g, over a plane, %d x %d, 2 workers\n\n",
               (double)lobes[i].asymmetry, PATHS_SIDE, PATHS_SIDE);
        printf("| | s | error, of the mean radiance | paths of that error, s |\n|---|---|---|---|\n");
        bench_walks(&session, &f, &w);
        bench_against_walks(&session, &f, &w, "once", SPS_SCATTERING_SINGLE);
        bench_against_walks(&session, &f, &w, "forward", SPS_SCATTERING_FORWARD);
        bench_against_walks(&session, &f, &w, "convolution", SPS_SCATTERING_CONVOLUTION);
        bench_against_walks(&session, &f, &w, "full", SPS_SCATTERING_MULTIPLE);
        frame_end(&f);
    }
    ex_session_end(&session);
}

/* --------------------------------------------------------------------------------------------- filling sheets */

enum { FILLING_SIZE = 512, LARGE = 960 };

/* One frame, splatted and gathered, and as the library chooses. */
static void bench_ways(ex_session *session, const frame *f, const char *name) {
    contender c[3];
    for (int i = 0; i < 3; ++i) {
        contender_set(&c[i], session, f, 0);
        c[i].view.filling = i == 0 ? SPS_FILLING_SPLAT : i == 1 ? SPS_FILLING_GATHER : SPS_FILLING_AUTO;
    }
    race(c, 3, REPEATS);
    printf("%-34s %8.3f %8.3f %8.3f s %7.2f\n", name, c[0].seconds, c[1].seconds, c[2].seconds,
           c[0].seconds / c[2].seconds);
}

/* Root mean square difference from the means of the pixels of a large picture, which is `times` as wide. */
static double error_of_means(const frame *f, const frame *large, int times) {
    double sum = 0;
    for (int y = 0; y < f->view.height; ++y)
        for (int x = 0; x < f->view.width; ++x) {
            const float *from = large->rgba + 4 * (size_t)(y * times * large->view.width + x * times);
            double mean = 0, off;
            for (int i = 0; i < times * times; ++i)
                mean += (double)from[4 * (i / times * large->view.width + i % times)] / (times * times);
            off = (double)f->rgba[4 * (size_t)(y * f->view.width + x)] - mean;
            sum += off * off;
        }
    return sqrt(sum / (f->view.width * (double)f->view.height));
}

/* Pictures in which voxels are smaller than pixels: splatted, with the slabs and texels of a large picture, and as the
   library chooses. */
static void bench_small(ex_session *session, frame *f, const char *name) {
    enum { WAYS = 3 };
    sps_plan_report plan;
    frame large;
    f->scene.mesh_count = 0; /* whose edges have no filter */
    frame_copy(&large, f);
    frame_resize(&large, LARGE, LARGE * 3 / 4);
    large.view.quality = SPS_QUALITY_HIGH;
    render_seconds(session, &large, &large.view);
    large.view.quality = SPS_QUALITY_MEDIUM;
    ex_stop_unless_ok(sps_plan(session->context, &large.scene, &large.view, &plan), program, session);
    for (int times = 24; times > 1; times /= 2) {
        contender c[WAYS];
        double error[WAYS];
        f->view.width = LARGE / times, f->view.height = LARGE * 3 / 4 / times;
        for (int i = 0; i < WAYS; ++i) {
            contender_set(&c[i], session, f, 0);
            c[i].view.filling = i ? SPS_FILLING_AUTO : SPS_FILLING_SPLAT;
            if (i == 1) c[i].view.slab_thickness = f->volume.transfer ? 0.7 : 1;
            if (i == 1)
                c[i].view.shadow_resolution =
                    plan.shadow_width > plan.shadow_height ? plan.shadow_width : plan.shadow_height;
            render_seconds(session, f, &c[i].view);
            error[i] = error_of_means(f, &large, times);
        }
        race(c, WAYS, REPEATS);
        printf("%-18s %4d x %-4d %8.4f %8.4f %8.4f s %10.5f %10.5f %10.5f\n", name, f->view.width, f->view.height,
               c[0].seconds, c[1].seconds, c[2].seconds, error[0], error[1], error[2]);
    }
    frame_end(&large);
}

/* The blob from twice its box's width, where far voxels are half as large as near ones. */
static void blob_approach(frame *f) {
    double *position = f->view.camera.position, offset[3], distance = 0;
    for (int i = 0; i < 3; ++i) offset[i] = position[i] - blob_centre[i], distance += offset[i] * offset[i];
    for (int i = 0; i < 3; ++i) {
        position[i] = blob_centre[i] + 2 * BLOB_BOX * BLOB_WIDTH / sqrt(distance) * offset[i];
        f->view.camera.target[i] = blob_centre[i];
    }
    f->view.camera.field_of_view = 2 * atan(0.4);
}

static void bench_filling(void) {
    ex_session session;
    ex_grid grid;
    frame f;
    printf("\nFilling sheets, medium, voxels held, 1 worker, %d x %d\n", FILLING_SIZE, FILLING_SIZE);
    printf("%-34s %8s %8s %8s   %7s\n", "", "splatted", "gathered", "chosen", "ratio");
    ex_session_measure(&session, program, 1);
    for (int slab = 1; slab <= 8; slab *= 8) {
        blob_frame(&f, 128, FILLING_SIZE);
        f.view.slab_thickness = slab;
        bench_ways(&session, &f, slab == 1 ? "blob 128^3 over a plane" : "... slabs of 8 voxels");
        frame_end(&f);
    }
    full_frame(&f, FILLING_SIZE);
    bench_ways(&session, &f, "256^3 full of gas");
    frame_end(&f);
    if (!smoke_load(&grid)) {
        smoke_ground_frame(&f, &grid, FILLING_SIZE);
        bench_ways(&session, &f, "smoke over a ground");
        frame_end(&f), ex_grid_free(&grid);
    }
    if (!bonsai_load(&grid)) {
        bonsai_frame(&f, &grid);
        bench_ways(&session, &f, "bonsai, a surface");
        frame_end(&f), ex_grid_free(&grid);
    }
    printf("%-30s %8s %8s %8s   %10s %10s %10s\n", "small pictures", "splatted", "fine", "chosen", "error", "fine",
           "chosen");
    blob_frame(&f, 128, LARGE);
    bench_small(&session, &f, "blob 128^3");
    frame_end(&f);
    blob_frame(&f, 128, LARGE);
    blob_approach(&f);
    bench_small(&session, &f, "... from nearby");
    frame_end(&f);
    blob_frame(&f, 128, LARGE);
    f.volume.size[1] = 13;
    bench_small(&session, &f, "... 128 x 13 x 128");
    frame_end(&f);
    if (!smoke_load(&grid)) {
        smoke_frame(&f, &grid);
        frame_resize(&f, LARGE, LARGE);
        bench_small(&session, &f, "smoke");
        frame_end(&f), ex_grid_free(&grid);
    }
    for (int surface = 0; surface < 2 && !bonsai_load(&grid); ++surface) {
        bonsai_frame(&f, &grid);
        f.volume.shading = surface ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
        free(f.rgba), f.rgba = (float *)ex_allocate((size_t)LARGE * LARGE, 4 * sizeof(float));
        bench_small(&session, &f, surface ? "bonsai, a surface" : "bonsai, a gas");
        frame_end(&f), ex_grid_free(&grid);
    }
    ex_session_end(&session);
}

/* ==================================================================================================== main */

static void bench_basics(void) {
    bench_bonsai();
    bench_splatting();
    bench_empty_space();
}

static void bench_errors(void) {
    bench_accuracy();
    bench_classified();
}

/* What can be asked for by name. `speed` is all up to `maps`; without a name, `accuracy` comes after them. */
typedef struct part {
    const char *name;
    void (*run)(void);
} part;

static const part parts[] = {{"default", bench_default}, {"goals", bench_goals},           {"basics", bench_basics},
                             {"filling", bench_filling}, {"lights", bench_penumbrae},      {"polygons", bench_polygons},
                             {"edges", bench_edges},     {"scattering", bench_scattering}, {"paths", bench_paths},
                             {"maps", bench_maps},       {"accuracy", bench_errors}};
enum { PARTS = sizeof parts / sizeof *parts };

int main(int argc, char **argv) {
    const char *wanted = argc > 1 ? argv[1] : "";
    int done = 0;
    if (argc == 2 && strcmp(wanted, "frames") == 0) return bench_frames(), 0;
    if (argc == 2 && strcmp(wanted, "single") == 0) return bench_single(), 0;
    if (argc == 2 && strcmp(wanted, "before") == 0) return bench_before(), 0;
    if (argc == 2 && strcmp(wanted, "cheapest") == 0) return bench_cheapest(), 0;
    if (argc == 3 && strcmp(wanted, "curves") == 0) return bench_growth(argv[2]), 0;
    for (int i = 0; i < PARTS && argc <= 2; ++i) {
        const int in_speed = parts[i].run != bench_errors && strcmp(wanted, "speed") == 0;
        if (argc > 1 && !in_speed && strcmp(wanted, parts[i].name) != 0) continue;
        if (!done++) printf("%d processors\n", ex_processor_count());
        parts[i].run();
    }
    if (done) return 0;
    fprintf(stderr,
            "%s: give nothing, or `speed`, or `frames`, or `single`, or `before`, or `cheapest`, or `curves FOLDER`",
            argv[0]);
    for (int i = 0; i < PARTS; ++i) fprintf(stderr, ", or `%s`", parts[i].name);
    fprintf(stderr, "\n");
    return 2;
}
