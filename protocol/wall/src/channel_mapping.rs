//! Positions of a channel's pixels: on the canvas of its screen, and in display space.
//!
//! ```text
//! channel pixel --bend, pin--> tile's pixel --origin--> canvas --surface--> display space
//!                         or   projector's ray ------------------^
//!                         or   its warp file ------> display space --wall's eye--> canvas
//! ```
//!
//! Pixels are counted from the upper left corner of the upper left one: a pixel's middle is at
//! (x + 0.5, y + 0.5).

mod thrown_outline;

use glam::{DMat3, DVec2, DVec3};
use thrown_outline::ThrownOutline;

use super::channel_calibration::ControlGrid;
use super::mesh_bvh::MeshBvh;
use super::wall_geometry::{ResolvedWall, ScreenGeometry, WallGeometry};
use super::warp_mesh::reach::{CellPlaces, CellReach};
use super::warp_mesh::{TessellationOptions, WarpMesh};
use super::{Channel, ChannelKind, Screen, Surface, Wall};
use crate::ChannelId;

/// Steps of the search for the pixel that a bend moves to a place; each at least halves the error.
const UNBEND_STEPS: usize = 32;

/// Maximum distance of a place on a mesh's canvas from the position of the pixel that shows it, in
/// pixels of the canvas; beyond it, another layer of the mesh stands before the place.
const LAYER_PX: f64 = 1.0;

/// Maximum distance beyond the canvas of a place that counts as on its edge, in pixels: what f64
/// rounds by.
const EDGE_SLACK_PX: f64 = 1e-6;

/// The same where calibration files say where places are: what f32 rounds by.
const FILE_SLACK_PX: f64 = 0.01;

/// The places of one channel's pixels.
#[derive(Clone, Debug)]
pub struct ChannelMapping<'a> {
    channel: &'a Channel,
    ground: ScreenGeometry<'a>,
    /// Its warp, and the eye that sees it on the canvas.
    warp: Option<(&'a MeshBvh, DVec3)>,
    /// `true` if its projector stands behind the screen.
    is_rear: bool,
    /// From where a pixel is meant to be to where the pins move it, and back.
    pin: Option<(DMat3, DMat3)>,
}

impl Wall {
    /// Returns the mapping of a channel's pixels without its files
    /// ([`crate::wall_geometry::ResolvedWall::channel_mapping`] has them); `None` if there is no
    /// such channel, or if its pins leave no picture.
    pub fn channel_mapping(&self, id: ChannelId) -> Option<ChannelMapping<'_>> {
        ResolvedWall::from(self).channel_mapping(id)
    }
}

impl<'a> ChannelMapping<'a> {
    /// The map of a channel on its screen, without files; `None` where its pins leave no picture.
    pub fn new(channel: &'a Channel, screen: &'a Screen) -> Option<Self> {
        Self::with_geometry(channel, screen, WallGeometry::empty())
    }

    /// The map of a channel on its screen; `None` where its pins leave no picture.
    pub fn with_geometry(
        channel: &'a Channel,
        screen: &'a Screen,
        shapes: &'a WallGeometry,
    ) -> Option<Self> {
        let pin = match channel.adjustment.pin {
            moves if moves == [DVec2::ZERO; 4] => None,
            moves => {
                let size = channel.size.as_dvec2();
                let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(|at| at * size);
                let mut pinned = corners;
                pinned.iter_mut().zip(moves).for_each(|(corner, offset)| *corner += offset);
                let forth = homography(corners, pinned)?;
                Some((forth, homography(pinned, corners)?))
            }
        };
        let ground = shapes.screen(screen);
        let is_rear = match &channel.cover {
            ChannelKind::Projector(projector) => ground.is_rear(projector),
            ChannelKind::Tile | ChannelKind::Map => false,
        };
        Some(Self { channel, ground, warp: shapes.warp_of(channel), is_rear, pin })
    }

    /// The place of the screen's canvas, in pixels, that a place of the channel's picture shows.
    pub fn canvas_from_pixel(&self, pixel: DVec2) -> Option<DVec2> {
        let meant = self.ideal_from_pixel(pixel)?;
        match &self.channel.cover {
            ChannelKind::Tile => Some(self.channel.origin.as_dvec2() + meant),
            ChannelKind::Projector(_) => self.lit(meant).map(|(_, canvas)| canvas),
            ChannelKind::Map => {
                let (facets, eye) = self.warp?;
                self.ground.canvas_through(eye, facets.point_at(meant)?)
            }
        }
    }

    /// The place of the screen's canvas of a point of display space that the channel's warp names:
    /// where the wall's eye sees it, as for [`Self::canvas_from_pixel`].
    pub(crate) fn canvas_from_point(&self, point: DVec3) -> Option<DVec2> {
        match (&self.channel.cover, self.warp) {
            (ChannelKind::Map, Some((_, eye))) => self.ground.canvas_through(eye, point),
            _ => self.ground.screen.canvas_from_display(point),
        }
    }

