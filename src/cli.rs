//! The commands, one file each.

mod address;
mod animation;
mod bake;
mod bake_arguments;
mod bench;
mod bound;
mod calibrate;
mod camera;
mod check;
mod completions;
mod demo;
mod depth_of_field;
mod devices;
mod displays;
mod examples;
mod film;
mod gallery;
mod http;
mod keys;
mod login;
mod manager;
mod negative_numbers;
mod node;
mod pattern;
mod progress;
mod query;
mod remote;
mod replay;
mod rest;
mod scene;
mod seen;
mod server;
mod session;
pub(crate) mod shutdown_signal;
mod simulate;
mod status;
mod stop;
mod stored_view;
mod surroundings;
mod tour;
mod unit;
mod up;
mod variant;
mod verify;
mod viewer;
mod wall;
mod watch;

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use polyptych_client::blocking::Client;
use polyptych_client::{OutputMode, ReconnectPolicy};
use polyptych_files::blob::BlobStore;
use polyptych_manager::import::{Baker, bake_wall_files, read_wall_files};
use polyptych_text::printable;
use polyptych_wall::Wall;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::limits::PORT_DEFAULT;
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};

use crate::logging::{self, LogOptions};
use negative_numbers::with_negative_numbers;

/// One scene, many displays, one frame.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, after_help = seen::EXIT_CODES)]
pub(crate) struct Cli {
    /// How and what to log: "json" or "text", a filter such as "info" or
    /// "polyptych_render=debug", or both with a comma [default: text, and info for manager and
    /// server, else warn]
    #[arg(long, global = true, env = "POLYPTYCH_LOG", value_name = "LOG")]
    #[arg(help_heading = "Options of every command", display_order = 1000)]
    #[arg(value_parser = LogOptions::parse)]
    log: Option<LogOptions>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show a wall of four displays with a generated scene on this machine
    Demo(demo::Arguments),
    /// Run a whole wall on this machine: a manager, and a process for each server
    Simulate(simulate::Arguments),
    /// Run the manager of a wall
    Manager(manager::Arguments),
    /// Run a render server, which draws one or more channels of a wall
    Server(server::Arguments),
    /// Start all processes of a wall on their machines by ssh, keep them running, and end them
    Up(up::Arguments),
    /// Write files with which systemd, Slurm, Kubernetes or containers run a wall
    Unit(unit::Arguments),
    /// Show a scene on a running wall
    Open(remote::OpenArguments),
    /// Move the camera of a running wall
    #[command(subcommand)]
    Camera(camera::CameraCommand),
    /// Say where the viewer's eyes are, or move them
    Eye(viewer::EyeArguments),
    /// Keep places of the camera, or lay other cameras' pictures and plans over parts of the wall
    View(viewer::ViewArguments),
    /// Move the camera of a running wall through stops
    #[command(subcommand)]
    Tour(tour::TourCommand),
    /// Play, hold or list the animations of the open scene
    #[command(subcommand)]
    Animation(animation::AnimationCommand),
    /// Save the picture of a running wall
    Shot(remote::ShotArguments),
    /// Save frames of a running wall at equal steps of scene time
    Film(film::FilmArguments),
    /// Make one sheet of pictures of many models
    Gallery(gallery::Arguments),
    /// Let every display say over its picture which one it is
    Identify(displays::Arguments),
    /// Make every display black
    Blank(displays::Arguments),
    /// Let every display keep what it shows
    Freeze(displays::Arguments),
    /// Let displays go dark by themselves, or say when they do
    Rest(rest::Arguments),
    /// Let every channel draw a test pattern
    Pattern(pattern::Arguments),
    /// Adjust a channel of a running wall: corners, bend, light, blends
    Tune(calibrate::Arguments),
    /// Bound the error and the rate of a running wall's pictures, or say how they are bounded
    Bound(bound::Arguments),
    /// Surround scenes by the light of a picture or of a clear sky, or say by what
    Environment(surroundings::EnvironmentArguments),
    /// Set the exposure of a running wall, or say how it is
    Exposure(surroundings::ExposureArguments),
    /// Set how a running wall's light becomes what displays show, or say how
    Tone(surroundings::ToneArguments),
    /// Lay fog over what cameras see
    Fog(surroundings::FogArguments),
    /// Spread light around what is bright
    Glow(surroundings::GlowArguments),
    /// Darken corners and gaps, which get less of the light from all around
    AmbientOcclusion(surroundings::OcclusionArguments),
    /// Blur what is nearer or farther than a distance
    DepthOfField(depth_of_field::Arguments),
    /// Show a variant of the open scene, or list those of its file
    Variant(variant::Arguments),
    /// Say how a running wall stands
    Status(status::Arguments),
    /// Read the trackers, wands and pads of a wall file, and move head and camera of its wall
    Devices(devices::Arguments),
    /// End the manager of a running wall, and its servers if asked to
    Stop(stop::Arguments),
    /// Print a link with which a browser may command a running wall, or the token of programs
    Login(login::Arguments),
    /// Make the keys of a wall: an authority, and a key for each node
    Keys(keys::Arguments),
    /// Say what a wall file describes, or what is wrong with it
    Check(check::Arguments),
    /// Prove in numbers that a wall shows every pixel in its place
    Prove(verify::Arguments),
    /// Make a wall file
    #[command(subcommand)]
    Wall(wall::WallCommand),
    /// Decide again what a recorded manager decided, and say what happened
    Replay(replay::Arguments),
    /// Say what of the open scene a pixel of the wall shows
    Pick(query::PickArguments),
    /// Ask what of the open scene is where
    #[command(subcommand)]
    Query(query::Query),
    /// Generate a scene, list the open one, or close it
    #[command(subcommand)]
    Scene(scene::Scene),
    /// Save all that the wall shows under a name, and open it again
    #[command(subcommand)]
    Session(session::Session),
    /// Change a node of the open scene
    #[command(subcommand)]
    Node(node::NodeCommand),
    /// Change the open scene by a file of operations: all of them, or nothing
    Transaction(node::TransactionArguments),
    /// Turn a glTF file into the blobs that servers read
    Bake(bake::Arguments),
    /// Report what frames of scenes cost at each error bound, and how far their pictures are off
    Bench(bench::Arguments),
    /// Print a script with which a shell completes this command
    Completions(completions::CompletionArguments),
    /// Write manual pages of all commands
    Man(completions::ManArguments),
}

