/* Penumbrae of extended lights: polygons and gas that cast them on polygons, against closed forms; gas on gas, against
   the reference; extents of zero; and that errors fall with the number of points. */

#include "check.h"

enum { SIDE = 64, ROWS = 8 }; /* rows in the middle, which stand for all where things are as wide as the view */
static float image_a[4 * SIDE * SIDE], image_b[4 * SIDE * SIDE], image_c[4 * SIDE * SIDE];
static sps_context *context;
static check_triangles ground, blocker;

/* --- a ground at y = 0, seen from above over 4 world units; what stands above y = 4 is behind the camera --- */

static void start(check_scene *s) {
    const double origin[3] = {-8, 0, -8}, u[3] = {16, 0, 0}, v[3] = {0, 0, 16};
    check_clear(s, SIDE, SIDE);
    ground.count = blocker.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(s, &ground, 0.5);
    check_set3(s->view.camera.position, 0, 4, 0);
    check_set3(s->view.camera.target, 0, 0, 0);
    check_set3(s->view.camera.up, 0, 0, -1);
    s->view.camera.ortho_height = 4;
}

/* World x of a column's centre. */
static double column_x(int x) { return (x + 0.5 - 0.5 * SIDE) * 4 / SIDE; }

/* A horizontal polygon over x0..x1, z0..z1. */
static void add_plate(double x0, double x1, double z0, double z1, double y) {
    const double origin[3] = {x0, y, z0}, u[3] = {x1 - x0, 0, 0}, v[3] = {0, 0, z1 - z0};
    check_add_quad(&blocker, origin, u, v);
}

static sps_light *add_disc(check_scene *s, double x, double y, double z, double radius) {
    sps_light *light = check_add_light(s, SPS_LIGHT_DISC, 4 * y * y);
    check_set3(light->position, x, y, z);
    check_set3(light->axes[0], radius, 0, 0);
    check_set3(light->axes[1], 0, 0, radius);
    return light;
}

/* The ground, half of which is below a plate half-way to a light with half axes of 1. */
static sps_light *start_edge(check_scene *s, sps_light_kind kind, int points) {
    sps_light *light;
    start(s);
    add_plate(-40, 0, -40, 40, 10);
    check_add_mesh(s, &blocker, 0.5);
    light = add_disc(s, 0, 20, 0, 1);
    light->kind = kind;
    light->samples = points;
    return light;
}

/* Share of a disc beyond a straight line at u radii from its centre. */
static double disc_share(double u) {
    u = fmin(fmax(u, -1), 1);
    return 0.5 + (asin(u) + u * sqrt(1 - u * u)) / PI;
}

/* The same for a square, across its sides. */
static double square_share(double u) { return fmin(fmax(0.5 + 0.5 * u, 0), 1); }

static void look_at_rows(check_scene *s) {
    static const int rows[4] = {0, SIDE / 2 - ROWS / 2, SIDE, ROWS};
    memcpy(s->view.region, rows, sizeof rows);
}

/* Renders the middle rows without and with the blocker into image_b and image_a. The mean of the ratio over a column is
   its visible share. */
static void render_ratio(check_scene *s, int blockers_mesh, int blockers_volume) {
    look_at_rows(s);
    s->scene.mesh_count -= blockers_mesh;
    s->scene.volume_count -= blockers_volume;
    check_render(context, s, image_b);
    s->scene.mesh_count += blockers_mesh;
    s->scene.volume_count += blockers_volume;
    check_render(context, s, image_a);
}

static double ratio_at(int x, int y) {
    const size_t at = 4 * (size_t)(y * SIDE + x);
    return (double)image_a[at] / (double)image_b[at];
}

static double share_at(int x) {
    double sum = 0;
    for (int y = 0; y < ROWS; ++y) sum += ratio_at(x, y) / ROWS;
    return sum;
}

/* The root mean square, over all columns, of the difference to a closed form of the share at x / half. */
static double edge_error(double half, double (*share)(double)) {
    double sum = 0;
    for (int x = 0; x < SIDE; ++x) sum += pow(share_at(x) - share(column_x(x) / half), 2);
    return sqrt(sum / SIDE);
}

/* A straight edge half-way between the light and the ground: the penumbra is as wide as the light. K points that lie
   evenly are K steps of 1 / K at most, with a mean error of 1 / (K sqrt 12); a disc's spiral is no worse than twice
   that. */
