//! Accessors: typed values out of raw bytes.
//!
//! Every bound is checked in u64 before a byte is read, and nothing is allocated for a count
//! before as many bytes are known to be there.

use polyptych_text::counted;

use super::buffer::ByteSpan;
use super::error::BakeError;
use super::source::GltfSource;
use super::source_file::READ_BYTES;

/// Most elements of an accessor that has no bytes of its own (all zeros, perhaps with some
/// replaced): larger counts would be memory for nothing.
pub(super) const ZEROS_MAX: u64 = 1 << 22;

/// Largest number of bytes from one element to the next, rounded up; glTF allows no more than 252.
const STRIDE_USUAL: u64 = 256;

/// The type of a component in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(number: u32, place: &str) -> Result<Self, BakeError> {
        Ok(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => {
                let what = format!("componentType {number} does not exist");
                let right = "5120 to 5123, 5125 or 5126 would be right";
                return Err(BakeError::at(place, what, right));
            }
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The value at the front of `bytes`; glTF 2.0, 3.6.2.2 says how integers are normalised.
    fn float(self, bytes: &[u8], normalized: bool) -> f32 {
        let (value, range) = match (self, bytes) {
            (Self::I8, [a, ..]) => (f32::from(*a as i8), 127.0),
            (Self::U8, [a, ..]) => (f32::from(*a), 255.0),
            (Self::I16, [a, b, ..]) => (f32::from(i16::from_le_bytes([*a, *b])), 32767.0),
            (Self::U16, [a, b, ..]) => (f32::from(u16::from_le_bytes([*a, *b])), 65535.0),
            (Self::U32, [a, b, c, d, ..]) => (u32::from_le_bytes([*a, *b, *c, *d]) as f32, 1.0),
            (Self::F32, [a, b, c, d, ..]) => return f32::from_le_bytes([*a, *b, *c, *d]),
            _ => (0.0, 1.0),
        };
        if normalized { (value / range).max(-1.0) } else { value }
    }

    fn index(self, bytes: &[u8]) -> u32 {
        match (self, bytes) {
            (Self::U8, [a, ..]) => u32::from(*a),
            (Self::U16, [a, b, ..]) => u32::from(u16::from_le_bytes([*a, *b])),
            (Self::U32, [a, b, c, d, ..]) => u32::from_le_bytes([*a, *b, *c, *d]),
            _ => 0,
        }
    }

    /// The index that ends a strip, fan or loop.
    fn restart(self) -> u32 {
        match self {
            Self::U8 => 0xff,
            Self::U16 => 0xffff,
            _ => 0xffff_ffff,
        }
    }
}

/// Returns whether an accessor has values of its own: without, all are 0 by glTF's rules, which is
/// what files have whose data only an extension holds.
pub(super) fn has_data(source: &GltfSource, index: u32) -> bool {
    let json = source.document.accessors.get(index as usize);
    json.is_none_or(|json| json.buffer_view.is_some() || json.sparse.is_some())
}

/// Elements that lie in bytes, one every `stride`.
#[derive(Clone, Copy, Debug)]
struct Elements<'a> {
    bytes: ByteSpan<'a>,
    /// Bytes of an element.
    size: usize,
    /// At least `size`.
    stride: usize,
    count: usize,
}

impl Elements<'_> {
    /// Reads all of them, of a file some at a time.
    fn read<T>(&self, place: &str, read: impl Fn(&[u8]) -> T) -> Result<Vec<T>, BakeError> {
        let mut out = Vec::with_capacity(self.count);
        let step = (READ_BYTES / self.stride).max(1);
        let mut rest = self.bytes;
        while out.len() < self.count {
            let count = step.min(self.count - out.len());
            let (run, others) = rest.split((count * self.stride) as u64);
            // Without what lies between the last element and the next one.
            let (run, _) = run.split(((count - 1) * self.stride + self.size) as u64);
            let bytes = run.bytes(place)?;
            out.extend((0..count).map(|at| read(bytes.get(at * self.stride..).unwrap_or(&[]))));
            rest = others;
        }
        Ok(out)
    }
}

