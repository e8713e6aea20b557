//! Leads that are lost, kept while storage stalls, and given up.

use super::*;

const LEASE: Duration = Duration::from_millis(200);

/// What a manager finds that waits for the lease of this folder.
fn wait_in(folder: &tempfile::TempDir, name: &str) -> Waited {
    let file = LeaseFile::beside(&folder.path().join("wall.state"));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
    let waiting = Leadership::wait(file, name.into(), LEASE, |_| {});
    runtime.expect("a runtime").block_on(waiting).expect("a lease")
}

fn lead(folder: &tempfile::TempDir, name: &str) -> Leadership {
    match wait_in(folder, name) {
        Waited::Leads(leadership) => leadership,
        Waited::Stopped => panic!("stopped"),
    }
}

#[test]
fn a_leader_that_was_replaced_commands_and_writes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = lead(&folder, "first");
    assert!(first.is_held() && first.fenced(|| Ok(1)).is_ok_and(|done| done == 1));
    // As a stopped process: it renews nothing, and does not know that it has lost the lease.
    first.shared.is_released.store(true, Ordering::Relaxed);
    let second = lead(&folder, "second");
    assert_eq!((first.term(), second.term()), (Term(1), Term(2)));
    first.shared.is_released.store(false, Ordering::Relaxed);
    let refused = first.fenced(|| Ok(())).expect_err("another one leads");
    assert!(refused.to_string().contains("second leads the wall now"), "{refused}");
    assert!(!first.is_held() && second.is_held());
    assert_eq!(second.lost_reason(), None);
}

#[cfg(unix)]
#[test]
fn a_renewal_writes_over_the_record_that_is_there() {
    use std::os::unix::fs::MetadataExt;
    let folder = tempfile::tempdir().expect("a folder");
    let leader = lead(&folder, "first");
    let path = folder.path().join("wall.state.lease");
    let facts = || std::fs::metadata(&path).map(|facts| (facts.ino(), facts.len()));
    let first = facts().expect("a record");
    leader.shared.renew().expect("renewed");
    assert_eq!(facts().expect("a record"), first, "a full disk has no room for another");
}

#[test]
fn a_lease_that_is_locked_by_its_own_leader_is_not_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let leader = lead(&folder, "first");
    let written = leader.fenced(|| {
        leader.shared.set_valid_until(ClockReading::default());
        assert!(!leader.is_held(), "it cannot be renewed now");
        Ok(leader.lost_reason().is_none())
    });
    assert!(written.expect("it leads"));
    assert!(leader.is_held());
}

#[test]
fn a_lease_is_not_lost_while_its_leader_writes_that_there_is_a_state() {
    let folder = tempfile::tempdir().expect("a folder");
    let leader = lead(&folder, "first");
    let record = folder.path().join("wall.state.lease");
    let (worked, has_worked) = std::sync::mpsc::sync_channel(1);
    std::thread::scope(|scope| {
        let (leader, record) = (&leader, &record);
        let written = scope.spawn(move || {
            leader.fenced(|| {
                // A pipe takes no record before somebody reads, as slow storage does.
                std::fs::remove_file(record)?;
                let made = std::process::Command::new("mkfifo").arg(record).status()?;
                assert!(made.success());
                worked.send(()).map_err(io::Error::other)
            })
        });
        has_worked.recv().expect("it works");
        leader.shared.set_valid_until(ClockReading::default());
        let is_held = leader.is_held();
        let reason = leader.lost_reason().map(str::to_owned);
        std::fs::read(record).expect("the record");
        written.join().expect("no panic").expect("written");
        assert_eq!((is_held, reason), (false, None), "it cannot be renewed now");
    });
}

#[test]
fn a_lease_is_not_lost_while_its_leader_waits_to_write_its_state() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = LeaseFile::beside(&folder.path().join("wall.state"));
    let mut contender = Contender::new("first".into(), LEASE);
    let taken = file.locked(|found| (contender.step(ClockReading::default(), found), ()));
    taken.expect("taken");
    // This lease has run out, as no thread renews it.
    let leader =
        Leadership::start(file.clone(), "first".into(), Term(1), contender, Instant::now());
    let seen = file.locked(|_| {
        // As storage does that stalls before the record is read, while `fenced` waits for it.
        leader.shared.fence_steps.fetch_add(1, Ordering::SeqCst);
        let is_held = leader.is_held();
        leader.shared.fence_steps.fetch_add(1, Ordering::SeqCst);
        (None, (is_held, leader.lost_reason().map(str::to_owned)))
    });
    assert_eq!(seen.expect("locked"), (false, None), "it cannot be renewed now");
    assert!(leader.is_held());
}

#[test]
fn a_lease_that_ran_out_is_renewed_before_the_next_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = lead(&folder, "first");
    first.shared.set_valid_until(ClockReading::default());
    assert!(first.is_held(), "nobody has taken it");
    std::fs::remove_file(folder.path().join("wall.state.lease")).expect("removed");
    first.shared.set_valid_until(ClockReading::default());
    assert!(!first.is_held());
    assert_eq!(first.lost_reason(), Some("the lease file was removed"));
}

#[test]
fn a_leader_whose_machine_slept_looks_at_the_lease_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = lead(&folder, "first");
    // By the clock that stood still it holds the lease for long, by the time of day no more.
    let slept = ClockReading { awake: Duration::from_hours(1), of_day: Duration::ZERO };
    first.shared.set_valid_until(slept);
    assert!(first.is_held(), "nobody has taken it");
    first.shared.is_released.store(true, Ordering::Relaxed);
    let second = lead(&folder, "second");
    first.shared.is_released.store(false, Ordering::Relaxed);
    first.shared.set_valid_until(slept);
    assert!(!first.is_held() && second.is_held());
    let reason = first.lost_reason().expect("it has looked");
    assert!(reason.contains("second leads the wall now"), "{reason}");
}

#[test]
fn a_stopped_wall_ends_managers_that_wait_but_not_those_that_come() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = lead(&folder, "first");
    std::thread::scope(|scope| {
        let file = LeaseFile::beside(&folder.path().join("wall.state"));
        let (looked, has_looked) = std::sync::mpsc::sync_channel(1);
        let waiting = scope.spawn(move || {
            let on_look = |_: Option<&LeaseRecord>| _ = looked.try_send(());
            let waiting = Leadership::wait(file, "second".into(), LEASE, on_look);
            let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
            runtime.expect("a runtime").block_on(waiting).expect("a lease")
        });
        has_looked.recv().expect("it looks");
        // The next look is after the first has ended.
        has_looked.recv().expect("it looks again");
        first.release(Release::Stopped);
        assert!(matches!(waiting.join().expect("no panic"), Waited::Stopped));
    });
    assert!(!first.is_held());
    assert_eq!(lead(&folder, "third").term(), Term(2));
}
