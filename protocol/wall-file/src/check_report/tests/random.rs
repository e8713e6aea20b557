//! Every wall that a wall file can say, with and without its calibration files, has finite numbers.

use std::fmt::Write;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_wall::CalibrationFileKind;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::wall_geometry::WallGeometry;
use polyptych_wall::warp::{
    CalibrationMap, ImportedMesh, ImportedVertex, MapCoordinates, Mask, WarpGeometry, WarpGrid,
    WarpMap,
};
use proptest::prelude::*;
use serde_json::Value;

use super::*;
use crate::tests::{generated, random};

/// Refuses a table in which a number is none: in JSON it would be null, in text a word.
fn check_finite(table: &CheckReport) -> Result<(), TestCaseError> {
    fn numbers(value: &Value) -> usize {
        match value {
            Value::Null => panic!("null stands where a number belongs"),
            Value::Number(number) => usize::from(number.as_f64().is_some_and(f64::is_finite)),
            Value::Array(list) => list.iter().map(numbers).sum(),
            Value::Object(map) => map.values().map(numbers).sum(),
            Value::Bool(_) | Value::String(_) => 0,
        }
    }
    let value = serde_json::to_value(table).expect("JSON");
    prop_assert!(numbers(&value) > 10, "{value}");
    let text = table.to_string();
    let mut words = text.split(|c: char| !c.is_alphanumeric());
    let odd = words.find(|word| matches!(word.to_lowercase().as_str(), "nan" | "inf" | "infinity"));
    prop_assert_eq!(odd, None, "{}", text);
    for channel in &table.channels {
        let is_whole = channel.size_m.is_some()
            && channel.degrees.is_some()
            && channel.pixels_per_degree.is_some()
            && channel.sampling.is_some();
        prop_assert!(is_whole || channel.unknown.is_some(), "{channel:?}");
        let spill = channel.spill.unwrap_or(0.5);
        prop_assert!((0.0..=1.0).contains(&spill), "{channel:?}");
    }
    Ok(())
}

/// A calibration file of this kind, made of a few numbers; some of it is unlit.
fn calibration(kind: CalibrationFileKind, seed: u32) -> CalibrationMap {
    let wave = |i: u32, by: f32| (f32::from((seed % 977) as u16) + i as f32 * by).sin();
    let size = UVec2::new(2 + seed % 7, 2 + seed / 7 % 5);
    let is_canvas = kind == CalibrationFileKind::Warp && seed.is_multiple_of(3);
    let space = if is_canvas { MapCoordinates::Canvas } else { MapCoordinates::Display };
    let value = |place: Vec2, i: u32| match space {
        MapCoordinates::Canvas => (place * 1.2 - 0.1).extend(0.0),
        MapCoordinates::Display => {
            Vec3::new(place.x * 4.0 - 2.0, 1.0 - place.y * 2.0, -2.0 + 0.2 * wave(i, 0.9))
        }
    };
    let place = |i: u32| {
        let at = UVec2::new(i % size.x, i / size.x).as_vec2();
        at / (size - 1).as_vec2()
    };
    let count = size.element_product();
    match kind {
        CalibrationFileKind::Alpha | CalibrationFileKind::Beta => {
            let texels = (0..count).map(|i| (wave(i, 2.0).abs() * 6e4) as u16).collect();
            CalibrationMap::Mask(Mask { size, components: 1, texels })
        }
        CalibrationFileKind::Warp if seed.is_multiple_of(2) => {
            let cell = |i: u32| match wave(i, 1.7) {
                lit if lit > -0.8 => value(place(i), i),
                _ => Vec3::NAN,
            };
            let grid = WarpGrid::new(size, (0..count).map(cell).collect());
            CalibrationMap::Warp(WarpMap { space, shape: WarpGeometry::Grid(grid) })
        }
        _ => {
            let vertex =
                |i: u32| ImportedVertex { place: place(i), value: value(place(i), i), light: 1.0 };
            let cells = (0..count).filter(|i| i % size.x + 1 < size.x && i / size.x + 1 < size.y);
            let triangles = cells.flat_map(|i| {
                let below = i + size.x;
                [[i, i + 1, below], [below + 1, below, i + 1]]
            });
            let mesh = ImportedMesh {
                vertices: (0..count).map(vertex).collect(),
                triangles: triangles.collect(),
            };
            CalibrationMap::Warp(WarpMap { space, shape: WarpGeometry::Mesh(mesh) })
        }
    }
}

