//! The brightness of what a channel shows: counts of its pixels by luminance.

use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use crate::ids::{Epoch, FrameId};

/// Counts for each doubling of luminance: an average over them is within an eighth of a stop.
const COUNTS_PER_STOP: f64 = 4.0;

/// The luminance below which the first count is, in stops; all of glTF's and of the sun's lies
/// above.
const STOPS_MIN: f64 = -40.0;

/// Number of counts: up to 40 stops.
pub const LUMINANCE_COUNTS: usize = 320;

/// The brightness of a channel's pixels in one frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameLuminance {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// The frame.
    pub frame: FrameId,
    /// The channel.
    pub channel: ChannelId,
    /// Numbers of pixels by [`luminance_index`], the darkest first.
    pub counts: Vec<u32>,
}

/// Returns the count to which a pixel of this luminance belongs, in the scene's own units; the
/// first or the last one where it is out of their range, and `None` for a black pixel.
pub fn luminance_index(luminance: f32) -> Option<usize> {
    let index = (f64::from(luminance).log2() - STOPS_MIN) * COUNTS_PER_STOP;
    (luminance > 0.0).then(|| (index.max(0.0) as usize).min(LUMINANCE_COUNTS - 1))
}

/// Returns the luminance in the middle of a count, in stops: its logarithm to base 2.
pub fn luminance_stops(index: usize) -> f64 {
    (index as f64 + 0.5) / COUNTS_PER_STOP + STOPS_MIN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_luminance_is_counted_within_an_eighth_of_a_stop() {
        for luminance in [1e-6f32, 0.18, 0.25, 1.0, 3.3, 60000.0, 1e9] {
            let index = luminance_index(luminance).expect("counted");
            let off = luminance_stops(index) - f64::from(luminance).log2();
            assert!(off.abs() <= 0.125 + 1e-6, "{luminance}: {off}");
        }
        for none in [0.0, -1.0, f32::NAN] {
            assert_eq!(luminance_index(none), None);
        }
        assert_eq!(luminance_index(1e-30), Some(0));
        assert_eq!(luminance_index(f32::INFINITY), Some(LUMINANCE_COUNTS - 1));
    }
}
