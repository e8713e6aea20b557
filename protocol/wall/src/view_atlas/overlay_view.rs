//! The source of a warped channel that shows a camera's own picture: the part of that picture that
//! its pixels show, as dense as its densest pixels.
//!
//! If pixels of the channel are pixels of the picture, as on tiles of a cylinder, the source's are
//! so too, and nothing is resampled.

use glam::{DMat3, DVec2, DVec3, UVec2};

use super::group::{Group, view_triangles};
use super::{
    AtlasError, AtlasView, MeshPart, SOURCE_GUARD, SOURCE_SHARE_MAX, TAP_SPACING, WarpMesh, plane,
};

/// A scale that is so near to 1 is 1.
const SCALE_ROUNDING: f64 = 1e-6;

/// The part of a camera's own picture that a channel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlayView {
    /// From points of [`PointSpace::Canvas`](crate::view::PointSpace::Canvas) to texels.
    pub plane: AtlasView,
    /// The area that `plane` holds, guard included: its upper left and lower right corners, in
    /// pixels of the canvas from the upper left of the picture.
    pub part: [DVec2; 2],
    /// The size of the source, in pixels.
    pub size: UVec2,
    /// Samples that a pixel takes of the source, across and down.
    pub taps: UVec2,
}

impl OverlayView {
    /// The plan of a mesh of such points; `side_max` is the adapter's largest texture.
    ///
    /// # Errors
    /// A mesh of nothing.
    pub fn new(mesh: &WarpMesh, side_max: u32) -> Result<Self, AtlasError> {
        Self::reduced(mesh, side_max, 1.0)
    }

    /// A plan as [`Self::new`] makes it, with this share of the pixels along each side: above 0,
    /// and at most 1.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn reduced(mesh: &WarpMesh, side_max: u32, share: f64) -> Result<Self, AtlasError> {
        let facets = view_triangles(mesh, DVec3::ZERO, MeshPart::View)?;
        let pixels = facets.iter().map(|facet| facet.area).sum::<f64>();
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for vertex in mesh.triangles.iter().flatten().map(|at| mesh.vertices[*at as usize]) {
            (low, high) = (low.min(vertex.point.truncate()), high.max(vertex.point.truncate()));
        }
        // Whole pixels; what rounding has put beyond one is no pixel more.
        let (low, high) = ((low + 1e-6).floor(), (high - 1e-6).ceil());
        let high = high.max(low + 1.0);
        let group = Group::new((DVec3::ZERO, DMat3::IDENTITY), (low, high), &facets);
        let span = high - low;
        let scale = group.sides() / span;
        let is_one = (scale - 1.0).abs().cmplt(DVec2::splat(SCALE_ROUNDING));
        let scale = DVec2::select(is_one, DVec2::ONE, scale);
        let most = (pixels * SOURCE_SHARE_MAX).max(1.0);
        let cut = (most / (span * scale).element_product()).sqrt().min(1.0) * share;
        let room = f64::from(side_max.saturating_sub(2 * SOURCE_GUARD).max(1));
        let sides = (span * scale * cut).ceil().min(DVec2::splat(room)).max(DVec2::ONE);
        let density = group.density(sides).map_or(DVec2::ONE, |density| density.across_down);
        let taps = (density / TAP_SPACING - SCALE_ROUNDING).ceil();
        let size = sides.as_uvec2() + 2 * SOURCE_GUARD;
        let guard = span * f64::from(SOURCE_GUARD) / sides;
        let (begin, end) = (low - guard, high + guard);
        Ok(Self {
            // The near plane is the view's own matrix's matter.
            plane: plane(&group, [0, 0, size.x, size.y], 1.0),
            part: [DVec2::new(begin.x, -end.y), DVec2::new(end.x, -begin.y)],
            size,
            taps: taps.clamp(DVec2::ONE, DVec2::splat(4.0)).as_uvec2(),
        })
    }
}
