//! Keeps the state file on a thread of its own: a disk that is full, slow or frozen holds no
//! frame. Answers that tell of a change wait until the change is kept, but not for long: then they
//! go out with a warning.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

use polyptych_core::{PersistentState, SessionId};
use polyptych_protocol::request::MessageToClient;
use tokio::sync::watch;

use super::StateFile;

/// Maximum time that an answer waits for the disk.
const HOLD_TIME_MAX: Duration = Duration::from_millis(500);

/// Time after which a state that could not be kept is tried again.
const RETRY_WAIT: Duration = Duration::from_secs(1);

/// Maximum time that the end of a manager waits for the disk.
const END_TIME_MAX: Duration = Duration::from_secs(1);

/// The last state that is to be kept; it replaces the ones before.
#[derive(Debug, Default)]
struct Slot {
    next: Option<(u64, PersistentState)>,
    is_over: bool,
}

/// The progress of the thread.
#[derive(Clone, Debug, Default)]
struct Progress {
    /// The last state that was tried.
    tried: u64,
    /// Why it could not be kept.
    fault: Option<String>,
}

/// An answer that waits until a state is kept.
#[derive(Debug)]
struct Held {
    state: u64,
    since: Instant,
    to: SessionId,
    answer: MessageToClient,
}

/// An answer that may go out, with what its client should know of the disk.
pub(crate) type Released = (SessionId, MessageToClient, Option<String>);

/// Keeps the states of one manager.
#[derive(Debug)]
pub(crate) struct Keeper {
    name: String,
    slot: Arc<(Mutex<Slot>, Condvar)>,
    progress: watch::Receiver<Progress>,
    sent: u64,
    /// The last state of which it is known what became of it.
    tried: u64,
    /// Since when a state waits for the disk.
    behind_since: Option<Instant>,
    held: VecDeque<Held>,
    /// `true` if trouble with the disk was logged, and its end was not yet.
    is_told: bool,
}

/// Returns whether an answer says that something has changed.
pub(crate) fn tells_of_change(answer: &MessageToClient) -> bool {
    matches!(answer, MessageToClient::Reply { reply: Ok(reply), .. } if reply.tells_of_change())
}

