//! `polyptych pick` and `query`: what of the open scene is where.

mod region;

use std::borrow::Cow;
use std::process::ExitCode;

use polyptych_client::glam::{DVec2, DVec3};
use polyptych_client::{NearestPoint, NearestQuery, Ray, RayHit, RayQuery};
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
    /// Say what stands between two points first, from the first one on
    Segment(SegmentArguments),
    /// Say what a point stands over, and how high: what is below it in the direction of −Y
    Ground(PointArguments),
    /// Say which point of the scene is nearest to a point
    Nearest(NearestArguments),
    /// List the nodes in a box along the axes, or around or outside it
    Box(region::BoxArguments),
    /// List the nodes in a sphere, or around or outside it
    Sphere(region::SphereArguments),
    /// List the nodes in a vertical prism over a polygon, or around or outside it
    Prism(region::PrismArguments),
    /// List the nodes that a rectangle of a plane screen shows, hidden by others or not
    Frustum(region::FrustumArguments),
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

#[derive(Debug, clap::Args)]
pub(super) struct SegmentArguments {
    /// Where it begins, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    from: DVec3,
    /// Where it ends: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    to: DVec3,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct PointArguments {
    /// The point, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    point: DVec3,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct NearestArguments {
    /// How far from the point at most, in world units [default: for ever]
    #[arg(long, value_name = "DISTANCE", value_parser = positive)]
    within: Option<f64>,
    #[command(flatten)]
    at: PointArguments,
}

fn pixel(text: &str) -> Result<DVec2, String> {
    numbers::<2>(text).map(DVec2::from_array)
}

pub(super) fn pick(arguments: &PickArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    conclude(client.pick(&arguments.screen, arguments.pixel)?.as_ref(), arguments.json)
}

pub(super) fn run(query: &Query) -> anyhow::Result<ExitCode> {
    match query {
        Query::Ray(arguments) => {
            let client = arguments.manager.connect()?;
            let ray = Ray { origin: arguments.origin, direction: arguments.direction };
            let hit =
                client.cast_ray(RayQuery { max_distance: arguments.max, ..RayQuery::new(ray) })?;
            conclude(hit.as_ref(), arguments.json)
        }
        Query::Segment(arguments) => {
            let client = arguments.manager.connect()?;
            let hit = client.first_between(arguments.from, arguments.to)?;
            conclude(hit.as_ref(), arguments.json)
        }
        Query::Ground(arguments) => {
            let hit = arguments.manager.connect()?.ground_below(arguments.point)?;
            conclude(hit.as_ref(), arguments.json)
        }
        Query::Nearest(NearestArguments { within, at }) => {
            let query = NearestQuery { point: at.point, within: *within };
            let nearest = at.manager.connect()?.nearest_point(query)?;
            conclude_nearest(nearest.as_ref(), at.json)
        }
        Query::Box(arguments) => arguments.run(),
        Query::Sphere(arguments) => arguments.run(),
        Query::Prism(arguments) => arguments.run(),
        Query::Frustum(arguments) => arguments.run(),
    }
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
    let name = shown_name(&hit.name);
    let side = if hit.is_front { "" } else { ", from behind" };
    let (node, distance) = (hit.node, hit.distance);
    say(format_args!("{node} {name} at {x:.6},{y:.6},{z:.6}, {distance:.6} away{side}"))?;
    Ok(ExitCode::SUCCESS)
}

fn conclude_nearest(nearest: Option<&NearestPoint>, is_json: bool) -> anyhow::Result<ExitCode> {
    match nearest {
        None if is_json => say(Value::Null)?,
        None => say("nothing")?,
        Some(NearestPoint { revision, node, name, position, distance }) if is_json => {
            let revision = revision.0;
            say(json!({
                "node": node.0,
                "name": name,
                "position": position,
                "distance": distance,
                "revision": revision,
            }))?;
        }
        Some(NearestPoint { node, name, position: DVec3 { x, y, z }, distance, .. }) => {
            let name = shown_name(name);
            say(format_args!("{node} {name} at {x:.6},{y:.6},{z:.6}, {distance:.6} away"))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A node's name as a line of text has it.
fn shown_name(name: &str) -> Cow<'_, str> {
    if name.is_empty() { "(no name)".into() } else { printable(name) }
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
