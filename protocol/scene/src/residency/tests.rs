//! Tests of the levels that fit a budget: against the definition for random scenes, and by hand.

use glam::{DAffine3, DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use proptest::prelude::*;

use super::*;
use crate::deformation::DeformedPrimitive;
use crate::edit::NodeId;
use crate::{
    IndexFormat, LevelCut, MovedPlace, Node, Primitive, Sampler, TextureFormat, Topology,
    VertexLayout,
};

/// A primitive of so many triangles, with a cut for each of these shares of them, the largest one
/// first.
fn primitive(name: u8, triangles: u32, cuts: &[(u32, f32)]) -> Primitive {
    let mut primitive = Primitive {
        blob: BlobHash([name; 32]),
        layout: VertexLayout::default(),
        vertex_count: triangles,
        index_count: triangles * 3,
        coarser_index_count: triangles * 3,
        meshlet_count: triangles,
        index_format: IndexFormat::U32,
        topology: Topology::Triangles,
        material: None,
        origin: DVec3::ZERO,
        min: Vec3::ZERO,
        max: Vec3::ONE,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
    };
    for (level, (share, error)) in (1..).zip(cuts) {
        let count = (triangles / share).max(1);
        primitive.cuts.insert(
            0,
            LevelCut {
                level,
                vertex_count: count,
                index_count: count * 3,
                coarser_index_count: 0,
                meshlet_count: count,
                error: *error,
            },
        );
    }
    primitive
}

fn mesh(primitives: Vec<Primitive>) -> Mesh {
    Mesh { name: String::new(), primitives }
}

fn texture(name: u8, side: u32) -> Texture {
    Texture {
        blob: BlobHash([name; 32]),
        format: TextureFormat::Rgba8Srgb,
        width: side,
        height: side / 2,
        mip_count: side.ilog2() + 1,
        sampler: Sampler::default(),
    }
}

/// Bytes on the GPU of a limited scene, by definition.
fn content_bytes(scene: &Scene) -> u64 {
    let meshes = scene.meshes.iter().enumerate();
    let primitives = meshes.flat_map(|(at, mesh)| mesh.primitives.iter().map(move |of| (at, of)));
    let primitives: HashMap<_, u64> =
        primitives.map(|(at, of)| (slot(at, of), of.geometry_bytes())).collect();
    let textures: HashMap<_, u64> =
        scene.textures.iter().map(|of| ((of.blob, of.width), of.bytes())).collect();
    primitives.values().sum::<u64>() + textures.values().sum::<u64>()
}

fn random_mesh() -> impl Strategy<Value = Mesh> {
    let cuts = prop::collection::vec((2u32..4, 0.0..2.0f32), 0..5);
    let one = (0u8..6, 4u32..4000, cuts);
    prop::collection::vec(one, 1..3).prop_map(|parts| {
        let levels = parts[0].2.len();
        let part = |(name, triangles, cuts): &(u8, u32, Vec<(u32, f32)>)| {
            let (mut share, mut error) = (1, 0.0);
            let add = |at: usize| {
                let (by, more) = cuts.get(at).copied().unwrap_or((2, 0.5));
                (share, error) = (share * by, error + more);
                (share, error)
            };
            let cuts: Vec<(u32, f32)> = (0..levels).map(add).collect();
            // Equal names have equal content.
            primitive(*name, *triangles + u32::from(*name), &cuts)
        };
        mesh(parts.iter().map(part).collect())
    })
}

proptest! {
    #[test]
    fn what_is_held_fits_and_grows_with_the_budget(
        mut meshes in prop::collection::vec(random_mesh(), 1..8),
        sides in prop::collection::vec(0u32..11, 0..4),
        scales in prop::collection::vec(0.01..100.0f64, 8),
        others in prop::collection::vec(0.01..100.0f64, 8),
        budgets in prop::collection::vec(0u64..1 << 20, 6),
    ) {
        for (at, mesh) in meshes.iter_mut().enumerate() {
            for (part, of) in mesh.primitives.iter_mut().enumerate() {
                // Every other mesh shares nothing.
                if at % 2 == 0 {
                    of.blob = BlobHash([(16 + at * 4 + part) as u8; 32]);
                }
            }
        }
        let textures: Vec<Texture> =
            (0..).zip(&sides).map(|(at, side)| texture(200 + at, 2 << side)).collect();
        let mut whole = Scene { textures: textures.clone(), ..Scene::default() };
        whole.meshes.clone_from(&meshes);
        let choose = |budget| Residency::choose(&meshes, &textures, &scales, budget);
        let Err(BudgetTooSmall { least }) = choose(0) else { panic!("nothing fits in 0 bytes") };
        prop_assert!(least > 0 && choose(least - 1).is_err());
        let mut budgets: Vec<u64> = budgets.into_iter().map(|more| least + more).collect();
        budgets.extend([least, u64::MAX]);
        budgets.sort_unstable();
        let mut before: Option<Residency> = None;
        for budget in budgets {
            let held = choose(budget).expect("the least works");
            prop_assert_eq!(&held, &choose(budget).expect("the same"));
            let mut scene = whole.clone();
            held.limit(&mut scene);
            prop_assert!(held.gpu_bytes <= budget && content_bytes(&scene) <= held.gpu_bytes);
            prop_assert_eq!(scene.meshes.iter().find_map(Mesh::cuts_fault), None);
            // Seen from elsewhere: both parts together fit too, as a server holds them for a while.
            let held_elsewhere = Residency::choose(&meshes, &textures, &others, budget);
            let mut elsewhere = whole.clone();
            held_elsewhere.expect("the same least").limit(&mut elsewhere);
            scene.meshes.extend(elsewhere.meshes);
            scene.textures.extend(elsewhere.textures);
            prop_assert!(content_bytes(&scene) <= budget);
            if let Some(before) = before {
                let left_out = [&before, &held].map(|of| of.texture_levels_left_out);
                prop_assert!(left_out[1] <= left_out[0]);
                prop_assert!(left_out[1] < left_out[0] || held.error <= before.error);
            }
            before = Some(held);
        }
        let all = before.expect("the last one");
        prop_assert!(all.error == 0.0 && all.levels.iter().all(|level| *level == 0));
        let mut scene = whole.clone();
        all.limit(&mut scene);
        prop_assert_eq!(scene, whole);
    }
}

#[test]
fn the_mesh_with_the_largest_error_is_refined_first() {
    let meshes = [
        mesh(vec![primitive(1, 1000, &[(4, 0.5), (16, 2.0)])]),
        mesh(vec![primitive(2, 4000, &[(4, 0.5), (16, 2.0)])]),
        mesh(vec![primitive(3, 10, &[])]),
    ];
    let choose = |scales: [f64; 3], budget| Residency::choose(&meshes, &[], &scales, budget);
    let least = choose([1.0; 3], 0).unwrap_err().least;
    let one_step = 188 * (24 + 12);
    // Twice the first step of the second mesh, but not of both.
    let enough = least + 80_000;
    assert_eq!(choose([1.0, 3.0, 1.0], enough).unwrap().levels, [2, 1, 0]);
    assert_eq!(choose([3.0, 1.0, 1.0], enough).unwrap().levels, [1, 2, 0]);
    let held = choose([3.0, 1.0, 1.0], enough).unwrap();
    let mut scene = Scene { meshes: meshes.to_vec(), ..Scene::default() };
    held.limit(&mut scene);
    assert_eq!((content_bytes(&scene), held.gpu_bytes), (least + one_step, least + one_step));
    // At 8 times the size the error is larger after a step than that of the other.
    assert_eq!(choose([8.0, 1.0, 1.0], least + 110_000).unwrap().levels, [0, 2, 0]);
    // Meshes with bytes in common are held alike.
    let shared = [meshes[0].clone(), mesh(vec![meshes[0].primitives[0].clone()])];
    let held = Residency::choose(&shared, &[], &[1.0, 9.0], 40 * 1000).unwrap();
    assert_eq!(held.levels[0], held.levels[1]);
    assert!((held.error - 9.0 * 0.5).abs() < 1e-6 || held.levels[0] != 1);
}

/// Nodes of one file that clips bend have equal blobs in meshes of their own.
#[test]
fn meshes_that_clips_bend_count_once_each_and_are_refined_by_themselves() {
    let deformed = DeformedPrimitive {
        blob: BlobHash([9; 32]),
        bytes: 1,
        joint_sets: 1,
        joint_count: 1,
        target_count: 0,
        is_flat: false,
    };
    let still = primitive(1, 1000, &[(4, 0.5)]);
    let bent = Primitive { deformed: Some(deformed), ..still.clone() };
    let four = |of: &Primitive| [(); 4].map(|()| mesh(vec![of.clone()]));
    let least = |meshes: &[Mesh]| Residency::choose(meshes, &[], &[], 0).unwrap_err().least;
    assert_eq!(least(&four(&bent)), 4 * least(&four(&still)));
    // The coarsest of all, and one that is refined in this part and one in another.
    let budget = least(&four(&bent)) + 2 * still.geometry_bytes();
    let levels =
        |weights: [f64; 4]| Residency::choose(&four(&bent), &[], &weights, budget).unwrap().levels;
    assert_eq!(levels([1.0, 3.0, 1.0, 1.0]), [1, 0, 1, 1]);
    assert_eq!(levels([1.0, 1.0, 1.0, 3.0]), [1, 1, 1, 0]);
    // The bytes of points may be those of lines.
    let lines = Primitive { topology: Topology::Lines, ..still.clone() };
    let both = [mesh(vec![still.clone()]), mesh(vec![lines])];
    assert_eq!(least(&both), 2 * least(&four(&still)));
}

#[test]
fn textures_give_up_their_largest_levels_before_they_take_half() {
    let textures = [texture(1, 1024), texture(2, 256), texture(2, 256), texture(3, 64)];
    let meshes = [mesh(vec![primitive(1, 60_000, &[(10, 0.5)])])];
    let whole = texture_bytes(&textures, 0);
    assert_eq!(whole, [1024, 256, 64].map(|side| texture(0, side).bytes()).iter().sum::<u64>());
    let held = Residency::choose(&meshes, &textures, &[1.0], 3 << 20).unwrap();
    assert_eq!((held.texture_levels_left_out, &held.levels[..]), (1, &[1][..]), "{held:?}");
    let small = textures[3].without_levels(8);
    assert_eq!(small, textures[3], "small ones stay");
    let halved = textures[0].without_levels(2);
    assert_eq!([halved.width, halved.height, halved.mip_count], [256, 128, 9]);
}

/// A place that sees in perspective, with 1,000 pixels per radian.
fn eye(x: f64, y: f64, z: f64) -> SeenFrom {
    SeenFrom { position: DVec3::new(x, y, z), density: 1000.0, is_parallel: false }
}

fn node(mesh: u32, local: DAffine3, parent: Option<u32>) -> Node {
    Node { local, mesh: Some(mesh), parent, ..Node::default() }
}

/// A mesh between 0 and 1 along each axis.
fn cube() -> Mesh {
    mesh(vec![primitive(1, 100, &[(2, 0.5)])])
}

#[test]
fn without_a_place_weights_are_the_scales_of_the_largest_place() {
    let scaled = |scale: f64| DAffine3::from_scale(DVec3::splat(scale));
    let nodes =
        vec![node(0, scaled(2.0), None), node(0, scaled(0.5), None), node(0, scaled(3.0), Some(0))];
    let scene = Scene { meshes: vec![cube(), mesh(Vec::new())], nodes, ..Scene::default() };
    let weights = MeshWeights::new(&scene, &[]);
    // 6 × √3 = 10.4, rounded down; nothing draws the other.
    assert_eq!(weights.each[0], 8.0);
    assert!(weights.each[1] > 0.0 && weights.each[1] < 1e-29, "{weights:?}");
    assert_eq!(weights.reach, f64::INFINITY);
}

#[test]
fn weights_are_pixels_at_the_nearest_point_of_the_nearest_copy() {
    let at = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    let nodes = vec![node(0, at(10.0), None), node(0, at(-50.0), None), node(1, at(100.0), None)];
    let scene = Scene { meshes: vec![cube(), cube()], nodes, ..Scene::default() };
    // √3 × 1000 / 10 = 173 and / 100 = 17.3.
    let weights = MeshWeights::new(&scene, &[eye(0.0, 0.5, 0.5)]);
    assert_eq!((&weights.each[..], weights.reach), (&[128.0, 16.0][..], 2.5));
    // The nearest of several places counts; parallel rays see all alike, however far.
    let parallel = SeenFrom { density: 20.0, is_parallel: true, ..eye(0.0, 0.0, 1e9) };
    let weights = MeshWeights::new(&scene, &[eye(0.0, 0.5, 0.5), parallel]);
    assert_eq!((&weights.each[..], weights.reach), (&[128.0, 32.0][..], 2.5));
    assert_eq!(MeshWeights::new(&scene, &[parallel]).reach, f64::INFINITY);
    // Inside of a mesh the eye is not at its surface.
    let inside = MeshWeights::new(&scene, &[eye(10.5, 0.5, 0.5)]);
    let nearest = 0.75_f64.sqrt() / 16.0;
    assert_eq!((inside.each[0], inside.reach), (24576.0, nearest / 4.0));
}

#[test]
fn a_small_mesh_on_the_wall_is_refined_before_one_that_no_node_draws() {
    let meshes = [1, 2].map(|name| mesh(vec![primitive(name, 1000, &[(4, 0.5), (16, 2.0)])]));
    let nodes = vec![node(0, DAffine3::from_scale(DVec3::splat(0.001)), None)];
    let scene = Scene { meshes: meshes.to_vec(), nodes, ..Scene::default() };
    let weights = MeshWeights::new(&scene, &[eye(3.0, 0.0, 0.0)]).each;
    // √3 × 0.001 × 1000 / 3 = 0.58.
    assert_eq!(weights[0], 0.5);
    let choose = |budget| Residency::choose(&meshes, &[], &weights, budget);
    let of = &meshes[0].primitives[0];
    // The coarsest of both, and one that is refined by a step in this part and in another.
    let refined = of.limited_to(&of.cut_at(1)).geometry_bytes();
    let held = choose(choose(0).unwrap_err().least + 2 * refined).unwrap();
    assert_eq!(held.levels, [1, 2]);
    assert_eq!(held.error, 0.5 * 0.5, "what nobody sees has no error");
}

proptest! {
    #[test]
    fn moves_that_change_no_weight_change_the_reach_as_for_the_scene_anew(
        places in prop::collection::vec(-60.0..60.0f64, 12),
        moves in prop::collection::btree_map(0u32..12, -4.0..4.0f64, 0..5),
    ) {
        let at = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
        let nodes = (0..).zip(&places).map(|(index, x)| node(index % 3, at(*x), None)).collect();
        let whole = mesh(vec![primitive(2, 100, &[])]);
        let mut scene = Scene { meshes: vec![cube(), cube(), whole], nodes, ..Scene::default() };
        let seen_from = [eye(0.0, 5.0, 0.5)];
        let before = NodeWeights::new(&scene, &seen_from);
        let mut moved = Vec::new();
        for (index, by) in moves {
            let local = at(places[index as usize] + by);
            scene.nodes[index as usize].local = local;
            let node = NodeId(u64::from(index));
            moved.push(MovedPlace { index, node, local, world: local });
        }
        let anew = MeshWeights::new(&scene, &seen_from);
        let expected = (anew.each == before.mesh_weights().each).then_some(anew.reach);
        prop_assert_eq!(before.reach_after(&moved, |_| &[][..]), expected);
    }
}

#[test]
fn weights_of_hard_numbers_are_finite() {
    let far = DAffine3::from_translation(DVec3::splat(1e300));
    let tiny = DAffine3::from_scale(DVec3::splat(1e-300));
    let flat = DAffine3::from_scale(DVec3::ZERO);
    let nodes = [far, tiny, flat].map(|local| node(0, local, None));
    for of in nodes {
        let scene = Scene { meshes: vec![cube()], nodes: vec![of], ..Scene::default() };
        for places in [&[][..], &[eye(0.0, 0.0, 0.0)], &[eye(1e300, -1e300, 0.0)]] {
            let weights = MeshWeights::new(&scene, places);
            assert!(weights.each[0].is_finite() && weights.each[0] > 0.0, "{weights:?}");
            assert!(weights.reach >= 0.0, "{weights:?}");
        }
    }
}

#[test]
fn a_place_serves_another_within_its_reach_and_density() {
    let here = eye(0.0, 0.0, 0.0);
    assert!(here.is_near(&eye(0.0, 3.0, 0.0), 3.0) && !here.is_near(&eye(0.0, 3.1, 0.0), 3.0));
    let denser = |factor: f64| SeenFrom { density: 1000.0 * factor, ..here };
    assert!(here.is_near(&denser(1.4), 0.0) && !here.is_near(&denser(1.6), 0.0));
    assert!(here.is_near(&denser(0.7), 0.0) && !here.is_near(&denser(0.6), 0.0));
    assert!(!here.is_near(&SeenFrom { is_parallel: true, ..here }, 1.0));
    assert!(!here.is_near(&eye(f64::NAN, 0.0, 0.0), 1.0), "no number is near nothing");
}
