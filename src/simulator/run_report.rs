//! `report.json`: what a simulated wall did.

use polyptych_client::{SceneSummary, Statistics};
use polyptych_text::counted;
use serde::Serialize;

use crate::simulator::ending::Ending;
use crate::simulator::faults::FaultRecord;

/// Faults that a summary lists; the report has them all.
const FAULTS_SAID_MAX: usize = 20;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum EndOfRun {
    /// All frames were drawn that were asked for.
    Done,
    /// By Ctrl-C or SIGTERM.
    Interrupted,
    /// The user closed a window.
    WindowClosed,
}

impl From<Option<Ending>> for EndOfRun {
    fn from(ending: Option<Ending>) -> Self {
        match ending {
            None => Self::Done,
            Some(Ending::Interrupted) => Self::Interrupted,
            Some(Ending::WindowClosed) => Self::WindowClosed,
        }
    }
}

/// The whole report. Times say their unit; spreads are over the frames of the run.
#[derive(Debug, Serialize)]
pub(crate) struct RunReport {
    /// The wall's name.
    pub wall: String,
    /// The scene's name.
    pub scene: String,
    /// The parts of the scene that are not drawn as its file has them.
    pub notes: Vec<String>,
    /// The adapters of the channels, each once.
    pub adapter: String,
    /// Why the run ended.
    pub ended: EndOfRun,
    /// Times that a server was started again.
    pub restarts: u64,
    /// Channels of which the last picture is missing, with the reason.
    pub missing: Vec<(String, String)>,
    /// The faults that happened on purpose, and their effects.
    pub faults: Vec<FaultRecord>,
    /// Faults beyond those that are recorded.
    pub faults_unrecorded: u64,
    /// The manager's measurements, for the wall and for each channel.
    #[serde(flatten)]
    pub statistics: Statistics,
}

impl RunReport {
    pub fn new(wall: &str, scene: &SceneSummary, statistics: Statistics) -> Self {
        let mut adapters: Vec<String> = Vec::new();
        for adapter in statistics.channels.iter().filter_map(|c| c.adapter.clone()) {
            if !adapters.contains(&adapter) {
                adapters.push(adapter);
            }
        }
        Self {
            wall: wall.to_owned(),
            scene: scene.name.clone(),
            notes: scene.notes.clone(),
            adapter: adapters.join(", "),
            ended: EndOfRun::Done,
            restarts: 0,
            missing: Vec::new(),
            faults: Vec::new(),
            faults_unrecorded: 0,
            statistics,
        }
    }

    /// Returns the times of the frames as text for people. Times of what was never drawn are left
    /// out.
    pub fn summary(&self) -> String {
        let all = &self.statistics;
        let times = if all.draw_ms.count == 0 {
            "no channel drew in time".to_owned()
        } else {
            let (draw_ms, barrier_us) = (all.draw_ms.p50, all.barrier_us.p50);
            let skew_us = all.swap_skew_us.p50;
            format!("drawing {draw_ms:.1} ms, barrier {barrier_us:.0} µs, skew {skew_us:.0} µs")
        };
        let (frames, frame_ms) = (all.frames, all.frame_ms);
        format!(
            "{} in {:.1} s, shown by all channels: {} of {frames}; {:.1} ms a frame (p95 {:.1}), \
             {times}, late {}",
            counted(frames, "frame"),
            all.seconds,
            all.complete,
            frame_ms.p50,
            frame_ms.p95,
            all.late
        )
    }

    /// Returns the effects of faults as text for people: a line for each fault, then one for each
    /// channel.
    pub fn fault_lines(&self) -> impl Iterator<Item = String> {
        let faults = self.faults.iter().take(FAULTS_SAID_MAX).map(FaultRecord::line);
        let more = self.faults.len().saturating_sub(FAULTS_SAID_MAX);
        let more = (more > 0).then(|| format!("{} in report.json", counted(more, "more fault")));
        let channels = self.statistics.channels.iter().map(|channel| {
            format!(
                "channel {}: {}, longest gap {:.0} ms, late {}",
                channel.name,
                format!("{:?}", channel.state).to_lowercase(),
                channel.longest_gap_ms,
                channel.late
            )
        });
        faults.chain(more).chain(channels)
    }
}
