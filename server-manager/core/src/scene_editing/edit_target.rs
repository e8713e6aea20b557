//! The parts of a scene that edits change.

use polyptych_scene::{AssetSetId, Edit, NodeId};
use serde::{Deserialize, Serialize};

/// The part of a scene that an edit changes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum EditTarget {
    /// A node.
    Node(NodeId),
    /// A material, by its number.
    Material(u32),
    /// Whether a layer is shown.
    Layer(String),
    /// The variant that is shown.
    Variant,
    /// Assets that were added.
    Assets(AssetSetId),
}

impl EditTarget {
    /// Returns the part that an edit changes.
    pub fn of(edit: &Edit) -> Option<Self> {
        match edit {
            Edit::SetMaterial { material, .. } => Some(Self::Material(*material)),
            Edit::SetLayerVisible { layer, .. } => Some(Self::Layer(layer.clone())),
            Edit::SetVariant(_) => Some(Self::Variant),
            Edit::AddAssets(set) => Some(Self::Assets(set.id())),
            Edit::RemoveAssets(id) => Some(Self::Assets(*id)),
            other => other.node().map(Self::Node),
        }
    }
}

impl std::fmt::Display for EditTarget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Node(node) => node.fmt(f),
            Self::Material(material) => write!(f, "material {material}"),
            Self::Layer(layer) => write!(f, "layer {layer}"),
            Self::Variant => f.write_str("the variant"),
            Self::Assets(_) => f.write_str("added assets"),
        }
    }
}
