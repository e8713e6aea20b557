// KHR_materials_diffuse_transmission: Lambert's light of the other side, below the same layer as
// that of this side; with KHR_materials_volume less what is absorbed along the thickness.

fn translucent(v: Varyings, seen: Surface, metallic: f32, texels: array<vec4<f32>, 6>) -> Surface {
    var s = seen;
    let part = extension.through.a * texels[THROUGH].a;
    s.through = extension.through.rgb * texels[THROUGH_COLOR].rgb * (part * (1.0 - metallic));
    s.diffuse *= 1.0 - part;
    s.depth = extension.transmission.y * texels[THICKNESS].g * v.stretch; //? volume
    s.through *= exp(-min(extension.absorption.rgb * s.depth, vec3<f32>(80.0))); //? volume
    return s;
}

// The part of light from below that passes the layer towards the eye is that of a light at the
// place where this one is mirrored in the surface.
fn light_through(s: Surface, toward: vec3<f32>, irradiance: vec3<f32>) -> vec3<f32> {
    let behind = clamp(-dot(s.normal, toward), 0.0, 1.0);
    let l_dot_v = dot(toward + 2.0 * behind * s.normal, s.toward_eye);
    let inverse_length = inverseSqrt(max(2.0 + 2.0 * l_dot_v, 1e-12));
    let c = 1.0 - clamp((1.0 + l_dot_v) * inverse_length, 0.0, 1.0);
    let c2 = c * c;
    let c5 = c2 * c2 * c;
    let passed = (1.0 - DIELECTRIC_F0) * (1.0 - c5); //? !specular
    let layer = s.reflectance.a * mix(s.reflectance.rgb, vec3<f32>(1.0), c5); //? specular
    let passed = 1.0 - largest(layer); //? unfilmed
    let passed = 1.0 - largest(filmed(s.film, layer)); //? iridescence
    return s.through * irradiance * (passed * behind * (1.0 / PI));
}

// Light of the surroundings of the other side.
fn around_behind(s: Surface) -> vec3<f32> {
    let light = surroundings(-s.normal.y, 1.0); //? !environment
    let light = environment_diffuse(-s.normal); //? environment
    return s.through * (1.0 - s.dielectric) * light;
}
