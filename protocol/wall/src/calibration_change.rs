//! Tuning: changes of one channel's adjustment while the wall runs.
//!
//! Only changes that leave the display's size, the scene and all other channels as they are can be
//! made. The result is checked like a wall file: a picture that is folded is refused.

pub mod carry_over;
pub mod keys;
#[cfg(test)]
mod tests;

use glam::{DMat3, DVec2, DVec3, UVec2};
use serde::{Deserialize, Serialize};

use crate::channel_calibration::ControlGrid;
use crate::limits::{BEND_POINTS_MAX, LEAK_MAX, TUNE_CHANGES_MAX};
use crate::{Channel, ChannelCalibration, Ramps, TransferFunction, Wall, foldover};

/// Largest factor of light and largest γ: beyond it a slip of the finger is likelier than a
/// display that is like that.
const FACTOR_MAX: f64 = 16.0;

/// One change of a channel's adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum CalibrationChange {
    /// Moves a corner of the picture.
    Pin {
        /// The corner.
        corner: Corner,
        /// To where, in pixels from where it was drawn; x right, y down.
        to: Offset,
    },
    /// Gives the bend so many points across and down, which lie on the present bend; `None`: no
    /// bend.
    Grid(Option<UVec2>),
    /// Moves a point of the bend.
    Bend {
        /// From 0 at the left.
        column: u32,
        /// From 0 at the top.
        row: u32,
        /// To where, in pixels from where it was; x right, y down.
        to: Offset,
    },
    /// Light of red, green and blue is multiplied by these, last.
    Gain(DVec3),
    /// Linear light is multiplied by it, first.
    Matrix(DMat3),
    /// Codes become light by code^γ, of red, green and blue; `None`: as sRGB says.
    Gamma(Option<DVec3>),
    /// The display's black level, as a share of its white in red, green and blue; `None`: that of
    /// the wall's projectors.
    Leak(Option<DVec3>),
    /// The width of a blend in pixels; `None`: as wide as the overlap.
    Edge {
        /// At which edge.
        side: Edge,
        /// In pixels.
        width: Option<f64>,
    },
}

/// A corner of a channel's upright picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Corner {
    /// Its index in [`ChannelCalibration::pin`] is that of this list.
    UpperLeft,
    /// The second.
    UpperRight,
    /// The third.
    LowerLeft,
    /// The fourth.
    LowerRight,
}

/// An edge of a channel's upright picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Edge {
    /// At the viewer's left.
    Left,
    /// At the viewer's right.
    Right,
    /// The upper one.
    Top,
    /// The lower one.
    Bottom,
}

/// The new position of a corner or point, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Offset {
    /// Relative to its position without any move.
    To(DVec2),
    /// Relative to its present position.
    By(DVec2),
}

impl Corner {
    /// All, in the order of [`ChannelCalibration::pin`].
    pub const ALL: [Self; 4] =
        [Self::UpperLeft, Self::UpperRight, Self::LowerLeft, Self::LowerRight];

    /// Returns the corner's name in commands and wall files.
    pub fn name(self) -> &'static str {
        match self {
            Self::UpperLeft => "upper-left",
            Self::UpperRight => "upper-right",
            Self::LowerLeft => "lower-left",
            Self::LowerRight => "lower-right",
        }
    }
}

impl Edge {
    /// All.
    pub const ALL: [Self; 4] = [Self::Left, Self::Right, Self::Top, Self::Bottom];

    /// Returns the edge's name in commands and wall files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Top => "top",
            Self::Bottom => "bottom",
        }
    }

    fn is_upright(self) -> bool {
        matches!(self, Self::Left | Self::Right)
    }
}

impl Offset {
    fn of(self, present: DVec2) -> DVec2 {
        match self {
            Self::To(to) => to,
            Self::By(by) => present + by,
        }
    }
}

impl CalibrationChange {
    /// Returns the change's key in commands.
    pub fn key(&self) -> String {
        match self {
            Self::Pin { corner, .. } => format!("pin.{}", corner.name()),
            Self::Grid(_) => "bend".into(),
            Self::Bend { column, row, .. } => format!("bend.{column}.{row}"),
            Self::Gain(_) => "gain".into(),
            Self::Matrix(_) => "matrix".into(),
            Self::Gamma(_) => "gamma".into(),
            Self::Leak(_) => "leak".into(),
            Self::Edge { side, .. } => format!("edge.{}", side.name()),
        }
    }

