/* Interactions of two features, and rarely used ones, each against an exact answer. */

#include "check.h"

#define RIPPLE 0.002 /* of a constant grid's optical depth, for high quality: see test_ripple in test_transport.c */

enum { SIDE = 24, PIXELS = SIDE * SIDE };
static float image_a[4 * PIXELS], image_b[4 * PIXELS], image_c[4 * PIXELS];
static sps_context *context;
static check_triangles ground, body;
static float one = 1;

static void start(check_scene *s, int width, int height, double ortho_height) {
    check_clear(s, width, height);
    check_orthographic(&s->view.camera, ortho_height);
    s->view.quality = SPS_QUALITY_HIGH;
    ground.count = body.count = 0;
}

/* The square |x|, |y| <= half at height z + slope y. */
static void add_square(check_triangles *triangles, double half, double z, double slope) {
    const double origin[3] = {-half, -half, z - slope * half}, u[3] = {2 * half, 0, 0};
    const double v[3] = {0, 2 * half, 2 * half * slope};
    check_add_quad(triangles, origin, u, v);
}

/* The box of value 1, |x|, |y| < half, in voxels of 0.1 units. */
static sps_volume *add_gas(check_scene *s, double half, double z0, double z1, double extinction) {
    const int side = (int)(20 * half + 0.5), layers = (int)(10 * (z1 - z0) + 0.5);
    sps_volume *volume = check_add_volume(s, side, side, layers, check_box(-half, -half, z0, half, half, z1));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)extinction;
    return volume;
}

/* --------------------------------------------------------------------------------------------------------- polygons */

/* Corner normals of a scaled, rotated and sheared mesh transform by the inverse transpose. */
static void test_normals_stretched(void) {
    static const double axes[3][3][3] = {{{4, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                         {{1, 0, 0}, {0, 1, 0}, {0, 0, 0.2}},
                                         {{2, 0.3, 0}, {-0.5, 1, 0.7}, {0.6, 0, 1.5}}};
    for (int n = 0; n < 3; ++n)
        for (int side = 0; side < 4; ++side) {
            const double local[3] = {side & 1 ? 0.7 : -0.2, side & 2 ? -0.5 : 0.3, 1};
            double rows[3][3], normal[3] = {0, 0, 0}, exact;
            check_scene s;
            sps_mesh *mesh;
            start(&s, 3, 3, 0.1);
            add_square(&body, 9, 0, 0);
            for (size_t i = 0; i < body.count; ++i)
                for (int k = 0; k < 9; ++k) body.list[i].normal[k / 3][k % 3] = (float)local[k % 3];
            mesh = check_add_mesh(&s, &body, 0.5);
            mesh->has_normals = 1;
            memcpy(mesh->placement.axis, axes[n], sizeof axes[n]);
            check_add_directional(&s, 0.2, 0.1, -1, 3)->no_shadow = 1;
            if (!check_render(context, &s, image_a) || !check_march(context, &s, 1, image_b, NULL)) return;
            CHECK(spsi_invert(axes[n][0], axes[n][1], axes[n][2], rows));
            for (int i = 0; i < 3; ++i) /* n' . (A p) = n . p for all p */
                vec_along(normal, rows[i], (double)(float)local[i], normal);
            exact = 0.5 / PI * 3 * (-0.2 * normal[0] - 0.1 * normal[1] + normal[2]) / vec_length(normal) / sqrt(1.05);
            CHECK_CASE("Found in review", "normals of a stretched and sheared mesh", "the inverse transpose's",
                       fabs((double)image_a[16] - exact), 1e-6, "a few roundings of floats");
            CHECK_NEAR((double)image_b[16], exact, 1e-6);
        }
}

/* A slanted plate from in front of the nearer of two clouds to behind the farther one: it is seen at every depth,
   through the gas in front of it, in both compositing orders. */
static void test_behind_a_chunk(void) {
    const double sigma = 0.8, reach = 3 * 0.1; /* kernels of voxels at a face end 2.5 voxels beyond it, at most 3 */
    for (int n = 0; n < 3; ++n) {
        int seen[3] = {0, 0, 0};
        check_scene s;
        start(&s, 3, PIXELS / 3, 9);
        add_gas(&s, 5, 1.6, 2.6, sigma);
        add_gas(&s, 5, -2.6, -1.6, sigma);
        if (n == 2) s.view.quality = SPS_QUALITY_MEDIUM;
        add_square(&body, 5, 0, 0.75); /* from -3.4 to 3.4 */
        check_add_mesh(&s, &body, 0.5);
        check_color(s.scene.ambient, 1, 1, 1);
        check_color(s.scene.background, 9, 9, 9);
        check_add_directional(&s, 0, 0, n == 1 ? 1 : -1, 1e-9);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i) {
            const double y = ((PIXELS / 3 - 1) / 2.0 - i / 3) * 9 / (PIXELS / 3), z = 0.75 * y;
            const int place = z > 2.6 + reach ? 0 : fabs(z) < 1.6 - reach ? 1 : z < -2.6 - reach ? 2 : -1;
            const double tau = sigma * place, ripple = n == 2 ? 0.0037 : RIPPLE;
            if (!CHECK(image_a[4 * i + 3] > 0.999f)) printf("    plate at %g, way %d\n", z, n);
            if (place < 0) continue;
            ++seen[place];
            if (!CHECK_CASE("Found in review", "plate from before two clouds to behind them",
                            "seen at every depth, through exp(-depth)", fabs((double)image_a[4 * i] - 0.5 * exp(-tau)),
                            0.5 * exp(-tau) * tau * ripple + 1e-5, "ripple"))
                printf("    plate at %g, way %d\n", z, n);
        }
        CHECK(seen[0] > 20 && seen[1] > 100 && seen[2] > 20);
    }
}

/* -------------------------------------------------------------------------------------------------------- reference */

/* A plate behind a point light shades nothing, neither a ground nor a thin gas above it; one in front of it does. */
static void test_behind_the_light(void) {
    for (int n = 0; n < 3; ++n) { /* no plate; behind the light; in front of it */
        check_scene s;
        start(&s, 5, 5, 1);
        add_square(&ground, 4, 0, 0);
        check_add_mesh(&s, &ground, 0.6);
        if (n) add_square(&body, 9, n == 1 ? 3 : 1, 0);
        if (n) check_add_mesh(&s, &body, 0.6);
        check_color(add_gas(&s, 1, 0.3, 0.6, 1e-3)->albedo, 1, 1, 1);
        check_add_point(&s, 0, 0, 2, 5);
        s.view.near_distance = 9.2; /* from 10: plates are not seen */
        if (!check_march(context, &s, 0.25, n == 1 ? image_b : n ? image_c : image_a, NULL)) return;
    }
    CHECK_CASE("Found in review", "plate behind a point light, in the reference", "the picture without it",
               memcmp(image_a, image_b, 25 * 4 * sizeof(float)) != 0, 0, "same bits");
    for (int i = 0; i < 25; ++i) {
        const double x = (i % 5 - 2) / 5.0, y = (i / 5 - 2) / 5.0, square = x * x + y * y + 4;
        /* gas absorbs at most 2 tau, and scatters less than tau times the intensity over 4 pi and the nearest square */
        const double exact = 0.6 / PI * 5 * 2 / (square * sqrt(square)), tau = 1e-3 * 0.8;
        CHECK_NEAR((double)image_b[4 * i], exact, exact * 2.2 * tau + 5 / (4 * PI) / (1.1 * 1.1) * tau);
        CHECK(image_c[4 * i] <= 0);
    }
}

/* Lights that are black, without shadow, or both, above a plate above the ground. */
static void test_lights_of_the_reference(void) {
    check_scene s;
    start(&s, 5, 5, 1);
    add_square(&ground, 4, 0, 0);
    add_square(&body, 9, 3, 0);
    check_add_mesh(&s, &ground, 0.6);
    check_add_mesh(&s, &body, 0.6);
    s.view.near_distance = 9;
    check_add_directional(&s, 0, 0, -1, 7); /* in shadow */
    check_add_directional(&s, 0, 0, -1, 0);
    check_add_directional(&s, 0.6, 0, -0.8, 2)->no_shadow = 1;
    check_add_directional(&s, 0, 0, -1, 0)->no_shadow = 1;
    check_add_point(&s, 0, 0, 5, 0);
    check_add_point(&s, 0, 0, 5, 4)->no_shadow = 1;
    check_color(s.scene.ambient, 0.1, 0.1, 0.1);
    if (!check_march(context, &s, 1, image_a, NULL) || !check_render(context, &s, image_b)) return;
    for (int i = 0; i < 25; ++i) {
        const double x = (i % 5 - 2) / 5.0, y = (i / 5 - 2) / 5.0, square = x * x + y * y + 25;
        const double exact = 0.6 * (0.1 + (2 * 0.8 + 4 * 5 / (square * sqrt(square))) / PI);
        CHECK_CASE("Found in review", "polygons of the reference under black and unshadowed lights", "closed form",
                   fabs((double)image_a[4 * i] - exact), 1e-6, "a few roundings of floats");
        CHECK_NEAR((double)image_b[4 * i], exact, 1e-6);
    }
    s.view.no_shadows = 1; /* the first one, too */
    if (!check_march(context, &s, 1, image_c, NULL)) return;
    for (int i = 0; i < 25; ++i) CHECK_NEAR((double)image_c[4 * i], (double)image_a[4 * i] + 0.6 / PI * 7, 2e-6);
}

static sps_particle balls[3];

static int read_balls(void *user, size_t first, size_t count, sps_particle *out) {
    (void)user;
    memcpy(out, balls + first, count * sizeof *out);
    return 0;
}

/* Particles by extinction equal those by optical depth, over a diameter of 2 r, or 4 r / 3 for soft ones; a ray through
   the centre of one of each kind meets all of it. */
static void test_extinction_of_balls(void) {
    for (int soft = 0; soft < 2; ++soft) {
        sps_particles set;
        for (int by = 0; by < 2; ++by) {
            check_scene s;
            start(&s, SIDE - 1, SIDE - 1, 2); /* odd: a pixel in the middle */
            memset(&set, 0, sizeof set);
            for (int i = 0; i < 3; ++i) {
                const double radius = 0.4 + 0.2 * i, depth = 0.5 + i, along = radius * (soft ? 4.0 / 3 : 2);
                balls[i].radius = (float)radius;
                balls[i].optical_depth = (float)(by ? depth / along : depth);
                balls[i].position[0] = 0.3f * (float)(i - 1);
                balls[i].position[2] = -2.0f * (float)i;
            }
            balls[0].position[0] = balls[2].position[0] = 0;
            balls[1].position[0] = 0.7f; /* beyond the middle */
            set.count = 3;
            set.read_fn = read_balls;
            set.soft = soft;
            set.is_extinction = by;
            check_color(set.emission, 0.7, 0.7, 0.7);
            s.scene.particles = &set;
            s.scene.particle_set_count = 1;
            if (!check_march(context, &s, 0.5, by ? image_b : image_a, NULL)) return;
        }
        /* optical depths are floats, 6e-8 off each, and so is the result, which is at most 1 */
        CHECK_CASE("Found in review", "particles by extinction, in the reference", "those of the same optical depth",
                   check_largest(image_a, image_b, 4 * (SIDE - 1) * (SIDE - 1)), 3e-7,
                   "three depths in floats, 6e-8 each");
        CHECK_NEAR((double)image_b[4 * ((SIDE - 1) * (SIDE - 1) / 2) + 3], -expm1(-0.5 - 2.5), 1e-6);
    }
}

static int read_one_voxel(void *user, const int lo[3], const int size[3], float *out) {
    const int at = *(const int *)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i) *out++ = lo[0] + i == at && lo[1] + j == at && lo[2] + k == at;
    return 0;
}

