//! Holes and overlaps, counted and sampled.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::warp::{
    CalibrationMap, ImportedMesh, ImportedVertex, MapCoordinates, WarpGeometry, WarpMap,
};
use polyptych_wall::{Ramps, Wall};

use super::*;

fn of(text: &str) -> Vec<Coverage> {
    coverage(&crate::parse(text, "wall.toml".as_ref()).unwrap(), 0)
}

fn tiles(lines: &str) -> String {
    format!(
        "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.0]\n\
         center = [0.0, 0.0, -1.0]\n{lines}\n"
    )
}

fn by_hand(channels: &[[u32; 4]], more: &str) -> String {
    let channel = |(index, [x, y, width, height]): (usize, &[u32; 4])| {
        format!(
            "[[screen.channel]]\nname = \"c{index}\"\norigin = [{x}, {y}]\n\
             pixels = [{width}, {height}]\n"
        )
    };
    let channels: Vec<String> = channels.iter().enumerate().map(channel).collect();
    tiles("pixels = [200, 100]") + &channels.concat() + more
}

fn patch(x: f64, y: f64, width: f64, height: f64) -> Region {
    let (origin, size) = (DVec2::new(x, y), DVec2::new(width, height));
    Region { origin, size, area: width * height }
}

#[test]
fn tiles_cover_their_canvas_once() {
    let [found] = of(&tiles("tiles = { columns = 3, rows = 2, pixels = [200, 100] }"))[..]
        .to_vec()
        .try_into()
        .unwrap();
    assert_eq!((found.eye, found.layers_max, found.step_px), (Eye::Center, 1, DVec2::ZERO));
    assert!(found.holes.is_empty() && found.overlaps.is_empty(), "{found:?}");
}

#[test]
fn overlapping_tiles_are_counted_to_the_pixel() {
    let grid = "tiles = { columns = 3, rows = 2, pixels = [200, 100], overlap = [30, 10] }";
    let found = &of(&tiles(grid))[0];
    assert_eq!((found.layers_max, found.holes.len()), (4, 0));
    // Seven neighbours side by side or above each other, four across a corner.
    assert_eq!(found.overlaps.len(), 11);
    assert_eq!(found.overlaps[0].channels, [0, 1]);
    assert_eq!(found.overlaps[0].patch, patch(170.0, 0.0, 30.0, 100.0));
    assert!(found.overlaps.iter().all(|overlap| overlap.is_blended));
}

#[test]
fn holes_are_joined_and_the_largest_comes_first() {
    // Two that overlap, so that holes are allowed: one around the corner of the other.
    let text = by_hand(&[[0, 0, 100, 100], [90, 0, 50, 40], [150, 90, 50, 10]], "");
    let found = &of(&text)[0];
    let [hole] = found.holes.as_slice() else { panic!("{:?}", found.holes) };
    assert_eq!((hole.origin, hole.size), (DVec2::new(100.0, 0.0), DVec2::new(100.0, 100.0)));
    assert_eq!(hole.area, 200.0 * 100.0 - 100.0 * 100.0 - 40.0 * 40.0 - 500.0);
    let apart = by_hand(&[[0, 0, 100, 100], [90, 0, 50, 100], [150, 0, 20, 100]], "");
    let holes = &of(&apart)[0].holes;
    assert_eq!(holes[..], [patch(170.0, 0.0, 30.0, 100.0), patch(140.0, 0.0, 10.0, 100.0)]);
}

#[test]
fn each_eye_has_a_coverage_of_its_own() {
    let eyes = "[channel.c0]\neye = \"left\"\n[channel.c1]\neye = \"right\"\n";
    let text = by_hand(&[[0, 0, 200, 100], [0, 0, 200, 100]], eyes);
    let found = of(&text);
    assert_eq!(found.iter().map(|of| of.eye).collect::<Vec<_>>(), [Eye::Left, Eye::Right]);
    assert!(found.iter().all(|of| of.layers_max == 1 && of.overlaps.is_empty()), "{found:?}");
    // A channel for both eyes overlaps with each.
    let both = text.replace("\"right\"", "\"center\"");
    assert_eq!(of(&both).iter().map(|of| of.layers_max).collect::<Vec<_>>(), [2, 1]);
}

#[test]
fn projectors_are_sampled() {
    // 2 m before the screen, 1 m wide and high each, 10 cm of it shared; nothing at both sides.
    let beam = |index: u32, x: f64| {
        format!(
            "[[screen.channel]]\nname = \"p{index}\"\npixels = [640, 640]\n\
             [screen.channel.projector]\nposition = [{x}, 0, 1]\nrotation = [0, 0, 0]\n\
             tangents = [-0.25, 0.25, -0.25, 0.25]\n"
        )
    };
    let text = tiles("pixels = [2000, 1000]") + &beam(0, -0.45) + &beam(1, 0.45);
    let found = &of(&text)[0];
    assert!(
        found.step_px.cmpgt(DVec2::ZERO).all() && found.step_px.cmplt(DVec2::splat(10.0)).all()
    );
    let [overlap] = found.overlaps.as_slice() else { panic!("{:?}", found.overlaps) };
    let end = overlap.patch.origin + overlap.patch.size;
    assert!((overlap.patch.origin.x - 950.0).abs() <= found.step_px.x, "{overlap:?}");
    assert!((end.x - 1050.0).abs() <= found.step_px.x && overlap.patch.size.y > 995.0);
    let areas: Vec<f64> = found.holes.iter().map(|hole| hole.area).collect();
    // 5 cm of 1 m at both sides, a millimetre a pixel.
    assert!(areas.len() == 2 && areas.iter().all(|area| (area - 50_000.0).abs() < 8000.0));
    assert_eq!(found.layers_max, 2);
}

