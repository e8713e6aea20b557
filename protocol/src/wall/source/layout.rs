//! Where planes stand in their atlas: on shelves, in order.

use glam::{DVec2, UVec2};

use super::group::Group;
use super::{SIDE_STEP, SOURCE_GUARD};

/// Side of a picture that no texture holds, in pixels; pixels seen along their surface ask for
/// more.
const SIDE_WANTED_MAX: f64 = 1e9;

/// The rectangles of all planes, guards included, and the size of their atlas; `None` where a
/// texture of `side_max` or `pixels_max` do not hold them. `cut` scales all sides.
pub(super) fn place(
    groups: &[Vec<Group>],
    cut: f64,
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
            // Bounded, so that a small `cut` is enough for a pixel that asks for no finite number.
            let wanted = group.sides().min(DVec2::splat(SIDE_WANTED_MAX));
            let sides = (wanted * cut / SIDE_STEP).ceil().max(DVec2::ONE) * SIDE_STEP;
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
