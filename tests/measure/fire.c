/* first-flights: how light that has not scattered yet reaches gas and polygons from small sources: for each scene of
   tests/flames.h and each quality, the error of the default render against closed forms and random paths of its own,
   beside it what these are off themselves, and the time of the frame on one core.
   fire [scene]   `rings`, `ground`, `floors`, `smoke`, `patch`, `room`: that one alone */

#define _POSIX_C_SOURCE 200809L
#include "flames.h"
#include <stdio.h>
#include <time.h>

static const char *const quality_names[] = {"default", "draft", "medium", "high", "ultra"};
enum { WIDTH = 256 };

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Renders in a context of its own. Returns the CPU time, or ends the program. */
static double render(const flames *f, sps_quality quality, float *rgba) {
    sps_context *context = sps_create(NULL, NULL);
    sps_view view = f->view;
    const sps_image image = {.rgba = rgba};
    const double start = seconds();
    view.quality = quality;
    if (!context || sps_render(context, &f->scene, &view, &image)) {
        printf("render: %s\n", sps_error(context));
        exit(1);
    }
    sps_destroy(context);
    return seconds() - start;
}

/* --- rings of haze around a flame --- */

enum { RING_ANGLES = 360, RING_COUNT = 3 };

/* Bilinear lookup on a ring about the picture's middle, of a radius in pixels. */
static double ring_value(const float *rgba, int width, double radius, int angle, int c) {
    const double turn = angle * 2 * FLAME_PI / RING_ANGLES;
    const double x = 0.5 * width - 0.5 + radius * cos(turn), y = 0.5 * width - 0.5 + radius * sin(turn);
    const int i = (int)x, j = (int)y;
    const double u = x - i, v = y - j;
    const float *p = rgba + 4 * (j * width + i) + c, *q = p + 4 * width;
    return (1 - v) * ((1 - u) * (double)p[0] + u * (double)p[4]) + v * ((1 - u) * (double)q[0] + u * (double)q[4]);
}

/* Mean of a ring, its lowest and its highest value. */
static void ring_measure(const float *rgba, int width, double radius, int c, double ring[3]) {
    ring[0] = 0, ring[1] = HUGE_VAL, ring[2] = 0;
    for (int a = 0; a < RING_ANGLES; ++a) {
        const double value = ring_value(rgba, width, radius * width / 10, a, c);
        ring[0] += value / RING_ANGLES;
        ring[1] = fmin(ring[1], value), ring[2] = fmax(ring[2], value);
    }
}

/* The mean of a ring by closed form and paths, over directions about it. */
static void ring_truth(const flames *f, double radius, int paths, uint64_t seed, double sum[3]) {
    enum { TURNS = 16 };
    sum[0] = sum[1] = sum[2] = 0;
    for (int i = 0; i < TURNS; ++i) {
        const double turn = (i + 0.5) * 2 * FLAME_PI / TURNS;
        const flames_ray eye = {{radius * cos(turn), radius * sin(turn), 20}, {0, 0, -1}};
        double once[3];
        flames_radiance(f, &eye, 2000, paths / TURNS, &seed, once);
        for (int c = 0; c < 3; ++c) sum[c] += once[c] / TURNS;
    }
}

/* The same rings by sps_reference, whose pixels have noise. */
static void rings_by_reference(const double (*truth)[3]) {
    enum { SIDE = 128 };
    static float rgba[SIDE * SIDE * 4];
    const sps_reference_settings settings = {.step = 2, .samples = 256, .seed = 1};
    const sps_image image = {.rgba = rgba};
    sps_context *context = sps_create(NULL, NULL);
    flames *f = flames_rings(SIDE, 0);
    const double start = seconds();
    if (!context || sps_reference(context, &f->scene, &f->view, &settings, &image)) {
        printf("reference: %s\n", sps_error(context));
        exit(1);
    }
    printf("  sps_reference, 256 paths, %.1f s:", seconds() - start);
    for (int r = 0; r < RING_COUNT; ++r) {
        double ring[3];
        ring_measure(rgba, SIDE, 1 << r, 0, ring);
        printf(" radius %d %.2f..%.2f, mean %+.2f %%%s", 1 << r, ring[1] / ring[0], ring[2] / ring[0],
               100 * (ring[0] / truth[r][0] - 1), r + 1 < RING_COUNT ? ";" : "\n");
    }
    sps_destroy(context);
    free(f);
}

