//! LDR-FLIP, the difference that a viewer sees who alternates between two pictures: P. Andersson,
//! J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström and M. Fairchild, *FLIP: A Difference
//! Evaluator for Alternating Images*, Proceedings of the ACM on Computer Graphics and Interactive
//! Techniques 3.2 (2020), article 15.
//!
//! Equal pictures have 0, and the largest difference is 1. Section numbers are those of the paper.

mod color;
mod filter;

use std::f64::consts::PI;
use std::sync::LazyLock;

use rayon::prelude::*;

use color::{Lab, hunt_lab, ycxcz_from_srgb};
use filter::{Gaussian, Plane};

/// Pixels per degree of a 0.7 m wide display of 3,840 pixels, seen from 0.7 m: what the paper uses.
pub(super) const PIXELS_PER_DEGREE: f64 = 0.7 * (3840.0 / 0.7) * (PI / 180.0);

/// Contrast sensitivity to light, red-green and blue-yellow as sums of Gaussians of the form
/// a √(π/b) exp(-π² x²/b), x in degrees; a and b of section 4.1.1.
const SENSITIVITY: [&[(f64, f64)]; 3] =
    [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];

/// The widest b of [`SENSITIVITY`], which all filters are cut off by.
const WIDEST: f64 = 0.04;

/// Exponent of colour differences, q_c of section 4.1.3.
const COLOR_EXPONENT: f32 = 0.7;

/// The share p_c of the largest colour difference below which differences are spread over the
/// errors up to p_t; section 4.1.3.
const COLOR_KNEE: (f32, f32) = (0.4, 0.95);

/// Width of features that viewers notice most, w of section 4.2, in degrees.
const FEATURE_WIDTH_DEGREES: f64 = 0.082;

/// Mean and 99th percentile of the errors of all pixels, from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub(super) struct FlipError {
    /// The mean over all pixels.
    pub mean: f64,
    /// The error that 99 of 100 pixels do not exceed.
    pub p99: f64,
}

/// A picture as a viewer perceives it: what FLIP compares.
#[derive(Debug)]
pub(super) struct PerceivedImage {
    /// Colours, without details too fine to be seen.
    colors: Vec<Lab>,
    /// Strength of edges and of points at each pixel.
    features: Vec<[f32; 2]>,
}

impl PerceivedImage {
    /// Filters an RGBA8 picture in sRGB, `width` pixels a row, as it is seen with so many pixels
    /// per degree. Alpha is ignored.
    pub fn new(rgba: &[u8], width: u32, pixels_per_degree: f64) -> Self {
        let pixels: Vec<[f32; 3]> =
            rgba.par_chunks_exact(4).map(|p| ycxcz_from_srgb([p[0], p[1], p[2]])).collect();
        let plane = |channel: usize| {
            let values = pixels.par_iter().map(|pixel| pixel[channel]).collect();
            Plane { values, width: width as usize }
        };
        let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
        let [y, cx, cz] = [0, 1, 2].map(|channel| {
            blurred(&plane(channel), SENSITIVITY[channel], radius, pixels_per_degree)
        });
        let filtered = (y.par_iter(), cx.par_iter(), cz.par_iter());
        let colors = filtered.into_par_iter().map(|(y, cx, cz)| hunt_lab([*y, *cx, *cz])).collect();
        Self { colors, features: features(&plane(0), pixels_per_degree) }
    }

    /// Returns the errors between this picture and another one of the same size.
    pub fn difference(&self, other: &Self) -> FlipError {
        let mut errors: Vec<f32> = (&self.colors, &self.features, &other.colors, &other.features)
            .into_par_iter()
            .map(|(color, feature, other_color, other_feature)| {
                let by_color = color_error(color.hyab_distance(*other_color));
                by_color.powf(1.0 - feature_error(*feature, *other_feature))
            })
            .collect();
        if errors.is_empty() {
            return FlipError::default();
        }
        let mean = errors.iter().map(|&e| f64::from(e)).sum::<f64>() / errors.len() as f64;
        let rank = (errors.len() * 99).div_ceil(100) - 1;
        let (_, p99, _) = errors.select_nth_unstable_by(rank, f32::total_cmp);
        FlipError { mean, p99: f64::from(*p99) }
    }
}

/// Returns a channel without what a viewer cannot resolve.
fn blurred(plane: &Plane, terms: &[(f64, f64)], radius: usize, pixels_per_degree: f64) -> Vec<f32> {
    let gaussians: Vec<(f64, Gaussian)> = terms
        .iter()
        .map(|&(a, b)| {
            // exp(-π² x²/b) has the standard deviation √(b / 2) / π.
            let gaussian = Gaussian::new((b / 2.0).sqrt() / PI * pixels_per_degree, radius);
            (a * (PI / b).sqrt() * gaussian.sum().powi(2), gaussian)
        })
        .collect();
    let total: f64 = gaussians.iter().map(|(weight, _)| weight).sum();
    let mut sum = vec![0.0; plane.values.len()];
    for (weight, gaussian) in gaussians {
        let smooth = gaussian.smoothing();
        let part = plane.filtered(&smooth, &smooth);
        let factor = (weight / total) as f32;
        sum.par_iter_mut().zip(&part.values).for_each(|(sum, value)| *sum += factor * value);
    }
    sum
}

/// Returns the strength of edges and points of a picture by its light, Y of YCxCz.
fn features(light: &Plane, pixels_per_degree: f64) -> Vec<[f32; 2]> {
    // From 0 for black to 1 for white.
    let values = light.values.par_iter().map(|y| (y + 16.0) / 116.0).collect();
    let light = Plane { values, width: light.width };
    let deviation = 0.5 * FEATURE_WIDTH_DEGREES * pixels_per_degree;
    let gaussian = Gaussian::new(deviation, (3.0 * deviation).ceil() as usize);
    let smooth = gaussian.smoothing();
    let strength = |kernel: &[f32]| {
        let across = light.filtered(kernel, &smooth).values;
        let down = light.filtered(&smooth, kernel).values;
        across.into_par_iter().zip(down).map(|(x, y)| x.hypot(y)).collect::<Vec<f32>>()
    };
    let edges = strength(&gaussian.first_derivative());
    let points = strength(&gaussian.second_derivative());
    edges.into_par_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
}

/// Returns the error from 0 to 1 of a HyAB distance.
fn color_error(distance: f32) -> f32 {
    static LARGEST: LazyLock<f32> = LazyLock::new(|| {
        let [green, blue] = [[0, 255, 0], [0, 0, 255]].map(|c| hunt_lab(ycxcz_from_srgb(c)));
        green.hyab_distance(blue).powf(COLOR_EXPONENT)
    });
    let distance = distance.powf(COLOR_EXPONENT);
    let (knee, error_at_knee) = (COLOR_KNEE.0 * *LARGEST, COLOR_KNEE.1);
    if distance < knee {
        distance * (error_at_knee / knee)
    } else {
        error_at_knee + (distance - knee) / (*LARGEST - knee) * (1.0 - error_at_knee)
    }
}

/// Returns the error from 0 to 1 of edges and points; section 4.2.
fn feature_error(a: [f32; 2], b: [f32; 2]) -> f32 {
    let largest = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    (largest / std::f32::consts::SQRT_2).sqrt()
}

#[cfg(test)]
mod tests;
