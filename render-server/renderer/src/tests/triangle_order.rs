//! Blended triangles of one mesh: drawn from far to near, the same on every channel.

use glam::{Affine2, DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Instance, Material, Node, NodeTraits, TextureFormat, TextureRef};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, drawn, look, pixel,
};
use crate::{GpuScene, ViewDesc};

const SIZE: [u32; 2] = [192, 128];
const TILE: [u32; 2] = [96, 64];
/// Colours of the texture along each side.
const COLORS: u32 = 32;

/// A half transparent material of which each texel has a colour of its own.
fn confetti_material(stage: &mut SceneFixture) -> u32 {
    let texel = |u: f64, v: f64| {
        let [x, y] = [u, v].map(|at| (at * f64::from(COLORS)) as u32);
        let bits = (x + y * COLORS).wrapping_mul(0x9e37_79b9);
        [(bits >> 24) as u8, (bits >> 16) as u8, (bits >> 8) as u8, 255]
    };
    let texture = stage.picture((COLORS, TextureFormat::Rgba8Srgb), texel);
    stage.material(Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, 0.5),
        base_color_texture: Some(TextureRef {
            texture,
            uv_set: 0,
            uv_transform: Affine2::IDENTITY,
        }),
        unlit: true,
        double_sided: true,
        alpha_mode: AlphaMode::Blend,
        ..Material::default()
    })
}

/// Small triangles that lie and turn at random in a cube around the origin, each of one colour; in
/// the order of a file that knows nothing of distances.
fn confetti(count: u32) -> Vec<MeshFixture> {
    let mut state = 7u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24) * 2.0 - 1.0
    };
    let piece = |index: u32| {
        let axis = DVec3::new(random(), random(), random()).normalize_or(DVec3::X);
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, random() * 3.0));
        let place = DVec3::new(random(), random(), random());
        let corners = [DVec3::X, DVec3::new(-0.5, 0.8, 0.0), DVec3::new(-0.5, -0.8, 0.0)];
        let corners = corners.map(|at| (place + turn * at * 0.12).as_vec3());
        let mut shape = MeshFixture::triangle(corners, (turn * DVec3::Z).as_vec3());
        let texel = [index % COLORS, index / COLORS].map(|at| (at as f32 + 0.5) / COLORS as f32);
        for vertex in &mut shape.vertices {
            (vertex[10], vertex[11]) = (texel[0], texel[1]);
        }
        shape
    };
    (0..count).map(piece).collect()
}

/// All triangles of some shapes in one.
fn joined(shapes: &[MeshFixture]) -> MeshFixture {
    let mut all = MeshFixture::default();
    for shape in shapes {
        let first = all.vertices.len() as u32;
        all.vertices.extend(&shape.vertices);
        all.indices.extend(shape.indices.iter().map(|index| first + index));
    }
    all
}

/// The shapes as one mesh, or each as a mesh and node of its own.
fn scene(shapes: &[MeshFixture], as_one: bool) -> GpuScene {
    let mut stage = SceneFixture::new();
    let material = Some(confetti_material(&mut stage));
    if as_one {
        let mesh = stage.mesh(&joined(shapes), material);
        stage.node(mesh, DAffine3::IDENTITY);
    } else {
        for shape in shapes {
            let mesh = stage.mesh(shape, material);
            stage.node(mesh, DAffine3::IDENTITY);
        }
    }
    stage.build()
}

fn views() -> Vec<ViewDesc> {
    let eyes = [DVec3::Z * 3.0, DVec3::Z * -3.0, DVec3::new(2.0, 1.5, -1.0), DVec3::Y * 0.2];
    eyes.map(|eye| look(eye, DVec3::new(0.1, 0.0, 0.0), SIZE)).into()
}

#[test]
fn triangles_of_a_mesh_are_blended_as_separate_nodes_are() {
    let shapes = confetti(400);
    let (one, separate) = (scene(&shapes, true), scene(&shapes, false));
    for view in views() {
        let (ours, stats) = draw_sampled(&one, SIZE, 1, std::slice::from_ref(&view));
        assert_eq!(stats.draw_calls, 1);
        let expected = draw(&separate, SIZE, &view);
        let counts = differences(&ours, &expected);
        println!("{counts:?} of {} pixels", drawn(&expected));
        // Nodes are ordered by the middles of their boxes, triangles by their own: where two are
        // as far away, the one or the other may come first. Without an order a fifth differs.
        assert!(drawn(&expected) > 4000 && counts[0] < ours.len() / 200, "{counts:?}");
    }
}

