//! A number of several things over time, as rows of shades: inline SVG.

use super::markup::{add, escaped, number};
use super::plot::Axis;

/// Width of the drawing, and of the names.
const WIDTH: f64 = 940.0;
const NAMES: f64 = 180.0;

/// Height of a row, of the title and of the axis.
const ROW: f64 = 14.0;
const HEAD: f64 = 30.0;
const FOOT: f64 = 40.0;

/// Maximum number of rows, and of steps in time.
pub(crate) const ROWS_MAX: usize = 64;
const STEPS: usize = 190;

/// Shades of a number, from none to the largest.
const SHADES: usize = 8;

/// Maximum number of letters of a name that fit.
const LETTERS: usize = 26;

/// A number of several things over time.
pub(crate) struct HeatRows {
    pub title: String,
    pub unit: &'static str,
    /// The meaning of a missing number.
    pub missing: &'static str,
    /// The times at which columns were measured, in seconds, in rising order.
    pub times_s: Vec<f64>,
    /// A name, and a number for each time; NaN for a missing one.
    pub rows: Vec<(String, Vec<f64>)>,
}

impl HeatRows {
    /// Returns the rows as an SVG element; nothing if there are none. Of more than [`ROWS_MAX`],
    /// those that miss most, and then those with the largest numbers, are kept in their order.
    pub fn svg(&self) -> String {
        let (Some(last), false) = (self.times_s.last(), self.rows.is_empty()) else {
            return String::new();
        };
        let shown = self.shown();
        let all = shown.iter().flat_map(|(_, values)| values).copied();
        let largest = all.filter(|value| value.is_finite()).fold(0.0, f64::max);
        let axis = Axis::linear("s", *last);
        let bottom = HEAD + ROW * shown.len() as f64;
        let (title, height) = (escaped(&self.title), bottom + FOOT);
        let mut svg = format!(
            "<svg class=\"spread\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
             aria-label=\"{title}\">\n<text class=\"title\" x=\"0\" y=\"16\">{title}</text>\n"
        );
        let place = |time: f64| NAMES + axis.fraction(time) * (WIDTH - NAMES - 20.0);
        for (index, (name, values)) in shown.iter().enumerate() {
            self.add_row(&mut svg, (name, values), HEAD + ROW * index as f64, largest, &place);
        }
        for &mark in &axis.marks {
            add(
                &mut svg,
                format_args!(
                    "<text class=\"mark x\" x=\"{:.1}\" y=\"{:.1}\">{} s</text>\n",
                    place(mark),
                    bottom + 14.0,
                    number(mark)
                ),
            );
        }
        let more = self.rows.len() - shown.len();
        let more = if more > 0 { format!("; {more} more not shown") } else { String::new() };
        add(
            &mut svg,
            format_args!(
                "<text class=\"mark\" x=\"{NAMES}\" y=\"{:.1}\">dark: {} {}; red: {}{more}</text>\n\
                 </svg>\n",
                bottom + 32.0,
                number(largest),
                self.unit,
                self.missing
            ),
        );
        svg
    }

    fn shown(&self) -> Vec<&(String, Vec<f64>)> {
        let rank = |(_, values): &(String, Vec<f64>)| {
            let missing = values.iter().filter(|value| value.is_nan()).count();
            (missing, values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max))
        };
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        order.sort_by(|a, b| {
            let (a, b) = (rank(&self.rows[*a]), rank(&self.rows[*b]));
            b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
        });
        order.truncate(ROWS_MAX);
        order.sort_unstable();
        order.into_iter().map(|index| &self.rows[index]).collect()
    }

    fn add_row(
        &self,
        svg: &mut String,
        (name, values): (&str, &[f64]),
        y: f64,
        largest: f64,
        place: &dyn Fn(f64) -> f64,
    ) {
        let short: String = name.chars().take(LETTERS).collect();
        add(
            svg,
            format_args!(
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                NAMES - 8.0,
                y + 10.0,
                escaped(&short)
            ),
        );
        let count = values.len().min(self.times_s.len());
        let step = count.div_ceil(STEPS).max(1);
        let mut cells: Vec<(f64, f64, Option<usize>)> = Vec::new();
        for from in (0..count).step_by(step) {
            let part = &values[from..(from + step).min(count)];
            let worst = part.iter().copied().fold(0.0, f64::max);
            let is_missing = part.iter().any(|value| value.is_nan());
            let shade = (worst / largest.max(f64::MIN_POSITIVE) * SHADES as f64).ceil() as usize;
            let shade = (!is_missing).then(|| shade.clamp(1, SHADES));
            let (begin, end) = (
                if from == 0 { 0.0 } else { self.times_s[from - 1] },
                self.times_s[(from + step).min(count) - 1],
            );
            match cells.last_mut() {
                Some(last) if last.2 == shade => last.1 = end,
                _ => cells.push((begin, end, shade)),
            }
        }
        for (begin, end, shade) in cells {
            let (x, width) = (place(begin), (place(end) - place(begin)).max(0.5));
            let (class, opacity) = match shade {
                Some(shade) => ("s0", shade as f64 / SHADES as f64),
                None => ("gone", 1.0),
            };
            add(
                svg,
                format_args!(
                    "<rect class=\"cell {class}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"{width:.1}\" \
                     height=\"{:.1}\" fill-opacity=\"{opacity:.2}\"/>",
                    y + 1.0,
                    ROW - 2.0
                ),
            );
        }
        svg.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_number_shows_among_many_rows_and_times() {
        let values = |row: usize| {
            let missing = |at: usize| row == 70 && at == 4321;
            (0..5000).map(|at| if missing(at) { f64::NAN } else { 5.0 }).collect()
        };
        let rows = (0..100).map(|row| (format!("<{row}>"), values(row))).collect();
        let times_s = (0..5000).map(|at| f64::from(at) / 60.0).collect();
        let (title, missing) = ("Drawing".into(), "not shown");
        let svg = HeatRows { title, unit: "ms", missing, times_s, rows }.svg();
        let document = roxmltree::Document::parse(&svg).expect("XML");
        let of_class = |class: &str| {
            let all = document.descendants().filter_map(|node| node.attribute("class"));
            all.filter(|has| *has == class).count()
        };
        assert_eq!(of_class("cell gone"), 1);
        assert_eq!(of_class("cell s0"), ROWS_MAX + 1, "equal neighbours are one cell");
        assert!(svg.contains("36 more not shown"), "{svg}");
    }
}