/* One voxel, surrounded by numbers of empty ones that move it through a brick of 8 voxels: its kernel reaches into each
   of the 26 bricks around its own, and the reference must look there. Steps stay in place. */
static void test_bricks_of_the_reference(void) {
    for (int pad = 0; pad < 8; ++pad) {
        const int side = 16 + 2 * pad;
        const double half = side / 16.0; /* voxels of 1/8 */
        int at = 7 + pad;
        check_scene s;
        sps_volume *volume;
        start(&s, SIDE, SIDE, 1);
        volume = check_add_volume(&s, side, side, side, check_box(-half, -half, -half, half, half, half));
        volume->read_fn = read_one_voxel;
        volume->user = &at;
        volume->extinction = 30;
        check_color(volume->emission, 1, 1, 1);
        if (!check_march(context, &s, 0.25, pad ? image_b : image_a, NULL)) return;
        if (pad && !CHECK(check_largest(image_a, image_b, 4 * PIXELS) < 1e-6)) printf("    padded by %d\n", pad);
    }
    CHECK((double)image_a[4 * (PIXELS / 2 + SIDE / 2)] > 0.01);
}

/* The distance of a thin layer is that of its middle, less tau / 12 of its thickness, since its front hides a little of
   its back. The content of a step counts at the step's middle. Distances are floats: 1e-6 at 10. */
static void test_distance_of_a_layer(void) {
    const double tau = 1e-4;
    for (int steps = 1; steps <= 4; ++steps) {
        check_scene s;
        start(&s, 3, 3, 0.1);
        add_gas(&s, 0.5, -0.4, 0.4, tau / 0.8);
        if (!check_march(context, &s, 1.0 / steps, image_a, image_b)) return;
        CHECK_CASE("Extremes", "distance of a layer of depth 1e-4, in the reference", "its middle",
                   fabs((double)image_b[4] - 10), 0.8 * tau / 12 + 2e-6,
                   "its front hides tau / 12 of it; floats of 10");
    }
}

/* From a hundred thousand times farther away, with a proportionally narrower lens, everything looks as without
   perspective. Depths are relative to the scene's middle; where a kernel is cut, floats relative to the eye are still
   used, which round by 0.03 there: 9 % of the light if extinction is 3. Depths relative to the eye throughout would be
   off by 40 %. */
static void test_distant_eye(void) {
    const double far_away = 1e6;
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        sps_volume *gas;
        start(&s, SIDE, SIDE, 1);
        add_square(&body, 0.3, 0.02, 0.2);
        add_square(&ground, 2, -0.5, 0);
        check_add_mesh(&s, &body, 0.5);
        check_add_mesh(&s, &ground, 0.8);
        gas = add_gas(&s, 0.5, -0.4, 0.4, 3);
        check_color(gas->albedo, 0.9, 0.9, 0.9);
        check_add_point(&s, 0.3, 0.2, 3, 5);
        s.view.camera.position[2] = n ? far_away : 10;
        check_perspective(&s.view.camera, n ? 2 * atan(0.5 / far_away) : 0);
        check_orthographic(&s.view.camera, n ? 0 : 1);
        if (!check_render(context, &s, n ? image_b : image_a)) return;
    }
    for (int i = 0; i < 4 * PIXELS; ++i)
        CHECK_NEAR((double)image_b[i], (double)image_a[i], 0.09 * (double)image_a[i] + 1e-6);
}

/* --------------------------------------------------------------------------------------------- volumes side by side */

/* Gas that only emits, in front of, behind and within gas that only absorbs: g l exp(-tau), and where they share a
   interval of length l, g l (1 - exp(-tau)) / tau. */
static void test_glow_beside_dust(void) {
    for (int place = 0; place < 3; ++place)
        for (int lit = 0; lit < 2; ++lit) {
            const double glow = 0.9, sigma = 1.3, z = place == 0 ? 2 : place == 1 ? -3.6 : -0.8, tau = sigma * 1.6;
            const double exact = glow * 1.6 * (place == 0 ? 1 : place == 1 ? exp(-tau) : -expm1(-tau) / tau);
            sps_volume *volume;
            check_scene s;
            start(&s, 5, 5, 0.2);
            volume = add_gas(&s, 1.5, z, z + 1.6, 0);
            check_color(volume->emission, glow, glow, glow);
            add_gas(&s, 1.5, -0.8, 0.8, sigma);
            if (lit) check_add_directional(&s, 0.3, 0, -1, 2); /* nothing scatters it */
            if (!check_render(context, &s, image_a) || !check_march(context, &s, 0.25, image_b, NULL)) return;
            /* Soft faces and thick slabs do not matter: where the gases overlap, emission and extinction rise and fall
               together, and only their sums count; elsewhere they are twelve voxels apart. What remains is the ripple
               of emission and extinction, and the reference's steps of 0.025, whose midpoints are off by (0.025
               sigma)^2 / 24. */
            for (int i = 0; i < 25; ++i) {
                const double room = exact * ((1 + tau) * RIPPLE + 0.025 * 0.025 * sigma * sigma / 24);
                CHECK_CASE("Found in review", "gas that only emits before, behind and within gas that absorbs",
                           "closed form", fabs((double)image_a[4 * i] - exact), room, "ripple of both");
                CHECK_NEAR((double)image_b[4 * i], exact, room);
                CHECK_NEAR((double)image_a[4 * i + 3], -expm1(-tau), exp(-tau) * tau * RIPPLE + 1e-5);
            }
        }
}

