/* Color per voxel, labels, and colors of particles: against mixtures of volumes and sets of one color each, which are
   the same by the superposition of what scatters, against sps_reference and closed forms. */

#include "check.h"

enum { SIDE = 20, VOXELS = SIDE * SIDE * SIDE, WIDTH = 36, HEIGHT = 28, PIXELS = WIDTH * HEIGHT };

static sps_context *context;
static float rgba[4 * PIXELS], exact[4 * PIXELS];

/* --- a cloud of many colors --- */

/* Values, albedo and emission of each voxel. part: 0..7, that of this corner of the color cube alone; -1: all. */
typedef struct cloud {
    float values[VOXELS], albedo[VOXELS][3], emission[VOXELS][3];
    int part;
} cloud;

static cloud all, corners[8];

static void fill_cloud(void) {
    check_random random = {5};
    check_lumps(all.values, SIDE);
    for (int i = 0; i < VOXELS; ++i) {
        const int x = i % SIDE, y = i / SIDE % SIDE, z = i / SIDE / SIDE;
        /* colors whose channels have bricks of their own */
        for (int c = 0; c < 3; ++c) {
            all.albedo[i][c] = (c == 0 && x < 14) || (c == 1 && z > 10)
                                   ? 0
                                   : (float)(0.5 + 0.45 * sin(0.5 * x + 0.7 * y * c + 0.3 * z + c));
            all.emission[i][c] = (float)(check_next(&random) * (y < 4 ? 3 - c : 0));
        }
    }
    all.part = -1;
    for (int n = 0; n < 8; ++n) corners[n] = all, corners[n].part = n;
}

/* The share of a voxel's value that has the color of a corner. */
static float share_of(const cloud *from, int voxel) {
    float share = 1;
    for (int c = 0; c < 3 && from->part >= 0; ++c)
        share *= from->part >> c & 1 ? from->albedo[voxel][c] : 1 - from->albedo[voxel][c];
    return share;
}

static int read_cloud(void *user, const int lo[3], const int size[3], float *out) {
    const cloud *from = (const cloud *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x) {
                const int i = ((lo[2] + z) * SIDE + lo[1] + y) * SIDE + lo[0] + x;
                *out++ = from->values[i] * share_of(from, i);
            }
    return 0;
}

static int color_cloud(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    const cloud *from = (const cloud *)user;
    for (int z = 0, n = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x, n += 3) {
                const int i = ((lo[2] + z) * SIDE + lo[1] + y) * SIDE + lo[0] + x;
                if (albedo) memcpy(albedo + n, from->albedo[i], sizeof from->albedo[i]);
                if (emission) memcpy(emission + n, from->emission[i], sizeof from->emission[i]);
            }
    return 0;
}

/* Emission of one channel, for a volume of its own. */
static int read_glow(void *user, const int lo[3], const int size[3], float *out) {
    const int c = *(const int *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x)
                *out++ = all.emission[((lo[2] + z) * SIDE + lo[1] + y) * SIDE + lo[0] + x][c];
    return 0;
}

static const sps_placement slanted = {{-1, -0.8, -0.9}, {{1.9, 0.2, 0}, {-0.1, 1.8, 0.3}, {0, -0.2, 2}}};

/* The scene with the cloud as one volume, or as eleven. */
static void place_cloud(check_scene *s, sps_volume *volumes, int mixed, sps_volume **first) {
    static int channels[3] = {0, 1, 2};
    int count = 0;
    memset(volumes, 0, 11 * sizeof *volumes);
    for (int n = 0; n < (mixed ? 8 : 1); ++n, ++count) {
        volumes[count].read_fn = read_cloud, volumes[count].user = mixed ? &corners[n] : &all;
        volumes[count].extinction = 4;
        for (int c = 0; c < 3; ++c) volumes[count].albedo[c] = (float)(n >> c & 1);
    }
    if (!mixed) volumes->appearance_fn = color_cloud;
    for (int c = 0; c < 3 && mixed; ++c, ++count) {
        volumes[count].read_fn = read_glow, volumes[count].user = &channels[c];
        volumes[count].emission[c] = 1;
    }
    for (int i = 0; i < count; ++i) {
        volumes[i].placement = slanted;
        for (int k = 0; k < 3; ++k) volumes[i].size[k] = SIDE;
    }
    s->scene.volumes = volumes, s->scene.volume_count = count;
    *first = volumes;
}

