//! `polyptych bench`: a report of speed against error, and what parts of the system cost.

mod barrier;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use polyptych_client::ERROR_PX_MAX;
use polyptych_text::counted;
use polyptych_wall::limits::CHANNEL_SIDE_MAX;

use super::bake_arguments::BakeArguments;
use super::{bound, one_line, say, simulate};
use crate::simulator::benchmark::{
    Benchmark, BenchmarkOptions, COLUMNS_MAX, PeerKit, RunInfo, SceneReport, grid_of, page,
};
use crate::simulator::ending::Ending;
use crate::simulator::local_wall::INTERRUPTED;
use crate::{logging, outputs};

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    part: Option<Part>,
    #[command(flatten)]
    report: ReportArguments,
}

#[derive(Debug, clap::Subcommand)]
enum Part {
    /// The frame barrier with stub servers on loopback, beside a raw TCP barrier
    Barrier(barrier::BarrierArguments),
}

#[derive(Debug, clap::Args)]
struct ReportArguments {
    /// The .gltf or .glb files to measure; without one, the generated town
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Where report.html and report.json go
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Pixels of the wall
    #[arg(long, value_name = "WxH", value_parser = super::wall::pixels)]
    #[arg(default_value = "1920x1080")]
    size: [u32; 2],
    /// Error bounds in pixels; 0, full detail, is always among them
    #[arg(long, value_name = "PX,...", value_delimiter = ',', value_parser = bound::error_px)]
    #[arg(default_value = "0.25,0.5,1,2,4,8")]
    error_bounds: Vec<f64>,
    /// Numbers of channels to cut the wall into; one channel is always measured
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = channels)]
    #[arg(default_value = "2,4,8")]
    channels: Vec<u32>,
    /// Frames to time for each setting in each round
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Rounds, in each of which all settings take turns
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Poses around the scene of which pictures are compared
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    poses: u32,
    /// Compare pictures from random places around and within the scene, in place of the orbit
    #[arg(long, value_name = "SEED")]
    random_views: Option<u64>,
    /// Pixels along each side of a pixel for comparing outlines
    #[arg(long, value_name = "N", default_value_t = 2)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=4))]
    supersampling: u32,
    /// Time other renderers too, by the program time.sh of this folder
    #[arg(long, value_name = "DIR")]
    peers: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.part {
        Some(Part::Barrier(barrier)) => barrier::run(barrier).map(|()| ExitCode::SUCCESS),
        None => report(&arguments.report),
    }
}

fn report(arguments: &ReportArguments) -> anyhow::Result<ExitCode> {
    let options = arguments.options()?;
    let find = |folder: &PathBuf| PeerKit::find(folder, arguments.out.join("peers"));
    let kit = arguments.peers.as_ref().map(find).transpose()?;
    outputs::make_folder(&arguments.out)?;
    arguments.files().iter().try_for_each(|file| outputs::check(file))?;
    let run = RunInfo::new(&options);
    let generated = [None];
    let named: Vec<Option<&Path>> = arguments.scenes.iter().map(|s| Some(s.as_path())).collect();
    let scenes = if named.is_empty() { &generated[..] } else { &named };
    let baker = arguments.bake.baker()?;
    let mut benchmark = Benchmark::new(&options, &run, baker, kit, scenes.len());
    let mut reports: Vec<SceneReport> = Vec::new();
    let mut ended = None;
    for scene in scenes {
        match simulate::shown(*scene).and_then(|shown| benchmark.measure(&shown)) {
            Ok(measured) => reports.push(measured),
            Err(error) => {
                ended = Ending::of(&error);
                if ended.is_some() {
                    break;
                }
                let file = scene.unwrap_or(Path::new("the generated town"));
                let reason = one_line(&error.context(file.display().to_string()));
                logging::say_failure("bench", &format!("error: {reason}"));
                reports.push(SceneReport::failed(file, &run, reason));
            }
        }
    }
    drop(benchmark);
    conclude(&reports, ended, arguments, &run)
}

