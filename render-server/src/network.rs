//! The network thread: connects, carries messages, tries again.

use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bytes::Bytes;
use crossbeam_channel::{Sender, TrySendError};
use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::handshake::{
    Adapter, BulkHello, Hello, Role, Secret, ServerHello, Welcome,
};
use polyptych_protocol::handshake_io::{self, ConnectionError, MessageStream};
use polyptych_protocol::limits::{HANDSHAKE_TIME_MAX, PINGS_PER_HEARTBEAT};
use polyptych_protocol::manager_addresses::ManagerAddresses;
use polyptych_protocol::process;
use polyptych_protocol::server_message::{Ping, ServerMessage};
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_protocol::stream::{ConnectError, Stream};
use polyptych_tls::{Credentials, NodeIdentity};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::bulk::{self, BULK_JOBS_MAX};
use crate::clock::{Clock, ClockEstimate};
use crate::connection_status::{ConnectionStatus, ManagerState, time_of_day};
use crate::ending::Ending;
use crate::loader::{LoadOrder, LoaderLink};
use crate::own_address::own_address;
use crate::render_event::RenderEvent;
use crate::render_thread::RenderTask;
use crate::run::{ServerError, ServerOptions, Shutdown};
use crate::term_guard::TermGuard;

/// First and maximum wait before another try. The first is short: a restarted manager should find
/// its wall again at once; the longest keeps a dark wall from flooding a manager that starts.
const RETRY_FIRST: Duration = Duration::from_millis(50);
const RETRY_LONGEST: Duration = Duration::from_secs(2);

/// The same where there is a standby: it takes over within a second or so, and finds its wall.
const RETRY_LONGEST_OF_SEVERAL: Duration = Duration::from_millis(200);

/// Maximum time for a manager whose bulk connection has ended to say why: both connections end
/// together.
const LAST_WORDS_TIME_MAX: Duration = Duration::from_millis(200);

/// Maximum time for sending a goodbye: the next connection waits for it.
const GOODBYE_TIME_MAX: Duration = Duration::from_millis(50);

/// Pause between two tries to tell a render thread whose queue is full.
const FULL_QUEUE_PAUSE: Duration = Duration::from_millis(10);

/// The reason why there is no connection.
#[derive(Debug, thiserror::Error)]
enum End {
    /// No manager answers at the address.
    #[error("{0}")]
    Unreachable(String),
    /// The manager refused this server, the connection failed, or this server cannot connect.
    #[error("{0}")]
    Failed(String),
    /// The manager said goodbye.
    #[error("{0}")]
    Goodbye(Goodbye),
}

impl End {
    fn failed(reason: impl std::fmt::Display) -> Self {
        Self::Failed(reason.to_string())
    }

    /// Returns whether the manager's process ended as a person or a supervisor asked it to.
    fn is_orderly(&self) -> bool {
        use Goodbye::{Ended, Stopped, StoppedWithServers};
        matches!(self, Self::Goodbye(Stopped | StoppedWithServers | Ended))
    }
}

impl From<polyptych_tls::ConnectError> for End {
    fn from(error: polyptych_tls::ConnectError) -> Self {
        use polyptych_tls::ConnectError::Stream;
        match error {
            Stream(ConnectError::Unresolved(_) | ConnectError::Unreachable(_)) => {
                Self::Unreachable(error.to_string())
            }
            _ => Self::failed(error),
        }
    }
}

impl From<ConnectionError> for End {
    fn from(error: ConnectionError) -> Self {
        match error {
            // A manager that is just ending, or not there yet behind a relay.
            ConnectionError::Io(_) | ConnectionError::Closed => {
                Self::Unreachable(error.to_string())
            }
            _ => Self::failed(error),
        }
    }
}

/// The options, channels and clock of the network thread.
pub(crate) struct Network {
    pub options: ServerOptions,
    pub adapter: Adapter,
    pub jobs: Sender<RenderTask>,
    pub orders: Sender<LoadOrder>,
    pub reports: mpsc::Sender<RenderEvent>,
    pub waiting_reports: mpsc::Receiver<RenderEvent>,
    pub clock: Arc<Clock>,
    pub managers: ManagerAddresses,
    pub terms: TermGuard,
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
    let (notifier, jobs) = (network.options.notifier.clone(), network.jobs.clone());
    let result = runtime.block_on(async {
        let mut connected = pin!(network.keep_connected(ending));
        tokio::select! {
            ended = &mut connected => return ended,
            () = show_life(notifier.as_ref(), &jobs) => {}
            () = shutdown => ending.end("it was told to end"),
        }
        connected.await
    });
    if let Some(notifier) = &notifier {
        notifier.stopping();
    }
    // A resolver of names that does not answer is not waited for.
    runtime.shutdown_background();
    result
}

