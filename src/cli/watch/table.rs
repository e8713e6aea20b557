//! A wall's status as lines that fit a terminal: a function of what is known and nothing else.

use polyptych_client::{ChannelState, ChannelStatus, DeviceState, OutputMode, Skew, WallStatus};
use polyptych_text::{counted, printable};
use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

use super::rates::Rates;
use crate::cli::devices;

/// Between two columns.
const GAP: usize = 2;

/// The reason of a channel in trouble gets at least so much; columns that matter less make room.
const REASON_WIDTH_MIN: usize = 36;

/// Longest name that is shown whole.
const NAME_WIDTH_MAX: usize = 24;

/// Warnings that are shown, and notes; the rest is counted.
const TEXTS_MAX: usize = 2;

/// All that is known.
#[derive(Debug)]
pub(super) struct WatchModel<'a> {
    /// The last answer, if there was one.
    pub status: Option<&'a WallStatus>,
    pub rates: &'a Rates,
    /// Where the manager does not answer now.
    pub trouble: Option<Trouble<'a>>,
}

/// A manager that does not answer.
#[derive(Debug)]
pub(super) struct Trouble<'a> {
    pub manager: &'a str,
    pub reason: &'a str,
    /// In seconds since 1970.
    pub since_utc_s: u64,
    pub seconds: u64,
}

/// Pieces of one line of the terminal.
pub(super) type Line = Vec<Piece>;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    pub text: String,
    pub tone: Tone,
}

/// How a piece looks. Colours only repeat what the words say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tone {
    Plain,
    Head,
    Quiet,
    Good,
    Busy,
    Warning,
    Bad,
}

/// The columns, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Channel,
    State,
    For,
    Frame,
    Rate,
    Draw,
    Skew,
    Late,
    Memory,
    Pid,
    Address,
    Reason,
}

const COLUMNS: [Column; 12] = [
    Column::Channel,
    Column::State,
    Column::For,
    Column::Frame,
    Column::Rate,
    Column::Draw,
    Column::Skew,
    Column::Late,
    Column::Memory,
    Column::Pid,
    Column::Address,
    Column::Reason,
];

/// What makes room first where the terminal is narrow.
const DISPENSABLE: [Column; 9] = [
    Column::Address,
    Column::Pid,
    Column::Memory,
    Column::Frame,
    Column::Skew,
    Column::Draw,
    Column::For,
    Column::Rate,
    Column::Late,
];

/// The table, of at most `height` lines of at most `width` columns.
pub(super) fn lines(view: &WatchModel, width: usize, height: usize) -> Vec<Line> {
    let mut lines = body(view, width, height, TEXTS_MAX);
    if lines.len() < height {
        lines.push(vec![piece("q ends", Tone::Quiet)]);
    }
    lines.truncate(height);
    lines.into_iter().map(|line| fitted(line, width)).collect()
}

/// The same table of one answer, all of it, for a reader of text.
pub(super) fn text(status: &WallStatus) -> String {
    let view = WatchModel { status: Some(status), rates: &Rates::default(), trouble: None };
    let lines = body(&view, usize::MAX, usize::MAX, usize::MAX).into_iter();
    let text = |line: Line| line.into_iter().map(|piece| piece.text).collect::<String>();
    lines.map(|line| text(fitted(line, usize::MAX))).collect::<Vec<_>>().join("\n")
}

/// All but the line with the key that ends it; of at most so many texts of a kind.
fn body(view: &WatchModel, width: usize, height: usize, texts_max: usize) -> Vec<Line> {
    let mut lines = Vec::new();
    if let Some(trouble) = &view.trouble {
        lines.push(vec![piece(trouble_in_words(trouble), Tone::Bad)]);
    }
    match view.status {
        None if view.trouble.is_none() => lines.push(vec![piece("connecting …", Tone::Quiet)]),
        None => {}
        Some(status) => {
            lines.push(vec![piece(wall_in_words(status, view.rates), Tone::Head)]);
            lines.push(vec![piece(counts_in_words(&status.channels), Tone::Plain)]);
            lines.extend(leader_in_words(status).map(|text| vec![piece(text, Tone::Plain)]));
            lines.extend(openings(status).map(|text| vec![piece(text, Tone::Busy)]));
            lines.extend(modes_in_words(status).map(|text| vec![piece(text, Tone::Warning)]));
            let live = status.devices.iter().filter(|of| of.state == DeviceState::Live);
            let live = live.take(texts_max).map(|of| vec![piece(devices::line(of), Tone::Plain)]);
            lines.extend(live);
            lines.extend(first_of(&status.warnings, "warning", Tone::Warning, texts_max));
            lines.extend(first_of(&status.notes, "note", Tone::Quiet, texts_max));
            // The last line is for the key that ends it.
            let room = height.saturating_sub(lines.len() + 1);
            lines.extend(channel_lines(status, view, width, room));
        }
    }
    lines
}

