//! Cost of levels of detail: the choice among them on the CPU, and whole frames, of scenes with
//! levels against the same ones without, in one run.
//!
//! `cargo bench -p polyptych-renderer --bench level_cost`. The scenes are terrains whose levels
//! were made by hand: many small ones, and one large one.

#[expect(dead_code, clippy::unwrap_used, reason = "tests use the rest")]
#[path = "../../render-server/renderer/src/tests/harness.rs"]
mod harness;
#[path = "../../render-server/renderer/src/tests/terrain.rs"]
mod terrain;

use std::error::Error;

use glam::{DAffine3, DVec2, DVec3};
use harness::{MeshFixture, SceneFixture, gpu, look, matt};
use polyptych_renderer::{AllowedError, DrawStats, GpuScene, Renderer, Target, ViewDesc};
use terrain::Terrain;

const SIZE: [u32; 2] = [1920, 1080];
const FRAMES: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let small = Terrain::mesh(1, |at| hills(at, 9.0));
    let large = Terrain::mesh(6, |at| hills(at, 9.0) + hills(at, 150.0) * 0.02);
    let many = (0..5000).map(|at| {
        let at = DVec3::new(f64::from(at % 100) - 50.0, 0.0, f64::from(at / 100) - 25.0);
        DAffine3::from_translation(at * 1.5)
    });
    compare("5,000 items", &small, &many.collect::<Vec<_>>(), 60.0)?;
    let one = DAffine3::from_translation(DVec3::new(-0.5, 0.0, -0.5));
    compare("one item", &large, &[DAffine3::from_scale(DVec3::splat(100.0)) * one], 60.0)
}

fn hills(at: DVec2, by: f64) -> f64 {
    0.08 * (at.x * by).sin() * (at.y * by * 1.3).cos()
}

fn scene(shape: &MeshFixture, nodes: &[DAffine3]) -> GpuScene {
    let mut stage = SceneFixture::new();
    let material = stage.material(matt(0.8, 0.5, 0.2));
    let mesh = stage.mesh(shape, Some(material));
    for local in nodes {
        stage.node(mesh, *local);
    }
    stage.build()
}

/// Prints medians over an orbit at this distance.
fn compare(
    name: &str,
    shape: &MeshFixture,
    nodes: &[DAffine3],
    distance: f64,
) -> Result<(), Box<dyn Error>> {
    let triangles = shape.indices.len() / 3 * nodes.len();
    println!("{name} of {} meshlets, {triangles} triangles in all", shape.meshlets.len());
    let whole = MeshFixture { coarser_indices: Vec::new(), meshlets: Vec::new(), ..shape.clone() };
    let (without, with) = (scene(&whole, nodes), scene(shape, nodes));
    orbit("without levels", &without, distance, 0.0)?;
    for pixels in [0.0, 0.5, 1.0, 2.0, 4.0] {
        orbit(&format!("at {pixels} px"), &with, distance, pixels)?;
    }
    Ok(())
}

fn orbit(what: &str, scene: &GpuScene, distance: f64, pixels: f64) -> Result<(), Box<dyn Error>> {
    let mut renderer = Renderer::new(gpu(), 1)?;
    renderer.prepare(gpu(), scene);
    let mut target = Target::new(gpu(), SIZE, 1, false)?;
    // As `look` has 60° over the picture's height; in its middle.
    let angle_rad = pixels / (f64::from(SIZE[1]) / 2.0 / 30f64.to_radians().tan());
    let mut frames = Vec::new();
    for frame in 0..FRAMES + 2 {
        let turn = frame as f64 / FRAMES as f64 * std::f64::consts::TAU;
        let eye = DVec3::new(turn.sin(), 0.2, turn.cos()) * distance;
        let allowed_error = AllowedError { angle_rad, length: 0.0, ..AllowedError::NONE };
        let view = ViewDesc { allowed_error, ..look(eye, DVec3::ZERO, SIZE) };
        frames.push(renderer.draw(gpu(), scene, &mut target, &[view])?);
    }
    // The first ones fill caches.
    frames.drain(..2);
    let median = |of: fn(&DrawStats) -> u64| {
        let mut numbers: Vec<u64> = frames.iter().map(of).collect();
        numbers.sort_unstable();
        numbers[numbers.len() / 2]
    };
    let ms = |of: fn(&DrawStats) -> u64| median(of) as f64 / 1e3;
    println!(
        "  {what:<16} choose {:6.3} ms, encode {:6.3}, frame {:7.2}; {:8} triangles, {:5} draws",
        ms(|stats| stats.cull_us),
        ms(|stats| stats.encode_us),
        ms(|stats| stats.cull_us + stats.encode_us + stats.gpu_us),
        median(|stats| stats.triangles),
        median(|stats| u64::from(stats.draw_calls)),
    );
    Ok(())
}