/// Has the render thread tell the supervisor, once a period, that it works: the sign goes through
/// both threads, so that it stays away when either hangs. It never returns.
async fn show_life(notifier: Option<&Arc<ServiceNotifier>>, jobs: &Sender<RenderTask>) {
    let Some(notifier) = notifier else { return std::future::pending().await };
    let mut period = tokio::time::interval(notifier.period());
    period.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        period.tick().await;
        // A full queue is a render thread that stands still.
        let _ = jobs.try_send(RenderTask::ShowLife(Arc::clone(notifier)));
    }
}

impl Network {
    /// Serves one connection after the other until it is to end, as the manager or this process
    /// says.
    ///
    /// # Errors
    /// It is to try once, and has.
    async fn keep_connected(&mut self, ending: &Ending) -> Result<(), ServerError> {
        let has_standby = self.managers.len() > 1;
        let wait_max = if has_standby { RETRY_LONGEST_OF_SEVERAL } else { RETRY_LONGEST };
        let mut wait = RETRY_FIRST;
        let mut last_reasons = vec![String::new(); self.managers.len()];
        // The last manager ended in order, and no other one has come.
        let mut is_away = false;
        tokio::select! {
            () = ending.ended() => return Ok(()),
            address = own_address(self.managers.current()) => self.address = address,
        }
        let all = &self.options.manager;
        self.notice(&format!("connecting to manager {all}"), ManagerState::Expected);
        loop {
            let manager = self.managers.current().to_owned();
            let started = Instant::now();
            let connected = tokio::select! {
                () = ending.ended() => return Ok(()),
                connected = self.connect() => connected,
            };
            let (was_connected, end) = match connected {
                Err(end) => (false, end),
                Ok((frames, welcome)) => (true, self.serve(frames, welcome, ending).await),
            };
            if ending.reason().is_some() {
                return Ok(());
            }
            let reason = end.to_string();
            if matches!(end, End::Goodbye(Goodbye::StoppedWithServers)) {
                tracing::info!(manager, reason, "this server ends");
                return Ok(());
            }
            if self.options.once {
                return Err(ServerError::GaveUp { manager, reason });
            }
            let last_reason = &mut last_reasons[self.managers.index()];
            let is_quiet = is_away && matches!(end, End::Unreachable(_));
            let is_news = reason != *last_reason && !is_quiet;
            if was_connected || is_news {
                *last_reason = reason;
                self.tell(&manager, was_connected, &end);
            }
            is_away = is_quiet || end.is_orderly();
            // A connection that ends again and again, for the same reason and at once, is as good
            // as none.
            if was_connected && (is_news || started.elapsed() > RETRY_LONGEST) {
                wait = RETRY_FIRST;
            }
            // A standby that does not lead refuses at once.
            if !self.managers.advance() {
                continue;
            }
            tokio::select! {
                () = ending.ended() => return Ok(()),
                () = tokio::time::sleep(wait.mul_f64(0.75 + 0.5 * fastrand::f64())) => {}
            }
            wait = (wait * 2).min(wait_max);
        }
    }

    /// Says on displays and in the log that there is no connection. One line for each change; a
    /// manager that is away all night fills no disk.
    fn tell(&mut self, manager: &str, was_connected: bool, end: &End) {
        // The connection's port belongs to nobody any more.
        self.address = self.address.map(|address| SocketAddr::new(address.ip(), 0));
        if end.is_orderly() {
            tracing::info!(manager, reason = %end, "the manager has ended; waiting for the next");
        } else {
            tracing::warn!(manager, reason = %end, "not connected; trying again for ever");
        }
        match end {
            End::Goodbye(Goodbye::Stopped | Goodbye::StoppedWithServers) => {
                let what = format!("wall stopped at {}", time_of_day());
                self.notice(&what, ManagerState::Stopped);
            }
            End::Goodbye(Goodbye::Ended) => {
                self.notice(&format!("manager stopped at {manager}: {end}"), ManagerState::Ended);
            }
            _ if was_connected => {
                self.notice(&format!("manager lost at {manager}: {end}"), ManagerState::Lost);
            }
            _ => self.notice(&format!("no manager at {manager}: {end}"), ManagerState::Expected),
        }
    }

    async fn connect(&mut self) -> Result<(MessageStream<Stream>, Welcome), End> {
        let hello = Hello::Server(ServerHello {
            name: self.options.name.clone(),
            channels: self.options.channels.clone(),
            pid: std::process::id(),
            adapter: self.adapter.clone(),
        });
        let (frames, welcome) = self.introduce(Role::Server, &hello).await?;
        self.terms.admit(welcome.term).map_err(End::failed)?;
        Ok((frames, welcome))
    }

