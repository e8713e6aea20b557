//! `report.json`: a list of scenes, each with what it costs at every error bound.

use std::ffi::OsString;
use std::path::Path;

use polyptych_client::SceneSummary;
use polyptych_text::counted;
use polyptych_wall::ShadowFilter;
use serde::Serialize;
use time::OffsetDateTime;

use super::BenchmarkOptions;
use super::flip::FlipError;
use super::frame_samples::FrameCosts;
use super::load_step::LoadStepReport;
use super::peers::PeerReport;
use super::stage::Memory;

/// The command, the date and the machine of a run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RunInfo {
    /// The command as it was typed; bytes that are no text are replaced.
    pub command: String,
    /// The version of the program.
    pub version: &'static str,
    /// The start of the run, in UTC.
    pub date: String,
    /// The processor, as the system calls it.
    pub processor: String,
    /// Cores that the program may use.
    pub cores: usize,
    /// The operating system.
    pub system: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Frames that were timed for each setting in each repetition.
    pub frames: u32,
    pub repetitions: u32,
    /// Poses of which pictures were compared.
    pub poses: u32,
    /// The seed of random poses; `None` for those of the orbit.
    pub random_views: Option<u64>,
    /// Pixels along each side of a pixel in the pictures of which outlines were compared.
    pub supersampling: u32,
}

impl RunInfo {
    /// Describes a run of this process that begins now.
    pub fn new(options: &BenchmarkOptions) -> Self {
        let now = OffsetDateTime::now_utc();
        let (month, day) = (u8::from(now.month()), now.day());
        let (hour, minute) = (now.hour(), now.minute());
        Self {
            command: command_line(std::env::args_os()),
            version: env!("CARGO_PKG_VERSION"),
            date: format!("{}-{month:02}-{day:02} {hour:02}:{minute:02} UTC", now.year()),
            processor: processor().unwrap_or_else(|| std::env::consts::ARCH.into()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            system: std::env::consts::OS.into(),
            size: options.size,
            frames: options.frames,
            repetitions: options.repetitions,
            poses: options.poses,
            random_views: options.random_views,
            supersampling: options.supersampling,
        }
    }
}

/// A command as a shell reads it back. A path need not be text.
fn command_line(words: impl Iterator<Item = OsString>) -> String {
    words.map(|word| quoted(&word.to_string_lossy())).collect::<Vec<_>>().join(" ")
}

/// A word of a command as a shell reads it back.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// Returns the processor's name; `None` where the system has no such file.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// A scene: what it costs and how far its pictures are off, or why it could not be measured.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneReport {
    /// The scene's name.
    pub scene: String,
    /// The path of its file.
    pub file: String,
    /// Why it could not be measured; the lists below are empty then.
    pub error: Option<String>,
    /// Triangles of the whole scene, each instance counted.
    pub scene_triangles: u64,
    /// Parts of the scene that are not drawn as its file has them.
    pub notes: Vec<String>,
    /// The adapter that drew it.
    pub adapter: String,
    pub run: RunInfo,
    /// From full detail to the largest bound, on one channel.
    pub(super) bounds: Vec<BoundReport>,
    /// The costs of the wall without anything to draw: it shows an empty node instead of the scene.
    pub(super) empty_frame: Option<FrameCosts>,
    /// The geometry at full detail in one colour: without materials and lights.
    pub(super) flat_frame: Option<FrameCosts>,
    /// The reason why this could not be drawn.
    pub flat_error: Option<String>,
    /// The rate bound while the load doubles and halves.
    pub(super) load_step: Option<LoadStepReport>,
    /// Full detail, the same pixels cut into more channels.
    pub(super) channels: Vec<ChannelsReport>,
    /// Full detail, with more samples per pixel.
    pub(super) samples: Vec<SamplesReport>,
    /// Full detail, with each kind of shadows.
    pub(super) shadows: Vec<ShadowsReport>,
    /// Other renderers with the same scene, size and poses; this one as the kit ran it is among
    /// them. Empty without a kit.
    pub(super) peers: Vec<PeerReport>,
    /// Why the kit of other renderers failed.
    pub peers_error: Option<String>,
}

impl SceneReport {
    /// A scene of which nothing was measured yet.
    pub fn new(file: &Path, run: &RunInfo) -> Self {
        Self {
            scene: file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            file: file.display().to_string(),
            error: None,
            scene_triangles: 0,
            notes: Vec::new(),
            adapter: String::new(),
            run: run.clone(),
            bounds: Vec::new(),
            empty_frame: None,
            flat_frame: None,
            flat_error: None,
            load_step: None,
            channels: Vec::new(),
            samples: Vec::new(),
            shadows: Vec::new(),
            peers: Vec::new(),
            peers_error: None,
        }
    }

