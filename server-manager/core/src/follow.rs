//! The camera as it follows a node: a function of where the node is in a frame, and of scene time.
//! Clips move it as they move the node.
//!
//! ```text
//! asked --places of the file are known--> moves with every frame --the node is gone--> over
//! ```
//!
//! The core knows what was edited, but not where the scene's file has its nodes: it names those
//! whose places it needs ([`Cluster::unplaced_nodes`]), and is told.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::follow::Follow;
use polyptych_protocol::request::{RequestError, Response};
use polyptych_scene::{FilePlace, NodeId};
use polyptych_wall::camera::Camera;
use serde::{Deserialize, Serialize};

use super::frame_request::FrameRequest;
use super::navigate::REMEMBER_WAIT;
use super::presentation::checked_camera;
use super::tours::TourClock;
use super::{ClientRequest, Cluster, Micros};

/// A node that is followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FollowedNode {
    /// Which, and how; its camera is known once its place is.
    pub follow: Follow,
    /// The relation of the time that it is followed to scene time.
    pub clock: TourClock,
}

/// A node that is followed in this life of the manager.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Following {
    node: FollowedNode,
    /// The places of nodes in the scene's file.
    places: BTreeMap<NodeId, FilePlace>,
    /// Who waits until the place is known.
    waiter: Option<ClientRequest>,
}

/// The place of a node, as far as it is known.
enum NodePlace {
    /// World space from its space.
    Known(DAffine3),
    /// It needs what the file says of these.
    Unknown(Vec<NodeId>),
    /// There is no such node any more.
    Gone,
}

/// The turn of a matrix: its axes made perpendicular, X first.
fn rotation_of(linear: DMat3) -> DQuat {
    let x = linear.x_axis.try_normalize().unwrap_or(DVec3::X);
    let y = linear.y_axis - x * x.dot(linear.y_axis);
    let y = y.try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize()
}

impl FollowedNode {
    /// The axes along which the camera stands, from those of the world, at this time.
    fn axes(&self, world: &DAffine3, time_s: f64) -> DQuat {
        let angle = self.follow.orbit_rad_per_s * time_s;
        let angle = if angle.is_finite() { angle % std::f64::consts::TAU } else { 0.0 };
        let own = if self.follow.is_turning { rotation_of(world.matrix3) } else { DQuat::IDENTITY };
        own * DQuat::from_rotation_y(angle)
    }

    /// The camera where the node stands here. One that has no place yet keeps this one.
    fn camera_at(&mut self, world: &DAffine3, time_s: f64, now: Camera) -> Camera {
        let (origin, axes) = (world.translation, self.axes(world, time_s));
        let kept = || Camera {
            position: axes.inverse() * (now.position - origin),
            rotation: (axes.inverse() * now.rotation).normalize(),
            scale: now.scale,
        };
        let Camera { position, rotation, scale } = *self.follow.camera.get_or_insert_with(kept);
        let position = origin + axes * position;
        let camera = Camera { position, rotation: (axes * rotation).normalize(), scale };
        if camera.fault().is_none() { camera } else { now }
    }
}

impl Cluster {
    /// Does what [`Request::FollowNode`](polyptych_protocol::request::Request) asks.
    ///
    /// # Errors
    /// The fault, and what would be right.
    pub(super) fn follow(
        &mut self,
        job: ClientRequest,
        mut follow: Follow,
    ) -> Result<Option<Response>, String> {
        follow.camera = follow.camera.map(checked_camera).transpose()?;
        if !follow.orbit_rad_per_s.is_finite() {
            let speed = follow.orbit_rad_per_s;
            return Err(format!("a camera goes around by a finite angle a second, not {speed}"));
        }
        if self.shown.scene.is_none() {
            return Err("no scene is open; open one first".to_owned());
        }
        if self.editing.outline().is_none() {
            return Err(
                "what the open scene holds is not known after a restart; open it again".to_owned()
            );
        }
        if matches!(self.place_of(follow.node, &BTreeMap::new()), NodePlace::Gone) {
            return Err(format!("there is no {}; it was removed, or never made", follow.node));
        }
        self.end_motion();
        let node = FollowedNode { follow, clock: TourClock::Waiting { at_s: 0.0 } };
        self.following = Some(Following { node, places: BTreeMap::new(), waiter: Some(job) });
        self.settle_following();
        Ok(None)
    }

    /// Ends whatever moves the camera.
    pub(super) fn end_motion(&mut self) {
        self.tour = None;
        if let Some(job) = self.following.take().and_then(|of| of.waiter) {
            let reason = "the camera was given another way meanwhile";
            self.reply_if_there(job, Err(RequestError::new(reason)));
        }
    }

    /// Those nodes of the scene's file whose place in it must be [told](Cluster::handle_places).
    pub fn unplaced_nodes(&self) -> Vec<NodeId> {
        let Some(following) = &self.following else { return Vec::new() };
        match self.place_of(following.node.follow.node, &following.places) {
            NodePlace::Unknown(nodes) => nodes,
            NodePlace::Known(_) | NodePlace::Gone => Vec::new(),
        }
    }

    /// Returns whether the next frame is for pictures or of a stated time, and the place of the
    /// node that it follows is yet to be told: after a restart, and where the node was hung from
    /// another. The place is told soon, or the following ends.
    pub(super) fn awaits_place(&self) -> bool {
        let order = self.orders.front().filter(|order| !order.is_preview);
        let is_exact = order.is_some_and(|of| of.time_s.is_some() || of.capture.is_some());
        let is_followed = self.following.as_ref().is_some_and(|of| of.waiter.is_none());
        is_exact && is_followed && self.shown.scene.is_some() && !self.unplaced_nodes().is_empty()
    }

