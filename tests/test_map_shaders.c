/* Shaders of examples/shaders/ that read exported maps as textures, beside sps_tmap_query on the same decoded texels:
   as C, and as GLSL 3.30, 4.30, ES 3.00 and ES 3.10 by OpenGL without a screen, where EGL has one. */

#define TMAP_TEXTURE
#include "check.h"

#include "map_scene.h"
#include "offscreen.h"
#include "shaders/transmittance_map.h"

enum { COLUMNS = 32, POINTS = COLUMNS * COLUMNS, BYTES = 1 << 20, FORMATS = 4 };

/* What the shaders promise. */
#define PROMISED 2e-4

static unsigned char exported[BYTES];

/* -------------------------------------------------------------------------------------------------------------- maps
 */

/* Every kind of texel that an export has: with fronts where near_depth is not 0, with a border, in one layer or 17. */
typedef struct kind {
    int technique, components, cubic, texel_range, planes, way, border;
    double near_depth;
} kind;

static const kind kinds[] = {
    {SPS_TMAP_OPACITY, 8, 0, 0, 0, ORTHO, 0, 0},       {SPS_TMAP_OPACITY, 8, 0, 0, 1, SPOT, 0, 1.5},
    {SPS_TMAP_OPACITY, 7, 1, 0, 1, ORTHO, 0, 1.5},     {SPS_TMAP_OPACITY, 4, 0, 0, 0, ROUND, 0, 0.5},
    {SPS_TMAP_OPACITY, 64, 1, 0, 0, ORTHO, 0, 1.5},    {SPS_TMAP_DEEP_OPACITY, 8, 1, 0, 0, SPOT, 0, 1.5},
    {SPS_TMAP_DEEP_OPACITY, 10, 0, 0, 0, ROUND, 0, 1}, {SPS_TMAP_DEEP_OPACITY, 6, 1, 0, 0, ORTHO_MATRIX, 2, 0},
    {SPS_TMAP_FOURIER, 7, 0, 0, 0, SPOT_TURNED, 0, 1}, {SPS_TMAP_FOURIER, 9, 0, 1, 0, ORTHO, 1, 1.5},
    {SPS_TMAP_MOMENT, 5, 0, 0, 0, ORTHO_TURNED, 0, 0}, {SPS_TMAP_MOMENT, 7, 0, 0, 0, ROUND, 0, 0.5},
    {SPS_TMAP_BEER, 3, 0, 0, 0, SPOT, 3, 1.5},         {SPS_TMAP_BEER, 3, 0, 0, 0, ROUND, 0, 1}};

enum { KINDS = sizeof kinds / sizeof *kinds };

/* A map whose texels are what its texture holds, and what a shader gets. */
typedef struct subject {
    fixture f;
    sps_tmap *map;
    sps_tmap_texture gas, surface;
    sps_export_format format, surface_format;
    unsigned char *gas_bytes, *surface_bytes;
    float *gas_values, *surface_values; /* as hardware returns them */
    float block[240];                   /* the uniform block: two structs and planes */
    tmap c;                             /* for the shader as C */
    tmap_format c_format;
} subject;

static double half_value(unsigned bits) {
    const int exponent = (int)(bits >> 10 & 31);
    const double fraction = (bits & 1023) / 1024.0,
                 size = exponent ? ldexp(1 + fraction, exponent - 15) : ldexp(fraction, -14);
    return bits & 0x8000 ? -size : size;
}

static float value_at(const unsigned char *bytes, sps_export_format format, size_t place) {
    float single;
    uint16_t number;
    if (format == SPS_EXPORT_UNORM8) return (float)(bytes[place] / 255.0);
    memcpy(&number, bytes + 2 * place, sizeof number);
    if (format != SPS_EXPORT_FLOAT) return (float)(format == SPS_EXPORT_HALF ? half_value(number) : number / 65535.0);
    memcpy(&single, bytes + 4 * place, sizeof single);
    return single;
}