/* Pictures with cells are compared with others that have the same: in quick tests, few. */
static void build_scene(check_scene *s) {
    check_clear(s, WIDTH, HEIGHT);
    if (!check_long()) s->view.scattering_resolution = 16;
    check_perspective(&s->view.camera, 0.3);
    check_add_directional(s, 1, -1, -0.5, 3);
    check_add_point(s, -2, 2, 2, 6);
    check_color(s->light[1].color, 6, 3, 2);
}

/* Fields are linear in what voxels hold, so that single scattering, and cells of isotropic gas, differ by rounding
   alone. With a peak, cells take from a volume's extinction the part that its albedo sends straight on: of black and
   white volumes another than of their mixture, 0.5 % apart here. Paths decide. */
static void test_mixture(void) {
    static sps_volume volumes[11];
    static const sps_lobe lobes[1] = {{0.6f, 1}};
    static const double corner[3] = {-3, -1.2, -3}, u[3] = {0, 0, 6}, v[3] = {6, 0, 0};
    const double heights[2] = {2.6, 20}; /* with voxels wider than pixels, and coarser levels */
    check_scene s;
    check_triangles ground;
    sps_volume *first;
    memset(&ground, 0, sizeof ground);
    check_add_quad(&ground, corner, u, v);
    build_scene(&s);
    for (int n = 0; n < 18; ++n) {
        const int cells = n % 2, peaked = n / 2 % 3 == 2;
        if (!check_long() && n > 1 && n != 4 && n != 9 && n != 10) continue;
        s.view.scattering = cells ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        s.view.filling = n < 6 ? SPS_FILLING_AUTO : n < 12 ? SPS_FILLING_SPLAT : SPS_FILLING_GATHER;
        check_orthographic(&s.view.camera, heights[n / 3 % 2]);
        s.scene.mesh_count = 0;
        if (n % 5 == 1) check_add_mesh(&s, &ground, 0.6);
        place_cloud(&s, volumes, 1, &first);
        for (int i = 0; i < 8 && peaked; ++i) volumes[i].lobes = lobes, volumes[i].lobe_count = 1;
        if (!check_render(context, &s, exact)) return;
        place_cloud(&s, volumes, 0, &first);
        if (peaked) first->lobes = lobes, first->lobe_count = 1;
        if (!check_render(context, &s, rgba)) return;
        const double error = error_of(rgba, exact, PIXELS);
        if (figures()) printf("mixture %d: %g\n", n, error);
        /* in a small picture, each volume chooses its own level */
        const int leveled = n / 3 % 2 == 1 && s.view.filling != SPS_FILLING_SPLAT;
        CHECK_CASE("Volumes", "colors per voxel against a volume of each", "mixture; relative", error,
                   leveled || (cells && peaked) ? 0.02
                   : cells                      ? 1e-3
                                                : 1e-5,
                   "rounding; with a peak, volumes' own albedo; in small pictures, volumes' own levels");
    }
    check_free_triangles(&ground);
}

static int color_purple(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    (void)user, (void)lo, (void)emission;
    for (int i = 0; i < size[0] * size[1] * size[2] && albedo; ++i) check_color(albedo + 3 * i, 0.9, 0, 0.4);
    return 0;
}

/* One color of all voxels, without green, is that of a volume. Coarser levels, gathered and splatted. */
static void test_one_color(void) {
    static sps_volume volumes[11];
    check_scene s;
    sps_volume *first;
    build_scene(&s);
    check_orthographic(&s.view.camera, 20);
    for (int filling = SPS_FILLING_AUTO; filling <= SPS_FILLING_GATHER; ++filling) {
        s.view.filling = (sps_filling)filling;
        place_cloud(&s, volumes, 0, &first);
        first->appearance_fn = color_purple;
        if (!check_render(context, &s, rgba)) return;
        first->appearance_fn = NULL;
        check_color(first->albedo, 0.9, 0, 0.4);
        if (!check_render(context, &s, exact)) return;
        CHECK_NEAR(error_of(rgba, exact, PIXELS), 0, 1e-5); /* rounding */
    }
}

static void test_cloud_paths(void) {
    static sps_volume volumes[11];
    static const sps_lobe lobes[1] = {{0.6f, 1}};
    check_scene s;
    sps_volume *first;
    build_scene(&s);
    place_cloud(&s, volumes, 0, &first);
    first->lobes = lobes, first->lobe_count = 1;
    s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 0;
    check_paths(context, &s, "colors per voxel", 12, 0.03);
}

