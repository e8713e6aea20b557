//! `polyptych replay`: decides again what a recorded manager decided.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use polyptych_manager::record::ring::RingReader;
use polyptych_manager::replay::incident::{Cut, Incident};
use polyptych_manager::replay::{Part, Replayed, replay};

use super::{counted, say};
use crate::pictures;

/// Where incidents are kept for the tests of a checkout.
const INCIDENTS: &str = "server-manager/tests/incidents";

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// What `--record` has written, or an incident that was kept
    file: PathBuf,
    /// Print JSON instead of a timeline
    #[arg(long)]
    json: bool,
    /// Keep it as a test: NAME in a checkout's server-manager/tests/incidents, or a path
    #[arg(long, value_name = "NAME")]
    keep: Option<String>,
    /// Of what is kept: which part of the recording, as the timeline counts [default: the last]
    #[arg(long, value_name = "N", requires = "keep")]
    part: Option<usize>,
    /// Of what is kept: from this manager time on [default: from the part's beginning]
    #[arg(long, value_name = "SECONDS", requires = "keep", value_parser = time)]
    from: Option<f64>,
    /// Of what is kept: up to this manager time [default: to the part's end]
    #[arg(long, value_name = "SECONDS", requires = "keep", value_parser = time)]
    to: Option<f64>,
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
    let replayed = replay(&reader)?;
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

/// Incidents are text, recordings are not.
fn is_text(path: &Path) -> anyhow::Result<bool> {
    let mut first = [0];
    let named = || path.display().to_string();
    let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut first));
    Ok(read.with_context(named)? == 1 && first == *b"{")
}

fn check(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if arguments.keep.is_some() {
        bail!("{}: is kept already; --keep takes a recording", arguments.file.display());
    }
    let incident = Incident::load(&arguments.file).map_err(|reason| anyhow!("{reason}"))?;
    let named = || arguments.file.display().to_string();
    let checked = incident.check().map_err(|reason| anyhow!("{reason}")).with_context(named)?;
    if arguments.json {
        say(serde_json::to_string_pretty(&checked)?)?;
    } else {
        say(format_args!(
            "{}: the invariants hold over {} inputs, {} frames, {} requests",
            arguments.file.display(),
            checked.inputs,
            checked.frames,
            checked.requests
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
    let cut = Cut { part: arguments.part, from_s: arguments.from, to_s: arguments.to };
    let named = || arguments.file.display().to_string();
    let incident = Incident::cut(reader, &cut, &arguments.about);
    let incident = incident.map_err(|reason| anyhow!("{reason}")).with_context(named)?;
    let (text, left_out) = incident.to_text().map_err(|reason| anyhow!("{reason}"))?;
    let kept = path.display();
    pictures::write_whole(&path, text.as_bytes())
        .with_context(|| format!("cannot write {kept}"))?;
    if left_out > 0 {
        eprintln!("warning: {left_out} inputs are left out: they hold numbers that text cannot");
    }
    let inputs = counted(text.lines().count() - 1, "input");
    match incident.check() {
        Ok(checked) => say(format_args!(
            "{kept}: {inputs}; the invariants hold over {} frames and {} requests",
            checked.frames, checked.requests
        )),
        // Kept all the same: that is what it is kept for.
        Err(reason) => say(format_args!("{kept}: {inputs}; a test of it fails: {reason}")),
    }
}

fn print(replayed: &Replayed, took: Duration) -> anyhow::Result<()> {
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
    let (inputs, decisions) = (replayed.inputs, replayed.decisions);
    let seconds = took.as_secs_f64();
    say(match replayed.differences {
        0 => format!("{inputs} inputs, {decisions} decisions, all the same; {seconds:.2} s"),
        n => format!("{inputs} inputs, {decisions} decisions, {n} of them differ; {seconds:.2} s"),
    })
}

fn print_part(number: usize, part: &Part) -> anyhow::Result<()> {
    let summary = &part.summary;
    let begin = if part.is_from_start { "from its start" } else { "from a checkpoint" };
    let end = if part.has_end { "it ended in order" } else { "it breaks off" };
    say(format_args!(
        "part {number}: manager {} (polyptych {}) {begin}, {:.3} s to {:.3} s; {end}",
        part.epoch, part.program, summary.from_s, summary.to_s
    ))?;
    for event in &summary.events {
        // Words of peers stand in it, which must not move a terminal's cursor.
        let escape = |c: char| if c.is_control() { c.escape_debug().to_string() } else { c.into() };
        let text: String = event.text.chars().map(escape).collect();
        say(format_args!("{:>10.3} s  {:<8} {text}", event.at_s, event.kind))?;
    }
    if summary.events_more > 0 {
        say(format_args!("            and {} events more", summary.events_more))?;
    }
    let list = |counts: &std::collections::BTreeMap<String, u64>| {
        let words: Vec<_> = counts.iter().map(|(name, count)| format!("{name} {count}")).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(", ") }
    };
    say(format_args!(
        "  {} frames, the longest {:.1} ms at {:.3} s; late: {}",
        summary.frames,
        summary.longest_frame_ms,
        summary.longest_frame_at_s,
        list(&summary.late)
    ))?;
    say(format_args!(
        "  requests: {}; {} answers, {} of them no\n",
        list(&summary.requests),
        summary.answers,
        summary.failures
    ))
}

/// A manager time in seconds, as an argument.
fn time(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of seconds"))?;
    let is_time = number.is_finite() && number >= 0.0;
    is_time.then_some(number).ok_or_else(|| format!("{text} is not 0 or more seconds"))
}
