//! A render server's control connection.

use futures_util::StreamExt;
use polyptych_protocol::codec;
use polyptych_protocol::connection::{self, Frames};
use polyptych_protocol::handshake::ServerHello;
use polyptych_protocol::status::Status;
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot};

use crate::cluster::SessionId;
use crate::session::{Event, Link, write_all};

/// Serves one connection until it ends, and tells the brain why it did.
pub(crate) async fn serve(
    mut frames: Frames<TcpStream>,
    hello: ServerHello,
    address: String,
    events: mpsc::Sender<Event>,
) {
    let (link, outbox) = Link::new();
    let close = link.close.clone();
    let (verdict, answer) = oneshot::channel();
    let joins = Event::ServerJoins { hello, address: address.clone(), link, verdict };
    if events.send(joins).await.is_err() {
        return;
    }
    let session = match answer.await {
        Ok(Ok(welcome)) => {
            let session = SessionId(welcome.session);
            if connection::welcome(&mut frames, welcome).await.is_err() {
                let reason = "the connection failed during the handshake".to_owned();
                let _ = events.send(Event::Gone { session, reason }).await;
                return;
            }
            session
        }
        Ok(Err(reason)) => {
            tracing::warn!(address, reason, "a server is refused");
            let _ = connection::refuse(&mut frames, reason).await;
            return;
        }
        Err(_) => return,
    };
    let (sink, mut stream) = frames.split();
    let writer = write_all(sink, outbox, close);
    let reader = async {
        loop {
            let bytes = match stream.next().await {
                None => return "it closed the connection".to_owned(),
                Some(Err(error)) => return format!("the connection failed: {error}"),
                Some(Ok(bytes)) => bytes,
            };
            let status = match codec::decode::<Status>(&bytes) {
                Ok(status) => status,
                Err(error) => return format!("it sent something malformed: {error}"),
            };
            let says = Event::ServerSays { from: session, status, bytes: bytes.len() };
            if events.send(says).await.is_err() {
                return "the manager ends".to_owned();
            }
        }
    };
    let reason = tokio::select! {
        reason = reader => reason,
        () = writer => "the manager closed the connection".to_owned(),
    };
    // The brain may be gone already; then nobody needs to know.
    let _ = events.send(Event::Gone { session, reason }).await;
}
