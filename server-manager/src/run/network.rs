//! The thread of all connections: peers are heard while the core is busy.

use std::io;
use std::thread::{Builder, JoinHandle};

use polyptych_protocol::stream;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
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
        Self::serve(runtime, acceptor::accept(listener, met))
    }

    /// Runs `accept`, and what it spawns, on a thread of its own.
    fn serve(
        runtime: Runtime,
        accept: impl Future<Output = ()> + Send + 'static,
    ) -> io::Result<Self> {
        let (door, end) = (CancellationToken::new(), CancellationToken::new());
        let (closed, ended) = (door.clone(), end.clone());
        let serve = move || {
            runtime.block_on(async {
                tokio::select! {
                    () = accept => {}
                    () = closed.cancelled() => {}
                }
                ended.cancelled().await;
            });
            // A read of a blob from a disk that stands still is not waited for.
            runtime.shutdown_background();
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

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_disk_that_stands_still_does_not_hold_the_end_of_the_network() {
        let (thaw, thawed) = sync_channel::<()>(0);
        let (begin, begun) = sync_channel(1);
        let frozen = move || {
            begin.send(()).expect("the test listens");
            thawed.recv()
        };
        let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
        let accept = async move { drop(tokio::task::spawn_blocking(frozen).await) };
        let network = Network::serve(runtime, accept).expect("a thread");
        begun.recv().expect("it reads");
        let (end, ended) = sync_channel(1);
        let drops = move || {
            network.close_door();
            drop(network);
            end.send(()).expect("the test listens");
        };
        Builder::new().name("end".into()).spawn(drops).expect("a thread");
        ended.recv_timeout(Duration::from_mins(1)).expect("the disk is not waited for");
        drop(thaw);
    }
}
