//! Windows of a wall that is new to this server.

use super::RenderThread;
use crate::loader::LoadedState;

impl RenderThread {
    /// Places the windows of this server among those of the whole wall, before its first frame:
    /// until then they would lie on each other.
    pub(super) fn arrange_windows(&mut self, state: &LoadedState) {
        let Some(wall) = state.replica.wall.as_deref() else { return };
        for output in &mut self.outputs {
            if let Some((id, _)) = wall.channel_by_name(&output.name) {
                output.place_window(wall, id);
            }
        }
    }
}
