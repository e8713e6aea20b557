//! What servers hold of a scene follows where it is seen from, in one frame for all.

use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_protocol::state_log::Operation;
use polyptych_scene::residency::SeenFrom;

use super::editing::{TREE, moving};
use super::*;

/// Metres by which an eye may move.
const REACH: f64 = 2.0;

fn limited(channels: u32) -> Wall {
    let mut wall = wall(channels);
    wall.budget.gpu_mib = Some(8);
    wall
}

fn at(x: f64) -> Camera {
    Camera { position: DVec3::X * x, ..Camera::IDENTITY }
}

impl ClusterFixture {
    /// A wall with two servers that hold a part of a scene.
    fn limited() -> Self {
        let mut stage = Self::live(limited(2));
        stage.detail_reach = Some(REACH);
        stage.open_town();
        stage
    }

    fn open_town(&mut self) {
        self.request(Request::OpenScene { path: "town.glb".into(), scene: None });
        let job = *self.imports.last().expect("an import");
        self.cluster.handle_import(self.now, job, Ok(Self::imported()));
        self.read();
        self.prepare_all();
        self.clear();
    }

    /// The wall shows a frame from here. Returns whether it waits for detail.
    fn look(&mut self, camera: Camera) -> bool {
        self.request(Request::SetCamera(camera));
        self.replies.clear();
        self.order_frame();
        // One that nobody ordered may come before.
        for _ in 0..3 {
            if self.replies.is_empty() {
                self.draw(&[0, 1], 1_000);
            }
        }
        match self.replies.pop() {
            Some((_, Ok(Response::Frame(feedback)))) => feedback.detail.awaits_detail,
            other => panic!("{other:?}"),
        }
    }

