//! Quantiles of measurements.

use serde::{Deserialize, Serialize};

/// The distribution of a set of measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// The number of measurements.
    pub count: u64,
    /// Half are below.
    pub p50: f64,
    /// 95 of 100 are below.
    pub p95: f64,
    /// 99 of 100 are below.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

impl Quantiles {
    /// Returns the quantiles of these values: the quantile q is the smallest value such that at
    /// least the fraction q of all values does not exceed it. All are 0 if there are no values.
    pub fn from_samples(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let (count, max) = (sorted.len() as u64, sorted.last().copied().unwrap_or(0.0));
        Self { count, p50: at(0.5), p95: at(0.95), p99: at(0.99), max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let spread = Quantiles::from_samples((1..=100).rev().map(f64::from));
        let expected = Quantiles { count: 100, p50: 50.0, p95: 95.0, p99: 99.0, max: 100.0 };
        assert_eq!(spread, expected);
        assert_eq!(Quantiles::from_samples([]), Quantiles::default());
        assert_eq!(Quantiles::from_samples([7.0]).p50, 7.0);
    }
}
