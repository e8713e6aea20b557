//! Attacks on a manager over HTTP: floods of bytes, readers that do not read, and invalid numbers.
//! The wall goes on, and the manager stays small.

use std::io::{Read, Write};
use std::net::TcpStream;

use polyptych_client::{ChannelState, WallStatus};
use serde_json::{Value, json};

use super::page::{Answer, Page, connect, exchange, read_answer};
use crate::harness::local_wall::small;
use crate::harness::place::TestDir;
use crate::harness::wait;

/// Streams of events that one manager serves at once.
const BROWSERS: usize = 50;

/// Maximum growth of the manager's memory in a test, in bytes.
const GROWTH_MAX: u64 = 64 << 20;

fn manager() -> Page {
    Page::manager(TestDir::new(), &small(1, 1), &[], &[])
}

fn status(page: &Page) -> WallStatus {
    page.local.client().status().expect("a status")
}

#[test]
fn bodies_without_end_are_refused_and_not_kept() {
    let page = manager();
    let before = status(&page).memory_bytes;
    let head = page.head("POST", "/api/v1/requests");
    let json = "Content-Type: application/json\r\n";
    let huge = format!("{head}{json}Content-Length: 5000000000\r\n\r\n");
    exchange(&page.address, huge.as_bytes()).refused(413, "at most 4194304 bytes");
    // Who has not logged in may say less.
    let login = page.head("POST", "/api/v1/login/challenge");
    let large = format!("{login}{json}Content-Length: 5000\r\n\r\n");
    exchange(&page.address, large.as_bytes()).refused(413, "at most 4096 bytes");

    let mut chunked = connect(&page.address);
    let begin = format!("{head}{json}Transfer-Encoding: chunked\r\n\r\n");
    chunked.write_all(begin.as_bytes()).expect("sent");
    let piece = [b"10000\r\n".to_vec(), vec![b'['; 0x10000], b"\r\n".to_vec()].concat();
    let sent = (0..100_000).take_while(|_| chunked.write_all(&piece).is_ok()).count();
    assert!(sent < 1000, "{sent} pieces of 64 KiB were taken");
    let answer = read_answer(&mut chunked);
    // Its last words may be lost where it had more to send.
    assert!([0, 413].contains(&answer.code), "{answer}");

    // Within the limit, but nested without end, or of numbers that are none.
    let text = |body: &str| {
        let length = body.len();
        let text = format!("{head}{json}Content-Length: {length}\r\n\r\n{body}");
        exchange(&page.address, text.as_bytes())
    };
    text(&"[".repeat(1_000_000)).refused(400, "the body is not what is asked for");
    text("{\"SetExposure\": NaN}").refused(400, "expected value");
    text("{\"SetExposure\": 1e999}").refused(400, "number out of range");
    text("{\"SetExposure\": 1e39}").refused(400, "number out of range");
    text("{\"SetExposure\": \"bright\"}").refused(400, "invalid type: string");
    text("").refused(400, "the body");
    text("\u{0}").refused(400, "expected value");
    // Larger than any request of TCP, though not as JSON.
    let long_path = json!({ "OpenScene": { "path": "x".repeat(3_000_000) } }).to_string();
    text(&long_path).refused(413, "a request takes at most 2097152 bytes");
    let long_name = json!({ "StoreView": { "name": "x".repeat(70), "camera": null } }).to_string();
    text(&long_name).refused(422, "1 to 64 bytes");

    let after = status(&page);
    assert!(after.memory_bytes < before + GROWTH_MAX, "{before} and {}", after.memory_bytes);
    assert_eq!(after.channels[0].state, ChannelState::Lost);
}

#[test]
fn heads_paths_and_methods_of_all_kinds_are_refused() {
    let page = manager();
    let code = |text: &str| exchange(&page.address, text.as_bytes()).code;
    let head = |method: &str, path: &str| page.head(method, path) + "\r\n";
    for path in [
        "/api/v1/../../etc/passwd",
        "/../../etc/passwd",
        "/api/v1/./status",
        "/api/v1/%2e%2e/status",
        "/api/v1//status",
        "/api/v1/status/",
        "/console.js/",
        "/api/v2/status",
        "/etc/passwd",
    ] {
        assert_eq!(code(&head("GET", path)), 404, "{path}");
    }
    assert_eq!(code(&head("GET", "/api/v1/views/%ff")), 405);
    assert_eq!(code(&head("DELETE", "/api/v1/views/%ff")), 400);
    assert_eq!(code(&head("PATCH", "/api/v1/status")), 405);
    assert_eq!(code(&head("POST", "/")), 405);
    assert_eq!(code(&head("GET", "/api/v1/status?x=%zz")), 400);
    assert_eq!(code("rubbish\r\n\r\n"), 400);
    let long = format!("GET /{} HTTP/1.1\r\n\r\n", "x".repeat(100_000));
    assert_ne!(code(&long), 200);
    let many = "X-Many: y\r\n".repeat(500);
    let many = format!("{}{many}\r\n", page.head("GET", "/api/v1/status"));
    assert_eq!(code(&many), 431);
    let head_only = exchange(&page.address, head("HEAD", "/api/v1/status").as_bytes());
    assert_eq!((head_only.code, head_only.body.len()), (200, 0));
}

