/* Light that scatters forward more than once: tables against another form of their series, layers against integrals of
   it, all kinds of matter, lights and shadows against the reference, clouds against random paths; and where it must
   leave everything as it is. */

#include "check.h"

enum { SIDE = 16, COUNT = 4 * SIDE * SIDE, CLOUD = 24, PUFF_EXTINCTION = 5, LANE_COUNT = SPSI_LANES };
static float image_a[COUNT], image_b[COUNT], image_c[COUNT], errors[3 * SIDE * SIDE];
static sps_context *context;
static check_triangles ground, pane;

static const float one = 1;

/* --- the series --- */

static double henyey_greenstein(double g, double c) { return (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * c, 1.5)); }

/* A phase function folded with itself until it stands for n events: lobes multiply their asymmetries. */
static double folded(const sps_lobe pair[2], int n, double c) {
    double sum = 0, ways = pow((double)pair[0].weight, n);
    if (!(pair[1].weight > 0)) return henyey_greenstein(pow((double)pair[0].asymmetry, n), c);
    for (int i = 0; i <= n; ++i) { /* i events by the second lobe */
        sum += ways * henyey_greenstein(pow((double)pair[0].asymmetry, n - i) * pow((double)pair[1].asymmetry, i), c);
        ways *= (double)pair[1].weight / (double)pair[0].weight * (n - i) / (i + 1);
    }
    return sum;
}

/* X of two lobes whose weights add up to 1, event by event instead of order by order. What is lost from the order 0 is
   the fit that >>scattering states. */
static double exact_pair(const sps_lobe pair[2], double albedo, double t, double c) {
    const double g =
        (double)pair[0].weight * (double)pair[0].asymmetry + (double)pair[1].weight * (double)pair[1].asymmetry;
    const double lost = 0.06 * (1 + c) * (1 + c) * (1 - g) * t;
    double sum = 0, uniform = 0, weight = exp(-t);
    for (int k = 1; k < 40 + 4 * t; ++k) {
        weight *= albedo * t / (k + 1);
        sum += weight * folded(pair, k + 1, c);
        uniform += weight * 0.25 / PI;
    }
    return fmax(sum - uniform * lost / (1 + lost), -folded(pair, 1, c) * exp(-t));
}

static double exact_forward(double g, double albedo, double t, double c) {
    const sps_lobe pair[2] = {{(float)g, 1}, {0, 0}};
    return exact_pair(pair, albedo, t, c);
}

/* Optical depth of a column of a table, whose last one is at 64. */
static double depth_of_column(int column) {
    const double u = column / 31.0 * (64 / 68.0);
    return 4 * u / (1 - u);
}

/* X as it is shown: from the last column but one, at 41, it goes to 0 at 64, linearly in u = t / (t + 4). */
static double shown_forward(double g, double t, double c) {
    const double last = depth_of_column(30);
    const double share = (64 / 68.0 - t / (t + 4)) / (64 / 68.0 - last / (last + 4));
    return fmax(fmin(share, 1), 0) * exact_forward(g, 1, fmin(t, last), c);
}

static spsi_material gas_of(double g, double albedo) {
    spsi_material material;
    memset(&material, 0, sizeof material);
    material.lobe_count = 1, material.lobes[0].weight = 1, material.lobes[0].asymmetry = (float)g;
    for (int c = 0; c < 3; ++c) material.albedo[c] = (float)albedo;
    return material;
}

/* A table's mean from depth t0 to t1. */
static double table_mean(const spsi_material *material, double albedo, double c, double t0, double t1) {
    float lanes[LANE_COUNT];
    spsi_forward_part part;
    spsi_forward_part_build(spsi_set((float)c), spsi_set((float)t0), spsi_set((float)t1), &part);
    spsi_store(lanes, spsi_forward_channel(material, 0, spsi_set((float)albedo), &part));
    return (double)lanes[0];
}

/* At nodes, what orders are left out costs: their squares are below 1e-4, and the phase function's peak is the sum of
   all of them. Between nodes, a bilinear table errs by about what half a node changes the slope. */
