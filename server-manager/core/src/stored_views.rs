//! Places of the camera under names.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::stored_view::{StoredView, name_fault};
use polyptych_wall::limits::STORED_VIEWS_MAX;

use super::Cluster;
use super::presentation::checked_camera;

impl Cluster {
    /// Stores, removes or lists places of the camera.
    ///
    /// # Errors
    /// The fault, and what would be right.
    pub(super) fn stored_view(&mut self, request: Request) -> Result<Response, String> {
        match request {
            Request::StoreView { name, camera } => {
                let camera = checked_camera(camera.unwrap_or(self.presentation.camera))?;
                self.store_view(StoredView { name, camera })?;
            }
            Request::RemoveView { name } => {
                let Ok(at) = self.find_view(&name) else { return Err(self.unknown_view(&name)) };
                self.stored_views.remove(at);
            }
            _ => return Ok(Response::StoredViews(self.stored_views.clone())),
        }
        Ok(Response::Done)
    }

    fn store_view(&mut self, view: StoredView) -> Result<(), String> {
        if let Some(fault) = name_fault(&view.name) {
            return Err(fault);
        }
        match self.find_view(&view.name) {
            Ok(at) => self.stored_views[at] = view,
            Err(_) if self.stored_views.len() >= STORED_VIEWS_MAX => {
                return Err(format!(
                    "{STORED_VIEWS_MAX} views are stored already, which is the maximum; remove one"
                ));
            }
            Err(at) => self.stored_views.insert(at, view),
        }
        Ok(())
    }

    /// The index of a view, or where it would stand.
    fn find_view(&self, name: &str) -> Result<usize, usize> {
        self.stored_views.binary_search_by(|view| view.name.as_str().cmp(name))
    }

    fn unknown_view(&self, name: &str) -> String {
        if let Some(fault) = name_fault(name) {
            return fault;
        }
        let names: Vec<&str> = self.stored_views.iter().map(|view| view.name.as_str()).collect();
        match names[..] {
            [] => format!("there is no stored view {name}; none is stored"),
            _ => format!("there is no stored view {name}; there are {}", names.join(", ")),
        }
    }

    /// Takes over the views of another life of the manager, looked at as those of a client are.
    pub(super) fn restore_stored_views(&mut self, views: &[StoredView]) {
        for view in views {
            let camera = checked_camera(view.camera);
            let stored =
                camera.and_then(|camera| self.store_view(StoredView { camera, ..view.clone() }));
            if let Err(reason) = stored {
                tracing::warn!(reason, "a stored view in the state file was dropped");
            }
        }
    }
}
