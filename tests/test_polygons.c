/* Polygons against exact answers: their shading, coverage, shadows on each other and in media, and media in front of,
   behind and around them. Surfaces are shaded in double precision from floats, so round-off is 1e-6 of the answer; the
   position of a shadow's edge is known to half a texel of the light's depth map. */

#include "check.h"

#define RIPPLE        0.002 /* error of a constant grid's optical depth at high quality: test_ripple in test_transport.c */
#define RIPPLE_MEDIUM 0.0037 /* the same at medium */
#define RIPPLE_DRAFT  0.0152 /* the same at draft, whose depth maps are the smallest */
#define ISOTROPIC     (0.25 / PI)
#define EXACT         1e-6

enum { PIXELS_MOST = 64 * 64 };
static float image_a[4 * PIXELS_MOST], image_b[4 * PIXELS_MOST], image_c[4 * PIXELS_MOST];
static float depth_a[PIXELS_MOST];
static sps_context *context;
static check_triangles ground, body;
static float one = 1;

/* ---------------------------------------------------------------------------------------------------------- helpers */

/* Empties the lists that tests share. */
static void start(check_scene *s, int width, int height, double ortho_height) {
    check_clear(s, width, height);
    check_orthographic(&s->view.camera, ortho_height);
    ground.count = body.count = 0;
}

/* The square |x|, |y| <= half at height z, facing up. */
static void add_square(check_triangles *triangles, double half, double z) {
    const double origin[3] = {-half, -half, z}, u[3] = {2 * half, 0, 0}, v[3] = {0, 2 * half, 0};
    check_add_quad(triangles, origin, u, v);
}

static double unit_cosine(const double a[3], const double b[3]) {
    return vec_dot(a, b) / vec_length(a) / vec_length(b);
}

/* World position of a pixel's centre on the plane z = 0, for the camera that looks down. */
static void pixel_on_plane(const check_scene *s, int i, double *x, double *y) {
    const double pitch = s->view.camera.ortho_height / s->view.height;
    *x = (i % s->view.width - 0.5 * (s->view.width - 1)) * pitch;
    *y = (0.5 * (s->view.height - 1) - i / s->view.width) * pitch;
}

static double largest_of(const float *image, size_t floats) {
    double most = 0;
    for (size_t i = 0; i < floats; ++i) most = fmax(most, (double)image[i]);
    return most;
}

/* Whether two triangles on corners 012 and 230 of a patch of the unit sphere form a ridge, not a valley. */
static int ridge(double corner[4][3]) {
    double u[3], v[3], normal[3], other[3];
    vec_along(corner[1], corner[0], -1, u);
    vec_along(corner[2], corner[0], -1, v);
    vec_cross(u, v, normal);
    vec_along(corner[3], corner[0], -1, other);
    return vec_dot(normal, other) * vec_dot(normal, corner[0]) <= 0;
}

/* A convex sphere of 12 * n * n facets, without degenerate poles: the faces of a cube, projected. */
static void add_sphere(check_triangles *triangles, const double centre[3], double radius, int n, int smooth) {
    for (int side = 0; side < 6; ++side)
        for (int i = 0; i < n * n; ++i) {
            double corner[4][3];
            for (int k = 0; k < 4; ++k) {
                const double u = 2.0 * (i % n + (k == 1 || k == 2)) / n - 1, v = 2.0 * (i / n + (k > 1)) / n - 1;
                corner[k][side / 2] = side % 2 ? -1 : 1;
                corner[k][(side / 2 + 1) % 3] = u;
                corner[k][(side / 2 + 2) % 3] = v;
                vec_normalise(corner[k]);
            }
            const int turn = !ridge(corner);
            for (int half = 0; half < 2; ++half) {
                sps_triangle *t = check_add_triangle(triangles);
                for (int k = 0; k < 3; ++k)
                    for (int c = 0; c < 3; ++c) {
                        const double n_c = corner[((half ? k + 2 : k) + turn) % 4][c];
                        t->position[k][c] = (float)(centre[c] + radius * n_c);
                        t->normal[k][c] = (float)(smooth ? n_c : 0);
                    }
            }
        }
}

/* ---------------------------------------------------------------------------------------------------------- shading */

/* rho / pi * irradiance * cosine, by a directional and by a point light, with no shadow except for its own. */
static void test_flat_shading(void) {
    for (int point = 0; point < 2; ++point)
        for (int tilt = 0; tilt < 80; tilt += 13) {
            const double a = tilt * PI / 180, normal[3] = {sin(a), 0, cos(a)};
            const double origin[3] = {-4 * cos(a), -4, 4 * sin(a)}, u[3] = {8 * cos(a), 0, -8 * sin(a)},
                         v[3] = {0, 8, 0};
            check_scene s;
            start(&s, 9, 7, 1);
            check_add_quad(&ground, origin, u, v);
            check_color(check_add_mesh(&s, &ground, 1)->albedo, 0.8, 0.5, 0);
            if (point)
                check_add_point(&s, 0.3, 0.7, 3, 5);
            else
                check_add_directional(&s, -0.5, 0.4, -1.3, 5);
            if (!check_render_depth(context, &s, image_a, depth_a)) return;
            for (int i = 0; i < 63; ++i) {
                double at[3], toward[3] = {0.5, -0.4, 1.3}, exact;
                pixel_on_plane(&s, i, &at[0], &at[1]);
                at[2] = -at[0] * tan(a);
                if (point) check_set3(toward, 0.3 - at[0], 0.7 - at[1], 3 - at[2]);
                exact = 5 / PI * fmax(0, unit_cosine(toward, normal)) / (point ? vec_dot(toward, toward) : 1);
                if (!CHECK_CASE("Shadows", "face perpendicular to the light, and tilted by up to 78 degrees",
                                "reflectance / pi * irradiance * cosine", fabs((double)image_a[4 * i] - 0.8 * exact),
                                2 * EXACT, "a few roundings of floats") ||
                    !CHECK_NEAR((double)image_a[4 * i + 1], 0.5 * exact, 2 * EXACT))
                    printf("    tilt %d, pixel %d\n", tilt, i);
                CHECK(image_a[4 * i + 2] == 0 && image_a[4 * i + 3] == 1);
                CHECK_NEAR((double)depth_a[i], 10 - at[2], 1e-5);
            }
        }
}

/* Colors, and normals normalised at the corners, are interpolated by barycentric weights: in perspective too, where
   these are not linear in the image. */
static void test_interpolation(void) {
    static const double xy[3][2] = {{-4, -3}, {5, -4}, {0.5, 7}},
                        colors[3][3] = {{1, 0, 0.3}, {0.1, 1, 0.5}, {0, 0.2, 0.9}};
    static const double normals[3][3] = {{-0.3, -0.2, 1}, {0.5, 0.1, 0.8}, {0.1, 0.9, 2}};
    const double area = (xy[1][0] - xy[0][0]) * (xy[2][1] - xy[0][1]) - (xy[2][0] - xy[0][0]) * (xy[1][1] - xy[0][1]);
    check_scene s;
    sps_triangle *t;
    start(&s, 13, 11, 1);
    t = check_add_triangle(&ground);
    for (int k = 0; k < 3; ++k)
        for (int c = 0; c < 3; ++c) {
            t->position[k][c] = (float)(c < 2 ? xy[k][c] : -0.3 * xy[k][0] - 0.4 * xy[k][1] - 0.7);
            t->albedo[k][c] = (float)colors[k][c];
            t->normal[k][c] = (float)normals[k][c];
        }
    {
        sps_mesh *mesh = check_add_mesh(&s, &ground, 0);
        mesh->has_albedos = mesh->has_normals = 1;
    }
    check_set3(s.view.camera.position, 0, 0, 2);
    check_perspective(&s.view.camera, 0.7);
    check_add_directional(&s, 0.2, -0.6, -1, 2)->no_shadow = 1;
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 143; ++i) {
        const double pitch = 2 * tan(0.35) / 11, x = (i % 13 - 6) * pitch, y = (5 - i / 13) * pitch;
        const double depth = 2.7 / (1 - 0.3 * x - 0.4 * y), p[2] = {x * depth, y * depth}, toward[3] = {-0.2, 0.6, 1};
        double normal[3] = {0, 0, 0}, color[3] = {0, 0, 0};
        for (int k = 0; k < 3; ++k) {
            const double *a = xy[(k + 1) % 3], *b = xy[(k + 2) % 3];
            const double weight = ((a[0] - p[0]) * (b[1] - p[1]) - (b[0] - p[0]) * (a[1] - p[1])) / area;
            for (int c = 0; c < 3; ++c) {
                normal[c] += weight * normals[k][c] / vec_length(normals[k]);
                color[c] += weight * colors[k][c];
            }
        }
        for (int c = 0; c < 3; ++c)
            CHECK_NEAR((double)image_a[4 * i + c], color[c] * 2 / PI * fmax(0, unit_cosine(toward, normal)), 2 * EXACT);
    }
}

