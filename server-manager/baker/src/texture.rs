//! Textures: images decoded one at a time, fitted, and written with their mip levels.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use gltf::json::validation::Checked;
use image::{ImageDecoder, ImageFormat, ImageReader};
use polyptych_files::blob::BlobHash;
use polyptych_scene::limits::TEXTURE_SIDE_MAX;
use polyptych_scene::{Filter, MipFilter, Sampler, Texture, TextureFormat, Wrap};
use serde::Deserialize;

use super::error::BakeError;
use super::json::{JsonError, from_value};
use super::material::{TextureKind, TextureUse};
use super::mip::{self, Rgba8Image};
use super::{BakeJob, image_format, ktx2, placeholder, specular_glossiness, uri};

/// Longest side of an image that is decoded; it is halved until a driver can hold it.
const IMAGE_SIDE_MAX: u32 = 16_384;

/// Most memory that a decoder may take.
const DECODE_BYTES_MAX: u64 = 512 << 20;

/// Images of so many pixels are decoded however small their files are: 4,096 × 4,096 of one colour
/// take WebP some hundred bytes.
const PIXELS_UNASKED: u64 = 1 << 24;

/// Most pixels per byte of file beyond that: deflate reaches about 1,000 bytes per byte, of up to
/// eight pixels each.
const PIXELS_PER_BYTE_MAX: u64 = 8192;

/// Pixels of all images together that are decoded however small the files are: four plain images
/// of 4,096 × 4,096. One small image could be named a thousand times.
const PIXELS_TOGETHER_UNASKED: u64 = 1 << 26;

/// Most pixels per byte of all files beyond that: a plain image of that size reaches 350.
const PIXELS_TOGETHER_PER_BYTE_MAX: u64 = 512;

/// The image of a texture that has none (`gltf` crate, feature `allow_empty_texture`).
const NO_IMAGE: usize = u32::MAX as usize;

/// Formats that the image library reads for us.
const FORMATS: [ImageFormat; 5] =
    [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Gif, ImageFormat::Bmp];

/// Extensions by which a texture names an image of a format that is read.
const READ_BY_EXTENSION: [&str; 2] = ["EXT_texture_webp", "KHR_texture_basisu"];

/// Formats that are read, for messages.
const RIGHT: &str = "a PNG, JPEG, WebP or KTX2 would be right";

/// An extension by which a texture names an image.
#[derive(Deserialize)]
struct ImageByExtension {
    source: u32,
}

/// Everything of a texture but its sampler.
#[derive(Clone, Copy)]
struct Stored {
    blob: BlobHash,
    width: u32,
    height: u32,
    mip_count: u32,
    is_placeholder: bool,
}

/// Pixels that may still be decoded. It bounds time, not memory: each image alone could be read.
#[derive(Debug)]
pub(super) struct PixelBudget(u64);

impl PixelBudget {
    pub fn new(job: &BakeJob<'_>) -> Self {
        Self(PIXELS_TOGETHER_UNASKED + PIXELS_TOGETHER_PER_BYTE_MAX * job.source.bytes)
    }

    fn spend(&mut self, pixels: u64, place: &str) -> Result<(), BakeError> {
        self.0 = self.0.checked_sub(pixels).ok_or_else(|| {
            let what = format!("with its {pixels} pixels there are too many in such files");
            BakeError::at(place, what, "fewer or smaller images would be right")
        })?;
        Ok(())
    }
}

/// The textures of a scene.
#[derive(Debug, Default)]
pub(super) struct Textures {
    /// In the order of their uses.
    pub list: Vec<Texture>,
    /// Those whose image is missing or cannot be read.
    pub placeholders: BTreeSet<u32>,
}

/// The outcomes of the images so far.
#[derive(Default)]
struct StoredImages {
    /// By index, content and whether there are mips: a texture, or the reason why it cannot be
    /// read.
    images: BTreeMap<(usize, TextureKind, bool), Result<Stored, String>>,
    /// Notes of those that cannot be read, each of which is told once.
    notes: BTreeSet<String>,
}

