//! Frames per second without and with a frame sent ahead, at a round trip of 20 ms.
//!
//! `cargo bench --bench pipeline_rate [-- SCENE.glb ...]`; without a scene, the town. Each run is a
//! wall of two channels of real processes, whose connections go through relays that hold every
//! byte for 10 ms each way. Runs of both depths take turns; the median of each is compared, and
//! the last pictures must be the same to the bit.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// Runs of each depth.
const ROUNDS: usize = 3;

const FRAMES: &str = "150";

/// The measures of one run.
struct Run {
    frames_per_second: f64,
    draw_ms: f64,
    skew_p99_us: f64,
    picture: Vec<u8>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let scenes: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    if scenes.is_empty() {
        return compare(None);
    }
    scenes.iter().try_for_each(|scene| compare(Some(scene)))
}

fn compare(scene: Option<&Path>) -> Result<(), Box<dyn Error>> {
    let mut runs = [const { Vec::new() }; 2];
    for _ in 0..ROUNDS {
        for (depth, runs) in runs.iter_mut().enumerate() {
            runs.push(run(depth, scene)?);
        }
    }
    let name = scene.map_or("the town".into(), |scene| scene.display().to_string());
    let all: Vec<&Run> = runs.iter().flatten().collect();
    let is_same = all.windows(2).all(|pair| pair[0].picture == pair[1].picture);
    let median = |runs: &[Run], of: fn(&Run) -> f64| {
        let mut all: Vec<f64> = runs.iter().map(of).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let mut rates = Vec::new();
    for (depth, runs) in runs.iter().enumerate() {
        let rate = median(runs, |run| run.frames_per_second);
        let (draw_ms, skew_us) = (median(runs, |run| run.draw_ms), median(runs, |r| r.skew_p99_us));
        println!(
            "{name}: depth {depth}: {rate:.1} frames per second, slowest channel draws \
             {draw_ms:.1} ms, skew p99 {skew_us:.0} us"
        );
        rates.push(rate);
    }
    let same = if is_same { "the same" } else { "DIFFERENT" };
    println!("{name}: ratio {:.2}, last pictures {same}", rates[1] / rates[0]);
    if is_same { Ok(()) } else { Err("a picture depends on the depth of the pipeline".into()) }
}

fn run(depth: usize, scene: Option<&Path>) -> Result<Run, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let wall = folder.path().join("wall.toml");
    let text = format!(
        "[wall]\nname = \"pipeline\"\n[sync]\npipeline_depth = {depth}\n\
         [[screen]]\nname = \"front\"\nsize = [1.92, 1.08]\ncenter = [0.0, 0.0, -1.304]\n\
         [screen.tiles]\ncolumns = 2\npixels = [160, 180]\n"
    );
    std::fs::write(&wall, text)?;
    let mut command = Command::new(env!("CARGO_BIN_EXE_polyptych"));
    command.arg("simulate").arg(&wall).args(scene).args(["--orbit", "--frames", FRAMES]);
    for channel in ["front-1-1", "front-2-1"] {
        command.args(["--fault", &format!("at 1 delay 10ms {channel}")]);
    }
    let out = folder.path().join("out");
    let status = command.arg("--out").arg(&out).stdout(Stdio::null()).status()?;
    if !status.success() {
        return Err("simulate failed".into());
    }
    let report: Value = serde_json::from_slice(&std::fs::read(out.join("report.json"))?)?;
    let number = |value: &Value| value.as_f64().ok_or("the report lacks a number");
    Ok(Run {
        frames_per_second: number(&report["frames"])? / number(&report["seconds"])?,
        draw_ms: number(&report["draw_ms"]["p50"])?,
        skew_p99_us: number(&report["swap_skew_us"]["p99"])?,
        picture: std::fs::read(out.join("wall.png"))?,
    })
}
