// Blended surfaces, over a float target; premultiplied by coverage.

@fragment
fn transparent(v: Varyings, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let base = base_color(v);
    let light = radiance(v, base.rgb, front) * frame.exposure;
    let coverage = clamp(base.a, 0.0, 1.0);
    return vec4<f32>(clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX)) * coverage, coverage);
}
