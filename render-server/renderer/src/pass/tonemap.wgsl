// From the float target, see `display_light`, to the display target.

@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var picture_sampler: sampler;

@fragment
fn tonemap(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(display_light(textureLoad(picture, vec2<i32>(at.xy), 0)), 1.0);
}
