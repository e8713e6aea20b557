//! Peers of a manager with keys that have the wrong ones, or none: each is told why, the log says
//! so in a line, and the wall goes on.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use polyptych_protocol::handshake::{
    Adapter, BulkHello, ClientHello, Hello, Preamble, Role, Secret, ServerHello, Welcome,
};
use polyptych_protocol::handshake_io::{ConnectionError, MessageStream, send_hello};
use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use polyptych_protocol::stream::Stream;
use polyptych_tls::{Credentials, connect};
use rcgen::ExtendedKeyUsagePurpose;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{ClientConfig, RootCertStore, ServerConfig, version};

use crate::harness::keys::{self, Forged};
use crate::harness::local_wall::{LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::wait;

/// A wall of two channels with keys.
fn secured() -> LocalWall {
    let (place, wall) = (TestDir::new(), small(2, 1));
    keys::make(&place, &wall);
    LocalWall::start_in(place, &wall, &[], "127.0.0.2:0")
}

fn run<F: Future>(future: F) -> F::Output {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let limited = async { tokio::time::timeout(wait::LIMIT, future).await };
    runtime.expect("a runtime").block_on(limited).expect("an answer in time")
}

/// Connects with these keys and this hello. The error is the manager's reason for a refusal.
async fn greet(
    address: &str,
    keys: &Path,
    role: Role,
    hello: &Hello,
) -> Result<(MessageStream<Stream>, Welcome), String> {
    let keys = Credentials::load(keys).expect("good keys");
    let stream = connect(address, Some(&keys), false).await.expect("connected");
    send_hello(stream, role, hello, &no_token()).await.map_err(|error| error.to_string())
}

/// Over TLS there is none.
fn no_token() -> Secret {
    Secret(String::new())
}

fn client(name: &str) -> Hello {
    Hello::Client(ClientHello { name: name.into() })
}

fn server(name: &str, channel: &str) -> Hello {
    Hello::Server(ServerHello {
        name: name.into(),
        channels: vec![channel.into()],
        pid: 1,
        adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
    })
}

fn bulk(session: u64) -> Hello {
    Hello::Bulk(BulkHello { session })
}

#[test]
fn a_peer_that_says_it_is_another_is_refused() {
    let mut local = secured();
    let [left, right] = ["front-1-1", "front-2-1"];
    assert!(local.servers.contains_key(left) && local.servers.contains_key(right));
    let keys = |node: &str| local.place.path("keys").join(node);
    let [left_keys, operator] = [keys(&format!("server-{left}")), keys("client-operator")];
    let cases: [(&PathBuf, Role, Hello, &str); 6] = [
        (&left_keys, Role::Client, client("operator"), "its certificate that it is server"),
        (&operator, Role::Client, client("planner"), "its certificate that it is client operator"),
        (&operator, Role::Server, server(left, left), "its certificate that it is client operator"),
        (&left_keys, Role::Server, server(right, right), "that it is server front-1-1"),
        (&left_keys, Role::Server, server(left, right), "channel front-2-1 to server front-2-1"),
        (&operator, Role::Bulk, bulk(1), "its certificate that it is client operator"),
    ];
    for (keys, role, hello, reason) in cases {
        let refused = run(greet(&local.address, keys, role, &hello));
        let refused = refused.expect_err(reason);
        assert!(refused.contains(reason), "{reason}: {refused}");
        local.manager.await_line(&["a peer is refused", reason]);
    }
    // The second connection of a server is for itself only: the first sessions are the servers'.
    let known = (1..=8).filter(|&session| {
        run(greet(&local.address, &left_keys, Role::Bulk, &bulk(session))).is_ok()
    });
    assert_eq!(known.count(), 1, "left came in as another server's second connection");
    local.client().render_frame().expect("the wall goes on");
}

/// TLS as somebody sets it up who trusts the wall's authority, and shows what is in a folder.
fn config(authority: &Path, shown: Option<&Path>) -> ClientConfig {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(authority.join("cert.pem")).expect("one")).expect("ok");
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let config = config.with_protocol_versions(&[&version::TLS13]).expect("TLS 1.3");
    let config = config.with_root_certificates(roots);
    let Some(folder) = shown else { return config.with_no_client_auth() };
    let certificate = CertificateDer::from_pem_file(folder.join("cert.pem")).expect("one");
    let key = PrivateKeyDer::from_pem_file(folder.join("key.pem")).expect("a key");
    config.with_client_auth_cert(vec![certificate], key).expect("they fit")
}

