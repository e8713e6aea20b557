//! Parts of a view's canvas with a guard band around them: where the pictures lie that pixels of a
//! neighbourhood are computed from, so that all channels of a screen compute the same texels.
//!
//! Surfaces that transmit light see such a picture behind them, light that spreads as glow comes
//! from one, and ambient occlusion from the depths of one. A view with glow has a wide one, and
//! with what transmits light two of them: a sharp one, a pixel a texel, for what is refracted
//! little, and a wide one of at most [`TEXELS_PER_RADIAN`] for what is refracted or blurred far.
//! Each is larger than what is seen by a guard band, and begins at a multiple of its coarsest texel
//! in pixels of the canvas, which the tiles of a screen share. Shaders clamp offsets and filters to
//! the guard band, as a function of the point alone; so no pixel depends on the channel that draws
//! it.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};

use super::view::ViewDesc;

/// Halvings of a picture of light: texels of the coarsest level are 64 finest ones wide.
pub(crate) const LEVELS: u32 = 6;

/// Texels of the sharp picture's guard band: 96 for offsets, 32 for filters.
const SHARP_REACH: i64 = 128;

/// Texels of the wide picture's guard band: half a radian or more, which is all that the filter of
/// the coarsest level reaches.
const WIDE_REACH: i64 = 256;

/// Texels of the wide picture to a radian, at most: its coarsest texels are 7° or more.
const TEXELS_PER_RADIAN: f64 = 512.0;

/// Texels of the depths of ambient occlusion to a radian, at most: a texel is two or three pixels
/// of a display that a viewer is close to.
const DEPTHS_PER_RADIAN: f64 = 724.0;

/// Texels of the guard band of these depths: the reach of ambient occlusion, seen up to 50° beside
/// the middle of the canvas, where an angle takes most texels.
pub(crate) const DEPTHS_REACH: i64 = 224;

/// Halvings of these depths: the directions in which they are searched repeat every 4 texels.
const DEPTHS_LEVELS: u32 = 2;

/// Texels around what is seen for which ambient occlusion is found: those that it is smoothed
/// over.
const OCCLUSION_REACH: i64 = 4;

/// Texels of the picture of depth of field to a radian, at most: a texel is one or two pixels of a
/// display that a viewer is close to.
const FOCUS_PER_RADIAN: f64 = 1024.0;

/// Texels of a disc's radius, at most: the widest of 4° seen 40° beside the middle of the canvas.
pub(crate) const DISC_REACH: i64 = 64;

/// Texels of the guard band of that picture: the coarsest ones that a disc may reach.
const FOCUS_REACH: i64 = 2 * DISC_REACH;

/// Texels around what is seen for which discs are gathered: those that pixels are between.
const GATHERED_REACH: i64 = 2;

/// Texels of the wide picture of a whole canvas, at most: 500 MB with four samples each. Only one
/// of more than 130° to both sides has fewer to a radian for that.
pub(crate) const TEXELS_MAX: u64 = 8 << 20;

/// Texels of all pictures of what is behind glass in a group of views, at most, unless it is one
/// view: 1 GB with four samples each.
const BEHIND_TEXELS_MAX: u64 = 16 << 20;

/// Texels of a side of the texture of these pictures, unless one of them is longer: groups take
/// turns in it, and a long one and a high one would make it both.
const BEHIND_SIDE: u32 = 4096;

/// The coarsest texel of a picture, as a power of two in pixels.
const SCALE_MAX: u32 = 12;

/// Texels of a canvas with its guard band: the longest viewport of the weakest driver.
const CANVAS_SIDE_MAX: f64 = 8192.0;

/// Twin of `Region` in `include/transmission.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct RegionRecord {
    pub corner: [i32; 2],
    pub place: [i32; 2],
    pub size: [i32; 2],
    pub scale: u32,
    pub reach: f32,
}

