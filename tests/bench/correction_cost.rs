//! The cost of a correction: one channel of 1920 × 1080 on a cylinder, with blend weights, against
//! its scene; and the costs and gains of finer warp meshes.
//!
//! `cargo bench --bench correction_cost -- SCENE.glb ...`. Kinds of frames are drawn in turn, so
//! that a machine whose speed drifts spoils none.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, UVec2};
use polyptych_baker::{self, BakeCache};
use polyptych_files::blob::BlobHash;
use polyptych_render::frame_views;
use polyptych_renderer::{
    self, AtlasViewDesc, BlendMapDesc, Correction, CorrectionDesc, EyeAtlas, Gpu, GpuScene,
    ImageEncoding, Renderer, SceneBuilder, Target, ViewDesc,
};
use polyptych_wall::camera::Camera;
use polyptych_wall::surface::{Cylinder, Surface};
use polyptych_wall::view_atlas::ViewAtlas;
use polyptych_wall::warp_mesh::{TessellationOptions, WarpMesh};

const SIZE: [u32; 2] = [1920, 1080];
const ROUNDS: usize = 15;
const NEAR_M: f64 = 0.1;

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let scenes: Vec<_> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    if scenes.is_empty() {
        return Err("cargo bench --bench correction_cost -- SCENE.glb ...".into());
    }
    let gpu = Gpu::headless()?;
    println!("{}", gpu.info().name);
    meshes(&gpu)?;
    scenes.iter().try_for_each(|scene| share(&gpu, Path::new(scene)))
}

/// A screen of 3 m radius, 51° wide, whose pixels are 1.4 mm.
fn screen() -> Surface {
    Surface::Cylinder(Cylinder {
        center: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        radius_m: 3.0,
        azimuth_rad: [-0.45, 0.45],
        height_m: [-0.76, 0.76],
    })
}

fn point(pixel: DVec2) -> Option<DVec3> {
    screen().display_from_uv(pixel / UVec2::from(SIZE).as_dvec2())
}

/// A correction of the screen, and the planes of its source.
struct Corrected {
    correction: Correction,
    plan: ViewAtlas,
    eyes: Vec<EyeAtlas>,
    points: usize,
    off_px: f64,
}

impl Corrected {
    fn new(gpu: &Gpu, rule: TessellationOptions, is_weighted: bool) -> Result<Self, Failure> {
        let mesh = WarpMesh::new(UVec2::from(SIZE), rule, point);
        let eye = DVec3::ZERO;
        let plan = ViewAtlas::new(&mesh, &[eye], NEAR_M, gpu.info().texture_side_max)?;
        let warp = mesh.clone();
        // A ramp of 15 % at both sides.
        let weight = |at: u32| {
            let x = (f64::from(at % SIZE[0]) + 0.5) / f64::from(SIZE[0]);
            let t = (x.min(1.0 - x) / 0.15).min(1.0);
            [t * t * (3.0 - 2.0 * t), 1.0 - t]
        };
        let weights: Vec<_> = (0..SIZE[0] * SIZE[1]).map(weight).collect();
        let desc = CorrectionDesc {
            warp: Some(warp.into()),
            light_map: is_weighted.then(|| BlendMapDesc::new(&weights, DVec3::splat(0.003)).into()),
            dither: is_weighted.then_some(7),
            ..CorrectionDesc::identity(SIZE)
        };
        let planes = plan.planes[0].iter();
        let planes = planes
            .map(|plane| AtlasViewDesc {
                eye_in_display: eye,
                clip_from_eye: plane.clip_from_eye(),
                rect: plane.rect,
            })
            .collect();
        Ok(Self {
            correction: Correction::new(gpu, desc)?,
            plan,
            eyes: vec![EyeAtlas { planes, triangles: None }],
            points: mesh.vertices.len(),
            off_px: off_px(&mesh),
        })
    }

    /// The time of a correction in milliseconds, from its submission to its end.
    fn correct(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        source: &Target,
    ) -> Result<f64, Failure> {
        let picture = self.correction.picture(gpu);
        let start = Instant::now();
        let taps = self.plan.taps.to_array();
        let drawn = self.correction.draw(gpu, source, &self.eyes, taps, &picture)?;
        renderer.finish_submission(gpu, &drawn)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }
}

