/* Scenes in which light reaches gas and polygons straight from a small source, with all their numbers, and what is
   right there: closed forms, and random paths in doubles that share nothing with the library. */

#ifndef FLAMES_H
#define FLAMES_H

#include "splatshadow.h"
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define FLAME_PI     3.14159265358979323846
#define FLAME_RADIUS 0.12                 /* of the ball that glows */
#define FLAME_SIZE   (2 * FLAME_RADIUS)   /* its diameter */
enum { FLAME_SIDE = 32, HAZE_SIDE = 64 }; /* voxels along each side */

typedef enum flames_source {
    FLAMES_BALL, /* of even glow */
    FLAMES_LAMP, /* a point light */
    FLAMES_SPOT  /* a spotlight from straight above, which lights a disc of the floor */
} flames_source;

/* A scene and what it is made of. All pointers lead into the struct, so that it must stay where it is. */
typedef struct flames {
    sps_scene scene;
    sps_view view;
    sps_volume volumes[2]; /* the flame, the gas around it */
    sps_grid grids[2];
    float flame[FLAME_SIDE * FLAME_SIDE * FLAME_SIDE], haze[HAZE_SIDE * HAZE_SIDE * HAZE_SIDE];
    sps_particle particle;
    sps_particles particles;
    sps_mesh mesh;
    sps_indexed_mesh net;
    float corners[12];
    sps_light lamp;
    /* For the truth: a source of light, a box of even gas about the origin, a square floor or the walls of that box */
    flames_source source;
    double focus[3];                       /* where it is; of a spotlight, where it lights the floor */
    double radius, intensity[3];           /* of the ball, and of all of it, per steradian */
    double half[3], extinction, albedo[3]; /* of the gas */
    double floor, floor_half, color[3];    /* the floor's y, half of its side, its reflectance */
    int has_floor, has_walls;              /* all sides of the box but +z */
} flames;

/* --- parts of scenes --- */

static inline void flames_box(sps_volume *volume, sps_grid *grid, const float *voxels, int side, const double half[3]) {
    memset(volume, 0, sizeof *volume);
    memset(grid, 0, sizeof *grid);
    grid->voxels = voxels, grid->format = SPS_VOXEL_F32;
    for (int i = 0; i < 3; ++i) {
        grid->size[i] = volume->size[i] = side;
        volume->placement.origin[i] = -half[i], volume->placement.axis[i][i] = 2 * half[i];
    }
    volume->read_fn = sps_grid_read, volume->range_fn = sps_grid_range, volume->user = grid;
}

/* A ball of radius 0.12 about the origin in voxels of 0.01, which emits 100, 60, 20 per unit of length. */
static inline void flames_add_ball(flames *f) {
    const double half[3] = {0.16, 0.16, 0.16}, voxel = 0.32 / FLAME_SIDE;
    double sum = 0;
    for (int i = 0; i < FLAME_SIDE * FLAME_SIDE * FLAME_SIDE; ++i) {
        const double x = (i % FLAME_SIDE + 0.5) * voxel - 0.16, y = (i / FLAME_SIDE % FLAME_SIDE + 0.5) * voxel - 0.16;
        const double z = (i / FLAME_SIDE / FLAME_SIDE + 0.5) * voxel - 0.16;
        f->flame[i] = x * x + y * y + z * z < FLAME_RADIUS * FLAME_RADIUS;
        sum += (double)f->flame[i] * voxel * voxel * voxel;
    }
    sps_volume *volume = &f->volumes[f->scene.volume_count];
    flames_box(volume, &f->grids[f->scene.volume_count++], f->flame, FLAME_SIDE, half);
    volume->emission[0] = 100, volume->emission[1] = 60, volume->emission[2] = 20;
    for (int c = 0; c < 3; ++c) f->intensity[c] = sum * (double)volume->emission[c];
    f->radius = FLAME_RADIUS;
}

static inline int flames_read_particle(void *user, size_t first, size_t count, sps_particle *out) {
    (void)first;
    for (size_t i = 0; i < count; ++i) out[i] = *(const sps_particle *)user;
    return 0;
}

