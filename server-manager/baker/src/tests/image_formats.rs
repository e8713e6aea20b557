//! Pictures of every format that is read, against the same picture as PNG.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, Rgba, RgbaImage};
use serde_json::json;

use super::bake_builder;
use super::builder::png;
use super::missing::textured;

/// Pixels of the sides: not square, and no multiple of a block.
const SIZE: [u32; 2] = [12, 8];

fn picture() -> RgbaImage {
    RgbaImage::from_fn(SIZE[0], SIZE[1], |x, y| Rgba(block_color(x / 4, y / 4)))
}

fn block_color(column: u32, row: u32) -> [u8; 4] {
    [40 + 60 * column as u8, 200 - 90 * row as u8, (30 * (column + 3 * row)) as u8, 255]
}

/// The largest level of the texture of colours.
fn colors(encoded: &[u8], texture: Option<&str>) -> Vec<u8> {
    let mut builder = textured(encoded);
    if let Some(extension) = texture {
        builder.json["textures"] = json!([{ "extensions": { extension: { "source": 0 } } }]);
        builder.json["extensionsRequired"] = json!([extension]);
    }
    let (place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    let texture = &scene.textures[0];
    let bytes = place.store.blobs().read(texture.blob).expect("read").expect("there");
    bytes[..texture.width as usize * texture.height as usize * 4].to_vec()
}

fn encoded(format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture().write_to(&mut bytes, format).expect("encoded");
    bytes.into_inner()
}

/// A KTX2 file (KTX 2.0) with one level of UASTC blocks of one colour each (mode 8).
fn ktx2() -> Vec<u8> {
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|w| w.to_le_bytes()).collect() };
    let blocks: Vec<u8> = (0..SIZE[1] / 4)
        .flat_map(|row| (0..SIZE[0] / 4).map(move |column| block_color(column, row)))
        .flat_map(|[r, g, b, a]| {
            let part = |value: u8, bit: u32| u128::from(value) << bit;
            let mode = 0x17;
            (mode | part(r, 5) | part(g, 13) | part(b, 21) | part(a, 29)).to_le_bytes()
        })
        .collect();
    let mut file = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    // Format, type size, size, depth, layers, faces, levels, supercompression.
    file.extend(words(&[0, 1, SIZE[0], SIZE[1], 0, 0, 1, 1, 0]));
    let (descriptor_at, descriptor_bytes) = (80 + 24, 44);
    file.extend(words(&[descriptor_at, descriptor_bytes, 0, 0]));
    file.extend([0_u64; 2].iter().flat_map(|word| word.to_le_bytes()));
    let data_at = u64::from(descriptor_at + descriptor_bytes).next_multiple_of(16);
    let length = blocks.len() as u64;
    file.extend([data_at, length, length].iter().flat_map(|word| word.to_le_bytes()));
    // Colour model UASTC, primaries of BT.709, transfer sRGB; blocks of 4 × 4 of 16 bytes.
    let model = 0xa6 | 1 << 8 | 2 << 16;
    let rgba_of_128_bits = 0x7f << 16 | 3 << 24;
    file.extend(words(&[descriptor_bytes, 0, 2 | 40 << 16, model, 0x0303, 16, 0]));
    file.extend(words(&[rgba_of_128_bits, 0, 0, u32::MAX]));
    file.resize(data_at as usize, 0);
    file.extend(blocks);
    file
}

#[test]
fn pictures_without_loss_are_those_of_the_png() {
    let expected = colors(&png(SIZE[0], SIZE[1], |x, y| block_color(x / 4, y / 4)), None);
    assert_eq!(expected, picture().into_raw());
    for format in [ImageFormat::WebP, ImageFormat::Bmp, ImageFormat::Gif] {
        assert!(colors(&encoded(format), None) == expected, "{format:?}");
    }
    assert!(colors(&encoded(ImageFormat::WebP), Some("EXT_texture_webp")) == expected);
    assert!(colors(&ktx2(), Some("KHR_texture_basisu")) == expected);
}

/// A KTX2 file of plain pixels: a format of Vulkan, and its one level as it is stored.
fn plain_ktx2(format: u32, level: &[u8]) -> Vec<u8> {
    let mut file = ktx2();
    let data_at = 160;
    file.resize(data_at, 0);
    file[12..16].copy_from_slice(&format.to_le_bytes());
    file[80..88].copy_from_slice(&(data_at as u64).to_le_bytes());
    file[88..96].copy_from_slice(&(level.len() as u64).to_le_bytes());
    file.extend(level);
    file
}

