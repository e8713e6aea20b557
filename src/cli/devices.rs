//! `polyptych devices`: a bridge between the trackers, wands and pads of a wall and its manager.

mod bridge_loop;
mod sources;

use std::path::PathBuf;

use anyhow::bail;
use polyptych_client::{DeviceState, DeviceStatus};

use super::shutdown_signal::shutdown_signal;
use super::{ManagerAddress, load_wall};

/// Runs until Ctrl-C or SIGTERM. While the manager is away, devices are read and the bridge
/// connects again; a second bridge of the same wall waits until the first one has left.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file, whose [[device]] tables are read
    wall: PathBuf,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let wall = load_wall(&arguments.wall)?;
    if wall.devices.is_empty() {
        bail!("{}: it names no device; add [[device]]", arguments.wall.display());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let ended = shutdown_signal(None)?;
        tokio::select! {
            result = bridge_loop::run(&wall, &arguments.manager) => result,
            () = ended => Ok(()),
        }
    })
}

/// Returns the state of a device as one line.
pub(super) fn line(status: &DeviceStatus) -> String {
    let mut parts = vec![format!("device {}: {}", status.name, status.state.name())];
    if status.state == DeviceState::Live {
        parts.push(format!("{:.0} readings/s", status.rate_hz));
    }
    parts.extend(status.reason.clone());
    if status.refused > 0 {
        parts.push(format!("{} refused", status.refused));
    }
    let latency = status.latency_ms;
    if latency.count > 0 {
        let (p50, p99) = (latency.p50, latency.p99);
        parts.push(format!("packet to swap {p50:.1} ms p50, {p99:.1} ms p99"));
    }
    parts.join(", ")
}
