//! Addresses, tokens, refusals, strangers.

use std::os::unix::fs::PermissionsExt;

use polyptych_client::{Client, ClientError, ConnectOptions};
use polyptych_protocol::handshake::{Preamble, Role, Secret};
use polyptych_protocol::handshake_io::{Introduced, receive_hello, reject};
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::net::TcpListener;

use crate::calls::answer;
use crate::manager::{Manager, TOKEN, options};

/// Returns the error of a client whose peer follows `script`.
async fn refused_by<F: Future<Output = ()>>(script: impl FnOnce(DuplexStream) -> F) -> String {
    let (ours, theirs) = duplex(1 << 12);
    let connecting = Client::connect_over(ours, options("wall-3:7878"));
    let (client, ()) = tokio::join!(connecting, script(theirs));
    client.expect_err("no connection").to_string()
}

#[tokio::test]
async fn a_client_connects_over_tcp() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let serving = tokio::spawn(async move {
        Manager::accept(listener.accept().await.expect("a peer").0).await.serve(answer).await;
    });
    let client = Client::connect_with(options(&address)).await.expect("connected");
    assert_eq!(client.status().await.expect("status").wall, "lab");
    assert_eq!(client.clone().address(), address);
    drop(client);
    serving.await.expect("the manager saw the end");
}

#[tokio::test]
async fn a_token_is_read_from_its_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("token");
    let with_file =
        || ConnectOptions { token: None, token_file: Some(file.clone()), ..options("pipe") };
    let error = Client::connect_over(duplex(1).0, with_file()).await.expect_err("no token");
    assert!(matches!(error, ClientError::Token(_)), "{error}");
    assert!(error.to_string().contains("the manager makes it when it starts"), "{error}");
    std::fs::write(&file, format!("{TOKEN}\n")).expect("written");
    let owner_alone = std::fs::Permissions::from_mode(0o600);
    std::fs::set_permissions(&file, owner_alone).expect("changed");
    let (ours, theirs) = duplex(1 << 12);
    let (client, _manager) =
        tokio::join!(Client::connect_over(ours, with_file()), Manager::accept(theirs));
    client.expect("connected");
}

#[tokio::test]
async fn nobody_at_the_address_is_named_with_what_to_do() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    drop(listener);
    let error = Client::connect_with(options(&address)).await.expect_err("nobody").to_string();
    let expected = format!(
        "no manager at {address} (Connection refused (os error 111)); start one with: \
         polyptych manager WALL.toml"
    );
    assert_eq!(error, expected);
    let error = Client::connect_with(options("127.0.0.1:port")).await.expect_err("no port");
    assert!(matches!(error, ClientError::Unresolved { .. }), "{error}");
    assert!(error.to_string().contains("write HOST:PORT"), "{error}");
}

#[tokio::test]
async fn a_wrong_token_is_refused_in_the_managers_words() {
    let error = refused_by(|stream| async {
        let another = Secret("fedcba9876543210".into());
        let introduced = receive_hello(stream, &another).await;
        let Introduced { mut frames, is_proven, .. } = introduced.expect("introduced");
        assert!(!is_proven);
        reject(&mut frames, "the token is wrong; copy the manager's".into()).await.expect("told");
    });
    let error = error.await;
    assert_eq!(
        error,
        "the manager at wall-3:7878 refused this client: the token is wrong; copy the manager's"
    );
}

#[tokio::test]
async fn another_version_is_named() {
    let error = refused_by(|mut stream| async move {
        stream.write_all(b"PLYP\x63\x00\x00\x00").await.expect("written");
        let mut rest = Vec::new();
        drop(stream.shutdown().await);
        drop(stream.read_to_end(&mut rest).await);
    });
    let error = error.await;
    assert!(error.contains("at wall-3:7878: the peer speaks version 99"), "{error}");
}

#[tokio::test]
async fn other_programs_are_not_taken_for_a_manager() {
    let say = |bytes: &[u8]| {
        let bytes = bytes.to_vec();
        refused_by(move |mut stream| async move {
            stream.write_all(&bytes).await.expect("written");
            drop(stream.shutdown().await);
            drop(stream.read_to_end(&mut Vec::new()).await);
        })
    };
    let error = say(b"SSH-2.0-OpenSSH_9.6\r\n").await;
    assert!(error.contains("does not speak the Polyptych protocol"), "{error}");
    let error = say(&Preamble::current(Role::Server).to_bytes()).await;
    assert!(error.contains("a render server answered where a manager"), "{error}");
    let error = say(b"PL").await;
    assert!(error.contains("closed the connection during the handshake"), "{error}");
    let manager = [&Preamble::current(Role::Manager).to_bytes()[..], &[7; 32]].concat();
    let error = say(&[&manager[..], b"\x04\x00\x00\x00\xff\xff\xff\xff"].concat()).await;
    assert!(error.contains("are not a HelloReply"), "{error}");
    let error = say(&[&manager[..], b"\xff\xff\xff\x7f"].concat()).await;
    assert!(error.contains("frame size too big"), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_peer_that_says_nothing_is_left_after_five_seconds() {
    let (ours, _theirs) = duplex(1 << 12);
    let begin = tokio::time::Instant::now();
    let error = Client::connect_over(ours, options("wall-3:7878")).await.expect_err("silence");
    assert_eq!(begin.elapsed().as_secs(), 5);
    assert!(error.to_string().contains("wall-3:7878 did not introduce itself"), "{error}");
}
