//! Connections that say nothing, many and all the time: whoever belongs to the wall still comes in.

use std::collections::VecDeque;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use polyptych_client::ChannelState;

use crate::harness::local_wall::{LocalWall, await_states, small};
use crate::harness::wait;

/// Connections that one flood holds open; beyond, it closes its oldest.
const HELD: usize = 600;

/// Maximum time in which a command of the wall's user is answered.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(1);

/// Connections that a flood makes together, and the time to the next: 5,000 a second.
const TOGETHER: usize = 50;
const PERIOD: Duration = Duration::from_millis(10);

/// Connects all the time and says nothing.
struct Flood {
    connected: Arc<AtomicU64>,
    /// Ends it when it is dropped.
    end: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Flood {
    fn start(address: &str) -> Self {
        let connected = Arc::<AtomicU64>::default();
        let (count, address) = (connected.clone(), address.to_owned());
        let (end, ended) = sync_channel(0);
        let connect = move || {
            let mut held = VecDeque::new();
            while ended.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                for _ in 0..TOGETHER {
                    if let Ok(stream) = TcpStream::connect(&address) {
                        held.push_back(stream);
                        count.fetch_add(1, Ordering::Relaxed);
                    }
                    if held.len() > HELD {
                        held.pop_front();
                    }
                }
            }
        };
        let thread = Builder::new().name("flood".into()).spawn(connect).expect("a thread");
        Self { connected, end: Some(end), thread: Some(thread) }
    }
}

impl Drop for Flood {
    fn drop(&mut self) {
        self.end = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

#[test]
fn silent_connections_keep_nobody_out() {
    let mut local = LocalWall::start(&small(1, 1), &[]);
    let flood = Flood::start(&local.address);
    let enough = 2000;
    let connected = || flood.connected.load(Ordering::Relaxed);
    wait::until("a flood", || (connected() > enough).then_some(()));
    for _ in 0..5 {
        let asked = Instant::now();
        local.run(&["status", "--json"]).succeeded();
        let took = asked.elapsed();
        println!("status took {} ms among {} connections", took.as_millis(), connected());
        assert!(took < ANSWER_TIME_MAX, "{took:?}");
    }
    let server = local.wall().channels[0].server.clone();
    local.servers.get_mut(&server).expect("there").kill();
    local.start_server(&server);
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    drop(flood);
}
