//! Walls on which the next frame is drawn while the last one waits for its swap: they show the
//! same, and everything else goes on as before.

use polyptych_client::{FrameFeedback, Pacing, Request, Response, Wall, fit_bounds};
use serde_json::Value;

use crate::harness::local_wall::{LocalWall, patient, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

const FRAMES: u64 = 12;

/// A wall whose pipeline has this depth.
fn wall(depth: u32) -> Wall {
    let mut wall = patient(small(2, 1));
    wall.sync.pipeline_depth = depth;
    wall
}

/// A run through a relay that takes 4 ms each way, and its report.
fn simulated(depth: u32) -> (Simulation, Value) {
    let place = TestDir::new();
    let record = place.path("wall.rec").display().to_string();
    let mut arguments = vec!["--orbit", "--frames", "12", "--record", &record];
    for fault in ["at 1 delay 4ms front-1-1", "at 1 delay 4ms front-2-1"] {
        arguments.extend(["--fault", fault]);
    }
    let mut simulation = Simulation::start(place, &wall(depth), town(), &arguments);
    simulation.process.finish(wait::LIMIT).succeeded();
    // All that a manager may do is found in its recording.
    simulation.place.run(["replay", &record]).succeeded();
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    (simulation, serde_json::from_slice(&text).expect("JSON"))
}

#[test]
fn a_frame_that_is_sent_ahead_shows_what_it_would_show_without() {
    let [(plain, before), (ahead, after)] = [0, 1].map(simulated);
    assert_eq!((&before["frames"], &before["ahead"]), (&FRAMES.into(), &0.into()));
    assert_eq!((&after["frames"], &after["complete"]), (&FRAMES.into(), &FRAMES.into()));
    assert!(after["ahead"].as_u64() > Some(0), "no two frames were on their way: {after}");
    for name in ["wall", "channel-front-1-1", "channel-front-2-1"] {
        let picture = |of: &Simulation| read(&of.place.path(&format!("out/{name}.png")));
        assert!(color_count(&picture(&plain)) > 100, "{name} shows nothing");
        check(name, &picture(&ahead), &picture(&plain), &IDENTICAL);
    }
}

#[test]
fn frames_that_are_asked_for_together_are_answered_in_order_and_captures_alone() {
    let folder = town().parent().expect("a folder");
    let [plain, ahead] = [0, 1].map(|depth| LocalWall::start(&wall(depth), &[folder]));
    let cameras = [0.2, 0.9, 1.6].map(|heading| {
        let focus = plain.client().open_scene("town.glb").expect("opened").bounds;
        fit_bounds(&wall(0), &focus.expect("something to see"), heading)
    });
    let client = ahead.client();
    client.open_scene("town.glb").expect("opened");
    for camera in cameras {
        let asked = [0.0, 0.5, 1.0, 1.5].map(|time_s| {
            let request = Request::RenderFrame { camera: Some(camera), time_s: Some(time_s) };
            client.submit(request).expect("sent")
        });
        let feedback = asked.map(|pending| match pending.wait().expect("answered") {
            Response::Frame(feedback) => feedback,
            other => panic!("{other:?}"),
        });
        let times = feedback.each_ref().map(|feedback| feedback.time_s);
        assert_eq!(times, [0.0, 0.5, 1.0, 1.5], "each frame is of its own request");
        assert!(feedback.is_sorted_by(|a, b| a.frame < b.frame));
        assert!(feedback.iter().all(FrameFeedback::is_complete), "{feedback:?}");
        let expected = screen_of(&shot(&plain.client(), camera));
        check("capture", &screen_of(&shot(&client, camera)), &expected, &IDENTICAL);
    }
    assert!(client.statistics(false).expect("statistics").ahead > 0);
    // At its own pace too, and a capture comes between.
    client.statistics(true).expect("statistics");
    let mut stream = client.feedback().expect("subscribed");
    client.start_rendering(Pacing::Free).expect("running");
    let mut last = None;
    for _ in 0..20 {
        let feedback = stream.next().expect("feedback");
        assert!(last.replace(feedback.frame) < Some(feedback.frame), "{feedback:?}");
    }
    let expected = screen_of(&shot(&plain.client(), cameras[2]));
    let capture = client.capture().expect("captured");
    check("running", &screen_of(&capture), &expected, &IDENTICAL);
    client.pause().expect("paused");
    assert!(client.statistics(false).expect("statistics").ahead > 0);
}
