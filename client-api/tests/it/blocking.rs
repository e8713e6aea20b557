//! The blocking client, outside and inside of a runtime.

use std::net::SocketAddr;
use std::sync::mpsc;
use std::thread;

use polyptych_client::blocking::Client;
use polyptych_client::glam::DVec3;
use polyptych_client::{Camera, ClientError, OutputMode, Pacing, Request, Response, fit_bounds};
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::request::MessageToClient;
use tokio::net::TcpListener;

use crate::calls::{answer, summary};
use crate::manager::{Manager, feedback, options};

/// A manager for one client, on a thread of its own; a frame's feedback comes with each frame.
fn manager() -> (SocketAddr, thread::JoinHandle<()>) {
    let (sender, address) = mpsc::sync_channel(1);
    let serving = async move {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        sender.send(listener.local_addr().expect("an address")).expect("the test listens");
        let stream = listener.accept().await.expect("a peer").0;
        // Two small messages in a row would wait for the peer's delayed acknowledgement.
        stream.set_nodelay(true).expect("set");
        let mut manager = Manager::accept(stream).await;
        while let Some((id, request)) = manager.next().await {
            if matches!(request, Request::RenderFrame { .. }) {
                manager.send(MessageToClient::Feedback(feedback(id.0))).await;
            }
            let stops = request == Request::Stop;
            manager.reply(id, answer(&request)).await;
            if stops {
                manager.send(MessageToClient::Goodbye(Goodbye::closed("asked to"))).await;
                return;
            }
        }
    };
    let work = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        runtime.expect("a runtime").block_on(serving);
    };
    let thread = thread::Builder::new().name("manager".into()).spawn(work).expect("a thread");
    (address.recv().expect("an address"), thread)
}

#[test]
fn every_call_waits_for_its_reply() {
    let (address, thread) = manager();
    let client = Client::connect_with(options(&address.to_string())).expect("connected");
    assert_eq!((client.wall_name(), client.address()), ("lab", address.to_string().as_str()));
    assert_eq!(client.open_scene("a.glb").expect("opened"), summary());
    let bounds = polyptych_client::Bounds { min: DVec3::ZERO, max: DVec3::ONE };
    let camera = fit_bounds(&client.wall().expect("wall"), &bounds, 0.0);
    client.set_camera(camera).expect("set");
    client.look_at(DVec3::X, DVec3::ZERO, DVec3::Y).expect("set");
    client.set_head(DVec3::Z).expect("set");
    client.set_exposure(2.0).expect("set");
    let mut feedbacks = client.feedback().expect("subscribed");
    assert_eq!(client.render_frame().expect("drawn"), feedback(9));
    let drawn = client.render_frame_at(Some(Camera::IDENTITY), Some(4.0)).expect("drawn");
    assert_eq!(drawn, feedback(4));
    assert!(feedbacks.next().is_some());
    client.start_rendering(Pacing::Free).expect("running");
    client.pause().expect("paused");
    client.set_output_mode(OutputMode::Freeze).expect("frozen");
    assert_eq!(client.status().expect("status").wall, "lab");
    assert_eq!(client.statistics(false).expect("statistics").frames, 3);
    let mut pending = client.submit(Request::CloseScene).expect("posted");
    assert_eq!(client.request(Request::CloseScene).expect("closed"), Response::Done);
    assert_eq!(pending.query().expect("came before").expect("closed"), Response::Done);
    assert_eq!(
        client.submit(Request::Pause).expect("posted").wait().expect("done"),
        Response::Done
    );
    assert!(matches!(client.capture(), Err(ClientError::WrongAnswer { .. })));
    client.close_scene().expect("closed");
    client.stop().expect("stopped");
    assert_eq!(feedbacks.by_ref().count(), 1, "the second frame's, then the end");
    assert_eq!(feedbacks.dropped(), 0);
    assert!(matches!(client.status(), Err(ClientError::Closed { .. })));
    assert_eq!(client.close_reason().as_deref(), Some("asked to"));
    assert_eq!(client.pending_requests(), 0);
    thread.join().expect("the manager ended well");
}

#[tokio::test]
async fn a_task_may_call_too_more_often_than_tokio_would_let_it() {
    let (address, thread) = manager();
    let client = Client::connect_with(options(&address.to_string())).expect("connected");
    let mut feedbacks = client.feedback().expect("subscribed");
    for _ in 0..400 {
        client.render_frame().expect("drawn");
        feedbacks.next().expect("there");
    }
    drop((client, feedbacks));
    thread.join().expect("the manager saw the end");
}

#[test]
fn connecting_fails_with_the_same_words() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    drop(listener);
    let error = Client::connect_with(options(&address)).expect_err("nobody").to_string();
    assert!(error.contains("start one with: polyptych manager"), "{error}");
}
