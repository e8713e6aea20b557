//! The maps of a directional light around a viewer: a function of the light, of the scene's bounds
//! and of the point between the viewer's eyes, never of the channel.
//!
//! Each map is a square in the plane that the light is perpendicular to. The widest one holds the
//! whole scene; each further one has a quarter of its width, with the viewer in the middle. Which
//! one a point is looked up in is decided by its distance to the viewer, so that the edge between
//! two is a sphere and no channel has another one.
//!
//! Maps stand on whole texels of a grid that is fixed in the world, and move by cells of many: a
//! point falls onto the same place of a texel wherever the viewer is, so no edge of a shadow
//! flickers, and a viewer who moves within a cell needs no new maps. Engel, "Cascaded Shadow Maps",
//! ShaderX5 (2006); Valient, "Stable Rendering of Cascaded Shadow Maps", ShaderX6 (2008).

use glam::{DMat3, DMat4, DVec3, DVec4};

use super::error_tolerance::rounded_up;
use super::scene::Bounds;
use super::view::{AllowedError, ViewDesc};

/// Texels along each side of a map: those of the widest one are about a pixel of a wall that shows
/// the whole scene.
pub(crate) const MAP_SIDE: u32 = 2048;

/// Maximum number of maps of a light: the finest is a thousandth of the scene. Twin of the length
/// of `SunShadow::cascades` in `include/shadow.wgsl`.
pub(crate) const CASCADES_MAX: usize = 6;

/// The width of a map over that of the next finer one. A texel is then 1 to 4 thousandths of its
/// distance to the viewer, a few pixels of a wall.
const RATIO: f64 = 4.0;

/// Texels by which a map moves at once: a fifth of its side, so that it is drawn anew every few
/// steps of a viewer who walks, and not with each.
const CELL_TEXELS: f64 = 384.0;

/// Texels at each edge of a map that only filters reach.
const BORDER_TEXELS: f64 = 8.0;

/// No map is for what is nearer than so many times the near plane: 1.6 m of a room.
const NEAR_FACTOR: f64 = 32.0;

/// Share of a scene's depth along the light by which that of the maps is larger, for rounding.
const DEPTH_MARGIN: f64 = 1e-5;

/// Share of half of the width of a scene that its maps have of depth at least: one that is flat has
/// none of its own.
const DEPTH_MIN: f64 = 1e-3;

/// Texels by which levels of detail in a map may be beside their place. Twin in
/// `include/shadow.wgsl`.
pub(crate) const LEVEL_TEXELS: f64 = 0.25;

/// Half of the sun's apparent diameter as a tangent. Twin in `include/sun_shadow.wgsl`.
pub(crate) const SUN_TANGENT: f64 = 0.004652;

/// Axes of the space in which maps are drawn; of unit length, perpendicular, right-handed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LightBasis {
    pub right: DVec3,
    pub up: DVec3,
    /// Towards the light.
    pub toward: DVec3,
}

impl LightBasis {
    /// The axes of a light, a function of the direction towards it alone, for any direction: Duff
    /// and others, "Building an Orthonormal Basis, Revisited", JCGT 6 (2017).
    pub fn new(toward: DVec3) -> Self {
        let n = toward.try_normalize().unwrap_or(DVec3::Y);
        let sign = 1f64.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            right: DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            up: DVec3::new(b, sign + n.y * n.y * a, -n.y),
            toward: n,
        }
    }

    /// A point of the world in these axes.
    fn of_world(&self, point: DVec3) -> DVec3 {
        DVec3::new(self.right.dot(point), self.up.dot(point), self.toward.dot(point))
    }

    fn to_world(self, point: DVec3) -> DVec3 {
        self.right * point.x + self.up * point.y + self.toward * point.z
    }

    /// Half of the sides of the box in these axes around a box of half sides in the world.
    fn half_around(&self, half: DVec3) -> DVec3 {
        let [right, up, toward] = [self.right, self.up, self.toward].map(DVec3::abs);
        DVec3::new(right.dot(half), up.dot(half), toward.dot(half))
    }
}

/// A map: all that its depths depend on, but for the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cascade {
    pub basis: LightBasis,
    /// The middle of the square and the depth of the scene's end that is nearest to the light, in
    /// the light's axes.
    pub origin: DVec3,
    /// The depth of the scene along the light, in units of the world.
    pub depth: f64,
    /// Length of a texel in units of the world.
    pub texel: f64,
    /// The distance to the viewer below which the map has all points; infinite of the widest.
    pub radius: f64,
    /// A sphere around all points that are looked up here: without end of the widest.
    pub around: (DVec3, f64),
    /// How far what casts may be off, in units of the world.
    pub level_error: f64,
}

