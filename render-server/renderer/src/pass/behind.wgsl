// Half of a picture: each texel is the mean of four.

@group(1) @binding(0) var picture: texture_2d<f32>;

@fragment
fn halve(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let corner = vec2<i32>(at.xy) * 2;
    let upper = textureLoad(picture, corner, 0) + textureLoad(picture, corner + vec2(1, 0), 0);
    let lower = textureLoad(picture, corner + vec2(0, 1), 0) + textureLoad(picture, corner + 1, 0);
    return (upper + lower) * 0.25;
}
