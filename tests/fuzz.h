/* Scenes that try to break the library, drawn from a generator (fuzz.c) or from the bytes of a file (test_seeds.c), and
   what holds for all of them: SPS_OK means an image of finite numbers, not negative, coverage 0..1, in memory within
   the plan, and the same bits for any workers; any other result means an untouched image and a sentence. Under
   sanitizers, also no access out of bounds and no undefined arithmetic. */

#ifndef FUZZ_H
#define FUZZ_H

#include "check.h"

/* The generator, and bytes that are drawn before it. */
static check_random numbers;
static const uint8_t *drawn;
static size_t drawn_left;

/* Scenes from bytes are tiny, so that a fuzzer tries hundreds a second, and have providers that lie. Those of a
   generator stay as they were. */
static int from_bytes;

static int next_byte(void) {
    if (drawn_left == 0) return (int)(256 * check_next(&numbers));
    --drawn_left;
    return *drawn++;
}

/* Draws from these bytes, and when they end from the generator that the first two choose. */
static inline void begin_bytes(const uint8_t *bytes, size_t size) {
    drawn = bytes, drawn_left = size, from_bytes = 1;
    numbers.state = 0;
    for (int i = 0; i < 2 && drawn_left > 0; ++i) numbers.state = 256 * numbers.state + (uint64_t)next_byte();
    check_next(&numbers);
}

static double unit(void) {
    if (!from_bytes) return check_next(&numbers);
    const int high = next_byte();
    return (256 * high + next_byte()) / 65536.0;
}

static double between(double low, double high) { return low + (high - low) * unit(); }

static int below(int count) { return from_bytes && count <= 256 ? next_byte() * count / 256 : (int)(unit() * count); }

/* What is rare takes large bytes: files are full of zeros and text. */
static int one_in(int count) { return below(count) == (from_bytes ? count - 1 : 0); }

/* A number that determines what a provider delivers. */
static uint64_t next_seed(void) { return from_bytes ? (uint64_t)next_byte() * 0x9e3779b97f4a7c15u : numbers.state; }

/* Keeps scenes from bytes tiny. */
static int limited(int size, int most) { return from_bytes && size > most ? most : size; }

/* Mostly a moderate number, sometimes one near the limits of a double or a float. */
static double strange(double low, double high) {
    static const double ends[] = {0, -0.0, 1e-300, 1e-40, 1e-20, 1e20, 1e30, 1e300, -1, -1e20};
    if (!one_in(60)) return between(low, high);
    if (one_in(5)) return HUGE_VAL;
    if (one_in(5)) return HUGE_VAL - HUGE_VAL;
    return ends[below((int)(sizeof ends / sizeof *ends))];
}

/* -------------------------------------------------------------------------------------------------------- providers */

/* What is wrong with what a provider delivers. */
typedef enum lie { HONEST = 0, NARROW_RANGE, FICKLE, GARBAGE, LIES } lie;

typedef struct provider {
    int kind, fails; /* 1 in `fails` calls fails; 0: none */
    lie lies;
    double scale;
    uint64_t seed;
    check_random coin; /* for failures, separate from the scene's own numbers */
} provider;

/* Calls of all providers, and the number of the one that fails; 0: none. */
static long provider_calls, provider_fails_at;

static int fails_now(provider *p) {
    if (p->lies == FICKLE) p->seed += 0x632be59bd9b4e019u; /* the next call delivers something else */
    if (++provider_calls == provider_fails_at) return 1;
    return p->fails > 0 && check_next(&p->coin) * p->fails < 1;
}

/* Of a provider that delivers garbage, one number in 16. */
static double garbled(const provider *p, double value, uint64_t place) {
    static const double garbage[] = {-1, -0.0, 1e-40, -1e-40, 1e18, 1.1e18, 3e38, -3e38};
    const uint64_t hash = (place + 1) * 0xd1342543de82ef95u + p->seed, kind = hash >> 32;
    if (p->lies != GARBAGE || kind % 16) return value;
    return kind / 16 % 10 == 8 ? HUGE_VAL : kind / 16 % 10 == 9 ? HUGE_VAL - HUGE_VAL : garbage[kind / 16 % 10];
}

static double field_value(const provider *p, double x, double y, double z) {
    const uint64_t place = (uint64_t)(int64_t)floor(x * 7919 + y * 104729 + z * 1299709);
    const uint64_t hash = place * 0x9e3779b97f4a7c15u + p->seed;
    if (p->lies == GARBAGE) return garbled(p, p->scale, place);
    switch (p->kind) {
    case 0: return p->scale;
    case 1: return p->scale * (double)(hash >> 40) / 16777216.0;
    case 2: return (hash >> 32) % 50 == 0 ? p->scale : 0;
    case 3: return p->scale * exp(-x * x - y * y - z * z);
    case 4: return x < y ? p->scale : 0;
    default: return (hash >> 32) % 4000 == 0 ? HUGE_VAL - HUGE_VAL : p->scale * fabs(sin(x) * cos(y + z));
    }
}

static int read_voxels(void *user, const int lo[3], const int size[3], float *out) {
    provider *p = (provider *)user;
    for (int k = 0; k < size[2]; ++k)
        for (int j = 0; j < size[1]; ++j)
            for (int i = 0; i < size[0]; ++i)
                *out++ = (float)field_value(p, 0.3 * (lo[0] + i), 0.3 * (lo[1] + j), 0.3 * (lo[2] + k));
    return fails_now(p);
}

static int eval_voxels(void *user, size_t count, const double *xyz, float *out) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < count; ++i, xyz += 3) {
        const int sane = fabs(xyz[0]) < 1e6 && fabs(xyz[1]) < 1e6 && fabs(xyz[2]) < 1e6;
        out[i] = sane ? (float)field_value(p, xyz[0], xyz[1], xyz[2]) : 0;
    }
    return fails_now(p);
}

/* The widest bounds, or empty if the field is empty throughout. */
static int range_voxels(void *user, const int lo[3], const int size[3], float out[2]) {
    provider *p = (provider *)user;
    (void)lo;
    (void)size;
    out[0] = 0;
    if (p->lies == NARROW_RANGE) return out[0] = out[1] = (float)(0.5 * p->scale), fails_now(p);
    if (p->lies == GARBAGE) return out[0] = (float)garbled(p, 0, 1), out[1] = (float)garbled(p, 1, 2), fails_now(p);
    out[1] = p->scale > 0 && p->scale < 1e18 ? (float)(p->kind == 5 ? HUGE_VAL : p->scale) : (float)(p->scale);
    return fails_now(p);
}

