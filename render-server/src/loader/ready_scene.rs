//! The scene of a state, from its manifests to the render thread.

use std::sync::Arc;

use polyptych_protocol::ids::{Epoch, Revision};
use polyptych_protocol::state_log::{Replica, SceneRef};
use polyptych_renderer::{ContentPlace, SceneLayout};
use polyptych_scene::residency::SeenFrom;
use polyptych_scene::{AssetManifests, Motion, NodeTraits, PlacedNodes, Scene, SceneFeatures};
use polyptych_wall::MemoryBudget;
use polyptych_wall::camera::Camera;

use super::held_part::{self, ChosenPart, HeldPart};
use super::{Loader, LoaderLink, SceneVersion, Upload, moves};
use crate::blob_sources::BlobOrder;
use crate::frame_views;

/// The scene of a state that was made ready.
pub(super) type SceneOfState = (Epoch, Revision, ReadyScene);

/// A scene that the render thread was given.
#[derive(Clone, Debug)]
pub(super) struct ReadyScene {
    pub version: SceneVersion,
    /// The budgets that it was loaded within.
    pub budget: MemoryBudget,
    /// The choice of its part, for the places that it is seen from; `None` if all of it is held.
    pub part: Option<ChosenPart>,
    /// The finest level of each mesh that is held of a part.
    pub levels: Vec<u32>,
    /// The warning of what its part is missing, for the operator.
    pub warning: Option<String>,
    pub seen_from: Vec<SeenFrom>,
    /// The scene of its file, without changes.
    pub base: Arc<Scene>,
    /// Manifests of what was added to it.
    pub added: AssetManifests,
    pub layout: Arc<SceneLayout>,
    /// The nodes as they stand in the layout.
    pub placed: Arc<PlacedNodes>,
    pub motion: Option<Arc<Motion>>,
    pub features: SceneFeatures,
    pub warm_up: Camera,
}

impl ReadyScene {
    /// See [`polyptych_protocol::server_message::Prepared::detail_reach`]. Where textures alone are
    /// left without levels, they are wherever they are seen from.
    pub fn detail_reach(&self) -> Option<f64> {
        let part = self.part.as_ref().filter(|_| self.levels.iter().any(|level| *level > 0));
        part.map(|part| part.reach.min(f64::MAX))
    }
}

impl Loader {
    pub(super) fn load_scene(
        &mut self,
        scene: &SceneRef,
        replica: &Replica,
        line: &LoaderLink,
    ) -> Result<ReadyScene, String> {
        let version = SceneVersion { manifest: scene.manifest, edits: replica.edits.fingerprint() };
        let budget = replica.wall.as_ref().map(|wall| wall.budget).unwrap_or_default();
        let ready = self.ready_scene.as_ref().map(|(_, _, ready)| ready.clone());
        let is_it = |of: &&ReadyScene| of.version.manifest == scene.manifest && of.budget == budget;
        let before = ready.as_ref().filter(is_it);
        let is_same = |of: &&ReadyScene| {
            of.version == version && (of.part.is_none() || of.seen_from == replica.seen_from)
        };
        if let Some(ready) = before.filter(is_same) {
            return Ok(ready.clone());
        }
        let base = match before {
            Some(ready) => Arc::clone(&ready.base),
            None => Arc::new(self.manifest(scene.manifest, &scene.name, line)?),
        };
        let mut added = AssetManifests::new();
        for manifest in replica.edits.asset_manifests() {
            let known = before.and_then(|ready| ready.added.get(&manifest)).cloned();
            let read = || self.manifest(manifest, "what was added", line).map(Arc::new);
            added.insert(manifest, known.map_or_else(read, Ok)?);
        }
        if let Some(before) = before
            && let Some(kept) = self.kept_scene(before, version, &added, replica)?
        {
            return Ok(kept);
        }
        let seen_from = replica.seen_from.clone();
        let (mut edited, ids) = replica.edits.apply_to(&base, &added);
        let mut traits = replica.edits.traits(&edited.nodes, ids);
        if let Some(fault) = edited.fault() {
            return Err(format!("scene {} as it was edited: {fault}", scene.name));
        }
        let part = HeldPart::limit(&mut edited, &seen_from, budget)?;
        let features = SceneFeatures::from_scene(&edited);
        let warm_up = frame_views::warm_up_camera(&edited);
        let placed = PlacedNodes::new(&edited.nodes, traits.ids.clone(), replica.edits.clone());
        let placed = Arc::new(placed);
        let motion = Motion::new(&base, &placed, &replica.edits).map(Arc::new);
        if let Some(motion) = &motion {
            motion.add_traits(&mut traits);
        }
        let (layout, held) = (self.layout(edited, &traits, line)?, before.map(|of| &*of.layout));
        let is_known = before.is_some_and(|before| before.added.keys().eq(added.keys()))
            && held.is_some_and(|held| layout.shares_content_with(held));
        let chosen = part.as_ref().map(|part| ChosenPart::new(part, Arc::clone(&placed)));
        let levels = part.as_ref().map(|part| part.levels.clone()).unwrap_or_default();
        let warning = part.as_ref().and_then(|part| part.warning.clone());
        let ready = ReadyScene {
            version,
            budget,
            part: chosen,
            levels,
            warning,
            seen_from,
            base,
            added,
            layout,
            placed,
            motion,
            features,
            warm_up,
        };
        if is_known {
            self.upload(Upload::Relayout { layout: Arc::clone(&ready.layout), moved: None })?;
        } else {
            // What is in buffers that others share would keep their memory.
            let is_alike = before.is_some_and(|of| of.part.is_some() == part.is_some());
            self.upload_content(&ready, held.filter(|_| is_alike), part.as_ref(), line)?;
        }
        Ok(ready)
    }

