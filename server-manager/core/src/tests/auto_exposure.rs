//! Automatic exposure: by what all channels show, in time that the test owns.

use polyptych_protocol::luminance::{FrameLuminance, LUMINANCE_COUNTS, luminance_index};
use polyptych_protocol::pattern::TestPattern;

use super::*;

/// Returns a channel's counts of a picture with this luminance all over, except for corners without
/// light and a lamp that is too bright to be counted.
fn counts(luminance: f32) -> Vec<u32> {
    let mut counts = vec![0; LUMINANCE_COUNTS];
    let at = luminance_index(luminance).expect("light");
    counts[at] = 900;
    (counts[0], counts[LUMINANCE_COUNTS - 1]) = (60, 40);
    counts
}

/// The exposure that shows it as middle grey, in stops.
fn due(luminance: f32) -> f64 {
    (0.18 / f64::from(luminance)).log2()
}

impl ClusterFixture {
    /// A wall of two channels that shows a scene and is exposed automatically.
    fn exposed() -> Self {
        let mut stage = Self::new(2);
        let job = ClientRequest { client: CLIENT, id: RequestId(99) };
        stage.cluster.handle_import(stage.now, job, Ok(Self::imported()));
        stage.read();
        stage.prepare_all();
        stage.request(Request::SetAutomaticExposure);
        stage
    }

    /// Time passes; frames are drawn in 20 ms each, and `light` is what channels show of those
    /// that are metered. Returns how many were drawn.
    fn light_for(&mut self, micros: Micros, light: &[Option<f32>; 2]) -> usize {
        let (end, mut drawn) = (self.now + micros, 0);
        while self.now < end {
            let Some(newest) = self.cluster.pipeline.newest().map(|barrier| barrier.frame) else {
                self.wait(10_000);
                continue;
            };
            drawn += 1;
            self.draw(&[0, 1], 20_000);
            let frame = self.frames.last().expect("sent").1.clone();
            assert_eq!(frame.frame, newest);
            for (channel, luminance) in (0..).zip(light) {
                if let Some(luminance) = luminance.filter(|_| frame.is_metered) {
                    // Channels tell 16 stops above white.
                    let most = 65536.0 / frame.presentation.exposure;
                    self.tell(channel, frame.frame, counts(luminance.min(most)));
                }
            }
        }
        drawn
    }

    fn tell(&mut self, channel: u16, frame: FrameId, counts: Vec<u32>) {
        let of = FrameLuminance { epoch: Epoch(7), frame, channel: ChannelId(channel), counts };
        self.say(SessionId(u64::from(channel)), ServerMessage::Luminance(of));
    }

    fn stops(&self) -> f64 {
        f64::from(self.cluster.presentation.exposure).log2()
    }
}

/// Channels count to an eighth of a stop, and the shares that do not count are not alike.
const NEAR: f64 = 0.25;

#[test]
fn the_first_metered_frame_sets_the_exposure_at_once_and_then_the_wall_rests() {
    let mut stage = ClusterFixture::exposed();
    let drawn = stage.light_for(200_000, &[Some(4.0); 2]);
    assert!((stage.stops() - due(4.0)).abs() < NEAR, "{}", stage.stops());
    assert!(drawn <= 3, "{drawn} frames");
    let pictures: Vec<_> = stage.frames.iter().map(|(_, f)| f.presentation.exposure).collect();
    assert_eq!(pictures.last(), Some(&stage.cluster.presentation.exposure));
    stage.light_for(1_000_000, &[Some(4.0); 2]);
    assert_eq!(stage.light_for(10_000_000, &[Some(4.0); 2]), 0, "nothing more is drawn");
}

#[test]
fn both_halves_of_a_wall_count_alike_and_a_silent_one_does_not() {
    let mut stage = ClusterFixture::exposed();
    stage.light_for(1_000_000, &[Some(1.0), Some(16.0)]);
    assert!((stage.stops() - due(4.0)).abs() < NEAR, "the mean of both: {}", stage.stops());

    let mut stage = ClusterFixture::exposed();
    stage.request(Request::Run(Pacing::Rate(30.0)));
    stage.light_for(5_000_000, &[Some(1.0), None]);
    assert!((stage.stops() - due(1.0)).abs() < NEAR, "{}", stage.stops());
}

