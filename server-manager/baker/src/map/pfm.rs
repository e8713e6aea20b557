//! PFM, the portable float map: three lines of text, then floats, rows from the bottom.
//!
//! ```text
//! PF\n            three components; MPCDI's 2d profile uses two of them
//! 1920 1080\n     width and height
//! -1.0\n          negative: little-endian, positive: big-endian; the amount means nothing here
//! ```
//!
//! Maps of two components are `pf2c`, as Panda3D writes them. Two components are u and v of the
//! screen's canvas, u to the right, v up, as MPCDI has it; three are a point in display space, in
//! metres. As `PF` has no other way to hold u and v, its third component decides: where it is NaN
//! in every pixel that has the other two, they are u and v; also where it is 0 throughout and the
//! others lie within 0 and 1. A screen whose points all lie in that square metre of z = 0 has to be
//! given by 1 nm of z. Pixels with NaN or infinity are unlit.

use glam::{UVec2, Vec3};
use polyptych_wall::limits::CHANNEL_SIDE_MAX;
use polyptych_wall::warp::{
    MapCoordinates, PLACE_REACH_MAX, WARP_REACH_M_MAX, WarpGeometry, WarpGrid, WarpMap,
};

use super::super::error::BakeError;

const RIGHT: &str = "PF, a line of width and height, a line of -1.0 or 1.0, then floats";

/// A float map.
#[derive(Clone, Debug)]
pub(super) struct Pfm {
    pub size: UVec2,
    /// 2 or 3.
    pub components: usize,
    /// Rows from the top; the third component of two is NaN.
    pub values: Vec<Vec3>,
}

/// Reads a float map of two or three components.
pub(super) fn read(bytes: &[u8]) -> Result<Pfm, BakeError> {
    let bad = |what: String| BakeError::at("head", what, format!("{RIGHT} would be right"));
    let mut rest = bytes;
    let kind = word(&mut rest).unwrap_or_default();
    let components = match kind {
        "PF" => 3,
        "pf2c" => 2,
        "Pf" => return Err(bad("it is a map of one component, Pf".to_owned())),
        "pf4c" => return Err(bad("it is a map of four components, pf4c".to_owned())),
        _ => return Err(bad("it does not begin with PF".to_owned())),
    };
    let mut side = |name: &str| {
        let text = word(&mut rest).unwrap_or_default();
        let side = text.parse::<u32>().ok();
        let side = side.filter(|side| (1..=CHANNEL_SIDE_MAX).contains(side));
        let what = || bad(format!("its {name} is '{text}', where 1 to {CHANNEL_SIDE_MAX} can be"));
        side.ok_or_else(what)
    };
    let size = UVec2::new(side("width")?, side("height")?);
    let text = word(&mut rest).unwrap_or_default();
    let scale = text.parse::<f64>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| bad(format!("its scale is '{text}'")))?;
    let pixels = size.x as usize * size.y as usize;
    // A line that ends in two bytes leaves the second one behind.
    let is_two_ends = rest.len() % 4 == 1 && rest.first() == Some(&b'\n');
    rest = if is_two_ends { &rest[1..] } else { rest };
    let due = pixels * components * 4;
    if rest.len() != due {
        let what = if rest.len() < due { "it is truncated" } else { "bytes follow its last pixel" };
        let what = format!("{what}: {} bytes of {} × {} pixels", rest.len(), size.x, size.y);
        return Err(BakeError::at("pixels", what, format!("{due} would be right")));
    }
    let float = |four: &[u8]| {
        let four = [four[0], four[1], four[2], four[3]];
        if scale < 0.0 { f32::from_le_bytes(four) } else { f32::from_be_bytes(four) }
    };
    let pixel = |bytes: &[u8]| {
        let third = if components == 3 { float(&bytes[8..]) } else { f32::NAN };
        Vec3::new(float(bytes), float(&bytes[4..]), third)
    };
    let rows = rest.chunks_exact(size.x as usize * components * 4).rev();
    let values = rows.flat_map(|row| row.chunks_exact(components * 4).map(pixel)).collect();
    Ok(Pfm { size, components, values })
}

/// The next word, and the one white space behind it.
fn word<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    const WORD_BYTES_MAX: usize = 32;
    let start = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
    let text = &rest[start..];
    let end = text.iter().take(WORD_BYTES_MAX).position(u8::is_ascii_whitespace)?;
    *rest = &text[end + 1..];
    std::str::from_utf8(&text[..end]).ok()
}

