/* Reads transmittance maps in a shader, as sps_tmap_query does on the CPU. docs/shadow_maps.md says which map to take,
   how to upload it, and what goes wrong.

       float light_left = tmap_transmittance(tmap_bound, tmap_project(tmap_bound, world_position));

   This file is GLSL and needs no other. transmittance_map.hlsl and transmittance_map.h include it as HLSL and as C:
   words that these spell differently begin with tmap_ here, or are C's own (fminf, sqrtf).

   It reads buffers (GLSL 4.30, ES 3.10), or, with TMAP_TEXTURE defined, what sps_tmap_export makes in the layout
   SPS_EXPORT_ARRAY (GLSL 3.30, ES 3.00): any format, with fronts, and surfaces as a second array. Hardware cube maps,
   atlases and slices are not read; an array holds six faces, too. The uniform block is then the 128 bytes of
   sps_tmap_constants and the 560 of sps_export_constants. Textures clamp to their edges. With them:

       tmap_filtered            one look-up of filtered numbers
       tmap_transmittance       four look-ups, mean of optical depths, as sps_tmap_query
       tmap_mean_transmittance  four look-ups, mean of transmittances, which is better in dense gas

   To let a map end softly over its last 8 texels, or to reach the next cascade there:

       float light_left = mix(1.0, tmap_filtered(tmap_bound, place), tmap_fade(tmap_bound, place, 8.0));

   In Mesa these are as near to sps_tmap_query, on the same numbers, as its filter's steps of 1/256 of a texel and the
   rounding of u allow, to 1e-6 (tests/test_map_shaders.c). Moments are solved for in floats, which moves some places of
   nearly singular ones by 4e-4.

   It reads every kind of map that its source holds. A shader that knows its map sets what it knows to constants, and
   the compiler drops the rest:

       tmap map = tmap_bound;
       map.technique_id = TMAP_DEEP_OPACITY, map.components = 8, map.cubic = 1, map.has_planes = 0;

   An engine with buffers of its own defines TMAP_TEXEL, TMAP_SURFACE, TMAP_PLANE, TMAP_START and TMAP_FRONT before it
   includes this file, and passes a tmap that it has filled itself. One with textures of its own defines TMAP_FETCH,
   TMAP_FETCH_SURFACE, TMAP_SAMPLE, TMAP_SCALE, TMAP_OFFSET, TMAP_MOMENT_BIAS and TMAP_PLANE. Maps of six faces take
   tmap_project_to_cube instead of tmap_project. */

#ifndef TMAP_INCLUDED
#define TMAP_INCLUDED

#ifndef TMAP_FUNCTION /* a shading language */
#define TMAP_FUNCTION
#define TMAP_ARRAYS
#define tmap_float     float
#define tmap_int       int
#define tmap_bool      bool
#define tmap_clamp     clamp
#define tmap_clamp_int clamp
#define fminf          min
#define fmaxf          max
#define fabsf          abs
#define floorf         floor
#define sqrtf          sqrt
#define sinf           sin
#define cosf           cos
#define expf           exp
#define logf           log
#ifndef TMAP_HLSL
#define tmap_vec2 vec2
#define tmap_vec3 vec3
#define tmap_vec4 vec4
#define tmap_mix  mix
#ifdef GL_ES
precision highp float;
precision highp int;
#ifdef TMAP_TEXTURE
precision highp sampler2DArray;
#endif
#endif
#endif
#endif

/* The numbers of sps_tmap_technique. */
#define TMAP_DEEP         1
#define TMAP_COMPRESSED   2
#define TMAP_OPACITY      3
#define TMAP_DEEP_OPACITY 4
#define TMAP_FOURIER      5
#define TMAP_MOMENT       6
#define TMAP_BEER         7
#define TMAP_DEPTH        9

/* What has to be known about a map, in the layout of a std140 block and of a constant buffer: sps_tmap_get_constants
   fills the same 128 bytes. */
struct tmap {
    tmap_vec4 row_x, row_y, row_w, row_distance; /* of sps_tmap_get_projection's matrix; a cube map needs none */
    int technique_id, components;
    int has_range;  /* 1: a deep opacity or Beer map, or texel_range is set */
    int has_planes; /* 1: planes is not NULL */
    int cubic;
    int has_surfaces;  /* 1: sps_tmap_surfaces is not NULL */
    int width, height; /* texels of a face, including its border */
    float near_depth, far_depth;
    float bias, bias_per_distance; /* of surfaces */
    int face, face_count;          /* the face that the rows are for */
    int has_fronts;                /* 1: sps_tmap_fronts is not NULL */
    int border;                    /* texels at each edge that lie outside the view */
    TMAP_ARRAYS
};