static void test_straight_edges(void) {
    static const int counts[] = {16, 64, 256};
    double errors[2][3];
    for (int kind = 0; kind < 2; ++kind)
        for (int i = 0; i < 3; ++i) {
            check_scene s;
            start_edge(&s, kind ? SPS_LIGHT_RECTANGLE : SPS_LIGHT_DISC, counts[i]);
            render_ratio(&s, 1, 0);
            errors[kind][i] = edge_error(1, kind ? square_share : disc_share);
            if (figures()) printf("edge %s, %d points: %.5f\n", kind ? "square" : "disc", counts[i], errors[kind][i]);
            CHECK_CASE("Shadows", "penumbra of a straight edge, disc and square, 16 to 256 points",
                       "closed form of the visible share, rms", errors[kind][i], 2 / (counts[i] * sqrt(12.0)) + 0.002,
                       "K steps of 1 / K, twice that for a spiral; cosines (1 / 20)^2");
        }
    for (int kind = 0; kind < 2; ++kind) {
        const double slope = log(errors[kind][2] / errors[kind][0]) / log(16.0);
        if (figures()) printf("edge %s: error falls as K^%.2f\n", kind ? "square" : "disc", slope);
        CHECK_CASE("Shadows", "K points of a light, 16 to 256", "the error falls faster than K^-0.6", slope, -0.6,
                   "random points have K^-0.5");
    }
    CHECK(errors[0][2] < 0.02 && errors[1][2] < 0.02);
}

/* A square on its corner: the share that an edge hides is that of a triangle's distribution. */
static double corner_share(double u) {
    u = fmin(fmax(u, -1), 1);
    return 0.5 + u - 0.5 * u * fabs(u);
}

static void test_square_on_its_corner(void) {
    check_scene s;
    sps_light *light = start_edge(&s, SPS_LIGHT_RECTANGLE, 64);
    check_set3(light->axes[0], 0.5, 0, 0.5);
    check_set3(light->axes[1], 0.5, 0, -0.5);
    render_ratio(&s, 1, 0);
    if (figures()) printf("square on its corner: %.5f\n", edge_error(1, corner_share));
    CHECK(edge_error(1, corner_share) < 2 / (64 * sqrt(12.0)) + 0.002);
}

/* The sun: a penumbra of 2 D tan(angle / 2) at distance D. */
static void test_sun(void) {
    check_scene s;
    sps_light *sun = start_edge(&s, SPS_LIGHT_DIRECTIONAL, 256);
    check_set3(sun->direction, 0, -1, 0);
    sun->angular_diameter = 2 * atan(0.1);
    render_ratio(&s, 1, 0);
    CHECK_NEAR(edge_error(1, disc_share), 0, 0.004);
}

/* A disc of radius 1/2 half-way to a light of radius 1: as seen from the ground below it covers all of the light, and
   from points nearer to the light than half-way a part. At height h, the blocker looks like a disc of radius
   (20 - h) / (10 - h) / 2 in the light's plane. */
static void test_vanishing_umbra(void) {
    static const double heights[] = {12, 15, 17.5}; /* of the blocker; the ground is at 0 */
    for (int i = 0; i < 3; ++i) {
        const double radius = 0.3, seen = radius * 20 / heights[i];
        check_scene s;
        double corners[33][3];
        start(&s);
        for (int k = 0; k < 33; ++k)
            check_set3(corners[k], radius * cos(2 * PI * k / 32), heights[i], radius * sin(2 * PI * k / 32));
        for (int k = 0; k < 32; ++k) {
            const double middle[3] = {0, heights[i], 0};
            check_add_corners(&blocker, middle, corners[k], corners[k + 1]);
        }
        check_add_mesh(&s, &blocker, 0.5);
        add_disc(&s, 0, 20, 0, 1)->samples = 256;
        render_ratio(&s, 1, 0);
        /* a polygon of 32 corners lacks 0.6 % of the area; 256 points miss by a part of their rim, 1 / sqrt(256) / 4 */
        CHECK_CASE("Shadows", "disc before a larger light: the umbra vanishes", "the ring that it leaves",
                   fabs(0.25 * (ratio_at(31, 3) + ratio_at(31, 4) + ratio_at(32, 3) + ratio_at(32, 4)) -
                        (1 - fmin(seen * seen, 1))),
                   0.02, "256 points miss by 1 / 16 of a quarter; 32 corners lack 0.6 %");
    }
}

/* --- gas --- */

static int read_full(void *user, const int low[3], const int size[3], float *out) {
    (void)user, (void)low;
    for (int64_t i = 0; i < (int64_t)size[0] * size[1] * size[2]; ++i) out[i] = 1;
    return 0;
}

/* A slab of gas over x < 0 as a blocker, in `count` layers of voxels, opaque, or of transmittance one half. Its edge is
   that of voxels of 1/16, half a width blurred by 0.65 voxels. It is as wide as light needs on its way to the middle
   rows. */
static void add_gas_plate(check_scene *s, double y, int count, double depth) {
    const double thick = 0.5;
    sps_volume *volume = check_add_volume(s, 40, count, 48, check_box(-2.5, y, -1.5, 0, y + thick, 1.5));
    volume->read_fn = read_full;
    volume->extinction = (float)(depth / thick);
    check_color(volume->albedo, 0, 0, 0);
}

static void add_wide(check_scene *s, int square) {
    sps_light *light = add_disc(s, 0, 20.5, 0, 1);
    light->kind = square ? SPS_LIGHT_RECTANGLE : SPS_LIGHT_DISC;
    light->samples = 64;
}

