//! Camera, head and pointer at rate, over a WebSocket.
//!
//! A message that comes while the one before is on its way waits; what comes behind it replaces it,
//! so that the wall is never behind the hand.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use hyper::body::Incoming;
use hyper::header::{CONNECTION, HeaderMap, HeaderName, HeaderValue, UPGRADE};
use hyper::upgrade::Upgraded;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::request::{Request as WallRequest, Response as WallResponse};
use polyptych_wall::Wall;
use polyptych_wall::camera::Camera;
use ring::digest::{SHA1_FOR_LEGACY_USE_ONLY, digest};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::Instant;

use super::pick::{self, PickBody};
use crate::http::answer::{self, Body, Refusal};
use crate::http::body;
use crate::http::client::HttpClient;
use crate::http::connection::Connection;
use crate::http::route::{Action, Route};
use crate::http::websocket::{self, Decoder, Fault, GOING_AWAY, Message};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[Route {
    method: "GET",
    path: "/live",
    summary: "A WebSocket for what moves: texts of JSON with a `camera`, a `head` or a `pointer` \
              (`screen` and `pixel`, as for a pick). Each is answered by `{\"frame\": N}`, with \
              what a pointer meets; `error` names each that is refused. Of those that come \
              meanwhile the last counts.",
    query: &[],
    body: None,
    action: Action::Live,
}];

/// Time without a byte of the peer after which it is asked whether it is there.
const PING_AFTER: Duration = Duration::from_secs(20);

/// Maximum time without a byte of the peer: three pings may get lost.
const SILENCE_MAX: Duration = Duration::from_secs(80);

/// Maximum time for the last moves of a peer that is gone.
const LAST_MOVES_MAX: Duration = Duration::from_secs(5);

/// Bytes that are read at a time.
const READ_BYTES: usize = 4096;

const KEY: HeaderName = HeaderName::from_static("sec-websocket-key");
const ACCEPT: HeaderName = HeaderName::from_static("sec-websocket-accept");
const VERSION: HeaderName = HeaderName::from_static("sec-websocket-version");

/// The moves of a text: camera, head and pointer, each if it is given.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Moves {
    camera: Option<Camera>,
    head: Option<HeadUpdate>,
    pointer: Option<PickBody>,
}

impl Moves {
    fn is_empty(&self) -> bool {
        self.camera.is_none() && self.head.is_none() && self.pointer.is_none()
    }

    /// Replaces each move that a newer text has.
    fn replace(&mut self, newer: Self) {
        self.camera = newer.camera.or(self.camera.take());
        self.head = match (self.head.take(), newer.head) {
            (Some(older), Some(newer)) => Some(newer.after(&older)),
            (older, newer) => newer.or(older),
        };
        self.pointer = newer.pointer.or(self.pointer.take());
    }
}

/// Turns a request into a WebSocket.
///
/// # Errors
/// The request is no handshake, another page sends it, or there is no place.
pub(in crate::http) async fn begin(
    connection: &Connection,
    mut request: Request<Incoming>,
) -> Result<Response<Body>, Refusal> {
    // A browser sends the cookie from any page, so its origin counts as for what changes the wall.
    connection.context.gate.check_origin(&Method::POST, request.headers())?;
    let accept = accepted(request.headers())?;
    let place = Arc::clone(&connection.context.admitted).try_acquire_owned();
    let place = place.map_err(|_| Refusal::unavailable("too many connections are open"))?;
    let client = connection.new_client(request.headers()).await?;
    let wall = Arc::clone(&connection.context.wall);
    let upgraded = hyper::upgrade::on(&mut request);
    tokio::spawn(async move {
        if let Ok(upgraded) = upgraded.await {
            Socket::new(upgraded, place, wall).serve(client).await;
        }
    });
    let mut answer = answer::with_type(StatusCode::SWITCHING_PROTOCOLS, "text/plain", Bytes::new());
    let headers = answer.headers_mut();
    headers.clear();
    headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
    headers.insert(CONNECTION, HeaderValue::from_static("Upgrade"));
    headers.insert(ACCEPT, accept);
    Ok(answer)
}

