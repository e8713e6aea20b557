//! Events of Linux joysticks: `struct js_event` of the kernel's `linux/joystick.h`, 8 bytes each,
//! in the byte order of the machine.

/// Size of an event in bytes.
pub const EVENT_BYTES: usize = 8;

/// Bit of events that state the value at the time of opening.
const INITIAL: u8 = 0x80;

/// Value of an axis at its end.
const AXIS_MAX: f64 = 32_767.0;

/// A value that has changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JoystickEvent {
    /// An axis, from −1 to 1.
    Axis(u8, f64),
    /// A button, 1 while it is pressed.
    Button(u8, f64),
}

/// Returns the event in these bytes; `None` for kinds that the kernel's header does not have.
pub fn event(bytes: [u8; EVENT_BYTES]) -> Option<JoystickEvent> {
    let [_, _, _, _, low, high, kind, number] = bytes;
    let value = i16::from_ne_bytes([low, high]);
    match kind & !INITIAL {
        1 => Some(JoystickEvent::Button(number, f64::from(u8::from(value != 0)))),
        2 => Some(JoystickEvent::Axis(number, (f64::from(value) / AXIS_MAX).max(-1.0))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_read_as_the_kernel_writes_them() {
        let bytes = |value: i16, kind: u8, number: u8| {
            let [low, high] = value.to_ne_bytes();
            [1, 2, 3, 4, low, high, kind, number]
        };
        assert_eq!(event(bytes(32_767, 2, 1)), Some(JoystickEvent::Axis(1, 1.0)));
        assert_eq!(event(bytes(-32_768, 0x82, 7)), Some(JoystickEvent::Axis(7, -1.0)));
        assert_eq!(event(bytes(1, 1, 3)), Some(JoystickEvent::Button(3, 1.0)));
        assert_eq!(event(bytes(0, 0x81, 3)), Some(JoystickEvent::Button(3, 0.0)));
        assert_eq!(event(bytes(0, 4, 3)), None);
    }
}
