// Reads transmittance maps that sps_tmap_export made, as transmittance_map.glsl does with TMAP_TEXTURE, which explains
// the formulas. Maps with `planes` are not read.
//
//     let place = tmap_project(world_position);
//     let light_left = mix(1.0, tmap_filtered(place), tmap_fade(place, 8.0));
//
// The map is in the layout SPS_EXPORT_ARRAY: a texture of 2D layers, surfaces as a second one. WebGPU filters halves
// and 8 bits; floats need the feature float32-filterable. Without it, leave out tmap_filtered and the sampler. The
// uniform buffer is the 128 bytes of sps_tmap_constants, then the 560 of sps_export_constants. The sampler is linear,
// and clamps. Groups and bindings of these four lines may be changed; TMAP_LAYERS is the number of layers of a face.

@group(0) @binding(0) var tmap_gas: texture_2d_array<f32>;
@group(0) @binding(1) var tmap_surfaces: texture_2d_array<f32>;
@group(0) @binding(2) var<uniform> tmap_bound: tmap_block;
@group(0) @binding(3) var tmap_sampler: sampler;

const TMAP_LAYERS: i32 = 3;

const TMAP_FOURIER: i32 = 5;
const TMAP_MOMENT: i32 = 6;
const TMAP_DEPTH: i32 = 9;

struct tmap_map {
    row_x: vec4f,
    row_y: vec4f,
    row_w: vec4f,
    row_distance: vec4f,
    technique_id: i32,
    components: i32,
    has_range: i32,
    has_planes: i32,
    cubic: i32,
    has_surfaces: i32,
    width: i32,
    height: i32,
    near_depth: f32,
    far_depth: f32,
    bias: f32,
    bias_per_distance: f32,
    face: i32,
    face_count: i32,
    has_fronts: i32,
    border: i32,
}

struct tmap_format {
    components: i32,
    columns: i32,
    moment_bias: f32,
    padding: i32,
    scale: array<vec4f, 17>,
    offset: array<vec4f, 17>,
}

struct tmap_block {
    map: tmap_map,
    format: tmap_format,
}

// The texel that is evaluated.
var<private> tmap_loaded: array<vec4f, TMAP_LAYERS>;

fn tmap_number(i: i32) -> f32 { return tmap_loaded[i / 4][i % 4]; }

fn tmap_between(depth: f32, before: f32, after: f32) -> f32 { return max(min(depth, after), before); }

// u and optical depth of plane i. Plane -1 is u = 0.
fn tmap_knot(first: i32, n: i32, i: i32) -> vec2f {
    let plane = clamp(i, 0, n - 1);
    if (i < 0) { return vec2f(0.0); }
    return vec2f(f32(plane + 1) / f32(n), tmap_number(first + plane));
}

fn tmap_planes_depth(first: i32, n: i32, u: f32) -> f32 {
    let at = u * f32(n);
    let plane = clamp(i32(at), 0, n - 1);
    let before = tmap_knot(first, n, plane - 1).y;
    let after = tmap_number(first + plane);
    return tmap_between(mix(before, after, at - f32(plane)), before, after);
}

fn tmap_secant(a: vec2f, b: vec2f) -> f32 { return (b.y - a.y) / (b.x - a.x); }

fn tmap_inner_slope(a: vec2f, b: vec2f, c: vec2f) -> f32 {
    let before = tmap_secant(a, b);
    let after = tmap_secant(b, c);
    let parabola = (before * (c.x - b.x) + after * (b.x - a.x)) / (c.x - a.x);
    return 2.0 * min(min(before, after), 0.5 * parabola);
}

fn tmap_end_slope(a: vec2f, b: vec2f, c: vec2f) -> f32 {
    let part = (b.x - a.x) / (c.x - a.x);
    let slope = tmap_secant(a, b) * (1.0 + part) - tmap_secant(b, c) * part;
    return max(min(slope, 2.0 * tmap_secant(a, b)), 0.0);
}

fn tmap_cubic_depth(first: i32, n: i32, u: f32) -> f32 {
    var i = 0;
    while (i < n - 1 && tmap_knot(first, n, i).x < u) { i += 1; }
    let a = tmap_knot(first, n, i - 2);
    let b = tmap_knot(first, n, i - 1);
    let c = tmap_knot(first, n, i);
    let d = tmap_knot(first, n, i + 1);
    let even = tmap_secant(b, c);
    let t = clamp((u - b.x) / (c.x - b.x), 0.0, 1.0);
    var slope0 = even;
    var slope1 = even;
    if (i > 0) { slope0 = tmap_inner_slope(a, b, c); } else if (i < n - 1) { slope0 = tmap_end_slope(b, c, d); }
    if (i < n - 1) { slope1 = tmap_inner_slope(b, c, d); } else if (i > 0) { slope1 = tmap_end_slope(c, b, a); }
    let bend = (1.0 - t) * (slope0 - even) - t * (slope1 - even);
    return tmap_between(mix(b.y, c.y, t) + t * (1.0 - t) * (c.x - b.x) * bend, b.y, c.y);
}