/// Connects a client with this TLS configuration. The error is the reason for a refusal.
async fn shake(address: &str, config: ClientConfig) -> Result<(), String> {
    let tcp = tokio::net::TcpStream::connect(address).await.expect("connected");
    let name = "manager.polyptych".try_into().expect("a name");
    let tls = TlsConnector::from(Arc::new(config)).connect(name, tcp).await;
    let tls = tls.map_err(|error| polyptych_tls::describe(&error))?;
    let introduced = send_hello(tls, Role::Client, &client("x"), &no_token()).await;
    introduced.map(drop).map_err(|error| match error {
        ConnectionError::Io(error) => polyptych_tls::describe(&error),
        other => other.to_string(),
    })
}

#[test]
fn a_certificate_that_is_no_good_is_refused_by_its_fault_on_both_sides() {
    let mut local = secured();
    let authority = local.place.path("keys/authority");
    local.place.run(["keys", "wall.toml", "-o", "other"]).succeeded();
    let forge = |name: &str, forged: Forged| {
        let folder = local.place.path(name);
        forged.write(&authority, &folder);
        folder
    };
    let good = || Forged::client("x.client.polyptych");
    let folders = [
        forge("expired", Forged { days: [-300, -3], ..good() }),
        forge("early", Forged { days: [3, 300], ..good() }),
        local.place.path("other/client-operator"),
        forge("purpose", Forged { purpose: ExtendedKeyUsagePurpose::ServerAuth, ..good() }),
        local.place.path("keys/manager"),
        forge("display", Forged { names: vec!["x.display.polyptych".into()], ..good() }),
    ];
    let alert = "the peer refuses this end";
    let faults = [
        [alert, "its time is over since 3 days"],
        [alert, "its time has not begun"],
        ["made by another authority", "another authority made it"],
        [alert, "made for the other side"],
        [alert, "made for the other side"],
        ["the connection", "it names no node of a wall"],
    ];
    for (folder, [told, logged]) in folders.iter().zip(faults) {
        let refused = run(shake(&local.address, config(&authority, Some(folder))));
        let refused = refused.expect_err(logged);
        assert!(refused.contains(told), "{folder:?}: {refused}");
        local.manager.await_line(&["a peer is refused", logged]);
    }
    let refused = run(shake(&local.address, config(&authority, None))).expect_err("no certificate");
    assert!(refused.contains("it wants a certificate"), "{refused}");
    local.manager.await_line(&["a peer is refused", "shows no certificate"]);
    // The same client without a fault is let in: it is the faults that are refused.
    let whole = forge("whole", good());
    run(shake(&local.address, config(&authority, Some(&whole)))).expect("let in");
    local.client().render_frame().expect("the wall goes on");
}

#[test]
fn nobody_but_the_manager_passes_for_it() {
    let local = secured();
    local.place.run(["keys", "wall.toml", "-o", "other"]).succeeded();
    for (folder, fault) in [
        ("keys/server-front-1-1", "made for the other side"),
        ("keys/client-operator", "made for the other side"),
        ("other/manager", "another authority made it"),
    ] {
        let folder = local.place.path(folder);
        let listener = TcpListener::bind("127.0.0.3:0").expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let certificate = CertificateDer::from_pem_file(folder.join("cert.pem")).expect("one");
        let key = PrivateKeyDer::from_pem_file(folder.join("key.pem")).expect("a key");
        let posing = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()));
        let posing = posing.with_protocol_versions(&[&version::TLS13]).expect("TLS 1.3");
        let posing = posing.with_no_client_auth().with_single_cert(vec![certificate], key);
        let posing = tokio_rustls::TlsAcceptor::from(Arc::new(posing.expect("they fit")));
        let operator = local.place.path("keys/client-operator");
        let (accepted, refused) = run(async {
            listener.set_nonblocking(true).expect("set");
            let listener = tokio::net::TcpListener::from_std(listener).expect("a listener");
            let accept = async {
                let (tcp, _) = listener.accept().await.expect("somebody comes");
                posing.accept(tcp).await.map(drop)
            };
            let keys = Credentials::load(&operator).expect("good keys");
            let dialed = async { connect(&address, Some(&keys), false).await.map(drop) };
            tokio::join!(accept, dialed)
        });
        assert!(accepted.is_err(), "{folder:?} passed for the manager");
        let refused = refused.expect_err(fault).to_string();
        assert!(refused.contains(fault), "{folder:?}: {refused}");
    }
}

