/* The renderer behind page.html, compiled to WebAssembly without threads: scenes, frames within a budget, and the error
   of a still picture at some of its pixels. JavaScript calls the functions named web_*; a native build has the same. */

#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"

#include <strings.h>
#include <time.h>

#include "../blackbody.h"
#include "../densities.h"
#include "../nvdb.h"
#include "../particles.h"
#include "../vdb.h"
#include "../volume_file.h"

#ifdef __wasm__
#define WEB_CALL(name) __attribute__((export_name(#name))) name
/* 1: input is waiting, so the call in progress is to be cancelled. */
__attribute__((import_module("page"), import_name("pending"))) int page_pending(void);
#else
#define WEB_CALL(name) name
static int page_pending(void) { return 0; }
#endif

enum { BLOB, SMOKE, CLOUD, FIRE, SCAN, PARTICLES };
enum { SAMPLED = 24, PARTICLE_COUNT = 20000, LARGEST_FILE = 400000000, VOXELS_MOST = 50000000, QUALITIES = 5 };

/* One context renders moving pictures; the other, still ones and measurements. Each keeps its own voxels and cells. */
enum { MOVING, STILL, CONTEXTS };

typedef struct web_state {
    sps_context *contexts[CONTEXTS];
    sps_scene scene;
    sps_volume volume;
    sps_grid grid; /* the volume's, unless it is a dropped file's */
    float *voxels;
    sps_mesh ground;
    sps_particles set;
    sps_particle *particles;
    sps_light light;
    sps_transfer transfer;
    sps_transfer_point points[EX_TEMPERATURE_POINTS];
    ex_grid dense;    /* the dropped file's */
    ex_sparse sparse; /* likewise; its size is 0 if the file is dense */
    double centre[3], distance, size;
    double around, above;             /* the camera's angles */
    double light_around, light_above; /* the light's */
    uint64_t revision;
    float *rgba, *other;  /* the picture shown, and one to compare */
    unsigned char *codes; /* sRGB and alpha, as a canvas takes them */
    int width, height;
    int columns, rows, step, passes; /* sampled pixels, and passes of paths through them */
    float *sums, *squares, *mean, *deviation;
    float *tried[QUALITIES]; /* the sampled pixels of compared pictures; NULL: none */
    char report[8192];
    ex_error error;
} web_state;

static web_state web;

static double web_clock(void *user) {
    struct timespec now;
    (void)user;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int web_progress(void *user, float fraction) {
    (void)user, (void)fraction;
    return page_pending();
}

static int web_fail(int context) { return ex_fail(&web.error, "%s", sps_error(web.contexts[context])); }

/* ---------------------------------------------------------------------------------------------------------- scenes */

static int ground_read(void *user, size_t first, size_t count, sps_triangle *out) {
    static const float corners[4][2] = {{-80, 80}, {80, 80}, {80, -80}, {-80, -80}};
    const float height = *(const float *)user;
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < 3; ++k) {
            const float *corner = corners[k == 0 ? 0 : first + i + k];
            out[i].position[k][0] = corner[0], out[i].position[k][1] = height, out[i].position[k][2] = corner[1];
        }
    return 0;
}

static void set_ground(double height, double gray) {
    static float at;
    at = (float)height;
    memset(&web.ground, 0, sizeof web.ground);
    web.ground.triangle_count = 2, web.ground.read_fn = ground_read, web.ground.user = &at;
    web.ground.revision = ++web.revision;
    ex_color(web.ground.albedo, gray, gray, 0.95 * gray);
    web.scene.meshes = &web.ground, web.scene.mesh_count = 1;
}

typedef double web_density(ex_vec p);

/* Sets the volume to a function of position, evaluated once: the reference reads voxels again and again. */
static sps_volume *set_volume(ex_vec low, ex_vec high, int voxels, web_density *density) {
    sps_volume *volume = &web.volume;
    memset(volume, 0, sizeof *volume), memset(&web.grid, 0, sizeof web.grid);
    ex_volume_box(volume, low, high, voxels);
    const size_t count = (size_t)volume->size[0] * (size_t)volume->size[1] * (size_t)volume->size[2];
    const double edge = volume->placement.axis[0][0] / volume->size[0];
    free(web.voxels);
    float *out = web.voxels = (float *)ex_allocate(count, sizeof(float));
    for (int z = 0; z < volume->size[2]; ++z)
        for (int y = 0; y < volume->size[1]; ++y)
            for (int x = 0; x < volume->size[0]; ++x)
                *out++ = (float)density(
                    ex_vec_of(low.x + (x + 0.5) * edge, low.y + (y + 0.5) * edge, low.z + (z + 0.5) * edge));
    web.grid.voxels = web.voxels, web.grid.format = SPS_VOXEL_F32;
    memcpy(web.grid.size, volume->size, sizeof web.grid.size);
    volume->read_fn = sps_grid_read, volume->range_fn = sps_grid_range, volume->user = &web.grid;
    volume->revision = ++web.revision;
    web.scene.volumes = volume, web.scene.volume_count = 1;
    return volume;
}

