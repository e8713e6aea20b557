//! A wall of this machine that shows the scene to be measured.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use glam::DVec3;
use polyptych_client::{
    Bounds, Camera, ClientError, FrameFeedback, Image, NewNode, NodeId, QualityBounds,
    SceneSummary, Transaction, View,
};
use polyptych_manager::import::Baker;
use polyptych_wall::Wall;
use serde::Serialize;

use crate::simulator::ending::EndRequest;
use crate::simulator::faults::FaultHooks;
use crate::simulator::local_wall::{LocalWall, LocalWallOptions};
use crate::simulator::orbit;
use crate::simulator::verify::ReferenceScene;

/// Memory of the servers of a wall, in bytes.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Memory {
    /// Textures and meshes of the scene on the GPU.
    pub gpu_bytes: u64,
    /// Resident memory of the server's process.
    pub server_bytes: u64,
}

/// A running wall with an open scene; dropping it ends the processes.
#[derive(Debug)]
pub(super) struct Stage {
    local: LocalWall,
    wall: Wall,
    pub summary: SceneSummary,
    /// The part of the scene that the camera goes around.
    focus: Bounds,
}

impl Stage {
    /// Starts the wall and opens the scene.
    ///
    /// # Errors
    /// The reason why a process does not start or the scene cannot be opened;
    /// [`crate::simulator::ending::Ending`] if the user ended the run.
    pub fn open(wall: Wall, scene: &ReferenceScene, baker: &Baker) -> anyhow::Result<Self> {
        let local = LocalWall::start(LocalWallOptions {
            wall: wall.clone(),
            scene_roots: vec![scene.file.parent().unwrap_or(Path::new("/")).to_owned()],
            baker: baker.clone(),
            windows: false,
            http: None,
            recorder: None,
            culls_occluded: true,
            needs: FaultHooks::default(),
        })?;
        let opened = local.client.open_scene(scene.file.display().to_string());
        let summary = unless_ended(&local, opened)?;
        // A scene without anything to see is measured too.
        let nothing = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
        let focus = scene.focus.or(summary.bounds).unwrap_or(nothing);
        Ok(Self { local, wall, summary, focus })
    }

    /// Returns what tells that the user ended the run, which outlives the wall.
    pub fn end(&self) -> Arc<EndRequest> {
        Arc::clone(&self.local.end)
    }

    /// Returns the camera of the orbit at a scene time in seconds.
    pub fn camera_at(&self, time_s: f64) -> Camera {
        orbit::camera_at(&self.wall, &self.focus, time_s)
    }

