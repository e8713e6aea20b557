//! The camera follows a node: in the frame that moves it, on all channels, and after a restart.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DAffine3, DQuat, DVec3};
use polyptych_protocol::clip::ClipSummary;
use polyptych_protocol::follow::Follow;
use polyptych_protocol::transaction::Transaction;
use polyptych_scene::{
    AnimatedNode, AnimatedPath, Animations, Channel, Clip, Edit, FilePlace, Interpolation, NewNode,
    Node, NodeId, Scene,
};
use polyptych_wall::camera::Camera;

use super::editing::{DOOR, HOUSE, TREE, at, moving, outline};
use super::*;

fn follow(node: NodeId) -> Follow {
    let camera = Some(Camera { position: DVec3::Z * 2.0, ..Camera::IDENTITY });
    Follow { node, camera, is_turning: false, orbit_rad_per_s: 0.0 }
}

impl ClusterFixture {
    /// Answers the core's question for the places of nodes, as the file of the house has them.
    /// Returns these nodes.
    fn place_nodes(&mut self) -> Vec<NodeId> {
        let nodes = self.cluster.unplaced_nodes();
        let scene = self.cluster.shown.scene.as_ref().expect("a scene").manifest;
        let place = |node: &NodeId| (*node, FilePlace::still(at(10.0 + node.0 as f64)));
        let places = nodes.iter().map(place).collect();
        self.cluster.handle(self.now, Input::Places { scene, places: Ok(places) }).expect("told");
        self.read();
        nodes
    }

    fn fail_to_place(&mut self, reason: &str) {
        let scene = self.cluster.shown.scene.as_ref().expect("a scene").manifest;
        let places = Err(reason.to_owned());
        self.cluster.handle(self.now, Input::Places { scene, places }).expect("told");
        self.read();
    }

    fn follow(&mut self, follow: Follow) -> Result<(), String> {
        self.replies.clear();
        let id = self.request(Request::FollowNode(follow));
        self.place_nodes();
        let (of, reply) = self.replies.pop().expect("an answer");
        assert_eq!(of, id);
        reply.map(|reply| assert_eq!(reply, Response::Done)).map_err(|error| error.reason)
    }

    fn frame_at(&mut self, now: Micros) -> Camera {
        self.now = now;
        self.frames.clear();
        self.request(Request::RenderFrame { camera: None, time_s: None });
        let channels: Vec<u32> = (0..self.cluster.wall.channels.len() as u32).collect();
        self.draw(&channels, 0);
        let cameras: Vec<_> = self.frames.iter().map(|(_, of)| of.presentation.camera).collect();
        assert!(cameras.iter().all(|camera| *camera == cameras[0]));
        cameras[0]
    }
}

fn near(camera: Camera, position: DVec3) {
    assert!(camera.position.distance(position) < 1e-12, "{camera:?} is not at {position}");
}

#[test]
fn the_camera_moves_in_the_frame_that_moves_the_node_or_what_it_hangs_from() {
    let mut stage = ClusterFixture::with_house(2);
    let id = stage.request(Request::FollowNode(follow(DOOR)));
    assert!(stage.replies.iter().all(|(of, _)| *of != id), "its place is not known yet");
    assert_eq!(stage.place_nodes(), [DOOR, HOUSE]);
    assert!(stage.replies.iter().any(|(of, reply)| *of == id && reply.is_ok()));
    let door = |x: f64| DVec3::new(x, 0.0, 2.0);
    near(stage.frame_at(1_000_000), door(21.0));
    stage.clear();
    stage.edit(moving(HOUSE, 3.0));
    stage.prepare_all();
    let moved = stage.frames.last().expect("a frame for the change").1.clone();
    near(moved.presentation.camera, door(14.0));
    stage.draw(&[0, 1], 1_000);
    // Hung from another node of the file, whose place is asked for then.
    let mut transaction = Transaction::default();
    transaction.set_parent(DOOR, Some(TREE));
    stage.edit(transaction);
    stage.prepare_all();
    stage.draw(&[0, 1], 1_000);
    assert_eq!(stage.place_nodes(), [TREE]);
    near(stage.frame_at(3_000_000), door(23.0));
    assert!(stage.cluster.unplaced_nodes().is_empty());
}

