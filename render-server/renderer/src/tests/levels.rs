//! Levels of detail: pictures, errors on the picture, draw calls; on a terrain whose errors are
//! known.

use std::collections::BTreeSet;

use glam::{DAffine3, DMat4, DVec2, DVec3, DVec4, Quat, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Instance, Material, Primitive};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, drawn, look, matt,
};
use super::terrain::Terrain;
use crate::draw_list::{Draw, DrawList, Scratch, VisibleItems};
use crate::{AllowedError, DrawStats, GpuScene, ViewDesc};

const SIZE: [u32; 2] = [192, 128];

/// Vertical pixels to a radian in the middle of [`look`]'s picture.
fn pixels_per_radian() -> f64 {
    f64::from(SIZE[1]) / 2.0 / 30f64.to_radians().tan()
}

/// So many pixels anywhere on the picture: at its corners a radian has more of them.
fn pixels(count: f64) -> AllowedError {
    let corner = DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0 / pixels_per_radian();
    let angle_rad = count / (pixels_per_radian() * (1.0 + corner.length_squared()));
    AllowedError { angle_rad, length: 0.0, ..AllowedError::NONE }
}

fn hills(at: DVec2) -> f64 {
    let wave = |by: f64, turn: f64| (at.x * by + turn).sin() * (at.y * by * 1.3 - turn).cos();
    0.08 * wave(9.0, 0.3) + 0.006 * wave(20.0, 1.1)
}

/// Hills of 8,192 triangles, a metre wide, with levels of detail or without.
fn terrain(has_levels: bool) -> MeshFixture {
    let mut shape = Terrain::mesh(3, hills);
    if !has_levels {
        shape.meshlets.clear();
        shape.coarser_indices.clear();
    }
    shape
}

fn scene(shape: &MeshFixture, material: Material, nodes: &[DAffine3]) -> GpuScene {
    let mut stage = SceneFixture::new();
    let material = stage.material(material);
    let mesh = stage.mesh(shape, Some(material));
    for local in nodes {
        stage.node(mesh, *local);
    }
    stage.build()
}

/// Hills near the eye and far away, turned and stretched.
fn places() -> [DAffine3; 3] {
    let turn = |by| DAffine3::from_rotation_y(by);
    let stretched = DAffine3::from_scale(DVec3::new(8.0, 5.0, 6.0));
    [
        DAffine3::from_translation(DVec3::new(-0.5, 0.0, -0.5)),
        DAffine3::from_translation(DVec3::new(-6.0, -0.4, -10.0)) * stretched,
        DAffine3::from_translation(DVec3::new(1.0, 0.0, -3.0)) * turn(0.7) * stretched,
    ]
}

fn eyes() -> impl Iterator<Item = ViewDesc> {
    let steps = (0..6).map(f64::from);
    steps.map(|t| {
        let eye = DVec3::new((t * 1.7).sin(), 0.25 + 0.1 * t, (t * 1.7).cos());
        look(eye, DVec3::new(0.1 * t, 0.0, -0.3 * t), SIZE)
    })
}

fn allowing(allowed_error: AllowedError, view: &ViewDesc) -> ViewDesc {
    ViewDesc { allowed_error, ..view.clone() }
}

fn glass() -> Material {
    let base_color = Vec4::new(0.9, 0.5, 0.2, 0.4);
    Material { base_color, alpha_mode: AlphaMode::Blend, double_sided: true, ..matt(1.0, 1.0, 1.0) }
}

#[test]
fn without_an_allowed_error_pictures_are_those_without_levels() {
    for material in [matt(0.8, 0.5, 0.2), glass()] {
        let with = scene(&terrain(true), material.clone(), &places());
        let without = scene(&terrain(false), material, &places());
        for view in eyes() {
            let view = std::slice::from_ref(&view);
            let (a, stats) = draw_sampled(&with, SIZE, 1, view);
            let (b, _) = draw_sampled(&without, SIZE, 1, view);
            assert_eq!(differences(&a, &b), [0; 3]);
            assert!(stats.error_share == 0.0 && drawn(&a) > 400, "{stats:?}");
        }
    }
}

