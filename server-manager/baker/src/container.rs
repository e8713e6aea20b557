//! The two forms of a glTF file: JSON alone, and GLB.
//!
//! ```text
//! GLB  = "glTF" version=2 length  chunk*        all u32, little-endian
//! chunk = length type bytes                     "JSON" first, then "BIN\0"
//! ```

use std::ops::Range;

use super::document::{AssetHeader, Document};
use super::error::BakeError;
use super::extensions::ExtensionUses;
use super::json::{self, JsonError};
use super::source_file::SourceFile;
use super::uri;

/// Largest JSON: about a million nodes; text takes several times its size when parsed.
const JSON_BYTES_MAX: u64 = 256 << 20;

/// The extensions that a file may require.
pub(super) const EXTENSIONS: [&str; 29] = [
    "EXT_lights_image_based",
    "EXT_lod",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MOZ_lightmap",
    "MSFT_lod",
];

/// Extensions without which a file's shapes stay as they are: one that requires them is drawn, with
/// a note if anything is missing. Those of materials are known by how their names begin.
const OF_APPEARANCE: [&str; 19] = [
    "EXT_instance_features",
    "EXT_lights_ies",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_mesh_primitive_restart",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "FB_geometry_metadata",
    "GODOT_single_root",
    "KHR_audio_emitter",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_rigid_bodies",
    "KHR_technique_webgl",
    "KHR_techniques_webgl",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
];

const MAGIC: &[u8] = b"glTF";
const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// Bytes before the first chunk.
const HEAD_BYTES: u64 = 12;

/// Bytes before the content of a chunk.
const CHUNK_HEAD_BYTES: u64 = 8;

/// Reads the document. Returns it with the place of a GLB's binary chunk in the file.
pub(super) fn parse(file: &SourceFile) -> Result<(Document, Option<Range<u64>>), BakeError> {
    let head = file.bytes(0, file.length.min(HEAD_BYTES), "file")?;
    if !head.starts_with(MAGIC) {
        return Ok((read_json(file, 0..file.length)?, None));
    }
    let chunks = glb_chunks(file, &head)?;
    Ok((read_json(file, chunks.json)?, chunks.bin))
}

/// The places of the two chunks in the file.
struct Chunks {
    json: Range<u64>,
    bin: Option<Range<u64>>,
}

fn glb_chunks(file: &SourceFile, head: &[u8]) -> Result<Chunks, BakeError> {
    let truncated = |what: &str| {
        let what = format!("the file is truncated: {what}, {} bytes are there", file.length);
        BakeError::at("file", what, "a whole GLB file would be right")
    };
    let version = word(head, 4).ok_or_else(|| truncated("its head ends"))?;
    if version != 2 {
        let what = format!("it is GLB of version {version}");
        return Err(BakeError::at("file", what, "glTF 2.0 would be right"));
    }
    let length = word(head, 8).ok_or_else(|| truncated("its head ends"))?;
    let length = u64::from(length);
    if length > file.length {
        return Err(truncated(&format!("it says {length} bytes")));
    }
    let mut chunks = Vec::new();
    let mut at = HEAD_BYTES;
    while chunks.len() < 2 && at + CHUNK_HEAD_BYTES <= length {
        let head = file.bytes(at, CHUNK_HEAD_BYTES, "file")?;
        let [size, kind] = [0, 4].map(|at| word(&head, at).unwrap_or(0));
        let start = at + CHUNK_HEAD_BYTES;
        let end = start + u64::from(size);
        if end > length {
            return Err(truncated(&format!("a chunk at {at} says {size} bytes")));
        }
        chunks.push((kind, start..end));
        at = end.next_multiple_of(4);
    }
    let mut chunks = chunks.into_iter();
    let Some((JSON, json)) = chunks.next() else {
        let what = "it is GLB, but its first chunk is not JSON";
        return Err(BakeError::at("file", what, "a JSON chunk would be right"));
    };
    let bin = chunks.next().and_then(|(kind, range)| (kind == BIN).then_some(range));
    Ok(Chunks { json, bin })
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let word = bytes.get(at..at + 4)?;
    word.try_into().ok().map(u32::from_le_bytes)
}

fn read_json(file: &SourceFile, Range { start, end }: Range<u64>) -> Result<Document, BakeError> {
    let length = end - start;
    if length > JSON_BYTES_MAX {
        let what = format!("its JSON has {length} bytes");
        return Err(BakeError::at("JSON", what, format!("at most {JSON_BYTES_MAX} can be read")));
    }
    parse_json(&file.bytes(start, length, "file")?)
}

fn parse_json(bytes: &[u8]) -> Result<Document, BakeError> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if text.trim_ascii_start().first() != Some(&b'{') {
        let what = "it is not glTF: neither JSON nor GLB";
        return Err(BakeError::at("file", what, "a .gltf or .glb file would be right"));
    }
    let malformed = |JsonError { path, error }: JsonError| {
        let what = if error.is_eof() { "the file is truncated: " } else { "" };
        let place = if path.is_empty() { "JSON".to_owned() } else { uri::shorten_middle(&path) };
        let error = uri::shorten_middle(&error.to_string());
        let is_twice = error.starts_with("duplicate field");
        let right = if is_twice { "each key once" } else { "glTF 2.0" };
        BakeError::at(place, format!("{what}{error}"), format!("{right} would be right"))
    };
    let head: AssetHeader = json::from_slice(text).map_err(|error| {
        // Text that is no JSON, such as `NaN`: the document's own error says in which key.
        let of_document = json::from_slice::<Document>(text).err();
        malformed(of_document.filter(|_| error.error.is_syntax()).unwrap_or(error))
    })?;
    check_head(&head)?;
    let mut document: Document = json::from_slice(text).map_err(malformed)?;
    document.extension_uses = ExtensionUses::of_json(text);
    Ok(document)
}

fn check_head(head: &AssetHeader) -> Result<(), BakeError> {
    let right = "glTF 2.0 would be right, with asset.version \"2.0\"";
    let asset = head.asset.as_ref();
    let Some(version) = asset.and_then(|asset| asset.version.as_ref()) else {
        return Err(BakeError::at("asset.version", "it is missing, so this is not glTF 2", right));
    };
    let is_two = version.as_str().is_some_and(|text| text == "2" || text.starts_with("2."));
    if !is_two {
        return Err(BakeError::at("asset.version", format!("it is glTF {version}"), right));
    }
    let min = asset.and_then(|asset| asset.min_version.as_deref()).unwrap_or("2.0");
    if min != "2.0" {
        return Err(BakeError::at("asset.minVersion", format!("it needs glTF {min}"), right));
    }
    let known = |name: &&String| {
        EXTENSIONS.contains(&name.as_str())
            || OF_APPEARANCE.contains(&name.as_str())
            || name.starts_with("KHR_materials_")
            || name.starts_with("EXT_materials_")
    };
    if let Some(name) = head.extensions_required.iter().find(|name| !known(name)) {
        let what = format!("{} is required but not supported", uri::shorten(name));
        let right = format!("supported are {}", EXTENSIONS.join(", "));
        return Err(BakeError::at("extensionsRequired", what, right));
    }
    Ok(())
}
