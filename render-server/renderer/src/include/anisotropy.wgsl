// KHR_materials_anisotropy: GGX with another roughness along each of two directions of the surface
// (Burley, "Physically-Based Shading at Disney", 2012), with the height-correlated Smith term of
// appendix B. Surroundings are mirrored at a normal that is bent towards the eye across the
// direction, as in Khronos' sample viewer and Filament.

struct Grain {
    // The direction in which highlights are longer, and the one across it.
    along: vec3<f32>,
    across: vec3<f32>,
    // GGX's α in both.
    alpha: vec2<f32>,
    strength: f32,
    // What surroundings are mirrored at.
    bent: vec3<f32>,
}

// See `grain_albedo.rs`.
@group(3) @binding(11) var grain_table: texture_3d<f32>;

// A unit vector across another one.
fn perpendicular(n: vec3<f32>) -> vec3<f32> {
    let axis = select(vec3<f32>(1.0, 0.0, 0.0), vec3<f32>(0.0, 1.0, 0.0), abs(n.x) > 0.7);
    return unit(cross(n, axis));
}

// The direction lies in the plane of the tangents, and is brought into that of the shading normal.
// Where it stands along the normal there is none.
fn grain_of(v: Varyings, s: Surface, texels: array<vec4<f32>, 6>) -> Grain {
    var grain: Grain;
    var direction = extension.anisotropy.yz;
    grain.strength = extension.anisotropy.x;
    if ANISOTROPY != 0u {
        let texel = texels[ANISOTROPY];
        let to = texel.xy * 2.0 - 1.0;
        direction = to.x * direction + to.y * vec2<f32>(-direction.y, direction.x);
        direction *= inverseSqrt(max(dot(direction, direction), 1e-12));
        grain.strength *= texel.b;
    }
    let tangent = tangent_of(v);
    let bitangent = cross(normal_of(v), tangent.xyz) * tangent.w;
    let wanted = tangent.xyz * direction.x + bitangent * direction.y;
    let flat = wanted - s.normal * dot(s.normal, wanted);
    let is_there = dot(flat, flat) > 1e-6;
    grain.strength = select(0.0, grain.strength, is_there);
    grain.along = unit(select(perpendicular(s.normal), flat, is_there));
    grain.across = cross(s.normal, grain.along);
    let alpha = sqrt(s.alpha_squared);
    let strength = grain.strength * grain.strength;
    grain.alpha = vec2<f32>(mix(alpha, 1.0, strength), alpha);
    let seen = s.toward_eye - grain.across * dot(grain.across, s.toward_eye);
    let bend = 1.0 - grain.strength * (1.0 - sqrt(alpha));
    let bend2 = bend * bend;
    grain.bent = unit(mix(seen, s.normal, bend2 * bend2));
    return grain;
}

// None, for a layer with a normal of its own.
fn even_grain(s: Surface, normal: vec3<f32>, alpha_squared: f32) -> Grain { //? clearcoat
    var grain: Grain; //? clearcoat
    let flat = s.grain.along - normal * dot(normal, s.grain.along); //? clearcoat
    let is_there = dot(flat, flat) > 1e-6; //? clearcoat
    grain.along = unit(select(perpendicular(normal), flat, is_there)); //? clearcoat
    grain.across = cross(normal, grain.along); //? clearcoat
    grain.alpha = vec2<f32>(sqrt(alpha_squared)); //? clearcoat
    grain.bent = normal; //? clearcoat
    return grain; //? clearcoat
} //? clearcoat

fn along_and_across(grain: Grain, v: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(dot(grain.along, v), dot(grain.across, v));
}

// The part of Smith's term that is the same for every light.
fn grain_smith(s: Surface) -> f32 {
    let eye = s.grain.alpha * along_and_across(s.grain, s.toward_eye);
    return sqrt(dot(eye, eye) + s.n_dot_v * s.n_dot_v);
}

// D V, times π.
fn grain_lobe(
    s: Surface,
    toward: vec3<f32>,
    n_dot_l: f32,
    n_dot_h: f32,
    inverse_length: f32,
) -> f32 {
    let alpha = s.grain.alpha;
    let light = along_and_across(s.grain, toward);
    let half = (light + along_and_across(s.grain, s.toward_eye)) * inverse_length;
    let a2 = alpha.x * alpha.y;
    let f = vec3<f32>(alpha.yx * half, a2 * n_dot_h);
    let w2 = a2 / max(dot(f, f), 1e-12);
    let bent = alpha * light;
    let lit = n_dot_l * s.smith;
    let seen = s.n_dot_v * sqrt(dot(bent, bent) + n_dot_l * n_dot_l);
    return 0.5 * a2 * w2 * w2 / max(lit + seen, 1e-12);
}

// E and B of the eye's direction, by α in the plane of eye and normal.
fn grain_albedo(s: Surface, roughness: f32) -> vec2<f32> {
    let sides = vec3<f32>(textureDimensions(grain_table));
    let place = vec3<f32>(sqrt(s.n_dot_v), roughness, s.grain.strength);
    let layers = 0.5 * sides.z;
    let at = place * (vec3<f32>(sides.xy, layers) - 1.0) + 0.5;
    let behind = vec3<f32>(at.xy, at.z + layers);
    let e = textureSampleLevel(grain_table, albedo_sampler, at / sides, 0.0).rgb;
    let b = textureSampleLevel(grain_table, albedo_sampler, behind / sides, 0.0).rgb;
    let eye = along_and_across(s.grain, s.toward_eye);
    let alpha = length(s.grain.alpha * eye) / max(length(eye), 1e-6) - s.grain.alpha.y;
    let part = clamp(alpha / max(s.grain.alpha.x - s.grain.alpha.y, 1e-6), 0.0, 1.0);
    let rest = 1.0 - part;
    let lean = rest - part;
    let weights = vec3<f32>(rest * lean, 4.0 * part * rest, -part * lean);
    return vec2<f32>(dot(e, weights), dot(b, weights));
}

fn grain_mirrored(s: Surface) -> vec3<f32> {
    return 2.0 * dot(s.grain.bent, s.toward_eye) * s.grain.bent - s.toward_eye;
}
