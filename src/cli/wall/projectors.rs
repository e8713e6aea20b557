//! Walls that are lit by projectors: their options, poses that cover the screen or what would
//! work instead, and their part of the wall file.

use std::fmt::Write;

use anyhow::{anyhow, bail};
use polyptych_wall_file::check_report::CheckReport;
use polyptych_wall_file::coverage::coverage;

use super::metres;
use super::pose::{LENS_HEIGHT_MIN_M, Lens, Pose, Trouble};

/// Throw ratio unless another one is asked for: that of a common zoom lens.
pub(super) const THROW_DEFAULT: f64 = 1.2;

/// Lens shift up or down unless another one is asked for, in heights of the picture.
const SHIFT_DEFAULT: f64 = 0.5;

/// Overlap of neighbours unless another one is asked for, in percent of a picture's side.
pub(super) const OVERLAP_DEFAULT: u32 = 15;

/// Maximum overlap in percent: more, and every place is lit twice.
const OVERLAP_MAX: u32 = 45;

/// How far above the screen lenses hang, in metres.
const ABOVE_SCREEN_M: f64 = 0.25;

/// How far above the viewer's eye lenses hang at least, in metres.
const ABOVE_EYE_M: f64 = 0.6;

/// Least distance between a projector and its screen, in metres.
pub(super) const DISTANCE_MIN_M: f64 = 0.3;

/// Throw ratios that are tried when another one fails: from that of a short-throw lens to that of
/// a long zoom.
const THROWS_TRIED: [f64; 2] = [0.3, 4.0];

/// What of an overlap may be missing where it is measured at places, as a share of it.
const OVERLAP_SLACK: f64 = 0.05;

/// Where projectors hang, and what their lenses can.
#[derive(Debug, clap::Args)]
pub(super) struct Options {
    /// Throw ratio of the projectors: distance by the picture's width there
    #[arg(long, value_name = "RATIO", value_parser = ratio)]
    pub throw: Option<f64>,
    /// Farthest that their lenses shift the picture up or down, in its heights [default: 0.5]
    #[arg(long, value_name = "HEIGHTS", value_parser = shift)]
    lens_shift: Option<f64>,
    /// Height of their lenses above the floor, in metres [default: above screen and heads]
    #[arg(long, value_name = "METRES", value_parser = metres)]
    mount_height: Option<f64>,
    /// Farthest that they may hang from what they light, in metres
    #[arg(long, value_name = "METRES", value_parser = metres)]
    throw_distance: Option<f64>,
}

/// A throw ratio, as an argument.
fn ratio(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a throw ratio"))?;
    let fits = (0.1..=20.0).contains(&number);
    fits.then_some(number).ok_or_else(|| format!("a throw ratio of {text} is not within 0.1 to 20"))
}

/// A lens shift, as an argument.
fn shift(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of heights"))?;
    let fits = (0.0..=1.5).contains(&number);
    fits.then_some(number).ok_or_else(|| format!("a lens shift of {text} is not within 0 to 1.5"))
}

/// An overlap across and down, as an argument: `288x162`, or one number for both.
pub(super) fn overlaps(text: &str) -> Result<[u32; 2], String> {
    let pair = text.split_once('x').unwrap_or((text, text));
    let pair = pair.0.parse().ok().zip(pair.1.parse().ok());
    let (across, down) =
        pair.ok_or_else(|| format!("{text:?} is no overlap; write ACROSSxDOWN"))?;
    Ok([across, down])
}

/// An overlap of projectors as a share of a picture's side.
pub(super) fn share(percent: u32) -> anyhow::Result<f64> {
    if percent > OVERLAP_MAX {
        bail!(
            "--overlap {percent}: with projectors it is percent of a picture's side; 0 to \
             {OVERLAP_MAX} work"
        );
    }
    Ok(f64::from(percent) / 100.0)
}