#[derive(Clone, Debug)]
struct Sparse<'a> {
    /// Those of the replaced elements.
    indices: Vec<u32>,
    values: Elements<'a>,
}

/// An accessor whose bytes are all there.
#[derive(Clone, Debug)]
pub(super) struct Accessor<'a> {
    /// Its JSON path, for messages.
    pub place: String,
    /// Number of elements.
    pub count: usize,
    /// Number of components of an element.
    pub width: usize,
    component: Component,
    normalized: bool,
    base: Option<Elements<'a>>,
    sparse: Option<Sparse<'a>>,
}

/// Indices, and the one that stands for a restart.
#[derive(Clone, Debug)]
pub(super) struct Indices {
    pub values: Vec<u32>,
    pub restart: u32,
}

impl<'a> Accessor<'a> {
    /// Checks the accessor that `used_at` points at.
    pub(super) fn open(
        source: &'a GltfSource,
        index: u32,
        used_at: &str,
    ) -> Result<Self, BakeError> {
        let json = source.document.accessors.at(index, used_at)?;
        let place = format!("accessors[{index}]");
        let component = Component::of(json.component_type, &place)?;
        let width = match json.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" | "MAT2" => 4,
            "MAT3" => 9,
            "MAT4" => 16,
            other => {
                let what = format!("type '{}' does not exist", super::uri::shorten(other));
                return Err(BakeError::at(place, what, "SCALAR, VEC2 … MAT4 would be right"));
            }
        };
        let size = component.size() * width;
        let base = match json.buffer_view {
            None if json.count > ZEROS_MAX => {
                let what = format!("{} without a bufferView", counted(json.count, "element"));
                return Err(BakeError::at(place, what, format!("at most {ZEROS_MAX} can be zero")));
            }
            None => None,
            Some(view) => Some(elements(source, view, json.byte_offset, size, json.count, &place)?),
        };
        let sparse = match &json.sparse {
            None => None,
            Some(sparse) => Some(open_sparse(source, sparse, size, json.count, &place)?),
        };
        source.reserve_elements(json.count, &place)?;
        let count = json.count as usize;
        Ok(Self { place, count, width, component, normalized: json.normalized, base, sparse })
    }

    /// All elements as floats.
    pub(super) fn floats<const N: usize>(&self) -> Result<Vec<[f32; N]>, BakeError> {
        if self.width != N || self.component == Component::U32 {
            let names = ["SCALAR", "VEC2", "VEC3", "VEC4"];
            let right = names.get(N - 1).copied().unwrap_or("MAT4");
            let what = format!("{} components of {:?} in an element", self.width, self.component);
            let right = format!("{right} of float, or of 8- or 16-bit integers, would be right");
            return Err(BakeError::at(&self.place, what, right));
        }
        let size = self.component.size();
        let read = |bytes: &[u8]| {
            std::array::from_fn(|i| match bytes.get(i * size..) {
                Some(bytes) => self.component.float(bytes, self.normalized),
                None => 0.0,
            })
        };
        self.elements([0.0; N], read)
    }

    /// All elements as colours with alpha; where they have none, it is this number.
    pub(super) fn colors(&self, alpha: f32) -> Result<Vec<[f32; 4]>, BakeError> {
        if self.width != 3 {
            return self.floats::<4>();
        }
        let colors = self.floats::<3>()?.into_iter();
        Ok(colors.map(|[r, g, b]| [r, g, b, alpha]).collect())
    }

    /// All elements as unsigned integers.
    pub(super) fn unsigned<const N: usize>(&self) -> Result<Vec<[u32; N]>, BakeError> {
        let is_unsigned = [Component::U8, Component::U16, Component::U32].contains(&self.component);
        if self.width != N || !is_unsigned {
            let what = format!("{} components of {:?} in an element", self.width, self.component);
            let right = format!("{N} unsigned 8- or 16-bit integers would be right");
            return Err(BakeError::at(&self.place, what, right));
        }
        let size = self.component.size();
        let read = |bytes: &[u8]| {
            std::array::from_fn(|i| bytes.get(i * size..).map_or(0, |b| self.component.index(b)))
        };
        self.elements([0; N], read)
    }

    /// All elements as indices.
    pub(super) fn indices(&self) -> Result<Indices, BakeError> {
        let unsigned = [Component::U8, Component::U16, Component::U32].contains(&self.component);
        if !unsigned || self.width != 1 {
            let what = format!("{} components of {:?} in an index", self.width, self.component);
            let right = "SCALAR of unsigned 8-, 16- or 32-bit integers would be right";
            return Err(BakeError::at(&self.place, what, right));
        }
        let values = self.elements(0, |bytes| self.component.index(bytes))?;
        Ok(Indices { values, restart: self.component.restart() })
    }

    fn elements<T: Clone>(&self, zero: T, read: impl Fn(&[u8]) -> T) -> Result<Vec<T>, BakeError> {
        let mut out = match &self.base {
            Some(base) => base.read(&self.place, &read)?,
            None => vec![zero; self.count],
        };
        if let Some(Sparse { indices, values }) = &self.sparse {
            for (index, value) in indices.iter().zip(values.read(&self.place, &read)?) {
                if let Some(slot) = out.get_mut(*index as usize) {
                    *slot = value;
                }
            }
        }
        Ok(out)
    }
}