/* Compares the penumbra on the ground with the closed form. */
static void check_gas_edge(check_scene *s, int square, const char *what, int count) {
    double error = 0;
    render_ratio(s, 0, 1);
    for (int x = 0; x < SIDE; ++x) {
        const double u = column_x(x) / (10.25 / 10.25), lit = square ? square_share(u) : disc_share(u);
        error += pow(share_at(x) - (lit + (1 - lit) * exp(-0.7)), 2) / SIDE;
    }
    error = sqrt(error);
    if (figures()) printf("gas edge %s, %d %s: %.5f\n", square ? "square" : "disc", count, what, error);
    CHECK_CASE("Shadows", "penumbra of gas, disc and square, in 4 to 64 layers, 16 to 1024 sheets",
               "the same closed form, rms", error, 0.02, "its edge's blur, 0.04 of the penumbra, adds by squares");
}

/* Blur of a volume's edge and of the penumbra add by squares: 0.65/16 = 0.04 of a penumbra of 1 changes its middle by
   far less than the 2 % that are wanted. Where gas begins, its optical depth is not yet all there: a row of voxels is
   left out of an opaque plate's edge, which moves where half of the light is lost. */
static void test_gas_edges(void) {
    static const int layers[] = {4, 16, 64};
    for (int kind = 0; kind < 2; ++kind)
        for (int i = 0; i < 3; ++i) {
            check_scene s;
            start(&s);
            add_gas_plate(&s, 10, layers[i], 0.7);
            add_wide(&s, kind);
            check_gas_edge(&s, kind, "layers", layers[i]);
        }
}

/* Gas over x < 0 above the ground, and below it all over, so that the ground lies amid sheets. */
static int read_amid(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) {
        const int x = low[0] + i % size[0], y = low[1] + i / size[0] % size[1];
        out[i] = y < 6 || (y >= 22 && x < 16);
    }
    return 0;
}

/* A wide disc's penumbra within one chunk of sheets, which light passes at slants of up to 35 degrees, against the
   reference with as many points. Each misses by 0.0085 of the light at an edge (test_straight_edges), as rms. */
static void test_ground_amid(void) {
    static const int region[4] = {SIDE / 2 - 8, SIDE / 2, 16, 1};
    const double origin[3] = {-1, 0, -0.5}, u[3] = {2, 0, 0}, v[3] = {0, 0, 1};
    check_scene s;
    sps_volume *volume;
    double off = 0, lit;
    start(&s);
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    s.mesh[0].triangle_count = ground.count;
    add_disc(&s, 0, 20, 0, 14)->samples = 64;
    s.view.shadow_resolution = 300;   /* light crosses tens of texels within a chunk */
    s.view.camera.position[1] = 0.25; /* below what is above the ground */
    memcpy(s.view.region, region, sizeof region);
    check_render(context, &s, image_c);
    lit = (double)image_c[0];
    volume = check_add_volume(&s, 32, 26, 16, check_box(-1, -1, -0.5, 1, 0.625, 0.5));
    volume->read_fn = read_amid;
    volume->extinction = (float)(0.7 / 0.25);
    check_color(volume->albedo, 0, 0, 0);
    check_render(context, &s, image_a);
    check_march(context, &s, 0.14, image_b, NULL);
    for (int i = 0; i < 16; ++i) off = fmax(off, fabs((double)image_a[4 * i] - (double)image_b[4 * i]) / lit);
    if (figures()) printf("ground amid sheets: off by %.3g\n", off);
    CHECK(off < 2 * 0.0085 * sqrt(2));
}

/* The same in other numbers of sheets, which have nothing to do with where light is lost. The number at a slab of one
   voxel, from which the others follow, is rounded up. */
static void test_gas_sheets(void) {
    static const int sheets[] = {16, 128, 1024};
    for (int kind = 0; kind < 2; ++kind)
        for (int i = 0; i < (check_long() ? 3 : 2 - kind); ++i) {
            sps_stats_report stats;
            double whole;
            check_scene s;
            start(&s);
            add_gas_plate(&s, 10, 4, 0.7);
            add_wide(&s, kind);
            s.view.slab_thickness = 1;
            look_at_rows(&s);
            check_render(context, &s, image_a);
            sps_get_stats(context, &stats);
            whole = (double)stats.slabs;
            s.view.slab_thickness = whole / sheets[i];
            check_gas_edge(&s, kind, "sheets", sheets[i]);
            sps_get_stats(context, &stats);
            CHECK_NEAR((double)stats.slabs, sheets[i], 1 + sheets[i] / whole);
        }
}

/* The share of a disc that reaches a point through the blurred edge at x = 0 of gas of optical depth `depth`: an
   integral over the disc's chords. */
static double disc_through_edge(double x, double half, double sigma, double depth) {
    double sum = 0, all = 0;
    for (int i = 0; i < 400; ++i) {
        const double t = (i + 0.5) / 200 - 1, weight = sqrt(1 - t * t);
        sum += weight * exp(-depth * 0.5 * erfc((x + t * half) / (sigma * sqrt(2.0))));
        all += weight;
    }
    return sum / all;
}

