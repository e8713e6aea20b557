//! Test patterns: pictures by which a wall is set up.

use serde::{Deserialize, Serialize};

/// A test pattern that every channel shows instead of the scene. A frame carries it, so that all
/// channels change with the same frame, captures show it, and a server that joins gets it with its
/// first one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TestPattern {
    /// Lines along the screen, with the numbers of the canvas's pixels and the channel's name:
    /// where channels overlap, their lines fall together.
    Grid,
    /// Squares along the screen.
    Checker,
    /// All codes, dark to light: of all colours together, then of each.
    Ramp,
    /// The share of the light that the channel gives: white where it is alone.
    Weights,
    /// The number of channels that light a place.
    Overlap,
    /// The number of the display's pixels per degree of the viewer's sight.
    Density,
    /// Lines and squares of one and two pixels: they are even grey to an eye that is too far away,
    /// and to a lens that is not in focus.
    Focus,
    /// White, yellow, cyan, green, magenta, red, blue, black; below them steps of grey.
    ColorBars,
    /// Lines through the point of the screen that is nearest to the viewer's eye.
    Crosshair,
    /// The outermost pixels of the display.
    Border,
}

impl TestPattern {
    /// All there are.
    pub const ALL: [Self; 10] = [
        Self::Grid,
        Self::Checker,
        Self::Ramp,
        Self::Weights,
        Self::Overlap,
        Self::Density,
        Self::Focus,
        Self::ColorBars,
        Self::Crosshair,
        Self::Border,
    ];

    /// Returns the pattern's name in commands and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::Checker => "checker",
            Self::Ramp => "ramp",
            Self::Weights => "weights",
            Self::Overlap => "overlap",
            Self::Density => "density",
            Self::Focus => "focus",
            Self::ColorBars => "color-bars",
            Self::Crosshair => "crosshair",
            Self::Border => "border",
        }
    }

    /// Returns the pattern of this name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pattern| pattern.name() == name)
    }

    /// Returns whether the pattern shows the light itself or the edge of the display. Neither blend
    /// nor colour correction is applied to such a pattern, because they would hide it.
    pub fn bypasses_color(self) -> bool {
        matches!(self, Self::Weights | Self::Overlap | Self::Density | Self::Border)
    }

    /// Returns whether the pattern depends on the position of the viewer's eye.
    pub fn depends_on_eye(self) -> bool {
        matches!(self, Self::Density | Self::Crosshair)
    }

    /// Returns whether the pattern depends on other channels only by their number of pixels.
    pub fn ignores_neighbours(self) -> bool {
        // The light that is left to a channel depends on all that are beside it.
        matches!(self, Self::Density | Self::Border)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_json_and_come_back() {
        for pattern in TestPattern::ALL {
            assert_eq!(TestPattern::from_name(pattern.name()), Some(pattern));
            assert_eq!(serde_json::to_value(pattern).expect("JSON"), pattern.name());
        }
        assert_eq!(TestPattern::from_name("plasma"), None);
    }
}
