//! Windows that fill monitors: which, with or without a window manager, and after changes.
//!
//! Window managers that support full screen are asked for it. Otherwise windows are placed and
//! sized here, and no window manager is asked about them (*override redirect*): a simple one would
//! put frames around them, and one that starts later leaves them alone. They need no keyboard
//! focus.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::platform::x11::WindowAttributesExtX11;
use winit::raw_window_handle::{HasWindowHandle, RawWindowHandle};
use winit::window::{Window, WindowAttributes, WindowId};

use crate::desktop::{Desktop, DesktopError};
use crate::mismatch::MonitorAssignment;
use crate::monitor::{Monitor, assign, list};

/// Times that a window is put back after something else has moved it. Then somebody means it.
const CORRECTIONS_MAX: u32 = 8;

/// The windows of a server in full screen.
#[derive(Debug)]
pub(crate) struct Fullscreen {
    desktop: Desktop,
    is_managed: bool,
    /// Monitors by channel, as the command line names them, and as the wall file does.
    named: BTreeMap<String, String>,
    from_wall: BTreeMap<String, String>,
    channels: Vec<String>,
    /// One for each of the channels.
    assignments: Vec<MonitorAssignment>,
    windows: Vec<FullscreenWindow>,
}

#[derive(Debug)]
struct FullscreenWindow {
    window: Arc<Window>,
    corrections: u32,
}

impl Fullscreen {
    /// Chooses a monitor for every channel, and keeps the screen from being blanked.
    ///
    /// # Errors
    /// One line: the X server cannot be asked, or the monitors do not suffice.
    pub fn open(channels: &[String], named: BTreeMap<String, String>) -> Result<Self, String> {
        let desktop = Desktop::open().map_err(|error| error.to_string())?;
        let is_managed = desktop.has_fullscreen_manager().map_err(|error| error.to_string())?;
        let mut fullscreen = Self {
            desktop,
            is_managed,
            named,
            from_wall: BTreeMap::new(),
            channels: channels.to_vec(),
            assignments: Vec::new(),
            windows: Vec::new(),
        };
        fullscreen.assign_monitors(&fullscreen.names())?;
        if let Err(error) = fullscreen.desktop.keep_awake() {
            tracing::warn!(%error, "the screen saver could not be inhibited");
        }
        Ok(fullscreen)
    }

    /// Chooses monitors anew and says so to other servers.
    fn assign_monitors(&mut self, names: &BTreeMap<String, String>) -> Result<(), String> {
        let chosen = self.desktop.alone(|| {
            let monitors = self.desktop.monitors().map_err(|error| error.to_string())?;
            let taken = self.desktop.taken(&monitors).map_err(|error| error.to_string())?;
            let chosen = assign(&self.channels, names, &monitors, &taken)?;
            let shared = chosen.iter().filter(|monitor| taken.contains(&monitor.name));
            for monitor in shared {
                tracing::warn!(monitor = monitor.name, "another server fills this monitor too");
            }
            self.claim(&chosen).map_err(|error| error.to_string())?;
            Ok(chosen)
        });
        let chosen = chosen.unwrap_or_else(|error| Err(error.to_string()))?;
        for (channel, monitor) in self.channels.iter().zip(&chosen) {
            tracing::info!(channel, %monitor, managed = self.is_managed, "full screen");
        }
        let assignment = |monitor| MonitorAssignment { monitor, is_connected: true };
        self.assignments = chosen.into_iter().map(assignment).collect();
        Ok(())
    }

    fn names(&self) -> BTreeMap<String, String> {
        let mut names = self.from_wall.clone();
        names.extend(self.named.clone());
        names
    }

    fn claim(&self, chosen: &[Monitor]) -> Result<(), DesktopError> {
        let names: BTreeSet<&str> = chosen.iter().map(|monitor| monitor.name.as_str()).collect();
        for assignment in &self.assignments {
            let name = assignment.monitor.name.as_str();
            if !names.contains(name) {
                self.desktop.claim(name, false)?;
            }
        }
        names.into_iter().try_for_each(|name| self.desktop.claim(name, true))
    }

    /// Returns how the window of the next channel is made; [`Self::adopt`] takes it over.
    pub fn attributes(&self, attributes: WindowAttributes) -> WindowAttributes {
        let Some(MonitorAssignment { monitor, .. }) = self.assignments.get(self.windows.len())
        else {
            return attributes;
        };
        let ([x, y], [width, height]) = (monitor.position, monitor.size);
        attributes
            .with_position(PhysicalPosition::new(x, y))
            .with_inner_size(PhysicalSize::new(width, height))
            .with_decorations(false)
            .with_visible(false)
            .with_override_redirect(!self.is_managed)
    }