static double dome(const void *user, const double p[3]) {
    const double x = p[0] - *(const double *)user, square = x * x + p[1] * p[1] + p[2] * p[2];
    return 0.9 * exp(-3 * square);
}

static const sps_transfer_point soft_points[2] = {{0.1f, {0.9f, 0.3f, 0.2f}, 0, {0, 0, 0}},
                                                  {0.9f, {0.2f, 0.4f, 0.9f}, 6, {0, 0, 0}}};
static const sps_transfer_point hard_points[3] = {{0.3f, {0.3f, 0.8f, 0.3f}, 0, {0, 0, 0}},
                                                  {0.4f, {0.8f, 0.8f, 0.2f}, 12, {0, 0, 0}},
                                                  {0.9f, {0.9f, 0.9f, 0.9f}, 12, {0, 0, 0}}};

/* `first` and `second`: which of the two exist. */
static int render_classified(int first, int second, int march, float *image) {
    static const double places[2] = {-1.1, 1.1};
    static check_field fields[2];
    sps_transfer transfers[2];
    check_scene s;
    start(&s, SIDE, SIDE, 4.6);
    memset(transfers, 0, sizeof transfers);
    for (int i = 0; i < 2; ++i) {
        const double x = places[i];
        sps_volume *volume;
        if (!(i ? second : first)) continue;
        fields[i].value_fn = dome;
        fields[i].user = &places[i];
        transfers[i].points = i ? hard_points : soft_points;
        transfers[i].point_count = i ? 3 : 2;
        volume = check_add_volume(&s, 22, 22, 22, check_box(x - 1.1, -1.1, -1.1, x + 1.1, 1.1, 1.1));
        volume->eval_fn = check_eval_field;
        volume->user = &fields[i];
        volume->transfer = &transfers[i];
        volume->shading = i ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
        volume->specular = i ? 0.3f : 0;
    }
    check_add_directional(&s, 0.5, -0.3, -1,
                          3); /* from the first to the second, which is shaded by the first beside it */
    check_color(s.scene.ambient, 0.2, 0.2, 0.2);
    return march ? check_march(context, &s, 0.5, image, NULL) : check_render(context, &s, image);
}

/* A classified gas beside a classified surface: together no farther from the reference than each by itself. The shadow
   of one on the other adds the error of the light's optical depth, which is less than that of the eye's: so the mean
   squares of both are allowed, twice. Each by itself is held to 1 % of the maximum radiance, about 1. */
static void test_classified_together(void) {
    double alone[2], together;
    for (int i = 0; i < 2; ++i) {
        if (!render_classified(!i, i, 0, image_a) || !render_classified(!i, i, 1, image_b)) return;
        alone[i] = check_rms(image_a, image_b, 4 * PIXELS);
    }
    if (!render_classified(1, 1, 0, image_a) || !render_classified(1, 1, 1, image_b)) return;
    together = check_rms(image_a, image_b, 4 * PIXELS);
    if (!CHECK_CASE("Found in review", "classified gas beside a classified surface", "brute force, rms", together,
                    sqrt(2 * (alone[0] * alone[0] + alone[1] * alone[1])),
                    "the squares of both alone, and as much for the light between them"))
        printf("    together %g, alone %g and %g\n", together, alone[0], alone[1]);
    if (getenv("CHECK_TIMES"))
        printf("classified: together %.5f, gas %.5f, surface %.5f\n", together, alone[0], alone[1]);
    for (int i = 0; i < 2; ++i) CHECK(alone[i] < 0.01);
}

/* A dome of classified matter, visible where its value is above 0.1: within 0.856 of the world's origin. */
static void place_dome(check_scene *s, int perspective) {
    static const double middle = 0;
    static check_field field;
    static sps_transfer transfer;
    sps_volume *volume;
    start(s, SIDE, SIDE, perspective ? 0 : 1.6);
    check_perspective(&s->view.camera, perspective ? 0.35 : 0);
    field.value_fn = dome;
    field.user = &middle;
    transfer.points = soft_points;
    transfer.point_count = 2;
    volume = check_add_volume(s, 10, 10, 10, check_box(-1.1, -1.1, -1.1, 1.1, 1.1, 1.1));
    volume->eval_fn = check_eval_field;
    volume->user = &field;
    volume->transfer = &transfer;
    volume->shading = SPS_SHADING_SURFACE;
    volume->specular = 0.3f;
    check_add_directional(s, 0.5, -0.3, -1, 3)->no_shadow = 1;
}

/* `hidden`: the left half of the picture shows a square amid the dome. */
static int render_beside(int hidden, int perspective, int steep, int march, float *image) {
    check_scene s;
    const double corner[3] = {-3, -2, 0.2}, u[3] = {3.01, 0, 0}, v[3] = {0, 4, steep ? 2.0 : 0.0};
    place_dome(&s, perspective);
    s.view.quality = steep ? SPS_QUALITY_MEDIUM : SPS_QUALITY_HIGH;
    if (hidden) check_add_quad(&body, corner, u, v);
    if (hidden) check_add_mesh(&s, &body, 0);
    return march ? check_march(context, &s, 0.2, image, NULL) : check_render(context, &s, image);
}

/* A polygon amid classified matter changes no pixel that does not show it: gradients use the neighbours' whole slabs,
   in front of the polygon and behind it. Matter in front of it is shaded with the slabs behind it too, as in the
   reference: no farther from that than the picture without it, whose rays are all longer. Round-off: the ends of slabs
   are stored as fractions of these, to 1e-6, whole or not, and the polygon's depth is a float. */
static void test_polygon_beside(void) {
    for (int n = 0; n < 4; ++n) {
        const int perspective = n & 1, steep = n >> 1;
        double beside = 0, before = 0, without = 0;
        if (!render_beside(1, perspective, steep, 0, image_a) || !render_beside(0, perspective, steep, 0, image_b))
            return;
        if (!render_beside(0, perspective, steep, 1, image_c)) return;
        for (int i = 0; i < PIXELS; ++i)
            if (i % SIDE >= SIDE / 2 + 1)
                for (int c = 0; c < 3; ++c)
                    beside = fmax(beside, fabs((double)(image_a[4 * i + c] - image_b[4 * i + c])));
        without = check_rms(image_b, image_c, 4 * PIXELS);
        if (!render_beside(1, perspective, steep, 1, image_c)) return;
        before = check_rms(image_a, image_c, 4 * PIXELS);
        if (!CHECK(beside < 1e-5) || !CHECK(before <= 1.1 * without))
            printf("    %d: beside %g, before %g, without %g\n", n, beside, before, without);
    }
}

static double ramp(const void *user, const double p[3]) {
    (void)user;
    return fmax(0, 0.5 + p[0]);
}

/* The eye amid a surface of voxels of 0.1 units whose value rises along x by 0.1 per voxel from 0.5 at the eye, so
   dense that only the nearest two voxels are visible: the slabs around the eye, too, are shaded by their whole
   surroundings, some of which are behind it. Lit along the gradient, all of it reflects its reflectance times
   irradiance / pi. The maximum ripple of 0.2 % (RIPPLE), with a period of a voxel, turns normals by at most 2 pi 0.002
   0.65 / 0.1 in either direction across, where values are below 0.65, and each reduces a cosine by half its square: 0.7
   %. */
static void test_eye_amid_surface(void) {
    static const sps_transfer_point points[2] = {{0, {0.8f, 0.8f, 0.8f}, 10, {0, 0, 0}},
                                                 {2, {0.8f, 0.8f, 0.8f}, 10, {0, 0, 0}}};
    static check_field field;
    for (int n = 0; n < 13; ++n) {
        static const double directions[7][3] = {{1, 0, 0},        {-1, 0, 0},       {0, 1, 0.1}, {0, 0, -1},
                                                {0.6, -0.5, 0.4}, {-0.3, 0.4, 0.8}, {0, 1, 0}};
        const int way = n < 12 ? n % 6 : 6;
        sps_transfer transfer;
        check_scene s;
        sps_volume *volume;
        const double turn = 2 * PI * RIPPLE * 0.65 / 0.1;
        double least = HUGE_VAL, most = 0;
        start(&s, SIDE, SIDE, 0);
        check_set3(s.view.camera.position, 0.013 * (n % 6), n < 6 ? -0.02 : n < 12 ? 0.03 : 0.12, 0.03);
        for (int i = 0; i < 3; ++i) s.view.camera.target[i] = s.view.camera.position[i] + directions[way][i];
        check_perspective(&s.view.camera, 0.9);
        s.view.slab_thickness = n < 6    ? 0
                                : n < 12 ? 1
                                         : 2; /* thick ones need kernels, and bricks, that lie wholly behind the eye */
        memset(&transfer, 0, sizeof transfer);
        transfer.points = points;
        transfer.point_count = 2;
        field.value_fn = ramp;
        volume = check_add_volume(&s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
        volume->eval_fn = check_eval_field;
        volume->user = &field;
        volume->transfer = &transfer;
        volume->shading = SPS_SHADING_SURFACE;
        volume->gradient_full = 0.01f;
        check_add_directional(&s, 1, 0, 0, PI)->no_shadow = 1;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i) {
            least = fmin(least, (double)(image_a[4 * i] / image_a[4 * i + 3]));
            most = fmax(most, (double)(image_a[4 * i] / image_a[4 * i + 3]));
        }
        if (!CHECK(least > 0.8 * (1 - turn * turn) && most < 0.8 * (1 + 1e-5)))
            printf("    view %d: %g to %g instead of 0.8\n", n, least, most);
    }
}

