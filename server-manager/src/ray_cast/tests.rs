//! Rays against every triangle of a scene, one by one in the world.

use glam::{DQuat, Quat, Vec3};
use polyptych_protocol::ids::Revision;
use polyptych_scene::{
    AssetManifests, Edit, Instance, Mesh, Node, NodeId, Primitive, Scene, SceneEdits, VertexLayout,
};
use proptest::prelude::*;

use super::*;

/// A scene in a store, with what was changed of it.
struct Stage {
    _folder: tempfile::TempDir,
    store: BlobStore,
    base: Scene,
    edits: SceneEdits,
    index: Arc<SceneIndex>,
    soup: Vec<[Vec3; 3]>,
}

fn corner(numbers: [f32; 3]) -> Vec3 {
    Vec3::from(numbers)
}

impl Stage {
    /// One mesh of these triangles, which stands in these places; the last one twice, by instances.
    fn new(soup: &[[Vec3; 3]], places: &[DAffine3], edits: SceneEdits) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = BlobStore::new(folder.path());
        let points = soup.iter().flatten();
        let vertex = |point: &Vec3| [point.to_array(), [0.0; 3]].concat();
        let vertices = points.clone().flat_map(vertex).flat_map(f32::to_le_bytes);
        let indices = (0..soup.len() as u16 * 3).flat_map(u16::to_le_bytes);
        let bytes: Vec<u8> = vertices.chain(indices).collect();
        let origin = DVec3::new(10.0, 0.0, 0.0);
        let around = |of: fn(Vec3, Vec3) -> Vec3| points.clone().copied().reduce(of).expect("some");
        let primitive = Primitive {
            blob: store.write(&bytes).expect("written"),
            layout: VertexLayout::default(),
            vertex_count: soup.len() as u32 * 3,
            index_count: soup.len() as u32 * 3,
            index_format: IndexFormat::U16,
            topology: Topology::Triangles,
            material: None,
            origin,
            min: around(Vec3::min),
            max: around(Vec3::max),
        };
        let mesh = Mesh { name: String::new(), primitives: vec![primitive] };
        let node = |local: &DAffine3| Node { local: *local, mesh: Some(0), ..Node::default() };
        let mut nodes: Vec<Node> = places.iter().map(node).collect();
        let instance = |x: f32| Instance {
            translation: Vec3::X * x,
            rotation: Quat::from_rotation_z(x),
            scale: Vec3::new(1.0, -0.5, 2.0),
        };
        nodes.last_mut().expect("a place").instances = [0.5, 7.0].map(instance).into();
        let base = Scene { nodes, meshes: vec![mesh], ..Scene::default() };
        let manifest = store.write(&polyptych_codec::encode(&base)).expect("written");
        let index = SceneIndex::new(None, &store, manifest, edits.clone()).expect("an index");
        Self { _folder: folder, store, base, edits, index, soup: soup.to_vec() }
    }

    fn cast(&self, ray: Ray) -> Option<RayHit> {
        let cache = TriangleCache::default();
        let query = RayQuery { ray, max_distance: None };
        let hit = cast(&self.index, &cache, &self.store, &query, Revision(3)).expect("a scene");
        let again = cast(&self.index, &cache, &self.store, &query, Revision(3)).expect("a scene");
        assert_eq!(hit, again, "what is kept answers alike");
        hit
    }

    /// Every triangle in the world, with its node.
    fn triangles(&self) -> Vec<(NodeId, [DVec3; 3])> {
        let (scene, ids) = self.edits.apply_to(&self.base, &AssetManifests::new());
        let world = scene.world_from_nodes();
        let mut all = Vec::new();
        for ((node, id), world) in scene.nodes.iter().zip(ids).zip(world) {
            let places: Vec<DAffine3> = match &node.instances[..] {
                [] => vec![world],
                instances => instances
                    .iter()
                    .map(|one| {
                        world
                            * DAffine3::from_scale_rotation_translation(
                                one.scale.as_dvec3(),
                                one.rotation.as_dquat(),
                                one.translation.as_dvec3(),
                            )
                    })
                    .collect(),
            };
            for place in places {
                for corners in &self.soup {
                    let point = |p: &Vec3| DVec3::new(10.0, 0.0, 0.0) + p.as_dvec3();
                    all.push((id, corners.each_ref().map(|p| place.transform_point3(point(p)))));
                }
            }
        }
        all
    }

    /// How far along a ray the nearest triangle is, by looking at each.
    fn nearest(&self, ray: &Ray) -> Option<f64> {
        let along = |(_, [a, b, c]): (NodeId, [DVec3; 3])| {
            let normal = (b - a).cross(c - a);
            let along = (a - ray.origin).dot(normal) / ray.direction.dot(normal);
            let at = ray.at(along);
            let inside = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(from, to)| (*to - *from).cross(at - *from).dot(normal) >= 0.0);
            (along > 0.0 && inside).then_some(along)
        };
        self.triangles().into_iter().filter_map(along).reduce(f64::min)
    }
}

