//! Films of a scripted wall: channels, managers and detail that come late or never.

use polyptych_client::FrameId;

use super::*;

/// A wall on which a channel is missing in these captures.
#[derive(Default)]
struct Script {
    captures: u32,
    draws: u32,
    /// Draws after which more detail comes.
    coarse: u32,
    /// The number of the state that is drawn. Each draw takes a second.
    revision: u64,
    missing: Vec<u32>,
    /// Captures during which the manager goes.
    lost: Vec<u32>,
    /// Captures that the manager does not answer.
    unanswered: Vec<u32>,
    /// Captures for which others leave no room.
    crowded: Vec<u32>,
    waits: u32,
    /// Each takes a second.
    pauses: u32,
    /// The capture during which the film is interrupted; 0 if it is not.
    interrupted: u32,
}

impl FilmSource for Script {
    fn awaits_detail(&mut self, _: f64) -> Result<Option<Revision>, ClientError> {
        self.draws += 1;
        Ok((self.draws <= self.coarse).then_some(Revision(self.revision)))
    }

    fn elapsed(&self) -> Duration {
        Duration::from_secs(u64::from(self.draws + self.pauses))
    }

    fn capture(&mut self, _: f64) -> Result<Capture, ClientError> {
        self.captures += 1;
        if self.lost.contains(&self.captures) {
            let (request, address) = ("capture the wall", "here".to_owned());
            let reason = "it was killed".to_owned();
            return Err(ClientError::ConnectionLost { request, address, reason });
        }
        if self.unanswered.contains(&self.captures) {
            let (request, after) = ("capture the wall", Duration::from_mins(1));
            return Err(ClientError::TimedOut { request, after });
        }
        if self.crowded.contains(&self.captures) {
            let reason = format!("{CAPTURE_ROOM_TAKEN} 570 MiB of 1024 MiB");
            return Err(ClientError::Failed { request: "capture the wall", reason });
        }
        let is_missing = self.missing.contains(&self.captures);
        let missing = is_missing.then(|| ("left".to_owned(), "it is lost".to_owned()));
        Ok(Capture {
            frame: FrameId(u64::from(self.captures)),
            screens: Vec::new(),
            channels: Vec::new(),
            missing: missing.into_iter().collect(),
        })
    }

    fn pause(&mut self) {
        self.pauses += 1;
    }

    fn await_channels(&mut self, _: Duration) -> anyhow::Result<()> {
        self.waits += 1;
        Ok(())
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted != 0 && self.captures >= self.interrupted
    }
}

#[test]
fn a_frame_without_a_channel_is_captured_again_and_told() {
    let mut script = Script { missing: vec![2, 4], lost: vec![3], ..Script::default() };
    let mut flaws = FilmFlaws::default();
    for frame in 0..3 {
        let time_s = f64::from(frame) * 0.5;
        let capture = whole_frame(&mut script, frame, time_s, &mut flaws).expect("whole");
        assert!(capture.missing.is_empty());
    }
    assert_eq!((script.captures, script.waits), (6, 3));
    let [RedrawnFrame { frame: 1, time_s: 0.5, tries: 4, missing, lost: Some(lost) }] =
        &flaws.redrawn[..]
    else {
        panic!("{flaws:?}");
    };
    assert_eq!(missing, &[("left".to_owned(), "it is lost".to_owned())]);
    assert!(lost.contains("it was killed"), "{lost}");
}

#[test]
fn a_frame_whose_manager_hung_is_captured_again() {
    let mut script = Script { unanswered: vec![1], ..Script::default() };
    let mut flaws = FilmFlaws::default();
    whole_frame(&mut script, 0, 0.0, &mut flaws).expect("whole");
    assert_eq!((script.captures, script.waits), (2, 1));
    let lost = flaws.redrawn[0].lost.as_deref().expect("a reason");
    assert!(lost.contains("did not answer"), "{lost}");
}

#[test]
fn a_frame_waits_for_room_beside_captures_of_others_but_not_for_ever() {
    let mut script = Script { crowded: vec![1, 2], ..Script::default() };
    let mut flaws = FilmFlaws::default();
    whole_frame(&mut script, 0, 0.0, &mut flaws).expect("whole");
    assert_eq!((script.captures, script.pauses, script.waits), (3, 2, 0));
    assert!(flaws.redrawn.is_empty(), "nothing of it was missing");
    let mut script = Script { crowded: (1..100).collect(), ..Script::default() };
    let error = whole_frame(&mut script, 7, 0.0, &mut flaws).expect_err("no room");
    assert!(format!("{error:#}").contains("captures on their way"), "{error:#}");
    assert_eq!(u64::from(script.pauses), RETURN_TIME_MAX.as_secs());
}

