/* Bounds of light, sps_reference_settings.lower and upper: against closed forms and against quadrature of its own; that
   they close in on each other; that they hold in dense gas and at the edges of shadows; what is refused; workers,
   failures. */

#include "check.h"

enum { SIDE = 4, COUNT = SIDE * SIDE, GRID = 8, VALUES = GRID * GRID * GRID };
static sps_context *context;
static float rgba[4 * COUNT], exact[4 * COUNT], low[3 * COUNT], high[3 * COUNT];
static float smooth[VALUES], noise[VALUES];
static check_array arrays[2];
static check_triangles faces;

/* --- scenes --- */

static void fill_values(void) {
    check_random random = {3};
    for (int i = 0; i < VALUES; ++i) {
        const double x = (i % GRID + 0.5) / GRID, y = (i / GRID % GRID + 0.5) / GRID,
                     z = (i / GRID / GRID + 0.5) / GRID;
        smooth[i] = (float)(0.5 + 0.25 * sin(3 * x + 1) * cos(2 * y) + 0.2 * sin(4 * z));
        noise[i] = (float)check_next(&random);
    }
    for (int n = 0; n < 2; ++n) {
        arrays[n].values = n ? noise : smooth;
        for (int k = 0; k < 3; ++k) arrays[n].size[k] = GRID;
    }
}

/* Gas in a box of voxels of 0.25 x 0.3 x 0.25, as seen from above at 2 units of height. */
static sps_volume *start(check_scene *s, int noisy, double extinction) {
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    check_orthographic(&s->view.camera, 2);
    volume = check_add_volume(s, GRID, GRID, GRID, check_box(-1, -1.2, -1, 1, 1.2, 1));
    volume->read_fn = check_read_array, volume->user = &arrays[noisy];
    volume->extinction = (float)extinction;
    check_color(volume->albedo, 0.9, 0.6, 0.3);
    faces.count = 0;
    return volume;
}

static sps_result bracket(sps_context *by, const check_scene *s, double step) {
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings);
    memset(&image, 0, sizeof image);
    settings.step = step;
    settings.lower = low, settings.upper = high;
    image.rgba = rgba;
    return sps_reference(by, &s->scene, &s->view, &settings, &image);
}

/* Bounds are in order, and the picture is between them. Returns their mean distance, of the picture's mean. */
static double check_order(const check_scene *s, double step) {
    double width = 0, sum = 0;
    if (!CHECK_OK(context, bracket(context, s, step))) return HUGE_VAL;
    for (int i = 0; i < 3 * COUNT; ++i) {
        const float found = rgba[4 * (i / 3) + i % 3];
        CHECK(low[i] <= found && found <= high[i] && high[i] < HUGE_VAL);
        width += (double)high[i] - (double)low[i];
        sum += (double)found;
    }
    return sum > 0 ? width / sum : width;
}

/* --- the truth: sums over all voxels, and quadrature in steps that are short beside any bound's --- */

static double kernel(double d) { return exp(-0.5 * d * d / (0.65 * 0.65)) / (sqrt(2 * PI) * 0.65); }

static double field_at(const sps_volume *volume, const double p[3]) {
    const float *values = ((const check_array *)volume->user)->values;
    double w[3][GRID], sum = 0;
    for (int k = 0; k < 3; ++k) {
        const double at = (p[k] - volume->placement.origin[k]) / volume->placement.axis[k][k] * GRID;
        for (int i = 0; i < GRID; ++i) w[k][i] = kernel(at - i - 0.5);
    }
    for (int z = 0; z < GRID; ++z)
        for (int y = 0; y < GRID; ++y)
            for (int x = 0; x < GRID; ++x)
                sum += w[0][x] * w[1][y] * w[2][z] * (double)values[(z * GRID + y) * GRID + x];
    return sum;
}

static double extinction_at(const check_scene *s, const double p[3]) {
    double sum = 0;
    for (int m = 0; m < s->scene.volume_count; ++m) sum += (double)s->volume[m].extinction * field_at(&s->volume[m], p);
    return sum;
}

static const double places[3] = {0.1127016653792583, 0.5, 0.8872983346207417},
                    weights[3] = {5 / 18.0, 8 / 18.0, 5 / 18.0};

/* Optical depth from a point along a unit vector. */
static double depth_along(const check_scene *s, const double from[3], const double direction[3], double length,
                          int count) {
    double sum = 0;
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < 3; ++j) {
            double p[3];
            vec_along(from, direction, length * (i + places[j]) / count, p);
            sum += weights[j] * length / count * extinction_at(s, p);
        }
    return sum;
}

