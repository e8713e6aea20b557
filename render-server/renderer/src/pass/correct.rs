//! From the light of a source target to the codes of one display.
//!
//! The warp mesh itself is drawn, so that its points are interpolated by the rasteriser and no map
//! is read; mesh and maps go to the GPU once, and a frame brings two kilobytes.

mod cells;
mod correction_mesh;
mod light_map;
mod pipelines;

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, DVec4};
use polyptych_wall::TransferFunction;
use polyptych_wall::view_atlas::{SOURCE_CELLS_MAX, SOURCE_GUARD, SOURCE_PLANES_MAX};
use polyptych_wall::warp_mesh::WarpMesh;
use wgpu::util::DeviceExt;

use crate::correction::{
    AtlasViewDesc, CorrectionDesc, CorrectionError, EyeAtlas, curve_codes, mesh_fault,
};
use crate::frame::Submission;
use crate::gpu::Gpu;
use crate::output_texture::{ImageEncoding, OutputTexture};
use crate::pass::tonemap::{clear, resume};
use crate::target::TargetError;

pub(crate) use cells::CellRecord;
pub use correction_mesh::CorrectionMesh;
use light_map::LightMap;
use pipelines::{Pipelines, Sampling};

/// Source pixels beyond a plane's own that still count as its own: rounding must leave no point
/// between two planes.
const INNER_MARGIN: f64 = 0.5;

/// Entries of a measured curve as the shader reads it.
const CODE_COUNT: usize = 4096;

/// Samples for a pixel, across and down, at most: the source is then six times as dense as the
/// display.
pub const TAPS_MAX: u32 = 4;

/// Twin of `SourcePlane` in `correct.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct PlaneRecord {
    pub across: [f32; 4],
    pub down: [f32; 4],
    pub depth: [f32; 4],
    pub inner: [f32; 4],
}

/// Twin of `Eye` in `correct.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct EyeRecord {
    pub position: [f32; 4],
    pub clip_x: [f32; 4],
    pub clip_y: [f32; 4],
    pub upright_x: [f32; 4],
    pub upright_y: [f32; 4],
}

/// Twin of `Correction` in `correct.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct CorrectionUniform {
    pub eyes: [EyeRecord; 2],
    pub planes: [PlaneRecord; 2 * SOURCE_PLANES_MAX],
    pub red: [f32; 4],
    pub green: [f32; 4],
    pub blue: [f32; 4],
    pub light_scale: [f32; 4],
    pub inverse_gamma: [f32; 4],
    pub even_weights: [[f32; 4]; 3],
    pub texel: [f32; 2],
    pub pad: [f32; 2],
}

/// One channel's correction, on the GPU.
#[derive(Debug)]
pub struct Correction {
    desc: CorrectionDesc,
    shape: Rc<CorrectionMesh>,
    light_map: LightMap,
    codes: wgpu::Buffer,
    pipelines: Rc<RefCell<Pipelines>>,
}

impl Correction {
    /// Takes a description to the GPU.
    ///
    /// # Errors
    /// The description is invalid; the error says why.
    pub fn new(gpu: &Gpu, desc: CorrectionDesc) -> Result<Self, CorrectionError> {
        Self::after(gpu, desc, None)
    }

    /// Takes a description to the GPU; what it has in common with that of a `known` correction on
    /// the same GPU, and all that was compiled, is shared with it.
    ///
    /// # Errors
    /// The description is invalid; the error says why.
    pub fn after(
        gpu: &Gpu,
        desc: CorrectionDesc,
        known: Option<&Self>,
    ) -> Result<Self, CorrectionError> {
        check(gpu, &desc)?;
        let same_shape = known.filter(|known| {
            is_same(known.desc.warp.as_ref(), desc.warp.as_ref())
                && known.desc.upright == desc.upright
        });
        let shape = match same_shape {
            Some(known) => Rc::clone(&known.shape),
            None => Rc::new(CorrectionMesh::new(gpu, desc.upright, desc.warp.as_deref())),
        };
        let same_light =
            known.filter(|known| is_same(known.desc.light_map.as_ref(), desc.light_map.as_ref()));
        let light_map = match same_light {
            Some(known) => known.light_map.clone(),
            None => LightMap::new(gpu, &desc),
        };
        let pipelines = match known {
            Some(known) => Rc::clone(&known.pipelines),
            None => Rc::new(RefCell::new(Pipelines::new(gpu))),
        };
        let codes = codes(gpu, &desc.curve);
        Ok(Self { desc, shape, light_map, codes, pipelines })
    }

