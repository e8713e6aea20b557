//! `polyptych eye` and `view`: where the viewer's head is, and cameras on parts of the wall.

use std::process::ExitCode;

use anyhow::{Context, bail};
use polyptych_client::glam::DVec3;
use polyptych_client::{Area, Camera, HeadPose, View, ViewProjection, Wall};

use polyptych_text::printable;

use super::remote::{field_of_view, numbers, point, positive};
use super::seen::show;
use super::stored_view::{self, GoArguments, NameArguments};
use super::{ManagerAddress, node, say};

#[derive(Debug, clap::Args)]
pub(super) struct EyeArguments {
    /// The middle between the eyes, in metres of display space: X,Y,Z [default: say where it is]
    #[arg(value_parser = point, allow_hyphen_values = true)]
    position: Option<DVec3>,
    /// What the head looks at, in metres of display space: X,Y,Z [default: along -Z]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    #[arg(requires = "position")]
    look: Option<DVec3>,
    /// From the left eye to the right one, in metres [default: as the wall file says]
    #[arg(long, value_name = "METRES", requires = "position", allow_hyphen_values = true)]
    separation: Option<f64>,
    /// Put it back to where the wall file has it
    #[arg(long, conflicts_with = "position")]
    reset: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn eye(arguments: &EyeArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let Some(position) = arguments.position else {
        if arguments.reset {
            client.set_head(client.wall()?.head())?;
            return show(&client);
        }
        say(in_words(&client.presentation()?.head))?;
        return Ok(ExitCode::SUCCESS);
    };
    let at_rest = client.wall()?.head();
    let rotation = match arguments.look {
        Some(target) if target == position => {
            bail!("the head is at {position} and cannot look at itself; look elsewhere")
        }
        Some(target) => Camera::look_at(position, target, DVec3::Y).rotation,
        None => at_rest.rotation,
    };
    let eye_separation_m = arguments.separation.unwrap_or(at_rest.eye_separation_m);
    client.set_head(HeadPose { position, rotation, eye_separation_m })?;
    show(&client)
}

fn in_words(head: &HeadPose) -> String {
    let ahead = head.rotation * DVec3::NEG_Z;
    let list = |v: DVec3| format!("{:.4},{:.4},{:.4}", v.x, v.y, v.z);
    format!(
        "the eyes are at {} m, {:.1} mm apart, and look along {}",
        list(head.position),
        head.eye_separation_m * 1e3,
        list(ahead)
    )
}

#[derive(Debug, clap::Args)]
pub(super) struct ViewArguments {
    #[command(subcommand)]
    what: ViewCommand,
}

#[derive(Debug, clap::Subcommand)]
enum ViewCommand {
    /// Lay a camera's picture over a part of the wall
    Add(AddArguments),
    /// Keep where the camera is under a name
    Save(NameArguments),
    /// Move the camera to where a stored view has it
    Go(GoArguments),
    /// Forget a stored view
    Remove(NameArguments),
    /// Say which views lie over the wall, and which places of the camera are stored
    List(ListArguments),
    /// Take all views away that lie over the wall
    Clear(ManagerAddress),
}

#[derive(Debug, clap::Args)]
struct ListArguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

#[derive(Debug, clap::Args)]
struct AddArguments {
    /// Where its camera stands, in world units: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    position: DVec3,
    /// What it looks at: X,Y,Z
    #[arg(value_parser = point, allow_hyphen_values = true)]
    target: DVec3,
    /// What is up: X,Y,Z
    #[arg(long, value_parser = point, allow_hyphen_values = true, default_value = "0,1,0")]
    up: DVec3,
    /// World units per metre of display space
    #[arg(long, default_value_t = 1.0, value_parser = positive, allow_hyphen_values = true)]
    scale: f64,
    /// The screen that it is on [default: the wall's only one, or all]
    #[arg(long, value_name = "NAME")]
    screen: Option<String>,
    /// Its pixels on that screen, from the upper left: X,Y,WIDTH,HEIGHT [default: all]
    #[arg(long, value_parser = rectangle, allow_hyphen_values = true)]
    rect: Option<[u32; 4]>,
    /// A plan in parallel rays, that shows so many metres from its lower to its upper edge
    #[arg(long, value_name = "METRES", conflicts_with = "fov")]
    #[arg(value_parser = positive, allow_hyphen_values = true)]
    ortho: Option<f64>,
    /// A camera's own picture, with this angle from its lower to its upper edge [default: what
    /// the viewer sees through the wall]
    #[arg(long, value_name = "DEGREES")]
    #[arg(value_parser = field_of_view, allow_hyphen_values = true)]
    fov: Option<f64>,
    /// Show only this node of the scene and what hangs from it, by its number or path
    #[arg(long, value_name = "NODE")]
    root: Option<String>,
    /// Show these layers and no others, whether the scene shows or hides them: NAME,NAME,…;
    /// what is in no layer is always shown [default: as `scene layer` says]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    layers: Option<Vec<String>>,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn view(arguments: &ViewArguments) -> anyhow::Result<ExitCode> {
    match &arguments.what {
        ViewCommand::Add(add) => {
            let client = add.manager.connect()?;
            let mut views = client.presentation()?.views;
            let mut view = add.view(&client.wall()?)?;
            if let Some(root) = &add.root {
                view.root = Some(node::find_node(&client, root)?.0);
            }
            views.push(view);
            client.set_views(views)?;
            show(&client)
        }
        ViewCommand::Save(arguments) => stored_view::save(arguments),
        ViewCommand::Go(arguments) => stored_view::go(arguments),
        ViewCommand::Remove(arguments) => stored_view::remove(arguments),
        ViewCommand::List(arguments) => list(arguments),
        ViewCommand::Clear(manager) => {
            let client = manager.connect()?;
            client.clear_views()?;
            show(&client)
        }
    }
}

fn list(arguments: &ListArguments) -> anyhow::Result<ExitCode> {
    let client = arguments.manager.connect()?;
    let (wall, views) = (client.wall()?, client.presentation()?.views);
    let stored = client.stored_views()?;
    if arguments.json {
        let stored: Vec<_> = stored.iter().map(stored_view::in_json).collect();
        say(serde_json::json!({ "overlays": views, "stored": stored }))?;
        return Ok(ExitCode::SUCCESS);
    }
    if views.is_empty() {
        say("there are no views: the wall shows its camera's picture")?;
    }
    views.iter().try_for_each(|view| say(line(view, &wall)))?;
    stored.iter().try_for_each(|view| say(stored_view::line(view)))?;
    Ok(ExitCode::SUCCESS)
}

impl AddArguments {
    fn view(&self, wall: &Wall) -> anyhow::Result<View> {
        if self.position == self.target {
            bail!("the camera stands at {} and cannot look at itself", self.position);
        }
        if self.up == DVec3::ZERO {
            bail!("--up 0,0,0 is no direction: name one, such as 0,1,0");
        }
        let projection = match (self.ortho, self.fov) {
            (Some(height_m), _) => ViewProjection::Orthographic { height_m },
            (None, Some(fov)) => ViewProjection::Perspective { fov_y_rad: fov.to_radians() },
            (None, None) => ViewProjection::Wall,
        };
        let camera = Camera::look_at(self.position, self.target, self.up).with_scale(self.scale);
        let named = |layers: &Vec<String>| {
            layers.iter().filter(|layer| !layer.is_empty()).cloned().collect()
        };
        let layers = self.layers.as_ref().map(named);
        Ok(View { projection, area: self.area(wall)?, layers, ..View::of_wall(camera) })
    }

