//! Requests to end a film early, after which the wall runs on as before.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::Builder;
use std::time::Duration;

use polyptych_client::blocking::Client;

use super::wall_before::WallBefore;
use crate::cli::shutdown_signal::watch_shutdown_signals;
use crate::logging;

/// Exit code of a film that was interrupted twice: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// The longest that the second interruption waits for the manager's answer.
const RESUME_TIME_MAX: Duration = Duration::from_secs(2);

/// A request to end the film, which may come at any time.
#[derive(Clone, Debug, Default)]
pub(super) struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Watches for requests to end. The first ends the film after its frame; the second gives
    /// the wall back what it had before, and ends this process at once.
    ///
    /// # Errors
    /// The system lets this process handle no signals.
    pub fn watch(client: Client, before: WallBefore) -> std::io::Result<Self> {
        let asked = Self::default();
        let on_request = asked.clone();
        watch_shutdown_signals(None, move || {
            if !on_request.0.swap(true, Ordering::Relaxed) {
                logging::say_warning("interrupted: the film ends after this frame");
                return;
            }
            match resumed_by(&client, before) {
                Ok(()) => logging::say_warning("interrupted again: the film ends at once"),
                Err(error) => logging::say_warning(&format!("the wall may stay paused: {error}")),
            }
            logging::finish();
            std::process::exit(INTERRUPTED);
        })?;
        Ok(asked)
    }

    /// Returns whether the film is to end.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Gives the wall back what it had before. A manager that is away is not waited for as long as a
/// film would.
fn resumed_by(client: &Client, before: WallBefore) -> Result<(), String> {
    let (done, answer) = mpsc::sync_channel(1);
    let client = client.clone();
    // Whoever asks twice wants this process to end: the thread ends with it.
    let resume = move || drop(done.send(before.restore(&client)));
    Builder::new().name("resume".into()).spawn(resume).map_err(|error| error.to_string())?;
    match answer.recv_timeout(RESUME_TIME_MAX) {
        Ok(resumed) => resumed.map_err(|error| error.to_string()),
        Err(_) => Err(format!("the manager has not answered within {RESUME_TIME_MAX:?}")),
    }
}
