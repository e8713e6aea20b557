// Reflected radiance of the surroundings, where they are a map: in the place of `ambient`. The lobe
// of a rough layer leans towards the normal as there.
fn environment_light(s: Surface) -> vec3<f32> {
    let alpha = sqrt(s.alpha_squared);
    let mirrored = 2.0 * s.facing * s.normal - s.toward_eye; //? !anisotropy
    let mirrored = grain_mirrored(s); //? anisotropy
    let along = mix(mirrored, s.normal, alpha);
    let specular = s.f0 * s.albedo.x + s.rise * s.albedo.y;
    return s.diffuse * (1.0 - s.dielectric) * environment_diffuse(s.normal)
        + specular * environment_reflected(along, sqrt(alpha));
}
