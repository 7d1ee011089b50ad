/* Translucent polygons against exact answers: what is seen through them, the light that they let pass, and gas between
   them; and pixels that edges of polygons cross. Every test runs for all renderers of the table. Errors that tolerances
   are made of: EXACT  of polygons alone: they are shaded in double precision, from and into floats, and a few of these
   are multiplied. 6e-8 each. ripple of a constant grid's optical depth, see the table. */

#include "check.h"

#define EXACT     1e-6
#define ISOTROPIC (0.25 / PI)

enum { PIXELS_MOST = 48 * 48, LISTS = 4 };
static float image[4 * PIXELS_MOST], depths[PIXELS_MOST], plain[4 * PIXELS_MOST], dark[4 * PIXELS_MOST];
static sps_context *context;
static check_triangles lists[LISTS];
static float one = 1;

typedef struct renderer {
    const char *name;
    sps_result (*run)(const check_scene *s, const sps_image *into);
    /* Largest relative error of the optical depth of a constant grid. Kernels of standard deviation 0.65 voxels sum up
       to 1 +- 2 exp(-2 (0.65 pi)^2) = 1 +- 4.8e-4 along each axis across a ray; along the ray that cancels out. When
       they are cut, as by sps_render, there is more: test_ripple in test_transport.c. */
    double ripple;
    int samples_all; /* 1: with coverage_samples, gas and shading are sampled too, not only polygons' edges */
} renderer;

/* Steps of a quarter of a voxel. */
static sps_result march(const check_scene *s, const sps_image *into) {
    return check_reference(context, &s->scene, &s->view, 0.25, into);
}

static sps_result draw(const check_scene *s, const sps_image *into) {
    return sps_render(context, &s->scene, &s->view, into);
}

#define RENDERERS 2
static const renderer renderers[] = {{"sps_reference", march, 0.001, 1}, {"sps_render", draw, 0.002, 0}};

/* ---------------------------------------------------------------------------------------------------------- helpers */

static void start(check_scene *s, int width, int height) {
    check_clear(s, width, height);
    s->view.quality = SPS_QUALITY_HIGH;
    for (int i = 0; i < LISTS; ++i) lists[i].count = 0;
}

/* Renders into `rgba` and `depths`. */
static int render_into(const renderer *r, const check_scene *s, float *rgba) {
    sps_image into;
    memset(&into, 0, sizeof into);
    into.rgba = rgba;
    into.depth = depths;
    if (CHECK_OK(context, r->run(s, &into))) return 1;
    printf("    %s\n", r->name);
    return 0;
}

/* Adds the square |x|, |y| <= half at height z to a list. */
static void add_square(check_triangles *triangles, double half, double z) {
    const double origin[3] = {-half, -half, z}, u[3] = {2 * half, 0, 0}, v[3] = {0, 2 * half, 0};
    check_add_quad(triangles, origin, u, v);
}

/* A mesh of the next list, which is not empty: black, and of these transmittances. */
static sps_mesh *add_mesh(check_scene *s, double r, double g, double b) {
    sps_mesh *mesh = check_add_mesh(s, &lists[s->scene.mesh_count], 0);
    check_color(mesh->transmittance, r, g, b);
    return mesh;
}

/* A pane that covers the view, at height z. */
static sps_mesh *add_pane(check_scene *s, double z, double r, double g, double b) {
    add_square(&lists[s->scene.mesh_count], 50, z);
    return add_mesh(s, r, g, b);
}

/* An opaque ground of this reflectance at z = 0, which the eye sees from z = 1, below the panes. */
static void add_ground(check_scene *s, double reflectance) {
    check_color(add_pane(s, 0, 0, 0, 0)->albedo, reflectance, reflectance, reflectance);
    s->view.camera.position[2] = 1;
}

/* The colors of all pixels. */
static void check_pixels(const renderer *r, const check_scene *s, const double exact[3], const double tolerance[3]) {
    for (int i = 0; i < s->view.width * s->view.height; ++i)
        for (int c = 0; c < 3; ++c)
            if (!CHECK_NEAR((double)image[4 * i + c], exact[c], tolerance[c])) {
                printf("    %s, pixel %d, color %d\n", r->name, i, c);
                return;
            }
}

/* The same, where there are only polygons. */
static void check_exact(const renderer *r, const check_scene *s, const double exact[3]) {
    double tolerance[3];
    for (int c = 0; c < 3; ++c) tolerance[c] = EXACT * fmax(1, exact[c]);
    check_pixels(r, s, exact, tolerance);
}

#define EACH_RENDERER(test)                                                                                            \
    for (const renderer *r = renderers; r < renderers + RENDERERS; ++r) test(r)

/* ---------------------------------------------------------------------------------------------- what is seen through
 */

/* The background through a pane, and what it reflects of ambient light: color * ambient + T background. Coverage is
   1 - mean T, and depth that of the pane, along the ray. */
static void background_through(const renderer *r) {
    static const double T[3][3] = {{0.5, 0.5, 0.5}, {0.25, 0.75, 0}, {1, 1, 1}};
    for (int n = 0; n < 3; ++n)
        for (int perspective = 0; perspective < 2; ++perspective) {
            const double exact[3] = {0.1 * 0.5 + T[n][0] * 1, 0.2 * 0.25 + T[n][1] * 2, 0.3 * 0.125 + T[n][2] * 4};
            const double taken = 1 - (T[n][0] + T[n][1] + T[n][2]) / 3;
            check_scene s;
            start(&s, 5, 4);
            check_perspective(&s.view.camera, perspective ? 0.8 : 0);
            check_color(add_pane(&s, 3, T[n][0], T[n][1], T[n][2])->albedo, 0.1, 0.2, 0.3);
            check_color(s.scene.ambient, 0.5, 0.25, 0.125);
            check_color(s.scene.background, 1, 2, 4);
            if (!render_into(r, &s, image)) return;
            check_exact(r, &s, exact);
            for (int i = 0; i < 20; ++i) {
                const double pitch = 2 * tan(0.4) / 4, x = (i % 5 - 2) * pitch, y = (1.5 - i / 5) * pitch;
                const double away = 7 * (perspective ? sqrt(1 + x * x + y * y) : 1);
                CHECK_NEAR((double)image[4 * i + 3], taken, EXACT);
                CHECK_NEAR((double)depths[i], taken > 0 ? away : HUGE_VAL, 7 * EXACT);
            }
        }
}
static void test_background_through(void) { EACH_RENDERER(background_through); }

/* Each pane is a layer of each pixel that it covers, the last pixel too. */
static void test_layers_counted(void) {
    for (int panes = 1; panes < 4; ++panes) {
        check_scene s;
        sps_image into;
        sps_stats_report stats;
        start(&s, 5, 3);
        for (int n = 0; n < panes; ++n) add_pane(&s, -n, 0.5, 0.5, 0.5);
        memset(&into, 0, sizeof into);
        into.rgba = image;
        CHECK_OK(context, sps_render(context, &s.scene, &s.view, &into));
        sps_get_stats(context, &stats);
        CHECK(stats.layers == (uint64_t)(15 * panes));
    }
}

/* Three panes before a background, in any order, or all in one place: the product of their transmittances. With a
   reflectance each, in order: s0 + T0 (s1 + T1 (s2 + T2 B)). Depth: the mean of the panes', weighted by the mean over
   the colors of what each takes away. */
