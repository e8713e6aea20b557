//! Preparations that must not be done: too large, or not wanted any more.

use std::thread;

use crossbeam_channel::bounded;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use polyptych_protocol::state_log::{Operation, SceneRef};
use polyptych_scene::{
    AnimatedNode, Edit, IndexFormat, Mesh, Node, NodeId, Primitive, Sampler, Scene, Texture,
    TextureFormat, Topology, VertexLayout,
};

use super::*;

/// A revision that the render thread cannot make drawable.
const FAILING: Revision = Revision(99);

/// A loader whose cache has what a test writes, and a render thread that takes all.
struct Stage {
    cache: BlobStore,
    orders: Sender<LoadOrder>,
    line: LoaderLink,
    reports: mpsc::Receiver<RenderEvent>,
    /// Uploads that the render thread was given, once the loader has ended.
    uploads: thread::JoinHandle<Uploads>,
    loader: Option<Loader>,
    _root: tempfile::TempDir,
}

/// Uploads that a render thread was given.
#[derive(Debug, Default, PartialEq)]
struct Uploads {
    /// Scenes that were begun.
    begun: usize,
    /// Scenes that were laid out anew after edits.
    laid_out: usize,
    /// Items that were moved, of each scene where they were laid over the layout.
    moved: Vec<usize>,
}

impl Stage {
    fn new() -> Self {
        Self::finishing(|_| {})
    }

    /// With a render thread that does this before it answers for a state.
    fn finishing(finish: impl Fn(&LoadedState) + Send + 'static) -> Self {
        let root = tempfile::tempdir().expect("a temporary folder");
        let cache = BlobStore::new(root.path());
        let (orders, waiting) = bounded(ORDERS_MAX);
        let (sender, uploaded) = bounded(UPLOADS_MAX);
        let (bulk, _) = mpsc::channel(1);
        let (reporter, reports) = mpsc::channel(16);
        let line = LoaderLink { bulk, reports: reporter, is_cut: Arc::default() };
        let take = move || {
            let mut uploads = Uploads::default();
            for upload in uploaded {
                match upload {
                    Upload::Begin { .. } => uploads.begun += 1,
                    Upload::Relayout { moved: Some(moved), .. } => uploads.moved.push(moved.len()),
                    Upload::Relayout { moved: None, .. } => uploads.laid_out += 1,
                    Upload::Finish { state, answer } => {
                        finish(&state);
                        let is_fine = state.replica.revision != FAILING;
                        let bytes = is_fine.then_some(7).ok_or_else(|| "no memory".to_owned());
                        answer.send(bytes).expect("waited for");
                    }
                    _ => {}
                }
            }
            uploads
        };
        let uploads = thread::Builder::new().name("render".into()).spawn(take).expect("a thread");
        let loader = Loader::new(cache.clone(), waiting, sender, Arc::default(), Vec::new());
        Self { cache, orders, line, reports, uploads, loader: Some(loader), _root: root }
    }

    /// The connection ends, and another one takes its place. Gives what is reported over that.
    fn reconnect(&mut self) -> mpsc::Receiver<RenderEvent> {
        let (reporter, reports) = mpsc::channel(16);
        let (is_cut, bulk) = (Arc::default(), self.line.bulk.clone());
        let line = LoaderLink { bulk, reports: reporter, is_cut };
        std::mem::replace(&mut self.line, line).is_cut.store(true, Ordering::Relaxed);
        reports
    }

    /// Orders a scene of a mesh of so many primitives, drawn by so many nodes. States that were
    /// ready before were refused.
    fn order(&self, revision: u64, primitives: usize, nodes: usize) {
        let scene = self.scene_of(primitives, nodes);
        self.open(revision, &scene, Vec::new());
    }

    /// A scene of a mesh of so many primitives, drawn by so many nodes.
    fn scene_of(&self, primitives: usize, nodes: usize) -> Scene {
        let bytes = vec![0; 3 * VertexLayout::default().stride() as usize + 6];
        let blob = self.cache.write(&bytes).expect("written");
        let node = Node { mesh: Some(0), ..Node::default() };
        let mesh = Mesh { name: String::new(), primitives: vec![triangle(blob); primitives] };
        Scene { nodes: vec![node; nodes], meshes: vec![mesh], ..Scene::default() }
    }

