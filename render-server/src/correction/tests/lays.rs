//! Views of their own on curved, bent and projected channels, against rays of their cameras in f64.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_wall::camera::Camera;
use polyptych_wall::channel_calibration::ControlGrid;
use polyptych_wall::projector::Projector;
use polyptych_wall::view::{Area, ViewProjection};
use polyptych_wall::warp::{
    CalibrationMap, ImportedMesh, ImportedVertex, MapCoordinates, WarpGeometry, WarpGrid, WarpMap,
};
use polyptych_wall::{CalibrationFile, CalibrationFileKind};

use super::*;

/// The codes of a channel that shows these views.
fn codes(wall: &Wall, maps: &CalibrationMaps, scene: &GpuScene, views: &[View]) -> Vec<[u8; 4]> {
    let plan =
        CorrectionPlan::new(wall, maps, ChannelId(0)).expect("a plan").expect("a correction");
    let mut corrector = Corrector::new(gpu(), plan, wall, None).expect("a corrector");
    let mut renderer = Renderer::new(gpu(), 1).expect("a renderer");
    renderer.prepare_for(gpu(), scene, ImageEncoding::Light);
    let mut output = ChannelOutput::new("curve".into(), None, None);
    let mut frame = frame(wall.head());
    frame.presentation.views = views.to_vec();
    wall.check_views(views).expect("views that can be");
    let drawing = (&mut renderer, scene);
    corrector.draw(gpu(), drawing, wall, &frame, &mut output).expect("drawn");
    let bytes = read_picture(gpu(), output.picture().expect("a picture")).expect("read");
    bytes.as_chunks::<4>().0.to_vec()
}

/// Display light of the spots along a view's ray to a place of its window, by hand.
fn seen(view: &View, size_m: DVec2, place: DVec2, spots: &[Spot]) -> f64 {
    let Camera { position, rotation, .. } = view.camera;
    let at = DVec2::new(place.x - 0.5, 0.5 - place.y) * size_m / size_m.y;
    let (eye, ray) = match view.projection {
        ViewProjection::Perspective { fov_y_rad } => {
            let half = (fov_y_rad / 2.0).tan() * 2.0;
            (position, rotation * (at * half).extend(-1.0))
        }
        ViewProjection::Orthographic { height_m } => {
            (position + rotation * (at * height_m).extend(0.0), rotation * DVec3::NEG_Z)
        }
        ViewProjection::Wall => panic!("it has none"),
    };
    spots.iter().map(|spot| spot.light(eye, ray)).sum()
}

/// Four spots on a sheet before the camera at the origin, and a camera that sees them.
fn spots() -> Vec<Spot> {
    [(-0.9, -0.5), (0.8, -0.4), (-0.7, 0.55), (1.0, 0.5)]
        .map(|(x, y)| Spot { place: DVec3::new(x, y, -4.0), half: 0.5 })
        .into()
}

fn lenses() -> [ViewProjection; 2] {
    [
        ViewProjection::Perspective { fov_y_rad: 0.55 },
        ViewProjection::Orthographic { height_m: 2.2 },
    ]
}

fn laid(rect: [u32; 4], projection: ViewProjection) -> View {
    let area = Area::Screen { screen: 0, rect };
    View { area, projection, ..View::of_wall(Camera::IDENTITY) }
}

/// A wall's own view that sees none of the spots.
fn away() -> View {
    let rotation = DQuat::from_rotation_y(PI);
    View::of_wall(Camera { rotation, ..Camera::IDENTITY })
}

/// Width and height in metres of a rectangle, as it lies, by differences of the surface's points.
fn size_m(screen: &Screen, [x, y, width, height]: [u32; 4]) -> DVec2 {
    let middle =
        DVec2::new(f64::from(x) + f64::from(width) / 2.0, f64::from(y) + f64::from(height) / 2.0);
    let at = |offset: DVec2| screen.display_from_canvas(middle + offset);
    let span = |step: DVec2| match (at(-step), at(step)) {
        (Some(a), Some(b)) => a.distance(b) / 2e-3,
        _ => 1.0,
    };
    DVec2::new(span(DVec2::X * 1e-3) * f64::from(width), span(DVec2::Y * 1e-3) * f64::from(height))
}

