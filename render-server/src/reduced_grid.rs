//! The pixels of a channel at a lower resolution.
//!
//! They are those of its screen's whole canvas at that resolution, which the tiles of the screen
//! share: at a border both tiles draw the same pixels, and a few beyond it, so that both enlarge
//! the same picture there.

use polyptych_protocol::quality_bounds::resolution_scale;
use polyptych_renderer::{Enlargement, ViewDesc};
use polyptych_wall::{Channel, FrustumMode, Screen};

/// Pixels beyond a channel's border: the filter that enlarges reads half a pixel beyond it, and
/// what is resolved or drawn as a line may be one pixel off.
const GUARD: i64 = 2;

/// The pixels of a channel at a lower resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ReducedGrid {
    /// The channel's place on its canvas, and its size, in pixels.
    origin: [f64; 2],
    full: [u32; 2],
    /// Lower resolution, as shares of the pixels across and down. They make the canvas a whole
    /// number of pixels, so that tiles shift it by whole pixels.
    scale: [f64; 2],
    /// The first pixel of the canvas that is drawn, at the lower resolution.
    first: [i64; 2],
    /// Pixels that are drawn for each eye, at the lower resolution.
    size: [u32; 2],
}

impl ReducedGrid {
    /// The grid of a channel on a plane screen; `None` for its own pixels.
    pub fn new(channel: &Channel, screen: &Screen, steps: u8) -> Option<Self> {
        if steps == 0 {
            return None;
        }
        let full = channel.size.to_array();
        let (canvas, origin) = match channel.projection {
            FrustumMode::Shared => (screen.canvas.to_array(), channel.origin.as_dvec2().to_array()),
            FrustumMode::Own => (full, [0.0; 2]),
        };
        let mut grid = Self { origin, full, scale: [1.0; 2], first: [0; 2], size: [1; 2] };
        for axis in 0..2 {
            let all = f64::from(canvas[axis].max(1));
            let reduced = (all * resolution_scale(steps)).round().max(1.0);
            let scale = reduced / all;
            let (begin, end) = (origin[axis], origin[axis] + f64::from(full[axis]));
            // Beyond the canvas there is nothing: its last pixels are repeated.
            let first = ((begin * scale).floor() as i64 - GUARD).max(0);
            let last = ((end * scale).ceil() as i64 + GUARD).min(reduced as i64);
            (grid.scale[axis], grid.first[axis]) = (scale, first);
            grid.size[axis] = u32::try_from(last - first).unwrap_or(1).max(1);
        }
        Some(grid)
    }

    /// Width and height of the target for so many eyes, in pixels.
    pub fn size(&self, eyes: u32) -> [u32; 2] {
        [self.size[0] * eyes, self.size[1]]
    }

    /// The place of the target's picture in the channel's.
    pub fn enlargement(&self, parts: u32) -> Enlargement {
        let place = |axis: usize| self.first[axis] as f64 / self.scale[axis] - self.origin[axis];
        let side = |axis: usize| f64::from(self.size[axis]) / self.scale[axis];
        Enlargement { parts, covered: [place(0), place(1), side(0), side(1)] }
    }

    /// The views of a target of so many eyes at the lower resolution.
    pub fn views(&self, views: &[ViewDesc], eyes: u32) -> Vec<ViewDesc> {
        let eye_of = |view: &ViewDesc| {
            let left = view.scissor.map_or(0, |[left, ..]| left);
            (left / self.full[0].max(1)).min(eyes.saturating_sub(1))
        };
        views.iter().filter_map(|view| self.view(view, eye_of(view))).collect()
    }

    /// A view of the channel at the lower resolution, of the part of the target for this eye;
    /// `None` if it covers no pixel. Views that are side by side have no pixel in common.
    fn view(&self, view: &ViewDesc, eye: u32) -> Option<ViewDesc> {
        let [width, height] = self.full;
        let [left, top] = [f64::from(eye * width), 0.0];
        let [x, y, w, h] = view.viewport;
        let at = |axis: usize, pixel: f64| {
            (pixel + self.origin[axis]) * self.scale[axis] - self.first[axis] as f64
        };
        let shift = f64::from(eye * self.size[0]);
        let viewport =
            [at(0, x - left) + shift, at(1, y - top), w * self.scale[0], h * self.scale[1]];
        let [sx, sy, sw, sh] = view.scissor.unwrap_or([eye * width, 0, width, height]);
        let sx = sx.saturating_sub(eye * width);
        let span = |axis: usize, begin: u32, length: u32| {
            let (end, last) = (begin + length, self.size[axis]);
            let place = |pixel: u32| (at(axis, f64::from(pixel)).round().max(0.0) as u32).min(last);
            // The outermost views have what is drawn beyond the channel, too.
            let first = if begin == 0 { 0 } else { place(begin) };
            let after = if end >= self.full[axis] { last } else { place(end) };
            (first < after).then(|| [first, after - first])
        };
        let ([left, width], [top, height]) = (span(0, sx, sw)?, span(1, sy, sh)?);
        let scissor = Some([left + eye * self.size[0], top, width, height]);
        Some(ViewDesc { viewport: rounded(viewport), scissor, ..view.clone() })
    }
}

/// Whole pixels where rounding is all that is missing: tiles then shift their canvas by them.
fn rounded(viewport: [f64; 4]) -> [f64; 4] {
    viewport.map(|side| if (side - side.round()).abs() < 1e-6 { side.round() } else { side })
}
