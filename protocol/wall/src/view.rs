//! Views: which part of a channel shows which camera, and what it is drawn with; pure f64.
//!
//! A view that is a camera's own picture fills its window, a rectangle of a plane screen, as it
//! would fill a display of that size: its frustum is centred on the window, wherever the viewer
//! is, and both eyes see the same. Tiles that the window spans share its matrix, and shift its
//! viewport by whole pixels.
//!
//! On screens that are curved, and on channels that are bent, the window is a rectangle of the
//! screen's canvas, and its picture lies on it as a sheet of paper would: of a cylinder, arc by
//! height; of a dome, azimuth by elevation, with the sides that it has in its middle.

mod overlay_mesh;

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, UVec2};
use polyptych_text::{counted, text_of_peer};
use serde::{Deserialize, Serialize};

use super::frustum::{ChannelFrustum, FrustumError, ScreenFrustum};
use super::{Channel, ChannelKind, FrustumMode, Screen, Surface, Wall};
use crate::ChannelId;
use crate::camera::Camera;
use crate::limits::{SHARED_CANVAS_SIDE_MAX, VIEW_PARTS_MAX, VIEWS_MAX};

pub use overlay_mesh::{CanvasRect, PointSpace};

/// The far end of depth in parallel rays, in metres behind the near plane, until it is fitted to
/// the scene.
pub const PARALLEL_DEPTH_M: f64 = 1e6;

/// Maximum distance between the planes of two screens that count as one, as a share of their size.
const ONE_PLANE_SHARE: f64 = 1e-6;

/// A camera's picture on a part of the wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// The pose of display space in the world.
    pub camera: Camera,
    /// The part of the wall.
    pub area: Area,
    /// The projection of the camera's view onto the part.
    pub projection: ViewProjection,
    /// The number of the only node of the scene that is shown, with all that hangs from it; all are
    /// if `None`, and nothing once that node is removed. Lights outside of it shine into it.
    pub root: Option<u64>,
    /// The names of the layers that are shown, whether the scene shows or hides them; those that
    /// the scene shows if `None`. What is in no layer is always shown.
    #[serde(default, deserialize_with = "text_of_peer")]
    pub layers: Option<Vec<String>>,
}

/// The projection of a camera's view onto a part of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ViewProjection {
    /// A window: the part shows what the viewer's eyes see through it.
    Wall,
    /// A camera's own picture, independent of the viewer's eyes: the camera stands at the origin of
    /// display space and looks along its −Z through the middle of the part.
    Perspective {
        /// From the lower to the upper edge of the part, in radians.
        fov_y_rad: f64,
    },
    /// An orthographic projection.
    Orthographic {
        /// The height that the part shows, in metres of display space.
        height_m: f64,
    },
}

impl View {
    /// A camera's picture on the whole wall, as through a window.
    pub fn of_wall(camera: Camera) -> Self {
        let projection = ViewProjection::Wall;
        Self { camera, area: Area::Wall, projection, root: None, layers: None }
    }
}

/// A part of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Area {
    /// All screens.
    Wall,
    /// A rectangle of one screen's canvas, in pixels from its upper left.
    Screen {
        /// An index into the wall's screens.
        screen: u16,
        /// x, y, width, height.
        rect: [u32; 4],
    },
}