    async fn introduce(
        &self,
        role: Role,
        hello: &Hello,
    ) -> Result<(MessageStream<Stream>, Welcome), End> {
        let introduce = async {
            let secret = self.secret().map_err(End::Failed)?;
            let keys = self.keys().map_err(End::Failed)?;
            let (manager, insecure) = (self.managers.current(), self.options.insecure);
            let stream = polyptych_tls::connect(manager, keys.as_ref(), insecure).await?;
            Ok(handshake_io::send_hello(stream, role, hello, &secret).await?)
        };
        let limit = HANDSHAKE_TIME_MAX;
        let introduced = tokio::time::timeout(limit, introduce).await;
        let silent = |_| End::Unreachable(format!("no answer within {} s", limit.as_secs()));
        introduced.map_err(silent)?
    }

    /// This server's keys, where it has any, as they are now.
    fn keys(&self) -> Result<Option<Credentials>, String> {
        let Some(folder) = &self.options.keys else { return Ok(None) };
        let keys = Credentials::load(folder).map_err(|error| error.to_string())?;
        let wanted = NodeIdentity::Server(self.options.name.clone());
        keys.expect_identity(&wanted).map_err(|error| error.to_string())?;
        Ok(Some(keys))
    }

    /// The token, or an empty one over TLS, where the certificate proves more.
    fn secret(&self) -> Result<Secret, String> {
        if self.options.keys.is_some() {
            return Ok(Secret(String::new()));
        }
        self.options.token.read().map(Secret).map_err(|error| error.to_string())
    }

    /// Serves one connection until it ends, and says why it did, to the manager too.
    async fn serve(
        &mut self,
        mut frames: MessageStream<Stream>,
        welcome: Welcome,
        ending: &Ending,
    ) -> End {
        let end = tokio::select! {
            () = ending.ended() => End::failed(ending.reason().unwrap_or_default()),
            end = self.serve_both(&mut frames, &welcome) => end,
        };
        // A manager that is gone, or reads nothing, is not waited for.
        let goodbye = polyptych_codec::encode(&ServerMessage::Goodbye { reason: end.to_string() });
        let _ = tokio::time::timeout(GOODBYE_TIME_MAX, frames.send(goodbye)).await;
        tokio::select! {
            biased;
            () = send_surely(&self.jobs, RenderTask::Disconnected) => {}
            () = ending.ended() => {}
        }
        end
    }

    /// Serves a control connection and its bulk connection until one of them ends; says why.
    async fn serve_both(&mut self, frames: &mut MessageStream<Stream>, welcome: &Welcome) -> End {
        let (manager, term) = (self.managers.current(), welcome.term.0);
        tracing::info!(manager, wall = welcome.wall, epoch = %welcome.epoch, term, "connected");
        self.address = frames.get_ref().local_addr().ok();
        if let Some(notifier) = &self.options.notifier {
            notifier.ready();
        }
        self.notice(
            &format!("wall {}: getting the scene ready", welcome.wall),
            ManagerState::Expected,
        );
        self.clock.set(None);
        // Reports for an older connection mean nothing on this one.
        while self.waiting_reports.try_recv().is_ok() {}
        send_surely(&self.jobs, RenderTask::Connected).await;
        let hello = Hello::Bulk(BulkHello { session: welcome.session });
        let bulk_frames = match self.introduce(Role::Bulk, &hello).await {
            Ok((frames, _)) => frames,
            Err(end) => return End::Failed(format!("bulk connection: {end}")),
        };
        let (bulk_jobs, waiting) = mpsc::channel(BULK_JOBS_MAX);
        let is_cut = Arc::new(AtomicBool::new(false));
        let line =
            LoaderLink { bulk: bulk_jobs, reports: self.reports.clone(), is_cut: is_cut.clone() };
        let end = {
            let mut conversation = pin!(self.converse(frames, welcome, line));
            tokio::select! {
                biased;
                end = &mut conversation => end,
                reason = bulk::serve(bulk_frames, waiting) => {
                    let last = tokio::time::timeout(LAST_WORDS_TIME_MAX, conversation).await;
                    last.unwrap_or(End::Failed(reason))
                }
            }
        };
        is_cut.store(true, Ordering::Relaxed);
        end
    }

