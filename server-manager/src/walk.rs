//! The way that is possible of one who walks or flies through the open scene.
//!
//! The way is gone in short steps. Of every place the distance to the nearest triangle is known, so
//! a step that is shorter can pass through none, and is taken if it leads no nearer than the walker
//! may be: what lies between two places is nearer by half of their distance at most. Above ground
//! the same holds for a column of balls from the eye down to where a step is high enough.

use glam::DVec3;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{NearestPoint, NearestQuery, RayHit, RayQuery};
use polyptych_protocol::walk_query::{
    Touched, WAY_POINTS_MAX, WalkEnd, WalkQuery, WalkedWay, Walker,
};
use polyptych_scene::SceneSubset;
use polyptych_wall::limits::REGION_REACH_MAX;
use polyptych_wall::pick_ray::Ray;

use crate::mesh_walk::MeshWalk;
use crate::nearest_point::nearest;
use crate::ray_cast::cast;

/// Steps in the height of an eye: ground between two of them is not looked at.
const STEPS_PER_HEIGHT: f64 = 16.0;

/// The shortest way that counts as progress, as a share of the radius.
const CONTACT_SHARE: f64 = 1e-3;

/// The longest part of a step of which only the ends are looked at, as a share of the radius: in
/// between, a walker is nearer by half of it at most.
const PART_SHARE: f64 = 1.0 / 16.0;

/// By how much less a distance may be than one that must be kept: rounding, far below what shows.
const ROUNDING: f64 = 1e-9;

/// The scene as a walker knows it.
pub(crate) trait Surroundings {
    /// The point of the triangles that is nearest, if one is within this distance.
    ///
    /// # Errors
    /// The scene cannot be read, or it takes too long.
    fn nearest(&self, point: DVec3, within: f64) -> Result<Option<Contact>, String>;

    /// The first triangle straight below a point, if one is within this depth.
    ///
    /// # Errors
    /// The scene cannot be read, or it takes too long.
    fn below(&self, point: DVec3, depth: Option<f64>) -> Result<Option<Contact>, String>;
}

/// A place of a triangle, and its distance from where it was looked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Contact {
    pub distance: f64,
    pub place: Touched,
}

impl Surroundings for (&MeshWalk<'_>, Revision) {
    fn nearest(&self, point: DVec3, within: f64) -> Result<Option<Contact>, String> {
        self.0.check_time()?;
        let found = nearest(self.0, &NearestQuery { point, within: Some(within) }, self.1)?;
        Ok(found.map(|NearestPoint { node, name, position, distance, .. }| Contact {
            distance,
            place: Touched { node, name, position },
        }))
    }

    fn below(&self, point: DVec3, depth: Option<f64>) -> Result<Option<Contact>, String> {
        self.0.check_time()?;
        let ray = Ray { origin: point, direction: DVec3::NEG_Y };
        let subset = SceneSubset::default();
        let query = RayQuery { ray, max_distance: depth, subset };
        let found = cast(self.0, &query, self.1)?;
        Ok(found.map(|RayHit { node, name, position, distance, .. }| Contact {
            distance,
            place: Touched { node, name, position },
        }))
    }
}

/// The way that is possible of one that is asked for.
///
/// # Errors
/// The way or the walker cannot be, the scene cannot be read, or it takes too long.
pub(crate) fn walk(
    around: &impl Surroundings,
    query: &WalkQuery,
    revision: Revision,
) -> Result<WalkedWay, String> {
    check(query)?;
    let walker = query.walker;
    let mut points = vec![query.way[0]];
    let end = go(around, query, &mut points)?;
    let of_height = walker.eye_height.map(|height| height / 100.0);
    let of_radius = walker.radius.map(|radius| radius / 10.0);
    let tolerance = of_height.into_iter().chain(of_radius).fold(f64::INFINITY, f64::min);
    let points = simplified(&points, tolerance);
    if points.len() > WAY_POINTS_MAX {
        return Err(format!(
            "the way has {} points, where {WAY_POINTS_MAX} can be given; ask for a shorter one",
            points.len()
        ));
    }
    Ok(WalkedWay { revision, points, end })
}

