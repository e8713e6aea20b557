//! Lengths on paper: round steps, and the bar that says how long a metre is.

use glam::DVec2;

use crate::report_page::markup::{add, number};

/// Returns the largest of 1, 2 and 5 times a power of ten that is no larger than this.
pub(super) fn round_below(value: f64) -> f64 {
    let power = 10.0_f64.powf(value.log10().floor());
    // A little more, so that 0.1 is not rounded below itself.
    let most = value * (1.0 + 1e-9);
    [5.0, 2.0].into_iter().map(|digit| digit * power).find(|step| *step <= most).unwrap_or(power)
}

/// Returns a length in metres, or in centimetres or millimetres if it is short.
pub(super) fn length(metres: f64) -> String {
    match metres.abs() {
        size if size >= 1.0 || size == 0.0 => format!("{} m", number(metres)),
        size if size >= 0.01 => format!("{} cm", number(metres * 100.0)),
        _ => format!("{} mm", number(metres * 1000.0)),
    }
}

/// Returns width and height in metres as text.
pub(super) fn extent([width, height]: [f64; 2]) -> String {
    format!("{width:.2} × {height:.2} m")
}

/// Adds a bar of a round length that is no longer than `longest`, with its lower left at a place.
pub(super) fn add_bar(svg: &mut String, at: DVec2, pixels_per_metre: f64, longest: f64) {
    let metres = round_below(longest / pixels_per_metre);
    let DVec2 { x, y } = at;
    let (end, top) = (x + metres * pixels_per_metre, y - 5.0);
    add(
        svg,
        format_args!(
            "<g class=\"w-bar\" data-metres=\"{metres}\"><path d=\"M{x:.2} {top:.2}V{y:.2}H{end:.2}\
             V{top:.2}\"/><text class=\"w-fact w-middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text></g>\n",
            f64::midpoint(x, end),
            y - 4.0,
            length(metres)
        ),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_lengths_have_a_unit() {
        for (value, step) in [(1.0, 1.0), (0.1, 0.1), (1.9, 1.0), (4.99, 2.0), (73.0, 50.0)] {
            assert!((round_below(value) / step - 1.0).abs() < 1e-9, "{value}: {step}");
        }
        for (metres, text) in [(2.0, "2 m"), (0.5, "50 cm"), (0.002, "2 mm"), (0.0, "0 m")] {
            assert_eq!(length(metres), text);
        }
    }
}
