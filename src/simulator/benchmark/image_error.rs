//! Measured errors of pictures: those of each error bound against those of full detail.

use super::flip::{FlipError, PIXELS_PER_DEGREE, PerceivedImage};
use super::silhouette::Coverage;
use super::stage::Stage;

/// Returns the FLIP error of each bound: the mean over all pixels of all poses, and the largest
/// 99th percentile of a pose. Bounds are in pixels, and the first one is full detail.
pub(super) fn flip_errors(
    stage: &Stage,
    times_s: &[f64],
    bounds_px: &[f64],
) -> anyhow::Result<Vec<FlipError>> {
    let mut errors = vec![FlipError::default(); bounds_px.len()];
    for &time_s in times_s {
        let mut reference = None;
        for (&bound_px, error) in bounds_px.iter().zip(&mut errors) {
            stage.set_error_bound(bound_px)?;
            let picture = stage.picture(stage.camera_at(time_s), time_s)?;
            let perceive = || PerceivedImage::new(&picture.rgba, picture.width, PIXELS_PER_DEGREE);
            let (full_detail, perceived) =
                reference.get_or_insert_with(|| (picture.rgba.clone(), perceive()));
            // Equal pictures have no error; filters are not needed to know.
            if *full_detail != picture.rgba {
                let measured = perceived.difference(&perceive());
                error.mean += measured.mean / times_s.len() as f64;
                error.p99 = error.p99.max(measured.p99);
            }
        }
    }
    Ok(errors)
}

/// Returns the largest distance between the outlines of the scene at each bound and at full
/// detail, over all poses, in pixels of this wall. Bounds are likewise, and the first one is full
/// detail.
pub(super) fn outline_distances(
    stage: &Stage,
    times_s: &[f64],
    bounds_px: &[f64],
) -> anyhow::Result<Vec<f64>> {
    // The background is one colour, whatever the camera sees of it.
    let background = stage.picture(stage.camera_away(), 0.0)?.rgba;
    let mut distances_px = vec![0.0_f64; bounds_px.len()];
    for &time_s in times_s {
        let mut reference: Option<Coverage> = None;
        for (&bound_px, distance_px) in bounds_px.iter().zip(&mut distances_px) {
            stage.set_error_bound(bound_px)?;
            let picture = stage.picture(stage.camera_at(time_s), time_s)?;
            let coverage = Coverage::in_front_of(&background, &picture.rgba, picture.width);
            match &reference {
                None => reference = Some(coverage),
                Some(full_detail) => {
                    *distance_px = distance_px.max(full_detail.outline_distance_px(&coverage));
                }
            }
        }
    }
    Ok(distances_px)
}
