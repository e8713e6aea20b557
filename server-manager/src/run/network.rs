//! The thread of all connections: peers are heard while the core is busy.

use std::io;
use std::thread::{Builder, JoinHandle};

use polyptych_protocol::stream;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::acceptor::{self, AcceptContext};

/// Serves connections until it is dropped.
#[derive(Debug)]
pub(super) struct Network {
    /// Ends the accepting of connections.
    door: CancellationToken,
    /// Ends all connections.
    end: CancellationToken,
    thread: Option<JoinHandle<()>>,
}

impl Network {
    /// Accepts connections on a thread of its own.
    ///
    /// # Errors
    /// The system gives no thread, or does not take the socket.
    pub fn start(listener: std::net::TcpListener, met: AcceptContext) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        stream::deepen_queue(&listener)?;
        let listener = {
            let _inside = runtime.enter();
            TcpListener::from_std(listener)?
        };
        let (door, end) = (CancellationToken::new(), CancellationToken::new());
        let (closed, ended) = (door.clone(), end.clone());
        let serve = move || {
            runtime.block_on(async {
                tokio::select! {
                    () = acceptor::accept(listener, met) => {}
                    () = closed.cancelled() => {}
                }
                ended.cancelled().await;
            });
        };
        let thread = Builder::new().name("network".into()).spawn(serve)?;
        Ok(Self { door, end, thread: Some(thread) })
    }

    /// Accepts no further connection; those that are there go on.
    pub fn close_door(&self) {
        self.door.cancel();
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        self.end.cancel();
        if let Some(thread) = self.thread.take() {
            // It does not panic; if it did, the log says so.
            let _ = thread.join();
        }
    }
}
