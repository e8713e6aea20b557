//! The files of a scene: the glTF itself, its buffers and its images.
//!
//! Foreign files name other files. What they name is followed only inside the folder of the
//! scene, after symlinks are resolved, and only as far as the named limits.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use polyptych_files::blob::BlobHash;
use polyptych_text::counted;

use super::buffer::{Buffer, ByteSpan};
use super::document::{BufferView, Document, ViewExtensions};
use super::error::BakeError;
use super::source_file::{self, SourceFile, SourceFiles};
use super::uri::{self, UriTarget};
use super::{compressed, container};

/// Largest scene file: a GLB's length field ends there.
pub(super) const FILE_BYTES_MAX: u64 = 4 << 30;

/// Largest file of a buffer: hundreds of millions of triangles, and read within minutes.
const BUFFER_BYTES_MAX: u64 = 64 << 30;

/// Largest image file or data: no PNG that decodes within the limits is larger.
pub(super) const IMAGE_BYTES_MAX: u64 = 1 << 30;

/// Bytes of packed views that are read however small the files are.
const PACKED_UNASKED: u64 = 1 << 30;

/// Most times that all bytes of the files are read as packed views beyond that.
const PACKED_PER_BYTE_MAX: u64 = 4;

/// Elements of accessors that are read however small the files are: four of the largest that have
/// no bytes of their own, a few seconds of work.
const ELEMENTS_UNASKED: u64 = 1 << 24;

/// Most elements per byte of the files beyond that. An element takes at least a byte, and parts
/// that share their vertices read them again, hundreds of times in drawings of machines; a small
/// file could ask for hours of it.
const ELEMENTS_PER_BYTE_MAX: u64 = 64;

/// A scene's files. Buffers and images of files stay on disk until they are needed.
#[derive(Debug)]
pub(super) struct GltfSource {
    /// The JSON.
    pub document: Document,
    /// A digest that changes whenever a byte of any of the files changes.
    pub digest: BlobHash,
    /// Bytes of all files and `data:` URIs together.
    pub bytes: u64,
    elements_read: Cell<u64>,
    packed_read: Cell<u64>,
    files: SourceFiles,
    buffers: Vec<Buffer>,
    images: Vec<Image>,
}

#[derive(Debug)]
enum Image {
    File {
        path: PathBuf,
        hash: BlobHash,
    },
    Data(Vec<u8>),
    View(u32),
    /// Cannot be read, for this reason.
    Absent(String),
}

impl GltfSource {
    /// Reads the document of a scene file; hashes the file, its buffers and its images.
    pub(super) fn open(path: &Path, cancel: &AtomicBool) -> Result<Self, BakeError> {
        let path = fs::canonicalize(path).map_err(|error| BakeError::io(path, error))?;
        let folder = path.parent().unwrap_or(Path::new("/")).to_path_buf();
        let files = SourceFiles::default();
        let (file, hash) = SourceFile::open(&files, &path, FILE_BYTES_MAX, "file", cancel)?;
        let mut digest = blake3::Hasher::new();
        digest.update(hash.0.as_slice());
        let (document, chunk) = container::parse(&file)?;
        let mut source = Self {
            document,
            digest: BlobHash([0; 32]),
            bytes: file.length,
            elements_read: Cell::new(0),
            packed_read: Cell::new(0),
            files,
            buffers: Vec::new(),
            images: Vec::new(),
        };
        let chunk = chunk.map(|of| {
            let (first, length) = (of.start, of.end - of.start);
            Buffer::File { file: Arc::new(file), first, length }
        });
        source.open_buffers(&folder, chunk, &mut digest, cancel)?;
        source.open_images(&folder, &mut digest, cancel)?;
        source.digest = BlobHash(*digest.finalize().as_bytes());
        Ok(source)
    }