/* Either side is lit by a light that faces it, for any order of corners; the other side is dark. */
static void test_two_sided(void) {
    for (int n = 0; n < 8; ++n) {
        const int flipped = n & 1, from_below = n >> 1 & 1, seen_from_below = n >> 2;
        const double origin[3] = {-2, -2, 0}, u[3] = {4, 0, 0}, v[3] = {0, 4, 0};
        const double exact = from_below == seen_from_below ? 0.6 / PI * 2 : 0;
        check_scene s;
        start(&s, 4, 4, 1);
        check_add_quad(&ground, origin, flipped ? v : u, flipped ? u : v);
        check_add_mesh(&s, &ground, 0.6);
        check_add_directional(&s, 0, 0, from_below ? 1 : -1, 2);
        if (seen_from_below) s.view.camera.position[2] = -10;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 16; ++i) CHECK_NEAR((double)image_a[4 * i], exact, EXACT);
    }
}

/* --------------------------------------------------------------------------------------------------------- coverage */

/* A square cut into 2 n^2 triangles with jittered inner corners; each goes to one of two lists. `on_pixels`: corners
   are not jittered, and lie on pixels' centres for some cameras. */
static void add_shattered(check_random *random, int n, const double origin[3], const double u[3], const double v[3],
                          int on_pixels) {
    double corner[33 * 33][3];
    for (int i = 0; i < (n + 1) * (n + 1); ++i) {
        const int x = i % (n + 1), y = i / (n + 1), inner = !on_pixels && x > 0 && y > 0 && x < n && y < n;
        const double a = (x + inner * 0.6 * (check_next(random) - 0.5)) / n;
        const double b = (y + inner * 0.6 * (check_next(random) - 0.5)) / n;
        for (int c = 0; c < 3; ++c) corner[i][c] = origin[c] + a * u[c] + b * v[c];
    }
    for (int i = 0; i < n * n; ++i) {
        const int at = i / n * (n + 1) + i % n, around[4] = {at, at + 1, at + n + 2, at + n + 1};
        const int turn = check_next(random) < 0.5;
        for (int half = 0; half < 2; ++half) {
            const int a = around[turn], b = around[(turn + 1 + half) % 4], c = around[(turn + 2 + half) % 4];
            check_triangles *list = check_next(random) < 0.5 ? &ground : &body;
            if (check_next(random) < 0.5)
                check_add_corners(list, corner[a], corner[b], corner[c]);
            else
                check_add_corners(list, corner[b], corner[a], corner[c]);
        }
    }
}

/* Every pixel is covered by the whole, and by exactly one of its two parts. */
static void check_covered_once(check_scene *s, const char *name) {
    const int pixels = s->view.width * s->view.height;
    int holes = 0, twice = 0;
    check_add_mesh(s, &ground, 1);
    check_add_mesh(s, &body, 1);
    if (!check_render(context, s, image_a)) return;
    s->scene.mesh_count = 1;
    if (!check_render(context, s, image_b)) return;
    s->scene.meshes = &s->mesh[1];
    if (!check_render(context, s, image_c)) return;
    for (int i = 0; i < pixels; ++i) {
        const int sum = (image_b[4 * i + 3] > 0) + (image_c[4 * i + 3] > 0);
        holes += image_a[4 * i + 3] < 1 || sum < 1;
        twice += sum > 1;
    }
    if (!CHECK_CASE("Extremes", "net of triangles, from in front of the eye to behind it, and on pixels' centres",
                    "no pixel shows through, none is covered twice", holes + twice, 0, "exact"))
        printf("    %s: %d holes, %d twice\n", name, holes, twice);
}

static void test_watertight(void) {
    check_random random = {7};
    for (int n = 0; n < 4; ++n) {
        const double origin[3] = {-1, -1, 0}, u[3] = {2, 0, 0.3}, v[3] = {0, 2, -0.2};
        /* rows of triangles of 5 units, one of which reaches from 2.5 in front of the camera to 2.5 behind it */
        const double far_origin[3] = {-40, -2, -77.5}, far_u[3] = {80, 0, 0}, far_v[3] = {0, 0.5, 160};
        check_scene s;
        start(&s, 64, 64, 1.5);
        add_shattered(&random, 32, origin, u, v, 0);
        check_covered_once(&s, "orthographic");
        start(&s, 64, 64, 1);
        add_shattered(&random, 32, origin, u, v, 0);
        check_set3(s.view.camera.position, 0.1, -0.3, 1.2);
        check_perspective(&s.view.camera, 0.7);
        check_covered_once(&s, "perspective");
        start(&s, 64, 40, 1); /* a ground below the camera, in front of and behind it */
        add_shattered(&random, 32, far_origin, far_u, far_v, 0);
        check_set3(s.view.camera.position, 0.3, 0.1, 0);
        check_set3(s.view.camera.target, 0, -3, -4);
        check_perspective(&s.view.camera, 1); /* from 9 to 66 degrees below the horizon */
        s.view.near_distance = n & 1 ? 0.1 : 0;
        check_covered_once(&s, "across the near plane");
    }
}

/* Corners and edges exactly on pixels' centres. */
static void test_watertight_on_pixels(void) {
    check_random random = {11};
    for (int n = 0; n < 4; ++n) {
        const double origin[3] = {-1, -1, 0}, u[3] = {2, 0, 0}, v[3] = {0, 2, 0};
        const double slope[3] = {-8, -8, -11}, slope_u[3] = {16, 0, 8}, slope_v[3] = {0, 16, 4};
        check_scene s;
        start(&s, 31, 31, 31.0 / 16);
        add_shattered(&random, 32, origin, u, v, 1);
        check_covered_once(&s, "orthographic, on pixels");
        start(&s, 31, 31, 1); /* a corner in the middle of a slanted square, on the axis of the camera */
        add_shattered(&random, 8, slope, slope_u, slope_v, 1);
        check_set3(s.view.camera.position, 0, 0, 2);
        check_perspective(&s.view.camera, 1);
        check_covered_once(&s, "perspective, on pixels");
    }
}

/* Polygons nearer than near_distance are not seen, but still cast shadows. */
static void test_near_distance(void) {
    for (int n = 0; n < 4; ++n) {
        const int perspective = n & 1, shadows = n >> 1;
        check_scene s;
        start(&s, 7, 5, 1);
        add_square(&body, 2, 1);
        add_square(&ground, 2, 0);
        check_add_mesh(&s, &body, 0.9);
        check_add_mesh(&s, &ground, 0.4);
        check_add_directional(&s, 0, 0, -1, 3)->no_shadow = !shadows;
        check_perspective(&s.view.camera, perspective ? 0.1 : 0);
        s.view.near_distance = 9.5;
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        for (int i = 0; i < 35; ++i) {
            CHECK_NEAR((double)image_a[4 * i], shadows ? 0 : 0.4 / PI * 3, EXACT);
            CHECK(image_a[4 * i + 3] == 1 && depth_a[i] > 9.9f);
        }
        s.view.near_distance = 8.5;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 35; ++i) CHECK_NEAR((double)image_a[4 * i], 0.9 / PI * 3, EXACT);
    }
}

