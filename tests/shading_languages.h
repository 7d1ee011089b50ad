/* examples/shaders/transmittance_map.glsl, or .hlsl, compiled as C++ and run on the CPU: defines the types and
   functions of these languages that C++ lacks, so that the files are included unchanged, bindings too. This is the only
   part of the tests that is not C. SAMPLING_HLSL selects HLSL. */

#ifndef SHADING_LANGUAGES_H
#define SHADING_LANGUAGES_H

namespace shading {
typedef uint32_t uint;

struct vec2 {
    float x, y;
};

struct vec3 {
    float x, y, z;
};

struct vec4 {
    float x, y, z, w;
};

typedef vec2 float2;
typedef vec3 float3;
typedef vec4 float4;

/* No more than these languages have: for integers, only clamp is used. */
inline float min(float a, float b) { return ::fminf(a, b); }
inline float max(float a, float b) { return ::fmaxf(a, b); }
inline float abs(float x) { return ::fabsf(x); }
inline float floor(float x) { return ::floorf(x); }
inline float sqrt(float x) { return ::sqrtf(x); }
inline float sin(float x) { return ::sinf(x); }
inline float cos(float x) { return ::cosf(x); }
inline float exp(float x) { return ::expf(x); }
inline float log(float x) { return ::logf(x); }
inline float clamp(float x, float low, float high) { return min(max(x, low), high); }
inline int clamp(int x, int low, int high) { return x < low ? low : x > high ? high : x; }

#ifdef SAMPLING_HLSL

inline float lerp(float a, float b, float t) { return a + t * (b - a); }

template <class T> struct StructuredBuffer {
    const T *data;
    T operator[](int i) const { return data[i]; }
};

#define TMAP_REGISTER(name)
#define cbuffer inline namespace
#include "shaders/transmittance_map.hlsl"
#undef cbuffer

inline void bind(const float *texels, const float *others[3], const uint32_t *starts) {
    tmap_texels.data = texels, tmap_starts.data = starts;
    tmap_surfaces.data = others[0], tmap_fronts.data = others[1], tmap_planes.data = others[2];
}

#else

inline float mix(float a, float b, float t) { return a + t * (b - a); }

/* A block's members have file scope; an unsized array is a pointer. */
#define layout(...)
#define readonly
#define buffer        inline namespace
#define uniform       inline namespace
#define tmap_texels   (*tmap_texels)
#define tmap_surfaces (*tmap_surfaces)
#define tmap_planes   (*tmap_planes)
#define tmap_starts   (*tmap_starts)
#define tmap_fronts   (*tmap_fronts)
#include "shaders/transmittance_map.glsl"
#undef layout
#undef readonly
#undef buffer
#undef uniform
#undef tmap_texels
#undef tmap_surfaces
#undef tmap_planes
#undef tmap_starts
#undef tmap_fronts

inline void bind(const float *texels, const float *others[3], const uint32_t *starts) {
    tmap_texels = (float(*)[])texels, tmap_starts = (uint(*)[])starts;
    tmap_surfaces = (float(*)[])others[0], tmap_fronts = (float(*)[])others[1], tmap_planes = (float(*)[])others[2];
}

#endif

} // namespace shading

/* From here on these names are C's again. */
#undef fminf
#undef fmaxf
#undef fabsf
#undef floorf
#undef sqrtf
#undef sinf
#undef cosf
#undef expf
#undef logf
using namespace shading;

#endif
