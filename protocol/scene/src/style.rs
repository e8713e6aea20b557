//! Styles: how nodes are drawn, whatever their meshes and materials say.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The way in which a node, with all that hangs from it, is drawn. `None` is as of the node above,
/// of nodes that hang from the scene itself solid, as its material says, without a highlight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeStyle {
    /// The part of meshes that is drawn.
    pub fill: Option<Fill>,
    /// The light on surfaces.
    pub shading: Option<Shading>,
    /// A colour over what is drawn.
    pub highlight: Option<Highlight>,
}

/// The way in which a node turns towards the viewer, about its own origin: of its directions, +Z is
/// its front. All displays show it turned alike, towards the middle between the viewer's eyes, or
/// towards the camera of a view that is a camera's own picture; in parallel rays against these.
/// Nodes that hang from it turn with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Facing {
    /// Its front points at the eye.
    Eye,
    /// It turns about the world's Y axis only, so that what is upright stays upright.
    Upright,
}

/// The part of a mesh that is drawn.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub enum Fill {
    /// All of it.
    #[default]
    Solid,
    /// The edges of its triangles, as lines of one pixel; hidden edges too.
    Wireframe,
    /// Its vertices, as points of one pixel; hidden ones too.
    Points,
}

/// The light on surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shading {
    /// The light that their materials ask for.
    #[default]
    Material,
    /// None: their base colours are shown as they are, as of `KHR_materials_unlit`.
    Unlit,
}

/// A colour over what is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Highlight {
    /// None.
    #[default]
    Off,
    /// This colour is mixed into the shown one, after light and tone mapping.
    Tint {
        /// Linear RGB, 0 to 1, as displays show it.
        color: Vec3,
        /// The part of it in the mixture, 0 to 1.
        share: f32,
    },
}

impl NodeStyle {
    /// Returns whether it changes nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The style of a node that has this as its own, below one of another.
    #[must_use]
    pub fn below(self, above: Self) -> Self {
        Self {
            fill: self.fill.or(above.fill),
            shading: self.shading.or(above.shading),
            highlight: self.highlight.or(above.highlight),
        }
    }

    /// Returns why it is none, if so.
    pub fn fault(&self) -> Option<String> {
        let Some(Highlight::Tint { color, share }) = self.highlight else { return None };
        let is_part = |part: f32| (0.0..=1.0).contains(&part);
        if !color.to_array().into_iter().all(is_part) {
            return Some(format!("a highlight's color is 0 to 1 in all three, not {color}"));
        }
        (!is_part(share)).then(|| format!("a highlight's share is 0 to 1, not {share}"))
    }
}
