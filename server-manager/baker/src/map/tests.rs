//! Files of walls, written by another hand, through the readers.

mod archives;
mod broken;
mod foreign;
#[path = "../../../../tests/harness/maps.rs"]
mod maps;
mod random;

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use glam::{UVec2, Vec2, Vec3};
use maps::{Png, png};
use polyptych_wall::warp::{
    CalibrationMap, ImportedMesh, MapCoordinates, Mask, WarpGeometry, WarpGrid, WarpMap,
};
use serde_json::json;

use super::super::BakeCache;
use super::super::tests::builder::Builder;
use super::{MapUse, bake_map};

const WARP: MapUse =
    MapUse::Warp { aspect: Some(16.0 / 9.0), dark_zeros: false, sgct_roles: false };

/// A folder with a store.
struct MapFixture {
    folder: tempfile::TempDir,
    store: BakeCache,
}

impl MapFixture {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = BakeCache::open(folder.path().join("store")).expect("a store");
        Self { folder, store }
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::write(&path, bytes).expect("written");
        path
    }

    /// Through file and blob, as a server gets it.
    fn bake(&self, name: &str, used_as: MapUse, bytes: &[u8]) -> Result<CalibrationMap, String> {
        let path = self.write(name, bytes);
        let baked = bake_map(&path, used_as, &self.store, &AtomicBool::new(false));
        let baked = baked.map_err(|error| error.to_string())?;
        let blob = self.store.blobs().read(baked.blob).expect("read").expect("there");
        Ok(CalibrationMap::decode(&blob).expect("a blob of the baker"))
    }
}

fn warp(name: &str, used_as: MapUse, bytes: &[u8]) -> WarpMap {
    match MapFixture::new().bake(name, used_as, bytes).expect("baked") {
        CalibrationMap::Warp(warp) => warp,
        CalibrationMap::Mask(_) => panic!("a mask"),
    }
}

fn grid(name: &str, bytes: &[u8]) -> (MapCoordinates, WarpGrid) {
    let WarpMap { space, shape } = warp(name, WARP, bytes);
    let WarpGeometry::Grid(grid) = shape else { panic!("a mesh") };
    (space, grid)
}

fn mesh(name: &str, used_as: MapUse, bytes: &[u8]) -> (MapCoordinates, ImportedMesh) {
    let WarpMap { space, shape } = warp(name, used_as, bytes);
    let WarpGeometry::Mesh(mesh) = shape else { panic!("a grid") };
    (space, mesh)
}

fn mask(bytes: &[u8]) -> Mask {
    match MapFixture::new().bake("mask.png", MapUse::Mask, bytes).expect("baked") {
        CalibrationMap::Mask(mask) => mask,
        CalibrationMap::Warp(_) => panic!("a warp"),
    }
}

/// Three components are metres; rows of the file begin at the bottom, those of the map at the top.
#[test]
fn points_of_a_float_map_keep_their_rows_in_both_byte_orders() {
    let value = |x: u32, y: u32| match (x, y) {
        (2, 0) => [f32::NAN; 3],
        (1, 1) => [1.0, f32::INFINITY, 0.0],
        _ => [x as f32, -(y as f32), -2.5],
    };
    for is_little in [true, false] {
        let (space, grid) = grid("a.pfm", &maps::pfm([3, 2], 3, is_little, value));
        assert_eq!((space, grid.size), (MapCoordinates::Display, UVec2::new(3, 2)));
        assert_eq!(grid.values[1], Vec3::new(1.0, 0.0, -2.5), "the upper row");
        assert_eq!(grid.values[5], Vec3::new(2.0, -1.0, -2.5), "the lower row");
        assert!(grid.values[2].is_nan() && grid.values[4].is_nan(), "unlit");
    }
}

/// u and v, v up: of two components, of three with NaN, of three with 0 in the unit square.
#[test]
fn places_of_a_float_map_are_places_of_the_canvas() {
    let value = |third: f32| move |x: u32, y: u32| [0.25 * x as f32, 1.0 - 0.5 * y as f32, third];
    let named = |bytes: Vec<u8>| [b"pf2c", &bytes[2..]].concat();
    let files = [
        named(maps::pfm([3, 2], 2, true, value(0.0))),
        named(maps::pfm([3, 2], 2, false, value(0.0))),
        maps::pfm([3, 2], 3, true, value(f32::NAN)),
        maps::pfm([3, 2], 3, true, value(0.0)),
    ];
    for file in files {
        let (space, grid) = grid("a.pfm", &file);
        assert_eq!(space, MapCoordinates::Canvas);
        assert_eq!(grid.values[0], Vec3::ZERO, "the upper left corner of the canvas");
        assert_eq!(grid.values[5], Vec3::new(0.5, 0.5, 0.0));
    }
    let outside = maps::pfm([3, 2], 3, true, |x, y| [x as f32, y as f32, 0.0]);
    assert_eq!(
        grid("a.pfm", &outside).0,
        MapCoordinates::Display,
        "beyond the unit square: metres"
    );
}

