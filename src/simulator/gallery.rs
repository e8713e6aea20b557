//! Models that a wall of one display opens one after the other, each with its picture and with what
//! is known of it.

mod sheet;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use image::RgbaImage;
use polyptych_client::{SceneSummary, fit_bounds};
use polyptych_manager::import::Baker;
use polyptych_wall::{ShadowFilter, Wall};
use serde::Serialize;

use crate::image_files;
use crate::simulator::benchmark::BenchWall;
use crate::simulator::ending::EndRequest;
use crate::simulator::faults::FaultHooks;
use crate::simulator::local_wall::{LocalWall, LocalWallOptions};
use crate::simulator::orbit;

pub(crate) use sheet::Sheet;

/// Samples per pixel of the pictures.
const SAMPLES: u32 = 4;

/// Frames of which the median is the time of a model, after one that fills caches.
const TIMED_FRAMES: usize = 3;

/// Maximum number of folders within each other that are searched.
const FOLDERS_DEEP_MAX: usize = 64;

/// One model of a gallery.
#[derive(Debug, Serialize)]
pub(crate) struct ModelReport {
    /// The file, as it was named or found.
    pub file: String,
    /// Why there is no picture; `None` for a model that was drawn.
    pub error: Option<String>,
    pub triangles: u64,
    /// Names of the renderer's features that it needs.
    pub needs: Vec<&'static str>,
    /// The parts of it that are not drawn, or not as the file has them.
    pub notes: Vec<String>,
    /// The exposure that suits its lights.
    pub exposure: f32,
    /// Names of its animations.
    pub animations: Vec<String>,
    /// Time from the request until the wall could draw it, in milliseconds.
    pub open_ms: Option<f64>,
    /// Median time of a frame, in milliseconds.
    pub frame_ms: Option<f64>,
    /// Its picture, as the display showed it.
    #[serde(skip)]
    pub picture: Option<RgbaImage>,
}

impl ModelReport {
    fn new(file: &Path) -> Self {
        Self {
            file: file.display().to_string(),
            error: None,
            triangles: 0,
            needs: Vec::new(),
            notes: Vec::new(),
            exposure: 1.0,
            animations: Vec::new(),
            open_ms: None,
            frame_ms: None,
            picture: None,
        }
    }

    fn describe(&mut self, summary: &SceneSummary, open_time: Duration) {
        self.triangles = summary.triangles;
        self.needs = summary.features.names();
        self.notes.clone_from(&summary.notes);
        self.exposure = summary.exposure;
        self.animations = summary.clips.iter().map(|clip| clip.name.clone()).collect();
        self.open_ms = Some(open_time.as_secs_f64() * 1e3);
    }
}

/// The wall of a gallery.
#[derive(Debug)]
pub(crate) struct Gallery {
    wall: Wall,
    scene_roots: Vec<PathBuf>,
    baker: Baker,
    /// Scene time of the pictures, in seconds.
    time_s: f64,
    /// Started for the first model, and again after one that it could not draw.
    local: Option<LocalWall>,
    /// The end request of the last wall, which it outlives: the user may end the run between two
    /// walls.
    end: Option<Arc<EndRequest>>,
}

impl Gallery {
    /// Returns a gallery of models in these folders, with pictures of so many pixels, of a scene
    /// time in seconds.
    ///
    /// # Errors
    /// A size that no display can have.
    pub fn new(
        scene_roots: Vec<PathBuf>,
        size: [u32; 2],
        time_s: f64,
        baker: Baker,
    ) -> anyhow::Result<Self> {
        let shadows = ShadowFilter::default();
        let wall = BenchWall { size, channels: 1, samples: SAMPLES, shadows }.to_wall()?;
        Ok(Self { wall, scene_roots, baker, time_s, local: None, end: None })
    }

    /// Opens a model and takes its picture. A model that cannot be opened or drawn is reported with
    /// the reason.
    ///
    /// # Errors
    /// A wall that cannot be started; [`Ending`](crate::simulator::ending::Ending) if the user
    /// ended the run.
    pub fn show(&mut self, file: &Path) -> anyhow::Result<ModelReport> {
        let local = match self.local.take() {
            Some(local) => local,
            None => self.start()?,
        };
        self.end = Some(Arc::clone(&local.end));
        let mut report = ModelReport::new(file);
        let shown = self.draw(&local, file, &mut report);
        if let Some(ending) = local.end.ending() {
            return Err(ending.into());
        }
        match shown {
            Ok(()) => self.local = Some(local),
            Err(Failure::Refused(error)) => {
                report.error = Some(error);
                self.local = Some(local);
            }
            // What a model has left of the wall is not what the next one should meet.
            Err(Failure::NotDrawn(error)) => report.error = Some(format!("{error:#}")),
        }
        Ok(report)
    }

