//! Walls whose geometry stands in files, against the same walls by their geometry.

mod hard;
mod meshes;

use glam::{UVec2, Vec3};
use polyptych_files::blob::BlobHash;

use super::super::blend::tests::walls::{askew, bend};
use super::super::blend::{BlendModel, ChannelMasks, blend_map};
use super::super::light_composite::{DisplayImage, LightComposite, StereoEye};
use super::super::warp::{CalibrationMap, MapCoordinates, WarpGrid};
use super::super::{CalibrationFile, CalibrationFileKind, ChannelKind};
use super::*;
use crate::ChannelId;

/// Maximum error of a warp's cells and of rounding to f32, in pixels; a warped pixel may be off by
/// three times as much.
const PLACE_ERROR_MAX: f64 = 0.03;

/// Makes these the files of a wall, all of one kind.
fn with_files(
    wall: &mut Wall,
    kind: CalibrationFileKind,
    files: &[CalibrationMap],
) -> CalibrationMaps {
    for index in 0..files.len() as u8 {
        let blob = Some(BlobHash([index; 32]));
        wall.files.push(CalibrationFile {
            path: index.to_string(),
            kind,
            blob,
            is_for_one_eye: false,
            front: Vec::new(),
        });
    }
    CalibrationMaps::load(wall, |hash| Ok(Arc::new(files[usize::from(hash.0[0])].clone())))
        .expect("sound")
}

/// Values at the middles of cells, by their places in a picture; NaN where there are none.
fn grid(size: UVec2, value: impl Fn(DVec2) -> Option<DVec3>) -> WarpGeometry {
    let place = |i: u32| UVec2::new(i % size.x, i / size.x).as_dvec2() + 0.5;
    let value = |i| value(place(i) / size.as_dvec2()).map_or(Vec3::NAN, DVec3::as_vec3);
    WarpGeometry::Grid(WarpGrid::new(size, (0..size.x * size.y).map(value).collect()))
}

/// Returns the wall as if a program had measured it: a map for each channel, with as many points as
/// pixels.
fn measured(wall: &Wall, space: MapCoordinates) -> (Wall, CalibrationMaps) {
    let mut by_files = wall.clone();
    let mut files = Vec::new();
    for (index, (id, channel)) in wall.channel_ids().zip(&mut by_files.channels).enumerate() {
        let (map, size) = (wall.channel_mapping(id).expect("a picture"), channel.size);
        let canvas = wall.screens[usize::from(channel.screen)].canvas.as_dvec2();
        let shape = grid(size, |place| match space {
            MapCoordinates::Display => map.display_from_pixel(place * size.as_dvec2()),
            MapCoordinates::Canvas => {
                let at = map.canvas_from_pixel(place * size.as_dvec2())? / canvas;
                Some(at.extend(0.0))
            }
        });
        files.push(CalibrationMap::Warp(WarpMap { space, shape }));
        channel.cover = ChannelKind::Map;
        channel.adjustment =
            ChannelCalibration { warp: Some(index as u16), ..ChannelCalibration::default() };
    }
    let maps = with_files(&mut by_files, CalibrationFileKind::Warp, &files);
    (by_files, maps)
}

/// Some pixels of every channel: its id and the place.
fn pixels(wall: &Wall, step: usize) -> impl Iterator<Item = (ChannelId, UVec2)> + '_ {
    wall.channel_ids().zip(&wall.channels).flat_map(move |(id, channel)| {
        let size = channel.size;
        let all = (0..size.y).flat_map(move |y| (0..size.x).map(move |x| UVec2::new(x, y)));
        all.step_by(step).map(move |pixel| (id, pixel))
    })
}

