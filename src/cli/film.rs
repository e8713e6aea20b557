//! `polyptych film`: frames at equal steps of scene time, none lost and none twice.
//!
//! ```text
//! time of frame n -> capture -> all channels in it? ------- yes --> written
//!                       ^--- no, or no manager: wait for them ---+
//! ```

mod film_output;
mod interruption;
mod wall_before;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use film_output::FilmOutput;
use interruption::Interruption;
use polyptych_client::blocking::Client;
use polyptych_client::{Capture, ClientError, ReconnectPolicy, Revision};
use polyptych_protocol::request::CAPTURE_ROOM_TAKEN;
use polyptych_text::{counted, printable};
use serde::Serialize;
use wall_before::WallBefore;

use super::progress::ProgressReport;
use super::remote::{numbers, positive};
use super::seen::await_displays_unless;
use super::{ManagerAddress, say};

/// Maximum number of frames: their numbers have six digits, and ten hours at 27 a second are more
/// than anybody renders in one go.
const FRAMES_MAX: u32 = 1_000_000;

/// Maximum number of times that a frame is captured: a channel that is missing this often, though
/// it was back each time, will not come.
const TRIES_MAX: u32 = 8;

/// Maximum time that a frame waits for channels that are missing: a server is started again in
/// seconds, and gets a large scene in a minute.
const RETURN_TIME_MAX: Duration = Duration::from_mins(1);

/// Maximum time that a frame waits for detail that servers load where a budget holds a part of it.
/// Behind one that waited in vain, no other waits before servers hold another part.
const DETAIL_TIME_MAX: Duration = Duration::from_secs(15);

/// Pause before a capture that found no room beside captures of others is asked for again: each
/// try draws the frame.
const ROOM_PAUSE: Duration = Duration::from_secs(1);

/// Maximum number of frames that the report names in words.
const NAMED_MAX: usize = 32;

#[derive(Debug, clap::Args)]
pub(super) struct FilmArguments {
    /// A folder for a PNG of each screen and frame, or a file that ends in .mp4, .mkv or .webm,
    /// which ffmpeg writes
    out: PathBuf,
    /// How many frames
    #[arg(long, value_name = "N")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_MAX)))]
    frames: u32,
    /// Frames per second of scene time, however long the wall takes for each
    #[arg(long, value_name = "F", value_parser = positive)]
    fps: f64,
    /// Scene time of the first frame [default: where the tour begins that is played, else 0]
    #[arg(long, value_name = "SECONDS", value_parser = second, allow_hyphen_values = true)]
    from: Option<f64>,
    /// Print a report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

fn second(text: &str) -> Result<f64, String> {
    numbers::<1>(text).map(|[number]| number)
}

/// The report of a film.
#[derive(Debug, Serialize)]
struct FilmReport {
    out: String,
    /// Frames that were asked for.
    frames: u32,
    /// Frames that are in the film, from the first on.
    written: u32,
    fps: f64,
    from_s: f64,
    #[serde(flatten)]
    flaws: FilmFlaws,
}

/// The flaws with which a film goes on.
#[derive(Debug, Default, Serialize)]
struct FilmFlaws {
    redrawn: Vec<RedrawnFrame>,
    /// The number of frames that are in the film without detail that did not come in time.
    without_detail: u32,
    /// The state that was waited for in vain: it stays the same until servers hold another part.
    #[serde(skip)]
    awaited_in_vain: Option<Revision>,
}

/// A frame that was captured more than once.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct RedrawnFrame {
    /// Its number, from 0.
    frame: u32,
    time_s: f64,
    /// The number of its captures.
    tries: u32,
    /// Channels that were missing before the last try, each once, with the first reason.
    missing: Vec<(String, String)>,
    /// Why the manager did not answer before the last try, if it did not; the first reason.
    lost: Option<String>,
}

/// A source of pictures of a film.
trait FilmSource {
    /// Returns the state that this frame is drawn with if it will have more detail when it is drawn
    /// again.
    fn awaits_detail(&mut self, time_s: f64) -> Result<Option<Revision>, ClientError>;

    /// Returns the time since the film began.
    fn elapsed(&self) -> Duration;

    fn capture(&mut self, time_s: f64) -> Result<Capture, ClientError>;

    /// Waits for [`ROOM_PAUSE`].
    fn pause(&mut self);

    /// Waits until manager and channels of the wall are back, and no longer than this.
    fn await_channels(&mut self, limit: Duration) -> anyhow::Result<()>;

    /// Returns whether the film is to end before its last frame.
    fn is_interrupted(&self) -> bool;
}