/* The same ball as a particle, whose optical depth along a diameter is 0.001. */
static inline void flames_add_particle(flames *f) {
    const float color[3] = {100, 60, 20};
    f->particle.radius = (float)FLAME_RADIUS, f->particle.optical_depth = 0.001f;
    f->particles.count = 1, f->particles.read_fn = flames_read_particle, f->particles.user = &f->particle;
    for (int c = 0; c < 3; ++c) {
        f->particles.emission[c] = color[c] * (float)(FLAME_SIZE / 0.001);
        f->intensity[c] = (double)color[c] * 4 / 3 * FLAME_PI * pow(FLAME_RADIUS, 3);
    }
    f->scene.particles = &f->particles, f->scene.particle_set_count = 1;
    f->radius = FLAME_RADIUS;
}

/* A flame that falls off as a Gaussian, of 16 voxels along 0.5, which emits 100, 60, 20 times its value. For what is
   farther away than 1, a ball with the same second moment is the same to 1e-5. */
static inline void flames_add_gaussian(flames *f) {
    enum { SIDE = 16 };
    const double half[3] = {0.25, 0.25, 0.25}, voxel = 0.5 / SIDE;
    double sum = 0, square = 0;
    for (int i = 0; i < SIDE * SIDE * SIDE; ++i) {
        const double x = (i % SIDE + 0.5) / SIDE - 0.5, y = (i / SIDE % SIDE + 0.5) / SIDE - 0.5;
        const double z = (i / SIDE / SIDE + 0.5) / SIDE - 0.5, value = exp(-40 * (x * x + y * y + z * z));
        f->flame[i] = (float)value;
        sum += value, square += value * x * x * 0.25;
    }
    sps_volume *volume = &f->volumes[f->scene.volume_count];
    flames_box(volume, &f->grids[f->scene.volume_count++], f->flame, SIDE, half);
    volume->emission[0] = 100, volume->emission[1] = 60, volume->emission[2] = 20;
    for (int c = 0; c < 3; ++c) f->intensity[c] = sum * voxel * voxel * voxel * (double)volume->emission[c];
    f->radius = sqrt(5 * (square / sum + 0.65 * 0.65 * voxel * voxel));
}

/* A box of even gas about the origin. */
static inline void flames_add_haze(flames *f, const double half[3], double extinction, const float albedo[3]) {
    for (int i = 0; i < HAZE_SIDE * HAZE_SIDE * HAZE_SIDE; ++i) f->haze[i] = 1;
    sps_volume *volume = &f->volumes[f->scene.volume_count];
    flames_box(volume, &f->grids[f->scene.volume_count++], f->haze, HAZE_SIDE, half);
    volume->extinction = (float)extinction;
    f->extinction = extinction;
    for (int i = 0; i < 3; ++i) {
        volume->albedo[i] = albedo[i];
        f->half[i] = half[i], f->albedo[i] = (double)albedo[i];
    }
}

/* A square floor below the origin, at a distance from it, and an orthographic camera that looks at the point below the
   origin from 60 degrees off the vertical and sees `shown` across. */
static inline void flames_add_floor(flames *f, double below, double half, double shown) {
    static const uint16_t indices[] = {0, 1, 2, 0, 2, 3};
    static const float color[3] = {0.5f, 0.4f, 0.3f};
    const float y = (float)-below, r = (float)half;
    const float corners[12] = {-r, y, r, r, y, r, r, y, -r, -r, y, -r};
    memcpy(f->corners, corners, sizeof corners);
    memset(&f->net, 0, sizeof f->net);
    f->net.vertex_count = 4, f->net.positions = f->corners, f->net.triangle_count = 2, f->net.indices_u16 = indices;
    f->mesh.triangle_count = 2, f->mesh.read_fn = sps_indexed_mesh_read, f->mesh.user = &f->net;
    f->scene.meshes = &f->mesh, f->scene.mesh_count = 1;
    f->has_floor = 1, f->floor = (double)y, f->floor_half = half;
    for (int c = 0; c < 3; ++c) f->mesh.albedo[c] = color[c], f->color[c] = (double)color[c];
    sps_camera *camera = &f->view.camera;
    camera->target[1] = (double)y;
    camera->position[1] = (double)y + 0.5 * (20 + 10 * shown), camera->position[2] = sqrt(0.75) * (20 + 10 * shown);
    camera->up[1] = 1;
    camera->ortho_height = shown;
}

