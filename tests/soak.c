/* Random scenes against sps_reference: soak SEED COUNT FIRST compares COUNT of them, from number FIRST on, the same
   ones for the same SEED on every machine; without COUNT, 4 chosen ones, or 20 where SPLATSHADOW_LONG is set. A scene
   fails if its error, relative to the reference's mean, is neither below 3 % at medium quality nor falls to half of
   that at high quality, unless one of the causes below explains it. Every other one with polygons is compared again,
   with samples of their edges; every fifth one with light from cell to cell, with random paths. Prints the worst ten,
   each with the line that renders it again; with SOAK_ALL in the environment, every one. */

#include "random_scene.h"

#include "measure/measuring.h"
#include "photons.h"

enum { WORST = 10, QUICK = 4 };

/* Scenes of seed 1 that run without COUNT: a varied choice, none of which takes long. */
static const int quick[QUICK] = {3, 19, 29, 91};

typedef struct outcome {
    long number;
    int levels[FEATURES];
    int images; /* that lights throw */
    int cones;  /* spotlights */
    int panes;  /* 1: the mesh lets light pass */
    int crops;  /* 1: volumes are cut */
    scene_report report;
    const char *reason; /* why it may fail; NULL: it may not, or is good */
    double seconds;     /* by all workers */
} outcome;

typedef struct soak {
    uint64_t seed;
    outcome worst[WORST];
    int worst_count, show_all;
    long compared, refused, dark, hidden, failed, excused;
    long beside, beside_excused; /* pictures of walls and gas beside a light; that may fail */
} soak;

static void print_outcome(const soak *s, const outcome *o) {
    const scene_report *r = &o->report;
    printf("%6.2f %% %6.2f %%  bias %6.2f %% %6.2f %%  coverage %.4f  depth %.4f  mean %.2g  own %.2f %%  %d refined  "
           "%d images  "
           "%d cones  %d panes  %d crops  %.1f s  "
           "make soak SEED=%llu FIRST=%ld COUNT=1\n            ",
           100 * r->medium.light, 100 * r->high.light, 100 * r->medium.bias, 100 * r->high.bias, r->medium.coverage,
           r->medium.depth, r->high.mean, 100 * r->own, r->refined, o->images, o->cones, o->panes, o->crops, o->seconds,
           (unsigned long long)s->seed, o->number);
    print_levels(o->levels);
}

/* Keeps the worst scenes, worst first. */
static void rank(soak *s, const outcome *o) {
    int at = s->worst_count;
    while (at > 0 && s->worst[at - 1].report.medium.light < o->report.medium.light) --at;
    if (at == WORST) return;
    if (s->worst_count < WORST) ++s->worst_count;
    memmove(s->worst + at + 1, s->worst + at, (size_t)(s->worst_count - 1 - at) * sizeof *o);
    s->worst[at] = *o;
}

/* Levels that are drawn with all others. */
static int drawn_levels(int f) { return f == LIGHT ? LIGHT_WIDE_SUN : f == SHADOW ? SHADOW_TABLE : level_count(f); }

/* A light with an extent in the place of every other one without that casts sharp shadows by slabs, or none. Drawn by a
   generator of its own, so that all other scenes stay as they are. */
static void draw_extent(check_random random, int levels[FEATURES]) {
    const int extended = LIGHT_WIDE_SUN + draw_below(&random, 3);
    const int has_map = levels[SHADOW] != SHADOW_SLABS && levels[SHADOW] != SHADOW_NONE;
    if (one_in(&random, 2) && levels[LIGHT] != LIGHT_NONE && !has_map) levels[LIGHT] = extended;
}

/* Every eighth scene has an area light whose light polygons and gas hide; by a generator of its own, so that all else
   stays. */
static void draw_area(check_random random, int levels[FEATURES]) {
    static const int meshes[4] = {MESH_SOUP, MESH_SLIVERS, MESH_WALL, MESH_BALL};
    for (int i = 0; i < 11; ++i) check_next(&random);
    if (!one_in(&random, 8) || levels[WORLD] == WORLD_FAR) return;
    levels[LIGHT] = LIGHT_WIDE_SUN + draw_below(&random, 3);
    levels[MESH] = meshes[draw_below(&random, 4)];
    levels[SHADOW] = SHADOW_AUTO;
    if (levels[VOLUME] == VOLUME_NONE && levels[PARTICLES] == PARTICLES_NONE) levels[PARTICLES] = PARTICLES_EVEN;
}

/* A table in the place of every other map that draws nothing; by a generator of its own, too, so that all else stays.
 */
static void draw_table(check_random random, int levels[FEATURES]) {
    for (int i = 0; i < 3; ++i) check_next(&random);
    if ((levels[SHADOW] == SHADOW_DEEP || levels[SHADOW] == SHADOW_COMPRESSED) && one_in(&random, 2))
        levels[SHADOW] = SHADOW_TABLE;
}

