//! `polyptych simulate`: a whole wall on one machine, with real processes.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use polyptych_client::blocking::{Client, Pending};
use polyptych_client::glam::DVec3;
use polyptych_client::{Bounds, Camera, QualityBounds, Request, Response, fit_bounds};
use polyptych_manager::recorder::Recorder;
use polyptych_text::counted;
use polyptych_wall::Wall;

use super::bake_arguments::BakeArguments;
use super::progress::ProgressReport;
use super::remote::{open_scene, point, say_notes};
use super::seen::Seen;
use super::surroundings::LookArguments;
use super::{
    bake_files, bound, cache_folder, http, load_wall, log_file_warnings, login, rate, say, seconds,
};
use crate::simulator::ending::Ending;
use crate::simulator::faults::{self, Fault, FaultHooks, Faults};
use crate::simulator::frame_series::FrameSeries;
use crate::simulator::local_wall::{INTERRUPTED, LocalWall, LocalWallOptions};
use crate::simulator::look::{Brightness, Look};
use crate::simulator::orbit;
use crate::simulator::run_page;
use crate::simulator::run_report::RunReport;
use crate::simulator::town::{TownExtras, TownOptions, generate};
use crate::simulator::verify::ReferenceScene;
use crate::{image_files, logging, outputs, progress};

/// Frames of a run, where nothing else is said.
const FRAMES_DEFAULT: u64 = 60;

/// Frames that are drawn before measuring begins: the first ones fill caches.
const WARM_UP_FRAMES: u64 = 3;

/// Time after which nothing is waited for that automatic exposure could measure: eight of its
/// periods. A scene may have nothing to measure.
const METERING_TIME_MAX: Duration = Duration::from_secs(2);

/// Time after which detail is not waited for that a budget holds too little of.
const DETAIL_TIME_MAX: Duration = Duration::from_secs(15);

/// The file with the picture of the whole wall.
const WALL_PICTURE: &str = "wall.png";

/// The file with what the run measured.
const REPORT: &str = "report.json";

/// The file with the measurements for people, with pictures and plots.
const REPORT_PAGE: &str = "report.html";

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    pub wall: PathBuf,
    /// The .gltf or .glb file to show; without one, the generated town
    pub scene: Option<PathBuf>,
    /// The scene of a file that has several, by its name or its number from 0 on [default: the one
    /// that the file names, or its first]
    #[arg(long = "scene", value_name = "NAME", requires = "scene")]
    pub scene_name: Option<String>,
    /// How many frames to draw [default: 60; with --windows, until a window is closed]
    #[arg(long, conflicts_with = "seconds", value_parser = clap::value_parser!(u64).range(1..))]
    pub frames: Option<u64>,
    /// How long to draw
    #[arg(long, value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Frames per second at most [default: as many as the wall can]
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub rate: Option<f64>,
    /// Scene time of the first frame, in seconds: animations are at that time
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = scene_time)]
    pub time: f64,
    /// Frames of a second of scene time, however long each takes [default: those of --rate, or 30]
    #[arg(long, value_name = "FPS", value_parser = rate)]
    pub fps: Option<f64>,
    /// Let the camera go round the scene, always as far from its middle
    #[arg(long)]
    pub orbit: bool,
    /// Let the camera go from one point to another in the course of the run, and look ahead: two
    /// points X,Y,Z, in world units
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"], value_parser = point)]
    #[arg(allow_hyphen_values = true, conflicts_with_all = ["orbit", "seconds", "windows"])]
    pub walk: Vec<DVec3>,
    /// Show a window for each channel. The mouse turns the scene (drag), moves it (drag with
    /// another button or Shift) and zooms (wheel). Closing a window ends the run
    #[arg(long)]
    pub windows: bool,
    #[command(flatten)]
    pub look: LookArguments,
    /// Draw coarser levels of detail where that moves no edge by more pixels of the wall than this
    #[arg(long, value_name = "PX", default_value_t = 0.0, value_parser = bound::error_px)]
    pub error_bound: f64,
    /// Allow more error as long as the wall draws fewer frames per second than this
    #[arg(long, value_name = "FPS", value_parser = bound::rate_fps)]
    pub rate_bound: Option<f64>,
    /// Draw what others hide, too: for measurements. The pictures are the same
    #[arg(long)]
    pub no_occlusion: bool,
    #[command(flatten)]
    pub bake: BakeArguments,
    /// Record what the manager is told, to be replayed
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Serve the page for browsers and the HTTP interface at http://ADDR/ while the wall runs
    #[arg(long, value_name = "ADDR", value_parser = http::address)]
    pub http: Option<String>,
    /// Where wall.png, channel-NAME.png and report.json go
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    /// Write the picture of the whole wall here too: .png or .jpg
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// That picture has half of the wall's pixels along each side
    #[arg(skip)]
    pub is_picture_halved: bool,
    /// What the generated town has besides
    #[arg(skip)]
    pub extras: TownExtras,
    /// Let something go wrong: "at 30 kill front-1-1", "every 500 stop 2s any"; may be given again
    #[arg(long, value_name = "FAULT", value_parser = faults::parse)]
    pub fault: Vec<Fault>,
    /// Chooses the channels of faults that hit any
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub fault_seed: u64,
}