/* A little plate of gas far above the ground: within the gas penumbrae are a third of a texel wide, on the ground one
   and a half pixels. 64 points miss as they do at a polygon's edge, by 0.0085 (above), times the light that the plate
   keeps off.
 */
static void test_far_ground(void) {
    const double half = 10 * tan(0.0045);
    check_scene s;
    sps_light *sun;
    sps_volume *volume;
    double error = 0;
    start(&s);
    volume = check_add_volume(&s, 16, 4, 16, check_box(-0.8, 10, -0.4, 0, 10.2, 0.4));
    volume->read_fn = read_full;
    volume->extinction = 10;
    sun = check_add_directional(&s, 0, -1, 0, 2);
    sun->angular_diameter = 0.009;
    sun->samples = 64;
    render_ratio(&s, 0, 1);
    for (int x = SIDE / 2 - 5; x < SIDE / 2 + 5; ++x) {
        const double exact = disc_through_edge(column_x(x), half, 0.65 * 0.05, 2);
        error += pow(share_at(x) - exact, 2) / 10;
        if (figures()) printf("  %.3f: %.4f, exactly %.4f\n", column_x(x), share_at(x), exact);
    }
    if (figures()) printf("little plate above a far ground: %.5f\n", sqrt(error));
    CHECK(sqrt(error) < 0.0085);
    sun->angular_diameter = 0;
    render_ratio(&s, 0, 1);
    CHECK_NEAR(share_at(SIDE / 2 + 1), disc_through_edge(column_x(SIDE / 2 + 1), 0, 0.65 * 0.05, 2), 0.0085);
}

/* --- nothing is lost where there is no extent --- */

static int read_ball(void *user, const int low[3], const int size[3], float *out) {
    const double n = *(const int *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x) {
                const double p[3] = {(low[0] + x + 0.5) / n - 0.5, (low[1] + y + 0.5) / n - 0.5,
                                     (low[2] + z + 0.5) / n - 0.5};
                *out++ = (float)fmin(fmax(8 * (0.35 - sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])) + 0.5, 0), 1);
            }
    return 0;
}

/* A ball of gas above the ground, seen from the side, and a plate that cuts off a part of the light. */
static void start_ball(check_scene *s, int polygons) {
    static int n = 14;
    sps_volume *ball;
    check_clear(s, SIDE, SIDE);
    ground.count = blocker.count = 0;
    ball = check_add_volume(s, n, n, n, check_box(-1, 0.2, -1, 1, 2.2, 1));
    ball->read_fn = read_ball;
    ball->user = &n;
    ball->extinction = 5;
    check_color(ball->albedo, 0.9, 0.8, 0.6);
    if (polygons) {
        const double origin[3] = {-4, 0, -4}, u[3] = {8, 0, 0}, v[3] = {0, 0, 8};
        check_add_quad(&ground, origin, u, v);
        check_add_mesh(s, &ground, 0.5);
        add_plate(-0.9, 0.1, -0.8, 0.9, 2.5);
        check_add_mesh(s, &blocker, 0.5);
    }
    check_set3(s->view.camera.position, 1.5, 2.6, 5);
    check_set3(s->view.camera.target, 0, 0.9, 0);
    check_set3(s->view.camera.up, 0, 1, 0);
    check_perspective(&s->view.camera, 0.7);
    s->view.quality = SPS_QUALITY_HIGH;
}

static void test_no_extent(void) {
    check_scene s;
    sps_stats_report stats;
    sps_plan_report plan;
    start_ball(&s, 1);
    check_add_point(&s, 1, 5, 1, 30);
    check_add_directional(&s, 0.3, -1, -0.2, 1);
    check_render(context, &s, image_a);
    s.light[0].kind = SPS_LIGHT_DISC;
    s.light[0].samples = s.light[1].samples = 9;
    check_render(context, &s, image_b);
    CHECK_CASE("Shadows", "lights of extent 0", "the hard shadows", memcmp(image_a, image_b, sizeof image_a) != 0, 0,
               "same bits");
    sps_get_stats(context, &stats);
    CHECK(stats.soft_texels == 0);
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.light_points == 1 && plan.pass[SPS_PASS_PENUMBRAE].runs == 0);
    CHECK(strstr(plan.pass[SPS_PASS_PENUMBRAE].reason, "no area light casts shadows") != NULL);
    /* penumbrae of less than half a texel are left sharp in gas, and the plan says so */
    check_set3(s.light[0].axes[0], 1e-4, 0, 0);
    s.light[1].angular_diameter = 1e-4;
    s.scene.mesh_count = 0;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.light_points == 9 && plan.pass[SPS_PASS_PENUMBRAE].runs == 0);
    CHECK(strstr(plan.pass[SPS_PASS_PENUMBRAE].reason, "half a texel") != NULL);
    s.scene.mesh_count = 2;
    check_render(context, &s, image_b);
    sps_get_stats(context, &stats);
    CHECK(stats.soft_texels == 0);
    /* a penumbra on the ground, 2.5 below the plate, is 2.5e-4 wide: less than 1 in 100 pixels sees a part of it */
    CHECK(check_rms(image_a, image_b, 4 * SIDE * SIDE) < 0.01);
    s.light[1].angular_diameter = 0.1;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.pass[SPS_PASS_PENUMBRAE].runs == 2 && plan.pass[SPS_PASS_PENUMBRAE].bytes > 0);
    check_render(context, &s, image_b);
    sps_get_stats(context, &stats);
    CHECK(stats.soft_texels > 0);
    check_free_triangles(&ground);
    check_free_triangles(&blocker);
}

