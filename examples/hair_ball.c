/* A ball of 10000 hairs, drawn as lines by a renderer of its own that looks their shadows up in transmittance maps.
   From left to right: without shadows among hairs, by an opacity map, by a deep opacity map of as many floats, and by
   the exact lists of a deep map. */

#include "arguments.h"
#include "particles.h"
#include "picture.h"
#include "vectors.h"
#include <time.h>

enum {
    HAIRS = 10000,
    POINTS = 12,
    COUNT = HAIRS * POINTS,
    SIDE = 320,
    PANELS = 4,
    WIDTH = SIDE * PANELS,
    TEXELS = 512
};

#define HEAD    0.75 /* radius; hairs reach up to 1.6 */
#define REACH   1.7
#define OPACITY 0.6
#define WIDE    0.008

/* A point of a hair to draw, with the way to the next one. */
typedef struct mark {
    ex_vec from, to;
    float lit; /* transmittance from the light */
} mark;

static sps_strand_point points[COUNT];
static mark marks[COUNT];
static uint64_t state = 5;

/* -1 < x < 1, the same on every machine. */
static double random_number(void) {
    state = state * 2862933555777941757u + 3037000493u;
    return (double)(state >> 11) / 4503599627370496.0 - 1;
}

static ex_vec random_in_ball(void) {
    ex_vec v = ex_vec_of(1, 1, 1);
    while (ex_vec_dot(v, v) > 1) {
        v.x = random_number();
        v.y = random_number();
        v.z = random_number();
    }
    return v;
}

/* Each hair grows outwards, curls about its own axis, and sinks. */
static void grow(void) {
    for (int i = 0; i < HAIRS; ++i) {
        const ex_vec normal = ex_vec_unit(random_in_ball()), side = ex_vec_perpendicular(normal);
        const ex_vec other = ex_vec_cross(normal, side), lean = ex_vec_scale(random_in_ball(), 0.35);
        const double phase = EX_PI * random_number(), curl = 0.05 + 0.03 * random_number();
        const double length = 0.55 + 0.1 * random_number();
        for (int k = 0; k < POINTS; ++k) {
            const double s = (double)k / (POINTS - 1), angle = phase + 9 * s;
            ex_vec p = ex_vec_scale(normal, HEAD + length * s);
            p = ex_vec_add(p, ex_vec_scale(lean, length * s));
            p = ex_vec_add(p, ex_vec_scale(side, curl * s * cos(angle)));
            p = ex_vec_add(p, ex_vec_scale(other, curl * s * sin(angle)));
            p.y -= 0.2 * s * s - 0.06;
            sps_strand_point *to = &points[i * POINTS + k];
            ex_store(to->position, p);
            to->width = (float)(WIDE * (1 - 0.7 * s));
            to->optical_depth = (float)-log1p(-OPACITY);
            to->begins = k == 0;
        }
    }
}

static int read_points(void *user, size_t first, size_t count, sps_strand_point *out) {
    memcpy(out, (const sps_strand_point *)user + first, count * sizeof *out);
    return 0;
}

static ex_vec place(int i) {
    const float *p = points[i].position;
    return ex_vec_of((double)p[0], (double)p[1], (double)p[2]);
}

/* Makes the map of a panel and asks it at every point; panel 0 has no hair in its map, only the head. */
static sps_result shade(sps_context *context, int panel, ex_vec sun) {
    static const sps_tmap_technique techniques[PANELS] = {SPS_TMAP_DEEP, SPS_TMAP_OPACITY, SPS_TMAP_DEEP_OPACITY,
                                                          SPS_TMAP_DEEP};
    const sps_particle head = {.radius = (float)HEAD, .optical_depth = 100};
    const sps_particles heads = {.count = 1, .read_fn = ex_particles_read, .user = (void *)(uintptr_t)&head};
    const sps_strands hair = {.point_count = COUNT, .read_fn = read_points, .user = points};
    const sps_scene scene = {
        .particles = &heads, .particle_set_count = 1, .strands = &hair, .strand_set_count = panel > 0};
    sps_tmap_light light = {.width = TEXELS, .height = TEXELS, .camera = {.up = {0, 1, 0}, .ortho_height = 2 * REACH}};
    sps_tmap_settings settings = {.technique = techniques[panel], .far_depth = 2 * REACH};
    sps_tmap *map;
    light.camera.position[0] = -REACH * sun.x, light.camera.position[1] = -REACH * sun.y;
    light.camera.position[2] = -REACH * sun.z;
    if (techniques[panel] != SPS_TMAP_DEEP) settings.components = 8;
    const double begin = (double)clock() / CLOCKS_PER_SEC;
    sps_result result = sps_tmap_create(context, &light, &settings, &map);
    if (result == SPS_OK) result = sps_tmap_add(map, &scene);
    if (result == SPS_OK) result = sps_tmap_finish(map);
    if (result == SPS_OK) printf("map of panel %d: %.3f s\n", panel + 1, (double)clock() / CLOCKS_PER_SEC - begin);
    for (int i = 0; i < COUNT && result == SPS_OK; ++i) {
        const ex_vec p = ex_vec_add(place(i), ex_vec_scale(sun, -2 * WIDE)); /* not in its own shadow */
        const double at[3] = {p.x, p.y, p.z};
        marks[i].from = place(i);
        marks[i].to = i + 1 < COUNT && !points[i + 1].begins ? place(i + 1) : marks[i].from;
        result = sps_tmap_query(map, 1, at, NULL, &marks[i].lit);
    }
    sps_tmap_destroy(map);
    return result;
}