fn tmap_fourier_depth(first: i32, n: i32, u: f32) -> f32 {
    let whole = 0.5 * tmap_number(first);
    var sum = whole * u;
    for (var k = 1; 2 * k < n; k += 1) {
        let w = 6.28318531 * f32(k);
        sum += (tmap_number(first + 2 * k - 1) * sin(w * u) + tmap_number(first + 2 * k) * (1.0 - cos(w * u))) / w;
    }
    return max(min(sum, whole), 0.0);
}

// Row i of the lower triangular matrix; `least` is the least square on its diagonal.
struct tmap_triangle {
    size: i32,
    least: f32,
    rows: array<vec4f, 4>,
}

fn tmap_biased_moment(n: i32, k: i32, bias: f32) -> f32 {
    var wide = 0.0;
    if (k == 0) { return 1.0; }
    if (k % 2 == 0) { wide = select(select(0.45, select(0.451, 0.48, k == 2), k < 6), 0.375, n == 5); }
    return mix(clamp(tmap_number(k), -1.0, 1.0), wide, bias);
}

fn tmap_biased_factor(n: i32, bias: f32) -> tmap_triangle {
    var f: tmap_triangle;
    f.size = (n + 1) / 2;
    f.least = 1.0;
    for (var i = 0; i < f.size; i += 1) {
        for (var j = 0; j <= i; j += 1) {
            var sum = tmap_biased_moment(n, i + j, bias);
            for (var l = 0; l < j; l += 1) { sum -= f.rows[i][l] * f.rows[j][l]; }
            if (i == j) {
                f.least = min(f.least, sum);
                f.rows[i][j] = sqrt(max(sum, 1e-7));
            } else {
                f.rows[i][j] = sum / f.rows[j][j];
            }
        }
    }
    return f;
}

fn tmap_moment_factor(n: i32) -> tmap_triangle {
    var bias = tmap_bound.format.moment_bias;
    var f = tmap_biased_factor(n, bias);
    while (!(f.least > 0.0) && bias < 1.0) {
        bias = min(10.0 * bias, 1.0);
        f = tmap_biased_factor(n, bias);
    }
    return f;
}

// Older compilers index an array by a variable only where it is a variable itself; hence the copy.
fn tmap_moment_polynomials(factor: tmap_triangle, z: f32) -> vec4f {
    var f = factor;
    var p = vec4f(0.0);
    var power = 1.0;
    for (var i = 0; i < f.size; i += 1) {
        var sum = power;
        for (var k = 0; k < i; k += 1) { sum -= f.rows[i][k] * p[k]; }
        p[i] = sum / f.rows[i][i];
        power *= z;
    }
    return p;
}

fn tmap_moment_weight(f: tmap_triangle, z: f32) -> f32 {
    let p = tmap_moment_polynomials(f, z);
    return 1.0 / dot(p, p);
}

fn tmap_moment_kernel(factor: tmap_triangle, z: f32) -> vec4f {
    var f = factor;
    var c = tmap_moment_polynomials(f, z);
    for (var i = f.size - 1; i >= 0; i -= 1) {
        for (var k = i + 1; k < f.size; k += 1) { c[i] -= f.rows[k][i] * c[k]; }
        c[i] /= f.rows[i][i];
    }
    return c;
}

fn tmap_quadratic_roots(c: vec3f) -> vec2f {
    let root = sqrt(max(c.y * c.y - 4.0 * c.x * c.z, 0.0));
    let q = -0.5 * select(c.y + root, c.y - root, c.y < 0.0);
    var a = 100.0;
    var b = -100.0;
    if (abs(q) < 100.0 * abs(c.z)) { a = q / c.z; }
    if (abs(c.x) < 100.0 * abs(q)) { b = c.x / q; }
    return vec2f(min(a, b), max(a, b));
}

fn tmap_cubic(c: vec4f, x: f32) -> f32 { return ((c.w * x + c.z) * x + c.y) * x + c.x; }