#[test]
fn blobs_with_the_coarsest_level_first_are_drawn_the_same() {
    let before = terrain(true);
    let coarse_first = MeshFixture { is_coarse_first: true, ..before.clone() };
    assert_ne!(before.bytes(), coarse_first.bytes());
    for material in [matt(0.8, 0.5, 0.2), glass()] {
        let [a, b] = [&before, &coarse_first].map(|of| scene(of, material.clone(), &places()));
        for (view, count) in eyes().zip([0.0, 0.5, 1.0, 2.0, 4.0, 8.0]) {
            let view = [allowing(pixels(count), &view)];
            let [(a, stats), (b, same)] = [&a, &b].map(|of| draw_sampled(of, SIZE, 1, &view));
            assert_eq!((differences(&a, &b), stats.triangles), ([0; 3], same.triangles));
            assert_eq!((stats.draw_calls, stats.error_share), (same.draw_calls, same.error_share));
        }
    }
}

#[test]
fn without_finer_levels_the_finest_one_that_is_held_is_drawn() {
    let whole = terrain(true);
    for (material, level) in [(matt(0.8, 0.5, 0.2), 1), (glass(), 2), (matt(0.8, 0.5, 0.2), 4)] {
        let limited = scene(&whole.limited_to(level), material.clone(), &places());
        let alone = MeshFixture { indices: whole.level(level), ..terrain(false) };
        let alone = scene(&alone, material, &places());
        for view in eyes() {
            let pixel = pixels(1.0).angle_rad;
            let view = allowing(AllowedError { pixel, ..AllowedError::NONE }, &view);
            let (a, stats) = draw_sampled(&limited, SIZE, 1, std::slice::from_ref(&view));
            let (b, _) = draw_sampled(&alone, SIZE, 1, std::slice::from_ref(&view));
            assert_eq!(differences(&a, &b), [0; 3], "level {level}");
            assert!(stats.error_share > 0.0, "{stats:?}");
            // Tiles meet, and their errors are no more than that of all.
            let half = |x| ViewDesc { scissor: Some([x, 0, 96, 128]), ..view.clone() };
            let (tiles, of_tiles) = draw_sampled(&limited, SIZE, 1, &[half(0), half(96)]);
            assert_eq!(differences(&a, &tiles), [0; 3], "level {level}");
            assert!(of_tiles.error_share <= stats.error_share);
        }
    }
}

#[test]
fn errors_of_missing_levels_are_told_in_pixels_or_as_multiples_of_the_bound() {
    let whole = terrain(true);
    let limited = scene(&whole.limited_to(3), matt(0.8, 0.5, 0.2), &places());
    let view = eyes().nth(1).unwrap();
    let share = |allowed: AllowedError| {
        draw_sampled(&limited, SIZE, 1, &[allowing(allowed, &view)]).1.error_share
    };
    let pixel = pixels(1.0).angle_rad;
    let in_pixels = share(AllowedError { pixel, ..AllowedError::NONE });
    assert!(in_pixels > 1.0, "{in_pixels}");
    let of_half = share(AllowedError { pixel, ..pixels(0.5) });
    assert!((of_half / in_pixels - 2.0).abs() < 0.2, "{of_half} {in_pixels}");
    // A bound that allows all that is missing draws it as if nothing were.
    let loose = pixels(f64::from(in_pixels) * 4.0);
    let all = scene(&whole, matt(0.8, 0.5, 0.2), &places());
    let [a, b] = [&limited, &all].map(|of| draw(of, SIZE, &allowing(loose, &view)));
    assert_eq!(differences(&a, &b), [0; 3]);
    assert_eq!(share(AllowedError::NONE), 0.0, "nobody knows a pixel");
}

#[test]
fn tiles_of_coarser_pictures_meet() {
    for (material, samples) in [(matt(0.8, 0.5, 0.2), 1), (glass(), 1), (matt(0.3, 0.5, 0.8), 4)] {
        let scene = scene(&terrain(true), material, &places());
        for count in [0.5, 2.0, 8.0] {
            let view = allowing(pixels(count), &eyes().nth(1).unwrap());
            let (whole, _) = draw_sampled(&scene, SIZE, samples, std::slice::from_ref(&view));
            let mut tiles = Vec::new();
            for (x, y) in [(0, 0), (96, 0), (0, 64), (96, 64)] {
                tiles.push(ViewDesc { scissor: Some([x, y, 96, 64]), ..view.clone() });
            }
            let (apart, _) = draw_sampled(&scene, SIZE, samples, &tiles);
            assert_eq!(differences(&whole, &apart), [0; 3], "{count} px");
        }
    }
}

