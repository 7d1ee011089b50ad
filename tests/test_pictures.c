/* Small scenes for errors that larger ones hide: several lights, the parameters of each quality, the defaults of zero
   fields. Each has a closed form, or must equal another picture bit for bit. Tolerances are derived where they are
   used, from
   RIPPLE  the error of a constant grid's optical depth at draft, medium, high and ultra (test_ripple in
           test_transport.c), as kernels are cut;
   ROUND   float round-off of a picture: 6e-8 for each of about ten operations. */

#include "check.h"

#define ROUND 1e-6

enum { SIDE = 24, PIXELS = SIDE * SIDE };
static const sps_quality qualities[4] = {SPS_QUALITY_DRAFT, SPS_QUALITY_MEDIUM, SPS_QUALITY_HIGH, SPS_QUALITY_ULTRA};
static const double ripple[4] = {0.0152, 0.0037, 0.002, 0.002};
static sps_context *context;
static float one = 1;
static float image_a[4 * PIXELS], image_b[4 * PIXELS];

/* A slab of voxels of 0.1 around the origin, of optical depth tau along z, absorbing only. */
static sps_volume *add_slab(check_scene *s, double tau) {
    sps_volume *volume = check_add_volume(s, 35, 35, 6, check_box(-1.75, -1.75, -0.3, 1.75, 1.75, 0.3));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)(tau / 0.6);
    return volume;
}

/* 4 x 4 pixels that show `height` world units around x, from above. */
static void start(check_scene *s, double x, double height) {
    check_clear(s, 4, 4);
    s->view.camera.position[0] = s->view.camera.target[0] = x;
    check_orthographic(&s->view.camera, height);
}

/* A grey plate across the view at height z, wide enough for all of these tests. */
static void add_plate(check_scene *s, check_triangles *triangles, double z, double reflectance) {
    const double origin[3] = {-4, -4, z}, u[3] = {8, 0, 0}, v[3] = {0, 8, 0};
    check_add_quad(triangles, origin, u, v);
    check_add_mesh(s, triangles, reflectance);
}

/* All pixels of a channel are `exact`. */
static int even(const float *image, int pixels, int channel, double exact, double tolerance) {
    int good = 1;
    for (int i = 0; i < pixels && good; ++i) good = CHECK_NEAR((double)image[4 * i + channel], exact, tolerance);
    return good;
}

/* --------------------------------------------------------------------------------------------------- several lights */

/* Directions of three lights, each of which shines in one channel only. */
static const double ways[3][3] = {{0.3, 0, -1}, {-0.25, 0.1, -1}, {0, 0.4, -1}};
static const double strengths[3] = {2, 3, 5};

static double cosine_of(int light) {
    return 1 / sqrt(ways[light][0] * ways[light][0] + ways[light][1] * ways[light][1] + 1);
}

/* The three lights in the order `first`, `first + 1`, ..; light number `unshadowed` casts no shadow. */
static void add_lights(check_scene *s, int first, int unshadowed) {
    for (int i = 0; i < 3; ++i) {
        const int n = (first + i) % 3;
        sps_light *light = check_add_directional(s, ways[n][0], ways[n][1], ways[n][2], 0);
        light->color[n] = (float)strengths[n];
        light->no_shadow = n == unshadowed;
    }
}

/* A light without shadow beside two with shadows, in every order: on a plate below absorbing gas, it alone is not
   dimmed on its way down, nor is ambient light, which counts once. Optical depths are RIPPLE off each, on the way down
   and up. */
static void test_one_light_of_three_without_shadow(void) {
    const double tau = 0.7, reflectance = 0.6, ambient = 0.25;
    for (int first = 0; first < 3; ++first)
        for (int unshadowed = 0; unshadowed < 3; ++unshadowed) {
            check_triangles triangles = {NULL, 0, 0, 0, 0};
            check_scene s;
            start(&s, 0, 0.2);
            add_slab(&s, tau);
            add_plate(&s, &triangles, -0.7, reflectance);
            add_lights(&s, first, unshadowed);
            check_color(s.scene.ambient, ambient, ambient, ambient);
            if (!check_render(context, &s, image_a)) return;
            for (int n = 0; n < 3; ++n) {
                const double down = n == unshadowed ? 0 : tau / cosine_of(n);
                const double direct = strengths[n] * cosine_of(n) / PI * exp(-down);
                const double exact = reflectance * (direct + ambient) * exp(-tau);
                for (int i = 0; i < 16; ++i)
                    if (!CHECK_CASE(
                            "Found in review", "light without shadow beside two that cast shadows, in any order",
                            "dimmed once less", fabs((double)image_a[4 * i + n] - exact),
                            exact * ((tau + down) * ripple[1] + ROUND), "ripple of medium quality, down and up"))
                        printf("    light %d, unshadowed %d, first %d\n", n, unshadowed, first);
            }
            check_free_triangles(&triangles);
        }
}

/* The same in gas so thin that shadows vanish: each light counts once, and so do ambient light and emission. The
   remaining shadow is less than that of the whole way in and out, 2.2 tau. */
