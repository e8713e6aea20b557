//! The rate that is held while the load of the scene doubles, and halves again.
//!
//! The scene is shown as a camera's own picture on the whole screen, then by two such cameras on a
//! half each, then by one again: the pixels stay, and the triangles of full detail double.

use std::f64::consts::FRAC_PI_4;

use polyptych_client::{Area, Camera, QualityBounds, View, ViewProjection};
use serde::Serialize;

use super::frame_samples::Spread;
use super::stage::Stage;
use crate::simulator::orbit;

/// The period of the rate bound as a multiple of a frame of full detail with one camera: two need
/// up to twice the time of one, and so less detail or fewer pixels.
const PERIOD_FACTOR: f64 = 1.3;

/// Range of rate bounds that can be asked for, in frames per second.
const RATES_FPS: [f64; 2] = [1.0, 1000.0];

/// Frames of each phase for each frame that is timed of other settings: the bound rises within
/// frames, but falls by 3 % a frame.
const FRAMES_FACTOR: u32 = 3;

/// A run with a step of the load.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LoadStepReport {
    /// The rate bound, in frames per second.
    pub rate_bound_fps: f64,
    /// One camera, two of them, and one again.
    pub phases: Vec<LoadPhase>,
}

/// The frames with one load.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct LoadPhase {
    /// Cameras that show the scene, on all of the wall's pixels together.
    pub cameras: u32,
    /// Frames that were ordered.
    pub frames: u32,
    /// Frames that took no longer than the period of the rate bound.
    pub in_time: u32,
    /// From the frame command to the swap command, in milliseconds.
    pub frame_ms: Spread,
    /// The error bounds in force, in pixels of the wall.
    pub error_in_force_px: Spread,
    /// Pixels along each side as a share of the wall's: the median and the least.
    pub resolution_scale: f64,
    pub resolution_scale_min: f64,
    /// Triangles of a frame, median.
    pub triangles: u64,
}

/// Draws frames while the load changes, of so many frames for other settings.
///
/// # Errors
/// A channel did not draw a frame; `Ending` if the user ended the run.
pub(super) fn measure(stage: &Stage, frames: u32) -> anyhow::Result<LoadStepReport> {
    stage.set_error_bound(0.0)?;
    let mut next = 0;
    // The first frames fill caches.
    draw(stage, 1, frames, &mut next, f64::INFINITY)?;
    let free = draw(stage, 1, frames, &mut next, f64::INFINITY)?;
    let [least, most] = RATES_FPS;
    let rate_fps = (1000.0 / (PERIOD_FACTOR * free.frame_ms.p50)).clamp(least, most);
    stage.set_bounds(QualityBounds { error_px: 0.0, rate_fps: Some(rate_fps) })?;
    let mut phases = Vec::new();
    for cameras in [1, 2, 1] {
        let frames = frames * FRAMES_FACTOR;
        phases.push(draw(stage, cameras, frames, &mut next, 1000.0 / rate_fps)?);
    }
    stage.set_views(Vec::new())?;
    stage.set_error_bound(0.0)?;
    Ok(LoadStepReport { rate_bound_fps: rate_fps, phases })
}

/// Draws the next frames of the orbit by so many cameras, and counts those within a period.
fn draw(
    stage: &Stage,
    cameras: u32,
    frames: u32,
    next: &mut u32,
    period_ms: f64,
) -> anyhow::Result<LoadPhase> {
    let mut phase = LoadPhase { cameras, frames, ..LoadPhase::default() };
    let (mut times, mut errors, mut scales) = (Vec::new(), Vec::new(), Vec::new());
    let mut triangles = Vec::new();
    for _ in 0..frames {
        let time_s = f64::from(*next) / orbit::TIME_RATE;
        *next += 1;
        let camera = stage.camera_at(time_s);
        stage.set_views(views(stage.size(), cameras, camera))?;
        let feedback = stage.draw(camera, time_s)?;
        let frame_ms = feedback.frame_us as f64 / 1e3;
        phase.in_time += u32::from(frame_ms <= period_ms);
        times.push(frame_ms);
        errors.push(feedback.detail.error_in_force_px);
        scales.push(feedback.detail.resolution_scale);
        let drawn: u64 = feedback.channels.iter().map(|channel| channel.triangles).sum();
        triangles.push(drawn as f64);
    }
    phase.frame_ms = Spread::from_samples(&times);
    phase.error_in_force_px = Spread::from_samples(&errors);
    phase.resolution_scale = Spread::from_samples(&scales).p50;
    phase.resolution_scale_min = scales.iter().copied().fold(1.0, f64::min);
    phase.triangles = Spread::from_samples(&triangles).p50 as u64;
    Ok(phase)
}

/// Columns of the screen of this size in pixels, each with the same camera's picture.
fn views([width, height]: [u32; 2], cameras: u32, camera: Camera) -> Vec<View> {
    let wide = width / cameras;
    // Narrower pictures show as much from side to side, so that each has all of the triangles.
    let fov_y_rad = 2.0 * (f64::from(cameras) * (FRAC_PI_4 / 2.0).tan()).atan();
    let part = |column: u32| View {
        area: Area::Screen { screen: 0, rect: [column * wide, 0, wide, height] },
        projection: ViewProjection::Perspective { fov_y_rad },
        ..View::of_wall(camera)
    };
    (0..cameras).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_share_the_pixels_and_show_as_much_from_side_to_side() {
        let one = views([1920, 1080], 1, Camera::IDENTITY);
        let two = views([1920, 1080], 2, Camera::IDENTITY);
        assert_eq!((one.len(), two.len()), (1, 2));
        let half_width = |view: &View| {
            let Area::Screen { rect: [_, _, width, height], .. } = view.area else { panic!("all") };
            let ViewProjection::Perspective { fov_y_rad } = view.projection else { panic!("wall") };
            (fov_y_rad / 2.0).tan() * f64::from(width) / f64::from(height)
        };
        assert!((half_width(&one[0]) - half_width(&two[1])).abs() < 1e-12);
        assert_eq!(two[1].area, Area::Screen { screen: 0, rect: [960, 0, 960, 1080] });
    }
}
