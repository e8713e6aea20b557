//! `polyptych status`: how a running wall stands.

use polyptych_client::WallStatus;

use super::{ManagerAddress, say, watch};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Go on: a live table in a terminal, a line a second elsewhere
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.watch {
        return watch::run(&arguments.manager, arguments.json);
    }
    let status = arguments.manager.connect()?.status()?;
    if arguments.json {
        say(serde_json::to_string_pretty(&status)?)?;
    } else {
        say(table(&status).trim_end())?;
    }
    Ok(())
}

fn table(status: &WallStatus) -> String {
    let scene = status.scene.as_deref().unwrap_or("none");
    let mut text = format!(
        "wall {}, scene {scene}, frame {}, revision {}, deadline {:.0} ms\n",
        status.wall, status.frame, status.revision, status.deadline_ms
    );
    let header = ["CHANNEL", "STATE", "FOR", "FRAME", "LATE", "PID", "ADDRESS", "REASON"];
    let mut rows = vec![header.map(String::from)];
    rows.extend(status.channels.iter().map(|channel| {
        [
            channel.name.clone(),
            format!("{:?}", channel.state).to_lowercase(),
            format!("{:.1} s", channel.since_ms as f64 / 1000.0),
            channel.frame.to_string(),
            channel.late.to_string(),
            channel.pid.map_or_else(|| "-".into(), |pid| pid.to_string()),
            channel.address.clone().unwrap_or_else(|| "-".into()),
            channel.reason.clone().unwrap_or_default(),
        ]
    }));
    let width = |column: usize| rows.iter().map(|r| r[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    for row in &rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        let line = cells.collect::<Vec<_>>().join("  ");
        text.push_str(line.trim_end());
        text.push('\n');
    }
    for warning in &status.warnings {
        text.push_str("warning: ");
        text.push_str(warning);
        text.push('\n');
    }
    text
}
