//! Connections that come back: what was sent fails once, what was not waits, feedback goes on.

use std::time::Duration;

use polyptych_client::{
    Client, ClientError, ConnectOptions, Epoch, OpenProgress, OpenStage, Pacing, ReconnectPolicy,
    Request, RequestId, Response,
};
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::handshake::{Secret, Welcome};
use polyptych_protocol::handshake_io::{Introduced, accept, receive_hello, reject};
use polyptych_protocol::request::MessageToClient;
use tokio::net::{TcpListener, TcpStream};

use crate::calls::answer;
use crate::manager::{Manager, TOKEN, feedback, options};

async fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    (listener, address)
}

fn with(address: &str, reconnect: ReconnectPolicy) -> ConnectOptions {
    ConnectOptions { reconnect: Some(reconnect), ..options(address) }
}

/// A manager in another life, or of another wall.
async fn manager_on(listener: &TcpListener, epoch: u64, wall: &str) -> Manager<TcpStream> {
    let (stream, _) = listener.accept().await.expect("a peer");
    let introduced = receive_hello(stream, &Secret(TOKEN.into())).await;
    let Introduced { mut frames, proof, .. } = introduced.expect("introduced");
    let wall = wall.to_owned();
    let given = Welcome {
        epoch: Epoch(epoch),
        term: polyptych_protocol::ids::Term::default(),
        session: 1,
        wall,
        heartbeat_ms: 2000,
    };
    accept(&mut frames, given, proof).await.expect("welcomed");
    Manager { frames }
}

async fn connected(
    listener: &TcpListener,
    options: ConnectOptions,
) -> (Client, Manager<TcpStream>) {
    let (client, manager) =
        tokio::join!(Client::connect_with(options), manager_on(listener, 1, "lab"));
    (client.expect("connected"), manager)
}

#[tokio::test]
async fn what_was_sent_fails_once_and_is_not_repeated() {
    let (listener, address) = listen().await;
    let (client, mut manager) = connected(&listener, options(&address)).await;
    assert_eq!((client.is_connected(), client.epoch()), (true, Epoch(1)));
    let (frame, ()) = tokio::join!(client.render_frame(), async {
        manager.next().await.expect("it came");
        drop(manager);
    });
    let error = frame.expect_err("lost");
    assert!(matches!(error, ClientError::ConnectionLost { .. }), "{error}");
    assert!(error.is_outcome_unknown());
    // Whether it knows of the loss already or not: this waits for the next manager.
    let (status, manager) = tokio::join!(client.status(), async {
        let mut manager = manager_on(&listener, 2, "lab").await;
        // The first that comes is this one: no frame is drawn behind anyone's back.
        let id = manager.expect(Request::Status).await;
        manager.reply(id, answer(&Request::Status)).await;
        manager
    });
    status.expect("the new manager has answered");
    assert_eq!((client.is_connected(), client.epoch()), (true, Epoch(2)));
    assert_eq!((client.close_reason(), client.pending_requests()), (None, 0));
    drop(manager);
}

/// Serves a connection of this epoch until the scene's outcome is asked for.
async fn asked_for_outcome(listener: &TcpListener, epoch: u64) -> (Manager<TcpStream>, RequestId) {
    let mut manager = manager_on(listener, epoch, "lab").await;
    let (id, request) = manager.next().await.expect("a request");
    assert_eq!(request, Request::OpenOutcome { session: 1, of: id }, "asked, and not repeated");
    (manager, id)
}

#[tokio::test]
async fn a_scene_that_was_being_opened_is_asked_for_over_the_next_connection() {
    let (listener, address) = listen().await;
    let (client, mut manager) = connected(&listener, options(&address)).await;
    let mut heard = Vec::new();
    let (scene, manager) = tokio::join!(
        client.open_scene_with("a.glb", |progress| heard.push(progress.percent)),
        async {
            manager.expect(Request::OpenScene { path: "a.glb".into(), scene: None }).await;
            drop(manager);
            // Lost again, before there was an answer.
            drop(asked_for_outcome(&listener, 1).await);
            let (mut manager, id) = asked_for_outcome(&listener, 1).await;
            let progress = OpenProgress { stage: OpenStage::Baking, percent: 40 };
            manager.send(MessageToClient::Progress { id, progress }).await;
            manager
                .reply(id, answer(&Request::OpenScene { path: "a.glb".into(), scene: None }))
                .await;
            manager
        }
    );
    scene.expect("opened");
    assert_eq!((heard, client.pending_requests()), (vec![40], 0));
    drop(manager);
}

#[tokio::test]
async fn a_scene_of_another_epoch_is_lost_with_its_manager() {
    let (listener, address) = listen().await;
    let (client, mut manager) = connected(&listener, options(&address)).await;
    let (scene, manager) = tokio::join!(client.open_scene("a.glb"), async {
        manager.next().await.expect("it came");
        drop(manager);
        manager_on(&listener, 2, "lab").await
    });
    let error = scene.expect_err("lost");
    assert!(matches!(error, ClientError::ConnectionLost { .. }), "{error}");
    assert!(error.is_outcome_unknown());
    drop(manager);
}

