// From scene light to display light, both linear. `tone.rs` is its twin.

override TONE_MAPPER: u32 = 0u; //? !frame
// What a float target can hold; also turns NaN into a number.
const LIGHT_MAX: f32 = 60000.0;

// By the number of a `ToneMapper`.
fn tone_map_by(mapper: u32, light: vec3<f32>) -> vec3<f32> {
    if mapper == 1u {
        return tone_map_aces(light);
    }
    if mapper == 2u {
        return clamp(light, vec3<f32>(0.0), vec3<f32>(1.0));
    }
    return tone_map_neutral(light);
}

// K. Narkowicz, "ACES Filmic Tone Mapping Curve" (2015): a fit of the reference rendering, whose
// input is 0.6 of the light there.
fn tone_map_aces(light: vec3<f32>) -> vec3<f32> {
    let c = clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX)) * 0.6;
    let curve = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
    return clamp(curve, vec3<f32>(0.0), vec3<f32>(1.0));
}

// Khronos PBR Neutral, github.com/KhronosGroup/ToneMapping, PBR_Neutral.
fn tone_map_neutral(light: vec3<f32>) -> vec3<f32> {
    let start = 0.76;
    let desaturation = 0.15;
    let color = clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX));
    let least = min(color.r, min(color.g, color.b));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let shifted = color - offset;
    let peak = max(shifted.r, max(shifted.g, shifted.b));
    let d = 1.0 - start;
    let new_peak = 1.0 - d * d / max(peak + d - start, d);
    let g = 1.0 / (desaturation * (peak - new_peak) + 1.0);
    let compressed = mix(vec3<f32>(new_peak), shifted * (new_peak / max(peak, start)), g);
    return select(compressed, shifted, peak < start);
}

fn tone_map(light: vec3<f32>) -> vec3<f32> {
    return tone_map_by(frame.tone_mapper, light); //? frame
    return tone_map_by(TONE_MAPPER, light); //? !frame
}

// Display light of one pixel of the float target. Its alpha is the part of its colour that is
// exposed scene light; the rest, of unlit surfaces, is display light already. A flag, and not the
// inverse of the tone mapper for what is unlit: the mapper never shows a saturated, bright colour
// such as pure red, and at an exposure of 0 there is no inverse either. The part is exact for
// whole pixels (1 and 0), is resolved like any colour, and adds where surfaces are blended.
fn display_light(pixel: vec4<f32>) -> vec3<f32> {
    let unlit = clamp(pixel.rgb, vec3<f32>(0.0), vec3<f32>(1.0));
    return unlit * (1.0 - pixel.a) + tone_map(pixel.rgb) * pixel.a;
}
