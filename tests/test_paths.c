/* Multiple scattering in sps_reference, by random paths: against closed forms and published figures, with eye and light
   exchanged, and on its own terms: seeds, errors, workers, regions, failures. Paths are drawn from fixed seeds, so what
   passes once passes always; means are held against five of their standard errors. */

#include "check.h"
#include "flames.h"

enum { SIDE = 24, PIXELS = SIDE * SIDE, COUNT = 4 * PIXELS, PARTICLES = 60 };
static float image_a[COUNT], image_b[COUNT], error_a[3 * PIXELS], error_b[3 * PIXELS];
static sps_context *context;
static check_triangles ground, pane;

static const float one = 1;

/* Number of paths: four times as many in long tests. */
static int many(int samples) { return check_long() ? 4 * samples : samples; }

/* In steps of that many voxels, by which light from lamps is followed to the scattering. */
static sps_result follow_by(double step, sps_context *by, const check_scene *s, int samples, uint64_t seed, float *rgba,
                            float *error) {
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings);
    memset(&image, 0, sizeof image);
    settings.step = step, settings.samples = samples, settings.seed = seed, settings.error = error;
    image.rgba = rgba;
    return sps_reference(by, &s->scene, &s->view, &settings, &image);
}

static sps_result follow(sps_context *by, const check_scene *s, int samples, uint64_t seed, float *rgba, float *error) {
    return follow_by(0.25, by, s, samples, seed, rgba, error);
}

/* As follow, where accuracy does not matter. */
static sps_result follow_coarsely(sps_context *by, const check_scene *s, int samples, uint64_t seed, float *rgba,
                                  float *error) {
    return follow_by(check_long() ? 0.25 : 1, by, s, samples, seed, rgba, error);
}

/* Mean of a color over the image, and the standard error of that. */
static double mean_channel(const check_scene *s, const float *rgba, const float *error, int c, double *deviation) {
    const int count = s->view.width * s->view.height;
    double sum = 0, square = 0;
    for (int i = 0; i < count; ++i) {
        sum += (double)rgba[4 * i + c] / count;
        square += pow((double)error[3 * i + c] / count, 2);
    }
    *deviation = sqrt(square);
    return sum;
}

/* Compares the mean of a color over image_a with the exact one. `systematic`: what may be off besides noise. */
static void check_truth(const check_scene *s, const char *name, int c, double exact, double systematic) {
    double deviation;
    const double mean = mean_channel(s, image_a, error_a, c, &deviation);
    if (figures()) printf("%s: %.5f +- %.5f, exact %.5f\n", name, mean, deviation, exact);
    if (!CHECK_CASE("Scattering", "Monte Carlo: layers, a half-space, a furnace, a floor",
                    "tables, Chandrasekhar's H, closed forms", fabs(mean - exact), 5 * deviation + systematic,
                    "five standard errors; the tables' last digit"))
        printf("    %s\n", name);
}

/* --- layers that are much wider than thick --- */

/* A layer of unit thickness, and a black plane behind it if `black`. What leaves at its edges is below 1 / WIDE. */
enum { WIDE = 400 };
static void start_layer(check_scene *s, double depth, const sps_lobe *lobe, int black) {
    const double origin[3] = {-3 * WIDE, -3 * WIDE, -2}, u[3] = {6 * WIDE, 0, 0}, v[3] = {0, 6 * WIDE, 0};
    sps_volume *volume;
    check_clear(s, 8, 8);
    volume = check_add_volume(s, 9, 9, 3, check_box(-WIDE, -WIDE, 0, WIDE, WIDE, 1));
    volume->read_fn = check_read_constant;
    volume->user = (void *)(size_t)&one;
    volume->extinction = (float)depth;
    volume->lobes = lobe;
    volume->lobe_count = lobe != NULL;
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    if (black) check_add_mesh(s, &ground, 0);
}

/* Light from one side of a layer, seen square to it: what the layer reflects of light that comes square to it. H. C.
   van de Hulst, Multiple Light Scattering, 1980, gives 0.0974 for the second. Without absorption and asymmetry,
   doubling gives 0.853 for a depth of 10, and 0.0005 is its last digit. */
static void test_layers(void) {
    static const sps_lobe lobe = {0.75f, 1};
    check_scene s;
    start_layer(&s, 10, NULL, 1);
    check_color(s.volume[0].albedo, 1, 1, 1);
    check_color(s.scene.ambient, 1, 1, 1);
    if (!CHECK_OK(context, follow(context, &s, many(100), 1, image_a, error_a))) return;
    check_truth(&s, "reflected by depth 10", 0, 0.853, 0.0005);
    CHECK(fabsf(image_a[0] - image_a[4]) > 0 && fabsf(image_a[0] - image_a[4 * 8]) > 0); /* paths of their own */
    start_layer(&s, 2, &lobe, 1);
    check_color(s.volume[0].albedo, 0.9, 0.9, 0.9);
    check_color(s.scene.ambient, 1, 1, 1);
    if (!CHECK_OK(context, follow(context, &s, many(1000), 1, image_a, error_a))) return;
    check_truth(&s, "reflected by depth 2", 0, 0.0974, 0.00005);
}

/* Chandrasekhar's H function at 1, of isotropic scattering: H(m) = 1 / (sqrt(1 - w) + w / 2 int x H(x) / (x + m) dx),
   by the midpoint rule, to 1e-6. */
static double h_function(double w) {
    enum { N = 400 };
    double h[N], last = 0, value = 1;
    for (int i = 0; i < N; ++i) h[i] = 1;
    while (fabs(value - last) > 1e-7) {
        double next[N];
        last = value;
        for (int i = 0; i <= N; ++i) {
            const double m = i < N ? (i + 0.5) / N : 1;
            double sum = 0;
            for (int k = 0; k < N; ++k) sum += (k + 0.5) / N * h[k] / ((k + 0.5) / N + m) / N;
            if (i < N) next[i] = 1 / (sqrt(1 - w) + 0.5 * w * sum);
            if (i == N) value = 1 / (sqrt(1 - w) + 0.5 * w * sum);
        }
        for (int i = 0; i < N; ++i) h[i] = 0.5 * (h[i] + next[i]);
    }
    return value;
}

