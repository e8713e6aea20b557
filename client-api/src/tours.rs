//! Places of the camera that the manager keeps, and tours through them.

use polyptych_protocol::follow::Follow;
use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::stored_view::StoredView;
use polyptych_protocol::tour_status::TourStatus;
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::Tour;

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Keeps a camera under a name, in the place of what had that name; `None` is the present one.
    /// The manager remembers it over a restart.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where name or camera cannot be, or too many are
    /// stored.
    pub async fn store_view(
        &self,
        name: impl Into<String>,
        camera: Option<Camera>,
    ) -> Result<(), ClientError> {
        self.done("store the view", Request::StoreView { name: name.into(), camera }).await
    }

    /// Forgets a stored view.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the views that there are.
    pub async fn remove_view(&self, name: impl Into<String>) -> Result<(), ClientError> {
        self.done("remove the view", Request::RemoveView { name: name.into() }).await
    }

    /// Returns the stored views, by name.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn stored_views(&self) -> Result<Vec<StoredView>, ClientError> {
        match self.request(Request::ListStoredViews).await? {
            Response::StoredViews(views) => Ok(views),
            other => Err(wrong_answer("list the stored views", &other)),
        }
    }

    /// Lets the camera move through stops, for every frame as a function of its scene time; all
    /// channels draw the same camera. The tour begins with the next frame that is asked for or
    /// paced. [`Client::set_camera`], a mouse over the wall and another scene end it; at its end
    /// the camera stays at the last stop. The manager goes on with it after a restart.
    ///
    /// A wall that is paused does not move by itself: let it run ([`Client::start_rendering`]),
    /// or ask for each frame, with times of your own ([`Client::capture_at`]) for a film.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the stop that cannot be.
    pub async fn play_tour(&self, tour: Tour) -> Result<(), ClientError> {
        self.done("play the tour", Request::PlayTour(tour)).await
    }

    /// Lets the camera follow a node of the open scene, for every frame as a function of where the
    /// node is in it: all channels draw the same camera, in the frame that moves the node. What
    /// ends a tour ends it, [`Client::stop_tour`] too, and so does the end of the node. The manager
    /// goes on with it after a restart.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if there is no such node, or a number is not
    /// finite.
    pub async fn follow_node(&self, follow: Follow) -> Result<(), ClientError> {
        self.done("follow the node", Request::FollowNode(follow)).await
    }

    /// Ends the tour, or the following of a node; the camera stays where it is.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn stop_tour(&self) -> Result<(), ClientError> {
        self.done("stop the tour", Request::StopTour).await
    }

    /// Returns how the tour stands, with the scene time and the pace that it follows.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn tour(&self) -> Result<TourStatus, ClientError> {
        match self.request(Request::DescribeTour).await? {
            Response::Tour(status) => Ok(*status),
            other => Err(wrong_answer("read how the tour stands", &other)),
        }
    }
}
