//! Charts: the parts of a patch on which texture coordinates and colours are continuous.

use std::collections::HashMap;

use glam::DVec3;

use super::triangle_set::SurfacePoint;

/// Returns for each point the length of the box around its chart, in units of the primitive's
/// space: 0 for one without a triangle. Triangles are of one chart if they have a point with the
/// same place in space and on the textures, and the same colour.
pub(super) fn sizes(points: &[SurfacePoint], indices: &[u32]) -> Vec<f64> {
    let mut first_at = HashMap::new();
    let bits = |point: &SurfacePoint| {
        let looks = point.looks.map(|look| look.to_array().map(f64::to_bits));
        (point.position.to_array().map(f64::to_bits), looks)
    };
    // Each point's way to the one that stands for its chart.
    let mut parents: Vec<u32> =
        (0..).zip(points).map(|(at, point)| *first_at.entry(bits(point)).or_insert(at)).collect();
    for [a, b, c] in indices.as_chunks::<3>().0 {
        let charts = [*a, *b, *c].map(|corner| root(&mut parents, corner));
        let least = charts.into_iter().fold(u32::MAX, u32::min);
        for chart in charts {
            parents[chart as usize] = least;
        }
    }
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut boxes = vec![empty; points.len()];
    for &index in indices {
        let (low, high) = &mut boxes[root(&mut parents, index) as usize];
        let position = points[index as usize].position;
        (*low, *high) = (low.min(position), high.max(position));
    }
    let size = |point: u32| {
        let (low, high) = boxes[root(&mut parents, point) as usize];
        if low.cmple(high).all() { low.distance(high) } else { 0.0 }
    };
    (0..points.len() as u32).map(size).collect()
}

/// Gives the point that stands for all that are connected to one, and shortens the way to it.
pub(super) fn root(parents: &mut [u32], mut point: u32) -> u32 {
    while parents[point as usize] != point {
        let parent = parents[point as usize];
        parents[point as usize] = parents[parent as usize];
        point = parent;
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn charts_end_at_seams_and_not_at_creases() {
        let point = |x: f64, u: f64| SurfacePoint {
            position: DVec3::new(x, 0.0, 0.0),
            looks: [DVec2::new(u, 0.0), DVec2::ZERO, DVec2::ZERO, DVec2::ZERO],
        };
        // Two triangles with corners alike, of different normals; then one beyond a seam.
        let points = [0.0, 1.0, 2.0, 2.0, 3.0, 4.0].map(|x| point(x, x));
        let beyond = [4.0, 5.0, 6.5].map(|x| point(x, x + 9.0));
        let all: Vec<SurfacePoint> = points.into_iter().chain(beyond).collect();
        let sizes = sizes(&all, &[0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(sizes, [4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 2.5, 2.5, 2.5]);
    }
}