#ifdef TMAP_TEXTURE
/* Layers of a face at most, of four numbers each, fronts included; up to 17. Compilers take long over many. */
#ifndef TMAP_LAYERS
#define TMAP_LAYERS 3
#endif

/* The members of sps_export_constants. */
struct tmap_format {
    int components, columns;
    float moment_bias;
    int padding;
    tmap_vec4 scale[17], offset[17];
};

/* An engine that binds textures in its own way defines TMAP_FETCH and all that follow it here. */
#if !defined(TMAP_FETCH) || defined(TMAP_HLSL_BLOCK)
#ifndef TMAP_HLSL
#ifndef TMAP_GAS_BINDING
#define TMAP_GAS_BINDING     0
#define TMAP_SURFACE_BINDING 1
#define TMAP_BLOCK_BINDING   2
#endif
#ifndef TMAP_SET
#define TMAP_SET 0
#endif
#ifdef VULKAN
#define TMAP_LAYOUT(n) layout(set = TMAP_SET, binding = n)
#define TMAP_BLOCK     layout(std140, set = TMAP_SET, binding = TMAP_BLOCK_BINDING) uniform tmap_block
#elif __VERSION__ >= 420 || (defined(GL_ES) && __VERSION__ >= 310)
#define TMAP_LAYOUT(n) layout(binding = n)
#define TMAP_BLOCK     layout(std140, binding = TMAP_BLOCK_BINDING) uniform tmap_block
#else /* the program binds them by name */
#define TMAP_LAYOUT(n)
#define TMAP_BLOCK layout(std140) uniform tmap_block
#endif
TMAP_LAYOUT(TMAP_GAS_BINDING) uniform sampler2DArray tmap_gas;
TMAP_LAYOUT(TMAP_SURFACE_BINDING) uniform sampler2DArray tmap_surfaces;
#define TMAP_FETCH(map, column, row, layer)         texelFetch(tmap_gas, ivec3(column, row, layer), 0)
#define TMAP_FETCH_SURFACE(map, column, row, layer) texelFetch(tmap_surfaces, ivec3(column, row, layer), 0).x
#define TMAP_SAMPLE(map, s, t, layer)               textureLod(tmap_gas, vec3(s, t, layer), 0.0)
#endif
TMAP_BLOCK {
    tmap tmap_bound;
    tmap_format tmap_bound_format;
#ifdef TMAP_PLANES /* of the settings */
    tmap_vec4 tmap_bound_planes[17];
#endif
};
#define TMAP_SCALE(map, i)       tmap_bound_format.scale[i]
#define TMAP_OFFSET(map, i)      tmap_bound_format.offset[i]
#define TMAP_MOMENT_BIAS(map, n) tmap_bound_format.moment_bias
#ifdef TMAP_PLANES
#define TMAP_PLANE(map, i) tmap_bound_planes[(i) / 4][(i) % 4]
#else
#define TMAP_PLANE(map, i) 0.0f
#endif
#endif

/* The texel that is evaluated. */
#ifndef TMAP_TEXEL
#ifdef TMAP_HLSL
static float4 tmap_loaded[TMAP_LAYERS];
#else
vec4 tmap_loaded[TMAP_LAYERS];
#endif
#define TMAP_TEXEL(map, i)   tmap_loaded[(i) / 4][(i) % 4]
#define TMAP_KEEP(map, i, v) tmap_loaded[i] = v
#endif
#define TMAP_FRONT(map, i) TMAP_TEXEL(map, (map).components)
#endif

#ifndef TMAP_TEXEL
#ifndef TMAP_HLSL
layout(std430, binding = 0) readonly buffer tmap_texel_buffer { float tmap_texels[]; };
layout(std430, binding = 1) readonly buffer tmap_surface_buffer { float tmap_surfaces[]; };
layout(std430, binding = 2) readonly buffer tmap_plane_buffer { float tmap_planes[]; };
layout(std430, binding = 3) readonly buffer tmap_start_buffer { uint tmap_starts[]; };
layout(std430, binding = 5) readonly buffer tmap_front_buffer { float tmap_fronts[]; };
layout(std140, binding = 4) uniform tmap_block { tmap tmap_bound; };
#endif
#define TMAP_TEXEL(map, i)   tmap_texels[i]
#define TMAP_SURFACE(map, i) tmap_surfaces[i]
#define TMAP_PLANE(map, i)   tmap_planes[i]
#define TMAP_START(map, i)   tmap_starts[i]
#define TMAP_FRONT(map, i)   tmap_fronts[i]
#endif

