/* Rays through corners and edges of triangles, and rays that pass close by. The number of times that a ray meets a net
   of triangles has no tolerance: once if the net faces the ray everywhere, however the compiler contracts products and
   sums. So this runs in configurations that contract them in different ways. */

#include "check.h"

enum { SIDE = 33, MIDDLE = SIDE / 2 };
static check_triangles net;
static sps_context *context;
static float image[SIDE * SIDE * 4];

/* The sign of a difference of products that doubles cannot represent: (n + 1)(n - 1) is 1 less than n n. */
static void test_signs(void) {
    check_random random = {3};
    for (int i = 0; i < 1000; ++i) {
        const double n = floor(ldexp(1 + check_next(&random), 51)), scale = ldexp(1, i % 200 - 100);
        const double a = scale * (n + 1), b = n - 1, c = scale * n;
        CHECK(spsi_sign_of_difference(a, b, c, n) == -1 && spsi_sign_of_difference(c, n, b, a) == 1);
        CHECK(spsi_sign_of_difference(-a, b, c, n) == -1 && spsi_sign_of_difference(-c, n, a, -b) == -1);
        CHECK(spsi_sign_of_difference(a, b, b, a) == 0 && spsi_sign_of_difference(0, a, b, 0) == 0);
        CHECK(spsi_sign_of_difference(a, b, 0, n) == 1 && spsi_sign_of_difference(b, 0, n, a) == -1);
    }
}

static void add_face(spsi_face *face, const double a[3], const double b[3], const double c[3]) {
    memset(face, 0, sizeof *face);
    memcpy(face->position[0], a, sizeof face->position[0]);
    memcpy(face->position[1], b, sizeof face->position[1]);
    memcpy(face->position[2], c, sizeof face->position[2]);
}

/* The number of faces in front of the eye that the ray of a pixel meets. Their boxes must contain the pixel, too. */
static int count_hits(const spsi_rays *rays, const spsi_face *list, int count, int x, int y) {
    spsi_faces faces;
    int hits = 0;
    faces.list = list;
    faces.count = count;
    for (int i = 0; i < count; ++i) {
        spsi_edges edges;
        double w[3];
        int box[4], x0, x1;
        spsi_face_edges(&faces, i, rays, &edges);
        if (!spsi_face_hit(&edges, x, y, w)) continue;
        if (!(w[0] * edges.corner[0][2] + w[1] * edges.corner[1][2] + w[2] * edges.corner[2][2] > 0)) continue;
        CHECK(w[0] >= 0 && w[1] >= 0 && w[2] >= 0 && fabs(w[0] + w[1] + w[2] - 1) < 1e-15);
        spsi_face_box(&faces, i, rays, box);
        x0 = box[0];
        x1 = box[2];
        spsi_face_span(&edges, y, &x0, &x1);
        if (!CHECK(x0 <= x && x <= x1 && box[1] <= y && y <= box[3])) printf("    pixel %d %d of %d\n", x, y, i);
        ++hits;
    }
    return hits;
}

static spsi_rays look(const double eye[3], const double at[3], double field_of_view, double height) {
    sps_view view;
    spsi_rays rays;
    memset(&view, 0, sizeof view);
    memset(&rays, 0, sizeof rays);
    memcpy(view.camera.position, eye, sizeof view.camera.position);
    memcpy(view.camera.target, at, sizeof view.camera.target);
    view.camera.up[1] = 1;
    view.width = view.height = rays.width = rays.height = SIDE;
    check_orthographic(&view.camera, height);
    check_perspective(&view.camera, field_of_view);
    CHECK(spsi_rays_from_camera(&rays, &view.camera));
    return rays;
}

/* Fans around a corner at which the camera is aimed, up to round-off. Corners of the rim surround it, in front of and
   behind the eye, and edges of each triangle have any order. One ray passes as near as round-off permits, others all
   around. */
