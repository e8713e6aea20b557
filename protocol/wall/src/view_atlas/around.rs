//! The source of a channel for eyes of omnidirectional stereo: each part of its mesh has a planar
//! picture of its own, seen from the middle of the places that the eyes have there.
//!
//! A pixel that shows the point P of the screen is to show what lies on the line from its own eye
//! e through P. Drawn from an eye e', it shows what lies on the line from e' through P: a point on
//! the screen is where it is, whatever e' is. A point that lies infinitely far beyond it, in the
//! direction d = P − e, is drawn at the place P' of the screen for which P' − e' is parallel to d:
//!
//! ```text
//! P' − P = (e' − e) − d (n·(e' − e)) / (n·d)      n: the normal of the screen at P
//! ```
//!
//! A point at a share t of the way is off by (1 − 1/t) times as much, which is less for all from
//! half the screen's distance on. For a part of the directions up to δ to either side, at the
//! elevation φ, with eyes that are s apart and pixels of p, that is s·(1 − cos δ) / 2p across, and
//! s·sin δ·sin φ / 2p up or down: one eye has come nearer, the other one has not. Left and right
//! are off by as much to opposite sides, so their disparity is off by twice that at most.
//!
//! Parts are halved, worst first, until none is off by more than the wall file allows.

use glam::DVec3;

use super::group::{Group, ViewTriangle, view_triangles};
use super::{AtlasError, MeshPart, SOURCE_CELLS_MAX, WarpMesh};
use crate::Viewpoint;
use crate::warp_mesh::WarpVertex;

/// By how much of the allowed error the eye may differ from the middle of an edge to its end: parts
/// are made of whole triangles.
const EDGE_SHARE: f64 = 0.5;

/// A part of a mesh, as the eyes see it.
#[derive(Debug)]
struct Cell {
    samples: Vec<Sample>,
    /// In pixels; infinite where no plane holds it.
    error_px: f64,
    /// For each viewpoint, once there is a plane for each.
    groups: Option<Vec<Group>>,
}

/// A triangle, and what its corners' own eyes see.
#[derive(Clone, Debug)]
struct Sample {
    facet: ViewTriangle,
    /// From the head to its middle: azimuth and elevation in radians.
    azimuth: f64,
    elevation: f64,
    /// For each viewpoint and corner.
    corners: Vec<Corner>,
}

/// A corner of a triangle as one viewpoint sees it.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// Its own eye, in metres of display space.
    eye: DVec3,
    /// From it to the corner, by the distance of the eye from the screen's plane there; 0 where
    /// that is seen from the side, and has no picture.
    ray: DVec3,
    /// The normal of the screen.
    normal: DVec3,
    /// The longer side of a pixel there, in metres.
    pixel_m: f64,
}

impl Corner {
    /// By how many pixels infinitely far points are off that another eye sees here.
    fn off_px(&self, eye: DVec3) -> f64 {
        let moved = eye - self.eye;
        (moved - self.ray * self.normal.dot(moved)).length() / self.pixel_m
    }
}

/// The planes of all viewpoints, and what each shows.
#[derive(Debug)]
pub(super) struct Cells {
    /// For each viewpoint, its planes; the same number for all.
    pub groups: Vec<Vec<Group>>,
    /// For each plane the triangles of the mesh that it shows.
    pub triangles: Vec<Vec<u32>>,
    /// By how much a point is off at most, in pixels.
    pub error_px: f64,
}

impl WarpMesh {
    /// The mesh with edges that are short enough for these viewpoints: as it is, unless there are
    /// eyes of omnidirectional stereo.
    #[must_use]
    pub fn refined_for(self, viewpoints: &[Viewpoint]) -> Self {
        let around = viewpoints.iter().find_map(|viewpoint| match viewpoint {
            Viewpoint::Fixed(_) => None,
            Viewpoint::Around(around) => Some((viewpoint, around)),
        });
        let Some((viewpoint, around)) = around else { return self };
        let is_long = |a: &WarpVertex, b: &WarpVertex| {
            // The ends may see the middle alike from both sides.
            let eye = viewpoint.eye_for(a.point.midpoint(b.point));
            let off_m = |end: &WarpVertex| {
                let toward = (end.point - around.head).normalize_or_zero();
                let moved = eye - viewpoint.eye_for(end.point);
                (moved - toward * moved.dot(toward)).length()
            };
            let pitch = a.point.distance(b.point) / a.pixel.distance(b.pixel);
            off_m(a).max(off_m(b)) > EDGE_SHARE * around.error_max_px * pitch
        };
        self.divided(is_long)
    }
}

/// The parts of a mesh that viewpoints around one head see.
///
/// # Errors
/// The errors of [`ViewAtlas::new`](super::ViewAtlas::new), for the head.
pub(super) fn cells(
    (mesh, part): (&WarpMesh, MeshPart),
    viewpoints: &[Viewpoint],
    error_max_px: f64,
) -> Result<Cells, AtlasError> {
    let head = viewpoints.first().map_or(DVec3::ZERO, Viewpoint::middle);
    let samples: Vec<Sample> = view_triangles(mesh, head, part)?
        .into_iter()
        .map(|facet| Sample::new(facet, head, viewpoints))
        .collect();
    let mut cells = vec![Cell::new(samples, head, viewpoints)];
    while cells.len() < SOURCE_CELLS_MAX {
        let is_wanted = |cell: &Cell| cell.error_px > error_max_px && cell.samples.len() > 1;
        let wanted = cells.iter().enumerate().filter(|(_, cell)| is_wanted(cell));
        let worst = wanted.max_by(|(_, a), (_, b)| a.error_px.total_cmp(&b.error_px));
        let Some((at, _)) = worst else { break };
        let cell = cells.swap_remove(at);
        cells.extend(cell.halves(head, viewpoints));
    }
    let mut found = Cells {
        groups: vec![Vec::with_capacity(cells.len()); viewpoints.len()],
        triangles: Vec::with_capacity(cells.len()),
        error_px: 0.0,
    };
    for cell in cells {
        let Some(groups) = cell.groups else {
            return Err(AtlasError::Coarse(cell.samples[0].facet.middle));
        };
        found.triangles.push(cell.samples.iter().map(|sample| sample.facet.triangle).collect());
        found.error_px = found.error_px.max(cell.error_px);
        for (all, group) in found.groups.iter_mut().zip(groups) {
            all.push(group);
        }
    }
    Ok(found)
}

