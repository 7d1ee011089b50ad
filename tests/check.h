/* Counted checks, and small scenes for several tests. Includes the library's implementation, so that tests can call
   private functions. A test is a program: CHECK things in main, and end with `return check_report();`. */

#ifndef CHECK_H
#define CHECK_H

#define SPLATSHADOW_IMPLEMENTATION
#include "splatshadow.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* --------------------------------------------------------------------------------------------------------- counting */

static int check_passed, check_failed;

static inline int check_count(int good) {
    if (good)
        ++check_passed;
    else
        ++check_failed;
    return good;
}

/* Prints the last line of a test program, and returns its exit status. */
static inline int check_report(void) {
    printf("%d passed, %d failed\n", check_passed, check_failed);
    return check_failed != 0;
}

/* After a failed check: exits if the environment has CHECK_STOP. */
static inline int check_failure(void) {
    if (getenv("CHECK_STOP")) exit(check_report());
    return 0;
}

static inline int check_true(int good, const char *text, const char *file, int line) {
    if (check_count(good)) return 1;
    printf("%s:%d: failed: %s\n", file, line, text);
    return check_failure();
}

/* NaN is near nothing. Infinity is near itself. */
static inline int check_near(double value, double exact, double tolerance, const char *text, const char *file,
                             int line) {
    const int good = value == exact || fabs(value - exact) <= tolerance;
    if (check_count(good)) return 1;
    printf("%s:%d: failed: %s is %.9g, exact %.9g, off by %.3g, allowed %.3g\n", file, line, text, value, exact,
           value - exact, tolerance);
    return check_failure();
}

/* Each returns whether it held, so that a loop can name its case: if (!CHECK(x)) printf("    at angle %d\n", i); */
#define CHECK(condition)                    check_true((condition) ? 1 : 0, #condition, __FILE__, __LINE__)
#define CHECK_NEAR(value, exact, tolerance) check_near((value), (exact), (tolerance), #value, __FILE__, __LINE__)
/* The call returns SPS_OK; otherwise prints the context's sentence. */
#define CHECK_OK(context, call) check_result((context), (call), #call, __FILE__, __LINE__)
/* The same for a hard case: `measured` is at most `tolerance`, `why` it may be that much. docs/hard-cases.md lists all
   of them; a case that is checked more than once has the row of its worst. The four texts are literals. What must hold
   exactly has a tolerance of 0, and as `measured` 0 or 1, or the number of places where it does not hold. */
#define CHECK_CASE(group, name, expectation, measured, tolerance, why)                                                 \
    check_case(group "\t" name "\t" expectation "\t" why, (measured), (tolerance), __FILE__, __LINE__, __func__)

static inline int check_result(const sps_context *context, sps_result result, const char *text, const char *file,
                               int line) {
    if (check_count(result == SPS_OK)) return 1;
    printf("%s:%d: failed: %s gives %d: %s\n", file, line, text, (int)result, sps_error(context));
    return check_failure();
}

/* Appends the row to the file that CHECK_CASES in the environment names, for `make hard-cases`, unless the row before
   it is the same case, and no better. Lines are written whole, since programs that run at once share the file. NaN is
   not within any tolerance. */
static inline int check_case(const char *row, double measured, double tolerance, const char *file, int line,
                             const char *function) {
    static FILE *cases;
    static const char *last;
    static double worst;
    const double ratio = tolerance > 0 ? measured / tolerance : measured;
    const char *path = getenv("CHECK_CASES");
    if (path && !cases && (cases = fopen(path, "a")) != NULL) setvbuf(cases, NULL, _IOLBF, BUFSIZ);
    if (cases && !(row == last && ratio <= worst)) {
        fprintf(cases, "%s\t%.9g\t%.9g\t%s\t%d\t%s\n", row, measured, tolerance, file, line, function);
        last = row, worst = ratio;
    }
    if (check_count(measured <= tolerance)) return 1;
    printf("%s:%d: failed: %s: %.9g, allowed %.9g\n", file, line, row, measured, tolerance);
    return check_failure();
}

/* Whether the data of sps_get_error agree with the last call's sentence: "OBJECT[index].FIELD", and the value, as a
   number or as the name of an enumerator. */
