//! Screens: the surfaces of a wall, and the canvases of pixels on them.

use glam::{DVec2, DVec3, UVec2};
use serde::{Deserialize, Serialize};

use super::surface::{Plane, Surface};

/// A surface in display space, with the pixels that would cover all of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Screen {
    /// Unique within the wall.
    pub name: String,
    /// Its position and curvature.
    pub surface: Surface,
    /// Pixels of the whole screen, those hidden behind bezels included: the surface's (u, v) in
    /// steps of one pixel.
    pub canvas: UVec2,
    /// The gaps between its tiles, where the wall file asked for such.
    pub bezel: Option<Bezel>,
}

/// Gaps between the tiles of a screen, behind which the picture goes on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bezel {
    /// The gap that the wall file asks for, across and down, in metres.
    pub asked_m: DVec2,
    /// The gap in force: the nearest even numbers of pixels.
    pub pixels: UVec2,
}

impl Screen {
    /// A screen without bezels.
    pub fn new(name: &str, surface: Surface, canvas: UVec2) -> Self {
        Self { name: name.to_owned(), surface, canvas, bezel: None }
    }

    /// The screen's plane, if it is one.
    pub fn plane(&self) -> Option<&Plane> {
        match &self.surface {
            Surface::Plane(plane) => Some(plane),
            _ => None,
        }
    }

    /// Width and height in metres, along the surface.
    pub fn size_m(&self) -> DVec2 {
        self.surface.size_m()
    }

    /// The point of display space, in metres, at a place of the canvas in pixels from its upper
    /// left, rows downwards; beside the canvas where the surface goes on. `None` where there is
    /// no surface, or where it stands in a file.
    pub fn display_from_canvas(&self, pixel: DVec2) -> Option<DVec3> {
        self.surface.display_from_uv(pixel / self.canvas.as_dvec2())
    }

    /// The place of the canvas where a point of the surface lies.
    pub fn canvas_from_display(&self, point: DVec3) -> Option<DVec2> {
        Some(self.surface.uv_from_display(point)? * self.canvas.as_dvec2())
    }

    pub(super) fn fault(&self, file_count: usize) -> Option<String> {
        let fault = self.surface.fault(file_count)?;
        Some(format!("screen {}: {fault}", self.name))
    }
}
