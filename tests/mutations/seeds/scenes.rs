//! Scene files: glTF as JSON and as GLB, with everything in it that the baker reads.

use std::io::Cursor;

use image::{ImageFormat, RgbImage, RgbaImage};
use serde_json::{Value, json};

/// A scene's JSON and the bytes of its one buffer.
#[derive(Clone, Debug)]
pub struct Parts {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Parts {
    /// Returns it as one binary file.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let word = |value: usize| (value as u32).to_le_bytes();
        let whole = 12 + 8 + json.len() + 8 + bin.len();
        let mut out = [b"glTF", &word(2)[..], &word(whole), &word(json.len()), b"JSON"].concat();
        out.extend(json);
        out.extend(word(bin.len()));
        out.extend(b"BIN\0");
        out.extend(bin);
        out
    }

    /// Returns it as JSON, with the buffer in a `data:` URI.
    pub fn gltf(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        let mut uri = "data:application/octet-stream,".to_owned();
        uri.extend(self.bin.iter().map(|byte| format!("%{byte:02x}")));
        // A mutation may have taken the buffer away.
        if let Some(Value::Object(buffer)) = json.pointer_mut("/buffers/0") {
            buffer.insert("uri".to_owned(), json!(uri));
        }
        json.to_string().into_bytes()
    }

    /// Appends bytes as a view, and gives its number.
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor =
            json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
        self.push("accessors", accessor)
    }

    fn floats(&mut self, kind: &str, width: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / width, &bytes)
    }

    fn close(mut self) -> Self {
        self.json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        self
    }
}

fn empty() -> Parts {
    let json = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [],
        "meshes": [], "accessors": [], "bufferViews": [], "buffers": [],
    });
    Parts { json, bin: Vec::new() }
}

