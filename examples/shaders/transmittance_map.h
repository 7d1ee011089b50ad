/* transmittance_map.glsl as C99 or C++, for programs that look maps up on the CPU without the library. With the library
   there is sps_tmap_query.

       tmap map;
       memcpy(&map, &constants, sizeof constants); // of sps_tmap_constants, 128 bytes
       map.texels = texels, map.surfaces = surfaces, map.fronts = NULL, map.planes = NULL, map.starts = NULL;
       float light_left = tmap_transmittance(map, tmap_project(map, position));

   The arrays are those of sps_tmap_texels, sps_tmap_surfaces, sps_tmap_fronts, the settings' planes, and sps_tmap_starts;
   they stay the caller's, and are NULL where the map has none. All functions are static and pure, so that any number of threads may
   look up any number of maps. */

#ifndef TRANSMITTANCE_MAP_H
#define TRANSMITTANCE_MAP_H
#include <math.h>
#include <stdint.h>

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

static inline float tmap_mix(float a, float b, float t) { return a + t * (b - a); }
static inline float tmap_clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }
static inline int tmap_clamp_int(int x, int low, int high) { return x < low ? low : x > high ? high : x; }

#define TMAP_FUNCTION static inline
#define TMAP_ARRAYS                                                                                                    \
    const float *texels, *surfaces, *fronts, *planes;                                                                  \
    const uint32_t *starts;
#define TMAP_TEXEL(map, i)   (map).texels[i]
#define TMAP_SURFACE(map, i) (map).surfaces[i]
#define TMAP_PLANE(map, i)   (map).planes[i]
#define TMAP_START(map, i)   (map).starts[i]
#define TMAP_FRONT(map, i)   (map).fronts[i]
#define tmap_float(x)        ((float)(x))
#define tmap_int(x)          ((int)(x))
#include "transmittance_map.glsl"

#endif
