//! All that clips move in a scene as it stands: nodes, the vertices of meshes, and looks.
//!
//! A node that was edited moves from where it was put: `edited · rest⁻¹ · animated`. Joints hang
//! from each other as in the scene's file.

mod looks;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DAffine3, DVec3};

use crate::animated_property::ChangedMaterial;
use crate::animation::{AnimatedPath, ClipTime, NodePose, edited_from_rest};
use crate::deformation::{Deformation, Shape, Skin};
use crate::edit::NodeId;
use crate::placed_nodes::{MovedPlace, PlacedNodes};
use crate::scene_edits::SceneEdits;
use crate::{Light, NodeTraits, Scene};
use looks::Looks;

/// The moving parts of a scene with the edits of a moment.
#[derive(Debug)]
pub struct Motion {
    base: Arc<Scene>,
    /// Nodes that stand elsewhere than they were placed, without any clip; rising.
    elsewhere: Vec<MovedPlace>,
    /// Nodes that may move, parents before their children, which is rising too.
    movers: Vec<Mover>,
    /// The indices of these, and of those that move once an edit turns a joint; rising.
    may_move: Vec<u32>,
    /// One for each of the scene's deformations that has a skin.
    skeletons: Vec<Option<Skeleton>>,
    looks: Looks,
}

/// A node that may move.
#[derive(Clone, Copy, Debug)]
struct Mover {
    /// Its index among the placed nodes.
    index: u32,
    node: NodeId,
    above: Above,
    local: DAffine3,
    moves: Moves,
    /// The light of the file that it has, if clips change that.
    light: Option<u32>,
}

/// The space that a node hangs from.
#[derive(Clone, Copy, Debug)]
enum Above {
    /// A space that stands still.
    Still(DAffine3),
    /// An index into the movers.
    Mover(usize),
}

/// The way in which a node's own transform changes.
#[derive(Clone, Copy, Debug)]
enum Moves {
    /// Not at all.
    Never,
    /// The way of an animated node, by its index, and its place in the file.
    Animated(usize, DAffine3),
    /// The way of the joints of a deformation, by its index, and its place in the file.
    Joints(usize, DAffine3),
}

/// The nodes of a skin, from its top down.
#[derive(Debug)]
struct Skeleton {
    /// Parents before their children.
    bones: Vec<Bone>,
    /// The bone of each joint; `None` for the top itself.
    joints: Vec<Option<usize>>,
    rigid: Option<usize>,
    /// The place of the node that draws the skin below its top, as in the file; `None` where
    /// something moves it.
    still: Option<DVec3>,
}

#[derive(Clone, Copy, Debug)]
struct Bone {
    parent: Option<usize>,
    local: DAffine3,
    moves: Moves,
    /// It is where it is in the file, and no clip moves it.
    is_still: bool,
}

/// A moment of a scene that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// World space from the nodes that stand elsewhere than they were placed, in the order of their
    /// indices among the placed nodes.
    pub places: Vec<(u32, NodeId, DAffine3)>,
    /// The shape of each of the scene's deformations.
    pub shapes: Vec<Shape>,
    /// Those of [`Self::places`] that are hidden, with all that hangs from them; rising.
    pub hidden: Vec<u32>,
    /// Those of them that have a light that clips change, with the light as it shines; rising.
    pub lights: Vec<(u32, Light)>,
    /// The materials that clips change; rising.
    pub materials: Vec<ChangedMaterial>,
}

impl Moves {
    /// The transform of a node now.
    fn local(self, still: DAffine3, poses: &[NodePose], anchors: &[DVec3]) -> DAffine3 {
        match self {
            Self::Never => still,
            Self::Animated(at, rest) => poses[at].local_from(rest, still),
            Self::Joints(at, rest) => {
                let anchor = DAffine3::from_translation(anchors[at]);
                edited_from_rest(rest, still).map_or(anchor, |change| change * anchor)
            }
        }
    }
}

/// These nodes, and all that hangs from them.
fn with_children(placed: &PlacedNodes, nodes: impl Iterator<Item = u32>) -> BTreeSet<u32> {
    let (mut all, mut open) = (BTreeSet::new(), nodes.collect::<Vec<_>>());
    while let Some(index) = open.pop() {
        if all.insert(index) {
            open.extend(placed.children(index));
        }
    }
    all
}

