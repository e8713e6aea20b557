//! A scene's geometry in one colour: what is left of a frame's time without materials and lights.

use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::{Map, Value, json};

/// The first four bytes of a binary glTF file.
const MAGIC: &[u8; 4] = b"glTF";

/// Bytes of the header of such a file, and of that of each chunk.
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// The extension by which materials have no light.
const UNLIT: &str = "KHR_materials_unlit";

/// The extension that brings lights.
const LIGHTS: &str = "KHR_lights_punctual";

/// Writes the geometry of a .gltf or .glb file into a folder, with one colour and without lights,
/// and returns the new file. Surfaces that were seen from both sides still are.
///
/// # Errors
/// The file is no glTF, or names buffers that are not files beside it.
pub(super) fn write(file: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
    let bytes = fs::read(file).with_context(|| format!("{}", file.display()))?;
    let name = file.file_name().context("the scene has no file name")?;
    let onto = folder.join(name);
    if !bytes.starts_with(MAGIC) {
        let mut document = parsed(&bytes, file)?;
        copy_buffers(&document, file, folder)?;
        flatten(&mut document);
        fs::write(&onto, document.to_string())?;
        return Ok(onto);
    }
    let length = bytes.get(HEADER_BYTES..HEADER_BYTES + 4).and_then(|it| it.try_into().ok());
    let length = length.map_or(0, u32::from_le_bytes) as usize;
    let begin = HEADER_BYTES + CHUNK_HEADER_BYTES;
    let text = bytes.get(begin..begin.saturating_add(length));
    let text = text.with_context(|| format!("{}: its first chunk is cut off", file.display()))?;
    let mut document = parsed(text, file)?;
    copy_buffers(&document, file, folder)?;
    flatten(&mut document);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[begin + length..];
    let all = begin + text.len() + rest.len();
    let mut written = bytes[..8].to_vec();
    written.extend(u32::try_from(all)?.to_le_bytes());
    written.extend(u32::try_from(text.len())?.to_le_bytes());
    written.extend(b"JSON");
    written.extend(text);
    written.extend(rest);
    fs::write(&onto, written)?;
    Ok(onto)
}

fn parsed(text: &[u8], file: &Path) -> anyhow::Result<Value> {
    serde_json::from_slice(text).with_context(|| format!("{} is no glTF", file.display()))
}

/// Copies the buffers that stand beside a file.
fn copy_buffers(document: &Value, file: &Path, folder: &Path) -> anyhow::Result<()> {
    let beside = file.parent().unwrap_or(Path::new("."));
    let buffers = document["buffers"].as_array().map_or(&[][..], Vec::as_slice);
    for uri in buffers.iter().filter_map(|buffer| buffer["uri"].as_str()) {
        if uri.starts_with("data:") {
            continue;
        }
        let mut parts = Path::new(uri).components();
        let is_plain = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
        if !is_plain || uri.contains(['%', ':']) {
            bail!("the buffer {uri:?} is not a file beside the scene");
        }
        fs::copy(beside.join(uri), folder.join(uri)).with_context(|| uri.to_owned())?;
    }
    Ok(())
}

/// Gives a glTF document one colour, and takes its lights.
fn flatten(document: &mut Value) {
    let materials = document["materials"].as_array().cloned().unwrap_or_default();
    let is_double = |primitive: &Value| {
        let index = primitive["material"].as_u64().and_then(|it| usize::try_from(it).ok());
        let material = index.and_then(|index| materials.get(index));
        material.is_some_and(|material| material["doubleSided"] == true)
    };
    let meshes = document.get_mut("meshes").and_then(Value::as_array_mut);
    for mesh in meshes.into_iter().flatten() {
        let primitives = mesh.get_mut("primitives").and_then(Value::as_array_mut);
        for primitive in primitives.into_iter().flatten() {
            let material = u32::from(is_double(primitive));
            primitive["material"] = json!(material);
            without(primitive, "KHR_materials_variants");
        }
    }
    for node in document.get_mut("nodes").and_then(Value::as_array_mut).into_iter().flatten() {
        without(node, LIGHTS);
    }
    without(document, LIGHTS);
    let flat = |double_sided: bool| {
        json!({
            "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1.0] },
            "doubleSided": double_sided,
            "extensions": { UNLIT: {} },
        })
    };
    let Some(all) = document.as_object_mut() else { return };
    for unused in ["textures", "images", "samplers"] {
        all.remove(unused);
    }
    all.insert("materials".into(), json!([flat(false), flat(true)]));
    let used = all.entry("extensionsUsed").or_insert_with(|| json!([]));
    if let Some(used) = used.as_array_mut()
        && !used.iter().any(|name| name == UNLIT)
    {
        used.push(UNLIT.into());
    }
}

/// Takes an extension from an object.
fn without(object: &mut Value, extension: &str) {
    if let Some(all) = object.get_mut("extensions").and_then(Value::as_object_mut) {
        all.remove(extension);
    }
    let is_empty = object.get("extensions").and_then(Value::as_object).is_some_and(Map::is_empty);
    if let Some(object) = object.as_object_mut().filter(|_| is_empty) {
        object.remove("extensions");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometry_keeps_its_place_and_loses_materials_textures_and_lights() {
        let folder = tempfile::tempdir().expect("a folder");
        let document = json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "uri": "a.bin", "byteLength": 3 }],
            "nodes": [{ "mesh": 0, "extensions": { LIGHTS: { "light": 0 } } }],
            "extensions": { LIGHTS: { "lights": [{}] } },
            "extensionsUsed": [LIGHTS],
            "meshes": [{ "primitives": [{ "material": 1, "indices": 4 }, { "material": 0 }, {}] }],
            "materials": [{ "alphaMode": "BLEND" }, { "doubleSided": true }],
            "textures": [{}], "images": [{}], "samplers": [{}],
        });
        let (file, out) = (folder.path().join("a.gltf"), folder.path().join("out"));
        fs::create_dir(&out).expect("a folder");
        fs::write(&file, document.to_string()).expect("written");
        fs::write(folder.path().join("a.bin"), b"abc").expect("written");
        let written = write(&file, &out).expect("flat");
        assert_eq!(fs::read(out.join("a.bin")).expect("copied"), b"abc");
        let flat = parsed(&fs::read(written).expect("there"), &file).expect("JSON");
        let primitives = &flat["meshes"][0]["primitives"];
        assert_eq!(
            *primitives,
            json!([
                { "material": 1, "indices": 4 }, { "material": 0 }, { "material": 0 },
            ])
        );
        assert_eq!(flat["materials"][1]["doubleSided"], true);
        assert!(flat["materials"][0]["extensions"][UNLIT].is_object());
        assert_eq!(flat["nodes"], json!([{ "mesh": 0 }]));
        for gone in ["textures", "images", "samplers", "extensions"] {
            assert!(flat.get(gone).is_none(), "{gone}: {flat}");
        }
    }

    #[test]
    fn what_is_no_scene_or_reaches_elsewhere_is_refused_with_its_name() {
        let folder = tempfile::tempdir().expect("a folder");
        for (text, why) in [
            (&b"not a scene"[..], "a.gltf is no glTF"),
            (b"glTF\x02\0\0\0", "its first chunk is cut off"),
            (br#"{"buffers":[{"uri":"../b.bin"}]}"#, "../b.bin"),
        ] {
            let file = folder.path().join("a.gltf");
            fs::write(&file, text).expect("written");
            let error = write(&file, folder.path()).expect_err("refused");
            assert!(format!("{error:#}").contains(why), "{error:#}");
        }
    }
}
