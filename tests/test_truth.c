/* Colors against closed forms, channel by channel, of sps_reference and of sps_render, which share what resolves
   lights, cones, projectors, cameras and transfer functions: a mistake there is wrong in both, and no comparison of the
   two sees it. Each scene is seen with three unequal channels, and with each two of them equal, which is not grey.

   With an optical depth t of the eye's ray, whatever the density along it, a sun that shines along it from the eye's
   side is scattered back as albedo * phase * E * (1 - exp(-2 t)) / 2, and one from behind as albedo * phase * E * t *
   exp(-t). */

#include "check.h"

enum { SIDE = 3, PIXELS = SIDE * SIDE, MIDDLE = PIXELS / 2 };

static float image[4 * PIXELS];
static check_triangles floor_faces;
static const float one = 1;

/* The colors of a scene: of the light, of what it meets, of what glows, and of what surrounds. */
typedef struct palette {
    float light[3], albedo[3], glow[3], around[3];
} palette;

/* Number n: 0, all different; 1 to 3, two channels equal, the same two in all colors. */
static palette palette_of(int n) {
    static const palette all = {{2, 3, 5}, {0.9f, 0.6f, 0.3f}, {0.2f, 0.5f, 0.9f}, {0.3f, 0.8f, 0.5f}};
    palette p = all;
    float *const colors[4] = {p.light, p.albedo, p.glow, p.around};
    for (int i = 0; i < 4 && n > 0; ++i) colors[i][n % 3] = colors[i][(n + 1) % 3];
    return p;
}

/* A scene, and the radiance of its middle pixel. */
typedef struct truth {
    const char *name;
    void (*build)(check_scene *s, const palette *p);
    double (*radiance)(const palette *p, int channel);
    double march, render; /* relative tolerances of sps_reference and of sps_render */
    int pixel;            /* number, from 1, of another pixel; 0: the middle one */
} truth;

/* --- gas: a layer of optical depth DEPTH along the eye's ray, so wide that its sides are not seen --- */

#define DEPTH 1.3

static sps_volume *add_layer(check_scene *s) {
    sps_volume *layer = check_add_volume(s, 21, 17, 12, check_box(-2.1, -1.7, -0.6, 2.1, 1.7, 0.6));
    layer->read_fn = check_read_constant, layer->user = (void *)(size_t)&one;
    layer->extinction = (float)(DEPTH / 1.2);
    return layer;
}

/* Henyey-Greenstein's phase function. */
static double phase(double g, double cosine) { return (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * cosine, 1.5)); }

static void color_volume(sps_volume *volume, const palette *p) { memcpy(volume->albedo, p->albedo, sizeof p->albedo); }

static void lit_layer(check_scene *s, const palette *p, double z) {
    static const sps_lobe lobes[2] = {{0.5f, 3}, {-0.2f, 1}};
    sps_volume *layer = add_layer(s);
    layer->lobes = lobes, layer->lobe_count = 2;
    color_volume(layer, p);
    memcpy(check_add_directional(s, 0, 0, z, 1)->color, p->light, sizeof p->light);
}

static double lobes_phase(double cosine) { return 0.75 * phase(0.5, cosine) + 0.25 * phase(-0.2, cosine); }

static void front_lit(check_scene *s, const palette *p) { lit_layer(s, p, -1); }
static double front_lit_is(const palette *p, int c) {
    return (double)p->albedo[c] * (double)p->light[c] * lobes_phase(-1) * 0.5 * -expm1(-2 * DEPTH);
}

static void back_lit(check_scene *s, const palette *p) { lit_layer(s, p, 1); }
static double back_lit_is(const palette *p, int c) {
    return (double)p->albedo[c] * (double)p->light[c] * lobes_phase(1) * DEPTH * exp(-DEPTH);
}

/* The same, by an orthographic matrix whose near plane lies in the layer's middle: gas before it is seen, too. */
static void by_matrix(check_scene *s, const palette *p) {
    static const double matrix[16] = {40, 0, 0, 0, 0, 40, 0, 0, 0, 0, -1, -1, 0, 0, 0, 1};
    front_lit(s, p);
    check_matrix(&s->view.camera, matrix);
}