/* The library's own choice in the place of every other light by slabs or by a table; by a generator of its own. */
static void draw_auto(check_random random, int levels[FEATURES]) {
    for (int i = 0; i < 7; ++i) check_next(&random);
    if ((levels[SHADOW] == SHADOW_SLABS || levels[SHADOW] == SHADOW_TABLE) && one_in(&random, 2))
        levels[SHADOW] = SHADOW_AUTO;
}

/* Compatible levels, each as likely as the others; but few scenes are without a light. */
static void draw_levels(check_random *random, int levels[FEATURES]) {
    int good;
    do {
        good = 1;
        for (int f = 0; f < FEATURES; ++f) levels[f] = draw_below(random, drawn_levels(f));
        if (levels[LIGHT] == LIGHT_NONE) levels[LIGHT] = draw_below(random, LIGHT_WIDE_SUN);
        for (int a = 0; a < FEATURES; ++a)
            for (int b = 0; b < a; ++b) good &= !scene_excluded(a, levels[a], b, levels[b]);
    } while (!good);
    draw_extent(*random, levels);
    draw_table(*random, levels);
    draw_auto(*random, levels);
    draw_area(*random, levels);
}

static void judge(soak *s, const outcome *o) {
    const scene_report *r = &o->report;
    const int good = scene_good(r) && r->medium.edges <= SCENE_CUT;
    const char *reason = good ? NULL : o->reason;
    if (s->show_all) print_outcome(s, o);
    ++s->compared;
    rank(s, o);
    if (reason) printf("scene %ld may fail: %s\n", o->number, reason);
    s->excused += reason != NULL;
    if (check_count(good || reason)) return;
    ++s->failed;
    printf("failed, %d pixels at edges left out:\n", r->medium.edges);
    print_outcome(s, o);
}

/* Whether a picture with light from cell to cell is darker than what is judged, by the renderer and by a few paths. */
static int cells_dark(sps_context *context, const random_scene *x) {
    static float rgba[2][4 * CELLS_SIDE * CELLS_SIDE];
    const size_t pixels = check_pixel_count(&x->s.view);
    double sums[2] = {0, 0};
    sps_reference_settings settings;
    sps_image image;
    memset(&settings, 0, sizeof settings), memset(&image, 0, sizeof image);
    settings.step = 0.5, settings.samples = 4, settings.seed = 2;
    image.rgba = rgba[1];
    if (!check_render(context, &x->s, rgba[0])) return 0;
    if (!CHECK_OK(context, sps_reference(context, &x->s.scene, &x->s.view, &settings, &image))) return 0;
    for (size_t i = 0; i < 8 * pixels; ++i)
        if (i % 4 < 3) sums[i / (4 * pixels)] += (double)rgba[i / (4 * pixels)][i % (4 * pixels)];
    return fmax(sums[0], sums[1]) < SCENE_DARK * 3 * (double)pixels;
}

/* Every fifth scene again, with light from cell to cell, against random paths. Changes the scene. */
static void soak_cells(sps_context *context, random_scene *x, const int levels[FEATURES], long number) {
    char name[48];
    sps_plan_report plan;
    if (number % 5 != 2 || has_surfaces(levels)) return;
    prepare_cells(x, CELLS_SIDE);
    if (sps_plan(context, &x->s.scene, &x->s.view, &plan) == SPS_ERROR_UNSUPPORTED) return;
    if (cells_dark(context, x)) return;
    snprintf(name, sizeof name, "scene %ld, cells", number);
    check_paths(context, &x->s, name, 32, 0.05);
}

/* The part of a voxel's kernel inside a volume's crop, or inside its box if it has a border. */
static double kernel_inside(const sps_volume *volume, const int voxel[3]) {
    int cropped = 0;
    double inside = 1;
    for (int k = 0; k < 6; ++k) cropped |= volume->crop[k];
    for (int k = 0; k < 3 && (cropped || volume->border); ++k) {
        const double low = cropped ? volume->crop[k] : 0, high = cropped ? volume->crop[3 + k] : volume->size[k];
        const double per = 1 / (0.65 * sqrt(2)), at = voxel[k] + 0.5;
        inside *= 0.5 * (erf((high - at) * per) - erf((low - at) * per));
    }
    return inside;
}

