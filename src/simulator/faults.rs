//! Faults on purpose: what is to go wrong in a simulated wall goes wrong at its frame, and what
//! came of it is recorded.

mod fault_proxy;
mod plan;
mod record;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use polyptych_client::FrameFeedback;
use polyptych_files::output_file;
use polyptych_wall::Wall;
use rustix::process::{Pid, Signal, kill_process};

use crate::simulator::local_wall::LocalWall;
pub(crate) use fault_proxy::FaultProxy;
pub(crate) use plan::{Fault, FaultKind, parse};
pub(crate) use record::FaultRecord;
use record::{FaultEnd, FaultEvent, FaultRecorder};

/// Faults that wait for their end at once; a wall with more of them under way learns nothing.
const ENDS_MAX: usize = 64;

/// The text of a server's file that makes its GPU lost, once.
const LOSS: &str = "lose\n";

/// The servers of a wall that need hooks for faults, by name.
#[derive(Clone, Debug, Default)]
pub(crate) struct FaultHooks {
    /// Those whose connections go through a relay.
    pub relayed: BTreeSet<String>,
    /// Those that can be slowed down.
    pub slowed: BTreeSet<String>,
}

impl FaultHooks {
    /// Returns the hooks that these faults need on this wall.
    ///
    /// # Errors
    /// A fault that the wall cannot have.
    pub fn of(plan: &[Fault], wall: &Wall) -> anyhow::Result<Self> {
        let mut needs = Self::default();
        for fault in plan {
            fault.check(wall).map_err(|error| anyhow!("--fault {error}"))?;
            let hit = wall.channels.iter().filter(|channel| fault.may_hit(&channel.name));
            let servers = hit.map(|channel| channel.server.clone());
            match fault.what {
                FaultKind::Slow { .. } | FaultKind::LoseGpu => needs.slowed.extend(servers),
                what if what.is_of_network() => needs.relayed.extend(servers),
                _ => {}
            }
        }
        Ok(needs)
    }
}

/// The faults of a run.
pub(crate) struct Faults<'a> {
    plan: &'a [Fault],
    local: &'a LocalWall,
    /// A channel's name and its server's, in the wall's order.
    channels: Vec<(String, String)>,
    chance: fastrand::Rng,
    recorder: FaultRecorder,
    /// By server: the process that stands still, and until when.
    stopped: BTreeMap<String, (Pid, Instant)>,
    /// Until when servers are slowed, delayed or unplugged; `None`: to the end.
    lasting: BTreeMap<(&'static str, String), Option<Instant>>,
    ends: FaultTimer,
}

impl<'a> Faults<'a> {
    /// The faults of a plan; the same seed chooses the same channels.
    ///
    /// # Errors
    /// The system gave no thread.
    pub fn new(
        plan: &'a [Fault],
        seed: u64,
        wall: &Wall,
        local: &'a LocalWall,
    ) -> anyhow::Result<Self> {
        let channels = wall.channels.iter().map(|c| (c.name.clone(), c.server.clone()));
        let channels: Vec<_> = channels.collect();
        Ok(Self {
            plan,
            local,
            recorder: FaultRecorder::new(channels.iter().cloned(), Instant::now()),
            channels,
            chance: fastrand::Rng::with_seed(seed),
            stopped: BTreeMap::new(),
            lasting: BTreeMap::new(),
            ends: FaultTimer::start()?,
        })
    }

    /// A frame of the run has ended, the first being 1; what is due behind it is done.
    ///
    /// # Errors
    /// The manager is gone.
    pub fn note(&mut self, frame: u64, feedback: &FrameFeedback) -> anyhow::Result<()> {
        let local = self.local;
        self.recorder.note(feedback, &|server| local.restarts_of(server), Instant::now());
        for fault in self.plan.iter().filter(|fault| fault.is_due(frame)) {
            let named = self.channels.iter().position(|(name, _)| *name == fault.channel);
            let channel = named.unwrap_or_else(|| self.chance.usize(..self.channels.len()));
            let server = self.channels[channel].1.clone();
            let deadline_ms = local.client.status()?.deadline_ms;
            let restarts = local.restarts_of(&server);
            let skipped = self.inflict(fault.what, &server).err();
            let end = match fault.what {
                FaultKind::Kill => FaultEnd::Restart(restarts + 1),
                what if what.lasts() => FaultEnd::Never,
                what => what.length().map_or(FaultEnd::AtOnce, FaultEnd::After),
            };
            let what = fault.what.to_string();
            let happened = FaultEvent { frame, what, channel, skipped, deadline_ms, end };
            self.recorder.add(happened, Instant::now());
        }
        Ok(())
    }