/* The same, in a box that is turned about the eye's rays and leans: each ray still crosses 1.2 of it. */
static void turned(check_scene *s, const palette *p) {
    sps_placement *place;
    front_lit(s, p);
    place = &s->volume[0].placement;
    check_set3(place->axis[0], 3.5, 2, 0), check_set3(place->axis[1], -1.5, 3, 0),
        check_set3(place->axis[2], 0.3, -0.2, 1.2);
    for (int k = 0; k < 3; ++k) place->origin[k] = -0.5 * (place->axis[0][k] + place->axis[1][k] + place->axis[2][k]);
}

/* The same, with another sun behind a black wall, whose shadow holds all of the layer. */
static void beside_hidden_sun(check_scene *s, const palette *p) {
    static const double corner[3] = {-9, -9, -2}, right[3] = {18, 0, 0}, up[3] = {0, 18, 0};
    static check_triangles faces;
    front_lit(s, p);
    if (faces.count == 0) check_add_quad(&faces, corner, right, up);
    check_add_mesh(s, &faces, 0);
    check_add_directional(s, 0.2, 0.1, 1, 4);
}

/* Classified gas about the eye, in front of a floor at depth 0.6, under a sun that nothing shades: all of the ray has
   the value 1, halfway between two points. */
static void classified(check_scene *s, const palette *p) {
    static const double corner[3] = {-1, -1, -0.3}, right[3] = {2, 0, 0}, up[3] = {0, 2, 0};
    static sps_transfer_point points[2];
    static sps_transfer transfer;
    static check_triangles faces;
    sps_volume *layer = add_layer(s);
    for (int i = 0; i < 2; ++i) {
        points[i].value = i ? 1.5f : 0.5f, points[i].extinction = (float)(DEPTH / 0.6 * (i ? 1.4 : 0.6));
        for (int c = 0; c < 3; ++c) points[i].albedo[c] = p->albedo[c] * (i ? 0.9f : 1.1f);
    }
    memset(&transfer, 0, sizeof transfer);
    transfer.points = points, transfer.point_count = 2;
    layer->transfer = &transfer;
    if (faces.count == 0) check_add_quad(&faces, corner, right, up);
    memcpy(check_add_mesh(s, &faces, 1)->albedo, p->around, sizeof p->around);
    s->view.camera.position[2] = 0.3, s->view.camera.target[2] = -1;
    memcpy(check_add_directional(s, 0, 0, -1, 1)->color, p->light, sizeof p->light);
    s->light[0].no_shadow = 1;
}
static double classified_is(const palette *p, int c) {
    const double light = (double)p->light[c];
    return (double)p->albedo[c] * light / (4 * PI) * -expm1(-DEPTH) + (double)p->around[c] * light / PI * exp(-DEPTH);
}

static void glowing(check_scene *s, const palette *p) {
    memcpy(add_layer(s)->emission, p->glow, sizeof p->glow);
    memcpy(s->scene.background, p->around, sizeof p->around);
}
static double glowing_is(const palette *p, int c) {
    return (double)p->glow[c] * 1.2 / DEPTH * -expm1(-DEPTH) + (double)p->around[c] * exp(-DEPTH);
}

/* A pane in the glow, 0.1 before its middle, seen half a unit below the middle, where slabs, which a faint sun tilts,
   have other depths. */
static void pane_in_glow(check_scene *s, const palette *p) {
    static const double corner[3] = {-3, -3, 0.1}, right[3] = {6, 0, 0}, up[3] = {0, 6, 0};
    static check_triangles faces;
    glowing(s, p);
    if (faces.count == 0) check_add_quad(&faces, corner, right, up);
    memcpy(check_add_mesh(s, &faces, 0)->transmittance, p->albedo, sizeof p->albedo);
    check_add_directional(s, 1, 0.8, -1, 1e-9);
    check_orthographic(&s->view.camera, 1.5);
}
static double pane_in_glow_is(const palette *p, int c) {
    const double before = DEPTH * (0.5 - 0.1 / 1.2), behind = DEPTH - before,
                 passes = (double)p->albedo[c] * exp(-before);
    const double glow = (double)p->glow[c] * 1.2 / DEPTH;
    return glow * -expm1(-before) + passes * (glow * -expm1(-behind) + (double)p->around[c] * exp(-behind));
}

/* Ambient light reaches all gas. */
static void surrounded(check_scene *s, const palette *p) {
    color_volume(add_layer(s), p);
    memcpy(s->scene.ambient, p->around, sizeof p->around);
}
static double surrounded_is(const palette *p, int c) {
    return (double)p->albedo[c] * (double)p->around[c] * -expm1(-DEPTH);
}

/* --- a ball of gas, seen 0.3 radii from its middle --- */