static inline int check_error_info(const sps_context *context, sps_result result) {
    static const char *const names[] = {"",         "",         "config", "scene",     "view",   "image",
                                        "volume",   "mesh",     "light",  "particles", "tmap",   "light",
                                        "settings", "settings", "export", "out",       "strands"};
    char start[128], number[32];
    sps_error_info info;
    sps_get_error(context, &info);
    if (info.result != result || strcmp(info.sentence, sps_error(context)) != 0) return 0;
    snprintf(start, sizeof start, "%s%s%s", names[info.object],
             *names[info.object] && *info.field && info.index < 0 ? "." : "", info.index < 0 ? info.field : "");
    if (info.index >= 0)
        snprintf(start, sizeof start, "%s[%d]%s%s", names[info.object], info.index, *info.field ? "." : "", info.field);
    snprintf(number, sizeof number, "%g", info.value);
    return strncmp(info.sentence, start, strlen(start)) == 0 &&
           (info.value == 0 || strstr(info.sentence + strlen(start), number) ||
            strncmp(info.sentence + strlen(start), " is SPS_", 8) == 0);
}

/* CHECK_FIGURES in the environment: tests print what they measure. */
static inline int figures(void) { return getenv("CHECK_FIGURES") != NULL; }

/* Runs one test, and names it if it failed. The environment may have CHECK_TIMES, which prints the time of each;
   CHECK_ONLY, the name of the only one to run; and CHECK_STOP, which prints each name as it begins, so that a crash can
   be attributed. */
static inline void check_run(const char *name, void (*test)(void)) {
    const int failed = check_failed;
    const char *only = getenv("CHECK_ONLY");
    clock_t start;
    if (only && strcmp(only, name) != 0) return;
    if (getenv("CHECK_STOP")) printf("running %s\n", name), fflush(stdout);
    start = clock();
    test();
    if (check_failed > failed) printf("%s: %d failed\n", name, check_failed - failed);
    if (getenv("CHECK_TIMES")) printf("%s: %.2f s\n", name, (double)(clock() - start) / CLOCKS_PER_SEC);
    fflush(stdout);
}

#define RUN(test) check_run(#test, test)

/* Whether these are the long tests. The others leave out what costs time and repeats what is tested elsewhere. */
static inline int check_long(void) { return getenv("SPLATSHADOW_LONG") != NULL; }

/* Runs a test among the long ones only: it is slow, and other tests were the first to notice each deliberate error of
   tests/mutants.txt. */
#define RUN_LONG(test)                                                                                                 \
    do {                                                                                                               \
        if (check_long()) RUN(test);                                                                                   \
    } while (0)

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SANITIZED 1
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0
#endif

/* Whether these are quick tests under sanitizers, which look at memory: fewer variants of a scene show as much. */
static inline int check_memory_only(void) { return SANITIZED && !check_long(); }

/* ------------------------------------------------------------------------------------------------------------ files */

/* Returns the contents of a file, which the caller frees, and their size; NULL if it cannot be read. Tests run in the
   project's folder. */
static inline char *read_bytes(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    const size_t room = 1 << 20;
    char *text = file ? (char *)malloc(room + 1) : NULL;
    *size = text ? fread(text, 1, room, file) : 0;
    if (text) text[*size] = 0;
    if (file) fclose(file);
    return text;
}

static inline char *read_text(const char *path) {
    size_t size;
    return read_bytes(path, &size);
}

/* ---------------------------------------------------------------------------------------------------------- vectors */

#define PI 3.14159265358979323846

static inline double vec_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline double vec_length(const double a[3]) { return sqrt(vec_dot(a, a)); }

static inline void vec_cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double vec_determinant(const double a[3], const double b[3], const double c[3]) {
    double bc[3];
    vec_cross(b, c, bc);
    return vec_dot(a, bc);
}

/* out = a + t b */
static inline void vec_along(const double a[3], const double b[3], double t, double out[3]) {
    for (int i = 0; i < 3; ++i) out[i] = a[i] + t * b[i];
}

static inline void vec_normalise(double a[3]) {
    const double length = vec_length(a);
    for (int i = 0; i < 3; ++i) a[i] /= length;
}

/* Two unit vectors perpendicular to the unit vector n. */
static inline void vec_basis(const double n[3], double x[3], double y[3]) {
    const double ax = fabs(n[0]), ay = fabs(n[1]), az = fabs(n[2]);
    const int least = ax <= ay && ax <= az ? 0 : ay <= az ? 1 : 2;
    for (int i = 0; i < 3; ++i) x[i] = (i == least) - n[least] * n[i];
    vec_normalise(x);
    vec_cross(n, x, y);
}