    /// The file of this scene has its nodes here, each in its parent's space; or it cannot be read.
    pub(super) fn handle_places(
        &mut self,
        scene: BlobHash,
        places: Result<Vec<(NodeId, FilePlace)>, String>,
    ) {
        if self.shown.scene.as_ref().is_none_or(|shown| shown.manifest != scene) {
            return;
        }
        let Some(following) = &mut self.following else { return };
        match places {
            Ok(places) => following.places.extend(places),
            Err(reason) => {
                let (node, waiter) = (following.node.follow.node, following.waiter);
                self.following = None;
                tracing::warn!(%node, reason, "the node is not followed: its place is not known");
                if let Some(job) = waiter {
                    self.reply_if_there(job, Err(RequestError::new(reason)));
                }
                return self.persist();
            }
        }
        self.settle_following();
    }

    /// Answers who waits for the place of a node, where it is known now.
    fn settle_following(&mut self) {
        let Some(Following { node, places, waiter: Some(job) }) = &self.following else { return };
        let (job, place) = (*job, self.place_of(node.follow.node, places));
        let reply = match place {
            NodePlace::Unknown(_) => return,
            NodePlace::Known(world) => {
                let now = self.presentation.camera;
                if let Some(Following { node, waiter, .. }) = &mut self.following {
                    *waiter = None;
                    self.presentation.camera = node.camera_at(&world, 0.0, now);
                }
                Ok(Response::Done)
            }
            NodePlace::Gone => {
                self.following = None;
                Err(RequestError::new("the node was removed meanwhile"))
            }
        };
        self.persist();
        self.reply_if_there(job, reply);
    }

    fn reply_if_there(&mut self, job: ClientRequest, reply: Result<Response, RequestError>) {
        if self.clients.contains_key(&job.client) {
            self.reply(job, reply);
        }
    }

    /// Moves the camera to where the followed node has it in the frame that begins.
    pub(super) fn follow_node(&mut self, order: Option<&FrameRequest>, time_s: f64, now: Micros) {
        let Some(Following { node, places, waiter: None }) = &self.following else { return };
        let world = match self.place_of(node.follow.node, places) {
            NodePlace::Known(world) => world,
            NodePlace::Unknown(_) => return,
            NodePlace::Gone => {
                tracing::info!(node = %node.follow.node, "the node that was followed is gone");
                self.following = None;
                self.navigator.remember_at.get_or_insert(now + REMEMBER_WAIT);
                return;
            }
        };
        let is_timed = self.is_timed(order);
        let is_given = order.is_some_and(|order| order.time_s.is_some());
        let camera = self.presentation.camera;
        let Some(Following { node, .. }) = &mut self.following else { return };
        let is_first = is_timed && node.clock.advance(is_given, time_s);
        let followed_s = node.clock.at_s();
        self.presentation.camera = node.camera_at(&world, followed_s, camera);
        if is_first {
            self.persist();
        }
    }

    /// Lets the camera go on around the followed node after a pause.
    pub(super) fn resume_following(&mut self) {
        let own_s = self.pacer.own_s;
        if let Some(Following { node, .. }) = &mut self.following {
            node.clock = node.clock.remembered(own_s);
        }
    }

    /// The followed node as another life of the manager goes on with it, whose scene time begins
    /// anew.
    pub(super) fn remembered_following(&self) -> Option<FollowedNode> {
        let mut node = self.following.as_ref()?.node.clone();
        node.clock = node.clock.remembered(self.pacer.own_s);
        Some(node)
    }

    /// Takes over the followed node of another life of the manager.
    pub(super) fn restore_following(&mut self, remembered: Option<&FollowedNode>) {
        let Some(node) = remembered else { return };
        let fault = node.follow.camera.and_then(|camera| camera.fault());
        if fault.is_some() || !node.clock.is_finite() || !node.follow.orbit_rad_per_s.is_finite() {
            tracing::warn!(
                "the followed node in the state file was dropped: its numbers are wrong"
            );
            return;
        }
        let node = node.clone();
        self.following = Some(Following { node, places: BTreeMap::new(), waiter: None });
    }

    /// The node that is followed.
    pub(super) fn followed(&self) -> Option<NodeId> {
        self.following.as_ref().map(|following| following.node.follow.node)
    }

    /// World space from the space of a node, in the state that frames name, as clips move it now.
    fn place_of(&self, node: NodeId, places: &BTreeMap<NodeId, FilePlace>) -> NodePlace {
        let (edits, mut unknown) = (&self.shown.edits, Vec::new());
        // A manager that has only begun may not know the scene yet.
        let Some(outline) = self.editing.outline() else { return NodePlace::Unknown(Vec::new()) };
        let Some(way) = outline.way_up(edits, node) else { return NodePlace::Gone };
        let clips = self.clips.times();
        let mut world = DAffine3::IDENTITY;
        for node in way {
            let edited = edits.node(node);
            let put = edited.and_then(|of| of.local);
            let made = edited.and_then(|of| of.created.as_ref()).map(|made| made.local);
            let known = match places.get(&node) {
                Some(place) => Some(place.local(put, &clips)),
                // Where nothing moves by itself, what a node was put to is all that counts.
                None => put.filter(|_| made.is_some() || self.clips.is_empty()).or(made),
            };
            match known {
                Some(local) => world = local * world,
                None => unknown.push(node),
            }
        }
        if unknown.is_empty() { NodePlace::Known(world) } else { NodePlace::Unknown(unknown) }
    }
}
