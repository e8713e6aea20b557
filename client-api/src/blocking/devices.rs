//! Trackers, wands and pads, waited for.

use polyptych_protocol::device_status::DeviceStatus;
use polyptych_protocol::navigation::Flight;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::fly`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn fly(&self, flight: Flight) -> Result<(), ClientError> {
        wait(self.inner.fly(flight))
    }

    /// Blocking version of [`crate::Client::report_devices`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn report_devices(&self, report: Vec<DeviceStatus>) -> Result<(), ClientError> {
        wait(self.inner.report_devices(report))
    }
}
