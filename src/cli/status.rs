//! `polyptych status`: how a running wall stands.

use polyptych_client::{DisplayMode, Opening, Skew, WallStatus};

use super::{ManagerAddress, printable, say, watch};

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

/// Present-call skew over the last frames: half, 99 of 100 and all are below; and how far off the
/// server's clock may be.
const SKEW: &str = "SKEW P50/P99/MAX ±CLOCK µs";

fn skew(skew: &Skew) -> String {
    let Some(error_us) = skew.clock_error_us.filter(|_| skew.frames > 0) else {
        return "-".to_owned();
    };
    format!("{}/{}/{} ±{error_us}", skew.p50_us, skew.p99_us, skew.max_us)
}

fn table(status: &WallStatus) -> String {
    let scene = status.scene.as_deref().unwrap_or("none");
    let mut text = format!(
        "wall {}, scene {scene}, frame {}, revision {}, deadline {:.0} ms\n",
        status.wall, status.frame, status.revision, status.deadline_ms
    );
    if status.displays != DisplayMode::Normal {
        let mode = status.displays.name();
        text += &["displays: ", mode, ", until: polyptych ", mode, " --off\n"].concat();
    }
    for Opening { scene, progress } in &status.opening {
        text += &["opening ", &printable(scene), ": ", &progress.to_string(), "\n"].concat();
    }
    if let Some(pattern) = status.pattern {
        text += &["pattern: ", pattern.name(), ", until: polyptych pattern --off\n"].concat();
    }
    let header = ["CHANNEL", "STATE", "FOR", "FRAME", "LATE", SKEW, "PID", "ADDRESS", "REASON"];
    let mut rows = vec![header.map(String::from)];
    rows.extend(status.channels.iter().map(|channel| {
        [
            channel.name.clone(),
            format!("{:?}", channel.state).to_lowercase(),
            format!("{:.1} s", channel.since_ms as f64 / 1000.0),
            channel.frame.to_string(),
            channel.late.to_string(),
            skew(&channel.skew),
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
    let warnings =
        status.warnings.iter().map(|warning| ["warning: ", &printable(warning), "\n"].concat());
    let notes = status.notes.iter().map(|note| ["note: ", &printable(note), "\n"].concat());
    text.extend(warnings.chain(notes));
    text
}
