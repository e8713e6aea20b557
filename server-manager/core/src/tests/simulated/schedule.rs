//! One schedule: a wall of a random size, random requests and faults, and then calm, in which all
//! must come back.

use glam::{DAffine3, DVec3};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::{Pacing, Request};
use polyptych_protocol::transaction::Transaction;
use polyptych_scene::{NewNode, NodeId};
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::tour::{Tour, TourStop};
use polyptych_wall::view::View;
use polyptych_wall::{ChannelId, DeadlinePolicy, calibration_change};

use super::super::{Micros, wall};
use super::coverage::Coverage;
use super::dice::Rng;
use super::server::{RETRY_LONGEST, Server};
use super::world::{Check, Simulation};

/// Frames a second of the calm at the end.
const CALM_RATE: f64 = 50.0;

/// Frames after which the worst of channels is waited for again: `REJOIN_FRAMES_MAX` of the core,
/// and a few for those that stumble once more.
const CALM_FRAMES: u64 = 700;

/// The frequency of faults and requests in a schedule.
#[derive(Clone, Copy, Debug)]
struct FaultRates {
    /// Faults in a thousand steps.
    faults: u64,
    requests: u64,
    /// Longest wait between two steps.
    pause_us: u64,
}

const TEMPERS: [FaultRates; 4] = [
    FaultRates { faults: 10, requests: 300, pause_us: 8_000 },
    FaultRates { faults: 60, requests: 200, pause_us: 12_000 },
    FaultRates { faults: 150, requests: 150, pause_us: 20_000 },
    FaultRates { faults: 30, requests: 700, pause_us: 4_000 },
];

/// Runs the schedule of a seed; says what broke, and when.
pub fn run(seed: u64, is_told: bool) -> Result<Coverage, String> {
    let mut dice = Rng::new(seed, 1);
    let mut world = build(seed, &mut dice);
    world.is_told = is_told;
    let temper = dice.pick(&TEMPERS);
    let ran = play(&mut world, &mut dice, temper).and_then(|()| calm(&mut world));
    if let Err(fault) = ran {
        let at = world.now as f64 / 1000.0;
        return Err(format!("after {at:.3} ms: {fault}"));
    }
    let mut coverage = world.coverage;
    coverage.schedules = 1;
    coverage.shown = world.watch.shows;
    coverage.frames = world.watch.frames_sent;
    coverage.virtual_us = world.now;
    coverage.tally("answers", world.watch.promises.answers);
    coverage.tally("answers that refuse", world.watch.promises.refusals);
    coverage.tally("feedback to subscribers", world.watch.feedback_sent);
    coverage.tally("wrong picture shown before it was reported", world.watch.wrong_shows);
    Ok(coverage)
}

fn build(seed: u64, dice: &mut Rng) -> Simulation {
    // Small walls mostly: they fail as large ones do, and cost less.
    let count = dice.pick(&[1, 1, 2, 2, 2, 3, 3, 4, 6]);
    // Servers of one kind: one that is several times slower than the others is late by the rule.
    let frame_us = dice.between(6_000, 25_000);
    let mut next = 0;
    let mut servers = Vec::new();
    for index in 0..count {
        let most = if count == 1 { 6 } else { 3 };
        let channels = dice.pick(&[1, 1, dice.clone().between(1, most)]);
        let ids = (next..next + channels as u16).map(ChannelId).collect();
        next += channels as u16;
        let draw_us = dice.between(frame_us * 6 / 10, frame_us * 12 / 10) / channels;
        let load_us = dice.pick(&[2_000, 20_000, 200_000]);
        servers.push(Server::new(index, ids, draw_us, load_us));
    }
    let mut wall = wall(u32::from(next));
    wall.heartbeat_ms = dice.pick(&[200, 500, 2_000]);
    let max_ms = dice.pick(&[300, 1_000, 2_000]);
    wall.deadline = DeadlinePolicy { factor: 4.0, min_ms: dice.pick(&[30, 50]), max_ms };
    // By the seed, so that older seeds of the others mean what they did.
    wall.sync.pipeline_depth = u32::from(seed % 8 >= 4);
    wall.sync.swap_lead_ms = if seed % 3 == 2 { 5 } else { 0 };
    wall.budget.gpu_mib = (seed % 5 == 1).then_some(64);
    let clients = dice.below(4) as usize;
    Simulation::new(seed, wall, servers, clients)
}