/* --------------------------------------------------------------------------------------------------- random numbers */

typedef struct check_random {
    uint64_t state;
} check_random;

/* 0 <= x < 1, the same on every machine. [L'Ecuyer 1999, multiplier for 2^64] */
static inline double check_next(check_random *random) {
    random->state = random->state * 2862933555777941757u + 3037000493u;
    return (double)(random->state >> 11) / 9007199254740992.0;
}

/* ------------------------------------------------------------------------------------------------ context and hooks */

/* An allocator that counts, and that can fail; a loop that runs its indices out of order with changing worker ids. */
typedef struct check_hooks {
    int worker_count;    /* 0: no parallel_for_fn */
    uint64_t order;      /* changes the order in which indices run */
    size_t memory_limit; /* 0: no limit */
    long fail_at;        /* the allocation, counted from 1, that fails; 0: none */
    long allocations;    /* requested so far */
    size_t live, peak;   /* bytes */
    long live_blocks;
    long loops; /* calls of parallel_for */
} check_hooks;

static inline void *check_alloc(void *user, size_t size) {
    check_hooks *hooks = (check_hooks *)user;
    void *pointer;
    if (++hooks->allocations == hooks->fail_at || size == 0) return NULL; /* as some allocators do */
    pointer = malloc(size);
    if (!pointer) return NULL;
    memset(pointer, 0xcd, size); /* reading uninitialised memory yields odd numbers, the same ones each time */
    hooks->live += size;
    hooks->live_blocks += 1;
    if (hooks->live > hooks->peak) hooks->peak = hooks->live;
    return pointer;
}

static inline void check_free(void *user, void *pointer, size_t size) {
    check_hooks *hooks = (check_hooks *)user;
    hooks->live -= size;
    hooks->live_blocks -= 1;
    free(pointer);
}

/* Runs 0..count-1 in a shuffled order; the worker ids follow another sequence, so that these are shuffled too. */
static inline void check_parallel_for(void *user, int count, sps_task_fn task, void *task_data) {
    check_hooks *hooks = (check_hooks *)user;
    check_random random;
    int *order = (int *)malloc(sizeof(int) * (size_t)(count > 0 ? count : 1));
    random.state = hooks->order + 1;
    hooks->loops += 1;
    if (!order) abort();
    for (int i = 0; i < count; ++i) order[i] = i;
    for (int i = count - 1; i > 0; --i) {
        const int other = (int)(check_next(&random) * (i + 1)), kept = order[i];
        order[i] = order[other];
        order[other] = kept;
    }
    for (int i = 0; i < count; ++i) task(task_data, order[i], (int)(check_next(&random) * hooks->worker_count));
    free(order);
}

/* A config that calls the hooks. */
static inline sps_config check_config(check_hooks *hooks) {
    sps_config config;
    memset(&config, 0, sizeof config);
    config.alloc_fn = check_alloc;
    config.free_fn = check_free;
    config.alloc_user = hooks;
    config.memory_limit = hooks->memory_limit;
    if (hooks->worker_count > 0) {
        config.parallel_for_fn = check_parallel_for;
        config.parallel_user = hooks;
        config.worker_count = hooks->worker_count;
    }
    return config;
}

/* hooks may be NULL: a context with all defaults. Returns NULL if sps_create does. */
static inline sps_context *check_context(check_hooks *hooks) {
    sps_config config;
    if (!hooks) return sps_create(NULL, NULL);
    config = check_config(hooks);
    return sps_create(&config, NULL);
}

/* ------------------------------------------------------------------------------------------------ sources of voxels */

/* read_fn: every voxel has the value *(float *)user. */
static inline int check_read_constant(void *user, const int lo[3], const int size[3], float *out) {
    const size_t count = (size_t)size[0] * (size_t)size[1] * (size_t)size[2];
    (void)lo;
    for (size_t i = 0; i < count; ++i) out[i] = *(const float *)user;
    return 0;
}

/* eval_fn: the value *(float *)user everywhere. */
static inline int check_eval_constant(void *user, size_t count, const double *positions, float *out) {
    (void)positions;
    for (size_t i = 0; i < count; ++i) out[i] = *(const float *)user;
    return 0;
}

/* A formula, for use as read_fn (through its placement, which must be the volume's) or as eval_fn. */
typedef struct check_field {
    double (*value_fn)(const void *user, const double position[3]);
    const void *user;
    int size[3];
    sps_placement placement;
} check_field;

