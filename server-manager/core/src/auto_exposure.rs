//! Automatic exposure: one factor for the whole wall, by what its channels show.
//!
//! Some frames are metered: once they are shown, each channel counts its pixels by luminance, which
//! no frame waits for. When all have, or the next frame is metered, the counts of all channels
//! together say what the exposure should be, and each frame goes a part of the way to it, by the
//! time that has passed. The first time it is there at once.

use std::collections::BTreeSet;

use polyptych_protocol::ids::FrameId;
use polyptych_protocol::luminance::{FrameLuminance, LUMINANCE_COUNTS, luminance_stops};
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use super::{Cluster, Micros, SessionId};

/// Time between two metered frames: eyes and cameras adapt slower.
const METERING_PERIOD: Micros = 250_000;

/// The display light that the metered mean becomes: a grey card, which reflects 18 %. Materials
/// are so shown about as they are, as the baker exposes scenes in real units for, too.
const MIDDLE_GREY: f64 = 0.18;

/// Shares of the pixels that do not count, the darkest and the brightest: unlit corners, and
/// lamps themselves.
const LEFT_OUT: [f64; 2] = [0.1, 0.05];

/// Time after which 63 % of a change are done, in seconds.
const ADAPTATION_S: f64 = 0.4;

/// A difference that nobody sees, in stops: half a level of 8 bits at middle grey.
const SAME_STOPS: f64 = 0.01;

/// Minimum distance from the exposure, in stops, at which a metered target may be wrong: channels
/// count light only up to 16 stops above white.
const UNSURE_STOPS: f64 = 8.0;

/// Range of an exposure in stops: that of what is counted.
const STOPS_MAX: f64 = 40.0;

/// The state of automatic exposure.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct AutoExposure {
    /// The exposure that suits the open scene, from which metering begins.
    pub suited: Option<f32>,
    /// Metered frames have set the exposure.
    has_adapted: bool,
    /// The exposure to go to, in stops.
    target: Option<f64>,
    /// The time of the last step towards `target`.
    adapted_at: Micros,
    metering: Option<Metering>,
    /// The time at which the last metered frame began.
    metered_at: Option<Micros>,
    /// The newest frame was not metered, though it shows a scene.
    is_unmetered: bool,
}

/// A frame that is metered.
#[derive(Debug, Serialize, Deserialize)]
struct Metering {
    frame: FrameId,
    /// Channels that have not answered.
    waited: BTreeSet<ChannelId>,
    /// Pixels by luminance, of all that have.
    counts: Vec<u64>,
}

impl AutoExposure {
    /// Forgets: what is shown next has nothing to do with it.
    pub fn restart(&mut self, suited: Option<f32>) {
        *self = Self { suited, ..Self::default() };
    }

    /// Returns whether the frame that begins on these channels is to be metered.
    fn begin(&mut self, now: Micros, frame: FrameId, channels: &[ChannelId]) -> bool {
        let is_due = self.metered_at.is_none_or(|at| now >= at + METERING_PERIOD);
        self.is_unmetered = !channels.is_empty() && !is_due;
        if channels.is_empty() || !is_due {
            return false;
        }
        // Those that are silent are left out.
        self.conclude();
        let counts = vec![0; LUMINANCE_COUNTS];
        let waited = channels.iter().copied().collect();
        self.metering = Some(Metering { frame, waited, counts });
        self.metered_at = Some(now);
        true
    }

    /// Takes what a channel has counted. Returns whether all have.
    fn add(&mut self, of: &FrameLuminance) -> bool {
        let Some(metering) = self.metering.as_mut().filter(|it| it.frame == of.frame) else {
            return false;
        };
        if metering.waited.remove(&of.channel) {
            for (sum, &count) in metering.counts.iter_mut().zip(&of.counts) {
                *sum += u64::from(count);
            }
        }
        metering.waited.is_empty()
    }

    /// Makes a target of what is known of the frame that is metered.
    fn conclude(&mut self) {
        let Some(metering) = self.metering.take() else { return };
        if let Some(mean) = mean_stops(&metering.counts) {
            self.target = Some((MIDDLE_GREY.log2() - mean).clamp(-STOPS_MAX, STOPS_MAX));
        }
    }