/// The reason why views cannot be shown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// More than a frame may have.
    #[error("{0} views, where {VIEWS_MAX} can be, the wall's own among them")]
    TooMany(usize),
    /// Its camera is invalid.
    #[error("{0}")]
    Camera(String),
    /// The angle or the height of a camera's own picture.
    #[error("{what} of {value} {unit}, where {right} can be")]
    Projection {
        /// The name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The unit of `value`.
        unit: &'static str,
        /// The accepted range.
        right: &'static str,
    },
    /// The wall has fewer screens.
    #[error(
        "the wall has {} and none of number {screen}; they count from 0",
        counted(count, "screen")
    )]
    NoScreen {
        /// The requested screen.
        screen: u16,
        /// The number of the wall's screens.
        count: usize,
    },
    /// A window that is not on its screen.
    #[error(
        "the rectangle {rect:?} is not on screen {screen}; x, y, width and height lie within \
         {} × {} pixels", .canvas.x, .canvas.y
    )]
    Rectangle {
        /// The screen's name.
        screen: String,
        /// The requested rectangle.
        rect: [u32; 4],
        /// The screen's.
        canvas: UVec2,
    },
    /// A window on pixels whose places on the canvas nothing says.
    #[error(
        "channel {channel}: nothing says which pixels of screen {screen} it shows, since its warp \
         and that screen are both points of files; rectangles and cameras of their own need a \
         warp of u, v, or a screen that is a plane, a cylinder or a sphere"
    )]
    NoCanvas {
        /// The screen's name.
        screen: String,
        /// The channel's name.
        channel: String,
    },
    /// A camera's own picture over screens that stand at an angle.
    #[error(
        "screens {first} and {second} do not lie in one plane, in one size of pixels: name one"
    )]
    NotOnePlane {
        /// A screen's name.
        first: String,
        /// Another screen's name.
        second: String,
    },
    /// So many views lie over each other that a channel falls to pieces.
    #[error(
        "the views divide channel {channel} into more than {VIEW_PARTS_MAX} rectangles; lay fewer \
         over each other"
    )]
    Parts {
        /// The channel's name.
        channel: String,
    },
    /// The wall cannot be seen from this eye.
    #[error(transparent)]
    Frustum(#[from] FrustumError),
}

/// A rectangle of a channel that shows one view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewRect {
    /// An index into the frame's views.
    pub view: usize,
    /// x, y, width, height in pixels of the channel.
    pub rect: [u32; 4],
}

impl Wall {
    /// Checks that these views can be shown, from every eye that the wall can be seen from.
    ///
    /// # Errors
    /// The fault of the first that cannot, with the accepted range.
    pub fn check_views(&self, views: &[View]) -> Result<(), ViewError> {
        if views.len() > VIEWS_MAX {
            return Err(ViewError::TooMany(views.len()));
        }
        views.iter().try_for_each(|view| self.check_view(view))?;
        let ids = self.channel_ids().zip(&self.channels);
        let mut tiles = ids.filter(|(_, channel)| !self.is_warped(channel));
        tiles.try_for_each(|(id, _)| self.view_rects(id, views).map(|_| ()))
    }

    fn check_view(&self, view: &View) -> Result<(), ViewError> {
        if let Some(fault) = view.camera.fault() {
            return Err(ViewError::Camera(fault));
        }
        view.projection.check()?;
        let is_own = view.projection != ViewProjection::Wall;
        match view.area {
            Area::Screen { screen: index, rect } => {
                let count = self.screens.len();
                let none = ViewError::NoScreen { screen: index, count };
                let screen = self.screens.get(usize::from(index)).ok_or(none)?;
                let [x, y, width, height] = rect;
                let fits = |from: u32, length: u32, side: u32| {
                    length > 0 && from.checked_add(length).is_some_and(|end| end <= side)
                };
                let canvas = screen.canvas;
                if !(fits(x, width, canvas.x) && fits(y, height, canvas.y)) {
                    let screen = screen.name.clone();
                    return Err(ViewError::Rectangle { screen, rect, canvas });
                }
                self.check_canvas(index)
            }
            Area::Wall if is_own => {
                (0u16..).zip(&self.screens).try_for_each(|(index, _)| self.check_canvas(index))?;
                let mut pairs = self.screens.windows(2);
                pairs.try_for_each(|pair| in_one_plane(&pair[0], &pair[1]))
            }
            Area::Wall => Ok(()),
        }
    }

    /// Checks that it is known which pixels of the screen's canvas its channels show.
    fn check_canvas(&self, index: u16) -> Result<(), ViewError> {
        let screen = &self.screens[usize::from(index)];
        if !matches!(screen.surface, Surface::Mesh(_)) {
            return Ok(());
        }
        let has_no_canvas = |channel: &&Channel| {
            channel.screen == index
                && (channel.cover != ChannelKind::Tile || channel.adjustment.warp.is_some())
        };
        self.channels.iter().find(has_no_canvas).map_or(Ok(()), |channel| {
            let (screen, channel) = (screen.name.clone(), channel.name.clone());
            Err(ViewError::NoCanvas { screen, channel })
        })
    }

