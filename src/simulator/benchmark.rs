//! Speed against error: what frames of a scene cost at each error bound, and how far their
//! pictures are from those of full detail.

mod bench_wall;
mod distance_transform;
mod flat_scene;
mod flip;
mod frame_samples;
mod html;
mod image_error;
mod load_step;
mod peers;
mod scene_report;
mod silhouette;
mod stage;

use std::sync::Arc;

use polyptych_client::Camera;
use polyptych_manager::import::Baker;
use polyptych_text::counted;
use polyptych_wall::ShadowFilter;

pub(crate) use bench_wall::BenchWall;
pub(crate) use bench_wall::{COLUMNS_MAX, grid_of};
use frame_samples::FrameSamples;
pub(crate) use html::page;
pub(crate) use peers::PeerKit;
use scene_report::{BoundReport, ChannelsReport, SamplesReport, ShadowsReport, shadows_name};
pub(crate) use scene_report::{RunInfo, SceneReport};
use stage::Stage;

use crate::progress::Steps;
use crate::simulator::ending::{EndRequest, Ending};
use crate::simulator::orbit;
use crate::simulator::verify::ReferenceScene;

/// Frames that are drawn before measuring begins: the first ones fill caches.
const WARM_UP_FRAMES: u32 = 3;

/// Samples per pixel of the wall that is compared with one sample.
const SAMPLES: u32 = 4;

/// Shadows of walls that are compared with one that has the usual shadows.
const OTHER_SHADOWS: [ShadowFilter; 3] =
    [ShadowFilter::Off, ShadowFilter::Hard, ShadowFilter::ContactHardening];

/// The measurements of each scene.
#[derive(Debug)]
pub(crate) struct BenchmarkOptions {
    /// Width and height of the wall, in pixels.
    pub size: [u32; 2],
    /// Error bounds in pixels, from small to large; the first one is 0, full detail.
    pub bounds_px: Vec<f64>,
    /// Numbers of channels that share the wall's pixels, from small to large; the first one is 1.
    pub channel_counts: Vec<u32>,
    /// Frames that are timed for each bound in each repetition.
    pub frames: u32,
    /// Times that everything is timed, in turn.
    pub repetitions: u32,
    /// Poses of which pictures are compared.
    pub poses: u32,
    /// The seed of random poses around and within the scene; `None` for poses of the orbit.
    pub random_views: Option<u64>,
    /// Pixels along each side of a pixel, for pictures of which outlines are compared.
    pub supersampling: u32,
}

impl BenchmarkOptions {
    /// Steps of one scene that progress counts.
    fn steps(&self, has_peers: bool) -> u64 {
        let walls = 1 + self.channel_counts[1..].len() as u64 + 2 + OTHER_SHADOWS.len() as u64;
        3 + u64::from(self.repetitions) * walls + u64::from(has_peers)
    }
}

/// Measures scenes, one after the other.
#[derive(Debug)]
pub(crate) struct Benchmark<'a> {
    options: &'a BenchmarkOptions,
    run: &'a RunInfo,
    baker: Baker,
    peers: Option<PeerKit>,
    steps: Steps,
    /// Number of scenes so far.
    scenes: usize,
    /// The end that was asked of the last wall: Ctrl-C may come between two walls.
    end: Option<Arc<EndRequest>>,
}

impl<'a> Benchmark<'a> {
    pub fn new(
        options: &'a BenchmarkOptions,
        run: &'a RunInfo,
        baker: Baker,
        peers: Option<PeerKit>,
        scenes: usize,
    ) -> Self {
        let steps = Steps::new(scenes as u64 * options.steps(peers.is_some()));
        Self { options, run, baker, peers, steps, scenes: 0, end: None }
    }

