//! Sticks and buttons that fly the camera.

use glam::{DVec2, DVec3};
use polyptych_protocol::navigation::Flight;
use polyptych_wall::device::FlyControls;

use crate::{Micros, seconds};

/// Period of flights that are sent: that of most displays.
pub const FLIGHT_PERIOD: Micros = 16_667;

/// Maximum time that one flight stands for: a bridge that was stopped does not leap.
const STEP_MAX: Micros = 100_000;

/// The controls of a device and their values.
#[derive(Clone, Debug)]
pub(crate) struct FlightControls {
    controls: FlyControls,
    /// Values from −1 to 1, in the order of [`FlyControls::controls`].
    values: [f64; 5],
    /// The time of the last flight; `None` before the first one of a push.
    last: Option<Micros>,
}

impl FlightControls {
    pub fn new(controls: FlyControls) -> Self {
        Self { controls, values: [0.0; 5], last: None }
    }

    /// Returns the controls as the wall file has them.
    pub fn controls(&self) -> &FlyControls {
        &self.controls
    }

    /// Sets the value that a control has from `now` on, by its place.
    pub fn set(&mut self, now: Micros, place: usize, value: f64) {
        let Some(control) = self.controls.controls()[place] else { return };
        let is_negative = control.is_negative;
        // The time without a held control is no part of the next flight.
        if self.due().is_none() {
            self.last = self.last.filter(|last| now.saturating_sub(*last) < FLIGHT_PERIOD);
        }
        let value = if value.is_finite() { value.clamp(-1.0, 1.0) } else { 0.0 };
        self.values[place] = if is_negative { -value } else { value };
    }

    /// Sets all values to 0: the device is lost.
    pub fn release(&mut self) {
        self.values = [0.0; 5];
    }

    /// Returns the time of the next flight; `None` if no control is held.
    pub fn due(&self) -> Option<Micros> {
        let is_held = (0..5).any(|place| self.deflection(place) != 0.0);
        is_held.then(|| self.last.map_or(0, |last| last + FLIGHT_PERIOD))
    }

    /// Returns the value beyond the dead zone, scaled to −1 to 1.
    fn deflection(&self, place: usize) -> f64 {
        let (value, dead) = (self.values[place], self.controls.dead_zone);
        value.signum() * ((value.abs() - dead).max(0.0) / (1.0 - dead))
    }

    /// Returns the flight since the last one; `None` if nothing is held. The axes are those of the
    /// display space: the viewer flies to where the head stands, not where it looks.
    pub fn take(&mut self, now: Micros) -> Option<Flight> {
        if self.due().is_none() {
            self.last = None;
            return None;
        }
        let since = self.last.map_or(FLIGHT_PERIOD, |last| now.saturating_sub(last));
        self.last = Some(now);
        let step_s = seconds(since.min(STEP_MAX));
        let [right, up, forward, turn, pitch] = [0, 1, 2, 3, 4].map(|of| self.deflection(of));
        let offset = DVec3::new(right, up, -forward);
        Some(Flight {
            offset_m: offset * (self.controls.speed * step_s),
            turn_rad: DVec2::new(turn, pitch) * (self.controls.turn_speed * step_s),
        })
    }
}

#[cfg(test)]
mod tests {
    use polyptych_wall::device::{Control, ControlInput};

    use super::*;

    #[test]
    fn a_stick_flies_at_its_speed_beyond_the_dead_zone_and_stops() {
        let axis = |of, is_negative| Some(Control { input: ControlInput::Axis(of), is_negative });
        let mut flight = FlightControls::new(FlyControls {
            right: axis(0, false),
            up: None,
            forward: axis(1, true),
            turn: axis(2, false),
            pitch: None,
            speed: 2.0,
            turn_speed: 1.0,
            dead_zone: 0.2,
        });
        assert_eq!((flight.due(), flight.take(0)), (None, None));
        flight.set(0, 0, 0.2);
        flight.set(0, 1, 1.0);
        assert_eq!(flight.due(), None, "a stick in its dead zone, and a control that is not there");
        // Pushed forwards, the axis of a stick is negative.
        flight.set(0, 2, -7.0);
        flight.take(1_000_000);
        assert_eq!(flight.due(), Some(1_000_000 + FLIGHT_PERIOD));
        let offset = flight.take(1_050_000).expect("held").offset_m;
        assert!(offset.abs_diff_eq(DVec3::NEG_Z * 0.1, 1e-9), "{offset}");
        flight.set(1_050_000, 2, 0.0);
        flight.set(1_050_000, 3, 0.6);
        let turn = flight.take(1_100_000).expect("held").turn_rad;
        assert!(turn.abs_diff_eq(DVec2::new(0.5 * 0.05, 0.0), 1e-9), "{turn}");
        let long = flight.take(9_000_000).expect("held").turn_rad;
        assert!(long.abs_diff_eq(DVec2::new(0.05, 0.0), 1e-9), "{long}");
        flight.set(9_000_000, 3, f64::NAN);
        assert_eq!(flight.take(9_100_000), None);
        flight.set(9_200_000, 3, 0.6);
        assert!(flight.take(9_200_000).is_some());
        flight.set(9_210_000, 3, 0.0);
        flight.set(20_000_000, 3, 0.6);
        let first = flight.take(20_000_000).expect("held").turn_rad.x;
        assert!((first - 0.5 * seconds(FLIGHT_PERIOD)).abs() < 1e-9, "no leap at first: {first}");
    }
}
