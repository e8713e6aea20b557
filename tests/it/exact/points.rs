//! The positions of drawn points, to hundredths of a pixel, by the real shaders.
//!
//! A marker is a square that shows a bell curve. The reference knows each of its pixels before
//! they are rounded to 8 bits, and how they change as the marker moves; so the least squares of
//! what was drawn against that give the marker's displacement, to about 0.002 pixels.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, EulerRot, UVec2, Vec3};
use polyptych_client::{Camera, Wall};
use polyptych_wall::ChannelId;

use super::channels;
use super::hard_cases::all_planar;
use crate::harness::local_wall::small;
use crate::harness::model::{Instance, Model, Part};
use crate::harness::stage::{RenderFixture, reference_view};
use crate::reference::raster::Projected;
use crate::reference::tone;
use crate::reference::view::View;

/// The bar of walls.md, in pixels.
const ERROR_MAX: f64 = 0.01;

/// Half of a marker's side in pixels.
const MARKER: f64 = 18.0;

/// Pixels between markers, and from the edge of the picture.
const CELL: f64 = 64.0;

/// Side of the bell curve's picture.
const BELL: u32 = 48;

/// From the origin, along no axis.
fn places() -> [(&'static str, DVec3); 4] {
    let along = DVec3::new(0.8, -0.36, 0.48);
    [("0", 0.0), ("16 km", 16e3), ("6.4e6 m", 6.4e6), ("1e7 m", 1e7)].map(|(n, d)| (n, along * d))
}

fn bell() -> (u32, Vec<u8>) {
    let sigma = f64::from(BELL) / 6.0;
    let away = |at: u32| (f64::from(at) + 0.5 - f64::from(BELL) / 2.0) / sigma;
    let code = |i: u32| {
        let (x, y) = (away(i % BELL), away(i / BELL));
        (240.0 * (-0.5 * (x * x + y * y)).exp()).round() as u8
    };
    (BELL, (0..BELL * BELL).map(code).collect())
}

/// The way in which markers are put into the file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Each is a node of its own below the scene's.
    Nodes,
    /// All are one mesh, which is as large as the scene.
    OneMesh,
    /// All are copies of one mesh below one node, in numbers of f32 as their extension has them.
    Copies,
}

/// Markers all over a wall's channels, at distances from where the eye nearly is to far away.
fn markers(wall: &Wall, camera: Camera, form: Form, random: &mut fastrand::Rng) -> Model {
    let mut parts: Vec<Part> = Vec::new();
    for id in channels(wall) {
        let view = reference_view(wall, id, camera).expect("a view");
        let size = DVec2::new(f64::from(view.size[0]), f64::from(view.size[1]));
        let cells = ((size - CELL * 0.5) / CELL).floor().min(DVec2::new(5.0, 4.0)).max(DVec2::ONE);
        let step = size / cells;
        for cell in 0..(cells.x * cells.y) as u32 {
            let at = DVec2::new(f64::from(cell % cells.x as u32), f64::from(cell / cells.x as u32));
            let jitter = DVec2::new(random.f64(), random.f64()) - 0.5;
            let pixel = (at + 0.5) * step + jitter * (step - CELL).max(DVec2::ZERO);
            // From just behind the screen to 2 km.
            let w = 2.0 * 1000f64.powf(random.f64());
            parts.push(marker(&view, pixel, w, camera.position, form));
        }
    }
    if form == Form::Copies {
        let copies = parts.iter().flat_map(|part| part.copies.clone()).collect();
        parts.truncate(1);
        parts[0].copies = copies;
    }
    if form == Form::OneMesh {
        let mut whole = parts.remove(0);
        for part in &parts {
            whole.join(part);
        }
        parts = vec![whole];
    }
    Model { parts, picture: Some(bell()) }
}

