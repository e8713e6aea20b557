//! Warnings about what works, but will not look its best.

use glam::UVec2;
use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use polyptych_wall::view_atlas::SOURCE_CELLS_MAX;
use polyptych_wall::{Channel, Eye, StereoMode, Surface, Wall};

use super::{ChannelRow, CoverageRow, ScreenRow, crossing, pitch_m, plausibility};
use crate::coverage::is_plain_tile;

/// Pixels whose sides differ by more than this show circles as ellipses that one can see.
const ANISOTROPY_MAX: f64 = 0.01;

/// An overlap that is narrower than this many pixels is seen as a line, however it is blended.
const OVERLAP_PX_MIN: f64 = 8.0;

/// A projector that loses more of its picture than this was not aimed.
const SPILL_MAX: f64 = 0.5;

/// Most warnings of one kind about one screen.
const OF_A_KIND_MAX: usize = 4;

/// A channel that is drawn from fewer pixels for each of its own is blurred there.
const SAMPLING_MIN: f64 = 0.999;

/// Everything that is to be said of the wall and of its rows.
pub(super) fn warnings(wall: &Wall, screens: &[ScreenRow], channels: &[ChannelRow]) -> Vec<String> {
    let mut warnings = uneven_pixels(wall);
    warnings.extend(plausibility::warnings(wall, screens, channels));
    warnings.extend(crossing::warnings(wall));
    for channel in wall.channels.iter().filter(|channel| is_plain_tile(channel)) {
        if channel.origin % 2 != UVec2::ZERO {
            warnings.push(format!(
                "channel {}: its origin [{}, {}] is odd, so that textures may differ from its \
                 neighbours'; even numbers are best",
                channel.name, channel.origin.x, channel.origin.y
            ));
        }
    }
    for (index, screen) in screens.iter().enumerate() {
        for coverage in &screen.coverage {
            warnings.extend(hole(screen, coverage));
            warnings.extend(overlaps(wall, index, screen, coverage));
        }
    }
    warnings.extend(channels.iter().filter_map(sampling));
    warnings.extend(stereo(wall, channels));
    warnings.extend(channels.iter().filter_map(spill));
    warnings
}

fn sampling(channel: &ChannelRow) -> Option<String> {
    let [fewest, _] = channel.sampling.filter(|[fewest, _]| *fewest < SAMPLING_MIN)?;
    Some(format!(
        "channel {}: with textures of {CHANNEL_SIDE_MAX} pixels it is drawn from {fewest:.2} \
         pixels for one of its own where they are fewest; divide it, or move the eye away from \
         its screen",
        channel.name
    ))
}

/// Warns of omnidirectional stereo without effect, or with a larger error than the wall file
/// allows.
fn stereo(wall: &Wall, channels: &[ChannelRow]) -> Vec<String> {
    if wall.stereo.mode == StereoMode::Head {
        return Vec::new();
    }
    if !wall.channels.iter().any(|channel| wall.is_omnidirectional(channel)) {
        let what = "wall.stereo is omnidirectional, and no channel is for one eye or for both; \
                    give channels eye = \"left\" and \"right\", or stereo = \"side-by-side\"";
        return vec![what.to_owned()];
    }
    let allowed = wall.stereo.error_max_px;
    let is_off = |row: &&ChannelRow| row.stereo_error_px.is_some_and(|error| error > allowed);
    let worst = |a: &&ChannelRow, b: &&ChannelRow| {
        let error = |row: &ChannelRow| row.stereo_error_px.unwrap_or(0.0);
        error(a).total_cmp(&error(b))
    };
    let row = channels.iter().filter(is_off).max_by(worst);
    let text = row.map(|row| {
        format!(
            "channel {}: with {SOURCE_CELLS_MAX} pictures for each eye, points behind the screen \
             are off by up to {:.2} px, where wall.stereo_error allows {allowed}; allow more, or \
             divide the channel",
            row.name,
            row.stereo_error_px.unwrap_or(0.0)
        )
    });
    text.into_iter().collect()
}

/// Light that is lost, and channels that cannot be drawn at all.
fn spill(channel: &ChannelRow) -> Option<String> {
    let ChannelRow { name, screen, .. } = channel;
    let remedy = if channel.cover == "projector" {
        "aim its projector, or narrow its picture"
    } else {
        "check its pins, or the units and the origin of its warp file"
    };
    match (channel.spill, &channel.unknown) {
        (Some(1.0), _) => {
            Some(format!("channel {name} lights nothing of screen {screen}; {remedy}"))
        }
        (Some(_), Some(why)) => {
            Some(format!("channel {name} cannot be drawn: {why}; move the eye, or {remedy}"))
        }
        (Some(share), None) if share > SPILL_MAX => Some(format!(
            "channel {name}: {} of its pixels miss screen {screen}; {remedy}",
            percent(share)
        )),
        _ => None,
    }
}

