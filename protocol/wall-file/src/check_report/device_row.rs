//! Trackers, wands and pads in a check report.

use std::fmt;

use glam::DVec3;
use polyptych_wall::Wall;
use polyptych_wall::device::{Device, HeadInput, RotationForm};
use polyptych_wall::head::HeadPose;
use serde::Serialize;

use crate::control;

/// Metres in a unit of trackers that are sold: millimetres to feet, and metres.
const UNIT_RANGE_M: (f64, f64) = (0.0009, 1.1);

/// Maximum plausible distance between a sensor and the eyes, in metres: a helmet.
const EYES_MAX_M: f64 = 0.4;

/// Maximum plausible prediction in milliseconds: beyond it overshooting is seen.
const PREDICTION_MS_MAX: u32 = 60;

/// Maximum plausible distance between a tracker's origin and the eye, in metres.
const ORIGIN_DISTANCE_MAX_M: f64 = 50.0;

/// A device in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeviceRow {
    /// The device's name.
    pub name: String,
    /// `osc`, `vrpn`, `joystick` or `spacenav`.
    pub kind: &'static str,
    /// The address or the path of its readings.
    pub place: String,
    /// The readings of the head, if it tracks that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head: Option<String>,
    /// The time that poses of the head are predicted ahead, in milliseconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prediction_ms: Option<u32>,
    /// Its controls of flights, if it has any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fly: Option<String>,
}

impl DeviceRow {
    /// The words for a device.
    pub fn new(device: &Device) -> Self {
        let names = ["right", "up", "forward", "turn", "pitch"];
        let fly = device.fly.as_ref().map(|fly| {
            let named = names.into_iter().zip(fly.controls());
            let words =
                named.filter_map(|(name, of)| Some(format!("{name} {}", control::written(of?))));
            words.collect::<Vec<_>>().join(", ")
        });
        Self {
            name: device.name.clone(),
            kind: device.source.kind(),
            place: device.source.place().to_owned(),
            head: device.head.as_ref().map(|head| input(&head.input)),
            prediction_ms: device.head.as_ref().map(|head| head.prediction_ms),
            fly,
        }
    }
}

impl fmt::Display for DeviceRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "device {}: {} {}", self.name, self.kind, self.place)?;
        if let Some(head) = &self.head {
            write!(f, ", head by {head}")?;
            if let Some(ahead_ms) = self.prediction_ms.filter(|ms| *ms > 0) {
                write!(f, ", predicted {ahead_ms} ms ahead")?;
            }
        }
        match &self.fly {
            Some(fly) => write!(f, ", flies by {fly}"),
            None => Ok(()),
        }
    }
}

fn input(input: &HeadInput) -> String {
    match input {
        HeadInput::Vrpn { tracker, sensor } => format!("sensor {sensor} of {tracker}"),
        HeadInput::Osc { position, rotation, form } => {
            let form = match form {
                None => " without rotation",
                Some(RotationForm::Quaternion | RotationForm::QuaternionWxyz) => " with quaternion",
                Some(RotationForm::Matrix) => " with matrix",
                Some(RotationForm::Euler { .. }) => " with angles",
            };
            let rotation = rotation.as_ref().map(|of| format!(" and {of}")).unwrap_or_default();
            format!("{position}{rotation}{form}")
        }
    }
}

/// Numbers of devices that a wall file may have, but no room.
pub(super) fn warnings(wall: &Wall) -> Vec<String> {
    wall.devices.iter().flat_map(|device| of_device(wall, device)).collect()
}

fn of_device(wall: &Wall, device: &Device) -> Vec<String> {
    let mut warnings = Vec::new();
    let name = &device.name;
    let Some(head) = &device.head else { return warnings };
    let (low, high) = UNIT_RANGE_M;
    let unit_m = device.frame.unit_m;
    if !(low..=high).contains(&unit_m) {
        warnings.push(format!(
            "device {name}: a unit of its tracker is {unit_m} m, where {low} to {high} are \
             plausible; check frame.unit, 0.001 is millimetres"
        ));
    }
    let apart = device.frame.origin.distance(wall.eye);
    if apart > ORIGIN_DISTANCE_MAX_M {
        warnings.push(format!(
            "device {name}: its tracker's origin is {apart:.0} m from the eye, where up to \
             {ORIGIN_DISTANCE_MAX_M:.0} m are plausible; check frame.origin, metres are meant"
        ));
    }
    let offset = head.eyes.length();
    if offset > EYES_MAX_M {
        warnings.push(format!(
            "device {name}: the eyes are {offset:.2} m from the sensor, where up to {EYES_MAX_M} \
             m are plausible; check head.eyes, metres are meant"
        ));
    }
    if head.prediction_ms > PREDICTION_MS_MAX {
        warnings.push(format!(
            "device {name}: poses are predicted {} ms ahead, so that heads overshoot; up to \
             {PREDICTION_MS_MAX} are plausible",
            head.prediction_ms
        ));
    }
    if let Some(bounds) = head.bounds {
        warnings.extend(of_bounds(wall, name, bounds));
    }
    warnings
}

/// A head that the bounds let behind a screen, and a wall's own eye that they do not hold.
fn of_bounds(wall: &Wall, name: &str, [low, high]: [DVec3; 2]) -> Vec<String> {
    let mut warnings = Vec::new();
    if wall.eye.clamp(low, high) != wall.eye {
        warnings.push(format!(
            "device {name}: wall.eye {} is outside of head.bounds {low} to {high}, where the head \
             goes when the device is lost; make them larger, or move the eye",
            wall.eye
        ));
    }
    let corner = |index: usize| {
        let side = |axis: usize| if index >> axis & 1 == 0 { low[axis] } else { high[axis] };
        DVec3::new(side(0), side(1), side(2))
    };
    let refused = (0..8).map(corner).find_map(|corner| {
        let head = HeadPose { position: corner, ..wall.head() };
        Some((corner, wall.check_head(&head).err()?))
    });
    if let Some((corner, error)) = refused {
        warnings.push(format!(
            "device {name}: a head at the corner {corner} of head.bounds is refused: {error}; \
             make the bounds smaller"
        ));
    }
    warnings
}
