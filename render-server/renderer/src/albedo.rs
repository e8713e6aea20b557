//! Directional albedo of the microfacet layer of glTF's materials: a table for the shaders, made
//! from the BRDF by quadrature.
//!
//! The layer is GGX with the height-correlated Smith term V and Schlick's Fresnel term
//! `F = f0 + (f90 - f0) c⁵`, with `c = 1 - v·h` (glTF 2.0, appendix B). Under a radiance of 1 from
//! all sides it reflects `f0 E + (f90 - f0) B`, where `E(μ, roughness)` is the integral of
//! `D V (n·l)` over the directions l, B the same with the factor c⁵, and μ = n·v.
//!
//! E is the part that leaves after one reflection. The rest, 69 % for a rough metal that is seen
//! from the front, meets more facets, which the model leaves out. The shaders multiply the layer
//! by `1 + f0 (1 / E - 1)`: E. Turquin, "Practical multiple scattering compensation for microfacet
//! models" (2019), as three.js and Filament do. At f0 = f90 = 1 this gives E · 1 / E = 1: what
//! absorbs nothing is as bright as its surroundings.
//!
//! A fraction of metal mixes the results of both materials, as appendix B does. F is linear in f0
//! and f90, so one f0 and one f90 hold the mix, each part with its own compensation:
//! `f0 = (1 - m) k_d 0.04 + m k_m color` and `f90 = (1 - m) k_d + m k_m`. Below the layer is only
//! the dielectric's diffuse light: it is weakened by the dielectric's F, and not by that of the
//! mix, which takes up to half of it (KhronosGroup/glTF issue 2386). For a light this is 1 - F,
//! for surroundings 1 less the layer's whole albedo.

use std::f64::consts::PI;
use std::sync::OnceLock;

use super::gpu::Gpu;
use super::sheen_albedo;
use super::tone::f16_bits;

/// Entries along each side: rows by roughness from 0 to 1, columns by √μ from 0 to 1. Linear
/// interpolation is off by 0.06 % on average, by 3 % where both are below 0.1. Twin of
/// `ALBEDO_SIDE` in `include/surface.wgsl`.
const SIDE: usize = 32;

/// Places along the radius and along the half circle at which one entry is evaluated.
const NODES: usize = 16;

/// Minimum of GGX's α, which is roughness squared; twin of `ALPHA_MIN` in the shaders.
pub(crate) const ALPHA_MIN: f64 = 0.002;

/// Minimum of μ, as in the shaders.
pub(crate) const MU_MIN: f64 = 1e-4;

/// The table on the GPU: E in red, B in green; in blue that of [`sheen_albedo`].
pub(crate) fn texture(gpu: &Gpu) -> wgpu::TextureView {
    let side = SIDE as u32;
    let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("albedo/texture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let texels = table().iter().zip(sheen_table()).map(|([e, b], sheen)| [*e, *b, *sheen, 1.0]);
    let bits: Vec<u16> = texels.flatten().map(f16_bits).collect();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(8 * side),
        rows_per_image: None,
    };
    gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&bits), layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Linear and clamped to the edges.
pub(crate) fn sampler(gpu: &Gpu) -> wgpu::Sampler {
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("albedo/sampler"),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

/// All entries, made once in a process: about 20 ms.
fn table() -> &'static [[f64; 2]] {
    static TABLE: OnceLock<Vec<[f64; 2]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let nodes = gauss_legendre();
        (0..SIDE * SIDE).map(place).map(|[mu, roughness]| albedo(mu, roughness, &nodes)).collect()
    })
}

/// The entries of fibres, made once in a process: about 10 ms.
fn sheen_table() -> &'static [f64] {
    static TABLE: OnceLock<Vec<f64>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let nodes = gauss_legendre();
        let entry = |[mu, roughness]: [f64; 2]| sheen_albedo::albedo(mu, roughness, &nodes);
        (0..SIDE * SIDE).map(place).map(entry).collect()
    })
}

