//! Coverage-guided: what a stranger says on a connection, from its first byte on, against both
//! ends of the handshake. The first byte is the end and how the rest is cut into packets.
#![no_main]

use std::cell::RefCell;

use libfuzzer_sys::fuzz_target;
use polyptych_protocol::connection::{Introduced, introduce, receive_introduction, refuse, welcome};
use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret, Welcome};
use polyptych_protocol::ids::{Epoch, Term};
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::runtime::{Builder, Runtime};

thread_local! {
    static RUNTIME: RefCell<Runtime> =
        RefCell::new(Builder::new_current_thread().build().expect("a runtime"));
}

/// Says the bytes in pieces, and listens to the end: nothing that is said may be lost.
async fn say(mut stream: DuplexStream, bytes: &[u8], piece: usize) -> Vec<u8> {
    for piece in bytes.chunks(piece) {
        // It may close before all is said.
        if stream.write_all(piece).await.is_err() {
            break;
        }
    }
    let _ = stream.shutdown().await;
    let mut heard = Vec::new();
    let _ = stream.read_to_end(&mut heard).await;
    heard
}

async fn manager(stream: DuplexStream) {
    let secret = Secret("s".into());
    let Ok(introduced) = receive_introduction(stream, &secret).await else { return };
    let Introduced { mut frames, hello, proof, .. } = introduced;
    if matches!(hello, Hello::Bulk(_)) {
        let _ = refuse(&mut frames, "no".to_owned()).await;
        return;
    }
    let given = Welcome {
        epoch: Epoch(7),
        term: Term::default(),
        session: 1,
        wall: "w".into(),
        heartbeat_ms: 2000,
    };
    let _ = welcome(&mut frames, given, proof).await;
}

async fn client(stream: DuplexStream) {
    let hello = Hello::Client(ClientHello { name: "a".into() });
    if let Err(error) = introduce(stream, Role::Client, &hello, &Secret("s".into())).await {
        // A stranger's bytes, or its reason; either way the log must bear it.
        assert!(error.to_string().len() < 16 << 10);
    }
}

fuzz_target!(|data: &[u8]| {
    let Some((&first, bytes)) = data.split_first() else { return };
    let (ours, theirs) = tokio::io::duplex(64 << 10);
    let piece = usize::from(first >> 1) + 1;
    RUNTIME.with_borrow(|runtime| {
        runtime.block_on(async {
            let heard = if first.is_multiple_of(2) {
                tokio::join!(say(ours, bytes, piece), manager(theirs)).0
            } else {
                tokio::join!(say(ours, bytes, piece), client(theirs)).0
            };
            assert!(heard.len() < 16 << 10, "{} bytes for a stranger", heard.len());
        });
    });
});
