//! A manager that is killed, and clients that are.

use std::time::Instant;

use futures_util::SinkExt;
use polyptych_client::blocking::{Client, FeedbackStream};
use polyptych_client::{ChannelState, FrameFeedback, Pacing, Request};
use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret};
use polyptych_protocol::handshake_io::send_hello;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::RequestMessage;
use polyptych_protocol::token;

use super::{RATE, brisk, hold, in_time};
use crate::harness::local_wall::LocalWall;
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

/// Returns whether all channels are live and have drawn this frame.
fn is_whole(feedback: &FrameFeedback) -> bool {
    let mut channels = feedback.channels.iter();
    channels.all(|c| c.state == ChannelState::Live && c.draw_us.is_some())
}

/// A wall that moves by itself, and its feedback.
fn moving_wall() -> (LocalWall, Client, FeedbackStream) {
    let folder = town().parent().expect("a folder");
    let local = LocalWall::start(&brisk(2, 1), &[folder]);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    client.set_camera(poses(&bounds)[1]).expect("set");
    client.start_rendering(Pacing::Rate(RATE)).expect("runs");
    let mut feedbacks = client.feedback().expect("a stream");
    assert!(feedbacks.any(|feedback| is_whole(&feedback)), "the stream goes on");
    (local, client, feedbacks)
}

#[test]
fn a_wall_moves_again_soon_after_its_manager_was_killed() {
    let folder = town().parent().expect("a folder");
    let wall = brisk(2, 1);
    let (local, client, _) = moving_wall();
    let mut running = Some(local);
    let known = client.status().expect("status");
    in_time(|| {
        let mut local = running.take().expect("a wall");
        local.manager.kill();
        for (name, server) in &mut local.servers {
            server.await_line(&["not connected; trying again for ever"]);
            assert!(!server.has_ended(), "{name} keeps its last frame");
        }
        let LocalWall { place, address, servers, .. } = local;
        let restarted = Instant::now();
        let mut local = LocalWall::manager(place, &wall, &[folder], &address);
        local.servers = servers;
        let client = local.client();
        running = Some(local);
        let mut feedbacks = client.feedback().expect("a stream");
        let whole = feedbacks.find(is_whole).expect("the stream goes on");
        let moving_ms = restarted.elapsed().as_secs_f64() * 1000.0;
        let now = client.status().expect("status");
        assert_eq!((now.revision, now.digest), (known.revision, known.digest), "as acknowledged");
        assert_eq!(now.scene.as_deref(), Some("town"));
        assert!(whole.frame.0 > 0 && now.epoch != known.epoch, "another life");
        hold(moving_ms <= 3000.0, "milliseconds from restart to a moving wall", &moving_ms)
    });
}

#[test]
fn a_wall_goes_on_when_the_client_that_moves_it_is_killed() {
    let (local, client, mut feedbacks) = moving_wall();
    client.pause().expect("stands still");
    let token = token::read(&local.place.token_file()).expect("a token");
    let hello = Hello::Client(ClientHello { name: "doomed".into() });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let doomed = runtime.expect("a runtime").block_on(async {
        let stream = tokio::net::TcpStream::connect(&local.address).await.expect("connected");
        let (mut frames, _) =
            send_hello(stream, Role::Client, &hello, &Secret(token)).await.expect("let in");
        let request = Request::Run(Pacing::Rate(RATE));
        let call = RequestMessage::new(RequestId(1), request);
        frames.send(polyptych_codec::encode(&call)).await.expect("asked");
        frames.into_inner().into_std().expect("a socket")
    });
    assert!(feedbacks.next().is_some(), "it moves");
    assert_eq!(client.status().expect("status").clients.len(), 2);
    // What the system does to the sockets of a process that is killed.
    drop(doomed);
    wait::until("the client is gone", || {
        let clients = client.status().expect("status").clients;
        (clients == ["test"]).then_some(())
    });
    let from = feedbacks.next().expect("a frame").frame.0;
    let is_later = |feedback: &FrameFeedback| feedback.frame.0 >= from + 30;
    let later = feedbacks.find(|f| is_later(f) && is_whole(f)).expect("it goes on");
    assert!(later.time_s > 0.0, "{later:?}");
    // The other takes over.
    client.start_rendering(Pacing::Rate(RATE / 2.0)).expect("another pace");
    client.pause().expect("stands still");
    let [first, second] = [0, 1].map(|_| client.render_frame().expect("drawn").frame);
    assert_eq!(second.0, first.0 + 1, "nobody else draws any more");
}