/// A square that is seen around a pixel, parallel to the screen.
fn marker(view: &View, pixel: DVec2, w: f64, scene: DVec3, form: Form) -> Part {
    let middle = view.world(pixel, w);
    let reach = |offset: DVec2| view.world(pixel + offset, w) - middle;
    let (right, up) = (reach(DVec2::X * MARKER), reach(-DVec2::Y * MARKER));
    let root = DMat4::from_translation(scene);
    let from_scene = middle - scene;
    if form == Form::OneMesh {
        let f32s = [from_scene, right, up].map(DVec3::as_vec3);
        return Part::rectangle(root, f32s[0], f32s[1], f32s[2], Vec3::ONE);
    }
    let back = right.cross(up).normalize();
    let square = || Part::rectangle(root, Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE);
    if form == Form::Copies {
        let turned = DMat3::from_cols(right.normalize(), up.normalize(), back);
        let scale = DVec3::new(right.length(), up.length(), 1.0).as_vec3();
        let rotation = DQuat::from_mat3(&turned).as_quat();
        let copy = Instance { translation: from_scene.as_vec3(), rotation, scale };
        return Part { copies: vec![copy], ..square() };
    }
    let node = DMat4::from_cols(
        right.extend(0.0),
        up.extend(0.0),
        back.extend(0.0),
        from_scene.extend(1.0),
    );
    let mut part = square();
    part.chain.push(node);
    part
}

/// Returns the displacement of each of a channel's markers from its expected position, in pixels.
fn displacements(
    stage: &mut RenderFixture,
    model: &Model,
    wall: &Wall,
    id: ChannelId,
    at: Camera,
) -> Vec<DVec2> {
    let view = reference_view(wall, id, at).expect("a view");
    let facets = model.facets();
    let drawn = stage.channel(wall, id, at);
    // A marker is two triangles of one plane: either tells about both.
    facets
        .chunks(2)
        .filter_map(|square| {
            let halves: Vec<_> = square.iter().filter_map(|f| Projected::new(&view, f)).collect();
            let [first, second] = halves.as_slice() else { return None };
            let spans = [first.span(view.size), second.span(view.size)];
            let least = UVec2::from(spans[0][0]).min(UVec2::from(spans[1][0]));
            let most = UVec2::from(spans[0][1]).max(UVec2::from(spans[1][1]));
            let is_whole =
                least.min_element() > 1 && (UVec2::from(view.size) - most).min_element() > 2;
            let code = |point: DVec2| tone::unlit_codes(first.at(point).1).y;
            let (mut normal, mut right) = ([0.0; 3], DVec2::ZERO);
            for (x, y) in (least.y..=most.y).flat_map(|y| (least.x..=most.x).map(move |x| (x, y))) {
                let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                // Not at the edge, which is sharp; but across the seam of the two.
                if !inside(first, second, center) {
                    continue;
                }
                let step = 0.125;
                let slope = |axis: DVec2| {
                    (code(center + axis * step) - code(center - axis * step)) / (2.0 * step)
                };
                let slope = DVec2::new(slope(DVec2::X), slope(DVec2::Y));
                let error = f64::from(drawn.get_pixel(x, y).0[1]) - code(center);
                normal[0] += slope.x * slope.x;
                normal[1] += slope.x * slope.y;
                normal[2] += slope.y * slope.y;
                right -= slope * error;
            }
            let determinant = normal[0] * normal[2] - normal[1] * normal[1];
            let moved = DVec2::new(
                (normal[2] * right.x - normal[1] * right.y) / determinant,
                (normal[0] * right.y - normal[1] * right.x) / determinant,
            );
            is_whole.then_some(moved)
        })
        .collect()
}

/// Two pixels within the square that both triangles make.
fn inside(first: &Projected, second: &Projected, center: DVec2) -> bool {
    let reach = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].map(|d| d * 2.0);
    reach.iter().all(|offset| first.covers(center + offset) || second.covers(center + offset))
}

/// The largest error over all channels of a wall, and how many markers were measured.
fn worst(wall: &Wall, place: DVec3, form: Form) -> (f64, usize) {
    let mut random = fastrand::Rng::with_seed(11);
    let rotation = DQuat::from_euler(EulerRot::YXZ, 0.7, -0.2, 0.1);
    let camera = Camera { position: place, rotation, scale: 1.0 };
    let model = markers(wall, camera, form, &mut random);
    let mut stage = RenderFixture::of(&model.gltf());
    let mut all = Vec::new();
    for id in channels(wall) {
        all.extend(displacements(&mut stage, &model, wall, id, camera));
    }
    (all.iter().map(|moved| moved.length()).fold(0.0, f64::max), all.len())
}

