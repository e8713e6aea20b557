//! Pictures: pieces come before their description, and may be too many.

use polyptych_client::{ClientError, ConnectOptions, FrameId, Request, RequestId, Response};
use polyptych_protocol::request::{CaptureInfo, ImageInfo};

use crate::calls::answer;
use crate::manager::{options, pair, pair_with};

fn info(name: &str, is_screen: bool, width: u32, height: u32) -> ImageInfo {
    ImageInfo { name: name.into(), is_screen, width, height }
}

fn captured(pictures: Vec<ImageInfo>) -> Response {
    let missing = vec![("right".to_owned(), "no server drives it".to_owned())];
    Response::Captured(CaptureInfo { frame: FrameId(5), pictures, missing })
}

#[tokio::test]
async fn pictures_come_together_from_their_pieces() {
    let (client, mut manager) = pair().await;
    let script = async {
        let first = manager.expect(Request::Capture { time_s: None }).await;
        let second = manager.expect(Request::Capture { time_s: None }).await;
        manager.piece(first, 1, &[7; 5]).await;
        manager.piece(second, 0, &[9; 4]).await;
        manager.piece(RequestId(77), 0, &[1; 100]).await;
        manager.piece(first, 0, &[1; 16]).await;
        manager.piece(first, 1, &[8; 3]).await;
        manager.reply(second, captured(vec![info("s", true, 1, 1)])).await;
        let said = vec![info("s", true, 4, 1), info("left", false, 2, 1)];
        manager.reply(first, captured(said)).await;
    };
    let (first, second, ()) = tokio::join!(client.capture(), client.capture(), script);
    let first = first.expect("captured");
    assert_eq!(first.frame, FrameId(5));
    assert_eq!((first.screens[0].name.as_str(), first.screens[0].width), ("s", 4));
    assert_eq!(first.channels[0].rgba, [7, 7, 7, 7, 7, 8, 8, 8]);
    assert_eq!(first.missing[0].0, "right");
    assert_eq!(second.expect("captured").screens[0].rgba, [9; 4]);
}

#[tokio::test]
async fn a_capture_beyond_the_limit_ends_alone() {
    let small = ConnectOptions { capture_bytes_max: 1000, ..options("pipe") };
    let (client, mut manager) = pair_with(1 << 16, small).await;
    let script = async {
        let id = manager.expect(Request::Capture { time_s: None }).await;
        for _ in 0..3 {
            manager.piece(id, 0, &[0; 400]).await;
        }
        manager.reply(id, captured(vec![info("s", true, 10, 30)])).await;
        manager
    };
    let (capture, manager) = tokio::join!(client.capture(), script);
    let error = capture.expect_err("too large");
    assert!(matches!(error, ClientError::CaptureTooLarge { limit: 1000 }), "{error}");
    assert_eq!(client.pending_requests(), 0);
    let (status, ()) = tokio::join!(async move { client.status().await }, manager.serve(answer));
    status.expect("the connection holds");
}

#[tokio::test]
async fn pictures_that_do_not_fit_their_description_are_refused() {
    let (client, mut manager) = pair().await;
    let script = async {
        let id = manager.expect(Request::Capture { time_s: None }).await;
        manager.piece(id, 0, &[0; 400]).await;
        manager.reply(id, captured(vec![info("front", true, 10, 11)])).await;
    };
    let (capture, ()) = tokio::join!(client.capture(), script);
    let error = capture.expect_err("refused").to_string();
    assert!(error.contains("front came with 400 bytes; 10 x 11 pixels have 440"), "{error}");
}

#[tokio::test]
async fn a_raw_capture_keeps_no_pictures() {
    let (client, mut manager) = pair().await;
    let script = async {
        let id = manager.expect(Request::Capture { time_s: None }).await;
        manager.piece(id, 0, &[0; 4]).await;
        manager.reply(id, captured(vec![info("s", true, 1, 1)])).await;
    };
    let (reply, ()) = tokio::join!(client.request(Request::Capture { time_s: None }), script);
    assert!(matches!(reply, Ok(Response::Captured(_))));
}
