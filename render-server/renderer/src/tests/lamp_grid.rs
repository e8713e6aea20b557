//! Many lamps over one ground: the grid of cells against lists of all that reach some of the
//! ground.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use polyptych_scene::{Light, LightKind, Material, NodeTraits};

use super::harness::{MeshFixture, SceneFixture, differences, draw, drawn, look, matt};
use crate::{GpuScene, ViewDesc};

const SIZE: [u32; 2] = [160, 90];

/// A ground of 200 × 200 metres and a ball, far from the origin, below lamps of every kind: every
/// fifth one is a spot light, and some have no end.
fn street(lamps: u32, endless: u32) -> SceneFixture {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::splat(0.01);
    let paved = stage.material(Material { roughness: 0.4, ..matt(0.6, 0.55, 0.5) });
    let at = DVec3::new(2e4, -30.0, 1e4);
    let lying = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let ground = stage.mesh(&MeshFixture::rectangle(100.0, 100.0), Some(paved));
    stage.node(ground, DAffine3::from_rotation_translation(lying, at));
    let ball = stage.mesh(&MeshFixture::sphere(24), Some(paved));
    let size = DVec3::splat(6.0);
    stage.node(ball, DAffine3::from_scale_rotation_translation(size, DQuat::IDENTITY, at));
    // A lattice that looks random: steps of the golden ratio and its square.
    let place = |index: u32| {
        let [u, v] = [0.754_877_666, 0.569_840_291].map(|step| (f64::from(index) * step).fract());
        at + DVec3::new(u * 180.0 - 90.0, 1.5 + f64::from(index % 4), v * 180.0 - 90.0)
    };
    for index in 0..lamps {
        let spot = LightKind::Spot { inner_rad: 0.3, outer_rad: 0.9 };
        let kind = if index % 5 == 0 { spot } else { LightKind::Point };
        let color = Vec3::new(1.0, 0.5 + (index % 3) as f32 * 0.25, 0.6);
        let range = (index % (lamps / endless) != 7).then_some(7.0 + (index % 6) as f32);
        let down = DAffine3::from_rotation_translation(lying, place(index));
        stage.light(Light { kind, color, intensity: 12.0, range }, down);
    }
    stage
}

/// The scene with the grid, and with lists: lights that may move are in no grid.
fn both(stage: &SceneFixture) -> [GpuScene; 2] {
    let nodes = stage.desc.nodes.len();
    let moving = (0..nodes as u32).filter(|&at| stage.desc.nodes[at as usize].light.is_some());
    let traits = NodeTraits { moving: moving.collect(), ..NodeTraits::of_file(nodes) };
    let [grid, lists] = [stage.build(), stage.build_with(&traits)];
    assert!(grid.layout.lights.grid.is_some() && lists.layout.lights.grid.is_none());
    [grid, lists]
}

fn view(has_shadows: bool) -> ViewDesc {
    let at = DVec3::new(2e4, -30.0, 1e4);
    let view = look(at + DVec3::new(-30.0, 18.0, 60.0), at, SIZE);
    ViewDesc { has_shadows, ..view }
}

/// Time of both cores that this process has had, in milliseconds.
fn processor_ms() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(") ").next().unwrap_or_default().split(' ');
    fields.skip(11).take(2).filter_map(|of| of.parse::<f64>().ok()).sum::<f64>() * 10.0
}

#[test]
fn lamps_of_cells_make_the_picture_of_lists_of_all_lamps() {
    let scenes = both(&street(500, 5));
    for has_shadows in [false, true] {
        let pictures = scenes.each_ref().map(|scene| {
            let start = processor_ms();
            let picture = draw(scene, SIZE, &view(has_shadows));
            println!("shadows {has_shadows}: {} ms of a processor", processor_ms() - start);
            picture
        });
        assert!(drawn(&pictures[0]) > SIZE[0] as usize * SIZE[1] as usize / 2);
        assert_eq!(differences(&pictures[0], &pictures[1]), [0; 3]);
    }
}
