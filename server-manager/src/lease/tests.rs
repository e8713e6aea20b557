//! Managers with clocks of different rates that stop at any step, and whose machines sleep: never
//! do two lead at once.

use proptest::prelude::*;

use super::*;

const LEASE: Duration = Duration::from_secs(1);

/// The true time, which no manager knows.
type Micros = u64;

/// A manager whose clock began at some time and has a rate of its own.
struct Manager {
    contender: Contender,
    clock_at_zero: Micros,
    /// Its clock's microseconds for a thousand true ones.
    rate: u64,
    /// The time that its machine has slept, and that at which it fell asleep if it sleeps.
    slept: Micros,
    sleeps_since: Option<Micros>,
    /// The steps of a locked section that it has begun.
    section: Section,
    /// The time until which it believes to lead, by its own clocks, and the term.
    leads: Option<(ClockReading, u64)>,
}

/// The progress in a section under the lock: any time may pass between two of these.
enum Section {
    Outside,
    Read(Option<LeaseRecord>),
    Stepped(Contender, Option<LeaseRecord>),
}

struct World {
    now: Micros,
    record: Option<LeaseRecord>,
    locked_by: Option<usize>,
    managers: Vec<Manager>,
    terms_led: Vec<(u64, usize)>,
}

impl World {
    fn new(clocks: &[(u64, u64)]) -> Self {
        let manager = |(index, (clock_at_zero, rate)): (usize, &(u64, u64))| Manager {
            contender: Contender::new(format!("manager {index}"), LEASE),
            clock_at_zero: *clock_at_zero,
            rate: *rate,
            slept: 0,
            sleeps_since: None,
            section: Section::Outside,
            leads: None,
        };
        let managers = clocks.iter().enumerate().map(manager).collect();
        Self { now: 0, record: None, locked_by: None, managers, terms_led: Vec::new() }
    }

    /// Returns what a manager reads, who does so as its machine wakes up if it sleeps.
    fn clocks(&self, index: usize) -> ClockReading {
        let manager = &self.managers[index];
        let sleeps = manager.sleeps_since.map_or(0, |since| self.now - since);
        let clock =
            |time| Duration::from_micros(manager.clock_at_zero + time * manager.rate / 1000);
        let awake = clock(self.now - manager.slept - sleeps);
        ClockReading { awake, of_day: clock(self.now) }
    }

    fn fall_asleep(&mut self, index: usize) {
        self.managers[index].sleeps_since.get_or_insert(self.now);
    }

    fn wake(&mut self, index: usize) {
        let manager = &mut self.managers[index];
        manager.slept += manager.sleeps_since.take().map_or(0, |since| self.now - since);
    }

    /// Lets one manager do its next step; its machine is awake then.
    fn advance(&mut self, index: usize) {
        self.wake(index);
        let clocks = self.clocks(index);
        let manager = &mut self.managers[index];
        match std::mem::replace(&mut manager.section, Section::Outside) {
            Section::Outside if self.locked_by.is_some() => {}
            Section::Outside => {
                self.locked_by = Some(index);
                manager.section = Section::Read(self.record.clone());
            }
            Section::Read(found) => {
                let mut contender = manager.contender.clone();
                let record = contender.step(clocks, found.as_ref());
                manager.section = Section::Stepped(contender, record);
            }
            Section::Stepped(contender, record) => {
                self.locked_by = None;
                if record.is_some() {
                    self.record = record;
                }
                manager.leads = contender.valid_until().zip(contender.term());
                manager.contender = contender;
            }
        }
    }

    /// A killed process forgets everything, and the system takes its lock.
    fn kill(&mut self, index: usize) {
        self.locked_by.take_if(|by| *by == index);
        let manager = &mut self.managers[index];
        manager.contender = Contender::new(format!("manager {index}"), LEASE);
        (manager.section, manager.leads) = (Section::Outside, None);
    }

    /// Returns the managers that believe to lead now.
    fn leaders(&self) -> Vec<(u64, usize)> {
        let leads = |index: usize| {
            let (until, term) = self.managers[index].leads?;
            self.clocks(index).is_before(until).then_some((term, index))
        };
        (0..self.managers.len()).filter_map(leads).collect()
    }