/* A slope that crosses the near plane is seen exactly where it is behind it; before it, what lies behind shows. The
   columns beside the crossing, which rays reach within a rounding of it, are left out. */
static void test_across_near_plane(void) {
    for (int perspective = 0; perspective < 2; ++perspective) {
        const double origin[3] = {-3, -3, -3}, u[3] = {6, 0, 6}, v[3] = {0, 6, 0}; /* z = x */
        int wrong = 0;
        check_scene s;
        start(&s, 16, 5, 1);
        check_add_quad(&body, origin, u, v);
        add_square(&ground, 9, -2.5); /* behind all of the slope that is in the picture */
        check_add_mesh(&s, &body, 0.9);
        check_add_mesh(&s, &ground, 0.4);
        check_color(s.scene.ambient, 1, 1, 1);
        check_perspective(&s.view.camera, perspective ? 0.1 : 0);
        s.view.near_distance = 10; /* along the ray: z = 0 in the middle row */
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 80; ++i) {
            const double exact = i % 16 > 7 ? 0.4 : 0.9;
            if (i % 16 == 7 || i % 16 == 8) continue;
            wrong += !(fabs((double)image_a[4 * i] - exact) <= EXACT);
        }
        CHECK_CASE("Extremes", "triangle across the near plane", "cut there, pixel by pixel", wrong, 0, "exact");
    }
}

/* Triangles without area change no bit, and are counted. One is far away: it would enlarge the depth map's texels. */
static void test_degenerate(void) {
    static const double p[4][3] = {{0, 0, 1}, {1, 0, 1}, {2, 0, 1}, {0.3, 0.4, 0.5}};
    static const double far_off[3] = {500, -700, 3};
    check_scene s;
    sps_stats_report stats;
    for (int with = 0; with < 2; ++with) {
        start(&s, 17, 13, 2);
        if (with) {
            check_add_corners(&body, p[0], p[1], p[2]); /* on a line */
            check_add_corners(&body, p[0], p[3], p[0]);
            check_add_corners(&body, p[3], p[3], p[3]);
            check_add_corners(&body, far_off, p[0], far_off);
        }
        add_square(&body, 0.7, 0.2);
        if (with) add_square(&body, 0.7, 0.2); /* the same again: covered by itself, and no acne */
        add_square(&ground, 3, -0.5);
        check_add_mesh(&s, &body, 0.5);
        check_add_mesh(&s, &ground, 0.9);
        check_add_directional(&s, 0.3, 0.5, -1, 3);
        if (!check_render(context, &s, with ? image_b : image_a)) return;
    }
    s.mesh[0].revision = s.mesh[1].revision = 5;
    for (int held = 0; held < 3; ++held) {
        sps_get_stats(context, &stats);
        CHECK(stats.triangles_degenerate == 4);
        CHECK(stats.triangles == 6 && (stats.triangle_calls == 0) == (held == 2));
        CHECK_CASE("Extremes", "square drawn twice, triangles without area, shadows held or not", "the same picture",
                   memcmp(image_a, image_b, sizeof(float) * 4 * 17 * 13) != 0, 0, "same bits");
        if (!check_render(context, &s, image_b)) return;
    }
}

/* ---------------------------------------------------------------------------------------------- shadows on surfaces */

/* The position in a row, in pixels, where brightness crosses half of `full`; -1 if it does not. */
static double half_way(const float *row, int width, double full) {
    for (int i = 0; i + 1 < width; ++i) {
        const double a = (double)row[4 * i] - 0.5 * full, b = (double)row[4 * i + 4] - 0.5 * full;
        if (a < 0 && b >= 0) return i + a / (a - b);
    }
    return -1;
}

/* A roof at height 1 whose edge runs through (0,0) at an angle; its shadow on z = 0 ends where similar triangles say.
   The depth map covers the meshes with shadow_resolution - 4 texels across the longer side; the edge is known to half a
   texel, and linear interpolation of brightness in the image adds at most half a pixel. */
static void check_shadow_edge(int point, double angle) {
    const double edge[3] = {sin(angle), cos(angle), 0}, origin[3] = {-edge[0] * 3, -edge[1] * 3, 1};
    const double u[3] = {6 * edge[0], 6 * edge[1], 0}, v[3] = {-3 * cos(angle), 3 * sin(angle), 0};
    check_scene s;
    double texel, pitch;
    start(&s, 64, 9, 0.14);
    add_square(&ground, 4, 0);
    check_add_quad(&body, origin, u, v);
    check_add_mesh(&s, &ground, 1);
    check_add_mesh(&s, &body, 1);
    s.view.quality = SPS_QUALITY_DRAFT; /* of maps no larger than requested */
    s.view.shadow_resolution = 512;
    if (point)
        check_add_point(&s, -1, 0.5, 3, 9);
    else
        check_add_directional(&s, 0.8, 0, -1, 3);
    s.view.camera.position[0] = s.view.camera.target[0] = point ? 0.5 : 0.8;
    texel = 8 * sqrt(2.0) / 508; /* no narrower than the square's diagonal, as seen from above */
    pitch = s.view.camera.ortho_height / 9;
    if (!check_render(context, &s, image_a)) return;
    for (int row = 0; row < 9; ++row) {
        const double y = (4 - row) * pitch, full = (double)image_a[4 * (64 * row + 63)];
        const double y_roof = point ? y + (0.5 - y) / 3 : y, slant = tan(angle) * y_roof;
        const double exact = point ? -1 + (slant + 1) * 1.5 : slant + 0.8;
        const double found = half_way(image_a + 4 * 64 * row, 64, full);
        if (!CHECK(found >= 0) ||
            !CHECK_CASE("Shadows", "hard edge of a roof's shadow, by a sun and a point", "similar triangles",
                        fabs((found - 31.5) * pitch + s.view.camera.target[0] - exact),
                        0.5 * texel * 1.25 + 0.5 * pitch, "half a texel, at a slant, and half a pixel"))
            printf("    point %d, angle %g, row %d\n", point, angle, row);
        CHECK(image_a[4 * (64 * row + 8)] <= 0 && full > 0); /* the roof is visible at some pixels farther left */
    }
}

static void test_shadow_edges(void) {
    for (int point = 0; point < 2; ++point) {
        check_shadow_edge(point, 0);
        check_shadow_edge(point, 0.35);
        check_shadow_edge(point, -0.6);
    }
}

/* A lit plane shades no spot of itself, however grazing the light and however coarse the map. */
static void test_no_acne_on_plane(void) {
    static const double grazing[5] = {0.5, 0.1, 0.02, 0.004, 0.0005};
    for (int n = 0; n < 10; ++n)
        for (int size = 512; size <= 2048; size *= 4) {
            const double height = grazing[n % 5];
            check_scene s;
            int wrong = 0;
            start(&s, 33, 29, 3.7);
            add_square(&ground, 2, 0);
            check_add_mesh(&s, &ground, 1);
            s.view.quality = SPS_QUALITY_DRAFT;
            s.view.shadow_resolution = size;
            if (n < 5)
                check_add_directional(&s, 1, 0.37, -height, 3);
            else
                check_add_point(&s, -6, 1.3, 6 * height, 100);
            if (!check_render(context, &s, image_a)) return;
            s.view.no_shadows = 1;
            if (!check_render(context, &s, image_b)) return;
            for (int i = 0; i < 4 * 33 * 29; ++i) wrong += !(fabsf(image_a[i] - image_b[i]) <= 1e-6f * image_b[i]);
            CHECK(largest_of(image_b, 4 * 33 * 29) > 0);
            if (!CHECK_CASE("Shadows", "a plane lit at any height down to grazing", "it shades no spot of itself",
                            wrong, 0, "exact"))
                printf("    %d of %d values, light %g above, map of %d\n", wrong, 4 * 33 * 29, height, size);
        }
}

