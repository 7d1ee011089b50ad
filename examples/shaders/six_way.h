/* six_way.glsl as C99 or C++: the file itself, with its types. */

#ifndef SIX_WAY_H
#define SIX_WAY_H

typedef struct six_way_vec3 {
    float x, y, z;
} six_way_vec3;

typedef struct six_way_vec4 {
    float x, y, z, w;
} six_way_vec4;

#define SIX_WAY_FUNCTION static inline
#include "six_way.glsl"

#endif