    /// Returns whether all is compiled that such a draw needs.
    pub fn is_warm(&self, eyes: &[EyeAtlas], taps: [u32; 2]) -> bool {
        let sampling = Sampling::new(eyes, taps);
        let pipelines = self.pipelines.borrow();
        (0..self.desc.packing.eyes()).all(|eye| {
            let areas = self.areas(eye);
            let mut kinds = areas.iter().map(|(_, is_even)| (eye, *is_even));
            kinds.all(|part| pipelines.has(&self.desc, sampling, part))
        })
    }

    /// Width and height of the display's picture, in pixels.
    pub fn display_size(&self) -> [u32; 2] {
        self.desc.display_size()
    }

    /// Returns the encoding of its pictures.
    pub fn content(&self) -> ImageEncoding {
        if self.desc.is_fine { ImageEncoding::FineCodes } else { ImageEncoding::Codes }
    }

    /// A picture that [`Self::draw`] can draw onto, in pixels of the display.
    pub fn picture(&self, gpu: &Gpu) -> OutputTexture {
        OutputTexture::new(gpu, self.display_size(), self.content())
    }

    /// The pixels of a mesh, to be drawn over others of this correction ([`Self::draw_overlay`]).
    ///
    /// # Errors
    /// The mesh is invalid, or the correction resamples nothing.
    pub fn shape(&self, gpu: &Gpu, warp: &WarpMesh) -> Result<CorrectionMesh, CorrectionError> {
        if self.desc.warp.is_none() {
            return Err(CorrectionError::Source("a correction without a warp has one shape"));
        }
        match mesh_fault(warp, self.desc.upright) {
            Some(reason) => Err(CorrectionError::Mesh(reason)),
            None => Ok(CorrectionMesh::new(gpu, self.desc.upright, Some(warp))),
        }
    }

