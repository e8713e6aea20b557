//! The source of a channel with a warp: planar pictures that together hold all that its pixels see
//! from an eye, as dense as its densest pixels; pure f64.
//!
//! A picture looks along the middle of its rays, with its rows along the channel's. Where one
//! would span more than 110°, the channel is divided, at most into six; where that is not enough,
//! the six are the sides of a cube.

mod around;
mod group;
mod layout;
pub mod overlay_view;

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, UVec2};
use group::Group;

use super::viewpoint::Viewpoint;
use super::warp_mesh::WarpMesh;

/// Planes for one eye: a cube has six sides.
pub const SOURCE_PLANES_MAX: usize = 6;

/// Planes for one eye of omnidirectional stereo: each costs a pass over what it shows of the scene.
pub const SOURCE_CELLS_MAX: usize = 64;

/// A planar picture spans no more than this, in radians: 110°. Its middle then has a third of the
/// pixels that its edge has.
pub const SOURCE_SPAN_MAX: f64 = 110.0 * std::f64::consts::PI / 180.0;

/// Pixels around each plane's own ones, so that filters may reach over its edge.
pub const SOURCE_GUARD: u32 = 2;

/// An eye nearer to a point of the surface than a micrometre is on it.
pub const SOURCE_DISTANCE_MIN_M: f64 = 1e-6;

/// Share of a channel's pixels that may show the back of their surface: measured surfaces are
/// noisy where they are seen from the side.
const BACK_SHARE_MAX: f64 = 0.01;

/// Source pixels for each pixel of the channel, at most: a few pixels that look along their
/// surface would ask for any number.
const SOURCE_SHARE_MAX: f64 = 8.0;

/// Sides of planes are multiples of this, so that a moving eye seldom asks for another target.
const SIDE_STEP: f64 = 32.0;

/// Source pixels that one sample stands for: linear filtering reaches over two.
const TAP_SPACING: f64 = 1.5;

/// The pixels of a channel that a mesh has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshPart {
    /// All of them: the eye must be in front of as good as all of their surface.
    Whole,
    /// Those of a view. It may lie where the few are that an eye sees from the back, which is no
    /// reason not to show the channel.
    View,
}

/// The reason why a channel has no source.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum AtlasError {
    /// No pixel is lit.
    #[error("none of its pixels lies on its screen")]
    Nothing,
    /// A surface point at the eye has no direction.
    #[error("the eye {eye} m is on the surface at pixel ({}, {})", .pixel.x, .pixel.y)]
    EyeOnSurface {
        /// In metres of display space.
        eye: DVec3,
        /// The place in the upright picture, in pixels.
        pixel: DVec2,
    },
    /// Some pixels are seen from the front, some from the back.
    #[error(
        "the eye {eye} m is behind the surface at pixel ({}, {}), and in front of it elsewhere",
        .pixel.x, .pixel.y
    )]
    EyeBehind {
        /// In metres of display space.
        eye: DVec3,
        /// The place in the upright picture, in pixels.
        pixel: DVec2,
    },
    /// One triangle of the mesh spans more than any plane may.
    #[error("the mesh is too coarse: a triangle at pixel ({}, {}) spans over 110°", .0.x, .0.y)]
    Coarse(DVec2),
}

/// One planar picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtlasView {
    /// The eye that sees it, in metres of display space.
    pub eye: DVec3,
    /// Turns a vector from the eye in display space into view space, which looks along −Z.
    pub view_from_display: DMat3,
    /// Off-axis perspective into wgpu's clip space, reversed and without a far plane; of all of
    /// `rect`.
    pub clip_from_view: DMat4,
    /// x, y, width and height in pixels of the atlas, the guard included.
    pub rect: [u32; 4],
}

impl AtlasView {
    /// From vectors from the eye in display space to clip space.
    pub fn clip_from_eye(&self) -> DMat4 {
        self.clip_from_view * DMat4::from_mat3(self.view_from_display)
    }

    /// Returns the place of a vector from the eye, in pixels of the atlas; `None` behind the eye.
    pub fn texel(&self, ray: DVec3) -> Option<DVec2> {
        let clip = self.clip_from_eye() * ray.extend(1.0);
        let [x, y, width, height] = self.rect.map(f64::from);
        (clip.w > 0.0).then(|| {
            let ndc = clip.truncate() / clip.w;
            DVec2::new(x + (ndc.x + 1.0) * 0.5 * width, y + (1.0 - ndc.y) * 0.5 * height)
        })
    }
}

/// The source that one channel is drawn from, for the eyes that it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewAtlas {
    /// For each eye, its planes; the first one that holds a point shows it, unless `triangles`
    /// say otherwise.
    pub planes: Vec<Vec<AtlasView>>,
    /// The triangles of the mesh that each plane shows, of all eyes alike; empty without
    /// omnidirectional stereo.
    pub triangles: Vec<Vec<u32>>,
    /// Maximum error of points on the screen or behind it, for each eye, in pixels, since planes
    /// have one eye each; 0 without omnidirectional stereo.
    pub stereo_error_px: f64,
    /// The size of the target that holds them all, in pixels.
    pub size: UVec2,
    /// Minimum number of source pixels per pixel of the channel, over all places and directions; 1
    /// or more, unless something was cut.
    pub density_min: f64,
    /// Maximum number of source pixels per pixel of the channel, over all places and directions.
    pub density_max: f64,
    /// The fraction that is left of the wanted sides of the plane that was cut most; 1 if the
    /// adapter's textures sufficed.
    pub cut: f64,
    /// Samples that a pixel takes of the source, across and down.
    pub taps: UVec2,
}

