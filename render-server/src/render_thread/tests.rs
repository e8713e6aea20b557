//! The content of displays, from commands to pixels: without windows or sockets.

mod faults;
mod metering;
mod preparation;
mod resolution;

use std::num::NonZeroU32;
use std::sync::mpsc::sync_channel;
use std::time::Instant;

use crossbeam_channel::{Sender, bounded};
use glam::{DVec2, DVec3, UVec2, Vec3};
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_protocol::server_message::{FramePresented, FrameRendered, ServerMessage};
use polyptych_protocol::state_log::{Operation, Replica};
use polyptych_renderer::OutputTexture;
use polyptych_scene::Scene;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::surface::{Cylinder, Plane};
use polyptych_wall::{Channel, Orientation, Screen, Surface, Wall};

use super::*;
use crate::connection_status::ManagerState;
use crate::correction;
use crate::mismatch::NOTE_TIME;
use crate::monitor::Monitor;

const SIZE: [u32; 2] = [160, 90];
const EPOCH: Epoch = Epoch(3);

/// A render thread with one display, whose commands the test gives.
struct RenderThreadFixture {
    thread: RenderThread,
    reports: mpsc::Receiver<RenderEvent>,
    frame: u64,
    /// The frames that it is told to draw are metered.
    is_metered: bool,
    // A thread whose queues have no sender ends.
    _senders: (Sender<RenderTask>, Sender<Upload>),
}

fn wall() -> Wall {
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(3.2, 1.8));
    let screens = vec![Screen::new("front", Surface::Plane(plane), UVec2::from(SIZE))];
    let channel = Channel::tile("front-1-1", 0, UVec2::ZERO, UVec2::from(SIZE));
    let channels = vec![Channel { server: "left".into(), ..channel }];
    Wall { near_m: 0.1, ..Wall::new("test", screens, channels) }
}

/// Makes a state drawable, without a frame on the way.
fn finish(thread: &mut RenderThread, state: Arc<LoadedState>) {
    let (answer, answered) = sync_channel(1);
    thread.upload(Upload::Finish { state, answer });
    while thread.preparation.is_some() {
        if thread.continues_preparation() {
            thread.continue_preparation();
        } else {
            thread.wait();
        }
    }
    answered.recv().expect("answered").expect("finished");
}

fn notice(what: &str, is_lost: bool) -> RenderTask {
    let manager = if is_lost { ManagerState::Lost } else { ManagerState::Expected };
    let (what, since) = (what.to_owned(), "12:03:10 UTC".to_owned());
    RenderTask::Notice(ConnectionStatus {
        what,
        since,
        address: Some("127.0.0.1:5".into()),
        manager,
    })
}

impl RenderThreadFixture {
    fn new() -> Self {
        Self::in_full_screen(None)
    }

    /// With a display in full screen.
    fn in_full_screen(assigned: Option<MonitorAssignment>) -> Self {
        Self::on(Gpu::headless().unwrap_or_else(|error| panic!("{error}")), assigned)
    }

    fn on(gpu: Gpu, assigned: Option<MonitorAssignment>) -> Self {
        let outputs = vec![ChannelOutput::offscreen(&gpu, "front-1-1", SIZE, assigned)];
        let (jobs, waiting_jobs) = bounded(1);
        let (uploads, waiting_uploads) = bounded(1);
        let (reporter, reports) = mpsc::channel(100);
        let queues = Queues {
            jobs: waiting_jobs,
            uploads: waiting_uploads,
            reports: reporter,
            monitor_names: None,
        };
        let identity = ServerInfo { server: "left".into(), adapter: "a pencil".into() };
        let clock = Arc::new(Clock::default());
        let (present_delay, slowness) = (Duration::ZERO, DrawDelay::new(None));
        let drawing = DrawOptions { present_delay, slowness, culls_occluded: true };
        let thread = RenderThread::new(gpu, outputs, queues, clock, identity, drawing);
        let mut stage = Self {
            thread: thread.expect("a renderer"),
            reports,
            frame: 0,
            is_metered: false,
            _senders: (jobs, uploads),
        };
        stage.prepare(wall());
        stage
    }

