//! Flat fields: whatever a channel looks at has one light, so that its picture tells what the
//! channel does to light.

use std::path::Path;

use anyhow::{Context, bail};
use glam::DVec3;
use polyptych_client::blocking::Client;
use polyptych_client::{Camera, Capture, Image};
use polyptych_wall::Wall;
use serde_json::json;

use crate::outputs;

/// Light of the fields: a ramp from black to white.
pub(super) const GREYS: [f64; 6] = [0.0, 0.002, 0.05, 0.2, 0.6, 1.0];

/// Half a side of the box around the viewer, in nearest distances that are drawn. A frustum's
/// corner is a few of them away from the eye.
const HALF_NEARS: f64 = 1e3;

/// The pictures of all channels for each of [`GREYS`].
pub(super) struct Fields(Vec<Capture>);

impl Fields {
    /// Draws them on a wall that runs; the scenes go to this folder.
    ///
    /// # Errors
    /// A file could not be written or a field not drawn; the error names a channel without a
    /// picture.
    pub fn draw(client: &Client, wall: &Wall, folder: &Path) -> anyhow::Result<Self> {
        let mut captures = Vec::with_capacity(GREYS.len());
        outputs::make_folder(folder)?;
        outputs::write(&folder.join("box.bin"), &vertices())?;
        client.set_camera(Camera::IDENTITY)?;
        for grey in GREYS {
            let path = folder.join(format!("field-{grey}.gltf"));
            outputs::write(&path, document(wall, grey).to_string().as_bytes())?;
            client.open_scene(path.display().to_string())?;
            client.set_camera(Camera::IDENTITY)?;
            client.render_frame_at(None, Some(0.0))?;
            let capture = client.capture()?;
            if let Some((channel, why)) = capture.missing.first() {
                bail!("channel {channel} has no picture: {why}");
            }
            captures.push(capture);
        }
        Ok(Self(captures))
    }

    /// The pictures of a channel, one for each of [`GREYS`].
    ///
    /// # Errors
    /// There is none with this name.
    pub fn of(&self, name: &str) -> anyhow::Result<Vec<&Image>> {
        let picture = |capture: &'_ Capture| {
            let found = capture.channels.iter().position(|picture| picture.name == name);
            found.with_context(|| format!("channel {name} has no picture"))
        };
        self.0.iter().map(|capture| Ok(&capture.channels[picture(capture)?])).collect()
    }
}

/// The corners of a box of ±1, and its sides of two triangles each.
fn vertices() -> Vec<u8> {
    let corner = |at: u16| [0, 1, 2].map(|bit| if at >> bit & 1 == 0 { -1.0_f32 } else { 1.0 });
    let sides: [[u16; 4]; 6] =
        [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]];
    let mut bytes: Vec<u8> = (0..8).flat_map(corner).flat_map(f32::to_le_bytes).collect();
    let indices = sides.iter().flat_map(|[a, b, c, d]| [a, b, c, c, b, d]);
    bytes.extend(indices.flat_map(|index| index.to_le_bytes()));
    bytes
}

/// A scene of one box around the viewer, which shows this light itself.
fn document(wall: &Wall, grey: f64) -> serde_json::Value {
    let half = wall.near_m * HALF_NEARS + wall.eye_separation_m;
    let DVec3 { x, y, z } = wall.eye;
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": [x, y, z], "scale": [half, half, half] }],
        "extensionsUsed": ["KHR_materials_unlit"],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0 }, "indices": 1, "material": 0
        }] }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorFactor": [grey, grey, grey, 1.0] },
            "extensions": { "KHR_materials_unlit": {} }
        }],
        "buffers": [{ "uri": "box.bin", "byteLength": 168 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 96 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 72 }
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
              "min": [-1, -1, -1], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR" }
        ]
    })
}
