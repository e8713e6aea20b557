//! The maps of a point or spot light: a function of the light and of the scene's bounds alone,
//! never of the channel or the viewer, so that they are the same on every display and stay as they
//! are while the viewer moves.
//!
//! A narrow spot light has one map, which looks along its cone. Others have the faces of a cube:
//! along the axes of the world for a point light, along its cone for a wide spot light, which has
//! none behind it. Every map is wider than what is looked up in it by a border that only filters
//! reach, so no filter needs two maps and no border between faces is seen.
//!
//! Depth is reversed and infinite, as a camera's: its error is a share of the distance wherever the
//! near plane is, so that it can be as near as the shade of a lamp.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, DVec4};
use polyptych_wall::ShadowFilter;

use super::error_tolerance::rounded_up;
use super::scene::{Bounds, LocalLight};
use super::shadow_cascades::{LEVEL_TEXELS, LightBasis};
use super::view::{AllowedError, ViewDesc};

/// Texels along each side of the maps of a few lights: 90° of a face have 0.04° to 0.09° each.
const SIDE_OF_FEW: u32 = 2048;

/// Texels along each side of more: maps take 4 MiB each then, and not 16.
const SIDE_OF_MANY: u32 = 1024;

/// Maximum number of maps of the larger size: 256 MiB, as much as
/// [`LAMP_MAPS_MAX`](polyptych_scene::LAMP_MAPS_MAX) of the smaller one.
const FEW_MAX: usize = 16;

/// Texels at each edge of a map that only filters reach.
const BORDER_TEXELS: f64 = 8.0;

/// The same where filters are as wide as penumbras, as a share of a map's side. Twin of
/// `LAMP_SEARCH_MAX` in `include/lamp_shadow.wgsl`.
const PENUMBRA_BORDER: f64 = 1.0 / 32.0;

/// Of a lamp, in units of the world. Twin in `include/lamp_shadow.wgsl`.
pub(crate) const LAMP_RADIUS: f64 = 0.05;

/// The distance of the near plane as a share of how far a light reaches: 0.15 mm of 10 m. What is
/// nearer to the light casts no shadow.
const NEAR_FRACTION: f64 = 1.0 / 65_536.0;

/// Half of the diagonal of the largest lantern as a share of how far a light reaches in the scene:
/// a street lamp with a post of 8 m, of 12 m. A room that is the whole scene has more, unless the
/// lamp is in a corner of it.
const LANTERN_FRACTION: f64 = 1.0 / 2.0;

/// The same as a share of half of the scene's diagonal: a lantern lights what is around it, and a
/// room that is the whole scene is none, wherever its lamp is.
const LANTERN_SCENE_FRACTION: f64 = 3.0 / 4.0;

/// The least tangent of half a cone's angle: a map of no width has no texels.
const TANGENT_MIN: f64 = 1e-3;

/// A map: all that its depths depend on, but for the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LampMap {
    /// The light, in world space.
    position: DVec3,
    /// The map looks against `toward`.
    basis: LightBasis,
    /// The tangent of half of its angle, with the border.
    slope: f64,
    /// The distance of the near plane, in units of the world.
    near: f64,
    /// The maximum distance that the light reaches, in units of the world.
    reach: f64,
    /// Half of the diagonal of what may be a part of the lamp, in units of the world.
    lantern: f64,
    /// Texels along each side.
    side: u32,
}

/// Twin of `LampShadow` in `include/lamp_shadow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LampShadowRecord {
    pub right: [f32; 3],
    /// The number of its maps; 0 if it casts no shadow.
    pub count: u32,
    pub up: [f32; 3],
    pub layer: u32,
    pub near: f32,
    pub scale: f32,
    pub texel: f32,
    /// The radius of the lamp as seen from a point, in sides of the map for a depth of 1.
    pub spread: f32,
}

/// Texels along each side of each map of a view with so many maps of lamps.
pub(crate) fn side_of(maps: usize) -> u32 {
    if maps <= FEW_MAX { SIDE_OF_FEW } else { SIDE_OF_MANY }
}