impl Sample {
    fn new(facet: ViewTriangle, head: DVec3, viewpoints: &[Viewpoint]) -> Self {
        let middle = facet.middle_ray();
        let [across, down] = facet.slope;
        let corner = |viewpoint: &Viewpoint, ray: DVec3| {
            let point = head + ray;
            let eye = viewpoint.eye_for(point);
            let normal = across.cross(down).normalize_or_zero();
            let ray = (point - eye) / normal.dot(point - eye);
            let ray = if ray.is_finite() { ray } else { DVec3::ZERO };
            Corner { eye, ray, normal, pixel_m: across.length().max(down.length()) }
        };
        let corners: Vec<Corner> = viewpoints
            .iter()
            .flat_map(|viewpoint| facet.rays.map(|ray| corner(viewpoint, ray)))
            .collect();
        Self {
            azimuth: middle.x.atan2(-middle.z),
            elevation: middle.y.atan2(middle.x.hypot(middle.z)),
            facet,
            corners,
        }
    }

    /// The corners as a viewpoint sees them.
    fn seen_by(&self, viewpoint: usize) -> &[Corner] {
        &self.corners[3 * viewpoint..][..3]
    }
}

impl Cell {
    fn new(samples: Vec<Sample>, head: DVec3, viewpoints: &[Viewpoint]) -> Self {
        let (mut error_px, mut groups) = (0.0_f64, Vec::with_capacity(viewpoints.len()));
        for at in 0..viewpoints.len() {
            let corners = || samples.iter().flat_map(|sample| sample.seen_by(at));
            let (low, high) = corners()
                .map(|corner| corner.eye)
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), eye| {
                    (low.min(eye), high.max(eye))
                });
            let eye = low.midpoint(high);
            error_px = corners().map(|corner| corner.off_px(eye)).fold(error_px, f64::max);
            let facets: Vec<ViewTriangle> =
                samples.iter().map(|sample| sample.facet.seen_from(head, eye)).collect();
            groups.extend(Group::around(&facets, eye));
        }
        let groups = (groups.len() == viewpoints.len()).then_some(groups);
        let error_px = if groups.is_some() { error_px } else { f64::INFINITY };
        Self { samples, error_px, groups }
    }

    /// Divided by azimuth or elevation, whichever leaves the worse half less wrong.
    fn halves(self, head: DVec3, viewpoints: &[Viewpoint]) -> Vec<Self> {
        // Azimuths count from the middle of the part, that none lies behind the viewer.
        let (sin, cos) = self.samples.iter().fold((0.0, 0.0), |(sin, cos), sample| {
            let (s, c) = sample.azimuth.sin_cos();
            (sin + s, cos + c)
        });
        let middle = f64::atan2(sin, cos);
        let azimuth = |sample: &Sample| {
            (sample.azimuth - middle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
        };
        let by_azimuth = divide(&self.samples, azimuth);
        let by_elevation = divide(&self.samples, |sample| sample.elevation);
        let candidates = [by_azimuth, by_elevation].into_iter().flatten();
        let cells = candidates
            .map(|halves| halves.map(|half| Self::new(half, head, viewpoints)))
            .min_by(|a, b| {
                let [a, b] = [a, b].map(|halves| {
                    let worst = halves.iter().map(|half| half.error_px).fold(0.0, f64::max);
                    (worst, halves.iter().map(Self::span).sum::<f64>())
                });
                a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
            });
        cells.map_or_else(|| self.unequal_halves(head, viewpoints), Vec::from)
    }

    /// Divided by number, where all triangles have one middle.
    fn unequal_halves(mut self, head: DVec3, viewpoints: &[Viewpoint]) -> Vec<Self> {
        let second = self.samples.split_off(self.samples.len() / 2);
        [self.samples, second].map(|half| Self::new(half, head, viewpoints)).into()
    }

    /// The largest angle between rays of it and the first one, in radians.
    fn span(&self) -> f64 {
        let first = self.samples[0].facet.middle_ray();
        let angle = |sample: &Sample| sample.facet.middle_ray().angle_between(first);
        self.samples.iter().map(angle).fold(0.0, f64::max)
    }
}

/// Samples on either side of the middle of their range; `None` where all have one place.
fn divide(samples: &[Sample], place: impl Fn(&Sample) -> f64) -> Option<[Vec<Sample>; 2]> {
    let range = samples
        .iter()
        .map(&place)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), at| (a.min(at), b.max(at)));
    let middle = f64::midpoint(range.0, range.1);
    let (first, second): (Vec<_>, Vec<_>) =
        samples.iter().cloned().partition(|sample| place(sample) < middle);
    (!first.is_empty() && !second.is_empty()).then_some([first, second])
}

#[cfg(test)]
mod tests;
