//! Places of one picture in a cell of another one, as a polynomial of the place in the cell.

use glam::DVec2;

use super::BESIDE;

/// Where a cell's places are found for [`Patch::curved`]: three times three, and four between them
/// that tell how far off the curves are.
pub(super) const PLACES: [(f64, f64); 13] = [
    (0.0, 0.0),
    (0.5, 0.0),
    (1.0, 0.0),
    (0.0, 0.5),
    (0.5, 0.5),
    (1.0, 0.5),
    (0.0, 1.0),
    (0.5, 1.0),
    (1.0, 1.0),
    (0.25, 0.25),
    (0.75, 0.25),
    (0.25, 0.75),
    (0.75, 0.75),
];

/// Where it is found how far [`Patch::linear`] is off: the middles of all, of the upper side and of
/// the left one.
pub(super) const MIDDLES: [(f64, f64); 3] = [(0.5, 0.5), (0.5, 0.0), (0.0, 0.5)];

/// Places in a cell, and how far they may be off, in pixels.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// Of u^i v^j at `[j][i]`, where (u, v) is the place in the cell, (0, 0) to (1, 1).
    factors: [[DVec2; 3]; 3],
    pub error_px: f64,
    /// Of the cell, in its pixels.
    size: DVec2,
}

/// The places of one row of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    place: [DVec2; 3],
    down: [DVec2; 3],
    width: f64,
}

impl Patch {
    /// The biquadratic patch through the first nine of [`PLACES`]; `None` where one is missing.
    pub fn curved(places: [Option<DVec2>; 13], size: DVec2) -> Option<Self> {
        let mut found = [DVec2::ZERO; 13];
        for (found, place) in found.iter_mut().zip(places) {
            *found = place?;
        }
        // The parabola through values at 0, 1/2 and 1.
        let parabola = |[a, b, c]: [DVec2; 3]| [a, b * 4.0 - a * 3.0 - c, (a + c) * 2.0 - b * 4.0];
        let rows = [0, 3, 6].map(|at| parabola([found[at], found[at + 1], found[at + 2]]));
        let columns = [0, 1, 2].map(|power| parabola(rows.map(|row| row[power])));
        let factors = [0, 1, 2].map(|j| columns.map(|column| column[j]));
        let mut patch = Self { factors, error_px: 0.0, size };
        // A cubic remainder is within 3 % of its largest there; twice as much, since the worst
        // place may be another.
        let checks = PLACES[9..].iter().zip(&found[9..]);
        let off = checks.map(|((u, v), place)| patch.at(*u, *v).distance(*place));
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
        let zero = DVec2::ZERO;
        let factors = [[a, b - a, zero], [c - a, a - b - c + d, zero], [zero; 3]];
        Some(Self { factors, error_px: 2.0 * errors.into_iter().fold(0.0, f64::max), size })
    }

    fn at(&self, u: f64, v: f64) -> DVec2 {
        let row = self.factors.map(|[a, b, c]| a + (b + c * u) * u);
        row[0] + (row[1] + row[2] * v) * v
    }

    /// Whether all of it lies beyond one side of a picture of this size.
    pub fn is_beside(&self, picture: DVec2) -> bool {
        // What bounds a Bézier patch: its control points.
        let control = |[a, b, c]: [DVec2; 3]| [a, a + b * 0.5, a + b + c];
        let columns = [0, 1, 2].map(|i| control(self.factors.map(|row| row[i])));
        let points = [0, 1, 2].map(|j| control(columns.map(|column| column[j])));
        let points = points.as_flattened();
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let slack = self.error_px * 2.0 + BESIDE;
        (low - slack).cmpgt(picture).any() || (high + slack).cmplt(DVec2::ZERO).any()
    }

    /// The row of places at this distance from the cell's upper side, in pixels.
    pub fn row(&self, y: f64) -> Row {
        let v = y / self.size.y;
        let [a, b, c] = self.factors;
        Row {
            place: [0, 1, 2].map(|i| a[i] + (b[i] + c[i] * v) * v),
            down: [0, 1, 2].map(|i| (b[i] + c[i] * (2.0 * v)) / self.size.y),
            width: self.size.x,
        }
    }
}

impl Row {
    /// The place at this distance from the cell's left side, in pixels.
    pub fn at(&self, x: f64) -> DVec2 {
        let u = x / self.width;
        self.place[0] + (self.place[1] + self.place[2] * u) * u
    }

    /// By what the place moves from pixel to pixel, across and down.
    pub fn slope(&self, x: f64) -> [DVec2; 2] {
        let u = x / self.width;
        let across = (self.place[1] + self.place[2] * (2.0 * u)) / self.width;
        [across, self.down[0] + (self.down[1] + self.down[2] * u) * u]
    }
}