    /// A state whose pictures are as bright as the exposure says.
    fn prepare(&mut self, wall: Wall) {
        let plans = correction::correction_plans(
            &wall,
            &CalibrationMaps::default(),
            &["front-1-1".to_owned()],
            None,
        )
        .expect("plans");
        let revision = Revision(self.thread.states.len() as u64);
        let replica = Replica::from_snapshot(
            Revision(revision.0 + 1),
            vec![Operation::SetWall(Box::new(wall))],
        );
        let digest = replica.digest();
        let (scene, warm_up, plans) = (None, Camera::IDENTITY, Arc::new(plans));
        let state = LoadedState {
            environment: None,
            epoch: EPOCH,
            replica,
            digest,
            scene,
            warm_up,
            plans,
            maps: CalibrationMaps::default(),
            shapes: Arc::default(),
            motion: None,
        };
        let desc = Scene { sky: Vec3::new(0.2, 0.3, 0.4), ..Scene::default() };
        let builder = SceneBuilder::new(&self.thread.gpu, desc).expect("a scene");
        self.thread.building = Some(builder);
        finish(&mut self.thread, Arc::new(state));
    }

    fn draw(&mut self, exposure: f32, display: OutputMode) {
        self.frame += 1;
        let revision = self.thread.states.back().expect("a state").state.replica.revision;
        let frame = Frame {
            epoch: EPOCH,
            frame: FrameId(self.frame),
            time_s: 0.0,
            revision,
            presentation: Presentation {
                exposure,
                output_mode: display,
                is_exposure_automatic: self.is_metered,
                ..Presentation::new(HeadPose::facing_forward(DVec3::ZERO, 0.0))
            },
            capture: Some(NonZeroU32::MIN),
            detail: DetailBound::default(),
            clips: Vec::new(),
            is_metered: self.is_metered,
        };
        self.thread.handle(RenderTask::Frame(Box::new(frame)));
        self.turn();
    }

    /// Draws and shows a frame. Gives the picture of it that a capture gets.
    fn show(&mut self, exposure: f32, display: OutputMode) -> Vec<u8> {
        self.draw(exposure, display);
        let swap = Swap {
            epoch: EPOCH,
            frame: FrameId(self.frame),
            not_after_us: u64::MAX,
            present_at_us: None,
        };
        self.thread.handle(RenderTask::Swap(swap));
        self.turn();
        let (mut captured, mut drawn, mut shown) = (Vec::new(), false, false);
        while let Ok(report) = self.reports.try_recv() {
            let number = FrameId(self.frame);
            match report {
                RenderEvent::Picture(picture) => captured = picture.bytes.to_vec(),
                RenderEvent::Status(ServerMessage::Drawn(FrameRendered { frame, .. })) => {
                    drawn |= frame == number;
                }
                RenderEvent::Status(ServerMessage::Shown(FramePresented { frame, .. })) => {
                    shown |= frame == number;
                }
                RenderEvent::Status(ServerMessage::Display { .. }) => {}
                RenderEvent::Status(other) => panic!("{other:?}"),
            }
        }
        assert!(drawn && shown, "the channel answers in every mode");
        captured
    }

    fn turn(&mut self) {
        while let Some(act) = self.thread.playback.poll(None) {
            self.thread.perform(act);
        }
    }

    fn seen(&self) -> Vec<u8> {
        self.thread.outputs[0].read_back(&self.thread.gpu)
    }

    /// Pixels of what is seen that differ from these, as columns and rows from which and to which.
    fn differing(&self, from: &[u8]) -> Option<[usize; 4]> {
        let seen = self.seen();
        let pixels = seen.chunks_exact(4).zip(from.chunks_exact(4)).enumerate();
        let places = pixels.filter(|(_, (a, b))| a != b);
        let places = places.map(|(n, _)| [n % SIZE[0] as usize, n / SIZE[0] as usize]);
        places.fold(None, |bounds, [x, y]| {
            let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
            Some([left.min(x), top.min(y), right.max(x), bottom.max(y)])
        })
    }
}

