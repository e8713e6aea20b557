//! Binary glTF files (glTF 2.0, section 4.4) as they are written.
//!
//! The binary part goes out as it comes, so it may be larger than memory; the JSON, which stands
//! before it in a file, is known only at the end.

mod extension_json;
mod material_json;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{self, Write};

use glam::Vec3;

pub use material_json::{is_decomposable, material_json};

/// Maximum size of the JSON, in bytes: what the baker reads of a file.
pub const JSON_BYTES_MAX: usize = 256 << 20;

/// Maximum size of a file, in bytes: its head counts them in 32 bits.
pub const FILE_BYTES_MAX: u64 = u32::MAX as u64;

/// A list of JSON values, as text.
#[derive(Clone, Debug, Default)]
pub struct JsonList {
    text: String,
    len: u32,
}

impl JsonList {
    /// Appends a value; returns its index.
    pub fn push(&mut self, value: &str) -> u32 {
        if self.len > 0 {
            self.text.push(',');
        }
        self.text.push_str(value);
        self.len += 1;
        self.len - 1
    }

    /// Returns an object that has the list under this key; an empty one if the list is.
    pub fn as_member(&self, key: &str) -> String {
        if self.is_empty() { "{}".to_owned() } else { format!(r#"{{"{key}":[{}]}}"#, self.text) }
    }

    /// The number of values.
    pub fn len(&self) -> u32 {
        self.len
    }

    /// Returns whether it has no values.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// The use of a part of the binary data, which viewers upload by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewTarget {
    /// Vertices that are this number of bytes apart: a multiple of 4 from 4 to 252.
    Vertices(u32),
    /// Indices.
    Indices,
    /// None: a picture, or one value for each instance.
    Other,
}

/// Values in a part of the binary data.
#[derive(Clone, Copy, Debug)]
pub struct AccessorDesc {
    /// The part.
    pub view: u32,
    /// The place of the first value in it, in bytes.
    pub offset: u32,
    /// The type of each number.
    pub component: Component,
    /// The number of values.
    pub count: u32,
    /// Numbers in each value: 1 to 4.
    pub width: u32,
    /// The least and greatest of all values, which positions need.
    pub bounds: Option<(Vec3, Vec3)>,
}

/// A type of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// 16 bits without a sign.
    U16,
    /// 32 bits without a sign.
    U32,
    /// 32 bits, floating point.
    F32,
}

/// A binary glTF file under way, whose binary part goes to `W`.
#[derive(Debug)]
pub struct GlbWriter<W> {
    binary: W,
    length: u64,
    views: JsonList,
    accessors: JsonList,
    extensions: BTreeSet<&'static str>,
}

impl<W: Write> GlbWriter<W> {
    /// A file without anything.
    pub fn new(binary: W) -> Self {
        let (views, accessors) = (JsonList::default(), JsonList::default());
        Self { binary, length: 0, views, accessors, extensions: BTreeSet::new() }
    }

