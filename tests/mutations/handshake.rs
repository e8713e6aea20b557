//! Strangers on the port of a manager in this process, thousands of them, while a good client
//! goes on: damaged, cut off, slow, and of other protocols. The wall does not notice; every
//! connection is closed in time; nothing is left of them.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use fastrand::Rng;
use polyptych_client::ConnectOptions;
use polyptych_client::blocking::Client;
use polyptych_manager::import::Baker;
use polyptych_manager::{ManagerOptions, run};
use polyptych_protocol::handshake::{Preamble, Role};
use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use tokio::sync::Notify;

use crate::mutation::mutate;
use crate::seeds::messages;

/// Strangers one after the other, some of them several at once.
const STRANGERS: u64 = 3000;

/// Strangers that say nothing, or not all, and stay: as many as the door looks at together.
const SILENT: usize = 300;

/// Time after the limit within which a connection must end: the machine is busy.
const GRACE: Duration = Duration::from_secs(20);

/// The first bytes of other protocols: HTTP, TLS, SSH, a TLS alert, SMB.
const OTHERS: [&[u8]; 5] = [
    b"GET / HTTP/1.1\r\nHost: wall\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b"SSH-2.0-OpenSSH_9.2\r\n",
    b"\x15\x03\x01\x00\x02\x02\x46",
    b"\x00\x00\x00\x85\xffSMB",
];

fn start_manager() -> (SocketAddr, Arc<Notify>, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("an address");
    let folder = tempfile::tempdir().expect("a folder");
    let program = PathBuf::from(env!("CARGO_BIN_EXE_polyptych"));
    let store = folder.path().to_owned();
    let baker = Baker { program, memory_mib: 64, memory_remedy: "", store };
    let (wall, token) = (messages::wall(), messages::TOKEN.to_owned());
    let (scene_roots, memory, recorder) = (Vec::new(), None, None);
    let (keys, metrics) = (None, None);
    let options = ManagerOptions {
        wall,
        token,
        keys,
        scene_roots,
        baker,
        memory,
        leadership: None,
        is_navigable: false,
        recorder,
        metrics,
        http: None,
        notifier: None,
    };
    let end = Arc::new(Notify::new());
    let ended = Arc::clone(&end);
    let manager = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let ran = run(listener, options, async move { ended.notified().await });
        runtime.expect("a runtime").block_on(ran).expect("ran");
        drop(folder);
    };
    let thread = thread::Builder::new().name("manager".into()).spawn(manager).expect("a thread");
    (address, end, thread)
}

/// Open files of this process, and its resident memory in KiB.
fn held() -> (usize, i64) {
    let files = fs::read_dir("/proc/self/fd").expect("Linux").count();
    let status = fs::read_to_string("/proc/self/status").expect("Linux");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0");
    (files, line.trim().trim_end_matches(" kB").parse().unwrap_or(0))
}

/// Returns the bytes of a stranger: a handshake that is damaged somewhere, or something else.
fn saying(rng: &mut Rng, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut said = match rng.u8(0..8) {
        0 => OTHERS[rng.usize(0..OTHERS.len())].to_vec(),
        1 => vec![rng.u8(..); rng.usize(0..20_000)],
        _ => seeds[rng.usize(0..seeds.len())].clone(),
    };
    if rng.u8(0..8) != 0 {
        let other = seeds[rng.usize(0..seeds.len())].clone();
        mutate(rng, &mut said, &other);
    }
    said
}

/// Handshakes of each role: the right hello, another's, and other messages.
fn seeds() -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for role in [Role::Client, Role::Server, Role::Bulk, Role::Manager] {
        for (_, bytes) in messages::all().into_iter().take(8) {
            let preamble = Preamble::current(role).to_bytes();
            all.push([&preamble[..], &polyptych_codec::framed(&bytes)].concat());
        }
    }
    all
}