/* The eye amid classified matter of one value, which shows from 0.92 to 1.08 of that: the slabs around the eye hold it
   in full, by kernels some of which lie wholly behind the eye, and so the mean distance of what is seen is
   1 / extinction, to the 0.05 % that kernels' cut tails take. Ripple does not matter. Slabs of two voxels have an
   optical depth of 2 and more, and 1.1 % of a mean distance comes from the pieces that they are shaded in: 2 %. */
static void test_eye_amid_even(void) {
    static const sps_transfer_point points[4] = {{0.9f, {1, 1, 1}, 0, {0, 0, 0}},
                                                 {0.92f, {1, 1, 1}, 10, {0, 0, 0}},
                                                 {1.08f, {1, 1, 1}, 10, {0, 0, 0}},
                                                 {1.1f, {1, 1, 1}, 0, {0, 0, 0}}};
    for (int n = 0; n < 18; ++n) {
        static const double directions[6][3] = {{1, 0, 0},      {-1, 0, 0},       {0, 1, 0.1},
                                                {0.1, 0.2, -1}, {0.6, -0.5, 0.4}, {-0.3, 0.4, 0.8}};
        static float distance[PIXELS];
        double worst = 0;
        sps_transfer transfer;
        check_scene s;
        start(&s, SIDE, SIDE, 0);
        check_set3(s.view.camera.position, 0.013 * n, -0.02, 0.03);
        for (int i = 0; i < 3; ++i) s.view.camera.target[i] = s.view.camera.position[i] + directions[n % 6][i];
        check_perspective(&s.view.camera, 0.9);
        s.view.slab_thickness = 0.5 * (1 << n / 6);
        memset(&transfer, 0, sizeof transfer);
        transfer.points = points;
        transfer.point_count = 4;
        add_gas(&s, 1, -1, 1, 1)->transfer = &transfer;
        if (!check_render_depth(context, &s, image_a, distance)) return;
        for (int i = 0; i < PIXELS; ++i) worst = fmax(worst, fabs((double)distance[i] * 10 - 1));
        if (!CHECK(worst < (n < 12 ? 0.001 : 0.02))) printf("    view %d: off by %g\n", n, worst);
    }
}

/* The eye amid a uniform gas, in a picture of several tiles: each holds the bricks that it sees, including those cut by
   the eye's own plane. A ray's optical depth is the gas's over its path to the box's side, except within a kernel's
   reach of an edge, where the blur of two sides overlaps. The half voxel of blur is symmetric about a side; RIPPLE
   applies to the optical depth, and rays that leave a side at more than 45 degrees are skipped. */
static void test_eye_amid_tiles(void) {
    enum { WIDE = 150 };
    static float image[4 * WIDE * WIDE];
    for (int n = 0; n < 3; ++n) {
        static const double directions[3][3] = {{1, 0.2, 0.1}, {0.1, -1, 0.3}, {-0.2, 0.1, -1}};
        long looked_at = 0, wrong = 0;
        spsi_rays rays;
        check_scene s;
        start(&s, WIDE, WIDE, 0);
        check_set3(s.view.camera.position, 0, 0, 0);
        memcpy(s.view.camera.target, directions[n], sizeof s.view.camera.target);
        check_perspective(&s.view.camera, 1.7);
        add_gas(&s, 1, -1, 1, 0.5)->size[0] = 80; /* elongated: bricks four times as long along the view as across */
        if (!check_render(context, &s, image)) return;
        memset(&rays, 0, sizeof rays);
        rays.width = rays.height = WIDE;
        if (!CHECK(spsi_rays_from_camera(&rays, &s.view.camera))) return;
        for (int y = 0; y < WIDE; ++y)
            for (int x = 0; x < WIDE; ++x) {
                double d[3], most = 0, second = 0, exact;
                spsi_ray_direction(&rays, x, y, d);
                vec_normalise(d);
                for (int i = 0; i < 3; ++i) {
                    const double size = fabs(d[i]);
                    second = fmax(second, fmin(most, size));
                    most = fmax(most, size);
                }
                if (second > 0.65 * most) continue; /* it leaves the box at least 0.35 units from an edge */
                exact = -expm1(-0.5 / most);
                wrong += !(fabs((double)image[4 * (y * WIDE + x) + 3] - exact) < 0.5 / most * RIPPLE + 1e-5);
                ++looked_at;
            }
        if (!CHECK(wrong == 0 && looked_at > WIDE * WIDE / 10))
            printf("    view %d: %ld of %ld\n", n, wrong, looked_at);
    }
}

/* A near plane at least a slab in front of visible matter changes no bit: the slabs that it cuts are still complete,
   and so are gradients from them, even close to the eye, where a kernel is integrated along each ray. Slabs are 0.4 of
   a voxel, 0.09 units. */
static void test_near_plane_before(void) {
    for (int place = 0; place < 3; ++place) { /* parallel rays; a distant eye; a close eye */
        const double away = place < 2 ? 10 : 2;
        check_scene s;
        place_dome(&s, place > 0);
        s.view.camera.position[2] = away;
        if (place == 2) check_perspective(&s.view.camera, 1);
        if (!check_render(context, &s, image_a)) return;
        for (int n = 0; n < 6; ++n) {
            s.view.near_distance = away - 0.86 - 0.1 - 0.02 * n;
            if (!check_render(context, &s, image_b)) return;
            if (!CHECK(check_largest(image_a, image_b, 4 * PIXELS) <= 0))
                printf("    place %d, near plane at %g\n", place, s.view.near_distance);
        }
    }
}

static double rising(const void *user, const double p[3]) {
    (void)user;
    return fmax(1 - p[2], 0) / 2;
}

/* Extinction that rises as k (1 - z) / 2 from z = 1 downwards, up to a slanted plate that cuts thick slabs everywhere:
   an optical depth of k (1 - z)^2 / 4. Kernels preserve linear fields, except for their ripple. Where the rise begins,
   they add k / 4 of their variance, 0.65^2 voxels^2, and so do samples at the centres of voxels instead of means over
   these, 1/12 voxel^2 by Euler-Maclaurin. Slabs of a voxel are the thickest that can follow that bend. */
static void test_cut_slab_of_rising(void) {
    static const double k = 4;
    static const sps_transfer_point points[2] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 4, {0, 0, 0}}};
    check_field field;
    sps_transfer transfer;
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        sps_volume *volume;
        memset(&transfer, 0, sizeof transfer);
        transfer.points = points;
        transfer.point_count = 2;
        start(&s, 3, PIXELS / 3, 2.4);
        volume = add_gas(&s, 1.5, -1, 1, 0);
        field.value_fn = rising;
        volume->read_fn = NULL;
        volume->eval_fn = check_eval_field;
        volume->user = &field;
        volume->transfer = &transfer;
        s.view.slab_thickness = 0.5 * (1 << n);
        add_square(&body, 1.5, 0, 0.4);
        check_add_mesh(&s, &body, 0.5);
        check_color(s.scene.ambient, 1, 1, 1);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i) {
            const double y = ((PIXELS / 3 - 1) / 2.0 - i / 3) * 2.4 / (PIXELS / 3), way = 1 - 0.4 * y;
            const double tau = k / 2 * (way * way + 0.01 * (0.65 * 0.65 + 1.0 / 12)) / 2;
            if (!CHECK_NEAR(-log(2 * (double)image_a[4 * i]), tau, tau * RIPPLE + 1e-5))
                printf("    slab %g, y %g\n", s.view.slab_thickness, y);
        }
    }
}

/* Gas behind a near plane amid it: its mean distance is 1 / extinction behind that plane, for slabs of any thickness.
   Its end, 20 optical depths away, is not seen. */
