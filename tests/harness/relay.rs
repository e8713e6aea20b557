//! A line between a server and its manager that can be held: bytes wait in it, as on a slow link.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::Builder;

/// The relay; its threads end with their connections.
#[derive(Debug)]
pub struct Relay {
    /// The address that a server connects to.
    pub address: String,
    state: Arc<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Bytes that the manager may still send on each connection but the first.
    allowance: Mutex<Option<usize>>,
    changed: Condvar,
    is_over: AtomicBool,
}

impl Relay {
    /// A relay to the manager. Every connection but the first, which is a server's control
    /// connection, brings down only `bytes` bytes until [`Relay::release`].
    pub fn holding_bulk_after(bytes: usize, manager: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = listener.local_addr().expect("an address").to_string();
        let state = Arc::new(State { allowance: Mutex::new(Some(bytes)), ..State::default() });
        let (manager, shared) = (manager.to_owned(), Arc::clone(&state));
        let accept = move || {
            for (index, server) in listener.incoming().enumerate() {
                if shared.is_over.load(Ordering::Relaxed) {
                    return;
                }
                let (Ok(server), Ok(manager)) = (server, TcpStream::connect(&manager)) else {
                    continue;
                };
                let up = [&server, &manager].map(|stream| stream.try_clone().expect("cloned"));
                spawn(move || carry(up, |_| {}));
                let state = Arc::clone(&shared);
                let wait = move |sent| {
                    if index > 0 {
                        state.await_allowance(sent);
                    }
                };
                spawn(move || carry([manager, server], wait));
            }
        };
        spawn(accept);
        Self { address, state }
    }

    /// From now on everything passes.
    pub fn release(&self) {
        *self.state.allowance.lock().unwrap_or_else(PoisonError::into_inner) = None;
        self.state.changed.notify_all();
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.release();
        self.state.is_over.store(true, Ordering::Relaxed);
        // The listener hears of it by one more connection.
        drop(TcpStream::connect(&self.address));
    }
}

impl State {
    fn await_allowance(&self, sent: usize) {
        let allowance = self.allowance.lock().unwrap_or_else(PoisonError::into_inner);
        let is_held = |allowance: &mut Option<usize>| allowance.is_some_and(|most| sent > most);
        drop(self.changed.wait_while(allowance, is_held));
    }
}

fn spawn(work: impl FnOnce() + Send + 'static) {
    Builder::new().name("relay".into()).spawn(work).expect("a thread");
}

/// Carries bytes until one end closes; `wait` is told how many have passed so far.
fn carry([mut from, mut to]: [TcpStream; 2], wait: impl Fn(usize)) {
    let mut piece = vec![0; 1 << 16];
    let mut sent = 0;
    while let Ok(length @ 1..) = from.read(&mut piece) {
        sent += length;
        wait(sent);
        if to.write_all(&piece[..length]).is_err() {
            break;
        }
    }
    // Either may be closed already.
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