static void ball(check_scene *s, const palette *p, int soft, double depth) {
    static sps_particle particle;
    static sps_particles set;
    memset(&particle, 0, sizeof particle), memset(&set, 0, sizeof set);
    particle.radius = 1, particle.optical_depth = (float)depth, particle.position[0] = 0.3f;
    set.count = 1, set.read_fn = check_read_particles, set.user = &particle, set.soft = soft;
    memcpy(set.albedo, p->albedo, sizeof p->albedo), memcpy(set.emission, p->glow, sizeof p->glow);
    s->scene.particles = &set, s->scene.particle_set_count = 1;
    memcpy(check_add_directional(s, 0, 0, -1, 1)->color, p->light, sizeof p->light);
}

static double ball_is(const palette *p, int c, double depth) {
    const double scattered = (double)p->albedo[c] * (double)p->light[c] / (4 * PI) * 0.5 * -expm1(-2 * depth);
    return scattered + (double)p->glow[c] * -expm1(-depth);
}

static void even_ball(check_scene *s, const palette *p) { ball(s, p, 0, 2); }
static double even_ball_is(const palette *p, int c) { return ball_is(p, c, 2 * sqrt(0.91)); }
static void soft_ball(check_scene *s, const palette *p) { ball(s, p, 1, 2); }
static double soft_ball_is(const palette *p, int c) { return ball_is(p, c, 2 * pow(0.91, 1.5)); }

/* A dense one under a sun from the right, in the thickest slabs that are cut finer where particles are dense. Its light
   is a quadrature along the ray at x = 0.3: sqrt(1 - z^2) - x of gas lie towards the sun. */
#define THICK 3.0 /* optical depth of a radius */

static void dense_ball(check_scene *s, const palette *p) {
    ball(s, p, 0, 2 * THICK);
    check_set3(s->light[0].direction, -1, 0, 0);
    memset(((sps_particles *)(size_t)s->scene.particles)->emission, 0, 3 * sizeof(float));
    ((sps_particle *)s->scene.particles->user)->position[0] = -0.3f;
    s->view.slab_thickness = 2;
}
static double dense_ball_is(const palette *p, int c) {
    enum { STEPS = 4000 };
    const double top = sqrt(0.91), step = 2 * top / STEPS;
    double sum = 0;
    for (int i = 0; i < STEPS; ++i) {
        const double z = top - (i + 0.5) * step;
        sum += THICK * step * exp(-THICK * (top - z + sqrt(1 - z * z) - 0.3));
    }
    return (double)p->albedo[c] * (double)p->light[c] / (4 * PI) * sum;
}

/* --- a floor, seen from above, under lights of each kind; z = 0 --- */

static void add_floor(check_scene *s, const palette *p) {
    static const double corner[3] = {-4, -3, 0}, right[3] = {8, 0, 0}, up[3] = {0, 6, 0};
    if (floor_faces.count == 0) check_add_quad(&floor_faces, corner, right, up);
    memcpy(check_add_mesh(s, &floor_faces, 1)->albedo, p->albedo, sizeof p->albedo);
}

static double floor_is(const palette *p, int c, double irradiance) {
    return (double)p->albedo[c] * (double)p->light[c] * irradiance / PI;
}

static void sun_on_floor(check_scene *s, const palette *p) {
    add_floor(s, p);
    memcpy(check_add_directional(s, 3, 0, -4, 1)->color, p->light, sizeof p->light);
}
static double sun_on_floor_is(const palette *p, int c) { return floor_is(p, c, 0.8); }

static sps_light *lamp_on_floor(check_scene *s, const palette *p) {
    sps_light *lamp = check_add_point(s, 0, 1.5, 2, 1);
    add_floor(s, p);
    memcpy(lamp->color, p->light, sizeof p->light);
    return lamp;
}

static void point_on_floor(check_scene *s, const palette *p) { lamp_on_floor(s, p); }
static double point_on_floor_is(const palette *p, int c) { return floor_is(p, c, 2 / pow(6.25, 1.5)); }

/* The first pixel, at the upper left, of an eye 3 above the middle: its ray meets the floor at (-d, d), d = 3 tan(0.45)
   times the pixel's centre, 2/3 of the way to the edge. */
