//! The choice among levels of detail by itself, of random hierarchies, honest and not.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use polyptych_scene::Primitive;
use polyptych_scene::meshlet::{ErrorSphere, Meshlet};
use proptest::prelude::*;

use super::harness::{MeshFixture, look};
use crate::error_tolerance::{ErrorTolerance, ItemErrors};
use crate::scene::{MeshletCull, Meshlets, PlacedMesh, Stance};
use crate::{AllowedError, ViewDesc};

/// Triangles of each part of the finest level.
const TRIANGLES: u32 = 2;

/// A hierarchy over some parts of a surface, and for each part the meshlets that can draw it, from
/// the finest to the coarsest.
#[derive(Clone, Debug)]
struct Hierarchy {
    meshlets: Vec<Meshlet>,
    chains: Vec<Vec<usize>>,
    coarser_indices: u32,
}

impl Hierarchy {
    /// Parts in random places; each level joins some neighbours, with an error and a sphere that do
    /// not shrink.
    fn new(points: &[[f32; 3]], joins: &[(usize, f32)]) -> Self {
        let sphere = |at: &[f32; 3]| ErrorSphere { center: Vec3::from(*at), radius: 0.5 };
        let finest = |(at, point): (u32, &[f32; 3])| Meshlet {
            first_index: at * TRIANGLES * 3,
            index_count: TRIANGLES * 3,
            min: Vec3::from(*point) - 0.5,
            max: Vec3::from(*point) + 0.5,
            cone_axis: Vec3::ZERO,
            cone_sine: 1.0,
            error: 0.0,
            sphere: sphere(point),
            coarser_error: f32::INFINITY,
            coarser_sphere: sphere(point),
            level: 0,
        };
        let mut meshlets: Vec<Meshlet> = (0..).zip(points).map(finest).collect();
        let mut chains: Vec<Vec<usize>> = (0..points.len()).map(|at| vec![at]).collect();
        let mut level: Vec<Vec<usize>> = chains.clone();
        let mut next = points.len() as u32 * TRIANGLES * 3;
        for (count, grows) in joins {
            let groups: Vec<Vec<usize>> = level.chunks(*count).map(<[_]>::concat).collect();
            for parts in &groups {
                let below: Vec<usize> = parts.iter().map(|part| chains[*part].len() - 1).collect();
                let below: Vec<usize> =
                    parts.iter().zip(below).map(|(part, last)| chains[*part][last]).collect();
                let spheres = || below.iter().map(|at| meshlets[*at].sphere);
                let center = spheres().map(|of| of.center).sum::<Vec3>() / below.len() as f32;
                let reach = spheres().map(|of| of.center.distance(center) + of.radius);
                let radius = reach.fold(0.0, f32::max) * (1.0 + 1e-6);
                let error = below.iter().map(|at| meshlets[*at].error).fold(*grows, f32::max);
                let sphere = ErrorSphere { center, radius };
                for at in &below {
                    (meshlets[*at].coarser_error, meshlets[*at].coarser_sphere) = (error, sphere);
                }
                for part in parts {
                    chains[*part].push(meshlets.len());
                }
                let coarser = Meshlet {
                    first_index: next,
                    index_count: 3,
                    error,
                    sphere,
                    ..meshlets[below[0]]
                };
                let coarser_error = f32::INFINITY;
                meshlets.push(Meshlet { coarser_error, coarser_sphere: sphere, ..coarser });
                next += 3;
            }
            level = groups;
        }
        let coarser_indices = next - points.len() as u32 * TRIANGLES * 3;
        Self { meshlets, chains, coarser_indices }
    }

    fn parsed(&self) -> Meshlets {
        let fine = self.chains.len() as u32 * TRIANGLES * 3;
        parse(&self.meshlets, fine, self.coarser_indices).unwrap().unwrap()
    }
}

/// The meshlets of a blob of one vertex.
fn parse(meshlets: &[Meshlet], fine: u32, coarser: u32) -> Result<Option<Meshlets>, String> {
    let shape = MeshFixture {
        vertices: vec![[0.0; 12]],
        indices: vec![0; fine as usize],
        coarser_indices: vec![0; coarser as usize],
        meshlets: meshlets.to_vec(),
        ..MeshFixture::default()
    };
    let desc: Primitive = shape.primitive(None);
    Meshlets::parse(&desc, &shape.bytes())
}