static inline int check_eval_field(void *user, size_t count, const double *positions, float *out) {
    const check_field *field = (const check_field *)user;
    for (size_t i = 0; i < count; ++i) out[i] = (float)field->value_fn(field->user, positions + 3 * i);
    return 0;
}

static inline int check_read_field(void *user, const int lo[3], const int size[3], float *out) {
    const check_field *field = (const check_field *)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) {
                const int voxel[3] = {lo[0] + i, lo[1] + j, lo[2] + k};
                double position[3];
                for (int c = 0; c < 3; ++c) {
                    position[c] = field->placement.origin[c];
                    for (int a = 0; a < 3; ++a)
                        position[c] += (voxel[a] + 0.5) / field->size[a] * field->placement.axis[a][c];
                }
                *out++ = (float)field->value_fn(field->user, position);
            }
    return 0;
}

/* read_fn of an array, x fastest. `limit_calls` > 0: this call and later ones fail. */
typedef struct check_array {
    const float *values;
    int size[3];
    long calls, limit_calls;
} check_array;

static inline int check_read_array(void *user, const int lo[3], const int size[3], float *out) {
    check_array *array = (check_array *)user;
    array->calls += 1;
    if (array->limit_calls > 0 && array->calls >= array->limit_calls) return 1;
    for (int k = lo[2]; k < lo[2] + size[2]; ++k)
        for (int j = lo[1]; j < lo[1] + size[1]; ++j, out += size[0]) {
            const size_t row = ((size_t)k * (size_t)array->size[1] + (size_t)j) * (size_t)array->size[0];
            memcpy(out, array->values + row + (size_t)lo[0], (size_t)size[0] * sizeof(float));
        }
    return 0;
}

/* Fills side^3 values with overlapping lumps, as of a cloud. */
static inline void check_lumps(float *values, int side) {
    check_random random = {7};
    memset(values, 0, (size_t)side * (size_t)side * (size_t)side * sizeof *values);
    for (int i = 0; i < 14; ++i) {
        double centre[3], radius = side / 16.0 + side / 8.0 * check_next(&random);
        for (int k = 0; k < 3; ++k) centre[k] = side * (0.28 + 0.44 * check_next(&random));
        for (int n = 0; n < side * side * side; ++n) {
            const double x = n % side + 0.5 - centre[0], y = n / side % side + 0.5 - centre[1];
            const double z = n / (side * side) + 0.5 - centre[2];
            const double d = 1 - (x * x + y * y + z * z) / (radius * radius);
            if (d > 0) values[n] = (float)fmin(1, (double)values[n] + d * d);
        }
    }
}

/* sps_particles.read_fn of an array. */
static inline int check_read_particles(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

/* ---------------------------------------------------------------------------------------- where triangles come from */

typedef struct check_triangles {
    sps_triangle *list;
    size_t count, room;
    long calls, limit_calls; /* as in check_array */
} check_triangles;

/* sps_mesh.read_fn. */
static inline int check_read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    check_triangles *triangles = (check_triangles *)user;
    triangles->calls += 1;
    if (triangles->limit_calls > 0 && triangles->calls >= triangles->limit_calls) return 1;
    memcpy(out, triangles->list + first, count * sizeof *out);
    return 0;
}

/* Appends an all-zero triangle and returns it. */
static inline sps_triangle *check_add_triangle(check_triangles *triangles) {
    if (triangles->count == triangles->room) {
        triangles->room = triangles->room ? 2 * triangles->room : 16;
        triangles->list = (sps_triangle *)realloc(triangles->list, triangles->room * sizeof *triangles->list);
        if (!triangles->list) abort();
    }
    memset(&triangles->list[triangles->count], 0, sizeof *triangles->list);
    return &triangles->list[triangles->count++];
}

static inline void check_add_corners(check_triangles *triangles, const double a[3], const double b[3],
                                     const double c[3]) {
    sps_triangle *triangle = check_add_triangle(triangles);
    for (int i = 0; i < 3; ++i) {
        triangle->position[0][i] = (float)a[i];
        triangle->position[1][i] = (float)b[i];
        triangle->position[2][i] = (float)c[i];
    }
}

/* The parallelogram origin, origin + u, origin + u + v, origin + v. */
static inline void check_add_quad(check_triangles *triangles, const double origin[3], const double u[3],
                                  const double v[3]) {
    double a[3], b[3], c[3];
    for (int i = 0; i < 3; ++i) {
        a[i] = origin[i] + u[i];
        b[i] = a[i] + v[i];
        c[i] = origin[i] + v[i];
    }
    check_add_corners(triangles, origin, a, b);
    check_add_corners(triangles, origin, b, c);
}

