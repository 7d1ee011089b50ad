/* transmittance_map.glsl as HLSL, shader model 5.0 or later:

       float light_left = tmap_transmittance(tmap_bound, tmap_project(tmap_bound, world_position));

   TMAP_REGISTER may be defined to move the registers, TMAP_TEXEL and its like to read from other buffers. With
   TMAP_TEXTURE defined it reads textures. */

#define TMAP_HLSL
#define tmap_vec2 float2
#define tmap_vec3 float3
#define tmap_vec4 float4
#define tmap_mix  lerp

#ifndef TMAP_REGISTER
#define TMAP_REGISTER(name) : register(name)
#endif

#ifdef TMAP_TEXTURE
#ifndef TMAP_FETCH
#define TMAP_HLSL_BLOCK
#define TMAP_BLOCK cbuffer tmap_block TMAP_REGISTER(b0)
Texture2DArray<float4> tmap_gas TMAP_REGISTER(t0);
Texture2DArray<float> tmap_surfaces TMAP_REGISTER(t1);
SamplerState tmap_sampler TMAP_REGISTER(s0); /* linear, clamped */
#define TMAP_FETCH(map, column, row, layer)         tmap_gas.Load(int4(column, row, layer, 0))
#define TMAP_FETCH_SURFACE(map, column, row, layer) tmap_surfaces.Load(int4(column, row, layer, 0))
#define TMAP_SAMPLE(map, s, t, layer)               tmap_gas.SampleLevel(tmap_sampler, float3(s, t, layer), 0.0f)
#endif
#elif !defined(TMAP_TEXEL)
#define TMAP_BINDS
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