static void test_three_lights_in_thin_gas(void) {
    const double tau = 0.002, albedo = 0.8, ambient = 0.3, emission = 0.002;
    for (int first = 0; first < 3; ++first)
        for (int unshadowed = -1; unshadowed < 3; ++unshadowed) {
            check_scene s;
            sps_volume *gas;
            start(&s, 0, 0.2);
            gas = add_slab(&s, tau);
            check_color(gas->albedo, albedo, albedo, albedo);
            check_color(gas->emission, emission, emission, emission);
            check_color(s.scene.ambient, ambient, ambient, ambient);
            add_lights(&s, first, unshadowed);
            if (!check_render(context, &s, image_a)) return;
            for (int n = 0; n < 3; ++n) {
                const double exact = tau * albedo * (strengths[n] / (4 * PI) + ambient) + 0.6 * emission;
                if (!even(image_a, 16, n, exact, exact * (2.2 * tau + ripple[1] + ROUND)))
                    printf("    light %d, unshadowed %d, first %d\n", n, unshadowed, first);
            }
        }
}

/* ------------------------------------------------------------------------------------------ parameters of a quality */

/* Rays end at the transmittance of the quality, and not before: with 2.2 times as much they go on. */
static void test_rays_end(void) {
    static const double thresholds[4] = {0.01, 0.003, 0.0005, 0.00005};
    for (int n = 0; n < 4; ++n) {
        const double through = 2.2 * thresholds[n], tau = -log(through);
        check_scene s;
        start(&s, 0, 0.2);
        s.view.quality = qualities[n];
        add_slab(&s, tau);
        check_color(s.scene.background, 1, 1, 1);
        if (!check_render(context, &s, image_a)) return;
        even(image_a, 16, 0, through, through * (exp(tau * ripple[n]) - 1) + ROUND);
    }
}

/* The thickness of slabs in voxels and the size of texels are those of the quality. Kernels reach 2.5 voxels beyond the
   box on either side; a light's sheets have two texels of border. Rounding up adds one slab, and a pair of texels. */
static void test_slabs_and_texels(void) {
    static const double slabs[2][4] = {{2, 1, 0.5, 0.25}, {1.4, 0.7, 0.4, 0.2}};
    static const double texels[2][4] = {{0.75, 1, 2, 4}, {1, 1.25, 2, 4}};
    const double voxels = 20 + 2 * 2.5;
    const sps_transfer_point points[2] = {{0, {1, 1, 1}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 5, {0, 0, 0}}};
    sps_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.points = points;
    transfer.point_count = 2;
    for (int classified = 0; classified < 2; ++classified)
        for (int n = 0; n < 4; ++n) {
            sps_plan_report plan;
            check_scene s;
            sps_volume *volume;
            check_clear(&s, 800, 800); /* no voxel is smaller than a pixel */
            check_orthographic(&s.view.camera, 3);
            s.view.quality = qualities[n];
            volume = check_add_volume(&s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
            volume->read_fn = check_read_constant;
            volume->user = &one;
            volume->extinction = 1;
            volume->albedo[0] = 1;
            volume->transfer = classified ? &transfer : NULL;
            check_add_directional(&s, 0, 0, -1, 1);
            if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
            CHECK_NEAR(plan.slab_count, voxels / slabs[classified][n] + 0.5, 0.5 + ROUND);
            CHECK_NEAR(plan.shadow_width, voxels * texels[classified][n] + 4 + 1, 1 + ROUND);
            CHECK(plan.shadow_height == plan.shadow_width);
        }
}

/* The number of slabs that a scene under suns from these directions, by their numbers, is planned with. */
static int slabs_under(int lights, const int *numbers) {
    static const double directions[2][3] = {{0, 0, -1}, {1, 1, -1}};
    sps_plan_report plan;
    check_scene s;
    sps_volume *volume;
    check_clear(&s, 40, 30);
    volume = check_add_volume(&s, 20, 18, 16, check_box(-1, -0.9, -0.8, 1, 0.9, 0.8));
    volume->read_fn = check_read_constant, volume->user = &one, volume->extinction = 1, volume->albedo[0] = 1;
    for (int i = 0; i < lights; ++i) {
        const double *way = directions[numbers[i]];
        check_add_directional(&s, way[0], way[1], way[2], 1)->shadow_source = SPS_SHADOW_SHEETS;
    }
    return CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan)) ? plan.slab_count : 0;
}

/* Slabs are those of the longest sweep, whichever light has it. */
static void test_slabs_of_the_longest_sweep(void) {
    static const int orders[2][2] = {{0, 1}, {1, 0}};
    const int a = slabs_under(1, orders[0]), b = slabs_under(1, orders[1]);
    CHECK(a != b);
    for (int n = 0; n < 2; ++n) CHECK(slabs_under(2, orders[n]) == (a > b ? a : b));
}

/* sps_particles.read_fn: balls of radius *(float *)user in a row along z, from -1 to 1, except for the middle one. */
static int read_row(void *user, size_t first, size_t count, sps_particle *out) {
    for (size_t i = 0; i < count; ++i) {
        out[i].position[2] = first + i == 0 ? -1.0f : 1.0f;
        out[i].radius = *(const float *)user;
        out[i].optical_depth = 1;
    }
    return 0;
}

/* The voxel size equivalent to particles: 0.7 radii, or, if they are small in a large cloud, a 200th of the root mean
   square of their distance from their mean, which is 1 here. Rounding up adds up to one slab. */