#[test]
fn the_camera_moves_with_a_node_that_a_clip_moves_at_the_time_of_the_frame() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::OpenScene { path: "house.glb".into(), scene: None });
    let job = stage.imports.pop().expect("baked");
    let slide = ClipSummary { name: "slide".into(), duration_s: 2.0, is_played: true };
    let mut imported = ImportedScene { outline: outline(), ..ClusterFixture::imported() };
    imported.summary.clips = vec![slide];
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    stage.prepare_all();
    // Put elsewhere, it moves from there: the place of its file counts too.
    stage.edit(moving(HOUSE, 30.0));
    stage.prepare_all();
    stage.draw(&[0, 1], 0);
    stage.request(Request::FollowNode(follow(DOOR)));
    assert_eq!(stage.cluster.unplaced_nodes(), [DOOR, HOUSE]);
    let file = sliding_house();
    let place = |node| (node, FilePlace::of(&file, node).expect("of the file"));
    let places = Ok([DOOR, HOUSE].map(place).to_vec());
    let scene = stage.cluster.shown.scene.as_ref().expect("a scene").manifest;
    stage.cluster.handle(stage.now, Input::Places { scene, places }).expect("told");
    stage.read();
    for (time_s, slid) in [(0.0, 0.0), (1.5, 3.0), (0.5, 1.0), (2.5, 1.0)] {
        stage.frames.clear();
        stage.request(Request::RenderFrame { camera: None, time_s: Some(time_s) });
        stage.draw(&[0, 1], 0);
        let [one, other] = [0, 1].map(|at| stage.frames[at].1.presentation.camera);
        near(one, DVec3::new(31.0 + slid, 0.0, 2.0));
        assert_eq!(one, other, "all displays have the same camera");
    }
}

/// The file of a house that slides along X by 4 in 2 s, with its door 1 beside it.
fn sliding_house() -> Scene {
    let node = |parent, x| Node { parent, local: at(x), ..Node::default() };
    let rest =
        AnimatedNode { translation: DVec3::X * 10.0, scale: DVec3::ONE, ..AnimatedNode::default() };
    let slide = Channel {
        target: 0,
        path: AnimatedPath::Translation,
        interpolation: Interpolation::Linear,
        times: vec![0.0, 2.0],
        values: vec![10.0, 0.0, 0.0, 14.0, 0.0, 0.0],
    };
    let clip = Clip { name: "slide".into(), channels: vec![slide] };
    let animations = Animations { clips: vec![clip], nodes: vec![rest], ..Animations::default() };
    Scene { nodes: vec![node(None, 10.0), node(Some(0), 1.0)], animations, ..Scene::default() }
}

#[test]
fn it_turns_with_the_node_or_not_and_goes_around_it_in_scene_time() {
    let mut stage = ClusterFixture::with_house(1);
    let turned = DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, 3.0, -4.0),
        DQuat::from_rotation_y(FRAC_PI_2),
        DVec3::X * 5.0,
    );
    let mut transaction = Transaction::default();
    let made = transaction.create(NewNode { local: turned, ..NewNode::default() });
    assert!(matches!(transaction.edits[0], Edit::Create { node, .. } if node == made));
    stage.edit(transaction);
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    let made = NodeId(3);
    stage.follow(Follow { is_turning: true, ..follow(made) }).expect("followed");
    // Scale and mirroring do not count: a right-handed turn of its X and Y axes.
    near(stage.frame_at(2_000_000), DVec3::new(7.0, 0.0, 0.0));
    let level = stage.frame_at(2_500_000).rotation * DVec3::NEG_Z;
    assert!(level.distance(DVec3::NEG_X) < 1e-12, "{level}");
    let around = Follow { orbit_rad_per_s: PI / 2.0, ..follow(made) };
    stage.follow(around).expect("followed");
    near(stage.frame_at(4_000_000), DVec3::new(5.0, 0.0, 2.0));
    near(stage.frame_at(5_000_000), DVec3::new(7.0, 0.0, 0.0));
    near(stage.frame_at(6_000_000), DVec3::new(5.0, 0.0, -2.0));
    // After a pause it goes on where it was.
    stage.now = 31_000_000;
    stage.request(Request::Run(Pacing::Rate(1.0)));
    let (_, frame) = stage.frames.last().expect("a frame");
    near(frame.presentation.camera, DVec3::new(5.0, 0.0, -2.0));
    stage.draw(&[0], 0);
    stage.request(Request::Pause);
    // Another life goes on where it was.
    stage.request(Request::Status);
    let memory = stage.cluster.persistent_state();
    let mut next = ClusterFixture::empty(1);
    // The servers of the test are of this life.
    next.cluster = Cluster::restore(wall(1), Epoch(7), &memory);
    next.cluster.set_outline(Some(outline()));
    next.cluster.handle_client(CLIENT, "test".into());
    next.join(SessionId(0), 0).expect("joined");
    next.prepare_all();
    next.wait(10_000);
    next.draw(&[0], 1_000);
    near(next.frame_at(1_000_000), DVec3::new(5.0, 0.0, -2.0));
    near(next.frame_at(2_000_000), DVec3::new(3.0, 0.0, 0.0));
}

