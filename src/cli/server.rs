//! `polyptych server`: draws channels of a wall.

use std::collections::BTreeMap;
use std::net::ToSocketAddrs;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{anyhow, bail};
use clap::builder::NonEmptyStringValueParser;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_protocol::stream::check_addresses;
use polyptych_protocol::token;
use polyptych_render::{
    OutputKind, PRESENT_DELAY_MAX, ServerError, ServerOptions, TokenSource, gpus, monitors,
    run as run_server,
};
use polyptych_tls::{Credentials, CredentialsError, NodeIdentity};
use rustix::process::{Signal, getpid, kill_process};

use super::address::addresses;
use super::shutdown_signal::{parent_end, shutdown_signal};
use super::{MANAGER_VARIABLE, cache_folder, say};
use crate::simulator::local_wall::WINDOW_CLOSED;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The manager's address, HOST:PORT; with a standby the addresses of all managers, separated by
    /// commas
    #[arg(long, value_name = "ADDR", env = MANAGER_VARIABLE, value_parser = addresses)]
    #[arg(required_unless_present_any = ["list_monitors", "list_gpus"])]
    manager: Option<String>,
    /// The channel to draw; may be given again: one server can draw several
    #[arg(long, value_name = "NAME")]
    #[arg(required_unless_present_any = ["list_monitors", "list_gpus"])]
    channel: Vec<String>,
    /// Draw into a window for each channel. The mouse over it moves the camera where the manager
    /// lets it (manager --navigate)
    #[arg(long, conflicts_with_all = ["headless", "fullscreen"])]
    window: bool,
    /// Fill a monitor with each channel, with or without a window manager
    #[arg(long, conflicts_with = "headless")]
    fullscreen: bool,
    /// The monitor that a channel fills, before the one that the wall file names; may be given
    /// again, as CHANNEL=NAME [default: the next one, in the order of --list-monitors]
    #[arg(long, value_name = "NAME", requires = "fullscreen")]
    monitor: Vec<String>,
    /// Print this machine's monitors, their sizes and places in pixels, and end
    #[arg(long)]
    list_monitors: bool,
    /// The GPU to draw with: a part of its name, or its PCI address [default: the best one]
    #[arg(long, value_name = "NAME", env = GPU_VARIABLE)]
    #[arg(value_parser = NonEmptyStringValueParser::new())]
    gpu: Option<String>,
    /// Print this machine's GPUs, their drivers and PCI addresses, and end
    #[arg(long)]
    list_gpus: bool,
    /// Draw without a display [default where there is none]
    #[arg(long)]
    headless: bool,
    /// Give up, with the reason, instead of trying for ever
    #[arg(long)]
    once: bool,
    /// For logs and status [default: the name in the keys, else the first channel's]
    #[arg(long)]
    name: Option<String>,
    /// Where blobs are kept on this machine [default: in this user's cache folder]
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// The file with the manager's token [default: where the manager of this user puts it]
    #[arg(long, value_name = "FILE", env = token::TOKEN_FILE_VARIABLE)]
    token_file: Option<PathBuf>,
    /// This server's folder of keys, as `polyptych keys` makes it
    #[arg(long, value_name = "FOLDER")]
    keys: Option<PathBuf>,
    /// Go over a network without keys, though nothing is encrypted
    #[arg(long)]
    insecure: bool,
    /// Show every frame this much later, such as "5ms": for displays whose scan-out is known to be
    /// early, and for tests. The next frame is drawn later by as much
    #[arg(long, value_name = "TIME", value_parser = present_delay, hide_short_help = true)]
    present_delay: Option<Duration>,
    /// A file with the milliseconds that every frame is to take longer, read before each, for
    /// tests of how a wall bears a slow server; without the file none is slowed. "lose", "fill" or
    /// "hang" in it make the GPU lost, out of memory or stuck, once
    #[arg(long, value_name = "FILE")]
    slow_draw: Option<PathBuf>,
    /// Draw what others hide, too: for measurements. The pictures are the same
    #[arg(long, hide_short_help = true)]
    no_occlusion: bool,
    /// A file that holds "starting" or "ready" and is touched every 2 s while the server works, for
    /// probes; systemd is told without it
    #[arg(long, value_name = "FILE")]
    alive: Option<PathBuf>,
    /// End when standard input ends, as it does when the parent process does
    #[arg(long, hide = true)]
    with_parent: bool,
    /// Tell the parent that a window was closed, and go on; without this a closed window ends it
    #[arg(long, hide = true, requires = "with_parent")]
    tell_closed: bool,
}

