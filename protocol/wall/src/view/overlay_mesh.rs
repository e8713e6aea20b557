//! The pixels of a warped channel that show a rectangle of its screen's canvas, each with its place
//! in the rectangle: a part of the mesh of the channel's warp.
//!
//! Pixels belong to the rectangle that their middles are in. Where a form says where pixels lie,
//! the mesh is divided until it is right on the canvas too, so that a dome's pole is right to the
//! pixel; triangles of files are cut at the rectangle's border.

use glam::{DVec2, DVec3};

use crate::calibration_maps::CalibrationMaps;
use crate::channel_mapping::ChannelMapping;
use crate::wall_geometry::{ResolvedWall, ScreenGeometry};
use crate::warp::{MapCoordinates, WarpGeometry, WarpMap};
use crate::warp_mesh::reach::{CellPlaces, CellReach};
use crate::warp_mesh::{TessellationOptions, WarpMesh, WarpVertex};
use crate::{Channel, ChannelId, ChannelKind, Surface};

/// The space of a mesh's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointSpace {
    /// The surface's, in metres of display space.
    Surface,
    /// The canvas's: x right and y up in its pixels from the rectangle's upper left, z −1, so that
    /// from an eye at the origin the rectangle is a picture on the plane z = −1.
    Canvas,
}

/// A rectangle of a canvas, in its pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CanvasRect {
    /// Its upper left corner.
    pub begin: DVec2,
    /// Its lower right corner.
    pub end: DVec2,
}

/// The position of a place of a channel's picture.
#[derive(Clone, Copy, Debug)]
struct MappedPoint {
    canvas: DVec2,
    surface: DVec3,
}

impl ResolvedWall<'_> {
    /// The pixels of a warped channel that show a part of its screen's canvas; of nothing where
    /// none does.
    ///
    /// # Errors
    /// The pins leave no picture, a file is not there, or its points have no place on the canvas.
    pub fn overlay_mesh(
        &self,
        maps: &CalibrationMaps,
        id: ChannelId,
        part: CanvasRect,
        of: PointSpace,
    ) -> Result<WarpMesh, String> {
        let channel = self.wall.channel(id).ok_or("the wall has no such channel")?;
        let screen = self.wall.screen_of(channel);
        let ground = self.shapes.screen(screen);
        let pixels = self.channel_mapping(id).ok_or("its corner pins leave no picture")?;
        let around = screen.surface.u_of_turn().map(|turn| turn * f64::from(screen.canvas.x));
        let file = match (channel.adjustment.warp, &screen.surface) {
            (Some(file), _) => Some(file),
            (None, Surface::Mesh(file)) => Some(*file),
            (None, _) => None,
        };
        let map = match file {
            Some(file) => Some(maps.warp(file).ok_or("its file is not there")?),
            None => None,
        };
        let mut mesh = WarpMesh::default();
        for part in part.halves(around) {
            let slice = CanvasStrip { part: part.1, middle: part.0, around, origin: part.2, of };
            slice.add(&mut mesh, (channel, &ground), &pixels, map);
        }
        Ok(mesh)
    }
}

impl Surface {
    /// Returns the step of u that leads back to the same point, once around; `None` if u never
    /// returns.
    fn u_of_turn(&self) -> Option<f64> {
        let [left, right] = match self {
            Self::Cylinder(cylinder) => cylinder.azimuth_rad,
            Self::Sphere(sphere) => sphere.azimuth_rad,
            Self::Plane(_) | Self::Mesh(_) => return None,
        };
        Some((std::f64::consts::TAU / (right - left)).abs())
    }
}

impl CanvasRect {
    /// The part by pieces of which none is longer than half a turn around the screen, each with
    /// its middle and with where the whole begins: what lies behind is nearer to no piece.
    fn halves(self, around: Option<f64>) -> Vec<(f64, Self, DVec2)> {
        let whole = self.end.x - self.begin.x;
        let is_long = around.is_some_and(|around| whole > around / 2.0);
        let middle = f64::midpoint(self.begin.x, self.end.x);
        let edges = if is_long {
            vec![self.begin.x, middle, self.end.x]
        } else {
            vec![self.begin.x, self.end.x]
        };
        let piece = |pair: &[f64]| {
            let (begin, end) = (DVec2::new(pair[0], self.begin.y), DVec2::new(pair[1], self.end.y));
            (f64::midpoint(pair[0], pair[1]), Self { begin, end }, self.begin)
        };
        edges.windows(2).map(piece).collect()
    }