/* A layer without end, under a sun that shines square to it with irradiance 1, sends w / (8 pi) H(1)^2 back. Steps of a
   quarter voxel find light that has scattered once to 1e-3. */
static void test_half_space(void) {
    static const double albedos[3] = {0.5, 0.9, 0};
    double deviation;
    check_scene s;
    start_layer(&s, 60, NULL, 0);
    s.volume[0].size[2] = 40;
    check_color(s.volume[0].albedo, albedos[0], albedos[1], albedos[2]);
    check_add_directional(&s, 0, 0, -1, 1);
    if (!CHECK_OK(context, follow(context, &s, many(200), 1, image_a, error_a))) return;
    for (int c = 0; c < 3; ++c) {
        const double h = h_function(albedos[c]), exact = albedos[c] / (8 * 3.14159265358979) * h * h;
        const double mean = mean_channel(&s, image_a, error_a, c, &deviation);
        CHECK_CASE("Scattering", "semi-infinite layer under a sun, by random paths", "albedo / 8 pi H(1)^2",
                   fabs(mean - exact), 5 * deviation + 1e-3 * exact,
                   "five standard errors; steps of a quarter voxel, 1e-3");
    }
    CHECK(!(mean_channel(&s, image_a, error_a, 2, &deviation) > 0));
}

/* The same, seen from below a layer of depth 4 that only absorbs: shadow rays of little transmittance. */
static void test_dim(void) {
    const double h = h_function(0.9), exact = exp(-4.0) * 0.9 / (8 * 3.14159265358979) * h * h;
    const double step = check_long() ? 0.25 : 0.5; /* errors are of second order */
    check_scene s;
    sps_volume *absorber;
    start_layer(&s, 60, NULL, 0);
    s.volume[0].size[2] = 40;
    check_color(s.volume[0].albedo, 0.9, 0.9, 0.9);
    absorber = check_add_volume(&s, 9, 9, 3, check_box(-WIDE, -WIDE, 3, WIDE, WIDE, 4));
    absorber->read_fn = check_read_constant, absorber->user = (void *)(size_t)&one;
    absorber->extinction = 4;
    s.view.camera.position[2] = 2.5, s.view.near_distance = 0.5;
    check_add_directional(&s, 0, 0, -1, 1);
    if (!CHECK_OK(context, follow_by(step, context, &s, many(200), 1, image_a, error_a))) return;
    check_truth(&s, "half-space below an absorber", 0, exact, 1e-3 * pow(step / 0.25, 2) * exact);
}

/* A floor of reflectance r under thin gas that scatters evenly, in a sun that shines square to both, seen from between
   them: of the sun's light gas sends L(m) = E / (4 pi) (e^-t - e^(-t / m)) / (1 - m) down at cosine m, and the floor r
   times the mean of L over solid angles, weighted by m. Half of the gas's surroundings are the floor, of radiance
   r E / pi, which is 2 r times what the sun is to it. What is lost on the way, and scatters twice, are shares of about
   t. */
static void test_floor(void) {
    const double t = 0.01, r = 0.2, pi = 3.14159265358979;
    const double origin[3] = {-3 * WIDE, -3 * WIDE, -20}, u[3] = {6 * WIDE, 0, 0}, v[3] = {0, 6 * WIDE, 0};
    enum { N = 10000 };
    double exact = 0;
    check_scene s;
    start_layer(&s, t, NULL, 0);
    check_color(s.volume[0].albedo, 1, 1, 1);
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(&s, &ground, r);
    s.view.camera.position[2] = -3;
    s.view.camera.target[2] = -20;
    s.view.near_distance = 1;
    check_add_directional(&s, 0, 0, -1, 1);
    for (int i = 0; i < N; ++i) {
        const double m = (i + 0.5) / N, away = 1 / (4 * pi) * (exp(-t) - exp(-t / m)) / (1 - m);
        exact += (1 + 2 * r) * r * 2 * m * away / N;
    }
    check_march(context, &s, 0.25, image_b, NULL);
    if (!CHECK_OK(context, follow(context, &s, many(1000), 1, image_a, error_a))) return;
    for (int i = 0; i < 4 * 64; ++i) image_a[i] -= image_b[i];
    check_truth(&s, "floor lit by gas", 0, exact, 3 * t * exact);
}

/* Cosines that a sum of lobes draws: their mean is that of g, and that of 1.5 c^2 - 0.5 is that of g^2. */
static void test_lobes(void) {
    static const sps_lobe all[] = {{0.9f, 0.5f}, {-0.6f, 0.3f}, {0.0005f, 0.2f}};
    enum { N = 200000 };
    spsi_material material;
    uint64_t state = 5;
    double exact[2] = {0, 0}, sums[2] = {0, 0};
    int within = 1;
    memset(&material, 0, sizeof material);
    memcpy(material.lobes, all, sizeof all);
    material.lobe_count = 3;
    for (int i = 0; i < 3; ++i) {
        const double g = (double)all[i].asymmetry;
        exact[0] += (double)all[i].weight * g;
        exact[1] += (double)all[i].weight * g * g;
    }
    for (int i = 0; i < N; ++i) {
        const double c = spsi_random_phase(&state, &material);
        within &= c >= -1 && c <= 1;
        sums[0] += c / N;
        sums[1] += (1.5 * c * c - 0.5) / N;
    }
    CHECK(within);
    for (int k = 0; k < 2; ++k) CHECK(fabs(sums[k] - exact[k]) < 5 / sqrt((double)N)); /* both are within -1..1 */
}

/* --- a furnace: where all light is the same, nothing can be told apart --- */

static double tiny = 1; /* the scene's scale is 1 over this */

static double waves(const void *user, const double p[3]) {
    (void)user;
    return 0.6 + 0.2 * (sin(3 * tiny * p[0]) + sin(3 * tiny * p[1] + 1) + sin(3 * tiny * p[2] + 2));
}