    /// Submits what the eyes see of the source: one eye, or the left and the right one. `taps` are
    /// the samples across and down that one display pixel takes, 1 to 4 each.
    ///
    /// # Errors
    /// The source holds no light, or not these planes; the picture is none of [`Self::picture`];
    /// or the GPU failed.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        source: impl AsRef<OutputTexture>,
        eyes: &[EyeAtlas],
        taps: [u32; 2],
        onto: &OutputTexture,
    ) -> Result<Submission, CorrectionError> {
        self.draw_shape(gpu, None, source.as_ref(), (eyes, taps), onto)
    }

    /// Draws as [`Self::draw`] does, but only the pixels of a shape of this correction: the others
    /// stay.
    ///
    /// # Errors
    /// Those of [`Self::draw`].
    pub fn draw_overlay(
        &mut self,
        gpu: &Gpu,
        shape: &CorrectionMesh,
        source: impl AsRef<OutputTexture>,
        eyes_and_taps: (&[EyeAtlas], [u32; 2]),
        onto: &OutputTexture,
    ) -> Result<Submission, CorrectionError> {
        self.draw_shape(gpu, Some(shape), source.as_ref(), eyes_and_taps, onto)
    }

    fn draw_shape(
        &mut self,
        gpu: &Gpu,
        over: Option<&CorrectionMesh>,
        source: &OutputTexture,
        (eyes, taps): (&[EyeAtlas], [u32; 2]),
        onto: &OutputTexture,
    ) -> Result<Submission, CorrectionError> {
        if source.content() != ImageEncoding::Light {
            return Err(CorrectionError::Source("the source does not hold light"));
        }
        if onto.content() != self.content() || onto.size() != self.display_size() {
            return Err(CorrectionError::Source("the picture is not this display's"));
        }
        self.check_planes(source.size(), eyes)?;
        let sampling = Sampling::new(eyes, taps);
        let mut pipelines = self.pipelines.borrow_mut();
        let drawn: Vec<_> = (0..self.desc.packing.eyes())
            .flat_map(|eye| self.areas(eye).into_iter().map(move |area| (eye, area)))
            .map(|(eye, (sides, is_even))| {
                (sides, pipelines.of(gpu, &self.desc, sampling, (eye, is_even)))
            })
            .collect();
        let shape = over.unwrap_or(&self.shape);
        let uniform = self.uniform(shape.origin_in_display, source.size(), eyes);
        gpu.queue.write_buffer(&shape.uniform, 0, bytemuck::bytes_of(&uniform));
        let cells = cells::records(gpu, eyes, shape.origin_in_display);
        let parts = shape.parts(gpu, eyes);
        let resources = [
            wgpu::BindingResource::TextureView(source.view()),
            shape.uniform.as_entire_binding(),
            wgpu::BindingResource::TextureView(&self.light_map.view),
            self.codes.as_entire_binding(),
            cells.as_entire_binding(),
        ];
        let group = pipelines.group(gpu, resources);
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("correct") });
        {
            let view = onto.codes_view(gpu);
            let mut pass = match over {
                None => clear(&mut encoder, "correct/pass", &view, wgpu::Color::BLACK),
                Some(_) => resume(&mut encoder, "correct/pass", &view),
            };
            pass.set_bind_group(1, &group, &[]);
            pass.set_vertex_buffer(0, shape.corners.slice(..));
            pass.set_index_buffer(parts.indices.slice(..), wgpu::IndexFormat::Uint32);
            for ([left, top, right, bottom], pipeline) in &drawn {
                pass.set_scissor_rect(*left, *top, right - left, bottom - top);
                pass.set_pipeline(pipeline);
                for (cell, part) in (0..).zip(&parts.ranges) {
                    pass.draw_indexed(part.clone(), 0, cell..cell + 1);
                }
            }
        }
        Ok(Submission::new(gpu, encoder))
    }

    /// The parts of an eye's picture on the display, as left, top, right and bottom, and whether
    /// all pixels of one have the same weights.
    fn areas(&self, eye: usize) -> Vec<([u32; 4], bool)> {
        let [width, height] = self.desc.upright;
        let Some(even) = self.light_map.even else {
            return vec![(self.on_display([0, 0, width, height], eye), false)];
        };
        let others = even.others([width, height]).map(|sides| (sides, false));
        let all = std::iter::once((even.sides, true)).chain(others);
        all.map(|(sides, is_even)| (self.on_display(sides, eye), is_even)).collect()
    }

    /// Sides of a part of an eye's upright picture, in pixels of the display.
    fn on_display(&self, [left, top, right, bottom]: [u32; 4], eye: usize) -> [u32; 4] {
        let rows = self.desc.display_from_upright(eye);
        let place =
            |x: u32, y: u32| rows.map(|[a, b, c]| (a * f64::from(x) + b * f64::from(y) + c) as u32);
        let (one, other) = (place(left, top), place(right, bottom));
        let low = [0, 1].map(|at| one[at].min(other[at]));
        let high = [0, 1].map(|at| one[at].max(other[at]));
        [low[0], low[1], high[0], high[1]]
    }

    /// Checks that eyes have the planes that this correction needs.
    fn check_planes(
        &self,
        [width, height]: [u32; 2],
        eyes: &[EyeAtlas],
    ) -> Result<(), CorrectionError> {
        let refused = |reason| Err(CorrectionError::Source(reason));
        if eyes.len() != self.desc.packing.eyes() {
            return refused("as many eyes are needed as the packing has");
        }
        let count = eyes.iter().map(|eye| eye.planes.len()).max().unwrap_or(0);
        let has_cells = eyes.iter().any(|eye| eye.triangles.is_some());
        let most = if has_cells { SOURCE_CELLS_MAX } else { SOURCE_PLANES_MAX };
        if !(1..=most).contains(&count) || eyes.iter().any(|e| e.planes.is_empty()) {
            return refused("an eye has 1 to 6 planes, or 64 with triangles of their own");
        }
        let is_odd = |eye: &EyeAtlas| {
            let owned = eye.triangles.as_ref().map_or(count, |owned| owned.len());
            eye.triangles.is_some() != has_cells || owned != count || eye.planes.len() != count
        };
        if has_cells && eyes.iter().any(is_odd) {
            return refused("each eye needs a plane for each list of triangles");
        }
        let is_exact = self.desc.warp.is_none();
        let guard = if is_exact { 0 } else { 2 * SOURCE_GUARD };
        for plane in eyes.iter().flat_map(|eye| &eye.planes) {
            let [x, y, w, h] = plane.rect;
            let is_inside = |at: u32, length: u32, side: u32| {
                length > guard && at.checked_add(length).is_some_and(|end| end <= side)
            };
            if !(is_inside(x, w, width) && is_inside(y, h, height)) {
                return refused("a plane does not lie in the source");
            }
            if is_exact && [w, h] != self.desc.upright {
                return refused("a plane has not the size of the upright picture");
            }
        }
        Ok(())
    }

    fn uniform(
        &self,
        origin_in_display: DVec3,
        source: [u32; 2],
        eyes: &[EyeAtlas],
    ) -> CorrectionUniform {
        let [width, height] = self.display_size().map(f64::from);
        let mut uniform = CorrectionUniform {
            texel: source.map(|side| (1.0 / f64::from(side)) as f32),
            ..CorrectionUniform::default()
        };
        let is_exact = self.desc.warp.is_none();
        for (index, eye) in eyes.iter().enumerate() {
            let [x, y] = self.desc.display_from_upright(index);
            let clip_x = [x[0] * 2.0 / width, x[1] * 2.0 / width, x[2] * 2.0 / width - 1.0];
            let clip_y = [-y[0] * 2.0 / height, -y[1] * 2.0 / height, 1.0 - y[2] * 2.0 / height];
            let back = DMat3::from_cols_array(&[x[0], y[0], 0.0, x[1], y[1], 0.0, x[2], y[2], 1.0])
                .inverse();
            let position = eye.planes[0].eye_in_display - origin_in_display;
            uniform.eyes[index] = EyeRecord {
                position: row(position.extend(0.0)),
                clip_x: row(DVec3::from(clip_x).extend(0.0)),
                clip_y: row(DVec3::from(clip_y).extend(0.0)),
                upright_x: row(back.row(0).extend(0.0)),
                upright_y: row(back.row(1).extend(0.0)),
            };
            // Eyes with fewer planes than the other have their last one again.
            for slot in 0..SOURCE_PLANES_MAX {
                if let Some(plane) = eye.planes.get(slot).or(eye.planes.last()) {
                    uniform.planes[index * SOURCE_PLANES_MAX + slot] = plane.record(is_exact);
                }
            }
        }
        let color = &self.desc.color;
        [uniform.red, uniform.green, uniform.blue] =
            [0, 1, 2].map(|at| row(color.row(at).extend(0.0)));
        if let Some(map) = &self.desc.light_map {
            uniform.light_scale = row(map.add.extend(map.multiply));
        }
        if let Some(even) = &self.light_map.even {
            uniform.even_weights = even.bytes();
        }
        if let TransferFunction::Gamma(gamma) = &self.desc.curve {
            uniform.inverse_gamma = row(gamma.recip().extend(0.0));
        }
        uniform
    }
}

