//! Backgrounds: what surrounds a scene or lies below all of it, such as a sky dome, a ground plane
//! or a sea to the horizon. An overview of the scene leaves them out, since all else would be a
//! dot.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use glam::DVec3;
use polyptych_scene::{Bounds, Node, OVERVIEW_NOTE};
use polyptych_text::counted;

use super::uri;

/// Minimum ratio of the longest side of a background's box to that of the box of all else. Rooms
/// and plinths are a few times as large as what stands in them.
const RATIO_MIN: f64 = 16.0;

/// Minimum ratio of the longest side of a plane's box to its shortest: seas have waves, and grounds
/// have hills.
const FLATNESS_MIN: f64 = 20.0;

/// Maximum ratio of the longest side of a shell's box to its shortest: the two of a dome are two
/// times as different, and grounds with hills are flatter.
const SHELL_FLATNESS_MAX: f64 = 3.0;

/// Maximum distance of the middle of all else from that of a background's box, as a share of half
/// of the box's side: a handle in the corner of a door is no scene in front of a background.
const OFF_CENTER_MAX: f64 = 0.5;

/// Maximum number of parts that can be backgrounds: the six sides of a sky and some planes.
const PARTS_MAX: usize = 64;

/// The box around a part of a scene, in world space: a mesh in one of its places. Large primitives
/// are in pieces by now, which are no parts of their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DrawnBox {
    pub bounds: Bounds,
    /// Triangles, lines and points in it.
    pub elements: u64,
    /// The index of its node.
    pub node: u32,
}

/// The extent of a scene that an overview shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Overview {
    /// The box around all parts that are no backgrounds; `None` if nothing is drawn.
    pub bounds: Option<Bounds>,
    /// The nodes of the backgrounds.
    pub backgrounds: BTreeSet<u32>,
    /// The nodes of those backgrounds that are shells around the rest, with the ratio of the
    /// longest side of each one's box to that of `bounds`.
    pub shells: BTreeMap<u32, f64>,
    /// The ratio of the longest side of the smallest background's box to that of `bounds`; 0 if
    /// there are no backgrounds.
    pub ratio: f64,
}

impl Overview {
    /// The note that names the first background, if there is one.
    pub(super) fn note(&self, nodes: &[Node]) -> Option<String> {
        let first = nodes.get(*self.backgrounds.first()? as usize)?;
        let more = match self.backgrounds.len() as u64 - 1 {
            0 => String::new(),
            more => format!(" and {}", counted(more, "more background")),
        };
        let (name, ratio) = (uri::shorten(&first.name), self.ratio.round());
        Some(format!("{OVERVIEW_NOTE} '{name}'{more}: {ratio} times as long as all else"))
    }
}

/// Finds the backgrounds among the parts of a scene, which are added one by one.
///
/// Backgrounds are the largest parts, if each of them is at least [`RATIO_MIN`] times as long as
/// the box of all smaller parts, is a plane that these stand on or hang in front of, or a shell
/// that they stand in the middle of, and all of them together have no more triangles per length of
/// their boxes than all else.
#[derive(Debug, Default)]
pub(super) struct BackgroundSearch {
    /// The largest parts, of which the smallest is first.
    largest: BinaryHeap<Reverse<BySize>>,
    rest: Rest,
}

impl BackgroundSearch {
    /// Adds a part. Its box must be finite.
    pub(super) fn add(&mut self, part: DrawnBox) {
        self.largest.push(Reverse(BySize(part)));
        if self.largest.len() > PARTS_MAX
            && let Some(Reverse(BySize(smallest))) = self.largest.pop()
        {
            self.rest.add(&smallest);
        }
    }

