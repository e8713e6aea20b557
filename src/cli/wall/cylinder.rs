//! `polyptych wall cylinder`: displays side by side on a cylinder around the viewer, or projectors
//! that light it.

use std::fmt::Write;

use anyhow::bail;
use glam::{DQuat, DVec2, DVec3};
use polyptych_wall::surface::{Cylinder, Surface};

use super::pose::{Pose, Room, Stand, Target, Trouble, solve};
use super::projectors::{self, OVERLAP_DEFAULT, SURFACE_COMMENT, THROW_DEFAULT};
use super::{Common, degrees, drawing, head, metres, pixels, round};

/// Degrees that a projector lights unless their number is asked for.
const DEGREES_OF_PROJECTOR: f64 = 60.0;

/// Points of a projector's part, across and down, that must lie within its picture.
const POINTS: [u32; 2] = [32, 8];

/// By how much a projector's part is exceeded, as a share of it.
const MARGIN: f64 = 0.004;

/// Projectors are no nearer than this to the far side of the cylinder, in metres.
const FAR_SIDE_M: f64 = 0.4;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many displays side by side [default: 14, or a projector for each 60 degrees]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    channels: Option<u32>,
    /// The angle of all of them
    #[arg(long, value_name = "DEGREES", value_parser = degrees, default_value = "360")]
    degrees: f64,
    /// From the axis, where the viewer stands, to the screen, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "3")]
    radius: f64,
    /// Pixels of each [default: 1200x1920, or 1920x1080 of projectors]
    #[arg(long, value_name = "WxH", value_parser = pixels)]
    pixels: Option<[u32; 2]>,
    /// How high the screen is, in metres [default: so that pixels are square]
    #[arg(long, value_name = "METRES", value_parser = metres)]
    height: Option<f64>,
    /// Pixels that neighbours share [default: 0]; with --projectors percent of a picture's width
    /// [default: 15]
    #[arg(long, value_name = "NUMBER")]
    overlap: Option<u32>,
    /// Light the screen by projectors that hang in the room, and write their poses
    #[arg(long)]
    projectors: bool,
    #[command(flatten)]
    lenses: projectors::Options,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        if self.projectors {
            return self.projected();
        }
        self.lenses.refuse()?;
        let [width, height] = self.pixels.unwrap_or([1200, 1920]);
        let (channels, overlap) = (self.channels.unwrap_or(14), self.overlap.unwrap_or(0));
        let shared = u64::from(channels - 1) * u64::from(overlap);
        let canvas = (u64::from(channels) * u64::from(width)).saturating_sub(shared);
        if overlap >= width || canvas == 0 {
            bail!("--overlap: {overlap} of {width} pixels leave nothing to a channel alone");
        }
        let arc = self.degrees.to_radians() * self.radius;
        let height_m = self.height.unwrap_or(arc / canvas as f64 * f64::from(height));
        let mut text = self.beginning("displays", channels, [width, height], height_m);
        write!(text, "\n[screen.tiles]\ncolumns = {channels}\npixels = [{width}, {height}]\n")?;
        if overlap > 0 {
            writeln!(text, "overlap = [{overlap}, 0]   # pixels")?;
        }
        Ok(text)
    }

    /// Everything up to the channels; projectors have a canvas of their own.
    fn beginning(&self, kind: &str, channels: u32, pixels: [u32; 2], height_m: f64) -> String {
        let Self { degrees, radius, .. } = *self;
        let ([width, height], eye) = (pixels, self.common.eye_height);
        let mut comments = vec![
            format!("{channels} {kind} of {width} x {height} pixels on a cylinder of {radius} m"),
            format!(
                "radius around the viewer: {:.3} x {height_m:.3} m, {degrees} degrees.",
                degrees.to_radians() * radius
            ),
            String::new(),
        ];
        if self.projectors {
            comments.extend(projectors::comment(self.overlap.unwrap_or(OVERLAP_DEFAULT)));
        } else {
            comments.extend(SURFACE_COMMENT.map(str::to_owned));
        }
        comments.push(String::new());
        comments.extend(drawing(channels, 1));
        let mut text = head(&self.common, "cylinder", &comments, [0.0, eye, 0.0]);
        if self.projectors {
            text += "[blend]\nleak = 0.002   # of a projector's white, in its black\n\n";
        }
        text += "[[screen]]\nname = \"round\"\n";
        if self.projectors {
            let [columns, rows] = self.canvas(channels, pixels, height_m);
            let _ = writeln!(text, "pixels = [{columns}, {rows}]");
        }
        text + &format!(
            "\n[screen.cylinder]\ncenter = [0.0, 0.0, 0.0]\n\
             radius = {radius:?}\ndegrees = [{:?}, {:?}]   # left and right edge, from -z\n\
             height = [{:?}, {:?}]   # metres above the floor\n",
            -degrees / 2.0,
            degrees / 2.0,
            round(eye - height_m / 2.0),
            round(eye + height_m / 2.0),
        )
    }

    /// The share of the screen's width that each projector lights of itself and both neighbours,
    /// and the share by which the next one begins farther on.
    fn parts(&self, channels: u32) -> anyhow::Result<[f64; 2]> {
        let count = f64::from(channels);
        let alone = 1.0 - projectors::share(self.overlap.unwrap_or(OVERLAP_DEFAULT))?;
        let is_ring = self.degrees >= 360.0;
        let width = 1.0 / if is_ring { count * alone } else { 1.0 + (count - 1.0) * alone };
        Ok([width, width * alone])
    }

    fn canvas(&self, channels: u32, [width, _]: [u32; 2], height_m: f64) -> [u32; 2] {
        let part = self.parts(channels).map_or(1.0, |[part, _]| part);
        let columns = (f64::from(width) / part).round();
        let arc = self.degrees.to_radians() * self.radius;
        [columns, (columns * height_m / arc).round()].map(|side| side.max(1.0) as u32)
    }

    fn projected(&self) -> anyhow::Result<String> {
        let pixels = self.pixels.unwrap_or([1920, 1080]);
        let fewest = (self.degrees / DEGREES_OF_PROJECTOR).ceil().max(1.0) as u32;
        let channels = self.channels.unwrap_or(fewest);
        let throw = self.lenses.throw.unwrap_or(THROW_DEFAULT);
        let arc = self.degrees.to_radians() * self.radius;
        let [part, step] = self.parts(channels)?;
        let side = f64::from(pixels[1]) / f64::from(pixels[0].max(1));
        let height_m = self.height.unwrap_or(arc * part * side);
        let eye_m = self.common.eye_height;
        let half_m = height_m / 2.0;
        let mount_m = self.lenses.height_m(eye_m + half_m, eye_m)?;
        let distance_m = self.lenses.distance_m(2.0 * self.radius - FAR_SIDE_M)?;
        let cylinder = Cylinder {
            center: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            radius_m: self.radius,
            azimuth_rad: [-0.5, 0.5].map(|side| side * self.degrees.to_radians()),
            height_m: [eye_m - half_m, eye_m + half_m],
        };
        let surface = Surface::Cylinder(cylinder);
        let room = Room {
            eye: DVec3::new(0.0, eye_m, 0.0),
            surfaces: vec![surface.clone()],
            distance_m,
            may_raise: self.lenses.may_raise(),
        };
        let attempt = |throw: f64, channels: u32| -> Result<Vec<Pose>, Trouble> {
            let parts = self.parts(channels).unwrap_or([1.0; 2]);
            let targets = self.targets(&surface, channels, parts, mount_m);
            solve(self.lenses.lens(throw, pixels), &targets, &room)
        };
        let poses = projectors::poses((throw, channels), Some("--channels"), attempt)?;
        let mut text = self.beginning("projectors", channels, pixels, height_m);
        projectors::write_channels(&mut text, &poses, pixels);
        let [columns, rows] = self.canvas(channels, pixels, height_m).map(f64::from);
        let pairs = poses.windows(2).map(|pair| {
            let names = [pair[0].name.clone(), pair[1].name.clone()];
            (names, (part - step) * columns * rows)
        });
        projectors::verify(&text, &pairs.collect::<Vec<_>>())?;
        Ok(text)
    }

    fn targets(
        &self,
        surface: &Surface,
        channels: u32,
        [part, step]: [f64; 2],
        height_m: f64,
    ) -> Vec<Target> {
        let at = |place: DVec2| surface.display_from_uv(place).unwrap_or_default();
        let is_ring = self.degrees >= 360.0;
        let target = |index: u32| {
            let first = if is_ring { step / 2.0 } else { part / 2.0 };
            let middle = first + step * f64::from(index);
            let half = DVec2::new(part, 1.0) * (0.5 + MARGIN);
            let [columns, rows] = POINTS;
            let places =
                (0..=rows).flat_map(|y| (0..=columns).map(move |x| DVec2::new(x.into(), y.into())));
            let side = DVec2::new(columns.into(), rows.into()) / 2.0;
            let points =
                places.map(|place| at(DVec2::new(middle, 0.5) + (place / side - 1.0) * half));
            let point = at(DVec2::new(middle, 0.5));
            let inward = -DVec3::new(point.x, 0.0, point.z) / self.radius;
            Target {
                name: format!("round-{}", index + 1),
                points: points.collect(),
                stand: Stand::Before { point, inward, height_m },
            }
        };
        (0..channels).map(target).collect()
    }
}
