//! The correction between a scene's light and a display: the positions of its pixels and their
//! codes. Plain data; `pass/correct.rs` draws with it.
//!
//! ```text
//! scene → light, linear, 0 to 1 → resampled → matrix → × multiply + add → curve → dither → codes
//! ```

use std::sync::Arc;

use glam::{DMat3, DMat4, DVec2, DVec3, UVec2};
use polyptych_wall::limits::CURVE_POINTS_MAX;
use polyptych_wall::warp_mesh::{WarpMesh, WarpVertex};
use polyptych_wall::{Orientation, StereoPacking, TransferFunction};

/// All that a channel's picture goes through on its way to the display.
#[derive(Clone, Debug, PartialEq)]
pub struct CorrectionDesc {
    /// The size of one eye's upright picture, in pixels.
    pub upright: [u32; 2],
    /// The orientation of the display.
    pub turn: Orientation,
    /// Left and right of each eye's picture are exchanged, before anything is packed or turned.
    pub is_mirrored: bool,
    /// The layout of the two eyes' pictures on the display.
    pub packing: StereoPacking,
    /// The positions of the upright picture's pixels; `None`: they are the source's pixels.
    pub warp: Option<Arc<WarpMesh>>,
    /// Blend weights, masks and black level.
    pub light_map: Option<Arc<BlendMapDesc>>,
    /// Applied to linear light; what leaves 0 to 1 is clipped.
    pub color: DMat3,
    /// From light to codes.
    pub curve: TransferFunction,
    /// A number of the channel's own: noise of ± half a code, another on every channel, goes onto
    /// the codes before they are rounded.
    pub dither: Option<u32>,
    /// `true` if the display has 1,024 codes, `false` if it has 256.
    pub is_fine: bool,
}

/// Factors and addends of linear light for each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendMapDesc {
    /// Row by row from the upper left of the upright picture: factor and addend in 1/65,535 of
    /// `multiply` and `add`. A weight is off by 1/131,070 at most, so that the sum of four
    /// projectors' weights keeps 1/4096 eight times over. Once for all colours, or for red, then
    /// all for green, then all for blue.
    pub texels: Vec<[u16; 2]>,
    /// The value that a factor of 65,535 represents.
    pub multiply: f64,
    /// The values that an addend of 65,535 represents, in red, green and blue.
    pub add: DVec3,
}

/// The planes that an eye's picture is put together from. Without a warp mesh the one plane's
/// rectangle is the upright picture, pixel for pixel and without a guard.
#[derive(Clone, Debug, PartialEq)]
pub struct EyeAtlas {
    /// Without `triangles` all have one eye, and the first one that holds a point shows it.
    pub planes: Vec<AtlasViewDesc>,
    /// For each plane the triangles of the mesh that it shows, the same for all eyes.
    pub triangles: Option<Arc<Vec<Vec<u32>>>>,
}

/// A planar picture in the source target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtlasViewDesc {
    /// The eye that sees it, in metres of display space.
    pub eye_in_display: DVec3,
    /// From vectors from the eye in display space to the clip space of `rect`.
    pub clip_from_eye: DMat4,
    /// x, y, width and height in pixels of the source target,
    /// [`SOURCE_GUARD`](polyptych_wall::view_atlas::SOURCE_GUARD) on all sides included.
    pub rect: [u32; 4],
}

