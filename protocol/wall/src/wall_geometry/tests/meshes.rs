//! Screens that are meshes, with projectors and warps on them.

use glam::{DQuat, Vec2};

use super::super::super::blend::blend_channel::BlendChannel;
use super::super::super::projector::Projector;
use super::super::super::surface::Cylinder;
use super::super::super::warp::{ImportedMesh as Mesh, ImportedVertex as Vertex};
use super::*;

/// The mesh of a surface with so many cells.
fn mesh(cells: [u32; 2], point: impl Fn(DVec2) -> DVec3) -> CalibrationMap {
    let (cells, across) = (UVec2::from(cells), cells[0] + 1);
    let vertex = |i: u32| {
        let place = UVec2::new(i % across, i / across).as_dvec2() / cells.as_dvec2();
        Vertex { place: place.as_vec2(), value: point(place).as_vec3(), light: 1.0 }
    };
    let cell = |i: u32| {
        let at = i / cells.x * across + i % cells.x;
        [[at, at + 1, at + across], [at + across + 1, at + across, at + 1]]
    };
    let vertices = (0..across * (cells.y + 1)).map(vertex).collect();
    let triangles = (0..cells.x * cells.y).flat_map(cell).collect();
    let shape = WarpGeometry::Mesh(Mesh { vertices, triangles });
    CalibrationMap::Warp(WarpMap { space: MapCoordinates::Display, shape })
}

/// Returns the wall with its only screen as a mesh.
fn meshed(wall: &Wall, file: CalibrationMap) -> (Wall, CalibrationMaps) {
    let mut meshed = wall.clone();
    meshed.screens[0].surface = Surface::Mesh(0);
    let maps = with_files(&mut meshed, CalibrationFileKind::ScreenMesh, &[file]);
    (meshed, maps)
}

/// The point of the cylinder at a place of its canvas.
fn on_cylinder(place: DVec2) -> DVec3 {
    Surface::Cylinder(cylinder()).display_from_uv(place).expect("no file")
}

fn cylinder() -> Cylinder {
    let azimuth_rad = [-1.2, 1.2];
    let (center, rotation) = (DVec3::ZERO, DQuat::from_rotation_z(0.02));
    Cylinder { center, rotation, radius_m: 3.0, azimuth_rad, height_m: [-2.0, 2.0] }
}

