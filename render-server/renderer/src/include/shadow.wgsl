// Group 1: which part of the light of the suns reaches a point. See `shadow_cascades.rs`.

struct Cascade {
    // The eye's place in the map, and its depth.
    offset: vec3<f32>,
    // Of the map's side, to a unit of the world.
    scale: f32,
    // Points that are nearer to the viewer are in the map.
    radius: f32,
    // In units of the world.
    texel: f32,
    layer: u32,
    pad: u32,
}

struct SunShadow {
    right: vec3<f32>,
    count: u32,
    up: vec3<f32>,
    pad0: f32,
    // Over the depth of the scene.
    toward: vec3<f32>,
    // Of the fifth map.
    radius4: f32,
    // Of the four finest maps; the widest map, and those that are not there, have all points.
    radii: vec4<f32>,
    // Finest first.
    cascades: array<Cascade, 6>,
}

struct Shadows {
    // The point between the viewer's eyes.
    middle: vec3<f32>,
    pad0: u32,
    // By which surfaces may be drawn beside their place: in radians, and in units of the world.
    error: vec2<f32>,
    pad1: vec2<f32>,
    suns: array<SunShadow, 4>,
}

@group(1) @binding(0) var<uniform> shadows: Shadows;
// 1 at the light, 0 where nothing is.
@group(1) @binding(1) var shadow_maps: texture_depth_2d_array;
// 1 where what is asked for is no farther from the light than what the map has.
@group(1) @binding(2) var shadow_sampler: sampler_comparison;

override SOFT: bool = true;

// Share of a map's radius in which the next one is mixed in.
const BAND: f32 = 0.1;
// Texels along the light's plane that a filter reaches from a point.
const SOFT_REACH: f32 = 2.2;
const HARD_REACH: f32 = 0.75;
// Towards the light, beyond what f32 rounds: texels are thousandths of the distance or more.
const TOWARD_TEXELS: f32 = 0.1;
// The same of depths from 0 to 1.
const DEPTH_ROUNDING: f32 = 2.5e-7;

