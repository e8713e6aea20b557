//! Events of 3D mice from spacenavd, their driver on Linux: eight `i32` each, in the byte order of
//! the machine, over its UNIX socket.
//!
//! The format is that of protocol 0 in spacenavd's `proto_unix.c`, which every version speaks to a
//! client that asks for no other. A motion has the cap's deflection to the right, up and forwards
//! and its turns about these axes. A mouse that is unplugged is a motion of zeros.

use crate::joystick::JoystickEvent;

/// Size of an event in bytes.
pub const EVENT_BYTES: usize = 32;

/// Value of an axis at its end, in the HID descriptions of 3Dconnexion's mice.
const AXIS_MAX: f64 = 350.0;

/// Returns the changes in these bytes: six axes of a motion, from −1 to 1, or a button. Kinds of
/// later versions have none.
pub fn events(bytes: [u8; EVENT_BYTES]) -> Vec<JoystickEvent> {
    let number = |at: usize| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|of| bytes[at * 4 + of]);
        i32::from_ne_bytes([a, b, c, d])
    };
    let button = |value| {
        u8::try_from(number(1)).map(|of| JoystickEvent::Button(of, value)).into_iter().collect()
    };
    let axis = |of: u8| {
        let value = f64::from(number(usize::from(of) + 1)) / AXIS_MAX;
        JoystickEvent::Axis(of, value.clamp(-1.0, 1.0))
    };
    match number(0) {
        0 => (0..6).map(axis).collect(),
        1 => button(1.0),
        2 => button(0.0),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(numbers: [i32; 8]) -> [u8; EVENT_BYTES] {
        let mut bytes = [0; EVENT_BYTES];
        for (at, number) in numbers.into_iter().enumerate() {
            bytes[at * 4..at * 4 + 4].copy_from_slice(&number.to_ne_bytes());
        }
        bytes
    }

    #[test]
    fn events_are_read_as_spacenavd_writes_them() {
        let motion = events(bytes([0, 350, -175, i32::MAX, 0, i32::MIN, 35, 16]));
        let values = [1.0, -0.5, 1.0, 0.0, -1.0, 0.1];
        let expected = (0..).zip(values).map(|(of, value)| JoystickEvent::Axis(of, value));
        assert_eq!(motion, expected.collect::<Vec<_>>());
        assert_eq!(events(bytes([1, 3, 9, 9, 9, 9, 9, 9])), [JoystickEvent::Button(3, 1.0)]);
        assert_eq!(events(bytes([2, 255, 0, 0, 0, 0, 0, 0])), [JoystickEvent::Button(255, 0.0)]);
        for odd in [[1, 256, 0, 0, 0, 0, 0, 0], [2, -1, 0, 0, 0, 0, 0, 0], [3; 8], [-1; 8]] {
            assert_eq!(events(bytes(odd)), [], "{odd:?}");
        }
    }
}