static void rings(void) {
    static float rgba[WIDTH * WIDTH * 4], lit[WIDTH * WIDTH * 4];
    flames *f = flames_rings(WIDTH, 0), *lamp = flames_rings(WIDTH, 1);
    double truth[RING_COUNT][3], again[3];
    printf("rings of haze around a flame: extremes over mean, mean over the truth, mean over that by a point light\n");
    for (int r = 0; r < RING_COUNT; ++r) {
        ring_truth(f, 1 << r, 200000, 1, truth[r]);
        ring_truth(f, 1 << r, 100000, 2, again);
        printf("  radius %d: truth %.5g; by half as many other paths %+.2f %%\n", 1 << r, truth[r][0],
               100 * (again[0] / truth[r][0] - 1));
    }
    rings_by_reference((const double(*)[3])truth);
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_ULTRA; ++quality) {
        const double time = render(f, (sps_quality)quality, rgba);
        render(lamp, (sps_quality)quality, lit);
        for (int r = 0; r < RING_COUNT; ++r) {
            for (int c = 0; c < 3; c += 2) {
                double ring[3], point[3];
                ring_measure(rgba, WIDTH, 1 << r, c, ring);
                ring_measure(lit, WIDTH, 1 << r, c, point);
                printf("  %-6s radius %d %-4s: %.3f..%.3f, mean %+6.2f %%, point light %+6.2f %% (it: %.3f..%.3f)",
                       quality_names[quality], 1 << r, c ? "blue" : "red", ring[1] / ring[0], ring[2] / ring[0],
                       100 * (ring[0] / truth[r][c] - 1), 100 * (ring[0] / point[0] - 1), point[1] / point[0],
                       point[2] / point[0]);
                printf(r == 0 && c == 0 ? ", %.2f s\n" : "\n", time);
            }
        }
    }
    free(f), free(lamp);
}

/* --- floors --- */

enum { FLOOR_STEPS = 24 };

/* Relative errors over the points of a floor, nearer to the flame than twice its size, and farther. */
typedef struct floor_errors {
    double square[2], sum[2], worst[2], below; /* at the point below the flame, if that is seen */
    int count[2];
} floor_errors;

static void floor_add(floor_errors *errors, int far, double error) {
    errors->square[far] += error * error, errors->sum[far] += error, ++errors->count[far];
    if (fabs(error) > fabs(errors->worst[far])) errors->worst[far] = error;
}

/* Compares the pixels that show the floor within half of what the picture shows, on the channel that is worst. */
static void floor_measure(const flames *f, const float *rgba, const double *ratio, floor_errors *errors) {
    memset(errors, 0, sizeof *errors);
    errors->below = NAN;
    for (int y = 0; y < f->view.height; ++y)
        for (int x = 0; x < f->view.width; ++x) {
            double point[3], distance, radius, error = 0;
            flames_floor_point(f, x, y, point);
            distance = sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2]);
            radius = hypot(point[0], point[2]) / (0.5 * f->view.camera.ortho_height);
            if (flames_ball_before(f, point) || radius >= 1) continue;
            for (int c = 0; c < 3; ++c) {
                const double *r = ratio + (int)(radius * FLOOR_STEPS), u = radius * FLOOR_STEPS - (int)(r - ratio);
                const double right =
                    f->color[c] / FLAME_PI * f->intensity[c] * flames_irradiance(point) * (r[0] + u * (r[1] - r[0]));
                const double e = (double)rgba[4 * (y * f->view.width + x) + c] / right - 1;
                if (fabs(e) > fabs(error)) error = e;
            }
            floor_add(errors, distance > 2 * FLAME_SIZE, error);
            if (x == f->view.width / 2 && y == f->view.height / 2) errors->below = error;
        }
}

/* Ratio of the sum over voxels to the closed form, at even steps away from the point below the flame. Returns how much
   finer sums differ at most where the floor is seen. */
