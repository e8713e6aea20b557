//! Tunings of a wall whose file was edited, and the part of them that is still valid.
//!
//! Each key of a channel is merged from three values: the old file's, the tuned one and the new
//! file's. A tuned key stays unless the new file sets that key otherwise, or what it was measured
//! in has changed.

use super::keys::{KEYS, Key, differing_keys};
use super::{differs_only_by_calibration, reapply};
use crate::{Channel, ChannelCalibration, Ramps, Wall};

/// The outcome for the tunings of a wall.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CarriedOver {
    /// The tunings that are valid on the new wall, by channel; [`reapply`] accepts them.
    pub tunings: Vec<(String, ChannelCalibration)>,
    /// The tunings that are not.
    pub dropped: Vec<DroppedTuning>,
    /// Channels that have another name now: old and new name. Their tunings were kept.
    pub renamed: Vec<(String, String)>,
}

/// A tuning that is not valid any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DroppedTuning {
    /// The name of the channel, as it was when it was tuned.
    pub channel: String,
    /// The keys that are lost, as commands call them: `pin, gain`.
    pub keys: String,
    /// The reason why they are not valid.
    pub reason: String,
}

/// Returns what of these tunings of the old wall is valid on the new one. A tuning whose channel
/// the old wall does not have is valid if the new one's has the same orientation and files.
pub fn carried_over(
    old: &Wall,
    tunings: &[(String, ChannelCalibration)],
    new: &Wall,
) -> CarriedOver {
    let mut result = CarriedOver { renamed: renamed(old, new), ..CarriedOver::default() };
    for (name, tuned) in tunings {
        let new_name = result.renamed.iter().find(|(old, _)| old == name).map(|(_, new)| new);
        let new_name = new_name.unwrap_or(name).clone();
        let mut drop = |keys: &[&str], reason: String| {
            let (channel, keys) = (name.clone(), keys.join(", "));
            result.dropped.push(DroppedTuning { channel, keys, reason });
        };
        let Some((_, channel)) = new.channel_by_name(&new_name) else {
            drop(&tuned_keys(old, name, tuned), "the wall has no such channel any more".into());
            continue;
        };
        let merged = match old.channel_by_name(name) {
            Some((_, before)) => {
                let (merged, lost) = merged(old, before, tuned, new, channel);
                for (keys, reason) in lost {
                    drop(&keys, reason);
                }
                merged
            }
            None if differs_only_by_calibration(&channel.adjustment, tuned) => tuned.clone(),
            None => {
                let reason = "the wall file describes the channel otherwise".to_owned();
                drop(&tuned_keys(old, name, tuned), reason);
                continue;
            }
        };
        if merged == channel.adjustment {
            continue;
        }
        result.tunings.push((new_name, merged));
        if let Err(reason) = reapply(new, &result.tunings) {
            drop(&tuned_keys(old, name, tuned), reason);
            result.tunings.pop();
        }
    }
    result
}