    fn start(&self) -> anyhow::Result<LocalWall> {
        if let Some(ending) = self.end.as_ref().and_then(|end| end.ending()) {
            return Err(ending.into());
        }
        LocalWall::start(LocalWallOptions {
            wall: self.wall.clone(),
            scene_roots: self.scene_roots.clone(),
            baker: self.baker.clone(),
            windows: false,
            http: None,
            recorder: None,
            culls_occluded: true,
            needs: FaultHooks::default(),
        })
    }

    fn draw(
        &self,
        local: &LocalWall,
        file: &Path,
        report: &mut ModelReport,
    ) -> Result<(), Failure> {
        let began = Instant::now();
        let path = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        let opened = local.client.open_scene(path.display().to_string());
        let summary = opened.map_err(|error| Failure::Refused(error.to_string()))?;
        report.describe(&summary, began.elapsed());
        let bounds = summary.bounds.as_ref();
        let camera = bounds.map(|bounds| fit_bounds(&self.wall, bounds, orbit::HEADING_RAD));
        let mut times_ms = Vec::with_capacity(TIMED_FRAMES);
        for frame in 0..=TIMED_FRAMES {
            let began = Instant::now();
            let drawn = local.client.render_frame_at(camera, Some(self.time_s));
            let feedback = drawn.map_err(Failure::of)?;
            if let Some(channel) = feedback.missing_channels().next() {
                let reason = channel.reason.as_deref().unwrap_or("no reason is known");
                return Err(Failure::NotDrawn(anyhow!("it was not drawn: {reason}")));
            }
            if frame > 0 {
                times_ms.push(began.elapsed().as_secs_f64() * 1e3);
            }
        }
        times_ms.sort_by(f64::total_cmp);
        report.frame_ms = times_ms.get(TIMED_FRAMES / 2).copied();
        let capture = local.client.capture_at(Some(self.time_s)).map_err(Failure::of)?;
        if let Some((_, reason)) = capture.missing.first() {
            return Err(Failure::NotDrawn(anyhow!("it has no picture: {reason}")));
        }
        let picture = image_files::side_by_side(&capture.screens).map_err(Failure::NotDrawn)?;
        report.picture = Some(picture);
        Ok(())
    }
}

/// Why a model has no picture.
enum Failure {
    /// The wall refused it, and is as it was.
    Refused(String),
    /// The wall began to show it, and failed.
    NotDrawn(anyhow::Error),
}

impl Failure {
    fn of(error: impl Into<anyhow::Error>) -> Self {
        Self::NotDrawn(error.into())
    }
}

/// Returns the models among these files and below these folders, those of a folder by name.
/// Folders that are links are not followed.
///
/// # Errors
/// A path that cannot be read, or a folder without a model.
pub(crate) fn find_models(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut models = Vec::new();
    for path in paths {
        let cannot_read = || format!("cannot read {}", path.display());
        if !std::fs::metadata(path).with_context(cannot_read)?.is_dir() {
            models.push(path.clone());
            continue;
        }
        let before = models.len();
        add_models_of(path, FOLDERS_DEEP_MAX, &mut models)?;
        if models.len() == before {
            bail!("{}: there is no .gltf or .glb file in this folder", path.display());
        }
    }
    Ok(models)
}

fn add_models_of(folder: &Path, deep: usize, models: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let cannot_read = || format!("cannot read {}", folder.display());
    let entries = std::fs::read_dir(folder).with_context(cannot_read)?;
    let mut entries: Vec<_> = entries.collect::<Result<_, _>>().with_context(cannot_read)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        if entry.file_type().with_context(cannot_read)?.is_dir() {
            if deep > 0 {
                add_models_of(&path, deep - 1, models)?;
            }
        } else if is_model(&path) && path.is_file() {
            models.push(path);
        }
    }
    Ok(())
}

fn is_model(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    ["gltf", "glb"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}