#[test]
fn a_display_shows_what_was_swapped_and_not_what_is_drawn_next() {
    let mut stage = RenderThreadFixture::new();
    let first = stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.seen(), first);
    stage.draw(1.0, OutputMode::Normal);
    // Uncovered, it shows the same again.
    stage.thread.handle(RenderTask::Redraw { channel: "front-1-1".into() });
    assert_eq!(stage.seen(), first, "the next frame may never be swapped");
    let third = stage.show(0.8, OutputMode::Normal);
    assert_ne!(third, first);
    assert_eq!(stage.seen(), third);
}

#[test]
fn a_picture_that_was_drawn_ahead_is_shown_with_its_own_swap() {
    let mut stage = RenderThreadFixture::new();
    let pictures = [0.3, 0.5, 0.7, 0.9].map(|exposure| stage.show(exposure, OutputMode::Normal));
    let swap = |stage: &mut RenderThreadFixture, frame: u64| {
        let swap = Swap {
            epoch: EPOCH,
            frame: FrameId(frame),
            not_after_us: u64::MAX,
            present_at_us: None,
        };
        stage.thread.handle(RenderTask::Swap(swap));
    };
    let first = stage.frame + 1;
    stage.draw(0.3, OutputMode::Normal);
    for (ahead, exposure) in [(1, 0.5), (2, 0.7), (3, 0.9)] {
        let before = stage.seen();
        stage.draw(exposure, OutputMode::Normal);
        assert_eq!(stage.seen(), before, "frame {ahead} is drawn and not shown");
        swap(&mut stage, first + ahead - 1);
        assert_eq!(stage.seen(), pictures[ahead as usize - 1]);
    }
    swap(&mut stage, first + 3);
    assert_eq!(stage.seen(), pictures[3]);
    // A frozen display keeps it, though frames go on two by two.
    stage.draw(0.3, OutputMode::Freeze);
    stage.draw(0.5, OutputMode::Freeze);
    swap(&mut stage, first + 4);
    swap(&mut stage, first + 5);
    assert_eq!(stage.seen(), pictures[3]);
}

#[test]
fn a_wall_whose_displays_are_turned_and_curved_shows_it_from_the_next_frame_on() {
    let mut stage = RenderThreadFixture::new();
    let upright = stage.show(0.5, OutputMode::Normal);
    let mut turned = wall();
    turned.channels[0].adjustment.turn = Orientation::Left;
    stage.prepare(turned);
    let picture = stage.show(0.5, OutputMode::Normal);
    let size = stage.thread.outputs[0].picture().map(OutputTexture::size);
    assert_eq!(size, Some([SIZE[1], SIZE[0]]), "a display on its side");
    assert_eq!(picture.len(), upright.len());
    assert!(picture.iter().zip(&upright).all(|(a, b)| a.abs_diff(*b) <= 1), "all is sky");

    let mut curved = wall();
    curved.screens[0].surface = Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: glam::DQuat::IDENTITY,
        radius_m: 2.0,
        azimuth_rad: [-0.8, 0.8],
        height_m: [-0.9, 0.9],
    });
    stage.prepare(curved);
    let first = stage.show(0.5, OutputMode::Normal);
    assert!(first.iter().zip(&upright).all(|(a, b)| a.abs_diff(*b) <= 1), "all is sky");
    assert_eq!(stage.seen(), first);
    let second = stage.show(0.9, OutputMode::Normal);
    assert_ne!(first, second);
    stage.draw(0.3, OutputMode::Normal);
    stage.thread.handle(RenderTask::Redraw { channel: "front-1-1".into() });
    assert_eq!(stage.seen(), second, "the next frame may never be swapped");

    stage.prepare(wall());
    assert_eq!(stage.show(0.5, OutputMode::Normal), upright, "and as before");
}