/// μ and roughness of an entry.
fn place(at: usize) -> [f64; 2] {
    let part = |index: usize| index as f64 / (SIDE - 1) as f64;
    [part(at % SIDE).powi(2), part(at / SIDE)]
}

/// E and B. Facets are chosen by how much of them is visible: E. Heitz, "Sampling the GGX
/// Distribution of Visible Normals" (2018), whose disk is covered by `nodes` along the squared
/// radius and evenly around; its halves are mirror images. Each facet counts with the part of
/// its light that no other facet catches, G₂ / G₁.
fn albedo(mu: f64, roughness: f64, nodes: &[[f64; 2]]) -> [f64; 2] {
    let alpha = (roughness * roughness).max(ALPHA_MIN);
    let mu = mu.max(MU_MIN);
    let across = (1.0 - mu * mu).max(0.0).sqrt();
    // The view in the space where facets are a hemisphere.
    let length = (alpha * across).hypot(mu);
    let (x, z) = (alpha * across / length, mu / length);
    let visible = f64::midpoint(1.0, z);
    let mut sum = [0.0; 2];
    for &[radius_squared, weight] in nodes {
        for step in 0..NODES {
            let angle = PI * ((step as f64 + 0.5) / NODES as f64 - 0.5);
            let (sin, cos) = angle.sin_cos();
            let a = radius_squared.sqrt() * cos;
            let rim = (1.0 - a * a).max(0.0).sqrt();
            let b = (1.0 - visible) * rim + visible * radius_squared.sqrt() * sin;
            let c = (1.0 - a * a - b * b).max(0.0).sqrt();
            let facet = [alpha * (x * c - z * b), alpha * a, (x * b + z * c).max(0.0)];
            let size = facet.iter().map(|n| n * n).sum::<f64>().sqrt();
            let v_dot_h = ((across * facet[0] + mu * facet[2]) / size).clamp(0.0, 1.0);
            let n_dot_l = 2.0 * v_dot_h * facet[2] / size - mu;
            if n_dot_l <= 0.0 {
                continue;
            }
            let shadow = 1.0 + smith(mu, alpha);
            let kept = weight / NODES as f64 * shadow / (shadow + smith(n_dot_l, alpha));
            sum[0] += kept;
            sum[1] += kept * (1.0 - v_dot_h).powi(5);
        }
    }
    sum
}

/// Smith's Λ of GGX: Heitz, "Understanding the Masking-Shadowing Function" (2014), equation 72.
fn smith(cos: f64, alpha: f64) -> f64 {
    let tan_squared = (1.0 - cos * cos).max(0.0) / (cos * cos);
    f64::midpoint(-1.0, (1.0 + alpha * alpha * tan_squared).sqrt())
}