fn lock(slot: &Mutex<Slot>) -> MutexGuard<'_, Slot> {
    slot.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Keeper {
    /// Keeps states in this file.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn of(mut state: StateFile) -> io::Result<Self> {
        let name = state.path().display().to_string();
        let mut last: Option<PersistentState> = None;
        Self::start(name, move |memory| {
            // A camera or a head that is lost with the power is where it is again at once; a
            // tuning is somebody's work.
            let is_durable = last.as_ref().is_none_or(|last| last.differs_in_work(memory));
            state.save(memory, is_durable)?;
            last = Some(memory.clone());
            Ok(())
        })
    }

    fn start(
        name: String,
        mut save: impl FnMut(&PersistentState) -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        let slot = Arc::<(Mutex<Slot>, Condvar)>::default();
        let (report, progress) = watch::channel(Progress::default());
        let filled = Arc::clone(&slot);
        let work = move || {
            let mut failed: Option<(u64, PersistentState)> = None;
            while let Some((number, memory)) = next(&filled, failed.take()) {
                let fault = save(&memory).err().map(|error| error.to_string());
                if fault.is_some() {
                    failed = Some((number, memory));
                }
                report.send_replace(Progress { tried: number, fault });
            }
        };
        // It is not joined: a frozen disk may hold it for ever.
        Builder::new().name("state".into()).spawn(work)?;
        let (behind_since, held) = (None, VecDeque::new());
        let (sent, tried, is_told) = (0, 0, false);
        Ok(Self { name, slot, progress, sent, tried, behind_since, held, is_told })
    }

    /// Keeps this state, in the place of one that waits.
    pub fn keep(&mut self, memory: PersistentState) {
        self.sent += 1;
        self.behind_since.get_or_insert_with(Instant::now);
        let (slot, wake) = &*self.slot;
        lock(slot).next = Some((self.sent, memory));
        wake.notify_one();
    }

    /// Takes an answer that must not go out before what was given to be kept is; gives it back if
    /// nothing is on its way to the disk, or the disk is stuck.
    pub fn hold(&mut self, to: SessionId, answer: MessageToClient) -> Option<MessageToClient> {
        let is_behind = self.progress.borrow().tried < self.sent;
        // Answers of a client stay in order.
        let waits = self.held.iter().any(|held| held.to == to);
        // Of a disk that is known to be stuck the answer says so at once.
        let may_come = is_behind && self.warning().is_none();
        if waits || (may_come && tells_of_change(&answer)) {
            self.held.push_back(Held { state: self.sent, since: Instant::now(), to, answer });
            return None;
        }
        Some(answer)
    }

    /// Ready when the thread has come further.
    pub async fn progressed(&mut self) {
        if self.progress.changed().await.is_err() {
            std::future::pending::<()>().await;
        }
    }

    /// Returns the time at which the next answer has waited long enough, if any waits.
    pub fn due(&self) -> Option<Instant> {
        self.held.front().map(|held| held.since + HOLD_TIME_MAX)
    }

    /// The answers that may go out now.
    pub fn release(&mut self) -> Vec<Released> {
        self.release_at(Instant::now())
    }

    fn release_at(&mut self, now: Instant) -> Vec<Released> {
        let Progress { tried, fault } = self.progress.borrow_and_update().clone();
        if fault.is_none() && tried >= self.sent {
            self.behind_since = None;
        } else if fault.is_none() && tried > self.tried {
            // It goes on, though more has come meanwhile.
            self.behind_since = Some(now);
        }
        self.tried = tried;
        let warning = self.warning_at(now);
        self.tell(warning.as_deref());
        let mut released = Vec::new();
        while let Some(held) = self.held.front() {
            let is_tried = held.state <= tried;
            let is_due = now.saturating_duration_since(held.since) >= HOLD_TIME_MAX;
            if !is_tried && !is_due {
                break;
            }
            let warning = if is_tried && fault.is_none() { None } else { warning.clone() };
            let Some(Held { to, answer, .. }) = self.held.pop_front() else { break };
            released.push((to, answer, warning));
        }
        released
    }

    /// Logs trouble with the disk once, and its end.
    fn tell(&mut self, warning: Option<&str>) {
        if warning.is_some() == self.is_told {
            return;
        }
        self.is_told = warning.is_some();
        if let Some(warning) = warning {
            tracing::warn!("{warning}");
        } else {
            tracing::info!(path = self.name, "the state file was written again");
        }
    }

    /// Returns a warning about the disk for clients, if there is one.
    pub fn warning(&self) -> Option<String> {
        self.warning_at(Instant::now())
    }

    fn warning_at(&self, now: Instant) -> Option<String> {
        let name = &self.name;
        let lost = "a change is lost if the manager ends now";
        if let Some(fault) = &self.progress.borrow().fault {
            return Some(format!("cannot write state file {name}: {fault}; {lost}"));
        }
        let since = self.behind_since.map(|since| now.saturating_duration_since(since));
        since.filter(|since| *since >= HOLD_TIME_MAX).map(|since| {
            let seconds = since.as_secs_f64();
            format!("state file {name} has not been written for {seconds:.1} s; {lost}")
        })
    }

    /// Waits until all is kept, as far as the disk takes it in [`END_TIME_MAX`].
    pub async fn settle(&mut self) {
        let sent = self.sent;
        let kept = self.progress.wait_for(|progress| progress.tried >= sent);
        let _ = tokio::time::timeout(END_TIME_MAX, kept).await;
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        let (slot, wake) = &*self.slot;
        lock(slot).is_over = true;
        wake.notify_one();
    }
}

