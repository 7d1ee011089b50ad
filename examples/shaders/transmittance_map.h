/* transmittance_map.glsl as C99 or C++, for programs that look maps up on the CPU without the library. With the library
   there is sps_tmap_query.

       tmap map;
       memcpy(&map, &constants, sizeof constants); // of sps_tmap_constants, 128 bytes
       map.texels = texels, map.surfaces = surfaces, map.fronts = NULL, map.planes = NULL, map.starts = NULL;
       float light_left = tmap_transmittance(map, tmap_project(map, position));

   The arrays are those of sps_tmap_texels, sps_tmap_surfaces, sps_tmap_fronts, the settings' planes, and
   sps_tmap_starts; they stay the caller's, and are NULL where the map has none. All functions are static and pure, so
   that any number of threads may look up any number of maps.

   With TMAP_TEXTURE defined it reads exported maps: `gas` and `surfaces` are then what hardware makes of a texture's
   numbers, four floats and one, and `format` is a copy of sps_export_constants. */

#ifndef TRANSMITTANCE_MAP_H
#define TRANSMITTANCE_MAP_H
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct tmap_vec2 {
    float x, y;
} tmap_vec2;

typedef struct tmap_vec3 {
    float x, y, z;
} tmap_vec3;

typedef struct tmap_vec4 {
    float x, y, z, w;
} tmap_vec4;

typedef struct tmap tmap;
typedef struct tmap_place tmap_place;
typedef struct tmap_numbers tmap_numbers;
typedef struct tmap_triangle tmap_triangle;
typedef struct tmap_corner tmap_corner;

static inline float tmap_mix(float a, float b, float t) { return a + t * (b - a); }
static inline float tmap_clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }
static inline int tmap_clamp_int(int x, int low, int high) { return x < low ? low : x > high ? high : x; }

#define TMAP_FUNCTION static inline
#define tmap_float(x) ((float)(x))
#define tmap_int(x)   ((int)(x))
#define tmap_bool     int

#ifdef TMAP_TEXTURE
#define TMAP_LAYERS 17
typedef struct tmap_format tmap_format;
#define TMAP_ARRAYS                                                                                                    \
    const float *gas, *surfaces, *planes;                                                                              \
    const tmap_format *format;                                                                                         \
    float loaded[4 * TMAP_LAYERS];
#define TMAP_TEXEL(map, i) (map).loaded[i]
#define TMAP_KEEP(map, i, v)                                                                                           \
    do {                                                                                                               \
        const tmap_vec4 kept = v;                                                                                      \
        memcpy((map).loaded + 4 * (i), &kept, sizeof kept);                                                            \
    } while (0)
#define TMAP_AT(map, x, y, layer)            (((layer) * (map).height + (y)) * (map).width + (x))
#define TMAP_FETCH(map, x, y, layer)         tmap_fetch((map).gas + 4 * TMAP_AT(map, x, y, layer))
#define TMAP_FETCH_SURFACE(map, x, y, layer) (map).surfaces[TMAP_AT(map, x, y, layer)]
#define TMAP_SAMPLE(map, s, t, layer)        tmap_sample((map).gas, (map).width, (map).height, s, t, layer)
#define TMAP_SCALE(map, i)                   (map).format->scale[i]
#define TMAP_OFFSET(map, i)                  (map).format->offset[i]
#define TMAP_MOMENT_BIAS(map, n)             (map).format->moment_bias
#define TMAP_PLANE(map, i)                   (map).planes[i]

static inline tmap_vec4 tmap_fetch(const float *from) {
    tmap_vec4 value;
    memcpy(&value, from, sizeof value);
    return value;
}

/* A linear filter that clamps to edges, at texture coordinates s and t. */
static inline tmap_vec4 tmap_sample(const float *gas, int width, int height, float s, float t, float layer) {
    const float x = s * tmap_float(width) - 0.5f, y = t * tmap_float(height) - 0.5f;
    float sum[4] = {0};
    for (int i = 0; i < 4; ++i) {
        const float at_x = floorf(x) + tmap_float(i % 2), at_y = floorf(y) + tmap_float(i / 2);
        const float weight = (1 - fabsf(x - at_x)) * (1 - fabsf(y - at_y));
        const int column = tmap_clamp_int(tmap_int(at_x), 0, width - 1);
        const int row = tmap_clamp_int(tmap_int(at_y), 0, height - 1);
        for (int k = 0; k < 4; ++k) sum[k] += weight * gas[4 * ((tmap_int(layer) * height + row) * width + column) + k];
    }
    return tmap_fetch(sum);
}
#else
#define TMAP_ARRAYS                                                                                                    \
    const float *texels, *surfaces, *fronts, *planes;                                                                  \
    const uint32_t *starts;
#define TMAP_TEXEL(map, i)   (map).texels[i]
#define TMAP_SURFACE(map, i) (map).surfaces[i]
#define TMAP_PLANE(map, i)   (map).planes[i]
#define TMAP_START(map, i)   (map).starts[i]
#define TMAP_FRONT(map, i)   (map).fronts[i]
#endif
#include "transmittance_map.glsl"

#endif
