//! `polyptych bench barrier`: what the frame barrier costs, beside a raw one in the same run.

use std::path::PathBuf;

use crate::cli::say;
use crate::simulator::barrier::{BarrierCost, measure};

#[derive(Debug, clap::Args)]
pub(super) struct BarrierArguments {
    /// Number of servers; may be given again [default: 4, 16 and 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    servers: Vec<u16>,
    /// Frames to measure
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u64).range(10..=60_000))]
    frames: u64,
    /// Record what the manager is told meanwhile, to see what that costs
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Encrypt ours, with keys made for the measurement; the raw barrier stays in the clear
    #[arg(long)]
    tls: bool,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &BarrierArguments) -> anyhow::Result<()> {
    let numbers =
        if arguments.servers.is_empty() { vec![4, 16, 64] } else { arguments.servers.clone() };
    let (record, is_encrypted) = (arguments.record.as_deref(), arguments.tls);
    let measure = |servers| measure(servers, arguments.frames, record, is_encrypted);
    let costs: anyhow::Result<Vec<BarrierCost>> = numbers.into_iter().map(measure).collect();
    let costs = costs?;
    if arguments.json {
        say(serde_json::to_string_pretty(&costs)?)?;
        return Ok(());
    }
    say(format_args!(
        "barrier: from the frame command to the swap command; skew: of its arrival; µs"
    ))?;
    say(format_args!("servers          p50      p99      max  skew p50      p99   joined"))?;
    for cost in &costs {
        for (name, measured) in [("ours", &cost.ours), ("raw", &cost.raw)] {
            let (barrier, skew) = (&measured.barrier_us, &measured.skew_us);
            say(format_args!(
                "{:>7}  {name:<4} {:>7.0}  {:>7.0}  {:>7.0}  {:>8.0}  {:>7.0}  {}",
                cost.servers,
                barrier.p50,
                barrier.p99,
                barrier.max,
                skew.p50,
                skew.p99,
                if name == "ours" { format!("{:.0} ms", cost.joined_ms) } else { String::new() }
            ))?;
        }
        say(format_args!(
            "         ratio {:>6.2}  {:>7.2}           {:>8.2}",
            cost.ratio_p50, cost.ratio_p99, cost.skew_ratio_p50
        ))?;
    }
    Ok(())
}