static void test_depth_of_thick_gas(void) {
    static const double sigma = 10;
    for (int n = 0; n < 8; ++n) {
        float distance[9];
        check_scene s;
        start(&s, 3, 3, 0.1);
        add_gas(&s, 1.5, -2, 2, sigma);
        s.view.near_distance = 9.87;
        s.view.slab_thickness = 0.5 * (1 << n % 4);
        check_add_directional(&s, 0, 0, n < 4 ? -1 : 1, 1); /* from the front and from behind */
        if (!check_render_depth(context, &s, image_a, distance)) return;
        for (int i = 0; i < 9; ++i)
            if (!CHECK_NEAR((double)distance[i], 9.87 + 1 / sigma, RIPPLE / sigma + 2e-6))
                printf("    slab %g, light %d\n", s.view.slab_thickness, n / 4);
    }
}

/* Thin gas on a black ground, cut by it, under a low sun: all of it is lit down to the ground, although that rises by
   12 texels from one texel of the light's to the next. These, 40 units by 1024, are an eighth of the gas's height. The
   ripple is medium quality's. */
static void test_lit_down_to_the_ground(void) {
    static const double height = 0.3, sigma = 1e-4;
    for (int n = 0; n < 2; ++n) {
        const double exact = 3 * sigma * height * 0.25 / PI, turn = 0.3 + 1.7 * n;
        check_scene s;
        sps_volume *volume;
        start(&s, SIDE, SIDE, 20);
        s.view.quality = SPS_QUALITY_MEDIUM;
        volume = check_add_volume(&s, 40, 40, 8, check_box(-20, -20, -0.1, 20, 20, height));
        volume->read_fn = check_read_constant;
        volume->user = &one;
        volume->extinction = (float)sigma;
        check_color(volume->albedo, 1, 1, 1);
        add_square(&ground, 50, 0, 0);
        check_add_mesh(&s, &ground, 0);
        check_add_directional(&s, cos(turn), sin(turn), -1.0 / 12, 3);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i) /* the gas absorbs up to sigma 12 height of the light */
            if (!CHECK_CASE("What users of other renderers complain of",
                            "shadows in front of their occluder: gas above a ground, low sun", "all of it is lit",
                            fabs((double)image_a[4 * i] / exact - 1), 0.0037 + 13 * sigma * height,
                            "ripple of medium quality; what the gas itself absorbs"))
                printf("    light %d, pixel %d\n", n, i);
    }
}

/* Thin classified matter between z = -1 and 1 in the shadow of a plate whose edge cuts it at an angle: the lit part of
   a ray ends where the edge's shadow does, at any part of a slab. Each part is lit as at its middle, an error of up to
   half a part; a light's texel, of at most 6 / 1024 units, the box's diagonal with its kernels' reach, blurs that by
   5 / 3 of its size along z. The ripple is medium quality's. */
static void test_shadow_edge_in_slabs(void) {
    static const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 1e-4f, {0, 0, 0}}};
    const double way = 0.2 / cos(0.5 * acos(0.8)),
                 texel = 6.0 / 1024; /* through slabs, which face the half-way vector */
    sps_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.points = points;
    transfer.point_count = 2;
    for (int n = 0; n < 2; ++n) {
        const int side = n ? -1 : 1; /* from the front; from behind */
        const double corner[3] = {-40, -40, 3.0 * side}, u[3] = {40 - 2.25, 0, 0}, v[3] = {0, 80, 0};
        check_scene s;
        start(&s, SIDE, SIDE, 1.2);
        s.view.quality = SPS_QUALITY_MEDIUM;
        s.view.slab_thickness = 2;
        add_gas(&s, 1.5, -1, 1, 0)->transfer = &transfer;
        check_add_quad(&body, corner, u, v);
        check_add_mesh(&s, &body, 0);
        check_add_directional(&s, 0.6, 0, -0.8 * side, 4 * PI * 1e4);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < PIXELS; ++i) { /* in gas that absorbs 2e-4 of it along either path */
            const double x = (i % SIDE - (SIDE - 1) / 2.0) * 1.2 / SIDE, lit = 1 + x / 0.75;
            if (!CHECK_NEAR((double)image_a[4 * i], lit,
                            lit * (0.0037 + 5e-4) + 0.5 * way / SPSI_SUBSLABS + texel * 5 / 3))
                printf("    %d, x %g\n", n, x);
        }
    }
}

/* ----------------------------------------------------------------------------------------------- transfer functions */

/* The transfer function of some points, between 0 and 1. */
static void tabulate(const sps_transfer *transfer, spsi_table *table, spsi_material *material) {
    memset(table, 0xff, sizeof *table); /* NaN */
    memset(material, 0, sizeof *material);
    material->table = table;
    CHECK_OK(context, spsi_transfer_tabulate(context, transfer, 0, material));
    CHECK(material->table_scale >= SPSI_TABLE_SIZE && material->table_scale <= SPSI_TABLE_SIZE);
}

static int rising_transfer(void *user, size_t count, const float *values, sps_transfer_point *out) {
    *(int *)user += (int)count;
    for (size_t i = 0; i < count; ++i) {
        check_color(out[i].albedo, (double)values[i], 1 - (double)values[i], 0.25);
        out[i].extinction = 3 * values[i];
    }
    return 0;
}

/* What spsi_any_shown passes by has no extinction, to the last bit below an onset, and what it does not may have some:
   all values beyond the last clear entry before the onset. */
static void test_passed_by(void) {
    static const float onsets[4] = {0, 1.0f / SPSI_TABLE_SIZE, 0.25f, 1};
    static spsi_table table;
    for (int n = 0; n < 4; ++n) {
        const sps_transfer_point points[3] = {
            {0, {1, 1, 1}, 0, {0, 0, 0}}, {onsets[n], {1, 1, 1}, 0, {0, 0, 0}}, {1.25f, {1, 1, 1}, 3, {0, 0, 0}}};
        const float clear = onsets[n] * SPSI_TABLE_SIZE / 1.25f;
        sps_transfer transfer = {0};
        spsi_material material;
        transfer.points = points + (n == 0 ? 2 : 0); /* the first table has extinction from its first entry on */
        transfer.point_count = n == 0 ? 1 : 3;
        memset(&table, 0xff, sizeof table); /* NaN */
        memset(&material, 0, sizeof material);
        material.table = &table;
        CHECK_OK(context, spsi_transfer_tabulate(context, &transfer, 0, &material));
        CHECK_NEAR((double)table.last_clear, floor((double)clear), 0);
        for (int i = 0; i < 4 * SPSI_TABLE_SIZE; ++i) {
            const float value = 1.5f * (float)i / (4 * SPSI_TABLE_SIZE);
            float extinction[SPSI_LANES];
            spsi_store(extinction, spsi_classify_extinction(&material, spsi_set(value)));
            CHECK(spsi_any_shown(&material, spsi_set(value)) != 0 ? value * material.table_scale > floorf(clear)
                                                                  : !(extinction[0] > 0));
        }
    }
}

/* Entry i of a table is for the value i / SPSI_TABLE_SIZE, including the last one, by points or by a callback. */
static void test_table_entries(void) {
    static const sps_transfer_point by_points[3] = {{0, {0, 1, 0.25f}, 0, {0, 0, 0}},
                                                    {0.5f, {0.5f, 0.5f, 0.25f}, 1.5f, {0, 0, 0}},
                                                    {1, {1, 0, 0.25f}, 3, {0, 0, 0}}};
    static spsi_table table;
    for (int n = 0; n < 2; ++n) {
        int asked = 0;
        spsi_material material;
        sps_transfer transfer;
        memset(&transfer, 0, sizeof transfer);
        if (n) transfer.points = by_points, transfer.point_count = 3;
        if (!n) transfer.eval_fn = rising_transfer, transfer.user = &asked;
        tabulate(&transfer, &table, &material);
        CHECK(n || asked == SPSI_TABLE_SIZE + 1);
        for (int i = 0; i <= SPSI_TABLE_SIZE; ++i) { /* at most four float roundings each, of numbers up to 3 */
            const double value = (double)i / SPSI_TABLE_SIZE;
            int good = CHECK_NEAR((double)table.entry[i][0], value, 2.4e-7);
            good &= CHECK_NEAR((double)table.entry[i][1], 1 - value, 2.4e-7);
            good &= CHECK_NEAR((double)table.entry[i][3], 3 * value, 7.2e-7);
            if (!good) printf("    entry %d, by %s\n", i, n ? "points" : "callback");
        }
    }
}

/* Values up to one are visible if any of them has extinction by linear interpolation between the table's entries. At
   an entry's own value, the line behind it may count, too. */
