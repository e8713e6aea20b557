//! Fingers on displays that feel them: one turns the scene, several together move it and make it
//! larger or smaller.
//!
//! Each movement of a finger counts by itself, so that it does not matter in which order the window
//! system reports those of one gesture.

use std::collections::BTreeMap;

use glam::DVec2;
use winit::event::{Touch, TouchPhase};

/// Maximum number of fingers on all windows of a server: three people.
const FINGERS_MAX: usize = 32;

/// Shortest mean distance of fingers from their middle that is measured, in pixels: what is nearer
/// is one blot to a screen, and its size means nothing.
const SPREAD_MIN: f64 = 8.0;

/// A movement of one finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Gesture {
    /// The only finger of a window moved by so many pixels, right and down.
    One(DVec2),
    /// One of several moved their middle by so many pixels, and their distances from it by a factor
    /// above 0.
    Several { by: DVec2, zoom: f64 },
}

/// The fingers on the windows of a server.
#[derive(Debug, Default)]
pub(crate) struct Fingers {
    /// Places in pixels of the window, by channel and finger.
    places: BTreeMap<(String, u64), DVec2>,
}

impl Fingers {
    /// Takes what a finger did on the window of a channel. Returns a movement; `None` for a finger
    /// that comes, goes, or was not seen to come.
    pub fn handle(&mut self, channel: &str, touch: &Touch) -> Option<Gesture> {
        let key = (channel.to_owned(), touch.id);
        let now = DVec2::new(touch.location.x, touch.location.y);
        match touch.phase {
            TouchPhase::Started if now.is_finite() && self.places.len() < FINGERS_MAX => {
                self.places.insert(key, now);
                None
            }
            TouchPhase::Started => None,
            TouchPhase::Ended | TouchPhase::Cancelled => {
                self.places.remove(&key);
                None
            }
            TouchPhase::Moved => {
                let before = *self.places.get(&key).filter(|_| now.is_finite())?;
                let spread_before = self.spread(channel);
                self.places.insert(key, now);
                let by = now - before;
                let Some(spread_before) = spread_before else { return Some(Gesture::One(by)) };
                let (middle_by, spread) = (by / self.count(channel) as f64, self.spread(channel));
                let zoom = spread.unwrap_or(SPREAD_MIN) / spread_before;
                Some(Gesture::Several { by: middle_by, zoom })
            }
        }
    }

    /// Forgets the fingers on a window whose end may not be told.
    pub fn forget(&mut self, channel: &str) {
        self.places.retain(|(of, _), _| of != channel);
    }

    fn of<'a>(&'a self, channel: &'a str) -> impl Iterator<Item = DVec2> + 'a {
        self.places.iter().filter(move |((of, _), _)| of == channel).map(|(_, place)| *place)
    }

    fn count(&self, channel: &str) -> usize {
        self.of(channel).count()
    }

    /// The mean distance of several fingers from their middle, in pixels, at least [`SPREAD_MIN`];
    /// `None` for one.
    fn spread(&self, channel: &str) -> Option<f64> {
        let count = self.count(channel);
        if count < 2 {
            return None;
        }
        let middle = self.of(channel).sum::<DVec2>() / count as f64;
        let sum: f64 = self.of(channel).map(|place| place.distance(middle)).sum();
        Some((sum / count as f64).max(SPREAD_MIN))
    }
}

#[cfg(test)]
mod tests {
    use winit::dpi::PhysicalPosition;
    use winit::event::DeviceId;

    use super::*;

    fn touch(fingers: &mut Fingers, id: u64, phase: TouchPhase, at: [f64; 2]) -> Option<Gesture> {
        let location = PhysicalPosition::new(at[0], at[1]);
        let touch = Touch { device_id: DeviceId::dummy(), phase, location, force: None, id };
        fingers.handle("a", &touch)
    }

    #[test]
    fn one_finger_drags_from_where_it_came_down() {
        let mut fingers = Fingers::default();
        assert_eq!(touch(&mut fingers, 7, TouchPhase::Moved, [5.0, 5.0]), None, "it never came");
        assert_eq!(touch(&mut fingers, 7, TouchPhase::Started, [10.0, 10.0]), None);
        let moved = touch(&mut fingers, 7, TouchPhase::Moved, [13.0, 6.0]);
        assert_eq!(moved, Some(Gesture::One(DVec2::new(3.0, -4.0))));
        touch(&mut fingers, 7, TouchPhase::Ended, [13.0, 6.0]);
        assert_eq!(touch(&mut fingers, 7, TouchPhase::Moved, [0.0, 0.0]), None);
    }

    #[test]
    fn two_fingers_move_and_pinch_by_what_they_moved_in_all() {
        let mut fingers = Fingers::default();
        touch(&mut fingers, 1, TouchPhase::Started, [100.0, 100.0]);
        touch(&mut fingers, 2, TouchPhase::Started, [200.0, 100.0]);
        let (mut by, mut zoom) = (DVec2::ZERO, 1.0);
        for step in 1..=10 {
            // Apart to thrice the distance, and 40 pixels down.
            let far = 10.0 * f64::from(step);
            for (id, x) in [(1, 100.0 - far), (2, 200.0 + far)] {
                let at = [x, 100.0 + 4.0 * f64::from(step)];
                let moved = touch(&mut fingers, id, TouchPhase::Moved, at);
                let Some(Gesture::Several { by: part, zoom: factor }) = moved else {
                    panic!("{moved:?}");
                };
                (by, zoom) = (by + part, zoom * factor);
            }
        }
        assert!((by - DVec2::new(0.0, 40.0)).length() < 1e-9 && (zoom - 3.0).abs() < 1e-9, "{by}");
        // The one that stays drags alone.
        touch(&mut fingers, 1, TouchPhase::Cancelled, [0.0, 140.0]);
        let moved = touch(&mut fingers, 2, TouchPhase::Moved, [301.0, 140.0]);
        assert_eq!(moved, Some(Gesture::One(DVec2::X)));
    }

    #[test]
    fn fingers_in_one_place_on_other_windows_and_without_end_are_bounded() {
        let mut fingers = Fingers::default();
        for id in 0..1000 {
            touch(&mut fingers, id, TouchPhase::Started, [50.0, 50.0]);
        }
        assert_eq!(fingers.places.len(), FINGERS_MAX);
        let moved = touch(&mut fingers, 3, TouchPhase::Moved, [51.0, 50.0]);
        assert!(matches!(moved, Some(Gesture::Several { zoom, .. }) if zoom == 1.0), "{moved:?}");
        assert_eq!(touch(&mut fingers, 3, TouchPhase::Moved, [f64::NAN, 0.0]), None);
        fingers.forget("b");
        assert_eq!(fingers.places.len(), FINGERS_MAX);
        fingers.forget("a");
        assert!(fingers.places.is_empty());
    }
}
