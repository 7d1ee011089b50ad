/* Shades a card of smoke by the two textures of `bake six-way --layout unity`. `light` is the unit vector from the card
   to a light:

       vec4 a = texture(map_a, uv), b = texture(map_b, uv);
       vec3 towards = vec3(dot(light, card_right), dot(light, card_up), dot(light, card_towards_eye));
       vec3 radiance = irradiance * six_way_radiance(a, b, towards) / scale;

   Add the radiance of all lights, and glow_color * b.w / scale. Blend by a.w, straight or premultiplied as it was
   baked.

   Squares of the direction's components weigh the three sides that face the light, as Unity and O3DE do. That is exact
   for a light on one side. In 26 directions, the rms error is 6 % of mean radiance for an isotropic cloud of optical
   depth 0.7. At 5.5 it is 22 %, or 18 % with multiple scattering. With a phase function of asymmetry 0.6 it is
   twice the mean: the glow around a light behind the card belongs to that direction only. tests/test_six_way.c has
   these figures.

   This file is GLSL (1.30, ES 3.00) without bindings; six_way.wgsl says the same in WGSL, and six_way.h in C. HLSL
   includes this file, too, after

       #define SIX_WAY_FUNCTION
       #define six_way_vec3 float3
       #define six_way_vec4 float4

 */

#ifndef SIX_WAY_INCLUDED
#define SIX_WAY_INCLUDED

#ifndef SIX_WAY_FUNCTION /* a shading language */
#define SIX_WAY_FUNCTION
#define six_way_vec3 vec3
#define six_way_vec4 vec4
#endif

/* Texture a has right, top, back; b has left, bottom, front. Back is where the light is behind the card. */
SIX_WAY_FUNCTION float six_way_radiance(six_way_vec4 a, six_way_vec4 b, six_way_vec3 towards) {
    float from_x = towards.x > 0.0f ? a.x : b.x;
    float from_y = towards.y > 0.0f ? a.y : b.y;
    float from_z = towards.z > 0.0f ? b.z : a.z;
    return from_x * towards.x * towards.x + from_y * towards.y * towards.y + from_z * towards.z * towards.z;
}

#endif