/// The variable with the GPU to draw with, for machines of several users and for containers.
const GPU_VARIABLE: &str = "POLYPTYCH_GPU";

/// The folder of a user's sockets, which graphics drivers and their libraries look for.
const RUNTIME_FOLDER_VARIABLE: &str = "XDG_RUNTIME_DIR";

pub(super) fn run(arguments: Arguments) -> anyhow::Result<()> {
    if arguments.list_monitors {
        return list_monitors();
    }
    provide_runtime_folder();
    if arguments.list_gpus {
        return gpus()?.iter().try_for_each(|gpu| say(format_args!("{gpu}")));
    }
    // The command line is refused without it.
    let manager = arguments.manager.clone().ok_or_else(|| anyhow!("give --manager ADDR"))?;
    let name = name(&arguments, &manager)?;
    let monitors = monitor_names(&arguments.monitor, &arguments.channel)?;
    let output = if arguments.fullscreen {
        OutputKind::Fullscreen
    } else if arguments.window || (has_display() && !arguments.headless) {
        OutputKind::Window
    } else {
        OutputKind::Headless
    };
    let token_file = match arguments.token_file {
        Some(path) => path,
        None => token::default_path()?,
    };
    let cache = match arguments.cache {
        Some(cache) => cache,
        None => cache_folder()?.join("blobs"),
    };
    let options = ServerOptions {
        manager,
        name,
        keys: arguments.keys,
        insecure: arguments.insecure,
        channels: arguments.channel,
        token: TokenSource::File(token_file),
        cache,
        output,
        gpu: arguments.gpu,
        monitors,
        once: arguments.once,
        present_delay: arguments.present_delay.unwrap_or_default(),
        slow_draw: arguments.slow_draw,
        culls_occluded: !arguments.no_occlusion,
        notifier: ServiceNotifier::from_environment(arguments.alive.as_deref())?.map(Arc::new),
        on_close: arguments.tell_closed.then_some(tell_parent as fn(&str)),
    };
    let parent = arguments.with_parent.then(parent_end).transpose()?;
    let is_asked_to_end = shutdown_signal(parent)?;
    match run_server(options, Box::pin(is_asked_to_end)) {
        Err(error @ ServerError::DriverBusy) => {
            tracing::warn!(%error, "ending at once");
            // Nothing runs at exit then. Should it be refused, an error is as good.
            Ok(kill_process(getpid(), Signal::KILL)?)
        }
        ended => Ok(ended?),
    }
}

/// Tells the parent that the user has closed a window; it ends its servers when it is done.
fn tell_parent(channel: &str) {
    // A parent that is gone ends this process too.
    let _ = say(format_args!("{WINDOW_CLOSED} {channel}"));
}

fn list_monitors() -> anyhow::Result<()> {
    let monitors = monitors()?;
    if monitors.is_empty() {
        bail!("the X display has no monitor; connect one, or draw with --headless");
    }
    for monitor in monitors {
        let primary = if monitor.is_primary { " primary" } else { "" };
        say(format_args!("{monitor}{primary}"))?;
    }
    Ok(())
}

/// Reads `CHANNEL=NAME`, or `NAME` for the only channel, into monitors by channel.
fn monitor_names(
    given: &[String],
    channels: &[String],
) -> anyhow::Result<BTreeMap<String, String>> {
    let mut names = BTreeMap::new();
    for text in given {
        let (channel, name) = match (text.split_once('='), channels) {
            (Some((channel, name)), _) => (channel, name),
            (None, [channel]) => (channel.as_str(), text.as_str()),
            (None, _) => bail!(
                "--monitor {text}: this server draws {}; write CHANNEL={text} for one of them",
                channels.join(", ")
            ),
        };
        if !channels.iter().any(|known| known == channel) {
            let known = channels.join(", ");
            bail!("--monitor {text}: this server does not draw channel {channel:?}, but {known}");
        }
        if names.insert(channel.to_owned(), name.to_owned()).is_some() {
            bail!("--monitor {text}: channel {channel} is given a monitor twice; keep one");
        }
    }
    Ok(names)
}