static void perspective(check_scene *s, const palette *p) {
    lamp_on_floor(s, p);
    s->view.camera.position[2] = 3;
    check_perspective(&s->view.camera, 0.9);
}
static void perspective_matrix(check_scene *s, const palette *p) {
    static double matrix[16]; /* from (0, 0, 3) down, y up in the image, depth from 0 at 0.1 to 1 at infinity */
    lamp_on_floor(s, p);
    matrix[0] = matrix[5] = 1 / tan(0.45);
    matrix[10] = -1, matrix[11] = 3 - 0.1, matrix[14] = -1, matrix[15] = 3;
    check_matrix(&s->view.camera, matrix);
}
static double perspective_is(const palette *p, int c) {
    const double d = 2 * tan(0.45), square = d * d + (1.5 - d) * (1.5 - d) + 4;
    return floor_is(p, c, 2 / pow(square, 1.5));
}

/* A spotlight straight down: the ray to the middle pixel has a cosine of 0.8 with its axis, and is between the angles.
 */
#define INNER 0.5
#define OUTER 0.9

static void cone_on_floor(check_scene *s, const palette *p) {
    sps_light *lamp = lamp_on_floor(s, p);
    check_set3(lamp->direction, 0, 0, -1);
    lamp->inner_cone = INNER, lamp->outer_cone = OUTER, lamp->falloff = SPS_FALLOFF_NONE;
}
static double cone_on_floor_is(const palette *p, int c) {
    const double rise = (0.8 - cos(OUTER)) / (cos(INNER) - cos(OUTER));
    return floor_is(p, c, 0.8 * rise * rise);
}

/* A disc of radius 1 at a height of 2 over the middle: the mean of h / (h^2 + r^2)^1.5 over it. */
static void disc_on_floor(check_scene *s, const palette *p) {
    sps_light *disc = check_add_light(s, SPS_LIGHT_DISC, 1);
    add_floor(s, p);
    check_set3(disc->position, 0, 0, 2), check_set3(disc->axes[0], 1, 0, 0), check_set3(disc->axes[1], 0, 1, 0);
    memcpy(disc->color, p->light, sizeof p->light), disc->samples = 256;
}
static double disc_on_floor_is(const palette *p, int c) { return floor_is(p, c, 2 * (1 - 2 / sqrt(5.0))); }

/* The same, with an even ball of radius 0.3 and a depth of 2 between parts of the disc and the middle: the mean over
   points of the disc of what passes. */
static void disc_and_ball(check_scene *s, const palette *p) {
    ball(s, p, 0, 2);
    s->scene.light_count = 0;
    memset(((sps_particles *)(size_t)s->scene.particles)->emission, 0, 3 * sizeof(float));
    sps_particle *particle = (sps_particle *)s->scene.particles->user;
    particle->radius = 0.3f, particle->position[0] = 0.45f, particle->position[2] = 1;
    disc_on_floor(s, p);
}
static double disc_and_ball_is(const palette *p, int c) {
    enum { ACROSS = 100, AROUND = 100 };
    double sum = 0;
    for (int n = 0; n < ACROSS * AROUND; ++n) {
        const double r = sqrt((n % ACROSS + 0.5) / ACROSS), turn = 2 * PI * (n / ACROSS + 0.5) / AROUND;
        const double way[3] = {r * cos(turn), r * sin(turn), 2}, length = sqrt(r * r + 4);
        const double along = (0.45 * way[0] + way[2]) / length, square = 0.09 - (0.45 * 0.45 + 1 - along * along);
        sum += 2 / pow(length, 3) * exp(square > 0 ? -2 * sqrt(square) / 0.3 : 0);
    }
    return floor_is(p, c, sum / (ACROSS * AROUND));
}

/* Two discs by tables, of which each takes fewer than it has points, since there is gas, beside all that is looked at.
 */
static void two_discs(check_scene *s, const palette *p) {
    sps_volume *gas = add_layer(s);
    sps_light *high;
    gas->placement = check_box(2.5, 1.5, 0.5, 3.5, 2.5, 1.5);
    color_volume(gas, p);
    disc_on_floor(s, p);
    high = check_add_light(s, SPS_LIGHT_DISC, 1);
    check_set3(high->position, 0, 0, 3), check_set3(high->axes[0], 0.5, 0, 0), check_set3(high->axes[1], 0, 0.5, 0);
    for (int c = 0; c < 3; ++c) high->color[c] = 3 * p->light[c];
    for (int i = 0; i < 2; ++i) s->light[i].samples = 64, s->light[i].shadow_source = SPS_SHADOW_TABLE;
}
static double two_discs_are(const palette *p, int c) {
    return disc_on_floor_is(p, c) + 3 * floor_is(p, c, 8 * (1 - 3 / sqrt(9.25)));
}

