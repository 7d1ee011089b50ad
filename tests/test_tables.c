/* Shadow tables: against closed forms, sheets and the reference; errors that fall with the size; tables that are held
   from call to call equal new ones after each kind of change; memory, workers, failures. */

#include "check.h"

enum { SIDE = 32, COUNT = 4 * SIDE * SIDE, PARTICLES = 60 };
static float image_a[COUNT], image_b[COUNT];
static sps_context *context;
static check_triangles ground;
static sps_tmap_settings table; /* of all lights */

/* --- scenes --- */

static int read_blob(void *user, const int low[3], const int size[3], float *out) {
    const int n = *(const int *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y)
            for (int x = 0; x < size[0]; ++x) {
                const double p[3] = {2 * (low[0] + x + 0.5) / n - 1, 2 * (low[1] + y + 0.5) / n - 1,
                                     2 * (low[2] + z + 0.5) / n - 1};
                const double ripples = 0.15 * sin(9 * p[0]) * cos(8 * p[1]) * sin(7 * p[2] + 1);
                *out++ = (float)fmin(fmax(2 * (0.75 + ripples - vec_length(p)), 0), 1);
            }
    return 0;
}

static sps_particle swarm[PARTICLES];

static const sps_transfer_point points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                            {0.4f, {0.9f, 0.6f, 0.3f}, 0, {0, 0, 0}},
                                            {0.7f, {0.3f, 0.6f, 0.9f}, 12, {0, 0, 0}}};
static const sps_transfer_point other_points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                  {0.4f, {0.9f, 0.6f, 0.3f}, 0, {0, 0, 0}},
                                                  {0.7f, {0.3f, 0.6f, 0.9f}, 9, {0, 0, 0}}};
static const sps_transfer_point wide_points[] = {{0, {0.5f, 0.5f, 0.5f}, 0, {0, 0, 0}},
                                                 {0.8f, {0.9f, 0.6f, 0.3f}, 0, {0, 0, 0}},
                                                 {1.4f, {0.3f, 0.6f, 0.9f}, 12, {0, 0, 0}}};
static const sps_transfer tissue = {points, 3, NULL, NULL, 0}, other_tissue = {other_points, 3, NULL, NULL, 0};
static const sps_transfer wide_tissue = {wide_points, 3, NULL, NULL, 0}; /* that of `tissue` at half the value */

enum { GAS, SURFACE, SWARM, KINDS };
static const char *const names[] = {"gas", "surface", "particles"};

/* Something that casts shadows on itself and on a ground, under one light. */
static sps_light *start(check_scene *s, int kind, sps_light_kind light) {
    static int voxels = 28;
    static sps_particles set;
    const double origin[3] = {-3, -1, -3}, u[3] = {6, 0, 0}, v[3] = {0, 0, 6};
    check_random random = {77};
    sps_volume *volume;
    check_clear(s, SIDE, SIDE);
    ground.count = 0;
    check_add_quad(&ground, origin, u, v);
    check_add_mesh(s, &ground, 0.5)->revision = 1;
    check_set3(s->view.camera.position, 1.5, 2, 5);
    check_perspective(&s->view.camera, 0.6);
    if (kind == SWARM) {
        for (int i = 0; i < PARTICLES; ++i) {
            for (int k = 0; k < 3; ++k) swarm[i].position[k] = (float)(1.4 * check_next(&random) - 0.7);
            swarm[i].radius = (float)(0.1 + 0.15 * check_next(&random));
            swarm[i].optical_depth = 0.6f;
        }
        memset(&set, 0, sizeof set);
        set.count = PARTICLES;
        set.read_fn = check_read_particles, set.user = swarm;
        check_color(set.albedo, 0.8, 0.7, 0.9);
        s->scene.particles = &set, s->scene.particle_set_count = 1;
    } else {
        volume = check_add_volume(s, voxels, voxels, voxels, check_box(-1, -1, -1, 1, 1, 1));
        volume->read_fn = read_blob;
        volume->user = &voxels;
        volume->revision = 1;
        volume->extinction = 3;
        check_color(volume->albedo, 0.9, 0.8, 0.7);
        if (kind == SURFACE) volume->transfer = &tissue, volume->shading = SPS_SHADING_SURFACE;
    }
    if (light == SPS_LIGHT_DIRECTIONAL) return check_add_directional(s, 0.5, -1, -0.4, 3);
    return check_add_point(s, -1.5, 3, 1.2, 40);
}

/* --- how right they are --- */

static int read_full(void *user, const int low[3], const int size[3], float *out) {
    (void)user, (void)low;
    for (int64_t i = 0; i < (int64_t)size[0] * size[1] * size[2]; ++i) out[i] = 1;
    return 0;
}

/* Light straight down through an even slab of gas: the ground beneath has exp(-optical depth) of it, within a step of
   16 / 65535 and the ripple of kernels, 0.4 % of the depth at most. */