static void panes_in_order(const renderer *r) {
    static const double T[3][3] = {{0.5, 0.9, 1}, {0.8, 0.25, 0.7}, {0.3, 0.6, 0.4}};
    static const int orders[7][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}, {0, 0, 0}};
    for (int n = 0; n < 7; ++n)
        for (int reflects = 0; reflects < (n < 6 ? 2 : 1); ++reflects) {
            double exact[3] = {0, 0, 0}, through[3] = {1, 1, 1}, distance = 0, taken = 0;
            check_scene s;
            start(&s, 3, 3);
            check_color(s.scene.background, 1, 2, 3);
            check_color(s.scene.ambient, 1, 1, 1);
            for (int k = 0; k < 3; ++k) {
                sps_mesh *mesh = add_pane(&s, orders[n][k], T[k][0], T[k][1], T[k][2]);
                for (int c = 0; c < 3; ++c) mesh->albedo[c] = (float)(reflects * 0.1 * (k + c + 1));
            }
            for (int place = 2; place >= 0; --place) /* from the eye on */
                for (int k = 0; k < 3; ++k) {
                    double before = 0;
                    if (orders[n][k] != place) continue;
                    for (int c = 0; c < 3; ++c) {
                        before += through[c] * (1 - T[k][c]) / 3;
                        exact[c] += through[c] * (double)s.mesh[k].albedo[c];
                        through[c] *= T[k][c];
                    }
                    taken += before;
                    distance += before * (10 - place);
                }
            for (int c = 0; c < 3; ++c) exact[c] += through[c] * (c + 1);
            if (!render_into(r, &s, image)) return;
            check_exact(r, &s, exact);
            for (int i = 0; i < 9; ++i) {
                CHECK_NEAR((double)image[4 * i + 3], taken, EXACT);
                CHECK_NEAR((double)depths[i], distance / taken, 10 * EXACT);
            }
        }
}
static void test_panes_in_order(void) { EACH_RENDERER(panes_in_order); }

/* 200 panes: T^200 of the background, and (1 - T^200) / (1 - T) times what each adds. */
static void many_panes(const renderer *r) {
    const double T = 0.98, all = pow((double)(float)T, 200), sum = 0.01 * (1 - all) / (1 - T) + all;
    const double exact[3] = {sum, sum, sum}, tolerance[3] = {200 * 6e-8, 200 * 6e-8, 200 * 6e-8};
    check_scene s;
    start(&s, 2, 2);
    for (int i = 0; i < 200; ++i) add_square(&lists[0], 50, 5 - (i * 37 % 200) / 20.0); /* unordered */
    check_color(add_mesh(&s, T, T, T)->albedo, 0.01, 0.01, 0.01);
    check_color(s.scene.ambient, 1, 1, 1);
    check_color(s.scene.background, 1, 1, 1);
    if (!render_into(r, &s, image)) return;
    check_pixels(r, &s, exact, tolerance);
    for (int i = 0; i < 4; ++i) CHECK_NEAR((double)image[4 * i + 3], 1 - all, 200 * 6e-8);
}
static void test_many_panes(void) { EACH_RENDERER(many_panes); }

/* An opaque polygon hides the panes behind it, and a pane nearer than near_distance is not seen, nor one behind the
   eye. */
static void hidden_panes(const renderer *r) {
    static const double exact[3] = {0.5 * 0.25, 0.5 * 0.5, 0.5 * 0.125};
    check_scene s;
    start(&s, 3, 3);
    add_pane(&s, 2, 0.5, 0.5, 0.5);
    check_color(add_pane(&s, 1, 0, 0, 0)->albedo, 0.25, 0.5, 0.125);
    check_color(add_pane(&s, 0, 0.5, 0.5, 0.5)->albedo, 1, 1, 1);
    add_square(&lists[3], 50, 9.5);
    add_square(&lists[3], 50, 11);
    check_color(add_mesh(&s, 0.1, 0.1, 0.1)->albedo, 1, 1, 1);
    s.view.near_distance = 0.75;
    check_color(s.scene.ambient, 1, 1, 1);
    if (!render_into(r, &s, image)) return;
    check_exact(r, &s, exact);
    for (int i = 0; i < 9; ++i) CHECK(image[4 * i + 3] == 1);
}
static void test_hidden_panes(void) { EACH_RENDERER(hidden_panes); }

/* Writes color and emission by the point's height, which tells the layers apart. */
static int shade_by_height(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    *(size_t *)user += count;
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) {
            out[i].albedo[c] = (float)(0.1 * points[i].position[2]);
            out[i].emission[c] = (float)(c * points[i].position[2]);
        }
    return 0;
}

/* Textures of every layer: each adds through * (color + emission) under ambient light of 1. In the right half of the
   view, an opaque one hides the last. Every one that is seen is shaded once. */
static void textured_layers(const renderer *r) {
    const double origin[3] = {0, -50, 1.5}, u[3] = {50, 0, 0}, v[3] = {0, 100, 0};
    double exact[2][3];
    size_t points = 0;
    check_scene s;
    start(&s, 4, 3);
    for (int z = 1; z < 4; ++z) add_square(&lists[0], 50, z);
    add_mesh(&s, 0.5, 0.25, 0.75);
    check_add_quad(&lists[1], origin, u, v);
    add_mesh(&s, 0, 0, 0);
    for (int k = 0; k < 2; ++k) {
        s.mesh[k].shade_fn = shade_by_height;
        s.mesh[k].shade_user = &points;
    }
    check_color(s.scene.ambient, 1, 1, 1);
    for (int c = 0; c < 3; ++c) {
        const double T = (double)s.mesh[0].transmittance[c], each = 0.1 + c;
        exact[0][c] = each * (3 + T * (2 + T * 1));
        exact[1][c] = each * (3 + T * (2 + T * 1.5));
    }
    if (!render_into(r, &s, image)) return;
    for (int i = 0; i < 12; ++i)
        for (int c = 0; c < 3; ++c) CHECK_NEAR((double)image[4 * i + c], exact[i % 4 / 2][c], 10 * EXACT);
    CHECK(points == 3 * 12);
}
static void test_textured_layers(void) { EACH_RENDERER(textured_layers); }

/* -------------------------------------------------------------------------------------------------- light that passes
 */

/* Ground under panes: T irradiance per color, T being their product, whatever their order and the kind of light. */
static void shadows_on_ground(const renderer *r) {
    static const double T[3][3] = {{0.5, 0.9, 1}, {0.8, 0.25, 0.7}, {0.3, 0.6, 0.4}};
    for (int count = 0; count <= 3; ++count)
        for (int kind = 0; kind < 3; ++kind) {
            const int same = kind == 2; /* all in one place */
            check_scene s;
            start(&s, 7, 5);
            add_ground(&s, 0.5);
            for (int k = 0; k < count; ++k) add_pane(&s, same ? 3 : 2 + (k + kind) % 3, T[k][0], T[k][1], T[k][2]);
            if (kind == 1)
                check_add_point(&s, 0.3, -0.2, 8, 64);
            else
                check_add_directional(&s, 1, 0.5, -2, 4);
            check_color(s.scene.ambient, 0.5, 0.25, 0.125);
            if (!render_into(r, &s, image)) return;
            for (int i = 0; i < 35; ++i) {
                const double x = (i % 7 - 3) * 0.2 - 0.3, y = (2 - i / 7) * 0.2 + 0.2, square = x * x + y * y + 64;
                const double light = kind == 1 ? 64 * 8 / (square * sqrt(square)) : 4 * 2 / sqrt(5.25);
                for (int c = 0; c < 3; ++c) {
                    double through = 1;
                    for (int k = 0; k < count; ++k) through *= T[k][c];
                    const double exact = 0.5 * (light / PI * through + (double)s.scene.ambient[c]);
                    if (!CHECK_CASE("Shadows", "ground below up to three panes, of transmittance 1/2 and others",
                                    "the product of transmittances", fabs((double)image[4 * i + c] - exact), 2 * EXACT,
                                    "a few roundings of floats"))
                        printf("    %s, %d panes, kind %d, pixel %d\n", r->name, count, kind, i);
                }
            }
        }
}
static void test_shadows_on_ground(void) { EACH_RENDERER(shadows_on_ground); }

/* A pane reflects light of its eye's side only, lets pass that of both, and never shades itself; opaque polygons behind
   one hide the light. */
