//! An X display without a monitor, and what can be seen on it.

use std::process::Command;

use image::{Rgba, RgbaImage};
use x11rb::connection::Connection;
use x11rb::protocol::randr::{ConnectionExt as _, MonitorInfo};
use x11rb::protocol::screensaver::ConnectionExt as _;
use x11rb::protocol::xfixes::ConnectionExt as _;
use x11rb::protocol::xproto::{
    AtomEnum, Blanking, ClientMessageEvent, ConfigureWindowAux, ConnectionExt as _, EventMask,
    Exposures, ImageFormat, Window,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use super::process::Process;
use super::wait;

/// Its size in pixels.
pub const SIZE: [u16; 2] = [1024, 768];

/// A running X server; it ends with this.
#[derive(Debug)]
pub struct Display {
    /// The name for the variable `DISPLAY`.
    pub name: String,
    pub(super) connection: RustConnection,
    pub(super) root: Window,
    _server: Process,
}

impl Display {
    /// Starts `Xvfb` on a display that is free.
    pub fn start() -> Self {
        let [width, height] = SIZE;
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", "1", "-noreset", "-nolisten", "tcp", "-screen", "0"]);
        command.arg(format!("{width}x{height}x24"));
        let server = Process::start("Xvfb (on Debian or Ubuntu: apt install xvfb)", &mut command);
        let number = wait::until("the number of the display", || {
            server.output().lines().find_map(|line| line.trim().parse::<u32>().ok())
        });
        let name = format!(":{number}");
        let (connection, screen) = RustConnection::connect(Some(&name)).expect("a display");
        let root = connection.setup().roots[screen].root;
        Self { name, connection, root, _server: server }
    }

    /// Returns the picture of all windows together.
    pub fn screenshot(&self) -> RgbaImage {
        let [width, height] = SIZE;
        let (format, planes) = (ImageFormat::Z_PIXMAP, u32::MAX);
        let image = self.connection.get_image(format, self.root, 0, 0, width, height, planes);
        let image = image.expect("asked").reply().expect("an image");
        let mut pixels = image.data.chunks_exact(4);
        RgbaImage::from_fn(width.into(), height.into(), |_, _| match pixels.next() {
            // 24 bits of colour in 32, the least significant byte first.
            Some(&[b, g, r, _]) => Rgba([r, g, b, 255]),
            _ => panic!("the image ends too early"),
        })
    }

    /// The titles of all windows that have one.
    pub fn titles(&self) -> Vec<String> {
        let mut titles: Vec<String> =
            self.titled_windows().into_iter().map(|(title, _)| title).collect();
        titles.sort();
        titles
    }

    fn titled_windows(&self) -> Vec<(String, Window)> {
        let mut titles = Vec::new();
        let mut windows = vec![self.root];
        while let Some(window) = windows.pop() {
            // A window may go while it is looked at.
            let Ok(tree) = self.connection.query_tree(window).expect("asked").reply() else {
                continue;
            };
            windows.extend(tree.children);
            let (name, text) = (AtomEnum::WM_NAME, AtomEnum::ANY);
            let title = self.connection.get_property(false, window, name, text, 0, 256);
            if let Ok(title) = title.expect("asked").reply()
                && !title.value.is_empty()
            {
                titles.push((String::from_utf8_lossy(&title.value).into_owned(), window));
            }
        }
        titles
    }

    /// The window of this title, once there is one.
    #[track_caller]
    fn window(&self, title: &str) -> Window {
        wait::until(title, || {
            let mut all = self.titled_windows().into_iter();
            all.find(|(its, _)| its == title).map(|(_, window)| window)
        })
    }

    /// Divides the screen into monitors: names, and x, y, width, height in pixels. Others that
    /// were defined before go.
    pub fn set_monitors(&self, monitors: &[(&str, [i16; 4])]) {
        let connection = &self.connection;
        let known = connection.randr_get_monitors(self.root, true).expect("asked");
        let known = known.reply().expect("monitors").monitors;
        let atom = |name: &str| {
            let atom = connection.intern_atom(false, name.as_bytes()).expect("asked");
            atom.reply().expect("an atom").atom
        };
        // The X server refuses a name that it knows.
        for old in known.iter().filter(|it| !it.automatic) {
            let deleted = connection.randr_delete_monitor(self.root, old.name).expect("asked");
            deleted.check().expect("deleted");
        }
        let mut outputs = known.iter().flat_map(|it| it.outputs.clone()).collect::<Vec<_>>();
        for (name, [x, y, width, height]) in monitors {
            let monitor = MonitorInfo {
                name: atom(name),
                primary: false,
                automatic: false,
                x: *x,
                y: *y,
                width: *width as u16,
                height: *height as u16,
                width_in_millimeters: 100,
                height_in_millimeters: 100,
                // The first takes the only output, whose own monitor goes.
                outputs: std::mem::take(&mut outputs),
            };
            let set = connection.randr_set_monitor(self.root, monitor).expect("asked");
            set.check().expect("a monitor");
        }
    }

    /// Closes the window of this title as a person does with its frame.
    pub fn close(&self, title: &str) {
        let window = self.window(title);
        let atom = |name: &[u8]| {
            let atom = self.connection.intern_atom(false, name).expect("asked");
            atom.reply().expect("an atom").atom
        };
        let data = [atom(b"WM_DELETE_WINDOW"), 0, 0, 0, 0];
        let message = ClientMessageEvent::new(32, window, atom(b"WM_PROTOCOLS"), data);
        let sent = self.connection.send_event(false, window, EventMask::NO_EVENT, message);
        sent.expect("asked").check().expect("sent");
    }

    /// Resizes the window of this title as a person does with its frame.
    pub fn resize(&self, title: &str, [width, height]: [u32; 2]) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        let window = self.window(title);
        let resized = self.connection.configure_window(window, &size).expect("asked");
        resized.check().expect("resized");
    }

    /// Returns whether a person would see the pointer at a place.
    pub fn shows_pointer(&self, [x, y]: [i16; 2]) -> bool {
        let connection = &self.connection;
        connection.warp_pointer(x11rb::NONE, self.root, 0, 0, 0, 0, x, y).expect("asked");
        connection.xfixes_query_version(5, 0).expect("asked").reply().expect("XFixes");
        let image = connection.xfixes_get_cursor_image().expect("asked").reply();
        image.expect("a pointer").cursor_image.iter().any(|argb| argb >> 24 > 0)
    }

    /// Lets the screen be blanked after so many seconds without a touch.
    pub fn blank_after(&self, seconds: i16) {
        let connection = &self.connection;
        let (blanking, exposures) = (Blanking::PREFERRED, Exposures::NOT_ALLOWED);
        let set = connection.set_screen_saver(seconds, 0, blanking, exposures).expect("asked");
        set.check().expect("set");
        connection.sync().expect("done");
    }

    /// Returns whether the screen is blanked, and the milliseconds since the last input.
    pub fn is_blanked(&self) -> (bool, u32) {
        let info = self.connection.screensaver_query_info(self.root).expect("asked");
        let info = info.reply().expect("a screen saver");
        // X11/extensions/saver.h: ScreenSaverOn.
        (info.state == 1, info.ms_since_user_input)
    }
}