    fn area(&self, wall: &Wall) -> anyhow::Result<Area> {
        let names = || wall.screens.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ");
        let index = match &self.screen {
            Some(name) => wall.screens.iter().position(|screen| screen.name == *name),
            None if self.rect.is_none() => return Ok(Area::Wall),
            None => (wall.screens.len() == 1).then_some(0),
        };
        let index = index.with_context(|| {
            let wanted = self.screen.as_deref().unwrap_or("");
            format!("--screen {wanted:?}: name one of the wall's screens: {}", names())
        })?;
        let canvas = wall.screens[index].canvas;
        let rect = self.rect.unwrap_or([0, 0, canvas.x, canvas.y]);
        Ok(Area::Screen { screen: u16::try_from(index)?, rect })
    }
}

fn line(view: &View, wall: &Wall) -> String {
    let area = match view.area {
        Area::Wall => "the wall".to_owned(),
        Area::Screen { screen, rect: [x, y, width, height] } => {
            let name = wall.screens.get(usize::from(screen)).map_or("?", |s| s.name.as_str());
            format!("{name} {x},{y},{width},{height}")
        }
    };
    let projection = match view.projection {
        ViewProjection::Wall => "as a window".to_owned(),
        ViewProjection::Perspective { fov_y_rad } => {
            format!("{:.4} degrees high", fov_y_rad.to_degrees())
        }
        ViewProjection::Orthographic { height_m } => format!("a plan {height_m:.4} m high"),
    };
    let DVec3 { x, y, z } = view.camera.position;
    let root = view.root.map_or_else(String::new, |root| format!(", only node {root}"));
    let layers = match view.layers.as_deref() {
        None => String::new(),
        Some([]) => ", no layers".to_owned(),
        Some(layers) => format!(", layers {}", printable(&layers.join(", "))),
    };
    format!("{area}: from {x:.4},{y:.4},{z:.4}, {projection}{root}{layers}")
}

fn rectangle(text: &str) -> Result<[u32; 4], String> {
    let rect = numbers::<4>(text)?;
    let is_pixels = |n: &f64| n.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(n);
    if !rect.iter().all(is_pixels) {
        return Err(format!("{text:?} is no rectangle of whole pixels: X,Y,WIDTH,HEIGHT"));
    }
    Ok(rect.map(|n| n as u32))
}
