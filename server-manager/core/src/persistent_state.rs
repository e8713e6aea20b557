//! The state that outlives a manager: persisted before a client is told that its request was done.

use polyptych_protocol::environment::Environment;
use polyptych_protocol::ids::{Epoch, Revision};
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::request::Pacing;
use polyptych_protocol::screen_rest::RestRules;
use polyptych_protocol::state_log::{Operation, SceneRef, check_wall_size};
use polyptych_protocol::stored_view::StoredView;
use polyptych_scene::{Bounds, Edit, LightEffects, NodeId, SceneEdits};
use polyptych_wall::{ChannelCalibration, Wall, calibration_change};
use serde::{Deserialize, Serialize};

use super::{Cluster, EditedScene, Effect, FollowedNode, Micros, PlayedClips, PlayedTour};

/// A camera that comes with every frame is remembered this often: it is where a client was, not
/// what it asked to be kept.
const FRAME_CAMERA_PERIOD: Micros = 1_000_000;

/// The state that a manager needs to go on where another one stopped. It is valid for the wall that
/// comes with it: what an edited wall file makes invalid was removed before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PersistentState {
    /// Changes so far.
    pub revision: Revision,
    /// The open scene.
    pub scene: Option<SceneRef>,
    /// The presentation of frames: a wall that was made black does not light up with a new manager.
    pub presentation: Presentation,
    /// The pace at which the wall draws by itself, if it does.
    pub pace: Option<Pacing>,
    /// The adjustments of channels that were tuned, by name.
    pub tunings: Vec<(String, ChannelCalibration)>,
    /// Notes on what is not drawn of the open scene, as its manifest says.
    pub notes: Vec<String>,
    /// Around everything that the open scene draws.
    pub bounds: Option<Bounds>,
    /// The changes of the open scene.
    pub edits: SceneEdits,
    /// The number that the next node of it gets at least.
    pub next_node: u64,
    /// Its nodes that end with a client's connection, and so with the manager.
    pub temporary: Vec<NodeId>,
    /// Places of the camera, by name.
    #[serde(default)]
    pub stored_views: Vec<StoredView>,
    /// The tour that is played.
    #[serde(default)]
    pub tour: Option<PlayedTour>,
    /// The node that the camera follows.
    #[serde(default)]
    pub following: Option<FollowedNode>,
    /// The clips of the open scene.
    #[serde(default)]
    pub clips: PlayedClips,
    /// The surroundings of scenes, if not their own sky.
    #[serde(default)]
    pub environment: Option<Environment>,
    /// The rules by which displays go dark by themselves.
    #[serde(default)]
    pub rest: RestRules,
    /// `true` if a tracker has placed the head, which then returns to its place in the wall file
    /// unless its bridge comes back; `false` for a head that stays.
    #[serde(default)]
    pub is_head_tracked: bool,
}

impl PersistentState {
    /// Returns the state before anything was asked of this wall.
    pub fn of_wall(wall: &Wall) -> Self {
        Self {
            revision: Revision::default(),
            scene: None,
            presentation: Presentation::new(wall.head()),
            pace: None,
            tunings: Vec::new(),
            notes: Vec::new(),
            bounds: None,
            edits: SceneEdits::default(),
            next_node: 0,
            temporary: Vec::new(),
            stored_views: Vec::new(),
            tour: None,
            following: None,
            clips: PlayedClips::default(),
            environment: None,
            rest: RestRules::default(),
            is_head_tracked: false,
        }
    }

    /// Returns whether more differs than the camera, the head (tracked or not) and the views, which
    /// a client sends all the time, and how far a tour or what is followed has come.
    pub fn differs_in_work(&self, other: &Self) -> bool {
        let Presentation { camera, head, views, .. } = other.presentation.clone();
        let presentation = Presentation { camera, head, views, ..self.presentation.clone() };
        let is_same = |tour: &PlayedTour| other.tour.as_ref().is_some_and(|of| of.is_same(tour));
        let tour = if self.tour.as_ref().is_some_and(is_same) { &other.tour } else { &self.tour };
        let follow = |of: &Self| of.following.as_ref().map(|node| node.follow);
        let is_followed_alike = follow(self) == follow(other);
        let following = if is_followed_alike { &other.following } else { &self.following };
        let (tour, following) = (tour.clone(), following.clone());
        let clips = if self.clips.is_same(&other.clips) { &other.clips } else { &self.clips };
        let (clips, is_head_tracked) = (clips.clone(), other.is_head_tracked);
        Self { presentation, tour, following, clips, is_head_tracked, ..self.clone() } != *other
    }
}

/// Returns the changes of a scene without nodes that end with their client or the manager.
fn lasting(all: &SceneEdits, temporary: &[NodeId]) -> SceneEdits {
    let mut edits = all.clone();
    for &node in temporary {
        if edits.node(node).is_some() {
            edits.apply(Edit::Remove(node));
        }
    }
    for unused in edits.unused_assets() {
        edits.apply(Edit::RemoveAssets(unused));
    }
    edits
}