static inline flames *flames_begin(int width) {
    flames *f = (flames *)calloc(1, sizeof *f);
    if (!f) exit(1);
    f->view.width = f->view.height = width;
    f->scene.volumes = f->volumes;
    return f;
}

/* --- the scenes --- */

/* A flame in haze of optical depth 0.24 from side to side, seen along z, 10 units across. with_lamp: a point light of
   the flame's power stands for it. */
static inline flames *flames_rings(int width, int with_lamp) {
    const double half[3] = {6, 6, 6};
    const float albedo[3] = {1, 0.8f, 0.5f};
    flames *f = flames_begin(width);
    flames_add_gaussian(f);
    flames_add_haze(f, half, 0.02, albedo);
    f->view.camera.position[2] = 20, f->view.camera.ortho_height = 10;
    if (!with_lamp) return f;
    f->lamp.kind = SPS_LIGHT_POINT;
    for (int c = 0; c < 3; ++c) f->lamp.color[c] = (float)f->intensity[c];
    f->scene.lights = &f->lamp, f->scene.light_count = 1;
    f->scene.volumes = f->volumes + 1, f->scene.volume_count = 1;
    return f;
}

typedef enum flames_around {
    FLAMES_ALONE,    /* a ball of voxels; beyond them there is nothing */
    FLAMES_WIDE,     /* in a box of 12 units, or more, of gas that takes 1e-5 of light per unit and scatters none */
    FLAMES_PARTICLE, /* a particle instead of voxels */
    FLAMES_IN_SMOKE, /* in a box of smoke, 3 by 2 by 3 units, with an optical depth of 0.3 per unit */
} flames_around;

/* A ball that glows above a floor of 30 times that height, of which the picture shows so much across. */
static inline flames *flames_floor(int width, double below, double shown, flames_around around) {
    const double wide = fmax(6, 1.25 * below), boxes[2][3] = {{wide, wide, wide}, {1.5, 1, 1.5}};
    const float black[3] = {0, 0, 0}, smoke[3] = {0.9f, 0.8f, 0.6f};
    flames *f = flames_begin(width);
    if (around == FLAMES_PARTICLE)
        flames_add_particle(f);
    else
        flames_add_ball(f);
    if (around == FLAMES_WIDE) flames_add_haze(f, boxes[0], 1e-5, black);
    if (around == FLAMES_IN_SMOKE) flames_add_haze(f, boxes[1], 0.3, smoke);
    flames_add_floor(f, below, 30 * below, shown);
    return f;
}

/* A spotlight from 2 units straight above lights a disc of 0.1 on a wall of 4 (here the floor), in haze with an optical
   depth of 0.1 per unit, seen along the wall, 2 units across. */
static inline flames *flames_patch(int width) {
    const double half[3] = {2, 1, 2};
    const float albedo[3] = {1, 0.9f, 0.7f}, color[3] = {100000, 60000, 20000};
    flames *f = flames_begin(width);
    flames_add_haze(f, half, 0.1, albedo);
    flames_add_floor(f, 0.9, 2, 2);
    memset(&f->view.camera, 0, sizeof f->view.camera);
    f->view.camera.position[2] = 20, f->view.camera.ortho_height = 2;
    f->lamp.kind = SPS_LIGHT_POINT, f->lamp.position[1] = 1.1, f->lamp.direction[1] = -1;
    f->lamp.outer_cone = atan(0.025);
    for (int c = 0; c < 3; ++c) f->lamp.color[c] = color[c], f->intensity[c] = (double)color[c];
    f->scene.lights = &f->lamp, f->scene.light_count = 1;
    f->source = FLAMES_SPOT, f->focus[1] = f->floor;
    return f;
}

/* A lamp in fog with an optical depth of 0.5 per unit, which fills a room of 4 by 3 by 4 units. The side towards the
   camera is open; beyond the other walls the fog goes on for four voxels, so that it is even up to them. */
