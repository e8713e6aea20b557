// Light that leaves a surface towards the eye: glTF 2.0, appendix B, and an ambient hemisphere.

const PI: f32 = 3.14159265359;
// GGX's α below this makes highlights that f32 cannot resolve. Twin in `albedo.rs`.
const ALPHA_MIN: f32 = 0.002;
// Reflectance of dielectrics seen from the front: an index of refraction of 1.5.
const DIELECTRIC_F0: f32 = 0.04;
// Entries along a side of the table; twin of `SIDE` in `albedo.rs`.
const ALBEDO_SIDE: f32 = 32.0;
// Of the filter of `filtered_alpha_squared`, by its authors.
const NORMAL_VARIANCE: f32 = 0.15915494;
const VARIANCE_MAX: f32 = 0.18;

override SUN_COUNT: u32 = 1u;
override LAMPS: bool = false;
// In the count of an item's lamps: those of the cells of its places shine on it too.
const IN_CELLS: u32 = 0x80000000u;
const NO_LAMP: u32 = 0xffffffffu;

struct Surface {
    normal: vec3<f32>,
    toward_eye: vec3<f32>,
    // Less than 0 where a bent or wrong normal turns away from the eye.
    facing: f32,
    // The same, but a normal that turns away counts as one that is seen at a grazing angle, as in
    // three.js, Filament and Khronos' viewer.
    n_dot_v: f32,
    alpha_squared: f32,
    // The part of Smith's term that is the same for every light.
    smith: f32,
    // Lambert's albedo of what is not metal.
    diffuse: vec3<f32>,
    // The layer's Fresnel term is f0 + rise c⁵: dielectric and metal mixed, each compensated for
    // light that meets several facets. `albedo.rs` derives it.
    f0: vec3<f32>,
    rise: vec3<f32>,
    // E and B of the table.
    albedo: vec2<f32>,
    // Part of uniform surroundings that the dielectric's layer reflects.
    dielectric: f32,
    // Of the dielectric: reflectance from the front, and the part of the reflection that is there.
    reflectance: vec4<f32>, //? specular
    grain: Grain, //? anisotropy
    film: Film, //? iridescence
    // Lambert's albedo for light of the other side. //? diffuse_transmission
    through: vec3<f32>, //? diffuse_transmission
    // From this side to the other, along the normal. //? diffuse_transmission
    depth: f32, //? diffuse_transmission
    coat: Coat, //? clearcoat
    sheen: Sheen, //? sheen
}

// The interpolated tangent and normal are not made unit first: mikktspace bakes for that.
fn shading_normal(v: Varyings, front: bool) -> vec3<f32> {
    var normal = normal_of(v);
    if NORMAL != 0u {
        let uv = coordinates(v, NORMAL, 2u);
        let texel = textureSample(normal_texture, normal_sampler, uv).xyz * 2.0 - 1.0;
        let tangent = tangent_of(v);
        let scaled = texel.xy * material.normal_scale;
        let bitangent = cross(normal, tangent.xyz) * (tangent.w * scaled.y);
        normal = tangent.xyz * scaled.x + bitangent + normal * texel.z;
    }
    normal = unit(normal);
    if DOUBLE_SIDED {
        normal = select(-normal, normal, front);
    }
    return normal;
}