/* A convex body of flat facets: those that face the light are lit, the others face away, so shadows add nothing. */
static void test_convex_body(void) {
    check_random random = {5};
    for (int n = 0; n < 6; ++n) {
        const double centre[3] = {0.1, -0.05, 0};
        check_scene s;
        int wrong = 0;
        start(&s, 41, 41, 2.4);
        add_sphere(&body, centre, 1, 9, 0);
        check_add_mesh(&s, &body, 0.8);
        s.view.quality = SPS_QUALITY_DRAFT;
        if (n & 1)
            check_add_point(&s, 3 * check_next(&random) + 1, 3 * check_next(&random), 2 * check_next(&random), 9);
        else
            check_add_directional(&s, check_next(&random) - 0.5, check_next(&random) - 0.5, check_next(&random) - 0.7,
                                  3);
        if (!check_render(context, &s, image_a)) return;
        s.view.no_shadows = 1;
        if (!check_render(context, &s, image_b)) return;
        for (int i = 0; i < 4 * 41 * 41; ++i) wrong += !(fabsf(image_a[i] - image_b[i]) <= 1e-5f);
        if (!CHECK(wrong == 0)) printf("    light %d: %d values\n", n, wrong);
    }
}

/* The number of pixels that differ by more than `tolerance` from the image without shadows, which goes to image_b. */
static int count_shadowed(check_scene *s, double tolerance) {
    const int pixels = s->view.width * s->view.height;
    int count = 0;
    if (!check_render(context, s, image_a)) return -1;
    s->view.no_shadows = 1;
    if (!check_render(context, s, image_b)) return -1;
    s->view.no_shadows = 0;
    CHECK(largest_of(image_b, 4 * (size_t)pixels) > 0);
    for (int i = 0; i < 4 * pixels; ++i)
        count += !(fabs((double)image_a[i] - (double)image_b[i]) <= tolerance * (double)image_b[i]);
    return count;
}

/* A groove of two planes, open to a light above both: texels around its crease belong to the other plane, which rises
   in front of each, but shades no spot of it. Texels are 4 * 1.4 / 508 or / 1020 wide, and so are most pixels. */
static void test_groove(void) {
    for (int n = 0; n < 24; ++n) {
        const double turn = 0.37 * (n / 4) + 0.01, slope = n % 4 < 2 ? 0.25 : 0.9;
        const double c = cos(turn), z = sin(turn), origin[3] = {-2 * c, -2 * z, 0}, along[3] = {4 * c, 4 * z, 0};
        const double left[3] = {-2 * z, 2 * c, 2 * slope}, right[3] = {2 * z, -2 * c, 2 * slope};
        check_scene s;
        start(&s, 64, 64, 0.4);
        check_add_quad(&body, origin, along, left);
        check_add_quad(&body, origin, along, right);
        check_add_mesh(&s, &body, 0.8);
        s.view.quality = n & 1 ? SPS_QUALITY_MEDIUM : SPS_QUALITY_DRAFT;
        if (n / 4 % 2)
            check_add_point(&s, 0.3, -0.2, 5, 30);
        else
            check_add_directional(&s, 0.3, 0.2, -1, 3);
        const int wrong = count_shadowed(&s, 1e-6);
        if (!CHECK(wrong == 0)) printf("    turn %g, slope %g: %d values\n", turn, slope, wrong);
    }
}

/* Steps that rise away from the light, from less than a texel's width (2.8 / 508 or / 1020) up to a few texels: each
   texel shows another step, whose plane lies in front of the point and its own plane, and yet everything is lit. */
static void test_fine_steps(void) {
    static const double heights[4] = {0.0015, 0.004, 0.009, 0.016};
    for (int n = 0; n < 16; n += check_memory_only() ? 5 : 1) { /* 5: each turn and each height once */
        const double turn = 0.3 + 0.5 * (n / 4), c = cos(turn), z = sin(turn), height = heights[n % 4];
        const double across[3] = {-2 * z, 2 * c, 0}, tread[3] = {0.05 * c, 0.05 * z, 0}, riser[3] = {0, 0, height};
        double corner[3] = {z - c, -c - z, 0};
        check_scene s;
        start(&s, 64, 64, 0.4);
        for (int i = 0; i < 40; ++i) {
            check_add_quad(&body, corner, tread, across);
            vec_along(corner, tread, 1, corner);
            check_add_quad(&body, corner, riser, across);
            vec_along(corner, riser, 1, corner);
        }
        check_add_mesh(&s, &body, 0.8);
        s.view.quality = n & 1 ? SPS_QUALITY_MEDIUM : SPS_QUALITY_DRAFT;
        if (n & 2)
            check_add_point(&s, -3 * c, -3 * z, 4, 30);
        else
            check_add_directional(&s, 0.6 * c - 0.1 * z, 0.6 * z + 0.1 * c, -1, 3);
        const int wrong = count_shadowed(&s, 1e-6);
        if (!CHECK(wrong == 0)) printf("    turn %g, steps of %g: %d values\n", turn, height, wrong);
    }
}

/* Whether a light reaches all, or none, of a pixel and its eight neighbours, from the ratio of image_c and image_b. */
static int evenly_lit(int width, int height, int i) {
    double low = 1, high = 0;
    for (int n = 0; n < 9; ++n) {
        const int x = i % width + n % 3 - 1, y = i / width + n / 3 - 1, at = 4 * (y * width + x);
        if (x < 0 || y < 0 || x >= width || y >= height || !(image_b[at] > 0)) continue;
        low = fmin(low, (double)image_c[at] / (double)image_b[at]);
        high = fmax(high, (double)image_c[at] / (double)image_b[at]);
    }
    return high - low < 0.01;
}

/* A box on a floor, seen from either side: where it meets the floor in the light there is no dark spot, and where it
   meets the floor in the dark there is no light leak. A texel (4 * 1.4 / 1020) is a quarter of a pixel: beside the
   shadow's edge half a texel is uncertain, which the box may hide from the eye except for a single pixel. */
static void test_box_on_floor(void) {
    for (int n = 0; n < 12; ++n) {
        const double turn = 0.1 + 0.25 * (n / 2), c = cos(turn), z = sin(turn), up[3] = {0, 0, 0.5};
        const double corner[4][3] = {
            {-0.4 * c, -0.4 * z, 0}, {-0.4 * z, 0.4 * c, 0}, {0.4 * c, 0.4 * z, 0}, {0.4 * z, -0.4 * c, 0}};
        double edge[2][3], top[3];
        check_scene s;
        int dark = 0, light = 0;
        start(&s, 64, 64, 1);
        for (int side = 0; side < 4; ++side) {
            vec_along(corner[(side + 1) % 4], corner[side], -1, edge[0]);
            check_add_quad(&body, corner[side], edge[0], up);
        }
        vec_along(corner[1], corner[0], -1, edge[0]);
        vec_along(corner[3], corner[0], -1, edge[1]);
        vec_along(corner[0], up, 1, top);
        check_add_quad(&body, top, edge[0], edge[1]);
        add_square(&ground, 2, 0);
        check_add_mesh(&s, &body, 0.7);
        check_add_mesh(&s, &ground, 0.5);
        if (n & 1)
            check_add_point(&s, 1.2, -1.9, 2.5, 30);
        else
            check_add_directional(&s, -0.5, 0.8, -1, 3);
        check_set3(s.view.camera.position, n / 2 % 2 ? 1.5 : -1.5, n / 2 % 2 ? -2 : 2, 1.5);
        check_set3(s.view.camera.up, 0, 0, 1);
        check_perspective(&s.view.camera, 0.5);
        if (count_shadowed(&s, 1e-6) < 0 || !check_march(context, &s, 1, image_c, NULL)) return;
        for (int i = 0; i < 64 * 64; ++i) {
            const double full = (double)image_b[4 * i], share = (double)image_a[4 * i] - (double)image_c[4 * i];
            if (!(full > 0) || !evenly_lit(64, 64, i)) continue;
            dark += share < -0.01 * full;
            light += share > 0.01 * full;
        }
        if (!CHECK(dark <= 1) || !CHECK(light == 0)) printf("    case %d: %d too dark, %d too light\n", n, dark, light);
    }
}