static void test_what_shows(void) {
    static const sps_transfer_point band[4] = {{0.25f, {1, 1, 1}, 0, {0, 0, 0}},
                                               {0.2501f, {1, 1, 1}, 5, {0, 0, 0}},
                                               {0.5f, {1, 1, 1}, 5, {0, 0, 0}},
                                               {0.5001f, {1, 1, 1}, 0, {0, 0, 0}}};
    static spsi_table table;
    const int first = SPSI_TABLE_SIZE / 4; /* without extinction */
    spsi_material material;
    sps_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.points = band;
    transfer.point_count = 4;
    transfer.value_max = 1;
    tabulate(&transfer, &table, &material);
    CHECK(!(table.entry[first][3] > 0) && table.entry[first + 1][3] > 0);
    for (int a = -8; a <= 8; ++a) { /* quarters of an entry */
        const float low = ((float)first + 0.25f * (float)a) / SPSI_TABLE_SIZE;
        if (!CHECK(a == 0 || spsi_transfer_shows(&material, low) == (a > 0))) printf("    %d quarters\n", a);
    }
    CHECK(spsi_transfer_shows(&material, 1) && !spsi_transfer_shows(&material, 0));
}

enum { WIDE = 43, TALL = 37, DEEP = 70, MATTER = WIDE * TALL * DEEP };
static float matter[MATTER];
static unsigned char held[MATTER], wanted[MATTER];

/* Marks each voxel within three of voxel n. */
static void mark_about(int n) {
    const int at[3] = {n % WIDE, n / WIDE % TALL, n / (WIDE * TALL)};
    for (int z = at[2] - 3; z <= at[2] + 3; ++z)
        for (int y = at[1] - 3; y <= at[1] + 3; ++y)
            for (int x = at[0] - 3; x <= at[0] + 3; ++x)
                if (x >= 0 && x < WIDE && y >= 0 && y < TALL && z >= 0 && z < DEEP)
                    wanted[(z * TALL + y) * WIDE + x] = 1;
}

/* Marks the voxels that the context holds; returns the number of those that are wrong, or held twice. */
static int mark_held(void) {
    int wrong = 0;
    memset(held, 0, sizeof held);
    for (int b = 0; b < context->brick_count; ++b) {
        const spsi_brick *brick = (const spsi_brick *)context->buffers[SPSI_BUFFER_BRICKS].data + b;
        const spsi_segment *segment = spsi_segment_at(context, brick->segment);
        for (int i = brick->first; i < brick->first + brick->count; ++i) {
            const int x = brick->base[0] + spsi_segment_step(segment, i, 0);
            const int y = brick->base[1] + spsi_segment_step(segment, i, 1);
            const int n = ((brick->base[2] + spsi_segment_step(segment, i, 2)) * TALL + y) * WIDE + x;
            wrong += segment->value[i] < matter[n] || segment->value[i] > matter[n] || held[n];
            held[n] = 1;
        }
    }
    return wrong;
}

/* Exactly those voxels are held that are within two voxels of a place with a visible neighbour: within three of a
   visible voxel along each axis, across blocks. */
static void test_held_voxels(void) {
    static const sps_transfer_point points[2] = {{0.5f, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 1, {0, 0, 0}}};
    sps_transfer transfer;
    check_random random;
    check_array array;
    check_scene s;
    sps_volume *volume;
    int wrong, shown = 0;
    memset(&transfer, 0, sizeof transfer);
    memset(&array, 0, sizeof array);
    memset(wanted, 0, sizeof wanted);
    random.state = 5;
    for (int i = 0; i < MATTER; ++i) {
        const int shows = check_next(&random) < 1.0 / 700; /* so that some 40 % lie within 7^3 voxels of one */
        matter[i] = shows ? 0.75f : 0.25f;
        shown += shows;
        if (shows) mark_about(i);
    }
    CHECK(shown > MATTER / 1000);
    transfer.points = points;
    transfer.point_count = 2;
    array.values = matter;
    start(&s, 3, 3, 1);
    volume = check_add_volume(&s, WIDE, TALL, DEEP, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = check_read_array;
    volume->user = &array;
    volume->transfer = &transfer;
    array.size[0] = WIDE, array.size[1] = TALL, array.size[2] = DEEP;
    if (!check_render(context, &s, image_a)) return;
    wrong = mark_held();
    for (int i = 0; i < MATTER; ++i) wrong += held[i] != wanted[i];
    CHECK(wrong == 0);
}

static int range_constant(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)lo, (void)size;
    out[0] = out[1] = *(const float *)user;
    return 0;
}

/* Where matter of value 1 ends, its value falls to 0, through the visible values of a transfer function. A range_fn
   that returns 1 everywhere keeps that in the picture. */
static void test_shell_of_constant(void) {
    static const sps_transfer_point shell[4] = {{0.2f, {1, 1, 1}, 0, {0, 0, 0}},
                                                {0.4f, {1, 1, 1}, 30, {0, 0, 0}},
                                                {0.6f, {1, 1, 1}, 30, {0, 0, 0}},
                                                {0.8f, {1, 1, 1}, 0, {0, 0, 0}}};
    sps_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.points = shell;
    transfer.point_count = 4;
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        sps_volume *volume;
        start(&s, 3, 3, 0.1);
        volume = add_gas(&s, 1, -1, 1, 0);
        volume->transfer = &transfer;
        volume->range_fn = n ? range_constant : NULL;
        if (!check_render(context, &s, n ? image_b : image_a)) return;
    }
    CHECK(image_a[3] > 0.5f);
    CHECK_CASE("Found in review", "shell around constant values, with a range callback that says so",
               "stays in the picture", memcmp(image_a, image_b, 9 * 4 * sizeof(float)) != 0, 0, "same bits");
}

/* ------------------------------------------------------------------------------------------------------ grey scenes */

/* Scenes with a color in one place and one channel only. */
static void colored_scene(check_scene *s, int place, int channel) {
    const int gas = place > 2;
    float color[3] = {0.5f, 0.5f, 0.5f};
    float *places[5];
    start(s, 3, 3, 0.1);
    add_square(&ground, 4, 0, 0);
    if (!gas) check_add_mesh(s, &ground, 0.5);
    if (gas) add_gas(s, 1, -1, 1, place == 3 ? 1 : 0);
    check_add_directional(s, 0, 0, -1, 0.5)->no_shadow = 1;
    places[0] = s->scene.ambient;
    places[1] = s->mesh[0].albedo;
    places[2] = s->light[0].color;
    places[3] = s->volume[0].albedo;
    places[4] = s->volume[0].emission;
    color[channel] = 0.125f;
    memcpy(places[place], color, sizeof color);
    if (place != 2) check_color(s->light[0].color, place ? 1 : 0, place ? 1 : 0, place ? 1 : 0);
}

/* Everything else is grey: that channel is a quarter of the others, to the last bit, as a quarter of a float is
   exact. */
static void test_one_channel_differs(void) {
    for (int place = 0; place < 5; ++place)
        for (int channel = 0; channel < 3; ++channel) {
            check_scene s;
            colored_scene(&s, place, channel);
            if (!check_render(context, &s, image_a)) return;
            for (int i = 0; i < 9; ++i)
                for (int c = 0; c < 3; ++c) {
                    const float full = image_a[4 * i + (channel + 1) % 3], share = c == channel ? 0.25f : 1;
                    if (!CHECK(full > 0) || !CHECK_NEAR((double)image_a[4 * i + c], (double)(share * full), 0))
                        printf("    place %d, channel %d\n", place, channel);
                }
        }
}

/* ------------------------------------------------------------------------------------------------------ bookkeeping */

typedef struct course {
    long calls, cancel_at, messages, wrong;
    float first, last, step; /* fractions: the first, the last, the largest step */
} course;

static int progress(void *user, float fraction) {
    course *c = (course *)user;
    if (c->calls++ == 0) c->first = fraction;
    c->wrong += !(fraction >= 0 && fraction <= 1) || (c->calls > 1 && fraction < c->last);
    c->last = fraction;
    return c->calls == c->cancel_at;
}

/* The largest single step of progress. */
static int progress_step(void *user, float fraction) {
    course *c = (course *)user;
    c->step = fmaxf(c->step, fraction - c->last);
    c->last = fraction;
    return 0;
}

/* A frame of more than ten chunks of slabs whose light has no map: reading may be one step of a fifth, a chunk one step
   of a tenth of the rest. */
