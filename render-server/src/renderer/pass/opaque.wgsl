// Opaque and masked surfaces. Where nothing in the scene is blended, the tone mapping happens
// here, and no float target is needed.

override TONE_MAPPED: bool = true;

@fragment
fn opaque(v: Varyings, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let base = base_color(v);
    let light = radiance(v, base.rgb, front) * frame.exposure;
    // After the samples, whose derivatives need all four pixels of a quad.
    if MASKED {
        if base.a < material.alpha_cutoff {
            discard;
        }
    }
    if TONE_MAPPED {
        return vec4<f32>(tone_map(light), 1.0);
    }
    return vec4<f32>(clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX)), 1.0);
}
