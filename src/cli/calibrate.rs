//! `polyptych tune`: adjusts a channel of a running wall.

mod key;

use std::process::ExitCode;

use anyhow::bail;
use polyptych_client::Wall;
use polyptych_client::calibration_change::{CalibrationChange, Corner, Edge};
use polyptych_text::counted;
use polyptych_wall::TransferFunction;

use super::seen::Seen;
use super::{ManagerAddress, say};

/// A sign makes a move relative to where the point is; without one, or with "@" before the
/// numbers, it is from where the point was drawn.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Its name in the wall file
    channel: String,
    /// pin.upper-left=+1.5,-0.5 (a sign: further; none, or "@-3,2": from where it was drawn; in
    /// pixels, right and down), bend=5x5, bend.COLUMN.ROW=+0.5,0, bend=off, gain=1,0.9,1,
    /// gamma=2.2 or srgb, leak=0.003 or auto, matrix=1,0,0,0,1,0,0,0,1, edge.left=120 or auto
    #[arg(
        value_name = "KEY=VALUE",
        required_unless_present = "show",
        conflicts_with = "show",
        value_parser = key::change
    )]
    changes: Vec<CalibrationChange>,
    /// Print what the channel's adjustment is now, as changes that lead to it
    #[arg(long)]
    show: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    if arguments.show {
        show(&client.wall()?, &arguments.channel)?;
        return Ok(ExitCode::SUCCESS);
    }
    let tuned = client.calibrate(arguments.channel.as_str(), arguments.changes.clone())?;
    let seen = Seen::of(&client, &tuned.feedback)?;
    say(format_args!(
        "{} is tuned: revision {}, {}, {} after the request",
        arguments.channel,
        tuned.revision,
        seen.in_words(),
        counted(tuned.frames, "frame")
    ))?;
    Ok(seen.conclude())
}

fn show(wall: &Wall, name: &str) -> anyhow::Result<()> {
    let Some((_, channel)) = wall.channel_by_name(name) else {
        let names: Vec<_> = wall.channels.iter().map(|channel| channel.name.as_str()).collect();
        bail!("this wall has no channel {name:?}; it has {}", names.join(", "));
    };
    let adjustment = &channel.adjustment;
    for (corner, pin) in Corner::ALL.iter().zip(adjustment.pin) {
        say(format_args!("pin.{}=@{},{}", corner.name(), pin.x, pin.y))?;
    }
    match &adjustment.bend {
        None => say("bend=off")?,
        Some(bend) => {
            say(format_args!("bend={}x{}", bend.points.x, bend.points.y))?;
            for (at, to) in (0..).zip(bend.moves.iter()) {
                let (column, row) = (at % bend.points.x, at / bend.points.x);
                say(format_args!("bend.{column}.{row}=@{},{}", to.x, to.y))?;
            }
        }
    }
    let list =
        |numbers: &[f64]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
    let color = &adjustment.color;
    say(format_args!("matrix={}", list(&color.matrix.transpose().to_cols_array())))?;
    say(format_args!("gain={}", list(&color.gain.to_array())))?;
    match &color.curve {
        TransferFunction::Srgb => say("gamma=srgb")?,
        TransferFunction::Gamma(gamma) => say(format_args!("gamma={}", list(&gamma.to_array())))?,
        TransferFunction::Measured(points) => {
            let points = counted(points.len(), "point");
            say(format_args!("# a measured curve of {points}; gamma= replaces it"))?;
        }
    }
    let leak = color.leak.map_or_else(|| "auto".into(), |leak| list(&leak.to_array()));
    say(format_args!("leak={leak}"))?;
    let edges = &adjustment.edges;
    for (side, width) in Edge::ALL.iter().zip([edges.left, edges.right, edges.top, edges.bottom]) {
        let width = width.map_or_else(|| "auto".into(), |width| width.to_string());
        say(format_args!("edge.{}={width}", side.name()))?;
    }
    Ok(())
}