    /// Appends bytes, on a multiple of four; returns the index of their view.
    ///
    /// # Errors
    /// The error of the binary part, or a file that becomes too large.
    pub fn view(&mut self, target: ViewTarget, bytes: &[u8]) -> io::Result<u32> {
        self.align()?;
        let (offset, length) = (self.length, bytes.len());
        self.length += length as u64;
        if self.length > FILE_BYTES_MAX {
            return Err(too_large());
        }
        self.binary.write_all(bytes)?;
        let target = match target {
            ViewTarget::Vertices(stride) => format!(r#","byteStride":{stride},"target":34962"#),
            ViewTarget::Indices => r#","target":34963"#.to_owned(),
            ViewTarget::Other => String::new(),
        };
        let view = format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}{target}}}"#);
        Ok(self.views.push(&view))
    }

    /// Describes values of a view; returns the index of their accessor.
    pub fn accessor(&mut self, of: &AccessorDesc) -> u32 {
        let AccessorDesc { view, offset, component, count, width, bounds } = of;
        let component = match component {
            Component::U16 => 5123,
            Component::U32 => 5125,
            Component::F32 => 5126,
        };
        let kind = if *width == 1 { "SCALAR".to_owned() } else { format!("VEC{width}") };
        let bounds = bounds.map_or_else(String::new, |(min, max)| {
            format!(r#","min":{:?},"max":{:?}"#, min.to_array(), max.to_array())
        });
        let place = format!(r#""bufferView":{view},"byteOffset":{offset}"#);
        let values = format!(r#""componentType":{component},"count":{count},"type":"{kind}""#);
        self.accessors.push(&format!("{{{place},{values}{bounds}}}"))
    }

    /// Appends rows of floats as a view of their own; returns the index of their accessor.
    ///
    /// # Errors
    /// Those of [`GlbWriter::view`].
    pub fn floats<const N: usize>(
        &mut self,
        is_of_vertices: bool,
        rows: impl Iterator<Item = [f32; N]>,
        bounds: Option<(Vec3, Vec3)>,
    ) -> io::Result<u32> {
        let bytes: Vec<u8> = rows.flatten().flat_map(f32::to_le_bytes).collect();
        let (width, row) = (N as u32, N * size_of::<f32>());
        let target =
            if is_of_vertices { ViewTarget::Vertices(row as u32) } else { ViewTarget::Other };
        let (count, component) = ((bytes.len() / row) as u32, Component::F32);
        let view = self.view(target, &bytes)?;
        Ok(self.accessor(&AccessorDesc { view, offset: 0, component, count, width, bounds }))
    }

    /// Appends a picture, the bytes of a PNG or JPEG file; returns the value of its image.
    ///
    /// # Errors
    /// Those of [`GlbWriter::view`].
    pub fn picture(&mut self, file: &[u8]) -> io::Result<String> {
        let kind = if file.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
        let view = self.view(ViewTarget::Other, file)?;
        Ok(format!(r#"{{"bufferView":{view},"mimeType":"{kind}"}}"#))
    }

    /// Notes that the file uses an extension.
    pub fn use_extension(&mut self, name: &'static str) -> &'static str {
        self.extensions.insert(name);
        name
    }

    /// Ends the file: `lists` by their keys, and the value of `extensions` if there is one.
    /// Returns what stands before the binary part, and the binary part.
    ///
    /// # Errors
    /// Those of [`GlbWriter::view`].
    pub fn finish(
        mut self,
        lists: &[(&str, &JsonList)],
        extensions: Option<&str>,
    ) -> io::Result<(Vec<u8>, W)> {
        self.align()?;
        self.binary.flush()?;
        let mut json = r#"{"asset":{"version":"2.0","generator":"Polyptych"},"scene":0"#.to_owned();
        let names: Vec<String> = self.extensions.iter().map(|name| quoted(name)).collect();
        if !names.is_empty() {
            let _ = write!(json, r#","extensionsUsed":[{}]"#, names.join(","));
        }
        if let Some(extensions) = extensions {
            let _ = write!(json, r#","extensions":{extensions}"#);
        }
        if self.length > 0 {
            let _ = write!(json, r#","buffers":[{{"byteLength":{}}}]"#, self.length);
        }
        let own = [("bufferViews", &self.views), ("accessors", &self.accessors)];
        for (key, list) in own.iter().chain(lists).filter(|(_, list)| !list.is_empty()) {
            let _ = write!(json, r#","{key}":[{}]"#, list.text);
        }
        json.push('}');
        let padding = json.len().next_multiple_of(4) - json.len();
        json.extend(std::iter::repeat_n(' ', padding));
        // A chunk of nothing is left out.
        let binary_head = if self.length > 0 { 8 } else { 0 };
        let total = 12 + 8 + json.len() as u64 + binary_head + self.length;
        if total > FILE_BYTES_MAX || json.len() > JSON_BYTES_MAX {
            return Err(too_large());
        }
        let mut head = Vec::with_capacity(json.len() + 28);
        let word = |head: &mut Vec<u8>, word: u64| head.extend((word as u32).to_le_bytes());
        head.extend(b"glTF");
        word(&mut head, 2);
        word(&mut head, total);
        word(&mut head, json.len() as u64);
        head.extend(b"JSON");
        head.extend(json.as_bytes());
        if self.length > 0 {
            word(&mut head, self.length);
            head.extend(b"BIN\0");
        }
        Ok((head, self.binary))
    }

    fn align(&mut self) -> io::Result<()> {
        let aligned = self.length.next_multiple_of(4);
        self.binary.write_all(&[0; 4][..(aligned - self.length) as usize])?;
        self.length = aligned;
        Ok(())
    }
}

fn too_large() -> io::Error {
    io::Error::other(format!(
        "it is larger than a GLB file can be: {FILE_BYTES_MAX} bytes, of them {JSON_BYTES_MAX} of \
         JSON; make it in parts"
    ))
}

/// A text as JSON has it (RFC 8259, section 7).
pub fn quoted(text: &str) -> String {
    let mut json = String::with_capacity(text.len() + 2);
    json.push('"');
    for letter in text.chars() {
        match letter {
            '"' | '\\' => json.extend(['\\', letter]),
            '\0'..='\x1f' => {
                let _ = write!(json, "\\u{:04x}", u32::from(letter));
            }
            _ => json.push(letter),
        }
    }
    json.push('"');
    json
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_the_form_of_the_standard() {
        let mut file = GlbWriter::new(Vec::new());
        file.use_extension("KHR_lights_punctual");
        file.view(ViewTarget::Indices, &[1, 2, 3]).expect("memory");
        let positions = [[0.5, 1e-7, -3.0], [1.0, 2.0, 3e20]];
        let bounds = Some((Vec3::ZERO, Vec3::ONE));
        file.floats(true, positions.into_iter(), bounds).expect("memory");
        let mut nodes = JsonList::default();
        assert_eq!((nodes.push("{}"), nodes.push("{}"), nodes.len()), (0, 1, 2));
        let lists = [("nodes", &nodes), ("meshes", &JsonList::default())];
        let (head, binary) = file.finish(&lists, Some("{}")).expect("memory");
        assert_eq!((binary.len(), binary[3], binary.len() % 4), (28, 0, 0));
        let json = std::str::from_utf8(&head[20..head.len() - 8]).expect("text").trim_end();
        assert_eq!(
            json,
            "{\"asset\":{\"version\":\"2.0\",\"generator\":\"Polyptych\"},\"scene\":0,\
             \"extensionsUsed\":[\"KHR_lights_punctual\"],\"extensions\":{},\
             \"buffers\":[{\"byteLength\":28}],\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\
             \"byteLength\":3,\"target\":34963},{\"buffer\":0,\"byteOffset\":4,\
             \"byteLength\":24,\"byteStride\":12,\"target\":34962}],\"accessors\":[{\
             \"bufferView\":1,\"byteOffset\":0,\"componentType\":5126,\"count\":2,\
             \"type\":\"VEC3\",\"min\":[0.0, 0.0, 0.0],\"max\":[1.0, 1.0, 1.0]}],\
             \"nodes\":[{},{}]}"
        );
        let words =
            |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        assert_eq!((&head[..4], words(4)), (&b"glTF"[..], 2));
        assert_eq!(words(8) as usize, head.len() + binary.len());
        assert_eq!((words(12) as usize, &head[16..20]), (head.len() - 28, &b"JSON"[..]));
        assert_eq!(&head[head.len() - 8..], b"\x1c\0\0\0BIN\0");
    }

    #[test]
    fn texts_are_escaped() {
        assert_eq!(quoted("a \"b\"\\\n\u{1}ü\u{7f}"), "\"a \\\"b\\\"\\\\\\u000a\\u0001ü\u{7f}\"");
    }

    #[test]
    fn a_file_beyond_32_bits_is_refused() {
        struct Nowhere;
        impl Write for Nowhere {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                Ok(bytes.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let mut file = GlbWriter::new(Nowhere);
        let block = vec![0; 1 << 28];
        let mut blocks = 0;
        let error = loop {
            match file.view(ViewTarget::Other, &block) {
                Ok(_) => blocks += 1,
                Err(error) => break error.to_string(),
            }
        };
        assert!(blocks == 15 && error.contains("4294967295 bytes"), "{blocks}: {error}");
    }
}