    fn open_buffers(
        &mut self,
        folder: &Path,
        mut chunk: Option<Buffer>,
        digest: &mut blake3::Hasher,
        cancel: &AtomicBool,
    ) -> Result<(), BakeError> {
        // Each file is hashed once, however many buffers name it.
        let mut known: BTreeMap<PathBuf, (Arc<SourceFile>, BlobHash)> = BTreeMap::new();
        let unpacked = self.document.unpacked_buffers();
        for (i, buffer) in self.document.buffers.iter().enumerate() {
            let place = format!("buffers[{i}]");
            let is_for_unpacked = unpacked.contains(&(i as u32));
            let bytes = match &buffer.uri {
                Some(uri) => match uri::parse(uri, &place)? {
                    UriTarget::Data(bytes) => Buffer::Memory(bytes),
                    UriTarget::Path(path) => {
                        let path = match resolve(folder, &path, uri, &place) {
                            // Without it all of its views are unpacked.
                            Err(_) if is_for_unpacked => {
                                self.buffers.push(Buffer::EMPTY);
                                continue;
                            }
                            path => path?,
                        };
                        let (file, hash) = if let Some((file, hash)) = known.get(&path) {
                            (Arc::clone(file), *hash)
                        } else {
                            let max = BUFFER_BYTES_MAX;
                            let (file, hash) =
                                SourceFile::open(&self.files, &path, max, &place, cancel)?;
                            self.bytes += file.length;
                            let file = Arc::new(file);
                            known.insert(path, (Arc::clone(&file), hash));
                            (file, hash)
                        };
                        digest.update(hash.0.as_slice());
                        Buffer::from(file)
                    }
                },
                None if i == 0 && chunk.is_some() => chunk.take().unwrap_or(Buffer::EMPTY),
                None if is_for_unpacked => {
                    self.buffers.push(Buffer::EMPTY);
                    continue;
                }
                None => {
                    let what = "it has no uri, and the file no binary chunk for it";
                    return Err(BakeError::at(place, what, "a uri would be right"));
                }
            };
            if bytes.length() < buffer.byte_length {
                let what =
                    format!("truncated: there is no more than {}", counted(bytes.length(), "byte"));
                let right = format!("byteLength says {}", buffer.byte_length);
                return Err(BakeError::at(place, what, right));
            }
            self.buffers.push(bytes);
        }
        Ok(())
    }

    fn open_images(
        &mut self,
        folder: &Path,
        digest: &mut blake3::Hasher,
        cancel: &AtomicBool,
    ) -> Result<(), BakeError> {
        // Each file is hashed once, however many images name it.
        let mut known = BTreeMap::new();
        for i in 0..self.document.images.len() {
            let image = self.open_image(folder, i, digest, &mut known, cancel)?;
            if matches!(image, Image::Absent(_)) {
                // Once the image is there, it is another scene.
                digest.update(b"absent");
            }
            self.images.push(image);
        }
        Ok(())
    }

