//! From the world to pixels: a pose, an eye, and the corners of a screen; nothing else.

use glam::{DQuat, DVec2, DVec3};

/// A rectangle of a planar screen, and who looks at it.
#[derive(Clone, Copy, Debug)]
pub struct ScreenView {
    /// Lower left, lower right and upper left in metres of display space.
    pub corners: [DVec3; 3],
    /// Pixels of the whole screen.
    pub canvas: [u32; 2],
    /// The channel's upper left pixel on it.
    pub origin: [u32; 2],
    /// The channel's pixels.
    pub size: [u32; 2],
    /// In metres of display space.
    pub eye: DVec3,
    /// Metres.
    pub near_m: f64,
}

/// The placement of display space in the world.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    pub position: DVec3,
    pub rotation: DQuat,
    pub scale: f64,
}

/// A point before the division: it is seen at `(x, y) / w`, in pixels from the channel's upper
/// left, y down; `w` is its distance in metres along the screen's normal, negative behind the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomogeneousPixel {
    pub x: f64,
    pub y: f64,
    pub w: f64,
}

/// The view that a channel has of the world.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub size: [u32; 2],
    pub near_m: f64,
    eye_in_world: DVec3,
    /// The columns of the rotation's matrix, over the scale: rows of display from world.
    axes: [DVec3; 3],
    /// To the right and up along the screen, and from it to the viewer.
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    /// From the eye to the plane, in metres.
    distance: f64,
    /// The screen's left and top edges from the eye's foot, in metres.
    left: f64,
    top: f64,
    pixels_per_metre: DVec2,
    origin: DVec2,
}

impl View {
    /// A channel's view from a pose; why not, where the eye is not in front of the screen.
    pub fn new(seat: &ScreenView, pose: &Pose) -> Result<Self, String> {
        let [a, b, c] = seat.corners;
        let right = direction(b - a)?;
        // Square to the right one, as measured corners are not quite.
        let up = direction((c - a) - right * right.dot(c - a))?;
        let toward = right.cross(up);
        let from_eye = a - seat.eye;
        let distance = -toward.dot(from_eye);
        if distance.is_nan() || distance <= 0.0 {
            return Err(format!("the eye is {} m behind the screen", -distance));
        }
        let (width, height) = (right.dot(b - a), up.dot(c - a));
        let axes = columns(pose.rotation);
        let eye = seat.eye * pose.scale;
        Ok(Self {
            size: seat.size,
            near_m: seat.near_m,
            eye_in_world: pose.position + axes[0] * eye.x + axes[1] * eye.y + axes[2] * eye.z,
            axes: axes.map(|axis| axis / pose.scale),
            right,
            up,
            toward,
            distance,
            left: right.dot(from_eye),
            top: up.dot(c - seat.eye),
            pixels_per_metre: DVec2::new(
                f64::from(seat.canvas[0]) / width,
                f64::from(seat.canvas[1]) / height,
            ),
            origin: DVec2::new(f64::from(seat.origin[0]), f64::from(seat.origin[1])),
        })
    }

    /// Returns the point where the ray from the eye to a point of the world meets the screen's
    /// plane.
    ///
    /// The ray meets it at `v · distance / w`; all is multiplied by `w`, which may be 0.
    pub fn see(&self, world: DVec3) -> HomogeneousPixel {
        let v = self.seen_from_eye(world);
        let w = -self.toward.dot(v);
        let x = self.right.dot(v) * self.distance - self.left * w;
        let y = self.top * w - self.up.dot(v) * self.distance;
        HomogeneousPixel {
            x: x * self.pixels_per_metre.x - self.origin.x * w,
            y: y * self.pixels_per_metre.y - self.origin.y * w,
            w,
        }
    }

    /// The pixel of a point before the near plane.
    pub fn pixel(&self, world: DVec3) -> Option<DVec2> {
        let seen = self.see(world);
        (seen.w >= self.near_m).then(|| DVec2::new(seen.x / seen.w, seen.y / seen.w))
    }

    /// The point of the world that is seen at a pixel, `w` metres along the screen's normal.
    pub fn world(&self, pixel: DVec2, w: f64) -> DVec3 {
        let on_screen = (pixel + self.origin) / self.pixels_per_metre;
        let (x, y) = (on_screen.x + self.left, self.top - on_screen.y);
        let v = (self.right * x + self.up * y) * (w / self.distance) - self.toward * w;
        let out = |axis: DVec3| axis / axis.length_squared();
        self.eye_in_world
            + out(self.axes[0]) * v.x
            + out(self.axes[1]) * v.y
            + out(self.axes[2]) * v.z
    }

    /// The distance from the eye over the distance along the normal, at a pixel.
    pub fn slant(&self, pixel: DVec2) -> f64 {
        let on_screen = (pixel + self.origin) / self.pixels_per_metre;
        let (x, y) = (on_screen.x + self.left, self.top - on_screen.y);
        (x * x + y * y + self.distance * self.distance).sqrt() / self.distance
    }

    fn seen_from_eye(&self, world: DVec3) -> DVec3 {
        let away = world - self.eye_in_world;
        DVec3::new(self.axes[0].dot(away), self.axes[1].dot(away), self.axes[2].dot(away))
    }
}

fn direction(v: DVec3) -> Result<DVec3, String> {
    let length = v.dot(v).sqrt();
    if length.is_finite() && length > 0.0 {
        Ok(v / length)
    } else {
        Err("the screen's corners span no rectangle".to_owned())
    }
}

/// The columns of a unit quaternion's matrix.
fn columns(q: DQuat) -> [DVec3; 3] {
    let (x, y, z, w) = (q.x, q.y, q.z, q.w);
    [
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
        DVec3::new(2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
        DVec3::new(2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
    ]
}