/// Writes the textures that are used, in their order. Placeholders stand for images that cannot
/// be read, each with a note.
pub(super) fn write_all(job: &mut BakeJob<'_>, uses: &[TextureUse]) -> Result<Textures, BakeError> {
    let mut stored = StoredImages::default();
    let mut textures = Textures::default();
    let mut budget = PixelBudget::new(job);
    for (i, used) in uses.iter().enumerate() {
        job.step("textures", i as u64, uses.len() as u64)?;
        let place = format!("textures[{}]", used.texture);
        let json = job.source.document.textures.at(used.texture, &place)?;
        let sampler = match json.sampler {
            None => Sampler::default(),
            Some(index) => sampler(job, index.value() as u32, &place)?,
        };
        let images = images_of(json);
        if images.is_empty() {
            note_no_image(job, used.texture, json);
        }
        let has_mips = sampler.mip != MipFilter::None;
        let made = write(job, &images, (used.content, has_mips), (&mut stored, &mut budget))
            .map_err(|error| error.within(&place))?;
        if made.is_placeholder {
            textures.placeholders.insert(i as u32);
        }
        let format = match used.content {
            TextureKind::Color
            | TextureKind::ColorAlpha
            | TextureKind::ColorMask(_)
            | TextureKind::Tint => TextureFormat::Rgba8Srgb,
            TextureKind::Data | TextureKind::Normal | TextureKind::Glossiness(_) => {
                TextureFormat::Rgba8Linear
            }
        };
        let Stored { blob, width, height, mip_count, .. } = made;
        textures.list.push(Texture { blob, format, width, height, mip_count, sampler });
    }
    job.step("textures", uses.len() as u64, uses.len() as u64)?;
    Ok(textures)
}

/// Writes the first of these images that can be read, or a placeholder. Notes why others cannot.
fn write(
    job: &mut BakeJob<'_>,
    images: &[usize],
    (content, has_mips): (TextureKind, bool),
    (stored, budget): (&mut StoredImages, &mut PixelBudget),
) -> Result<Stored, BakeError> {
    let (mut made, mut unread) = (None, Vec::new());
    for &image in images {
        let key = (image, content, has_mips);
        let known = if let Some(known) = stored.images.get(&key) {
            known.clone()
        } else {
            let known = write_image(job, key, budget)?;
            stored.images.insert(key, known.clone());
            known
        };
        match known {
            Ok(known) => {
                made = Some((image, known));
                break;
            }
            Err(reason) => unread.push((image, reason)),
        }
    }
    let instead = match made {
        Some((image, _)) => format!("images[{image}] is shown in its place"),
        None => "a placeholder is shown".to_owned(),
    };
    for (image, reason) in unread {
        // The reason last: long ones are cut.
        let note = format!("{}: {instead}, since {reason}", title(job, image));
        if stored.notes.insert(note.clone()) {
            job.warn(&note);
        }
    }
    if let Some((_, made)) = made {
        return Ok(made);
    }
    let made = store(job, placeholder::picture(content), (content, has_mips), "textures")?;
    Ok(Stored { is_placeholder: true, ..made })
}

/// Writes an image, or says why it is missing or no image that can be read.
fn write_image(
    job: &mut BakeJob<'_>,
    (image, content, has_mips): (usize, TextureKind, bool),
    budget: &mut PixelBudget,
) -> Result<Result<Stored, String>, BakeError> {
    let mut picture = match decoded(job, image, budget)? {
        Ok(picture) => picture,
        Err(reason) => return Ok(Err(reason)),
    };
    if let TextureKind::Glossiness(factor) = content {
        picture = specular_glossiness::roughness_image(picture, factor);
    }
    store(job, picture, (content, has_mips), &format!("images[{image}]")).map(Ok)
}

fn store(
    job: &mut BakeJob<'_>,
    mut picture: Rgba8Image,
    (content, has_mips): (TextureKind, bool),
    place: &str,
) -> Result<Stored, BakeError> {
    let content = match content {
        TextureKind::Glossiness(_) => TextureKind::Data,
        other => other,
    };
    let side = picture.width.max(picture.height);
    if side > TEXTURE_SIDE_MAX {
        let (width, height) = (picture.width, picture.height);
        picture = mip::fit(picture, content, TEXTURE_SIDE_MAX, job.cancel)?;
        let (w, h) = (picture.width, picture.height);
        job.warn(&format!("{place}: {width} × {height} pixels became {w} × {h}"));
    }
    let (width, height) = (picture.width, picture.height);
    let mip_count = if has_mips { width.max(height).ilog2() + 1 } else { 1 };
    let bytes = mip::chain(picture, content, mip_count, job.cancel)?;
    let blob = job.write(&bytes, place)?;
    Ok(Stored { blob, width, height, mip_count, is_placeholder: false })
}

