/* Step 4 of docs/tutorial.md: an engine's own data, memory, threads and clock; cancelling; errors as data.
   cc -O3 -march=native -I. -I/usr/include/stb examples/tutorial/4_engine.c -o 4_engine -pthread -lm */

#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"
#include "picture.h"
#include <pthread.h>
#include <time.h>

enum { WIDTH = 320, HEIGHT = 240, PAGE = 16, NX = 128, NY = 160, NZ = 128, WORKERS = 2 };

/* The engine keeps smoke in pages of 16^3 voxels, and only those that hold any. */
typedef struct page {
    float max, voxels[PAGE][PAGE][PAGE];
} page;

typedef struct engine {
    page *pages[NZ / PAGE][NY / PAGE][NX / PAGE]; /* NULL: empty */
    uint64_t revision;                            /* raised by whatever changes a voxel */
    size_t bytes, bytes_peak;                     /* by engine_alloc */
    double deadline;                              /* by engine_seconds: a frame that takes longer is cancelled */
} engine;

static void set_voxel(engine *e, int x, int y, int z, float value) {
    page **at = &e->pages[z / PAGE][y / PAGE][x / PAGE];
    if (!*at && value > 0) *at = (page *)calloc(1, sizeof **at);
    if (!*at) return;
    (*at)->voxels[z % PAGE][y % PAGE][x % PAGE] = value;
    (*at)->max = fmaxf((*at)->max, value);
    ++e->revision;
}

/* Two columns that wind around each other and grow wider as they rise; x and z -0.8..0.8, y 0..2. */
static void fill_smoke(engine *e) {
    for (int i = 0; i < NX * NY * NZ; ++i) {
        const int ix = i % NX, iy = i / NX % NY, iz = i / (NX * NY);
        const double x = (ix + 0.5) * 1.6 / NX - 0.8, y = (iy + 0.5) * 2.0 / NY, z = (iz + 0.5) * 1.6 / NZ - 0.8;
        const double c = 0.22 * cos(5 * y), s = 0.22 * sin(5 * y), width = 0.1 + 0.06 * y;
        const double away = fmin(hypot(x - c, z - s), hypot(x + c, z + s)) / width;
        const double ripple = 1 + 0.5 * sin(19 * y + 9 * x) * sin(17 * z + 7 * y);
        set_voxel(e, ix, iy, iz, (float)(fmax(0, 1 - ripple * away * away) * fmin(1, 4 * (2 - y))));
    }
}

/* sps_volume.read_fn: any block; its ends need not be those of pages. `out` comes zeroed. */
static int read_pages(void *user, const int lo[3], const int size[3], float *out) {
    const engine *e = (const engine *)user;
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y)
            for (int x = lo[0]; x < lo[0] + size[0]; ++x, ++out) {
                const page *p = e->pages[z / PAGE][y / PAGE][x / PAGE];
                if (p) *out = p->voxels[z % PAGE][y % PAGE][x % PAGE];
            }
    return 0;
}

/* sps_volume.range_fn: bounds may be wide, so those of all pages that the block touches will do. */
static int range_of_pages(void *user, const int lo[3], const int size[3], float out_min_max[2]) {
    const engine *e = (const engine *)user;
    out_min_max[0] = out_min_max[1] = 0;
    for (int z = lo[2] / PAGE; z <= (lo[2] + size[2] - 1) / PAGE; ++z)
        for (int y = lo[1] / PAGE; y <= (lo[1] + size[1] - 1) / PAGE; ++y)
            for (int x = lo[0] / PAGE; x <= (lo[0] + size[0] - 1) / PAGE; ++x)
                if (e->pages[z][y][x]) out_min_max[1] = fmaxf(out_min_max[1], e->pages[z][y][x]->max);
    return 0;
}

static void *engine_alloc(void *user, size_t size) {
    engine *e = (engine *)user;
    void *memory = malloc(size);
    if (memory && (e->bytes += size) > e->bytes_peak) e->bytes_peak = e->bytes;
    return memory;
}

static void engine_free(void *user, void *pointer, size_t size) {
    if (pointer) ((engine *)user)->bytes -= size;
    free(pointer);
}