    /// Makes the change.
    ///
    /// # Errors
    /// The fault of the change itself, or of the point that it names.
    fn make(&self, adjustment: &mut ChannelCalibration, size: DVec2) -> Result<(), String> {
        match self {
            Self::Pin { corner, to } => {
                let pin = &mut adjustment.pin[*corner as usize];
                *pin = moved(*to, *pin, size)?;
            }
            Self::Grid(points) => {
                adjustment.bend = points.map(|p| regridded(adjustment, p, size)).transpose()?;
            }
            Self::Bend { column, row, to } => {
                let bend = adjustment.bend.as_mut();
                let bend = bend.ok_or("there is no bend yet; make one first, with bend=5x5")?;
                let UVec2 { x, y } = bend.points;
                if *column >= x || *row >= y {
                    let (x, y) = (x - 1, y - 1);
                    return Err(format!("there are columns 0 to {x} and rows 0 to {y}"));
                }
                let at = &mut bend.moves.make_mut()[(row * x + column) as usize];
                *at = moved(*to, *at, size)?;
            }
            Self::Gain(gain) => {
                let fits = gain.cmpge(DVec3::ZERO).all() && gain.cmple(DVec3::splat(16.0)).all();
                adjustment.color.gain = *fits.then_some(gain).ok_or("0 to 16 can be")?;
            }
            Self::Matrix(matrix) => {
                let largest = matrix.to_cols_array().into_iter().fold(0.0, |a: f64, b| {
                    if b.is_finite() { a.max(b.abs()) } else { f64::INFINITY }
                });
                let fits = largest <= FACTOR_MAX;
                adjustment.color.matrix = *fits.then_some(matrix).ok_or("−16 to 16 can be")?;
            }
            Self::Gamma(gamma) => adjustment.color.curve = curve(*gamma)?,
            Self::Leak(leak) => {
                let is_share = |leak: &DVec3| {
                    leak.cmpge(DVec3::ZERO).all() && leak.cmple(DVec3::splat(LEAK_MAX)).all()
                };
                if leak.is_some_and(|leak| !is_share(&leak)) {
                    return Err(format!("0 to {LEAK_MAX} of white can be, or auto"));
                }
                adjustment.color.leak = *leak;
            }
            Self::Edge { side, width } => {
                if width.is_some() && adjustment.ramps == Ramps::Alpha {
                    let reason = "its alpha file says how its light fades; take ramps out of the \
                                  wall file to tune edges";
                    return Err(reason.to_owned());
                }
                let across = if side.is_upright() { size.x } else { size.y };
                if width.is_some_and(|width| !(0.0..=across).contains(&width)) {
                    return Err(format!("0 to {across} pixels can be, or auto"));
                }
                let edges = &mut adjustment.edges;
                *match side {
                    Edge::Left => &mut edges.left,
                    Edge::Right => &mut edges.right,
                    Edge::Top => &mut edges.top,
                    Edge::Bottom => &mut edges.bottom,
                } = *width;
            }
        }
        Ok(())
    }
}

/// A move that leaves a point within two pictures of where it was.
fn moved(to: Offset, present: DVec2, size: DVec2) -> Result<DVec2, String> {
    let moved = to.of(present);
    let fits = moved.is_finite() && moved.abs().cmple(size).all();
    fits.then_some(moved).ok_or_else(|| {
        format!("a point can be moved by as much as the picture is wide or high, {size} pixels")
    })
}

/// The present bend at so many points.
fn regridded(
    adjustment: &ChannelCalibration,
    points: UVec2,
    size: DVec2,
) -> Result<ControlGrid, String> {
    let count = u64::from(points.x) * u64::from(points.y);
    if points.min_element() < 2 || count > BEND_POINTS_MAX as u64 {
        return Err(format!("2x2 to {BEND_POINTS_MAX} points in all can be"));
    }
    let place =
        |row: u32, column: u32| UVec2::new(column, row).as_dvec2() / (points - 1).as_dvec2();
    let present =
        |place: DVec2| adjustment.bend.as_ref().map_or(DVec2::ZERO, |bend| bend.offset(place));
    let rows = 0..points.y;
    let moves = rows.flat_map(|row| (0..points.x).map(move |column| present(place(row, column))));
    let moves: Vec<_> = moves.collect();
    debug_assert!(size.is_finite() && moves.len() as u64 == count);
    Ok(ControlGrid { points, moves: moves.into() })
}