impl Options {
    /// Refuses options of projectors for a wall without any.
    pub fn refuse(&self) -> anyhow::Result<()> {
        let given = [
            ("--throw", self.throw.is_some()),
            ("--lens-shift", self.lens_shift.is_some()),
            ("--mount-height", self.mount_height.is_some()),
            ("--throw-distance", self.throw_distance.is_some()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => bail!("{name} is for projectors; add --projectors"),
            None => Ok(()),
        }
    }

    /// A lens of this throw ratio for pictures of so many pixels.
    pub fn lens(&self, throw: f64, [width, height]: [u32; 2]) -> Lens {
        let aspect = f64::from(height.max(1)) / f64::from(width.max(1));
        Lens { throw, aspect, shift_max: self.lens_shift.unwrap_or(SHIFT_DEFAULT) }
    }

    /// Height of the lenses above the floor, above this upper edge of the screen and this eye.
    pub fn height_m(&self, top_m: f64, eye_m: f64) -> anyhow::Result<f64> {
        match self.mount_height {
            None => Ok((top_m + ABOVE_SCREEN_M).max(eye_m + ABOVE_EYE_M).max(LENS_HEIGHT_MIN_M)),
            Some(height) if height < LENS_HEIGHT_MIN_M => bail!(
                "--mount-height {height}: projectors would hang where people are; \
                 {LENS_HEIGHT_MIN_M} m or more works"
            ),
            Some(height) => Ok(height),
        }
    }

    /// Returns whether lenses may hang higher than [`height_m`](Self::height_m) says.
    pub fn may_raise(&self) -> bool {
        self.mount_height.is_none()
    }

    /// The least and the greatest distance at which projectors may hang, in a room so deep.
    pub fn distance_m(&self, room_m: f64) -> anyhow::Result<[f64; 2]> {
        let far = self.throw_distance.unwrap_or(room_m).min(room_m);
        if far <= DISTANCE_MIN_M {
            bail!("{far} m are too near for a projector; more than {DISTANCE_MIN_M} m work");
        }
        Ok([DISTANCE_MIN_M, far])
    }
}

/// Poses for this throw ratio and number of channels; else an error that names what works.
///
/// # Errors
/// What stands in the way, and the throw ratio nearest to that asked for with which there are
/// poses; so too the number of channels, if `of` is the option for it.
pub(super) fn poses(
    (throw, channels): (f64, u32),
    of: Option<&str>,
    attempt: impl Fn(f64, u32) -> Result<Vec<Pose>, Trouble>,
) -> anyhow::Result<Vec<Pose>> {
    let trouble = match attempt(throw, channels) {
        Ok(poses) => return Ok(poses),
        Err(trouble) => trouble,
    };
    let mut remedies = Vec::new();
    let [least, greatest] = THROWS_TRIED;
    let shorter = |step: i32| (throw * 0.96_f64.powi(step) * 100.0).floor() / 100.0;
    let longer = |step: i32| (throw * 1.04_f64.powi(step) * 100.0).ceil() / 100.0;
    let mut throws = (1..100)
        .flat_map(|step| [shorter(step), longer(step)])
        .filter(|throw| (least..=greatest).contains(throw));
    if let Some(works) = throws.find(|throw| attempt(*throw, channels).is_ok()) {
        remedies.push(format!("--throw {works} works"));
    }
    let mut more = channels + 1..=channels.saturating_mul(4).min(channels + 24);
    if let Some(of) = of
        && let Some(works) = more.find(|channels| attempt(throw, *channels).is_ok())
    {
        remedies.push(format!("{of} {works} works"));
    }
    if remedies.is_empty() {
        remedies.push(trouble.remedy().to_owned());
    }
    bail!(
        "{channels} projectors with a throw ratio of {throw}:1 cannot light this screen: \
         {trouble}; {}",
        remedies.join(", ")
    )
}

/// The channels of a screen that these projectors light.
pub(super) fn write_channels(text: &mut String, poses: &[Pose], pixels: [u32; 2]) {
    for Pose { name, position, turned: [yaw, pitch], tangents, shift, distance_m } in poses {
        let [left, right, ..] = tangents;
        let throw = 1.0 / (right - left);
        let _ = write!(
            text,
            "\n[[screen.channel]]\nname = {name:?}\npixels = {pixels:?}\n\
             [screen.channel.projector]\nposition = {:?}   # {distance_m:.2} m from the middle of \
             its part\nrotation = [{yaw:?}, {pitch:?}, 0.0]   # yaw, pitch, roll\n\
             tangents = {tangents:?}   # throw {throw:.2}:1, lens shift {shift:.2}\n",
            position.to_array(),
        );
    }
}

/// The line of comments that says what channels of projectors are.
pub(super) fn comment(overlap_percent: u32) -> [String; 2] {
    [
        "Projectors by pose: where each lens is, where it looks and how wide it throws. The".into(),
        format!("pictures cover the whole screen; neighbours share {overlap_percent} % at least."),
    ]
}

/// The lines of comments that say what channels without a pose are.
pub(super) const SURFACE_COMMENT: [&str; 2] = [
    "Channels lie on the surface: panels, or projectors that something else warps. For flat",
    "projectors as they stand in the room, make it with --projectors.",
];

/// Proves with the wall file's own check that every screen is covered, that these pairs of
/// channels share so many pixels of its canvas, and that there is nothing to warn of.
///
/// # Errors
/// What is not covered, which two overlap too little, or the warning.
pub(super) fn verify(text: &str, pairs: &[([String; 2], f64)]) -> anyhow::Result<()> {
    let wall = polyptych_wall_file::parse(text, "wall.toml".as_ref());
    let wall = wall.map_err(|error| anyhow!("{}: {}", error.key(), error.what()))?;
    let mut left: Vec<&([String; 2], f64)> = pairs.iter().collect();
    for (index, screen) in wall.screens.iter().enumerate() {
        for found in coverage(&wall, index) {
            if let Some(hole) = found.holes.first() {
                bail!(
                    "no projector lights {:.0} pixels of screen {}; a greater --overlap may work",
                    hole.area,
                    screen.name
                );
            }
            let name = |index: usize| &wall.channels[index].name;
            let is_met = |(names, pixels): &([String; 2], f64)| {
                found.overlaps.iter().any(|overlap| {
                    let [a, b] = overlap.channels.map(name);
                    let is_it = names.contains(a) && names.contains(b);
                    is_it && overlap.patch.area >= pixels * (1.0 - OVERLAP_SLACK)
                })
            };
            left.retain(|pair| !is_met(pair));
        }
    }
    if let Some(([a, b], _)) = left.first() {
        bail!("{a} and {b} overlap less than asked; a greater one may work");
    }
    match CheckReport::from_wall(&wall).warnings.first() {
        Some(warning) => bail!("this wall would not be a good one: {warning}"),
        None => Ok(()),
    }
}
