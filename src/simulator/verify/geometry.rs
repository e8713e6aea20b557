//! Positions of markers on all channels of a running wall, against those that f64 computes.

use std::path::Path;

use anyhow::Context;
use glam::{DVec2, DVec3};
use polyptych_client::blocking::Client;
use polyptych_client::{Camera, Capture, Image};
use polyptych_text::counted;
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Channel, ChannelId, ChannelKind, Eye, Viewpoint, Wall};

use super::light::{self, Drawn};
use super::marker::{self, LuminanceImage, Marker, Reading};
use super::verification_report::{Bound, MeasuredPoint, VerificationReport, with_eye};
use crate::outputs;
use crate::progress::Steps;

/// Maximum distance of a point from where f64 places it, in pixels.
const ERROR_MAX_PX: f64 = 0.01;

/// Maximum distance of a point if a picture is resampled: by a warp, between its source's pixels.
const WARPED_ERROR_MAX_PX: f64 = 0.1;

/// Maximum distance between the positions at which two channels show one point, in pixels.
const SEAM_MAX_PX: f64 = 0.05;

/// Maximum growth of a point's error from one frame to the next, in pixels.
const JITTER_MAX_PX: f64 = 0.01;

/// Half side of a marker in pixels, where the channel has room.
pub(super) const HALF_PX: f64 = 32.0;

/// The smallest of which a place can be told.
const HALF_MIN_PX: f64 = 4.0;

/// Scenes of markers that are drawn.
pub(super) const SCENES: usize = OFFSETS_M.len();

/// Distances from the origin at which scenes are placed, in metres.
const OFFSETS_M: [f64; 3] = [0.0, 1e4, 1e7];

/// Frames of a slow move, and how far each is from the one before: metres for each metre from the
/// eye to the nearest marker, up to one. A move of a millimetre is not slow five before a screen.
const STEPS: u32 = 4;
const STEP: DVec3 = DVec3::new(0.000_37, 0.000_21, -0.000_11);

/// Steps to the middle of a channel in which a place is looked for that is lit.
const PULLS: u32 = 8;

/// Least distance of a marker's plane from the eye, in nearest distances that are drawn: a frustum
/// that is not perpendicular to the marker cuts some of it off before.
const NEARS_MIN: f64 = 1.5;

/// Depths of markers, in distances from the eye to the screen.
const DEPTHS: [f64; 3] = [1.0, 1.7, 5.0];

/// Room around a marker's middle within its channel's picture, in its half sides.
const ROOM: f64 = 1.25;

/// A channel as one eye sees it, and where its pixels and that eye are. A display that has the
/// pictures of both eyes is two of them.
pub(super) struct ChannelView<'a> {
    pub id: ChannelId,
    pub name: &'a str,
    pub of: Eye,
    pub map: ChannelMapping<'a>,
    eye: Viewpoint,
    half: f64,
    is_warped: bool,
}

/// The error of a marker's position on one channel, in pixels.
struct MarkerError {
    /// The index of its view.
    channel: usize,
    marker: usize,
    /// The place at which it must be, in pixels of the channel's picture.
    pixel: DVec2,
    error_px: DVec2,
    /// The error along the screen, in pixels of the channel and in the axes of display space.
    error_in_display: DVec3,
}