static void test_series(void) {
    static const double asymmetries[] = {-0.6, 0, 0.5, 0.85, 0.95}, allowed[] = {0.01, 0.01, 0.005, 0.01, 0.02};
    static spsi_forward table;
    for (int i = 0; i < 5; ++i) {
        const double g = asymmetries[i], albedo = i % 2 ? 0.9 : 1;
        spsi_material material = gas_of(g, albedo);
        check_random random = {3};
        double square = 0, worst = 0;
        spsi_forward_build(&material, 0, 0, &table);
        material.forward = &table;
        CHECK(table.level_count == 1);
        for (int n = 0; n < 2000; ++n) {
            const int column = (int)(31 * check_next(&random)), row = (int)(32 * check_next(&random));
            const double t = depth_of_column(column), c = cos(PI * row * row / (31.0 * 31));
            const double angle = 1 - 2 * check_next(&random) * check_next(&random), depth = 12 * check_next(&random);
            const double exact = exact_forward((double)(float)g, (double)(float)albedo, depth, angle);
            const double whole = exact + henyey_greenstein(g, angle) * exp(-depth);
            const double off = (double)table.level[0][row * 32 + column] -
                               exact_forward((double)(float)g, (double)(float)albedo, t, c);
            worst = fmax(worst, fabs(off) / (henyey_greenstein(fabs(g), 1) * (1 + t) * exp(-t) + 1e-6));
            square += pow((table_mean(&material, albedo, angle, depth, depth) - exact) / whole, 2) / 2000;
        }
        if (figures()) printf("g %.2f: nodes off by %.6f of the peak, between them %.4f rms\n", g, worst, sqrt(square));
        CHECK(worst < 1e-3);
        CHECK(sqrt(square) < allowed[i]);
    }
}

/* The end of the series, in tables and where it is marched: as far as 80, beyond which nothing changes. */
static void test_end(void) {
    static spsi_forward table;
    spsi_material material = gas_of(0.8, 1);
    spsi_forward_build(&material, 0, 0, &table);
    material.forward = &table;
    for (int n = 0; n < 200; ++n) {
        const double t = 30 + 0.25 * n, c = 1 - 0.01 * n, exact = shown_forward((double)(float)0.8, t, c);
        double taken, shown = spsi_forward_fade(t, &taken);
        shown *= exact_forward((double)(float)0.8, 1, taken, c);
        CHECK_NEAR(shown, exact, 1e-9);
        CHECK_NEAR(table_mean(&material, 1, c, t, t), exact, 0.03 * exact);
    }
}

/* Several lobes: the sum over events has every mixture of them. */
static void test_lobes(void) {
    static const sps_lobe pair[2] = {{0.7f, 0.75f}, {-0.3f, 0.25f}};
    static spsi_forward table;
    spsi_material material = gas_of(0, 1);
    material.lobe_count = 2;
    memcpy(material.lobes, pair, sizeof pair);
    spsi_forward_build(&material, 0, 0, &table);
    for (int i = 0; i < 31; i += 3)
        for (int k = 0; k < 32; k += 3) {
            const double t = depth_of_column(i);
            const double exact = exact_pair(pair, 1, t, cos(PI * k * k / (31.0 * 31)));
            CHECK_NEAR((double)table.level[0][32 * k + i], exact, 1e-3 * folded(pair, 1, 1) * (1 + t) * exp(-t) + 1e-6);
        }
}

/* Classified volumes look albedo up, too. Errors are relative to what an albedo of 1 would send; at a small albedo and
   a large depth, where next to nothing is sent, they are a larger part of it. */
static void test_levels(void) {
    static spsi_forward table, exact;
    static spsi_table classified;
    double worst = 0;
    spsi_material material = gas_of(0.7, 0);
    material.table = &classified;
    spsi_forward_build(&material, 0, 0, &table);
    material.forward = &table;
    CHECK(table.level_count == SPSI_FORWARD_LEVELS);
    for (int i = 0; i <= 40; ++i)
        for (int n = 0; n < 8; ++n) {
            const double albedo = i / 40.0, t = 0.2 + n, c = cos(0.4 * n);
            spsi_material gas = gas_of(0.7, albedo);
            spsi_forward_build(&gas, 0, 0, &exact);
            gas.forward = &exact;
            worst = fmax(worst, fabs(table_mean(&material, albedo, c, t, t) - table_mean(&gas, albedo, c, t, t)) /
                                    (table_mean(&material, 1, c, t, t) + henyey_greenstein(0.7, c) * exp(-t)));
        }
    if (figures()) printf("levels of albedo: off by %.4f\n", worst);
    CHECK(worst < 0.015);
}

/* Means over parts, thin and thick, against many depths in each. */
static void test_means(void) {
    static const double starts[] = {0, 0.5, 3, 20}, lengths[] = {0.01, 0.5, 1.9, 4, 16, 100};
    static spsi_forward table;
    spsi_material material = gas_of(0.8, 1);
    spsi_forward_build(&material, 0, 0, &table);
    material.forward = &table;
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 6; ++k)
            for (int n = 0; n < 3; ++n) {
                const double t0 = starts[i], t1 = t0 + lengths[k], c = 1 - 0.6 * n;
                const double low = log(t0 + 1), high = log(t1 + 1);
                double sum = 0, got = table_mean(&material, 1, c, t0, t1);
                for (int m = 0; m < 2000; ++m) {
                    const double t = exp(low + (high - low) * (m + 0.5) / 2000) - 1;
                    sum += table_mean(&material, 1, c, t, t) * (t + 1) * (high - low) / 2000 / (t1 - t0);
                }
                if (!CHECK(fabs(got - sum) <= (lengths[k] < 4 ? 0.01 : 0.06) * sum + 1e-6))
                    printf("    from %g, %g long, cosine %g: %g, exact %g\n", t0, lengths[k], c, got, sum);
                got = table_mean(&material, 1, c, t1, t0);
                CHECK_NEAR(got, table_mean(&material, 1, c, t0, t1), 1e-6 + 1e-4 * sum);
            }
}

