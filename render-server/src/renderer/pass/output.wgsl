// From the display target to a surface.

@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var picture_sampler: sampler;

// Where the picture's upper left stands on the surface, in pixels.
override LEFT: i32 = 0;
override TOP: i32 = 0;
// The sizes are equal: pixels go over unchanged.
override EXACT: bool = true;
// The surface stores what it is given, so sRGB is encoded here.
override ENCODED: bool = false;
// Of the surface, in pixels.
override WIDTH: u32 = 1u;
override HEIGHT: u32 = 1u;

@fragment
fn output(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    var color = vec3<f32>(0.0);
    if EXACT {
        color = textureLoad(picture, vec2<i32>(at.xy) - vec2<i32>(LEFT, TOP), 0).rgb;
    } else {
        let surface_size = vec2<f32>(f32(WIDTH), f32(HEIGHT));
        color = textureSampleLevel(picture, picture_sampler, at.xy / surface_size, 0.0).rgb;
    }
    if ENCODED {
        // IEC 61966-2-1.
        let curved = 1.055 * pow(max(color, vec3<f32>(1e-8)), vec3<f32>(1.0 / 2.4)) - 0.055;
        color = select(curved, color * 12.92, color <= vec3<f32>(0.0031308));
    }
    return vec4<f32>(color, 1.0);
}
