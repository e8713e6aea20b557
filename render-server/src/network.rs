//! The network thread: connects, carries messages, tries again.

use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bytes::Bytes;
use crossbeam_channel::Sender;
use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::codec;
use polyptych_protocol::command::Command;
use polyptych_protocol::connection::{self, Frames};
use polyptych_protocol::handshake::{
    Adapter, BulkHello, Hello, Role, Secret, ServerHello, Welcome,
};
use polyptych_protocol::identity::Identity;
use polyptych_protocol::keys::Keys;
use polyptych_protocol::limits::{HANDSHAKE_TIME_MAX, PINGS_PER_HEARTBEAT};
use polyptych_protocol::process;
use polyptych_protocol::status::{Ping, Status};
use polyptych_protocol::stream::{self, Stream};
use tokio::net::UdpSocket;
use tokio::sync::mpsc;

use crate::bulk::{self, BULK_JOBS_MAX, BulkJob};
use crate::clock::{Clock, ClockEstimate};
use crate::ending::Ending;
use crate::loader::{Line, LoadOrder};
use crate::notice::{Notice, time_of_day};
use crate::render_thread::Job;
use crate::report::Report;
use crate::run::{ServerError, ServerOptions, Shutdown};

/// First and longest wait before another try. The first is short: a restarted manager should find
/// its wall again at once; the longest keeps a dark wall from flooding a manager that starts.
const RETRY_FIRST: Duration = Duration::from_millis(50);
const RETRY_LONGEST: Duration = Duration::from_secs(2);

/// How long a goodbye may take: the next connection waits for it.
const GOODBYE_TIME_MAX: Duration = Duration::from_millis(50);

/// What the network thread works with.
pub(crate) struct Network {
    pub options: ServerOptions,
    pub adapter: Adapter,
    pub jobs: Sender<Job>,
    pub orders: Sender<LoadOrder>,
    pub reports: mpsc::Sender<Report>,
    pub waiting_reports: mpsc::Receiver<Report>,
    pub clock: Arc<Clock>,
    /// This machine's, as the manager sees it.
    pub address: Option<SocketAddr>,
}

/// Connects and serves until told to end, which the manager is told.
pub(crate) fn run(
    mut network: Network,
    shutdown: Shutdown,
    ending: &Ending,
) -> Result<(), ServerError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut connected = pin!(network.keep_connected(ending));
        tokio::select! {
            ended = &mut connected => return ended,
            () = shutdown => ending.end("it was told to end"),
        }
        connected.await
    })
}

impl Network {
    /// Serves one connection after the other until it is to end.
    ///
    /// # Errors
    /// It is to try once, and has.
    async fn keep_connected(&mut self, ending: &Ending) -> Result<(), ServerError> {
        let manager = self.options.manager.clone();
        let mut wait = RETRY_FIRST;
        let mut last_reason = String::new();
        tokio::select! {
            () = ending.ended() => return Ok(()),
            address = own_address(&manager) => self.address = address,
        }
        self.notice(&format!("connecting to manager {manager}"), false);
        loop {
            let started = Instant::now();
            let connected = tokio::select! {
                () = ending.ended() => return Ok(()),
                connected = self.connect() => connected,
            };
            let (was_connected, reason) = match connected {
                Err(reason) => (false, reason),
                Ok((frames, welcome)) => (true, self.serve(frames, welcome, ending).await),
            };
            if ending.reason().is_some() {
                return Ok(());
            }
            if self.options.once {
                return Err(ServerError::GaveUp { manager, reason });
            }
            // One line for each change; a manager that is away all night fills no disk.
            let is_news = reason != last_reason;
            if was_connected || is_news {
                // The connection's port belongs to nobody any more.
                self.address = self.address.map(|address| SocketAddr::new(address.ip(), 0));
                tracing::warn!(manager, reason, "not connected; trying again for ever");
                let what = if was_connected { "manager lost" } else { "no manager" };
                self.notice(&format!("{what} at {manager}: {reason}"), was_connected);
            }
            last_reason = reason;
            // A connection that ends again and again, for the same reason and at once, is as good
            // as none.
            if was_connected && (is_news || started.elapsed() > RETRY_LONGEST) {
                wait = RETRY_FIRST;
            }
            tokio::select! {
                () = ending.ended() => return Ok(()),
                () = tokio::time::sleep(wait.mul_f64(0.75 + 0.5 * fastrand::f64())) => {}
            }
            wait = (wait * 2).min(RETRY_LONGEST);
        }
    }

