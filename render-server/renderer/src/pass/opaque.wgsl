// Opaque and masked surfaces. Where nothing in the scene is blended, the tone mapping happens
// here, and no float target is needed.

override TONE_MAPPED: bool = true;

@fragment
fn opaque(v: Varyings, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let base = base_color(v);
    let light = outgoing(v, base.rgb, front);
    // After the samples, whose derivatives need all four pixels of a quad.
    if MASKED {
        if base.a < material.alpha_cutoff {
            discard;
        }
    }
    if TONE_MAPPED && !shown_as_is() {
        return vec4<f32>(tone_map(light), 1.0);
    }
    // In the float target alpha is the part that is still to be mapped; see `display_light`.
    return vec4<f32>(light, select(light_part(), 1.0, TONE_MAPPED));
}