fn soup() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let point = prop::array::uniform3(-2.0f32..2.0);
    prop::collection::vec(prop::array::uniform3(point).prop_map(|t| t.map(corner)), 1..30)
}

fn places() -> impl Strategy<Value = Vec<DAffine3>> {
    let place = (prop::array::uniform3(-6.0..6.0), 0.1..3.0f64, 0.0..6.0f64);
    let place = place.prop_map(|(at, scale, turn)| {
        DAffine3::from_scale_rotation_translation(
            DVec3::new(scale, -scale, 1.0),
            DQuat::from_rotation_y(turn),
            DVec3::from(at) * 1e3,
        )
    });
    prop::collection::vec(place, 1..8)
}

proptest! {
    #[test]
    fn rays_meet_what_every_triangle_by_itself_says(
        soup in soup(),
        places in places(),
        aims in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::array::uniform3(-1.0..1.0f64)),
            20,
        ),
    ) {
        let mut edits = SceneEdits::default();
        edits.apply(Edit::SetVisible { node: NodeId(0), visible: places.len() == 1 });
        let stage = Stage::new(&soup, &places, edits);
        let triangles = stage.triangles();
        for (at, off) in aims {
            // Towards a triangle, from somewhere near it.
            let (_, [a, b, c]) = triangles[at.index(triangles.len())];
            let off = DVec3::from(off);
            let origin = a + off * 40.0;
            let ray = Ray { origin, direction: ((a + b + c) / 3.0 - origin) * 0.01 };
            let (found, due) = (stage.cast(ray), stage.nearest(&ray));
            let length = ray.direction.length();
            let (got, due) = (found.map(|hit| hit.distance), due.map(|along| along * length));
            // On the very edge of a triangle either answer is right.
            let is_same = match (got, due) {
                (Some(got), Some(due)) => (got - due).abs() < 1e-6 * (1.0 + due),
                (got, due) => got.is_none() == due.is_none(),
            };
            let moved = Ray { origin: origin + DVec3::splat(1e-7), ..ray };
            let is_edge = || stage.nearest(&moved).is_some() != due.is_some();
            prop_assert!(is_same || is_edge(), "{got:?} instead of {due:?}");
        }
    }
}

#[test]
fn a_hit_says_what_it_is_and_rays_that_are_none_are_refused() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(corner);
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for (place, x) in [(DAffine3::IDENTITY, 10.0), (mirrored, -10.0)] {
        let far = DAffine3::from_translation(DVec3::Y * 1e6);
        let stage = Stage::new(&[triangle], &[place, far], SceneEdits::default());
        let ray = Ray { origin: DVec3::new(x, 0.0, 5.0), direction: DVec3::NEG_Z * 2.0 };
        let hit = stage.cast(ray).expect("met");
        assert_eq!((hit.node, hit.distance, hit.is_front), (NodeId(0), 5.0, true), "{place}");
        assert_eq!((hit.position, hit.normal), (DVec3::new(x, 0.0, 0.0), DVec3::Z));
        let behind = Ray { origin: DVec3::new(x, 0.0, -5.0), direction: DVec3::Z };
        assert!(!stage.cast(behind).expect("met").is_front);
        let (cache, revision) = (TriangleCache::default(), Revision(1));
        let ask = |ray, max_distance| {
            cast(&stage.index, &cache, &stage.store, &RayQuery { ray, max_distance }, revision)
        };
        assert_eq!(ask(ray, Some(4.9)), Ok(None));
        assert!(ask(ray, Some(5.0)).expect("a ray").is_some());
        let nan = DVec3::splat(f64::NAN);
        for (ray, max) in [
            (Ray { origin: nan, ..ray }, None),
            (Ray { direction: nan, ..ray }, None),
            (Ray { direction: DVec3::ZERO, ..ray }, None),
            (ray, Some(-1.0)),
            (ray, Some(f64::NAN)),
        ] {
            assert!(ask(ray, max).is_err(), "{ray:?} {max:?}");
        }
    }
}