static const check_field wave_field = {waves, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
static const sps_lobe lobes[2] = {{0.8f, 3}, {-0.3f, 1}};
static sps_particle swarm[PARTICLES];
static sps_particles swarm_set;

static void add_swarm(check_scene *s) {
    check_random random = {3};
    for (int i = 0; i < PARTICLES; ++i) {
        for (int k = 0; k < 3; ++k) swarm[i].position[k] = (float)(1.6 * check_next(&random) - 0.8);
        swarm[i].radius = 0.3f, swarm[i].optical_depth = 0.7f;
    }
    memset(&swarm_set, 0, sizeof swarm_set);
    swarm_set.count = PARTICLES, swarm_set.read_fn = check_read_particles, swarm_set.user = swarm, swarm_set.soft = 1;
    check_color(swarm_set.albedo, 1, 1, 1);
    swarm_set.lobes = lobes, swarm_set.lobe_count = 1;
    s->scene.particles = &swarm_set, s->scene.particle_set_count = 1;
}

static void add_waves(check_scene *s) {
    sps_volume *volume = check_add_volume(s, 12, 12, 12, check_box(-1, -1, -1, 1, 1, 1));
    volume->eval_fn = check_eval_field;
    volume->user = (void *)(size_t)&wave_field;
    volume->extinction = 2;
    volume->lobes = lobes, volume->lobe_count = 2;
    check_color(volume->albedo, 1, 1, 1);
}

enum { GAS, TABLE, SWARM, BOTH, FLOOR, PANE, GLOWING, EMBERS, KINDS };
static const char *const names[] = {"gas",   "transfer", "particles", "gas and particles",
                                    "floor", "pane",     "glowing",   "all glow"};
static const sps_transfer_point points[] = {
    {0, {1, 1, 1}, 0, {0, 0, 0}}, {0.5f, {1, 1, 1}, 0.5f, {0, 0, 0}}, {1.2f, {1, 1, 1}, 4, {0, 0, 0}}};
static const sps_transfer tissue = {points, 3, NULL, NULL, 0};

static void start(check_scene *s, int kind) {
    const double origin[3] = {-5, -0.5, -5}, u[3] = {10, 0, 0}, v[3] = {0, 0, 10};
    const double corner[3] = {-0.6, -1.2, 0.1}, across[3] = {1.1, 0, 0.3}, up[3] = {0, 2.2, 0};
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 2.6, 1.8, 4);
    check_perspective(&s->view.camera, 0.6);
    if (kind != SWARM) add_waves(s);
    if (kind == TABLE) s->volume[0].transfer = &tissue;
    if (kind == SWARM || kind == BOTH || kind == FLOOR || kind == EMBERS) add_swarm(s);
    if (kind == FLOOR || kind == EMBERS) {
        ground.count = 0;
        check_add_quad(&ground, origin, u, v);
        check_add_mesh(s, &ground, 1);
    }
    if (kind == PANE) {
        pane.count = 0;
        check_add_quad(&pane, corner, across, up);
        check_add_mesh(s, &pane, 0);
        check_color(s->mesh[0].transmittance, 0.4, 0.7, 0.2);
        check_color(s->mesh[0].albedo, 0.6, 0.3, 0.8);
    }
    for (int c = 0; c < 3 && (kind == GLOWING || kind == EMBERS); ++c) { /* what it does not scatter it emits */
        s->volume[0].albedo[c] = 0.3f * (float)c, s->volume[0].emission[c] = 2 - 0.6f * (float)c;
        if (kind == EMBERS)
            swarm_set.albedo[c] = 0.9f - 0.4f * (float)c, swarm_set.emission[c] = 0.1f + 0.4f * (float)c;
    }
    if (kind != EMBERS) return;
    add_waves(s); /* a second volume, which is classified */
    s->volume[1].transfer = &tissue;
    s->volume[1].placement.origin[0] += 0.7;
}

/* Surroundings of radiance 1, and nothing that absorbs more than it emits: radiance is 1 everywhere. Pixels are off by
   as much as their errors say: sums of squares agree to 1 / sqrt(pixels), and with some skewness. */
static void check_furnace_by(check_scene *s, int paths, const char *name) {
    double squares = 0, errors = 0;
    const int side = check_long() ? SIDE : 16;
    for (int c = 0; c < 3; ++c) s->scene.ambient[c] = s->scene.background[c] = 1;
    s->view.width = s->view.height = side;
    if (!CHECK_OK(context, follow(context, s, paths, 1, image_a, error_a))) return;
    for (int c = 0; c < 3; ++c) check_truth(s, name, c, 1, 2e-5);
    for (int i = 0; i < side * side; ++i) {
        squares += pow((double)image_a[4 * i + 2] - 1, 2);
        errors += pow((double)error_a[3 * i + 2], 2);
    }
    if (figures()) printf("    deviation / error: %.3f\n", sqrt(squares / errors));
    CHECK(errors > 0 && fabs(squares / errors - 1) < 0.3);
}

static void check_furnace(check_scene *s, const char *name) { check_furnace_by(s, check_long() ? 128 : 24, name); }

/* The last two triangles of the ground. */
static int read_second(void *user, size_t first, size_t count, sps_triangle *out) {
    return check_read_triangles(user, first + 2, count, out);
}

static void test_furnace(void) {
    const double below[3] = {-1, -0.6, -1}, u[3] = {2, 0, 0}, v[3] = {0, 0, 2};
    const double matrix[16] = {0.8, 0, 0, 0, 0, 0.8, 0, 0, 0, 0, -1, -1, 0, 0, 0, 1}; /* from z = 0 down, and up */
    check_scene s;
    for (int kind = 0; kind < KINDS; ++kind) {
        start(&s, kind);
        check_furnace(&s, names[kind]);
    }
    start(&s, SWARM);
    check_furnace_by(&s, 2, "two paths, whose error is known to one degree of freedom");
    start(&s, FLOOR);
    check_orthographic(&s.view.camera, 2.5);
    s.view.coverage_samples = 2;
    check_furnace(&s, "parallel rays, four a pixel");
    start(&s, BOTH);
    check_set3(s.view.camera.position, 0.1, 0.2, 0.3);
    s.view.near_distance = 0.2;
    check_furnace(&s, "from within");
    check_orthographic(&s.view.camera, 1);
    s.view.near_distance = 0;
    check_furnace(&s, "parallel, from within");
    check_matrix(&s.view.camera, matrix);
    check_furnace(&s, "by a matrix without a near plane");
    start(&s, FLOOR);
    check_add_quad(&ground, below, u, v);
    s.mesh[1] = s.mesh[0];
    s.mesh[0].triangle_count = 2;
    s.mesh[1].read_fn = read_second;
    s.mesh[1].triangle_count = 2;
    check_color(s.mesh[1].albedo, 0, 0, 0);
    s.scene.mesh_count = 2;
    check_furnace(&s, "a black floor below the white one");
}

