//! `polyptych depth-of-field`: what is nearer or farther than a distance is blurred.

use std::process::ExitCode;

use polyptych_client::DepthOfField;

use super::{ManagerAddress, say, seen};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// What is at this distance from the eye is sharp, in world units; above 0. With a comma, the
    /// width of the lens too, else it is a fiftieth of that. Or "none". Without it, say how it is
    #[arg(value_name = "FOCUS[,APERTURE]|none", value_parser = wish)]
    focus: Option<Wish>,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// A depth of field that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wish {
    None,
    Lens(DepthOfField),
}

fn wish(text: &str) -> Result<Wish, String> {
    match text {
        "none" => Ok(Wish::None),
        _ => focus(text).map(Wish::Lens).map_err(|error| format!("{error}, or none")),
    }
}

/// Reads a distance that is sharp, and the width of the lens if it follows.
pub(super) fn focus(text: &str) -> Result<DepthOfField, String> {
    let number = |text: &str| text.trim().parse::<f32>().map_err(|_| "a number above 0".to_owned());
    let wanted = match text.split_once(',') {
        Some((focus, aperture)) => {
            DepthOfField { focus: number(focus)?, aperture: number(aperture)? }
        }
        None => DepthOfField::new(number(text)?),
    };
    match wanted.fault() {
        Some(fault) => Err(fault),
        None => Ok(wanted),
    }
}

/// Blurs what is not at a distance or ends it, or says how it is.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    match arguments.focus {
        Some(Wish::None) => client.set_depth_of_field(None)?,
        Some(Wish::Lens(wanted)) => client.set_depth_of_field(Some(wanted))?,
        None => {}
    }
    match client.presentation()?.depth_of_field {
        Some(DepthOfField { focus, aperture }) => {
            say(format_args!("depth of field with a focus at {focus}, an aperture of {aperture}"))
        }
        None => say("depth of field none"),
    }?;
    seen::conclude(&client, arguments.focus.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_a_distance_and_the_width_of_the_lens() {
        assert_eq!(focus("12"), Ok(DepthOfField { focus: 12.0, aperture: 0.24 }));
        assert_eq!(focus("12, 0.5"), Ok(DepthOfField { focus: 12.0, aperture: 0.5 }));
        assert_eq!(wish("none"), Ok(Wish::None));
        for (text, fault) in [("0", "focus"), ("5,0", "aperture"), ("-1", "focus"), ("5,", "above")]
        {
            let error = wish(text).expect_err("refused");
            assert!(error.contains(fault) && error.ends_with("or none"), "{text}: {error}");
        }
    }
}
