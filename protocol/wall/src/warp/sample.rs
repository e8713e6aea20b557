//! From a decoded map to the mesh that a channel is drawn through.

use glam::{DVec2, DVec3, UVec2};

use super::{ImportedMesh, MapCoordinates, WarpGeometry, WarpGrid, WarpMap};
use crate::Channel;
use crate::channel_mapping::ChannelMapping;
use crate::wall_geometry::ScreenGeometry;
use crate::warp_mesh::clip::SNAP_PX;
use crate::warp_mesh::reach::{CellPlaces, CellReach};
use crate::warp_mesh::refine::Refinement;
use crate::warp_mesh::{TessellationOptions, WarpMesh as ChannelMesh, WarpVertex};

/// Maximum length of a triangle's edge in pixels where lines are lines, so that no triangle spans
/// more than one plane of a source can.
const STRAIGHT_EDGE_PX: f64 = 256.0;

/// Maximum distance between a side of a canvas and a place that counts as on it, as a share of the
/// side: the rounding of f32.
const SNAP_UV: f64 = 1e-7;

/// Maximum distance between a place and the centre of a cell that counts as at it, in cells: the
/// rounding of places that pins and bends move.
const SNAP_CELL: f64 = 1e-7;

impl WarpMap {
    /// The mesh of a channel whose pixels lie where this map says; `pixels` has its corner pins
    /// and bends. Places between cells of a grid are unlit where one of these is. What a mesh has
    /// beside the picture is cut off.
    pub fn channel_mesh(
        &self,
        channel: &Channel,
        ground: &ScreenGeometry<'_>,
        pixels: &ChannelMapping<'_>,
    ) -> ChannelMesh {
        let size = channel.size.as_dvec2();
        match &self.shape {
            WarpGeometry::Grid(grid) => {
                let place = |pixel| Some(pixels.ideal_from_pixel(pixel)? / size);
                let point = |pixel| self.display_from_value(grid.value_at(place(pixel)?)?, ground);
                let is_mixed = |cell: &CellPlaces| grid.is_mixed(CellReach::new(cell, place));
                let rule = TessellationOptions::default();
                ChannelMesh::with_borders(channel.size, rule, point, is_mixed)
            }
            WarpGeometry::Mesh(mesh) => {
                let meant = mesh.placed(|place| place * size);
                let meant = meant.within_rect(DVec2::ZERO, size, SNAP_PX);
                self.drawn(meant, channel, ground, pixels)
            }
        }
    }

    /// The mesh of a tile of a screen whose surface this is: its places are those of the canvas.
    /// Parts beside the tile are cut off.
    pub fn screen_mesh(
        &self,
        channel: &Channel,
        ground: &ScreenGeometry<'_>,
        pixels: &ChannelMapping<'_>,
    ) -> ChannelMesh {
        let WarpGeometry::Mesh(mesh) = &self.shape else { return ChannelMesh::default() };
        let (canvas, origin) = (ground.screen.canvas.as_dvec2(), channel.origin.as_dvec2());
        let meant = mesh.placed(|place| place * canvas - origin);
        let meant = meant.within_rect(-origin, canvas - origin, SNAP_PX);
        self.drawn(meant, channel, ground, pixels)
    }

    /// The mesh of the whole screen whose surface this is: its places are u and v. `None` where it
    /// is no mesh of points in metres.
    pub fn surface(&self) -> Option<ChannelMesh> {
        let WarpGeometry::Mesh(mesh) = &self.shape else { return None };
        let is_in_room = self.space == MapCoordinates::Display;
        is_in_room.then(|| mesh.placed(|place| place).within_rect(DVec2::ZERO, DVec2::ONE, SNAP_UV))
    }