    /// The places that servers were told of since, by the one change on its way.
    fn told(&self) -> Vec<SeenFrom> {
        let [(_, first), (_, second)] = &self.prepares[..] else { panic!("{:?}", self.prepares) };
        assert_eq!(first, second);
        match &first.operations[..] {
            [Operation::SetSeenFrom(places)] => places.clone(),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn all_servers_get_what_serves_the_camera_before_a_frame_shows_it() {
    let mut stage = ClusterFixture::limited();
    let before = stage.cluster.shown.revision;
    assert!(stage.look(at(10.0)), "nothing is known of where it is seen from");
    let places = stage.told();
    let eye = at(10.0).position + stage.cluster.presentation.head.position;
    let density = places[0].density;
    assert_eq!(places, [SeenFrom { position: eye, density, is_parallel: false }]);
    assert!(density > 10.0, "{density}");
    stage.prepare(SessionId(0));
    assert!(stage.look(at(10.0)));
    assert!(stage.frames.iter().all(|(_, frame)| frame.revision == before), "as before");
    stage.frames.clear();
    stage.prepare(SessionId(1));
    // A wall that is paused shows it too.
    stage.wait(1_000);
    assert_eq!(stage.frames.len(), 2, "{:?}", stage.frames);
    assert!(stage.frames.iter().all(|(_, frame)| frame.revision.0 == before.0 + 1));
    // The first frame of a part draws shadows anew, and has time for it.
    stage.request(Request::Run(Pacing::Rate(0.01)));
    stage.draw(&[0, 1], 1_500_000);
    assert_eq!([0, 1].map(|index| stage.state(index)), [ChannelState::Live; 2]);
    assert!(!stage.look(at(10.0)), "it is there");
    assert_eq!(stage.state(0), ChannelState::Live);
    // A step within the reach changes nothing, however long it lasts.
    assert!(!stage.look(at(11.9)));
    stage.live_for(2_000_000);
    assert!(stage.prepares.is_empty());
    // Beyond it another part comes, once servers have had four times as long for frames.
    assert!(stage.look(at(12.1)));
    assert!(stage.prepares.is_empty());
    stage.live_for(3_500_000);
    assert!(stage.prepares.is_empty());
    stage.live_for(1_000_000);
    assert_eq!(stage.told()[0].position.x, 12.1);
    stage.prepare_all();
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    // Half a second at least.
    assert!(stage.look(at(20.0)));
    assert!(stage.prepares.is_empty());
    stage.wait(400_000);
    assert!(stage.prepares.is_empty());
    stage.live_for(4_000_000);
    assert_eq!(stage.told()[0].position.x, 20.0);
}

#[test]
fn every_view_counts_and_parallel_rays_have_no_place() {
    let mut stage = ClusterFixture::limited();
    let area = polyptych_wall::view::Area::Wall;
    let view = |projection| polyptych_wall::view::View {
        area,
        projection,
        ..polyptych_wall::view::View::of_wall(at(5.0))
    };
    let height_m = 4.0;
    let views = vec![
        view(polyptych_wall::view::ViewProjection::Perspective { fov_y_rad: 1.0 }),
        view(polyptych_wall::view::ViewProjection::Orthographic { height_m }),
    ];
    stage.request(Request::SetViews(views));
    stage.look(at(0.0));
    let places = stage.told();
    assert_eq!(places.len(), 3);
    assert_eq!(places[1].position, DVec3::X * 5.0);
    assert_eq!(places.iter().map(|of| of.is_parallel).collect::<Vec<_>>(), [false, false, true]);
    // Twice as many pixels along a metre across as down, of which there are 64.
    assert!((places[2].density - 128.0 / height_m).abs() < 1e-9, "{}", places[2].density);
}

#[test]
fn a_part_that_a_server_cannot_get_leaves_the_wall_as_it_was_and_is_tried_again() {
    let mut stage = ClusterFixture::limited();
    let before = stage.cluster.shown.clone();
    stage.look(at(10.0));
    let (_, refused) = stage.prepares[1].clone();
    stage.prepare(SessionId(0));
    stage.prepares.clear();
    stage.say(
        SessionId(1),
        ServerMessage::PrepareFailed {
            epoch: Epoch(7),
            revision: refused.revision,
            reason: "the store is gone".into(),
        },
    );
    assert_eq!(stage.cluster.shown, before);
    for channel in [0, 1] {
        assert_eq!(stage.state(channel), ChannelState::Live);
    }
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    stage.look(at(10.0));
    stage.live_for(9_000_000);
    assert!(stage.prepares.is_empty(), "{:?}", stage.prepares);
    stage.live_for(1_100_000);
    assert_eq!(stage.prepares.len(), 2);
    stage.prepares.retain(|(_, prepare)| prepare.revision > refused.revision);
    assert_eq!(stage.prepares.len(), 2, "another number than that of the refused one");
    let shown = stage.cluster.shown.revision;
    assert!(shown < refused.revision, "servers are told that frames do not name it");
    assert!(stage.prepares.iter().all(|(_, prepare)| prepare.shown == shown));
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.seen_from.len(), 1);
}

#[test]
fn a_part_that_was_refused_does_not_count_as_held() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    stage.prepare_all();
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    stage.look(at(60.0));
    stage.draw(&[0, 1], 1_000);
    stage.live_for(1_000_000);
    assert_eq!(stage.told()[0].position.x, 60.0);
    let (epoch, revision) = (Epoch(7), stage.prepares[0].1.revision);
    let digest = stage.cluster.changes.digest_of(revision).expect("on its way");
    let (features, scene_bytes, detail_reach) = (Vec::new(), 9, Some(100.0));
    let prepared = Prepared { epoch, revision, digest, features, scene_bytes, detail_reach };
    stage.say(SessionId(0), ServerMessage::Prepared(prepared));
    let reason = "the store is gone".into();
    stage.say(SessionId(1), ServerMessage::PrepareFailed { epoch, revision, reason });
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.read();
    let first = &stage.cluster.status(stage.now).channels[0];
    assert_eq!((first.state, first.scene_bytes), (ChannelState::Live, 0));
    assert!(stage.cluster.awaits_detail(stage.cluster.shown.revision), "it is 50 m from there");
}

#[test]
fn a_part_that_takes_for_ever_is_given_up_and_does_not_hold_others() {
    let mut stage = ClusterFixture::limited();
    let before = stage.cluster.shown.clone();
    stage.look(at(10.0));
    stage.prepare(SessionId(0));
    stage.live_for(5_000_000);
    let id = stage.request(Request::CloseScene);
    stage.live_for(1_900_000);
    assert!(!stage.replies.iter().any(|(of, _)| *of == id));
    assert_eq!(stage.prepares.len(), 1, "the part may still come");
    stage.live_for(200_000);
    assert_eq!(stage.cluster.shown, before, "no channel is left behind for it");
    assert_eq!([0, 1].map(|index| stage.state(index)), [ChannelState::Live; 2]);
    // The slow one has to answer, and is told of what was asked for since.
    stage.prepare_all();
    assert!(stage.replies.contains(&(id, Ok(Response::Done))), "{:?}", stage.replies);
    assert!(stage.cluster.shown.scene.is_none() && stage.cluster.shown.seen_from.is_empty());
    stage.clear();
    assert!(!stage.look(at(30.0)), "nothing is held");
    stage.live_for(5_000_000);
    assert!(stage.prepares.is_empty());
}

#[test]
fn an_effect_waits_two_seconds_behind_a_part_and_costs_no_display() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    stage.prepare(SessionId(0));
    let (_, part) = stage.prepares.remove(0);
    let id = stage.request(Request::SetFog(Some(polyptych_scene::Fog::even(90.0))));
    stage.live_for(1_900_000);
    assert!(stage.prepares.is_empty(), "the part may still come");
    stage.live_for(200_000);
    // Also the slow one is sent the change, whole, and stops to work on the part.
    let sent: Vec<_> = stage.prepares.iter().map(|(to, of)| (*to, of.base)).collect();
    assert_eq!(sent, [(SessionId(0), None), (SessionId(1), None)]);
    let (epoch, revision) = (Epoch(7), part.revision);
    let reason = "a newer preparation has come".into();
    stage.say(SessionId(1), ServerMessage::PrepareFailed { epoch, revision, reason });
    stage.prepare_all();
    assert!(stage.replies.contains(&(id, Ok(Response::Done))), "{:?}", stage.replies);
    assert_eq!([0, 1].map(|index| stage.state(index)), [ChannelState::Live; 2]);
}

