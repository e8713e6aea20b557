//! A way between one server and its manager that can be hurt.
//!
//! Bytes that come in on one side go out on the other, in order, after the delay in force. Only
//! servers with faults of their connections go through a proxy; the others connect directly.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

use polyptych_protocol::handshake::{PREAMBLE_BYTES, Preamble, Role};

/// Bytes that are taken from a socket at once.
const PIECE_BYTES: usize = 16 << 10;

/// Pieces that are on their way in one direction: 4 MiB, beyond which the sender waits as it
/// would for a full socket.
const PIECES_MAX: usize = 256;

/// Connections at once. A server has two, and those that it has given up may linger.
const CONNECTIONS_MAX: usize = 32;

/// A relay on a port of its own.
#[derive(Debug)]
pub(crate) struct FaultProxy {
    address: SocketAddr,
    state: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    line: Mutex<LinkState>,
    changed: Condvar,
}

/// The present state of the link.
#[derive(Debug, Default)]
struct LinkState {
    delay: Duration,
    unplugged_until: Option<Instant>,
    /// `true` if the next piece of a control connection is to be changed: up, down.
    corrupt: [bool; 2],
    open: BTreeMap<u64, Connection>,
    next: u64,
    is_over: bool,
}

/// Both ends of a connection.
#[derive(Debug)]
struct Connection {
    ends: [TcpStream; 2],
    /// Directions that are still carried.
    halves: u8,
}

/// Towards the manager, or away from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Up = 0,
    Down = 1,
}

/// Bytes on their way, and when they are to arrive.
struct DelayedChunk {
    due: Instant,
    bytes: Vec<u8>,
}

impl Shared {
    fn line(&self) -> MutexGuard<'_, LinkState> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FaultProxy {
    /// A relay to this manager.
    ///
    /// # Errors
    /// The system gave no port or no thread.
    pub fn start(manager: SocketAddr) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let state = Arc::new(Shared::default());
        let shared = Arc::clone(&state);
        Builder::new().name("relay".into()).spawn(move || accept(&listener, manager, &shared))?;
        Ok(Self { address, state })
    }

    /// Returns the address that its server connects to instead of the manager's.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// From now on every byte takes this much longer, in each direction.
    pub fn delay(&self, delay: Duration) {
        self.state.line().delay = delay;
    }

    /// Nothing passes for this long; nobody is told. What was sent meanwhile arrives afterwards,
    /// as it does where a cable is put in again.
    pub fn unplug(&self, length: Duration) {
        self.state.line().unplugged_until = Some(Instant::now() + length);
    }

    /// Changes the next piece of the control connection in these directions.
    pub fn corrupt(&self, up: bool, down: bool) {
        let mut line = self.state.line();
        line.corrupt = [line.corrupt[0] || up, line.corrupt[1] || down];
    }

    /// Closes all connections; new ones are let through.
    pub fn cut(&self) {
        for end in self.state.line().open.values().flat_map(|connection| &connection.ends) {
            // The other side may have closed it already.
            let _ = end.shutdown(Shutdown::Both);
        }
    }
}

impl Drop for FaultProxy {
    fn drop(&mut self) {
        self.cut();
        self.state.line().is_over = true;
        self.state.changed.notify_all();
        // Wakes the thread that accepts; it looks whether it is over before all else.
        drop(TcpStream::connect(self.address));
    }
}

fn accept(listener: &TcpListener, manager: SocketAddr, shared: &Arc<Shared>) {
    for server in listener.incoming() {
        if shared.line().is_over {
            return;
        }
        // A manager that can't be reached is told by a connection that ends at once.
        let opened = server.and_then(|server| open(server, manager, shared));
        if let Err(error) = opened {
            tracing::debug!(%error, "a relayed connection was not made");
        }
    }
}

