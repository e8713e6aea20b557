//! The triangles of the reference: without light, coloured by their corners and a picture.

use std::sync::Arc;

use glam::{DVec2, DVec3};

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// In world space.
    pub place: DVec3,
    /// Linear RGB; multiplies the picture.
    pub color: DVec3,
    /// From the picture's upper left.
    pub uv: DVec2,
}

/// A triangle; its front is counter-clockwise.
#[derive(Clone, Debug)]
pub struct Facet {
    pub corners: [Corner; 3],
    pub picture: Option<Arc<Texels>>,
    pub is_double_sided: bool,
}

/// A picture that ends at its edges.
#[derive(Clone, Debug)]
pub struct Texels {
    pub width: u32,
    /// Rows from the top; linear RGB.
    pub linear: Vec<DVec3>,
}

impl Texels {
    /// Between the four nearest texels.
    pub fn sample(&self, uv: DVec2) -> DVec3 {
        let height = self.linear.len() as u32 / self.width;
        let size = DVec2::new(f64::from(self.width), f64::from(height));
        let at = uv * size - 0.5;
        let (base, part) = (at.floor(), at - at.floor());
        let texel = |dx: f64, dy: f64| {
            let place = (base + DVec2::new(dx, dy)).clamp(DVec2::ZERO, size - 1.0);
            self.linear[place.y as usize * self.width as usize + place.x as usize]
        };
        let upper = texel(0.0, 0.0).lerp(texel(1.0, 0.0), part.x);
        let lower = texel(0.0, 1.0).lerp(texel(1.0, 1.0), part.x);
        upper.lerp(lower, part.y)
    }
}