/* What a point scatters back along the eye's ray, per unit of extinction and of albedo. */
static double light_at(const check_scene *s, const double p[3], float g) {
    double sum = 0;
    for (int i = 0; i < s->scene.light_count; ++i) {
        const sps_light *light = &s->light[i];
        double toward[3], far = 8, irradiance = (double)light->color[0], cosine, square;
        for (int k = 0; k < 3; ++k)
            toward[k] = light->kind == SPS_LIGHT_POINT ? light->position[k] - p[k] : -light->direction[k];
        if (light->kind == SPS_LIGHT_POINT) far = vec_length(toward), irradiance /= far * far;
        vec_normalise(toward);
        cosine = -toward[2]; /* between the light's way and that to the eye, +z */
        if (light->outer_cone > 0) {
            double axis[3] = {light->direction[0], light->direction[1], light->direction[2]}, share;
            vec_normalise(axis);
            share = -vec_dot(axis, toward);
            share = (share - cos(light->outer_cone)) / (cos(light->inner_cone) - cos(light->outer_cone));
            share = fmin(fmax(share, 0), 1);
            irradiance *= share * share;
        }
        square = 1 + (double)(g * g) - 2 * (double)g * cosine;
        if (s->scene.mesh_count > 0 && p[2] + toward[2] / toward[1] * (1.8 - p[1]) < 0.1) continue; /* test_shadow */
        sum += irradiance * (1 - (double)(g * g)) / (4 * PI * square * sqrt(square)) *
               exp(-depth_along(s, p, toward, far, light->kind == SPS_LIGHT_POINT ? 40 : 80));
    }
    return sum;
}

/* Radiance in red of a pixel's ray, which comes straight down. `edge` is a place along it where a shadow begins. */
static double truth(const check_scene *s, int pixel, double edge) {
    const double way[3] = {0, 0, -1}, x = 2.0 / SIDE * (pixel % SIDE + 0.5) - 1;
    const double p[3] = {x, 1 - 2.0 / SIDE * (pixel / SIDE + 0.5), 2.5};
    const double cuts[3] = {0, edge, 5};
    double sum = 0, depth = 0;
    for (int part = 0; part < 2; ++part)
        for (int i = 0; i < 50; ++i) {
            const double h = (cuts[part + 1] - cuts[part]) / 50;
            double from[3];
            vec_along(p, way, cuts[part] + i * h, from);
            for (int j = 0; j < 3 && h > 0; ++j) {
                double at[3], light = 0;
                const double passed = exp(-depth - depth_along(s, from, way, places[j] * h, 1));
                vec_along(from, way, places[j] * h, at);
                for (int m = 0; m < s->scene.volume_count; ++m) {
                    const sps_volume *volume = &s->volume[m];
                    const float g = volume->lobe_count > 0 ? volume->lobes[0].asymmetry : 0;
                    const double sent = light_at(s, at, g) + (double)s->scene.ambient[0];
                    light += field_at(volume, at) * ((double)volume->extinction * (double)volume->albedo[0] * sent +
                                                     (double)volume->emission[0]);
                }
                sum += weights[j] * h * passed * light;
            }
            depth += h > 0 ? depth_along(s, from, way, h, 1) : 0;
        }
    return sum + exp(-depth) * (double)s->scene.background[0];
}

/* --- tests --- */

/* The constants behind the bounds are not exceeded at any place or in any direction, not even where they were not
   looked for. */
static void test_kernel(void) {
    check_random random = {9};
    double sums[7] = {0}, ripples[7] = {0}, tails[7] = {0};
    for (int n = 0; n < 60; ++n) {
        double place[3], way[3], moved[3], square = 0;
        for (int k = 0; k < 3; ++k) {
            place[k] = n % 3 ? check_next(&random) : floor(3 * check_next(&random)) / 2;
            way[k] = n % 2 ? check_next(&random) - 0.5 : floor(2 * check_next(&random));
            moved[k] = place[k] + 1.5 * check_next(&random) - 0.75;
            square += way[k] * way[k];
        }
        if (!(square > 0)) continue;
        for (int beyond = 0; beyond < 2; ++beyond)
            for (int k = 0; k < 7; ++k) {
                double all = 0, alone = 0, far = 0;
                for (int i = 0; i < 16 * 16 * 16; ++i) {
                    const int cell[3] = {i % 16 - 7, i / 16 % 16 - 7, i / 256 - 7};
                    const double *at = beyond ? moved : place;
                    double along = 0, from = 0, before = 1, hermite, next;
                    int inside = 1;
                    for (int c = 0; c < 3; ++c) {
                        const double d = (at[c] - cell[c]) / 0.65;
                        along += d * way[c] / sqrt(square), from += d * d;
                        inside &= cell[c] >= -3 && cell[c] <= 4;
                    }
                    hermite = k > 0 ? along : 1;
                    for (int c = 1; c < k; ++c) next = along * hermite - c * before, before = hermite, hermite = next;
                    hermite *= exp(-0.5 * from) / pow(sqrt(2 * PI) * 0.65, 3) / pow(-0.65, k);
                    all += fabs(hermite), alone += hermite;
                    if (!inside) far += fabs(hermite);
                }
                if (beyond) tails[k] = fmax(tails[k], far);
                if (!beyond) sums[k] = fmax(sums[k], all), ripples[k] = fmax(ripples[k], fabs(alone));
            }
    }
    for (int k = 0; k < 7; ++k) {
        if (figures()) printf("order %d: %.4g, %.4g, %.4g\n", k, sums[k], ripples[k], tails[k]);
        CHECK(sums[k] <= spsi_kernel_sums[k] && sums[k] > 0.6 * spsi_kernel_sums[k]);
        CHECK(ripples[k] <= spsi_kernel_ripples[k] && tails[k] <= spsi_kernel_tails[k]);
    }
}