static inline flames *flames_room(int width) {
    static const float sides[] = {-2, -1.5f, 2,  -2, -1.5f, -2, -2, 1.5f,  -2, -2, 1.5f,  2,  2,  -1.5f, -2,
                                  2,  -1.5f, 2,  2,  1.5f,  2,  2,  1.5f,  -2, -2, -1.5f, 2,  2,  -1.5f, 2,
                                  2,  -1.5f, -2, -2, -1.5f, -2, -2, 1.5f,  -2, 2,  1.5f,  -2, 2,  1.5f,  2,
                                  -2, 1.5f,  2,  -2, -1.5f, -2, 2,  -1.5f, -2, 2,  1.5f,  -2, -2, 1.5f,  -2};
    static const uint16_t indices[] = {0, 1,  2,  0,  2,  3,  4,  5,  6,  4,  6,  7,  8,  9,  10,
                                       8, 10, 11, 12, 13, 14, 12, 14, 15, 16, 17, 18, 16, 18, 19};
    const double half[3] = {2, 1.5, 2};
    double grown[3];
    const float albedo[3] = {0.95f, 0.9f, 0.8f}, color[3] = {10, 6, 2};
    flames *f = flames_begin(width);
    for (int i = 0; i < 3; ++i) grown[i] = half[i] * HAZE_SIDE / (HAZE_SIDE - 8);
    flames_add_haze(f, grown, 0.5, albedo);
    f->volumes[0].placement.origin[2] -= grown[2] - half[2]; /* its front, too, is where the room's is */
    flames_add_floor(f, 1.5, 2, 2.8);
    memcpy(f->half, half, sizeof half);
    f->has_floor = 0, f->has_walls = 1;
    f->net.vertex_count = 20, f->net.positions = sides, f->net.triangle_count = 10, f->net.indices_u16 = indices;
    f->mesh.triangle_count = 10;
    memset(&f->view.camera, 0, sizeof f->view.camera);
    f->view.camera.position[2] = 20, f->view.camera.ortho_height = 2.8;
    f->lamp.kind = SPS_LIGHT_POINT, f->lamp.position[1] = 0.5;
    for (int c = 0; c < 3; ++c) f->lamp.color[c] = color[c], f->intensity[c] = (double)color[c];
    f->scene.lights = &f->lamp, f->scene.light_count = 1;
    f->source = FLAMES_LAMP, f->radius = 0.002, f->focus[1] = 0.5;
    return f;
}

/* The point of the floor that a pixel shows. */
static inline void flames_floor_point(const flames *f, int x, int y, double point[3]) {
    const double pixel = f->view.camera.ortho_height / f->view.height;
    point[0] = (x + 0.5 - 0.5 * f->view.width) * pixel;
    point[1] = f->floor;
    point[2] = -(0.5 * f->view.height - y - 0.5) * pixel / 0.5; /* the cosine of 60 degrees */
}

/* Whether the ball, its kernels and the pixels' filter included, lies before such a point. */
static inline int flames_ball_before(const flames *f, const double point[3]) {
    const double along = -(0.5 * point[1] + sqrt(0.75) * point[2]); /* towards the camera */
    const double square = point[0] * point[0] + point[1] * point[1] + point[2] * point[2] - along * along;
    return square < pow(FLAME_RADIUS + 0.03 + 2.5 * f->view.camera.ortho_height / f->view.height, 2);
}

/* --- closed forms --- */

/* Irradiance of a floor from a ball above it, per unit of intensity: a ball attracts as a point does [Newton]. */
static inline double flames_irradiance(const double point[3]) {
    const double square = point[0] * point[0] + point[1] * point[1] + point[2] * point[2];
    return -point[1] / (square * sqrt(square));
}

/* The same summed over the flame's voxels, each by `points` points per axis that have the variance of its kernel: 2, or
   3, which have its fourth moment, too. What glows below the floor does not light it. */
