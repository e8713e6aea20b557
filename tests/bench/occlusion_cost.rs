//! Cost of frames with and without occlusion culling along a walk through a scene, in one run.
//!
//! `cargo bench --bench occlusion_cost -- SCENE.glb X,Y,Z X,Y,Z [STORE]`: the camera goes from the
//! first point to the second and looks ahead. Frames are drawn with and without in turn, so that a
//! machine whose speed drifts favours neither, and their pictures are compared. `STORE` is a folder
//! that keeps the baked scene for the next run.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::{DMat3, DMat4, DVec3, DVec4};
use polyptych_baker::{self, BakeCache};
use polyptych_files::blob::BlobHash;
use polyptych_renderer::{
    AllowedError, DrawStats, Gpu, GpuScene, OcclusionCulling, Renderer, SceneBuilder, Target,
    ViewDesc, read_pixels,
};
use polyptych_scene::{SceneSubset, ToneMapper};

const SIZE: [u32; 2] = [1920, 1080];
const FRAMES: usize = 24;
/// Frames that fill caches.
const WARM_UP: usize = 3;
const NEAR_M: f64 = 0.05;

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let given: Vec<_> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let (Some(scene), Some(from), Some(to)) = (given.first(), given.get(1), given.get(2)) else {
        return Err("cargo bench --bench occlusion_cost -- SCENE.glb X,Y,Z X,Y,Z [STORE]".into());
    };
    let gpu = Gpu::headless()?;
    println!("{}", gpu.info().name);
    let scene = open(&gpu, Path::new(scene), given.get(3).map(Path::new))?;
    walk(&gpu, &scene, point(from)?, point(to)?)
}

fn point(text: &str) -> Result<DVec3, Failure> {
    let numbers: Vec<f64> = text.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let [x, y, z] = numbers[..] else { return Err(format!("{text}: give X,Y,Z").into()) };
    Ok(DVec3::new(x, y, z))
}

fn look(eye: DVec3, at: DVec3) -> ViewDesc {
    let z = (eye - at).normalize();
    let x = DVec3::Y.cross(z).normalize_or(DVec3::X);
    let f = 1.0 / 22.5f64.to_radians().tan();
    let [width, height] = SIZE.map(f64::from);
    ViewDesc {
        eye_in_world: eye,
        middle_eye_in_world: eye,
        view_from_world: DMat3::from_cols(x, z.cross(x), z).transpose(),
        clip_from_view: DMat4::from_cols(
            DVec4::X * f * height / width,
            DVec4::Y * f,
            -DVec4::W,
            DVec4::Z * NEAR_M,
        ),
        viewport: [0.0, 0.0, width, height],
        scissor: None,
        exposure: 1.0,
        tone: ToneMapper::default(),
        fog: None,
        glow: None,
        ambient_occlusion: None,
        depth_of_field: None,
        subset: SceneSubset::default(),
        allowed_error: AllowedError::NONE,
        has_shadows: false,
    }
}

/// Processor time of this process so far, in milliseconds, from ticks of 10 ms: on a busy machine
/// it tells more than the time that passes, where the driver draws on the processor.
fn processor_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let behind_name = text.rsplit(')').next().unwrap_or_default();
    let numbers = behind_name.split_whitespace().skip(11).take(2);
    numbers.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() * 10.0
}

/// The frames that are drawn with or without.
struct Run {
    name: &'static str,
    renderer: Renderer,
    target: Target,
    frames: Vec<DrawStats>,
    processor_ms: f64,
}

fn walk(gpu: &Gpu, scene: &GpuScene, from: DVec3, to: DVec3) -> Result<(), Failure> {
    let mut runs = Vec::new();
    let ways = [("without", OcclusionCulling::Never), ("with", OcclusionCulling::Always)];
    for (name, when) in ways {
        let mut renderer = Renderer::new(gpu, 1)?;
        renderer.set_occlusion(when);
        renderer.prepare(gpu, scene);
        let target = Target::new(gpu, SIZE, 1, scene.has_transparency())?;
        runs.push(Run { name, renderer, target, frames: Vec::new(), processor_ms: 0.0 });
    }
    let mut different = 0;
    for frame in 0..FRAMES + WARM_UP {
        let share = frame as f64 / (FRAMES + WARM_UP) as f64;
        let eye = from.lerp(to, share);
        let view = look(eye, eye + (to - from));
        let mut pictures = Vec::new();
        for run in &mut runs {
            let before_ms = processor_ms();
            let stats =
                run.renderer.draw(gpu, scene, &mut run.target, std::slice::from_ref(&view))?;
            if frame >= WARM_UP {
                run.processor_ms += processor_ms() - before_ms;
                run.frames.push(stats);
            }
            pictures.push(read_pixels(gpu, &run.target)?);
        }
        different += usize::from(pictures[0] != pictures[1]);
    }
    runs.iter().for_each(say);
    let ratio = median(&runs[0].frames, whole) as f64 / median(&runs[1].frames, whole) as f64;
    let processor = runs[0].processor_ms / runs[1].processor_ms;
    println!(
        "{ratio:.2} times as fast, {processor:.2} times the processor time; {different} of {} \
         pictures differ",
        FRAMES + WARM_UP
    );
    Ok(())
}

fn whole(stats: &DrawStats) -> u64 {
    stats.occlusion_us + stats.cull_us + stats.encode_us + stats.gpu_us
}

fn median(frames: &[DrawStats], of: fn(&DrawStats) -> u64) -> u64 {
    let mut numbers: Vec<u64> = frames.iter().map(of).collect();
    numbers.sort_unstable();
    numbers[numbers.len() / 2]
}

fn say(run: &Run) {
    let of = |of: fn(&DrawStats) -> u64| median(&run.frames, of);
    let ms = |number: fn(&DrawStats) -> u64| of(number) as f64 / 1e3;
    println!(
        "{:>8}: occlusion {:6.2} ms, cull {:6.2}, encode {:6.2}, GPU {:7.2}, frame {:7.2}",
        run.name,
        ms(|stats| stats.occlusion_us),
        ms(|stats| stats.cull_us),
        ms(|stats| stats.encode_us),
        ms(|stats| stats.gpu_us),
        ms(whole)
    );
    println!(
        "          {:.1} ms of processors; {} triangles, {} draws, {} items",
        run.processor_ms / FRAMES as f64,
        of(|stats| stats.triangles),
        of(|stats| u64::from(stats.draw_calls)),
        of(|stats| u64::from(stats.visible))
    );
}

/// A scene on the GPU.
fn open(gpu: &Gpu, path: &Path, kept: Option<&Path>) -> Result<GpuScene, Failure> {
    let folder = tempfile::tempdir()?;
    let store = BakeCache::open(kept.unwrap_or(folder.path()))?;
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
    Ok(builder.finish(gpu)?)
}