#[test]
fn projectors_light_a_mesh_where_they_light_the_surface_that_it_is_of() {
    let mut wall = askew(true, UVec2::new(160, 100), 0.06);
    wall.screens[0].surface = Surface::Cylinder(cylinder());
    // 2,400 columns are off the arc by 0.4 µm.
    let (meshed, maps) = meshed(&wall, mesh([2400, 4], on_cylinder));
    let shapes = WallGeometry::new(&meshed, &maps);
    let of = ResolvedWall { wall: &meshed, shapes: &shapes };
    let (mut worst, mut lit) = ([0.0_f64; 2], 0);
    let end = wall.screens[0].canvas.as_dvec2() - 1.0;
    for (id, pixel) in pixels(&wall, 7) {
        let pixel = pixel.as_dvec2() + 0.5;
        let (due, map) =
            (wall.channel_mapping(id).expect("due"), of.channel_mapping(id).expect("a map"));
        let canvas = due.canvas_from_pixel(pixel);
        let is_on = |at: &DVec2| at.cmpgt(DVec2::ONE).all() && at.cmplt(end).all();
        let Some(canvas) = canvas.filter(is_on) else { continue };
        lit += 1;
        let found = map.canvas_from_pixel(pixel).expect("on the canvas");
        worst[0] = worst[0].max(found.distance(canvas));
        let back = map.pixel_from_canvas(canvas).expect("of the picture");
        worst[1] = worst[1].max(back.distance(pixel));
    }
    println!("{lit} pixels: {worst:.5?} pixels off, and back");
    assert!(lit > 1000 && worst.iter().all(|off| *off < PLACE_ERROR_MAX), "{worst:?}");
    let (blend, due) = (BlendModel::new(of), BlendModel::new(&wall));
    assert_eq!(blend.overlap_max(), due.overlap_max());
    for (x, y) in (2..30).flat_map(|x| (2..18).map(move |y| (x, y))) {
        let canvas = DVec2::new(f64::from(x), f64::from(y)) * 10.0 + 0.3;
        let [found, due] = [&blend, &due].map(|blend| blend.weights(ChannelId(0), canvas));
        let is_near =
            |(a, b): (&(ChannelId, f64), &(ChannelId, f64))| a.0 == b.0 && (a.1 - b.1).abs() < 0.01;
        assert!(found.iter().zip(&due).all(is_near), "{canvas}: {found:?} {due:?}");
        assert!(found.is_empty() || (found.iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-9);
    }
}

fn beam(position: DVec3, look_at: DVec3, tangent: f64) -> Channel {
    let rotation = crate::camera::Camera::look_at(position, look_at, DVec3::Y).rotation;
    let mut channel = Channel::tile("beam", 0, UVec2::ZERO, UVec2::new(64, 64));
    let tangents = [-tangent, tangent, -tangent, tangent];
    channel.cover = ChannelKind::Projector(Box::new(Projector { position, rotation, tangents }));
    channel
}

/// A wall of one beam onto a mesh.
fn lit(file: CalibrationMap, beam: Channel) -> (Wall, WallGeometry) {
    let screen = Screen::new("hill", Surface::Mesh(0), UVec2::new(200, 100));
    let (wall, maps) = meshed(&Wall::new("w", vec![screen], vec![beam]), file);
    let shapes = WallGeometry::new(&wall, &maps);
    (wall, shapes)
}

/// A board whose right half stands a metre before its left half, joined by a step: from the right
/// the step hides some of the left half.
#[test]
fn what_a_mesh_hides_from_a_projector_is_dark() {
    let step = |place: DVec2| {
        let x = place.x * 4.0 - 2.0;
        let (beside, ahead) = (x.min(0.0) + (x - 0.1).max(0.0), (x * 10.0).clamp(0.0, 1.0));
        DVec3::new(beside, 1.0 - place.y * 2.0, ahead - 3.0)
    };
    let beam = beam(DVec3::X * 2.0, DVec3::new(0.0, 0.0, -3.0), 0.8);
    let (wall, shapes) = lit(mesh([400, 2], step), beam);
    let of = ResolvedWall { wall: &wall, shapes: &shapes };
    let codes = vec![255; 4 * 64 * 64];
    let shown = [DisplayImage { channel: ChannelId(0), rgba: &codes }];
    let row = LightComposite::new(of, 0, StereoEye::Left, &shown).row(50);
    // The ray past the edge at (0, -2) from (2, 0) comes down at x = -1, which is column 50.
    let is_lit = |x: usize| row[x].is_some();
    assert!(is_lit(40) && is_lit(48) && is_lit(110), "lit on both sides");
    assert!((52..99).all(|x| !is_lit(x)), "the shadow of the step");
    let map = of.channel_mapping(ChannelId(0)).expect("a map");
    for (_, pixel) in pixels(&wall, 3) {
        let Some(point) = map.display_from_pixel(pixel.as_dvec2() + 0.5) else { continue };
        assert!(!(-0.99..-0.01).contains(&point.x) || point.z > -2.99, "{point} is in the shadow");
    }
}

/// In a room all around it, some of a projector's light goes wherever it looks; a mesh that is
/// met from behind is dark.
#[test]
fn a_projector_within_a_closed_mesh_lights_it_and_one_outside_its_back() {
    let ball = |place: DVec2| {
        let angle = place * DVec2::new(std::f64::consts::TAU, std::f64::consts::PI);
        let (sin, cos) = angle.y.sin_cos();
        DVec3::new(-angle.x.sin() * sin, cos, angle.x.cos() * sin) * 2.0
    };
    let file = mesh([64, 32], ball);
    for look_at in [DVec3::X, DVec3::NEG_Z, DVec3::new(0.1, 1.0, 0.2), DVec3::Z] {
        let beam = beam(DVec3::new(0.3, -0.2, 0.1), look_at * 9.0, 0.7);
        let (wall, shapes) = lit(file.clone(), beam);
        let map = ResolvedWall { wall: &wall, shapes: &shapes }
            .channel_mapping(ChannelId(0))
            .expect("a map");
        for (_, pixel) in pixels(&wall, 5) {
            let point = map.display_from_pixel(pixel.as_dvec2() + 0.5).expect("a wall all around");
            assert!((1.95..2.001).contains(&point.length()), "{point}");
        }
    }
    let (wall, shapes) = lit(file, beam(DVec3::Z * 9.0, DVec3::ZERO, 0.1));
    let map =
        ResolvedWall { wall: &wall, shapes: &shapes }.channel_mapping(ChannelId(0)).expect("a map");
    let point = map.display_from_pixel(DVec2::splat(32.0)).expect("its near side");
    assert!(map.is_rear() && point.distance(DVec3::Z * 2.0) < 0.05, "{point}");
}

/// Holes of a few pixels, between the places at which a cell of 64 pixels is looked at, are dark to
/// the pixel.
#[test]
fn small_holes_of_a_mesh_are_dark() {
    let board = |place: DVec2| DVec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, -3.0);
    // Cells of 3.6 pixels, of which two are not there.
    let CalibrationMap::Warp(mut warp) = mesh([40, 20], board) else { panic!("a warp") };
    let WarpGeometry::Mesh(all) = &mut warp.shape else { panic!("a mesh") };
    let mut half = 0..;
    let holes = [5 * 40 + 15, 13 * 40 + 24];
    all.triangles.retain(|_| half.next().is_some_and(|half| !holes.contains(&(half / 2))));
    assert_eq!(all.triangles.len(), 2 * (40 * 20 - 2));
    let beam = beam(DVec3::ZERO, DVec3::NEG_Z, 0.3);
    let (mut wall, shapes) = lit(CalibrationMap::Warp(warp), beam);
    for is_bent in [false, true] {
        if is_bent {
            bend(&mut wall);
        }
        let of = ResolvedWall { wall: &wall, shapes: &shapes };
        let map = of.channel_mapping(ChannelId(0)).expect("a map");
        let drawn = map.drawn_mesh();
        let mut dark = 0;
        for (_, pixel) in pixels(&wall, 1) {
            let pixel = pixel.as_dvec2() + 0.5;
            let is_lit = map.drawn_from_pixel(pixel).is_some();
            assert_eq!(drawn.point_at(pixel).is_some(), is_lit, "{pixel}, bent {is_bent}");
            dark += usize::from(!is_lit);
        }
        assert!(dark >= 12, "{dark} pixels");
    }
}

