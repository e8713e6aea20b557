// Passes over the depth of occluders. A line that ends in `//? many` is there where pixels have
// several samples, and one with `//? single` where they have one.

@group(1) @binding(0) var occluders: texture_depth_2d; //? single
@group(1) @binding(0) var occluders: texture_depth_multisampled_2d; //? many
// Gives texels as they are; repeats those at the edges.
@group(1) @binding(1) var texels: sampler; //? single

// Pixels along each side of a cell; twin of `CELL_SIDE` in `occluder.rs`.
const CELL_SIDE: u32 = 8u;
const SAMPLES: i32 = 4; //? many

// The depth that the scene's pass begins with: just behind the occluders, so that of surfaces at
// one depth the first one drawn still wins there.
@fragment
fn behind(
    @builtin(position) at: vec4<f32>,
    @builtin(sample_index) at_sample: u32, //? many
) -> @builtin(frag_depth) f32 {
    let at_sample = 0u; //? single
    let bits = bitcast<u32>(textureLoad(occluders, vec2<i32>(at.xy), i32(at_sample)));
    // The next number towards 0, which is infinitely far.
    return bitcast<f32>(bits - select(0u, 1u, bits > 0u));
}

// The farthest depth of a cell. Four texels at a time, which takes a software driver half as long.
@fragment
fn farthest(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let first = vec2<u32>(at.xy) * CELL_SIDE;
    var depth = 1.0;
    let step = 1.0 / vec2<f32>(textureDimensions(occluders)); //? single
    for (var y = 1u; y < CELL_SIDE; y += 2u) { //? single
        for (var x = 1u; x < CELL_SIDE; x += 2u) { //? single
            let corner = vec2<f32>(first + vec2<u32>(x, y)) * step; //? single
            let four = textureGather(occluders, texels, corner); //? single
            let two = min(four.xy, four.zw); //? single
            depth = min(depth, min(two.x, two.y)); //? single
        } //? single
    } //? single
    let end = min(first + CELL_SIDE, textureDimensions(occluders)); //? many
    for (var y = first.y; y < end.y; y++) { //? many
        for (var x = first.x; x < end.x; x++) { //? many
            for (var i = 0; i < SAMPLES; i++) { //? many
                depth = min(depth, textureLoad(occluders, vec2<u32>(x, y), i)); //? many
            } //? many
        } //? many
    } //? many
    return vec4<f32>(depth, 0.0, 0.0, 1.0);
}