/// The view's picture lies where it should, and as bright, and nothing else has changed.
fn check_lay(
    name: &str,
    (wall, maps): (&Wall, &CalibrationMaps),
    rect: [u32; 4],
    canvas_of: impl Fn(DVec2) -> Option<DVec2>,
) {
    let spots = spots();
    let scene = scene(&spots);
    let size = wall.channels[0].size;
    let [x, y, width, height] = rect.map(f64::from);
    let size_m = size_m(&wall.screens[0], rect);
    for projection in lenses() {
        let view = laid(rect, projection);
        let drawn = codes(wall, maps, &scene, &[away(), view.clone()]);
        let light: Vec<f64> =
            drawn.iter().map(|code| linear_from_srgb(f64::from(code[0]) / 255.0)).collect();
        let places: Vec<Option<DVec2>> = (0..size.y)
            .flat_map(|row| (0..size.x).map(move |column| UVec2::new(column, row)))
            .map(|pixel| {
                let canvas = canvas_of(pixel.as_dvec2() + 0.5)?;
                let place = (canvas - DVec2::new(x, y)) / DVec2::new(width, height);
                let is_in = place.cmpge(DVec2::ZERO).all() && place.cmplt(DVec2::ONE).all();
                is_in.then_some(place)
            })
            .collect();
        let (mut most, mut worst) = (0f64, 0f64);
        for spot in &spots {
            let wanted: Vec<f64> = places
                .iter()
                .map(|place| place.map_or(0.0, |at| seen(&view, size_m, at, &[*spot])))
                .collect();
            let columns = size.x as usize;
            let (is, should) =
                (measure(&light, &wanted, columns), measure(&wanted, &wanted, columns));
            assert!(should.sum > 5.0, "{name}: the spot at {} is not on the display", spot.place);
            most = most.max(is.middle.distance(should.middle));
            worst = worst.max((is.sum / should.sum - 1.0).abs());
        }
        println!("{name}, {projection:?}: off by {most:.4} px, light by {worst:.4}");
        assert!(most <= 0.05 && worst < 0.02, "{name}: off by {most} px, light by {worst}");
        // Beside it, the wall's own picture: dark here.
        let beside = places.iter().zip(&drawn).filter(|(place, _)| place.is_none());
        let lit = beside.filter(|(_, code)| code[0] > 0).count();
        assert_eq!(lit, 0, "{name}: pixels beside it");
    }
}

fn by_form(wall: &Wall) -> impl Fn(DVec2) -> Option<DVec2> {
    let map = wall.channel_mapping(ChannelId(0)).expect("a map");
    move |pixel| map.canvas_from_pixel(pixel)
}

#[test]
fn a_cylinder_has_the_picture_as_paper_would() {
    let wall = wall(cylinder(1.2, DQuat::from_rotation_y(0.4)), [240, 134]);
    check_lay("cylinder", (&wall, &CalibrationMaps::default()), [30, 12, 180, 110], by_form(&wall));
}

#[test]
fn a_cylinder_changes_no_pixel_of_a_display_that_is_flat() {
    let (spots, maps, rect) = (spots(), CalibrationMaps::default(), [20, 10, 96, 64]);
    let scene = scene(&spots);
    let round = wall(cylinder(1.0, DQuat::IDENTITY), [160, 100]);
    // As large, flat, and through a correction that moves nothing.
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.0, 2.0));
    let mut flat = wall(Surface::Plane(plane), [160, 100]);
    flat.channels[0].adjustment.color.gain = DVec3::splat(1.0 - 1e-9);
    for projection in lenses() {
        let views = [away(), laid(rect, projection)];
        let [round, flat] = [&round, &flat].map(|wall| codes(wall, &maps, &scene, &views));
        let differ = round.iter().zip(&flat).filter(|(a, b)| a[0].abs_diff(b[0]) > 0).count();
        let lit = flat.iter().filter(|code| code[0] > 0).count();
        println!("{projection:?}: {differ} of {lit} lit pixels differ");
        assert!(lit > 500, "{lit} lit");
        assert_eq!(differ, 0, "{projection:?}");
    }
}