/// A square with an image, a normal map, a light, instances, a strip, points and replaced zeros.
pub fn everything() -> Parts {
    let mut parts = empty();
    let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions: Vec<f32> = corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect();
    let positions = parts.floats("VEC3", 3, &positions);
    let normals = parts.floats("VEC3", 3, [[0.0, 0.0, 1.0]; 4].as_flattened());
    let uvs = parts.floats("VEC2", 2, corners.as_flattened());
    let colors = parts.accessor("VEC4", 5121, 4, &[200; 16]);
    parts.json["accessors"][colors]["normalized"] = json!(true);
    let indices = parts.accessor("SCALAR", 5123, 6, &[0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0]);
    let strip = parts.accessor("SCALAR", 5121, 5, &[0, 1, 2, 255, 3]);
    let places = parts.floats("VEC3", 3, [[1.0, 2.0, 3.0]; 2].as_flattened());
    let which = parts.view(&[1, 0, 2, 0]);
    let values = parts.view(&bytes_of(&[0.5, 0.5, 0.0, 1.0, 0.25, 0.0]));
    let sparse = json!({
        "componentType": 5126, "type": "VEC3", "count": 4, "sparse": { "count": 2,
        "indices": { "bufferView": which, "componentType": 5123 },
        "values": { "bufferView": values } },
    });
    let sparse = parts.push("accessors", sparse);
    let png = encoded(ImageFormat::Png);
    let png = parts.view(&png);
    let jpeg = encoded(ImageFormat::Jpeg);
    let jpeg = parts.view(&jpeg);
    let square = json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs,
        "COLOR_0": colors });
    parts.json["meshes"] = json!([
        { "name": "square", "primitives": [
            { "attributes": square, "indices": indices, "material": 0 },
            { "attributes": { "POSITION": sparse }, "indices": strip, "mode": 5 },
            { "attributes": { "POSITION": positions }, "mode": 0, "material": 1 },
            { "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "mode": 6,
              "material": 0 },
        ] },
    ]);
    let lights = json!([{ "type": "spot", "intensity": 5.0, "range": 9.0,
        "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.5 } }, { "type": "point" }]);
    parts.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    let instancing = json!({ "attributes": { "TRANSLATION": places } });
    parts.json["nodes"] = json!([
        { "name": "root", "children": [1, 2], "scale": [2.0, 2.0, 2.0], "mesh": 0 },
        { "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": instancing } },
        { "rotation": [0.0, 0.0, 0.0, 1.0], "translation": [1e6, 0.0, 0.0],
          "extensions": { "KHR_lights_punctual": { "light": 0 } } },
    ]);
    let turned = json!({ "KHR_texture_transform": { "offset": [0.5, 0.0], "rotation": 1.0,
        "scale": [2.0, 2.0], "texCoord": 0 } });
    parts.json["materials"] = json!([
        { "name": "both", "alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": true,
          "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.5, 0.5, 1.0],
              "baseColorTexture": { "index": 0, "extensions": turned },
              "metallicRoughnessTexture": { "index": 1 }, "roughnessFactor": 0.5 },
          "normalTexture": { "index": 1, "scale": 0.5 }, "occlusionTexture": { "index": 1 },
          "emissiveTexture": { "index": 0 }, "emissiveFactor": [1.0, 1.0, 1.0],
          "extensions": material_extensions() },
        { "alphaMode": "BLEND", "extensions": { "KHR_materials_unlit": {} } },
    ]);
    parts.json["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 1 }]);
    parts.json["samplers"] = json!([{ "wrapS": 33071, "minFilter": 9987, "magFilter": 9729 }]);
    parts.json["images"] = json!([
        { "bufferView": png, "mimeType": "image/png" },
        { "bufferView": jpeg, "mimeType": "image/jpeg" },
    ]);
    parts.close()
}

/// Extensions of a material with two textures.
fn material_extensions() -> Value {
    json!({
        "KHR_materials_emissive_strength": { "emissiveStrength": 2.0 },
        "KHR_materials_anisotropy": { "anisotropyStrength": 0.5,
            "anisotropyRotation": 1.0, "anisotropyTexture": { "index": 1 } },
        "KHR_materials_iridescence": { "iridescenceFactor": 0.5, "iridescenceIor": 1.4,
            "iridescenceThicknessMinimum": 100, "iridescenceThicknessMaximum": 500,
            "iridescenceTexture": { "index": 1 },
            "iridescenceThicknessTexture": { "index": 1 } },
        "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.5,
            "diffuseTransmissionTexture": { "index": 0 },
            "diffuseTransmissionColorFactor": [1.0, 0.5, 0.5],
            "diffuseTransmissionColorTexture": { "index": 0 } },
        "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 2.0,
            "attenuationColor": [0.5, 1.0, 1.0] },
        "MOZ_lightmap": { "index": 1, "texCoord": 0, "intensity": 3.0 }
    })
}

/// One triangle.
pub fn triangle() -> Parts {
    let mut parts = empty();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let positions = parts.floats("VEC3", 3, &corners);
    parts.json["meshes"] = json!([{ "primitives": [{ "attributes": { "POSITION": positions } }] }]);
    parts.json["nodes"] = json!([{ "mesh": 0, "matrix":
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 5, 5, 1] }]);
    parts.close()
}

/// All of them as files, of both forms.
pub fn files() -> [Vec<u8>; 4] {
    let (small, large) = (triangle(), everything());
    [small.glb(), small.gltf(), large.glb(), large.gltf()]
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Eight by five pixels of many colours.
fn encoded(format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let color = |x: u32, y: u32| [(x * 30) as u8, (y * 50) as u8, 128];
    let written = if format == ImageFormat::Png {
        let rgba = |x, y| image::Rgba([color(x, y)[0], color(x, y)[1], 128, (x * 20) as u8]);
        RgbaImage::from_fn(8, 5, rgba).write_to(&mut bytes, format)
    } else {
        RgbImage::from_fn(8, 5, |x, y| image::Rgb(color(x, y))).write_to(&mut bytes, format)
    };
    written.expect("encoded");
    bytes.into_inner()
}