/* Exports; returns the bytes, and what a texture makes of each number. */
static unsigned char *take(sps_tmap *map, sps_export_content content, sps_export_format format, sps_tmap_texture *about,
                           float **values) {
    static const size_t each[FORMATS] = {4, 2, 2, 1};
    sps_tmap_export_settings settings;
    memset(&settings, 0, sizeof settings);
    settings.content = content, settings.format = format;
    CHECK_OK(map->context, sps_tmap_export(map, &settings, exported, sizeof exported, about));
    unsigned char *bytes = (unsigned char *)malloc(about->bytes);
    memcpy(bytes, exported, about->bytes);
    *values = (float *)malloc(about->bytes / each[format] * sizeof **values);
    for (size_t i = 0; i < about->bytes / each[format]; ++i) (*values)[i] = value_at(bytes, format, i);
    return bytes;
}

/* Puts what the textures hold into the map. The private arrays are not constant. */
static void decode(subject *s) {
    const sps_export_constants *c = &s->gas.constants;
    const size_t size = (size_t)s->gas.width * (size_t)s->gas.height, n = (size_t)check_settings_of(s->map).components;
    const size_t faces = (size_t)s->map->grid.face_count, layers = ((size_t)c->components + 3) / 4;
    float *texels = (float *)s->map->data.texels.data, *fronts = (float *)s->map->data.fronts.data;
    for (size_t i = 0; i < faces * size; ++i)
        for (size_t k = 0; k < (size_t)c->components; ++k) {
            const size_t place = 4 * ((i / size * layers + k / 4) * size + i % size) + k % 4;
            const float value = (float)((double)c->offset[k] + (double)c->scale[k] * (double)s->gas_values[place]);
            *(k < n ? texels + i * n + k : fronts + i) = value;
        }
    if (s->surface_values) memcpy(s->map->data.surfaces.data, s->surface_values, faces * size * sizeof(float));
}

static const float planes_of_8[8] = {0.1f, 0.16f, 0.3f, 0.42f, 0.5f, 0.55f, 0.7f, 1};

/* The uniform block, and the same as C. */
static void fill_block(subject *s) {
    const float *planes = check_settings_of(s->map).planes;
    const size_t plane_count = (size_t)check_settings_of(s->map).components;
    sps_tmap_constants constants;
    CHECK(sps_tmap_get_constants(s->map, 0, &constants) == SPS_OK);
    CHECK(sizeof constants == 128 && sizeof s->gas.constants == 560 && sizeof s->c_format == 560);
    memset(s->block, 0, sizeof s->block);
    memcpy(s->block, &constants, sizeof constants);
    memcpy(s->block + 32, &s->gas.constants, sizeof s->gas.constants);
    if (planes) memcpy(s->block + 172, planes, plane_count * sizeof *planes);
    memcpy((void *)&s->c, &constants, sizeof constants);
    memcpy(&s->c_format, &s->gas.constants, sizeof s->c_format);
    s->c.gas = s->gas_values, s->c.surfaces = s->surface_values, s->c.planes = planes, s->c.format = &s->c_format;
}

static int subject_make(subject *s, sps_context *context, const kind *k, sps_export_format format) {
    memset(s, 0, sizeof *s);
    begin_little(&s->f, k->technique);
    see(&s->f, k->way, SIDE);
    if (k->way == ORTHO || k->way == SPOT) s->f.light.width = 13;
    s->f.light.border = k->border;
    s->f.settings.components = k->components, s->f.settings.cubic = k->cubic;
    s->f.settings.texel_range = k->texel_range, s->f.settings.near_depth = k->near_depth;
    s->f.settings.planes = k->planes ? planes_of_8 + (8 - k->components) : NULL;
    s->map = must_build(&s->f, context);
    if (!s->map) return 0;
    s->format = format, s->surface_format = format == SPS_EXPORT_FLOAT ? SPS_EXPORT_FLOAT : SPS_EXPORT_HALF;
    s->gas_bytes = take(s->map, SPS_EXPORT_GAS, format, &s->gas, &s->gas_values);
    CHECK(s->map->data.surfaces.data != NULL);
    s->surface_bytes = take(s->map, SPS_EXPORT_SURFACES, s->surface_format, &s->surface, &s->surface_values);
    decode(s);
    fill_block(s);
    return 1;
}

