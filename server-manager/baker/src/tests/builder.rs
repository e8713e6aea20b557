//! Small glTF files made in code.

use std::io::Cursor;

use serde_json::{Value, json};

/// A glTF whose buffer grows as things are added.
#[derive(Clone)]
pub(crate) struct Builder {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Builder {
    /// A scene without nodes.
    pub(crate) fn empty() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "accessors": [], "bufferViews": [],
            "images": [], "textures": [],
        });
        Self { json, bin: Vec::new() }
    }

    /// One triangle of one metre, without normals or indices.
    pub(crate) fn triangle() -> Self {
        let mut builder = Self::empty();
        let positions = builder.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        builder.mesh(&json!({ "attributes": { "POSITION": positions } }));
        builder
    }

    /// A square in the plane of x and y that faces +z, with an image upright on it.
    pub(crate) fn quad() -> Self {
        let mut builder = Self::empty();
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let positions: Vec<f32> = corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect();
        let uvs: Vec<f32> = corners.iter().flat_map(|[x, y]| [*x, 1.0 - *y]).collect();
        let positions = builder.floats("VEC3", &positions);
        let normals = builder.floats("VEC3", [[0.0, 0.0, 1.0]; 4].as_flattened());
        let uvs = builder.floats("VEC2", &uvs);
        let indices = builder.indices(&[0, 1, 2, 0, 2, 3]);
        let attributes = json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs });
        builder.mesh(&json!({ "attributes": attributes, "indices": indices }));
        builder
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8], stride: Option<u64>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    pub(crate) fn accessor(
        &mut self,
        kind: &str,
        component: u32,
        count: usize,
        bytes: &[u8],
        stride: Option<u64>,
    ) -> usize {
        let view = self.view(bytes, stride);
        let accessor =
            json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
        self.push("accessors", accessor)
    }

    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / width, &bytes, None)
    }

    pub(crate) fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor("SCALAR", 5125, values.len(), &bytes, None)
    }

    /// A mesh of this primitive, and a root node that shows it.
    pub(crate) fn mesh(&mut self, primitive: &Value) {
        let mesh = self.push("meshes", json!({ "primitives": [primitive] }));
        let node = self.push("nodes", json!({ "mesh": mesh }));
        self.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(json!(node));
    }

    /// An image in the buffer, and a texture of it.
    pub(crate) fn image(&mut self, encoded: &[u8]) {
        let view = self.view(encoded, None);
        let image = self.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        self.push("textures", json!({ "source": image }));
    }

    fn text(&self, uri: Option<&str>) -> String {
        let mut json = self.json.clone();
        let mut buffer = json!({ "byteLength": self.bin.len() });
        if let Some(uri) = uri {
            buffer["uri"] = json!(uri);
        }
        if json["buffers"].is_null() {
            json["buffers"] = json!([buffer]);
        }
        json.to_string()
    }

    /// Returns the file as JSON text, with the buffer in the file `uri`.
    pub(crate) fn gltf(&self, uri: &str) -> Vec<u8> {
        self.text(Some(uri)).into_bytes()
    }

    /// Returns the file as one binary file.
    pub(crate) fn glb(&self) -> Vec<u8> {
        glb(&self.text(None), &self.bin)
    }
}

/// A GLB of this JSON and these bytes.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let word = |out: &mut Vec<u8>, value: usize| out.extend((value as u32).to_le_bytes());
    word(&mut out, 2);
    word(&mut out, 12 + 8 + json.len() + 8 + bin.len());
    word(&mut out, json.len());
    out.extend(b"JSON");
    out.extend(&json);
    word(&mut out, bin.len());
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

/// A PNG of these pixels.
pub(crate) fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let picture = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba(pixel(x, y)));
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("encoded");
    bytes.into_inner()
}