/* Sum of a volume's values, which are read at once, as far as their kernels are inside. */
static double values_sum(const sps_volume *volume) {
    enum { MOST = 40 };
    static float values[MOST * MOST * MOST];
    const int border = volume->border, first[3] = {-border, -border, -border};
    int size[3];
    double sum = 0;
    for (int k = 0; k < 3; ++k) size[k] = volume->size[k] + 2 * border;
    const int count = size[0] * size[1] * size[2];
    if (!volume->read_fn || count > MOST * MOST * MOST) return 0;
    if (!CHECK(volume->read_fn(volume->user, first, size, values) == 0)) return 0;
    for (int i = 0; i < count; ++i) {
        const int voxel[3] = {i % size[0] - border, i / size[0] % size[1] - border, i / (size[0] * size[1]) - border};
        sum += (double)values[i] * kernel_inside(volume, voxel);
    }
    return sum;
}

/* Every scene's first gas, alone and faint, whole or cut, from 4 pixels a voxel to 1/64 of one: the sum over pixels of
   its optical depth is that over its voxels. The distance and the quality are drawn by a generator of their own. A
   voxel of 0.54 pixels has one ray, which takes 17 % of a wave as long as a pixel for more; of that, noise and faces
   that are not parallel to the pixels have little. */
static void soak_distance(sps_context *context, const random_scene *from, check_random random, long number) {
    static random_scene x;
    static scene_picture picture;
    const sps_volume *gas = x.s.volume;
    double widest = 0, pixel, sum, mass = 0, depth, middle[3];
    sps_view *view = &x.s.view;
    sps_result result;
    for (int i = 0; i < 11; ++i) check_next(&random);
    if (from->s.scene.volume_count == 0 || from->s.volume->transfer) return;
    x = *from;
    check_random apart = random;
    if (one_in(&apart, 2)) crop_volume(&apart, x.s.volume);
    if (!((sum = values_sum(gas)) > 0)) return;
    x.s.scene.volumes = x.s.volume, x.s.scene.meshes = x.s.mesh, x.s.scene.lights = x.s.light;
    x.s.scene.volume_count = 1;
    x.s.scene.mesh_count = x.s.scene.light_count = x.s.scene.particle_set_count = 0;
    for (int k = 0; k < 3; ++k) {
        middle[k] = gas->placement.origin[k];
        for (int i = 0; i < 3; ++i) middle[k] += gas->placement.axis[i][k] / 2;
        widest += vec_length(gas->placement.axis[k]);
    }
    pixel = widest / 60 * pow(4 * 64 / 2.5, draw(&random, 0, 1));
    memset(view, 0, sizeof *view);
    view->width = view->height = 64;
    view->quality = (sps_quality)draw_below(&random, 5);
    for (int k = 0; k < 3; ++k)
        view->camera.position[k] = middle[k] + (k == 2 ? 4 * widest : pixel * draw(&random, 0, 1));
    memcpy(view->camera.target, view->camera.position, sizeof middle);
    view->camera.target[2] -= 1;
    view->camera.up[1] = 1;
    check_orthographic(&view->camera, 64 * pixel);
    depth = fabs(vec_determinant(gas->placement.axis[0], gas->placement.axis[1], gas->placement.axis[2])) * sum;
    depth /= (double)gas->size[0] * gas->size[1] * gas->size[2] * pixel * pixel;
    x.s.volume[0].extinction = (float)(1e-4 / depth);
    check_color(x.s.volume[0].emission, 0, 0, 0);
    result = scene_render(context, &x, 0, &picture);
    if (!CHECK_OK(context, result)) return;
    for (int i = 0; i < 64 * 64; ++i) mass -= log1p(-(double)picture.rgba[4 * i + 3]) / 1e-4;
    /* rays through pixels' middles meet a clipped box of n pixels as if it were n + 1 or n - 1 wide */
    double narrowest = HUGE_VAL;
    for (int k = 0; k < 3; ++k) {
        const double edge = vec_length(gas->placement.axis[k]) / gas->size[k];
        narrowest = fmin(narrowest, edge * (gas->crop[3 + k] > 0 ? gas->crop[3 + k] - gas->crop[k] : gas->size[k]));
    }
    const int clipped = (gas->crop[3] > 0 || gas->border > 0) && voxel_edge(gas) > 0.3 * pixel;
    if (!CHECK(fabs(mass - 1) <= 0.03 + (clipped ? pixel / narrowest : 0)))
        printf("    scene %ld far away, quality %d, voxels of %.4f pixels: %.4f of its mass\n", number,
               (int)view->quality, voxel_edge(gas) / pixel, mass);
}

/* --- light on a wall and on gas before it, against photons --- */

enum { BESIDE_SIDE = PHOTONS_SIDE, BESIDE_VOXELS = 12, BESIDE_PHOTONS = 30000, BESIDE_MORE = 10 }; /* a batch */
enum { FROM_FLAME, FROM_PARTICLE, FROM_LAMP, FROM_SUN_ALONG, FROM_SUN }; /* along: parallel to the wall */