/// The rate bound follows the times of a server's channels, all of them together.
#[test]
fn the_time_in_which_a_scene_is_moved_counts_once_for_all_channels() {
    let mut stage = RenderThreadFixture::new();
    let output = ChannelOutput::offscreen(&stage.thread.gpu, "front-2-1", SIZE, None);
    stage.thread.outputs.push(output);
    let mut both = wall();
    both.screens[0].canvas.x *= 2;
    let origin = UVec2::new(SIZE[0], 0);
    let beside = Channel { name: "front-2-1".into(), origin, ..both.channels[0].clone() };
    both.channels.push(beside);
    stage.prepare(both);
    stage.thread.moving_takes = Duration::from_mins(30);
    stage.draw(0.5, OutputMode::Normal);
    let reports = std::iter::from_fn(|| stage.reports.try_recv().ok());
    let times = reports.filter_map(|report| match report {
        RenderEvent::Status(ServerMessage::Drawn(drawn)) => Some(drawn.draw_us),
        _ => None,
    });
    let times: Vec<u32> = times.collect();
    let moving_us = 30 * 60 * 1_000_000;
    assert!(times.len() == 2 && times[0] >= moving_us && times[1] < moving_us, "{times:?}");
}

#[test]
fn a_mode_changes_what_is_seen_and_not_what_is_captured() {
    let mut stage = RenderThreadFixture::new();
    let plain = stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.show(0.5, OutputMode::Identify), plain, "captures are of what is drawn");
    let [left, top, right, bottom] = stage.differing(&plain).expect("a label");
    assert!(left > 0 && top > 0 && right < 159 && bottom < 89, "in the middle");
    let named = stage.seen();

    assert_eq!(stage.show(0.5, OutputMode::Blank), plain);
    assert!(stage.seen().chunks_exact(4).all(|pixel| pixel == [0, 0, 0, 255]));
    stage.thread.handle(RenderTask::Redraw { channel: "front-1-1".into() });
    assert!(stage.seen().chunks_exact(4).all(|pixel| pixel == [0, 0, 0, 255]));

    stage.show(0.5, OutputMode::Identify);
    let other = stage.show(0.9, OutputMode::Freeze);
    assert_ne!(other, plain, "drawing goes on");
    assert_eq!(stage.seen(), named, "frozen with its name");
    stage.show(0.7, OutputMode::Freeze);
    stage.thread.handle(RenderTask::Redraw { channel: "front-1-1".into() });
    assert_eq!(stage.seen(), named);
    let last = stage.show(0.7, OutputMode::Normal);
    assert_eq!(stage.seen(), last);
}

#[test]
fn a_lost_manager_is_told_in_a_corner_until_a_frame_is_shown() {
    let mut stage = RenderThreadFixture::new();
    stage.thread.handle(notice("connecting", false));
    let idle = stage.seen();
    let plain = stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.seen(), plain);
    assert_ne!(idle, plain);
    // It had drawn the next frame already, which no swap came for.
    stage.draw(1.0, OutputMode::Normal);
    stage.thread.handle(notice("manager lost at 127.0.0.1:7878: killed", true));
    stage.thread.handle(RenderTask::Disconnected);
    let [left, _, right, bottom] = stage.differing(&plain).expect("words");
    assert!(left < 16 && right < 159 && bottom == 89, "lower left");
    let lost = stage.seen();
    stage.thread.handle(notice("wall test: getting the scene ready", false));
    assert_eq!(stage.seen(), lost, "the picture is as old as before");
    let captured = stage.show(0.5, OutputMode::Normal);
    assert_eq!((captured, stage.seen()), (plain.clone(), plain), "and they are gone");
}