/// The variable that names the manager's address, for clients and servers.
const MANAGER_VARIABLE: &str = "POLYPTYCH_MANAGER";

/// Where a running manager is.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ManagerAddress {
    /// The manager's address; with a standby the addresses of all managers, separated by commas
    #[arg(
        long,
        value_name = "ADDR",
        env = MANAGER_VARIABLE,
        value_parser = address::addresses,
        default_value_t = format!("127.0.0.1:{PORT_DEFAULT}")
    )]
    manager: String,
    /// The file with the manager's token [default: where the manager of this user puts it]
    #[arg(long, value_name = "FILE", env = polyptych_protocol::token::TOKEN_FILE_VARIABLE)]
    token_file: Option<PathBuf>,
    /// This client's folder of keys, as `polyptych keys` makes it
    #[arg(long, value_name = "FOLDER", env = polyptych_client::KEYS_VARIABLE)]
    keys: Option<PathBuf>,
    /// Go over a network without keys, though nothing is encrypted
    #[arg(long)]
    insecure: bool,
}

impl ManagerAddress {
    /// A command asks once: where the connection is lost, it says so at once.
    fn connect(&self) -> anyhow::Result<Client> {
        self.connect_for(None)
    }

    /// Connects for a command that goes on once the manager is there again.
    fn connect_for(&self, reconnect: Option<ReconnectPolicy>) -> anyhow::Result<Client> {
        Ok(Client::connect_with(self.options(reconnect))?)
    }

    fn options(&self, reconnect: Option<ReconnectPolicy>) -> polyptych_client::ConnectOptions {
        let mut options = polyptych_client::ConnectOptions::new(self.manager.as_str());
        options.token_file.clone_from(&self.token_file);
        options.reconnect = reconnect;
        options.keys.clone_from(&self.keys);
        options.insecure = self.insecure;
        options
    }
}