#[test]
fn larger_errors_draw_fewer_triangles_and_say_which_error_it_is() {
    let scene = scene(&terrain(true), matt(0.8, 0.5, 0.2), &places());
    let view = eyes().nth(2).unwrap();
    let mut before = u64::MAX;
    for count in [0.0, 0.5, 1.0, 4.0, 16.0] {
        let view = allowing(pixels(count), &view);
        let (_, stats) = draw_sampled(&scene, SIZE, 1, &[view]);
        println!("{count} px: {stats:?}");
        assert!(stats.triangles < before, "{count} px: {stats:?}");
        assert!(stats.error_share <= 1.0 && (stats.error_share > 0.5) == (count > 0.0));
        before = stats.triangles;
    }
    assert!(before < 1500, "{before}");
}

/// The largest distance in pixels from one that only the first picture covers to the nearest that
/// the second one does, beside the edge of the picture.
fn farthest_alone(a: &[bool], b: &[bool], [width, height]: [u32; 2], margin: i64) -> f64 {
    let (width, height) = (i64::from(width), i64::from(height));
    let covered = |of: &[bool], x: i64, y: i64| of[(y * width + x) as usize];
    let mut farthest: f64 = 0.0;
    for (y, x) in
        (margin..height - margin).flat_map(|y| (margin..width - margin).map(move |x| (y, x)))
    {
        if !covered(a, x, y) || covered(b, x, y) {
            continue;
        }
        let around = (-margin..=margin).flat_map(|dy| (-margin..=margin).map(move |dx| (dx, dy)));
        let near = around.filter(|(dx, dy)| covered(b, x + dx, y + dy));
        let nearest = near.map(|(dx, dy)| ((dx * dx + dy * dy) as f64).sqrt());
        farthest = farthest.max(nearest.fold(f64::INFINITY, f64::min));
    }
    farthest
}

#[test]
fn silhouettes_are_no_farther_off_than_allowed() {
    /// Pixels of the large picture to one of those that are meant.
    const FINE: u32 = 4;
    let fine = SIZE.map(|side| side * FINE);
    let flat = Material { unlit: true, double_sided: true, ..matt(1.0, 0.0, 0.0) };
    let scene = scene(&terrain(true), flat, &[places()[0]]);
    let is_covered = |pixels: Vec<[u8; 4]>| -> Vec<bool> {
        pixels.iter().map(|pixel| pixel[0] > 150 && pixel[1] < 100).collect()
    };
    let mut largest = [0.0; 3];
    for step in 0..24 {
        let t = f64::from(step);
        let turn = DVec3::new((t * 2.4).sin(), 0.0, (t * 2.4).cos());
        let eye = turn * (0.35 + 0.05 * t) + DVec3::Y * (0.1 + 0.2 * (t * 0.9).sin().abs());
        let view = look(eye, DVec3::new(0.0, 0.05 * t.sin(), 0.0), fine);
        let exact = is_covered(draw(&scene, fine, &view));
        for (at, count) in [1.0, 2.0, 4.0].into_iter().enumerate() {
            let coarse = is_covered(draw(&scene, fine, &allowing(pixels(count), &view)));
            let margin = (count * f64::from(FINE)) as i64 + 3;
            let off = farthest_alone(&exact, &coarse, fine, margin)
                .max(farthest_alone(&coarse, &exact, fine, margin));
            // On both pictures, a point of a surface covers the pixel whose middle is nearest.
            let off = (off - std::f64::consts::SQRT_2) / f64::from(FINE);
            assert!(off <= count, "{off} px off where {count} are allowed, view {step}");
            largest[at] = f64::max(largest[at], off);
        }
    }
    println!("largest distance at 1, 2, 4 px: {largest:.3?}");
    assert!(largest.iter().all(|off| *off > 0.1), "nothing was coarser: {largest:?}");
}

