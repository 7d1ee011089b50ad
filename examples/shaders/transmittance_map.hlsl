/* transmittance_map.glsl as HLSL, shader model 5.0 or later:

       float light_left = tmap_transmittance(tmap_bound, tmap_project(tmap_bound, world_position));

   TMAP_REGISTER may be defined to move the registers, TMAP_TEXEL and its like to read from other buffers. */

#define TMAP_HLSL
#define tmap_vec2 float2
#define tmap_vec3 float3
#define tmap_vec4 float4
#define tmap_mix  lerp

#ifndef TMAP_TEXEL
#define TMAP_BINDS
#ifndef TMAP_REGISTER
#define TMAP_REGISTER(name) : register(name)
#endif
StructuredBuffer<float> tmap_texels TMAP_REGISTER(t0);
StructuredBuffer<float> tmap_surfaces TMAP_REGISTER(t1);
StructuredBuffer<float> tmap_planes TMAP_REGISTER(t2);
StructuredBuffer<uint> tmap_starts TMAP_REGISTER(t3);
StructuredBuffer<float> tmap_fronts TMAP_REGISTER(t4);
#endif

#include "transmittance_map.glsl"

#ifdef TMAP_BINDS
cbuffer tmap_block TMAP_REGISTER(b0) { tmap tmap_bound; };
#endif