/// Decodes an image, or says why it is missing or no image that can be read.
pub(super) fn decoded(
    job: &BakeJob<'_>,
    index: usize,
    budget: &mut PixelBudget,
) -> Result<Result<Rgba8Image, String>, BakeError> {
    let place = format!("images[{index}]");
    let json = job.source.document.images.at(u32::try_from(index).unwrap_or(u32::MAX), &place)?;
    let encoded = match job.source.image(index, job.cancel)? {
        Ok(encoded) => encoded,
        Err(reason) => return Ok(Err(reason)),
    };
    let named = || image_format::of_name(json.mime_type.as_deref(), json.uri.as_deref());
    let pixels = pixels(&encoded, named);
    if let Ok(pixels) = &pixels {
        budget.spend(*pixels, &place)?;
    }
    Ok(pixels.and_then(|_| decode(&encoded)))
}

/// The name of an image in notes.
fn title(job: &BakeJob<'_>, index: usize) -> String {
    let json = &job.source.document.images[index];
    let names = [Some(json.name.as_str()), json.uri.as_deref()];
    let is_name = |name: &&str| !name.is_empty() && !name.starts_with("data:");
    let name = names.into_iter().flatten().find(is_name);
    let name = name.map_or(String::new(), |name| format!(" '{}'", uri::shorten(name)));
    format!("images[{index}]{name}")
}

/// The images of a texture that may be read, in the order in which they are tried. The one that
/// every program can read comes first, since it lost nothing.
fn images_of(json: &gltf::json::Texture) -> Vec<usize> {
    let plain = Some(json.source.value()).filter(|&image| image != NO_IMAGE);
    let others = READ_BY_EXTENSION.into_iter().filter_map(|name| named_by(json, name)?.ok());
    plain.into_iter().chain(others).collect()
}

/// The image that a texture names by an extension, if it has that.
fn named_by(json: &gltf::json::Texture, name: &str) -> Option<Result<usize, JsonError>> {
    let value = json.extensions.as_ref()?.others.get(name)?;
    Some(from_value::<ImageByExtension>(value).map(|of| of.source as usize))
}

/// Says of a texture that names no image that can be read what it names instead.
fn note_no_image(job: &mut BakeJob<'_>, texture: u32, json: &gltf::json::Texture) {
    let broken = READ_BY_EXTENSION.into_iter().find_map(|name| {
        let JsonError { path, error } = named_by(json, name)?.err()?;
        let dot = if path.is_empty() { "" } else { "." };
        Some(format!("{name}{dot}{path} cannot be read: {error}; an index would be right"))
    });
    let others = json.extensions.iter().flat_map(|extensions| extensions.others.keys());
    let named = others.filter_map(|name| Some((image_format::of_extension(name)?, name)));
    let named = named.map(|(format, name)| format!("{format} ({name})")).next();
    let named = named.unwrap_or_else(|| "missing".to_owned());
    let reason = broken.unwrap_or_else(|| format!("its image is {named}; {RIGHT}"));
    job.warn(&format!("textures[{texture}]: a placeholder is shown, since {reason}"));
}

/// Pixels of an encoded image that can be decoded within the limits, or why it cannot.
fn pixels(encoded: &[u8], named: impl Fn() -> Option<String>) -> Result<u64, String> {
    if encoded.is_empty() {
        return Err(format!("it is empty; {RIGHT}"));
    }
    if ktx2::is_ktx2(encoded) {
        let [width, height] = ktx2::size(encoded).ok_or("it is KTX2 that is cut off")?;
        let pixels = u64::from(width) * u64::from(height);
        return check_pixels([width, height], pixels.saturating_mul(4), encoded.len());
    }
    let format = image::guess_format(encoded).ok();
    if !format.is_some_and(|format| FORMATS.contains(&format)) {
        let known = image_format::of_bytes(encoded).map(|name| format!("it is {name}"));
        let said = || named().map(|name| format!("it is no image, though it is called {name}"));
        let what = known.or_else(said).unwrap_or_else(|| "it is no image".to_owned());
        return Err(format!("{what}; {RIGHT}"));
    }
    let decoder = match reader(encoded).into_decoder() {
        Ok(decoder) => decoder,
        Err(error) => return Err(cannot(&error)),
    };
    let (width, height) = decoder.dimensions();
    check_pixels([width, height], decoder.total_bytes(), encoded.len())
}

