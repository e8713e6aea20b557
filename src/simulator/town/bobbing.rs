//! The way in which boats ride at their berths: some motions, which all boats share.
//!
//! Every wave of a motion has a whole number of periods in [`LENGTH_S`], so that the animation goes
//! on where it began.

use glam::{Vec3, vec3};

use super::trig::sin_cos;

/// Seconds after which a motion begins anew.
pub(super) const LENGTH_S: f32 = 12.0;

/// Different motions.
pub(super) const MOTIONS: usize = 6;

/// Keys of a motion: 48 steps of a quarter of a second, and the first one again.
pub(super) const KEYS: usize = 49;

/// A pose of a boat in the space of its berth.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoatPose {
    /// Metres.
    pub translation: Vec3,
    /// A unit quaternion.
    pub rotation: [f32; 4],
}

/// The time of a key, in seconds.
pub(super) fn time_s(key: usize) -> f32 {
    key as f32 * LENGTH_S / (KEYS - 1) as f32
}

/// The pose of a motion at a key: up to 0.09 m up and down, 4° from side to side and 1.5° along.
pub(super) fn pose(motion: usize, key: usize) -> BoatPose {
    let at = (key % (KEYS - 1)) as f32 / (KEYS - 1) as f32;
    let phase = motion as f32 / MOTIONS as f32;
    let wave = |periods: f32, shift: f32| sin_cos(at * periods + shift).0;
    let heave = 0.06 * wave(3.0, phase) + 0.03 * wave(5.0, 2.0 * phase + 0.3);
    let drift = 0.04 * wave(1.0, phase + 0.5);
    // A small angle in turns, half of it for the quaternion.
    let roll = 0.5 * (0.008 * wave(4.0, phase + 0.2) + 0.003 * wave(7.0, phase));
    let pitch = 0.5 * 0.004 * wave(3.0, phase + 0.35);
    let ((roll_sine, roll_cosine), (pitch_sine, pitch_cosine)) = (sin_cos(roll), sin_cos(pitch));
    // The bow points to +X: rolled about X, then pitched about Z.
    let rotation = [
        pitch_cosine * roll_sine,
        pitch_sine * roll_sine,
        pitch_sine * roll_cosine,
        pitch_cosine * roll_cosine,
    ];
    BoatPose { translation: vec3(0.0, heave, drift), rotation }
}