    /// Divides what was added into backgrounds and all else.
    pub(super) fn overview(self) -> Overview {
        let Self { largest, mut rest } = self;
        // Sorted by `Reverse`, so the largest is first.
        let parts: Vec<DrawnBox> =
            largest.into_sorted_vec().into_iter().map(|Reverse(BySize(part))| part).collect();
        let mut overview = Overview::default();
        for count in (0..parts.len()).rev() {
            let (largest, smallest) = (&parts[..=count], &parts[count]);
            if overview.backgrounds.is_empty()
                && let Some(bounds) = rest.bounds
                && are_backgrounds(largest, &bounds, rest.elements)
            {
                overview.backgrounds = largest.iter().map(|part| part.node).collect();
                let ratio = |part: &DrawnBox| length(&part.bounds) / length(&bounds);
                let shells = largest.iter().filter(|part| is_shell(&part.bounds));
                overview.shells = shells.map(|part| (part.node, ratio(part))).collect();
                overview.ratio = ratio(smallest);
                overview.bounds = Some(bounds);
            }
            rest.add(smallest);
        }
        overview.bounds = overview.bounds.or(rest.bounds);
        overview
    }
}

/// The box around parts, and what they hold.
#[derive(Debug, Default)]
struct Rest {
    bounds: Option<Bounds>,
    elements: u64,
}

impl Rest {
    fn add(&mut self, part: &DrawnBox) {
        let Bounds { min, max } = part.bounds;
        self.bounds = Some(
            self.bounds
                .map_or(part.bounds, |of| Bounds { min: of.min.min(min), max: of.max.max(max) }),
        );
        self.elements = self.elements.saturating_add(part.elements);
    }
}

/// Returns whether all of these parts, the largest first, are backgrounds of a box with so many
/// elements.
fn are_backgrounds(parts: &[DrawnBox], rest: &Bounds, elements: u64) -> bool {
    let smallest = parts.iter().map(|part| length(&part.bounds)).fold(f64::MAX, f64::min);
    let ratio = smallest / length(rest);
    // A point has no length, and what is seen at its scale is not known.
    if !(ratio >= RATIO_MIN && ratio.is_finite()) {
        return false;
    }
    let of_parts = parts.iter().map(|part| part.elements as f64 / length(&part.bounds));
    of_parts.sum::<f64>() <= elements as f64 / length(rest)
        && parts.iter().all(|part| is_around(&part.bounds, rest))
}

/// Returns whether the middle of a box is in front of the middle of a plane, or in a shell.
fn is_around(part: &Bounds, rest: &Bounds) -> bool {
    let half = (part.max - part.min) * 0.5;
    let off = (rest.center() - part.center()).abs();
    let longest = half.max_element();
    let is_central = off.cmple(half * OFF_CENTER_MAX);
    let central = [is_central.x, is_central.y, is_central.z].into_iter().filter(|of| *of).count();
    let is_plane = half.min_element() * FLATNESS_MIN <= longest;
    let reach = if is_plane { DVec3::splat(longest + length(rest)) } else { half };
    // A dome has its scene at its lower end, a plane beside it.
    central >= 2 && off.cmple(reach).all()
}

/// Returns whether a box is about as high as it is wide.
fn is_shell(part: &Bounds) -> bool {
    let sides = part.max - part.min;
    sides.min_element() * SHELL_FLATNESS_MAX >= sides.max_element()
}

/// The longest side of a box.
fn length(bounds: &Bounds) -> f64 {
    (bounds.max - bounds.min).max_element()
}

/// Orders parts by their length, equal ones by what they are, so that the order is that of no file.
#[derive(Debug, PartialEq)]
struct BySize(DrawnBox);

impl Eq for BySize {}

