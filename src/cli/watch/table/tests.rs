//! The table of walls that are well, ill, large and gone.

use polyptych_client::glam::DVec3;
use polyptych_client::{
    ChannelState, ChannelStatus, HeadPose, OutputMode, Presentation, Skew, WallStatus,
};
use polyptych_protocol::ids::{Digest, Epoch, FrameId, Revision};
use unicode_width::UnicodeWidthStr;

use super::*;

/// A wall whose channels are all live.
pub fn wall(channels: usize) -> WallStatus {
    let channel = |index: usize| ChannelStatus {
        name: format!("front-{}-1", index + 1),
        state: ChannelState::Live,
        since_ms: 12_300,
        reason: None,
        pid: Some(100 + index as u32),
        address: Some("127.0.0.1:5000".into()),
        adapter: Some("llvmpipe".into()),
        frame: FrameId(1234),
        revision: Revision(3),
        late: 0,
        draw_us: Some(41_230),
        skew: Skew { frames: 100, p50_us: 120, p99_us: 310, max_us: 900, clock_error_us: Some(60) },
        memory_bytes: 199_000_000,
        scene_bytes: 0,
    };
    WallStatus {
        wall: "small".into(),
        epoch: Epoch(1),
        revision: Revision(3),
        digest: Digest::default(),
        frame: FrameId(1235),
        scene: Some("town".into()),
        deadline_ms: 164.9,
        error_in_force_px: 0.0,
        channels: (0..channels).map(channel).collect(),
        clients: vec!["orbit".into()],
        warnings: Vec::new(),
        notes: Vec::new(),
        opening: Vec::new(),
        memory_bytes: 81_000_000,
        resolution_scale: 1.0,
        environment: None,
        rest: polyptych_client::RestStatus::default(),
        devices: Vec::new(),
        leader: None,
        presentation: Presentation::new(HeadPose::facing_forward(DVec3::X, 0.05)),
    }
}

fn trouble(status: &mut WallStatus, index: usize, state: ChannelState, reason: &str) {
    let channel = &mut status.channels[index];
    channel.state = state;
    channel.reason = Some(reason.into());
}

/// The text of every line; nothing may reach beyond the terminal.
fn drawn(view: &WatchModel, width: usize, height: usize) -> Vec<String> {
    let lines = lines(view, width, height);
    assert!(lines.len() <= height, "{} lines of {height}", lines.len());
    let text = |line: Line| line.into_iter().map(|piece| piece.text).collect::<String>();
    let lines: Vec<String> = lines.into_iter().map(text).collect();
    for line in &lines {
        assert!(line.width() <= width, "{} columns of {width}: {line}", line.width());
        assert!(!line.contains(char::is_control), "{line:?}");
    }
    lines
}

fn of<'a>(status: &'a WallStatus, rates: &'a Rates) -> WatchModel<'a> {
    WatchModel { status: Some(status), rates, trouble: None }
}

#[test]
fn a_wall_that_is_well_has_a_line_for_each_channel() {
    let mut status = wall(2);
    let mut rates = Rates::default();
    rates.add(0.0, &status);
    status.frame.0 += 60;
    status.channels[0].frame.0 += 60;
    rates.add(2.0, &status);
    assert_eq!(
        drawn(&of(&status, &rates), 100, 24),
        [
            "wall small  scene town  revision 3  frame 1295  30.0 fps  deadline 165 ms  1 client",
            "2 live",
            "CHANNEL    STATE     FOR  FRAME   FPS     DRAW  SKEW P50/P99/MAX ±CLOCK  LATE  \
             MEMORY  PID",
            "front-1-1  live   12.3 s   1294  30.0  41.2 ms       120/310/900 ±60 µs     0  \
             199 MB  100",
            "front-2-1  live   12.3 s   1234   0.0  41.2 ms       120/310/900 ±60 µs     0  \
             199 MB  101",
            "q ends",
        ]
    );
}

#[test]
fn one_look_and_a_watched_table_say_the_same() {
    let mut status = wall(3);
    trouble(&mut status, 1, ChannelState::Lost, "it closed the connection");
    status.warnings = (0..5).map(|n| format!("number {n}")).collect();
    status.presentation.output_mode = OutputMode::Blank;
    status.presentation.pattern = polyptych_client::TestPattern::from_name("grid");
    let rates = Rates::default();
    let looked = text(&status);
    let looked: Vec<&str> = looked.lines().collect();
    let watched = drawn(&of(&status, &rates), 400, 100);
    assert_eq!(looked[2], "displays: blank, until: polyptych blank --off");
    assert_eq!(looked[3], "pattern: grid, until: polyptych pattern --off");
    let of_both: Vec<&str> =
        looked.iter().copied().filter(|line| watched.iter().any(|other| other == line)).collect();
    // Only warnings without room are counted instead.
    assert_eq!(of_both.len(), looked.len() - 3, "{looked:#?} {watched:#?}");
    assert_eq!((watched.len(), looked.len()), (12, 13));
    assert!(looked[9].starts_with("CHANNEL") && looked[9].ends_with("PID  ADDRESS         REASON"));
}

