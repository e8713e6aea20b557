//! Directional albedo of the anisotropic layer of `KHR_materials_anisotropy`: what
//! [`albedo`](super::albedo) is for one roughness, for two along directions of the surface.
//!
//! It depends on the eye's angle φ around the normal, from the direction along which highlights are
//! longer: nearly as a parabola of α in the plane of eye and normal, which is
//! √(α₁² cos² φ + α₂² sin² φ). Entries hold it where that is α₂, halfway, and α₁.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::OnceLock;

use super::albedo::{ALPHA_MIN, MU_MIN, gauss_legendre};
use super::gpu::Gpu;
use super::tone::f16_bits;

/// Entries by √μ, by roughness and by strength, each from 0 to 1. Linear interpolation of E is off
/// by 0.14 % on average, and by 1.5 % at most where μ is more than 0.17 and roughness than 0.2.
const SIDES: [usize; 3] = [24, 16, 12];

/// Angles around the normal of one entry.
const ANGLES: usize = 16;

/// The table on the GPU, for linear samplers: that of B lies behind that of E.
pub(crate) fn texture(gpu: &Gpu) -> wgpu::TextureView {
    let [width, height, layers] = SIDES.map(|side| side as u32);
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 2 * layers };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("grain_albedo/texture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let texels = [0, 1].into_iter().flat_map(|which| table().iter().map(move |of| of[which]));
    let bits: Vec<u16> = texels.flat_map(|[a, b, c]| [a, b, c, 1.0].map(f16_bits)).collect();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(8 * width),
        rows_per_image: Some(height),
    };
    gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&bits), layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// E across the direction, between both and along it, and B.
type Entry = [[f64; 3]; 2];

/// All entries, made once in a process that draws such a material: about 0.2 s.
fn table() -> &'static [Entry] {
    static TABLE: OnceLock<Vec<Entry>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let nodes = gauss_legendre();
        let part = |at: usize, side: usize| at as f64 / (SIDES[side] - 1) as f64;
        let entry = |at: usize| {
            let (column, row) = (at % SIDES[0], at / SIDES[0] % SIDES[1]);
            let layer = at / (SIDES[0] * SIDES[1]);
            entry(part(column, 0).powi(2), part(row, 1), part(layer, 2), &nodes)
        };
        (0..SIDES.iter().product()).map(entry).collect()
    })
}

/// GGX's α along the direction and across it.
fn alphas(roughness: f64, strength: f64) -> [f64; 2] {
    let alpha = (roughness * roughness).max(ALPHA_MIN);
    [alpha + (1.0 - alpha) * strength * strength, alpha]
}

fn entry(mu: f64, roughness: f64, strength: f64, nodes: &[[f64; 2]]) -> Entry {
    let [along, across] = alphas(roughness, strength);
    let middle = f64::midpoint(along, across);
    // The angle at which α is that; any, where α is the same at all.
    let cos2 = (middle * middle - across * across) / (along * along - across * across).max(1e-12);
    let between = cos2.clamp(0.0, 1.0).sqrt().acos();
    let all = [FRAC_PI_2, between, 0.0].map(|angle| albedo((mu, angle), [along, across], nodes));
    [0, 1].map(|which| all.map(|of| of[which]))
}

