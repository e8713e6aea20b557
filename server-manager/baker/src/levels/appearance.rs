//! The distances by which textures and colours slide and the angles by which normals turn: sampled
//! at vertices that are removed, and at those that are added.
//!
//! A texture slides by the distance between a point and the one of the other surface that has the
//! same texture coordinates: the texture deviation of J. Cohen, M. Olano, D. Manocha,
//! *Appearance-preserving simplification* (1998). Coordinates that only nearly agree count by their
//! difference, as a length on the surface: so what is measured is the distance of a vertex to the
//! coarser surface where each point has its place in space and on the textures. Colours of vertices
//! count likewise: as far as it is to where that colour is. At a seam, the side that fits is taken.
//! A vertex that nothing fits any more, since its whole chart is left out, counts by the chart's
//! width; such charts side by side, as the tiles of a mosaic, count by the width of all together.
//! Where its chart is drawn all the same, as along a road, it slides by up to the chart's length.
//! A colour that is off by a share of all that a component can be counts as a slide over a quarter
//! as large a share of the surface's width.
//!
//! A vertex that only the coarser surface has is measured the other way, to the finer one, wherever
//! that fits best: parts grow together on which a texture goes on. Beyond the border of a surface
//! it goes on as well, so there the distances in space and on the textures do not add up: the
//! larger one counts, up to the length of the chart.
//!
//! Only these vertices are measured. Between vertices, position and texture coordinates are linear
//! on both surfaces, so that the largest slide nearly is at one; this is not proven.

use std::collections::BTreeMap;

use foldhash::{HashSet, HashSetExt};
use glam::{DVec2, DVec3};

use super::chart::Charts;
use super::patch::by_surface;
use super::source::Source;
use super::triangle_set::{Nearest, SurfacePoint, TriangleSet, shares_of_nearest};
use super::width;

/// The share of a surface's width over which a colour slides that is off by all that it can be: a
/// wall of 12 m that is a tenth darker at its foot is off by 0.3 m where it is bright down there.
const COLOR_SLIDE: f64 = 0.25;

/// The vertices of a patch, as they look.
pub(super) struct VertexList {
    points: Vec<SurfacePoint>,
    normals: Vec<DVec3>,
    /// `true` for a vertex with a colour of a palette, whose slide is no length.
    palettes: Vec<bool>,
}

/// A point of a triangle that looks nearly as a vertex.
struct Fit {
    /// From the vertex, in space, on the textures and in colour.
    distance: f64,
    triangle: u32,
    corners: [u32; 3],
    /// Those of the corners in the point.
    shares: [f64; 3],
}

/// The largest changes at any vertex.
#[derive(Debug, Default)]
pub(super) struct Change {
    /// That of vertices whose chart is not lost; in units of the primitive's space.
    slide: f64,
    /// The slides of others, likewise, by the points that stand for their charts.
    lost: BTreeMap<u32, f64>,
    /// In radians.
    pub normal_angle: f64,
}

impl Change {
    /// Returns the largest slide, in units of the primitive's space; see [`Charts::slide_of_lost`].
    pub fn slide(&self, charts: &Charts) -> f64 {
        self.slide.max(charts.slide_of_lost(&self.lost))
    }
}