    /// Returns whether a channel's pixels are not those of its screen's canvas, one to one, so that
    /// views are resampled for it ([`crate::wall_geometry::ResolvedWall::overlay_mesh`]).
    pub fn is_warped(&self, channel: &Channel) -> bool {
        channel.is_warped() || self.screen_of(channel).plane().is_none()
    }

    /// Returns the parts of a frame's views that a channel shows: disjoint rectangles; where views
    /// overlap, those of the later one.
    ///
    /// # Errors
    /// [`ViewError::Parts`] if there would be too many.
    pub fn view_rects(&self, id: ChannelId, views: &[View]) -> Result<Vec<ViewRect>, ViewError> {
        let Some(channel) = self.channel(id) else { return Ok(Vec::new()) };
        let rects: Vec<_> = views.iter().map(|view| channel.covered_by(&view.area)).collect();
        let mut parts = Vec::new();
        for (view, rect) in rects.iter().enumerate() {
            let mut left: Vec<_> = rect.iter().copied().collect();
            for over in rects[view + 1..].iter().flatten() {
                left = left.into_iter().flat_map(|rect| without(rect, *over)).collect();
                if left.len() > VIEW_PARTS_MAX {
                    break;
                }
            }
            parts.extend(left.into_iter().map(|rect| ViewRect { view, rect }));
            if parts.len() > VIEW_PARTS_MAX {
                return Err(ViewError::Parts { channel: channel.name.clone() });
            }
        }
        Ok(parts)
    }

    /// Returns the frustum with which a channel draws a view. A camera's own picture is drawn from
    /// the origin of display space, whatever the viewer's eye.
    ///
    /// # Errors
    /// Those of [`Wall::frustum`] for an eye, and of [`Wall::check_views`] for a camera's picture.
    pub fn view_frustum(
        &self,
        id: ChannelId,
        view: &View,
        eye_in_display: DVec3,
    ) -> Result<ChannelFrustum, ViewError> {
        if view.projection == ViewProjection::Wall {
            return Ok(self.frustum(id, eye_in_display)?);
        }
        self.check_view(view)?;
        let channel = self.channel(id).ok_or(FrustumError::NoChannel(id))?;
        let window = self.window(channel, &view.area)?;
        let size = channel.size.as_dvec2();
        let [x, y, width, height] = window.viewport;
        let is_shared = channel.projection == FrustumMode::Shared
            && width.max(height) <= f64::from(SHARED_CANVAS_SIDE_MAX);
        let (part, viewport) = if is_shared {
            ([DVec2::ZERO, DVec2::ONE], window.viewport)
        } else {
            let begin = DVec2::new(-x, -y) / DVec2::new(width, height);
            let end = begin + size / DVec2::new(width, height);
            ([begin, end], [0.0, 0.0, size.x, size.y])
        };
        Ok(ChannelFrustum {
            clip_from_view: view.projection.clip_from_view(window.size_m, part, self.near_m),
            view_from_display: DMat3::IDENTITY,
            eye: DVec3::ZERO,
            viewport,
            near_m: self.near_m,
        })
    }

    /// The part of its screen's canvas that an area covers on a channel. It was checked.
    ///
    /// # Errors
    /// Screens that do not lie in one plane.
    pub fn canvas_rect(&self, channel: &Channel, area: &Area) -> Result<CanvasRect, ViewError> {
        self.canvas_rect_of(self.screen_of(channel), area)
    }

