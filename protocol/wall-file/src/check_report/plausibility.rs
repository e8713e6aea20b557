//! Numbers that a wall file may have, but no wall that was ever built: slips of the unit, mostly.

use std::collections::BTreeMap;

use glam::DVec3;
use polyptych_wall::{Channel, ChannelKind, Wall};

use super::{ChannelRow, ProjectorRow, ScreenRow, Stereo, device_row, stereo};

/// Sides of screens that are built, in metres: from a viewfinder to the outside of the Sphere in
/// Las Vegas, 157 m wide.
const SIDE_RANGE_M: (f64, f64) = (0.01, 200.0);

/// Pixel pitches that are built, in metres: from a viewfinder's to that of a stadium's façade.
const PITCH_RANGE_M: (f64, f64) = (1e-5, 0.1);

/// Maximum plausible distance between the eye and a screen, in metres.
const EYE_DISTANCE_MAX_M: f64 = 500.0;

/// Separations of eyes in metres: from a child's to what exaggerates depth on purpose.
const EYE_SEPARATION_RANGE_M: (f64, f64) = (0.04, 0.12);

/// Throw ratios for sale: from a mirror lens to a stadium's.
const THROW_RANGE: (f64, f64) = (0.1, 20.0);

/// Maximum lens shift for sale, in pictures: half a picture beyond its own edge.
const SHIFT_MAX: f64 = 1.5;

/// Maximum plausible distance between a projector and what it lights, in metres.
const THROW_DISTANCE_MAX_M: f64 = 200.0;

/// Room that a viewer's head and shoulders take, in metres around the eye.
const VIEWER_RADIUS_M: f64 = 0.3;

/// Everything that is not plausible.
pub(super) fn warnings(wall: &Wall, screens: &[ScreenRow], channels: &[ChannelRow]) -> Vec<String> {
    let mut warnings = eyes(wall, screens);
    warnings.extend(screens.iter().filter_map(screen_size));
    warnings.extend(screens.iter().filter_map(pitch));
    for (row, channel) in channels.iter().zip(&wall.channels) {
        if let Some(projector) = &row.projector {
            warnings.extend(pose(row, projector));
            warnings.extend(viewer(wall, row, channel));
        }
    }
    warnings.extend(servers(channels));
    warnings.extend(device_row::warnings(wall));
    warnings
}

fn eyes(wall: &Wall, screens: &[ScreenRow]) -> Vec<String> {
    let mut warnings = Vec::new();
    for ScreenRow { name, eye_distance_m, .. } in screens {
        let Some(distance) = eye_distance_m else { continue };
        if *distance > EYE_DISTANCE_MAX_M {
            warnings.push(format!(
                "screen {name}: it is {distance:.0} m from the eye, where up to \
                 {EYE_DISTANCE_MAX_M:.0} m are plausible; check wall.eye, metres are meant"
            ));
        }
        if wall.near_m > *distance {
            warnings.push(format!(
                "screen {name}: the near plane, {} m, is farther than the screen, {distance:.3} \
                 m, so that nothing at the screen is drawn; check wall.near",
                wall.near_m
            ));
        }
    }
    let (low, high) = EYE_SEPARATION_RANGE_M;
    let separation_m = wall.eye_separation_m;
    if stereo(wall) != Stereo::None && !(low..=high).contains(&separation_m) {
        warnings.push(format!(
            "eyes are {separation_m} m apart, where {low} to {high} m are plausible; check \
             wall.eye_separation, 0.063 is the mean of adults"
        ));
    }
    if let Err(error) = wall.check_head(&wall.head()) {
        warnings.push(format!("{error}; move the eye or the screen"));
    }
    warnings
}

fn screen_size(screen: &ScreenRow) -> Option<String> {
    let (low, high) = SIDE_RANGE_M;
    let size = screen.size_m?;
    let [width, height] = size;
    size.iter().any(|side| !(low..=high).contains(side)).then(|| {
        format!(
            "screen {}: it is {width:.4} × {height:.4} m, where {low} to {high:.0} m are \
             plausible; check its size, metres are meant",
            screen.name
        )
    })
}

fn pitch(screen: &ScreenRow) -> Option<String> {
    let (low, high) = PITCH_RANGE_M;
    let pitch = screen.pitch_m?;
    let [x, y] = pitch.map(|side| side * 1e3);
    pitch.iter().any(|side| !(low..=high).contains(side)).then(|| {
        format!(
            "screen {}: its pixels are {x:.5} × {y:.5} mm, where {} to {} mm are plausible; check \
             its metres and pixels",
            screen.name,
            low * 1e3,
            high * 1e3
        )
    })
}

fn pose(row: &ChannelRow, projector: &ProjectorRow) -> Vec<String> {
    let mut warnings = Vec::new();
    let ProjectorRow { throw_ratio, shift, distance_m, .. } = *projector;
    let (low, high) = THROW_RANGE;
    if !(low..=high).contains(&throw_ratio) {
        warnings.push(format!(
            "channel {}: its projector has a throw ratio of {throw_ratio:.3}, where lenses have \
             {low} to {high:.0}; check its degrees or tangents",
            row.name
        ));
    }
    if shift.iter().any(|shift| shift.abs() > SHIFT_MAX) {
        warnings.push(format!(
            "channel {}: its lens is shifted by {:.2} widths and {:.2} heights of its picture, \
             where lenses reach {SHIFT_MAX}; check its shift or tangents",
            row.name, shift[0], shift[1]
        ));
    }
    if let Some(distance) = distance_m.filter(|distance| *distance > THROW_DISTANCE_MAX_M) {
        warnings.push(format!(
            "channel {}: its projector is {distance:.0} m from what it lights, where up to \
             {THROW_DISTANCE_MAX_M:.0} m are plausible; check its position, metres are meant",
            row.name
        ));
    }
    warnings
}

/// A projector that stands where the viewer's head is, or whose light the head takes.
fn viewer(wall: &Wall, row: &ChannelRow, channel: &Channel) -> Option<String> {
    let ChannelKind::Projector(projector) = &channel.cover else { return None };
    let name = &row.name;
    let apart = projector.position.distance(wall.eye);
    if apart < VIEWER_RADIUS_M {
        return Some(format!(
            "channel {name}: its projector is {apart:.2} m from the eye, where the viewer's head \
             is; move one of them"
        ));
    }
    let surface = &wall.screen_of(channel).surface;
    let is_shadowed = |point: DVec3| {
        let place = projector.project(point);
        let place = place.filter(|at| at.min_element() >= 0.0 && at.max_element() <= 1.0)?;
        let lit = projector.intersect(surface, place)?;
        Some(lit.distance(projector.position) > point.distance(projector.position))
    };
    (is_shadowed(wall.eye) == Some(true)).then(|| {
        format!(
            "channel {name}: the viewer stands in its projector's light, {apart:.2} m from it; \
             mount it higher, or move the eye"
        )
    })
}

/// Servers whose names differ in case only: one machine, written in two ways.
fn servers(channels: &[ChannelRow]) -> Vec<String> {
    let mut known: BTreeMap<String, &str> = BTreeMap::new();
    let mut warnings = Vec::new();
    for ChannelRow { name, server, .. } in channels {
        let first = *known.entry(server.to_ascii_lowercase()).or_insert(server);
        if first != server {
            warnings.push(format!(
                "channel {name}: its server is called {server:?}, another one {first:?}; write \
                 one machine in one way"
            ));
        }
    }
    warnings
}
