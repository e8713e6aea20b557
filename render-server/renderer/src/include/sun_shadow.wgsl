// Half of the sun's apparent diameter of 0.533°, as a tangent; twin in `shadow_cascades.rs`.
const SUN_TANGENT: f32 = 0.004652;
// Between normal and light.
const COSINE_MIN: f32 = 0.05;
// Sides of a map in which blockers are looked for.
const SUN_SEARCH_MAX: f32 = 1.0 / 16.0;

// In a map, for a point that was moved off its surface: a filter that looks at the surface around
// it must not find it before itself. On a plane it is enough to move by the filter's reach times
// the sine between normal and light: Holbert, "Saying Goodbye to Shadow Acne" (2011).
fn sun_place(
    sun: u32,
    at: u32,
    position: vec3<f32>,
    normal: vec3<f32>,
    away: f32,
) -> vec3<f32> {
    let cascade = shadows.suns[sun].cascades[at];
    let cosine = min(dot(normal, frame.suns[sun].toward), 1.0);
    let reach = select(HARD_REACH, SOFT_REACH, SOFT) * cascade.texel;
    let error = shadows.error.x * away + shadows.error.y;
    let sine = sqrt(1.0 - cosine * cosine);
    // Off its surface a point has a shadow that is somewhat beside its own, which counts where
    // penumbras are to be exact. Towards the light it keeps its texel.
    let off_surface = normal * (select(reach * sine, 0.0, CONTACT_HARDENING) + error);
    let slope = select(0.0, reach * sine / max(cosine, COSINE_MIN), CONTACT_HARDENING);
    // What casts may be off by so much along the normal.
    let level = LEVEL_TEXELS * cascade.texel / max(cosine, COSINE_MIN);
    let closer = frame.suns[sun].toward * (TOWARD_TEXELS * cascade.texel + slope + level);
    let moved = position + off_surface + closer;
    let across = dot(shadows.suns[sun].right, moved) * cascade.scale;
    let up = dot(shadows.suns[sun].up, moved) * cascade.scale;
    let depth = dot(shadows.suns[sun].toward, moved) + DEPTH_ROUNDING;
    let place = cascade.offset + vec3<f32>(across, -up, depth);
    // A sky, which maps do not hold, may be behind all that casts.
    return vec3<f32>(place.xy, max(place.z, 0.0));
}

fn map_visibility(sun: u32, at: u32, position: vec3<f32>, normal: vec3<f32>, away: f32) -> f32 {
    let fine = shadows.suns[sun].cascades[at];
    let place = sun_place(sun, at, position, normal, away);
    if CONTACT_HARDENING {
        let cosine = dot(normal, frame.suns[sun].toward);
        let part = min(1.0, GRAZING / SUN_TANGENT * cosine);
        let slant = vec2<f32>(0.0);
        let of_fine = fine.spread * part;
        let radius = penumbra_radius(place, fine.layer, of_fine, slant, SUN_SEARCH_MAX);
        // A disc of more texels than taps is even enough in a coarser map.
        let texels = radius * f32(textureDimensions(shadow_maps).x);
        let is_wider = vec3<f32>(texels) > vec3<f32>(16.0, 64.0, 256.0);
        let steps = select(vec3<u32>(0u), vec3<u32>(1u), is_wider);
        let map = min(at + steps.x + steps.y + steps.z, shadows.suns[sun].count - 1u);
        let cascade = shadows.suns[sun].cascades[map];
        let in_map = sun_place(sun, map, position, normal, away);
        let wide = radius * cascade.scale / fine.scale;
        return area_visibility(in_map, cascade.layer, cascade.spread * part, slant, wide);
    }
    if SOFT {
        return soft_visibility(place, fine.layer);
    }
    return hard_visibility(place, fine.layer);
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
