//! Measured errors of pictures: those of each error bound against those of full detail.

use polyptych_client::Camera;

use super::flip::{FlipError, PIXELS_PER_DEGREE, PerceivedImage};
use super::silhouette::Coverage;
use super::stage::Stage;

/// Returns the FLIP error of each bound: the mean over all pixels of all poses, and the largest
/// 99th percentile of a pose. Bounds are in pixels, and the first one is full detail.
pub(super) fn flip_errors(
    stage: &Stage,
    cameras: &[Camera],
    bounds_px: &[f64],
) -> anyhow::Result<Vec<FlipError>> {
    let mut errors = vec![FlipError::default(); bounds_px.len()];
    for &camera in cameras {
        let mut reference = None;
        for (&bound_px, error) in bounds_px.iter().zip(&mut errors) {
            stage.set_error_bound(bound_px)?;
            let picture = stage.picture(camera)?;
            let perceive = || PerceivedImage::new(&picture.rgba, picture.width, PIXELS_PER_DEGREE);
            let (full_detail, perceived) =
                reference.get_or_insert_with(|| (picture.rgba.clone(), perceive()));
            // Equal pictures have no error; filters are not needed to know.
            if *full_detail != picture.rgba {
                let measured = perceived.difference(&perceive());
                error.mean += measured.mean / cameras.len() as f64;
                error.p99 = error.p99.max(measured.p99);
            }
        }
    }
    Ok(errors)
}

/// Returns the distances between the outlines of the scene at each bound and at full detail, one
/// for each camera that sees an outline, in pixels of this wall: where the scene fills the picture,
/// there is none. Bounds are likewise, and the first one is full detail.
pub(super) fn outline_distances(
    stage: &Stage,
    cameras: &[Camera],
    bounds_px: &[f64],
) -> anyhow::Result<Vec<Vec<f64>>> {
    let empty = stage.add_empty_node()?;
    let mut distances_px = vec![Vec::with_capacity(cameras.len()); bounds_px.len()];
    for &camera in cameras {
        // A scene may have surroundings, of which each camera sees another part.
        let background = stage.background(camera, empty)?.rgba;
        let mut reference: Option<Coverage> = None;
        for (&bound_px, distances_px) in bounds_px.iter().zip(&mut distances_px) {
            stage.set_error_bound(bound_px)?;
            let picture = stage.picture(camera)?;
            let coverage = Coverage::in_front_of(&background, &picture.rgba, picture.width);
            match &reference {
                None if coverage.is_full() => break,
                None => {
                    distances_px.push(0.0);
                    reference = Some(coverage);
                }
                Some(full_detail) => {
                    distances_px.push(full_detail.outline_distance_px(&coverage));
                }
            }
        }
    }
    Ok(distances_px)
}
