//! `polyptych pick` and `query`: what of the open scene is where.

use std::process::ExitCode;

use polyptych_client::glam::{DVec2, DVec3};
use polyptych_client::{Ray, RayHit, RayQuery};
use polyptych_text::printable;
use serde_json::{Value, json};

use super::remote::{numbers, point, positive};
use super::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(super) struct PickArguments {
    /// The screen, by its name in the wall file
    screen: String,
    /// The place on it, in pixels from its upper left: X,Y
    #[arg(value_name = "X,Y", value_parser = pixel)]
    pixel: DVec2,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Subcommand)]
pub(super) enum Query {
    /// Say what a ray meets first, from either side
    Ray(RayArguments),
}

#[derive(Debug, clap::Args)]
pub(super) struct RayArguments {
    /// Where it begins, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    origin: DVec3,
    /// Where it goes; of any length but 0: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    direction: DVec3,
    /// How far, in world units [default: for ever]
    #[arg(long, value_name = "DISTANCE", value_parser = positive)]
    max: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

fn pixel(text: &str) -> Result<DVec2, String> {
    numbers::<2>(text).map(DVec2::from_array)
}

pub(super) fn pick(arguments: &PickArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    conclude(client.pick(&arguments.screen, arguments.pixel)?.as_ref(), arguments.json)
}

pub(super) fn run(query: &Query) -> anyhow::Result<ExitCode> {
    let Query::Ray(arguments) = query;
    let client = arguments.manager.connect()?;
    let ray = Ray { origin: arguments.origin, direction: arguments.direction };
    let hit = client.cast_ray(RayQuery { ray, max_distance: arguments.max })?;
    conclude(hit.as_ref(), arguments.json)
}

fn conclude(hit: Option<&RayHit>, is_json: bool) -> anyhow::Result<ExitCode> {
    if is_json {
        say(hit.map_or(Value::Null, in_json))?;
        return Ok(ExitCode::SUCCESS);
    }
    let Some(hit) = hit else {
        say("nothing")?;
        return Ok(ExitCode::SUCCESS);
    };
    let DVec3 { x, y, z } = hit.position;
    let name = if hit.name.is_empty() { "(no name)".into() } else { printable(&hit.name) };
    let side = if hit.is_front { "" } else { ", from behind" };
    let (node, distance) = (hit.node, hit.distance);
    say(format_args!("{node} {name} at {x:.6},{y:.6},{z:.6}, {distance:.6} away{side}"))?;
    Ok(ExitCode::SUCCESS)
}

fn in_json(hit: &RayHit) -> Value {
    json!({
        "node": hit.node.0,
        "name": hit.name,
        "position": hit.position,
        "normal": hit.normal,
        "distance": hit.distance,
        "is_front": hit.is_front,
        "material": hit.material,
        "revision": hit.revision.0,
    })
}