/* A place `along` the view and across it, in the scene's own coordinates. */
static void beside_place(double frame[3][3], double across, double up, double along, double out[3]) {
    for (int k = 0; k < 3; ++k) out[k] = across * frame[0][k] + up * frame[1][k] + along * frame[2][k];
}

/* Gas about the scene's centre, of an optical depth of 0.1 to 4 where its values are 1. */
static void beside_gas(random_scene *x) {
    static const int shapes[3] = {FIELD_BLOB, FIELD_NOISE, FIELD_CONSTANT};
    static const double centre[3] = {0, 0, 0};
    const int shape = shapes[draw_below(&x->random, 3)], placement = draw_below(&x->random, 2);
    sps_volume *volume = &x->s.volume[x->s.scene.volume_count];
    add_volume(x, VOLUME_GAS, shape, SOURCE_READ, placement, BESIDE_VOXELS, centre);
    volume->appearance_fn = NULL; /* photons know gas of one color */
    volume->extinction = (float)(draw_log(&x->random, 0.1, 4) / x->scale);
    if (one_in(&x->random, 2)) return;
    x->lobes[0][0].asymmetry = (float)draw(&x->random, -0.3, 0.7), x->lobes[0][0].weight = 1;
    volume->lobes = x->lobes[0], volume->lobe_count = 1;
}

/* A few voxels that glow, half of them without absorbing. */
static void beside_flame(random_scene *x, const double place[3]) {
    const int n = x->s.scene.volume_count, shape = one_in(&x->random, 2) ? FIELD_BLOB : FIELD_CONSTANT;
    const double edge = draw_log(&x->random, 0.06, 0.2), scale = x->scale;
    sps_volume *volume = &x->s.volume[n];
    add_volume(x, VOLUME_GLOW, shape, SOURCE_READ, draw_below(&x->random, 2), 3 + draw_below(&x->random, 4), place);
    for (int a = 0; a < 3; ++a) {
        volume->size[a] = (int)fmax(volume->size[a], 3);
        for (int k = 0; k < 3; ++k) {
            volume->placement.origin[k] += 0.5 * (1 - edge) * volume->placement.axis[a][k];
            volume->placement.axis[a][k] *= edge;
        }
    }
    volume->appearance_fn = NULL; /* photons know gas of one color */
    memcpy(x->fields[n].values.size, volume->size, sizeof volume->size);
    x->fields[n].values.placement = volume->placement;
    x->formulas[n].scale = edge * scale;
    volume->extinction = one_in(&x->random, 2) ? 0 : (float)(draw_log(&x->random, 0.1, 2) / (edge * scale));
    for (int c = 0; c < 3; ++c) volume->emission[c] = (float)(draw(&x->random, 0.2, 1) / (edge * edge * edge * scale));
}

static void beside_particle(random_scene *x, const double place[3]) {
    sps_particles *set = &x->sets[x->s.scene.particle_set_count++];
    sps_particle *p = x->crowds[0].list;
    const double radius = draw_log(&x->random, 0.03, 0.1);
    double world[3];
    x->s.scene.particles = x->sets;
    set->count = 1, set->read_fn = read_scene_crowd, set->user = &x->crowds[0];
    set->soft = one_in(&x->random, 2);
    draw_color(&x->random, 0, 0.8, set->albedo);
    scene_to_world(x, place, world);
    for (int k = 0; k < 3; ++k) p->position[k] = (float)world[k];
    p->radius = (float)(radius * x->scale);
    p->optical_depth = (float)draw_log(&x->random, 0.05, 3);
    for (int c = 0; c < 3; ++c)
        set->emission[c] = (float)(draw(&x->random, 0.2, 1) / (radius * radius * fmin(1, (double)p->optical_depth)));
}

/* Suns shine along the wall, so that it has only gas's light, or onto it, as lamps do. */
static void beside_light(random_scene *x, int from, double frame[3][3], const double place[3]) {
    const int is_lamp = from == FROM_LAMP;
    const double turn = draw(&x->random, 0, 2 * PI), onto = from == FROM_SUN ? draw(&x->random, 0.2, 1) : 0;
    const double along = sqrt(1 - onto * onto);
    sps_light *light = check_add_light(&x->s, is_lamp ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL, 1);
    beside_place(frame, along * cos(turn), along * sin(turn), onto, light->direction);
    scene_to_world(x, place, light->position);
    draw_color(&x->random, 0.3, 1, light->color);
    for (int c = 0; c < 3 && is_lamp; ++c) light->color[c] *= (float)(x->scale * x->scale);
    light->shadow_source = SPS_SHADOW_AUTO;
}

