//! Clips: every channel gets the same times, in this life of the manager and in the next.

use polyptych_protocol::clip::{ClipAction, ClipChange, ClipSummary};
use polyptych_scene::ClipTime;
use proptest::prelude::*;

use super::*;
use crate::clips::PlayedClips;

fn summary(name: &str, duration_s: f64, is_played: bool) -> ClipSummary {
    ClipSummary { name: name.into(), duration_s, is_played }
}

/// A wall whose scene has two motions of 2 and 3 s, the first of which is played, and a third
/// without a name.
fn stage() -> ClusterFixture {
    let mut stage = ClusterFixture::new(2);
    let clips = [summary("walk", 2.0, true), summary("run", 3.0, false), summary("", 1.0, false)];
    let mut imported = ClusterFixture::imported();
    imported.summary.clips = clips.to_vec();
    open(&mut stage, imported);
    stage
}

fn open(stage: &mut ClusterFixture, imported: ImportedScene) {
    stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports.pop().expect("an import");
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    stage.prepare_all();
    stage.draw(&[0, 1], 0);
    stage.clear();
}

const PLAY: ClipAction = ClipAction::Play { speed: None, weight: None, is_looping: None };

fn change(stage: &mut ClusterFixture, clip: Option<&str>, action: ClipAction) -> Option<String> {
    let clip = clip.map(str::to_owned);
    stage.replies.clear();
    let id = stage.request(Request::ChangeClips(ClipChange { clip, action }));
    let (of, reply) = stage.replies.pop().expect("an answer");
    assert_eq!(of, id);
    // A wall that is paused makes a frame for it.
    stage.draw(&[0, 1], 0);
    reply.err().map(|error| error.reason)
}

/// Draws a frame; returns its clips, which all servers have.
fn frame_at(stage: &mut ClusterFixture, now: Micros, time_s: Option<f64>) -> Vec<(u32, f64, f32)> {
    stage.now = now;
    stage.frames.clear();
    stage.request(Request::RenderFrame { camera: None, time_s });
    stage.draw(&[0, 1], 0);
    let all = stage.frames.iter().map(|(_, frame)| &frame.clips);
    let all: Vec<&Vec<ClipTime>> = all.collect();
    assert!(all.len() == 2 && all[0] == all[1]);
    all[0].iter().map(|of| (of.clip, of.time_s, of.weight)).collect()
}

#[test]
fn clips_are_functions_of_the_time_that_clients_give() {
    let mut stage = stage();
    for (time_s, wanted) in [(0.0, 0.0), (0.5, 0.5), (2.0, 2.0), (5.25, 1.25), (0.5, 0.5)] {
        let now = stage.now + 1_000_000;
        assert_eq!(frame_at(&mut stage, now, Some(time_s)), [(0, wanted, 1.0)], "{time_s}");
    }
}

#[test]
fn on_the_walls_own_clock_a_clip_begins_with_the_scene() {
    let mut stage = stage();
    assert_eq!(frame_at(&mut stage, 7_000_000, None), [(0, 0.0, 1.0)]);
    assert_eq!(frame_at(&mut stage, 8_500_000, None), [(0, 1.5, 1.0)]);
    // A film in between has its own times, and leaves the wall's alone.
    assert_eq!(frame_at(&mut stage, 8_600_000, Some(0.25)), [(0, 0.25, 1.0)]);
    assert_eq!(frame_at(&mut stage, 9_500_000, None), [(0, 0.5, 1.0)]);
    // A pause holds it, whatever a film in the pause shows.
    assert_eq!(frame_at(&mut stage, 9_600_000, Some(0.25)), [(0, 0.25, 1.0)]);
    stage.now = 60_000_000;
    stage.frames.clear();
    stage.request(Request::Run(Pacing::Rate(1.0)));
    assert_eq!(stage.frames[0].1.clips[0].time_s, 0.5);
}

