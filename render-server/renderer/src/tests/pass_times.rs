//! The time of each pass: measured where there is one, in one frame of eight, and no longer than
//! the frame.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use polyptych_scene::{
    AmbientOcclusion, DepthOfField, FramePass, Glow, Light, LightKind, Material,
    MaterialExtensions, PassTimes, Transmission,
};

use super::harness::{MeshFixture, SceneFixture, gpu, look, matt};
use crate::{DrawStats, GpuScene, Renderer, Target, ViewDesc};

const CANVAS: [u32; 2] = [320, 200];

/// A ball on a floor; with a sun that casts shadows, and of glass, if so asked.
fn ball(has_sun: bool, is_glass: bool) -> GpuScene {
    let mut stage = SceneFixture::new();
    let clear = Transmission { factor: 1.0, texture: None };
    let glass = MaterialExtensions { transmission: Some(clear), ..Default::default() };
    let extensions = is_glass.then(|| Box::new(glass));
    let grey = stage.material(matt(0.6, 0.6, 0.6));
    let own = stage.material(Material { extensions, ..matt(0.6, 0.6, 0.6) });
    let floor = stage.mesh(&MeshFixture::rectangle(4.0, 4.0), Some(grey));
    stage.node(floor, DAffine3::from_quat(DQuat::from_rotation_x(-1.5)));
    let ball = stage.mesh(&MeshFixture::sphere(12), Some(own));
    stage.node(ball, DAffine3::from_translation(DVec3::Y));
    if has_sun {
        let kind = LightKind::Directional;
        let sun = Light { kind, color: Vec3::ONE, intensity: 3.0, range: None };
        stage.light(sun, DAffine3::from_quat(DQuat::from_rotation_x(-0.9)));
    }
    stage.build()
}

/// Sixteen frames of a camera that moves, so that maps of shadows are drawn anew.
fn frames(scene: &GpuScene, of: impl Fn(ViewDesc) -> ViewDesc) -> Vec<DrawStats> {
    let mut renderer = Renderer::new(gpu(), 4).unwrap();
    renderer.prepare(gpu(), scene);
    let at =
        |frame: u32| of(look(DVec3::new(f64::from(frame) * 3.0, 3.0, 8.0), DVec3::ZERO, CANVAS));
    let is_linear = scene.needs_light(at(0).effects());
    let mut target = Target::new(gpu(), CANVAS, 4, is_linear).unwrap();
    (0..16).map(|frame| renderer.draw(gpu(), scene, &mut target, &[at(frame)]).unwrap()).collect()
}

/// The passes that some frame measured.
fn measured(frames: &[DrawStats]) -> Vec<FramePass> {
    let all = frames.iter().fold(PassTimes::default(), |all, of| all.and(of.passes));
    all.iter().filter(|(_, us)| *us > 0).map(|(pass, _)| pass).collect()
}

#[test]
fn a_pass_is_measured_where_there_is_one() {
    assert!(gpu().has_timestamps(), "this driver has no timestamps, so nothing is tested");
    let plain = frames(&ball(false, false), |view| view);
    assert_eq!(measured(&plain), [FramePass::Scene]);
    let effects = |view| ViewDesc {
        glow: Some(Glow::new(0.2)),
        ambient_occlusion: Some(AmbientOcclusion { radius: 0.5 }),
        depth_of_field: Some(DepthOfField::new(6.0)),
        ..view
    };
    let all = frames(&ball(true, true), effects);
    let wanted = [
        FramePass::Shadows,
        FramePass::AmbientOcclusion,
        FramePass::DepthOfField,
        FramePass::Glass,
        FramePass::Glow,
        FramePass::Scene,
        FramePass::ToneMapping,
    ];
    assert_eq!(measured(&all), wanted);
    for (at, of) in plain.iter().chain(&all).enumerate() {
        assert_eq!(of.passes.is_measured(), at % 8 == 1, "frame {at}");
        // The GPU's time is taken from outside, and has all of them in it.
        let sum: u64 = of.passes.iter().map(|(_, us)| u64::from(us)).sum();
        assert!(sum <= of.gpu_us + of.encode_us + of.cull_us, "frame {at}: {of:?}");
    }
}

#[test]
fn all_channels_of_a_round_are_measured() {
    assert!(gpu().has_timestamps(), "this driver has no timestamps, so nothing is tested");
    let scene = ball(false, false);
    let mut renderer = Renderer::new(gpu(), 4).unwrap();
    renderer.prepare(gpu(), &scene);
    let views = [look(DVec3::new(0.0, 3.0, 8.0), DVec3::ZERO, CANVAS)];
    let is_linear = scene.needs_light(views[0].effects());
    let mut targets = [0, 1].map(|_| Target::new(gpu(), CANVAS, 4, is_linear).unwrap());
    for round in 1..=16 {
        let begun = targets.each_mut().map(|to| renderer.begin(gpu(), &scene, to, &views).unwrap());
        let with_begun = targets.iter_mut().zip(begun);
        let submitted: Vec<_> = with_begun
            .map(|(to, begun)| renderer.submit(gpu(), &scene, to, begun).unwrap())
            .collect();
        for (to, frame) in targets.iter_mut().zip(submitted) {
            let passes = renderer.finish(gpu(), to, frame).unwrap().passes;
            assert_eq!(passes.is_measured(), round % 8 == 2, "round {round}");
        }
    }
}