/// Connects the two ends, by two threads for each direction.
fn open(server: TcpStream, manager: SocketAddr, shared: &Arc<Shared>) -> std::io::Result<()> {
    if shared.line().open.len() >= CONNECTIONS_MAX {
        return Err(std::io::Error::other("too many connections of one server"));
    }
    let manager = TcpStream::connect(manager)?;
    server.set_nodelay(true)?;
    manager.set_nodelay(true)?;
    let way = |direction, from: &TcpStream, to: &TcpStream| -> std::io::Result<_> {
        Ok((direction, from.try_clone()?, to.try_clone()?))
    };
    let ways = [way(Direction::Up, &server, &manager)?, way(Direction::Down, &manager, &server)?];
    let number = {
        let mut line = shared.line();
        line.next += 1;
        let number = line.next;
        line.open.insert(number, Connection { ends: [server, manager], halves: 2 });
        number
    };
    let is_bulk = Arc::new(AtomicBool::new(false));
    for (direction, from, to) in ways {
        let (pieces, waiting) = sync_channel(PIECES_MAX);
        let (reading, writing) = (Arc::clone(shared), Arc::clone(shared));
        let reader = Reader { direction, is_bulk: Arc::clone(&is_bulk), shared: reading };
        Builder::new().name("relay-in".into()).spawn(move || reader.run(from, &pieces))?;
        Builder::new()
            .name("relay-out".into())
            .spawn(move || write(to, &waiting, &writing, number))?;
    }
    Ok(())
}

/// The reader of one direction of a connection.
struct Reader {
    direction: Direction,
    /// `true` if the connection is a server's second one; known once its first bytes have come.
    is_bulk: Arc<AtomicBool>,
    shared: Arc<Shared>,
}

impl Reader {
    /// Ends when one of the two sockets does.
    fn run(self, mut from: TcpStream, pieces: &SyncSender<DelayedChunk>) {
        let mut buffer = vec![0; PIECE_BYTES];
        let mut is_first = true;
        loop {
            let count = match from.read(&mut buffer) {
                Ok(0) | Err(_) => return,
                Ok(count) => count,
            };
            let mut bytes = buffer[..count].to_vec();
            if std::mem::take(&mut is_first) && self.direction == Direction::Up {
                self.is_bulk.store(is_bulk(&bytes), Ordering::Relaxed);
            }
            let due = Instant::now() + self.look_at(&mut bytes);
            if pieces.send(DelayedChunk { due, bytes }).is_err() {
                return;
            }
        }
    }

    /// Does to a piece what is to be done to it; gives the delay in force.
    fn look_at(&self, bytes: &mut [u8]) -> Duration {
        let mut line = self.shared.line();
        let is_control = !self.is_bulk.load(Ordering::Relaxed);
        if is_control && std::mem::take(&mut line.corrupt[self.direction as usize]) {
            // Every length and every number in it is another one afterwards.
            for byte in bytes {
                *byte ^= 0xa5;
            }
        }
        line.delay
    }
}

fn is_bulk(first: &[u8]) -> bool {
    let preamble = first.first_chunk::<PREAMBLE_BYTES>();
    let preamble = preamble.and_then(|bytes| Preamble::from_bytes(*bytes).ok());
    preamble.is_some_and(|preamble| preamble.role == Role::Bulk)
}

/// Gives out what has come in, when it is due and while the way is not unplugged.
fn write(mut to: TcpStream, waiting: &Receiver<DelayedChunk>, shared: &Shared, number: u64) {
    for piece in waiting {
        std::thread::sleep(piece.due.saturating_duration_since(Instant::now()));
        if !await_plug(shared) || to.write_all(&piece.bytes).is_err() {
            break;
        }
    }
    // The end of a connection is held up as its bytes are.
    await_plug(shared);
    let mut line = shared.line();
    let _ = to.shutdown(Shutdown::Both);
    if let Some(connection) = line.open.get_mut(&number) {
        connection.halves -= 1;
        if connection.halves == 0 {
            line.open.remove(&number);
        }
    }
}