/* The reference reads colors by its own sums in doubles. Light once scattered and forward: errors of slabs. */
static void test_reference(void) {
    static sps_volume volumes[11];
    check_scene s;
    sps_volume *first;
    build_scene(&s);
    place_cloud(&s, volumes, 0, &first);
    for (int forward = 0; forward < 2; ++forward) {
        s.view.scattering = forward ? SPS_SCATTERING_FORWARD : SPS_SCATTERING_SINGLE;
        if (!check_render(context, &s, rgba) || !check_march(context, &s, 0.25, exact, NULL)) return;
        const double error = error_of(rgba, exact, PIXELS);
        if (figures()) printf("reference, forward %d: %g\n", forward, error);
        CHECK_CASE("Volumes", "colors per voxel", "sps_reference; relative", error, 0.02, "slabs, medium quality");
    }
}

/* --- labels --- */

/* A ball of label 1 within a ball of label 3, and nothing of label 2, which lies between them; a sheet of one voxel of
   label 4 apart. Values are label / 4. */
static int read_labels(void *user, const int lo[3], const int size[3], float *out) {
    (void)user;
    for (int z = lo[2]; z < lo[2] + size[2]; ++z)
        for (int y = lo[1]; y < lo[1] + size[1]; ++y)
            for (int x = lo[0]; x < lo[0] + size[0]; ++x) {
                const double r = hypot(hypot(x - 9.5, y - 11.5), z - 9.5);
                *out++ = y == 1 ? 1 : r < 3 ? 0.25f : r < 6 ? 0.75f : 0;
            }
    return 0;
}

/* The same as extinction and color, for comparison: the look of a label. */
static const sps_transfer_point looks[] = {
    {0.12f, {0, 0, 0}, 0, {0, 0, 0}},          {0.13f, {1, 0.4f, 0.2f}, 9, {0, 0, 0}},
    {0.37f, {1, 0.4f, 0.2f}, 9, {0, 0, 0}},    {0.38f, {0, 1, 0}, 5, {0, 4, 0}},
    {0.62f, {0, 1, 0}, 5, {0, 4, 0}},          {0.63f, {0.2f, 0.5f, 0.9f}, 3, {0, 0, 1}},
    {0.87f, {0.2f, 0.5f, 0.9f}, 3, {0, 0, 1}}, {0.88f, {0.8f, 0.8f, 0.8f}, 6, {0, 0, 0}}};

static sps_transfer_point greys[8];
static const sps_transfer_point *shown = looks; /* by color_looks */

static int read_looks(void *user, const int lo[3], const int size[3], float *out) {
    const size_t count = (size_t)size[0] * (size_t)size[1] * (size_t)size[2];
    read_labels(user, lo, size, out);
    for (size_t i = 0; i < count; ++i) out[i] = out[i] > 0.9f ? 6 : out[i] > 0.5f ? 3 : out[i] > 0.1f ? 9 : 0;
    return 0;
}

static int color_looks(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    const int count = size[0] * size[1] * size[2];
    float *labels = (float *)malloc((size_t)count * sizeof *labels);
    if (!labels) return 1;
    read_labels(user, lo, size, labels);
    for (int i = 0; i < count; ++i) {
        const int n = labels[i] > 0.9f ? 7 : labels[i] > 0.5f ? 5 : 1;
        if (albedo && labels[i] > 0) memcpy(albedo + 3 * i, shown[n].albedo, sizeof shown[n].albedo);
        if (emission && labels[i] > 0) memcpy(emission + 3 * i, shown[n].emission, sizeof shown[n].emission);
    }
    free(labels);
    return 0;
}