static void test_even_slab(void) {
    static const double depths[] = {0.1, 1, 4, 9, 15.5, 30};
    for (size_t i = 0; i < sizeof depths / sizeof *depths; ++i) {
        check_scene s;
        sps_volume *slab;
        double lit;
        start(&s, SWARM, SPS_LIGHT_DIRECTIONAL);
        s.scene.particle_set_count = 0;
        check_set3(s.light[0].direction, 0, -1, 0);
        slab = check_add_volume(&s, 40, 16, 40, check_box(-4, 0, -4, 4, 1, 4));
        slab->read_fn = read_full;
        slab->extinction = (float)depths[i];
        check_set3(s.view.camera.position, 0, -0.3, 0); /* between the slab and the ground */
        check_set3(s.view.camera.target, 0.01, -1, 0);
        s.view.region[2] = s.view.region[3] = 1, s.view.region[0] = s.view.region[1] = SIDE / 2;
        s.light[0].no_shadow = 1;
        check_render(context, &s, image_b);
        s.light[0].no_shadow = 0;
        s.light[0].shadow_map = &table;
        check_render(context, &s, image_a);
        lit = (double)image_a[0] / (double)image_b[0];
        if (figures()) printf("slab of %g: lit %.6f, exactly %.6f\n", depths[i], lit, exp(-depths[i]));
        CHECK_NEAR(lit, exp(-fmin(depths[i], 16)),
                   exp(-fmin(depths[i], 16)) * (0.004 * fmin(depths[i], 16) + 3e-4) + 2e-6);
    }
}

/* A table against sheets of the same quality, whose texels and slabs are as wide as its entries: 0.5 % of the mean.
   Those of particles are finer where an optical depth of 0.7 radii is above 0.0875: here it is 0.35 times 0.2. */
static void test_against_sheets(void) {
    for (int kind = 0; kind < KINDS; ++kind)
        for (int light = 0; light < 2; ++light) {
            check_scene s;
            double error;
            start(&s, kind, light ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL);
            for (int i = 0; i < PARTICLES && kind == SWARM; ++i) swarm[i].optical_depth = 0.2f;
            s.view.quality = SPS_QUALITY_HIGH;
            check_render(context, &s, image_a);
            s.light[0].shadow_map = &table;
            check_render(context, &s, image_b);
            error = check_rms(image_a, image_b, COUNT) / check_mean(image_a, COUNT);
            if (figures())
                printf("%s, %s: rms difference to sheets %.5f of the mean\n", names[kind], light ? "point" : "sun",
                       error);
            CHECK(error < 0.005);
        }
}

/* Twice the size, a quarter of the error, until that of the sheets shows: trilinear lookups. */
static void test_sizes(void) {
    static const int sizes[] = {8, 16, 32, 64};
    double errors[4];
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.view.quality = SPS_QUALITY_HIGH;
    check_render(context, &s, image_a);
    s.light[0].shadow_map = &table;
    for (int i = 0; i < 4; ++i) {
        s.light[0].shadow_map_resolution = sizes[i];
        check_render(context, &s, image_b);
        errors[i] = check_rms(image_a, image_b, COUNT) / check_mean(image_a, COUNT);
        if (figures()) printf("table of %d: %.5f of the mean\n", sizes[i], errors[i]);
        if (i > 0) CHECK(errors[i] < 0.5 * errors[i - 1] || errors[i] < 0.002);
    }
    CHECK(errors[3] < 0.005 && errors[0] > 0.02);
}

/* A light amid the gas, where sheets cannot serve: six faces, against the reference. Close to a light slabs are coarse:
   what a deep map, which is exact along its texels' rays, is off by is measured beside it. */
static void test_light_within(void) {
    static const int region[4] = {16, 14, 8, 8};
    sps_tmap_settings settings = table;
    check_scene s;
    double errors[2], mean = 0;
    start(&s, GAS, SPS_LIGHT_POINT);
    check_set3(s.light[0].position, 0.25, 0.1, 0.1);
    check_color(s.light[0].color, 1, 1, 1);
    memcpy(s.view.region, region, sizeof region);
    s.view.quality = SPS_QUALITY_HIGH;
    s.light[0].shadow_map = &settings;
    check_march(context, &s, 0.25, image_b, NULL);
    for (int i = 0; i < 256; ++i) mean += (double)image_b[i] / 256;
    for (int deep = 0; deep < 2; ++deep) {
        settings.technique = deep ? SPS_TMAP_DEEP : SPS_TMAP_TABLE;
        check_render(context, &s, image_a);
        errors[deep] = check_rms(image_a, image_b, 256) / mean;
    }
    if (figures()) printf("light within: rms error %.5f of the mean, by a deep map %.5f\n", errors[0], errors[1]);
    CHECK_CASE("Extremes", "light inside the gas, by a table", "brute force, rms of the mean", errors[0],
               errors[1] + 0.002, "a deep map's error, and 0.2 % for the table's planes");
}

/* --- what is held --- */

