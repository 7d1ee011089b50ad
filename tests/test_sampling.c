/* Transmittance maps sampled by the code of docs/shadow_maps.md against sps_tmap_query, and that page against this
   file: its C is the very text below, and its GLSL and HLSL are that text with the spelling changed. */

#include "check.h"

/* ------------------------------------------------------------------------------- the code of docs/shadow_maps.md */
/* begin */
typedef struct vec2 {
    float x, y;
} vec2;

typedef struct vec3 {
    float x, y, z;
} vec3;

typedef struct vec4 {
    float x, y, z, w;
} vec4;

static const float *texels, *surfaces, *planes; /* sps_tmap_texels, sps_tmap_surfaces, settings.planes */
static const uint32_t *starts;                  /* sps_tmap_starts */
static int map_technique, map_components;       /* settings */
static int map_has_range;                       /* a deep opacity map, or settings.texel_range */
static int map_has_planes, map_cubic;           /* settings.planes is not NULL; settings.cubic */
static int map_running_maximum;                 /* settings */
static int map_has_surfaces;                    /* surfaces is not NULL */
static int map_width, map_height;               /* texels of a face */
static float map_near, map_far;                 /* settings.near_depth, far_depth */
static float map_bias, map_bias_per_distance;   /* of surfaces: sps_tmap_get_projection's bias */
static vec4 map_row_x, map_row_y;               /* sps_tmap_get_projection's matrix, row by row; six faces need */
static vec4 map_row_distance, map_row_w;        /* none of these */

static float mix(float a, float b, float t) { return a + t * (b - a); }

static float clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }

static int clampi(int x, int low, int high) { return x < low ? low : x > high ? high : x; }

/* Even planes, at u = 1 / n .. 1. */
static float opacity_depth(int first, int n, float u) {
    float at = u * (float)n;
    int plane = clampi((int)at, 0, n - 1);
    float before = plane > 0 ? texels[first + plane - 1] : 0.0f;
    return mix(before, texels[first + plane], at - (float)plane);
}

/* u and optical depth of plane i; nothing lies before u = 0, which is plane -1. */
static vec2 opacity_knot(int first, int n, int i) {
    vec2 knot;
    int plane = clampi(i, 0, n - 1);
    knot.x = i < 0 ? 0.0f : map_has_planes != 0 ? planes[plane] : (float)(plane + 1) / (float)n;
    knot.y = i < 0 ? 0.0f : texels[first + plane];
    return knot;
}

/* The first plane that does not lie before u. */
static int opacity_plane(int first, int n, float u) {
    int i = 0;
    while (i < n - 1 && opacity_knot(first, n, i).x < u) ++i;
    return i;
}

/* Planes as given. */
static float opacity_planes_depth(int first, int n, float u) {
    int i = opacity_plane(first, n, u);
    vec2 a = opacity_knot(first, n, i - 1);
    vec2 b = opacity_knot(first, n, i);
    return mix(a.y, b.y, clamp((u - a.x) / (b.x - a.x), 0.0f, 1.0f));
}

static float secant(vec2 a, vec2 b) { return (b.y - a.y) / (b.x - a.x); }

/* The slope at b of a curve through a, b, c that never falls; at a. */
static float inner_slope(vec2 a, vec2 b, vec2 c) {
    float before = secant(a, b), after = secant(b, c);
    float parabola = (before * (c.x - b.x) + after * (b.x - a.x)) / (c.x - a.x);
    return 2.0f * fminf(fminf(before, after), 0.5f * parabola);
}

static float end_slope(vec2 a, vec2 b, vec2 c) {
    float part = (b.x - a.x) / (c.x - a.x);
    return clamp(secant(a, b) * (1.0f + part) - secant(b, c) * part, 0.0f, 2.0f * secant(a, b));
}

/* Planes even or given, monotone cubics between them. */
static float opacity_cubic_depth(int first, int n, float u) {
    int i = opacity_plane(first, n, u);
    vec2 a = opacity_knot(first, n, i - 2);
    vec2 b = opacity_knot(first, n, i - 1);
    vec2 c = opacity_knot(first, n, i);
    vec2 d = opacity_knot(first, n, i + 1);
    float even = secant(b, c), t = clamp((u - b.x) / (c.x - b.x), 0.0f, 1.0f);
    float slope0 = i > 0 ? inner_slope(a, b, c) : i < n - 1 ? end_slope(b, c, d) : even;
    float slope1 = i < n - 1 ? inner_slope(b, c, d) : i > 0 ? end_slope(c, b, a) : even;
    float bend = (1.0f - t) * (slope0 - even) - t * (slope1 - even);
    return clamp(mix(b.y, c.y, t) + t * (1.0f - t) * (c.x - b.x) * bend, b.y, c.y);
}

static float fourier_series(int first, int n, float u) {
    float sum = 0.5f * texels[first] * u;
    for (int k = 1; 2 * k < n; ++k) {
        float w = 6.28318531f * (float)k;
        float a = texels[first + 2 * k - 1], b = texels[first + 2 * k];
        sum += (a * sinf(w * u) + b * (1.0f - cosf(w * u))) / w;
    }
    return sum;
}

static float fourier_depth(int first, int n, float u) {
    float most = fourier_series(first, n, u);
    int samples = map_running_maximum != 0 ? 2 * (n - 1) : 0;
    for (int i = 1; (float)i < u * (float)samples; ++i)
        most = fmaxf(most, fourier_series(first, n, (float)i / (float)samples));
    return clamp(most, 0.0f, 0.5f * texels[first]);
}

static float cosine_depth(int first, int n, float u) {
    float sum = texels[first];
    for (int k = 1; k < n; ++k) sum += texels[first + k] * cosf(3.14159265f * (float)k * u);
    return -logf(clamp(sum, 1.12535e-7f, 1.0f));
}

static float beer_depth(int first, float u) {
    return fminf(fmaxf(u - texels[first], 0.0f) * texels[first + 1], texels[first + 2]);
}

static float depth_depth(int first, float u) { return u < texels[first] ? 0.0f : 1e15f; }

/* Transmittance between nodes, u and T each: straight lines, 1 before the first node, the last one's T behind it. */
static float nodes_depth(int first, int count, float u) {
    int low = 0, high = count; /* the first node behind u */
    while (low < high) {
        int middle = (low + high) / 2;
        if (texels[first + 2 * middle] <= u)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == 0) return 0.0f;
    int after = first + 2 * clampi(low, 0, count - 1), before = first + 2 * (low - 1);
    float t = low < count ? (u - texels[before]) / (texels[after] - texels[before]) : 0.0f;
    float through = mix(texels[before + 1], texels[after + 1], t);
    return through > 0.0f ? -logf(fminf(through, 1.0f)) : 1e15f;
}

static float adaptive_depth(int first, int n, float u) { return nodes_depth(first, n / 2, u); }

static float compressed_depth(int texel, float u) {
    int first = (int)starts[texel], last = (int)starts[texel + 1];
    return nodes_depth(2 * first, last - first, u);
}

