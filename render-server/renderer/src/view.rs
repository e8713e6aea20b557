//! The camera of one picture, and the part of it that the shaders read.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, DVec4, Mat4, Vec3, Vec4};
use polyptych_scene::{
    AmbientOcclusion, DepthOfField, Fog, Glow, LightEffects, SceneSubset, ToneMapper,
};

use super::cull::FrustumPlanes;
use super::pass::ambient_occlusion::OcclusionPlace;
use super::scene::{Bounds, GpuScene, LampGrid, LocalLight, Selection};

/// Directional lights in the uniforms; further ones are looked up like lamps.
pub(crate) const SUNS_MAX: usize = 4;

/// Pixels by which the culled rectangle is wider than the drawn one, for points and lines.
const CULL_MARGIN: f64 = 1.0;

/// Share of a scene's extent by which the depth of parallel rays reaches beyond it: more than f32
/// rounds, nothing that one would miss.
const DEPTH_MARGIN: f64 = 1e-5;

/// The least depth of parallel rays, in metres of the view: a flat scene has none of its own.
const DEPTH_MIN_M: f64 = 1e-3;

/// The depth of a scene without known bounds, in units of the world.
const DEPTH_UNKNOWN: f64 = 1e6;

/// The logarithm of a density of fog that is none; see `fog_passed_from_afar` in `fog.wgsl`.
const FOG_LOG_OF_NONE: f64 = -3e38;

/// The logarithms of densities at the eye: what is thinner is none, but far below the eye it may be
/// dense, so that only what f32 cannot hold is cut off; what is denser is solid.
const FOG_LOG_RANGE: [f64; 2] = [-1e30, 9000.0];

/// One view of a scene onto a target.
#[derive(Clone, Debug)]
pub struct ViewDesc {
    /// In world space.
    pub eye_in_world: DVec3,
    /// The middle of both eyes. Sorting is by the distance to this point, so that both eyes agree
    /// on the order.
    pub middle_eye_in_world: DVec3,
    /// Applied to `p − eye`; a rotation, or one with a uniform scale.
    pub view_from_world: DMat3,
    /// Reversed and infinite depth: z/w is 1 at the near plane and 0 at infinity. Of the whole
    /// canvas, whatever part of it the target shows. Where its last row is (0, 0, 0, 1) all rays
    /// are parallel, and only the near plane of its depth counts: the far one is fitted to the
    /// scene.
    pub clip_from_view: DMat4,
    /// The canvas, x, y, width, height in pixels of the target, y down. The tiles of one screen
    /// have one matrix, and canvases shifted by whole pixels.
    pub viewport: [f64; 4],
    /// Nothing is drawn outside this rectangle of the target: x, y, width, height in pixels.
    pub scissor: Option<[u32; 4]>,
    /// Factor of all light before tone mapping.
    pub exposure: f32,
    /// The way from exposed light to what is shown; that of the first view counts for the frame.
    pub tone: ToneMapper,
    /// Fog between the eye and what it sees; none where rays are parallel.
    pub fog: Option<Fog>,
    /// Light that spreads around what is bright; none where rays are parallel.
    pub glow: Option<Glow>,
    /// Corners and gaps get less of the light from all around.
    pub ambient_occlusion: Option<AmbientOcclusion>,
    /// What is nearer or farther than a distance is blurred; nothing where rays are parallel.
    pub depth_of_field: Option<DepthOfField>,
    /// The part of the scene that it shows.
    pub subset: SceneSubset,
    /// The error up to which coarser levels of detail are drawn.
    pub allowed_error: AllowedError,
    /// Lights cast shadows in it, if they do so in the scene and for the renderer.
    pub has_shadows: bool,
}

