//! The one log: operations, and the state that is their fold.
//!
//! Manager and servers fold with this same code; what they folded is compared by digest.

use std::sync::Arc;

use glam::DVec2;
use polyptych_files::blob::BlobHash;
use polyptych_scene::residency::SeenFrom;
use polyptych_scene::{Edit, LightEffects, SceneEdits};
use polyptych_wall::{ChannelCalibration, ChannelId, Wall};
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::ids::{Digest, Revision};
use crate::limits::MESSAGE_BYTES_MAX;

/// A change of the replicated state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Operation {
    /// The wall is now this.
    SetWall(Box<Wall>),
    /// A channel is adjusted in another way.
    Adjust {
        /// Its index in the wall.
        channel: ChannelId,
        /// All of its adjustment.
        adjustment: Box<ChannelCalibration>,
    },
    /// Points of a channel's bend are moved.
    MoveBend {
        /// The channel's index in the wall.
        channel: ChannelId,
        /// The index of each point, row by row, and by how many pixels it is moved from where it
        /// would be without a bend; x right, y down.
        moves: Vec<(u32, DVec2)>,
    },
    /// The wall shows this scene.
    OpenScene(SceneRef),
    /// The wall shows no scene.
    CloseScene,
    /// The open scene is changed, by all of these.
    EditScene(Arc<Vec<Edit>>),
    /// All that was changed of the open scene is this.
    SetEdits(Box<SceneEdits>),
    /// Scenes are surrounded by this, or by their own sky if `None`.
    SetEnvironment(Option<Environment>),
    /// The open scene is seen from these places, which decide what servers hold of it where all is
    /// more than their budget.
    SetSeenFrom(Vec<SeenFrom>),
    /// Frames have these effects.
    SetEffects(LightEffects),
}

/// Maximum size of a wall's description, in encoded bytes: it travels in one message, beside a
/// scene's name.
const WALL_BYTES_MAX: usize = MESSAGE_BYTES_MAX / 2;

/// Checks that a wall's description fits into a message.
///
/// # Errors
/// Its size, the maximum and the remedy.
pub fn check_wall_size(wall: &Wall) -> Result<(), String> {
    // Without its bends, whose points take 16 bytes each, a wall is encoded fast.
    let mut bare = wall.clone();
    let bends = bare.channels.iter_mut().filter_map(|channel| channel.adjustment.bend.take());
    let points: usize = bends.map(|bend| bend.moves.len()).sum();
    let bytes = polyptych_codec::encode(&bare).len() + points * size_of::<DVec2>();
    if bytes > WALL_BYTES_MAX {
        return Err(format!(
            "the wall's description takes {bytes} bytes, where {WALL_BYTES_MAX} can be; bends with \
             fewer points would fit"
        ));
    }
    Ok(())
}

/// A baked scene, by the hash of its manifest, which names all the rest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneRef {
    /// The scene's name.
    pub name: String,
    /// A [`polyptych_scene::Scene`], encoded.
    pub manifest: BlobHash,
}

/// The state that manager and servers hold alike: the fold of the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Replica {
    /// Operations applied so far.
    pub revision: Revision,
    /// The wall, once the first operation has set it.
    pub wall: Option<Box<Wall>>,
    /// The open scene.
    pub scene: Option<SceneRef>,
    /// The edits of the scene since it was opened.
    pub edits: SceneEdits,
    /// The surroundings of scenes, if not their own sky.
    #[serde(default)]
    pub environment: Option<Environment>,
    /// The effects that frames have, or will have from the next one on.
    #[serde(default)]
    pub effects: LightEffects,
    /// The places that the open scene is seen from, as far as servers need them; none after it was
    /// opened.
    #[serde(default)]
    pub seen_from: Vec<SeenFrom>,
    /// Fingerprints of the parts.
    parts: Parts,
}

/// Fingerprints of the parts of a [`Replica`], kept so that a change costs what it changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Parts {
    /// The fingerprint of the wall without its channels' adjustments.
    wall: u64,
    /// The fingerprint of each channel's adjustment.
    adjustments: Vec<u64>,
}

/// The fingerprint of a part of a kind.
fn part(kind: u8, bytes: &[u8]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&[kind]).update(bytes);
    let hash = hasher.finalize();
    hash.as_bytes().iter().take(8).fold(0u64, |sum, &byte| (sum << 8) | u64::from(byte))
}

fn part_of_adjustment(index: usize, adjustment: &ChannelCalibration) -> u64 {
    part(4, &polyptych_codec::encode(&(index as u64, adjustment)))
}