/* Moments in a narrower format need more: sps_export_constants has it. */
#ifndef TMAP_MOMENT_BIAS
#define TMAP_MOMENT_BIAS(map, n) ((n) == 5 ? 5e-7f : 5e-6f)
#endif

/* Throughout, `first` is the index of a texel's first float, n the number of its floats, and u the depth: 0 at
   near_depth, 1 at far_depth. A function *_depth returns the optical depth before u. */

/* Between two planes, as the library has it: stored depths may fall, if they were rounded. */
TMAP_FUNCTION float tmap_between(float depth, float before, float after) { return fmaxf(fminf(depth, after), before); }

/* Opacity: planes at u = 1 / n, 2 / n .. 1, straight lines between them. */
TMAP_FUNCTION float tmap_even_planes_depth(tmap map, int first, int n, float u) {
    float at = u * tmap_float(n);
    int plane = tmap_clamp_int(tmap_int(at), 0, n - 1);
    float before = plane > 0 ? TMAP_TEXEL(map, first + plane - 1) : 0.0f;
    float after = TMAP_TEXEL(map, first + plane);
    return tmap_between(tmap_mix(before, after, at - tmap_float(plane)), before, after);
}

/* Returns u and optical depth of plane i. Plane -1 is u = 0, and nothing lies before it. */
TMAP_FUNCTION tmap_vec2 tmap_knot(tmap map, int first, int n, int i) {
    tmap_vec2 knot;
    int plane = tmap_clamp_int(i, 0, n - 1);
    knot.x = i < 0 ? 0.0f : map.has_planes != 0 ? TMAP_PLANE(map, plane) : tmap_float(plane + 1) / tmap_float(n);
    knot.y = i < 0 ? 0.0f : TMAP_TEXEL(map, first + plane);
    return knot;
}

/* Returns the first plane at or behind u. */
TMAP_FUNCTION int tmap_next_plane(tmap map, int first, int n, float u) {
    int i = 0;
    while (i < n - 1 && tmap_knot(map, first, n, i).x < u) ++i;
    return i;
}

/* Opacity: planes where the caller put them, straight lines between them. */
TMAP_FUNCTION float tmap_planes_depth(tmap map, int first, int n, float u) {
    int i = tmap_next_plane(map, first, n, u);
    tmap_vec2 a = tmap_knot(map, first, n, i - 1);
    tmap_vec2 b = tmap_knot(map, first, n, i);
    return tmap_between(tmap_mix(a.y, b.y, tmap_clamp((u - a.x) / (b.x - a.x), 0.0f, 1.0f)), a.y, b.y);
}

TMAP_FUNCTION float tmap_secant(tmap_vec2 a, tmap_vec2 b) { return (b.y - a.y) / (b.x - a.x); }

/* Slopes of a curve through a, b, c that never falls: at b, and at a. [Steffen 1990] */
TMAP_FUNCTION float tmap_inner_slope(tmap_vec2 a, tmap_vec2 b, tmap_vec2 c) {
    float before = tmap_secant(a, b), after = tmap_secant(b, c);
    float parabola = (before * (c.x - b.x) + after * (b.x - a.x)) / (c.x - a.x);
    return 2.0f * fminf(fminf(before, after), 0.5f * parabola);
}

TMAP_FUNCTION float tmap_end_slope(tmap_vec2 a, tmap_vec2 b, tmap_vec2 c) {
    float part = (b.x - a.x) / (c.x - a.x);
    float slope = tmap_secant(a, b) * (1.0f + part) - tmap_secant(b, c) * part;
    return fmaxf(fminf(slope, 2.0f * tmap_secant(a, b)), 0.0f);
}