/// The first of these texts, a line each, and a line that counts the rest.
fn first_of<'a>(
    texts: &'a [String],
    kind: &'a str,
    tone: Tone,
    texts_max: usize,
) -> impl Iterator<Item = Line> + 'a {
    let more = texts.len().saturating_sub(texts_max);
    let more = (more > 0).then(|| format!("and {}", counted(more, &format!("more {kind}"))));
    let first = texts.iter().take(texts_max).map(move |text| format!("{kind}: {text}"));
    first.chain(more).map(move |text| vec![piece(text, tone)])
}

/// The manager that leads, where several share the wall.
fn leader_in_words(status: &WallStatus) -> impl Iterator<Item = String> {
    let leader = status.leader.iter();
    leader.map(|leader| format!("led by {}, term {}", printable(&leader.holder), leader.term))
}

/// The first scenes that are being opened.
fn openings(status: &WallStatus) -> impl Iterator<Item = String> {
    let openings = status.opening.iter().take(TEXTS_MAX);
    openings.map(|opening| format!("opening {}: {}", printable(&opening.scene), opening.progress))
}

/// The wall in one line, for a log.
pub(super) fn summary(view: &WatchModel) -> String {
    let Some(status) = view.status.filter(|_| view.trouble.is_none()) else {
        return view.trouble.as_ref().map_or_else(|| "connecting …".into(), trouble_in_words);
    };
    let of_channel = |channel: &ChannelStatus| {
        let (name, state) = (&channel.name, channel.state.name());
        let reason = channel.reason.as_ref().map(|reason| format!(": {reason}"));
        format!("{name} {state} {}{}", since(channel.since_ms), reason.unwrap_or_default())
    };
    let troubled = by_importance(&status.channels).filter(|c| c.state != ChannelState::Live);
    let mut parts = vec![wall_in_words(status, view.rates), counts_in_words(&status.channels)];
    parts.extend(openings(status));
    parts.extend(modes_in_words(status));
    parts.extend(troubled.map(of_channel));
    if let [first, rest @ ..] = &status.notes[..] {
        let more =
            if rest.is_empty() { String::new() } else { format!(" (and {} more)", rest.len()) };
        parts.push(format!("note: {first}{more}"));
    }
    plain(&parts.join("; "))
}

fn trouble_in_words(trouble: &Trouble) -> String {
    let of_day = trouble.since_utc_s % 86_400;
    let (hours, minutes, seconds) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!(
        "no answer from {} since {hours:02}:{minutes:02}:{seconds:02} UTC ({}), trying again: {}",
        trouble.manager,
        since(trouble.seconds * 1000),
        trouble.reason
    )
}

fn wall_in_words(status: &WallStatus, rates: &Rates) -> String {
    format!(
        "wall {}  scene {}{}  revision {}  frame {}  {} fps  deadline {:.0} ms  {}",
        status.wall,
        status.scene.as_deref().unwrap_or("none"),
        status.environment.as_ref().map_or_else(String::new, |of| format!(" in {of}")),
        status.revision,
        status.frame,
        rates.wall().map_or_else(|| "-".into(), |rate| format!("{rate:.1}")),
        status.deadline_ms,
        counted(status.clients.len(), "client"),
    )
}

/// What displays and channels show instead of the scene, and how that ends.
fn modes_in_words(status: &WallStatus) -> impl Iterator<Item = String> {
    let mode = status.presentation.output_mode.name();
    let displays = (status.presentation.output_mode != OutputMode::Normal)
        .then(|| ["displays: ", mode, ", until: polyptych ", mode, " --off"].concat());
    let pattern = status
        .presentation
        .pattern
        .map(|pattern| ["pattern: ", pattern.name(), ", until: polyptych pattern --off"].concat());
    let rest = status.rest.is_resting.then(|| {
        "displays: dark by themselves, until the wall is used or: polyptych rest --off".to_owned()
    });
    displays.into_iter().chain(pattern).chain(rest)
}

