//! Charts: the parts of a patch on which texture coordinates and colours are continuous.

use std::collections::BTreeMap;

use foldhash::{HashMap, HashMapExt};
use glam::{DVec2, DVec3};

use super::part_group::{self, PartGroup, PartPoints};
use super::source::Source;
use super::triangle_set::SurfacePoint;

/// The charts of triangles. These are of one chart if they are of one surface and have a point with
/// the same place in space and on the textures, and the same colour. A point without a triangle, as
/// a vertex that only a coarser level has, is of the chart of the one that it came from.
#[derive(Debug)]
pub(super) struct Charts {
    /// The point that stands for the chart of each point.
    chart_of: Vec<u32>,
    /// The triangles of each chart by the point that stands for it.
    parts: HashMap<u32, PartPoints>,
}

impl Charts {
    /// The charts of triangles over these points. `origin_of` is the point that one without a
    /// triangle came from, or itself.
    pub fn new(
        points: &[SurfacePoint],
        surface_of: impl Fn(u32) -> u32,
        indices: &[u32],
        origin_of: impl Fn(u32) -> u32,
    ) -> Self {
        let mut first_at = HashMap::new();
        let bits = |at: u32, point: &SurfacePoint| {
            let looks = point.looks.map(|look| look.to_array().map(f64::to_bits));
            (surface_of(at), point.position.to_array().map(f64::to_bits), looks)
        };
        // Each point's way to the one that stands for its chart.
        let mut parents: Vec<u32> = (0..)
            .zip(points)
            .map(|(at, point)| *first_at.entry(bits(at, point)).or_insert(at))
            .collect();
        for corners in indices.as_chunks::<3>().0 {
            join(&mut parents, *corners);
        }
        let mut has_triangle = vec![false; points.len()];
        let mut charts: HashMap<u32, Vec<DVec3>> = HashMap::new();
        for &index in indices {
            has_triangle[index as usize] = true;
            let chart = charts.entry(root(&mut parents, index)).or_default();
            chart.push(points[index as usize].position);
        }
        let part = |(at, chart): (u32, Vec<DVec3>)| (at, PartPoints::of_chart(chart));
        let parts = charts.into_iter().map(part).collect();
        for at in (0..points.len() as u32).filter(|at| !has_triangle[*at as usize]) {
            // One that looks as another is of its chart already.
            if parents[at as usize] == at {
                let origin = root(&mut parents, origin_of(at));
                parents[at as usize] = origin;
            }
        }
        let chart_of = (0..points.len() as u32).map(|at| root(&mut parents, at)).collect();
        Self { chart_of, parts }
    }

    /// Returns the point that stands for a point's chart.
    pub fn of(&self, point: u32) -> u32 {
        self.chart_of[point as usize]
    }

    /// Returns the width of a point's chart, in units of the primitive's space: 0 for one without a
    /// triangle.
    pub fn width(&self, point: u32) -> f64 {
        self.parts.get(&self.of(point)).map_or(0.0, |part| part.width)
    }

    /// Returns how long a point's chart is, likewise, and at least its width.
    pub fn length(&self, point: u32) -> f64 {
        self.parts.get(&self.of(point)).map_or(0.0, |part| part.length().max(part.width))
    }

    /// Returns the slide of charts of which something is lost, in units of the primitive's space.
    /// `lost` has the largest slide that was found in each, by the point that stands for it. That
    /// counts up to the width of the chart, or of all of them together that lie side by side.
    pub fn slide_of_lost(&self, lost: &BTreeMap<u32, f64>) -> f64 {
        let part = |(chart, slide): (&u32, &f64)| Some((self.parts.get(chart)?, *slide));
        let (parts, slides): (Vec<&PartPoints>, Vec<f64>) = lost.iter().filter_map(part).unzip();
        let slide = |group: &PartGroup| {
            let most = group.parts.iter().map(|at| slides[*at]).fold(0.0, f64::max);
            most.min(group.width)
        };
        part_group::groups(&parts).iter().map(slide).fold(0.0, f64::max)
    }
}

/// How far texture coordinates of an atlas may be outside of the unit square.
const ATLAS_SLACK: f64 = 1e-3;

/// The boxes around the charts of triangles, in texture coordinates. Charts of a surface whose
/// texture coordinates leave the unit square have none: its texture is tiled, and goes on beyond.
pub(super) struct UvBoxes {
    /// The place of each vertex's box.
    box_of: HashMap<u32, usize>,
    /// The least and the greatest corner, of both sets.
    boxes: Vec<[(DVec2, DVec2); 2]>,
}