#[test]
fn a_state_is_a_word_and_a_colour() {
    let mut status = wall(3);
    trouble(&mut status, 1, ChannelState::Late, "frame 7 was not drawn within 50 ms");
    trouble(&mut status, 2, ChannelState::Lost, "it closed the connection");
    let rates = Rates::default();
    let lines = lines(&of(&status, &rates), 120, 24);
    let tones = |word: &str| {
        let pieces = lines.iter().flatten().filter(|piece| piece.text.trim() == word);
        pieces.map(|piece| piece.tone).collect::<Vec<_>>()
    };
    assert_eq!(tones("live"), [Tone::Good]);
    assert_eq!(tones("late"), [Tone::Warning]);
    assert_eq!(tones("lost"), [Tone::Bad]);
    let text = drawn(&of(&status, &rates), 120, 24);
    assert_eq!(text[1], "1 lost, 1 late, 1 live");
    assert!(text[4].ends_with("frame 7 was not drawn within 50 ms"), "{text:?}");
}

#[test]
fn a_large_wall_shows_trouble_first_and_counts_the_rest() {
    let mut status = wall(64);
    trouble(&mut status, 60, ChannelState::Lost, "no server has claimed it yet");
    trouble(&mut status, 30, ChannelState::Late, "frame 7 was not drawn within 50 ms");
    let rates = Rates::default();
    let lines = drawn(&of(&status, &rates), 100, 12);
    assert_eq!(lines.len(), 12);
    assert!(lines[3].starts_with("front-61-1") && lines[3].contains("no server"), "{lines:?}");
    assert!(lines[4].starts_with("front-31-1") && lines[4].contains("late"), "{lines:?}");
    assert!(lines[5].starts_with("front-1-1"), "then the wall's order: {lines:?}");
    assert_eq!(lines[10], "and 57 more: 57 live");
    assert_eq!(lines[11], "q ends");
    // All of them, as soon as there is room.
    let lines = drawn(&of(&status, &rates), 100, 68);
    assert!(lines[3].starts_with("front-1-1") && lines[66].starts_with("front-64-1"));
}

#[test]
fn every_size_of_terminal_is_filled_and_not_overrun() {
    let mut status = wall(20);
    status.warnings = vec!["the wall mixes adapters or drivers".repeat(3); 5];
    status.channels[3].name = "顕示装置顕示装置顕示".into();
    trouble(&mut status, 5, ChannelState::Lost, &"the connection failed: reset; ".repeat(9));
    trouble(&mut status, 6, ChannelState::Late, "a\u{1b}[2Jb\nc");
    let rates = Rates::default();
    let gone = || Trouble { manager: "m:1", reason: "refused", since_utc_s: 0, seconds: 3 };
    for width in (0..140).chain([400]) {
        for height in (0..40).chain([100]) {
            drawn(&of(&status, &rates), width, height);
            let view = WatchModel { status: Some(&status), rates: &rates, trouble: Some(gone()) };
            drawn(&view, width, height);
            drawn(&WatchModel { status: None, rates: &rates, trouble: None }, width, height);
        }
    }
}

#[test]
fn a_narrow_terminal_keeps_name_state_and_reason() {
    let mut status = wall(2);
    trouble(&mut status, 1, ChannelState::Lost, "it closed the connection");
    let rates = Rates::default();
    let lines = drawn(&of(&status, &rates), 46, 24);
    assert_eq!(lines[2], "CHANNEL    STATE  REASON");
    assert_eq!(lines[4], "front-2-1  lost   it closed the connection");
    let lines = drawn(&of(&status, &rates), 60, 24);
    assert!(lines[2].contains("LATE") && !lines[2].contains("MEMORY"), "{lines:?}");
}

#[test]
fn a_manager_that_is_gone_is_said_with_the_time() {
    let status = wall(1);
    let rates = Rates::default();
    let trouble = || Trouble {
        manager: "127.0.0.1:7878",
        reason: "no manager at 127.0.0.1:7878",
        since_utc_s: 3_723 + 86_400,
        seconds: 12,
    };
    let view = WatchModel { status: Some(&status), rates: &rates, trouble: Some(trouble()) };
    let lines = drawn(&view, 120, 24);
    assert!(lines[0].starts_with("no answer from 127.0.0.1:7878 since 01:02:03 UTC (12.0 s)"));
    assert!(lines[4].starts_with("front-1-1"), "what was known last stays: {lines:?}");
    assert!(summary(&view).starts_with("no answer from"));
    let view = WatchModel { status: None, rates: &rates, trouble: Some(trouble()) };
    assert_eq!(drawn(&view, 120, 24).len(), 2);
}

#[test]
fn a_summary_is_one_line_with_all_trouble() {
    let mut status = wall(3);
    trouble(&mut status, 2, ChannelState::Lost, "it closed\nthe connection");
    let text = summary(&of(&status, &Rates::default()));
    assert!(text.contains("frame 1235  - fps") && text.contains("1 lost, 2 live"), "{text}");
    assert!(text.ends_with("front-3-1 lost 12.3 s: it closed\\nthe connection"), "{text}");
}
