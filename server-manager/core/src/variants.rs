//! The variants of the open scene, as clients see them.

use polyptych_protocol::variant::VariantList;
use polyptych_scene::find_variant;

use super::Cluster;

impl Cluster {
    /// The variants that can be chosen, and the one that was, shown or not yet.
    ///
    /// # Errors
    /// No scene is open.
    pub(super) fn variants(&self) -> Result<VariantList, String> {
        let outline = self.editing.outline().ok_or("no scene is open; open one first")?;
        let names = outline.variants().to_vec();
        let chosen = self.editing.accepted().variant();
        let chosen = chosen.and_then(|of| find_variant(&names, of).ok()).map(|at| at as u32);
        Ok(VariantList { names, chosen })
    }
}