/// Such as `62 live, 1 late, 1 lost`, the worst first.
fn counts_in_words<'a>(channels: impl IntoIterator<Item = &'a ChannelStatus>) -> String {
    let mut counts: Vec<(ChannelState, usize)> = Vec::new();
    for channel in channels {
        match counts.iter_mut().find(|(state, _)| *state == channel.state) {
            Some((_, count)) => *count += 1,
            None => counts.push((channel.state, 1)),
        }
    }
    counts.sort_by_key(|&(state, _)| importance(state));
    let words = counts.iter().map(|&(state, count)| format!("{count} {}", state.name()));
    words.collect::<Vec<_>>().join(", ")
}

/// Header, rows, and what had no room; of at most `room` lines.
fn channel_lines(status: &WallStatus, view: &WatchModel, width: usize, room: usize) -> Vec<Line> {
    if room < 2 {
        return Vec::new();
    }
    let rows = room - 1;
    let channels = &status.channels;
    let shown: Vec<&ChannelStatus> = if channels.len() <= rows {
        channels.iter().collect()
    } else {
        by_importance(channels).take(rows - 1).collect()
    };
    let index = |of: &ChannelStatus| channels.iter().position(|c| std::ptr::eq(c, of));
    let rate = |of: &ChannelStatus| index(of).and_then(|index| view.rates.channel(index));
    let cells: Vec<[String; COLUMNS.len()]> =
        shown.iter().map(|channel| COLUMNS.map(|c| cell(c, channel, rate(channel)))).collect();
    let widths = fitting_widths(&cells, width);
    let is_stale = view.trouble.is_some();
    let row = |texts: &[String; COLUMNS.len()], tone: &dyn Fn(Column) -> Tone| {
        let columns = COLUMNS.iter().zip(texts).zip(&widths);
        let columns =
            columns.filter_map(|((&column, text), width)| Some((column, text, (*width)?)));
        let pieces = columns.flat_map(|(column, text, width)| {
            let text = aligned(column, &shortened(text, width), width);
            [piece(text, tone(column)), piece(" ".repeat(GAP), Tone::Plain)]
        });
        pieces.collect::<Line>()
    };
    let mut lines = vec![row(&COLUMNS.map(|c| head(c).to_owned()), &|_| Tone::Head)];
    for (channel, texts) in shown.iter().zip(&cells) {
        lines.push(row(texts, &|column| match column {
            _ if is_stale => Tone::Quiet,
            Column::State => tone(channel.state),
            _ => Tone::Plain,
        }));
    }
    if shown.len() < channels.len() {
        let left = by_importance(channels).skip(shown.len());
        let text = format!("and {} more: {}", channels.len() - shown.len(), counts_in_words(left));
        lines.push(vec![piece(text, Tone::Quiet)]);
    }
    lines
}

fn by_importance(channels: &[ChannelStatus]) -> impl Iterator<Item = &ChannelStatus> {
    let mut sorted: Vec<&ChannelStatus> = channels.iter().collect();
    sorted.sort_by_key(|channel| importance(channel.state));
    sorted.into_iter()
}

/// The least is what a person should see first.
fn importance(state: ChannelState) -> u8 {
    match state {
        ChannelState::Lost => 0,
        ChannelState::Late => 1,
        ChannelState::Joining => 2,
        ChannelState::Preparing => 3,
        ChannelState::Ready => 4,
        ChannelState::Live => 5,
    }
}

fn tone(state: ChannelState) -> Tone {
    match state {
        ChannelState::Lost => Tone::Bad,
        ChannelState::Late => Tone::Warning,
        ChannelState::Joining | ChannelState::Preparing | ChannelState::Ready => Tone::Busy,
        ChannelState::Live => Tone::Good,
    }
}

fn head(column: Column) -> &'static str {
    match column {
        Column::Channel => "CHANNEL",
        Column::State => "STATE",
        Column::For => "FOR",
        Column::Frame => "FRAME",
        Column::Rate => "FPS",
        Column::Draw => "DRAW",
        // Of present calls: half, 99 of 100 and all are below; and how far off the clock may be.
        Column::Skew => "SKEW P50/P99/MAX ±CLOCK",
        Column::Late => "LATE",
        Column::Memory => "MEMORY",
        Column::Pid => "PID",
        Column::Address => "ADDRESS",
        Column::Reason => "REASON",
    }
}

