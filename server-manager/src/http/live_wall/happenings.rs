//! Happenings on the wall, in words: the differences between one status and the next.

use std::collections::BTreeMap;

use polyptych_protocol::feedback::{ChannelState, WallStatus};
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;

/// The facts of the last status.
#[derive(Debug, Default)]
pub(super) struct Happenings {
    last: Option<Known>,
}

#[derive(Debug, PartialEq)]
struct Known {
    epoch: u64,
    scene: Option<String>,
    channels: BTreeMap<String, ChannelState>,
    warnings: Vec<String>,
    clients: Vec<String>,
    opening: Vec<String>,
    output_mode: OutputMode,
    pattern: Option<&'static str>,
}

impl Happenings {
    /// Returns what has changed since the last status, a sentence each; of the first one nothing.
    pub fn of(&mut self, status: &WallStatus) -> Vec<String> {
        let shown = &status.presentation;
        let known = Known {
            epoch: status.epoch.0,
            scene: status.scene.clone(),
            channels: status.channels.iter().map(|of| (of.name.clone(), of.state)).collect(),
            warnings: status.warnings.clone(),
            clients: status.clients.clone(),
            opening: status.opening.iter().map(|of| of.scene.clone()).collect(),
            output_mode: shown.output_mode,
            pattern: shown.pattern.map(TestPattern::name),
        };
        let texts = match &self.last {
            Some(last) if last.epoch == known.epoch => differences(last, &known, status),
            _ => Vec::new(),
        };
        self.last = Some(known);
        texts
    }
}

fn differences(last: &Known, known: &Known, status: &WallStatus) -> Vec<String> {
    let mut texts = Vec::new();
    for channel in &status.channels {
        if last.channels.get(&channel.name) != Some(&channel.state) {
            let reason = channel.reason.as_ref().map_or(String::new(), |of| format!(": {of}"));
            texts.push(format!("channel {} is {}{reason}", channel.name, channel.state));
        }
    }
    for scene in known.opening.iter().filter(|scene| !last.opening.contains(scene)) {
        texts.push(format!("scene {scene} is being opened"));
    }
    if known.scene != last.scene {
        texts.push(match &known.scene {
            Some(scene) => format!("scene {scene} is shown"),
            None => "no scene is shown".into(),
        });
    }
    if known.output_mode != last.output_mode {
        texts.push(format!("displays are in mode {}", known.output_mode.name()));
    }
    if known.pattern != last.pattern {
        texts.push(match known.pattern {
            Some(pattern) => format!("channels draw the pattern {pattern}"),
            None => "channels draw the scene".into(),
        });
    }
    for warning in known.warnings.iter().filter(|warning| !last.warnings.contains(warning)) {
        texts.push(format!("warning: {warning}"));
    }
    for client in known.clients.iter().filter(|client| !last.clients.contains(client)) {
        texts.push(format!("client {client} has joined"));
    }
    for client in last.clients.iter().filter(|client| !known.clients.contains(client)) {
        texts.push(format!("client {client} has left"));
    }
    texts
}
