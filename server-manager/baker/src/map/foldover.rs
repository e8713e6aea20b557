//! The check that each place of a picture belongs to one triangle at most.
//!
//! A warp shows one point at a place. Triangles that are turned over, or lie over others, would
//! show two, and which of them is chance.

use glam::DVec2;
use polyptych_wall::warp::ImportedMesh;

use super::super::error::BakeError;

/// Points across and down at which overlaps are looked for: what is narrower than a 512th of the
/// mesh is a measured seam, not a fold.
const SAMPLES: usize = 512;

/// Share of a step that both ends of a triangle's row of samples are shortened by, so that
/// rounding gives no sample on a common edge to both of its triangles.
const EDGE: f64 = 1e-6;

/// The mesh without triangles that cover nothing of the picture, if no place of the picture has
/// two values. What lies beside the picture is never drawn, and may be folded.
///
/// # Errors
/// Names a triangle that is turned over or lies over another, as `place_of` calls the triangle of
/// an index; or says that no triangle covers any of the picture.
pub(super) fn check(
    mut mesh: ImportedMesh,
    place_of: impl Fn(usize) -> String,
) -> Result<ImportedMesh, BakeError> {
    let right = "places of a picture, 0 to 1 both ways, each covered once, would be right";
    let at = |index: u32| mesh.vertices[index as usize].place.as_dvec2();
    let mut kept = Vec::with_capacity(mesh.triangles.len());
    let mut first = None;
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        let corners = triangle.map(at);
        if !is_in_picture(corners) {
            continue;
        }
        let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
        if area == 0.0 {
            continue;
        }
        let (known, is_left) = *first.get_or_insert((i, area > 0.0));
        if is_left != (area > 0.0) {
            let what = format!("its UV are turned over against those of {}", place_of(known));
            return Err(BakeError::at(place_of(i), what, right));
        }
        kept.push((i, corners));
    }
    if kept.is_empty() {
        let what = "no triangle covers any of the picture: all places are beside it, or in a line";
        return Err(BakeError::at("file", what, right));
    }
    if let Some((one, other)) = overlap(&kept) {
        let what = format!("its UV lie over those of {}", place_of(other));
        return Err(BakeError::at(place_of(one), what, right));
    }
    if kept.len() < mesh.triangles.len() {
        mesh.triangles = kept.iter().map(|(i, _)| mesh.triangles[*i]).collect();
    }
    Ok(without_loose_vertices(mesh))
}

/// Only the vertices that a triangle has: the others may lie anywhere.
fn without_loose_vertices(mut mesh: ImportedMesh) -> ImportedMesh {
    let mut index_of = vec![u32::MAX; mesh.vertices.len()];
    let mut kept = Vec::new();
    for corner in mesh.triangles.iter_mut().flatten() {
        let index = &mut index_of[*corner as usize];
        if *index == u32::MAX {
            *index = kept.len() as u32;
            kept.push(mesh.vertices[*corner as usize]);
        }
        *corner = *index;
    }
    ImportedMesh { vertices: kept, triangles: mesh.triangles }
}

/// Returns whether more than a line of a triangle lies in the picture: axes that separate both, as
/// of two convex polygons; S. Gottschalk, *Separating axis theorem*, 1996.
fn is_in_picture(corners: [DVec2; 3]) -> bool {
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let meets_box = low.cmplt(DVec2::ONE).all() && high.cmpgt(DVec2::ZERO).all();
    let side = (b - a).perp_dot(c - a).signum();
    let picture = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
    let meets_edges = [(a, b), (b, c), (c, a)].iter().all(|(from, to)| {
        picture.iter().any(|corner| (*to - *from).perp_dot(*corner - *from) * side > 0.0)
    });
    meets_box && meets_edges
}

/// Two triangles that hold the same sample.
fn overlap(triangles: &[(usize, [DVec2; 3])]) -> Option<(usize, usize)> {
    let mut owners = vec![u32::MAX; SAMPLES * SAMPLES];
    let corners = || triangles.iter().flat_map(|(_, corners)| corners);
    let min = corners().fold(DVec2::MAX, |a, b| a.min(*b)).max(DVec2::ZERO);
    let max = corners().fold(DVec2::MIN, |a, b| a.max(*b)).min(DVec2::ONE);
    let step = (max - min).max(DVec2::splat(f64::MIN_POSITIVE)) / SAMPLES as f64;
    for (n, (_, corners)) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|corner| (corner - min) / step);
        let last = SAMPLES as f64 - 1.0;
        // Samples lie at halves; rows beside the triangle are not looked at.
        let top = (a.y.min(b.y).min(c.y) - 0.5).ceil().clamp(0.0, last);
        let bottom = (a.y.max(b.y).max(c.y) - 0.5).floor().clamp(0.0, last);
        for row in top as usize..=bottom as usize {
            let Some((from, to)) = span([a, b, c], row as f64 + 0.5) else { continue };
            let from = (from + EDGE - 0.5).ceil().max(0.0);
            let to = (to - EDGE - 0.5).floor().min(last);
            if from > to {
                continue;
            }
            for owner in &mut owners[row * SAMPLES..][from as usize..=to as usize] {
                if *owner != u32::MAX {
                    return Some((triangles[n].0, triangles[*owner as usize].0));
                }
                *owner = n as u32;
            }
        }
    }
    None
}

/// Returns the X coordinates at which a level line enters and leaves a triangle; `None` if it
/// misses it.
fn span(corners: [DVec2; 3], y: f64) -> Option<(f64, f64)> {
    let mut span: Option<(f64, f64)> = None;
    for i in 0..3 {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        // Half-open, so that a corner belongs to one edge; ordered, so that an edge gives the
        // same number for both of its triangles.
        let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
        if !(p.y <= y && y < q.y) {
            continue;
        }
        let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
        span = Some(span.map_or((x, x), |(from, to)| (from.min(x), to.max(x))));
    }
    span
}
