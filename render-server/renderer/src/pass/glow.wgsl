// Light that spreads: levels of a picture are mixed, the widest first; then the pixels of a float
// target take their share of it, on their way to the display target.

@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var picture_sampler: sampler;
@group(1) @binding(2) var spread_light: texture_2d<f32>;
@group(1) @binding(3) var<uniform> glow: Glow;

struct Glow {
    // The pixel of the target where the view's part of the picture begins, and its texel there.
    corner: vec2<f32>,
    place: vec2<f32>,
    // Texels of the whole picture.
    size: vec2<f32>,
    texels_per_pixel: f32,
    strength: f32,
}

// The mean of four linear samples: without them, edges of texels show where one is bright.
fn smoothed(source: texture_2d<f32>, texel: vec2<f32>, size: vec2<f32>) -> vec4<f32> {
    let a = textureSampleLevel(source, picture_sampler, (texel + vec2(-0.5, -0.5)) / size, 0.0);
    let b = textureSampleLevel(source, picture_sampler, (texel + vec2(0.5, -0.5)) / size, 0.0);
    let c = textureSampleLevel(source, picture_sampler, (texel + vec2(-0.5, 0.5)) / size, 0.0);
    let d = textureSampleLevel(source, picture_sampler, (texel + vec2(0.5, 0.5)) / size, 0.0);
    return (a + b + c + d) * 0.25;
}

// Blended with the target times its own alpha: what is left is light, and no unlit colour.
@fragment
fn keep_light() -> @location(0) vec4<f32> {
    return vec4<f32>(0.0);
}

// The next wider level, at a texel of this one.
@fragment
fn spread(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return smoothed(picture, at.xy * 0.5, vec2<f32>(textureDimensions(picture)));
}

// As `display_light`; the colours of unlit surfaces neither glow nor are shone over.
@fragment
fn tonemap_glow(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = textureLoad(picture, vec2<i32>(at.xy), 0);
    let texel = (at.xy - glow.corner) * glow.texels_per_pixel + glow.place;
    let around = smoothed(spread_light, texel, glow.size).rgb;
    let unlit = clamp(pixel.rgb, vec3<f32>(0.0), vec3<f32>(1.0));
    let light = tone_map(mix(pixel.rgb, around, glow.strength));
    return vec4<f32>(unlit * (1.0 - pixel.a) + light * pixel.a, 1.0);
}