/* Series of powers and exponentials are exact where the functions are, and so is what three points miss of t^6. */
static void test_series(void) {
    static const sps_lobe lobe = {-0.5f, 2};
    const double h = 0.7, half = 0.5 * h;
    spsi_series one, two, power;
    double missed = 2 * pow(half, 7) / 7, coefficient = 1;
    memset(&one, 0, sizeof one), memset(&two, 0, sizeof two);
    one.term[1] = 3, two.term[2] = 0.5;
    one = spsi_series_exponential(&one), two = spsi_series_exponential(&two);
    CHECK_NEAR(one.term[6], 729 / 720.0, 1e-12);
    CHECK_NEAR(two.term[6], 0.125 / 6, 1e-12);
    CHECK(two.term[5] <= 0);
    power = spsi_series_product(&one, &two); /* 3^4 / 4! + 3^2 / 2! / 2 + 1 / 8 */
    CHECK_NEAR(power.term[4], 81 / 24.0 + 9 / 4.0 + 1 / 8.0, 1e-12);
    memset(&two, 0, sizeof two);
    two.term[1] = 0.2;
    power = spsi_series_lobe(&lobe, 0.25, &two); /* (0.25 - 0.2 t)^(-3/2) */
    for (int n = 1; n <= 4; ++n) coefficient *= (n + 0.5) / n * 0.8;
    CHECK_NEAR(power.term[4], coefficient * 2 * 0.75 / (4 * PI * 0.125), 1e-7);
    for (int j = 0; j < 3; ++j) missed -= h * spsi_gauss_weights[j] * pow((spsi_gauss_places[j] - 0.5) * h, 6);
    CHECK_NEAR(spsi_gauss_error(h, 1), missed, 1e-9 * h);
}

enum { EDGE = 24 };

/* A marcher through voxels of unit size, whose values are given. */
static void march_voxels(float *values, float most[27], double extinction, spsi_frame *frame, spsi_marcher *marcher) {
    spsi_dense *grid = &marcher->grids[0];
    for (int i = 0; i < 27; ++i) most[i] = 1;
    grid->values = values, grid->most = most;
    for (int k = 0; k < 3; ++k) grid->size[k] = EDGE, grid->bricks[k] = 3, grid->inverse[k][k] = 1;
    grid->all_most = 1;
    frame->medium_count = 1, frame->matter.materials[0].extinction = (float)extinction;
    frame->matter.materials[0].extinguishes = extinction > 0, marcher->shade = spsi_bracket_shade;
    marcher->frame = frame, marcher->part_count = 2, marcher->step = 0.75;
    for (int k = 0; k < 3; ++k) marcher->bounds.low[k] = 0, marcher->bounds.high[k] = EDGE;
}

/* Voxels of 0 and 1 by turns along an axis bend the field most. What a step misses of them is within its bounds, and
   not far below: bounds that were a tenth as wide would not hold. So is what it misses of the light that they send. */
static void test_step(void) {
    static spsi_marcher marcher;
    static spsi_frame frame;
    static spsi_step step;
    static float values[EDGE * EDGE * EDGE], most[27];
    double tightest[2] = {0, 0};
    for (int i = 0; i < EDGE * EDGE * EDGE; ++i) values[i] = (float)(i / (EDGE * EDGE) % 2);
    march_voxels(values, most, 0, &frame, &marcher);
    for (int n = 0; n < 40; ++n) {
        const spsi_ray ray = {{12.3, 11.6, 11}, {0, 0, 1}, 0.05 * n, 0.05 * n + 0.75};
        double wanted = 0;
        spsi_enclosure bounds[2];
        spsi_incoming coming;
        spsi_step_build(&marcher, &ray, spsi_enclosure_of(0, 0), &step);
        spsi_incoming_plain(&coming);
        CHECK(step.lit && step.smooth);
        bounds[0] = step.gas[0].length, bounds[1] = spsi_step_integral(&marcher, &step, 0, &coming);
        for (int z = 1; z < EDGE; z += 2) /* kernels across sum up to 1, but for 5e-4 by axis */
            wanted += 0.5 * (erf((ray.origin[2] + ray.high - z - 0.5) / (0.65 * sqrt(2.0))) -
                             erf((ray.origin[2] + ray.low - z - 0.5) / (0.65 * sqrt(2.0))));
        for (int k = 0; k < 2; ++k) {
            double across = 0;
            for (int i = -8; i < 9; ++i) across += kernel(ray.origin[k] - floor(ray.origin[k]) - i - 0.5);
            wanted *= across;
        }
        for (int i = 0; i < 2; ++i) {
            const double middle = 0.5 * (bounds[i].low + bounds[i].high);
            CHECK(bounds[i].low <= wanted && wanted <= bounds[i].high);
            tightest[i] = fmax(tightest[i], fabs(wanted - middle) / (0.5 * (bounds[i].high - bounds[i].low)));
        }
    }
    if (figures()) printf("a step misses up to %.2f and %.2f of what is allowed\n", tightest[0], tightest[1]);
    CHECK(tightest[0] > 0.1 && tightest[1] > 0.1);
}

/* Even gas around a lamp lets exp(-extinction * distance) pass to all places of a step, and its optical depth changes
   no faster along that than its series says: by the cosine, and by half the square of the sine over the distance. 1e-3:
   kernels sum up to 1 but for 5e-4 by axis, and their ripple is even along a way of several voxels. */