impl Arguments {
    /// Returns the seconds of scene time from the first frame to another.
    fn seconds_of(&self, frame: u64) -> f64 {
        frame as f64 / self.fps.or(self.rate).unwrap_or(orbit::TIME_RATE)
    }
}

/// A scene time in seconds, as an argument.
pub(super) fn scene_time(text: &str) -> Result<f64, String> {
    /// Beyond 30 years a frame is no longer an exact step.
    const MAX: f64 = 1e9;
    let time: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    let is_time = (0.0..=MAX).contains(&time);
    is_time.then_some(time).ok_or_else(|| format!("a scene time is 0 to {MAX} seconds, not {text}"))
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let mut wall = load_wall(&arguments.wall)?;
    log_file_warnings(&bake_files(&mut wall, &arguments.wall, &arguments.bake.baker()?)?);
    simulate(&wall, arguments)
}

pub(super) fn simulate(wall: &Wall, arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let needs = FaultHooks::of(&arguments.fault, wall)?;
    if let Some(count) = frame_count(arguments)
        && let Some(late) = arguments.fault.iter().find(|fault| fault.first_frame() > count)
    {
        let frame = late.first_frame();
        bail!(
            "--fault: frame {frame} never comes: the run has {}; see --frames",
            counted(count, "frame")
        );
    }
    let out = &arguments.out;
    outputs::make_folder(out)?;
    // Known now, and not after a long run.
    for path in outputs_of(wall, out) {
        outputs::check(&path)?;
    }
    if let Some(picture) = &arguments.picture {
        image_files::check(picture)?;
    }
    let shown = shown_with(arguments.scene.as_deref(), arguments.extras)?;
    let folder = |file: &Path| file.parent().unwrap_or(Path::new("/")).to_owned();
    let mut scene_roots = vec![folder(&shown.file)];
    let look = arguments.look.look()?;
    scene_roots.extend(look.folder());
    let baker = arguments.bake.baker()?;
    let count = wall.channels.len();
    let (channels, screens) = (counted(count, "channel"), counted(wall.screens.len(), "screen"));
    say(format_args!("wall {}: {channels} on {screens}", wall.name))?;
    let options = LocalWallOptions {
        wall: wall.clone(),
        scene_roots,
        baker,
        windows: arguments.windows,
        culls_occluded: !arguments.no_occlusion,
        recorder: arguments.record.as_deref().map(Recorder::open).transpose()?,
        needs,
        http: arguments.http.as_deref().map(|at| http::bind(at, false, Vec::new())).transpose()?,
    };
    let http = options.http.as_ref().map(|http| http.listener.local_addr()).transpose()?;
    let spinner = step("starting the servers");
    let started = LocalWall::start(options);
    spinner.finish_and_clear();
    let local = match started {
        Ok(local) => local,
        Err(error) => return broken_off(error.downcast::<Ending>()?),
    };
    if let Some(address) = http {
        let link = login::link(&address.to_string(), &local.token)?;
        say(format_args!("the page is at {}; log in once: {link}", http::url(address, false)))?;
    }
    let driven = drive(&local, wall, (&shown, &look), arguments);
    match local.end.ending() {
        // What failed then failed for that reason.
        Some(ending) if !local.end.is_reported() => broken_off(ending),
        Some(Ending::Interrupted) => driven.map(|_| {
            logging::say_failure("simulate", "interrupted");
            ExitCode::from(INTERRUPTED)
        }),
        Some(Ending::WindowClosed) | None => driven,
    }
}

