//! The one log: operations, and the state that is their fold.
//!
//! Manager and servers fold with this same code; what they folded is compared by digest.

use serde::{Deserialize, Serialize};

use crate::ids::{BlobHash, Digest, Revision};
use crate::wall::Wall;

/// A change of the replicated state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Operation {
    /// The wall is now this.
    SetWall(Box<Wall>),
    /// The wall shows this scene.
    OpenScene(SceneRef),
    /// The wall shows no scene.
    CloseScene,
}

/// A baked scene, by the hash of its manifest, which names all the rest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneRef {
    /// What to call it.
    pub name: String,
    /// A [`crate::scene::Scene`], encoded.
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
}

impl Replica {
    /// Applies the next operation.
    pub fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::SetWall(wall) => self.wall = Some(wall),
            Operation::OpenScene(scene) => self.scene = Some(scene),
            Operation::CloseScene => self.scene = None,
        }
        self.revision.0 += 1;
    }

    /// The shortest list of operations that folds to this state.
    pub fn snapshot(&self) -> Vec<Operation> {
        let wall = self.wall.clone().map(Operation::SetWall);
        let scene = self.scene.clone().map(Operation::OpenScene);
        wall.into_iter().chain(scene).collect()
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
        let part = |kind: u8, bytes: &[u8]| {
            let mut hasher = blake3::Hasher::new();
            hasher.update(&[kind]).update(bytes);
            let hash = hasher.finalize();
            hash.as_bytes().iter().take(8).fold(0u64, |sum, &byte| (sum << 8) | u64::from(byte))
        };
        let wall = self.wall.as_ref().map_or(0, |wall| part(1, &crate::codec::encode(wall)));
        let scene = self.scene.as_ref().map_or(0, |scene| part(2, &scene.manifest.0));
        let revision = part(3, &self.revision.0.to_le_bytes());
        Digest(wall.wrapping_add(scene).wrapping_add(revision))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    }
}