/// Waits for the next state; one that could not be kept is tried again after a while.
fn next(
    (slot, wake): &(Mutex<Slot>, Condvar),
    failed: Option<(u64, PersistentState)>,
) -> Option<(u64, PersistentState)> {
    let mut slot = lock(slot);
    loop {
        if let Some(next) = slot.next.take() {
            return Some(next);
        }
        if slot.is_over {
            return None;
        }
        if failed.is_none() {
            slot = wake.wait(slot).unwrap_or_else(PoisonError::into_inner);
            continue;
        }
        let waited = wake.wait_timeout(slot, RETRY_WAIT);
        let (again, timed_out) = waited.unwrap_or_else(PoisonError::into_inner);
        slot = again;
        if timed_out.timed_out() && slot.next.is_none() {
            return failed;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use polyptych_protocol::ids::{RequestId, Revision};
    use polyptych_protocol::request::{RequestError, Response};
    use polyptych_wall::Wall;
    use polyptych_wall::view::View;

    use super::*;
    use polyptych_wall::camera::Camera;

    /// A disk that does what the test says, one write after the other.
    struct Disk {
        keeper: Keeper,
        verdicts: mpsc::SyncSender<io::Result<()>>,
        written: mpsc::Receiver<PersistentState>,
        runtime: tokio::runtime::Runtime,
    }

    impl Disk {
        fn new() -> Self {
            let (verdicts, verdict) = mpsc::sync_channel(8);
            let (write, written) = mpsc::sync_channel(8);
            let keeper = Keeper::start("state".into(), move |memory| {
                let verdict = verdict.recv().unwrap_or(Ok(()));
                write.send(memory.clone()).expect("the test listens");
                verdict
            });
            let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
            let runtime = runtime.expect("a runtime");
            Self { keeper: keeper.expect("a thread"), verdicts, written, runtime }
        }

        /// Lets the next write end like this, and waits until the keeper knows.
        fn end_write(&mut self, verdict: io::Result<()>) -> PersistentState {
            self.verdicts.send(verdict).expect("the thread listens");
            self.runtime.block_on(self.keeper.progressed());
            self.written.recv().expect("written")
        }

        fn release(&mut self) -> Vec<(SessionId, Option<String>)> {
            let released = self.keeper.release().into_iter();
            released.map(|(to, _, warning)| (to, warning)).collect()
        }
    }

    fn memory(revision: u64) -> PersistentState {
        PersistentState {
            revision: Revision(revision),
            ..PersistentState::of_wall(&Wall::new("w", vec![], vec![]))
        }
    }

    fn done(id: u64) -> MessageToClient {
        MessageToClient::Reply { id: RequestId(id), reply: Ok(Response::Done) }
    }

    const ANN: SessionId = SessionId(1);
    const BOB: SessionId = SessionId(2);

    #[test]
    fn answers_wait_until_what_they_tell_of_is_kept() {
        let mut disk = Disk::new();
        assert_eq!(disk.keeper.hold(ANN, done(0)), Some(done(0)), "nothing is on its way");
        disk.keeper.keep(memory(1));
        assert_eq!(disk.keeper.hold(ANN, done(1)), None);
        let no = MessageToClient::Reply { id: RequestId(2), reply: Err(RequestError::new("no")) };
        assert_eq!(disk.keeper.hold(BOB, no.clone()), Some(no.clone()), "nothing has changed");
        assert_eq!(disk.keeper.hold(ANN, no), None, "answers of a client stay in order");
        assert_eq!(disk.release(), []);
        disk.end_write(Ok(()));
        assert_eq!(disk.release(), [(ANN, None), (ANN, None)]);
        assert_eq!((disk.keeper.warning(), disk.keeper.due()), (None, None));
    }

    #[test]
    fn a_full_disk_is_told_with_the_answer_and_tried_again() {
        let mut disk = Disk::new();
        disk.keeper.keep(memory(1));
        assert_eq!(disk.keeper.hold(ANN, done(1)), None);
        disk.end_write(Err(io::Error::other("no space left")));
        let [(ANN, Some(warning))] = &disk.release()[..] else { panic!("no warning") };
        assert!(warning.contains("state file state: no space left"), "{warning}");
        assert!(disk.keeper.warning().is_some());
        // Without a further change.
        assert_eq!(disk.end_write(Ok(())).revision.0, 1);
        assert_eq!((disk.release(), disk.keeper.warning()), (vec![], None));
    }

    #[test]
    fn a_frozen_disk_holds_answers_for_half_a_second_and_keeps_the_last_state() {
        let mut disk = Disk::new();
        for revision in 1..=100 {
            disk.keeper.keep(memory(revision));
            assert_eq!(disk.keeper.hold(ANN, done(revision)), None);
        }
        let due = disk.keeper.due().expect("they wait");
        assert!(
            disk.keeper
                .release_at(due.checked_sub(Duration::from_millis(1)).expect("late enough"))
                .is_empty()
        );
        let released = disk.keeper.release_at(due + HOLD_TIME_MAX);
        assert_eq!(released.len(), 100);
        assert!(released.iter().all(|(to, _, warning)| *to == ANN && warning.is_some()));
        disk.keeper.behind_since =
            disk.keeper.behind_since.and_then(|at| at.checked_sub(HOLD_TIME_MAX));
        assert_eq!(disk.keeper.hold(BOB, done(0)), Some(done(0)), "it is known to be stuck");
        // The first was begun; those between are nobody's wish any more.
        let first = disk.end_write(Ok(()));
        let last = if first.revision.0 == 100 { first } else { disk.end_write(Ok(())) };
        assert_eq!(last.revision.0, 100);
        disk.release();
        assert_eq!(disk.keeper.warning(), None);
    }

    #[test]
    fn a_camera_is_not_synced_and_a_tuning_is() {
        let before = memory(1);
        let mut moved = before.clone();
        moved.presentation.camera.position.x += 1.0;
        moved.presentation.views = vec![View::of_wall(Camera::IDENTITY)];
        assert!(!before.differs_in_work(&moved));
        assert!(before.differs_in_work(&memory(2)));
    }
}