    async fn connect(&self) -> Result<(Frames<Stream>, Welcome), String> {
        let hello = Hello::Server(ServerHello {
            name: self.options.name.clone(),
            token: self.token()?,
            channels: self.options.channels.clone(),
            pid: std::process::id(),
            adapter: self.adapter.clone(),
        });
        self.introduce(Role::Server, &hello).await
    }

    async fn introduce(
        &self,
        role: Role,
        hello: &Hello,
    ) -> Result<(Frames<Stream>, Welcome), String> {
        let introduce = async {
            let keys = self.keys()?;
            let (manager, insecure) = (&self.options.manager, self.options.insecure);
            let stream = stream::dial(manager, keys.as_ref(), insecure).await;
            let stream = stream.map_err(|error| error.to_string())?;
            connection::introduce(stream, role, hello).await.map_err(|error| error.to_string())
        };
        let limit = HANDSHAKE_TIME_MAX;
        let introduced = tokio::time::timeout(limit, introduce).await;
        introduced.map_err(|_| format!("no answer within {} s", limit.as_secs()))?
    }

    /// This server's keys, where it has any, as they are now.
    fn keys(&self) -> Result<Option<Keys>, String> {
        let Some(folder) = &self.options.keys else { return Ok(None) };
        let keys = Keys::load(folder).map_err(|error| error.to_string())?;
        let wanted = Identity::Server(self.options.name.clone());
        keys.require(&wanted).map_err(|error| error.to_string())?;
        Ok(Some(keys))
    }

    /// What to show to the manager: over TLS the certificate does, and the token stays here.
    fn token(&self) -> Result<Secret, String> {
        if self.options.keys.is_some() {
            return Ok(Secret(String::new()));
        }
        self.options.token.read().map(Secret).map_err(|error| error.to_string())
    }

    /// Serves one connection until it ends, and says why it did, to the manager too.
    async fn serve(
        &mut self,
        mut frames: Frames<Stream>,
        welcome: Welcome,
        ending: &Ending,
    ) -> String {
        let reason = tokio::select! {
            () = ending.ended() => ending.reason().unwrap_or_default().to_owned(),
            reason = self.serve_both(&mut frames, &welcome) => reason,
        };
        // A manager that is gone, or reads nothing, is not waited for.
        let goodbye = codec::encode(&Status::Goodbye { reason: reason.clone() });
        let _ = tokio::time::timeout(GOODBYE_TIME_MAX, frames.send(goodbye)).await;
        let _ = self.jobs.try_send(Job::Disconnected);
        reason
    }

    /// Serves a control connection and its bulk connection until one of them ends; says why.
    async fn serve_both(&mut self, frames: &mut Frames<Stream>, welcome: &Welcome) -> String {
        let manager = &self.options.manager;
        tracing::info!(manager, wall = welcome.wall, epoch = %welcome.epoch, "connected");
        self.address = frames.get_ref().local_addr().ok();
        self.notice(&format!("wall {}: getting the scene ready", welcome.wall), false);
        self.clock.set(None);
        // Reports for an older connection mean nothing on this one.
        while self.waiting_reports.try_recv().is_ok() {}
        let token = match self.token() {
            Ok(token) => token,
            Err(reason) => return reason,
        };
        let hello = Hello::Bulk(BulkHello { token, session: welcome.session });
        let bulk_frames = match self.introduce(Role::Bulk, &hello).await {
            Ok((frames, _)) => frames,
            Err(reason) => return format!("bulk connection: {reason}"),
        };
        let (bulk_jobs, waiting) = mpsc::channel(BULK_JOBS_MAX);
        let is_cut = Arc::new(AtomicBool::new(false));
        let line = Line { bulk: bulk_jobs, reports: self.reports.clone(), is_cut: is_cut.clone() };
        let reason = tokio::select! {
            reason = bulk::serve(bulk_frames, waiting) => reason,
            reason = self.converse(frames, welcome, line) => reason,
        };
        is_cut.store(true, Ordering::Relaxed);
        reason
    }