#[tokio::test]
async fn requests_wait_in_order_and_dropped_ones_are_done_too() {
    let (listener, address) = listen().await;
    let (client, manager) = connected(&listener, options(&address)).await;
    drop(manager);
    // Once this has failed, the loss is known.
    let _ = client.pause().await;
    drop(client.submit(Request::SetExposure(2.0)).expect("posted"));
    let (run, ()) = tokio::join!(client.start_rendering(Pacing::Free), async {
        let mut manager = manager_on(&listener, 2, "lab").await;
        let mut seen = Vec::new();
        while seen.last() != Some(&Request::Run(Pacing::Free)) {
            let (id, request) = manager.next().await.expect("a request");
            manager.reply(id, Response::Done).await;
            seen.push(request);
        }
        // The pause was sent to the first manager, or it waited too: never both.
        let expected = [Request::SetExposure(2.0), Request::Run(Pacing::Free)];
        assert!(seen.ends_with(&expected), "{seen:?}");
    });
    run.expect("done");
}

#[tokio::test]
async fn a_request_fails_by_name_after_its_wait_and_is_never_sent() {
    let (listener, address) = listen().await;
    let wait = Duration::from_millis(300);
    let reconnect = ReconnectPolicy { wait, give_up_after: None };
    let (client, manager) = connected(&listener, with(&address, reconnect)).await;
    drop((manager, listener));
    let lost = async {
        while client.is_connected() {
            tokio::task::yield_now().await;
        }
    };
    lost.await;
    let error = client.close_scene().await.expect_err("nobody is there");
    assert!(matches!(error, ClientError::NotConnected { .. }) && !error.is_outcome_unknown());
    let text = error.to_string();
    assert!(
        text.starts_with(&format!(
            "cannot close the scene: no connection to the manager at {address}"
        )),
        "{text}"
    );
    assert!(text.contains("within 300ms") && text.contains("nothing was sent"), "{text}");
    assert!(client.close_reason().is_some_and(|reason| reason.contains("no manager at")));
    let listener = TcpListener::bind(&address).await.expect("the port is free");
    let (epoch, manager) = tokio::join!(client.connected(), manager_on(&listener, 5, "lab"));
    assert_eq!(epoch.expect("connected"), Epoch(5));
    let mut manager = manager;
    let (status, ()) = tokio::join!(client.status(), async {
        let id = manager.expect(Request::Status).await;
        manager.reply(id, answer(&Request::Status)).await;
    });
    status.expect("status");
}

#[tokio::test]
async fn feedback_goes_on_behind_a_gap() {
    let (listener, address) = listen().await;
    let (client, mut manager) = connected(&listener, options(&address)).await;
    let (feedbacks, ()) = tokio::join!(client.feedback(), async {
        let id = manager.expect(Request::Subscribe(true)).await;
        manager.reply(id, Response::Done).await;
    });
    let mut feedbacks = feedbacks.expect("subscribed");
    manager.send(MessageToClient::Feedback(feedback(70))).await;
    assert_eq!(feedbacks.next().await, Some(feedback(70)));
    assert_eq!((feedbacks.reconnects(), feedbacks.epoch()), (0, Epoch(1)));
    manager.send(MessageToClient::Goodbye(Goodbye::closed("an upgrade"))).await;
    drop(manager);
    let mut manager = manager_on(&listener, 2, "lab").await;
    let id = manager.expect(Request::Subscribe(true)).await;
    manager.reply(id, Response::Done).await;
    manager.send(MessageToClient::Feedback(feedback(1))).await;
    assert_eq!(feedbacks.next().await, Some(feedback(1)));
    assert_eq!((feedbacks.reconnects(), feedbacks.epoch(), feedbacks.dropped()), (1, Epoch(2), 0));
    drop(feedbacks);
    manager.expect(Request::Subscribe(false)).await;
    drop(client);
    assert!(manager.next().await.is_none(), "the client closed");
}

#[tokio::test]
async fn a_refusal_and_another_wall_are_not_what_was_meant() {
    let (listener, address) = listen().await;
    let (client, manager) = connected(&listener, options(&address)).await;
    drop(manager);
    let (stream, _) = listener.accept().await.expect("it comes again");
    let introduced = receive_hello(stream, &Secret(TOKEN.into())).await;
    let Introduced { mut frames, .. } = introduced.expect("introduced");
    reject(&mut frames, "another token".into()).await.expect("told");
    let mut other = manager_on(&listener, 2, "theatre").await;
    assert!(other.next().await.is_none(), "it does not stay");
    let (epoch, _manager) = tokio::join!(client.connected(), manager_on(&listener, 3, "lab"));
    assert_eq!(epoch.expect("connected"), Epoch(3));
    assert_eq!(client.wall_name(), "lab");
}

#[tokio::test]
async fn a_client_gives_up_where_it_is_told_to() {
    let (listener, address) = listen().await;
    let give_up_after = Some(Duration::from_millis(200));
    let reconnect = ReconnectPolicy { give_up_after, ..ReconnectPolicy::default() };
    let (client, manager) = connected(&listener, with(&address, reconnect)).await;
    drop((manager, listener));
    let error = client.connected().await;
    // It may not have noticed yet.
    let error = match error {
        Ok(_) => {
            let _ = client.status().await;
            client.connected().await.expect_err("it has ended")
        }
        Err(error) => error,
    };
    assert!(error.to_string().contains("no connection within 200ms: no manager at"), "{error}");
    assert!(matches!(client.status().await, Err(ClientError::Closed { .. })));
}

#[tokio::test]
async fn without_reconnection_the_client_ends_with_its_connection() {
    let (listener, address) = listen().await;
    let once = ConnectOptions { reconnect: None, ..options(&address) };
    let (client, manager) = connected(&listener, once).await;
    drop(manager);
    let _ = client.status().await;
    assert!(matches!(client.status().await, Err(ClientError::Closed { .. })));
    assert!(matches!(client.connected().await, Err(ClientError::Closed { .. })));
}