/// Starts this program anew with a folder for sockets if the environment names none, as in
/// containers and services: the libraries below the graphics driver print an error line for each
/// time that they miss it. The process stays the same one.
fn provide_runtime_folder() {
    let is_there = std::env::var_os(RUNTIME_FOLDER_VARIABLE).is_some_and(|value| !value.is_empty());
    let Some(program) = std::env::current_exe().ok().filter(|_| !is_there) else { return };
    let mut arguments = std::env::args_os();
    let mut again = Command::new(program);
    if let Some(name) = arguments.next() {
        again.arg0(name);
    }
    again.args(arguments).env(RUNTIME_FOLDER_VARIABLE, std::env::temp_dir());
    // It returns only if it failed; then there are those lines.
    let error = again.exec();
    tracing::debug!(%error, "this program could not be started anew");
}

/// What this server is called, by its keys where it has any.
fn name(arguments: &Arguments, manager: &str) -> anyhow::Result<String> {
    let given = arguments.name.as_ref();
    let Some(folder) = &arguments.keys else {
        // What the network would refuse again and again is said at once; a name that means nothing
        // yet may do so later.
        let each = manager.split(',').filter_map(|one| one.to_socket_addrs().ok());
        let found: Vec<_> = each.flatten().collect();
        check_addresses(&found, arguments.insecure)?;
        return Ok(given.unwrap_or(&arguments.channel[0]).clone());
    };
    let keys = match Credentials::load(folder) {
        // Machines without a battery start in the past: this one waits for its clock.
        Err(error @ CredentialsError::NotYetValid { .. }) => {
            tracing::warn!(%error, "waiting for the right time");
            return waiting_name(error, given);
        }
        loaded => loaded?,
    };
    for warning in keys.warnings() {
        tracing::warn!("{warning}");
    }
    let name = keys.server_name()?.to_owned();
    keys.expect_identity(&NodeIdentity::Server(given.unwrap_or(&name).clone()))?;
    Ok(name)
}

/// What a server is called whose keys are not valid yet.
fn waiting_name(error: CredentialsError, given: Option<&String>) -> anyhow::Result<String> {
    match &error {
        CredentialsError::NotYetValid { identity: NodeIdentity::Server(name), .. }
            if given.is_none_or(|given| given == name) =>
        {
            Ok(name.clone())
        }
        _ => Err(error.into()),
    }
}

/// A delay in milliseconds, as an argument: "5ms", or "0.5ms".
fn present_delay(text: &str) -> Result<Duration, String> {
    let longest_ms = PRESENT_DELAY_MAX.as_millis();
    let number = text.strip_suffix("ms").and_then(|number| number.trim().parse::<f64>().ok());
    let delay = number.and_then(|ms| Duration::try_from_secs_f64(ms / 1000.0).ok());
    delay
        .filter(|delay| *delay <= PRESENT_DELAY_MAX)
        .ok_or_else(|| format!("{text:?} is no delay of 0ms to {longest_ms}ms, such as 5ms"))
}

/// Whether windows can be opened here.
pub(super) fn has_display() -> bool {
    std::env::var_os("DISPLAY").is_some_and(|display| !display.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monitors_are_named_by_channel_or_alone_for_the_only_one() {
        let names = |given: &[&str], channels: &[&str]| {
            let owned = |list: &[&str]| list.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>();
            let names = monitor_names(&owned(given), &owned(channels));
            names.map(|it| it.into_iter().collect::<Vec<_>>()).map_err(|error| error.to_string())
        };
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(names(&["HDMI-1"], &["l"]), Ok(vec![pair("l", "HDMI-1")]));
        let both = names(&["r=DP-1", "l=A=B"], &["l", "r"]);
        assert_eq!(both, Ok(vec![pair("l", "A=B"), pair("r", "DP-1")]));
        for (given, channels, expected) in [
            (&["DP-1"][..], &["l", "r"][..], "this server draws l, r; write CHANNEL=DP-1"),
            (&["x=DP-1"], &["l", "r"], "this server does not draw channel \"x\", but l, r"),
            (&["A", "l=B"], &["l"], "channel l is given a monitor twice"),
        ] {
            let error = names(given, channels).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_delay_has_its_unit_and_a_limit() {
        assert_eq!(present_delay("5ms"), Ok(Duration::from_millis(5)));
        assert_eq!(present_delay("0.5 ms"), Ok(Duration::from_micros(500)));
        for text in ["5", "5s", "-1ms", "NaNms", "101ms", "ms", ""] {
            assert!(present_delay(text).is_err_and(|e| e.contains("100ms")), "{text:?}");
        }
    }
}
