// KHR_materials_clearcoat: a clear layer of an index of refraction of 1.5, which reflects as the
// layer of a dielectric does, and takes what it reflects of uniform surroundings from the light
// from below: see `albedo.rs`. Where it is smooth, that is the Fresnel term of the eye's direction,
// as the extension's `fresnel_coat` has it for every roughness; rough facets at the rim are seen
// less aslant, and reflect less.

struct Coat {
    normal: vec3<f32>,
    facing: f32,
    n_dot_v: f32,
    alpha_squared: f32,
    smith: f32,
    // E and B of the table.
    albedo: vec2<f32>,
    // Compensates for light that meets several facets.
    many: f32,
    // Part of the layer that is there.
    part: f32,
    // Part of the light from below that passes it.
    passed: f32,
}

// The mesh's normal, whatever normal map the material has, or that of the layer's own map.
fn coat_normal(v: Varyings, front: bool, texels: array<vec4<f32>, 6>) -> vec3<f32> {
    var normal = normal_of(v);
    if CLEARCOAT_NORMAL != 0u {
        let texel = texels[CLEARCOAT_NORMAL].xyz * 2.0 - 1.0;
        let tangent = tangent_of(v);
        let scaled = texel.xy * extension.clearcoat.z;
        let bitangent = cross(normal, tangent.xyz) * (tangent.w * scaled.y);
        normal = tangent.xyz * scaled.x + bitangent + normal * texel.z;
    }
    normal = unit(normal);
    return select(normal, -normal, DOUBLE_SIDED && !front);
}

fn clear_coat(
    v: Varyings,
    front: bool,
    toward_eye: vec3<f32>,
    texels: array<vec4<f32>, 6>,
) -> Coat {
    var coat: Coat;
    coat.normal = coat_normal(v, front, texels);
    coat.facing = dot(coat.normal, toward_eye);
    coat.n_dot_v = clamp(coat.facing, 1e-4, 1.0);
    let roughness = extension.clearcoat.y * texels[CLEARCOAT_ROUGHNESS].g;
    coat.alpha_squared = filtered_alpha_squared(roughness, unit(normal_of(v)));
    let a2 = coat.alpha_squared;
    coat.smith = sqrt(coat.n_dot_v * coat.n_dot_v * (1.0 - a2) + a2);
    let place = vec2<f32>(sqrt(coat.n_dot_v), sqrt(sqrt(a2))) * (1.0 - 1.0 / ALBEDO_SIDE);
    let middle = place + 0.5 / ALBEDO_SIDE;
    coat.albedo = textureSampleLevel(albedo_table, albedo_sampler, middle, 0.0).rg;
    coat.many = 1.0 + DIELECTRIC_F0 * (1.0 / coat.albedo.x - 1.0);
    coat.part = extension.clearcoat.x * texels[CLEARCOAT].r;
    let reflected = coat.many * mix(coat.albedo.y, coat.albedo.x, DIELECTRIC_F0);
    coat.passed = 1.0 - coat.part * reflected;
    return coat;
}

// The layer as a surface of its own.
fn coat_surface(s: Surface) -> Surface {
    var coat: Surface;
    coat.normal = s.coat.normal;
    coat.toward_eye = s.toward_eye;
    coat.facing = s.coat.facing;
    coat.n_dot_v = s.coat.n_dot_v;
    coat.alpha_squared = s.coat.alpha_squared;
    coat.smith = s.coat.smith;
    coat.grain = even_grain(s, coat.normal, coat.alpha_squared); //? anisotropy
    let reflected = s.coat.part * s.coat.many;
    coat.f0 = vec3<f32>(reflected * DIELECTRIC_F0);
    coat.rise = vec3<f32>(reflected * (1.0 - DIELECTRIC_F0));
    coat.albedo = s.coat.albedo;
    return coat;
}