/* An image of three columns, thrown by a lamp whose image is seen upright from behind it. */
static int paint_columns(void *user, size_t count, const float *uv, float *out) {
    (void)user;
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) out[3 * i + c] = (float)(1 + (int)(3 * uv[2 * i])) * (1 + 0.1f * (float)c);
    return 0;
}

static void image_on_floor(check_scene *s, const palette *p) {
    static sps_projector slide;
    sps_light *lamp = check_add_point(s, 0.3, 0, 2, 1);
    add_floor(s, p);
    memset(&slide, 0, sizeof slide);
    slide.width = 3, slide.height = 2, slide.sample_fn = paint_columns, slide.up[1] = 1;
    slide.left = -0.9, slide.right = 0.9, slide.bottom = -1, slide.top = 1;
    check_set3(lamp->direction, 0, 0, -1);
    lamp->projector = &slide;
    memcpy(lamp->color, p->light, sizeof p->light);
}
/* Right in the image is direction x up = +x: the middle is at a tangent of 0.15 to the left. */
static double image_on_floor_is(const palette *p, int c) {
    const double u = (-0.15 + 0.9) / 1.8, texel = 3 * u - 0.5, value = 1 + texel;
    return floor_is(p, c, 2 / pow(4.09, 1.5) * value * (1 + 0.1 * c));
}

/* Two panes before a floor in ambient light: each filters what the eye sees, and sends back a part of its own. */
static void panes(check_scene *s, const palette *p) {
    static check_triangles faces[2];
    for (int i = 0; i < 2; ++i) {
        const double corner[3] = {-3, -3, 1 + 0.5 * i}, right[3] = {6, 0, 0}, up[3] = {0, 6, 0};
        if (faces[i].count == 0) check_add_quad(&faces[i], corner, right, up);
    }
    add_floor(s, p);
    for (int i = 0; i < 2; ++i) {
        sps_mesh *pane = check_add_mesh(s, &faces[i], 0.1);
        memcpy(pane->transmittance, i ? p->around : p->albedo, sizeof p->around);
    }
    memcpy(s->scene.ambient, p->light, sizeof p->light);
}
static double panes_are(const palette *p, int c) {
    const double ambient = (double)p->light[c], behind = ambient * (double)p->albedo[c];
    return 0.1 * ambient + (double)p->around[c] * (0.1 * ambient + (double)p->albedo[c] * behind);
}

/* A stack of 40 panes of different colors, whose list is in no order: what each sends back passes those above it. */
enum { STACK = 40 };

static double stack_color(int level, int c) { return 0.05 + 0.01 * ((level * 7 + c * 3) % 11); }

static void stack(check_scene *s, const palette *p) {
    static check_triangles faces;
    sps_mesh *mesh;
    for (int i = 0; i < STACK && faces.count < 2 * STACK; ++i) {
        const int level = 23 * i % STACK; /* from the eye */
        const double corner[3] = {-3, -3, 2 - 0.04 * level}, right[3] = {6, 0, 0}, up[3] = {0, 6, 0};
        check_add_quad(&faces, corner, right, up);
        for (int k = 0; k < 6; ++k)
            for (int c = 0; c < 3; ++c)
                faces.list[faces.count - 1 - (size_t)(k / 3)].albedo[k % 3][c] = (float)stack_color(level, c);
    }
    mesh = check_add_mesh(s, &faces, 1);
    mesh->has_albedos = 1;
    for (int c = 0; c < 3; ++c) mesh->transmittance[c] = 1 - 0.1f * p->albedo[c];
    memcpy(s->scene.ambient, p->light, sizeof p->light);
}
static double stack_is(const palette *p, int c) {
    double sum = 0, passes = 1;
    for (int level = 0; level < STACK; ++level) {
        sum += passes * stack_color(level, c) * (double)p->light[c];
        passes *= (double)(1 - 0.1f * p->albedo[c]);
    }
    return sum;
}

/* Marched: midpoints in steps of an optical depth x are off by x^2 / 6 at most, with light there and back, and steps of
   0.1 voxels by 3e-5; balls take one step each, see below. Floors are exact but for floats; the disc's 256 points are
   off by points^-1, as in test_penumbrae of smooth light, half more behind the rim of a ball. Rendered, at high
   quality: light within a slab is second order in it; 0.5 % is twice what test_transport allows such layers, and balls
   have 0.7 %, as test_particles does. Slabs of an optical depth of x = 0.525, an eighth of 2 * 0.7 radii, are off by (2
   x)^2 / 24 = 5 %, twice that where light falls as fast across them. */