/// A running wall.
struct WallSource<'a> {
    client: &'a Client,
    progress: &'a ProgressReport,
    interruption: &'a Interruption,
    began: Instant,
    /// `true` if a budget of GPU memory may hold less than all detail: what it holds follows where
    /// frames are seen from.
    is_budgeted: bool,
}

impl FilmSource for WallSource<'_> {
    fn awaits_detail(&mut self, time_s: f64) -> Result<Option<Revision>, ClientError> {
        if !self.is_budgeted {
            return Ok(None);
        }
        let drawn = self.client.render_frame_at(None, Some(time_s))?;
        Ok(drawn.detail.awaits_detail.then_some(drawn.revision))
    }

    fn elapsed(&self) -> Duration {
        self.began.elapsed()
    }

    fn capture(&mut self, time_s: f64) -> Result<Capture, ClientError> {
        self.client.capture_at(Some(time_s))
    }

    fn pause(&mut self) {
        std::thread::sleep(ROOM_PAUSE);
    }

    fn await_channels(&mut self, limit: Duration) -> anyhow::Result<()> {
        let is_over = || self.interruption.is_asked();
        match await_displays_unless(self.client, Some(limit), self.progress, is_over) {
            // The next try says so, or goes through.
            Err(error) if error.downcast_ref().is_some_and(is_lost) => Ok(()),
            ended => ended,
        }
    }

    fn is_interrupted(&self) -> bool {
        self.interruption.is_asked()
    }
}

pub(super) fn film(arguments: &FilmArguments) -> anyhow::Result<ExitCode> {
    let mut output = FilmOutput::new(&arguments.out, arguments.fps)?;
    let reconnect = ReconnectPolicy { wait: RETURN_TIME_MAX, give_up_after: None };
    let client = arguments.manager.connect_for(Some(reconnect))?;
    let tour = client.tour()?;
    let is_budgeted = client.wall()?.budget.gpu_mib.is_some();
    let presentation = client.presentation()?;
    if presentation.is_exposure_automatic {
        tracing::warn!(
            "the exposure is automatic, so that the film may be brighter or darker when it is made \
             again; set it with: polyptych exposure EV"
        );
    }
    let from_s = arguments.from.or(tour.began_s).unwrap_or(0.0);
    let mut report = FilmReport {
        out: arguments.out.display().to_string(),
        frames: arguments.frames,
        written: 0,
        fps: arguments.fps,
        from_s,
        flaws: FilmFlaws::default(),
    };
    let before = WallBefore { pace: tour.pace, bounds: presentation.bounds };
    let interruption = Interruption::watch(client.clone(), before)?;
    let progress = ProgressReport::start();
    let mut source = WallSource {
        client: &client,
        progress: &progress,
        interruption: &interruption,
        began: Instant::now(),
        is_budgeted,
    };
    let suspended = before.suspend(&client).map_err(anyhow::Error::from);
    let filmed =
        suspended.and_then(|()| all_frames(&mut source, &mut output, &mut report, &progress));
    drop(progress);
    // What was written stays valid, however the film ended.
    let ended = output.finish();
    let resumed = before.restore(&client);
    if arguments.json {
        say(serde_json::to_string(&report)?)?;
    } else {
        say_report(&report)?;
    }
    if let (Err(_), Err(error)) = (&filmed, &resumed) {
        tracing::warn!(
            %error,
            "the wall may stay paused and without its rate bound; the page gives it both again"
        );
    }
    filmed.and(ended)?;
    resumed.context("the film is whole, but the wall does not run on as before")?;
    Ok(ExitCode::SUCCESS)
}

fn all_frames(
    source: &mut impl FilmSource,
    output: &mut FilmOutput,
    report: &mut FilmReport,
    progress: &ProgressReport,
) -> anyhow::Result<()> {
    for frame in 0..report.frames {
        if source.is_interrupted() {
            bail!("interrupted after {} of {}", report.written, counted(report.frames, "frame"));
        }
        let done = u64::from(frame) * 100 / u64::from(report.frames);
        progress.say(&format!("frame {frame} of {}", report.frames), u8::try_from(done).ok());
        let time_s = report.from_s + f64::from(frame) / report.fps;
        let capture = whole_frame(source, frame, time_s, &mut report.flaws)?;
        output.write(frame, &capture)?;
        report.written += 1;
    }
    Ok(())
}

/// Returns whether a capture may go through once the manager is there again: that of a stated time
/// is the same however often it is asked for.
fn is_lost(error: &ClientError) -> bool {
    // One that says goodbye may be started again, or have a standby, and one that hangs may go on.
    error.is_outcome_unknown() || matches!(error, ClientError::NotConnected { .. })
}