/* --- layers --- */

/* A layer of unit thickness and unit albedo, far wider than the view, lit along the eye's rays or against them. */
static void start_layer(check_scene *s, double depth, const sps_lobe *lobe, double towards) {
    sps_volume *volume;
    check_clear(s, 4, 4);
    volume = check_add_volume(s, 16, 16, 64, check_box(-4, -4, 0, 4, 4, 1));
    volume->read_fn = check_read_constant;
    volume->user = (void *)(size_t)&one;
    volume->extinction = (float)depth;
    volume->lobes = lobe, volume->lobe_count = 1;
    check_color(volume->albedo, 1, 1, 1);
    check_set3(s->view.camera.position, 0, 0, 9);
    check_add_directional(s, 0, 0, towards, 1);
    s->view.scattering = SPS_SCATTERING_FORWARD;
    s->view.quality = SPS_QUALITY_HIGH;
}

/* Through a layer, all light passes the same depth, wherever it scatters; what comes back has passed twice the depth at
   which it turned. Any number of slabs must show this: errors are the tables' and, for few slabs, the quadrature's. */
static void test_layers(void) {
    static const double depths[] = {0.3, 2, 8}, slabs[] = {1, 8, 32};
    static const sps_lobe lobe = {0.8f, 1};
    const double g = (double)lobe.asymmetry;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            for (int back = 0; back < 2; ++back) {
                const double t = depths[i];
                double exact = 0;
                check_scene s;
                start_layer(&s, t, &lobe, back ? -1 : 1);
                s.view.slab_thickness = slabs[k];
                check_render(context, &s, image_a);
                if (back)
                    for (int n = 0; n < 400; ++n) {
                        const double x = 2 * t * (n + 0.5) / 400;
                        exact += t / 400 * (henyey_greenstein(g, -1) * exp(-x) + exact_forward(g, 1, x, -1));
                    }
                else
                    exact = t * (henyey_greenstein(g, 1) * exp(-t) + exact_forward(g, 1, t, 1));
                if (figures())
                    printf("layer of %g, %s, slabs of %g: %.5f, exact %.5f\n", t, back ? "back" : "through", slabs[k],
                           (double)image_a[0], exact);
                CHECK_CASE("Scattering",
                           "layer of depth 0.3 to 8 through or back, in 1 to 64 sheets, forward scattering",
                           "integral of the series, relative", fabs((double)image_a[0] / exact - 1), 0.03,
                           "tables, 1 %; the quadrature of few slabs");
            }
}

/* By what a dense layer is shaded. */
enum { BY_SHEETS, BY_TABLE, BY_PLANES, BY_SAMPLES, BY_DISC, BY_LAMP, BY_BOTH, SOURCES };
static const char *const sources[] = {"sheets", "table", "planes", "samples", "disc", "lamp", "sheets and table"};

static void shade_layer(check_scene *s, int source, double towards) {
    static const sps_tmap_settings planes = {.technique = SPS_TMAP_OPACITY, .components = 64};
    sps_light *light = &s->light[0];
    if (source == BY_SHEETS || source == BY_SAMPLES || source == BY_BOTH) check_force_sheets(s);
    if (source == BY_TABLE) light->shadow_source = SPS_SHADOW_TABLE;
    if (source == BY_PLANES) light->shadow_map = &planes;
    if (source == BY_SAMPLES) light->angular_diameter = 0.02;
    if (source == BY_DISC || source == BY_LAMP) {
        light->kind = source == BY_DISC ? SPS_LIGHT_DISC : SPS_LIGHT_POINT;
        check_set3(light->position, 0, 0, -1000 * towards);
        check_color(light->color, 1e6, 1e6, 1e6);
    }
    if (source == BY_DISC) light->axes[0][0] = light->axes[1][1] = 100;
    if (source == BY_BOTH) {
        check_add_directional(s, 0, 0, towards, 1);
        s->light[1].shadow_source = SPS_SHADOW_TABLE;
    }
    if (source == BY_SAMPLES || source == BY_DISC) light->samples = 5;
}

/* Of a layer by one light: seen against it, or from its side. */
static double exact_layer(double g, double t, int back) {
    double sum = 0;
    if (!back) return t * (henyey_greenstein(g, 1) * exp(-t) + shown_forward(g, t, 1));
    for (int n = 0; n < 2000; ++n) {
        const double x = fmin(2 * t, 64) * (n + 0.5) / 2000;
        sum += henyey_greenstein(g, -1) * exp(-x) + shown_forward(g, x, -1);
    }
    return sum * fmin(t, 32) / 2000;
}

