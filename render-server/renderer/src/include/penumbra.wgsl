// The radius of the penumbra that blockers before a point make on it, in sides of the map; 0 where
// there is none. `spread` is the radius of the light as seen from a point, in sides of the map, for
// a difference in depth of 1: for parallel light as for a lamp's map, whose depths are inverse
// distances, what is nearer to the light by a depth of d hides parts of it within `spread` × d. The
// light's depth is 1, and nothing is looked at beyond `most`. Fernando, "Percentage-Closer Soft
// Shadows" (2005); that blockers are within a cone keeps a slanted surface from blocking itself.
fn penumbra_radius(place: vec3<f32>, layer: u32, spread: f32, slant: vec2<f32>, most: f32) -> f32 {
    let side = vec2<f32>(textureDimensions(shadow_maps));
    let cone = SEARCH_CONE * max(spread, 1e-9);
    let reach = min(cone * (1.0 - place.z), most);
    var sum = 0.0;
    var count = 0.0;
    var toward = vec2<f32>(1.0, 0.0);
    for (var tap = 0u; tap < SEARCH_TAPS; tap += 1u) {
        // Denser in the middle, where what is near the point is found.
        let part = (f32(tap) + 0.5) / f32(SEARCH_TAPS);
        let radius = reach * part * part;
        let at = (place.xy + slanted(toward * radius, slant)) * side;
        let texel = vec2<i32>(clamp(at, vec2<f32>(0.0), side - 1.0));
        let depth = textureLoad(shadow_maps, texel, layer, 0);
        let needed = place.z + max(radius - 1.0 / side.x, 0.0) / cone;
        sum += select(0.0, depth, depth > needed);
        count += select(0.0, 1.0, depth > needed);
        toward = turned(toward);
    }
    return select(0.0, (sum / max(count, 1.0) - place.z) * spread, count > 0.0);
}

// The part of a light of some size that reaches a point on which penumbras have a radius. Narrow
// ones have the edges of `soft_visibility`.
fn area_visibility(
    place: vec3<f32>,
    layer: u32,
    spread: f32,
    slant: vec2<f32>,
    radius: f32,
) -> f32 {
    let texel = 1.0 / f32(textureDimensions(shadow_maps).x);
    let is_wide = radius > NARROW_TEXELS * texel;
    var visible = 0.0;
    for (var once = select(0u, 1u, is_wide); once < 1u; once += 1u) {
        visible = soft_visibility(place, layer);
    }
    let slope = 1.0 / (DISC_CONE * max(spread, 1e-9));
    let taps = select(0u, DISC_TAPS, is_wide);
    var toward = vec2<f32>(1.0, 0.0);
    for (var tap = 0u; tap < taps; tap += 1u) {
        // Even over the disc: Vogel, "A better way to construct the sunflower head" (1979).
        let from_middle = radius * sqrt((f32(tap) + 0.5) / f32(DISC_TAPS));
        let at = place.xy + slanted(toward * from_middle, slant);
        let depth = place.z + max(from_middle - texel, 0.0) * slope;
        visible += lit_part(at, layer, depth) / f32(DISC_TAPS);
        toward = turned(toward);
    }
    return visible;
}