    /// Orders a scene, behind these operations.
    fn open(&self, revision: u64, scene: &Scene, mut operations: Vec<Operation>) {
        operations.push(self.opening(scene));
        self.order_while(0, revision, operations);
    }

    /// The operation that opens a scene.
    fn opening(&self, scene: &Scene) -> Operation {
        let manifest = self.cache.write(&polyptych_codec::encode(scene)).expect("written");
        Operation::OpenScene(SceneRef { name: "it".into(), manifest })
    }

    /// Orders the state that these operations lead to, while frames name a revision.
    fn order_while(&self, shown: u64, revision: u64, operations: Vec<Operation>) {
        let (base, shown, revision) = (None, Revision(shown), Revision(revision));
        let prepare = Prepare { epoch: Epoch(1), base, revision, shown, operations };
        self.orders.send(LoadOrder { prepare, line: self.line.clone() }).expect("taken");
    }

    /// Orders edits of the scene, the state of which has the revision before.
    fn edit(&self, revision: u64, edits: Vec<Edit>) {
        let (shown, revision) = (Revision(revision - 1), Revision(revision));
        let operations = vec![Operation::EditScene(edits.into())];
        let base = Some(shown);
        let prepare = Prepare { epoch: Epoch(1), base, revision, shown, operations };
        self.orders.send(LoadOrder { prepare, line: self.line.clone() }).expect("taken");
    }

    /// Serves all orders; returns what was said of each, and what the render thread was given.
    fn run(mut self) -> (Vec<Result<Revision, String>>, Uploads) {
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
        (said, self.uploads.join().expect("no panic"))
    }
}

/// A triangle whose vertices and indices are in this blob.
fn triangle(blob: BlobHash) -> Primitive {
    Primitive {
        blob,
        layout: VertexLayout::default(),
        vertex_count: 3,
        index_count: 3,
        coarser_index_count: 0,
        meshlet_count: 0,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: None,
        origin: DVec3::ZERO,
        min: Vec3::ZERO,
        max: Vec3::ONE,
    }
}

#[test]
fn refuses_a_manifest_that_expands_beyond_the_limit() {
    let stage = Stage::new();
    stage.order(1, 1000, 100_000);
    let (said, uploads) = stage.run();
    let [Err(reason)] = &said[..] else { panic!("{said:?}") };
    for part in ["manifest", "100000 nodes", "100000000 primitives", "2097152"] {
        assert!(reason.contains(part), "{part:?} is not in {reason:?}");
    }
    assert_eq!(uploads, Uploads::default(), "the render thread never hears of it");
}

#[test]
fn gives_up_a_scene_behind_which_another_waits() {
    let stage = Stage::new();
    stage.order(1, 1000, 2000);
    stage.order(2, 1, 1);
    let (said, uploads) = stage.run();
    let expected = [Err("a newer preparation has come".to_owned()), Ok(Revision(2))];
    assert_eq!((said, uploads.begun), (expected.to_vec(), 1));
}

#[test]
fn an_order_of_a_connection_that_has_ended_is_given_up_without_a_word() {
    let mut stage = Stage::new();
    stage.order(1, 1, 1);
    let mut reports = stage.reconnect();
    stage.order(2, 1, 1);
    let (said, uploads) = stage.run();
    assert_eq!((said, uploads.begun), (Vec::new(), 1));
    let report = reports.try_recv().expect("an answer");
    let RenderEvent::Status(ServerMessage::Prepared(prepared)) = report else {
        panic!("{report:?}")
    };
    assert_eq!((prepared.revision, reports.try_recv().is_err()), (Revision(2), true));
}

