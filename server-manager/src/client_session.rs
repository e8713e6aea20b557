//! A client's connection.

use futures_util::StreamExt;
use polyptych_protocol::codec;
use polyptych_protocol::connection::{self, Frames};
use polyptych_protocol::handshake::Proof;
use polyptych_protocol::request::Call;
use polyptych_protocol::stream::Stream;
use tokio::sync::{mpsc, oneshot};

use crate::cluster::SessionId;
use crate::session::{Event, Link, write_all};

/// Serves one connection until it ends.
pub(crate) async fn serve(
    (mut frames, proof): (Frames<Stream>, Proof),
    name: String,
    events: mpsc::Sender<Event>,
) {
    let (link, waiting) = Link::new();
    let close = link.close.clone();
    let (verdict, answer) = oneshot::channel();
    if events.send(Event::ClientJoins { name, link, verdict }).await.is_err() {
        return;
    }
    let welcome = match answer.await {
        Ok(Ok(welcome)) => welcome,
        Ok(Err(reason)) => {
            let _ = connection::refuse(&mut frames, reason).await;
            return;
        }
        Err(_) => return,
    };
    let session = SessionId(welcome.session);
    let reason = if connection::welcome(&mut frames, welcome, proof).await.is_ok() {
        let (sink, mut stream) = frames.split();
        let reader = async {
            loop {
                let bytes = match stream.next().await {
                    None => return "it closed the connection".to_owned(),
                    Some(Err(error)) => return format!("the connection failed: {error}"),
                    Some(Ok(bytes)) => bytes,
                };
                let Call { id, request } = match codec::decode(&bytes) {
                    Ok(call) => call,
                    Err(error) => return format!("it sent something malformed: {error}"),
                };
                // Waiting here when the brain is busy is the back-pressure on a flooding client.
                if events.send(Event::ClientAsks { from: session, id, request }).await.is_err() {
                    return "the manager ends".to_owned();
                }
            }
        };
        tokio::select! {
            reason = reader => reason,
            reason = write_all(sink, waiting, close) => reason,
        }
    } else {
        "the connection failed during the handshake".to_owned()
    };
    // The brain may be gone already; then nobody needs to know.
    let _ = events.send(Event::Gone { session, reason }).await;
}
