//! A wall in one process: manager, render servers and client as libraries, on threads.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions, Wall, fit_bounds};
use polyptych_manager::import::Baker;
use polyptych_manager::{ManagerOptions, run as run_manager};
use polyptych_render::{OutputKind, ServerOptions, TokenSource, run as run_server};
use tokio::sync::Notify;

use crate::harness::local_wall::small;
use crate::harness::place::TestDir;
use crate::harness::{scenes, wait};

pub(super) const TOKEN: &str = "0123456789abcdef";

/// A manager on a thread, ended by the notice that is given back.
pub(super) fn start_manager(wall: Wall, place: &TestDir) -> (String, Arc<Notify>, JoinHandle<()>) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("an address").to_string();
    let baker = Baker {
        program: PathBuf::from(env!("CARGO_BIN_EXE_polyptych")),
        memory_mib: 4096,
        memory_remedy: "",
        store: place.path("store"),
    };
    let roots = vec![scenes::town().parent().expect("a folder").to_owned()];
    let options = ManagerOptions {
        wall,
        token: TOKEN.into(),
        keys: None,
        scene_roots: roots,
        baker,
        memory: None,
        leadership: None,
        is_navigable: false,
        recorder: None,
        metrics: None,
        http: None,
        notifier: None,
    };
    let end = Arc::new(Notify::new());
    let ended = Arc::clone(&end);
    let manager = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let shutdown = async move { ended.notified().await };
        runtime
            .expect("a runtime")
            .block_on(run_manager(listener, options, shutdown))
            .expect("ran");
    };
    let thread = thread::Builder::new().name("manager".into()).spawn(manager).expect("a thread");
    (address, end, thread)
}

/// A render server on a thread.
pub(super) fn start_server(
    address: &str,
    channel: &str,
    place: &TestDir,
) -> (Arc<Notify>, JoinHandle<Result<(), String>>) {
    let options = ServerOptions {
        manager: address.to_owned(),
        channels: vec![channel.to_owned()],
        name: channel.to_owned(),
        token: TokenSource::Given(TOKEN.into()),
        keys: None,
        insecure: false,
        cache: place.path("blobs"),
        output: OutputKind::Headless,
        gpu: None,
        monitors: BTreeMap::new(),
        once: false,
        present_delay: std::time::Duration::ZERO,
        slow_draw: None,
        culls_occluded: true,
        notifier: None,
        on_close: None,
    };
    let end = Arc::new(Notify::new());
    let ended = Arc::clone(&end);
    let shutdown = Box::pin(async move { ended.notified().await });
    let server = move || run_server(options, shutdown).map_err(|error| error.to_string());
    (end, thread::Builder::new().name(channel.into()).spawn(server).expect("a thread"))
}

#[test]
fn a_wall_of_threads_shows_a_scene_and_ends_in_order() {
    let place = TestDir::new();
    let wall = small(2, 1);
    let (address, end_manager, manager) = start_manager(wall.clone(), &place);
    let servers: Vec<_> =
        wall.channels.iter().map(|c| start_server(&address, &c.name, &place)).collect();
    let mut connect = ConnectOptions::new(address);
    connect.token = Some(TOKEN.into());
    let client = Client::connect_with(connect).expect("connected");
    wait::until("all channels are ready", || {
        let status = client.status().expect("a status");
        status.channels.iter().all(|channel| channel.state == ChannelState::Ready).then_some(())
    });

    let town = scenes::town().file_name().expect("a name").to_string_lossy().into_owned();
    let scene = client.open_scene(town).expect("opened");
    let bounds = scene.bounds.expect("the town has bounds");
    client.set_camera(fit_bounds(&wall, &bounds, 0.5)).expect("set");
    let feedback = client.render_frame().expect("drawn");
    assert!(feedback.channels.iter().all(|c| c.draw_us.is_some()), "{feedback:?}");
    let capture = client.capture().expect("captured");
    assert!(capture.missing.is_empty(), "{:?}", capture.missing);
    let colors: std::collections::BTreeSet<&[u8]> = capture.screens[0].rgba.chunks(4).collect();
    assert!(colors.len() > 100, "only {} colours: no town", colors.len());

    for (end, server) in servers {
        end.notify_one();
        server.join().expect("no panic").expect("ended in order");
    }
    wait::until("the manager has noticed", || {
        let status = client.status().expect("a status");
        status.channels.iter().all(|channel| channel.state == ChannelState::Lost).then_some(())
    });
    end_manager.notify_one();
    manager.join().expect("no panic");
}
