// From a picture to one of fewer pixels: each has the mean light of a square.

@group(1) @binding(0) var picture: texture_2d<f32>;

struct Cell {
    @builtin(position) position: vec4<f32>,
    // Pixels along each side of a square.
    @location(0) @interpolate(flat, first) side: u32,
}

@vertex
fn corner(@builtin(vertex_index) index: u32, @builtin(instance_index) side: u32) -> Cell {
    let x = f32(index & 1u) * 2.0;
    let y = f32(index >> 1u) * 2.0;
    return Cell(vec4<f32>(2.0 * x - 1.0, 1.0 - 2.0 * y, 0.0, 1.0), side);
}

@fragment
fn reduce(at: Cell) -> @location(0) vec4<f32> {
    let first = vec2<u32>(at.position.xy) * at.side;
    // Squares at the right and lower edge may be cut off.
    let end = min(first + at.side, textureDimensions(picture));
    var sum = vec3<f32>(0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            sum += textureLoad(picture, vec2<u32>(x, y), 0).rgb;
        }
    }
    let size = end - first;
    return vec4<f32>(sum / f32(size.x * size.y), 1.0);
}
