// The surroundings behind everything: at an infinite depth, so only where nothing was drawn.

// Directions are first + right x + down y, in pixels from the canvas' upper left corner.
struct Background {
    first: vec4<f32>,
    right: vec4<f32>,
    down: vec4<f32>,
    // The canvas' upper left corner, in pixels of the target.
    corner: vec4<f32>,
}

@group(1) @binding(0) var<uniform> background: Background;

override TONE_MAPPED: bool = true;

@fragment
fn surroundings(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    // Whole pixels apart in the tiles of a screen, so that all of them have the same numbers.
    let place = at.xy - background.corner.xy;
    let along = background.first.xyz + background.right.xyz * place.x
        + background.down.xyz * place.y;
    var light = environment_reflected(along, 0.0) * frame.exposure; //? environment
    var light = frame.sky * frame.exposure; //? !environment
    light = clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX));
    light = mix(fog_glow(), light, fog_passed_from_afar(along)); //? fog
    if TONE_MAPPED {
        return vec4<f32>(tone_map(light), 1.0);
    }
    return vec4<f32>(light, 1.0);
}