impl Cluster {
    /// The core of this wall, going on from what another manager remembered.
    pub fn restore(wall: Wall, epoch: Epoch, memory: &PersistentState) -> Self {
        let mut cluster = Self::new(wall, epoch);
        if let Some(scene) = &memory.scene {
            cluster.shown.apply(Operation::OpenScene(scene.clone()));
            let edits = lasting(&memory.edits, &memory.temporary);
            if !edits.is_empty() {
                cluster.shown.apply(Operation::SetEdits(Box::new(edits.clone())));
            }
            cluster.editing.restore(edits, memory.next_node);
            cluster.notes.clone_from(&memory.notes);
            cluster.navigator.bounds = memory.bounds;
        }
        if memory.environment.is_some() {
            cluster.shown.apply(Operation::SetEnvironment(memory.environment.clone()));
        }
        let effects = memory.presentation.effects();
        if effects != LightEffects::default() {
            cluster.shown.apply(Operation::SetEffects(effects));
        }
        cluster.shown.revision = memory.revision.max(cluster.shown.revision);
        // A state without what has ended has not been numbered yet.
        cluster.shown.revision.0 += u64::from(cluster.shown.edits != memory.edits);
        let restored = calibration_change::reapply(&cluster.file, &memory.tunings)
            .and_then(|wall| check_wall_size(&wall).map(|()| wall));
        match restored {
            Ok(wall) => {
                let revision = cluster.shown.revision;
                cluster.shown.apply(Operation::SetWall(Box::new(wall.clone())));
                cluster.shown.revision = revision;
                cluster.tuned.note(&cluster.file, &wall);
                cluster.wall = wall;
            }
            Err(reason) => tracing::warn!(reason, "the tunings in the state file were dropped"),
        }
        cluster.editing.begin_at(cluster.shown.revision);
        cluster.shown_digest = cluster.shown.digest();
        for reason in cluster.resume(memory, 0) {
            tracing::warn!(reason, "a part of the remembered state was left out");
        }
        if memory.is_head_tracked {
            // Its bridge may have ended with the other manager; one that lives places it anew.
            cluster.begin_head_return(0);
        }
        cluster.restore_rest(memory.rest);
        cluster.restore_places();
        // Frames of another life were shown; its displays say that their manager is lost.
        cluster.is_going_on = true;
        cluster.remembered = Some(cluster.persistent_state());
        cluster
    }

    /// Presents, plays and keeps what another life of the manager did, or a session. Numbers from
    /// a file are looked at as those of a client are. Returns what cannot be, with the reason.
    pub(super) fn resume(&mut self, memory: &PersistentState, now: Micros) -> Vec<String> {
        let Presentation {
            camera,
            head,
            ref views,
            exposure,
            output_mode,
            pattern,
            bounds,
            tone,
            is_exposure_automatic,
            fog,
            glow,
            ambient_occlusion,
            depth_of_field,
            // It ends with the alignment that set it.
            marker: _,
        } = memory.presentation;
        // It goes with the scene: lights in real units are white at any other.
        self.presentation.is_exposure_automatic = is_exposure_automatic;
        if exposure.is_finite() && exposure >= 0.0 {
            self.presentation.exposure = exposure;
        }
        self.end_motion();
        if camera.fault().is_none() {
            self.presentation.camera = camera;
        }
        self.presentation.output_mode = output_mode;
        self.presentation.pattern = pattern;
        self.presentation.tone = tone;
        // What a client could not set is left out.
        self.presentation.fog = fog.filter(|fog| fog.fault().is_none());
        self.presentation.glow = glow.filter(|glow| glow.fault().is_none());
        self.presentation.ambient_occlusion = ambient_occlusion.filter(|of| of.fault().is_none());
        self.presentation.depth_of_field = depth_of_field.filter(|of| of.fault().is_none());
        let head = self.place_head(None, head.into());
        let head = head.map_err(|reason| format!("the head: {reason}"));
        let views = self.set_views(views.clone()).map_err(|reason| format!("views: {reason}"));
        let bounds = self.set_bounds(bounds).map_err(|reason| format!("the bounds: {reason}"));
        self.stored_views.clear();
        self.restore_stored_views(&memory.stored_views);
        self.restore_tour(memory.tour.as_ref());
        self.restore_following(memory.following.as_ref());
        self.restore_clips(&memory.clips);
        self.set_pace(memory.pace, now);
        [head, views, bounds].into_iter().filter_map(Result::err).collect()
    }

    /// Returns what is to outlive this manager.
    pub fn persistent_state(&self) -> PersistentState {
        let tunings = calibration_change::diff(&self.file, &self.wall);
        PersistentState {
            revision: self.shown.revision,
            scene: self.shown.scene.clone(),
            presentation: self.presentation.clone(),
            pace: self.pacer.pace(),
            tunings,
            notes: self.notes.clone(),
            bounds: self.navigator.bounds,
            edits: self.shown.edits.clone(),
            next_node: self.editing.next_node(),
            temporary: self.editing.temporary(),
            stored_views: self.stored_views.clone(),
            tour: self.remembered_tour(),
            following: self.remembered_following(),
            clips: self.remembered_clips(),
            environment: self.shown.environment.clone(),
            rest: self.rest.rules(),
            is_head_tracked: self.is_head_tracked(),
        }
    }

    /// The open scene in the state that frames name, without what is temporary.
    pub fn edited_scene(&self) -> Option<EditedScene> {
        let scene = self.shown.scene.clone()?;
        let edits = lasting(&self.shown.edits, &self.editing.temporary());
        Some(EditedScene { scene, edits, next_node: self.editing.next_node() })
    }

    /// Remembers the present state, where it has changed. Comes before the answer that tells of
    /// the change.
    pub(super) fn persist(&mut self) {
        let memory = self.persistent_state();
        if self.remembered.as_ref() != Some(&memory) {
            self.remembered = Some(memory.clone());
            self.outputs.push_back(Effect::Remember(Box::new(memory)));
        }
    }

    /// Persists the state after a frame, at most once in [`FRAME_CAMERA_PERIOD`].
    pub(super) fn persist_camera(&mut self, now: Micros) {
        if now.saturating_sub(self.remembered_at) >= FRAME_CAMERA_PERIOD {
            self.remembered_at = now;
            self.persist();
        }
    }
}
