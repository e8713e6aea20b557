//! Colours of the town, as linear RGB.

use glam::Vec3;

/// Linear RGB, each in [0, 1].
pub(super) type Color = Vec3;

/// From 0xRRGGBB in sRGB.
///
/// The curve is the cubic that fits sRGB's within 0.6 % (C. Scherzer, "sRGB approximations for
/// HLSL", 2012): a power function is not the same on every machine.
pub(super) fn srgb(hex: u32) -> Color {
    let linear = |shift: u32| {
        let c = ((hex >> shift) & 255) as f32 / 255.0;
        c * (c * (c * 0.305_306 + 0.682_171_1) + 0.012_522_9)
    };
    Color::new(linear(16), linear(8), linear(0))
}

/// Returns the colour as a vertex holds it: normalised bytes, opaque.
pub(super) fn bytes(color: Color) -> [u8; 4] {
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    [byte(color.x), byte(color.y), byte(color.z), 255]
}
