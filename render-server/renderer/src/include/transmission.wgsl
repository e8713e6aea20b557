// KHR_materials_transmission, KHR_materials_volume and KHR_materials_dispersion: light from behind
// a surface, out of the pictures of `guarded_region.rs`. All lengths on the screen are in pixels,
// and none depends on what a channel shows.

struct Region {
    // The corner in pixels of the target, and in texels of the texture.
    corner: vec2<i32>,
    place: vec2<i32>,
    // In texels.
    size: vec2<i32>,
    // A texel is 2^scale pixels wide.
    scale: u32,
    // Pixels around each surface that are drawn; 0 for a region that is not there.
    reach: f32,
}

struct Behind {
    sharp: Region,
    wide: Region,
    // Pixels to a unit of normalized device coordinates, right and down.
    pixels: vec2<f32>,
    pixels_per_radian: f32,
    // Logarithm of the pixels of the coarsest texels.
    detail_max: f32,
    // What the sharp region can have: left, top, right, bottom in pixels of the target.
    bounds: vec4<f32>,
}

@group(0) @binding(24) var behind_texture: texture_2d<f32>;
@group(0) @binding(25) var<uniform> behind: Behind;

struct Passing {
    // Part of the light behind that passes.
    part: vec3<f32>,
    // Exposed light, and the part of it that is still to be mapped: see `display_light`.
    behind: vec4<f32>,
    // That part of the colour of the surface, once `outgoing` has it.
    light: f32,
}

var<private> passing: Passing;

// Reach of the sharp region less the filter of the coarsest level that is read of it.
const SHARP_OFFSET_MAX: f32 = 96.0;
const SHARP_DETAIL_MAX: f32 = 4.0;
// Twin of `LEVELS` in `guarded_region.rs`.
const COARSEST: f32 = 6.0;
// Angle of a texel of Khronos' sample viewer, whose picture has 1,024 in 45 degrees.
const VIEWER_TEXEL: f32 = 7.67e-4;
const VIEWER_LEVELS: f32 = 10.0;

// The part of a colour that is light, where so much of it is what displays show as it is. Sums of
// all three are compared: a bright reflection before something dark is light, however clear the
// surface is.
fn part_of_light(color: vec3<f32>, shown: vec3<f32>) -> f32 {
    let all = max(color.r + color.g + color.b, 1e-30);
    return 1.0 - clamp((shown.r + shown.g + shown.b) / all, 0.0, 1.0);
}

fn transmitted_part(texels: array<vec4<f32>, 6>) -> f32 {
    return extension.transmission.x * texels[TRANSMISSION].r;
}

fn behind_texel(region: Region, level: u32, cell: vec2<i32>) -> vec4<f32> {
    let shift = vec2<u32>(level);
    let last = max((region.size >> shift) - 1, vec2<i32>(0));
    let at = (region.place >> shift) + clamp(cell, vec2<i32>(0), last);
    return textureLoad(behind_texture, at, i32(level));
}

fn behind_row(region: Region, level: u32, cell: vec2<i32>, weights: vec3<f32>) -> vec4<f32> {
    return behind_texel(region, level, cell - vec2<i32>(1, 0)) * weights.x
        + behind_texel(region, level, cell) * weights.y
        + behind_texel(region, level, cell + vec2<i32>(1, 0)) * weights.z;
}

// A level at a pixel and an offset: whole texels are counted in integers, so that the weights are
// the same wherever a region begins. The finest level is read linearly, the others with a quadratic
// B-spline, which shows no texels.
fn behind_level(region: Region, level: u32, pixel: vec2<i32>, offset: vec2<f32>) -> vec4<f32> {
    let shift = vec2<u32>(region.scale + level);
    let away = pixel - region.corner;
    let whole = away >> shift;
    let rest = vec2<f32>(away - (whole << shift)) + 0.5 + offset;
    let place = rest / f32(1u << shift.x);
    let middle = floor(place);
    let f = place - middle - 0.5;
    let is_fine = level == 0u;
    let low = select(0.5 * (0.5 - f) * (0.5 - f), max(-f, vec2<f32>(0.0)), is_fine);
    let high = select(0.5 * (0.5 + f) * (0.5 + f), max(f, vec2<f32>(0.0)), is_fine);
    let center = 1.0 - low - high;
    let cell = whole + vec2<i32>(middle);
    let across = vec3<f32>(low.x, center.x, high.x);
    let below = vec2<i32>(0, 1);
    return behind_row(region, level, cell - below, across) * low.y
        + behind_row(region, level, cell, across) * center.y
        + behind_row(region, level, cell + below, across) * high.y;
}