impl ViewAtlas {
    /// The plan of a channel for its eyes, in metres of display space: one, or left and right of
    /// one head.
    /// `near_m` is the wall's; `side_max` the adapter's largest texture, in pixels.
    ///
    /// # Errors
    /// A mesh of nothing, or an eye that is on the surface or behind a part of it.
    pub fn new<E: Copy + Into<Viewpoint>>(
        mesh: &WarpMesh,
        eyes: &[E],
        near_m: f64,
        side_max: u32,
    ) -> Result<Self, AtlasError> {
        Self::reduced((mesh, MeshPart::Whole), eyes, near_m, side_max, 1.0)
    }

    /// An atlas as [`Self::new`] makes it, of a channel or of a view on it, with this share of the
    /// pixels along each side: above 0, and at most 1.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn reduced<E: Copy + Into<Viewpoint>>(
        (mesh, part): (&WarpMesh, MeshPart),
        eyes: &[E],
        near_m: f64,
        side_max: u32,
        scale: f64,
    ) -> Result<Self, AtlasError> {
        let eyes: Vec<Viewpoint> = eyes.iter().map(|eye| (*eye).into()).collect();
        let (mut groups, mut triangles) = (Vec::with_capacity(eyes.len()), Vec::new());
        let (mut pixels, mut stereo_error_px) = (0.0, 0.0);
        for eye in &eyes {
            let middle = eye.middle();
            let facets = group::view_triangles(mesh, middle, part)?;
            pixels += facets.iter().map(|facet| facet.area).sum::<f64>();
            if let Viewpoint::Fixed(eye) = eye {
                groups.push(group::groups(&facets, *eye)?);
            }
        }
        if let Some(Viewpoint::Around(first)) = eyes.first() {
            let cells = around::cells((mesh, part), &eyes, first.error_max_px)?;
            (groups, triangles) = (cells.groups, cells.triangles);
            stereo_error_px = cells.error_px;
        }
        // A channel of a few pixels may have several planes, and each has at least one step.
        let planes = groups.iter().map(Vec::len).sum::<usize>() as f64;
        let pixels_max = (pixels * SOURCE_SHARE_MAX).max(planes * SIDE_STEP * SIDE_STEP);
        let mut share = 1.0;
        loop {
            if let Some((places, size)) =
                layout::pack(&groups, (share, scale), side_max, pixels_max)
            {
                let cut = layout::least_left(&groups, (share, scale), side_max, pixels_max);
                let plan = Self::of(&groups, &places, size, near_m, cut);
                return Ok(Self { triangles, stereo_error_px, ..plan });
            }
            share *= 0.95;
        }
    }

    fn of(
        groups: &[Vec<Group>],
        places: &[Vec<[u32; 4]>],
        size: UVec2,
        near_m: f64,
        cut: f64,
    ) -> Self {
        let mut plan = Self {
            planes: Vec::with_capacity(groups.len()),
            triangles: Vec::new(),
            stereo_error_px: 0.0,
            size,
            density_min: f64::INFINITY,
            density_max: 0.0,
            cut,
            taps: UVec2::ONE,
        };
        for (groups, places) in groups.iter().zip(places) {
            let planes = groups.iter().zip(places);
            plan.planes.push(planes.map(|(group, rect)| plane(group, *rect, near_m)).collect());
            for (group, rect) in groups.iter().zip(places) {
                let Some(density) = group.density(inner(*rect)) else { continue };
                plan.density_min = plan.density_min.min(density.least);
                plan.density_max = plan.density_max.max(density.most);
                let taps = (density.across_down / TAP_SPACING).ceil().max(DVec2::ONE);
                plan.taps = plan.taps.max(taps.min(DVec2::splat(4.0)).as_uvec2());
            }
        }
        plan
    }
}

/// A rectangle's pixels without the guard.
fn inner([_, _, width, height]: [u32; 4]) -> DVec2 {
    (UVec2::new(width, height) - 2 * SOURCE_GUARD).as_dvec2()
}

/// The plane of a group whose picture has this place in the atlas.
fn plane(group: &Group, rect: [u32; 4], near_m: f64) -> AtlasView {
    let guard = (group.high - group.low) * f64::from(SOURCE_GUARD) / inner(rect);
    let (low, high) = (group.low - guard, group.high + guard);
    let (scale, middle) = (2.0 / (high - low), (high + low) / (high - low));
    AtlasView {
        eye: group.eye,
        view_from_display: group.view_from_display,
        clip_from_view: DMat4::from_cols(
            DVec4::X * scale.x,
            DVec4::Y * scale.y,
            DVec4::new(middle.x, middle.y, 0.0, -1.0),
            DVec4::Z * near_m,
        ),
        rect,
    }
}

#[cfg(test)]
mod tests;
