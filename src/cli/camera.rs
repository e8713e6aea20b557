//! `polyptych camera`: where the camera of a running wall is, and how it moves.

mod author;

use std::process::ExitCode;

use anyhow::bail;
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DQuat, DVec3};
use polyptych_client::{Camera, Follow, Touched, Tour, WalkEnd, WalkQuery, WalkedWay, Walker};
use polyptych_text::printable;
use serde_json::json;

use super::node::node_by_name;
use super::remote::{numbers, point, positive};
use super::seen::{conclude, show};
use super::stored_view::TOUR_PACE;
use super::{ManagerAddress, say};

#[derive(Debug, clap::Subcommand)]
pub(super) enum CameraCommand {
    /// Stand at a point and look at another
    LookAt {
        /// Where to stand, in world units: X,Y,Z
        #[arg(value_parser = point, allow_hyphen_values = true)]
        position: DVec3,
        /// What to look at: X,Y,Z
        #[arg(value_parser = point, allow_hyphen_values = true)]
        target: DVec3,
        /// What is up: X,Y,Z
        #[arg(long, value_parser = point, allow_hyphen_values = true, default_value = "0,1,0")]
        up: DVec3,
        /// World units per metre of display space
        #[arg(long, default_value_t = 1.0)]
        scale: f64,
        #[command(flatten)]
        manager: ManagerAddress,
    },
    /// Stand at a point with a rotation
    Pose {
        /// Where to stand, in world units: X,Y,Z
        #[arg(value_parser = point, allow_hyphen_values = true)]
        position: DVec3,
        /// A unit quaternion: X,Y,Z,W
        #[arg(value_parser = quaternion, allow_hyphen_values = true)]
        rotation: DQuat,
        /// World units per metre of display space
        #[arg(long, default_value_t = 1.0)]
        scale: f64,
        #[command(flatten)]
        manager: ManagerAddress,
    },
    /// Walk over the ground to a point, or through several, up to what stands in the way
    Walk(WalkArguments),
    /// Move with a node of the scene, until the camera is placed otherwise
    Follow(FollowArguments),
    /// Stand where a camera of the scene's author stands, until the camera is placed otherwise
    Author(author::AuthorArguments),
    /// List the cameras of the scene's author
    List(author::ListArguments),
    /// Stay where the camera is: ends a walk, a tour, and the following of a node
    Stay {
        #[command(flatten)]
        manager: ManagerAddress,
    },
}

