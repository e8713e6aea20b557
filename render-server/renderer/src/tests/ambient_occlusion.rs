//! Ambient occlusion: rays cast in f64 find as much, planes have none, and no tile has a seam.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use polyptych_scene::{
    AlphaMode, AmbientOcclusion, Light, LightKind, Material, MaterialExtensions, ToneMapper,
    Transmission,
};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, matt, pixel,
};
use super::pixel_light::lights;
use crate::readback::read_pixels;
use crate::target::Target;
use crate::{GpuScene, Renderer, ViewDesc};

const CANVAS: [u32; 2] = [900, 600];

/// Rectangles of a colour, each with half its sides and a place; even light from all around.
struct Room {
    walls: Vec<([f64; 2], DAffine3)>,
}

impl Room {
    /// A floor with two walls behind it that meet at the origin, and a box on the floor.
    fn corner() -> Self {
        let mut room = Self { walls: Vec::new() };
        let turned = |axis, degrees: f64| DQuat::from_axis_angle(axis, degrees.to_radians());
        let mut wall = |half, turn, at| {
            room.walls.push((half, DAffine3::from_rotation_translation(turn, at)));
        };
        wall([4.0, 4.0], turned(DVec3::X, -90.0), DVec3::new(4.0, 0.0, 4.0));
        wall([4.0, 2.0], DQuat::IDENTITY, DVec3::new(4.0, 2.0, 0.0));
        wall([4.0, 2.0], turned(DVec3::Y, 90.0), DVec3::new(0.0, 2.0, 4.0));
        // A box of a metre, turned by a fifth of a right angle.
        let stands =
            DAffine3::from_rotation_translation(turned(DVec3::Y, 18.0), DVec3::new(2.0, 0.5, 1.6));
        for (axis, degrees) in [
            (DVec3::Y, 0.0),
            (DVec3::Y, 90.0),
            (DVec3::Y, 180.0),
            (DVec3::Y, 270.0),
            (DVec3::X, -90.0),
        ] {
            let side = turned(axis, degrees);
            let of_box = DAffine3::from_rotation_translation(side, side * DVec3::Z * 0.5);
            room.walls.push(([0.5, 0.5], stands * of_box));
        }
        room
    }

    fn scene(&self, material: &Material) -> GpuScene {
        let mut stage = SceneFixture::new();
        self.add_to(&mut stage, material);
        stage.build()
    }

    fn add_to(&self, stage: &mut SceneFixture, material: &Material) {
        (stage.desc.sky, stage.ground) = (Vec3::splat(0.8), Some(Vec3::splat(0.8)));
        // Without lights it would have the default sun.
        let kind = LightKind::Directional;
        let dark = Light { kind, color: Vec3::ONE, intensity: 0.0, range: None };
        stage.light(dark, DAffine3::IDENTITY);
        let material = stage.material(material.clone());
        for ([x, y], place) in &self.walls {
            let card = MeshFixture::rectangle(*x as f32, *y as f32);
            let card = stage.mesh(&card, Some(material));
            stage.node(card, *place);
        }
    }

