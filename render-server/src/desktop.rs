//! Features of an X server that winit lacks: monitors of RandR 1.5, windows that fill one without a
//! window manager, and a screen that is not blanked. They have a connection of their own.

use std::collections::BTreeSet;
use std::thread::Builder;

use x11rb::connection::Connection;
use x11rb::cookie::Cookie;
use x11rb::errors::{ConnectError, ReplyError};
use x11rb::protocol::dpms::{ConnectionExt as _, DPMSMode};
use x11rb::protocol::randr::{ConnectionExt as _, NotifyMask};
use x11rb::protocol::screensaver::ConnectionExt as _;
use x11rb::protocol::xproto::{
    Atom, AtomEnum, ChangeWindowAttributesAux, ClientMessageEvent, ConfigureWindowAux,
    ConnectionExt as _, CreateWindowAux, EventMask, PropMode, ScreenSaver, StackMode, Window,
    WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;
use x11rb::{COPY_DEPTH_FROM_PARENT, COPY_FROM_PARENT, CURRENT_TIME, NONE};

use crate::monitor::{Monitor, in_reading_order};

/// Longest list of a root window's property that is read, in 4 bytes each: the lists of window
/// managers have about a hundred entries.
const PROPERTY_WORDS_MAX: u32 = 4096;

/// Names of Extended Window Manager Hints 1.5 (freedesktop.org).
#[derive(Clone, Copy, Debug)]
struct Hints {
    supported: Atom,
    supporting_check: Atom,
    state: Atom,
    fullscreen: Atom,
}

/// The screen of an X server.
#[derive(Debug)]
pub(crate) struct Desktop {
    connection: RustConnection,
    root: Window,
    hints: Hints,
    /// Owns the selections by which other servers know what this one fills.
    owner: Window,
}

/// Why an X server could not be asked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DesktopError {
    #[error("there is no X display here, or DISPLAY does not name it: {0}")]
    Connect(#[from] ConnectError),
    #[error("the X server does not list its monitors, as RandR 1.5 does: {0}")]
    Monitors(ReplyError),
    #[error("the X server refuses: {0}")]
    Refused(String),
}

impl From<ReplyError> for DesktopError {
    fn from(error: ReplyError) -> Self {
        Self::Refused(error.to_string())
    }
}

impl From<x11rb::errors::ConnectionError> for DesktopError {
    fn from(error: x11rb::errors::ConnectionError) -> Self {
        Self::Refused(error.to_string())
    }
}

impl From<x11rb::errors::ReplyOrIdError> for DesktopError {
    fn from(error: x11rb::errors::ReplyOrIdError) -> Self {
        Self::Refused(error.to_string())
    }
}

impl Desktop {
    /// Connects to the display that `DISPLAY` names.
    pub fn open() -> Result<Self, DesktopError> {
        let (connection, screen) = RustConnection::connect(None)?;
        let root = connection.setup().roots[screen].root;
        let atom = |name: &str| -> Result<Atom, DesktopError> {
            Ok(connection.intern_atom(false, name.as_bytes())?.reply()?.atom)
        };
        let hints = Hints {
            supported: atom("_NET_SUPPORTED")?,
            supporting_check: atom("_NET_SUPPORTING_WM_CHECK")?,
            state: atom("_NET_WM_STATE")?,
            fullscreen: atom("_NET_WM_STATE_FULLSCREEN")?,
        };
        let owner = connection.generate_id()?;
        let (depth, class) = (COPY_DEPTH_FROM_PARENT, WindowClass::INPUT_ONLY);
        let (visual, aux) = (COPY_FROM_PARENT, CreateWindowAux::new());
        let made =
            connection.create_window(depth, owner, root, -1, -1, 1, 1, 0, class, visual, &aux)?;
        made.check()?;
        Ok(Self { connection, root, hints, owner })
    }

    /// Returns all monitors in reading order.
    pub fn monitors(&self) -> Result<Vec<Monitor>, DesktopError> {
        let connection = &self.connection;
        let asked = connection.randr_get_monitors(self.root, true)?;
        let reply = asked.reply().map_err(DesktopError::Monitors)?;
        let mut monitors = Vec::with_capacity(reply.monitors.len());
        for info in reply.monitors {
            let name = connection.get_atom_name(info.name)?.reply()?.name;
            monitors.push(Monitor {
                name: String::from_utf8_lossy(&name).into_owned(),
                position: [info.x.into(), info.y.into()],
                size: [info.width.into(), info.height.into()],
                is_primary: info.primary,
                is_automatic: info.automatic,
            });
        }
        monitors.retain(|monitor| monitor.size.iter().all(|side| *side > 0));
        Ok(in_reading_order(monitors))
    }

    /// Returns whether a window manager runs that knows full screen (Extended Window Manager
    /// Hints, `_NET_SUPPORTING_WM_CHECK`). Others would put a frame around a window.
    pub fn has_fullscreen_manager(&self) -> Result<bool, DesktopError> {
        let check = |window| self.property(window, self.hints.supporting_check);
        // Where the manager has gone, its word is still there, and its window is not.
        let Some(&window) = check(self.root)?.first() else { return Ok(false) };
        if check(window).ok().and_then(|it| it.first().copied()) != Some(window) {
            return Ok(false);
        }
        let supported = self.property(self.root, self.hints.supported)?;
        Ok(supported.contains(&self.hints.fullscreen))
    }

    fn property(&self, window: Window, name: Atom) -> Result<Vec<u32>, DesktopError> {
        let (any, length) = (AtomEnum::ANY, PROPERTY_WORDS_MAX);
        let reply = self.connection.get_property(false, window, name, any, 0, length)?.reply()?;
        Ok(reply.value32().map_or_else(Vec::new, Iterator::collect))
    }

    /// Asks a window manager to show a window in full screen as soon as it is mapped.
    pub fn begin_fullscreen(&self, window: Window) -> Result<(), DesktopError> {
        let (state, kind) = (self.hints.state, AtomEnum::ATOM);
        let fullscreen = [self.hints.fullscreen];
        let mode = PropMode::REPLACE;
        Ok(self.connection.change_property32(mode, window, state, kind, &fullscreen)?.check()?)
    }

    /// Moves a window over a monitor, above all others; through the window manager, where it is
    /// `managed`. Returns after the X server has done, or forwarded, it.
    pub fn fill(
        &self,
        window: Window,
        monitor: &Monitor,
        is_managed: bool,
    ) -> Result<(), DesktopError> {
        if is_managed {
            self.ask_for_fullscreen(window, false)?;
        }
        let ([x, y], [width, height]) = (monitor.position, monitor.size);
        let place = ConfigureWindowAux::new().x(x).y(y).width(width).height(height);
        let place = place.stack_mode(StackMode::ABOVE);
        self.connection.configure_window(window, &place)?.check()?;
        if is_managed {
            self.ask_for_fullscreen(window, true)?;
        }
        Ok(self.connection.sync()?)
    }

    fn ask_for_fullscreen(&self, window: Window, on: bool) -> Result<(), DesktopError> {
        // The last number: an application asks, and no pager.
        let data = [u32::from(on), self.hints.fullscreen, 0, 1, 0];
        let message = ClientMessageEvent::new(32, window, self.hints.state, data);
        let to = EventMask::SUBSTRUCTURE_REDIRECT | EventMask::SUBSTRUCTURE_NOTIFY;
        Ok(self.connection.send_event(false, self.root, to, message)?.check()?)
    }

    /// Returns whether a window covers just these pixels of the X screen.
    pub fn covers(&self, window: Window, monitor: &Monitor) -> Result<bool, DesktopError> {
        let size = self.connection.get_geometry(window)?.reply()?;
        let at = self.connection.translate_coordinates(window, self.root, 0, 0)?.reply()?;
        let position = [i32::from(at.dst_x), i32::from(at.dst_y)];
        let size = [u32::from(size.width), u32::from(size.height)];
        Ok(position == monitor.position && size == monitor.size)
    }

    /// Runs work while no other program may change anything: two servers that start together
    /// must not take the same monitor.
    pub fn alone<T>(&self, work: impl FnOnce() -> T) -> Result<T, DesktopError> {
        self.connection.grab_server()?.check()?;
        let done = work();
        self.connection.ungrab_server()?.check()?;
        Ok(done)
    }

    /// Returns the names of those monitors that other servers fill.
    pub fn taken(&self, monitors: &[Monitor]) -> Result<BTreeSet<String>, DesktopError> {
        let mut taken = BTreeSet::new();
        for monitor in monitors {
            let selection = self.selection(&monitor.name)?;
            let owner = self.connection.get_selection_owner(selection)?.reply()?.owner;
            if owner != NONE && owner != self.owner {
                taken.insert(monitor.name.clone());
            }
        }
        Ok(taken)
    }

    /// Says to other servers that this one fills a monitor, or does no more. The X server forgets
    /// it when this process ends, however it does.
    pub fn claim(&self, monitor: &str, is_filled: bool) -> Result<(), DesktopError> {
        let selection = self.selection(monitor)?;
        let owner = self.connection.get_selection_owner(selection)?.reply()?.owner;
        if is_filled || owner == self.owner {
            let owner = if is_filled { self.owner } else { NONE };
            self.connection.set_selection_owner(owner, selection, CURRENT_TIME)?.check()?;
        }
        Ok(())
    }

    fn selection(&self, monitor: &str) -> Result<Atom, DesktopError> {
        let name = format!("_POLYPTYCH_MONITOR_{monitor}");
        Ok(self.connection.intern_atom(false, name.as_bytes())?.reply()?.atom)
    }

    /// Wakes the monitors, and lets neither the X server's screen saver nor its power management
    /// (DPMS) blank them while this connection is open: `MIT-SCREEN-SAVER` 1.1, `Suspend`.
    pub fn keep_awake(&self) -> Result<(), DesktopError> {
        self.connection.screensaver_query_version(1, 1)?.reply()?;
        self.connection.screensaver_suspend(1)?.check()?;
        self.connection.force_screen_saver(ScreenSaver::RESET)?.check()?;
        let power = self.connection.dpms_info();
        // Without DPMS nothing has to be woken.
        if let Ok(power) = power.map_err(ReplyError::from).and_then(Cookie::reply)
            && power.state
        {
            self.connection.dpms_force_level(DPMSMode::ON)?.check()?;
        }
        Ok(())
    }
}

/// Returns the monitors of the display that `DISPLAY` names, in reading order.
pub(crate) fn monitors() -> Result<Vec<Monitor>, DesktopError> {
    Desktop::open()?.monitors()
}

/// Calls this, on a thread of its own, whenever monitors may have changed; until the X server ends.
pub(crate) fn watch(notify: impl Fn() + Send + 'static) -> Result<(), DesktopError> {
    let (connection, screen) = RustConnection::connect(None)?;
    let root = connection.setup().roots[screen].root;
    // Changes of virtual monitors come as those of the root window only.
    let attributes = ChangeWindowAttributesAux::new().event_mask(EventMask::STRUCTURE_NOTIFY);
    connection.change_window_attributes(root, &attributes)?.check()?;
    let changes = NotifyMask::SCREEN_CHANGE | NotifyMask::CRTC_CHANGE | NotifyMask::OUTPUT_CHANGE;
    connection.randr_select_input(root, changes)?.check()?;
    let wait = move || {
        while connection.wait_for_event().is_ok() {
            notify();
        }
    };
    let started = Builder::new().name("monitors".into()).spawn(wait);
    started.map(|_| ()).map_err(|error| DesktopError::Refused(error.to_string()))
}