fn open_sparse<'a>(
    source: &'a GltfSource,
    sparse: &super::document::Sparse,
    size: usize,
    count: u64,
    place: &str,
) -> Result<Sparse<'a>, BakeError> {
    let place = format!("{place}.sparse");
    if sparse.count > count {
        let what = format!("it replaces {} of {count} elements", sparse.count);
        return Err(BakeError::at(place, what, format!("at most {count} would be right")));
    }
    let index = Component::of(sparse.indices.component_type, &place)?;
    if ![Component::U8, Component::U16, Component::U32].contains(&index) {
        let what = format!("its indices are {index:?}");
        return Err(BakeError::at(place, what, "unsigned integers would be right"));
    }
    let (at, values) = (&sparse.indices, &sparse.values);
    let indices =
        elements(source, at.buffer_view, at.byte_offset, index.size(), sparse.count, &place)?;
    let values =
        elements(source, values.buffer_view, values.byte_offset, size, sparse.count, &place)?;
    let indices = indices.read(&place, |bytes| index.index(bytes))?;
    match indices.iter().position(|at| u64::from(*at) >= count) {
        None => Ok(Sparse { indices, values }),
        Some(i) => {
            let what = format!("index {i} is {}", indices[i]);
            Err(BakeError::at(place, what, format!("below {count} would be right")))
        }
    }
}

/// The place of `count` elements of `size` bytes each, checked to lie inside the view.
fn elements<'a>(
    source: &'a GltfSource,
    view: u32,
    offset: u64,
    size: usize,
    count: u64,
    place: &str,
) -> Result<Elements<'a>, BakeError> {
    let (json, bytes) = source.view(view, place)?;
    let stride = json.byte_stride.unwrap_or(size as u64);
    if stride < size as u64 {
        let what = format!("byteStride {stride} is less than an element of bufferViews[{view}]");
        return Err(BakeError::at(place, what, format!("at least {size} would be right")));
    }
    let span = match count {
        0 => Some(0),
        _ => (count - 1).checked_mul(stride).and_then(|span| span.checked_add(size as u64)),
    };
    let Some(bytes) = span.and_then(|span| bytes.part(offset, span)) else {
        let what = format!(
            "{count} elements of {size} bytes, {stride} apart, from {offset} on reach out of \
             bufferViews[{view}]"
        );
        return Err(BakeError::at(place, what, format!("the view has {} bytes", bytes.length)));
    };
    if stride > STRIDE_USUAL {
        // Bytes between elements are read too.
        source.reserve_elements(bytes.length / STRIDE_USUAL, place)?;
    }
    Ok(Elements { bytes, size, stride: stride as usize, count: count as usize })
}
