//! `polyptych query box`, `sphere`, `prism` and `frustum`: which nodes are in a region.

use std::process::ExitCode;

use polyptych_client::blocking::Client;
use polyptych_client::glam::{DVec2, DVec3};
use polyptych_client::{Region, Relation};
use serde_json::Value;

use super::{pixel, shown_name};
use crate::cli::node::{node_in_json, query_for};
use crate::cli::remote::{numbers, point};
use crate::cli::{ManagerAddress, say};

#[derive(Debug, clap::Args)]
pub(crate) struct BoxArguments {
    /// Its lowest corner, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    min: DVec3,
    /// Its highest corner: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    max: DVec3,
    #[command(flatten)]
    wanted: Wanted,
}

#[derive(Debug, clap::Args)]
pub(crate) struct SphereArguments {
    /// Its centre, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    center: DVec3,
    /// Its radius, 0 or more
    #[arg(value_parser = number, allow_hyphen_values = true)]
    radius: f64,
    #[command(flatten)]
    wanted: Wanted,
}

#[derive(Debug, clap::Args)]
pub(crate) struct PrismArguments {
    /// The heights of its floor and its roof, in world units: LOW,HIGH
    #[arg(value_name = "LOW,HIGH", value_parser = pixel, allow_hyphen_values = true)]
    heights: DVec2,
    /// The corners of its polygon in order, at least three, in quotes: "X,Z X,Z X,Z"
    #[arg(value_name = "CORNERS", value_parser = corners, allow_hyphen_values = true)]
    polygon: Polygon,
    #[command(flatten)]
    wanted: Wanted,
}

/// The corners of a polygon, x and z.
#[derive(Clone, Debug)]
struct Polygon(Vec<DVec2>);

#[derive(Debug, clap::Args)]
pub(crate) struct FrustumArguments {
    /// The screen, by its name in the wall file
    screen: String,
    /// The upper left of the rectangle, in pixels from the screen's upper left: X,Y
    #[arg(value_name = "X,Y", value_parser = pixel)]
    begin: DVec2,
    /// The lower right of the rectangle: X,Y
    #[arg(value_name = "X,Y", value_parser = pixel)]
    end: DVec2,
    #[command(flatten)]
    wanted: Wanted,
}

/// Which nodes are listed, and how.
#[derive(Debug, clap::Args)]
struct Wanted {
    /// How the triangles of a node must lie to the region
    #[arg(long, value_enum, default_value_t = Lies::Touches)]
    relation: Lies,
    /// Only this node and what hangs from it, as of `node set`
    #[arg(long, value_name = "NODE")]
    below: Option<String>,
    /// Only nodes of this name
    #[arg(long)]
    name: Option<String>,
    /// Print JSON: all that is known of each node
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Lies {
    /// All of every triangle is in the region
    Inside,
    /// Some triangle has a point of the region
    Touches,
    /// The node's box along the axes has all of the region
    Contains,
    /// No triangle has a point of the region
    Disjoint,
}

impl From<Lies> for Relation {
    fn from(lies: Lies) -> Self {
        match lies {
            Lies::Inside => Self::Inside,
            Lies::Touches => Self::Touches,
            Lies::Contains => Self::Contains,
            Lies::Disjoint => Self::Disjoint,
        }
    }
}

impl BoxArguments {
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        self.wanted.list(|_| Ok(Region::Box { min: self.min, max: self.max }))
    }
}

impl SphereArguments {
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        self.wanted.list(|_| Ok(Region::Sphere { center: self.center, radius: self.radius }))
    }
}

impl PrismArguments {
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        let DVec2 { x: low, y: high } = self.heights;
        self.wanted.list(|_| Ok(Region::Prism { polygon: self.polygon.0.clone(), low, high }))
    }
}

impl FrustumArguments {
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        self.wanted.list(|client| Ok(client.pick_region(&self.screen, [self.begin, self.end])?))
    }
}

impl Wanted {
    fn list(
        &self,
        region: impl FnOnce(&Client) -> anyhow::Result<Region>,
    ) -> anyhow::Result<ExitCode> {
        let client = self.manager.connect()?;
        let query = query_for(&client, self.below.as_deref(), self.name.as_deref())?;
        let nodes = client.find_all_in_region(region(&client)?, self.relation.into(), query)?;
        if self.json {
            say(Value::Array(nodes.iter().map(node_in_json).collect()))?;
            return Ok(ExitCode::SUCCESS);
        }
        if nodes.is_empty() {
            say("nothing")?;
        }
        for node in &nodes {
            say(format_args!("{} {}", node.id, shown_name(&node.name)))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn corners(text: &str) -> Result<Polygon, String> {
    text.split_whitespace().map(pixel).collect::<Result<_, _>>().map(Polygon)
}

fn number(text: &str) -> Result<f64, String> {
    numbers::<1>(text).map(|[number]| number)
}
