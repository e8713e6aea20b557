//! From an eye and a screen to the matrices that a channel is drawn with; pure f64.
//!
//! ```text
//!      c ┌───────────────┐           a, b, c: lower left, lower right, upper left
//!        │               │           r = unit(b − a), u = unit(c − a) ⟂ r, n = r × u
//!        │    screen     │ ↑ u       d = −n·(a − e): how far the eye e stands before the screen
//!        │               │           view space: x along r, y along u, z along n, e at the origin
//!      a └───────────────┘ b
//!               → r                  n points at the viewer
//! ```
//!
//! Robert Kooima, *Generalized Perspective Projection*, 2008; here with reversed depth and the
//! far plane at infinity, so that no near and far need tuning.

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use super::{Channel, FrustumMode, Screen, Wall};
use crate::ChannelId;

/// An eye nearer to a screen's plane than this is in it: a nanometre is beneath what f64 can
/// tell apart some kilometres from the origin of display space.
pub const EYE_DISTANCE_MIN_M: f64 = 1e-9;

/// The reason why there is no frustum.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FrustumError {
    /// The wall has no channel of this id, or the channel names no screen of the wall.
    #[error("the wall has no channel {} that lies on a screen", .0.0)]
    NoChannel(ChannelId),
    /// The screen's corners span no rectangle.
    #[error("channel {channel}: the corners of screen {screen} span no rectangle")]
    NoRectangle {
        /// The channel's name.
        channel: String,
        /// The screen's name.
        screen: String,
    },
    /// The screen is no plane: its channels are drawn in planes that cover it, and warped.
    #[error("channel {channel}: screen {screen} is curved, and has no frustum of its own")]
    Curved {
        /// The channel's name.
        channel: String,
        /// The screen's name.
        screen: String,
    },
    /// Rays from the eye to the screen all lie in its plane.
    #[error("channel {channel}: the eye {eye} m is in the plane of screen {screen}")]
    EyeInPlane {
        /// The channel's name.
        channel: String,
        /// The screen's name.
        screen: String,
        /// In metres of display space.
        eye: DVec3,
        /// From the plane, in metres; negative behind it.
        distance_m: f64,
    },
    /// The eye sees the screen's back.
    #[error(
        "channel {channel}: the eye {eye} m is {:.6} m behind screen {screen}", -.distance_m
    )]
    EyeBehind {
        /// The channel's name.
        channel: String,
        /// The screen's name.
        screen: String,
        /// In metres of display space.
        eye: DVec3,
        /// From the plane, in metres; negative.
        distance_m: f64,
    },
    /// The eye is not finite, or so far away that the matrix would not be.
    #[error("channel {channel}: the eye {eye} m is not a point that a screen is seen from")]
    EyeTooFar {
        /// The channel's name.
        channel: String,
        /// In metres of display space.
        eye: DVec3,
    },
}

/// A screen as an eye sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenFrustum {
    /// Rows r, u, n: turns display space into view space.
    pub view_from_display: DMat3,
    /// From the eye to the screen's plane in metres; above 0 in front of it.
    pub distance_m: f64,
    /// The screen's left, right, bottom and top edges in metres, from the point of its plane that
    /// is nearest to the eye.
    pub edges_m: [f64; 4],
}

/// The frustum that one channel is drawn with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelFrustum {
    /// Off-axis perspective into wgpu's clip space: z/w is 1 at the near plane, 0 at infinity.
    pub clip_from_view: DMat4,
    /// Turns a vector from the eye in display space into view space, whose −Z looks at the screen.
    pub view_from_display: DMat3,
    /// In metres of display space.
    pub eye: DVec3,
    /// The rectangle of the matrix's picture in this channel's target: x, y, width, height in
    /// pixels. The whole canvas, shifted, for [`FrustumMode::Shared`]; the target for
    /// [`FrustumMode::Own`].
    pub viewport: [f64; 4],
    /// The near plane's distance in metres of display space.
    pub near_m: f64,
}

impl ScreenFrustum {
    /// Left, right, bottom and top of the frustum on a near plane, in metres: Kooima's
    /// `l = r·(a − e)·near/d` and so on.
    pub fn near_edges_m(&self, near_m: f64) -> [f64; 4] {
        self.edges_m.map(|edge| edge * near_m / self.distance_m)
    }

    /// The part of the screen from `begin` to `end`, as fractions of the canvas from its upper
    /// left, with the same axes and distance.
    pub(super) fn sub_frustum(&self, begin: DVec2, end: DVec2) -> Self {
        let [left, right, bottom, top] = self.edges_m;
        let x = |t: f64| left + (right - left) * t;
        let y = |t: f64| top + (bottom - top) * t;
        Self { edges_m: [x(begin.x), x(end.x), y(end.y), y(begin.y)], ..*self }
    }

    /// The off-axis matrix, reversed and without a far plane. Written with the plane's metres
    /// instead of the near plane's, which cancels `near / d` from the first two rows.
    pub(super) fn clip_from_view(&self, near_m: f64) -> DMat4 {
        let [left, right, bottom, top] = self.edges_m;
        let (width, height) = (right - left, top - bottom);
        DMat4::from_cols(
            DVec4::new(2.0 * self.distance_m / width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0 * self.distance_m / height, 0.0, 0.0),
            DVec4::new((right + left) / width, (top + bottom) / height, 0.0, -1.0),
            DVec4::new(0.0, 0.0, near_m, 0.0),
        )
    }
}

