//! The settings of a wall that a film changes, and gives back.

use polyptych_client::blocking::Client;
use polyptych_client::{ClientError, Pacing, QualityBounds};

/// The settings of a wall before its film.
#[derive(Clone, Copy, Debug)]
pub(super) struct WallBefore {
    /// The wall's own pace; `None` if it is paused.
    pub pace: Option<Pacing>,
    /// The bounds of error and rate that were asked for.
    pub bounds: QualityBounds,
}

impl WallBefore {
    /// Makes the wall ready for a film. It has no pace of its own, since the frames of that would
    /// show other times between those of the film; and no rate bound, since a film is drawn as well
    /// as was asked for, however long that takes.
    ///
    /// # Errors
    /// The manager does not answer.
    pub fn suspend(&self, client: &Client) -> Result<(), ClientError> {
        if self.pace.is_some() {
            client.pause()?;
        }
        if self.bounds.rate_fps.is_some() {
            client.set_bounds(QualityBounds { rate_fps: None, ..self.bounds })?;
        }
        Ok(())
    }

    /// Gives the wall its rate bound and its pace back.
    ///
    /// # Errors
    /// The manager does not answer.
    pub fn restore(&self, client: &Client) -> Result<(), ClientError> {
        let is_bounded = self.bounds.rate_fps.is_some();
        let bounded =
            if is_bounded { ask_again(|| client.set_bounds(self.bounds)) } else { Ok(()) };
        let resumed = self.pace.map_or(Ok(()), |pace| ask_again(|| client.start_rendering(pace)));
        resumed.and(bounded)
    }
}

/// Asks once more if the manager is lost before it has answered: to be told twice changes nothing.
fn ask_again(ask: impl Fn() -> Result<(), ClientError>) -> Result<(), ClientError> {
    match ask() {
        Err(error) if error.is_outcome_unknown() => ask(),
        answered => answered,
    }
}