fn dome(elevation_rad: [f64; 2], azimuth_rad: [f64; 2]) -> Surface {
    Surface::Sphere(Sphere {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 4.0,
        azimuth_rad,
        elevation_rad,
    })
}

#[test]
fn a_dome_has_the_picture_by_azimuth_and_elevation() {
    let wall = wall(dome([0.0, 1.0], [-0.8, 0.8]), [240, 150]);
    check_lay("dome", (&wall, &CalibrationMaps::default()), [40, 20, 170, 100], by_form(&wall));
}

/// A projector from the middle, straight up into a whole dome: the pole is in its picture, and all
/// around it the canvas's edge.
#[test]
fn a_projector_at_the_pole_has_the_picture_around_it() {
    let mut wall = wall(dome([0.0, FRAC_PI_2], [-PI, PI]), [1024, 256]);
    wall.channels[0].size = UVec2::new(220, 220);
    wall.channels[0].cover = ChannelKind::Projector(Box::new(Projector {
        position: DVec3::new(0.1, 0.0, 0.05),
        rotation: DQuat::from_rotation_x(FRAC_PI_2),
        tangents: [-1.0, 1.0, -1.0, 1.0],
    }));
    for (x, width) in [(300, 424), (0, 1024), (700, 324)] {
        let name = format!("pole from {x}");
        check_lay(&name, (&wall, &CalibrationMaps::default()), [x, 30, width, 170], by_form(&wall));
    }
}

#[test]
fn pins_and_bends_move_the_picture() {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.2, 1.8));
    let mut bent = wall(Surface::Plane(plane), [240, 135]);
    let adjustment = &mut bent.channels[0].adjustment;
    adjustment.pin[0] = DVec2::new(20.0, 12.0);
    adjustment.pin[3] = DVec2::new(-9.0, -5.0);
    let mut moves = vec![DVec2::ZERO; 9];
    moves[4] = DVec2::new(3.0, -2.0);
    adjustment.bend = Some(ControlGrid { points: UVec2::splat(3), moves: moves.into() });
    check_lay(
        "pinned and bent",
        (&bent, &CalibrationMaps::default()),
        [40, 20, 160, 95],
        by_form(&bent),
    );
}

#[test]
fn a_projector_has_the_picture_where_the_screen_has_it() {
    let mut wall = wall(cylinder(1.2, DQuat::IDENTITY), [400, 222]);
    wall.channels[0].size = UVec2::new(240, 150);
    wall.channels[0].cover = ChannelKind::Projector(Box::new(Projector {
        position: DVec3::new(0.3, 0.2, 0.4),
        rotation: DQuat::from_rotation_y(-0.1) * DQuat::from_rotation_z(0.05),
        tangents: [-0.45, 0.45, -0.28, 0.28],
    }));
    check_lay(
        "projector",
        (&wall, &CalibrationMaps::default()),
        [90, 40, 200, 120],
        by_form(&wall),
    );
}

fn with_file(wall: &mut Wall, kind: CalibrationFileKind, map: WarpMap) -> CalibrationMaps {
    let blob = Some(BlobHash([7; 32]));
    let front = Vec::new();
    wall.files.push(CalibrationFile { path: "f".into(), kind, blob, is_for_one_eye: false, front });
    let map = Arc::new(CalibrationMap::Warp(map));
    CalibrationMaps::load(wall, |_| Ok(Arc::clone(&map))).expect("maps")
}

/// Returns the position on the canvas that a file gives to a point of the picture: a little askew.
fn askew(place: Vec2) -> Vec2 {
    Vec2::new(0.1 + 0.7 * place.x + 0.05 * place.y, 0.05 + 0.08 * place.x + 0.8 * place.y)
}

