//! What one picture is seen through, and what of it the shaders read.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, Mat4, Vec3};

use super::cull::Planes;
use super::scene::{Lamp, Lights};

/// Directional lights in the uniforms; further ones are looked up like lamps.
pub(in crate::renderer) const SUNS_MAX: usize = 4;

/// What light from below is of light from above: a matt, warm ground.
const GROUND: Vec3 = Vec3::new(0.36, 0.32, 0.28);

/// Pixels by which the culled rectangle is wider than the drawn one, for points and lines.
const CULL_MARGIN: f64 = 1.0;

/// One view of a scene onto a target.
#[derive(Clone, Debug)]
pub struct ViewDesc {
    /// In world space.
    pub eye_in_world: DVec3,
    /// Applied to `p − eye`; a rotation, or one with a uniform scale.
    pub view_from_world: DMat3,
    /// Reversed and infinite depth: z/w is 1 at the near plane and 0 at infinity. Of the whole
    /// canvas, whatever part of it the target shows.
    pub clip_from_view: DMat4,
    /// The canvas, x, y, width, height in pixels of the target, y down. The tiles of one screen
    /// have one matrix, and canvases shifted by whole pixels.
    pub viewport: [f64; 4],
    /// Nothing is drawn outside this rectangle of the target: x, y, width, height in pixels.
    pub scissor: Option<[u32; 4]>,
    /// Factor of all light before tone mapping.
    pub exposure: f32,
}

/// Twin of `Frame` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(in crate::renderer) struct FrameUniform {
    pub clip_from_eye: [[f32; 4]; 4],
    pub sky: [f32; 3],
    pub exposure: f32,
    pub ground: [f32; 3],
    pub pad: f32,
    pub suns: [SunRecord; SUNS_MAX],
}

/// Twin of `Sun` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(in crate::renderer) struct SunRecord {
    pub toward: [f32; 3],
    pub pad0: f32,
    pub irradiance: [f32; 3],
    pub pad1: f32,
}

/// Twin of `Lamp` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(in crate::renderer) struct LampRecord {
    pub position: [f32; 3],
    pub inverse_range: f32,
    pub intensity: [f32; 3],
    pub directional: u32,
    pub direction: [f32; 3],
    pub pad: f32,
    pub cone: [f32; 2],
    pub pad2: [f32; 2],
}

impl LampRecord {
    /// The lamp as seen from the eye; subtracted in f64.
    pub fn new(lamp: &Lamp, eye: DVec3) -> Self {
        Self {
            position: (lamp.position - eye).as_vec3().to_array(),
            inverse_range: lamp.inverse_range,
            intensity: lamp.intensity.to_array(),
            directional: u32::from(lamp.directional),
            direction: lamp.direction.to_array(),
            pad: 0.0,
            cone: lamp.cone,
            pad2: [0.0; 2],
        }
    }
}

impl ViewDesc {
    /// Clip space from eye-relative world positions, multiplied in f64.
    pub(in crate::renderer) fn clip_from_eye(&self) -> DMat4 {
        self.clip_from_view * DMat4::from_mat3(self.view_from_world)
    }

    /// The same as the shaders have it: times a factor, which changes no picture, that makes the
    /// numerator of depth, near over distance, a power of two. Then only the division rounds
    /// depth, and no product.
    pub(in crate::renderer) fn scaled_clip_from_eye(&self) -> DMat4 {
        let near = self.clip_from_view.w_axis.z;
        let is_scaled = near.is_normal() && near > 0.0;
        let scale = if is_scaled { near.log2().round().exp2() / near } else { 1.0 };
        self.clip_from_eye() * scale
    }

