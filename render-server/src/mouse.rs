//! The mouse over windows: dragging turns the scene, dragging with another button or with Shift
//! moves it, the wheel makes it larger or smaller. So do fingers, see [`touch`](super::touch).
//!
//! Movements are added up and taken once in [`PERIOD`], however often the window
//! system reports them.

use std::time::{Duration, Instant};

use glam::DVec2;
use polyptych_protocol::navigation::Navigation;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};

use crate::touch::{Fingers, Gesture};

/// Shortest time between two messages: as often as most displays show a frame.
const PERIOD: Duration = Duration::from_micros(16_667);

/// Radians by which a drag of one pixel turns the scene: half a turn for 500 pixels.
const ORBIT_RAD_PER_PIXEL: f64 = 0.0063;

/// The factor by which one click of the wheel enlarges the scene.
const ZOOM_PER_LINE: f64 = 1.15;

/// Pixels of a touchpad that count as one click.
const PIXELS_PER_LINE: f64 = 40.0;

/// Clicks that are added up at most, so that no wheel asks for more than a message may hold.
const LINES_MAX: f64 = 100.0;

/// The effect of a held button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    Orbit,
    Pan,
}

/// The mouse and the fingers over the windows of this server.
#[derive(Debug, Default)]
pub(crate) struct Mouse {
    /// Fingers alone count.
    is_fullscreen: bool,
    fingers: Fingers,
    held: Option<(MouseButton, Drag)>,
    position: Option<DVec2>,
    has_shift: bool,
    pending: Option<Navigation>,
    sent: Option<Instant>,
}

impl Mouse {
    /// In full screen nobody sits before the wall with its mouse, but somebody may touch it.
    pub fn new(is_fullscreen: bool) -> Self {
        Self { is_fullscreen, ..Self::default() }
    }

    /// Adds what the mouse or a finger does over the window of a channel, `size` being the window's
    /// in pixels.
    pub fn handle(&mut self, channel: &str, size: PhysicalSize<u32>, event: &WindowEvent) {
        let pixels = DVec2::new(f64::from(size.width), f64::from(size.height)).max(DVec2::ONE);
        match event {
            WindowEvent::Touch(touch) => match self.fingers.handle(channel, touch) {
                Some(Gesture::One(by)) => self.drag(channel, Drag::Orbit, by, pixels),
                Some(Gesture::Several { by, zoom }) => {
                    self.drag(channel, Drag::Pan, by, pixels);
                    self.zoom(channel, zoom);
                }
                None => {}
            },
            WindowEvent::Focused(false) => {
                self.held = None;
                self.fingers.forget(channel);
            }
            _ if self.is_fullscreen => {}
            WindowEvent::ModifiersChanged(keys) => self.has_shift = keys.state().shift_key(),
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } => {
                self.press(*button);
            }
            WindowEvent::MouseInput { state: ElementState::Released, button, .. } => {
                self.held = self.held.filter(|(held, _)| held != button);
            }
            WindowEvent::CursorMoved { position, .. } => {
                let now = DVec2::new(position.x, position.y);
                let before = self.position.replace(now);
                if let (Some((_, drag)), Some(before)) = (self.held, before) {
                    self.drag(channel, drag, now - before, pixels);
                }
            }
            // Positions in another window are measured from another corner.
            WindowEvent::CursorEntered { .. } if self.held.is_none() => self.position = None,
            WindowEvent::MouseWheel { delta, .. } => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / PIXELS_PER_LINE,
                };
                self.zoom(channel, ZOOM_PER_LINE.powf(lines.clamp(-LINES_MAX, LINES_MAX)));
            }
            _ => {}
        }
    }

    fn press(&mut self, button: MouseButton) {
        let drag = match button {
            MouseButton::Left if self.has_shift => Drag::Pan,
            MouseButton::Left => Drag::Orbit,
            MouseButton::Right | MouseButton::Middle => Drag::Pan,
            _ => return,
        };
        self.held = Some((button, drag));
    }

    fn drag(&mut self, channel: &str, drag: Drag, by: DVec2, size: DVec2) {
        let pending = self.pending(channel);
        match drag {
            Drag::Orbit => pending.orbit_rad += by * ORBIT_RAD_PER_PIXEL,
            Drag::Pan => pending.pan += by / size,
        }
    }

    fn zoom(&mut self, channel: &str, by: f64) {
        let limit = ZOOM_PER_LINE.powf(LINES_MAX);
        let pending = self.pending(channel);
        pending.zoom = (pending.zoom * by).clamp(1.0 / limit, limit);
    }

    /// Returns the movements that are not sent yet. A drag goes on in the channel where it began.
    fn pending(&mut self, channel: &str) -> &mut Navigation {
        self.pending.get_or_insert_with(|| Navigation::none(channel))
    }

    /// Takes the message that is due at `now`; `None` if none is.
    pub fn take(&mut self, now: Instant) -> Option<Navigation> {
        if self.pending.is_none() || self.sent.is_some_and(|sent| sent + PERIOD > now) {
            return None;
        }
        self.sent = Some(now);
        self.pending.take().filter(Navigation::is_sound)
    }

    /// Returns the time at which the next message is due, after [`Self::take`] was called at `now`;
    /// `None` if there is none.
    pub fn next(&self, now: Instant) -> Option<Instant> {
        self.pending.as_ref()?;
        let due = self.sent.map(|sent| sent + PERIOD).filter(|due| *due > now);
        Some(due.unwrap_or(now + PERIOD))
    }
}

#[cfg(test)]
mod tests {
    use winit::dpi::PhysicalPosition;
    use winit::event::{DeviceId, Touch, TouchPhase};

