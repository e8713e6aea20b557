//! The spread of measurements of several things, a row for each, as inline SVG.

use polyptych_client::Quantiles;

use super::markup::{add, escaped, number};
use super::plot::Axis;

/// Maximum number of rows: those with the largest values are kept.
pub(crate) const ROWS_MAX: usize = 64;

/// Width of a plot, of the names, and of the numbers at its right, in CSS pixels.
const WIDTH: f64 = 940.0;
const NAMES: f64 = 180.0;
const NUMBERS: f64 = 170.0;

/// Height of a row, and of the title and the axis.
const ROW: f64 = 18.0;
const HEAD: f64 = 30.0;
const FOOT: f64 = 40.0;

/// Maximum number of letters of a name that fit.
const LETTERS: usize = 26;

/// The measurements of one thing.
pub(crate) struct Spread {
    pub name: String,
    pub values: Quantiles,
    /// The bound that none of them should exceed.
    pub bound: Option<f64>,
}

/// Medians, 95 % and maxima of several things.
pub(crate) struct SpreadPlot {
    pub title: String,
    /// The unit of all values.
    pub unit: &'static str,
    pub rows: Vec<Spread>,
}

impl SpreadPlot {
    /// Returns the plot as an SVG element; nothing if there is no row.
    pub fn svg(&self) -> String {
        let rows = self.shown();
        if rows.is_empty() {
            return String::new();
        }
        let largest = rows.iter().map(|row| row.values.max.max(row.bound.unwrap_or(0.0)));
        let axis = Axis::linear(self.unit, largest.fold(0.0, f64::max));
        let place = |value: f64| NAMES + axis.fraction(value) * (WIDTH - NAMES - NUMBERS);
        let bottom = HEAD + ROW * rows.len() as f64;
        let (title, height) = (escaped(&self.title), bottom + FOOT);
        let mut svg = format!(
            "<svg class=\"spread\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
             aria-label=\"{title}\">\n<text class=\"title\" x=\"0\" y=\"16\">{title}</text>\n"
        );
        for &mark in &axis.marks {
            let (x, text) = (place(mark), number(mark));
            add(
                &mut svg,
                format_args!(
                    "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{HEAD}\" \
                     y2=\"{bottom}\"/><text class=\"mark x\" x=\"{x:.1}\" y=\"{:.1}\">{text} \
                     {}</text>\n",
                    bottom + 15.0,
                    self.unit
                ),
            );
        }
        for (index, row) in rows.iter().enumerate() {
            self.add_row(&mut svg, row, HEAD + ROW * (index as f64 + 0.5), &place);
        }
        let more = self.rows.len() - rows.len();
        let more = if more > 0 { format!("; {more} more, none larger") } else { String::new() };
        add(
            &mut svg,
            format_args!(
                "<text class=\"mark\" x=\"{NAMES}\" y=\"{:.1}\">bar: to the median; line: to 95 %; \
                 dot: maximum; stroke: bound{more}</text>\n</svg>\n",
                bottom + 32.0
            ),
        );
        svg
    }

    /// Returns the rows with the largest maxima, in their order.
    fn shown(&self) -> Vec<&Spread> {
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        order.sort_by(|a, b| self.rows[*b].values.max.total_cmp(&self.rows[*a].values.max));
        order.truncate(ROWS_MAX);
        order.sort_unstable();
        order.into_iter().map(|index| &self.rows[index]).collect()
    }

    fn add_row(&self, svg: &mut String, row: &Spread, y: f64, place: &dyn Fn(f64) -> f64) {
        let name: String = row.name.chars().take(LETTERS).collect();
        let Quantiles { count, p50, p95, max, .. } = row.values;
        let is_over = row.bound.is_some_and(|bound| max > bound);
        let class = if is_over { "s1" } else { "s0" };
        let [zero, median, most, last] = [0.0, p50, p95, max].map(place);
        add(
            svg,
            format_args!(
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
                NAMES - 8.0,
                y + 4.0,
                escaped(&name)
            ),
        );
        if count == 0 {
            return;
        }
        if let Some(bound) = row.bound.map(place) {
            add(
                svg,
                format_args!(
                    "<line class=\"line s2\" x1=\"{bound:.1}\" x2=\"{bound:.1}\" y1=\"{:.1}\" \
                     y2=\"{:.1}\"/>",
                    y - 7.0,
                    y + 7.0
                ),
            );
        }
        add(
            svg,
            format_args!(
                "<rect class=\"bar {class}\" x=\"{zero:.1}\" width=\"{:.1}\" y=\"{:.1}\" \
                 height=\"8\"/><line class=\"line {class}\" x1=\"{median:.1}\" x2=\"{most:.1}\" \
                 y1=\"{y:.1}\" y2=\"{y:.1}\"/><circle class=\"dot {class}\" cx=\"{last:.1}\" \
                 cy=\"{y:.1}\" r=\"3.5\"><title>{} of {count}</title></circle><text class=\"mark\" \
                 x=\"{:.1}\" y=\"{:.1}\">{} / {} / {} {}</text>\n",
                median - zero,
                y - 4.0,
                escaped(&row.name),
                WIDTH - NUMBERS + 14.0,
                y + 4.0,
                number(p50),
                number(p95),
                number(max),
                self.unit
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_of_many_things_keeps_the_worst_and_is_well_formed() {
        let row = |at: u32| Spread {
            name: format!("<{at}>"),
            values: Quantiles::from_samples([f64::from(at), f64::from(at) + 1.0]),
            bound: Some(900.0),
        };
        let rows = (0..1000).map(row).collect();
        let plot = SpreadPlot { title: "Errors".into(), unit: "px", rows };
        let svg = plot.svg();
        let document = roxmltree::Document::parse(&svg).unwrap_or_else(|e| panic!("{e}: {svg}"));
        let dots = document.descendants().filter(|node| node.has_tag_name("circle"));
        assert_eq!(dots.count(), ROWS_MAX);
        assert!(svg.contains("&lt;999&gt;") && svg.contains("936 more"), "{svg}");
        let none = SpreadPlot { title: "Errors".into(), unit: "px", rows: Vec::new() };
        assert_eq!(none.svg(), "");
    }

    #[test]
    fn the_largest_are_kept_behind_many_that_are_equal() {
        let row = |at: u32| Spread {
            name: format!("row {at}"),
            values: Quantiles::from_samples([if at < 70 { 0.0 } else { 10.0 }]),
            bound: None,
        };
        let rows = (0..100).map(row).collect();
        let plot = SpreadPlot { title: "Late".into(), unit: "ms", rows };
        let names: Vec<String> = plot.shown().iter().map(|row| row.name.clone()).collect();
        let wanted: Vec<String> = (0..34).chain(70..100).map(|at| format!("row {at}")).collect();
        assert_eq!(names, wanted);
        assert!(plot.svg().contains("36 more, none larger"), "{}", plot.svg());
    }
}