/* A roof closer to the floor than a texel's width (8 * 1.4 / 508) blocks all light, whether whole or in pieces as small
   as a texel. Polygons nearer than near_distance cast shadows and are not seen. */
static void test_thin_roof(void) {
    static const double heights[4] = {0.02, 0.004, 0.0005, 0.00005};
    for (int n = 0; n < 16; ++n) {
        const double height = heights[n % 4], origin[3] = {-0.6, -0.6, height}, u[3] = {1.2, 0, 0}, v[3] = {0, 1.2, 0};
        const int pieces = n & 4 ? 64 : 1;
        check_scene s;
        start(&s, 31, 31, 0.9);
        for (int i = 0; i < pieces * pieces; ++i) {
            double corner[3], edge_u[3], edge_v[3];
            for (int k = 0; k < 3; ++k) edge_u[k] = u[k] / pieces, edge_v[k] = v[k] / pieces;
            vec_along(origin, edge_u, i % pieces, corner);
            vec_along(corner, edge_v, i / pieces, corner);
            check_add_quad(&body, corner, edge_u, edge_v);
        }
        add_square(&ground, 4, 0);
        check_add_mesh(&s, &ground, 0.5);
        s.view.quality = SPS_QUALITY_DRAFT;
        s.view.near_distance = 10 - 0.5 * height;
        if (n & 8)
            check_add_point(&s, 0.5, 0.3, 3, 30);
        else
            check_add_directional(&s, 0.5, 0.31, -1, 3);
        if (!check_render(context, &s, image_b)) return;
        check_add_mesh(&s, &body, 0.5);
        if (!check_render(context, &s, image_a)) return;
        CHECK(image_b[4 * 480] > 0.1f); /* without the roof it is light */
        int lit = 0;
        for (int i = 0; i < 31 * 31; ++i) lit += image_a[4 * i] > 0;
        if (!CHECK(lit == 0)) printf("    height %g, %d pieces: %d pixels\n", height, pieces, lit);
    }
}

/* A smooth sphere: lit by its normals up to where its facets face away, which is within one facet (0.25 radians) of the
   terminator; nothing is lit beyond. */
static void test_terminator(void) {
    const double centre[3] = {0, 0, 0}, toward[3] = {0.8, 0.36, 0.48};
    check_scene s;
    start(&s, 45, 45, 2.2);
    add_sphere(&body, centre, 1, 9, 1);
    check_add_mesh(&s, &body, 1)->has_normals = 1;
    check_add_directional(&s, -toward[0], -toward[1], -toward[2], PI);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 45 * 45; ++i) {
        double p[3], cosine;
        pixel_on_plane(&s, i, &p[0], &p[1]);
        p[2] = 1 - p[0] * p[0] - p[1] * p[1];
        if (p[2] < 0.1) continue; /* the outline is a polygon's */
        p[2] = sqrt(p[2]);
        cosine = vec_dot(p, toward);
        /* normals of facets deviate from the sphere's by their sag, (0.25 / 2)^2 / 2 / cos of the view */
        if (cosine > 0.3) CHECK_NEAR((double)image_a[4 * i], cosine, 0.008 / p[2]);
        if (cosine < -0.25) CHECK(image_a[4 * i] <= 0);
        CHECK((double)image_a[4 * i] <= fmax(0, cosine) + 0.008 / p[2]);
    }
}

/* The six walls of the cube |x|, |y|, |z| <= 1, each of two triangles. */
static void add_walls(check_triangles *triangles) {
    for (int side = 0; side < 6; ++side) {
        double origin[3] = {-1, -1, -1}, u[3] = {0, 0, 0}, v[3] = {0, 0, 0};
        origin[side / 2] = side % 2 ? -1 : 1;
        u[(side / 2 + 1) % 3] = 2;
        v[(side / 2 + 2) % 3] = 2;
        check_add_quad(triangles, origin, u, v);
    }
}

static void look_inside(check_scene *s, int side) {
    check_set3(s->view.camera.position, -0.2, 0.1, 0.15);
    memcpy(s->view.camera.target, s->view.camera.position, sizeof s->view.camera.target);
    s->view.camera.target[side / 2] += side % 2 ? -1 : 1;
    check_set3(s->view.camera.up, 0, side / 2 != 1, side / 2 == 1);
    check_perspective(&s->view.camera, 1.6);
}

/* The point on a wall that a pixel of that camera sees. Returns its distance. */
static double wall_point(const check_scene *s, int i, double at[3]) {
    const double pitch = 2 * tan(0.5 * s->view.camera.field_of_view) / s->view.height;
    const double x = (i % s->view.width - 0.5 * (s->view.width - 1)) * pitch;
    const double y = (0.5 * (s->view.height - 1) - i / s->view.width) * pitch;
    double forward[3], right[3], up[3], ray[3], t = 1e9;
    vec_along(s->view.camera.target, s->view.camera.position, -1, forward);
    vec_cross(forward, s->view.camera.up, right);
    vec_normalise(right);
    vec_cross(right, forward, up);
    for (int c = 0; c < 3; ++c) ray[c] = forward[c] + x * right[c] + y * up[c];
    for (int c = 0; c < 3; ++c) t = fmin(t, ((ray[c] > 0 ? 1 : -1) - s->view.camera.position[c]) / ray[c]);
    vec_along(s->view.camera.position, ray, t, at);
    return t * vec_length(ray);
}

/* The distance from a point on a wall to the next wall. */
static double to_corner(const double at[3]) {
    double gap[3];
    for (int c = 0; c < 3; ++c) gap[c] = 1 - fabs(at[c]);
    return gap[0] + gap[1] + gap[2] - fmax(gap[0], fmax(gap[1], gap[2])) - fmin(gap[0], fmin(gap[1], gap[2]));
}

/* A point light inside a closed box lights all six walls: intensity / pi * cosine / distance^2. Within a texel of where
   walls meet (2.6 away, where each face of the map has 512 texels on twice that), one may shade the other. */
#define BOX_TEXEL (2 * 2.6 / 509)
static void test_light_in_box(void) {
    for (int side = 0; side < 6; ++side) {
        const double light[3] = {0.4, -0.3, 0.2};
        check_scene s;
        start(&s, 24, 24, 1);
        add_walls(&body);
        check_add_mesh(&s, &body, 1);
        check_add_point(&s, light[0], light[1], light[2], PI);
        look_inside(&s, side);
        if (!check_render_depth(context, &s, image_a, depth_a)) return;
        for (int i = 0; i < 24 * 24; ++i) {
            double at[3], square = 0, cosine = 0;
            const double distance = wall_point(&s, i, at);
            for (int c = 0; c < 3; ++c) {
                const double away = light[c] - at[c];
                square += away * away;
                if (fabs(at[c]) > 1 - 1e-9) cosine = fabs(away);
            }
            if (to_corner(at) < BOX_TEXEL)
                CHECK((double)image_a[4 * i] <= cosine / sqrt(square) / square + 1e-5);
            else if (!CHECK_NEAR((double)image_a[4 * i], cosine / sqrt(square) / square, 1e-5))
                printf("    side %d, pixel %d %d\n", side, i % 24, i / 24);
            CHECK_NEAR((double)depth_a[i], distance, 1e-5);
        }
        for (int i = 0; i < 24 * 24; ++i) CHECK(image_a[4 * i] > 0.02f && image_a[4 * i + 3] == 1);
    }
}

/* No light gets into a closed box, from the sun or from a lamp close by, except within a texel of where walls meet, as
   a map's edges are only that sharp. */