    /// Takes over the window of the next channel and shows it. Returns what it fills.
    ///
    /// # Errors
    /// The X server refused.
    pub fn adopt(&mut self, window: Arc<Window>) -> Result<Option<MonitorAssignment>, String> {
        let index = self.windows.len();
        window.set_cursor_visible(false);
        if self.is_managed {
            let begun = self.desktop.begin_fullscreen(id_of(&window));
            begun.map_err(|error| error.to_string())?;
        }
        window.set_visible(true);
        self.windows.push(FullscreenWindow { window, corrections: 0 });
        Ok(self.assignments.get(index).cloned())
    }

    /// Takes the names of monitors of a wall file, by channel; the command line's have precedence.
    /// Returns all channels with what they fill.
    ///
    /// # Errors
    /// One line: a name that no monitor has, or twice the same.
    pub fn handle_names(
        &mut self,
        from_wall: BTreeMap<String, String>,
    ) -> Result<Vec<(String, MonitorAssignment)>, String> {
        if self.from_wall != from_wall {
            self.from_wall = from_wall;
            self.assign_monitors(&self.names())?;
            self.fill();
        }
        Ok(self.channels.iter().cloned().zip(self.assignments.iter().cloned()).collect())
    }

    /// Follows monitors that were moved, resized, plugged in or unplugged. Returns all channels
    /// with what they fill, if anything has changed.
    pub fn handle_change(&mut self) -> Vec<(String, MonitorAssignment)> {
        let monitors = match self.desktop.monitors() {
            Ok(monitors) => monitors,
            Err(error) => {
                tracing::warn!(%error, "the monitors could not be listed");
                return Vec::new();
            }
        };
        let before = self.assignments.clone();
        let found = |assignment: &MonitorAssignment| {
            monitors.iter().find(|it| it.name == assignment.monitor.name)
        };
        for assignment in &mut self.assignments {
            match found(assignment).cloned() {
                Some(monitor) => *assignment = MonitorAssignment { monitor, is_connected: true },
                None => assignment.is_connected = false,
            }
        }
        self.reassign_lost();
        if self.assignments == before {
            return Vec::new();
        }
        tracing::info!(monitors = list(&monitors), "the monitors have changed");
        self.fill();
        self.channels.iter().cloned().zip(self.assignments.iter().cloned()).collect()
    }

    /// Moves channels whose monitors are gone, and were named by nobody, to others that are free.
    fn reassign_lost(&mut self) {
        let mut names = self.names();
        for (channel, assignment) in self.channels.iter().zip(&self.assignments) {
            if assignment.is_connected {
                names.entry(channel.clone()).or_insert_with(|| assignment.monitor.name.clone());
            }
        }
        // Where none is free, it waits for its own to come back.
        if self.channels.iter().any(|channel| !names.contains_key(channel))
            && let Err(reason) = self.assign_monitors(&names)
        {
            tracing::warn!(reason, "a channel has no monitor any more");
        }
    }

    /// Puts every window over its monitor.
    fn fill(&mut self) {
        for (placed, assignment) in self.windows.iter_mut().zip(&self.assignments) {
            placed.corrections = 0;
            if assignment.is_connected {
                put(&self.desktop, self.is_managed, &placed.window, &assignment.monitor);
            }
        }
    }

    /// Puts a window back that something else has moved or resized.
    pub fn restore(&mut self, id: WindowId) {
        let mut windows = self.windows.iter_mut().zip(&self.assignments);
        let Some((placed, assignment)) = windows.find(|(placed, _)| placed.window.id() == id)
        else {
            return;
        };
        // Should the X server not answer, the display is gone, and with it this process soon.
        let covers =
            self.desktop.covers(id_of(&placed.window), &assignment.monitor).unwrap_or(true);
        if covers || !assignment.is_connected || placed.corrections >= CORRECTIONS_MAX {
            return;
        }
        placed.corrections += 1;
        if placed.corrections == CORRECTIONS_MAX {
            let monitor = &assignment.monitor;
            tracing::error!(%monitor, "the window manager keeps moving this window away");
        }
        put(&self.desktop, self.is_managed, &placed.window, &assignment.monitor);
    }

    /// Returns the size that a window in full screen keeps on displays of any density, in pixels.
    pub fn size_of(&self, id: WindowId) -> Option<PhysicalSize<u32>> {
        let mut windows = self.windows.iter().zip(&self.assignments);
        let (_, assignment) = windows.find(|(placed, _)| placed.window.id() == id)?;
        Some(PhysicalSize::from(assignment.monitor.size))
    }
}

fn put(desktop: &Desktop, is_managed: bool, window: &Window, monitor: &Monitor) {
    if let Err(error) = desktop.fill(id_of(window), monitor, is_managed) {
        tracing::warn!(%error, %monitor, "a window could not be placed");
    }
}

/// The X server's number of a window.
fn id_of(window: &Window) -> u32 {
    match window.window_handle().map(|handle| handle.as_raw()) {
        Ok(RawWindowHandle::Xlib(handle)) => u32::try_from(handle.window).unwrap_or_default(),
        Ok(RawWindowHandle::Xcb(handle)) => handle.window.get(),
        // winit has no other windows here.
        _ => 0,
    }
}