#[test]
fn files_of_places_have_the_picture_where_they_say() {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.2, 1.8));
    let screen = wall(Surface::Plane(plane), [320, 180]);
    let canvas_of = |pixel: DVec2| {
        let place = (pixel / DVec2::new(240.0, 135.0)).as_vec2();
        Some(askew(place).as_dvec2() * DVec2::new(320.0, 180.0))
    };
    let cell = |i: u32| Vec2::new((i % 48) as f32 + 0.5, (i / 48) as f32 + 0.5);
    let values = (0..48 * 27).map(|i| askew(cell(i) / Vec2::new(48.0, 27.0)).extend(0.0));
    let grid = WarpGeometry::Grid(WarpGrid::new(UVec2::new(48, 27), values.collect()));
    let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| Vec2::new(x, y));
    let vertex = |place: Vec2| {
        let value = askew(place).extend(0.0);
        ImportedVertex { place, value, light: 1.0 }
    };
    let vertices = corners.map(vertex).to_vec();
    let mesh = WarpGeometry::Mesh(ImportedMesh { vertices, triangles: vec![[0, 1, 2], [2, 1, 3]] });
    for (name, shape) in [("grid", grid), ("mesh", mesh)] {
        let mut wall = screen.clone();
        wall.channels[0].size = UVec2::new(240, 135);
        (wall.channels[0].cover, wall.channels[0].adjustment.warp) = (ChannelKind::Map, Some(0));
        let warp = WarpMap { space: MapCoordinates::Canvas, shape };
        let maps = with_file(&mut wall, CalibrationFileKind::Warp, warp);
        check_lay(name, (&wall, &maps), [60, 30, 190, 120], canvas_of);
    }
}

/// A measured warp that turns back over half a hundredth of its pixels is shown, and so is a view
/// that lies where most of those are.
#[test]
fn a_view_over_the_few_pixels_that_turn_back_is_shown() {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(3.2, 0.8));
    let mut wall = wall(Surface::Plane(plane), [400, 100]);
    let vertex = |x: f32, y: f32, u: f32| ImportedVertex {
        place: Vec2::new(x, y),
        value: Vec3::new(u, y, 0.0),
        light: 1.0,
    };
    let row = |y| [vertex(0.0, y, 0.0), vertex(0.995, y, 0.995), vertex(1.0, y, 0.99)];
    let vertices = [row(0.0), row(1.0)].concat();
    let triangles = vec![[0, 1, 3], [3, 1, 4], [1, 2, 4], [4, 2, 5]];
    let shape = WarpGeometry::Mesh(ImportedMesh { vertices, triangles });
    (wall.channels[0].cover, wall.channels[0].adjustment.warp) = (ChannelKind::Map, Some(0));
    let map = WarpMap { space: MapCoordinates::Canvas, shape };
    let maps = with_file(&mut wall, CalibrationFileKind::Warp, map);
    let plan =
        CorrectionPlan::new(&wall, &maps, ChannelId(0)).expect("a plan").expect("a correction");
    let mut corrector = Corrector::new(gpu(), plan, &wall, None).expect("a corrector");
    for projection in [ViewProjection::Wall, lenses()[1]] {
        let mut frame = frame(wall.head());
        frame.presentation.views = vec![laid([390, 20, 10, 60], projection)];
        let layers = corrector.layers(gpu(), &wall, &frame).expect("both layers");
        assert_eq!(layers.len(), 2, "{projection:?}");
    }
}