impl VertexList {
    /// These vertices of a source. Units of textures and colours are as long as they are on average
    /// on the triangles `indices` of each surface, which number the list. `simplified` are those
    /// that are simplified, whose vertices may be others.
    pub fn new(
        source: &Source<'_>,
        vertices: &[u32],
        (indices, simplified): (&[u32], &[u32]),
    ) -> Self {
        let positions = vertices.iter().map(|vertex| source.position(*vertex));
        let point = |position| SurfacePoint { position, ..SurfacePoint::default() };
        let mut points: Vec<SurfacePoint> = positions.map(point).collect();
        let surface_of = |index: u32| source.surface_of(vertices[index as usize]);
        let mut is_measured = vec![false; vertices.len()];
        for index in indices {
            is_measured[*index as usize] = true;
        }
        let is_other = |index: u32| !is_measured[index as usize];
        let simplified = by_surface(simplified, surface_of);
        let mut palettes = vec![false; vertices.len()];
        for (surface, own) in by_surface(indices, surface_of) {
            for set in 0..2 {
                let uv = |index: u32| source.uvs(vertices[index as usize])[set];
                let position = |index: u32| points[index as usize].position;
                let mut lengths = UvLengths::new(&own, position, uv);
                if let Some(simplified) = simplified.get(&surface) {
                    lengths.add(simplified, is_other, position, uv);
                }
                for ((index, point), is_palette) in (0..).zip(&mut points).zip(&mut palettes) {
                    if surface_of(index) == surface {
                        *is_palette |= lengths.is_palette(index);
                        let place = uv(index) * lengths.along(index);
                        point.looks[set] = if place.is_finite() { place } else { DVec2::ZERO };
                    }
                }
            }
            if source.surfaces()[surface as usize].layout.color {
                let color = |index: u32| source.color(vertices[index as usize]);
                let length = color_length(own.iter().map(|at| points[*at as usize].position));
                for (index, point) in (0..).zip(&mut points) {
                    if surface_of(index) == surface {
                        let [red, green, blue, alpha] = color(index).map(|one| one * length);
                        point.looks[2] = DVec2::new(red, green);
                        point.looks[3] = DVec2::new(blue, alpha);
                    }
                }
            }
        }
        // Those of a file may be a thousandth too long or too short, which looks like 2.5 degrees.
        let normal = |vertex: &u32| source.normal(*vertex).normalize_or_zero();
        Self { points, normals: vertices.iter().map(normal).collect(), palettes }
    }

    /// Returns its vertices' places in space and on the textures.
    pub fn points(&self) -> &[SurfacePoint] {
        &self.points
    }

    /// Adds the change at vertices that `before` uses and `after` does not. `charts` are those of
    /// `before`, and `nearest` gives the triangle of `after` that is nearest to a vertex in space.
    pub fn change(
        &self,
        (before, after): (&[u32], &[u32]),
        charts: &Charts,
        after_set: &TriangleSet,
        nearest: impl Fn(u32) -> Nearest,
        change: &mut Change,
    ) {
        let mut is_removed = vec![false; self.points.len()];
        for index in before {
            is_removed[*index as usize] = true;
        }
        for index in after {
            is_removed[*index as usize] = false;
        }
        let removed = (0..).zip(is_removed).filter_map(|(index, is)| is.then_some(index));
        for index in removed {
            let near = nearest(index).triangle;
            let chart = charts.of(index);
            let near_corners = &after[near as usize * 3..][..3];
            let is_drawn = !self.palettes[index as usize]
                && near_corners.iter().all(|corner| charts.of(*corner) == chart);
            let slide_max = if is_drawn { charts.length(index) } else { charts.width(index) };
            let fit = self.best_fit(index, (after, after_set), near, slide_max);
            let slide = fit.distance;
            let normals = fit.corners.iter().zip(fit.shares);
            let normal: DVec3 = normals.map(|(at, share)| self.normals[*at as usize] * share).sum();
            let cosine = normal.normalize_or_zero().dot(self.normals[index as usize]);
            if is_drawn || slide < slide_max {
                change.slide = change.slide.max(slide.min(slide_max));
            } else if slide_max > 0.0 {
                let most = change.lost.entry(chart).or_insert(slide_max);
                *most = most.max(slide);
            }
            change.normal_angle = change.normal_angle.max(cosine.clamp(-1.0, 1.0).acos());
        }
    }

