//! Monitors of an X server, and which of them each channel fills. Knows no X: `desktop.rs` asks.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// A monitor as RandR 1.5 has it: an output, several that make one picture, or a part of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Monitor {
    /// The name in the X server and in `xrandr --listmonitors`.
    pub name: String,
    /// Its upper left pixel on the X screen.
    pub position: [i32; 2],
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The user has called it the primary one.
    pub is_primary: bool,
    /// The X server made it for an output; nobody has defined it.
    pub is_automatic: bool,
}

impl fmt::Display for Monitor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([width, height], [x, y]) = (self.size, self.position);
        write!(f, "{} {width}x{height} at {x},{y}", self.name)
    }
}

impl Monitor {
    fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.overlap(other, axis) > 0)
    }

    /// Pixels that both cover along an axis; negative where there is a gap.
    fn overlap(&self, other: &Self, axis: usize) -> i64 {
        let ends = [self, other].map(|it| i64::from(it.position[axis]) + i64::from(it.size[axis]));
        let begin = i64::from(self.position[axis].max(other.position[axis]));
        ends[0].min(ends[1]) - begin
    }
}

/// Sorts monitors as a page is read: rows from above, each from the left. Monitors are in one row
/// if half of the lower one's height stands beside the row's first.
pub(crate) fn in_reading_order(mut monitors: Vec<Monitor>) -> Vec<Monitor> {
    let mut sorted = Vec::with_capacity(monitors.len());
    while let Some(first) = monitors.iter().min_by_key(|it| (it.position[1], it.position[0])) {
        let first = first.clone();
        let is_beside =
            |it: &Monitor| 2 * first.overlap(it, 1) >= i64::from(first.size[1].min(it.size[1]));
        let (mut row, rest) = monitors.into_iter().partition::<Vec<_>, _>(is_beside);
        row.sort_by_key(|it| it.position);
        sorted.append(&mut row);
        monitors = rest;
    }
    sorted
}