/// Says it, in one or more pieces, and hears the other end out.
fn visit(address: SocketAddr, said: &[u8], pieces: usize) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("connected");
    for piece in said.chunks(said.len().div_ceil(pieces).max(1)) {
        // It may close before all is said.
        if stream.write_all(piece).is_err() {
            break;
        }
    }
    stream
}

/// Reads until the other end closes; panics where it does not.
fn hear_out(mut stream: TcpStream) {
    stream.set_read_timeout(Some(HANDSHAKE_TIME_MAX + GRACE)).expect("a limit");
    let mut part = [0; 4096];
    loop {
        match stream.read(&mut part) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::ConnectionReset => return,
            Err(error) => panic!("a stranger's connection is not closed: {error}"),
        }
    }
}

fn connect(address: SocketAddr) -> Client {
    let mut options = ConnectOptions::new(address.to_string());
    options.token = Some(messages::TOKEN.to_owned());
    Client::connect_with(options).expect("connected")
}

/// Asks without a pause until told to end; gives how often it was answered.
fn good_client(address: SocketAddr, is_over: Arc<AtomicBool>) -> JoinHandle<u64> {
    let work = move || {
        let client = connect(address);
        let mut answers = 0;
        while !is_over.load(Ordering::Relaxed) {
            client.render_frame().expect("the wall goes on");
            answers += 1;
        }
        answers
    };
    thread::Builder::new().name("good".into()).spawn(work).expect("a thread")
}

/// One of the tests here at a time: both count on what this process holds.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
fn strangers_by_the_thousand_leave_nothing_behind() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let (address, end, manager) = start_manager();
    let is_over = Arc::new(AtomicBool::new(false));
    let good = good_client(address, Arc::clone(&is_over));
    let seeds = seeds();
    let mut before = (0, 0);
    for number in 0..STRANGERS {
        if number == STRANGERS / 10 {
            // The first ones fill the allocator's pools.
            before = held();
        }
        let mut rng = Rng::with_seed(crate::seed().wrapping_add(number));
        let said = saying(&mut rng, &seeds);
        let stream = visit(address, &said, rng.usize(1..5));
        // Nothing more will come: what is incomplete is over.
        let _ = stream.shutdown(std::net::Shutdown::Write);
        hear_out(stream);
    }
    is_over.store(true, Ordering::Relaxed);
    let answers = good.join().expect("the good client is served throughout");
    assert!(answers > 10, "{answers} frames meanwhile");
    let client = connect(address);
    let deadline = Instant::now() + GRACE;
    while client.status().expect("a status").clients.len() > 1 {
        assert!(Instant::now() < deadline, "{:?}", client.status());
    }
    let after = held();
    println!("files and KiB: {before:?} became {after:?}; {answers} frames meanwhile");
    // Other tests of this process hold some dozens of files. What they hold of memory is theirs,
    // so it has to be a leak of ten times as much that is seen here: 100 KiB for each stranger.
    assert!(after.0 <= before.0 + 64, "files: {before:?} became {after:?}");
    let growth_kib_max = STRANGERS as i64 * 100;
    assert!(after.1 - before.1 < growth_kib_max, "KiB: {before:?} became {after:?}");
    end.notify_one();
    manager.join().expect("no panic");
}

#[test]
fn who_does_not_finish_is_shown_out_in_time() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let (address, end, manager) = start_manager();
    let begin = Instant::now();
    let seeds = seeds();
    let visit_half = |i: usize| {
        let whole = &seeds[i % seeds.len()];
        // Nothing, half a preamble, no hello, half a hello.
        let cut = [0, 5, 8, 12, whole.len() - 1][i % 5];
        visit(address, &whole[..cut], 1)
    };
    let streams: Vec<TcpStream> = (0..SILENT).map(visit_half).collect();
    // Meanwhile others come in.
    connect(address).render_frame().expect("served");
    streams.into_iter().for_each(hear_out);
    let taken = begin.elapsed();
    assert!(taken < HANDSHAKE_TIME_MAX + GRACE, "{taken:?}");
    end.notify_one();
    manager.join().expect("no panic");
}