/// E and B of an eye with the cosine μ at an angle around the normal; see `albedo::albedo`.
fn albedo((mu, angle): (f64, f64), [ax, ay]: [f64; 2], nodes: &[[f64; 2]]) -> [f64; 2] {
    let mu = mu.max(MU_MIN);
    let flat = (1.0 - mu * mu).max(0.0).sqrt();
    let eye = [flat * angle.cos(), flat * angle.sin(), mu];
    // The view in the space where facets are a hemisphere, and two directions across it.
    let [x, y, z] = unit([ax * eye[0], ay * eye[1], eye[2]]);
    let level = x.hypot(y);
    let first = if level > 1e-9 { [-y / level, x / level, 0.0] } else { [1.0, 0.0, 0.0] };
    let second = [-z * first[1], z * first[0], x * first[1] - y * first[0]];
    let visible = f64::midpoint(1.0, z);
    let seen = 1.0 + smith(eye, [ax, ay]);
    let mut sum = [0.0; 2];
    for &[radius_squared, weight] in nodes {
        for step in 0..ANGLES {
            let (sin, cos) = (2.0 * PI * (step as f64 + 0.5) / ANGLES as f64).sin_cos();
            let a = radius_squared.sqrt() * cos;
            let rim = (1.0 - a * a).max(0.0).sqrt();
            let b = (1.0 - visible) * rim + visible * radius_squared.sqrt() * sin;
            let c = (1.0 - a * a - b * b).max(0.0).sqrt();
            let up = [0, 1, 2].map(|at| a * first[at] + b * second[at] + c * [x, y, z][at]);
            let facet = unit([ax * up[0], ay * up[1], up[2].max(0.0)]);
            let v_dot_h: f64 = facet.iter().zip(eye).map(|(h, v)| h * v).sum();
            let light = [0, 1, 2].map(|at| 2.0 * v_dot_h * facet[at] - eye[at]);
            if light[2] <= 0.0 {
                continue;
            }
            let kept = weight / ANGLES as f64 * seen / (seen + smith(light, [ax, ay]));
            sum[0] += kept;
            sum[1] += kept * (1.0 - v_dot_h.clamp(0.0, 1.0)).powi(5);
        }
    }
    sum
}

fn unit(of: [f64; 3]) -> [f64; 3] {
    let length = of.iter().map(|part| part * part).sum::<f64>().sqrt();
    of.map(|part| part / length)
}

/// Smith's Λ: Heitz, "Understanding the Masking-Shadowing Function" (2014), equations 72 and 86.
fn smith([x, y, z]: [f64; 3], [ax, ay]: [f64; 2]) -> f64 {
    let bent = (ax * x).powi(2) + (ay * y).powi(2);
    f64::midpoint(-1.0, (1.0 + bent / (z * z)).sqrt())
}

#[cfg(test)]
pub(crate) mod tests {
    use std::f64::consts::FRAC_PI_4;

    use glam::DVec3;

    use super::*;

    /// D V of the layer, times π, where highlights are longer along +x.
    pub(crate) fn facets([ax, ay]: [f64; 2], eye: DVec3, light: DVec3) -> f64 {
        let h = (eye + light).normalize();
        let stretched = (h.x / ax).powi(2) + (h.y / ay).powi(2) + h.z * h.z;
        let d = 1.0 / (ax * ay * stretched * stretched);
        let long = |of: DVec3| DVec3::new(ax * of.x, ay * of.y, of.z).length();
        d * 0.5 / (light.z * long(eye) + eye.z * long(light))
    }

    /// α along and across the direction, by `KHR_materials_anisotropy`.
    pub(crate) fn stretched(roughness: f64, strength: f64) -> [f64; 2] {
        let alpha = roughness * roughness;
        [alpha * (1.0 - strength * strength) + strength * strength, alpha]
    }

    /// Facets spaced by the layer's distribution, and the solid angle of each: [`facets`] times
    /// the cosine of the facet is the same number for all.
    pub(crate) fn spaced([ax, ay]: [f64; 2], steps: usize) -> impl Iterator<Item = (DVec3, f64)> {
        let place = move |(i, j): (usize, usize)| {
            let u = (i as f64 + 0.5) / steps as f64;
            let (sin, cos) = (2.0 * PI * (j as f64 + 0.5) / steps as f64).sin_cos();
            let slope = (u / (1.0 - u)).sqrt();
            let h = DVec3::new(ax * slope * cos, ay * slope * sin, 1.0).normalize();
            let stretched = (h.x / ax).powi(2) + (h.y / ay).powi(2) + h.z * h.z;
            let density = h.z / (PI * ax * ay * stretched * stretched);
            (h, 1.0 / (density * (steps * steps) as f64))
        };
        (0..steps).flat_map(move |i| (0..steps).map(move |j| (i, j))).map(place)
    }