/// The nodes that edits gave a mesh that bends: its vertices are those of all who show it.
fn sharers(base: &Scene, edits: &SceneEdits) -> impl Iterator<Item = NodeId> {
    let bends = |mesh: u32| base.deformations.iter().any(|of| of.mesh == mesh);
    let shown = edits.nodes().filter(move |(_, of)| of.given_mesh().is_some_and(bends));
    shown.map(|(node, _)| node)
}

impl Motion {
    /// The moving parts of a scene of which `placed` has the nodes, with edits that differ from
    /// those it was placed with in places only. `None` where nothing ever moves by itself.
    pub fn new(base: &Arc<Scene>, placed: &PlacedNodes, edits: &SceneEdits) -> Option<Self> {
        let looks = Looks::new(base, edits);
        if base.animations.nodes.is_empty() && base.deformations.is_empty() && looks.is_empty() {
            return None;
        }
        let elsewhere = placed.moved(base, edits).unwrap_or_default();
        let mut motion = Self {
            base: Arc::clone(base),
            elsewhere,
            movers: Vec::new(),
            may_move: Vec::new(),
            skeletons: Vec::new(),
            looks,
        };
        let mut tops: BTreeMap<u32, Moves> = BTreeMap::new();
        for (at, of) in base.animations.nodes.iter().enumerate() {
            if let Some(index) = placed.index_of(NodeId(of.node.into())) {
                tops.insert(index, motion.animated(at));
            }
        }
        let mut still = Vec::new();
        for (at, of) in base.deformations.iter().enumerate() {
            let skeleton = of.skin.as_ref().map(|skin| motion.skeleton(edits, of, skin));
            let index = placed.index_of(NodeId(of.node.into()));
            if let (Some(skeleton), Some(index)) = (&skeleton, index) {
                if skeleton.still.is_some() {
                    still.push(index);
                } else {
                    tops.insert(index, Moves::Joints(at, base.nodes[of.node as usize].local));
                }
            }
            motion.skeletons.push(skeleton);
        }
        let of_file = motion.looks.nodes().chain(motion.lamps(edits));
        let of_file = of_file.map(|node| NodeId(node.into()));
        for node in of_file.chain(sharers(base, edits)) {
            if let Some(index) = placed.index_of(node) {
                tops.entry(index).or_insert(Moves::Never);
            }
        }
        motion.add_movers(placed, edits, &tops);
        let all = tops.into_keys().chain(still);
        motion.may_move = with_children(placed, all).into_iter().collect();
        Some(motion)
    }

    /// The nodes of the file whose lights clips change, and that have them still; rising.
    fn lamps(&self, edits: &SceneEdits) -> Vec<u32> {
        if !self.looks.has_lights() {
            return Vec::new();
        }
        let all = 0..self.base.nodes.len() as u32;
        all.filter(|node| self.light_of(edits, NodeId((*node).into())).is_some()).collect()
    }

    /// The light of the file that a node has, if clips change it.
    fn light_of(&self, edits: &SceneEdits, node: NodeId) -> Option<u32> {
        let of_file = self.base.nodes.get(usize::try_from(node.0).ok()?)?;
        let light = of_file.light.filter(|light| self.looks.has_light(*light))?;
        let is_own = edits.node(node).is_some_and(|edits| edits.light.is_some());
        (!is_own).then_some(light)
    }

    fn animated(&self, at: usize) -> Moves {
        let node = self.base.animations.nodes[at].node;
        Moves::Animated(at, self.base.nodes[node as usize].local)
    }

    /// Adds the nodes that clips move, and all that hangs from them.
    fn add_movers(
        &mut self,
        placed: &PlacedNodes,
        edits: &SceneEdits,
        tops: &BTreeMap<u32, Moves>,
    ) {
        let mut mover_of: BTreeMap<u32, usize> = BTreeMap::new();
        for index in with_children(placed, tops.keys().copied()) {
            let moves = tops.get(&index).copied().unwrap_or(Moves::Never);
            let node = placed.id(index);
            let still = edits.local_of(&self.base, node).unwrap_or_default();
            let parent = placed.parent(index);
            let above = match parent.and_then(|parent| mover_of.get(&parent)) {
                Some(mover) => Above::Mover(*mover),
                None => Above::Still(
                    parent
                        .and_then(|of| placed.world_of(&self.base, edits, of))
                        .unwrap_or_default(),
                ),
            };
            mover_of.insert(index, self.movers.len());
            let light = self.light_of(edits, node);
            self.movers.push(Mover { index, node, above, local: still, moves, light });
        }
    }