/* Dense layers, in which light is followed to 64, whatever shades. Seen against the light, nothing behind that is lit:
   what one of 120 may show is the round-off of the last column. Thick slabs may err as much as test_means allows. */
static void test_dense(void) {
    static const double depths[] = {30, 50, 120}, slabs[] = {2, 32};
    static const sps_lobe lobe = {0.8f, 1};
    for (int source = 0; source < SOURCES; ++source)
        for (int n = 0; n < 3 * 2 * 2; ++n) {
            const int back = n % 2, lights = source == BY_BOTH ? 2 : 1;
            const double t = depths[n / 4], slab = slabs[n / 2 % 2];
            const double exact = lights * exact_layer((double)lobe.asymmetry, t, back);
            sps_stats_report stats;
            check_scene s;
            if (!check_long() && n / 4 == 1) continue; /* the depth between the others */
            start_layer(&s, t, &lobe, back ? -1 : 1);
            shade_layer(&s, source, back ? -1 : 1);
            s.view.slab_thickness = slab;
            check_render(context, &s, image_a);
            sps_get_stats(context, &stats);
            CHECK((stats.soft_texels > 0) == (source == BY_SAMPLES || source == BY_DISC));
            if (figures())
                printf("%s, layer of %g, %s, slabs of %g: %.6f, exact %.6f\n", sources[source], t,
                       back ? "back" : "through", slab, (double)image_a[0], exact);
            if (!CHECK_NEAR((double)image_a[0], exact, (slab > 2 ? 0.06 : 0.03) * exact + 1e-9))
                printf("    by %s, layer of %g, %s, slabs of %g\n", sources[source], t, back ? "back" : "through",
                       slab);
        }
}

/* --- against the reference --- */

static const sps_transfer_point points[] = {{0, {0.9f, 0.9f, 0.5f}, 0, {0, 0, 0}},
                                            {1, {0.9f, 0.6f, 0.3f}, 6, {0, 0, 0}}};
static const sps_transfer tissue = {points, 2, NULL, NULL, 0};
static const sps_lobe lobes[] = {{0.7f, 3}, {-0.2f, 1}};

static void add_gas(check_scene *s) {
    sps_volume *volume = check_add_puff(s, PUFF_EXTINCTION);
    volume->lobes = lobes, volume->lobe_count = 2;
    check_color(volume->albedo, 1, 0.8, 0.5);
}

static void add_particles(check_scene *s) {
    sps_particles *set = check_add_swarm(s, 0.8);
    set->soft = 1;
    set->lobes = lobes, set->lobe_count = 1;
    check_color(set->albedo, 0.8, 0.9, 1);
}

static void add_polygons(check_scene *s) {
    const double origin[3] = {-2, -1.1, -2}, u[3] = {4, 0, 0}, v[3] = {0, 0, 4};
    const double high[3] = {-1, 0.2, -1.2}, wide[3] = {1.1, 0, 0}, deep[3] = {0, 0.1, 2.4};
    ground.count = pane.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(s, &ground, 0.5);
    check_add_quad(&pane, high, wide, deep);
    check_translucent(check_add_mesh(s, &pane, 0.2), 0.5);
}

enum { GAS, CLASSIFIED, SURFACE, SWARM, AMID_POLYGONS, KINDS };
static const char *const kinds[] = {"gas", "classified", "surface", "particles", "amid polygons"};
enum { SUN, WIDE_SUN, LAMP, LAMP_WITHIN, LIGHTS };
static const char *const lights[] = {"sun", "wide sun", "lamp", "lamp within"};

static void start(check_scene *s, int kind, int light) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 1.5, 1, 5);
    check_perspective(&s->view.camera, 0.3); /* pixels smaller than voxels */
    if (kind == SWARM)
        add_particles(s);
    else
        add_gas(s);
    if (kind == CLASSIFIED || kind == SURFACE) s->volume[0].transfer = &tissue;
    if (kind == SURFACE) s->volume[0].shading = SPS_SHADING_SURFACE, s->volume[0].gradient_full = 0.3f;
    if (kind == AMID_POLYGONS) add_polygons(s);
    if (light == SUN || light == WIDE_SUN) check_add_directional(s, 0.5, -0.8, 0.4, 2);
    if (light == WIDE_SUN) s->light[0].angular_diameter = 0.1;
    if (light == LAMP) check_add_point(s, -2, 3, -2, 20);
    if (light == LAMP_WITHIN) check_add_point(s, 0.1, 0.15, -0.2, 1);
    s->view.quality = SPS_QUALITY_HIGH;
    s->view.scattering = SPS_SCATTERING_FORWARD;
}

