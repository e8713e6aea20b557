//! `polyptych wall dome`: projectors at the rim of a dome, which light its far side and its top.

use std::fmt::Write;

use anyhow::bail;
use glam::{DQuat, DVec3};
use polyptych_wall::surface::{Sphere, Surface};

use super::pose::{LENS_HEIGHT_MIN_M, Pose, Room, Stand, Target, Trouble, solve};
use super::projectors::{self, OVERLAP_DEFAULT};
use super::{Common, head, metres, pixels, round};

/// How far from the axis lenses are, as a share of the dome's radius: in the cove along its rim.
const RIM: f64 = 0.92;

/// How far below the springline lenses are, in metres, so that nobody's light meets them.
const BELOW_SPRINGLINE_M: f64 = 0.5;

/// How far above the viewer's eye the springline is unless asked for, in metres: light goes from
/// rim to rim over heads.
const SPRINGLINE_ABOVE_EYE_M: f64 = 1.0;

/// Throw ratios that are tried, from the longest, unless one is asked for.
const THROW_RANGE: (f64, f64) = (0.3, 1.6);

/// Elevations up to which the projectors around are tried, in degrees.
const ELEVATION_RANGE: (u32, u32) = (15, 85);

/// By how much a projector's part is exceeded, in degrees.
const MARGIN_DEGREES: f64 = 0.4;