static int nearer_last(const void *a, const void *b) {
    const double x = ((const mark *)a)->from.z, y = ((const mark *)b)->from.z;
    return (x > y) - (x < y);
}

/* Light along a hair, by its tangent. [Kajiya & Kay 1989] */
static void hair_color(const mark *m, ex_vec sun, double rgb[3]) {
    static const double albedo[3] = {0.5, 0.27, 0.1}, sky[3] = {0.1, 0.12, 0.16};
    const ex_vec tangent = ex_vec_unit(ex_vec_sub(m->to, m->from));
    const double along = ex_vec_dot(tangent, sun), across = sqrt(fmax(1 - along * along, 0));
    const double bright = across * sqrt(fmax(1 - tangent.z * tangent.z, 0)) + along * tangent.z;
    const double shine = 0.35 * pow(fmax(bright, 0), 30);
    for (int c = 0; c < 3; ++c) rgb[c] = (double)m->lit * 1.3 * (albedo[c] * across + shine) + sky[c] * albedo[c];
}

/* Blends a dot of some opacity over four pixels. */
static void dot(float *rgba, double x, double y, const double rgb[3], double opacity) {
    const int i = (int)floor(x), j = (int)floor(y);
    for (int k = 0; k < 4; ++k) {
        const int column = i + k % 2, row = j + k / 2;
        if (column < 0 || row < 0 || column >= SIDE || row >= SIDE) continue;
        const double share = opacity * (1 - fabs(x - column)) * (1 - fabs(y - row));
        float *pixel = rgba + 4 * (row * WIDTH + column);
        for (int c = 0; c < 3; ++c) pixel[c] = (float)ex_mix((double)pixel[c], rgb[c], share);
    }
}

/* Seen from the front, without perspective: background, head, and hairs from the back to the front. */
static void draw(float *rgba, ex_vec sun) {
    const double scale = SIDE / (2 * REACH);
    for (int i = 0; i < SIDE * SIDE; ++i) {
        const double x = (i % SIDE + 0.5) / scale - REACH, y = REACH - (i / SIDE + 0.5) / scale;
        const double square = HEAD * HEAD - x * x - y * y;
        const double facing = -(x * sun.x + y * sun.y + sqrt(fmax(square, 0)) * sun.z) / HEAD;
        float *pixel = rgba + 4 * (i / SIDE * WIDTH + i % SIDE);
        ex_color(pixel, 0.3, 0.32, 0.35);
        if (square > 0) ex_color(pixel, 0.02 + 0.1 * fmax(facing, 0), 0.02 + 0.06 * fmax(facing, 0), 0.02);
    }
    qsort(marks, COUNT, sizeof *marks, nearer_last);
    for (int i = 0; i < COUNT; ++i) {
        const mark *m = &marks[i];
        const double length = scale * hypot(m->to.x - m->from.x, m->to.y - m->from.y);
        const int dots = (int)ceil(2 * length);
        double rgb[3];
        if (m->from.z < 0 && hypot(m->from.x, m->from.y) < HEAD) continue;
        hair_color(m, sun, rgb);
        for (int k = 0; k < dots; ++k) {
            const double s = (k + 0.5) / dots, x = ex_mix(m->from.x, m->to.x, s), y = ex_mix(m->from.y, m->to.y, s);
            dot(rgba, (x + REACH) * scale - 0.5, (REACH - y) * scale - 0.5, rgb,
                fmin(1.2 * WIDE * scale * length / dots, 1));
        }
    }
}

int main(int argc, char **argv) {
    static float rgba[WIDTH * SIDE * 4];
    const ex_vec sun = ex_vec_unit(ex_vec_of(0.9, -0.6, -0.3));
    ex_error error;
    const char *out = ex_out_file(argc, argv, "hair_ball.png");
    if (!out) return EX_MISTAKEN;
    sps_context *context = sps_create(NULL, NULL);
    if (!context) return puts("out of memory"), EX_FAILED;
    grow();
    for (int panel = 0; panel < PANELS; ++panel) {
        if (shade(context, panel, sun) != SPS_OK) return puts(sps_error(context)), EX_FAILED;
        draw(rgba + (size_t)4 * SIDE * (size_t)panel, sun);
    }
    sps_destroy(context);
    if (ex_write_picture(out, rgba, WIDTH, SIDE, &error)) return puts(error.text), EX_FAILED;
    return EX_OK;
}