    /// The place of the channel's picture that shows a place of the canvas; it may lie outside.
    pub fn pixel_from_canvas(&self, canvas: DVec2) -> Option<DVec2> {
        let point = match self.channel.cover {
            ChannelKind::Tile => None,
            _ => self.ground.display_from_canvas(canvas),
        };
        self.pixel_at(canvas, point)
    }

    /// Returns the pixel like [`Self::pixel_from_canvas`], for a place whose point of display space
    /// is known; only tiles need no point.
    pub(crate) fn pixel_at(&self, canvas: DVec2, point: Option<DVec3>) -> Option<DVec2> {
        let meant = match &self.channel.cover {
            ChannelKind::Tile => canvas - self.channel.origin.as_dvec2(),
            ChannelKind::Projector(projector) => {
                projector.project(point?)? * self.channel.size.as_dvec2()
            }
            ChannelKind::Map => self.warped_to(canvas, point?)?,
        };
        self.pixel_from_ideal(meant)
    }

    /// The point of display space, in metres, that a place of the channel's picture shows.
    pub fn display_from_pixel(&self, pixel: DVec2) -> Option<DVec3> {
        match (&self.channel.cover, self.warp) {
            (ChannelKind::Projector(projector), _) => {
                let meant = self.ideal_from_pixel(pixel)?;
                let direction = projector.direction(meant / self.channel.size.as_dvec2());
                self.point_along(direction)
            }
            (ChannelKind::Map, Some((facets, _))) => facets.point_at(self.ideal_from_pixel(pixel)?),
            _ => self.ground.display_from_canvas(self.canvas_from_pixel(pixel)?),
        }
    }

    /// Returns whether a place that [`Self::canvas_from_pixel`] gave lies on the canvas: light
    /// beside it falls on nothing.
    pub fn is_on_canvas(&self, canvas: DVec2) -> bool {
        let is_rounded = self.channel.cover == ChannelKind::Map || self.ground.is_mesh();
        let slack = DVec2::splat(if is_rounded { FILE_SLACK_PX } else { EDGE_SLACK_PX });
        let high = self.ground.screen.canvas.as_dvec2() + slack;
        canvas.cmpge(-slack).all() && canvas.cmple(high).all()
    }

    /// The point of display space, in metres, that is drawn at a place of the channel's picture:
    /// that of [`Self::display_from_pixel`], but none where a projector's light misses the canvas.
    pub fn drawn_from_pixel(&self, pixel: DVec2) -> Option<DVec3> {
        if !self.is_thrown() {
            return self.display_from_pixel(pixel);
        }
        let (point, canvas) = self.lit(self.ideal_from_pixel(pixel)?)?;
        self.is_on_canvas(canvas).then_some(point)
    }

    /// The mesh of all that [`Self::drawn_from_pixel`] gives. Channels that files place are drawn
    /// through that of [`ResolvedWall::drawn_mesh`].
    pub fn drawn_mesh(&self) -> WarpMesh {
        let canvas = self.ground.screen.canvas.as_dvec2();
        let outline = self.thrown_outline();
        // A screen that is small in a projector's picture may lie between places of a cell. Its
        // edges are too even to leave one between places that are all lit; holes of a mesh do.
        let is_mixed = |cell: &CellPlaces| {
            let reach = || CellReach::new(cell, |pixel| self.canvas_from_pixel(pixel));
            let meant = || CellReach::new(cell, |pixel| self.ideal_from_pixel(pixel));
            let ends = outline.as_ref().is_some_and(|outline| outline.crosses(meant()));
            ends || (self.is_thrown()
                && self.drawn_from_pixel(cell[4]).is_none()
                && reach().crosses(DVec2::ZERO, canvas))
        };
        let point = |pixel| self.drawn_from_pixel(pixel);
        let rule = TessellationOptions::default();
        WarpMesh::with_borders(self.channel.size, rule, point, is_mixed)
    }

    /// Returns the least and the largest corner of a part of the canvas, in its pixels, around all
    /// that a tile shows; `None` for other channels, and for pins so steep that there is no end.
    pub fn canvas_bounds(&self) -> Option<[DVec2; 2]> {
        if self.channel.cover != ChannelKind::Tile {
            return None;
        }
        let [low, high] = self.unbent_bounds();
        let back = self.pin.map_or(DMat3::IDENTITY, |(_, back)| back);
        let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in [low, DVec2::new(high.x, low.y), DVec2::new(low.x, high.y), high] {
            let canvas = self.channel.origin.as_dvec2() + project(back, corner)?;
            (least, most) = (least.min(canvas), most.max(canvas));
        }
        // Places between pixels are rounded by less than that.
        Some([least - 1.0, most + 1.0])
    }