fn with_scheme(mut file: Vec<u8>, scheme: u32) -> Vec<u8> {
    file[44..48].copy_from_slice(&scheme.to_le_bytes());
    file
}

/// A frame of Zstandard with one block that is stored (RFC 8878, 3.1.1).
fn zstandard(bytes: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x60];
    frame.extend((bytes.len() as u16 - 256).to_le_bytes());
    frame.extend(&(1 | (bytes.len() as u32) << 3).to_le_bytes()[..3]);
    frame.extend(bytes);
    frame
}

/// A stream of zlib with one block that is stored (RFC 1950, RFC 1951).
fn zlib(bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len() as u16;
    let mut stream = vec![0x78, 0x01, 0x01];
    stream.extend(length.to_le_bytes());
    stream.extend((!length).to_le_bytes());
    stream.extend(bytes);
    let sums = bytes.iter().fold([1_u32, 0], |[a, b], byte| {
        let a = (a + u32::from(*byte)) % 65_521;
        [a, (b + a) % 65_521]
    });
    stream.extend((sums[1] << 16 | sums[0]).to_be_bytes());
    stream
}

#[test]
fn ktx2_of_plain_bytes_is_the_picture_of_the_png() {
    let rgba = picture().into_raw();
    let rgb: Vec<u8> = rgba.chunks(4).flat_map(|of| [of[0], of[1], of[2]]).collect();
    let bgra: Vec<u8> = rgba.chunks(4).flat_map(|of| [of[2], of[1], of[0], of[3]]).collect();
    let compressed = |format, bytes: &[u8]| {
        let [zstandard, zlib] = [zstandard(bytes), zlib(bytes)];
        [
            plain_ktx2(format, bytes),
            with_scheme(plain_ktx2(format, &zstandard), 2),
            with_scheme(plain_ktx2(format, &zlib), 3),
        ]
    };
    for (format, bytes) in [(23, &rgb), (29, &rgb), (37, &rgba), (43, &rgba), (50, &bgra)] {
        for file in compressed(format, bytes) {
            assert!(colors(&file, Some("KHR_texture_basisu")) == rgba, "{format}");
        }
    }
    let red: Vec<u8> = rgba.chunks(4).map(|of| of[0]).collect();
    let expected: Vec<u8> = red.iter().flat_map(|&red| [red, 0, 0, 255]).collect();
    assert!(colors(&plain_ktx2(9, &red), None) == expected);
}

/// A lamp of other programs, whose images are RGB with Zstandard.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn ktx2_of_a_real_lamp_has_no_placeholders() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets");
    let folder = folder.join("AnisotropyBarnLamp");
    for (name, side) in [("normalbump", 1024), ("anisotropy", 512)] {
        let file = folder.join(format!("AnisotropyBarnLamp_{name}.ktx2"));
        let pixels = colors(&std::fs::read(file).expect("an asset"), None);
        assert_eq!(pixels.len(), side * side * 4);
        // A normal map is blue, and directions of fibres are of all kinds.
        let mean = |channel: usize| -> f64 {
            let of = pixels.iter().skip(channel).step_by(4);
            of.map(|value| f64::from(*value)).sum::<f64>() / (side * side) as f64
        };
        println!("{name}: {:?}", [mean(0), mean(1), mean(2)]);
        assert!(mean(2) > 100.0, "{name}");
    }
}