#[test]
fn the_answer_for_a_state_that_was_replaced_while_it_was_finished_is_dropped() {
    let (at_it, is_at) = bounded(1);
    let (go, may_go) = bounded(1);
    let mut stage = Stage::finishing(move |state| {
        at_it.send(state.replica.revision).expect("waited for");
        may_go.recv().expect("told to go on");
    });
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    stage.order(1, 1, 1);
    assert_eq!(is_at.recv(), Ok(Revision(1)));
    // The manager is gone while the render thread is at it; the next one orders its own state.
    let mut reports = stage.reconnect();
    stage.order(7, 2, 1);
    go.send(()).expect("waited for");
    assert_eq!(is_at.recv(), Ok(Revision(7)));
    go.send(()).expect("waited for");
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    assert!(stage.reports.try_recv().is_err(), "nobody waits for the first");
    let report = reports.try_recv().expect("an answer");
    let RenderEvent::Status(ServerMessage::Prepared(prepared)) = report else {
        panic!("{report:?}")
    };
    assert_eq!((prepared.revision, reports.try_recv().is_err()), (Revision(7), true));
    assert_eq!(stage.uploads.join().expect("no panic").begun, 2);
}

#[test]
fn a_refused_scene_that_made_room_for_one_that_failed_is_brought_again() {
    let mut stage = Stage::new();
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    for (revision, primitives) in [(1, 1), (FAILING.0, 2), (100, 1)] {
        stage.order(revision, primitives, 1);
        // One at a time: a newer one ends those before.
        match stage.reports.blocking_recv().expect("an answer") {
            RenderEvent::Status(ServerMessage::Prepared(of)) => assert_eq!(of.revision.0, revision),
            RenderEvent::Status(ServerMessage::PrepareFailed { revision, .. }) => {
                assert_eq!(revision, FAILING);
            }
            other => panic!("{other:?}"),
        }
    }
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    assert_eq!(stage.uploads.join().expect("no panic").begun, 3);
}

#[test]
fn an_edit_behind_a_refused_scene_and_one_that_failed_builds_on_the_shown_scene() {
    let mut stage = Stage::new();
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    let opening = |primitives| stage.opening(&stage.scene_of(primitives, 100));
    let local = DAffine3::from_translation(DVec3::X);
    let edits = vec![Edit::SetTransform { node: NodeId(3), local }];
    let orders = [
        (0, 1, vec![opening(1)]),
        (1, 2, vec![opening(2)]),
        // The second was refused and makes room for this one.
        (1, FAILING.0, vec![opening(3)]),
        (1, 100, vec![opening(1), Operation::EditScene(edits.into())]),
    ];
    for (shown, revision, operations) in orders {
        stage.order_while(shown, revision, operations);
        // One at a time: a newer one ends those before.
        let RenderEvent::Status(status) = stage.reports.blocking_recv().expect("an answer") else {
            panic!("a picture")
        };
        let is_ready = matches!(status, ServerMessage::Prepared(_));
        assert_eq!(is_ready, revision != FAILING.0, "{status:?}");
    }
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    let uploads = stage.uploads.join().expect("no panic");
    assert_eq!(uploads, Uploads { begun: 3, laid_out: 0, moved: vec![1] });
}

#[test]
fn moves_are_laid_over_the_layout_and_other_edits_lay_out_anew() {
    let mut stage = Stage::new();
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    let expect_ready = |stage: &mut Stage, revision: u64| {
        // One at a time: each waits for the state before.
        let report = stage.reports.blocking_recv().expect("an answer");
        let RenderEvent::Status(ServerMessage::Prepared(prepared)) = report else {
            panic!("{report:?}")
        };
        assert_eq!(prepared.revision, Revision(revision));
    };
    let place = |node: u64| Edit::SetTransform {
        node: NodeId(node),
        local: DAffine3::from_translation(DVec3::X * node as f64),
    };
    stage.order(1, 1, 100);
    expect_ready(&mut stage, 1);
    let name = Edit::SetName { node: NodeId(9), name: "nine".into() };
    let hide = Edit::SetVisible { node: NodeId(5), visible: false };
    let all = [
        vec![place(3)],
        vec![name],
        vec![place(4)],
        vec![hide],
        vec![place(4), place(5)],
        (0..60).map(place).collect(),
    ];
    for (revision, edits) in (2..).zip(all) {
        stage.edit(revision, edits);
        expect_ready(&mut stage, revision);
    }
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    let uploads = stage.uploads.join().expect("no panic");
    // Node 4 stands in the layout that was made without node 5 as it was moved before.
    let expected = Uploads { begun: 1, laid_out: 2, moved: vec![1, 1, 2, 0] };
    assert_eq!(uploads, expected);
}