fn check(query: &WalkQuery) -> Result<(), String> {
    let WalkQuery { way, walker: Walker { eye_height, radius, step_height } } = query;
    if !(2..=WAY_POINTS_MAX).contains(&way.len()) {
        return Err(format!("a way has 2 to {WAY_POINTS_MAX} points, not {}", way.len()));
    }
    let is_out = |point: &DVec3| point.is_nan() || point.abs().max_element() > REGION_REACH_MAX;
    if let Some(point) = way.iter().find(|point| is_out(point)) {
        let limit = format!("at most {REGION_REACH_MAX:e} from 0");
        return Err(format!("a point of the way is {point}; give three finite numbers, {limit}"));
    }
    let is_length = |length: f64| length > 0.0 && length <= REGION_REACH_MAX;
    for (what, length) in [("eye's height", *eye_height), ("radius", *radius)] {
        if let Some(length) = length.filter(|length| !is_length(*length)) {
            return Err(format!("a walker's {what} is above 0, not {length}"));
        }
    }
    match (*eye_height, *radius) {
        (None, None) => {
            return Err("a walker without a height and without a radius is stopped by nothing; \
                        give one of them"
                .to_owned());
        }
        (Some(height), Some(radius)) if radius >= height => {
            return Err(format!("a walker's radius is below the eye's height {height}"));
        }
        _ => {}
    }
    let highest = eye_height.unwrap_or(f64::INFINITY);
    if !(0.0..=highest).contains(step_height) {
        return Err(format!(
            "a walker's highest step is from 0 to the eye's height, not {step_height}"
        ));
    }
    Ok(())
}

/// Goes the way as far as it can be gone.
fn go(
    around: &impl Surroundings,
    query: &WalkQuery,
    points: &mut Vec<DVec3>,
) -> Result<WalkEnd, String> {
    let walker = query.walker;
    let mut eye = query.way[0];
    if let Some(height) = walker.eye_height {
        let Some(ground) = around.below(eye, None)? else { return Ok(WalkEnd::NoGround) };
        eye.y = ground.place.position.y + height;
        points[0] = eye;
    }
    for goal in &query.way[1..] {
        loop {
            let mut rest = *goal - eye;
            if walker.eye_height.is_some() {
                rest.y = 0.0;
            }
            let length = rest.length();
            if length <= ROUNDING * (eye.abs().max_element() + length) {
                break;
            }
            let longest = walker.eye_height.map_or(length, |height| height / STEPS_PER_HEIGHT);
            let step = rest * (longest.min(length) / length);
            let step = match free_step(around, &walker, eye, step)? {
                Ok(step) => step,
                Err(place) => return Ok(WalkEnd::Obstacle(place)),
            };
            let next = match on_ground(around, &walker, eye, eye + step)? {
                Ok(next) => next,
                Err(end) => return Ok(end),
            };
            if next == eye {
                // Numbers as large as these have no shorter steps.
                break;
            }
            eye = next;
            points.push(eye);
        }
    }
    Ok(WalkEnd::Arrived)
}

/// The eye, and what of the body below it keeps its distance.
fn body(walker: &Walker, eye: DVec3) -> impl Iterator<Item = DVec3> + use<> {
    let radius = walker.radius.unwrap_or(f64::INFINITY);
    let depth = walker.eye_height.map_or(0.0, |height| height - walker.step_height - radius);
    // One radius apart they leave no room for anything thicker than a seventh of it.
    let count = (depth.max(0.0) / radius).ceil();
    let spacing = if count > 0.0 { depth / count } else { 0.0 };
    (0..=count as u32).map(move |index| eye - DVec3::Y * (spacing * f64::from(index)))
}

/// The part of a step that keeps the walker's distance from everything, or the place that lets it
/// go no further.
fn free_step(
    around: &impl Surroundings,
    walker: &Walker,
    eye: DVec3,
    step: DVec3,
) -> Result<Result<DVec3, Touched>, String> {
    let Some(radius) = walker.radius else { return Ok(Ok(step)) };
    let length = step.length();
    let mut near: Vec<(DVec3, Contact)> = Vec::new();
    for center in body(walker, eye) {
        let contact = around.nearest(center, radius + length)?;
        near.extend(contact.map(|contact| (center, contact)));
    }
    near.sort_by(|a, b| a.1.distance.total_cmp(&b.1.distance));
    let Some((_, first)) = near.first() else { return Ok(Ok(step)) };
    let free = first.distance - radius;
    if free >= length {
        return Ok(Ok(step));
    }
    // It can pass through nothing, but may come too near: along a wall it does not.
    let mut trial = length.min(first.distance * (1.0 - ROUNDING));
    while trial > CONTACT_SHARE * radius {
        let by = step * (trial / length);
        if keeps_distance(around, &near, radius, by)? {
            return Ok(Ok(by));
        }
        trial = if free < trial && free > CONTACT_SHARE * radius { free } else { trial / 2.0 };
    }
    Ok(Err(first.place.clone()))
}

