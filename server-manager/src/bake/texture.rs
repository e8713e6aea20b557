//! Textures: images decoded one at a time, fitted, and written with their mip levels.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;

use gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use gltf::json::validation::Checked;
use image::{ImageFormat, ImageReader};
use polyptych_protocol::ids::BlobHash;
use polyptych_protocol::limits::TEXTURE_SIDE_MAX;
use polyptych_protocol::scene::{Filter, MipFilter, Sampler, Texture, TextureFormat, Wrap};

use super::Job;
use super::error::BakeError;
use super::material::{Content, TextureUse};
use super::mip::{self, Picture};

/// Longest side of an image that is decoded; it is halved until a driver can hold it.
const IMAGE_SIDE_MAX: u32 = 16_384;

/// Most memory that a decoder may take.
const DECODE_BYTES_MAX: u64 = 512 << 20;

/// Images of so many pixels are decoded however small their files are.
const PIXELS_UNASKED: u64 = 1 << 22;

/// Most pixels per byte of file beyond that: deflate reaches about 1,000 bytes per byte.
const PIXELS_PER_BYTE_MAX: u64 = 1024;

/// Pixels of all images together that are decoded however small the files are: four plain images
/// of 4,096 × 4,096. One small image could be named a thousand times.
const PIXELS_TOGETHER_UNASKED: u64 = 1 << 26;

/// Most pixels per byte of all files beyond that: a plain image of that size reaches 350.
const PIXELS_TOGETHER_PER_BYTE_MAX: u64 = 512;

/// Everything of a texture but its sampler.
#[derive(Clone, Copy)]
struct Stored {
    blob: BlobHash,
    width: u32,
    height: u32,
    mip_count: u32,
}

/// Writes the textures that are used, in their order.
pub(super) fn write_all(job: &mut Job<'_>, uses: &[TextureUse]) -> Result<Vec<Texture>, BakeError> {
    let mut stored: BTreeMap<(usize, Content, bool), Stored> = BTreeMap::new();
    let mut textures = Vec::with_capacity(uses.len());
    let bytes = job.source.bytes;
    let mut pixels_left = PIXELS_TOGETHER_UNASKED + PIXELS_TOGETHER_PER_BYTE_MAX * bytes;
    for (i, used) in uses.iter().enumerate() {
        job.step("textures", i as u64, uses.len() as u64)?;
        let place = format!("textures[{}]", used.texture);
        let json = job.source.document.textures.at(used.texture, &place)?;
        let sampler = match json.sampler {
            None => Sampler::default(),
            Some(index) => sampler(job, index.value() as u32, &place)?,
        };
        let image = json.source.value();
        let has_mips = sampler.mip != MipFilter::None;
        let key = (image, used.content, has_mips);
        let Stored { blob, width, height, mip_count } = if let Some(stored) = stored.get(&key) {
            *stored
        } else {
            let made = write(job, image, used.content, has_mips, &mut pixels_left)?;
            stored.insert(key, made);
            made
        };
        let format = match used.content {
            Content::Color | Content::ColorAlpha => TextureFormat::Rgba8Srgb,
            Content::Data | Content::Normal => TextureFormat::Rgba8Linear,
        };
        textures.push(Texture { blob, format, width, height, mip_count, sampler });
    }
    job.step("textures", uses.len() as u64, uses.len() as u64)?;
    Ok(textures)
}

fn write(
    job: &mut Job<'_>,
    index: usize,
    content: Content,
    has_mips: bool,
    pixels_left: &mut u64,
) -> Result<Stored, BakeError> {
    let encoded = job.source.image(index, job.cancel)?;
    let place = format!("images[{index}]");
    let mut picture = decode(encoded, &place, pixels_left)?;
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
    let blob = job.write(&bytes, &place)?;
    Ok(Stored { blob, width, height, mip_count })
}

fn decode(
    encoded: Cow<'_, [u8]>,
    place: &str,
    pixels_left: &mut u64,
) -> Result<Picture, BakeError> {
    let right = "a PNG or JPEG of at most 16384 × 16384 pixels would be right";
    let bad = |what: String| BakeError::at(place, what, right);
    let open = || {
        let reader = ImageReader::new(Cursor::new(encoded.as_ref())).with_guessed_format();
        reader.map_err(|error| bad(error.to_string()))
    };
    let format = open()?.format();
    if !matches!(format, Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err(bad("it is neither PNG nor JPEG".to_owned()));
    }
    let cannot = |error: image::ImageError| bad(format!("it can't be decoded: {error}"));
    let (width, height) = open()?.into_dimensions().map_err(cannot)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > PIXELS_UNASKED && pixels / PIXELS_PER_BYTE_MAX > encoded.len() as u64 {
        let bytes = encoded.len();
        return Err(bad(format!("{bytes} bytes can't hold {width} × {height} pixels")));
    }
    let Some(left) = pixels_left.checked_sub(pixels) else {
        return Err(bad(format!("with {width} × {height} more, too many pixels for such files")));
    };
    *pixels_left = left;
    let mut reader = open()?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(IMAGE_SIDE_MAX);
    limits.max_image_height = Some(IMAGE_SIDE_MAX);
    limits.max_alloc = Some(DECODE_BYTES_MAX);
    reader.limits(limits);
    let decoded = reader.decode().map_err(cannot)?;
    if width == 0 || height == 0 {
        return Err(bad("it has no pixels".to_owned()));
    }
    drop(encoded);
    let rgba = decoded.into_rgba8();
    Ok(Picture { width: rgba.width(), height: rgba.height(), rgba: rgba.into_raw() })
}

fn sampler(job: &Job<'_>, index: u32, place: &str) -> Result<Sampler, BakeError> {
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