static void test_slabs_of_particles(void) {
    static const float radii[2] = {0.1f, 0.001f};
    for (int i = 0; i < 2; ++i) {
        const double radius = (double)radii[i], edge = fmax(0.7 * radius, 1.0 / 200);
        float user = radii[i];
        sps_particles particles;
        sps_stats_report stats;
        check_scene s;
        check_clear(&s, 4096, 4096); /* pixels are smaller than particles */
        s.view.region[2] = s.view.region[3] = 8;
        memset(&particles, 0, sizeof particles);
        particles.read_fn = read_row;
        particles.user = &user;
        particles.count = 2;
        s.scene.particles = &particles;
        s.scene.particle_set_count = 1;
        if (!check_render(context, &s, image_a)) return;
        sps_get_stats(context, &stats);
        CHECK_NEAR((double)stats.slabs, 2 * (1 + radius) / edge + 0.5, 0.5 + 1e-3);
    }
}

/* The grid of a light's rays is centred on the gas that it is fitted to, with two texels of border all around, and up
   to one more for rounding on the longer side, two on the shorter one; for point lights and directional ones. */
static void test_border(void) {
    const spsi_bounds bounds = {{-1, -2, -0.5}, {1.5, 1, 0.75}};
    for (int point = 0; point < 2; ++point) {
        double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
        spsi_rays rays;
        spsi_light lamp;
        memset(&lamp, 0, sizeof lamp);
        memset(&rays, 0, sizeof rays);
        lamp.is_point = point;
        check_set3(lamp.direction, -1, -2, -3);
        vec_normalise(lamp.direction);
        check_set3(lamp.position, 2, 4, 6);
        if (!CHECK(spsi_rays_fit(&lamp, &bounds, 0.05, 0, 4096, &rays))) return;
        for (int corner = 0; corner < 8; ++corner) {
            double at[3], q[3];
            spsi_bounds_corner(&bounds, corner, at);
            spsi_project(&rays, at, q);
            for (int k = 0; k < 2; ++k) low[k] = fmin(low[k], q[k]), high[k] = fmax(high[k], q[k]);
        }
        for (int k = 0; k < 2; ++k) {
            const double size = k == 0 ? rays.width : rays.height;
            CHECK_NEAR(low[k], 2.5, 1 + ROUND); /* 1.5 from the outermost texel's centre, and rounding up */
            CHECK_NEAR(low[k] + high[k], size - 1, 1e-6 * size);
        }
    }
}

/* -------------------------------------------------------------------------------------------------- parts of a slab */

/* The integral of 1 + 2 x - 3 x^2 from a to b. */
static double integral(double a, double b) { return b - a + b * b - a * a - (b * b * b - a * a * a); }

/* The same function, without integral. */
static double value_at(double x) { return 1 + 2 * x - 3 * x * x; }

/* A parabola is determined by its means over three slabs, or by its values in their middles, and so is its mean over
   each part of the middle one, or of the rest of that in front of a polygon. */
static void check_parabola(int means) {
    float three[3], lanes[SPSI_LANES];
    spsi_parabola p;
    for (int n = 0; n < 3; ++n) three[n] = (float)(means ? integral(n - 1.5, n - 0.5) : value_at(n - 1));
    p = spsi_parabola_through(spsi_set(three[0]), spsi_set(three[1]), spsi_set(three[2]), means);
    for (int cut = 0; cut < 2; ++cut)
        for (int part = 0; part < SPSI_SUBSLABS; ++part) {
            const double first = cut ? 0.3 : 0, width = (cut ? 0.45 : 1) / SPSI_SUBSLABS,
                         from = first + part * width - 0.5;
            const spsi_portion portion = spsi_portion_of(spsi_set((float)first), spsi_set(cut ? 0.75f : 1), part);
            spsi_store(lanes, spsi_parabola_mean(&p, &portion));
            CHECK_NEAR((double)lanes[0], integral(from, from + width) / width, ROUND);
        }
}

static void test_parabola(void) {
    check_parabola(0);
    check_parabola(1);
}

/* The mean position of what is seen of an interval of optical depth d: the mean of u with weight exp(-d u), which is
   1/d - 1/(exp(d) - 1), or 1/2 - d/12 for small d. ROUND is for the series, which is accurate to 1e-7. */
static void test_mean_way(void) {
    for (double d = 1e-12; d < 100; d *= 1.3) {
        const double exact = d < 1e-3 ? 0.5 - d / 12 : 1 / d - 1 / expm1(d);
        float lanes[SPSI_LANES];
        spsi_store(lanes, spsi_mean_length(spsi_set((float)d)));
        CHECK_NEAR((double)lanes[0], exact, ROUND);
    }
}

/* A plate below a slab that is visible only where its value is close to 1, lit from the side by a point light: the
   light's rays cross slabs at angles that change from texel to texel, and a value is mass per length of ray in a slab.
   Errors are second order in slabs and texels, so that from high to ultra they fall to a quarter, and the error of
   ultra is a third of the difference; as much again is allowed, and RIPPLE of three passes through the gas, where
   extinction changes ten times as fast as the value. */
