//! `polyptych replay`: decides again what a recorded manager decided.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use polyptych_manager::recorder::ring::RingReader;
use polyptych_manager::replay::incident::{Incident, TimeRange};
use polyptych_manager::replay::lanes::Lanes;
use polyptych_manager::replay::{ReplayReport, ReplayRun, replay, replay_lanes};
use polyptych_text::{counted, printable};
use time::OffsetDateTime;

use super::say;
use crate::report_page::markup::{add, escaped};
use crate::report_page::{self, add_facts, add_row, begin_table, end_table};
use crate::{lane_drawing, logging, outputs};

/// Maximum number of events in a page.
const EVENTS_MAX: usize = 1000;

/// Where incidents are kept for the tests of a checkout.
const INCIDENTS: &str = "server-manager/tests/incidents";

#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("of a part").args(["keep", "svg", "html"]).multiple(true))]
pub(super) struct Arguments {
    /// What `--record` has written, or an incident that was kept
    file: PathBuf,
    /// Print JSON instead of a timeline
    #[arg(long)]
    json: bool,
    /// Keep it as a test: NAME in a checkout's server-manager/tests/incidents, or a path
    #[arg(long, value_name = "NAME", conflicts_with_all = ["json", "svg", "html"])]
    keep: Option<String>,
    /// Draw lanes over time, of manager, channels and clients: an SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Write lanes and events as one page: an HTML file
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Of what is kept or drawn: which part of the recording, as the timeline counts [default: the
    /// last]
    #[arg(long, value_name = "N", requires = "of a part")]
    part: Option<usize>,
    /// Of what is kept or drawn: from this manager time on [default: from the part's beginning]
    #[arg(long, value_name = "SECONDS", requires = "of a part", value_parser = seconds)]
    from: Option<f64>,
    /// Of what is kept or drawn: up to this manager time [default: to the part's end]
    #[arg(long, value_name = "SECONDS", requires = "of a part", value_parser = seconds)]
    to: Option<f64>,
    /// Write over what was kept under this name
    #[arg(long, requires = "keep")]
    force: bool,
    /// Of what is kept: a sentence for the person whose test fails
    #[arg(long, value_name = "TEXT", requires = "keep", default_value = "")]
    about: String,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if is_text(&arguments.file)? {
        return check(arguments);
    }
    let reader = RingReader::open(&arguments.file)?;
    if let Some(name) = &arguments.keep {
        keep(&reader, name, arguments)?;
        return Ok(ExitCode::SUCCESS);
    }
    let begin = Instant::now();
    let is_drawn = arguments.svg.is_some() || arguments.html.is_some();
    let replayed = if is_drawn { draw(&reader, arguments)? } else { replay(&reader)? };
    warn_of_unreadable(replayed.unreadable_segments);
    if replayed.inputs == 0 {
        bail!("{}: nothing was recorded whole", arguments.file.display());
    }
    if arguments.json {
        say(serde_json::to_string_pretty(&replayed)?)?;
    } else {
        print(&replayed, begin.elapsed())?;
    }
    let is_good = replayed.differences == 0 && replayed.violation.is_none();
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Replays, and writes the lanes of a part.
fn draw(reader: &RingReader, arguments: &Arguments) -> anyhow::Result<ReplayReport> {
    let outputs = [&arguments.svg, &arguments.html];
    outputs.into_iter().flatten().try_for_each(|file| outputs::check(file))?;
    let range = arguments.range();
    if let (Some(from), Some(to)) = (range.from_s, range.to_s)
        && to <= from
    {
        bail!("--to {to} is not after --from {from}; give a later time");
    }
    let (replayed, lanes) = replay_lanes(reader, &range)?;
    if replayed.inputs == 0 {
        // That is what is wrong with it, and not the range.
        return Ok(replayed);
    }
    let named = arguments.file.display();
    let Some(lanes) = lanes else {
        let parts = replayed.parts.len();
        bail!("{named}: there is no such part to draw; the recording has {parts}, see --part");
    };
    if lanes.channels.iter().all(|lane| lane.states.is_empty()) {
        bail!("{named}: there is nothing in that time; the timeline shows what there is");
    }
    let name = arguments.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let drawing = lane_drawing::svg(&lanes, &name);
    if let Some(file) = &arguments.html {
        outputs::write(file, page(&name, &replayed, &lanes, &drawing).as_bytes())?;
    }
    if let Some(file) = &arguments.svg {
        outputs::write(file, drawing.as_bytes())?;
    }
    Ok(replayed)
}

/// Lanes and events as a page.
fn page(name: &str, replayed: &ReplayReport, lanes: &Lanes, drawing: &str) -> String {
    let title = format!("Recording {name}");
    let mut body = format!("<h1>{}</h1>\n", escaped(&title));
    let is_same = if replayed.differences == 0 { "yes".to_owned() } else { "no".to_owned() };
    let facts = [
        ("Inputs", replayed.inputs.to_string()),
        ("Decided again as then", is_same),
        ("Broken invariant", replayed.violation.clone().unwrap_or_else(|| "none".into())),
    ];
    add_facts(&mut body, &facts);
    body.push_str(drawing);
    let Some(part) = lanes.part.checked_sub(1).and_then(|index| replayed.parts.get(index)) else {
        return report_page::page(&title, &body);
    };
    begin_table(&mut body, "Events", &["Time, UTC", "Manager, s", "Kind", "What"]);
    for event in lanes.events.iter().take(EVENTS_MAX) {
        let time = clock(part, event.at_s).time();
        let text = printable(&event.text).into_owned();
        add_row(&mut body, &[time, format!("{:.3}", event.at_s), event.kind.to_owned(), text]);
    }
    end_table(&mut body);
    let more = lanes.events.len().saturating_sub(EVENTS_MAX) as u64 + lanes.events_more;
    if more > 0 {
        let text = counted(more, "more event");
        add(&mut body, format_args!("<p class=\"note\">And {text}.</p>\n"));
    }
    report_page::page(&title, &body)
}

impl Arguments {
    fn range(&self) -> TimeRange {
        TimeRange { part: self.part, from_s: self.from, to_s: self.to }
    }
}

/// Incidents are text, recordings are not.
fn is_text(path: &Path) -> anyhow::Result<bool> {
    let mut first = [0];
    let named = || path.display().to_string();
    let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut first));
    Ok(read.with_context(named)? == 1 && first == *b"{")
}

