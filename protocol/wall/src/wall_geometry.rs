//! The geometry of a wall's screens and channels from its files, ready for look-ups of places.
//!
//! ```text
//! mesh of a screen      canvas <-> display space      both ways, and where a ray meets it
//! warp of a channel     meant pixel <-> display space
//!     on the canvas     where the ray goes on from the wall's eye through that point
//! ```
//!
//! So a warp whose points do not lie on its screen is on the canvas where the wall's eye sees it:
//! two channels that show one point agree, whatever the screen is. Pins and bends are not in it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::calibration_change::Edge;
use super::calibration_maps::CalibrationMaps;
use super::channel_mapping::ChannelMapping;
use super::lit_area::{self, LitArea};
use super::mesh_bvh::{Hit, MeshBvh};
use super::projector::Projector;
use super::warp::{WarpGeometry, WarpMap};
use super::warp_mesh::WarpMesh;
use super::{Channel, ChannelCalibration, Screen, Surface, Wall};

/// The file geometry of a wall; empty if the wall has no files, or if its files were not read.
#[derive(Clone, Debug, Default)]
pub struct WallGeometry {
    eye: DVec3,
    /// By file; their places are u and v.
    screens: BTreeMap<u16, Arc<MeshBvh>>,
    /// By name; their places are pixels.
    channels: BTreeMap<String, ChannelGeometry>,
}

/// The geometry of a channel whose pixels a file places.
#[derive(Clone, Debug)]
struct ChannelGeometry {
    facets: Arc<MeshBvh>,
    outline: Arc<LitArea>,
    /// `true` if the file also gives the light of its corners.
    has_light: bool,
}

static NONE: WallGeometry =
    WallGeometry { eye: DVec3::ZERO, screens: BTreeMap::new(), channels: BTreeMap::new() };

/// A wall with its file geometry. `From<&Wall>` gives empty geometry.
#[derive(Clone, Copy, Debug)]
pub struct ResolvedWall<'a> {
    /// The wall.
    pub wall: &'a Wall,
    /// The geometry from its files.
    pub shapes: &'a WallGeometry,
}

impl<'a> From<&'a Wall> for ResolvedWall<'a> {
    fn from(wall: &'a Wall) -> Self {
        Self { wall, shapes: &NONE }
    }
}

impl<'a> ResolvedWall<'a> {
    /// Returns the mapping of a channel's pixels, like [`Wall::channel_mapping`], with its files.
    pub fn channel_mapping(&self, id: crate::ChannelId) -> Option<ChannelMapping<'a>> {
        let channel = self.wall.channel(id)?;
        ChannelMapping::with_geometry(
            channel,
            self.wall.screens.get(usize::from(channel.screen))?,
            self.shapes,
        )
    }
}