static void test_closed_box_is_dark(void) {
    for (int n = 0; n < 18; ++n) {
        check_scene s;
        int lit = 0;
        start(&s, 24, 24, 1);
        add_walls(&body);
        check_add_mesh(&s, &body, 1);
        if (n / 6 == 0) check_add_directional(&s, 0.3, -1, 0.2, 1000);
        if (n / 6 == 1) check_add_directional(&s, 1, -1, -1, 1000);
        if (n / 6 == 2) check_add_point(&s, 1.3, 1.1, 0.2, 1000);
        look_inside(&s, n % 6);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 24 * 24; ++i) {
            double at[3];
            wall_point(&s, i, at);
            lit += image_a[4 * i] > 0 && to_corner(at) > BOX_TEXEL;
        }
        if (!CHECK(lit == 0))
            printf("    light %d, side %d: %d pixels, at most %g\n", n / 6, n % 6, lit,
                   largest_of(image_a, 4 * 24 * 24));
    }
}

/* ----------------------------------------------------------------------------------------------- surfaces and media */

/* A slab of cubic voxels of 1/8 (exact in binary) around the origin. */
static sps_volume *add_slab(check_scene *s, int side, int layers, double extinction) {
    const double w = side / 16.0, h = layers / 16.0;
    sps_volume *volume = check_add_volume(s, side, side, layers, check_box(-w, -w, -h, w, w, h));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)extinction;
    s->view.quality = SPS_QUALITY_HIGH;
    return volume;
}

static double slab_radiance(double te, double tl) { return te > 0 ? te * -expm1(-te - tl) / (te + tl) : 0; }

/* A slab with a polygon in it at height z; light from the eye's side at `angle`, or none; radiance of emission,
   scattering and surface together, exact if z is 2.5 voxels inside. */
static double slab_with_polygon(double z, double sigma, double angle, double emission, double irradiance, double rho) {
    const double te = sigma * (1.25 - z), tl = te / cos(angle);
    double sum = emission / sigma * -expm1(-te) + irradiance * ISOTROPIC * slab_radiance(te, tl);
    return sum + exp(-te - tl) * rho / PI * irradiance * cos(angle);
}

/* Renders it: a slab of 20 layers, 2.5 high. */
static int render_slab_with_polygon(double z, double sigma, double angle, double slab, int lit, sps_quality quality,
                                    float *image) {
    const int side = angle > 0.6 ? 41 : angle > 0 ? 33 : 9; /* wide enough for slanted light */
    check_scene s;
    sps_volume *volume;
    start(&s, 5, 5, 0.3);
    add_square(&ground, 6, z);
    check_add_mesh(&s, &ground, 0.7);
    volume = add_slab(&s, side, 20, sigma);
    check_color(volume->albedo, 1, 1, 1);
    check_color(volume->emission, 0.2, 0.2, 0.2);
    if (lit) check_add_directional(&s, sin(angle), 0, -lit * cos(angle), 3);
    s.view.slab_thickness = slab;
    s.view.quality = quality;
    s.view.shadow_resolution = 3 * side;
    check_color(s.scene.background, 5, 5, 5);
    return check_render(context, &s, image);
}

/* A polygon at depths that include the very planes between sheets (every half voxel, for any margin around the voxels)
   is exact: all of the gas in front of it, none of that behind it, itself once. Texels of a third of a voxel
   interpolate the light's depth linearly, whose bend at the slab's face costs tl / 20 / 1.6 / 3^2 / 8 in oblique light.
 */
static void test_polygon_in_slab(void) {
    static const double angles[2] = {0, 0.7}, slabs[3] = {1, 3, 0.5};
    for (int a = 0; a < 2; ++a)
        for (int n = 0; n < 3 - a; ++n)
            for (int step = -7; step <= 7; step += check_memory_only() ? 7 : a ? 3 : n ? 2 : 1) {
                const double z = step / 8.0, sigma = 0.8, exact = slab_with_polygon(z, sigma, angles[a], 0.2, 3, 0.7);
                const double depth = sigma * (1.25 - z) * (1 + 1 / cos(angles[a]));
                if (!render_slab_with_polygon(z, sigma, angles[a], slabs[n], 1, SPS_QUALITY_MEDIUM, image_a)) return;
                for (int i = 0; i < 25; ++i)
                    if (!CHECK_CASE("Transport", "polygon at any depth of a slab, in the planes between sheets, too",
                                    "all gas before it, none behind it, itself once",
                                    fabs((double)image_a[4 * i] - exact),
                                    exact * (depth * RIPPLE_MEDIUM + 1e-4 + (a ? depth / 20 / 1.6 / 72 : 0)),
                                    "ripple of medium quality; straight lines between texels")) {
                        printf("    at %g, light at %g, slab %g, pixel %d\n", z, angles[a], slabs[n], i);
                        break;
                    }
                CHECK(image_a[3] >= 1);
            }
}

/* On the light's side there is the closed form, whose slab ends where the polygon has left it. Near a face, the kernel
   smooths the slab: at most 0.4 of its width, 0.65 / 8, is missing or too much, for eye and light, of what dims the
   surface, 0.67, and of what glows and scatters. Ripple is that of both ways' depth. */
static void check_lit_slide(double z, double angle, double found) {
    const double within = fmin(fmax(z, -1.25), 1.25), exact = slab_with_polygon(within, 0.8, angle, 0.2, 3, 0.7);
    const double ways = 1 + 1 / cos(angle), face = fabs(fabs(z) - 1.25) < 0.32 ? 0.4 * 0.65 / 8 : 0;
    const double allowed = face * (0.67 * 0.8 * ways + 0.2 + 3 * ISOTROPIC);
    if (!CHECK_NEAR(found, exact, allowed + exact * (0.8 * (1.25 - within) * ways * RIPPLE_DRAFT + 1e-4)))
        printf("    at %g, light at %g\n", z, angle);
}

/* A polygon moved in small steps through the whole slab and out on both sides: brightness never jumps. It changes at
   most by the effect of extinction 0.8 over a step, for eye and light, on everything (the surface 0.67, emission and
   scattering 0.24 + 0.25 per unit of length), and by the ripple of another part of a kernel. */
static void test_polygon_slides(void) {
    for (int lit = check_memory_only() ? 1 : -1; lit <= 1; ++lit)
        for (int n = 0; n < 1 + (lit > 0); ++n) {
            const double step = n ? 1.0 / 20 : 1.0 / 16; /* steps of half a voxel meet every plane between sheets */
            double before = -1, sum = 0;
            for (int i = n ? -6 : -27; i <= (n ? 6 : 27); ++i) {
                const double z = i * step;
                if (!render_slab_with_polygon(z, 0.8, n ? 0.5 : 0, n ? 1 : 2, lit, SPS_QUALITY_DRAFT, image_a)) return;
                if (before >= 0 && !CHECK_CASE("Transport", "polygon moved through a slab and out on both sides",
                                               "brightness never jumps", fabs((double)image_a[48] - before),
                                               step * (0.8 * 2.2 * 0.67 + 0.5) + 1e-4,
                                               "extinction of a step, for eye and light, on all that is seen"))
                    printf("    at %g, light %d, tilted %d\n", z, lit, n);
                before = (double)image_a[48];
                sum += before;
                if (lit > 0) check_lit_slide(z, n ? 0.5 : 0, before);
                if (lit < 1) { /* dark on the eye's side: emission alone, no light leaks from behind */
                    const double te = 0.8 * fmin(fmax(1.25 - z, 0), 2.5);
                    /* near the faces the kernel smooths the slab: at most 0.4 of its width is missing or too much */
                    CHECK_NEAR(before, 0.25 * -expm1(-te),
                               0.2 * (fabs(fabs(z) - 1.25) < 0.32 ? 0.4 * 0.65 / 8 : 0) +
                                   0.25 * 0.37 * RIPPLE_DRAFT); /* te exp(-te) <= 0.37 */
                }
            }
            CHECK(sum > 1);
        }
}