#[test]
fn ktx2_of_another_kind_is_a_placeholder_that_says_so() {
    let whole = ktx2();
    let mut blocks = whole.clone();
    // BC7.
    blocks[12] = 145;
    let mut short = plain_ktx2(37, &picture().into_raw());
    short.truncate(short.len() - 1);
    let mut few = plain_ktx2(23, &[0; 12]);
    few.extend([0; 400]);
    let broken = |scheme| with_scheme(plain_ktx2(37, &[77; 384]), scheme);
    let mut huge = whole.clone();
    huge[20..24].copy_from_slice(&60_000_u32.to_le_bytes());
    for (encoded, part) in [
        (&blocks[..], "KTX2 of Vulkan's format 145, which is not read"),
        (&short[..], "KTX2 that is cut off"),
        (&few[..], "KTX2 of 12 bytes where 12 × 8 pixels take 288"),
        (&broken(1)[..], "of the supercompression 1, which is not read"),
        (&broken(2)[..], "whose Zstandard is broken"),
        (&broken(3)[..], "whose zlib is broken"),
        (&whole[..whole.len() - 20], "KTX2 that can't be decoded"),
        (&huge[..], "at most 16384 pixels a side"),
    ] {
        let (_place, baked, _) = bake_builder(&textured(encoded));
        let notes = baked.warnings.join("\n");
        assert!(notes.contains(part) && notes.contains("placeholder"), "{part}: {notes}");
    }
}

#[test]
fn a_plain_image_comes_before_that_of_an_extension() {
    let grey = png(4, 4, |_, _| [90, 90, 90, 255]);
    let mut builder = textured(&grey);
    builder.image(b"broken");
    builder.json["textures"] =
        json!([{ "source": 0, "extensions": { "EXT_texture_webp": { "source": 1 } } }]);
    let (_place, baked, scene) = bake_builder(&builder);
    assert!(baked.warnings.is_empty(), "{:?}", baked.warnings);
    assert_eq!(scene.textures[0].width, 4);
}

#[test]
fn the_image_of_an_extension_stands_for_a_plain_one_that_cannot_be_read() {
    let webp = encoded(ImageFormat::WebP);
    for (extension, file, plain, reason) in [
        ("EXT_texture_webp", &webp, json!({ "uri": "gone.png" }), "can't be found"),
        ("EXT_texture_webp", &webp, json!({ "uri": "data:image/png;base64,AAAA" }), "called PNG"),
        ("KHR_texture_basisu", &ktx2(), json!({}), "neither uri nor bufferView"),
    ] {
        let mut builder = textured(file);
        builder.json["images"].as_array_mut().expect("a list").push(plain);
        // Exporters of dynamic languages write 0.0.
        let extensions = json!({ extension: { "source": 0.0 } });
        builder.json["textures"] = json!([{ "source": 1, "extensions": extensions }]);
        let (place, baked, scene) = bake_builder(&builder);
        let [note] = &baked.warnings[..] else { panic!("{:?}", baked.warnings) };
        assert!(note.starts_with("images[1]") && note.contains(reason), "{note}");
        assert!(note.contains("images[0] is shown in its place"), "{note}");
        let texture = &scene.textures[0];
        let bytes = place.store.blobs().read(texture.blob).expect("read").expect("there");
        assert!(bytes.starts_with(&picture().into_raw()), "{extension}");
    }
}

#[test]
fn a_texture_of_which_no_image_can_be_read_is_a_placeholder_that_says_why() {
    let mut builder = textured(b"broken");
    builder.image(b"broken, too");
    let by_webp = |source: serde_json::Value| json!({ "EXT_texture_webp": source });
    for (texture, part) in [
        (json!({ "source": 0, "extensions": by_webp(json!({ "source": 1 })) }), "1 more"),
        (json!({ "extensions": by_webp(json!({ "source": 0.5 })) }), "0.5 is not an integer"),
        (json!({ "extensions": by_webp(json!({})) }), "EXT_texture_webp cannot be read"),
    ] {
        builder.json["textures"] = json!([texture]);
        let (_place, baked, _) = bake_builder(&builder);
        let [note] = &baked.warnings[..] else { panic!("{:?}", baked.warnings) };
        assert!(note.contains(part) && note.contains("a placeholder is shown"), "{note}");
    }
}

/// One picture that other programs have written in several ways.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn ktx2_and_webp_of_other_programs_are_one_picture() {
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/assets/gltf-transform/ext");
    let read = |name: &str| colors(&std::fs::read(folder.join(name)).expect("an asset"), None);
    let expected = read("test-lossless.webp");
    for (name, most) in [("test.ktx2", 6.0), ("test-lossy.webp", 6.0)] {
        let other = read(name);
        assert_eq!(other.len(), expected.len(), "{name}");
        let off: u64 = expected.iter().zip(&other).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = off as f64 / expected.len() as f64;
        println!("{name}: {mean:.2} levels");
        assert!(mean < most, "{name}: {mean} levels in the mean");
    }
}