    async fn converse(
        &mut self,
        frames: &mut Frames<Stream>,
        welcome: &Welcome,
        line: Line,
    ) -> String {
        let heartbeat = Duration::from_millis(u64::from(welcome.heartbeat_ms.max(1)));
        let mut ping = tokio::time::interval(heartbeat / PINGS_PER_HEARTBEAT);
        let mut estimate = ClockEstimate::default();
        let mut last_heard = Instant::now();
        loop {
            let outgoing: Bytes = tokio::select! {
                message = frames.next() => {
                    last_heard = Instant::now();
                    match message {
                        None => return "it closed the connection".to_owned(),
                        Some(Err(error)) => return error.to_string(),
                        Some(Ok(bytes)) => {
                            if let Err(reason) = self.obey(&bytes, &mut estimate, &line) {
                                return reason;
                            }
                        }
                    }
                    continue;
                }
                Some(report) = self.waiting_reports.recv() => match report {
                    Report::Status(status) => {
                        if matches!(status, Status::Prepared(_)) {
                            let what = format!("wall {}: ready, no frame yet", welcome.wall);
                            self.notice(&what, false);
                        }
                        codec::encode(&status)
                    }
                    Report::Picture(picture) => {
                        if line.bulk.try_send(BulkJob::Send(picture)).is_err() {
                            tracing::warn!("a picture was dropped: the bulk connection is busy");
                        }
                        continue;
                    }
                },
                _ = ping.tick() => {
                    if last_heard.elapsed() > heartbeat {
                        return format!("silent for more than {} ms", heartbeat.as_millis());
                    }
                    let sent_us = self.clock.local_us();
                    let memory_bytes = process::resident_bytes().unwrap_or(0);
                    codec::encode(&Status::Ping(Ping { sent_us, memory_bytes }))
                }
            };
            match tokio::time::timeout(heartbeat, frames.send(outgoing)).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return error.to_string(),
                Err(_) => return "it reads nothing any more".to_owned(),
            }
        }
    }

    fn obey(&self, bytes: &[u8], estimate: &mut ClockEstimate, line: &Line) -> Result<(), String> {
        let command = codec::decode::<Command>(bytes)
            .map_err(|error| format!("it sent something malformed: {error}"))?;
        match command {
            // A full queue is a render thread that stands still: what it misses, it is late with.
            Command::Frame(frame) => drop(self.jobs.try_send(Job::Frame(Box::new(frame)))),
            Command::Swap(swap) => drop(self.jobs.try_send(Job::Swap(swap))),
            Command::Prepare(prepare) => {
                let order = LoadOrder { prepare, line: line.clone() };
                if self.orders.try_send(order).is_err() {
                    return Err("it sends changes faster than they can be prepared".to_owned());
                }
            }
            Command::Pong(pong) => {
                let now_us = self.clock.local_us();
                estimate.add(&pong, now_us);
                self.clock.set(estimate.best(now_us));
            }
            Command::Goodbye { reason } => return Err(reason),
        }
        Ok(())
    }

    /// What channels without a picture say, and since when; and those whose picture is old.
    fn notice(&self, what: &str, is_lost: bool) {
        let address = self.address.map(|address| match address.port() {
            0 => address.ip().to_string(),
            _ => address.to_string(),
        });
        let notice = Notice { what: what.to_owned(), since: time_of_day(), address, is_lost };
        let _ = self.jobs.try_send(Job::Notice(notice));
    }
}

/// This machine's address on the way to the manager, with port 0: the system's table of routes is
/// asked by a socket that sends nothing. `None` where there is no way, or no such name.
async fn own_address(manager: &str) -> Option<SocketAddr> {
    let ask = async {
        for any in ["0.0.0.0:0", "[::]:0"] {
            let Ok(socket) = UdpSocket::bind(any).await else { continue };
            if socket.connect(manager).await.is_ok() {
                let address = socket.local_addr().ok()?;
                return Some(SocketAddr::new(address.ip(), 0));
            }
        }
        None
    };
    tokio::time::timeout(HANDSHAKE_TIME_MAX, ask).await.ok().flatten()
}
