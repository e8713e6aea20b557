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

// A filter of 3 × 3 texels, at any place between texels, in four samples of four texels each:
// Castaño, "Shadow Mapping Summary", part 1 (2013).
fn soft_visibility(place: vec3<f32>, layer: u32) -> f32 {
    let side = vec2<f32>(textureDimensions(shadow_maps));
    let corner = floor(place.xy * side + 0.5);
    let part = place.xy * side + 0.5 - corner;
    let near = 3.0 - 2.0 * part;
    let far = 1.0 + 2.0 * part;
    let low = (corner - 1.5 + (2.0 - part) / near) / side;
    let high = (corner + 0.5 + part / far) / side;
    let a = lit_part(low, layer, place.z) * near.x * near.y;
    let b = lit_part(vec2<f32>(high.x, low.y), layer, place.z) * far.x * near.y;
    let c = lit_part(vec2<f32>(low.x, high.y), layer, place.z) * near.x * far.y;
    let d = lit_part(high, layer, place.z) * far.x * far.y;
    return (a + b + c + d) * (1.0 / 16.0);
}

fn lit_part(at: vec2<f32>, layer: u32, depth: f32) -> f32 {
    return textureSampleCompareLevel(shadow_maps, shadow_sampler, at, layer, depth);
}

fn hard_visibility(place: vec3<f32>, layer: u32) -> f32 {
    let side = vec2<f32>(textureDimensions(shadow_maps));
    // In the middle of a texel the sampler has that one alone.
    return lit_part((floor(place.xy * side) + 0.5) / side, layer, place.z);
}

// From a map, for a point that was moved off its surface: a filter that looks at the surface around
// it must not find it before itself. On a plane it is enough to move by the filter's reach times
// the sine between normal and light: Holbert, "Saying Goodbye to Shadow Acne" (2011).
fn map_visibility(sun: u32, at: u32, position: vec3<f32>, normal: vec3<f32>, away: f32) -> f32 {
    let cascade = shadows.suns[sun].cascades[at];
    let cosine = min(dot(normal, frame.suns[sun].toward), 1.0);
    let reach = select(HARD_REACH, SOFT_REACH, SOFT) * cascade.texel;
    let error = shadows.error.x * away + shadows.error.y;
    let off_surface = normal * (reach * sqrt(1.0 - cosine * cosine) + error);
    let moved = position + off_surface + frame.suns[sun].toward * (TOWARD_TEXELS * cascade.texel);
    let across = dot(shadows.suns[sun].right, moved) * cascade.scale;
    let up = dot(shadows.suns[sun].up, moved) * cascade.scale;
    let depth = dot(shadows.suns[sun].toward, moved) + DEPTH_ROUNDING;
    let place = cascade.offset + vec3<f32>(across, -up, depth);
    if SOFT {
        return soft_visibility(place, cascade.layer);
    }
    return hard_visibility(place, cascade.layer);
}

// The part of a sun's light that reaches a point of a surface. The map is chosen by the distance to
// the viewer, which is the same for all channels and both eyes. There is one loop and no branch:
// software drivers skip only what is in loops.
fn sun_visibility(sun: u32, position: vec3<f32>, normal: vec3<f32>) -> f32 {
    let away = length(position - shadows.middle);
    let is_beyond = vec4<f32>(away) >= shadows.suns[sun].radii;
    let beyond = select(vec4<u32>(0u), vec4<u32>(1u), is_beyond);
    let beyond4 = select(0u, 1u, away >= shadows.suns[sun].radius4);
    let at = beyond.x + beyond.y + beyond.z + beyond.w + beyond4;
    let radius = shadows.suns[sun].cascades[at].radius;
    let coarser = clamp(1.0 - (radius - away) / (radius * BAND), 0.0, 1.0);
    let has_maps = shadows.suns[sun].count > 0u;
    let is_used = has_maps && dot(normal, frame.suns[sun].toward) > 0.0;
    let end = select(at, select(at + 1u, at + 2u, coarser > 0.0), is_used);
    var part = 1.0 - coarser;
    var visible = select(1.0, 0.0, has_maps);
    for (var map = at; map < end; map += 1u) {
        visible += part * map_visibility(sun, map, position, normal, away);
        part = coarser;
    }
    return visible;
}