static inline void check_free_triangles(check_triangles *triangles) {
    free(triangles->list);
    memset(triangles, 0, sizeof *triangles);
}

/* ----------------------------------------------------------------------------------------------------------- scenes */

/* A scene with room for a test's objects. Its pointers refer to the struct itself: fill it in its final place. */
typedef struct check_scene {
    sps_volume volume[4];
    sps_mesh mesh[4];
    sps_light light[8];
    sps_scene scene;
    sps_view view;
} check_scene;

/* No volume, no mesh, no light; an orthographic camera at (0,0,10) that looks down -z at 1 world unit of height. Light
   scatters once, as closed forms and the reference without paths have it. */
static inline void check_clear(check_scene *s, int width, int height) {
    memset(s, 0, sizeof *s);
    s->scene.volumes = s->volume;
    s->scene.meshes = s->mesh;
    s->scene.lights = s->light;
    s->view.width = width;
    s->view.height = height;
    s->view.camera.position[2] = 10;
    s->view.camera.up[1] = 1;
    s->view.camera.ortho_height = 1;
    s->view.scattering = SPS_SCATTERING_SINGLE;
}

static inline void check_set3(double out[3], double x, double y, double z) {
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

static inline void check_color(float out[3], double r, double g, double b) {
    out[0] = (float)r;
    out[1] = (float)g;
    out[2] = (float)b;
}

/* Makes the camera perspective; 0: leaves it unchanged. */
static inline void check_perspective(sps_camera *camera, double angle) {
    if (angle == 0) return;
    camera->field_of_view = angle;
    camera->ortho_height = 0;
}

/* Makes the camera orthographic; 0: leaves it unchanged. */
static inline void check_orthographic(sps_camera *camera, double height) {
    if (height == 0) return;
    camera->ortho_height = height;
    camera->field_of_view = 0;
}

/* Makes the camera a matrix; NULL: leaves it unchanged. */
static inline void check_matrix(sps_camera *camera, const double matrix[16]) {
    if (!matrix) return;
    camera->world_to_clip = matrix;
    camera->field_of_view = camera->ortho_height = 0;
}

/* A map's resolved settings; zeros if there is no map. */
static inline sps_tmap_settings check_settings_of(const sps_tmap *map) {
    sps_tmap_info info;
    memset(&info, 0, sizeof info);
    sps_tmap_get_info(map, &info);
    return info.settings;
}

/* The size of a map in bytes, or 0. */
static inline size_t check_bytes_of(const sps_tmap *map) {
    sps_tmap_info info;
    return sps_tmap_get_info(map, &info) == SPS_OK ? info.bytes : 0;
}

/* The light of a map with the camera of a view. */
static inline sps_tmap_light check_light_of(const sps_view *view) {
    sps_tmap_light light;
    memset(&light, 0, sizeof light);
    light.width = view->width;
    light.height = view->height;
    light.camera = view->camera;
    light.quality = view->quality;
    light.slab_thickness = view->slab_thickness;
    return light;
}

/* The axis-aligned box from low to high. */
static inline sps_placement check_box(double x0, double y0, double z0, double x1, double y1, double z1) {
    sps_placement placement;
    memset(&placement, 0, sizeof placement);
    check_set3(placement.origin, x0, y0, z0);
    check_set3(placement.axis[0], x1 - x0, 0, 0);
    check_set3(placement.axis[1], 0, y1 - y0, 0);
    check_set3(placement.axis[2], 0, 0, z1 - z0);
    return placement;
}

/* Appends a volume to the scene: set read_fn or eval_fn, user and its appearance. */
static inline sps_volume *check_add_volume(check_scene *s, int nx, int ny, int nz, sps_placement placement) {
    sps_volume *volume = &s->volume[s->scene.volume_count++];
    volume->size[0] = nx;
    volume->size[1] = ny;
    volume->size[2] = nz;
    volume->placement = placement;
    return volume;
}

static inline double check_puff(const void *user, const double p[3]) {
    const double r = vec_length(p), ripples = 0.2 * sin(7 * p[0] + 1) * cos(6 * p[1]) * sin(8 * p[2]);
    (void)user;
    return fmin(fmax(2.5 * (0.8 + ripples - r), 0), 1);
}

/* Appends a puff of gas about the origin, 1.6 wide and with ripples. */
static inline sps_volume *check_add_puff(check_scene *s, double extinction) {
    static const check_field field = {check_puff, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
    sps_volume *volume = check_add_volume(s, 25, 25, 25, check_box(-1, -1, -1, 1, 1, 1));
    volume->eval_fn = check_eval_field;
    volume->user = (void *)(size_t)&field;
    volume->extinction = (float)extinction;
    return volume;
}

/* Adds 50 particles about the origin as the scene's only set, until the next call. */
static inline sps_particles *check_add_swarm(check_scene *s, double optical_depth) {
    enum { SWARM_COUNT = 50 };
    static sps_particle swarm[SWARM_COUNT];
    static sps_particles set;
    check_random random = {5};
    for (int i = 0; i < SWARM_COUNT; ++i) {
        for (int k = 0; k < 3; ++k) swarm[i].position[k] = (float)(1.4 * check_next(&random) - 0.7);
        swarm[i].radius = 0.25f;
        swarm[i].optical_depth = (float)optical_depth;
    }
    memset(&set, 0, sizeof set);
    set.count = SWARM_COUNT, set.read_fn = check_read_particles, set.user = swarm;
    s->scene.particles = &set, s->scene.particle_set_count = 1;
    return &set;
}

/* Appends a white light to the scene: set its direction or position. */
static inline sps_light *check_add_light(check_scene *s, sps_light_kind kind, double strength) {
    sps_light *light = &s->light[s->scene.light_count++];
    light->kind = kind;
    check_color(light->color, strength, strength, strength);
    return light;
}

static inline sps_light *check_add_directional(check_scene *s, double x, double y, double z, double irradiance) {
    sps_light *light = check_add_light(s, SPS_LIGHT_DIRECTIONAL, irradiance);
    check_set3(light->direction, x, y, z);
    return light;
}

static inline sps_light *check_add_point(check_scene *s, double x, double y, double z, double intensity) {
    sps_light *light = check_add_light(s, SPS_LIGHT_POINT, intensity);
    check_set3(light->position, x, y, z);
    return light;
}

/* sps_config.progress_fn: cancels the at-th call. */
typedef struct check_cancel {
    long calls, at;
} check_cancel;

static inline int check_cancel_at(void *user, float fraction) {
    check_cancel *cancel = (check_cancel *)user;
    (void)fraction;
    return ++cancel->calls == cancel->at;
}

/* sps_config.clock_fn: a second passes from call to call, so that progress_fn is due whenever it can be. */
static inline double check_hasty_clock(void *user) {
    static double seconds;
    (void)user;
    return seconds += 1;
}

/* Makes a mesh let the same share of each color pass. */
static inline void check_translucent(sps_mesh *mesh, double transmittance) {
    for (int c = 0; c < 3; ++c) mesh->transmittance[c] = (float)transmittance;
}

/* Call when the triangles are complete: their number is copied. */
static inline sps_mesh *check_add_mesh(check_scene *s, check_triangles *triangles, double reflectance) {
    sps_mesh *mesh = &s->mesh[s->scene.mesh_count++];
    mesh->read_fn = check_read_triangles;
    mesh->user = triangles;
    mesh->triangle_count = triangles->count;
    check_color(mesh->albedo, reflectance, reflectance, reflectance);
    return mesh;
}

/* ----------------------------------------------------------------------------------------------------------- images */

/* Renders into rgba (4 floats per pixel of the view's region) and depth (or NULL). A failure is counted and printed. */
static inline int check_render_depth(sps_context *context, const check_scene *s, float *rgba, float *depth) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    image.depth = depth;
    return CHECK_OK(context, sps_render(context, &s->scene, &s->view, &image));
}

static inline int check_render(sps_context *context, const check_scene *s, float *rgba) {
    return check_render_depth(context, s, rgba, NULL);
}

/* Lights shade by sheets, whether or not slabs serve them and another one's sweep could carry them. */
static inline void check_force_sheets(check_scene *s) {
    for (int i = 0; i < s->scene.light_count; ++i) s->light[i].shadow_source = SPS_SHADOW_SHEETS;
}

/* Renders what must fail with this result and these words, and leave the image untouched. */
static inline void check_fails(sps_context *context, const check_scene *s, float *rgba, sps_result result,
                               const char *words) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    rgba[0] = 7;
    CHECK(sps_render(context, &s->scene, &s->view, &image) == result);
    if (!CHECK(strstr(sps_error(context), words) != NULL))
        printf("    wanted \"%s\", got \"%s\"\n", words, sps_error(context));
    CHECK(rgba[0] == 7);
}