/* --- all kinds against the reference --- */

static void set_wide(check_scene *s, int kind) {
    sps_light *light = kind == SPS_LIGHT_DIRECTIONAL ? check_add_directional(s, -0.3, -1, 0.25, 2)
                                                     : check_add_light(s, (sps_light_kind)kind, 150);
    light->angular_diameter = kind == SPS_LIGHT_DIRECTIONAL ? 0.3 : 0;
    check_set3(light->position, 1.5, 9, 2);
    check_set3(light->axes[0], 0.5, 0, 0.1);
    check_set3(light->axes[1], 0, 0.3, 0.5);
}

/* A region of the picture whose reference takes half a second. Its points are another set than the renderer's; the
   noise of `points` points at a surface is at most 1 / sqrt(4 points) where light is half seen, and far less in gas,
   where each ray has a hundred samples. */
static double reference_error(check_scene *s, int points, double *mean) {
    static const int region[4] = {26, 24, 6, 6};
    const int count = 4 * 6 * 6;
    double sum = 0;
    memcpy(s->view.region, region, sizeof region);
    s->light[0].samples = 64;
    check_render(context, s, image_a);
    s->light[0].samples = points;
    check_march(context, s, 0.14, image_b, NULL);
    for (int i = 0; i < count; ++i) sum += (double)image_b[i] / count;
    *mean = sum;
    return check_rms(image_a, image_b, (size_t)count);
}

static void test_reference(void) {
    static const char *const names[] = {"sun", "point", "disc", "rectangle"};
    for (int kind = 0; kind < 4; ++kind)
        for (int polygons = 0; polygons < 2; ++polygons) {
            check_scene s;
            double hard, error, mean;
            if (kind == SPS_LIGHT_POINT || (!check_long() && (kind == SPS_LIGHT_DISC || !polygons))) continue;
            start_ball(&s, polygons);
            set_wide(&s, kind);
            error = reference_error(&s, 8, &mean);
            s.light[0].angular_diameter = 0;
            if (kind) s.light[0].kind = SPS_LIGHT_POINT;
            hard = reference_error(&s, 1, &mean);
            if (figures())
                printf("%s%s: rms error %.5f, of the same light without extent %.5f, mean %.4f\n", names[kind],
                       polygons ? " with polygons" : "", error, hard, mean);
            CHECK_CASE("What users of other renderers complain of",
                       "area lights ignored in media: sun, disc, rectangle", "brute force, rms", error,
                       hard + 0.0025 * mean,
                       "the light's without extent; 8 points' noise, half of what a shift would cost");
        }
    check_free_triangles(&ground);
    check_free_triangles(&blocker);
}

/* --- one light as another --- */

static int read_blobs(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x)
                *out++ = (float)((low[0] + x) % 12 < 3 && (low[1] + y) % 12 < 3 && (low[2] + z) % 12 < 3);
    return 0;
}

/* Little blobs apart from each other, or a fog amid which the ground lies, seen from the side. */
static void start_field(check_scene *s, int fog) {
    sps_volume *volume;
    start(s);
    volume = check_add_volume(s, 48, 48, 48, check_box(-1.5, fog ? -1.5 : 0.1, -1.5, 1.5, fog ? 1.5 : 3.1, 1.5));
    volume->read_fn = fog ? read_full : read_blobs;
    volume->extinction = fog ? 0.7f : 9.0f;
    check_color(volume->albedo, 0.8, 0.8, 0.8);
    check_set3(s->view.camera.position, 2, 3, 6);
    check_set3(s->view.camera.target, 0, 0.6, 0);
    check_set3(s->view.camera.up, 0, 1, 0);
}

/* A sun of 0.01 has penumbrae of up to 0.03 in a field of 3, half a voxel: soft light, but nearly the picture of the
   sharp sun. Edges of blobs are blurred by 0.65 voxels, which becomes hypot(0.65, 0.25): 7 % wider. Light in gas and on
   the ground comes by another path (planes and beams; planes and chunks), whose texels lie elsewhere. */
