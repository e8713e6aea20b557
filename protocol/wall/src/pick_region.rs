//! The pyramid in the world that a rectangle of the wall shows, in f64.

use glam::{DVec2, DVec3};

use crate::head::HeadPose;
use crate::pick_ray::{PickError, Ray};
use crate::region::{HalfSpace, Region};
use crate::view::{Area, View, ViewProjection};
use crate::{Surface, Wall};

impl Wall {
    /// Returns the region that a rectangle of a screen shows, from its upper left to its lower
    /// right corner in pixels, as [`Wall::pick_ray`] counts them: a pyramid from the eye that goes
    /// on without an end, or of a view in parallel rays a prism from its camera's plane. The near
    /// plane is not a side of it: what stands between it and the eye is in the region.
    ///
    /// # Errors
    /// [`PickError`]; also if the rectangle is empty, if more than one view is shown in it, or if
    /// it is seen through a screen that is not a plane, where its sides are no planes.
    pub fn pick_region(
        &self,
        views: &[View],
        head: &HeadPose,
        screen: &str,
        [begin, end]: [DVec2; 2],
    ) -> Result<Region, PickError> {
        if !begin.cmplt(end).all() {
            return Err(PickError::EmptyRectangle { begin, end });
        }
        let mut screens = self.screens.iter().enumerate();
        if let Some((index, known)) = screens.find(|(_, known)| known.name == screen) {
            let view = only_view(views, index, [begin, end])?;
            let is_window = view.is_none_or(|view| view.projection == ViewProjection::Wall);
            if is_window && !matches!(known.surface, Surface::Plane(_)) {
                return Err(PickError::Curved(known.name.clone()));
            }
        }
        // Around the rectangle, as the screen is seen from its front.
        let corners = [begin, DVec2::new(begin.x, end.y), end, DVec2::new(end.x, begin.y)];
        let mut rays = Vec::with_capacity(corners.len());
        for corner in corners {
            // The last row and column end where the view does.
            let inner =
                corner.clamp(begin, end.with_x(end.x.next_down()).with_y(end.y.next_down()));
            rays.push(self.pick_ray(views, head, screen, inner)?);
        }
        Ok(Region::Convex(sides(&rays)?))
    }
}

/// The view of which alone a rectangle shows a part; `None` is the wall's own picture, where no
/// view was laid.
fn only_view(
    views: &[View],
    screen: usize,
    [begin, end]: [DVec2; 2],
) -> Result<Option<&View>, PickError> {
    for view in views.iter().rev() {
        let Area::Screen { screen: index, rect: [x, y, width, height] } = view.area else {
            return Ok(Some(view));
        };
        let low = DVec2::new(x.into(), y.into());
        let high = low + DVec2::new(width.into(), height.into());
        let is_beside = (low.cmpge(end) | high.cmple(begin)).any();
        if usize::from(index) == screen && !is_beside {
            let is_whole = low.cmple(begin).all() && high.cmpge(end).all();
            return if is_whole { Ok(Some(view)) } else { Err(PickError::SeveralViews) };
        }
    }
    Ok(None)
}

/// The planes between neighbouring rays, and where they all begin in different points, the plane
/// through these.
fn sides(rays: &[Ray]) -> Result<Vec<HalfSpace>, PickError> {
    let middle = rays.iter().map(|ray| ray.at(1.0)).sum::<DVec3>() / rays.len() as f64;
    let mut planes = Vec::with_capacity(rays.len() + 1);
    for (one, next) in rays.iter().zip(rays.iter().cycle().skip(1)) {
        let along = next.at(1.0) - one.at(1.0);
        planes.push(side(along.cross(one.direction), one.origin, middle)?);
    }
    let [first, second, third, ..] = rays else { return Ok(planes) };
    let floor = (second.origin - first.origin).cross(third.origin - first.origin);
    if floor != DVec3::ZERO {
        planes.push(side(floor, first.origin, middle)?);
    }
    Ok(planes)
}

/// The half space of a plane through a point on whose one side the other point lies.
fn side(normal: DVec3, through: DVec3, inner: DVec3) -> Result<HalfSpace, PickError> {
    // The eye may stand in the plane of the screen.
    let normal = normal.try_normalize().ok_or(PickError::NoDirection)?;
    let normal = if normal.dot(inner - through) > 0.0 { -normal } else { normal };
    Ok(HalfSpace { normal, offset: normal.dot(through) })
}
