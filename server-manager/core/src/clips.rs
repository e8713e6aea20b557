//! Clips of the open scene: their times are functions of scene time, evaluated for every frame.
//!
//! A clip has two clocks, which differ in where they began: frames whose time a client gives have
//! the clip at that time, others go on from the first frame after the scene was opened. What a
//! client asks begins both anew from what the last frame showed. After a pause the wall's own clock
//! goes on from its last frame.

use polyptych_protocol::clip::{ClipAction, ClipChange, ClipStatus, ClipSummary};
use polyptych_scene::ClipTime;
use serde::{Deserialize, Serialize};

use super::Cluster;
use super::frame_request::FrameRequest;

/// The largest speed of a clip, either way: beyond it no frame shows what the one before did.
const SPEED_MAX: f64 = 1000.0;

/// The latest time that a clip is put to, in seconds: 30 years.
const SEEK_MAX_S: f64 = 1e9;

/// A clip as it is played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlayedClip {
    status: ClipStatus,
    /// The moment at which the wall's own clock began.
    own: Beginning,
    /// The moment at which the clock of clients began.
    given: Beginning,
    /// Its time in the last frame, which does not begin anew at its end.
    at_s: f64,
}

/// A moment of the clock of a clip or tour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beginning {
    /// Scene time in seconds; `None` before a frame has come.
    pub(super) scene_s: Option<f64>,
    /// The time of the clip or tour then, in seconds.
    pub(super) at_s: f64,
}

impl Beginning {
    /// Returns the time of the clip or tour in a frame at this scene time; it goes on by `speed`
    /// seconds in a second.
    fn at(&self, time_s: f64, speed: f64) -> f64 {
        // Finite times that are far apart can have an infinite difference, of which no part is 0.
        let passed_s = match self.scene_s {
            Some(scene_s) if speed != 0.0 => (time_s - scene_s) * speed,
            _ => 0.0,
        };
        (self.at_s + passed_s).clamp(-f64::MAX, f64::MAX)
    }

    /// Returns the time in a frame, with which the clock begins if it has not yet.
    pub(super) fn advance(&mut self, time_s: f64, speed: f64) -> f64 {
        self.scene_s.get_or_insert(time_s);
        self.at(time_s, speed)
    }

    /// Returns the clock that goes on with its next frame from what it showed at this scene time.
    pub(super) fn held(&self, time_s: f64, speed: f64) -> Self {
        Self { scene_s: None, at_s: self.at(time_s, speed) }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.at_s.is_finite() && self.scene_s.is_none_or(f64::is_finite)
    }
}

impl PlayedClip {
    fn new(clip: ClipSummary) -> Self {
        let weight = if clip.is_played { 1.0 } else { 0.0 };
        let status = ClipStatus {
            is_running: clip.is_played,
            is_looping: true,
            time_s: 0.0,
            speed: 1.0,
            weight,
            clip,
        };
        let own = Beginning { scene_s: None, at_s: 0.0 };
        Self { status, own, given: Beginning { scene_s: Some(0.0), at_s: 0.0 }, at_s: 0.0 }
    }

    /// Seconds of it in a second of scene time, 0 while it is held.
    fn speed(&self) -> f64 {
        if self.status.is_running { self.status.speed } else { 0.0 }
    }

    /// Goes on to a frame at this scene time.
    fn advance(&mut self, is_given: bool, time_s: f64) {
        let speed = self.speed();
        let clock = if is_given { &mut self.given } else { &mut self.own };
        self.at_s = clock.advance(time_s, speed);
        self.status.time_s = self.wrapped();
    }

    /// Its time, which begins anew at its end if it is a loop, and else stays there.
    fn wrapped(&self) -> f64 {
        let duration_s = self.status.clip.duration_s;
        if duration_s <= 0.0 {
            0.0
        } else if !self.status.is_looping || self.at_s == duration_s {
            self.at_s.clamp(0.0, duration_s)
        } else {
            self.at_s.rem_euclid(duration_s)
        }
    }