    /// The scene as it was laid out before, if no more of it has changed than where nodes stand;
    /// `None` if it must be laid out anew.
    fn kept_scene(
        &self,
        before: &ReadyScene,
        version: SceneVersion,
        added: &AssetManifests,
        replica: &Replica,
    ) -> Result<Option<ReadyScene>, String> {
        // A part is chosen by where nodes stand and what sees them, all of a scene by nothing.
        let chosen = before.part.as_ref().filter(|_| before.seen_from == replica.seen_from);
        let mut part = chosen.and_then(|part| part.after(&before.base, &replica.edits));
        if before.part.is_some() && part.is_none() {
            let (mut edited, ids) = replica.edits.apply_to(&before.base, added);
            let held = HeldPart::limit(&mut edited, &replica.seen_from, before.budget)?;
            let Some(held) = held.filter(|held| held.levels == before.levels) else {
                return Ok(None);
            };
            let placed = PlacedNodes::new(&edited.nodes, ids, replica.edits.clone());
            part = Some(ChosenPart::new(&held, Arc::new(placed)));
        }
        let seen_from = replica.seen_from.clone();
        let kept = ReadyScene { part, seen_from, ..before.clone() };
        if before.version == version {
            return Ok(Some(kept));
        }
        let moved = moves::moved_items(before, &replica.edits);
        let Some((moved, motion)) = moved else { return Ok(None) };
        let (layout, moved) = (Arc::clone(&before.layout), Some(Arc::new(moved)));
        self.upload(Upload::Relayout { layout, moved })?;
        Ok(Some(ReadyScene { version, motion, ..kept }))
    }

    /// Gives the render thread what of a scene it has not yet.
    fn upload_content(
        &mut self,
        ready: &ReadyScene,
        held: Option<&SceneLayout>,
        part: Option<&HeldPart>,
        line: &LoaderLink,
    ) -> Result<(), String> {
        let layout = &ready.layout;
        let missing = layout.content_beyond(held);
        let (shares, is_part, shown) = (held.is_some(), part.is_some(), self.shown);
        self.upload(Upload::Begin { layout: Arc::clone(layout), shares, is_part, shown })?;
        let is_gone = |(epoch, of): &(Epoch, Replica)| !shown.allows(*epoch, of.revision);
        if self.ready.as_ref().is_some_and(is_gone) {
            // Should this one fail, the next builds on what the render thread still holds.
            let shown_scene = self.shown_scene.clone();
            self.ready_scene = shown_scene.filter(|(epoch, of, _)| shown.is(*epoch, *of));
        }
        let order = BlobOrder { bulk: &line.bulk, check: &|| self.check(line) };
        let host_bytes = ready.budget.host_bytes();
        let wanted = missing.into_iter().map(|(hash, place)| {
            let parts = part.and_then(|part| part.parts(layout.content(), &place));
            (hash, parts, place)
        });
        self.sources.each(wanted, (&order, host_bytes), |place, parts| {
            let bytes = held_part::joined(layout.content(), &place, parts);
            let bytes = match host_bytes {
                // Half is for what is fetched ahead.
                Some(limit) => self.host_memory.count(bytes, limit / 2, order.check)?,
                None => bytes,
            };
            self.upload(match place {
                ContentPlace::Texture { index } => Upload::Texture { index, bytes },
                ContentPlace::Primitive { mesh, primitive } => {
                    Upload::Primitive { mesh, primitive, bytes }
                }
                ContentPlace::Deformer { mesh, primitive } => {
                    Upload::Deformer { mesh, primitive, bytes }
                }
            })
        })
    }

    fn layout(
        &self,
        scene: Scene,
        traits: &NodeTraits,
        line: &LoaderLink,
    ) -> Result<Arc<SceneLayout>, String> {
        let layout = SceneLayout::with_traits(scene, traits, &|| self.fault(line).is_some());
        layout.map(Arc::new).map_err(|error| match self.fault(line) {
            Some(fault) => fault.to_owned(),
            None => error.to_string(),
        })
    }
}