static void test_shade(void) {
    static spsi_marcher marcher;
    static spsi_frame frame;
    static spsi_step step;
    static float values[EDGE * EDGE * EDGE], most[27];
    const double extinction = 3, place[3] = {12, 12, 12};
    for (int i = 0; i < EDGE * EDGE * EDGE; ++i) values[i] = 1;
    march_voxels(values, most, extinction, &frame, &marcher);
    for (int n = 0; n < 12; ++n) {
        const double away = 1.5 + n / 4, turn = 0.5 * (n % 4);
        const spsi_ray ray = {{12, 12, 12 + away}, {sin(turn), 0, cos(turn)}, -0.25, 0.25};
        spsi_incoming coming;
        spsi_light lamp;
        memset(&lamp, 0, sizeof lamp);
        lamp.is_point = lamp.shadows = 1;
        memcpy(lamp.position, place, sizeof lamp.position);
        spsi_step_build(&marcher, &ray, spsi_enclosure_of(0, 0), &step);
        spsi_incoming_plain(&coming);
        spsi_incoming_shade(&marcher, &step, &lamp, &coming);
        CHECK(coming.smooth);
        for (int i = 0; i < 9; ++i) {
            const double t = ray.low + i / 16.0,
                         depth = extinction * sqrt(away * away + t * t + 2 * t * away * cos(turn));
            CHECK(coming.passes.low <= exp(-depth) * 1.001 && exp(-depth) * 0.999 <= coming.passes.high);
        }
        CHECK(extinction * cos(turn) <= coming.series.term[1] * 1.001);
        CHECK(extinction * sin(turn) * sin(turn) / (2 * away) <= coming.series.term[2] * 1.001);
    }
}

/* 1 / (t^2 + q^2) about any place, whose k-th derivative / k! is sin((k + 1) angle) / (q r^(k + 1)) for the angle at
   which the lamp is seen: the series is not below that, and not far above where the lamp is ahead. */
static void test_falloff(void) {
    static spsi_frame frame;
    static spsi_content content;
    static spsi_marcher marcher;
    double tightest = 0;
    frame.content = &content;
    marcher.frame = &frame;
    for (int n = 0; n < 30; ++n) {
        const double q = 0.1 + 0.1 * (n % 3), t = 1 + 0.1 * n, r = sqrt(t * t + q * q);
        static spsi_step step;
        spsi_light lamp;
        spsi_incoming coming;
        memset(&lamp, 0, sizeof lamp);
        memset(&step, 0, sizeof step);
        lamp.is_point = lamp.falls_off = 1;
        lamp.position[0] = q, lamp.position[1] = t;
        step.ray.direction[1] = 1, step.ray.low = -0.01, step.ray.high = 0.01;
        spsi_incoming_plain(&coming);
        spsi_incoming_fall(&marcher, &step, &lamp, &coming);
        CHECK(coming.range.low <= 1 / (r * r) && 1 / (r * r) <= coming.range.high && coming.smooth);
        CHECK_NEAR(coming.falls[1], 1 / (r * r), 1e-9);
        for (int k = 0; k <= 6; ++k) {
            const double exact_term = fabs(sin((k + 1) * atan2(q, t))) / (q * pow(r, k + 1));
            CHECK(exact_term <= coming.falloff.term[k] * (1 + 1e-12));
            if (k > 0) tightest = fmax(tightest, exact_term / coming.falloff.term[k]);
        }
    }
    CHECK(tightest > 0.5);
}

/* Before a white background, gas that scatters nothing lets exp(-depth) pass, and a kernel's integral along its axis is
   an error function. */
static void test_absorption(void) {
    for (int noisy = 0; noisy < 2; ++noisy) {
        check_scene s;
        sps_volume *volume = start(&s, noisy, 1.5);
        double width[2];
        check_color(volume->albedo, 0, 0, 0);
        check_color(s.scene.background, 1, 1, 1);
        for (int n = 0; n < 2; ++n) {
            width[n] = check_order(&s, n ? 0.25 : 0.5);
            for (int i = 0; i < COUNT; ++i) {
                double depth = 0, x = 2.0 / SIDE * (i % SIDE + 0.5) - 1, y = 1 - 2.0 / SIDE * (i / SIDE + 0.5), passed;
                for (int v = 0; v < VALUES; ++v)
                    depth += 1.5 * 0.25 * (double)arrays[noisy].values[v] * kernel(4 * (x + 1) - v % GRID - 0.5) *
                             kernel((y + 1.2) / 0.3 - v / GRID % GRID - 0.5);
                passed = exp(-depth);
                CHECK((double)low[3 * i] <= passed && passed <= (double)high[3 * i]);
            }
        }
        if (figures()) printf("absorbed%s: bounds %.2g apart, %.2g\n", noisy ? ", noise" : "", width[0], width[1]);
        CHECK(width[1] - 4.2e-6 < (width[0] - 4e-6) / 32); /* without what floats round, the sixth power: 64 */
        if (noisy)
            CHECK_CASE("Transport", "voxels of noise, absorbing: bounds apart in steps of a quarter",
                       "closed form within", width[1], 1e-4,
                       "249 / 2016000 of half the values' range, by the step to the sixth, per voxel");
        else
            CHECK(width[1] < 2e-5);
    }
}

/* Bounds hold beside a volume's box, too, as far as kernels reach: 2.55 to 2.95 voxels from it, gas that is dense
   enough shows. */
