/* A campfire at night. A volume of temperatures glows as black bodies do; it is the only light. Multiple scattering,
   the default, carries its light to the ground, the stones and the smoke. */

#include "blackbody.h"
#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

enum { TONGUES = 9, STONES = 12, LOGS = 5 };

/* A tongue of fire: where it begins, how high and wide it is, and how it sways. */
typedef struct tongue {
    double x, z, height, radius, phase;
} tongue;

typedef struct fire {
    tongue tongues[TONGUES];
} fire;

static fire made_fire(void) {
    fire made;
    uint32_t random = 41;
    for (int i = 0; i < TONGUES; ++i) {
        tongue *t = &made.tongues[i];
        const double angle = 2.4 * i, out = 0.065 * sqrt(i + 0.1) * (0.8 + 0.4 * ex_random(&random));
        t->x = out * cos(angle), t->z = out * sin(angle);
        t->height = (1.15 - 2.9 * out) * (0.75 + 0.5 * ex_random(&random));
        t->radius = 0.065 + 0.04 * ex_random(&random);
        t->phase = 10 * ex_random(&random);
    }
    return made;
}

/* How deep a point is in a tongue: 1 on its axis, 0 at its rim, which is widest low down. Tongues lean towards the
   middle and sway more the higher they are. */
static double tongue_depth(const tongue *t, ex_vec p) {
    const double up = p.y / t->height;
    if (up < -0.1 || up > 1) return -1;
    const double lean = 1 - 0.7 * ex_clamp(up, 0, 1), sway = 0.18 * ex_ramp(0, 1, up);
    const double width = t->radius * 1.5 * pow(up + 0.12, 0.4) * pow(1 - up, 0.75) + 1e-6;
    double dx = p.x - lean * t->x, dz = p.z - lean * t->z;
    if (dx * dx + dz * dz > 0.1) return -1;
    dx -= sway * ex_noise(ex_vec_of(t->phase, 2.3 * p.y, 1.7));
    dz -= sway * ex_noise(ex_vec_of(4.1, 2.3 * p.y, t->phase));
    return 1 - sqrt(dx * dx + dz * dz) / width;
}

/* The temperature of embers on the ground, in heaps. */
static double ember_heat(ex_vec p) {
    const double around = sqrt(p.x * p.x + p.z * p.z), heap = ex_noise(ex_vec_of(11 * p.x, 0.5, 11 * p.z));
    const double top = 0.045 * ex_ramp(0.2, 0.05, around) + 0.02 * heap;
    return (0.52 + 0.14 * heap) * ex_ramp(top + 0.02, top, p.y) * ex_ramp(0.2, 0.12, around);
}

/* sps_volume.eval_fn: temperatures, 1 in the hottest parts. Eddies that are drawn upwards eat into the rim. */
static int fire_value(void *user, size_t count, const double *positions, float *out) {
    const fire *made = (const fire *)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        double merged = 0;
        out[i] = p.y < 0.12 ? (float)ember_heat(p) : 0;
        for (int k = 0; k < TONGUES; ++k) merged += exp(7 * tongue_depth(&made->tongues[k], p));
        double depth = log(merged) / 7;
        if (depth < -0.3) continue;
        depth += 0.1 - 0.68 * ex_turbulence(ex_vec_of(8 * p.x, 3.4 * p.y, 8 * p.z), 3) * (0.75 + 0.6 * p.y);
        const double hot = sqrt(ex_ramp(0, 1, depth)) * (0.78 + 0.22 * ex_ramp(0, 0.4, p.y)) * (1 - 0.25 * p.y);
        out[i] = (float)fmax((double)out[i], hot);
    }
    return 0;
}

static void set_fire(sps_volume *volume, fire *made, sps_transfer *transfer) {
    static sps_transfer_point points[EX_TEMPERATURE_POINTS];
    ex_temperature_points(2300, 45, 1, points);
    transfer->points = points, transfer->point_count = EX_TEMPERATURE_POINTS;
    ex_volume_box(volume, ex_vec_of(-0.36, 0, -0.36), ex_vec_of(0.36, 1.4, 0.36), 96);
    volume->eval_fn = fire_value, volume->user = made, volume->concurrent = 1;
    volume->transfer = transfer;
}

/* sps_volume.eval_fn: smoke begins where flames end, widens and thins out as it rises, and drifts. */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double up = fmax(p.y - 0.5, 0), wide = 0.16 + 0.26 * up;
        const double dx = p.x - 0.10 * up * up - 0.25 * ex_noise(ex_vec_of(0.5, 1.1 * p.y, 3.3)) * up;
        const double dz = p.z - 0.25 * ex_noise(ex_vec_of(8.2, 1.1 * p.y, 0.4)) * up;
        const double depth = 1 - sqrt(dx * dx + dz * dz) / wide;
        out[i] = 0;
        if (depth < -0.8) continue;
        const double eddies = ex_turbulence(ex_vec_of(3.4 * p.x, 2.2 * p.y - 3, 3.4 * p.z), 4);
        const double body = ex_ramp(0, 0.7, depth + 0.5 - 1.3 * eddies);
        out[i] = (float)(body * ex_ramp(0.55, 1.2, p.y) * ex_ramp(2.8, 1.9, p.y) * 0.16 / (wide + 0.05));
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    ex_volume_box(smoke, ex_vec_of(-0.8, 0.4, -0.8), ex_vec_of(1.2, 2.8, 0.8), 56);
    smoke->eval_fn = smoke_value, smoke->concurrent = 1;
    smoke->extinction = 5;
    ex_color(smoke->albedo, 0.82, 0.80, 0.78);
}

