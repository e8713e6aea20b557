//! Controls of devices as the wall file writes them: `-/wand/stick[1]`, `axis0`, `button3`.

use polyptych_wall::device::{Control, ControlInput};

use super::device::is_osc_address;
use super::document::DeviceKind;

/// Maximum number of an OSC message's argument.
const ARGUMENT_MAX: u16 = 63;

/// Returns the control that a text names; the error is the fault and the remedy.
pub(super) fn control(kind: DeviceKind, text: &str) -> Result<Control, (String, String)> {
    let (is_negative, name) = match text.strip_prefix('-') {
        Some(name) => (true, name),
        None => (false, text),
    };
    let input = match kind {
        DeviceKind::Osc => osc(name),
        // The kernel's ABS_CNT.
        DeviceKind::Joystick => axis_or_button(name, 64),
        DeviceKind::Spacenav => axis_or_button(name, 6),
        DeviceKind::Vrpn => {
            let what = "trackers of VRPN have no controls".to_owned();
            return Err((what, "use a device of another kind".to_owned()));
        }
    };
    input.map(|input| Control { input, is_negative }).ok_or_else(|| {
        let remedy = match kind {
            DeviceKind::Joystick => "write \"axis0\" to \"axis63\" or \"button0\" to \"button255\"",
            DeviceKind::Spacenav => "write \"axis0\" to \"axis5\" or \"button0\" to \"button255\"",
            _ => "write an OSC address, with \"[1]\" behind it for the second argument",
        };
        let found: String = text.chars().take(80).collect();
        (format!("{found:?} is no control"), remedy.to_owned())
    })
}

fn osc(name: &str) -> Option<ControlInput> {
    let (address, argument) = match name.strip_suffix(']').and_then(|rest| rest.split_once('[')) {
        Some((address, number)) => (address, whole(number).filter(|n| *n <= ARGUMENT_MAX)?),
        None => (name, 0),
    };
    is_osc_address(address).then(|| ControlInput::Osc { address: address.to_owned(), argument })
}

fn axis_or_button(name: &str, axes: u16) -> Option<ControlInput> {
    if let Some(number) = name.strip_prefix("axis") {
        return whole(number).filter(|n| *n < axes).map(|n| ControlInput::Axis(n as u8));
    }
    let number = whole(name.strip_prefix("button")?)?;
    u8::try_from(number).ok().map(ControlInput::Button)
}

/// A number of digits only.
fn whole(text: &str) -> Option<u16> {
    text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?
}

/// The text of a control.
pub(super) fn written(control: &Control) -> String {
    let sign = if control.is_negative { "-" } else { "" };
    match &control.input {
        ControlInput::Osc { address, argument: 0 } => format!("{sign}{address}"),
        ControlInput::Osc { address, argument } => format!("{sign}{address}[{argument}]"),
        ControlInput::Axis(number) => format!("{sign}axis{number}"),
        ControlInput::Button(number) => format!("{sign}button{number}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_are_written_as_they_are_read_and_others_are_refused() {
        let of = |kind, texts: &[&str]| {
            for text in texts {
                let read = control(kind, text).unwrap_or_else(|(what, _)| panic!("{what}"));
                assert_eq!(written(&read), *text);
            }
        };
        of(DeviceKind::Osc, &["/wand/x", "-/wand/stick[1]"]);
        of(DeviceKind::Joystick, &["axis0", "-axis3", "button11"]);
        of(DeviceKind::Spacenav, &["axis5", "-axis4", "button255"]);
        for (kind, text) in [
            (DeviceKind::Osc, "wand"),
            (DeviceKind::Osc, "/a[64]"),
            (DeviceKind::Osc, "/a[-1]"),
            (DeviceKind::Osc, "/a*"),
            (DeviceKind::Joystick, "axis64"),
            (DeviceKind::Joystick, "button256"),
            (DeviceKind::Joystick, "axis"),
            (DeviceKind::Joystick, "/a"),
            (DeviceKind::Spacenav, "axis6"),
            (DeviceKind::Spacenav, "rx"),
            (DeviceKind::Vrpn, "axis0"),
        ] {
            assert!(control(kind, text).is_err(), "{text}");
        }
    }
}