/// Waits while the way is unplugged; `false` where it will not be used any more.
fn await_plug(shared: &Shared) -> bool {
    let mut line = shared.line();
    loop {
        let now = Instant::now();
        let until = line.unplugged_until.filter(|&until| until > now);
        match until {
            _ if line.is_over => return false,
            None => return true,
            Some(until) => {
                let waited = shared.changed.wait_timeout(line, until - now);
                line = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A relay, and both ends of a connection through it that began with these bytes.
    fn connect(first: &[u8]) -> (FaultProxy, TcpStream, TcpStream) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let relay = FaultProxy::start(listener.local_addr().expect("an address")).expect("a relay");
        let mut server = TcpStream::connect(relay.address()).expect("connected");
        let (mut manager, _) = listener.accept().expect("accepted");
        for end in [&server, &manager] {
            end.set_read_timeout(Some(Duration::from_secs(10))).expect("a limit");
        }
        server.write_all(first).expect("written");
        assert_eq!(take(&mut manager, first.len()), first);
        (relay, server, manager)
    }

    fn take(from: &mut TcpStream, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        from.read_exact(&mut bytes).expect("as many bytes as were sent");
        bytes
    }

    fn connect_control() -> (FaultProxy, TcpStream, TcpStream) {
        connect(&Preamble::current(Role::Server).to_bytes())
    }

    #[test]
    fn bytes_pass_in_order_both_ways_and_so_does_the_end() {
        let (_relay, mut server, mut manager) = connect_control();
        let sent: Vec<u8> = (0..3 * PIECE_BYTES).map(|n| (n % 251) as u8).collect();
        server.write_all(&sent).expect("written");
        assert_eq!(take(&mut manager, sent.len()), sent);
        manager.write_all(&sent).expect("written");
        assert_eq!(take(&mut server, sent.len()), sent);
        drop(server);
        assert_eq!(manager.read(&mut [0]).expect("the end"), 0);
    }

    #[test]
    fn a_delay_holds_bytes_up_and_keeps_their_order() {
        let (relay, mut server, mut manager) = connect_control();
        relay.delay(Duration::from_millis(60));
        let start = Instant::now();
        server.write_all(b"ab").expect("written");
        assert_eq!(take(&mut manager, 1), b"a");
        assert!(start.elapsed() >= Duration::from_millis(60), "{:?}", start.elapsed());
        relay.delay(Duration::ZERO);
        server.write_all(b"c").expect("written");
        assert_eq!(take(&mut manager, 2), b"bc");
    }

    #[test]
    fn an_unplugged_way_holds_everything_and_closes_nothing() {
        let (relay, mut server, mut manager) = connect_control();
        let start = Instant::now();
        relay.unplug(Duration::from_millis(100));
        server.write_all(b"a").expect("written");
        drop(server);
        assert_eq!(take(&mut manager, 1), b"a");
        assert_eq!(manager.read(&mut [0]).expect("the end"), 0);
        assert!(start.elapsed() >= Duration::from_millis(100), "{:?}", start.elapsed());
    }

    #[test]
    fn one_piece_of_one_direction_of_the_control_connection_is_changed() {
        let (relay, mut server, mut manager) = connect_control();
        relay.corrupt(false, true);
        for (sent, came) in [(b"ab", [b'a' ^ 0xa5, b'b' ^ 0xa5]), (b"cd", *b"cd")] {
            server.write_all(sent).expect("written");
            assert_eq!(take(&mut manager, 2), sent);
            manager.write_all(sent).expect("written");
            assert_eq!(take(&mut server, 2), came);
        }
        let bulk = Preamble::current(Role::Bulk).to_bytes();
        let (relay, mut server, mut manager) = connect(&bulk);
        relay.corrupt(true, true);
        server.write_all(b"ab").expect("written");
        assert_eq!(take(&mut manager, 2), b"ab");
    }

    #[test]
    fn a_cut_ends_what_is_open_and_nothing_is_left_of_it() {
        let (relay, mut server, mut manager) = connect_control();
        relay.cut();
        for end in [&mut server, &mut manager] {
            let ended = end.read(&mut [0]);
            assert!(matches!(ended, Ok(0) | Err(_)), "{ended:?}");
        }
        let deadline = Instant::now() + Duration::from_secs(10);
        while !relay.state.line().open.is_empty() {
            assert!(Instant::now() < deadline, "the connection is still known");
            std::thread::yield_now();
        }
    }
}
