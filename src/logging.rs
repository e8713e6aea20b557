//! The log of this process, on standard error: text for people, or JSON, one object a line.
//!
//! Several processes of a wall on one machine write to the same standard error. Each line is one
//! write and not longer than a pipe takes whole, and says which process wrote it. A thread of its
//! own writes them, so that nothing else waits for who reads standard error.

mod limit;
mod queue;

use std::fmt;
use std::io::{IsTerminal, Write};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use limit::Budgets;
use polyptych_text::printable;
use queue::Queue;
use serde::de::IgnoredAny;
use serde_json::json;
use tracing::field::Field;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::fmt::format::{self, Format, Json, JsonFields, Writer};
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Maximum bytes of a line: what a pipe takes in one piece (`PIPE_BUF` of Linux). A longer one
/// could be torn by another process's.
const LINE_BYTES_MAX: usize = 4096;

/// Bytes of a longer line that are kept; escaped again they are at most twice as many.
const CUT_BYTES_MAX: usize = 1800;

/// The text of a line in the place of one that no pipe takes whole.
const TOO_LONG: &str = "a line too long to be written";

/// The end of a line of text that was cut.
const CUT: &str = "… (cut)\n";

/// Maximum time for which the end of a process waits for lines that are not written yet.
const FLUSH_TIME_MAX: Duration = Duration::from_millis(300);

/// The form of the log, as given by `--log`: `json` or `text`, and a filter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LogOptions {
    is_json: bool,
    filter: Option<String>,
}

/// The options chosen at the start; like the subscriber, there is one set for the process.
static CHOSEN: OnceLock<LogOptions> = OnceLock::new();

/// Lines on their way to standard error; `None` if the system gave no thread for it.
static QUEUE: OnceLock<Option<Queue>> = OnceLock::new();

/// The kind of this process, which every line of JSON states.
static PROCESS: OnceLock<&'static str> = OnceLock::new();

impl LogOptions {
    /// Reads `json`, `text`, a filter, or both with a comma between.
    ///
    /// # Errors
    /// The filter is invalid; the error says why.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut wish = Self::default();
        let mut directives = Vec::new();
        for part in text.split(',') {
            match part.trim() {
                "json" => wish.is_json = true,
                "text" => wish.is_json = false,
                directive => directives.push(directive),
            }
        }
        if !directives.is_empty() {
            let filter = directives.join(",");
            EnvFilter::try_new(&filter).map_err(|error| error.to_string())?;
            wish.filter = Some(filter);
        }
        Ok(wish)
    }
}

/// Begins the log. `level` is the filter where none was asked for; `process` stands in every line
/// of JSON.
pub(crate) fn start(wish: Option<&LogOptions>, level: &str, process: &'static str) {
    let process = PROCESS.get_or_init(|| process);
    let wish = CHOSEN.get_or_init(|| wish.cloned().unwrap_or_default());
    // The driver libraries log what is of interest to their own developers.
    let quiet = format!("{level},wgpu_core=warn,wgpu_hal=error,naga=warn,winit=error");
    let filter = wish.filter.as_deref().map(EnvFilter::try_new);
    let filter = filter.and_then(Result::ok).unwrap_or_else(|| EnvFilter::new(quiet));
    QUEUE.get_or_init(|| Queue::start(std::io::stderr(), dropped_line).ok());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(|| LogWriter);
    let budgets = Budgets::default();
    if wish.is_json {
        let lines = JsonLines { json: Format::default().json(), head: LinePrefix::new(process) };
        let lines = Limited { lines, budgets };
        log.fmt_fields(JsonFields::new()).event_format(lines).init();
    } else {
        let fields = format::debug_fn(write_field).delimited(" ");
        let lines = Limited { lines: Format::default(), budgets };
        // Colours are for people: a log file with escape codes can't be searched.
        let is_colored = std::io::stderr().is_terminal() && !is_plain();
        log.with_ansi(is_colored).fmt_fields(fields).event_format(lines).init();
    }
    std::panic::set_hook(Box::new(|panic| {
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("without a name");
        say_last_words(&format!("thread {name}: {panic}"));
        finish();
    }));
}