    /// Returns the mesh that a channel draws, from a mesh whose vertices are at places before pins
    /// and bends, and have values of this map.
    fn drawn(
        &self,
        meant: ChannelMesh,
        channel: &Channel,
        ground: &ScreenGeometry<'_>,
        pixels: &ChannelMapping<'_>,
    ) -> ChannelMesh {
        let size = channel.size.as_dvec2();
        let is_unmoved =
            channel.adjustment.bend.is_none() && channel.adjustment.pin == [DVec2::ZERO; 4];
        let is_straight = is_unmoved
            && (self.space == MapCoordinates::Display || ground.screen.plane().is_some());
        let TessellationOptions { step_px, error_px } = TessellationOptions::default();
        let edge_px = if is_straight { STRAIGHT_EDGE_PX } else { f64::from(step_px) };
        let meant = if is_unmoved {
            meant.within_rect(DVec2::ZERO, size, SNAP_PX)
        } else {
            meant.cut(&pixels.lines_around_picture())
        };
        let drawn = meant.mapped(Refinement { edge_px, error_px }, |vertex| {
            let pixel = pixels.pixel_from_ideal(vertex.pixel)?;
            let point = self.display_from_value(vertex.point, ground)?;
            Some(WarpVertex { pixel, point })
        });
        drawn.within_rect(DVec2::ZERO, size, SNAP_PX)
    }

    fn display_from_value(&self, value: DVec3, ground: &ScreenGeometry<'_>) -> Option<DVec3> {
        match self.space {
            MapCoordinates::Display => Some(value),
            MapCoordinates::Canvas => {
                ground.display_from_canvas(value.truncate() * ground.screen.canvas.as_dvec2())
            }
        }
    }
}

impl ImportedMesh {
    /// Returns the triangles with their places mapped by `pixel_of` to a channel's pixels or to the
    /// picture; their points are the map's values.
    fn placed(&self, pixel_of: impl Fn(DVec2) -> DVec2) -> ChannelMesh {
        let vertex = |vertex: &super::ImportedVertex| WarpVertex {
            pixel: pixel_of(vertex.place.as_dvec2()),
            point: vertex.value.as_dvec3(),
        };
        let vertices = self.vertices.iter().map(vertex).collect();
        ChannelMesh { vertices, triangles: self.triangles.clone() }
    }
}

impl WarpGrid {
    /// The value at a place of the picture, linear between the centres of cells, and going on
    /// beyond the outermost ones. `None` where one of those around is unlit; at the centre of a
    /// cell only that cell counts.
    pub fn value_at(&self, place: DVec2) -> Option<DVec3> {
        let at = place * self.size.as_dvec2() - 0.5;
        let last = self.size.saturating_sub(UVec2::splat(2)).as_dvec2();
        let from = at.floor().clamp(DVec2::ZERO, last);
        let is_line = self.size.cmpgt(UVec2::ONE);
        let part = DVec2::select(is_line, at - from, DVec2::ZERO);
        let from = from.as_uvec2();
        let to = (from + 1).min(self.size - 1);
        let value = |x: u32, y: u32| {
            let value = self.values[y as usize * self.size.x as usize + x as usize];
            (!value.is_nan()).then(|| value.as_dvec3())
        };
        let row = |y: u32| between(value(from.x, y), value(to.x, y), part.x);
        between(row(from.y), row(to.y), part.y)
    }

    /// Returns whether some of the cells around these places of the picture are lit and others are
    /// not.
    pub(crate) fn is_mixed(&self, places: CellReach) -> bool {
        let CellReach::Within { low, high } = places else { return places == CellReach::Partly };
        let (scale, last) = (self.size.as_dvec2(), (self.size - 1).as_dvec2());
        // Beyond the outermost centres the two next to them count.
        let first = (low * scale - 0.5).floor().min(last - 1.0).max(DVec2::ZERO);
        let end = (high * scale - 0.5).ceil().max(first + 1.0).min(last);
        self.has_both(first.as_uvec2(), end.as_uvec2())
    }
}

