//! The check for a folded picture of a channel: pins or bends that let two of its pixels lie on one
//! place, or that mirror it. Wall files and tunings are held to the same rule, so that a tuned
//! picture can be saved and read again.

use glam::{DVec2, UVec2};

use super::channel_mapping::ChannelMapping;
use super::surface::Surface;
use super::{Channel, ChannelKind, Screen};

/// Steps of a bend's cells at which it is looked at: between two points it is a cubic spline, which
/// has at most two turns.
const STEPS_OF_CELL: u32 = 4;

/// Maximum distance in pixels of a place from itself, after it was moved by pins and bends and
/// back.
const ASTRAY_MAX_PX: f64 = 1e-3;

/// A picture that cannot be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}; {remedy}")]
pub struct FoldoverError {
    /// `pin` or `bend`.
    pub key: &'static str,
    /// The fault.
    pub what: &'static str,
    /// The fix.
    pub remedy: &'static str,
}

/// Returns the fold of a channel's picture, if any.
pub fn fault(channel: &Channel) -> Option<FoldoverError> {
    // Of pins and bends only the picture's own size matters: as a tile of nothing, whatever it is.
    let nothing = Screen::new("", Surface::Mesh(0), UVec2::ONE);
    let mut tile = channel.clone();
    (tile.cover, tile.origin) = (ChannelKind::Tile, UVec2::ZERO);
    let bend = tile.adjustment.bend.take();
    let is_flat = |tile: &Channel, steps| {
        ChannelMapping::new(tile, &nothing).is_some_and(|map| is_flat(&map, tile.size, steps))
    };
    if tile.adjustment.pin != [DVec2::ZERO; 4] && !is_flat(&tile, UVec2::ONE) {
        return Some(FoldoverError {
            key: "pin",
            what: "the pins fold the picture, or mirror it",
            remedy: "move corners by less than they are apart; to mirror, see mirror",
        });
    }
    let steps = (bend.as_ref()?.points - 1) * STEPS_OF_CELL;
    tile.adjustment.bend = bend;
    (!is_flat(&tile, steps)).then_some(FoldoverError {
        key: "bend",
        what: "the bend folds the picture, or nearly",
        remedy: "move its points by less than they are apart, and neighbours alike",
    })
}

/// Returns whether the picture keeps its side everywhere, and all its places are found again.
fn is_flat(map: &ChannelMapping<'_>, size: UVec2, steps: UVec2) -> bool {
    let place = |x: u32, y: u32| {
        let at = UVec2::new(x, y).as_dvec2() / steps.as_dvec2() * size.as_dvec2();
        let pixel = map.pixel_from_canvas(at)?;
        map.canvas_from_pixel(pixel).filter(|back| back.distance(at) < ASTRAY_MAX_PX).map(|_| pixel)
    };
    let row = |y: u32| (0..=steps.x).map(|x| place(x, y)).collect::<Option<Vec<DVec2>>>();
    let Some(mut above) = row(0) else { return false };
    for y in 1..=steps.y {
        let Some(below) = row(y) else { return false };
        for (upper, lower) in above.windows(2).zip(below.windows(2)) {
            let (right, down) = (upper[1] - upper[0], lower[0] - upper[0]);
            let (left, up) = (lower[0] - lower[1], upper[1] - lower[1]);
            if right.perp_dot(down) <= 0.0 || left.perp_dot(up) <= 0.0 {
                return false;
            }
        }
        above = below;
    }
    true
}