impl Pfm {
    /// Returns the map in which pixels are unlit whose three numbers are 0; the third may be NaN.
    pub fn with_dark_zeros(mut self) -> Self {
        let is_zero = |value: &&mut Vec3| {
            value.x == 0.0 && value.y == 0.0 && (value.z == 0.0 || value.z.is_nan())
        };
        self.values.iter_mut().filter(is_zero).for_each(|value| *value = Vec3::NAN);
        self
    }

    /// Returns whether the values are u and v: see the head of this file.
    pub fn is_uv(&self) -> bool {
        let mut lit = self.values.iter().filter(|v| v.x.is_finite() && v.y.is_finite());
        let in_square = |v: &Vec3| v.x.clamp(0.0, 1.0) == v.x && v.y.clamp(0.0, 1.0) == v.y;
        self.components == 2
            || lit.clone().all(|v| v.z.is_nan())
            || lit.all(|v| v.z == 0.0 && in_square(v))
    }

    /// The map, with v down on the canvas, or in metres of display space.
    pub fn into_warp(self) -> Result<WarpMap, BakeError> {
        let space = if self.is_uv() { MapCoordinates::Canvas } else { MapCoordinates::Display };
        let convert = |value: Vec3| match space {
            MapCoordinates::Canvas => Vec3::new(value.x, 1.0 - value.y, 0.0),
            MapCoordinates::Display => value,
        };
        self.map(space, convert)
    }

    /// The map with every lit value converted; pixels with NaN or infinity are unlit.
    pub fn map(
        self,
        space: MapCoordinates,
        convert: impl Fn(Vec3) -> Vec3,
    ) -> Result<WarpMap, BakeError> {
        let (reach, what) = match space {
            MapCoordinates::Canvas => {
                (PLACE_REACH_MAX, "as u and v, which are 0 to 1 on the canvas")
            }
            MapCoordinates::Display => (WARP_REACH_M_MAX, "as a point in metres"),
        };
        let used = if space == MapCoordinates::Canvas { 2 } else { 3 };
        let mut values = self.values;
        let mut is_lit = false;
        for (at, value) in values.iter_mut().enumerate() {
            let converted = convert(*value);
            if !converted.is_finite() {
                *value = Vec3::NAN;
                continue;
            }
            let (x, y) = (at % self.size.x as usize, at / self.size.x as usize);
            let place = || format!("pixel ({x}, {y}) from the upper left");
            if let Some(odd) = value.to_array()[..used].iter().find(|number| is_swapped(**number)) {
                let what = format!("it holds {odd:e}: its bytes seem to be in the other order");
                let right = "a scale below 0 for little-endian floats, above 0 for big-endian ones";
                return Err(BakeError::at(place(), what, format!("{right}, would be right")));
            }
            if converted.abs().max_element() > reach {
                let right = format!("at most {reach} either way would be right");
                return Err(BakeError::at(place(), format!("it is {value} {what}"), right));
            }
            *value = converted;
            is_lit = true;
        }
        if !is_lit {
            let what = "every pixel is NaN or infinite, so that nothing is lit";
            return Err(BakeError::at("pixels", what, "finite values where there is light"));
        }
        let grid = WarpGrid::new(self.size, values);
        Ok(WarpMap { space, shape: WarpGeometry::Grid(grid) })
    }
}

/// Returns whether the number's bytes seem to be swapped: usual numbers then have exponents that no
/// measured number has.
fn is_swapped(number: f32) -> bool {
    let size = number.abs();
    size != 0.0 && !(1e-25..1e25).contains(&size)
}

/// The file that reads back as this grid.
pub(super) fn write(space: MapCoordinates, grid: &WarpGrid) -> Vec<u8> {
    let mut out = format!("PF\n{} {}\n-1.0\n", grid.size.x, grid.size.y).into_bytes();
    for row in grid.values.chunks_exact(grid.size.x as usize).rev() {
        for value in row {
            let [x, y, z] = match space {
                MapCoordinates::Canvas => [value.x, 1.0 - value.y, f32::NAN],
                MapCoordinates::Display => value.to_array(),
            };
            for number in [x, y, z] {
                out.extend_from_slice(&number.to_le_bytes());
            }
        }
    }
    out
}