static sps_stats_report render_stats(const check_scene *s, float *image) {
    sps_stats_report stats;
    check_render(context, s, image);
    sps_get_stats(context, &stats);
    return stats;
}

/* After a change, the picture is that of a context which has held nothing, and the table was made anew; or, if the
   change does not concern the table, it was held. */
static void check_change(const check_scene *s, int held, const char *what) {
    sps_context *fresh = check_context(NULL);
    const sps_stats_report stats = render_stats(s, image_a);
    if (!CHECK(stats.tables_held == (uint64_t)held && stats.tables_made == (uint64_t)!held))
        printf("    %s: %.0f made, %.0f held\n", what, (double)stats.tables_made, (double)stats.tables_held);
    check_render(fresh, s, image_b);
    if (!CHECK(memcmp(image_a, image_b, sizeof image_a) == 0)) printf("    %s\n", what);
    sps_destroy(fresh);
}

static void test_held(void) {
    sps_tmap_settings fewer = table;
    sps_volume *volume, *within;
    check_scene s;
    start(&s, SURFACE, SPS_LIGHT_DIRECTIONAL);
    volume = &s.volume[0];
    fewer.components = 20;
    within = check_add_volume(&s, 6, 6, 6, check_box(0, 0, 0, 0.3, 0.3, 0.3)); /* which does not change the bounds */
    within->read_fn = read_full;
    within->revision = 1;
    within->extinction = 2;
    s.light[0].shadow_map = &table;
    s.view.quality = SPS_QUALITY_DRAFT;
    check_render(context, &s, image_a);
    check_change(&s, 1, "nothing");
    s.view.camera.position[0] = -2;
    check_change(&s, 1, "camera");
    check_color(s.light[0].color, 1, 2, 3);
    check_change(&s, 1, "color");
    volume->albedo[0] = 0.1f;
    check_change(&s, 1, "albedo");
    volume->revision = 2;
    check_change(&s, 0, "revision");
    volume->placement.origin[0] += 0.05;
    check_change(&s, 0, "place");
    within->placement.origin[0] += 0.05;
    check_change(&s, 0, "place within");
    within->extinction = 3;
    check_change(&s, 0, "extinction within");
    volume->transfer = &other_tissue;
    check_change(&s, 0, "transfer");
    volume->transfer = NULL;
    check_change(&s, 0, "a gas");
    volume->extinction *= 1.5f;
    check_change(&s, 0, "extinction");
    s.light[0].direction[0] += 0.01;
    check_change(&s, 0, "direction");
    s.light[0].shadow_map_resolution = 30;
    check_change(&s, 0, "size");
    s.light[0].shadow_map = &fewer;
    check_change(&s, 0, "planes");
    s.view.quality = SPS_QUALITY_HIGH;
    check_change(&s, 0, "quality");
    s.view.slab_thickness = 0.8;
    check_change(&s, 0, "slab");
    s.light[0].kind = SPS_LIGHT_POINT;
    check_set3(s.light[0].position, 1, 3, 0);
    check_change(&s, 0, "kind");
    s.light[0].position[1] = 3.1;
    check_change(&s, 0, "position");
    volume->revision = 0; /* it may be another one in each call */
    check_change(&s, 0, "no revision");
    check_change(&s, 0, "no revision again");
}

/* The bounds of an even cube, whose corners are floats without rounding, are the same as seen from mirrored lights. */
static void test_held_mirrored(void) {
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.volume[0].read_fn = read_full;
    s.volume[0].size[0] = s.volume[0].size[1] = s.volume[0].size[2] = 32;
    s.light[0].shadow_map = &table;
    check_render(context, &s, image_a);
    s.light[0].direction[0] *= -1;
    check_change(&s, 0, "mirrored direction");
}