/* Stretches of u0, u1, optical depth, and how much there is of a chord that is densest in the middle: 1, all of it;
   less, its last part; 0: a stretch that is even. At u = 1 what lies behind counts, too. */
static float deep_depth(int texel, float u) {
    int first = 4 * (int)starts[texel], last = 4 * (int)starts[texel + 1];
    float sum = 0.0f;
    for (int i = first; i < last && texels[i] <= u; i += 4) {
        float u0 = texels[i], u1 = texels[i + 1], soft = texels[i + 3];
        float s = u < fminf(u1, 1.0f) ? (u - u0) / (u1 - u0) : 1.0f;
        float bend = s * (6.0f * soft - 3.0f - 2.0f * soft * s) + 6.0f - 6.0f * soft;
        sum += texels[i + 2] * (soft > 0.0f ? s * bend / (3.0f - 2.0f * soft) : s);
    }
    return sum;
}

/* Up to five numbers: values of polynomials, coefficients from the lowest on, roots. */
typedef struct numbers {
    int count;
    float x[5];
} numbers;

/* The lower left half of a matrix of `size` rows: row i begins at 5 i. */
typedef struct lower_left {
    int size;
    float x[25];
} lower_left;

/* Moment k of the wide distribution of which a little is mixed in, so that rounding does no harm. */
static float wide_moment(int n, int k) {
    if (k % 2 == 1) return 0.0f;
    if (n == 5) return 0.375f;
    if (n == 7) return k == 2 ? 0.48f : k == 4 ? 0.451f : 0.45f;
    return k == 2 ? 0.75f : k == 4 ? 0.676666667f : k == 6 ? 0.63f : 0.600303030f;
}

/* Cholesky's factor of the matrix whose element i, j is moment i + j. */
static lower_left moment_factor(int first, int n) {
    lower_left f;
    float bias = n == 5 ? 5e-7f : n == 7 ? 5e-6f : 5e-5f;
    f.size = (n + 1) / 2;
    for (int i = 0; i < f.size; ++i)
        for (int j = 0; j <= i; ++j) {
            int k = i + j;
            float sum = k == 0 ? 1.0f : mix(texels[first + k], wide_moment(n, k), bias);
            for (int l = 0; l < j; ++l) sum -= f.x[5 * i + l] * f.x[5 * j + l];
            f.x[5 * i + j] = i == j ? sqrtf(fmaxf(sum, 1e-7f)) : sum / f.x[5 * j + j];
        }
    return f;
}

/* The orthonormal polynomials at z. */
static numbers moment_polynomials(lower_left f, float z) {
    numbers p;
    float power = 1.0f;
    p.count = f.size;
    for (int i = 0; i < f.size; ++i) {
        float sum = power;
        for (int k = 0; k < i; ++k) sum -= f.x[5 * i + k] * p.x[k];
        p.x[i] = sum / f.x[5 * i + i];
        power *= z;
    }
    return p;
}

/* The most that can lie at z. */
static float moment_weight(lower_left f, float z) {
    numbers p = moment_polynomials(f, z);
    float sum = 0.0f;
    for (int i = 0; i < p.count; ++i) sum += p.x[i] * p.x[i];
    return 1.0f / sum;
}

/* The polynomial whose roots are where the rest lies if as much as can lies at z. */
static numbers moment_kernel(lower_left f, float z) {
    numbers c = moment_polynomials(f, z);
    for (int i = f.size - 1; i >= 0; --i) {
        for (int k = i + 1; k < f.size; ++k) c.x[i] -= f.x[5 * k + i] * c.x[k];
        c.x[i] /= f.x[5 * i + i];
    }
    return c;
}

/* c, differentiated `order` times. */
static numbers derivative(numbers c, int order) {
    for (int turn = 0; turn < order; ++turn) {
        c.count -= 1;
        for (int i = 0; i < c.count; ++i) c.x[i] = (float)(i + 1) * c.x[i + 1];
    }
    return c;
}

static float polynomial(numbers c, float x) {
    float value = 0.0f;
    for (int i = c.count - 1; i >= 0; --i) value = value * x + c.x[i];
    return value;
}

/* The roots of a quadratic polynomial, the lesser first, cut to -100..100: beyond lies nothing that counts. */
static numbers quadratic_roots(numbers c) {
    numbers roots;
    float root = sqrtf(fmaxf(c.x[1] * c.x[1] - 4.0f * c.x[0] * c.x[2], 0.0f));
    float q = -0.5f * (c.x[1] < 0.0f ? c.x[1] - root : c.x[1] + root);
    float a = fabsf(q) < 100.0f * fabsf(c.x[2]) ? q / c.x[2] : 100.0f;
    float b = fabsf(c.x[0]) < 100.0f * fabsf(q) ? c.x[0] / q : -100.0f;
    roots.count = 2;
    roots.x[0] = fminf(a, b);
    roots.x[1] = fmaxf(a, b);
    return roots;
}

/* The root between a and b: Newton's steps, or halves where they lead astray. */
static float root_between(numbers c, float a, float b) {
    numbers slope = derivative(c, 1);
    float end = polynomial(c, b), x = 0.5f * (a + b);
    for (int i = 0; i < 32; ++i) {
        float value = polynomial(c, x), next = x - value / polynomial(slope, x);
        if (value * end > 0.0f)
            b = x;
        else
            a = x;
        if (!(next > a && next < b)) next = 0.5f * (a + b);
        if (fabsf(next - x) < 1e-6f) return next;
        x = next;
    }
    return x;
}

/* Roots of degree 2, 3 or 4, all real: those of each derivative part those of the one before it. */
static numbers moment_roots(numbers c) {
    numbers roots = quadratic_roots(derivative(c, c.count - 3));
    for (int order = c.count - 4; order >= 0; --order) {
        numbers inner = roots, d = derivative(c, order);
        roots.count = inner.count + 1;
        for (int i = 0; i < roots.count; ++i) {
            float a = i > 0 ? inner.x[clampi(i - 1, 0, 4)] : -100.0f;
            float b = i < inner.count ? inner.x[i] : 100.0f;
            roots.x[i] = root_between(d, a, b);
        }
    }
    return roots;
}

static float moment_depth(int first, int n, float u) {
    float z = 2.0f * u - 1.0f, whole = texels[first];
    if (!(whole > 0.0f) || u >= 1.0f) return whole;
    lower_left f = moment_factor(first, n);
    numbers roots = moment_roots(moment_kernel(f, z));
    float here = moment_weight(f, z), sum = here, before = 0.5f * here;
    for (int i = 0; i < roots.count; ++i) {
        float weight = moment_weight(f, roots.x[i]);
        sum += weight;
        before += roots.x[i] < z ? weight : 0.0f;
    }
    return whole * before / sum;
}

