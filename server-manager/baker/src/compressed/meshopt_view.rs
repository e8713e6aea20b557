//! Views of `EXT_meshopt_compression` and `KHR_meshopt_compression`, as their specifications have
//! them; the streams themselves are meshoptimizer's.

use std::sync::atomic::AtomicBool;

use super::super::check;
use super::super::document::MeshoptView;
use super::super::error::BakeError;
use super::super::source::GltfSource;
use super::super::uri;
use super::Room;

/// Largest element of a stream of attributes, in bytes.
const STRIDE_MAX: u64 = 256;

/// Unpacks the views whose buffer has no bytes.
pub(super) fn unpack(
    source: &mut GltfSource,
    room: &mut Room,
    cancel: &AtomicBool,
) -> Result<(), BakeError> {
    for index in 0..source.document.buffer_views.len() {
        let view = &source.document.buffer_views[index];
        let Some(packed) = view.extensions.meshopt() else { continue };
        if source.has_bytes(view.buffer) {
            continue;
        }
        check(cancel)?;
        let place = format!("bufferViews[{index}].extensions.{}", packed.0);
        let stream = Stream::of(packed.1, &place)?;
        let bytes = (stream.count as u64).saturating_mul(stream.stride as u64);
        room.take(bytes, &place)?;
        let encoded = source.packed(source.span_of(stream.view, &place)?, &place)?;
        let unpacked = stream.decode(&encoded).map_err(|what| {
            BakeError::at(&place, what, "a whole stream of meshoptimizer would be right")
        })?;
        let stride = view.byte_stride;
        drop(encoded);
        source.replace_view(index, unpacked, stride);
    }
    Ok(())
}

/// The kind of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// The change of a stream's elements after they are unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StreamFilter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// A stream whose numbers go together.
#[derive(Debug)]
struct Stream {
    /// Buffer, first byte and length.
    view: [u64; 3],
    stride: usize,
    count: usize,
    mode: Mode,
    filter: StreamFilter,
}

impl Stream {
    fn of(json: &MeshoptView, place: &str) -> Result<Self, BakeError> {
        let wrong = |key: &str, what: String, right: &str| {
            Err(BakeError::at(format!("{place}.{key}"), what, right))
        };
        let mode = match json.mode.as_str() {
            "ATTRIBUTES" => Mode::Attributes,
            "TRIANGLES" => Mode::Triangles,
            "INDICES" => Mode::Indices,
            other => {
                let what = format!("there is no '{}'", uri::shorten(other));
                return wrong("mode", what, "ATTRIBUTES, TRIANGLES or INDICES would be right");
            }
        };
        let filter = match json.filter.as_deref() {
            None | Some("NONE") => StreamFilter::None,
            Some("OCTAHEDRAL") => StreamFilter::Octahedral,
            Some("QUATERNION") => StreamFilter::Quaternion,
            Some("EXPONENTIAL") => StreamFilter::Exponential,
            Some("COLOR") => StreamFilter::Color,
            Some(other) => {
                let what = format!("there is no '{}'", uri::shorten(other));
                let right = "NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR would be right";
                return wrong("filter", what, right);
            }
        };
        let stride = json.byte_stride;
        let fits = match (mode, filter) {
            (Mode::Attributes, StreamFilter::None | StreamFilter::Exponential) => {
                stride > 0 && stride <= STRIDE_MAX && stride.is_multiple_of(4)
            }
            (Mode::Attributes, StreamFilter::Octahedral | StreamFilter::Color) => {
                stride == 4 || stride == 8
            }
            (Mode::Attributes, StreamFilter::Quaternion) => stride == 8,
            (_, StreamFilter::None) => stride == 2 || stride == 4,
            _ => return wrong("filter", "indices have none".to_owned(), "NONE would be right"),
        };
        if !fits {
            let what = format!("{stride} bytes do not suit {mode:?} with the filter {filter:?}");
            return wrong("byteStride", what, "what the extension allows would be right");
        }
        if mode == Mode::Triangles && !json.count.is_multiple_of(3) {
            return wrong("count", format!("it is {}", json.count), "triples would be right");
        }
        let Ok(count) = usize::try_from(json.count) else {
            return wrong("count", format!("it is {}", json.count), "less would be right");
        };
        let view = [json.buffer.into(), json.byte_offset, json.byte_length];
        Ok(Self { view, stride: stride as usize, count, mode, filter })
    }