    /// Finds an image. One that is not there, or is no file, leaves a scene that can be shown; one
    /// that leads out of the scene's folder is an error, as of buffers.
    fn open_image(
        &mut self,
        folder: &Path,
        index: usize,
        digest: &mut blake3::Hasher,
        known: &mut BTreeMap<PathBuf, BlobHash>,
        cancel: &AtomicBool,
    ) -> Result<Image, BakeError> {
        let (place, image) = (format!("images[{index}]"), &self.document.images[index]);
        let absent = |error: BakeError| match error {
            BakeError::Cancelled => Err(error),
            _ => Ok(Image::Absent(error.reason())),
        };
        let uri = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => uri,
            (None, Some(view)) => return Ok(Image::View(view)),
            (None, None) => {
                let right = "one of them would be right";
                return absent(BakeError::at(place, "it has neither uri nor bufferView", right));
            }
        };
        let path = match uri::parse(uri, &place) {
            Ok(UriTarget::Data(bytes)) => return Ok(Image::Data(bytes)),
            Ok(UriTarget::Path(path)) => path,
            Err(error) => return absent(error),
        };
        let path = match resolve(folder, &path, uri, &place) {
            Ok(path) => path,
            Err(Unresolved::Outside(error)) => return Err(error),
            Err(Unresolved::Absent(error)) => return absent(error),
        };
        if let Some(&hash) = known.get(&path) {
            digest.update(hash.0.as_slice());
            return Ok(Image::File { path, hash });
        }
        match SourceFile::open(&self.files, &path, IMAGE_BYTES_MAX, &place, cancel) {
            Ok((file, hash)) => {
                self.bytes += file.length;
                digest.update(hash.0.as_slice());
                known.insert(path.clone(), hash);
                Ok(Image::File { path, hash })
            }
            Err(error) => absent(error),
        }
    }

    /// Notes that so many elements will be read, unless that is more than such files can hold.
    pub(super) fn reserve_elements(&self, elements: u64, place: &str) -> Result<(), BakeError> {
        let read = self.elements_read.get().saturating_add(elements);
        let allowed = ELEMENTS_UNASKED + ELEMENTS_PER_BYTE_MAX * self.bytes;
        if read > allowed {
            let what = format!("with it {read} elements would be read from {} bytes", self.bytes);
            return Err(BakeError::at(place, what, format!("at most {allowed} can be")));
        }
        self.elements_read.set(read);
        Ok(())
    }

    /// Reads a view that is packed, and so has to be in memory as a whole.
    ///
    /// # Errors
    /// It is larger than a scene file may be, such views take too much together, or it can't be
    /// read.
    pub(super) fn packed<'a>(
        &self,
        span: ByteSpan<'a>,
        place: &str,
    ) -> Result<Cow<'a, [u8]>, BakeError> {
        let length = span.length;
        if length > FILE_BYTES_MAX {
            let what = format!("its packed bytes are {length}");
            return Err(BakeError::at(place, what, format!("at most {FILE_BYTES_MAX} can be")));
        }
        let read = self.packed_read.get().saturating_add(length);
        let allowed = PACKED_UNASKED.saturating_add(self.bytes.saturating_mul(PACKED_PER_BYTE_MAX));
        if read > allowed {
            let what = format!("with it {read} packed bytes would be read");
            return Err(BakeError::at(place, what, format!("at most {allowed} can be")));
        }
        self.packed_read.set(read);
        span.bytes(place)
    }

    /// Fails if a read of a file did, also where the part that needed it was left out.
    ///
    /// # Errors
    /// Those of [`SourceFiles::check`].
    pub(super) fn check_reads(&self) -> Result<(), BakeError> {
        self.files.check()
    }

    /// Unpacks what the files hold in a compressed form.
    ///
    /// # Errors
    /// Those of [`compressed::unpack`].
    pub(super) fn unpack(&mut self, cancel: &AtomicBool) -> Result<(), BakeError> {
        compressed::unpack(self, cancel)
    }

    /// Returns whether a buffer has bytes of its own, or is not there.
    pub(super) fn has_bytes(&self, buffer: u32) -> bool {
        self.buffers.get(buffer as usize).is_none_or(|bytes| bytes.length() > 0)
    }

    /// The place of bytes of a buffer, given with the first one and the length.
    pub(super) fn span_of(
        &self,
        [buffer, first, length]: [u64; 3],
        place: &str,
    ) -> Result<ByteSpan<'_>, BakeError> {
        let found = usize::try_from(buffer).ok().and_then(|buffer| self.buffers.get(buffer));
        let Some(bytes) = found else {
            return Err(BakeError::beyond(place, "buffers", buffer, self.buffers.len()));
        };
        bytes.span().part(first, length).ok_or_else(|| {
            let what = format!("{length} bytes from {first} on reach out of buffers[{buffer}]");
            let right = format!("the buffer has {}", counted(bytes.length(), "byte"));
            BakeError::at(place, what, right)
        })
    }

    /// Adds a buffer with a view of all of it. Returns the view's index.
    pub(super) fn add_view(&mut self, bytes: Vec<u8>) -> u32 {
        let view = self.whole_view(bytes, None);
        self.document.buffer_views.push(view)
    }

    /// Makes a view, which must be there, one of these bytes.
    pub(super) fn replace_view(&mut self, index: usize, bytes: Vec<u8>, stride: Option<u64>) {
        let view = self.whole_view(bytes, stride);
        self.document.buffer_views.replace(index, view);
    }

    fn whole_view(&mut self, bytes: Vec<u8>, byte_stride: Option<u64>) -> BufferView {
        let buffer = u32::try_from(self.buffers.len()).unwrap_or(u32::MAX);
        let byte_length = bytes.len() as u64;
        // What is unpacked may be read as often as what lies in a file.
        self.bytes = self.bytes.saturating_add(byte_length);
        self.buffers.push(Buffer::Memory(bytes));
        let extensions = ViewExtensions::default();
        BufferView { buffer, byte_offset: 0, byte_length, byte_stride, extensions }
    }

    /// `bufferViews[index]`, which `place` names, and the place of its bytes.
    pub(super) fn view(
        &self,
        index: u32,
        place: &str,
    ) -> Result<(&BufferView, ByteSpan<'_>), BakeError> {
        let view = self.document.buffer_views.at(index, place)?;
        let place = format!("bufferViews[{index}]");
        let bytes = [view.buffer.into(), view.byte_offset, view.byte_length];
        Ok((view, self.span_of(bytes, &place)?))
    }

    /// The encoded bytes of `images[index]`, or why there are none.
    ///
    /// # Errors
    /// An index beyond the list, and a file that changed meanwhile.
    pub(super) fn image(
        &self,
        index: usize,
        cancel: &AtomicBool,
    ) -> Result<Result<Cow<'_, [u8]>, String>, BakeError> {
        let place = format!("images[{index}]");
        match self.images.get(index) {
            None => Err(BakeError::beyond("textures", "images", index as u64, self.images.len())),
            Some(Image::Absent(reason)) => Ok(Err(reason.clone())),
            Some(Image::Data(bytes)) => Ok(Ok(Cow::Borrowed(bytes))),
            Some(Image::View(view)) => match self.view(*view, &place) {
                Err(error) => Ok(Err(error.reason())),
                Ok((_, ByteSpan { length, .. })) if length > IMAGE_BYTES_MAX => {
                    Ok(Err(format!("it has {length} bytes; at most {IMAGE_BYTES_MAX} can be read")))
                }
                Ok((_, span)) => span.bytes(&place).map(Ok),
            },
            Some(Image::File { path, hash }) => {
                let bytes = source_file::read(path, IMAGE_BYTES_MAX, &place, cancel)?;
                if BlobHash::of(&bytes) != *hash {
                    let what = format!("{} changed while it was read", path.display());
                    return Err(BakeError::at(place, what, "a file that rests would be right"));
                }
                Ok(Ok(Cow::Owned(bytes)))
            }
        }
    }
}