/* Optical depth of gas before u in one texel. Keep the line of your technique. */
static float gas_depth(int texel, float u) {
    int first = texel * map_components, n = map_components;
    if (map_technique == SPS_TMAP_DEEP) return deep_depth(texel, u);
    if (map_technique == SPS_TMAP_COMPRESSED) return compressed_depth(texel, u);
    if (map_technique == SPS_TMAP_DEPTH) return depth_depth(first, u);
    if (map_technique == SPS_TMAP_COSINE) return cosine_depth(first, n, u);
    if (map_technique == SPS_TMAP_MOMENT) return moment_depth(first, n, u);
    if (map_technique == SPS_TMAP_ADAPTIVE) return adaptive_depth(first, n, u);
    if (map_technique == SPS_TMAP_BEER) return beer_depth(first, u);
    if (map_has_range != 0) { /* u counts from the texel's first occluder to its last */
        float begin = texels[first], end = texels[first + 1];
        if (u < begin) return 0.0f;
        u = end > begin ? fminf((u - begin) / (end - begin), 1.0f) : 1.0f;
        first += 2;
        n -= 2;
    }
    if (map_technique == SPS_TMAP_FOURIER) return fourier_depth(first, n, u);
    if (map_cubic != 0) return opacity_cubic_depth(first, n, u);
    return map_has_planes != 0 ? opacity_planes_depth(first, n, u) : opacity_depth(first, n, u);
}

/* Where a point lies in the map: texels' centres are whole numbers of x and y. */
typedef struct place {
    int face;
    float x, y, u, distance;
} place;

static float row_times(vec4 row, vec3 p) { return row.x * p.x + row.y * p.y + row.z * p.z + row.w; }

static place place_of(vec3 position) {
    place p;
    float w = row_times(map_row_w, position);
    p.face = 0;
    p.x = row_times(map_row_x, position) / w;
    p.y = row_times(map_row_y, position) / w;
    p.distance = row_times(map_row_distance, position);
    p.u = w > 0.0f ? (p.distance - map_near) / (map_far - map_near) : -1.0f;
    return p;
}

/* The same of six faces, for a point counted from the light. */
static place place_of_six(vec3 offset) {
    place p;
    float x = fabsf(offset.x), y = fabsf(offset.y), z = fabsf(offset.z);
    int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    float along = axis == 0 ? offset.x : axis == 1 ? offset.y : offset.z;
    float right = axis == 0 ? offset.y : axis == 1 ? offset.z : offset.x;
    float down = axis == 0 ? offset.z : axis == 1 ? offset.x : offset.y;
    p.face = 2 * axis + (along < 0.0f ? 1 : 0);
    p.distance = fabsf(along);
    p.x = (0.5f + 0.5f * right / p.distance) * (float)(map_width - 1);
    p.y = (0.5f + 0.5f * down / p.distance) * (float)(map_height - 1);
    p.u = p.distance > 0.0f ? (p.distance - map_near) / (map_far - map_near) : -1.0f;
    return p;
}

/* The results of four texels at the point's own u: their optical depths are mixed, not what is in them. */
static float transmittance(place p) {
    float right = (float)map_width - 0.5f, bottom = (float)map_height - 0.5f, depth = 0.0f, lit = 0.0f;
    float bias = (map_bias + map_bias_per_distance * p.distance) / (map_far - map_near);
    if (!(p.u >= 0.0f && p.x >= -0.5f && p.y >= -0.5f && p.x <= right && p.y <= bottom)) return 1.0f;
    float u = fminf(p.u, 1.0f);
    for (int i = 0; i < 4; ++i) {
        int x = (int)floorf(p.x) + i % 2, y = (int)floorf(p.y) + i / 2;
        int row = p.face * map_height + clampi(y, 0, map_height - 1);
        int texel = row * map_width + clampi(x, 0, map_width - 1);
        float weight = (1.0f - fabsf(p.x - (float)x)) * (1.0f - fabsf(p.y - (float)y));
        depth += weight * gas_depth(texel, u);
        lit += map_has_surfaces != 0 && surfaces[texel] + bias < p.u ? 0.0f : weight;
    }
    return lit * expf(-depth);
}
/* end */

/* ------------------------------------------------------------------------------------------------------ the scene */

enum { WIDTH = 23, HEIGHT = 17, SIDE = 19, EVEN = 40, SOFT = 30, OPAQUE = 5, GLASS = 4, POINTS = 1000 };

typedef enum light_kind { SPOT, SUN, SIX_FACES, SPOT_BY_MATRIX, SUN_BY_MATRIX, KINDS } light_kind;

/* Gas in two sets of particles and some of them dense, opaque triangles and translucent ones, all of it within 4 of
   the origin along each axis. The light is outside, or, of six faces, in the midst of it; some of the gas and of the
   points looked at lie before near_depth. */
typedef struct fixture {
    sps_view light;
    sps_tmap_settings settings;
    sps_scene scene;
    sps_particles sets[2];
    sps_mesh meshes[2];
    sps_particle even[EVEN], soft[SOFT];
    sps_triangle opaque[OPAQUE], glass[GLASS];
    light_kind kind;
    double matrix[16];
} fixture;

static int read_particles(void *user, size_t first, size_t count, sps_particle *out) {
    memcpy(out, (const sps_particle *)user + first, count * sizeof *out);
    return 0;
}

static int read_triangles(void *user, size_t first, size_t count, sps_triangle *out) {
    memcpy(out, (const sps_triangle *)user + first, count * sizeof *out);
    return 0;
}

static void scatter(check_random *random, sps_particle *list, int count) {
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) list[i].position[k] = (float)(6 * check_next(random) - 3);
        list[i].radius = (float)(0.4 + 0.9 * check_next(random));
        list[i].optical_depth = (float)((i % 10 == 0 ? 8 : 1) * check_next(random));
    }
}

static void scatter_triangles(check_random *random, sps_triangle *list, int count) {
    for (int i = 0; i < count; ++i) {
        double middle[3];
        for (int k = 0; k < 3; ++k) middle[k] = 5 * check_next(random) - 2.5;
        for (int corner = 0; corner < 3; ++corner)
            for (int k = 0; k < 3; ++k)
                list[i].position[corner][k] = (float)(middle[k] + 3.5 * (check_next(random) - 0.5));
    }
}

static void fixture_fill(fixture *f) {
    check_random random = {77};
    scatter(&random, f->even, EVEN);
    scatter(&random, f->soft, SOFT);
    scatter_triangles(&random, f->opaque, OPAQUE);
    scatter_triangles(&random, f->glass, GLASS);
    for (int i = 0; i < 2; ++i) {
        f->sets[i].read_fn = read_particles;
        f->meshes[i].read_fn = read_triangles;
    }
    f->sets[0].user = f->even, f->sets[0].count = EVEN;
    f->sets[1].user = f->soft, f->sets[1].count = SOFT, f->sets[1].soft = 1;
    f->meshes[0].user = f->opaque, f->meshes[0].triangle_count = OPAQUE;
    f->meshes[1].user = f->glass, f->meshes[1].triangle_count = GLASS, f->meshes[1].transparency = 0.6f;
    f->scene.particles = f->sets, f->scene.particles_count = 2;
    f->scene.meshes = f->meshes, f->scene.mesh_count = 2;
}