#[test]
fn after_a_restart_a_capture_waits_until_the_place_of_the_node_is_told() {
    let mut stage = ClusterFixture::with_house(1);
    stage.follow(follow(DOOR)).expect("followed");
    let memory = stage.cluster.persistent_state();
    let mut next = ClusterFixture::empty(1);
    next.cluster = Cluster::restore(wall(1), Epoch(7), &memory);
    next.cluster.set_outline(Some(outline()));
    next.cluster.handle_client(CLIENT, "test".into());
    next.join(SessionId(0), 0).expect("joined");
    next.prepare_all();
    next.wait(10_000);
    next.draw(&[0], 1_000);
    next.cluster.presentation.camera = Camera::IDENTITY;
    next.now = 1_000_000;
    next.frames.clear();
    next.request(Request::Capture { time_s: Some(1.5) });
    next.wait(10_000);
    assert!(next.frames.is_empty(), "the camera is not known yet");
    assert_eq!(next.place_nodes(), [DOOR, HOUSE]);
    next.wait(0);
    near(next.frames[0].1.presentation.camera, DVec3::new(21.0, 0.0, 2.0));
}

#[test]
fn one_without_a_place_of_its_own_keeps_the_present_one() {
    let mut stage = ClusterFixture::with_house(1);
    let camera = Camera { position: DVec3::new(1.0, 2.0, 3.0), scale: 0.5, ..Camera::IDENTITY };
    stage.request(Request::SetCamera(camera));
    stage.follow(Follow { camera: None, ..follow(TREE) }).expect("followed");
    near(stage.frame_at(1_000_000), camera.position);
    stage.edit(moving(TREE, 13.0));
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    let moved = stage.frame_at(2_000_000);
    near(moved, camera.position + DVec3::X);
    assert_eq!(moved.scale, 0.5);
}

#[test]
fn it_ends_with_the_node_with_the_scene_and_with_another_camera() {
    let followed = |stage: &ClusterFixture| stage.cluster.tour_status().following;
    let mut stage = ClusterFixture::with_house(1);
    stage.follow(follow(DOOR)).expect("followed");
    assert_eq!(followed(&stage), Some(DOOR));
    let before = stage.frame_at(1_000_000);
    let mut transaction = Transaction::default();
    transaction.remove(HOUSE);
    stage.edit(transaction);
    stage.prepare_all();
    stage.draw(&[0], 1_000);
    assert_eq!(stage.frame_at(2_000_000), before, "it stays");
    assert_eq!(followed(&stage), None);
    let refused = stage.request(Request::FollowNode(follow(DOOR)));
    let (of, reply) = stage.replies.pop().expect("an answer");
    assert_eq!(of, refused);
    assert!(reply.expect_err("gone").reason.contains("there is no node 1"));
    for end in 0..3 {
        stage.follow(follow(TREE)).expect("followed");
        match end {
            0 => drop(stage.request(Request::SetCamera(Camera::IDENTITY))),
            1 => drop(stage.request(Request::StopTour)),
            _ => stage.open_house(),
        }
        assert_eq!(followed(&stage), None, "end {end}");
        assert_eq!(stage.cluster.persistent_state().following, None);
    }
    // Whoever waits for its place is told of the end.
    let waits = stage.request(Request::FollowNode(follow(TREE)));
    stage.request(Request::SetCamera(Camera::IDENTITY));
    assert!(stage.replies.iter().any(|(of, reply)| *of == waits && reply.is_err()));
    let waits = stage.request(Request::FollowNode(follow(TREE)));
    stage.fail_to_place("no such blob");
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == waits).expect("an answer");
    assert_eq!(reply.as_ref().expect_err("not placed").reason, "no such blob");
    assert_eq!(followed(&stage), None);
}

#[test]
fn what_cannot_be_followed_is_refused() {
    let mut stage = ClusterFixture::with_house(1);
    let refused = |stage: &mut ClusterFixture, follow| {
        stage.request(Request::FollowNode(follow));
        let (_, reply) = stage.replies.pop().expect("an answer");
        reply.expect_err("refused").reason
    };
    let wrong = Follow { orbit_rad_per_s: f64::NAN, ..follow(TREE) };
    assert!(refused(&mut stage, wrong).contains("finite angle"));
    let bad = Camera { scale: 0.0, ..Camera::IDENTITY };
    assert!(refused(&mut stage, Follow { camera: Some(bad), ..follow(TREE) }).contains("scale"));
    assert!(refused(&mut stage, follow(NodeId(99))).contains("there is no node 99"));
    // Who would wait for what nobody knows is told so.
    stage.cluster.set_outline(None);
    assert!(refused(&mut stage, follow(TREE)).contains("open it again"));
    stage.request(Request::CloseScene);
    stage.prepare_all();
    assert!(refused(&mut stage, follow(TREE)).contains("no scene is open"));
}