#[test]
fn pixels_by_a_file_lie_where_geometry_says() {
    for (is_round, is_bent, space) in [
        (false, false, MapCoordinates::Display),
        (false, true, MapCoordinates::Canvas),
        (true, false, MapCoordinates::Display),
        (true, true, MapCoordinates::Display),
        (true, false, MapCoordinates::Canvas),
    ] {
        let mut wall = askew(is_round, UVec2::new(160, 100), 0.06);
        if is_bent {
            bend(&mut wall);
        }
        let (by_files, maps) = measured(&wall, space);
        let shapes = WallGeometry::new(&by_files, &maps);
        let of = ResolvedWall { wall: &by_files, shapes: &shapes };
        let mut worst = [0.0_f64; 2];
        for (id, pixel) in pixels(&wall, 7) {
            let pixel = pixel.as_dvec2() + 0.5;
            let (due, map) =
                (wall.channel_mapping(id).expect("due"), of.channel_mapping(id).expect("a map"));
            let Some(canvas) = due.canvas_from_pixel(pixel) else { continue };
            let found = map.canvas_from_pixel(pixel).expect("on the canvas");
            // What is one pixel of the channel, on the canvas.
            let beside = due.canvas_from_pixel(pixel + DVec2::X * 0.1).expect("beside");
            let pitch = beside.distance(canvas) * 10.0;
            worst[0] = worst[0].max(found.distance(canvas) / pitch);
            let back = map.pixel_from_canvas(canvas).expect("of the picture");
            worst[1] = worst[1].max(back.distance(pixel));
        }
        println!("round {is_round}, bent {is_bent}, {space:?}: {worst:.5?} pixels off, and back");
        assert!(worst.iter().all(|off| *off < PLACE_ERROR_MAX), "{worst:?}");
    }
}

#[test]
fn weights_of_channels_by_files_add_up_to_one() {
    for is_round in [false, true] {
        let wall = askew(is_round, UVec2::new(160, 100), 0.06);
        let (by_files, maps) = measured(&wall, MapCoordinates::Display);
        let shapes = WallGeometry::new(&by_files, &maps);
        let of = ResolvedWall { wall: &by_files, shapes: &shapes };
        let (blend, due) = (BlendModel::new(of), BlendModel::new(&wall));
        let lights = |id| blend_map(of, id, &ChannelMasks::default()).expect("a light map");
        let lights: Vec<_> = wall.channel_ids().map(lights).collect();
        let (mut sums, mut others_off, mut most) = (0.0_f64, 0.0_f64, 0);
        for (id, pixel) in pixels(&wall, 5) {
            let at = pixel.as_dvec2() + 0.5;
            let canvas = of.channel_mapping(id).expect("a map").canvas_from_pixel(at).expect("lit");
            let own = lights[usize::from(id.0)].texel(pixel.x, pixel.y, 0)[0];
            let weights = blend.weights(id, canvas);
            let others = weights.iter().filter(|(other, _)| *other != id);
            sums = sums.max((own + others.map(|(_, weight)| weight).sum::<f64>() - 1.0).abs());
            most = most.max(weights.len());
            let known: BTreeMap<_, _> = due.weights(id, canvas).into_iter().collect();
            for (id, weight) in weights {
                // At an edge one of both may count a channel with a weight of almost nothing.
                let due = known.get(&id).copied().unwrap_or(0.0);
                others_off = others_off.max((weight - due).abs());
            }
        }
        println!(
            "round {is_round}: sums of up to {most} weights off by {sums:.2e}, weights by \
                  {others_off:.2e} from those by geometry"
        );
        assert_eq!(most, due.overlap_max());
        assert!(sums <= 1.0 / 4096.0, "{sums:e}");
        assert!(others_off <= 0.01, "{others_off:e}");
    }
}

