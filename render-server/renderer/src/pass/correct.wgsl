// From linear display light to the codes of one display: resampled along the warp mesh, mixed,
// weighted and encoded. `correct.rs` fills the uniforms.

// A plane's rows take a vector from the eye to its texels times w, and to w.
struct SourcePlane {
    across: vec4<f32>,
    down: vec4<f32>,
    depth: vec4<f32>,
    // Left, top, right and bottom, in texels.
    inner: vec4<f32>,
}

// Rows of affine maps; x, y, 1.
struct Eye {
    // From the mesh's origin.
    position: vec4<f32>,
    clip_x: vec4<f32>,
    clip_y: vec4<f32>,
    upright_x: vec4<f32>,
    upright_y: vec4<f32>,
}

// A plane that shows triangles of its own, for an eye of its own.
struct Cell {
    // From the mesh's origin.
    position: vec4<f32>,
    across: vec4<f32>,
    down: vec4<f32>,
    depth: vec4<f32>,
}

struct Correction {
    eyes: array<Eye, 2>,
    planes: array<SourcePlane, 12>,
    red: vec4<f32>,
    green: vec4<f32>,
    blue: vec4<f32>,
    // What the light map's numbers stand for; w is the factor's.
    light_scale: vec4<f32>,
    inverse_gamma: vec4<f32>,
    // Of red, green and blue: texels of the light map that all pixels have.
    even_weights: array<vec4<f32>, 3>,
    // Sides of one texel of the source, in its coordinates.
    texel: vec2<f32>,
    pad: vec2<f32>,
}

struct Corner {
    @builtin(position) clip: vec4<f32>,
    // From the eye; with one plane, already in its texels times w, which costs less here.
    @location(0) @interpolate(linear) ray: vec3<f32>,
}

@group(1) @binding(0) var source: texture_2d<f32>;
@group(1) @binding(1) var source_sampler: sampler;
@group(1) @binding(2) var<uniform> correction: Correction;
// Factor and addend, each as its lower and its upper byte: every driver reads such texels, and
// mixes none.
// A layer for all colours, or one each.
@group(1) @binding(3) var light_map: texture_2d_array<f32>;
@group(1) @binding(4) var<storage, read> codes: array<vec4<f32>>;
// Gives the texel that it is asked for, unmixed.
@group(1) @binding(5) var map_sampler: sampler;

// The left eye's, then as many of the right one.
@group(1) @binding(6) var<storage, read> cells: array<Cell>;

// The eye that is drawn; a constant, since uniforms at a place that varies are read slowly.
override EYE: u32 = 0u;
// There is no mesh: pixels are the source's.
override EXACT: bool = false;
override PLANES: u32 = 1u;
// Each draw is of one plane's own triangles: the number of planes, or 0.
override CELLS: u32 = 0u;
// Samples for each pixel, where the source is denser than the display.
override TAPS_ACROSS: u32 = 1u;
override TAPS_DOWN: u32 = 1u;
override COLORED: bool = false;
override WEIGHTED: bool = false;
// All pixels that are drawn have the same weights.
override EVEN: bool = false;
// Red, green and blue have weights of their own.
override TINTED: bool = false;
// Of the upright picture, in pixels.
override WIDTH: f32 = 1.0;
override HEIGHT: f32 = 1.0;
// 0 sRGB, 1 a power, 2 measured.
override CURVE: u32 = 0u;
override DITHERED: bool = false;
override CHANNEL: u32 = 0u;
// The display's largest code.
override CODES: f32 = 255.0;
// The target encodes what it is given as sRGB.
override ENCODES: bool = false;

@vertex
fn corner(
    @location(0) pixel: vec2<f32>,
    @location(1) point: vec3<f32>,
    @builtin(instance_index) cell_index: u32,
) -> Corner {
    let eye = correction.eyes[EYE];
    let at = vec3<f32>(pixel, 1.0);
    var out: Corner;
    out.clip = vec4<f32>(dot(eye.clip_x.xyz, at), dot(eye.clip_y.xyz, at), 0.0, 1.0);
    out.ray = point - eye.position.xyz;
    if CELLS > 0u {
        let cell = cells[EYE * CELLS + cell_index];
        let ray = point - cell.position.xyz;
        let across = dot(cell.across.xyz, ray);
        out.ray = vec3<f32>(across, dot(cell.down.xyz, ray), dot(cell.depth.xyz, ray));
    } else if PLANES == 1u {
        out.ray = texels(correction.planes[EYE * 6u], out.ray);
    }
    return out;
}

fn texels(plane: SourcePlane, ray: vec3<f32>) -> vec3<f32> {
    let across = dot(plane.across.xyz, ray);
    return vec3<f32>(across, dot(plane.down.xyz, ray), dot(plane.depth.xyz, ray));
}