static double blob_density(ex_vec p) { return exp(-16 * ex_vec_dot(p, p)); }

static double smoke_density(ex_vec p) {
    const double up = p.y + 1, wide = 0.1 + 0.22 * up;
    const double dx = p.x - 0.2 * up * ex_noise(ex_vec_of(0.5, 1.6 * p.y, 3.3));
    const double dz = p.z - 0.2 * up * ex_noise(ex_vec_of(8.2, 1.6 * p.y, 0.4));
    const double depth = 1 - sqrt(dx * dx + dz * dz) / wide;
    if (depth < -0.8) return 0;
    const double eddies = ex_turbulence(ex_vec_of(5 * p.x, 3.6 * p.y, 5 * p.z), 4);
    return ex_ramp(0, 0.6, depth + 0.45 - 1.2 * eddies) * ex_ramp(1, 0.7, p.y) * ex_ramp(-1, -0.9, p.y);
}

static double cloud_density(ex_vec p) {
    const double depth = 0.72 - sqrt(ex_vec_dot(p, p) + p.y * p.y);
    return ex_clamp(6 * (depth + 0.35 * ex_fractal(ex_vec_scale(p, 3), 5)), 0, 1);
}

/* A temperature, 1 where it is hottest. */
static double fire_density(ex_vec p) {
    const double up = p.y + 1, wide = 0.30 * pow(up + 0.05, 0.4) * pow(ex_clamp(1 - up / 1.7, 0, 1), 0.7) + 1e-6;
    const double dx = p.x - 0.25 * up * ex_noise(ex_vec_of(2.1, 2 * p.y, 1.7));
    const double dz = p.z - 0.25 * up * ex_noise(ex_vec_of(4.1, 2 * p.y, 6.3));
    const double depth =
        1.1 - sqrt(dx * dx + dz * dz) / wide - 0.8 * ex_turbulence(ex_vec_of(5 * p.x, 2.4 * p.y, 5 * p.z), 3);
    return up > 1.7 ? 0 : sqrt(ex_ramp(0, 1, depth)) * (1 - 0.2 * up);
}

/* What a scanner might find: half a shell of soft matter around a dense spiral. */
static double scan_density(ex_vec p) {
    const double shell = fabs(ex_vec_length(p) - 0.8 - 0.05 * ex_noise(ex_vec_scale(p, 4)));
    const double rise = 0.35, turns = (p.y + 0.6) / rise - atan2(p.z, p.x) / (2 * EX_PI);
    const double beside = 0.93 * rise * (turns - floor(turns + 0.5)), out = sqrt(p.x * p.x + p.z * p.z) - 0.4;
    const double ends = fabs(p.y) < 0.62 ? 0 : fabs(p.y) - 0.62;
    const double dense = ex_solid(sqrt(out * out + beside * beside + ends * ends) - 0.09, 0.08);
    return fmax(0.9 * dense, 0.45 * ex_ramp(0.1, 0, p.x + 0.3 * p.z) * ex_solid(shell - 0.06, 0.08));
}

/* How scans look, by parts of their greatest value: soft matter, then dense. Extinction is that of a scan 2 wide. */
static const sps_transfer_point scan_points[] = {{0.20f, {0.80f, 0.55f, 0.42f}, 0, {0, 0, 0}},
                                                 {0.30f, {0.80f, 0.55f, 0.42f}, 60, {0, 0, 0}},
                                                 {0.55f, {0.85f, 0.75f, 0.62f}, 200, {0, 0, 0}},
                                                 {1.00f, {0.92f, 0.90f, 0.84f}, 400, {0, 0, 0}}};

