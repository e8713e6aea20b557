//! `polyptych environment`, `exposure` and `tone`: the light of a running wall.

use polyptych_client::{EnvironmentSource, ToneMapper};
use polyptych_text::printable;

use super::remote::path_from_here;
use super::{ManagerAddress, say};

/// Limits of an exposure in stops: a factor of 2 to the power of this is far from all that a
/// picture can show, and from what f32 holds.
const STOPS_MAX: f64 = 64.0;

#[derive(Debug, clap::Args)]
pub(super) struct EnvironmentArguments {
    /// An equirectangular Radiance .hdr file in one of the manager's scene folders; "sky", a clear
    /// sky with the sun of the open scene; or "none", each scene's own sky. Without it, say which
    environment: Option<String>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// Surrounds scenes by light, or says by what they are surrounded.
pub(super) fn environment(arguments: &EnvironmentArguments) -> anyhow::Result<()> {
    let client = arguments.manager.connect()?;
    if let Some(asked) = &arguments.environment {
        let source = match asked.as_str() {
            "none" => EnvironmentSource::None,
            "sky" => EnvironmentSource::Sky,
            file => EnvironmentSource::File { path: path_from_here(file) },
        };
        client.set_environment(source)?;
    }
    match client.status()?.environment {
        Some(name) => say(format_args!("environment {}", printable(&name))),
        None => say("environment none: scenes have their own sky"),
    }
}

#[derive(Debug, clap::Args)]
pub(super) struct ExposureArguments {
    /// In stops: 1 is twice as bright as 0, and -1 half as bright; 0 shows a radiance of 1 as it
    /// is. Without it, say how it is
    #[arg(value_name = "EV", value_parser = stops, allow_negative_numbers = true)]
    stops: Option<f64>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// Sets the exposure, or says how it is.
pub(super) fn exposure(arguments: &ExposureArguments) -> anyhow::Result<()> {
    let client = arguments.manager.connect()?;
    if let Some(stops) = arguments.stops {
        client.set_exposure(stops.exp2() as f32)?;
    }
    let factor = client.presentation()?.exposure;
    say(format_args!("exposure {:.2} EV, a factor of {factor}", factor.log2()))
}

/// An exposure in stops, as an argument.
fn stops(text: &str) -> Result<f64, String> {
    let stops: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of stops"))?;
    let is_one = stops.abs() <= STOPS_MAX;
    is_one
        .then_some(stops)
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
pub(super) fn tone(arguments: &ToneArguments) -> anyhow::Result<()> {
    let client = arguments.manager.connect()?;
    if let Some(tone) = arguments.tone {
        client.set_tone(tone)?;
    }
    say(format_args!("tone {}", client.presentation()?.tone.name()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_are_numbers_of_a_range() {
        for text in ["0", "-3.5", "+2", "64"] {
            assert!(stops(text).is_ok(), "{text}");
        }
        for text in ["", "auto", "65", "NaN", "inf", "1EV"] {
            assert!(stops(text).is_err(), "{text}");
        }
    }
}