static void sides_of_a_pane(const renderer *r) {
    for (int side = 0; side < 2; ++side)
        for (int blocked = 0; blocked < 2; ++blocked) {
            const double cosine = 2 / sqrt(5.0), T[3] = {0.5, 0.25, 0.75};
            double exact[3];
            check_scene s;
            start(&s, 3, 3);
            check_color(add_pane(&s, 1, T[0], T[1], T[2])->albedo, 0.25, 0.5, 0.125);
            check_color(add_pane(&s, -1, 0, 0, 0)->albedo, 0.5, 0.5, 0.5);
            if (blocked) add_pane(&s, 11, 0, 0, 0); /* behind the camera */
            check_add_directional(&s, 1, 0, side ? -2 : 2, 4);
            for (int c = 0; c < 3; ++c) {
                const double light = side && !blocked ? 4 / PI * cosine : 0;
                exact[c] = light * ((double)s.mesh[0].albedo[c] + T[c] * 0.5 * T[c]);
            }
            if (!render_into(r, &s, image)) return;
            check_exact(r, &s, exact);
        }
}
static void test_sides_of_a_pane(void) { EACH_RENDERER(sides_of_a_pane); }

/* A pane's penumbra is a mixture: with transmittance T, light is that of an opaque pane, and T times what this one
   keeps off. The points of a light are the same in all three images. */
static void penumbra_of_a_pane(const renderer *r) {
    static const double T[3] = {0.5, 0.25, 0.75}, corner[3] = {0, -50, 3}, u[3] = {50, 0, 0}, v[3] = {0, 100, 0};
    float *const into[3] = {plain, dark, image};
    int partly = 0;
    check_scene s;
    for (int n = 0; n < 3; ++n) { /* without a pane, with an opaque one, and with the pane */
        sps_light *light;
        start(&s, 12, 8);
        add_ground(&s, 0.5);
        check_add_quad(&lists[1], corner, u, v);
        if (n > 0) add_mesh(&s, n == 2 ? T[0] : 0, n == 2 ? T[1] : 0, n == 2 ? T[2] : 0);
        light = check_add_light(&s, SPS_LIGHT_DISC, 100);
        check_set3(light->position, 0.05, 0, 8);
        check_set3(light->axes[0], 0.5, 0, 0);
        check_set3(light->axes[1], 0, 0.5, 0);
        if (!render_into(r, &s, into[n])) return;
    }
    for (int i = 0; i < 4 * 96; ++i) {
        const double all = (double)plain[i], least = (double)dark[i];
        if (i % 4 == 3) continue;
        partly += least > 0.1 * all && least < 0.9 * all;
        if (!CHECK_NEAR((double)image[i], least + T[i % 4] * (all - least), 2 * EXACT))
            printf("    %s, pixel %d\n", r->name, i / 4);
    }
    CHECK(partly > 20);
}
static void test_penumbra_of_a_pane(void) { EACH_RENDERER(penumbra_of_a_pane); }

/* A net of n x n squares of side 1/8 around (x, y) at height z, each cut along one diagonal or the other. */
static void add_net(check_triangles *net, int n, double x, double y, double z) {
    for (int i = 0; i < n * n; ++i) {
        const double a = x + (i % n - n / 2) * 0.125, b = y + (i / n - n / 2) * 0.125;
        const double corner[4][3] = {{a, b, z}, {a + 0.125, b, z}, {a + 0.125, b + 0.125, z}, {a, b + 0.125, z}};
        const int turn = (i * 7 + i / n) % 2;
        check_add_corners(net, corner[turn], corner[turn + 1], corner[turn + 2]);
        check_add_corners(net, corner[turn], corner[turn + 2], corner[(turn + 3) % 4]);
    }
}

/* A ray through an edge that triangles share, or through a corner, is filtered once by a net: one is between ground and
   eye, and light comes through that and another one. All coordinates are multiples of 1/32, so that rays hit edges,
   diagonals and corners exactly. */
static void shared_edges(const renderer *r) {
    static const double ways[5][3] = {{0, 0, -1}, {0.5, 0, -1}, {-0.25, 0.5, -1}, {0.5, 0.5, -1}, {-0.5, 0.25, -1}};
    for (int n = 0; n < 6; ++n) { /* 5: a point light */
        const double *way = ways[n % 5];
        check_scene s;
        start(&s, 16, 16);
        check_orthographic(&s.view.camera, 1);
        check_set3(s.view.camera.position, 1.0 / 32, 1.0 / 32, 1);
        check_set3(s.view.camera.target, 1.0 / 32, 1.0 / 32, 0);
        add_square(&lists[0], 8, 0);
        check_color(add_mesh(&s, 0, 0, 0)->albedo, 0.5, 0.5, 0.5);
        add_net(&lists[1], 16, -2 * way[0], -2 * way[1], 2);
        add_mesh(&s, 0.5, 0.25, 0.75);
        add_net(&lists[2], 24, 0, 0, 0.5);
        add_mesh(&s, 0.75, 0.5, 0.25);
        if (n < 5)
            check_add_directional(&s, way[0], way[1], way[2], 4);
        else
            check_add_point(&s, 0, 0, 4, 64);
        if (!render_into(r, &s, image)) return;
        for (int i = 0; i < 256; ++i) {
            const double x = (i % 16 - 7) / 16.0, y = (8 - i / 16) / 16.0, square = x * x + y * y + 16;
            const double light = n < 5 ? 4 / vec_length(way) : 64 * 4 / (square * sqrt(square));
            const double seen[3] = {0.75 * 0.75 * 0.5, 0.5 * 0.5 * 0.25, 0.25 * 0.25 * 0.75}; /* eye: 1 net, light: 2 */
            for (int c = 0; c < 3; ++c)
                if (!CHECK_NEAR((double)image[4 * i + c], 0.5 * light / PI * seen[c], EXACT)) {
                    printf("    %s, light %d, pixel %d %d, color %d\n", r->name, n, i % 16, i / 16, c);
                    return;
                }
        }
    }
}
static void test_shared_edges(void) { EACH_RENDERER(shared_edges); }

/* A net seen from anywhere, in perspective or not, with a corner in the middle pixel, up to round-off: each ray passes
   it once. */
static void seen_edges(const renderer *r) {
    check_random random = {5};
    for (int n = 0; n < 100; ++n) {
        check_scene s;
        start(&s, 9, 9);
        add_net(&lists[0], 16, 0, 0, n % 3 * 0.5);
        add_mesh(&s, 0.5, 0.25, 0.75);
        for (int i = 0; i < 3; ++i) {
            const double at = n % 4 ? 2 * check_next(&random) - 1 : i == 1;
            s.view.camera.target[i] = i < 2 ? (n * (i + 3) % 9 - 4) * 0.125 : n % 3 * 0.5;
            s.view.camera.position[i] = s.view.camera.target[i] + (i < 2 ? at : 2 + n % 5);
        }
        check_orthographic(&s.view.camera, 9.0 / 16);
        check_perspective(&s.view.camera, n % 2 ? 0.125 : 0);
        check_color(s.scene.background, 1, 1, 1);
        if (!render_into(r, &s, image)) return;
        for (int i = 0; i < 81; ++i)
            for (int c = 0; c < 3; ++c)
                if (!CHECK((double)image[4 * i + c] == (double)s.mesh[0].transmittance[c])) {
                    printf("    %s, view %d, pixel %d %d: %g\n", r->name, n, i % 9, i / 9, (double)image[4 * i + c]);
                    return;
                }
    }
}
static void test_seen_edges(void) { EACH_RENDERER(seen_edges); }

/* A closed net whose corners lie anywhere, seen from within: whatever is inside is lit through it once, and the
   background is seen through it once. The light's color makes the ground 0.5, where its light comes straight down. */