static int transfer_curve(void *user, size_t count, const float *values, sps_transfer_point *out) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < count; ++i) {
        const double t = (double)values[i] / (p->scale > 0 ? p->scale : 1);
        check_color(out[i].albedo, fmin(1, fabs(t)), 0.5, 0.2);
        out[i].extinction = (float)garbled(p, t > 0.3 ? 5 * t : 0, (uint64_t)i);
        if (p->scale > 1) out[i].emission[1] = (float)garbled(p, t, (uint64_t)i);
    }
    return fails_now(p);
}

static int background_sky(void *user, size_t count, const float *directions, float *rgb) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < 3 * count; ++i)
        rgb[i] = (float)garbled(p, 0.5 + 0.5 * (double)directions[i], (uint64_t)(1000 + 1000 * directions[i]));
    return fails_now(p);
}

/* A texture that depends on the point alone; kind 5 leaves the range in one place in 4000. */
static int shade_points(void *user, size_t count, const sps_surface_point *points, sps_surface *out) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < count; ++i) {
        const sps_surface_point *at = &points[i];
        const uint64_t hash = ((uint64_t)at->x * 7919 + (uint64_t)at->y * 104729) * 0x9e3779b97f4a7c15u + p->seed;
        for (int c = 0; c < 3; ++c) out[i].albedo[c] *= 0.5f + 0.5f * at->normal[c];
        if (p->kind == 1) check_color(out[i].albedo, fmod(fabs(at->uv[0]), 1), fmod(fabs(at->uv[1]), 1), 0.5);
        if (p->kind == 2) out[i].emission[at->triangle % 3] = fabsf(at->weights[1]);
        if (p->kind == 3) out[i].albedo[0] = fminf(1, fabsf(at->uv_dx[0]) + fabsf(at->uv_dy[1]));
        if (p->kind == 5 && (hash >> 32) % 4000 == 0) out[i].emission[1] = (float)(HUGE_VAL - HUGE_VAL);
        if (p->lies == GARBAGE) out[i].albedo[at->x % 3] = (float)garbled(p, 0.5, hash);
    }
    return fails_now(p);
}

/* Mostly colors of 0..1 or a little more; `kind` as for a field. */
static int sample_image(void *user, size_t count, const float *uv, float *rgb) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < 3 * count; ++i)
        rgb[i] = (float)field_value(p, 9 * (double)uv[2 * (i / 3)], 9 * (double)uv[2 * (i / 3) + 1], (double)(i % 3));
    return fails_now(p);
}

/* Every particle has its own random numbers, whichever block it is read in. */
static int read_particles(void *user, size_t first, size_t count, sps_particle *out) {
    provider *p = (provider *)user;
    for (size_t i = 0; i < count; ++i) {
        check_random own;
        double size;
        own.state = p->seed + 7919 * (uint64_t)(first + i);
        for (int k = 0; k < 3; ++k) check_next(&own);
        for (int k = 0; k < 3; ++k) out[i].position[k] = (float)((2 * check_next(&own) - 1) * (p->kind == 2 ? 9 : 1));
        size = check_next(&own);
        out[i].radius = (float)(p->kind == 0 ? 0.3 * size : p->kind == 1 ? 0.01 * size : pow(size, 12) * 3);
        out[i].optical_depth = (float)(p->scale * check_next(&own));
        if (p->kind == 5 && (first + i) % 100 == 99) out[i].position[i / 100 % 3] = (float)(HUGE_VAL - HUGE_VAL);
        if (p->kind == 4 && (first + i) % 100 == 9) out[i].position[0] *= 1e9f;
        if (p->kind == 3 && (first + i) % 100 == 9) out[i].radius *= check_next(&own) < 0.5 ? 1e6f : 1e-12f;
        for (int c = 0; c < 3; ++c) out[i].albedo[c] = (float)fmin(1, size * (c + 1));
        if (p->lies == GARBAGE) out[i].radius = (float)garbled(p, 0.1, (uint64_t)(first + i));
    }
    return fails_now(p);
}

/* ----------------------------------------------------------------------------------------------------------- scenes */

/* Sets an enumeration to any number, even one that it does not have. */
static void put_int(void *field, int value) { memcpy(field, &value, sizeof value); }

enum { VOLUMES = 3, MESHES = 2, LIGHTS = 3, SETS = 2, PIXELS_MAX = 90 * 90, TINY = 80 /* pixels */ };

typedef struct scenery {
    check_scene s;
    sps_grid grids[VOLUMES];
    sps_indexed_mesh indexed[MESHES];
    void *memory[VOLUMES + 5 * MESHES + LIGHTS +
                 1]; /* what these read, each block of exactly the size that they may read */
    int memory_count;
    provider providers[VOLUMES], sky, crowds[SETS], textures[MESHES], images[LIGHTS];
    sps_particles sets[SETS];
    sps_projector projectors[LIGHTS];
    sps_tmap_settings maps[LIGHTS];
    sps_transfer transfers[VOLUMES];
    sps_transfer_point points[VOLUMES][4];
    sps_lobe lobes[VOLUMES][2];
    check_triangles triangles[MESHES];
    double matrix[16];
} scenery;

static void random_color(float color[3], double most) {
    const int grey = one_in(3);
    for (int c = 0; c < 3; ++c) color[c] = c && grey ? color[0] : (float)strange(0, most);
    if (one_in(4)) memset(color, 0, 3 * sizeof *color);
}

static void random_placement(sps_placement *placement) {
    for (int i = 0; i < 3; ++i) {
        placement->origin[i] = strange(-1.5, 0.5);
        for (int k = 0; k < 3; ++k)
            placement->axis[i][k] = i == k ? strange(0.05, 2) : one_in(3) ? strange(-0.7, 0.7) : 0;
    }
    if (one_in(30)) memset(placement->axis, 0, sizeof placement->axis);
    if (one_in(60)) memcpy(placement->axis[1], placement->axis[0], sizeof placement->axis[0]);
}