static void subject_free(subject *s) {
    sps_tmap_destroy(s->map);
    free(s->gas_bytes), free(s->surface_bytes), free(s->gas_values), free(s->surface_values);
    end(&s->f);
}

/* ------------------------------------------------------------------------------------------------------------ points
 */

/* World points within the map and a little beyond, before near_depth and behind far_depth, each fourth at a texel's
   centre. */
static void place_points(const subject *s, float points[4 * POINTS]) {
    const int width = s->gas.width, height = s->gas.height, faces = s->map->grid.face_count;
    const double near_depth = s->map->grid.near_depth, range = 1 / s->map->grid.per_depth;
    check_random random = {1234};
    for (int i = 0; i < POINTS; ++i) {
        const double beyond = faces == 1 ? 0.8 : -0.5;
        double x = (width + 2 * beyond) * check_next(&random) - beyond - 0.5, point[3];
        double y = (height + 2 * beyond) * check_next(&random) - beyond - 0.5;
        const double t = near_depth + range * (1.2 * check_next(&random) - 0.05);
        if (i % 4 == 0) x = spsi_dmin(floor(fabs(x)), width - 1), y = spsi_dmin(floor(fabs(y)), height - 1);
        if (i % 4 == 0 && faces > 1) x = spsi_dmax(x, 1), y = spsi_dmin(spsi_dmax(y, 1), height - 2);
        if (i % 4 == 0 && faces > 1) x = spsi_dmin(x, width - 2);
        on_ray(s->map, i % faces, 0, 0, 0, point);
        spsi_ray_point(&s->map->grid.rays[i % faces], x, y, t, point);
        for (int k = 0; k < 3; ++k) points[4 * i + k] = (float)point[k];
        points[4 * i + 3] = 1;
    }
}

/* --------------------------------------------------------------------------------------------------- what is expected
 */

/* As spsi_moment_depths, with the bias of the export. */
static double moment_depth(const sps_tmap *map, const float *values, float u, double bias) {
    const double biases[2] = {bias, bias};
    const int components = check_settings_of(map).components;
    spsi_hankel hankel;
    double bounds[2];
    if (!(values[0] > 0) || u >= 1) return (double)values[0];
    spsi_hankel_build(&hankel, values, components, biases);
    spsi_hankel_bounds(&hankel, 2 * (double)u - 1, bounds);
    return 0.5 * (bounds[0] + bounds[1]) * (double)values[0];
}

/* Optical depth of a texel's numbers, of which a front is the last. */
static double numbers_depth(const subject *s, const double *numbers, float u) {
    float values[SPSI_EXPORT_MOST], depth = 0;
    const int count = s->gas.constants.components;
    for (int k = 0; k < count; ++k) values[k] = (float)numbers[k];
    const double front = s->map->data.fronts.data ? numbers[count - 1] : 0;
    const spsi_texel texel = {values + 2 * s->map->has_range, 0};
    if (s->map->settings.technique == SPS_TMAP_MOMENT)
        return front + moment_depth(s->map, values, u, (double)s->gas.constants.moment_bias);
    spsi_tmap_depths(s->map, &texel, 1, &u, &depth);
    return front + (double)depth;
}

/* Numbers that lie between four texels, at fractions fx and fy. Moments are solved for with a nearly singular matrix:
   in floats, the result is exact for moments that are off by about 3e-7 [Wilkinson 1968]. `noise` moves them by three
   times as much, since eight tries do not find the worst. */
static void mix_numbers(const subject *s, const spsi_tmap_quad *quad, const double f[2], check_random *noise,
                        double *numbers) {
    const int count = s->gas.constants.components, n = check_settings_of(s->map).components;
    const double fx = fmin(fmax(f[0], 0), 1), fy = fmin(fmax(f[1], 0), 1);
    const float *texels = sps_tmap_texels(s->map), *fronts = sps_tmap_fronts(s->map);
    memset(numbers, 0, (size_t)count * sizeof *numbers);
    for (int i = 0; i < 4; ++i) {
        const size_t index = spsi_quad_texel(s->map, quad, i);
        const double weight = (i & 1 ? fx : 1 - fx) * (i >> 1 ? fy : 1 - fy);
        for (int k = 0; k < count; ++k)
            numbers[k] += weight * (double)(k < n ? texels[index * (size_t)n + (size_t)k] : fronts[index]);
    }
    for (int k = 1; k < n && noise; ++k) numbers[k] += check_next(noise) < 0.5 ? -9e-7 : 9e-7;
}