fn cell(column: Column, channel: &ChannelStatus, rate: Option<f64>) -> String {
    let nothing = || "-".to_owned();
    match column {
        Column::Channel => shortened(&plain(&channel.name), NAME_WIDTH_MAX),
        Column::State => channel.state.name().to_owned(),
        Column::For => since(channel.since_ms),
        Column::Frame => channel.frame.to_string(),
        Column::Rate => rate.map_or_else(nothing, |rate| format!("{rate:.1}")),
        Column::Draw => {
            let in_ms = |us: u32| format!("{:.1} ms", f64::from(us) / 1000.0);
            channel.draw_us.map_or_else(nothing, in_ms)
        }
        Column::Skew => {
            let Skew { frames, p50_us, p99_us, max_us, clock_error_us } = channel.skew;
            let error_us = clock_error_us.filter(|_| frames > 0);
            let in_words = |error_us| format!("{p50_us}/{p99_us}/{max_us} ±{error_us} µs");
            error_us.map_or_else(nothing, in_words)
        }
        Column::Late => channel.late.to_string(),
        Column::Memory if channel.memory_bytes == 0 => nothing(),
        Column::Memory => format!("{:.0} MB", channel.memory_bytes as f64 * 1e-6),
        Column::Pid => channel.pid.map_or_else(nothing, |pid| pid.to_string()),
        Column::Address => plain(channel.address.as_deref().unwrap_or("-")),
        Column::Reason => plain(channel.reason.as_deref().unwrap_or_default()),
    }
}

/// A length of time in as few characters as say it.
fn since(ms: u64) -> String {
    match ms / 1000 {
        0..60 => format!("{:.1} s", ms as f64 / 1000.0),
        seconds @ 60..3600 => format!("{} min", seconds / 60),
        seconds @ 3600..172_800 => format!("{} h", seconds / 3600),
        seconds => format!("{} d", seconds / 86_400),
    }
}

/// The width of every column; `None` for one that has no room.
fn fitting_widths(
    cells: &[[String; COLUMNS.len()]],
    width: usize,
) -> [Option<usize>; COLUMNS.len()] {
    let widest = |index: usize| cells.iter().map(|row| row[index].width()).max().unwrap_or(0);
    let wanted: Vec<usize> =
        (0..COLUMNS.len()).map(|index| widest(index).max(head(COLUMNS[index]).width())).collect();
    let reason = COLUMNS.len() - 1;
    let has_reason = widest(reason) > 0;
    let reason_min = if has_reason { wanted[reason].min(REASON_WIDTH_MIN) } else { 0 };
    let mut widths: [Option<usize>; COLUMNS.len()] = std::array::from_fn(|i| Some(wanted[i]));
    let of_others = |widths: &[Option<usize>; COLUMNS.len()]| {
        widths[..reason].iter().flatten().map(|width| width + GAP).sum::<usize>()
    };
    for dispensable in DISPENSABLE {
        if of_others(&widths) + reason_min <= width {
            break;
        }
        if let Some(index) = COLUMNS.iter().position(|&column| column == dispensable) {
            widths[index] = None;
        }
    }
    let left = width.saturating_sub(of_others(&widths));
    widths[reason] = Some(wanted[reason].min(left)).filter(|&width| has_reason && width > 0);
    widths
}

/// Words to the left, numbers to the right.
fn aligned(column: Column, text: &str, width: usize) -> String {
    let padding = " ".repeat(width.saturating_sub(text.width()));
    match column {
        Column::Channel | Column::State | Column::Address | Column::Reason => {
            format!("{text}{padding}")
        }
        _ => format!("{padding}{text}"),
    }
}

/// The same in at most so many columns.
fn shortened(text: &str, width: usize) -> String {
    if text.width() <= width {
        return text.to_owned();
    }
    let mut short = String::new();
    let mut left = width.saturating_sub(1);
    for c in text.chars() {
        match left.checked_sub(c.width().unwrap_or(0)) {
            Some(rest) => left = rest,
            None => break,
        }
        short.push(c);
    }
    if width > 0 {
        short.push('…');
    }
    short
}

/// Texts of files and peers stand here, which must not move the cursor.
fn plain(text: &str) -> String {
    printable(text).into_owned()
}

/// The line as far as the terminal reaches.
fn fitted(line: Line, width: usize) -> Line {
    let mut left = width;
    let fit = |Piece { text, tone }: Piece| {
        let text = shortened(&plain(&text), left);
        left -= text.width();
        Piece { text, tone }
    };
    let mut line: Line = line.into_iter().map(fit).filter(|piece| !piece.text.is_empty()).collect();
    while line.pop_if(|piece| piece.text.trim().is_empty()).is_some() {}
    if let Some(last) = line.last_mut() {
        last.text.truncate(last.text.trim_end().len());
    }
    line
}

fn piece(text: impl Into<String>, tone: Tone) -> Piece {
    Piece { text: text.into(), tone }
}

#[cfg(test)]
pub(super) mod tests;
