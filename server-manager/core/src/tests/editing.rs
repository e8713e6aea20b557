//! Transactions: all of one on one frame, or nothing; who is told, what is remembered.

use glam::{DAffine3, DVec3};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_protocol::feedback::Edited;
use polyptych_protocol::transaction::{AssetSource, BakedAssets, Transaction};
use polyptych_scene::{
    AssetSetId, Edit, Material, NewNode, Node, NodeId, Scene, SceneOutline, provisional_asset,
};

use super::super::scene_editing::TRANSACTIONS_MAX;
use super::*;

/// A house with a door, and a tree.
pub(super) fn outline() -> Arc<SceneOutline> {
    let node = |parent| Node { parent, ..Node::default() };
    let nodes = vec![node(None), node(Some(0)), node(None)];
    Arc::new(SceneOutline::from(&Scene { nodes, ..Scene::default() }))
}

pub(super) const HOUSE: NodeId = NodeId(0);
pub(super) const DOOR: NodeId = NodeId(1);
pub(super) const TREE: NodeId = NodeId(2);

pub(super) fn at(x: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::X * x)
}

pub(super) fn moving(node: NodeId, x: f64) -> Transaction {
    let mut transaction = Transaction::default();
    transaction.set_transform(node, at(x));
    transaction
}

impl ClusterFixture {
    /// A wall that shows the house.
    pub(super) fn with_house(channels: u32) -> Self {
        let mut stage = Self::new(channels);
        stage.open_house();
        stage
    }

    pub(super) fn open_house(&mut self) {
        self.request(Request::OpenScene { path: "house.glb".into(), scene: None });
        let job = self.imports.pop().expect("baked");
        let imported = ImportedScene { outline: outline(), ..Self::imported() };
        self.cluster.handle_import(self.now, job, Ok(imported));
        self.read();
        self.prepare_all();
        self.clear();
    }

    pub(super) fn edit(&mut self, transaction: Transaction) -> RequestId {
        self.request(Request::Edit(transaction))
    }

    fn edited(&self, id: RequestId) -> Option<&Edited> {
        let of_id = self.replies.iter().find(|(of, _)| *of == id)?;
        match &of_id.1 {
            Ok(Response::Edited(edited)) => Some(edited),
            other => panic!("{other:?}"),
        }
    }

    fn refusal(&mut self, transaction: Transaction) -> String {
        let before = self.cluster.editing_fingerprint();
        let id = self.edit(transaction);
        assert_eq!(self.cluster.editing_fingerprint(), before, "nothing half done");
        let (of, reply) = self.replies.pop().expect("an answer");
        assert_eq!(of, id);
        reply.expect_err("refused").reason
    }

    /// Returns the X coordinate at which a server has a node, if it was moved.
    fn place(&self, session: u64, node: NodeId) -> Option<f64> {
        let edits = &self.replicas[&SessionId(session)].edits;
        edits.node(node).and_then(|of| of.local).map(|local| local.translation.x)
    }
}

#[test]
fn a_transaction_is_seen_whole_from_one_frame_on() {
    let mut stage = ClusterFixture::with_house(2);
    let before = stage.cluster.frame;
    let mut transaction = moving(TREE, 4.0);
    let shed = transaction.create(NewNode { name: "shed".into(), ..NewNode::default() });
    transaction.create(NewNode { parent: Some(shed), local: at(2.0), ..NewNode::default() });
    transaction.set_parent(DOOR, Some(shed));
    let id = stage.edit(transaction);
    assert_eq!((stage.prepares.len(), stage.frames.len()), (2, 0), "nothing is drawn yet");
    stage.prepare_all();
    assert_eq!((stage.place(0, TREE), stage.place(1, TREE)), (Some(4.0), Some(4.0)));
    stage.draw(&[0], 1_000);
    assert!(stage.edited(id).is_none(), "not all have drawn it");
    stage.draw(&[1], 1_000);
    let edited = stage.edited(id).expect("an answer").clone();
    assert_eq!(edited.created, [NodeId(3), NodeId(4)]);
    assert_eq!(edited.node(shed), Some(NodeId(3)));
    assert_eq!((edited.feedback.frame.0, edited.frames), (before.0 + 1, 1));
    assert!(edited.feedback.is_complete());
    assert_eq!(stage.cluster.shown.edits.node(DOOR).expect("moved").parent, Some(Some(NodeId(3))));
    let memory = stage.memories.last().expect("remembered").clone();
    assert_eq!((memory.edits, memory.next_node), (stage.cluster.shown.edits.clone(), 5));
}