    /// Returns the records of all faults, and the number of those that were not recorded.
    pub fn finish(self) -> (Vec<FaultRecord>, u64) {
        let unrecorded = self.recorder.unrecorded;
        (self.recorder.finish(), unrecorded)
    }

    /// Does it. The error is the reason why it could not be done.
    fn inflict(&mut self, what: FaultKind, server: &str) -> Result<(), String> {
        let no_relay = || format!("the server {server} has no relay");
        let relay = || self.local.relay(server).ok_or_else(no_relay);
        match what {
            FaultKind::Kill => signal(self.pid_of(server)?, Signal::KILL)?,
            FaultKind::Stop(length) => self.stop(server, length)?,
            FaultKind::Slow { by, length } => {
                let file = self.local.slow_file(server).ok_or("the server can't be slowed")?;
                check_keeps_gpu(&file)?;
                self.begin_alone("slowed", server, length)?;
                let text = format!("{}\n", by.as_millis());
                output_file::write(&file, text.as_bytes()).map_err(|error| error.to_string())?;
                self.ends.add(length, move || end_slowness(&file, &text));
            }
            FaultKind::LoseGpu => {
                let file = self.local.slow_file(server).ok_or("the server has no such file")?;
                check_keeps_gpu(&file)?;
                // It is read before the next frame, and removed: what slows would end with it.
                self.begin_alone("slowed", server, Some(Duration::ZERO))?;
                output_file::write(&file, LOSS.as_bytes()).map_err(|error| error.to_string())?;
            }
            FaultKind::Corrupt { up, down } => relay()?.corrupt(up, down),
            FaultKind::Cut => relay()?.cut(),
            FaultKind::Unplug(length) => {
                relay()?;
                self.begin_alone("unplugged", server, Some(length))?;
                relay()?.unplug(length);
            }
            FaultKind::Delay { by, length } => {
                relay()?;
                self.begin_alone("delayed", server, length)?;
                let relay = Arc::clone(relay()?);
                relay.delay(by);
                self.ends.add(length, move || relay.delay(Duration::ZERO));
            }
        }
        Ok(())
    }

    /// A server is slowed, delayed or unplugged once at a time: both would have one end.
    fn begin_alone(
        &mut self,
        what: &'static str,
        server: &str,
        length: Option<Duration>,
    ) -> Result<(), String> {
        let now = Instant::now();
        let is_over = |until: &Option<Instant>| until.is_some_and(|until| until <= now);
        let key = (what, server.to_owned());
        if self.lasting.get(&key).is_some_and(|until| !is_over(until)) {
            return Err(format!("its server is {what} already"));
        }
        self.lasting.insert(key, length.map(|length| now + length));
        Ok(())
    }

    fn stop(&mut self, server: &str, length: Duration) -> Result<(), String> {
        let (now, pid) = (Instant::now(), self.pid_of(server)?);
        if is_stopped(self.stopped.get(server), pid, now) {
            return Err("its server is stopped already".to_owned());
        }
        signal(pid, Signal::STOP)?;
        self.stopped.insert(server.to_owned(), (pid, now + length));
        let running = self.local.pid_watch(server);
        // One that was killed meanwhile needs no waking.
        self.ends.add(Some(length), move || drop(wake(pid, running().and_then(process))));
        Ok(())
    }

    fn pid_of(&self, server: &str) -> Result<Pid, String> {
        let pid = self.local.pid_of(server).and_then(process);
        pid.ok_or_else(|| "its server is not running".to_owned())
    }
}

/// Checks that a server's file does not demand a loss of the GPU that the server has not read yet:
/// that fault would be undone by what is written over it.
fn check_keeps_gpu(file: &Path) -> Result<(), String> {
    let is_lost = std::fs::read_to_string(file).is_ok_and(|text| text == LOSS);
    if is_lost { Err("its GPU is about to be lost".to_owned()) } else { Ok(()) }
}

