/* Textures: a globe with an image on it over a checkered ground, behind a trail of smoke that shades both. The ground
   is a formula, which is filtered over the pixel; the image is an array, as an engine would have it. */

#include "scene.h"
#include "scene_program.h"
#include "shapes.h"

/* --- a checker --- */

/* Integral from 0 to x of a wave that is 1 in 0..1, -1 in 1..2, and so on: a triangle wave. */
static double square_wave_integral(double x) { return fabs(x - 2 * floor(0.5 * x + 0.5)); }

/* Mean of that wave over a width. */
static double square_wave(double x, double width) {
    const double w = fmax(width, 1e-6);
    return (square_wave_integral(x + 0.5 * w) - square_wave_integral(x - 0.5 * w)) / w;
}

/* sps_mesh.shade_fn of the ground: tiles as wide as 1 in u and v. A pixel covers uv_dx and uv_dy; means over these turn
   the tiles near the horizon into an even grey, where single samples would be noise. */
static int shade_ground(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    static const float tiles[2][3] = {{0.045f, 0.05f, 0.06f}, {0.22f, 0.20f, 0.17f}};
    (void)user;
    for (size_t i = 0; i < count; ++i) {
        const sps_surface_point *p = &points[i];
        double wave = 1;
        for (int k = 0; k < 2; ++k)
            wave *= square_wave(p->uv[k], fabs((double)p->uv_dx[k]) + fabs((double)p->uv_dy[k]));
        for (int c = 0; c < 3; ++c)
            out[i].albedo[c] = (float)ex_mix((double)tiles[0][c], (double)tiles[1][c], 0.5 + 0.5 * wave);
    }
    return 0;
}

/* --- an image --- */

enum { IMAGE_WIDTH = 512, IMAGE_HEIGHT = 256 };

typedef struct texture {
    float texels[IMAGE_HEIGHT][IMAGE_WIDTH][4]; /* reflectance, and light of its own: the towns of the night side */
} texture;

/* A point of the unit sphere: u runs from pole to pole, v around. */
static ex_vec sphere_point(double u, double v) {
    const double polar = EX_PI * u, azimuth = 2 * EX_PI * v;
    return ex_vec_of(sin(polar) * cos(azimuth), cos(polar), -sin(polar) * sin(azimuth));
}

/* Draws land and sea, ice at the poles, and towns on the coast. */
static void draw_map(texture *map) {
    static const float sea[3] = {0.01f, 0.04f, 0.12f}, land[3] = {0.05f, 0.12f, 0.03f}, dry[3] = {0.21f, 0.16f, 0.08f};
    for (int y = 0; y < IMAGE_HEIGHT; ++y)
        for (int x = 0; x < IMAGE_WIDTH; ++x) {
            const ex_vec p = sphere_point((y + 0.5) / IMAGE_HEIGHT, (x + 0.5) / IMAGE_WIDTH);
            const double height = ex_fractal(ex_vec_scale(p, 1.7), 6), dryness = ex_fractal(ex_vec_scale(p, 5), 4);
            const double above = ex_ramp(0.02, 0.05, height), desert = ex_ramp(-0.1, 0.3, dryness);
            const double ice = ex_ramp(0.86, 0.90, fabs(p.y) + 0.15 * dryness);
            const double town = ex_ramp(0.35, 0.5, ex_fractal(ex_vec_scale(p, 31), 2)) * above;
            for (int c = 0; c < 3; ++c) {
                const double soil = ex_mix((double)land[c], (double)dry[c], desert);
                map->texels[y][x][c] = (float)ex_mix(ex_mix((double)sea[c], soil, above), 0.45, ice);
            }
            map->texels[y][x][3] = (float)(town * (1 - ice));
        }
}

/* The image at u, v, between four texels; it goes on around the globe. */
static void look_up(const texture *map, double u, double v, double texel[4]) {
    const double y = ex_clamp(u * IMAGE_HEIGHT - 0.5, 0, IMAGE_HEIGHT - 1), x = v * IMAGE_WIDTH - 0.5;
    const int y0 = (int)y, x0 = (int)floor(x);
    memset(texel, 0, 4 * sizeof *texel);
    for (int i = 0; i < 4; ++i) {
        const int row = y0 + i / 2 < IMAGE_HEIGHT ? y0 + i / 2 : IMAGE_HEIGHT - 1;
        const int column = (x0 + i % 2 + IMAGE_WIDTH) % IMAGE_WIDTH;
        const double weight = (i / 2 ? y - y0 : 1 - (y - y0)) * (i % 2 ? x - x0 : 1 - (x - x0));
        for (int c = 0; c < 4; ++c) texel[c] += weight * (double)map->texels[row][column][c];
    }
}

