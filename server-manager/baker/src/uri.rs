//! URIs in a glTF file: data in place, or a relative path.

use super::error::BakeError;

/// The target of a URI.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum UriTarget {
    /// The bytes of a `data:` URI.
    Data(Vec<u8>),
    /// A path relative to the scene file, percent-decoded.
    Path(String),
}

/// Reads a URI that stands at `place`.
pub(super) fn parse(uri: &str, place: &str) -> Result<UriTarget, BakeError> {
    if let Some(rest) = strip_prefix_ignore_case(uri, "data:") {
        return data(rest, place).map(UriTarget::Data);
    }
    if let Some(scheme) = scheme(uri) {
        let what = format!("'{}' would be fetched by {scheme}:", shorten(uri));
        let right = "a file beside the scene, named by a relative path, would be right";
        return Err(BakeError::at(place, what, right));
    }
    let path = String::from_utf8(percent_decode(uri.as_bytes())).ok();
    path.filter(|path| !path.is_empty() && !path.contains('\0')).map(UriTarget::Path).ok_or_else(
        || {
            let what = format!("'{}' is not a path", shorten(uri));
            BakeError::at(place, what, "percent-encoded UTF-8 would be right")
        },
    )
}

/// The start of a URI: messages stay readable, whatever a file holds.
pub(super) fn shorten(uri: &str) -> String {
    const CHARS_MAX: usize = 80;
    match uri.char_indices().nth(CHARS_MAX) {
        Some((end, _)) => format!("{}…", &uri[..end]),
        None => uri.to_owned(),
    }
}

/// The start and the end of a long message that repeats a file's text: its place stands last.
pub(super) fn shorten_middle(message: &str) -> String {
    const SIDE_CHARS: usize = 120;
    let count = message.chars().count();
    if count <= 2 * SIDE_CHARS {
        return message.to_owned();
    }
    let start: String = message.chars().take(SIDE_CHARS).collect();
    let end: String = message.chars().skip(count - SIDE_CHARS).collect();
    format!("{start}…{end}")
}

fn strip_prefix_ignore_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let head = text.get(..prefix.len())?;
    head.eq_ignore_ascii_case(prefix).then(|| &text[prefix.len()..])
}

/// The scheme of RFC 3986, if there is one: a letter, then letters, digits, `+`, `-` or `.`.
fn scheme(uri: &str) -> Option<&str> {
    let (scheme, _) = uri.split_once(':')?;
    let starts = scheme.starts_with(|c: char| c.is_ascii_alphabetic());
    let goes_on = scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    (starts && goes_on).then_some(scheme)
}

fn data(rest: &str, place: &str) -> Result<Vec<u8>, BakeError> {
    let Some((head, body)) = rest.split_once(',') else {
        let right = "data:MEDIATYPE;base64,... would be right";
        return Err(BakeError::at(place, "the data: URI has no comma", right));
    };
    let raw = percent_decode(body.as_bytes());
    let is_base64 = head.rsplit(';').next().is_some_and(|end| end.eq_ignore_ascii_case("base64"));
    if !is_base64 {
        return Ok(raw);
    }
    base64_decode(&raw).ok_or_else(|| {
        let what = "the data: URI is not base64, or ends too early";
        BakeError::at(place, what, "letters, digits, + and /, in fours, would be right")
    })
}

/// Bytes with every `%XX` replaced; what is not such an escape stays as it is.
fn percent_decode(bytes: &[u8]) -> Vec<u8> {
    let digit = |at: usize| bytes.get(at).and_then(|&b| (b as char).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        if let (b'%', Some(high), Some(low)) = (byte, digit(at + 1), digit(at + 2)) {
            out.push((high * 16 + low) as u8);
            at += 3;
        } else {
            out.push(byte);
            at += 1;
        }
    }
    out
}

/// The bytes that standard or URL-safe base64 stands for; white space is skipped.
fn base64_decode(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut held) = (0u32, 0u32);
    let mut padded = false;
    for &byte in text {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => {
                padded = true;
                continue;
            }
            b' ' | b'\t' | b'\r' | b'\n' => continue,
            _ => return None,
        };
        if padded {
            return None;
        }
        bits = bits << 6 | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
            bits &= (1 << held) - 1;
        }
    }
    // Six bits left over are half of a byte: something was cut off.
    (held < 6).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_messages_keep_both_ends() {
        assert_eq!(shorten_middle("short"), "short");
        let long = shorten_middle(&format!("invalid type {}at line 1", "ü".repeat(9_999)));
        assert!(long.chars().count() < 250, "{long}");
        assert!(long.starts_with("invalid type ü") && long.ends_with("üat line 1"), "{long}");
    }

    #[test]
    fn base64_and_percent() {
        let read = |uri: &str| parse(uri, "buffers[0]").ok();
        let bytes = |bytes: &[u8]| Some(UriTarget::Data(bytes.to_vec()));
        assert_eq!(read("data:application/octet-stream;base64,aGVsbG8="), bytes(b"hello"));
        assert_eq!(read("data:;base64,aGVsbG8"), bytes(b"hello"));
        assert_eq!(read("DATA:text/plain,a%20b%2"), bytes(b"a b%2"));
        assert_eq!(read("data:;base64,aGV*"), None);
        assert_eq!(read("data:;base64,aGVsb"), None);
        assert_eq!(read("a%20b/c.bin"), Some(UriTarget::Path("a b/c.bin".into())));
        assert_eq!(read("https://example.org/a.bin"), None);
        assert_eq!(read("%ff.bin"), None);
    }
}