    fn holds(&self, canvas: DVec2) -> bool {
        canvas.cmpge(self.begin).all() && canvas.cmplt(self.end).all()
    }
}

/// A piece of a part, and how its points are told.
#[derive(Clone, Copy, Debug)]
struct CanvasStrip {
    part: CanvasRect,
    /// The x of the strip's middle: of all turns around the screen, the nearest to it is meant.
    middle: f64,
    /// Pixels of the canvas of a whole turn, where there is one.
    around: Option<f64>,
    /// The upper left corner of the whole part.
    origin: DVec2,
    of: PointSpace,
}

impl CanvasStrip {
    fn add(
        &self,
        onto: &mut WarpMesh,
        (channel, ground): (&Channel, &ScreenGeometry<'_>),
        pixels: &ChannelMapping<'_>,
        map: Option<&WarpMap>,
    ) {
        let screen = ground.screen;
        let place_of = |pixel: DVec2| match map {
            None => {
                let canvas = pixels.canvas_from_pixel(pixel)?;
                Some(MappedPoint { canvas, surface: pixels.display_from_pixel(pixel)? })
            }
            Some(WarpMap { space, shape: WarpGeometry::Grid(grid) }) => {
                let meant = pixels.ideal_from_pixel(pixel)? / channel.size.as_dvec2();
                let value = grid.value_at(meant)?;
                Some(match space {
                    MapCoordinates::Canvas => {
                        let canvas = value.truncate() * screen.canvas.as_dvec2();
                        MappedPoint { canvas, surface: screen.display_from_canvas(canvas)? }
                    }
                    MapCoordinates::Display => {
                        MappedPoint { canvas: pixels.canvas_from_point(value)?, surface: value }
                    }
                })
            }
            Some(_) => None,
        };
        let is_tile_of_mesh =
            matches!(screen.surface, Surface::Mesh(_)) && channel.adjustment.warp.is_none();
        let mesh = match map {
            Some(map) if matches!(map.shape, WarpGeometry::Mesh(_)) => {
                let whole = if is_tile_of_mesh {
                    map.screen_mesh(channel, ground, pixels)
                } else {
                    map.channel_mesh(channel, ground, pixels)
                };
                self.cut(&whole, |vertex| {
                    if is_tile_of_mesh {
                        return Some(
                            channel.origin.as_dvec2() + pixels.ideal_from_pixel(vertex.pixel)?,
                        );
                    }
                    pixels.canvas_from_point(vertex.point)
                })
            }
            _ => {
                let point = |pixel| {
                    let place = place_of(pixel)?;
                    let canvas = self.turned(place.canvas);
                    self.part.holds(canvas).then(|| self.point(canvas, place.surface))
                };
                let is_mixed = |cell: &CellPlaces| {
                    let canvas = |pixel| Some(self.turned(place_of(pixel)?.canvas));
                    let reach = CellReach::new(cell, canvas).on_turn(self.around);
                    let CanvasRect { begin, end } = self.part;
                    let is_holed = || Self::is_holed(map, cell, (channel, pixels));
                    reach.crosses(begin, end) || (!reach.is_beside(begin, end) && is_holed())
                };
                let rule = TessellationOptions::default();
                WarpMesh::with_borders(channel.size, rule, point, is_mixed)
            }
        };
        let first = onto.vertices.len() as u32;
        onto.vertices.extend(mesh.vertices);
        onto.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|at| at + first)));
    }

    /// Returns whether a map leaves a part of a cell dark, but not all of it.
    fn is_holed(
        map: Option<&WarpMap>,
        cell: &CellPlaces,
        (channel, pixels): (&Channel, &ChannelMapping<'_>),
    ) -> bool {
        let Some(WarpMap { shape: WarpGeometry::Grid(grid), .. }) = map else { return false };
        let size = channel.size.as_dvec2();
        grid.is_mixed(CellReach::new(cell, |pixel| Some(pixels.ideal_from_pixel(pixel)? / size)))
    }

    /// Returns the same place of the canvas, in the nearest of all turns.
    fn turned(&self, canvas: DVec2) -> DVec2 {
        let Some(around) = self.around else { return canvas };
        let turns = ((self.middle - canvas.x) / around).round();
        DVec2::new(canvas.x + turns * around, canvas.y)
    }

    fn point(&self, canvas: DVec2, surface: DVec3) -> DVec3 {
        match self.of {
            PointSpace::Surface => surface,
            PointSpace::Canvas => {
                let at = canvas - self.origin;
                DVec3::new(at.x, -at.y, -1.0)
            }
        }
    }

    /// Returns the part of the triangles inside. Corners whose place is not known leave a hole.
    fn cut(&self, whole: &WarpMesh, canvas_of: impl Fn(&WarpVertex) -> Option<DVec2>) -> WarpMesh {
        let places: Vec<Option<DVec2>> = whole
            .vertices
            .iter()
            .map(|vertex| canvas_of(vertex).map(|at| self.turned(at)))
            .collect();
        let mut mesh = WarpMesh::default();
        for triangle in &whole.triangles {
            let corner = |at: u32| {
                let WarpVertex { pixel, point } = whole.vertices[at as usize];
                Some(ClipVertex { canvas: places[at as usize]?, pixel, point })
            };
            let corners: Option<Vec<ClipVertex>> = triangle.iter().map(|at| corner(*at)).collect();
            let Some(corners) = corners else { continue };
            let (low, high) =
                corners.iter().fold((f64::INFINITY, -f64::INFINITY), |span, corner| {
                    (span.0.min(corner.canvas.x), span.1.max(corner.canvas.x))
                });
            if self.around.is_some_and(|around| high - low > around / 2.0) {
                // It lies behind, where turns change: in another piece it is whole.
                continue;
            }
            let polygon = clipped(corners, &self.part);
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(polygon.iter().map(|corner| WarpVertex {
                pixel: corner.pixel,
                point: self.point(corner.canvas, corner.point),
            }));
            let fan = 1..(polygon.len() as u32).saturating_sub(1);
            mesh.triangles.extend(fan.map(|at| [first, first + at, first + at + 1]));
        }
        mesh
    }
}