impl ChannelFrustum {
    /// The pixel of the channel's target that shows a point of display space: x to the right, y
    /// down, (0, 0) the upper left corner of the upper left pixel. It may lie outside the target.
    /// `None` for a point beside or behind the eye.
    pub fn pixel_from_display(&self, point: DVec3) -> Option<DVec2> {
        let clip = self.clip_from_view * (self.view_from_display * (point - self.eye)).extend(1.0);
        if clip.w.is_nan() || clip.w <= 0.0 {
            return None;
        }
        let [x, y, width, height] = self.viewport;
        let from_upper_left = DVec2::new(0.5 + 0.5 * clip.x / clip.w, 0.5 - 0.5 * clip.y / clip.w);
        let pixel = DVec2::new(x, y) + from_upper_left * DVec2::new(width, height);
        pixel.is_finite().then_some(pixel)
    }
}

impl Screen {
    /// The screen as this eye, in metres of display space, sees it: from the front or from behind
    /// (a negative distance). `None` where the corners span no rectangle, or it is curved.
    pub fn frustum(&self, eye_in_display: DVec3) -> Option<ScreenFrustum> {
        let plane = self.plane()?;
        let (a, b, c) = (plane.lower_left, plane.lower_right, plane.upper_left);
        let r = (b - a).try_normalize()?;
        // Corners were measured by someone: u is made exactly square to r.
        let u = ((c - a) - r * r.dot(c - a)).try_normalize()?;
        let n = r.cross(u);
        let (to_a, to_b, to_c) = (a - eye_in_display, b - eye_in_display, c - eye_in_display);
        Some(ScreenFrustum {
            view_from_display: DMat3::from_cols(r, u, n).transpose(),
            distance_m: -n.dot(to_a),
            edges_m: [r.dot(to_a), r.dot(to_b), u.dot(to_a), u.dot(to_c)],
        })
    }
}

impl Wall {
    /// Returns the frustum of a channel for an eye in metres of display space.
    ///
    /// # Errors
    /// [`FrustumError`] where the channel doesn't exist, its screen is no rectangle, or the eye
    /// doesn't stand in front of it.
    pub fn frustum(
        &self,
        channel: ChannelId,
        eye_in_display: DVec3,
    ) -> Result<ChannelFrustum, FrustumError> {
        let (channel, screen) = self
            .channel(channel)
            .and_then(|c| Some((c, self.screens.get(usize::from(c.screen))?)))
            .ok_or(FrustumError::NoChannel(channel))?;
        let seen = seen_from_front(channel, screen, eye_in_display)?;
        let (canvas, origin, size) =
            (screen.canvas.as_dvec2(), channel.origin.as_dvec2(), channel.size.as_dvec2());
        let (part, viewport) = match channel.projection {
            FrustumMode::Shared => (seen, [-origin.x, -origin.y, canvas.x, canvas.y]),
            FrustumMode::Own => {
                let part = seen.sub_frustum(origin / canvas, (origin + size) / canvas);
                (part, [0.0, 0.0, size.x, size.y])
            }
        };
        let clip_from_view = part.clip_from_view(self.near_m);
        if !clip_from_view.is_finite() {
            let channel = channel.name.clone();
            return Err(FrustumError::EyeTooFar { channel, eye: eye_in_display });
        }
        Ok(ChannelFrustum {
            clip_from_view,
            view_from_display: seen.view_from_display,
            eye: eye_in_display,
            viewport,
            near_m: self.near_m,
        })
    }

    /// The pixel of a channel's target that shows a point of display space, both eye and point in
    /// metres; see [`ChannelFrustum::pixel_from_display`]. `None` where there is no frustum or the
    /// point is beside or behind the eye.
    pub fn pixel_from_display(
        &self,
        channel: ChannelId,
        eye_in_display: DVec3,
        point: DVec3,
    ) -> Option<DVec2> {
        self.frustum(channel, eye_in_display).ok()?.pixel_from_display(point)
    }
}

/// The channel's screen, once it is sure that the eye stands in front of it.
pub(super) fn seen_from_front(
    channel: &Channel,
    screen: &Screen,
    eye: DVec3,
) -> Result<ScreenFrustum, FrustumError> {
    let channel = channel.name.clone();
    let name = screen.name.clone();
    if screen.plane().is_none() {
        return Err(FrustumError::Curved { channel, screen: name });
    }
    let Some(seen) = screen.frustum(eye) else {
        return Err(FrustumError::NoRectangle { channel, screen: name });
    };
    let distance_m = seen.distance_m;
    if !distance_m.is_finite() {
        return Err(FrustumError::EyeTooFar { channel, eye });
    }
    if distance_m.abs() <= EYE_DISTANCE_MIN_M {
        return Err(FrustumError::EyeInPlane { channel, screen: name, eye, distance_m });
    }
    if distance_m < 0.0 {
        return Err(FrustumError::EyeBehind { channel, screen: name, eye, distance_m });
    }
    Ok(seen)
}

#[cfg(test)]
mod tests;
