//! An X display without a monitor, and what can be seen on it.

use std::process::Command;

use image::{Rgba, RgbaImage};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt, ImageFormat, Window};
use x11rb::rust_connection::RustConnection;

use super::process::Process;
use super::wait;

/// Its size in pixels.
pub const SIZE: [u16; 2] = [1024, 768];

/// A running X server; it ends with this.
#[derive(Debug)]
pub struct Display {
    /// As `DISPLAY` names it.
    pub name: String,
    connection: RustConnection,
    root: Window,
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

    /// What all windows together show.
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
                titles.push(String::from_utf8_lossy(&title.value).into_owned());
            }
        }
        titles.sort();
        titles
    }
}
