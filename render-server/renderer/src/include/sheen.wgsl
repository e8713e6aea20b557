// KHR_materials_sheen: the distribution of fibres of Estevez and Kulla, "Production Friendly
// Microfacet Sheen BRDF" (2017), with their fit of what shadows it, and what is below weakened by
// the albedo of the fibres. Of surroundings they reflect the diffuse light: their lobe is about
// as wide.

// Twin of `ROUGHNESS_MIN` in `sheen.rs`.
const SHEEN_ROUGHNESS_MIN: f32 = 0.1;

struct Sheen {
    color: vec3<f32>,
    roughness: f32,
    // Of the eye's direction: Smith's Λ, and E of the table.
    lambda: f32,
    albedo: f32,
}

fn sheen_fit(x: f32, alpha: f32) -> f32 {
    let part = (1.0 - alpha) * (1.0 - alpha);
    let a = mix(21.5473, 25.3245, part);
    let b = mix(3.82987, 3.32435, part);
    let c = mix(0.19823, 0.16801, part);
    let d = mix(-1.97760, -1.27393, part);
    let e = mix(-4.32054, -4.85967, part);
    return a / (1.0 + b * pow(x, c)) + d * x + e;
}

fn sheen_lambda(cosine: f32, alpha: f32) -> f32 {
    if cosine < 0.5 {
        return exp(sheen_fit(cosine, alpha));
    }
    return exp(2.0 * sheen_fit(0.5, alpha) - sheen_fit(1.0 - cosine, alpha));
}

// Part of uniform surroundings that white fibres reflect; more than 1 at the rim of smooth ones.
fn sheen_albedo(cosine: f32, roughness: f32) -> f32 {
    let place = vec2<f32>(sqrt(cosine), roughness) * (1.0 - 1.0 / ALBEDO_SIDE);
    let middle = place + 0.5 / ALBEDO_SIDE;
    return textureSampleLevel(albedo_table, albedo_sampler, middle, 0.0).b;
}

fn sheen_of(n_dot_v: f32, texels: array<vec4<f32>, 6>) -> Sheen {
    var sheen: Sheen;
    let roughness = extension.sheen.a * texels[SHEEN_ROUGHNESS].a;
    sheen.roughness = max(roughness, SHEEN_ROUGHNESS_MIN);
    sheen.lambda = sheen_lambda(n_dot_v, sheen.roughness * sheen.roughness);
    sheen.albedo = sheen_albedo(n_dot_v, sheen.roughness);
    // No more light than there is.
    let color = extension.sheen.rgb * texels[SHEEN_COLOR].rgb;
    sheen.color = color / max(sheen.albedo, 1.0);
    return sheen;
}

// Light of fibres and of what is below them, from that of the latter alone.
fn sheen_light(
    s: Surface,
    toward: vec3<f32>,
    irradiance: vec3<f32>,
    below: vec3<f32>,
) -> vec3<f32> {
    let n_dot_l = dot(s.normal, toward);
    if n_dot_l <= 0.0 {
        return below; //? !diffuse_transmission
        let over = largest(s.sheen.color) * s.sheen.albedo; //? diffuse_transmission
        return below * max(1.0 - over, 0.0); //? diffuse_transmission
    }
    let alpha = s.sheen.roughness * s.sheen.roughness;
    let inverse_length = inverseSqrt(max(2.0 + 2.0 * dot(toward, s.toward_eye), 1e-12));
    let n_dot_h = clamp((n_dot_l + s.facing) * inverse_length, 0.0, 1.0);
    let sine_squared = max(1.0 - n_dot_h * n_dot_h, 1e-7);
    let density = (2.0 + 1.0 / alpha) * pow(sine_squared, 0.5 / alpha) * (0.5 / PI);
    let lit = min(n_dot_l, 1.0);
    // The light's cosine is taken out of the bracket of V.
    let seen = 0.25 / (s.n_dot_v * (1.0 + s.sheen.lambda + sheen_lambda(lit, alpha)));
    let most = largest(s.sheen.color);
    let taken = most * max(s.sheen.albedo, sheen_albedo(lit, s.sheen.roughness));
    return below * max(1.0 - taken, 0.0) + s.sheen.color * irradiance * (density * seen);
}

// The same of surroundings, whose diffuse light is given.
fn sheen_around(s: Surface, diffuse: vec3<f32>, below: vec3<f32>) -> vec3<f32> {
    let reflected = s.sheen.color * s.sheen.albedo;
    return below * (1.0 - largest(reflected)) + reflected * diffuse;
}