static void test_fans(void) {
    check_random random = {5};
    int missed = 0, twice = 0;
    for (int n = 0; n < 3000; ++n) {
        const int blades = 3 + n % 6, orthographic = n % 4 == 3, behind = n % 4 == 1;
        double eye[3], middle[3], rim[9][3], shift = n % 5 == 4 ? 1000 : 0;
        spsi_face list[8];
        spsi_rays rays;
        for (int k = 0; k < 3; ++k) {
            middle[k] = (double)(float)(shift + 8 * check_next(&random));
            eye[k] = middle[k] + 4 * check_next(&random) + (k == 2 ? 3 : -2);
        }
        rays = look(eye, middle, orthographic ? 0 : 0.3 + check_next(&random), 1 + check_next(&random));
        for (int i = 0; i < blades; ++i) {
            const double turn = 2 * PI * (i + 0.4 * check_next(&random)) / blades;
            const double away = (check_next(&random) - 0.5) * 6 + (behind && i % 2 ? 12 : 0);
            for (int k = 0; k < 3; ++k)
                rim[i][k] = middle[k] + SIDE * 4 * (cos(turn) * rays.a[k] + sin(turn) * rays.b[k]) * (behind ? 9 : 1) +
                            away * (eye[k] - middle[k]) / 6;
        }
        memcpy(rim[blades], rim[0], sizeof rim[0]);
        for (int i = 0; i < blades; ++i) {
            const double *corner[3] = {middle, rim[i], rim[i + 1]};
            const int first = (int)(3 * check_next(&random)), step = check_next(&random) < 0.5 ? 1 : 2;
            add_face(&list[i], corner[first], corner[(first + step) % 3], corner[(first + 2 * step) % 3]);
        }
        for (int y = -1; y <= 1; ++y)
            for (int x = -1; x <= 1; ++x) {
                const int hits = count_hits(&rays, list, blades, MIDDLE + x, MIDDLE + y);
                missed += hits < 1;
                twice += hits > 1;
            }
    }
    if (!CHECK_CASE("Found in review", "rays at a vertex of a closed mesh, however edges lie",
                    "each meets one triangle", missed + twice, 0, "exact signs"))
        printf("    missed %d, met twice %d\n", missed, twice);
}

/* Rays exactly through corners and along edges, without round-off: a ground of whole-numbered corners, below the eye
   and on both sides of its plane. The ray of pixel (x, y) meets it 16 / y ahead, a whole number for some. */
static void test_ground_of_whole_numbers(void) {
    static spsi_face list[2 * 40 * 48];
    spsi_rays rays;
    int count = 0, corners = 0;
    memset(&rays, 0, sizeof rays);
    rays.perspective = 1;
    rays.width = SIDE;
    rays.height = SIDE;
    rays.a[0] = rays.b[1] = rays.c[2] = 1;
    rays.c[0] = -MIDDLE;
    CHECK(spsi_rays_complete(&rays));
    for (int z = -8; z < 40; ++z)
        for (int x = -20; x < 20; ++x) {
            const double stretch = 16, from[3] = {x * stretch, 16, (double)z};
            const double aside[3] = {(x + 1) * stretch, 16, (double)z}, ahead[3] = {x * stretch, 16, z + 1.0};
            const double across[3] = {(x + 1) * stretch, 16, z + 1.0};
            const int turned = (x + z) & 1;
            add_face(&list[count++], from, aside, turned ? across : ahead);
            add_face(&list[count++], ahead, across, turned ? from : aside);
        }
    for (int y = 1; y < SIDE; ++y) /* row 0 looks at the horizon */
        for (int x = 0; x < SIDE; ++x) {
            const double z = 16.0 / y, at = (x - MIDDLE) * z;
            if (!CHECK(count_hits(&rays, list, count, x, y) == 1)) printf("    pixel %d %d\n", x, y);
            corners += z == floor(z) && fmod(at, 16) == 0;
        }
    CHECK(corners > 10);
}