// The light that a ray from the eye sees; `right` and `below` are how it differs in the next
// pixels.
fn light_along(ray: vec3<f32>, right: vec3<f32>, below: vec3<f32>) -> vec3<f32> {
    var at = ray;
    var step_right = right;
    var step_below = below;
    if PLANES > 1u {
        var chosen = EYE * 6u;
        for (var i = 0u; i < PLANES; i++) {
            let plane = correction.planes[EYE * 6u + i];
            let h = texels(plane, ray);
            let is_inside = all(h.xy >= plane.inner.xy * h.z) && all(h.xy <= plane.inner.zw * h.z);
            if h.z > 0.0 && is_inside {
                chosen = EYE * 6u + i;
                break;
            }
        }
        at = texels(correction.planes[chosen], ray);
        step_right = texels(correction.planes[chosen], right);
        step_below = texels(correction.planes[chosen], below);
    }
    let inverse = 1.0 / at.z;
    let middle = at.xy * inverse * correction.texel;
    if TAPS_ACROSS * TAPS_DOWN == 1u {
        return textureSampleLevel(source, source_sampler, middle, 0.0).rgb;
    }
    // The pixel's footprint: the derivative of a quotient.
    let scale = correction.texel * inverse;
    let width = step_right.xy * scale - middle * (step_right.z * inverse);
    let height = step_below.xy * scale - middle * (step_below.z * inverse);
    var sum = vec3<f32>(0.0);
    for (var j = 0u; j < TAPS_DOWN; j++) {
        for (var i = 0u; i < TAPS_ACROSS; i++) {
            let x = (f32(i) + 0.5) / f32(TAPS_ACROSS) - 0.5;
            let y = (f32(j) + 0.5) / f32(TAPS_DOWN) - 0.5;
            let place = middle + width * x + height * y;
            sum += textureSampleLevel(source, source_sampler, place, 0.0).rgb;
        }
    }
    return sum / f32(TAPS_ACROSS * TAPS_DOWN);
}

fn encode(light: vec3<f32>) -> vec3<f32> {
    if CURVE == 0u {
        // IEC 61966-2-1, 1.055 x^(1/2.4) - 0.055, as a polynomial of x^(1/4) that is off by
        // 0.0017 codes of 255 at most; two roots cost a software driver less than a power.
        let t = sqrt(sqrt(light));
        let high = (-0.06814659 * t + 0.28953081) * t - 0.57748017;
        let curved = ((high * t + 1.255403) * t + 0.16202663) * t - 0.06134025;
        return select(curved, light * 12.92, light <= vec3<f32>(0.0031308));
    }
    if CURVE == 1u {
        let curved = pow(max(light, vec3<f32>(1e-12)), correction.inverse_gamma.xyz);
        return select(curved, vec3<f32>(0.0), light <= vec3<f32>(0.0));
    }
    // Entry i is the code of (i / last)².
    let last = arrayLength(&codes) - 1u;
    let at = sqrt(clamp(light, vec3<f32>(0.0), vec3<f32>(1.0))) * f32(last);
    let low = min(vec3<u32>(at), vec3<u32>(last - 1u));
    let below = vec3<f32>(codes[low.x].x, codes[low.y].y, codes[low.z].z);
    let above = vec3<f32>(codes[low.x + 1u].x, codes[low.y + 1u].y, codes[low.z + 1u].z);
    return mix(below, above, at - vec3<f32>(low));
}

// Three numbers from −½ to ½ that depend on the pixel and the channel: ten bits each of a hash
// with two multiplications, C. Wellons, Prospecting for Hash Functions, 2018 (lowbias32).
fn noise(pixel: vec2<u32>) -> vec3<f32> {
    var v = (pixel.x | (pixel.y << 16u)) ^ (CHANNEL * 0x9e3779b9u);
    v = (v ^ (v >> 16u)) * 0x7feb352du;
    v = (v ^ (v >> 15u)) * 0x846ca68bu;
    v = v ^ (v >> 16u);
    // Signed, which is quicker to convert.
    let parts = vec3<i32>(vec3<u32>(v, v >> 10u, v >> 20u) & vec3<u32>(1023u));
    return (vec3<f32>(parts) + 0.5) / 1024.0 - 0.5;
}

// Factor and addend of a layer of the light map.
fn weight_at(place: vec2<f32>, layer: i32) -> vec2<f32> {
    var bytes = correction.even_weights[layer];
    if !EVEN {
        bytes = textureSampleLevel(light_map, map_sampler, place, layer, 0.0);
    }
    return (bytes.xz + 256.0 * bytes.yw) / 257.0;
}

@fragment
fn correct(in: Corner) -> @location(0) vec4<f32> {
    let eye = correction.eyes[EYE];
    let frame = vec3<f32>(in.clip.xy, 1.0);
    let pixel = vec2<f32>(dot(eye.upright_x.xyz, frame), dot(eye.upright_y.xyz, frame));
    var light = vec3<f32>(0.0);
    if EXACT {
        let corner = vec2<i32>(correction.planes[EYE * 6u].inner.xy);
        light = textureLoad(source, corner + vec2<i32>(pixel), 0).rgb;
    } else {
        light = light_along(in.ray, dpdx(in.ray), dpdy(in.ray));
    }
    if COLORED {
        let red = dot(correction.red.xyz, light);
        let green = dot(correction.green.xyz, light);
        light = vec3<f32>(red, green, dot(correction.blue.xyz, light));
    }
    light = clamp(light, vec3<f32>(0.0), vec3<f32>(1.0));
    if WEIGHTED {
        let place = pixel / vec2<f32>(WIDTH, HEIGHT);
        let red = weight_at(place, 0);
        var factor = red.xxx;
        var addend = red.yyy;
        if TINTED {
            let green = weight_at(place, 1);
            let blue = weight_at(place, 2);
            factor = vec3<f32>(red.x, green.x, blue.x);
            addend = vec3<f32>(red.y, green.y, blue.y);
        }
        light = light * (factor * correction.light_scale.w)
            + addend * correction.light_scale.xyz;
    }
    var code = encode(light);
    if DITHERED {
        code += noise(vec2<u32>(in.clip.xy)) / CODES;
    }
    if CODES > 255.0 {
        // Some drivers round codes of ten bits down: a quarter more is no other code to any.
        code = (floor(code * CODES + 0.5) + 0.25) / CODES;
    }
    if ENCODES {
        let code = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0));
        let curved = pow((code + 0.055) / 1.055, vec3<f32>(2.4));
        return vec4<f32>(select(curved, code / 12.92, code <= vec3<f32>(0.04045)), 1.0);
    }
    return vec4<f32>(code, 1.0);
}
