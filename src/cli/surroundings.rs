//! `polyptych environment`, `exposure`, `tone`, `fog`, `glow` and `ambient-occlusion`: the light of
//! a running wall, and of a run.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use polyptych_client::glam::DVec3;
use polyptych_client::{AmbientOcclusion, DepthOfField, EnvironmentSource, Fog, Glow, ToneMapper};
use polyptych_text::printable;

use super::remote::{here_or_there, point, positive};
use super::{ManagerAddress, depth_of_field, say, seen};
use crate::simulator::look::{Brightness, Look};

/// Limits of an exposure in stops: a factor of 2 to the power of this is far from all that a
/// picture can show, and from what f32 holds.
const STOPS_MAX: f64 = 64.0;

/// How a run shows its scene.
#[derive(Debug, Default, clap::Args)]
pub(super) struct LookArguments {
    /// Multiply all light by this, or "auto": by what the wall shows [default: 1, or what suits
    /// lights in real units]
    #[arg(long, value_name = "FACTOR|auto", value_parser = brightness)]
    pub exposure: Option<Brightness>,
    /// Surround the scene by light: an equirectangular Radiance .hdr file; or "sky", a clear sky
    /// with the scene's sun
    #[arg(long, value_name = "FILE|sky")]
    pub environment: Option<String>,
    /// Show exposed light as "neutral", "aces" or "none" do [default: neutral]
    #[arg(long, value_name = "NAME")]
    pub tone: Option<ToneMapper>,
    /// Lay fog over the scene: the distance of sight in world units
    #[arg(long, value_name = "VISIBILITY", value_parser = positive)]
    pub fog: Option<f64>,
    /// Spread this share of all light around what is bright, above 0 and up to 1
    #[arg(long, value_name = "STRENGTH", value_parser = glow_strength)]
    pub glow: Option<f32>,
    /// Darken corners and gaps: nothing farther than this takes light from a place, in world units
    #[arg(long, value_name = "RADIUS", value_parser = occlusion_radius)]
    pub ambient_occlusion: Option<f32>,
    /// Blur what is nearer or farther than a distance from the eye, in world units: the distance,
    /// or FOCUS,APERTURE with the width of the lens [default aperture: a fiftieth of the focus]
    #[arg(long, value_name = "FOCUS", value_parser = depth_of_field::focus)]
    pub depth_of_field: Option<DepthOfField>,
}

impl LookArguments {
    /// Returns what is asked for.
    ///
    /// # Errors
    /// A file of surroundings that cannot be found.
    pub fn look(&self) -> anyhow::Result<Look> {
        Ok(Look {
            environment: self.environment.as_deref().map(surroundings).transpose()?,
            tone: self.tone,
            fog: self.fog.map(Fog::even),
            glow: self.glow.map(Glow::new),
            ambient_occlusion: self.ambient_occlusion.map(|radius| AmbientOcclusion { radius }),
            depth_of_field: self.depth_of_field,
            exposure: self.exposure,
        })
    }
}

/// A factor of light, as an argument.
pub(super) fn factor(text: &str) -> Result<f32, String> {
    let number: f32 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    let is_factor = number.is_finite() && number >= 0.0;
    is_factor.then_some(number).ok_or_else(|| format!("{text} is not 0 or more"))
}

/// The surroundings that are asked for.
fn surroundings(asked: &str) -> anyhow::Result<EnvironmentSource> {
    if asked == "sky" {
        return Ok(EnvironmentSource::Sky);
    }
    let file = Path::new(asked).canonicalize().with_context(|| {
        format!("--environment {asked}: neither sky nor a file that can be found")
    })?;
    Ok(EnvironmentSource::File { path: file.display().to_string() })
}

/// The exposure of a run, as an argument.
fn brightness(text: &str) -> Result<Brightness, String> {
    if text == "auto" {
        return Ok(Brightness::Automatic);
    }
    let factor = factor(text).map(Brightness::Factor);
    factor.map_err(|error| format!("{error}; or write auto"))
}