fn stance(linear: DMat3) -> Stance {
    let mut stances = Vec::new();
    let one = MeshFixture::rectangle(1.0, 1.0).primitive(None);
    let mesh = PlacedMesh { node: 0, mesh: 0, primitives: &[one], instances: &[], billboard: None };
    let placed = mesh.place::<()>(&DAffine3::from_mat3(linear), &mut stances, |_| Ok(()));
    placed.unwrap();
    stances.remove(0)
}

fn errors(eye: DVec3, origin: DVec3, linear: DMat3, allowed_error: AllowedError) -> ItemErrors {
    let view = ViewDesc { allowed_error, ..look(eye, eye + DVec3::X, [64, 64]) };
    ErrorTolerance::new(&view).of_item(origin, &stance(linear))
}

fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-size..size).prop_map(DVec3::from)
}

fn hierarchy() -> impl Strategy<Value = Hierarchy> {
    let points = prop::collection::vec(prop::array::uniform3(-20.0..20.0f32), 1..120);
    let join = (1usize..5, prop_oneof![Just(1e-3f32), 0.001..0.5f32]);
    (points, prop::collection::vec(join, 0..6))
        .prop_map(|(points, joins)| Hierarchy::new(&points, &joins))
}

/// Turns, scales that differ by axis, shears, and flat ones.
fn linear() -> impl Strategy<Value = DMat3> {
    let scale = prop_oneof![Just(DVec3::ONE), vector(3.0), Just(DVec3::new(1.0, 2.0, 0.0))];
    (vector(1.0), 0.0..6.0f64, scale, vector(1.0)).prop_map(|(axis, angle, scale, shear)| {
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize_or(DVec3::X), angle));
        let sheared = DMat3::from_cols(DVec3::X, DVec3::new(shear.x, 1.0, shear.y), DVec3::Z);
        turn * DMat3::from_diagonal(scale) * sheared
    })
}