static double engine_seconds(void *user) {
    struct timespec now;
    (void)user;
    return clock_gettime(CLOCK_MONOTONIC, &now), (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* sps_config.progress_fn: non-zero cancels. */
static int check_deadline(void *user, float fraction) {
    return fraction < 1 && engine_seconds(NULL) > ((const engine *)user)->deadline;
}

/* A loop whose indices several threads take. */
typedef struct loop {
    pthread_mutex_t mutex;
    int next, count, workers;
    sps_task_fn task;
    void *data;
} loop;

static void *run_loop(void *user) {
    loop *l = (loop *)user;
    pthread_mutex_lock(&l->mutex);
    const int worker = l->workers++;
    while (l->next < l->count) {
        const int index = l->next++;
        pthread_mutex_unlock(&l->mutex);
        l->task(l->data, index, worker);
        pthread_mutex_lock(&l->mutex);
    }
    pthread_mutex_unlock(&l->mutex);
    return NULL;
}

/* sps_config.parallel_for_fn. An engine has threads waiting (examples/threads.h); here they are made for each loop. */
static void parallel_for(void *user, int count, sps_task_fn task, void *data) {
    loop l = {.mutex = PTHREAD_MUTEX_INITIALIZER, .count = count, .task = task, .data = data};
    pthread_t threads[WORKERS - 1];
    int started = 0;
    (void)user;
    while (started < WORKERS - 1 && started < count - 1 && !pthread_create(&threads[started], NULL, run_loop, &l))
        ++started;
    run_loop(&l);
    while (started > 0) pthread_join(threads[--started], NULL);
}

/* A frame within `seconds`. What can be mended by looking at the error is mended, and the frame begun again. */
static sps_result render_frame(engine *e, sps_context *context, sps_scene *scene, sps_light *light, sps_image *image,
                               double seconds) {
    sps_view view = {.width = WIDTH, .height = HEIGHT, .scattering = SPS_SCATTERING_OFF};
    sps_error_info why;
    sps_stats_report stats;
    view.camera =
        (sps_camera){.position = {0.6, 1.7, 5.2}, .target = {0, 0.9, 0}, .field_of_view = 0.5, .up = {0, 1, 0}};
    e->deadline = engine_seconds(NULL) + seconds;
    sps_render(context, scene, &view, image);
    sps_get_error(context, &why);
    sps_get_stats(context, &stats);
    printf("%s: %.3f s, %llu blocks read, %llu skipped, %.1f MB\n", why.result == SPS_OK ? "rendered" : why.sentence,
           stats.seconds_total, (unsigned long long)stats.read_calls, (unsigned long long)stats.blocks_skipped,
           1e-6 * (double)e->bytes_peak);
    if (why.result == SPS_ERROR_UNSUPPORTED && why.object == SPS_OBJECT_LIGHT &&
        light[why.index].shadow_source == SPS_SHADOW_SHEETS) {
        light[why.index].shadow_source = SPS_SHADOW_AUTO; /* no slabs serve it: tables do */
        return render_frame(e, context, scene, light, image, seconds);
    }
    return why.result;
}

int main(int argc, char **argv) {
    static const float corners[] = {-900, 0, -900, 0, 0, 99, 900, 0, -900};
    static float rgba[WIDTH * HEIGHT * 4];
    static engine e;
    fill_smoke(&e);
    sps_volume smoke = {.size = {NX, NY, NZ}, .placement = {{-.8, 0, -.8}, {{1.6, 0, 0}, {0, 2, 0}, {0, 0, 1.6}}}};
    smoke.read_fn = read_pages, smoke.range_fn = range_of_pages, smoke.user = &e, smoke.revision = e.revision;
    smoke.extinction = 15;
    smoke.albedo[0] = smoke.albedo[1] = smoke.albedo[2] = 0.9f;
    sps_indexed_mesh ground = {.vertex_count = 3, .positions = corners, .triangle_count = 1};
    sps_mesh mesh = {.triangle_count = 1, .read_fn = sps_indexed_mesh_read, .user = &ground, .revision = 1};
    mesh.color[0] = mesh.color[1] = mesh.color[2] = 0.3f;
    sps_light lights[2] = {{.direction = {1, -1, -0.7}, .color = {5, 5.5f, 6}},
                           {.kind = SPS_LIGHT_DISC, .position = {0, 0.35, 0}, .color = {1.5f, 0.6f, 0.2f}}};
    lights[1].axes[0][0] = lights[1].axes[1][2] = 0.05; /* a flame */
    lights[1].shadow_source = SPS_SHADOW_SHEETS;
    sps_scene scene = {.volumes = &smoke, .volume_count = 1, .meshes = &mesh, .mesh_count = 1};
    scene.lights = lights, scene.light_count = 2;
    scene.background[0] = 0.05f, scene.background[1] = 0.07f, scene.background[2] = 0.1f;
    sps_image image = {.rgba = rgba};

    sps_config config = {.parallel_for_fn = parallel_for, .worker_count = WORKERS, .clock_fn = engine_seconds};
    config.alloc_fn = engine_alloc, config.free_fn = engine_free, config.alloc_user = &e;
    config.progress_fn = check_deadline, config.progress_user = &e;
    sps_error_info why;
    sps_context *context = sps_create(&config, &why);
    if (!context) return puts(why.sentence), 1;
    render_frame(&e, context, &scene, lights, &image, 0);                /* too late: cancelled */
    if (render_frame(&e, context, &scene, lights, &image, 60)) return 1; /* the light is mended */
    lights[0].direction[0] = -1;                                         /* changes no voxel */
    if (render_frame(&e, context, &scene, lights, &image, 60)) return 1; /* reads none */
    sps_destroy(context);

    ex_error error;
    if (ex_write_picture(argc > 1 ? argv[1] : "4_engine.png", rgba, WIDTH, HEIGHT, &error)) return puts(error.text), 1;
    return e.bytes != 0; /* the context has given all back */
}