/* Particles are read in every call, and compared. */
static void test_held_particles(void) {
    check_scene s;
    start(&s, SWARM, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &table;
    check_render(context, &s, image_a);
    check_change(&s, 1, "nothing");
    swarm[7].position[1] += 0.01f;
    check_change(&s, 0, "a particle");
    ((sps_particles *)(void *)(size_t)s.scene.particles)->soft = 1;
    check_change(&s, 0, "soft");
}

/* Each light has its own; those of lights that are gone are released, all of them by a call without tables. */
static void test_several(void) {
    sps_stats_report one, two, none;
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &table;
    one = render_stats(&s, image_a);
    check_add_point(&s, -2, 3, 2, 30)->shadow_map = &table;
    two = render_stats(&s, image_a);
    CHECK(two.tables_held == 1 && two.tables_made == 1 && two.slabs == one.slabs);
    two = render_stats(&s, image_a);
    CHECK(two.tables_held == 2 && two.tables_made == 0 && two.light_fragments == 0);
    s.light[0] = s.light[1]; /* the second one's table goes to both, one after the other */
    s.scene.light_count = 1;
    one = render_stats(&s, image_a);
    CHECK(one.tables_held == 1 && one.tables_made == 0 && one.bytes < two.bytes);
    s.light[0].shadow_map = NULL;
    none = render_stats(&s, image_a);
    s.light[0].shadow_map = &table;
    one = render_stats(&s, image_a);
    CHECK(none.tables_held == 0 && one.tables_made == 1);
}

/* --- what is updated --- */

/* A still volume and a small lump in it, which moves from call to call. */
typedef struct lumpy {
    int n;        /* voxels along an edge */
    double at[3]; /* of the lump, -1..1 */
    int fails;    /* 1: reading fails */
} lumpy;

static lumpy cloud;

static int read_lumpy(void *user, const int low[3], const int size[3], float *out) {
    const lumpy *l = (const lumpy *)user;
    for (int z = 0; z < size[2]; ++z)
        for (int y = 0; y < size[1]; ++y) {
            const double q[2] = {2 * (low[1] + y + 0.5) / l->n - 1, 2 * (low[2] + z + 0.5) / l->n - 1};
            const double wave = 0.2 * cos(8 * q[0]) * sin(7 * q[1] + 1);
            for (int x = 0; x < size[0]; ++x) {
                const double p = 2 * (low[0] + x + 0.5) / l->n - 1;
                const double from[3] = {p - l->at[0], q[0] - l->at[1], q[1] - l->at[2]};
                *out++ = (float)(0.3 + wave * sin(9 * p) + 0.5 * fmax(0, 1 - vec_length(from) / 0.12));
            }
        }
    return l->fails;
}

/* That scene: the lump at the beginning of its way, or, for particles, the swarm. */
static sps_light *start_lumpy(check_scene *s, int kind, sps_light_kind kind_of_light, int within) {
    sps_light *light = start(s, kind, kind_of_light);
    cloud.n = 48;
    cloud.fails = 0;
    cloud.at[0] = -0.4, cloud.at[1] = 0.1, cloud.at[2] = 0.2;
    if (kind != SWARM) s->volume[0].read_fn = read_lumpy, s->volume[0].user = &cloud;
    if (kind != SWARM) s->volume[0].size[0] = s->volume[0].size[1] = s->volume[0].size[2] = cloud.n;
    if (within) check_set3(light->position, 0.9, 0.9, -0.9);
    s->view.quality = SPS_QUALITY_DRAFT;
    light->shadow_map = &table;
    light->shadow_map_resolution = within ? 64 : 100; /* no multiple of a patch or of a tile */
    return light;
}

/* The next frame: the lump has moved, or two particles that are not the outermost. */
static void move_lump(check_scene *s, int kind) {
    if (kind != SWARM) {
        cloud.at[0] += 0.05;
        s->volume[0].revision += 1;
        return;
    }
    for (int i = 0; i < 2; ++i)
        for (int k = 0; k < 3; ++k) swarm[i].position[k] *= 0.8f;
}

/* The picture of a context that has held nothing, into image_b. */
static void render_fresh(const check_scene *s) {
    sps_context *fresh = check_context(NULL);
    check_render(fresh, s, image_b);
    sps_destroy(fresh);
}

/* Renders with a context that holds an earlier table: the bits of a fresh one. Returns the share of tables that were
   made. */
static double check_update(sps_context *holder, const check_scene *s, const char *what) {
    sps_stats_report stats;
    double made, held;
    check_render(holder, s, image_a);
    sps_get_stats(holder, &stats);
    made = (double)stats.tables_made, held = (double)stats.tables_held;
    render_fresh(s);
    if (!CHECK(memcmp(image_a, image_b, sizeof image_a) == 0)) printf("    %s\n", what);
    CHECK(made + held > 0);
    if (figures()) printf("%s: %.0f tables made, %.0f held\n", what, made, held);
    return made / (made + held);
}

/* An animation: each frame has the bits of a fresh context's, with one worker and with three. */
static void test_updated(void) {
    for (int kind = 0; kind < KINDS; ++kind)
        for (int light = 0; light < (kind ? 2 : 3); ++light) {
            const int contexts = (light || kind != GAS) && !check_long() ? 1 : 2;
            check_hooks hooks[2];
            sps_context *holders[2];
            check_scene s;
            if (!check_long() && kind == SURFACE && light) continue;
            memset(hooks, 0, sizeof hooks);
            start_lumpy(&s, kind, light ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL, light == 2);
            for (int i = 0; i < contexts; ++i) {
                hooks[i].worker_count = i ? 3 : 0;
                holders[i] = check_context(&hooks[i]);
                CHECK(check_update(holders[i], &s, names[kind]) >= 1);
            }
            for (int frame = 0; frame < 2; ++frame) {
                move_lump(&s, kind);
                for (int i = 0; i < contexts; ++i) { CHECK(check_update(holders[i], &s, names[kind]) >= 1); }
            }
            for (int i = 0; i < contexts; ++i) sps_destroy(holders[i]);
        }
}

/* A second volume, of coarser voxels, so that slabs stay as thin as they are. */
static sps_volume *add_part(check_scene *s, float extinction) {
    sps_volume *part = check_add_volume(s, 5, 5, 5, check_box(0, 0, 0, 0.3, 0.3, 0.3));
    part->read_fn = read_full;
    part->revision = 1;
    part->extinction = extinction;
    return part;
}

/* Which tables each kind of change makes anew: all, some, none. */
enum { ALL, PART, NOTHING };

static void check_part(sps_context *holder, const check_scene *s, int part, const char *what) {
    const double made = check_update(holder, s, what);
    if (!CHECK(part == ALL ? made >= 1 : part == PART ? made > 0 && made < 1 : made <= 0))
        printf("    %s: %g of the tables was made\n", what, made);
}

static void test_updated_changes(void) {
    sps_context *holder = check_context(NULL);
    sps_volume *volume, *within;
    check_scene s;
    start_lumpy(&s, GAS, SPS_LIGHT_DIRECTIONAL, 0);
    s.light[0].shadow_map_resolution = 52;
    volume = &s.volume[0];
    for (int k = 0; k < 3; ++k) volume->size[k] = cloud.n = 36; /* still finer than the second volume */
    check_render(holder, &s, image_a);
    check_part(holder, &s, NOTHING, "nothing");
    volume->revision += 1;
    check_part(holder, &s, ALL, "another revision of the same voxels");
    within = add_part(&s, 2);
    check_part(holder, &s, ALL, "a second volume");
    within->extinction = 3;
    check_part(holder, &s, ALL, "its extinction");
    within->placement.origin[0] += 0.05;
    check_part(holder, &s, ALL, "its place");
    within->placement.axis[0][0] *= 1.1;
    check_part(holder, &s, ALL, "its width");
    volume->extinction = 4;
    check_part(holder, &s, ALL, "the extinction of all");
    volume->transfer = &tissue;
    check_part(holder, &s, ALL, "a transfer function");
    volume->transfer = &other_tissue;
    check_part(holder, &s, ALL, "another transfer function");
    volume->transfer = NULL;
    check_part(holder, &s, ALL, "no transfer function");
    s.light[0].direction[0] += 0.02;
    check_part(holder, &s, ALL, "the light");
    s.view.slab_thickness = 0.9;
    check_part(holder, &s, ALL, "slabs");
    s.view.quality = SPS_QUALITY_HIGH;
    check_part(holder, &s, ALL, "kernels");
    s.light[0].shadow_map_resolution = 70;
    check_part(holder, &s, ALL, "the grid");
    within->placement.origin[0] = 0.9;
    check_part(holder, &s, ALL, "wider bounds");
    s.scene.volume_count = 1;
    check_part(holder, &s, ALL, "narrower bounds");
    volume->revision = 0;
    check_part(holder, &s, ALL, "no revision");
    check_part(holder, &s, ALL, "no revision again");
    sps_destroy(holder);
}

/* A volume that is classified within a gas, by another function in each call. */
static void test_updated_transfer(void) {
    sps_context *holder = check_context(NULL);
    sps_volume *within;
    check_scene s;
    start_lumpy(&s, GAS, SPS_LIGHT_DIRECTIONAL, 0);
    check_render(holder, &s, image_a);
    within = add_part(&s, 1);
    within->transfer = &tissue;
    check_part(holder, &s, ALL, "a classified volume, whose slabs are thinner");
    within->transfer = &other_tissue;
    check_part(holder, &s, ALL, "the transfer function of a part");
    within->transfer = &tissue;
    check_part(holder, &s, ALL, "the first transfer function");
    within->transfer = &wide_tissue;
    check_part(holder, &s, ALL, "the same colors at other values");
    move_lump(&s, GAS);
    check_part(holder, &s, ALL, "the lump beside it");
    sps_destroy(holder);
}

/* Six faces: their rays do not depend on how far gas reaches, but their slabs do, and their range. */
static void test_updated_bounds(void) {
    sps_context *holder = check_context(NULL);
    sps_volume *aside;
    check_scene s;
    start_lumpy(&s, GAS, SPS_LIGHT_POINT, 1);
    aside = add_part(&s, 2);
    check_render(holder, &s, image_a);
    aside->placement.origin[0] = 1.1;
    check_part(holder, &s, ALL, "wider on the near side");
    aside->placement.origin[0] = -1.7;
    check_part(holder, &s, ALL, "wider on the far side");
    sps_destroy(holder);
}

/* Voxels of 1 in the corners of 40^3, and others of 1 from `low` to `high`, except for one of `other`. */
typedef struct single {
    int low[3], high[3], at[3];
    float other;
} single;

static int read_single(void *user, const int low[3], const int size[3], float *out) {
    const single *box = (const single *)user;
    for (int z = low[2]; z < low[2] + size[2]; ++z)
        for (int y = low[1]; y < low[1] + size[1]; ++y)
            for (int x = low[0]; x < low[0] + size[0]; ++x) {
                const int at[3] = {x, y, z};
                int corner = 1, inside = 1, other = 1;
                for (int k = 0; k < 3; ++k) {
                    corner &= at[k] == 0 || at[k] == 39;
                    inside &= at[k] >= box->low[k] && at[k] <= box->high[k];
                    other &= at[k] == box->at[k];
                }
                *out++ = !corner && !inside ? 0 : other ? box->other : 1;
            }
    return 0;
}

/* Light straight down: where voxels are along its rays counts too. A brick moves by its height, a voxel within its
   brick. */
static void test_updated_along(void) {
    sps_context *holder = check_context(NULL);
    single moved = {{16, 8, 16}, {23, 15, 23}, {17, 21, 16}, 1};
    check_scene s;
    start_lumpy(&s, GAS, SPS_LIGHT_DIRECTIONAL, 0);
    check_set3(s.light[0].direction, 0, -1, 0);
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = 40;
    s.volume[0].read_fn = read_single, s.volume[0].user = &moved;
    check_render(holder, &s, image_a);
    moved.low[1] = 16, moved.high[1] = 23, s.volume[0].revision += 1;
    check_part(holder, &s, ALL, "a brick");
    moved.low[1] = moved.high[1] = 18, s.volume[0].revision += 1;
    check_part(holder, &s, ALL, "a layer of it");
    moved.low[1] = moved.high[1] = 21, s.volume[0].revision += 1;
    check_part(holder, &s, ALL, "another layer");
    moved.other = 2, s.volume[0].revision += 1;
    check_part(holder, &s, ALL, "its second voxel");
    sps_destroy(holder);
}

/* Particles: a moved one, a denser one, a new last one; soft ones. */
static void test_updated_particles(void) {
    sps_context *holder = check_context(NULL);
    sps_particles *set;
    check_scene s;
    start_lumpy(&s, SWARM, SPS_LIGHT_POINT, 0);
    set = (sps_particles *)(void *)(size_t)s.scene.particles;
    set->count -= 1;
    for (int k = 0; k < 3; ++k) swarm[9].position[k] = swarm[PARTICLES - 1].position[k] = 0.1f * (float)k;
    check_render(holder, &s, image_a);
    swarm[9].position[1] += 0.05f;
    check_part(holder, &s, ALL, "a particle");
    swarm[9].optical_depth *= 2;
    check_part(holder, &s, ALL, "a denser particle");
    set->count += 1;
    check_part(holder, &s, ALL, "a particle more");
    set->soft = 1;
    check_part(holder, &s, ALL, "soft");
    set->is_extinction = 1;
    check_part(holder, &s, ALL, "extinction");
    sps_destroy(holder);
}

/* Two lights, of which one moves too; a budget counts the table and not what it was. */
static void test_updated_several(void) {
    sps_context *holder = check_context(NULL);
    sps_tmap_settings settings = table;
    sps_light *other;
    check_scene s;
    start_lumpy(&s, GAS, SPS_LIGHT_DIRECTIONAL, 0);
    settings.components = 40;
    settings.byte_budget = 100 * 100 * 40 * 4 + 100000;
    s.light[0].shadow_map = &settings;
    other = check_add_point(&s, -2, 3, 2, 30);
    other->shadow_map = &table, other->shadow_map_resolution = 70;
    check_render(holder, &s, image_a);
    move_lump(&s, GAS);
    check_part(holder, &s, ALL, "two lights");
    move_lump(&s, GAS);
    other->position[0] += 0.1;
    check_part(holder, &s, ALL, "two lights, one of which moves");
    other->position[0] += 0.1;
    check_part(holder, &s, PART, "one light moves");
    sps_destroy(holder);
}

/* A call that updates a table is cancelled, lacks memory or cannot read: the next one has the bits of a fresh context.
   Returns whether the call in between has failed. */
static int check_interrupted(int kind, long cancelled, long refused, int reading) {
    check_cancel c = {0, 0};
    check_hooks hooks;
    sps_config config;
    sps_context *holder;
    sps_image image;
    sps_result result;
    check_scene s;
    memset(&hooks, 0, sizeof hooks);
    memset(&image, 0, sizeof image);
    config = check_config(&hooks);
    config.progress_fn = check_cancel_at;
    config.clock_fn = check_hasty_clock;
    config.progress_user = &c;
    holder = sps_create(&config, NULL);
    image.rgba = image_a;
    start_lumpy(&s, kind, SPS_LIGHT_DIRECTIONAL, 0);
    for (int k = 0; k < 3; ++k) s.volume[0].size[k] = cloud.n = 24; /* many calls, so few voxels */
    check_render(holder, &s, image_a);
    move_lump(&s, kind);
    c.at = cancelled > 0 ? c.calls + cancelled : 0;
    hooks.fail_at = refused > 0 ? hooks.allocations + refused : 0;
    cloud.fails = reading;
    result = sps_render(holder, &s.scene, &s.view, &image);
    CHECK(result == SPS_OK || result == SPS_ERROR_MEMORY || result == SPS_ERROR_CALLBACK ||
          result == SPS_ERROR_CANCELLED);
    c.at = hooks.fail_at = 0;
    cloud.fails = 0;
    move_lump(&s, kind);
    check_update(holder, &s, "after a failure");
    sps_destroy(holder);
    CHECK(hooks.live == 0);
    return result != SPS_OK;
}

static void test_updated_failures(void) {
    long n;
    for (n = 1; check_interrupted(GAS, n, 0, 0); n += 1 + n / 2) CHECK(n < 10000);
    CHECK(n > 20);
    for (n = 1; check_interrupted(GAS, 0, n, 0); ++n) CHECK(n < 1000);
    CHECK(n > 1); /* the table */
    CHECK(check_interrupted(GAS, 0, 0, 1));
}

/* --- memory, workers, failures --- */

static void test_plan(void) {
    for (int kind = 0; kind < KINDS; ++kind)
        for (int light = 0; light < 2; ++light) {
            sps_context *fresh = check_context(NULL);
            sps_plan_report plan;
            sps_stats_report stats;
            check_scene s;
            start(&s, kind, light ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL);
            s.light[0].shadow_map = &table;
            s.light[0].shadow_map_omnidirectional = light;
            CHECK_OK(fresh, sps_plan(fresh, &s.scene, &s.view, &plan));
            check_render(fresh, &s, image_a);
            sps_get_stats(fresh, &stats);
            CHECK(stats.bytes_peak <= plan.bytes && plan.pass[SPS_PASS_LIGHT_MAPS].runs == 1);
            if (figures())
                printf("%s, %s: planned %.1f MB, at most %.1f MB\n", names[kind], light ? "six faces" : "sun",
                       1e-6 * (double)plan.bytes, 1e-6 * (double)stats.bytes_peak);
            sps_destroy(fresh);
        }
}

/* A wide volume's table has 256 texels on a side, unless its size is set. */
static void test_default_size(void) {
    const size_t bytes = (size_t)256 * (256 + 64) * 1024 * 4; /* of entries, and of 64 rows as they are made */
    sps_plan_report plan;
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    check_set3(s.light[0].direction, 0, -1, 0);
    s.light[0].shadow_map = &table;
    s.volume[0].size[0] = s.volume[0].size[2] = 700;
    s.volume[0].size[1] = 4;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.pass[SPS_PASS_LIGHT_MAPS].bytes < bytes + bytes / 4);
    s.light[0].shadow_map_resolution = 600;
    CHECK_OK(context, sps_plan(context, &s.scene, &s.view, &plan));
    CHECK(plan.pass[SPS_PASS_LIGHT_MAPS].bytes > bytes + bytes / 4);
}

