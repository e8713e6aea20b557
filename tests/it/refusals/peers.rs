//! Peers that are none: they are shown the door, and the wall goes on.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;

use polyptych_client::ChannelState;
use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret};
use polyptych_protocol::handshake_io::send_hello;
use polyptych_protocol::token;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::harness::local_wall::{LocalWall, shot, small};
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

/// Says this to the manager; gives what it answers before it closes the connection.
#[track_caller]
fn answer_to(address: &str, said: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(wait::LIMIT)).expect("a limit");
    // It may close before all is said.
    let _ = stream.write_all(said);
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Ok(_) => answer,
        Err(error) if error.kind() == ErrorKind::ConnectionReset => answer,
        Err(error) => panic!("the connection is not closed: {error}"),
    }
}

/// Bytes without meaning, the same each time (the generator of Numerical Recipes).
fn noise(length: usize) -> Vec<u8> {
    let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    std::iter::successors(Some(1), next).map(|state| (state >> 24) as u8).take(length).collect()
}

#[test]
fn strangers_on_the_port_change_nothing() {
    let mut local = LocalWall::start(&small(2, 1), &[town().parent().expect("a folder")]);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let camera = poses(&bounds)[4];
    let before = shot(&client, camera);
    let client_preamble = b"PLYP\x02\x00\x01\x00";
    let frame_of = |length: u32| [&client_preamble[..], &length.to_be_bytes()].concat();
    let sayings: [(&str, Vec<u8>); 8] = [
        ("noise", noise(100_000)),
        ("zeros", vec![0; 5000]),
        ("http", b"GET / HTTP/1.1\r\nHost: wall\r\n\r\n".to_vec()),
        ("half a preamble", b"PLYP".to_vec()),
        ("no hello", client_preamble.to_vec()),
        ("a huge frame", frame_of(u32::MAX)),
        ("a frame beyond the handshake's", [frame_of(5000), vec![0; 5000]].concat()),
        ("a hello of noise", [frame_of(64), noise(64)].concat()),
    ];
    for (what, said) in &sayings {
        let answer = answer_to(&local.address, said);
        assert!(answer.len() < 1024, "{what}: {} bytes", answer.len());
    }
    local.manager.await_line(&["a peer did not introduce itself"]);
    let older = answer_to(&local.address, b"PLYP\x63\x00\x01\x00");
    assert!(String::from_utf8_lossy(&older).contains("you speak version 99"), "{older:?}");
    local.manager.await_line(&["a peer is refused", "version 99"]);

    let after = shot(&client, camera);
    assert!(after.channels == before.channels, "the picture has changed");
    let status = client.status().expect("a status");
    assert!(status.channels.iter().all(|c| c.state == ChannelState::Live && c.late == 0));
    assert_eq!(status.clients.len(), 1, "{:?}", status.clients);
}

#[test]
fn a_peer_that_was_let_in_is_still_held_to_the_limits() {
    let local = LocalWall::start(&small(1, 1), &[]);
    let client = local.client();
    let token = token::read(&local.place.token_file()).expect("a token");
    let hello = Hello::Client(ClientHello { name: "rogue".into() });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.expect("a runtime").block_on(async {
        let mut long = vec![0xff; 4];
        long.extend(noise(100_000));
        let mut malformed = 64u32.to_be_bytes().to_vec();
        malformed.extend(noise(64));
        for said in [long, malformed] {
            let stream = tokio::net::TcpStream::connect(&local.address).await.expect("connected");
            let introduced = send_hello(stream, Role::Client, &hello, &Secret(token.clone())).await;
            let mut stream = introduced.expect("let in").0.into_inner();
            // It may close before all is said.
            let _ = stream.write_all(&said).await;
            let mut answer = Vec::new();
            let read = tokio::time::timeout(wait::LIMIT, stream.read_to_end(&mut answer)).await;
            assert!(read.is_ok(), "the connection is not closed");
        }
    });
    client.render_frame().expect("the wall goes on");
    wait::until("the rogue is forgotten", || {
        let clients = client.status().expect("a status").clients;
        (clients.len() == 1).then_some(())
    });
}

#[test]
fn a_wrong_token_is_told_on_both_sides() {
    let mut local = LocalWall::start(&small(1, 1), &[]);
    let wrong = local.place.write("other-token", "0123456789abcdef0123456789abcdef");
    let wrong = wrong.display().to_string();
    let parts = ["the token is not this manager's", "token file"];
    local.run(&["status", "--token-file", &wrong]).failed(&parts);
    local.manager.await_line(&["a peer is refused", "the token is not"]);
    let server = ["server", "--once", "--headless", "--channel", "front", "--token-file", &wrong];
    local.run(&server).failed(&parts);
    let gone = local.place.path("no-token").display().to_string();
    local.run(&["status", "--token-file", &gone]).failed(&["no-token is not there"]);
    local.client().render_frame().expect("the wall goes on");
}