/// Proves where channels show points, for scenes near and far from the origin.
///
/// # Errors
/// A scene could not be written, or not be drawn.
pub(super) fn verify(
    client: &Client,
    (shaped, drawn): (ResolvedWall<'_>, Drawn<'_>),
    (folder, steps): (&Path, &mut Steps),
    table: &mut VerificationReport,
    mut keep: impl FnMut(&Capture) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let wall = shaped.wall;
    let seen = channels(shaped);
    let markers = markers(wall, &seen);
    let rest: Vec<&str> = wall
        .channels
        .iter()
        .map(|channel| channel.name.as_str())
        .filter(|name| seen.iter().all(|channel| channel.name != *name))
        .collect();
    if !rest.is_empty() {
        let why = "too small for markers, or nothing is lit in their middle";
        let note = format!("{}: {why}", rest.join(", "));
        table.add("channels without markers", rest.len() as f64, "", None, note);
    }
    if markers.is_empty() {
        return Ok(());
    }
    let distances = seen.iter().flat_map(|s| markers.iter().map(|m| m.distance_m(s.eye.middle())));
    let step_m = STEP * distances.fold(1.0, f64::min);
    for offset_m in OFFSETS_M {
        let count = counted(markers.len(), "marker");
        let is_near = offset_m == 0.0;
        let away = if is_near { "at the origin" } else { &format!("{offset_m:e} m away") };
        steps.begin(format_args!("looking for {count} on all channels, {away}"));
        let offset = DVec3::new(offset_m, -0.5 * offset_m, 0.25 * offset_m);
        let place = folder.join(format!("markers-{offset_m}"));
        outputs::make_folder(&place)?;
        for (name, bytes) in marker::files(&markers, offset)? {
            outputs::write(&place.join(name), &bytes)?;
        }
        client.open_scene(place.join(marker::SCENE_NAME).display().to_string())?;
        let mut frames = Vec::new();
        for step in 0..STEPS {
            let shift = step_m * f64::from(step);
            client.set_camera(Camera { position: offset + shift, ..Camera::IDENTITY })?;
            client.render_frame_at(None, Some(0.0))?;
            let capture = client.capture()?;
            if offset_m == 0.0 && step == 0 {
                keep(&capture)?;
            }
            frames.push(find((wall, drawn), &seen, &markers, &capture, -shift)?);
        }
        let at = if offset_m == 0.0 { String::new() } else { format!(", {offset_m:e} m away") };
        report(table, (wall, &seen, &markers), &frames, &at);
        let points = frames.iter().flatten().map(|found| found.point((wall, &seen, &markers)));
        table.points.extend(points.map(|point| MeasuredPoint { offset_m, ..point }));
    }
    Ok(())
}

/// The channels that are large enough for markers, as each of their eyes sees them.
pub(super) fn channels(shaped: ResolvedWall<'_>) -> Vec<ChannelView<'_>> {
    let wall = shaped.wall;
    let head = wall.head();
    let mut views = Vec::new();
    for (id, channel) in wall.channel_ids().zip(&wall.channels) {
        let Some(map) = shaped.channel_mapping(id) else { continue };
        let half = HALF_PX.min((channel.size.min_element() as f64 / 7.0).floor());
        let middle = map.drawn_from_pixel(channel.size.as_dvec2() / 2.0);
        if half < HALF_MIN_PX || middle.is_none() {
            continue;
        }
        for &of in channel.eyes() {
            let (eye, map) = (wall.viewpoint(&head, of), map.clone());
            let is_warped = is_warped(wall, channel);
            views.push(ChannelView { id, name: &channel.name, of, map, eye, half, is_warped });
        }
    }
    views
}

impl ChannelView<'_> {
    /// Returns the channel's name, with the eye where it is not for the middle of both.
    pub fn label(&self) -> String {
        with_eye(self.name, self.of)
    }

    /// Returns whether all of a marker around this pixel of the picture can be seen.
    fn has_room(&self, pixel: DVec2, size: DVec2) -> bool {
        let inset = DVec2::splat(self.half * ROOM);
        let around = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y];
        let is_lit = |by: DVec2| self.map.drawn_from_pixel(pixel + by * self.half).is_some();
        pixel.cmpge(inset).all()
            && pixel.cmple(size - inset).all()
            && around.into_iter().all(is_lit)
    }

    /// Returns whether the other one is of another channel, and some eye sees both.
    fn meets(&self, other: &Self) -> bool {
        let is_for_both = self.of == Eye::Center || other.of == Eye::Center;
        self.id != other.id && (is_for_both || self.of == other.of)
    }
}