fn play(world: &mut Simulation, dice: &mut Rng, temper: FaultRates) -> Check {
    world.start_manager()?;
    for index in 0..world.servers.len() {
        let late = dice.pick(&[0, 0, 0, 400_000]);
        let due = world.now + dice.between(0, 2_000 + late);
        world.at(due, super::world::SimEvent::ServerStarts(index));
    }
    world.run_until(world.now + dice.pick(&[1_000, 30_000, 300_000]))?;
    for index in 0..world.clients.len() {
        world.connect_client(index);
    }
    if dice.is_hit(700) && !world.clients.is_empty() {
        let pace = a_pace(dice);
        world.ask(0, Request::Run(pace));
    }
    for _ in 0..dice.between(100, 600) {
        let pause_us = match dice.below(100) {
            0 => temper.pause_us * 20,
            1..30 => 0,
            _ => dice.below(temper.pause_us),
        };
        world.run_until(world.now + pause_us)?;
        if dice.is_hit(temper.faults) {
            fault(world, dice);
        }
        if dice.is_hit(temper.requests) && !world.clients.is_empty() {
            request(world, dice)?;
        }
    }
    Ok(())
}

fn spot(dice: &mut Rng) -> Camera {
    Camera { scale: 1.0 + dice.below(100) as f64 / 7.0, ..Camera::IDENTITY }
}

fn a_tour(dice: &mut Rng) -> Request {
    let stop = |travel_s: u64, camera| TourStop::new(camera, travel_s as f64 * 0.1);
    let stops = (0..dice.below(4)).map(|index| stop(index, spot(dice))).collect();
    let is_loop = dice.is_hit(300);
    match dice.below(8) {
        0 => Request::StopTour,
        1 => Request::StoreView { name: "spot".into(), camera: None },
        2 => Request::RemoveView { name: "spot".into() },
        3 => Request::DescribeTour,
        _ => Request::PlayTour(Tour { stops, is_loop }),
    }
}

fn a_pace(dice: &mut Rng) -> Pacing {
    match dice.below(6) {
        0..2 => Pacing::Free,
        2 => Pacing::Rate(0.5),
        _ => Pacing::Rate(dice.pick(&[10.0, 30.0, 60.0, 240.0])),
    }
}

/// Edits of which some cannot be, now and then on a state that was seen before.
fn a_transaction(world: &Simulation, dice: &mut Rng) -> Transaction {
    let node = |dice: &mut Rng| NodeId(dice.below(9));
    let mut transaction = Transaction { is_temporary: dice.is_hit(200), ..Transaction::default() };
    if dice.is_hit(300) {
        let shown = world.manager.cluster.as_ref().map(|cluster| cluster.shown.revision.0);
        transaction.base = Some(Revision(shown.unwrap_or(0).saturating_sub(dice.below(3))));
    }
    for _ in 0..dice.between(1, 4) {
        match dice.below(10) {
            0 => transaction.remove(node(dice)),
            1..3 => {
                let parent = dice.is_hit(500).then(|| node(dice));
                transaction.create(NewNode { parent, ..NewNode::default() });
            }
            3 => {
                let parent = dice.is_hit(700).then(|| node(dice));
                transaction.set_parent(node(dice), parent);
            }
            4 => transaction.set_visible(node(dice), dice.is_hit(500)),
            _ => {
                let at = DVec3::X * dice.below(50) as f64;
                transaction.set_transform(node(dice), DAffine3::from_translation(at));
            }
        }
    }
    transaction
}

/// Asks for many transactions now and then, and gives one more.
fn edits(world: &mut Simulation, client: usize, dice: &mut Rng) -> Request {
    for _ in 1..dice.pick(&[1, 1, 2, 40, 300]) {
        let transaction = a_transaction(world, dice);
        world.ask(client, Request::Edit(transaction));
    }
    Request::Edit(a_transaction(world, dice))
}

fn bounds(dice: &mut Rng) -> QualityBounds {
    QualityBounds {
        error_px: dice.below(5) as f64 * 0.25,
        rate_fps: dice.is_hit(500).then(|| 1.0 + dice.below(60) as f64),
    }
}