#[test]
fn a_part_for_which_nobody_else_waits_has_ten_seconds() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    stage.prepare(SessionId(0));
    stage.live_for(9_000_000);
    stage.prepare(SessionId(1));
    assert_eq!(stage.cluster.shown.seen_from.len(), 1);
}

/// Servers begin anew with each try: one that takes longer than the first would never come.
#[test]
fn a_part_that_was_not_ready_has_twice_the_time_when_it_is_tried_again() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    stage.live_for(10_500_000);
    stage.draw(&[0, 1], 1_000);
    stage.prepares.clear();
    stage.live_for(10_000_000);
    assert_eq!(stage.prepares.len(), 2, "it is tried again");
    stage.live_for(19_000_000);
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.seen_from.len(), 1);
}

#[test]
fn a_part_that_comes_after_it_was_given_up_costs_no_display() {
    let mut stage = ClusterFixture::limited();
    let before = stage.cluster.shown.clone();
    stage.look(at(10.0));
    let (_, part) = stage.prepares[1].clone();
    stage.live_for(10_500_000);
    stage.look(at(0.0));
    // No frame is swapped between both.
    for session in [0, 1] {
        stage.prepare(SessionId(session));
    }
    assert_eq!([0, 1].map(|index| stage.state(index)), [ChannelState::Live; 2]);
    assert_eq!(stage.cluster.shown, before);
    stage.look(at(10.0));
    stage.live_for(11_000_000);
    let later = stage.prepares.iter().filter(|(_, prepare)| prepare.revision > part.revision);
    assert_eq!(later.count(), 2, "it is tried again");
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.seen_from.len(), 1);
}

/// Each try gives it more time, and servers stop to work on it when that is over.
#[test]
fn a_part_that_takes_three_seconds_comes_though_a_program_edits_at_every_frame() {
    let mut stage = ClusterFixture::live(limited(2));
    stage.detail_reach = Some(REACH);
    stage.open_house();
    stage.look(at(10.0));
    let end = stage.now + 120_000_000;
    let mut begun = BTreeMap::new();
    while stage.now < end && stage.cluster.shown.seen_from.is_empty() {
        stage.edit(moving(TREE, 4.0));
        for session in [0, 1].map(SessionId) {
            let sent = stage.prepares.iter().filter(|(to, _)| *to == session);
            let sent: Vec<_> = sent.map(|(_, prepare)| prepare.clone()).collect();
            let Some(last) = sent.last() else { continue };
            for _ in 1..sent.len() {
                stage.cancel(session);
            }
            let since = *begun.entry(last.revision).or_insert(stage.now);
            let is_part = |of: &Operation| matches!(of, Operation::SetSeenFrom(_));
            if !last.operations.iter().any(is_part) || stage.now - since >= 3_000_000 {
                stage.prepare(session);
            }
        }
        stage.wait(16_000);
        if !stage.cluster.pipeline.is_empty() {
            stage.draw(&[0, 1], 0);
        }
    }
    assert_eq!(stage.cluster.shown.seen_from[0].position.x, 10.0);
    let refused = stage.replies.iter().find(|(_, reply)| reply.is_err());
    assert_eq!(refused, None, "no edit is lost");
}

