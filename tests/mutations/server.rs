//! The render server behind the decoder, but for its socket and its GPU: what a command or a
//! manifest that can be decoded meets next.

use std::time::Duration;

use polyptych_protocol::command::{Command, Frame, Prepare};
use polyptych_protocol::state_log::Replica;
use polyptych_render::clock::ClockEstimate;
use polyptych_render::frame_scheduler::{FrameAction, FrameScheduler};
use polyptych_render::frame_views;
use polyptych_renderer::SceneLayout;
use polyptych_scene::Scene;
use polyptych_wall::{ChannelId, Wall};

use crate::seeds::messages;

/// A server's state between its threads.
#[derive(Debug)]
pub struct Server {
    wall: Wall,
    now: u64,
    replica: Replica,
    playback: FrameScheduler,
    clock: ClockEstimate,
}

impl Server {
    /// One that has been sent nothing yet.
    pub fn new() -> Self {
        Self {
            wall: messages::wall(),
            now: 1_000_000,
            replica: Replica::default(),
            playback: FrameScheduler::default(),
            clock: ClockEstimate::default(),
        }
    }

    /// Handles a command as a render server does, but for drawing.
    pub fn obey(&mut self, command: Command) {
        self.now += 1000;
        match command {
            Command::Prepare(prepare) => self.prepare(prepare),
            Command::Frame(frame) => {
                self.draw(&frame);
                self.playback.handle_frame(Box::new(frame));
            }
            Command::Swap(swap) => drop(self.playback.handle_swap(swap, Some(self.now))),
            Command::Pong(pong) => {
                self.clock.add(&pong, self.now);
                let _ = self.clock.best(self.now);
            }
            Command::Goodbye(_) => self.playback.reset(),
        }
        while let Some(act) = self.playback.poll(Some(self.now)) {
            if let FrameAction::Draw { frame, .. } = act {
                drop(self.playback.frame_drawn(&frame, Duration::ZERO, Some(self.now)));
            }
        }
    }

    fn draw(&self, frame: &Frame) {
        let wall = self.replica.wall.as_deref().unwrap_or(&self.wall);
        for id in wall.channel_ids().chain([ChannelId(u16::MAX)]) {
            let Ok(views) = frame_views::views(wall, id, frame) else { continue };
            let Some(channel) = wall.channel(id) else { continue };
            for view in views {
                let Some([x, y, width, height]) = view.scissor else { continue };
                assert!(x + width <= channel.size.x && y + height <= channel.size.y);
            }
        }
    }

    fn prepare(&mut self, prepare: Prepare) {
        let mut replica = match prepare.base {
            Some(_) => self.replica.clone(),
            None => Replica::default(),
        };
        for operation in prepare.operations {
            replica.apply(operation);
        }
        if replica.wall.as_ref().and_then(|wall| wall.fault()).is_none() {
            let _ = replica.digest();
            self.replica = replica;
        }
    }
}

/// Handles a manifest as a server does before it asks for the blobs.
pub fn show(scene: &Scene) {
    if scene.fault().is_none() {
        let _ = frame_views::warm_up_camera(scene);
        let layout = SceneLayout::new(scene.clone(), &|| false);
        assert!(layout.is_ok(), "{layout:?}");
    }
}