    /// Adds the slide at vertices that `after` uses and `before` does not: coordinates that go on
    /// from where a corner came may be those of another place. `set` and `charts` are those of
    /// `before`.
    pub fn change_of_added(
        &self,
        (before, set): (&[u32], &TriangleSet),
        after: &[u32],
        charts: &Charts,
        change: &mut Change,
    ) {
        let mut is_known = vec![false; self.points.len()];
        for index in before {
            is_known[*index as usize] = true;
        }
        // Neighbours in the list are neighbours in space.
        let mut guess = 0;
        for &index in after {
            // Each once.
            if std::mem::replace(&mut is_known[index as usize], true) {
                continue;
            }
            let fit = self.best_fit(index, (before, set), guess, f64::INFINITY);
            let near = SurfacePoint::mix(&self.corner_points(fit.corners), fit.shares);
            let apart = near.position.distance(self.points[index as usize].position);
            let looks = (fit.distance * fit.distance - apart * apart).max(0.0).sqrt();
            let slide = apart.max(looks).min(charts.length(fit.corners[0]));
            change.slide = change.slide.max(slide);
            guess = fit.triangle;
        }
    }

    /// Returns the point of triangles that a vertex fits best, in space, on the textures and in
    /// colour, if it is nearer than `limit`; else one of the triangle `guess`, or a nearer one.
    fn best_fit(
        &self,
        index: u32,
        (triangles, set): (&[u32], &TriangleSet),
        guess: u32,
        limit: f64,
    ) -> Fit {
        let point = self.points[index as usize];
        let fit = |triangle: u32| {
            let first = triangle as usize * 3;
            let corners = [triangles[first], triangles[first + 1], triangles[first + 2]];
            let points = self.corner_points(corners);
            let shares = shares_of_nearest(point, &points);
            let distance = point.distance(SurfacePoint::mix(&points, shares));
            Fit { distance, triangle, corners, shares }
        };
        let mut best = fit(guess);
        set.visit_within(point.position, best.distance.min(limit), |triangle| {
            let other = fit(triangle);
            if other.distance < best.distance {
                best = other;
            }
            best.distance.min(limit)
        });
        best
    }

    fn corner_points(&self, corners: [u32; 3]) -> [SurfacePoint; 3] {
        corners.map(|corner| self.points[corner as usize])
    }
}

/// Returns the slide that counts as much as a colour that is off by all that a component can be:
/// over a share of a surface, of which these are the points.
pub(super) fn color_length(points: impl Iterator<Item = DVec3>) -> f64 {
    COLOR_SLIDE * width::of_points(points)
}

/// Texture units on a surface that is shown by single places of its texture, such as the colours of
/// a palette: triangles of which one unit would be longer than so many diagonals of the box around
/// the surface have one place each.
const PALETTE_UNITS: f64 = 1024.0;

/// Triangles with more than so many times the area on the texture by that on the surface of the
/// middle one do not count for the average: one stray texture coordinate would make the units of
/// all others short, and the slides of textures with them.
const STRAY_DENSITY: f64 = 16.0;

/// How long texture units are on a surface.
#[derive(Debug, Default)]
pub(super) struct UvLengths {
    /// Of both coordinates, on average, where triangles have an area on the texture, but for
    /// strays; 0 if that has no meaning.
    textured: DVec2,
    /// Of vertices whose triangles have one place of the texture each: any two of those are as far
    /// from each other as can be.
    palette: f64,
    palette_vertices: HashSet<u32>,
}

impl UvLengths {
    /// The lengths on these triangles: their product is their area on the surface by that on the
    /// texture, and one by the other is as on the middle triangle. See [`STRAY_DENSITY`] for those
    /// that are left out.
    pub fn new(
        indices: &[u32],
        position: impl Fn(u32) -> DVec3,
        uv: impl Fn(u32) -> DVec2,
    ) -> Self {
        let Some(first) = indices.first().map(|index| uv(*index)) else { return Self::default() };
        // Nothing to tell apart, as where there are none.
        if indices.iter().all(|index| uv(*index) == first) {
            return Self::default();
        }
        let bounds = indices.iter().map(|index| (position(*index), position(*index)));
        let bounds = bounds.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        let palette = bounds.map_or(0.0, |(min, max)| (max - min).length()) * PALETTE_UNITS;
        let textured = DVec2::ZERO;
        let mut lengths = Self { textured, palette, palette_vertices: HashSet::new() };
        let areas = lengths.add(indices, |_| true, &position, &uv);
        let density = |[own, of]: [f64; 2]| [of / own, own];
        let densities = areas.iter().filter(|[own, _]| *own > 0.0).map(|of| density(*of));
        let densest = middle(densities).unwrap_or(f64::INFINITY) * STRAY_DENSITY;
        let (mut area, mut texture_area) = (0.0, 0.0);
        for [own, own_texture] in areas {
            if own_texture <= own * densest {
                area += own;
                texture_area += own_texture;
            }
        }
        let length = (area / texture_area).sqrt();
        let triangles = indices.as_chunks::<3>().0.iter();
        let stretches = triangles
            .filter_map(|corners| stretch(corners.map(&position), corners.map(&uv), palette));
        let stretch = middle(stretches).unwrap_or(1.0).sqrt();
        let both = DVec2::new(length * stretch, length / stretch);
        lengths.textured = if both.is_finite() { both } else { DVec2::ZERO };
        lengths
    }