/* Least and greatest of what a look-up may return. */
typedef struct span {
    double low, high;
} span;

static void span_take(span *s, double value) { s->low = fmin(s->low, value), s->high = fmax(s->high, value); }

/* The answers of the three look-ups. */
typedef struct answers {
    span four, mean, filtered;
} answers;

/* A texture unit has fractions of at least 8 bits: they are off by up to 1/256, if it truncates. Of 8-bit texels it
   returns 8 bits, each number off by up to 1/255 of its scale. */
static void take_filtered(const subject *s, const spsi_tmap_quad *quad, const double ul[2], int is_hardware,
                          check_random *noise, answers *to) {
    const float u = (float)ul[0];
    const double lit = ul[1];
    const double fx = quad->weight[1] + quad->weight[3], fy = quad->weight[2] + quad->weight[3];
    const double step = is_hardware ? 1 / 256.0 : 0;
    double numbers[SPSI_EXPORT_MOST], slack = 0;
    for (int i = 0; i < (is_hardware ? 9 : 1); ++i) {
        const double f[2] = {fx + step * (i % 3 == 2 ? -1 : i % 3), fy + step * (i / 3 == 2 ? -1 : i / 3)};
        mix_numbers(s, quad, f, noise, numbers);
        const double through = exp(-numbers_depth(s, numbers, u));
        for (int k = 0; k < s->gas.constants.components && i == 0; ++k) {
            const double kept = numbers[k];
            if (!is_hardware || s->format != SPS_EXPORT_UNORM8) break;
            numbers[k] += (double)s->gas.constants.scale[k] / 255;
            const double more = exp(-numbers_depth(s, numbers, u));
            numbers[k] = kept - (double)s->gas.constants.scale[k] / 255;
            slack += fmax(fabs(more - through), fabs(exp(-numbers_depth(s, numbers, u)) - through));
            numbers[k] = kept;
        }
        span_take(&to->filtered, lit * (through - slack));
        span_take(&to->filtered, lit * (through + slack));
    }
}

static double surface_gap(const subject *s, const spsi_tmap_quad *quad, int i) {
    const double bias = (s->map->bias[0] + s->map->bias[1] * quad->t) * s->map->grid.per_depth;
    const double u = (quad->t - s->map->grid.near_depth) * s->map->grid.per_depth;
    return (double)sps_tmap_surfaces(s->map)[spsi_quad_texel(s->map, quad, i)] + bias - u;
}

/* u of a point is off by 8e-7: depths are up to 30, with one rounding, and sums of three products of up to 12, over a
   range of 18. */
static answers expect(const subject *s, const spsi_tmap_quad *quad, int is_hardware) {
    const span none = {2, -1};
    answers to = {none, none, none};
    check_random random = {5};
    const int tries = s->map->settings.technique == SPS_TMAP_MOMENT ? 35 : 3;
    for (int j = 0; j < tries; ++j) {
        check_random *noise = j < 3 ? NULL : &random;
        const float u = fminf(fmaxf(quad->u + (float)(j % 3 - 1) * 8e-7f, 0), 1);
        double depth = 0, lit = 0, mean = 0, numbers[SPSI_EXPORT_MOST];
        for (int i = 0; i < 4; ++i) {
            const double f[2] = {(double)(i & 1), (double)(i >> 1)}, weight = quad->weight[i];
            mix_numbers(s, quad, f, noise, numbers);
            const double one_depth = numbers_depth(s, numbers, u);
            depth += weight * one_depth;
            lit += surface_gap(s, quad, i) < 0 ? 0 : weight;
            mean += surface_gap(s, quad, i) < 0 ? 0 : weight * exp(-one_depth);
        }
        span_take(&to.four, lit * exp(-depth));
        span_take(&to.mean, mean);
        const double ul[2] = {(double)u, lit};
        take_filtered(s, quad, ul, is_hardware, noise, &to);
    }
    return to;
}