impl PartialOrd for BySize {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for BySize {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let of_length = length(&self.0.bounds).total_cmp(&length(&other.0.bounds));
        of_length.then_with(|| other.0.node.cmp(&self.0.node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(min: [f64; 3], max: [f64; 3], elements: u64) -> DrawnBox {
        DrawnBox { bounds: Bounds { min: min.into(), max: max.into() }, elements, node: 0 }
    }

    /// The numbers of the parts that are backgrounds.
    fn backgrounds(parts: &[DrawnBox]) -> Vec<u32> {
        let mut search = BackgroundSearch::default();
        for (node, part) in (0..).zip(parts) {
            search.add(DrawnBox { node, ..*part });
        }
        let overview = search.overview();
        let is_shown = |node: u32| !overview.backgrounds.contains(&node);
        let mut rest = Rest::default();
        for (_, part) in (0..).zip(parts).filter(|(node, _)| is_shown(*node)) {
            rest.add(part);
        }
        assert_eq!(overview.bounds, rest.bounds);
        overview.backgrounds.into_iter().collect()
    }

    const MODEL: ([f64; 3], [f64; 3]) = ([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]);

    fn model() -> DrawnBox {
        part(MODEL.0, MODEL.1, 12)
    }

    #[test]
    fn leaves_out_planes_domes_and_seas() {
        let ground = part([-50.0, 0.0, -50.0], [50.0, 0.0, 50.0], 2);
        let sea = part([-4e3, -3.0, -5e3], [5e3, 3.0, 4e3], 512);
        let dome = part([-1e3, 0.0, -1e3], [1e3, 1e3, 1e3], 2048);
        let sphere = part([-500.0; 3], [500.0; 3], 1024);
        let wall = part([-40.0, -15.0, -3.0], [40.0, 15.0, -3.0], 2);
        for background in [ground, sea, dome, sphere, wall] {
            assert_eq!(backgrounds(&[background, model()]), [0], "{background:?}");
            assert_eq!(backgrounds(&[model(), background]), [1], "{background:?}");
        }
        assert_eq!(backgrounds(&[model(), ground, dome, sphere, sea]), [1, 2, 3, 4]);
    }

    #[test]
    fn leaves_out_a_sky_of_six_sides() {
        let side = |axis: usize, at: f64| {
            let (mut min, mut max) = ([-100.0; 3], [100.0; 3]);
            (min[axis], max[axis]) = (at, at);
            part(min, max, 2)
        };
        let mut parts: Vec<DrawnBox> =
            (0..6).map(|i| side(i / 2, [-100.0, 100.0][i % 2])).collect();
        parts.push(model());
        assert_eq!(backgrounds(&parts), [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn keeps_what_is_the_scene_itself() {
        let none: [u32; 0] = [];
        assert_eq!(backgrounds(&[]), none);
        assert_eq!(backgrounds(&[part([-50.0; 3], [50.0; 3], 2)]), none);
        // A room, a plinth that is not much larger, and a handle at the side of a door.
        let room = part([-6.0, 0.0, -6.0], [6.0, 4.0, 6.0], 40);
        assert_eq!(backgrounds(&[room, model()]), none);
        let handle = part([0.35, 1.0, 0.0], [0.4, 1.05, 0.05], 900);
        let door = part([-0.45, 0.0, -0.04], [0.45, 2.1, 0.0], 12);
        assert_eq!(backgrounds(&[door, handle]), none);
        // A knob in the middle of a cabinet, and a moon far from its planet.
        let knob = part([-0.02, 0.48, 0.4], [0.02, 0.52, 0.43], 900);
        assert_eq!(backgrounds(&[part([-0.5, 0.0, -0.4], [0.5, 1.0, 0.4], 12), knob]), none);
        let moon = part([2.9, -0.1, -0.1], [3.1, 0.1, 0.1], 900);
        assert_eq!(backgrounds(&[part([-1.0; 3], [1.0; 3], 900), moon]), none);
        // A terrain that is finer than the house on it.
        let terrain = part([-500.0, -20.0, -500.0], [500.0, 20.0, 500.0], 200_000);
        assert_eq!(backgrounds(&[terrain, part(MODEL.0, MODEL.1, 300)]), none);
        assert_eq!(backgrounds(&[terrain, part([0.0; 3], [0.0; 3], 1)]), none);
    }

    #[test]
    fn finds_backgrounds_among_many_small_parts() {
        let mut parts: Vec<DrawnBox> = (0..1000)
            .map(|i| f64::from(i % 100))
            .map(|x| part([x - 50.0, 0.0, 0.0], [x - 49.0, 3.0, 1.0], 20))
            .collect();
        parts.push(part([-2e3, -0.1, -2e3], [2e3, -0.1, 2e3], 96));
        assert_eq!(backgrounds(&parts), [1000]);
    }
}
