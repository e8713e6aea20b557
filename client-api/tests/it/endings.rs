//! Connections that end: closed, torn, said goodbye to, full of garbage.

use std::time::Duration;

use bytes::Bytes;
use futures_util::SinkExt;
use polyptych_client::{ClientError, Request};
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::request::MessageToClient;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::manager::{options, pair, pair_with};

#[tokio::test]
async fn a_manager_that_closes_leaves_no_request_open() {
    let (client, mut manager) = pair().await;
    let script = async {
        manager.next().await.expect("a request");
        manager.next().await.expect("another");
        drop(manager);
    };
    let (frame, scene, ()) =
        tokio::join!(client.render_frame(), client.open_scene("a.glb"), script);
    let error = frame.expect_err("lost");
    assert!(matches!(error, ClientError::ConnectionLost { .. }), "{error}");
    assert_eq!(
        error.to_string(),
        "the connection to the manager at pipe was lost (the manager closed it); \
         whether it did \"render a frame\" is unknown"
    );
    assert!(matches!(scene, Err(ClientError::ConnectionLost { .. })));
    let error = client.status().await.expect_err("ended before");
    assert!(matches!(error, ClientError::Closed { .. }), "{error}");
    assert_eq!(client.close_reason().as_deref(), Some("the manager closed it"));
    assert!(matches!(client.feedback().await, Err(ClientError::Closed { .. })));
    assert_eq!(client.pending_requests(), 0);
}

#[tokio::test]
async fn a_goodbye_is_passed_on() {
    let (client, mut manager) = pair().await;
    let mut feedbacks = {
        let (feedbacks, ()) = tokio::join!(client.feedback(), async {
            let id = manager.expect(Request::Subscribe(true)).await;
            manager.reply(id, polyptych_client::Response::Done).await;
        });
        feedbacks.expect("subscribed")
    };
    let script = async {
        manager.next().await.expect("a request");
        manager.next().await.expect("a stop");
        manager.send(MessageToClient::Goodbye(Goodbye::closed("ctrl-c"))).await;
    };
    let (frame, stop, ()) = tokio::join!(client.render_frame(), client.stop(), script);
    let error = frame.expect_err("ended");
    assert!(matches!(error, ClientError::ManagerEnded { .. }), "{error}");
    assert!(error.to_string().contains("the manager at pipe ended (ctrl-c)"), "{error}");
    stop.expect("that is what was asked for");
    assert_eq!(feedbacks.next().await, None);
    assert_eq!(client.close_reason().as_deref(), Some("ctrl-c"));
}

#[tokio::test]
async fn garbage_ends_the_connection_with_its_name() {
    let (client, mut manager) = pair().await;
    let script = manager.frames.send(Bytes::from_static(&[0xff; 40]));
    let (error, sent) = tokio::join!(client.status(), script);
    sent.expect("sent");
    let error = error.expect_err("garbage").to_string();
    assert!(
        error.contains("a message made no sense: these 40 bytes are not a MessageToClient"),
        "{error}"
    );

    // A length beyond every limit is refused before anything is allocated for it.
    let (client, mut manager) = pair().await;
    let script = manager.frames.get_mut().write_all(&[0xff; 8]);
    let (error, sent) = tokio::join!(client.status(), script);
    sent.expect("sent");
    let error = error.expect_err("garbage").to_string();
    assert!(error.contains("frame size too big"), "{error}");

    // The end in the midst of a message.
    let (client, mut manager) = pair().await;
    manager.frames.get_mut().write_all(&[100, 0, 0, 0, 1]).await.expect("sent");
    drop(manager);
    let error = client.status().await.expect_err("torn").to_string();
    assert!(error.contains("bytes remaining on stream"), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_manager_that_takes_nothing_for_half_a_minute_is_lost_and_a_slow_one_is_not() {
    let patient = {
        let mut options = options("pipe");
        options.timeouts.other = Duration::from_mins(10);
        options
    };
    let (client, mut manager) = pair_with(64, patient).await;
    let begin = tokio::time::Instant::now();
    let open: Vec<_> = (0..100).map(|_| client.submit(Request::Status).expect("posted")).collect();
    for _ in 0..4 {
        tokio::time::advance(Duration::from_secs(20)).await;
        manager.frames.get_mut().read_exact(&mut [0; 64]).await.expect("read");
    }
    for pending in open {
        let error = pending.await.expect_err("stuck").to_string();
        assert!(error.contains("it has read nothing for 30 s"), "{error}");
    }
    assert_eq!(begin.elapsed().as_secs(), 80 + 31);
}

#[tokio::test]
async fn a_posted_request_arrives_though_everyone_is_gone() {
    let (client, mut manager) = pair().await;
    drop(client.submit(Request::CloseScene).expect("posted"));
    drop(client);
    manager.expect(Request::CloseScene).await;
    assert!(manager.next().await.is_none(), "the client closed");
}

#[test]
fn a_runtime_that_is_shut_down_leaves_nobody_waiting() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.expect("a runtime");
    let (mut pending, _manager) = runtime.block_on(async {
        let (client, manager) = pair().await;
        (client.submit(Request::Status).expect("posted"), manager)
    });
    drop(runtime);
    let error = pending.poll().expect("an answer").expect_err("lost").to_string();
    assert!(error.contains("the client's runtime was shut down"), "{error}");
}
