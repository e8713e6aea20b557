//! Poses of projectors that hang in a room, found so that their pictures cover what they have to.
//!
//! A projector is a pinhole without distortion. It hangs at a height, straight before the middle
//! of its target or at a fixed place, and is yawed, pitched and shifted until the target lies
//! within its picture; the nearest place where it fits is taken. Poses are refused if a projector
//! or the viewer's head stands in the light of another one.

use std::fmt;

use glam::{DQuat, DVec2, DVec3, EulerRot};
use polyptych_wall::Surface;
use polyptych_wall::projector::Projector;

use super::round;

/// Maximum number of steps of turning a projector toward its target; each leaves a fraction of the
/// error.
const AIM_STEPS: usize = 40;

/// A target is in the middle of a picture when it is off by no more than this tangent.
const AIM_ERROR: f64 = 1e-9;

/// Places between the nearest and the farthest one that are tried.
const DISTANCES: u32 = 60;

/// Bisections between a place that is too near and one that is not: 16 m to a millimetre.
const BISECTIONS: usize = 14;

/// By how much farther away projectors are tried than where they just fit.
const FACTORS: [f64; 6] = [1.0, 1.08, 1.2, 1.35, 1.6, 2.0];

/// By how much higher projectors are tried than where they were meant to hang, in metres.
const RAISES_M: [f64; 4] = [0.0, 0.3, 0.7, 1.2];

/// By how much each second projector hangs higher than its neighbours, in metres.
const STAGGERS_M: [f64; 2] = [0.0, 0.35];

/// Half the room that a projector takes, in metres: right, up and back.
const BODY_M: DVec3 = DVec3::new(0.2, 0.12, 0.2);

/// Half the room that a viewer's head takes, in metres.
const HEAD_M: DVec3 = DVec3::new(0.15, 0.2, 0.15);

/// Minimum height of a lens above the floor, in metres: people walk below it.
pub(super) const LENS_HEIGHT_MIN_M: f64 = 2.0;

/// Most of a picture that may miss its surface; `check`, which counts finer, warns from half on.
const SPILL_MAX: f64 = 0.48;

/// Places across and down of a picture at which it is asked what misses the surface.
const SPILL_PLACES: u32 = 24;

/// The lens of all projectors of a wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    /// Distance by the picture's width.
    pub throw: f64,
    /// The picture's height by its width.
    pub aspect: f64,
    /// Maximum lens shift up or down, in heights of the picture.
    pub shift_max: f64,
}

/// Where a projector may hang.
#[derive(Clone, Copy, Debug)]
pub(super) enum Stand {
    /// In front of a point of the screen, in a horizontal direction of length 1, at a height.
    Before { point: DVec3, inward: DVec3, height_m: f64 },
    /// At a place.
    At(DVec3),
}

/// What one projector has to light.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// The channel's name.
    pub name: String,
    /// Points of the screen, its corners and edges among them.
    pub points: Vec<DVec3>,
    /// Where its projector may hang.
    pub stand: Stand,
}

/// The room that projectors hang in.
#[derive(Clone, Debug)]
pub(super) struct Room {
    /// The viewer's eye.
    pub eye: DVec3,
    /// What each target lies on; of one surface for all, or one for each target.
    pub surfaces: Vec<Surface>,
    /// Least and greatest distance from the screen at which projectors may hang, in metres.
    pub distance_m: [f64; 2],
    /// Whether they may hang higher than asked.
    pub may_raise: bool,
}

/// A projector that covers its target.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    /// The channel's name.
    pub name: String,
    /// Of the lens, in metres.
    pub position: DVec3,
    /// Yaw and pitch in degrees.
    pub turned: [f64; 2],
    /// Left, right, bottom and top of its picture.
    pub tangents: [f64; 4],
    /// Lens shift, in heights of the picture.
    pub shift: f64,
    /// From the lens to the middle of its target, in metres.
    pub distance_m: f64,
}

/// Why no poses were found.
#[derive(Clone, Debug)]
pub(super) enum Trouble {
    /// A target does not fit into the picture at any distance.
    Reach { name: String, to_m: f64 },
    /// Most of a picture misses the screen, whose share this is.
    Spill { name: String, share: f64 },
    /// One projector hangs in the light of another.
    InLight { body: String, of: String },
    /// Two projectors hang in one place.
    SamePlace { names: [String; 2] },
    /// The viewer's head is in the light.
    Viewer { name: String },
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reach { name, to_m } => {
                write!(f, "from up to {to_m:.2} m away the picture of {name} is too small")
            }
            Self::Spill { name, share } => {
                write!(f, "{:.0} % of the picture of {name} would miss the screen", share * 100.0)
            }
            Self::InLight { body, of } => write!(f, "{body} would hang in the light of {of}"),
            Self::SamePlace { names: [a, b] } => write!(f, "{a} and {b} would hang in one place"),
            Self::Viewer { name } => {
                write!(f, "the viewer's head would be in the light of {name}")
            }
        }
    }
}