impl WallGeometry {
    /// No shapes, for whatever wall.
    pub fn empty() -> &'static Self {
        &NONE
    }

    /// The shapes of all screens and channels.
    pub fn new(wall: &Wall, maps: &CalibrationMaps) -> Self {
        Self::of(wall, maps, |_| true)
    }

    /// The shapes of those screens for which `is_wanted`, and of the channels on them. A file
    /// that is not there, or of no use for what names it, makes none.
    pub fn of(wall: &Wall, maps: &CalibrationMaps, is_wanted: impl Fn(u16) -> bool) -> Self {
        let mut shapes = Self { eye: wall.eye, ..Self::default() };
        let wanted = (0u16..).zip(&wall.screens).filter(|(index, _)| is_wanted(*index));
        for (_, screen) in wanted {
            if let Surface::Mesh(file) = screen.surface
                && !shapes.screens.contains_key(&file)
                && let Some(facets) = maps.warp(file).and_then(WarpMap::surface)
            {
                shapes.screens.insert(file, Arc::new(MeshBvh::new(facets)));
            }
        }
        // Channels of one size on one screen may share a file.
        let mut known: BTreeMap<(u16, u16, [u32; 2]), ChannelGeometry> = BTreeMap::new();
        for channel in wall.channels.iter().filter(|channel| is_wanted(channel.screen)) {
            let Some(file) = channel.adjustment.warp else { continue };
            let key = (file, channel.screen, channel.size.to_array());
            let made = match known.get(&key) {
                Some(shape) => Some(shape.clone()),
                None => shapes.channel_shape(wall, maps, channel, file),
            };
            let Some(shape) = made else { continue };
            known.insert(key, shape.clone());
            shapes.channels.insert(channel.name.clone(), shape);
        }
        shapes
    }

    fn channel_shape(
        &self,
        wall: &Wall,
        maps: &CalibrationMaps,
        channel: &Channel,
        file: u16,
    ) -> Option<ChannelGeometry> {
        let warp = maps.warp(file)?;
        let screen = wall.screens.get(usize::from(channel.screen))?;
        let straight = Channel { adjustment: ChannelCalibration::default(), ..channel.clone() };
        let pixels = ChannelMapping::with_geometry(&straight, screen, self)?;
        let mesh: WarpMesh = warp.channel_mesh(&straight, &self.screen(screen), &pixels);
        let has_light = match &warp.shape {
            WarpGeometry::Grid(_) => false,
            WarpGeometry::Mesh(mesh) => mesh.vertices.iter().any(|vertex| vertex.light < 1.0),
        };
        if mesh.triangles.is_empty() {
            return None;
        }
        let outline = Arc::new(LitArea::new(&mesh));
        Some(ChannelGeometry { facets: Arc::new(MeshBvh::new(mesh)), outline, has_light })
    }

    /// A screen, with its mesh where it is one.
    pub fn screen<'a>(&'a self, screen: &'a Screen) -> ScreenGeometry<'a> {
        let facets = match screen.surface {
            Surface::Mesh(file) => self.screens.get(&file).map(Arc::as_ref),
            _ => None,
        };
        ScreenGeometry { screen, facets }
    }

    /// The warp of a channel, and the eye that its canvas is seen from.
    pub(super) fn warp_of(&self, channel: &Channel) -> Option<(&MeshBvh, DVec3)> {
        let shape = self.channels.get(&channel.name)?;
        Some((shape.facets.as_ref(), self.eye))
    }

    /// Returns the part of a channel's picture that its warp lights.
    pub(super) fn lit_area_of(&self, channel: &Channel) -> Option<&LitArea> {
        self.channels.get(&channel.name).map(|shape| shape.outline.as_ref())
    }

    /// Returns a place beside a side of what a channel's warp lights: so far along it, from 0 to 1,
    /// and so many pixels inside, in pixels before pins and bends. `None` without a warp.
    pub fn lit_edge(
        &self,
        channel: &Channel,
        side: Edge,
        along: f64,
        inside: f64,
    ) -> Option<DVec2> {
        let outline = self.lit_area_of(channel)?;
        let (side, inward) = match side {
            Edge::Left => (lit_area::Edge::Left, DVec2::X),
            Edge::Right => (lit_area::Edge::Right, DVec2::NEG_X),
            Edge::Top => (lit_area::Edge::Top, DVec2::Y),
            Edge::Bottom => (lit_area::Edge::Bottom, DVec2::NEG_Y),
        };
        let beside = outline.low.lerp(outline.high, along);
        Some(outline.snap_to_edge(side, beside) + inward * inside)
    }

    /// Returns whether a channel's own files share its light with others, so that nothing is
    /// computed: if the wall file says so, or if a file places its pixels and there is an alpha
    /// mask or the light of a mesh's corners. The latter does not hold if the wall file has widths
    /// of ramps.
    pub fn is_blended_by_file(&self, channel: &Channel) -> bool {
        let adjustment = &channel.adjustment;
        let has_light = self.channels.get(&channel.name).is_some_and(|shape| shape.has_light);
        let is_implied = channel.cover == super::ChannelKind::Map
            && (has_light || adjustment.alpha.is_some())
            && adjustment.edges == super::BlendWidths::default();
        is_implied || adjustment.ramps == super::Ramps::Alpha
    }
}