/* Opacity: any planes, monotone cubics between them. */
TMAP_FUNCTION float tmap_cubic_depth(tmap map, int first, int n, float u) {
    int i = tmap_next_plane(map, first, n, u);
    tmap_vec2 a = tmap_knot(map, first, n, i - 2);
    tmap_vec2 b = tmap_knot(map, first, n, i - 1);
    tmap_vec2 c = tmap_knot(map, first, n, i);
    tmap_vec2 d = tmap_knot(map, first, n, i + 1);
    float even = tmap_secant(b, c), t = tmap_clamp((u - b.x) / (c.x - b.x), 0.0f, 1.0f);
    float slope0 = i > 0 ? tmap_inner_slope(a, b, c) : i < n - 1 ? tmap_end_slope(b, c, d) : even;
    float slope1 = i < n - 1 ? tmap_inner_slope(b, c, d) : i > 0 ? tmap_end_slope(c, b, a) : even;
    float bend = (1.0f - t) * (slope0 - even) - t * (slope1 - even);
    return tmap_between(tmap_mix(b.y, c.y, t) + t * (1.0f - t) * (c.x - b.x) * bend, b.y, c.y);
}

/* Fourier series of extinction, integrated up to u: no less than nothing and no more than all. */
TMAP_FUNCTION float tmap_fourier_depth(tmap map, int first, int n, float u) {
    float whole = 0.5f * TMAP_TEXEL(map, first), sum = whole * u;
    for (int k = 1; 2 * k < n; ++k) {
        float w = 6.28318531f * tmap_float(k);
        float a = TMAP_TEXEL(map, first + 2 * k - 1), b = TMAP_TEXEL(map, first + 2 * k);
        sum += (a * sinf(w * u) + b * (1.0f - cosf(w * u))) / w;
    }
    return tmap_clamp(sum, 0.0f, whole);
}

#ifndef TMAP_TEXTURE
/* Nodes of u and transmittance, straight lines of transmittance between them: 1 before the first node, constant behind
   the last. */
TMAP_FUNCTION float tmap_nodes_depth(tmap map, int first, int count, float u) {
    int low = 0, high = count; /* bisects for the first node behind u */
    while (low < high) {
        int middle = (low + high) / 2;
        if (TMAP_TEXEL(map, first + 2 * middle) <= u)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == 0) return 0.0f;
    int after = first + 2 * tmap_clamp_int(low, 0, count - 1), before = first + 2 * (low - 1);
    float t = low < count ? (u - TMAP_TEXEL(map, before)) / (TMAP_TEXEL(map, after) - TMAP_TEXEL(map, before)) : 0.0f;
    float through = tmap_mix(TMAP_TEXEL(map, before + 1), TMAP_TEXEL(map, after + 1), t);
    return through > 0.0f ? -logf(fminf(through, 1.0f)) : 1e15f;
}

TMAP_FUNCTION float tmap_compressed_depth(tmap map, int texel, float u) {
    int first = tmap_int(TMAP_START(map, texel)), last = tmap_int(TMAP_START(map, texel + 1));
    return tmap_nodes_depth(map, 2 * first, last - first, u);
}

/* Deep: intervals of u0, u1, optical depth, softness. Softness 0 is an interval of constant extinction, 1 a whole chord
   through a soft particle, densest in its middle, and anything between the last part of such a chord. At u = 1
   everything counts, including what lies behind. */
TMAP_FUNCTION float tmap_deep_depth(tmap map, int texel, float u) {
    int first = 4 * tmap_int(TMAP_START(map, texel)), last = 4 * tmap_int(TMAP_START(map, texel + 1));
    float sum = 0.0f;
    for (int i = first; i < last && TMAP_TEXEL(map, i) <= u; i += 4) {
        float u0 = TMAP_TEXEL(map, i), u1 = TMAP_TEXEL(map, i + 1), soft = TMAP_TEXEL(map, i + 3);
        float s = u < fminf(u1, 1.0f) ? (u - u0) / (u1 - u0) : 1.0f;
        float bend = s * (6.0f * soft - 3.0f - 2.0f * soft * s) + 6.0f - 6.0f * soft;
        sum += TMAP_TEXEL(map, i + 2) * (soft > 0.0f ? s * bend / (3.0f - 2.0f * soft) : s);
    }
    return sum;
}
#endif

/* Moments leave a range of optical depths that may lie before u; the answer is its middle. Both ends of the range
   belong to the distribution of few points, one of them at u, that has the given moments [Muenstermann et al. 2018]. In
   floats transmittance is good to about 1e-3; the library works in double precision. */