/// Returns the answer to the key of a handshake (RFC 6455, § 4.2.2).
fn accepted(headers: &HeaderMap) -> Result<HeaderValue, Refusal> {
    const GUID: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
    let text = |name: &HeaderName| headers.get(name).and_then(|of| of.to_str().ok());
    let has = |name: &HeaderName, word: &str| {
        let words = text(name).unwrap_or_default().split(',');
        words.map(str::trim).any(|of| of.eq_ignore_ascii_case(word))
    };
    let key = text(&KEY).filter(|key| key.len() == 24 && key.ends_with("=="));
    let is_handshake = has(&UPGRADE, "websocket") && has(&CONNECTION, "upgrade");
    let (Some(key), true, Some("13")) = (key, is_handshake, text(&VERSION)) else {
        let reason = "this is a WebSocket of version 13; send its handshake (RFC 6455)";
        return Err(Refusal::new(StatusCode::UPGRADE_REQUIRED, reason));
    };
    let hash = digest(&SHA1_FOR_LEGACY_USE_ONLY, format!("{key}{GUID}").as_bytes());
    HeaderValue::try_from(base64(hash.as_ref())).map_err(|_| Refusal::unavailable("no answer"))
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = three.iter().fold(0, |bits, byte| (bits << 8) | usize::from(*byte));
        let bits = bits << (8 * (3 - three.len()));
        for digit in 0..4 {
            let is_there = digit <= three.len();
            let code = char::from(DIGITS[(bits >> (18 - 6 * digit)) & 63]);
            text.push(if is_there { code } else { '=' });
        }
    }
    text
}

type Answering = Pin<Box<dyn Future<Output = (HttpClient, Value)> + Send>>;

/// A socket that is served by one task. It reads nothing while its peer does not read.
struct Socket {
    from: ReadHalf<TokioIo<Upgraded>>,
    to: WriteHalf<TokioIo<Upgraded>>,
    decoder: Decoder,
    waiting: Moves,
    wall: Arc<Wall>,
    #[expect(dead_code, reason = "counted until it is dropped")]
    place: OwnedSemaphorePermit,
}

