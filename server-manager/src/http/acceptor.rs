//! Accepts connections, bounds them, and serves HTTP/1.1 on them.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use polyptych_protocol::stall_limit::StallLimit;
use tokio::net::{TcpListener, TcpStream};

use super::HttpContext;
use super::connection::Connection;
use crate::strangers::Strangers;

/// Maximum size of a request's head. Hyper takes no smaller limit.
const HEAD_BYTES_MAX: usize = 8 << 10;

/// Maximum number of lines of a request's head; browsers send some 20.
const HEADERS_MAX: usize = 64;

/// Maximum time until a request's head has come, and between two requests of a connection.
const HEAD_TIME_MAX: Duration = Duration::from_secs(30);

/// Maximum time in which a peer takes none of the bytes that wait for it, as on TCP.
const STALL_TIME_MAX: Duration = Duration::from_secs(10);

/// Between two tries where the system gives no connection.
const ACCEPT_WAIT: Duration = Duration::from_millis(100);

/// Accepts connections until it is dropped. Those that have not shown who they are make room for
/// each other, as on TCP.
pub(super) async fn accept(listener: std::net::TcpListener, context: Arc<HttpContext>) {
    let listener = match TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => {
            tracing::error!(%error, "the wall goes on without HTTP");
            return;
        }
    };
    let strangers = Strangers::default();
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                let guest = strangers.admit(address.ip());
                let end = guest.end.clone();
                let context = Arc::clone(&context);
                tokio::spawn(async move {
                    tokio::select! {
                        () = serve(stream, address, guest, context) => {}
                        () = end.cancelled() => {}
                    }
                });
            }
            // Out of file descriptors, most likely.
            Err(error) => {
                strangers.make_room();
                tracing::debug!(%error, "cannot accept an HTTP connection");
                tokio::time::sleep(ACCEPT_WAIT).await;
            }
        }
    }
}

async fn serve(
    stream: TcpStream,
    address: SocketAddr,
    guest: crate::strangers::Guest,
    context: Arc<HttpContext>,
) {
    let accepted = polyptych_tls::accept(stream, context.gate.keys.as_ref());
    let (stream, identity) = match tokio::time::timeout(HANDSHAKE_TIME_MAX, accepted).await {
        Ok(Ok(accepted)) => accepted,
        Ok(Err(reason)) => {
            if let Some(times) = context.rejections.record(address, &reason) {
                tracing::warn!(peer = %address, reason, times, "an HTTP peer is refused");
            }
            return;
        }
        Err(_) => return,
    };
    let connection = Arc::new(Connection::new(context, address, identity, guest));
    let service = service_fn(|request| {
        let connection = Arc::clone(&connection);
        async move { Ok::<_, std::convert::Infallible>(connection.answer(request).await) }
    });
    let stream = StallLimit::new(stream, STALL_TIME_MAX);
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME_MAX)
        .max_buf_size(HEAD_BYTES_MAX)
        .max_headers(HEADERS_MAX)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades()
        .await;
    if let Err(error) = served {
        tracing::debug!(peer = %address, %error, "an HTTP connection failed");
    }
}