#[test]
fn one_side_without_keys_is_told_which() {
    let mut local = secured();
    let token = local.place.write("token", "0123456789abcdef0123456789abcdef");
    let token = token.display().to_string();
    // Not through the harness, which gives keys where there are some.
    let clear = ["status", "--token-file", &token, "--manager", &local.address];
    local.place.run(clear).failed(&["speaks TLS only", "--keys"]);
    local.manager.await_line(&["a peer is refused", "came in the clear"]);
    let clear =
        ["server", "--once", "--headless", "--channel", "front-1-1", "--token-file", &token];
    let at = ["--manager", &local.address];
    local.place.run(clear.iter().chain(&at)).failed(&["speaks TLS only", "--keys"]);

    let mut plain = LocalWall::start(&small(1, 1), &[]);
    let operator = local.place.path("keys/client-operator").display().to_string();
    plain.run(&["status", "--keys", &operator]).failed(&["does not speak TLS", "--keys"]);
    plain.manager.await_line(&["a peer is refused", "speaks TLS", "without --keys"]);
    for wall in [&local, &plain] {
        wall.client().render_frame().expect("the wall goes on");
    }
}

/// Says this, and nothing else; gives what is answered before the connection is closed.
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

/// Peers of a time: a stalled one must not take the handshake's limit from the others.
fn stalled(address: &str, manager: &mut Process) {
    let began = Instant::now();
    // The head of a record, a message that is never finished, and not a byte.
    let sayings: [&'static [u8]; 3] = [&[0x16], &[0x16, 3, 1, 2, 0, 1, 0, 1, 252, 3, 3], &[]];
    let peers = sayings.map(|said| {
        let address = address.to_owned();
        let peer = std::thread::Builder::new().name("stranger".into());
        peer.spawn(move || answer_to(&address, said)).expect("a thread")
    });
    for peer in peers {
        assert_eq!(peer.join().expect("closed"), b"");
    }
    // They were closed by the limit, neither at once nor never.
    let took = began.elapsed();
    assert!(took >= HANDSHAKE_TIME_MAX && took < HANDSHAKE_TIME_MAX + wait::LIMIT, "{took:?}");
    manager.await_line(&["a peer did not introduce itself"]);
}

#[test]
fn strangers_at_a_door_with_tls_change_nothing() {
    let mut local = secured();
    let client = local.client();
    let before = client.render_frame().expect("a frame");
    stalled(&local.address, &mut local.manager);
    let http = answer_to(&local.address, b"GET / HTTP/1.1\r\nHost: wall\r\n\r\n");
    assert_eq!(http, b"");
    local.manager.await_line(&["a peer is refused", "does not speak TLS", "GET / HT"]);
    // Noise in a record of TLS, and one message that goes on and on.
    let noise = [&[0x16, 3, 1, 0, 200][..], &[0xa5; 200]].concat();
    assert!(answer_to(&local.address, &noise).len() < 16, "an alert at most");
    local.manager.await_line(&["a peer is refused", "TLS failed"]);
    let head: &[u8] = &[0x16, 3, 1, 0x40, 0, 1, 0, 0xff, 0xff, 3, 3];
    let flood = [head, &[0; 16_384 - 6], &[0x16, 3, 1, 0x40, 0], &[0; 16_384]].concat();
    assert!(answer_to(&local.address, &flood).len() < 16, "an alert at most");
    local.manager.await_line(&["a peer is refused", "4096 bytes"]);
    // Whoever has proven who it is, is still held to the handshake's limits.
    let operator = Credentials::load(&local.place.path("keys/client-operator")).expect("good keys");
    run(async {
        use tokio::io::{AsyncReadExt, AsyncWriteExt};
        let mut stream = connect(&local.address, Some(&operator), false).await.expect("connected");
        let said =
            [&Preamble::current(Role::Client).to_bytes()[..], &5000u32.to_be_bytes(), &[0; 5000]]
                .concat();
        stream.write_all(&said).await.expect("written");
        let mut answer = Vec::new();
        // Closed with what it did not read, or in order.
        let _ = stream.read_to_end(&mut answer).await;
        assert!(answer.len() < 1024, "{} bytes", answer.len());
    });
    let after = client.render_frame().expect("the wall goes on");
    assert!(after.frame > before.frame);
    assert!(after.channels.iter().all(|channel| channel.draw_us.is_some()), "{after:?}");
}
