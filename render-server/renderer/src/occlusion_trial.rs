//! Trials of leaving out what is hidden: a target keeps the way in which its frames are faster.

/// Frames before the first trial: the first ones fill caches.
const FIRST_TRIAL_AFTER: u32 = 4;

/// Frames of a trial. The first one does not know yet what was hidden before it; the last one is
/// measured.
const TRIAL_FRAMES: u32 = 2;

/// Frames from one trial to the next: at first, and at most, when trials have changed nothing. A
/// trial may cost twice a frame's time, which then is below one percent.
const TRIAL_PERIOD_MIN: u32 = 32;
const TRIAL_PERIOD_MAX: u32 = 256;

/// The share of the present time that the other way must save: less is noise.
const GAIN_MIN: f64 = 0.05;

/// The factor by which the time of frames changes where the view is another one, so that both ways
/// are compared anew.
const CHANGE_FACTOR: f64 = 1.5;

/// Such frames, one after the other, before both ways are compared anew: one alone is slow by
/// chance.
const CHANGED_FRAMES: u32 = 4;

/// The choice between both ways for one target.
#[derive(Debug)]
pub(crate) struct OcclusionTrial {
    is_culling: bool,
    /// Microseconds of the last frame that was no trial.
    last_us: Option<f64>,
    /// Microseconds of a frame of the faster way when the last trial ended; infinite before it.
    compared_us: f64,
    period: u32,
    until_trial: u32,
    trial_frames: u32,
    changed_frames: u32,
}

impl Default for OcclusionTrial {
    fn default() -> Self {
        Self {
            is_culling: true,
            last_us: None,
            compared_us: f64::INFINITY,
            period: TRIAL_PERIOD_MIN,
            until_trial: FIRST_TRIAL_AFTER,
            trial_frames: 0,
            changed_frames: 0,
        }
    }
}

impl OcclusionTrial {
    /// Returns whether the next frame leaves out what is hidden.
    pub fn is_culling(&self) -> bool {
        self.is_culling != self.is_under_way()
    }

    /// Returns whether the next frame is drawn in the way that was slower.
    pub fn is_under_way(&self) -> bool {
        self.trial_frames > 0
    }

    /// Takes the time of the frame that was drawn as [`Self::is_culling`] says.
    pub fn record(&mut self, frame_us: u64) {
        let frame_us = frame_us as f64;
        if self.trial_frames > 0 {
            self.trial_frames -= 1;
            if self.trial_frames == 0 {
                self.end_trial(frame_us);
            }
            return;
        }
        self.last_us = Some(frame_us);
        let is_other = frame_us > self.compared_us * CHANGE_FACTOR
            || frame_us * CHANGE_FACTOR < self.compared_us;
        let is_other = is_other && self.compared_us.is_finite();
        self.changed_frames = if is_other { self.changed_frames + 1 } else { 0 };
        if self.changed_frames >= CHANGED_FRAMES {
            (self.changed_frames, self.until_trial) = (0, 1);
        }
        self.until_trial = self.until_trial.saturating_sub(1);
        if self.until_trial == 0 {
            self.trial_frames = TRIAL_FRAMES;
        }
    }

    fn end_trial(&mut self, tried_us: f64) {
        let last_us = self.last_us.unwrap_or(f64::INFINITY);
        let is_better = tried_us < last_us * (1.0 - GAIN_MIN);
        if is_better {
            self.is_culling = !self.is_culling;
            self.period = TRIAL_PERIOD_MIN;
        } else {
            self.period = (self.period * 2).min(TRIAL_PERIOD_MAX);
        }
        self.compared_us = if is_better { tried_us } else { last_us };
        self.until_trial = self.period;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws frames that take so long with and without; returns how many were drawn with.
    fn run(trial: &mut OcclusionTrial, frames: u32, with_us: u64, without_us: u64) -> u32 {
        let mut drawn = 0;
        for _ in 0..frames {
            let is_culling = trial.is_culling();
            drawn += u32::from(is_culling);
            trial.record(if is_culling { with_us } else { without_us });
        }
        drawn
    }

    #[test]
    fn keeps_the_faster_way_and_tries_the_other_rarely() {
        let mut trial = OcclusionTrial::default();
        assert!(run(&mut trial, 1000, 10_000, 25_000) > 980);
        let mut trial = OcclusionTrial::default();
        assert!(run(&mut trial, 1000, 25_000, 10_000) < 25);
        let mut trial = OcclusionTrial::default();
        assert!(run(&mut trial, 1000, 10_000, 9_900) > 980, "a difference that is noise");
    }

    #[test]
    fn follows_a_view_that_changes() {
        let mut trial = OcclusionTrial::default();
        run(&mut trial, 600, 25_000, 10_000);
        assert!(run(&mut trial, 100, 20_000, 60_000) > 80, "a street after an overview");
        assert!(run(&mut trial, 100, 90_000, 60_000) < 20, "and an overview again");
    }
}