/* Makes a volume show as surfaces. Cells hardly resolve how these shadow ambient light, so there is little of it. */
static void set_scan(sps_volume *volume, float greatest) {
    memcpy(web.points, scan_points, sizeof scan_points);
    for (int i = 0; i < 4; ++i) web.points[i].extinction *= (float)(2 / web.size), web.points[i].value *= greatest;
    web.transfer.points = web.points, web.transfer.point_count = 4;
    volume->transfer = &web.transfer, volume->shading = SPS_SHADING_SURFACE;
    for (int c = 0; c < 3; ++c) web.scene.ambient[c] *= 0.3f;
}

/* Two arms of dust around a dense middle. */
static void set_particles(void) {
    uint32_t random = 7;
    free(web.particles);
    web.particles = (sps_particle *)ex_allocate(PARTICLE_COUNT, sizeof *web.particles);
    for (int i = 0; i < PARTICLE_COUNT; ++i) {
        sps_particle *p = &web.particles[i];
        const double out = pow(ex_random(&random), 0.7), arm = i % 2 * EX_PI + 5 * out;
        const double spread = 0.22 * (1.1 - out), a = 2 * EX_PI * ex_random(&random), r = spread * ex_random(&random);
        p->position[0] = (float)(out * cos(arm) + r * cos(a));
        p->position[1] = (float)(0.25 * spread * (2 * ex_random(&random) - 1));
        p->position[2] = (float)(out * sin(arm) + r * sin(a));
        p->radius = (float)(0.012 + 0.02 * ex_random(&random));
        p->optical_depth = 0.35f;
    }
    memset(&web.set, 0, sizeof web.set);
    web.set.count = PARTICLE_COUNT, web.set.read_fn = ex_particles_read, web.set.user = web.particles;
    web.set.soft = 1;
    ex_color(web.set.albedo, 0.85, 0.75, 0.65);
    web.scene.particles = &web.set, web.scene.particle_set_count = 1;
}

static void set_gas(sps_volume *volume, double extinction, double red, double green, double blue) {
    volume->extinction = (float)extinction;
    ex_color(volume->albedo, red, green, blue);
}

static void set_fire(void) {
    sps_volume *fire = set_volume(ex_vec_of(-0.5, -1, -0.5), ex_vec_of(0.5, 0.8, 0.5), 80, fire_density);
    ex_temperature_points(2300, 60, 1, web.points);
    web.transfer.points = web.points, web.transfer.point_count = EX_TEMPERATURE_POINTS;
    fire->transfer = &web.transfer;
    set_ground(-1, 0.4);
    web.scene.light_count = 0;
    for (int c = 0; c < 3; ++c) web.scene.ambient[c] = web.scene.background[c] = 0.002f;
}

/* An empty scene under a warm sun and a weak sky; the camera looks down a little. */
static void begin_scene(void) {
    memset(&web.scene, 0, sizeof web.scene);
    memset(&web.light, 0, sizeof web.light);
    memset(web.centre, 0, sizeof web.centre);
    web.light.kind = SPS_LIGHT_DIRECTIONAL;
    ex_color(web.light.color, 3.2, 3, 2.7);
    web.scene.lights = &web.light, web.scene.light_count = 1;
    ex_color(web.scene.ambient, 0.10, 0.13, 0.17);
    ex_color(web.scene.background, 0.10, 0.13, 0.17);
    web.distance = 4.6, web.size = 2, web.around = 0.4, web.above = 0.3;
    web.light_around = -0.9, web.light_above = 0.8;
    web.passes = 0;
}

static void free_dropped(void) {
    free(web.dense.data), free(web.dense.ranges);
    ex_sparse_free(&web.sparse);
    memset(&web.dense, 0, sizeof web.dense), memset(&web.sparse, 0, sizeof web.sparse);
}