static double floor_correct(const flames *f, double ratio[FLOOR_STEPS + 1]) {
    double worst = 0;
    for (int i = 0; i <= FLOOR_STEPS; ++i) {
        const double x = 0.5 * f->view.camera.ortho_height * i / FLOOR_STEPS, point[3] = {0.8 * x, f->floor, 0.6 * x};
        const double coarse = flames_irradiance_summed(f, point, 2);
        ratio[i] = 1;
        if (!(f->scene.particle_set_count == 0)) continue;
        ratio[i] = flames_irradiance_summed(f, point, 3) / flames_irradiance(point);
        if (!flames_ball_before(f, point)) worst = fmax(worst, fabs(coarse / flames_irradiance(point) / ratio[i] - 1));
    }
    return worst;
}

static void floor_rows(double below, double shown, flames_around around, const char *name) {
    static float rgba[WIDTH * WIDTH * 4];
    flames *f = flames_floor(WIDTH, below, shown, around);
    double ratio[FLOOR_STEPS + 1], truth_error = floor_correct(f, ratio);
    printf("floor %.2f below a flame of %.2f (%.2f times its size), %s; truth +-%.2f %%, up to %.2f %% from the closed "
           "form\n",
           below, FLAME_SIZE, below / FLAME_SIZE, name, 100 * truth_error, 100 * fabs(ratio[0] - 1));
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_ULTRA; ++quality) {
        floor_errors e;
        const double time = render(f, (sps_quality)quality, rgba);
        floor_measure(f, rgba, ratio, &e);
        printf("  %-6s straight below %+7.2f %%", quality_names[quality], 100 * e.below);
        for (int i = 0; i < 2; ++i)
            if (e.count[i])
                printf("; %s mean %+6.2f %%, rms %6.2f %%, worst %+7.2f %%", i ? "far" : "near",
                       100 * e.sum[i] / e.count[i], 100 * sqrt(e.square[i] / e.count[i]), 100 * e.worst[i]);
        printf("; %.2f s\n", time);
    }
    free(f);
}

static void ground(void) {
    floor_rows(0.3, 5, FLAMES_ALONE, "voxels");
    floor_rows(0.3, 5, FLAMES_PARTICLE, "a particle");
}

static void floors(void) {
    static const double sizes[] = {0.5, 1, 2, 5, 20};
    for (int i = 0; i < 5; ++i) {
        floor_rows(sizes[i] * FLAME_SIZE, 4 * sizes[i] * FLAME_SIZE, FLAMES_ALONE, "alone");
        floor_rows(sizes[i] * FLAME_SIZE, 4 * sizes[i] * FLAME_SIZE, FLAMES_WIDE, "within gas that is all but empty");
    }
}

/* --- pictures against paths --- */

enum { PATHS_WIDTH = 128, PATHS_EVERY = 16, PATHS_COUNT = (PATHS_WIDTH / PATHS_EVERY) * (PATHS_WIDTH / PATHS_EVERY) };

typedef struct trial {
    const char *name;
    flames *(*build)(int width);
    /* The eye's ray of a pixel, from 30 units before what it shows on; returns 0 for a pixel that does not count. */
    int (*eye)(const flames *f, int x, int y, flames_ray *ray);
    int steps, paths;
} trial;

static flames *smoke_build(int width) { return flames_floor(width, 0.3, 2.4, FLAMES_IN_SMOKE); }

static int smoke_eye(const flames *f, int x, int y, flames_ray *ray) {
    const double down[3] = {0, -0.5, -sqrt(0.75)};
    flames_floor_point(f, x, y, ray->origin);
    if (flames_ball_before(f, ray->origin)) return 0;
    for (int i = 0; i < 3; ++i) ray->direction[i] = down[i], ray->origin[i] -= 30 * down[i];
    return 1;
}

/* A ray along -z. Returns its distance from the axis through the focus along y (0) or z (1). */
static double straight_eye(const flames *f, int x, int y, int along_z, flames_ray *ray) {
    const double pixel = f->view.camera.ortho_height / f->view.height;
    memset(ray, 0, sizeof *ray);
    ray->origin[0] = (x + 0.5 - 0.5 * f->view.width) * pixel;
    ray->origin[1] = (0.5 * f->view.height - y - 0.5) * pixel;
    ray->origin[2] = 30, ray->direction[2] = -1;
    return along_z ? hypot(ray->origin[0], ray->origin[1] - f->focus[1]) : fabs(ray->origin[0]);
}

static int patch_eye(const flames *f, int x, int y, flames_ray *ray) {
    return straight_eye(f, x, y, 0, ray) > 0.1 && ray->origin[1] > f->floor + 0.03 && ray->origin[1] < 0.9;
}

