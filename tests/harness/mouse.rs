//! The actions of a user at an X display: the mouse over windows.

use std::collections::BTreeMap;

use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    self, AtomEnum, BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ConnectionExt, MOTION_NOTIFY_EVENT,
    Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;

use super::display::Display;

/// Buttons of a mouse, as X numbers them; the wheel is two of them.
pub const LEFT: u8 = 1;
pub const RIGHT: u8 = 3;
pub const WHEEL_UP: u8 = 4;
pub const WHEEL_DOWN: u8 = 5;

/// x, y, width and height in pixels of the display.
pub type Rect = [i32; 4];

impl Display {
    /// All windows whose titles begin so, by their titles without that.
    fn windows(&self, prefix: &str) -> BTreeMap<String, Window> {
        let mut found = BTreeMap::new();
        let mut windows = vec![self.root];
        while let Some(window) = windows.pop() {
            // A window may go while it is looked at.
            let Ok(tree) = self.connection.query_tree(window).expect("asked").reply() else {
                continue;
            };
            windows.extend(tree.children);
            let (name, text) = (AtomEnum::WM_NAME, AtomEnum::ANY);
            let title = self.connection.get_property(false, window, name, text, 0, 256);
            let Ok(title) = title.expect("asked").reply() else { continue };
            if let Some(rest) = String::from_utf8_lossy(&title.value).strip_prefix(prefix) {
                found.insert(rest.to_owned(), window);
            }
        }
        found
    }

    /// Returns the rectangles of channels' windows, by the channels' names.
    pub fn channel_windows(&self) -> BTreeMap<String, Rect> {
        let windows = self.windows("polyptych ").into_iter();
        let rect = |(name, window)| {
            let size = self.connection.get_geometry(window).expect("asked").reply().ok()?;
            let at = self.connection.translate_coordinates(window, self.root, 0, 0);
            let at = at.expect("asked").reply().ok()?;
            let [x, y] = [at.dst_x, at.dst_y].map(i32::from);
            Some((name, [x, y, i32::from(size.width), i32::from(size.height)]))
        };
        windows.filter_map(rect).collect()
    }

    fn fake(&self, kind: u8, detail: u8, [x, y]: [i32; 2]) {
        let [x, y] = [x, y].map(|place| i16::try_from(place).expect("on the display"));
        let faked = self.connection.xtest_fake_input(kind, detail, 0, self.root, x, y, 0);
        faked.expect("sent").check().expect("XTEST");
    }

    /// Moves the mouse to a place of the display.
    pub fn point(&self, place: [i32; 2]) {
        self.fake(MOTION_NOTIFY_EVENT, 0, place);
    }

    /// Presses and releases a button where the mouse is.
    pub fn click(&self, button: u8) {
        self.fake(BUTTON_PRESS_EVENT, button, [0, 0]);
        self.fake(BUTTON_RELEASE_EVENT, button, [0, 0]);
        self.connection.flush().expect("sent");
    }

    /// Drags with this button, in steps as a hand does.
    pub fn drag(&self, button: u8, from: [i32; 2], to: [i32; 2]) {
        const STEPS: i32 = 8;
        self.point(from);
        self.fake(BUTTON_PRESS_EVENT, button, [0, 0]);
        for step in 1..=STEPS {
            let at = |axis: usize| from[axis] + (to[axis] - from[axis]) * step / STEPS;
            self.point([at(0), at(1)]);
        }
        self.fake(BUTTON_RELEASE_EVENT, button, [0, 0]);
        // Whatever was sent has come to the server once it answers.
        let _ = xproto::get_input_focus(&self.connection).expect("asked").reply();
    }
}
