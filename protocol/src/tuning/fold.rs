//! Whether a picture is folded: pins or bends that let two of its pixels lie on one place.

use glam::{DVec2, UVec2};

use crate::wall::pixels::PixelMap;
use crate::wall::{Channel, Screen};

/// Places that are looked at between two points of a bend, each way: between them it is a cubic
/// spline, which has at most two turns.
const PLACES_PER_CELL: u32 = 4;

/// A picture that cannot be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fold {
    /// `pin` or `bend`.
    pub key: &'static str,
    /// What is wrong, and what would be right.
    pub what: &'static str,
}

/// What is folded of a channel's picture, if anything.
pub fn fault(channel: &Channel) -> Option<Fold> {
    // Of a pin and a bend only the channel's own size matters, not what it lies on.
    let flat = Screen::new("", crate::wall::surface::Surface::Mesh(0), UVec2::ONE);
    let size = channel.size.as_dvec2();
    let corners = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|at| at * size);
    let [a, b, c] = [0, 1, 2].map(|at| corners[at] + channel.adjustment.pin[at]);
    let is_turned_over = (b - a).perp_dot(c - a) <= 0.0;
    let Some(map) = PixelMap::new(channel, &flat).filter(|_| !is_turned_over) else {
        let what = "the four corners would make no convex picture; move it less";
        return Some(Fold { key: "pin", what });
    };
    let bend = channel.adjustment.bend.as_ref()?;
    let places = (bend.points - 1) * PLACES_PER_CELL;
    let step = size / places.as_dvec2();
    let folded = Fold { key: "bend", what: "the picture would be folded there; move it less" };
    let row = |y: u32| -> Option<Vec<DVec2>> {
        let places = (0..=places.x).map(|x| UVec2::new(x, y).as_dvec2() * step);
        places.map(|pixel| map.unbent(pixel)).collect()
    };
    let Some(mut above) = row(0) else { return Some(folded) };
    for y in 1..=places.y {
        let Some(below) = row(y) else { return Some(folded) };
        for (up, low) in above.windows(2).zip(below.windows(2)) {
            // Both triangles of each cell must keep the turn that they had.
            let upper = (up[1] - up[0]).perp_dot(low[0] - up[0]);
            let lower = (low[0] - low[1]).perp_dot(up[1] - low[1]);
            if !(upper > 0.0 && lower > 0.0) {
                return Some(folded);
            }
        }
        above = below;
    }
    None
}