    /// The nearest wall along a ray, its distance, and its normal towards the ray's origin.
    fn hit(&self, from: DVec3, along: DVec3) -> Option<(f64, DVec3)> {
        let hits = self.walls.iter().filter_map(|([x, y], place)| {
            let inverse = place.inverse();
            let (from, along) = (inverse.transform_point3(from), inverse.transform_vector3(along));
            let distance = -from.z / along.z;
            let at = from + along * distance;
            let inside = distance > 1e-7 && at.x.abs() <= *x && at.y.abs() <= *y;
            let normal = place.transform_vector3(DVec3::Z * -along.z.signum());
            inside.then_some((distance, normal))
        });
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The part of even light from all around that gets to what a ray sees; `None` if it sees
    /// nothing.
    fn visible_part(&self, from: DVec3, along: DVec3, radius: f64) -> Option<f64> {
        let (distance, normal) = self.hit(from, along)?;
        let at = from + along * distance + normal * 1e-6;
        let radius = radius.min(distance / 8.0);
        let side = normal.any_orthonormal_vector();
        let other = normal.cross(side);
        let (rings, sectors) = (16u32, 48u32);
        let mut taken = 0.0;
        for (ring, sector) in (0..rings).flat_map(|ring| (0..sectors).map(move |at| (ring, at))) {
            // Equal parts of the light that a matt surface reflects.
            let sine = ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt();
            let turn = (f64::from(sector) + 0.5) / f64::from(sectors) * std::f64::consts::TAU;
            let cosine = (1.0 - sine * sine).sqrt();
            let ray = (side * turn.cos() + other * turn.sin()) * sine + normal * cosine;
            let hit = self.hit(at, ray).map_or(f64::INFINITY, |(distance, _)| distance);
            taken += (1.0 - (hit / radius).powi(2)).max(0.0);
        }
        Some(1.0 - taken / f64::from(rings * sectors))
    }
}

fn view(occlusion: Option<f32>) -> ViewDesc {
    let ambient_occlusion = occlusion.map(|radius| AmbientOcclusion { radius });
    let seen = look(DVec3::new(4.5, 2.6, 4.8), DVec3::new(1.4, 0.6, 0.9), CANVAS);
    ViewDesc { ambient_occlusion, tone: ToneMapper::None, ..seen }
}

/// The ray of a pixel of a view.
fn ray(view: &ViewDesc, [x, y]: [u32; 2]) -> DVec3 {
    let [_, _, width, height] = view.viewport;
    let across = (f64::from(x) + 0.5) / width * 2.0 - 1.0;
    let up = 1.0 - (f64::from(y) + 0.5) / height * 2.0;
    let in_view =
        DVec3::new(across / view.clip_from_view.x_axis.x, up / view.clip_from_view.y_axis.y, -1.0);
    (view.view_from_world.transpose() * in_view).normalize()
}

/// The part of the light from all around that gets to each pixel.
fn visible_parts(scene: &GpuScene, seen: &ViewDesc) -> Vec<f64> {
    let plain = ViewDesc { ambient_occlusion: None, ..seen.clone() };
    let (plain, dark) = (lights(scene, 1, &plain), lights(scene, 1, seen));
    plain
        .iter()
        .zip(&dark)
        .map(|(plain, dark)| if *plain > 0.0 { dark / plain } else { 1.0 })
        .collect()
}

#[test]
fn rays_find_as_much() {
    let room = Room::corner();
    let scene = room.scene(&matt(0.7, 0.7, 0.7));
    for radius in [0.2, 0.5, 2.0] {
        let seen = view(Some(radius));
        let found = visible_parts(&scene, &seen);
        let grid =
            (2..CANVAS[1]).step_by(5).flat_map(|y| (2..CANVAS[0]).step_by(5).map(move |x| [x, y]));
        let (mut errors, mut sums) = (Vec::new(), [0.0; 2]);
        for [x, y] in grid {
            let along = ray(&seen, [x, y]);
            let wanted = room.visible_part(seen.eye_in_world, along, f64::from(radius));
            let Some(wanted) = wanted else { continue };
            let found = found[(y * CANVAS[0] + x) as usize];
            errors.push((found - wanted).abs());
            sums = [sums[0] + wanted, sums[1] + found];
        }
        errors.sort_by(f64::total_cmp);
        let count = errors.len();
        let mean = errors.iter().sum::<f64>() / count as f64;
        let [wanted, found] = sums.map(|sum| 1.0 - sum / count as f64);
        let most = errors[count * 95 / 100];
        println!(
            "radius {radius}: {wanted:.4} of the light taken by rays, {found:.4} here; off by \
             {mean:.4}, 95 % by up to {most:.3}, 99 % {:.3}",
            errors[count * 99 / 100],
        );
        // What is behind the box is not in the picture; it cannot be told.
        assert!(wanted > 0.005 && mean < 0.007 && most < 0.04, "{mean}, {most}");
    }
}

#[test]
fn planes_and_edges_that_stand_out_are_not_darkened() {
    let flat = Room { walls: vec![([40.0, 40.0], DAffine3::from_rotation_x(-1.4))] };
    let scene = flat.scene(&matt(0.7, 0.7, 0.7));
    let least = visible_parts(&scene, &view(Some(3.0))).into_iter().fold(1.0, f64::min);
    assert!(least > 0.995, "{least}");
    // A card far before a wall: neither has an edge of the other.
    let card = |z: f64, half: f64| ([half, half], DAffine3::from_translation(DVec3::Z * z));
    let apart = Room { walls: vec![card(-6.0, 30.0), card(0.0, 0.8)] };
    let scene = apart.scene(&matt(0.7, 0.7, 0.7));
    let seen = ViewDesc {
        ambient_occlusion: Some(AmbientOcclusion { radius: 1.0 }),
        ..look(DVec3::Z * 4.0, DVec3::ZERO, CANVAS)
    };
    let least = visible_parts(&scene, &seen).into_iter().fold(1.0, f64::min);
    assert!(least > 0.995, "{least}");
}

#[test]
fn what_blends_is_not_darkened_by_what_is_behind_it() {
    let pane = Material { alpha_mode: AlphaMode::Blend, ..matt(0.7, 0.7, 0.7) };
    let scene = |material: &Material| {
        let mut stage = SceneFixture::new();
        (stage.desc.sky, stage.ground) = (Vec3::splat(0.8), Some(Vec3::splat(0.8)));
        let [wall, card] = [matt(0.5, 0.5, 0.5), material.clone()].map(|of| stage.material(of));
        let wide = stage.mesh(&MeshFixture::rectangle(6.0, 6.0), Some(wall));
        // Two walls that meet behind the middle.
        for degrees in [45.0_f64, -45.0] {
            let turn = DAffine3::from_rotation_y(degrees.to_radians());
            stage.node(wide, turn * DAffine3::from_translation(DVec3::X * -degrees.signum() * 6.0));
        }
        let near = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(card));
        stage.node(near, DAffine3::from_translation(DVec3::Z * 5.0));
        stage.build()
    };
    let seen = |radius: Option<f32>| ViewDesc {
        ambient_occlusion: radius.map(|radius| AmbientOcclusion { radius }),
        ..look(DVec3::Z * 9.0, DVec3::ZERO, CANVAS)
    };
    let at = |material: &Material, radius, y| {
        pixel(&draw(&scene(material), CANVAS, &seen(radius)), CANVAS, 450, y)
    };
    for material in [&pane, &matt(0.7, 0.7, 0.7)] {
        let [card, dark] = [None, Some(1.5)].map(|radius| at(material, radius, 300));
        assert!(card.iter().zip(dark).all(|(a, b)| a.abs_diff(b) <= 1), "{card:?}, {dark:?}");
        let [corner, dark] = [None, Some(1.5)].map(|radius| at(material, radius, 40));
        assert!(corner[0] > dark[0] + 20, "{corner:?}, {dark:?}");
    }
}

