//! Files that come in pieces, and requests that wait their turn.

use std::io::{self, Write};
use std::time::Duration;

use polyptych_client::{ClientError, ConnectOptions, ExportedScene, Request, Response, Timeouts};
use polyptych_protocol::delivery::Delivery;
use polyptych_protocol::request::RequestMessage;

use crate::manager::{options, pair, pair_with};

fn exported(bytes: u64) -> Response {
    Response::Exported(ExportedScene { name: "town".into(), bytes, ..ExportedScene::default() })
}

const EXPORT: Request = Request::ExportScene { saved: None };

#[tokio::test]
async fn a_file_is_its_pieces_in_order_and_other_answers_come_between() {
    let (client, mut manager) = pair().await;
    let mut file = Vec::new();
    let work = async {
        let id = manager.expect(EXPORT).await;
        for piece in 0..10u8 {
            manager.piece(id, 0, &[piece; 3]).await;
        }
        let status = manager.expect(Request::CloseScene).await;
        manager.reply(status, Response::Done).await;
        manager.piece(id, 0, &[77]).await;
        manager.reply(id, exported(31)).await;
    };
    let (written, closed, ()) =
        tokio::join!(client.export_scene(None, &mut file), client.close_scene(), work);
    closed.expect("closed");
    assert_eq!(written.expect("written").name, "town");
    let expected: Vec<u8> = (0..10).flat_map(|piece| [piece; 3]).chain([77]).collect();
    assert_eq!(file, expected);
}

#[tokio::test]
async fn a_file_that_is_not_whole_or_cannot_be_written_is_an_error() {
    let (client, mut manager) = pair().await;
    let short = async {
        let id = manager.expect(EXPORT).await;
        manager.piece(id, 0, b"abc").await;
        manager.reply(id, exported(4)).await;
    };
    let mut file = Vec::new();
    let (written, ()) = tokio::join!(client.export_scene(None, &mut file), short);
    let error = written.expect_err("short");
    assert!(matches!(error, ClientError::IncompleteFile { bytes: 3, expected: 4 }), "{error}");

    struct Full;
    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let named = Request::ExportScene { saved: Some("evening".into()) };
    let full = async {
        let id = manager.expect(named).await;
        for _ in 0..100 {
            manager.piece(id, 0, &[0; 4096]).await;
        }
        // What nobody waits for holds nothing up.
        let status = manager.expect(Request::CloseScene).await;
        manager.reply(status, Response::Done).await;
    };
    let export = async {
        let error = client.export_scene(Some("evening"), &mut Full).await.expect_err("full");
        assert!(matches!(error, ClientError::Write(_)), "{error}");
        client.close_scene().await.expect("closed");
    };
    tokio::join!(full, export);
    assert_eq!(client.pending_requests(), 0);
}

#[tokio::test(start_paused = true)]
async fn each_piece_renews_the_time_and_queued_requests_have_no_end_of_theirs() {
    let second = Duration::from_secs(1);
    let timeouts = Timeouts { open_scene: second, capture: second, other: second };
    let options = ConnectOptions { timeouts, ..options("pipe") };
    let (client, mut manager) = pair_with(1 << 16, options).await;
    let mut queued = client.submit_queued(Request::Pause, 7).expect("posted");
    let message: RequestMessage = manager.next_message().await.expect("a request");
    assert_eq!(message.delivery, Delivery::Queued { priority: 7 });
    let work = async {
        let id = manager.expect(EXPORT).await;
        for _ in 0..5 {
            tokio::time::advance(second * 9 / 10).await;
            manager.piece(id, 0, b"abc").await;
        }
        manager.reply(id, exported(15)).await;
        // One that says nothing any more.
        manager.expect(EXPORT).await;
        tokio::time::advance(second * 2).await;
    };
    let mut file = Vec::new();
    let export = async {
        client.export_scene(None, &mut file).await.expect("written");
        let error = client.export_scene(None, &mut Vec::new()).await.expect_err("silent");
        assert!(matches!(error, ClientError::TimedOut { .. }), "{error}");
    };
    tokio::join!(work, export);
    assert!(queued.poll().is_none(), "it waits still");
    manager.reply(message.id, Response::Done).await;
    assert_eq!(queued.await.expect("answered"), Response::Done);
}