// Reflected radiance for light of the given irradiance, perpendicular to its direction.
// D: GGX. V: height-correlated Smith (Heitz 2014). F: Schlick. Diffuse: Lambert, below a layer that
// lets through what the dielectric's F leaves, as in appendix B.
fn reflect_light(s: Surface, toward: vec3<f32>, irradiance: vec3<f32>) -> vec3<f32> { //? !layers
fn reflect_below(s: Surface, toward: vec3<f32>, irradiance: vec3<f32>) -> vec3<f32> { //? layers
    let n_dot_l = clamp(dot(s.normal, toward), 0.0, 1.0);
    // With h = l + v: |h|² = 2 + 2 l·v, so neither h nor its dot products need be formed.
    let l_dot_v = dot(toward, s.toward_eye);
    let inverse_length = inverseSqrt(max(2.0 + 2.0 * l_dot_v, 1e-12));
    let n_dot_h = clamp((n_dot_l + s.facing) * inverse_length, 0.0, 1.0);
    let v_dot_h = clamp((1.0 + l_dot_v) * inverse_length, 0.0, 1.0);
    let a2 = s.alpha_squared; //? !anisotropy
    let f = (n_dot_h * a2 - n_dot_h) * n_dot_h + 1.0; //? !anisotropy
    let lit = n_dot_l * s.smith; //? !anisotropy
    let seen = s.n_dot_v * sqrt(n_dot_l * n_dot_l * (1.0 - a2) + a2); //? !anisotropy
    // π of D and of Lambert are taken out of the bracket.
    let specular = 0.5 * a2 / max(f * f * (lit + seen), 1e-12); //? !anisotropy
    let specular = grain_lobe(s, toward, n_dot_l, n_dot_h, inverse_length); //? anisotropy
    let c = 1.0 - v_dot_h;
    let c2 = c * c;
    let c5 = c2 * c2 * c;
    let beneath = (1.0 - DIELECTRIC_F0) * (1.0 - c5); //? !specular
    let dielectric = s.reflectance.a * mix(s.reflectance.rgb, vec3<f32>(1.0), c5); //? iridescence
    let beneath = 1.0 - largest(filmed(s.film, dielectric)); //? iridescence
    let beneath = 1.0 - s.reflectance.a * mix(largest(s.reflectance.rgb), 1.0, c5); //? unfilmed
    let brdf = s.diffuse * beneath + (s.f0 + s.rise * c5) * specular;
    let through = light_through(s, toward, irradiance); //? diffuse_transmission
    return through + brdf * irradiance * (n_dot_l * (1.0 / PI)); //? diffuse_transmission
    return brdf * irradiance * (n_dot_l * (1.0 / PI)); //? !diffuse_transmission
}

// The interpolated normal, without a normal map, on the side that is seen.
fn surface_normal(v: Varyings, front: bool) -> vec3<f32> {
    let normal = unit(normal_of(v));
    return select(normal, -normal, DOUBLE_SIDED && !front);
}

fn sun_light(s: Surface, sun: u32, position: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let light = reflect_light(s, frame.suns[sun].toward, frame.suns[sun].irradiance);
    return light * sun_visibility(sun, position, normal); //? !diffuse_transmission
    // Light of the other side falls on that. //? diffuse_transmission
    let is_behind = dot(s.normal, frame.suns[sun].toward) < 0.0; //? diffuse_transmission
    let lit = position - select(0.0, s.depth, is_behind) * normal; //? diffuse_transmission
    let side = select(normal, -normal, is_behind); //? diffuse_transmission
    return light * sun_visibility(sun, lit, side); //? diffuse_transmission
}

// KHR_lights_punctual: inverse square, windowed by the range, smoothed by the cone.
fn lamp_light(s: Surface, position: vec3<f32>, lamp: Lamp) -> vec3<f32> {
    let away = lamp.position - position;
    let distance_squared = max(dot(away, away), 1e-12);
    var toward = away * inverseSqrt(distance_squared);
    let ratio = distance_squared * lamp.inverse_range * lamp.inverse_range;
    var strength = clamp(1.0 - ratio * ratio, 0.0, 1.0) / distance_squared;
    let cone = clamp(dot(-toward, lamp.direction) * lamp.cone.x + lamp.cone.y, 0.0, 1.0);
    strength *= cone * cone;
    if lamp.directional != 0u {
        toward = -lamp.direction;
        strength = 1.0;
    }
    return reflect_light(s, toward, lamp.intensity * strength);
}

// First and end of the list of the lamps that may have light in the cell of a place.
fn lamps_of_cell(position: vec3<f32>) -> vec2<u32> {
    let at = floor((position - frame.lamp_origin) * frame.cells_per_unit);
    let is_inside = all(at >= vec3<f32>(0.0)) && all(at < vec3<f32>(frame.lamp_cells));
    if !is_inside {
        return vec2<u32>(0u);
    }
    let cell = vec3<u32>(at);
    let index = (cell.z * frame.lamp_cells.y + cell.y) * frame.lamp_cells.x + cell.x;
    return vec2<u32>(lamp_indices[index], lamp_indices[index + 1u]);
}

// Radiance of the surroundings along a direction; `width` is how far the horizon is blurred.
fn surroundings(up: f32, width: f32) -> vec3<f32> {
    return mix(frame.ground, frame.sky, clamp(up / width * 0.5 + 0.5, 0.0, 1.0));
}

// α² widened by how much the surface's normal turns within a pixel, so that highlights smaller than
// a pixel are dimmed and not missed: Tokuyoshi and Kaplanyan, "Improved Geometric Specular
// Antialiasing" (2019).
fn filtered_alpha_squared(roughness: f32, normal: vec3<f32>) -> f32 {
    let alpha = max(roughness * roughness, ALPHA_MIN);
    let across = dpdx(normal);
    let down = dpdy(normal);
    let variance = NORMAL_VARIANCE * (dot(across, across) + dot(down, down));
    return min(alpha * alpha + min(2.0 * variance, VARIANCE_MAX), 1.0);
}

// What the layer of a material reflects; see `albedo.rs`.
fn layered(seen: Surface, base: vec3<f32>, metallic: f32) -> Surface {
    var s = seen;
    s.smith = sqrt(s.n_dot_v * s.n_dot_v * (1.0 - s.alpha_squared) + s.alpha_squared);
    let roughness = sqrt(sqrt(s.alpha_squared));
    let place = vec2<f32>(sqrt(s.n_dot_v), roughness) * (1.0 - 1.0 / ALBEDO_SIDE);
    let middle = place + 0.5 / ALBEDO_SIDE;
    s.albedo = textureSampleLevel(albedo_table, albedo_sampler, middle, 0.0).rg;
    s.smith = grain_smith(s); //? anisotropy
    s.albedo = grain_albedo(s, roughness); //? anisotropy
    let lost = 1.0 / s.albedo.x - 1.0;
    let dielectric = 1.0 + DIELECTRIC_F0 * lost; //? !specular
    let metal = metallic * (1.0 + base * lost);
    let rest = 1.0 - metallic;
    s.diffuse = base * rest;
    s.f0 = vec3<f32>(rest * dielectric * DIELECTRIC_F0) + metal * base; //? !specular
    let rise = rest * dielectric * (1.0 - DIELECTRIC_F0); //? !specular
    s.rise = vec3<f32>(rise) + metal * (1.0 - base); //? !specular
    s.dielectric = dielectric * mix(s.albedo.y, s.albedo.x, DIELECTRIC_F0); //? !specular
    let f0 = s.reflectance.rgb; //? specular
    let dielectric = s.reflectance.a * (1.0 + f0 * lost); //? specular
    s.f0 = rest * dielectric * f0 + metal * base; //? specular
    s.rise = rest * dielectric * (1.0 - f0) + metal * (1.0 - base); //? specular
    s.dielectric = largest(dielectric * mix(s.albedo.yyy, s.albedo.xxx, f0)); //? unfilmed
    let reflected = dielectric * mix(s.albedo.yyy, s.albedo.xxx, f0); //? iridescence
    s = below_film(s, reflected, metallic); //? iridescence
    return s;
}

// Reflected radiance of the surroundings. The lobe of a rough layer leans towards the normal, since
// half of a lobe around the mirrored direction would lie below the surface; how far, and how wide
// it is, was fitted to integrals over GGX: off by 0.03 on average, from 0 (ground) to 1 (sky).
fn ambient(s: Surface) -> vec3<f32> {
    let alpha = sqrt(s.alpha_squared);
    let mirrored_up = 2.0 * s.facing * s.normal.y - s.toward_eye.y; //? !anisotropy
    let lean = 1.0 - 2.0 * alpha * (1.0 - alpha) * (1.0 - s.n_dot_v); //? !anisotropy
    let mirrored = grain_mirrored(s); //? anisotropy
    let mirrored_up = mirrored.y; //? anisotropy
    let cosine = dot(mirrored, s.normal); //? anisotropy
    let lean = max(1.0 - 2.0 * alpha * (1.0 - alpha) * (1.0 - cosine), 1e-6); //? anisotropy
    let up = mix(mirrored_up, s.normal.y, alpha) * inverseSqrt(lean);
    let specular = s.f0 * s.albedo.x + s.rise * s.albedo.y;
    let reflected = specular * surroundings(up, 0.1 + alpha * (2.0 - alpha)); //? baked_light
    // This sky stands for what a file lacks: the rest of its light is in the baked one.
    return reflected; //? baked_light
    return s.diffuse * (1.0 - s.dielectric) * surroundings(s.normal.y, 1.0) //? !baked_light
        + specular * surroundings(up, 0.1 + alpha * (2.0 - alpha)); //? !baked_light
}

// Radiance before exposure, from a base colour whose alpha has been dealt with.
fn radiance(v: Varyings, base: vec3<f32>, front: bool) -> vec3<f32> {
    var metallic = material.metallic;
    var roughness = material.roughness;
    var occlusion = 1.0;
    if METALLIC_ROUGHNESS != 0u {
        let uv = coordinates(v, METALLIC_ROUGHNESS, 1u);
        let texel = textureSample(metallic_roughness_texture, metallic_roughness_sampler, uv);
        metallic *= texel.b;
        roughness *= texel.g;
        if OCCLUSION_PACKED {
            occlusion = 1.0 + material.occlusion_strength * (texel.r - 1.0);
        }
    }
    if OCCLUSION != 0u {
        let uv = coordinates(v, OCCLUSION, 3u);
        let texel = textureSample(occlusion_texture, occlusion_sampler, uv);
        occlusion = 1.0 + material.occlusion_strength * (texel.r - 1.0);
    }
    // Baked light has corners and gaps darkened already. //? baked_light
    let baked_part = occlusion; //? baked_light
    occlusion = min(occlusion, ambient_visibility(v)); //? ambient_occlusion
    let position = position_of(v);
    var s: Surface;
    s.normal = shading_normal(v, front);
    s.toward_eye = unit(frame.eye.xyz - position * frame.eye.w);
    s.facing = dot(s.normal, s.toward_eye);
    s.n_dot_v = clamp(s.facing, 1e-4, 1.0);
    s.alpha_squared = filtered_alpha_squared(roughness, unit(normal_of(v)));
    let texels = further_texels(v); //? extended
    s.grain = grain_of(v, s, texels); //? anisotropy
    s.reflectance = reflectance(texels); //? specular
    s.film = film_of(s, base, texels); //? iridescence
    s = layered(s, base, metallic);
    let part = transmitted_part(texels); //? transmission
    passing.part = s.diffuse * (part * (1.0 - s.dielectric)); //? transmission
    passing.behind = light_behind(v, s, roughness, texels); //? transmission
    s.diffuse *= 1.0 - part; //? transmission
    s = translucent(v, s, metallic, texels); //? diffuse_transmission
    s.through *= 1.0 - part; //? diffuse_transmission & transmission
    s.sheen = sheen_of(s.n_dot_v, texels); //? sheen
    s.coat = clear_coat(v, front, s.toward_eye, texels); //? clearcoat
    passing.part *= 1.0 - largest(s.sheen.color * s.sheen.albedo); //? transmission & sheen
    passing.part *= s.coat.passed; //? transmission & clearcoat

    var light = ambient(s) * occlusion; //? !environment
    var light = environment_light(s) * occlusion; //? environment
    light += around_behind(s) * occlusion; //? diffuse_transmission
    light += baked_light(s, texels) * baked_part; //? baked_light
    light = layers_around(s, light, occlusion); //? layers
    let facing = surface_normal(v, front);
    if SUN_COUNT > 0u { light += sun_light(s, 0u, position, facing); }
    if SUN_COUNT > 1u { light += sun_light(s, 1u, position, facing); }
    if SUN_COUNT > 2u { light += sun_light(s, 2u, position, facing); }
    if SUN_COUNT > 3u { light += sun_light(s, 3u, position, facing); }
    if LAMPS {
        var list = lamps_of(v);
        var near = vec2<u32>(0u);
        if (list.y & IN_CELLS) != 0u {
            near = lamps_of_cell(position);
        }
        list.y = list.x + (list.y & ~IN_CELLS);
        // Both are in rising order, and so is their union: the order of sums is that of the file.
        while list.x < list.y || near.x < near.y {
            let of_item = select(NO_LAMP, lamp_indices[list.x], list.x < list.y);
            let of_cell = select(NO_LAMP, lamp_indices[near.x], near.x < near.y);
            let at = min(of_item, of_cell);
            list.x += u32(of_item == at);
            near.x += u32(of_cell == at);
            let without = light; //? lamp_shadows
            light += lamp_light(s, position, lamps[at]);
            let is_lit = any(light != without); //? lamp_shadows
            let lit = position; //? lamp_shadows & !diffuse_transmission
            let side = facing; //? lamp_shadows & !diffuse_transmission
            let away = lamps[at].position - position; //? lamp_shadows & diffuse_transmission
            let is_behind = dot(s.normal, away) < 0.0; //? lamp_shadows & diffuse_transmission
            let depth = select(0.0, s.depth, is_behind); //? lamp_shadows & diffuse_transmission
            let lit = position - depth * facing; //? lamp_shadows & diffuse_transmission
            let side = select(facing, -facing, is_behind); //? lamp_shadows & diffuse_transmission
            let part = lamp_visibility(at, lit, side, is_lit); //? lamp_shadows
            light = select(mix(without, light, part), without, part <= 0.0); //? lamp_shadows
        }
    }
    if GLOWING {
        var glow = material.emissive;
        if EMISSIVE != 0u {
            let uv = coordinates(v, EMISSIVE, 4u);
            glow *= textureSample(emissive_texture, emissive_sampler, uv).rgb;
        }
        glow *= s.coat.passed; //? clearcoat
        light += glow;
    }
    return light;
}

// Whether `outgoing` is display light already.
fn shown_as_is() -> bool {
    return !LIT || HIGHLIGHTED;
}

// The part of what `outgoing` gave that is still to be mapped: see `display_light`.
fn light_part() -> f32 {
    let part = 1.0; //? !transmission
    let part = passing.light; //? transmission
    return select(part, 0.0, shown_as_is());
}

// Exposed light of a surface; of an unlit one its colour, which displays show as it is
// (`KHR_materials_unlit`), whatever the exposure. A highlight is mixed into what is shown, so that
// its colour is the same at every exposure.
fn outgoing(v: Varyings, base: vec3<f32>, front: bool) -> vec3<f32> {
    var color = clamp(base, vec3<f32>(0.0), vec3<f32>(1.0));
    if LIT {
        let light = radiance(v, base, front) * frame.exposure; //? !transmission
        var light = radiance(v, base, front) * frame.exposure; //? transmission
        light += passing.part * passing.behind.rgb; //? transmission & !fog
        color = clamp(light, vec3<f32>(0.0), vec3<f32>(LIGHT_MAX));
    }
    var glow = fog_glow(); //? fog
    if !LIT { glow = tone_map(glow); } //? fog
    color = mix(glow, color, fog_passed(position_of(v))); //? fog
    // The picture behind has all of the fog, and the part of it before the surface is drawn above.
    let before = glow * (1.0 - fog_passed(position_of(v))); //? fog & transmission
    let passed = max(passing.behind.rgb - before, vec3<f32>(0.0)); //? fog & transmission
    color += passing.part * passed; //? fog & transmission
    let passed = passing.behind.rgb; //? !fog & transmission
    let shown = passing.part * passed * (1.0 - passing.behind.a); //? transmission
    passing.light = part_of_light(color, shown); //? transmission
    if HIGHLIGHTED {
        if LIT {
            color = tone_map(color); //? !transmission
            color = display_light(vec4<f32>(color, passing.light)); //? transmission
        }
        color = mix(color, material.highlight.rgb, material.highlight.a);
    }
    return color;
}
