//! Stitches the pictures that the channels of one frame sent, as they hang on the wall: plain tiles
//! byte for byte; where channels overlap, lie askew, lie where a file says or correct their light,
//! the sum of their light.

mod geometry_cache;

use std::borrow::Cow;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::UVec2;
use polyptych_core::ClientRequest;
use polyptych_protocol::bulk::CaptureChunk;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::{CAPTURE_ROOM_TAKEN, ImageInfo};
use polyptych_wall::color::SrgbCodes;
use polyptych_wall::light_composite::{DisplayImage, LightComposite, StereoEye, needs_composite};
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Channel, ChannelId, Wall};
use rayon::prelude::*;

pub use geometry_cache::GeometryCache;

/// The colour where no channel shows anything: bezels, and channels that sent no picture.
const DARK: [u8; 4] = [12, 12, 12, 255];

/// Most bytes of RGBA8 that captures may take which are on their way, together: one of twice an
/// 8,192 × 8,192 wall, as screens and as channels.
pub const CAPTURE_BYTES_MAX: u64 = 1 << 30;

/// The memory budget of captures on their way: a client that asks for many and reads none fills the
/// budget, not the machine.
#[derive(Clone, Debug, Default)]
pub struct CaptureBudget(Arc<AtomicU64>);

/// The part of it that one capture takes, until it is dropped.
#[derive(Debug)]
pub struct BudgetGuard {
    bytes: u64,
    of: CaptureBudget,
}

impl CaptureBudget {
    /// Room for the pictures of a wall, of squares of pixels with this side.
    ///
    /// # Errors
    /// The wall is too large to be captured at once, or other captures take the room.
    pub fn reserve(&self, wall: &Wall, side: NonZeroU32) -> Result<BudgetGuard, String> {
        let squares = |size: UVec2, side: NonZeroU32| -> u64 {
            size.to_array().map(|pixels| u64::from(pixels.div_ceil(side.get()))).iter().product()
        };
        let (mut all, mut largest) = (0, 0);
        for (index, screen) in (0..).zip(&wall.screens) {
            for eye in StereoEye::of(wall, index) {
                all += squares(screen.canvas, side);
                // Pictures that are superposed are enlarged for it, one screen after the other.
                if side > NonZeroU32::MIN && needs_composite(wall, index, *eye) {
                    let seen = wall.channels.iter().filter(|channel| channel.screen == index);
                    let whole = seen.map(|of| squares(of.display_size(), NonZeroU32::MIN)).sum();
                    largest = largest.max(whole);
                }
            }
        }
        let displays = wall.channels.iter().map(Channel::display_size);
        all += displays.map(|size| squares(size, side)).sum::<u64>() + largest;
        let bytes = 4 * all;
        let (takes, most) = (bytes >> 20, CAPTURE_BYTES_MAX >> 20);
        if bytes > CAPTURE_BYTES_MAX {
            return Err(format!(
                "a capture of this wall takes {takes} MiB, where {most} MiB are allowed"
            ));
        }
        let taken = self.0.fetch_add(bytes, Ordering::Relaxed);
        let room = BudgetGuard { bytes, of: self.clone() };
        if taken + bytes > CAPTURE_BYTES_MAX {
            return Err(format!(
                "{CAPTURE_ROOM_TAKEN} {} MiB of {most} MiB, and this one takes {takes} MiB; ask \
                 again once their pictures were read",
                taken >> 20
            ));
        }
        Ok(room)
    }
}