#[test]
fn no_gap_opens_between_levels() {
    let flat = Material { unlit: true, double_sided: true, ..matt(1.0, 0.0, 0.0) };
    let scene = scene(&terrain(true), flat, &[DAffine3::from_scale(DVec3::splat(20.0))]);
    let mut drawn = BTreeSet::new();
    for step in 0..40 {
        let t = f64::from(step);
        // Steeply down onto the middle of it, so that nothing else shows.
        let at = DVec3::new(10.0 + (t * 1.3).sin(), 0.0, 10.0 + (t * 0.7).cos());
        let view = look(at + DVec3::new(1.0, 3.0 + t.sin(), 1.5), at, SIZE);
        let view = allowing(pixels([0.7, 2.0, 6.0][step as usize % 3]), &view);
        let (picture, stats) = draw_sampled(&scene, SIZE, 1, &[view]);
        let gaps = picture.iter().filter(|pixel| **pixel != picture[0]).count();
        assert!(gaps == 0 && picture[0][0] > 200, "{gaps} pixels of gaps in view {step}");
        drawn.insert(stats.triangles);
    }
    assert!(drawn.len() > 20, "{drawn:?}");
}

fn list(scene: &GpuScene, view: &ViewDesc) -> DrawList {
    let (mut scratch, mut records) = (Scratch::default(), Vec::new());
    let visible = VisibleItems::new(scene, view, [0, 0, SIZE[0], SIZE[1]]);
    DrawList::new(scene, view, (&visible, &visible.items), &mut scratch, &mut records)
}

#[test]
fn both_eyes_draw_the_same_levels() {
    // So few triangles that none are looked at for whether they show.
    let scene = scene(&Terrain::mesh(1, hills), matt(0.8, 0.5, 0.2), &places());
    let mut drawn = BTreeSet::new();
    for middle in eyes() {
        let right = middle.view_from_world.row(0);
        // Of a scene in kilometres and of one in metres.
        for apart in [3.25e-5, 0.03125, 0.0325] {
            let eye = |side: f64| ViewDesc {
                eye_in_world: middle.middle_eye_in_world + right * apart * side,
                ..allowing(pixels(16.0), &middle)
            };
            let levels = |view: &ViewDesc| -> Vec<[u32; 2]> {
                list(&scene, view).opaque.iter().map(|draw| draw.indices).collect()
            };
            let [left, right] = [-1.0, 1.0].map(|side| levels(&eye(side)));
            assert_eq!(left, right, "{apart} from {}", middle.eye_in_world);
            drawn.extend(left);
        }
    }
    assert!(drawn.len() > 4, "{drawn:?}");
}

#[test]
fn far_instances_of_a_mesh_are_few_draws() {
    let nodes = (0..1000).map(|at| {
        let at = DVec3::new(f64::from(at % 40) - 20.0, 0.0, -f64::from(at / 40) * 2.0);
        DAffine3::from_translation(at + DVec3::new(0.0, -4.0, -8.0))
    });
    let nodes: Vec<DAffine3> = nodes.collect();
    let scene = scene(&Terrain::mesh(1, hills), matt(0.8, 0.5, 0.2), &nodes);
    let view = look(DVec3::ZERO, DVec3::new(0.0, -4.0, -30.0), SIZE);
    let stats = |view: &ViewDesc| draw_sampled(&scene, SIZE, 1, std::slice::from_ref(view)).1;
    let fine = stats(&view);
    let coarse = stats(&allowing(pixels(4.0), &view));
    println!("{fine:?}\n{coarse:?}");
    assert!(fine.visible > 500 && fine.draw_calls == 1, "{fine:?}");
    assert!(coarse.draw_calls < 20 && coarse.triangles * 5 < fine.triangles, "{coarse:?}");
}