    /// The uniforms of this view.
    pub(in crate::renderer) fn uniform(&self, sky: Vec3, lights: &Lights) -> FrameUniform {
        let mut suns = [SunRecord::default(); SUNS_MAX];
        for (record, sun) in suns.iter_mut().zip(&lights.suns) {
            record.toward = sun.toward.to_array();
            record.irradiance = sun.irradiance.to_array();
        }
        let clip_from_eye: Mat4 = self.scaled_clip_from_eye().as_mat4();
        FrameUniform {
            clip_from_eye: clip_from_eye.to_cols_array_2d(),
            sky: sky.to_array(),
            exposure: self.exposure,
            ground: (sky * GROUND).to_array(),
            pad: 0.0,
            suns,
        }
    }

    /// The pixels of a target of this size that the view may touch: x, y, width, height; `None`
    /// where there are none.
    pub(in crate::renderer) fn rectangle(&self, size: [u32; 2]) -> Option<[u32; 4]> {
        let [sx, sy, sw, sh] = self.scissor.unwrap_or([0, 0, size[0], size[1]]);
        let [vx, vy, vw, vh] = self.viewport;
        let span = |scissor: u32, length: u32, from: f64, extent: f64, side: u32| {
            let start = f64::from(scissor).max(from.floor()).max(0.0);
            let end = (f64::from(scissor) + f64::from(length)).min((from + extent).ceil());
            (start as u32, end.min(f64::from(side)).max(0.0) as u32)
        };
        let (x0, x1) = span(sx, sw, vx, vw, size[0]);
        let (y0, y1) = span(sy, sh, vy, vh, size[1]);
        (x0 < x1 && y0 < y1).then(|| [x0, y0, x1 - x0, y1 - y0])
    }

    /// The planes around a rectangle of the target.
    pub(in crate::renderer) fn planes(&self, rectangle: [u32; 4]) -> Planes {
        let [x, y, width, height] = rectangle.map(f64::from);
        let [vx, vy, vw, vh] = self.viewport;
        let across = |pixel: f64| (pixel - vx) / vw * 2.0 - 1.0;
        let up = |pixel: f64| 1.0 - (pixel - vy) / vh * 2.0;
        let left = across(x - CULL_MARGIN);
        let right = across(x + width + CULL_MARGIN);
        let (bottom, top) = (up(y + height + CULL_MARGIN), up(y - CULL_MARGIN));
        Planes::new(self.eye_in_world, &self.clip_from_eye(), [left, bottom, right, top])
    }

    /// Where a world point falls, in pixels of the target; `None` at or behind the near plane.
    pub(in crate::renderer) fn project(
        &self,
        clip_from_eye: &DMat4,
        point: DVec3,
    ) -> Option<[f64; 2]> {
        let clip = *clip_from_eye * (point - self.eye_in_world).extend(1.0);
        if !(clip.w > 0.0 && clip.z < clip.w) {
            return None;
        }
        let [vx, vy, vw, vh] = self.viewport;
        let ndc = clip.truncate() / clip.w;
        Some([vx + (ndc.x + 1.0) * 0.5 * vw, vy + (1.0 - ndc.y) * 0.5 * vh])
    }

    /// What is wrong with this view, if anything. `side_max` is the adapter's largest texture.
    pub(in crate::renderer) fn fault(&self, side_max: u32) -> Option<String> {
        let finite = self.eye_in_world.is_finite()
            && self.view_from_world.is_finite()
            && self.clip_from_view.is_finite()
            && self.viewport.iter().all(|number| number.is_finite())
            && self.exposure.is_finite();
        if !finite {
            return Some("a number in it is not finite".to_owned());
        }
        let [x, y, width, height] = self.viewport;
        let side_max = f64::from(side_max);
        if !(width > 0.0 && height > 0.0 && width <= side_max && height <= side_max) {
            return Some(format!("its canvas is {width} × {height}, where 1 to {side_max} can be"));
        }
        (x < -2.0 * side_max || y < -2.0 * side_max || x >= side_max || y >= side_max)
            .then(|| format!("its canvas begins at ({x}, {y}), out of reach"))
    }
}