static const truth truths[] = {
    {"layer lit from the front", front_lit, front_lit_is, 1e-3, 0.005, 0},
    {"layer lit from the front, by a matrix", by_matrix, front_lit_is, 1e-3, 0.005, 0},
    {"turned and sheared layer", turned, front_lit_is, 1e-3, 0.005, 0},
    {"layer between a sun and a hidden one", beside_hidden_sun, front_lit_is, 1e-3, 0.005, 0},
    {"layer lit from behind", back_lit, back_lit_is, 1e-3, 0.005, 0},
    {"classified gas before a floor", classified, classified_is, 1e-3, 0.005, 0},
    {"layer that glows", glowing, glowing_is, 1e-3, 0.005, 0},
    {"pane in a layer that glows", pane_in_glow, pane_in_glow_is, 1e-3, 0.005, 8},
    {"layer in ambient light", surrounded, surrounded_is, 1e-3, 0.005, 0},
    {"even ball", even_ball, even_ball_is, 1e-3, 0.01, 0},
    {"soft ball", soft_ball, soft_ball_is, 1e-3, 0.01, 0},
    {"dense ball in thick slabs", dense_ball, dense_ball_is, 0.01, 0.1, 0},
    {"sun on a floor", sun_on_floor, sun_on_floor_is, 1e-5, 1e-5, 0},
    {"lamp on a floor", point_on_floor, point_on_floor_is, 1e-5, 1e-5, 0},
    {"lamp on a floor, in perspective", perspective, perspective_is, 1e-5, 1e-5, 1},
    {"lamp on a floor, by a matrix", perspective_matrix, perspective_is, 1e-5, 1e-5, 1},
    {"spotlight on a floor", cone_on_floor, cone_on_floor_is, 1e-5, 1e-5, 0},
    {"disc on a floor", disc_on_floor, disc_on_floor_is, 4e-3, 4e-3, 0},
    {"disc behind a ball, on a floor", disc_and_ball, disc_and_ball_is, 6e-3, 6e-3, 0},
    {"two discs on a floor", two_discs, two_discs_are, 1e-2, 4e-3, 0},
    {"image on a floor", image_on_floor, image_on_floor_is, 1e-5, 1e-5, 0},
    {"panes before a floor", panes, panes_are, 1e-5, 1e-5, 0},
    {"a stack of panes", stack, stack_is, 1e-5, 1e-5, 0},
};

static void check_truth(sps_context *context, const truth *t, int marched, int n) {
    const palette p = palette_of(n);
    const double share = marched ? t->march : t->render;
    check_scene s;
    check_clear(&s, SIDE, SIDE);
    check_orthographic(&s.view.camera, 0.05);
    s.view.quality = SPS_QUALITY_HIGH;
    t->build(&s, &p);
    if (marched ? !check_march(context, &s, 0.1, image, NULL) : !check_render(context, &s, image)) return;
    for (int c = 0; c < 3; ++c) {
        const double exact = t->radiance(&p, c);
        const double found = (double)image[4 * (t->pixel ? t->pixel - 1 : MIDDLE) + c];
        if (figures())
            printf("%s, %s, palette %d, channel %d: %+.5f %%\n", t->name, marched ? "marched" : "rendered", n, c,
                   100 * (found / exact - 1));
        if (!CHECK_CASE("Transport",
                        "layers, balls, lights on floors, images and panes in unequal colors, marched and rendered",
                        "closed forms in each channel", fabs(found / exact - 1) / share, 1,
                        "1e-5 to 1 %, derived in tests/test_truth.c"))
            printf("    %s, %s, palette %d, channel %d: %g, exact %g\n", t->name, marched ? "marched" : "rendered", n,
                   c, found, exact);
    }
}

static void test_truths(void) {
    sps_context *context = check_context(NULL);
    for (size_t i = 0; i < sizeof truths / sizeof *truths; ++i)
        for (int n = 0; n < 4; ++n)
            for (int marched = 0; marched < 2; ++marched)
                if (check_long() || ((int)i + n + marched) % 2 == 0) check_truth(context, &truths[i], marched, n);
    sps_destroy(context);
    check_free_triangles(&floor_faces);
}

int main(void) {
    RUN(test_truths);
    return check_report();
}
