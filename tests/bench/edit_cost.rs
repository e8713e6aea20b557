//! Cost of edits of a large scene: the manager for each transaction, by part, and a server for
//! each state that it makes ready.
//!
//! `cargo bench --bench edit_cost [-- NODES MOVED]`; without, scenes of 10,000, 100,000 and a
//! million nodes, of which 1 % move in each frame. Nothing is drawn, and no socket is used.

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec2, DVec3, UVec2, Vec3};
use polyptych_core::{Cluster, Effect, ImportedScene, Input, SessionId};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::Command;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::{Epoch, RequestId};
use polyptych_protocol::request::{MessageToClient, Request, Response, SceneSummary};
use polyptych_protocol::server_message::{FrameRendered, Prepared, ServerMessage};
use polyptych_protocol::state_log::{Operation, Replica, SceneRef};
use polyptych_protocol::transaction::Transaction;
use polyptych_renderer::{MovedItems, MovedNode, SceneLayout};
use polyptych_scene::{
    AssetManifests, Edit, IndexFormat, Mesh, Node, NodeId, PlacedNodes, Primitive, Scene,
    SceneEdits, SceneFeatures, SceneOutline, Topology, VertexLayout,
};
use polyptych_wall::surface::{Plane, Surface};
use polyptych_wall::{Channel, ChannelId, Screen, Wall};

const FRAMES: usize = 40;
const SERVERS: u16 = 4;
const MESHES: u32 = 4;

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|of| of.parse().ok()).collect();
    let sizes = match numbers[..] {
        [nodes, moved] => vec![(nodes, moved)],
        _ => vec![(10_000, 100), (100_000, 1000), (1_000_000, 10_000)],
    };
    for (nodes, moved) in sizes {
        println!("{nodes} nodes, {moved} of them move in each frame");
        let scene = scene(nodes);
        server(&scene, moved)?;
        manager(&scene, moved)?;
    }
    Ok(())
}

/// Groups of a hundred nodes that share a few meshes.
fn scene(nodes: u64) -> Scene {
    let primitive = |mesh: u32| Primitive {
        blob: BlobHash::of(&mesh.to_le_bytes()),
        layout: VertexLayout::default(),
        vertex_count: 24,
        index_count: 36,
        coarser_index_count: 0,
        meshlet_count: 0,
        cuts: Vec::new(),
        finest_level: 0,
        deformed: None,
        index_format: IndexFormat::U16,
        topology: Topology::Triangles,
        material: None,
        origin: DVec3::ZERO,
        min: Vec3::splat(-0.5),
        max: Vec3::splat(0.5),
    };
    let mesh = |index| Mesh { name: String::new(), primitives: vec![primitive(index)] };
    let node = |index: u64| {
        let is_group = index.is_multiple_of(100);
        let (x, z) = ((index / 100 % 1000) as f64, (index / 100_000) as f64);
        let at = if is_group { DVec3::new(x, 0.0, z) * 40.0 } else { place(index, 0) };
        Node {
            name: format!("node {index}"),
            parent: (!is_group).then_some((index / 100 * 100) as u32),
            local: DAffine3::from_translation(at),
            mesh: (!is_group).then_some((index % u64::from(MESHES)) as u32),
            ..Node::default()
        }
    };
    let (nodes, meshes) = ((0..nodes).map(node).collect(), (0..MESHES).map(mesh).collect());
    Scene { name: "many".into(), nodes, meshes, ..Scene::default() }
}

/// A place in its group, another one in each frame.
fn place(node: u64, frame: u64) -> DVec3 {
    let at = |by: u64| (node * by % 997) as f64 / 25.0;
    DVec3::new(at(7), at(31), at(101)) + DVec3::Y * (frame as f64 * 0.01)
}

/// Edits that move so many nodes of a scene; scattered over all of it, or some that follow each
/// other.
fn moves(nodes: u64, moved: u64, frame: u64, is_scattered: bool) -> Vec<Edit> {
    let step = if is_scattered { nodes / moved } else { 1 };
    let node = |index: u64| {
        // Not the groups themselves.
        let own = if is_scattered { index * step } else { index / 99 * 100 + 1 + index % 99 };
        let node = own + u64::from(own.is_multiple_of(100));
        let local = DAffine3::from_translation(place(node, frame));
        Edit::SetTransform { node: NodeId(node), local }
    };
    (0..moved).map(node).collect()
}

/// Prints the median, and the longest after the first two.
fn say(what: &str, mut times: Vec<Duration>) {
    let first = times.first().copied().unwrap_or_default();
    times.drain(..times.len().min(2));
    times.sort_unstable();
    let ms = |of: Option<&Duration>| of.map_or(0.0, |time| time.as_secs_f64() * 1e3);
    let (median, longest) = (ms(times.get(times.len() / 2)), ms(times.last()));
    println!(
        "  {what:<58} first {:8.2}  median {median:8.2}  longest {longest:8.2} ms",
        ms(Some(&first))
    );
}