/* Orthographic pixels on corners: half of all edges run along rows and columns of pixels. */
static void test_squares_on_pixels(void) {
    static spsi_face list[2 * 16 * 16];
    spsi_rays rays;
    int count = 0;
    memset(&rays, 0, sizeof rays);
    rays.width = rays.height = SIDE;
    rays.a[0] = rays.b[1] = rays.c[2] = 1;
    CHECK(spsi_rays_complete(&rays));
    for (int y = 0; y < SIDE - 1; y += 2)
        for (int x = 0; x < SIDE - 1; x += 2) {
            const double p[4][3] = {
                {(double)x, (double)y, 1}, {x + 2.0, (double)y, 2}, {x + 2.0, y + 2.0, 1}, {(double)x, y + 2.0, 3}};
            const int turn = (x / 2 + y) % 4;
            add_face(&list[count++], p[turn], p[(turn + 1) % 4], p[(turn + 2) % 4]);
            add_face(&list[count++], p[turn], p[(turn + 3) % 4], p[(turn + 2) % 4]);
        }
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x) {
            const int hits = count_hits(&rays, list, count, x, y),
                      rim = x == 0 || y == 0 || x == SIDE - 1 || y == SIDE - 1;
            if (!CHECK(rim ? hits <= 1 : hits == 1)) printf("    pixel %d %d: %d\n", x, y, hits);
        }
}

/* Triangles of all sizes, some of which reach behind the eye, or are seen edge-on: the result with the corners in any
   order, and the pixels of boxes and spans, are the same; the plane is met where long doubles say. */
static void test_any_triangle(void) {
    static const double origin[3] = {0, 0, 0}, ahead[3] = {0, 0, -1};
    const spsi_rays rays = look(origin, ahead, 1, 0);
    check_random random = {9};
    int hits = 0;
    for (int n = 0; n < 1500; ++n) {
        const double size = pow(10, 8 * check_next(&random) - 4);
        double p[3][3];
        spsi_face face, turned;
        for (int k = 0; k < 9; ++k) p[k / 3][k % 3] = size * (check_next(&random) - 0.5);
        if (n % 7 == 0) /* through the eye, nearly */
            for (int k = 0; k < 3; ++k) p[2][k] = 0.3 * p[0][k] - 0.8 * p[1][k];
        add_face(&face, p[0], p[1], p[2]);
        add_face(&turned, p[2], p[1], p[0]);
        for (int i = 0; i < 60; ++i) {
            const int x = (int)(SIDE * check_next(&random)), y = (int)(SIDE * check_next(&random));
            const int here = count_hits(&rays, &face, 1, x, y);
            double d[3], u[3], v[3], w[3], side[3];
            CHECK(here == count_hits(&rays, &turned, 1, x, y));
            hits += here;
            spsi_ray_direction(&rays, x, y, d);
            vec_cross(p[1], p[2], u);
            vec_cross(p[2], p[0], v);
            vec_cross(p[0], p[1], w);
            side[0] = vec_dot(u, d);
            side[1] = vec_dot(v, d);
            side[2] = vec_dot(w, d);
            if (fabs(side[0]) < 1e-9 * size * size || fabs(side[1]) < 1e-9 * size * size ||
                fabs(side[2]) < 1e-9 * size * size || n % 7 == 0)
                continue;
            { /* all of the sign of the determinant: the ray meets the triangle, and does so before the eye */
                const double whole = vec_dot(p[0], u);
                CHECK(here == (side[0] * whole > 0 && side[1] * whole > 0 && side[2] * whole > 0));
            }
        }
    }
    CHECK(hits > 500);
}

/* Triangles in the plane of a row of pixels, seen edge-on except for round-off, with corners near and far: whether a
   ray meets them is decided by all three exact signs, even if there is no single point of intersection. */