/// Names monitors with their sizes and places, for an error of one line.
pub(crate) fn list(monitors: &[Monitor]) -> String {
    if monitors.is_empty() {
        return "none".to_owned();
    }
    monitors.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Gives every channel a monitor: the one that is named for it, else the next in order that no
/// other channel, and no other server (`taken`, by name), fills. `monitors` are in reading order.
///
/// # Errors
/// One line that lists the monitors: a name that no monitor has, one monitor for two channels, or
/// more channels than monitors.
pub(crate) fn assign(
    channels: &[String],
    names: &BTreeMap<String, String>,
    monitors: &[Monitor],
    taken: &BTreeSet<String>,
) -> Result<Vec<Monitor>, String> {
    let mut given: Vec<Option<&Monitor>> = Vec::with_capacity(channels.len());
    for channel in channels {
        let Some(name) = names.get(channel) else {
            given.push(None);
            continue;
        };
        let Some(monitor) = monitors.iter().find(|monitor| monitor.name == *name) else {
            let known = list(monitors);
            return Err(format!(
                "channel {channel}: there is no monitor {name:?}; the monitors here: {known}"
            ));
        };
        let is_it = |it: Option<&Monitor>| it.is_some_and(|it| it.name == *name);
        if let Some(other) = given.iter().copied().position(is_it) {
            return Err(format!(
                "channels {} and {channel} are both given monitor {name:?}; give each one of its \
                 own: {}",
                channels[other],
                list(monitors)
            ));
        }
        given.push(Some(monitor));
    }
    for index in 0..given.len() {
        if given[index].is_none() {
            let is_used = |it: &Monitor| given.iter().flatten().any(|used| used.overlaps(it));
            let mut free = monitors.iter().filter(|it| !is_replaced(it, monitors));
            let next = free.find(|it| !taken.contains(&it.name) && !is_used(it));
            given[index] = Some(next.ok_or_else(|| too_few(channels.len(), monitors, taken))?);
        }
    }
    Ok(given.into_iter().flatten().cloned().collect())
}

/// An output's own monitor where somebody has defined others over it, as for a part of it.
fn is_replaced(monitor: &Monitor, monitors: &[Monitor]) -> bool {
    let is_over = |it: &Monitor| !it.is_automatic && it.overlaps(monitor);
    monitor.is_automatic && monitors.iter().any(is_over)
}

fn too_few(channels: usize, monitors: &[Monitor], taken: &BTreeSet<String>) -> String {
    let plural = if channels == 1 { "" } else { "s" };
    let filled = if taken.is_empty() {
        String::new()
    } else {
        let taken = taken.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        format!(" (other servers fill {taken})")
    };
    format!(
        "no monitor is left for {channels} channel{plural} in full screen; the monitors here: \
         {}{filled}; draw fewer channels, name monitors with --monitor, or use --window",
        list(monitors)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monitor(name: &str, position: [i32; 2], size: [u32; 2]) -> Monitor {
        Monitor { name: name.into(), position, size, is_primary: false, is_automatic: false }
    }

    fn names(monitors: &[Monitor]) -> Vec<&str> {
        monitors.iter().map(|monitor| monitor.name.as_str()).collect()
    }

    fn given(
        channels: &[&str],
        named: &[(&str, &str)],
        monitors: &[Monitor],
        taken: &[&str],
    ) -> Result<Vec<String>, String> {
        let channels: Vec<String> = channels.iter().map(|name| (*name).to_owned()).collect();
        let named = named.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        let taken = taken.iter().map(|name| (*name).to_owned()).collect();
        let given = assign(&channels, &named, monitors, &taken)?;
        Ok(given.into_iter().map(|monitor| monitor.name).collect())
    }

    #[test]
    fn monitors_are_sorted_as_a_page_is_read() {
        let side = [1920, 1080];
        let grid = vec![
            monitor("d", [1920, 1100], side),
            monitor("b", [1920, 20], side),
            monitor("c", [0, 1080], side),
            monitor("a", [0, 0], side),
        ];
        assert_eq!(names(&in_reading_order(grid)), ["a", "b", "c", "d"]);
        // The right one stands higher, and still beside the left one.
        let askew =
            vec![monitor("right", [1366, -300], side), monitor("left", [0, 0], [1366, 768])];
        assert_eq!(names(&in_reading_order(askew)), ["left", "right"]);
        let above = vec![monitor("low", [0, 1080], side), monitor("high", [960, 0], side)];
        assert_eq!(names(&in_reading_order(above)), ["high", "low"]);
    }

    #[test]
    fn channels_take_named_monitors_first_and_then_others_in_order() {
        let [a, b] = [monitor("A", [0, 0], [512, 768]), monitor("B", [512, 0], [512, 768])];
        let both = [a.clone(), b.clone()];
        assert_eq!(given(&["l", "r"], &[], &both, &[]).unwrap(), ["A", "B"]);
        assert_eq!(given(&["l", "r"], &[("r", "A")], &both, &[]).unwrap(), ["B", "A"]);
        assert_eq!(given(&["l"], &[], &both, &["A"]).unwrap(), ["B"], "another server is on A");
        assert_eq!(given(&["l"], &[("l", "A")], &both, &["A"]).unwrap(), ["A"], "it was asked");
        // A name that is meant for a channel of another server.
        assert_eq!(given(&["l"], &[("r", "A")], &both, &[]).unwrap(), ["A"]);
    }

    #[test]
    fn monitors_with_the_same_pixels_are_not_taken_twice() {
        let [a, b] = [monitor("A", [0, 0], [512, 768]), monitor("B", [512, 0], [512, 768])];
        let whole = Monitor { is_automatic: true, ..monitor("screen", [0, 0], [1024, 768]) };
        let split = [whole.clone(), a.clone(), b];
        assert_eq!(given(&["l", "r"], &[], &split, &[]).unwrap(), ["A", "B"]);
        assert_eq!(given(&["l"], &[("l", "screen")], &split, &[]).unwrap(), ["screen"]);
        let mirrored = [a.clone(), Monitor { name: "A2".into(), ..a }];
        let refused = given(&["l", "r"], &[], &mirrored, &[]).unwrap_err();
        assert!(refused.contains("A 512x768 at 0,0, A2 512x768 at 0,0"), "{refused}");
        assert_eq!(given(&["l"], &[], &[whole], &[]).unwrap(), ["screen"]);
    }

    #[test]
    fn errors_are_one_line_that_lists_the_monitors() {
        let both = [monitor("A", [0, 0], [512, 768]), monitor("B", [512, 0], [512, 768])];
        let known = "A 512x768 at 0,0, B 512x768 at 512,0";
        let twice = [("l", "B"), ("r", "B")];
        for (error, expected) in [
            (given(&["l"], &[("l", "HDMI-9")], &both, &[]), "there is no monitor \"HDMI-9\""),
            (given(&["l", "r"], &twice, &both, &[]), "channels l and r are both given"),
            (given(&["l", "m", "r"], &[], &both, &[]), "no monitor is left for 3 channels"),
            (given(&["l"], &[], &both, &["A", "B"]), "(other servers fill A, B)"),
        ] {
            let error = error.unwrap_err();
            assert!(error.contains(expected) && error.contains(known), "{error}");
            assert_eq!(error.lines().count(), 1);
        }
        let none = given(&["l"], &[], &[], &[]).unwrap_err();
        assert!(none.contains("no monitor is left for 1 channel in full screen"), "{none}");
        assert!(none.contains("the monitors here: none"), "{none}");
    }
}