/* What 1 % of the brightest value, test_series' limit of what tables leave between nodes, makes of such an error. It
   counts where one pixel sees a lamp amid surfaces, 144 times as bright as the mean. */
static double error_at_peak(const float *image) {
    double most = 0;
    for (int i = 0; i < COUNT; ++i)
        if (i % 4 < 3) most = fmax(most, (double)image[i]);
    return 0.01 * most / (sqrt(3.0) * SIDE * mean_of(image, SIDE * SIDE));
}

/* The reference marches with the series itself. Errors may be those of light that scatters once, and what tables leave,
   0.5 % of many pixels and 1 % of one. Returns that of light that scatters forward. */
static double compare_with_reference(int kind, int light, double extinction) {
    const double step = extinction > PUFF_EXTINCTION ? 0.4 : 0.5;
    double once, again, more;
    check_scene s;
    start(&s, kind, light);
    s.volume[0].extinction = (float)extinction;
    s.view.scattering = SPS_SCATTERING_SINGLE;
    check_render(context, &s, image_a);
    check_march(context, &s, step, image_b, NULL);
    once = error_of(image_a, image_b, SIDE * SIDE);
    more = mean_of(image_b, SIDE * SIDE);
    s.view.scattering = SPS_SCATTERING_FORWARD;
    check_render(context, &s, image_a);
    check_march(context, &s, step, image_b, NULL);
    again = error_of(image_a, image_b, SIDE * SIDE);
    more = mean_of(image_b, SIDE * SIDE) / more;
    if (figures())
        printf("%s, %s: %.2f times as bright, error %.4f, scattered once %.4f\n", kinds[kind], lights[light], more,
               again, once);
    CHECK(more > 1.05);
    if (!CHECK(again < once + 0.005 + error_at_peak(image_b)))
        printf("    %s, %s: %.4f, %.4f\n", kinds[kind], lights[light], again, once);
    return again;
}

static void test_reference(void) {
    for (int kind = 0; kind < KINDS; ++kind)
        for (int light = 0; light < LIGHTS; ++light)
            if (check_long() || ((kind + light) % 3 == 0 && light != WIDE_SUN))
                compare_with_reference(kind, light, PUFF_EXTINCTION);
    check_free_triangles(&ground);
    check_free_triangles(&pane);
}

/* A puff that is 48 deep, so that light ends in it. Of a lamp's light within it, next to nothing comes out that has
   scattered once only; the error may be that of the sun's. */
static void test_dense_reference(void) {
    compare_with_reference(GAS, SUN, 30);
    CHECK(compare_with_reference(GAS, LAMP_WITHIN, 30) < 0.036);
}

/* Whatever gas is shaded by, it shows the same. */
static void test_shadows(void) {
    static const sps_tmap_settings deep = {.technique = SPS_TMAP_COMPRESSED, .epsilon = 0.002f};
    check_scene s;
    start(&s, GAS, SUN);
    check_force_sheets(&s);
    check_render(context, &s, image_b);
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    check_render(context, &s, image_a);
    CHECK(error_of(image_a, image_b, SIDE * SIDE) < 0.01);
    s.light[0].shadow_source = SPS_SHADOW_AUTO;
    s.light[0].shadow_map = &deep;
    check_render(context, &s, image_a);
    CHECK(error_of(image_a, image_b, SIDE * SIDE) < 0.01);
}

/* --- against random paths --- */

static float cloud[CLOUD * CLOUD * CLOUD];
static check_array array = {cloud, {CLOUD, CLOUD, CLOUD}, 0, 0};

/* Relative to random paths' mean, with their own variance taken off. */
static double error_of_paths(const float *image) {
    double square = 0;
    for (int i = 0; i < SIDE * SIDE; ++i) {
        square += pow((double)image[4 * i] - (double)image_b[4 * i], 2) - pow((double)errors[3 * i], 2);
    }
    return sqrt(fmax(square, 0) / (SIDE * SIDE)) / mean_of(image_b, SIDE * SIDE);
}