    /// Returns a camera in a random place around or within the scene, which looks at a random point
    /// of it: eyes are at 0.2 to 5 times the distance of the orbit, each factor of two as likely.
    pub fn random_camera(&self, random: &mut fastrand::Rng) -> Camera {
        let mut between = |a: f64, b: f64| a + (b - a) * random.f64();
        let half = (self.focus.max - self.focus.min) * 0.5;
        let target = self.focus.center()
            + half * DVec3::new(between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0));
        let orbit = self.camera_at(0.0);
        let factor = 5_f64.powf(between(-1.0, 1.0));
        let distance =
            (orbit.world_from_display(self.wall.eye) - self.focus.center()).length() * factor;
        let (heading, height) = (between(0.0, TAU), between(-0.2, 1.0_f64));
        let across = (1.0 - height * height).sqrt();
        let outward = DVec3::new(heading.sin() * across, height, heading.cos() * across);
        let eye = target + outward * distance;
        let rotation = Camera::look_at(eye, target, DVec3::Y).rotation;
        // A unit of the display is as many of the world as the distance asks for, as in the orbit.
        let scale = orbit.scale * factor;
        Camera { position: eye - rotation * (scale * self.wall.eye), rotation, scale }
    }

    /// Adds a node that shows nothing to the scene.
    pub fn add_empty_node(&self) -> anyhow::Result<NodeId> {
        let mut adding = Transaction::default();
        adding.create(NewNode::default());
        let added = unless_ended(&self.local, self.local.client.commit(adding))?;
        added.created.first().copied().context("the manager has made no node")
    }

    /// Shows an empty node instead of the scene, from this camera: wherever a camera looks, it may
    /// see a dome of the scene.
    pub fn show_only(&self, empty: NodeId, camera: Camera) -> anyhow::Result<()> {
        self.set_views(vec![View { root: Some(empty.0), ..View::of_wall(camera) }])
    }

    /// Returns the picture of what this camera sees where the scene shows only an empty node.
    pub fn background(&self, camera: Camera, empty: NodeId) -> anyhow::Result<Image> {
        self.show_only(empty, camera)?;
        let picture = self.picture(camera)?;
        self.set_views(Vec::new())?;
        Ok(picture)
    }

    /// Returns the width and height of the screen in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.wall.screens.first().map_or([1, 1], |screen| screen.canvas.to_array())
    }

    /// Sets the maximum error of what is drawn, in pixels of this wall.
    pub fn set_error_bound(&self, bound_px: f64) -> anyhow::Result<()> {
        self.set_bounds(QualityBounds { error_px: bound_px, rate_fps: None })
    }

    /// Sets the maximum error and the minimum rate.
    pub fn set_bounds(&self, bounds: QualityBounds) -> anyhow::Result<()> {
        unless_ended(&self.local, self.local.client.set_bounds(bounds))
    }

    /// Sets the views over the wall's own camera.
    pub fn set_views(&self, views: Vec<View>) -> anyhow::Result<()> {
        unless_ended(&self.local, self.local.client.set_views(views))
    }

    /// Draws a frame on all channels.
    ///
    /// # Errors
    /// The channel that did not draw it; `Ending` if the user ended the run.
    pub fn draw(&self, camera: Camera, time_s: f64) -> anyhow::Result<FrameFeedback> {
        let drawn = self.local.client.render_frame_at(Some(camera), Some(time_s));
        let feedback = unless_ended(&self.local, drawn)?;
        if let Some(channel) = feedback.missing_channels().next() {
            let reason = channel.reason.as_deref().unwrap_or("no reason is known");
            bail!("channel {} did not draw a frame: {reason}", channel.name);
        }
        Ok(feedback)
    }

    /// Draws a frame and returns its picture of the whole screen.
    pub fn picture(&self, camera: Camera) -> anyhow::Result<Image> {
        self.draw(camera, 0.0)?;
        // At the same time, or what moves is compared at two.
        let mut capture = unless_ended(&self.local, self.local.client.capture_at(Some(0.0)))?;
        if let Some((channel, reason)) = capture.missing.first() {
            bail!("channel {channel} has no picture: {reason}");
        }
        capture.screens.pop().context("the capture has no picture of the screen")
    }

    /// Returns the name of what draws.
    pub fn adapter(&self) -> anyhow::Result<String> {
        let status = unless_ended(&self.local, self.local.client.status())?;
        let adapter = status.channels.into_iter().find_map(|channel| channel.adapter);
        Ok(adapter.unwrap_or_else(|| "unknown".into()))
    }

    /// Returns the memory that the server takes now.
    pub fn memory(&self) -> anyhow::Result<Memory> {
        let status = unless_ended(&self.local, self.local.client.status())?;
        // All channels are those of one server, and each reports its whole process.
        let largest = |of: fn(&polyptych_client::ChannelStatus) -> u64| {
            status.channels.iter().map(of).max().unwrap_or(0)
        };
        let gpu_bytes = largest(|channel| channel.scene_bytes);
        Ok(Memory { gpu_bytes, server_bytes: largest(|channel| channel.memory_bytes) })
    }
}

/// Returns a result, or why the user ended the run: what failed then failed for that reason.
fn unless_ended<T>(local: &LocalWall, result: Result<T, ClientError>) -> anyhow::Result<T> {
    match local.end.ending() {
        Some(ending) => Err(ending.into()),
        None => Ok(result?),
    }
}