    /// Returns the lines at which the mesh that a projector lights ends; `None` for other screens.
    fn thrown_outline(&self) -> Option<ThrownOutline> {
        let ChannelKind::Projector(projector) = &self.channel.cover else { return None };
        let (size, edges) = (self.channel.size.as_dvec2(), self.ground.outline());
        (!edges.is_empty()).then(|| ThrownOutline::new(projector, size, edges))
    }

    fn is_thrown(&self) -> bool {
        matches!(self.channel.cover, ChannelKind::Projector(_))
    }

    /// Returns whether everything that places its pixels is there; if not, a file is missing.
    pub fn is_resolved(&self) -> bool {
        match self.channel.cover {
            ChannelKind::Tile => true,
            ChannelKind::Projector(_) => {
                !matches!(self.ground.screen.surface, Surface::Mesh(_)) || self.ground.is_mesh()
            }
            ChannelKind::Map => self.warp.is_some(),
        }
    }

    /// Returns whether triangles of a file lie between pixels and places.
    pub(crate) fn is_faceted(&self) -> bool {
        self.warp.is_some() || self.ground.is_mesh()
    }

    /// The screen that it lies on.
    pub(crate) fn screen(&self) -> ScreenGeometry<'a> {
        self.ground
    }

    /// Returns the point that a projector lights with this place of its picture, and its place on
    /// the canvas.
    fn lit(&self, meant: DVec2) -> Option<(DVec3, DVec2)> {
        let ChannelKind::Projector(projector) = &self.channel.cover else { return None };
        self.lit_along(projector.direction(meant / self.channel.size.as_dvec2()))
    }

    /// Returns the point that a projector lights in this direction.
    pub(crate) fn point_along(&self, direction: DVec3) -> Option<DVec3> {
        let ChannelKind::Projector(projector) = &self.channel.cover else { return None };
        self.ground.point_side(projector.position, direction, self.is_rear)
    }

    /// Returns the point that a projector lights in this direction, and its place on the canvas.
    pub fn lit_along(&self, direction: DVec3) -> Option<(DVec3, DVec2)> {
        let ChannelKind::Projector(projector) = &self.channel.cover else { return None };
        self.ground.hit_side(projector.position, direction, self.is_rear)
    }

    /// Returns whether its projector stands behind the screen.
    pub fn is_rear(&self) -> bool {
        self.is_rear
    }

    /// The place that a warp shows at a place of the canvas.
    fn warped_to(&self, canvas: DVec2, point: DVec3) -> Option<DVec2> {
        let (facets, eye) = self.warp?;
        let hit = facets.hit(eye, point - eye, 1.0)?;
        if self.ground.is_mesh() {
            let back = self.ground.canvas_through(eye, hit.point)?;
            return (back.distance(canvas) <= LAYER_PX).then_some(hit.place);
        }
        Some(hit.place)
    }

    /// The place that the bend has moved to this one; `None` where the search does not settle.
    pub(crate) fn undistort(&self, pixel: DVec2) -> Option<DVec2> {
        match &self.channel.adjustment.bend {
            Some(bend) => bend.undo(pixel, self.channel.size.as_dvec2()),
            None => Some(pixel),
        }
    }

    /// The pixel whose light was meant to be where this one's is.
    pub fn ideal_from_pixel(&self, pixel: DVec2) -> Option<DVec2> {
        let unbent = self.undistort(pixel)?;
        self.pin.map_or(Some(unbent), |(_, back)| project(back, unbent))
    }

    /// Returns the least and the largest corner around all places that a bend moves into the
    /// picture, in pixels.
    fn unbent_bounds(&self) -> [DVec2; 2] {
        let margin = self.channel.adjustment.bend.as_ref().map_or(0.0, ControlGrid::reach);
        [DVec2::splat(-margin), self.channel.size.as_dvec2() + margin]
    }

    /// Lines around all places, before pins and bends, that are moved into the picture: for them
    /// no `line.dot((x, y, 1))` is negative. A bend leaves a margin.
    pub(crate) fn lines_around_picture(&self) -> [DVec3; 4] {
        let [low, high] = self.unbent_bounds();
        // In homogeneous coordinates, so that what lies behind the horizon of pins is cut off too:
        // J. Blinn, M. Newell, *Clipping using homogeneous coordinates*, 1978.
        let rows = self.pin.map_or(DMat3::IDENTITY, |(forth, _)| forth).transpose();
        let (x, y, w) = (rows.x_axis, rows.y_axis, rows.z_axis);
        [x - w * low.x, y - w * low.y, w * high.x - x, w * high.y - y]
    }

    /// The pixel that a place of the picture, before pins and bends, is moved to.
    pub fn pixel_from_ideal(&self, meant: DVec2) -> Option<DVec2> {
        let pinned = self.pin.map_or(Some(meant), |(forth, _)| project(forth, meant))?;
        Some(match &self.channel.adjustment.bend {
            Some(bend) => pinned + bend.offset(pinned / self.channel.size.as_dvec2()),
            None => pinned,
        })
    }
}