/// Returns the value at a share of the way from one value to another; an end that has no weight
/// there need not be lit.
fn between(a: Option<DVec3>, b: Option<DVec3>, part: f64) -> Option<DVec3> {
    if part.abs() < SNAP_CELL {
        a
    } else if (1.0 - part).abs() < SNAP_CELL {
        b
    } else {
        Some(a? + (b? - a?) * part)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::surface::Plane;
    use crate::wall_geometry::WallGeometry;
    use crate::{Screen, Surface};

    fn stage() -> (Channel, Screen) {
        let plane = Plane {
            lower_left: DVec3::new(-2.0, -1.0, -3.0),
            lower_right: DVec3::new(2.0, -1.0, -3.0),
            upper_left: DVec3::new(-2.0, 1.0, -3.0),
        };
        let screen = Screen::new("s", Surface::Plane(plane), UVec2::new(400, 200));
        (Channel::tile("c", 0, UVec2::ZERO, UVec2::new(80, 40)), screen)
    }

    /// A grid of values at cells' centres, by place.
    fn grid(size: UVec2, value: impl Fn(Vec2) -> Vec3) -> WarpGeometry {
        let place = |i: u32| Vec2::new((i % size.x) as f32 + 0.5, (i / size.x) as f32 + 0.5);
        let values = (0..size.x * size.y).map(|i| value(place(i) / size.as_vec2())).collect();
        WarpGeometry::Grid(WarpGrid::new(size, values))
    }

    /// The whole canvas by u and v is the screen itself, to its corners, of any grid.
    #[test]
    fn places_of_the_canvas_are_points_of_the_screen() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("no pins");
        for size in [[2, 2], [5, 3], [80, 40]] {
            let shape = grid(UVec2::from(size), |place| place.extend(0.0));
            let warp = WarpMap { space: MapCoordinates::Canvas, shape };
            let mesh = warp.channel_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
            for at in [[0.0, 0.0], [80.0, 40.0], [13.0, 37.5], [79.5, 0.5]] {
                let at = DVec2::from(at);
                let due = screen.display_from_canvas(at * 5.0).expect("a plane");
                let found = mesh.point_at(at).expect("lit");
                assert!(found.distance(due) < 1e-6, "{size:?} at {at}: {found}, {due}");
            }
        }
    }

    #[test]
    fn points_are_linear_between_cells_and_unlit_beside_unlit_ones() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("no pins");
        let shape = grid(UVec2::new(8, 4), |place| {
            if place.x > 0.5 { Vec3::NAN } else { Vec3::new(place.x, place.y * 2.0, -1.0) }
        });
        let warp = WarpMap { space: MapCoordinates::Display, shape };
        let mesh = warp.channel_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
        let found = mesh.point_at(DVec2::new(20.0, 20.0)).expect("lit");
        assert!(found.distance(DVec3::new(0.25, 1.0, -1.0)) < 1e-6, "{found}");
        assert_eq!(mesh.point_at(DVec2::new(45.0, 20.0)), None);
        let WarpGeometry::Grid(grid) = &warp.shape else { panic!("a grid") };
        assert_eq!(grid.value_at(DVec2::new(0.47, 0.5)), None, "beside an unlit cell");
    }

    /// One unlit value of a map that has one for each pixel darkens that pixel alone.
    #[test]
    fn an_unlit_value_darkens_no_pixel_beside_it() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("no pins");
        let hole = DVec2::new(32.5, 20.5);
        let shape = grid(channel.size, |place| {
            let at = place.as_dvec2() * DVec2::new(80.0, 40.0);
            if at.distance(hole) < 0.5 { Vec3::NAN } else { place.extend(0.0) }
        });
        let warp = WarpMap { space: MapCoordinates::Canvas, shape };
        let mesh = warp.channel_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
        for (x, y) in (-2..=2).flat_map(|y| (-2..=2).map(move |x| (x, y))) {
            let at = hole + DVec2::new(f64::from(x), f64::from(y));
            let found = mesh.point_at(at);
            assert_eq!(found.is_none(), at == hole, "{at}: {found:?}");
            if let Some(found) = found {
                let due = screen.display_from_canvas(at * 5.0).expect("a plane");
                assert!(found.distance(due) < 1e-6, "{at}: {found}, {due}");
            }
        }
    }

    /// A hole, and something lit, between the places at which the largest cells are looked at.
    #[test]
    fn no_hole_is_passed_over_and_nothing_lit_is_lost() {
        let (mut channel, screen) = stage();
        let is_in = |place: Vec2| {
            let at = place * Vec2::new(80.0, 40.0);
            at.cmpgt(Vec2::new(40.0, 22.0)).all() && at.cmplt(Vec2::new(60.0, 38.0)).all()
        };
        for (is_hole, is_pinned) in [(true, false), (true, true), (false, false), (false, true)] {
            if is_pinned {
                channel.adjustment.pin[1] = DVec2::new(-2.0, 1.0);
            } else {
                channel.adjustment.pin = [DVec2::ZERO; 4];
            }
            let pixels = ChannelMapping::new(&channel, &screen).expect("a picture");
            let shape = grid(channel.size, |place| {
                if is_in(place) == is_hole { Vec3::NAN } else { place.extend(0.0) }
            });
            let WarpGeometry::Grid(values) = &shape else { panic!("a grid") };
            let due = |pixel: DVec2| {
                let meant = pixels.ideal_from_pixel(pixel).expect("a place");
                values.value_at(meant / channel.size.as_dvec2()).is_some()
            };
            let (space, shape) = (MapCoordinates::Canvas, shape.clone());
            let warp = WarpMap { space, shape };
            let mesh = warp.channel_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
            for (x, y) in (0..40).flat_map(|y| (0..80).map(move |x| (x, y))) {
                let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let is_lit = mesh.point_at(pixel).is_some();
                assert_eq!(is_lit, due(pixel), "{pixel}, hole {is_hole}, pinned {is_pinned}");
            }
        }
    }

    #[test]
    fn a_tile_of_a_mesh_has_the_triangles_that_reach_into_it() {
        let (mut channel, screen) = stage();
        channel.origin = UVec2::new(200, 100);
        let pixels = ChannelMapping::new(&channel, &screen).expect("no pins");
        // 10 × 10 cells of 40 × 20 pixels of the canvas.
        let vertex = |i: u32| {
            let place = Vec2::new((i % 11) as f32, (i / 11) as f32) / 10.0;
            super::super::ImportedVertex { place, value: place.extend(-2.0), light: 1.0 }
        };
        let cell = |i: u32| {
            let at = i / 10 * 11 + i % 10;
            [[at, at + 1, at + 11], [at + 11, at + 1, at + 12]]
        };
        let (vertices, triangles) = ((0..121).map(vertex).collect(), (0..100).flat_map(cell));
        let mesh = ImportedMesh { vertices, triangles: triangles.collect() };
        let warp = WarpMap { space: MapCoordinates::Display, shape: WarpGeometry::Mesh(mesh) };
        let mesh = warp.screen_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
        // 80 × 40 pixels from (200, 100): two by two cells and no other.
        assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (8, 9));
        for at in [[0.5, 0.5], [79.5, 39.5], [13.0, 37.5]] {
            let at = DVec2::from(at);
            let due = ((at + DVec2::new(200.0, 100.0)) / DVec2::new(400.0, 200.0)).extend(-2.0);
            let found = mesh.point_at(at).expect("lit");
            assert!(found.distance(due) < 1e-6, "{found}, {due}");
        }
    }

    #[test]
    fn a_mesh_keeps_its_triangles_at_its_pixels() {
        let (channel, screen) = stage();
        let pixels = ChannelMapping::new(&channel, &screen).expect("no pins");
        let vertex = |u: f32, v: f32| {
            let (place, value) = (Vec2::new(u, v), Vec3::new(u, v, 0.0));
            super::super::ImportedVertex { place, value, light: 1.0 }
        };
        let vertices = vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)];
        let mesh = ImportedMesh { vertices, triangles: vec![[0, 1, 2]] };
        let warp = WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Mesh(mesh) };
        let mesh = warp.channel_mesh(&channel, &WallGeometry::empty().screen(&screen), &pixels);
        let found = mesh.point_at(DVec2::new(20.0, 10.0)).expect("lit");
        let due = screen.display_from_canvas(DVec2::new(100.0, 50.0)).expect("a plane");
        assert!(found.distance(due) < 1e-9, "{found} {due}");
        assert_eq!(mesh.point_at(DVec2::new(70.0, 30.0)), None, "a hole");
    }
}
