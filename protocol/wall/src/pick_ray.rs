//! The ray into the world that a pixel of the wall looks along, in f64.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::head::HeadPose;
use crate::view::{Area, View, ViewError, ViewProjection};
use crate::{Screen, Wall};

/// A half line in world space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ray {
    /// The point from which it starts.
    pub origin: DVec3,
    /// Its direction; of any length but 0.
    pub direction: DVec3,
}

impl Ray {
    /// The point at so many times the direction from the origin.
    pub fn at(&self, times: f64) -> DVec3 {
        self.origin + self.direction * times
    }
}

/// The reason why there is no ray.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PickError {
    /// There is no such screen.
    #[error("the wall has no screen {name:?}; it has {all}")]
    NoScreen {
        /// The requested name.
        name: String,
        /// The names that there are.
        all: String,
    },
    /// The pixel is not on the screen.
    #[error("{pixel} is not on screen {name}, which has {} × {} pixels", .canvas.x, .canvas.y)]
    OffScreen {
        /// The requested pixel.
        pixel: DVec2,
        /// The screen.
        name: String,
        /// Its size.
        canvas: glam::UVec2,
    },
    /// The screen's shape stands in a file.
    #[error("screen {0} is a mesh, whose points are not known here")]
    Mesh(String),
    /// The eye is on the screen itself.
    #[error("the viewer's eye is at that very point of the screen")]
    NoDirection,
    /// A rectangle without pixels.
    #[error("the rectangle from {begin} to {end} is empty; give its upper left corner first")]
    EmptyRectangle {
        /// Its upper left corner, in pixels.
        begin: DVec2,
        /// Its lower right corner, in pixels.
        end: DVec2,
    },
    /// A rectangle over a border between views.
    #[error("the rectangle shows more than one view; give one that lies in a single view")]
    SeveralViews,
    /// A rectangle of a screen whose rays through a line are not in one plane.
    #[error("screen {0} is not a plane, so its rectangles show no pyramid; pick pixels of it")]
    Curved(String),
    /// No view is shown there, or one that cannot be.
    #[error("{0}")]
    View(#[from] ViewError),
}

impl Wall {
    /// The ray that a pixel of a screen shows: from the eye, which stands between the viewer's,
    /// through the place of the pixel on the screen; or from the camera of the last of these views
    /// that covers it. Pixels count from the upper left corner of the screen; the middle of the
    /// first is (0.5, 0.5).
    ///
    /// # Errors
    /// [`PickError`].
    pub fn pick_ray(
        &self,
        views: &[View],
        head: &HeadPose,
        screen: &str,
        pixel: DVec2,
    ) -> Result<Ray, PickError> {
        let found = self.screens.iter().position(|known| known.name == screen);
        let Some(index) = found else {
            let all: Vec<_> = self.screens.iter().map(|known| known.name.as_str()).collect();
            return Err(PickError::NoScreen { name: screen.to_owned(), all: all.join(", ") });
        };
        let screen = &self.screens[index];
        let size = screen.canvas.as_dvec2();
        if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(size).all()) {
            let (name, canvas) = (screen.name.clone(), screen.canvas);
            return Err(PickError::OffScreen { pixel, name, canvas });
        }
        let own = View::of_wall(crate::camera::Camera::IDENTITY);
        let view = last_over(views, index, pixel).unwrap_or(&own);
        let ray = self.view_ray(view, head, screen, pixel)?;
        if ray.direction.length_squared() > 0.0 { Ok(ray) } else { Err(PickError::NoDirection) }
    }

    /// The last of these views that covers a pixel of a screen, as [`Wall::pick_ray`] counts them.
    pub fn view_at<'a>(&self, views: &'a [View], screen: &str, pixel: DVec2) -> Option<&'a View> {
        let screen = self.screens.iter().position(|known| known.name == screen)?;
        last_over(views, screen, pixel)
    }

    fn view_ray(
        &self,
        view: &View,
        head: &HeadPose,
        screen: &Screen,
        pixel: DVec2,
    ) -> Result<Ray, PickError> {
        let world = |display: DVec3| view.camera.world_from_display(display);
        if view.projection == ViewProjection::Wall {
            let mesh = || PickError::Mesh(screen.name.clone());
            let point = world(screen.display_from_canvas(pixel).ok_or_else(mesh)?);
            let origin = world(head.position);
            return Ok(Ray { origin, direction: point - origin });
        }
        let window = self.canvas_rect_of(screen, &view.area)?;
        let size_m = screen.part_size_m(&window);
        let part = (pixel - window.begin) / (window.end - window.begin);
        // From the middle of the window, in heights of it; y up.
        let at = DVec2::new((part.x - 0.5) * size_m.x / size_m.y, 0.5 - part.y);
        let [from, through] = match view.projection {
            ViewProjection::Perspective { fov_y_rad } => {
                let at = at * 2.0 * (fov_y_rad / 2.0).tan();
                [DVec3::ZERO, at.extend(-1.0)]
            }
            ViewProjection::Orthographic { height_m } => {
                let at = at * height_m;
                [at.extend(0.0), at.extend(-1.0)]
            }
            ViewProjection::Wall => [DVec3::ZERO; 2],
        };
        let origin = world(from);
        Ok(Ray { origin, direction: world(through) - origin })
    }
}

fn last_over(views: &[View], screen: usize, pixel: DVec2) -> Option<&View> {
    let covers = |view: &&View| match view.area {
        Area::Wall => true,
        Area::Screen { screen: of, rect: [x, y, width, height] } => {
            let begin = DVec2::new(x.into(), y.into());
            let end = begin + DVec2::new(width.into(), height.into());
            usize::from(of) == screen && pixel.cmpge(begin).all() && pixel.cmplt(end).all()
        }
    };
    views.iter().rev().find(covers)
}