/* Row-major, with a column that turns the world by some angle and moves it 8 before the light; perspective as OpenGL
   has it, from 2 to 20, and orthographic as Direct3D has it, 7 by 6 world units and 16 deep. */
static void fill_matrix(double m[16], int perspective) {
    const double c = cos(0.4), s = sin(0.4), x = perspective ? 2.2 : 2 / 7.0, y = perspective ? 2.9 : 2 / 6.0;
    const double view[3][4] = {{c, s, 0, 0.2}, {-s, c, 0, 0.1}, {0, 0, 1, 8}};
    for (int i = 0; i < 4; ++i) {
        const double one = i == 3;
        m[i] = x * view[0][i], m[4 + i] = y * view[1][i];
        m[8 + i] = perspective ? (22 * view[2][i] - 80 * one) / 18 : view[2][i] / 16;
        m[12 + i] = perspective ? view[2][i] : one;
    }
}

static void fixture_aim(fixture *f, light_kind kind) {
    f->kind = kind;
    check_set3(f->light.position, 0.3, -0.2, kind == SIX_FACES ? 0.4 : 9);
    check_set3(f->light.target, -0.4, 0.5, 0);
    check_set3(f->light.up, 0.2, 1, 0.1);
    f->light.width = kind == SIX_FACES ? SIDE : WIDTH;
    f->light.height = kind == SIX_FACES ? SIDE : HEIGHT;
    f->light.field_of_view = kind == SPOT ? 0.7 : 0;
    f->light.ortho_height = 6;
    f->settings.near_depth = kind == SIX_FACES ? 0.9 : 5.5;
    f->settings.far_depth = kind == SIX_FACES ? 4.5 : 13;
    f->settings.omnidirectional = kind == SIX_FACES;
    if (kind < SPOT_BY_MATRIX) return;
    fill_matrix(f->matrix, kind == SPOT_BY_MATRIX);
    f->light.world_to_clip = f->matrix;
    if (kind == SUN_BY_MATRIX)
        f->settings.near_depth += 16, f->settings.far_depth += 16, f->settings.surface_bias = 0.4;
}

static sps_tmap *fixture_build(const fixture *f, sps_context *context) {
    sps_tmap *map = NULL;
    if (CHECK_OK(context, sps_tmap_create(context, &f->light, &f->settings, &map)) &&
        CHECK_OK(context, sps_tmap_add(map, &f->scene)) && CHECK_OK(context, sps_tmap_finish(map)))
        return map;
    sps_tmap_destroy(map);
    return NULL;
}

/* ------------------------------------------------------------------------------------- what a program hands a shader
 */

static vec4 row_of(const double matrix[16], int row) {
    vec4 out;
    out.x = (float)matrix[4 * row], out.y = (float)matrix[4 * row + 1], out.z = (float)matrix[4 * row + 2];
    out.w = (float)matrix[4 * row + 3];
    return out;
}

/* An engine that has drawn the map itself, with a clip matrix of its own, hands over the same. */
static void check_own_matrix(const fixture *f, const double matrix[16]) {
    const double *m = f->light.world_to_clip, *w = m + 12;
    for (int i = 0; i < 4; ++i) {
        const double own[3] = {((m[i] + w[i]) * f->light.width - w[i]) / 2,
                               ((w[i] - m[4 + i]) * f->light.height - w[i]) / 2, w[i]};
        CHECK_NEAR(matrix[i], own[0], 1e-12 * WIDTH);
        CHECK_NEAR(matrix[4 + i], own[1], 1e-12 * WIDTH);
        CHECK_NEAR(matrix[12 + i], own[2], 1e-12);
    }
}

static void hand_over(const sps_tmap *map, const fixture *f) {
    sps_tmap_settings s;
    double matrix[16], bias[2];
    sps_tmap_get_settings(map, &s);
    texels = sps_tmap_texels(map), starts = sps_tmap_starts(map), surfaces = sps_tmap_surfaces(map);
    planes = s.planes;
    map_technique = (int)s.technique, map_components = s.components;
    map_has_range = s.technique == SPS_TMAP_DEEP_OPACITY || (s.technique == SPS_TMAP_FOURIER && s.texel_range);
    map_has_planes = planes != NULL, map_cubic = s.cubic;
    map_running_maximum = s.running_maximum;
    map_has_surfaces = surfaces != NULL;
    map_width = f->light.width, map_height = f->light.height;
    map_near = (float)s.near_depth, map_far = (float)s.far_depth;
    sps_tmap_get_projection(map, 0, matrix, bias);
    map_row_x = row_of(matrix, 0), map_row_y = row_of(matrix, 1);
    map_row_distance = row_of(matrix, 2), map_row_w = row_of(matrix, 3);
    map_bias = (float)bias[0], map_bias_per_distance = (float)bias[1];
    if (f->light.world_to_clip) check_own_matrix(f, matrix);
}

/* A point given in world space. */
static place locate(const fixture *f, const double position[3]) {
    vec3 p;
    const double *origin = f->light.position;
    if (!f->settings.omnidirectional) {
        p.x = (float)position[0], p.y = (float)position[1], p.z = (float)position[2];
        return place_of(p);
    }
    p.x = (float)(position[0] - origin[0]), p.y = (float)(position[1] - origin[1]);
    p.z = (float)(position[2] - origin[2]);
    return place_of_six(p);
}

/* -------------------------------------------------------------------------------------------- against sps_tmap_query
 */

/* Between what a floating-point evaluation may come to lies, for certain, between low and high. */
typedef struct span {
    double low, high;
} span;

/* By what optical depth, as `depth`, may be off because transmittance is, by `error`, cut below at `least`. */
static span span_of_through(double depth, double error, double least) {
    span s;
    const double through = exp(-depth), low = fmax(through - error, least);
    s.low = -log(fmin(through + error, 1));
    s.high = low > 0 ? -log(low) : 1e15;
    return s;
}

/* Moments are solved for by a matrix close to singular. In floats that gives the exact answer to a matrix whose
   elements are off by about its size times 6e-8 [Wilkinson 1968]; what this means for the answer is found out by doing
   that to them: three times as much as the most that eight tries show. */
static span span_of_moments(int texel, float u, double depth) {
    const float *kept = texels;
    check_random random = {(uint64_t)texel + 1};
    double most = 0;
    span s;
    for (int i = 0; i < 8; ++i) {
        float moved[9];
        for (int k = 0; k < map_components; ++k) {
            const double error = 3e-7 * (check_next(&random) < 0.5 ? -1 : 1);
            moved[k] = (float)((double)kept[texel * map_components + k] + (k > 0 ? error : 0));
        }
        texels = moved;
        most = fmax(most, fabs((double)moment_depth(0, map_components, u) - depth));
    }
    texels = kept;
    s.low = depth - 3 * most, s.high = depth + 3 * most;
    return s;
}