impl Drop for BudgetGuard {
    fn drop(&mut self) {
        self.of.0.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// The pictures of one frame as they come in.
#[derive(Debug)]
pub struct CaptureJob {
    /// Who asked for them.
    pub job: ClientRequest,
    /// The frame that they show.
    pub frame: FrameId,
    /// The side of the squares of pixels that the pictures have the mean light of.
    side: NonZeroU32,
    /// Channels that will send none, with the reason.
    missing: Vec<(String, String)>,
    parts: Vec<ChannelImage>,
    /// The wall, tuned as the frame shows it.
    wall: Wall,
    shapes: GeometryCache,
    room: BudgetGuard,
}

#[derive(Debug)]
struct ChannelImage {
    channel: ChannelId,
    /// Its picture is on the way, then.
    has_drawn: bool,
    name: String,
    bytes_total: usize,
    size: (u32, u32),
    bytes: Vec<u8>,
}

impl ChannelImage {
    /// Its picture with all pixels of the channel's display.
    fn enlarged(&self, wall: &Wall, side: NonZeroU32) -> Cow<'_, [u8]> {
        let Some(channel) = wall.channel(self.channel).filter(|_| side > NonZeroU32::MIN) else {
            return Cow::Borrowed(&self.bytes);
        };
        let size = channel.display_size();
        let mut whole = Vec::with_capacity(4 * size.x as usize * size.y as usize);
        let rows: Vec<&[u8]> = self.bytes.chunks_exact(4 * self.size.0.max(1) as usize).collect();
        for y in 0..size.y {
            let Some(row) = rows.get((y / side.get()) as usize) else { break };
            for x in 0..size.x {
                let at = 4 * (x / side.get()) as usize;
                whole.extend_from_slice(row.get(at..at + 4).unwrap_or(&DARK));
            }
        }
        Cow::Owned(whole)
    }
}

/// A picture as it is sent to a client: sRGB RGBA8, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaptureImage {
    /// Its name and size.
    pub info: ImageInfo,
    /// `4 · width · height` bytes.
    pub rgba: Vec<u8>,
}

impl CaptureJob {
    /// Waits for the pictures of these channels.
    pub fn new(
        job: ClientRequest,
        (frame, side): (FrameId, NonZeroU32),
        channels: &[ChannelId],
        missing: Vec<(String, String)>,
        (wall, shapes): (&Wall, &GeometryCache),
        room: BudgetGuard,
    ) -> Self {
        let part = |&id: &ChannelId| {
            let channel = wall.channel(id)?;
            let size = channel.display_size().to_array();
            let [width, height] = size.map(|pixels| pixels.div_ceil(side.get()));
            Some(ChannelImage {
                channel: id,
                has_drawn: false,
                name: channel.name.clone(),
                bytes_total: 4 * width as usize * height as usize,
                size: (width, height),
                bytes: Vec::new(),
            })
        };
        let parts = channels.iter().filter_map(part).collect();
        let (wall, shapes) = (wall.clone(), shapes.clone());
        Self { job, frame, side, missing, parts, wall, shapes, room }
    }

    /// A piece has come. Pieces of other frames and pieces that don't fit are not taken.
    ///
    /// # Errors
    /// Says what does not fit, if the sender is at fault.
    pub fn add(&mut self, chunk: &CaptureChunk) -> Result<(), String> {
        if chunk.frame != self.frame {
            return Ok(());
        }
        let Some(part) = self.parts.iter_mut().find(|part| part.channel == chunk.channel) else {
            return Ok(());
        };
        if (chunk.width, chunk.height) != part.size
            || chunk.offset != part.bytes.len() as u64
            || part.bytes.len() + chunk.bytes.len() > part.bytes_total
        {
            return Err(format!(
                "channel {} sent a piece of {} × {} pixels at byte {}, where {} × {} pixels at \
                 byte {} were due",
                part.name,
                chunk.width,
                chunk.height,
                chunk.offset,
                part.size.0,
                part.size.1,
                part.bytes.len()
            ));
        }
        part.bytes.extend_from_slice(&chunk.bytes);
        Ok(())
    }

    /// A channel has drawn a frame. One that drew a later frame without this one has passed it
    /// over, as a late channel may.
    pub fn note_drawn(&mut self, channel: ChannelId, frame: FrameId) {
        let Some(part) = self.parts.iter_mut().find(|part| part.channel == channel) else { return };
        if frame == self.frame {
            part.has_drawn = true;
        } else if frame > self.frame && !part.has_drawn {
            self.mark_missing(&[channel], "it was late, and passed the frame over");
        }
    }

