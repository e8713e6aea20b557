//! The WebSocket for what moves: moves of a hand arrive, and peers that do wrong harm nobody.

use std::io::{Read, Write};
use std::net::TcpStream;

use polyptych_client::Camera;
use polyptych_client::glam::DVec3;
use serde_json::{Value, json};

use super::page::{Page, connect, exchange};
use crate::harness::local_wall::small;
use crate::harness::place::TestDir;

const HANDSHAKE: &str = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";

fn head(page: &Page) -> String {
    page.head("GET", "/api/v1/live").replace("Connection: close\r\n", HANDSHAKE)
}

fn open(page: &Page) -> TcpStream {
    let mut stream = connect(&page.address);
    stream.write_all(format!("{}\r\n", head(page)).as_bytes()).expect("sent");
    let mut answer = Vec::new();
    while !answer.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).expect("an answer");
        answer.push(byte[0]);
    }
    let answer = String::from_utf8(answer).expect("text").to_lowercase();
    assert!(answer.starts_with("http/1.1 101 "), "{answer}");
    assert!(answer.contains("sec-websocket-accept: s3pplmbitxaq9kygzzhzrbk+xoo="), "{answer}");
    stream
}

/// A frame as a client sends it.
fn frame(first: u8, payload: &[u8]) -> Vec<u8> {
    let mask = [1, 2, 3, 4];
    let length = (payload.len() as u16).to_be_bytes();
    let lengths =
        if payload.len() < 126 { vec![0x80 | length[1]] } else { vec![0xfe, length[0], length[1]] };
    let masked = payload.iter().enumerate().map(|(at, byte)| byte ^ mask[at % 4]);
    std::iter::once(first).chain(lengths).chain(mask).chain(masked).collect()
}

/// The next frame of the server: its first byte and its payload.
fn next(stream: &mut TcpStream) -> (u8, Vec<u8>) {
    let mut head = [0; 2];
    stream.read_exact(&mut head).expect("a frame");
    let mut length = usize::from(head[1]);
    if length == 126 {
        let mut more = [0; 2];
        stream.read_exact(&mut more).expect("a length");
        length = usize::from(u16::from_be_bytes(more));
    }
    let mut payload = vec![0; length];
    stream.read_exact(&mut payload).expect("a payload");
    (head[0], payload)
}

fn said(stream: &mut TcpStream) -> Value {
    let (first, payload) = next(stream);
    assert_eq!(first, 0x81, "{payload:?}");
    serde_json::from_slice(&payload).expect("JSON")
}

fn at(x: f64) -> Camera {
    Camera { position: DVec3::new(x, 0.0, 0.0), ..Camera::IDENTITY }
}

#[test]
fn the_last_camera_of_many_is_shown_and_the_wall_is_not_behind() {
    const COUNT: usize = 2000;
    let page = Page::manager(TestDir::new(), &small(1, 1), &[], &[]);
    let shown = || page.local.client().status().expect("a status").presentation;
    let mut stream = open(&page);
    let text = |value: Value| frame(0x81, value.to_string().as_bytes());
    stream.write_all(&text(json!({ "head": { "position": [0.1, 0.0, 0.0] } }))).expect("sent");
    assert!(said(&mut stream)["frame"].as_u64().is_some_and(|frame| frame > 0));
    assert_eq!(shown().head.position.x, 0.1);
    let mut reader = stream.try_clone().expect("a reader");
    let read = move || {
        let mut answers = 0;
        while said(&mut reader)["error"].is_null() {
            answers += 1;
        }
        answers
    };
    let answers = std::thread::Builder::new().name("reader".into()).spawn(read).expect("a thread");
    for step in 1..=COUNT {
        stream.write_all(&text(json!({ "camera": at(step as f64) }))).expect("sent");
    }
    // Refused, and so the last that is answered; it says what would be right.
    stream.write_all(&text(json!({ "camera": at(COUNT as f64), "speed": 1 }))).expect("sent");
    // It may overtake all others: nothing else is answered before its frame is drawn.
    let answers = answers.join().expect("answers");
    assert!(answers <= COUNT, "{answers} answers");
    let pointer = json!({ "pointer": { "screen": "front", "pixel": [1.5, 1.5] } });
    stream.write_all(&text(pointer)).expect("sent");
    // One frame was being drawn and one camera waited.
    for behind in 0.. {
        assert!(behind <= 2, "the wall is behind");
        let answer = said(&mut stream);
        if let Some(error) = answer["error"].as_str() {
            assert!(error.contains("no scene is open"), "{error}");
            break;
        }
    }
    assert_eq!(shown().camera, at(COUNT as f64));
    stream.write_all(&frame(0x89, b"there?")).expect("sent");
    assert_eq!(next(&mut stream), (0x8a, b"there?".to_vec()));
    stream.write_all(&frame(0x88, &1000_u16.to_be_bytes())).expect("sent");
    assert_eq!(next(&mut stream), (0x88, 1000_u16.to_be_bytes().to_vec()));
    assert_eq!(stream.read(&mut [0]).unwrap_or(0), 0, "it is closed");
}