/// A tile's pixel at a place of the canvas is the same with the mesh's point there and without.
#[test]
fn tiles_of_a_mesh_are_found_without_its_points() {
    let hill = |place: DVec2| DVec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, -3.0);
    let mut tile = Channel::tile("tile", 0, UVec2::new(60, 20), UVec2::splat(64));
    tile.adjustment.pin[2] = DVec2::new(5.0, -3.0);
    let (wall, shapes) = lit(mesh([8, 4], hill), tile);
    let of = ResolvedWall { wall: &wall, shapes: &shapes };
    let lamp = BlendChannel::new(of, &wall.channels[0]);
    for (_, pixel) in pixels(&wall, 5) {
        let pixel = pixel.as_dvec2() + 0.5;
        let canvas = lamp.canvas(pixel).expect("on the canvas");
        let spot = lamp.spot(pixel).expect("on the canvas");
        let due = lamp.pixel_of(&spot);
        assert!(due.is_some() && lamp.pixel(canvas) == due, "{canvas}: {due:?}");
    }
}

/// Triangles of no area lie in many meshes; they neither light nor hide.
#[test]
fn triangles_without_an_area_change_nothing() {
    let board = |place: DVec2| DVec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, -3.0);
    let good = mesh([8, 4], board);
    let CalibrationMap::Warp(mut warp) = good.clone() else { panic!("a warp") };
    let WarpGeometry::Mesh(all) = &mut warp.shape else { panic!("a mesh") };
    let first = all.vertices.len() as u32;
    let speck = Vertex { place: Vec2::splat(0.5), value: Vec3::new(0.1, 0.1, -1.0), light: 1.0 };
    all.vertices.extend([speck, Vertex { value: Vec3::new(0.5, 0.1, -1.0), ..speck }]);
    all.triangles.extend([[first; 3], [first, first + 1, first], [0, 0, 5], [3, 4, 3]]);
    let beam = beam(DVec3::ZERO, DVec3::NEG_Z, 0.3);
    let (good, bad) = (lit(good, beam.clone()), lit(CalibrationMap::Warp(warp), beam));
    let [due, found] = [&good, &bad].map(|(wall, shapes)| {
        ResolvedWall { wall, shapes }.channel_mapping(ChannelId(0)).expect("a map")
    });
    for (_, pixel) in pixels(&good.0, 3) {
        let pixel = pixel.as_dvec2() + 0.5;
        let [due, found] = [&due, &found].map(|map| map.display_from_pixel(pixel).expect("lit"));
        assert!(due.distance(found) < 1e-9, "{due} {found}");
    }
}