fn curve(gamma: Option<DVec3>) -> Result<TransferFunction, String> {
    let Some(gamma) = gamma else { return Ok(TransferFunction::Srgb) };
    let fits = gamma.cmpgt(DVec3::splat(0.1)).all() && gamma.cmple(DVec3::splat(FACTOR_MAX)).all();
    fits.then_some(TransferFunction::Gamma(gamma))
        .ok_or_else(|| "numbers above 0.1, up to 16, can be, or srgb".into())
}

/// The wall with these changes made to a channel, all or none.
///
/// # Errors
/// The wrong channel or key, its fault, and the fix.
pub fn apply_changes(
    wall: &Wall,
    channel: &str,
    changes: &[CalibrationChange],
) -> Result<Wall, String> {
    let Some((id, _)) = wall.channel_by_name(channel) else {
        let names: Vec<_> = wall.channels.iter().map(|channel| channel.name.as_str()).collect();
        return Err(format!("this wall has no channel {channel:?}; it has {}", names.join(", ")));
    };
    if changes.len() > TUNE_CHANGES_MAX {
        return Err(format!("{} changes at once, where {TUNE_CHANGES_MAX} can be", changes.len()));
    }
    let mut wall = wall.clone();
    let size = wall.channels[usize::from(id.0)].size.as_dvec2();
    for change in changes {
        let adjustment = &mut wall.channels[usize::from(id.0)].adjustment;
        change
            .make(adjustment, size)
            .map_err(|reason| format!("{channel}: {}: {reason}", change.key()))?;
    }
    if let Some(fault) = foldover::fault(&wall.channels[usize::from(id.0)]) {
        // The key that was turned last is what a person wants to hear of.
        let key =
            changes.iter().rev().map(CalibrationChange::key).find(|key| key.starts_with(fault.key));
        let key = key.unwrap_or_else(|| fault.key.to_owned());
        return Err(format!("{channel}: {key}: {fault}"));
    }
    // The other channels are as they were.
    wall.fault_of(&wall.channels[usize::from(id.0)]).map_or(Ok(wall), Err)
}

/// Returns the tuned adjustments of a wall's channels, by name: those that differ from the file's.
pub fn diff(file: &Wall, tuned: &Wall) -> Vec<(String, ChannelCalibration)> {
    let pairs = file.channels.iter().zip(&tuned.channels);
    let differing = pairs.filter(|(before, now)| before.adjustment != now.adjustment);
    differing.map(|(_, now)| (now.name.clone(), now.adjustment.clone())).collect()
}

/// The wall with these adjustments; numbers from a file are looked at as those of a client are.
///
/// # Errors
/// The reason why an adjustment does not fit.
pub fn reapply(file: &Wall, tunings: &[(String, ChannelCalibration)]) -> Result<Wall, String> {
    let mut wall = file.clone();
    for (name, adjustment) in tunings {
        let found = wall.channels.iter_mut().find(|channel| channel.name == *name);
        let channel = found.ok_or_else(|| format!("there is no channel {name:?}"))?;
        if !differs_only_by_calibration(&channel.adjustment, adjustment) {
            return Err(format!("channel {name} hangs otherwise"));
        }
        channel.adjustment = adjustment.clone();
    }
    // First: a bend of no points is none that could be folded.
    wall.fault().map_or(Ok(()), Err)?;
    wall.channels.iter().try_for_each(fold_or)?;
    Ok(wall)
}

fn fold_or(channel: &Channel) -> Result<(), String> {
    foldover::fault(channel).map_or(Ok(()), |fault| Err(format!("{}: {fault}", channel.name)))
}

/// Returns whether one differs from the other only in what can be tuned.
pub fn differs_only_by_calibration(file: &ChannelCalibration, tuned: &ChannelCalibration) -> bool {
    let ChannelCalibration { pin, bend, edges, color, .. } = file.clone();
    *file == ChannelCalibration { pin, bend, edges, color, ..tuned.clone() }
}