/// Twin of `Behind` in `include/transmission.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct BehindUniform {
    pub sharp: RegionRecord,
    pub wide: RegionRecord,
    pub pixels: [f32; 2],
    pub pixels_per_radian: f32,
    pub detail_max: f32,
    pub bounds: [f32; 4],
}

/// A part of a view's canvas with a guard band around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct GuardedRegion {
    /// A texel is 2^scale pixels wide.
    pub scale: u32,
    /// Texels of the guard band.
    reach: i64,
    /// Pixels of the target.
    pub corner: [i64; 2],
    /// Width and height in texels: multiples of the coarsest texel.
    pub size: [u32; 2],
    /// Texels of the texture that holds all of them, where [`pack`] put it.
    pub place: [u32; 2],
}

impl GuardedRegion {
    /// Returns the pictures for what a view shows in a rectangle of the target, the wide one last.
    pub fn of_view(view: &ViewDesc, rectangle: [u32; 4]) -> Vec<Self> {
        let wide = Self::of_glow(view, rectangle);
        let sharp = || Self::around(view, rectangle.map(i64::from), (0, LEVELS), SHARP_REACH);
        let sharp = (wide.scale > 0).then(sharp);
        sharp.into_iter().chain([wide]).collect()
    }

    /// Returns the picture for light that spreads in what a view shows in a rectangle of the
    /// target.
    pub fn of_glow(view: &ViewDesc, rectangle: [u32; 4]) -> Self {
        let scale = scale(view, TEXELS_PER_RADIAN, WIDE_REACH);
        Self::around(view, rectangle.map(i64::from), (scale, LEVELS), WIDE_REACH)
    }

    /// Returns the places of the ambient occlusion of what a view shows in a rectangle of the
    /// canvas, in pixels of the target, and of the depths that it is found from: the texels of both
    /// are the same.
    pub fn of_occlusion(view: &ViewDesc, rectangle: [i64; 4]) -> [Self; 2] {
        let scale = scale(view, DEPTHS_PER_RADIAN, DEPTHS_REACH);
        let around = |reach| Self::around(view, rectangle, (scale, DEPTHS_LEVELS), reach);
        [around(OCCLUSION_REACH), around(OCCLUSION_REACH + DEPTHS_REACH)]
    }

    /// Returns the places of what discs of depth of field cover in what a view shows in a rectangle
    /// of the target, and of the picture that has them: the texels of both are the same.
    pub fn of_focus(view: &ViewDesc, rectangle: [u32; 4]) -> [Self; 2] {
        let scale = scale(view, FOCUS_PER_RADIAN, FOCUS_REACH);
        let rectangle = rectangle.map(i64::from);
        let around = |levels, reach| Self::around(view, rectangle, (scale, levels), reach);
        [around(0, GATHERED_REACH), around(LEVELS, GATHERED_REACH + FOCUS_REACH)]
    }

    /// Returns the pictures of what is behind glass in the picture of a view, where glass is all
    /// over it: those that are drawn are no larger.
    pub fn pictures_behind(&self, of: &ViewDesc) -> Vec<Self> {
        let ([x, y], [width, height]) = (self.place, self.size);
        Self::of_view(&self.view(of), [x, y, width, height])
    }

    /// All of it in pixels of the target: x, y, width, height.
    pub fn rectangle(&self) -> [i64; 4] {
        let [width, height] = self.size.map(|side| i64::from(side) << self.scale);
        [self.corner[0], self.corner[1], width, height]
    }

    /// Radians to a texel in the middle of the canvas.
    pub fn texel_rad(&self, view: &ViewDesc) -> f64 {
        f64::from(1u32 << self.scale) / pixels_per_radian(view)
    }

