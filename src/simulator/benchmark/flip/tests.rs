//! FLIP against values of the reference implementation, `flip-evaluator` 1.7 of its authors, for
//! pictures that both make by the same formulas of whole numbers.

use super::*;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

fn picture(pixel: impl Fn(i32, i32) -> [i32; 3]) -> Vec<u8> {
    let places = (0..HEIGHT as i32).flat_map(|y| (0..WIDTH as i32).map(move |x| (x, y)));
    places
        .flat_map(|(x, y)| {
            let [r, g, b] = pixel(x, y);
            [r, g, b, 255]
        })
        .map(|c| c as u8)
        .collect()
}

/// A pattern of ramps and squares; the squares can be moved.
fn pattern(shift: i32) -> Vec<u8> {
    picture(|x, y| {
        let is_light = ((x - shift).div_euclid(8) + y / 8) % 2 == 0;
        [(x * 7 + y * 3) % 256, (x * x / 5 + y * 11) % 256, if is_light { 200 } else { 40 }]
    })
}

fn difference(a: &[u8], b: &[u8], pixels_per_degree: f64) -> FlipError {
    let [a, b] = [a, b].map(|p| PerceivedImage::new(p, WIDTH, pixels_per_degree));
    a.difference(&b)
}

#[test]
fn errors_are_those_of_the_reference_implementation() {
    let flat = |color: [i32; 3]| picture(|_, _| color);
    let line = picture(|x, _| [if x == 30 { 0 } else { 255 }; 3]);
    let (usual, coarse) = (67.0206, 30.0);
    for (name, a, b, pixels_per_degree, mean, p99) in [
        ("black, white", flat([0; 3]), flat([255; 3]), usual, 0.967_365, 0.967_386),
        ("green, blue", flat([0, 255, 0]), flat([0, 0, 255]), usual, 1.0, 1.0),
        ("reddish", flat([100; 3]), flat([110, 100, 100]), usual, 0.116_363, 0.116_362),
        ("shifted", pattern(0), pattern(3), usual, 0.279_464, 0.663_355),
        ("nearer", pattern(0), pattern(3), coarse, 0.387_838, f64::NAN),
        ("line", flat([255; 3]), line, usual, 0.036_401, f64::NAN),
    ] {
        let error = difference(&a, &b, pixels_per_degree);
        // The reference adds up in single precision: its own mean of a flat field is 2e-5 off.
        assert!((error.mean - mean).abs() < 3e-5, "{name}: {error:?}");
        assert!(p99.is_nan() || (error.p99 - p99).abs() < 3e-5, "{name}: {error:?}");
    }
}

#[test]
fn equal_pictures_have_no_error_and_the_order_does_not_matter() {
    let zero = FlipError { mean: 0.0, p99: 0.0 };
    assert_eq!(difference(&pattern(0), &pattern(0), PIXELS_PER_DEGREE), zero);
    let there = difference(&pattern(0), &pattern(2), PIXELS_PER_DEGREE);
    let back = difference(&pattern(2), &pattern(0), PIXELS_PER_DEGREE);
    assert_eq!(there, back);
    assert!(there.mean > 0.0 && there.mean < there.p99 && there.p99 <= 1.0, "{there:?}");
}