#[test]
fn a_wall_adapts_by_the_time_that_passes_whatever_its_rate() {
    let way = |rate: f64| {
        let mut stage = ClusterFixture::exposed();
        stage.request(Request::Run(Pacing::Rate(rate)));
        stage.light_for(1_000_000, &[Some(1.0); 2]);
        stage.light_for(700_000, &[Some(32.0); 2]);
        let early = stage.stops();
        stage.light_for(4_000_000, &[Some(32.0); 2]);
        assert!((stage.stops() - due(32.0)).abs() < NEAR, "{}", stage.stops());
        early
    };
    let [slow, fast] = [12.0, 40.0].map(way);
    let done = |stops: f64| (stops - due(1.0)) / (due(32.0) - due(1.0));
    assert!(done(slow) > 0.4 && done(slow) < 0.95, "on the way: {}", done(slow));
    assert!((done(slow) - done(fast)).abs() < 0.3, "{} and {}", done(slow), done(fast));
}

#[test]
fn what_is_brighter_than_channels_can_tell_is_metered_again_at_once() {
    let mut stage = ClusterFixture::exposed();
    stage.light_for(1_000_000, &[Some(2e9); 2]);
    assert!((stage.stops() - due(2e9)).abs() < NEAR, "{} not {}", stage.stops(), due(2e9));
}

#[test]
fn a_moved_camera_of_a_paused_wall_is_metered_in_the_end() {
    let mut stage = ClusterFixture::exposed();
    stage.light_for(270_000, &[Some(1.0); 2]);
    // So soon after a metered frame that this one is not.
    stage.request(Request::RenderFrame { camera: Some(Camera::IDENTITY), time_s: None });
    assert!(!stage.frames.last().expect("sent").1.is_metered);
    stage.light_for(5_000_000, &[Some(32.0); 2]);
    assert!((stage.stops() - due(32.0)).abs() < NEAR, "{}", stage.stops());
    assert_eq!(stage.light_for(5_000_000, &[Some(32.0); 2]), 0, "and then it rests");
}

#[test]
fn black_patterns_and_hostile_counts_change_nothing() {
    let mut stage = ClusterFixture::exposed();
    let frame = stage.frames.last().expect("sent").1.clone();
    assert!(frame.is_metered);
    stage.draw(&[0, 1], 20_000);
    // Of another channel, of another frame, of any length, and all black.
    stage.tell(0, FrameId(frame.frame.0 + 7), counts(9.0));
    let foreign = FrameLuminance {
        epoch: Epoch(7),
        frame: frame.frame,
        channel: ChannelId(1),
        counts: counts(9.0),
    };
    stage.say(SessionId(0), ServerMessage::Luminance(foreign));
    stage.tell(0, frame.frame, vec![0; 100_000]);
    stage.tell(1, frame.frame, Vec::new());
    assert_eq!(stage.cluster.presentation.exposure, 1.0);
    // Again, and as many as can be.
    stage.tell(1, frame.frame, vec![u32::MAX; LUMINANCE_COUNTS]);
    assert_eq!(stage.cluster.presentation.exposure, 1.0);

    stage.request(Request::SetPattern(Some(TestPattern::Grid)));
    stage.light_for(2_000_000, &[Some(9.0); 2]);
    assert!(!stage.frames.last().expect("sent").1.is_metered, "a pattern is not metered");
    assert_eq!(stage.cluster.presentation.exposure, 1.0);
}

#[test]
fn an_exposure_that_is_set_ends_it_and_another_scene_and_manager_do_not() {
    let mut stage = ClusterFixture::exposed();
    stage.light_for(500_000, &[Some(4.0); 2]);
    let wall = stage.cluster.wall.clone();
    let memory = stage.cluster.persistent_state();
    let restored = Cluster::restore(wall, Epoch(9), &memory);
    assert!(restored.presentation.is_exposure_automatic);
    assert_eq!(restored.presentation.exposure, stage.cluster.presentation.exposure);

    let job = ClientRequest { client: CLIENT, id: RequestId(98) };
    let mut imported = ClusterFixture::imported();
    imported.summary.exposure = 0.001;
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    stage.prepare_all();
    assert_eq!(stage.cluster.presentation.exposure, 0.001, "metering begins where it suits");
    stage.order_frame();
    stage.light_for(500_000, &[Some(800.0); 2]);
    assert!((stage.stops() - due(800.0)).abs() < NEAR, "{}", stage.stops());

    stage.request(Request::SetExposure(0.5));
    assert!(!stage.cluster.presentation.is_exposure_automatic);
    stage.order_frame();
    stage.light_for(2_000_000, &[Some(800.0); 2]);
    assert!(!stage.frames.last().expect("sent").1.is_metered);
    assert_eq!(stage.cluster.presentation.exposure, 0.5);
    // From black, too.
    stage.request(Request::SetExposure(0.0));
    stage.request(Request::SetAutomaticExposure);
    stage.light_for(500_000, &[Some(800.0); 2]);
    assert!((stage.stops() - due(800.0)).abs() < NEAR, "{}", stage.stops());
}