impl Trouble {
    /// What may help where neither another throw ratio nor more projectors do.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Spill { .. } => "a greater --lens-shift, or a lower --mount-height may work",
            _ => "a lower screen, or a greater --mount-height may work",
        }
    }
}

impl Pose {
    /// The projector of this pose.
    fn projector(&self) -> Projector {
        let [yaw, pitch] = self.turned.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0);
        Projector { position: self.position, rotation, tangents: self.tangents }
    }
}

/// Poses for all targets, each as near as it can be; farther away, and then higher, if they would
/// stand in each other's light.
pub(super) fn solve(lens: Lens, targets: &[Target], room: &Room) -> Result<Vec<Pose>, Trouble> {
    let mut first = None;
    let raises = if room.may_raise { &RAISES_M[..] } else { &RAISES_M[..1] };
    let staggers = if room.may_raise { &STAGGERS_M[..] } else { &STAGGERS_M[..1] };
    for factor in FACTORS {
        for raise_m in raises {
            for stagger_m in staggers {
                match all(lens, targets, room, (*raise_m, *stagger_m), factor) {
                    Ok(poses) => return Ok(poses),
                    Err(trouble) => {
                        let is_too_far = matches!(trouble, Trouble::Reach { .. });
                        first = first.or(Some(trouble));
                        if is_too_far {
                            break;
                        }
                    }
                }
            }
        }
        // Fixed places have no distance, and what cannot be reached cannot be from farther away.
        let is_fixed = targets.iter().all(|target| matches!(target.stand, Stand::At(_)));
        if is_fixed || matches!(first, Some(Trouble::Reach { .. })) {
            break;
        }
    }
    let name = targets.first().map_or_else(String::new, |target| target.name.clone());
    Err(first.unwrap_or(Trouble::Reach { name, to_m: room.distance_m[1] }))
}

fn all(
    lens: Lens,
    targets: &[Target],
    room: &Room,
    (raise_m, stagger_m): (f64, f64),
    factor: f64,
) -> Result<Vec<Pose>, Trouble> {
    let pose = |(index, target): (usize, &Target)| {
        let is_second = index % 2 == 1;
        one(lens, target, room, raise_m + if is_second { stagger_m } else { 0.0 }, factor)
    };
    let poses = targets.iter().enumerate().map(pose).collect::<Result<Vec<Pose>, Trouble>>()?;
    let names = |a: &Pose, b: &Pose| [a.name.clone(), b.name.clone()];
    for (index, pose) in poses.iter().enumerate() {
        let (projector, surface) = (pose.projector(), &room.surfaces[index % room.surfaces.len()]);
        let share = spill(&projector, surface);
        if share > SPILL_MAX {
            return Err(Trouble::Spill { name: pose.name.clone(), share });
        }
        let is_lit = |middle: DVec3, half: DVec3| {
            corners(half).any(|corner| takes_light(&projector, surface, middle + corner))
        };
        if is_lit(room.eye, HEAD_M) {
            return Err(Trouble::Viewer { name: pose.name.clone() });
        }
        for other in poses.iter().filter(|other| other.name != pose.name) {
            let apart = (other.position - pose.position).abs() / BODY_M;
            if apart.max_element() < 2.0 {
                return Err(Trouble::SamePlace { names: names(pose, other) });
            }
            if is_lit(other.position, BODY_M) {
                let [of, body] = names(pose, other);
                return Err(Trouble::InLight { body, of });
            }
        }
    }
    Ok(poses)
}

/// The share of a projector's picture that misses a surface.
fn spill(projector: &Projector, surface: &Surface) -> f64 {
    let at = |index: u32| (f64::from(index) + 0.5) / f64::from(SPILL_PLACES);
    let places = (0..SPILL_PLACES.pow(2))
        .map(|index| DVec2::new(at(index % SPILL_PLACES), at(index / SPILL_PLACES)));
    // A plane is hit beside its patch too, other surfaces a little beside it.
    let is_on = |uv: DVec2| uv.min_element() >= 0.0 && uv.max_element() <= 1.0;
    let is_lit = |place: &DVec2| {
        let uv = projector.intersect(surface, *place).and_then(|lit| surface.uv_from_display(lit));
        uv.is_some_and(is_on)
    };
    let missed = places.filter(|place| !is_lit(place)).count();
    missed as f64 / f64::from(SPILL_PLACES.pow(2))
}