    /// Adds the vertices of triangles for which `is_new` holds. Gives the areas of each triangle
    /// that is textured, on the surface and on the texture; one without either is not drawn.
    pub fn add(
        &mut self,
        indices: &[u32],
        is_new: impl Fn(u32) -> bool,
        position: impl Fn(u32) -> DVec3,
        uv: impl Fn(u32) -> DVec2,
    ) -> Vec<[f64; 2]> {
        let (mut textured, mut areas) = (Vec::new(), Vec::new());
        for corners in indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(&position);
            let own = (b - a).cross(c - a).length();
            let [a, b, c] = corners.map(&uv);
            let own_texture = (b - a).perp_dot(c - a).abs();
            if own > own_texture * self.palette * self.palette {
                self.palette_vertices.extend(corners.iter().filter(|at| is_new(**at)));
            } else if own_texture > 0.0 {
                textured.push(corners);
                areas.push([own, own_texture]);
            }
        }
        if !self.palette_vertices.is_empty() {
            for corner in textured.into_iter().flatten().filter(|at| is_new(**at)) {
                self.palette_vertices.remove(corner);
            }
        }
        areas
    }

    /// The lengths of units of both texture coordinates at a vertex.
    pub fn along(&self, index: u32) -> DVec2 {
        if self.is_palette(index) { DVec2::splat(self.palette) } else { self.textured }
    }

    /// The longer one of these lengths.
    pub fn at(&self, index: u32) -> f64 {
        self.along(index).max_element()
    }

    /// Returns whether a vertex has a colour of a palette.
    pub fn is_palette(&self, index: u32) -> bool {
        self.palette_vertices.contains(&index)
    }
}

/// Returns how long a unit of the first texture coordinate is on a triangle by one of the second,
/// and twice the triangle's area; `None` if it has no texture, or a single place of a palette, of
/// which a unit is `palette` long.
fn stretch([a, b, c]: [DVec3; 3], uvs: [DVec2; 3], palette: f64) -> Option<[f64; 2]> {
    let (edge, other) = (b - a, c - a);
    let (uv, other_uv) = (uvs[1] - uvs[0], uvs[2] - uvs[0]);
    let (own, own_texture) = (edge.cross(other).length(), uv.perp_dot(other_uv).abs());
    // The ways along which one coordinate stays as it is, both by the area on the texture.
    let first = (edge * other_uv.y - other * uv.y).length();
    let second = (other * uv.x - edge * other_uv.x).length();
    let ratio = first / second;
    let is_textured = own > 0.0 && own_texture > 0.0 && own <= own_texture * palette * palette;
    (is_textured && ratio > 0.0 && ratio.is_finite()).then_some([ratio, own])
}

/// Returns the median of values with their weights, which follow them.
fn middle(values: impl Iterator<Item = [f64; 2]>) -> Option<f64> {
    let mut sorted: Vec<[f64; 2]> = values.collect();
    sorted.sort_unstable_by(|one, two| one[0].total_cmp(&two[0]));
    let half = sorted.iter().map(|[_, weight]| weight).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let middle = sorted.iter().find(|[_, weight]| {
        sum += weight;
        sum >= half
    });
    middle.map(|[value, _]| *value)
}