    /// Measures a scene.
    ///
    /// # Errors
    /// The reason why it cannot be opened or drawn; [`Ending`] if the user ended the run.
    pub fn measure(&mut self, scene: &ReferenceScene) -> anyhow::Result<SceneReport> {
        self.scenes += 1;
        let shadows = ShadowFilter::default();
        let single = BenchWall { size: self.options.size, channels: 1, samples: 1, shadows };
        let mut report = SceneReport::new(&scene.file, self.run);
        report.bounds = self.options.bounds_px.iter().map(|&px| BoundReport::new(px)).collect();
        self.measure_errors(single, scene, &mut report)?;
        let mut bounds = vec![FrameSamples::default(); self.options.bounds_px.len()];
        let mut channels = vec![FrameSamples::default(); self.options.channel_counts.len()];
        let (mut empty, mut samples) = (FrameSamples::default(), FrameSamples::default());
        let mut others = OTHER_SHADOWS.map(|_| FrameSamples::default());
        let (flat_folder, mut flat) = (tempfile::tempdir()?, FrameSamples::default());
        let flat_scene = flat_scene::write(&scene.file, flat_folder.path());
        let flat_scene = flat_scene.map(|file| ReferenceScene { file, ..scene.clone() });
        // In turn, so that a machine whose speed drifts favours no setting.
        for repetition in 1..=self.options.repetitions {
            let stage = self.open(single, scene, format_args!("round {repetition}, all bounds"))?;
            for ((&bound_px, samples), bound) in
                self.options.bounds_px.iter().zip(&mut bounds).zip(&mut report.bounds)
            {
                stage.set_error_bound(bound_px)?;
                self.time(&stage, samples, |time_s| stage.camera_at(time_s))?;
                bound.memory = stage.memory()?;
            }
            stage.show_only(stage.add_empty_node()?, stage.camera_at(0.0))?;
            self.time(&stage, &mut empty, |time_s| stage.camera_at(time_s))?;
            drop(stage);
            for (&count, measured) in self.options.channel_counts.iter().zip(&mut channels).skip(1)
            {
                let wall = BenchWall { channels: count, ..single };
                self.time_wall(wall, scene, repetition, measured)?;
            }
            let wall = BenchWall { samples: SAMPLES, ..single };
            self.time_wall(wall, scene, repetition, &mut samples)?;
            for (shadows, measured) in OTHER_SHADOWS.into_iter().zip(&mut others) {
                self.time_wall(BenchWall { shadows, ..single }, scene, repetition, measured)?;
            }
            match &flat_scene {
                Ok(flat_scene) => self.time_wall(single, flat_scene, repetition, &mut flat)?,
                Err(error) => report.flat_error = Some(format!("{error:#}")),
            }
        }
        let stage = self.open(single, scene, "a step of the load")?;
        report.load_step = Some(load_step::measure(&stage, self.options.frames)?);
        drop(stage);
        channels[0] = bounds[0].clone();
        for (bound, samples) in report.bounds.iter_mut().zip(&bounds) {
            bound.frames = samples.costs();
        }
        report.empty_frame = Some(empty.costs());
        report.flat_frame = flat_scene.is_ok().then(|| flat.costs());
        report.channels = (self.options.channel_counts.iter().zip(&channels))
            .map(|(&channels, samples)| ChannelsReport { channels, frames: samples.costs() })
            .collect();
        report.samples = [(1, &bounds[0]), (SAMPLES, &samples)]
            .map(|(samples, measured)| SamplesReport { samples, frames: measured.costs() })
            .to_vec();
        report.shadows = std::iter::once((ShadowFilter::default(), &bounds[0]))
            .chain(OTHER_SHADOWS.into_iter().zip(&others))
            .map(|(shadows, measured)| ShadowsReport { shadows, frames: measured.costs() })
            .collect();
        self.time_peers(scene, &mut report)?;
        Ok(report)
    }

    /// Times other renderers, if the user has named a kit. One that fails leaves the rest of the
    /// report as it is.
    fn time_peers(
        &mut self,
        scene: &ReferenceScene,
        report: &mut SceneReport,
    ) -> anyhow::Result<()> {
        let (Some(kit), Some(end)) = (&self.peers, &self.end) else { return Ok(()) };
        self.steps.begin(format_args!("{}: other renderers", report.scene));
        match kit.time(&scene.file, self.scenes, self.options, end) {
            Ok(peers) => report.peers = peers,
            Err(error) if error.is::<Ending>() => return Err(error),
            Err(error) => report.peers_error = Some(format!("{error:#}")),
        }
        Ok(())
    }

