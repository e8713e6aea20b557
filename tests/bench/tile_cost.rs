//! The cost of tiling: a 2×2 wall against one channel of the same pixels, on one machine in one
//! run.
//!
//! `cargo bench --bench tile_cost [-- SCENE.glb ...]`; without a scene, the generated town. The two
//! walls are run in turn, A B A B, so that a machine whose speed drifts spoils neither; the ratio
//! is taken pair by pair.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

const PAIRS: usize = 5;
const FRAMES: &str = "40";

fn main() -> Result<(), Box<dyn Error>> {
    let scenes: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    let folder = tempfile::tempdir()?;
    if scenes.is_empty() {
        return compare(None, folder.path());
    }
    scenes.iter().try_for_each(|scene| compare(Some(scene), folder.path()))
}

fn compare(scene: Option<&PathBuf>, folder: &Path) -> Result<(), Box<dyn Error>> {
    let name = scene.map_or_else(|| "the generated town".into(), |s| s.display().to_string());
    let mut ratios = Vec::new();
    for pair in 0..=PAIRS {
        let one = frame_ms("single", scene, folder)?;
        let four = frame_ms("wall-2x2", scene, folder)?;
        // The first pair bakes and fills caches.
        if pair > 0 {
            println!("{name}: one channel {one:.1} ms, 2×2 {four:.1} ms, ratio {:.3}", four / one);
            ratios.push(four / one);
        }
    }
    ratios.sort_by(f64::total_cmp);
    let (low, middle, high) = (ratios[0], ratios[PAIRS / 2], ratios[PAIRS - 1]);
    println!("{name}: 2×2 costs {middle:.3} times one channel (from {low:.3} to {high:.3})");
    Ok(())
}

/// The median time of a frame on a wall of `configs`, in milliseconds.
fn frame_ms(wall: &str, scene: Option<&PathBuf>, out: &Path) -> Result<f64, Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let run = Command::new(env!("CARGO_BIN_EXE_polyptych"))
        .arg("simulate")
        .arg(root.join("configs").join(wall).with_extension("toml"))
        .args(scene)
        .args(["--frames", FRAMES, "--orbit", "--out"])
        .arg(out)
        .output()?;
    if !run.status.success() {
        return Err(String::from_utf8_lossy(&run.stderr).into_owned().into());
    }
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json"))?)?;
    report
        .pointer("/frame_ms/p50")
        .and_then(serde_json::Value::as_f64)
        .ok_or_else(|| format!("the report of {wall} has no frame_ms.p50").into())
}
