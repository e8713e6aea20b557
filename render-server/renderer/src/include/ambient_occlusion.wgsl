// The part of the light from all around that gets to a surface: see `AmbientOcclusionPass`.

// The visible part, and the depth that it is of.
@group(0) @binding(26) var occlusion_map: texture_2d<f32>;

// Where the map has no texel of a surface, it is not occluded.
const OCCLUSION_OF_NONE: f32 = 1e-3;

// Between the texels around a pixel, of which those of other surfaces do not count: by how much
// their depth differs from that of this surface, which is linear over the picture.
fn ambient_visibility(v: Varyings) -> f32 {
    let slope = vec2<f32>(dpdx(v.clip.z), dpdy(v.clip.z));
    let place = frame.occlusion;
    if place.texels_per_pixel == 0.0 {
        return 1.0;
    }
    let at = v.clip.xy * place.texels_per_pixel + place.offset - 0.5;
    let first = floor(at);
    let part = at - first;
    let tolerance = v.clip.z * place.relative + place.absolute;
    var sum = OCCLUSION_OF_NONE;
    var weights = OCCLUSION_OF_NONE;
    for (var corner = 0; corner < 4; corner++) {
        let step = vec2<f32>(vec2<i32>(corner & 1, corner >> 1));
        let texel = textureLoad(occlusion_map, vec2<i32>(first + step), 0).xy;
        let beside = (first + step - at) / place.texels_per_pixel;
        let apart = (texel.y - v.clip.z - dot(slope, beside)) / tolerance;
        let near = mix(1.0 - part, part, step);
        let weight = near.x * near.y / ((1.0 + apart * apart) * (1.0 + apart * apart));
        sum += texel.x * weight;
        weights += weight;
    }
    return sum / weights;
}