#[test]
fn an_edit_that_cannot_be_takes_its_transaction_with_it() {
    let mut stage = ClusterFixture::with_house(2);
    let mut tried = moving(TREE, 4.0);
    tried.set_parent(HOUSE, Some(DOOR));
    assert_eq!(stage.refusal(tried), "edit 1: node 0 cannot hang from node 1, which hangs from it");
    let cases: [(Edit, &str); 10] = [
        (Edit::Remove(NodeId(3)), "there is no node 3"),
        (Edit::SetVisible { node: NodeId::provisional(0), visible: true }, "used before it is"),
        (Edit::SetTransform { node: TREE, local: at(f64::NAN) }, "finite numbers"),
        (Edit::SetTransform { node: TREE, local: DAffine3::ZERO }, "singular"),
        (
            Edit::SetTransform { node: TREE, local: DAffine3::from_scale(DVec3::splat(1e30)) },
            "beyond 1e18",
        ),
        (Edit::SetTransform { node: TREE, local: at(1e30) }, "beyond 1e18"),
        (Edit::SetMesh { node: TREE, mesh: Some(0) }, "no mesh 0; the scene's file has 0"),
        (Edit::SetName { node: TREE, name: "n".repeat(1 << 20) }, "1048576 bytes, where 256"),
        (Edit::Create { node: NodeId(7), new: Box::default() }, "where new node 0 is next"),
        (Edit::RemoveAssets(AssetSetId(BlobHash([0; 32]))), "assets come beside the edits"),
    ];
    for (edit, part) in cases {
        let edits = vec![Edit::SetTransform { node: TREE, local: at(1.0) }, edit];
        let reason = stage.refusal(Transaction { edits, ..Transaction::default() });
        assert!(reason.starts_with("edit 1: ") && reason.contains(part), "{reason}");
    }
    assert_eq!(stage.refusal(Transaction::default()), "a transaction has one edit or more");
    assert_eq!(stage.prepares.len(), 0);
    let bare = ClusterFixture::new(1).refusal(moving(TREE, 1.0));
    assert!(bare.contains("no scene is open"), "{bare}");
}

#[test]
fn what_somebody_else_has_changed_since_is_not_overwritten() {
    let mut stage = ClusterFixture::with_house(1);
    let seen = stage.cluster.shown.revision;
    let before = Transaction { base: Some(Revision(seen.0 - 1)), ..moving(TREE, 1.0) };
    assert!(stage.refusal(before).contains("before the scene was opened"), "another scene's node");
    stage.edit(moving(TREE, 1.0));
    let on_it = |node, x| Transaction { base: Some(seen), ..moving(node, x) };
    let reason = stage.refusal(on_it(TREE, 2.0));
    assert!(reason.contains("node 2 is being changed by another"), "{reason}");
    stage.prepare_all();
    let reason = stage.refusal(on_it(TREE, 2.0));
    let now = stage.cluster.shown.revision;
    assert!(reason.contains(&format!("node 2 was changed at revision {now}")), "{reason}");
    let id = stage.edit(on_it(DOOR, 2.0));
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    stage.draw(&[0], 1_000);
    assert!(stage.edited(id).is_some(), "another node is free");
    // Back as it was in the file it was changed all the same.
    for visible in [false, true] {
        let mut blink = Transaction::default();
        blink.set_visible(HOUSE, visible);
        stage.edit(blink);
        stage.prepare_all();
    }
    assert!(stage.refusal(on_it(HOUSE, 2.0)).contains("node 0 was changed at revision"));
    let later = Transaction { base: Some(Revision(now.0 + 9)), ..moving(TREE, 2.0) };
    assert!(stage.refusal(later).contains("and the wall shows"));
}

#[test]
fn what_is_no_change_of_the_scene_is_no_change_for_who_reads_it() {
    let mut stage = ClusterFixture::with_house(1);
    let read = stage.cluster.scene_revision();
    assert_eq!(read, stage.cluster.shown.revision);
    let blob = BlobHash([7; 32]);
    let baked = EnvironmentSource::Baked(Environment { name: "studio.hdr".into(), blob });
    stage.request(Request::SetEnvironment(baked));
    stage.prepare_all();
    assert!(stage.cluster.shown.revision > read);
    assert_eq!(stage.cluster.scene_revision(), read);
    let on_it = |x| Transaction { base: Some(read), ..moving(TREE, x) };
    stage.edit(on_it(1.0));
    stage.prepare_all();
    assert_eq!(stage.cluster.scene_revision(), stage.cluster.shown.revision);
    assert!(stage.refusal(on_it(2.0)).contains("node 2 was changed at revision"));
}