    /// A scene that could not be measured, with the reason.
    pub fn failed(file: &Path, run: &RunInfo, reason: String) -> Self {
        Self { error: Some(reason), ..Self::new(file, run) }
    }

    /// Returns what was measured, for people: one line for each error bound.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        self.bounds.iter().map(|bound| {
            let silhouette = match bound.silhouette_px {
                Some(px) => {
                    let poses = counted(bound.poses_outlined, "pose");
                    format!("{px:.2} px, within the bound in {} of {poses}", bound.poses_within)
                }
                None => "not seen in any pose".to_owned(),
            };
            format!(
                "{}: bound {} px: {:.1} ms a frame, {}, silhouette {silhouette}, FLIP {:.4}",
                self.scene,
                bound.error_bound_px,
                bound.frames.frame_ms,
                counted(bound.frames.triangles, "triangle"),
                bound.flip
            )
        })
    }

    /// Takes over what opening the scene has told.
    pub(super) fn describe(&mut self, summary: &SceneSummary, adapter: String) {
        self.scene.clone_from(&summary.name);
        self.scene_triangles = summary.triangles;
        self.notes.clone_from(&summary.notes);
        self.adapter = adapter;
    }
}

/// The costs of a frame at an error bound, and its measured error.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct BoundReport {
    /// The bound that was asked for, in pixels; 0 is full detail.
    pub error_bound_px: f64,
    #[serde(flatten)]
    pub frames: FrameCosts,
    #[serde(flatten)]
    pub memory: Memory,
    /// The largest measured distance between outlines at this bound and at full detail, in pixels;
    /// `None` if the scene fills the picture of every pose.
    pub silhouette_px: Option<f64>,
    /// Poses at which outlines are seen.
    pub poses_outlined: u32,
    /// Poses of these at which that distance is within the bound, up to the diagonal of a pixel of
    /// the pictures that are compared: both outlines are rounded to centres of pixels.
    pub poses_within: u32,
    /// The mean FLIP error against full detail, from 0 to 1.
    pub flip: f64,
    /// The FLIP error that 99 of 100 pixels do not exceed, in the worst pose.
    pub flip_p99: f64,
}

impl BoundReport {
    pub fn new(error_bound_px: f64) -> Self {
        Self { error_bound_px, ..Self::default() }
    }

    /// Takes the distances of outlines in pictures with `factor` pixels along each of the wall's.
    pub fn set_outlines(&mut self, distances: &[f64], factor: f64) {
        let px = |distance: &f64| distance / factor;
        self.silhouette_px = distances.iter().map(px).reduce(f64::max);
        self.poses_outlined = u32::try_from(distances.len()).unwrap_or(u32::MAX);
        let most = self.error_bound_px + std::f64::consts::SQRT_2 / factor;
        let within = |distance: &&f64| self.error_bound_px > 0.0 && px(distance) <= most;
        let exact = |distance: &&f64| **distance == 0.0;
        let within = distances.iter().filter(|d| within(d) || exact(d)).count();
        self.poses_within = u32::try_from(within).unwrap_or(u32::MAX);
    }

    pub fn set_flip(&mut self, error: FlipError) {
        (self.flip, self.flip_p99) = (error.mean, error.p99);
    }
}

/// The costs of a frame on a number of channels.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ChannelsReport {
    pub channels: u32,
    #[serde(flatten)]
    pub frames: FrameCosts,
}

/// The costs of a frame with a number of samples per pixel.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SamplesReport {
    pub samples: u32,
    #[serde(flatten)]
    pub frames: FrameCosts,
}

/// The costs of a frame with a kind of shadows.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ShadowsReport {
    pub shadows: ShadowFilter,
    #[serde(flatten)]
    pub frames: FrameCosts,
}

/// Returns a kind of shadows as people call it.
pub(super) fn shadows_name(shadows: ShadowFilter) -> &'static str {
    match shadows {
        ShadowFilter::Off => "no shadows",
        ShadowFilter::Hard => "hard shadows",
        ShadowFilter::Soft => "soft shadows",
        ShadowFilter::ContactHardening => "contact-hardening shadows",
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStringExt;

    use super::*;

    #[test]
    fn words_of_a_command_can_be_typed_again() {
        for (word, typed) in [
            ("bench", "bench"),
            ("a b.glb", "'a b.glb'"),
            ("it's", r"'it'\''s'"),
            ("", "''"),
            ("--size=1920x1080", "--size=1920x1080"),
        ] {
            assert_eq!(quoted(word), typed);
        }
    }

    #[test]
    fn a_path_that_is_no_text_is_named_in_the_command() {
        let path = OsString::from_vec(b"b\xff.glb".to_vec());
        let words = [OsString::from("bench"), path];
        assert_eq!(command_line(words.into_iter()), "bench 'b\u{fffd}.glb'");
    }
}
