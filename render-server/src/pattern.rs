//! Test patterns as pictures: from a wall, a channel, a pattern and an eye to sRGB codes, on the
//! CPU; nothing else goes in.
//!
//! Some follow the screen's canvas, so that the lines of channels that overlap fall together:
//! `canvas`. Some are the display's own pixels: `own`. Some show what the wall file comes to:
//! `light`.

mod canvas;
mod diagnostic;
mod display;
mod marker;
mod pixel_positions;
#[cfg(test)]
mod tests;

use glam::{DVec3, UVec2};
use image::{Rgba, RgbaImage, imageops};
use pixel_positions::PixelPositions;
use polyptych_protocol::calibration_marker::MarkedPoint;
use polyptych_protocol::pattern::TestPattern;
use polyptych_renderer::{Label, LabelPosition};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::color::srgb_from_linear;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Channel, ChannelCalibration, ChannelId, Orientation};

/// Black, and no light at all.
const BLACK: [u8; 3] = [0; 3];

/// The pattern's picture on a channel, upright and of the channel's size, as sRGB codes.
///
/// `eye` is where the viewer's is, in metres of display space.
///
/// # Errors
/// There is no such channel, or its pins leave no picture.
fn picture(
    shaped: ResolvedWall<'_>,
    maps: &CalibrationMaps,
    id: ChannelId,
    pattern: TestPattern,
    eye: DVec3,
) -> Result<RgbaImage, String> {
    let wall = shaped.wall;
    let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
    let screen = wall.screen_of(channel);
    let no_picture = || format!("the pins of channel {} leave no picture", channel.name);
    let map = shaped.channel_mapping(id).ok_or_else(no_picture)?;
    let places = PixelPositions::new(&map, channel.size);
    let follows_canvas = matches!(
        pattern,
        TestPattern::Grid
            | TestPattern::Checker
            | TestPattern::Crosshair
            | TestPattern::Overlap
            | TestPattern::Density
    );
    if follows_canvas && !map.is_resolved() {
        // Said on the display: a channel that fails would keep its last picture.
        return Ok(words(channel, "where its pixels lie stands in a file that is not there"));
    }
    Ok(match pattern {
        TestPattern::Grid => {
            let mut grid = canvas::grid(wall, screen, &places);
            let name = Label { lines: vec![channel.name.clone()], place: LabelPosition::Middle };
            label(&mut grid, &name);
            grid
        }
        TestPattern::Checker => canvas::checker(wall, screen, &places),
        TestPattern::Crosshair => canvas::crosshair(wall, screen, &places, eye),
        TestPattern::Overlap => diagnostic::overlap(shaped, id, &places),
        TestPattern::Density => diagnostic::density(channel, &map, eye),
        TestPattern::Weights => diagnostic::weights(shaped, maps, id),
        TestPattern::Ramp => display::ramp(channel.size),
        TestPattern::ColorBars => display::color_bars(channel.size),
        TestPattern::Focus => display::focus_chart(channel.size),
        TestPattern::Border => display::border(channel.size),
    })
}

/// Returns that picture as the channel's display gets it: its light shared and coloured, unless
/// that is what it shows; over it the point that is marked, if one is; then mirrored and
/// turned as it hangs, for both eyes.
///
/// # Errors
/// Those of [`picture`].
pub(crate) fn draw_pattern<'a>(
    of: impl Into<ResolvedWall<'a>>,
    maps: &CalibrationMaps,
    id: ChannelId,
    pattern: TestPattern,
    (eye, mark): (DVec3, Option<MarkedPoint>),
) -> Result<RgbaImage, String> {
    let shaped = of.into();
    let mut upright = picture(shaped, maps, id, pattern, eye)?;
    let channel = shaped.wall.channel(id).ok_or("the channel is not on the wall any more")?;
    if !pattern.bypasses_color() {
        diagnostic::apply_blend(&mut upright, shaped, maps, id);
    }
    if let Some((point, map)) = mark.zip(shaped.channel_mapping(id)) {
        marker::draw(&mut upright, channel, &map, point);
    }
    Ok(hung(&channel.adjustment, &upright))
}

/// An upright picture as a display shows it that hangs like this.
fn hung(adjustment: &ChannelCalibration, upright: &RgbaImage) -> RgbaImage {
    let one = if adjustment.mirror { imageops::flip_horizontal(upright) } else { upright.clone() };
    let turned = match adjustment.turn {
        Orientation::None => one,
        // Its upper side is at the viewer's left: what is up to the viewer is at its right.
        Orientation::Left => imageops::rotate90(&one),
        Orientation::Right => imageops::rotate270(&one),
        Orientation::Half => imageops::rotate180(&one),
    };
    let parts = adjustment.packing.parts();
    if parts == UVec2::ONE {
        return turned;
    }
    let size = UVec2::from(turned.dimensions());
    let (both, second) = (size * parts, size * (parts - 1));
    let mut packed = RgbaImage::new(both.x, both.y);
    imageops::replace(&mut packed, &turned, 0, 0);
    imageops::replace(&mut packed, &turned, i64::from(second.x), i64::from(second.y));
    packed
}

fn words(channel: &Channel, what: &str) -> RgbaImage {
    let mut image = blank(channel.size);
    let lines = vec![channel.name.clone(), what.to_owned()];
    label(&mut image, &Label { lines, place: LabelPosition::Middle });
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
