//! Gets a new state ready: finds its blobs and feeds them to the render thread piece by piece.
//!
//! It runs on a thread of its own, so that neither sockets nor frames wait for disks and stores.
//! `blob_sources` finds the blobs.

mod held_part;
mod host_memory;
mod moves;
mod ready_scene;
mod surroundings;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Instant;

use bytes::Bytes;
use crossbeam_channel::{Receiver, Sender};
use glam::DVec3;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::command::Prepare;
use polyptych_protocol::ids::{Digest, Epoch, Revision};
use polyptych_protocol::server_message::{Prepared, ServerMessage};
use polyptych_protocol::state_log::Replica;
use polyptych_renderer::{MovedItems, SceneLayout};
use polyptych_scene::{Motion, Scene, SceneFeatures};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::camera::Camera;
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};
use polyptych_wall::warp::CalibrationMap;
use polyptych_wall::{ChannelCalibration, Wall};
use tokio::sync::mpsc;

use crate::blob_sources::{BlobOrder, BlobSources};
use crate::bulk::BulkJob;
use crate::correction::{self, CorrectionPlans};
use crate::render_event::RenderEvent;
use host_memory::HostMemory;
use ready_scene::{ReadyScene, SceneOfState};
pub(crate) use surroundings::LoadedEnvironment;

/// Orders that wait for the loader; the manager sends one change at a time.
pub(crate) const ORDERS_MAX: usize = 16;

/// Pieces that wait for the render thread.
pub(crate) const UPLOADS_MAX: usize = 4;

/// A state that can be drawn, but for what the GPU holds of it.
#[derive(Debug)]
pub(crate) struct LoadedState {
    pub epoch: Epoch,
    pub replica: Replica,
    pub digest: Digest,
    /// Its scene.
    pub scene: Option<SceneVersion>,
    pub warm_up: Camera,
    /// Its surroundings, if not its own sky.
    pub environment: Option<LoadedEnvironment>,
    /// The plans of this server's channels; those of the state before if the wall is the same.
    pub plans: Arc<CorrectionPlans>,
    /// The decoded files of its wall.
    pub maps: CalibrationMaps,
    /// The geometry that the files give to the screens of this server's channels.
    pub shapes: Arc<WallGeometry>,
    /// All that moves by itself in its scene, if anything.
    pub motion: Option<Arc<Motion>>,
}

/// A scene as it stands: its manifest, and what was changed of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SceneVersion {
    pub manifest: BlobHash,
    /// See [`SceneEdits::fingerprint`].
    pub edits: u64,
}

impl LoadedState {
    /// Samples per pixel of its wall.
    pub fn samples(&self) -> Option<u32> {
        self.replica.wall.as_ref().map(|wall| wall.samples)
    }
}

/// Work for the render thread, done between frames.
#[derive(Debug)]
pub(crate) enum Upload {
    /// A new scene begins; what it has in common with the latest one that is held is there already,
    /// if so said. Of a scene within a budget it may be a part. States that no frame names any more
    /// make room for it.
    Begin { layout: Arc<SceneLayout>, shares: bool, is_part: bool, shown: ShownState },
    /// The latest scene that is held is laid out otherwise, but for what was moved since.
    Relayout { layout: Arc<SceneLayout>, moved: Option<Arc<MovedItems>> },
    /// A texture of it.
    Texture { index: usize, bytes: Bytes },
    /// A primitive of it.
    Primitive { mesh: usize, primitive: usize, bytes: Bytes },
    /// The data that move the vertices of a primitive that is there.
    Deformer { mesh: usize, primitive: usize, bytes: Bytes },
    /// All is there: make it drawable, warm up, and answer with the scene's bytes.
    Finish { state: Arc<LoadedState>, answer: SyncSender<Result<u64, String>> },
    /// The scene that began will not be finished.
    Abandon,
}

/// The state that frames name while the next one is got ready.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShownState {
    pub epoch: Epoch,
    pub revision: Revision,
}

impl ShownState {
    /// Returns whether a frame may still name a state that was got ready before. Of an older epoch
    /// one may be on the displays.
    pub fn allows(self, epoch: Epoch, revision: Revision) -> bool {
        epoch != self.epoch || revision <= self.revision
    }

