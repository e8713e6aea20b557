//! Parts of a scene that cannot be shown: the rest is shown, with a note, or the file is refused
//! with that reason where nothing is left.

use polyptych_scene::Scene;
use polyptych_scene::limits::TEXTURE_SIDE_MAX;
use serde_json::json;

use super::builder::{Builder, png};
use super::{BakeFixture, bake_builder};

pub(super) fn textured(encoded: &[u8]) -> Builder {
    let mut builder = Builder::quad();
    builder.json["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
        "normalTexture": { "index": 0 },
    }]);
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    builder.image(encoded);
    builder
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
}

/// A PNG whose head says this size, with a sound check sum.
fn claims(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png(8, 8, |x, y| [x as u8, y as u8, 0, 255]);
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    bytes
}

/// The first pixel of each texture of a scene.
fn first_pixels(place: &BakeFixture, scene: &Scene) -> Vec<Vec<u8>> {
    let first = |texture: &polyptych_scene::Texture| {
        let bytes = place.store.blobs().read(texture.blob).expect("read").expect("there");
        assert_eq!(bytes.len() as u64, texture.bytes());
        bytes[..4].to_vec()
    };
    scene.textures.iter().map(first).collect()
}

#[test]
fn images_that_cannot_be_read_are_placeholders_with_a_note_that_names_the_format() {
    let whole = png(8, 8, |x, y| [x as u8, y as u8, 0, 255]);
    for (encoded, part) in [
        (&b"not an image"[..], "it is no image"),
        (&whole[..whole.len() / 2], "can't be decoded"),
        (b"", "it is empty"),
        (b"GIF89a\x01\0\x01\0", "can't be decoded"),
        (b"BM\x36\0\0\0", "can't be decoded"),
        (b"RIFF\x1a\0\0\0WEBPVP8L", "can't be decoded"),
        (b"\xabKTX 20\xbb\r\n\x1a\n", "it is KTX2 that is cut off"),
        (b"\0\0\0\x20ftypavif", "it is AVIF"),
        (b"II*\0\x08\0\0\0", "it is TIFF"),
        (b"<html><title>404</title>", "it is HTML"),
        (&claims(16_384, 16_384), "16384 × 16384 pixels of 4 bytes take 1024 MiB; at most"),
        (&claims(16_384, 16_384), "512 MiB can be read, such as 11585 × 11585"),
        (&claims(200_000, 2), "at most 16384 pixels a side"),
        (&claims(8_192, 8_192), "can't hold 8192 × 8192"),
        // One of this size may be of one colour.
        (&claims(4_096, 4_096), "can't be decoded"),
    ] {
        let (place, baked, scene) = bake_builder(&textured(encoded));
        let note = baked.warnings.iter().find(|note| note.contains(part));
        let note = note.unwrap_or_else(|| panic!("'{part}' is not in {:?}", baked.warnings));
        assert!(note.starts_with("images[0]") && note.contains("placeholder"), "{note}");
        assert!(!note.contains('\n'), "{note}");
        // A checker for the colours, a flat normal.
        let pixels = first_pixels(&place, &scene);
        assert_eq!(pixels, [[188, 188, 188, 255], [128, 128, 255, 255]], "{part}");
        assert!(scene.textures.iter().all(|texture| texture.width < TEXTURE_SIDE_MAX));
    }
    let (place, baked, scene) = bake_builder(&textured(&whole));
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert_eq!(first_pixels(&place, &scene)[0], [0, 0, 0, 255]);
}

#[test]
fn an_image_that_is_absent_is_a_placeholder_until_it_is_there() {
    for (uri, part) in [
        ("wood%20floor.png", "can't be found"),
        ("https://example.org/a.png", "https"),
        ("folder", "not a file"),
        ("data:image/webp;base64,AAAA", "called WebP"),
        ("data:image/png;base64,****", "base64"),
    ] {
        let mut builder = textured(b"");
        builder.json["images"] = json!([{ "uri": uri, "name": "floor" }]);
        let place = BakeFixture::new();
        place.write("scene/folder/other.txt", b"text");
        let path = place.write("scene/scene.glb", &builder.glb());
        let baked = place.bake(&path).expect("baked");
        let note = baked.warnings.join("\n");
        assert!(note.contains("images[0] 'floor'") && note.contains(part), "{uri}: {note}");
        if uri == "wood%20floor.png" {
            assert!(place.bake(&path).expect("baked").reused, "the note is kept too");
            place.write("scene/wood floor.png", &png(2, 2, |_, _| [9, 9, 9, 255]));
            let found = place.bake(&path).expect("baked");
            assert!(!found.reused && found.warnings.is_empty(), "{:?}", found.warnings);
        }
    }
}

#[test]
fn images_that_lead_out_of_the_scenes_folder_are_refused() {
    for uri in ["../outside.png", "..%2foutside.png", "/etc/hostname", "a/../../outside.png"] {
        let mut builder = textured(b"");
        builder.json["images"] = json!([{ "uri": uri }]);
        let message = refusal(&builder);
        assert!(message.contains("images[0]") && message.contains("leads out"), "{message}");
    }
}