impl Parts {
    fn of(wall: &Wall) -> Self {
        let adjustments = wall.channels.iter().map(|channel| &channel.adjustment).enumerate();
        let adjustments = adjustments.map(|(index, of)| part_of_adjustment(index, of)).collect();
        let mut bare = wall.clone();
        for channel in &mut bare.channels {
            channel.adjustment = ChannelCalibration::default();
        }
        Self { wall: part(1, &polyptych_codec::encode(&bare)), adjustments }
    }
}

impl Replica {
    /// Applies the next operation.
    pub fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::SetWall(wall) => {
                self.parts = Parts::of(&wall);
                self.wall = Some(wall);
            }
            Operation::Adjust { channel, adjustment } => {
                self.adjust(channel, |of| *of = *adjustment);
            }
            Operation::MoveBend { channel, moves } => self.adjust(channel, |of| {
                let Some(bend) = &mut of.bend else { return };
                let present = bend.moves.make_mut();
                for (index, to) in moves {
                    if let Some(point) = present.get_mut(index as usize) {
                        *point = to;
                    }
                }
            }),
            Operation::OpenScene(scene) => {
                (self.scene, self.edits) = (Some(scene), SceneEdits::default());
                self.seen_from.clear();
            }
            Operation::CloseScene => {
                (self.scene, self.edits) = (None, SceneEdits::default());
                self.seen_from.clear();
            }
            Operation::EditScene(edits) => {
                for edit in Arc::unwrap_or_clone(edits) {
                    self.edits.apply(edit);
                }
            }
            Operation::SetEdits(edits) => self.edits = *edits,
            Operation::SetEnvironment(environment) => self.environment = environment,
            Operation::SetSeenFrom(places) => self.seen_from = places,
            Operation::SetEffects(effects) => self.effects = effects,
        }
        self.revision.0 += 1;
    }

    /// The state after an edit of the scene of which it is known what it comes to.
    #[must_use]
    pub fn with_edits(&self, edits: SceneEdits) -> Self {
        let revision = Revision(self.revision.0 + 1);
        Self { revision, edits, ..self.clone() }
    }

    /// Changes a channel's adjustment. What a wall does not have is left alone: the digest tells.
    fn adjust(&mut self, channel: ChannelId, change: impl FnOnce(&mut ChannelCalibration)) {
        let index = usize::from(channel.0);
        let channel = self.wall.as_mut().and_then(|wall| wall.channels.get_mut(index));
        if let (Some(channel), Some(part)) = (channel, self.parts.adjustments.get_mut(index)) {
            change(&mut channel.adjustment);
            *part = part_of_adjustment(index, &channel.adjustment);
        }
    }

    /// The shortest list of operations that folds to this state.
    pub fn snapshot(&self) -> Vec<Operation> {
        let wall = self.wall.clone().map(Operation::SetWall);
        let scene = self.scene.clone().map(Operation::OpenScene);
        let edits =
            (!self.edits.is_empty()).then(|| Operation::SetEdits(self.edits.clone().into()));
        let environment = self.environment.clone();
        let environment = environment.map(|of| Operation::SetEnvironment(Some(of)));
        let places = &self.seen_from;
        let seen_from = (!places.is_empty()).then(|| Operation::SetSeenFrom(places.clone()));
        let scene = scene.into_iter().chain(edits).chain(seen_from);
        let has_effects = self.effects != LightEffects::default();
        let effects = has_effects.then_some(Operation::SetEffects(self.effects));
        wall.into_iter().chain(scene).chain(environment).chain(effects).collect()
    }

    /// The state that a snapshot of this revision folds to.
    pub fn from_snapshot(revision: Revision, operations: Vec<Operation>) -> Self {
        let mut replica = Self::default();
        for operation in operations {
            replica.apply(operation);
        }
        replica.revision = revision;
        replica
    }

    /// A fingerprint of the state, revision included: a sum over its parts, so that one part can
    /// change without a recount of the others.
    pub fn digest(&self) -> Digest {
        let of_adjustments = self.parts.adjustments.iter();
        let wall = of_adjustments.fold(self.parts.wall, |sum, part| sum.wrapping_add(*part));
        let scene = self.scene.as_ref().map_or(0, |scene| part(2, &scene.manifest.0));
        let revision = part(3, &self.revision.0.to_le_bytes());
        let scene = scene.wrapping_add(self.edits.fingerprint());
        let environment = self.environment.as_ref().map_or(0, |of| part(5, &of.blob.0));
        let LightEffects { fog, glow, ambient_occlusion, depth_of_field } = self.effects;
        let effects = [fog, glow, ambient_occlusion, depth_of_field].map(u8::from);
        let effects = if effects == [0; 4] { 0 } else { part(7, &effects) };
        let scene = scene.wrapping_add(environment).wrapping_add(effects);
        let places = &self.seen_from;
        let seen_from =
            if places.is_empty() { 0 } else { part(6, &polyptych_codec::encode(places)) };
        let scene = scene.wrapping_add(seen_from);
        Digest(wall.wrapping_add(scene).wrapping_add(revision))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, UVec2};

    use super::*;
    use polyptych_wall::Channel;
    use polyptych_wall::channel_calibration::ControlGrid;

    #[test]
    fn a_snapshot_folds_to_the_same_digest() {
        let mut replica = Replica::default();
        for name in ["a", "b", "c"] {
            let manifest = BlobHash::of(name.as_bytes());
            replica.apply(Operation::OpenScene(SceneRef { name: name.into(), manifest }));
        }
        let copy = Replica::from_snapshot(replica.revision, replica.snapshot());
        assert_eq!(copy, replica);
        assert_eq!(copy.digest(), replica.digest());

        replica.apply(Operation::CloseScene);
        assert_ne!(copy.digest(), replica.digest());

        let environment = Environment { name: "sky".into(), blob: BlobHash::of(b"sky") };
        replica.apply(Operation::SetEnvironment(Some(environment)));
        let surrounded = Replica::from_snapshot(replica.revision, replica.snapshot());
        assert_eq!((&surrounded, surrounded.digest()), (&replica, replica.digest()));
        replica.environment = None;
        assert_ne!(surrounded.digest(), replica.digest(), "the environment is in the digest");

        replica
            .apply(Operation::SetEffects(LightEffects { glow: true, ..LightEffects::default() }));
        let glowing = Replica::from_snapshot(replica.revision, replica.snapshot());
        assert_eq!((&glowing, glowing.digest()), (&replica, replica.digest()));
        replica.effects = LightEffects { fog: true, ..LightEffects::default() };
        assert_ne!(glowing.digest(), replica.digest(), "the effects are in the digest");

        let place = SeenFrom { position: DVec3::ONE, density: 1000.0, is_parallel: false };
        let manifest = BlobHash::of(b"d");
        replica.apply(Operation::OpenScene(SceneRef { name: "d".into(), manifest }));
        replica.apply(Operation::SetSeenFrom(vec![place]));
        let seen = Replica::from_snapshot(replica.revision, replica.snapshot());
        assert_eq!((&seen, seen.digest()), (&replica, replica.digest()));
        replica.seen_from.clear();
        assert_ne!(seen.digest(), replica.digest(), "the places are in the digest");
        let revision = replica.revision;
        replica.apply(Operation::SetSeenFrom(vec![place]));
        replica.apply(Operation::OpenScene(SceneRef { name: "d".into(), manifest }));
        assert!(replica.revision > revision && replica.seen_from.is_empty(), "a new scene");
    }

    #[test]
    fn changes_of_adjustments_fold_to_the_digest_of_the_whole_wall() {
        let tile = |name| Channel::tile(name, 0, UVec2::ZERO, UVec2::splat(8));
        let wall = Wall::new("w", Vec::new(), vec![tile("a"), tile("b")]);
        let mut replica = Replica::default();
        replica.apply(Operation::SetWall(Box::new(wall)));
        let bend = ControlGrid { points: UVec2::splat(2), moves: vec![DVec2::ZERO; 4].into() };
        let adjustment =
            Box::new(ChannelCalibration { bend: Some(bend), ..ChannelCalibration::default() });
        let channel = ChannelId(1);
        for operation in [
            Operation::Adjust { channel, adjustment },
            Operation::MoveBend { channel, moves: vec![(3, DVec2::X)] },
        ] {
            let before = replica.clone();
            replica.apply(operation);
            let whole = Replica::from_snapshot(replica.revision, replica.snapshot());
            assert_eq!((&whole, whole.digest()), (&replica, replica.digest()));
            let same = Replica { revision: before.revision, ..replica.clone() };
            assert_ne!(same.digest(), before.digest(), "the channel is in the digest");
        }
        let moved = replica.wall.as_ref().and_then(|w| w.channels[1].adjustment.bend.as_ref());
        assert_eq!(moved.expect("a bend").moves[3], DVec2::X);
        // What is not there changes nothing.
        let parts = replica.parts.clone();
        for (channel, index) in [(ChannelId(1), 4), (ChannelId(0), 0), (ChannelId(2), 0)] {
            replica.apply(Operation::MoveBend { channel, moves: vec![(index, DVec2::ONE)] });
            assert_eq!(replica.parts, parts);
        }
    }
}