static void test_tails(void) {
    double least = 1;
    check_scene s;
    check_color(start(&s, 0, 1e3)->albedo, 0, 0, 0);
    check_color(s.scene.background, 1, 1, 1);
    s.view.camera.position[0] = s.view.camera.target[0] = 1 + 2.75 * 0.25;
    check_orthographic(&s.view.camera, 0.1);
    if (!CHECK_OK(context, bracket(context, &s, 0.25))) return;
    for (int i = 0; i < COUNT; ++i) {
        double depth = 0, x = 1 + 2.75 * 0.25 + 0.1 / SIDE * (i % SIDE + 0.5) - 0.05,
               y = 0.05 - 0.1 / SIDE * (i / SIDE + 0.5);
        for (int v = 0; v < VALUES; ++v)
            depth += 1e3 * 0.25 * (double)arrays[0].values[v] * kernel(4 * (x + 1) - v % GRID - 0.5) *
                     kernel((y + 1.2) / 0.3 - v / GRID % GRID - 0.5);
        CHECK((double)low[3 * i] <= exp(-depth) && exp(-depth) <= (double)high[3 * i]);
        least = fmin(least, (double)high[3 * i]);
    }
    CHECK(least < 0.9999);
}

enum { SUN, LAMP, SPOT, LOBES, OWN, TWO, NOISE, CURTAIN, KINDS };

static void start_kind(check_scene *s, int kind) {
    static const sps_lobe lobe = {0.6f, 1};
    sps_volume *volume = start(s, kind == NOISE, 1);
    sps_light *light;
    if (kind == LAMP || kind == SPOT)
        light = check_add_point(s, 0.6, 2, 0.9, 3);
    else
        light = check_add_directional(s, 0.4, -1, -0.3, 2);
    if (kind == SPOT) check_set3(light->direction, -0.2, -1, -0.3), light->inner_cone = 0.3, light->outer_cone = 0.8;
    if (kind == LOBES || kind == LAMP) volume->lobes = &lobe, volume->lobe_count = 1;
    if (kind == OWN) s->scene.ambient[0] = 0.3f, volume->emission[0] = 0.2f, s->scene.background[0] = 0.4f;
    if (kind == CURTAIN) { /* something opaque and black above, which ends amid rays */
        volume->extinction = 0.02f;
        check_set3(s->light[0].direction, 0, -1, 0);
        volume = check_add_volume(s, GRID, GRID, GRID, check_box(-3, 3.3, 0, 3, 5.3, 2));
        volume->read_fn = check_read_array, volume->user = &arrays[0];
        volume->extinction = 40;
    }
    if (kind != TWO) return;
    volume = check_add_volume(s, GRID, GRID, GRID, check_box(-0.4, -0.5, -0.8, 1.2, 0.9, 0.6));
    volume->read_fn = check_read_array, volume->user = &arrays[1];
    volume->extinction = 2;
    check_color(volume->albedo, 0.5, 0.6, 0.3);
}

/* Light that scatters once, from every kind of light that has bounds. */
static void test_scattering(void) {
    static const int pixels[2] = {5, 11};
    const int count = check_long() ? 2 : 1;
    static const char *const names[] = {"sun", "lamp", "spot", "lobes", "own light", "two volumes", "noise", "curtain"};
    for (int kind = 0; kind < KINDS; ++kind) {
        double wanted[2];
        check_scene s;
        start_kind(&s, kind);
        for (int i = 0; i < count; ++i) wanted[i] = truth(&s, pixels[i], 0);
        for (int n = 0; n < (kind == 0 || check_long() ? 2 : 1); ++n) {
            const double width = check_order(&s, n ? 0.4 : 0.75);
            if (figures()) printf("%s, step %g: bounds %.2g apart\n", names[kind], n ? 0.4 : 0.75, width);
            CHECK(kind == CURTAIN || width < (n ? 0.004 : 0.04));
            for (int i = 0; i < count; ++i) {
                const double bounds[2] = {(double)low[3 * pixels[i]], (double)high[3 * pixels[i]]};
                if (!CHECK(bounds[0] <= wanted[i] && wanted[i] <= bounds[1]))
                    printf("    %s, pixel %d: %.9g not within %.9g .. %.9g\n", names[kind], pixels[i], wanted[i],
                           bounds[0], bounds[1]);
            }
        }
    }
}

/* A plate above the gas ends at z = 0.1 and shades what is below that, along light that comes at a slant: each of the
   eye's rays comes into its shadow at another place. */
static void test_shadow(void) {
    for (int opaque = 0; opaque < 2; ++opaque) {
        const double origin[3] = {-9, 1.8, -9}, u[3] = {18, 0, 0}, v[3] = {0, 0, 9.1};
        check_scene s;
        double width;
        start(&s, 0, 1);
        check_add_quad(&faces, origin, u, v);
        check_add_mesh(&s, &faces, 0);
        if (!opaque) check_translucent(&s.mesh[0], 0.5);
        check_add_directional(&s, 0.3, -1, -0.4, 2);
        width = check_order(&s, 0.5);
        if (figures()) printf("%s plate: bounds %.2g apart\n", opaque ? "opaque" : "translucent", width);
        CHECK(width < 0.0022); /* of 16 steps one is halved 6 times: 1 / 1024, and what others are apart by, 0.001 */
        for (int i = 1; i < COUNT && opaque; i += 4) {
            const double y = 1 - 2.0 / SIDE * (i / SIDE + 0.5), wanted = truth(&s, i, 2.5 - (0.1 - 0.4 * (1.8 - y)));
            if (!CHECK((double)low[3 * i] <= wanted && wanted <= (double)high[3 * i]))
                printf("    pixel %d: %.9g not within %.9g .. %.9g\n", i, wanted, (double)low[3 * i],
                       (double)high[3 * i]);
        }
    }
}