/* What is seen lies before the eye, what gives light behind it, so that small sources are not in the picture. */
static void build_beside(random_scene *x, check_random random, int from) {
    const int has_wall = from >= FROM_LAMP || !one_in(&random, 4),
              has_gas = !has_wall || from >= FROM_LAMP || !one_in(&random, 3);
    const double wall = draw(&random, 0.1, has_wall ? 1.2 : 0.4), gap = draw_log(&random, 0.1, 1),
                 half = draw(&random, 0.3, 2);
    double frame[3][3], place[3], target[3];
    memset(x, 0, sizeof *x);
    check_clear(&x->s, BESIDE_SIDE, BESIDE_SIDE);
    x->scale = draw_log(&random, 0.01, 100);
    draw_rotation(&random, frame);
    x->random = random;
    x->voxels = BESIDE_VOXELS;
    x->s.view.scattering = one_in(&x->random, 2) ? SPS_SCATTERING_AUTO : SPS_SCATTERING_MULTIPLE;
    beside_place(frame, 0, 0, wall - gap, place);
    beside_place(frame, 0, 0, wall, target);
    scene_to_world(x, place, x->s.view.camera.position);
    scene_to_world(x, target, x->s.view.camera.target);
    memcpy(x->s.view.camera.up, frame[1], sizeof frame[1]);
    check_orthographic(&x->s.view.camera, x->scale * draw(&x->random, 0.5, 1));
    if (has_gas) beside_gas(x);
    if (has_wall) {
        double u[3], v[3];
        beside_place(frame, half, 0, 0, u);
        beside_place(frame, 0, half, 0, v);
        add_rectangle(x, target[0], target[1], target[2], u, v);
        check_add_mesh(&x->s, &x->triangles, 0.5);
        draw_color(&x->random, 0.3, 0.9, x->s.mesh[0].albedo);
        for (int a = 0; a < 3; ++a) x->s.mesh[0].placement.axis[a][a] = x->scale;
    }
    const double across = draw(&x->random, -0.3, 0.3), back = draw(&x->random, 0.25, 0.7);
    beside_place(frame, across, 0, wall - gap - back, place);
    if (from == FROM_FLAME) beside_flame(x, place);
    if (from == FROM_PARTICLE) beside_particle(x, place);
    if (from >= FROM_LAMP) beside_light(x, from, frame, place);
}

static int beside_quarter(int pixel) {
    return pixel % PHOTONS_SIDE / (PHOTONS_SIDE / 2) + 2 * (pixel / PHOTONS_SIDE / (PHOTONS_SIDE / 2));
}

/* Sums of each quarter's judged pixels by the renderer, by photons, and the latter's standard error. */
typedef struct beside_sums {
    double found[4], exact[4], error[4], mean; /* mean: of a judged pixel's colors */
    int pixels[4];
} beside_sums;

/* Standard errors are those of batches. */
static void sum_quarters(const photons_scene *p, const float *found,
                         double batches[PHOTONS_BATCHES][3 * PHOTONS_PIXELS], beside_sums *sums) {
    double squares[4] = {0};
    memset(sums, 0, sizeof *sums);
    for (int b = 0; b < PHOTONS_BATCHES; ++b) {
        double batch[4] = {0};
        for (int i = 0; i < PHOTONS_PIXELS; ++i)
            for (int c = 0; c < 3; ++c) batch[beside_quarter(i)] += batches[b][3 * i + c];
        for (int q = 0; q < 4; ++q) sums->exact[q] += batch[q], squares[q] += batch[q] * batch[q];
    }
    for (int i = 0; i < PHOTONS_PIXELS; ++i) {
        if (!p->judged[i]) continue;
        ++sums->pixels[beside_quarter(i)];
        for (int c = 0; c < 3; ++c) sums->found[beside_quarter(i)] += (double)found[4 * i + c];
    }
    int pixels = 0;
    for (int q = 0; q < 4; ++q) {
        sums->exact[q] /= PHOTONS_BATCHES, pixels += sums->pixels[q], sums->mean += sums->exact[q];
        squares[q] = fmax(0, squares[q] / PHOTONS_BATCHES - sums->exact[q] * sums->exact[q]);
        sums->error[q] = sqrt(squares[q] / (PHOTONS_BATCHES - 1));
    }
    sums->mean /= fmax(1, 3 * pixels);
}

/* Light from cell to cell has few directions [Lathrop 1968]: where a wall far from gas has no other light, which is
   where a sun shines along it, it may be off by tens of per cent of little. Returns how much a pixel's sum of colors
   may be, relative to what the sun would give the wall if it shone onto it: 0.72 %, the most of 131 scenes, 53 of which
   are off by more than 5 % of what they are, and a tenth more. */
#define BESIDE_RAYS 0.008

