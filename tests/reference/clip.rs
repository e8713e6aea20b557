//! Clipping before the division (Sutherland and Hodgman, "Reentrant Polygon Clipping", 1974).

use super::view::HomogeneousPixel;

/// The distance of a point inside a boundary, times some positive number; linear in the point.
type Boundary = fn(&HomogeneousPixel, [f64; 3]) -> f64;

/// The near plane first: what is left of it has `w` above 0, so no edge goes through the ideal
/// point. The sixth boundary, the far plane, is at infinity, where nothing is.
const BOUNDARIES: [Boundary; 5] = [
    |p, [_, _, near]| p.w - near,
    |p, _| p.x,
    |p, [width, _, _]| width * p.w - p.x,
    |p, _| p.y,
    |p, [_, height, _]| height * p.w - p.y,
];

/// The part of a triangle that lies before the near plane and within a picture of this size.
pub fn clip(
    triangle: [HomogeneousPixel; 3],
    [width, height]: [u32; 2],
    near_m: f64,
) -> Vec<HomogeneousPixel> {
    let limits = [f64::from(width), f64::from(height), near_m];
    let mut polygon = triangle.to_vec();
    for boundary in BOUNDARIES {
        let inside: Vec<f64> = polygon.iter().map(|point| boundary(point, limits)).collect();
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (i, point) in polygon.iter().enumerate() {
            let next = (i + 1) % polygon.len();
            if inside[i] >= 0.0 {
                kept.push(*point);
            }
            if (inside[i] > 0.0 && inside[next] < 0.0) || (inside[i] < 0.0 && inside[next] > 0.0) {
                kept.push(crossing((*point, inside[i]), (polygon[next], inside[next])));
            }
        }
        polygon = kept;
    }
    polygon
}

/// Returns the point where an edge meets a boundary. It is computed from the inside outwards, so
/// that triangles which share the edge get the same point to the last bit.
fn crossing(a: (HomogeneousPixel, f64), b: (HomogeneousPixel, f64)) -> HomogeneousPixel {
    let ((inner, d1), (outer, d2)) = if a.1 > 0.0 { (a, b) } else { (b, a) };
    let t = d1 / (d1 - d2);
    let mix = |from: f64, to: f64| from + (to - from) * t;
    HomogeneousPixel {
        x: mix(inner.x, outer.x),
        y: mix(inner.y, outer.y),
        w: mix(inner.w, outer.w),
    }
}
