//! `polyptych wall arch`: flat screens in an arch around the viewer.

use std::fmt::Write;

use anyhow::bail;

use super::{Common, degrees, drawing, head, metres, pixels, round};

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
        let eye = self.common.eye_height;
        let mut text = head(&self.common, "arch", &comments, [0.0, eye, 0.0]);
        for index in 0..channels {
            // From −Z, growing to the viewer's right.
            let azimuth = (f64::from(index) + 0.5) * step - degrees / 2.0;
            let (sin, cos) = azimuth.to_radians().sin_cos();
            writeln!(
                text,
                "[[screen]]\nname = \"arch-{}\"\nsize = [{:?}, {:?}]\n\
                 center = [{:?}, {:?}, {:?}]\nrotation = [{:?}, 0, 0]\n\
                 tiles.pixels = [{width_px}, {height_px}]\n",
                index + 1,
                round(width),
                round(height),
                round(radius * sin),
                round(eye),
                round(-radius * cos),
                round(-azimuth),
            )?;
        }
        Ok(text)
    }
}