fn allowed() -> impl Strategy<Value = AllowedError> {
    let number = || prop_oneof![Just(0.0), 1e-4..0.1f64, 0.1..10.0f64];
    (number(), number()).prop_map(|(angle_rad, length)| AllowedError {
        angle_rad,
        length,
        ..AllowedError::NONE
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn each_part_is_drawn_by_exactly_one_level(
        of in hierarchy(), linear in linear(), eye in vector(60.0), allowed in allowed(),
        far in prop_oneof![Just(0.0), Just(1e7)],
    ) {
        let place = DVec3::new(far, -far * 0.7, far * 0.3);
        let errors = errors(eye + place, place, linear, allowed);
        let mut shares: f64 = 0.0;
        for chain in &of.chains {
            let drawn = chain.iter().filter_map(|at| errors.share_if_drawn(&of.meshlets[*at]));
            let drawn: Vec<f64> = drawn.collect();
            prop_assert_eq!(drawn.len(), 1, "of {:?}", chain);
            shares = shares.max(drawn[0]);
        }
        prop_assert!((0.0..=1.0).contains(&shares));
        // What decides about many at once comes to the same.
        let expected: Vec<u32> = (0u32..).zip(&of.meshlets)
            .filter(|(_, meshlet)| errors.share_if_drawn(meshlet).is_some())
            .map(|(at, _)| at).collect();
        let (meshlets, mut chosen) = (of.parsed(), Vec::new());
        let share = meshlets.choose(&errors, None, &mut chosen);
        prop_assert_eq!(&chosen, &expected);
        prop_assert_eq!(share, shares);
        if let Some(run) = meshlets.one_level(&errors) {
            let indices: Vec<u32> = expected.iter().flat_map(|at| {
                let meshlet = meshlets.get(*at);
                meshlet.first_index..meshlet.first_index + meshlet.index_count
            }).collect();
            let of_run: Vec<u32> = (run.indices[0]..run.indices[0] + run.indices[1]).collect();
            prop_assert_eq!(indices, of_run);
            prop_assert!((shares..=1.0).contains(&run.error_share));
        }
    }

    #[test]
    fn allowed_errors_are_not_exceeded_at_any_point(
        of in hierarchy(), linear in linear(), eye in vector(60.0), angle in 1e-4..0.1f64,
        aside in vector(1.0), toward in vector(1.0),
    ) {
        // As seen by an eye beside the one between both.
        let view = ViewDesc {
            eye_in_world: eye + aside,
            allowed_error: AllowedError { angle_rad: angle, length: 0.0, ..AllowedError::NONE },
            ..look(eye, eye + DVec3::X, [64, 64])
        };
        let errors = ErrorTolerance::new(&view).of_item(DVec3::ZERO, &stance(linear));
        for meshlet in &of.meshlets {
            if errors.share_if_drawn(meshlet).is_none() {
                continue;
            }
            // A point of the surface, and one that is as far beside it as the error says.
            let sphere = &meshlet.sphere;
            let outward = toward.normalize_or(DVec3::X);
            let point = sphere.center.as_dvec3() + outward * f64::from(sphere.radius);
            let beside = linear * (aside.normalize_or(DVec3::X) * f64::from(meshlet.error));
            let distance = (linear * point).distance(view.eye_in_world);
            prop_assert!(beside.length() <= angle * distance * (1.0 + 1e-9));
        }
    }

    #[test]
    fn eyes_of_one_wall_choose_alike_wherever_they_are(
        of in hierarchy(), linear in linear(), eye in vector(60.0), angle in 1e-4..0.1f64,
        aside in vector(1.0), nearer in 0.0..1.0f64,
    ) {
        // Near a dome's pole eyes come together, and a middle eye has no offset at all.
        let allowed_error =
            AllowedError { angle_rad: angle, eye_offset: aside.length(), ..AllowedError::NONE };
        let drawn = |offset: f64| -> Vec<bool> {
            let eye_in_world = eye + aside * offset;
            let view = look(eye, eye + DVec3::X, [64, 64]);
            let view = ViewDesc { eye_in_world, allowed_error, ..view };
            let errors = ErrorTolerance::new(&view).of_item(DVec3::ZERO, &stance(linear));
            of.meshlets.iter().map(|meshlet| errors.share_if_drawn(meshlet).is_some()).collect()
        };
        let one = drawn(1.0);
        prop_assert_eq!(&one, &drawn(nearer));
        prop_assert_eq!(&one, &drawn(0.0));
        prop_assert_eq!(&one, &drawn(-1.0));
    }

    #[test]
    fn dishonest_meshlets_are_refused_or_draw_indices_that_are_there(
        meshlets in prop::collection::vec(random_meshlet(), 1..80),
        linear in linear(), eye in vector(60.0), allowed in allowed(), is_mended in any::<bool>(),
    ) {
        let (fine, coarser) = (24, 240);
        let meshlets = if is_mended { mended(&meshlets, fine) } else { meshlets };
        let parsed = parse(&meshlets, fine, coarser);
        prop_assert!(parsed.is_ok() || !is_mended, "{:?}", parsed);
        let Ok(Some(parsed)) = parsed else { return Ok(()) };
        let errors = errors(eye, DVec3::ZERO, linear, allowed);
        let mut chosen = Vec::new();
        let share = parsed.choose(&errors, None, &mut chosen);
        prop_assert!((0.0..=1.0).contains(&share));
        let runs = chosen.iter().map(|at| parsed.get(*at));
        let runs = runs.map(|meshlet| [meshlet.first_index, meshlet.index_count]);
        for [first, count] in runs.chain(parsed.one_level(&errors).map(|run| run.indices)) {
            prop_assert!(count > 0 && first + count <= fine + coarser);
        }
        let of_all: u32 = chosen.iter().map(|at| parsed.get(*at).index_count).sum();
        prop_assert!(of_all <= fine + coarser);
    }
}

/// A meshlet of any numbers.
fn random_meshlet() -> impl Strategy<Value = Meshlet> {
    let sphere = || {
        (number(), number(), number(), number())
            .prop_map(|(x, y, z, radius)| ErrorSphere { center: Vec3::new(x, y, z), radius })
    };
    let indices = (0u32..40, 0u32..9);
    let numbers = prop::array::uniform4(number());
    (indices, numbers, sphere(), sphere()).prop_map(
        |((first, count), [error, coarser_error, corner, cone], sphere, coarser_sphere)| Meshlet {
            first_index: first * 3,
            index_count: count,
            min: Vec3::NEG_ONE,
            max: Vec3::splat(corner),
            cone_axis: Vec3::splat(cone),
            cone_sine: cone,
            error,
            sphere,
            coarser_error,
            coarser_sphere,
            level: 0,
        },
    )
}

/// Returns the meshlets with a finest level and with numbers that are valid each by itself; as a
/// hierarchy their errors and spheres stay wrong.
fn mended(meshlets: &[Meshlet], fine: u32) -> Vec<Meshlet> {
    let sphere = |of: ErrorSphere| ErrorSphere {
        center: if of.center.is_finite() { of.center } else { Vec3::ZERO },
        radius: if of.radius >= 0.0 { of.radius } else { f32::INFINITY },
    };
    let mend = |(at, one): (u32, &Meshlet)| {
        let is_error = one.error > 0.0 && one.error.is_finite();
        let own = if is_error { one.error } else { 1.0 };
        let error = if at == 0 { 0.0 } else { own };
        let is_coarser = one.coarser_error >= error && one.coarser_error > 0.0;
        Meshlet {
            first_index: if at == 0 { 0 } else { one.first_index },
            index_count: if at == 0 { fine } else { 3 },
            max: Vec3::ONE,
            cone_axis: Vec3::Y,
            cone_sine: 0.5,
            error,
            coarser_error: if is_coarser { one.coarser_error } else { f32::INFINITY },
            sphere: sphere(one.sphere),
            coarser_sphere: sphere(one.coarser_sphere),
            ..*one
        }
    };
    (0..).zip(meshlets).map(mend).collect()
}

/// Numbers as they should be, and others.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        0.0..3.0f32,
        Just(0.0),
        Just(f32::INFINITY),
        Just(f32::NAN),
        Just(-1.0),
        Just(f32::MAX),
        Just(f32::MIN_POSITIVE)
    ]
}