    /// Returns [`Wall::canvas_rect`] for a screen.
    pub(crate) fn canvas_rect_of(
        &self,
        screen: &Screen,
        area: &Area,
    ) -> Result<CanvasRect, ViewError> {
        let (begin, end) = match *area {
            Area::Screen { rect: [x, y, width, height], .. } => {
                let begin = UVec2::new(x, y).as_dvec2();
                (begin, begin + UVec2::new(width, height).as_dvec2())
            }
            // Around all screens, in pixels of this one.
            Area::Wall if self.screens.len() > 1 => {
                let far = DVec2::splat(f64::INFINITY);
                let around = self.screens.iter().try_fold((far, -far), |(least, most), other| {
                    let corners = [DVec2::ZERO, other.canvas.as_dvec2()]
                        .map(|at| screen.canvas_from_display(other.display_from_canvas(at)?));
                    let [upper_left, lower_right] = corners;
                    Some((least.min(upper_left?), most.max(lower_right?)))
                });
                let name = || screen.name.clone();
                around.ok_or_else(|| ViewError::NotOnePlane { first: name(), second: name() })?
            }
            Area::Wall => (DVec2::ZERO, screen.canvas.as_dvec2()),
        };
        Ok(CanvasRect { begin, end })
    }

    /// Returns the rectangle of an area's window in a channel's pixels. The area was checked.
    fn window(&self, channel: &Channel, area: &Area) -> Result<OverlayRect, ViewError> {
        let part = self.canvas_rect(channel, area)?;
        let (at, size) = (part.begin - channel.origin.as_dvec2(), part.end - part.begin);
        let size_m = self.screen_of(channel).part_size_m(&part);
        Ok(OverlayRect { size_m, viewport: [at.x, at.y, size.x, size.y] })
    }

    /// The matrix with which a part of a camera's own picture is drawn, reversed in depth: from
    /// its upper left to its lower right, in pixels of the canvas from those of the picture's.
    pub fn overlay_matrix(
        &self,
        channel: &Channel,
        view: &View,
        whole: &CanvasRect,
        part: [DVec2; 2],
    ) -> DMat4 {
        let size_m = self.screen_of(channel).part_size_m(whole);
        let share = part.map(|at| at / (whole.end - whole.begin));
        view.projection.clip_from_view(size_m, share, self.near_m)
    }
}

impl Screen {
    /// Width and height in metres of a part of the canvas as it lies on the surface, measured
    /// across and down its middle; those of pixels where the surface stands in a file, whose
    /// pixels count as square.
    pub(crate) fn part_size_m(&self, part: &CanvasRect) -> DVec2 {
        let (canvas, size) = (self.canvas.as_dvec2(), part.end - part.begin);
        let size_m = match &self.surface {
            Surface::Mesh(_) => return size,
            Surface::Sphere(sphere) => {
                let [bottom, top] = sphere.elevation_rad;
                let v = f64::midpoint(part.begin.y, part.end.y) / canvas.y;
                // Circles of latitude are shorter towards the pole.
                DVec2::new((top + (bottom - top) * v).cos(), 1.0) * self.size_m()
            }
            _ => self.size_m(),
        };
        size_m * size / canvas
    }
}

/// The part of the wall that one camera's own picture fills.
struct OverlayRect {
    size_m: DVec2,
    /// x, y, width and height in pixels of a channel.
    viewport: [f64; 4],
}

impl ViewProjection {
    fn check(self) -> Result<(), ViewError> {
        match self {
            Self::Perspective { fov_y_rad: value }
                if !(value > 0.0 && value < std::f64::consts::PI) =>
            {
                let (what, right) = ("a field of view", "an angle between 0 and π");
                Err(ViewError::Projection { what, value, unit: "rad", right })
            }
            Self::Orthographic { height_m: value } if !(value > 0.0 && value.is_finite()) => {
                let (what, right) = ("a height", "a number above 0");
                Err(ViewError::Projection { what, value, unit: "m", right })
            }
            _ => Ok(()),
        }
    }