impl UvBoxes {
    /// The boxes of these triangles, which are three vertices of the source each.
    pub fn new(source: &Source<'_>, triangles: &[u32]) -> Self {
        let mut first_at = HashMap::new();
        let mut parents: Vec<u32> = Vec::new();
        let mut numbers = BTreeMap::new();
        for &vertex in triangles {
            numbers.entry(vertex).or_insert_with(|| {
                let look = source.uvs(vertex).map(|uv| uv.to_array().map(f64::to_bits));
                let key = (source.welded[vertex as usize], source.surface_of(vertex), look);
                let number = parents.len() as u32;
                parents.push(*first_at.entry(key).or_insert(number));
                number
            });
        }
        for corners in triangles.as_chunks::<3>().0 {
            join(&mut parents, corners.map(|corner| numbers[&corner]));
        }
        let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut boxes = vec![[empty; 2]; parents.len()];
        let mut surfaces = vec![0; parents.len()];
        let mut tiled: HashMap<u32, [bool; 2]> = HashMap::new();
        let mut box_of = HashMap::with_capacity(numbers.len());
        for (vertex, number) in numbers {
            let chart = root(&mut parents, number) as usize;
            box_of.insert(vertex, chart);
            surfaces[chart] = source.surface_of(vertex);
            let is_tiled = tiled.entry(surfaces[chart]).or_default();
            for (set, uv) in source.uvs(vertex).into_iter().enumerate() {
                let (low, high) = &mut boxes[chart][set];
                (*low, *high) = (low.min(uv), high.max(uv));
                let outside = (uv - 0.5).abs().max_element() - 0.5;
                is_tiled[set] |= outside > ATLAS_SLACK;
            }
        }
        for (boxes, surface) in boxes.iter_mut().zip(surfaces) {
            let is_tiled = tiled.get(&surface).copied().unwrap_or_default();
            for (of, is_tiled) in boxes.iter_mut().zip(is_tiled) {
                if is_tiled {
                    *of = (DVec2::NEG_INFINITY, DVec2::INFINITY);
                }
            }
        }
        Self { box_of, boxes }
    }

    /// Returns the nearest texture coordinates within the box of a vertex's chart: beyond it, the
    /// texture may be that of something else.
    pub fn clamp(&self, vertex: u32, uvs: [DVec2; 2]) -> [DVec2; 2] {
        let boxes = self.box_of.get(&vertex).map(|at| self.boxes[*at]);
        let Some(boxes) = boxes else { return uvs };
        [0, 1].map(|set| uvs[set].max(boxes[set].0).min(boxes[set].1))
    }
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

/// Connects the corners of a triangle.
pub(super) fn join(parents: &mut [u32], corners: [u32; 3]) {
    let roots = corners.map(|corner| root(parents, corner));
    let least = roots.into_iter().fold(u32::MAX, u32::min);
    for root in roots {
        parents[root as usize] = least;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::surface::Surface;
    use glam::DVec2;
    use polyptych_scene::VertexLayout;

    #[test]
    fn only_charts_of_an_atlas_have_boxes() {
        // Positions, normals, texture coordinates.
        let square = |scale: f32| -> Vec<f32> {
            let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
            let row = |[u, v]: [f32; 2]| [u, v, 0.0, 0.0, 0.0, 1.0, u * scale, v * scale];
            corners.into_iter().flat_map(row).collect()
        };
        for (scale, clamped) in [(0.5, 0.5), (1.0, 1.0), (3.0, 9.0)] {
            let vertices = square(scale);
            let layout = VertexLayout { uv0: true, ..VertexLayout::default() };
            let (indices, keeps_order, locked) = (&[0, 1, 2][..], false, &[][..]);
            let surfaces = [Surface { layout, vertices: &vertices, indices, keeps_order, locked }];
            let source = Source::new(&surfaces);
            let boxes = UvBoxes::new(&source, indices);
            let uvs = boxes.clamp(0, [DVec2::splat(9.0), DVec2::ZERO]);
            assert_eq!(uvs[0], DVec2::splat(clamped), "coordinates up to {scale}");
        }
    }

    #[test]
    fn charts_end_at_seams_and_not_at_creases() {
        let point = |[x, y]: [f64; 2], u: f64| SurfacePoint {
            position: DVec3::new(x, y, 0.0),
            looks: [DVec2::new(u, 0.0), DVec2::ZERO, DVec2::ZERO, DVec2::ZERO],
        };
        // Two triangles with corners alike, of different normals; then one beyond a seam.
        let points = [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [2.0, 0.0], [3.0, 1.0], [4.0, 0.0]];
        let points = points.map(|at| point(at, at[0]));
        let beyond = [[4.0, 0.0], [5.0, 0.5], [6.5, 0.0]].map(|at| point(at, at[0] + 9.0));
        let all: Vec<SurfacePoint> = points.into_iter().chain(beyond).collect();
        let charts = Charts::new(&all, |_| 0, &[0, 1, 2, 3, 4, 5, 6, 7, 8], |at| at);
        let widths: Vec<f64> = (0..9).map(|point| charts.width(point)).collect();
        let (own, beyond) = widths.split_at(6);
        assert!(own.iter().all(|width| *width == own[0] && (0.66..=1.0).contains(width)));
        assert!(beyond.iter().all(|width| *width == beyond[0] && (0.33..=0.5).contains(width)));
    }
}