#[test]
fn transactions_that_come_faster_than_frames_are_shown_together() {
    let mut stage = ClusterFixture::with_house(2);
    let before = stage.cluster.shown.revision;
    let ids: Vec<_> = (0..20).map(|x| stage.edit(moving(TREE, f64::from(x)))).collect();
    stage.prepare_all();
    stage.prepare_all();
    for _ in 0..3 {
        stage.draw(&[0, 1], 1_000);
        stage.wait(0);
    }
    assert!(ids.iter().all(|id| stage.edited(*id).is_some()), "{:?}", stage.replies);
    assert_eq!(stage.place(0, TREE), Some(19.0));
    assert_eq!(stage.cluster.shown.revision.0, before.0 + 2, "two changes");
    stage.clear();
    for _ in 0..=TRANSACTIONS_MAX {
        stage.edit(moving(TREE, 1.0));
    }
    let refused = stage.replies.iter().filter(|(_, reply)| reply.is_err()).count();
    assert_eq!(refused, 1, "one client cannot fill the manager's memory");
}

#[test]
fn numbers_and_edits_outlive_the_manager_and_end_with_the_scene() {
    let mut stage = ClusterFixture::with_house(1);
    let mut transaction = Transaction::default();
    let shed = transaction.create(NewNode::default());
    transaction.remove(shed);
    transaction.create(NewNode { local: at(3.0), ..NewNode::default() });
    stage.edit(transaction);
    stage.prepare_all();
    let memory = stage.memories.last().expect("remembered").clone();
    let digest = stage.cluster.shown_digest;
    stage.cluster = Cluster::restore(wall(1), Epoch(8), &memory);
    stage.cluster.set_outline(Some(outline()));
    assert_eq!(stage.cluster.shown_digest, digest);
    stage.cluster.handle_client(CLIENT, "test".into());
    stage.join(SessionId(9), 0).expect("joined");
    let snapshot = &stage.prepares.last().expect("a snapshot").1;
    assert_eq!((snapshot.base, snapshot.operations.len()), (None, 3), "wall, scene, edits");
    stage.prepare_all();
    assert_eq!(stage.place(9, NodeId(4)), None, "placed as it was made");
    assert!(stage.replicas[&SessionId(9)].edits.node(NodeId(3)).is_none(), "gone without a trace");
    let mut transaction = Transaction::default();
    transaction.create(NewNode::default());
    stage.edit(transaction);
    stage.prepare_all();
    assert_eq!(stage.memories.last().expect("remembered").next_node, 6, "no number twice");
    stage.request(Request::OpenScene { path: "house.glb".into(), scene: None });
    let job = stage.imports.pop().expect("baked");
    let imported = ImportedScene { outline: outline(), ..ClusterFixture::imported() };
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    assert!(stage.refusal(moving(TREE, 1.0)).contains("another scene is being opened"));
    stage.prepare_all();
    assert!(stage.cluster.shown.edits.is_empty());
}

#[test]
fn edits_that_no_server_can_prepare_change_nothing_and_take_those_behind_with_them() {
    let mut stage = ClusterFixture::with_house(2);
    let first = stage.edit(moving(TREE, 1.0));
    let second = stage.edit(moving(DOOR, 1.0));
    let before = stage.cluster.shown.edits.fingerprint();
    for session in [0, 1] {
        let revision = stage.prepares.last().expect("a change").1.revision;
        let reason = "the disk is full".to_owned();
        let epoch = stage.cluster.epoch();
        let failed = ServerMessage::PrepareFailed { epoch, revision, reason };
        stage.say(SessionId(session), failed);
    }
    for id in [first, second] {
        let (_, reply) = stage.replies.iter().find(|(of, _)| *of == id).expect("an answer");
        let reason = &reply.as_ref().expect_err("refused").reason;
        assert!(
            reason.starts_with("nothing has changed, since server c0: the disk is full"),
            "{reason}"
        );
    }
    assert_eq!(stage.cluster.shown.edits.fingerprint(), before);
    assert_eq!(stage.cluster.editing_fingerprint(), before);
}

