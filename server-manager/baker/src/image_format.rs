//! Names of image formats: by the first bytes, else by what the file says of itself.

/// The name of the format that these first bytes belong to.
pub(super) fn of_bytes(bytes: &[u8]) -> Option<&'static str> {
    const BY_MAGIC: [(&[u8], &str); 21] = [
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"\xff\xd8\xff", "JPEG"),
        (b"GIF8", "GIF"),
        (b"BM", "BMP"),
        (b"\xabKTX 20\xbb", "KTX2"),
        (b"\xabKTX 11\xbb", "KTX"),
        (b"II*\0", "TIFF"),
        (b"MM\0*", "TIFF"),
        (b"DDS ", "DDS"),
        (b"sB", "Basis Universal"),
        (b"\xff\x0a", "JPEG XL"),
        (b"\0\0\0\x0cJXL ", "JPEG XL"),
        (b"\0\0\0\x0cjP  ", "JPEG 2000"),
        (b"\x76\x2f\x31\x01", "OpenEXR"),
        (b"#?R", "Radiance HDR"),
        (b"8BPS", "PSD"),
        (b"qoif", "QOI"),
        (b"%PDF", "PDF"),
        (b"version https://git-lfs", "a pointer of Git LFS, of which the file was not fetched"),
        (b"\0\0\x01\0", "ICO"),
        (b"gimp xcf", "XCF"),
    ];
    if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return Some("WebP");
    }
    if bytes.get(4..8) == Some(b"ftyp") {
        return Some(match bytes.get(8..12) {
            Some(b"avif" | b"avis") => "AVIF",
            Some(b"heic" | b"heix" | b"mif1" | b"msf1") => "HEIC",
            _ => "MP4",
        });
    }
    let text = bytes.trim_ascii_start().get(..5).unwrap_or_default().to_ascii_lowercase();
    if text.starts_with(b"<svg") {
        return Some("SVG");
    }
    if matches!(&text[..], b"<html" | b"<!doc") {
        return Some("HTML");
    }
    if text.starts_with(b"<?xml") {
        return Some("XML, perhaps SVG");
    }
    BY_MAGIC.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, name)| *name)
}

/// The name of the format that a media type or the end of a file's name stands for.
pub(super) fn of_name(mime_type: Option<&str>, uri: Option<&str>) -> Option<String> {
    let of_mime = mime_type.map(|mime| mime.strip_prefix("image/").unwrap_or(mime));
    let path = uri.filter(|uri| !uri.starts_with("data:"));
    let path = path.map(|uri| uri.split(['?', '#']).next().unwrap_or(uri));
    let name = path.and_then(|path| path.rsplit(['/', '\\']).next());
    let of_name = name.and_then(|name| name.rsplit_once('.')).map(|(_, end)| end);
    let of_data = uri.and_then(|uri| uri.strip_prefix("data:image/"));
    let of_data = of_data.and_then(|rest| rest.split([';', ',']).next());
    let known = of_mime.or(of_name).or(of_data)?.to_ascii_lowercase();
    let known = known.strip_prefix("x-").unwrap_or(&known);
    Some(match known {
        "png" => "PNG".to_owned(),
        "jpg" | "jpeg" => "JPEG".to_owned(),
        "gif" => "GIF".to_owned(),
        "bmp" | "ms-bmp" => "BMP".to_owned(),
        "webp" => "WebP".to_owned(),
        "ktx2" => "KTX2".to_owned(),
        "ktx" => "KTX".to_owned(),
        "avif" => "AVIF".to_owned(),
        "tif" | "tiff" => "TIFF".to_owned(),
        "tga" | "targa" => "TGA".to_owned(),
        "dds" | "vnd-ms.dds" => "DDS".to_owned(),
        "exr" => "OpenEXR".to_owned(),
        "hdr" | "vnd.radiance" => "Radiance HDR".to_owned(),
        "svg" | "svg+xml" => "SVG".to_owned(),
        "" => return None,
        other => super::uri::shorten(other),
    })
}

/// The format of a texture that names its image only by an extension, with that extension.
pub(super) fn of_extension(name: &str) -> Option<&'static str> {
    Some(match name {
        "KHR_texture_basisu" => "KTX2",
        "EXT_texture_webp" => "WebP",
        "EXT_texture_avif" => "AVIF",
        "MSFT_texture_dds" => "DDS",
        "MOZ_texture_rgbe" => "Radiance HDR",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_known_by_their_first_bytes() {
        for (bytes, name) in [
            (&b"GIF89a"[..], "GIF"),
            (b"BM\x36\0", "BMP"),
            (b"RIFF\x10\0\0\0WEBPVP8 ", "WebP"),
            (b"\xabKTX 20\xbb\r\n\x1a\n", "KTX2"),
            (b"\0\0\0\x20ftypavif\0\0", "AVIF"),
            (b"II*\0\x08\0", "TIFF"),
            (b"MM\0*\0\0", "TIFF"),
            (b"  <svg xmlns", "SVG"),
            (b"<!DOCTYPE html>", "HTML"),
            (b"version https://git-lfs.github.com/spec/v1", "a pointer of Git LFS"),
        ] {
            assert!(of_bytes(bytes).is_some_and(|found| found.starts_with(name)), "{name}");
        }
        assert_eq!(of_bytes(b""), None);
        assert_eq!(of_bytes(b"not an image"), None);
    }

    #[test]
    fn formats_are_known_by_media_type_and_name_where_bytes_say_nothing() {
        let of = |mime, uri| of_name(mime, uri).unwrap_or_default();
        assert_eq!(of(Some("image/ktx2"), None), "KTX2");
        assert_eq!(of(None, Some("a.b/wood%20floor.TGA")), "TGA");
        assert_eq!(of(None, Some("wood.webp?v=2#x")), "WebP");
        assert_eq!(of(None, Some("data:image/avif;base64,AAAA")), "AVIF");
        assert_eq!(of_name(None, Some("folder.d/wood")), None);
        assert_eq!(of_name(None, Some("folder.d\\wood")), None);
        assert_eq!(of_name(None, None), None);
    }
}
