// Group 0, where light comes from all around: see `EnvironmentMap`.

struct Environment {
    // Factors of the polynomials of the normal; w of the first is the last level of the map.
    diffuse: array<vec4<f32>, 9>,
}

@group(0) @binding(16) var environment_map: texture_cube<f32>;
@group(0) @binding(17) var environment_sampler: sampler;
@group(0) @binding(18) var<uniform> environment: Environment;

// Irradiance over π of a surface with this normal.
fn environment_diffuse(n: vec3<f32>) -> vec3<f32> {
    var sum = environment.diffuse[0].rgb;
    sum += environment.diffuse[1].rgb * n.y;
    sum += environment.diffuse[2].rgb * n.z;
    sum += environment.diffuse[3].rgb * n.x;
    sum += environment.diffuse[4].rgb * (n.x * n.y);
    sum += environment.diffuse[5].rgb * (n.y * n.z);
    sum += environment.diffuse[6].rgb * (3.0 * n.z * n.z - 1.0);
    sum += environment.diffuse[7].rgb * (n.x * n.z);
    sum += environment.diffuse[8].rgb * (n.x * n.x - n.y * n.y);
    // Behind a bright spot the second order falls below nothing.
    return max(sum, vec3<f32>(0.0)) * frame.surroundings;
}

// Radiance that a lobe of this perceptual roughness sees along a direction of any length.
fn environment_reflected(along: vec3<f32>, roughness: f32) -> vec3<f32> {
    let level = roughness * environment.diffuse[0].w;
    let light = textureSampleLevel(environment_map, environment_sampler, along, level).rgb;
    return light * frame.surroundings;
}