    /// The texels of this region that are those of a rectangle of another one of the same scale,
    /// both in their textures: x, y, width, height. `None` if there are none.
    pub fn texels_at(&self, other: &Self, rectangle: [u32; 4]) -> Option<[u32; 4]> {
        let span = |at: usize| {
            let shift = (other.corner[at] - self.corner[at]) >> self.scale;
            let place = [self.place[at], other.place[at]].map(i64::from);
            let from = i64::from(rectangle[at]) - place[1] + shift;
            let end = from + i64::from(rectangle[at + 2]);
            let [from, end] = [from, end].map(|to| to.clamp(0, i64::from(self.size[at])));
            (from < end).then(|| [(place[0] + from) as u32, (end - from) as u32])
        };
        let ([x, width], [y, height]) = (span(0)?, span(1)?);
        Some([x, y, width, height])
    }

    fn around(
        view: &ViewDesc,
        rectangle: [i64; 4],
        (scale, levels): (u32, u32),
        reach: i64,
    ) -> Self {
        let step = 1i64 << (scale + levels);
        let axis = |at: usize| {
            let base = view.viewport[at].floor() as i64;
            let from = rectangle[at] - base - (reach << scale);
            let to = rectangle[at] + rectangle[at + 2] - base + (reach << scale);
            let (first, end) = (from.div_euclid(step), (to + step - 1).div_euclid(step));
            (first * step + base, ((end - first) << levels) as u32)
        };
        let [(x, width), (y, height)] = [axis(0), axis(1)];
        Self { scale, reach, corner: [x, y], size: [width, height], place: [0, 0] }
    }

    /// Whole pixels by which the canvas is extended on each side.
    fn margin(&self, length: f64) -> f64 {
        let texel = f64::from(1u32 << self.scale);
        let room = ((CANVAS_SIDE_MAX * texel - length) / 2.0).floor();
        ((self.reach << self.scale) as f64).min(room).max(0.0)
    }

    /// Returns the view that draws it.
    pub fn view(&self, of: &ViewDesc) -> ViewDesc {
        let texel = f64::from(1u32 << self.scale);
        let [vx, vy, width, height] = of.viewport;
        let (across, down) = (self.margin(width), self.margin(height));
        let axis = |at: usize, from: f64, margin: f64| {
            f64::from(self.place[at]) + (from - self.corner[at] as f64 - margin) / texel
        };
        let grown = [width + 2.0 * across, height + 2.0 * down];
        let shrink = DVec3::new(width / grown[0], height / grown[1], 1.0);
        let mut allowed_error = of.allowed_error;
        if self.scale > 0 && !of.is_parallel() {
            // Half a texel, on all channels.
            let angle = 0.5 * texel / pixels_per_radian(of);
            allowed_error.angle_rad = allowed_error.angle_rad.max(angle);
        }
        let [x, y] = [axis(0, vx, across), axis(1, vy, down)];
        ViewDesc {
            clip_from_view: DMat4::from_scale(shrink) * of.clip_from_view,
            viewport: [x, y, grown[0] / texel, grown[1] / texel],
            scissor: Some([self.place[0], self.place[1], self.size[0], self.size[1]]),
            allowed_error,
            ..of.clone()
        }
    }

    fn record(&self) -> RegionRecord {
        RegionRecord {
            corner: self.corner.map(|at| at as i32),
            place: self.place.map(|at| at as i32),
            size: self.size.map(|at| at as i32),
            scale: self.scale,
            reach: (self.reach << self.scale) as f32,
        }
    }
}

impl BehindUniform {
    /// The uniforms of a view with these pictures; zeros if it has none.
    pub fn new(view: &ViewDesc, regions: &[GuardedRegion]) -> Self {
        let [x, y, width, height] = view.viewport;
        let Some(wide) = regions.last() else { return Self::default() };
        let sharp = regions.first().filter(|_| regions.len() > 1);
        let margins = sharp.map_or([0.0; 2], |of| [of.margin(width), of.margin(height)]);
        let [left, top] = [x - margins[0], y - margins[1]];
        let [right, bottom] = [x + width + margins[0], y + height + margins[1]];
        Self {
            sharp: sharp.map(GuardedRegion::record).unwrap_or_default(),
            wide: wide.record(),
            pixels: [(width * 0.5) as f32, (-height * 0.5) as f32],
            pixels_per_radian: pixels_per_radian(view) as f32,
            detail_max: (wide.scale + LEVELS) as f32,
            bounds: [left, top, right, bottom].map(|at| at as f32),
        }
    }
}

