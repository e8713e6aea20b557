// Blended surfaces, over a float target; premultiplied by coverage. The target's alpha is the
// part of scene light: the pipeline adds the coverage of lit surfaces only.

@fragment
fn transparent(v: Varyings, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let base = base_color(v);
    let coverage = clamp(base.a, 0.0, 1.0);
    return vec4<f32>(outgoing(v, base.rgb, front) * coverage, coverage);
}