#[test]
fn more_indices_than_there_are_is_refused() {
    let one = Hierarchy::new(&[[0.0; 3]], &[(1, 0.5)]);
    let mut meshlets = one.meshlets.clone();
    assert!(parse(&meshlets, 6, 3).is_ok());
    meshlets.push(meshlets[1]);
    let fault = parse(&meshlets, 6, 3).unwrap_err();
    assert_eq!(fault, "its meshlets have 12 indices, where 9 can be");
}

#[test]
fn meshlets_that_are_hidden_hold_no_triangle_that_faces_the_eye() {
    let shape = MeshFixture::sphere(40).with_meshlets(80);
    let corner = |index: u32| Vec3::from_slice(&shape.vertices[index as usize][..3]).as_dvec3();
    let mut hidden = 0;
    for eye in [DVec3::new(0.0, 0.0, 4.0), DVec3::new(3.0, 1.0, -2.0), DVec3::Y * 1.05] {
        let planes = look(eye, DVec3::ZERO, [64, 64]).planes([0, 0, 64, 64]);
        let cull = MeshletCull::new(&planes, &DMat3::IDENTITY, DVec3::ZERO, true);
        let both_sides = MeshletCull::new(&planes, &DMat3::IDENTITY, DVec3::ZERO, false);
        for meshlet in shape.meshlets.iter().filter(|meshlet| cull.hides(meshlet)) {
            hidden += 1;
            assert!(!both_sides.hides(meshlet));
            let first = meshlet.first_index as usize;
            let indices = &shape.indices[first..first + meshlet.index_count as usize];
            for triangle in indices.as_chunks::<3>().0 {
                let [a, b, c] = triangle.map(corner);
                assert!((b - a).cross(c - a).dot(eye - a) <= 0.0, "it faces {eye}");
            }
        }
    }
    assert!(hidden > 10, "only {hidden} meshlets were found to face away");
}

#[test]
fn flat_items_hide_no_meshlet_whatever_sign_rounding_gives_them() {
    let shape = MeshFixture::sphere(40).with_meshlets(80);
    let planes = look(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, [64, 64]).planes([0, 0, 64, 64]);
    let mut signs = [0; 2];
    for step in 0..64 {
        let [one, two] = [0.7, 1.9].map(|turn| DMat3::from_rotation_z(turn + f64::from(step)));
        let flat = one * DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)) * two;
        signs[usize::from(flat.determinant() < 0.0)] += usize::from(flat.determinant() != 0.0);
        let cull = MeshletCull::new(&planes, &flat, DVec3::ZERO, true);
        assert!(!shape.meshlets.iter().any(|meshlet| cull.hides(meshlet)));
    }
    assert!(signs.iter().all(|count| *count > 0), "{signs:?}: nothing was rounded");
}

#[test]
fn meshlets_without_a_cone_are_never_hidden() {
    let flat = MeshFixture::triangle([Vec3::ZERO; 3], Vec3::Z).with_meshlets(1);
    let planes = look(DVec3::Z, DVec3::ZERO, [64, 64]).planes([0, 0, 64, 64]);
    let cull = MeshletCull::new(&planes, &DMat3::IDENTITY, DVec3::ZERO, true);
    let dishonest = Meshlet { cone_sine: -9.0, ..flat.meshlets[0] };
    assert!(!cull.hides(&flat.meshlets[0]) && !cull.hides(&dishonest));
}
