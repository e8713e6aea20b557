//! The changes of one node of a scene.

use std::collections::BTreeMap;

use glam::DAffine3;
use serde::{Deserialize, Serialize};

use crate::edit::{Attribute, Edit, NewNode, NodeId};
use crate::{Facing, Light, NodeStyle};

/// The differences of one node; `None` for what is as its file has it. Of nodes that were made,
/// `created` has all that [`NewNode`] has.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeEdits {
    /// The node as it stands; `None` for nodes of the file.
    pub created: Option<Box<NewNode>>,
    /// `true` once it was taken away.
    pub is_removed: bool,
    /// The node that it hangs from now.
    pub parent: Option<Option<NodeId>>,
    /// Its place now: parent space from its space.
    pub local: Option<DAffine3>,
    /// `true` while it is hidden.
    pub is_hidden: bool,
    /// Its name now.
    pub name: Option<String>,
    /// Its mesh now.
    pub mesh: Option<Option<u32>>,
    /// Its light now.
    pub light: Option<Option<Light>>,
    /// Its attributes.
    pub attributes: BTreeMap<String, Attribute>,
    /// The layer that it was put into; `None` for that of its parent.
    pub layer: Option<String>,
    /// The only one of its children that is shown; `None` for all.
    pub switch: Option<NodeId>,
    /// The way in which it is drawn.
    pub style: NodeStyle,
    /// The way in which it turns towards the viewer.
    pub facing: Option<Facing>,
}

impl NodeEdits {
    /// The mesh that edits gave the node, which may be made by them; `None` if it has no mesh or
    /// that of the file.
    pub fn given_mesh(&self) -> Option<u32> {
        self.mesh.unwrap_or_else(|| self.created.as_ref().and_then(|new| new.mesh))
    }

    /// Returns whether no more of what is drawn differs than where the node is.
    pub(crate) fn differs_in_place_only(&self, other: &Self) -> bool {
        // Whatever else there is of a node, or comes to be, counts as drawn.
        let mut here = self.clone();
        (here.local, here.name) = (other.local, other.name.clone());
        here.attributes.clone_from(&other.attributes);
        if let (Some(own), Some(its)) = (&mut here.created, &other.created) {
            own.local = its.local;
            own.name.clone_from(&its.name);
        }
        here == *other
    }

    pub(crate) fn apply(&mut self, edit: Edit) {
        // One that was made is kept as it would be made now, which takes no more than before.
        if let Some(made) = &mut self.created {
            match edit {
                Edit::SetParent { parent, .. } => return made.parent = parent,
                Edit::SetTransform { local, .. } => return made.local = local,
                Edit::SetName { name, .. } => return made.name = name,
                Edit::SetMesh { mesh, .. } => return made.mesh = mesh,
                Edit::SetLight { light, .. } => return made.light = light,
                _ => {}
            }
        }
        match edit {
            Edit::Create { new, .. } => *self = Self { created: Some(new), ..Self::default() },
            Edit::Remove(_) => {
                // One that was made is gone without a trace: its number is not given again.
                let is_removed = self.created.is_none();
                *self = Self { is_removed, ..Self::default() };
            }
            Edit::SetParent { parent, .. } => self.parent = Some(parent),
            Edit::SetTransform { local, .. } => self.local = Some(local),
            Edit::SetVisible { visible, .. } => self.is_hidden = !visible,
            Edit::SetName { name, .. } => self.name = Some(name),
            Edit::SetMesh { mesh, .. } => self.mesh = Some(mesh),
            Edit::SetLight { light, .. } => self.light = Some(light),
            Edit::SetAttribute { key, value: Some(value), .. } => {
                self.attributes.insert(key, value);
            }
            Edit::SetAttribute { key, value: None, .. } => drop(self.attributes.remove(&key)),
            Edit::SetLayer { layer, .. } => self.layer = layer,
            Edit::SetSwitch { shown, .. } => self.switch = shown,
            Edit::SetStyle { style, .. } => self.style = style,
            Edit::SetFacing { facing, .. } => self.facing = facing,
            Edit::SetMaterial { .. }
            | Edit::AddAssets(_)
            | Edit::RemoveAssets(_)
            | Edit::SetVariant(_)
            | Edit::SetLayerVisible { .. } => {}
        }
    }
}