/// Corners of a box around the origin, and its middle.
fn corners(half: DVec3) -> impl Iterator<Item = DVec3> {
    let sign = |bit: u32, corner: u32| if corner & bit == 0 { -1.0 } else { 1.0 };
    let corner = move |at| half * DVec3::new(sign(1, at), sign(2, at), sign(4, at));
    (0..8).map(corner).chain([DVec3::ZERO])
}

/// Returns whether a point lies between a projector and what it lights.
fn takes_light(projector: &Projector, surface: &Surface, point: DVec3) -> bool {
    let place = projector.project(point);
    let is_in = |at: &DVec2| at.min_element() >= 0.0 && at.max_element() <= 1.0;
    let lit = place.filter(is_in).and_then(|place| projector.intersect(surface, place));
    lit.is_some_and(|lit| lit.distance(projector.position) > point.distance(projector.position))
}

/// The nearest pose that covers a target, then as many times as far away.
fn one(
    lens: Lens,
    target: &Target,
    room: &Room,
    raise_m: f64,
    factor: f64,
) -> Result<Pose, Trouble> {
    let [near, far] = room.distance_m;
    let trouble = || Trouble::Reach { name: target.name.clone(), to_m: far };
    let Stand::Before { point, inward, height_m } = target.stand else {
        let Stand::At(place) = target.stand else { return Err(trouble()) };
        return aim(lens, target, place).ok_or_else(trouble);
    };
    let at = |distance: f64| {
        let place = point + inward * distance;
        let place = [place.x, height_m + raise_m, place.z].map(round);
        aim(lens, target, place.into())
    };
    let ratio = (far / near).powf(1.0 / f64::from(DISTANCES));
    let distance = |step: u32| near * ratio.powf(f64::from(step));
    let step = (0..=DISTANCES).find(|step| at(distance(*step)).is_some()).ok_or_else(trouble)?;
    let (mut low, mut high) = (distance(step.saturating_sub(1)), distance(step));
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(low, high);
        *(if at(middle).is_some() { &mut high } else { &mut low }) = middle;
    }
    if high * factor > far * (1.0 + 1e-9) {
        return Err(trouble());
    }
    at(high * factor).ok_or_else(trouble)
}

/// Turns and shifts a projector at a place so that its target is in the middle of its picture;
/// `None` if it does not fit in. It is shifted before it is pitched, which keeps sides parallel.
fn aim(lens: Lens, target: &Target, place: DVec3) -> Option<Pose> {
    let half = DVec2::new(1.0, lens.aspect) / (2.0 * lens.throw);
    let middle = target.points.iter().sum::<DVec3>() / target.points.len() as f64;
    let toward = middle - place;
    let mut yaw = (-toward.x).atan2(-toward.z);
    let seen = |yaw: f64, pitch: f64| {
        let own = DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0).inverse();
        let tangent = |point: &DVec3| {
            let ray = own * (*point - place);
            (ray.z < 0.0).then(|| DVec2::new(ray.x, ray.y) / -ray.z)
        };
        let mut tangents = target.points.iter().map(tangent);
        let first = tangents.next()??;
        tangents
            .try_fold((first, first), |(low, high), at| at.map(|at| (low.min(at), high.max(at))))
    };
    // Level first: as much shift as the lens has.
    let level = seen(yaw, 0.0).map(|(low, high)| (low.y + high.y) / (4.0 * half.y));
    let wanted = level.unwrap_or(toward.y.signum() * f64::INFINITY);
    let shift = round(wanted.clamp(-lens.shift_max, lens.shift_max));
    let is_level = lens.shift_max > 0.0 && wanted.abs() <= lens.shift_max;
    let mut pitch = if is_level { 0.0 } else { toward.y.atan2(toward.x.hypot(toward.z)) };
    for _ in 0..AIM_STEPS {
        let (low, high) = seen(yaw, pitch)?;
        let off = (low + high) / 2.0;
        yaw -= off.x.atan();
        let up = if is_level { 0.0 } else { off.y.atan() - (2.0 * half.y * shift).atan() };
        pitch += up;
        if off.x.abs().max(up.abs()) < AIM_ERROR {
            break;
        }
    }
    let turned = [yaw.to_degrees(), pitch.to_degrees()].map(round);
    let (low, high) = seen(turned[0].to_radians(), turned[1].to_radians())?;
    let up = 2.0 * half.y * shift;
    let tangents = [-half.x, half.x, up - half.y, up + half.y].map(round);
    let [left, right, bottom, top] = tangents;
    let fits = left <= low.x && high.x <= right && bottom <= low.y && high.y <= top;
    fits.then(|| Pose {
        name: target.name.clone(),
        position: place,
        turned,
        tangents,
        shift,
        distance_m: toward.length(),
    })
}
