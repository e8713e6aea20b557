//! The tree against all triangles one by one, and the hard cases of meshes.

use glam::UVec2;
use proptest::prelude::*;

use super::super::triangle_bvh::{CLOSE, meet};
use super::*;
use crate::warp_mesh::{TessellationOptions, WarpVertex};

/// A mesh of any triangles: corner after corner.
fn soup(corners: &[[DVec3; 3]]) -> MeshBvh {
    let all = corners.iter().flatten();
    let vertex = |point: &DVec3| WarpVertex { pixel: point.truncate(), point: *point };
    let vertices = all.map(vertex).collect();
    let triangles = (0..corners.len() as u32).map(|at| [at * 3, at * 3 + 1, at * 3 + 2]).collect();
    MeshBvh::new(WarpMesh { vertices, triangles })
}

/// A grid of cells from (0, 0) to (1, 1), upright before a viewer at +Z.
fn sheet(cells: u32, z: impl Fn(DVec2) -> f64) -> WarpMesh {
    let mut mesh = WarpMesh::default();
    for i in 0..(cells + 1).pow(2) {
        let place = UVec2::new(i % (cells + 1), i / (cells + 1)).as_dvec2() / f64::from(cells);
        let point = DVec3::new(place.x, -place.y, z(place));
        mesh.vertices.push(WarpVertex { pixel: place, point });
    }
    for i in 0..cells * cells {
        let at = i / cells * (cells + 1) + i % cells;
        mesh.triangles.push([at, at + 1, at + cells + 1]);
        mesh.triangles.push([at + cells + 2, at + cells + 1, at + 1]);
    }
    mesh
}

#[test]
fn every_place_of_a_sheet_is_found_on_lines_and_corners_too() {
    let facets = MeshBvh::new(sheet(8, |place| place.x));
    for i in 0..=64 * 64 {
        // Borders and diagonals of cells are among them, and the corners of the sheet.
        let place = DVec2::new(f64::from(i % 65), f64::from(i / 65)) / 64.0;
        let due = DVec3::new(place.x, -place.y, place.x);
        let found = facets.point_at(place).expect("a point");
        assert!(found.distance(due) < 1e-12, "{place}: {found}");
        let eye = DVec3::new(0.3, 0.2, 5.0);
        let hit = facets.hit(eye, due - eye, 0.0).expect("met");
        assert!(hit.is_front && hit.place.distance(place) < 1e-9, "{place}: {hit:?}");
    }
    assert_eq!(facets.point_at(DVec2::new(1.01, 0.5)), None);
    assert_eq!(facets.hit(DVec3::Z, DVec3::Z, 0.0), None, "it lies behind");
}

#[test]
fn the_back_of_a_sheet_is_known() {
    let facets = MeshBvh::new(sheet(3, |_| 0.0));
    let (middle, from) = (DVec3::new(0.4, -0.4, 0.0), DVec3::new(0.0, 0.0, -2.0));
    let hit = facets.hit(from, middle - from, 0.0).expect("met");
    assert!(!hit.is_front, "{hit:?}");
}

/// Two sheets behind each other: a ray meets the first one, and still finds points of the second
/// one if it is asked near them.
#[test]
fn a_ray_meets_the_first_layer_or_the_one_that_is_asked_for() {
    let (mut near, far) = (sheet(4, |_| 1.0), sheet(4, |_| -1.0));
    let shift = near.vertices.len() as u32;
    let moved = far.vertices.iter();
    near.vertices.extend(moved.map(|v| WarpVertex { pixel: v.pixel + 2.0, point: v.point }));
    near.triangles.extend(far.triangles.iter().map(|corners| corners.map(|at| at + shift)));
    let facets = MeshBvh::new(near);
    let eye = DVec3::new(0.5, -0.5, 10.0);
    let target = DVec3::new(0.6, -0.4, -1.0);
    let first = facets.hit(eye, target - eye, 0.0).expect("met");
    assert!((first.point.z - 1.0).abs() < 1e-12 && first.place.x < 1.0, "{first:?}");
    let second = facets.hit(eye, target - eye, 1.0).expect("met");
    assert!(second.point.distance(target) < 1e-12 && second.place.x > 1.0, "{second:?}");
}

