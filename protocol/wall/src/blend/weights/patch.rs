//! Places of one picture in a cell of another one, as a polynomial of the place in the cell.

use glam::DVec2;

use super::BESIDE;

/// Nodes of [`Patch::curved`], across and down.
const NODES: usize = 4;

/// Places from which [`Patch::curved`] is made: its nodes, and those that tell how far it is off.
pub(super) const PLACES: usize = NODES * NODES + 4;

/// Places in a cell where a patch's error is checked, one of each sign: there a cubic's remainder
/// is within 6 % of its largest.
const CHECKS: [f64; 2] = [1.0 / 6.0, 5.0 / 6.0];

/// The places of a cell, from (0, 0) to (1, 1), from which [`Patch::curved`] is made.
pub(super) fn places() -> [(f64, f64); PLACES] {
    let node = |at: usize| at as f64 / (NODES - 1) as f64;
    std::array::from_fn(|at| match at.checked_sub(NODES * NODES) {
        None => (node(at % NODES), node(at / NODES)),
        Some(check) => (CHECKS[check % 2], CHECKS[check / 2]),
    })
}

/// Places where the error of [`Patch::linear`] is measured: the middles of the cell, of its upper
/// side and of its left one.
pub(super) const MIDDLES: [(f64, f64); 3] = [(0.5, 0.5), (0.5, 0.0), (0.0, 0.5)];

/// Places in a cell, and how far they may be off, in pixels.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// The factors of u^i v^j at `[j][i]`, where (u, v) is the place in the cell, (0, 0) to (1, 1).
    factors: [[DVec2; NODES]; NODES],
    pub error_px: f64,
    /// The size of the cell, in its pixels.
    size: DVec2,
}

/// The places of one row of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    place: [DVec2; NODES],
    down: [DVec2; NODES],
    width: f64,
}

impl Patch {
    /// The bicubic patch through the nodes among [`places`]; `None` where one is missing.
    pub fn curved(found: &[Option<DVec2>; PLACES], size: DVec2) -> Option<Self> {
        let mut exact = [DVec2::ZERO; PLACES];
        for (exact, found) in exact.iter_mut().zip(found) {
            *exact = (*found)?;
        }
        let rows = [0, 1, 2, 3].map(|row| cubic([0, 1, 2, 3].map(|at| exact[row * NODES + at])));
        let columns = [0, 1, 2, 3].map(|power| cubic(rows.map(|row| row[power])));
        let factors = [0, 1, 2, 3].map(|j| columns.map(|column| column[j]));
        let mut patch = Self { factors, error_px: 0.0, size };
        let checks = places().into_iter().zip(exact).skip(NODES * NODES);
        let off = checks.map(|((u, v), place)| patch.at(u, v).distance(place));
        // Twice as much, since the worst place may be another.
        patch.error_px = 2.0 * off.fold(0.0, f64::max);
        patch.error_px.is_finite().then_some(patch)
    }

    /// The patch that is linear between four corners; how far it is off is seen at [`MIDDLES`],
    /// twice as much being taken, since the worst place may be another.
    pub fn linear(
        corners: [Option<DVec2>; 4],
        exact: [Option<DVec2>; 3],
        size: DVec2,
    ) -> Option<Self> {
        let ([Some(a), Some(b), Some(c), Some(d)], [Some(middle), Some(above), Some(left)]) =
            (corners, exact)
        else {
            return None;
        };
        let errors = [
            ((a + b + c + d) / 4.0).distance(middle),
            ((a + b) / 2.0).distance(above),
            ((a + c) / 2.0).distance(left),
        ];
        let mut factors = [[DVec2::ZERO; NODES]; NODES];
        factors[0][..2].copy_from_slice(&[a, b - a]);
        factors[1][..2].copy_from_slice(&[c - a, a - b - c + d]);
        Some(Self { factors, error_px: 2.0 * errors.into_iter().fold(0.0, f64::max), size })
    }

    fn at(&self, u: f64, v: f64) -> DVec2 {
        value(self.factors.map(|row| value(row, u)), v)
    }

    /// Returns whether all of it lies beyond one side of a picture of this size.
    pub fn is_beside(&self, picture: DVec2) -> bool {
        // What bounds a Bézier patch: its control points.
        let control =
            |[a, b, c, d]: [DVec2; NODES]| [a, a + b / 3.0, a + (b * 2.0 + c) / 3.0, a + b + c + d];
        let columns = [0, 1, 2, 3].map(|i| control(self.factors.map(|row| row[i])));
        let points = [0, 1, 2, 3].map(|j| control(columns.map(|column| column[j])));
        let points = points.as_flattened();
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let slack = self.error_px * 2.0 + BESIDE;
        (low - slack).cmpgt(picture).any() || (high + slack).cmplt(DVec2::ZERO).any()
    }

    /// The row of places at this distance from the cell's upper side, in pixels.
    pub fn row(&self, y: f64) -> Row {
        let v = y / self.size.y;
        let columns = [0, 1, 2, 3].map(|i| self.factors.map(|row| row[i]));
        Row {
            place: columns.map(|column| value(column, v)),
            down: columns.map(|column| slope(column, v) / self.size.y),
            width: self.size.x,
        }
    }
}

impl Row {
    /// The place at this distance from the cell's left side, in pixels.
    pub fn at(&self, x: f64) -> DVec2 {
        value(self.place, x / self.width)
    }

    /// By what the place moves from pixel to pixel, across and down.
    pub fn slope(&self, x: f64) -> [DVec2; 2] {
        let u = x / self.width;
        [slope(self.place, u) / self.width, value(self.down, u)]
    }
}

/// The factors of the cubic through values at 0, 1/3, 2/3 and 1.
fn cubic([a, b, c, d]: [DVec2; NODES]) -> [DVec2; NODES] {
    [
        a,
        (b * 18.0 - a * 11.0 - c * 9.0 + d * 2.0) / 2.0,
        (a * 2.0 - b * 5.0 + c * 4.0 - d) * 4.5,
        (b * 3.0 - a - c * 3.0 + d) * 4.5,
    ]
}

fn value([a, b, c, d]: [DVec2; NODES], at: f64) -> DVec2 {
    a + (b + (c + d * at) * at) * at
}

fn slope([_, b, c, d]: [DVec2; NODES], at: f64) -> DVec2 {
    b + (c * 2.0 + d * (3.0 * at)) * at
}