/* Returns 0; 1: out of memory, or no such scene. */
int WEB_CALL(web_choose)(int number) {
    const ex_vec low = ex_vec_of(-1, -1, -1), high = ex_vec_of(1, 1, 1);
    if (number < BLOB || number > PARTICLES) return ex_fail(&web.error, "there is no scene %d", number);
    for (int i = 0; i < CONTEXTS && !web.contexts[i]; ++i) {
        sps_config config;
        memset(&config, 0, sizeof config);
        config.clock_fn = web_clock, config.progress_fn = web_progress;
        web.contexts[i] = sps_create(&config, NULL);
        if (!web.contexts[i]) return ex_fail(&web.error, "there is no memory for a context");
    }
    free_dropped();
    begin_scene();
    switch (number) {
    case BLOB:
        set_gas(set_volume(low, high, 64, blob_density), 6, 0.7, 0.8, 0.9);
        ex_color(web.light.color, 9, 8, 7);
        set_ground(-0.8, 0.3);
        break;
    case SMOKE:
        set_gas(set_volume(low, high, 96, smoke_density), 9, 0.6, 0.58, 0.56);
        set_ground(-1, 0.35);
        break;
    case CLOUD: set_gas(set_volume(low, high, 96, cloud_density), 30, 1, 0.99, 0.98); break;
    case FIRE: set_fire(); break;
    case SCAN: set_scan(set_volume(low, high, 128, scan_density), 1); break;
    default: set_particles(); break;
    }
    return 0;
}

/* ---------------------------------------------------------------------------------------------------- dropped files */

static int ends_with(const char *text, const char *end) {
    const size_t length = strlen(text), size = strlen(end);
    return length >= size && strcasecmp(text + length - size, end) == 0;
}

/* Refuses more voxels than two contexts and the file have memory for: the readers would end the module. */
static int check_room(const char *path, const int size[3], size_t each) {
    const double voxels = (double)size[0] * size[1] * size[2];
    void *room = voxels <= VOXELS_MOST ? malloc((size_t)voxels * (each + 16)) : NULL;
    free(room);
    return room ? 0 : ex_fail(&web.error, "%s: %.1f million voxels are too many for the page", path, 1e-6 * voxels);
}

/* Refuses values that no picture can show. Blocks with such values have a range up to 1e18. */
static int check_values(const char *path, float greatest) {
    if (!(greatest < 1e18f)) return ex_fail(&web.error, "%s: some values are no numbers, or above 1e18", path);
    return greatest > 0 ? 0 : ex_fail(&web.error, "%s: no voxel is above 0", path);
}

static int open_sparse(const char *path, ex_sparse *sparse, sps_volume *volume, float *greatest) {
    const ex_sparse_format *format = ends_with(path, ".nvdb") ? &ex_nvdb : &ex_vdb;
    if (ex_sparse_open(format, sparse, path, NULL, LARGEST_FILE, &web.error)) return 1;
    if (ex_sparse_highest(sparse, greatest, &web.error) || check_values(path, *greatest)) return 1;
    memcpy(volume->size, sparse->size, sizeof volume->size);
    volume->placement = ex_sparse_placement(sparse);
    volume->read_fn = ex_sparse_read, volume->range_fn = ex_sparse_range, volume->user = &web.sparse;
    volume->range_levels = EX_SPARSE_RANGE_LEVELS;
    return 0;
}

/* A patient's z is upwards. */
static void stand_up(sps_placement *placement) {
    for (int n = 0; n < 4; ++n) {
        double *v = n < 3 ? placement->axis[n] : placement->origin;
        const double up = v[2];
        v[2] = -v[1], v[1] = up;
    }
}

static int open_dense(const char *path, ex_grid *dense, sps_volume *volume, float *greatest) {
    ex_volume_file file;
    if (!ex_volume_format_of(path))
        return ex_fail(&web.error, "%s: not a .nrrd, .nii, .nii.gz, .mha, .npy, .npz, .vdb or .nvdb file", path);
    if (ex_volume_file_read(&file, path, &web.error)) return 1;
    if (check_room(path, file.voxels.size, ex_type_size(file.voxels.type))) return 1;
    file.voxels.max_bytes = LARGEST_FILE;
    if (ex_grid_load(dense, &file.voxels, &web.error)) return 1;
    for (size_t i = 0; i < (size_t)dense->blocks[0] * (size_t)dense->blocks[1] * (size_t)dense->blocks[2]; ++i)
        *greatest = fmaxf(*greatest, dense->ranges[2 * i + 1]);
    if (check_values(path, *greatest)) return 1;
    memcpy(volume->size, file.voxels.size, sizeof volume->size);
    volume->placement = ex_volume_file_placement(&file);
    if (!ex_type_is_float(file.voxels.type)) stand_up(&volume->placement);
    volume->read_fn = ex_grid_read, volume->range_fn = ex_grid_range, volume->user = &web.dense;
    return 0;
}