impl LampMap {
    /// The maps of a light in a scene, by face; none where a number of the light is not finite.
    pub fn all(lamp: &LocalLight, scene: &Bounds, side: u32, filter: ShadowFilter) -> Vec<Self> {
        let position = lamp.position;
        let farthest = (scene.min - position).abs().max((scene.max - position).abs()).length();
        let reach = lamp.reach();
        let far = if farthest.is_finite() { farthest.min(reach) } else { reach };
        let near = if far.is_finite() { rounded_up(far * NEAR_FRACTION) } else { NEAR_FRACTION };
        if !(position.is_finite() && near > 0.0) {
            return Vec::new();
        }
        let of_scene = rounded_up(scene.half().length() * LANTERN_SCENE_FRACTION);
        let lantern = (near / NEAR_FRACTION * LANTERN_FRACTION).min(of_scene);
        let is_spot = lamp.outer_rad.is_some();
        let toward = if is_spot { -lamp.direction.as_dvec3() } else { DVec3::Z };
        let tangent = match lamp.outer_rad {
            Some(angle) if lamp.map_count == 1 => angle.tan().max(TANGENT_MIN),
            _ => 1.0,
        };
        let border = match filter {
            ShadowFilter::ContactHardening => PENUMBRA_BORDER,
            _ => BORDER_TEXELS / f64::from(side),
        };
        let slope = tangent / (1.0 - 2.0 * border);
        let cube = LightBasis::new(toward);
        let map = |basis| Self { position, basis, slope, near, reach, lantern, side };
        faces(cube).into_iter().take(lamp.map_count).map(map).collect()
    }

    /// The view that draws the map, of what a camera shows.
    pub fn view(&self, camera: &ViewDesc) -> ViewDesc {
        let LightBasis { right, up, toward } = self.basis;
        let (across, side) = (self.slope.recip(), f64::from(self.side));
        ViewDesc {
            eye_in_world: self.position,
            middle_eye_in_world: self.position,
            view_from_world: DMat3::from_cols(right, up, toward).transpose(),
            clip_from_view: DMat4::from_cols(
                DVec4::X * across,
                DVec4::Y * across,
                -DVec4::W,
                DVec4::Z * self.near,
            ),
            viewport: [0.0, 0.0, side, side],
            scissor: None,
            exposure: 1.0,
            fog: None,
            glow: None,
            ambient_occlusion: None,
            depth_of_field: None,
            tone: polyptych_scene::ToneMapper::default(),
            subset: camera.subset.clone(),
            // Levels of detail as the light sees them, whoever sees the shadow.
            allowed_error: AllowedError {
                angle_rad: LEVEL_TEXELS * self.texel(),
                pixel: self.texel(),
                ..AllowedError::NONE
            },
            has_shadows: false,
        }
    }

    /// A sphere around all that the light reaches, in world space.
    pub fn reached(&self) -> (DVec3, f64) {
        (self.position, self.reach)
    }

    /// Half of the diagonal of what may be a part of the lamp, in units of the world.
    pub fn lantern_radius(&self) -> f64 {
        self.lantern
    }

    /// Length of a texel at a distance of 1 along the map's axis, in units of the world.
    fn texel(&self) -> f64 {
        2.0 * self.slope / f64::from(self.side)
    }
}

impl LampShadowRecord {
    /// The record of a lamp whose maps, by face, begin at a layer.
    pub fn new(layer: u32, maps: &[LampMap]) -> Self {
        let Some(first) = maps.first() else { return Self::default() };
        Self {
            right: first.basis.right.as_vec3().to_array(),
            count: maps.len() as u32,
            up: first.basis.up.as_vec3().to_array(),
            layer,
            near: first.near as f32,
            scale: (0.5 / first.slope) as f32,
            texel: first.texel() as f32,
            spread: (LAMP_RADIUS * 0.5 / (first.slope * first.near)) as f32,
        }
    }
}

/// The axes of the faces of a cube, in the order of `lamp_face` in `include/lamp_shadow.wgsl`: the
/// first one's, to its right, left, above and below it, and behind.
fn faces(cube: LightBasis) -> [LightBasis; 6] {
    let LightBasis { right: x, up: y, toward: z } = cube;
    [
        cube,
        LightBasis { right: z, up: y, toward: -x },
        LightBasis { right: -z, up: y, toward: x },
        LightBasis { right: x, up: z, toward: -y },
        LightBasis { right: x, up: -z, toward: y },
        LightBasis { right: -x, up: y, toward: -z },
    ]
}