static void closed_net(const renderer *r) {
    enum { N = 9 };
    for (int kind = 0; kind < 2; ++kind) {
        double corner[N + 1][2 * N][3];
        check_random random = {(uint64_t)(11 + kind)};
        const double exact[3] = {0.5 * 0.5, 0.25, 0.5 * 0.75};
        check_scene s;
        start(&s, 32, 32);
        for (int i = 0; i <= N; ++i)
            for (int j = 0; j < 2 * N; ++j) {
                const double radius = 3 + (i % N ? 0.4 * check_next(&random) : 0), down = PI * i / N;
                const double across = PI * j / N, wide = i % N ? sin(down) : 0;
                check_set3(corner[i][j], radius * wide * cos(across), radius * wide * sin(across), radius * cos(down));
            }
        for (int i = 0; i < N; ++i)
            for (int j = 0; j < 2 * N; ++j) {
                const int next = (j + 1) % (2 * N);
                if (i > 0) check_add_corners(&lists[0], corner[i][j], corner[i][next], corner[i + 1][j]);
                if (i < N - 1) check_add_corners(&lists[0], corner[i][next], corner[i + 1][next], corner[i + 1][j]);
            }
        add_mesh(&s, 0.5, 1, 0.75);
        check_set3(s.view.camera.position, 0, 0, 0.5);
        check_perspective(&s.view.camera, 2.2);
        add_square(&lists[1], 0.875, 0);
        check_color(add_mesh(&s, 0, 0, 0)->albedo, 0.5, 0.5, 0.5);
        check_color(s.scene.background, 0.5, 0.25, 0.5);
        if (kind)
            check_add_directional(&s, 0.3, 0.2, -1, PI * sqrt(1.13));
        else
            check_add_point(&s, 0.7, 0.9, 30, PI)->falloff = SPS_FALLOFF_NONE;
        if (!render_into(r, &s, image)) return;
        for (int i = 0; i < 1024; ++i)
            for (int c = 0; c < 3; ++c) {
                const double T = (double)s.mesh[0].transmittance[c];
                const double x = (i % 32 - 15.5) / 16 * tan(1.1) * 0.5, y = (15.5 - i / 32) / 16 * tan(1.1) * 0.5;
                const int ground = fabs(x) <= 0.875 && fabs(y) <= 0.875;
                const double square = (0.7 - x) * (0.7 - x) + (0.9 - y) * (0.9 - y) + 900;
                const double lit = kind ? 0.5 : 30 / sqrt(square) * 0.5;
                if (!CHECK_NEAR((double)image[4 * i + c], ground ? lit * T : exact[c], EXACT)) {
                    printf("    %s, light %d, pixel %d %d, color %d\n", r->name, kind, i % 32, i / 32, c);
                    return;
                }
            }
    }
}
static void test_closed_net(void) { EACH_RENDERER(closed_net); }

/* ------------------------------------------------------------------------------------------------------ amid gas */

enum { ACROSS = 24, LAYERS = 40 }; /* voxels of the fog, of 0.1; rays pass at least 7 voxels from its sides */

/* Fog of optical depth tau along z, from z = -2 to 2, where it fades out. */
static sps_volume *add_fog(check_scene *s, double tau) {
    sps_volume *fog = check_add_volume(s, ACROSS, ACROSS, LAYERS, check_box(-1.2, -1.2, -2, 1.2, 1.2, 2));
    fog->read_fn = check_read_constant;
    fog->user = &one;
    fog->extinction = (float)(tau / (0.1 * LAYERS));
    return fog;
}

/* A pane in the middle of fog: each side has half of the fog's optical depth, tau. Ambient light and emission add
   S (1 - e^-tau), where S is what is sent per unit of optical depth, however fog is distributed along the ray. */
static double glow_of_halves(double tau, double S, double surface, double T, double background) {
    const double half = S * -expm1(-tau), passes = exp(-tau);
    return half + passes * (surface + T * (half + passes * background));
}

static void glowing_fog(const renderer *r) {
    static const double T[3] = {0.5, 0.25, 0.75};
    double exact[3], slack[3];
    check_scene s;
    start(&s, 4, 4);
    {
        sps_volume *fog = add_fog(&s, 1.5);
        check_color(fog->albedo, 0.5, 0.25, 1);
        check_color(fog->emission, 0.1, 0.3, 0.2);
        check_color(add_pane(&s, 0, T[0], T[1], T[2])->albedo, 0.5, 0.25, 0.125);
        check_color(s.scene.ambient, 0.5, 0.25, 0.5);
        check_color(s.scene.background, 1, 2, 3);
        for (int c = 0; c < 3; ++c) {
            const double S = (double)(fog->albedo[c] * s.scene.ambient[c] + fog->emission[c] / fog->extinction);
            const double surface = (double)(s.mesh[0].albedo[c] * s.scene.ambient[c]);
            exact[c] = glow_of_halves(0.75, S, surface, T[c], c + 1);
            slack[c] = fabs(glow_of_halves(0.75 * (1 + r->ripple), S, surface, T[c], c + 1) - exact[c]) + EXACT;
        }
    }
    if (!render_into(r, &s, image)) return;
    check_pixels(r, &s, exact, slack);
}
static void test_glowing_fog(void) { EACH_RENDERER(glowing_fog); }

/* The same lit along the eye's rays, from the eye's side or from the other one; times albedo, phase function and
   irradiance. Light from the eye's side: the integral of e^-2t from 0 to tau for each half, the farther one filtered
   twice. Light from the other side: e^-(2 tau) at every depth t, and in both halves it is filtered once in all. */
static double lit_halves(double tau, int behind, double T) {
    if (behind) return 2 * tau * exp(-2 * tau) * T;
    return -expm1(-2 * tau) / 2 * (1 + exp(-2 * tau) * T * T);
}

/* Errors other than ripple: with steps of a quarter of a voxel, which have an optical depth of k = 1.5 / 40 / 4 for the
   eye and as much for the light, the midpoint rule for e^-2t is (2 k)^2 / 24 = 1.5e-5 off, relatively; likewise half of
   it for shadow rays. Where a shadow ray has a number of steps of its own, it begins within f(p) that is even, so that
   no more is added. sps_render's slabs, of half a voxel, have closed forms for fog that is even. */
static void lit_fog(const renderer *r) {
    static const double T[3] = {0.5, 0.25, 0.75};
    for (int behind = 0; behind < 2; ++behind) {
        double exact[3], slack[3];
        check_scene s;
        start(&s, 3, 3);
        check_color(add_fog(&s, 1.5)->albedo, 1, 1, 1);
        add_pane(&s, 0, T[0], T[1], T[2]);
        check_add_directional(&s, 0, 0, behind ? 1 : -1, 4 * PI);
        for (int c = 0; c < 3; ++c) {
            exact[c] = lit_halves(0.75, behind, T[c]);
            slack[c] = fabs(lit_halves(0.75 * (1 + r->ripple), behind, T[c]) - exact[c]) + 3e-5 * exact[c] + EXACT;
        }
        if (!render_into(r, &s, image)) return;
        check_pixels(r, &s, exact, slack);
    }
}
static void test_lit_fog(void) { EACH_RENDERER(lit_fog); }

/* Thin fog that is lit from the side, and only before a pane: the pane takes none of that away, though slabs are lit in
   part as wholes. What is lit behind the pane, 0.02 of 2, and half of it taken away, is 0.005. A slab of four voxels is
   0.57 long along the eye's rays, where the edge of a shadow is found in quarters: half of an eighth may be lost, 0.018
   of 2. Fog is as even as kernels add up. */
static void lit_before_a_pane(const renderer *r) {
    static const double corner[3] = {-3, -50, -50}, u[3] = {0, 100, 0}, v[3] = {0, 0, 50};
    float *const into[2] = {plain, image};
    double share = 0;
    check_scene s;
    for (int n = 0; n < 2; ++n) {
        start(&s, 8, 1);
        s.view.slab_thickness = 4, s.view.camera.ortho_height = 0.2;
        check_color(add_fog(&s, 0.05)->albedo, 1, 1, 1);
        check_add_directional(&s, 1, 0, 0, 10);
        check_add_quad(&lists[0], corner, u, v);
        add_mesh(&s, 0, 0, 0);
        if (n > 0) add_pane(&s, 0.02, 0.5, 0.5, 0.5);
        if (!render_into(r, &s, into[n])) return;
    }
    for (int i = 0; i < 8; ++i) share += (double)image[4 * i] / (double)plain[4 * i] / 8;
    CHECK_NEAR(share, 1, 0.005 + 0.009 + r->ripple);
}
static void test_lit_before_a_pane(void) { EACH_RENDERER(lit_before_a_pane); }

/* A pane between thin fog and a disc that lights it from the side: the edge's penumbra is 2 * 0.5 * 3 / 5 = 0.6 wide in
   the fog's middle, of the 2 that the view is high, so that some of its 24 rows are lit in part. The middle of light
   would cast an edge of a texel. The reference casts a ray per step and point, so that both are few. */