#[test]
fn what_is_smaller_than_the_allowed_error_is_left_out() {
    let ball = MeshFixture::sphere(4);
    let at = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, -100.0));
    // A ball of 1.7 units around, and one of a thousandth of that.
    let small = at(3.0) * DAffine3::from_scale(DVec3::splat(1e-3));
    let around_the_eye = DAffine3::from_scale(DVec3::splat(0.2));
    let scene = scene(&ball, matt(0.8, 0.5, 0.2), &[at(0.0), small, around_the_eye]);
    let view = look(DVec3::ZERO, DVec3::NEG_Z, SIZE);
    let stats = |angle_rad: f64| -> DrawStats {
        let view = allowing(AllowedError { angle_rad, length: 0.0, ..AllowedError::NONE }, &view);
        draw_sampled(&scene, SIZE, 1, &[view]).1
    };
    assert_eq!((stats(0.0).visible, stats(0.0).culled), (3, 0));
    assert_eq!((stats(1e-5).visible, stats(1e-5).error_share), (3, 0.0));
    let left_out = stats(1e-3);
    assert_eq!((left_out.visible, left_out.culled), (2, 1), "the small one");
    assert!((0.02..0.05).contains(&left_out.error_share), "{left_out:?}");
    assert_eq!(stats(0.5).visible, 1, "only the one around the eye");
}

#[test]
fn small_parts_of_a_large_mesh_are_drawn() {
    let parts = |count: u32| {
        let mut stage = SceneFixture::new();
        let mesh = stage.mesh(&MeshFixture::rectangle(0.5, 0.5), None) as usize;
        let primitives = &mut stage.desc.meshes[mesh].primitives;
        for at in 1..count {
            let origin = DVec3::X * f64::from(at);
            primitives.push(Primitive { origin, ..primitives[0].clone() });
        }
        stage.node(mesh as u32, DAffine3::from_translation(DVec3::new(-20.0, 0.0, -100.0)));
        let view = look(DVec3::ZERO, DVec3::NEG_Z, SIZE);
        // Three parts of one unit are about as wide.
        let view =
            allowing(AllowedError { angle_rad: 0.03, length: 0.0, ..AllowedError::NONE }, &view);
        draw_sampled(&stage.build(), SIZE, 1, &[view]).1.visible
    };
    assert_eq!([parts(1), parts(2), parts(40)], [0, 0, 40]);
}

#[test]
fn a_small_item_of_a_large_crowd_is_drawn() {
    let drawn = |crowd: f32| {
        let mut stage = SceneFixture::new();
        let mesh = stage.mesh(&MeshFixture::rectangle(0.5, 0.5), None);
        stage.node(mesh, DAffine3::from_translation(DVec3::new(0.0, 0.0, -100.0)));
        stage.desc.nodes[0].crowd = crowd;
        let view = look(DVec3::ZERO, DVec3::NEG_Z, SIZE);
        let view =
            allowing(AllowedError { angle_rad: 0.03, length: 0.0, ..AllowedError::NONE }, &view);
        let drawn = draw_sampled(&stage.build(), SIZE, 1, &[view]).1;
        (drawn.visible, drawn.error_share)
    };
    // 1.4 units alone, 2.8 and 14 units together, where 3 are allowed.
    let (visible, alone) = drawn(0.0);
    assert!(visible == 0 && (0.4..0.5).contains(&alone), "{visible}, {alone}");
    let (visible, together) = drawn(2.0);
    assert!(visible == 0 && (1.9..2.1).contains(&(together / alone)), "{visible}, {together}");
    assert_eq!(drawn(10.0), (1, 0.0));
}

#[test]
fn a_copy_in_a_large_crowd_is_drawn_and_one_that_stands_alone_is_not() {
    let mut stage = SceneFixture::new();
    let mesh = stage.mesh(&MeshFixture::rectangle(0.5, 0.5), None);
    let node = stage.node(mesh, DAffine3::from_translation(DVec3::new(0.0, 0.0, -100.0)));
    let copy = |(x, crowd): (f32, f32)| Instance {
        translation: Vec3::X * x,
        rotation: Quat::IDENTITY,
        scale: Vec3::ONE,
        crowd,
    };
    // The largest, and that of the second; 1.4 units each, where 3 are allowed.
    let node = &mut stage.desc.nodes[node as usize];
    node.crowd = 10.0;
    node.instances = [(-9.0, 0.0), (0.0, 10.0), (9.0, 2.0)].map(copy).into();
    let view = look(DVec3::ZERO, DVec3::NEG_Z, SIZE);
    let view = allowing(AllowedError { angle_rad: 0.03, length: 0.0, ..AllowedError::NONE }, &view);
    let scene = stage.build();
    let drawn = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&view)).1;
    assert_eq!((drawn.visible, drawn.culled), (1, 2));
    let exact = draw_sampled(&scene, SIZE, 1, &[allowing(AllowedError::NONE, &view)]).1;
    assert_eq!((exact.visible, exact.culled), (3, 0), "all can be seen");
}