fn timed<T>(times: &mut Vec<Duration>, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    times.push(start.elapsed());
    done
}

/// A server: the scene laid out anew, and what was moved laid over it.
fn server(base: &Scene, moved: u64) -> Result<(), Failure> {
    let none = AssetManifests::new();
    let mut anew = Vec::new();
    for _ in 0..3 {
        let edits = SceneEdits::default();
        timed(&mut anew, || {
            let (scene, ids) = edits.apply_to(base, &none);
            assert!(scene.fault().is_none());
            let _ = SceneFeatures::from_scene(&scene);
            let placed = PlacedNodes::new(&scene.nodes, ids, edits.clone());
            SceneLayout::new(scene, &|| false).map(|layout| (placed, layout))
        })?;
    }
    say("server: laid out anew", anew);
    let (scene, ids) = SceneEdits::default().apply_to(base, &none);
    let placed = PlacedNodes::new(&scene.nodes, ids, SceneEdits::default());
    let layout = SceneLayout::new(scene, &|| false)?;
    for is_scattered in [true, false] {
        let (mut replica, mut fold, mut find, mut lay) =
            (Replica::default(), Vec::new(), Vec::new(), Vec::new());
        for frame in 0..FRAMES as u64 {
            let edits = moves(base.nodes.len() as u64, moved, frame + 1, is_scattered);
            timed(&mut fold, || {
                let before = replica.clone();
                replica.apply(Operation::EditScene(Arc::new(edits)));
                drop(before);
            });
            let places = timed(&mut find, || placed.moved(base, &replica.edits));
            let places = places.ok_or("more than moves")?;
            let items = timed(&mut lay, || {
                let nodes = places.iter();
                let nodes = nodes.map(|place| MovedNode::new(place.index, place.world, &[]));
                MovedItems::new(&layout, nodes)
            });
            assert_eq!(items.map(|items| items.len() as u64), Some(moved));
        }
        let which = if is_scattered { "scattered" } else { "neighbours" };
        say(&format!("server: fold, {which}"), fold);
        say("server: what stands elsewhere", find);
        say("server: items that were moved, their tree, their batches", lay);
    }
    Ok(())
}

/// Servers that answer at once, and what the manager takes meanwhile.
struct Stage {
    cluster: Cluster,
    now: u64,
    replicas: Vec<(SessionId, Replica)>,
    /// Bytes to all servers.
    sent: u64,
    /// Time in the core, and to encode commands.
    core: Duration,
    encode: Duration,
    edited: u64,
    remembered: Option<Box<polyptych_core::PersistentState>>,
}

impl Stage {
    fn tell(&mut self, input: Input) {
        self.now += 10;
        let start = Instant::now();
        let done = self.cluster.handle(self.now, input);
        self.core += start.elapsed();
        done.expect("let in");
    }

    /// Carries out what the core wants, until there is nothing more to do.
    fn settle(&mut self) {
        loop {
            while let Some(effect) = self.cluster.poll_effect() {
                match effect {
                    Effect::Command { to, command } => {
                        let start = Instant::now();
                        let bytes = polyptych_codec::framed(&polyptych_codec::encode(&*command));
                        self.encode += start.elapsed();
                        self.sent += bytes.len() as u64 * to.len() as u64;
                        for session in to {
                            self.answer(session, &command);
                        }
                    }
                    Effect::Answer { answer: MessageToClient::Reply { reply, .. }, .. } => {
                        self.edited += u64::from(matches!(reply, Ok(Response::Edited(_))));
                    }
                    Effect::Remember(memory) => self.remembered = Some(memory),
                    _ => {}
                }
            }
            match self.cluster.poll_timeout() {
                Some(due) if due <= self.now => self.tell(Input::Timeout),
                _ => return,
            }
        }
    }

    fn answer(&mut self, session: SessionId, command: &Command) {
        let of = (session.0 - 1) as usize;
        let status = match command {
            Command::Prepare(prepare) => {
                let replica = &mut self.replicas[of].1;
                if prepare.base.is_none() {
                    *replica = Replica::from_snapshot(prepare.revision, prepare.operations.clone());
                } else {
                    prepare.operations.iter().cloned().for_each(|one| replica.apply(one));
                }
                let (epoch, revision, digest) = (prepare.epoch, prepare.revision, replica.digest());
                let features = Vec::new();
                ServerMessage::Prepared(Prepared {
                    epoch,
                    revision,
                    digest,
                    features,
                    scene_bytes: 0,
                    detail_reach: None,
                })
            }
            Command::Frame(frame) => ServerMessage::Drawn(FrameRendered {
                epoch: frame.epoch,
                frame: frame.frame,
                channel: ChannelId(of as u16),
                revision: self.replicas[of].1.revision,
                digest: self.replicas[of].1.digest(),
                draw_us: 0,
                triangles: 0,
                draw_calls: 0,
                error_fraction: 0.0,
                draws_occluded: 0,
                is_trial: false,
                passes: polyptych_scene::PassTimes::default(),
            }),
            _ => return,
        };
        self.tell(Input::Status { from: session, status });
    }
}