    fn skeleton(&self, edits: &SceneEdits, of: &Deformation, skin: &Skin) -> Skeleton {
        let (bones, joints) = (Vec::new(), Vec::new());
        let mut skeleton = Skeleton { bones, joints, rigid: None, still: None };
        let mut known: BTreeMap<u32, usize> = BTreeMap::new();
        for joint in &skin.joints {
            let bone = self.bone(edits, (skin.top, joint.node), &mut skeleton.bones, &mut known);
            skeleton.joints.push(bone);
        }
        let rigid = skin.rigid;
        skeleton.rigid = rigid
            .and_then(|node| self.bone(edits, (skin.top, node), &mut skeleton.bones, &mut known));
        // Items that count as moving are drawn into all maps of shadows while anything moves.
        let is_still = of.weights_of.is_none() && skeleton.bones.iter().all(|bone| bone.is_still);
        skeleton.still = is_still.then(|| self.base.nodes[of.node as usize].local.translation);
        skeleton
    }

    /// Returns the bone of a node below a skin's top, and adds those between the two.
    fn bone(
        &self,
        edits: &SceneEdits,
        (top, node): (Option<u32>, u32),
        bones: &mut Vec<Bone>,
        known: &mut BTreeMap<u32, usize>,
    ) -> Option<usize> {
        let mut way = Vec::new();
        let mut next = Some(node).filter(|_| Some(node) != top);
        while let Some(node) = next.filter(|node| !known.contains_key(node)) {
            way.push(node);
            next = self.base.nodes[node as usize].parent.filter(|parent| Some(*parent) != top);
        }
        let mut parent = next.and_then(|node| known.get(&node).copied());
        for node in way.into_iter().rev() {
            let of_file = self.base.nodes[node as usize].local;
            let local = edits.local_of(&self.base, NodeId(node.into())).unwrap_or(of_file);
            let animated = &self.base.animations.nodes;
            let at = animated.binary_search_by_key(&node, |of| of.node);
            let moves = at.map_or(Moves::Never, |at| self.animated(at));
            let is_still = at.is_err() && local == of_file;
            bones.push(Bone { parent, local, moves, is_still });
            parent = Some(bones.len() - 1);
            known.insert(node, bones.len() - 1);
        }
        parent
    }

    /// Returns whether a clip may turn something inside out.
    pub fn may_mirror(&self) -> bool {
        // Clips may take away what turns a node inside out at rest.
        let is_turned = |mover: &Mover| match mover.moves {
            Moves::Animated(_, rest) | Moves::Joints(_, rest) => {
                [rest, mover.local].iter().any(|local| local.matrix3.determinant() < 0.0)
            }
            Moves::Never => false,
        };
        let mut channels = self.base.animations.clips.iter().flat_map(|clip| &clip.channels);
        let has_negative = channels
            .any(|channel| channel.path == AnimatedPath::Scale && channel.may_be_negative());
        has_negative || self.movers.iter().any(is_turned)
    }

    /// Returns whether these clips move anything, a skeleton was edited, or looks are as they are
    /// at a moment only.
    pub fn is_moved_by(&self, clips: &[ClipTime]) -> bool {
        let is_always = !self.base.deformations.is_empty() || !self.looks.is_empty();
        is_always || clips.iter().any(|clip| clip.weight > 0.0)
    }

    /// Says of the placed nodes and of the materials what clips may do to them.
    pub fn add_traits(&self, traits: &mut NodeTraits) {
        traits.moving.clone_from(&self.may_move);
        traits.may_mirror = self.may_mirror();
        traits.changing_lights = self.changing_lights().collect();
        traits.changing_materials = self.looks.changing(&self.base);
    }

