//! Screens that cross each other or lie in the same place, which no two real ones do.

use glam::{DVec2, DVec3};
use polyptych_wall::{Channel, Eye, Surface, Wall};

use crate::coverage::is_seen_by;

/// Places of a screen along each side; the first and last one are near its edges.
const SIDE: usize = 18;

/// Distance of the outermost places from an edge, as a share of the side: screens may touch.
const INSET: f64 = 0.005;

/// Minimum distance from a surface of a point that does not lie on it, in metres; of a screen
/// smaller than a metre, as a share of its radius.
const ON_SURFACE_MAX: f64 = 1e-3;

/// Maximum number of pairs that are named.
const PAIRS_MAX: usize = 4;

/// The way in which two screens meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meeting {
    Apart,
    Cross,
    SamePlace,
}

/// A warning for each pair of screens that meet, of those that one eye sees.
pub(super) fn warnings(wall: &Wall) -> Vec<String> {
    let grids: Vec<Option<Grid<'_>>> =
        wall.screens.iter().map(|screen| Grid::new(&screen.surface)).collect();
    let mut said = Vec::new();
    let mut more = 0;
    for (second, b) in grids.iter().enumerate() {
        for (first, a) in grids[..second].iter().enumerate() {
            let (Some(a), Some(b)) = (a, b) else { continue };
            if !a.may_meet(b) || !is_seen_together(wall, first, second) {
                continue;
            }
            let what = match (a.meet(b), b.meet(a)) {
                (Meeting::Apart, Meeting::Apart) => continue,
                (Meeting::SamePlace, _) | (_, Meeting::SamePlace) => "lie in the same place",
                _ => "cross each other",
            };
            if said.len() == PAIRS_MAX {
                more += 1;
                continue;
            }
            let [a, b] = [first, second].map(|index| &wall.screens[index].name);
            said.push(format!(
                "screens {a} and {b} {what}, so that one hides the other; check where they stand"
            ));
        }
    }
    if more > 0 {
        said.push(format!("{more} more pairs of screens meet like these"));
    }
    said
}

fn is_seen_together(wall: &Wall, first: usize, second: usize) -> bool {
    let is_seen = |screen: usize, eye: Eye| {
        let on = |channel: &&Channel| usize::from(channel.screen) == screen;
        wall.channels.iter().filter(on).any(|channel| is_seen_by(channel, eye))
    };
    [Eye::Left, Eye::Right].iter().any(|eye| is_seen(first, *eye) && is_seen(second, *eye))
}

/// Points of a surface, row by row, and a sphere around them.
struct Grid<'a> {
    surface: &'a Surface,
    points: Vec<DVec3>,
    middle: DVec3,
    radius_m: f64,
}

impl<'a> Grid<'a> {
    /// The grid of a surface that is no mesh.
    fn new(surface: &'a Surface) -> Option<Self> {
        let last = (SIDE - 1) as f64;
        let at = |step: usize| (step as f64 / last).clamp(INSET, 1.0 - INSET);
        let places = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| DVec2::new(at(x), at(y))));
        let points = places.map(|place| surface.display_from_uv(place));
        let points = points.collect::<Option<Vec<DVec3>>>()?;
        let middle = points.iter().sum::<DVec3>() / points.len() as f64;
        let radius_m = points.iter().map(|point| point.distance(middle)).fold(0.0, f64::max);
        Some(Self { surface, points, middle, radius_m })
    }

    fn may_meet(&self, other: &Self) -> bool {
        self.middle.distance(other.middle) <= self.radius_m + other.radius_m
    }

    /// Returns the way in which points of this grid and lines between them meet another surface.
    fn meet(&self, other: &Self) -> Meeting {
        let before: Vec<Option<f64>> =
            self.points.iter().map(|point| before_m(other.surface, *point)).collect();
        let slack_m = ON_SURFACE_MAX * self.radius_m.min(1.0);
        let is_on = |distance: &Option<f64>| distance.is_some_and(|m| m.abs() < slack_m);
        if before.iter().any(is_on) {
            return meet_on(&before, is_on);
        }
        let beside = |at: usize| {
            let right = (at % SIDE + 1 < SIDE).then_some(at + 1);
            let below = (at + SIDE < before.len()).then_some(at + SIDE);
            [right, below].into_iter().flatten()
        };
        let is_crossed = |a: usize, b: usize| {
            before[a].zip(before[b]).is_some_and(|(a, b)| (a > 0.0) != (b > 0.0))
        };
        let crossed = (0..before.len()).any(|at| beside(at).any(|next| is_crossed(at, next)));
        if crossed { Meeting::Cross } else { Meeting::Apart }
    }
}

/// Returns the way in which surfaces meet if these points of one, row by row, lie on the other: a
/// few are where both cross, many are a common part.
fn meet_on(before: &[Option<f64>], is_on: impl Fn(&Option<f64>) -> bool) -> Meeting {
    let is_common = |row: &&[Option<f64>]| row.windows(2).any(|pair| pair.iter().all(&is_on));
    let rows = before.chunks(SIDE).filter(is_common).count();
    if rows > 1 { Meeting::SamePlace } else { Meeting::Cross }
}

/// Returns the distance of a point before a surface in metres, negative behind it; `None` beside
/// it.
fn before_m(surface: &Surface, point: DVec3) -> Option<f64> {
    let uv = surface.uv_from_display(point)?;
    let is_inside =
        uv.cmpge(DVec2::splat(INSET)).all() && uv.cmple(DVec2::splat(1.0 - INSET)).all();
    let foot = surface.display_from_uv(uv).filter(|_| is_inside)?;
    Some(surface.normal(uv)?.dot(point - foot)).filter(|distance| distance.is_finite())
}