/// Points of a projector's part, around and up, that must lie within its picture.
const POINTS: [u32; 2] = [24, 12];

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many projectors: all around, and one for the top
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(4..=32))]
    channels: u32,
    /// The dome's radius in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "4")]
    radius: f64,
    /// How high its lower edge is above the floor, in metres [default: 1 m above the eye, and 2.5
    /// m at least]
    #[arg(long, value_name = "METRES", value_parser = metres)]
    springline: Option<f64>,
    /// Pixels of a projector; they are square
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
    /// What neighbours share, in percent of a picture's width
    #[arg(long, value_name = "PERCENT", default_value_t = OVERLAP_DEFAULT)]
    overlap: u32,
    #[command(flatten)]
    lenses: projectors::Options,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let Self { channels, radius, pixels: [width_px, _], .. } = *self;
        let share = projectors::share(self.overlap)?;
        let eye_m = self.common.eye_height;
        let lowest_m = LENS_HEIGHT_MIN_M + BELOW_SPRINGLINE_M;
        let usual_m = (eye_m + SPRINGLINE_ABOVE_EYE_M).max(lowest_m);
        let springline_m = self.springline.unwrap_or(usual_m);
        if springline_m < lowest_m {
            bail!(
                "--springline {springline_m}: projectors hang {BELOW_SPRINGLINE_M} m below it, \
                 where people are; {lowest_m} m or more works"
            );
        }
        let middle = DVec3::new(0.0, springline_m, 0.0);
        let attempt = |throw: f64, channels: u32| self.poses(throw, channels, share, middle);
        let (low, high) = THROW_RANGE;
        let steps = ((high - low) / 0.02) as u32;
        let all = (0..steps).map(|step| (high * 100.0 - f64::from(step) * 2.0).round() / 100.0);
        let throw =
            self.lenses.throw.or_else(|| all.into_iter().find(|t| attempt(*t, channels).is_ok()));
        let poses =
            projectors::poses((throw.unwrap_or(low), channels), Some("--channels"), attempt)?;
        let degrees = 360.0 / (f64::from(channels - 1) * (1.0 - share));
        let quarter = (f64::from(width_px) / degrees * 90.0).round().max(2.0) as u32;
        let mut comments = vec![format!(
            "A dome of {radius} m radius, lit from its rim by {} projectors that each light a part",
            channels - 1
        )];
        comments.push("of the far side, and by one that lights the top.".to_owned());
        comments.extend(projectors::comment(self.overlap));
        let drawing = [
            "",
            "         . zenith .",
            "      .       /    \\ .",
            "     .       /   around.",
            "    .       /   ___---  .",
            "    +------/_---\"------+   springline",
            "    **                  |",
            "             eye             ** lenses, 0.5 m below the springline",
        ];
        comments.extend(drawing.map(str::to_owned));
        let mut text = head(&self.common, "dome", &comments, [0.0, eye_m, 0.0]);
        writeln!(
            text,
            "[blend]\nleak = 0.002   # of a projector's white, in its black\n\n\
             [[screen]]\nname = \"dome\"\npixels = [{}, {quarter}]\n\n[screen.sphere]\n\
             center = [0.0, {springline_m:?}, 0.0]\nradius = {radius:?}\n\
             azimuth = [-180, 180]\nelevation = [0, 90]",
            quarter * 4,
        )?;
        projectors::write_channels(&mut text, &poses, self.pixels);
        projectors::verify(&text, &[])?;
        Ok(text)
    }

    /// Projectors around up to the highest elevation at which they still cover their part, and one
    /// that covers what is above.
    fn poses(
        &self,
        throw: f64,
        channels: u32,
        share: f64,
        middle: DVec3,
    ) -> Result<Vec<Pose>, Trouble> {
        let around = channels - 1;
        let azimuth_rad = [-std::f64::consts::PI, std::f64::consts::PI];
        let elevation_rad = [0.0, std::f64::consts::FRAC_PI_2];
        let rotation = DQuat::IDENTITY;
        let sphere =
            Sphere { center: middle, rotation, radius_m: self.radius, azimuth_rad, elevation_rad };
        let room = Room {
            eye: DVec3::new(0.0, self.common.eye_height, 0.0),
            surfaces: vec![Surface::Sphere(sphere)],
            distance_m: [projectors::DISTANCE_MIN_M, 2.0 * self.radius],
            may_raise: false,
        };
        let lens = self.lenses.lens(throw, self.pixels);
        let target = |index: u32, to: f64| self.around(index, around, to, share, middle);
        let fits = |to: &u32| solve(lens, &[target(0, f64::from(*to))], &room).is_ok();
        let (low, high) = ELEVATION_RANGE;
        let to = (low..=high).rev().find(fits).map_or(f64::from(low), f64::from);
        let mut targets: Vec<Target> = (0..around).map(|index| target(index, to)).collect();
        targets.push(self.zenith(around, to - share * 90.0, middle));
        solve(lens, &targets, &room)
    }

    /// A projector's part of the far side: from the springline up to an elevation in degrees.
    fn around(&self, index: u32, of: u32, to: f64, share: f64, middle: DVec3) -> Target {
        let azimuth = f64::from(index) * 360.0 / f64::from(of);
        let half = 180.0 / (f64::from(of) * (1.0 - share)) + MARGIN_DEGREES;
        let [columns, rows] = POINTS.map(f64::from);
        let point = |x: u32, y: u32| {
            let side = half * (2.0 * f64::from(x) / columns - 1.0);
            let up = -MARGIN_DEGREES + (to + MARGIN_DEGREES) * f64::from(y) / rows;
            self.on_dome(middle, azimuth + side, up)
        };
        let points = (0..=POINTS[1]).flat_map(|y| (0..=POINTS[0]).map(move |x| (x, y)));
        Target {
            name: format!("around-{}", index + 1),
            points: points.map(|(x, y)| point(x, y)).collect(),
            stand: Stand::At(self.on_rim(middle, azimuth + 180.0)),
        }
    }

    /// The part around the top from an elevation in degrees on.
    fn zenith(&self, around: u32, from: f64, middle: DVec3) -> Target {
        let points = (0..=POINTS[1]).flat_map(|y| (0..POINTS[0]).map(move |x| (x, y)));
        let point = |(x, y): (u32, u32)| {
            let up = from + (90.0 - from) * f64::from(y) / f64::from(POINTS[1]);
            self.on_dome(middle, f64::from(x) * 360.0 / f64::from(POINTS[0]), up)
        };
        // Between two of those around.
        let azimuth = 180.0 + 180.0 / f64::from(around);
        Target {
            name: "zenith".to_owned(),
            points: points.map(point).collect(),
            stand: Stand::At(self.on_rim(middle, azimuth)),
        }
    }

    fn on_dome(&self, middle: DVec3, azimuth: f64, elevation: f64) -> DVec3 {
        let ((sin, cos), (up, out)) =
            (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
        middle + DVec3::new(out * sin, up, -out * cos) * self.radius
    }

    fn on_rim(&self, middle: DVec3, azimuth: f64) -> DVec3 {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let rim = DVec3::new(sin, 0.0, -cos) * (RIM * self.radius);
        (middle + rim - DVec3::Y * BELOW_SPRINGLINE_M).to_array().map(round).into()
    }
}
