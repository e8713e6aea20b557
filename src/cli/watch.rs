//! `polyptych status --watch`: the status of a running wall, again and again.
//!
//! In a terminal a live table. Elsewhere a line a second, for logs and `grep`; with `--json` an
//! object a second.

mod rates;
pub(super) mod status_poller;
mod table;
mod terminal;

use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use polyptych_client::WallStatus;

use super::ManagerAddress;
use super::shutdown_signal::watch_shutdown_signals;
use status_poller::{Latest, StatusPoller};
use terminal::Terminal;

/// Between two looks at keys and news: quick for a hand, idle for a processor.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

/// At least so often the table is drawn: the time that a manager is gone goes on.
const DRAW_PERIOD: Duration = Duration::from_secs(1);

/// Between two lines where there is no terminal.
const LINE_PERIOD: Duration = Duration::from_secs(1);

/// The status of a wall as one table: the one that is watched, as wide and as long as it is.
pub(super) fn table(status: &WallStatus) -> String {
    table::text(status)
}

/// Watches until a person or a signal ends it.
///
/// # Errors
/// The terminal or standard output failed.
pub(super) fn run(manager: &ManagerAddress, json: bool) -> anyhow::Result<()> {
    let is_over = ended_by_signal()?;
    let source = StatusPoller::start(manager)?;
    if json || !std::io::stdout().is_terminal() {
        return print_lines(&source, json, &is_over);
    }
    let mut screen = Terminal::open()?;
    let mut drawn: Option<(u64, Instant)> = None;
    while !is_over.load(Ordering::Relaxed) {
        let input = Terminal::await_input(LOOK_PERIOD)?;
        if input.is_end {
            break;
        }
        let latest = source.latest();
        let is_news = drawn.is_none_or(|(number, _)| number != latest.number);
        let is_old = drawn.is_none_or(|(_, at)| at.elapsed() >= DRAW_PERIOD);
        if is_news || is_old || input.is_resized {
            let (width, height) = Terminal::size()?;
            screen.draw(&table::lines(&latest.view(), width, height))?;
            drawn = Some((latest.number, Instant::now()));
        }
    }
    Ok(())
}

fn print_lines(source: &StatusPoller, json: bool, is_over: &AtomicBool) -> anyhow::Result<()> {
    // The first line is worth waiting for an answer, the others come by the clock.
    let mut due = Instant::now() + LINE_PERIOD;
    while source.latest().number == 0 && Instant::now() < due {
        std::thread::sleep(LOOK_PERIOD);
    }
    due = Instant::now();
    while !is_over.load(Ordering::Relaxed) {
        if Instant::now() < due {
            std::thread::sleep(LOOK_PERIOD);
            continue;
        }
        // A process that was stopped for a while says nothing of that time.
        due = (due + LINE_PERIOD).max(Instant::now());
        let line = line_of(&source.latest(), json)?;
        match writeln!(std::io::stdout(), "{line}") {
            // A reader that has seen enough.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => return Ok(()),
            written => written?,
        }
    }
    Ok(())
}

fn line_of(latest: &Latest, json: bool) -> anyhow::Result<String> {
    if !json {
        return Ok(table::summary(&latest.view()));
    }
    Ok(match (&latest.trouble, &latest.status) {
        (None, Some(status)) => serde_json::to_string(status)?,
        (Some(trouble), _) => serde_json::json!({ "error": trouble.reason }).to_string(),
        (None, None) => serde_json::json!({ "error": "no answer yet" }).to_string(),
    })
}

/// Becomes true at SIGTERM, and at SIGINT where the terminal does not read Ctrl-C as a key.
fn ended_by_signal() -> anyhow::Result<Arc<AtomicBool>> {
    let is_over = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&is_over);
    watch_shutdown_signals(None, move || ended.store(true, Ordering::Relaxed))?;
    Ok(is_over)
}
