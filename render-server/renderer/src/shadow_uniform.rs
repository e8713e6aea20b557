//! The uniform of the shadow maps of directional lights.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::shadow_cascades::{CASCADES_MAX, Cascade, MAP_SIDE};
use super::view::{SUNS_MAX, ViewDesc};

/// Twin of `Shadows` in `include/shadow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct ShadowUniform {
    /// The point between the viewer's eyes, relative to the eye, in world axes.
    pub middle: [f32; 3],
    pub pad0: u32,
    /// The allowed error: in radians, and in units of the world.
    pub error: [f32; 2],
    pub pad1: [f32; 2],
    pub suns: [SunShadowRecord; SUNS_MAX],
}

/// Twin of `SunShadow` in `include/shadow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct SunShadowRecord {
    pub right: [f32; 3],
    /// The number of its maps; 0 if it casts no shadow.
    pub count: u32,
    pub up: [f32; 3],
    pub pad0: f32,
    /// Towards the light, over the depth of the scene.
    pub toward: [f32; 3],
    /// The radius of the fifth finest map.
    pub radius4: f32,
    /// The radii of the four finest maps; the widest map, and those that are not there, have all
    /// points.
    pub radii: [f32; 4],
    /// Finest first.
    pub cascades: [CascadeRecord; CASCADES_MAX],
}

/// Twin of `Cascade` in `include/shadow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct CascadeRecord {
    /// The eye's place in the map, and its depth.
    pub offset: [f32; 3],
    /// The share of the map's side in a unit of the world.
    pub scale: f32,
    pub radius: f32,
    pub texel: f32,
    pub layer: u32,
    /// The radius of a sun as seen from a point, in sides of the map for a depth of 1.
    pub spread: f32,
}

impl ShadowUniform {
    /// No shadows.
    pub fn none() -> Self {
        Self::default()
    }

    /// The maps of a view: for each light its widest map's layer and its maps, widest first.
    pub fn new(view: &ViewDesc, suns: &[Option<(u32, Vec<Cascade>)>]) -> Self {
        let error = &view.allowed_error;
        let mut uniform = Self {
            middle: (view.middle_eye_in_world - view.eye_in_world).as_vec3().to_array(),
            error: [error.angle_rad as f32, error.length as f32],
            ..Self::default()
        };
        for (record, sun) in uniform.suns.iter_mut().zip(suns) {
            if let Some((layer, cascades)) = sun {
                *record = SunShadowRecord::new(*layer, cascades, view.eye_in_world);
            }
        }
        uniform
    }
}

impl SunShadowRecord {
    fn new(layer: u32, cascades: &[Cascade], eye: DVec3) -> Self {
        let Some(widest) = cascades.first() else { return Self::default() };
        let mut record = Self {
            right: widest.basis.right.as_vec3().to_array(),
            count: cascades.len() as u32,
            up: widest.basis.up.as_vec3().to_array(),
            toward: (widest.basis.toward / widest.depth).as_vec3().to_array(),
            radius4: f32::MAX,
            radii: [f32::MAX; 4],
            ..Self::default()
        };
        let widest_first: Vec<_> = (layer..).zip(cascades).collect();
        for (to, (layer, of)) in record.cascades.iter_mut().zip(widest_first.into_iter().rev()) {
            *to = CascadeRecord {
                offset: of.place_of(eye).as_vec3().to_array(),
                scale: (1.0 / (f64::from(MAP_SIDE) * of.texel)) as f32,
                radius: of.radius.min(f64::from(f32::MAX)) as f32,
                texel: of.texel as f32,
                layer,
                spread: of.spread() as f32,
            };
        }
        let [radii @ .., radius4, _] = record.cascades.map(|of| of.radius);
        let radius = |at: usize, radius| if at + 1 < cascades.len() { radius } else { f32::MAX };
        record.radius4 = radius(4, radius4);
        record.radii = std::array::from_fn(|at| radius(at, radii[at]));
        record
    }
}
