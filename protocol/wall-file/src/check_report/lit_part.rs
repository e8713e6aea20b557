//! The part of a channel's picture that lands on its screen: a projector may throw beyond it, a
//! calibration file may leave pixels dark.

use glam::DVec2;

use crate::coverage::Footprint;

/// Places across and down at which light is looked for.
const SIDE: u32 = 64;

/// Maximum number of closer looks: each is at least eight times as close as the one before.
const LOOKS_MAX: usize = 6;

/// Fewer lit places than these, and the part is looked at more closely.
const LIT_FEW: usize = 64;

/// The lit part of a picture, in pixels from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LitPart {
    /// The share of the picture's pixels that land on the screen, 0 to 1.
    pub share: f64,
    /// Upper left corner of the rectangle around it.
    pub low: DVec2,
    /// Lower right corner of that rectangle.
    pub high: DVec2,
    /// A lit place near the rectangle's middle.
    pub middle: DVec2,
}

impl LitPart {
    /// The whole of a picture of this size.
    pub fn whole(size: DVec2) -> Self {
        Self { share: 1.0, low: DVec2::ZERO, high: size, middle: size / 2.0 }
    }

    /// The part of a picture of this size that lands on a canvas; `None` if nothing does.
    pub fn new(print: &Footprint<'_>, size: DVec2, canvas: DVec2) -> Option<Self> {
        let mut look = Look::new(print, DVec2::ZERO, size);
        if look.lit.is_empty() {
            // A screen that is small in the picture lies between the places.
            look = Look::around(print, size, canvas)?;
        }
        for _ in 0..LOOKS_MAX {
            if look.lit.len() >= LIT_FEW {
                break;
            }
            let (low, high) = look.bounds(size);
            let closer = Look::new(print, low, high);
            if closer.lit.is_empty() {
                break;
            }
            look = closer;
        }
        let (low, high) = look.bounds(size);
        let middle = (low + high) / 2.0;
        let near = look
            .lit
            .iter()
            .min_by(|a, b| a.distance_squared(middle).total_cmp(&b.distance_squared(middle)))?;
        let middle = print.lit_point(middle).map_or(*near, |_| middle);
        let looked = look.step * f64::from(SIDE) / size;
        let share = look.lit.len() as f64 / f64::from(SIDE * SIDE) * looked.element_product();
        Some(Self { share: share.min(1.0), low, high, middle })
    }
}

/// A look at the middles of equal cells.
struct Look {
    /// The size of a cell, in pixels.
    step: DVec2,
    /// The places that land on the screen.
    lit: Vec<DVec2>,
}

impl Look {
    fn new(print: &Footprint<'_>, low: DVec2, high: DVec2) -> Self {
        let step = (high - low) / f64::from(SIDE);
        let places = middles().map(|at| low + at * (high - low));
        Self { step, lit: places.filter(|place| print.lit_point(*place).is_some()).collect() }
    }

    /// A look at where places of the canvas are in the picture.
    fn around(print: &Footprint<'_>, size: DVec2, canvas: DVec2) -> Option<Self> {
        let pixels: Vec<DVec2> = middles().filter_map(|at| print.pixel_at(at * canvas)).collect();
        let low = pixels.iter().copied().reduce(DVec2::min)?;
        let high = pixels.iter().copied().reduce(DVec2::max)?;
        let margin = (high - low) / 2.0 + 1.0;
        let looked = Self::new(print, (low - margin).max(DVec2::ZERO), (high + margin).min(size));
        // Places on an edge may be lit in one direction of the calculation only.
        let is_lit = |pixel: &DVec2| print.lit_point(*pixel).is_some();
        let step = DVec2::splat(1.0 / f64::from(SIDE));
        let lit = if looked.lit.is_empty() {
            Self { step, lit: pixels.into_iter().filter(is_lit).take(1).collect() }
        } else {
            looked
        };
        (!lit.lit.is_empty()).then_some(lit)
    }

    /// The rectangle around all cells that touch a lit one, within a picture of this size.
    fn bounds(&self, size: DVec2) -> (DVec2, DVec2) {
        let low = self.lit.iter().copied().reduce(DVec2::min).unwrap_or_default();
        let high = self.lit.iter().copied().reduce(DVec2::max).unwrap_or_default();
        ((low - self.step).max(DVec2::ZERO), (high + self.step).min(size))
    }
}

/// The middles of cells, in the unit square.
fn middles() -> impl Iterator<Item = DVec2> {
    let at = |step: u32| (f64::from(step) + 0.5) / f64::from(SIDE);
    (0..SIDE).flat_map(move |y| (0..SIDE).map(move |x| DVec2::new(at(x), at(y))))
}
