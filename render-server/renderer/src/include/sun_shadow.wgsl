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