    async fn converse(
        &mut self,
        frames: &mut MessageStream<Stream>,
        welcome: &Welcome,
        line: LoaderLink,
    ) -> End {
        let heartbeat = Duration::from_millis(u64::from(welcome.heartbeat_ms.max(1)));
        let mut ping = tokio::time::interval(heartbeat / PINGS_PER_HEARTBEAT);
        let mut estimate = ClockEstimate::default();
        let mut last_heard = Instant::now();
        loop {
            let outgoing: Bytes = tokio::select! {
                message = frames.next() => {
                    last_heard = Instant::now();
                    match message {
                        None => return End::failed("it closed the connection"),
                        Some(Err(error)) => return End::failed(error),
                        Some(Ok(bytes)) => {
                            if let Err(end) = self.handle_command(&bytes, &mut estimate, &line) {
                                return end;
                            }
                        }
                    }
                    continue;
                }
                Some(report) = self.waiting_reports.recv() => match report {
                    RenderEvent::Status(status) => {
                        if matches!(status, ServerMessage::Prepared(_)) {
                            let what = format!("wall {}: ready, no frame yet", welcome.wall);
                            self.notice(&what, ManagerState::Expected);
                        }
                        polyptych_codec::encode(&status)
                    }
                    RenderEvent::Picture(picture) => {
                        let Some(failed) = bulk::send_picture(&line.bulk, picture) else {
                            continue;
                        };
                        polyptych_codec::encode(&failed)
                    }
                },
                _ = ping.tick() => {
                    if last_heard.elapsed() > heartbeat {
                        let ms = heartbeat.as_millis();
                        return End::failed(format_args!("silent for more than {ms} ms"));
                    }
                    let sent_us = self.clock.local_us();
                    let memory_bytes = process::resident_bytes().unwrap_or(0);
                    polyptych_codec::encode(&ServerMessage::Ping(Ping { sent_us, memory_bytes }))
                }
            };
            match tokio::time::timeout(heartbeat, frames.send(outgoing)).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return End::failed(error),
                Err(_) => return End::failed("it reads nothing any more"),
            }
        }
    }

    fn handle_command(
        &self,
        bytes: &[u8],
        estimate: &mut ClockEstimate,
        line: &LoaderLink,
    ) -> Result<(), End> {
        let malformed = |error| End::failed(format_args!("it sent something malformed: {error}"));
        let command = polyptych_protocol::framing::decode::<Command>(bytes).map_err(malformed)?;
        match command {
            // A full queue is a render thread that stands still: what it misses, it is late with.
            Command::Frame(frame) => drop(self.jobs.try_send(RenderTask::Frame(Box::new(frame)))),
            Command::Swap(swap) => drop(self.jobs.try_send(RenderTask::Swap(swap))),
            Command::Prepare(prepare) => {
                let order = LoadOrder { prepare, line: line.clone() };
                if self.orders.try_send(order).is_err() {
                    return Err(End::failed("it sends changes faster than they can be prepared"));
                }
            }
            Command::Pong(pong) => {
                let now_us = self.clock.local_us();
                estimate.add(&pong, now_us);
                self.clock.set(estimate.best(now_us));
            }
            Command::Goodbye(goodbye) => return Err(End::Goodbye(goodbye)),
        }
        Ok(())
    }

    /// Sends the render thread the connection's state, for channels with an old picture or without
    /// one.
    fn notice(&self, what: &str, manager: ManagerState) {
        if let Some(notifier) = &self.options.notifier {
            notifier.status(what);
        }
        let address = self.address.map(|address| match address.port() {
            0 => address.ip().to_string(),
            _ => address.to_string(),
        });
        let notice =
            ConnectionStatus { what: what.to_owned(), since: time_of_day(), address, manager };
        let _ = self.jobs.try_send(RenderTask::Notice(notice));
    }
}

/// Tells the render thread that a connection begins or has ended. Waits while its queue is full:
/// frames and reports of one connection would else be taken for those of the next one.
async fn send_surely(jobs: &Sender<RenderTask>, mut waiting: RenderTask) {
    while let Err(TrySendError::Full(task)) = jobs.try_send(waiting) {
        waiting = task;
        tokio::time::sleep(FULL_QUEUE_PAUSE).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_render_thread_whose_queue_is_full_hears_of_the_end_of_a_connection() {
        let (jobs, waiting) = crossbeam_channel::bounded(1);
        let wall = ConnectionStatus {
            what: "connected".to_owned(),
            since: "12:03:10 UTC".to_owned(),
            address: None,
            manager: ManagerState::Expected,
        };
        jobs.try_send(RenderTask::Notice(wall)).expect("room");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
        let taken = runtime.expect("a runtime").block_on(async {
            let mut sent = pin!(send_surely(&jobs, RenderTask::Disconnected));
            let is_sent = futures_util::poll!(sent.as_mut()).is_ready();
            assert!(!is_sent, "there is no room for it");
            let first = waiting.try_recv().expect("the notice");
            sent.await;
            [first, waiting.try_recv().expect("the end")]
        });
        assert!(matches!(taken, [RenderTask::Notice(_), RenderTask::Disconnected]), "{taken:?}");
    }
}