/* A stone: a ball, flattened and dented. */
typedef struct stone {
    ex_vec place;
    double size, seed;
} stone;

static ex_vec stone_point(const void *shape, double u, double v) {
    const stone *s = (const stone *)shape;
    const double along = EX_PI * u, around = 2 * EX_PI * (v - floor(v));
    const ex_vec way = ex_vec_of(sin(along) * cos(around), -cos(along), sin(along) * sin(around));
    const double dent = 1 + 0.35 * ex_noise(ex_vec_of(1.1 * way.x + s->seed, 1.1 * way.y, 1.1 * way.z));
    const ex_vec offset = ex_vec_scale(way, s->size * dent);
    return ex_vec_add(s->place, ex_vec_of(offset.x, 0.72 * offset.y, offset.z));
}

static void build_stones(ex_mesh *mesh) {
    uint32_t random = 5;
    for (int i = 0; i < STONES; ++i) {
        const double angle = 2 * EX_PI * (i + 0.35 * ex_random(&random)) / STONES,
                     size = 0.10 + 0.05 * ex_random(&random);
        const double gray = 0.30 + 0.15 * ex_random(&random);
        const stone one = {ex_vec_of(0.66 * sin(angle), 0.4 * size, 0.66 * cos(angle)), size, 3.7 * i};
        float color[3];
        ex_color(color, gray, 0.96 * gray, 0.90 * gray);
        ex_shape_surface(mesh, stone_point, &one, 9, 14, color, NULL);
    }
}

/* sps_mesh.shade_fn of the ground: earth in patches, sooty around the fire. */
static int ground_color(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const ex_vec p = ex_vec_of(points[i].position[0], 0.5, points[i].position[2]);
        const double patches = 1 + 0.35 * ex_fractal(ex_vec_scale(p, 4), 4);
        const double shade =
            ex_clamp(patches, 0.3, 1.6) * (0.25 + 0.75 * ex_ramp(0.3, 0.62, sqrt(p.x * p.x + p.z * p.z)));
        ex_color(out[i].albedo, 0.30 * shade, 0.24 * shade, 0.17 * shade);
    }
    return 0;
}

static void build_ground(ex_mesh *mesh) {
    static const float earth[3] = {0.30f, 0.24f, 0.17f};
    ex_shape_quad(mesh, ex_vec_of(-9, 0, -9), ex_vec_of(-9, 0, 9), ex_vec_of(9, 0, 9), ex_vec_of(9, 0, -9), earth);
}

/* Logs that lie like the spokes of a wheel, with their inner ends in the fire. */
static void build_logs(ex_mesh *mesh) {
    static const float bark[3] = {0.16f, 0.10f, 0.06f};
    uint32_t random = 9;
    for (int i = 0; i < LOGS; ++i) {
        const double angle = 2 * EX_PI * (i + 0.5 + 0.3 * ex_random(&random)) / LOGS, turned = angle + 0.5;
        const ex_vec foot = ex_vec_of(0.52 * sin(angle), 0.045, 0.52 * cos(angle));
        const ex_vec top = ex_vec_of(0.22 * sin(turned), 0.08 + 0.06 * ex_random(&random), 0.22 * cos(turned));
        const double length = ex_vec_length(ex_vec_sub(top, foot));
        const double profile[8] = {0, 0, 0.05, 0.01, 0.042, length - 0.01, 0, length};
        const ex_lathe log = {profile, 4, foot, ex_vec_unit(ex_vec_sub(top, foot))};
        ex_shape_lathe(mesh, &log, 10, bark, NULL);
    }
}

/* Film: what is bright comes closer and closer to white, so that flames keep their shades beside a dark ground. */
static void expose(void *user, const sps_view *view, const sps_image *image) {
    const float exposure = *(const float *)user;
    for (size_t i = 0; i < 4 * (size_t)view->width * (size_t)view->height; ++i)
        if (i % 4 < 3) image->rgba[i] = 1 - expf(-exposure * image->rgba[i]);
}

int main(int argc, char **argv) {
    static float night[2][3] = {{0.001f, 0.001f, 0.002f}, {0.002f, 0.003f, 0.006f}}, exposure = 5;
    const sps_light moon = ex_sun(ex_vec_of(0.5, -1, -0.4), 0);
    sps_view view = ex_view(ex_vec_of(0.4, 1.9, 3.9), ex_vec_of(0.03, 0.41, 0), 25);
    sps_scene scene = ex_scene(&moon);
    sps_volume volumes[2] = {{0}};
    sps_transfer transfer = {0};
    fire made = made_fire();
    ex_mesh ground = {0}, things = {0};
    view.quality = SPS_QUALITY_DEFAULT, view.scattering = SPS_SCATTERING_AUTO;
    set_fire(&volumes[0], &made, &transfer);
    set_smoke(&volumes[1]);
    build_ground(&ground);
    build_stones(&things);
    build_logs(&things);
    sps_mesh meshes[2] = {ex_shape_mesh(&ground), ex_shape_mesh(&things)};
    meshes[0].shade_fn = ground_color;
    scene.volumes = volumes, scene.volume_count = 2;
    scene.meshes = meshes, scene.mesh_count = 2;
    scene.light_count = 0;
    ex_color(scene.ambient, 0.001, 0.0015, 0.003);
    scene.background_user = night;
    const ex_finish film = {expose, &exposure};
    const ex_panels panel = {&scene, 1, EX_SAMPLE_EDGES, &film};
    const int status = ex_panels_program(argc, argv, "fire.png", &panel, &view);
    ex_mesh_free(&ground);
    ex_mesh_free(&things);
    return status;
}