/// Pixels of tiles that differ from one camera's at all, by more than a code, and by more than 8.
fn tile_differences(scene: &GpuScene, samples: u32, seen: &ViewDesc) -> [usize; 3] {
    let whole = draw_sampled(scene, CANVAS, samples, std::slice::from_ref(seen)).0;
    let mut total = [0; 3];
    // Borders at odd pixels.
    for [x, y, width, height] in
        [[0, 0, 451, 283], [451, 0, 449, 283], [0, 283, 451, 317], [451, 283, 449, 317]]
    {
        let viewport = [-f64::from(x), -f64::from(y), 900.0, 600.0];
        let tile = ViewDesc { viewport, ..seen.clone() };
        let tile = draw_sampled(scene, [width, height], samples, &[tile]).0;
        let rows = y..y + height;
        let places = rows.flat_map(|row| (x..x + width).map(move |column| (column, row)));
        let wanted: Vec<_> =
            places.map(|(column, row)| pixel(&whole, CANVAS, column, row)).collect();
        for (sum, count) in total.iter_mut().zip(differences(&tile, &wanted)) {
            *sum += count;
        }
    }
    total
}

#[test]
fn tiles_agree_with_one_camera() {
    let room = Room::corner();
    let glass = MaterialExtensions {
        transmission: Some(Transmission { factor: 0.9, texture: None }),
        ..MaterialExtensions::default()
    };
    let mut with_pane = SceneFixture::new();
    room.add_to(&mut with_pane, &matt(0.7, 0.7, 0.7));
    let pane =
        Material { roughness: 0.0, extensions: Some(Box::new(glass)), ..matt(0.9, 0.9, 0.9) };
    let pane = with_pane.material(pane);
    let card = with_pane.mesh(&MeshFixture::rectangle(1.2, 1.2), Some(pane));
    let turn = DAffine3::from_rotation_y(0.8);
    with_pane.node(card, DAffine3::from_translation(DVec3::new(2.6, 1.2, 2.8)) * turn);
    let seen = view(Some(2.0));
    // Two and four pixels a texel too.
    let fine = |zoom: f64| {
        let mut fine = seen.clone();
        fine.clip_from_view = DMat4::from_scale(DVec3::new(zoom, zoom, 1.0)) * fine.clip_from_view;
        fine
    };
    for (name, scene) in [("walls", room.scene(&matt(0.7, 0.7, 0.7))), ("glass", with_pane.build())]
    {
        for (samples, zoom) in [(1, 1.0), (4, 1.0), (1, 2.5), (4, 5.0)] {
            let total = tile_differences(&scene, samples, &fine(zoom));
            println!("{name}, ×{samples}, {zoom} times as near: {total:?} of 540,000");
            assert!(total[0] * 1000 <= 540_000 && total[2] == 0, "{total:?}");
        }
    }
}

