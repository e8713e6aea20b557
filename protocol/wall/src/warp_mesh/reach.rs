//! The rectangle to which a map takes a cell of a picture, so that borders are found that pass
//! between the places at which the cell is looked at.

use glam::DVec2;

/// Share of their spread by which a smooth map may reach beyond the places of a cell: a parabola
/// through three even steps does so by no more.
const BETWEEN_SHARE: f64 = 1.0 / 8.0;

/// Places of a cell in pixels, row by row: its corners, the middles of its sides, its middle.
pub(crate) type CellPlaces = [DVec2; 9];

/// The part of a plane to which a map takes a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum CellReach {
    /// None: no place of the cell is there.
    Nowhere,
    /// Unknown: only some places of the cell are there.
    Partly,
    /// All of it is between these corners.
    Within { low: DVec2, high: DVec2 },
}

impl CellReach {
    /// The reach of a cell with these places, where `map` is smooth.
    pub fn new(places: &CellPlaces, map: impl Fn(DVec2) -> Option<DVec2>) -> Self {
        let mapped = places.map(map);
        let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low, high) = mapped
            .iter()
            .flatten()
            .fold(none, |(low, high), at: &DVec2| (low.min(*at), high.max(*at)));
        match mapped.iter().flatten().count() {
            0 => Self::Nowhere,
            9 => {
                let beside = (high - low) * BETWEEN_SHARE;
                Self::Within { low: low - beside, high: high + beside }
            }
            _ => Self::Partly,
        }
    }

    /// The reach on a surface that returns to itself after `around`: unknown over more than half
    /// of that, where there is a pole or the seam of all turns.
    #[must_use]
    pub fn on_turn(self, around: Option<f64>) -> Self {
        match (self, around) {
            (Self::Within { low, high }, Some(around)) if high.x - low.x > around / 2.0 => {
                Self::Partly
            }
            _ => self,
        }
    }

    /// Returns whether nothing of it lies in a rectangle.
    pub fn is_beside(self, begin: DVec2, end: DVec2) -> bool {
        match self {
            Self::Within { low, high } => high.cmplt(begin).any() || low.cmpgt(end).any(),
            Self::Nowhere | Self::Partly => false,
        }
    }

    /// Returns whether a part of it may lie in a rectangle and another beside it.
    pub fn crosses(self, begin: DVec2, end: DVec2) -> bool {
        match self {
            Self::Nowhere => false,
            Self::Partly => true,
            Self::Within { low, high } => {
                let is_inside = low.cmpge(begin).all() && high.cmple(end).all();
                !is_inside && !self.is_beside(begin, end)
            }
        }
    }
}
