//! A program of another user that holds the manager's port while the manager is down: it answers
//! as a manager would, and keeps all that it hears.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use polyptych_protocol::handshake::{
    HelloReply, Introduction, Nonces, Preamble, Role, Secret, Welcome,
};
use polyptych_protocol::ids::{Epoch, Term};

use crate::harness::place::TestDir;

/// Maximum time for a peer's next bytes.
const SILENCE: Duration = Duration::from_secs(10);

/// The token of the wall's user.
const TOKEN: &str = "5ec4e7f00dfeedc0ffee5ec4e7f00dfe";

/// Lets `visitors` come in as a manager that does not know their token, and gives what it heard.
fn squat(listener: TcpListener, visitors: usize) -> JoinHandle<Vec<u8>> {
    let serve = move || {
        let mut heard = Vec::new();
        for _ in 0..visitors {
            let (stream, _) = listener.accept().expect("a visitor");
            pose(stream, &mut heard);
        }
        heard
    };
    Builder::new().name("squatter".into()).spawn(serve).expect("a thread")
}

/// Answers one visitor with all that a manager says, and a proof of another token.
fn pose(mut stream: TcpStream, heard: &mut Vec<u8>) {
    stream.set_read_timeout(Some(SILENCE)).expect("a limit");
    let mut preamble = [0; 8];
    stream.read_exact(&mut preamble).expect("a preamble");
    let nonce = [7; 32];
    let greeting = [&Preamble::current(Role::Manager).to_bytes()[..], &nonce].concat();
    stream.write_all(&greeting).expect("written");
    let mut length = [0; 4];
    stream.read_exact(&mut length).expect("a message");
    let mut message = vec![0; u32::from_le_bytes(length) as usize];
    stream.read_exact(&mut message).expect("the whole message");
    let introduction: Introduction =
        polyptych_protocol::framing::decode(&message).expect("an introduction");
    let nonces = Nonces { manager: nonce, peer: introduction.nonce };
    let proof = nonces.proof_of_manager(&Secret("0123456789abcdef".into()));
    let given = Welcome {
        epoch: Epoch(1),
        term: Term::default(),
        session: 1,
        wall: "w".into(),
        heartbeat_ms: 2000,
    };
    let answer =
        polyptych_codec::framed(&polyptych_codec::encode(&HelloReply::Welcome(given, proof)));
    stream.write_all(&answer).expect("written");
    heard.extend_from_slice(&preamble);
    heard.extend_from_slice(&message);
    // All that follows, should the visitor believe it.
    let rest = stream.read_to_end(heard);
    assert!(rest.is_ok() || rest.is_err_and(|e| e.kind() == ErrorKind::ConnectionReset));
}

#[test]
fn a_stranger_on_the_port_learns_nothing_and_is_not_believed() {
    let place = TestDir::new();
    place.write("state/token", TOKEN);
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let squatter = squat(listener, 2);

    let doubt = ["does not know this wall's token", "another token file"];
    place.run(["status", "--manager", &address]).failed(&doubt);
    let server = ["server", "--once", "--headless", "--channel", "front", "--manager", &address];
    place.run(server).failed(&doubt);

    let heard = squatter.join().expect("it only listened");
    let key = blake3::derive_key("polyptych 2026-11 proof of the token", TOKEN.as_bytes());
    for secret in [TOKEN.as_bytes(), &TOKEN.as_bytes()[..8], &key] {
        let has_it = heard.windows(secret.len()).any(|bytes| bytes == secret);
        assert!(!has_it, "a part of the token in {:?}", heard.escape_ascii().to_string());
    }
    // It stays no longer than it takes to see what answers: two introductions and nothing else.
    assert!(heard.len() < 1024, "{} bytes", heard.len());
}

#[test]
fn a_proof_that_was_overheard_is_good_for_nothing() {
    let hello = polyptych_protocol::handshake::ClientHello { name: "x".into() };
    let hello = polyptych_protocol::handshake::Hello::Client(hello);
    let secret = Secret(TOKEN.into());
    let heard = Nonces { manager: [1; 32], peer: [2; 32] };
    let proof = heard.proof_of_peer(&secret, &hello);
    for (nonces, is_same) in [
        (heard, true),
        (Nonces { manager: [3; 32], ..heard }, false),
        (Nonces { peer: [3; 32], ..heard }, false),
    ] {
        assert_eq!(proof.is(&nonces.proof_of_peer(&secret, &hello)), is_same);
    }
    // Nor does one end's pass for the other's.
    assert!(!proof.is(&heard.proof_of_manager(&secret)));
}