/// A hill of two slopes in a file, whose places are the canvas: as a tile of it has them.
#[test]
fn a_screen_in_a_file_has_the_picture_by_its_own_places() {
    let mut hill = wall(Surface::Mesh(0), [240, 136]);
    let point = |u: f32, v: f32, z: f32| ImportedVertex {
        place: Vec2::new(u, v),
        value: Vec3::new(u * 2.0 - 1.0, 0.6 - v * 1.2, z),
        light: 1.0,
    };
    let rows = [0.0, 1.0].map(|v| [point(0.0, v, -2.0), point(0.5, v, -2.3), point(1.0, v, -2.0)]);
    let triangles = vec![[0, 1, 3], [3, 1, 4], [1, 2, 4], [4, 2, 5]];
    let mesh = ImportedMesh { vertices: rows.concat(), triangles };
    let map = WarpMap { space: MapCoordinates::Display, shape: WarpGeometry::Mesh(mesh) };
    let maps = with_file(&mut hill, CalibrationFileKind::ScreenMesh, map);
    check_lay("hill", (&hill, &maps), [30, 12, 180, 110], Some);
    // Through a warp of points besides, nothing says which.
    hill.channels[0].adjustment.warp = Some(0);
    let plan = laid([0, 0, 10, 10], lenses()[1]);
    let said = hill.check_views(&[plan]).expect_err("refused").to_string();
    assert!(said.starts_with("channel curve: ") && said.contains("a plane, a cylinder"), "{said}");
}

#[test]
fn views_with_a_camera_of_their_own_have_the_resolution_in_force() {
    let wall = wall(cylinder(1.2, DQuat::IDENTITY), [480, 268]);
    let maps = CalibrationMaps::default();
    let plan =
        CorrectionPlan::new(&wall, &maps, ChannelId(0)).expect("a plan").expect("a correction");
    for projection in lenses() {
        let mut corrector = Corrector::new(gpu(), plan.clone(), &wall, None).expect("a corrector");
        let mut frame = frame(wall.head());
        frame.presentation.views = vec![away(), laid([40, 20, 400, 220], projection)];
        let texels = [0, 4, 0].map(|steps| {
            frame.detail.resolution_steps = steps;
            let layers = corrector.layers(gpu(), &wall, &frame).expect("both layers");
            layers[1].shots.size.map(f64::from).iter().product::<f64>()
        });
        // A half along each side, and a guard of as many texels at either resolution.
        let share = texels[1] / texels[0];
        assert!((0.24..0.28).contains(&share), "{projection:?}: {share} of the texels");
        assert_eq!(texels[2], texels[0], "{projection:?}");
    }
}

/// The wall's own frusta with another camera, on a part of a curve: there as that camera alone
/// would have it on all of it, and as before beside it.
#[test]
fn a_part_of_a_curve_shows_another_camera_through_the_walls_frusta() {
    let turned = DQuat::from_rotation_y(0.35);
    let wall = wall(cylinder(1.0, DQuat::IDENTITY), [200, 134]);
    let spots: Vec<_> = (-4..=4)
        .map(|at| Spot { place: toward(f64::from(at) * 0.25, 0.0, 5.0), half: 0.5 })
        .collect();
    let (scene, maps) = (scene(&spots), CalibrationMaps::default());
    let base = View::of_wall(Camera::IDENTITY);
    let other = View::of_wall(Camera { rotation: turned, ..Camera::IDENTITY });
    let rect = [50, 20, 90, 80];
    let part = View { area: Area::Screen { screen: 0, rect }, ..other.clone() };
    let [below, above, both] = [vec![base.clone()], vec![other], vec![base, part]]
        .map(|views| codes(&wall, &maps, &scene, &views));
    assert_ne!(below, above);
    let (mut most, mut off) = (0, 0);
    for (at, code) in both.iter().enumerate() {
        let (x, y) = (at as u32 % 200, at as u32 / 200);
        let is_in = (50..140).contains(&x) && (20..100).contains(&y);
        if is_in {
            // Sampled from a smaller source, whose pixels lie elsewhere.
            let difference = code[0].abs_diff(above[at][0]);
            most = most.max(difference);
            off += usize::from(difference > 2);
        } else {
            assert_eq!(*code, below[at], "beside it at ({x}, {y})");
        }
    }
    println!("within it off by {most} levels, {off} pixels by more than 2");
    assert!(most <= 6 && off * 50 < 90 * 80, "{most} levels, {off} pixels by more than 2");
}