/// Pixels to a radian in the middle of the canvas. Where rays are parallel the canvas counts as a
/// radian high.
fn pixels_per_radian(view: &ViewDesc) -> f64 {
    let height = view.viewport[3];
    if view.is_parallel() {
        return height.max(1.0);
    }
    let slope = (view.clip_from_view.y_axis.y / view.clip_from_view.z_axis.w).abs();
    let pixels = height * 0.5 * slope;
    if pixels.is_finite() { pixels.max(1.0) } else { height.max(1.0) }
}

/// The width of a texel where so many are a radian at most, as a power of two in pixels: a function
/// of the canvas, which tiles share.
fn scale(view: &ViewDesc, texels_per_radian: f64, reach: i64) -> u32 {
    let scale = (pixels_per_radian(view) / texels_per_radian).log2().ceil();
    let texels = |scale: u32| {
        let side = |pixels: f64| (pixels / f64::from(1 << scale)).ceil() + 2.0 * reach as f64;
        side(view.viewport[2]) * side(view.viewport[3])
    };
    let is_small = |scale: &u32| texels(*scale) <= TEXELS_MAX as f64;
    let first = scale.clamp(0.0, f64::from(SCALE_MAX)) as u32;
    (first..SCALE_MAX).find(is_small).unwrap_or(SCALE_MAX)
}

/// Places pictures beside and below each other in a texture of sides up to `side_max`. Returns the
/// texture's sides; `None` if they do not fit. One that is longer than `side_max` loses its end.
pub(crate) fn pack<'a>(
    regions: impl Iterator<Item = &'a mut GuardedRegion>,
    side_max: u32,
) -> Option<[u32; 2]> {
    let side_max = side_max >> LEVELS << LEVELS;
    let (mut x, mut y, mut height, mut sides) = (0, 0, 0, [0, 0]);
    for region in regions {
        region.size = region.size.map(|side| side.min(side_max));
        if x + region.size[0] > side_max {
            (x, y, height) = (0, y + height, 0);
        }
        region.place = [x, y];
        x += region.size[0];
        height = height.max(region.size[1]);
        sides = [sides[0].max(x), sides[1].max(y + height)];
    }
    (sides[1] <= side_max).then_some(sides)
}

/// The side of a texture for these pictures of what is behind glass.
fn side_behind(pictures: &[&mut GuardedRegion], side_max: u32) -> u32 {
    let is_short = pictures.iter().flat_map(|of| of.size).all(|side| side <= BEHIND_SIDE);
    if is_short { side_max.min(BEHIND_SIDE) } else { side_max }
}

/// Places pictures of what is behind glass as [`pack`] does: in short rows, if they fit.
pub(crate) fn pack_behind(mut regions: Vec<&mut GuardedRegion>, side_max: u32) -> Option<[u32; 2]> {
    let side = side_behind(&regions, side_max);
    let sides = pack(regions.iter_mut().map(|of| &mut **of), side);
    sides.or_else(|| pack(regions.into_iter(), side_max))
}

/// Returns whether a group of views may have these pictures of what is behind glass: in short rows,
/// since groups take turns in one texture.
pub(crate) fn has_room_behind(pictures: &[GuardedRegion], side_max: u32) -> bool {
    let mut pictures = pictures.to_vec();
    let pictures: Vec<&mut GuardedRegion> = pictures.iter_mut().collect();
    let side = side_behind(&pictures, side_max);
    let sides = pack(pictures.into_iter(), side);
    sides.is_some_and(|[width, height]| u64::from(width) * u64::from(height) <= BEHIND_TEXELS_MAX)
}
