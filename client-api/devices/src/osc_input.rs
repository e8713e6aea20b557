//! The readings in a device's OSC messages.

use glam::{DQuat, DVec3};
use polyptych_wall::device::{Control, ControlInput, Device, FlyControls, HeadInput, RotationForm};

use crate::osc::{self, OscMessage};
use crate::rotation_reading::{numbers_of, rotation};
use crate::sensor_pose::SensorPose;
use crate::{Micros, micros_from_ms};

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

/// The addresses that a device listens to, and the halves of a pose that came last.
#[derive(Clone, Debug)]
pub(crate) struct OscInput {
    head: Option<HeadInput>,
    fly: Option<FlyControls>,
    position: Half<DVec3>,
    rotation: Half<DQuat>,
    /// Maximum age of one half when the other one comes: then the tracker has lost it.
    age_max: Micros,
}

/// The last value of a half of a pose, with the time at which it came.
type Half<T> = Option<(T, Micros)>;

impl OscInput {
    pub fn new(device: &Device) -> Self {
        let head = device.head.as_ref().map(|head| head.input.clone());
        let age_max = micros_from_ms(device.lost_ms);
        Self { head, fly: device.fly.clone(), position: None, rotation: None, age_max }
    }

    /// Returns the readings of a packet; messages of other addresses are ignored.
    ///
    /// # Errors
    /// The fault of the packet, or of a message that is listened to. Nothing of the packet counts.
    pub fn read(&mut self, now: Micros, packet: &[u8]) -> Result<PacketReadings, String> {
        let messages = osc::parse(packet).map_err(|error| error.to_string())?;
        let mut readings = PacketReadings {
            time_tag: messages.iter().find_map(|message| message.time_tag),
            ..PacketReadings::default()
        };
        let mut next = self.clone();
        let mut is_new = false;
        for message in &messages {
            is_new |= next.read_pose(now, message)?;
            next.read_values(message, &mut readings.values)?;
        }
        if is_new {
            readings.pose = next.pose(now);
        }
        (self.position, self.rotation) = (next.position, next.rotation);
        Ok(readings)
    }

    /// Returns the pose of the last position and rotation; `None` while one of them is missing, or
    /// too old to be of one pose with the other.
    fn pose(&self, now: Micros) -> Option<SensorPose> {
        let Some(HeadInput::Osc { form, .. }) = &self.head else { return None };
        let is_fresh = |at: Micros| now.saturating_sub(at) < self.age_max;
        let rotation = self.rotation.filter(|(_, at)| is_fresh(*at)).map(|(rotation, _)| rotation);
        let is_whole = form.is_none() || rotation.is_some();
        let (position, _) = self.position.filter(|(_, at)| is_whole && is_fresh(*at))?;
        Some(SensorPose { position, rotation })
    }

    /// Reads a message that is a part of the pose. Returns whether it is.
    fn read_pose(&mut self, now: Micros, message: &OscMessage<'_>) -> Result<bool, String> {
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
                self.rotation = Some((turned(message, *form, &numbers)?, now));
            }
            Some(RotationForm::Matrix) if is_pose => {
                let n = numbers(message, MATRIX_NUMBERS)?;
                let rows = [n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]];
                self.rotation = Some((turned(message, RotationForm::Matrix, &rows)?, now));
                self.position = Some((DVec3::new(n[3], n[7], n[11]), now));
            }
            Some(form) if is_pose => {
                let numbers = numbers(message, 3 + numbers_of(*form))?;
                self.rotation = Some((turned(message, *form, &numbers[3..])?, now));
                self.position = Some((DVec3::from_slice(&numbers), now));
            }
            _ => self.position = Some((DVec3::from_slice(&numbers(message, 3)?), now)),
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
