//! Light from all around the scene, in the place of its own sky.

use polyptych_files::blob::BlobHash;
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// A client's wish.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnvironmentSource {
    /// None: scenes have their own sky.
    None,
    /// An equirectangular picture of radiance: a Radiance .hdr file in one of the manager's scene
    /// folders, absolute or relative to one of them.
    File {
        /// At most [`polyptych_wall::limits::PATH_BYTES_MAX`] bytes.
        #[serde(deserialize_with = "text_of_peer")]
        path: String,
    },
    /// A clear sky, whose sun is where the first directional light of the open scene is.
    Sky,
    /// A bake that the manager has of one of these. Clients cannot ask for it.
    Baked(Environment),
}

/// Surroundings that were baked, by the hash of their blob.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Environment {
    /// Its name: `sky`, or that of the file.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// A [`polyptych_scene::EnvironmentMap`], encoded.
    pub blob: BlobHash,
}