#[test]
fn what_is_temporary_ends_with_its_client_and_with_the_manager() {
    const GUEST: SessionId = SessionId(700);
    let mut stage = ClusterFixture::with_house(1);
    stage.cluster.handle_client(GUEST, "guest".into());
    let mut pointer = Transaction::temporary();
    let arrow = pointer.create(NewNode::default());
    pointer.create(NewNode { parent: Some(arrow), ..NewNode::default() });
    let request = Request::Edit(pointer);
    stage.cluster.handle_request(stage.now, GUEST, RequestId(1), request);
    stage.read();
    stage.prepare_all();
    stage.edit(moving(TREE, 1.0));
    stage.prepare_all();
    let memory = stage.memories.last().expect("remembered").clone();
    assert_eq!(memory.temporary, [NodeId(3), NodeId(4)]);

    let restored = Cluster::restore(wall(1), Epoch(8), &memory);
    let left: Vec<_> = restored.shown.edits.nodes().map(|(node, _)| node).collect();
    assert_eq!((left, restored.shown.revision), (vec![TREE], Revision(memory.revision.0 + 1)));

    // Somebody hangs something from it; it goes too.
    let mut below = Transaction::default();
    below.create(NewNode { parent: Some(NodeId(3)), ..NewNode::default() });
    stage.edit(below);
    stage.prepare_all();
    stage.cluster.handle_client_gone(stage.now, GUEST);
    stage.read();
    stage.prepare_all();
    let left: Vec<_> = stage.cluster.shown.edits.nodes().map(|(node, _)| node).collect();
    assert_eq!(left, [TREE]);
    assert!(stage.memories.last().expect("remembered").temporary.is_empty());
    let replica = &stage.replicas[&SessionId(0)];
    assert_eq!(replica.digest(), stage.cluster.shown_digest);
}

#[test]
fn temporary_nodes_end_with_their_client_though_servers_refuse_at_first() {
    const GUEST: SessionId = SessionId(700);
    let mut stage = ClusterFixture::with_house(1);
    stage.cluster.handle_client(GUEST, "guest".into());
    let mut pointer = Transaction::temporary();
    pointer.create(NewNode::default());
    stage.cluster.handle_request(stage.now, GUEST, RequestId(1), Request::Edit(pointer));
    stage.read();
    stage.prepare_all();
    let left = |stage: &ClusterFixture| stage.cluster.shown.edits.nodes().count();
    assert_eq!(left(&stage), 1);
    stage.cluster.handle_client_gone(stage.now, GUEST);
    stage.read();
    for _ in 0..3 {
        let (epoch, reason) = (Epoch(7), "no room".to_owned());
        let revision = stage.cluster.changes.revision().expect("it is to go");
        stage.say(SessionId(0), ServerMessage::PrepareFailed { epoch, revision, reason });
        assert_eq!((left(&stage), stage.cluster.changes.revision()), (1, None));
        assert_eq!(stage.cluster.persistent_state().temporary, [NodeId(3)]);
        stage.wait(1_000_000);
    }
    stage.prepare_all();
    assert_eq!(left(&stage), 0);
    assert!(stage.memories.last().expect("remembered").temporary.is_empty());
    assert_eq!(stage.cluster.next_temporary_end(), None);
}

/// A transaction that shows the last of so many meshes that it brings.
fn bringing(manifest: u8, meshes: u32) -> Transaction {
    let assets = BakedAssets {
        manifest: BlobHash([manifest; 32]),
        primitives: vec![1; meshes as usize],
        materials: 1,
        textures: 0,
        notes: vec![format!("file {manifest}: a note")],
    };
    let mut transaction = Transaction::default().with_assets(AssetSource::Baked(assets));
    let mesh = Some(provisional_asset(meshes - 1));
    transaction.create(NewNode { mesh, ..NewNode::default() });
    transaction
}

#[test]
fn assets_have_numbers_behind_all_others_and_go_when_nothing_uses_them() {
    let mut stage = ClusterFixture::with_house(1);
    let numbers = |stage: &mut ClusterFixture, transaction| {
        let id = stage.edit(transaction);
        stage.prepare_all();
        stage.draw(&[0], 1_000);
        let edited = stage.edited(id).expect("an answer").clone();
        assert!(edited.notes.len() == 1 && edited.notes[0].ends_with(": a note"), "{edited:?}");
        (edited.assets.map(|of| (of.first_mesh, of.first_material)), edited.created[0])
    };
    let (first, one) = numbers(&mut stage, bringing(1, 2));
    let (second, _) = numbers(&mut stage, bringing(2, 1));
    assert_eq!((first, second), (Some((0, 0)), Some((2, 1))));
    let (again, other) = numbers(&mut stage, bringing(1, 2));
    assert_eq!(again, Some((3, 2)), "materials of its own, though the bytes are there once");
    let held = |stage: &ClusterFixture| {
        let shown = &stage.cluster.shown.edits;
        (shown.assets().count(), shown.clone() == stage.replicas[&SessionId(0)].edits)
    };
    for (node, left) in [(one, 2), (other, 1)] {
        let mut gone = Transaction::default();
        gone.remove(node);
        stage.edit(gone);
        stage.prepare_all();
        stage.draw(&[0], 1_000);
        assert_eq!(held(&stage), (left, true), "each goes with its own node");
    }
    let idle = Transaction { edits: Vec::new(), ..bringing(3, 1) };
    assert!(stage.refusal(idle).contains("nothing of the scene would use the assets"));
    let mut beyond = bringing(3, 1);
    beyond.create(NewNode { mesh: Some(provisional_asset(1)), ..NewNode::default() });
    assert_eq!(stage.refusal(beyond), "edit 1: the transaction brings no mesh 1; it brings 1");
    let raw = Transaction::default().with_assets(AssetSource::File("x.glb".into()));
    assert_eq!(stage.refusal(raw), "its assets were not read yet");
    assert_eq!(held(&stage), (1, true));
}

