//! Planar rectangles.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A planar rectangle in display space, in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// The lower left corner as the viewer sees it.
    pub lower_left: DVec3,
    /// The lower right corner as the viewer sees it.
    pub lower_right: DVec3,
    /// The upper left corner as the viewer sees it.
    pub upper_left: DVec3,
}

impl Plane {
    /// An upright rectangle of this width and height in metres that faces +Z.
    pub fn upright(center: DVec3, size_m: DVec2) -> Self {
        let corner = |x: f64, y: f64| center + DVec3::new(x * size_m.x, y * size_m.y, 0.0) / 2.0;
        Self {
            lower_left: corner(-1.0, -1.0),
            lower_right: corner(1.0, -1.0),
            upper_left: corner(-1.0, 1.0),
        }
    }

    /// Width and height in metres.
    pub fn size_m(&self) -> DVec2 {
        DVec2::new(
            self.lower_left.distance(self.lower_right),
            self.lower_left.distance(self.upper_left),
        )
    }

    pub(super) fn display_from_uv(&self, uv: DVec2) -> DVec3 {
        self.upper_left
            + (self.lower_right - self.lower_left) * uv.x
            + (self.lower_left - self.upper_left) * uv.y
    }

    pub(super) fn uv_from_display(&self, point: DVec3) -> Option<DVec2> {
        let (right, down) = (self.lower_right - self.lower_left, self.lower_left - self.upper_left);
        let from = point - self.upper_left;
        let uv = DVec2::new(
            from.dot(right) / right.length_squared(),
            from.dot(down) / down.length_squared(),
        );
        uv.is_finite().then_some(uv)
    }

    pub(super) fn normal(&self) -> DVec3 {
        (self.lower_right - self.lower_left).cross(self.upper_left - self.lower_left)
    }

    pub(super) fn hit(&self, from: DVec3, direction: DVec3, is_behind: bool) -> Option<DVec3> {
        let normal = if is_behind { -self.normal() } else { self.normal() };
        let toward = normal.dot(direction);
        let t = normal.dot(self.lower_left - from) / toward;
        (toward < 0.0 && t > 0.0 && t.is_finite()).then(|| from + direction * t)
    }

    pub(super) fn fault(&self) -> Option<String> {
        let corners = [self.lower_left, self.lower_right, self.upper_left];
        (!corners.iter().all(|corner| corner.is_finite())).then(|| "a corner is not finite".into())
    }
}
