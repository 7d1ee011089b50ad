/* sps_plan_report.bytes against the memory that sps_render takes, as the allocator sees it, in random scenes. The plan
   is an upper bound in a new context, once voxels are cached, and after other frames. Once voxels are cached, it is
   within twice the use. What the interface excludes is taken off the use: layers of pixels and of texels, and what
   works on lists. No map has lists here. */

#include "random_scene.h"

enum { SCENES = 300, QUICK = 55, PIXELS = 16, CROWD = 5000, KINDS = 11 };

static const int excluded[] = {
    SPSI_BUFFER_LAYER_SAMPLES,     SPSI_BUFFER_LAYER_STARTS,        SPSI_BUFFER_FRAGMENTS,         SPSI_BUFFER_LAYERS,
    SPSI_BUFFER_TRANSLUCENCY_MAPS, SPSI_BUFFER_TRANSLUCENCY_TEXELS, SPSI_BUFFER_TRANSLUCENT_PLANES};

/* Particles on a spiral about the middle of the scene. */
static int read_spiral(void *user, size_t first, size_t count, sps_particle *out) {
    const random_scene *x = (const random_scene *)user;
    for (size_t i = 0; i < count; ++i) {
        const double turn = 0.1 * (double)(first + i), across = 0.4 * (double)(first + i) / CROWD;
        const double local[3] = {across * cos(turn), across * sin(turn), 0.3 * sin(0.37 * turn)};
        double world[3];
        scene_to_world(x, local, world);
        for (int k = 0; k < 3; ++k) out[i].position[k] = (float)world[k];
        out[i].radius = (float)(0.01 * x->scale), out[i].optical_depth = 0.05f;
    }
    return 0;
}

static void add_strips(random_scene *x, int count) {
    for (int i = 0; i < count; ++i) {
        const double u[3] = {0.001, 0, 0}, v[3] = {0, 0.5, 0};
        add_rectangle(x, 0.001 * i - 0.5, -0.6, 0, u, v);
    }
}

/* Makes one of a plan's terms large. */
static void enlarge(random_scene *x, int kind) {
    sps_view *view = &x->s.view;
    if (kind == 0) view->shadow_resolution = 120;
    if (kind == 1) view->coverage_samples = 8;
    if (kind == 2) view->filling = SPS_FILLING_SPLAT;
    if (kind == 3) view->filling = SPS_FILLING_GATHER;
    if (kind == 4) view->scattering = SPS_SCATTERING_MULTIPLE, view->scattering_resolution = 10;
    if (kind == 5) view->scattering = SPS_SCATTERING_FORWARD;
    if (kind == 6) view->scattering = SPS_SCATTERING_CONVOLUTION, view->scattering_resolution = 8;
    if (kind == 7) view->scattering = SPS_SCATTERING_AUTO, view->scattering_resolution = 8;
    if (kind == 8 && x->s.scene.particle_set_count > 0)
        x->sets[0].count = CROWD, x->sets[0].read_fn = read_spiral, x->sets[0].user = x;
    if (kind == 9 && x->s.scene.mesh_count > 0) add_strips(x, 2000);
}

static void draw_scene(random_scene *x, int n) {
    check_random random;
    int levels[FEATURES], good;
    random.state = 77777u + (uint64_t)n * 0x9e3779b97f4a7c15u;
    check_next(&random);
    do {
        good = 1;
        for (int f = 0; f < FEATURES; ++f) levels[f] = draw_below(&random, level_count(f));
        if (levels[SHADOW] == SHADOW_DEEP || levels[SHADOW] == SHADOW_COMPRESSED) levels[SHADOW] = SHADOW_TABLE;
        for (int a = 0; a < FEATURES; ++a)
            for (int b = 0; b < a; ++b) good &= !scene_excluded(a, levels[a], b, levels[b]);
    } while (!good);
    build_scene(x, levels, random.state, n % KINDS == 10 ? 40 : 6 + n % 7, PIXELS);
    x->s.view.quality = SPS_QUALITY_DRAFT, x->s.view.scattering = SPS_SCATTERING_SINGLE;
    draw_panes(x, random.state);
    for (int i = 0; i < x->s.scene.light_count; ++i)
        if (x->s.light[i].shadow_map && x->maps[i].technique != SPS_TMAP_OPACITY) x->s.light[i].shadow_map = NULL;
    x->s.view.shadow_resolution = n % 4 == 1 ? 0 : 30;
    enlarge(x, n % KINDS);
    for (int i = 0; i < x->s.scene.volume_count; ++i) x->s.volume[i].revision = (uint64_t)n + 1;
}

static double bytes_aside(const sps_context *context) {
    size_t sum = 0;
    for (size_t i = 0; i < sizeof excluded / sizeof *excluded; ++i) sum += context->buffers[excluded[i]].size;
    return (double)sum;
}

/* Most bytes at once during a render, planned before; -1 if the scene is refused. */
static double peak_of(sps_context *context, check_hooks *hooks, const random_scene *x, sps_plan_report *plan) {
    static float rgba[4 * 4 * PIXELS * PIXELS], depth[4 * PIXELS * PIXELS];
    sps_image image;
    memset(&image, 0, sizeof image);
    image.rgba = rgba, image.depth = depth;
    if (sps_plan(context, &x->s.scene, &x->s.view, plan)) return -1;
    hooks->peak = hooks->live;
    if (sps_render(context, &x->s.scene, &x->s.view, &image)) return -1;
    return (double)hooks->peak - bytes_aside(context);
}

/* Planned bytes that a second render does not take: depth maps that no triangle meets, blocks of voxels that are held,
   and cached multiple scattering. */
static double unused(const sps_context *context, const sps_plan_report *plan) {
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    return (double)(context->planned[SPSI_BUFFER_DEPTH_MAPS] + context->planned[SPSI_BUFFER_BLOCKS]) +
           (stats.cells > 0 ? 0 : (double)(plan->pass[SPS_PASS_CELLS].bytes + plan->pass[SPS_PASS_SPREADING].bytes));
}

int main(void) {
    static random_scene x;
    check_hooks hooks[2];
    const int scenes = check_long() ? SCENES : QUICK;
    int rendered = 0;
    memset(hooks, 0, sizeof hooks);
    sps_context *used = check_context(&hooks[1]);
    for (int n = 0; n < scenes; ++n) {
        draw_scene(&x, n);
        memset(&hooks[0], 0, sizeof hooks[0]);
        hooks[0].worker_count = n % 5 == 0 ? 24 : 0;
        sps_context *fresh = check_context(&hooks[0]);
        for (int round = 0; round < 3; ++round) {
            sps_plan_report plan;
            sps_context *context = round < 2 ? fresh : used;
            const double aside = bytes_aside(context), peak = peak_of(context, &hooks[round == 2], &x, &plan);
            if (peak < 0) break;
            const double planned = (double)plan.bytes - aside;
            if (!CHECK_CASE("Engineering", "bytes of random scenes, in new and in used contexts", "peak / planned",
                            peak / planned, 1, "a bound") ||
                !CHECK(round != 1 || planned - unused(context, &plan) <= 2 * peak))
                printf("    scene %d, round %d: %.0f of %.0f\n", n, round, peak, planned);
            rendered += round == 0;
        }
        sps_destroy(fresh);
        free_scene(&x);
    }
    sps_destroy(used);
    CHECK(rendered > scenes / 2);
    return check_report();
}
