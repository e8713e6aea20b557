//! Blobs of deformers, whole and damaged, and what they make of vertices.

use super::*;
use crate::{IndexFormat, Topology};

/// Two triangles of three vertices each, with two joints and two morph targets.
fn deformer(is_flat: bool) -> Deformer {
    let corners = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
    ];
    let vertices = corners.iter().flat_map(|[x, y, z]| [*x, *y, *z, 0.0, 0.0, 1.0]).collect();
    let influence = |at: usize| Influence {
        joints: [0, 1, 0, 0],
        weights: if at < 3 { [1.0, 0.0, 0.0, 0.0] } else { [0.25, 0.75, 0.0, 0.0] },
    };
    let up = Deltas { vertices: vec![4], values: vec![0.0, 0.0, 2.0] };
    let raised = [
        up,
        Deltas::default(),
        Deltas::default(),
        Deltas::default(),
        Deltas::default(),
        Deltas::default(),
    ];
    Deformer {
        layout: VertexLayout::default(),
        vertices,
        influences: (0..6).map(influence).collect(),
        targets: vec![raised, Default::default()],
        is_flat,
    }
}

fn primitive() -> Primitive {
    Primitive {
        blob: BlobHash([0; 32]),
        layout: VertexLayout::default(),
        vertex_count: 6,
        index_count: 6,
        coarser_index_count: 0,
        meshlet_count: 0,
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: None,
        origin: DVec3::ZERO,
        min: Vec3::ZERO,
        max: Vec3::ONE,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
    }
}

fn described(bytes: u64, is_flat: bool) -> DeformedPrimitive {
    let blob = BlobHash([0; 32]);
    DeformedPrimitive { blob, bytes, joint_sets: 1, joint_count: 2, target_count: 2, is_flat }
}

fn shape(second: DAffine3, weight: f64) -> Shape {
    let joints = vec![DAffine3::IDENTITY, second];
    Shape { joints, rigid: DAffine3::IDENTITY, weights: vec![weight, 0.0] }
}

fn vertex(of: &[f32], at: usize) -> [Vec3; 2] {
    let of = &of[at * 6..];
    [Vec3::new(of[0], of[1], of[2]), Vec3::new(of[3], of[4], of[5])]
}

#[test]
fn a_blob_comes_back_as_it_was_and_damaged_ones_are_refused() {
    for is_flat in [false, true] {
        let whole = deformer(is_flat);
        let bytes = whole.to_bytes();
        let described = described(bytes.len() as u64, is_flat);
        assert_eq!(Deformer::parse(&primitive(), &described, &bytes), Ok(whole));
        for end in 0..bytes.len() {
            Deformer::parse(&primitive(), &described, &bytes[..end]).expect_err("cut off");
        }
        let longer = [&bytes[..], &[0; 4]].concat();
        Deformer::parse(&primitive(), &described, &longer).expect_err("too long");
        let fewer = DeformedPrimitive { joint_count: 1, ..described };
        Deformer::parse(&primitive(), &fewer, &bytes).expect_err("a joint that is not there");
        let mut moved = bytes.clone();
        let first_delta = 6 * 24 + 6 * 24 + 4;
        moved[first_delta] = 6;
        Deformer::parse(&primitive(), &described, &moved).expect_err("a vertex too many");
    }
    let huge = Primitive { vertex_count: u32::MAX, ..primitive() };
    Deformer::parse(&huge, &described(0, false), &[]).expect_err("nothing is made of a claim");
    let shared = Primitive { vertex_count: 4, ..primitive() };
    let bytes = deformer(true).to_bytes();
    Deformer::parse(&shared, &described(0, true), &bytes).expect_err("flat, with shared vertices");
}

#[test]
fn vertices_are_morphed_and_then_follow_their_joints() {
    let mut out = Vec::new();
    let second = DAffine3::from_translation(DVec3::new(4.0, 0.0, 0.0));
    deformer(false).apply(&shape(second, 0.5), &mut out);
    assert_eq!(vertex(&out, 1)[0], Vec3::X, "the first joint stands");
    assert_eq!(vertex(&out, 4), [Vec3::new(4.0, 1.0, 1.0), Vec3::Z]);
    // At no weight and with joints at rest all is as it was, to the bit.
    deformer(false).apply(&shape(DAffine3::IDENTITY, 0.0), &mut out);
    assert_eq!(out, deformer(false).vertices);
}

#[test]
fn flat_triangles_keep_the_normals_of_their_planes() {
    let mut out = Vec::new();
    deformer(true).apply(&shape(DAffine3::IDENTITY, 1.0), &mut out);
    let wanted = DVec3::new(0.0, 1.0, 2.0).cross(DVec3::new(-1.0, 1.0, 0.0)).normalize();
    for at in 3..6 {
        assert!(vertex(&out, at)[1].distance(wanted.as_vec3()) < 1e-6);
    }
    assert_eq!(vertex(&out, 0)[1], Vec3::Z);
}

#[test]
fn mirrored_joints_turn_normals_to_the_outside() {
    let mirror = DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
    let of = shape(mirror, 0.0);
    let of = Shape { joints: vec![mirror; 2], ..of };
    let mut out = Vec::new();
    deformer(false).apply(&of, &mut out);
    assert_eq!(vertex(&out, 0)[1], Vec3::NEG_Z);
    assert_eq!(deformer(false).mirrored(&of), [true; 6]);
    // A joint without extent gives numbers all the same.
    let flat = shape(DAffine3::from_scale(DVec3::ZERO), 0.0);
    deformer(false).apply(&Shape { joints: vec![flat.joints[1]; 2], ..flat }, &mut out);
    assert!(out.iter().all(|number| number.is_finite()));
}