/// Programs write zeros where nothing is lit: a key says so, and without it a warning does.
#[test]
fn points_at_the_origin_are_dark_where_the_wall_says_so() {
    let value = |x: u32, y: u32| if x == 1 { [0.0; 3] } else { [x as f32, y as f32, -2.0] };
    let file = maps::pfm([3, 2], 3, true, value);
    let place = MapFixture::new();
    let path = place.write("a.pfm", &file);
    for (dark_zeros, is_lit) in [(false, true), (true, false)] {
        let used_as = MapUse::Warp { aspect: None, dark_zeros, sgct_roles: false };
        let baked = bake_map(&path, used_as, &place.store, &AtomicBool::new(false)).expect("baked");
        let warning = baked.warning.unwrap_or_default();
        assert_eq!(warning.contains("2 pixels at (0, 0, 0)"), is_lit, "{warning}");
        let CalibrationMap::Warp(warp) = place.bake("a.pfm", used_as, &file).expect("a map") else {
            panic!("a mask")
        };
        let WarpGeometry::Grid(grid) = warp.shape else { panic!("a mesh") };
        assert_eq!((grid.values[1].is_nan(), grid.values[2].is_nan()), (!is_lit, false));
    }
}

#[test]
fn a_head_of_windows_lines_is_a_head() {
    let file = maps::pfm([2, 1], 3, true, |x, _| [x as f32, 0.5, 0.0]);
    let head = b"PF\n2 1\n-1.000000\n".len();
    let file = [b"PF\r\n2 1\r\n-1.0\r\n", &file[head..]].concat();
    assert_eq!(grid("a.pfm", &file).1.values[1], Vec3::new(1.0, 0.5, 0.0));
}

/// v is up in OBJ and down on the canvas; the quadrilaterals become two triangles each.
#[test]
fn a_mesh_of_obj_is_points_at_places() {
    let corner = |u: f64, v: f64| ([u * 4.0, 3.0 - v * 3.0, -2.0], [u, 1.0 - v]);
    let text = maps::obj([4, 3], corner);
    for used_as in [WARP, MapUse::ScreenMesh] {
        let (space, mesh) = mesh("a.obj", used_as, text.as_bytes());
        assert_eq!((space, mesh.vertices.len()), (MapCoordinates::Display, 20));
        assert_eq!(mesh.triangles.len(), 24);
        for vertex in &mesh.vertices {
            let [u, v] = vertex.place.to_array();
            let due = Vec3::new(u * 4.0, 3.0 - v * 3.0, -2.0);
            assert!(vertex.value.distance(due) < 1e-6, "{vertex:?}");
        }
    }
}

#[test]
fn corners_may_be_counted_from_the_end_and_share_positions() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nf -3/-3/1 2/2 3/3\n";
    let (_, mesh) = mesh("a.obj", WARP, text.as_bytes());
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.vertices[0].place, Vec2::new(0.0, 1.0));
}

/// SGCT's roles: positions from -1 to 1 on the picture, up, and UV on the canvas; a corner's UV
/// has the number of its position where it names none.
#[test]
fn a_mesh_of_sgct_is_places_of_the_canvas_at_places() {
    let sgct = MapUse::Warp { aspect: None, dark_zeros: false, sgct_roles: true };
    let text = "v -1 1 0\nv 1 1 0\nv -1 -1 9\nvt 0.1 0.8\nvt 0.9 0.8\nvt 0.1 0.4\n";
    for face in ["f 1/1/1 2/2/2 3/3/3\n", "f 1 2 3\n"] {
        let (space, mesh) = mesh("a.obj", sgct, format!("{text}{face}").as_bytes());
        assert_eq!((space, &mesh.triangles[..]), (MapCoordinates::Canvas, &[[0, 1, 2]][..]));
        let found = mesh.vertices.iter().map(|vertex| (vertex.place, vertex.value));
        let due = [
            (Vec2::ZERO, Vec3::new(0.1, 0.2, 0.0)),
            (Vec2::X, Vec3::new(0.9, 0.2, 0.0)),
            (Vec2::Y, Vec3::new(0.1, 0.6, 0.0)),
        ];
        for ((place, value), (due_place, due_value)) in found.zip(due) {
            assert_eq!(place, due_place);
            assert!(value.distance(due_value) < 1e-6, "{value}");
        }
    }
    let line = MapFixture::new().bake("a.pfm", sgct, b"PF\n1 1\n-1.0\n").expect_err("refused");
    assert!(line.contains("a.pfm: file: ") && line.contains("warp_obj"), "{line}");
}