static void random_provider(provider *p) {
    static const double scales[] = {1, 1, 1, 1, 0.01, 100, 0, 1e-35, 1e17};
    memset(p, 0, sizeof *p);
    p->kind = one_in(30) ? 5 : below(5);
    p->scale = scales[below((int)(sizeof scales / sizeof *scales))];
    p->fails = one_in(40) ? 4 : 0;
    p->seed = p->coin.state = next_seed();
    if (from_bytes && one_in(16)) p->lies = (lie)(1 + below(LIES - 1));
}

static void random_transfer(scenery *x, int n, sps_volume *volume) {
    sps_transfer *transfer = &x->transfers[n];
    volume->transfer = transfer;
    transfer->user = &x->providers[n];
    volume->shading = one_in(2) ? SPS_SHADING_SURFACE : SPS_SHADING_GAS;
    volume->specular = (float)strange(0, 1);
    volume->shininess = (float)strange(0, 100);
    if (one_in(2)) volume->gradient_full = (float)strange(0, 0.5);
    if (one_in(3)) {
        transfer->eval_fn = transfer_curve;
        transfer->value_max = (float)x->providers[n].scale;
        return;
    }
    transfer->points = x->points[n];
    transfer->point_count = 1 + below(4);
    for (int i = 0; i < 4; ++i) {
        x->points[n][i].value = (float)((i + 0.9 * unit()) * 0.3 * x->providers[n].scale);
        random_color(x->points[n][i].albedo, 1);
        x->points[n][i].extinction = one_in(3) ? 0 : (float)strange(0, 20);
        if (one_in(3)) random_color(x->points[n][i].emission, 2);
    }
}

/* Memory with arbitrary contents until the scenery is freed. */
static void *random_memory(scenery *x, size_t size) {
    check_random own;
    uint8_t *memory = (uint8_t *)malloc(size ? size : 1);
    if (!memory) abort();
    own.state = next_seed();
    for (size_t i = 0; i < size; ++i) memory[i] = (uint8_t)(256 * check_next(&own));
    return x->memory[x->memory_count++] = memory;
}

/* Voxels in memory: packed or with gaps, forwards or backwards, valid for the most part. */
static void random_grid(scenery *x, int n) {
    sps_volume *volume = &x->s.volume[n];
    sps_grid *grid = &x->grids[n];
    const size_t bytes[] = {1, 1, 2, 2, 4, 2, 4};
    const int format = one_in(16) ? below(7) : 1 + below(3); /* floats of arbitrary bits are mostly refused */
    size_t stride = bytes[format], before = 0;
    const int packed = one_in(2), border = one_in(40) || volume->border < 0 ? below(4) : limited(volume->border, 5);
    put_int(&grid->format, format);
    grid->border = border;
    for (int i = 0; i < 3; ++i) {
        const int size = (volume->size[i] > 0 ? volume->size[i] : 1) + 2 * border, backwards = !packed && one_in(3);
        grid->size[i] = one_in(40) ? volume->size[i] + below(3) - 1 : volume->size[i];
        if (!packed) stride += bytes[format] * (size_t)below(3);
        if (!packed) grid->stride[i] = backwards ? -(ptrdiff_t)stride : (ptrdiff_t)stride;
        before += stride * (size_t)(backwards ? size - 1 - border : border);
        stride *= (size_t)size;
    }
    grid->voxels = one_in(40) ? NULL : (uint8_t *)random_memory(x, stride) + before;
    grid->scale = format == 1 ? 1 / 255.0f : format == 2 ? 1 / 65535.0f : one_in(4) ? (float)strange(-1, 1) : 0;
    if (one_in(8)) grid->offset = (float)strange(-0.2, 0.2);
    volume->read_fn = sps_grid_read, volume->eval_fn = NULL, volume->range_fn = one_in(2) ? sps_grid_range : NULL;
    volume->user = grid;
}

/* Faces that cut the volume, mostly valid, and voxels beyond it. */
static void random_crop(sps_volume *volume) {
    for (int k = 0; k < 3; ++k) {
        const int size = volume->size[k] > 0 ? volume->size[k] : 1;
        volume->crop[k] = below(size + 1);
        volume->crop[3 + k] = one_in(30) ? below(size + 2) : volume->crop[k] + below(size + 1 - volume->crop[k]);
    }
    if (one_in(4)) memset(volume->crop, 0, sizeof volume->crop);
    if (one_in(2)) volume->border = one_in(40) ? 65538 * below(2) - 1 : below(6); /* -1, 65537: refused */
    volume->range_levels = one_in(40) ? below(6) - 1 : below(4);
}

static void random_volume(scenery *x, int n) {
    static const int sizes[] = {1, 2, 3, 7, 8, 9, 15, 20, 33, 5, 5, 12};
    sps_volume *volume = &x->s.volume[n];
    for (int i = 0; i < 3; ++i) volume->size[i] = limited(one_in(40) ? below(3) - 1 : sizes[below(12)], 9);
    random_placement(&volume->placement);
    random_provider(&x->providers[n]);
    volume->user = &x->providers[n];
    if (one_in(3))
        volume->eval_fn = eval_voxels;
    else
        volume->read_fn = read_voxels;
    if (one_in(4) && x->providers[n].kind < 5) volume->range_fn = range_voxels;
    volume->extinction = (float)(one_in(8) ? 0 : one_in(12) ? 1e8 : strange(0, 6));
    random_color(volume->albedo, 1);
    if (one_in(3)) random_color(volume->emission, 2);
    if (one_in(3)) {
        volume->lobes = x->lobes[n];
        volume->lobe_count = 1 + below(2);
        for (int i = 0; i < 2; ++i) {
            x->lobes[n][i].asymmetry = (float)strange(-0.99, 0.99);
            x->lobes[n][i].weight = (float)strange(0.1, 1);
        }
    }
    if (one_in(3)) random_transfer(x, n, volume);
    if (one_in(3)) volume->revision = 1 + (uint64_t)below(3);
    if (!from_bytes) return;
    if (one_in(5)) random_crop(volume);
    volume->concurrent = one_in(3);
    if (one_in(4)) random_grid(x, n);
}