impl ControlGrid {
    /// A bound of how far any place is moved, in pixels: weights of a cubic sum up to 1.25 each
    /// way, and what goes on beyond the grid is at most three times as much as in it.
    fn reach(&self) -> f64 {
        let most = self.moves.iter().map(|by| by.length()).fold(0.0, f64::max);
        most * (3.0 * 1.25) * (3.0 * 1.25)
    }

    /// By how many pixels a place, (0, 0) to (1, 1), is moved; beside the grid as at its edge.
    pub(crate) fn offset(&self, place: DVec2) -> DVec2 {
        let last = (self.points - 1).as_ivec2();
        let at = place.clamp(DVec2::ZERO, DVec2::ONE) * last.as_dvec2();
        let cell = at.floor().as_ivec2().min(last - 1);
        let (x, y) = (weights(at.x - f64::from(cell.x)), weights(at.y - f64::from(cell.y)));
        let mut sum = DVec2::ZERO;
        for (row, wy) in (-1..=2).zip(y) {
            for (column, wx) in (-1..=2).zip(x) {
                sum += self.beyond(cell.x + column, cell.y + row) * (wx * wy);
            }
        }
        sum
    }

    /// The move of a grid point; beyond the grid's edge it goes on as a line, so that a grid that
    /// was moved evenly moves everything evenly.
    fn beyond(&self, column: i32, row: i32) -> DVec2 {
        let last = (self.points - 1).as_ivec2();
        let along = |c: i32, r: i32| {
            let at = r.clamp(0, last.y) * (last.x + 1) + c.clamp(0, last.x);
            self.moves[at as usize]
        };
        let across = |r: i32| match column {
            c if c < 0 => along(0, r) * 2.0 - along(1, r),
            c if c > last.x => along(last.x, r) * 2.0 - along(last.x - 1, r),
            c => along(c, r),
        };
        match row {
            r if r < 0 => across(0) * 2.0 - across(1),
            r if r > last.y => across(last.y) * 2.0 - across(last.y - 1),
            r => across(r),
        }
    }

    /// The pixel that is moved to this one, by fixed-point steps; `None` where the grid is bent so
    /// sharply that they do not settle.
    fn undo(&self, pixel: DVec2, size: DVec2) -> Option<DVec2> {
        let mut found = pixel;
        for _ in 0..UNBEND_STEPS {
            let next = pixel - self.offset(found / size);
            if next.distance_squared(found) < 1e-18 {
                return Some(next);
            }
            found = next;
        }
        None
    }
}

/// Weights of the four points around a place between the middle two: E. Catmull, R. Rom, *A class
/// of local interpolating splines*, 1974.
fn weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        -0.5 * t2 + 0.5 * t3,
    ]
}

fn project(matrix: DMat3, point: DVec2) -> Option<DVec2> {
    let image = matrix * point.extend(1.0);
    let flat = image.truncate() / image.z;
    (image.z > 0.0 && flat.is_finite()).then_some(flat)
}

/// The homography that takes four points to four others; `None` where three of them are in line.
/// Paul Heckbert, *Fundamentals of Texture Mapping and Image Warping*, 1989, §2.2.3: through the
/// unit square.
fn homography(from: [DVec2; 4], to: [DVec2; 4]) -> Option<DMat3> {
    let matrix = from_square(to)? * from_square(from)?.inverse();
    // Such that places of the picture have a positive third coordinate.
    let matrix = matrix * (matrix * from[0].extend(1.0)).z.signum();
    matrix.is_finite().then_some(matrix)
}

/// From the unit square's (0, 0), (1, 0), (0, 1), (1, 1) to a convex quadrilateral.
fn from_square([p00, p10, p01, p11]: [DVec2; 4]) -> Option<DMat3> {
    let sum = p00 - p10 + p11 - p01;
    let (d1, d2) = (p10 - p11, p01 - p11);
    let area = d1.perp_dot(d2);
    let turns = [(p00, p10, p11), (p10, p11, p01), (p11, p01, p00), (p01, p00, p10)]
        .map(|(a, b, c)| (b - a).perp_dot(c - b));
    if !(turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0)) {
        return None;
    }
    let (g, h) = (sum.perp_dot(d2) / area, d1.perp_dot(sum) / area);
    Some(DMat3::from_cols(
        (p10 - p00 + p10 * g).extend(g),
        (p01 - p00 + p01 * h).extend(h),
        p00.extend(1.0),
    ))
}

#[cfg(test)]
mod tests;