    /// The matrix of a part, from begin to end, of a window: reversed, with a far plane for
    /// parallel rays only, whose w is 1 everywhere.
    fn clip_from_view(self, size_m: DVec2, [begin, end]: [DVec2; 2], near_m: f64) -> DMat4 {
        let (scale, distance_m) = match self {
            Self::Perspective { fov_y_rad } => (1.0, 0.5 * size_m.y / (0.5 * fov_y_rad).tan()),
            Self::Orthographic { height_m } => (height_m / size_m.y, 1.0),
            Self::Wall => (1.0, 1.0),
        };
        let half = size_m * (0.5 * scale);
        let edges_m = [-half.x, half.x, -half.y, half.y];
        let view_from_display = DMat3::IDENTITY;
        let part = ScreenFrustum { view_from_display, distance_m, edges_m }.sub_frustum(begin, end);
        if !matches!(self, Self::Orthographic { .. }) {
            return part.clip_from_view(near_m);
        }
        let [left, right, bottom, top] = part.edges_m;
        let (width, height) = (right - left, top - bottom);
        let far_m = near_m + PARALLEL_DEPTH_M;
        DMat4::from_cols(
            DVec4::X * (2.0 / width),
            DVec4::Y * (2.0 / height),
            DVec4::Z * PARALLEL_DEPTH_M.recip(),
            DVec4::new(
                -(right + left) / width,
                -(top + bottom) / height,
                far_m / PARALLEL_DEPTH_M,
                1.0,
            ),
        )
    }
}

impl Channel {
    /// The rectangle of the channel that an area covers, if any.
    fn covered_by(&self, area: &Area) -> Option<[u32; 4]> {
        let Area::Screen { screen, rect: [x, y, width, height] } = *area else {
            return Some([0, 0, self.size.x, self.size.y]);
        };
        let (origin, end) = (self.origin, self.origin + self.size);
        let (left, top) = (x.max(origin.x), y.max(origin.y));
        let right = x.saturating_add(width).min(end.x);
        let bottom = y.saturating_add(height).min(end.y);
        let is_covered = screen == self.screen && left < right && top < bottom;
        is_covered.then(|| [left - origin.x, top - origin.y, right - left, bottom - top])
    }
}

/// Returns the parts of a rectangle beside another one: above, below, left and right of it.
fn without(rect: [u32; 4], over: [u32; 4]) -> Vec<[u32; 4]> {
    let ends = |[x, y, width, height]: [u32; 4]| [x, y, x + width, y + height];
    let ([x0, y0, x1, y1], [ox0, oy0, ox1, oy1]) = (ends(rect), ends(over));
    let (left, top, right, bottom) = (x0.max(ox0), y0.max(oy0), x1.min(ox1), y1.min(oy1));
    if left >= right || top >= bottom {
        return vec![rect];
    }
    let beside = [
        [x0, y0, x1, top],
        [x0, bottom, x1, y1],
        [x0, top, left, bottom],
        [right, top, x1, bottom],
    ];
    let is_some = |[x0, y0, x1, y1]: &[u32; 4]| x0 < x1 && y0 < y1;
    let sized = |[x0, y0, x1, y1]: [u32; 4]| [x0, y0, x1 - x0, y1 - y0];
    beside.into_iter().filter(is_some).map(sized).collect()
}

fn in_one_plane(first: &Screen, second: &Screen) -> Result<(), ViewError> {
    let is_one = (|| {
        let (a, b) = (first.frustum(DVec3::ZERO)?, second.frustum(DVec3::ZERO)?);
        let size_m = first.size_m().max(second.size_m()).max_element();
        let apart_m = (a.distance_m - b.distance_m).abs();
        let turned = a.view_from_display - b.view_from_display;
        let pitch = |screen: &Screen| screen.size_m() / screen.canvas.as_dvec2();
        let is_even = (pitch(first) / pitch(second) - 1.0).abs().max_element() < ONE_PLANE_SHARE;
        let turned = turned.to_cols_array().into_iter().fold(0.0, |most: f64, t| most.max(t.abs()));
        Some(apart_m < ONE_PLANE_SHARE * size_m && turned < ONE_PLANE_SHARE && is_even)
    })();
    if is_one == Some(true) {
        return Ok(());
    }
    let (first, second) = (first.name.clone(), second.name.clone());
    Err(ViewError::NotOnePlane { first, second })
}

#[cfg(test)]
mod tests;