/// Points, lines, and triangles that lie along the ray have no place and hide nothing.
#[test]
fn triangles_without_an_area_are_not_met() {
    let (a, b) = (DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -1.0));
    let along = [DVec3::NEG_Z, DVec3::NEG_Z * 2.0, DVec3::new(0.0, 1.0, -1.5)];
    let facets = soup(&[[a, a, a], [a, b, a.lerp(b, 0.5)], along]);
    assert_eq!(facets.hit(DVec3::ZERO, DVec3::NEG_Z, 0.0), None);
    assert_eq!(facets.hit(DVec3::ZERO, DVec3::new(0.3, 0.0, -1.0), 0.0), None);
    assert_eq!(facets.point_at(DVec2::new(0.5, 0.0)), None);
    assert_eq!(MeshBvh::new(WarpMesh::default()).hit(DVec3::ZERO, DVec3::X, 0.0), None);
}

/// From within a closed mesh every direction meets it, on the side that is inside.
#[test]
fn a_closed_mesh_is_met_in_every_direction() {
    let size = UVec2::new(64, 32);
    let ball =
        WarpMesh::new(size, TessellationOptions { step_px: 4, error_px: f64::INFINITY }, |pixel| {
            let angle = pixel / size.as_dvec2() * DVec2::new(2.0, 1.0) * std::f64::consts::PI;
            let (sin, cos) = angle.y.sin_cos();
            Some(DVec3::new(angle.x.sin() * sin, cos, -angle.x.cos() * sin) * 3.0)
        });
    let facets = MeshBvh::new(ball);
    for i in 0..1000 {
        let t = f64::from(i);
        let direction = DVec3::new((t * 1.7).sin(), (t * 0.9).cos(), (t * 2.3).sin());
        let hit = facets.hit(DVec3::new(0.5, -0.3, 0.7), direction, 0.0).expect("met");
        assert!(hit.is_front, "{direction}: {hit:?}");
        assert!((2.8..3.001).contains(&hit.point.length()), "{hit:?}");
    }
}

proptest! {
    /// The tree passes over no triangle: whatever they are, each query has the answer of a loop.
    #[test]
    fn the_tree_meets_what_a_loop_meets(
        numbers in proptest::collection::vec(-4i8..=4, 9..360),
        from in [-6.0..6.0, -6.0..6.0, -6.0..6.0f64],
        to in [-4i8..=4, -4i8..=4, -4i8..=4],
        near in prop_oneof![Just(0.0), Just(1.0)],
    ) {
        let point = |at: &[i8]| DVec3::new(at[0].into(), at[1].into(), at[2].into());
        let corners: Vec<[DVec3; 3]> = numbers
            .chunks_exact(9)
            .map(|nine| [point(&nine[..3]), point(&nine[3..6]), point(&nine[6..])])
            .collect();
        let (from, to) = (DVec3::from_array(from), point(&to));
        let direction = to - from;
        let by_loop = (0u32..).zip(&corners).filter_map(|(index, corners)| {
            let met = meet(EDGE_SHARE, from, direction, *corners)?;
            Some(((met[0] - near).abs(), index, met))
        });
        let due = by_loop.min_by(|a, b| (a.0, a.1).partial_cmp(&(b.0, b.1)).expect("numbers"));
        let facets = soup(&corners);
        let of = |at: usize| corners[at];
        let found = facets.by_point.nearest(EDGE_SHARE, (from, direction, near), of);
        let gap = |along: f64| (along - near).abs();
        let [found, due] = [found.map(|(_, met)| met), due.map(|(_, _, met)| met)];
        prop_assert_eq!(found.is_some(), due.is_some());
        if let (Some(found), Some(due)) = (found, due) {
            prop_assert!(gap(found[0]) <= gap(due[0]) + CLOSE, "{found:?} {due:?}");
        }
    }
}

/// Ends of edges are told apart by their points, which files repeat where places differ.
#[test]
fn a_mesh_ends_at_the_edges_of_one_triangle_alone() {
    let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
    let same_as_c = DVec3::new(-0.0, 1.0, 0.0);
    let facets = soup(&[[a, b, c], [d, same_as_c, b], [b, b, d]]);
    let outline = facets.outline();
    let has = |ends: [DVec3; 2]| outline.contains(&ends) || outline.contains(&[ends[1], ends[0]]);
    assert!([[a, b], [c, a], [d, c], [b, d]].into_iter().all(has), "{outline:?}");
    assert_eq!(outline.len(), 4, "not the edge between both, nor any of no area");
}