fn request(world: &mut Simulation, dice: &mut Rng) -> Check {
    let client = dice.below(world.clients.len() as u64) as usize;
    if world.clients[client].session.is_none() {
        if dice.is_hit(300) {
            world.connect_client(client);
        }
        return Ok(());
    }
    let request = match dice.below(100) {
        0..25 => {
            let camera = dice.is_hit(500).then(|| spot(dice));
            let time_s = dice.is_hit(300).then_some(1.5);
            let request = Request::RenderFrame { camera, time_s };
            let burst = if dice.is_hit(40) { dice.between(2, 90) } else { 1 };
            for _ in 1..burst {
                world.ask(client, request.clone());
            }
            request
        }
        25..35 => Request::SetCamera(spot(dice)),
        35 => Request::SetHead(DVec3::new(dice.below(9) as f64 * 0.1, 0.0, 0.5).into()),
        36 => Request::SetHead(
            HeadPose::facing_forward(DVec3::Z * dice.below(9) as f64 * 0.1, 0.06).into(),
        ),
        37 => Request::SetViews(vec![View::of_wall(spot(dice)); dice.below(3) as usize]),
        38 => Request::SetExposure(dice.below(5) as f32),
        39..41 => Request::SetBounds(bounds(dice)),
        41..50 => {
            let request = Request::OpenScene { path: "town.glb".into(), scene: None };
            let burst = if dice.is_hit(30) { dice.between(2, 80) } else { 1 };
            for _ in 1..burst {
                world.ask(client, request.clone());
            }
            request
        }
        50..56 => {
            let burst = if dice.is_hit(30) { dice.between(2, 80) } else { 1 };
            for _ in 1..burst {
                world.ask(client, Request::CloseScene);
            }
            Request::CloseScene
        }
        56..64 => Request::Run(a_pace(dice)),
        64..68 => Request::Pause,
        68..74 => Request::Capture { time_s: dice.is_hit(300).then_some(2.5) },
        74..80 => Request::Status,
        80..86 => Request::Statistics { reset: dice.is_hit(300) },
        86 => Request::DescribeWall,
        87 if dice.is_hit(500) => a_tour(dice),
        87 => edits(world, client, dice),
        88..94 => Request::Subscribe(dice.is_hit(700)),
        94 => Request::SetExposure(f32::NAN),
        95..97 => {
            // Now and then beyond what can be, and in bursts as a slider's.
            let channel = format!("c{}", dice.below(world.wall.channels.len() as u64));
            let gain =
                calibration_change::CalibrationChange::Gain(DVec3::splat(dice.below(2_000) as f64));
            let request = Request::Tune { channel, changes: vec![gain] };
            for _ in 1..dice.pick(&[1, 1, 1, 4, 20]) {
                world.ask(client, request.clone());
            }
            request
        }
        97 if dice.is_hit(200) => Request::Stop,
        _ => {
            world.coverage.count("client disconnected");
            return world.disconnect_client(client);
        }
    };
    world.ask(client, request);
    Ok(())
}

#[expect(clippy::too_many_lines, reason = "one table of faults with their weights")]
fn fault(world: &mut Simulation, dice: &mut Rng) {
    let index = dice.below(world.servers.len() as u64) as usize;
    let heartbeat = Micros::from(world.wall.heartbeat_ms) * 1000;
    let now = world.now;
    let short = now + dice.between(1_000, 400_000);
    let what = match dice.below(100) {
        0..10 => {
            break_connection(world, dice, index);
            return;
        }
        10..20 => {
            world.kill_server(index, dice.is_hit(600));
            let back = now + dice.between(1_000, 2 * heartbeat);
            world.at(back, super::world::SimEvent::ServerStarts(index));
            "server killed"
        }
        20..32 => {
            let longest = dice.pick(&[50_000, heartbeat / 2, 3 * heartbeat]);
            let until = &mut world.servers[index].trouble.stopped_until;
            *until = (now + dice.between(1_000, longest)).max(*until);
            "server stopped"
        }
        32..44 => {
            let trouble = &mut world.servers[index].trouble;
            (trouble.slow_until, trouble.slow_by) = (short, dice.between(2, 40));
            "server slow"
        }
        44..54 => {
            let longest = dice.pick(&[100_000, 2 * heartbeat]);
            let until = &mut world.servers[index].trouble.hangs_until;
            *until = (now + dice.between(1_000, longest)).max(*until);
            "render thread hangs"
        }
        54..60 => {
            world.servers[index].trouble.draws_fail_until = short;
            "draws fail"
        }
        60..67 => {
            world.servers[index].trouble.loads_fail_until = short;
            "loads fail"
        }
        67..73 => {
            let trouble = &mut world.servers[index].trouble;
            let by = dice.pick(&[50_000, 1_000_000, 4_000_000]);
            (trouble.loads_slow_until, trouble.loads_slow_by) = (short, by);
            "loads slow"
        }
        73..79 => {
            world.servers[index].trouble.corrupts_next = true;
            "next state corrupt"
        }
        79..86 => {
            if let Some(state) = world.servers[index].states.back_mut() {
                state.digest.0 ^= 2;
            }
            "held state corrupt"
        }
        86..92 => {
            let extra = dice.pick(&[2_000, 30_000, heartbeat]);
            world.weather.spikes[index] = (short, extra);
            "delays"
        }
        92..96 => {
            let longest = dice.pick(&[5_000, 100_000, 2 * heartbeat]);
            let until = &mut world.manager.stopped_until;
            *until = (now + dice.between(100, longest)).max(*until);
            "manager stopped"
        }
        96..98 => {
            world.manager.dies_after = Some(dice.below(12) as u32);
            "manager is to die"
        }
        _ => {
            world.kill_manager("killed");
            "manager killed"
        }
    };
    world.tell(|| format!("{what}: {index}"));
    world.coverage.count(what);
}

