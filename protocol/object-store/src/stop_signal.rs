//! The end of an upload before its last blob: because somebody asks for it, or because a blob
//! cannot be sent.

use std::pin::pin;

use tokio::sync::watch;

/// Tells all that is on its way to end.
#[derive(Debug)]
pub(crate) struct StopSender(watch::Sender<bool>);

/// The receiving side of a [`StopSender`], one for each blob.
#[derive(Debug)]
pub(crate) struct StopSignal(watch::Receiver<bool>);

impl StopSender {
    pub fn new() -> Self {
        Self(watch::Sender::new(false))
    }

    pub fn signal(&self) -> StopSignal {
        StopSignal(self.0.subscribe())
    }

    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl StopSignal {
    /// Returns what `work` comes to, or `None` if all is to end before.
    pub async fn unless_stopped<T>(&mut self, work: impl Future<Output = T>) -> Option<T> {
        let stopped = async {
            // The sender is there as long as anything is sent.
            let _ = self.0.wait_for(|is_stopped| *is_stopped).await;
        };
        tokio::select! {
            biased;
            () = stopped => None,
            done = work => Some(done),
        }
    }
}

/// Returns what `work` comes to. Tells it to end once `asked` is ready, and waits until it has.
pub(crate) async fn stopped_by<T>(
    stop: &StopSender,
    asked: impl Future<Output = ()>,
    work: impl Future<Output = T>,
) -> T {
    let mut work = pin!(work);
    tokio::select! {
        done = &mut work => return done,
        () = asked => stop.stop(),
    }
    work.await
}