    /// Returns the exposure of a frame that begins now, and whether it is where it should be.
    fn step(&mut self, now: Micros, exposure: f32) -> (f32, bool) {
        let passed_s = now.saturating_sub(self.adapted_at) as f64 * 1e-6;
        self.adapted_at = now;
        let Some(target) = self.target else { return (exposure, true) };
        let stops = f64::from(exposure).log2();
        let way = target - stops;
        if !self.has_adapted {
            self.has_adapted = way.abs() < UNSURE_STOPS;
            // Metered once more where it was far off, to go there at once again.
            self.target = self.target.filter(|_| self.has_adapted);
            return (target.exp2() as f32, true);
        }
        if way.abs() <= SAME_STOPS {
            return (exposure, true);
        }
        let stops = stops + way * -(-passed_s / ADAPTATION_S).exp_m1();
        (stops.exp2() as f32, (target - stops).abs() <= SAME_STOPS)
    }
}

/// The mean of the pixels that count, in stops of luminance; `None` where all are black.
fn mean_stops(counts: &[u64]) -> Option<f64> {
    let all: u64 = counts.iter().sum();
    if all == 0 {
        return None;
    }
    let [low, high] = [LEFT_OUT[0], 1.0 - LEFT_OUT[1]].map(|share| share * all as f64);
    let (mut passed, mut sum) = (0.0, 0.0);
    for (index, &count) in counts.iter().enumerate() {
        let end = passed + count as f64;
        sum += (end.min(high) - f64::max(passed, low)).max(0.0) * luminance_stops(index);
        passed = end;
    }
    Some(sum / (high - low))
}

impl Cluster {
    /// Exposes the wall by what it shows.
    pub(super) fn set_automatic_exposure(&mut self, now: Micros) {
        if !self.presentation.is_exposure_automatic {
            self.presentation.is_exposure_automatic = true;
            self.auto_exposure.restart(self.auto_exposure.suited);
            self.presentation.exposure = self.auto_exposure.suited.unwrap_or(1.0);
        }
        self.wants_frame |= !self.pacer.is_soon(now);
    }

    /// Sets the exposure of the frame that begins on these channels; returns whether it is to be
    /// metered.
    pub(super) fn expose(&mut self, now: Micros, channels: &[ChannelId]) -> bool {
        if !self.presentation.is_exposure_automatic {
            return false;
        }
        // Nothing could be metered in the dark.
        if self.presentation.exposure <= 0.0 {
            self.presentation.exposure = self.auto_exposure.suited.unwrap_or(1.0);
        }
        let exposure = self.presentation.exposure;
        let (exposure, is_there) = self.auto_exposure.step(now, exposure);
        self.presentation.exposure = exposure;
        let shows_scene = self.shown.scene.is_some() && self.presentation.pattern.is_none();
        let channels = if shows_scene { channels } else { &[] };
        self.wants_frame |= !is_there && !channels.is_empty() && !self.pacer.is_soon(now);
        self.auto_exposure.begin(now, self.frame, channels)
    }

    pub(super) fn handle_luminance(&mut self, now: Micros, from: SessionId, of: &FrameLuminance) {
        let is_its = of.epoch == self.epoch && self.registry.owns_channel(from, of.channel);
        if is_its && self.presentation.is_exposure_automatic && self.auto_exposure.add(of) {
            self.auto_exposure.conclude();
            let stops = f64::from(self.presentation.exposure).log2();
            let is_off = |target: f64| (target - stops).abs() > SAME_STOPS;
            let wants = self.auto_exposure.target.is_some_and(is_off);
            self.wants_frame |= wants && !self.pacer.is_soon(now);
            self.advance_frame(now);
        }
    }

    /// Returns the time at which the newest frame is metered after all, on a wall that draws on
    /// request only; `None` if there is nothing to meter.
    pub(super) fn next_metering(&self) -> Option<Micros> {
        let state = &self.auto_exposure;
        let waits = self.presentation.is_exposure_automatic && state.is_unmetered;
        let begun = state.metered_at.filter(|_| waits && self.pacer.pace().is_none())?;
        Some(begun + METERING_PERIOD)
    }

    /// Asks for a frame that is metered, where it is time.
    pub(super) fn meter_at_last(&mut self, now: Micros) {
        if self.next_metering().is_some_and(|at| now >= at) {
            self.auto_exposure.is_unmetered = false;
            self.wants_frame = true;
        }
    }
}
