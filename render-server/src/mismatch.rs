//! The fit of a channel's picture to the monitor that it fills, and the warning if it does not fit.

use std::time::{Duration, Instant};

use crate::monitor::Monitor;

/// Time for which a display shows over its first pictures that they do not fit: enough to read it
/// at every display of a wall that was just started, and no mark on a wall that stays as it is.
pub(crate) const NOTE_TIME: Duration = Duration::from_mins(1);

/// The monitor that a channel fills in full screen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MonitorAssignment {
    pub monitor: Monitor,
    /// `false` after it was unplugged.
    pub is_connected: bool,
}

/// The time until which a display shows over its pictures that they do not fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum NoteTime {
    /// It has shown no picture since.
    #[default]
    NotYet,
    Until(Instant),
    /// Only together with the display's name.
    Over,
}

/// The sizes that should be equal, as width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// The channel's display picture.
    pub picture: [u32; 2],
    /// The value of the wall file's `pixels` that would make it as large as the monitor, if any.
    pub pixels: Option<[u32; 2]>,
    /// The window.
    pub window: [u32; 2],
}

/// A warning about a display, for log, status and the display itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct DisplayMismatch {
    /// A sentence for log and status, which names the remedy.
    pub warning: String,
    /// A short form of the warning, for the display.
    pub note: String,
}

/// Returns what is wrong with a channel's display in full screen, if anything.
pub(crate) fn mismatch(
    channel: &str,
    assignment: &MonitorAssignment,
    sizes: Sizes,
) -> Option<DisplayMismatch> {
    let name = &assignment.monitor.name;
    let by = |[width, height]: [u32; 2]| format!("{width}x{height}");
    let size = assignment.monitor.size;
    if !assignment.is_connected {
        return Some(DisplayMismatch {
            warning: format!(
                "channel {channel} is not seen: its monitor {name} is gone; connect it, or name \
                 another"
            ),
            note: format!("monitor {name} is gone"),
        });
    }
    if sizes.window != size {
        let window = by(sizes.window);
        return Some(DisplayMismatch {
            warning: format!(
                "channel {channel} covers {window} pixels of its monitor {name}, which has {}: \
                 the window manager refuses full screen; run the server without one",
                by(size)
            ),
            note: format!("window {window}, monitor {name} {}", by(size)),
        });
    }
    if sizes.picture == size {
        return None;
    }
    let picture = by(sizes.picture);
    let remedy = match sizes.pixels {
        Some(pixels) => format!("write pixels = {pixels:?} for it in the wall file"),
        None => "give it another monitor".to_owned(),
    };
    Some(DisplayMismatch {
        warning: format!(
            "channel {channel} has {picture} pixels and its monitor {name} {}, so that it is \
             scaled: set the monitor to {picture}, or {remedy}",
            by(size)
        ),
        note: format!("channel {picture}, monitor {name} {}", by(size)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assignment(size: [u32; 2]) -> MonitorAssignment {
        let (name, position) = ("HDMI-1".to_owned(), [0, 0]);
        let monitor = Monitor { name, position, size, is_primary: false, is_automatic: true };
        MonitorAssignment { monitor, is_connected: true }
    }

    #[test]
    fn equal_sizes_are_no_misfit() {
        let size = [1920, 1080];
        let sizes = Sizes { picture: size, pixels: Some(size), window: size };
        assert_eq!(mismatch("left", &assignment(size), sizes), None);
    }

    #[test]
    fn a_misfit_names_channel_monitor_sizes_and_remedy() {
        let sizes = Sizes { picture: [960, 540], pixels: Some([1920, 1200]), window: [1920, 1200] };
        let found = mismatch("left", &assignment([1920, 1200]), sizes).unwrap();
        assert_eq!(
            found.warning,
            "channel left has 960x540 pixels and its monitor HDMI-1 1920x1200, so that it is \
             scaled: set the monitor to 960x540, or write pixels = [1920, 1200] for it in the \
             wall file"
        );
        assert_eq!(found.note, "channel 960x540, monitor HDMI-1 1920x1200");

        let small = Sizes { window: [640, 360], ..sizes };
        let found = mismatch("left", &assignment([1920, 1200]), small).unwrap();
        assert!(found.warning.contains("640x360") && found.warning.contains("window manager"));

        let gone = MonitorAssignment { is_connected: false, ..assignment([1920, 1200]) };
        let found = mismatch("left", &gone, sizes).unwrap();
        assert!(found.warning.contains("monitor HDMI-1 is gone"), "{}", found.warning);
    }
}