/// Writes what waits, as far as standard error takes it within a short time. The end of the
/// process calls it.
pub(crate) fn finish() {
    if let Some(Some(queue)) = QUEUE.get() {
        queue.flush(FLUSH_TIME_MAX);
    }
}

/// Writes a field of a line of text. Text of peers stands in fields, and must not move a
/// terminal's cursor or look like lines of their own.
fn write_field(writer: &mut Writer<'_>, field: &Field, value: &dyn fmt::Debug) -> fmt::Result {
    let value = format!("{value:?}");
    let (name, value) = (field.name(), printable(&value));
    if name == "message" {
        return writer.write_str(&value);
    }
    if writer.has_ansi_escapes() {
        return write!(writer, "\u{1b}[3m{name}\u{1b}[0m\u{1b}[2m=\u{1b}[0m{value}");
    }
    write!(writer, "{name}={value}")
}

/// Returns whether the environment asks for no colours (<https://no-color.org>).
pub(crate) fn is_plain() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

/// Returns whether standard error is for programs: nothing else may be written there.
pub(crate) fn is_json() -> bool {
    CHOSEN.get().is_some_and(|wish| wish.is_json)
}

/// Returns the `--log` of a child process. Only its errors are logged by default: its warnings are
/// for a wall, and on one machine connecting again is normal.
pub(crate) fn of_children() -> String {
    let wish = CHOSEN.get().cloned().unwrap_or_default();
    let form = if wish.is_json { "json" } else { "text" };
    format!("{form},{}", wish.filter.as_deref().unwrap_or("error"))
}

/// The last words of a command that failed: they are written even if lines before them are not.
pub(crate) fn say_failure(process: &'static str, text: &str) {
    if is_json() {
        emit(json_line("ERROR", process, text).as_bytes(), true);
    } else {
        emit(format!("{text}\n").as_bytes(), true);
    }
}

/// Logs a warning: the command did its work, but not as a person would expect.
pub(crate) fn say_warning(text: &str) {
    if is_json() {
        emit(json_line("WARN", process(), text).as_bytes(), false);
    } else {
        emit(format!("warning: {text}\n").as_bytes(), false);
    }
}

/// Passes on a line that another process of the wall wrote to its standard error.
pub(crate) fn pass_on(child: &str, line: &str) {
    if !is_json() {
        emit(format!("{child}: {line}\n").as_bytes(), false);
    } else if line.starts_with('{') && serde_json::from_str::<IgnoredAny>(line).is_ok() {
        emit(format!("{line}\n").as_bytes(), false);
    } else {
        say_warning(&format!("{child}: {line}"));
    }
}

/// A line for people who wait. Logs for programs do not have it.
pub(crate) fn say_progress(text: &str) {
    if !is_json() {
        emit(format!("{text}\n").as_bytes(), false);
    }
}

/// Draws on a terminal what is soon drawn anew. While the terminal takes nothing it is not drawn.
pub(crate) fn draw(bytes: &[u8]) {
    if let Some(Some(queue)) = QUEUE.get() {
        queue.push_drawing(bytes);
    }
}

/// The message of a panic.
fn say_last_words(text: &str) {
    if is_json() {
        emit(json_line("ERROR", process(), text).as_bytes(), true);
    } else {
        let lines: Vec<_> = text.lines().map(printable).collect();
        emit(format!("{}\n", lines.join("\n")).as_bytes(), true);
    }
}

fn process() -> &'static str {
    PROCESS.get().copied().unwrap_or("polyptych")
}

/// A line of JSON past all filters.
fn json_line(level: &str, process: &'static str, text: &str) -> String {
    let message = cut(text, CUT_BYTES_MAX);
    let rest = json!({ "level": level, "fields": { "message": message }, "target": "polyptych" });
    LinePrefix::new(process).before(&rest.to_string())
}

/// A line that says how many others are missing.
fn dropped_line(count: u64) -> String {
    missing_line(count, "dropped", "standard error was not read: log lines were dropped")
}