/// The files that a run writes. Screens of which each eye sees another picture have one more.
fn outputs_of(wall: &Wall, out: &Path) -> Vec<PathBuf> {
    let channels = wall.channels.iter().map(|channel| channel_file(&channel.name));
    let screens = wall.screens.iter().map(|screen| screen_file(&screen.name));
    let both = [WALL_PICTURE, REPORT, REPORT_PAGE].map(str::to_owned);
    channels.chain(screens).chain(both).map(|name| out.join(name)).collect()
}

fn channel_file(name: &str) -> String {
    format!("channel-{name}.png")
}

fn screen_file(name: &str) -> String {
    format!("screen-{name}.png")
}

/// The end of a run that has drawn no frame to report of.
fn broken_off(ending: Ending) -> anyhow::Result<ExitCode> {
    let text = format!("{ending} before the first frame was drawn: there is no report");
    if ending == Ending::Interrupted {
        logging::say_failure("simulate", &text);
        return Ok(ExitCode::from(INTERRUPTED));
    }
    say(text)?;
    Ok(ExitCode::SUCCESS)
}

/// Opens the scene, draws the frames, and writes what came of them.
fn drive(
    local: &LocalWall,
    wall: &Wall,
    (shown, look): (&ReferenceScene, &Look),
    arguments: &Arguments,
) -> anyhow::Result<ExitCode> {
    let client = &local.client;
    let path = shown.file.display().to_string();
    let summary =
        open_scene(client, (&path, arguments.scene_name.as_deref()), &ProgressReport::start())?;
    let features = summary.features.names().join(", ");
    say(format_args!(
        "scene {}: {}; needs: {features}",
        summary.name,
        counted(summary.triangles, "triangle")
    ))?;
    say_notes(&summary.notes)?;
    look.apply(client)?;
    // Who was late for a frame was not waited for when something changed.
    local.await_channels()?;
    let (error_px, rate_fps) = (arguments.error_bound, arguments.rate_bound);
    client.set_bounds(QualityBounds { error_px, rate_fps })?;
    let focus = shown.focus.or(summary.bounds);
    let camera = |n: u64| camera_of_frame(wall, focus.as_ref(), arguments, n);
    let navigations = warm_up(client, &camera, arguments)?;
    client.statistics(true)?;
    let mut faults = Faults::new(&arguments.fault, arguments.fault_seed, wall, local)?;
    let run = FrameRun { local, arguments, camera: &camera, ahead: wall.sync.pipeline_depth };
    let mut series = FrameSeries::default();
    let time_s = run.draw(navigations, (&mut faults, &mut series))?;
    let ending = local.end.ending();
    let statistics = client.statistics(false)?;
    let (faults, faults_unrecorded) = faults.finish();
    let mut report = RunReport::new(&wall.name, &summary, statistics.clone());
    report.ended = ending.into();
    report.restarts = local.restarts();
    report.faults = faults;
    report.faults_unrecorded = faults_unrecorded;
    // Of the moment that the last frame showed. It may be refused, and what was measured stays.
    outputs::write(&arguments.out.join(REPORT), &serde_json::to_vec_pretty(&report)?)?;
    let capture = client.capture_at(Some(time_s)).context("the run has no picture")?;
    for picture in &capture.channels {
        let path = arguments.out.join(channel_file(&picture.name));
        image_files::save_png(&path, &image_files::to_image(picture)?)?;
    }
    if capture.screens.len() > 1 {
        for picture in &capture.screens {
            let path = arguments.out.join(screen_file(&picture.name));
            image_files::save_png(&path, &image_files::to_image(picture)?)?;
        }
    }
    let whole = image_files::side_by_side(&capture.screens)?;
    image_files::save_png(&arguments.out.join(WALL_PICTURE), &whole)?;
    if let Some(picture) = &arguments.picture {
        image_files::save(picture, &whole, arguments.is_picture_halved)?;
    }
    let seen = Seen::in_pictures(&capture).and_never_shown(&statistics);
    report.missing = capture.missing;
    outputs::write(&arguments.out.join(REPORT), &serde_json::to_vec_pretty(&report)?)?;
    let page = run_page::page(wall, &report, &series, &whole)?;
    outputs::write(&arguments.out.join(REPORT_PAGE), page.as_bytes())?;
    print_summary(&report, &arguments.out)?;
    Ok(seen.conclude())
}