static float *random_floats(scenery *x, size_t count) {
    float *floats = (float *)random_memory(x, count * sizeof *floats);
    for (size_t i = 0; i < count; ++i) floats[i] = (float)(one_in(100) ? strange(-1, 1) : between(-1, 1));
    return floats;
}

/* The mesh's triangles, by indices of few vertices, valid for the most part. */
static void random_indexed(scenery *x, int n) {
    sps_mesh *mesh = &x->s.mesh[n];
    sps_indexed_mesh *indexed = &x->indexed[n];
    const size_t vertices = 3 + (size_t)below(6), corners = 3 * mesh->triangle_count;
    const int indices = below(3), wrong = one_in(20);
    indexed->vertex_count = indices ? vertices : 3 * mesh->triangle_count;
    indexed->triangle_count = mesh->triangle_count;
    indexed->positions = random_floats(x, 3 * indexed->vertex_count);
    if (mesh->has_normals || one_in(4)) indexed->normals = random_floats(x, 3 * indexed->vertex_count);
    if (mesh->has_albedos && !one_in(20)) {
        float *colors = random_floats(x, 3 * indexed->vertex_count);
        for (size_t i = 0; i < 3 * indexed->vertex_count; ++i) colors[i] = fabsf(colors[i]);
        indexed->albedos = colors;
    }
    if (one_in(2)) indexed->uvs = random_floats(x, 2 * indexed->vertex_count);
    if (indices == 1) {
        uint16_t *list = (uint16_t *)random_memory(x, corners * sizeof *list);
        for (size_t i = 0; i < corners; ++i) list[i] = (uint16_t)(list[i] % (vertices + (size_t)wrong));
        indexed->indices_u16 = list;
    } else if (indices == 2) {
        uint32_t *list = (uint32_t *)random_memory(x, corners * sizeof *list);
        for (size_t i = 0; i < corners; ++i) list[i] = (uint32_t)(list[i] % (vertices + (size_t)wrong));
        indexed->indices_u32 = list;
    }
    if (one_in(30)) mesh->triangle_count += (size_t)below(3); /* more than there are */
    mesh->read_fn = sps_indexed_mesh_read, mesh->user = indexed;
}

static void random_mesh(scenery *x, int n) {
    const int count = limited(one_in(8) ? 300 : below(12), 20);
    sps_mesh *mesh = &x->s.mesh[n];
    for (int i = 0; i < count; ++i) {
        sps_triangle *t = check_add_triangle(&x->triangles[n]);
        const double size = one_in(20) ? 50 : one_in(10) ? 0 : 1;
        for (int corner = 0; corner < 3; ++corner)
            for (int k = 0; k < 3; ++k) {
                t->position[corner][k] = (float)(between(-1, 1) * size);
                t->normal[corner][k] = (float)between(-1, 1);
                t->albedo[corner][k] = (float)unit();
                if (k < 2) t->uv[corner][k] = (float)between(-2, 2);
            }
        if (one_in(400)) t->position[1][1] = (float)(HUGE_VAL - HUGE_VAL);
        if (one_in(400)) t->uv[1][1] = one_in(2) ? 3e38f : (float)HUGE_VAL;
    }
    mesh->triangle_count = x->triangles[n].count;
    mesh->read_fn = check_read_triangles;
    mesh->user = &x->triangles[n];
    mesh->has_normals = one_in(2);
    mesh->has_albedos = one_in(2);
    random_color(mesh->albedo, 1);
    if (one_in(2)) random_placement(&mesh->placement);
    if (one_in(3)) random_color(mesh->transmittance, 1);
    if (from_bytes && one_in(3)) mesh->revision = 1 + (uint64_t)below(3);
    if (from_bytes && one_in(4)) random_indexed(x, n);
    if (!one_in(3)) return;
    random_provider(&x->textures[n]);
    mesh->shade_fn = shade_points;
    mesh->shade_user = &x->textures[n];
}

static void random_set(scenery *x, int n) {
    sps_particles *set = &x->sets[n];
    random_provider(&x->crowds[n]);
    if (one_in(20)) x->crowds[n].kind = 5;
    set->count = one_in(8) ? 0 : (size_t)limited(one_in(6) ? 9000 : below(300), 40);
    set->read_fn = read_particles;
    set->user = &x->crowds[n];
    set->soft = one_in(2);
    set->is_extinction = one_in(3);
    random_color(set->albedo, 1);
    if (one_in(3)) random_color(set->emission, 2);
    if (one_in(3) && x->lobes[n][0].weight > 0) set->lobes = x->lobes[n], set->lobe_count = 1; /* of a volume */
}

/* Valid settings, except for one in twelve. */
static void random_map(sps_tmap_settings *map) {
    static const int components[] = {0, 0, 0, 1, 7, 8, 9, 7, 10, 3, 20};
    memset(map, 0, sizeof *map);
    put_int(&map->technique, one_in(60) ? 11 : below(11));
    if (one_in(2) && (int)map->technique < 11) map->components = components[map->technique];
    if (one_in(24)) map->components = below(70) - 2;
    map->cubic = one_in(2);
    map->texel_range = one_in(3) && map->components == 0;
    if (one_in(3)) map->epsilon = (float)strange(0, 0.5);
    if (one_in(10)) map->byte_budget = (size_t)below(100000);
}

/* Planes of an opacity map, valid for the most part. */
static void random_planes(scenery *x, sps_tmap_settings *map) {
    const int count = 1 + below(8), deep = map->technique == SPS_TMAP_DEEP_OPACITY;
    if (map->technique != SPS_TMAP_OPACITY && !deep && !one_in(20)) return;
    if (!one_in(3)) return;
    map->components = one_in(20) ? 0 : count + (deep ? 2 : 0);
    float *planes = (float *)random_memory(x, (size_t)count * sizeof *planes);
    for (int i = 0; i < count; ++i) planes[i] = (float)((i + (i + 1 < count ? unit() : 1)) / count);
    if (one_in(8)) planes[below(count)] = (float)strange(-1, 2);
    map->planes = planes;
}