/// A share in percent that says neither 0 nor 100 unless it is so.
fn percent(share: f64) -> String {
    let percent = share * 100.0;
    if percent > 99.0 { format!("{percent:.3} %") } else { format!("{percent:.0} %") }
}

fn uneven_pixels(wall: &Wall) -> Vec<String> {
    // A dome's pixels are uneven by what it is, and a mesh's only its file knows.
    let is_even = |surface: &Surface| matches!(surface, Surface::Plane(_) | Surface::Cylinder(_));
    let screens = wall.screens.iter().filter(|screen| is_even(&screen.surface));
    let uneven = screens.filter_map(|screen| {
        let pitch = pitch_m(screen);
        let ratio = pitch.max_element() / pitch.min_element();
        let [x, y] = (pitch * 1e3).to_array();
        (ratio > 1.0 + ANISOTROPY_MAX).then(|| {
            format!(
                "screen {}: its pixels are {x:.4} mm wide and {y:.4} mm high, {:.1} % apart; \
                 check its metres and pixels",
                screen.name,
                (ratio - 1.0) * 100.0
            )
        })
    });
    uneven.collect()
}

/// Warns of a part that is not covered where channels blend; elsewhere the wall file hid it.
fn hole(screen: &ScreenRow, coverage: &CoverageRow) -> Option<String> {
    let largest = coverage.uncovered.first().filter(|_| coverage.blends)?;
    Some(format!(
        "screen {}: {}no channel shows {:.2} % of it, the largest part {largest}",
        screen.name,
        of_eye(coverage.eye),
        (1.0 - coverage.covered) * 100.0
    ))
}

fn of_eye(eye: Eye) -> &'static str {
    match eye {
        Eye::Center => "",
        Eye::Left => "for the left eye ",
        Eye::Right => "for the right eye ",
    }
}

/// Overlaps that look like slips: tiles that are no grid, slivers, ramps without width.
fn overlaps(wall: &Wall, index: usize, screen: &ScreenRow, coverage: &CoverageRow) -> Vec<String> {
    let on_screen = |channel: &&Channel| usize::from(channel.screen) == index;
    let channels: Vec<&Channel> = wall.channels.iter().filter(on_screen).collect();
    let is_by_hand = channels.iter().all(|c| is_plain_tile(c)) && !is_grid(&channels);
    let said = coverage.overlaps.iter().filter_map(|overlap| {
        let [first, second] = &overlap.channels;
        let [width, height] = overlap.patch.pixels;
        // Corners of a grid meet in small squares, which is as it should be.
        let is_sliver = width.min(height) < OVERLAP_PX_MIN && width.max(height) > OVERLAP_PX_MIN;
        let what = if !overlap.is_blended {
            "a ramp has no width there, so that its light ends in a line"
        } else if is_sliver && coverage.step_px == [0.0; 2] {
            "too narrow to be blended without a line"
        } else if is_by_hand {
            "they are blended there"
        } else {
            return None;
        };
        Some(format!(
            "screen {}: channels {first} and {second} overlap, {}: {what}",
            screen.name, overlap.patch
        ))
    });
    let mut said: Vec<String> = said.collect();
    if said.len() > OF_A_KIND_MAX {
        let more = said.len() - OF_A_KIND_MAX;
        said.truncate(OF_A_KIND_MAX);
        said.push(format!("screen {}: {more} more overlaps like these", screen.name));
    }
    said
}

/// Returns whether tiles of one size stand evenly in columns and rows, for each eye alike.
fn is_grid(channels: &[&Channel]) -> bool {
    let even = |axis: usize| {
        let mut at: Vec<u32> = channels.iter().map(|channel| channel.origin[axis]).collect();
        at.sort_unstable();
        at.dedup();
        let is_even = at.windows(3).all(|of| of[1] - of[0] == of[2] - of[1]);
        is_even.then_some(at.len())
    };
    let is_one_size = channels.iter().all(|channel| channel.size == channels[0].size);
    let per_place = |cells: usize| cells > 0 && channels.len().is_multiple_of(cells);
    is_one_size && even(0).zip(even(1)).is_some_and(|(x, y)| per_place(x * y))
}