fn check(name: &str, wall: &Wall) {
    for form in [Form::Nodes, Form::OneMesh, Form::Copies] {
        let mut line = format!("{name}, {form:?}:");
        let mut most: f64 = 0.0;
        for (at, place) in places() {
            let (error, count) = worst(wall, place, form);
            assert!(count >= wall.channels.len(), "{name}: only {count} markers were seen");
            line.extend([" ", at, &format!(" {error:.4} px of {count}")]);
            most = most.max(error);
        }
        println!("{line}");
        assert!(most <= ERROR_MAX, "{line}: more than {ERROR_MAX} px");
    }
}

#[test]
fn markers_of_every_wall_file_stand_where_the_reference_says() {
    for (name, wall) in all_planar() {
        check(&name, &wall);
    }
}

#[test]
fn markers_of_random_walls_stand_where_the_reference_says() {
    let mut random = fastrand::Rng::with_seed(5);
    for number in 0..5 {
        check(&format!("random wall {number}"), &random_wall(&mut random));
    }
}

#[test]
fn markers_on_a_canvas_of_16384_pixels_stand_where_the_reference_says() {
    // Beyond what one viewport spans: each tile has a frustum of its own.
    let text = r#"
        [wall]
        name = "wide"
        [[screen]]
        name = "front"
        size = [16.384, 0.096]
        center = [0.0, 0.0, -6.0]
        tiles = { columns = 2, rows = 1, pixels = [8192, 96] }
    "#;
    let wall = polyptych_wall_file::parse(text, "wide.toml".as_ref())
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(wall.screens[0].canvas.x, 16_384);
    check("16384 pixels", &wall);
}

/// A screen somewhere in the room, rolled and aslant, and an eye before it that is not in the
/// middle.
fn random_wall(random: &mut fastrand::Rng) -> Wall {
    let mut unit = || random.f64() * 2.0 - 1.0;
    let axis = DVec3::new(unit(), unit(), unit()).normalize();
    let turn = DQuat::from_axis_angle(axis, unit() * std::f64::consts::PI);
    let (right, up) = (turn * DVec3::X * (2.0 + unit()), turn * DVec3::Y * (1.5 + unit() * 0.5));
    let center = DVec3::new(unit(), unit(), unit()) * 5.0;
    let eye = center + turn * DVec3::new(unit() * 2.0, unit(), 1.2 + unit());
    let corner = |x: f64, y: f64| (center + right * (x * 0.5) + up * (y * 0.5)).to_array();
    let text = format!(
        r#"
        [wall]
        name = "random"
        eye = {:?}
        [[screen]]
        name = "front"
        lower_left = {:?}
        lower_right = {:?}
        upper_left = {:?}
        tiles = {{ columns = 2, rows = 1, pixels = [640, 480] }}
        "#,
        eye.to_array(),
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(-1.0, 1.0),
    );
    polyptych_wall_file::parse(&text, "random.toml".as_ref())
        .unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_slow_camera_at_the_radius_of_the_earth_does_not_shake() {
    let wall = small(1, 1);
    let id = ChannelId(0);
    let start = DVec3::new(0.8, -0.36, 0.48) * 6.4e6;
    for form in [Form::Nodes, Form::OneMesh] {
        let camera = Camera { position: start, ..Camera::IDENTITY };
        let model = markers(&wall, camera, form, &mut fastrand::Rng::with_seed(3));
        let mut stage = RenderFixture::of(&model.gltf());
        let mut last: Option<Vec<DVec2>> = None;
        let mut shaking: f64 = 0.0;
        for step in 0..24 {
            // Less than a pixel a frame for the nearest marker.
            let t = f64::from(step);
            let position = start + DVec3::new(0.000_37, 0.000_11, -0.000_23) * t;
            let rotation = DQuat::from_rotation_y(t * 2e-5);
            let camera = Camera { position, rotation, scale: 1.0 };
            let now = displacements(&mut stage, &model, &wall, id, camera);
            assert!(now.len() > 5, "{} markers", now.len());
            if let Some(last) = last.filter(|last| last.len() == now.len()) {
                let steps = last.iter().zip(&now).map(|(a, b)| a.distance(*b));
                shaking = steps.fold(shaking, f64::max);
            }
            last = Some(now);
        }
        println!("{form:?}: {shaking:.4} px from frame to frame, against the path in f64");
        assert!(shaking > 0.0 && shaking <= ERROR_MAX, "{form:?}: {shaking} px");
    }
}