    /// Compares the pictures of every bound with those of full detail: all of them as the wall
    /// shows them, and outlines with several pixels for each of the wall's.
    fn measure_errors(
        &mut self,
        single: BenchWall,
        scene: &ReferenceScene,
        report: &mut SceneReport,
    ) -> anyhow::Result<()> {
        let stage = self.open(single, scene, "pictures at every bound")?;
        report.describe(&stage.summary, stage.adapter()?);
        let poses = self.poses(&stage);
        let errors = image_error::flip_errors(&stage, &poses, &self.options.bounds_px)?;
        for (bound, error) in report.bounds.iter_mut().zip(errors) {
            bound.set_flip(error);
        }
        drop(stage);
        let factor = self.options.supersampling;
        let fine = BenchWall { size: single.size.map(|side| side * factor), ..single };
        let stage = self.open(fine, scene, "outlines at every bound")?;
        let bounds_px: Vec<f64> =
            self.options.bounds_px.iter().map(|px| px * f64::from(factor)).collect();
        let distances_px = image_error::outline_distances(&stage, &poses, &bounds_px)?;
        for (bound, distances_px) in report.bounds.iter_mut().zip(distances_px) {
            bound.set_outlines(&distances_px, f64::from(factor));
        }
        Ok(())
    }

    /// Returns the cameras of which pictures are compared.
    fn poses(&self, stage: &Stage) -> Vec<Camera> {
        let count = self.options.poses;
        match self.options.random_views {
            Some(seed) => {
                let mut random = fastrand::Rng::with_seed(seed);
                (0..count).map(|_| stage.random_camera(&mut random)).collect()
            }
            None => orbit::times_of_turn(count).map(|time_s| stage.camera_at(time_s)).collect(),
        }
    }

    /// Times frames of full detail on another wall.
    fn time_wall(
        &mut self,
        wall: BenchWall,
        scene: &ReferenceScene,
        repetition: u32,
        samples: &mut FrameSamples,
    ) -> anyhow::Result<()> {
        let channels = counted(wall.channels, "channel");
        let per_pixel = counted(wall.samples, "sample");
        let shadows = shadows_name(wall.shadows);
        let what = format!("round {repetition}, {channels}, {per_pixel} a pixel, {shadows}");
        let stage = self.open(wall, scene, what)?;
        stage.set_error_bound(0.0)?;
        self.time(&stage, samples, |time_s| stage.camera_at(time_s))
    }

    /// Times frames along the orbit.
    fn time(
        &self,
        stage: &Stage,
        samples: &mut FrameSamples,
        camera: impl Fn(f64) -> Camera,
    ) -> anyhow::Result<()> {
        for _ in 0..WARM_UP_FRAMES {
            stage.draw(camera(0.0), 0.0)?;
        }
        for frame in 0..self.options.frames {
            let time_s = f64::from(frame) / orbit::TIME_RATE;
            samples.add(&stage.draw(camera(time_s), time_s)?);
        }
        Ok(())
    }

    fn open(
        &mut self,
        wall: BenchWall,
        scene: &ReferenceScene,
        what: impl std::fmt::Display,
    ) -> anyhow::Result<Stage> {
        let name = scene.file.file_stem().unwrap_or_default().to_string_lossy();
        self.steps.begin(format_args!("{name}: {what}"));
        let stage = Stage::open(wall.to_wall()?, scene, &self.baker);
        let interrupted = self.end.as_ref().and_then(|end| end.ending());
        if let Some(ending) = interrupted {
            return Err(anyhow::Error::from(ending));
        }
        let stage = stage?;
        self.end = Some(stage.end());
        Ok(stage)
    }
}