static inline double flames_irradiance_summed(const flames *f, const double point[3], int points) {
    static const double places[2][3] = {{-0.65, 0.65, 0}, {-1.12583302491977, 0, 1.12583302491977}};
    static const double weights[2][3] = {{0.5, 0.5, 0}, {1.0 / 6, 2.0 / 3, 1.0 / 6}};
    const double voxel = f->volumes[0].placement.axis[0][0] / FLAME_SIDE, corner = f->volumes[0].placement.origin[0];
    const int all = points * points * points;
    double sum = 0, weight = 0;
    for (int i = 0; i < FLAME_SIDE * FLAME_SIDE * FLAME_SIDE; ++i) {
        if (!(f->flame[i] > 0)) continue;
        for (int n = 0; n < all; ++n) {
            const int at[3] = {n % points, n / points % points, n / points / points};
            const int voxels[3] = {i % FLAME_SIDE, i / FLAME_SIDE % FLAME_SIDE, i / FLAME_SIDE / FLAME_SIDE};
            double offset[3], square = 0, w = (double)f->flame[i];
            for (int k = 0; k < 3; ++k) {
                offset[k] = corner + (voxels[k] + 0.5 + places[points - 2][at[k]]) * voxel - point[k];
                square += offset[k] * offset[k];
                w *= weights[points - 2][at[k]];
            }
            weight += w;
            sum += w * fmax(offset[1], 0) / (square * sqrt(square));
        }
    }
    return sum / weight;
}

/* The mean of 1 / r^2 over a ball of radius a, at a distance from its centre. */
static inline double flames_inverse_square(double a, double distance) {
    const double d = fmax(distance, 1e-6 * a), x = d / a;
    if (x > 30) return (1 + 0.2 / (x * x)) / (d * d);
    return 0.75 / (a * a) * (2 + (1 - x * x) / x * log((1 + x) / fmax(fabs(1 - x), 1e-12)));
}

/* --- random paths --- */

/* [Steele et al. 2014] */
static inline double flames_random(uint64_t *state) {
    uint64_t z = *state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return (double)((z ^ z >> 31) >> 11) / 9007199254740992.0;
}

typedef struct flames_ray {
    double origin[3], direction[3]; /* of unit length */
} flames_ray;

/* A place on a ray where it meets a floor or a wall. */
typedef struct flames_hit {
    double distance;  /* infinity: none */
    double normal[3]; /* towards where the ray comes from */
} flames_hit;

static inline void flames_along(const flames_ray *ray, double t, double point[3]) {
    for (int i = 0; i < 3; ++i) point[i] = ray->origin[i] + t * ray->direction[i];
}

static inline void flames_hit_floor(const flames *f, const flames_ray *ray, flames_hit *hit) {
    const double t = (f->floor - ray->origin[1]) / ray->direction[1];
    double point[3];
    if (!(f->has_floor && ray->direction[1] < 0 && t > 0)) return;
    flames_along(ray, t, point);
    if (!(fabs(point[0]) <= f->floor_half && fabs(point[2]) <= f->floor_half)) return;
    hit->distance = t, hit->normal[1] = 1;
}

/* The part of a ray in the gas, from 0 on, up to the floor or wall that it meets. */
static inline void flames_cross(const flames *f, const flames_ray *ray, double range[2], flames_hit *hit) {
    int last = 0;
    memset(hit, 0, sizeof *hit);
    hit->distance = HUGE_VAL;
    flames_hit_floor(f, ray, hit);
    range[0] = 0, range[1] = hit->distance;
    for (int i = 0; i < 3; ++i) {
        const double d = fabs(ray->direction[i]) > 1e-12 ? ray->direction[i] : 1e-12;
        const double a = (-f->half[i] - ray->origin[i]) / d, b = (f->half[i] - ray->origin[i]) / d;
        range[0] = fmax(range[0], fmin(a, b));
        if (fmax(a, b) < range[1]) range[1] = fmax(a, b), last = i;
    }
    if (!(range[1] > range[0])) {
        range[1] = range[0] = 0;
    } else if (f->has_walls && !(last == 2 && ray->direction[2] > 0)) {
        hit->distance = range[1];
        hit->normal[last] = ray->direction[last] > 0 ? -1 : 1;
    }
}

