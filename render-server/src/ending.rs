//! The end of a server that was asked for from inside, and its reason, which the manager is told.

use std::sync::OnceLock;

use tokio_util::sync::CancellationToken;

/// Ends the network's thread, for the first reason that is given.
#[derive(Debug, Default)]
pub(crate) struct Ending {
    token: CancellationToken,
    reason: OnceLock<String>,
}

impl Ending {
    /// Ends it. Later reasons are those of its clean-up.
    pub fn end(&self, reason: &str) {
        // A reason that is there already is the right one.
        let _ = self.reason.set(reason.to_owned());
        self.token.cancel();
    }

    /// Waits until it is to end.
    pub async fn ended(&self) {
        self.token.cancelled().await;
    }

    /// The reason, once it is to end.
    pub fn reason(&self) -> Option<&str> {
        self.reason.get().map(String::as_str)
    }
}
