//! The lit area of a channel's picture that a file places: the first and last lit place of each row
//! and column. Ramps begin there and not at the edges of the picture, which may be dark.
//!
//! Holes within are not in it: beside a hole, a channel keeps its weight up to the edge.

use glam::DVec2;

use super::warp_mesh::WarpMesh;

/// Rows and columns that are looked at; between them edges are straight.
const LINES: usize = 128;

/// The outline of what is lit, in pixels before pins and bends.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LitArea {
    /// The rectangle around all of it.
    pub low: DVec2,
    pub high: DVec2,
    /// The ends of equally spaced lines across, then down; NaN where all is dark.
    lines: [Vec<DVec2>; 2],
}

/// A side of an outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edge {
    Left,
    Right,
    Top,
    Bottom,
}

impl LitArea {
    /// Returns the area that the triangles of a mesh cover.
    pub fn new(mesh: &WarpMesh) -> Self {
        let corners = mesh.triangles.iter().flatten();
        let places = corners.map(|corner| mesh.vertices[*corner as usize].pixel);
        let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low, high) = places.fold(none, |(low, high), at| (low.min(at), high.max(at)));
        Self { low, high, lines: [0, 1].map(|along| lines(mesh, along, low, high)) }
    }

    /// The places at which the line through a place along an axis begins and ends.
    fn line(&self, along: usize, at: DVec2) -> DVec2 {
        let beside = 1 - along;
        let share = (at[beside] - self.low[beside]) / (self.high[beside] - self.low[beside]);
        let place = (share * LINES as f64 - 0.5).clamp(0.0, LINES as f64 - 1.0);
        let before = place.floor();
        let lines = &self.lines[along];
        let (a, b) = (lines[before as usize], lines[(before as usize + 1).min(LINES - 1)]);
        match (a.is_nan(), b.is_nan()) {
            (false, false) => a.lerp(b, place - before),
            (true, _) => b,
            (_, true) => a,
        }
    }

    /// Returns the distances of a place from the left, right, upper and lower side, in pixels;
    /// negative beyond it.
    pub fn distances(&self, at: DVec2) -> [f64; 4] {
        let (row, column) = (self.line(0, at), self.line(1, at));
        let from = [at.x - row.x, row.y - at.x, at.y - column.x, column.y - at.y];
        from.map(|distance| if distance.is_nan() { 0.0 } else { distance })
    }

    /// A place of the rectangle, moved to this side of the outline.
    pub fn snap_to_edge(&self, side: Edge, at: DVec2) -> DVec2 {
        let (along, end) = match side {
            Edge::Left => (0, 0),
            Edge::Right => (0, 1),
            Edge::Top => (1, 0),
            Edge::Bottom => (1, 1),
        };
        let mut moved = at;
        moved[along] = self.line(along, at)[end];
        if moved.is_nan() { at } else { moved }
    }
}

/// Returns the first and last place where lines along an axis, 0 across and 1 down, meet triangles.
fn lines(mesh: &WarpMesh, along: usize, low: DVec2, high: DVec2) -> Vec<DVec2> {
    let (beside, count) = (1 - along, LINES as f64);
    let step = (high[beside] - low[beside]) / count;
    let mut lines = vec![DVec2::NAN; LINES];
    for triangle in &mesh.triangles {
        let corners = triangle.map(|corner| mesh.vertices[corner as usize].pixel);
        let at = corners.map(|corner| (corner[beside] - low[beside]) / step - 0.5);
        let first = at.into_iter().fold(f64::INFINITY, f64::min).ceil().max(0.0);
        let last = at.into_iter().fold(f64::NEG_INFINITY, f64::max).floor().min(count - 1.0);
        let mut line = first;
        while line <= last {
            let span = &mut lines[line as usize];
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let t = (line - at[a]) / (at[b] - at[a]);
                if (0.0..=1.0).contains(&t) {
                    let met = corners[a].lerp(corners[b], t)[along];
                    *span = DVec2::new(span.x.min(met), span.y.max(met));
                }
            }
            line += 1.0;
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::super::warp_mesh::TessellationOptions;
    use super::*;

    #[test]
    fn slanted_sides_are_where_they_are_lit() {
        let size = UVec2::new(200, 160);
        // A keystone: 20 pixels narrower on each side at the top, and dark below 150.
        let inset = |y: f64| 20.0 * (1.0 - y / 160.0);
        let is_lit =
            |at: DVec2| at.x >= inset(at.y) && at.x <= 200.0 - inset(at.y) && at.y <= 150.0;
        let mesh = WarpMesh::new(size, TessellationOptions::default(), |at| {
            is_lit(at).then(|| at.extend(-1.0))
        });
        let outline = LitArea::new(&mesh);
        for at in [[60.0, 40.0], [150.0, 100.0], [100.0, 149.0], [30.0, 80.0]] {
            let at = DVec2::from(at);
            let due = [at.x - inset(at.y), 200.0 - inset(at.y) - at.x, at.y, 150.0 - at.y];
            let found = outline.distances(at);
            let off = (0..4).map(|side| (found[side] - due[side]).abs()).fold(0.0, f64::max);
            assert!(off < 1.5, "{at}: {found:?}, {due:?}");
        }
        assert!(outline.distances(DVec2::new(5.0, 20.0))[0] < 0.0, "beyond");
        let moved = outline.snap_to_edge(Edge::Right, DVec2::new(200.0, 80.0));
        assert!((moved.x - 190.0).abs() < 1.5 && moved.y == 80.0, "{moved}");
    }

    #[test]
    fn a_mesh_of_nothing_or_of_a_line_has_an_outline() {
        let nothing = LitArea::new(&WarpMesh::default());
        assert_eq!(nothing.distances(DVec2::ONE), [0.0; 4]);
        let line = WarpMesh::new(UVec2::new(1, 50), TessellationOptions::default(), |at| {
            Some(at.extend(0.0))
        });
        let distances = LitArea::new(&line).distances(DVec2::new(0.5, 20.0));
        assert!(distances.iter().all(|distance| distance.is_finite()), "{distances:?}");
    }
}