static void test_nearly_sharp(void) {
    for (int fog = 0; fog < 2; ++fog) {
        sps_stats_report stats;
        check_scene s;
        double error;
        start_field(&s, fog);
        check_add_directional(&s, -0.3, -1, -0.2, 2);
        check_render(context, &s, image_a);
        s.light[0].angular_diameter = 0.01;
        s.view.shadow_resolution = 160; /* texels of a third of a voxel */
        check_render(context, &s, image_b);
        sps_get_stats(context, &stats);
        CHECK(stats.soft_texels > 0);
        error = error_of(image_a, image_b, SIDE * SIDE);
        if (figures()) printf("nearly sharp, %s: rms %.5f of the mean\n", fog ? "fog" : "blobs", error);
        CHECK_CASE("Shadows", "sun of 0.01 radians", "nearly the sharp sun's picture, rms of the mean", error,
                   fog ? 0.004 : 0.03, "edges of blobs are 7 % wider; fog has none");
    }
}

/* --- beams --- */

/* Gas with a plate over x < 0, at z around 0. */
static void start_plate(check_scene *s, int (*read_fn)(void *, const int *, const int *, float *), int layers) {
    start(s);
    s->scene.mesh_count = 0;
    sps_volume *volume = check_add_volume(s, 64, layers, 64, check_box(-1, 1 - layers / 32.0, -1, 1, 1, 1));
    volume->read_fn = read_fn;
    volume->extinction = 64;
    check_color(volume->albedo, 0.8, 0.8, 0.8);
    check_set3(s->view.camera.position, 0, 1 - layers / 64.0, 8);
    check_set3(s->view.camera.target, 0, 1 - layers / 64.0, 0);
    check_set3(s->view.camera.up, 0, 1, 0);
    s->view.camera.ortho_height = layers / 32.0;
    check_add_directional(s, 0, -1, 0, 2);
    s->light[0].samples = 256;
}

/* Fog right below the plate, and narrower, so that all of it sees the plate as endless along z. */
static int read_eaves(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int z = low[2]; z < low[2] + size[2]; ++z)
        for (int y = low[1]; y < low[1] + size[1]; ++y)
            for (int x = low[0]; x < low[0] + size[0]; ++x)
                *out++ = y >= 60 ? (float)(x < 32) : abs(z - 32) < 13 ? 1e-4f : 0;
    return 0;
}

/* The mean of sharp suns, evenly over the disc of a wide one, in image_c. */
static void render_suns(check_scene *s, double diameter, int count) {
    sps_light *light = &s->light[0];
    memset(image_c, 0, sizeof image_c);
    light->angular_diameter = 0;
    for (int i = 0; i < count; ++i) {
        const double turn = 2.4 * i + 1, out = tan(diameter / 2) * sqrt((i + 0.5) / count);
        check_set3(light->direction, out * cos(turn), -1, out * sin(turn));
        check_render(context, s, image_a);
        for (int k = 0; k < 4 * SIDE * SIDE; ++k) image_c[k] += image_a[k] / (float)count;
    }
}

/* Sharp suns look planes up linearly, which adds a sixth of a square texel on average, or voxel, to the variance of a
   plate's blur: 0.65 becomes 0.77. Half of the light passes at 1.36 times that from the edge, which moves by 0.16
   voxels. Over a penumbra of w of 64 columns, this is 0.16 / w of full light: 0.04 / sqrt(w) of the mean, rms. With the
   blur, the narrowest sun's has 2.5 columns on average. */
static void test_steps(void) {
    static const double suns[] = {0.06, 0.2, 0.6};
    for (int i = 0; i < 3; ++i) {
        if (!check_long() && i != 1) continue;
        static const int below[4] = {0, SIDE / 8, SIDE, SIDE - SIDE / 8};
        check_scene s;
        start_plate(&s, read_eaves, 64);
        memcpy(s.view.region, below, sizeof below);
        s.light[0].angular_diameter = (float)suns[i];
        check_render(context, &s, image_b);
        render_suns(&s, suns[i], 128);
        const double error = error_of(image_c, image_b, (size_t)(below[2] * below[3]));
        if (figures()) printf("steps, sun of %.2f: rms %.5f of the mean\n", suns[i], error);
        CHECK(error < 0.025);
    }
}

static int plate_layers;

/* Fog far below the plate, and at the side at all heights. */
static int read_gap(void *user, const int low[3], const int size[3], float *out) {
    (void)user;
    for (int z = low[2]; z < low[2] + size[2]; ++z)
        for (int y = low[1]; y < low[1] + size[1]; ++y)
            for (int x = low[0]; x < low[0] + size[0]; ++x) {
                const int top = y >= plate_layers - 4;
                const float value = top && x < 32 ? 1 : y < 6 || (x >= 56 && !top) ? 1e-4f : 0;
                *out++ = abs(z - 32) < 13 ? value : 0;
            }
    return 0;
}

