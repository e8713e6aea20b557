//! The colour spaces of FLIP: linear YCxCz, in which light is filtered, and CIE L*a*b*, in which
//! colours are compared.

/// CIE XYZ of linear sRGB, by rows: IEC 61966-2-1 in fractions.
const XYZ_FROM_RGB: [[f32; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];

/// The inverse of [`XYZ_FROM_RGB`].
const RGB_FROM_XYZ: [[f32; 3]; 3] = [
    [3.241_003_3, -1.537_399, -0.498_615_86],
    [-0.969_224_33, 1.875_930_1, 0.041_554_224],
    [0.055_639_423, -0.204_011_2, 1.057_148_9],
];

/// White, D65.
const WHITE_XYZ: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];

/// A colour in CIE L*a*b*, its a* and b* scaled by the Hunt effect: colours look less colourful
/// in the dark.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lab([f32; 3]);

impl Lab {
    /// Returns the HyAB distance: city-block between light and colour, Euclidean within colours.
    pub fn hyab_distance(self, other: Self) -> f32 {
        let [l, a, b] = [0, 1, 2].map(|i| self.0[i] - other.0[i]);
        l.abs() + a.hypot(b)
    }
}

/// Returns the YCxCz of a pixel in sRGB: L*a*b* without its cube roots, so that it is linear.
pub(super) fn ycxcz_from_srgb(srgb: [u8; 3]) -> [f32; 3] {
    let [x, y, z] = relative_xyz(srgb.map(linear));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Returns the colour to compare of a filtered pixel. What filters have left outside of the
/// display's gamut is brought back to its border.
pub(super) fn hunt_lab([y, cx, cz]: [f32; 3]) -> Lab {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    let xyz = [0, 1, 2].map(|i| relative[i] * WHITE_XYZ[i]);
    let rgb = multiply(&RGB_FROM_XYZ, xyz).map(|light| light.clamp(0.0, 1.0));
    let [x, y, z] = relative_xyz(rgb).map(lab_root);
    let l = 116.0 * y - 16.0;
    Lab([l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)])
}

/// Returns XYZ in parts of white.
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    let xyz = multiply(&XYZ_FROM_RGB, rgb);
    [0, 1, 2].map(|i| xyz[i] / WHITE_XYZ[i])
}

fn multiply(rows: &[[f32; 3]; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    rows.map(|row| row[0] * x + row[1] * y + row[2] * z)
}

/// Light of an sRGB code, from 0 to 1.
fn linear(code: u8) -> f32 {
    polyptych_wall::color::linear_from_srgb(f64::from(code) / 255.0) as f32
}

/// The cube root of CIE L*a*b*, with a straight line for what is almost black.
fn lab_root(light: f32) -> f32 {
    const DELTA: f32 = 6.0 / 29.0;
    if light > DELTA.powi(3) { light.cbrt() } else { light / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
}