    /// Returns whether no more pieces are to come.
    pub fn is_complete(&self) -> bool {
        self.parts.iter().all(|part| part.bytes.len() == part.bytes_total)
    }

    /// These channels will send nothing more, for this reason.
    pub fn mark_missing(&mut self, channels: &[ChannelId], reason: &str) {
        let gone = |part: &ChannelImage| {
            channels.contains(&part.channel) && part.bytes.len() < part.bytes_total
        };
        for part in self.parts.extract_if(.., |part| gone(part)) {
            self.missing.push((part.name, reason.to_owned()));
        }
    }

    /// Nobody waits any longer for what has not come.
    pub fn expire(&mut self) {
        let all: Vec<_> = self.parts.iter().map(|part| part.channel).collect();
        self.mark_missing(&all, "its picture did not come in time");
    }

    /// A picture for each screen and eye, then one for each channel that sent its own, as its
    /// display gets it; the channels that are missing in the screens' pictures, with the reason;
    /// and the room that all take. What the right eye sees of a screen, where that is something
    /// else, has the screen's name and `-right` ([`right_eye_name`]).
    pub fn stitch(mut self) -> (Vec<CaptureImage>, Vec<(String, String)>, BudgetGuard) {
        let wall = &self.wall;
        let shapes = self.shapes.get(wall).unwrap_or_else(|reason| {
            tracing::warn!(reason, "channels that files place are not in the picture");
            let is_unknown = |part: &&ChannelImage| {
                wall.channel_mapping(part.channel).is_some_and(|of| !of.is_resolved())
            };
            let unknown = self.parts.iter().filter(is_unknown);
            let reason = format!("its place on the screen could not be read: {reason}");
            self.missing.extend(unknown.map(|part| (part.name.clone(), reason.clone())));
            Arc::default()
        });
        let of = ResolvedWall { wall, shapes: &shapes };
        let mut pictures = Vec::new();
        for index in 0..u16::try_from(wall.screens.len()).unwrap_or(u16::MAX) {
            let sides = StereoEye::of(wall, index).iter();
            pictures
                .extend(sides.map(|eye| screen_picture(of, (index, *eye), self.side, &self.parts)));
        }
        for ChannelImage { name, size: (width, height), bytes, .. } in self.parts {
            let info = ImageInfo { name, is_screen: false, width, height };
            pictures.push(CaptureImage { info, rgba: bytes });
        }
        (pictures, self.missing, self.room)
    }
}

/// The name of what the right eye sees of a screen. The pictures of different screens and eyes have
/// different names: where a screen has this one, as beside a `front` in a CAVE, `-eye` follows.
fn right_eye_name(wall: &Wall, screen: &str) -> String {
    let mut name = format!("{screen}-right");
    while wall.screens.iter().any(|other| other.name == name) {
        name.push_str("-eye");
    }
    name
}

/// Returns the picture that one eye sees of a screen: each pixel is that in the middle of a square,
/// `side` pixels of the screen along each side.
fn screen_picture(
    of: ResolvedWall<'_>,
    (index, eye): (u16, StereoEye),
    side: NonZeroU32,
    parts: &[ChannelImage],
) -> CaptureImage {
    let wall = of.wall;
    let screen = &wall.screens[usize::from(index)];
    let name = match eye {
        StereoEye::Left => screen.name.clone(),
        StereoEye::Right => right_eye_name(wall, &screen.name),
    };
    let [width, height] = screen.canvas.to_array().map(|pixels| pixels.div_ceil(side.get()));
    let rgba = DARK.repeat(width as usize * height as usize);
    let info = ImageInfo { name, is_screen: true, width, height };
    let mut picture = CaptureImage { info, rgba };
    if needs_composite(wall, index, eye) {
        superpose(&mut picture, of, (index, eye), side, parts);
        return picture;
    }
    for part in parts {
        let Some(channel) = wall.channel(part.channel) else { continue };
        if channel.screen == index && eye.sees(channel) {
            paste(&mut picture, (channel, screen.canvas), side, part);
        }
    }
    picture
}