/// A line that says how many others are missing, and why.
fn missing_line(count: u64, key: &str, why: &str) -> String {
    let mut timestamp = String::new();
    // A time before 1970 has no text; the line is worth more than its time.
    let _ = SystemTime.format_time(&mut Writer::new(&mut timestamp));
    if !is_json() {
        return format!("{timestamp}  WARN polyptych: {why} {key}={count}\n");
    }
    let rest = json!({
        "timestamp": timestamp,
        "level": "WARN",
        "fields": { "message": why, key: count },
        "target": "polyptych",
    });
    LinePrefix::new(process()).before(&rest.to_string())
}

/// Hands a line to the thread that writes.
fn emit(line: &[u8], is_last_words: bool) {
    match QUEUE.get() {
        Some(Some(queue)) if is_last_words => queue.push_last_words(line),
        Some(Some(queue)) => queue.push(line),
        // Where standard error is closed, there is nobody to tell.
        _ => drop(std::io::stderr().write_all(line)),
    }
}

/// Takes the lines of the log, each in one call.
#[derive(Clone, Copy, Debug)]
struct LogWriter;

impl Write for LogWriter {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(line);
        if text.len() > LINE_BYTES_MAX {
            let kept = cut(&text, LINE_BYTES_MAX - CUT.len());
            emit(format!("{kept}{CUT}").as_bytes(), false);
        } else {
            emit(line, false);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The members that every line begins with.
#[derive(Debug)]
struct LinePrefix {
    process: &'static str,
    pid: u32,
}

impl LinePrefix {
    fn new(process: &'static str) -> Self {
        Self { process, pid: std::process::id() }
    }

    /// The head and then the members of this JSON object.
    fn before(&self, object: &str) -> String {
        let (process, pid) = (self.process, self.pid);
        let members = object.trim_end().strip_prefix('{').unwrap_or("}");
        format!("{{\"process\":\"{process}\",\"pid\":{pid},{members}\n")
    }
}

/// Lines of which no place of the program writes too many.
#[derive(Debug)]
struct Limited<L> {
    lines: L,
    budgets: Budgets,
}

impl<S, N, L> FormatEvent<S, N> for Limited<L>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
    L: FormatEvent<S, N>,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let facts = event.metadata();
        // Who asks for more than is said by default has all of it.
        if *facts.level() <= Level::INFO {
            let place = (facts.file().unwrap_or(facts.target()), facts.line().unwrap_or(0));
            match self.budgets.take(Instant::now(), place) {
                None => return Ok(()),
                Some(0) => {}
                Some(count) => {
                    let why = "lines like the next one were left out, there were too many";
                    writer.write_str(&missing_line(count, "left_out", why))?;
                }
            }
        }
        self.lines.format_event(context, writer, event)
    }
}

/// The crate's lines of JSON with a head, and never torn.
#[derive(Debug)]
struct JsonLines {
    json: Format<Json>,
    head: LinePrefix,
}

impl<S, N> FormatEvent<S, N> for JsonLines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut object = String::new();
        self.json.format_event(context, Writer::new(&mut object), event)?;
        let line = self.head.before(&object);
        if line.len() <= LINE_BYTES_MAX {
            return writer.write_str(&line);
        }
        let mut timestamp = String::new();
        SystemTime.format_time(&mut Writer::new(&mut timestamp))?;
        let facts = event.metadata();
        let object = json!({
            "timestamp": timestamp,
            "level": facts.level().to_string(),
            "fields": { "message": TOO_LONG, "cut": cut(&object, CUT_BYTES_MAX) },
            "target": facts.target(),
        });
        writer.write_str(&self.head.before(&object.to_string()))
    }
}