/* --------------------------------------------------------------------------------------------------------- judgement
 */

/* Largest errors of one map. */
typedef struct errors {
    double four, mean, filtered, fade;
    int outside, within, between;
} errors;

static double beyond(span s, double value) {
    return value >= s.low && value <= s.high ? 0 : fmax(s.low - value, value - s.high);
}

#define FADE 2.5

/* The weight at map coordinates in doubles. */
static double expect_fade(const subject *s, const double q[3]) {
    sps_tmap *map = s->map;
    const double x = fmin(q[0], s->gas.width - 1 - q[0]), y = fmin(q[1], s->gas.height - 1 - q[1]);
    if (map->grid.face_count > 1) return 1;
    return fmin(fmax((fmin(x, y) - map->border + 0.5) / FADE, 0), 1);
}

/* A point, and what the look-ups returned there: four, mean, filtered, fade. Points whose side of an edge or of a
   surface floats cannot tell do not count. */
static void judge(const subject *s, const float point[3], const float got[4], int is_hardware, int is_centre,
                  errors *worst) {
    const double at[3] = {(double)point[0], (double)point[1], (double)point[2]};
    sps_tmap *map = s->map;
    spsi_tmap_quad quad;
    double q[3], offset[3];
    float query = -1;
    spsi_along(at, map->grid.rays[0].origin, -1, offset);
    spsi_project(&map->grid.rays[map->grid.face_count > 1 ? spsi_cube_face_of(offset) : 0], at, q);
    const double fade = expect_fade(s, q), u = (q[2] - map->grid.near_depth) * map->grid.per_depth;
    const double first = map->border - 0.5, left = fmin(q[0] - first, s->gas.width - 1 - first - q[0]);
    const double edge = fmin(left, fmin(q[1] - first, s->gas.height - 1 - first - q[1]));
    if (fabs(u) < 1e-6 || (fabs(edge) < 1e-4 && map->grid.face_count == 1)) return;
    worst->fade = fmax(worst->fade, fabs((double)got[3] - (u < 0 ? 0 : fade)));
    if (!spsi_tmap_locate(map, at, &quad)) {
        worst->outside += CHECK(got[0] == 1 && got[1] == 1 && got[2] == 1);
        return;
    }
    for (int i = 0; i < 4; ++i)
        if (fabs(surface_gap(s, &quad, i)) < 2e-6) return;
    const answers right = expect(s, &quad, is_hardware && !is_centre);
    sps_tmap_query(map, 1, at, NULL, &query);
    if (map->settings.technique != SPS_TMAP_MOMENT || s->format == SPS_EXPORT_FLOAT)
        CHECK(beyond(right.four, (double)query) < 1e-6);
    worst->within += 1;
    worst->between += got[0] > 0.02f && got[0] < 0.98f;
    worst->four = fmax(worst->four, beyond(right.four, (double)got[0]));
    worst->mean = fmax(worst->mean, beyond(right.mean, (double)got[1]));
    worst->filtered = fmax(worst->filtered, beyond(right.filtered, (double)got[2]));
}

static void conclude(const char *language, int number, const subject *s, const errors *worst) {
    static const char *const formats[FORMATS] = {"float", "half", "unorm16", "unorm8"};
    int good = CHECK(worst->four <= PROMISED) & CHECK(worst->mean <= PROMISED) & CHECK(worst->filtered <= PROMISED);
    good &= CHECK(worst->fade <= 1e-4) & CHECK(worst->within > POINTS / 4 && worst->between > POINTS / 20);
    good &= CHECK(worst->outside > 0);
    if (!good || getenv("CHECK_FIGURES"))
        printf("    %s, map %d, technique %d, %s: four %.2g, mean %.2g, filtered %.2g, fade %.2g; %d, %d, %d\n",
               language, number, (int)s->map->settings.technique, formats[s->format], worst->four, worst->mean,
               worst->filtered, worst->fade, worst->outside, worst->within, worst->between);
}