/* A pane halves what is behind it; a floor is lit through gas. */
static void test_faces(void) {
    const double origin[3] = {-3, -3, -1.5}, u[3] = {6, 0, 0}, v[3] = {0, 6, 0}, above[3] = {-3, -3, 2};
    check_triangles pane;
    check_scene s;
    memset(&pane, 0, sizeof pane);
    start(&s, 0, 1);
    check_add_quad(&faces, origin, u, v);
    check_add_mesh(&s, &faces, 0.5);
    check_add_directional(&s, 0, 0, -1, PI);
    check_order(&s, 0.4);
    for (int i = 5; i < COUNT; i += 5) { /* there and back again */
        const double way[3] = {0, 0, -1},
                     p[3] = {2.0 / SIDE * (i % SIDE + 0.5) - 1, 1 - 2.0 / SIDE * (i / SIDE + 0.5), 2.5};
        const double lit = 0.5 * exp(-2 * depth_along(&s, p, way, 5, 100));
        s.scene.mesh_count = 0;
        CHECK_NEAR(0.5 * ((double)low[3 * i] + (double)high[3 * i]), lit + truth(&s, i, 0), 1e-4);
        CHECK((double)low[3 * i] <= lit + truth(&s, i, 0) && lit + truth(&s, i, 0) <= (double)high[3 * i]);
        s.scene.mesh_count = 1;
    }
    memcpy(exact, low, sizeof low);
    check_add_quad(&pane, above, u, v);
    check_add_mesh(&s, &pane, 0);
    check_translucent(&s.mesh[1], 0.5);
    s.light[0].no_shadow = 1;
    check_order(&s, 0.4);
    memcpy(exact, low, sizeof low);
    s.scene.mesh_count = 1;
    check_order(&s, 0.4);
    for (int i = 0; i < 3 * COUNT; ++i) CHECK_NEAR((double)exact[i], 0.5 * (double)low[i], 1e-6 * (double)low[i]);
    check_free_triangles(&pane);
}

/* Chords of balls are exact, and gas amid them shines on both of their sides. Bounds of a floor's light have their
   shadows. The march's steps have particles' mean optical depth, and its kernels end, which costs it 2e-6 of each. */
static void test_particles(void) {
    const double origin[3] = {-3, -3, -1.5}, u[3] = {6, 0, 0}, v[3] = {0, 6, 0};
    for (int kind = 0; kind < 3; ++kind) { /* gas that absorbs, gas that shines, a floor below gas that absorbs */
        check_scene s;
        start(&s, 0, 1);
        check_add_swarm(&s, 0.4);
        check_color(s.volume[0].albedo, 0, 0, 0);
        check_color(s.scene.background, 1, 1, 1);
        if (kind == 1) check_color(s.volume[0].emission, 2, 2, 2);
        if (kind == 2) {
            check_add_quad(&faces, origin, u, v);
            check_add_mesh(&s, &faces, 0.5);
            check_add_directional(&s, 0.1, -0.2, -1, PI);
        }
        check_order(&s, 0.25);
        check_march(context, &s, 0.02, exact, NULL);
        for (int i = 0; i < 3 * COUNT; ++i) {
            const double found = (double)exact[4 * (i / 3) + i % 3], room = kind ? 2e-4 * found : 2e-5;
            CHECK((double)low[i] - room <= found && found <= (double)high[i] + room);
            CHECK(kind == 1 || (double)high[i] - (double)low[i] < 1e-4);
        }
    }
}

/* However dense gas is, bounds are finite and in order, and never above what all of it could scatter. */
static void test_dense(void) {
    static const double extinctions[] = {1e-6, 30, 1e3, 1e6, 1e15};
    for (int n = 0; n < 5; ++n) {
        check_scene s;
        double width;
        start(&s, n > 2, extinctions[n]);
        check_add_directional(&s, 0.3, -0.4, -1, 4 * PI);
        width = check_order(&s, 0.75);
        if (figures()) printf("extinction %g: bounds %.2g apart\n", extinctions[n], width);
        for (int i = 0; i < COUNT; ++i) CHECK(low[3 * i] >= -1e-6f && high[3 * i] <= 0.9f * (1 + 3e-6f));
        if (n < 3) CHECK(width < (n < 2 ? 0.002 : 0.02)); /* 0.3 and 14 units of optical depth a voxel */
    }
}

/* A march in short steps lies between the bounds, in each color: 2e-6 of kernels apart, and its steps, halved, change
   it by 1e-4. */
static void check_held(const check_scene *s, double step) {
    check_order(s, step);
    check_march(context, s, 0.04, exact, NULL);
    for (int i = 0; i < 3 * COUNT; ++i) {
        const double found = (double)exact[4 * (i / 3) + i % 3], room = 5e-4 * found;
        CHECK((double)low[i] - room <= found && found <= (double)high[i] + room);
    }
}

/* Noise in a box that is turned about an axis oblique to the eye's, under a sun; and noise that glows, in ambient
   light, so dense that quadrature of what comes from everywhere is off by more than the march. */
