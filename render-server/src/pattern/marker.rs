//! The point that is being moved while a channel is aligned, lit over its pattern.

use glam::DVec2;
use image::RgbaImage;
use polyptych_protocol::calibration_marker::MarkedPoint;
use polyptych_wall::Channel;
use polyptych_wall::calibration_change::{Corner, Edge};
use polyptych_wall::channel_mapping::ChannelMapping;

use super::opaque;

/// Radius of the mark as a share of the picture's shorter side: seen from where a wall is aligned.
const RADIUS_SHARE: f64 = 1.0 / 30.0;

/// Minimum radius of the mark in pixels.
const RADIUS_MIN: f64 = 4.0;

/// The parts of the radius up to which the mark is red, black and white: it stands out from any
/// pattern.
const RINGS: [(f64, [u8; 3]); 3] = [(0.4, [255, 32, 32]), (0.7, [0; 3]), (1.0, [255; 3])];

/// Lights a point of an upright picture, where pins and bend have it. A point outside of the
/// picture is lit at its border.
pub(super) fn draw(
    image: &mut RgbaImage,
    channel: &Channel,
    map: &ChannelMapping<'_>,
    point: MarkedPoint,
) {
    let size = channel.size.as_dvec2();
    let place = match point {
        MarkedPoint::Corner(corner) => match corner {
            Corner::UpperLeft => DVec2::ZERO,
            Corner::UpperRight => DVec2::X,
            Corner::LowerLeft => DVec2::Y,
            Corner::LowerRight => DVec2::ONE,
        },
        MarkedPoint::Edge(edge) => match edge {
            Edge::Left => DVec2::new(0.0, 0.5),
            Edge::Right => DVec2::new(1.0, 0.5),
            Edge::Top => DVec2::new(0.5, 0.0),
            Edge::Bottom => DVec2::new(0.5, 1.0),
        },
        MarkedPoint::Bend { column, row } => {
            let Some(bend) = &channel.adjustment.bend else { return };
            let at = row.saturating_mul(bend.points.x).saturating_add(column);
            // The bend may have fewer points than when the mark was set.
            let Some(by) = bend.moves.get(at as usize) else { return };
            let last = (bend.points - 1).as_dvec2();
            // Points of the bend lie on the display, behind the pins.
            return lit(image, DVec2::new(f64::from(column), f64::from(row)) / last * size + *by);
        }
    };
    if let Some(pixel) = map.pixel_from_ideal(place * size) {
        lit(image, pixel);
    }
}

/// Lights a pixel of a picture.
fn lit(image: &mut RgbaImage, pixel: DVec2) {
    let size = DVec2::new(f64::from(image.width()), f64::from(image.height()));
    let center = pixel.clamp(DVec2::ZERO, size);
    let radius = (size.min_element() * RADIUS_SHARE).max(RADIUS_MIN);
    for y in rows(center.y, radius, image.height()) {
        for x in rows(center.x, radius, image.width()) {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let part = at.distance(center) / radius;
            if let Some((_, color)) = RINGS.iter().find(|(to, _)| part <= *to) {
                image.put_pixel(x, y, opaque(*color));
            }
        }
    }
}

/// The pixels along one side that a mark may touch.
fn rows(center: f64, radius: f64, count: u32) -> std::ops::Range<u32> {
    // Both are within the picture, and so within u32.
    let last = f64::from(count);
    (center - radius).clamp(0.0, last) as u32..(center + radius).ceil().clamp(0.0, last) as u32
}