#[test]
fn a_display_is_presented_again_only_where_a_notice_changes_what_it_shows() {
    let mut stage = RenderThreadFixture::new();
    let presents = |stage: &RenderThreadFixture| stage.thread.outputs[0].presents;
    stage.thread.handle(notice("connecting", false));
    stage.thread.handle(notice("wall test: getting the scene ready", false));
    assert_eq!(presents(&stage), 2, "an idle display says it");
    stage.show(0.5, OutputMode::Normal);
    let shown = presents(&stage);
    for _ in 0..10 {
        stage.thread.handle(notice("wall test: ready, no frame yet", false));
    }
    assert_eq!(presents(&stage), shown, "the picture waits for the next frame");
    stage.thread.handle(notice("manager lost at 127.0.0.1:7878: killed", true));
    assert_eq!(presents(&stage), shown + 1);

    stage.show(0.5, OutputMode::Identify);
    let named = presents(&stage);
    stage.thread.handle(notice("wall test: ready, no frame yet", false));
    assert_eq!(presents(&stage), named, "its address is the same");
    let RenderTask::Notice(elsewhere) = notice("wall test: ready, no frame yet", false) else {
        panic!("a notice")
    };
    let address = Some("127.0.0.1:6".into());
    stage.thread.handle(RenderTask::Notice(ConnectionStatus { address, ..elsewhere }));
    assert_eq!(presents(&stage), named + 1);
}

#[test]
fn a_stopped_wall_says_so_instead_of_its_last_picture() {
    let mut stage = RenderThreadFixture::new();
    let plain = stage.show(0.5, OutputMode::Normal);
    let (what, since) = ("wall stopped at 12:03:10 UTC".to_owned(), "12:03:10 UTC".to_owned());
    let manager = ManagerState::Stopped;
    stage.thread.handle(RenderTask::Notice(ConnectionStatus {
        what,
        since,
        address: None,
        manager,
    }));
    let stopped = stage.seen();
    stage.thread.handle(RenderTask::Disconnected);
    assert_eq!(stage.seen(), stopped);
    // All of it is other pixels: the sky is nowhere, not even between the words.
    assert_eq!(stage.differing(&plain), Some([0, 0, SIZE[0] as usize - 1, SIZE[1] as usize - 1]));
    stage.thread.handle(notice("wall test: getting the scene ready", false));
    assert_ne!(stage.seen(), plain, "not yet");
    let again = stage.show(0.5, OutputMode::Normal);
    assert_eq!((&again, &stage.seen()), (&plain, &plain));
}

#[test]
fn a_black_display_stays_black_when_its_manager_is_lost() {
    let mut stage = RenderThreadFixture::new();
    stage.show(0.5, OutputMode::Blank);
    let black = stage.seen();
    stage.thread.handle(notice("manager lost at 127.0.0.1:7878: killed", true));
    stage.thread.handle(RenderTask::Disconnected);
    stage.thread.handle(notice("wall test: ready, no frame yet", false));
    assert_eq!(stage.seen(), black);
}

#[test]
fn a_display_that_starts_frozen_says_so_and_keeps_saying_it() {
    let mut stage = RenderThreadFixture::new();
    stage.thread.handle(notice("wall test: ready, no frame yet", false));
    let idle = stage.seen();
    stage.show(0.5, OutputMode::Freeze);
    let frozen = stage.seen();
    assert_ne!(frozen, idle, "other words");
    stage.show(0.9, OutputMode::Freeze);
    assert_eq!(stage.seen(), frozen);
    let plain = stage.show(0.9, OutputMode::Normal);
    assert_eq!(stage.seen(), plain);
}

#[test]
fn an_idle_picture_says_name_server_address_state_and_since_when() {
    let identity = ServerInfo { server: "left".into(), adapter: "a pencil".into() };
    let RenderTask::Notice(notice) = notice("no manager at 127.0.0.1:7878: refused", false) else {
        panic!("a notice")
    };
    assert_eq!(
        identity.idle_lines("front-1-1", &notice, false),
        [
            "front-1-1",
            "server left",
            "127.0.0.1:5",
            "no manager at 127.0.0.1:7878: refused",
            "since 12:03:10 UTC"
        ]
    );
    assert_eq!(
        identity.identify_lines("front-1-1", [1920, 1080], Some(&notice)),
        ["front-1-1", "server left", "127.0.0.1:5", "1920 x 1080 pixels", "a pencil"]
    );
}