/* -------------------------------------------------------------------------------------------------------------- as C
 */

static tmap_place locate(const subject *s, const float point[3]) {
    const double *light = s->f.light.camera.position;
    tmap_vec3 p = {point[0], point[1], point[2]};
    if (s->map->grid.face_count == 1) return tmap_project(s->c, p);
    p.x -= (float)light[0], p.y -= (float)light[1], p.z -= (float)light[2];
    return tmap_project_to_cube(s->c, p);
}

static void test_c(void) {
    static float points[4 * POINTS];
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < KINDS * FORMATS; ++n) {
        errors worst = {0, 0, 0, 0, 0, 0, 0};
        subject s;
        if (!subject_make(&s, context, &kinds[n / FORMATS], (sps_export_format)(n % FORMATS))) continue;
        place_points(&s, points);
        for (int i = 0; i < POINTS; ++i) {
            const tmap_place p = locate(&s, points + 4 * i);
            const float got[4] = {tmap_transmittance(s.c, p), tmap_mean_transmittance(s.c, p), tmap_filtered(s.c, p),
                                  tmap_fade(s.c, p, (float)FADE)};
            judge(&s, points + 4 * i, got, 0, i % 4 == 0, &worst);
        }
        conclude("C", n / FORMATS, &s, &worst);
        subject_free(&s);
    }
    sps_destroy(context);
}

