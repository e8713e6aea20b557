//! Servers that are killed, that stand still and that are slow.

use super::{Run, hold, in_time};

#[test]
fn a_killed_server_is_live_again_and_the_others_go_on() {
    in_time(|| {
        let run = Run::new(&["at 40 kill front-2-1"], 140);
        let fault = run.fault(0);
        fault.went_through(&["lost", "live"])?;
        assert_eq!(run.report["restarts"], 1);
        assert!(run.said(&["server is lost", "front-2-1", "reason="]), "{}", run.log);
        let back_ms = fault.ms_after("live_again_ms")?;
        hold(back_ms <= 2000.0, "milliseconds from restart to live", &back_ms)?;
        fault.spared_the_others()?;
        run.kept_its_pace()
    });
}

#[test]
fn a_server_whose_gpu_is_lost_opens_it_again_and_the_others_go_on() {
    in_time(|| {
        let run = Run::new(&["at 40 lose-gpu front-2-1"], 140);
        let fault = run.fault(0);
        // Frames may not see that it prepares: that takes milliseconds.
        fault.was_away()?;
        assert_eq!(run.report["restarts"], 0, "its process stays");
        assert!(!run.log.contains("server is lost"), "and so does its connection");
        assert!(run.said(&["ERROR", "the GPU was lost", "front-2-1"]), "{}", run.log);
        assert!(run.said(&["the GPU is open again", "front-2-1", "ms="]), "{}", run.log);
        let back_ms = fault.ms("live_again_ms")?;
        hold(back_ms <= 2000.0, "milliseconds from the loss to live", &back_ms)?;
        fault.spared_the_others()?;
        run.kept_its_pace()
    });
}

#[test]
fn a_stopped_server_shows_the_current_frame_when_it_wakes() {
    in_time(|| {
        let run = Run::new(&["at 40 stop 3s front-1-2"], 180);
        let fault = run.fault(0);
        // Beyond the heartbeat it is lost: it comes back by itself, and the scene is still there.
        fault.went_through(&["late", "lost", "live"])?;
        assert_eq!(run.report["restarts"], 0);
        assert!(run.log.contains("silent for more than 2000 ms"), "the reason is said");
        let woke_ms = fault.ms_after("drew_again_ms")?;
        hold(woke_ms <= 250.0, "milliseconds from waking to the current frame", &woke_ms)?;
        let late = run.channel("front-1-2")["late"].as_u64();
        hold(late == Some(1), "late not once, and then not waited for", &late)?;
        fault.spared_the_others()?;
        run.kept_its_pace()
    });
}

#[test]
fn a_short_stop_makes_a_channel_late_and_nothing_else() {
    in_time(|| {
        let run = Run::new(&["at 40 stop 600ms front-1-1"], 110);
        let fault = run.fault(0);
        fault.went_through(&["late", "live"])?;
        assert!(!run.log.contains("server is lost"), "the connection holds");
        let woke_ms = fault.ms_after("drew_again_ms")?;
        hold(woke_ms <= 250.0, "milliseconds from waking to the current frame", &woke_ms)?;
        fault.spared_the_others()
    });
}

#[test]
fn a_slow_server_is_late_and_shows_every_frame_that_it_can() {
    in_time(|| {
        let run = Run::new(&["at 40 slow 200ms for 3s front-2-2"], 160);
        let fault = run.fault(0);
        fault.went_through(&["late", "live"])?;
        // In these 3 s the wall shows 90 frames, and it shows at most 15 of them.
        let shown = run.channel("front-2-2")["frames"].as_u64().expect("a number");
        hold((72..=100).contains(&shown), "frames shown of 160", &shown)?;
        let gap_ms = run.channel("front-2-2")["longest_gap_ms"].as_f64().expect("a number");
        hold(gap_ms <= 700.0, "longest gap of the slow channel", &gap_ms)?;
        fault.spared_the_others()?;
        run.kept_its_pace()
    });
}

#[test]
fn a_report_says_what_was_not_done_and_who_never_came_back() {
    let run = Run::new(&["at 40 stop 600s front-1-1", "at 45 stop 1s front-1-1"], 60);
    let [forever, again] = [0, 1].map(|index| run.fault(index).record.clone());
    assert!(forever["live_again_ms"].is_null() && forever["over_ms"].is_null(), "{forever}");
    assert!(run.log.contains("stop 600s front-1-1: not live again"), "{}", run.log);
    assert_eq!(again["skipped"], "its server is stopped already");
    assert!(run.log.contains("stop 1s front-1-1: not done, its server is stopped already"));
    let channel = run.channel("front-1-1");
    assert!(channel["state"] == "late" || channel["state"] == "lost", "{channel}");
    let gap_ms = channel["longest_gap_ms"].as_f64().expect("a number");
    assert!(gap_ms >= 500.0, "20 frames at 30 a second are a gap, though no frame ended it");
}