/// Places from 0 to 1 and weights, which add up to 1: zeros of a Legendre polynomial by Newton's
/// method.
pub(crate) fn gauss_legendre() -> Vec<[f64; 2]> {
    let count = NODES as f64;
    let node = |index: usize| {
        let mut x = (PI * (index as f64 + 0.75) / (count + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..8 {
            let (mut last, mut value) = (1.0, x);
            for degree in 2..=NODES {
                let degree = degree as f64;
                let next = ((2.0 * degree - 1.0) * x * value - (degree - 1.0) * last) / degree;
                (last, value) = (value, next);
            }
            slope = count * (x * value - last) / (x * x - 1.0);
            x -= value / slope;
        }
        [f64::midpoint(1.0, x), 1.0 / ((1.0 - x * x) * slope * slope)]
    };
    (0..NODES).map(node).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// E and B as the shaders read them.
    pub(crate) fn looked_up(mu: f64, roughness: f64) -> [f64; 2] {
        let last = (SIDE - 1) as f64;
        let (x, y) = (mu.sqrt() * last, roughness * last);
        let (column, row) = ((x as usize).min(SIDE - 2), (y as usize).min(SIDE - 2));
        let (u, v) = (x - column as f64, y - row as f64);
        [0, 1].map(|part| {
            let at = |dx: usize, dy: usize| table()[(row + dy) * SIDE + column + dx][part];
            (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v)
                + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v
        })
    }

    /// E and B by another way: the BRDF itself over a grid of facets, D (h) as glTF has it. The
    /// polar angle of h is spaced so that each step holds as much of GGX.
    pub(crate) fn integrated(mu: f64, roughness: f64) -> [f64; 2] {
        const STEPS: usize = 400;
        let alpha2 = roughness.powi(4);
        let across = (1.0 - mu * mu).sqrt();
        let mut sum = [0.0; 2];
        for i in 0..STEPS {
            // Cumulative distribution of D cos: cos² = (1 - u) / (1 + (α² - 1) u).
            let u = (i as f64 + 0.5) / STEPS as f64;
            let h_z2 = (1.0 - u) / (1.0 + (alpha2 - 1.0) * u);
            let (h_z, h_x) = (h_z2.sqrt(), (1.0 - h_z2).sqrt());
            for j in 0..STEPS {
                let angle = PI * (j as f64 + 0.5) / STEPS as f64;
                let v_dot_h = across * h_x * angle.cos() + mu * h_z;
                let n_dot_l = 2.0 * v_dot_h * h_z - mu;
                if v_dot_h <= 0.0 || n_dot_l <= 0.0 {
                    continue;
                }
                let lit = n_dot_l * (mu * mu * (1.0 - alpha2) + alpha2).sqrt();
                let seen = mu * (n_dot_l * n_dot_l * (1.0 - alpha2) + alpha2).sqrt();
                // D V (n·l) dl, with dl = 4 v·h dh; D (n·h) dh is what the grid spaces evenly.
                let part = 0.5 / (lit + seen) * n_dot_l * 4.0 * v_dot_h / h_z;
                let part = part / (STEPS * STEPS) as f64;
                sum[0] += part;
                sum[1] += part * (1.0 - v_dot_h).powi(5);
            }
        }
        sum
    }

    #[test]
    fn the_table_holds_what_the_brdf_integrates_to() {
        for roughness in [0.15, 0.3, 0.5, 0.77, 1.0] {
            for mu in [0.06, 0.2, 0.45, 0.8, 1.0] {
                let [e, b] = looked_up(mu, roughness);
                let wanted = integrated(mu, roughness);
                let name = format!("{e}, {b} instead of {wanted:?} at {mu}, {roughness}");
                assert!((e / wanted[0] - 1.0).abs() < 0.01, "{name}");
                assert!((b - wanted[1]).abs() < 0.004, "{name}");
            }
        }
    }

    /// GGX with the height-correlated Smith term, in f64: 1 − ln 2 at roughness 1 seen from above,
    /// and what comes back of light from all around, which a layer without compensation loses.
    #[test]
    fn a_single_reflection_loses_as_much_as_is_known() {
        let above = looked_up(1.0, 1.0)[0];
        assert!((above - (1.0 - 2f64.ln())).abs() < 0.002, "{above}");
        for (roughness, wanted) in
            [(0.1, 0.9996), (0.25, 0.9869), (0.5, 0.8824), (0.75, 0.6562), (1.0, 0.4091)]
        {
            let at = |n: i32| (f64::from(n) + 0.5) / 256.0;
            let parts = (0..256).map(|n| looked_up(at(n), roughness)[0] * at(n) * 2.0 / 256.0);
            let got: f64 = parts.sum();
            assert!((got - wanted).abs() < 0.002, "{got} instead of {wanted} at {roughness}");
        }
    }

    #[test]
    fn weights_of_the_quadrature_add_up_to_one() {
        let nodes = gauss_legendre();
        let sum = |power: i32| nodes.iter().map(|[at, by]| by * at.powi(power)).sum::<f64>();
        for power in 0..20 {
            assert!((sum(power) * f64::from(power + 1) - 1.0).abs() < 1e-12, "{power}");
        }
    }

    #[test]
    fn a_mirror_reflects_all_by_fresnels_share() {
        let [e, b] = looked_up(0.25, 0.0);
        assert!((e - 1.0).abs() < 0.002 && (b - 0.75f64.powi(5)).abs() < 0.003, "{e} {b}");
    }
}
