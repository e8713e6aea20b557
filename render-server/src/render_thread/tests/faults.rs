//! Channels that cannot draw, beside those that can, displays that take no frames, and a GPU
//! whose memory runs out.

use polyptych_files::blob::BlobHash;
use polyptych_renderer::GpuFaultKind;
use polyptych_scene::{LightEffects, Sampler, Texture, TextureFormat};

use super::preparation::with_effects;
use super::*;

impl RenderThreadFixture {
    /// Draws and shows a frame. Returns the channels that drew it, whose pictures were sent, that
    /// failed, and that showed it.
    fn told(&mut self, exposure: f32) -> [Vec<u16>; 4] {
        self.draw(exposure, OutputMode::Normal);
        let (frame, not_after_us, present_at_us) = (FrameId(self.frame), u64::MAX, None);
        let swap = Swap { epoch: EPOCH, frame, not_after_us, present_at_us };
        self.thread.handle(RenderTask::Swap(swap));
        self.turn();
        let mut told: [Vec<u16>; 4] = Default::default();
        while let Ok(report) = self.reports.try_recv() {
            let (index, channel) = match report {
                RenderEvent::Status(ServerMessage::Drawn(of)) => (0, of.channel),
                RenderEvent::Picture(of) => (1, of.channel),
                RenderEvent::Status(ServerMessage::DrawFailed { channel, .. }) => (2, channel),
                RenderEvent::Status(ServerMessage::Shown(of)) => (3, of.channel),
                RenderEvent::Status(_) => continue,
            };
            told[index].push(channel.0);
        }
        told
    }
}

#[test]
fn a_channel_that_cannot_draw_does_not_hold_up_the_others_of_its_server() {
    let mut stage = RenderThreadFixture::new();
    let beside = ChannelOutput::offscreen(&stage.thread.gpu, "front-1-2", SIZE, None);
    stage.thread.outputs.push(beside);
    let two = |width| {
        let mut wall = wall();
        wall.screens[0].canvas.x *= 2;
        let (origin, size) = (UVec2::new(SIZE[0], 0), UVec2::new(width, SIZE[1]));
        let channel = Channel::tile("front-1-2", 0, origin, size);
        wall.channels.push(Channel { server: "left".into(), ..channel });
        wall
    };
    let seen = |stage: &RenderThreadFixture| {
        let outputs = stage.thread.outputs.iter();
        outputs.map(|output| output.read_back(&stage.thread.gpu)).collect::<Vec<_>>()
    };
    stage.prepare(two(SIZE[0]));
    assert_eq!(stage.told(0.5), [vec![0u16, 1], vec![0, 1], vec![], vec![0, 1]]);
    let before = seen(&stage);
    // No adapter has a texture of this width.
    stage.prepare(two(1 << 24));
    for exposure in [0.7, 0.9] {
        assert_eq!(stage.told(exposure), [vec![0u16], vec![0], vec![1], vec![0]]);
    }
    let during = seen(&stage);
    assert_ne!(during[0], before[0], "it goes on");
    assert_eq!(during[1], before[1], "it keeps its picture");
    stage.prepare(two(SIZE[0]));
    assert_eq!(stage.told(0.3), [vec![0u16, 1], vec![0, 1], vec![], vec![0, 1]]);
    assert_ne!(seen(&stage)[1], before[1]);
}

#[test]
fn a_display_that_takes_no_frames_does_not_cost_the_picture_that_somebody_asked_for() {
    let mut stage = RenderThreadFixture::new();
    stage.thread.outputs[0].is_broken = true;
    for exposure in [0.5, 0.9] {
        // A failure to draw would have the manager drop the picture.
        assert_eq!(stage.told(exposure), [vec![0u16], vec![0], vec![], vec![]]);
    }
    let reported = stage.thread.outputs[0].reported.as_deref();
    assert_eq!(reported, Some("its display takes no frames: it is to be so"));
    stage.thread.outputs[0].is_broken = false;
    assert_eq!(stage.told(0.7), [vec![0u16], vec![0], vec![], vec![0]]);
    assert_eq!(stage.thread.outputs[0].reported, None);
}

/// A scene that holds a texture of one pixel.
fn textured(gpu: &Gpu) -> SceneBuilder {
    let texture = Texture {
        blob: BlobHash::of(b"white"),
        format: TextureFormat::Rgba8Srgb,
        width: 1,
        height: 1,
        mip_count: 1,
        sampler: Sampler::default(),
    };
    let desc = Scene { sky: Vec3::ONE, textures: vec![texture], ..Scene::default() };
    let mut builder = SceneBuilder::new(gpu, desc).expect("a scene");
    builder.upload_texture(gpu, 0, &[255; 4]).expect("uploaded");
    builder
}

/// A render thread that draws a scene with a texture, and the state that it draws.
fn with_texture() -> (RenderThreadFixture, Arc<LoadedState>) {
    let mut stage = RenderThreadFixture::new();
    let before = Arc::clone(&stage.thread.states.back().expect("a state").state);
    let state = with_effects(&before, LightEffects::NONE);
    stage.thread.building = Some(textured(&stage.thread.gpu));
    finish(&mut stage.thread, Arc::clone(&state));
    stage.draw(0.5, OutputMode::Normal);
    (stage, state)
}

#[test]
fn memory_that_runs_out_where_two_scenes_are_held_costs_no_level_of_textures() {
    let run_out = |stage: &RenderThreadFixture| {
        stage.thread.gpu.give_up(GpuFaultKind::OutOfMemory, "it is full, for a test");
    };
    let left_out = |stage: &mut RenderThreadFixture| {
        let fault = stage.thread.gpu.first_fault().expect("a fault");
        stage.thread.recover(&fault).expect("opened again");
        stage.thread.losses.levels_left_out
    };
    let (mut stage, _) = with_texture();
    run_out(&stage);
    assert_eq!(left_out(&mut stage), 1, "the scene is alone");

    let (mut stage, state) = with_texture();
    stage.thread.building = Some(textured(&stage.thread.gpu));
    finish(&mut stage.thread, with_effects(&state, LightEffects::NONE));
    run_out(&stage);
    assert_eq!(left_out(&mut stage), 0, "the next one waits for other servers");

    let (mut stage, state) = with_texture();
    let scene = textured(&stage.thread.gpu).finish(&stage.thread.gpu).expect("a scene");
    run_out(&stage);
    let next = with_effects(&state, LightEffects::NONE);
    let completed = stage.thread.complete(next, Rc::new(scene), true);
    completed.expect_err("the next one is drawn once, which fails");
    assert_eq!(left_out(&mut stage), 0, "it was the last step");
    assert!(!stage.thread.is_completing);
}