static void test_labels(void) {
    static const sps_transfer all_looks = {looks, 8, NULL, NULL, 0}, all_greys = {greys, 8, NULL, NULL, 0};
    sps_transfer_point green[5];
    sps_transfer only_green = {green, 5, NULL, NULL, 0};
    check_scene s;
    build_scene(&s);
    check_orthographic(&s.view.camera, 2.2);
    sps_volume *volume = check_add_volume(&s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = read_labels, volume->transfer = &all_looks, volume->classify_voxels = 1;
    memcpy(greys, looks, sizeof greys);
    for (int i = 0; i < 8; ++i) greys[i].albedo[1] = greys[i].albedo[2] = greys[i].albedo[0];
    for (int mode = 0; mode < 3; ++mode) { /* the same extinctions and colors in two ways; greys share a channel */
        s.view.scattering = mode == 1 ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        shown = mode == 2 ? greys : looks;
        volume->read_fn = read_labels, volume->transfer = mode == 2 ? &all_greys : &all_looks;
        volume->classify_voxels = 1;
        volume->appearance_fn = NULL;
        if (!check_render(context, &s, exact)) return;
        volume->read_fn = read_looks, volume->appearance_fn = color_looks, volume->extinction = 1;
        volume->transfer = NULL, volume->classify_voxels = 0;
        if (!check_render(context, &s, rgba)) return;
        CHECK_NEAR(error_of(rgba, exact, PIXELS), 0, 1e-5);
    }
    memcpy(green, looks + 2, sizeof green);
    green[0].extinction = green[3].extinction = green[4].extinction = 0;
    memset(green[3].emission, 0, sizeof green[3].emission), memset(green[4].emission, 0, sizeof green[4].emission);
    volume->read_fn = read_labels, volume->transfer = &only_green, volume->appearance_fn = NULL;
    volume->classify_voxels = 1;
    if (!check_render(context, &s, rgba)) return;
    for (int i = 0; i < 4 * PIXELS; ++i) CHECK(!(rgba[i] > 0)); /* there is no voxel of it */
    volume->classify_voxels = 0;
    if (!check_render(context, &s, rgba)) return;
    CHECK(brightest_of(rgba, PIXELS) > 0); /* between labels 1 and 3, interpolation passes through it */
}

/* A sheet of one voxel keeps its optical depth wherever thresholds are: its kernels' integral is a voxel's edge. */
static void test_sheet(void) {
    check_scene s;
    build_scene(&s);
    s.scene.light_count = 0;
    check_orthographic(&s.view.camera, 0.2);
    s.view.camera.position[0] = 0, s.view.camera.position[1] = 10, s.view.camera.position[2] = 0;
    s.view.camera.up[1] = 0, s.view.camera.up[2] = 1;
    sps_volume *volume = check_add_volume(&s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = read_labels, volume->classify_voxels = 1;
    for (int n = 1; n < 8; ++n) {
        const float threshold = 0.76f + 0.03f * (float)n;
        const sps_transfer_point points[2] = {{threshold, {0, 0, 0}, 0, {0, 0, 0}},
                                              {threshold + 0.01f, {0, 0, 0}, 6, {0, 0, 0}}};
        const sps_transfer transfer = {points, 2, NULL, NULL, 1};
        volume->transfer = &transfer;
        if (!check_render(context, &s, rgba)) return;
        const double depth = -log1p(-(double)rgba[4 * (PIXELS / 2 + WIDTH / 2) + 3]);
        CHECK_CASE("Volumes", "a sheet of one voxel, by thresholds", "optical depth; relative", fabs(depth / 0.6 - 1),
                   4e-3, "kernels' ripple");
    }
}

/* Surfaces are shaded by the gradient of extinction, as the reference has it. */
static void test_surfaces(void) {
    static const sps_transfer all_looks = {looks, 8, NULL, NULL, 0};
    check_scene s;
    build_scene(&s);
    check_orthographic(&s.view.camera, 2.2);
    s.view.width = 18, s.view.height = 14;
    sps_volume *volume = check_add_volume(&s, SIDE, SIDE, SIDE, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = read_labels, volume->transfer = &all_looks, volume->classify_voxels = 1;
    volume->shading = SPS_SHADING_SURFACE, volume->specular = 0.4f;
    if (!check_render(context, &s, rgba) || !check_march(context, &s, 0.25, exact, NULL)) return;
    const double error = error_of(rgba, exact, 18 * 14);
    if (figures()) printf("labels as surfaces: %g\n", error);
    CHECK_CASE("Volumes", "labels as surfaces", "sps_reference; relative", error, 0.05, "slabs, medium quality");
    volume->shading = SPS_SHADING_GAS;
    if (!check_render(context, &s, exact)) return;
    CHECK(error_of(rgba, exact, 18 * 14) > 0.1);
}

/* --- maps --- */

static int only_albedo(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    (void)emission;
    return color_cloud(user, lo, size, albedo, NULL);
}

/* Colors do not matter to a map. */
static void test_maps(void) {
    static sps_volume volumes[11];
    check_scene s;
    sps_volume *first;
    double points[3 * 64];
    float depths[2][64];
    build_scene(&s);
    place_cloud(&s, volumes, 0, &first);
    check_random random = {9};
    for (int i = 0; i < 3 * 64; ++i) points[i] = 1.6 * check_next(&random) - 0.8;
    for (int n = 0; n < 2; ++n) {
        sps_tmap_light light = check_light_of(&s.view);
        sps_tmap_settings settings;
        sps_tmap *map;
        memset(&settings, 0, sizeof settings);
        settings.near_depth = 5, settings.far_depth = 15, settings.technique = SPS_TMAP_DEEP;
        first->appearance_fn = n ? only_albedo : NULL;
        if (!CHECK_OK(context, sps_tmap_create(context, &light, &settings, &map))) return;
        if (CHECK_OK(context, sps_tmap_add(map, &s.scene)) && CHECK_OK(context, sps_tmap_finish(map)))
            CHECK(sps_tmap_query(map, 64, points, depths[n], NULL) == SPS_OK);
        sps_tmap_destroy(map);
    }
    CHECK(memcmp(depths[0], depths[1], sizeof *depths) == 0 && depths[0][0] > 0);
}

/* --- particles --- */

enum { BALLS = 60, DYES = 4 };

static sps_particle balls[BALLS];

/* One set of balls of several colors, or a set of each color, or one of the first half and one without albedos of its
   own for each other color. */
static void place_balls(check_scene *s, sps_particles *sets, int apart, int soft) {
    static sps_particle unread[BALLS]; /* albedos that do not count */
    const int count = apart == 2 ? 1 + DYES / 2 : apart ? DYES : 1;
    memset(sets, 0, DYES * sizeof *sets);
    memcpy(unread, balls, sizeof unread);
    for (int i = 0; i < BALLS; ++i) unread[i].albedo[i % 3] = 1 - unread[i].albedo[i % 3];
    for (int n = 0, first = 0; n < count; first += (int)sets[n++].count) {
        sets[n].count = apart == 2 && n == 0 ? BALLS / 2 : apart ? BALLS / DYES : BALLS;
        sets[n].read_fn = check_read_particles;
        sets[n].soft = soft, sets[n].has_albedos = !apart || (apart == 2 && n == 0);
        sets[n].user = (sets[n].has_albedos ? balls : unread) + first;
        memcpy(sets[n].albedo, balls[first].albedo, sizeof sets[n].albedo);
        for (int c = 0; c < 3; ++c) sets[n].emission[c] = s->view.scattering == SPS_SCATTERING_SINGLE ? 0.1f : 0;
    }
    s->scene.particles = sets, s->scene.particle_set_count = count;
}

/* The same balls, in one set or in one for each color: sums are linear in extinction, and in it times albedo. Radii of
   two pixels and more, which the reference's rays resolve. One has no radius. */
static void test_particles(void) {
    static sps_particles sets[DYES];
    check_random random = {3};
    check_scene s;
    build_scene(&s);
    for (int i = 0; i < BALLS; ++i) {
        for (int k = 0; k < 3; ++k) balls[i].position[k] = (float)(2 * check_next(&random) - 1);
        for (int c = 0; c < 3; ++c) balls[i].albedo[c] = (float)check_next(&random);
        if (i % (BALLS / DYES) > 0) memcpy(balls[i].albedo, balls[i - 1].albedo, sizeof balls[i].albedo);
        balls[i].radius = (float)(0.2 + 0.2 * check_next(&random));
        balls[i].optical_depth = (float)(0.5 * check_next(&random));
    }
    balls[20].radius = 0;
    for (int n = 0; n < 6; ++n) {
        const int cells = n % 2;
        s.view.scattering = cells ? SPS_SCATTERING_MULTIPLE : SPS_SCATTERING_SINGLE;
        check_orthographic(&s.view.camera, n < 4 ? 2.6 : 20);
        place_balls(&s, sets, 1, n / 2 % 2);
        if (!check_render(context, &s, exact)) return;
        place_balls(&s, sets, n == 4 ? 2 : 0, n / 2 % 2);
        if (!check_render(context, &s, rgba)) return;
        const double error = error_of(rgba, exact, PIXELS);
        if (figures()) printf("particles %d: %g\n", n, error);
        CHECK_CASE("Particles", "albedo of each against a set of each color", "sets apart; relative", error, 1e-5,
                   "rounding");
    }
    check_perspective(&s.view.camera, 0.3);
    s.view.scattering = SPS_SCATTERING_SINGLE;
    double errors[2];
    for (int colored = 0; colored < 2; ++colored) { /* particles of one color err by their slabs */
        sets->has_albedos = colored;
        check_color(sets->albedo, 0.5, 0.5, 0.5);
        if (!check_render(context, &s, rgba) || !check_march(context, &s, 0.25, exact, NULL)) return;
        errors[colored] = error_of(rgba, exact, PIXELS);
    }
    if (figures()) printf("particles, reference: %g, of one color %g\n", errors[1], errors[0]);
    CHECK_CASE("Particles", "albedo of each", "sps_reference; relative", errors[1], 1.2 * errors[0],
               "a fifth more than without albedos");
    s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 0;
    check_paths(context, &s, "albedo of each particle", 8, 0.03);
    if (!check_long()) s.view.scattering_resolution = 16;
    for (int n = 0; n < 2; ++n) { /* cells are made anew for other colors */
        sps_context *fresh = sps_create(NULL, NULL);
        for (int i = 0; i < BALLS && n; ++i) balls[i].albedo[i % 3] *= 0.5f;
        if (!CHECK(fresh) || !check_render(context, &s, rgba) || !check_render(fresh, &s, exact)) return;
        CHECK(check_same(&s, rgba, exact));
        sps_destroy(fresh);
    }
    balls[7].albedo[1] = 1.5f;
    check_fails(context, &s, rgba, SPS_ERROR_DATA, "particle[7].albedo is 1.5; red, green and blue must be 0..1");
}

/* A set has its own color beside one whose particles have theirs, also for the light that it keeps within. */
static void test_beside(void) {
    static sps_particles sets[DYES];
    check_random random = {4};
    check_scene s;
    build_scene(&s);
    check_orthographic(&s.view.camera, 2.6);
    s.view.width = WIDTH / 2, s.view.height = HEIGHT / 2;
    s.view.scattering = SPS_SCATTERING_MULTIPLE, s.view.scattering_resolution = 8;
    for (int i = 0; i < BALLS; ++i) {
        for (int k = 0; k < 3; ++k) balls[i].position[k] = (float)(2 * check_next(&random) - 1);
        check_color(balls[i].albedo, i < BALLS / 2 ? 0.9 : 0.1, i < BALLS / 2 ? 0.2 : 0.9, 0.5);
        balls[i].radius = 0.1f, balls[i].optical_depth = 2;
    }
    for (int colored = 0; colored < 2; ++colored) {
        place_balls(&s, sets, 2, 0);
        sets->has_albedos = colored;
        for (int n = 0; n < s.scene.particle_set_count; ++n) check_color(sets[n].emission, 3, 2, 1);
        if (!check_render(context, &s, colored ? rgba : exact)) return;
    }
    if (figures()) printf("beside: %g\n", error_of(rgba, exact, WIDTH / 2 * HEIGHT / 2));
    CHECK_NEAR(error_of(rgba, exact, WIDTH / 2 * HEIGHT / 2), 0, 1e-5); /* rounding */
}

/* A context that holds voxels reads them again when colors come, go or change. */
static void test_held(void) {
    static sps_volume volumes[11];
    check_scene s;
    sps_volume *first;
    build_scene(&s);
    place_cloud(&s, volumes, 0, &first);
    first->revision = 3;
    s.view.scattering = SPS_SCATTERING_MULTIPLE;
    for (int n = 0; n < 5; ++n) {
        sps_context *fresh = sps_create(NULL, NULL);
        first->appearance_fn = n == 1 ? NULL : n == 2 ? only_albedo : color_cloud;
        if (n == 4) first->revision = 4, all.albedo[VOXELS / 2 + SIDE / 2][1] = 0.01f;
        if (!CHECK(fresh) || !check_render(context, &s, rgba) || !check_render(fresh, &s, exact)) return;
        CHECK(check_same(&s, rgba, exact));
        sps_destroy(fresh);
    }
}

/* --- errors --- */

typedef struct wrong_color {
    float albedo, emission;
    int result;
} wrong_color;

static int color_wrongly(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    const wrong_color *wrong = (const wrong_color *)user;
    const int there = lo[2] <= 3 && lo[2] + size[2] > 3, at = ((3 - lo[2]) * size[1] + 2) * size[0] + 1;
    if (albedo && there) albedo[3 * at + 1] = wrong->albedo;
    if (emission && there) emission[3 * at + 2] = wrong->emission;
    return wrong->result;
}

static int read_even(void *user, const int lo[3], const int size[3], float *out) {
    (void)user, (void)lo;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i) out[i] = 0.5f;
    return 0;
}

static int read_spoilt(void *user, const int lo[3], const int size[3], float *out) {
    read_even(user, lo, size, out);
    if (lo[2] <= 3 && lo[2] + size[2] > 3) out[((3 - lo[2]) * size[1] + 2) * size[0] + 1] = -1;
    return 0;
}

static void test_errors(void) {
    static const sps_transfer transfer = {looks, 8, NULL, NULL, 0};
    static const struct {
        wrong_color wrong;
        sps_result result;
        const char *words;
    } rows[] = {{{-0.5f, 0, 0}, SPS_ERROR_DATA, "appearance_fn's albedo is -0.5; values must be 0..1 (voxel 1,2,3)"},
                {{1.5f, 0, 0}, SPS_ERROR_DATA, "appearance_fn's albedo is 1.5"},
                {{NAN, 0, 0}, SPS_ERROR_DATA, "appearance_fn's albedo is"},
                {{0, -1, 0}, SPS_ERROR_DATA, "appearance_fn's emission is -1; values must be 0..1e18 (voxel 1,2,3)"},
                {{0, INFINITY, 0}, SPS_ERROR_DATA, "appearance_fn's emission is inf"},
                {{0, 0, 7}, SPS_ERROR_CALLBACK, "appearance_fn"}};
    check_scene s;
    build_scene(&s);
    sps_volume *volume = check_add_volume(&s, SIDE, 12, 9, check_box(-1, -1, -1, 1, 1, 1));
    volume->read_fn = read_even, volume->appearance_fn = color_wrongly, volume->extinction = 1;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i) {
        wrong_color wrong = rows[i].wrong;
        volume->user = &wrong;
        check_fails(context, &s, rgba, rows[i].result, rows[i].words);
        s.scene.replace_invalid = 1;
        sps_stats_report stats;
        if (wrong.result == 0 && check_render(context, &s, rgba)) {
            sps_get_stats(context, &stats);
            CHECK(stats.values_replaced == 1);
        }
        s.scene.replace_invalid = 0;
    }
    wrong_color valid = {0.5f, 0, 0}; /* a value is replaced once, though channels read it, too */
    sps_stats_report stats;
    volume->read_fn = read_spoilt, volume->user = &valid, s.scene.replace_invalid = 1;
    if (check_render(context, &s, rgba)) sps_get_stats(context, &stats), CHECK(stats.values_replaced == 1);
    volume->read_fn = read_even, s.scene.replace_invalid = 0;
    volume->transfer = &transfer;
    check_fails(context, &s, rgba, SPS_ERROR_ARGUMENT, "appearance_fn");
    volume->appearance_fn = NULL, volume->classify_voxels = 1; /* no bounds are known, whatever the colors */
    static float bounds[2][3 * PIXELS];
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    image.rgba = rgba, settings.step = 1, settings.lower = bounds[0], settings.upper = bounds[1];
    if (!CHECK(sps_reference(context, &s.scene, &s.view, &settings, &image) == SPS_ERROR_UNSUPPORTED))
        printf("    %s\n", sps_error(context));
    volume->classify_voxels = 0;
    volume->transfer = NULL, volume->appearance_fn = NULL, volume->classify_voxels = 1;
    check_fails(context, &s, rgba, SPS_ERROR_ARGUMENT, "classify_voxels");
}

int main(void) {
    context = sps_create(NULL, NULL);
    if (!CHECK(context)) return check_report();
    fill_cloud();
    RUN(test_mixture);
    RUN(test_one_color);
    RUN_LONG(test_cloud_paths);
    RUN_LONG(test_reference);
    RUN(test_labels);
    RUN(test_sheet);
    RUN_LONG(test_surfaces);
    RUN(test_maps);
    RUN(test_particles);
    RUN(test_beside);
    RUN(test_held);
    RUN(test_errors);
    sps_destroy(context);
    return check_report();
}