/* However large a table is made, by default it has no more entries than can be looked up: it is not refused. That they
   are looked up, for which it is filled, is left to the long tests. */
static void test_large(void) {
    sps_context *fresh;
    check_hooks hooks;
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &table;
    s.light[0].shadow_map_resolution = 2048;
    s.view.quality = SPS_QUALITY_DRAFT;
    memset(&hooks, 0, sizeof hooks);
    hooks.memory_limit = 100000000; /* a tenth of its bytes */
    fresh = check_context(&hooks);
    check_fails(fresh, &s, image_a, SPS_ERROR_MEMORY, "memory_limit");
    sps_destroy(fresh);
    if (!check_long()) return;
    fresh = check_context(NULL);
    check_render(fresh, &s, image_a);
    s.light[0].shadow_map_resolution = 64;
    check_render(fresh, &s, image_b);
    CHECK(check_rms(image_a, image_b, COUNT) <
          0.01 * check_mean(image_b, COUNT)); /* 64: 0.0006, test_sizes; planes: the same */
    sps_destroy(fresh);
}

static void test_workers(void) {
    check_hooks hooks;
    sps_context *many;
    memset(&hooks, 0, sizeof hooks);
    hooks.worker_count = 3, hooks.order = 1;
    many = check_context(&hooks);
    for (int kind = 0; kind < KINDS; ++kind) {
        check_scene s;
        start(&s, kind, SPS_LIGHT_POINT);
        s.light[0].shadow_map = &table;
        check_render(context, &s, image_a);
        for (int call = 0; call < 2; ++call) {
            check_render(many, &s, image_b);
            CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        }
    }
    sps_destroy(many);
}