/* Sets centre, size and distance from the volume's box. */
static void look_at(const sps_volume *volume) {
    web.size = 0;
    for (int k = 0; k < 3; ++k) web.centre[k] = volume->placement.origin[k];
    for (int a = 0; a < 3; ++a) {
        double square = 0;
        for (int k = 0; k < 3; ++k) {
            web.centre[k] += 0.5 * volume->placement.axis[a][k];
            square += pow(volume->placement.axis[a][k], 2);
        }
        web.size = fmax(web.size, sqrt(square));
    }
    web.distance = 2.5 * web.size;
}

/* Opens a file; the scene stays as it is if that fails. Returns 0, or 1 and leaves a sentence. */
int WEB_CALL(web_open)(const char *path) {
    sps_volume volume;
    ex_grid dense;
    ex_sparse sparse;
    float greatest = 0;
    memset(&volume, 0, sizeof volume), memset(&dense, 0, sizeof dense), memset(&sparse, 0, sizeof sparse);
    const int is_sparse = ends_with(path, ".vdb") || ends_with(path, ".nvdb");
    if (is_sparse ? open_sparse(path, &sparse, &volume, &greatest) : open_dense(path, &dense, &volume, &greatest)) {
        free(dense.data), free(dense.ranges);
        ex_sparse_free(&sparse);
        return 1;
    }
    free_dropped();
    web.dense = dense, web.sparse = sparse;
    begin_scene();
    look_at(&volume);
    web.volume = volume;
    web.volume.revision = ++web.revision;
    web.scene.volumes = &web.volume, web.scene.volume_count = 1;
    if (!is_sparse && !ex_type_is_float(dense.type))
        set_scan(&web.volume, greatest);
    else
        set_gas(&web.volume, 60 / web.size / (double)greatest, 0.9, 0.9, 0.9);
    return 0;
}

/* ------------------------------------------------------------------------------------------------------ the camera */

void WEB_CALL(web_turn)(double around, double above) {
    web.around += around;
    web.above = ex_clamp(web.above + above, -1.5, 1.5);
    web.passes = 0;
}

void WEB_CALL(web_zoom)(double factor) {
    web.distance = ex_clamp(web.distance * factor, 0.3 * web.size, 20 * web.size);
    web.passes = 0;
}

void WEB_CALL(web_turn_light)(double around, double above) {
    web.light_around += around;
    web.light_above = ex_clamp(web.light_above + above, -1.5, 1.5);
    web.passes = 0;
}

static ex_vec direction_of(double around, double above) {
    return ex_vec_of(cos(above) * sin(around), sin(above), cos(above) * cos(around));
}

/* A matrix that shows every step-th pixel of the picture from `first` on, or all of them. */
static void set_matrix(int step, int first, int columns, int rows, double matrix[16]) {
    const ex_vec toward = direction_of(web.around, web.above), ahead = ex_vec_scale(toward, -1);
    const ex_vec right = ex_vec_unit(ex_vec_cross(ahead, ex_vec_of(0, 1, 0))), up = ex_vec_cross(right, ahead);
    const ex_vec centre = ex_vec_of(web.centre[0], web.centre[1], web.centre[2]);
    const ex_vec eye = ex_vec_add(centre, ex_vec_scale(toward, web.distance));
    const double wide = (double)step * columns / web.width, high = (double)step * rows / web.height;
    const double off = 2 * (first + 0.5 - 0.5 * step), zoom = 1 / tan(0.25);
    const double left = wide - 1 + off / web.width, top = 1 - high - off / web.height;
    const double across = zoom * web.height / web.width;
    const ex_vec axes[3] = {ex_vec_scale(ex_vec_sub(ex_vec_scale(right, across), ex_vec_scale(ahead, left)), 1 / wide),
                            ex_vec_scale(ex_vec_sub(ex_vec_scale(up, zoom), ex_vec_scale(ahead, top)), 1 / high),
                            ahead};
    memset(matrix, 0, 16 * sizeof *matrix);
    for (int i = 0; i < 3; ++i) {
        double *row = matrix + 4 * (i == 2 ? 3 : i);
        row[0] = axes[i].x, row[1] = axes[i].y, row[2] = axes[i].z;
        row[3] = -ex_vec_dot(axes[i], eye);
    }
    matrix[11] = 2;
}

/* ---------------------------------------------------------------------------------------------------------- frames */

