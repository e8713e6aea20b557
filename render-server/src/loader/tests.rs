//! Preparations that must not be done: too large, or not wanted any more.

use std::thread;

use crossbeam_channel::bounded;
use glam::{DAffine3, DVec3, Vec3};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::state_log::Operation;
use polyptych_scene::{IndexFormat, Mesh, Node, Primitive, Scene, Topology, VertexLayout};

use super::*;

/// A loader whose cache has what a test writes, and a render thread that takes all.
struct Stage {
    cache: BlobStore,
    orders: Sender<LoadOrder>,
    line: LoaderLink,
    reports: mpsc::Receiver<RenderEvent>,
    /// How many scenes were begun, once the loader has ended.
    begun: thread::JoinHandle<usize>,
    loader: Option<Loader>,
    _root: tempfile::TempDir,
}

impl Stage {
    fn new() -> Self {
        let root = tempfile::tempdir().expect("a temporary folder");
        let cache = BlobStore::new(root.path());
        let (orders, waiting) = bounded(ORDERS_MAX);
        let (uploads, uploaded) = bounded(UPLOADS_MAX);
        let (bulk, _) = mpsc::channel(1);
        let (reporter, reports) = mpsc::channel(16);
        let line = LoaderLink { bulk, reports: reporter, is_cut: Arc::default() };
        let take = move || {
            let mut begun = 0;
            for upload in uploaded {
                match upload {
                    Upload::Begin { .. } => begun += 1,
                    Upload::Finish { answer, .. } => answer.send(Ok(7)).expect("waited for"),
                    _ => {}
                }
            }
            begun
        };
        let begun = thread::Builder::new().name("render".into()).spawn(take).expect("a thread");
        let loader = Loader::new(cache.clone(), waiting, uploads, Arc::default(), Vec::new());
        Self { cache, orders, line, reports, begun, loader: Some(loader), _root: root }
    }

    /// Orders a scene of a mesh of so many primitives, drawn by so many nodes.
    fn order(&self, revision: u64, primitives: usize, nodes: usize) {
        let layout = VertexLayout::default();
        let bytes = vec![0; 3 * layout.stride() as usize + 6];
        let primitive = Primitive {
            blob: self.cache.write(&bytes).expect("written"),
            layout,
            vertex_count: 3,
            index_count: 3,
            index_format: IndexFormat::U16,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::ZERO,
            min: Vec3::ZERO,
            max: Vec3::ONE,
        };
        let node = Node {
            name: String::new(),
            parent: None,
            local: DAffine3::IDENTITY,
            mesh: Some(0),
            light: None,
            instances: Vec::new(),
        };
        let mesh = Mesh { name: String::new(), primitives: vec![primitive; primitives] };
        let scene = Scene { nodes: vec![node; nodes], meshes: vec![mesh], ..Scene::default() };
        let manifest = self.cache.write(&polyptych_codec::encode(&scene)).expect("written");
        let operations = vec![Operation::OpenScene(SceneRef { name: "it".into(), manifest })];
        let revision = Revision(revision);
        let prepare = Prepare { epoch: Epoch(1), base: None, revision, operations };
        self.orders.send(LoadOrder { prepare, line: self.line.clone() }).expect("taken");
    }

    /// Serves all orders; returns what was said of each, and how many scenes were begun.
    fn run(mut self) -> (Vec<Result<Revision, String>>, usize) {
        let loader = self.loader.take().expect("not run yet");
        drop((self.orders, self.line));
        loader.run();
        let mut said = Vec::new();
        while let Ok(RenderEvent::Status(status)) = self.reports.try_recv() {
            said.push(match status {
                ServerMessage::Prepared(prepared) => Ok(prepared.revision),
                ServerMessage::PrepareFailed { reason, .. } => Err(reason),
                other => panic!("{other:?}"),
            });
        }
        (said, self.begun.join().expect("no panic"))
    }
}

#[test]
fn refuses_a_manifest_that_expands_beyond_the_limit() {
    let stage = Stage::new();
    stage.order(1, 1000, 100_000);
    let (said, begun) = stage.run();
    let [Err(reason)] = &said[..] else { panic!("{said:?}") };
    for part in ["manifest", "100000 nodes", "100000000 primitives", "2097152"] {
        assert!(reason.contains(part), "{part:?} is not in {reason:?}");
    }
    assert_eq!(begun, 0, "the render thread never hears of it");
}

#[test]
fn gives_up_a_scene_behind_which_another_waits() {
    let stage = Stage::new();
    stage.order(1, 1000, 2000);
    stage.order(2, 1, 1);
    let (said, begun) = stage.run();
    let expected = [Err("a newer preparation has come".to_owned()), Ok(Revision(2))];
    assert_eq!((said, begun), (expected.to_vec(), 1));
}
