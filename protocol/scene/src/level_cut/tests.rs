//! Cuts of a blob made by hand, and tables that are out of order.

use glam::{DVec3, Vec3};
use polyptych_files::blob::BlobHash;

use super::*;
use crate::meshlet::ErrorSphere;
use crate::{IndexFormat, Topology, VertexLayout};

fn meshlet(first_index: u32, level: u32) -> Meshlet {
    let sphere = ErrorSphere { center: Vec3::ZERO, radius: 1.0 };
    Meshlet {
        first_index,
        index_count: 3,
        min: Vec3::ZERO,
        max: Vec3::ONE,
        cone_axis: Vec3::ZERO,
        cone_sine: 1.0,
        error: level as f32,
        sphere,
        coarser_error: level as f32 + 1.0,
        coarser_sphere: sphere,
        level,
    }
}

/// Four triangles of the finest level, two of level 1, one of level 2, of which each names a vertex
/// of its own; and the blob.
fn primitive() -> (Primitive, Vec<u8>) {
    let cut = |level, index_count, coarser_index_count, meshlet_count| LevelCut {
        level,
        vertex_count: meshlet_count + 2,
        index_count,
        coarser_index_count,
        meshlet_count,
        error: level as f32,
    };
    let primitive = Primitive {
        blob: BlobHash([0; 32]),
        layout: VertexLayout::default(),
        vertex_count: 9,
        index_count: 12,
        coarser_index_count: 9,
        meshlet_count: 7,
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: None,
        origin: DVec3::ZERO,
        min: Vec3::ZERO,
        max: Vec3::ONE,
        cuts: vec![cut(2, 3, 0, 1), cut(1, 6, 3, 3)],
        finest_level: 0,
        deformed: None,
    };
    let places = [(18, 2), (12, 1), (15, 1), (9, 0), (0, 0), (3, 0), (6, 0)];
    let mut bytes: Vec<u8> = (0..primitive.vertex_bytes()).map(|at| at as u8).collect();
    let indices = (0..7_u16).flat_map(|at| [0, 1, at + 2]);
    bytes.extend(indices.flat_map(u16::to_le_bytes));
    bytes.resize(primitive.first_meshlet_byte() as usize, 0);
    bytes.extend(places.into_iter().flat_map(|(first, level)| meshlet(first, level).to_bytes()));
    assert_eq!(bytes.len() as u64, primitive.bytes());
    (primitive, bytes)
}

fn third_corners(of: &Primitive, blob: &[u8]) -> Vec<u32> {
    of.index_format.numbers(&of.finest_indices_of(blob)).skip(2).step_by(3).collect()
}

#[test]
fn the_finest_level_comes_in_the_order_of_drawing() {
    let (whole, blob) = primitive();
    assert_eq!(third_corners(&whole, &blob), [6, 7, 8, 5]);
    // What is cut off is not drawn, and nothing panics.
    assert!(third_corners(&whole, &blob[..blob.len() - 200]).len() < 4);
    assert!(third_corners(&whole, &[]).is_empty());
}

#[test]
fn a_cut_is_a_primitive_of_its_own_made_of_beginnings() {
    let (whole, blob) = primitive();
    for (level, corners) in [(1, vec![3, 4]), (2, vec![2]), (7, vec![2])] {
        let limited = whole.limited_to(&whole.cut_at(level));
        let parts = whole.parts_of(&limited).map(|of| &blob[of.start as usize..of.end as usize]);
        let bytes = Primitive::joined(&limited, parts);
        assert_eq!(bytes.len() as u64, limited.bytes());
        assert_eq!(third_corners(&limited, &bytes), corners, "level {level}");
        assert!(corners.iter().all(|vertex| *vertex < limited.vertex_count));
        let mesh = Mesh { name: String::new(), primitives: vec![limited] };
        assert_eq!(mesh.cuts_fault(), None);
    }
    assert_eq!(whole.limited_to(&whole.cut_at(0)), Primitive { cuts: whole.cuts.clone(), ..whole });
}

type Change<'a> = &'a dyn Fn(&mut Vec<LevelCut>);

#[test]
fn tables_that_lie_are_refused() {
    let (whole, _) = primitive();
    let fault = |change: Change<'_>| {
        let mut wrong = whole.clone();
        change(&mut wrong.cuts);
        Mesh { name: String::new(), primitives: vec![wrong] }.cuts_fault()
    };
    assert_eq!(fault(&|_| ()), None);
    let wrong: [Change<'_>; 12] = [
        &|cuts| cuts.reverse(),
        &|cuts| cuts[0].vertex_count = 6,
        &|cuts| cuts[1].vertex_count = 10,
        &|cuts| cuts[1].index_count = u32::MAX - 1,
        &|cuts| cuts[1].index_count = 7,
        &|cuts| cuts[0].index_count = 0,
        &|cuts| cuts[1].meshlet_count = 8,
        &|cuts| cuts[0].meshlet_count = 0,
        &|cuts| cuts[0].error = f32::NAN,
        &|cuts| cuts[0].error = f32::INFINITY,
        &|cuts| cuts[1].error = -1.0,
        &|cuts| cuts[1].level = 0,
    ];
    for (at, wrong) in wrong.into_iter().enumerate() {
        assert!(fault(wrong).is_some(), "{at}");
    }
    assert!(fault(&|cuts| *cuts = vec![cuts[0]; CUTS_MAX + 1]).is_some());
    let other = Primitive { cuts: vec![whole.cuts[0]], ..whole.clone() };
    let mesh = Mesh { name: String::new(), primitives: vec![whole, other] };
    assert_eq!(mesh.cuts_fault(), Some("primitives with different levels"));
}