#[test]
fn backslashes_part_folders_where_no_file_has_them_in_its_name() {
    let place = BakeFixture::new();
    let pictures = [[9, 0, 0, 255], [0, 9, 0, 255]].map(|color| png(2, 2, |_, _| color));
    place.write("scene/textures/old wood.png", &pictures[0]);
    place.write("outside.png", &pictures[0]);
    let bake = |uri: &str| {
        let mut builder = textured(b"");
        builder.json["images"] = json!([{ "uri": uri }]);
        place.write("scene/buffers/scene.bin", &builder.bin);
        let path = place.write("scene/scene.gltf", &builder.gltf(r"buffers\scene.bin"));
        let baked = place.bake(&path).expect("baked");
        (first_pixels(&place, &place.scene(&baked))[0].clone(), baked.warnings.join("\n"))
    };
    for uri in [r"textures\old wood.png", "textures%5Cold%20wood.png", r".\textures/old wood.png"] {
        let (pixel, notes) = bake(uri);
        assert_eq!((&pixel[..], notes.as_str()), (&[9, 0, 0, 255][..], ""), "{uri}");
    }
    for uri in [r"..\outside.png", r"\etc\hostname", r"textures\..\..\outside.png"] {
        let (pixel, notes) = bake(uri);
        assert!(pixel == [188, 188, 188, 255] && notes.contains("leads out"), "{uri}: {notes}");
    }
    let (_, notes) = bake(r"textures\new wood.png");
    assert!(notes.contains(r"'textures\new wood.png' can't be found"), "{notes}");
    #[cfg(unix)]
    {
        let link = place.folder.path().join("scene/textures/link.png");
        let target = place.folder.path().join("outside.png");
        std::os::unix::fs::symlink(target, link).expect("linked");
        let (pixel, notes) = bake(r"textures\link.png");
        assert!(pixel[0] == 188 && notes.contains("leads out"), "{notes}");
        // A file of that very name comes first.
        place.write(r"scene/textures\old wood.png", &pictures[1]);
        assert_eq!(bake(r"textures\old wood.png").0, [0, 9, 0, 255]);
    }
}

#[test]
fn images_that_nothing_uses_are_not_looked_at() {
    let mut builder = Builder::quad();
    builder.json["images"] = json!([{ "uri": "gone.png" }, {}]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty() && scene.textures.is_empty(), "{:?}", baked.warnings);
}

#[test]
fn placeholders_leave_light_as_it_is() {
    let mut builder = textured(b"broken");
    builder.json["materials"] = json!([{
        "pbrMetallicRoughness": { "metallicRoughnessTexture": { "index": 0 } },
        "occlusionTexture": { "index": 0 },
        "emissiveTexture": { "index": 0 }, "emissiveFactor": [1, 1, 1],
    }]);
    let (place, _, scene) = bake_builder(&builder);
    let material = &scene.materials[0];
    assert_eq!(material.emissive, glam::Vec3::ZERO, "it does not glow");
    assert!(material.emissive_texture.is_none());
    let data = material.metallic_roughness_texture.expect("a texture").texture as usize;
    // Not occluded, rough, no metal.
    assert_eq!(first_pixels(&place, &scene)[data], [255, 255, 0, 255]);
}

#[test]
fn textures_of_an_extension_are_named_with_it() {
    let mut builder = textured(b"");
    builder.json["textures"] = json!([{ "extensions": { "EXT_texture_avif": { "source": 0 } } }]);
    builder.json["extensionsUsed"] = json!(["EXT_texture_avif"]);
    let (place, baked, scene) = bake_builder(&builder);
    let note = baked.warnings.join("\n");
    assert!(
        note.contains("textures[0]: a placeholder is shown, since its image is AVIF"),
        "{note}"
    );
    assert_eq!(first_pixels(&place, &scene)[0], [188, 188, 188, 255]);
}

/// The quad as a Draco mesh whose stream is none: its accessors have no data.
fn draco(builder: &mut Builder, primitive: usize) {
    let positions = json!({ "componentType": 5126, "count": 24, "type": "VEC3" });
    let indices = json!({ "componentType": 5123, "count": 36, "type": "SCALAR" });
    let accessors = builder.json["accessors"].as_array_mut().expect("a list");
    let first = accessors.len();
    accessors.push(positions);
    accessors.push(indices);
    builder.json["meshes"][0]["primitives"][primitive] = json!({
        "attributes": { "POSITION": first }, "indices": first + 1,
        "extensions": { "KHR_draco_mesh_compression": {
            "bufferView": 0, "attributes": { "POSITION": 0 } } },
    });
    builder.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
}

fn refusal(builder: &Builder) -> String {
    let place = BakeFixture::new();
    let path = place.write("scene.glb", &builder.glb());
    place.bake(&path).expect_err("refused").to_string()
}

#[test]
fn draco_meshes_without_other_data_are_left_out_and_nothing_left_is_refused() {
    let mut builder = Builder::quad();
    let quad = builder.json["meshes"][0]["primitives"][0].clone();
    draco(&mut builder, 0);
    let message = refusal(&builder);
    for part in ["meshes[0].primitives[0]", "compressed with Draco", "nothing is left to draw"] {
        assert!(message.contains(part), "'{part}' is not in: {message}");
    }
    builder.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(quad);
    let (_place, baked, _) = bake_builder(&builder);
    assert_eq!(baked.triangles, 2);
    let note = baked.warnings.iter().find(|note| note.contains("compressed with Draco"));
    assert!(note.is_some_and(|note| note.starts_with("meshes[0].primitives[0]")));
}

#[test]
fn draco_meshes_with_other_data_are_drawn_from_it() {
    let mut builder = Builder::quad();
    builder.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
    builder.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    let (_place, baked, _) = bake_builder(&builder);
    assert_eq!(baked.triangles, 2);
}

#[test]
fn positions_and_indices_without_data_are_left_out_whatever_the_reason() {
    for (accessor, part) in [(0, "POSITION has no data"), (3, "indices has no data")] {
        let mut builder = Builder::quad();
        let json = builder.json["accessors"][accessor].as_object_mut().expect("an object");
        json.remove("bufferView");
        let message = refusal(&builder);
        assert!(message.contains(part) && message.contains("nothing is left"), "{message}");
    }
    let mut builder = Builder::quad();
    builder.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "NORMAL": 1 });
    assert!(refusal(&builder).contains("no POSITION"));
}