/* Whether two images of the scene's view have the same bits. */
static inline int check_same(const check_scene *s, const float *a, const float *b) {
    return memcmp(a, b, 4 * sizeof *a * (size_t)s->view.width * (size_t)s->view.height) == 0;
}

/* Renders with a context that has all defaults. */
static inline void check_render_plain(const check_scene *s, float *rgba) {
    sps_context *by = check_context(NULL);
    check_render(by, s, rgba);
    sps_destroy(by);
}

/* Any number of workers, in any order, renders the same bits. Both arrays hold an image of the view. */
static inline void check_workers(const check_scene *s, float *rgba, float *exact) {
    static const int counts[] = {1, 2, 3, 7};
    check_render_plain(s, exact);
    for (int i = 0; i < 4; ++i) {
        check_hooks hooks;
        sps_context *by;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = counts[i], hooks.order = (uint64_t)i;
        by = check_context(&hooks);
        check_render(by, s, rgba);
        if (!CHECK_CASE("What users of other renderers complain of",
                        "output that changes with the thread count: 1, 2, 3, 7", "the same picture",
                        !check_same(s, rgba, exact), 0, "same bits"))
            printf("    with %d workers\n", counts[i]);
        sps_destroy(by);
        CHECK(hooks.live == 0);
    }
}

