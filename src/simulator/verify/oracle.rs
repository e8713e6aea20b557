//! The wall's picture against the picture of one channel that shows a whole screen.

use anyhow::Context;
use glam::DVec3;
use image::RgbaImage;
use polyptych_wall::blend::BlendModel;
use polyptych_wall::color::{linear_from_srgb, srgb_from_linear};
use polyptych_wall::{Channel, ChannelKind, ColorCorrection, Screen, TransferFunction, Wall};

use super::verification_report::{Bound, VerificationReport};

/// Shares of pixels that must be the same, and within one level: tiles that share a matrix.
const SAME_MIN: f64 = 0.995;
const NEAR_MIN: f64 = 0.9999;

/// The row of the first share.
const SAME: &str = "pixels that are the same";

/// Most pixels that may be off by more than eight levels, as a share.
const FAR_MAX: f64 = 20e-6;

/// The levels within which a picture that several channels share is judged: each rounds its share.
const SHARED_LEVELS: u8 = 2;

/// Share of pixels that must keep that.
const SHARED_MIN: f64 = 0.999;

/// The difference between two pictures, over the pixels that were compared.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    pixels: u64,
    same: u64,
    within_one: u64,
    within_shared: u64,
    beyond_eight: u64,
}

/// Returns whether a screen can be shown by one channel for comparison: planar, seen by one eye,
/// and of channels whose pixels are those of the canvas.
pub(super) fn can_judge(wall: &Wall, index: u16) -> bool {
    let screen = &wall.screens[usize::from(index)];
    let is_whole_pixel = |channel: &Channel| {
        let plain = polyptych_wall::ChannelCalibration {
            // What is undone before pictures are laid together.
            turn: channel.adjustment.turn,
            mirror: channel.adjustment.mirror,
            color: ColorCorrection {
                curve: channel.adjustment.color.curve.clone(),
                ..ColorCorrection::default()
            },
            edges: channel.adjustment.edges,
            ..Default::default()
        };
        channel.cover == ChannelKind::Tile && channel.adjustment == plain
    };
    screen.plane().is_some()
        && screen.canvas.max_element() <= polyptych_wall::limits::SHARED_CANVAS_SIDE_MAX
        && wall.channels.iter().filter(|channel| channel.screen == index).all(is_whole_pixel)
}

/// The wall of one channel that shows the whole of a screen.
pub(super) fn single(wall: &Wall, index: u16) -> Wall {
    let screen = &wall.screens[usize::from(index)];
    let channel = Channel::tile("single", 0, glam::UVec2::ZERO, screen.canvas);
    Wall {
        eye: wall.eye,
        near_m: wall.near_m,
        samples: wall.samples,
        shadows: wall.shadows,
        ..Wall::new("single", vec![Screen { bezel: None, ..screen.clone() }], vec![channel])
    }
}

/// Compares a screen's picture with the single one, where channels show it.
///
/// # Errors
/// Pictures of different sizes.
pub(super) fn compare(
    wall: &Wall,
    index: u16,
    stitched: &RgbaImage,
    single: &RgbaImage,
    table: &mut VerificationReport,
) -> anyhow::Result<RgbaImage> {
    let screen = &wall.screens[usize::from(index)];
    if stitched.dimensions() != single.dimensions() {
        anyhow::bail!("the pictures of screen {} differ in size", screen.name);
    }
    let channels: Vec<&Channel> =
        wall.channels.iter().filter(|channel| channel.screen == index).collect();
    let lit_by = |x: u32, y: u32| {
        let at = glam::UVec2::new(x, y);
        let is_lit = |channel: &&&Channel| {
            at.cmpge(channel.origin).all() && at.cmplt(channel.origin + channel.size).all()
        };
        channels.iter().filter(is_lit).count()
    };
    let lifted = lifted(wall);
    let mut difference = Difference::default();
    // Light that is laid together is rounded twice, and so are codes of another curve.
    let is_srgb = |channel: &&Channel| channel.adjustment.color.curve == TransferFunction::Srgb;
    let mut is_shared =
        BlendModel::new(wall).black() != DVec3::ZERO || !channels.iter().all(is_srgb);
    let mut picture = RgbaImage::new(stitched.width(), stitched.height());
    for (x, y, pixel) in stitched.enumerate_pixels() {
        let count = lit_by(x, y);
        if count == 0 {
            continue;
        }
        is_shared |= count > 1;
        let other = single.get_pixel(x, y).0;
        let levels = (0..3).map(|i| pixel[i].abs_diff(lifted[i][usize::from(other[i])]));
        let levels = levels.max().unwrap_or(0);
        difference.add(levels);
        // Eight levels are white: who looks for a difference must see one level.
        let shade = levels.saturating_mul(31);
        picture.put_pixel(x, y, image::Rgba([shade, shade, shade, 255]));
    }
    difference.judge(&screen.name, is_shared, table);
    Ok(picture)
}