fn tmap_root_between(c: vec4f, low: f32, high: f32) -> f32 {
    let end = tmap_cubic(c, high);
    var a = low;
    var b = high;
    var x = 0.5 * (a + b);
    for (var i = 0; i < 32; i += 1) {
        let value = tmap_cubic(c, x);
        var next = x - value / ((3.0 * c.w * x + 2.0 * c.z) * x + c.y);
        if (value * end > 0.0) { b = x; } else { a = x; }
        if (!(next > a && next < b)) { next = 0.5 * (a + b); }
        if (abs(next - x) < 1e-6) { return next; }
        x = next;
    }
    return x;
}

fn tmap_moment_depth(n: i32, u: f32) -> f32 {
    let z = 2.0 * u - 1.0;
    let whole = tmap_number(0);
    if (!(whole > 0.0) || u >= 1.0) { return whole; }
    let f = tmap_moment_factor(n);
    let c = tmap_moment_kernel(f, z);
    var roots = vec3f(tmap_quadratic_roots(c.xyz), 0.0);
    if (f.size == 4) {
        let inner = tmap_quadratic_roots(vec3f(c.y, 2.0 * c.z, 3.0 * c.w));
        roots = vec3f(tmap_root_between(c, -100.0, inner.x), tmap_root_between(c, inner.x, inner.y),
                      tmap_root_between(c, inner.y, 100.0));
    }
    let here = tmap_moment_weight(f, z);
    var sum = here;
    var before = 0.5 * here;
    for (var i = 0; i < f.size - 1; i += 1) {
        let weight = tmap_moment_weight(f, roots[i]);
        sum += weight;
        if (roots[i] < z) { before += weight; }
    }
    return whole * before / sum;
}

// Optical depth before u in the texel that is loaded, with its front.
fn tmap_gas_depth(depth: f32) -> f32 {
    let map = tmap_bound.map;
    var first = 0;
    var n = map.components;
    var u = depth;
    var front = 0.0;
    if (map.technique_id == TMAP_DEPTH) { return 0.0; }
    if (map.has_fronts != 0) { front = tmap_number(n); }
    if (map.technique_id == TMAP_MOMENT) { return front + tmap_moment_depth(n, u); }
    if (map.has_range != 0) {
        let begin = tmap_number(0);
        let end = tmap_number(1);
        if (u < begin) { return front; }
        if (end > begin) { u = min((u - begin) / (end - begin), 1.0); } else { u = 1.0; }
        first = 2;
        n -= 2;
    }
    if (map.technique_id == TMAP_FOURIER) { return front + tmap_fourier_depth(first, n, u); }
    if (map.cubic != 0) { return front + tmap_cubic_depth(first, n, u); }
    return front + tmap_planes_depth(first, n, u);
}

// Where a point lies in the map. Texel centers are at integer x and y; distance is measured like near_depth.
struct tmap_place {
    face: i32,
    x: f32,
    y: f32,
    u: f32,
    distance: f32,
}

fn tmap_u(distance: f32) -> f32 {
    let map = tmap_bound.map;
    return (distance - map.near_depth) / (map.far_depth - map.near_depth);
}

fn tmap_project(position: vec3f) -> tmap_place {
    let map = tmap_bound.map;
    let p = vec4f(position, 1.0);
    let w = dot(map.row_w, p);
    let distance = dot(map.row_distance, p);
    let u = select(-1.0, tmap_u(distance), w > 0.0);
    return tmap_place(map.face, dot(map.row_x, p) / w, dot(map.row_y, p) / w, u, distance);
}

// The same for six faces; `offset` is the point minus the light's position.
fn tmap_project_to_cube(offset: vec3f) -> tmap_place {
    let map = tmap_bound.map;
    let size = abs(offset);
    let axis = select(select(2, 1, size.y >= size.z), 0, size.x >= size.y && size.x >= size.z);
    let distance = size[axis];
    let x = (0.5 + 0.5 * offset[(axis + 1) % 3] / distance) * f32(map.width - 1);
    let y = (0.5 + 0.5 * offset[(axis + 2) % 3] / distance) * f32(map.height - 1);
    let u = select(-1.0, tmap_u(distance), distance > 0.0);
    return tmap_place(2 * axis + select(0, 1, offset[axis] < 0.0), x, y, u, distance);
}

fn tmap_inside(p: tmap_place) -> f32 {
    let map = tmap_bound.map;
    let right = f32(map.width) - 1.0 - p.x;
    let bottom = f32(map.height) - 1.0 - p.y;
    return min(min(p.x, right), min(p.y, bottom)) - f32(map.border) + 0.5;
}

fn tmap_is_outside(p: tmap_place) -> bool { return !(p.u >= 0.0 && tmap_inside(p) >= 0.0); }

