//! Checks that the eye sees the front of every screen, and that projectors light them.

use glam::{DVec2, DVec3};
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::frustum::EYE_DISTANCE_MIN_M;
use polyptych_wall::{Channel, ChannelKind, Screen};

use super::error::WallFileError;
use super::screen::ChannelDraft;
use super::source::SourceText;
use crate::coverage::Footprint;

/// Places of a channel, across and down, at which it is looked at: corners and middles, and some
/// between them, because a dome is nearest anywhere.
const SIDE: u32 = 9;

/// The eye must see the front of every screen, and every projector light its own.
pub(super) fn check(
    source: &SourceText<'_>,
    eye: DVec3,
    screens: &[Screen],
    drafts: &[ChannelDraft],
) -> Result<(), WallFileError> {
    for (index, screen) in screens.iter().enumerate() {
        let drafts = drafts.iter().filter(|draft| usize::from(draft.channel.screen) == index);
        if screen.plane().is_some() {
            let distance_m = screen.frustum(eye).map_or(f64::NAN, |seen| seen.distance_m);
            let first = drafts.clone().next().map_or("", |draft| draft.channel.name.as_str());
            check_distance(source, eye, screen, first, distance_m)?;
        }
        for draft in drafts {
            let is_thrown = matches!(draft.channel.cover, ChannelKind::Projector(_));
            check_nearness(source, eye, screen, &draft.channel)?;
            if screen.plane().is_some() && !is_thrown {
                continue;
            }
            let lit = places(&draft.channel, screen);
            if is_thrown && lit.is_empty() {
                check_lit(source, screen, draft)?;
            }
            if screen.plane().is_none()
                && let Some(distance_m) = nearest_m(screen, eye, &lit)
            {
                check_distance(source, eye, screen, &draft.channel.name, distance_m)?;
            }
        }
    }
    Ok(())
}

fn check_distance(
    source: &SourceText<'_>,
    eye: DVec3,
    screen: &Screen,
    channel: &str,
    distance_m: f64,
) -> Result<(), WallFileError> {
    if distance_m > EYE_DISTANCE_MIN_M {
        return Ok(());
    }
    let place = if distance_m < -EYE_DISTANCE_MIN_M {
        format!("{:.6} m behind", -distance_m)
    } else {
        "in the plane of".to_owned()
    };
    let what = format!(
        "the eye {eye} m is {place} screen {:?}, so that its channel {channel:?} has no view",
        screen.name
    );
    let remedy = if screen.plane().is_some() {
        "move the eye or the screen; corners are named as the viewer sees them"
    } else {
        "move the eye or the screen; left and right are as the viewer sees them"
    };
    Err(source.error("wall.eye", what, remedy))
}

fn check_nearness(
    source: &SourceText<'_>,
    eye: DVec3,
    screen: &Screen,
    channel: &Channel,
) -> Result<(), WallFileError> {
    let distance_m = screen.frustum(eye).map_or(f64::INFINITY, |seen| seen.distance_m);
    match screen.eye_distance_min_m(channel, eye) {
        Some(least_m) if distance_m < least_m => {
            let what = format!(
                "the eye {eye} m is {distance_m:.6} m before screen {:?}, so near that pixels of \
                 its channel {:?} would be wrong",
                screen.name, channel.name
            );
            let remedy = format!("move the eye or the screen: {least_m:.6} m is enough");
            Err(source.error("wall.eye", what, &remedy))
        }
        _ => Ok(()),
    }
}

/// A projector whose pixels all miss may still light a screen that is small in its picture.
fn check_lit(
    source: &SourceText<'_>,
    screen: &Screen,
    draft: &ChannelDraft,
) -> Result<(), WallFileError> {
    let canvas = screen.canvas.as_dvec2();
    let print = Footprint::new(&draft.channel, screen);
    let is_file = screen.display_from_canvas(canvas / 2.0).is_none();
    if is_file || grid(canvas).any(|at| print.covers(at)) {
        return Ok(());
    }
    let what = format!(
        "the projector of channel {:?} lights nothing of screen {:?}",
        draft.channel.name, screen.name
    );
    let remedy = "check position, look_at or rotation, and degrees";
    Err(source.error(format!("{}.projector", draft.key), what, remedy))
}

/// Places of the canvas that a channel shows; none where only files know.
fn places(channel: &Channel, screen: &Screen) -> Vec<DVec2> {
    let Some(map) = ChannelMapping::new(channel, screen) else { return Vec::new() };
    let canvas = screen.canvas.as_dvec2();
    let is_on = |at: &DVec2| at.cmpge(DVec2::ZERO).all() && at.cmple(canvas).all();
    let pixels = grid(channel.size.as_dvec2());
    pixels.filter_map(|pixel| map.canvas_from_pixel(pixel)).filter(is_on).collect()
}

/// From corner to corner.
fn grid(size: DVec2) -> impl Iterator<Item = DVec2> {
    let at = |step: u32| f64::from(step) / f64::from(SIDE - 1);
    (0..SIDE).flat_map(move |y| (0..SIDE).map(move |x| DVec2::new(at(x), at(y)) * size))
}

/// Returns the minimum distance of the eye before the planes that touch the screen at these places.
fn nearest_m(screen: &Screen, eye: DVec3, places: &[DVec2]) -> Option<f64> {
    let distance = |at: &DVec2| {
        let normal = screen.surface.normal(*at / screen.canvas.as_dvec2())?;
        Some(normal.dot(eye - screen.display_from_canvas(*at)?))
    };
    places.iter().filter_map(distance).min_by(f64::total_cmp)
}
