//! Scenes for tests: the generated town, assets that may lie beside the repository, and glTF
//! files made in code.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use polyptych_client::glam::DVec3;
use polyptych_client::{Bounds, Camera};
use serde_json::{Value, json};

use super::place::{TestDir, of_this_run};

/// A town of four blocks, generated once for each run of the tests.
pub fn town() -> &'static Path {
    static TOWN: OnceLock<PathBuf> = OnceLock::new();
    TOWN.get_or_init(|| {
        let path = of_this_run().join("scenes/town.glb");
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        let town = ["scene", "town", "--blocks", "2", "--seed", "1", "-o"].map(PathBuf::from);
        TestDir::new().run(town.iter().chain([&path])).succeeded();
        path
    })
}

/// A scene from the assets beside the repository. Who needs it is ignored where there are none.
pub fn asset(name: &str) -> PathBuf {
    beside("assets", name)
}

/// A calibration file of another system from beside the repository, as [`asset`].
pub fn foreign_wall(name: &str) -> PathBuf {
    beside("walls", name)
}

fn beside(folder: &str, name: &str) -> PathBuf {
    let all = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(folder);
    all.join(name).canonicalize().unwrap_or_else(|error| panic!("{folder}/{name}: {error}"))
}

/// Eight ways to look at a scene: all around it, from far and near, from above and level, with
/// edges and corners of tiles in the middle of it.
pub fn poses(bounds: &Bounds) -> [Camera; 8] {
    // How far away, in radii of the scene: the town is a small island in a wide sea.
    let distances = [1.6, 0.9, 0.5, 0.35, 0.25, 0.18, 0.7, 0.12];
    let elevations_rad: [f64; 8] = [0.35, 0.2, 0.5, 0.3, 0.25, 0.4, 1.5, 0.3];
    std::array::from_fn(|i| {
        let (sin_h, cos_h) = (i as f64 * TAU / 8.0 + 0.2).sin_cos();
        let (sin_e, cos_e) = elevations_rad[i].sin_cos();
        let distance = bounds.radius() * distances[i];
        let outward = DVec3::new(sin_h * cos_e, sin_e, cos_h * cos_e) * distance;
        let camera = Camera::look_at(bounds.center() + outward, bounds.center(), DVec3::Y);
        // The wall stands halfway between the viewer and what is looked at.
        camera.with_scale(distance * 0.5)
    })
}

/// A glTF file under construction.
#[derive(Clone, Debug)]
pub struct Gltf {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Gltf {
    /// One triangle of one metre.
    pub fn triangle() -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
                { "bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR" },
            ],
            "bufferViews": [
                { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
                { "buffer": 0, "byteOffset": 36, "byteLength": 12 },
            ],
        });
        let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let mut bin: Vec<u8> = positions.iter().flat_map(|value| value.to_le_bytes()).collect();
        bin.extend([0u32, 1, 2].iter().flat_map(|index| index.to_le_bytes()));
        Self { json, bin }
    }

    /// Returns the file with a change.
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }

    /// Adds numbers of a component type to the buffer. Returns the index of their accessor.
    pub fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let Self { json, bin } = self;
        bin.resize(bin.len().next_multiple_of(4), 0);
        let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        bin.extend_from_slice(bytes);
        let views = json["bufferViews"].as_array_mut().expect("a list");
        views.push(view);
        let view = views.len() - 1;
        let accessors = json["accessors"].as_array_mut().expect("a list");
        accessors.push(json!({ "bufferView": view, "componentType": component, "count": count,
            "type": kind }));
        accessors.len() - 1
    }

    /// Adds numbers to the buffer. Returns the index of their accessor.
    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / width, &bytes)
    }

    /// Returns it as JSON, with the buffer in another file.
    pub fn gltf(&self, uri: &str) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "uri": uri, "byteLength": self.bin.len() }]);
        json.to_string().into_bytes()
    }

    /// Returns it as one binary file.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + json.len() + 8 + self.bin.len();
        let word = |value: usize| (value as u32).to_le_bytes();
        let header = [*b"glTF", word(2), word(total), word(json.len()), *b"JSON"].concat();
        let second = [word(self.bin.len()), *b"BIN\0"].concat();
        [header, json, second, self.bin.clone()].concat()
    }
}
