//! Maps through their blobs: whole, damaged, and with what must not be.

mod cut;
mod lit;

use proptest::prelude::*;

use super::*;

fn grid() -> CalibrationMap {
    let unlit = Vec3::splat(f32::NAN);
    let values = vec![Vec3::new(-1.5, 0.25, -3.0), unlit, Vec3::X, unlit, Vec3::Y, Vec3::Z];
    let grid = WarpGrid::new(UVec2::new(3, 2), values);
    CalibrationMap::Warp(WarpMap {
        space: MapCoordinates::Display,
        shape: WarpGeometry::Grid(grid),
    })
}

fn mesh() -> CalibrationMap {
    let vertex = |u: f32, v: f32| ImportedVertex {
        place: Vec2::new(u, v),
        value: Vec3::new(v, u, 0.0),
        light: 0.5,
    };
    let vertices = vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0), vertex(1.0, 1.0)];
    let mesh = ImportedMesh { vertices, triangles: vec![[0, 1, 2], [3, 2, 1]] };
    CalibrationMap::Warp(WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Mesh(mesh) })
}

fn mask(components: u8) -> CalibrationMap {
    let texels = (0..6 * u16::from(components)).map(|i| i * 1000).collect();
    CalibrationMap::Mask(Mask { size: UVec2::new(2, 3), components, texels })
}

fn all() -> [CalibrationMap; 4] {
    [grid(), mesh(), mask(1), mask(3)]
}

/// Byte for byte: NaN is not equal to itself.
#[test]
fn a_map_is_the_same_after_its_blob() {
    for map in all() {
        let bytes = map.encode();
        let decoded = CalibrationMap::decode(&bytes).expect("its own bytes");
        assert_eq!(decoded.encode(), bytes);
    }
    assert_eq!(CalibrationMap::decode(&mesh().encode()), Ok(mesh()));
    assert_eq!(CalibrationMap::decode(&mask(3).encode()), Ok(mask(3)));
}

/// Blobs are kept on disks: what they look like must not change without another version.
#[test]
fn golden_bytes_of_a_mask() {
    let map = CalibrationMap::Mask(Mask {
        size: UVec2::new(2, 1),
        components: 1,
        texels: vec![1, 65535],
    });
    assert_eq!(map.encode(), b"ppwf\x01\x03\x01\0\x02\0\0\0\x01\0\0\0\x01\0\xff\xff");
}

#[test]
fn a_pixel_of_a_mask_has_three_colours() {
    let (CalibrationMap::Mask(grey), CalibrationMap::Mask(rgb)) = (mask(1), mask(3)) else {
        panic!("masks")
    };
    assert_eq!(grey.at(1, 2), [5000; 3]);
    assert_eq!(rgb.at(1, 2), [15000, 16000, 17000]);
}

#[test]
fn what_must_not_be_is_refused_by_name() {
    let with = |change: &dyn Fn(&mut ImportedMesh)| {
        let CalibrationMap::Warp(mut warp) = mesh() else { panic!("a warp") };
        let WarpGeometry::Mesh(mesh) = &mut warp.shape else { panic!("a mesh") };
        change(mesh);
        CalibrationMap::decode(&CalibrationMap::Warp(warp).encode()).expect_err("refused")
    };
    assert_eq!(with(&|m| m.triangles[1][2] = 4), "a triangle names vertex 4 of 4");
    assert!(with(&|m| m.triangles.clear()).contains("0 triangles"));
    assert!(with(&|m| m.vertices[2].place.x = f32::NAN).contains("out of reach"));
    assert!(with(&|m| m.vertices[2].light = 1.5).contains("out of reach"));
    assert!(with(&|m| m.vertices[2].value.z = 0.1).contains("out of reach"), "canvases are flat");

    let bytes = grid().encode();
    let with = |at: usize, value: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        CalibrationMap::decode(&bytes).expect_err("refused")
    };
    assert!(with(16, &1001f32.to_le_bytes()).contains("beyond 1000"));
    assert!(with(16, &f32::NAN.to_le_bytes()).contains("a value is"), "NaN for all three or none");
    assert!(with(4, &[2]).contains("another version"));
    assert!(with(5, &[9]).contains("kind 9"));
    assert!(with(6, &[7]).contains("space 7"));
    assert!(with(8, &[0]).contains("bytes for 0"));
    assert!(with(8, &u32::MAX.to_le_bytes()).contains("bytes for 4294967295"));
    assert!(CalibrationMap::decode(&bytes[..15]).expect_err("refused").contains("cut short"));
    assert!(CalibrationMap::decode(&bytes[..bytes.len() - 1]).is_err());
    assert!(CalibrationMap::decode(b"ppwf\x01\x03\x02\0\x01\0\0\0\x01\0\0\0\x01\0\x01\0").is_err());
    let none = b"ppwf\x01\x03\x01\0\0\0\0\0\x01\0\0\0";
    assert!(CalibrationMap::decode(none).expect_err("refused").contains("0 × 1"));
}

proptest! {
    /// Whatever bytes come, there is a sound map or a line, and never a panic.
    #[test]
    fn damaged_blobs_are_sound_or_refused(
        which in 0usize..4,
        at in any::<proptest::sample::Index>(),
        value in any::<u8>(),
        cut in any::<proptest::sample::Index>(),
    ) {
        let mut bytes = all()[which].encode();
        let at = at.index(bytes.len());
        bytes[at] = value;
        for bytes in [&bytes[..], &bytes[..cut.index(bytes.len())]] {
            match CalibrationMap::decode(bytes) {
                Ok(map) => prop_assert_eq!(map.fault(), None),
                Err(line) => prop_assert!(!line.contains('\n') && line.len() < 200),
            }
        }
    }
}
