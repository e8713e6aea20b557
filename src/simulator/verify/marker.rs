//! Markers: soft spots of light whose place a picture tells to a hundredth of a pixel.
//!
//! A marker is a quad that lies along the screen, so that a right wall shows it undistorted: its
//! light falls off as a Gaussian. Where it is found is compared with where it must be by the same
//! sum over the same pixels, one of what was drawn, one of what f64 says: both see the same
//! pixels, the same distortion and the same edge of the picture. The sum is one over the marker,
//! not over the picture: a texture's filter blurs evenly there, and moves nothing, also where
//! perspective makes one half of the marker larger.

use glam::{DMat2, DVec2, DVec3, UVec2};
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::{ChannelId, Eye, Viewpoint};
use serde_json::{Value, json};

/// Standard deviation of a marker's light, its half side being 1: at the edge of what is summed
/// it has fallen to a thousandth.
const SIGMA: f64 = 0.22;

/// Steps to the pixel that shows a point: four are enough for a plane.
const NEWTON_STEPS: usize = 24;

/// Maximum number of times that a step to that pixel is halved if it leads away from it.
const HALVINGS: u32 = 6;

/// Radius within which a marker's light is summed, its half side being 1.
const RADIUS: f64 = 0.8;

/// Texels across a marker's image: fewer than pixels, where a channel has room. Between levels of a
/// picture of more, the filter of a GPU moves the middle by 0.026 pixels.
const IMAGE_SIDE: u32 = 48;

/// A marker whose picture is narrower than this share of the one on its own channel is drawn from
/// so few of its texels that it is no Gaussian any more.
const NARROW_MIN: f64 = 0.4;

/// Least share of a marker's light that must be found: less, and something lies over it.
const FOUND_MIN: f64 = 0.5;

/// Least correlation of what is found with a marker's light: an even light has a middle too.
const LIKE_MIN: f64 = 0.9;

/// A quad that faces the viewer along the screen, in metres of display space.
#[derive(Clone, Debug)]
pub(crate) struct Marker {
    /// The channel that it was made for.
    pub channel: ChannelId,
    /// The eye of that channel for which it was made.
    pub of: Eye,
    /// The position of its middle in that channel's picture; (0, 0) if it was made for none.
    pub pixel: DVec2,
    /// `true` if it lies on the screen, where all eyes see it at one place.
    pub is_on_screen: bool,
    center: DVec3,
    /// From the middle to the right edge, and to the upper one.
    right: DVec3,
    up: DVec3,
}

/// Light of a channel's picture, upright and before blends: one number a pixel, NaN where it
/// cannot be told.
#[derive(Debug)]
pub(crate) struct LuminanceImage {
    pub size: UVec2,
    pub grey: Vec<f32>,
}

/// The reading of a marker from a channel's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reading {
    /// The offset from its expected position, in pixels.
    Off(DVec2),
    /// The channel has too little of the light there to tell, or sees it too much from the side.
    Unclear,
    /// It is not there.
    Missing,
}

/// From an eye, in a direction.
pub(crate) type Ray = (DVec3, DVec3);

/// Returns the function from pixels of a channel to the rays through its screen.
pub(crate) fn sight(
    map: &ChannelMapping<'_>,
    eye: impl Into<Viewpoint>,
) -> impl Fn(DVec2) -> Option<Ray> {
    let eye = eye.into();
    move |pixel| {
        let point = map.drawn_from_pixel(pixel)?;
        let eye = eye.eye_for(point);
        Some((eye, point - eye))
    }
}

impl Marker {
    /// A marker for whichever channels show it: its middle, and from there to its right and upper
    /// edges.
    pub fn new(center: DVec3, right: DVec3, up: DVec3) -> Self {
        Self {
            channel: ChannelId(u16::MAX),
            of: Eye::Center,
            pixel: DVec2::ZERO,
            is_on_screen: false,
            center,
            right,
            up,
        }
    }

