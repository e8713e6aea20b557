//! `polyptych bound`: bounds the error and the rate of a running wall's pictures.

use std::process::ExitCode;

use polyptych_client::QualityBounds;

use super::{ManagerAddress, say, seen};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    bounds: BoundArguments,
    /// Take the rate bound away
    #[arg(long, conflicts_with = "rate")]
    no_rate: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

/// The bounds as arguments.
#[derive(Debug, clap::Args)]
struct BoundArguments {
    /// Draw coarser levels of detail where that moves no edge by more pixels of the wall than this;
    /// 0 draws everything at its finest
    #[arg(long, value_name = "PX", value_parser = error_px)]
    error: Option<f64>,
    /// Allow more error as long as the wall draws fewer frames per second than this
    #[arg(long, value_name = "FPS", value_parser = rate_fps)]
    rate: Option<f64>,
}

/// An error bound in pixels, as an argument.
pub(super) fn error_px(text: &str) -> Result<f64, String> {
    let error_px = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    QualityBounds { error_px, ..QualityBounds::FINEST }.validate().map(|()| error_px)
}

/// A rate bound in frames per second, as an argument.
pub(super) fn rate_fps(text: &str) -> Result<f64, String> {
    let rate = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    QualityBounds { rate_fps: Some(rate), ..QualityBounds::FINEST }.validate().map(|()| rate)
}

/// Sets the bounds that are given, keeps the others, and says which hold.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let before = client.presentation()?.bounds;
    let BoundArguments { error, rate } = arguments.bounds;
    let kept = if arguments.no_rate { None } else { before.rate_fps };
    let bounds =
        QualityBounds { error_px: error.unwrap_or(before.error_px), rate_fps: rate.or(kept) };
    if bounds != before {
        client.set_bounds(bounds)?;
    }
    let is_asked = error.is_some() || rate.is_some() || arguments.no_rate;
    let status = client.status()?;
    let (in_force_px, scale) = (status.error_in_force_px, status.resolution_scale);
    if arguments.json {
        let QualityBounds { error_px, rate_fps } = bounds;
        say(serde_json::json!({
            "error_bound_px": error_px,
            "rate_bound_fps": rate_fps,
            "error_in_force_px": in_force_px,
            "resolution_scale": scale,
        }))?;
        return seen::conclude(&client, is_asked);
    }
    let rate = match bounds.rate_fps {
        Some(rate) => format!("at least {rate} frames per second"),
        None => "any rate".to_owned(),
    };
    let resolution = if scale < 1.0 {
        format!(", {:.0} % of the pixels along each side", 100.0 * scale)
    } else {
        String::new()
    };
    say(format_args!(
        "an error of at most {} pixels, {rate}; in force: {in_force_px:.2} pixels{resolution}",
        bounds.error_px
    ))?;
    seen::conclude(&client, is_asked)
}

#[cfg(test)]
mod tests {
    use super::{error_px, rate_fps};

    #[test]
    fn bounds_out_of_range_are_refused_in_the_words_of_the_manager() {
        assert_eq!((error_px("0"), error_px("64")), (Ok(0.0), Ok(64.0)));
        for number in ["NaN", "-1", "inf", "65"] {
            let words = format!("an error bound is 0 to 64 pixels, not {number}");
            assert_eq!(error_px(number), Err(words));
        }
        assert_eq!((rate_fps("1"), rate_fps("1e3")), (Ok(1.0), Ok(1000.0)));
        for number in ["NaN", "0", "-1", "inf", "1000000000"] {
            let words = format!("a rate bound is 1 to 1000 frames per second, not {number}");
            assert_eq!(rate_fps(number), Err(words));
        }
        assert_eq!(error_px("two"), Err("\"two\" is not a number".to_owned()));
    }
}