    /// E and B by another way: the BRDF over spaced facets.
    pub(crate) fn integrated(eye: DVec3, alphas: [f64; 2]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (h, solid_angle) in spaced(alphas, 400) {
            let light = h * 2.0 * eye.dot(h) - eye;
            if eye.dot(h) <= 0.0 || light.z <= 0.0 {
                continue;
            }
            let part = facets(alphas, eye, light) / PI * light.z * 4.0 * eye.dot(h) * solid_angle;
            sum[0] += part;
            sum[1] += part * (1.0 - eye.dot(h)).powi(5);
        }
        sum
    }

    /// E and B as the shaders read them.
    fn looked_up(mu: f64, roughness: f64, strength: f64, angle: f64) -> [f64; 2] {
        let place = [mu.sqrt(), roughness, strength];
        let at = [0, 1, 2].map(|side| place[side] * (SIDES[side] - 1) as f64);
        let first = [0, 1, 2].map(|side| (at[side] as usize).min(SIDES[side] - 2));
        let mut sum = [0.0; 2];
        let [along, across] = alphas(roughness, strength);
        let alpha = (along * angle.cos()).hypot(across * angle.sin());
        let part = ((alpha - across) / (along - across).max(1e-6)).clamp(0.0, 1.0);
        for corner in 0..8 {
            let step = [corner & 1, corner >> 1 & 1, corner >> 2];
            let share = |side: usize| {
                let part = at[side] - first[side] as f64;
                if step[side] == 1 { part } else { 1.0 - part }
            };
            let [x, y, z] = [0, 1, 2].map(|side| first[side] + step[side]);
            let texel = table()[(z * SIDES[1] + y) * SIDES[0] + x];
            let weight = share(0) * share(1) * share(2);
            for (sum, [across, between, along]) in sum.iter_mut().zip(texel) {
                let rest = 1.0 - part;
                let ends = across * rest * (rest - part) + along * part * (part - rest);
                *sum += weight * (ends + between * 4.0 * part * rest);
            }
        }
        sum
    }

    #[test]
    fn the_table_holds_what_the_brdf_integrates_to() {
        let mut worst = [0.0f64; 2];
        for (roughness, strength) in [(0.2, 0.5), (0.3, 1.0), (0.5, 0.3), (0.77, 0.8), (1.0, 0.6)] {
            for mu in [0.15, 0.3, 0.55, 0.8, 1.0] {
                for angle in [0.0, 0.5, FRAC_PI_4, 1.2, FRAC_PI_2] {
                    let flat = (1.0f64 - mu * mu).sqrt();
                    let eye = DVec3::new(flat * angle.cos(), flat * angle.sin(), mu);
                    let [e, b] = looked_up(mu, roughness, strength, angle);
                    let wanted = integrated(eye, stretched(roughness, strength));
                    let off = [(e / wanted[0] - 1.0).abs(), (b - wanted[1]).abs()];
                    worst = [worst[0].max(off[0]), worst[1].max(off[1])];
                    let name = format!("{mu}, {roughness}, {strength}, {angle}");
                    assert!(off[0] < 0.02, "{e} instead of {wanted:?} at {name}");
                    assert!(off[1] < 0.015, "{b} instead of {wanted:?} at {name}");
                }
            }
        }
        println!("E is off by {} at most, B by {}", worst[0], worst[1]);
    }

    #[test]
    fn without_strength_it_is_the_albedo_of_one_roughness() {
        for (mu, roughness) in [(0.2, 0.3), (0.6, 0.6), (0.9, 1.0)] {
            let (got, wanted) = (
                looked_up(mu, roughness, 0.0, 0.7),
                crate::albedo::tests::integrated(mu, roughness),
            );
            assert!((got[0] / wanted[0] - 1.0).abs() < 0.01, "{got:?} instead of {wanted:?}");
        }
    }
}
