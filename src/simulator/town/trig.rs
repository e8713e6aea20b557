//! Sine and cosine without the C library, whose last bits differ between machines.

use glam::Vec3;

/// Sine and cosine of an angle in turns (1 is 2π radians).
///
/// The angle is brought to ±1/8 turn, then Taylor's series to the 15th power is summed with
/// additions and multiplications alone, which IEEE 754 rounds alike everywhere.
pub(super) fn sin_cos(turns: f32) -> (f32, f32) {
    let turns = f64::from(turns);
    let quarter = (turns * 4.0).round();
    let x = (turns - quarter * 0.25) * std::f64::consts::TAU;
    let square = x * x;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for n in (1..=8).rev() {
        let k = f64::from(2 * n - 1);
        sine = 1.0 - sine * square / ((k + 1.0) * (k + 2.0));
        cosine = 1.0 - cosine * square / (k * (k + 1.0));
    }
    let (sine, cosine) = (sine * x, cosine);
    let (sine, cosine) = match (quarter as i64).rem_euclid(4) {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    };
    (sine as f32, cosine as f32)
}

/// Rotated about +Y, anticlockwise seen from above.
pub(super) fn about_up(vector: Vec3, turns: f32) -> Vec3 {
    let (sine, cosine) = sin_cos(turns);
    Vec3::new(vector.x * cosine + vector.z * sine, vector.y, vector.z * cosine - vector.x * sine)
}