/* Between plate and fog lie chunks that hold gas, but not on the beams' way. */
static void test_gap(void) {
    for (plate_layers = 96; plate_layers <= 128; plate_layers += 8) { /* an odd or even number of chunks */
        check_scene s;
        start_plate(&s, read_gap, plate_layers);
        s.view.shadow_resolution = 256;
        s.light[0].angular_diameter = 0.02f;
        check_render(context, &s, image_a);
        /* 2 to 4 voxels above the fog's bottom, at x of -0.5 and 0.5 */
        const float *middle = image_a + 4 * (SIDE * (SIDE - 2) + SIDE / 2);
        const float *dark = middle - 4 * (16 * SIDE / plate_layers), *lit = middle + 4 * (16 * SIDE / plate_layers);
        if (figures()) printf("fog far below a plate: %.7f, beside it %.7f\n", (double)*dark, (double)*lit);
        CHECK(*lit > 0);
        /* exp(-8) of the light passes the plate; half of a voxel at each end of the fog is lit, 1 voxel in 25 */
        CHECK(*dark < 0.04f * *lit);
    }
}

/* A distant disc is a sun, whose rays are no longer parallel by the width of the field over its distance, 3 / 400, and
   whose light grows by twice that towards the field's top. */
static void test_distant_disc(void) {
    for (int fog = 0; fog < 2; ++fog) {
        const double distance = 400, radius = distance * tan(0.1);
        check_scene s;
        double error;
        start_field(&s, fog);
        check_add_directional(&s, 0, -1, 0, 2)->angular_diameter = 0.2;
        s.light[0].samples = 64;
        check_render(context, &s, image_a);
        s.scene.light_count = 0;
        add_disc(&s, 0, distance, 0, radius)->samples = 64;
        check_color(s.light[0].color, 2 * distance * distance, 2 * distance * distance, 2 * distance * distance);
        check_render(context, &s, image_b);
        error = error_of(image_a, image_b, SIDE * SIDE);
        if (figures()) printf("distant disc, %s: rms %.5f of the mean\n", fog ? "fog" : "blobs", error);
        CHECK(error < 0.015);
    }
}

/* --- spotlights --- */

/* On the ground below it a spotlight's share follows from the cosine alone; gas sees the same cone as the reference. */
static void test_cone(void) {
    check_scene s;
    sps_light *spot;
    double worst = 0, bare, error, mean;
    start(&s);
    spot = check_add_point(&s, 0, 5, 0, 100);
    check_render(context, &s, image_b);
    check_set3(spot->direction, 0.2, -2, 0.1);
    spot->inner_cone = 0.1;
    spot->outer_cone = 0.3;
    check_render(context, &s, image_a);
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x) {
            const double to[3] = {column_x(x), -5, column_x(y)}, axis[3] = {0.2, -2, 0.1};
            const double cosine = vec_dot(to, axis) / (vec_length(to) * vec_length(axis));
            const double share = fmin(fmax((cosine - cos(0.3)) / (cos(0.1) - cos(0.3)), 0), 1);
            worst = fmax(worst, fabs(ratio_at(x, y) - share * share));
        }
    CHECK(worst < 1e-4); /* 1 / (cos .1 - cos .3) = 25 times the rounding of a float, and of the ratio */
    for (int extended = 0; extended < 2; ++extended) {
        start_ball(&s, 1);
        set_wide(&s, extended ? SPS_LIGHT_DISC : SPS_LIGHT_POINT);
        check_set3(s.light[0].direction, -1.5, -8, -1.8);
        bare = reference_error(&s, extended ? 8 : 1, &mean);
        s.light[0].inner_cone = 0.03;
        s.light[0].outer_cone = 0.12;
        error = reference_error(&s, extended ? 8 : 1, &mean);
        if (figures())
            printf("spot%s: rms error %.5f, without cone %.5f, mean %.4f\n", extended ? " of a disc" : "", error, bare,
                   mean);
        CHECK(error < bare + 0.005 * mean);
    }
    check_free_triangles(&ground);
    check_free_triangles(&blocker);
}

/* --- what stays the same --- */

/* Two plates of gas one behind the other hide each other's light: 16 points against 256, and 64 against 256. */
static void test_two_blockers(void) {
    const int counts[] = {16, 64, check_long() ? 256 : 128};
    double errors[2];
    for (int i = 2; i >= 0; --i) {
        check_scene s;
        start(&s);
        add_gas_plate(&s, 8, 8, 6);
        add_gas_plate(&s, 13, 8, 6);
        s.volume[1].placement.origin[0] += 2.2;
        s.volume[1].placement.axis[0][0] = 5;
        add_disc(&s, 0, 20, 0, 1.5)->samples = counts[i];
        look_at_rows(&s);
        check_render(context, &s, i == 2 ? image_c : image_a);
        if (i < 2) errors[i] = check_rms(image_a, image_c, 4 * SIDE * ROWS);
    }
    {
        check_scene s;
        start(&s);
        add_disc(&s, 0, 20, 0, 1.5);
        look_at_rows(&s);
        check_render(context, &s, image_b);
    }
    if (figures())
        printf("two blockers: rms of 16, 64 points against 256: %.5f %.5f of %.4f unshadowed\n", errors[0], errors[1],
               (double)image_b[4 * (ROWS / 2 * SIDE + SIDE / 2)]);
    CHECK_CASE("Shadows", "two plates of gas that hide parts of a disc, 64 points", "that of more points, rms",
               errors[1], 0.005 * (double)image_b[4 * (ROWS / 2 * SIDE + SIDE / 2)],
               "half a percent of the unshadowed ground");
    CHECK(errors[1] < 0.5 * errors[0]);
}