/// Draws the frames that are not measured: until caches are full, automatic exposure has a value
/// and detail has come, where there are. Returns the number of moves that mice made.
fn warm_up(
    client: &Client,
    camera: &dyn Fn(u64) -> Option<Camera>,
    arguments: &Arguments,
) -> anyhow::Result<u64> {
    let (start, before) = (Instant::now(), client.presentation()?.exposure);
    let is_automatic = arguments.look.exposure == Some(Brightness::Automatic);
    let (mut frames, mut navigations) = (0, 0);
    loop {
        let own = if navigations == 0 { camera(0) } else { None };
        let feedback = client.render_frame_at(own, Some(arguments.time))?;
        (frames, navigations) = (frames + 1, feedback.navigations);
        let is_over = |after| frames >= 2 * WARM_UP_FRAMES && start.elapsed() >= after;
        let is_metered = !is_automatic || client.presentation()?.exposure != before;
        let has_detail = !feedback.detail.awaits_detail || is_over(DETAIL_TIME_MAX);
        if frames >= WARM_UP_FRAMES && has_detail && (is_metered || is_over(METERING_TIME_MAX)) {
            if feedback.detail.awaits_detail {
                let waited = DETAIL_TIME_MAX.as_secs();
                say(format_args!("note: after {waited} s more detail is still on its way"))?;
            }
            return Ok(navigations);
        }
    }
}

fn camera_of_frame(
    wall: &Wall,
    focus: Option<&Bounds>,
    arguments: &Arguments,
    n: u64,
) -> Option<Camera> {
    if let [from, to] = arguments.walk[..] {
        let steps = frame_count(arguments).unwrap_or(1).saturating_sub(1).max(1);
        let at = from.lerp(to, n as f64 / steps as f64);
        return Some(Camera::look_at(at, at + (to - from), DVec3::Y));
    }
    let time_s = arguments.seconds_of(n);
    Some(if arguments.orbit {
        orbit::camera_at(wall, focus?, time_s)
    } else {
        fit_bounds(wall, focus?, orbit::HEADING_RAD)
    })
}

/// How many frames are drawn; `None` where it goes by time, or until a window is closed.
fn frame_count(arguments: &Arguments) -> Option<u64> {
    match (arguments.frames, arguments.seconds) {
        (Some(frames), _) => Some(frames),
        (None, Some(_)) => None,
        (None, None) => (!arguments.windows).then_some(FRAMES_DEFAULT),
    }
}

/// The time at which the next frame is asked for: a period of `rate` frames per second after
/// `last`, but not before `now`. Time that was lost is not made up for by frames in a hurry.
fn next_due(last: Option<Instant>, rate: Option<f64>, now: Instant) -> Instant {
    let period = rate.and_then(|rate| Duration::try_from_secs_f64(1.0 / rate).ok());
    let due = last.zip(period).and_then(|(last, period)| last.checked_add(period));
    due.map_or(now, |due| due.max(now))
}

/// The frames of a run.
struct FrameRun<'a> {
    local: &'a LocalWall,
    arguments: &'a Arguments,
    camera: &'a dyn Fn(u64) -> Option<Camera>,
    /// Frames that are asked for before the last one was answered, as many as the wall draws ahead.
    ahead: u32,
}

