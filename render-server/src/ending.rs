//! The end of a server that was asked for from inside, and its reason, which the manager is told.

use std::sync::{Arc, OnceLock};
use std::thread;

use tokio_util::sync::CancellationToken;

/// Ends the network's thread, for the first reason that is given.
#[derive(Debug, Default)]
pub(crate) struct Ending {
    token: CancellationToken,
    reason: OnceLock<String>,
    /// The thread that panicked, if one did.
    panicked: OnceLock<&'static str>,
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
    /// The name of the thread that panicked, if one did.
    pub fn panicked(&self) -> Option<&'static str> {
        self.panicked.get().copied()
    }
}

/// Ends a server whose thread panics while it has this: a server without it would stay and draw
/// nothing.
pub(crate) struct PanicGuard<T> {
    thread: &'static str,
    ending: Arc<Ending>,
    on_end: Arc<dyn Fn() + Send + Sync>,
    /// An end of a queue, which other threads see closed only after they can know of the panic.
    _queue: T,
}

impl<T> PanicGuard<T> {
    /// Guards the thread of this name. `on_end` wakes the main thread.
    pub fn new(
        thread: &'static str,
        ending: &Arc<Ending>,
        on_end: &Arc<dyn Fn() + Send + Sync>,
        queue: T,
    ) -> Self {
        let (ending, on_end) = (Arc::clone(ending), Arc::clone(on_end));
        Self { thread, ending, on_end, _queue: queue }
    }
}

impl<T> Drop for PanicGuard<T> {
    fn drop(&mut self) {
        if thread::panicking() {
            // The first one is the cause of others.
            let _ = self.ending.panicked.set(self.thread);
            self.ending.end(&format!("its {} thread panicked", self.thread));
            (self.on_end)();
        }
    }
}

#[cfg(test)]
mod tests {
    use crossbeam_channel::bounded;

    use super::*;

    #[test]
    fn a_panic_is_known_before_the_queue_of_its_thread_ends() {
        let (ending, (queue, waiting)) = (Arc::new(Ending::default()), bounded::<()>(1));
        let (woken, wakes) = bounded(1);
        let wake: Arc<dyn Fn() + Send + Sync> = Arc::new(move || {
            let _ = woken.try_send(());
        });
        let guard = PanicGuard::new("loader", &ending, &wake, queue.clone());
        let panics = move || {
            let _guard = guard;
            let _queue = queue;
            std::panic::panic_any("on purpose");
        };
        let panics = thread::Builder::new().name("panics".into()).spawn(panics).expect("a thread");
        assert!(waiting.recv().is_err(), "it ends");
        assert_eq!(ending.panicked(), Some("loader"));
        assert_eq!(ending.reason(), Some("its loader thread panicked"));
        assert!(wakes.recv().is_ok());
        assert!(panics.join().is_err());

        let (ending, (queue, waiting)) = (Arc::new(Ending::default()), bounded::<()>(1));
        drop(PanicGuard::new("loader", &ending, &wake, queue));
        assert!(waiting.recv().is_err() && ending.reason().is_none(), "no panic is no end");
    }
}