#[test]
fn views_of_any_number_are_as_dark_as_one() {
    let scene = Room::corner().scene(&matt(0.7, 0.7, 0.7));
    // Each has depths of 0.6 million texels: 100 take several textures after each other.
    let part = |at: u32| ViewDesc {
        scissor: Some([at % 10 * 90, at / 10 * 60, 90, 60]),
        ..view(Some(0.8))
    };
    let views: Vec<ViewDesc> = (0..100).map(part).collect();
    let wanted = draw_sampled(&scene, CANVAS, 1, &[view(Some(0.8))]).0;
    let found = draw_sampled(&scene, CANVAS, 1, &views).0;
    let [differing, _, most] = differences(&found, &wanted);
    // Places in the texture of depths round otherwise.
    assert!(differing * 200 <= wanted.len() && most == 0, "{differing}, {most}");
}

#[test]
fn screens_that_meet_at_an_angle_find_about_as_much() {
    let scene = Room::corner().scene(&matt(0.7, 0.7, 0.7));
    let ahead = view(Some(0.5));
    // The same eye, turned by 40° to the side.
    let turn = glam::DMat3::from_rotation_y(40_f64.to_radians());
    let aside = ViewDesc { view_from_world: turn * ahead.view_from_world, ..ahead.clone() };
    let [first, second] = [&ahead, &aside].map(|seen| visible_parts(&scene, seen));
    let (mut errors, mut darkest) = (Vec::new(), 1.0_f64);
    for (y, x) in
        (0..CANVAS[1]).step_by(3).flat_map(|y| (0..CANVAS[0]).step_by(3).map(move |x| (y, x)))
    {
        let along = aside.view_from_world * ray(&ahead, [x, y]);
        let clip = aside.clip_from_view * along.extend(1.0);
        let [across, down] = [clip.x / -along.z, -clip.y / -along.z];
        let column = ((across + 1.0) * 0.5 * f64::from(CANVAS[0])).floor();
        let row = ((down + 1.0) * 0.5 * f64::from(CANVAS[1])).floor();
        let inside = along.z < 0.0
            && (0.0..f64::from(CANVAS[0])).contains(&column)
            && (0.0..f64::from(CANVAS[1])).contains(&row);
        if inside {
            let at = row as usize * CANVAS[0] as usize + column as usize;
            let here = first[(y * CANVAS[0] + x) as usize];
            darkest = darkest.min(here);
            errors.push((here - second[at]).abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let most = errors[errors.len() * 99 / 100];
    println!("{} rays on both screens: off by {mean:.4}, 99 % by up to {most:.3}", errors.len());
    assert!(errors.len() > 5_000 && darkest < 0.6, "{} {darkest}", errors.len());
    assert!(mean < 0.006 && most < 0.08, "{mean}, {most}");
}

#[test]
fn plans_are_darkened_and_numbers_that_are_no_radius_are_refused() {
    let scene = Room::corner().scene(&matt(0.7, 0.7, 0.7));
    let mut flat = view(Some(0.8));
    // Six units wide.
    flat.clip_from_view = DMat4::from_scale(DVec3::new(1.0 / 3.0, 0.5, 0.1));
    flat.clip_from_view.w_axis.z = 1.0;
    assert!(flat.is_parallel());
    let parts = visible_parts(&scene, &flat);
    let darkest = parts.iter().copied().fold(1.0, f64::min);
    let untouched = parts.iter().filter(|part| **part > 0.995).count();
    assert!((0.3..0.65).contains(&darkest), "{darkest}");
    assert!(untouched * 2 > parts.len(), "{untouched} of {}", parts.len());
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), CANVAS, 1, false).unwrap();
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = renderer.draw(gpu(), &scene, &mut target, &[view(Some(radius))]).unwrap_err();
        assert!(error.to_string().contains("radius"), "{error}");
    }
    for radius in [f32::MIN_POSITIVE, f32::MAX] {
        renderer.draw(gpu(), &scene, &mut target, &[view(Some(radius))]).unwrap();
    }
}

#[test]
fn nothing_is_made_for_views_without_it() {
    let scene = Room::corner().scene(&matt(0.7, 0.7, 0.7));
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), CANVAS, 1, false).unwrap();
    for (radius, is_there) in [(None, false), (Some(0.5), true), (None, true)] {
        renderer.draw(gpu(), &scene, &mut target, &[view(radius)]).unwrap();
        assert_eq!(renderer.frames.has_occlusion(), is_there);
    }
    let after = read_pixels(gpu(), &target).unwrap();
    assert!(after.as_chunks::<4>().0 == draw(&scene, CANVAS, &view(None)));
}
