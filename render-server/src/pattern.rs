//! Test patterns as pictures: from a wall, a channel, a pattern and an eye to sRGB codes, on the
//! CPU; nothing else goes in.
//!
//! Some follow the screen's canvas, so that the lines of channels that overlap fall together:
//! `canvas`. Some are the display's own pixels: `own`. Some show what the wall file comes to:
//! `light`.

mod canvas;
mod light;
mod own;
mod places;
#[cfg(test)]
mod tests;

use glam::{DVec3, UVec2};
use image::{Rgba, RgbaImage, imageops};
use places::Places;
use polyptych_protocol::pattern::Pattern;
use polyptych_renderer::{Label, Place};
use polyptych_wall::color::srgb_from_linear;
use polyptych_wall::maps::Maps;
use polyptych_wall::shapes::Shaped;
use polyptych_wall::{Adjustment, Channel, ChannelId, Packing, Turn};

/// Black, and no light at all.
const BLACK: [u8; 3] = [0; 3];

/// The pattern's picture on a channel, upright and of the channel's size, as sRGB codes.
///
/// `eye` is where the viewer's is, in metres of display space.
///
/// # Errors
/// There is no such channel, or its pins leave no picture.
fn picture(
    shaped: Shaped<'_>,
    id: ChannelId,
    pattern: Pattern,
    eye: DVec3,
) -> Result<RgbaImage, String> {
    let wall = shaped.wall;
    let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
    let screen = wall.screen_of(channel);
    let no_picture = || format!("the pins of channel {} leave no picture", channel.name);
    let map = shaped.pixel_map(id).ok_or_else(no_picture)?;
    let places = Places::new(&map, channel.size);
    let follows_canvas = matches!(
        pattern,
        Pattern::Grid | Pattern::Checker | Pattern::Crosshair | Pattern::Overlap | Pattern::Density
    );
    if follows_canvas && !map.is_known() {
        // Said on the display: a channel that fails would keep its last picture.
        return Ok(words(channel, "where its pixels lie stands in a file that is not there"));
    }
    Ok(match pattern {
        Pattern::Grid => {
            let mut grid = canvas::grid(wall, screen, &places);
            let name = Label { lines: vec![channel.name.clone()], place: Place::Middle };
            label(&mut grid, &name);
            grid
        }
        Pattern::Checker => canvas::checker(wall, screen, &places),
        Pattern::Crosshair => canvas::crosshair(wall, screen, &places, eye),
        Pattern::Overlap => light::overlap(shaped, id, &places),
        Pattern::Density => light::density(channel, &map, eye),
        Pattern::Weights => light::weights(shaped, id),
        Pattern::Ramp => own::ramp(channel.size),
        Pattern::ColorBars => own::color_bars(channel.size),
        Pattern::Focus => own::focus(channel.size),
        Pattern::Border => own::border(channel.size),
    })
}

/// The same as the channel's display gets it: its light shared and coloured, unless that is what
/// it shows; then mirrored, for both eyes and turned as it hangs.
///
/// # Errors
/// As [`picture`].
pub(crate) fn display<'a>(
    of: impl Into<Shaped<'a>>,
    maps: &Maps,
    id: ChannelId,
    pattern: Pattern,
    eye: DVec3,
) -> Result<RgbaImage, String> {
    let shaped = of.into();
    let mut upright = picture(shaped, id, pattern, eye)?;
    let channel = shaped.wall.channel(id).ok_or("the channel is not on the wall any more")?;
    if !pattern.is_of_light() {
        light::share(&mut upright, shaped, maps, id);
    }
    Ok(hung(&channel.adjustment, &upright))
}

/// An upright picture as a display shows it that hangs like this.
fn hung(adjustment: &Adjustment, upright: &RgbaImage) -> RgbaImage {
    let one = if adjustment.mirror { imageops::flip_horizontal(upright) } else { upright.clone() };
    let (width, height) = one.dimensions();
    let second = match adjustment.packing {
        Packing::None | Packing::Anaglyph => None,
        Packing::SideBySide => Some([width, 0]),
        Packing::TopBottom => Some([0, height]),
    };
    let packed = match second {
        None => one,
        Some([x, y]) => {
            let mut both = RgbaImage::new(width + x, height + y);
            imageops::replace(&mut both, &one, 0, 0);
            imageops::replace(&mut both, &one, i64::from(x), i64::from(y));
            both
        }
    };
    match adjustment.turn {
        Turn::None => packed,
        // Its upper side is at the viewer's left: what is up to the viewer is at its right.
        Turn::Left => imageops::rotate90(&packed),
        Turn::Right => imageops::rotate270(&packed),
        Turn::Half => imageops::rotate180(&packed),
    }
}

fn words(channel: &Channel, what: &str) -> RgbaImage {
    let mut image = blank(channel.size);
    let lines = vec![channel.name.clone(), what.to_owned()];
    label(&mut image, &Label { lines, place: Place::Middle });
    image
}

fn label(image: &mut RgbaImage, label: &Label) {
    if let Some((panel, [left, top])) = label.image([image.width(), image.height()]) {
        imageops::replace(image, &panel, i64::from(left), i64::from(top));
    }
}

fn blank(size: UVec2) -> RgbaImage {
    RgbaImage::from_pixel(size.x, size.y, Rgba([0, 0, 0, 255]))
}

fn opaque([red, green, blue]: [u8; 3]) -> Rgba<u8> {
    Rgba([red, green, blue, 255])
}

/// The sRGB code of linear light, rounded.
fn code(light: f64) -> u8 {
    (srgb_from_linear(light.clamp(0.0, 1.0)) * 255.0).round() as u8
}
