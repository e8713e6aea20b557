//! `polyptych wall cylinder`: displays side by side on a cylinder around the viewer.

use std::fmt::Write;

use anyhow::bail;

use super::{Common, degrees, drawing, head, metres, pixels, round};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many displays side by side
    #[arg(long, default_value_t = 14, value_parser = clap::value_parser!(u32).range(1..=1024))]
    channels: u32,
    /// The angle of all of them
    #[arg(long, value_name = "DEGREES", value_parser = degrees, default_value = "360")]
    degrees: f64,
    /// From the axis, where the viewer stands, to the screen, in metres
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "3")]
    radius: f64,
    /// Pixels of each
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1200x1920")]
    pixels: [u32; 2],
    /// How high the screen is, in metres [default: so that pixels are square]
    #[arg(long, value_name = "METRES", value_parser = metres)]
    height: Option<f64>,
    /// Pixels that neighbours share, for projectors that blend
    #[arg(long, value_name = "PIXELS", default_value_t = 0)]
    overlap: u32,
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let Self { channels, degrees, radius, pixels: [width, height], overlap, .. } = *self;
        let shared = u64::from(channels - 1) * u64::from(overlap);
        let canvas = (u64::from(channels) * u64::from(width)).saturating_sub(shared);
        if overlap >= width || canvas == 0 {
            bail!("--overlap: {overlap} of {width} pixels leave nothing to a channel alone");
        }
        let arc = degrees.to_radians() * radius;
        let height_m = self.height.unwrap_or(arc / canvas as f64 * f64::from(height));
        let eye = self.common.eye_height;
        let mut comments = vec![
            format!("{channels} displays of {width} x {height} pixels on a cylinder of {radius} m"),
            format!("radius around the viewer: {arc:.3} x {height_m:.3} m, {degrees} degrees."),
            String::new(),
        ];
        comments.extend(drawing(channels, 1));
        let mut text = head(&self.common, "cylinder", &comments, [0.0, eye, 0.0]);
        write!(
            text,
            "[[screen]]\nname = \"round\"\n\n[screen.cylinder]\ncenter = [0.0, 0.0, 0.0]\n\
             radius = {radius:?}\ndegrees = [{:?}, {:?}]   # left and right edge, from -z\n\
             height = [{:?}, {:?}]   # metres above the floor\n\n[screen.tiles]\n\
             columns = {channels}\npixels = [{width}, {height}]\n",
            -degrees / 2.0,
            degrees / 2.0,
            round(eye - height_m / 2.0),
            round(eye + height_m / 2.0),
        )?;
        if overlap > 0 {
            writeln!(text, "overlap = [{overlap}, 0]   # pixels")?;
        }
        Ok(text)
    }
}