impl AtlasViewDesc {
    /// The rows of the matrix to texels, multiplied in f64.
    fn record(&self, is_exact: bool) -> PlaneRecord {
        let [x, y, width, height] = self.rect.map(f64::from);
        let [across, up, depth] = [0, 1, 3].map(|at| self.clip_from_eye.row(at));
        let guard = if is_exact { 0.0 } else { f64::from(SOURCE_GUARD) - INNER_MARGIN };
        let inner = [x + guard, y + guard, x + width - guard, y + height - guard];
        PlaneRecord {
            across: row(depth * (x + width / 2.0) + across * (width / 2.0)),
            down: row(depth * (y + height / 2.0) - up * (height / 2.0)),
            depth: row(depth),
            inner: inner.map(|number| number as f32),
        }
    }
}

fn row(row: DVec4) -> [f32; 4] {
    row.as_vec4().to_array()
}

/// Returns whether two descriptions share a part, or both are without it.
fn is_same<T>(a: Option<&Arc<T>>, b: Option<&Arc<T>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// The codes of a measured curve; of another one, two that nobody reads.
fn codes(gpu: &Gpu, curve: &TransferFunction) -> wgpu::Buffer {
    let codes = match curve {
        TransferFunction::Measured(_) => curve_codes(curve, CODE_COUNT),
        _ => vec![DVec3::ZERO; 2],
    };
    let codes: Vec<[f32; 4]> = codes.iter().map(|code| row(code.extend(0.0))).collect();
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("correct/codes"),
        contents: bytemuck::cast_slice(&codes),
        usage: wgpu::BufferUsages::STORAGE,
    })
}

/// Validates a description for this adapter.
fn check(gpu: &Gpu, desc: &CorrectionDesc) -> Result<(), CorrectionError> {
    let [width, height] = desc.display_size();
    let side_max = gpu.device.limits().max_texture_dimension_2d;
    if [width, height].iter().any(|side| !(1..=side_max).contains(side)) {
        return Err(TargetError::Size { width, height, side_max }.into());
    }
    desc.fault().map_or(Ok(()), Err)
}
