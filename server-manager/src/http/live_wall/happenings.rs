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
    texts.extend(begun(last, known).map(|warning| format!("warning: {warning}")));
    for client in known.clients.iter().filter(|client| !last.clients.contains(client)) {
        texts.push(format!("client {client} has joined"));
    }
    for client in last.clients.iter().filter(|client| !known.clients.contains(client)) {
        texts.push(format!("client {client} has left"));
    }
    texts
}

/// The warnings that have begun. One that ends while another of the same words begins goes on: only
/// its numbers, or the channel that it names, have changed.
fn begun<'a>(last: &Known, known: &'a Known) -> impl Iterator<Item = &'a String> {
    let ended = last.warnings.iter().filter(|warning| !known.warnings.contains(warning));
    let mut ended: Vec<Vec<&str>> = ended.map(|warning| words(warning, known)).collect();
    let new = known.warnings.iter().filter(move |warning| !last.warnings.contains(warning));
    new.filter(move |warning| {
        let now = words(warning, known);
        let before = ended.iter().position(|before| *before == now);
        before.map(|place| ended.swap_remove(place)).is_none()
    })
}

/// The words of a warning that stay the same while it lasts: without numbers and channel names.
fn words<'a>(warning: &'a str, known: &Known) -> Vec<&'a str> {
    let stays = |word: &&str| {
        let bare = word.trim_matches(|of: char| !of.is_alphanumeric());
        bare.parse::<f64>().is_err() && !known.channels.contains_key(bare)
    };
    warning.split(' ').filter(stays).collect()
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::feedback::{ChannelStatus, Skew};
    use polyptych_protocol::ids::{FrameId, Revision};

    use super::*;
    use crate::http::scene_pictures::tests::status;

    fn channel(name: &str) -> ChannelStatus {
        ChannelStatus {
            name: name.into(),
            state: ChannelState::Live,
            since_ms: 0,
            reason: None,
            pid: None,
            address: None,
            adapter: None,
            frame: FrameId(1),
            revision: Revision(1),
            late: 0,
            draw_us: None,
            skew: Skew::default(),
            memory_bytes: 0,
            scene_bytes: 0,
        }
    }

    /// The number of sentences that are told of these statuses, each with its warnings.
    fn told<const N: usize>(statuses: [&[&str]; N]) -> [usize; N] {
        let mut happenings = Happenings::default();
        happenings.of(&status(None));
        statuses.map(|warnings| {
            let warnings = warnings.iter().map(|&of| of.to_owned()).collect();
            let channels = ["left", "front-1-1"].map(channel).into();
            let texts = happenings.of(&WallStatus { warnings, channels, ..status(None) });
            texts.iter().filter(|text| text.starts_with("warning: ")).count()
        })
    }

    #[test]
    fn a_warning_is_told_once_until_it_ends() {
        let behind = ["0.5 s; a", "1.0 s; a", "1.5 s; a"]
            .map(|rest| format!("state file wall.state has not been written for {rest} change"));
        let [first, second, third] = behind.each_ref().map(String::as_str);
        assert_eq!(told([&[first], &[second], &[third], &[], &[first]]), [1, 0, 0, 0, 1]);
        let slow = ["left draws 40.1 ms", "front-1-1 draws 41 ms"]
            .map(|rest| format!("the rate bound of 60 is not kept: channel {rest} even so"));
        let [left, front] = slow.each_ref().map(String::as_str);
        assert_eq!(told([&[left], &[front], &[left], &[front]]), [1, 0, 0, 0]);
        // A second one of the same words is told beside the first.
        let [one, two] = ["device 1 is lost: silent", "device 2 is lost: silent"];
        assert_eq!(told([&[one], &[one, two], &[two], &[first, two]]), [1, 1, 0, 1]);
    }
}