fn wall() -> Wall {
    let name = |index: u16| format!("stub-{index}");
    let channel = |index: u16| {
        Channel::tile(&name(index), 0, UVec2::new(u32::from(index) * 64, 0), UVec2::splat(64))
    };
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
    let canvas = UVec2::new(u32::from(SERVERS) * 64, 64);
    let screens = vec![Screen::new("front", Surface::Plane(plane), canvas)];
    Wall::new("edits", screens, (0..SERVERS).map(channel).collect())
}

fn stage(base: &Scene) -> Stage {
    let mut stage = Stage {
        cluster: Cluster::new(wall(), Epoch(1)),
        now: 0,
        replicas: (0..SERVERS)
            .map(|of| (SessionId(u64::from(of) + 1), Replica::default()))
            .collect(),
        sent: 0,
        core: Duration::ZERO,
        encode: Duration::ZERO,
        edited: 0,
        remembered: None,
    };
    for of in 0..SERVERS {
        let adapter = Adapter { texture_side_max: 8192, ..Adapter::default() };
        let name = format!("stub-{of}");
        let hello = ServerHello { channels: vec![name.clone()], name, pid: 1, adapter };
        let session = SessionId(u64::from(of) + 1);
        stage.tell(Input::Server { session, hello, address: "127.0.0.1".into() });
        stage.settle();
    }
    let client = SessionId(100);
    stage.tell(Input::Client { session: client, name: "bench".into() });
    let summary = SceneSummary {
        name: base.name.clone(),
        revision: polyptych_protocol::ids::Revision(0),
        bounds: None,
        triangles: 0,
        features: SceneFeatures::default(),
        notes: Vec::new(),
        exposure: 1.0,
        clips: Vec::new(),
    };
    let scene = SceneRef { name: base.name.clone(), manifest: BlobHash::of(b"many") };
    let outline = Arc::new(SceneOutline::from(base));
    let imported = ImportedScene::of_file(scene, summary, outline);
    let job = polyptych_core::ClientRequest { client, id: RequestId(1) };
    stage.tell(Input::Import { job, imported: Ok(imported) });
    stage.settle();
    stage
}

fn manager(base: &Scene, moved: u64) -> Result<(), Failure> {
    let mut stage = stage(base);
    let client = SessionId(100);
    let (mut decode, mut core, mut encode, mut record, mut keep) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut sent = 0;
    for frame in 0..FRAMES as u64 {
        let edits = moves(base.nodes.len() as u64, moved, frame + 1, true);
        let transaction = Transaction { edits, ..Transaction::default() };
        let request = Request::Edit(transaction);
        let bytes = polyptych_codec::encode(&request);
        let request =
            timed(&mut decode, || polyptych_protocol::framing::decode::<Request>(&bytes))?;
        let input = Input::Request { client, id: RequestId(frame + 2), request };
        timed(&mut record, || polyptych_codec::encode(&input));
        (stage.core, stage.encode, stage.sent) = (Duration::ZERO, Duration::ZERO, 0);
        let before = stage.edited;
        stage.tell(input);
        stage.settle();
        let end = stage.now + 10_000_000;
        while stage.edited == before && stage.now < end {
            stage.now = stage.cluster.poll_timeout().unwrap_or(end).max(stage.now);
            stage.tell(Input::Timeout);
            stage.settle();
        }
        if stage.edited == before {
            return Err("the transaction was not seen".into());
        }
        core.push(stage.core);
        encode.push(stage.encode);
        sent = stage.sent;
        if let Some(memory) = stage.remembered.take() {
            timed(&mut keep, || BlobHash::of(&polyptych_codec::encode(&*memory)));
        }
    }
    say("manager: a transaction decoded", decode);
    say("manager: core, from the transaction to its answer", core);
    say("manager: commands encoded, once for all servers", encode);
    say("manager: the recording's copy of the transaction", record);
    say("state thread: what is remembered, encoded and hashed", keep);
    println!(
        "  {} bytes to each server, {:.1} for each node that moves",
        sent / u64::from(SERVERS),
        sent as f64 / f64::from(SERVERS) / moved as f64
    );
    Ok(())
}