/// A picture passes through all channels, each sharing its light, and is compared with itself in
/// levels.
#[test]
fn a_screen_of_files_is_stitched_as_one_of_geometry() {
    for (is_round, space) in [(false, MapCoordinates::Canvas), (true, MapCoordinates::Display)] {
        let wall = askew(is_round, UVec2::new(160, 100), 0.06);
        let (by_files, maps) = measured(&wall, space);
        let shapes = WallGeometry::new(&by_files, &maps);
        let of = ResolvedWall { wall: &by_files, shapes: &shapes };
        let picture = |at: DVec2| 0.5 + 0.3 * (at.x / 13.0).sin() * (at.y / 17.0).cos();
        let codes = |of: ResolvedWall<'_>, id: ChannelId| -> Vec<u8> {
            let map = of.channel_mapping(id).expect("a map");
            let blend = BlendModel::new(of);
            let light = blend.blend_map(id, &ChannelMasks::default());
            let color = blend.color(id).expect("a channel");
            let plain = [DVec3::ONE, DVec3::ZERO];
            let all = pixels(of.wall, 1).filter(|(other, _)| *other == id);
            let code = |pixel: UVec2| {
                let at = map.canvas_from_pixel(pixel.as_dvec2() + 0.5);
                let [by, add] = light.as_ref().map_or(plain, |map| map.light_at(pixel.x, pixel.y));
                let light = DVec3::splat(at.map_or(0.0, picture));
                let codes = color.codes(light, by, add) * 255.0;
                let [r, g, b] = codes.round().to_array().map(|code| code as u8);
                [r, g, b, 255]
            };
            all.flat_map(|(_, pixel)| code(pixel)).collect()
        };
        let stitch = |of: ResolvedWall<'_>| -> Vec<Option<DVec3>> {
            let all: Vec<_> = of.wall.channel_ids().map(|id| (id, codes(of, id))).collect();
            let pictures = all
                .iter()
                .map(|(id, rgba)| DisplayImage { channel: *id, rgba })
                .collect::<Vec<_>>();
            let shown = LightComposite::new(of, 0, StereoEye::Left, &pictures);
            (0..of.wall.screens[0].canvas.y).flat_map(|y| shown.row(y)).collect()
        };
        let (found, due) = (stitch(of), stitch((&wall).into()));
        let code = |light: DVec3| crate::color::srgb_from_linear(light.y) * 255.0;
        let lit = due.iter().filter(|light| light.is_some()).count();
        let both = found.iter().zip(&due);
        let mut off: Vec<f64> =
            both.filter_map(|(a, b)| Some((code((*a)?) - code((*b)?)).abs())).collect();
        off.sort_unstable_by(f64::total_cmp);
        let (nearly_all, largest) = (off[off.len() * 999 / 1000], off[off.len() - 1]);
        println!(
            "round {is_round}, {space:?}: {} of {lit} pixels, 99.9 % within {nearly_all:.3} \
                  levels, all within {largest:.2}",
            off.len()
        );
        assert!(off.len() > lit * 999 / 1000, "all are lit");
        assert!(nearly_all < 1.0, "{nearly_all}");
        // Without its files nobody knows what it shows.
        let blind = LightComposite::new(&by_files, 0, StereoEye::Left, &[]);
        assert!(blind.row(50).iter().all(Option::is_none));
    }
}