static void test_progress_steps(void) {
    course c;
    sps_config config;
    sps_context *own;
    check_scene s;
    sps_plan_report plan;
    sps_image image;
    start(&s, 9, 9, 1);
    add_gas(&s, 1.5, -0.8, 0.8, 1);
    check_add_directional(&s, 0.3, 0, -1, 2);
    memset(&config, 0, sizeof config);
    memset(&c, 0, sizeof c);
    memset(&image, 0, sizeof image);
    config.progress_fn = progress_step;
    config.clock_fn = check_hasty_clock;
    config.progress_user = &c;
    image.rgba = image_a;
    own = sps_create(&config, NULL);
    s.view.slab_thickness = 0.02;
    CHECK(sps_plan(own, &s.scene, &s.view, &plan) == SPS_OK && plan.slab_count > 160);
    memset(&c, 0, sizeof c);
    CHECK(sps_render(own, &s.scene, &s.view, &image) == SPS_OK && c.step > 0 && c.step < 0.21f);
    sps_destroy(own);
}

#define LONG_SWARM   20480
#define LONG_LIGHTS  63
#define TASK_SECONDS 0.0004 /* pass between two looks at the clock: a task */

typedef struct pace {
    double now, last, least, most; /* seconds: the time, that of the last call, and between two calls */
    long calls, cancel_at;
    float fraction;
} pace;

static double pace_clock(void *user) { return ((pace *)user)->now += TASK_SECONDS; }

static int pace_progress(void *user, float fraction) {
    pace *p = (pace *)user;
    const double between = p->now - p->last;
    if (p->calls++ > 0 && fraction < 1) p->least = fmin(p->least, between), p->most = fmax(p->most, between);
    p->last = p->now;
    p->fraction = fraction;
    return p->calls == p->cancel_at;
}

/* progress_fn is called every 10 ms by the clock, and when all is done; no later than that and the task that goes on,
   or, with several workers, whose rounds may begin just before it is due and last as long, than 20 ms and two tasks. */
static void test_progress_pace(void) {
    for (int which = 0; which < 12; ++which) {
        const int workers = which % 2 ? 4 : 0, marched = which / 2 % 2, cancels = which / 4 == 1, timed = which < 8;
        check_hooks hooks;
        pace p = {0, 0, HUGE_VAL, 0, 0, 0, 0};
        sps_config config;
        sps_context *own;
        sps_result result;
        check_scene s;
        clock_t began;
        sps_image image = {image_a, NULL, 0};
        start(&s, SIDE, SIDE, 1);
        add_gas(&s, 1.5, -0.8, 0.8, 1);
        check_add_directional(&s, 0.3, 0, -1, 2);
        s.view.slab_thickness = 0.02;
        memset(&hooks, 0, sizeof hooks);
        hooks.worker_count = workers;
        config = check_config(&hooks);
        config.progress_fn = pace_progress, config.clock_fn = timed ? pace_clock : NULL;
        config.progress_user = config.clock_user = &p;
        p.cancel_at = cancels ? 3 : 0;
        own = sps_create(&config, NULL);
        began = clock();
        result =
            marched ? check_reference(own, &s.scene, &s.view, 1, &image) : sps_render(own, &s.scene, &s.view, &image);
        CHECK(result == (cancels ? SPS_ERROR_CANCELLED : SPS_OK) && (cancels || p.fraction >= 1));
        if (!timed) p.now = (double)(clock() - began) / CLOCKS_PER_SEC;
        CHECK(cancels ? p.calls == 3 : p.calls >= (timed ? 4 : 1) && p.calls <= p.now / 0.01 + 2);
        sps_destroy(own);
        if (!timed) continue;
        CHECK_CASE("Engineering", "progress by a clock that passes 0.4 ms per task", "seconds between two calls",
                   p.most, (workers ? 0.02 : 0.01) + 3.5 * TASK_SECONDS,
                   "10 ms, the task and two looks for statistics");
        CHECK(p.least > 0.01 - 1e-9 && p.least < 1);
        if (figures()) printf("%d: %ld calls in %g, %g to %g\n", which, p.calls, p.now, p.least, p.most);
    }
}

/* A scene of one tile in which one task does most of the work: 0: shading slabs; 1: splatting bricks; 2: light that a
   curved wall receives from cells; 3: particles of a map. */
