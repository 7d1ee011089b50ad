// six_way.glsl in WGSL: shades a card of smoke by the two textures of `bake six-way --layout unity`. `light` is the
// unit vector from the card to a light:
//
//     let a = textureSample(map_a, linear_sampler, uv);
//     let b = textureSample(map_b, linear_sampler, uv);
//     let towards = vec3f(dot(light, card_right), dot(light, card_up), dot(light, card_towards_eye));
//     let radiance = irradiance * six_way_radiance(a, b, towards) / scale;

// Texture a has right, top, back; b has left, bottom, front. Back is where the light is behind the card.
fn six_way_radiance(a: vec4f, b: vec4f, towards: vec3f) -> f32 {
    let sides = select(vec3f(b.x, b.y, a.z), vec3f(a.x, a.y, b.z), towards > vec3f(0.0));
    return dot(sides, towards * towards);
}