/* One texel at one u. Sums of up to 17 terms, angles of up to 50 radians good to 6e-8 of themselves, each term less
   than the whole: 2e-6 of that. Lines between nodes of T: three roundings. Cosines: 8 terms of up to 1 with angles of
   up to
   22. The floor of a cosine map's T is given in the code in six digits. */
static span span_of_texel(int texel, float u) {
    const double depth = (double)gas_depth(texel, u), whole = (double)gas_depth(texel, 1);
    span s;
    if (map_technique == SPS_TMAP_COSINE) return span_of_through(depth, 3e-6, 1.12535e-7);
    if (map_technique == SPS_TMAP_COMPRESSED || map_technique == SPS_TMAP_ADAPTIVE)
        return span_of_through(depth, 3e-7, 0);
    if (map_technique == SPS_TMAP_MOMENT) return span_of_moments(texel, u, depth);
    s.low = s.high = depth;
    if (map_technique == SPS_TMAP_DEPTH) return s;
    s.low -= 2e-6 * whole, s.high += 2e-6 * whole;
    return s;
}

/* Everything between u - 8e-7 and u + 8e-7: depths are up to 30, of one rounding, and sums of three products of up to
   12, in a range of 4 that is not as far away or of 8.5. Curves are straight over so little, or jump. */
static span span_about(int texel, float u) {
    span s = span_of_texel(texel, u);
    for (int i = -1; i <= 1; i += 2) {
        const span other = span_of_texel(texel, fminf(fmaxf(u + (float)i * 8e-7f, 0), 1));
        s.low = fmin(s.low, other.low), s.high = fmax(s.high, other.high);
    }
    return s;
}

static double overlap(double x, int texel) { return fmax(1 - fabs(x - texel), 0); }

/* What the code may give at a place. Texel coordinates are sums of three products of up to 12 in units of at most 5
   texels, each good to 6e-8: 2e-5. A point whose u is this close to a surface may be before or behind it. */
static span span_of_transmittance(const place *p) {
    const double bias = (double)((map_bias + map_bias_per_distance * p->distance) / (map_far - map_near));
    const double beyond = (double)p->u; /* of far_depth, perhaps: surfaces may lie there */
    const float u = fminf(p->u, 1);
    span depth = {0, 0}, lit = {0, 0}, s;
    for (int i = 0; i < 4; ++i) {
        const int x = (int)floorf(p->x) + i % 2, y = (int)floorf(p->y) + i / 2;
        const int row = p->face * map_height + clampi(y, 0, map_height - 1);
        const int texel = row * map_width + clampi(x, 0, map_width - 1);
        const double weight = overlap((double)p->x, x) * overlap((double)p->y, y), less = fmax(weight - 4e-5, 0);
        const span one = span_about(texel, u);
        const double surface = surfaces ? (double)surfaces[texel] + bias : 1e30;
        depth.low += less * fmax(one.low, 0), depth.high += (weight + 4e-5) * one.high;
        lit.low += surface - 1e-6 < beyond ? 0 : less;
        lit.high += surface + 1e-6 < beyond ? 0 : weight + 4e-5;
        if (i == 3 && lit.low > 1 - 2e-4) lit.low = lit.high = 1;
    }
    s.low = lit.low * exp(-depth.high) - 3e-7, s.high = lit.high * exp(-depth.low) + 3e-7;
    return s;
}

static int outside(const place *p) {
    return !(p->u >= 0 && p->x >= -0.5f && p->y >= -0.5f && p->x <= (float)map_width - 0.5f &&
             p->y <= (float)map_height - 0.5f);
}

/* What random points came to. */
typedef struct tally {
    int outside, between, seen, dark;
    double slack; /* widths of spans, summed */
} tally;

/* Whether both transmittances are right at a place on the map. */
typedef int (*judge_fn)(const place *p, double sampled, double query, tally *points);

static int judge_between(const place *p, double sampled, double query, tally *points) {
    const span s = span_of_transmittance(p);
    points->slack += s.high - s.low;
    points->between += query > 0.02 && query < 0.98;
    return query >= s.low && query <= s.high && sampled >= s.low && sampled <= s.high;
}

/* Behind far_depth, up to three times as far from the middle of things. Texel coordinates are off by three times as
   much there, 6e-5, weights by 1.2e-4, and that of the largest optical depth, 30, is 4e-3 of T. */
static int judge_beyond(const place *p, double sampled, double query, tally *points) {
    if (p->u < 1.01f) return 1;
    const span s = span_of_transmittance(p);
    if (s.high - s.low > 1e-2) return 1; /* at a surface's own depth, or at the map's edge */
    ++points->seen;
    points->dark += query <= 0;
    return fabs(sampled - query) <= 4e-3;
}

/* Lets points be judged that lie anywhere within `reach` of the middle along each axis. Outside of the map both
   transmittances are 1. */
static tally check_points(const char *name, const fixture *f, const sps_tmap *map, uint64_t seed, double reach,
                          judge_fn judge) {
    check_random random = {seed};
    tally points = {0, 0, 0, 0, 0};
    for (int i = 0; i < POINTS; ++i) {
        double position[3];
        float query;
        for (int k = 0; k < 3; ++k) position[k] = (double)(float)(reach * (2 * check_next(&random) - 1));
        sps_tmap_query(map, 1, position, NULL, &query);
        const place p = locate(f, position);
        const double sampled = (double)transmittance(p);
        const int is_outside = outside(&p);
        points.outside += is_outside;
        if (!CHECK(is_outside ? sampled == 1 && query == 1 : judge(&p, sampled, (double)query, &points)))
            printf("    %s, light %d: face %d x %g y %g u %g: sampled %.8g, query %.8g\n", name, (int)f->kind, p.face,
                   (double)p.x, (double)p.y, (double)p.u, sampled, (double)query);
    }
    return points;
}

/* At random points the code gives what sps_tmap_query does, but for rounding, which on average over all points on the
   map is allowed no more than 5e-4. One in five points at least is neither lit nor dark. */
static void check_map(const char *name, const fixture *f, const sps_tmap *map) {
    hand_over(map, f);
    const tally near = check_points(name, f, map, 5, 4, judge_between);
    const tally far = check_points(name, f, map, 6, 12, judge_beyond);
    if (!CHECK(near.slack < 5e-4 * (double)POINTS && near.outside < POINTS / 2 &&
               (near.between > POINTS / 5 || map_technique == SPS_TMAP_DEPTH)))
        printf("    %s, light %d: slack %g, %d partly lit, %d outside\n", name, (int)f->kind,
               near.slack / (double)POINTS, near.between, near.outside);
    if (!CHECK(far.seen > 20 && (!surfaces || far.dark > 0)))
        printf("    %s, light %d: of %d points behind far_depth %d are dark\n", name, (int)f->kind, far.seen, far.dark);
}

/* ---------------------------------------------------------------------------------------------------- all techniques
 */