/* A place beside the map moves to its edge, and no other does; depth stays. */
static void test_clamped_places(void) {
    sps_context *context = sps_create(NULL, NULL);
    subject s;
    if (subject_make(&s, context, &kinds[7], SPS_EXPORT_FLOAT)) {
        for (int i = 0; i < 100; ++i) {
            const tmap_place p = {0, (float)(i % 10) * 2 - 3, (float)(i / 10) * 2 - 3, 0.3f, 5};
            const tmap_place q = tmap_clamp_place(s.c, p);
            CHECK(q.x == fminf(fmaxf(p.x, 2), 10) && q.y == fminf(fmaxf(p.y, 2), 10));
            CHECK(q.face == 0 && q.u == p.u && q.distance == p.distance);
            CHECK(tmap_fade(s.c, q, 0.5f) == 1);
        }
        subject_free(&s);
    }
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------------------- in OpenGL */

static const char *const languages[] = {"330", "300 es", "430", "310 es"};

static const char *const draw_all =
    "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? "
    "3.0 : -1.0, 0.0, 1.0); }";

/* A pixel per point. What is known about the map is constant, as docs/shadow_maps.md advises: compilers take seconds
   over the rest. */
static const char *const look_up =
    "uniform highp sampler2D points; uniform vec4 light; out vec4 color; void main() {"
    "vec3 at = texelFetch(points, ivec2(gl_FragCoord.xy), 0).xyz; tmap map = tmap_bound;"
    "map.technique_id = TECHNIQUE; map.cubic = CUBIC; map.has_planes = PLANES; map.has_range = RANGE;"
    "tmap_place p = tmap_project(map, at); if (light.w > 0.0) p = tmap_project_to_cube(map, at - light.xyz);"
    "color = vec4(tmap_transmittance(map, p), tmap_mean_transmittance(map, p), tmap_filtered(map, p),"
    "tmap_fade(map, p, 2.5)); }";

static char *read_shader(void) {
    FILE *file = fopen("examples/shaders/transmittance_map.glsl", "rb");
    char *text = (char *)calloc(1, 1 << 17);
    if (file) CHECK(fread(text, 1, 1 << 17, file) > 1000 && feof(file));
    if (file) fclose(file);
    return text;
}

/* What is known about a map; a line ends with `end`. */
static void define(const kind *k, const char *language, const char *end, char text[300]) {
    const int beer = k->technique == SPS_TMAP_BEER, is_ranged = beer || k->technique == SPS_TMAP_DEEP_OPACITY;
    snprintf(text, 300,
             "#version %s%s#define TMAP_TEXTURE%s#define TMAP_PLANES%s#define TMAP_LAYERS %d%s#define TECHNIQUE %d%s"
             "#define CUBIC %d%s#define PLANES %d%s#define RANGE %d%s",
             language, end, end, end, (k->components + 4) / 4, end, k->technique, end, k->cubic, end, k->planes, end,
             is_ranged || k->texel_range, end);
}

/* The file as it is, between the engine's lines. GLSL 4.30 and ES 3.10 have bindings in the text. */
static unsigned make_program(offscreen *gl, const char *language, const kind *k, const char *file) {
    char version[300];
    define(k, language, "\n", version);
    const char *vertex[3] = {version, draw_all, ""}, *fragment[3] = {version, file, look_up};
    const unsigned program = offscreen_program(gl, vertex, fragment);
    if (!CHECK(program != 0)) return 0;
    gl->UseProgram(program);
    gl->Uniform1i(gl->GetUniformLocation(program, "points"), 3);
    if (language[0] == '4' || language[1] == '1') return program;
    gl->Uniform1i(gl->GetUniformLocation(program, "tmap_gas"), 0);
    gl->Uniform1i(gl->GetUniformLocation(program, "tmap_surfaces"), 1);
    gl->UniformBlockBinding(program, gl->GetUniformBlockIndex(program, "tmap_block"), 2);
    return program;
}

static void upload(offscreen *gl, const subject *s) {
    const int faces = s->map->grid.face_count;
    const int half = s->surface_format == SPS_EXPORT_HALF;
    const offscreen_format gas[FORMATS] = {
        {0x8814, 0x1908, 0x1406}, {0x881A, 0x1908, 0x140B}, {0x805B, 0x1908, 0x1403}, {0x8058, 0x1908, 0x1401}};
    const offscreen_format surface[2] = {{0x822E, 0x1903, 0x1406}, {0x822D, 0x1903, 0x140B}};
    const int size[3] = {s->gas.width, s->gas.height, s->gas.layers}, flat[3] = {size[0], size[1], faces};
    offscreen_texture(gl, 0, &gas[s->format], size, s->gas_bytes);
    offscreen_texture(gl, 1, &surface[half], flat, s->surface_bytes);
    gl->BufferData(OFFSCREEN_UNIFORMS, (ptrdiff_t)sizeof s->block, s->block, 0x88E4);
}

/* A map for each language, in long tests all of them: drivers on the CPU compile for seconds as they draw. Half of the
   languages need bindings by name, the other half has them. */
static void run_language(offscreen *gl, int language, const char *file) {
    static float points[4 * POINTS], got[4 * POINTS];
    const offscreen_format floats = {0x8814, 0x1908, 0x1406};
    const int size[3] = {COLUMNS, COLUMNS, 0};
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < KINDS * FORMATS; ++n) {
        errors worst = {0, 0, 0, 0, 0, 0, 0};
        const sps_export_format format = (sps_export_format)(n % FORMATS);
        subject s;
        const kind *k = &kinds[n / FORMATS];
        if (n % FORMATS != (n / FORMATS + n / FORMATS / 4) % FORMATS) continue;
        if (check_long() ? n / FORMATS % 4 != language : (n / FORMATS != 5 + 4 * language || language > 1) && n >= 4)
            continue;
        const unsigned program = make_program(gl, languages[language], k, file);
        if (!program || (!check_long() && n < 4)) continue; /* compiled alone */
        if (!subject_make(&s, context, k, format)) continue;
        const double *light = s.f.light.camera.position;
        place_points(&s, points);
        upload(gl, &s);
        offscreen_texture(gl, 3, &floats, size, points);
        gl->Uniform4f(gl->GetUniformLocation(program, "light"), (float)light[0], (float)light[1], (float)light[2],
                      s.f.light.omnidirectional ? 1 : 0);
        if (format == SPS_EXPORT_UNORM16 && gl->GetError() != 0) {
            printf("skipped: unorm16 in %s, which this driver lacks\n", languages[language]);
        } else {
            offscreen_draw(gl, got);
            CHECK(gl->GetError() == 0);
            for (int i = 0; i < POINTS; ++i) judge(&s, points + 4 * i, got + 4 * i, 1, i % 4 == 0, &worst);
            conclude(languages[language], n / FORMATS, &s, &worst);
        }
        subject_free(&s);
    }
    sps_destroy(context);
}