static double beside_rays(const random_scene *x) {
    const sps_light *sun = x->s.light;
    double toward[3], sum = 0;
    if (x->s.scene.light_count == 0 || sun->kind != SPS_LIGHT_DIRECTIONAL) return 0;
    vec_along(x->s.view.camera.target, x->s.view.camera.position, -1, toward);
    if (fabs(vec_dot(toward, sun->direction)) > 1e-6 * vec_length(toward)) return 0;
    for (int c = 0; c < 3; ++c) sum += (double)sun->color[c] * (double)x->s.mesh[0].albedo[c] / PI;
    return BESIDE_RAYS * sum;
}

/* Whether each quarter's sum is that of photons within so many standard errors, 5 % of it, 1 % of the picture's mean,
   and `rays` a pixel. Returns how many are not; unless `show` is 0, prints these, or all. */
static int compare_quarters(const beside_sums *s, double errors, double rays, int show) {
    int wrong = 0;
    if (s->mean < SCENE_DARK) return 0;
    for (int q = 0; q < 4; ++q) {
        const double off = s->found[q] - s->exact[q], few = (0.01 * s->mean * 3 + rays) * s->pixels[q];
        const int good = fabs(off) <= errors * s->error[q] + 0.05 * s->exact[q] + few;
        wrong += !good;
        if (show > 1 || (show && !good))
            printf("    quarter %d: %.4g, photons %.4g +- %.2f %%, %+.2f %%%s\n", q, s->found[q], s->exact[q],
                   100 * s->error[q] / s->exact[q], 100 * off / s->exact[q], good ? "" : ", failed");
    }
    return wrong;
}

/* Whether a quarter is known so badly that its noise might hide what is wrong. */
static int quarters_are_noisy(const beside_sums *s) {
    int noisy = 0;
    for (int q = 0; q < 4; ++q) noisy |= s->mean >= SCENE_DARK && s->error[q] > 0.04 * s->exact[q];
    return noisy;
}

/* Renders with default settings, and returns how many quarters are not right: by some photons, of little noise, within
   two standard errors, and if not, by ten times as many within three, and at last by a hundred times within five, which
   are 7 % or less, and below 2 % near small sources. excused: set to 1 if they are right but for few directions. */
static int compare_beside(sps_context *context, const random_scene *x, int show, int *excused) {
    static float found[4 * PHOTONS_PIXELS];
    static double batches[PHOTONS_BATCHES][3 * PHOTONS_PIXELS];
    static photons_scene p;
    static const double errors[3] = {2, 3, 5};
    const double rays = beside_rays(x);
    beside_sums sums;
    int wrong = 1, count = BESIDE_PHOTONS;
    if (!check_render(context, &x->s, found) || !CHECK(photons_begin(&p, x))) return 4;
    for (int n = 0; n < 3 && wrong; ++n, count *= BESIDE_MORE) {
        memset(batches, 0, sizeof batches);
        for (int b = 0; b < PHOTONS_BATCHES; ++b)
            for (int i = 0; i < count; ++i) photons_send(&p, 1.0 / count, batches[b]);
        sum_quarters(&p, found, batches, &sums);
        wrong = compare_quarters(&sums, errors[n], rays, show > 1 || (show && n == 2) ? show : 0);
        *excused = !wrong && compare_quarters(&sums, errors[n], 0, 0) > 0;
        wrong += n == 0 && quarters_are_noisy(&sums);
    }
    photons_end(&p);
    return wrong;
}

/* Two of three scenes have one of these beside them, by a generator of its own: what is lit by a flame of a few voxels
   or a particle, or a wall beside gas that a lamp or a sun lights. */
static void soak_beside(sps_context *context, soak *s, check_random random, long number) {
    static const char *const names[] = {"flame", "particle", "lamp", "sun along it", "sun"};
    static random_scene x;
    int from, excused = 0;
    for (int i = 0; i < 17; ++i) check_next(&random);
    if (one_in(&random, 3)) return;
    from = draw_below(&random, 5);
    build_beside(&x, random, from);
    if (getenv("SOAK_ALL")) printf("    scene %ld, light of a %s on a wall or gas:\n", number, names[from]);
    if (!CHECK(compare_beside(context, &x, getenv("SOAK_ALL") ? 2 : 1, &excused) == 0))
        printf("scene %ld, light of a %s on a wall or gas, failed\n", number, names[from]);
    if (excused) printf("scene %ld, light of a %s on a wall, may fail: few directions\n", number, names[from]);
    ++s->beside, s->beside_excused += excused;
    free_scene(&x);
}

/* --- particles smaller than a pixel --- */

/* Up to a hundred thin particles, of radii from 0.01 to 1.3 pixels, at any place in their pixels: the sums over the
   picture of its optical depth and of the light of an unshadowed sun are those of the closed form. The reference's rays
   through pixels' centres would miss most of them. 2 %: what widened ones promise. Particles are few and thin, so that
   what hides what is below 1 %; perspective is so narrow that rays are as if parallel, within 0.1 %. */