static void test_turned(void) {
    for (int n = 0; n < 2; ++n) {
        check_scene s;
        sps_volume *volume = start(&s, 1, n ? 6 : 2);
        sps_placement *place = &volume->placement;
        *place = check_box(-0.6, -0.5, -0.9, 0.6, 0.9, 0.4);
        check_set3(place->axis[0], 0.8, 0.3, -0.7), check_set3(place->axis[1], -0.5, 1.1, 0.2);
        check_set3(place->axis[2], 0.6, 0.1, 1);
        for (int k = 0; k < 3; ++k)
            place->origin[k] = -0.5 * (place->axis[0][k] + place->axis[1][k] + place->axis[2][k]);
        if (n == 0) check_add_directional(&s, 0.5, -1, -0.7, 3);
        if (n == 1) check_color(volume->emission, 3, 2, 1), check_color(s.scene.ambient, 0.5, 1, 2);
        check_held(&s, 0.75);
    }
}

/* A lamp within the gas, on a pixel's ray and beside it; one that does not fall off, behind which a lobe is another.
   Bounds are no farther apart than those of a straight line through the middle of each step: half a step of 0.0625
   changes the gas, whose slope is 1.03 at most and whose mean 0.5, by 0.13 of it, and what both ways let pass by 0.06.
   The square of the sum is 0.037. Beside the lamp, steps of half the length have a quarter of that. */
static void test_lamp_within(void) {
    static const sps_lobe lobe = {0.3f, 1};
    for (int n = 0; n < 3; ++n) {
        const double pixel = 2.0 / SIDE;
        double width, halved;
        check_scene s;
        sps_volume *volume = start(&s, 0, 1);
        sps_light *lamp = check_add_point(&s, n == 1 ? 0 : 0.5 * pixel, n == 1 ? 0 : 0.5 * pixel, 0.1, 1);
        if (n == 2) volume->lobes = &lobe, volume->lobe_count = 1;
        if (n == 2) lamp->falloff = SPS_FALLOFF_NONE, lamp->no_shadow = 1, lamp->position[0] += 1e-4;
        width = n == 1 ? check_order(&s, 1) : HUGE_VAL;
        halved = check_order(&s, 0.5);
        if (!CHECK(halved < 0.037 && halved < 0.25 * width)) printf("    %d: bounds %g apart, %g\n", n, width, halved);
        check_march(context, &s, 0.04, exact, NULL);
        for (int i = 0; i < 3 * COUNT; ++i) { /* the march: 2e-6 of kernels, and its steps, halved, by 1e-4 */
            const double found = (double)exact[4 * (i / 3) + i % 3], room = 5e-4 * found;
            CHECK((double)low[i] - room <= found && found <= (double)high[i] + room);
        }
    }
}

/* A cone bends within a range just where a straight line through its ends misses it. */
static void test_corners_of_cones(void) {
    check_random random = {3};
    spsi_cone cone;
    int bent = 0;
    memset(&cone, 0, sizeof cone);
    cone.exists = 1, cone.none = 0.7, cone.rim = 0.4; /* all of the light up to 0.3, none from 0.7 on */
    for (int n = 0; n < 1000; ++n) {
        const double from = check_next(&random), to = from + 0.5 * check_next(&random);
        double share[3];
        spsi_enclosure range;
        range.low = from, range.high = to;
        for (int i = 0; i < 3; ++i) share[i] = fmin(fmax((0.7 - from - 0.5 * i * (to - from)) / 0.4, 0), 1);
        CHECK(spsi_cone_bends(&cone, range) == (fabs(share[0] + share[2] - 2 * share[1]) > 1e-12));
        bent += spsi_cone_bends(&cone, range);
    }
    CHECK(bent > 100 && bent < 900);
}

/* Gas outside of a cone is dark, and nothing else is said of it. */
static void test_outside_cone(void) {
    check_scene s;
    sps_light *lamp;
    start(&s, 1, 1);
    lamp = check_add_point(&s, 2.9, 0, 0, 1);
    check_set3(lamp->direction, 0.1, -1, 0), lamp->inner_cone = 0.9, lamp->outer_cone = 1;
    check_order(&s, 0.75);
    for (int i = 0; i < 3 * COUNT; ++i) CHECK(low[i] <= 0 && high[i] >= 0 && high[i] < 1e-6f);
}

static void check_refused(const check_scene *s, const char *text) {
    rgba[0] = low[0] = 7;
    CHECK(bracket(context, s, 0.5) == SPS_ERROR_UNSUPPORTED);
    if (!CHECK(strstr(sps_error(context), text) != NULL)) printf("    got \"%s\"\n", sps_error(context));
    CHECK(rgba[0] > 6 && low[0] > 6 && check_error_info(context, SPS_ERROR_UNSUPPORTED));
}

