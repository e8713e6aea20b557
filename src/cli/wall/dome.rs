//! `polyptych wall dome`: projectors in the middle of a dome, all around and one straight up.

use std::fmt::Write;

use anyhow::bail;

use super::{Common, head, metres, pixels, round};

/// How far the projectors around look up: their lower edge then lies on the springline.
const PITCH_DEGREES: f64 = 25.0;

/// How far each reaches into its neighbours, at the least.
const OVERLAP_DEGREES: f64 = 5.0;

/// How far below the springline the lower edge lies, as a tangent: a margin for those who aim.
const BELOW_TANGENT: f64 = 0.014;

/// Bounds of the upper projector's half angle.
const UPPER_DEGREES: (f64, f64) = (15.0, 70.0);

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    pub common: Common,
    /// How many projectors: all around, and one straight up
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(4..=32))]
    channels: u32,
    /// The dome's radius in metres; its springline is as high as the eye
    #[arg(long, value_name = "METRES", value_parser = metres, default_value = "4")]
    radius: f64,
    /// Pixels of a projector that looks around; they are square
    #[arg(long, value_name = "WxH", value_parser = pixels, default_value = "1920x1080")]
    pixels: [u32; 2],
}

impl Arguments {
    /// The wall file.
    pub fn text(&self) -> anyhow::Result<String> {
        let [width_px, height_px] = self.pixels;
        let around = self.channels - 1;
        let pitch = PITCH_DEGREES.to_radians();
        // On the springline, the azimuth a is at the tangent tan(a) / cos(pitch).
        let reach = (180.0 / f64::from(around) + OVERLAP_DEGREES).to_radians();
        let side = reach.tan() / pitch.cos();
        let bottom = -pitch.tan() - BELOW_TANGENT;
        let top = bottom + 2.0 * side * f64::from(height_px) / f64::from(width_px.max(1));
        // Straight ahead they reach least far up; what is above is the upper one's.
        let upper = 90.0 - PITCH_DEGREES - top.atan().to_degrees() + OVERLAP_DEGREES;
        let (low, high) = UPPER_DEGREES;
        if top <= bottom || upper > high {
            bail!(
                "{around} projectors of {width_px}x{height_px} pixels around leave {upper:.0}° to \
                 the one above, which can {high}°; give fewer --channels, or higher --pixels"
            );
        }
        let upper = upper.max(low).to_radians().tan();
        let pixels_per_degree = f64::from(width_px) / (2.0 * side.atan()).to_degrees();
        let quarter = (pixels_per_degree * 90.0).round().max(2.0) as u32;
        let eye = self.common.eye_height;
        let comments = [
            format!(
                "A dome of {} m radius, lit from its middle by {around} projectors",
                self.radius
            ),
            "all around and one straight up, which overlap and blend.".to_owned(),
            String::new(),
            "         . zenith .".to_owned(),
            "      .    \\    /    .".to_owned(),
            "     . around   around .".to_owned(),
            "    .        \\/        .".to_owned(),
            "    +------- ** -------+   springline, as high as the eye".to_owned(),
        ];
        let mut text = head(&self.common, "dome", &comments, [0.0, eye, 0.0]);
        writeln!(
            text,
            "[blend]\nleak = 0.002   # of a projector's white, in its black\n\n\
             [[screen]]\nname = \"dome\"\npixels = [{}, {quarter}]\n\n[screen.sphere]\n\
             center = [0.0, {eye:?}, 0.0]\nradius = {:?}\nazimuth = [-180, 180]\n\
             elevation = [0, 90]\n",
            quarter * 4,
            self.radius
        )?;
        let mut projector = |name: &str, size: [u32; 2], turned: [f64; 2], tangents: [f64; 4]| {
            let ([yaw, pitch], tangents) = (turned.map(round), tangents.map(round));
            writeln!(
                text,
                "[[screen.channel]]\nname = {name:?}\npixels = {size:?}\n\
                 [screen.channel.projector]\nposition = [0.0, {eye:?}, 0.0]\n\
                 rotation = [{yaw:?}, {pitch:?}, 0]\ntangents = {tangents:?}\n"
            )
        };
        for index in 0..around {
            // To the viewer's right, as channels of other walls go on.
            let yaw = (360.0 - f64::from(index) * 360.0 / f64::from(around)) % 360.0;
            let name = format!("around-{}", index + 1);
            projector(&name, self.pixels, [yaw, PITCH_DEGREES], [-side, side, bottom, top])?;
        }
        let square = [width_px.min(height_px); 2];
        projector("zenith", square, [0.0, 90.0], [-upper, upper, -upper, upper])?;
        Ok(text)
    }
}