impl Cli {
    /// Returns the kind of this process, for readers of several logs.
    pub fn process(&self) -> &'static str {
        match self.command {
            Command::Demo(_) | Command::Simulate(_) => "simulate",
            Command::Manager(_) => "manager",
            Command::Server(_) => "server",
            Command::Bake(_) => "bake",
            Command::Up(_) => "up",
            _ => "polyptych",
        }
    }
}

/// The command as its help, manual and completions describe it.
fn command() -> clap::Command {
    examples::with_examples(with_negative_numbers(Cli::command()))
}

/// The arguments of this process; ends it with a message if they are wrong.
pub(crate) fn parse() -> Cli {
    let parsed = Cli::from_arg_matches(&command().get_matches());
    parsed.unwrap_or_else(|error| error.exit())
}

/// Checks arguments of the command without running it.
///
/// # Errors
/// The message of this program about them, in one line.
pub(crate) fn check_command_line(arguments: &[String]) -> Result<(), String> {
    let words = std::iter::once("polyptych").chain(arguments.iter().map(String::as_str));
    let Err(error) = command().try_get_matches_from(words) else { return Ok(()) };
    let text = error.to_string();
    let said = text.split("\n\nUsage").next().unwrap_or_default();
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    Err(said.trim_start_matches("error: ").to_owned())
}

pub(crate) fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    let done = match cli.command {
        Command::Demo(arguments) => return demo::run(&arguments),
        Command::Simulate(arguments) => return simulate::run(&arguments),
        Command::Manager(arguments) => manager::run(&arguments),
        Command::Server(arguments) => server::run(arguments),
        Command::Up(arguments) => up::run(&arguments),
        Command::Unit(arguments) => unit::run(&arguments),
        Command::Open(arguments) => return remote::open(&arguments),
        Command::Camera(command) => return camera::run(&command),
        Command::Eye(arguments) => return viewer::eye(&arguments),
        Command::View(arguments) => return viewer::view(&arguments),
        Command::Tour(command) => return tour::run(&command),
        Command::Animation(command) => return animation::run(&command),
        Command::Shot(arguments) => return remote::capture(&arguments),
        Command::Film(arguments) => return film::film(&arguments),
        Command::Gallery(arguments) => return gallery::run(&arguments),
        Command::Identify(arguments) => return displays::run(OutputMode::Identify, &arguments),
        Command::Blank(arguments) => return displays::run(OutputMode::Blank, &arguments),
        Command::Freeze(arguments) => return displays::run(OutputMode::Freeze, &arguments),
        Command::Rest(arguments) => rest::run(&arguments),
        Command::Pattern(arguments) => return pattern::run(&arguments),
        Command::Tune(arguments) => return calibrate::run(&arguments),
        Command::Bound(arguments) => return bound::run(&arguments),
        Command::Environment(arguments) => return surroundings::environment(&arguments),
        Command::Exposure(arguments) => return surroundings::exposure(&arguments),
        Command::Tone(arguments) => return surroundings::tone(&arguments),
        Command::Fog(arguments) => return surroundings::fog(&arguments),
        Command::Glow(arguments) => return surroundings::glow(&arguments),
        Command::AmbientOcclusion(arguments) => return surroundings::ambient_occlusion(&arguments),
        Command::DepthOfField(arguments) => return depth_of_field::run(&arguments),
        Command::Variant(arguments) => return variant::run(&arguments),
        Command::Status(arguments) => status::run(&arguments),
        Command::Devices(arguments) => devices::run(&arguments),
        Command::Stop(arguments) => stop::run(&arguments),
        Command::Login(arguments) => login::run(&arguments),
        Command::Keys(arguments) => keys::run(&arguments),
        Command::Check(arguments) => return check::run(&arguments),
        Command::Prove(arguments) => return verify::run(&arguments),
        Command::Wall(wall) => return wall::run(&wall),
        Command::Replay(arguments) => return replay::run(&arguments),
        Command::Scene(scene) => return scene::run(&scene),
        Command::Session(session) => return session::run(&session),
        Command::Pick(arguments) => return query::pick(&arguments),
        Command::Query(query) => return query::run(&query),
        Command::Node(command) => return node::run(&command),
        Command::Transaction(arguments) => return node::transaction(&arguments),
        Command::Bake(arguments) => bake::run(&arguments),
        Command::Bench(arguments) => return bench::run(&arguments),
        Command::Completions(arguments) => completions::completions(&arguments),
        Command::Man(arguments) => completions::man(&arguments),
    };
    done.map(|()| ExitCode::SUCCESS)
}

