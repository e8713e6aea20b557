//! The camera, the viewer's head, and the views that lie over the wall's own picture.

use polyptych_protocol::head_update::HeadUpdate;
use polyptych_wall::Wall;
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::view::View;

use super::Cluster;

impl Cluster {
    pub(super) fn set_head(&mut self, update: HeadUpdate) -> Result<(), String> {
        let head = update.apply(&self.presentation.head);
        self.walls().try_for_each(|wall| wall.check_head(&head)).map_err(|e| e.to_string())?;
        self.presentation.head = HeadPose { rotation: head.rotation.normalize(), ..head };
        Ok(())
    }

    /// Lays views over the wall that a client asks for.
    pub(super) fn request_views(&mut self, views: Vec<View>) -> Result<(), String> {
        for (number, view) in views.iter().enumerate() {
            self.check_subset(view).map_err(|error| format!("view {number}: {error}"))?;
        }
        self.set_views(views)
    }

    /// Forgets nodes and layers of the scene that was shown before: views show all of the next.
    pub(super) fn end_subsets(&mut self) {
        for view in &mut self.presentation.views {
            (view.root, view.layers) = (None, None);
        }
    }

    /// Lays views over the wall, whatever the scene has of what they choose.
    pub(super) fn set_views(&mut self, views: Vec<View>) -> Result<(), String> {
        let mut all = vec![View::of_wall(Camera::IDENTITY)];
        all.extend(views.into_iter().map(|view| View { camera: normal(view.camera), ..view }));
        self.walls().try_for_each(|wall| wall.check_views(&all)).map_err(|e| e.to_string())?;
        all.remove(0);
        self.presentation.views = all;
        Ok(())
    }

    /// The wall that frames show, and those that tunings on their way lead to: who sets a view
    /// meanwhile is to see it on these too.
    fn walls(&self) -> impl Iterator<Item = &Wall> {
        std::iter::once(&self.wall).chain(self.changes.pending_walls())
    }

    /// Checks that the present head and views can be shown on this wall too.
    ///
    /// # Errors
    /// Says whether the head or a view cannot be shown, why, and what to do.
    pub(super) fn check_presentation(&self, wall: &Wall) -> Result<(), String> {
        wall.check_head(&self.presentation.head)
            .map_err(|error| format!("the head as it stands: {error}; move it first"))?;
        wall.check_views(&self.presentation.all_views())
            .map_err(|error| format!("the views as they lie: {error}; take them away first"))
    }
}

pub(super) fn checked_camera(camera: Camera) -> Result<Camera, String> {
    match camera.fault() {
        Some(fault) => Err(fault),
        None => Ok(normal(camera)),
    }
}

/// Numbers of others are units only nearly.
fn normal(camera: Camera) -> Camera {
    let length = camera.rotation.length();
    if length > 0.0 && length.is_finite() {
        Camera { rotation: camera.rotation.normalize(), ..camera }
    } else {
        camera
    }
}