/* --- what emits lights gas and polygons --- */

/* The largest deviation, of the three colors, of the mean of a picture over a truth; pixels whose truth is 0 do not
   count. */
static double mean_ratio(const float *rgba, const double (*truth)[3], int pixels) {
    double worst = 0;
    for (int c = 0; c < 3; ++c) {
        double sum = 0;
        int count = 0;
        for (int i = 0; i < pixels; ++i)
            if (truth[i][c] > 0) sum += (double)rgba[4 * i + c] / truth[i][c], ++count;
        if (!(fabs(sum / count - 1) <= worst)) worst = fabs(sum / count - 1);
    }
    return worst;
}

enum { FLAME_WIDTH = 32 };
static double flame_truth[FLAME_WIDTH * FLAME_WIDTH][3];
static float flame_image[4 * FLAME_WIDTH * FLAME_WIDTH], flame_error[3 * FLAME_WIDTH * FLAME_WIDTH];

static sps_result follow_flames(const flames *f, double step, int samples) {
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings);
    memset(&image, 0, sizeof image);
    settings.step = step, settings.samples = samples, settings.seed = 1, settings.error = flame_error;
    image.rgba = flame_image;
    return sps_reference(context, &f->scene, &f->view, &settings, &image);
}

/* Haze from 0.8 to 4.8 units around a flame of 0.12. What has scattered once is in closed form, all orders over that by
   paths of the test's own at eight distances. With 600 pixels of 1024 paths, a fifth of which scatter in the haze, at
   places as bright as 1 / r^2, the mean has a standard error of 0.6 %: seeds 1 to 8 give 0.2 to 1.1 %. */
static void test_flame_in_haze(void) {
    flames *f = flames_rings(FLAME_WIDTH, 0);
    double all[9][3];
    uint64_t seed = 1;
    for (int i = 0; i < 9; ++i) {
        const flames_ray eye = {{0.3 * (0.8 + 0.5 * i), sqrt(0.91) * (0.8 + 0.5 * i), 20}, {0, 0, -1}};
        double once[3];
        flames_radiance_once(f, &eye, 400, once);
        flames_radiance(f, &eye, 400, check_long() ? 4000 : 2000, &seed, all[i]);
        for (int c = 0; c < 3; ++c) all[i][c] /= once[c];
    }
    for (int i = 0; i < FLAME_WIDTH * FLAME_WIDTH; ++i) {
        const double pixel = 10.0 / FLAME_WIDTH, x = (i % FLAME_WIDTH + 0.5) * pixel - 5;
        const double y = (i / FLAME_WIDTH + 0.5) * pixel - 5, at = (hypot(x, y) - 0.8) / 0.5;
        const flames_ray eye = {{x, y, 20}, {0, 0, -1}};
        memset(flame_truth[i], 0, sizeof flame_truth[i]);
        if (!(at >= 0 && at < 8)) continue;
        flames_radiance_once(f, &eye, 400, flame_truth[i]);
        for (int c = 0; c < 3; ++c)
            flame_truth[i][c] *= all[(int)at][c] + (at - (int)at) * (all[(int)at + 1][c] - all[(int)at][c]);
    }
    if (CHECK_OK(context, follow_flames(f, 4, 1024)))
        CHECK_CASE("Scattering", "a small flame in haze, by 1024 random paths",
                   "closed form, and paths of the test's own",
                   mean_ratio(flame_image, (const double(*)[3])flame_truth, FLAME_WIDTH * FLAME_WIDTH), 0.02,
                   "three standard errors; relative");
    free(f);
}

/* A floor 0.3 below a ball of 0.12: of voxels, of a particle, of a soft one of the same power. The distance to a point
   of the ball varies by a fifth, what it lights by 40 %: the mean of 500 pixels of 32 paths by 0.4 %. */
static void test_flame_above_floor(void) {
    for (int kind = 0; kind < 3; ++kind) {
        flames *f = flames_floor(FLAME_WIDTH, 0.3, 1.5, kind ? FLAMES_PARTICLE : FLAMES_ALONE);
        double error;
        if (kind == 2) f->particles.soft = 1, f->particle.optical_depth *= 5.0f / 3;
        for (int i = 0; i < FLAME_WIDTH * FLAME_WIDTH; ++i) {
            double point[3];
            flames_floor_point(f, i % FLAME_WIDTH, i / FLAME_WIDTH, point);
            for (int c = 0; c < 3; ++c)
                flame_truth[i][c] = flames_ball_before(f, point)
                                        ? 0
                                        : f->color[c] / FLAME_PI * f->intensity[c] * flames_irradiance(point);
        }
        if (!CHECK_OK(context, follow_flames(f, 1, 32))) return;
        error = mean_ratio(flame_image, (const double(*)[3])flame_truth, FLAME_WIDTH * FLAME_WIDTH);
        if (figures()) printf("floor below a flame, kind %d: off by %.4f\n", kind, error);
        CHECK_CASE("Scattering", "a floor below a small flame, by 32 random paths", "closed form", error, 0.02,
                   "five standard errors; relative");
        free(f);
    }
}

/* --- eye and light exchanged --- */

