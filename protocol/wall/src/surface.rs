//! Surfaces of screens, all with one parametrisation: (u, v), from (0, 0) at the upper left to
//! (1, 1) at the lower right as the viewer sees it, and beyond where the surface goes on.

pub mod cylinder;
mod eye_distance;
pub mod plane;
pub mod sphere;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

pub use cylinder::Cylinder;
pub use plane::Plane;
pub use sphere::Sphere;

/// The position and the curvature of a screen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Surface {
    /// A rectangle.
    Plane(Plane),
    /// A patch of a cylinder, upright unless it is turned.
    Cylinder(Cylinder),
    /// A patch of a sphere.
    Sphere(Sphere),
    /// A mesh whose texture coordinates are (u, v): an index into
    /// [`Wall::files`](super::Wall::files).
    Mesh(u16),
}

impl Surface {
    /// The point of display space, in metres, at (u, v). `None` for a mesh: its file has it.
    pub fn display_from_uv(&self, uv: DVec2) -> Option<DVec3> {
        match self {
            Self::Plane(plane) => Some(plane.display_from_uv(uv)),
            Self::Cylinder(cylinder) => Some(cylinder.display_from_uv(uv)),
            Self::Sphere(sphere) => Some(sphere.display_from_uv(uv)),
            Self::Mesh(_) => None,
        }
    }

    /// The (u, v) of a point that lies on the surface, or of the foot of one that does not.
    pub fn uv_from_display(&self, point: DVec3) -> Option<DVec2> {
        match self {
            Self::Plane(plane) => plane.uv_from_display(point),
            Self::Cylinder(cylinder) => cylinder.uv_from_display(point),
            Self::Sphere(sphere) => sphere.uv_from_display(point),
            Self::Mesh(_) => None,
        }
    }

    /// Returns the point where a ray meets the patch, or the surface a little beside it, on the
    /// side that the viewer sees; for a plane, the point on the plane. `None` if it meets neither,
    /// and for a mesh.
    pub fn hit(&self, from: DVec3, direction: DVec3) -> Option<DVec3> {
        self.hit_side(from, direction, false)
    }

    /// Returns the point like [`Self::hit`], on the side that the viewer does not see if
    /// `is_behind`: the side that projectors behind a screen light.
    pub fn hit_side(&self, from: DVec3, direction: DVec3, is_behind: bool) -> Option<DVec3> {
        match self {
            Self::Plane(plane) => plane.hit(from, direction, is_behind),
            Self::Cylinder(cylinder) => cylinder.hit(from, direction, is_behind),
            Self::Sphere(sphere) => sphere.hit(from, direction, is_behind),
            Self::Mesh(_) => None,
        }
    }

    /// The surface's normal at (u, v), of length 1, on the side that the viewer sees. `None` for a
    /// mesh.
    pub fn normal(&self, uv: DVec2) -> Option<DVec3> {
        let normal = match self {
            Self::Plane(plane) => plane.normal(),
            Self::Cylinder(cylinder) => cylinder.normal(uv),
            Self::Sphere(sphere) => sphere.normal(uv),
            Self::Mesh(_) => return None,
        };
        normal.try_normalize()
    }

    /// Width and height in metres along the surface; of a sphere, along its equator and its
    /// meridian. Zero for a mesh.
    pub fn size_m(&self) -> DVec2 {
        match self {
            Self::Plane(plane) => plane.size_m(),
            Self::Cylinder(cylinder) => cylinder.size_m(),
            Self::Sphere(sphere) => sphere.size_m(),
            Self::Mesh(_) => DVec2::ZERO,
        }
    }

    pub(super) fn fault(&self, file_count: usize) -> Option<String> {
        match self {
            Self::Plane(plane) => plane.fault(),
            Self::Cylinder(cylinder) => cylinder.fault(),
            Self::Sphere(sphere) => sphere.fault(),
            Self::Mesh(file) => (usize::from(*file) >= file_count)
                .then(|| "it names a file that the wall does not have".into()),
        }
    }
}

/// Both places along a ray, in units of its direction and nearer first, at which it is as far as
/// `radius` from the origin: of p + t·d, without cancellation. `None` where it passes by.
///
/// W. Press et al., *Numerical Recipes*, §5.6.
fn crossings(pp: f64, pd: f64, dd: f64, radius: f64) -> Option<[f64; 2]> {
    let c = pp - radius * radius;
    let root = (pd * pd - dd * c).sqrt();
    let q = -(pd + pd.signum() * root);
    let (first, second) = if q == 0.0 { (0.0, 0.0) } else { (q / dd, c / q) };
    (root.is_finite() && first.is_finite() && second.is_finite())
        .then(|| [first.min(second), first.max(second)])
}

#[cfg(test)]
mod tests;