// Light at an offset from a pixel, blurred to texels of 2^detail pixels. Filters reach four of
// them at most; what is farther away than is drawn around every surface is taken from there.
fn behind_at(pixel: vec2<i32>, wanted: vec2<f32>, detail: f32) -> vec4<f32> {
    let reach = max(behind.wide.reach - 4.0 * exp2(detail), 0.0);
    let offset = wanted * min(1.0, reach / max(length(wanted), 1e-6));
    let place = vec2<f32>(pixel) + 0.5 + offset;
    let filtered = 2.0 * exp2(SHARP_DETAIL_MAX);
    let is_outside = any(place < behind.bounds.xy + filtered)
        || any(place > behind.bounds.zw - filtered);
    let coarsest = min(f32(behind.wide.scale), SHARP_DETAIL_MAX);
    let blurred = smoothstep(coarsest - 1.0, coarsest, detail);
    let moved = smoothstep(0.5 * SHARP_OFFSET_MAX, SHARP_OFFSET_MAX, length(offset));
    let far = select(max(blurred, moved), 1.0, is_outside || behind.sharp.reach == 0.0);
    // Two levels of each region that counts. It is a loop because Mesa's software driver ends where
    // the shader becomes too long.
    let first = select(0u, 2u, far == 1.0);
    let end = select(4u, 2u, far == 0.0);
    var light = vec4<f32>(0.0);
    for (var at = first; at < end; at++) {
        var region = behind.sharp;
        var weight = 1.0 - far;
        if at >= 2u {
            region = behind.wide;
            weight = far;
        }
        let level = clamp(detail - f32(region.scale), 0.0, COARSEST);
        let lower = min(floor(level), COARSEST - 1.0);
        let upper = at & 1u;
        weight *= select(lower + 1.0 - level, level - lower, upper == 1u);
        if weight > 0.0 {
            light += behind_level(region, u32(lower) + upper, pixel, offset) * weight;
        }
    }
    return light;
}

// Logarithm of the pixels that texels have for a roughness as Khronos' sample viewer has it, or
// for offsets that press many pixels into one.
fn behind_detail(roughness: f32, offset: vec2<f32>) -> f32 {
    let rough = clamp(roughness * extension.absorption.w, 0.0, 1.0);
    let angle = VIEWER_TEXEL * (exp2(VIEWER_LEVELS * rough) - 1.0);
    let texel = angle * behind.pixels_per_radian;
    let across = dpdx(offset) + vec2<f32>(1.0, 0.0);
    let down = dpdy(offset) + vec2<f32>(0.0, 1.0);
    let pressed = max(max(dot(across, across), dot(down, down)), 1.0);
    return min(0.5 * log2(texel * texel + pressed), behind.detail_max);
}

// Pixels from a point to where its refracted ray leaves the volume.
fn refracted_offset(s: Surface, position: vec3<f32>, ratio: f32, way: f32) -> vec2<f32> { //? volume
    let along = refract(-s.toward_eye, s.normal, ratio); //? volume
    let enters = frame.clip_from_eye * vec4<f32>(position, 1.0); //? volume
    let leaves = frame.clip_from_eye * vec4<f32>(position + along * way, 1.0); //? volume
    // Behind the eye there is no place. //? volume
    let w = max(leaves.w, 0.01 * enters.w); //? volume
    return (leaves.xy / w - enters.xy / enters.w) * behind.pixels; //? volume
} //? volume

// Exposed light from behind, less what a volume absorbs.
fn light_behind(
    v: Varyings,
    s: Surface,
    roughness: f32,
    texels: array<vec4<f32>, 6>,
) -> vec4<f32> {
    let pixel = vec2<i32>(v.clip.xy);
    let still = vec2<f32>(0.0); //? !volume
    return behind_at(pixel, still, behind_detail(roughness, still)); //? !volume
    let way = extension.transmission.y * texels[THICKNESS].g * v.stretch; //? volume
    let ratio = extension.transmission.z; //? volume
    let position = position_of(v); //? volume
    let middle = refracted_offset(s, position, ratio, way); //? volume
    var light = behind_at(pixel, middle, behind_detail(roughness, middle)); //? volume
    // By `KHR_materials_dispersion`: 20 over the Abbe number, from blue to red. //? dispersion
    let spread = (1.0 / ratio - 1.0) * 0.025 * extension.transmission.w; //? dispersion
    let least = 1.0 / max(1.0 / ratio - spread, 1.0); //? dispersion
    let red = refracted_offset(s, position, least, way); //? dispersion
    let blue = refracted_offset(s, position, 1.0 / (1.0 / ratio + spread), way); //? dispersion
    light.r = behind_at(pixel, red, behind_detail(roughness, red)).r; //? dispersion
    light.b = behind_at(pixel, blue, behind_detail(roughness, blue)).b; //? dispersion
    let passed = exp(-min(extension.absorption.rgb * way, vec3<f32>(80.0))); //? volume
    return vec4<f32>(light.rgb * passed, light.a); //? volume
}