/* Light sent back by a scene, seen from one direction under a sun from the other: the image's sum, times its area. */
static double sent(int kind, int swapped, double *deviation) {
    static const double ways[2][3] = {{0.5, 0.8, 0.6}, {-0.7, 0.5, 0.4}};
    const double *to_eye = ways[swapped], *to_sun = ways[1 - swapped];
    const double origin[3] = {-1, -0.5, -1}, u[3] = {2, 0, 0}, v[3] = {0, 0, 2};
    check_scene s;
    start(&s, kind == FLOOR ? BOTH : kind);
    for (int i = 0; i < 3; ++i) s.view.camera.position[i] = 9 * to_eye[i];
    check_orthographic(&s.view.camera, 4);
    check_add_directional(&s, -to_sun[0], -to_sun[1], -to_sun[2], 1);
    if (kind == FLOOR) {
        ground.count = 0;
        check_add_quad(&ground, origin, u, v);
        check_add_mesh(&s, &ground, 0.8);
    }
    if (!CHECK_OK(context, follow_by(check_long() ? 0.25 : 0.5, context, &s, many(80), 1, image_a, error_a))) return 0;
    return mean_channel(&s, image_a, error_a, 1, deviation);
}

/* Helmholtz: they may be exchanged. The picture is much larger than what is seen, so pixels at edges average out to
   1 / SIDE^1.5 of the mean, and step by step marching to 1e-3, or, by steps twice as long, 4e-3. */
static void test_exchanged(void) {
    static const int kinds[] = {FLOOR, PANE, GAS, BOTH}; /* the latter two are parts of the former */
    for (int k = 0; k < (check_long() ? 4 : 1); ++k) {   /* panes are in test_furnace, too */
        double errors[2], one = sent(kinds[k], 0, &errors[0]), other = sent(kinds[k], 1, &errors[1]);
        const double mean = 0.5 * (one + other), room = 5 * hypot(errors[0], errors[1]);
        if (figures())
            printf("%s: %.5f, exchanged %.5f, +- %.5f\n", names[kinds[k]], one, other, hypot(errors[0], errors[1]));
        CHECK_CASE("Transport", "eye and sun change places, light scattered any number of times", "the same light",
                   fabs(one - other), room + mean * (1 / pow(SIDE, 1.5) + (check_long() ? 1e-3 : 4e-3)),
                   "five standard errors; pixels at edges");
    }
}

/* --- what scatters, and what does not --- */

/* Where there is no gas, paths add nothing: polygons pass no light on to each other. They take away ambient light that
   comes from behind a polygon. */
static void test_polygons(void) {
    const double origin[3] = {-1, -0.5, -1}, across[3] = {2, 0, 0}, back[3] = {0, 0, 2}, up[3] = {0, 2, 0};
    check_scene s;
    start(&s, FLOOR);
    s.scene.volume_count = s.scene.particle_set_count = 0;
    ground.count = 0;
    check_add_quad(&ground, origin, across, back);
    check_add_quad(&ground, origin, across, up);
    s.mesh[0].triangle_count = ground.count;
    check_add_directional(&s, -0.3, -1, -0.6, 1);
    check_march(context, &s, 0.25, image_b, NULL);
    CHECK_OK(context, follow(context, &s, 16, 1, image_a, NULL));
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    for (int c = 0; c < 3; ++c) s.scene.ambient[c] = 1;
    check_march(context, &s, 0.25, image_b, NULL);
    CHECK_OK(context, follow(context, &s, 16, 1, image_a, NULL));
    for (int i = 0; i < PIXELS; ++i) CHECK(image_a[4 * i] <= image_b[4 * i] + 1e-6f);
    CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
}

/* Polygons send gas the colors of their corners, in whatever order these are. Paths are the same, but for the rounding
   of places: a few of some 10000 may take another turn. */
static void test_corners(void) {
    double mean[2][3] = {{0, 0, 0}, {0, 0, 0}};
    check_scene s;
    start(&s, FLOOR);
    s.mesh[0].has_albedos = 1;
    check_add_directional(&s, -0.3, -1, -0.6, 3);
    for (size_t i = 0; i < ground.count; ++i)
        for (int k = 0; k < 9; ++k) ground.list[i].albedo[k / 3][k % 3] = (float)((4 * k + 3 * i) % 9) / 8;
    for (int turned = 0; turned < 2; ++turned) {
        CHECK_OK(context, follow_coarsely(context, &s, 16, 1, image_a, NULL));
        for (int i = 0; i < 4 * PIXELS; ++i)
            if (i % 4 < 3) mean[turned][i % 4] += (double)image_a[i] / PIXELS;
        for (size_t i = 0; i < ground.count; ++i) {
            const sps_triangle as_before = ground.list[i];
            for (int k = 0; k < 3; ++k) {
                memcpy(ground.list[i].position[k], as_before.position[(k + 1) % 3], sizeof as_before.position[0]);
                memcpy(ground.list[i].albedo[k], as_before.albedo[(k + 1) % 3], sizeof as_before.albedo[0]);
            }
        }
        s.mesh[0].revision += 1;
    }
    for (int c = 0; c < 3; ++c) CHECK_NEAR(mean[1][c], mean[0][c], 1e-3 * mean[0][c]);
}

/* A scene 2^30 times smaller, in which light that leaves a floor may meet a wall, has the same picture: all lengths are
   the same but for powers of 2, which round nothing, so that paths are the same. */
static void test_tiny(void) {
    const double small = 1.0 / (1 << 30), up[3] = {0, 2, 0}, across[3] = {2, 0, 0}, back[3] = {0, 0, 2};
    const double origin[3] = {-1, -0.5, -1}, corner[3] = {-1, -0.5, -0.9};
    check_scene s;
    start(&s, GAS);
    s.volume[0].extinction = 1;
    ground.count = 0;
    check_add_quad(&ground, origin, across, back);
    check_add_quad(&ground, corner, across, up);
    check_add_mesh(&s, &ground, 1);
    check_add_directional(&s, -0.3, -1, -0.6, 3);
    CHECK_OK(context, follow_coarsely(context, &s, 16, 1, image_a, NULL));
    for (size_t i = 0; i < ground.count; ++i)
        for (int k = 0; k < 9; ++k) ground.list[i].position[k / 3][k % 3] *= (float)small;
    s.mesh[0].revision += 1;
    s.volume[0].extinction = (float)(1 / small);
    for (int k = 0; k < 9; ++k) s.volume[0].placement.axis[k / 3][k % 3] *= small;
    for (int k = 0; k < 3; ++k) s.volume[0].placement.origin[k] *= small, s.view.camera.position[k] *= small;
    tiny = 1 / small;
    CHECK_OK(context, follow_coarsely(context, &s, 16, 1, image_b, NULL));
    tiny = 1;
    CHECK(check_largest(image_a, image_b, 4 * PIXELS) == 0);
}