#[derive(Debug, clap::Args)]
pub(super) struct EnvironmentArguments {
    /// An equirectangular Radiance .hdr file in one of the manager's scene folders; "sky", a clear
    /// sky with the sun of the open scene; or "none", each scene's own sky. Without it, say which
    environment: Option<String>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// Surrounds scenes by light, or says by what they are surrounded.
pub(super) fn environment(arguments: &EnvironmentArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    if let Some(asked) = &arguments.environment {
        match asked.as_str() {
            "none" => client.set_environment(EnvironmentSource::None)?,
            "sky" => client.set_environment(EnvironmentSource::Sky)?,
            file => here_or_there(file, |path| {
                client.set_environment(EnvironmentSource::File { path: path.to_owned() })
            })?,
        }
    }
    match client.status()?.environment {
        Some(name) => say(format_args!("environment {}", printable(&name))),
        None => say("environment none: scenes have their own sky"),
    }?;
    seen::conclude(&client, arguments.environment.is_some())
}

#[derive(Debug, clap::Args)]
pub(super) struct ExposureArguments {
    /// In stops: 1 is twice as bright as 0, and -1 half as bright; 0 shows a radiance of 1 as it
    /// is. Or "auto", by what the wall shows. Without it, say how it is
    #[arg(value_name = "EV|auto", value_parser = wish)]
    wish: Option<Exposure>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// An exposure that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Exposure {
    Automatic,
    Stops(f64),
}

/// Sets the exposure, or says how it is.
pub(super) fn exposure(arguments: &ExposureArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    match arguments.wish {
        Some(Exposure::Automatic) => client.set_automatic_exposure()?,
        Some(Exposure::Stops(stops)) => client.set_exposure(stops.exp2() as f32)?,
        None => {}
    }
    let shown = client.presentation()?;
    let (factor, stops) = (shown.exposure, shown.exposure.log2());
    if !shown.is_exposure_automatic {
        say(format_args!("exposure {stops:.2} EV, a factor of {factor}"))?;
    } else if arguments.wish.is_some() {
        say("exposure automatic: frames that are drawn set it")?;
    } else {
        say(format_args!("exposure automatic, now {stops:.2} EV, a factor of {factor}"))?;
    }
    seen::conclude(&client, arguments.wish.is_some())
}

/// An exposure, as an argument.
fn wish(text: &str) -> Result<Exposure, String> {
    if text == "auto" {
        return Ok(Exposure::Automatic);
    }
    let stops: f64 =
        text.parse().map_err(|_| format!("{text:?} is neither a number of stops nor auto"))?;
    let is_one = stops.abs() <= STOPS_MAX;
    is_one
        .then_some(Exposure::Stops(stops))
        .ok_or_else(|| format!("{text} is not within -{STOPS_MAX} to {STOPS_MAX}"))
}

#[derive(Debug, clap::Args)]
pub(super) struct ToneArguments {
    /// "neutral", which keeps the colours of materials; "aces", as films look; or "none", where
    /// what is brighter than 1 is white. Without it, say which
    tone: Option<ToneMapper>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// Sets how exposed light becomes what displays show, or says how.
pub(super) fn tone(arguments: &ToneArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    if let Some(tone) = arguments.tone {
        client.set_tone(tone)?;
    }
    say(format_args!("tone {}", client.presentation()?.tone.name()))?;
    seen::conclude(&client, arguments.tone.is_some())
}

#[derive(Debug, clap::Args)]
pub(super) struct FogArguments {
    /// Distance of sight in world units: 5 % of the light of a surface passes. Or "none". Without
    /// it, say how it is
    #[arg(value_name = "VISIBILITY|none", value_parser = visibility)]
    visibility: Option<Visibility>,
    /// The height, as Y in world units, at which one sees that far
    #[arg(long, value_name = "Y", default_value_t = 0.0, requires = "visibility")]
    height: f64,
    /// Let half of it be left with each so many units above, and twice as much be below [default:
    /// the same everywhere]
    #[arg(long, value_name = "UNITS", value_parser = positive, requires = "visibility")]
    half: Option<f64>,
    /// The share of red, green and blue that it scatters, 0 to 1: R,G,B
    #[arg(
        long,
        value_name = "R,G,B",
        value_parser = point,
        default_value = "1,1,1",
        requires = "visibility"
    )]
    color: DVec3,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// A fog that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Visibility {
    Unlimited,
    Units(f64),
}

fn visibility(text: &str) -> Result<Visibility, String> {
    match text {
        "none" => Ok(Visibility::Unlimited),
        _ => positive(text).map(Visibility::Units).map_err(|error| format!("{error}, or none")),
    }
}

/// Lays fog over the wall or takes it away, or says how it is.
pub(super) fn fog(arguments: &FogArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    match arguments.visibility {
        Some(Visibility::Unlimited) => client.set_fog(None)?,
        Some(Visibility::Units(visibility)) => client.set_fog(Some(Fog {
            visibility,
            height: arguments.height,
            half_height: arguments.half,
            color: arguments.color.as_vec3().to_array(),
        }))?,
        None => {}
    }
    if let Some(Fog { visibility, height, half_height, color: [r, g, b] }) =
        client.presentation()?.fog
    {
        let layer = match half_height {
            Some(half) => format!(" at a height of {height}, half of it with each {half} above"),
            None => String::new(),
        };
        say(format_args!("fog with a visibility of {visibility}{layer}, scatters {r},{g},{b}"))?;
    } else {
        say("fog none")?;
    }
    seen::conclude(&client, arguments.visibility.is_some())
}