/* A cloud of albedo 1 from behind, aside and in front: not exact, but far closer than light that scatters once. */
static void test_cloud(void) {
    static const double directions[3][3] = {{0.3, 0.1, 1}, {1, 0.2, 0}, {0.3, -0.4, -1}};
    static const sps_lobe around = {0.3f, 1};
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, settings.samples = check_long() ? 200 : 50, settings.seed = 1, settings.error = errors;
    image.rgba = image_b;
    check_lumps(cloud, CLOUD);
    for (int i = 0; i < 3; ++i) {
        double once, again, mean;
        check_scene s;
        sps_volume *volume;
        check_clear(&s, SIDE, SIDE);
        s.view.camera.ortho_height = 1.4;
        volume = check_add_volume(&s, CLOUD, CLOUD, CLOUD, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = check_read_array, volume->user = &array;
        volume->extinction = 8;
        volume->lobes = &around, volume->lobe_count = 1;
        check_color(volume->albedo, 1, 1, 1);
        check_add_directional(&s, directions[i][0], directions[i][1], directions[i][2], 1);
        s.view.quality = SPS_QUALITY_HIGH;
        if (!CHECK_OK(context, sps_reference(context, &s.scene, &s.view, &settings, &image))) return;
        check_render(context, &s, image_a);
        s.view.scattering = SPS_SCATTERING_FORWARD;
        check_render(context, &s, image_c);
        once = error_of_paths(image_a), again = error_of_paths(image_c);
        mean = mean_of(image_c, SIDE * SIDE) / mean_of(image_b, SIDE * SIDE);
        if (figures())
            printf("cloud, light %d: once %.3f, forward %.3f of the mean; mean %.3f and %.3f of random paths\n", i,
                   once, again, mean_of(image_a, SIDE * SIDE) / mean_of(image_b, SIDE * SIDE), mean);
        CHECK(again < 0.55 * once);
        CHECK(mean > 0.7 && mean < 1.15);
    }
}

/* --- where nothing changes, and what never fails --- */

static int same(const float *a, const float *b) { return memcmp(a, b, sizeof image_a) == 0; }

static int forward_runs(const check_scene *s) {
    sps_plan_report report;
    if (!CHECK_OK(context, sps_plan(context, &s->scene, &s->view, &report))) return -1;
    return report.pass[SPS_PASS_FORWARD].runs;
}

/* Albedo 0, lights without shadows, and no light call for nothing. */
static void test_left_out(void) {
    for (int kind = 0; kind < 3; ++kind) {
        check_scene s;
        start(&s, GAS, SUN);
        CHECK(forward_runs(&s) == 1);
        if (kind == 0) check_color(s.volume[0].albedo, 0, 0, 0);
        if (kind == 1) s.light[0].no_shadow = 1;
        if (kind == 2) s.scene.light_count = 0;
        CHECK(forward_runs(&s) == 0);
        check_render(context, &s, image_a);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        CHECK(forward_runs(&s) == 0);
        check_render(context, &s, image_b);
        CHECK_CASE("Scattering", "albedo 0, lights without shadow or no light, forward scattering",
                   "that of scattering off", !same(image_a, image_b), 0, "same bits");
    }
}

/* Light from behind, by sheets, takes another pass over them; from the front, or by a table, it does not. */
static void test_passes(void) {
    for (int kind = 0; kind < 3; ++kind) {
        sps_plan_report report, once;
        sps_stats_report stats;
        double slabs, bytes;
        check_scene s;
        start(&s, GAS, SUN);
        if (kind == 1) check_set3(s.light[0].direction, -0.5, -0.8, -2);
        if (kind == 2)
            s.light[0].shadow_source = SPS_SHADOW_TABLE;
        else
            check_force_sheets(&s);
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report))) return;
        CHECK(report.pass[SPS_PASS_EYE_SHEETS].runs == (kind == 0 ? 2 : 1));
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        slabs = (double)stats.slabs;
        s.view.scattering = SPS_SCATTERING_SINGLE;
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &once))) return;
        bytes = (double)report.pass[SPS_PASS_EYE_SHEETS].bytes - (double)once.pass[SPS_PASS_EYE_SHEETS].bytes;
        CHECK_NEAR(bytes, kind == 0 ? 4 * (2 + 3) * 64 * 64 : 0, 0); /* one tile */
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        CHECK_NEAR(slabs / (double)stats.slabs, kind == 0 ? 2 : 1, 0.01);
    }
}

/* Thin gas scatters nothing twice: X is at most depth / 2 times the largest of what scatters once. */
static void test_thin(void) {
    for (int light = SUN; light <= WIDE_SUN; ++light) {
        check_scene s;
        start(&s, GAS, light);
        s.volume[0].extinction = 1e-4f, s.volume[0].lobe_count = 0;
        check_render(context, &s, image_a);
        s.view.scattering = SPS_SCATTERING_SINGLE;
        check_render(context, &s, image_b);
        CHECK(check_largest(image_a, image_b, COUNT) < 2e-4 * mean_of(image_b, SIDE * SIDE) * 10);
        CHECK(!same(image_a, image_b));
    }
}

/* A table that is held from a call in which light scatters once ends too early for the next. */
static void test_held(void) {
    sps_context *other = check_context(NULL);
    check_scene s;
    start(&s, GAS, SUN);
    s.volume[0].extinction = 30, s.volume[0].revision = 1;
    s.light[0].shadow_source = SPS_SHADOW_TABLE;
    check_render(other, &s, image_b);
    for (int i = 0; i < 3; ++i) {
        sps_stats_report stats;
        s.view.scattering = i == 0 ? SPS_SCATTERING_SINGLE : SPS_SCATTERING_FORWARD;
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        CHECK(stats.tables_held == (i == 2));
    }
    CHECK(same(image_a, image_b));
    sps_destroy(other);
}