/* Transmittance between a point and another one, their distance, and the direction. */
static inline double flames_passes(const flames *f, const double from[3], const double to[3], double *distance,
                                   double direction[3]) {
    flames_ray ray;
    flames_hit hit;
    double range[2], square = 0;
    for (int i = 0; i < 3; ++i) square += (to[i] - from[i]) * (to[i] - from[i]);
    *distance = sqrt(fmax(square, 1e-300));
    for (int i = 0; i < 3; ++i)
        ray.origin[i] = from[i], ray.direction[i] = direction[i] = (to[i] - from[i]) / *distance;
    flames_cross(f, &ray, range, &hit);
    return exp(-f->extinction * fmax(0, fmin(range[1], *distance) - fmin(range[0], *distance)));
}

/* --- light straight from the source, and from the beam of a spotlight --- */

enum { FLAMES_BEAM = 24 };

/* Flux of a spotlight without inner cone, per unit of intensity: the square of a share that grows with the cosine. */
static inline double flames_spot_flux(const flames *f) { return 2 * FLAME_PI * (1 - cos(f->lamp.outer_cone)) / 3; }

/* The n-th of FLAMES_BEAM points of the lit disc that reflect the same power. */
static inline void flames_spot_point(const flames *f, int n, double point[3]) {
    const double s = cbrt((n / 6 + 0.5) / (FLAMES_BEAM / 6)), turn = (n % 6 + 0.25 * (n / 6)) * FLAME_PI / 3;
    const double cosine = 1 - (1 - s) * (1 - cos(f->lamp.outer_cone));
    const double r = (f->lamp.position[1] - f->floor) * sqrt(1 / (cosine * cosine) - 1);
    point[0] = r * cos(turn), point[1] = f->floor, point[2] = r * sin(turn);
}

/* The n-th of FLAMES_BEAM points of the beam, even in angle about a point. Returns the power that gas scatters there,
   as intensity over the square of the distance, per unit of the spotlight's intensity and of the albedo. */
static inline double flames_beam_point(const flames *f, const double about[3], int n, double point[3]) {
    const double q = fmax(hypot(about[0], about[2]), 1e-9), top = fmin(f->half[1], f->lamp.position[1]);
    const double low = atan((f->floor - about[1]) / q), high = atan((top - about[1]) / q);
    const double past =
        exp(-f->extinction * (top - (point[1] = about[1] + q * tan(low + (high - low) * (n + 0.5) / FLAMES_BEAM))));
    point[0] = point[2] = 0;
    return flames_spot_flux(f) * f->extinction * past / (4 * FLAME_PI) * (high - low) / FLAMES_BEAM / q;
}

/* Adds the light of a spotlight that gas or floor has sent on once: fluence, or irradiance if there is a normal. */
static inline void flames_add_spot(const flames *f, const double point[3], const double *normal, double sum[3]) {
    const double past = exp(-f->extinction * (fmin(f->half[1], f->lamp.position[1]) - f->floor));
    for (int n = 0; n < FLAMES_BEAM; ++n) {
        double at[3], way[3], distance, power = flames_beam_point(f, point, n, at);
        double passes = flames_passes(f, point, at, &distance, way);
        const double cosine = normal ? fmax(0, normal[0] * way[0] + normal[1] * way[1] + normal[2] * way[2]) : 1;
        for (int c = 0; c < 3; ++c) sum[c] += power * passes * cosine * f->albedo[c] * f->intensity[c];
        if (normal) continue; /* the floor does not light itself */
        flames_spot_point(f, n, at);
        passes = flames_passes(f, point, at, &distance, way) * fmax(0, -way[1]) / (distance * distance);
        power = flames_spot_flux(f) * past / (FLAMES_BEAM * FLAME_PI);
        for (int c = 0; c < 3; ++c) sum[c] += power * passes * f->color[c] * f->intensity[c];
    }
}

/* Adds what gas at a point scatters, straight from the source, per unit of optical depth. */
static inline void flames_light_gas(const flames *f, const double point[3], const double weight[3], double sum[3]) {
    double fluence[3] = {0, 0, 0}, distance, way[3];
    if (f->source == FLAMES_SPOT) {
        flames_add_spot(f, point, NULL, fluence);
    } else {
        const double passes = flames_passes(f, point, f->focus, &distance, way);
        for (int c = 0; c < 3; ++c) fluence[c] = f->intensity[c] * passes * flames_inverse_square(f->radius, distance);
    }
    for (int c = 0; c < 3; ++c) sum[c] += weight[c] * f->albedo[c] * fluence[c] / (4 * FLAME_PI);
}