static void penumbra_in_fog(const renderer *r) {
    static const double corner[3] = {-3, 0, -50}, u[3] = {0, 50, 0}, v[3] = {0, 0, 100};
    float *const into[2] = {plain, image};
    int partly = 0;
    check_scene s;
    for (int n = 0; n < 2; ++n) {
        sps_volume *fog;
        sps_light *light;
        start(&s, 1, 24);
        fog = add_fog(&s, 0.05);
        for (int k = 0; k < 3; ++k) fog->size[k] /= 2;
        check_color(fog->albedo, 1, 1, 1);
        check_add_quad(&lists[0], corner, u, v);
        if (n > 0) add_mesh(&s, 0.5, 0.5, 0.5);
        light = check_add_light(&s, SPS_LIGHT_DISC, 100);
        light->samples = 16;
        check_set3(light->position, -8, 0, 0);
        check_set3(light->axes[0], 0, 0.5, 0);
        check_set3(light->axes[1], 0, 0, 0.5);
        s.view.camera.ortho_height = 2;
        if (!render_into(r, &s, into[n])) return;
    }
    for (int i = 0; i < 24; ++i) {
        const double lit = (double)image[4 * i] / (double)plain[4 * i];
        partly += lit > 0.55 && lit < 0.95;
    }
    CHECK(partly >= 4);
    CHECK_NEAR((double)image[0], 0.5 * (double)plain[0], 0.01 * (double)plain[0]);
    CHECK_NEAR((double)image[4 * 23], (double)plain[4 * 23], 0.01 * (double)plain[4 * 23]);
}
static void test_penumbra_in_fog(void) { EACH_RENDERER(penumbra_in_fog); }

/* Two panes between fog and the sun: the fog's light is the product of what each lets pass times what it is without
   them, up to some roundings of floats. */
static void panes_before_fog(const renderer *r) {
    static const double corners[2][3] = {{-3, -50, -50}, {-4, -50, -50}}, u[3] = {0, 100, 0}, v[3] = {0, 0, 100};
    float *const into[2] = {plain, image};
    check_scene s;
    for (int n = 0; n < 2; ++n) {
        sps_volume *fog;
        start(&s, 1, 1);
        fog = add_fog(&s, 0.05);
        for (int k = 0; k < 3; ++k) fog->size[k] /= 2;
        check_color(fog->albedo, 1, 1, 1);
        for (int k = 0; k < 2; ++k) check_add_quad(&lists[k], corners[k], u, v);
        if (n > 0) add_mesh(&s, 0.5, 0.5, 0.5), add_mesh(&s, 0.2, 0.4, 0.8);
        check_set3(check_add_light(&s, SPS_LIGHT_DIRECTIONAL, 1)->direction, 1, 0, 0);
        s.view.camera.ortho_height = 1;
        if (!render_into(r, &s, into[n])) return;
    }
    for (int c = 0; c < 3; ++c)
        CHECK_NEAR((double)image[c], 0.5 * 0.2 * (1 << c) * (double)plain[c], 2e-6 * (double)plain[c]);
    CHECK(plain[0] > 0);
}
static void test_panes_before_fog(void) { EACH_RENDERER(panes_before_fog); }

/* Fog of extinction sigma in front of polygons k = 0..2, which are `away[k]` from the eye and let T[k] pass: the color
   behind the first k parts of the fog adds surface[k], and the fog S (1 - e^-tau). *distance: mean distance of what is
   taken away, of one color; a part of length L from distance d on has d (1 - e^-tau) + (1 - e^-tau (1 + tau)) /
   sigma. */
static double fog_and_polygons(double sigma, const double away[3], const double T[3], const double surface[3], double S,
                               double *distance) {
    double color = 0, through = 1;
    *distance = 0;
    for (int k = 0; k < 3; ++k) {
        const double start = k > 0 ? away[k - 1] : 0, tau = sigma * (away[k] - start);
        color += through * S * -expm1(-tau);
        *distance += through * (start * -expm1(-tau) + (1 - exp(-tau) * (1 + tau)) / sigma);
        through *= exp(-tau);
        color += through * surface[k];
        *distance += through * (1 - T[k]) * away[k];
        through *= T[k];
    }
    return color;
}

/* The eye is in the fog, before two panes and an opaque polygon. Inside the fog, ripple along a ray adds 4.8e-4 / (2
   pi) of a voxel at each end of a part, relatively less than 4e-5 of any part. Distance is that of the middle of a
   step, or slab, h <= 0.05: the mean is sigma h^2 / 12 = 1.1e-4 before it. */
static void eye_in_fog(const renderer *r) {
    static const double T[3][3] = {{0.5, 0.25, 0.75}, {0.9, 0.6, 0.3}, {0, 0, 0}}, away[3] = {0.5, 1.5, 2.5};
    double exact[3], slack[3], mean[2] = {0, 0};
    check_scene s;
    start(&s, 3, 3);
    {
        sps_volume *fog = add_fog(&s, 2);
        check_color(fog->albedo, 0, 0, 0);
        check_color(fog->emission, 0.5, 0.25, 1);
        s.view.slab_thickness = 0.5; /* that of high quality, however wide pixels are */
        check_set3(s.view.camera.position, 0, 0, 1);
        for (int k = 0; k < 3; ++k)
            check_color(add_pane(&s, 1 - away[k], T[k][0], T[k][1], T[k][2])->albedo, 0.25, 0.125 * k, 0.5);
        check_color(s.scene.ambient, 2, 1, 1);
        for (int c = 0; c < 3; ++c) {
            const double S = (double)(fog->emission[c] / fog->extinction), t[3] = {T[0][c], T[1][c], T[2][c]};
            double surface[3], distance, change;
            for (int k = 0; k < 3; ++k) surface[k] = (double)(s.mesh[k].albedo[c] * s.scene.ambient[c]);
            exact[c] = fog_and_polygons(0.5, away, t, surface, S, &distance);
            mean[0] += distance / 3;
            change = fog_and_polygons(0.5 * (1 + r->ripple), away, t, surface, S, &distance) - exact[c];
            mean[1] += distance / 3;
            slack[c] = fabs(change) + 4e-5 * exact[c] + EXACT;
        }
    }
    if (!render_into(r, &s, image)) return;
    check_pixels(r, &s, exact, slack);
    for (int i = 0; i < 9; ++i) {
        CHECK_NEAR((double)image[4 * i + 3], 1, EXACT);
        CHECK_NEAR((double)depths[i], mean[0], fabs(mean[1] - mean[0]) + 4e-5 + 1.1e-4);
    }
}
static void test_eye_in_fog(void) { EACH_RENDERER(eye_in_fog); }

/* Gas that only absorbs, in two volumes, between three polygons: s0 + T0 e^-a (s1 + T1 e^-b s2). */
static double layered(double a, double b, const double surface[3], const double T[2]) {
    return surface[0] + T[0] * exp(-a) * (surface[1] + T[1] * exp(-b) * surface[2]);
}

static void gas_between_panes(const renderer *r) {
    static const double reflectance[3][3] = {{0.1, 0.2, 0}, {0.2, 0.1, 0.3}, {0.5, 0.9, 0.7}};
    static const double T[2][3] = {{0.5, 0.8, 0.9}, {0.7, 0.3, 0.6}};
    double exact[3], slack[3];
    check_scene s;
    start(&s, 3, 3);
    s.view.filling = SPS_FILLING_SPLAT; /* levels spread gas over a pixel, here 0.7, and so behind what is near it */
    for (int k = 0; k < 2; ++k) {       /* they fade out within 3.3 voxels, before z = 0, 1.5 and 3 */
        sps_volume *gas = check_add_volume(&s, ACROSS, ACROSS, 8, check_box(-1.2, -1.2, 0.35, 1.2, 1.2, 1.15));
        gas->placement.origin[2] += 1.5 * (1 - k);
        gas->read_fn = check_read_constant;
        gas->user = &one;
        gas->extinction = (float)((k ? 0.7 : 0.4) / 0.8);
    }
    for (int k = 0; k < 3; ++k) {
        sps_mesh *mesh = add_pane(&s, 3 - 1.5 * k, k < 2 ? T[k][0] : 0, k < 2 ? T[k][1] : 0, k < 2 ? T[k][2] : 0);
        check_color(mesh->albedo, reflectance[k][0], reflectance[k][1], reflectance[k][2]);
    }
    check_color(s.scene.ambient, 1, 1, 1);
    for (int c = 0; c < 3; ++c) {
        const double surface[3] = {reflectance[0][c], reflectance[1][c], reflectance[2][c]}, t[2] = {T[0][c], T[1][c]};
        const double more = 1 + r->ripple;
        exact[c] = layered(0.4, 0.7, surface, t);
        slack[c] = fabs(layered(0.4 * more, 0.7 * more, surface, t) - exact[c]) + EXACT;
    }
    if (!render_into(r, &s, image)) return;
    check_pixels(r, &s, exact, slack);
}
static void test_gas_between_panes(void) { EACH_RENDERER(gas_between_panes); }