    /// Begins both clocks anew at a time of it; `given_s` is the last time that a client gave.
    fn begin_at(&mut self, at_s: f64, given_s: f64) {
        self.at_s = at_s;
        self.own = Beginning { scene_s: None, at_s };
        self.given = Beginning { scene_s: Some(given_s), at_s };
        self.status.time_s = self.wrapped();
    }

    /// The time from which it plays on, as its status has it: one that is over begins again.
    fn next_start_s(&self) -> f64 {
        let ClipStatus { clip, is_looping, time_s, speed, .. } = &self.status;
        if !is_looping && *speed > 0.0 && *time_s >= clip.duration_s {
            0.0
        } else if !is_looping && *speed < 0.0 && *time_s <= 0.0 {
            clip.duration_s
        } else {
            *time_s
        }
    }

    fn is_finite(&self) -> bool {
        let ClipStatus { clip, speed, weight, time_s, .. } = &self.status;
        let numbers = [clip.duration_s, *speed, f64::from(*weight), *time_s, self.at_s];
        numbers.iter().all(|number| number.is_finite())
            && self.own.is_finite()
            && self.given.is_finite()
    }
}

/// The clips of the open scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlayedClips {
    clips: Vec<PlayedClip>,
    /// The last scene time that a client gave.
    given_s: f64,
}

impl PlayedClips {
    /// The clips of a scene that was opened.
    pub(super) fn new(clips: &[ClipSummary]) -> Self {
        Self { clips: clips.iter().cloned().map(PlayedClip::new).collect(), given_s: 0.0 }
    }

    /// Returns whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.clips.is_empty()
    }

    /// The clips that a frame shows.
    pub(super) fn times(&self) -> Vec<ClipTime> {
        let shown = (0..).zip(&self.clips).filter(|(_, of)| of.status.weight > 0.0);
        let time = |(clip, of): (u32, &PlayedClip)| ClipTime {
            clip,
            time_s: of.status.time_s,
            weight: of.status.weight,
        };
        shown.map(time).collect()
    }

    /// Returns whether only the times differ.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let settings = |of: &PlayedClip| ClipStatus { time_s: 0.0, ..of.status.clone() };
        self.clips.iter().map(settings).eq(other.clips.iter().map(settings))
    }

    pub(super) fn advance(&mut self, is_given: bool, time_s: f64) {
        if is_given {
            self.given_s = time_s;
        }
        self.clips.iter_mut().for_each(|clip| clip.advance(is_given, time_s));
    }

    /// The state of each clip.
    pub(super) fn statuses(&self) -> Vec<ClipStatus> {
        self.clips.iter().map(|clip| clip.status.clone()).collect()
    }

    /// Returns the clips that a change is about.
    ///
    /// # Errors
    /// There is no such clip, with the names of those that are there.
    fn named(&self, name: Option<&str>) -> Result<Vec<usize>, String> {
        /// The number of names that are given: a line.
        const NAMES_MAX: usize = 12;
        if self.clips.is_empty() {
            return Err("the open scene has no animations".to_owned());
        }
        let Some(name) = name else {
            let all = 0..self.clips.len();
            return Ok(all.filter(|at| self.clips[*at].status.weight > 0.0).collect());
        };
        let by_name = self.clips.iter().position(|of| of.status.clip.name == name);
        let by_number = || name.parse().ok().filter(|at: &usize| *at < self.clips.len());
        by_name.or_else(by_number).map(|at| vec![at]).ok_or_else(|| {
            let title = |(at, of): (usize, &PlayedClip)| match of.status.clip.name.as_str() {
                "" => at.to_string(),
                name => format!("{at} ({name})"),
            };
            let names = self.clips.iter().enumerate().map(title).take(NAMES_MAX);
            let names = names.collect::<Vec<_>>().join(", ");
            let more = if self.clips.len() > NAMES_MAX { ", …" } else { "" };
            format!("there is no animation {name}; there are {names}{more}")
        })
    }

    /// Does what a client asks.
    ///
    /// # Errors
    /// There is no such clip, or a number is none that can be.
    fn change(&mut self, change: &ClipChange) -> Result<(), String> {
        check(&change.action)?;
        let chosen = self.named(change.clip.as_deref())?;
        let given_s = self.given_s;
        if let ClipAction::Play { weight: None, .. } = change.action
            && change.clip.is_some()
        {
            self.clips.iter_mut().for_each(|of| of.status.weight = 0.0);
        }
        for at in chosen {
            let of = &mut self.clips[at];
            let now_s = of.status.time_s;
            match change.action {
                ClipAction::Pause => {
                    of.status.is_running = false;
                    of.begin_at(now_s, given_s);
                }
                ClipAction::Seek(time_s) => of.begin_at(time_s, given_s),
                ClipAction::Play { speed, weight, is_looping } => {
                    let (named, was) = (change.clip.is_some(), of.status.weight);
                    of.status.speed = speed.unwrap_or(of.status.speed);
                    of.status.weight = weight.unwrap_or(if named { 1.0 } else { was });
                    of.status.is_looping = is_looping.unwrap_or(of.status.is_looping);
                    of.status.is_running = true;
                    of.begin_at(of.next_start_s(), given_s);
                }
            }
        }
        Ok(())
    }
}

