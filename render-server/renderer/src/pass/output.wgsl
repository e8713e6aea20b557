// From the display target to a surface.

@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var picture_sampler: sampler;

// Where the picture's upper left stands on the surface, in pixels.
override LEFT: i32 = 0;
override TOP: i32 = 0;
// The picture has as many pixels as it covers: they go over unchanged.
override EXACT: bool = true;
// The picture is light as sRGB, and the surface stores what it is given: it is encoded here.
override ENCODED: bool = false;
// The picture is codes, and the surface encodes what it is given: what gives them is stored.
override DECODED: bool = false;
// Codes of ten bits go onto a surface of ten.
override KEPT: bool = false;
// Of the picture on the surface, in pixels.
override WIDTH: u32 = 1u;
override HEIGHT: u32 = 1u;

@fragment
fn output(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    var color = vec3<f32>(0.0);
    if EXACT {
        color = textureLoad(picture, vec2<i32>(at.xy) - vec2<i32>(LEFT, TOP), 0).rgb;
    } else {
        let place = at.xy - vec2<f32>(f32(LEFT), f32(TOP));
        let uv = place / vec2<f32>(f32(WIDTH), f32(HEIGHT));
        color = textureSampleLevel(picture, picture_sampler, uv, 0.0).rgb;
    }
    if ENCODED {
        // IEC 61966-2-1.
        let curved = 1.055 * pow(max(color, vec3<f32>(1e-8)), vec3<f32>(1.0 / 2.4)) - 0.055;
        color = select(curved, color * 12.92, color <= vec3<f32>(0.0031308));
    }
    if DECODED {
        let curved = pow((color + 0.055) / 1.055, vec3<f32>(2.4));
        color = select(curved, color / 12.92, color <= vec3<f32>(0.04045));
    }
    if KEPT {
        // As in `correct.wgsl`: no driver makes another code of it.
        color += 0.25 / 1023.0;
    }
    return vec4<f32>(color, 1.0);
}
