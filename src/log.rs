//! The log of this process, on standard error: text for people, or JSON, one object a line.
//!
//! Several processes of a wall on one machine write to the same standard error. Each line is one
//! write and not longer than a pipe takes whole, and says which process wrote it.

use std::fmt;
use std::io::{IsTerminal, Write};
use std::sync::OnceLock;

use serde_json::json;
use tracing::{Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::{Format, Json, JsonFields, Writer};
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Longest line of JSON: what a pipe takes in one piece (`PIPE_BUF` of Linux). A longer one could
/// be torn by another process's.
const LINE_BYTES_MAX: usize = 4096;

/// Bytes of a longer line that are kept; escaped again they are at most twice as many.
const CUT_BYTES_MAX: usize = 1800;

/// What a line says in the place of one that no pipe takes whole.
const TOO_LONG: &str = "a line too long to be written";

/// What the log is like, as `--log` says: `json` or `text`, and a filter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LogWish {
    is_json: bool,
    filter: Option<String>,
}

/// What was chosen at the start; like the subscriber, one for the process.
static CHOSEN: OnceLock<LogWish> = OnceLock::new();

/// What this process is, as every line of JSON says.
static PROCESS: OnceLock<&'static str> = OnceLock::new();

impl LogWish {
    /// Reads `json`, `text`, a filter, or both with a comma between.
    ///
    /// # Errors
    /// What the filter does not mean.
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
pub(crate) fn start(wish: Option<&LogWish>, level: &str, process: &'static str) {
    let process = PROCESS.get_or_init(|| process);
    let wish = CHOSEN.get_or_init(|| wish.cloned().unwrap_or_default());
    // The driver libraries log what is of interest to their own developers.
    let quiet = format!("{level},wgpu_core=warn,wgpu_hal=error,naga=warn,winit=error");
    let filter = wish.filter.as_deref().map(EnvFilter::try_new);
    let filter = filter.and_then(Result::ok).unwrap_or_else(|| EnvFilter::new(quiet));
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    if wish.is_json {
        let lines = Lines { json: Format::default().json(), head: Head::new(process) };
        log.fmt_fields(JsonFields::new()).event_format(lines).init();
        std::panic::set_hook(Box::new(move |panic| {
            say_json(process, &panic.to_string());
        }));
    } else {
        // Colours are for people: a log file with escape codes can't be searched.
        log.with_ansi(std::io::stderr().is_terminal() && !is_plain()).init();
    }
}

/// Whether the environment asks for no colours (<https://no-color.org>).
pub(crate) fn is_plain() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

/// Whether standard error is for programs: nothing else may be written there.
pub(crate) fn is_json() -> bool {
    CHOSEN.get().is_some_and(|wish| wish.is_json)
}

/// What `--log` of a child process is. Its warnings are for a wall: connecting again is daily work
/// on one machine.
pub(crate) fn of_children() -> String {
    let wish = CHOSEN.get().cloned().unwrap_or_default();
    let form = if wish.is_json { "json" } else { "text" };
    format!("{form},{}", wish.filter.as_deref().unwrap_or("error"))
}

/// The last words of a command that failed.
pub(crate) fn say_failure(process: &'static str, text: &str) {
    if is_json() {
        say_json(process, text);
    } else {
        eprintln!("{text}");
    }
}

/// What a command did, but not as a person would expect.
pub(crate) fn say_warning(text: &str) {
    if is_json() {
        say_json_at("WARN", PROCESS.get().copied().unwrap_or("polyptych"), text);
    } else {
        eprintln!("warning: {text}");
    }
}

fn say_json(process: &'static str, text: &str) {
    say_json_at("ERROR", process, text);
}

/// Writes a line of JSON past all filters.
fn say_json_at(level: &str, process: &'static str, text: &str) {
    let message = cut(text, CUT_BYTES_MAX);
    let rest = json!({ "level": level, "fields": { "message": message }, "target": "polyptych" });
    let line = Head::new(process).before(&rest.to_string());
    // Where standard error is closed, there is nobody to tell.
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// What every line begins with.
#[derive(Debug)]
struct Head {
    process: &'static str,
    pid: u32,
}

impl Head {
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

/// The crate's lines of JSON with a head, and never torn.
#[derive(Debug)]
struct Lines {
    json: Format<Json>,
    head: Head,
}

impl<S, N> FormatEvent<S, N> for Lines
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
            Ok(LogWish { is_json, filter: filter.map(str::to_owned) })
        };
        assert_eq!(LogWish::parse("json"), wish(true, None));
        assert_eq!(LogWish::parse("text"), wish(false, None));
        assert_eq!(LogWish::parse("info"), wish(false, Some("info")));
        assert_eq!(
            LogWish::parse("json,warn,polyptych_render=debug"),
            wish(true, Some("warn,polyptych_render=debug"))
        );
        assert!(LogWish::parse("json,a=b=c").is_err());
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
        let lines = Lines { json: Format::default().json(), head: Head::new("manager") };
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
