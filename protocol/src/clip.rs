//! Clips of the open scene: its animations, and how each is played.
//!
//! A clip is played as a function of scene time. On the wall's own clock it begins with the first
//! frame after the scene was opened; where clients give the time of a frame, it is at that time.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// An animation of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClipSummary {
    /// Its name in the file; may be empty or stand twice.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The time of its last key, in seconds.
    pub duration_s: f64,
    /// `true` where it is played unless something else is asked for.
    pub is_played: bool,
}

/// The state of a clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClipStatus {
    /// The clip.
    pub clip: ClipSummary,
    /// `true` while its time goes on.
    pub is_running: bool,
    /// `true` if it begins anew at its end.
    pub is_looping: bool,
    /// Its time in the last frame, in seconds since its beginning.
    pub time_s: f64,
    /// Seconds of it in a second of scene time; negative for backwards.
    pub speed: f64,
    /// Its part beside other clips; 0 for one that moves nothing.
    pub weight: f32,
}

/// A change of how clips are played, from the next frame on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipChange {
    /// A clip's name, or its number from 0 on; all that move something if not given.
    #[serde(default, deserialize_with = "text_of_peer")]
    pub clip: Option<String>,
    /// The change.
    pub action: ClipAction,
}

/// A change of one clip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ClipAction {
    /// Lets it go on. What is not given stays as it is.
    Play {
        /// See [`ClipStatus::speed`].
        speed: Option<f64>,
        /// See [`ClipStatus::weight`]. Clips that are named are played alone, at 1, unless this is
        /// given.
        weight: Option<f32>,
        /// See [`ClipStatus::is_looping`].
        is_looping: Option<bool>,
    },
    /// Holds it where it is.
    Pause,
    /// Puts it to a time, in seconds since its beginning.
    Seek(f64),
}
