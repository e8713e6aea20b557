//! Windows of one screen, moved apart where its channels share a part of it.

use glam::{DVec2, I64Vec2};

use super::super::{Eye, Wall};
use super::Area;

/// Distances between channels are stretched by this at most; where that is not enough, they lie on
/// each other almost wholly, and a plain grid shows more.
const STRETCH_MAX: f64 = 4.0;

/// The area of each of these channels of one screen.
///
/// Tiles lie as on the screen. Channels for the left eye that lie on those for the right one come
/// to lie beside them, as a whole. Projectors that overlap keep their order and are moved apart.
pub(super) fn separate(wall: &Wall, channels: &[usize]) -> Vec<Area> {
    let area = |&id: &usize| {
        let channel = &wall.channels[id];
        let size = channel.display_size().max(glam::UVec2::ONE);
        Area { origin: channel.origin.as_i64vec2(), size: size.as_i64vec2() }
    };
    let mut areas: Vec<Area> = channels.iter().map(area).collect();
    let eye = |index: usize| wall.channels[channels[index]].adjustment.eye;
    let eyes = [Eye::Left, Eye::Center, Eye::Right];
    let groups = eyes.map(|of| (0..channels.len()).filter(|&i| eye(i) == of).collect::<Vec<_>>());
    for group in &groups {
        let apart = stretched(&group.iter().map(|&i| areas[i]).collect::<Vec<_>>());
        for (&index, area) in group.iter().zip(apart) {
            areas[index] = area;
        }
    }
    if is_disjoint(&areas) {
        return areas;
    }
    let mut left = 0;
    for group in groups.iter().filter(|group| !group.is_empty()) {
        let around = Area::around(group.iter().map(|&i| areas[i]));
        for &index in group {
            let by = I64Vec2::new(left - around.origin.x, -around.origin.y);
            areas[index] = areas[index].moved(by);
        }
        left += around.size.x;
    }
    areas
}

/// Returns the areas with their distances stretched by as little as makes them disjoint.
fn stretched(areas: &[Area]) -> Vec<Area> {
    let center = |area: &Area| (area.origin + area.end()).as_dvec2() / 2.0;
    let mut stretch = DVec2::ONE;
    for (index, a) in areas.iter().enumerate() {
        for b in areas[..index].iter().filter(|b| a.overlaps(b)) {
            let apart = (center(a) - center(b)).abs();
            let needed = (a.size + b.size).as_dvec2() / 2.0 / apart;
            // Divided by nothing, it is infinite.
            if needed.x <= needed.y {
                stretch.x = stretch.x.max(needed.x);
            } else {
                stretch.y = stretch.y.max(needed.y);
            }
        }
    }
    if stretch == DVec2::ONE {
        return areas.to_vec();
    }
    if stretch.max_element() <= STRETCH_MAX {
        let place = |area: &Area| {
            let origin = center(area) * stretch - area.size.as_dvec2() / 2.0;
            // Rounded in one direction, what touches goes on to touch.
            Area { origin: (origin - 1e-6).ceil().as_i64vec2(), ..*area }
        };
        let apart: Vec<Area> = areas.iter().map(place).collect();
        if is_disjoint(&apart) {
            return apart;
        }
    }
    let sizes: Vec<I64Vec2> = areas.iter().map(|area| area.size).collect();
    grid(&sizes).into_iter().zip(sizes).map(|(origin, size)| Area { origin, size }).collect()
}

fn is_disjoint(areas: &[Area]) -> bool {
    areas.iter().enumerate().all(|(index, a)| areas[..index].iter().all(|b| !a.overlaps(b)))
}

/// Upper left corners of boxes of these sizes in rows of about as many as there are rows, from the
/// upper left on.
pub(super) fn grid(sizes: &[I64Vec2]) -> Vec<I64Vec2> {
    let across = (sizes.len() as f64).sqrt().ceil().max(1.0) as usize;
    let cell = sizes.iter().copied().fold(I64Vec2::ZERO, I64Vec2::max);
    let place = |index: usize| I64Vec2::new((index % across) as i64, (index / across) as i64);
    (0..sizes.len()).map(|index| place(index) * cell).collect()
}