/// Returns whether a channel's picture is resampled on its way to the display.
pub(super) fn is_warped(wall: &Wall, channel: &Channel) -> bool {
    let adjustment = &channel.adjustment;
    wall.screen_of(channel).plane().is_none()
        || channel.cover != ChannelKind::Tile
        || adjustment.pin != [DVec2::ZERO; 4]
        || adjustment.bend.is_some()
        || adjustment.warp.is_some()
        || wall.is_omnidirectional(channel)
}

/// Nine for each channel, but for those that would lie over others.
fn markers(wall: &Wall, seen: &[ChannelView<'_>]) -> Vec<Marker> {
    // Eyes are up to this far from the middle, from where nearer markers lie before other ones.
    let is_mono = seen.iter().all(|s| s.eye == Viewpoint::Fixed(wall.eye));
    let aside_m = if is_mono { 0.0 } else { wall.eye_separation_m / 2.0 };
    let mut markers: Vec<(Marker, DVec3, f64)> = Vec::new();
    for (index, channel) in seen.iter().enumerate() {
        let size = wall.channels[usize::from(channel.id.0)].size.as_dvec2();
        let inset = DVec2::splat(channel.half * ROOM);
        for place in 0..9 {
            let share = DVec2::new(f64::from(place % 3), f64::from(place / 3)) / 2.0;
            let pixel = inset + (size - inset * 2.0) * share;
            let depth = DEPTHS[(index + place as usize) % DEPTHS.len()];
            let of = (channel.id, &channel.map);
            // Where a file leaves margins dark, nearer to the middle.
            let nearer = |pull: u32| {
                let pixel = pixel.lerp(size / 2.0, f64::from(pull) / f64::from(PULLS));
                let marker = Marker::at(of, channel.eye, pixel, channel.half, depth)?;
                // Nothing nearer is drawn: a marker that is too near goes further away.
                let needed = wall.near_m * NEARS_MIN / marker.distance_m(channel.eye.middle());
                if needed <= 1.0 {
                    return Some(marker);
                }
                Marker::at(of, channel.eye, pixel, channel.half, depth * needed)
            };
            let Some(mut marker) = (0..PULLS).find_map(nearer) else { continue };
            marker.of = channel.of;
            // From one point for all: that between the eyes.
            let (toward, radius) = marker.cone(wall.eye, aside_m);
            let is_free = |(_, other, other_radius): &(_, DVec3, f64)| {
                toward.distance(*other) > radius + other_radius
            };
            if markers.iter().all(is_free) {
                markers.push((marker, toward, radius));
            }
        }
    }
    markers.into_iter().map(|(marker, _, _)| marker).collect()
}

/// Looks for every marker in the picture of every channel that must show all of it.
fn find(
    (wall, drawn): (&Wall, Drawn<'_>),
    seen: &[ChannelView<'_>],
    markers: &[Marker],
    capture: &Capture,
    offset: DVec3,
) -> anyhow::Result<Vec<MarkerError>> {
    let mut all = Vec::new();
    for (at, channel) in seen.iter().enumerate() {
        let picture = picture_of(capture, channel.name)?;
        let light: LuminanceImage = light::of(drawn, wall, (channel.id, channel.of), picture)?;
        let size = light.size.as_dvec2();
        for (index, marker) in markers.iter().enumerate() {
            let is_of_channel = marker.channel == channel.id;
            let sight = marker::sight(&channel.map, channel.eye);
            let from = if is_of_channel { marker.pixel } else { size / 2.0 };
            let pixel = marker.seen_at(&sight, offset, (light.size, from));
            // The other eye of its display must see it too, if its picture has room there.
            let has_room = || pixel.is_some_and(|pixel| channel.has_room(pixel, size));
            let is_due = is_of_channel && (marker.of == channel.of || has_room());
            // Another channel's marker counts where all of it is seen.
            let inset = DVec2::splat(if is_due { 0.0 } else { channel.half * 1.5 });
            let is_whole =
                |pixel: &DVec2| pixel.cmpge(inset).all() && pixel.cmple(size - inset).all();
            let reading = pixel.filter(is_whole).map_or(Reading::Missing, |pixel| {
                let around = (pixel, channel.half);
                marker.read(&sight, &light, offset, around)
            });
            match (pixel, reading) {
                (Some(pixel), Reading::Off(error_px)) => {
                    all.push(MarkerError::new((at, index), &channel.map, pixel, error_px));
                }
                (_, Reading::Missing) if is_due => {
                    all.push(MarkerError::nothing((at, index), pixel.unwrap_or(marker.pixel)));
                }
                // Where its weight ends a channel says little, and another one shows the marker.
                _ => {}
            }
        }
    }
    Ok(all)
}

/// The picture of a channel.
///
/// # Errors
/// Why there is none.
pub(super) fn picture_of<'a>(capture: &'a Capture, name: &str) -> anyhow::Result<&'a Image> {
    let picture = capture.channels.iter().find(|picture| picture.name == name);
    picture.with_context(|| {
        let why = capture.missing.iter().find(|(missing, _)| missing == name);
        format!("channel {name} has no picture: {}", why.map_or("it sent none", |(_, why)| why))
    })
}

impl MarkerError {
    fn nothing((channel, marker): (usize, usize), pixel: DVec2) -> Self {
        Self { channel, marker, pixel, error_px: DVec2::NAN, error_in_display: DVec3::NAN }
    }

    /// Returns whether it is a point that is not on the screen, for eyes of omnidirectional stereo.
    fn is_deep(&self, seen: &[ChannelView<'_>], markers: &[Marker]) -> bool {
        let is_around = matches!(seen[self.channel].eye, Viewpoint::Around(_));
        is_around && !markers[self.marker].is_on_screen
    }

    /// Returns the point as reports have it.
    fn point(
        &self,
        (wall, seen, markers): (&Wall, &[ChannelView<'_>], &[Marker]),
    ) -> MeasuredPoint {
        let channel = &seen[self.channel];
        let bound_px = match (self.is_deep(seen, markers), channel.is_warped) {
            (true, _) => wall.stereo.error_max_px + WARPED_ERROR_MAX_PX,
            (false, true) => WARPED_ERROR_MAX_PX,
            (false, false) => ERROR_MAX_PX,
        };
        MeasuredPoint {
            channel: channel.name.to_owned(),
            eye: channel.of,
            screen: usize::from(wall.channels[usize::from(channel.id.0)].screen),
            pixel: self.pixel,
            canvas: channel.map.canvas_from_pixel(self.pixel).unwrap_or(DVec2::NAN),
            error_px: self.error_px.length(),
            bound_px,
            offset_m: 0.0,
        }
    }

    fn new(
        (channel, marker): (usize, usize),
        map: &ChannelMapping<'_>,
        pixel: DVec2,
        error_px: DVec2,
    ) -> Self {
        let along = |step: DVec2| {
            let (ahead, behind) =
                (map.display_from_pixel(pixel + step)?, map.display_from_pixel(pixel - step)?);
            Some((ahead - behind) / 2.0)
        };
        let (x, y) = (along(DVec2::X), along(DVec2::Y));
        let error_in_display = x.zip(y).map_or(DVec3::NAN, |(x, y)| {
            (x * error_px.x + y * error_px.y) / x.length().min(y.length())
        });
        Self { channel, marker, pixel, error_px, error_in_display }
    }
}

/// The largest of these numbers and where it is; a number that is none is the largest, and none at
/// all are no number: nothing is proved by what could not be read.
pub(super) fn worst(numbers: impl Iterator<Item = (f64, String)>) -> (f64, String) {
    let mut numbers = numbers.peekable();
    if numbers.peek().is_none() {
        return (f64::NAN, "nowhere".to_owned());
    }
    let mut worst = (0.0, String::new());
    for (number, place) in numbers {
        if number.is_nan() {
            return (number, place);
        }
        if number > worst.0 {
            worst = (number, place);
        }
    }
    worst
}

/// Points that are not on the screen, for eyes of omnidirectional stereo.
fn report_deep(
    table: &mut VerificationReport,
    (wall, seen): (&Wall, &[ChannelView<'_>]),
    deep: &[&MarkerError],
    at: &str,
) {
    if deep.is_empty() {
        return;
    }
    let errors = deep.iter().map(|found| (found.error_px.length(), seen[found.channel].label()));
    let (error, place) = worst(errors);
    let most = Some(Bound::AtMost(wall.stereo.error_max_px + WARPED_ERROR_MAX_PX));
    let note = format!("{place}, against an eye of its own for each pixel");
    table.add(format!("omnidirectional stereo behind the screen{at}"), error, "px", most, note);
}

fn report(
    table: &mut VerificationReport,
    (wall, seen, markers): (&Wall, &[ChannelView<'_>], &[Marker]),
    frames: &[Vec<MarkerError>],
    at: &str,
) {
    // Eyes of omnidirectional stereo stand still within each part of a picture: what is not on the
    // screen has a bound of its own.
    let is_deep = |found: &&MarkerError| found.is_deep(seen, markers);
    let all = || frames.iter().flatten().filter(|found| !is_deep(found));
    let deep: Vec<&MarkerError> = frames.iter().flatten().filter(is_deep).collect();
    report_deep(table, (wall, seen), &deep, at);
    for is_warped in [false, true] {
        if !seen.iter().any(|channel| channel.is_warped == is_warped) {
            continue;
        }
        let errors = all()
            .filter(|found| seen[found.channel].is_warped == is_warped)
            .map(|found| (found.error_px.length(), seen[found.channel].label()));
        let (error, place) = worst(errors);
        let (kind, most) =
            if is_warped { ("warped ", WARPED_ERROR_MAX_PX) } else { ("", ERROR_MAX_PX) };
        let note = if error.is_nan() {
            format!("{place}: a marker is not found, or none can be read")
        } else {
            place
        };
        table.add(format!("{kind}points{at}"), error, "px", Some(Bound::AtMost(most)), note);
    }
    let mut seams = Vec::new();
    for frame in frames {
        for (index, one) in frame.iter().enumerate() {
            let others = frame[index + 1..].iter().filter(|other| other.marker == one.marker);
            for other in others.filter(|other| !is_deep(other)) {
                let (a, b) = (&seen[one.channel], &seen[other.channel]);
                if a.meets(b) {
                    let apart = one.error_in_display.distance(other.error_in_display);
                    seams.push((apart, [a.label(), b.label()].join(" and ")));
                }
            }
        }
    }
    if !seams.is_empty() {
        let (apart, place) = worst(seams.into_iter());
        let most = Some(Bound::AtMost(SEAM_MAX_PX));
        table.add(format!("one point on two channels{at}"), apart, "px", most, place);
    }
    let mut jitter = Vec::new();
    for pair in frames.windows(2) {
        for found in &pair[1] {
            let is_same = |before: &&MarkerError| {
                (before.channel, before.marker) == (found.channel, found.marker)
            };
            let Some(before) = pair[0].iter().find(is_same) else { continue };
            let step = found.error_px.distance(before.error_px);
            jitter.push((step, seen[found.channel].label()));
        }
    }
    let (step, place) = worst(jitter.into_iter());
    let is_warped = seen.iter().any(|channel| channel.is_warped);
    let most = if is_warped { WARPED_ERROR_MAX_PX } else { JITTER_MAX_PX };
    let note = format!("{place} ({} markers)", markers.len());
    table.add(format!("jitter{at}"), step, "px", Some(Bound::AtMost(most)), note);
}

#[cfg(test)]
mod tests;