impl FrameRun<'_> {
    /// Draws the frames. Returns the scene time of the last one.
    fn draw(
        &self,
        mut navigations: u64,
        (faults, series): (&mut Faults<'_>, &mut FrameSeries),
    ) -> anyhow::Result<f64> {
        let Self { local, arguments, camera, ahead } = *self;
        let count = frame_count(arguments);
        let bar = ProgressBar::with_draw_target(count, progress::target());
        let wide = if count.is_some() { "{wide_bar} " } else { "" };
        let template = format!("drawing {wide}frame {{pos}}, {{per_sec}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style);
        }
        let (start, mut last_s) = (Instant::now(), arguments.time);
        let (mut asked, mut asked_at) = (VecDeque::new(), None);
        let mut answer = |n: u64, pending: Pending| -> anyhow::Result<u64> {
            let Response::Frame(feedback) = pending.wait()? else {
                bail!("frame {} of the run was answered with something else", n + 1);
            };
            local.end.has_results();
            faults.note(n + 1, &feedback)?;
            series.note(start.elapsed().as_secs_f64(), &feedback);
            bar.inc(1);
            Ok(feedback.navigations)
        };
        for n in 0.. {
            let is_over = arguments.seconds.is_some_and(|length| start.elapsed() >= length);
            if count.is_some_and(|count| n >= count) || is_over {
                break;
            }
            let due = next_due(asked_at, arguments.rate, Instant::now());
            if local.end.wait_until(due).is_some() {
                break;
            }
            asked_at = Some(due);
            last_s = arguments.time + arguments.seconds_of(n);
            let time_s = Some(last_s);
            // Once the mouse has moved the camera, it is the user's.
            let own = if navigations == 0 { camera(n) } else { None };
            let request = Request::RenderFrame { camera: own, time_s };
            asked.push_back((n, local.client.submit(request)?));
            if asked.len() > ahead as usize
                && let Some((n, pending)) = asked.pop_front()
            {
                navigations = answer(n, pending)?;
            }
        }
        for (n, pending) in asked {
            answer(n, pending)?;
        }
        bar.finish_and_clear();
        Ok(last_s)
    }
}

fn print_summary(report: &RunReport, out: &Path) -> anyhow::Result<()> {
    say(report.summary())?;
    if !report.faults.is_empty() {
        report.fault_lines().try_for_each(say)?;
    }
    for (channel, reason) in &report.missing {
        say(format_args!("channel {channel} is missing in the picture: {reason}"))?;
    }
    say(format_args!("pictures and report: {}", out.display()))
}

fn step(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::with_draw_target(None, progress::target()).with_message(what);
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

/// The scene of a file, or the generated one.
pub(super) fn shown(scene: Option<&Path>) -> anyhow::Result<ReferenceScene> {
    shown_with(scene, TownExtras::default())
}

fn shown_with(scene: Option<&Path>, extras: TownExtras) -> anyhow::Result<ReferenceScene> {
    let Some(scene) = scene else { return generated_town(extras) };
    let file = scene.canonicalize().with_context(|| scene.display().to_string())?;
    Ok(ReferenceScene { file, focus: None })
}

/// The scene of the demo, kept in this user's cache folder once it was made.
fn generated_town(extras: TownExtras) -> anyhow::Result<ReferenceScene> {
    let town = TownOptions { blocks: 4, seed: 1, extras };
    let folder = cache_folder()?.join("scenes");
    outputs::make_folder(&folder)?;
    let is_plain = extras == TownExtras::default();
    let path = folder.join(if is_plain { "town.glb" } else { "harbour.glb" });
    let bytes = generate(&town)?;
    // Written anew each time: it is quick, and an older version may lie there.
    outputs::write(&path, &bytes)?;
    let (min, max) = town.focus();
    Ok(ReferenceScene { file: path.canonicalize()?, focus: Some(Bounds { min, max }) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_after_a_stall_keep_their_distance() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let due = |last: Option<u64>, now: u64| next_due(last.map(at), Some(10.0), at(now));
        assert_eq!([due(None, 0), due(Some(0), 30), due(Some(100), 210)], [0, 100, 210].map(at));
        // The second frame after a stall of two seconds.
        assert_eq!([due(Some(210), 2200), due(Some(2200), 2201)], [2200, 2300].map(at));
        assert_eq!(next_due(Some(at(5)), None, at(6)), at(6), "as many as the wall can");
    }
}
