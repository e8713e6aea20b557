//! The places of planes in their atlas: on shelves, in order.

use glam::{DVec2, UVec2};

use super::group::Group;
use super::{SIDE_STEP, SOURCE_GUARD};

/// Side of a picture that no texture holds, in pixels; what is seen from the side asks for more.
const SIDE_WANTED_MAX: f64 = 1e9;

/// The rectangles of all planes, guards included, and the size of their atlas; `None` where a
/// texture of `side_max` or `pixels_max` do not hold them. No picture gets more than `share` of
/// `pixels_max`: those that want the most are cut, such as the poles of a sphere, and not those of
/// what is between. Of the sides that are dense enough, each wants `scale`.
pub(super) fn pack(
    groups: &[Vec<Group>],
    (share, scale): (f64, f64),
    side_max: u32,
    pixels_max: f64,
) -> Option<(Vec<Vec<[u32; 4]>>, UVec2)> {
    let mut size = UVec2::ZERO;
    // x, y and height of the shelf that is being filled.
    let mut shelf = [0; 3];
    let mut pixels = 0.0;
    let mut places = Vec::with_capacity(groups.len());
    for groups in groups {
        let mut rects = Vec::with_capacity(groups.len());
        for group in groups {
            let wanted = wanted(group, scale);
            let sides = (wanted * left(wanted, share, side_max, pixels_max) / SIDE_STEP)
                .ceil()
                .max(DVec2::ONE)
                * SIDE_STEP;
            pixels += sides.x * sides.y;
            if !(pixels <= pixels_max && sides.max_element() <= f64::from(side_max)) {
                return None;
            }
            let [width, height] = (sides.as_uvec2() + 2 * SOURCE_GUARD).to_array();
            if shelf[0] + width > side_max {
                shelf = [0, shelf[1] + shelf[2], 0];
            }
            let [x, y, _] = shelf;
            if width > side_max || y + height > side_max {
                return None;
            }
            rects.push([x, y, width, height]);
            shelf = [x + width, y, shelf[2].max(height)];
            size = size.max(UVec2::new(x + width, y + height));
        }
        places.push(rects);
    }
    Some((places, size))
}

/// The sides of a picture; bounded where a pixel asks for no finite number.
fn wanted(group: &Group, scale: f64) -> DVec2 {
    (group.sides() * scale).min(DVec2::splat(SIDE_WANTED_MAX))
}

/// Returns the fraction that is left of the sides that a picture wants.
fn left(wanted: DVec2, share: f64, side_max: u32, pixels_max: f64) -> f64 {
    let pixels = share * pixels_max / wanted.element_product();
    // Sides are rounded up to whole steps.
    let steps = ((f64::from(side_max) - 2.0 * f64::from(SOURCE_GUARD)) / SIDE_STEP).floor();
    let of_side = (steps.max(1.0) - 1e-6) * SIDE_STEP / wanted.max_element();
    pixels.sqrt().min(of_side).min(1.0)
}

/// Returns the fraction that is left of the wanted sides of the picture that is cut most.
pub(super) fn least_left(
    groups: &[Vec<Group>],
    (share, scale): (f64, f64),
    side_max: u32,
    pixels_max: f64,
) -> f64 {
    let of = |group: &Group| left(wanted(group, scale), share, side_max, pixels_max);
    groups.iter().flatten().map(of).fold(1.0, f64::min)
}