typedef struct variant {
    const char *name;
    sps_tmap_technique technique;
    int components, cubic, has_planes, texel_range, running_maximum;
    sps_tmap_window window;
} variant;

static const variant variants[] = {
    {"deep", SPS_TMAP_DEEP, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"compressed", SPS_TMAP_COMPRESSED, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"depth", SPS_TMAP_DEPTH, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity", SPS_TMAP_OPACITY, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity, one plane", SPS_TMAP_OPACITY, 1, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity, cubic", SPS_TMAP_OPACITY, 11, 1, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity, one plane, cubic", SPS_TMAP_OPACITY, 1, 1, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity, planes given", SPS_TMAP_OPACITY, 8, 0, 1, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"opacity, planes given, cubic", SPS_TMAP_OPACITY, 8, 1, 1, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"deep opacity", SPS_TMAP_DEEP_OPACITY, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"deep opacity, planes given, cubic", SPS_TMAP_DEEP_OPACITY, 10, 1, 1, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"Fourier", SPS_TMAP_FOURIER, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"Fourier, Lanczos", SPS_TMAP_FOURIER, 17, 0, 0, 0, 0, SPS_TMAP_WINDOW_LANCZOS},
    {"Fourier, Fejer, range", SPS_TMAP_FOURIER, 11, 0, 0, 1, 0, SPS_TMAP_WINDOW_FEJER},
    {"Fourier, range", SPS_TMAP_FOURIER, 0, 0, 0, 1, 0, SPS_TMAP_WINDOW_NONE},
    {"Fourier, running maximum", SPS_TMAP_FOURIER, 9, 0, 0, 0, 1, SPS_TMAP_WINDOW_NONE},
    {"Fourier, range, running maximum", SPS_TMAP_FOURIER, 9, 0, 0, 1, 1, SPS_TMAP_WINDOW_NONE},
    {"cosine", SPS_TMAP_COSINE, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"cosine, Lanczos", SPS_TMAP_COSINE, 6, 0, 0, 0, 0, SPS_TMAP_WINDOW_LANCZOS},
    {"4 moments", SPS_TMAP_MOMENT, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"6 moments", SPS_TMAP_MOMENT, 7, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"8 moments", SPS_TMAP_MOMENT, 9, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"adaptive", SPS_TMAP_ADAPTIVE, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
    {"Beer", SPS_TMAP_BEER, 0, 0, 0, 0, 0, SPS_TMAP_WINDOW_NONE},
};

static const float given_planes[8] = {0.15f, 0.3f, 0.34f, 0.4f, 0.55f, 0.77f, 0.8f, 1};

static void fixture_begin(fixture *f, const variant *v, light_kind kind) {
    memset(f, 0, sizeof *f);
    fixture_fill(f);
    f->settings.technique = v->technique;
    f->settings.components = v->components;
    f->settings.cubic = v->cubic;
    f->settings.planes = v->has_planes ? given_planes : NULL;
    f->settings.window = v->window;
    f->settings.texel_range = v->texel_range;
    f->settings.running_maximum = v->running_maximum;
    fixture_aim(f, kind);
}

static void test_techniques(void) {
    static fixture f;
    sps_context *context = sps_create(NULL);
    for (int kind = 0; kind < KINDS; ++kind)
        for (size_t i = 0; i < sizeof variants / sizeof *variants; ++i) {
            /* what a matrix says is the same for all: two will do */
            if (kind >= SPOT_BY_MATRIX && variants[i].technique != SPS_TMAP_COMPRESSED) continue;
            fixture_begin(&f, &variants[i], (light_kind)kind);
            sps_tmap *map = fixture_build(&f, context);
            if (map) check_map(variants[i].name, &f, map);
            sps_tmap_destroy(map);
        }
    sps_destroy(context);
}

/* Nothing opaque: no surfaces are handed over. */
static void test_gas_alone(void) {
    static fixture f;
    sps_context *context = sps_create(NULL);
    fixture_begin(&f, &variants[3], SPOT);
    f.scene.mesh_count = 0;
    sps_tmap *map = fixture_build(&f, context);
    if (CHECK(map != NULL && sps_tmap_surfaces(map) == NULL)) check_map("gas alone", &f, map);
    sps_tmap_destroy(map);
    sps_destroy(context);
}

/* ------------------------------------------------------------------------------------------ what else the page says */

/* Mixes component `component` of the four texels of a place, as a texture's filter does. */
static double filtered(place p, int component) {
    double sum = 0;
    for (int i = 0; i < 4; ++i) {
        const int x = (int)floorf(p.x) + i % 2, y = (int)floorf(p.y) + i / 2;
        const int texel = clampi(y, 0, map_height - 1) * map_width + clampi(x, 0, map_width - 1);
        sum += overlap((double)p.x, x) * overlap((double)p.y, y) * (double)texels[texel * map_components + component];
    }
    return sum;
}

/* Even planes in a 3D texture of n slices, whose centres are at (i + 0.5) / n. */
static double filtered_opacity(place p) {
    const int n = map_components;
    const double u = (double)p.u, slice = n * (fmax(u, 1.0 / n) - 0.5 / n) - 0.5;
    const int below = clampi((int)floor(slice), 0, n - 1), above = clampi(below + 1, 0, n - 1);
    const double t = slice - below;
    return fmin(n * u, 1) * ((1 - t) * filtered(p, below) + t * filtered(p, above));
}

static double filtered_fourier(place p) {
    float mixed[17];
    for (int k = 0; k < map_components; ++k) mixed[k] = (float)filtered(p, k);
    const float *kept = texels;
    texels = mixed;
    const double depth = (double)fourier_series(0, map_components, p.u);
    texels = kept;
    return fmin(fmax(depth, 0), 0.5 * (double)mixed[0]);
}

/* The shortcuts give what four texels' results do: floats of up to 40, sums of 7. A Fourier map's series of four texels
   must for that be where none is cut, which is the case for most. */
static void test_shortcuts(void) {
    static fixture f;
    for (int fourier = 0; fourier < 2; ++fourier) {
        sps_context *context = sps_create(NULL);
        check_random random = {21};
        int uncut = 0;
        fixture_begin(&f, &variants[fourier ? 11 : 3], SUN);
        f.scene.mesh_count = 0;
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        hand_over(map, &f);
        for (int i = 0; i < POINTS; ++i) {
            place p;
            p.face = 0, p.distance = 0, p.u = (float)check_next(&random);
            p.x = (float)((WIDTH - 1) * check_next(&random)), p.y = (float)((HEIGHT - 1) * check_next(&random));
            const double through = exp(-(fourier ? filtered_fourier(p) : filtered_opacity(p)));
            const int near_by = fabs(through - (double)transmittance(p)) < 2e-5;
            uncut += near_by;
            if (!fourier) CHECK(near_by);
        }
        CHECK(uncut > POINTS / 2);
        sps_tmap_destroy(map);
        sps_destroy(context);
    }
}

/* What section 6 says that a stretch adds to a texel of a technique: floats, in the end, of one stretch alone. */
static void insert_as_told(double u0, double u1, double depth, int soft, double *out) {
    const double pi = 3.14159265358979323846, m = 0.5 * (u0 + u1), e = 0.5 * (u1 - u0);
    const double z = 2 * m - 1, h = 2 * e;
    const int n = map_components;
    for (int i = 0; i < n && map_technique == SPS_TMAP_OPACITY; ++i) {
        const double s = fmin(fmax(((i + 1.0) / n - u0) / (u1 - u0), 0), 1);
        out[i] = depth * (soft ? s * s * (3 - 2 * s) : s);
    }
    for (int k = 0; 2 * k < n && map_technique == SPS_TMAP_FOURIER; ++k) {
        const double x = 2 * pi * k * e;
        const double d = k == 0 ? 1 : soft ? 3 * (sin(x) - x * cos(x)) / (x * x * x) : sin(x) / x;
        if (k > 0) out[2 * k - 1] = 2 * depth * cos(2 * pi * k * m) * d;
        out[2 * k] = 2 * depth * sin(2 * pi * k * m) * d;
        if (k == 0) out[0] = 2 * depth;
    }
    if (map_technique == SPS_TMAP_BEER) out[0] = u0, out[1] = depth / (u1 - u0), out[2] = depth;
    if (map_technique != SPS_TMAP_MOMENT) return;
    out[0] = depth, out[1] = z, out[2] = z * z + h * h / 3, out[3] = z * z * z + z * h * h;
    out[4] = pow(z, 4) + 2 * z * z * h * h + pow(h, 4) / 5;
    for (int k = 1; k < n; ++k) /* the other formula says the same */
        CHECK_NEAR((pow(z + h, k + 1) - pow(z - h, k + 1)) / ((k + 1) * 2 * h), out[k], 1e-12);
}

/* One particle before one light, and each texel's chord through it by hand. u0 and u1 are floats, good to 3e-8, and the
   shortest chord looked at is 1/37 of the depth: 2e-6 for what is divided by its length, 1e-5 with the library's own
   rounding of chords. */
static void test_insertion(void) {
    static const int which[] = {3, 11, 19, 23}; /* opacity, Fourier, 4 moments, Beer */
    static fixture f;
    sps_particle ball;
    sps_context *context = sps_create(NULL);
    for (int i = 0; i < 8; ++i) {
        const int soft = i >= 4;
        if (soft && which[i % 4] == 19) continue; /* the page has moments of even stretches */
        fixture_begin(&f, &variants[which[i % 4]], SUN);
        memset(&ball, 0, sizeof ball);
        ball.position[0] = 0.3f, ball.position[1] = -0.2f, ball.position[2] = 0.4f;
        ball.radius = 2, ball.optical_depth = 2;
        f.sets[soft].user = &ball, f.sets[soft].count = 1, f.sets[!soft].count = 0;
        f.scene.mesh_count = 0;
        check_set3(f.light.target, 0.3, -0.2, 0);
        check_set3(f.light.up, 0, 1, 0);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        hand_over(map, &f);
        for (int texel = 0; texel < WIDTH * HEIGHT; ++texel) {
            const double x = (texel % WIDTH - 0.5 * (WIDTH - 1)) * 6 / (double)HEIGHT;
            const double y = (texel / WIDTH - 0.5 * (HEIGHT - 1)) * 6 / (double)HEIGHT, square = 4 - x * x - y * y;
            const double half = sqrt(fmax(square, 0)), middle = 9 - 0.4, range = 13 - 5.5;
            double told[8];
            if (half < 0.1) continue;
            insert_as_told((middle - half - 5.5) / range, (middle + half - 5.5) / range,
                           2 * (soft ? pow(half / 2, 3) : half / 2), soft, told);
            for (int k = 0; k < map_components; ++k)
                CHECK_NEAR((double)texels[texel * map_components + k], told[k], 1e-5 * fmax(fabs(told[k]), 1));
        }
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* ---------------------------------------------------------------------------------------- what half precision leaves
 */

/* Rounds to 11 digits, to even, as storing in half precision does; what is too large becomes the largest. */
static float half_of(float x) {
    int exponent;
    frexp((double)x, &exponent);
    const double step = ldexp(1, exponent > -13 ? exponent - 11 : -24);
    return (float)fmin(fmax(nearbyint((double)x / step) * step, -65504), 65504);
}

/* The most that transmittance changes when a map's texels are rounded to half precision: what docs/shadow_maps.md says
   of each technique. */
static void test_half(void) {
    static const struct {
        const char *name;
        double most;
        int fails; /* 1: it is off by more than that */
    } rows[] = {{"opacity", 5e-4, 0},          {"opacity, cubic", 5e-4, 0}, {"Fourier", 5e-3, 0},
                {"Fourier, Lanczos", 5e-3, 0}, {"cosine", 5e-3, 0},         {"adaptive", 5e-3, 0},
                {"deep opacity", 5e-3, 0},     {"Beer", 5e-3, 0},           {"4 moments", 0.02, 1},
                {"6 moments", 0.02, 1},        {"8 moments", 0.02, 1}};
    static fixture f;
    static float rounded[WIDTH * HEIGHT * 17];
    sps_context *context = sps_create(NULL);
    for (size_t row = 0; row < sizeof rows / sizeof *rows; ++row) {
        const variant *v = variants;
        check_random random = {9};
        double most = 0;
        while (strcmp(v->name, rows[row].name) != 0) ++v;
        fixture_begin(&f, v, SUN);
        sps_tmap *map = fixture_build(&f, context);
        if (!CHECK(map != NULL)) continue;
        hand_over(map, &f);
        for (int i = 0; i < WIDTH * HEIGHT * map_components; ++i) rounded[i] = half_of(texels[i]);
        for (int i = 0; i < 4 * POINTS; ++i) {
            const int texel = (int)(check_next(&random) * (double)(WIDTH * HEIGHT));
            const float u = (float)check_next(&random);
            texels = sps_tmap_texels(map);
            const double exact = exp((double)-gas_depth(texel, u));
            texels = rounded;
            most = fmax(most, fabs(exp((double)-gas_depth(texel, u)) - exact));
        }
        if (!CHECK(rows[row].fails == (most > rows[row].most))) printf("    %s: %g\n", rows[row].name, most);
        sps_tmap_destroy(map);
    }
    sps_destroy(context);
}

/* --------------------------------------------------------------------------------------------------- the page itself
 */

/* All of a file, to be freed; NULL if it cannot be read. */
static char *read_text(const char *path) {
    FILE *file = fopen(path, "rb");
    const size_t room = 1 << 20;
    char *text = file ? (char *)malloc(room + 1) : NULL;
    size_t length = 0;
    if (text) length = fread(text, 1, room, file);
    if (text) text[length] = 0;
    if (file) fclose(file);
    return text;
}

/* Appends to a text that ends with 0 and has room. */
static void append(char *out, const char *from, size_t length) {
    const size_t end = strlen(out);
    memcpy(out + end, from, length);
    out[end + length] = 0;
}

/* The code blocks of a language from number `first` on, with an empty line between them. To be freed. */
static char *blocks_of(const char *page, const char *language, int first) {
    char *out = (char *)calloc(strlen(page) + 1, 1);
    char fence[16];
    snprintf(fence, sizeof fence, "\n```%s\n", language);
    for (const char *at = strstr(page, fence); at && out; at = strstr(at, fence)) {
        const char *begin = at + strlen(fence), *end = strstr(begin, "\n```\n");
        if (!end) break;
        at = end;
        if (first-- > 0) continue;
        if (out[0]) append(out, "\n", 1);
        append(out, begin, (size_t)(end + 1 - begin));
    }
    return out;
}

typedef struct spelling {
    const char *c, *other;
} spelling;

/* Words that differ; "" leaves one out, with the space after it. What comes before the first function is C's alone. */
static const spelling to_glsl[] = {{"static", ""},   {"typedef", ""},  {"clampi", "clamp"}, {"fminf", "min"},
                                   {"fmaxf", "max"}, {"fabsf", "abs"}, {"sqrtf", "sqrt"},   {"sinf", "sin"},
                                   {"cosf", "cos"},  {"expf", "exp"},  {"floorf", "floor"}, {"logf", "log"},
                                   {NULL, NULL}};
static const spelling to_hlsl[] = {
    {"mix", "lerp"}, {"vec2", "float2"}, {"vec3", "float3"}, {"vec4", "float4"}, {NULL, NULL}};

static int is_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || (c >= '0' && c <= '9');
}

static size_t word_length(const char *text) {
    size_t length = 0;
    while (is_word(text[length])) ++length;
    return length;
}

/* Numbers lose their f; 1e-7 is two words. */
static size_t number_length(const char *word, size_t length) {
    return word[0] >= '0' && word[0] <= '9' && word[length - 1] == 'f' ? length - 1 : length;
}

/* Another language's words for C's. To be freed. */
static char *respell(const char *text, const spelling *spellings) {
    char *out = (char *)calloc(2 * strlen(text) + 1, 1);
    while (*text && out) {
        const size_t length = word_length(text);
        const spelling *s = spellings;
        if (length == 0) {
            append(out, text++, 1);
            continue;
        }
        while (s->c && (strlen(s->c) != length || strncmp(s->c, text, length) != 0)) ++s;
        append(out, s->c ? s->other : text, s->c ? strlen(s->other) : number_length(text, length));
        text += length;
        if (s->c && !s->other[0]) ++text;
    }
    return out;
}

/* What a cast is of: a word and the brackets after it, or brackets alone. */
static size_t operand_length(const char *text) {
    size_t length = word_length(text);
    int depth = 0;
    while (text[length] == '(' || text[length] == '[') do {
            depth += text[length] == '(' || text[length] == '[' ? 1 : 0;
            depth -= text[length] == ')' || text[length] == ']' ? 1 : 0;
            ++length;
        } while (depth > 0);
    return length;
}

/* (float)x becomes float(x), in place: that takes no more room. */
static void turn_casts(char *text, const char *type) {
    char cast[16];
    snprintf(cast, sizeof cast, "(%s)", type);
    for (char *at = strstr(text, cast); at; at = strstr(at + 1, cast)) {
        char *operand = at + strlen(cast);
        const size_t length = operand_length(operand);
        memmove(at, at + 1, strlen(type));
        at[strlen(type)] = '(';
        if (operand[0] == '(')
            memmove(operand - 1, operand + 1, strlen(operand));
        else
            memmove(operand - 1, operand, length), operand[length - 1] = ')';
    }
}

/* "} name;" that ends a typedef becomes "};". */
static void close_structs(char *text) {
    for (char *at = strstr(text, "\n} "); at; at = strstr(at + 1, "\n} ")) {
        const size_t name = word_length(at + 3);
        if (at[3 + name] == ';') memmove(at + 2, at + 3 + name, strlen(at + 3 + name) + 1);
    }
}

static char *glsl_of(const char *c) {
    char *text = respell(c, to_glsl);
    turn_casts(text, "float");
    turn_casts(text, "int");
    close_structs(text);
    return text;
}

/* Says where two texts part, and gives 1 if they do not. */
static int same_text(const char *name, const char *page, const char *wanted) {
    size_t same = 0, line = 1, begin = 0;
    while (page[same] && page[same] == wanted[same]) {
        if (page[same++] == '\n') ++line, begin = same;
    }
    if (page[same] == wanted[same]) return 1;
    printf("    %s, line %d of the code: the page has\n        %.*s\n    where the test has\n        %.*s\n", name,
           (int)line, (int)strcspn(page + begin, "\n"), page + begin, (int)strcspn(wanted + begin, "\n"),
           wanted + begin);
    return 0;
}

/* The code of this file. To be freed. */
static char *own_code(void) {
    char *text = read_text("tests/test_sampling.c");
    char *begin = text ? strstr(text, "/* begin */\n") : NULL, *end = text ? strstr(text, "/* end */\n") : NULL;
    if (!begin || !end) return text;
    *end = 0;
    memmove(text, begin + strlen("/* begin */\n"), (size_t)(end - begin));
    return text;
}

/* Without what only C needs to know: from the first function after the prelude on. */
static const char *without_prelude(const char *code) {
    const char *begin = strstr(code, "/* Even planes");
    return begin ? begin : code;
}

/* The page's C is the code above, its GLSL and HLSL are what follows from that. */
static void test_page(void) {
    char *page = read_text("docs/shadow_maps.md"), *code = own_code();
    if (CHECK(page && code)) {
        char *c = blocks_of(page, "c", 0), *glsl = blocks_of(page, "glsl", 1), *hlsl = blocks_of(page, "hlsl", 1);
        char *as_glsl = glsl_of(without_prelude(code)), *as_hlsl = respell(as_glsl, to_hlsl);
        CHECK(same_text("C", c, code));
        CHECK(same_text("GLSL", glsl, as_glsl));
        CHECK(same_text("HLSL", hlsl, as_hlsl));
        free(c), free(glsl), free(hlsl), free(as_glsl), free(as_hlsl);
    }
    free(page), free(code);
}

/* `test_sampling glsl` and `test_sampling hlsl` print what belongs on the page. */
static int print_code(const char *language) {
    char *code = own_code(), *glsl = code ? glsl_of(without_prelude(code)) : NULL;
    char *hlsl = glsl ? respell(glsl, to_hlsl) : NULL;
    if (hlsl) fputs(strcmp(language, "hlsl") == 0 ? hlsl : glsl, stdout);
    free(code), free(glsl), free(hlsl);
    return 0;
}

int main(int count, char **arguments) {
    if (count > 1) return print_code(arguments[1]);
    RUN(test_techniques);
    RUN(test_gas_alone);
    RUN(test_shortcuts);
    RUN(test_insertion);
    RUN(test_half);
    RUN(test_page);
    return check_report();
}
