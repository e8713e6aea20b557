//! The part of a scene that is loaded within the wall's budgets of memory.

use std::ops::Range;
use std::sync::Arc;

use bytes::Bytes;
use polyptych_renderer::ContentPlace;
use polyptych_scene::residency::{BudgetTooSmall, NodeWeights, Residency, SeenFrom};
use polyptych_scene::{Mesh, PlacedNodes, Primitive, Scene, SceneEdits, Texture};
use polyptych_wall::MemoryBudget;

use super::moves;

/// Meshes and textures of which only a part is loaded.
#[derive(Debug)]
pub(super) struct HeldPart {
    /// Meshes with all that their blobs hold.
    meshes: Vec<Mesh>,
    textures: Vec<Texture>,
    /// What it was chosen by.
    pub weights: Arc<NodeWeights>,
    /// The finest level of each mesh that is held.
    pub levels: Vec<u32>,
    /// The warning of what is missing, for the operator.
    pub warning: Option<String>,
}

/// The places by which a part was chosen, and how far they may move.
#[derive(Clone, Debug)]
pub(super) struct ChosenPart {
    weights: Arc<NodeWeights>,
    /// The nodes as they were weighed.
    placed: Arc<PlacedNodes>,
    /// See [`polyptych_scene::residency::MeshWeights::reach`].
    pub reach: f64,
}

impl ChosenPart {
    pub fn new(part: &HeldPart, placed: Arc<PlacedNodes>) -> Self {
        let (weights, reach) = (Arc::clone(&part.weights), part.weights.mesh_weights().reach);
        Self { weights, placed, reach }
    }

    /// Returns the same part with other edits, seen from the same places. `None` where another one
    /// may be chosen then. It costs what was moved since this one was.
    pub fn after(&self, base: &Scene, edits: &SceneEdits) -> Option<Self> {
        let moved = self.placed.moved(base, edits)?;
        let reach = self.weights.reach_after(&moved, |node| moves::instances(base, node))?;
        Some(Self { reach, ..self.clone() })
    }
}

impl HeldPart {
    /// Limits a scene as it was edited to the budget of GPU memory, for places that it is seen
    /// from; `None` if all of it is loaded.
    ///
    /// The choice depends on the replicated state alone, so that all servers make the same.
    ///
    /// # Errors
    /// Even the coarsest of the scene is more than the budget: the key, and the least that works.
    pub fn limit(
        edited: &mut Scene,
        seen_from: &[SeenFrom],
        budget: MemoryBudget,
    ) -> Result<Option<Self>, String> {
        let (Some(bytes), Some(mib)) = (budget.gpu_bytes(), budget.gpu_mib) else {
            return Ok(None);
        };
        let weights = Arc::new(NodeWeights::new(edited, seen_from));
        let each = weights.mesh_weights().each;
        let held = Residency::choose(&edited.meshes, &edited.textures, &each, bytes);
        let held = held.map_err(|BudgetTooSmall { least }| {
            let least = least.div_ceil(1 << 20);
            format!(
                "the scene's coarsest meshes and smallest textures are more than the budget: \
                 budget.gpu_mib is {mib}; write at least {least}"
            )
        })?;
        if held.levels.iter().all(|level| *level == 0) && held.texture_levels_left_out == 0 {
            return Ok(None);
        }
        let part = Self {
            meshes: edited.meshes.clone(),
            textures: edited.textures.clone(),
            weights,
            levels: held.levels.clone(),
            warning: warning(&held, mib),
        };
        held.limit(edited);
        let (bytes, error) = (held.gpu_bytes, held.error);
        let places = seen_from.len();
        tracing::debug!(bytes, error, places, mib, "a part of the scene is held within the budget");
        Ok(Some(part))
    }

    /// The parts of the blob of a place in a limited scene, in bytes.
    pub fn parts(&self, limited: &Scene, place: &ContentPlace) -> Option<Vec<Range<u64>>> {
        match *place {
            ContentPlace::Texture { index } => {
                let (whole, held) = (self.textures.get(index)?, limited.textures.get(index)?);
                Some(std::iter::once(whole.bytes() - held.bytes()..whole.bytes()).collect())
            }
            ContentPlace::Deformer { .. } => None,
            ContentPlace::Primitive { mesh, primitive } => {
                let whole = self.meshes.get(mesh)?.primitives.get(primitive)?;
                let held = limited.meshes.get(mesh)?.primitives.get(primitive)?;
                Some(whole.parts_of(held).to_vec())
            }
        }
    }
}

/// The blob of a place in a limited scene, from its parts.
pub(super) fn joined(limited: &Scene, place: &ContentPlace, parts: Vec<Bytes>) -> Bytes {
    if let ContentPlace::Primitive { mesh, primitive } = *place
        && let [vertices, indices, meshlets] = &parts[..]
        && let Some(of) = limited.meshes.get(mesh).and_then(|mesh| mesh.primitives.get(primitive))
    {
        return Primitive::joined(of, [vertices, indices, meshlets]).into();
    }
    parts.into_iter().next().unwrap_or_default()
}

fn warning(held: &Residency, mib: u32) -> Option<String> {
    let side = 1_u32 << held.texture_levels_left_out;
    (side > 1).then(|| {
        format!(
            "the budget of {mib} MiB (budget.gpu_mib) is too small for the textures: they are \
             shown with 1/{side} of their width and height"
        )
    })
}