/// The sum of the channels' light, sRGB again. Row by row, so that it needs no room of its own.
fn superpose(
    picture: &mut CaptureImage,
    of: ResolvedWall<'_>,
    (index, eye): (u16, StereoEye),
    side: NonZeroU32,
    parts: &[ChannelImage],
) {
    let is_seen = |part: &&ChannelImage| {
        of.wall.channel(part.channel).is_some_and(|channel| channel.screen == index)
    };
    let parts: Vec<_> = parts.iter().filter(is_seen).collect();
    let whole: Vec<_> = parts.iter().map(|part| part.enlarged(of.wall, side)).collect();
    let pictures = parts.iter().zip(&whole);
    let pictures: Vec<_> =
        pictures.map(|(part, rgba)| DisplayImage { channel: part.channel, rgba }).collect();
    let shown = LightComposite::new(of, index, eye, &pictures);
    let canvas = of.wall.screens[usize::from(index)].canvas;
    let codes = SrgbCodes::default();
    let row_bytes = 4 * picture.info.width.max(1) as usize;
    picture.rgba.par_chunks_exact_mut(row_bytes).enumerate().for_each(|(y, row)| {
        let light = shown.row(middle(y as u32, side, canvas.y));
        for (x, pixel) in (0..).zip(row.chunks_exact_mut(4)) {
            let at = middle(x, side, canvas.x) as usize;
            let Some(light) = light.get(at).copied().flatten() else { continue };
            let [r, g, b] = light.to_array().map(|light| codes.code(light));
            pixel.copy_from_slice(&[r, g, b, u8::MAX]);
        }
    });
}

/// The pixel in the middle of a square of pixels, of so many in all.
fn middle(square: u32, side: NonZeroU32, all: u32) -> u32 {
    (square * side.get() + side.get() / 2).min(all.saturating_sub(1))
}

/// Puts the picture of a channel in its place: into the squares of the screen, which has so many
/// pixels in all, whose middle is the channel's.
fn paste(
    screen: &mut CaptureImage,
    (channel, canvas): (&Channel, UVec2),
    side: NonZeroU32,
    part: &ChannelImage,
) {
    // The squares of the screen along an axis, and the channel's own for each.
    let squares = |origin: u32, size: u32, canvas: u32| -> Vec<[usize; 2]> {
        let all = (origin / side.get()..canvas.div_ceil(side.get())).map(|square| {
            let at = middle(square, side, canvas);
            ((origin..origin + size).contains(&at))
                .then(|| [square, (at - origin) / side.get()].map(|square| square as usize))
        });
        all.flatten().collect()
    };
    let columns = squares(channel.origin.x, channel.size.x, canvas.x);
    let Some(&[left, _]) = columns.first() else { return };
    let (row_bytes, screen_row_bytes) = (4 * part.size.0 as usize, 4 * screen.info.width as usize);
    for [onto, from] in squares(channel.origin.y, channel.size.y, canvas.y) {
        let first = onto * screen_row_bytes + 4 * left;
        let row = part.bytes.get(from * row_bytes..(from + 1) * row_bytes);
        let target = screen.rgba.get_mut(first..first + 4 * columns.len());
        let (Some(row), Some(target)) = (row, target) else { continue };
        if side == NonZeroU32::MIN && row.len() == target.len() {
            target.copy_from_slice(row);
            continue;
        }
        for (pixel, [_, from]) in target.chunks_exact_mut(4).zip(&columns) {
            if let Some(square) = row.get(4 * from..4 * from + 4) {
                pixel.copy_from_slice(square);
            }
        }
    }
}

#[cfg(test)]
mod tests;