/* Up to four numbers: values of polynomials, coefficients from the constant one on, or roots. */
struct tmap_numbers {
    int count;
    float x[4];
};

/* A lower triangular matrix of `size` rows; row i begins at 4 i. `least` is the least square on its diagonal. */
struct tmap_triangle {
    int size;
    float least;
    float x[16];
};

/* Moment k of the wide distribution that is mixed in to keep the matrix regular in spite of rounding. */
TMAP_FUNCTION float tmap_wide_moment(int n, int k) {
    if (k % 2 == 1) return 0.0f;
    if (n == 5) return 0.375f;
    return k == 2 ? 0.48f : k == 4 ? 0.451f : 0.45f;
}

/* Moment k, with a part of the wide distribution. */
TMAP_FUNCTION float tmap_biased_moment(tmap map, int first, int n, int k, float bias) {
    return k == 0 ? 1.0f : tmap_mix(tmap_clamp(TMAP_TEXEL(map, first + k), -1.0f, 1.0f), tmap_wide_moment(n, k), bias);
}

/* Cholesky factor of the matrix whose element i, j is moment i + j. */
TMAP_FUNCTION tmap_triangle tmap_biased_factor(tmap map, int first, int n, float bias) {
    tmap_triangle f;
    f.size = (n + 1) / 2;
    f.least = 1.0f;
    for (int i = 0; i < f.size; ++i)
        for (int j = 0; j <= i; ++j) {
            float sum = tmap_biased_moment(map, first, n, i + j, bias);
            for (int l = 0; l < j; ++l) sum -= f.x[4 * i + l] * f.x[4 * j + l];
            f.least = i == j ? fminf(f.least, sum) : f.least;
            f.x[4 * i + j] = i == j ? sqrtf(fmaxf(sum, 1e-7f)) : sum / f.x[4 * j + j];
        }
    return f;
}

/* Moments that no distribution has, since they were rounded, need more of the wide one. */
TMAP_FUNCTION tmap_triangle tmap_moment_factor(tmap map, int first, int n) {
    float bias = TMAP_MOMENT_BIAS(map, n);
    tmap_triangle f = tmap_biased_factor(map, first, n, bias);
    while (!(f.least > 0.0f) && bias < 1.0f) {
        bias = fminf(10.0f * bias, 1.0f);
        f = tmap_biased_factor(map, first, n, bias);
    }
    return f;
}

/* Values of the orthonormal polynomials at z. */
TMAP_FUNCTION tmap_numbers tmap_moment_polynomials(tmap_triangle f, float z) {
    tmap_numbers p;
    float power = 1.0f;
    p.count = f.size;
    for (int i = 0; i < f.size; ++i) {
        float sum = power;
        for (int k = 0; k < i; ++k) sum -= f.x[4 * i + k] * p.x[k];
        p.x[i] = sum / f.x[4 * i + i];
        power *= z;
    }
    return p;
}

/* The largest share that can lie at z. */
TMAP_FUNCTION float tmap_moment_weight(tmap_triangle f, float z) {
    tmap_numbers p = tmap_moment_polynomials(f, z);
    float sum = 0.0f;
    for (int i = 0; i < p.count; ++i) sum += p.x[i] * p.x[i];
    return 1.0f / sum;
}

/* The polynomial whose roots are the other points of the distribution that has its largest share at z. */
TMAP_FUNCTION tmap_numbers tmap_moment_kernel(tmap_triangle f, float z) {
    tmap_numbers c = tmap_moment_polynomials(f, z);
    for (int i = f.size - 1; i >= 0; --i) {
        for (int k = i + 1; k < f.size; ++k) c.x[i] -= f.x[4 * k + i] * c.x[k];
        c.x[i] /= f.x[4 * i + i];
    }
    return c;
}

TMAP_FUNCTION tmap_numbers tmap_derivative(tmap_numbers c) {
    c.count -= 1;
    for (int i = 0; i < c.count; ++i) c.x[i] = tmap_float(i + 1) * c.x[i + 1];
    return c;
}

TMAP_FUNCTION float tmap_polynomial(tmap_numbers c, float x) {
    float value = 0.0f;
    for (int i = c.count - 1; i >= 0; --i) value = value * x + c.x[i];
    return value;
}

