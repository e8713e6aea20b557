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
    // See `penumbra_radius`.
    spread: f32,
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
// Lights have a size: penumbras are as wide as they would be.
override CONTACT_HARDENING: bool = false;

// Share of a map's radius in which the next one is mixed in.
const BAND: f32 = 0.1;
// Texels along the light's plane that a filter reaches from a point.
const SOFT_REACH: f32 = 2.2;
const HARD_REACH: f32 = 0.75;
// Texels by which a level of detail in a map may be beside its place; twin in `shadow_cascades.rs`.
const LEVEL_TEXELS: f32 = 0.25;
// Towards the light, beyond what f32 rounds: texels are thousandths of the distance or more.
const TOWARD_TEXELS: f32 = 0.1;
// The same of depths from 0 to 1.
const DEPTH_ROUNDING: f32 = 2.5e-7;
const SEARCH_TAPS: u32 = 32u;
const DISC_TAPS: u32 = 48u;
// Blockers are looked for in a cone so much wider than that towards the light: else none is found
// for points at the outer edge of a penumbra, of which they hide the last part.
const SEARCH_CONE: f32 = 2.0;
// The same while the disc is summed, where blockers are nearer or farther than their mean.
const DISC_CONE: f32 = 4.0;
// Penumbras of a smaller radius are as wide as soft edges.
const NARROW_TEXELS: f32 = 1.5;
// Of the cosine between normal and light: lights are seen no larger, so that no cone is cut by the
// plane of the surface.
const GRAZING: f32 = 0.9 / DISC_CONE;

// The next direction of a spiral: by the golden angle.
fn turned(v: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(v.x * -0.7373688 - v.y * 0.6754903, v.x * 0.6754903 + v.y * -0.7373688);
}

// A place in a disc that faces the light, in a map that is seen at a slant: `slant` is the tangent
// of the angle to the map's axis, towards the place.
fn slanted(v: vec2<f32>, slant: vec2<f32>) -> vec2<f32> {
    return v + slant * (dot(v, slant) / (1.0 + sqrt(1.0 + dot(slant, slant))));
}