    fn decode(&self, encoded: &[u8]) -> Result<Vec<u8>, String> {
        let mut bytes = match (self.mode, self.stride) {
            (Mode::Attributes, _) => attributes(encoded, self.count, self.stride),
            (Mode::Triangles, 2) => meshopt::decode_index_buffer::<u16>(encoded, self.count)
                .map(|indices| indices.into_iter().flat_map(u16::to_le_bytes).collect()),
            (Mode::Triangles, _) => meshopt::decode_index_buffer::<u32>(encoded, self.count)
                .map(|indices| indices.into_iter().flat_map(u32::to_le_bytes).collect()),
            (Mode::Indices, 2) => meshopt::decode_index_sequence::<u16>(encoded, self.count)
                .map(|indices| indices.into_iter().flat_map(u16::to_le_bytes).collect()),
            (Mode::Indices, _) => meshopt::decode_index_sequence::<u32>(encoded, self.count)
                .map(|indices| indices.into_iter().flat_map(u32::to_le_bytes).collect()),
        }
        .map_err(|error| format!("it can't be unpacked: {error}"))?;
        self.undo_filter(&mut bytes);
        Ok(bytes)
    }

    fn undo_filter(&self, bytes: &mut [u8]) {
        match (self.filter, self.stride) {
            (StreamFilter::None, _) => {}
            (StreamFilter::Octahedral, 4) => bytewise(bytes, meshopt::decode_filter_oct::<i8>),
            (StreamFilter::Octahedral, _) => wordwise(bytes, meshopt::decode_filter_oct::<i16>),
            (StreamFilter::Quaternion, _) => wordwise(bytes, meshopt::decode_filter_quat),
            (StreamFilter::Color, 4) => {
                let mut rows: Vec<[u8; 4]> = bytes.as_chunks::<4>().0.to_vec();
                meshopt::decode_filter_color(&mut rows);
                bytes.copy_from_slice(rows.as_flattened());
            }
            (StreamFilter::Color, _) => wordwise(bytes, |rows: &mut [[i16; 4]]| {
                let mut colors: Vec<[u16; 4]> =
                    rows.iter().map(|row| row.map(i16::cast_unsigned)).collect();
                meshopt::decode_filter_color(&mut colors);
                for (row, color) in rows.iter_mut().zip(colors) {
                    *row = color.map(u16::cast_signed);
                }
            }),
            (StreamFilter::Exponential, _) => {
                let words = bytes.as_chunks::<4>().0.iter();
                let mut words: Vec<[u32; 1]> =
                    words.map(|word| [u32::from_le_bytes(*word)]).collect();
                meshopt::decode_filter_exp(&mut words);
                for (bytes, [word]) in bytes.chunks_exact_mut(4).zip(words) {
                    bytes.copy_from_slice(&word.to_le_bytes());
                }
            }
        }
    }
}

/// Calls a function with elements of four signed bytes.
fn bytewise(bytes: &mut [u8], decode: impl Fn(&mut [[i8; 4]])) {
    let rows = bytes.as_chunks::<4>().0.iter();
    let mut rows: Vec<[i8; 4]> = rows.map(|row| row.map(u8::cast_signed)).collect();
    decode(&mut rows);
    for (byte, value) in bytes.iter_mut().zip(rows.as_flattened()) {
        *byte = value.cast_unsigned();
    }
}

/// Calls a function with elements of four signed words, which are little-endian.
fn wordwise(bytes: &mut [u8], decode: impl Fn(&mut [[i16; 4]])) {
    let words: Vec<i16> =
        bytes.as_chunks::<2>().0.iter().map(|word| i16::from_le_bytes(*word)).collect();
    let mut rows: Vec<[i16; 4]> = words.as_chunks::<4>().0.to_vec();
    decode(&mut rows);
    for (bytes, value) in bytes.chunks_exact_mut(2).zip(rows.as_flattened()) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
}

/// An element of `N` bytes.
#[derive(Clone, Debug)]
struct Row<const N: usize>([u8; N]);

impl<const N: usize> Default for Row<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

fn rows<const N: usize>(encoded: &[u8], count: usize) -> meshopt::Result<Vec<u8>> {
    let rows: Vec<Row<N>> = meshopt::decode_vertex_buffer(encoded, count)?;
    Ok(rows.iter().flat_map(|row| row.0).collect())
}

/// Elements of `stride` bytes, a multiple of 4 up to [`STRIDE_MAX`]: the library takes the size of
/// an element from its type.
fn attributes(encoded: &[u8], count: usize, stride: usize) -> meshopt::Result<Vec<u8>> {
    macro_rules! by_stride {
        ($($words:literal)*) => {
            match stride / 4 {
                $($words => rows::<{ $words * 4 }>(encoded, count),)*
                _ => Ok(Vec::new()),
            }
        };
    }
    by_stride!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62
        63 64
    )
}