static void test_edge_on(void) {
    static const double origin[3] = {0.1, 0.2, 0.3}, ahead[3] = {0.4, -0.3, -1};
    const spsi_rays rays = look(origin, ahead, 1, 0);
    check_random random = {13};
    int hits = 0;
    for (int n = 0; n < 20000; ++n) {
        const int y = (int)(SIDE * check_next(&random));
        const double off = pow(10, -9 - n % 8); /* a row is about 32, with a round-off of 4e-15 */
        double p[3][3];
        spsi_face face;
        spsi_faces faces;
        spsi_edges edges;
        for (int i = 0; i < 3; ++i) {
            double d[3];
            spsi_ray_direction(&rays, SIDE * check_next(&random), y + off * (check_next(&random) - 0.5), d);
            vec_along(origin, d, pow(10, 6 * check_next(&random) - 3), p[i]);
        }
        add_face(&face, p[0], p[1], p[2]);
        faces.list = &face;
        faces.count = 1;
        spsi_face_edges(&faces, 0, &rays, &edges);
        for (int x = 0; x < SIDE; x += 4) {
            double w[3];
            const int met = spsi_face_hit(&edges, x, y, w);
            if (!CHECK(met == spsi_face_hit_exactly((const double(*)[3])edges.corner, edges.side, x, y)))
                printf("    row %d pixel %d of %d\n", y, x, n);
            hits += met;
        }
    }
    CHECK(hits > 100);
}

/* A triangle as a face, and its bounds on screen. */
static void box_of(const double p[3][3], const spsi_rays *rays, spsi_face *face, int box[4]) {
    spsi_faces faces;
    add_face(face, p[0], p[1], p[2]);
    faces.list = face;
    faces.count = 1;
    spsi_face_box(&faces, 0, rays, box);
}

/* Screen bounds of a triangle that reaches behind the eye. */
static void test_boxes_behind(void) {
    static const double origin[3] = {0, 0, 0}, ahead[3] = {0, 0, -1};
    const spsi_rays rays = look(origin, ahead, 1, 0);
    int large = 0;
    for (int x = -200; x < 200; ++x) {
        /* a strip across the eye's plane, 1 below: squares of 1, which see the screen only in the middle. Its height is
           +-0.55 at 1 ahead, so that on it the ground is seen from 1.8 ahead on. */
        const double p[3][3] = {{(double)x, -1, -0.5}, {x + 1.0, -1, -0.5}, {(double)x, -1, 0.5}};
        spsi_face face;
        int box[4];
        box_of(p, &rays, &face, box);
        large += box[2] >= box[0] && box[3] >= box[1];
    }
    CHECK(large == 0); /* at 0.5 ahead it is at 2, below the image, and runs further down from there */
    for (int side = 0; side < 2; ++side) { /* from the image's middle to the left, or right, and behind the eye */
        const double x = side ? 1 : -1, p[3][3] = {{0, 0, -2}, {x, 0.1, 1}, {x, -0.1, 1}};
        spsi_face face;
        int box[4];
        box_of(p, &rays, &face, box);
        CHECK(box[0] == (side ? MIDDLE : 0) && box[2] == (side ? SIDE - 1 : MIDDLE));
        CHECK(box[1] == 0 && box[3] == SIDE - 1);
        CHECK(count_hits(&rays, &face, 1, MIDDLE + (side ? 9 : -9), MIDDLE) == 1);
    }
    {
        const double p[3][3] = {{0, 0, 1}, {1, 0.1, 1}, {1, -0.1, 0}};
        spsi_face face;
        int box[4];
        box_of(p, &rays, &face, box);
        CHECK(box[2] < box[0]);
    }
}

/* The square +-60 in 18 x 18 squares, so that a corner is at (0, 0, 0). */
static void add_squares(void) {
    net.count = 0;
    for (int j = -9; j < 9; ++j)
        for (int i = -9; i < 9; ++i) {
            const double w = 60.0 / 9, origin[3] = {i * w, j * w, 0}, u[3] = {(i + 1) * w, j * w, 0};
            const double both[3] = {(i + 1) * w, (j + 1) * w, 0}, v[3] = {i * w, (j + 1) * w, 0};
            check_add_corners(&net, origin, u, both);
            check_add_corners(&net, origin, both, v);
        }
}