/* sps_mesh.shade_fn of the globe. A texel is about as large as a pixel, so that the image needs no other filter. */
static int shade_globe(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    for (size_t i = 0; i < count; ++i) {
        double texel[4];
        look_up((const texture *)user, points[i].uv[0], points[i].uv[1], texel);
        for (int c = 0; c < 3; ++c) out[i].albedo[c] = (float)texel[c];
        ex_color(out[i].emission, 0.35 * texel[3], 0.24 * texel[3], 0.08 * texel[3]);
    }
    return 0;
}

/* --- the scene --- */

/* ex_surface_fn: the globe, whose axis is tilted. */
static ex_vec globe_point(const void *shape, double u, double v) {
    const ex_vec p = sphere_point(u, v);
    const double c = cos(0.4), s = sin(0.4);
    (void)shape;
    return ex_vec_of(0.95 * (c * p.x + s * p.y), 1.15 + 0.95 * (c * p.y - s * p.x), 0.95 * p.z);
}

/* sps_volume.eval_fn: a trail of smoke that winds around the globe and thins out. */
static int smoke_value(void *user, size_t count, const double *positions, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i, positions += 3) {
        const ex_vec p = ex_vec_of(positions[0], positions[1], positions[2]);
        const double around = atan2(p.z, p.x), across = sqrt(p.x * p.x + p.z * p.z) - 1.45;
        const double up = p.y - 1.0 - 0.25 * sin(around + 0.6);
        const double creases = 0.30 * ex_turbulence(ex_vec_scale(p, 2.2), 4);
        const double along = 0.22 + 0.14 * cos(around - 2.4);
        out[i] = (float)ex_ramp(along + 0.12, along - 0.08, sqrt(across * across + up * up) + creases);
    }
    return 0;
}

static void set_smoke(sps_volume *smoke) {
    static const sps_lobe forward = {0.3f, 1};
    ex_volume_box(smoke, ex_vec_of(-2, 0.35, -2), ex_vec_of(2, 1.75, 2), 128);
    smoke->eval_fn = smoke_value, smoke->concurrent = 1;
    smoke->extinction = 5;
    ex_color(smoke->albedo, 0.95, 0.94, 0.92);
    smoke->lobes = &forward, smoke->lobe_count = 1;
}

/* Half a unit to a tile: texture coordinates from 0 to 1 become those of the tiles. */
static void build_ground(ex_mesh *mesh, const float color[3]) {
    ex_shape_quad(mesh, ex_vec_of(-40, 0, -60), ex_vec_of(-40, 0, 10), ex_vec_of(40, 0, 10), ex_vec_of(40, 0, -60),
                  color);
    for (int i = 0; i < 6; ++i) {
        mesh->triangles[i / 3].uv[i % 3][0] *= 70 / 0.5f;
        mesh->triangles[i / 3].uv[i % 3][1] *= 80 / 0.5f;
    }
}

int main(int argc, char **argv) {
    static const float white[3] = {1, 1, 1};
    static texture map;
    const sps_light sun = ex_sun(ex_vec_of(1.0, -1.2, -0.5), 15);
    const sps_view view = ex_view(ex_vec_of(-0.9, 2.3, 6.6), ex_vec_of(0.1, 0.85, 0), 30);
    sps_scene scene = ex_scene(&sun);
    sps_volume smoke = {0};
    ex_mesh shapes[2] = {{0}};
    draw_map(&map);
    set_smoke(&smoke);
    build_ground(&shapes[0], white);
    ex_shape_surface(&shapes[1], globe_point, NULL, 48, 96, white, NULL);
    sps_mesh meshes[2] = {ex_shape_mesh(&shapes[0]), ex_shape_mesh(&shapes[1])};
    meshes[0].shade_fn = shade_ground;
    meshes[1].shade_fn = shade_globe, meshes[1].shade_user = &map;
    scene.volumes = &smoke, scene.volume_count = 1;
    scene.meshes = meshes, scene.mesh_count = 2;
    /* The image's texels and the ball's hard shadow would show steps. */
    const int status = ex_scene_program(argc, argv, "textured.png", &scene, &view, EX_SAMPLE_ALL);
    for (int i = 0; i < 2; ++i) ex_mesh_free(&shapes[i]);
    return status;
}