/* An extent and a cone, valid for the most part. */
static void random_extent(sps_light *light) {
    if (one_in(2)) return;
    put_int(&light->kind, below(one_in(30) ? 6 : 4));
    if (light->kind == SPS_LIGHT_DIRECTIONAL || one_in(30)) light->angular_diameter = strange(0, 0.4);
    for (int a = 0; a < 2; ++a)
        for (int i = 0; i < 3; ++i) light->axes[a][i] = one_in(3) ? 0 : strange(-0.5, 0.5);
    light->samples = one_in(20) ? below(400) - 20 : below(12);
    if (from_bytes && (light->samples == 0 || light->samples > 9) && !one_in(30)) light->samples = 1 + below(9);
    if (light->kind == SPS_LIGHT_DIRECTIONAL || one_in(2)) return;
    light->outer_cone = strange(0, 1.5);
    light->inner_cone = one_in(10) ? strange(0, 1.5) : light->outer_cone * unit();
}

/* An image, valid for the most part, of a few texels, at times of many or of a strange number. */
static void random_projector(scenery *x, int n) {
    static const int sizes[] = {0, -1, 4097, 4096, 700, 2147483647};
    sps_light *light = &x->s.light[n];
    sps_projector *projector = &x->projectors[n];
    random_provider(&x->images[n]);
    projector->width = one_in(40) ? sizes[below(6)] : 1 + below(one_in(6) ? 200 : 12);
    projector->height = one_in(40) ? sizes[below(5)] : 1 + below(one_in(6) ? 200 : 12); /* rows are calls */
    if (projector->width <= 4096) projector->width = limited(projector->width, 20);
    if (projector->height <= 4096) projector->height = limited(projector->height, 20);
    projector->sample_fn = one_in(100) ? NULL : sample_image;
    projector->user = &x->images[n];
    projector->left = strange(-2, 0.5), projector->right = projector->left + strange(0.05, 3);
    projector->bottom = strange(-2, 0.5), projector->top = projector->bottom + strange(0.05, 3);
    for (int i = 0; i < 3; ++i) projector->up[i] = one_in(3) ? 0 : strange(-1, 1);
    if (one_in(2)) projector->focus = one_in(10) ? strange(0, 1) : strange(2, 9);
    light->projector = projector;
}

static void random_light(scenery *x, int n) {
    sps_light *light = &x->s.light[n];
    light->kind = one_in(2) ? SPS_LIGHT_POINT : SPS_LIGHT_DIRECTIONAL;
    for (int i = 0; i < 3; ++i) {
        light->direction[i] = one_in(4) ? below(3) - 1 : strange(-1, 1);
        light->position[i] = one_in(6) ? strange(-1, 1) : strange(-9, 9);
    }
    random_color(light->color, 5);
    random_extent(light);
    if (one_in(4)) random_projector(x, n);
    if (one_in(4)) put_int(&light->falloff, one_in(30) ? 2 : 1);
    light->no_shadow = one_in(5);
    random_map(&x->maps[n]);
    if (from_bytes) random_planes(x, &x->maps[n]);
    if (one_in(3)) light->shadow_map = &x->maps[n];
    if (one_in(light->shadow_map ? 60 : 2)) put_int(&light->shadow_source, one_in(30) ? below(5) - 1 : below(3));
    light->shadow_map_omnidirectional = one_in(light->kind == SPS_LIGHT_DIRECTIONAL ? 100 : 5);
    light->shadow_map_resolution = limited(1 + below(one_in(4) ? 100 : 20), 12);
}

/* A perspective matrix that is unusable half of the time. */
static void random_matrix(scenery *x) {
    for (int i = 0; i < 16; ++i) x->matrix[i] = one_in(3) ? 0 : strange(-2, 2);
    if (one_in(2)) {
        const double look[16] = {2, 0, 0, 0.1, 0, 2, 0, 0.2, 0, 0, 1, 3, 0, 0, -1, 5};
        memcpy(x->matrix, look, sizeof look);
    }
    check_matrix(&x->s.view.camera, x->matrix);
}

/* What a scene from bytes draws by itself, and what would take long otherwise. */
static void random_tiny_view(sps_view *view) {
    view->shadow_resolution = view->shadow_resolution == 0 ? 16 : limited(view->shadow_resolution, 24);
    view->scattering = (sps_scattering)below(6);
    view->scattering_resolution = 1 + below(6);
    view->scattering_tolerance = one_in(2) ? 0 : (float)strange(0, 1);
    view->filling = (sps_filling)below(3);
    view->tolerance = one_in(2) ? 0 : (float)strange(0, 1);
    if (one_in(40)) put_int(&view->scattering, 6);
    if (one_in(40)) put_int(&view->filling, 3);
    if (one_in(40)) view->scattering_resolution = one_in(2) ? 257 : below(40) - 20;
}

/* Leaves a view's settings to a budget; it is drawn from nothing, too. */
static void random_budget(sps_view *view) {
    view->quality = SPS_QUALITY_DEFAULT;
    view->slab_thickness = 0, view->tolerance = view->height % 29 == 28 ? 0.1f : 0, view->scattering_resolution = 0;
    view->budget_seconds = view->height % 2 ? 1e-4 * view->height : view->height % 34 == 32 ? -1 : 0;
    view->budget_error = view->height % 2 ? 0 : 0.1 * (view->height % 5);
    view->budget_scale_min = view->height % 4 == 3 ? 0.2 * (view->height % 7) : 0;
}