#[test]
fn a_refused_move_is_named_and_takes_no_other_with_it() {
    let page = Page::manager(TestDir::new(), &small(1, 1), &[], &[]);
    let shown = || page.local.client().status().expect("a status").presentation;
    let mut stream = open(&page);
    let mut ask = |value: Value| {
        stream.write_all(&frame(0x81, value.to_string().as_bytes())).expect("sent");
        said(&mut stream)
    };
    let inside = json!({ "position": [0.0, 0.0, -1e6] });
    let answer = ask(json!({ "camera": at(3.0), "head": inside }));
    assert!(answer["frame"].as_u64().is_some_and(|frame| frame > 0), "{answer}");
    assert!(answer["error"].as_str().is_some_and(|of| of.starts_with("head: ")), "{answer}");
    assert_eq!(shown().camera, at(3.0));
    let flat = Camera { scale: 0.0, ..at(4.0) };
    let answer = ask(json!({ "camera": flat, "head": { "position": [0.1, 0.0, 0.0] } }));
    let due = "camera: camera scale 0 is not a number above 0";
    assert_eq!((answer["frame"].is_u64(), answer["error"].as_str()), (true, Some(due)));
    assert_eq!((shown().camera, shown().head.position.x), (at(3.0), 0.1));
}

#[test]
fn strangers_other_pages_and_wrong_frames_are_refused() {
    let page = Page::manager(TestDir::new(), &small(1, 1), &[], &[]);
    let ask = |head: &str| exchange(&page.address, format!("{head}\r\n").as_bytes());
    let good = head(&page).replace("Connection: Upgrade", "Connection: Upgrade, close");
    ask(&page.head("GET", "/api/v1/live")).refused(426, "WebSocket of version 13");
    ask(&good.replace("Bearer ", "Bearer x")).refused(401, "");
    ask(&format!("{good}Origin: http://elsewhere.example\r\n")).refused(403, "elsewhere");
    for (bytes, code) in [
        (b"\x81\x02{}".to_vec(), 1002_u16),
        (frame(0x82, b"{}"), 1003),
        (frame(0x81, b"\xff"), 1007),
        (vec![0x81, 0xff, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0], 1009),
    ] {
        let mut stream = open(&page);
        stream.write_all(&bytes).expect("sent");
        let (first, payload) = next(&mut stream);
        assert_eq!((first, &payload[..2]), (0x88, &code.to_be_bytes()[..]));
    }
    // Fifty that say nothing leave nothing behind once they are gone.
    let silent: Vec<_> = (0..50).map(|_| open(&page)).collect();
    let clients = || page.local.client().status().expect("a status").clients.len();
    assert!(clients() > 50);
    drop(silent);
    crate::harness::wait::until("they are gone", || (clients() < 10).then_some(()));
}
