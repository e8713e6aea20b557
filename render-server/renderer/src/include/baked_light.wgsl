// MOZ_lightmap: light that was computed before, as three.js has it. It is all that falls on what is
// matt, so Lambert's albedo reflects it whole: the layer above takes nothing of it.

fn baked_light(s: Surface, texels: array<vec4<f32>, 6>) -> vec3<f32> {
    return s.diffuse * texels[BAKED_LIGHT].rgb * (extension.clearcoat.w * (1.0 / PI));
}