impl Cascade {
    /// The maps of a light for what a view shows of a scene, widest first; none where the scene has
    /// no bounds or the light is not shown.
    pub fn all(toward: DVec3, scene: &Bounds, view: &ViewDesc, count_max: usize) -> Vec<Self> {
        let basis = LightBasis::new(toward);
        let (middle, half) = (basis.of_world(scene.center()), basis.half_around(scene.half()));
        let widest = rounded_up(half.x.max(half.y));
        if !(middle.is_finite() && half.is_finite() && widest > 0.0 && widest.is_finite()) {
            return Vec::new();
        }
        let eye = view.middle_eye_in_world;
        let near = view.clip_from_view.w_axis.z / view.view_from_world.row(2).length();
        let near = if view.is_parallel() { 0.0 } else { rounded_up(near * NEAR_FACTOR) };
        // Nothing is nearer to the viewer than this.
        let nearest = scene.distance_squared(eye).sqrt().max(near);
        let margin = half.z * DEPTH_MARGIN + middle.z.abs() * f64::EPSILON * 4.0;
        let depth = (2.0 * (half.z + margin)).max(widest * DEPTH_MIN);
        // As a map shows levels of detail, whoever sees the shadow: another viewer, or another
        // bound, needs no other map.
        let level_texels = if view.allowed_error.is_none() { 0.0 } else { LEVEL_TEXELS };
        let light = Light { basis, middle, depth, eye: basis.of_world(eye), level_texels };
        let mut maps = Vec::new();
        let mut radius = widest;
        while maps.is_empty() || (maps.len() < count_max && radius > nearest) {
            maps.push(light.map(radius, maps.is_empty()));
            radius /= RATIO;
        }
        maps
    }

    /// Half of the side of the square, in units of the world.
    pub fn half_side(&self) -> f64 {
        f64::from(MAP_SIDE) * 0.5 * self.texel
    }

    /// The radius of the sun as seen from a point, in sides of the map, at the map's depth from it.
    pub fn spread(&self) -> f64 {
        SUN_TANGENT * self.depth / (f64::from(MAP_SIDE) * self.texel)
    }

    /// The view that draws the map, of what a camera shows.
    pub fn view(&self, camera: &ViewDesc) -> ViewDesc {
        let LightBasis { right, up, toward } = self.basis;
        let across = self.half_side().recip();
        let side = f64::from(MAP_SIDE);
        let eye_in_world = self.basis.to_world(self.origin);
        ViewDesc {
            eye_in_world,
            middle_eye_in_world: eye_in_world,
            view_from_world: DMat3::from_cols(right, up, toward).transpose(),
            clip_from_view: DMat4::from_cols(
                DVec4::X * across,
                DVec4::Y * across,
                DVec4::Z / self.depth,
                DVec4::new(0.0, 0.0, 1.0, 1.0),
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
            allowed_error: AllowedError { length: self.level_error, ..AllowedError::NONE },
            has_shadows: false,
        }
    }

    /// The place of a point in the map, from 0 to 1 from the upper left, and the depth there, from
    /// 0 to 1 at the light.
    pub fn place_of(&self, point: DVec3) -> DVec3 {
        let from = point - self.basis.to_world(self.origin);
        let side = f64::from(MAP_SIDE) * self.texel;
        DVec3::new(
            0.5 + self.basis.right.dot(from) / side,
            0.5 - self.basis.up.dot(from) / side,
            1.0 + self.basis.toward.dot(from) / self.depth,
        )
    }
}

/// A light's axes, and what lies where in them.
#[derive(Debug)]
struct Light {
    basis: LightBasis,
    /// The middle of the scene.
    middle: DVec3,
    /// The depth of the scene, with a margin.
    depth: f64,
    eye: DVec3,
    level_texels: f64,
}

impl Light {
    fn map(&self, radius: f64, is_widest: bool) -> Cascade {
        let texel = 2.0 * radius / (f64::from(MAP_SIDE) - CELL_TEXELS - 2.0 * BORDER_TEXELS);
        let cell = texel * CELL_TEXELS;
        let on = |step: f64, at: DVec3| (at / step).round() * step;
        let viewer = on(cell, self.eye);
        let middle = if is_widest { on(texel, self.middle) } else { viewer };
        let eye = self.basis.to_world(viewer);
        // Within the cell, half of its diagonal.
        let way = cell * 0.5 * 3f64.sqrt();
        Cascade {
            basis: self.basis,
            origin: middle.with_z(self.middle.z + self.depth * 0.5),
            depth: self.depth,
            texel,
            radius: if is_widest { f64::INFINITY } else { radius },
            around: (eye, if is_widest { f64::INFINITY } else { radius + way }),
            level_error: self.level_texels * texel,
        }
    }
}