#[test]
fn a_camera_that_moves_takes_no_time_from_a_scene_on_its_way() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    stage.prepare_all();
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    let large = stage.open("large");
    stage.look(at(60.0));
    stage.live_for(600_000_000);
    assert_eq!(stage.reply(large), None, "no display is ready for it, and no change waits");
    stage.prepare_all();
    assert!(matches!(stage.reply(large), Some(Ok(Response::SceneOpened(_)))));
}

#[test]
fn a_part_that_waited_for_its_turn_costs_no_pause_for_that() {
    let mut stage = ClusterFixture::limited();
    let studio = Environment { name: "studio.hdr".into(), blob: BlobHash([7; 32]) };
    stage.request(Request::SetEnvironment(EnvironmentSource::Baked(studio)));
    stage.look(at(60.0));
    stage.request(Request::Run(Pacing::Rate(0.01)));
    stage.draw(&[0, 1], 1_000);
    stage.live_for(60_000_000);
    assert!(stage.cluster.shown.environment.is_none(), "it is still on its way");
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.seen_from[0].position.x, 60.0);
    // The first frame of the surroundings, and that of the part.
    stage.draw(&[0, 1], 1_000);
    stage.draw(&[0, 1], 1_000);
    stage.look(at(120.0));
    stage.live_for(3_000_000);
    assert_eq!(stage.told()[0].position.x, 120.0);
}

#[test]
fn another_scene_does_not_pause_for_the_parts_of_the_last_one() {
    let mut stage = ClusterFixture::limited();
    stage.request(Request::Run(Pacing::Rate(0.01)));
    stage.look(at(10.0));
    stage.live_for(9_000_000);
    stage.prepare_all();
    stage.wait(1_000);
    stage.draw(&[0, 1], 1_000);
    stage.open_town();
    stage.look(at(10.0));
    stage.wait(1_000);
    assert_eq!(stage.told()[0].position.x, 10.0);
}

/// Frames of a film wait for detail, and not as long as a wall that draws by itself has for frames.
#[test]
fn a_paused_wall_asks_for_the_next_part_at_once_however_long_the_last_one_took() {
    for runs_before in [false, true] {
        let mut stage = ClusterFixture::limited();
        stage.look(at(10.0));
        stage.live_for(4_000_000);
        stage.prepare_all();
        stage.wait(1_000);
        if runs_before {
            stage.request(Request::Run(Pacing::Rate(0.01)));
        }
        stage.draw(&[0, 1], 1_000);
        stage.request(Request::Pause);
        assert!(stage.look(at(60.0)));
        stage.wait(1_000_000);
        assert_eq!(stage.told()[0].position.x, 60.0);
    }
}

#[test]
fn servers_that_hold_all_are_told_nothing() {
    for (wall, reach) in [(limited(2), None), (wall(2), Some(REACH))] {
        let mut stage = ClusterFixture::live(wall);
        stage.detail_reach = reach;
        stage.open_town();
        assert!(!stage.look(at(10.0)));
        stage.live_for(5_000_000);
        assert!(stage.prepares.is_empty());
    }
}

#[test]
fn a_reach_that_lies_costs_one_change_in_half_a_second() {
    for reach in [f64::NAN, -1.0, 0.0] {
        let mut stage = ClusterFixture::limited();
        stage.detail_reach = Some(reach);
        let mut changes = 0;
        for step in 0..100 {
            stage.look(at(f64::from(step) * 0.01));
            stage.wait(19_000);
            changes += stage.prepares.len();
            stage.prepare_all();
        }
        assert!((6..=10).contains(&changes), "{changes} of two servers within two seconds");
    }
}

#[test]
fn a_restored_wall_begins_with_the_part_of_its_camera() {
    let mut stage = ClusterFixture::limited();
    stage.look(at(10.0));
    let memory = stage.memories.last().expect("remembered").clone();
    let restored = Cluster::restore(limited(2), Epoch(8), &memory);
    assert_eq!(restored.shown.seen_from[0].position.x, 10.0);
    assert_eq!(restored.shown.digest(), restored.shown_digest);
    assert_eq!(restored.shown.revision, memory.revision);
}