#[test]
fn a_picture_that_does_not_fit_its_monitor_is_told_for_a_while_on_it_and_to_each_manager() {
    let (name, position) = ("HDMI-1".to_owned(), [0, 0]);
    let monitor = Monitor { name, position, size: SIZE, is_primary: false, is_automatic: true };
    let assigned =
        |monitor: &Monitor| MonitorAssignment { monitor: monitor.clone(), is_connected: true };
    let mut stage = RenderThreadFixture::in_full_screen(Some(assigned(&monitor)));
    let told = |stage: &mut RenderThreadFixture| {
        let reports = std::iter::from_fn(|| stage.reports.try_recv().ok());
        let warnings = reports.filter_map(|report| match report {
            RenderEvent::Status(ServerMessage::Display { warning, .. }) => Some(warning),
            _ => None,
        });
        warnings.collect::<Vec<_>>()
    };
    assert_eq!(told(&mut stage), [], "it fits");
    let plain = stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.seen(), plain);

    let mut smaller = wall();
    smaller.channels[0].size = UVec2::new(80, 45);
    stage.prepare(smaller);
    let warning = "channel front-1-1 has 80x45 pixels and its monitor HDMI-1 160x90, so that it \
                   is scaled: set the monitor to 80x45, or write pixels = [160, 90] for it in the \
                   wall file";
    assert_eq!(told(&mut stage), [Some(warning.to_owned())]);
    stage.show(0.5, OutputMode::Normal);
    let noted = stage.seen();
    stage.thread.outputs[0].end_note(Instant::now() + 2 * NOTE_TIME);
    stage.thread.show_again(0);
    let clean = stage.seen();
    let [left, _, _, bottom] = stage.differing(&noted).expect("the note has gone");
    assert!(left < 16 && bottom == 89, "it stood in the lower left");
    assert!(stage.thread.note_wait() > NOTE_TIME, "no other one is waited for");
    stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.seen(), clean, "said once");

    stage.thread.handle(RenderTask::Disconnected);
    stage.thread.check_displays();
    assert_eq!(told(&mut stage), [Some(warning.to_owned())], "the next manager hears it too");
    stage.prepare(wall());
    assert_eq!(told(&mut stage), [None], "it fits again");

    stage.thread.handle(RenderTask::Disconnected);
    let gone = MonitorAssignment { is_connected: false, ..assigned(&monitor) };
    let channel = "front-1-1".to_owned();
    stage.thread.handle(RenderTask::MonitorAssigned { channel, assignment: gone });
    // What was reported without a connection is dropped.
    let dropped = told(&mut stage);
    stage.thread.handle(RenderTask::Connected);
    stage.prepare(wall());
    let told_again = told(&mut stage);
    assert_eq!(told_again, dropped, "the next manager hears what happened while there was none");
    assert!(matches!(&told_again[..], [Some(warning)] if warning.contains("is gone")));
    let (channel, assignment) = ("front-1-1".to_owned(), assigned(&monitor));
    stage.thread.handle(RenderTask::MonitorAssigned { channel, assignment });
    assert_eq!(told(&mut stage), [None], "and that it is over");

    stage.thread.outputs[0].present_fault = Some("its surface is not valid".to_owned());
    stage.thread.check_displays();
    let warning = "its display takes no frames: its surface is not valid".to_owned();
    assert_eq!(told(&mut stage), [Some(warning)]);
    stage.show(0.5, OutputMode::Normal);
    assert_eq!(stage.thread.outputs[0].reported, None, "a frame that it takes ends that");
}