/* A surface under a slab: dimmed by exp(-tau / cos) on the light's way, and again on the eye's if that passes through
   it. */
static void test_volume_shadow_on_plane(void) {
    for (int n = 0; n < 4; ++n) {
        const double angle = n & 1 ? 0.6 : 0, tl = 0.9 / cos(angle), te = n & 2 ? 0.9 : 0;
        const double exact = 0.6 / PI * 3 * cos(angle) * exp(-tl - te);
        check_scene s;
        start(&s, 7, 5, 0.4);
        add_square(&ground, 5, -1);
        check_add_mesh(&s, &ground, 0.6);
        add_slab(&s, n & 1 ? 41 : 15, 6, 0.9 / 0.75);
        check_add_directional(&s, sin(angle), 0, -cos(angle), 3);
        s.view.shadow_resolution = 100;
        if (te <= 0) s.view.near_distance = 10.8; /* the rays begin below the slab */
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 35; ++i)
            if (!CHECK_CASE("Shadows", "slab of gas over a surface, light perpendicular to both and at a slant",
                            "exp(-depth / cosine) of the light", fabs((double)image_a[4 * i] - exact),
                            exact * (tl + te) * RIPPLE + EXACT, "ripple"))
                printf("    case %d\n", n);
    }
}

/* A slope within a slab of gas that only absorbs, lit from the eye: pixels side by side look through different numbers
   of sheets, and so does the light. */
static void test_slope_in_slab(void) {
    const double sigma = 0.8, tilt = PI / 4;
    const double origin[3] = {-4 * cos(tilt), -4, 4 * sin(tilt)}, u[3] = {8 * cos(tilt), 0, -8 * sin(tilt)},
                 v[3] = {0, 8, 0};
    check_scene s;
    start(&s, 16, 2, 0.25);
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(&s, &ground, 0.7);
    add_slab(&s, 25, 20, sigma);
    check_add_directional(&s, 0, 0, -1, 3)->shadow_source = SPS_SHADOW_SHEETS;
    s.view.slab_thickness = 1;
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 32; ++i) {
        double x, y, depth, exact;
        pixel_on_plane(&s, i, &x, &y);
        depth = 2 * sigma * (1.25 + x * tan(tilt));
        exact = 0.7 / PI * 3 * cos(tilt) * exp(-depth);
        if (!CHECK_NEAR((double)image_a[4 * i], exact, exact * (depth * RIPPLE + 1e-4))) printf("    pixel %d\n", i);
    }
}

/* Places lie on their face's plane. Rays that graze it are moved onto it across, not far along it. */
static void test_grazing_places(void) {
    check_random random = {3};
    for (int round = 0; round < 400; ++round) {
        const double tilt = round % 2 ? 1e-9 * check_next(&random) : check_next(&random);
        const double ray[3] = {1, 0, -tilt}, rasterised[3] = {2, 1, 1e-6 * check_next(&random)};
        const double plane[3] = {0, 0, 2};
        double point[3];
        spsi_face face;
        memset(&face, 0, sizeof face);
        spsi_surface_place(&face, plane, ray, rasterised, point);
        CHECK(fabs(point[2]) <= 1e-15);
        if (!CHECK(fabs(point[0] - 2) <= (tilt > 1e-8 ? 1e-6 / tilt : 0)))
            printf("    tilt %g: at %g\n", tilt, point[0]);
    }
}

/* Where the eye sees no gas, polygons of a whole chunk are lit at once. Between planes 0, 1, 4, 9, .. deep, places in
   any slab, beside each other, lie on straight lines; before and behind the chunk counts as at its ends, and gas beside
   the planes, whose texels are 0 at the edge, as none. */
static void test_slabs_side_by_side(void) {
    enum { WIDE = 6 };
    static float memory[SPSI_CHUNK + 1][WIDE * WIDE];
    static spsi_sliced sliced;
    spsi_rays rays;
    spsi_slabs slabs;
    spsi_points points;
    memset(&rays, 0, sizeof rays), memset(&slabs, 0, sizeof slabs);
    for (int i = 0; i < 3; ++i) rays.inverse[i][i] = 1;
    rays.width = rays.height = sliced.planes.width = sliced.planes.height = WIDE;
    slabs.normal[2] = slabs.thickness = 1;
    sliced.target.rays = &rays, sliced.target.slabs = &slabs;
    for (int k = 0; k <= SPSI_CHUNK; ++k) {
        for (int i = 0; i < WIDE * WIDE; ++i)
            memory[k][i] = i % WIDE % (WIDE - 1) && i / WIDE % (WIDE - 1) ? (float)(k * k) : 0;
        sliced.planes.depth[k] = memory[k];
    }
    for (int shift = -3; shift < SPSI_CHUNK + 3; ++shift) {
        float depths[SPSI_LANES];
        points.lanes = (1 << SPSI_LANES) - 1;
        for (int i = 0; i < SPSI_LANES; ++i) {
            points.at[0][i] = i % 5 == 4 ? -2 : 2.5, points.at[1][i] = 2;
            points.at[2][i] = 40 + shift + 0.3 + i * 7 % SPSI_LANES;
        }
        spsi_store(depths, spsi_sliced_surfaces(&sliced, 40, &points));
        for (int i = 0; i < SPSI_LANES; ++i) {
            const double slab = fmin(fmax(points.at[2][i] - 40, 0), SPSI_CHUNK), k = fmin(floor(slab), SPSI_CHUNK - 1);
            const double exact = i % 5 == 4 ? 0 : k * k + (slab - k) * (2 * k + 1);
            if (!CHECK_NEAR((double)depths[i], exact, 1e-6 * (1 + exact) * SPSI_CHUNK)) printf("    slab %g\n", slab);
        }
    }
}

/* A roof over part of a slab: its shadow fills the gas behind it along the light. Along the eye's upright ray at x the
   part above 1.5 - x is lit. Half a texel of the map (8 / 2044 across, seen at 45 degrees) moves the edge by 0.003; the
   lit share of a quarter of a sheet (0.0625 / 4) that the edge crosses may be off by half of that, 0.008; and the
   smooth face of the slab adds or removes 0.4 of a kernel's width of medium. */
static void test_polygon_shadow_in_medium(void) {
    const double sigma = 1.1, root = sqrt(2.0);
    const double origin[3] = {-4, -4, 1.5}, u[3] = {4, 0, 0}, v[3] = {0, 8, 0};
    check_scene s;
    start(&s, 63, 3, 0.096);
    check_add_quad(&body, origin, u, v);
    check_add_mesh(&s, &body, 0.5);
    check_color(add_slab(&s, 45, 8, sigma)->albedo, 1, 1, 1);
    check_add_directional(&s, 1, 0, -1, 3);
    s.view.shadow_resolution = 400;
    s.view.camera.position[0] = s.view.camera.target[0] = 1.5;
    if (!check_render(context, &s, image_a)) return;
    for (int i = 63; i < 126; ++i) {
        const double x = 1.5 + (i - 63 - 31) * 0.032, above = x - 1, lit = fmin(fmax(above, 0), 1);
        const double edge = lit > 0 && lit < 1 ? 0.011 : 0;
        const double face = fabs(above) < 0.35 || fabs(above - 1) < 0.35 ? 0.4 * 0.65 / 8 : 0;
        const double exact = 3 * ISOTROPIC * slab_radiance(sigma * lit, sigma * lit * root);
        const double tolerance = 3 * ISOTROPIC * sigma * (edge + face) + exact * RIPPLE * 2 + 1e-4;
        if (!CHECK_CASE("Shadows", "roof over a part of a slab of gas", "closed form of the lit part",
                        fabs((double)image_a[4 * i] - exact), tolerance,
                        "half a texel; half of a quarter of a sheet; the slab's soft face"))
            printf("    at x = %g\n", x);
        if (x < 0.6) CHECK(image_a[4 * i] == 0);
    }
}

/* Radiance of a column at x: gas of height 1 over a floor, lit where rays of slope 0.75 pass a roof at 1.5 beyond
   `edge`. */