    /// Returns whether it is this state.
    pub fn is(self, epoch: Epoch, revision: Revision) -> bool {
        (epoch, revision) == (self.epoch, self.revision)
    }
}

/// A state to get ready, for one connection.
#[derive(Debug)]
pub(crate) struct LoadOrder {
    pub prepare: Prepare,
    pub line: LoaderLink,
}

/// The loader's link to the connection that an order came from.
#[derive(Clone, Debug)]
pub(crate) struct LoaderLink {
    pub bulk: mpsc::Sender<BulkJob>,
    pub reports: mpsc::Sender<RenderEvent>,
    pub is_cut: Arc<AtomicBool>,
}

/// The loader's own state.
#[derive(Debug)]
pub(crate) struct Loader {
    sources: BlobSources,
    orders: Receiver<LoadOrder>,
    uploads: Sender<Upload>,
    /// See [`Gpu::losses`](polyptych_renderer::Gpu::losses); what was made ready before is gone.
    losses: Arc<AtomicU64>,
    ready_losses: u64,
    /// Those that this server drives.
    channels: Vec<String>,
    /// The state that was made ready last; the render thread may hold its scene no more.
    ready: Option<(Epoch, Replica)>,
    shown: ShownState,
    ready_plans: Option<(Wall, Arc<CorrectionPlans>)>,
    /// The scene of the latest state that the render thread holds.
    ready_scene: Option<SceneOfState>,
    /// The scene of the state before that one, if frames still named it when that was ordered. It
    /// is the latest again where that one makes room for the next.
    shown_scene: Option<SceneOfState>,
    ready_environment: Option<LoadedEnvironment>,
    host_memory: HostMemory,
    /// The decoded files of the last wall: it changes in small things while it is adjusted.
    ready_maps: BTreeMap<BlobHash, Arc<CalibrationMap>>,
    /// The geometry that these files give to a wall, which is kept as it was before it was
    /// adjusted.
    ready_shapes: Option<((Wall, bool), Arc<WallGeometry>)>,
}

impl Loader {
    pub fn new(
        cache: BlobStore,
        orders: Receiver<LoadOrder>,
        uploads: Sender<Upload>,
        losses: Arc<AtomicU64>,
        channels: Vec<String>,
    ) -> Self {
        Self {
            sources: BlobSources::new(cache),
            orders,
            uploads,
            losses,
            ready_losses: 0,
            channels,
            ready: None,
            shown: ShownState { epoch: Epoch(0), revision: Revision(0) },
            ready_plans: None,
            ready_scene: None,
            shown_scene: None,
            ready_environment: None,
            host_memory: HostMemory::default(),
            ready_maps: BTreeMap::new(),
            ready_shapes: None,
        }
    }

    /// Serves orders until there can be no more.
    pub fn run(mut self) {
        self.sources.clean_cache();
        while let Ok(LoadOrder { prepare, line }) = self.orders.recv() {
            let (epoch, revision) = (prepare.epoch, prepare.revision);
            let _span = tracing::error_span!("prepare", revision = revision.0).entered();
            let status = match self.load_on_any_device(&prepare, &line) {
                Ok(prepared) => ServerMessage::Prepared(prepared),
                Err(reason) => {
                    if self.uploads.send(Upload::Abandon).is_err() {
                        return;
                    }
                    ServerMessage::PrepareFailed { epoch, revision, reason }
                }
            };
            // The next connection gets a new order, for which this is no answer.
            if line.is_cut.load(Ordering::Relaxed) {
                continue;
            }
            // The connection may be gone since.
            let _ = line.reports.blocking_send(RenderEvent::Status(status));
            if let Some(status) = self.sources.news() {
                let _ = line.reports.blocking_send(RenderEvent::Status(status));
            }
        }
    }