static void random_view(scenery *x) {
    sps_view *view = &x->s.view;
    view->width = one_in(30) ? below(3) - 1 : 1 + below(one_in(4) ? 90 : 24);
    view->height = one_in(30) ? below(3) - 1 : 1 + below(one_in(4) ? 90 : 24);
    if (view->width > 0) view->height = limited(view->height, 1 + TINY / view->width);
    for (int i = 0; i < 3; ++i) {
        view->camera.position[i] = one_in(5) ? strange(-1, 1) : strange(-6, 6);
        view->camera.target[i] = strange(-0.5, 0.5);
        view->camera.up[i] = one_in(3) ? 0 : strange(-1, 1);
    }
    if (one_in(3))
        view->camera.ortho_height = strange(0.5, 4);
    else
        view->camera.field_of_view = one_in(5) ? strange(0, 3.1) : strange(0.1, 0.8);
    if (one_in(60)) view->camera.ortho_height = strange(0, 1);
    if (one_in(6)) view->near_distance = strange(0, 6);
    if (one_in(8)) random_matrix(x);
    if (one_in(4) && view->width > 0 && view->height > 0) {
        view->region[0] = below(view->width);
        view->region[1] = below(view->height);
        view->region[2] = 1 + below(view->width - view->region[0] + one_in(20));
        view->region[3] = 1 + below(view->height - view->region[1] + one_in(20));
    }
    put_int(&view->quality, one_in(100) ? 7 : below(4));
    if (one_in(4)) view->slab_thickness = one_in(6) ? 1e6 : strange(0.2, 5);
    view->shadow_resolution = one_in(10) ? 0 : 1 + below(100);
    view->no_shadows = one_in(8);
    view->scattering = one_in(3) ? SPS_SCATTERING_FORWARD : SPS_SCATTERING_SINGLE;
    if (view->scattering != SPS_SCATTERING_SINGLE && view->width % 2)
        view->scattering = view->height % 4 == 0   ? SPS_SCATTERING_AUTO
                           : view->height % 4 == 1 ? SPS_SCATTERING_CONVOLUTION
                                                   : SPS_SCATTERING_MULTIPLE;
    view->scattering_tolerance = view->height % 8 ? 0 : 0.5f;
    view->scattering_resolution = view->width % 13; /* drawn from nothing: scenes stay as they were */
    view->filling = (sps_filling)(view->width % 31 == 30 ? 3 : view->width % 3);
    view->tolerance = view->height % 37 == 36 ? 2 : 0.3f * (float)(view->height % 3);
    if (one_in(4)) view->coverage_samples = below(10) - (one_in(20) ? 1 : 0);
    if (from_bytes) random_tiny_view(view);
    if (view->width % 10 == 9) random_budget(view);
}

/* Spoils something that a caller might get wrong. */
static void spoil(scenery *x) {
    sps_scene *scene = &x->s.scene;
    switch (below(18)) {
    case 0: x->s.volume[0].start_canary = 1; break;
    case 1: x->s.light[0].end_canary = 1; break;
    case 2: scene->volumes = NULL; break;
    case 3: scene->mesh_count = -1; break;
    case 4: x->s.volume[0].lobe_count = below(20) - 3; break;
    case 5: x->s.volume[0].eval_fn = NULL; break;
    case 6: x->s.mesh[0].read_fn = NULL; break;
    case 7: put_int(&x->s.light[0].kind, -1); break;
    case 8: put_int(&x->s.volume[0].shading, 9); break;
    case 9: x->s.view.region[2] = 2147483647; break;
    case 10: x->s.view.width = 20000; break;
    case 11: x->s.volume[0].transfer = &x->transfers[VOLUMES - 1]; break;
    case 12: scene->ambient[1] = -1; break;
    case 13: x->sets[0].end_canary = 1; break;
    case 14: scene->particle_set_count = -2; break;
    case 15: x->sets[1].read_fn = NULL; break;
    case 16: x->projectors[0].start_canary = 2; break;
    default: memcpy(x->s.view.camera.target, x->s.view.camera.position, sizeof x->s.view.camera.target); break;
    }
}

/* Depth maps have 512 x 512 texels at least, which cost more than all else: few scenes from bytes have polygons that
   shade gas. */
static void spare_depth_maps(scenery *x) {
    sps_scene *scene = &x->s.scene;
    const int has_gas = scene->volume_count > 0 || scene->particle_set_count > 0;
    if (scene->mesh_count <= 0 || scene->light_count <= 0 || !has_gas) return;
    if (one_in(12))
        x->s.view.quality = SPS_QUALITY_DRAFT;
    else if (one_in(2))
        scene->mesh_count = 0;
    else if (one_in(2))
        scene->light_count = 0;
    else
        scene->volume_count = scene->particle_set_count = 0;
}

static int color_voxels(void *user, const int lo[3], const int size[3], float *albedo, float *emission) {
    provider *p = (provider *)user;
    for (int i = 0; i < size[0] * size[1] * size[2]; ++i)
        for (int c = 0; c < 3; ++c) {
            const double own = 0.5 + 0.5 * sin(i + lo[c] + c);
            if (albedo) albedo[3 * i + c] = (float)garbled(p, own, (uint64_t)(i + lo[2]));
            if (emission && c != i % 3) emission[3 * i + c] = (float)garbled(p, own, (uint64_t)(i + lo[1]));
        }
    return fails_now(p);
}

/* Colors of voxels and of particles, in one scene of three. */
static void random_colors(scenery *x) {
    if (!one_in(3)) return;
    for (int i = 0; i < x->s.scene.volume_count; ++i) {
        sps_volume *volume = &x->s.volume[i];
        if (volume->transfer)
            volume->classify_voxels = one_in(2);
        else if (volume->read_fn != sps_grid_read && one_in(2))
            volume->appearance_fn = color_voxels;
    }
    for (int i = 0; i < x->s.scene.particle_set_count; ++i) x->sets[i].has_albedos = one_in(2);
}

static void random_scenery(scenery *x) {
    memset(x, 0, sizeof *x);
    check_clear(&x->s, 0, 0);
    x->s.view.camera.ortho_height = 0;
    x->s.scene.volume_count = below(VOLUMES + 1);
    x->s.scene.mesh_count = below(MESHES + 1);
    x->s.scene.light_count = below(LIGHTS + 1);
    for (int i = 0; i < x->s.scene.volume_count; ++i) random_volume(x, i);
    if (x->s.scene.volume_count > 1 && one_in(3)) x->s.volume[1] = x->s.volume[0]; /* shares a channel */
    for (int i = 0; i < x->s.scene.mesh_count; ++i) random_mesh(x, i);
    for (int i = 0; i < x->s.scene.light_count; ++i) random_light(x, i);
    x->s.scene.particles = x->sets;
    x->s.scene.particle_set_count = one_in(2) ? 0 : below(SETS + 1);
    for (int i = 0; i < x->s.scene.particle_set_count; ++i) random_set(x, i);
    random_color(x->s.scene.ambient, 1);
    random_color(x->s.scene.background, 1);
    random_provider(&x->sky);
    if (one_in(5)) x->s.scene.background_fn = background_sky, x->s.scene.background_user = &x->sky;
    x->s.scene.replace_invalid = one_in(3);
    random_view(x);
    if (from_bytes) spare_depth_maps(x);
    random_colors(x);
    if (one_in(12)) spoil(x);
    if (one_in(5)) x->s.scene.sky_fn = background_sky, x->s.scene.sky_user = &x->sky;
    if (one_in(3)) x->s.view.sky_samples = below(100);
}

