//! Moves of the wall's camera by the mouse over a window, and by wands and pads.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A move of the wall's camera about the middle of the open scene, as the mouse over one of its
/// windows asks for it; what came since the last message, added up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Navigation {
    /// The name of the channel in whose window the mouse is.
    pub channel: String,
    /// The angles by which the scene turns: to the right about its vertical axis, and its near side
    /// downwards; in radians.
    pub orbit_rad: DVec2,
    /// The distances by which the scene moves to the right and downwards, in widths and heights of
    /// the channel's picture.
    pub pan: DVec2,
    /// The factor by which the scene appears larger; above 0.
    pub zoom: f64,
}

impl Navigation {
    /// No move.
    pub fn none(channel: &str) -> Self {
        let (orbit_rad, pan) = (DVec2::ZERO, DVec2::ZERO);
        Self { channel: channel.to_owned(), orbit_rad, pan, zoom: 1.0 }
    }

    /// Returns whether all numbers are finite and the zoom is above 0.
    pub fn is_sound(&self) -> bool {
        let is_finite = self.orbit_rad.is_finite() && self.pan.is_finite();
        is_finite && self.zoom.is_finite() && self.zoom > 0.0
    }
}

/// A move of the wall's camera by a wand or a pad: the viewer flies through the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flight {
    /// Offset of the viewer along the axes of display space, in its metres.
    pub offset_m: DVec3,
    /// Turn of the view to the right, about the scene's vertical through the viewer, and up; in
    /// radians.
    pub turn_rad: DVec2,
}

impl Flight {
    /// No move.
    pub const NONE: Self = Self { offset_m: DVec3::ZERO, turn_rad: DVec2::ZERO };

    /// Returns whether all numbers are finite.
    pub fn is_valid(&self) -> bool {
        self.offset_m.is_finite() && self.turn_rad.is_finite()
    }
}