/* First collisions on a ray through a soft ball and an even one that overlap: how many lie before some places, and in
   how many it is the soft one. Truth is summed along the ray: the probability of none so far is exp(-depth). With N
   draws, a fraction p has a standard error of sqrt(p (1 - p) / N). */
static void test_collisions(void) {
    enum { DRAWS = 20000, STEPS = 20000, PLACES = 4 };
    static spsi_frame frame;
    static spsi_content content;
    static spsi_marcher marcher;
    static const spsi_particle balls[2] = {{{0, 0, 5}, 2, 2.5f}, {{0.3f, 0, 6}, 1.5f, 1}};
    static const double places[PLACES] = {4, 5, 6, 7};
    spsi_tree_node leaf = {{-9, -9, -9}, {9, 9, 9}, 0, 2};
    int order[2] = {0, 1}, before[PLACES] = {0}, soft = 0;
    double passes = 1, wanted[PLACES] = {0}, wanted_soft = 0;
    uint64_t random = 7;
    content.particles = balls;
    content.set_ends[0] = 1, content.set_ends[1] = 2;
    frame.content = &content;
    frame.particles.set_count = 2;
    frame.particles.sets[0].soft = 1;
    marcher.frame = &frame;
    marcher.particles.nodes = &leaf, marcher.particles.order = order, marcher.particles.count = 2;
    for (int i = 0; i < DRAWS; ++i) {
        spsi_ray ray = {{0.8, 0.5, 0}, {0, 0, 1}, 0, HUGE_VAL};
        int part = -1;
        spsi_path_through_particles(&marcher, &ray, &random, &part);
        for (int k = 0; k < PLACES; ++k) before[k] += part >= 0 && ray.high < places[k];
        soft += part == 0;
    }
    for (int i = 0; i < STEPS; ++i) {
        const double h = 9.0 / STEPS, z = (i + 0.5) * h;
        const double r2 = (0.64 + 0.25 + (z - 5) * (z - 5)) / 4;
        const double s2 = ((0.8 - (double)0.3f) * (0.8 - (double)0.3f) + 0.25 + (z - 6) * (z - 6)) / 2.25;
        const double first = 2.5 / (4.0 / 3 * 2) * fmax(0, 1 - r2), second = s2 < 1 ? 1.0 / (2 * 1.5) : 0;
        const double ends = passes * -expm1(-h * (first + second));
        for (int k = 0; k < PLACES; ++k) wanted[k] += z < places[k] ? ends : 0;
        if (first > 0) wanted_soft += ends * first / (first + second);
        passes -= ends;
    }
    for (int k = 0; k < PLACES; ++k)
        CHECK_NEAR((double)before[k] / DRAWS, wanted[k], 5 * sqrt(wanted[k] * (1 - wanted[k]) / DRAWS));
    CHECK_NEAR((double)soft / DRAWS, wanted_soft, 5 * sqrt(wanted_soft * (1 - wanted_soft) / DRAWS));
}

/* Balls that lie twice in the same places, once white and once black, each of half the depth, are grey ones; so are the
   voxels of two such volumes. */
static void test_shared(void) {
    static sps_particles sets[2];
    double deviations[2], means[2];
    for (int both = 0; both < 2; ++both) {
        check_scene s;
        start(&s, BOTH);
        check_color(s.scene.ambient, 1, 1, 1);
        sets[0] = sets[1] = swarm_set;
        check_color(sets[1].albedo, 0, 0, 0);
        s.scene.particles = sets;
        s.volume[1] = s.volume[0];
        check_color(s.volume[1].albedo, 0, 0, 0);
        s.scene.volume_count = s.scene.particle_set_count = 2;
        if (!both) {
            check_color(sets[0].albedo, 0.5, 0.5, 0.5);
            check_color(s.volume[0].albedo, 0.5, 0.5, 0.5);
            sets[1].count = 0;
            s.volume[0].extinction *= 2, s.scene.volume_count = 1;
        }
        for (int i = 0; i < PARTICLES; ++i) swarm[i].optical_depth = both ? 0.7f : 1.4f;
        if (!CHECK_OK(context, follow(context, &s, many(32), 1, image_a, error_a))) return;
        means[both] = mean_channel(&s, image_a, error_a, 0, &deviations[both]);
    }
    if (figures()) printf("grey: %.5f, white and black: %.5f\n", means[0], means[1]);
    CHECK(fabs(means[0] - means[1]) < 5 * hypot(deviations[0], deviations[1]));
}

/* --- settings --- */

static void test_seeds(void) {
    check_scene s;
    double square = 0, errors = 0;
    start(&s, BOTH);
    check_add_point(&s, 1, 3, 2, 20);
    if (!CHECK_OK(context, follow_coarsely(context, &s, 16, 7, image_a, error_a))) return;
    CHECK_OK(context, follow_coarsely(context, &s, 16, 7, image_b, error_b));
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0 && memcmp(error_a, error_b, sizeof error_a) == 0);
    CHECK_OK(context, follow_coarsely(context, &s, 16, 8, image_b, error_b));
    for (int i = 0; i < PIXELS; ++i) {
        square += pow((double)image_a[4 * i] - (double)image_b[4 * i], 2);
        errors += pow((double)error_a[3 * i], 2) + pow((double)error_b[3 * i], 2);
    }
    CHECK(fabs(square / errors - 1) < 0.3); /* as in check_furnace */
    CHECK_OK(context, follow_coarsely(context, &s, 1, 7, image_b, NULL));
    for (int i = 0; i < PIXELS; ++i) CHECK(!(fabsf(image_a[4 * i + 3] - image_b[4 * i + 3]) > 0));
}