/// Warps on a mesh: by places of its canvas, and by points.
#[test]
fn warps_lie_on_the_canvas_of_a_mesh() {
    let hill = |place: DVec2| {
        let height = (place.x * 3.0).sin() * 0.3;
        DVec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, height - 3.0)
    };
    let left_half = mesh([20, 4], |place| hill(place * DVec2::new(0.5, 1.0)));
    let on_canvas = grid(UVec2::new(2, 2), |place| Some(DVec3::new(place.x * 0.5, place.y, 0.0)));
    let on_canvas =
        CalibrationMap::Warp(WarpMap { space: MapCoordinates::Canvas, shape: on_canvas });
    for warp in [left_half, on_canvas] {
        let mut channel = Channel::tile("left", 0, UVec2::ZERO, UVec2::new(100, 100));
        channel.cover = ChannelKind::Map;
        channel.adjustment.warp = Some(1);
        let screen = Screen::new("hill", Surface::Mesh(0), UVec2::new(200, 100));
        let mut wall = Wall::new("w", vec![screen], vec![channel]);
        let files = [mesh([40, 4], hill), warp];
        for (index, kind) in [(0, CalibrationFileKind::ScreenMesh), (1, CalibrationFileKind::Warp)]
        {
            let blob = Some(BlobHash([index; 32]));
            wall.files.push(CalibrationFile {
                path: "x".into(),
                kind,
                blob,
                is_for_one_eye: false,
                front: Vec::new(),
            });
        }
        let read = |hash: BlobHash| Ok(Arc::new(files[usize::from(hash.0[0])].clone()));
        let maps = CalibrationMaps::load(&wall, read).expect("sound");
        let shapes = WallGeometry::new(&wall, &maps);
        let map = ResolvedWall { wall: &wall, shapes: &shapes }
            .channel_mapping(ChannelId(0))
            .expect("a map");
        for at in [[10.5, 20.5], [50.5, 99.5], [99.0, 1.0], [33.3, 77.7]] {
            let pixel = DVec2::from(at);
            let canvas = map.canvas_from_pixel(pixel).expect("on the canvas");
            assert!(canvas.distance(pixel) < 0.02, "{pixel}: {canvas}");
            let back = map.pixel_from_canvas(pixel).expect("of the picture");
            assert!(back.distance(pixel) < 0.02, "{pixel}: {back}");
        }
        assert_eq!(map.pixel_from_canvas(DVec2::new(150.0, 50.0)), None);
    }
}