/* Adds what a floor or wall reflects, straight from the source. */
static inline void flames_light_wall(const flames *f, const double point[3], const double normal[3],
                                     const double weight[3], double sum[3]) {
    double irradiance[3] = {0, 0, 0}, distance, way[3];
    if (f->source == FLAMES_SPOT) {
        flames_add_spot(f, point, normal, irradiance);
    } else {
        const double passes = flames_passes(f, point, f->focus, &distance, way);
        const double cosine = fmax(0, normal[0] * way[0] + normal[1] * way[1] + normal[2] * way[2]);
        for (int c = 0; c < 3; ++c) irradiance[c] = f->intensity[c] * passes * cosine / (distance * distance);
    }
    for (int c = 0; c < 3; ++c) sum[c] += weight[c] * f->color[c] / FLAME_PI * irradiance[c];
}

/* A unit vector at a cosine from an axis, itself a unit vector, in a random direction about it. */
static inline void flames_about(uint64_t *random, const double axis[3], double cosine, double direction[3]) {
    const double turn = 2 * FLAME_PI * flames_random(random), sine = sqrt(fmax(0, 1 - cosine * cosine));
    const int k = fabs(axis[0]) < 0.6 ? 0 : 1; /* an axis across */
    double across[3] = {-axis[k] * axis[0], -axis[k] * axis[1], -axis[k] * axis[2]}, size;
    across[k] += 1;
    size = sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
    for (int i = 0; i < 3; ++i) across[i] /= size;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        direction[i] =
            cosine * axis[i] + sine * (cos(turn) * across[i] + sin(turn) * (axis[j] * across[l] - axis[l] * across[j]));
    }
}

/* Turns a path, in gas evenly, off a wall by the cosine: half of all that way, the others by an even angle from the
   direction of the source, near which a ray meets the brightest places. Returns the weight. */
static inline double flames_turn(const flames *f, uint64_t *random, const double *normal, flames_ray *ray) {
    double toward[3], distance, cosine, part, along = 1, density;
    flames_passes(f, ray->origin, f->focus, &distance, toward);
    if (flames_random(random) < 0.5)
        flames_about(random, toward, cos(FLAME_PI * flames_random(random)), ray->direction);
    else if (normal)
        flames_about(random, normal, sqrt(flames_random(random)), ray->direction);
    else
        flames_about(random, toward, 2 * flames_random(random) - 1, ray->direction);
    cosine = toward[0] * ray->direction[0] + toward[1] * ray->direction[1] + toward[2] * ray->direction[2];
    part = 1 / (2 * FLAME_PI * FLAME_PI * fmax(sqrt(fmax(0, 1 - cosine * cosine)), 1e-9));
    if (normal) along = normal[0] * ray->direction[0] + normal[1] * ray->direction[1] + normal[2] * ray->direction[2];
    density = normal ? fmax(along, 0) / FLAME_PI : 0.25 / FLAME_PI;
    return density / (0.5 * density + 0.5 * part);
}

/* Draws a place on a ray's part in the gas: by what gets there, or by the angle about the source, which lights all
   angles evenly. Returns the probability of a collision there over the density. */
static inline double flames_collide(const flames *f, const flames_ray *ray, const double range[2], uint64_t *random,
                                    double *t) {
    const double middle =
        -(ray->origin[0] * ray->direction[0] + ray->origin[1] * ray->direction[1] + ray->origin[2] * ray->direction[2]);
    const double taken = -expm1(-f->extinction * (range[1] - range[0]));
    double foot[3], q, low, high, density;
    flames_along(ray, middle, foot);
    q = hypot(hypot(foot[0] - f->focus[0], foot[1] - f->focus[1]), foot[2] - f->focus[2]);
    q = fmax(q, 1e-6 * (range[1] - range[0]));
    low = atan((range[0] - middle) / q), high = atan((range[1] - middle) / q);
    if (flames_random(random) < 0.5)
        *t = range[0] - log1p(-taken * flames_random(random)) / f->extinction;
    else
        *t = middle + q * tan(low + (high - low) * flames_random(random));
    *t = fmin(fmax(*t, range[0]), range[1]);
    const double collides = f->extinction * exp(-f->extinction * (*t - range[0]));
    density = 0.5 * collides / taken + 0.5 * q / ((q * q + (*t - middle) * (*t - middle)) * (high - low));
    return collides / density;
}