/// Keys of one channel that were lost, with the reason.
type Lost = Vec<(Vec<&'static str>, String)>;

/// Returns the new file's adjustment with the tuned keys that are still valid.
fn merged(
    old: &Wall,
    before: &Channel,
    tuned: &ChannelCalibration,
    new: &Wall,
    now: &Channel,
) -> (ChannelCalibration, Lost) {
    let mut merged = now.adjustment.clone();
    let (mut edited, mut faded, mut moved) = (Vec::new(), Vec::new(), Vec::new());
    let moved_reason = change_of_picture(old, before, new, now);
    for Key { name, is_in_pixels, is_same, copy } in KEYS {
        let is_tuned = !is_same(tuned, &before.adjustment);
        if !is_tuned || is_same(tuned, &now.adjustment) {
            // Not tuned, or the wall file says it now.
        } else if !is_same(&before.adjustment, &now.adjustment) {
            edited.push(*name);
        } else if name.starts_with("edge.") && now.adjustment.ramps == Ramps::Alpha {
            faded.push(*name);
        } else if *is_in_pixels && moved_reason.is_some() {
            moved.push(*name);
        } else {
            copy(tuned, &mut merged);
        }
    }
    let mut lost = Lost::new();
    if !edited.is_empty() {
        lost.push((edited, "the wall file gives another value now".to_owned()));
    }
    if !faded.is_empty() {
        lost.push((faded, "the channel's alpha file says how its light fades now".to_owned()));
    }
    if let Some(reason) = moved_reason.filter(|_| !moved.is_empty()) {
        lost.push((moved, reason));
    }
    (merged, lost)
}

/// Returns the names of the keys that were tuned; of a channel that the old wall does not have, of
/// those that are not the default.
fn tuned_keys(old: &Wall, name: &str, tuned: &ChannelCalibration) -> Vec<&'static str> {
    let before = old.channel_by_name(name);
    let before =
        before.map_or_else(ChannelCalibration::default, |(_, channel)| channel.adjustment.clone());
    differing_keys(tuned, &before)
}

/// Returns why pixels of a channel's upright picture mean something else than before, if they do.
fn change_of_picture(old: &Wall, before: &Channel, new: &Wall, now: &Channel) -> Option<String> {
    let (a, b) = (&before.adjustment, &now.adjustment);
    if before.size != now.size {
        let ([w, h], [x, y]) = (before.size.to_array(), now.size.to_array());
        return Some(format!("the channel has {x} × {y} pixels now, and had {w} × {h}"));
    }
    if (a.turn, a.mirror, a.packing) != (b.turn, b.mirror, b.packing) {
        return Some("the channel's turn, mirror or stereo has changed".to_owned());
    }
    if before.cover != now.cover {
        return Some("the channel's projector has changed".to_owned());
    }
    let is_same_warp =
        a.warp.is_some() == b.warp.is_some() && old.content_of(a.warp) == new.content_of(b.warp);
    (!is_same_warp).then(|| "the channel's warp file has changed".to_owned())
}

/// Returns channels of which only the name (and server) has changed: old and new name. Only
/// unambiguous ones.
fn renamed(old: &Wall, new: &Wall) -> Vec<(String, String)> {
    let missing_in = |wall: &Wall, of: &Wall| -> Vec<Channel> {
        let is_missing = |channel: &&Channel| wall.channel_by_name(&channel.name).is_none();
        of.channels.iter().filter(is_missing).cloned().collect()
    };
    let (gone, added) = (missing_in(new, old), missing_in(old, new));
    let is_it = |gone: &Channel, added: &Channel| is_same_channel(old, gone, new, added);
    let mut renamed = Vec::new();
    for one in &gone {
        let mut matches = added.iter().filter(|other| is_it(one, other));
        let (Some(other), None) = (matches.next(), matches.next()) else { continue };
        if gone.iter().filter(|gone| is_it(gone, other)).count() == 1 {
            renamed.push((one.name.clone(), other.name.clone()));
        }
    }
    renamed
}

/// Returns whether two channels are the same in all but name, server and index.
fn is_same_channel(old: &Wall, one: &Channel, new: &Wall, two: &Channel) -> bool {
    let (a, b) = (&one.adjustment, &two.adjustment);
    let is_same_file = |a: Option<u16>, b: Option<u16>| {
        a.is_some() == b.is_some() && old.content_of(a) == new.content_of(b)
    };
    old.has_same_screen(one.screen, new, two.screen)
        && (one.origin, one.size, one.projection) == (two.origin, two.size, two.projection)
        && one.cover == two.cover
        && is_same_file(a.warp, b.warp)
        && is_same_file(a.alpha, b.alpha)
        && is_same_file(a.beta, b.beta)
        && ChannelCalibration { warp: None, alpha: None, beta: None, ..a.clone() }
            == ChannelCalibration { warp: None, alpha: None, beta: None, ..b.clone() }
}
