//! Requests to end a film early, after which the wall runs on as before.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use polyptych_client::Pacing;
use polyptych_client::blocking::Client;

use crate::cli::shutdown_signal::watch_shutdown_signals;
use crate::logging;

/// Exit code of a film that was interrupted twice: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// A request to end the film, which may come at any time.
#[derive(Clone, Debug, Default)]
pub(super) struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Watches for Ctrl-C and SIGTERM. The first ends the film after its frame; the second gives
    /// the wall its pace back and ends this process at once.
    ///
    /// # Errors
    /// The system lets this process handle no signals.
    pub fn watch(client: Client, pace: Option<Pacing>) -> std::io::Result<Self> {
        let asked = Self::default();
        let on_request = asked.clone();
        watch_shutdown_signals(false, move || {
            if !on_request.0.swap(true, Ordering::Relaxed) {
                logging::say_warning("interrupted: the film ends after this frame");
                return;
            }
            let resumed = pace.map_or(Ok(()), |pace| client.start_rendering(pace));
            match resumed {
                Ok(()) => logging::say_warning("interrupted again: the film ends at once"),
                Err(error) => logging::say_warning(&format!("the wall stays paused: {error}")),
            }
            std::process::exit(INTERRUPTED);
        })?;
        Ok(asked)
    }

    /// Returns whether the film is to end.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