static double half_lit_column(double x, double edge, double sigma) {
    const double lit = fmin(fmax(0.5 - (1.5 - (x - edge) / 0.75), 0), 1);
    const double surface = x - 0.75 * 2.5 > edge ? exp(-sigma * 2.25) * 0.7 / PI * 3 * 0.8 : 0;
    return 3 * ISOTROPIC * slab_radiance(sigma * lit, 1.25 * sigma * lit) + surface;
}

/* A roof over gas and floor, once of polygons, once of a layer of nearly solid voxels: either shades both. The
   position of the polygons' edge is known to half a texel and to a quarter of a sheet, as above. That of the voxels is
   soft: kernels reach 2.5 / 8 along and up, so 1.25 times that on a slanted ray; a texel of half a voxel and, along the
   eye's ray, a sheet of half a voxel are added. The image lies between those with the edge that far to either side. */
static void test_dense_stand_in(void) {
    for (int voxels = 0; voxels < 2; ++voxels) {
        const double sigma = 0.6, reach = voxels ? 2.5 / 8 * 1.25 + 0.0625 * 1.25 + 0.0625 * 0.75 * 1.2 : 0.011 * 0.75;
        /* light is not followed beyond an optical depth of 16; behind polygons there is none */
        const double left = voxels ? exp(-16.0) * half_lit_column(10, 0, sigma) : 0;
        const double origin[3] = {-3, -1, 1.5}, u[3] = {3, 0, 0}, v[3] = {0, 2, 0};
        check_scene s;
        sps_volume *gas;
        int dark = 0, bright = 0;
        start(&s, 63, 3, 0.15);
        add_square(&ground, 5, -1);
        check_add_mesh(&s, &ground, 0.7);
        gas = add_slab(&s, 45, 8, sigma);
        gas->placement.origin[0] += 1.3;
        check_color(gas->albedo, 1, 1, 1);
        if (voxels) {
            sps_volume *roof = check_add_volume(&s, 24, 16, 1, check_box(-3, -1, 1.5 - 0.0625, 0, 1, 1.5 + 0.0625));
            roof->read_fn = check_read_constant;
            roof->user = &one;
            roof->extinction = 800; /* 100 in total */
        } else {
            check_add_quad(&body, origin, u, v);
            check_add_mesh(&s, &body, 0.5);
        }
        check_add_directional(&s, 0.75, 0, -1, 3);
        s.view.camera.position[0] = s.view.camera.target[0] = 1.5;
        s.view.near_distance = 9.1; /* between the roof and the gas */
        if (!check_render(context, &s, image_a)) return;
        for (int i = 63; i < 126; ++i) {
            const double x = 1.5 + (i - 63 - 31) * 0.05, seen = (double)image_a[4 * i];
            const double low = half_lit_column(x, reach, sigma), high = half_lit_column(x, -reach, sigma);
            const double above = 0.5 - (1.5 - x / 0.75); /* smooth faces, as above */
            const double face =
                fabs(above) < 0.35 + reach / 0.75 || fabs(above - 1) < 0.35 + reach / 0.75 ? 0.4 * 0.65 / 8 : 0;
            const double slack = 3 * ISOTROPIC * sigma * face + high * sigma * 2.25 * RIPPLE + 1e-4 * high + left;
            if (!CHECK_CASE("Shadows", "roof of polygons, and of nearly solid voxels, over gas and a floor",
                            "both between two closed forms", fmax(low - seen, seen - high), slack,
                            "edges known to half a texel and a quarter of a sheet; voxels' kernels"))
                printf("    voxels %d: %g at x = %g, not within %g and %g\n", voxels, seen, x, low - slack,
                       high + slack);
            dark += high <= 0;
            bright += x > 0.75 * 2.5 + reach;
            if (high <= 0) CHECK(seen <= slack);
        }
        CHECK(dark > 3 && bright > 3);
    }
}

/* -------------------------------------------------------------------------------------------- against the reference */

static double blob(const void *user, const double p[3]) {
    const double q[3] = {p[0] + 0.2, p[1] - 0.1, p[2] - 0.1};
    (void)user;
    return exp(-7 * vec_dot(q, q));
}

/* Gas, a ball half inside it, ground, sun and lamp. Edges of shadows on surfaces are steps: of the 40 pixels of an
   edge, half a texel (1/500 of the scene, 1/15 of a pixel) may put one in 15 on the other side, which by sqrt(40 / 15 /
   768) would be 0.06 of the surface's brightness if that step were not mostly the gas's soft one; for the other pixels
   the kernel's floor of 3e-4 holds. So: all pixels except for 8 to 0.004 of the brightest, and RMS 0.01. */
static void test_mixed_scene(void) {
    const double centre[3] = {0.3, -0.2, 0.1};
    check_field field;
    check_scene s;
    sps_volume *gas;
    double most;
    int far = 0;
    start(&s, 32, 24, 1);
    memset(&field, 0, sizeof field);
    field.value_fn = blob;
    add_sphere(&body, centre, 0.35, 6, 1);
    {
        const double origin[3] = {-2, -1, 2}, u[3] = {4, 0, 0}, v[3] = {0, 0, -4};
        check_add_quad(&ground, origin, u, v);
    }
    check_add_mesh(&s, &body, 0.7)->has_normals = 1;
    check_color(check_add_mesh(&s, &ground, 0.5)->albedo, 0.5, 0.6, 0.4);
    gas = check_add_volume(&s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
    gas->eval_fn = check_eval_field;
    gas->user = &field;
    gas->extinction = 3;
    check_color(gas->albedo, 0.9, 0.8, 0.7);
    check_add_directional(&s, 0.6, -1, -0.5, 3);
    check_color(check_add_point(&s, -1.5, 2.5, 2, 1)->color, 4, 6, 9);
    check_set3(s.view.camera.position, 0.7, 1.2, 4);
    check_perspective(&s.view.camera, 0.6);
    s.view.quality = SPS_QUALITY_HIGH;
    s.view.shadow_resolution = 100;
    check_color(s.scene.ambient, 0.1, 0.1, 0.2);
    check_color(s.scene.background, 0.3, 0.4, 0.5);
    if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.5, image_b, NULL)) return;
    most = largest_of(image_b, 4 * 768);
    for (int i = 0; i < 768; ++i) far += check_largest(image_a + 4 * i, image_b + 4 * i, 4) > 0.004 * most;
    printf("mixed scene: error %.2e, %d pixels beyond 0.004\n", check_rms(image_a, image_b, 4 * 768) / most, far);
    CHECK_NEAR(check_rms(image_a, image_b, 4 * 768) / most, 0, 0.01);
    CHECK(far <= 8);
}

int main(void) {
    context = check_context(NULL);
    if (!CHECK(context != NULL)) return check_report();
    RUN(test_flat_shading);
    RUN(test_interpolation);
    RUN(test_two_sided);
    RUN(test_watertight);
    RUN(test_watertight_on_pixels);
    RUN(test_near_distance);
    RUN(test_across_near_plane);
    RUN(test_degenerate);
    RUN(test_shadow_edges);
    RUN(test_no_acne_on_plane);
    RUN(test_convex_body);
    RUN(test_groove);
    RUN(test_fine_steps);
    RUN(test_box_on_floor);
    RUN(test_thin_roof);
    RUN(test_terminator);
    RUN(test_light_in_box);
    RUN(test_closed_box_is_dark);
    RUN(test_polygon_in_slab);
    RUN(test_polygon_slides);
    RUN(test_volume_shadow_on_plane);
    RUN(test_slope_in_slab);
    RUN(test_grazing_places);
    RUN(test_slabs_side_by_side);
    RUN(test_polygon_shadow_in_medium);
    RUN(test_dense_stand_in);
    RUN(test_mixed_scene);
    sps_destroy(context);
    check_free_triangles(&ground);
    check_free_triangles(&body);
    return check_report();
}
