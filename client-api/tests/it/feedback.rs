//! The feedback stream: slow readers, several readers, the end of the subscription.

use polyptych_client::{Client, FEEDBACK_QUEUE_MAX, FeedbackStream, Request, Response};
use polyptych_protocol::request::MessageToClient;
use tokio::io::DuplexStream;

use crate::calls::answer;
use crate::manager::{Manager, feedback, pair};

async fn subscribe(client: &Client, manager: &mut Manager<DuplexStream>) -> FeedbackStream {
    let (feedbacks, ()) = tokio::join!(client.feedback(), async {
        let id = manager.expect(Request::Subscribe(true)).await;
        manager.reply(id, Response::Done).await;
    });
    feedbacks.expect("subscribed")
}

#[tokio::test]
async fn a_flood_drops_the_oldest_and_never_blocks_the_connection() {
    let (client, mut manager) = pair().await;
    let mut feedbacks = subscribe(&client, &mut manager).await;
    let sent = 10 * FEEDBACK_QUEUE_MAX as u64;
    for frame in 0..sent {
        manager.send(MessageToClient::Feedback(feedback(frame))).await;
    }
    // Nobody has read yet, and a call gets through.
    let id = {
        let (status, id) = tokio::join!(client.status(), async {
            let id = manager.expect(Request::Status).await;
            manager.reply(id, answer(&Request::Status)).await;
            id
        });
        status.expect("status");
        id
    };
    assert!(id.0 > 0);
    let kept = FEEDBACK_QUEUE_MAX as u64;
    for frame in sent - kept..sent {
        assert_eq!(feedbacks.next().await.expect("there"), feedback(frame));
    }
    assert_eq!(feedbacks.dropped(), sent - kept);
    drop(manager);
    assert_eq!(feedbacks.next().await, None);
}

#[tokio::test]
async fn each_reader_gets_all_and_the_last_ends_the_subscription() {
    let (client, mut manager) = pair().await;
    let mut first = subscribe(&client, &mut manager).await;
    let mut second = subscribe(&client.clone(), &mut manager).await;
    manager.send(MessageToClient::Feedback(feedback(1))).await;
    assert_eq!(first.next().await, Some(feedback(1)));
    assert_eq!(second.next().await, Some(feedback(1)));
    drop(first);
    // The subscription goes on: the next request is this one.
    let (status, ()) = tokio::join!(client.status(), async {
        let id = manager.expect(Request::Status).await;
        manager.reply(id, answer(&Request::Status)).await;
    });
    status.expect("status");
    manager.send(MessageToClient::Feedback(feedback(2))).await;
    assert_eq!(second.next().await, Some(feedback(2)));
    drop(second);
    manager.expect(Request::Subscribe(false)).await;
    assert_eq!(client.pending_requests(), 0);
    // A client without readers takes what still comes.
    manager.send(MessageToClient::Feedback(feedback(3))).await;
    let (status, ()) = tokio::join!(async move { client.status().await }, manager.serve(answer));
    status.expect("the connection holds");
}

#[tokio::test]
async fn a_subscription_that_fails_says_why() {
    let (client, mut manager) = pair().await;
    let (feedbacks, ()) = tokio::join!(client.feedback(), async {
        let id = manager.expect(Request::Subscribe(true)).await;
        manager.fail(id, "not now").await;
    });
    let error = feedbacks.expect_err("failed").to_string();
    assert_eq!(error, "cannot subscribe to feedback: not now");
    manager.expect(Request::Subscribe(false)).await;
}

#[tokio::test]
async fn feedback_keeps_the_connection_open() {
    let (client, mut manager) = pair().await;
    let mut feedbacks = subscribe(&client, &mut manager).await;
    drop(client);
    manager.send(MessageToClient::Feedback(feedback(1))).await;
    assert_eq!(feedbacks.next().await, Some(feedback(1)));
    drop(feedbacks);
    manager.expect(Request::Subscribe(false)).await;
    assert!(manager.next().await.is_none(), "the client closed");
}