/// The code and the reason of a close frame; `None` if the peer is gone.
type End = Option<(u16, &'static str)>;

impl Socket {
    fn new(upgraded: Upgraded, place: OwnedSemaphorePermit, wall: Arc<Wall>) -> Self {
        let (from, to) = tokio::io::split(TokioIo::new(upgraded));
        let (decoder, waiting) = (Decoder::default(), Moves::default());
        Self { from, to, decoder, waiting, wall, place }
    }

    async fn serve(mut self, client: HttpClient) {
        let (mut idle, mut answering) = (Some(client), None::<Answering>);
        let end = self.turn(&mut idle, &mut answering).await;
        // What was said last counts, though nobody waits for the answer.
        let finish = async {
            let client = match answering.take() {
                Some(answering) => Some(answering.await.0),
                None => idle.take(),
            };
            if let Some(client) = client.filter(|of| !of.is_over() && !self.waiting.is_empty()) {
                let moves = std::mem::take(&mut self.waiting);
                drop(answer_moves(client, Arc::clone(&self.wall), moves).await);
            }
        };
        // A wall that does not draw must not keep the place of who is gone.
        let _ = tokio::time::timeout(LAST_MOVES_MAX, finish).await;
        if let Some((code, reason)) = end {
            // A peer that is gone needs no goodbye.
            let _ = self.to.write_all(&websocket::close(code, reason)).await;
        }
        let _ = self.to.shutdown().await;
    }

    async fn turn(
        &mut self,
        idle: &mut Option<HttpClient>,
        answering: &mut Option<Answering>,
    ) -> End {
        let (mut heard, mut bytes) = (Instant::now(), vec![0; READ_BYTES]);
        let mut asked_at = heard;
        loop {
            if let Some(client) = idle.take_if(|_| !self.waiting.is_empty()) {
                let (moves, wall) = (std::mem::take(&mut self.waiting), Arc::clone(&self.wall));
                *answering = Some(Box::pin(answer_moves(client, wall, moves)));
            }
            let next_ping = heard.max(asked_at) + PING_AFTER;
            tokio::select! {
                (client, value) = wait(answering) => {
                    *answering = None;
                    let is_over = client.is_over();
                    *idle = Some(client);
                    self.say(&value).await.ok()?;
                    if is_over {
                        return Some((GOING_AWAY, "the manager ended this client"));
                    }
                }
                read = self.from.read(&mut bytes) => {
                    let count = read.ok().filter(|count| *count > 0)?;
                    heard = Instant::now();
                    self.decoder.feed(&bytes[..count]);
                    if let Err(end) = self.take().await {
                        return end;
                    }
                }
                () = tokio::time::sleep_until(next_ping) => {
                    if heard.elapsed() >= SILENCE_MAX {
                        return Some((GOING_AWAY, "nothing was heard for 80 s"));
                    }
                    asked_at = Instant::now();
                    self.to.write_all(&websocket::ping()).await.ok()?;
                }
            }
        }
    }

    /// Takes all messages that are there.
    async fn take(&mut self) -> Result<(), End> {
        loop {
            match self.decoder.next() {
                Ok(None) => return Ok(()),
                Ok(Some(Message::Pong)) => {}
                Ok(Some(Message::Ping(payload))) => {
                    self.to.write_all(&websocket::pong(&payload)).await.map_err(|_| None)?;
                }
                Ok(Some(Message::Close(code))) => return Err(Some((code.unwrap_or(1000), ""))),
                Ok(Some(Message::Text(text))) => match body::parse::<Moves>(text.as_bytes()) {
                    Ok(moves) if moves.is_empty() => {
                        let reason = "say a camera, a head or a pointer";
                        self.say(&json!({ "error": reason })).await.map_err(|_| None)?;
                    }
                    Ok(moves) => self.waiting.replace(moves),
                    Err(refusal) => {
                        self.say(&json!({ "error": refusal.reason })).await.map_err(|_| None)?;
                    }
                },
                Err(Fault { code, reason }) => return Err(Some((code, reason))),
            }
        }
    }

    async fn say(&mut self, value: &Value) -> std::io::Result<()> {
        self.to.write_all(&websocket::text(&value.to_string())).await
    }
}

/// Waits for an answer; indefinitely if none is on its way.
async fn wait(answering: &mut Option<Answering>) -> (HttpClient, Value) {
    match answering {
        Some(answering) => answering.as_mut().await,
        None => std::future::pending().await,
    }
}

/// Moves the wall and draws a frame for that. Returns the text of the answer.
///
/// Each move is tried by itself, since they may come from several texts: one that is refused is
/// named in `error`, and takes no other with it.
async fn answer_moves(
    mut client: HttpClient,
    wall: Arc<Wall>,
    moves: Moves,
) -> (HttpClient, Value) {
    let Moves { camera, head, pointer } = moves;
    let (mut value, mut errors) = (json!({}), Vec::new());
    let mut is_moved = false;
    if let Some(head) = head {
        match client.ask(WallRequest::SetHead(head)).await {
            Ok(_) => is_moved = true,
            Err(refusal) => errors.push(format!("head: {}", refusal.reason)),
        }
    }
    let fault = camera.as_ref().and_then(Camera::fault);
    let camera = camera.filter(|_| fault.is_none());
    errors.extend(fault.map(|fault| format!("camera: {fault}")));
    if is_moved || camera.is_some() {
        let frame = WallRequest::Redraw(camera);
        match client.ask(frame).await {
            Ok(answered) => {
                if let WallResponse::Frame(frame) = answered.response {
                    value["frame"] = json!(frame.frame);
                }
            }
            Err(refusal) => errors.push(refusal.reason),
        }
    }
    if let Some(pointer) = pointer {
        match pick::find(&mut client, &wall, &pointer).await {
            Ok(hit) => value["pointer"] = json!(hit),
            Err(refusal) => errors.push(format!("pointer: {}", refusal.reason)),
        }
    }
    if !errors.is_empty() {
        value["error"] = json!(errors.join("; "));
    }
    (client, value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_of_a_handshake_is_answered_as_the_rfc_has_it() {
        let mut headers = HeaderMap::new();
        let mut put = |name: HeaderName, value| {
            headers.insert(name, HeaderValue::from_static(value));
        };
        put(UPGRADE, "WebSocket");
        put(CONNECTION, "keep-alive, Upgrade");
        put(KEY, "dGhlIHNhbXBsZSBub25jZQ==");
        put(VERSION, "13");
        let accept = accepted(&headers).expect("a handshake");
        assert_eq!(accept, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
        for name in [UPGRADE, CONNECTION, KEY, VERSION] {
            let mut less = headers.clone();
            less.remove(name);
            let refusal = accepted(&less).expect_err("no handshake");
            assert_eq!(refusal.status, StatusCode::UPGRADE_REQUIRED);
        }
    }

    #[test]
    fn the_last_of_each_move_counts() {
        let parsed = |text: &str| body::parse::<Moves>(text.as_bytes()).expect("moves");
        let camera = |x: f64| format!(r#"{{"position":[{x},0,0],"rotation":[0,0,0,1],"scale":1}}"#);
        let mut waiting = Moves::default();
        assert!(waiting.is_empty());
        for text in [
            format!(r#"{{"camera":{}}}"#, camera(1.0)),
            r#"{"pointer":{"screen":"front","pixel":[3,4]}}"#.to_owned(),
            r#"{"head":{"position":[1,2,3],"rotation":[0,0,1,0]}}"#.to_owned(),
            r#"{"head":{"position":[4,5,6]}}"#.to_owned(),
            format!(r#"{{"camera":{}}}"#, camera(2.0)),
        ] {
            waiting.replace(parsed(&text));
        }
        assert_eq!(waiting.camera.map(|camera| camera.position.x), Some(2.0));
        let head = waiting.head.expect("a head");
        assert_eq!(head.position.x, 4.0);
        assert_eq!(head.rotation.map(|turn| turn.z), Some(1.0), "what is not given stays");
        assert!(waiting.pointer.is_some());
        assert!(body::parse::<Moves>(br#"{"speed":1}"#).is_err());
    }
}