/* Every allocation fails once, in the call that makes a table and in the one that finds another light. */
static void test_allocations(void) {
    const double direction[2] = {0.5, -0.3}; /* x of the two lights' */
    sps_image image;
    check_scene s;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &table;
    s.light[0].shadow_map_resolution = 50;
    s.view.quality = SPS_QUALITY_DRAFT;
    s.light[0].direction[0] = direction[1];
    check_render(context, &s, image_b);
    for (long n = 1; n < 1000; ++n) {
        check_hooks hooks;
        sps_context *failing;
        sps_result results[2];
        memset(&hooks, 0, sizeof hooks);
        failing = check_context(&hooks);
        s.light[0].direction[0] = direction[0];
        hooks.fail_at = hooks.allocations + n;
        results[0] = sps_render(failing, &s.scene, &s.view, &image);
        s.light[0].direction[0] = direction[1];
        results[1] = sps_render(failing, &s.scene, &s.view, &image);
        CHECK(results[0] == SPS_OK || results[0] == SPS_ERROR_MEMORY);
        hooks.fail_at = 0;
        CHECK_OK(failing, sps_render(failing, &s.scene, &s.view, &image));
        CHECK(memcmp(image_a, image_b, sizeof image_a) == 0);
        sps_destroy(failing);
        CHECK(hooks.live == 0);
        if (results[0] == SPS_OK && results[1] == SPS_OK) break;
        CHECK(n < 999);
    }
}