/* Roots of a quadratic polynomial, the smaller one first, clamped to -100..100: those farther out have no weight. */
TMAP_FUNCTION tmap_numbers tmap_quadratic_roots(tmap_numbers c) {
    tmap_numbers roots;
    float root = sqrtf(fmaxf(c.x[1] * c.x[1] - 4.0f * c.x[0] * c.x[2], 0.0f));
    float q = -0.5f * (c.x[1] < 0.0f ? c.x[1] - root : c.x[1] + root);
    float a = fabsf(q) < 100.0f * fabsf(c.x[2]) ? q / c.x[2] : 100.0f;
    float b = fabsf(c.x[0]) < 100.0f * fabsf(q) ? c.x[0] / q : -100.0f;
    roots.count = 2;
    roots.x[0] = fminf(a, b);
    roots.x[1] = fmaxf(a, b);
    return roots;
}

/* The root between a and b, by Newton's method with bisection where a step leaves the bracket. */
TMAP_FUNCTION float tmap_root_between(tmap_numbers c, float a, float b) {
    tmap_numbers slope = tmap_derivative(c);
    float end = tmap_polynomial(c, b), x = 0.5f * (a + b);
    for (int i = 0; i < 32; ++i) {
        float value = tmap_polynomial(c, x), next = x - value / tmap_polynomial(slope, x);
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

/* Roots of a polynomial of degree 2 or 3, all real: the roots of its derivative separate those of a cubic. */
TMAP_FUNCTION tmap_numbers tmap_moment_roots(tmap_numbers c) {
    if (c.count == 3) return tmap_quadratic_roots(c);
    tmap_numbers roots, inner = tmap_quadratic_roots(tmap_derivative(c));
    roots.count = 3;
    roots.x[0] = tmap_root_between(c, -100.0f, inner.x[0]);
    roots.x[1] = tmap_root_between(c, inner.x[0], inner.x[1]);
    roots.x[2] = tmap_root_between(c, inner.x[1], 100.0f);
    return roots;
}

TMAP_FUNCTION float tmap_moment_depth(tmap map, int first, int n, float u) {
    float z = 2.0f * u - 1.0f, whole = TMAP_TEXEL(map, first);
    if (!(whole > 0.0f) || u >= 1.0f) return whole;
    tmap_triangle f = tmap_moment_factor(map, first, n);
    tmap_numbers roots = tmap_moment_roots(tmap_moment_kernel(f, z));
    float here = tmap_moment_weight(f, z), sum = here, before = 0.5f * here;
    for (int i = 0; i < roots.count; ++i) {
        float weight = tmap_moment_weight(f, roots.x[i]);
        sum += weight;
        before += roots.x[i] < z ? weight : 0.0f;
    }
    return whole * before / sum;
}

/* Optical depth of the gas before u in one texel. */
TMAP_FUNCTION float tmap_gas_depth(tmap map, int texel, float u) {
    int first = texel * map.components, n = map.components;
#ifndef TMAP_TEXTURE
    if (map.technique_id == TMAP_DEEP) return tmap_deep_depth(map, texel, u);
    if (map.technique_id == TMAP_COMPRESSED) return tmap_compressed_depth(map, texel, u);
#endif
    if (map.technique_id == TMAP_DEPTH) return 0.0f; /* it holds no gas */
    if (map.technique_id == TMAP_MOMENT) return tmap_moment_depth(map, first, n, u);
    if (map.has_range != 0) { /* from the texel's first occluder to its last */
        float begin = TMAP_TEXEL(map, first), end = TMAP_TEXEL(map, first + 1);
        if (u < begin) return 0.0f;
        u = end > begin ? fminf((u - begin) / (end - begin), 1.0f) : 1.0f;
        first += 2;
        n -= 2;
    }
    if (map.technique_id == TMAP_FOURIER) return tmap_fourier_depth(map, first, n, u);
    if (map.cubic != 0) return tmap_cubic_depth(map, first, n, u);
    return map.has_planes != 0 ? tmap_planes_depth(map, first, n, u) : tmap_even_planes_depth(map, first, n, u);
}

/* Where a point lies in the map. Texel centers are at integer x and y; distance is measured like near_depth. */
struct tmap_place {
    int face;
    float x, y, u, distance;
};

TMAP_FUNCTION float tmap_row_times(tmap_vec4 row, tmap_vec3 p) {
    return row.x * p.x + row.y * p.y + row.z * p.z + row.w;
}

/* A point in the space that the rows are for, which is world space unless the caller moved them. */
TMAP_FUNCTION tmap_place tmap_project(tmap map, tmap_vec3 position) {
    tmap_place p;
    float w = tmap_row_times(map.row_w, position);
    p.face = map.face;
    p.x = tmap_row_times(map.row_x, position) / w;
    p.y = tmap_row_times(map.row_y, position) / w;
    p.distance = tmap_row_times(map.row_distance, position);
    p.u = w > 0.0f ? (p.distance - map.near_depth) / (map.far_depth - map.near_depth) : -1.0f;
    return p;
}

/* The same for a cube map; `offset` is the point minus the light's position. */
TMAP_FUNCTION tmap_place tmap_project_to_cube(tmap map, tmap_vec3 offset) {
    tmap_place p;
    float x = fabsf(offset.x), y = fabsf(offset.y), z = fabsf(offset.z);
    int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    float along = axis == 0 ? offset.x : axis == 1 ? offset.y : offset.z;
    float right = axis == 0 ? offset.y : axis == 1 ? offset.z : offset.x;
    float down = axis == 0 ? offset.z : axis == 1 ? offset.x : offset.y;
    p.face = 2 * axis + (along < 0.0f ? 1 : 0);
    p.distance = fabsf(along);
    p.x = (0.5f + 0.5f * right / p.distance) * tmap_float(map.width - 1);
    p.y = (0.5f + 0.5f * down / p.distance) * tmap_float(map.height - 1);
    p.u = p.distance > 0.0f ? (p.distance - map.near_depth) / (map.far_depth - map.near_depth) : -1.0f;
    return p;
}

/* How many texels a place lies within the map's edges; negative outside. */
TMAP_FUNCTION float tmap_inside(tmap map, tmap_place p) {
    float right = tmap_float(map.width) - 1.0f, bottom = tmap_float(map.height) - 1.0f;
    return fminf(fminf(p.x, right - p.x), fminf(p.y, bottom - p.y)) - tmap_float(map.border) + 0.5f;
}

/* Fades to 0 at the map's edges, over some texels, and is 0 outside: the weight of this map's answer beside that of the
   next cascade, or 1. Six faces have no edges. */
TMAP_FUNCTION float tmap_fade(tmap map, tmap_place p, float texels) {
    if (!(p.u >= 0.0f)) return 0.0f;
    return map.face_count == 6 ? 1.0f : tmap_clamp(tmap_inside(map, p) / fmaxf(texels, 1e-6f), 0.0f, 1.0f);
}

/* The nearest place within the map, for points beside it that continue its edge. */
TMAP_FUNCTION tmap_place tmap_clamp_place(tmap map, tmap_place p) {
    float border = tmap_float(map.border);
    p.x = tmap_clamp(p.x, border, tmap_float(map.width) - 1.0f - border);
    p.y = tmap_clamp(p.y, border, tmap_float(map.height) - 1.0f - border);
    return p;
}

#ifdef TMAP_TEXTURE
/* What a texture holds, in the map's numbers. */
TMAP_FUNCTION tmap_vec4 tmap_decode(tmap_vec4 value, tmap_vec4 scale, tmap_vec4 offset) {
    value.x = offset.x + scale.x * value.x;
    value.y = offset.y + scale.y * value.y;
    value.z = offset.z + scale.z * value.z;
    value.w = offset.w + scale.w * value.w;
    return value;
}

/* Layers of a face. */
TMAP_FUNCTION int tmap_layers(tmap map) { return (map.components + map.has_fronts + 3) / 4; }

/* Loads a texel. C keeps it in the map. */
TMAP_FUNCTION tmap tmap_load(tmap map, int face, int x, int y) {
    int layers = tmap_layers(map);
    for (int i = 0; i < TMAP_LAYERS && i < layers; ++i) {
        tmap_vec4 value = TMAP_FETCH(map, x, y, face * layers + i);
        TMAP_KEEP(map, i, tmap_decode(value, TMAP_SCALE(map, i), TMAP_OFFSET(map, i)));
    }
    return map;
}

/* Loads a bilinear mean of texels. */
TMAP_FUNCTION tmap tmap_load_filtered(tmap map, tmap_place p) {
    int layers = tmap_layers(map);
    float s = (p.x + 0.5f) / tmap_float(map.width), t = (p.y + 0.5f) / tmap_float(map.height);
    for (int i = 0; i < TMAP_LAYERS && i < layers; ++i) {
        tmap_vec4 value = TMAP_SAMPLE(map, s, t, tmap_float(p.face * layers + i));
        TMAP_KEEP(map, i, tmap_decode(value, TMAP_SCALE(map, i), TMAP_OFFSET(map, i)));
    }
    return map;
}
#endif

/* One of the four texels around a place, moved into the map, and its weight. */
struct tmap_corner {
    int x, y;
    float weight;
};

TMAP_FUNCTION tmap_corner tmap_corner_at(tmap map, tmap_place p, int i) {
    tmap_corner corner;
    int x = tmap_int(floorf(p.x)) + i % 2, y = tmap_int(floorf(p.y)) + i / 2;
    corner.weight = (1.0f - fabsf(p.x - tmap_float(x))) * (1.0f - fabsf(p.y - tmap_float(y)));
    corner.x = tmap_clamp_int(x, 0, map.width - 1);
    corner.y = tmap_clamp_int(y, 0, map.height - 1);
    return corner;
}

/* Optical depth before u in one texel. */
TMAP_FUNCTION float tmap_corner_depth(tmap map, int face, tmap_corner corner, float u) {
#ifdef TMAP_TEXTURE
    int texel = 0;
    map = tmap_load(map, face, corner.x, corner.y);
#else
    int texel = (face * map.height + corner.y) * map.width + corner.x;
#endif
    return tmap_gas_depth(map, texel, u) + (map.has_fronts != 0 ? TMAP_FRONT(map, texel) : 0.0f);
}

/* 0: a texel's surface shades the place. */
TMAP_FUNCTION float tmap_corner_lit(tmap map, tmap_place p, tmap_corner corner) {
    float bias = (map.bias + map.bias_per_distance * p.distance) / (map.far_depth - map.near_depth);
    if (map.has_surfaces == 0) return 1.0f;
#ifdef TMAP_TEXTURE
    return TMAP_FETCH_SURFACE(map, corner.x, corner.y, p.face) + bias < p.u ? 0.0f : 1.0f;
#else
    int texel = (p.face * map.height + corner.y) * map.width + corner.x;
    return TMAP_SURFACE(map, texel) + bias < p.u ? 0.0f : 1.0f;
#endif
}

/* Outside of the map everything is lit. */
TMAP_FUNCTION tmap_bool tmap_is_outside(tmap map, tmap_place p) {
    return !(p.u >= 0.0f && tmap_inside(map, p) >= 0.0f);
}

/* The share of light that reaches a place. Interpolates the optical depths of four texels, not their contents, and
   compares with four surfaces before interpolating. */
TMAP_FUNCTION float tmap_transmittance(tmap map, tmap_place p) {
    float depth = 0.0f, lit = 0.0f;
    if (tmap_is_outside(map, p)) return 1.0f;
    for (int i = 0; i < 4; ++i) {
        tmap_corner corner = tmap_corner_at(map, p, i);
        depth += corner.weight * tmap_corner_depth(map, p.face, corner, fminf(p.u, 1.0f));
        lit += corner.weight * tmap_corner_lit(map, p, corner);
    }
    return lit * expf(-depth);
}

/* The same, but interpolates the light that reaches the place through each texel. */
TMAP_FUNCTION float tmap_mean_transmittance(tmap map, tmap_place p) {
    float mean = 0.0f;
    if (tmap_is_outside(map, p)) return 1.0f;
    for (int i = 0; i < 4; ++i) {
        tmap_corner corner = tmap_corner_at(map, p, i);
        float depth = tmap_corner_depth(map, p.face, corner, fminf(p.u, 1.0f));
        mean += corner.weight * tmap_corner_lit(map, p, corner) * expf(-depth);
    }
    return mean;
}

#ifdef TMAP_TEXTURE
/* The same by one look-up of filtered numbers. Surfaces are compared as above. */
TMAP_FUNCTION float tmap_filtered(tmap map, tmap_place p) {
    float lit = 0.0f;
    if (tmap_is_outside(map, p)) return 1.0f;
    for (int i = 0; i < 4; ++i) {
        tmap_corner corner = tmap_corner_at(map, p, i);
        lit += corner.weight * tmap_corner_lit(map, p, corner);
    }
    map = tmap_load_filtered(map, p);
    return lit * expf(-tmap_gas_depth(map, 0, fminf(p.u, 1.0f)) - (map.has_fronts != 0 ? TMAP_FRONT(map, 0) : 0.0f));
}
#endif

#endif