/// Why a path leads to no file that may be read.
enum Unresolved {
    /// It leads out of the scene's folder.
    Outside(BakeError),
    /// There is no such file.
    Absent(BakeError),
}

impl From<Unresolved> for BakeError {
    fn from(unresolved: Unresolved) -> Self {
        match unresolved {
            Unresolved::Outside(error) | Unresolved::Absent(error) => error,
        }
    }
}

/// Returns the file that a relative path leads to, if it stays inside the folder. Where there is
/// none, backslashes part folders too, as programs of Windows write them.
fn resolve(folder: &Path, path: &str, uri: &str, place: &str) -> Result<PathBuf, Unresolved> {
    match resolve_as_named(folder, path, uri, place) {
        Err(Unresolved::Absent(_)) if path.contains('\\') => {
            let found = resolve_as_named(folder, &path.replace('\\', "/"), uri, place);
            // The name as it is leads nowhere, and so not out of the folder.
            found.map_err(|other| Unresolved::Absent(other.into()))
        }
        resolved => resolved,
    }
}

/// Returns the file that a relative path leads to with slashes alone, if it stays inside the
/// folder.
fn resolve_as_named(
    folder: &Path,
    path: &str,
    uri: &str,
    place: &str,
) -> Result<PathBuf, Unresolved> {
    let outside = || {
        let what = format!("'{}' leads out of the scene's folder", uri::shorten(uri));
        let right = "a file in the scene's folder or below would be right";
        Unresolved::Outside(BakeError::at(place, what, right))
    };
    // The path as written first: what lies outside is not even looked for.
    let mut depth = 0i64;
    for component in Path::new(path).components() {
        depth += match component {
            Component::Normal(_) => 1,
            Component::CurDir => 0,
            Component::ParentDir => -1,
            Component::RootDir | Component::Prefix(_) => return Err(outside()),
        };
        if depth < 0 {
            return Err(outside());
        }
    }
    let resolved = fs::canonicalize(folder.join(path)).map_err(|error| {
        let what = format!("'{}' can't be found: {error}", uri::shorten(uri));
        let right = format!("it should lie in {}", folder.display());
        Unresolved::Absent(BakeError::at(place, what, right))
    })?;
    if resolved.starts_with(folder) { Ok(resolved) } else { Err(outside()) }
}