#[derive(Debug, clap::Args)]
pub(super) struct WalkArguments {
    /// Where to go, in world units: X,Y,Z; above ground Y does not count
    #[arg(value_parser = point, allow_hyphen_values = true)]
    goal: DVec3,
    /// Go there first; may be given several times
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    via: Vec<DVec3>,
    /// Height of the eye above the ground
    #[arg(long, value_name = "UNITS", value_parser = positive, default_value_t = 1.7)]
    eye_height: f64,
    /// Fly straight, instead of keeping a height above the ground
    #[arg(long, conflicts_with_all = ["eye_height", "step"])]
    fly: bool,
    /// Distance that is kept from everything
    #[arg(long, value_name = "UNITS", value_parser = positive, default_value_t = 0.3)]
    radius: f64,
    /// Pass through walls
    #[arg(long, conflicts_with = "radius")]
    through: bool,
    /// Highest step that is taken, up or down
    #[arg(long, value_name = "UNITS", value_parser = positive, default_value_t = 0.4)]
    step: f64,
    /// World units in a second
    #[arg(long, value_name = "UNITS", value_parser = positive, default_value_t = 1.4)]
    speed: f64,
    /// Look where the way goes, level, instead of as before
    #[arg(long)]
    ahead: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
pub(super) struct FollowArguments {
    /// The node, by its number, its path such as /harbour/boat, or the end of its path
    node: String,
    /// Turn with the node, instead of keeping the directions of the world
    #[arg(long)]
    turning: bool,
    /// Where to stand, from the node's origin, looking at it [default: as the camera is now]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    from: Option<DVec3>,
    /// Go around it by so many degrees in a second, counterclockwise as seen from above
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    orbit: f64,
    #[command(flatten)]
    manager: ManagerAddress,
}

fn quaternion(text: &str) -> Result<DQuat, String> {
    numbers::<4>(text).map(DQuat::from_array)
}

pub(super) fn run(command: &CameraCommand) -> anyhow::Result<ExitCode> {
    let (camera, manager) = match command {
        CameraCommand::LookAt { position, target, .. } if position == target => {
            bail!("the camera stands at {position} and cannot look at itself; look elsewhere");
        }
        CameraCommand::LookAt { position, target, up, scale, manager } => {
            (Camera::look_at(*position, *target, *up).with_scale(*scale), manager)
        }
        CameraCommand::Pose { position, rotation, scale, manager } => {
            (Camera { position: *position, rotation: *rotation, scale: *scale }, manager)
        }
        CameraCommand::Walk(arguments) => return walk(arguments),
        CameraCommand::Follow(arguments) => return follow(arguments),
        CameraCommand::Author(arguments) => return author::author(arguments),
        CameraCommand::List(arguments) => return author::list(arguments),
        CameraCommand::Stay { manager } => {
            let client = manager.connect()?;
            client.stop_tour()?;
            return show(&client);
        }
    };
    let client = manager.connect()?;
    // Set for good, and not for one frame only: a manager remembers it over a restart.
    client.set_camera(camera)?;
    show(&client)
}

fn follow(arguments: &FollowArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let node = node_by_name(&client, &arguments.node)?;
    let scale = client.presentation()?.camera.scale;
    let camera = match arguments.from {
        Some(DVec3::ZERO) => bail!("--from 0,0,0 is the node itself; stand away from it"),
        Some(from) => {
            let eye = client.wall()?.eye;
            let camera = Camera::look_at(from, DVec3::ZERO, DVec3::Y).with_scale(scale);
            Some(camera.with_eye_at(eye, from))
        }
        None => None,
    };
    let orbit_rad_per_s = arguments.orbit.to_radians();
    client.follow_node(Follow { node, camera, is_turning: arguments.turning, orbit_rad_per_s })?;
    if client.tour()?.pace.is_none() && arguments.orbit != 0.0 {
        client.start_rendering(TOUR_PACE)?;
    }
    show(&client)
}

fn walk(arguments: &WalkArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let (eye, camera) = (client.wall()?.eye, client.presentation()?.camera);
    let mut way = vec![camera.world_from_display(eye)];
    way.extend(arguments.via.iter().chain([&arguments.goal]));
    let walker = Walker {
        eye_height: (!arguments.fly).then_some(arguments.eye_height),
        radius: (!arguments.through).then_some(arguments.radius),
        step_height: if arguments.fly { 0.0 } else { arguments.step.min(arguments.eye_height) },
    };
    let found = client.find_way(WalkQuery { way, walker })?;
    let (length, end) = (found.length(), in_words(&found.end));
    if found.points.len() < 2 && found.end != WalkEnd::Arrived {
        bail!("the camera cannot go there: {end}");
    }
    play(&client, arguments, &found, camera, eye)?;
    if arguments.json {
        let seconds = length / arguments.speed;
        say(json!({ "length": length, "seconds": seconds, "points": found.points, "end": end }))?;
    } else {
        say(format_args!("{length:.2} units, {:.1} s: {end}", length / arguments.speed))?;
    }
    conclude(&client, true)
}

/// Lets the camera go a way; a wall that is paused runs from now on.
fn play(
    client: &Client,
    arguments: &WalkArguments,
    way: &WalkedWay,
    camera: Camera,
    eye: DVec3,
) -> anyhow::Result<()> {
    let mut tour = Tour::along(camera, eye, &way.points, arguments.speed);
    if arguments.ahead {
        tour = tour.looking_ahead(eye);
    }
    client.play_tour(tour)?;
    if client.tour()?.pace.is_none() {
        client.start_rendering(TOUR_PACE)?;
    }
    Ok(())
}

fn in_words(end: &WalkEnd) -> String {
    let at = |touched: &Touched| {
        let DVec3 { x, y, z } = touched.position;
        let name = printable(&touched.name);
        let name = if name.is_empty() { String::new() } else { format!(" ({name})") };
        format!("{}{name} at {x:.2},{y:.2},{z:.2}", touched.node)
    };
    match end {
        WalkEnd::Arrived => "arrives".to_owned(),
        WalkEnd::Obstacle(touched) => format!("stops before {}", at(touched)),
        WalkEnd::Rise(touched) => format!("stops where the ground rises: {}", at(touched)),
        WalkEnd::Fall(touched) => format!("stops where the ground falls: {}", at(touched)),
        WalkEnd::NoGround => "stops where there is no ground".to_owned(),
    }
}