static void test_two_lights(void) {
    check_scene s;
    start(&s, GAS, SUN);
    check_add_point(&s, -2, 3, -2, 20);
    check_render(context, &s, image_c);
    s.scene.light_count = 1;
    check_render(context, &s, image_a);
    s.light[0] = s.light[1];
    check_render(context, &s, image_b);
    for (int i = 0; i < COUNT; ++i)
        if (i % 4 < 3) image_a[i] += image_b[i];
    memcpy(image_b, image_c, sizeof image_b);
    CHECK(error_of(image_a, image_b, SIDE * SIDE) < 0.01); /* slabs and shadow buffers differ */
}

/* A gas of colored albedo shows in each channel what a grey gas of that albedo shows. */
static void test_colors(void) {
    for (int c = 0; c < 3; ++c) {
        double largest = 0;
        check_scene s;
        start(&s, GAS, SUN);
        check_render(context, &s, image_a);
        check_color(s.volume[0].albedo, s.volume[0].albedo[c], s.volume[0].albedo[c], s.volume[0].albedo[c]);
        check_render(context, &s, image_b);
        for (int i = c; i < COUNT; i += 4) largest = fmax(largest, fabs((double)(image_a[i] - image_b[i])));
        if (!CHECK(largest <= 1e-5 * mean_of(image_b, SIDE * SIDE)))
            printf("    color %d: %g of %g\n", c, largest, mean_of(image_b, SIDE * SIDE));
    }
}

/* Peaks, backward peaks and several lobes, thin to dense: finite, and not negative. */
static void test_finite(void) {
    static const sps_lobe all[][2] = {{{0.99f, 1}, {0, 0}}, {{-0.99f, 1}, {0, 0}}, {{0.95f, 5}, {-0.9f, 1}}};
    static const float extinctions[] = {1e-6f, 3, 1e3f, 1e12f};
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 4; ++k) {
            int bad = 0;
            check_scene s;
            start(&s, i == 1 ? CLASSIFIED : GAS, k % 2 ? LAMP : SUN);
            s.view.quality = SPS_QUALITY_DRAFT;
            s.volume[0].lobes = all[i], s.volume[0].lobe_count = i == 2 ? 2 : 1;
            s.volume[0].extinction = extinctions[k];
            check_color(s.volume[0].albedo, 1, 1, 0.999);
            check_render(context, &s, image_a);
            for (int n = 0; n < COUNT; ++n) bad += !(image_a[n] >= 0 && image_a[n] <= FLT_MAX);
            CHECK(bad == 0);
        }
}

static void test_refused(void) {
    static const int wrong[] = {-1, SPS_SCATTERING_MULTIPLE + 1};
    check_scene s;
    for (int i = 0; i < 2; ++i) {
        start(&s, GAS, SUN);
        memcpy(&s.view.scattering, &wrong[i], sizeof wrong[i]);
        check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "view.scattering is");
    }
}

/* --- ambient light in place of it --- */

/* An even layer across the view, and particles in front of it if `mixed`. */
static void start_ambient(check_scene *s, int mixed) {
    check_clear(s, SIDE, SIDE);
    check_add_volume(s, 16, 16, 16, check_box(-2, -2, -1, 2, 2, 1));
    s->volume[0].read_fn = check_read_constant;
    s->volume[0].user = (void *)(size_t)&one;
    s->volume[0].extinction = 1;
    check_color(s->volume[0].albedo, 0.9, 0.6, 0.3);
    s->view.scattering = SPS_SCATTERING_AMBIENT;
    if (mixed) check_color(check_add_swarm(s, 1)->albedo, 0.5, 0.5, 0.5);
}

/* A layer of optical depth t and albedo w shows w A (1 - exp(-t)) of its own ambient light A, beside the scene's. The
   same gas without it in the scene's has the same picture; other grades, and random paths, do not see it. */