fn break_connection(world: &mut Simulation, dice: &mut Rng, index: usize) {
    let Some(link) = world.servers[index].link else { return };
    let what = match dice.below(4) {
        0 => {
            world.cut(link);
            "connection cut"
        }
        1 => {
            world.silence(link, true, true);
            "connection half open"
        }
        2 => {
            world.silence(link, true, false);
            "connection half open to the server"
        }
        // It comes back before the manager finds the old one dead.
        _ => {
            world.silence(link, false, true);
            world.disconnect(index, "its network changed");
            "taken over by the same process"
        }
    };
    world.tell(|| format!("{what}: {index}"));
    world.coverage.count(what);
}

/// All faults end; the wall must be whole again, at rest and in motion.
fn calm(world: &mut Simulation) -> Check {
    world.tell(|| "from here on there are no faults".to_owned());
    world.manager.dies_after = None;
    for index in 0..world.servers.len() {
        world.servers[index].trouble.corrupts_next = false;
        world.start_server(index);
    }
    let heartbeat = Micros::from(world.wall.heartbeat_ms) * 1000;
    // What is under way may last as long as the longest trouble, a wait before a retry, a load;
    // then every channel catches up, frame by frame.
    let longest = Micros::from(world.wall.deadline.max_ms) * 1000;
    let rejoining = (CALM_FRAMES as f64 / CALM_RATE * 1e6) as Micros;
    let end = world.now + 6 * heartbeat + 2 * RETRY_LONGEST + 12 * longest + 20_000_000 + rejoining;
    world.clients.push(super::world::Client::default());
    let client = world.clients.len() - 1;
    loop {
        // Another manager has another session, and what other clients said may come later.
        world.connect_client(client);
        let pace = world.manager.cluster.as_ref().and_then(|cluster| cluster.pacer.pace());
        if pace != Some(Pacing::Rate(CALM_RATE)) {
            world.ask(client, Request::Run(Pacing::Rate(CALM_RATE)));
        }
        world.run_until(world.now + 40_000)?;
        if is_whole(world) && is_at_rest_alike(world, client)? {
            world.coverage.count("wall whole again");
            return Ok(());
        }
        if world.now > end {
            return Err(format!("the wall does not come back: {}", missing(world)));
        }
    }
}

fn is_whole(world: &Simulation) -> bool {
    let Some(cluster) = &world.manager.cluster else { return false };
    cluster.registry.channels().all(|(_, c)| c.state == ChannelState::Live)
        && world.watch.promises.open_requests() == 0
        && cluster.changes.waiting() == 0
}

fn missing(world: &Simulation) -> String {
    let states = world.manager.cluster.as_ref().map(|cluster| {
        let line = |(id, c): (ChannelId, &super::super::registry::ChannelEntry)| {
            format!("{id} {:?} {:?}", c.state, c.reason)
        };
        cluster.registry.channels().map(line).collect::<Vec<_>>().join("; ")
    });
    let open = world.watch.promises.an_open_request();
    format!("{states:?}; open requests: {open:?}; pictures: {:?}", world.watch.shown)
}

/// Returns whether all channels show the last frame, of the same state, once no more come.
fn is_at_rest_alike(world: &mut Simulation, client: usize) -> Result<bool, String> {
    // A wall whose camera moves is not at rest.
    let is_navigated = std::mem::take(&mut world.is_navigated);
    world.ask(client, Request::Pause);
    world.run_until(world.now + 400_000)?;
    world.is_navigated = is_navigated;
    world.ask(client, Request::Status);
    world.run_until(world.now + 1_000)?;
    let is_alike = is_whole(world)
        && world.manager.cluster.as_ref().is_some_and(|cluster| {
            let last = cluster.swapped;
            cluster.registry.channels().all(|(id, _)| {
                world.watch.shown.get(&id).is_some_and(|picture| {
                    (picture.epoch, picture.frame) == (cluster.epoch, last)
                        && picture.revision == cluster.shown.revision
                        && picture.digest == cluster.shown_digest
                })
            })
        });
    if !is_alike {
        world.coverage.count("not alike at rest at first");
        world.ask(client, Request::Run(Pacing::Rate(CALM_RATE)));
    }
    Ok(is_alike)
}