static void test_light_through_what_is_classified(void) {
    static const sps_transfer_point points[3] = {
        {0.9f, {0, 0, 0}, 0, {0, 0, 0}}, {1, {0, 0, 0}, 1, {0, 0, 0}}, {1.1f, {0, 0, 0}, 0, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    check_triangles triangles = {NULL, 0, 0, 0, 0};
    float reference[4 * 16];
    check_scene s;
    start(&s, 0, 0.8);
    add_slab(&s, 1)->transfer = &transfer;
    add_plate(&s, &triangles, -0.7, 1);
    check_add_point(&s, 1.6, 1.2, 2.4, 5);
    s.view.quality = SPS_QUALITY_HIGH;
    if (!check_render(context, &s, image_a)) return;
    s.view.quality = SPS_QUALITY_ULTRA;
    if (!check_render(context, &s, image_b)) return;
    if (!check_march(context, &s, 0.1, reference, NULL)) return;
    for (int i = 0; i < 16; ++i) {
        const double ultra = (double)image_b[4 * i], high = (double)image_a[4 * i];
        CHECK_NEAR(ultra, (double)reference[4 * i], 2.0 / 3 * fabs(high - ultra) + 10 * 3 * 0.6 * ripple[3] * ultra);
    }
    check_free_triangles(&triangles);
}

/* Optical depth through add_slab's gas with an extinction of 5 at a value of 0.45, falling to 0 at 0 and 0.9: six
   layers of Gaussians, summed in 130 steps per standard deviation of a kernel. */
static double depth_of_faces(void) {
    const double h = 0.0005, sigma = 0.065;
    double depth = 0;
    for (double z = -0.7; z < 0.7; z += h) {
        double value = 0;
        for (int k = 0; k < 6; ++k) {
            const double d = (z + 0.25 - 0.1 * k) / sigma;
            value += 0.1 * exp(-0.5 * d * d) / (sigma * sqrt(2 * PI));
        }
        depth += h * 5 * fmax(0, 1 - fabs(value - 0.45) / 0.45);
    }
    return depth;
}

/* Light is dimmed by a slab that is visible only at its faces, where values rise within two voxels, as the eye's ray
   is: a plate below has the square of the background's transmittance. Values are RIPPLE off, extinction twice that of
   its maximum. At high and ultra quality optical depth is right, too: the error of parabolas through slabs of up to 0.4
   voxels is cubic in these, and that of straight lines, or none, would be visible. */
static void test_light_as_eye(void) {
    static const sps_transfer_point points[3] = {
        {0, {0, 0, 0}, 0, {0, 0, 0}}, {0.45f, {0, 0, 0}, 5, {0, 0, 0}}, {0.9f, {0, 0, 0}, 0, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    for (int n = 0; n < 4; ++n) {
        check_triangles triangles = {NULL, 0, 0, 0, 0};
        double through;
        check_scene s;
        start(&s, 0, 0.8);
        s.view.quality = qualities[n];
        add_slab(&s, 1)->transfer = &transfer;
        add_plate(&s, &triangles, -0.7, 1);
        check_add_directional(&s, 0, 0, -1, PI);
        if (!check_render(context, &s, image_a)) return;
        s.scene.mesh_count = s.scene.light_count = 0;
        if (!check_render(context, &s, image_b)) return;
        through = 1 - (double)image_b[3];
        if (n == 3) CHECK_NEAR(-log(through), depth_of_faces(), depth_of_faces() * 2 * ripple[n]);
        even(image_a, 16, 0, through * through, 2 * through * through * (ROUND - log(through) * 2 * ripple[n]));
        check_free_triangles(&triangles);
    }
}

/* Gas beside the shadow of a plate, whose edge crosses every ray within the gas at another depth: light comes in at 45
   degrees, and a ray that is lit over a length d scatters (1 - e^-a) / (1 + sqrt 2), a = (1 + sqrt 2) d extinction.
   Slabs are 2 voxels thick, tilted by 22.5 degrees, and visibility is tested in the middle of each quarter: an error of
   up to half of that in d, whose mean over all positions in four quarters vanishes except for curvature, a share of
   (quarter * extinction * way)^2 / 24 of the radiance. In addition, RIPPLE of a, and the plate's edge, half a texel off
   in a depth map whose 2044 texels span the gas: 4.9 sin 45 degrees wide, so that d changes by 4.9 / 4088. */
static void test_lit_in_part(void) {
    const double extinction = 3, origin[3] = {-1, -1, 1}, u[3] = {1, 0, 0}, v[3] = {0, 2, 0}, way = 1 + sqrt(2.0);
    const double quarter = 0.05 / cos(PI / 8), first = 0.2;
    double sum = 0, exact = 0, slack = 0;
    check_triangles triangles = {NULL, 0, 0, 0, 0};
    check_scene s;
    sps_volume *gas;
    check_clear(&s, 64, 1);
    check_set3(s.view.camera.position, 0.7 + first + 2 * quarter, 0, 10);
    check_set3(s.view.camera.target, 0.7 + first + 2 * quarter, 0, 0);
    check_orthographic(&s.view.camera, 4 * quarter / 64);
    s.view.quality = SPS_QUALITY_HIGH;
    s.view.slab_thickness = 2;
    gas = add_slab(&s, 0.6 * extinction);
    check_color(gas->albedo, 1, 1, 1);
    check_add_quad(&triangles, origin, u, v);
    check_add_mesh(&s, &triangles, 1);
    check_add_directional(&s, 1, 0, -1, 4 * PI);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 64; ++i) {
        const double d = first + (i + 0.5) / 64 * 4 * quarter, a = way * d * extinction,
                     bend = quarter * way * extinction;
        sum += (double)image_a[4 * i] / 64;
        exact += -expm1(-a) / way / 64;
        slack += exp(-a) / way * (a * ripple[2] + bend * bend / 24 + way * extinction * 4.9 / 4088) / 64;
    }
    CHECK_NEAR(sum, exact, slack);
    check_free_triangles(&triangles);
}

/* Faint gas far below a dense absorbing block, in light from the side that misses the block there: the transmittance of
   the block on the eye's ray, known from alpha, must not affect its light. Its own depth is RIPPLE off, and 4 tau
   allows for its own shadow, which alpha includes, too. */
static void test_light_below_a_block(void) {
    const double tau = 0.0001, cosine = sqrt(0.5);
    check_scene s;
    sps_volume *volume;
    start(&s, -0.5, 0.2);
    s.view.slab_thickness = 3;
    s.view.quality = SPS_QUALITY_HIGH;
    check_color(add_slab(&s, tau)->albedo, 1, 1, 1);
    volume = check_add_volume(&s, 20, 20, 6, check_box(-2, -1, 1.4, 0, 1, 2));
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = 2.5f;
    check_add_directional(&s, -1, 0, -1, 4 * PI * cosine);
    if (!check_render(context, &s, image_a)) return;
    for (int i = 0; i < 16; ++i) {
        const double exact = (1 - (double)image_a[4 * i + 3]) * tau * cosine;
        if (!CHECK_NEAR((double)image_a[4 * i], exact, exact * (ripple[2] + 4 * tau))) return;
    }
}

/* The little light that is left where a ray ends counts there: mean distances are right to the threshold, 0.01 for
   draft quality, times the gas behind, half a slab and RIPPLE of the free length. */
static void test_distance_of_dense_gas(void) {
    float depths[2][16];
    check_scene s;
    start(&s, 0, 0.2);
    s.view.quality = SPS_QUALITY_DRAFT;
    s.view.slab_thickness = 0.25;
    add_slab(&s, 8);
    if (!check_render_depth(context, &s, image_a, depths[0])) return;
    if (!check_march(context, &s, 0.1, image_b, depths[1])) return;
    for (int i = 0; i < 16; ++i)
        if (!CHECK_NEAR((double)depths[0][i], (double)depths[1][i], 0.01 * 0.6 + 0.0125 + 0.6 / 8 * ripple[0])) return;
}

/* A plate fifty thousand slabs behind the gas in front of it is seen like a near one. */
static void test_plate_far_behind(void) {
    const double tau = 0.5, ambient = 0.4, exact = ambient * exp(-tau);
    for (int distant = 0; distant < 2; ++distant) {
        check_triangles triangles = {NULL, 0, 0, 0, 0};
        check_scene s;
        start(&s, 0, 0.2);
        add_slab(&s, tau);
        add_plate(&s, &triangles, distant ? -5000 : -1, 1);
        check_color(s.scene.ambient, ambient, ambient, ambient);
        if (check_render(context, &s, image_a)) even(image_a, 16, 0, exact, exact * tau * ripple[1] + ROUND);
        check_free_triangles(&triangles);
    }
}

/* Two blocks of gas above each other's sides, far apart and in different tiles of the light's sheets; a plate at the
   height of the lower one lies in the shadow of the upper one, whose planes no longer change there. */
static void test_shadow_of_an_earlier_chunk(void) {
    const double tau = 0.8, origin[3] = {-3, -1, -1.5}, u[3] = {3, 0, 0}, v[3] = {0, 2, 0};
    check_triangles triangles = {NULL, 0, 0, 0, 0};
    check_scene s;
    start(&s, -1.5, 0.2);
    s.view.shadow_resolution = 256;
    for (int i = 0; i < 2; ++i) {
        const double x = i == 0 ? -2 : 1, z = i == 0 ? 1 : -2;
        sps_volume *volume = check_add_volume(&s, 10, 10, 10, check_box(x, -0.5, z, x + 1, 0.5, z + 1));
        volume->read_fn = check_read_constant;
        volume->user = &one;
        volume->extinction = (float)tau;
    }
    check_add_quad(&triangles, origin, u, v);
    check_add_mesh(&s, &triangles, 1);
    check_add_directional(&s, 0, 0, -1, PI);
    if (check_render(context, &s, image_a))
        even(image_a, 16, 0, exp(-2 * tau), exp(-2 * tau) * (2 * tau * ripple[1] + ROUND));
    check_free_triangles(&triangles);
}

/* The patches of a tile that a box touches, one by one. */
static void test_patches(void) {
    check_random random = {7};
    for (int n = 0; n < 2000; ++n) {
        uint64_t patches = 0;
        int box[4];
        spsi_tile tile;
        memset(&tile, 0, sizeof tile);
        tile.x0 = 128;
        tile.y0 = 64;
        for (int k = 0; k < 2; ++k) {
            const int corner = k == 0 ? 128 : 64;
            box[k] = corner + (int)(check_next(&random) * SPSI_TILE_WIDTH);
            box[k + 2] = box[k] + (int)(check_next(&random) * (corner + SPSI_TILE_WIDTH - box[k]));
        }
        for (int y = box[1]; y <= box[3]; ++y)
            for (int x = box[0]; x <= box[2]; ++x) {
                const int column = (int)fmin(fmax(x - 128, 0), SPSI_TILE_WIDTH - 1) / SPSI_PATCH;
                const int row = (int)fmin(fmax(y - 64, 0), SPSI_TILE_HEIGHT - 1) / SPSI_PATCH;
                patches |= UINT64_C(1) << (8 * row + column);
            }
        if (!CHECK(spsi_patches(&tile, box[0], box[1], box[2], box[3]) == patches)) return;
    }
}

/* ---------------------------------------------------------------------------------------------- surfaces in volumes */

/* A faint slab that is visible only at its two faces, as surfaces: in light from either side, one of them reflects
   reflectance / pi times irradiance times cosine per optical depth, and a highlight's (n + 8) / (8 pi) (n.h)^n, of
   which half is seen; the other one faces away and reflects nothing. From behind there is no highlight either: it
   points away from the eye. Values are RIPPLE off, extinction twice that, and the way in and out absorbs at most twice
   the total optical depth. */
static void test_faces_of_a_slab(void) {
    static const sps_transfer_point points[3] = {
        {0.1f, {1, 1, 1}, 0, {0, 0, 0}}, {0.5f, {1, 1, 1}, 0.02f, {0, 0, 0}}, {0.9f, {1, 1, 1}, 0, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    const float shininess = 8;
    const double tilt = 0.3, highlight = ((double)shininess + 8) / 8 * pow(cos(tilt / 2), (double)shininess);
    for (int behind = 0; behind < 2; ++behind) {
        const double exact = behind ? 1 : cos(tilt) * (1 + highlight); /* per depth, of irradiance pi */
        sps_volume *volume;
        check_scene s;
        start(&s, 0, 0.12);
        s.view.quality = SPS_QUALITY_HIGH;
        volume = add_slab(&s, 1);
        volume->transfer = &transfer;
        volume->shading = SPS_SHADING_SURFACE;
        volume->specular = 1;
        volume->shininess = shininess;
        check_add_directional(&s, behind ? 0 : sin(tilt), 0, behind ? 1 : -cos(tilt), PI);
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 16; ++i) {
            const double alpha = (double)image_a[4 * i + 3], sent = (double)image_a[4 * i];
            CHECK(alpha > 0.001 && alpha < 0.01);
            if (!CHECK_NEAR(sent, exact * alpha / 2, exact * alpha / 2 * (2 * ripple[2] + 2 * alpha))) return;
        }
    }
}

/* ------------------------------------------------------------------------------------------------ tiles and patches */

/* Every pixel of a tile, up to the last one of its last patch, sees the same uniform gas, and so with a region's
   offset. */
static void test_whole_tile(void) {
    const double tau = 0.6, exact = -expm1(-tau);
    static float pixels[4 * 64 * 64];
    check_scene s;
    check_clear(&s, 64, 64);
    check_orthographic(&s.view.camera, 1.6);
    add_slab(&s, tau);
    if (!check_render(context, &s, pixels)) return;
    even(pixels, 64 * 64, 3, exact, exp(-tau) * tau * ripple[1] + ROUND);
}

static double speckles(const void *user, const double p[3]) {
    const int cell =
        (int)floor(20 * p[0] + 40) * 7919 + (int)floor(20 * p[1] + 40) * 104729 + (int)floor(20 * p[2] + 40);
    (void)user;
    return cell % 11 == 0 ? 1 : 0.1;
}

/* Footprints a few pixels wide are splatted two rows at a time, from the first row that their tile has. What is in the
   first 48 rows of a picture, and in its last 48, is the same in pictures of these alone, of which one tile holds all,
   though the whole picture has its second tile from row 64 on. Positions are off by 3e-6 pixels, float round-off of 80,
   so that a ray may miss the rim of a kernel: exp(-0.5 (2.5 / 0.65)^2) of its middle, whose optical depth is 0.04. */
static void test_rows_across_tiles(void) {
    enum { WIDE = 80, LOW = 48 };
    static float whole[4 * WIDE * WIDE], part[4 * WIDE * LOW];
    static const check_field field = {speckles, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
    for (int n = 0; n < 3; ++n) {
        const double up = n == 0 ? 0 : (n == 1 ? 0.5 : -0.5) * (WIDE - LOW) / (0.5 * WIDE);
        const float *same = whole + (n == 1 ? 0 : 4 * WIDE * (WIDE - LOW));
        check_scene s;
        sps_volume *volume;
        check_clear(&s, WIDE, n == 0 ? WIDE : LOW);
        check_orthographic(&s.view.camera, n == 0 ? 2 : 2.0 * LOW / WIDE);
        s.view.camera.position[1] = s.view.camera.target[1] = up;
        volume = check_add_volume(&s, 64, 64, 64, check_box(-1, -1, -1, 1, 1, 1));
        volume->eval_fn = check_eval_field, volume->user = (void *)(size_t)&field;
        volume->extinction = 1;
        check_color(volume->emission, 1, 1, 1);
        s.view.filling = SPS_FILLING_SPLAT;
        if (!check_render(context, &s, n == 0 ? whole : part)) return;
        if (n > 0) CHECK(check_largest(part, same, 4 * WIDE * LOW) <= 0.04 * 6e-4 + ROUND);
    }
}

/* A near plane amid gas that is lit along the eye's rays, from the front or from behind: alpha of the gas beyond it is
   1 - e^-tau, and light from behind passes tau on its way in and out, wherever it is scattered; light from the front
   also passes the gas in front of the near plane. Depths are RIPPLE off. The field is uniform for 0.1 on either side of
   the plane, so that there is no other error. */
static void test_near_plane_amid_gas(void) {
    for (int n = 0; n < 4; ++n)
        for (int behind = 0; behind < 2; ++behind) {
            const double extinction = 2, before = 0.27 * extinction, tau = 0.33 * extinction, both = before + tau;
            const double from_behind = tau * exp(-tau), from_before = exp(-before) * -expm1(-2 * tau) / 2;
            const double exact = behind ? from_behind : from_before;
            check_scene s;
            start(&s, 0, 0.2);
            s.view.quality = qualities[n];
            s.view.camera.position[2] =
                n % 2 ? 10 : 0.03; /* or the camera itself amid gas, which sees nothing behind it */
            s.view.camera.target[2] = -1;
            s.view.near_distance = n % 2 ? 10 - 0.03 : 0;
            check_color(add_slab(&s, both)->albedo, 1, 1, 1);
            check_add_directional(&s, 0, 0, behind ? 1 : -1, 4 * PI);
            if (!check_render(context, &s, image_a)) return;
            if (!even(image_a, 16, 3, -expm1(-tau), exp(-tau) * tau * ripple[n] + ROUND) ||
                !even(image_a, 16, 0, exact, exact * (both + 1) * ripple[n] + ROUND))
                printf("    quality %d, light from behind %d\n", n, behind);
        }
}

/* One voxel sheared into a needle, whose footprint is a thin ellipse across a whole tile: a Gaussian of the voxel's
   covariance, cut at 2.5 / 0.65 standard deviations and divided by the mass that remains. Its exponent is a difference
   of floats up to 500: 3e-5 off, and ten times that for the numbers that these are computed from. */
static void test_needle(void) {
    const double xx = 2, xy = 2.2, yy = 2.44, variance = 0.65 * 0.65, cut = 2.5 / 0.65, pixel = 0.06;
    const double determinant = xx * yy - xy * xy, volume_of = 0.2, extinction = 2;
    static float pixels[4 * 64 * 64];
    check_scene s;
    sps_volume *volume;
    sps_placement placement;
    check_clear(&s, 64, 64);
    check_orthographic(&s.view.camera, 64 * pixel);
    s.view.quality = SPS_QUALITY_HIGH;
    memset(&placement, 0, sizeof placement);
    check_set3(placement.axis[0], 1, 1, 0);
    check_set3(placement.axis[1], 1, 1.2, 0);
    check_set3(placement.axis[2], 0, 0, 1);
    check_set3(placement.origin, -1, -1.1, -0.5);
    volume = check_add_volume(&s, 1, 1, 1, placement);
    volume->read_fn = check_read_constant;
    volume->user = &one;
    volume->extinction = (float)extinction;
    if (!check_render(context, &s, pixels)) return;
    for (int i = 0; i < 64 * 64; ++i) {
        const double x = (i % 64 - 31.5) * pixel, y = (31.5 - i / 64) * pixel;
        const double square = (yy * x * x - 2 * xy * x * y + xx * y * y) / determinant / variance;
        const double peak = extinction * volume_of / (2 * PI * variance * sqrt(determinant)) / -expm1(-0.5 * cut * cut);
        const double depth = square < cut * cut ? peak * exp(-0.5 * square) : 0;
        if (fabs(square - cut * cut) < 0.01) continue; /* the rim, where round-off decides */
        if (!CHECK_NEAR((double)pixels[4 * i + 3], -expm1(-depth), 4e-4)) return;
    }
}

/* Beside a patch whose rays have ended in a dense block, faint gas far behind the block is still right. */
static void test_beside_what_has_ended(void) {
    const double tau = 0.4;
    for (int side = 0; side < 2; ++side) {
        const double x = side ? 0 : -2;
        check_scene s;
        sps_volume *dense, *faint;
        check_clear(&s, 32, 16);
        check_orthographic(&s.view.camera, 1.6);
        dense = check_add_volume(&s, 20, 20, 10, check_box(x, -1, 4, x + 2, 1, 5));
        dense->extinction = 50;
        faint = check_add_volume(&s, 40, 20, 10, check_box(-2, -1, -5, 2, 1, -4));
        faint->extinction = (float)tau;
        dense->read_fn = faint->read_fn = check_read_constant;
        dense->user = faint->user = &one;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 16 * 32; ++i) {
            const int column =
                side ? 31 - i % 32 : i % 32; /* the block ends at 16, and its kernels two pixels further */
            const double alpha = (double)image_a[4 * i + 3];
            if (column < 13 && !CHECK(alpha >= 1)) return;
            if (column > 18 && !CHECK_NEAR(alpha, -expm1(-tau), exp(-tau) * tau * ripple[1] + ROUND)) return;
        }
    }
}

/* --------------------------------------------------------------------------------------------------------- refusals */

/* The image of a camera amid gas is cut into parts if it sees more than 139 degrees, 2 acos(0.35), from the centre of
   one corner pixel to that of the opposite one: tan(fov / 2) sqrt(2) (SIDE - 1) / SIDE above tan(acos(0.35)). */
static void test_widest_camera(void) {
    const double limit = 2 * atan(tan(acos(0.35)) / sqrt(2.0) * SIDE / (SIDE - 1));
    for (int wide = 0; wide < 2; ++wide) {
        sps_plan_report plan;
        check_scene s;
        check_clear(&s, SIDE, SIDE);
        add_slab(&s, 1);
        check_set3(s.view.camera.position, 0, 0, 0);
        check_set3(s.view.camera.target, 0, 0, -1);
        check_perspective(&s.view.camera, limit + (wide ? 1e-4 : -1e-4));
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        CHECK((plan.sweep_count == 1) == !wide);
    }
}

/* A point light that shades by sheets is accepted if it sees gas within 78.46 degrees, acos(0.2), of its central ray,
   and refused beyond. The gas reaches 2.5 voxels beyond the centres of its outermost voxels. */
static void test_closest_light(void) {
    const double side = 1.7 + 0.25, limit = sqrt(2 * side * side) * 0.2 / sqrt(1 - 0.04);
    for (int close = 0; close < 2; ++close) {
        sps_image image = {image_a, NULL, 0};
        check_scene s;
        check_clear(&s, 8, 8);
        check_color(add_slab(&s, 1)->albedo, 1, 1, 1);
        check_add_point(&s, 0, 0, 0.25 + 0.25 + limit * (close ? 0.999 : 1.001), 1);
        check_force_sheets(&s);
        CHECK(sps_render(context, &s.scene, &s.view, &image) == (close ? SPS_ERROR_UNSUPPORTED : SPS_OK));
    }
}

/* ------------------------------------------------------------------------------------------------ defaults of zeros */

static double ball(const void *user, const double p[3]) {
    (void)user;
    return fmax(0, 0.4 * (1 - sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])));
}

/* A shaded ball whose values fall by 0.04 per voxel, so that it is four parts surface and one part gas, with a
   highlight. Every field that has a default is 0. */
static sps_volume *add_ball(check_scene *s, check_field *field) {
    static const sps_transfer_point points[3] = {{0.08f, {0.8f, 0.5f, 0.3f}, 0, {0, 0, 0}},
                                                 {0.2f, {0.7f, 0.6f, 0.4f}, 9, {0, 0, 0}},
                                                 {0.4f, {1, 1, 1}, 20, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 3, NULL, NULL, 0};
    sps_volume *volume = check_add_volume(s, 20, 20, 20, check_box(-1, -1, -1, 1, 1, 1));
    memset(field, 0, sizeof *field);
    field->value_fn = ball;
    volume->eval_fn = check_eval_field;
    volume->user = field;
    volume->transfer = &transfer;
    volume->shading = SPS_SHADING_SURFACE;
    volume->specular = 0.5f;
    check_add_directional(s, -0.4, -0.5, -1, 3);
    check_orthographic(&s->view.camera, 2.4);
    return volume;
}

/* The defaults in the header's comments, set explicitly, make the same picture bit for bit. `change` is the field. */
static void test_defaults(void) {
    static const sps_lobe lobe = {0, 7};
    for (int change = 0; change < 6; ++change) {
        check_scene s;
        check_field field;
        sps_volume *volume;
        check_clear(&s, SIDE, SIDE);
        volume = add_ball(&s, &field);
        if (!check_render(context, &s, image_a)) return;
        if (change == 0) volume->shininess = 32;
        if (change == 1) volume->gradient_full = 0.05f;
        if (change == 2) s.view.quality = SPS_QUALITY_MEDIUM;
        if (change == 3) volume->lobes = &lobe, volume->lobe_count = 1;
        if (change == 4) s.view.slab_thickness = 0.7;
        if (change == 5) s.view.region[2] = s.view.region[3] = SIDE;
        if (!check_render(context, &s, image_b)) return;
        if (!CHECK(memcmp(image_a, image_b, sizeof image_a) == 0)) printf("    change %d\n", change);
    }
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    RUN(test_one_light_of_three_without_shadow);
    RUN(test_three_lights_in_thin_gas);
    RUN(test_rays_end);
    RUN(test_slabs_and_texels);
    RUN(test_slabs_of_the_longest_sweep);
    RUN(test_slabs_of_particles);
    RUN(test_border);
    RUN(test_parabola);
    RUN(test_mean_way);
    RUN(test_light_through_what_is_classified);
    RUN(test_light_as_eye);
    RUN(test_lit_in_part);
    RUN(test_light_below_a_block);
    RUN(test_distance_of_dense_gas);
    RUN(test_plate_far_behind);
    RUN(test_shadow_of_an_earlier_chunk);
    RUN(test_patches);
    RUN(test_faces_of_a_slab);
    RUN(test_whole_tile);
    RUN(test_rows_across_tiles);
    RUN(test_near_plane_amid_gas);
    RUN(test_needle);
    RUN(test_beside_what_has_ended);
    RUN(test_widest_camera);
    RUN(test_closest_light);
    RUN(test_defaults);
    sps_destroy(context);
    return check_report();
}