#[test]
fn clips_are_played_held_and_put_to_a_time() {
    let mut stage = stage();
    frame_at(&mut stage, 1_000_000, None);
    assert_eq!(frame_at(&mut stage, 1_500_000, None), [(0, 0.5, 1.0)]);
    assert_eq!(change(&mut stage, None, ClipAction::Pause), None);
    assert_eq!(frame_at(&mut stage, 3_000_000, None), [(0, 0.5, 1.0)]);
    assert_eq!(frame_at(&mut stage, 3_100_000, Some(9.0)), [(0, 0.5, 1.0)], "held for films too");
    assert_eq!(change(&mut stage, Some("walk"), ClipAction::Seek(1.25)), None);
    assert_eq!(frame_at(&mut stage, 4_000_000, None), [(0, 1.25, 1.0)]);
    let backwards = ClipAction::Play { speed: Some(-0.5), weight: None, is_looping: None };
    assert_eq!(change(&mut stage, None, backwards), None);
    frame_at(&mut stage, 5_000_000, None);
    assert_eq!(frame_at(&mut stage, 6_000_000, None), [(0, 0.75, 1.0)]);
    // Named, it is played alone; a number is a name too.
    assert_eq!(change(&mut stage, Some("1"), PLAY), None);
    frame_at(&mut stage, 7_000_000, None);
    assert_eq!(frame_at(&mut stage, 8_000_000, None), [(1, 1.0, 1.0)]);
    let beside = ClipAction::Play { speed: None, weight: Some(0.25), is_looping: Some(false) };
    assert_eq!(change(&mut stage, Some("2"), beside), None);
    frame_at(&mut stage, 9_000_000, None);
    assert_eq!(frame_at(&mut stage, 15_500_000, None), [(1, 2.5, 1.0), (2, 1.0, 0.25)]);
    // Played once, one that is over begins again, backwards from its end.
    for (speed, now) in [(1.0, 16_000_000), (-1.0, 19_000_000), (-1.0, 22_000_000)] {
        let once = ClipAction::Play { speed: Some(speed), weight: None, is_looping: Some(false) };
        assert_eq!(change(&mut stage, Some("2"), once), None);
        let [start_s, end_s] = if speed > 0.0 { [0.0, 1.0] } else { [1.0, 0.0] };
        assert_eq!(frame_at(&mut stage, now, None), [(2, start_s, 1.0)]);
        assert_eq!(frame_at(&mut stage, now + 2_000_000, None), [(2, end_s, 1.0)]);
    }
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let mut stage = stage();
    let refused = |stage: &mut ClusterFixture, clip: Option<&str>, action, parts: &[&str]| {
        let reason = change(stage, clip, action).expect("refused");
        for part in parts {
            assert!(reason.contains(part), "'{part}' is not in: {reason}");
        }
    };
    refused(&mut stage, Some("jump"), PLAY, &["jump", "0 (walk), 1 (run), 2"]);
    refused(&mut stage, Some("3"), PLAY, &["no animation 3"]);
    refused(&mut stage, None, ClipAction::Seek(f64::NAN), &["NaN"]);
    refused(&mut stage, None, ClipAction::Seek(-1.0), &["not -1"]);
    let fast = ClipAction::Play { speed: Some(f64::INFINITY), weight: None, is_looping: None };
    refused(&mut stage, None, fast, &["inf", "1000"]);
    let heavy = ClipAction::Play { speed: None, weight: Some(1.5), is_looping: None };
    refused(&mut stage, Some("run"), heavy, &["0 to 1", "1.5"]);
    assert_eq!(frame_at(&mut stage, 4_000_000, Some(1.0)), [(0, 1.0, 1.0)]);
    let mut plain = ClusterFixture::new(2);
    refused(&mut plain, None, PLAY, &["no scene is open"]);
    let mut still = ClusterFixture::new(2);
    open(&mut still, ClusterFixture::imported());
    refused(&mut still, None, PLAY, &["no animations"]);
}

#[test]
fn another_life_of_the_manager_goes_on_with_them() {
    let mut stage = stage();
    frame_at(&mut stage, 1_000_000, None);
    change(
        &mut stage,
        Some("run"),
        ClipAction::Play { speed: Some(0.5), weight: None, is_looping: None },
    );
    frame_at(&mut stage, 2_000_000, None);
    frame_at(&mut stage, 4_000_000, None);
    stage.request(Request::Status);
    stage.wait(1_100_000);
    frame_at(&mut stage, 6_000_000, None);
    let memory = stage.memories.last().expect("remembered").clone();
    let bytes = polyptych_codec::encode(&memory.clips);
    let read = polyptych_codec::decode_within::<PlayedClips, 4096>(&bytes);
    assert_eq!(read.as_ref(), Ok(&memory.clips));
    let next = Cluster::restore(wall(2), Epoch(7), &memory);
    assert_eq!(next.clips.times(), stage.cluster.clips.times(), "it begins where it was");
    assert_eq!(next.clips.statuses(), stage.cluster.clips.statuses());
}

/// Finite numbers, the largest and smallest among them.
fn extreme() -> impl Strategy<Value = f64> {
    let ends = [f64::MAX, f64::MIN, 1e30, -1e30, f64::MIN_POSITIVE, 0.0];
    prop_oneof![prop::sample::select(ends.to_vec()), any::<f64>()]
        .prop_filter("finite", |number| number.is_finite())
}

proptest! {
    #[test]
    fn a_held_clip_stays_where_it_is_whatever_the_scene_times_are(
        times in prop::collection::vec((any::<bool>(), extreme()), 1..20),
        held_s in 0.0..2.0f64,
        is_paused in any::<bool>(),
    ) {
        let mut stage = stage();
        let still = ClipAction::Play { speed: Some(0.0), weight: None, is_looping: None };
        change(&mut stage, None, if is_paused { ClipAction::Pause } else { still });
        change(&mut stage, None, ClipAction::Seek(held_s));
        for (is_given, time_s) in times {
            stage.cluster.clips.advance(is_given, time_s);
            for of in stage.cluster.clips.times() {
                prop_assert_eq!(of.time_s, held_s, "at {}", time_s);
            }
        }
    }

    #[test]
    fn times_are_within_the_clip_whatever_is_asked(
        times in prop::collection::vec((any::<bool>(), extreme()), 1..20),
        speed in prop_oneof![-1000.0..1000.0f64, Just(0.0)],
        is_looping in any::<bool>(),
    ) {
        let mut stage = stage();
        let (speed, is_looping) = (Some(speed), Some(is_looping));
        let action = ClipAction::Play { speed, weight: None, is_looping };
        change(&mut stage, None, action);
        for (is_given, time_s) in times {
            stage.cluster.clips.advance(is_given, time_s);
            for of in stage.cluster.clips.times() {
                prop_assert!((0.0..=2.0).contains(&of.time_s), "{}", of.time_s);
            }
        }
    }
}
