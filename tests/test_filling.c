/* Sheets that are filled from the pixels' side: samples of a field against its sum over all voxels, and pictures of all
   kinds of volumes against those that are splatted and against sps_reference; what is splatted nevertheless, what is
   held, counts, bytes, workers. */

#include "check.h"

enum { SIDE = 20, COUNT = 4 * SIDE * SIDE, GRID = 16 };
static float image_a[COUNT], image_b[COUNT], image_c[COUNT];
static sps_context *context;
static check_triangles faces;
static float noise[GRID * GRID * GRID], lumps[GRID * GRID * GRID], dot[GRID * GRID * GRID], ball[GRID * GRID * GRID];

/* Number of samples of the last picture. */
static double samples_of(sps_context *of) {
    sps_stats_report stats;
    sps_get_stats(of, &stats);
    return (double)(stats.eye_samples + stats.light_samples);
}

/* Those of the eye's rays. */
static double eye_samples_of(sps_context *of) {
    sps_stats_report stats;
    sps_get_stats(of, &stats);
    return (double)stats.eye_samples;
}

/* --- a field alone --- */

/* The field that voxels stand for, at a place counted in voxels from the first one's centre. */
static double sum_of_kernels(const float *values, const double at[3]) {
    const double peak = pow(SPSI_SIGMA * sqrt(2 * PI), -3);
    double sum = 0;
    for (int n = 0; n < GRID * GRID * GRID; ++n) {
        const double x = n % GRID - at[0], y = n / GRID % GRID - at[1], z = n / (GRID * GRID) - at[2];
        const double square = x * x + y * y + z * z;
        if (square < 25) sum += (double)values[n] * exp(-0.5 * square / (SPSI_SIGMA * SPSI_SIGMA));
    }
    return peak * sum;
}

/* The sample of a field at such a place, in a vector whose other lanes are left out. */
static double sample_at(const spsi_pyramid *fields, const spsi_pyramid_level *field, const double at[3]) {
    float values[SPSI_LANES];
    uint64_t count = 0;
    spsi_sampler tapper;
    spsi_v place[3];
    memset(&tapper, 0, sizeof tapper);
    tapper.fields = fields;
    tapper.field = field;
    tapper.cells = (const uint32_t(*)[2])field->cells[0];
    for (int k = 0; k < 3; ++k) place[k] = spsi_set((float)(at[k] - SPSI_BRICK * field->low[k]));
    spsi_store(values, spsi_sampler_values(&tapper, place, 1, &count));
    return (double)values[0];
}

static int read_some(void *user, const int lo[3], const int size[3], float *out) {
    check_array array = {(const float *)user, {GRID, GRID, GRID}, 0, 0};
    return check_read_array(&array, lo, size, out);
}

static void start(check_scene *s, float *values) {
    check_clear(s, SIDE, SIDE);
    check_set3(s->view.camera.position, 1.2, 0.9, 4);
    check_orthographic(&s->view.camera, 2.2);
    s->view.filling = SPS_FILLING_GATHER;
    check_add_volume(s, GRID, GRID, GRID, check_box(-1, -1, -1, 1, 1, 1));
    s->volume[0].read_fn = read_some;
    s->volume[0].user = values;
    s->volume[0].extinction = 2;
    check_color(s->volume[0].albedo, 0.9, 0.8, 0.7);
    faces.count = 0;
}

/* Weights of all voxels differ from the kernel by at most what is cut, and what sharing that out changes: per axis the
   largest sum of weights beyond 4 taps is 0.0054 (6: 1.4e-5) and the same again shared out, while random values from 0
   to 1 lie about 1/2: three axes. A lattice of kernels is even to 5e-4 along each axis. Places are rounded to half of
   1/1024 of a voxel; the field changes by 0.7 per voxel and axis at most. */
