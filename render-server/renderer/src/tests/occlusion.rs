//! Items that others hide: pictures with and without them are equal, bit for bit.

use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4, Vec3};
use polyptych_scene::{AlphaMode, Light, LightKind, Material};
use proptest::prelude::*;

use super::harness::{MeshFixture, SceneFixture, differences, drawn, gpu, look, matt};
use crate::{DrawStats, GpuScene, OcclusionCulling, Renderer, Target, ViewDesc, read_pixels};

const SIZE: [u32; 2] = [160, 96];

/// Draws frames, each of some views, and returns the pictures and numbers of all.
fn frames(
    scene: &GpuScene,
    samples: u32,
    when: OcclusionCulling,
    frames: &[Vec<ViewDesc>],
) -> Vec<(Vec<[u8; 4]>, DrawStats)> {
    let mut renderer = Renderer::new(gpu(), samples).unwrap();
    renderer.set_occlusion(when);
    renderer.prepare(gpu(), scene);
    let mut target = Target::new(gpu(), SIZE, samples, scene.has_transparency()).unwrap();
    let mut draw = |views: &Vec<ViewDesc>| {
        let stats = renderer.draw(gpu(), scene, &mut target, views).unwrap();
        (read_pixels(gpu(), &target).unwrap().as_chunks::<4>().0.to_vec(), stats)
    };
    frames.iter().map(&mut draw).collect()
}

/// Draws with and without, expects equal pictures, and returns the numbers of those with.
fn expect_equal(scene: &GpuScene, samples: u32, all: &[Vec<ViewDesc>]) -> Vec<DrawStats> {
    let with = frames(scene, samples, OcclusionCulling::Always, all);
    let without = frames(scene, samples, OcclusionCulling::Never, all);
    for (frame, (with, without)) in with.iter().zip(&without).enumerate() {
        assert_eq!(differences(&with.0, &without.0), [0; 3], "frame {frame}: {:?}", with.1);
        assert_eq!(without.1.occluded, 0);
        let items = |stats: &DrawStats| stats.visible + stats.occluded;
        assert_eq!(items(&with.1), items(&without.1));
    }
    with.into_iter().map(|(_, stats)| stats).collect()
}

/// Materials of all kinds, by number.
fn paint(stage: &mut SceneFixture, kind: u32) -> u32 {
    let shade = 0.2 + 0.1 * (kind % 7) as f32;
    let plain = matt(shade, 1.0 - shade, 0.5);
    let material = match kind % 6 {
        0 | 1 => plain,
        2 => Material { double_sided: true, ..plain },
        3 => Material {
            base_color: plain.base_color.with_w(0.3),
            alpha_mode: AlphaMode::Mask(0.5),
            ..plain
        },
        4 => Material {
            alpha_mode: AlphaMode::Blend,
            base_color: plain.base_color.with_w(0.5),
            ..plain
        },
        _ => Material { unlit: true, ..plain },
    };
    stage.material(material)
}

/// A box of half sides 1, seen from outside.
fn cube() -> MeshFixture {
    let mut shape = MeshFixture::default();
    for (normal, right) in [
        (Vec3::X, Vec3::NEG_Z),
        (Vec3::NEG_X, Vec3::Z),
        (Vec3::Y, Vec3::X),
        (Vec3::NEG_Y, Vec3::X),
        (Vec3::Z, Vec3::X),
        (Vec3::NEG_Z, Vec3::NEG_X),
    ] {
        let up = normal.cross(right);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| {
            shape.push(normal + right * x + up * y, normal, right, glam::Vec2::new(x, y))
        });
        let [a, b, c, d] = corners;
        shape.indices.extend([a, b, c, a, c, d]);
    }
    shape
}

/// A placed shape: which, its material, place, turn and sides.
type Placed = (u32, u32, [f64; 3], f64, [f64; 3]);