static int room_eye(const flames *f, int x, int y, flames_ray *ray) { return straight_eye(f, x, y, 1, ray) > 0.15; }

/* Radiance at every sixteenth pixel; 0 at those that do not count. */
static void trial_truth(const trial *t, const flames *f, int paths, uint64_t seed, double (*truth)[3]) {
    for (int y = PATHS_EVERY / 2; y < PATHS_WIDTH; y += PATHS_EVERY)
        for (int x = PATHS_EVERY / 2; x < PATHS_WIDTH; x += PATHS_EVERY, ++truth) {
            flames_ray eye;
            memset(*truth, 0, sizeof *truth);
            if (t->eye(f, x, y, &eye)) flames_radiance(f, &eye, t->steps, paths, &seed, *truth);
        }
}

/* The error of a picture, or of another truth: of the mean, rms of relative errors, and the largest of these. */
static void trial_compare(const float *rgba, const double (*other)[3], const double (*truth)[3], double out[3]) {
    double square = 0, sum = 0, mean = 0, worst = 0;
    int count = 0;
    for (int n = 0; n < PATHS_COUNT; ++n)
        for (int c = 0; c < 3; ++c) {
            const int x = n % (PATHS_WIDTH / PATHS_EVERY), y = n / (PATHS_WIDTH / PATHS_EVERY);
            const int pixel = (PATHS_EVERY * y + PATHS_EVERY / 2) * PATHS_WIDTH + PATHS_EVERY * x + PATHS_EVERY / 2;
            const double right = truth[n][c], got = rgba ? (double)rgba[4 * pixel + c] : other[n][c];
            if (!(right > 0)) continue;
            ++count, mean += right, sum += got - right, square += pow(got / right - 1, 2);
            if (fabs(got / right - 1) > fabs(worst)) worst = got / right - 1;
        }
    out[0] = 100 * sum / mean, out[1] = 100 * sqrt(square / count), out[2] = 100 * worst;
}

static void trial_rows(const trial *t) {
    static float rgba[PATHS_WIDTH * PATHS_WIDTH * 4];
    static double truth[PATHS_COUNT][3], again[PATHS_COUNT][3];
    flames *f = t->build(PATHS_WIDTH);
    double e[3], more = 0, all = 0;
    trial_truth(t, f, 0, 1, again);
    trial_truth(t, f, t->paths, 1, truth);
    for (int n = 0; n < PATHS_COUNT; ++n) all += truth[n][0], more += truth[n][0] - again[n][0];
    trial_truth(t, f, t->paths / 4, 2, again);
    trial_compare(NULL, (const double(*)[3])again, (const double(*)[3])truth, e);
    printf("%s; %.0f %% of red light by paths; a quarter of other paths: mean %+.2f %%, rms %.2f %%\n", t->name,
           100 * more / all, e[0], e[1]);
    for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_ULTRA; ++quality) {
        const double time = render(f, (sps_quality)quality, rgba);
        trial_compare(rgba, NULL, (const double(*)[3])truth, e);
        printf("  %-6s mean %+6.2f %%, relative rms %6.2f %%, worst %+7.2f %%; %.2f s\n", quality_names[quality], e[0],
               e[1], e[2], time);
    }
    free(f);
}

static void smoke(void) {
    const trial t = {"a fire over a ground in thin smoke", smoke_build, smoke_eye, 400, 20000};
    trial_rows(&t);
}

static void patch(void) {
    const trial t = {"haze lit by a lit patch of a wall", flames_patch, patch_eye, 200, 4000};
    trial_rows(&t);
}

static void room(void) {
    const trial t = {"a lamp in a room full of fog", flames_room, room_eye, 400, 60000};
    trial_rows(&t);
}

int main(int count, char **words) {
    static const struct {
        const char *name;
        void (*run)(void);
    } scenes[] = {{"rings", rings}, {"ground", ground}, {"floors", floors},
                  {"smoke", smoke}, {"patch", patch},   {"room", room}};
    int run = 0;
    setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; ++i)
        if (count < 2 || strcmp(words[1], scenes[i].name) == 0) scenes[i].run(), ++run;
    if (!run) fprintf(stderr, "fire: no scene %s: rings, ground, floors, smoke, patch or room\n", words[1]);
    return !run;
}