/// At most so many bytes from the beginning.
fn cut(text: &str, bytes_max: usize) -> &str {
    &text[..text.floor_char_boundary(bytes_max)]
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use serde_json::Value;

    use super::*;

    #[test]
    fn a_wish_is_a_form_and_a_filter() {
        let wish = |is_json, filter: Option<&str>| {
            Ok(LogOptions { is_json, filter: filter.map(str::to_owned) })
        };
        assert_eq!(LogOptions::parse("json"), wish(true, None));
        assert_eq!(LogOptions::parse("text"), wish(false, None));
        assert_eq!(LogOptions::parse("info"), wish(false, Some("info")));
        assert_eq!(
            LogOptions::parse("json,warn,polyptych_render=debug"),
            wish(true, Some("warn,polyptych_render=debug"))
        );
        assert!(LogOptions::parse("json,a=b=c").is_err());
    }

    #[test]
    fn a_line_of_text_is_one_line_without_control_characters() {
        let kept = Kept::default();
        let writer = kept.clone();
        let log = tracing_subscriber::fmt()
            .with_ansi(false)
            .fmt_fields(format::debug_fn(write_field).delimited(" "))
            .event_format(Limited { lines: Format::default(), budgets: Budgets::default() })
            .with_writer(move || writer.clone())
            .finish();
        let bad = "\u{1b}[2J\r\nERROR forged \u{9b}1m \u{202e}";
        tracing::subscriber::with_default(log, || {
            let _server = tracing::error_span!("server", server = %bad, session = 3).entered();
            tracing::warn!(reason = %bad, quoted = bad, number = 7, "late {bad}");
        });
        let text = String::from_utf8(kept.0.lock().expect("not poisoned").clone()).expect("UTF-8");
        let is_raw = |c: char| c.is_control() || c == '\u{202e}';
        assert!(!text.trim_end_matches('\n').contains(is_raw), "{text:?}");
        assert_eq!(text.lines().count(), 1, "{text}");
        let escaped = "\\u{1b}[2J\\r\\nERROR forged \\u{9b}1m \\u{202e}";
        for part in [
            format!("late {escaped}"),
            format!("reason={escaped}"),
            format!("server={escaped}"),
            "number=7".to_owned(),
            "session=3".to_owned(),
        ] {
            assert!(text.contains(&part), "{part}: {text}");
        }
    }

    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Vec<u8>>>);

    impl Write for Kept {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().expect("not poisoned").extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn lines_of(work: impl FnOnce()) -> Vec<Value> {
        let kept = Kept::default();
        let writer = kept.clone();
        let lines = JsonLines { json: Format::default().json(), head: LinePrefix::new("manager") };
        let log = tracing_subscriber::fmt()
            .fmt_fields(JsonFields::new())
            .event_format(lines)
            .with_writer(move || writer.clone())
            .finish();
        tracing::subscriber::with_default(log, work);
        let text = String::from_utf8(kept.0.lock().expect("not poisoned").clone()).expect("UTF-8");
        let parse = |line: &str| {
            assert!(line.len() < LINE_BYTES_MAX, "{} bytes", line.len());
            serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))
        };
        text.lines().map(parse).collect()
    }

    #[test]
    fn a_line_says_process_spans_and_fields() {
        let lines = lines_of(|| {
            let _server = tracing::error_span!("server", session = 3, server = "left").entered();
            let _frame = tracing::error_span!("frame", frame = 7).entered();
            tracing::warn!(reason = "a\n\"b\"", "late");
        });
        let [line] = &lines[..] else { panic!("{lines:?}") };
        assert_eq!((&line["process"], &line["level"]), (&"manager".into(), &"WARN".into()));
        assert_eq!(line["pid"], std::process::id());
        assert_eq!(line["fields"]["message"], "late");
        assert_eq!(line["fields"]["reason"], "a\n\"b\"");
        assert_eq!(line["spans"][0]["session"], 3);
        assert_eq!(line["spans"][0]["server"], "left");
        assert_eq!(line["spans"][1]["frame"], 7);
        assert!(line["timestamp"].as_str().is_some_and(|time| time.ends_with('Z')), "{line}");
    }

    #[test]
    fn a_line_too_long_is_cut_and_still_json() {
        for text in ["ä\"".repeat(2000), "\u{1}".repeat(5000), "x".repeat(1 << 20)] {
            let lines = lines_of(|| tracing::warn!(reason = text, "long"));
            let [line] = &lines[..] else { panic!("{lines:?}") };
            assert!(line["fields"]["cut"].as_str().is_some_and(|cut| cut.contains("long")));
            assert_eq!(line["level"], "WARN");
        }
    }
}