/* Renders what may fail, which must leave the image untouched. */
static inline sps_result check_try(sps_context *context, const check_scene *s, float *rgba) {
    sps_result result;
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    rgba[0] = 7;
    result = sps_render(context, &s->scene, &s->view, &image);
    CHECK(result == SPS_OK || rgba[0] == 7);
    return result;
}

/* Any allocation may fail, or, with `cancels`, any call of progress_fn may cancel: an error, no image, nothing left in
   memory, and the next two calls show what they should. Each one is tried, or, with `sparse` above 0, fewer and fewer:
   after the n-th, n / sparse are left out. Both arrays hold an image of the view. Returns how many there are. */
static inline long check_failing(const check_scene *s, int cancels, int sparse, float *rgba, float *exact) {
    check_hooks hooks;
    check_cancel cancel = {0, 0};
    sps_config config;
    sps_result result;
    long at = 0;
    memset(&hooks, 0, sizeof hooks);
    check_render_plain(s, exact);
    do {
        sps_context *by;
        config = check_config(&hooks);
        config.progress_fn = check_cancel_at, config.progress_user = &cancel;
        config.clock_fn = check_hasty_clock;
        by = sps_create(&config, NULL);
        at += sparse > 0 ? 1 + at / sparse : 1;
        hooks.fail_at = cancels ? 0 : hooks.allocations + at;
        cancel.calls = 0, cancel.at = cancels ? at : 0;
        result = check_try(by, s, rgba);
        hooks.fail_at = cancel.at = 0;
        if (result != SPS_OK) {
            CHECK(result == (cancels ? SPS_ERROR_CANCELLED : SPS_ERROR_MEMORY));
            CHECK(check_try(by, s, rgba) == SPS_OK);
        }
        CHECK(check_same(s, rgba, exact));
        if (check_long() || result == SPS_OK) CHECK(check_try(by, s, rgba) == SPS_OK && check_same(s, rgba, exact));
        sps_destroy(by);
        CHECK(hooks.live == 0);
    } while (result != SPS_OK && at < 100000);
    if (figures()) printf("%s: up to %ld\n", cancels ? "calls that cancel" : "allocations that fail", at - 1);
    return at - 1;
}

/* sps_reference in steps of that many voxels, light scattered once. */
static inline sps_result check_reference(sps_context *context, const sps_scene *scene, const sps_view *view,
                                         double step, const sps_image *image) {
    sps_reference_settings settings;
    memset(&settings, 0, sizeof settings);
    settings.step = step;
    return sps_reference(context, scene, view, &settings, image);
}

static inline int check_march(sps_context *context, const check_scene *s, double step, float *rgba, float *depth) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    image.depth = depth;
    return CHECK_OK(context, check_reference(context, &s->scene, &s->view, step, &image));
}

/* Root mean square of a - b. */
static inline double check_rms(const float *a, const float *b, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; ++i) {
        const double difference = (double)a[i] - (double)b[i];
        sum += difference * difference;
    }
    return count ? sqrt(sum / (double)count) : 0;
}