/// A screen, and its mesh where it stands in a file that is there.
#[derive(Clone, Copy, Debug)]
pub struct ScreenGeometry<'a> {
    /// The screen.
    pub screen: &'a Screen,
    facets: Option<&'a MeshBvh>,
}

impl ScreenGeometry<'_> {
    /// The point of display space at a place of the canvas, as [`Screen::display_from_canvas`].
    pub fn display_from_canvas(&self, canvas: DVec2) -> Option<DVec3> {
        match self.facets {
            Some(facets) => facets.point_at(canvas / self.screen.canvas.as_dvec2()),
            None => self.screen.display_from_canvas(canvas),
        }
    }

    /// The first point that a ray meets, and where on the canvas it is. A mesh that is met from
    /// behind stands in the way of what it hides.
    pub fn hit(&self, from: DVec3, direction: DVec3) -> Option<(DVec3, DVec2)> {
        self.hit_side(from, direction, false)
    }

    /// Returns the hit like [`Self::hit`], on the side that the viewer does not see if `is_behind`.
    pub fn hit_side(
        &self,
        from: DVec3,
        direction: DVec3,
        is_behind: bool,
    ) -> Option<(DVec3, DVec2)> {
        if let Some(facets) = self.facets {
            let hit = facets.hit(from, direction, 0.0).filter(|hit| hit.is_front != is_behind)?;
            return Some((hit.point, self.canvas(hit)));
        }
        let point = self.screen.surface.hit_side(from, direction, is_behind)?;
        Some((point, self.screen.canvas_from_display(point)?))
    }

    /// The point of [`Self::hit_side`] alone, which takes less time.
    pub(super) fn point_side(
        &self,
        from: DVec3,
        direction: DVec3,
        is_behind: bool,
    ) -> Option<DVec3> {
        let Some(facets) = self.facets else {
            return self.screen.surface.hit_side(from, direction, is_behind);
        };
        let hit = facets.hit(from, direction, 0.0).filter(|hit| hit.is_front != is_behind)?;
        Some(hit.point)
    }

    /// Returns whether a projector stands behind the screen, so that the viewer sees its light
    /// through it.
    pub fn is_rear(&self, projector: &Projector) -> bool {
        projector.is_rear(|direction| {
            let distance = |is_behind| {
                let (point, canvas) = self.hit_side(projector.position, direction, is_behind)?;
                let is_on = canvas.cmpge(DVec2::ZERO).all()
                    && canvas.cmple(self.screen.canvas.as_dvec2()).all();
                is_on.then(|| point.distance(projector.position))
            };
            match (distance(false), distance(true)) {
                (None, None) => None,
                (front, back) => {
                    Some(back.unwrap_or(f64::INFINITY) < front.unwrap_or(f64::INFINITY))
                }
            }
        })
    }

    /// Returns the place on the canvas where an eye sees a point: of a mesh, on the layer nearest
    /// to the point.
    pub fn canvas_through(&self, eye: DVec3, point: DVec3) -> Option<DVec2> {
        match self.facets {
            Some(facets) => facets.hit(eye, point - eye, 1.0).map(|hit| self.canvas(hit)),
            None => self.hit(eye, point - eye).map(|(_, canvas)| canvas),
        }
    }

    /// Returns whether it is a mesh with known points; such a mesh may hide some of them from an
    /// eye.
    pub fn is_mesh(&self) -> bool {
        self.facets.is_some()
    }

    /// The edges at which a mesh ends, by the points of their ends; none of other screens.
    pub(super) fn outline(&self) -> &[[DVec3; 2]] {
        self.facets.map_or(&[], MeshBvh::outline)
    }

    fn canvas(&self, hit: Hit) -> DVec2 {
        hit.place * self.screen.canvas.as_dvec2()
    }
}

#[cfg(test)]
mod tests;
