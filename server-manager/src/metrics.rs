//! Metrics over HTTP, for Prometheus and whoever reads its format.
//!
//! It has a thread of its own: a scrape costs the core's thread one [`Snapshot`], and the text
//! is written elsewhere. What is told is no secret of the wall, but names channels and servers;
//! there is no password, so the address is for this machine or a network that is trusted.

mod exposition;

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use hyper::body::Incoming;
use hyper::header::{ALLOW, CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use polyptych_core::Snapshot;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, mpsc, oneshot};
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::session::Event;

/// Connections at once: a few scrapers and a person. Others wait in the system's queue.
const SCRAPES_MAX: usize = 8;

/// Largest head of a request; Prometheus sends some 300 bytes. Hyper takes no smaller limit.
const REQUEST_BYTES_MAX: usize = 8 << 10;

/// Maximum time for a request's head to come.
const REQUEST_TIME_MAX: Duration = Duration::from_secs(5);

/// Maximum time for the core to answer: it does in microseconds, or is flooded.
const SNAPSHOT_TIME_MAX: Duration = Duration::from_secs(5);

/// Maximum duration of a connection, slow readers included: Prometheus waits no longer by default.
const CONNECTION_TIME_MAX: Duration = Duration::from_secs(10);

/// Between two tries where the system gives no connection.
const ACCEPT_WAIT: Duration = Duration::from_millis(100);

/// The state of the manager when it is asked.
#[derive(Debug)]
pub(crate) struct MetricsSnapshot {
    pub snapshot: Snapshot,
    pub queues: Vec<Queue>,
    /// Connection, direction and bytes so far.
    pub bytes: [(&'static str, &'static str, u64); 4],
}

/// The fill level of a queue.
#[derive(Debug)]
pub(crate) struct Queue {
    pub name: &'static str,
    pub length: usize,
    pub limit: usize,
}

/// Answers on a thread of its own until the guard is dropped.
///
/// # Errors
/// The system gave no thread or timer.
pub(crate) fn start(
    listener: std::net::TcpListener,
    events: mpsc::Sender<Event>,
) -> std::io::Result<DropGuard> {
    listener.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let stop = CancellationToken::new();
    let stopped = stop.clone();
    let work = move || {
        runtime.block_on(async {
            tokio::select! {
                () = accept(listener, events) => {}
                () = stopped.cancelled() => {}
            }
        });
    };
    std::thread::Builder::new().name("metrics".into()).spawn(work)?;
    Ok(stop.drop_guard())
}

async fn accept(listener: std::net::TcpListener, events: mpsc::Sender<Event>) {
    let listener = match TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => {
            tracing::error!(%error, "the wall goes on without metrics");
            return;
        }
    };
    let permits = Arc::new(Semaphore::new(SCRAPES_MAX));
    loop {
        // The permit comes first, so that a flood waits in the system's queue.
        let Ok(permit) = Arc::clone(&permits).acquire_owned().await else { return };
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(ACCEPT_WAIT).await;
            continue;
        };
        let events = events.clone();
        tokio::spawn(async move {
            let service = service_fn(|request| answer(request, &events));
            let connection = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(REQUEST_TIME_MAX)
                .max_buf_size(REQUEST_BYTES_MAX)
                .keep_alive(false)
                // A client may end its side behind the request, as `nc -N` does.
                .half_close(true)
                .serve_connection(TokioIo::new(stream), service);
            match tokio::time::timeout(CONNECTION_TIME_MAX, connection).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => tracing::debug!(%error, "a scrape failed"),
                Err(_) => tracing::debug!("a scrape took too long"),
            }
            drop(permit);
        });
    }
}

async fn answer(
    request: Request<Incoming>,
    events: &mpsc::Sender<Event>,
) -> Result<Response<String>, Infallible> {
    Ok(if request.uri().path() != "/metrics" {
        plain(StatusCode::NOT_FOUND, "there is only /metrics here\n")
    } else if !matches!(*request.method(), Method::GET | Method::HEAD) {
        let mut refusal = plain(StatusCode::METHOD_NOT_ALLOWED, "metrics are read with GET\n");
        refusal.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
        refusal
    } else {
        match tokio::time::timeout(SNAPSHOT_TIME_MAX, sample(events)).await {
            Ok(Some(sample)) => exposed(sample),
            Ok(None) => plain(StatusCode::SERVICE_UNAVAILABLE, "the manager ends\n"),
            Err(_) => plain(StatusCode::SERVICE_UNAVAILABLE, "the manager is busy\n"),
        }
    })
}

async fn sample(events: &mpsc::Sender<Event>) -> Option<MetricsSnapshot> {
    let (answer, sample) = oneshot::channel();
    events.send(Event::Watched { answer }).await.ok()?;
    sample.await.ok()
}

fn exposed(sample: MetricsSnapshot) -> Response<String> {
    match exposition::render(sample) {
        Ok(text) => with_type(StatusCode::OK, exposition::CONTENT_TYPE, text),
        Err(error) => plain(StatusCode::INTERNAL_SERVER_ERROR, &format!("{error}\n")),
    }
}

fn plain(status: StatusCode, text: &str) -> Response<String> {
    with_type(status, "text/plain; charset=utf-8", text.to_owned())
}

fn with_type(status: StatusCode, content_type: &'static str, text: String) -> Response<String> {
    let mut response = Response::new(text);
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    response
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{Shutdown, TcpStream};

    use super::*;

    #[test]
    fn a_client_that_sends_no_more_is_answered() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let mut client = TcpStream::connect(address).expect("connected");
        client.write_all(b"GET / HTTP/1.1\r\nHost: wall\r\n\r\n").expect("sent");
        client.shutdown(Shutdown::Write).expect("half closed");
        // It is met only now, so that the end is there with the request.
        let (events, _inbox) = mpsc::channel(1);
        let _running = start(listener, events).expect("a thread");
        let mut answer = String::new();
        client.read_to_string(&mut answer).expect("the connection ends in order");
        assert!(answer.starts_with("HTTP/1.1 404"), "{answer:?}");
    }
}