fn stage_of(all: &[Placed], scale: f64) -> SceneFixture {
    let mut stage = SceneFixture::new();
    let sun = LightKind::Directional;
    stage.light(
        Light { kind: sun, color: Vec3::ONE, intensity: 2.0, range: None },
        DAffine3::from_rotation_x(-0.7),
    );
    let shapes = [cube(), MeshFixture::rectangle(1.0, 1.0), MeshFixture::sphere(6)];
    for (shape, kind, at, turn, sides) in all {
        let material = paint(&mut stage, *kind);
        let mesh = stage.mesh(&shapes[*shape as usize % 3], Some(material));
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.64, 0.48), *turn);
        let (at, sides) = (DVec3::from_array(*at) * scale, DVec3::from_array(*sides) * scale);
        stage.node(mesh, DAffine3::from_scale_rotation_translation(sides, turn, at));
    }
    stage
}

fn side() -> impl Strategy<Value = f64> {
    // Walls, beams and posts: some sides are thin or nothing.
    prop_oneof![2 => 0.2..3.0, 1 => 3.0..12.0, 1 => 0.001..0.02, 1 => Just(0.0)]
}

fn placed() -> impl Strategy<Value = Placed> {
    let at = prop::array::uniform3(-8.0..8.0f64);
    let turn = prop_oneof![1 => Just(0.0), 2 => 0.0..6.0f64];
    (0..3u32, 0..24u32, at, turn, prop::array::uniform3(side()))
}

/// Parallel rays that show this height.
fn plan(eye: DVec3, at: DVec3, height: f64) -> ViewDesc {
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let clip_from_view = DMat4::from_cols(
        DVec4::X * (2.0 / (height * aspect)),
        DVec4::Y * (2.0 / height),
        DVec4::Z / 1e6,
        DVec4::new(0.0, 0.0, 1.0, 1.0),
    );
    ViewDesc { clip_from_view, ..look(eye, at, SIZE) }
}