/// Returns the wall with calibration files that were read.
fn with_shapes(wall: &Wall, seed: u32) -> (Wall, WallGeometry) {
    let mut wall = wall.clone();
    let mut made = Vec::new();
    for (index, file) in (0u32..).zip(&mut wall.files) {
        made.push(calibration(file.kind, seed.wrapping_add(index * 31)));
        file.blob = Some(BlobHash([index as u8; 32]));
    }
    let maps =
        CalibrationMaps::load(&wall, |hash| Ok(Arc::new(made[usize::from(hash.0[0])].clone())));
    let shapes = WallGeometry::new(&wall, &maps.expect("sound"));
    (wall, shapes)
}

/// One number of many sizes and both signs.
fn length(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.log10()..high.log10()).prop_map(|exponent| 10.0_f64.powf(exponent))
}

/// A wall with one screen of any form and size, and projectors anywhere that look anywhere.
fn projected() -> impl Strategy<Value = String> {
    let projector = (
        prop::array::uniform3(-1.0..1.0),
        prop::array::uniform3(-0.8..0.8),
        (length(0.01, 170.0), length(0.01, 170.0)),
        prop::array::uniform2(-1.0..1.0),
        prop::array::uniform2(1u32..500),
    );
    let screen = (0..3_u8, length(0.002, 5e5), length(0.05, 1.0), 5.0..180.0_f64);
    let channels = prop::collection::vec(projector, 1..4);
    (screen, channels, prop::array::uniform2(1u32..4000)).prop_map(
        |((form, side, flat, half), channels, pixels)| {
            let high = side * flat;
            let form = match form {
                0 => format!("size = [{side:?}, {high:?}]\ncenter = [0, 0, {:?}]", -side),
                1 => format!(
                    "cylinder = {{ radius = {side:?}, degrees = [{:?}, {half:?}], height = [{:?}, \
                     {high:?}] }}",
                    -half, -high
                ),
                _ => format!(
                    "sphere = {{ radius = {side:?}, azimuth = [{:?}, {half:?}], elevation = [-30, \
                     90] }}",
                    -half
                ),
            };
            let mut text = format!(
                "[wall]\nname = \"w\"\n[[screen]]\nname = \"s\"\npixels = {pixels:?}\n{form}\n"
            );
            for (at, (position, toward, degrees, shift, size)) in channels.iter().enumerate() {
                let position = position.map(|part: f64| part * side * 0.9);
                let target = [toward[0] * side, toward[1] * high, -side];
                let _ = write!(
                    text,
                    "[[screen.channel]]\nname = \"c{at}\"\npixels = {size:?}\nprojector = {{ \
                     position = {position:?}, look_at = {target:?}, degrees = {degrees:?}, shift \
                     = {shift:?} }}\n",
                    degrees = [degrees.0, degrees.1]
                );
            }
            text
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 4, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn random_walls_have_finite_figures(wall in generated::wall(), seed in any::<u32>()) {
        check_finite(&CheckReport::from_wall(&wall))?;
        let (wall, shapes) = with_shapes(&wall, seed);
        check_finite(&CheckReport::from_wall(ResolvedWall { wall: &wall, shapes: &shapes }))?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 32, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn damaged_wall_files_that_are_accepted_have_finite_figures(text in random::mutated()) {
        if let Ok(wall) = crate::parse(&text, "w.toml".as_ref()) {
            check_finite(&CheckReport::from_wall(&wall))?;
        }
    }

    #[test]
    fn projectors_of_any_pose_have_finite_figures(text in projected()) {
        if let Ok(wall) = crate::parse(&text, "w.toml".as_ref()) {
            check_finite(&CheckReport::from_wall(&wall))?;
        }
    }
}