static void free_scenery(scenery *x) {
    for (int i = 0; i < MESHES; ++i) check_free_triangles(&x->triangles[i]);
    for (int i = 0; i < x->memory_count; ++i) free(x->memory[i]);
}

/* ------------------------------------------------------------------------------------------------------------ calls */

static float rgba[4 * PIXELS_MAX], distance[PIXELS_MAX], lower[3 * PIXELS_MAX], upper[3 * PIXELS_MAX];

/* Pixels of these that are used. */
static int pixel_room(void) { return from_bytes ? 90 + TINY + 1 : PIXELS_MAX; }

static int image_sane(const scenery *x, const sps_context *context) {
    const sps_view *view = &x->s.view;
    const int width = view->region[2] ? view->region[2] : view->width;
    const int height = view->region[2] ? view->region[3] : view->height;
    int size[2] = {width, height}; /* a budget may shrink it */
    sps_stats_report stats;
    sps_get_stats(context, &stats);
    if (view->budget_scale_min > 0 && stats.budget.width > 0)
        size[0] = stats.budget.width, size[1] = stats.budget.height;
    if (size[0] > width || size[1] > height) return printf("    a budget enlarged it\n"), 0;
    for (int i = 0; i < pixel_room(); ++i) {
        const int x_at = i % width, y_at = i / width, inside = x_at < size[0] && y_at < size[1];
        for (int k = 4 * i; k < 4 * i + 4; ++k)
            if (inside ? !(rgba[k] >= 0 && (double)rgba[k] <= (k % 4 == 3 ? 1 : (double)FLT_MAX)) : !(rgba[k] == -7))
                return printf("    number %d of pixel %d,%d: %g\n", k % 4, x_at, y_at, (double)rgba[k]), 0;
        if (inside ? !((double)distance[i] >= -1e30) : !(distance[i] == -7))
            return printf("    distance of pixel %d,%d: %g\n", x_at, y_at, (double)distance[i]), 0;
    }
    return 1;
}

static int image_untouched(void) {
    for (int i = 0; i < 4 * pixel_room(); ++i)
        if (!(rgba[i] == -7)) return 0;
    for (int i = 0; i < pixel_room(); ++i)
        if (!(distance[i] == -7)) return 0;
    return 1;
}

static void clear_image(void) {
    for (int i = 0; i < 4 * pixel_room(); ++i) rgba[i] = -7;
    for (int i = 0; i < pixel_room(); ++i) distance[i] = -7;
}

/* Marches with bounds, which only some scenes have. */
static sps_result bound_scenery(sps_context *context, const scenery *x) {
    sps_reference_settings wanted;
    sps_image image;
    sps_result result;
    const int count = 3 * pixel_room();
    int good = 1;
    memset(&wanted, 0, sizeof wanted);
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    image.depth = distance;
    clear_image();
    for (int i = 0; i < count; ++i) lower[i] = upper[i] = -7;
    wanted.step = 0.75;
    wanted.lower = lower, wanted.upper = upper;
    result = sps_reference(context, &x->s.scene, &x->s.view, &wanted, &image);
    for (int i = 0; i < count; ++i) {
        const float found = rgba[4 * (i / 3) + i % 3];
        good &= found == -7 ? lower[i] == -7 && upper[i] == -7 : lower[i] <= found && found <= upper[i];
    }
    CHECK(good);
    return result;
}

static sps_result render_scenery(sps_context *context, const scenery *x, int reference) {
    sps_reference_settings wanted;
    sps_image image;
    memset(&wanted, 0, sizeof wanted);
    memset(&image, 0, sizeof image);
    image.rgba = rgba;
    image.depth = distance;
    clear_image();
    wanted.step = from_bytes ? 1 + x->s.view.height % 4 : 2;
    wanted.samples = x->s.view.width % 3; /* paths */
    if ((x->s.view.scattering == SPS_SCATTERING_AUTO || x->s.view.scattering >= SPS_SCATTERING_CONVOLUTION) &&
        wanted.samples == 0)
        wanted.samples = 1;
    if (reference) return sps_reference(context, &x->s.scene, &x->s.view, &wanted, &image);
    return sps_render(context, &x->s.scene, &x->s.view, &image);
}

static void report(long number, const char *what, sps_result result, const sps_context *context) {
    printf("    scene %ld, %s: %d: %s\n", number, what, (int)result, sps_error(context));
}

/* Checks that hold after any call. */
static void check_outcome(const scenery *x, long number, const char *what, sps_result result,
                          const sps_context *context) {
    const int good = result == SPS_OK ? image_sane(x, context) && !sps_error(context)[0]
                                      : image_untouched() && sps_error(context)[0];
    if (!CHECK_CASE("Engineering", "random scenes with strange numbers, 300 of them",
                    "every pixel finite, not negative and within bounds; or an error, and the image untouched", !good,
                    0, "exact") ||
        !CHECK(check_error_info(context, result)))
        report(number, what, result, context);
}

static int is_steady(const provider *p) { return !p->fails && p->lies != FICKLE; }

static int has_budget(const scenery *x) { return x->s.view.budget_seconds > 0 || x->s.view.budget_error > 0; }

/* Whether every call has the same result, so that two of them may be compared. What a budget chooses depends on
   workers, regions and what was rendered before. */
static int steady(const scenery *x) {
    int good = is_steady(&x->sky) && !has_budget(x);
    for (int i = 0; i < VOLUMES; ++i) good &= is_steady(&x->providers[i]);
    for (int i = 0; i < SETS; ++i) good &= is_steady(&x->crowds[i]);
    for (int i = 0; i < MESHES; ++i) good &= is_steady(&x->textures[i]);
    for (int i = 0; i < LIGHTS; ++i) good &= is_steady(&x->images[i]);
    return good;
}