/* ------------------------------------------------------------------------------------------------ edges of polygons */

/* Area of the part of a pixel, of side 1 about (x, y), where x c + y s < 0: the pixel's corners, clipped. */
static double covered_area(double x, double y, double c, double s) {
    double at[4][2], clipped[8][2], area = 0;
    int count = 0;
    for (int i = 0; i < 4; ++i) at[i][0] = x + (i == 1 || i == 2) - 0.5, at[i][1] = y + (i >= 2) - 0.5;
    for (int i = 0; i < 4; ++i) {
        const double *a = at[i], *b = at[(i + 1) % 4], p = a[0] * c + a[1] * s, q = b[0] * c + b[1] * s;
        if (p < 0) memcpy(clipped[count++], a, sizeof at[0]);
        if ((p < 0) == (q < 0)) continue;
        for (int k = 0; k < 2; ++k) clipped[count][k] = a[k] + p / (p - q) * (b[k] - a[k]);
        ++count;
    }
    for (int i = 0; i < count; ++i) {
        const double *a = clipped[i], *b = clipped[(i + 1) % count];
        area += 0.5 * (a[0] * b[1] - a[1] * b[0]);
    }
    return area;
}

/* A straight edge at any angle: each pixel's coverage is the area, to 1 / 2N + 1 / 4N^2, which is less than 1 / N. For
   the samples of one line, 1 / N apart and half of that from the pixel's sides, along the axis on which the edge is
   steeper count the covered length to half of their distance, 1 / 2N. The lengths on N such lines, times 1 / N, sum up
   to the area by the midpoint rule, which is exact where length is linear across, and off by 1 / 8N^2 at each of two
   places where it bends to 0 or 1, since its slope is 1 at most. The color is the mean of both sides'. */
static void straight_edge(const renderer *r) {
    static const int sides[] = {0, 1, 2, 3, 4, 5, 8};
    for (int n = 0; n < 7; ++n)
        for (int turn = 0; turn < 24; ++turn) {
            const int N = sides[n] > 1 ? sides[n] : 1;
            const double angle = 2 * PI * (turn + 0.1 * n) / 24, c = cos(angle), s_ = sin(angle);
            const double tolerance = 0.5 / N + 0.25 / N / N + EXACT;
            const double middle[3] = {0.1, 0.2, 0}, T = turn % 2 ? 0.5 : 0;
            double origin[3], u[3] = {40 * s_, -40 * c, 0}, v[3] = {-20 * c, -20 * s_, 0};
            check_scene s;
            start(&s, 12, 12);
            check_orthographic(&s.view.camera, 12);
            s.view.coverage_samples = sides[n];
            vec_along(middle, u, -0.5, origin);
            check_add_quad(&lists[0], origin, u, v);
            check_color(add_mesh(&s, T, T, T)->albedo, 0.75, 0.5, 0.25);
            check_color(s.scene.ambient, 1, 1, 1);
            check_color(s.scene.background, 1, 2, 3);
            if (!render_into(r, &s, image)) return;
            for (int i = 0; i < 144; ++i) {
                const double area = covered_area(i % 12 - 5.5 - 0.1, 5.5 - i / 12 - 0.2, c, s_);
                const double share = (double)image[4 * i + 3] / (1 - T);
                if (!CHECK_NEAR(share, area, tolerance)) {
                    printf("    %s, N = %d, turn %d, pixel %d\n", r->name, sides[n], turn, i);
                    return;
                }
                for (int k = 0; k < 3; ++k)
                    CHECK_NEAR((double)image[4 * i + k],
                               share * (0.75 - 0.25 * k + T * (k + 1)) + (1 - share) * (k + 1), 3 * EXACT);
                CHECK_NEAR((double)depths[i], share > 0 ? 10 : HUGE_VAL, 10 * EXACT);
            }
        }
}
static void test_straight_edge(void) { EACH_RENDERER(straight_edge); }

/* An edge between halves of one plane whose colors differ in a single channel: by area, as above, in that one, and not
   at all in the others. */
static void colored_edge(const renderer *r) {
    for (int n = 0; n < 12; ++n) {
        const int N = n % 2 ? 4 : 8, channel = n / 2 % 3;
        const double angle = 2 * PI * (n + 0.3) / 12, c = cos(angle), s_ = sin(angle);
        check_scene s;
        start(&s, 12, 12);
        check_orthographic(&s.view.camera, 12);
        s.view.coverage_samples = N;
        for (int half = -1; half <= 1; half += 2) { /* beyond the edge, and before it */
            const double origin[3] = {0.1 - 20 * s_, 0.2 + 20 * c, 0}, u[3] = {40 * s_, -40 * c, 0};
            const double v[3] = {half * 20 * c, half * 20 * s_, 0};
            check_add_quad(&lists[0], origin, u, v);
            for (int i = 0; i < 6; ++i) {
                float *color = lists[0].list[lists[0].count - 1 - (size_t)(i / 3)].albedo[i % 3];
                check_color(color, 0.5, 0.5, 0.5);
                color[channel] = half < 0 ? 0.9f : 0.3f;
            }
        }
        add_mesh(&s, 0, 0, 0)->has_albedos = 1;
        check_color(s.scene.ambient, 1, 1, 1);
        if (!render_into(r, &s, image)) return;
        for (int i = 0; i < 144; ++i) {
            const double area = covered_area(i % 12 - 5.5 - 0.1, 5.5 - i / 12 - 0.2, c, s_);
            for (int k = 0; k < 3; ++k)
                CHECK_NEAR((double)image[4 * i + k], k == channel ? 0.3 + 0.6 * area : 0.5,
                           (k == channel) * 0.6 * (0.5 / N + 0.25 / N / N) + 3 * EXACT);
        }
    }
}
static void test_colored_edge(void) { EACH_RENDERER(colored_edge); }

/* With N x N samples, a pixel is the mean of the N x N pixels that an image of N times as many on each side has in its
   place: translucent and opaque polygons that cross each other; lit, and amid gas, where these are sampled too. Where
   they are not, what a polygon covers of one opaque surface behind it has that surface's mean depth: with half of it
   covered, off by a quarter of the surface's range of depths at most, of which translucent polygons let half show. And
   distances are along the ray through the pixel's centre: 10, times the angle of 0.16 to the image's corner, times half
   a pixel's diagonal of 0.015, is 0.024. */