    /// The indices of the nodes with a light that clips change among the placed nodes, rising.
    fn changing_lights(&self) -> impl Iterator<Item = u32> + '_ {
        self.movers.iter().filter(|mover| mover.light.is_some()).map(|mover| mover.index)
    }

    /// The scene's deformations, in the order of [`Moment::shapes`].
    pub fn deformations(&self) -> &[Deformation] {
        &self.base.deformations
    }

    /// The nodes of the scene's file.
    pub fn base(&self) -> &Scene {
        &self.base
    }

    /// The indices of the nodes that may move among the placed nodes, rising: none of a skin that
    /// no clip moves and no edit has bent.
    pub fn movers(&self) -> impl Iterator<Item = u32> + '_ {
        self.movers.iter().map(|mover| mover.index)
    }

    /// All that these clips move, as they move it.
    pub fn at(&self, clips: &[ClipTime]) -> Moment {
        let (poses, values) = self.base.animations.at(clips);
        let shapes = self.base.deformations.iter().zip(&self.skeletons);
        let (shapes, anchors): (Vec<Shape>, Vec<DVec3>) =
            shapes.map(|(of, skeleton)| shape(of, skeleton.as_ref(), &poses)).unzip();
        let mut worlds: Vec<DAffine3> = Vec::with_capacity(self.movers.len());
        let (mut hidden, mut lights) = (BTreeSet::new(), BTreeMap::new());
        let mut places = BTreeMap::new();
        places.extend(self.elsewhere.iter().map(|of| (of.index, (of.node, of.world))));
        for mover in &self.movers {
            let local = mover.moves.local(mover.local, &poses, &anchors);
            let world = match mover.above {
                Above::Still(world) => world * local,
                Above::Mover(above) => worlds[above] * local,
            };
            worlds.push(world);
            places.insert(mover.index, (mover.node, world));
            let above = match mover.above {
                Above::Mover(above) => Some(self.movers[above].index),
                Above::Still(_) => None,
            };
            let is_below_hidden = above.is_some_and(|above| hidden.contains(&above));
            let of_file = u32::try_from(mover.node.0);
            if is_below_hidden || of_file.is_ok_and(|node| self.looks.hides(node, &values)) {
                hidden.insert(mover.index);
            }
            let light = mover.light.and_then(|of| self.looks.light(&self.base, of, &values));
            lights.extend(light.map(|light| (mover.index, light)));
        }
        let places = places.into_iter().map(|(index, (node, world))| (index, node, world));
        Moment {
            places: places.collect(),
            shapes,
            hidden: hidden.into_iter().collect(),
            lights: lights.into_iter().collect(),
            materials: self.looks.materials(&self.base, &values),
        }
    }
}

/// The shape of a deformation, and the place of the node that draws it below the skin's top: near
/// the joints, so that vertices stay small numbers wherever they go.
fn shape(of: &Deformation, skeleton: Option<&Skeleton>, poses: &[NodePose]) -> (Shape, DVec3) {
    let animated = of.weights_of.and_then(|at| poses.get(at as usize));
    let weights = animated.map_or_else(|| of.weights.clone(), |pose| pose.weights.clone());
    let (Some(skin), Some(skeleton)) = (&of.skin, skeleton) else {
        return (Shape { joints: Vec::new(), rigid: DAffine3::IDENTITY, weights }, DVec3::ZERO);
    };
    let mut worlds: Vec<DAffine3> = Vec::with_capacity(skeleton.bones.len());
    for bone in &skeleton.bones {
        let local = bone.moves.local(bone.local, poses, &[]);
        worlds.push(bone.parent.map_or(local, |parent| worlds[parent] * local));
    }
    let world = |bone: &Option<usize>| bone.map_or(DAffine3::IDENTITY, |bone| worlds[bone]);
    let joints = skeleton.joints.iter().zip(&skin.joints);
    let mut joints: Vec<DAffine3> =
        joints.map(|(bone, joint)| world(bone) * joint.inverse_bind).collect();
    let anchor = skeleton.still.unwrap_or_else(|| median(&joints));
    for matrix in &mut joints {
        matrix.translation -= anchor;
    }
    let mut rigid = world(&skeleton.rigid);
    rigid.translation -= anchor;
    (Shape { joints, rigid, weights }, anchor)
}

/// The component-wise median: most joints of a skin stand near each other, whatever one does.
fn median(matrices: &[DAffine3]) -> DVec3 {
    let component = |axis: usize| {
        let mut values: Vec<f64> = matrices.iter().map(|of| of.translation[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().filter(|value| value.is_finite()).unwrap_or(0.0)
    };
    DVec3::new(component(0), component(1), component(2))
}

#[cfg(test)]
mod tests;
