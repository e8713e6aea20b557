//! Trackers, wands and pads: for bridges between them and the wall.

use polyptych_protocol::device_status::DeviceStatus;
use polyptych_protocol::navigation::Flight;
use polyptych_protocol::request::Request;

use crate::client::Client;
use crate::error::ClientError;

impl Client {
    /// Moves the camera as wands and pads fly it, from the next frame on: relative to where it is
    /// by then, so that several clients may.
    ///
    /// # Errors
    /// [`ClientError`]; a move that leads too far, or is not finite.
    pub async fn fly(&self, flight: Flight) -> Result<(), ClientError> {
        self.done("fly the camera", Request::Fly(flight)).await
    }

    /// Reports the state of the devices of the wall file that this client reads. The wall's status
    /// names them; they are lost once this client ends.
    ///
    /// # Errors
    /// [`ClientError`]; a device that the wall file does not have, or that another client reads.
    pub async fn report_devices(&self, report: Vec<DeviceStatus>) -> Result<(), ClientError> {
        self.done("report the devices", Request::ReportDevices(report)).await
    }
}