/* Any number of workers, and any region, give the same bits; rows may be longer than the region. */
static void test_regions(void) {
    enum { PITCH = 20, LEFT = 5, TOP = 7, ACROSS = 11, DOWN = 9 };
    check_hooks hooks;
    sps_context *workers;
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    memset(&hooks, 0, sizeof hooks);
    memset(&settings, 0, sizeof settings);
    memset(&image, 0, sizeof image);
    workers = check_context(&hooks);
    start(&s, EMBERS);
    check_add_point(&s, 1, 3, 2, 20);
    if (!CHECK_OK(context, follow_coarsely(context, &s, 20, 7, image_a, error_a))) return;
    s.view.region[0] = LEFT, s.view.region[1] = TOP, s.view.region[2] = ACROSS, s.view.region[3] = DOWN;
    settings.step = check_long() ? 0.25 : 1, settings.samples = 20, settings.seed = 7, settings.error = error_b;
    image.rgba = image_b, image.row_pixels = PITCH;
    CHECK_OK(workers, sps_reference(workers, &s.scene, &s.view, &settings, &image));
    for (int y = 0; y < DOWN; ++y) {
        const int from = (TOP + y) * SIDE + LEFT, to = y * PITCH;
        CHECK(memcmp(image_a + 4 * from, image_b + 4 * to, ACROSS * 4 * sizeof *image_a) == 0);
        CHECK(memcmp(error_a + 3 * from, error_b + 3 * to, ACROSS * 3 * sizeof *error_a) == 0);
    }
    sps_destroy(workers);
    CHECK(hooks.live == 0);
}

/* Paths begin at all samples of a pixel: gas that only a third of it shows, above or below, left or right, is as
   bright. Five standard errors of a difference. */
static void test_all_samples(void) {
    double light[4], deviation[4];
    for (int n = 0; n < 4; ++n) {
        const double aside = n % 2 ? 2 : -2, x = n < 2 ? 0 : aside, y = n < 2 ? aside : 0;
        const double half[2] = {n < 2 ? 3.0 : 1.0, n < 2 ? 1.0 : 3.0};
        check_scene s;
        sps_volume *volume;
        check_clear(&s, 1, 1);
        check_orthographic(&s.view.camera, 6);
        volume = check_add_volume(&s, 9, 9, 9, check_box(x - half[0], y - half[1], -1, x + half[0], y + half[1], 1));
        volume->read_fn = check_read_constant, volume->user = (void *)(size_t)&one;
        volume->extinction = 2;
        check_color(volume->albedo, 1, 1, 1);
        check_add_directional(&s, 0, 0, -1, 3);
        s.view.coverage_samples = 3;
        s.view.scattering = SPS_SCATTERING_MULTIPLE;
        if (!CHECK_OK(context, follow_coarsely(context, &s, many(400), 3, image_a, error_a))) return;
        light[n] = mean_channel(&s, image_a, error_a, 0, &deviation[n]);
        CHECK(light[n] > 0.01);
        if (figures()) printf("gas in a third of a pixel: %.4f +- %.4f\n", light[n], deviation[n]);
        for (int m = 0; m < n; ++m)
            CHECK_NEAR(light[n], light[m], 5 * sqrt(pow(deviation[n], 2) + pow(deviation[m], 2)));
    }
}

static void check_refused(sps_reference_settings *settings, const char *field, const char *words) {
    check_scene s;
    sps_image image;
    sps_error_info info;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    image_a[0] = 7;
    start(&s, GAS);
    CHECK(sps_reference(context, &s.scene, &s.view, settings, &image) == SPS_ERROR_ARGUMENT);
    sps_get_error(context, &info);
    CHECK(info.object == (settings ? SPS_OBJECT_REFERENCE_SETTINGS : SPS_OBJECT_CALL));
    CHECK(strcmp(info.field, field) == 0);
    if (!CHECK(strstr(info.sentence, words) != NULL)) printf("    %s\n", info.sentence);
    CHECK(!(fabsf(image_a[0] - 7) > 0));
}

static void test_settings(void) {
    sps_reference_settings settings;
    memset(&settings, 0, sizeof settings);
    check_refused(NULL, "settings", "is NULL");
    check_refused(&settings, "step", "settings.step is 0; it must be above 0");
    settings.step = 1, settings.samples = -1;
    check_refused(&settings, "samples", "settings.samples is -1; it must be 0..1048576");
    settings.samples = (1 << 20) + 1;
    check_refused(&settings, "samples", "settings.samples is 1.04858e+06; it must be 0..1048576");
    settings.samples = 1, settings.error = error_a;
    check_refused(&settings, "samples", "settings.samples is 1; an estimate of the error needs at least 2");
    settings.samples = 2, settings.start_canary = 1;
    check_refused(&settings, "start_canary", "not zeroed");
    settings.start_canary = 0, settings.end_canary = 1;
    check_refused(&settings, "end_canary", "not zeroed");
}

/* Cancelled at any point, or out of memory at any allocation: the image stays, nothing leaks. */
static void test_failures(void) {
    check_cancel cancel = {0, 0};
    check_hooks hooks;
    sps_config config;
    sps_result result;
    check_scene s;
    int cancelled = 0, refused = 0;
    start(&s, FLOOR);
    s.view.width = s.view.height = 8;
    check_add_point(&s, 1, 3, 2, 20);
    memset(&hooks, 0, sizeof hooks);
    config = check_config(&hooks);
    config.progress_fn = check_cancel_at, config.progress_user = &cancel;
    config.clock_fn = check_hasty_clock;
    do {
        sps_context *own = sps_create(&config, NULL);
        cancel.calls = 0, cancel.at = ++cancelled;
        image_a[0] = 7, error_a[0] = 7;
        result = follow_coarsely(own, &s, 10, 1, image_a, error_a);
        CHECK(result == SPS_OK || (result == SPS_ERROR_CANCELLED && !(image_a[0] < 7) && !(error_a[0] < 7)));
        sps_destroy(own);
    } while (result != SPS_OK && cancelled < 1000);
    CHECK(cancelled > 10);
    cancel.at = 0;
    do {
        sps_context *own = sps_create(&config, NULL);
        hooks.fail_at = hooks.allocations + ++refused;
        image_a[0] = 7, error_a[0] = 7;
        result = follow_coarsely(own, &s, 2, 1, image_a, error_a);
        CHECK(result == SPS_OK || (result == SPS_ERROR_MEMORY && !(image_a[0] < 7) && !(error_a[0] < 7)));
        hooks.fail_at = 0;
        sps_destroy(own);
    } while (result != SPS_OK && refused < 1000);
    CHECK(refused > 5 && hooks.live == 0);
}

