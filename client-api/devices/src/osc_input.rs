//! The readings in a device's OSC messages.

use glam::{DQuat, DVec3};
use polyptych_wall::device::{Control, ControlInput, Device, FlyControls, HeadInput, RotationForm};

use crate::osc::{self, OscMessage};
use crate::rotation_reading::{numbers_of, rotation};
use crate::sensor_pose::SensorPose;

/// Numbers of a 4 × 4 matrix.
const MATRIX_NUMBERS: usize = 16;

/// The readings of one packet.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PacketReadings {
    /// The newest pose of the head's sensor.
    pub pose: Option<SensorPose>,
    /// Values of the controls that the packet has, by their place in [`FlyControls::controls`].
    pub values: Vec<(usize, f64)>,
    /// The first time tag.
    pub time_tag: Option<u64>,
}

/// The addresses that a device listens to, and the half of a pose that came last.
#[derive(Clone, Debug)]
pub(crate) struct OscInput {
    head: Option<HeadInput>,
    fly: Option<FlyControls>,
    position: Option<DVec3>,
    rotation: Option<DQuat>,
}

impl OscInput {
    pub fn new(device: &Device) -> Self {
        let head = device.head.as_ref().map(|head| head.input.clone());
        Self { head, fly: device.fly.clone(), position: None, rotation: None }
    }

    /// Returns the readings of a packet; messages of other addresses are ignored.
    ///
    /// # Errors
    /// The fault of the packet, or of a message that is listened to. Nothing of the packet counts.
    pub fn read(&mut self, packet: &[u8]) -> Result<PacketReadings, String> {
        let messages = osc::parse(packet).map_err(|error| error.to_string())?;
        let mut readings = PacketReadings {
            time_tag: messages.iter().find_map(|message| message.time_tag),
            ..PacketReadings::default()
        };
        let mut next = self.clone();
        let mut is_new = false;
        for message in &messages {
            is_new |= next.read_pose(message)?;
            next.read_values(message, &mut readings.values)?;
        }
        if is_new {
            readings.pose = next.pose();
        }
        (self.position, self.rotation) = (next.position, next.rotation);
        Ok(readings)
    }

    /// Returns the pose of the last position and rotation; `None` while one of them is missing.
    fn pose(&self) -> Option<SensorPose> {
        let Some(HeadInput::Osc { form, .. }) = &self.head else { return None };
        let is_whole = form.is_none() || self.rotation.is_some();
        let position = self.position.filter(|_| is_whole)?;
        Some(SensorPose { position, rotation: self.rotation })
    }

    /// Reads a message that is a part of the pose. Returns whether it is.
    fn read_pose(&mut self, message: &OscMessage<'_>) -> Result<bool, String> {
        let Some(HeadInput::Osc { position, rotation, form }) = self.head.as_ref() else {
            return Ok(false);
        };
        let is_rotation = rotation.as_deref() == Some(message.address);
        let is_position = *position == message.address;
        if !is_rotation && !is_position {
            return Ok(false);
        }
        let is_pose = is_position && rotation.is_none();
        match form {
            Some(form) if is_rotation => {
                let numbers = numbers(message, numbers_of(*form))?;
                self.rotation = Some(turned(message, *form, &numbers)?);
            }
            Some(RotationForm::Matrix) if is_pose => {
                let n = numbers(message, MATRIX_NUMBERS)?;
                let rows = [n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]];
                self.rotation = Some(turned(message, RotationForm::Matrix, &rows)?);
                self.position = Some(DVec3::new(n[3], n[7], n[11]));
            }
            Some(form) if is_pose => {
                let numbers = numbers(message, 3 + numbers_of(*form))?;
                self.rotation = Some(turned(message, *form, &numbers[3..])?);
                self.position = Some(DVec3::from_slice(&numbers));
            }
            _ => self.position = Some(DVec3::from_slice(&numbers(message, 3)?)),
        }
        Ok(true)
    }

    fn read_values(
        &self,
        message: &OscMessage<'_>,
        values: &mut Vec<(usize, f64)>,
    ) -> Result<(), String> {
        let Some(fly) = &self.fly else { return Ok(()) };
        for (place, control) in fly.controls().into_iter().enumerate() {
            let Some(Control { input: ControlInput::Osc { address, argument }, .. }) = control
            else {
                continue;
            };
            if *address != message.address {
                continue;
            }
            let found = message.arguments.get(usize::from(*argument));
            let Some(value) = found.and_then(osc::OscArgument::number) else {
                return Err(format!("argument {argument} of {address} is no finite number"));
            };
            values.push((place, value));
        }
        Ok(())
    }
}

/// Returns the numbers of a message, which must be `count` finite numbers.
fn numbers(message: &OscMessage<'_>, count: usize) -> Result<Vec<f64>, String> {
    let address = message.address;
    let found = message.arguments.len();
    if found != count {
        return Err(format!("{address} has {found} arguments, where {count} numbers belong"));
    }
    let numbers = message.arguments.iter().map(osc::OscArgument::number);
    let numbers: Option<Vec<f64>> = numbers.collect();
    numbers.ok_or_else(|| format!("an argument of {address} is no finite number"))
}

fn turned(message: &OscMessage<'_>, form: RotationForm, of: &[f64]) -> Result<DQuat, String> {
    rotation(form, of).ok_or_else(|| format!("the numbers of {} are no rotation", message.address))
}