static void test_ambient(void) {
    check_scene s;
    start_ambient(&s, 0);
    check_color(s.volume[0].ambient, 0.5, 1, 2);
    check_color(s.scene.ambient, 0.25, 0, 0);
    check_render(context, &s, image_a);
    for (int c = 0; c < 3; ++c) { /* the layer fades out at either end, but holds as much: t is 2 */
        static const double sent[3] = {0.9 * 0.75, 0.6, 0.6};
        CHECK_NEAR((double)image_a[4 * (SIDE * SIDE / 2 + SIDE / 2) + c], sent[c] * (1 - exp(-2)), 2e-3);
    }
    CHECK(check_march(context, &s, 0.25, image_b, NULL));
    CHECK(check_largest(image_a, image_b, COUNT) < 2e-3);
    check_color(s.volume[0].ambient, 0, 0, 0);
    check_color(s.scene.ambient, 0.75, 1, 2);
    check_render(context, &s, image_b);
    CHECK(check_largest(image_a, image_b, COUNT) < 1e-6);
    check_color(s.volume[0].ambient, 5, 5, 5);
    for (int n = 0; n < 3; ++n) {
        s.view.scattering = n == 0   ? SPS_SCATTERING_SINGLE
                            : n == 1 ? SPS_SCATTERING_FORWARD
                                     : SPS_SCATTERING_CONVOLUTION;
        check_render(context, &s, image_a);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    }
}

/* Each gas has its own: gases that are alike but for it are two. */
static void test_ambient_of_each(void) {
    sps_particles *swarm;
    sps_plan_report report;
    check_scene s;
    start_ambient(&s, 1);
    swarm = (sps_particles *)(size_t)s.scene.particles;
    check_color(swarm->ambient, 0, 0, 3);
    check_render(context, &s, image_a);
    check_color(swarm->ambient, 0, 0, 0);
    check_color(s.volume[0].ambient, 2, 0, 0);
    check_render(context, &s, image_b);
    check_color(swarm->ambient, 0, 0, 3);
    check_render(context, &s, image_c);
    for (int i = 0; i < COUNT; ++i)
        if (i % 4 < 3) CHECK_NEAR((double)image_c[i], (double)image_a[i] + (double)image_b[i], 1e-5);
    CHECK(image_a[2] > 0 && image_a[0] < 1e-6f && image_b[0] > 0 && image_b[2] < 1e-6f);
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
    CHECK(report.pass[SPS_PASS_AMBIENT].runs == 1 && report.color_channels == 3);
    CHECK(strstr(report.pass[SPS_PASS_FORWARD].reason, "does not ask") != NULL);
    s.view.scattering = SPS_SCATTERING_SINGLE;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &report));
    CHECK(report.pass[SPS_PASS_AMBIENT].runs == 0);
    swarm->ambient[1] = -1;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "ambient");
    swarm->ambient[1] = 0, s.volume[0].ambient[2] = NAN;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "ambient");
}

/* An allocation that fails at any point of a call that measures gas first, with a map beside the sheets: nothing leaks,
   and a call after it leaves the context with as much memory as one without a failure before it. */
static void test_failures(void) {
    sps_tmap_settings settings;
    check_hooks hooks;
    sps_result result;
    size_t left[2] = {0, 0}; /* bytes, after a failed call and another; the least and the most */
    long n = 0;
    memset(&settings, 0, sizeof settings), memset(&hooks, 0, sizeof hooks);
    settings.technique = SPS_TMAP_COMPRESSED;
    do {
        sps_context *by = check_context(&hooks);
        sps_image image;
        check_scene s;
        start_ambient(&s, 0);
        s.view.width = s.view.height = 8;
        s.view.scattering = SPS_SCATTERING_FORWARD;
        check_add_directional(&s, 0.2, 0.1, 1, 1); /* from behind: by sheets, after a first pass */
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        check_add_directional(&s, 1, -1, 0, 1);
        s.light[1].shadow_map = &settings, s.light[1].shadow_map_resolution = 16;
        memset(&image, 0, sizeof image);
        image.rgba = image_a;
        hooks.fail_at = hooks.allocations + ++n;
        result = sps_render(by, &s.scene, &s.view, &image);
        hooks.fail_at = 0;
        CHECK(result == SPS_OK || result == SPS_ERROR_MEMORY);
        CHECK_OK(by, sps_render(by, &s.scene, &s.view, &image));
        left[0] = n == 1 || hooks.live < left[0] ? hooks.live : left[0];
        left[1] = hooks.live > left[1] ? hooks.live : left[1];
        sps_destroy(by);
        CHECK(hooks.live == 0);
    } while (result != SPS_OK && n < 1000);
    CHECK(n > 20 && left[0] == left[1]);
}

int main(void) {
    context = check_context(NULL);
    RUN(test_series);
    RUN(test_end);
    RUN(test_lobes);
    RUN(test_levels);
    RUN(test_means);
    RUN(test_layers);
    RUN(test_dense);
    RUN(test_reference);
    RUN(test_dense_reference);
    RUN(test_shadows);
    RUN_LONG(test_cloud);
    RUN(test_left_out);
    RUN(test_passes);
    RUN(test_thin);
    RUN(test_held);
    RUN(test_two_lights);
    RUN(test_colors);
    RUN(test_finite);
    RUN(test_refused);
    RUN(test_ambient);
    RUN(test_ambient_of_each);
    RUN(test_failures);
    sps_destroy(context);
    return check_report();
}