#[test]
fn views_lie_where_the_eye_sees_points_that_are_not_on_the_screen() {
    use crate::view::{CanvasRect, PointSpace};
    // A plane at 2 m stands for what is at 4 m, as in an imported MPCDI archive.
    let (size, canvas) = (UVec2::new(64, 32), UVec2::new(64, 32));
    let plane = crate::surface::Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(2.0, 1.0));
    let screen = Screen::new("front", Surface::Plane(plane), canvas);
    let mut channel = Channel::tile("c", 0, UVec2::ZERO, size);
    channel.cover = ChannelKind::Map;
    channel.adjustment.warp = Some(0);
    let mut wall = Wall { eye: DVec3::ZERO, ..Wall::new("w", vec![screen], vec![channel]) };
    let point = |place: DVec2| DVec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, -4.0);
    let grid = grid(size, |place| Some(point(place)));
    let mut triangles = Vec::new();
    for i in 0..12 {
        let at = i / 4 * 5 + i % 4;
        triangles.extend([[at, at + 1, at + 5], [at + 5, at + 1, at + 6]]);
    }
    let vertex = |i: u32| {
        let place = DVec2::new(f64::from(i % 5) / 4.0, f64::from(i / 5) / 3.0);
        let (place, value) = (place.as_vec2(), point(place).as_vec3());
        crate::warp::ImportedVertex { place, value, light: 1.0 }
    };
    let mesh = crate::warp::ImportedMesh { vertices: (0..20).map(vertex).collect(), triangles };
    for shape in [grid, WarpGeometry::Mesh(mesh)] {
        wall.files.clear();
        let map = CalibrationMap::Warp(WarpMap { space: MapCoordinates::Display, shape });
        let maps = with_files(&mut wall, CalibrationFileKind::Warp, &[map]);
        let shapes = WallGeometry::new(&wall, &maps);
        let shaped = ResolvedWall { wall: &wall, shapes: &shapes };
        let part = CanvasRect { begin: DVec2::ZERO, end: canvas.as_dvec2() };
        let mesh = shaped.overlay_mesh(&maps, ChannelId(0), part, PointSpace::Canvas);
        let mesh = mesh.expect("a mesh");
        for at in [[1.5, 1.5], [20.5, 9.5], [40.5, 30.5], [62.5, 16.5]].map(DVec2::from) {
            let found = mesh.point_at(at).unwrap_or_else(|| panic!("nothing at {at}"));
            let found = DVec2::new(found.x, -found.y) / -found.z;
            assert!(found.distance(at) < PLACE_ERROR_MAX, "{found} at {at}");
        }
    }
}

/// Views between the places at which the largest cells of a channel are looked at: a narrow one on
/// a plane, and one around the pole of a dome.
#[test]
fn views_have_all_of_their_pixels_however_narrow_they_are() {
    use std::f64::consts::{FRAC_PI_2, PI};

    use crate::view::{CanvasRect, PointSpace};
    let plane = crate::surface::Plane::upright(DVec3::NEG_Z * 2.0, DVec2::new(2.0, 1.0));
    let dome = crate::surface::Sphere {
        center: DVec3::ZERO,
        rotation: glam::DQuat::IDENTITY,
        radius_m: 4.0,
        azimuth_rad: [-PI, PI],
        elevation_rad: [0.0, FRAC_PI_2],
    };
    let beam = Projector {
        position: DVec3::new(0.1, 0.0, 0.05),
        rotation: glam::DQuat::from_rotation_x(FRAC_PI_2),
        tangents: [-1.0, 1.0, -1.0, 1.0],
    };
    for (surface, cover, canvas, [begin, end]) in [
        (Surface::Plane(plane), ChannelKind::Tile, [256, 128], [[36.0, 70.0], [60.0, 90.0]]),
        (
            Surface::Sphere(dome),
            ChannelKind::Projector(Box::new(beam)),
            [1024, 256],
            [[0.0, 0.0], [1024.0, 6.0]],
        ),
    ] {
        let screen = Screen::new("s", surface, UVec2::from(canvas));
        let mut channel = Channel::tile("c", 0, UVec2::ZERO, UVec2::new(220, 120));
        channel.cover = cover;
        let wall = Wall::new("w", vec![screen], vec![channel]);
        let (begin, end) = (DVec2::from(begin), DVec2::from(end));
        let shaped = ResolvedWall::from(&wall);
        let (maps, part) = (CalibrationMaps::default(), CanvasRect { begin, end });
        let mesh = shaped.overlay_mesh(&maps, ChannelId(0), part, PointSpace::Canvas);
        let mesh = mesh.expect("a mesh");
        let map = shaped.channel_mapping(ChannelId(0)).expect("a map");
        let mut lit = 0;
        for (_, pixel) in pixels(&wall, 1) {
            let pixel = pixel.as_dvec2() + 0.5;
            let at = map.canvas_from_pixel(pixel).expect("on the canvas");
            let is_due = at.cmpge(begin).all() && at.cmplt(end).all();
            assert_eq!(mesh.point_at(pixel).is_some(), is_due, "{pixel} shows {at}");
            lit += usize::from(is_due);
        }
        assert!(lit > 20, "{lit} pixels");
    }
}