    /// A marker of a half side of `half` pixels around a pixel of a channel, `depth` times as far
    /// from the eye as the screen is. `None` where the channel's pixels there lie nowhere.
    pub fn at(
        (channel, map): (ChannelId, &ChannelMapping<'_>),
        eye: impl Into<Viewpoint>,
        pixel: DVec2,
        half: f64,
        depth: f64,
    ) -> Option<Self> {
        let center = map.drawn_from_pixel(pixel)?;
        let eye = eye.into().eye_for(center);
        // Both ways, and their mean: on a curved screen neither alone is tangential.
        let side = |step: DVec2| {
            let (ahead, behind) =
                (map.drawn_from_pixel(pixel + step)?, map.drawn_from_pixel(pixel - step)?);
            Some((ahead - behind) / 2.0 * depth)
        };
        let (right, down) = (side(DVec2::X * half)?, side(DVec2::Y * half)?);
        let center = eye + (center - eye) * depth;
        let is_on_screen = depth == 1.0;
        Some(Self { channel, of: Eye::Center, pixel, is_on_screen, center, right, up: -down })
    }

    /// Returns the offset of the marker from `around`, its expected position, in the picture of a
    /// channel with this sight, while the marker has moved by `offset` metres.
    pub fn read(
        &self,
        sight: impl Fn(DVec2) -> Option<Ray>,
        light: &LuminanceImage,
        offset: DVec3,
        (around, half): (DVec2, f64),
    ) -> Reading {
        let place_at = |pixel: DVec2| self.place(sight(pixel)?, offset);
        let slope_at = |pixel: DVec2, at: DVec2| {
            let (across, down) =
                (place_at(pixel + DVec2::X)? - at, place_at(pixel + DVec2::Y)? - at);
            Some(DMat2::from_cols(across, down))
        };
        let Some(slope) = place_at(around).and_then(|at| slope_at(around, at)) else {
            return Reading::Missing;
        };
        if narrowness(slope) * half * NARROW_MIN > 1.0 {
            return Reading::Unclear;
        }
        let reach = DVec2::splat(half * 1.5);
        let first = (around - reach).floor().max(DVec2::ZERO).as_uvec2();
        let end = (around + reach).ceil().max(DVec2::ZERO).as_uvec2().min(light.size);
        let (mut drawn, mut expected) = (WeightedSum::default(), WeightedSum::default());
        let mut likeness = Likeness::default();
        for y in first.y..end.y {
            for x in first.x..end.x {
                let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let Some(place) = place_at(pixel) else { continue };
                if place.length() > RADIUS {
                    continue;
                }
                let grey = f64::from(light.grey[(y * light.size.x + x) as usize]);
                if grey.is_nan() {
                    return Reading::Unclear;
                }
                let Some(slope) = slope_at(pixel, place) else { continue };
                let area = slope.determinant().abs();
                drawn.add(place, grey * area);
                expected.add(place, gauss(place) * area);
                likeness.add(grey, gauss(place), area);
            }
        }
        let is_found = drawn.weight > expected.weight * FOUND_MIN && expected.weight > 0.0;
        if is_found && likeness.correlation() > LIKE_MIN {
            Reading::Off(slope.inverse() * (drawn.mean() - expected.mean()))
        } else {
            Reading::Missing
        }
    }

    /// The pixel at which a channel must show the marker, found by Newton's method from
    /// `from`; `None` where it does not show its middle.
    pub fn seen_at(
        &self,
        sight: impl Fn(DVec2) -> Option<Ray>,
        offset: DVec3,
        (size, from): (UVec2, DVec2),
    ) -> Option<DVec2> {
        let size = size.as_dvec2();
        let place_at = |pixel: DVec2| self.place(sight(pixel)?, offset);
        let mut pixel = from;
        let mut here = place_at(pixel)?;
        for _ in 0..NEWTON_STEPS {
            let slope = |by: DVec2| Some((place_at(pixel + by)? - place_at(pixel - by)?) / 2.0);
            let slopes = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?);
            let step = slopes.inverse() * here;
            if !step.is_finite() {
                return None;
            }
            // Not beyond where the picture could lie: far out a curved screen may have no points.
            // A map that is not smooth is no line: a step that leads away from it is halved.
            let nearer = (0..HALVINGS).find_map(|halved| {
                let next = pixel - step / f64::from(1 << halved);
                let next = next.clamp(-size * 0.02, size * 1.02);
                let there = place_at(next)?;
                (there.length() < here.length()).then_some((next, there))
            });
            // No better place is known where rounding ends.
            let Some(nearer) = nearer else { break };
            (pixel, here) = nearer;
        }
        let is_inside = pixel.cmpgt(DVec2::ZERO).all() && pixel.cmplt(size).all();
        (here.length() < 1e-6 && is_inside).then_some(pixel)
    }

    /// The direction from an eye to its middle, and how far around that its corners reach, as a
    /// length between unit vectors, for all eyes that are up to `aside_m` metres away from there.
    pub fn cone(&self, eye: DVec3, aside_m: f64) -> (DVec3, f64) {
        let toward = (self.center - eye).normalize();
        let corner = (self.center + self.right + self.up - eye).normalize();
        (toward, toward.distance(corner) + aside_m / self.center.distance(eye))
    }

    /// Returns the distance of its plane from an eye, in metres.
    pub fn distance_m(&self, eye: DVec3) -> f64 {
        self.right.cross(self.up).normalize().dot(self.center - eye).abs()
    }

    /// Returns the point where a ray meets the marker: (±1, ±1) are its corners. `None` if the
    /// marker is behind the eye or parallel to the ray.
    pub fn place(&self, (eye, direction): Ray, offset: DVec3) -> Option<DVec2> {
        let normal = self.right.cross(self.up);
        let center = self.center + offset;
        let t = normal.dot(center - eye) / normal.dot(direction);
        let from = eye + direction * t - center;
        // Its sides are not perpendicular where a projector throws askew.
        let sides = DMat2::from_cols(
            DVec2::new(self.right.length_squared(), self.right.dot(self.up)),
            DVec2::new(self.right.dot(self.up), self.up.length_squared()),
        );
        let place = sides.inverse() * DVec2::new(from.dot(self.right), from.dot(self.up));
        (t > 0.0 && place.is_finite()).then_some(place)
    }