/* The picture of a mirrored scene is the mirrored picture, except for the points' spiral, which turns the other way: as
   far off as 256 points are from more of them. */
static void test_mirror(void) {
    check_scene s;
    double worst = 0;
    start_ball(&s, 0);
    s.view.camera.position[0] = s.view.camera.target[0] = 0;
    set_wide(&s, SPS_LIGHT_DISC);
    s.light[0].samples = 256;
    check_render(context, &s, image_a);
    s.light[0].position[0] *= -1;
    s.light[0].axes[0][0] *= -1;
    s.light[0].axes[1][0] *= -1;
    check_render(context, &s, image_b);
    for (int y = 0; y < SIDE; ++y)
        for (int x = 0; x < SIDE; ++x)
            worst =
                fmax(worst, fabs((double)image_a[4 * (y * SIDE + x)] - (double)image_b[4 * (y * SIDE + SIDE - 1 - x)]));
    if (figures()) printf("mirrored: largest difference %.5f\n", worst);
    CHECK(worst < 0.004);
}

static void test_workers(void) {
    check_hooks hooks;
    sps_context *many;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = 3, hooks.order = 1;
    many = check_context(&hooks);
    for (int kind = 0; kind < 4; ++kind) {
        check_scene s;
        if (kind == SPS_LIGHT_POINT) continue;
        start_ball(&s, 1);
        set_wide(&s, kind);
        check_render(context, &s, image_a);
        check_render(many, &s, image_b);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    }
    sps_destroy(many);
    check_free_triangles(&ground);
    check_free_triangles(&blocker);
}

/* --- what is refused --- */

static void check_refused(const check_scene *s, sps_result result, const char *text) {
    check_fails(context, s, image_a, result, text);
}

static void test_refused(void) {
    sps_tmap_settings map;
    check_scene s;
    memset(&map, 0, sizeof map);
    start_ball(&s, 0);
    set_wide(&s, SPS_LIGHT_DISC);
    s.light[0].samples = 257;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].samples is 257; it must be 0..256");
    s.light[0].samples = -1;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].samples is -1");
    s.light[0].samples = 0;
    s.light[0].axes[1][2] = (double)NAN;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].axes[1] is nan");
    set_wide(&s, SPS_LIGHT_DIRECTIONAL);
    s.light[0] = s.light[1];
    s.scene.light_count = 1;
    s.light[0].angular_diameter = 2.1;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].angular_diameter is 2.1; it must be 0..2 radians");
    s.light[0].angular_diameter = -1;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].angular_diameter is -1");
    s.light[0].angular_diameter = 0.2;
    s.light[0].shadow_map = &map;
    check_refused(&s, SPS_ERROR_UNSUPPORTED, "light[0].shadow_map holds the shadow of a single point");
    s.light[0].shadow_map = NULL;
    s.light[0].angular_diameter = 2;
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    check_refused(&s, SPS_ERROR_UNSUPPORTED, "light[0] is inside or too close");
    s.light[0].kind = SPS_LIGHT_DISC;
    check_set3(s.light[0].axes[0], 40, 0, 0);
    check_refused(&s, SPS_ERROR_UNSUPPORTED, "light[0] is ");
    s.light[0].no_shadow = 1;
    check_render(context, &s, image_b);
    s.light[0].outer_cone = 4;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].outer_cone is 4; it must be 0..pi");
    s.light[0].outer_cone = 0.2;
    s.light[0].inner_cone = 0.2;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].inner_cone is 0.2; it must be 0, or less than outer_cone");
    s.light[0].outer_cone = NAN;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].outer_cone is nan; it must be 0..pi");
    s.light[0].outer_cone = 0.2;
    s.light[0].inner_cone = 0.1;
    check_set3(s.light[0].direction, 0, 0, 0);
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].direction is 0");
    s.light[0].kind = SPS_LIGHT_DIRECTIONAL;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].outer_cone is 0.2; it must be 0: a directional light has no cone");
    s.light[0].outer_cone = 0;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].inner_cone is 0.1; it must be 0: a directional light has no cone");
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    RUN(test_straight_edges);
    RUN(test_square_on_its_corner);
    RUN(test_sun);
    RUN(test_vanishing_umbra);
    RUN(test_gas_edges);
    RUN(test_ground_amid);
    RUN(test_gas_sheets);
    RUN(test_far_ground);
    RUN(test_no_extent);
    RUN(test_reference);
    RUN(test_nearly_sharp);
    RUN(test_steps);
    RUN(test_gap);
    RUN(test_distant_disc);
    RUN(test_cone);
    RUN_LONG(test_two_blockers);
    RUN(test_mirror);
    RUN(test_workers);
    RUN(test_refused);
    sps_destroy(context);
    check_free_triangles(&ground);
    check_free_triangles(&blocker);
    return check_report();
}