fn check(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let wants = [("--svg", &arguments.svg), ("--html", &arguments.html)];
    let wanted = wants.into_iter().find(|(_, file)| file.is_some()).map(|(name, _)| name);
    if let Some(name) = wanted.or(arguments.keep.is_some().then_some("--keep")) {
        bail!("{}: is an incident; {name} takes a recording", arguments.file.display());
    }
    let incident = Incident::load(&arguments.file).map_err(|reason| anyhow!("{reason}"))?;
    let named = || arguments.file.display().to_string();
    let checked = incident.check().map_err(|reason| anyhow!("{reason}")).with_context(named)?;
    if arguments.json {
        say(serde_json::to_string_pretty(&checked)?)?;
    } else {
        say(format_args!(
            "{}: the invariants hold over {}, {}, {}",
            arguments.file.display(),
            counted(checked.inputs, "input"),
            counted(checked.frames, "frame"),
            counted(checked.requests, "request")
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn keep(reader: &RingReader, name: &str, arguments: &Arguments) -> anyhow::Result<()> {
    let path = if name.contains('/') || Path::new(name).extension().is_some() {
        PathBuf::from(name)
    } else if Path::new(INCIDENTS).is_dir() {
        Path::new(INCIDENTS).join(format!("{name}.incident"))
    } else {
        bail!("{INCIDENTS} is not here; run this in a checkout, or name a path: ./{name}.incident");
    };
    outputs::check_source(&path, arguments.force)?;
    let cut = arguments.range();
    let named = || arguments.file.display().to_string();
    let incident = Incident::extract(reader, &cut, &arguments.about);
    let incident = incident.map_err(|reason| anyhow!("{reason}")).with_context(named)?;
    warn_of_unreadable(incident.unreadable_segments());
    let text = incident.to_text().map_err(|reason| anyhow!("{reason}"));
    let (text, left_out) = text.with_context(named)?;
    let kept = path.display();
    outputs::write(&path, text.as_bytes())?;
    if left_out > 0 {
        let inputs = counted(left_out, "input");
        logging::say_warning(&format!("left out: {inputs} with numbers that text cannot hold"));
    }
    let inputs = counted(text.lines().count() - 1, "input");
    match incident.check() {
        Ok(checked) => say(format_args!(
            "{kept}: {inputs}; the invariants hold over {} and {}",
            counted(checked.frames, "frame"),
            counted(checked.requests, "request")
        )),
        // Kept all the same: that is what it is kept for.
        Err(reason) => say(format_args!("{kept}: {inputs}; a test of it fails: {reason}")),
    }
}

/// Says how much of a recording is left out, if any.
fn warn_of_unreadable(segments: u64) {
    if segments > 0 {
        let segments = counted(segments, "segment");
        logging::say_warning(&format!(
            "left out: {segments} of the recording, unreadable to this program; replay the rest \
             with the release that wrote it"
        ));
    }
}

fn print(replayed: &ReplayReport, took: Duration) -> anyhow::Result<()> {
    for (number, part) in (1..).zip(&replayed.parts) {
        print_part(number, part)?;
    }
    if let Some(difference) = &replayed.first_difference {
        say(format_args!(
            "first difference: part {}, input {} at {:.6} s\n  told:     {}\n  recorded: {}\n  \
             replayed: {}",
            difference.part,
            difference.number,
            difference.at_s,
            difference.input,
            difference.recorded,
            difference.replayed
        ))?;
    }
    if let Some(violation) = &replayed.violation {
        say(format_args!("broken invariant: {violation}"))?;
    }
    let inputs = counted(replayed.inputs, "input");
    let decisions = counted(replayed.decisions, "decision");
    let seconds = took.as_secs_f64();
    say(match replayed.differences {
        0 => format!("{inputs}, {decisions}, all the same; {seconds:.2} s"),
        n => format!("{inputs}, {decisions}, of which {n} differ; {seconds:.2} s"),
    })
}

fn print_part(number: usize, part: &ReplayRun) -> anyhow::Result<()> {
    let summary = &part.summary;
    let begin = if part.is_from_start { "from its start" } else { "from a checkpoint" };
    let end = if part.has_end { "it ended in order" } else { "it breaks off" };
    say(format_args!(
        "part {number}: manager {} (polyptych {}) {begin}, {} to {} UTC, {:.3} s to {:.3} s; {end}",
        part.epoch,
        part.program,
        clock(part, summary.from_s).date_and_time(),
        clock(part, summary.to_s).time(),
        summary.from_s,
        summary.to_s
    ))?;
    for event in &summary.events {
        // Words of peers stand in it.
        let text = printable(&event.text);
        let time = clock(part, event.at_s).time();
        say(format_args!("{time} {:>10.3} s  {:<8} {text}", event.at_s, event.kind))?;
    }
    if summary.events_more > 0 {
        say(format_args!("and {}", counted(summary.events_more, "more event")))?;
    }
    let list = |counts: &std::collections::BTreeMap<String, u64>| {
        let words: Vec<_> = counts.iter().map(|(name, count)| format!("{name} {count}")).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(", ") }
    };
    say(format_args!(
        "  {}, the longest {:.1} ms at {:.3} s; late: {}",
        counted(summary.frames, "frame"),
        summary.longest_frame_ms,
        summary.longest_frame_at_s,
        list(&summary.late)
    ))?;
    say(format_args!(
        "  requests: {}; {}, of which {} said no\n",
        list(&summary.requests),
        counted(summary.answers, "answer"),
        summary.failures
    ))
}

/// The time of day, in UTC, at a time of a part's manager.
fn clock(part: &ReplayRun, at_s: f64) -> Clock {
    let nanos = i128::from(part.started_unix_us) * 1000 + (at_s * 1e9) as i128;
    Clock(OffsetDateTime::from_unix_timestamp_nanos(nanos).unwrap_or(OffsetDateTime::UNIX_EPOCH))
}

/// A moment, in UTC.
struct Clock(OffsetDateTime);

impl Clock {
    /// As 12:34:56.789.
    fn time(&self) -> String {
        let (hours, minutes, seconds, ms) = self.0.time().as_hms_milli();
        format!("{hours:02}:{minutes:02}:{seconds:02}.{ms:03}")
    }

    /// As 2026-01-31 12:34:56.789.
    fn date_and_time(&self) -> String {
        let (year, month, day) = self.0.to_calendar_date();
        format!("{year}-{:02}-{day:02} {}", u8::from(month), self.time())
    }
}

/// A manager time in seconds, as an argument.
fn seconds(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of seconds"))?;
    let is_time = number.is_finite() && number >= 0.0;
    is_time.then_some(number).ok_or_else(|| format!("{text} is not 0 or more seconds"))
}