static void test_gl(void) {
    char *file = read_shader();
    if (!*file) printf("skipped: shaders in OpenGL: run this in the top folder\n");
    for (int i = 0; i < 4 && *file; ++i) {
        const char *lack = "";
        offscreen gl;
        if (offscreen_begin(&gl, i % 2, COLUMNS, COLUMNS, &lack)) run_language(&gl, i, file);
        if (*lack) printf("skipped: GLSL %s: %s\n", languages[i], lack);
        offscreen_end(&gl);
    }
    free(file);
}

/* ------------------------------------------------------------------------------------------------------ in a browser
 */

/* FOLDER/map_N.bin: a line of JSON, then block, points, gas and surfaces, which web.mjs draws with into got_N.bin. */
static void write_map(const char *folder, int n, const subject *s, const kind *k, const float points[4 * POINTS]) {
    char path[4096], defines[300];
    const double *light = s->f.light.camera.position;
    define(k, "300 es", "\\n", defines);
    snprintf(path, sizeof path, "%s/map_%d.bin", folder, n);
    FILE *file = fopen(path, "wb");
    if (!CHECK(file != NULL)) return;
    fprintf(file,
            "{\"defines\":\"%s\",\"vertex\":\"%s\",\"fragment\":\"%s\",\"format\":%d,\"half\":%d,\"size\":[%d,%d,%d],"
            "\"faces\":%d,\"light\":[%.9g,%.9g,%.9g,%d],\"bytes\":[%zu,%zu,%zu,%zu]}\n",
            defines, draw_all, look_up, (int)s->format, s->surface_format == SPS_EXPORT_HALF, s->gas.width,
            s->gas.height, s->gas.layers, s->map->grid.face_count, light[0], light[1], light[2],
            s->f.light.omnidirectional, sizeof s->block, 4 * POINTS * sizeof *points, s->gas.bytes, s->surface.bytes);
    fwrite(s->block, sizeof s->block, 1, file);
    fwrite(points, sizeof *points, 4 * POINTS, file);
    fwrite(s->gas_bytes, 1, s->gas.bytes, file);
    fwrite(s->surface_bytes, 1, s->surface.bytes, file);
    CHECK(fclose(file) == 0);
}

static void judge_map(const char *folder, int n, const subject *s, const float points[4 * POINTS]) {
    static float got[4 * POINTS];
    errors worst = {0, 0, 0, 0, 0, 0, 0};
    char path[4096];
    snprintf(path, sizeof path, "%s/got_%d.bin", folder, n);
    FILE *file = fopen(path, "rb");
    if (!CHECK(file && fread(got, sizeof *got, 4 * POINTS, file) == 4 * POINTS)) printf("    %s is missing\n", path);
    if (file) fclose(file);
    for (int i = 0; i < POINTS && file; ++i) judge(s, points + 4 * i, got + 4 * i, 1, i % 4 == 0, &worst);
    if (file) conclude("WebGL 2", n / FORMATS, s, &worst);
}

/* WebGL 2 has no unorm16. */
static void run_browser(const char *folder, int judges) {
    static float points[4 * POINTS];
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < KINDS * FORMATS; ++n) {
        subject s;
        const sps_export_format format = (sps_export_format)(n % FORMATS);
        if (format == SPS_EXPORT_UNORM16 || !subject_make(&s, context, &kinds[n / FORMATS], format)) continue;
        place_points(&s, points);
        if (judges)
            judge_map(folder, n, &s, points);
        else
            write_map(folder, n, &s, &kinds[n / FORMATS], points);
        subject_free(&s);
    }
    sps_destroy(context);
}

/* With `write FOLDER` and `judge FOLDER`, maps for web.mjs, and what it has drawn. */
int main(int argc, char **argv) {
    if (argc == 3) {
        run_browser(argv[2], strcmp(argv[1], "judge") == 0);
        return check_report();
    }
    RUN(test_c);
    RUN(test_clamped_places);
    RUN(test_gl);
    return check_report();
}