static void check_refused(check_scene *s, sps_result result, const char *text) {
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = image_a;
    CHECK(sps_render(context, &s->scene, &s->view, &image) == result);
    if (!CHECK(strstr(sps_error(context), text) != NULL))
        printf("    wanted \"%s\", got \"%s\"\n", text, sps_error(context));
}

/* A light's default is a table; a byte_budget takes planes from it, until none is left to take. */
static void test_settings(void) {
    sps_tmap_settings settings;
    sps_stats_report stats;
    check_scene s;
    memset(&settings, 0, sizeof settings);
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &table;
    check_render(context, &s, image_a);
    s.light[0].shadow_map = &settings;
    stats = render_stats(&s, image_b);
    CHECK(stats.tables_held == 1 && memcmp(image_a, image_b, sizeof image_a) == 0);
    for (int size = 17; size < 30; size += 4) { /* which are not multiples of a block's 4 texels */
        settings.byte_budget = (size_t)(60 * size * size) + 4000;
        s.light[0].shadow_map_resolution = size;
        stats = render_stats(&s, image_b);
        CHECK(context->shadow_table_count == 1);
        CHECK(((const spsi_shadow_table *)context->buffers[SPSI_BUFFER_SHADOW_TABLES].data)->pairs.size <
              settings.byte_budget);
    }
    settings.byte_budget = 60000;
    s.light[0].shadow_map_resolution = 20;
    stats = render_stats(&s, image_b);
    CHECK(stats.tables_made == 1 && memcmp(image_a, image_b, sizeof image_a) != 0);
    CHECK(check_rms(image_a, image_b, COUNT) <
          0.1 * check_mean(image_a, COUNT)); /* between tables of 8 and 16, test_sizes */
}