/* --- hard cases --- */

static int finite_image(const check_scene *s, int samples) {
    if (!CHECK_OK(context, follow(context, s, samples, 1, image_a, error_a))) return 0;
    for (int i = 0; i < 4 * s->view.width * s->view.height; ++i)
        if (!CHECK_CASE("What users of other renderers complain of",
                        "NaN from branches of probability 0: no gas, extinction 1e18, light in it, far away",
                        "finite, not negative", !(image_a[i] >= 0 && image_a[i] <= FLT_MAX), 0, "exact"))
            return 0;
    return 1;
}

/* Nothing but surroundings; gas as dense as it may be; a light in the middle of it; a scene far from the origin. */
static void test_extremes(void) {
    double near_by, far_away, deviations[2];
    check_scene s;
    check_clear(&s, 4, 4);
    check_color(s.scene.ambient, 1, 1, 1);
    finite_image(&s, 4);
    for (int i = 0; i < 16; ++i) CHECK(!(image_a[4 * i] > 0));
    start(&s, FLOOR);
    if (!check_long()) s.view.width = s.view.height = SIDE / 3;
    check_add_point(&s, 0, 0, 0, 1);
    finite_image(&s, 4);
    s.volume[0].extinction = 1e18f;
    finite_image(&s, 2);
    start(&s, GAS);
    s.view.width = s.view.height = SIDE / 2;
    s.volume[0].eval_fn = NULL, s.volume[0].read_fn = check_read_constant, s.volume[0].user = (void *)(size_t)&one;
    check_add_directional(&s, 1, -1, 0, 1);
    for (int i = 0; i < 3; ++i) {
        s.volume[0].placement.origin[i] += 1e6;
        s.view.camera.position[i] += 1e6, s.view.camera.target[i] += 1e6;
    }
    finite_image(&s, 64);
    far_away = mean_channel(&s, image_a, error_a, 0, &deviations[1]);
    for (int i = 0; i < 3; ++i) {
        s.volume[0].placement.origin[i] -= 1e6;
        s.view.camera.position[i] -= 1e6, s.view.camera.target[i] -= 1e6;
    }
    finite_image(&s, 64);
    near_by = mean_channel(&s, image_a, error_a, 0, &deviations[0]);
    CHECK(fabs(near_by - far_away) < 5 * hypot(deviations[0], deviations[1]));
    check_orthographic(&s.view.camera, 4);
    finite_image(&s, 64);
    near_by = mean_channel(&s, image_a, error_a, 0, &deviations[0]);
    for (int i = 0; i < 3; ++i) s.view.camera.position[i] *= 1e12;
    finite_image(&s, 64);
    far_away = mean_channel(&s, image_a, error_a, 0, &deviations[1]);
    CHECK(fabs(near_by - far_away) < 5 * hypot(deviations[0], deviations[1]) + 0.01 * near_by);
}

/* A thin ember, even or soft, 2 above a floor: an even ball lights it as a point does [Newton], and so does each shell
   of a soft one. Its chords are 2/3 of the longest on the mean over its outline, 2/5 if soft. */
static void test_embers(void) {
    const double origin[3] = {-30, -30, -2}, u[3] = {60, 0, 0}, v[3] = {0, 60, 0}, square = 1 + 0.49 + 4;
    for (int soft = 0; soft < 2; ++soft) {
        static sps_particle ember;
        static sps_particles set;
        check_scene s;
        check_clear(&s, 4, 4);
        check_orthographic(&s.view.camera, 0.02);
        check_set3(s.view.camera.position, 1, 0.7, 10), check_set3(s.view.camera.target, 1, 0.7, 0);
        memset(&ember, 0, sizeof ember), memset(&set, 0, sizeof set);
        ember.radius = 0.3f, ember.optical_depth = 1e-3f;
        set.count = 1, set.read_fn = check_read_particles, set.user = &ember, set.soft = soft;
        check_color(set.emission, 5e3, 3e3, 1e3);
        s.scene.particles = &set, s.scene.particle_set_count = 1;
        ground.count = 0;
        check_add_quad(&ground, origin, u, v);
        check_color(check_add_mesh(&s, &ground, 0.5)->albedo, 0.3, 0.5, 0.9);
        if (!CHECK_OK(context, follow(context, &s, many(200), 1, image_a, error_a))) return;
        for (int c = 0; c < 3; ++c) {
            const double power = (double)set.emission[c] * 1e-3 * 3.14159265358979 * 0.09 * (soft ? 0.4 : 2.0 / 3);
            const double exact = (double)s.mesh[0].albedo[c] / 3.14159265358979 * power * 2 / pow(square, 1.5);
            check_truth(&s, soft ? "below a soft ember" : "below an even ember", c, exact, 2e-3 * exact);
        }
    }
}

int main(void) {
    context = sps_create(NULL, NULL);
    RUN(test_layers);
    RUN(test_half_space);
    RUN(test_dim);
    RUN(test_floor);
    RUN(test_embers);
    RUN(test_lobes);
    RUN(test_furnace);
    RUN_LONG(test_flame_in_haze);
    RUN(test_flame_above_floor);
    RUN_LONG(test_exchanged);
    RUN(test_polygons);
    RUN(test_corners);
    RUN(test_tiny);
    RUN(test_collisions);
    RUN(test_shared);
    RUN(test_seeds);
    RUN(test_regions);
    RUN(test_all_samples);
    RUN(test_settings);
    RUN(test_failures);
    RUN(test_extremes);
    check_free_triangles(&ground);
    check_free_triangles(&pane);
    sps_destroy(context);
    return check_report();
}