    use super::*;

    const SIZE: PhysicalSize<u32> = PhysicalSize::new(200, 100);

    fn moved(mouse: &mut Mouse, x: f64, y: f64) {
        let (device_id, position) = (DeviceId::dummy(), PhysicalPosition::new(x, y));
        mouse.handle("a", SIZE, &WindowEvent::CursorMoved { device_id, position });
    }

    fn button(mouse: &mut Mouse, button: MouseButton, state: ElementState) {
        let device_id = DeviceId::dummy();
        mouse.handle("a", SIZE, &WindowEvent::MouseInput { device_id, state, button });
    }

    fn wheel(mouse: &mut Mouse, lines: f32) {
        let delta = MouseScrollDelta::LineDelta(0.0, lines);
        let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
        mouse.handle("a", SIZE, &WindowEvent::MouseWheel { device_id, delta, phase });
    }

    #[test]
    fn a_drag_turns_the_scene_by_what_it_moved_in_all() {
        let (mut mouse, now) = (Mouse::default(), Instant::now());
        moved(&mut mouse, 10.0, 10.0);
        assert_eq!(mouse.take(now), None, "no button is held");
        button(&mut mouse, MouseButton::Left, ElementState::Pressed);
        moved(&mut mouse, 30.0, 10.0);
        moved(&mut mouse, 110.0, 20.0);
        button(&mut mouse, MouseButton::Left, ElementState::Released);
        moved(&mut mouse, 0.0, 0.0);
        let all = mouse.take(Instant::now()).expect("a move");
        let expected = DVec2::new(100.0, 10.0) * ORBIT_RAD_PER_PIXEL;
        assert!((all.orbit_rad - expected).length() < 1e-12, "{all:?}");
        assert_eq!((all.pan, all.zoom, all.channel.as_str()), (DVec2::ZERO, 1.0, "a"));
        assert_eq!(mouse.take(now + Duration::from_secs(9)), None, "it is sent once");
    }

    #[test]
    fn other_buttons_move_the_scene_by_parts_of_the_window() {
        for held in [MouseButton::Right, MouseButton::Middle] {
            let mut mouse = Mouse::default();
            moved(&mut mouse, 0.0, 0.0);
            button(&mut mouse, held, ElementState::Pressed);
            moved(&mut mouse, 100.0, 25.0);
            let all = mouse.take(Instant::now()).expect("a move");
            assert_eq!((all.pan, all.orbit_rad), (DVec2::new(0.5, 0.25), DVec2::ZERO));
        }
    }

    #[test]
    fn in_full_screen_fingers_count_and_the_mouse_does_not() {
        let mut mouse = Mouse::new(true);
        button(&mut mouse, MouseButton::Left, ElementState::Pressed);
        moved(&mut mouse, 10.0, 10.0);
        moved(&mut mouse, 90.0, 10.0);
        wheel(&mut mouse, 3.0);
        assert_eq!(mouse.take(Instant::now()), None);
        let mut finger = |id, phase, x, y| {
            let (device_id, location) = (DeviceId::dummy(), PhysicalPosition::new(x, y));
            let touch = Touch { device_id, phase, location, force: None, id };
            mouse.handle("a", SIZE, &WindowEvent::Touch(touch));
        };
        finger(1, TouchPhase::Started, 20.0, 20.0);
        finger(1, TouchPhase::Moved, 30.0, 20.0);
        finger(2, TouchPhase::Started, 130.0, 20.0);
        finger(1, TouchPhase::Moved, 80.0, 20.0);
        let all = mouse.take(Instant::now()).expect("a move");
        assert_eq!(all.orbit_rad, DVec2::new(10.0, 0.0) * ORBIT_RAD_PER_PIXEL);
        // Two move by their middle, which is 25 of 200 pixels; they are half as far apart.
        assert_eq!((all.pan, all.zoom), (DVec2::new(0.125, 0.0), 0.5));
    }

    #[test]
    fn the_wheel_zooms_and_comes_back() {
        let mut mouse = Mouse::default();
        wheel(&mut mouse, 2.0);
        wheel(&mut mouse, -2.0);
        wheel(&mut mouse, 1.0);
        let zoom = mouse.take(Instant::now()).expect("a move").zoom;
        assert!((zoom - ZOOM_PER_LINE).abs() < 1e-12, "{zoom}");
        for lines in [f32::MAX, f32::MIN, f32::INFINITY] {
            wheel(&mut mouse, lines);
            assert!(mouse.pending("a").is_sound(), "{lines} lines");
        }
    }

    #[test]
    fn moves_are_sent_at_most_sixty_times_a_second_and_none_is_lost() {
        let (mut mouse, start) = (Mouse::default(), Instant::now());
        button(&mut mouse, MouseButton::Left, ElementState::Pressed);
        moved(&mut mouse, 0.0, 0.0);
        let (mut sent, mut turned) = (0, 0.0);
        for ms in 1..=1000_u32 {
            moved(&mut mouse, f64::from(ms), 0.0);
            let at = start + Duration::from_millis(u64::from(ms));
            if let Some(all) = mouse.take(at) {
                (sent, turned) = (sent + 1, turned + all.orbit_rad.x);
            }
        }
        assert!((50..=61).contains(&sent), "{sent} messages");
        turned += mouse.take(start + Duration::from_secs(2)).map_or(0.0, |all| all.orbit_rad.x);
        assert!((turned - 1000.0 * ORBIT_RAD_PER_PIXEL).abs() < 1e-9, "{turned}");
    }
}