static void set_size(int width, int height) {
    const size_t pixels = (size_t)width * (size_t)height;
    if (width == web.width && height == web.height) return;
    free(web.rgba), free(web.other), free(web.codes);
    web.rgba = (float *)ex_allocate(pixels, 4 * sizeof(float));
    web.other = (float *)ex_allocate(pixels, 4 * sizeof(float));
    web.codes = (unsigned char *)ex_allocate(pixels, 4);
    web.width = width, web.height = height, web.passes = 0;
}

static void set_light(void) {
    const ex_vec toward = direction_of(web.light_around, web.light_above);
    web.light.direction[0] = -toward.x, web.light.direction[1] = -toward.y, web.light.direction[2] = -toward.z;
}

static unsigned char srgb_code(float linear) {
    return (unsigned char)(0.5f +
                           255 * (linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1 / 2.4f) - 0.055f));
}

/* Codes of a picture's top left, without gaps. The table's steps are an eighth of a code at most. */
static void encode(int width, int height) {
    enum { STEPS = 32768 };
    static unsigned char table[STEPS + 1];
    unsigned char *code = web.codes;
    for (int i = 0; i <= STEPS && !table[STEPS]; ++i) table[i] = srgb_code((float)i / STEPS);
    table[STEPS] = 255;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x, code += 4) {
            const float *pixel = web.rgba + 4 * ((size_t)y * (size_t)web.width + (size_t)x);
            for (int c = 0; c < 3; ++c) code[c] = table[(int)(STEPS * fminf(fmaxf(pixel[c], 0), 1) + 0.5f)];
            code[3] = 255;
        }
}

/* The whole picture at a quality, seen through `matrix`, which this fills. */
static sps_view view_of(int quality, double matrix[16]) {
    sps_view view;
    memset(&view, 0, sizeof view);
    set_light();
    set_matrix(1, 0, web.width, web.height, matrix);
    view.camera.world_to_clip = matrix;
    view.width = web.width, view.height = web.height;
    view.quality = (sps_quality)quality;
    return view;
}

/* Renders a frame: within `milliseconds`, perhaps smaller; or, if these are 0, of a quality. Returns 0, or 1. */
int WEB_CALL(web_frame)(int width, int height, double milliseconds, int quality) {
    const int context = milliseconds > 0 ? MOVING : STILL;
    double matrix[16];
    sps_stats_report stats;
    set_size(width, height);
    sps_view view = view_of(milliseconds > 0 ? 0 : quality, matrix);
    if (milliseconds > 0) view.budget_seconds = 0.001 * milliseconds, view.budget_scale_min = 0.5;
    const sps_image image = {web.rgba, NULL, 0};
    if (sps_render(web.contexts[context], &web.scene, &view, &image)) return web_fail(context);
    sps_get_stats(web.contexts[context], &stats);
    const int shown[2] = {stats.budget.width ? stats.budget.width : width,
                          stats.budget.height ? stats.budget.height : height};
    encode(shown[0], shown[1]);
    snprintf(web.report, sizeof web.report,
             "{\"ms\":%.2f,\"width\":%d,\"height\":%d,\"quality\":%d,\"slabs\":%d,\"cells\":%d}",
             1e3 * stats.seconds_total, shown[0], shown[1], milliseconds > 0 ? (int)stats.budget.quality : quality,
             (int)stats.slabs, (int)stats.cells);
    return 0;
}

/* Reports the passes that a frame of a quality runs, and why. */
int WEB_CALL(web_plan)(int quality) {
    double matrix[16];
    sps_plan_report plan;
    size_t length = 0;
    const sps_view view = view_of(quality, matrix);
    if (sps_plan(web.contexts[STILL], &web.scene, &view, &plan)) return web_fail(STILL);
    for (int i = 0; i < SPS_PASS_COUNT; ++i) {
        const sps_pass_report *pass = &plan.pass[i];
        const int added = snprintf(web.report + length, sizeof web.report - length, "%s[\"%s\",%d,\"%s\"]",
                                   i ? "," : "[", sps_pass_name((sps_pass)i), pass->runs, pass->reason);
        if (added < 0 || (size_t)added >= sizeof web.report - length - 2) break;
        length += (size_t)added;
    }
    strcpy(web.report + length, "]");
    return 0;
}

/* ---------------------------------------------------------------------------------------------- what accuracy costs */