#[test]
fn panes_of_one_mesh_are_sorted_from_both_sides() {
    let mut panes = Vec::new();
    for (index, z) in [(1u32, 0.0f32), (40, -0.6), (700, -0.3)] {
        let mut pane = MeshFixture::rectangle(1.0, 1.0);
        let texel = Vec2::new((index % COLORS) as f32 + 0.5, (index / COLORS) as f32 + 0.5);
        for vertex in &mut pane.vertices {
            vertex[2] = z;
            (vertex[10], vertex[11]) = (texel.x / COLORS as f32, texel.y / COLORS as f32);
        }
        panes.push(pane);
    }
    let (one, separate) = (scene(&panes, true), scene(&panes, false));
    for z in [2.5, -3.0] {
        let view = look(DVec3::Z * z, DVec3::Z * -0.3, SIZE);
        let ours = draw(&one, SIZE, &view);
        assert_eq!(differences(&ours, &draw(&separate, SIZE, &view)), [0; 3], "from {z}");
        assert!(drawn(&ours) > 2000);
    }
    let middles = [2.5, -3.0].map(|z| {
        let view = look(DVec3::Z * z, DVec3::Z * -0.3, SIZE);
        pixel(&draw(&one, SIZE, &view), SIZE, 96, 64)
    });
    assert_ne!(middles[0], middles[1], "the nearest pane counts most");
}

#[test]
fn tiles_show_the_same_order_as_one_picture() {
    let one = scene(&confetti(400), true);
    for view in views() {
        let whole = draw(&one, SIZE, &view);
        let mut wrong = 0;
        for [x, y] in [[0, 0], [96, 0], [0, 64], [96, 64]] {
            let tile = ViewDesc {
                viewport: [-f64::from(x), -f64::from(y), f64::from(SIZE[0]), f64::from(SIZE[1])],
                ..view.clone()
            };
            let tile = draw(&one, TILE, &tile);
            let places = (0..TILE[1]).flat_map(|row| (0..TILE[0]).map(move |column| (column, row)));
            let own: Vec<_> =
                places.map(|(column, row)| pixel(&whole, SIZE, x + column, y + row)).collect();
            wrong += differences(&tile, &own)[0];
        }
        // Triangles that lie across a border are rounded anew there.
        assert!(wrong * 1000 <= whole.len() * 5, "{wrong} of {}", whole.len());
    }
}

#[test]
fn places_of_convex_meshes_stay_one_draw() {
    let mut stage = SceneFixture::new();
    let material = Some(confetti_material(&mut stage));
    let mesh = Some(stage.mesh(&MeshFixture::sphere(8), material));
    let place = |index: u32| Instance {
        translation: Vec3::new(0.0, 0.0, -(index as f32)),
        rotation: glam::Quat::IDENTITY,
        scale: Vec3::splat(0.3),
        crowd: 0.0,
    };
    let instances = (0..20).map(place).collect();
    stage.desc.nodes.push(Node { mesh, instances, ..Node::default() });
    let view = look(DVec3::Z * 4.0, DVec3::ZERO, SIZE);
    let (_, stats) = draw_sampled(&stage.build(), SIZE, 1, &[view]);
    assert_eq!((stats.visible, stats.draw_calls), (20, 40), "back faces, then front faces");
}

#[test]
fn more_triangles_than_can_be_ordered_are_drawn_as_they_come() {
    let mut stage = SceneFixture::new();
    let material = Some(confetti_material(&mut stage));
    let shapes = confetti(16);
    let mesh = Some(stage.mesh(&joined(&shapes), material));
    let place = |index: u32| Instance {
        translation: Vec3::new((index % 128) as f32, (index / 128) as f32, 0.0) * 9.0,
        rotation: glam::Quat::IDENTITY,
        scale: Vec3::ONE,
        crowd: 0.0,
    };
    let of = |count: u32| (0..count).map(place).collect();
    for (count, draws) in [(16_384, 1), (16_385, 2)] {
        stage.desc.nodes = vec![Node { mesh, instances: of(count), ..Node::default() }];
        // Turned inside out, they are in another batch: no more of them than there are.
        let traits = NodeTraits { moving: vec![0], may_mirror: true, ..NodeTraits::of_file(1) };
        let turning = stage.build_with(&traits);
        let ordered = [0, 1].map(|batch| turning.order_of(batch).is_some());
        assert_eq!(ordered, [draws == 1; 2], "{count} places that may be turned");
        let view = look(DVec3::Z * 4.0, DVec3::ZERO, SIZE);
        let (pixels, stats) = draw_sampled(&stage.build(), SIZE, 1, &[view]);
        assert_eq!((stats.visible, stats.draw_calls), (1, draws), "{count} places");
        assert!(drawn(&pixels) > 50, "{}", drawn(&pixels));
    }
}