/// Writes what was measured, and returns the exit code.
fn conclude(
    reports: &[SceneReport],
    ended: Option<Ending>,
    arguments: &ReportArguments,
    run: &RunInfo,
) -> anyhow::Result<ExitCode> {
    if let Some(ending) = ended {
        logging::say_failure("bench", &format!("{ending}; scenes measured: {}", reports.len()));
    }
    if !reports.is_empty() {
        let [json, html] = arguments.files();
        outputs::write(&json, &serde_json::to_vec_pretty(reports)?)?;
        outputs::write(&html, page(run, reports).as_bytes())?;
        reports.iter().flat_map(SceneReport::lines).try_for_each(say)?;
        say(format_args!("report: {}", html.display()))?;
    }
    if ended == Some(Ending::Interrupted) {
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let failed = reports.iter().filter(|report| report.error.is_some());
    let failed: Vec<&str> = failed.map(|report| report.file.as_str()).collect();
    if !failed.is_empty() {
        let (count, all) = (failed.len(), counted(reports.len(), "scene"));
        let files = failed.join(", ");
        bail!("{count} of {all} could not be measured, for the reasons above: {files}");
    }
    if let Some(reason) = reports.iter().find_map(|report| report.peers_error.as_ref()) {
        bail!("other renderers: {reason}");
    }
    Ok(ExitCode::SUCCESS)
}

impl ReportArguments {
    /// The files that a report is written to.
    fn files(&self) -> [PathBuf; 2] {
        ["report.json", "report.html"].map(|name| self.out.join(name))
    }

    /// Returns what is measured.
    ///
    /// # Errors
    /// A size that cannot be cut into the channels, or is too large for fine pictures.
    fn options(&self) -> anyhow::Result<BenchmarkOptions> {
        let [width, height] = self.size;
        let most = self.channels.iter().filter_map(|&count| grid_of(count));
        let [columns, rows] = most.fold([1, 1], |[a, b], [c, d]| [a.max(c), b.max(d)]);
        if width % columns != 0 || height % rows != 0 || width == 0 || height == 0 {
            bail!(
                "--size {width}x{height} cannot be cut into {columns} columns and {rows} rows of \
                 channels; give multiples of {columns} and {rows}, or fewer --channels"
            );
        }
        let side_max = CHANNEL_SIDE_MAX / self.supersampling;
        if width.max(height) > side_max {
            bail!(
                "--size {width}x{height} is too large: with --supersampling {} a side has at most \
                 {side_max} pixels",
                self.supersampling
            );
        }
        let bound_max_px = ERROR_PX_MAX / f64::from(self.supersampling);
        if let Some(bound_px) = self.error_bounds.iter().find(|px| **px > bound_max_px) {
            bail!(
                "--error-bounds {bound_px} is too large: with --supersampling {} a bound is at \
                 most {bound_max_px} pixels",
                self.supersampling
            );
        }
        // Adding 0 makes 0 of -0, which would be another bound.
        let mut bounds_px: Vec<f64> = self.error_bounds.iter().map(|px| px + 0.0).collect();
        bounds_px.push(0.0);
        bounds_px.sort_by(f64::total_cmp);
        bounds_px.dedup();
        let mut channel_counts = self.channels.clone();
        channel_counts.push(1);
        channel_counts.sort_unstable();
        channel_counts.dedup();
        Ok(BenchmarkOptions {
            size: self.size,
            bounds_px,
            channel_counts,
            frames: self.frames,
            repetitions: self.rounds,
            poses: self.poses,
            random_views: self.random_views,
            supersampling: self.supersampling,
        })
    }
}

/// A number of channels, as an argument.
fn channels(text: &str) -> Result<u32, String> {
    let number: u32 = text.parse().map_err(|_| format!("{text:?} is not a number of channels"))?;
    let max = COLUMNS_MAX * COLUMNS_MAX;
    let fits = grid_of(number).is_some();
    fits.then_some(number).ok_or_else(|| format!("{text} is not a power of two from 1 to {max}"))
}