/// Returns whether no part of a body comes nearer on the way than it may, or than it was.
fn keeps_distance(
    around: &impl Surroundings,
    near: &[(DVec3, Contact)],
    radius: f64,
    by: DVec3,
) -> Result<bool, String> {
    for (center, before) in near {
        let [from, to] = [*center, *center + by];
        if !is_clear(around, radius, [(from, before.distance), (to, f64::NAN)])? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Returns whether a ball comes no nearer to anything than its radius, or than it is at first, on
/// the way between two places, each with its distance from the nearest triangle; NaN if that is not
/// known yet.
fn is_clear(
    around: &impl Surroundings,
    radius: f64,
    [(from, first), (to, last)]: [(DVec3, f64); 2],
) -> Result<bool, String> {
    let within = radius + from.distance(to);
    let distance = |point: DVec3| -> Result<f64, String> {
        Ok(around.nearest(point, within)?.map_or(within, |contact| contact.distance))
    };
    let least = first.min(radius) * (1.0 - ROUNDING);
    let last = if last.is_nan() { distance(to)? } else { last };
    let mut open = vec![(from, first, to, last)];
    while let Some((from, first, to, last)) = open.pop() {
        let length = from.distance(to);
        if first.min(last) < least {
            return Ok(false);
        }
        if length > PART_SHARE * radius && f64::midpoint(first, last) - length / 2.0 < least {
            let middle = from.midpoint(to);
            let between = distance(middle)?;
            open.extend([(middle, between, to, last), (from, first, middle, between)]);
        }
    }
    Ok(true)
}

/// The eye after a step, at its height above ground, or why it cannot be there.
fn on_ground(
    around: &impl Surroundings,
    walker: &Walker,
    from: DVec3,
    to: DVec3,
) -> Result<Result<DVec3, WalkEnd>, String> {
    let Some(height) = walker.eye_height else { return Ok(Ok(to)) };
    let Some(ground) = around.below(to, None)? else { return Ok(Err(WalkEnd::NoGround)) };
    let eye = to.with_y(ground.place.position.y + height);
    let rise = eye.y - from.y;
    if rise.abs() > walker.step_height {
        let end = if rise > 0.0 { WalkEnd::Rise } else { WalkEnd::Fall };
        return Ok(Err(end(ground.place)));
    }
    let Some(radius) = walker.radius.filter(|_| rise > 0.0) else { return Ok(Ok(eye)) };
    // What is low stops who is lifted: through it, or too near to it.
    let through = around.below(eye, Some(rise))?;
    let before = around.nearest(to, radius)?.map_or(radius, |before| before.distance);
    if through.is_none() && is_clear(around, radius, [(to, before), (eye, f64::NAN)])? {
        return Ok(Ok(eye));
    }
    let low = match through {
        Some(low) => low.place,
        None => around.nearest(eye, radius + rise)?.map_or(ground.place, |low| low.place),
    };
    Ok(Err(WalkEnd::Obstacle(low)))
}

/// Leaves out points that are this near to the straight line between those that stay (D. Douglas,
/// T. Peucker, *Algorithms for the reduction of the number of points required to represent a
/// digitized line*, 1973).
fn simplified(points: &[DVec3], tolerance: f64) -> Vec<DVec3> {
    let mut kept = vec![false; points.len()];
    let last = points.len() - 1;
    (kept[0], kept[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((first, last)) = open.pop() {
        let (from, way) = (points[first], points[last] - points[first]);
        let off = |at: usize| {
            let along = (points[at] - from).dot(way) / way.length_squared();
            let along = if along.is_finite() { along.clamp(0.0, 1.0) } else { 0.0 };
            (points[at] - from - way * along).length()
        };
        let farthest = (first + 1..last).max_by(|a, b| off(*a).total_cmp(&off(*b)));
        if let Some(at) = farthest.filter(|at| off(*at) > tolerance) {
            kept[at] = true;
            open.extend([(first, at), (at, last)]);
        }
    }
    points.iter().zip(kept).filter(|(_, is_kept)| *is_kept).map(|(point, _)| *point).collect()
}

#[cfg(test)]
mod tests;