/// The left and the right half, each for an eye of its own.
fn eyes(view: &ViewDesc, apart: f64) -> Vec<ViewDesc> {
    let [width, height] = SIZE;
    let across = view.view_from_world.row(0) * apart;
    let half = |at: u32, by: f64| ViewDesc {
        eye_in_world: view.eye_in_world + across * by,
        scissor: Some([at * width / 2, 0, width / 2, height]),
        ..view.clone()
    };
    vec![half(0, -0.5), half(1, 0.5)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn leaving_out_what_is_hidden_changes_no_pixel(
        all in prop::collection::vec(placed(), 3..40),
        eyes_at in prop::collection::vec(prop::array::uniform3(-9.0..9.0f64), 1..3),
        scale in prop_oneof![Just(1.0), Just(1e-3), Just(1e4)],
        kind in 0..4u32,
    ) {
        let scene = stage_of(&all, scale).build();
        let views: Vec<Vec<ViewDesc>> = eyes_at
            .iter()
            // Twice: the second one knows what the first one has hidden.
            .flat_map(|at| [at; 2])
            .map(|at| {
                let eye = DVec3::from_array(*at) * scale;
                let view = match kind {
                    0 => plan(eye, DVec3::Y * 0.1, 10.0 * scale),
                    _ => look(eye, DVec3::Y * 0.1, SIZE),
                };
                if kind == 1 { eyes(&view, 0.3 * scale) } else { vec![view] }
            })
            .collect();
        expect_equal(&scene, if kind == 2 { 4 } else { 1 }, &views);
    }
}

/// A wall of a material, and many things behind it.
pub fn behind_a_wall(material: Material) -> GpuScene {
    let mut stage = SceneFixture::new();
    let (wall, other) = (stage.material(material), stage.material(matt(0.8, 0.3, 0.2)));
    let wall = stage.mesh(&MeshFixture::rectangle(4.0, 2.0), Some(wall));
    let ball = stage.mesh(&MeshFixture::sphere(12), Some(other));
    stage.node(wall, DAffine3::IDENTITY);
    for at in 0..60 {
        let place = DVec3::new(f64::from(at % 10) - 4.5, f64::from(at / 10) * 0.5 - 1.2, -6.0);
        let place = DAffine3::from_translation(place);
        stage.node(ball, place * DAffine3::from_scale(DVec3::splat(0.2)));
    }
    stage.build()
}

#[test]
fn things_behind_a_wall_are_left_out_and_beside_it_not() {
    let scene = behind_a_wall(matt(0.5, 0.5, 0.5));
    let before = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    let stats = expect_equal(&scene, 1, &[vec![before.clone()], vec![before.clone()]]);
    assert_eq!([stats[0].occluded, stats[1].occluded], [60, 60], "{stats:?}");
    assert_eq!((stats[0].triangles, stats[0].draw_calls), (2, 1));
    let stats = expect_equal(&scene, 4, &[vec![before]]);
    assert_eq!(stats[0].occluded, 60, "with several samples");
    let from_above = look(DVec3::new(0.0, 6.0, 3.0), DVec3::Z * -5.0, SIZE);
    let stats = expect_equal(&scene, 1, &[vec![from_above]]);
    assert!(stats[0].occluded < 40, "{stats:?}");
    let parallel = plan(DVec3::Z * 3.0, DVec3::ZERO, 3.0);
    let stats = expect_equal(&scene, 1, &[vec![parallel]]);
    assert!(stats[0].occluded > 20, "{stats:?}");
}

#[test]
fn what_can_be_seen_through_hides_nothing() {
    let through = matt(0.5, 0.5, 0.5);
    let alpha = |alpha_mode, alpha: f32| Material {
        alpha_mode,
        base_color: through.base_color.with_w(alpha),
        ..through.clone()
    };
    let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    for material in [alpha(AlphaMode::Blend, 0.4), alpha(AlphaMode::Mask(0.5), 0.2)] {
        let scene = behind_a_wall(material);
        let stats = expect_equal(&scene, 1, &[vec![view.clone()]]);
        assert_eq!(stats[0].occluded, 0);
    }
    // Nor does a wall that is seen from its back, which is not drawn.
    let scene = behind_a_wall(through);
    let back = look(DVec3::Z * -0.5, DVec3::Z * 3.0, SIZE);
    assert_eq!(expect_equal(&scene, 1, &[vec![back]])[0].occluded, 0);
}

#[test]
fn first_drawn_of_one_depth_still_wins() {
    let mut stage = SceneFixture::new();
    let shape = MeshFixture::rectangle(2.0, 1.0);
    for color in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
        let [r, g, b] = color;
        let material = stage.material(Material { unlit: true, ..matt(r, g, b) });
        let mesh = stage.mesh(&shape, Some(material));
        stage.node(mesh, DAffine3::IDENTITY);
        // A tilted one crosses them: of some pixels the depth is the same by chance.
        stage.node(mesh, DAffine3::from_rotation_y(0.01));
    }
    let scene = stage.build();
    let views: Vec<_> = (0..20)
        .map(|at| {
            let at = f64::from(at);
            vec![look(DVec3::new(at * 0.1 - 1.0, 0.3, 2.0 + at * at), DVec3::ZERO, SIZE)]
        })
        .collect();
    expect_equal(&scene, 1, &views);
    let pictures = frames(&scene, 1, OcclusionCulling::Always, &views[..1]);
    assert!(drawn(&pictures[0].0) > 1000);
}

#[test]
fn moving_on_shows_what_was_hidden_before() {
    let scene = behind_a_wall(matt(0.5, 0.5, 0.5));
    let views: Vec<_> = (0..12)
        .map(|at| {
            let eye = DVec3::new(f64::from(at) * 1.2, 0.2, 3.0 - f64::from(at % 3));
            vec![look(eye, DVec3::Z * -4.0, SIZE)]
        })
        .collect();
    let stats = expect_equal(&scene, 1, &views);
    assert!(stats[0].occluded > stats[11].occluded, "{stats:?}");
    assert!(stats[11].visible > 20, "{stats:?}");
}