static void soak_specks(sps_context *context, check_random random, long number) {
    enum { SPECKS_SIDE = 32 };
    static random_scene x;
    static float rgba[4 * SPECKS_SIDE * SPECKS_SIDE];
    double pixel, mass = 0, depth = 0, light = 0, frame[3][3];
    sps_particles *set = x.sets;
    sps_view *view = &x.s.view;
    for (int i = 0; i < 23; ++i) check_next(&random);
    memset(&x, 0, sizeof x);
    check_clear(&x.s, SPECKS_SIDE, SPECKS_SIDE);
    draw_rotation(&random, frame);
    pixel = draw_log(&random, 0.001, 1000);
    view->quality = (sps_quality)draw_below(&random, 5);
    view->filling = (sps_filling)draw_below(&random, 3);
    for (int k = 0; k < 3; ++k) view->camera.position[k] = -640 * pixel * frame[2][k];
    memcpy(view->camera.up, frame[1], sizeof frame[1]);
    check_orthographic(&view->camera, SPECKS_SIDE * pixel);
    check_perspective(&view->camera, one_in(&random, 2) ? 2 * atan(0.5 * SPECKS_SIDE / 640) : 0);
    x.s.scene.particles = set, x.s.scene.particle_set_count = 1;
    set->read_fn = read_scene_crowd, set->user = &x.crowds[0];
    set->count = 1 + (size_t)draw_below(&random, 100);
    set->soft = one_in(&random, 2), set->is_extinction = one_in(&random, 2);
    check_color(set->albedo, 1, 1, 1);
    const double largest = draw_log(&random, 0.02, 1.3);
    for (size_t i = 0; i < set->count; ++i) {
        sps_particle *p = &x.crowds[0].list[i];
        const double radius = pixel * largest * draw(&random, 0.5, 1), thick = draw_log(&random, 1e-4, 1e-2);
        const double across = draw(&random, -12, 12) * pixel, up = draw(&random, -12, 12) * pixel;
        double place[3];
        beside_place(frame, across, up, 0, place);
        for (int k = 0; k < 3; ++k) p->position[k] = (float)place[k];
        p->radius = (float)radius;
        p->optical_depth = (float)(set->is_extinction ? thick / (radius * (set->soft ? 4 / 3.0 : 2)) : thick);
        mass += PI * thick * radius * radius / (pixel * pixel) * (set->soft ? 0.4 : 2 / 3.0);
    }
    check_add_directional(&x.s, frame[0][0], frame[0][1], frame[0][2], 4 * PI)->no_shadow = 1;
    if (!check_render(context, &x.s, rgba)) return;
    for (int i = 0; i < SPECKS_SIDE * SPECKS_SIDE; ++i)
        depth -= log1p(-(double)rgba[4 * i + 3]), light += (double)rgba[4 * i];
    if (getenv("SOAK_ALL")) printf("    scene %ld, specks: %.4f, %.4f\n", number, depth / mass, light / mass);
    if (!CHECK(fabs(depth / mass - 1) <= 0.02 && fabs(light / mass - 1) <= 0.03))
        printf("    scene %ld, %d particles up to %.3f pixels, quality %d, filling %d, %s: %.4f of their mass, %.4f of "
               "their light\n",
               number, (int)set->count, largest, (int)view->quality, (int)view->filling, set->soft ? "soft" : "even",
               depth / mass, light / mass);
}

static void soak_scene(sps_context *context, soak *s, long number) {
    static random_scene x;
    check_random random;
    int voxels, pixels;
    clock_t start;
    outcome o;
    memset(&o, 0, sizeof o);
    o.number = number;
    random.state = (s->seed * 1000003u + (uint64_t)number) * 0x9e3779b97f4a7c15u;
    check_next(&random);
    draw_levels(&random, o.levels);
    pixels = 40 + draw_below(&random, 25);
    voxels = 9 + draw_below(&random, 8);
    build_scene(&x, o.levels, random.state, voxels, pixels);
    o.images = throw_images(&x, random.state);
    o.cones = narrow_cones(&x, random.state);
    o.panes = draw_panes(&x, random.state);
    o.crops = draw_crops(&x, random.state);
    start = clock();
    o.report = measure_scene(context, &x, 1);
    if (scene_shown(&o.report) && !scene_good(&o.report)) o.reason = excuse(context, &x, &o.report);
    o.seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    if (o.report.result != SPS_OK) {
        const int area = o.levels[LIGHT] >= LIGHT_WIDE_SUN && strstr(sps_error(context), "light[0]");
        if (!CHECK(o.report.result == SPS_ERROR_UNSUPPORTED && !area))
            printf("    scene %ld: %s\n", number, sps_error(context));
        ++s->refused;
    } else if (o.report.high.mean < SCENE_DARK)
        ++s->dark;
    else if (!scene_shown(&o.report))
        ++s->hidden;
    else
        judge(s, &o);
    if (o.report.result == SPS_OK && number % 2 == 0) check_edges(context, &x, 2 + (int)(number / 2 % 4));
    soak_distance(context, &x, random, number);
    soak_beside(context, s, random, number);
    soak_specks(context, random, number);
    soak_cells(context, &x, o.levels, number);
    free_scene(&x);
}