/// Opens a stream of events.
fn listen(page: &Page, query: &str) -> TcpStream {
    let mut stream = connect(&page.address);
    let head = page.head("GET", &format!("/api/v1/events{query}"));
    stream.write_all(format!("{head}\r\n").as_bytes()).expect("sent");
    stream
}

/// Reads until a part of it has come.
fn read_until(stream: &mut TcpStream, part: &str) -> String {
    let mut text = String::new();
    let mut bytes = [0; 4096];
    while !text.contains(part) {
        let count = stream.read(&mut bytes).expect("more");
        assert!(count > 0, "it ended before {part:?}: {text}");
        text += &String::from_utf8_lossy(&bytes[..count]);
    }
    text
}

#[test]
fn many_browsers_are_told_what_happens_and_cost_one_client() {
    let page = manager();
    let mut streams: Vec<TcpStream> = (0..BROWSERS).map(|_| listen(&page, "")).collect();
    for stream in &mut streams {
        let text = read_until(stream, "event: status\ndata: {");
        assert!(text.contains("content-type: text/event-stream"), "{text}");
    }
    let clients = status(&page).clients;
    assert_eq!(clients.iter().filter(|name| *name == "http live").count(), 1, "{clients:?}");
    page.ask("PUT", "/displays", Some(&json!({ "mode": "identify" }))).value();
    for stream in &mut streams {
        read_until(stream, "displays are in mode identify");
    }
    let mut eager = listen(&page, "?feedback=true");
    read_until(&mut eager, "event: status");
    wait::until("feedback", || {
        page.ask("POST", "/frame", Some(&json!({ "time_s": 4.5 }))).value();
        eager.set_read_timeout(Some(std::time::Duration::from_millis(200))).expect("a limit");
        let mut bytes = vec![0; 65536];
        let count = eager.read(&mut bytes).unwrap_or(0);
        String::from_utf8_lossy(&bytes[..count]).contains("event: feedback").then_some(())
    });
    drop((streams, eager));
    // Without browsers nobody asks any more.
    wait::until("silence", || {
        let clients = status(&page).clients;
        (!clients.iter().any(|name| name == "http live")).then_some(())
    });
}

#[test]
fn who_reads_nothing_is_let_go_and_holds_nothing() {
    let page = manager();
    let before = status(&page).memory_bytes;
    let deaf: Vec<TcpStream> = (0..BROWSERS)
        .map(|_| {
            let mut stream = connect(&page.address);
            let one = page.head("GET", "/api/v1/openapi.json").replace("close", "keep-alive");
            // Answers of 30 KiB each, of which none is read.
            let _ = stream.write_all(format!("{one}\r\n").repeat(300).as_bytes());
            stream
        })
        .collect();
    // Others are served meanwhile.
    for _ in 0..20 {
        assert_eq!(page.ask("GET", "/status", None).code, 200);
    }
    let mut memory = Vec::new();
    let is_gone = |stream: &TcpStream| {
        stream.set_nonblocking(true).expect("a mode");
        let error = (&*stream).write(b"GET ").err();
        error.is_some_and(|error| error.kind() != std::io::ErrorKind::WouldBlock)
    };
    wait::until("they are let go", || {
        memory.push(status(&page).memory_bytes);
        deaf.iter().all(is_gone).then_some(())
    });
    let most = memory.into_iter().max().unwrap_or_default();
    assert!(most < before + GROWTH_MAX, "{before} and {most}");
}

#[test]
fn connections_that_say_nothing_make_room_for_others() {
    let page = manager();
    let silent: Vec<TcpStream> = (0..600).map(|_| connect(&page.address)).collect();
    for _ in 0..10 {
        let answer: Answer = page.ask("GET", "/status", None);
        let value: Value = answer.value();
        assert_eq!(value["wall"], "small");
    }
    drop(silent);
    assert_eq!(page.ask("GET", "/status", None).code, 200);
}
