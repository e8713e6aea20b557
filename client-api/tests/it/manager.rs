//! A manager that does what the test says, over a pipe in memory or over TCP.

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use polyptych_client::{
    Client, ConnectOptions, Epoch, FrameFeedback, FrameId, Request, RequestId, Response, Revision,
};
use polyptych_protocol::handshake::{Hello, Secret, Welcome};
use polyptych_protocol::handshake_io::{Introduced, MessageStream, accept, receive_hello};
use polyptych_protocol::request::{MessageToClient, ReplyChunk, RequestError, RequestMessage};
use tokio::io::{AsyncRead, AsyncWrite, DuplexStream};

pub const TOKEN: &str = "0123456789abcdef";

/// One connection, from the manager's side.
pub struct Manager<S> {
    pub frames: MessageStream<S>,
}

pub fn options(address: &str) -> ConnectOptions {
    let token = Some(TOKEN.to_owned());
    ConnectOptions { token, name: "test".into(), ..ConnectOptions::new(address) }
}

/// A client and its manager, over a pipe that holds `bytes` in each direction.
pub async fn pair_with(bytes: usize, options: ConnectOptions) -> (Client, Manager<DuplexStream>) {
    let (ours, theirs) = tokio::io::duplex(bytes);
    let (client, manager) =
        tokio::join!(Client::connect_over(ours, options), Manager::accept(theirs));
    (client.expect("connected"), manager)
}

pub async fn pair() -> (Client, Manager<DuplexStream>) {
    pair_with(1 << 16, options("pipe")).await
}

impl<S: AsyncRead + AsyncWrite + Unpin> Manager<S> {
    /// Lets a client in that has the right token.
    pub async fn accept(stream: S) -> Self {
        let introduced = receive_hello(stream, &Secret(TOKEN.into())).await;
        let Introduced { mut frames, hello, is_proven, proof } = introduced.expect("introduced");
        let Hello::Client(hello) = hello else { panic!("no client: {hello:?}") };
        assert_eq!((hello.name.as_str(), is_proven), ("test", true));
        let given = Welcome {
            epoch: Epoch(7),
            term: polyptych_protocol::ids::Term::default(),
            session: 1,
            wall: "lab".into(),
            heartbeat_ms: 2000,
        };
        accept(&mut frames, given, proof).await.expect("welcomed");
        Self { frames }
    }

    /// The next request; `None` once the client has closed.
    pub async fn next(&mut self) -> Option<(RequestId, Request)> {
        self.next_message().await.map(|message| (message.id, message.request))
    }

    /// The next request, with all that is sent beside it.
    pub async fn next_message(&mut self) -> Option<RequestMessage> {
        let bytes = self.frames.next().await?.expect("a message");
        Some(polyptych_protocol::framing::decode(&bytes).expect("a call"))
    }

    /// The next request, which must be this one.
    pub async fn expect(&mut self, expected: Request) -> RequestId {
        let (id, request) = self.next().await.expect("a request");
        assert_eq!(request, expected);
        id
    }

    pub async fn send(&mut self, answer: MessageToClient) {
        self.frames.send(polyptych_codec::encode(&answer)).await.expect("sent");
    }

    pub async fn reply(&mut self, id: RequestId, reply: Response) {
        self.send(MessageToClient::Reply { id, reply: Ok(reply) }).await;
    }

    pub async fn fail(&mut self, id: RequestId, reason: &str) {
        self.send(MessageToClient::Reply { id, reply: Err(RequestError::new(reason)) }).await;
    }

    pub async fn piece(&mut self, id: RequestId, index: u32, bytes: &[u8]) {
        let bytes = Bytes::copy_from_slice(bytes);
        self.send(MessageToClient::Chunk(ReplyChunk { id, index, bytes })).await;
    }

    /// Answers each request as `answer` says, until the client closes.
    pub async fn serve(mut self, answer: impl Fn(&Request) -> Response) {
        while let Some((id, request)) = self.next().await {
            self.reply(id, answer(&request)).await;
        }
    }
}

pub fn feedback(frame: u64) -> FrameFeedback {
    FrameFeedback {
        frame: FrameId(frame),
        time_s: 0.5,
        revision: Revision(3),
        frame_us: 900,
        barrier_us: 100,
        navigations: 0,
        detail: polyptych_client::DrawnDetail::default(),
        channels: Vec::new(),
    }
}