/* Whole pictures, and maps that count triangles, from positions aimed at a corner. */
static void test_pictures_and_maps(void) {
    check_random random = {1};
    int holes = 0, wrong = 0;
    add_squares();
    for (int n = 0; n < 300; ++n) {
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        check_add_mesh(&s, &net, 0.8);
        for (int k = 0; k < 2; ++k) s.view.camera.position[k] = floor(121 * check_next(&random) - 60) / 10;
        s.view.camera.position[2] = 6 + floor(40 * check_next(&random)) / 10;
        check_perspective(&s.view.camera, 0.7);
        if (!check_render(context, &s, image)) return;
        for (int i = 0; i < SIDE * SIDE; ++i) holes += image[4 * i + 3] < 1;
        if (n % 10 == 0) {
            const sps_tmap_light light = check_light_of(&s.view);
            sps_tmap_settings settings;
            sps_tmap *map;
            memset(&settings, 0, sizeof settings);
            settings.technique = SPS_TMAP_DEEP;
            settings.far_depth = 60;
            check_translucent(&s.mesh[0], 0.5);
            if (!CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map))) return;
            if (!CHECK_OK(context, sps_tmap_add(map, &s.scene)) || !CHECK_OK(context, sps_tmap_finish(map))) return;
            for (int i = 0; i < SIDE * SIDE; ++i) wrong += sps_tmap_starts(map)[i + 1] - sps_tmap_starts(map)[i] != 1;
            sps_tmap_destroy(map);
        }
    }
    if (!CHECK_CASE("Extremes", "shared edges and corners of a net, in 300 pictures and 30 maps",
                    "no hole, every texel's ray counts once", holes + wrong, 0, "exact signs"))
        printf("    %d holes, %d texels\n", holes, wrong);
}

/* From inside a closed body, in all directions, towards its corners and the middles of its edges: no light leaks in.
   The body has 8 faces around any point, in any orientation: its corners have been rounded, as floats and by rotation.
 */
static void test_closed_body(void) {
    check_random random = {2};
    int holes = 0;
    for (int n = 0; n < 120; ++n) {
        check_scene s;
        double corner[6][3], turn[3][3], target[3];
        const int edge = n % 2, from = n % 6, to = (n % 6 + 2) % 6;
        net.count = 0;
        check_clear(&s, SIDE, SIDE);
        for (int k = 0; k < 3; ++k) turn[0][k] = check_next(&random) - 0.5;
        vec_normalise(turn[0]);
        vec_basis(turn[0], turn[1], turn[2]);
        for (int i = 0; i < 6; ++i)
            for (int k = 0; k < 3; ++k) corner[i][k] = (double)(float)((i % 2 ? -2 : 2) * turn[i / 2][k]);
        for (int i = 0; i < 8; ++i)
            check_add_corners(&net, corner[i & 1], corner[2 + (i >> 1 & 1)], corner[4 + (i >> 2)]);
        for (int k = 0; k < 3; ++k) target[k] = edge ? (corner[from][k] + corner[to][k]) / 2 : corner[from][k];
        for (int k = 0; k < 3; ++k) s.view.camera.position[k] = 0.7 * (check_next(&random) - 0.5);
        memcpy(s.view.camera.target, target, sizeof target);
        check_perspective(&s.view.camera, 0.2 + 2.5 * check_next(&random));
        check_add_mesh(&s, &net, 0.8);
        if (!check_render(context, &s, image)) return;
        for (int i = 0; i < SIDE * SIDE; ++i) holes += image[4 * i + 3] < 1;
    }
    if (!CHECK_CASE("Found in review", "closed body from within, looking at its corners and edges", "no light leaks in",
                    holes, 0, "exact signs"))
        printf("    %d holes\n", holes);
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_signs);
    RUN(test_fans);
    RUN(test_ground_of_whole_numbers);
    RUN(test_squares_on_pixels);
    RUN(test_any_triangle);
    RUN(test_edge_on);
    RUN(test_boxes_behind);
    RUN(test_pictures_and_maps);
    RUN(test_closed_body);
    sps_destroy(context);
    check_free_triangles(&net);
    return check_report();
}