static void test_refused(void) {
    static const sps_transfer_point points[] = {{0, {0, 0, 0}, 0, {0, 0, 0}}, {1, {1, 1, 1}, 9, {0, 0, 0}}};
    static const sps_transfer transfer = {points, 2, NULL, NULL, 0};
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    start(&s, 0, 1);
    check_add_directional(&s, 0, 0, -1, 1);
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    check_refused(&s, "view.scattering must be SPS_SCATTERING_SINGLE");
    s.view.scattering = SPS_SCATTERING_FORWARD;
    check_refused(&s, "view.scattering must be SPS_SCATTERING_SINGLE");
    s.view.scattering = SPS_SCATTERING_SINGLE;
    s.volume[0].transfer = &transfer;
    check_refused(&s, "volume[0].transfer");
    s.volume[0].transfer = NULL;
    s.light[0].angular_diameter = 0.1;
    check_refused(&s, "light[0]");
    s.light[0].angular_diameter = 0;
    check_add_swarm(&s, 1);
    check_refused(&s, "particles[0]");
    s.scene.particle_set_count = 0;
    s.scene.volume_count = 2;
    s.volume[1] = s.volume[0];
    s.volume[1].placement.origin[0] = 1e9;
    check_refused(&s, "too far apart");
    for (int i = 0; i < 2; ++i) /* in thousandths, nearer and as many steps */
        for (int k = 0; k < 3; ++k) s.volume[i].placement.axis[k][k] *= 1e-3;
    s.volume[1].placement.origin[0] = 1e6;
    check_refused(&s, "too far apart");
    s.scene.volume_count = 1;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, settings.lower = low, image.rgba = rgba;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "upper is NULL") != NULL);
    settings.upper = high, settings.lower = NULL;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "lower is NULL") != NULL);
    settings.lower = high;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_ARGUMENT);
    CHECK(strstr(sps_error(context), "upper is the memory of lower, too") != NULL);
    settings.lower = low, settings.samples = 4;
    CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED);
    CHECK(strstr(sps_error(context), "samples") != NULL);
    CHECK_OK(context, bracket(context, &s, 0.5));
}

/* The same bits for any number of workers and in part of the image; rows that are longer; empty scenes. */
static void test_workers(void) {
    static float wide[2 * 3 * COUNT];
    check_hooks hooks;
    sps_context *by;
    sps_reference_settings settings;
    sps_image image;
    check_scene s;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = 3, hooks.order = 1;
    by = check_context(&hooks);
    start_kind(&s, TWO);
    check_order(&s, 0.75);
    memcpy(exact, low, sizeof low);
    CHECK_OK(by, bracket(by, &s, 0.75));
    CHECK(memcmp(exact, low, sizeof low) == 0);
    s.view.region[0] = 1, s.view.region[1] = 2, s.view.region[2] = 3, s.view.region[3] = 2;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.75, settings.lower = wide, settings.upper = high, image.rgba = rgba, image.row_pixels = 5;
    CHECK_OK(by, sps_reference(by, &s.scene, &s.view, &settings, &image));
    for (int y = 0; y < 2; ++y)
        CHECK(memcmp(wide + (size_t)y * 15, exact + 3 * ((size_t)(y + 2) * SIDE + 1), 9 * sizeof(float)) == 0);
    memset(s.view.region, 0, sizeof s.view.region);
    s.scene.volume_count = 0;
    s.scene.background[1] = 0.5f;
    CHECK_OK(by, bracket(by, &s, 0.75));
    CHECK(low[0] <= 0 && high[0] >= 0 && high[0] < 1e-6f && low[1] < 0.5f && high[1] > 0.5f && high[1] < 0.500002f);
    sps_destroy(by);
    CHECK(hooks.live == 0);
}

/* Every allocation may fail, and every call of progress_fn cancel: bounds and image stay as they were. */
static void test_failures(void) {
    for (int cancels = 0; cancels < 2; ++cancels)
        for (long n = 1; n < 1000; ++n) {
            check_cancel cancel = {0, 0};
            check_hooks hooks;
            sps_config config;
            sps_context *by;
            sps_result result;
            check_scene s;
            memset(&hooks, 0, sizeof hooks);
            config = check_config(&hooks);
            config.progress_fn = check_cancel_at, config.progress_user = &cancel;
            config.clock_fn = check_hasty_clock;
            by = sps_create(&config, NULL);
            start(&s, 0, 1);
            s.view.region[2] = s.view.region[3] = 2;
            if (cancels) cancel.at = n;
            if (!cancels) hooks.fail_at = hooks.allocations + n;
            rgba[0] = low[0] = 7;
            result = bracket(by, &s, 0.75);
            CHECK(result == SPS_OK || result == (cancels ? SPS_ERROR_CANCELLED : SPS_ERROR_MEMORY));
            CHECK(result == SPS_OK || (rgba[0] > 6 && low[0] > 6));
            hooks.fail_at = cancel.at = 0;
            CHECK_OK(by, bracket(by, &s, 0.75));
            sps_destroy(by);
            CHECK(hooks.live == 0);
            if (result == SPS_OK) break;
            CHECK(n < 999);
        }
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    fill_values();
    RUN(test_kernel);
    RUN(test_series);
    RUN(test_step);
    RUN(test_shade);
    RUN(test_falloff);
    RUN(test_absorption);
    RUN(test_tails);
    RUN(test_scattering);
    RUN(test_shadow);
    RUN(test_faces);
    RUN(test_particles);
    RUN(test_dense);
    RUN(test_turned);
    RUN(test_lamp_within);
    RUN(test_corners_of_cones);
    RUN(test_outside_cone);
    RUN(test_refused);
    RUN(test_workers);
    RUN(test_failures);
    sps_destroy(context);
    check_free_triangles(&faces);
    return check_report();
}