static void test_refused(void) {
    sps_tmap_settings settings = table;
    sps_tmap_light light;
    sps_tmap *map = NULL;
    check_scene s;
    start(&s, GAS, SPS_LIGHT_DIRECTIONAL);
    s.light[0].shadow_map = &settings;
    settings.components = 7;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].shadow_map.components is 7; a shadow table has 8, 9 .. 1024");
    settings.components = 1025;
    check_refused(&s, SPS_ERROR_ARGUMENT, "light[0].shadow_map.components is 1025");
    settings.components = 0;
    s.light[0].angular_diameter = 0.1;
    check_refused(&s, SPS_ERROR_UNSUPPORTED, "light[0].shadow_map holds the shadow of a single point");
    s.light[0].angular_diameter = 0;
    settings.components = 1024;
    s.light[0].shadow_map_resolution = 640; /* 1.6 times as many */
    check_refused(&s, SPS_ERROR_MEMORY,
                  "light[0].shadow_map.components is 1024; a table of this size would have more than 2^28 entries");
    light = check_light_of(&s.view);
    settings.far_depth = 10;
    CHECK(sps_tmap_create(context, &light, &settings, &map) == SPS_ERROR_ARGUMENT && !map);
    CHECK(strstr(sps_error(context), "which is for sps_light.shadow_map only") != NULL);
}

int main(void) {
    context = check_context(NULL);
    if (!context) return 1;
    table.technique = SPS_TMAP_TABLE;
    RUN(test_even_slab);
    RUN(test_against_sheets);
    RUN(test_sizes);
    RUN_LONG(test_light_within);
    RUN(test_held);
    RUN(test_held_mirrored);
    RUN(test_held_particles);
    RUN(test_several);
    RUN(test_updated);
    RUN(test_updated_changes);
    RUN(test_updated_transfer);
    RUN(test_updated_bounds);
    RUN(test_updated_along);
    RUN(test_updated_particles);
    RUN(test_updated_several);
    RUN(test_updated_failures);
    RUN(test_plan);
    RUN(test_default_size);
    RUN(test_large);
    RUN(test_workers);
    RUN(test_allocations);
    RUN(test_settings);
    RUN(test_refused);
    sps_destroy(context);
    check_free_triangles(&ground);
    return check_report();
}