/// Why a picture cannot be corrected.
#[derive(Debug, thiserror::Error)]
pub enum CorrectionError {
    /// The display's picture is empty or too large.
    #[error(transparent)]
    Target(#[from] super::TargetError),
    /// A mesh that points outside of itself or of the picture, or has a number that is none.
    #[error("the warp mesh: {0}")]
    Mesh(String),
    /// Not a texel for each pixel.
    #[error("the light map has {found} texels, where the picture has {wanted}")]
    LightMap {
        /// The number of texels in the map.
        found: usize,
        /// The number of texels needed: one for each pixel of the picture.
        wanted: usize,
    },
    /// A curve that does not rise, or a matrix that is not finite.
    #[error("the colours: {0}")]
    Color(&'static str),
    /// Other eyes or planes than the description needs.
    #[error("{0}")]
    Source(&'static str),
}

impl BlendMapDesc {
    /// A map of factors and addends, the addends being shares of `add`; all from 0 on. Factors are
    /// scaled by the largest.
    pub fn new(pixels: &[[f64; 2]], add: DVec3) -> Self {
        let largest = |at: usize| pixels.iter().map(|p| p[at]).fold(0.0, f64::max);
        let (multiply, share) = (largest(0), largest(1));
        let texel = |value: f64, whole: f64| {
            if whole > 0.0 { (value / whole * 65535.0).round() as u16 } else { 0 }
        };
        let texels = pixels.iter().map(|[f, a]| [texel(*f, multiply), texel(*a, share)]).collect();
        Self { texels, multiply, add: add * share }
    }
}

impl CorrectionDesc {
    /// A description that changes nothing.
    pub fn identity(upright: [u32; 2]) -> Self {
        Self {
            upright,
            turn: Orientation::None,
            is_mirrored: false,
            packing: StereoPacking::None,
            warp: None,
            light_map: None,
            color: DMat3::IDENTITY,
            curve: TransferFunction::Srgb,
            dither: None,
            is_fine: false,
        }
    }

    /// Width and height of one eye's picture as it is turned for the display.
    fn turned(&self) -> UVec2 {
        self.turn.turned(self.upright.into())
    }

    /// Width and height of the display's own picture, in pixels.
    pub fn display_size(&self) -> [u32; 2] {
        self.turned().saturating_mul(self.packing.parts()).to_array()
    }

    /// The affine map from an eye's upright pixels to the display's, as rows x and y; exact, being
    /// made of 0, 1, −1 and whole numbers.
    pub(crate) fn display_from_upright(&self, eye: usize) -> [[f64; 3]; 2] {
        let [width, height] = self.upright.map(f64::from);
        let x = if self.is_mirrored { [-1.0, 0.0, width] } else { [1.0, 0.0, 0.0] };
        let y = [0.0, 1.0, 0.0];
        let from = |side: f64, row: [f64; 3]| [-row[0], -row[1], side - row[2]];
        let mut rows = match self.turn {
            Orientation::None => [x, y],
            Orientation::Left => [from(height, y), x],
            Orientation::Right => [y, from(width, x)],
            Orientation::Half => [from(width, x), from(height, y)],
        };
        // The display takes the eyes apart in its own pixels.
        let step = (self.packing.parts() - 1) * self.turned();
        rows[0][2] += f64::from(step.x) * eye as f64;
        rows[1][2] += f64::from(step.y) * eye as f64;
        rows
    }

    /// Returns the first fault of the description; `None` if it is valid.
    pub(crate) fn fault(&self) -> Option<CorrectionError> {
        if !self.color.is_finite() {
            return Some(CorrectionError::Color("the matrix is not finite"));
        }
        if let Some(reason) = curve_fault(&self.curve) {
            return Some(CorrectionError::Color(reason));
        }
        let wanted = self.upright[0] as usize * self.upright[1] as usize;
        let is_wrong = |map: &&Arc<BlendMapDesc>| ![wanted, 3 * wanted].contains(&map.texels.len());
        if let Some(map) = self.light_map.as_ref().filter(is_wrong) {
            return Some(CorrectionError::LightMap { found: map.texels.len(), wanted });
        }
        let reason = mesh_fault(self.warp.as_ref()?, self.upright)?;
        Some(CorrectionError::Mesh(reason))
    }
}

/// Returns what is wrong with a mesh for an upright picture of this size, if anything.
pub(crate) fn mesh_fault(mesh: &WarpMesh, [width, height]: [u32; 2]) -> Option<String> {
    if mesh.triangles.is_empty() {
        return Some("there is no triangle".to_owned());
    }
    let count = mesh.vertices.len();
    if mesh.triangles.iter().flatten().any(|index| *index as usize >= count) {
        return Some(format!("a triangle has a corner beyond the {count} points"));
    }
    let is_inside = |v: &WarpVertex| {
        let is_on = |at: f64, side: u32| (0.0..=f64::from(side)).contains(&at);
        is_on(v.pixel.x, width) && is_on(v.pixel.y, height) && v.point.is_finite()
    };
    let outside = mesh.vertices.iter().find(|vertex| !is_inside(vertex))?;
    let (DVec2 { x, y }, point) = (outside.pixel, outside.point);
    Some(format!("pixel ({x}, {y}) at {point} m is not one of {width} × {height}"))
}

fn curve_fault(curve: &TransferFunction) -> Option<&'static str> {
    match curve {
        TransferFunction::Srgb => None,
        TransferFunction::Gamma(gamma) => (!gamma.is_finite() || gamma.cmple(DVec3::ZERO).any())
            .then_some("a gamma is not above 0"),
        TransferFunction::Measured(light) => {
            let rises = light.windows(2).all(|pair| pair[0].cmple(pair[1]).all());
            let ends = (light.first(), light.last()) == (Some(&DVec3::ZERO), Some(&DVec3::ONE));
            let is_good = (2..=CURVE_POINTS_MAX).contains(&light.len()) && rises && ends;
            (!is_good).then_some("a curve does not rise from 0 to 1")
        }
    }
}

/// Returns the codes, 0 to 1, of the lights (i / (count − 1))²: their distances follow the curves
/// of displays, so that lines between them are off by less than a hundredth of a code. Empty for
/// curves that are not measured.
pub(crate) fn curve_codes(curve: &TransferFunction, count: usize) -> Vec<DVec3> {
    let TransferFunction::Measured(light) = curve else { return Vec::new() };
    let last = (count - 1).max(1) as f64;
    let code = |target: f64, at: usize| {
        // The first of equal lights: a code that adds none is not sent.
        let above = light.partition_point(|point| point[at] < target);
        let Some(below) = above.checked_sub(1) else { return 0.0 };
        let high = light.get(above).map_or(1.0, |point| point[at]);
        let low = light[below][at];
        (below as f64 + (target - low) / (high - low)) / (light.len() - 1) as f64
    };
    let of = |i: usize| {
        let target = (i as f64 / last).powi(2);
        DVec3::new(code(target, 0), code(target, 1), code(target, 2))
    };
    (0..count).map(of).collect()
}