    /// Loads again where the GPU was lost meanwhile, until it was lost too often for its thread.
    fn load_on_any_device(
        &mut self,
        prepare: &Prepare,
        line: &LoaderLink,
    ) -> Result<Prepared, String> {
        loop {
            let loaded = self.load(prepare.clone(), line);
            let is_lost = self.losses.load(Ordering::SeqCst) != self.ready_losses;
            if loaded.is_ok() || !is_lost || self.fault(line).is_some() {
                return loaded;
            }
            self.upload(Upload::Abandon)?;
        }
    }

    fn load(&mut self, prepare: Prepare, line: &LoaderLink) -> Result<Prepared, String> {
        let epoch = prepare.epoch;
        self.shown = ShownState { epoch, revision: prepare.shown };
        let losses = self.losses.load(Ordering::SeqCst);
        if std::mem::replace(&mut self.ready_losses, losses) != losses {
            (self.ready_scene, self.shown_scene) = (None, None);
        }
        let replica = self.fold(prepare)?;
        if let Some(fault) = replica.wall.as_ref().and_then(|wall| wall.fault()) {
            return Err(fault);
        }
        self.sources.set_stores(replica.wall.as_ref().map_or(&[][..], |wall| &wall.stores));
        let maps = match replica.wall.as_deref() {
            Some(wall) => self.load_maps(wall, line)?,
            None => CalibrationMaps::default(),
        };
        let scene = match &replica.scene {
            None => None,
            Some(scene) => Some(self.load_scene(scene, &replica, line)?),
        };
        let environment = self.load_environment(&replica, scene.as_ref(), line)?;
        let digest = replica.digest();
        let revision = replica.revision;
        let shapes = self.shapes(replica.wall.as_deref(), &maps);
        let plans = self.plans(replica.wall.as_deref(), &maps, &shapes)?;
        let state = LoadedState {
            epoch,
            replica: replica.clone(),
            digest,
            scene: scene.as_ref().map(|scene| scene.version),
            warm_up: scene.as_ref().map_or(Camera::IDENTITY, |scene| scene.warm_up),
            environment: environment.clone(),
            plans,
            maps,
            shapes,
            motion: scene.as_ref().and_then(|scene| scene.motion.clone()),
        };
        let (answer, finished) = sync_channel(1);
        self.upload(Upload::Finish { state: Arc::new(state), answer })?;
        let scene_bytes = finished.recv().map_err(|_| "the render thread has ended")??;
        self.ready = Some((epoch, replica));
        self.sources.set_memory_warning(scene.as_ref().and_then(|scene| scene.warning.clone()));
        let mut features = scene.as_ref().map_or_else(SceneFeatures::default, |of| of.features);
        features.environment = environment.is_some();
        let features = features.names().into_iter().map(Into::into).collect();
        let detail_reach = scene.as_ref().and_then(ReadyScene::detail_reach);
        let scene = scene.map(|scene| (epoch, revision, scene));
        let before = std::mem::replace(&mut self.ready_scene, scene);
        self.shown_scene = before.filter(|(epoch, of, _)| self.shown.is(*epoch, *of));
        self.ready_environment = environment;
        Ok(Prepared { epoch, revision, digest, features, scene_bytes, detail_reach })
    }

    /// Returns the wall's geometry. It is that of the last call if only settings that do not move
    /// it have changed.
    fn shapes(&mut self, wall: Option<&Wall>, maps: &CalibrationMaps) -> Arc<WallGeometry> {
        let Some(wall) = wall.filter(|wall| !wall.files.is_empty()) else {
            return Arc::default();
        };
        let mut bare = wall.clone();
        for channel in &mut bare.channels {
            let warp = channel.adjustment.warp;
            channel.adjustment = ChannelCalibration { warp, ..ChannelCalibration::default() };
        }
        // The wall has one black, to which all of its overlaps add.
        let wants_all = wall.channels.iter().any(|of| wall.leak_of(of) != DVec3::ZERO);
        let key = (bare, wants_all);
        if let Some((_, shapes)) = self.ready_shapes.as_ref().filter(|(known, _)| *known == key) {
            return Arc::clone(shapes);
        }
        let own = |name: &String| wall.channel_by_name(name).map(|(_, channel)| channel.screen);
        let screens: Vec<u16> = self.channels.iter().filter_map(own).collect();
        let is_wanted = |screen| wants_all || screens.contains(&screen);
        let shapes = Arc::new(WallGeometry::of(wall, maps, is_wanted));
        self.ready_shapes = Some((key, Arc::clone(&shapes)));
        shapes
    }

