//! Separable filters over planes of numbers.

use rayon::prelude::*;

/// One number for each pixel of a picture, row by row.
#[derive(Debug)]
pub(super) struct Plane {
    pub values: Vec<f32>,
    pub width: usize,
}

impl Plane {
    /// Returns the plane filtered by one kernel along its rows and another one along its columns.
    /// Beyond the border its outermost values go on.
    pub fn filtered(&self, along_rows: &[f32], along_columns: &[f32]) -> Self {
        self.filtered_rows(along_rows).filtered_columns(along_columns)
    }

    fn filtered_rows(&self, kernel: &[f32]) -> Self {
        let (width, radius) = (self.width.max(1), kernel.len() / 2);
        let mut values = vec![0.0; self.values.len()];
        let rows = values.par_chunks_exact_mut(width).zip(self.values.par_chunks_exact(width));
        rows.for_each_init(Vec::new, |padded, (filtered, row)| {
            padded.clear();
            padded.resize(radius, row[0]);
            padded.extend_from_slice(row);
            padded.resize(row.len() + 2 * radius, row[width - 1]);
            for (value, around) in filtered.iter_mut().zip(padded.windows(kernel.len())) {
                *value = around.iter().zip(kernel).map(|(value, weight)| value * weight).sum();
            }
        });
        Self { values, width: self.width }
    }

    fn filtered_columns(&self, kernel: &[f32]) -> Self {
        let (width, radius) = (self.width.max(1), kernel.len() / 2);
        let height = self.values.len() / width;
        let mut values = vec![0.0; self.values.len()];
        values.par_chunks_exact_mut(width).enumerate().for_each(|(y, filtered)| {
            for (tap, weight) in kernel.iter().enumerate() {
                let from = (y + tap).saturating_sub(radius).min(height - 1);
                let row = &self.values[from * width..(from + 1) * width];
                filtered.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
            }
        });
        Self { values, width: self.width }
    }
}

/// A Gaussian at whole pixels, with the maximum 1.
#[derive(Debug)]
pub(super) struct Gaussian {
    /// The standard deviation, in pixels.
    deviation: f64,
    radius: i32,
}

impl Gaussian {
    pub fn new(deviation: f64, radius: usize) -> Self {
        Self { deviation, radius: radius as i32 }
    }

    fn at(&self, x: f64) -> f64 {
        (-x * x / (2.0 * self.deviation * self.deviation)).exp()
    }

    fn samples(&self, of: impl Fn(f64) -> f64) -> Vec<f64> {
        (-self.radius..=self.radius).map(|x| of(f64::from(x))).collect()
    }

    /// Returns the sum of the samples.
    pub fn sum(&self) -> f64 {
        self.samples(|x| self.at(x)).iter().sum()
    }

    /// Returns the kernel that smooths: its weights add up to 1.
    pub fn smoothing(&self) -> Vec<f32> {
        let sum = self.sum();
        self.samples(|x| self.at(x) / sum).into_iter().map(|weight| weight as f32).collect()
    }

    /// Returns the kernel that finds edges.
    pub fn first_derivative(&self) -> Vec<f32> {
        balanced(&self.samples(|x| -x * self.at(x)))
    }

    /// Returns the kernel that finds points and lines.
    pub fn second_derivative(&self) -> Vec<f32> {
        let variance = self.deviation * self.deviation;
        balanced(&self.samples(|x| (x * x / variance - 1.0) * self.at(x)))
    }
}

/// Scales weights so that positive ones add up to 1 and negative ones to -1.
fn balanced(weights: &[f64]) -> Vec<f32> {
    let positive: f64 = weights.iter().filter(|weight| **weight > 0.0).sum();
    let negative: f64 = -weights.iter().filter(|weight| **weight < 0.0).sum::<f64>();
    let scaled = |&weight: &f64| weight / if weight > 0.0 { positive } else { negative };
    weights.iter().map(|weight| scaled(weight) as f32).collect()
}