/// The distance by which surfaces may be drawn beside their place, as a function of their distance
/// to [`ViewDesc::middle_eye_in_world`]. All channels have the same one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AllowedError {
    /// In radians as seen from that point: the part of the error that grows with the distance.
    pub angle_rad: f64,
    /// In units of the world: the part that does not. Of parallel rays it is all there is.
    pub length: f64,
    /// The distance of any eye of the wall from that point, in units of the world: each view allows
    /// no more than the eye that is farthest from it does, whichever it is for.
    pub eye_offset: f64,
    /// A pixel, in radians or, of parallel rays, in units of the world: the unit of errors of
    /// levels that are drawn for want of finer ones where no error is allowed. 0 if not known.
    pub pixel: f64,
    /// The error changes with the rate of frames: what takes long to draw anew, such as maps of
    /// shadows, is as where some error is allowed.
    pub follows_rate: bool,
}

impl AllowedError {
    /// Only the finest level.
    pub const NONE: Self =
        Self { angle_rad: 0.0, length: 0.0, eye_offset: 0.0, pixel: 0.0, follows_rate: false };

    /// Returns whether all that is drawn is of the finest level.
    pub(crate) fn is_none(&self) -> bool {
        self.angle_rad <= 0.0 && self.length <= 0.0 && !self.follows_rate
    }
}

/// Twin of `Frame` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct FrameUniform {
    pub clip_from_eye: [[f32; 4]; 4],
    pub sky: [f32; 3],
    pub exposure: f32,
    pub ground: [f32; 3],
    pub fog_fall: f32,
    pub eye: [f32; 4],
    pub fog: [f32; 4],
    pub lamp_origin: [f32; 3],
    pub cells_per_unit: f32,
    pub lamp_cells: [u32; 3],
    pub surroundings: f32,
    pub occlusion: OcclusionPlace,
    pub tone_mapper: u32,
    pub pad: [u32; 3],
    pub suns: [DirectionalLightRecord; SUNS_MAX],
}

/// Twin of `Sun` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct DirectionalLightRecord {
    pub toward: [f32; 3],
    pub pad0: f32,
    pub irradiance: [f32; 3],
    pub pad1: f32,
}

/// Twin of `Lamp` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LocalLightRecord {
    pub position: [f32; 3],
    pub inverse_range: f32,
    pub intensity: [f32; 3],
    pub directional: u32,
    pub direction: [f32; 3],
    pub pad: f32,
    pub cone: [f32; 2],
    pub pad2: [f32; 2],
}

