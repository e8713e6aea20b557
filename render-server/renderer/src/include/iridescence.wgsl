// KHR_materials_iridescence: interference in a thin film, by L. Belcour and P. Barla, "A Practical
// Extension to Microfacet Theory for the Modeling of Varying Iridescence" (2017), as the extension
// simplifies it. Like Khronos' sample viewer and three.js it is evaluated at the angle between eye
// and normal, for lights, too. The path within the film is that of the refracted ray, as the paper
// has it; the extension's text has the outer angle there.

struct Film {
    // Part of the reflection that is the film's.
    part: f32,
    // What it reflects on the dielectric, and on the metal.
    dielectric: vec3<f32>,
    metal: vec3<f32>,
}

fn fifth(x: f32) -> f32 {
    return x * x * x * x * x;
}

// The part of interference that turns with the path, in micrometres times 2π, as linear RGB: the
// Fourier transform of the eye's sensitivity, which the authors fitted.
fn film_sensitivity(path: f32) -> vec3<f32> {
    let squared = path * path;
    let positions = vec3<f32>(1.6810, 1.7953, 2.2084);
    let variances = vec3<f32>(4.3278e-3, 9.3046e-3, 6.6121e-3);
    let amplitudes = vec3<f32>(0.84659000, 1.00022189, 1.00112249);
    var xyz = amplitudes * cos(positions * path) * exp(-variances * squared);
    xyz.x += 0.15386831 * cos(2.2399 * path) * exp(-4.5282e-3 * squared);
    return xyz.x * vec3<f32>(3.2404542, -0.9692660, 0.0556434)
        + xyz.y * vec3<f32>(-1.5371385, 1.8760108, -0.2040259)
        + xyz.z * vec3<f32>(-0.4985314, 0.0415560, 1.0572252);
}

// Reflectance of a film on a substance of this reflectance from the front. No more than all light:
// colours outside those of displays are cut.
fn film_reflectance(f0: vec3<f32>, cosine: f32, ior: f32, thickness: f32) -> vec3<f32> {
    let within = sqrt(1.0 - (1.0 - cosine * cosine) / (ior * ior));
    let ratio = (ior - 1.0) / (ior + 1.0);
    let top = mix(ratio * ratio, 1.0, fifth(1.0 - cosine));
    let passed = 1.0 - top;
    let root = sqrt(clamp(f0 + 1e-4, vec3<f32>(0.0), vec3<f32>(0.9999)));
    let below = (1.0 + root) / (1.0 - root);
    let step = (below - ior) / (below + ior);
    let bottom = mix(step * step, vec3<f32>(1.0), fifth(1.0 - within));
    let both = clamp(top * bottom, vec3<f32>(1e-5), vec3<f32>(0.9999));
    let inner = passed * passed * bottom / (1.0 - both);
    // Where the index rises twice, both reflections turn the wave alike.
    let turned = select(vec3<f32>(1.0), vec3<f32>(-1.0), below >= vec3<f32>(ior));
    let path = 2.0 * PI * 1e-3 * 2.0 * ior * thickness * within;
    var light = top + inner;
    let first = (inner - passed) * sqrt(both);
    light += 2.0 * first * turned * film_sensitivity(path);
    light += 2.0 * first * sqrt(both) * film_sensitivity(2.0 * path);
    return clamp(light, vec3<f32>(0.0), vec3<f32>(1.0));
}

fn film_of(s: Surface, base: vec3<f32>, texels: array<vec4<f32>, 6>) -> Film {
    var film: Film;
    let ior = extension.film.y;
    let full = texels[IRIDESCENCE_THICKNESS].g;
    let thickness = mix(extension.film.z, extension.film.w, full);
    film.part = extension.film.x * texels[IRIDESCENCE].r;
    film.part = select(0.0, film.part, thickness > 0.0);
    let f0 = s.reflectance.rgb * s.reflectance.a;
    film.dielectric = film_reflectance(f0, s.n_dot_v, ior, thickness);
    film.metal = film_reflectance(base, s.n_dot_v, ior, thickness);
    return film;
}

// A reflection of the dielectric as the film changes it.
fn filmed(film: Film, reflected: vec3<f32>) -> vec3<f32> {
    return mix(reflected, film.dielectric, film.part);
}

// The layer of a material with a film, from that without; `reflected` is what the dielectric
// reflects of uniform surroundings.
fn below_film(seen: Surface, reflected: vec3<f32>, metallic: f32) -> Surface {
    var s = seen;
    let lost = 1.0 / s.albedo.x - 1.0;
    let dielectric = s.film.dielectric * (1.0 + s.film.dielectric * lost);
    let metal = s.film.metal * (1.0 + s.film.metal * lost);
    s.f0 = mix(s.f0, mix(dielectric, metal, metallic), s.film.part);
    s.rise *= 1.0 - s.film.part;
    s.dielectric = largest(mix(reflected, dielectric * s.albedo.x, s.film.part));
    return s;
}
