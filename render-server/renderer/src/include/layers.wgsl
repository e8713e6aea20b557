// Layers above a material. Each lets through what it does not reflect.

// In the place of the material's own reflection.
fn reflect_light(s: Surface, toward: vec3<f32>, irradiance: vec3<f32>) -> vec3<f32> {
    var light = reflect_below(s, toward, irradiance);
    light = sheen_light(s, toward, irradiance, light); //? sheen
    let coat = reflect_below(coat_surface(s), toward, irradiance); //? clearcoat
    light = light * s.coat.passed + coat; //? clearcoat
    return light;
}

// Reflected radiance of the surroundings, from that of the material below.
fn layers_around(s: Surface, below: vec3<f32>, occlusion: f32) -> vec3<f32> {
    var light = below;
    let diffuse = surroundings(s.normal.y, 1.0) * occlusion; //? sheen & !environment
    let diffuse = environment_diffuse(s.normal) * occlusion; //? sheen & environment
    light = sheen_around(s, diffuse, light); //? sheen
    let coat = coat_surface(s); //? clearcoat
    let reflected = ambient(coat) * occlusion; //? clearcoat & !environment
    let reflected = environment_light(coat) * occlusion; //? clearcoat & environment
    light = light * s.coat.passed + reflected; //? clearcoat
    return light;
}
