//! The cameras of a file's author: each is told of as an attribute of its node.

use polyptych_scene::{Attribute, CAMERA_KEY};
use serde::Deserialize;

use super::document::Node;
use super::{BakeJob, uri};

/// A camera, as far as a wall can use it: it has frusta of its own.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Camera {
    name: String,
    #[serde(rename = "type")]
    kind: Option<String>,
    perspective: Perspective,
    orthographic: Orthographic,
}

/// Its angle from the lower edge of the picture to the upper one, in radians.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Perspective {
    yfov: Option<f64>,
}

/// Half of the height that the picture shows, in world units.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Orthographic {
    ymag: Option<f64>,
}

impl Camera {
    /// Its name, and the extent of its picture: `Front: perspective, 37.8° high`.
    fn describe(&self) -> String {
        let name = match self.name.as_str() {
            "" => String::new(),
            name => format!("{}: ", uri::shorten(name)),
        };
        let kind = uri::shorten(self.kind.as_deref().unwrap_or("camera"));
        let extent = match (self.perspective.yfov, self.orthographic.ymag) {
            (Some(angle), None) => format!(", {:.1}° high", angle.to_degrees()),
            (None, Some(half)) => format!(", {} units high", 2.0 * half),
            _ => String::new(),
        };
        name + &kind + &extent
    }
}

/// The attribute that tells of the camera of a node; one that the file has not is noted.
pub(super) fn attribute(
    job: &mut BakeJob<'_>,
    index: u32,
    node: &Node,
) -> Option<(String, Attribute)> {
    let cameras = &job.source.document.cameras;
    match cameras.at(node.camera?, &format!("nodes[{index}].camera")) {
        Ok(camera) => Some((CAMERA_KEY.to_owned(), Attribute::Text(camera.describe()))),
        Err(error) => {
            job.warn(&format!("{error}; the node has no camera"));
            None
        }
    }
}