/// Logs go to standard error; what a command is asked for goes to standard output.
pub(crate) fn start_log(cli: &Cli) {
    let level = match cli.command {
        Command::Manager(_) | Command::Server(_) => "info",
        // What its own manager would warn of, the command says itself.
        Command::Simulate(_) | Command::Demo(_) | Command::Bench(_) | Command::Gallery(_) => {
            "warn,polyptych_core=error,polyptych_manager=error"
        }
        // Its core would warn of what happened long ago.
        Command::Replay(_) => "warn,polyptych_core=off,polyptych_manager=off",
        _ => "warn",
    };
    logging::start(cli.log.as_ref(), level, cli.process());
}

/// Writes a line to standard output. A reader that has seen enough, such as `head`, is no error.
fn say(line: impl Display) -> anyhow::Result<()> {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write to standard output"),
    }
}

/// Returns the error with its causes in one line. It may quote files and peers, so control
/// characters are made printable: they could move a terminal's cursor or begin lines of their own.
pub(crate) fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Many an error names its cause already.
        if !line.contains(&cause) {
            let separator = if line.is_empty() { "" } else { ": " };
            line.push_str(separator);
            line.push_str(&cause);
        }
    }
    printable(&line).into_owned()
}

/// The calibration files of a wall, as read.
#[derive(Default)]
struct WallFiles {
    maps: CalibrationMaps,
    shapes: WallGeometry,
    /// Warnings about values that work, but may not be intended.
    warnings: Vec<String>,
}

/// Has the files of a wall baked, and makes sure that servers can draw what they place.
fn bake_files(wall: &mut Wall, path: &Path, baker: &Baker) -> anyhow::Result<WallFiles> {
    if wall.files.is_empty() {
        return Ok(WallFiles::default());
    }
    let about = |reason: String| anyhow!("{}: {reason}", path.display());
    let folder = path.parent().unwrap_or(Path::new(""));
    let warnings = bake_wall_files(wall, folder, baker).map_err(about)?;
    let maps = read_wall_files(wall, &BlobStore::new(baker.store.join("blobs")));
    let maps = maps.map_err(about)?;
    let shapes = WallGeometry::new(wall, &maps);
    ResolvedWall { wall, shapes: &shapes }.check_files(&maps).map_err(about)?;
    Ok(WallFiles { maps, shapes, warnings })
}

/// Logs what may not be meant of the files of a wall that is about to run.
fn log_file_warnings(files: &WallFiles) {
    for warning in &files.warnings {
        logging::say_warning(warning);
    }
}

fn load_wall(path: &Path) -> anyhow::Result<Wall> {
    // The error begins with the file, line and key.
    polyptych_wall_file::load(path).map_err(|error| anyhow!("{error}"))
}

/// The folder in which this user's caches lie.
fn cache_folder() -> anyhow::Result<PathBuf> {
    let from = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let cache = from("XDG_CACHE_HOME").or_else(|| from("HOME").map(|home| home.join(".cache")));
    cache
        .map(|folder| folder.join("polyptych"))
        .context("neither XDG_CACHE_HOME nor HOME says where caches lie; name a folder")
}

/// A positive number of seconds, as an argument.
fn seconds(text: &str) -> Result<Duration, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number of seconds"))?;
    Duration::try_from_secs_f64(number)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| format!("{text} is not a positive number of seconds"))
}

/// A rate in frames per second, as an argument.
fn rate(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    let is_rate = (0.01..=1000.0).contains(&number);
    is_rate.then_some(number).ok_or_else(|| format!("{text} is not within 0.01 to 1000"))
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    #[test]
    fn an_error_is_one_line_that_names_each_cause_once() {
        let error =
            anyhow!("no room").context("b.bin: no room").context("cannot open a\u{1b}[1m\nb");
        assert_eq!(one_line(&error), "cannot open a\\u{1b}[1m\\nb: b.bin: no room");
    }
}