/// Checks the size of a picture in pixels and in bytes, decoded and encoded. Returns its pixels.
fn check_pixels([width, height]: [u32; 2], bytes: u64, encoded: usize) -> Result<u64, String> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(format!("it has no pixels; {RIGHT}"));
    }
    if width.max(height) > IMAGE_SIDE_MAX || bytes > DECODE_BYTES_MAX {
        let side = (DECODE_BYTES_MAX / bytes.div_ceil(pixels)).isqrt();
        let side = side.min(u64::from(IMAGE_SIDE_MAX));
        return Err(format!(
            "{width} × {height} pixels of {} bytes take {} MiB; at most {IMAGE_SIDE_MAX} pixels a \
             side and {} MiB can be read, such as {side} × {side}",
            bytes.div_ceil(pixels),
            bytes.div_ceil(1 << 20),
            DECODE_BYTES_MAX >> 20,
        ));
    }
    if pixels > PIXELS_UNASKED && pixels / PIXELS_PER_BYTE_MAX > encoded as u64 {
        return Err(format!("{encoded} bytes can't hold {width} × {height} pixels; {RIGHT}"));
    }
    Ok(pixels)
}

fn decode(encoded: &[u8]) -> Result<Rgba8Image, String> {
    if ktx2::is_ktx2(encoded) {
        return ktx2::decode(encoded);
    }
    let decoded = reader(encoded).decode().map_err(|error| cannot(&error))?;
    let rgba = decoded.into_rgba8();
    Ok(Rgba8Image { width: rgba.width(), height: rgba.height(), rgba: rgba.into_raw() })
}

fn cannot(error: &image::ImageError) -> String {
    format!("it can't be decoded: {error}; a whole PNG, JPEG or WebP would be right")
}

fn reader(encoded: &[u8]) -> ImageReader<Cursor<&[u8]>> {
    let mut reader = ImageReader::new(Cursor::new(encoded));
    if let Ok(format) = image::guess_format(encoded) {
        reader.set_format(format);
    }
    let mut limits = image::Limits::default();
    limits.max_image_width = None;
    limits.max_image_height = None;
    limits.max_alloc = Some(DECODE_BYTES_MAX);
    reader.limits(limits);
    reader
}

fn sampler(job: &BakeJob<'_>, index: u32, place: &str) -> Result<Sampler, BakeError> {
    let json = job.source.document.samplers.at(index, place)?;
    let bad = |key: &str| {
        let place = format!("samplers[{index}].{key}");
        BakeError::at(place, "the number does not exist", "one of glTF's constants would be right")
    };
    let wrap = |mode: Checked<WrappingMode>, key| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
        Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
        Checked::Invalid => Err(bad(key)),
    };
    let mag = match json.mag_filter {
        Some(Checked::Valid(MagFilter::Nearest)) => Filter::Nearest,
        None | Some(Checked::Valid(MagFilter::Linear)) => Filter::Linear,
        Some(Checked::Invalid) => return Err(bad("magFilter")),
    };
    let (min, mip) = match json.min_filter {
        None => (Filter::Linear, MipFilter::Linear),
        Some(Checked::Invalid) => return Err(bad("minFilter")),
        Some(Checked::Valid(filter)) => match filter {
            MinFilter::Nearest => (Filter::Nearest, MipFilter::None),
            MinFilter::Linear => (Filter::Linear, MipFilter::None),
            MinFilter::NearestMipmapNearest => (Filter::Nearest, MipFilter::Nearest),
            MinFilter::LinearMipmapNearest => (Filter::Linear, MipFilter::Nearest),
            MinFilter::NearestMipmapLinear => (Filter::Nearest, MipFilter::Linear),
            MinFilter::LinearMipmapLinear => (Filter::Linear, MipFilter::Linear),
        },
    };
    let (wrap_u, wrap_v) = (wrap(json.wrap_s, "wrapS")?, wrap(json.wrap_t, "wrapT")?);
    Ok(Sampler { mag, min, mip, wrap_u, wrap_v })
}