/// Draws a frame until it has the detail that servers hold for it, and no longer than
/// [`DETAIL_TIME_MAX`]; only once, where its state was waited for in vain before. Returns whether
/// the frame has all of its detail.
fn await_detail(
    source: &mut impl FilmSource,
    time_s: f64,
    flaws: &mut FilmFlaws,
) -> Result<bool, ClientError> {
    let began = source.elapsed();
    while let Some(revision) = source.awaits_detail(time_s)? {
        if source.is_interrupted() || flaws.awaited_in_vain == Some(revision) {
            return Ok(false);
        }
        if source.elapsed().saturating_sub(began) >= DETAIL_TIME_MAX {
            flaws.awaited_in_vain = Some(revision);
            if flaws.without_detail == 0 {
                tracing::warn!(
                    time_s,
                    "detail has not come; frames are filmed without it, until servers load some"
                );
            }
            return Ok(false);
        }
    }
    Ok(true)
}

/// Captures a frame as soon as there is room for its pictures beside captures of others, and waits
/// for that no longer than [`RETURN_TIME_MAX`].
fn capture_with_room(source: &mut impl FilmSource, time_s: f64) -> Result<Capture, ClientError> {
    let began = source.elapsed();
    loop {
        let captured = source.capture(time_s);
        let is_refused = matches!(
            &captured,
            Err(ClientError::Failed { reason, .. }) if reason.starts_with(CAPTURE_ROOM_TAKEN)
        );
        let is_over = source.elapsed().saturating_sub(began) >= RETURN_TIME_MAX;
        if !is_refused || is_over || source.is_interrupted() {
            return captured;
        }
        source.pause();
    }
}

/// Captures a frame until all channels are in it.
///
/// # Errors
/// The manager does not answer, or channels are missing for too long: names them.
fn whole_frame(
    source: &mut impl FilmSource,
    frame: u32,
    time_s: f64,
    flaws: &mut FilmFlaws,
) -> anyhow::Result<Capture> {
    let (mut missing, mut lost) = (Vec::<(String, String)>::new(), None);
    let mut began = None;
    for tries in 1..=TRIES_MAX {
        let detailed = await_detail(source, time_s, flaws);
        match detailed.and_then(|it| Ok((it, capture_with_room(source, time_s)?))) {
            Ok((has_detail, capture)) if capture.missing.is_empty() => {
                flaws.without_detail += u32::from(!has_detail);
                if tries > 1 {
                    flaws.redrawn.push(RedrawnFrame { frame, time_s, tries, missing, lost });
                }
                return Ok(capture);
            }
            Ok((_, capture)) => {
                for (name, reason) in capture.missing {
                    if missing.iter().all(|(other, _)| *other != name) {
                        missing.push((name, reason));
                    }
                }
            }
            Err(error) if is_lost(&error) => {
                lost.get_or_insert_with(|| error.to_string());
            }
            Err(error) => return Err(error).with_context(|| format!("frame {frame}")),
        }
        if source.is_interrupted() {
            break;
        }
        let waited = began.get_or_insert_with(Instant::now).elapsed();
        let Some(rest) = RETURN_TIME_MAX.checked_sub(waited) else { break };
        source.await_channels(rest)?;
    }
    if missing.is_empty() {
        bail!("frame {frame}: {}", lost.unwrap_or_default());
    }
    let list: Vec<String> = missing.iter().map(named).collect();
    bail!("frame {frame} has no picture of {}; see: polyptych status", list.join("; "))
}

fn named((name, reason): &(String, String)) -> String {
    format!("channel {}: {}", printable(name), printable(reason))
}

fn say_report(report: &FilmReport) -> anyhow::Result<()> {
    let FilmReport { out, written, fps, from_s, flaws, .. } = report;
    let FilmFlaws { redrawn, without_detail, .. } = flaws;
    let (frames, out) = (counted(*written, "frame"), printable(out));
    let again = match redrawn.len() {
        0 => "none".to_owned(),
        count => count.to_string(),
    };
    say(format_args!("{out}: {frames} from {from_s} s on, {fps} per second; {again} redrawn"))?;
    for of in redrawn.iter().take(NAMED_MAX) {
        let list: Vec<String> = of.missing.iter().map(named).chain(of.lost.clone()).collect();
        let RedrawnFrame { frame, tries, .. } = of;
        say(format_args!("frame {frame} was drawn {tries} times: {}", list.join("; ")))?;
    }
    if let Some(more @ 1..) = redrawn.len().checked_sub(NAMED_MAX) {
        say(format_args!("{} more; --json names all", counted(more, "redrawn frame")))?;
    }
    if *without_detail > 0 {
        let frames = counted(*without_detail, "frame");
        say(format_args!("detail that did not come in time is missing from {frames}"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