/// v is down in glTF; the node's transform holds.
#[test]
fn a_mesh_of_gltf_is_points_at_places() {
    let mut builder = Builder::triangle();
    builder.json["nodes"][0]["translation"] = json!([0.0, 0.0, -2.0]);
    let accessor = builder.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    builder.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(accessor);
    let (space, mesh) = mesh("a.glb", MapUse::ScreenMesh, &builder.glb());
    assert_eq!((space, mesh.triangles.len()), (MapCoordinates::Display, 1));
    assert!(mesh.vertices.iter().all(|vertex| vertex.value.z == -2.0), "{mesh:?}");
    assert_eq!(mesh.vertices[1].place, Vec2::new(1.0, 0.0));
}

/// Bourke's mesh: x is measured in the height, y and v are up, negative nodes darken their cells.
#[test]
fn a_bourke_mesh_is_places_of_the_canvas_with_light() {
    let aspect = 16.0 / 9.0;
    let node = |x: u32, y: u32| {
        let (u, v) = (f64::from(x) / 3.0, f64::from(y) / 2.0);
        let intensity = if x == 3 && y == 2 { -1.0 } else { 0.5 };
        [(u * 2.0 - 1.0) * aspect, v * 2.0 - 1.0, u, v, intensity]
    };
    let (space, mesh) = mesh("a.data", WARP, maps::bourke([4, 3], node).as_bytes());
    assert_eq!(
        (space, mesh.vertices.len()),
        (MapCoordinates::Canvas, 11),
        "the unlit one is loose"
    );
    assert_eq!(mesh.triangles.len(), 2 * (6 - 1), "one cell has an unlit corner");
    for vertex in &mesh.vertices {
        let due = Vec3::new(vertex.place.x, vertex.place.y, 0.0);
        assert!(vertex.value.distance(due) < 1e-6, "it shows what is there: {vertex:?}");
    }
    assert!((mesh.vertices[0].light - 0.5f32.powf(2.2)).abs() < 1e-6);
    assert_eq!(mesh.vertices[0].place, Vec2::new(0.0, 1.0), "the first node is the lower left");
}

#[test]
fn a_uv_image_is_places_of_the_canvas() {
    let lit = u16::MAX;
    let texels = [0, lit, lit, 13107, 26214, lit, lit, 0, lit, lit, lit, 0];
    let picture = Png { size: [2, 2], color: 2, bits: 16, gamma: Some(45455), texels: &texels };
    let (space, grid) = grid("uv.png", &png(&picture));
    assert_eq!((space, grid.values[0]), (MapCoordinates::Canvas, Vec3::ZERO));
    assert!(grid.values[1].distance(Vec3::new(0.2, 0.6, 0.0)) < 1e-6, "gamma is not asked");
    assert_eq!(grid.values[2], Vec3::new(1.0, 1.0, 0.0));
    assert!(grid.values[3].is_nan(), "blue is 0");
    let texels = [0, 0, 0, lit, 0, 0, lit, 0];
    let picture = Png { size: [2, 1], color: 6, bits: 16, gamma: None, texels: &texels };
    let (_, grid) = self::grid("uv.png", &png(&picture));
    assert!(grid.values[0] == Vec3::new(0.0, 1.0, 0.0) && grid.values[1].is_nan(), "alpha");
}

/// Light of 8 and 16 bits, sRGB and gamma, against the formulas in f64.
#[test]
fn masks_are_linear_light() {
    let srgb = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    let ramp: Vec<u16> = (0..256).collect();
    let due = |light: &dyn Fn(f64) -> f64| -> Vec<u16> {
        (0..256).map(|i| (light(f64::from(i) / 255.0) * 65535.0).round() as u16).collect()
    };
    let of = |gamma, texels: &[u16], bits| {
        let size = [16, 16];
        mask(&png(&Png { size, color: 0, bits, gamma, texels }))
    };
    assert_eq!(of(None, &ramp, 8).texels, due(&srgb));
    assert_eq!(of(Some(100_000), &ramp, 8).texels, due(&|v| v));
    let gamma = of(Some(45_455), &ramp, 8);
    let worst = gamma.texels.iter().zip(due(&|v| v.powf(2.2))).map(|(a, b)| a.abs_diff(b)).max();
    assert!(worst <= Some(1), "{worst:?}");
    let wide: Vec<u16> = ramp.iter().map(|value| value * 257).collect();
    assert_eq!(of(Some(100_000), &wide, 16).texels, wide);
    assert_eq!(gamma.components, 1);
}

#[test]
fn a_mask_of_colours_keeps_them_and_a_grey_one_does_not() {
    let texels = [0, 0, 0, 255, 128, 0];
    let picture = Png { size: [2, 1], color: 2, bits: 8, gamma: Some(100_000), texels: &texels };
    let colours = mask(&png(&picture));
    assert_eq!(colours.at(1, 0), [65535, 128 * 257, 0]);
    let texels = [9, 9, 9, 7, 7, 7];
    let grey = mask(&png(&Png { texels: &texels, ..picture }));
    assert_eq!((grey.components, grey.at(1, 0)), (1, [7 * 257; 3]));
}