impl LocalLightRecord {
    /// The lamp as seen from the eye; subtracted in f64. Dark where a part of the scene is without
    /// it.
    pub fn new(lamp: &LocalLight, eye: DVec3, part: Selection) -> Self {
        Self {
            position: (lamp.position - eye).as_vec3().to_array(),
            inverse_range: lamp.inverse_range,
            intensity: lamp.on.color_in(lamp.intensity, part).to_array(),
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
    pub(crate) fn clip_from_eye(&self) -> DMat4 {
        self.clip_from_view * DMat4::from_mat3(self.view_from_world)
    }

    /// Returns the clip matrix as the shaders have it: times a factor, which changes no picture,
    /// that makes the numerator of depth, near over distance, a power of two. Then only the
    /// division rounds depth, and no product.
    pub(crate) fn scaled_clip_from_eye(&self) -> DMat4 {
        let near = self.clip_from_view.w_axis.z;
        let is_scaled = near.is_normal() && near > 0.0;
        let scale = if is_scaled { near.log2().round().exp2() / near } else { 1.0 };
        self.clip_from_eye() * scale
    }

    /// Returns whether all rays are parallel, instead of meeting in the eye.
    pub(crate) fn is_parallel(&self) -> bool {
        self.clip_from_view.row(3) == DVec4::W
    }

    /// The unit vector in world space along which the middle ray looks.
    pub(crate) fn forward(&self) -> DVec3 {
        -self.view_from_world.row(2).normalize_or(DVec3::Z)
    }

    /// The eye relative to itself: the origin, or with w = 0 the direction to it where all rays are
    /// parallel.
    pub(crate) fn homogeneous_eye(&self) -> Vec4 {
        if self.is_parallel() { (-self.forward()).as_vec3().extend(0.0) } else { Vec4::W }
    }

    /// Returns the distance of a box for the order of drawing, to its centre or to its nearest
    /// point. The distance to an eye is squared; for parallel rays it is the depth, which may be
    /// negative.
    pub(crate) fn sort_depth(&self, of: &Bounds, by_nearest: bool) -> f64 {
        if self.is_parallel() {
            let forward = self.forward();
            let depth = forward.dot(of.center() - self.eye_in_world);
            return depth - if by_nearest { forward.abs().dot(of.half()) } else { 0.0 };
        }
        if by_nearest {
            of.distance_squared(self.middle_eye_in_world)
        } else {
            self.point_depth(of.center())
        }
    }

    /// A measure of how far away a point in world space is, the same for both eyes: the square of
    /// its distance, or its depth where rays are parallel.
    pub(crate) fn point_depth(&self, point: DVec3) -> f64 {
        if self.is_parallel() {
            self.forward().dot(point - self.eye_in_world)
        } else {
            point.distance_squared(self.middle_eye_in_world)
        }
    }

    /// Returns this view with a depth range fitted to the scene behind the near plane, if rays are
    /// parallel. The eye moves along them to where the scene begins, so that f32 has the scene's
    /// own size to resolve and not its distance. The smallest step in depth is then the scene's
    /// extent along the rays × 2⁻²⁴, 0.6 mm of 10 km, and finer towards the far end.
    pub(crate) fn with_fitted_depth(&self, scene: &Bounds) -> Self {
        if !self.is_parallel() {
            return self.clone();
        }
        let forward = self.forward();
        let world_per_metre = self.view_from_world.row(2).length().recip();
        let (slope, at_eye) = (self.clip_from_view.z_axis.z, self.clip_from_view.w_axis.z);
        let near = (at_eye - 1.0) / slope * world_per_metre;
        let middle = forward.dot(scene.center() - self.eye_in_world);
        let half = forward.abs().dot(scene.half());
        let is_known = middle.is_finite() && half.is_finite();
        let (begin, end) = if is_known { (middle - half, middle + half) } else { (near, near) };
        // Beyond what f32 rounds away from a box that is flat along the rays.
        let margin = (half + middle.abs() * f64::EPSILON) * DEPTH_MARGIN;
        let begin = if is_known { near.max(begin - margin) } else { near };
        let least = world_per_metre * DEPTH_MIN_M;
        let depth = if is_known { (end + margin - begin).max(least) } else { DEPTH_UNKNOWN };
        let mut clip_from_view = self.clip_from_view;
        clip_from_view.z_axis.z = world_per_metre / depth;
        clip_from_view.w_axis.z = 1.0;
        let eye_in_world = self.eye_in_world + forward * begin;
        Self { eye_in_world, clip_from_view, ..self.clone() }
    }

    /// Returns which effects of light it has.
    pub fn effects(&self) -> LightEffects {
        LightEffects {
            fog: self.fog.is_some(),
            glow: self.glow.is_some(),
            ambient_occlusion: self.ambient_occlusion.is_some(),
            depth_of_field: self.depth_of_field.is_some(),
        }
    }

    /// The uniforms of this view of a part of a scene.
    pub(crate) fn uniform(&self, scene: &GpuScene, part: Selection) -> FrameUniform {
        let mut suns = [DirectionalLightRecord::default(); SUNS_MAX];
        for (record, sun) in suns.iter_mut().zip(scene.suns()) {
            record.toward = sun.toward.to_array();
            record.irradiance = sun.on.color_in(sun.irradiance, part).to_array();
        }
        let clip_from_eye: Mat4 = self.scaled_clip_from_eye().as_mat4();
        let fog = self.fog.filter(|_| !self.is_parallel());
        let color = fog.map_or(Vec3::ZERO, |fog| fog.color.into());
        let fog_log = fog.map_or(FOG_LOG_OF_NONE, |fog| {
            fog.log_density(self.eye_in_world.y).clamp(FOG_LOG_RANGE[0], FOG_LOG_RANGE[1])
        });
        let grid = scene.layout.lights.grid.as_ref();
        let from_eye = |grid: &LampGrid| (grid.origin - self.eye_in_world).as_vec3();
        FrameUniform {
            clip_from_eye: clip_from_eye.to_cols_array_2d(),
            sky: scene.layout.sky.to_array(),
            exposure: self.exposure,
            ground: scene.layout.ground.to_array(),
            fog_fall: fog.map_or(0.0, |fog| fog.fall()) as f32,
            eye: self.homogeneous_eye().to_array(),
            fog: (color * scene.scattered(part)).extend(fog_log as f32).to_array(),
            lamp_origin: grid.map_or(Vec3::ZERO, from_eye).to_array(),
            cells_per_unit: grid.map_or(0.0, |grid| grid.side.recip() as f32),
            lamp_cells: grid.map_or([0; 3], |grid| grid.cells.to_array()),
            surroundings: scene.surroundings_scale(),
            occlusion: OcclusionPlace::default(),
            tone_mapper: self.tone.number() as u32,
            pad: [0; 3],
            suns,
        }
    }

    /// The pixels of a target of this size that the view may touch: x, y, width, height; `None`
    /// where there are none.
    pub(crate) fn rectangle(&self, size: [u32; 2]) -> Option<[u32; 4]> {
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
    pub(crate) fn planes(&self, rectangle: [u32; 4]) -> FrustumPlanes {
        let [x, y, width, height] = rectangle.map(f64::from);
        let [vx, vy, vw, vh] = self.viewport;
        let across = |pixel: f64| (pixel - vx) / vw * 2.0 - 1.0;
        let up = |pixel: f64| 1.0 - (pixel - vy) / vh * 2.0;
        let left = across(x - CULL_MARGIN);
        let right = across(x + width + CULL_MARGIN);
        let (bottom, top) = (up(y + height + CULL_MARGIN), up(y - CULL_MARGIN));
        FrustumPlanes::new(self.eye_in_world, &self.clip_from_eye(), [left, bottom, right, top])
    }

    /// Returns the position of a world point in pixels of the target; `None` at or behind the near
    /// plane.
    pub(crate) fn project(&self, clip_from_eye: &DMat4, point: DVec3) -> Option<[f64; 2]> {
        let clip = *clip_from_eye * (point - self.eye_in_world).extend(1.0);
        if !(clip.w > 0.0 && clip.z < clip.w) {
            return None;
        }
        let [vx, vy, vw, vh] = self.viewport;
        let ndc = clip.truncate() / clip.w;
        Some([vx + (ndc.x + 1.0) * 0.5 * vw, vy + (1.0 - ndc.y) * 0.5 * vh])
    }

    /// Returns the first fault of this view; `None` if it is valid. `side_max` is the adapter's
    /// largest texture.
    pub(crate) fn fault(&self, side_max: u32) -> Option<String> {
        let finite = self.eye_in_world.is_finite()
            && self.view_from_world.is_finite()
            && self.clip_from_view.is_finite()
            && self.viewport.iter().all(|number| number.is_finite())
            && self.exposure.is_finite();
        if !finite {
            return Some("a number in it is not finite".to_owned());
        }
        if let Some(fault) = self.fog.and_then(|fog| fog.fault()) {
            return Some(fault);
        }
        if let Some(fault) = self.glow.and_then(|glow| glow.fault()) {
            return Some(fault);
        }
        if let Some(fault) = self.ambient_occlusion.and_then(|of| of.fault()) {
            return Some(fault);
        }
        if let Some(fault) = self.depth_of_field.and_then(|of| of.fault()) {
            return Some(fault);
        }
        let AllowedError { angle_rad, length, eye_offset, pixel, .. } = self.allowed_error;
        let is_error = |number: f64| number.is_finite() && number >= 0.0;
        if ![angle_rad, length, eye_offset, pixel].into_iter().all(is_error) {
            let got = format!(
                "{angle_rad} rad and {length} units of the world, of eyes {eye_offset} off"
            );
            return Some(format!("its allowed error is {got}, where 0 and more can be"));
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