// Fades to 0 at the map's edges, over some texels, and is 0 outside. Six faces have no edges.
fn tmap_fade(p: tmap_place, texels: f32) -> f32 {
    if (!(p.u >= 0.0)) { return 0.0; }
    if (tmap_bound.map.face_count == 6) { return 1.0; }
    return clamp(tmap_inside(p) / max(texels, 1e-6), 0.0, 1.0);
}

fn tmap_clamp_place(p: tmap_place) -> tmap_place {
    let map = tmap_bound.map;
    let border = f32(map.border);
    let x = clamp(p.x, border, f32(map.width) - 1.0 - border);
    let y = clamp(p.y, border, f32(map.height) - 1.0 - border);
    return tmap_place(p.face, x, y, p.u, p.distance);
}

fn tmap_layers() -> i32 { return (tmap_bound.map.components + tmap_bound.map.has_fronts + 3) / 4; }

fn tmap_load(p: tmap_place, corner: tmap_corner) {
    let layers = tmap_layers();
    for (var i = 0; i < TMAP_LAYERS && i < layers; i += 1) {
        let value = textureLoad(tmap_gas, vec2i(corner.x, corner.y), p.face * layers + i, 0);
        tmap_loaded[i] = tmap_bound.format.offset[i] + tmap_bound.format.scale[i] * value;
    }
}

fn tmap_load_filtered(p: tmap_place) {
    let layers = tmap_layers();
    let at = vec2f(p.x + 0.5, p.y + 0.5) / vec2f(f32(tmap_bound.map.width), f32(tmap_bound.map.height));
    for (var i = 0; i < TMAP_LAYERS && i < layers; i += 1) {
        let value = textureSampleLevel(tmap_gas, tmap_sampler, at, p.face * layers + i, 0.0);
        tmap_loaded[i] = tmap_bound.format.offset[i] + tmap_bound.format.scale[i] * value;
    }
}

// One of the four texels around a place, moved into the map, and its weight.
struct tmap_corner {
    x: i32,
    y: i32,
    weight: f32,
}

fn tmap_corner_at(p: tmap_place, i: i32) -> tmap_corner {
    let map = tmap_bound.map;
    let x = i32(floor(p.x)) + i % 2;
    let y = i32(floor(p.y)) + i / 2;
    let weight = (1.0 - abs(p.x - f32(x))) * (1.0 - abs(p.y - f32(y)));
    return tmap_corner(clamp(x, 0, map.width - 1), clamp(y, 0, map.height - 1), weight);
}

fn tmap_corner_lit(p: tmap_place, corner: tmap_corner) -> f32 {
    let map = tmap_bound.map;
    if (map.has_surfaces == 0) { return 1.0; }
    let bias = (map.bias + map.bias_per_distance * p.distance) / (map.far_depth - map.near_depth);
    let surface = textureLoad(tmap_surfaces, vec2i(corner.x, corner.y), p.face, 0).x;
    return select(1.0, 0.0, surface + bias < p.u);
}

// The share of light that reaches a place: four look-ups, mean of optical depths.
fn tmap_transmittance(p: tmap_place) -> f32 {
    var depth = 0.0;
    var lit = 0.0;
    if (tmap_is_outside(p)) { return 1.0; }
    for (var i = 0; i < 4; i += 1) {
        let corner = tmap_corner_at(p, i);
        tmap_load(p, corner);
        depth += corner.weight * tmap_gas_depth(min(p.u, 1.0));
        lit += corner.weight * tmap_corner_lit(p, corner);
    }
    return lit * exp(-depth);
}

// The same with the mean of transmittances.
fn tmap_mean_transmittance(p: tmap_place) -> f32 {
    var mean = 0.0;
    if (tmap_is_outside(p)) { return 1.0; }
    for (var i = 0; i < 4; i += 1) {
        let corner = tmap_corner_at(p, i);
        tmap_load(p, corner);
        mean += corner.weight * tmap_corner_lit(p, corner) * exp(-tmap_gas_depth(min(p.u, 1.0)));
    }
    return mean;
}

// The same by one look-up of filtered numbers.
fn tmap_filtered(p: tmap_place) -> f32 {
    var lit = 0.0;
    if (tmap_is_outside(p)) { return 1.0; }
    for (var i = 0; i < 4; i += 1) {
        let corner = tmap_corner_at(p, i);
        lit += corner.weight * tmap_corner_lit(p, corner);
    }
    tmap_load_filtered(p);
    return lit * exp(-tmap_gas_depth(min(p.u, 1.0)));
}
