//! Trackers, wands and pads as a wall file says them.

use polyptych_wall::device::{
    Device, DeviceSource, FlyControls, HeadInput, HeadTracking, RotationForm, SignedAxis,
    TrackerFrame,
};

use crate::control;
use crate::document::{
    DeviceKind, DeviceSection, FlySection, FormChoice, FrameSection, HeadSection, Row,
};
use crate::rotation::{degrees, written};

/// The section of a device.
pub fn section(device: &Device) -> DeviceSection {
    let place = |is_meant: bool| is_meant.then(|| device.source.place().to_owned());
    let kind = match device.source {
        DeviceSource::Osc { .. } => DeviceKind::Osc,
        DeviceSource::Vrpn { .. } => DeviceKind::Vrpn,
        DeviceSource::Joystick { .. } => DeviceKind::Joystick,
        DeviceSource::Spacenav { .. } => DeviceKind::Spacenav,
    };
    DeviceSection {
        name: device.name.clone(),
        kind,
        listen: place(kind == DeviceKind::Osc),
        server: place(kind == DeviceKind::Vrpn),
        path: place(matches!(kind, DeviceKind::Joystick | DeviceKind::Spacenav)),
        lost_ms: device.lost_ms,
        frame: frame(&device.frame),
        head: device.head.as_ref().map(head),
        fly: device.fly.as_ref().map(fly),
    }
}

fn frame(frame: &TrackerFrame) -> FrameSection {
    let axis = |axis: SignedAxis| {
        let sign = if axis.is_negative { "-" } else { "" };
        format!("{sign}{}", letter(axis.index))
    };
    FrameSection {
        axes: frame.axes.map(axis),
        unit: frame.unit_m,
        origin: frame.origin.to_array(),
        rotation: written(frame.rotation),
    }
}

fn letter(axis: u8) -> char {
    ['x', 'y', 'z'][usize::from(axis.min(2))]
}

fn head(head: &HeadTracking) -> HeadSection {
    let section = HeadSection {
        pose: None,
        position: None,
        rotation: None,
        form: None,
        order: None,
        tracker: None,
        sensor: None,
        mount: written(head.mount),
        eyes: head.eyes.to_array(),
        prediction_ms: head.prediction_ms,
        speed_max: head.speed_max,
        jump: head.jump_m,
        hold_ms: head.hold_ms,
        ease_ms: head.ease_ms,
        bounds: head.bounds.map(|corners| corners.map(|corner| Row(corner.to_array()))),
    };
    match &head.input {
        HeadInput::Vrpn { tracker, sensor } => {
            HeadSection { tracker: Some(tracker.clone()), sensor: Some(*sensor), ..section }
        }
        HeadInput::Osc { position, rotation, form } => {
            let is_pose = form.is_some() && rotation.is_none();
            let order = match form {
                Some(RotationForm::Euler { order, .. }) => {
                    Some(order.0.map(letter).into_iter().collect())
                }
                _ => None,
            };
            HeadSection {
                pose: is_pose.then(|| position.clone()),
                position: (!is_pose).then(|| position.clone()),
                rotation: rotation.clone(),
                form: form.map(choice),
                order,
                ..section
            }
        }
    }
}

fn choice(form: RotationForm) -> FormChoice {
    match form {
        RotationForm::Quaternion => FormChoice::Quaternion,
        RotationForm::QuaternionWxyz => FormChoice::QuaternionWxyz,
        RotationForm::Matrix => FormChoice::Matrix,
        RotationForm::Euler { is_degrees: true, .. } => FormChoice::EulerDegrees,
        RotationForm::Euler { is_degrees: false, .. } => FormChoice::EulerRadians,
    }
}

fn fly(fly: &FlyControls) -> FlySection {
    let [right, up, forward, turn, pitch] = fly.controls().map(|of| of.map(control::written));
    FlySection {
        right,
        up,
        forward,
        turn,
        pitch,
        speed: fly.speed,
        turn_speed: degrees(fly.turn_speed),
        dead_zone: fly.dead_zone,
    }
}
