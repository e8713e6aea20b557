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

