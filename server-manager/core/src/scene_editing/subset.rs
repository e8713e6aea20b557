//! Parts of the open scene that views show.

use polyptych_scene::limits::LAYERS_MAX;
use polyptych_scene::{NodeId, SceneSubset};
use polyptych_wall::view::View;

use crate::Cluster;

impl Cluster {
    /// Checks that the open scene, as it was edited, has what a view shows of it.
    ///
    /// # Errors
    /// Says which node or layer is missing, that there are too many layers, or that no scene is
    /// open.
    pub(crate) fn check_subset(&self, view: &View) -> Result<(), String> {
        let (root, layers) = (view.root.map(NodeId), view.layers.clone());
        if root.is_none() && layers.is_none() {
            return Ok(());
        }
        if layers.as_ref().is_some_and(|layers| layers.len() > LAYERS_MAX) {
            return Err(format!("a view names at most {LAYERS_MAX} layers"));
        }
        let outline = self.editing.outline.as_ref();
        let outline = outline.ok_or("no scene is open, so there are no nodes and no layers")?;
        let subset = SceneSubset { root, layers };
        let checked = outline.check_subset(&self.editing.accepted, &subset);
        checked.map_err(|error| error.to_string())
    }
}
