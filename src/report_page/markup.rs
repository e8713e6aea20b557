//! Pieces of HTML and SVG: escaped text, short numbers, paths.

use std::fmt::Write;

use glam::DVec2;

/// Returns text as it stands in HTML and XML, between tags or in quotes.
pub(crate) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            // XML has no way to write them.
            '\u{fffe}' | '\u{ffff}' => escaped.push('\u{fffd}'),
            c if c.is_control() && c != '\n' && c != '\t' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// Adds formatted text.
pub(crate) fn add(text: &mut String, what: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = text.write_fmt(what);
}

/// Returns a number in at most four digits, large ones in thousands or millions.
pub(crate) fn number(value: f64) -> String {
    let (value, unit) = match value.abs() {
        size if size >= 1e6 => (value / 1e6, " M"),
        size if size >= 1e4 => (value / 1e3, " k"),
        _ => (value, ""),
    };
    let digits = match value.abs() {
        size if size >= 100.0 => 0,
        size if size >= 10.0 => 1,
        size if size >= 1.0 => 2,
        _ => 4,
    };
    format!("{}{unit}", trimmed(&format!("{value:.digits$}")))
}

/// Returns a decimal number without zeros at its end.
fn trimmed(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

/// Returns the path of lines through these points, `M1 2L3 4`, closed or open; to a hundredth of a
/// unit. Points that are not finite are left out.
pub(crate) fn path(points: &[DVec2], is_closed: bool) -> String {
    let mut path = String::new();
    let mut command = 'M';
    for point in points.iter().filter(|point| point.is_finite()) {
        let [x, y] = point.to_array().map(|at| format!("{at:.2}"));
        add(&mut path, format_args!("{command}{} {}", trimmed(&x), trimmed(&y)));
        command = 'L';
    }
    if is_closed && !path.is_empty() {
        path.push('Z');
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (0.25, "0.25"),
            (8.0, "8"),
            (58.04, "58"),
            (12.34, "12.3"),
            (9999.0, "9999"),
            (94_722.0, "94.7 k"),
            (2_300_000.0, "2.3 M"),
        ] {
            assert_eq!(number(value), text, "{value}");
        }
    }

    #[test]
    fn paths_have_no_invalid_numbers() {
        let points = [DVec2::new(1.0, -2.5), DVec2::NAN, DVec2::new(100.0, 0.126)];
        assert_eq!(path(&points, true), "M1 -2.5L100 0.13Z");
        assert_eq!(path(&points[1..2], true), "");
    }
}