#[derive(Debug, clap::Args)]
pub(super) struct GlowArguments {
    /// The share of all light that spreads, above 0 and up to 1: 0.05 is a lens, 0.2 is mist. Or
    /// "none". Without it, say how it is
    #[arg(value_name = "STRENGTH|none", value_parser = strength)]
    strength: Option<Strength>,
    /// The width of the widest part as seen by the viewer, in degrees, 0.1 to 7
    #[arg(long, value_name = "DEGREES", default_value_t = 4.0, requires = "strength")]
    width: f32,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// A glow that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Strength {
    None,
    Share(f32),
}

fn strength(text: &str) -> Result<Strength, String> {
    match text {
        "none" => Ok(Strength::None),
        _ => glow_strength(text).map(Strength::Share).map_err(|error| format!("{error}, or none")),
    }
}

/// Reads the strength of a glow.
fn glow_strength(text: &str) -> Result<f32, String> {
    let strength: f32 = text.parse().map_err(|_| "a number above 0 and up to 1")?;
    match Glow::new(strength).fault() {
        Some(fault) => Err(fault),
        None => Ok(strength),
    }
}

/// Spreads light around what is bright or ends it, or says how it is.
pub(super) fn glow(arguments: &GlowArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    match arguments.strength {
        Some(Strength::None) => client.set_glow(None)?,
        Some(Strength::Share(strength)) => {
            client.set_glow(Some(Glow { strength, width_degrees: arguments.width }))?;
        }
        None => {}
    }
    match client.presentation()?.glow {
        Some(Glow { strength, width_degrees }) => {
            say(format_args!("glow with a strength of {strength}, {width_degrees}° wide"))
        }
        None => say("glow none"),
    }?;
    seen::conclude(&client, arguments.strength.is_some())
}

#[derive(Debug, clap::Args)]
pub(super) struct OcclusionArguments {
    /// Nothing farther than this takes light from a place, in world units; above 0. Or "none".
    /// Without it, say how it is
    #[arg(value_name = "RADIUS|none", value_parser = radius)]
    radius: Option<Radius>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// An ambient occlusion that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Radius {
    None,
    Within(f32),
}

fn radius(text: &str) -> Result<Radius, String> {
    match text {
        "none" => Ok(Radius::None),
        _ => {
            occlusion_radius(text).map(Radius::Within).map_err(|error| format!("{error}, or none"))
        }
    }
}

/// Reads the radius of an ambient occlusion.
fn occlusion_radius(text: &str) -> Result<f32, String> {
    let radius: f32 = text.parse().map_err(|_| "a number above 0")?;
    match (AmbientOcclusion { radius }).fault() {
        Some(fault) => Err(fault),
        None => Ok(radius),
    }
}

/// Darkens corners and gaps or ends it, or says how it is.
pub(super) fn ambient_occlusion(arguments: &OcclusionArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    match arguments.radius {
        Some(Radius::None) => client.set_ambient_occlusion(None)?,
        Some(Radius::Within(radius)) => {
            client.set_ambient_occlusion(Some(AmbientOcclusion { radius }))?;
        }
        None => {}
    }
    match client.presentation()?.ambient_occlusion {
        Some(AmbientOcclusion { radius }) => {
            say(format_args!("ambient occlusion with a radius of {radius}"))
        }
        None => say("ambient occlusion none"),
    }?;
    seen::conclude(&client, arguments.radius.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_of_a_run_is_a_factor_or_automatic() {
        assert_eq!(brightness("2.5"), Ok(Brightness::Factor(2.5)));
        assert_eq!(brightness("auto"), Ok(Brightness::Automatic));
        for text in ["", "-1", "NaN", "bright"] {
            let error = brightness(text).expect_err(text);
            assert!(error.ends_with("or write auto"), "{error}");
        }
    }

    #[test]
    fn exposures_are_numbers_of_a_range_or_automatic() {
        for text in ["0", "-3.5", "+2", "64"] {
            assert!(matches!(wish(text), Ok(Exposure::Stops(_))), "{text}");
        }
        assert_eq!(wish("auto"), Ok(Exposure::Automatic));
        for text in ["", "Auto", "65", "NaN", "inf", "1EV"] {
            assert!(wish(text).is_err(), "{text}");
        }
    }
}