    fn plans(
        &mut self,
        wall: Option<&Wall>,
        maps: &CalibrationMaps,
        shapes: &WallGeometry,
    ) -> Result<Arc<CorrectionPlans>, String> {
        let Some(wall) = wall else { return Ok(Arc::default()) };
        if let Some((_, plans)) = self.ready_plans.as_ref().filter(|(known, _)| known == wall) {
            return Ok(Arc::clone(plans));
        }
        let start = Instant::now();
        let known = self.ready_plans.as_ref().map(|(_, plans)| &**plans);
        let shaped = ResolvedWall { wall, shapes };
        let plans = Arc::new(correction::correction_plans(shaped, maps, &self.channels, known)?);
        let plan_us = start.elapsed().as_micros() as u64;
        tracing::debug!(plan_us, "the channels' corrections were planned");
        self.ready_plans = Some((wall.clone(), Arc::clone(&plans)));
        Ok(plans)
    }

    fn fold(&self, prepare: Prepare) -> Result<Replica, String> {
        let Some(base) = prepare.base else {
            return Ok(Replica::from_snapshot(prepare.revision, prepare.operations));
        };
        let same = |(epoch, replica): &&(Epoch, Replica)| {
            *epoch == prepare.epoch && replica.revision == base
        };
        let ready = self.ready.as_ref().filter(same);
        let mut replica = ready.map(|(_, replica)| replica.clone()).ok_or_else(|| {
            format!("revision {} builds on {base}, which is not here", prepare.revision)
        })?;
        for operation in prepare.operations {
            replica.apply(operation);
        }
        Ok(replica)
    }

    /// The files of a wall, decoded here and not between frames.
    fn load_maps(&mut self, wall: &Wall, line: &LoaderLink) -> Result<CalibrationMaps, String> {
        let mut maps = BTreeMap::new();
        let loaded = CalibrationMaps::load(wall, |hash| {
            if let Some(known) = maps.get(&hash).or_else(|| self.ready_maps.get(&hash)) {
                let known = Arc::clone(known);
                maps.insert(hash, Arc::clone(&known));
                return Ok(known);
            }
            let map = Arc::new(CalibrationMap::decode(&self.blob(hash, line)?)?);
            maps.insert(hash, Arc::clone(&map));
            Ok(map)
        })?;
        self.ready_maps = maps;
        Ok(loaded)
    }

    fn manifest(&self, hash: BlobHash, name: &str, line: &LoaderLink) -> Result<Scene, String> {
        let bytes = self.blob(hash, line)?;
        let scene = polyptych_scene::decode(&bytes)
            .map_err(|error| format!("manifest of {name}: {error}"))?;
        match scene.fault() {
            Some(fault) => Err(format!("manifest of {name}: {fault}")),
            None => Ok(scene),
        }
    }

    fn blob(&self, hash: BlobHash, line: &LoaderLink) -> Result<Bytes, String> {
        self.sources.blob(hash, &BlobOrder { bulk: &line.bulk, check: &|| self.check(line) })
    }

    /// Returns why a preparation is not wanted any more, if it is not.
    fn fault(&self, line: &LoaderLink) -> Option<&'static str> {
        if line.is_cut.load(Ordering::Relaxed) {
            return Some("the connection that asked for it has ended");
        }
        // The manager sends another order before the answer only if the answer is of no use.
        (!self.orders.is_empty()).then_some("a newer preparation has come")
    }

    /// # Errors
    /// The preparation is not wanted any more.
    fn check(&self, line: &LoaderLink) -> Result<(), String> {
        self.fault(line).map_or(Ok(()), |fault| Err(fault.to_owned()))
    }

    fn upload(&self, upload: Upload) -> Result<(), String> {
        self.uploads.send(upload).map_err(|_| "the render thread has ended".to_owned())
    }
}

#[cfg(test)]
mod tests;