/// A corner of a triangle that is cut.
#[derive(Clone, Copy, Debug)]
struct ClipVertex {
    canvas: DVec2,
    pixel: DVec2,
    point: DVec3,
}

/// Returns the part of a convex polygon in a rectangle: I. Sutherland, G. Hodgman, *Reentrant
/// Polygon Clipping*, 1974. Crossings are computed from the corner with the lesser coordinate, so
/// that the rectangles at both sides of a line get the same ones.
fn clipped(polygon: Vec<ClipVertex>, part: &CanvasRect) -> Vec<ClipVertex> {
    let edges = [(0, part.begin.x, 1.0), (0, part.end.x, -1.0), (1, part.begin.y, 1.0)]
        .into_iter()
        .chain([(1, part.end.y, -1.0)]);
    edges.fold(polygon, |polygon, (axis, line, inward)| {
        let depth = |corner: &ClipVertex| (corner.canvas[axis] - line) * inward;
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (at, corner) in polygon.iter().enumerate() {
            let next = &polygon[(at + 1) % polygon.len()];
            if depth(corner) >= 0.0 {
                kept.push(*corner);
            }
            if (depth(corner) > 0.0 && depth(next) < 0.0)
                || (depth(corner) < 0.0 && depth(next) > 0.0)
            {
                let is_rising = corner.canvas[axis] <= next.canvas[axis];
                let (low, high) = if is_rising { (corner, next) } else { (next, corner) };
                let share = (line - low.canvas[axis]) / (high.canvas[axis] - low.canvas[axis]);
                let mut canvas = low.canvas.lerp(high.canvas, share);
                canvas[axis] = line;
                kept.push(ClipVertex {
                    canvas,
                    pixel: low.pixel.lerp(high.pixel, share),
                    point: low.point.lerp(high.point, share),
                });
            }
        }
        kept
    })
}

impl Channel {
    /// Returns whether its pixels are not those of its screen's canvas, one to one.
    pub(super) fn is_warped(&self) -> bool {
        let adjustment = &self.adjustment;
        self.cover != ChannelKind::Tile
            || adjustment.warp.is_some()
            || adjustment.bend.is_some()
            || adjustment.pin != [DVec2::ZERO; 4]
    }
}