    /// Its node: the quad (±1, ±1, 0) turned, stretched and moved.
    fn node(&self) -> Value {
        let normal = self.right.cross(self.up).normalize() * self.right.length();
        let mut matrix = Vec::with_capacity(16);
        for (axis, w) in [(self.right, 0.0), (self.up, 0.0), (normal, 0.0), (self.center, 1.0)] {
            matrix.extend([axis.x, axis.y, axis.z, w]);
        }
        json!({ "mesh": 0, "matrix": matrix })
    }
}

/// Light, and where it is.
#[derive(Default)]
struct WeightedSum {
    weight: f64,
    moment: DVec2,
}

impl WeightedSum {
    fn add(&mut self, place: DVec2, light: f64) {
        self.weight += light;
        self.moment += place * light;
    }

    fn mean(&self) -> DVec2 {
        self.moment / self.weight
    }
}

/// Weighted sums of two lights, of their squares and of their product.
#[derive(Default)]
struct Likeness {
    weight: f64,
    sums: DVec2,
    squares: DVec2,
    product: f64,
}

impl Likeness {
    fn add(&mut self, a: f64, b: f64, weight: f64) {
        let pair = DVec2::new(a, b);
        self.weight += weight;
        self.sums += pair * weight;
        self.squares += pair * pair * weight;
        self.product += a * b * weight;
    }

    /// Pearson's coefficient, from -1 to 1; 0 where one of both is even.
    fn correlation(&self) -> f64 {
        let mean = self.sums / self.weight;
        let spread = self.squares / self.weight - mean * mean;
        let common = self.product / self.weight - mean.x * mean.y;
        let scale = (spread.x * spread.y).sqrt();
        if scale > 1e-9 { common / scale } else { 0.0 }
    }
}

/// Returns the number of a marker's half sides that a pixel spans where its picture is narrowest:
/// the largest singular value of this matrix.
fn narrowness(place_from_pixel: DMat2) -> f64 {
    let (a, b) = (place_from_pixel.x_axis, place_from_pixel.y_axis);
    let (sum, product) = (a.length_squared() + b.length_squared(), a.perp_dot(b));
    f64::midpoint(sum, (sum * sum - 4.0 * product * product).max(0.0).sqrt()).sqrt()
}

/// Returns the light of a marker at a place of it.
pub(super) fn gauss(place: DVec2) -> f64 {
    (-place.length_squared() / (2.0 * SIGMA * SIGMA)).exp() * PEAK
}

/// Light of a marker's middle, from 0 to 1: unlit surfaces are not tone-mapped.
const PEAK: f64 = 0.7;

/// The file that opens, among those of [`files`].
pub(crate) const SCENE_NAME: &str = "markers.gltf";

/// A scene of these markers as files of one folder, names and bytes. All of it is moved by
/// `offset` metres, as a scene far from its origin is.
///
/// # Errors
/// An image that could not be written.
pub(crate) fn files(
    markers: &[Marker],
    offset: DVec3,
) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    let mut image = std::io::Cursor::new(Vec::new());
    picture().write_to(&mut image, image::ImageFormat::Png)?;
    Ok(vec![
        (SCENE_NAME, document(markers, offset).to_string().into_bytes()),
        ("marker.bin", quad()),
        ("marker.png", image.into_inner()),
    ])
}

/// A square of ±1, places and texture coordinates of four corners, and two triangles.
fn quad() -> Vec<u8> {
    let corners: [[f32; 5]; 4] = [
        [-1.0, -1.0, 0.0, 0.0, 1.0],
        [1.0, -1.0, 0.0, 1.0, 1.0],
        [-1.0, 1.0, 0.0, 0.0, 0.0],
        [1.0, 1.0, 0.0, 1.0, 0.0],
    ];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|n| n.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 2, 1, 3].iter().flat_map(|index| index.to_le_bytes()));
    bytes
}

fn document(markers: &[Marker], offset: DVec3) -> Value {
    let mut nodes: Vec<Value> = markers.iter().map(Marker::node).collect();
    let children: Vec<usize> = (0..nodes.len()).collect();
    nodes.push(json!({ "translation": offset.to_array(), "children": children }));
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "nodes": nodes,
        "extensionsUsed": ["KHR_materials_unlit"],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0
        }] }],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "extensions": { "KHR_materials_unlit": {} }
        }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }],
        "images": [{ "uri": "marker.png" }],
        "buffers": [{ "uri": "marker.bin", "byteLength": 92 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 80, "byteStride": 20 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 12 }
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
              "min": [-1, -1, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 4,
              "type": "VEC2" },
            { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" }
        ]
    })
}

/// The picture of a marker's light.
fn picture() -> image::GrayImage {
    image::GrayImage::from_fn(IMAGE_SIDE, IMAGE_SIDE, |x, y| {
        let place = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / f64::from(IMAGE_SIDE);
        let light = gauss(place * 2.0 - 1.0);
        // IEC 61966-2-1.
        let code = if light <= 0.003_130_8 {
            12.92 * light
        } else {
            1.055 * light.powf(1.0 / 2.4) - 0.055
        };
        image::Luma([(code * 255.0).round() as u8])
    })
}

#[cfg(test)]
mod tests;
