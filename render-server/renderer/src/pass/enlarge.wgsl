// From a picture of lower resolution to one with all pixels.

@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var picture_sampler: sampler;

// Parts of the picture side by side, one for each eye.
override PARTS: u32 = 1u;

struct Place {
    @builtin(position) position: vec4<f32>,
    // From 0 to 1 over the viewport, which is the whole of a part.
    @location(0) place: vec2<f32>,
    @location(1) @interpolate(flat, first) part: u32,
}

@vertex
fn corner(@builtin(vertex_index) index: u32, @builtin(instance_index) part: u32) -> Place {
    let x = f32(index & 1u) * 2.0;
    let y = f32(index >> 1u) * 2.0;
    return Place(vec4<f32>(2.0 * x - 1.0, 1.0 - 2.0 * y, 0.0, 1.0), vec2<f32>(x, y), part);
}

@fragment
fn enlarge(at: Place) -> @location(0) vec4<f32> {
    let size = vec2<f32>(textureDimensions(picture));
    let width = 1.0 / f32(PARTS);
    // No nearer to the next part than the middle of the last pixel.
    let inset = 0.5 / size;
    let low = vec2<f32>(f32(at.part) * width, 0.0) + inset;
    let high = vec2<f32>(f32(at.part + 1u) * width, 1.0) - inset;
    let place = vec2<f32>((at.place.x + f32(at.part)) * width, at.place.y);
    let uv = clamp(place, low, high);
    return vec4<f32>(textureSampleLevel(picture, picture_sampler, uv, 0.0).rgb, 1.0);
}