/// # Errors
/// A number is none that can be, and what would be right.
fn check(action: &ClipAction) -> Result<(), String> {
    match *action {
        ClipAction::Seek(time_s) if !(0.0..=SEEK_MAX_S).contains(&time_s) => {
            Err(format!("an animation is put to 0 to {SEEK_MAX_S} seconds, not {time_s}"))
        }
        ClipAction::Play { speed: Some(speed), .. }
            if !(-SPEED_MAX..=SPEED_MAX).contains(&speed) =>
        {
            Err(format!("an animation's speed is {} to {SPEED_MAX}, not {speed}", -SPEED_MAX))
        }
        ClipAction::Play { weight: Some(weight), .. } if !(0.0..=1.0).contains(&weight) => {
            Err(format!("an animation's weight is 0 to 1, not {weight}"))
        }
        _ => Ok(()),
    }
}

impl Cluster {
    /// Changes how clips are played. A wall that is paused makes a frame for it.
    ///
    /// # Errors
    /// No scene is open, there is no such clip, or a number is none that can be.
    pub(super) fn change_clips(&mut self, change: &ClipChange) -> Result<(), String> {
        if self.shown.scene.is_none() {
            return Err("no scene is open; open one first".to_owned());
        }
        self.clips.change(change)?;
        self.wants_frame = true;
        Ok(())
    }

    /// Brings clips to the frame that begins. A frame that nobody has asked for shows what the last
    /// one did.
    pub(super) fn advance_clips(&mut self, order: Option<&FrameRequest>, time_s: f64) {
        if self.is_timed(order) {
            let is_given = order.is_some_and(|order| order.time_s.is_some());
            self.clips.advance(is_given, time_s);
        }
    }

    /// The clips as a wall goes on with them after a pause, or another life of the manager, whose
    /// scene time begins anew.
    pub(super) fn remembered_clips(&self) -> PlayedClips {
        let mut clips = self.clips.clone();
        for of in &mut clips.clips {
            of.own = of.own.held(self.pacer.own_s, of.speed());
        }
        clips
    }

    /// Takes over the clips of another life of the manager.
    pub(super) fn restore_clips(&mut self, remembered: &PlayedClips) {
        if remembered.clips.iter().all(PlayedClip::is_finite) && remembered.given_s.is_finite() {
            self.clips = remembered.clone();
        } else {
            tracing::warn!("the animations in the state file were dropped: not finite");
        }
    }
}