#[test]
fn a_frame_is_captured_once_its_detail_is_there() {
    let mut script = Script { coarse: 3, ..Script::default() };
    whole_frame(&mut script, 0, 0.0, &mut FilmFlaws::default()).expect("whole");
    assert_eq!((script.draws, script.captures), (4, 1));
    let mut script = Script { coarse: u32::MAX, interrupted: 1, captures: 1, ..script };
    whole_frame(&mut script, 0, 0.0, &mut FilmFlaws::default()).expect("whole");
    assert_eq!((script.draws, script.captures), (5, 2), "an interrupted film waits no longer");
}

#[test]
fn detail_that_does_not_come_is_waited_for_once_and_its_frames_are_counted() {
    let mut script = Script { coarse: u32::MAX, ..Script::default() };
    let mut flaws = FilmFlaws::default();
    let draws = |script: &mut Script, flaws: &mut FilmFlaws| {
        let before = script.draws;
        whole_frame(script, 0, 0.0, flaws).expect("whole");
        (u64::from(script.draws - before), flaws.without_detail)
    };
    let waited = DETAIL_TIME_MAX.as_secs();
    assert_eq!(draws(&mut script, &mut flaws), (waited, 1));
    assert_eq!(draws(&mut script, &mut flaws), (1, 2));
    // Servers hold another part, which does not serve this frame either.
    script.revision += 1;
    assert_eq!(draws(&mut script, &mut flaws), (waited, 3));
    assert_eq!(draws(&mut script, &mut flaws), (1, 4));
    // One that they serve is no sign that they will hold more.
    script.coarse = 0;
    assert_eq!(draws(&mut script, &mut flaws), (1, 4));
    script.coarse = u32::MAX;
    assert_eq!(draws(&mut script, &mut flaws), (1, 5));
    let report = serde_json::to_value(&flaws).expect("JSON");
    assert_eq!(report, serde_json::json!({ "redrawn": [], "without_detail": 5 }));
}

#[test]
fn a_channel_that_stays_away_ends_the_film() {
    let (missing, lost) = ((1..100).collect(), Vec::new());
    let mut script = Script { missing, lost, ..Script::default() };
    let error = whole_frame(&mut script, 7, 0.0, &mut FilmFlaws::default()).expect_err("not whole");
    assert!(error.to_string().starts_with("frame 7 has no picture of channel left: it is lost"));
    assert_eq!((script.captures, script.waits), (TRIES_MAX, TRIES_MAX));
    let (missing, lost) = (Vec::new(), (1..100).collect());
    let mut script = Script { missing, lost, ..Script::default() };
    let error = whole_frame(&mut script, 7, 0.0, &mut FilmFlaws::default()).expect_err("not whole");
    assert!(error.to_string().starts_with("frame 7: the connection to the manager at here"));
}

#[test]
fn an_interrupted_film_ends_with_a_whole_frame_and_waits_for_no_channel() {
    let folder = tempfile::tempdir().expect("a folder");
    let (frames, fps, out) = (100, 10.0, folder.path().display().to_string());
    let begun = || {
        let output = FilmOutput::new(folder.path(), fps).expect("a folder");
        let (written, from_s, flaws, out) = (0, 0.0, FilmFlaws::default(), out.clone());
        (output, FilmReport { out, frames, written, fps, from_s, flaws })
    };
    let (mut output, mut report) = begun();
    let mut script = Script { interrupted: 3, ..Script::default() };
    let silent = ProgressReport::Silent;
    let ended = all_frames(&mut script, &mut output, &mut report, &silent);
    assert_eq!(ended.expect_err("not whole").to_string(), "interrupted after 3 of 100 frames");
    assert_eq!((script.captures, report.written), (3, 3));

    let (mut output, mut report) = begun();
    let missing = (1..100).collect();
    let mut script = Script { interrupted: 1, missing, ..Script::default() };
    let ended = all_frames(&mut script, &mut output, &mut report, &silent);
    assert!(ended.expect_err("not whole").to_string().contains("channel left: it is lost"));
    assert_eq!((script.captures, script.waits, report.written), (1, 0, 0));
}