static void finer_image(const renderer *r) {
    for (int n = 0; n < 6; ++n) {
        const int N = 2 + n % 3, lit = r->samples_all && n >= 3, perspective = n % 2;
        check_random random;
        check_scene s;
        float *const into[2] = {plain, image};
        static float fine_depths[PIXELS_MOST];
        if (!check_long() && lit && N > 2) continue; /* slow, and much like the others */
        for (int fine = 1; fine >= 0; --fine) {
            start(&s, fine ? 12 * N : 12, fine ? 10 * N : 10);
            s.view.coverage_samples = fine ? n % 2 : N;
            check_orthographic(&s.view.camera, 2);
            check_perspective(&s.view.camera, perspective ? 0.25 : 0);
            random.state = (uint64_t)n;
            for (int k = 0; k < 36; ++k) {
                double corner[3][3];
                for (int i = 0; i < 9; ++i) corner[i / 3][i % 3] = 2.6 * check_next(&random) - 1.3;
                check_add_corners(&lists[k / 12], corner[0], corner[1], corner[2]);
            }
            for (int k = 0; k < 3; ++k) {
                sps_mesh *mesh = add_mesh(&s, 0.4 * k, 0.3 * k, 0.45 * k);
                check_color(mesh->albedo, 0.2 * k, 0.5, 0.8 - 0.3 * k);
            }
            if (lit) check_color(add_fog(&s, 1)->albedo, 1, 1, 1);
            if (lit) s.volume[0].size[0] = s.volume[0].size[1] = s.volume[0].size[2] = 6;
            if (lit) check_add_point(&s, 1, 2, 4, 20);
            check_color(s.scene.ambient, 1, 0.5, 0.25);
            check_color(s.scene.background, 1, 2, 3);
            if (!render_into(r, &s, into[!fine])) return;
            if (fine) memcpy(fine_depths, depths, sizeof depths);
        }
        for (int i = 0; i < 120; ++i) {
            double mean[5] = {0, 0, 0, 0, 0}, least = HUGE_VAL, most = 0;
            for (int k = 0; k < N * N; ++k) {
                const int at = (i / 12 * N + k / N) * 12 * N + i % 12 * N + k % N;
                for (int c = 0; c < 4; ++c) mean[c] += (double)plain[4 * at + c] / (N * N);
                if (plain[4 * at + 3] > 0) least = fmin(least, (double)fine_depths[at]);
                if (plain[4 * at + 3] > 0) most = fmax(most, (double)fine_depths[at]);
                if (plain[4 * at + 3] > 0) mean[4] += (double)(plain[4 * at + 3] * fine_depths[at]) / (N * N);
            }
            for (int c = 0; c < 4; ++c)
                if (!CHECK_NEAR((double)image[4 * i + c], mean[c], 4 * EXACT)) {
                    printf("    %s, scene %d, pixel %d, channel %d\n", r->name, n, i, c);
                    return;
                }
            if (mean[3] > 0.01)
                CHECK_NEAR((double)depths[i], mean[4] / mean[3],
                           1e-4 + (r->samples_all ? 0 : 0.5 * (most - least) + perspective * 0.024));
        }
    }
}
static void test_finer_image(void) { EACH_RENDERER(finer_image); }

/* 0 and 1 are the same; other numbers than 0..8 are refused. */
static void number_of_samples(const renderer *r) {
    static const int wrong[] = {-1, 9, 1000};
    check_scene s;
    sps_image into;
    start(&s, 12, 10);
    add_square(&lists[0], 0.37, 0);
    check_color(add_mesh(&s, 0.5, 0.25, 0)->albedo, 0.5, 0.25, 0.125);
    check_color(s.scene.ambient, 1, 1, 1);
    if (!render_into(r, &s, plain)) return;
    s.view.coverage_samples = 1;
    if (!render_into(r, &s, image)) return;
    CHECK(memcmp(image, plain, 4 * 120 * sizeof *image) == 0);
    memset(&into, 0, sizeof into);
    into.rgba = image;
    for (int n = 0; n < 3; ++n) {
        s.view.coverage_samples = wrong[n];
        image[0] = -5;
        CHECK(r->run(&s, &into) == SPS_ERROR_ARGUMENT && image[0] <= -5);
        CHECK(check_error_info(context, SPS_ERROR_ARGUMENT) && strstr(sps_error(context), "view.coverage_samples"));
    }
}
static void test_number_of_samples(void) { EACH_RENDERER(number_of_samples); }

/* ---------------------------------------------------------------------------------------------------- repeatability */

/* Layers, a texture, gas and a light: the same bits with any number of workers, and in a region. */
static void same_bits(const renderer *r) {
    size_t points = 0;
    check_scene s;
    start(&s, 8, 6);
    check_color(add_fog(&s, 1)->albedo, 1, 1, 1);
    s.volume[0].size[0] = s.volume[0].size[1] = 6;
    s.volume[0].size[2] = 10;
    for (int k = 0; k < 3; ++k) add_square(&lists[0], 0.3 + 0.05 * k, 1 - 0.7 * k);
    add_mesh(&s, 0.5, 0.25, 0.75);
    s.mesh[0].shade_fn = shade_by_height;
    s.mesh[0].shade_user = &points;
    s.mesh[0].placement = check_box(0, 0, 3, 1, 1, 4);
    s.view.coverage_samples = 2;
    check_add_directional(&s, 0.3, 0.2, -1, 2);
    if (!render_into(r, &s, plain)) return;
    for (int workers = 1; workers < 4; workers += 2) {
        check_hooks hooks;
        sps_context *const usual = context;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = workers;
        hooks.order = (uint64_t)workers;
        context = check_context(&hooks);
        if (CHECK(context) && render_into(r, &s, image)) CHECK(memcmp(image, plain, 4 * 48 * sizeof *image) == 0);
        s.view.region[0] = 2;
        s.view.region[1] = 1;
        s.view.region[2] = 5;
        s.view.region[3] = 4;
        if (context && render_into(r, &s, image))
            for (int y = 0; y < 4; ++y)
                CHECK(memcmp(image + 4 * 5 * y, plain + 4 * (8 * (y + 1) + 2), 4 * 5 * sizeof *image) == 0);
        memset(s.view.region, 0, sizeof s.view.region);
        sps_destroy(context);
        CHECK(hooks.live == 0);
        context = usual;
    }
}
static void test_same_bits(void) { EACH_RENDERER(same_bits); }

/* A pane and a slab of voxels of the same transmittance cast the same shadow, on a ground and on fog in front of it:
   the slab's optical depth is that of a constant grid, off by 0.2 %, so that its transmittance T is off by T log(1 / T)
   / 500, 0.08 % of the light at most; fog, whose own light both share, is the same in both pictures except where slabs
   begin, less than 1 %. */
static void dense_stand_in(const renderer *r) {
    static const double T[3] = {0.5, 0.1, 0};
    for (int n = 0; n < 6; n += check_long() ? 1 : 2) {
        const double passes = T[n % 3];
        const int foggy = n / 3;
        float *const into[2] = {plain, image};
        double most = 0, worst = 0;
        for (int dense = 0; dense < 2; ++dense) {
            check_scene s;
            start(&s, 12, 10);
            check_perspective(&s.view.camera, 0.3);
            check_set3(s.view.camera.position, 0, -5, 1.2);
            check_set3(s.view.camera.target, 0, 0, 0.7);
            check_set3(s.view.camera.up, 0, 0, 1);
            add_square(&lists[0], 4, 0);
            check_color(add_mesh(&s, 0, 0, 0)->albedo, 0.5, 0.5, 0.5);
            check_add_directional(&s, 0, 0, -1, 4);
            if (foggy) {
                sps_volume *fog = check_add_volume(&s, 12, 12, 12, check_box(-0.6, -0.6, 0.2, 0.6, 0.6, 1.4));
                fog->read_fn = check_read_constant, fog->user = &one, fog->extinction = 0.5f;
                check_color(fog->albedo, 1, 1, 1);
            }
            if (dense) {
                sps_volume *slab = check_add_volume(&s, 48, 48, 5, check_box(-2.4, -2.4, 2, 2.4, 2.4, 2.5));
                slab->read_fn = check_read_constant, slab->user = &one;
                slab->extinction = (float)((passes > 0 ? -log(passes) : 50) / 0.5);
            } else {
                add_square(&lists[1], 2.4, 2);
                add_mesh(&s, passes, passes, passes);
            }
            if (!render_into(r, &s, into[dense])) return;
        }
        for (int i = 0; i < 4 * 120; ++i) {
            most = fmax(most, (double)plain[i]);
            worst = fmax(worst, fabs((double)(image[i] - plain[i])));
        }
        if (!CHECK_CASE("Shadows", "pane, and a slab of voxels of its transmittance, over ground and fog",
                        "the same picture", worst, 0.01 * (passes > 0 ? most : 1),
                        "ripple of the slab's depth, 0.08 %; where slabs of fog begin, 1 %"))
            printf("    %s, T %g, fog %d: %g of %g\n", r->name, passes, foggy, worst, most);
    }
}
static void test_dense_stand_in(void) { EACH_RENDERER(dense_stand_in); }