/// The largest error of 500 pixels in all places, in pixels.
fn off_px(mesh: &WarpMesh) -> f64 {
    let places = (0..500u32).map(|n| {
        // A low-discrepancy sequence: the golden ratio's generalisation to the plane.
        let n = f64::from(n);
        DVec2::new((n * 0.754_877_666).fract(), (n * 0.569_840_291).fract())
    });
    let pitch = 0.9 * 3.0 / f64::from(SIZE[0]);
    places
        .filter_map(|place| {
            let pixel = place * UVec2::from(SIZE).as_dvec2();
            Some(mesh.point_at(pixel)?.distance(point(pixel)?) / pitch)
        })
        .fold(0.0, f64::max)
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// The size of cells against error and time, over a source of nothing.
fn meshes(gpu: &Gpu) -> Result<(), Failure> {
    let steps = [128, 64, 32, 16, 8, 4];
    let rules = steps.map(|step_px| TessellationOptions { step_px, error_px: f64::INFINITY });
    let mut all = Vec::new();
    for rule in rules.into_iter().chain([TessellationOptions::default()]) {
        all.push((rule, Corrected::new(gpu, rule, false)?, Vec::new()));
    }
    let size = all.iter().fold(UVec2::ZERO, |size, (_, one, _)| size.max(one.plan.size));
    let source = Target::with_encoding(gpu, size.to_array(), 1, false, ImageEncoding::Light)?;
    let mut renderer = Renderer::new(gpu, 1)?;
    for round in 0..=ROUNDS {
        for (_, corrected, times) in &mut all {
            let took = corrected.correct(gpu, &mut renderer, &source)?;
            if round > 0 {
                times.push(took);
            }
        }
    }
    println!("cells of | points | off by at most | correction");
    for (rule, corrected, times) in all {
        let (points, off, took) = (corrected.points, corrected.off_px, median(times));
        let name = if rule.error_px.is_finite() { "the rule" } else { "" };
        println!("{:4} px {name} | {points} | {off:.4} px | {took:.1} ms", rule.step_px);
    }
    Ok(())
}

fn share(gpu: &Gpu, path: &Path) -> Result<(), Failure> {
    let (scene, camera) = open(gpu, path)?;
    let mut corrected = Corrected::new(gpu, TessellationOptions::default(), true)?;
    let mut warped = Corrected::new(gpu, TessellationOptions::default(), false)?;
    let mut renderer = Renderer::new(gpu, 1)?;
    renderer.prepare_for(gpu, &scene, ImageEncoding::Srgb);
    renderer.prepare_for(gpu, &scene, ImageEncoding::Light);
    let mut plain = Target::new(gpu, SIZE, 1, scene.has_transparency())?;
    let size = corrected.plan.size.to_array();
    let mut source =
        Target::with_encoding(gpu, size, 1, scene.has_transparency(), ImageEncoding::Light)?;
    let plane = corrected.plan.planes[0][0];
    let view = |viewport: [u32; 4]| ViewDesc {
        eye_in_world: camera.world_from_display(DVec3::ZERO),
        middle_eye_in_world: camera.world_from_display(DVec3::ZERO),
        view_from_world: plane.view_from_display
            * DMat3::from_quat(camera.rotation).transpose()
            * camera.scale.recip(),
        clip_from_view: DMat4::from_cols_array(&plane.clip_from_view.to_cols_array()),
        viewport: viewport.map(f64::from),
        scissor: None,
        exposure: 1.0,
        tone: polyptych_scene::ToneMapper::default(),
        fog: None,
        glow: None,
        ambient_occlusion: None,
        depth_of_field: None,
        subset: polyptych_scene::SceneSubset::default(),
        allowed_error: polyptych_renderer::AllowedError::NONE,
        has_shadows: false,
    };
    let (whole, part) = (view([0, 0, SIZE[0], SIZE[1]]), view(plane.rect));
    let mut times = [const { Vec::new() }; 4];
    for round in 0..=ROUNDS {
        let mut took = [0.0; 4];
        let start = Instant::now();
        renderer.draw(gpu, &scene, &mut plain, std::slice::from_ref(&whole))?;
        took[0] = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        renderer.draw(gpu, &scene, &mut source, std::slice::from_ref(&part))?;
        took[1] = start.elapsed().as_secs_f64() * 1e3;
        took[2] = warped.correct(gpu, &mut renderer, &source)?;
        took[3] = corrected.correct(gpu, &mut renderer, &source)?;
        // The first one compiles.
        if round > 0 {
            times.iter_mut().zip(took).for_each(|(times, took)| times.push(took));
        }
    }
    let [plain, source, warp, all] = times.map(median);
    println!(
        "{}: as drawn {plain:.1} ms; source of {} × {} {source:.1} ms, warp {warp:.1} ms, warp, \
         blend and dither {all:.1} ms: {:.1} % of the corrected frame, {:.1} % of the drawn one",
        path.display(),
        size[0],
        size[1],
        100.0 * all / (source + all),
        100.0 * all / plain
    );
    Ok(())
}

/// A scene on the GPU, and a camera that has all of it in sight.
fn open(gpu: &Gpu, path: &Path) -> Result<(GpuScene, Camera), Failure> {
    let folder = tempfile::tempdir()?;
    let store = BakeCache::open(folder.path())?;
    let baked = polyptych_baker::bake(path, &store, &mut |_| {}, &AtomicBool::new(false))?;
    let blobs = store.blobs();
    let read = |hash: BlobHash| {
        let bytes = blobs.read(hash)?;
        bytes.ok_or_else(|| Failure::from(format!("blob {hash} is missing")))
    };
    let manifest = polyptych_scene::decode(&read(baked.manifest)?)?;
    let mut builder = SceneBuilder::new(gpu, manifest.clone())?;
    for (index, texture) in manifest.textures.iter().enumerate() {
        builder.upload_texture(gpu, index, &read(texture.blob)?)?;
    }
    for (mesh, of_mesh) in manifest.meshes.iter().enumerate() {
        for (primitive, of_primitive) in of_mesh.primitives.iter().enumerate() {
            builder.upload_primitive(gpu, mesh, primitive, &read(of_primitive.blob)?)?;
        }
    }
    Ok((builder.finish(gpu)?, frame_views::warm_up_camera(&manifest)))
}