/// Removes a server's file if it still says what slows the server: anything else in it is another
/// fault's.
fn end_slowness(file: &Path, text: &str) {
    if std::fs::read_to_string(file).is_ok_and(|said| said == text) {
        // A file that is gone already slows nobody.
        let _ = std::fs::remove_file(file);
    }
}

fn process(pid: u32) -> Option<Pid> {
    Pid::from_raw(pid as i32)
}

/// Returns whether this process is the one that stands still. A server that was killed meanwhile
/// has another one, which runs.
fn is_stopped(stopped: Option<&(Pid, Instant)>, pid: Pid, now: Instant) -> bool {
    stopped.is_some_and(|&(stopped, until)| stopped == pid && until > now)
}

/// Lets a stopped process go on, if it is still the one that is running for its server: the number
/// of one that has ended may be another program's.
fn wake(pid: Pid, running: Option<Pid>) -> Result<(), String> {
    if running != Some(pid) {
        return Err("it has ended meanwhile".to_owned());
    }
    signal(pid, Signal::CONT)
}

fn signal(pid: Pid, signal: Signal) -> Result<(), String> {
    kill_process(pid, signal).map_err(|error| error.to_string())
}

/// Ends faults when their time is over, on a thread of their own: frames don't wait for them,
/// and they not for frames.
struct FaultTimer {
    due: Option<SyncSender<DueExpiry>>,
    thread: Option<JoinHandle<()>>,
}

struct DueExpiry {
    at: Instant,
    act: Box<dyn FnOnce() + Send>,
}

impl FaultTimer {
    fn start() -> anyhow::Result<Self> {
        let (due, waiting) = sync_channel(ENDS_MAX);
        let thread = Builder::new().name("fault-ends".into()).spawn(move || Self::run(&waiting))?;
        Ok(Self { due: Some(due), thread: Some(thread) })
    }

    /// Without a length there is no end.
    fn add(&self, length: Option<Duration>, act: impl FnOnce() + Send + 'static) {
        if let (Some(length), Some(due)) = (length, &self.due) {
            // Its thread ends only after this end of the queue.
            let _ = due.send(DueExpiry { at: Instant::now() + length, act: Box::new(act) });
        }
    }

    fn run(waiting: &Receiver<DueExpiry>) {
        let mut ends: Vec<DueExpiry> = Vec::new();
        loop {
            let now = Instant::now();
            for end in ends.extract_if(.., |end| end.at <= now) {
                (end.act)();
            }
            let next = ends.iter().map(|end| end.at).min();
            let wait = next.map_or(Duration::from_hours(1), |at| at.saturating_duration_since(now));
            match waiting.recv_timeout(wait) {
                Ok(end) => ends.push(end),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // The run is over: whoever stands still must be able to end.
        for end in ends {
            (end.act)();
        }
    }
}

impl Drop for FaultTimer {
    fn drop(&mut self) {
        drop(self.due.take());
        if let Some(thread) = self.thread.take() {
            // What it had to end ends with the processes then.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_process_that_was_stopped_stands_still_and_is_woken() {
        let own = rustix::process::getpid();
        let other = process(own.as_raw_nonzero().get() as u32 + 1).expect("a number");
        let (now, length) = (Instant::now(), Duration::from_mins(10));
        let stopped = (own, now + length);
        assert!(is_stopped(Some(&stopped), own, now), "a second stop");
        assert!(!is_stopped(Some(&stopped), other, now), "it was killed and started again");
        assert!(!is_stopped(Some(&stopped), own, now + length), "it runs again");
        assert!(!is_stopped(None, own, now));
        wake(own, Some(other)).expect_err("another process runs in its place");
        wake(own, None).expect_err("it has ended");
        wake(own, Some(own)).expect("for a process that runs this is nothing");
    }

    #[test]
    fn a_loss_that_is_not_read_yet_is_not_undone() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("slow-0");
        assert_eq!(check_keeps_gpu(&file), Ok(()), "there is none");
        std::fs::write(&file, "200\n").expect("written");
        assert_eq!(check_keeps_gpu(&file), Ok(()));
        std::fs::write(&file, LOSS).expect("written");
        check_keeps_gpu(&file).expect_err("it was not read");
        // The end of a fault that slowed before.
        end_slowness(&file, "200\n");
        check_keeps_gpu(&file).expect_err("it is still to come");
        std::fs::write(&file, "200\n").expect("written");
        end_slowness(&file, "200\n");
        assert!(!file.exists(), "it still slows");
    }
}