/* The largest |a - b|; NaN if there is one. */
static inline double check_largest(const float *a, const float *b, size_t count) {
    double largest = 0;
    for (size_t i = 0; i < count; ++i) {
        const double difference = fabs((double)a[i] - (double)b[i]);
        if (!(difference <= largest)) largest = difference;
        if (difference != difference) return difference;
    }
    return largest;
}

static inline double check_mean(const float *values, size_t count) {
    double sum = 0;
    for (size_t i = 0; i < count; ++i) sum += (double)values[i];
    return sum / (double)count;
}

/* The mean of red, green and blue of RGBA pixels. */
static inline double mean_of(const float *image, size_t pixels) {
    double sum = 0;
    for (size_t i = 0; i < 4 * pixels; ++i) sum += i % 4 < 3 ? (double)image[i] : 0;
    return sum / (3 * (double)pixels);
}

/* Root mean square of a - b in red, green and blue, relative to b's mean. */
static inline double error_of(const float *a, const float *b, size_t pixels) {
    double square = 0;
    for (size_t i = 0; i < 4 * pixels; ++i)
        if (i % 4 < 3) square += pow((double)a[i] - (double)b[i], 2);
    return sqrt(square / (3 * (double)pixels)) / mean_of(b, pixels);
}

/* The largest red, green or blue. */
static inline double brightest_of(const float *image, size_t pixels) {
    double most = 0;
    for (size_t i = 0; i < 4 * pixels; ++i)
        if (i % 4 < 3) most = fmax(most, (double)image[i]);
    return most;
}

/* Pixels of the picture, or of its region. */
static inline size_t check_pixel_count(const sps_view *view) {
    return view->region[2] ? (size_t)view->region[2] * (size_t)view->region[3]
                           : (size_t)view->width * (size_t)view->height;
}

/* Compares the mean of all pixels, rendered, with that of random paths: within five standard errors and `share` of it.
   CHECK_FIGURES in the environment prints both. Returns by how much they may differ, or 0 after a failure. */
static inline double check_paths_of(sps_context *context, const check_scene *s, const float *found, const char *name,
                                    int samples, double share) {
    const size_t pixels = check_pixel_count(&s->view);
    float *exact = (float *)calloc(7 * pixels, sizeof *exact), *errors = exact + 4 * pixels;
    double sums[2] = {0, 0}, square = 0, count = 3 * (double)pixels, allowed;
    sps_reference_settings settings;
    sps_image image;
    int good = CHECK(exact != NULL);
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, settings.samples = check_long() ? 8 * samples : samples, settings.seed = 1;
    settings.error = errors, image.rgba = exact;
    good = good && CHECK_OK(context, sps_reference(context, &s->scene, &s->view, &settings, &image));
    for (size_t i = 0; i < 4 * pixels && good; ++i)
        if (i % 4 < 3) sums[0] += (double)found[i], sums[1] += (double)exact[i];
    for (size_t i = 0; i < 3 * pixels && good; ++i) square += (double)errors[i] * (double)errors[i];
    square = sqrt(3 * square); /* colors share their paths */
    allowed = 5 * square + share * sums[1];
    if (figures())
        printf("%s: %.5f, paths %.5f +- %.5f: %+.2f %%\n", name, sums[0] / count, sums[1] / count, square / count,
               100 * (sums[0] / sums[1] - 1));
    if (good &&
        !CHECK_CASE(
            "Scattering",
            "gas, particles and what is classified, under all kinds of lights, beside polygons, full scattering",
            "the mean of random paths, relative", fabs(sums[0] - sums[1]) / fmax(sums[1], DBL_MIN),
            allowed / fmax(sums[1], DBL_MIN), "five standard errors of the paths, and 3 to 10 % for cells"))
        printf("    %s: %g, paths %g +- %g\n", name, sums[0] / count, sums[1] / count, square / count);
    free(exact);
    return good ? allowed / count : 0;
}

/* Renders, and compares as above. */
static inline int check_paths(sps_context *context, const check_scene *s, const char *name, int samples, double share) {
    float *found = (float *)calloc(4 * check_pixel_count(&s->view), sizeof *found);
    int good = CHECK(found != NULL) && check_render(context, s, found);
    good = good && check_paths_of(context, s, found, name, samples, share) > 0;
    free(found);
    return good;
}

#endif /* CHECK_H */