static void start_long_task(check_scene *s, int which, sps_particle *swarm, sps_particles *set) {
    static sps_light lights[LONG_LIGHTS];
    start(s, 64, 64, 2);
    s->view.scattering = which == 2 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
    s->view.quality = SPS_QUALITY_DRAFT;
    if (which < 3) {
        const int side = which == 1 ? 128 : 16;
        sps_volume *volume = check_add_volume(s, side, side, side, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = check_read_constant, volume->user = &one;
        volume->extinction = 0.5f, volume->revision = 1;
        check_color(volume->albedo, 0.9, 0.9, 0.9);
        s->view.filling = which == 1 ? SPS_FILLING_SPLAT : SPS_FILLING_GATHER;
    }
    if (which == 0) { /* lights that have no shadows, which each pixel looks up */
        memset(lights, 0, sizeof lights);
        for (int i = 0; i < LONG_LIGHTS; ++i) {
            check_set3(lights[i].direction, 0, 0, -1);
            check_color(lights[i].color, 1, 1, 1);
            lights[i].no_shadow = 1;
        }
        s->scene.lights = lights, s->scene.light_count = LONG_LIGHTS;
        s->view.slab_thickness = 0.05;
    }
    if (which == 1) s->view.slab_thickness = 8; /* few chunks of slabs, each a task */
    if (which == 2) {
        add_square(&ground, 1, -1.2, 0);
        for (int k = 0; k < 9; ++k) ground.list[0].normal[k / 3][k % 3] = k % 3 == 2 ? 1.0f : 0.1f * (float)(k / 3);
        memcpy(ground.list[1].normal, ground.list[0].normal, sizeof ground.list[0].normal);
        check_add_mesh(s, &ground, 0.5)->has_normals = 1;
        s->mesh[0].revision = 1;
        check_add_directional(s, 0.3, 0, -1, 2);
        s->view.scattering_resolution = 4;
    }
    if (which < 3) return;
    for (int i = 0; i < LONG_SWARM; ++i) {
        for (int k = 0; k < 3; ++k) swarm[i].position[k] = (float)((i >> 3 * k) % 8) / 8 - 0.5f;
        swarm[i].radius = 0.1f, swarm[i].optical_depth = 0.001f;
    }
    memset(set, 0, sizeof *set);
    set->count = LONG_SWARM, set->read_fn = check_read_particles, set->user = swarm;
    s->scene.particles = set, s->scene.particle_set_count = 1;
}

/* Calls of progress_fn in the second of two frames, which has little else to do than the task, or in making a map. */
static long calls_of_long_task(sps_context *own, const check_scene *s, int which, check_cancel *count,
                               sps_stats_report *stats) {
    static float rgba[4 * 64 * 64];
    sps_image image = {rgba, NULL, 0};
    const sps_tmap_light light = check_light_of(&s->view);
    sps_tmap_settings settings;
    sps_tmap *map = NULL;
    memset(&settings, 0, sizeof settings);
    settings.technique = SPS_TMAP_OPACITY, settings.near_depth = 5, settings.far_depth = 15;
    for (int n = 0; n < 2 && which < 3; ++n) {
        count->calls = 0;
        CHECK_OK(own, sps_render(own, &s->scene, &s->view, &image));
    }
    if (which == 3) {
        CHECK_OK(own, sps_tmap_create(own, &light, &settings, &map));
        CHECK_OK(own, sps_tmap_add(map, &s->scene));
        CHECK_OK(own, sps_tmap_finish(map));
        sps_tmap_destroy(map);
    }
    sps_get_stats(own, stats);
    return count->calls;
}

/* On one thread, progress_fn can be called amid a task, too: after at most 8 rows of a vector of pixels that look up 63
   lights in 16 slabs, 128 bricks of 8^3 voxels, 64 pixels that receive light, twice here, or 256 particles, which were
   placed in tasks of as many. Without one of these, calls are missing: 703, 3, 51, 70. */
static void test_progress_amid_tasks(void) {
    static sps_particle swarm[LONG_SWARM];
    sps_particles set;
    for (int which = 0; which < 4; ++which) {
        check_cancel count = {0, 0};
        check_hooks hooks;
        sps_config config;
        sps_context *own;
        check_scene s;
        sps_stats_report stats;
        long calls, asked;
        memset(&hooks, 0, sizeof hooks);
        config = check_config(&hooks);
        config.progress_fn = check_cancel_at, config.progress_user = &count;
        config.clock_fn = check_hasty_clock;
        own = sps_create(&config, NULL);
        start_long_task(&s, which, swarm, &set);
        calls = calls_of_long_task(own, &s, which, &count, &stats);
        asked = (long)(which == 0   ? stats.pixels_shaded / (8 * 16 * 16)
                       : which == 1 ? stats.eye_footprints / (128 * 512)
                       : which == 2 ? stats.pixels_of_polygons / 32
                                    : stats.particles / 128);
        CHECK_CASE("Engineering", "work between two calls of progress_fn within a task", "calls that are missing",
                   (double)(calls < asked ? asked - calls : 0), 0, "exact");
        if (figures()) printf("task %d: %ld calls, %ld asked for\n", which, calls, asked);
        sps_destroy(own);
    }
}

static void message(void *user, const char *text) {
    course *c = (course *)user;
    c->messages += text[0] != 0;
}

/* Progress begins at 0 in every call, even after one that was cancelled half-way; and cancelling sends no message. */
static void test_progress_of_calls(void) {
    course c;
    sps_config config;
    sps_context *own;
    check_scene s;
    start(&s, 9, 9, 1);
    add_gas(&s, 1.5, -0.8, 0.8, 1);
    check_add_directional(&s, 0.3, 0, -1, 2);
    memset(&config, 0, sizeof config);
    config.progress_fn = progress;
    config.clock_fn = check_hasty_clock;
    config.message_fn = message;
    config.progress_user = config.message_user = &c;
    own = sps_create(&config, NULL);
    if (!CHECK(own)) return;
    for (int call = 0; call < 6; ++call) {
        sps_image image;
        sps_result result;
        memset(&image, 0, sizeof image);
        memset(&c, 0, sizeof c);
        image.rgba = image_a;
        c.cancel_at = call == 2 || call == 3 ? 4 : 0;
        result =
            call % 2 ? check_reference(own, &s.scene, &s.view, 1, &image) : sps_render(own, &s.scene, &s.view, &image);
        CHECK(c.calls > 3 && c.messages == 0);
        CHECK_CASE("Found in review", "progress of calls after each other, some of them cancelled",
                   "begins at 0, rises, sends no message", c.wrong + !(c.first < 0.2f) + (int)c.messages, 0, "exact");
        if (c.cancel_at)
            CHECK(result == SPS_ERROR_CANCELLED && c.calls == 4 && strstr(sps_error(own), "cancelled"));
        else
            CHECK(result == SPS_OK && c.last >= 1 && sps_error(own)[0] == 0);
    }
    check_perspective(&s.view.camera, -1); /* errors are reported */
    memset(&c, 0, sizeof c);
    {
        sps_image image;
        memset(&image, 0, sizeof image);
        image.rgba = image_a;
        CHECK(sps_render(own, &s.scene, &s.view, &image) == SPS_ERROR_ARGUMENT && c.messages == 1 && c.calls == 0);
    }
    sps_destroy(own);
}

/* The first of two failures stands: its result, its sentence, and one message. */
static void test_first_failure(void) {
    course c;
    sps_config config;
    sps_context *own;
    memset(&config, 0, sizeof config);
    memset(&c, 0, sizeof c);
    config.message_fn = message;
    config.message_user = &c;
    own = sps_create(&config, NULL);
    if (!CHECK(own)) return;
    CHECK(spsi_fail(own, SPS_ERROR_DATA, "the cause") == SPS_ERROR_DATA && c.messages == 1);
    CHECK(spsi_fail(own, SPS_ERROR_MEMORY, "what follows from it") == SPS_ERROR_DATA && c.messages == 1);
    CHECK(!strcmp(sps_error(own), "the cause"));
    sps_destroy(own);
}

static int ranges_left;

static int range_until(void *user, const int lo[3], const int size[3], float out[2]) {
    (void)user, (void)lo, (void)size;
    out[0] = out[1] = 1;
    return ranges_left-- <= 0;
}

/* A plan that fails, early, half-way or late, leaves its report empty. */
static void test_failed_plans(void) {
    for (int n = 0; n < 5; ++n) {
        sps_plan_report report;
        const unsigned char *bytes = (const unsigned char *)&report;
        size_t left = 0;
        sps_volume *volume;
        sps_result result;
        check_scene s;
        start(&s, 9, 9, 1);
        add_square(&ground, 1, 0, 0);
        check_add_mesh(&s, &ground, 0.5);
        volume = add_gas(&s, 3, -3, 3, 1);
        volume->range_fn = range_until;
        ranges_left = n == 1 ? 0 : n == 2 ? 3 : 1000;
        if (n == 3) check_add_point(&s, 0.1, 0.2, 0.1, 1); /* amid what it lights */
        check_force_sheets(&s);
        if (n == 4) s.view.camera.up[0] = s.view.camera.position[0] = HUGE_VAL;
        memset(&report, 0x55, sizeof report);
        result = sps_plan(context, &s.scene, &s.view, &report);
        for (size_t i = 0; i < sizeof report; ++i) left += bytes[i] != 0;
        if (n == 0) CHECK(result == SPS_OK && report.range_calls > 3 && report.bytes > 0 && report.sweep_count == 1);
        if (n > 0)
            CHECK_CASE("Found in review", "report of a plan that fails early, half-way or late",
                       "is empty: bytes that are not 0", (double)left, 0, "exact");
        if (n == 1 || n == 2) CHECK(result == SPS_ERROR_CALLBACK);
        if (n == 3) CHECK(result == SPS_ERROR_UNSUPPORTED);
        if (n == 4) CHECK(result == SPS_ERROR_ARGUMENT);
    }
}

static long unwritten_wrong;

/* Writes the first block, and no other. */
static int read_first(void *user, const int lo[3], const int size[3], float *out) {
    const size_t count = (size_t)size[0] * (size_t)size[1] * (size_t)size[2];
    (void)lo;
    for (size_t i = 0; i < count; ++i) {
        unwritten_wrong += !(out[i] >= 0 && out[i] <= 0);
        if (*(int *)user == 0) out[i] = 1;
    }
    *(int *)user += 1;
    return 0;
}

static int eval_first(void *user, size_t count, const double *positions, float *out) {
    const int size[3] = {(int)count, 1, 1};
    (void)positions;
    return read_first(user, NULL, size, out);
}

/* Values that a callback does not write are 0, not those of the block before. */
static void test_unwritten_voxels(void) {
    for (int march = 0; march < 2; ++march)
        for (int n = 0; n < 2; ++n) {
            int calls = 0;
            check_scene s;
            check_hooks hooks;
            sps_context *own;
            sps_volume *volume;
            start(&s, SIDE, SIDE, 8);
            volume = add_gas(&s, 4, -4, 4, 50);
            volume->read_fn = n ? NULL : read_first;
            volume->eval_fn = n ? eval_first : NULL;
            volume->user = &calls;
            memset(&hooks, 0, sizeof hooks);
            own = check_context(&hooks);
            unwritten_wrong = 0;
            if (march ? !check_march(own, &s, 2, image_a, NULL) : !check_render(own, &s, image_a)) break;
            CHECK(calls > 1);
            CHECK_CASE("Found in review", "voxels that a callback does not write", "are 0, not the last block's",
                       unwritten_wrong, 0, "exact");
            CHECK(image_a[4 * (SIDE - 2) + 3] <= 0); /* the upper right corner; the first block is below, on the left */
            sps_destroy(own);
        }
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_table_entries);
    RUN(test_passed_by);
    RUN(test_what_shows);
    RUN(test_held_voxels);
    RUN(test_shell_of_constant);
    RUN(test_one_channel_differs);
    RUN(test_first_failure);
    RUN(test_normals_stretched);
    RUN(test_behind_a_chunk);
    RUN(test_behind_the_light);
    RUN(test_lights_of_the_reference);
    RUN(test_extinction_of_balls);
    RUN(test_bricks_of_the_reference);
    RUN(test_distance_of_a_layer);
    RUN(test_distant_eye);
    RUN(test_glow_beside_dust);
    RUN(test_classified_together);
    RUN(test_polygon_beside);
    RUN(test_eye_amid_surface);
    RUN(test_eye_amid_even);
    RUN(test_eye_amid_tiles);
    RUN(test_near_plane_before);
    RUN(test_cut_slab_of_rising);
    RUN(test_depth_of_thick_gas);
    RUN(test_lit_down_to_the_ground);
    RUN(test_shadow_edge_in_slabs);
    RUN(test_progress_of_calls);
    RUN(test_progress_steps);
    RUN(test_progress_pace);
    RUN(test_progress_amid_tasks);
    RUN(test_failed_plans);
    RUN(test_unwritten_voxels);
    sps_destroy(context);
    check_free_triangles(&ground);
    check_free_triangles(&body);
    return check_report();
}