/* Follows a path that has just been turned, by a wall or by gas, and adds what it meets that the source lights. */
static inline void flames_follow(const flames *f, flames_ray *ray, int off_wall, const double start[3],
                                 uint64_t *random, double sum[3]) {
    double weight[3] = {start[0], start[1], start[2]}, range[2], t;
    for (int order = 0; order < 40 && weight[0] > 0; ++order) {
        flames_hit hit;
        flames_cross(f, ray, range, &hit);
        const double passes = exp(-f->extinction * (range[1] - range[0]));
        const int wall = hit.distance < 1e300 && !off_wall;
        const double chance = !wall ? 1 : passes < 1 ? fmin(fmax(1 - passes, 0.25), 0.75) : 0; /* of gas */
        if (!wall && !(passes < 1)) return;
        off_wall = !(flames_random(random) < chance);
        double w = off_wall ? passes / (1 - chance) : flames_collide(f, ray, range, random, &t) / chance;
        for (int c = 0; c < 3; ++c) weight[c] *= w;
        flames_along(ray, off_wall ? hit.distance : t, ray->origin);
        if (off_wall)
            flames_light_wall(f, ray->origin, hit.normal, weight, sum);
        else
            flames_light_gas(f, ray->origin, weight, sum);
        w = flames_turn(f, random, off_wall ? hit.normal : NULL, ray);
        for (int c = 0; c < 3; ++c) weight[c] *= w * (off_wall ? f->color[c] : f->albedo[c]);
    }
}

/* What has scattered or been reflected once, straight from the source, along an eye's ray, by midpoints. */
static inline void flames_radiance_once(const flames *f, const flames_ray *eye, int steps, double sum[3]) {
    double range[2], weight[3], point[3];
    flames_hit hit;
    flames_cross(f, eye, range, &hit);
    const double length = range[1] - range[0], h = length / steps;
    sum[0] = sum[1] = sum[2] = 0;
    for (int i = 0; i < steps && length > 0; ++i) {
        weight[0] = weight[1] = weight[2] = f->extinction * h * exp(-f->extinction * (i + 0.5) * h);
        flames_along(eye, range[0] + (i + 0.5) * h, point);
        flames_light_gas(f, point, weight, sum);
    }
    weight[0] = weight[1] = weight[2] = exp(-f->extinction * length);
    if (!(hit.distance < 1e300)) return;
    flames_along(eye, hit.distance, point);
    flames_light_wall(f, point, hit.normal, weight, sum);
}

/* Radiance along an eye's ray, without what the source itself shows there: the above, and the rest by random paths, so
   many that begin in the gas, and as many on the wall. */
static inline void flames_radiance(const flames *f, const flames_ray *eye, int steps, int paths, uint64_t *random,
                                   double sum[3]) {
    double range[2], more[3] = {0, 0, 0}, weight[3], w;
    flames_ray ray;
    flames_hit hit;
    flames_cross(f, eye, range, &hit);
    const double past = exp(-f->extinction * (range[1] - range[0]));
    flames_radiance_once(f, eye, steps, sum);
    for (int i = 0; i < paths && f->extinction > 0; ++i) {
        const double u = (i + flames_random(random)) / paths;
        flames_along(eye, range[0] - log(1 - u * (1 - past)) / f->extinction, ray.origin);
        w = flames_turn(f, random, NULL, &ray);
        for (int c = 0; c < 3; ++c) weight[c] = w * (1 - past) * f->albedo[c] / paths;
        flames_follow(f, &ray, 0, weight, random, more);
        if (!(hit.distance < 1e300)) continue;
        flames_along(eye, hit.distance, ray.origin);
        w = flames_turn(f, random, hit.normal, &ray);
        for (int c = 0; c < 3; ++c) weight[c] = w * past * f->color[c] / paths;
        flames_follow(f, &ray, 1, weight, random, more);
    }
    for (int c = 0; c < 3; ++c) sum[c] += more[c];
}

#endif