    fn check(&mut self) -> Result<(), TestCaseError> {
        let leaders = self.leaders();
        prop_assert!(leaders.len() <= 1, "at {} µs {leaders:?} lead", self.now);
        if let Some(leader) = leaders.first() {
            let last = self.terms_led.last();
            prop_assert!(last.is_none_or(|last| last == leader || last.0 < leader.0));
            if last != Some(leader) {
                self.terms_led.push(*leader);
            }
        }
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn two_managers_never_lead_at_once(
        clocks in prop::collection::vec((0..10_000_000_u64, 976..1024_u64), 2..4),
        runs in prop::collection::vec((0..4_usize, 0..20_u32, 1..100_u32, 1..30_000_u64), 10..60),
    ) {
        let mut world = World::new(&clocks);
        for (index, what, steps, tick) in runs {
            let index = index % clocks.len();
            match what {
                0 => world.kill(index),
                1..4 => world.fall_asleep((index + 1) % clocks.len()),
                _ => {}
            }
            // The others are stopped meanwhile, be it within a step, or their machines sleep.
            for _ in 0..steps {
                world.advance(index);
                world.now += tick;
                world.check()?;
            }
        }
    }
}

/// Steps a manager through a whole section under the lock.
fn whole_step(world: &mut World, index: usize) {
    for _ in 0..3 {
        world.advance(index);
    }
}

#[test]
fn a_standby_leads_once_a_lease_time_has_passed_without_renewal() {
    let mut world = World::new(&[(0, 1000), (5_000_000, 1000)]);
    whole_step(&mut world, 0);
    for _ in 0..10 {
        world.now += 300_000;
        (0..2).for_each(|index| whole_step(&mut world, index));
        assert_eq!(world.leaders(), [(1, 0)], "it renews");
    }
    world.now += 999_999;
    whole_step(&mut world, 1);
    assert_eq!(world.leaders(), [], "the first fences itself before");
    world.now += 1;
    whole_step(&mut world, 1);
    assert_eq!(world.leaders(), [(2, 1)]);
    whole_step(&mut world, 0);
    assert_eq!(world.leaders(), [(2, 1)], "the first finds another term");
}

/// Both clocks of a machine that never slept, and whose time of day began with the manager.
fn at(time: Duration) -> ClockReading {
    ClockReading { awake: time, of_day: time }
}

#[test]
fn a_released_lease_is_taken_at_once_and_a_removed_one_is_not_renewed() {
    let mut first = Contender::new("first".into(), LEASE);
    let mut second = Contender::new("second".into(), LEASE);
    let taken = first.step(at(Duration::ZERO), None).expect("nobody has it");
    assert_eq!(second.step(at(Duration::ZERO), Some(&taken)), None);
    let released = first.release(Some(&taken)).expect("it was the first's");
    assert_eq!(first.valid_until(), None);
    let next = second.step(at(Duration::ZERO), Some(&released)).expect("it is free");
    assert_eq!((next.term, &*next.holder), (2, "second"));
    assert_eq!(first.release(Some(&next)), None);
    assert_eq!(
        second.step(at(Duration::ZERO), None),
        None,
        "the term before is not known any more"
    );
    assert_eq!(second.term(), None);
}

#[test]
fn a_record_that_is_gone_is_not_taken_for_a_free_lease() {
    let mut first = Contender::new("first".into(), LEASE);
    let mut second = Contender::new("second".into(), LEASE);
    let taken = first.step(at(Duration::ZERO), None).expect("nobody has it");
    assert_eq!(second.step(at(Duration::ZERO), Some(&taken)), None);
    for time in 0..10 {
        assert_eq!(second.step(at(time * LEASE), None), None, "its storage may be gone");
    }
    let next = second.step(at(10 * LEASE), Some(&taken)).expect("the storage is back");
    assert_eq!(next.term, 2);
}

#[test]
fn a_record_says_for_good_that_the_state_was_written() {
    let mut first = Contender::new("first".into(), LEASE);
    let mut second = Contender::new("second".into(), LEASE);
    let taken = first.step(at(Duration::ZERO), None).expect("nobody has it");
    assert!(!taken.has_state);
    let written = LeaseRecord { has_state: true, ..taken };
    let renewed = first.step(at(LEASE / 3), Some(&written)).expect("renewed");
    let released = first.release(Some(&renewed)).expect("it was the first's");
    let next = second.step(at(LEASE), Some(&released)).expect("it is free");
    assert!(renewed.has_state && released.has_state && next.has_state);
}

#[test]
fn a_standby_waits_by_the_lease_time_of_the_holder() {
    let mut first = Contender::new("first".into(), 3 * LEASE);
    let mut second = Contender::new("second".into(), LEASE / 2);
    let taken = first.step(at(Duration::ZERO), None).expect("nobody has it");
    assert_eq!(second.step(at(Duration::ZERO), Some(&taken)), None);
    assert_eq!(second.step(at(LEASE * 2999 / 1000), Some(&taken)), None);
    assert!(second.step(at(3 * LEASE), Some(&taken)).is_some());
}

#[test]
fn a_holder_whose_machine_sleeps_holds_nothing_when_it_wakes_up() {
    let mut world = World::new(&[(0, 1000), (0, 1000)]);
    (0..2).for_each(|index| whole_step(&mut world, index));
    world.fall_asleep(0);
    world.now += 1_000_000;
    whole_step(&mut world, 1);
    assert_eq!(world.leaders(), [(2, 1)], "not as the first wakes up either");
    let clocks = world.clocks(0);
    assert_eq!([clocks.awake, clocks.of_day], [Duration::ZERO, LEASE]);
    whole_step(&mut world, 0);
    assert_eq!(world.leaders(), [(2, 1)], "the first finds another term");
}

#[test]
fn a_time_of_day_that_is_set_never_makes_a_lease_longer_or_a_candidate_earlier() {
    let mut first = Contender::new("first".into(), LEASE);
    let taken = first.step(at(100 * LEASE), None).expect("nobody has it");
    let until = first.valid_until().expect("it holds the lease");
    let end = 100 * LEASE + LEASE * 2 / 3;
    let back = ClockReading { awake: end, of_day: Duration::ZERO };
    assert!(!back.is_before(until), "set back");
    let forward = ClockReading { awake: 100 * LEASE, of_day: end };
    assert!(!forward.is_before(until), "set forward, it looks at the record first");
    let renewed = first.step(forward, Some(&taken)).expect("it is still its own");
    let until = first.valid_until().expect("it holds the lease");
    assert!(forward.is_before(until));

    let mut second = Contender::new("second".into(), LEASE);
    assert_eq!(second.step(at(LEASE), Some(&renewed)), None);
    let forward = ClockReading { awake: LEASE, of_day: 100 * LEASE };
    assert_eq!(second.step(forward, Some(&renewed)), None);
    assert!(second.step(at(2 * LEASE), Some(&renewed)).is_some());
}