/* Steps of one voxel that a ray takes through all volumes, at most: small voxels far from each other make it many. */
static double steps_to_march(const scenery *x) {
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, edge = HUGE_VAL;
    for (int i = 0; i < x->s.scene.volume_count; ++i) {
        const sps_volume *volume = &x->s.volume[i];
        for (int k = 0; k < 3; ++k) edge = fmin(edge, vec_length(volume->placement.axis[k]) / volume->size[k]);
        for (int corner = 0; corner < 8; ++corner)
            for (int k = 0; k < 3; ++k) {
                double at = volume->placement.origin[k];
                for (int a = 0; a < 3; ++a) at += (corner >> a & 1) * volume->placement.axis[a][k];
                low[k] = fmin(low[k], at);
                high[k] = fmax(high[k], at);
            }
    }
    return (high[0] - low[0] + (high[1] - low[1]) + (high[2] - low[2])) / edge;
}

static int small_enough_to_march(const scenery *x) {
    enum { STEPS = 1000 };
    const sps_view *view = &x->s.view;
    double extent = 0;
    for (int i = 0; i < x->s.scene.volume_count; ++i)
        for (int k = 0; k < 9; ++k) extent = fmax(extent, fabs(x->s.volume[i].placement.axis[k / 3][k % 3]));
    for (int i = 0; i < x->s.scene.particle_set_count; ++i)
        if (x->sets[i].count > 300 || x->crowds[i].kind != 0)
            return 0; /* radii set the step, stray particles the length of rays */
    if (x->s.scene.volume_count > 0 && steps_to_march(x) > STEPS) return 0;
    return view->width * view->height < (from_bytes ? 24 : 200) && extent < 3;
}

/* Whether nothing keeps lists, or is fitted to them, whose length cannot be planned: no light's map, and no polygons of
   which pixels show several. */
static int sums_only(const scenery *x) {
    if (x->s.view.coverage_samples > 1) return 0;
    for (int i = 0; i < x->s.scene.mesh_count; ++i)
        if (!spsi_black(x->s.mesh[i].transmittance)) return 0;
    for (int i = 0; i < x->s.scene.light_count; ++i) {
        const sps_tmap_technique technique = x->maps[i].technique;
        if (x->s.light[i].shadow_map && technique != SPS_TMAP_OPACITY && technique != SPS_TMAP_DEEP_OPACITY &&
            technique != SPS_TMAP_FOURIER && technique != SPS_TMAP_MOMENT && technique != SPS_TMAP_BEER &&
            technique != SPS_TMAP_TABLE && technique != SPS_TMAP_DEFAULT)
            return 0;
    }
    return 1;
}

/* Checks that hold for any map at any position. */
static int map_sane(const sps_tmap *map) {
    double points[3 * 40];
    float depths[40], passes[40], least[40], most[40];
    for (int i = 0; i < 3 * 40; ++i) points[i] = one_in(10) ? strange(-1e6, 1e6) : strange(-3, 3);
    sps_tmap_query(map, 40, points, depths, passes);
    sps_tmap_bounds(map, 40, points, least, most);
    for (int i = 0; i < 40; ++i)
        if (!(depths[i] >= 0 && depths[i] <= 1e15f && passes[i] >= 0 && passes[i] <= 1 && least[i] >= 0 &&
              least[i] <= depths[i] * 1.0001f + 1e-4f && depths[i] <= most[i] * 1.0001f + 1e-4f)) {
            printf("    at %g,%g,%g: depth %g, passes %g, %g .. %g\n", points[3 * i], points[3 * i + 1],
                   points[3 * i + 2], (double)depths[i], (double)passes[i], (double)least[i], (double)most[i]);
            return 0;
        }
    return 1;
}

/* A map's settings, and as its light the scene's camera. */
static void random_map_of(scenery *x, sps_tmap_light *light, sps_tmap_settings *wanted) {
    random_map(wanted);
    if (from_bytes) random_planes(x, wanted);
    wanted->near_depth = one_in(3) ? 0 : strange(0, 4);
    wanted->far_depth = wanted->near_depth + strange(0.01, 9);
    wanted->surface_bias = one_in(2) ? 0 : strange(0, 0.1);
    *light = check_light_of(&x->s.view);
    light->omnidirectional = one_in(5);
    if (light->omnidirectional) light->height = light->width;
}

/* After a failure there may be no map; otherwise the caller destroys it. */
static sps_result make_map(sps_context *context, const scenery *x, const sps_tmap_light *light,
                           const sps_tmap_settings *wanted, sps_tmap **map) {
    sps_result result = sps_tmap_create(context, light, wanted, map);
    if (result == SPS_OK) result = sps_tmap_add(*map, &x->s.scene);
    if (result == SPS_OK) result = sps_tmap_finish(*map);
    return result;
}

static void check_map_outcome(sps_tmap *map, long number, sps_result result, const sps_context *context) {
    const int good = result == SPS_OK ? map_sane(map) && !sps_error(context)[0] : sps_error(context)[0] != 0;
    if (!CHECK(good) || !CHECK(check_error_info(context, result))) report(number, "map", result, context);
}

/* Renders what has just been planned, which must agree. `progress`: of a call; NULL: nobody watches. */
static sps_result render_as_planned(sps_context *context, const check_hooks *hooks, const scenery *x, long number,
                                    float *progress) {
    sps_plan_report plan;
    char sentence[256];
    const sps_result planned = sps_plan(context, &x->s.scene, &x->s.view, &plan);
    snprintf(sentence, sizeof sentence, "%s", sps_error(context));
    if (progress) *progress = 0;
    const sps_result result = render_scenery(context, x, 0);
    check_outcome(x, number, "render", result, context);
    /* the plan knows only the volumes' boxes, which may need more slabs than the voxels in them */
    if (planned == SPS_ERROR_ARGUMENT && !strstr(sentence, "view.slab_thickness") && !CHECK(result != SPS_OK))
        printf("    scene %ld renders, but its plan fails: %s\n", number, sentence);
    /* and what fits a budget before voxels are read may be another setting than what does then */
    if (has_budget(x)) return result;
    if (planned == SPS_OK && result == SPS_OK && sums_only(x) && !CHECK(hooks->peak <= plan.bytes)) {
        report(number, "memory", result, context);
        printf("    peak %.0f, planned %.0f\n", (double)hooks->peak, (double)plan.bytes);
    }
    return result;
}

#endif /* FUZZ_H */