/* The square with middle m, of side 2 half, perpendicular to an axis. */
static void add_face_of_cube(check_triangles *list, int axis, double middle, double half) {
    double origin[3] = {-half, -half, -half}, u[3] = {0, 0, 0}, v[3] = {0, 0, 0};
    origin[axis] = middle;
    u[(axis + 1) % 3] = v[(axis + 2) % 3] = 2 * half;
    check_add_quad(list, origin, u, v);
}

/* A lamp in a small translucent cube amid even fog, whose light passes the cube once in every direction: also where two
   of the light's six faces meet, which the eye looks along. Fog of optical depth 0.4 across is off by its cut kernels,
   0.2 %, and by slabs, whose light is the mean of a few steps: below 1 %, or 2 % where slabs are twice as thick. */
static void test_seams(void) {
    for (int n = 0; n < 2; ++n) {
        const double height = n ? 0.1 : 0.3;
        check_scene s;
        sps_volume *fog;
        start(&s, 41, 3);
        check_orthographic(&s.view.camera, 0.0067);
        check_set3(s.view.camera.position, 3, 3, height);
        check_set3(s.view.camera.target, 0, 0, height);
        check_set3(s.view.camera.up, 0, 0, 1);
        fog = check_add_volume(&s, 16, 16, 16, check_box(-1, -1, -1, 1, 1, 1));
        fog->read_fn = check_read_constant, fog->user = &one, fog->extinction = 0.2f;
        check_color(fog->albedo, 1, 1, 1);
        for (int i = 0; i < 6; ++i) add_face_of_cube(&lists[0], i / 2, i % 2 ? 0.05 : -0.05, 0.05);
        add_mesh(&s, 0.1, 0.1, 0.1);
        check_add_point(&s, 0, 0, 0, 1);
        if (!render_into(&renderers[0], &s, plain)) return;
        for (int quality = SPS_QUALITY_DRAFT; quality <= SPS_QUALITY_HIGH; ++quality) {
            if (!check_long() && quality == SPS_QUALITY_MEDIUM) continue;
            s.view.quality = (sps_quality)quality;
            if (!render_into(&renderers[1], &s, image)) return;
            for (int i = 0; i < 123; ++i)
                if (!CHECK_NEAR((double)image[4 * i] / (double)plain[4 * i], 1,
                                quality == SPS_QUALITY_DRAFT ? 0.02 : 0.01)) {
                    printf("    quality %d, height %g, pixel %d\n", quality, height, i);
                    return;
                }
        }
    }
}

/* Panes on one side of a larger cube, or on two opposite ones: the light's other faces are as bright as without panes.
   In sum over the picture within what slabs leave out, 1 % as above. */
static void test_single_sides(void) {
    enum { WIDTH = 15, HEIGHT = 10 };
    for (int sides = 0; sides < 9; ++sides) {
        double sums[2] = {0, 0};
        check_scene s;
        sps_volume *fog;
        start(&s, WIDTH, HEIGHT);
        check_set3(s.view.camera.position, 3, 2.2, 1.1);
        s.view.quality = SPS_QUALITY_MEDIUM;
        fog = check_add_volume(&s, 16, 16, 16, check_box(-1, -1, -1, 1, 1, 1));
        fog->read_fn = check_read_constant, fog->user = &one, fog->extinction = 0.2f;
        check_color(fog->albedo, 1, 1, 1);
        for (int i = 0; i < 6; ++i)
            if (i == sides || i / 2 == sides - 6) add_face_of_cube(&lists[0], i / 2, i % 2 ? 0.3 : -0.3, 0.3);
        add_mesh(&s, 0.1, 0.3, 0.6);
        check_add_point(&s, 0, 0, 0, 1);
        for (int i = 0; i < RENDERERS; ++i) {
            if (!render_into(&renderers[i], &s, image)) return;
            for (int k = 0; k < WIDTH * HEIGHT; ++k) sums[i] += (double)image[4 * k];
        }
        CHECK_NEAR(sums[1] / sums[0], 1, 0.01);
    }
}

/* Many panes in one pixel, all of which lie before a steep surface of two colors, though not at their mean depth. */
static void many_steep_panes(const renderer *r) {
    for (int m = 1; m <= 6; ++m) {
        check_scene s;
        start(&s, 1, 1);
        s.view.coverage_samples = 8;
        check_orthographic(&s.view.camera, 1);
        for (int i = 0; i < m * m; ++i) {
            const double side = 2.0 / m, x = -1 + i % m * side, y = -1 + i / m * side;
            const double origin[3] = {x, y, 4 * x + 0.05}, u[3] = {side, 0, 4 * side}, v[3] = {0, side, 0};
            check_add_quad(&lists[0], origin, u, v);
        }
        add_mesh(&s, 0.2, 0.2, 0.2);
        for (int k = 0; k < 2; ++k) {
            const double origin[3] = {k - 1, -1, 4 * (k - 1)}, u[3] = {1, 0, 4}, v[3] = {0, 2, 0};
            check_add_quad(&lists[1 + k], origin, u, v);
            check_color(add_mesh(&s, 0, 0, 0)->albedo, 1 - 0.5 * k, 1 - 0.5 * k, 1 - 0.5 * k);
        }
        check_color(s.scene.ambient, 1, 1, 1);
        if (!render_into(r, &s, image)) return;
        for (int c = 0; c < 3; ++c) CHECK_NEAR((double)image[c], 0.2 * 0.75, EXACT);
    }
}
static void test_many_steep_panes(void) { EACH_RENDERER(many_steep_panes); }

/* A polygon that covers half of the pixel, before fog that glows: the other half shows all of the fog, S (1 - e^-tau),
   off by the grid's ripple. */
static void gas_behind_an_edge(const renderer *r) {
    const double tau = 1, S = 0.5, fog_seen = S * -expm1(-tau);
    check_scene s;
    sps_volume *fog;
    start(&s, 1, 1);
    s.view.coverage_samples = 2;
    check_orthographic(&s.view.camera, 0.5);
    fog = add_fog(&s, tau);
    for (int c = 0; c < 3; ++c) fog->emission[c] = (float)(S * (double)fog->extinction);
    {
        const double origin[3] = {-5, -5, 3}, u[3] = {5, 0, 0}, v[3] = {0, 10, 0};
        check_add_quad(&lists[0], origin, u, v);
    }
    check_color(add_mesh(&s, 0, 0, 0)->albedo, 0.5, 0.5, 0.5);
    check_color(s.scene.ambient, 1, 1, 1);
    if (!render_into(r, &s, image)) return;
    for (int c = 0; c < 3; ++c)
        CHECK_NEAR((double)image[c], 0.5 * 0.5 + 0.5 * fog_seen, 0.5 * r->ripple * tau * S + EXACT);
}
static void test_gas_behind_an_edge(void) { EACH_RENDERER(gas_behind_an_edge); }

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_background_through);
    RUN(test_panes_in_order);
    RUN(test_layers_counted);
    RUN(test_many_panes);
    RUN(test_hidden_panes);
    RUN(test_textured_layers);
    RUN(test_shadows_on_ground);
    RUN(test_sides_of_a_pane);
    RUN(test_penumbra_of_a_pane);
    RUN(test_shared_edges);
    RUN(test_seen_edges);
    RUN(test_closed_net);
    RUN(test_glowing_fog);
    RUN_LONG(test_lit_fog);
    RUN(test_lit_before_a_pane);
    RUN(test_penumbra_in_fog);
    RUN(test_panes_before_fog);
    RUN(test_eye_in_fog);
    RUN(test_gas_between_panes);
    RUN(test_straight_edge);
    RUN(test_colored_edge);
    RUN(test_finer_image);
    RUN(test_number_of_samples);
    RUN(test_same_bits);
    RUN_LONG(test_dense_stand_in);
    RUN(test_seams);
    RUN_LONG(test_single_sides);
    RUN(test_many_steep_panes);
    RUN(test_gas_behind_an_edge);
    for (int i = 0; i < LISTS; ++i) check_free_triangles(&lists[i]);
    sps_destroy(context);
    return check_report();
}
