//! `polyptych wall arch`: flat screens in an arch around the viewer, each a display or lit by a
//! projector.

use std::fmt::Write;

use anyhow::bail;
use glam::{DVec2, DVec3};
use polyptych_wall::surface::{Plane, Surface};

use super::pose::{Room, Stand, Target, solve};
use super::projectors::{self, SURFACE_COMMENT, THROW_DEFAULT};
use super::{Common, degrees, drawing, head, metres, pixels, round};

/// By how much a projector exceeds its screen, as a share of it.
const MARGIN: f64 = 0.004;

/// Widest screen of an arch as the viewer sees it: beyond, its edges are far away.
const SCREEN_DEGREES_MAX: f64 = 150.0;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many screens, each a display
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=256))]
    channels: u32,
    /// The angle of all of them
    #[arg(long, value_name = "DEGREES", value_parser = degrees, default_value = "120")]
    degrees: f64,
    /// From the viewer to the middle of each, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "3")]
    radius: f64,
    /// Pixels of each; they are square
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
    /// Light each screen by a projector that hangs in the room, and write its pose
    #[arg(long)]
    projectors: bool,
    #[command(flatten)]
    lenses: projectors::Options,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let Self { channels, degrees, radius, pixels: [width_px, height_px], .. } = *self;
        let step = degrees / f64::from(channels);
        if step > SCREEN_DEGREES_MAX {
            bail!("{channels} screens over {degrees}° are {step}° each; {SCREEN_DEGREES_MAX} fit");
        }
        let width = 2.0 * radius * (step / 2.0).to_radians().tan();
        let height = width * f64::from(height_px) / f64::from(width_px.max(1));
        let mut comments = vec![
            format!("{channels} flat screens in an arch of {degrees} degrees around the viewer,"),
            format!("{width:.3} x {height:.3} m and {width_px} x {height_px} pixels each:"),
            String::new(),
        ];
        comments.extend(drawing(channels, 1));
        comments.push(String::new());
        if self.projectors {
            comments
                .push("Projectors by pose: where each lens is, where it looks, how wide.".into());
        } else {
            self.lenses.refuse()?;
            comments.extend(SURFACE_COMMENT.map(str::to_owned));
        }
        let poses = if self.projectors { self.poses([width, height])? } else { Vec::new() };
        let eye = self.common.eye_height;
        let mut text = head(&self.common, "arch", &comments, [0.0, eye, 0.0]);
        for index in 0..channels {
            // From −Z, growing to the viewer's right.
            let azimuth = (f64::from(index) + 0.5) * step - degrees / 2.0;
            let (sin, cos) = azimuth.to_radians().sin_cos();
            writeln!(
                text,
                "[[screen]]\nname = \"arch-{}\"\nsize = [{:?}, {:?}]\n\
                 center = [{:?}, {:?}, {:?}]\nrotation = [{:?}, 0, 0]",
                index + 1,
                round(width),
                round(height),
                round(radius * sin),
                round(eye),
                round(-radius * cos),
                round(-azimuth),
            )?;
            match poses.get(index as usize) {
                None => writeln!(text, "tiles.pixels = [{width_px}, {height_px}]\n")?,
                Some(pose) => {
                    writeln!(text, "pixels = [{width_px}, {height_px}]")?;
                    let pose = std::slice::from_ref(pose);
                    projectors::write_channels(&mut text, pose, [width_px, height_px]);
                    text.push('\n');
                }
            }
        }
        projectors::verify(&text, &[])?;
        Ok(text)
    }

    /// A projector for each screen of this size in metres.
    fn poses(&self, [width, height]: [f64; 2]) -> anyhow::Result<Vec<super::pose::Pose>> {
        let Self { channels, degrees, radius, .. } = *self;
        let eye_m = self.common.eye_height;
        let mount_m = self.lenses.height_m(eye_m + height / 2.0, eye_m)?;
        let distance_m = self.lenses.distance_m(2.0 * radius)?;
        let step = degrees / f64::from(channels);
        let screen = |index: u32| {
            let azimuth = ((f64::from(index) + 0.5) * step - degrees / 2.0).to_radians();
            let out = DVec3::new(azimuth.sin(), 0.0, -azimuth.cos());
            let right = DVec3::new(-out.z, 0.0, out.x);
            let middle = DVec3::Y * eye_m + out * radius;
            let corner = |x: f64, y: f64| middle + right * (x * width) + DVec3::Y * (y * height);
            let lower_left = corner(-0.5, -0.5);
            let (lower_right, upper_left) = (corner(0.5, -0.5), corner(-0.5, 0.5));
            let plane = Surface::Plane(Plane { lower_left, lower_right, upper_left });
            let edge = 0.5 + MARGIN;
            let corners = [[-edge, -edge], [edge, -edge], [-edge, edge], [edge, edge]];
            let target = Target {
                name: format!("arch-{}", index + 1),
                points: corners.map(DVec2::from).map(|at| corner(at.x, at.y)).to_vec(),
                stand: Stand::Before { point: middle, inward: -out, height_m: mount_m },
            };
            (plane, target)
        };
        let (surfaces, targets): (Vec<_>, Vec<_>) = (0..channels).map(screen).unzip();
        let eye = DVec3::Y * eye_m;
        let room = Room { eye, surfaces, distance_m, may_raise: self.lenses.may_raise() };
        let throw = self.lenses.throw.unwrap_or(THROW_DEFAULT);
        // Another number of screens would be another arch.
        let attempt = |throw: f64, _| solve(self.lenses.lens(throw, self.pixels), &targets, &room);
        projectors::poses((throw, channels), None, attempt)
    }
}