/// Returns the codes that the wall shows for each code of red, green and blue of a single picture:
/// black is as light as the place where most leaks, and white stays as it is.
fn lifted(wall: &Wall) -> [Vec<u8>; 3] {
    let lift = |black: f64, code: u8| {
        let light = linear_from_srgb(f64::from(code) / 255.0);
        (srgb_from_linear(black + (1.0 - black) * light) * 255.0).round() as u8
    };
    let of = |black| (0..=u8::MAX).map(|code| lift(black, code)).collect();
    BlendModel::new(wall).black().to_array().map(of)
}

impl Difference {
    fn add(&mut self, levels: u8) {
        self.pixels += 1;
        self.same += u64::from(levels == 0);
        self.within_one += u64::from(levels <= 1);
        self.within_shared += u64::from(levels <= SHARED_LEVELS);
        self.beyond_eight += u64::from(levels > 8);
    }

    fn judge(&self, screen: &str, is_shared: bool, table: &mut VerificationReport) {
        let share = |count: u64| count as f64 / self.pixels as f64;
        let note = format!("screen {screen}, {} pixels, against one channel", self.pixels);
        if is_shared {
            let what = format!("pixels within {SHARED_LEVELS} levels, superposed");
            let least = Some(Bound::AtLeast(SHARED_MIN));
            table.add(what, share(self.within_shared), "", least, note);
            return;
        }
        let rows = [
            (SAME, self.same, Bound::AtLeast(SAME_MIN)),
            ("pixels within one level", self.within_one, Bound::AtLeast(NEAR_MIN)),
            ("pixels off by more than eight", self.beyond_eight, Bound::AtMost(FAR_MAX)),
        ];
        for (what, count, target) in rows {
            table.add(what, share(count), "", Some(target), note.clone());
        }
    }
}

/// The picture of a screen that one channel shows; `None` if the channel sent none, which the table
/// tells with the reason: a dark picture would be compared in its place.
///
/// # Errors
/// The capture has no picture of the screen.
pub(super) fn single_screen(
    capture: &polyptych_client::Capture,
    name: &str,
    table: &mut VerificationReport,
) -> anyhow::Result<Option<RgbaImage>> {
    if let Some((_, why)) = capture.missing.first() {
        let why = format!("screen {name}: its one channel has no picture: {why}");
        table.add_unmeasured(SAME, Some(Bound::AtLeast(SAME_MIN)), why);
        return Ok(None);
    }
    screen_of(capture, name).map(Some)
}

/// The picture of a screen in a capture.
///
/// # Errors
/// The capture has no picture of the screen.
pub(super) fn screen_of(
    capture: &polyptych_client::Capture,
    name: &str,
) -> anyhow::Result<RgbaImage> {
    let picture = capture.screens.iter().find(|picture| picture.name == name);
    crate::image_files::to_image(picture.with_context(|| format!("no picture of screen {name}"))?)
}

#[cfg(test)]
mod tests {
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{ShadowFilter, Surface};

    use super::*;

    #[test]
    fn the_single_channel_draws_as_the_wall_does() {
        let plane = Plane::upright(DVec3::NEG_Z, glam::DVec2::ONE);
        let screen = Screen::new("front", Surface::Plane(plane), glam::UVec2::splat(64));
        let wall = Wall {
            samples: 4,
            shadows: ShadowFilter::ContactHardening,
            ..Wall::new("two", vec![screen], Vec::new())
        };
        let single = single(&wall, 0);
        assert_eq!((single.samples, single.shadows), (wall.samples, wall.shadows));
    }

    #[test]
    fn a_single_channel_without_a_picture_is_not_compared_with() {
        let (name, rgba) = ("front".to_owned(), vec![0; 4]);
        let dark = polyptych_client::Image { name, width: 1, height: 1, rgba };
        let mut capture = polyptych_client::Capture {
            frame: polyptych_client::FrameId(1),
            screens: vec![dark],
            channels: Vec::new(),
            missing: vec![("single".into(), "the device is lost".into())],
        };
        let mut table = VerificationReport::default();
        let picture = single_screen(&capture, "front", &mut table).expect("a row");
        assert!(picture.is_none() && !table.is_met());
        let [row] = &table.rows[..] else { panic!("{table}") };
        assert_eq!((row.what.as_str(), row.measured), (SAME, None));
        assert!(row.note.contains("front") && row.note.contains("the device is lost"), "{table}");
        capture.missing.clear();
        let picture = single_screen(&capture, "front", &mut table).expect("a picture");
        assert!(picture.is_some() && table.rows.len() == 1);
    }
}