#[test]
fn a_projector_lights_the_near_side_of_a_round_screen_only() {
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"round\"\npixels = [3600, 100]\n\
                cylinder = { radius = 3.0, degrees = [-180, 180], height = [-0.2, 0.2] }\n\
                [[screen.channel]]\nname = \"beam\"\npixels = [800, 100]\n\
                [screen.channel.projector]\nposition = [0, 0, 0]\nrotation = [0, 0, 0]\n\
                degrees = [90, 30]\n";
    let found = &of(text)[0];
    let hole: f64 = found.holes.iter().map(|hole| hole.area).sum();
    assert!((hole / 360_000.0 - 0.75).abs() < 0.01, "{found:?}");
}

#[test]
fn ramps_without_width_are_not_blended() {
    let text = by_hand(&[[0, 0, 110, 100], [90, 0, 110, 100]], "");
    let mut wall = crate::parse(&text, "wall.toml".as_ref()).unwrap();
    assert!(coverage(&wall, 0)[0].overlaps[0].is_blended);
    // As someone may tune it on the running wall.
    wall.channels[1].adjustment.edges.left = Some(0.0);
    assert!(!coverage(&wall, 0)[0].overlaps[0].is_blended);
    wall.channels[1].adjustment.edges.left = None;
    wall.channels[1].adjustment.edges.right = Some(0.0);
    assert!(coverage(&wall, 0)[0].overlaps[0].is_blended, "at that edge it is alone");
    wall.channels[1].adjustment.edges.left = Some(0.0);
    wall.channels[0].adjustment.ramps = Ramps::Alpha;
    assert!(coverage(&wall, 0)[0].overlaps[0].is_blended, "its file fades the other one");
}

/// A warp that lights the left `share` of a picture, and with it some of the canvas's width.
fn lit_strip(share: f32, [from, to]: [f32; 2]) -> CalibrationMap {
    let corner = |index: u8| {
        let (x, y) = (f32::from(index % 2), f32::from(index / 2));
        let (place, value) = (Vec2::new(x * share, y), Vec3::new(from + x * (to - from), y, 0.0));
        ImportedVertex { place, value, light: 1.0 }
    };
    let triangles = vec![[0, 1, 2], [3, 2, 1]];
    let mesh = ImportedMesh { vertices: (0..4).map(corner).collect(), triangles };
    CalibrationMap::Warp(WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Mesh(mesh) })
}

#[test]
fn ramps_without_width_are_found_where_the_light_of_a_warp_ends() {
    let warps = "[channel.c0]\nwarp = \"c0.pfm\"\n[channel.c1]\nwarp = \"c1.pfm\"\n";
    let text = by_hand(&[[0, 0, 200, 100], [0, 0, 200, 100]], warps);
    let mut wall = crate::parse(&text, "wall.toml".as_ref()).unwrap();
    for (index, file) in (0_u8..).zip(&mut wall.files) {
        file.blob = Some(BlobHash([index; 32]));
    }
    // The right fifth of the first picture is dark.
    let made = [lit_strip(0.8, [0.0, 0.6]), lit_strip(1.0, [0.4, 1.0])];
    let maps =
        CalibrationMaps::load(&wall, |hash| Ok(Arc::new(made[usize::from(hash.0[0])].clone())));
    let shapes = WallGeometry::new(&wall, &maps.expect("sound"));
    let is_blended = |wall: &Wall| {
        let found = coverage(ResolvedWall { wall, shapes: &shapes }, 0);
        found[0].overlaps[0].is_blended
    };
    wall.channels[0].adjustment.edges.left = Some(0.0);
    assert!(is_blended(&wall), "at that edge it is alone");
    wall.channels[0].adjustment.edges.right = Some(0.0);
    assert!(!is_blended(&wall));
}

#[test]
fn what_only_files_know_is_not_guessed() {
    let mapped = by_hand(&[[0, 0, 200, 100]], "[channel.c0]\nwarp = \"c0.pfm\"\n");
    assert_eq!(of(&mapped), []);
    let mesh = tiles("tiles.pixels = [200, 100]")
        .replace("size = [2.0, 1.0]\ncenter = [0.0, 0.0, -1.0]", "mesh = \"hull.obj\"");
    assert_eq!(of(&mesh)[0].layers_max, 1);
}