/// A plan of this height, with the distances that parallel rays show of an error.
fn plan(eye: DVec3, height: f64, length: f64) -> ViewDesc {
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let clip_from_view = DMat4::from_cols(
        DVec4::X * (2.0 / (height * aspect)),
        DVec4::Y * (2.0 / height),
        DVec4::Z / 1e6,
        DVec4::new(0.0, 0.0, 1.0, 1.0),
    );
    // An angle means nothing to parallel rays.
    let allowed_error = AllowedError { angle_rad: 1.0, length, ..AllowedError::NONE };
    ViewDesc { clip_from_view, allowed_error, ..look(eye, eye - DVec3::new(0.1, 1.0, 0.2), SIZE) }
}

#[test]
fn parallel_rays_show_one_error_at_all_distances() {
    let scene = scene(&terrain(true), matt(0.8, 0.5, 0.2), &places());
    let stats = |height: f64, length: f64| {
        let view = plan(DVec3::new(0.1 * height, height, 0.2 * height), 40.0, length);
        draw_sampled(&scene, SIZE, 1, &[view])
    };
    let [fine, coarse] = [0.0, 0.05].map(|length| stats(100.0, length));
    assert!(coarse.1.triangles * 2 < fine.1.triangles, "{:?} {:?}", coarse.1, fine.1);
    assert!(fine.1.error_share == 0.0 && coarse.1.error_share > 0.2);
    let higher = stats(1000.0, 0.05);
    assert_eq!(higher.1.triangles, coarse.1.triangles);
    let view = plan(DVec3::new(10.0, 100.0, 20.0), 40.0, 0.05);
    let parts = (0..6).map(|i| {
        let scissor = Some([i % 3 * 64, i / 3 * 64, 64, 64]);
        ViewDesc { scissor, ..view.clone() }
    });
    let (parts, _) = draw_sampled(&scene, SIZE, 1, &parts.collect::<Vec<_>>());
    assert_eq!(differences(&coarse.0, &parts), [0; 3]);
}

#[test]
fn back_faces_of_glass_are_drawn_at_the_levels_of_its_front() {
    // More triangles than are ordered by distance.
    let places: Vec<DAffine3> = places().into_iter().cycle().take(600).collect();
    let scene = scene(&Terrain::mesh(1, hills), glass(), &places);
    let view = allowing(pixels(2.0), &eyes().next().unwrap());
    let draws = list(&scene, &view).transparent;
    let of = |pipeline: u32| -> Vec<[u32; 2]> {
        draws.iter().filter(|draw| draw.pipeline == pipeline).map(|draw| draw.indices).collect()
    };
    let both: BTreeSet<u32> = draws.iter().map(|draw| draw.pipeline).collect();
    let [a, b] = both.into_iter().collect::<Vec<_>>()[..] else { panic!("{draws:?}") };
    assert!(of(a).len() > 2 && of(a) == of(b), "{draws:?}");
    let whole = |draw: &Draw| draw.indices[1] == terrain(true).indices.len() as u32;
    assert!(!draws.iter().all(whole));
}

#[test]
fn ordered_triangles_of_glass_are_those_of_its_levels() {
    let [ordered, as_they_come] = [1, 200].map(|times| {
        let places = places();
        let places: Vec<DAffine3> =
            places.iter().copied().cycle().take(places.len() * times).collect();
        let scene = scene(&Terrain::mesh(1, hills), glass(), &places);
        let view = allowing(pixels(2.0), &eyes().next().unwrap());
        let list = list(&scene, &view);
        assert!(list.transparent.iter().all(|draw| draw.ordered == (times == 1)));
        let indices: u32 = list.transparent.iter().map(|draw| draw.indices[1] * draw.count).sum();
        (indices, list.triangles)
    });
    assert_eq!(ordered.0, 3 * ordered.1 as u32);
    // Others draw each twice, of all places.
    assert_eq!(as_they_come.0, 2 * 200 * ordered.0);
}