#[test]
fn a_file_that_replaces_itself_again_and_again_takes_the_numbers_of_two() {
    let mut stage = ClusterFixture::with_house(1);
    let mut shown = None;
    for turn in [0, 1, 0, 1, 0] {
        let mut transaction = bringing(1, 2);
        if let Some(node) = shown {
            transaction.remove(node);
        }
        let id = stage.edit(transaction);
        stage.prepare_all();
        stage.draw(&[0], 1_000);
        let edited = stage.edited(id).expect("an answer").clone();
        let numbers = edited.assets.expect("numbers");
        assert_eq!((numbers.first_mesh, numbers.first_material), (turn * 2, turn));
        assert_eq!(stage.cluster.shown.edits.assets().count(), 1);
        shown = Some(edited.created[0]);
    }
}

#[test]
fn a_file_that_replaces_itself_is_not_in_its_own_way() {
    let mut stage = ClusterFixture::with_house(1);
    let id = stage.edit(bringing(1, 2));
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    let shown = stage.edited(id).expect("an answer").clone();
    let mut gone = Transaction::default();
    gone.remove(shown.created[0]);
    stage.edit(gone);
    // While that is prepared, the same file comes again, with the same numbers.
    let id = stage.edit(Transaction { base: Some(shown.revision), ..bringing(1, 2) });
    stage.prepare_all();
    stage.prepare_all();
    for _ in 0..3 {
        stage.draw(&[0], 1_000);
        stage.wait(0);
    }
    assert_eq!(stage.edited(id).expect("an answer").assets, shown.assets);
}

#[test]
fn a_client_that_saw_another_material_of_a_number_is_refused() {
    let mut stage = ClusterFixture::with_house(1);
    let show = |stage: &mut ClusterFixture, transaction: Transaction| {
        let id = stage.edit(transaction);
        stage.prepare_all();
        stage.draw(&[0], 1_000);
        stage.edited(id).expect("an answer").clone()
    };
    let first = show(&mut stage, bringing(1, 1));
    let mut gone = Transaction::default();
    gone.remove(first.created[0]);
    show(&mut stage, gone);
    let second = show(&mut stage, bringing(2, 1));
    assert_eq!(second.assets, first.assets, "the numbers are given again");
    let paint = |base: Revision| {
        let mut transaction = Transaction::based_on(base);
        transaction.set_material(0, Material::default());
        transaction
    };
    let refusal = stage.refusal(paint(first.revision));
    assert!(refusal.contains("what material 0 shows was changed at revision"), "{refusal}");
    show(&mut stage, paint(second.revision));
    // So is one that saw another mesh of a number.
    let place = |base: Revision| {
        let mut transaction = Transaction::based_on(base);
        let mesh = second.assets.expect("numbers").first_mesh;
        transaction.create(NewNode { mesh: Some(mesh), ..NewNode::default() });
        transaction
    };
    let refusal = stage.refusal(place(first.revision));
    assert!(refusal.contains("shows was changed at revision"), "{refusal}");
    show(&mut stage, place(second.revision));
}

#[test]
fn a_file_without_meshes_brings_nodes_and_notes_alone() {
    let mut stage = ClusterFixture::with_house(1);
    let assets = BakedAssets {
        manifest: BlobHash([9; 32]),
        primitives: Vec::new(),
        materials: 1,
        textures: 0,
        notes: vec!["scenes: a note".into()],
    };
    let mut lamp = Transaction::default().with_assets(AssetSource::Baked(assets));
    lamp.create(NewNode::default());
    let id = stage.edit(lamp);
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    let edited = stage.edited(id).expect("an answer");
    assert_eq!((edited.created.len(), edited.assets), (1, None));
    assert_eq!(edited.notes, ["scenes: a note"]);
    assert_eq!(stage.cluster.shown.edits.assets().count(), 0);
}