static void print_summary(const soak *s) {
    printf("the worst, by error at medium, then at high quality, relative to the reference's mean:\n");
    for (int i = 0; i < s->worst_count; ++i) print_outcome(s, &s->worst[i]);
    printf("%ld compared, %ld of them failed, %ld more may fail; %ld refused, %ld dark, %ld too near a lamp\n",
           s->compared, s->failed, s->excused, s->refused, s->dark, s->hidden);
    printf("%ld beside a light, %ld of them may fail\n", s->beside, s->beside_excused);
}

/* What a process has counted. */
typedef struct soak_count {
    soak s; /* the reasons that it points to are at the same place in all processes */
    int passed, failed;
} soak_count;

/* Adds what another process has counted to this one's. */
static void add_count(soak *s, const soak_count *other) {
    const soak *t = &other->s;
    s->compared += t->compared, s->refused += t->refused, s->dark += t->dark, s->hidden += t->hidden;
    s->failed += t->failed, s->excused += t->excused, s->beside += t->beside, s->beside_excused += t->beside_excused;
    for (int i = 0; i < t->worst_count; ++i) rank(s, &t->worst[i]);
    check_passed += other->passed, check_failed += other->failed;
}

/* Every n-th scene from `first` on, one after the other; the chosen ones if n is 0. */
static void soak_every(soak *s, long first, long end, long n, int workers) {
    ex_session session;
    ex_session_measure(&session, "soak", workers);
    for (int i = 0; i < QUICK && n == 0; ++i) soak_scene(session.context, s, quick[i]);
    for (long i = first; i < end && n > 0; i += n) {
        soak_scene(session.context, s, i);
        fflush(stdout); /* the lines of a scene stay together */
    }
    ex_session_end(&session);
}

/* The scenes are shared by as many processes as there are processors: much of the work has a single thread, or waits
   for its slowest. Results do not depend on it. */
static void soak_together(soak *s, long first, long scenes) {
    enum { MOST = 64 };
    const int most = scenes < 2 * MOST ? (int)scenes / 2 : MOST;
    const int processors = most < 1 ? 1 : ex_processor_count() < most ? ex_processor_count() : most;
    int pipes[MOST][2];
    static soak_count other;
    fflush(stdout);
    for (int k = 1; k < processors; ++k) {
        if (!CHECK(pipe(pipes[k]) == 0)) return;
        if (fork() != 0) continue;
        soak_every(s, first + k, first + scenes, processors, 1);
        other.s = *s, other.passed = check_passed, other.failed = check_failed;
        exit(write(pipes[k][1], &other, sizeof other) != sizeof other);
    }
    soak_every(s, first, first + scenes, processors, processors > 1 ? 1 : 0);
    for (int k = 1; k < processors; ++k) {
        close(pipes[k][1]);
        FILE *from = fdopen(pipes[k][0], "rb");
        if (!CHECK(from != NULL)) return;
        if (CHECK(fread(&other, sizeof other, 1, from) == 1)) add_count(s, &other);
        fclose(from);
    }
}

int main(int count, char **arguments) {
    static soak s;
    const long scenes = count > 2 ? strtol(arguments[2], NULL, 10) : check_long() ? 20L : 0L;
    const long first = count > 3 ? strtol(arguments[3], NULL, 10) : 0;
    s.seed = count > 1 ? strtoul(arguments[1], NULL, 10) : 1;
    s.show_all = getenv("SOAK_ALL") != NULL;
    if (scenes > 0)
        soak_together(&s, first, scenes);
    else
        soak_every(&s, 0, 0, 0, 0);
    print_summary(&s);
    CHECK_CASE("Found in review", "random scenes against brute force, medium and high quality",
               "rms of 3 %, or half of it at high: scenes that are not", (double)s.failed, 0,
               "causes are listed in tests/soak.c, with bounds");
    CHECK(s.excused <= (scenes > 0) + s.compared / 20);            /* 2 in 100 fail, none of the quick ones */
    CHECK(5 * (s.refused + s.dark + s.hidden) <= s.compared + 10); /* most are compared */
    return check_report();
}