static void test_samples(void) {
    for (int quality = SPS_QUALITY_MEDIUM; quality <= SPS_QUALITY_HIGH; ++quality) {
        const double cut = quality == SPS_QUALITY_MEDIUM ? 0.0054 : 1.4e-5;
        const double allowed = 3 * (2 * cut + 5e-4 + 0.7 / 2048);
        check_random random = {4};
        check_scene s;
        const spsi_pyramid *fields;
        double worst = 0;
        start(&s, noise);
        s.view.quality = (sps_quality)quality;
        if (!check_render(context, &s, image_a)) return;
        fields = (const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data;
        CHECK(fields->taps == (quality == SPS_QUALITY_MEDIUM ? 4 : 6));
        for (int i = 0; i < 4000; ++i) {
            const spsi_pyramid_level *field = fields->levels[0];
            double at[3];
            for (int k = 0; k < 3; ++k) at[k] = -4 + (GRID + 7) * check_next(&random);
            worst = fmax(worst, fabs(sample_at(fields, field, at) - sum_of_kernels(noise, at)));
        }
        if (!CHECK(worst <= allowed)) printf("    quality %d: %g, allowed %g\n", quality, worst, allowed);
        if (figures()) printf("%d taps: off by up to %.5f\n", fields->taps, worst);
    }
}

/* The gradient of that field per voxel. */
static void gradient_of_kernels(const float *values, const double at[3], double gradient[3]) {
    const double square_sigma = SPSI_SIGMA * SPSI_SIGMA, peak = pow(SPSI_SIGMA * sqrt(2 * PI), -3);
    memset(gradient, 0, 3 * sizeof *gradient);
    for (int n = 0; n < GRID * GRID * GRID; ++n) {
        const double off[3] = {n % GRID - at[0], n / GRID % GRID - at[1], n / (GRID * GRID) - at[2]};
        const double square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
        const double weight = square < 25 ? peak * exp(-0.5 * square / square_sigma) : 0;
        for (int k = 0; k < 3; ++k) gradient[k] += off[k] / square_sigma * weight * (double)values[n];
    }
}

/* A field's gradient at such a place, from that in the world of sheared voxels. */
static void gradient_at(const spsi_pyramid *fields, const double at[3], double gradient[3]) {
    static const float rows[3][3] = {{8, 0, 0}, {-2.8f, 8, -2}, {0, 0, 8}};
    float world[3][SPSI_LANES];
    spsi_sampler tapper;
    spsi_v place[3], slope[3];
    memset(&tapper, 0, sizeof tapper);
    tapper.fields = fields;
    tapper.field = fields->levels[0];
    memcpy(tapper.rows, rows, sizeof rows);
    for (int k = 0; k < 3; ++k) place[k] = spsi_set((float)(at[k] - SPSI_BRICK * tapper.field->low[k]));
    spsi_sampler_gradient(&tapper, place, 1, slope);
    for (int i = 0; i < 3; ++i) spsi_store(world[i], slope[i]);
    gradient[1] = (double)world[1][0] / 8;
    gradient[0] = ((double)world[0][0] + 2.8 * gradient[1]) / 8;
    gradient[2] = ((double)world[2][0] + 2 * gradient[1]) / 8;
}

/* Gradients differ from those of kernels by what test_samples says, with the derivative's weights along one axis: those
   beyond 4 taps add up to 0.0257 (6: 1.1e-4), and the same again is shared out; of values about 1/2, half of that. A
   lattice of kernels changes by 2 pi 5e-4 of them, which is shared out likewise. Along the two other axes, weights are
   as far off as there, of changes of 1/2 the derivative's 1.23 at most. Places are rounded to half of 1/1024 of a
   voxel; gradients change by 1.3 per voxel along their own axis, and by 1.23^2 / 2 along the others. */
static void test_gradients(void) {
    for (int quality = SPS_QUALITY_MEDIUM; quality <= SPS_QUALITY_HIGH; ++quality) {
        const double cut = quality == SPS_QUALITY_MEDIUM ? 0.0054 : 1.4e-5;
        const double own = (quality == SPS_QUALITY_MEDIUM ? 0.0257 : 1.1e-4) + 2 * PI * 5e-4;
        const double allowed = own + 2 * (2 * cut + 5e-4) * 1.23 / 2 + (1.3 + 1.23 * 1.23) / 2048;
        check_random random = {6};
        check_scene s;
        double worst = 0;
        start(&s, noise);
        s.view.quality = (sps_quality)quality;
        if (!check_render(context, &s, image_a)) return;
        for (int i = 0; i < 2000; ++i) {
            double at[3], gradient[3], exact[3];
            for (int k = 0; k < 3; ++k) at[k] = -4 + (GRID + 7) * check_next(&random);
            gradient_at((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data, at, gradient);
            gradient_of_kernels(noise, at, exact);
            for (int k = 0; k < 3; ++k) worst = fmax(worst, fabs(gradient[k] - exact[k]));
        }
        if (!CHECK(worst <= allowed)) printf("    quality %d: %g, allowed %g\n", quality, worst, allowed);
        if (figures()) printf("gradients at quality %d: off by up to %.5f\n", quality, worst);
    }
}

/* The mean depth at which parts of a slab are seen, by closed form, from either side: the light's order is the eye's or
   runs against it. Floats add up to 1e-6 of it. */
static void test_seen(void) {
    static const float depths[SPSI_SUBSLABS] = {0.4f, 2, 0, 1.5f};
    for (int backwards = 0; backwards < 2; ++backwards) {
        double left = 1, seen = 0, sum = 0;
        float found[SPSI_LANES];
        spsi_sample samples[SPSI_SUBSLABS];
        spsi_sweep sweep;
        spsi_shader shader;
        spsi_slab slab;
        spsi_v depth;
        memset(samples, 0, sizeof samples), memset(&sweep, 0, sizeof sweep);
        memset(&shader, 0, sizeof shader), memset(&slab, 0, sizeof slab);
        sweep.back_to_front = backwards;
        shader.sweep = &sweep;
        slab.samples = samples;
        slab.part_count = SPSI_SUBSLABS, slab.material_count = 1, slab.open = 1;
        slab.enter = spsi_set(3), slab.leave = spsi_set(5);
        for (int i = 0; i < SPSI_SUBSLABS; ++i) {
            const double own = (double)depths[i], weight = left * -expm1(-own);
            samples[backwards ? SPSI_SUBSLABS - 1 - i : i].depth = spsi_set(depths[i]);
            left -= weight;
            seen += weight;
            sum += weight * (3 + 2 * (i + 0.5) / SPSI_SUBSLABS);
        }
        CHECK(spsi_slab_seen(&shader, &slab, 0, &depth) == 1);
        spsi_store(found, depth);
        CHECK_NEAR((double)found[0], sum / seen, 5e-6);
    }
}

/* --- pictures --- */

static const sps_transfer_point colors[4] = {{0.1f, {1, 1, 1}, 0, {0, 0, 0}},
                                             {0.3f, {1, 0.4f, 0.2f}, 3, {0, 0, 0}},
                                             {0.6f, {0.3f, 0.5f, 1}, 8, {0, 0, 0}},
                                             {1, {1, 1, 1}, 12, {0, 0, 0}}};
static sps_tmap_settings deep;
static const sps_transfer looks = {colors, 4, NULL, NULL, 0};
/* Nothing below 0.6. */
static const sps_transfer_point high_colors[3] = {
    {0.6f, {1, 0.5f, 0.5f}, 0, {0, 0, 0}}, {0.601f, {1, 0.5f, 0.5f}, 20, {0, 0, 0}}, {1, {1, 1, 1}, 30, {0, 0, 0}}};
static const sps_transfer high_looks = {high_colors, 3, NULL, NULL, 0};
static const sps_transfer_point even_colors[2] = {{0, {0.8f, 0.8f, 0.8f}, 10, {0, 0, 0}},
                                                  {2, {0.8f, 0.8f, 0.8f}, 10, {0, 0, 0}}};
static const sps_transfer even_looks = {even_colors, 2, NULL, NULL, 0};
static sps_particles *swarm;

enum {
    GAS,
    PERSPECTIVE,
    BEHIND,
    CLASSIFIED,
    SURFACE,
    SURFACE_BEHIND,
    SHEARED_SURFACE,
    SHEARED,
    FLOOR,
    FLOOR_BEHIND,
    NEAR_PLANE,
    MIXED,
    LAMP,
    THICK,
    LONG_VOXELS,
    SOFT,
    PANE,
    CUT_CLASSIFIED,
    DOT,
    TABLE,
    DEEP_MAP,
    KINDS
};

/* How far the gathered picture, image_a, and the splatted one, image_b, are off a marched one, and from each other,
   relative to its mean; with the splatted one in place of the marched one if that is left out: neither way can be
   nearer to it by more than they are apart. Returns 0 if marching fails. */
static int compare_ways(const check_scene *s, int marches, double *gathered, double *splatted, double *apart) {
    double mean = 0;
    if (marches) {
        if (!check_march(context, s, 0.75, image_c, NULL)) return 0;
    } else
        memcpy(image_c, image_b, sizeof image_c);
    for (int i = 0; i < COUNT; ++i) mean += (double)image_c[i] / COUNT;
    *gathered = check_rms(image_a, image_c, COUNT) / mean;
    *splatted = check_rms(image_b, image_c, COUNT) / mean;
    *apart = check_rms(image_a, image_b, COUNT) / mean;
    return 1;
}

static int is_surface(int kind) { return kind == SURFACE || kind == SURFACE_BEHIND || kind == SHEARED_SURFACE; }

static void start_kind(check_scene *s, int kind) {
    static const double corner[3] = {-3, -0.6, -3}, u[3] = {0, 0.8, 6}, v[3] = {6, 0, 0};
    const int classified = kind == CLASSIFIED || is_surface(kind) || kind == CUT_CLASSIFIED;
    start(s, classified ? lumps : kind == DOT ? dot : noise);
    if (kind == PERSPECTIVE || kind == NEAR_PLANE) {
        check_set3(s->view.camera.position, 3.6, 2.7, 12);
        check_perspective(&s->view.camera, 0.16);
    }
    if (kind == FLOOR || kind == FLOOR_BEHIND || kind == NEAR_PLANE || kind == DOT || kind == CUT_CLASSIFIED)
        s->view.quality = SPS_QUALITY_HIGH;
    if (kind == BEHIND || kind == FLOOR_BEHIND || kind == SURFACE_BEHIND)
        check_add_directional(s, -0.5, -0.4, 1, 3);
    else if (kind == LAMP)
        check_add_point(s, 2.5, 3, 1.5, 30);
    else
        check_add_directional(s, 1, -1, -0.6, 3);
    s->light[0].shadow_source = kind == TABLE      ? SPS_SHADOW_TABLE
                                : kind == DEEP_MAP ? SPS_SHADOW_AUTO
                                                   : SPS_SHADOW_SHEETS;
    if (kind == DEEP_MAP) s->light[0].shadow_map = &deep;
    if (kind == SOFT) s->light[0].angular_diameter = 0.2;
    if (classified) s->volume[0].transfer = &looks;
    if (kind == DOT) s->volume[0].extinction = 100;
    if (is_surface(kind)) s->volume[0].shading = SPS_SHADING_SURFACE;
    if (kind == SHEARED_SURFACE) s->volume[0].gradient_full = 1; /* not all of it is a surface */
    if (kind == SHEARED || kind == SHEARED_SURFACE) check_set3(s->volume[0].placement.axis[1], 0.7, 2, 0.5);
    if (kind == NEAR_PLANE) s->view.near_distance = 12.7;
    if (kind == LONG_VOXELS) s->volume[0].placement = check_box(-0.4, -1, -1.2, 0.4, 1, 1.2);
    if (kind == LONG_VOXELS) check_orthographic(&s->view.camera, 1);
    if (kind == DOT) s->view.slab_thickness = 0.2; /* its kernel lies in two chunks of slabs */
    if (kind == THICK || kind == FLOOR || kind == FLOOR_BEHIND || kind == NEAR_PLANE) s->view.slab_thickness = 3;
    if (kind == FLOOR || kind == FLOOR_BEHIND || kind == PANE || kind == CUT_CLASSIFIED) {
        check_add_quad(&faces, corner, u, v);
        check_add_mesh(s, &faces, 0.6);
        if (kind == PANE) check_color(s->mesh[0].transmittance, 0.5, 0.7, 0.2);
    }
    if (kind != MIXED) return;
    swarm = check_add_swarm(s, 0.4);
    check_color(swarm->albedo, 0.8, 0.9, 1);
    s->volume[1] = s->volume[0];
    s->volume[1].placement = check_box(-0.2, -1, -0.5, 1.2, 0.6, 1);
    s->volume[1].user = lumps;
    s->volume[1].transfer = &looks;
    s->scene.volume_count = 2;
}

/* A wave of voxels is sampled with at most 0.0039 of its amplitude wrong (4 taps; 6: 0.0003), and voxels' values are at
   most twice their mean, so that optical depths differ by 2 * 0.0039 of themselves at most, and radiance by no more.
   Slabs, texels and the reference's steps are the same for both. A lone voxel shows what cut kernels are uneven by,
   0.002 at high quality, to eye and light, and weights that add up to 1, 5e-4 per axis; it covers a twentieth of the
   picture, whose mean it is compared with. Extinction of the transfer function rises 1.5 times as fast as in proportion
   where it ends its steepest piece. That does not say how far apart surfaces are, whose gradient is that of the place
   where a slab is seen, which moves with its optical depths: but neither way is nearer to the reference by more. Where
   a slab is cut, steps of up to 0.8 voxels lack their end's correction, 0.64 / 24 of a slope of 0.7, in gas that is
   worth 8 voxels. */
static void test_pictures_alike(void) {
    for (int kind = 0; kind < KINDS; ++kind) {
        check_scene s;
        double gathered, splatted, apart, wave;
        sps_stats_report stats;
        start_kind(&s, kind);
        if (!check_render(context, &s, image_a)) return;
        sps_get_stats(context, &stats);
        if (!CHECK(stats.eye_samples > 0 && (kind >= LAMP || stats.light_samples > 0)))
            printf("    kind %d is not gathered\n", kind);
        s.view.filling = SPS_FILLING_SPLAT;
        if (!check_render(context, &s, image_b)) return;
        CHECK(samples_of(context) == 0);
        if (check_memory_only()) continue;
        if (!compare_ways(&s, check_long() || is_surface(kind), &gathered, &splatted, &apart)) return;
        if (figures())
            printf("kind %2d: gathered off by %.3f %%, splatted by %.3f %%, %.3f %% apart\n", kind, 100 * gathered,
                   100 * splatted, 100 * apart);
        wave = 2 * (s.view.quality == SPS_QUALITY_HIGH ? 0.0003 : 0.0039) * (s.volume[0].transfer ? 1.5 : 1);
        if (kind == DOT) wave = sqrt(20) * (wave + 2 * 0.002 + 3 * 5e-4);
        if (kind == NEAR_PLANE || kind == FLOOR || kind == FLOOR_BEHIND) wave += 0.64 / 24 * 0.7 / 8;
        if (!CHECK(gathered <= splatted + wave) ||
            !CHECK(is_surface(kind) ? splatted <= gathered + wave : apart <= wave))
            printf("    kind %d: %g, splatted %g, apart %g\n", kind, gathered, splatted, apart);
    }
}

/* --- small pictures --- */

/* A voxel of a field or a level, counted from the volume's first one; 0 where none is held. */
static double voxel_of(const spsi_pyramid *fields, const spsi_pyramid_level *field, const int at[3]) {
    const int border = fields->taps / 2 - 1;
    int brick[3], in[3], number;
    for (int k = 0; k < 3; ++k) {
        brick[k] = (at[k] + 8 * SPSI_BRICK) / SPSI_BRICK - 8;
        in[k] = at[k] - SPSI_BRICK * brick[k] + border;
        if (brick[k] < field->low[k] || brick[k] >= field->low[k] + field->size[k]) return 0;
    }
    number = field->grid[spsi_pyramid_cell(field, brick)];
    if (number < 0) return 0;
    return (double)spsi_pyramid_plane(field, number, in[2])[in[1] * spsi_pyramid_pitch(fields->taps) + in[0]];
}

/* Samples of a level against the sum of its kernels; see test_samples, here times the largest voxel. Its last voxels
   lie near the end of a brick, so that samples in the next one reach them. */
static void check_level(const spsi_pyramid *fields, const spsi_pyramid_level *level, int last) {
    const double allowed = 3 * (2 * (fields->taps == 4 ? 0.0054 : 1.4e-5) + 5e-4 + 0.7 / 2048);
    check_random random = {5};
    for (int n = 0; n < 400; ++n) {
        double at[3], exact = 0, most = 0, sample;
        for (int k = 0; k < 3; ++k) at[k] = last + 1 + 2 * check_next(&random) - 2 * (n % 3 == k);
        sample = sample_at(fields, level, at);
        for (int i = 0; i < 512; ++i) {
            const int of[3] = {(int)floor(at[0]) - 3 + i % 8, (int)floor(at[1]) - 3 + i / 8 % 8,
                               (int)floor(at[2]) - 3 + i / 64};
            double square = 0;
            for (int k = 0; k < 3; ++k) square += (of[k] - at[k]) * (of[k] - at[k]);
            exact += voxel_of(fields, level, of) * exp(-0.5 * square / (SPSI_SIGMA * SPSI_SIGMA));
            most = fmax(most, voxel_of(fields, level, of));
        }
        exact *= pow(SPSI_SIGMA * sqrt(2 * PI), -3);
        if (!CHECK(fabs(sample - exact) <= allowed * most + 1e-7))
            printf("    at %.2f %.2f %.2f: %g, exact %g\n", at[0], at[1], at[2], sample, exact);
    }
}

/* Each level's voxels are those of the finer one, weighted by 1, 3, 3 and 1 of 8 along each axis: to within the floats
   of three such sums. None is lost: their sum is an eighth of the finer one's. */
static void check_levels(sps_quality quality, int taps) {
    static const double weights[4] = {0.125, 0.375, 0.375, 0.125};
    const spsi_pyramid *fields;
    check_scene s;
    start(&s, noise);
    check_orthographic(&s.view.camera, 20);
    s.view.quality = quality;
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 15;
    if (!check_render(context, &s, image_a)) return;
    fields = (const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data;
    if (!CHECK(samples_of(context) > 0 && fields->leveled > 1 && fields->taps == taps)) return;
    for (int n = 0; n + 1 < fields->leveled; ++n) {
        const spsi_pyramid_level *fine = &fields->levels[0][n], *level = fine + 1;
        double sums[2] = {0, 0}, worst = 0;
        for (int at = 0; at < 32 * 32 * 32; ++at) {
            const int coarse[3] = {at % 32 - 8, at / 32 % 32 - 8, at / 1024 - 8};
            double sum = 0, value = voxel_of(fields, level, coarse);
            for (int i = 0; i < 64; ++i) {
                const int of[3] = {2 * coarse[0] + i % 4 - 1, 2 * coarse[1] + i / 4 % 4 - 1,
                                   2 * coarse[2] + i / 16 - 1};
                sum += weights[i % 4] * weights[i / 4 % 4] * weights[i / 16] * voxel_of(fields, fine, of);
            }
            worst = fmax(worst, fabs(sum - value));
            sums[0] += voxel_of(fields, fine, coarse);
            sums[1] += value;
        }
        CHECK(worst <= 1e-6);
        if (n == 0) check_level(fields, level, 7);
        if (!CHECK(fabs(sums[1] - sums[0] / 8) <= 1e-5 * sums[0]))
            printf("    level %d: %g, %g\n", n, sums[0], sums[1]);
    }
}

static void test_levels(void) {
    check_levels(SPS_QUALITY_MEDIUM, 4);
    check_levels(SPS_QUALITY_ULTRA, 6);
}

/* Optical depth of a thin ball with a Gaussian profile, as many pixels see it that voxels are smaller than: its sum is
   that of any picture. Its own variance is w, in square pixels, at which the steepest change with variance is that of
   its peak: 1 / w of it. Splatted voxels have a variance of 0.25 at least. What is gathered has that of a voxel, 0.125
   at least, or, where four rays add 0.0625, 0.031 at least, or on a level 5.78 times 0.0078 to 0.031: 0.16 less at
   most. */
static void check_small_picture(int size, sps_quality quality) {
    const double w = 0.2 * 0.2 * SIDE * SIDE * 4.0 / (0.1 * size * 0.1 * size);
    double sums[2] = {0, 0}, peak = 0;
    sps_plan_report plan;
    check_scene s;
    start(&s, ball);
    check_orthographic(&s.view.camera, 0.1 * size);
    s.view.quality = quality;
    s.volume[0].extinction = 0.01f;
    check_color(s.volume[0].albedo, 0, 0, 0);
    for (int splat = 0; splat < 2; ++splat) {
        float *image = splat ? image_b : image_a;
        s.view.filling = splat ? SPS_FILLING_SPLAT : SPS_FILLING_GATHER;
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        if (!check_render(context, &s, image)) return;
        CHECK((samples_of(context) > 0) == !splat && plan.eye_gathered == !splat);
        for (int i = 0; i < SIDE * SIDE; ++i) {
            image[4 * i + 3] = -log1pf(-image[4 * i + 3]);
            sums[splat] += (double)image[4 * i + 3];
            peak = fmax(peak, (double)image[4 * i + 3]);
        }
    }
    if (!CHECK_CASE("Found in review", "gas of voxels smaller than pixels, gathered",
                    "the same total optical depth, splatted", fabs(sums[1] / sums[0] - 1), 0.01,
                    "the kernel's cut, 0.4 % in either way") ||
        !CHECK(check_largest(image_a, image_b, COUNT) <= 0.16 / w * peak + 0.005 * peak))
        printf("    %d: sums %g and %g, %g of %g apart, w %g\n", size, sums[0], sums[1],
               check_largest(image_a, image_b, COUNT), peak, w);
    if (figures())
        printf("voxels of %.3f pixels: %.3f %% apart\n", SIDE * 2.0 / GRID / (0.1 * size),
               100 * check_largest(image_a, image_b, COUNT) / peak);
}

/* Voxels 10 times as long as wide, the narrow ones smaller than pixels, the long ones not: no coarser level serves, and
   as many rays do as the narrow ones need: n x n in a picture of 4 n. The truth is the mean of 8 x 8 pixels each of a
   larger picture, splatted. Rays have a variance of (1 - 1 / n^2) / 12, pixels one of 1 / 12, and the larger picture's
   filter adds 0.25 / 64. The ball has the variance w along its narrow axis, where half the share by which that changes
   is what its peak changes by; 0.006 is for what is cut of kernels, as above. */
static void check_flat_picture(int size, sps_quality quality) {
    enum { FINE = 8 };
    static float fine[4 * FINE * FINE * SIDE * SIDE];
    const double w = pow(0.02 * SIDE / (0.1 * size), 2);
    const double rays = (1 - 16.0 / (size * size)) / 12;
    const double allowed = 0.5 * (1.0 / 12 + 0.25 / 64 - rays) / (w + rays) + 0.006;
    double peak = 0, worst = 0;
    check_scene s;
    start(&s, ball);
    check_orthographic(&s.view.camera, 0.1 * size);
    check_set3(s.view.camera.position, 3, 0, 4);
    for (int k = 0; k < 3; ++k) s.volume[0].placement.axis[1][k] *= 0.1, s.volume[0].placement.origin[1] *= k ? 1 : 0.1;
    s.view.quality = quality;
    s.volume[0].extinction = 0.01f;
    check_color(s.volume[0].albedo, 0, 0, 0);
    if (!check_render(context, &s, image_a)) return;
    CHECK(samples_of(context) > 0);
    s.view.width = s.view.height = FINE * SIDE;
    s.view.filling = SPS_FILLING_SPLAT;
    if (!check_render(context, &s, fine)) return;
    for (int i = 0; i < SIDE * SIDE; ++i) {
        double mean = 0;
        for (int n = 0; n < FINE * FINE; ++n) {
            const int x = i % SIDE * FINE + n % FINE, y = i / SIDE * FINE + n / FINE;
            mean -= log1p(-(double)fine[4 * (y * FINE * SIDE + x) + 3]) / (FINE * FINE);
        }
        peak = fmax(peak, mean);
        worst = fmax(worst, fabs(mean + log1p(-(double)image_a[4 * i + 3])));
    }
    if (figures())
        printf("flat voxels of %.3f pixels: %.3f %% off, allowed %.3f\n", SIDE * 0.0125 / (0.1 * size),
               100 * worst / peak, 100 * allowed);
    if (!CHECK_CASE("Found in review", "gas of voxels 10 times as long as wide, the narrow side smaller than pixels",
                    "the mean over pixels, per peak", worst / peak, allowed, "the variance of a pixel's rays"))
        printf("    %d: quality %d\n", size, (int)quality);
}

static void test_flat_pictures(void) {
    for (int size = 8; size < 33; size *= 2) {
        check_flat_picture(size, SPS_QUALITY_MEDIUM);
        check_flat_picture(size, SPS_QUALITY_ULTRA);
    }
}

/* Seen from twice the volume's width, its far voxels are half as large as the near ones. Pictures of any size gather:
   grids of rays serve sizes of voxels up to 2.8 times apart, and levels are 2 apart. */
static void test_every_size_gathers(void) {
    for (int size = 4; size < 80; ++size) {
        sps_plan_report plan;
        check_scene s;
        check_clear(&s, size, size);
        check_add_volume(&s, 128, 128, 128, check_box(-1, -1, -1, 1, 1, 1));
        s.volume[0].read_fn = check_read_constant, s.volume[0].user = noise, s.volume[0].extinction = 1;
        check_set3(s.view.camera.position, 0, 1.2, 4);
        check_perspective(&s.view.camera, 0.6);
        CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
        if (!CHECK(plan.eye_gathered == 1)) printf("    %d pixels: %s\n", size, plan.eye_filling);
    }
}

static void test_small_pictures(void) {
    for (int size = 9; size < 100; size *= 2) {
        check_small_picture(size, SPS_QUALITY_MEDIUM);
        check_small_picture(size, SPS_QUALITY_ULTRA);
    }
}

/* Second moments of a picture's opacity about its middle, in pixels: along x, along y, and of x with y. */
static void moments_of(const float *image, double moments[3]) {
    double sum = 0, xx = 0, yy = 0, xy = 0;
    for (int i = 0; i < SIDE * SIDE; ++i) {
        const double x = i % SIDE - (SIDE - 1) / 2.0, y = i / SIDE - (SIDE - 1) / 2.0, a = (double)image[4 * i + 3];
        sum += a, xx += a * x * x, yy += a * y * y, xy += a * x * y;
    }
    moments[0] = xx / sum, moments[1] = yy / sum, moments[2] = xy / sum;
}

/* Rays a quarter of a pixel from its centre widen a picture by 1/16 along either axis, and never along a diagonal: four
   of them, or two that swing from one diagonal to the other. The ball's width is that of its voxels, 1.6, and of the
   kernel, of whose variance 4 taps have 0.945 at a voxel to 0.998 between two. A sum over pixels is that over the plane
   but for exp(-2 pi^2 m), where m is the moment, which changes by twice 4 pi^2 m^2 of that. Voxels of 0.33 pixels have
   7/16 of a level, 1 - log2(4 * 0.65^2 * 0.33^2 / 0.125) = 0.442 in sixteenths: kernels twice as wide, of voxels that
   weights of 1, 3, 3 and 1 widen by 0.75 of a voxel's square. */
static void test_pixel_filter(void) {
    static const double pixels[] = {0.8, 0.5, 0.33}, mixes[] = {0, 0, 7.0 / 16};
    for (int n = 0; n < 3; ++n) {
        const double square = pixels[n] * pixels[n], own = 1.6 * 1.6 * square;
        const double kernel = (SPSI_SIGMA * SPSI_SIGMA * (1 + 3 * mixes[n]) + 0.75 * mixes[n]) * square;
        const double exact = own + kernel + (n ? 1.0 / 16 : 0), rest = exp(-2 * PI * PI * exact);
        const double allowed = 0.055 * kernel + 8 * PI * PI * exact * exact * rest;
        double moments[3];
        check_scene s;
        start(&s, ball);
        check_set3(s.view.camera.position, 0, 0, 4);
        check_orthographic(&s.view.camera, SIDE / pixels[n] * 2 / GRID);
        s.volume[0].extinction = 1e-3f;
        if (!check_render(context, &s, image_a)) return;
        moments_of(image_a, moments);
        if (!CHECK(fabs(moments[0] - exact) <= allowed) || !CHECK(fabs(moments[1] - exact) <= allowed) ||
            !CHECK(fabs(moments[2]) <= 0.001))
            printf("    voxels of %g pixels: %g, %g, %g, exactly %g, 0\n", pixels[n], moments[0], moments[1],
                   moments[2], exact);
    }
}

/* The same ball, classified, as a surface: its values differ as above, by 0.25 / w at most, since its ray adds nothing
   to the variance of a voxel, and the transfer function's extinction rises 1.5 times as fast as in proportion. As a gas
   it is sampled as often. So do a splatted pixel and the reference, which has the value at its centre. */
static void test_small_surfaces(void) {
    for (int size = 4; size < 10; size += 2) {
        const double w = 0.2 * 0.2 * SIDE * SIDE * 4.0 / (size * size), allowed = 1.5 * 0.25 / w;
        double gathered, splatted, apart, samples;
        check_scene s;
        start(&s, ball);
        check_orthographic(&s.view.camera, size);
        check_add_directional(&s, 1, -1, -0.6, 3);
        s.volume[0].transfer = &looks;
        s.view.filling = SPS_FILLING_GATHER;
        s.volume[0].shading = SPS_SHADING_GAS;
        if (!check_render(context, &s, image_a)) return;
        samples = eye_samples_of(context);
        s.volume[0].shading = SPS_SHADING_SURFACE;
        if (!check_render(context, &s, image_a)) return;
        CHECK(samples > 0 && eye_samples_of(context) == samples);
        s.view.filling = SPS_FILLING_SPLAT;
        if (!check_render(context, &s, image_b)) return;
        CHECK(samples_of(context) == 0);
        if (check_memory_only()) continue;
        if (!compare_ways(&s, 1, &gathered, &splatted, &apart)) return;
        if (!CHECK(gathered <= splatted + allowed) || !CHECK(apart <= allowed) || !CHECK(splatted <= allowed))
            printf("    %d: %g, splatted %g, apart %g, allowed %g\n", size, gathered, splatted, apart, allowed);
        if (figures())
            printf("surface of voxels of %.3f pixels: gathered off by %.3f %%, splatted by %.3f %%, %.3f %% apart\n",
                   SIDE * 2.0 / GRID / size, 100 * gathered, 100 * splatted, 100 * apart);
    }
}

/* A picture of a ball lies in its middle, whatever level it is sampled from. Its optical depth has a variance of 0.3
   square pixels at least, and of 0.36 with the rays: samples a pixel apart move its middle by less than exp(-2 pi^2
   0.36) of one, and 0.01 is for floats of alpha. A level's voxels are a third of a pixel wide. */
static void test_middle(void) {
    double sum = 0, middle[2] = {0, 0};
    check_scene s;
    start(&s, ball);
    check_orthographic(&s.view.camera, 14.4);
    s.volume[0].extinction = 0.3f;
    check_color(s.volume[0].albedo, 0, 0, 0);
    if (!check_render(context, &s, image_a)) return;
    CHECK(((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data)->leveled > 1);
    for (int i = 0; i < SIDE * SIDE; ++i) {
        const double depth = (double)-log1pf(-image_a[4 * i + 3]);
        sum += depth;
        middle[0] += depth * (i % SIDE - (SIDE - 1) / 2.0);
        middle[1] += depth * (i / SIDE - (SIDE - 1) / 2.0);
    }
    for (int k = 0; k < 2; ++k) CHECK_NEAR(middle[k] / sum, 0, 0.01 + 0.001);
}

/* --- surfaces beside what is not sampled --- */

enum { PATCHES = 16 }; /* pixels on a side of a picture whose last patches, of 8, are full */

/* A surface seen along z, in pixels of either size. */
static void start_surface(check_scene *s, int wide, int pixels) {
    const double size = wide ? 0.05 : 0.025;
    start(s, lumps);
    check_set3(s->view.camera.position, 0, 0, 4);
    check_orthographic(&s->view.camera, size * pixels);
    s->view.width = s->view.height = pixels;
    s->volume[0].transfer = &looks;
    s->volume[0].shading = SPS_SHADING_SURFACE;
    check_add_directional(s, 1, -1, -0.6, 3)->no_shadow = 1;
}

/* Light of a pixel is at most 3 * 1 / pi, of which sums of floats in another order change 1e-5. */
static int pixels_alike(const float *a, const float *b) { return check_largest(a, b, 4) <= 1e-5; }

/* A picture's outer pixels are those that a larger picture has there. */
static void test_picture_ends(void) {
    for (int wide = 0; wide < 2; ++wide) {
        int wrong = 0;
        check_scene s;
        start_surface(&s, wide, PATCHES / 2);
        if (!check_render(context, &s, image_a)) return;
        CHECK(samples_of(context) > 0);
        start_surface(&s, wide, PATCHES);
        if (!check_render(context, &s, image_b)) return;
        for (int i = 0; i < PATCHES * PATCHES / 4; ++i) {
            const int x = i % (PATCHES / 2), y = i / (PATCHES / 2);
            const float *other = image_b + 4 * ((y + PATCHES / 4) * PATCHES + x + PATCHES / 4);
            wrong += !pixels_alike(image_a + 4 * i, other);
        }
        if (!CHECK(wrong == 0)) printf("    %d: %d pixels are others than in a larger picture\n", wide, wrong);
    }
}

/* Pixels beside a patch that a polygon hides look as without it. */
static void test_hidden_beside(void) {
    static const double corner[3] = {-1, -1, 2}, u[3] = {1, 0, 0}, v[3] = {0, 2, 0};
    for (int wide = 0; wide < 2; ++wide) {
        int wrong = 0;
        check_scene s;
        start_surface(&s, wide, PATCHES);
        if (!check_render(context, &s, image_a)) return;
        check_add_quad(&faces, corner, u, v);
        check_add_mesh(&s, &faces, 0);
        if (!check_render(context, &s, image_b)) return;
        CHECK(samples_of(context) > 0);
        for (int i = 0; i < PATCHES * PATCHES; ++i)
            if (i % PATCHES < PATCHES / 2)
                wrong += image_b[4 * i] > 0;
            else
                wrong += !pixels_alike(image_a + 4 * i, image_b + 4 * i);
        if (!CHECK(wrong == 0)) printf("    %d: %d pixels are wrong beside a polygon\n", wide, wrong);
    }
}

/* --- which samples are taken --- */

/* Whether any voxel of lumps that lies within a range is shown: 0.6 and more if it is classified. */
static int shows_within(int classified, const int low[3], const int high[3]) {
    for (int z = spsi_imax(low[2], 0); z <= spsi_imin(high[2], GRID - 1); ++z)
        for (int y = spsi_imax(low[1], 0); y <= spsi_imin(high[1], GRID - 1); ++y)
            for (int x = spsi_imax(low[0], 0); x <= spsi_imin(high[0], GRID - 1); ++x) {
                const float value = lumps[(z * GRID + y) * GRID + x];
                if (classified ? value > 0.601f : value > 0) return 1;
            }
    return 0;
}

/* Number of a field's cells that are marked in a reach and should not be, or the other way round. */
static int cells_wrong(const spsi_pyramid *fields, int classified, int number) {
    const spsi_pyramid_level *field = fields->levels[0];
    const int farther = classified ? number : 0, taps = fields->taps;
    int wrong = 0;
    for (int held = 0; held < field->count; ++held) {
        int at[3];
        spsi_pyramid_at(field, field->stored[held].place, at);
        for (int n = 0; n < 64; ++n) {
            const int cell[3] = {n % 4, n / 4 % 4, n / 16};
            int low[3], high[3];
            for (int k = 0; k < 3; ++k) {
                low[k] = SPSI_BRICK * at[k] + 2 * cell[k] - (taps / 2 - 1) - farther;
                high[k] = SPSI_BRICK * at[k] + 2 * cell[k] + 1 + taps / 2 + farther;
            }
            wrong += (int)(field->cells[number][field->stored[held].place][n / 32] >> n % 32 & 1) !=
                     shows_within(classified, low, high);
        }
    }
    return wrong;
}

static void test_cells(void) {
    for (int classified = 0; classified < 2; ++classified)
        for (int quality = SPS_QUALITY_MEDIUM; quality <= SPS_QUALITY_HIGH; ++quality) {
            const spsi_pyramid *fields;
            check_scene s;
            start(&s, lumps);
            s.view.quality = (sps_quality)quality;
            if (classified) s.volume[0].transfer = &high_looks;
            if (!check_render(context, &s, image_a)) return;
            fields = (const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data;
            for (int n = 0; n < (classified ? SPSI_PYRAMID_REACHES : 1); ++n) {
                const int wrong = cells_wrong(fields, classified, n);
                if (!CHECK(wrong == 0)) printf("    %d, %d, %d: %d cells\n", classified, quality, n, wrong);
            }
        }
}

/* Samples per slab on the one ray of a picture, through the middle of a thin block of 48 voxels. */
static double samples_per_slab(double slab) {
    static const sps_transfer_point thin_colors[2] = {{0, {1, 1, 1}, 0.01f, {0, 0, 0}},
                                                      {2, {1, 1, 1}, 0.01f, {0, 0, 0}}};
    static const sps_transfer thin = {thin_colors, 2, NULL, NULL, 0};
    static float one = 1;
    sps_stats_report stats;
    check_scene s;
    start(&s, &one);
    s.volume[0].read_fn = check_read_constant;
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 48;
    s.volume[0].transfer = &thin;
    s.view.width = s.view.height = 1;
    s.view.slab_thickness = slab;
    check_set3(s.view.camera.position, 0, 0, 4);
    check_orthographic(&s.view.camera, 1);
    if (!check_render(context, &s, image_a)) return 0;
    sps_get_stats(context, &stats);
    return (double)stats.eye_samples / (double)stats.slabs;
}

/* Classified slabs have one sample, or two if they are asked to be twice as thick as samples may be apart; those that a
   wide pixel has made thick have one again. Chunks look at a slab to either side and are whole, a fifth more of 60
   slabs; the block fills most of them. */
static void test_steps(void) {
    static const double slabs[3] = {0.7, 2.8, 0};
    for (int n = 0; n < 3; ++n) {
        const double samples = samples_per_slab(slabs[n]);
        if (!CHECK(n == 1 ? samples > 1.5 : samples > 0.5 && samples < 1.5)) printf("    %d: %g\n", n, samples);
    }
}

/* Marks all cells of all bricks that are held. */
static void mark_all_cells(const spsi_pyramid_level *field) {
    for (int n = 0; n < SPSI_PYRAMID_REACHES; ++n)
        for (int held = 0; held < field->count; ++held)
            memset(field->cells[n][field->stored[held].place], 0xff, sizeof field->cells[n][0]);
}

/* Where samples of a classified volume are left out, nothing depends on them: pictures are the same with all of them.
   Dots of 1 stand in values just below those shown, so that each sample that is missing would tell. Where dots are
   sparse and slabs are thin, samples end amid these values. */
static void test_left_out(void) {
    static float dots[GRID * GRID * GRID];
    for (int n = 0; n < 8; ++n) {
        check_random random = {2};
        check_scene s;
        double samples;
        for (int i = 0; i < GRID * GRID * GRID; ++i) dots[i] = check_next(&random) < (n & 4 ? 0.002 : 0.01) ? 1 : 0.58f;
        start_kind(&s, SURFACE);
        s.view.quality = n & 1 ? SPS_QUALITY_HIGH : SPS_QUALITY_MEDIUM;
        s.view.slab_thickness = n & 4 ? 0.25 : 0;
        s.volume[0].user = dots;
        s.volume[0].transfer = &high_looks;
        s.volume[0].revision = 3 + (uint64_t)n;
        if (n & 2) check_orthographic(&s.view.camera, 1);
        if (!check_render(context, &s, image_a)) return;
        samples = samples_of(context);
        mark_all_cells(((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data)->levels[0]);
        if (!check_render(context, &s, image_b)) return;
        if (!CHECK(samples < 0.9 * samples_of(context) && memcmp(image_a, image_b, sizeof image_a) == 0))
            printf("    %d: %g of %g samples\n", n, samples, samples_of(context));
    }
}

/* Profiles of classified slabs follow a parabola of which they know samples, or means: these are off by its bend / 12.
   Parts have its means, to the round-off of a few sums. */
static void test_profiles(void) {
    static spsi_table table;
    const double middle = 2, slope = 0.3, bend = -0.2;
    spsi_material material;
    memset(&material, 0, sizeof material);
    material.table = &table;
    material.table_scale = 1;
    for (int means = 0; means < 2; ++means) {
        const double more = means ? bend / 12 : 0;
        spsi_parabola p;
        spsi_v values[3];
        for (int n = -1; n <= 1; ++n) values[n + 1] = spsi_set((float)(middle + slope * n + bend * n * n + more));
        table.last_clear = 1;
        CHECK(spsi_values_through(&material, values, means, &p));
        for (int part = 0; part < SPSI_SUBSLABS; ++part) {
            const spsi_portion portion = spsi_portion_of(spsi_set(0), spsi_set(1), part);
            const double low = (double)part / SPSI_SUBSLABS - 0.5, high = low + 1.0 / SPSI_SUBSLABS;
            const double whole = middle * (high - low) + slope * (high * high - low * low) / 2 +
                                 bend * (high * high * high - low * low * low) / 3;
            CHECK_NEAR((double)spsi_lane(spsi_parabola_mean(&p, &portion), 0), whole * SPSI_SUBSLABS,
                       8 * 1.2e-7 * middle);
        }
        table.last_clear = 3; /* more than any of the three */
        CHECK(spsi_values_through(&material, values, means, &p) == means);
        CHECK((spsi_lane(p.value, 0) > 0) == means && (spsi_lane(p.slope, 0) > 0) == means &&
              (spsi_lane(p.bend, 0) < 0) == means);
    }
}

/* Rays through dense gas end, each by itself: of a single patch, half of whose pixels are behind a dense layer, half of
   the samples behind that are left out. */
static void test_ended_rays(void) {
    static float layer[GRID * GRID * GRID];
    double samples[2];
    for (int dense = 0; dense < 2; ++dense) {
        check_scene s;
        for (int i = 0; i < GRID * GRID * GRID; ++i)
            layer[i] = dense && i / (GRID * GRID) >= GRID - 3 && i % GRID < GRID / 2 ? 1000 : 1e-3f;
        start(&s, layer);
        s.view.width = s.view.height = SPSI_PATCH;
        check_set3(s.view.camera.position, 0, 0, 4);
        check_orthographic(&s.view.camera, 0.9);
        s.view.no_shadows = 1;
        s.view.slab_thickness = 0.2; /* 80 of them */
        if (!check_render(context, &s, image_a)) return;
        samples[dense] = samples_of(context);
    }
    if (!CHECK(samples[1] < 0.6 * samples[0])) printf("    %g of %g samples\n", samples[1], samples[0]);
}

/* --- even values --- */

/* The middle of a block of value 1, seen from a near plane within it and so dense that no face shows: a gas, whatever
   its shading, since the field has no slope. */
static void start_even(check_scene *s, double gradient_full) {
    static float one = 1;
    start(s, &one);
    s->volume[0].read_fn = check_read_constant;
    s->volume[0].placement = check_box(-1.6, -1.6, -1.6, 1.6, 1.6, 1.6);
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = 32;
    s->volume[0].transfer = &even_looks;
    s->volume[0].shading = SPS_SHADING_SURFACE;
    s->volume[0].gradient_full = (float)gradient_full;
    check_set3(s->view.camera.position, 2, 1.5, 4);
    s->view.near_distance = sqrt(2 * 2 + 1.5 * 1.5 + 4 * 4);
    check_orthographic(&s->view.camera, 1);
    check_add_directional(s, 0.3, 0.4, 1, 3)->no_shadow = 1;
}

/* Root mean square error of the picture, relative to 3 * 0.8 / 4 pi, the light of an opaque gas of that color. */
static double even_error(void) {
    const double exact = 3 * 0.8 / (4 * PI);
    double sum = 0;
    for (int i = 0; i < SIDE * SIDE; ++i) sum += pow((double)image_a[4 * i] / exact - 1, 2);
    return sqrt(sum / (SIDE * SIDE));
}

/* Where values are even, splatted kernels ripple by r (root mean square, see sps_quality) with a wave of a voxel:
   slopes are 2 pi r instead of 0, so that w = 2 pi r / gradient_full of the light is that of surfaces facing anywhere.
   It differs from a gas's by w (4 max(0, n.l) - 1) of that, whose root mean square is sqrt(16 / 6 - 8 / 4 + 1) w; a ray
   sees a voxel's length of it, so it may be less. Besides, rays end at a transmittance of 0.003 and 0.0005, and the
   kernels' own ripple adds r. Samples of what is gathered add up to 1 and have no ripple. */
static void test_even_surface(void) {
    static const double ripple[2] = {0.0012, 0.0007}, left[2] = {0.003, 0.0005}, full[3] = {0.05, 0.2, 1};
    for (int high = 0; high < 2; ++high)
        for (int n = 0; n < 3; ++n)
            for (int splat = 0; splat < 2; ++splat) {
                const double w = splat ? 2 * PI * ripple[high] / full[n] : 0;
                const double allowed = sqrt(16.0 / 6 - 8.0 / 4 + 1) * w + left[high] + splat * ripple[high];
                check_scene s;
                start_even(&s, full[n]);
                s.view.quality = high ? SPS_QUALITY_HIGH : SPS_QUALITY_MEDIUM;
                if (splat) s.view.filling = SPS_FILLING_SPLAT;
                if (!check_render(context, &s, image_a)) return;
                CHECK((samples_of(context) > 0) == !splat);
                if (!CHECK(even_error() <= allowed))
                    printf("    quality %d, %g: %g, allowed %g\n", high, full[n], even_error(), allowed);
                if (figures())
                    printf("even values, %s, %s, gradient_full %.2f: off by %.2f %%\n", high ? "high" : "medium",
                           splat ? "splatted" : "gathered", full[n], 100 * even_error());
            }
}

/* --- what is splatted nevertheless --- */

/* --- patches of sixteen rays --- */

enum { EDGE = 40 }; /* voxels */

/* A cloud as wide as 7 voxels, in a cube from -1 to 1, of which it fills the middle. */
static double cloud(const void *user, const double p[3]) {
    const double width = 7 * 2.0 / EDGE;
    (void)user;
    return exp(-(p[0] * p[0] + p[1] * p[1] + 1.3 * p[2] * p[2]) / (2 * width * width));
}

static const check_field cloud_field = {cloud, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};

static double one(const void *user, const double p[3]) { return (void)user, (void)p, 1; }

/* The cloud, in a picture in which a patch is `voxels` wide. It absorbs, and scatters nothing. */
static void start_cloud(check_scene *s, double voxels) {
    start(s, noise);
    check_orthographic(&s->view.camera, SIDE * voxels / 8 * 2 / EDGE);
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = EDGE;
    s->volume[0].read_fn = NULL;
    s->volume[0].eval_fn = check_eval_field;
    s->volume[0].user = (void *)(size_t)&cloud_field;
    s->volume[0].extinction = 4;
    check_color(s->volume[0].albedo, 0, 0, 0);
}

/* Renders with a tolerance, and returns what was used of it by the eye. */
static double spent(check_scene *s, float tolerance, float *image, double *samples) {
    sps_stats_report stats;
    s->view.tolerance = tolerance;
    if (!check_render(context, s, image)) return -1;
    sps_get_stats(context, &stats);
    *samples = (double)stats.eye_samples;
    return (double)stats.eye_bound;
}

/* The largest difference of the optical depths of two pictures of matter that only absorbs. */
static double depths_apart_in(int channel, const float *a, const float *b) {
    double most = 0;
    for (int i = channel; i < COUNT; i += 4) most = fmax(most, fabs((double)log1pf(-a[i]) - (double)log1pf(-b[i])));
    return most;
}

static double depths_apart(const float *a, const float *b) { return depths_apart_in(3, a, b); }

/* Third differences of cubics are their third derivatives. The norm counts each of the orders in which one may be
   taken: 1 for x x x, 3 for x x y, 6 for x y z. */
static void test_bends(void) {
    static const int powers[10][3] = {{3, 0, 0}, {0, 3, 0}, {0, 0, 3}, {2, 1, 0}, {2, 0, 1},
                                      {1, 2, 0}, {0, 2, 1}, {1, 0, 2}, {0, 1, 2}, {1, 1, 1}};
    static float values[SPSI_PYRAMID_FLOATS];
    for (int taps = 4; taps <= 6; taps += 2)
        for (int n = 0; n < 10; ++n) {
            const int *power = powers[n], edge = spsi_pyramid_edge(taps), pitch = spsi_pyramid_pitch(taps);
            const double exact = n < 3 ? 6 : n < 9 ? sqrt(3) * 2 : sqrt(6);
            float bends[8];
            for (int i = 0; i < edge * edge * pitch; ++i) {
                const double x = i % pitch - 5, y = i / pitch % edge - 5, z = i / pitch / edge - 5;
                values[i] = (float)(pow(x, power[0]) * pow(y, power[1]) * pow(z, power[2]));
            }
            spsi_pyramid_thirds(taps, values, bends);
            for (int i = 0; i < 8; ++i) CHECK_NEAR((double)bends[i], exact, 1e-5);
        }
}

/* A brick's planes, one behind the other. */
static const float *brick_of(const spsi_pyramid *fields, const spsi_pyramid_level *field, int held) {
    static float values[SPSI_PYRAMID_FLOATS];
    const size_t floats = (size_t)spsi_plane_floats(fields->taps);
    for (int z = 0; z < spsi_pyramid_edge(fields->taps); ++z)
        memcpy(values + (size_t)z * floats, spsi_pyramid_plane(field, held, z), floats * sizeof(float));
    return values;
}

/* Boxes of places bend as much as the most that eighths of bricks do in which a row begins that a sample in them reads,
   or at most the next ones. */
static void test_boxes_bend(void) {
    check_random random = {8};
    check_scene s;
    const spsi_pyramid *fields;
    const spsi_pyramid_level *field;
    float alone[8], all[SPSI_LANES];
    start(&s, noise);
    s.view.tolerance = 0.1f;
    if (!check_render(context, &s, image_a)) return;
    fields = (const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data;
    field = fields->levels[0];
    for (int i = 0; i < 500; ++i) {
        spsi_sampler tapper;
        spsi_sampler_boxes boxes;
        int low[3], high[3];
        float least = 0, most = 0;
        memset(&tapper, 0, sizeof tapper);
        tapper.fields = fields;
        tapper.field = tapper.finest = field;
        for (int k = 0; k < 3; ++k) {
            const double at = -6 + (8 * field->size[k] + 6) * check_next(&random), wide = 24 * check_next(&random);
            boxes.low[k] = spsi_set((float)at), boxes.high[k] = spsi_set((float)(at + wide));
            low[k] = (int)floor((at - 1) / 4), high[k] = (int)floor((at + wide + 2) / 4); /* rows of 4 taps */
        }
        for (int n = 0; n < field->count; ++n) {
            spsi_pyramid_thirds(fields->taps, brick_of(fields, field, n), alone);
            for (int m = 0; m < 8; ++m) {
                int at[3], in = 1, beside = 1;
                spsi_pyramid_at(field, field->stored[n].place, at);
                for (int k = 0; k < 3; ++k) {
                    const int eighth = 2 * (at[k] - field->low[k]) + (m >> k & 1);
                    in &= eighth >= low[k] && eighth <= high[k];
                    beside &= eighth >= spsi_imin(low[k], 2 * field->size[k] - 1);
                    beside &= eighth <= spsi_imax(high[k], 0) + 1;
                }
                if (in) least = fmaxf(least, alone[m]);
                if (beside || in) most = fmaxf(most, alone[m]);
            }
        }
        spsi_store(all, spsi_sampler_boxes_thirds(&tapper, &boxes));
        if (!CHECK(all[0] >= least && all[0] <= most))
            printf("    box %d: %g, eighths %g to %g\n", i, (double)all[0], (double)least, (double)most);
    }
}

/* Slabs that are in need of rays have the same bits as if all were, and others have nothing. */
static void test_slabs_in_need(void) {
    enum { SIZE = 64 * 64, SLABS = 8 };
    static float whole[SLABS * SIZE], some[SLABS * SIZE];
    check_random random = {5};
    check_scene s;
    spsi_sampler tapper;
    spsi_tile tile;
    start(&s, noise);
    if (!check_render(context, &s, image_a)) return;
    memset(&tapper, 0, sizeof tapper);
    memset(&tile, 0, sizeof tile);
    tapper.fields = (const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data;
    tapper.field = tapper.finest = tapper.fields->levels[0];
    tapper.cells = (const uint32_t(*)[2])tapper.field->cells[0];
    tapper.rays = tapper.side = 1, tapper.scale = 1, tapper.slab.slope[0] = 1;
    for (int k = 0; k < 3; ++k) {
        tapper.at[k].base[0] = 11, tapper.at[k].base[1] = 0.1f * (float)(k + 1), tapper.at[k].base[2] = 0.2f;
        tapper.at[k].slope[0] = 0.9f - 0.2f * (float)k;
    }
    tile.slab_count = SLABS, tile.pitch = 64, tile.sheet_size = SIZE;
    for (int i = 0; i < 60; ++i) {
        tapper.steps = 1 + i % 3;
        int all[SPSI_SAMPLER_SLABS + 3] = {0}, need[SPSI_SAMPLER_SLABS + 3] = {0}, wrong = 0, seen = 0;
        memset(whole, 0, sizeof whole), memset(some, 0, sizeof some);
        for (int n = 1; n <= SLABS; ++n) {
            all[n] = SPSI_ALL_LANES;
            need[n] = (int)(check_next(&random) * (SPSI_ALL_LANES + 1)) & SPSI_ALL_LANES;
        }
        spsi_sampler_row(&tapper, &tile, 3, i % 8, SPSI_ALL_LANES, all, whole);
        spsi_sampler_row(&tapper, &tile, 3, i % 8, SPSI_ALL_LANES, need, some);
        for (int n = 0; n < SLABS * SPSI_LANES; ++n) {
            const int slab = n / SPSI_LANES, lane = n % SPSI_LANES, at = slab * SIZE + i % 8 * 64 + 3 + lane;
            const float is = need[1 + slab] >> lane & 1 ? whole[at] : 0;
            wrong += memcmp(&is, &some[at], sizeof is) != 0;
            seen += whole[at] > 0;
        }
        CHECK(wrong == 0 && seen > SLABS * SPSI_LANES / 2);
    }
}

/* Even gas as far as its sides, in a box that is seen at a slant: all chunks of slabs meet some side in each patch.
   Rays are left out where it is even, along thin slabs, and not where they meet a side, nor are slabs there less exact.
   Off by what a lattice of kernels is uneven by, 5e-4 along each axis, along sqrt(12), and by what is used of the
   tolerance. */
static void test_tolerance_inside(void) {
    static const check_field even = {one, NULL, {0, 0, 0}, {{0, 0, 0}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}};
    for (int slab = 1; slab <= 4; slab += 3) {
        double all, some, bound;
        check_scene s;
        start_cloud(&s, 6);
        check_orthographic(&s.view.camera, 1.2);
        for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 96;
        s.volume[0].user = (void *)(size_t)&even;
        s.volume[0].extinction = 0.5f;
        s.view.slab_thickness = slab;
        CHECK(spent(&s, 0, image_a, &all) == 0);
        bound = spent(&s, 0.01f, image_b, &some);
        if (figures())
            printf("even gas in a box, slabs of %d: %.3f of the samples, bound %.5f, off by %.6f\n", slab, some / all,
                   bound, depths_apart(image_a, image_b));
        CHECK(bound <= 0.01 * (1 + 1e-6) && some < 0.7 * all);
        CHECK(depths_apart(image_a, image_b) <= bound + 0.5 * sqrt(12) * 3 * 5e-4);
    }
}

/* What kernels are uneven by in the cloud's optical depth: a slope is off by 0.0013 of itself (2 pi sigma^2 2 q,
   q = exp(-2 pi^2 sigma^2)) and 0.0054 for what 4 taps leave out, here 0.0067 * 0.6 / 7 of the largest value along
   7 sqrt(2 pi) voxels of 4 * 2 / EDGE each. */
#define UNEVEN (0.0067 * 0.6 * sqrt(2 * PI) * 4 * 2 / EDGE)

/* What is interpolated is off by no more than the bound, which is no more than the tolerance, and by what kernels are
   uneven by. A tolerance that is less than what all patches would use leaves some of them, but not all, as they are. */
static void test_tolerance(void) {
    static const double widths[] = {1, 3, 6};
    for (int n = 0; n < 3; ++n) {
        for (int slab = 1; slab <= 4; slab += 3) {
            double none, all, some, bound, half;
            check_scene s;
            start_cloud(&s, widths[n]);
            s.view.slab_thickness = slab;
            CHECK(spent(&s, 0, image_a, &none) == 0);
            bound = spent(&s, 1, image_b, &all);
            if (!CHECK(bound > 0 && bound <= 1) || !CHECK(all < 0.5 * none) ||
                !CHECK(depths_apart(image_a, image_b) <= bound + UNEVEN))
                printf("    patches of %g voxels, slabs of %d: %g of %g samples, bound %g, off by %g\n", widths[n],
                       slab, all, none, bound, depths_apart(image_a, image_b));
            if (figures())
                printf("patches of %g voxels, slabs of %d: %.3f of the samples, bound %.5f, off by %.6f\n", widths[n],
                       slab, all / none, bound, depths_apart(image_a, image_b));
            half = spent(&s, (float)(0.4 * bound), image_b, &some);
            if (!CHECK(half <= 0.4 * bound * (1 + 1e-6) && some > all && some < none))
                printf("    patches of %g voxels, slabs of %d: bound %g of %g, %g samples\n", widths[n], slab, half,
                       0.4 * bound, some);
            s.volume[0].extinction = 0.5f * s.volume[0].extinction;
            CHECK_NEAR(spent(&s, 0.5f, image_b, &some), 0.5 * bound, 1e-5 * bound);
        }
    }
}

/* A black polygon that cuts slabs amid the cloud, all of which is lit alike: what is seen of it is off by no more than
   the bound, since nothing is interpolated in a slab that the polygon cuts. */
static void test_tolerance_before_polygon(void) {
    static const double corner[3] = {-1, -1, -0.05}, u[3] = {2, 0, 0.1}, v[3] = {0, 2, 0.06};
    for (int slab = 1; slab <= 4; slab += 3) {
        double none, some, bound, off;
        check_scene s;
        start_cloud(&s, 3);
        s.view.slab_thickness = slab;
        check_color(s.volume[0].albedo, 1, 1, 1);
        check_add_directional(&s, 0, -1, -1, 4 * PI)->no_shadow = 1; /* gas of radiance 1 */
        check_add_quad(&faces, corner, u, v);
        check_add_mesh(&s, &faces, 0);
        CHECK(spent(&s, 0, image_a, &none) == 0);
        bound = spent(&s, 1, image_b, &some);
        off = depths_apart_in(0, image_a, image_b);
        if (figures())
            printf("slabs of %d before a polygon: %g of %g samples, bound %g, off by %g\n", slab, some, none, bound,
                   off);
        CHECK(bound > 0 && bound <= 1 && some < none);
        CHECK(off <= bound + UNEVEN);
    }
}

/* The same where voxels are smaller than pixels, with two rays a pixel, four, two on a coarser level, and sixteen where
   voxels are too long for a level, in gas that is as much thinner as bounds are wider. */
static void test_tolerance_of_small_voxels(void) {
    static const double widths[] = {16, 26, 34, 50};
    static const int rays[] = {2, 4, 2, 16};
    for (int n = 0; n < 4; ++n) {
        const double thinner = pow(6 / widths[n], 3);
        double all, some, bound;
        check_scene s;
        start_cloud(&s, widths[n]);
        s.volume[0].extinction *= (float)thinner;
        if (n == 3) s.volume[0].placement.axis[1][1] *= 4;
        CHECK(spent(&s, 0, image_a, &all) == 0);
        bound = spent(&s, 1, image_b, &some);
        if (!CHECK(bound > 0.2 && bound <= 1 && some < 0.75 * all) ||
            !CHECK(depths_apart(image_a, image_b) <= bound + UNEVEN * thinner))
            printf("    patches of %g voxels: %g of %g samples, bound %g, off by %g\n", widths[n], some, all, bound,
                   depths_apart(image_a, image_b));
        if (figures())
            printf("patches of %g voxels, %d rays a pixel: %.3f of the samples, bound %.5f, off by %.6f\n", widths[n],
                   rays[n], some / all, bound, depths_apart(image_a, image_b));
    }
}

/* Light is interpolated as well: what arrives is off by both bounds at most, relative to what would arrive without gas.
   A patch of texels has eight voxels on a side at medium; they are half as large here. */
static void test_tolerance_of_light(void) {
    sps_stats_report all, some;
    check_scene s;
    double unshadowed;
    start_cloud(&s, 3);
    check_color(s.volume[0].albedo, 1, 1, 1);
    check_add_directional(&s, 1, -1, -0.6, 3);
    s.light[0].shadow_source = SPS_SHADOW_SHEETS;
    s.view.shadow_resolution = 160;
    if (!check_render(context, &s, image_a)) return;
    sps_get_stats(context, &all);
    s.view.tolerance = 0.2f;
    if (!check_render(context, &s, image_b)) return;
    sps_get_stats(context, &some);
    unshadowed = 3 / (4 * PI);
    CHECK((double)some.light_samples < 0.7 * (double)all.light_samples && all.light_bound == 0);
    CHECK(some.light_bound > 0 && some.light_bound <= 0.2f && some.eye_bound <= 0.2f);
    CHECK(check_largest(image_a, image_b, COUNT) <=
          unshadowed * ((double)some.light_bound + (double)some.eye_bound + 2 * 0.0067));
}

/* The bound of two lights is that of the one that has the larger, whichever comes first. */
static void test_bound_of_lights(void) {
    double bound[4];
    for (int n = 0; n < 4; ++n) {
        sps_stats_report stats;
        check_scene s;
        start_cloud(&s, 3);
        check_color(s.volume[0].albedo, 1, 1, 1);
        for (int i = 0; i < (n < 2 ? 1 : 2); ++i) { /* one, the other, both, both in another order */
            const int second = n == 1 || (n == 2 && i == 1) || (n == 3 && i == 0);
            check_add_directional(&s, second ? 0.2 : 1, -1, -0.6, 3)->shadow_source = SPS_SHADOW_SHEETS;
        }
        s.view.shadow_resolution = 160;
        s.view.tolerance = 0.2f;
        if (!check_render(context, &s, image_b)) return;
        sps_get_stats(context, &stats);
        bound[n] = (double)stats.light_bound;
    }
    CHECK(bound[0] != bound[1]);
    for (int n = 2; n < 4; ++n) CHECK(bound[n] == fmax(bound[0], bound[1]));
}

enum { ROD_SIDE = 24, ROD_LENGTH = 128, ROD_PIXELS = 64 };
static float rod[ROD_SIDE * ROD_SIDE * ROD_LENGTH];
static float rod_a[4 * ROD_PIXELS * ROD_PIXELS], rod_b[4 * ROD_PIXELS * ROD_PIXELS];

/* A rod of voxels along z, just beyond an eighth of bricks on two sides or well within one. */
static void start_rod(check_scene *s, check_array *array, int x, int y, sps_quality quality) {
    const check_array all = {rod, {ROD_SIDE, ROD_SIDE, ROD_LENGTH}, 0, 0};
    memset(rod, 0, sizeof rod);
    for (int z = 20; z < 108; ++z) rod[(z * ROD_SIDE + y) * ROD_SIDE + x] = 1;
    *array = all;
    check_clear(s, ROD_PIXELS, ROD_PIXELS);
    check_add_volume(s, ROD_SIDE, ROD_SIDE, ROD_LENGTH, check_box(0, 0, 0, ROD_SIDE, ROD_SIDE, ROD_LENGTH));
    s->volume[0].read_fn = check_read_array;
    s->volume[0].user = array;
    s->volume[0].extinction = 0.4f;
    s->view.quality = quality;
    s->view.filling = SPS_FILLING_GATHER;
    faces.count = 0;
}

/* Renders without tolerance and with one, and gives the largest difference of what `of` makes of the pictures' channel,
   and the statistics of the latter. */
static double rods_apart(check_scene *s, int channel, sps_stats_report *stats) {
    double most = 0;
    s->view.tolerance = 0;
    if (!check_render(context, s, rod_a)) return 0;
    s->view.tolerance = 1e-3f;
    if (!check_render(context, s, rod_b)) return 0;
    sps_get_stats(context, stats);
    for (int i = channel; i < 4 * ROD_PIXELS * ROD_PIXELS; i += 4) {
        const double a = (double)rod_a[i], b = (double)rod_b[i];
        most = fmax(most, channel == 3 ? fabs(log1p(-a) - log1p(-b)) : fabs(log(a) - log(b)));
    }
    return most;
}

/* Bounds know of voxels beside a patch which only the outermost of its samples read. Floats round depths of up to 35 by
   2e-6, and what is left of light by 1e-7 in each of them. */
static void test_tolerance_beside_rods(void) {
    for (int n = 0; n < 8; ++n) {
        const int x = 8 + n % 2, y = 8 + n / 2 % 2;
        const sps_quality quality = n < 4 ? SPS_QUALITY_MEDIUM : SPS_QUALITY_HIGH;
        for (int place = 0; place < 8; ++place) {
            const double at = 8.2 + 0.5 * place;
            check_scene s;
            check_array array;
            sps_stats_report stats;
            start_rod(&s, &array, x, y, quality);
            s.view.slab_thickness = n < 4 ? 1 : 0.5;
            check_set3(s.view.camera.position, at, at, -50);
            check_set3(s.view.camera.target, at, at, 0);
            check_orthographic(&s.view.camera, 32 >> place % 3);
            const double apart = rods_apart(&s, 3, &stats);
            if (!CHECK(apart <= (double)stats.eye_bound + 1e-5))
                printf("    rod %d,%d from %g: bound %g, off by %g\n", x, y, at, (double)stats.eye_bound, apart);
        }
    }
}

/* The same of a light's sheets, by the shadow on a plane behind the gas. */
static void test_tolerance_of_light_beside_rods(void) {
    static const double origin[3] = {-50, -50, 140}, u[3] = {200, 0, 0}, v[3] = {0, 200, 0};
    for (int n = 0; n < 16; ++n) {
        const int x = 8 + n % 2, y = 8 + n / 2 % 2;
        check_scene s;
        check_array array;
        sps_stats_report stats;
        start_rod(&s, &array, x, y, SPS_QUALITY_MEDIUM);
        rod[(64 * ROD_SIDE + 2) * ROD_SIDE + 2] = rod[(64 * ROD_SIDE + 20) * ROD_SIDE + 20] = 0.01f; /* more texels */
        check_add_quad(&faces, origin, u, v);
        check_add_mesh(&s, &faces, 1);
        check_add_directional(&s, 0, 0, 1, 3);
        s.light[0].shadow_source = SPS_SHADOW_SHEETS;
        s.view.shadow_resolution = 20 + 3 * n;
        check_set3(s.view.camera.position, 9, 9, 132);
        check_set3(s.view.camera.target, 9, 9, 140);
        check_orthographic(&s.view.camera, 12);
        const double apart = rods_apart(&s, 0, &stats);
        if (!CHECK(apart <= (double)stats.light_bound + 1e-5))
            printf("    rod %d,%d, %d texels: bound %g, off by %g\n", x, y, s.view.shadow_resolution,
                   (double)stats.light_bound, apart);
    }
}

/* What may not be interpolated stays as it is, to the bit: noise, what emits, what is classified, splatted or coarse;
   patches that polygons or the near plane cut. */
static void test_not_interpolated(void) {
    static const double corner[3] = {-3, -0.05, -3}, u[3] = {0, 0.1, 6}, v[3] = {6, 0, 0};
    for (int kind = 0; kind < 7; ++kind) {
        check_scene s;
        double samples[2];
        start_cloud(&s, kind == 4 ? 40 : 3);
        if (kind == 0) start(&s, noise);
        if (kind == 1) check_color(s.volume[0].emission, 1, 1, 1);
        if (kind == 2) s.volume[0].transfer = &looks;
        if (kind == 3) s.view.filling = SPS_FILLING_SPLAT;
        if (kind == 5) {
            check_add_quad(&faces, corner, u, v); /* through the middle, across rows of patches */
            check_add_mesh(&s, &faces, 0.6);
        }
        if (kind == 6) s.view.near_distance = sqrt(1.2 * 1.2 + 0.9 * 0.9 + 16);
        spent(&s, 0, image_a, &samples[0]);
        spent(&s, kind == 0 ? 1e-4f : kind < 5 ? 0.02f : 1, image_b, &samples[1]);
        /* the same rays; and those that have shown that others can't stand for them may have been followed twice */
        if (kind < 5 && !CHECK(samples[1] >= samples[0] && memcmp(image_a, image_b, sizeof image_a) == 0))
            printf("    kind %d: %g of %g samples, off by %g\n", kind, samples[1], samples[0],
                   depths_apart(image_a, image_b));
        if (kind >= 5 && !CHECK(samples[1] < samples[0] && depths_apart(image_a, image_b) <= 0.02))
            printf("    kind %d: %g of %g samples, off by %g\n", kind, samples[1], samples[0],
                   depths_apart(image_a, image_b));
    }
}

/* --- cells, and sheets in which light spreads --- */

enum { MOST_SAMPLES = 48 * 48 * 48 };

/* The samples from which the last picture's cells were filled, or the last face of a light. */
static const spsi_sampling *sampling_of(const check_scene *s) {
    const void *job = context->buffers[SPSI_BUFFER_CELL_JOB].data;
    if (s->view.scattering == SPS_SCATTERING_MULTIPLE) return &((const spsi_cell_job *)job)->sheets;
    return &((const spsi_spread_job *)job)->sheets;
}

/* Mean values of slabs, as the last picture's samples have them. */
static size_t sample_again(const check_scene *s, float *out) {
    static spsi_sampling sheets;
    const spsi_sampling *as = sampling_of(s);
    const int width = as->rays.width, height = as->rays.height;
    memset(&sheets, 0, sizeof sheets);
    sheets.rays = as->rays, sheets.slabs = as->slabs;
    memset(out, 0, MOST_SAMPLES * sizeof *out);
    if (!CHECK(width * height * as->slabs.count <= MOST_SAMPLES)) return 0;
    if (!CHECK_OK(context, spsi_sampling_begin(context, as->target.frame, &sheets))) return 0;
    for (int chunk = 0; chunk < spsi_chunk_count(&sheets.slabs); ++chunk) {
        spsi_contents_advance(&sheets.contents, chunk);
        spsi_contents_bin_particles(&sheets.contents);
        for (int i = 0; i < spsi_sampling_task_count(&sheets); ++i) {
            spsi_tile tile;
            const int slabs = spsi_sampling_tile(&sheets, i, 0, &tile);
            for (int n = 0; n < slabs * (tile.x1 - tile.x0 + 1) * (tile.y1 - tile.y0 + 1); ++n) {
                const int x = n % (tile.x1 - tile.x0 + 1), row = n / (tile.x1 - tile.x0 + 1);
                const int y = row % (tile.y1 - tile.y0 + 1), k = row / (tile.y1 - tile.y0 + 1);
                float lanes[SPSI_LANES];
                spsi_store(lanes, spsi_row_slabs_at(&sheets.shader, tile.x0 + x, tile.y0 + y).count);
                out[((sheets.contents.first_slab + k) * height + tile.y0 + y) * width + tile.x0 + x] =
                    lanes[0] * tile.sheets[(size_t)k * tile.sheet_size + (size_t)(y * tile.pitch + x)];
            }
        }
    }
    return (size_t)(width * height * as->slabs.count);
}

/* Classified volumes fill cells, and sheets across a light's rays, either way, alike before they are classified: waves
   of voxels lose at most 0.0003 of their amplitude by 6 taps, as in test_pictures_alike, and cut kernels ripple by up
   to 0.002. Gas keeps its mass, and is never gathered. */
static void test_samples_alike(void) {
    static float gathered[MOST_SAMPLES], splatted[MOST_SAMPLES];
    for (int kind = 0; kind < 3; ++kind) {
        check_scene s;
        double off, all = 0;
        size_t count = 0;
        start(&s, lumps);
        s.volume[0].transfer = &looks;
        s.view.scattering = kind == 0 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_CONVOLUTION;
        s.view.scattering_resolution = 12;
        s.view.quality = SPS_QUALITY_HIGH;
        if (kind < 2) check_add_directional(&s, 1, -1, -0.6, 3);
        if (kind == 2) check_add_point(&s, 50, 60, 30, 12000);
        for (int splat = 0; splat < 2; ++splat) {
            s.view.filling = splat ? SPS_FILLING_SPLAT : SPS_FILLING_GATHER;
            if (!check_render(context, &s, image_a)) return;
            CHECK(sampling_of(&s)->target.verdicts[0] == (splat ? SPSI_SPLAT_ASKED : SPSI_GATHER_ASKED));
            count = sample_again(&s, splat ? splatted : gathered);
        }
        for (size_t i = 0; i < count; ++i) all += (double)(splatted[i] * splatted[i]) / (double)count;
        off = check_rms(gathered, splatted, count) / sqrt(all);
        if (figures()) printf("samples %d: %.3f %% apart\n", kind, 100 * off);
        if (!CHECK(count > 0 && off <= 0.0003 + 0.002)) printf("    kind %d: %g\n", kind, off);
        s.volume[0].transfer = NULL;
        s.view.filling = SPS_FILLING_GATHER;
        s.view.scattering_resolution = 20;
        check_render(context, &s, image_a);
        CHECK(sampling_of(&s)->target.verdicts[0] == SPSI_SPLAT_MASS);
    }
}

static void test_splatted(void) {
    for (int n = 0; n < 7; ++n) {
        check_scene s;
        start(&s, noise);
        if (n == 1) check_orthographic(&s.view.camera, 640000); /* the coarsest voxels have 0.016 pixels */
        if (n == 2) check_set3(s.view.camera.position, 0.2, 0.1, 0.4), check_perspective(&s.view.camera, 0.4);
        if (n == 3) s.view.slab_thickness = 20;
        if (n == 4) s.view.filling = SPS_FILLING_SPLAT;
        if (n > 4) check_orthographic(&s.view.camera, 14); /* voxels of 0.18 pixels, some of them long */
        if (n > 4) s.view.quality = SPS_QUALITY_HIGH, s.volume[0].placement.axis[0][0] *= n == 5 ? 1.9 : 2.1;
        if (!check_render(context, &s, image_a)) return;
        if (!CHECK((samples_of(context) > 0) == (n == 0 || n > 4))) printf("    case %d\n", n);
        if (n > 4)
            CHECK((((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data)->leveled > 1) == (n == 5));
    }
}

/* The plan says how the eye's and the light's sheets are filled, and why. */
static void test_reasons(void) {
    static const struct {
        int eye, light;
        const char *eye_reason, *light_reason;
    } expected[] = {
        {1, 1, "gathered: samples cost less", "gathered: samples cost less"},
        {0, 1, "splatted: voxels are smaller than pixels", "gathered: samples cost less"},
        {0, 1, "splatted: voxels are near the eye", "gathered: samples cost less"},
        {0, 0, "splatted: rays cross too many voxels", "splatted: rays cross too many voxels"},
        {0, 0, "splatted: view.filling", "splatted: view.filling"},
        {1, 1, "gathered: view.filling", "gathered: view.filling"},
        {0, 0, "splatted: footprints cost less", "splatted: footprints cost less"},
        {1, 1, "gathered: samples cost less", "gathered: samples cost less"},
        {1, 1, "gathered: samples cost less", "gathered: samples cost less"},
        {0, 0, "splatted: gas is opaque within", "splatted: gas is opaque within"},
    };
    for (int n = 0; n < 10; ++n)
        for (int held = 0; held < 2; ++held) {
            sps_plan_report plan;
            sps_stats_report stats;
            check_scene s;
            start(&s, noise);
            check_add_directional(&s, 1, -1, -0.6, 3);
            s.light[0].shadow_source = SPS_SHADOW_SHEETS;
            s.volume[0].revision = 1;
            s.view.filling = n == 4 ? SPS_FILLING_SPLAT : n == 5 ? SPS_FILLING_GATHER : SPS_FILLING_AUTO;
            if (n == 1) check_orthographic(&s.view.camera, 640000);
            if (n == 2) check_set3(s.view.camera.position, 0.2, 0.1, 0.4), check_perspective(&s.view.camera, 0.4);
            if (n == 3) s.view.slab_thickness = 20;
            if (n == 6) s.volume[0].user = dot;
            if (n == 8) s.view.quality = SPS_QUALITY_HIGH, s.view.shadow_resolution = 4;
            if (n == 7) {
                s.volume[0].transfer = &looks, s.volume[0].shading = SPS_SHADING_SURFACE;
                check_orthographic(&s.view.camera, 9);
            }
            if (n == 9) s.volume[0].extinction = 1e6f;
            if ((n == 6 || n == 9) && !held) check_render(context, &s, image_a); /* only who has read it knows */
            if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
            if (!CHECK(plan.eye_gathered == expected[n].eye && plan.light_gathered == expected[n].light) ||
                !CHECK(strstr(plan.eye_filling, expected[n].eye_reason) == plan.eye_filling) ||
                !CHECK(strstr(plan.light_filling, expected[n].light_reason) == plan.light_filling))
                printf("    case %d: %d %s, %d %s\n", n, plan.eye_gathered, plan.eye_filling, plan.light_gathered,
                       plan.light_filling);
            check_render(context, &s, image_a);
            sps_get_stats(context, &stats);
            CHECK((stats.eye_samples > 0) == plan.eye_gathered && (stats.eye_footprints > 0) == !plan.eye_gathered);
            CHECK((stats.light_samples > 0) == plan.light_gathered);
        }
}

/* Of several lights, the count and the reason are those of one that most volumes are gathered for. */
static void test_reasons_of_lights(void) {
    for (int n = 0; n < 2; ++n) {
        sps_plan_report plan;
        check_scene s;
        start(&s, noise);
        s.view.filling = SPS_FILLING_AUTO;
        if (n) check_add_point(&s, 1, 3, 2.5, 3);
        check_add_directional(&s, 1, -1, -0.6, 3);
        if (!n) check_add_point(&s, 1, 3, 2.5, 3);
        for (int i = 0; i < 2; ++i) s.light[i].shadow_source = SPS_SHADOW_SHEETS;
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        if (!CHECK(plan.light_gathered == 1 && strstr(plan.light_filling, "gathered: samples cost less")))
            printf("    %d: %s\n", plan.light_gathered, plan.light_filling);
    }
}

/* What is chosen is one of the two pictures, to the bit. */
static void test_chosen(void) {
    check_scene s;
    start(&s, noise);
    for (int even = 0; even < 2; ++even) {
        s.volume[0].user = even ? noise : dot;
        for (int other = 0; other < 2; ++other) {
            s.view.filling = SPS_FILLING_AUTO;
            check_render(context, &s, image_a);
            s.view.filling = even != other ? SPS_FILLING_GATHER : SPS_FILLING_SPLAT;
            check_render(context, &s, image_b);
            CHECK((memcmp(image_a, image_b, sizeof image_a) == 0) == !other);
        }
    }
}

/* One voxel at each end of a volume so long that a grid of its bricks would be empty. */
static int read_ends(void *user, const int lo[3], const int size[3], float *out) {
    const int last = *(const int *)user - 1;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) {
        const int x = lo[0] + i % size[0], y = lo[1] + i / size[0] % size[1], z = lo[2] + i / (size[0] * size[1]);
        out[i] = (x + y + z == 0) || (x == last && y == last && z == last);
    }
    return 0;
}

static int range_ends(void *user, const int lo[3], const int size[3], float out[2]) {
    const int end = *(const int *)user;
    out[0] = 0;
    out[1] = lo[0] + lo[1] + lo[2] == 0 || (lo[0] + size[0] == end && lo[1] + size[1] == end && lo[2] + size[2] == end);
    return 0;
}

static void start_ends(check_scene *s, int *size) {
    start(s, noise);
    for (int k = 0; k < 3; ++k) s->volume[0].size[k] = *size;
    s->volume[0].read_fn = read_ends;
    s->volume[0].range_fn = range_ends;
    s->volume[0].user = size;
}

/* Whether voxels are scattered is told by each volume's own bricks, whatever another volume holds. */
static void test_scattered_thinly(void) {
    static float one = 1;
    int size = 400;
    for (int beside = 0; beside < 2; ++beside) {
        sps_plan_report plan;
        sps_stats_report stats;
        check_scene s;
        start_ends(&s, &size);
        check_set3(s.view.camera.target, -1, -1, -1);
        check_orthographic(&s.view.camera, 0.1);
        if (beside) {
            sps_volume *other = check_add_volume(&s, 88, 88, 88, check_box(-1, -1, -1, 1, 1, 1));
            other->read_fn = check_read_constant, other->user = &one, other->extinction = 0.1f;
        }
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        CHECK(strstr(plan.eye_filling, "splatted: voxels are scattered") == plan.eye_filling);
        check_render(context, &s, image_a);
        sps_get_stats(context, &stats);
        CHECK((stats.eye_samples > 0) == beside && stats.eye_footprints > 0);
        CHECK(((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data)->levels[0]->grid == NULL);
    }
}

/* Light from the left meets the surface of such a voxel, whose left half faces it: its gradient is known, whatever
   fills sheets. A hundredth allows for the column of pixels in the middle. */
static void test_scattered_surface(void) {
    static const sps_transfer_point points[2] = {{0.02f, {1, 1, 1}, 0, {0, 0, 0}}, {0.03f, {1, 1, 1}, 1, {0, 0, 0}}};
    static const sps_transfer skin = {points, 2, NULL, NULL, 0};
    const double middle = 1 / 400.0 - 1;
    int size = 400;
    for (int filling = SPS_FILLING_SPLAT; filling <= SPS_FILLING_GATHER; ++filling) {
        double sum[2] = {0, 0};
        check_scene s;
        start_ends(&s, &size);
        check_set3(s.view.camera.position, middle, middle, 4);
        check_set3(s.view.camera.target, middle, middle, middle);
        check_orthographic(&s.view.camera, 0.03);
        check_add_directional(&s, 1, 0, 0, 1)->no_shadow = 1;
        s.volume[0].transfer = &skin;
        s.volume[0].shading = SPS_SHADING_SURFACE;
        s.volume[0].gradient_full = 1e-3f;
        s.view.filling = (sps_filling)filling;
        if (!check_render(context, &s, image_a)) return;
        CHECK(((const spsi_pyramid *)context->buffers[SPSI_BUFFER_PYRAMIDS].data)->levels[0]->count > 0);
        for (int i = 0; i < SIDE * SIDE; ++i) sum[i % SIDE >= SIDE / 2] += (double)image_a[4 * i];
        CHECK(sum[0] > 0 && sum[1] <= 0.01 * sum[0]);
    }
}

/* Bytes that are planned follow from what is read, not from the box. Two blocks of up to 32^3 voxels are 128 bricks:
   each lies within reach of 27 on every level, of 8 planes and 192 bytes, and grids have at most 9 * (65536 + 64 * 128)
   cells of 12 bytes. */
static void test_thin_bytes(void) {
    int size = 2000;
    size_t bytes[2];
    check_scene s;
    start_ends(&s, &size);
    for (int i = 0; i < 2; ++i) {
        sps_plan_report plan;
        s.view.filling = i ? SPS_FILLING_GATHER : SPS_FILLING_SPLAT;
        if (!CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan))) return;
        bytes[i] = plan.pass[SPS_PASS_GATHER].bytes;
    }
    CHECK(bytes[1] - bytes[0] <= sizeof(spsi_pyramid) + 2 * 484 + 9 * (27 * 128 * 4064 + 9 * (65536 + 64 * 128) * 12));
}

/* --- what is held, counted, planned --- */

/* Fields are made anew where values or the number of taps change, and only then. Pictures do not depend on what a
   context has held, on workers or on the region. */
static void test_held(void) {
    check_scene s;
    sps_context *fresh = check_context(NULL);
    start_kind(&s, MIXED);
    s.volume[0].revision = s.volume[1].revision = 1;
    check_render(context, &s, image_a);
    check_render(context, &s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    s.view.quality = SPS_QUALITY_HIGH;
    check_render(context, &s, image_a);
    check_render(fresh, &s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    s.volume[0].user = lumps, s.volume[0].revision = 2;
    check_render(context, &s, image_b);
    CHECK(memcmp(image_a, image_b, sizeof image_a) != 0);
    check_render(fresh, &s, image_a);
    CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
    sps_destroy(fresh);
}

/* Nor do tables, whose texels are filled either way. */
static void test_held_table(void) {
    check_scene s;
    start_kind(&s, TABLE);
    s.volume[0].revision = 1;
    for (int way = SPS_FILLING_SPLAT; way <= SPS_FILLING_GATHER; ++way) {
        sps_context *fresh = check_context(NULL);
        s.view.filling = (sps_filling)way;
        check_render(context, &s, image_a);
        check_render(fresh, &s, image_b);
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        sps_destroy(fresh);
    }
}

/* The plan's pass of reading includes fields, whose bound is the difference from splatting. In pictures as small as
   these a gas has levels, and what is classified beside it has none: a mean's look is not the mean of looks. */
static void test_bytes(void) {
    static const int own[] = {SPSI_BUFFER_PYRAMIDS,    SPSI_BUFFER_PYRAMID_GRIDS, SPSI_BUFFER_PYRAMID_VALUES,
                              SPSI_BUFFER_LEVEL_GRIDS, SPSI_BUFFER_LEVEL_VALUES,  SPSI_BUFFER_THIRDS};
    for (int kind = GAS; kind <= MIXED; kind += MIXED) {
        sps_context *fresh = check_context(NULL);
        const spsi_pyramid *fields;
        sps_plan_report plans[2];
        sps_stats_report stats;
        check_scene s;
        size_t bytes = 0;
        start_kind(&s, kind);
        check_orthographic(&s.view.camera, 20);
        for (int i = 0; i < 2; ++i) {
            s.view.filling = i ? SPS_FILLING_GATHER : SPS_FILLING_SPLAT;
            s.view.tolerance = i ? 0.1f : 0;
            CHECK_OK(fresh, sps_plan(fresh, &s.scene, &s.view, &plans[i]));
        }
        check_render(fresh, &s, image_a);
        sps_get_stats(fresh, &stats);
        CHECK(stats.bytes_peak <= plans[1].bytes);
        for (int i = 0; i < 6; ++i) bytes += fresh->buffers[own[i]].size;
        CHECK(fresh->buffers[SPSI_BUFFER_LEVEL_VALUES].size > 0);
        fields = (const spsi_pyramid *)fresh->buffers[SPSI_BUFFER_PYRAMIDS].data;
        for (int i = 0; i < s.scene.volume_count; ++i)
            CHECK((fields->levels[i][1].count == 0) == (s.volume[i].transfer != NULL));
        CHECK(bytes > 0 && bytes <= plans[1].pass[SPS_PASS_GATHER].bytes - plans[0].pass[SPS_PASS_GATHER].bytes);
        sps_destroy(fresh);
    }
}

/* The bound on fields is below twice the use where most voxels have bricks of their own: edges of 11 bricks and more.
 */
static void test_bytes_of_dense(void) {
    static const int side = 12 * SPSI_BRICK;
    static float one = 1;
    check_scene s;
    check_clear(&s, 8, 8);
    check_perspective(&s.view.camera, 0.5);
    s.view.filling = SPS_FILLING_GATHER;
    for (int count = 1; count <= 2; ++count) {
        sps_context *fresh = check_context(NULL);
        sps_plan_report plan;
        sps_volume *volume = check_add_volume(&s, side, side, side, check_box(count - 2, -1, -1, count, 1, 1));
        volume->read_fn = check_read_constant, volume->user = &one, volume->extinction = 1;
        CHECK_OK(fresh, sps_plan(fresh, &s.scene, &s.view, &plan));
        const size_t planned = fresh->planned[SPSI_BUFFER_PYRAMID_VALUES];
        check_render(fresh, &s, image_a);
        const size_t used = fresh->buffers[SPSI_BUFFER_PYRAMID_VALUES].size;
        if (!CHECK(used <= planned && 2 * used > planned)) printf("    %zu of %zu\n", used, planned);
        sps_destroy(fresh);
    }
}

static void test_workers_and_failures(void) {
    check_scene s;
    start_kind(&s, MIXED);
    check_workers(&s, image_a, image_b);
    CHECK(check_failing(&s, 0, 4, image_a, image_b) > 8);
    start_kind(&s, GAS);
    check_orthographic(&s.view.camera, 20);
    check_workers(&s, image_a, image_b);
    CHECK(check_failing(&s, 0, 4, image_a, image_b) > 8);
    start_cloud(&s, 3);
    check_add_directional(&s, 1, -1, -0.6, 3);
    check_color(s.volume[0].albedo, 1, 1, 1);
    s.view.tolerance = 1;
    check_workers(&s, image_a, image_b);
    CHECK(check_failing(&s, 0, 4, image_a, image_b) > 8);
}

static void test_bad(void) {
    check_scene s;
    start(&s, noise);
    s.view.filling = (sps_filling)3;
    check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "view.filling is 3");
    s.view.filling = SPS_FILLING_AUTO;
    for (int n = 0; n < 3; ++n) {
        static const float wrong[] = {-0.1f, 1.5f, NAN};
        s.view.tolerance = wrong[n];
        check_fails(context, &s, image_a, SPS_ERROR_ARGUMENT, "view.tolerance is");
    }
}

int main(void) {
    check_random random = {9};
    deep.technique = SPS_TMAP_DEEP;
    for (int i = 0; i < GRID * GRID * GRID; ++i) noise[i] = (float)check_next(&random);
    for (int i = 0; i < GRID * GRID * GRID; ++i) {
        const double x = i % GRID - 7.5, y = i / GRID % GRID - 7.5, z = i / (GRID * GRID) - 7.5;
        ball[i] = (float)exp(-(x * x + y * y + z * z) / (2 * 1.6 * 1.6)); /* 0.2 wide */
    }
    dot[(7 * GRID + 7) * GRID + 7] = 1; /* the last voxel of its brick */
    check_lumps(lumps, GRID);
    context = check_context(NULL);
    RUN(test_samples);
    RUN(test_gradients);
    RUN(test_seen);
    RUN(test_pictures_alike);
    RUN(test_levels);
    RUN(test_small_pictures);
    RUN(test_flat_pictures);
    RUN(test_every_size_gathers);
    RUN(test_pixel_filter);
    RUN(test_small_surfaces);
    RUN(test_middle);
    RUN(test_picture_ends);
    RUN(test_hidden_beside);
    RUN(test_cells);
    RUN(test_steps);
    RUN(test_left_out);
    RUN(test_profiles);
    RUN(test_ended_rays);
    RUN(test_even_surface);
    RUN(test_bends);
    RUN(test_boxes_bend);
    RUN(test_slabs_in_need);
    RUN(test_tolerance);
    RUN(test_tolerance_inside);
    RUN(test_tolerance_before_polygon);
    RUN(test_tolerance_of_small_voxels);
    RUN(test_tolerance_of_light);
    RUN(test_bound_of_lights);
    RUN_LONG(test_tolerance_beside_rods);
    RUN(test_tolerance_of_light_beside_rods);
    RUN(test_not_interpolated);
    RUN(test_samples_alike);
    RUN(test_splatted);
    RUN(test_reasons);
    RUN(test_reasons_of_lights);
    RUN(test_chosen);
    RUN(test_scattered_thinly);
    RUN(test_scattered_surface);
    RUN(test_thin_bytes);
    RUN(test_held);
    RUN(test_held_table);
    RUN(test_bytes);
    RUN(test_bytes_of_dense);
    RUN(test_workers_and_failures);
    RUN(test_bad);
    sps_destroy(context);
    return check_report();
}
