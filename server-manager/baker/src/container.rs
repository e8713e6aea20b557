//! The two forms of a glTF file: JSON alone, and GLB.
//!
//! ```text
//! GLB  = "glTF" version=2 length  chunk*        all u32, little-endian
//! chunk = length type bytes                     "JSON" first, then "BIN\0"
//! ```

use super::document::{AssetHeader, Document};
use super::error::BakeError;
use super::extensions::ExtensionUses;
use super::json::{self, JsonError};
use super::uri;

/// Largest JSON: about a million nodes; text takes several times its size when parsed.
pub(super) const JSON_BYTES_MAX: usize = 256 << 20;

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
/// a note. Those of materials are known by how their names begin.
const OF_APPEARANCE: [&str; 9] = [
    "EXT_lights_ies",
    "EXT_texture_avif",
    "KHR_audio_emitter",
    "KHR_technique_webgl",
    "KHR_techniques_webgl",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
];

const MAGIC: &[u8] = b"glTF";
const JSON: &[u8] = b"JSON";
const BIN: &[u8] = b"BIN\0";

/// The document, and the binary chunk of a GLB.
pub(super) fn parse(mut bytes: Vec<u8>) -> Result<(Document, Option<Vec<u8>>), BakeError> {
    if !bytes.starts_with(MAGIC) {
        return Ok((parse_json(&bytes)?, None));
    }
    let chunks = glb_chunks(&bytes)?;
    let document = parse_json(&bytes[chunks.json])?;
    let chunk = chunks.bin.map(|bin| {
        // Shortened in place: the buffer of a large scene is not held twice.
        bytes.truncate(bin.end);
        bytes.drain(..bin.start);
        bytes
    });
    Ok((document, chunk))
}

struct Chunks {
    json: std::ops::Range<usize>,
    bin: Option<std::ops::Range<usize>>,
}

fn glb_chunks(bytes: &[u8]) -> Result<Chunks, BakeError> {
    let truncated = |what: &str| {
        let what = format!("the file is truncated: {what}, {} bytes are there", bytes.len());
        BakeError::at("file", what, "a whole GLB file would be right")
    };
    let version = word(bytes, 4).ok_or_else(|| truncated("its head ends"))?;
    if version != 2 {
        let what = format!("it is GLB of version {version}");
        return Err(BakeError::at("file", what, "glTF 2.0 would be right"));
    }
    let length = word(bytes, 8).ok_or_else(|| truncated("its head ends"))? as usize;
    let bytes = bytes.get(..length).ok_or_else(|| truncated(&format!("it says {length} bytes")))?;
    let mut chunks = Vec::new();
    let mut at = 12usize;
    while chunks.len() < 2 && at + 8 <= bytes.len() {
        let size = word(bytes, at).unwrap_or(0) as usize;
        let (start, kind) = (at + 8, &bytes[at + 4..at + 8]);
        let end = start.checked_add(size).filter(|&end| end <= bytes.len());
        let end = end.ok_or_else(|| truncated(&format!("a chunk at {at} says {size} bytes")))?;
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

fn parse_json(bytes: &[u8]) -> Result<Document, BakeError> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if text.len() > JSON_BYTES_MAX {
        let what = format!("its JSON has {} bytes", text.len());
        return Err(BakeError::at("JSON", what, format!("at most {JSON_BYTES_MAX} can be read")));
    }
    if text.trim_ascii_start().first() != Some(&b'{') {
        let what = "it is not glTF: neither JSON nor GLB";
        return Err(BakeError::at("file", what, "a .gltf or .glb file would be right"));
    }
    let malformed = |JsonError { path, error }: JsonError| {
        let what = if error.is_eof() { "the file is truncated: " } else { "" };
        let place = if path.is_empty() { "JSON".to_owned() } else { uri::shorten_middle(&path) };
        let error = uri::shorten_middle(&error.to_string());
        BakeError::at(place, format!("{what}{error}"), "glTF 2.0 would be right")
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