/* Adds paths through every step-th pixel, for the error of a picture as it stands. Returns 0, or 1. */
int WEB_CALL(web_measure)(int paths) {
    double matrix[16];
    sps_reference_settings settings;
    if (web.passes == 0) {
        web.step = web.width > SAMPLED ? web.width / SAMPLED : 1;
        web.columns = (web.width - web.step / 2 - 1) / web.step + 1;
        web.rows = (web.height - web.step / 2 - 1) / web.step + 1;
        const size_t count = (size_t)web.columns * (size_t)web.rows;
        free(web.sums), free(web.squares), free(web.mean), free(web.deviation);
        web.sums = (float *)ex_allocate(count, 3 * sizeof(float));
        web.squares = (float *)ex_allocate(count, 3 * sizeof(float));
        web.mean = (float *)ex_allocate(count, 4 * sizeof(float));
        web.deviation = (float *)ex_allocate(count, 3 * sizeof(float));
        for (int q = 0; q < QUALITIES; ++q) free(web.tried[q]), web.tried[q] = NULL;
    }
    sps_view view = view_of(0, matrix);
    set_matrix(web.step, web.step / 2, web.columns, web.rows, matrix);
    view.width = web.columns, view.height = web.rows;
    memset(&settings, 0, sizeof settings);
    settings.step = 1, settings.samples = paths, settings.seed = (uint64_t)web.passes + 1;
    settings.error = web.deviation;
    const sps_image image = {web.mean, NULL, 0};
    if (sps_reference(web.contexts[STILL], &web.scene, &view, &settings, &image)) return web_fail(STILL);
    for (int i = 0; i < 3 * web.columns * web.rows; ++i) {
        web.sums[i] += web.mean[4 * (i / 3) + i % 3];
        web.squares[i] += web.deviation[i] * web.deviation[i];
    }
    ++web.passes;
    return 0;
}

/* Number i of the sampled pixels' channels, in a picture. */
static float sampled(const float *picture, int i) {
    const int x = i / 3 % web.columns * web.step + web.step / 2, y = i / 3 / web.columns * web.step + web.step / 2;
    return picture[4 * (y * web.width + x) + i % 3];
}

/* The root mean square difference to the paths' mean, less their noise, over their mean radiance; or, with `noise`,
   that noise. Quality 0: the picture shown; else one that web_try has rendered. -1: nothing is measured yet. */
double WEB_CALL(web_difference)(int quality, int noise) {
    const int count = 3 * web.columns * web.rows, passes = web.passes;
    double difference = 0, variance = 0, mean = 0;
    if (passes == 0 || quality < 0 || quality >= QUALITIES || (quality && !web.tried[quality])) return -1;
    for (int i = 0; i < count; ++i) {
        const float shown = quality ? web.tried[quality][i] : sampled(web.rgba, i);
        const double exact = (double)web.sums[i] / passes;
        mean += exact / count;
        difference += pow((double)shown - exact, 2) / count;
        variance += (double)web.squares[i] / ((double)passes * passes) / count;
    }
    return sqrt(fmax(noise ? variance : difference - variance, 0)) / fmax(mean, 1e-12);
}

/* Renders a frame of a quality that is not shown, twice, and reports the milliseconds of the second, for which light is
   cached. web_measure must have been called. Returns 0, or 1. */
int WEB_CALL(web_try)(int quality) {
    double matrix[16];
    sps_stats_report stats;
    const int count = 3 * web.columns * web.rows;
    const sps_view view = view_of(quality, matrix);
    const sps_image image = {web.other, NULL, 0};
    for (int i = 0; i < 2; ++i)
        if (sps_render(web.contexts[STILL], &web.scene, &view, &image)) return web_fail(STILL);
    sps_get_stats(web.contexts[STILL], &stats);
    free(web.tried[quality]);
    web.tried[quality] = (float *)ex_allocate((size_t)count, sizeof(float));
    for (int i = 0; i < count; ++i) web.tried[quality][i] = sampled(web.other, i);
    snprintf(web.report, sizeof web.report, "%.2f", 1e3 * stats.seconds_total);
    return 0;
}

const float *WEB_CALL(web_rgba)(void) { return web.rgba; }
const unsigned char *WEB_CALL(web_codes)(void) { return web.codes; }
const char *WEB_CALL(web_report)(void) { return web.report; }
const char *WEB_CALL(web_sentence)(void) { return web.error.text; }
/* Where JavaScript writes a file's name. */
char *WEB_CALL(web_name)(void) {
    static char name[256];
    return name;
}