#[test]
fn a_scene_whose_textures_are_reduced_is_warned_of_also_behind_one_that_failed() {
    let mut stage = Stage::new();
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    let mut large = Texture {
        blob: BlobHash::of(b""),
        format: TextureFormat::Rgba8Srgb,
        width: 512,
        height: 512,
        mip_count: 10,
        sampler: Sampler::default(),
    };
    large.blob = stage.cache.write(&vec![0; large.bytes() as usize]).expect("written");
    let reduced = Scene { textures: vec![large], ..Scene::default() };
    let primitives = vec![triangle(BlobHash::of(b"nowhere"))];
    let mesh = Mesh { name: String::new(), primitives };
    let missing = Scene { meshes: vec![mesh], ..Scene::default() };
    let mut wall = Wall::new("test", Vec::new(), Vec::new());
    wall.budget.gpu_mib = Some(1);
    let (mut warning, mut were_ready) = (None, Vec::new());
    for (revision, scene) in (1..).zip([&reduced, &missing, &reduced]) {
        stage.open(revision, scene, vec![Operation::SetWall(Box::new(wall.clone()))]);
        // The warning comes behind the answer; the next order may come before.
        while were_ready.len() < revision as usize {
            match stage.reports.blocking_recv().expect("an answer") {
                RenderEvent::Status(ServerMessage::Storage { warning: told }) => warning = told,
                RenderEvent::Status(ServerMessage::Prepared(_)) => were_ready.push(true),
                RenderEvent::Status(ServerMessage::PrepareFailed { .. }) => were_ready.push(false),
                other => panic!("{other:?}"),
            }
        }
    }
    assert_eq!(were_ready, [true, false, true]);
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    while let Ok(RenderEvent::Status(ServerMessage::Storage { warning: told })) =
        stage.reports.try_recv()
    {
        warning = told;
    }
    let warning = warning.expect("its textures are reduced still");
    assert!(warning.contains("1/2 of their width and height"), "{warning}");
}

#[test]
fn a_node_that_clips_move_and_no_edit_mirrors_any_more_asks_for_a_new_layout() {
    let mut stage = Stage::new();
    let loader = stage.loader.take().expect("not run yet");
    let thread = thread::Builder::new().name("loader".into()).spawn(|| loader.run());
    let expect_ready = |stage: &mut Stage, revision: u64| {
        let report = stage.reports.blocking_recv().expect("an answer");
        let RenderEvent::Status(ServerMessage::Prepared(prepared)) = report else {
            panic!("{report:?}")
        };
        assert_eq!(prepared.revision, Revision(revision));
    };
    let moving = AnimatedNode {
        node: 0,
        translation: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        scale: DVec3::ONE,
        weights: Vec::new(),
    };
    let mut scene = stage.scene_of(1, 9);
    scene.animations.nodes = vec![moving];
    stage.open(1, &scene, Vec::new());
    expect_ready(&mut stage, 1);
    // Its batch has a twin with the second and the third of them only.
    for (revision, width) in (2..).zip([2.0, -2.0, -3.0, 3.0, 4.0]) {
        let local = DAffine3::from_scale(DVec3::new(width, 1.0, 1.0));
        stage.edit(revision, vec![Edit::SetTransform { node: NodeId(0), local }]);
        expect_ready(&mut stage, revision);
    }
    drop((stage.orders, stage.line));
    thread.expect("a thread").join().expect("no panic");
    let uploads = stage.uploads.join().expect("no panic");
    assert_eq!(uploads, Uploads { begun: 1, laid_out: 2, moved: vec![1, 1, 1] });
}
