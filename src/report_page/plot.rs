//! Line plots as inline SVG, which follow the colours of the page around them.

use super::markup::{add, escaped, number};

/// Width and height of a plot, in CSS pixels.
const SIZE: [f64; 2] = [460.0, 300.0];

/// Space around the axes for labels: left, top, right, bottom.
const MARGIN: [f64; 4] = [64.0, 44.0, 14.0, 46.0];

/// The smallest bound on an axis of bounds, in pixels; below, the axis is linear, so that 0 has a
/// place on it.
const BOUND_KNEE_PX: f64 = 0.25;

/// The approximate number of intervals of a linear axis.
const INTERVALS: f64 = 5.0;

/// The scale by which numbers become places along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scale {
    /// Proportional to the number, from 0.
    Linear,
    /// Linear up to a quarter, and logarithmic above: each doubling takes as much space as the
    /// first quarter.
    Bound,
    /// Logarithmic, for numbers from 1.
    Doublings,
}

impl Scale {
    /// Returns the place of a number, in units of the axis.
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Bound if value <= BOUND_KNEE_PX => value / BOUND_KNEE_PX,
            Self::Bound => 1.0 + (value / BOUND_KNEE_PX).log2(),
            Self::Doublings => value.log2(),
        }
    }
}

/// An axis with its marks.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub label: String,
    pub scale: Scale,
    /// The marked numbers in rising order; the axis reaches from the first to the last one.
    pub marks: Vec<f64>,
}

impl Axis {
    /// Returns an axis from 0 with round marks that reaches at least to `max`.
    pub fn linear(label: &str, max: f64) -> Self {
        let max = if max.is_finite() && max > 0.0 { max } else { 1.0 };
        let power = 10.0_f64.powf((max / INTERVALS).log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
        let step = step.into_iter().find(|step| max / step <= INTERVALS).unwrap_or(max);
        let count = (max / step).ceil() as u32;
        let marks = (0..=count).map(|index| f64::from(index) * step).collect();
        Self { label: label.into(), scale: Scale::Linear, marks }
    }

    /// Returns the part of the axis below a number, from 0 to 1.
    pub fn fraction(&self, value: f64) -> f64 {
        let place = |value: &f64| self.scale.place(*value);
        let ends = self.marks.first().zip(self.marks.last()).map(|(a, b)| (place(a), place(b)));
        match ends {
            Some((from, to)) if to > from => (self.scale.place(value) - from) / (to - from),
            // One mark stands in the middle.
            _ => 0.5,
        }
    }
}

/// A measured value, with the range that half of the measurements lie in if there are several.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    pub x: f64,
    pub y: f64,
    pub quartiles: Option<[f64; 2]>,
}

/// Points of one kind, joined by a line.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub name: String,
    pub points: Vec<Point>,
    /// `true` for a line to compare with, dashed and without markers.
    pub is_guide: bool,
}

/// A plot with one line for each series.
#[derive(Clone, Debug)]
pub(crate) struct Plot {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

impl Plot {
    /// Returns the plot as an SVG element.
    pub fn svg(&self) -> String {
        let [width, height] = SIZE;
        let title = escaped(&self.title);
        let mut svg = format!(
            "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">\n\
             <text class=\"title\" x=\"{}\" y=\"16\">{title}</text>\n",
            MARGIN[0]
        );
        self.add_axes(&mut svg);
        for (index, series) in self.series.iter().enumerate() {
            self.add_series(&mut svg, index, series);
        }
        self.add_legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn place_x(&self, value: f64) -> f64 {
        MARGIN[0] + self.x.fraction(value) * (SIZE[0] - MARGIN[0] - MARGIN[2])
    }

    fn place_y(&self, value: f64) -> f64 {
        let bottom = SIZE[1] - MARGIN[3];
        bottom - self.y.fraction(value) * (bottom - MARGIN[1])
    }

    fn add_axes(&self, svg: &mut String) {
        let (left, right) = (MARGIN[0], SIZE[0] - MARGIN[2]);
        let (top, bottom) = (MARGIN[1], SIZE[1] - MARGIN[3]);
        for &mark in &self.y.marks {
            let (y, text) = (self.place_y(mark), number(mark));
            add(
                svg,
                format_args!(
                    "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y:.1}\" \
                     y2=\"{y:.1}\"/>\
                 <text class=\"mark y\" x=\"{:.1}\" y=\"{:.1}\">{text}</text>\n",
                    left - 6.0,
                    y + 4.0
                ),
            );
        }
        for &mark in &self.x.marks {
            let (x, text) = (self.place_x(mark), number(mark));
            add(
                svg,
                format_args!(
                    "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top}\" \
                     y2=\"{bottom}\"/>\
                 <text class=\"mark x\" x=\"{x:.1}\" y=\"{:.1}\">{text}</text>\n",
                    bottom + 16.0
                ),
            );
        }
        let middle = f64::midpoint(top, bottom);
        add(
            svg,
            format_args!(
                "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\">{}</text>\n\
             <text class=\"label\" transform=\"translate(14 {middle:.1}) rotate(-90)\">{}</text>\n",
                f64::midpoint(left, right),
                SIZE[1] - 10.0,
                escaped(&self.x.label),
                escaped(&self.y.label)
            ),
        );
    }

    fn add_series(&self, svg: &mut String, index: usize, series: &Series) {
        let guide = if series.is_guide { " guide" } else { "" };
        let place =
            |point: &Point| format!("{:.1},{:.1}", self.place_x(point.x), self.place_y(point.y));
        let places: Vec<String> = series.points.iter().map(place).collect();
        add(
            svg,
            format_args!(
                "<polyline class=\"line s{index}{guide}\" points=\"{}\"/>\n",
                places.join(" ")
            ),
        );
        if series.is_guide {
            return;
        }
        for point in &series.points {
            let (x, y) = (self.place_x(point.x), self.place_y(point.y));
            if let Some([low, high]) = point.quartiles {
                let (low, high) = (self.place_y(low), self.place_y(high));
                add(
                    svg,
                    format_args!(
                        "<line class=\"line s{index}\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{low:.1}\" \
                     y2=\"{high:.1}\"/>"
                    ),
                );
            }
            add(
                svg,
                format_args!(
                    "<circle class=\"dot s{index}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\">\
                 <title>{}: {} at {}</title></circle>\n",
                    escaped(&series.name),
                    number(point.y),
                    number(point.x)
                ),
            );
        }
    }

    fn add_legend(&self, svg: &mut String) {
        let mut x = MARGIN[0];
        for (index, series) in self.series.iter().enumerate() {
            let guide = if series.is_guide { " guide" } else { "" };
            add(
                svg,
                format_args!(
                    "<line class=\"line s{index}{guide}\" x1=\"{x:.1}\" x2=\"{:.1}\" y1=\"30\" \
                 y2=\"30\"/><text class=\"legend\" x=\"{:.1}\" y=\"34\">{}</text>\n",
                    x + 18.0,
                    x + 23.0,
                    escaped(&series.name)
                ),
            );
            // Letters of 11 px are about 6 px wide.
            x += 38.0 + 6.0 * series.name.chars().count() as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        let marks = vec![0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
        let axis = Axis { label: "asked <px>".into(), scale: Scale::Bound, marks };
        let point = |x: f64| Point { x, y: x / 2.0, quartiles: Some([x / 4.0, x]) };
        let points = axis.marks.iter().copied().map(point).collect();
        let series = vec![
            Series { name: "measured & seen".into(), points, is_guide: false },
            Series { name: "equal".into(), points: Vec::new(), is_guide: true },
        ];
        Plot { title: "Error".into(), x: axis.clone(), y: axis, series }
    }

    #[test]
    fn bounds_stand_at_equal_distances_and_a_number_on_the_diagonal_is_as_far_on_both_axes() {
        let plot = plot();
        for (index, &mark) in plot.x.marks.iter().enumerate() {
            assert!((plot.x.fraction(mark) - index as f64 / 6.0).abs() < 1e-12, "{mark}");
        }
        for value in [0.0, 0.1, 0.3, 3.0, 8.0] {
            assert_eq!(plot.x.fraction(value), plot.y.fraction(value));
        }
    }

    #[test]
    fn marks_of_a_linear_axis_are_round_and_reach_its_largest_value() {
        for max in [0.003, 0.9, 1.0, 7.3, 58.0, 99.0, 101.0, 2.3e6] {
            let axis = Axis::linear("ms", max);
            let last = *axis.marks.last().expect("a mark");
            assert!(last >= max * (1.0 - 1e-12) && last <= max * 2.0, "{max}: {:?}", axis.marks);
            assert!((3..=7).contains(&axis.marks.len()), "{max}: {:?}", axis.marks);
        }
        for nothing in [0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Axis::linear("ms", nothing).marks.last(), Some(&1.0));
        }
    }

    #[test]
    fn a_plot_is_well_formed_and_has_all_its_points_within() {
        let svg = plot().svg();
        let document = roxmltree::Document::parse(&svg).unwrap_or_else(|e| panic!("{e}: {svg}"));
        let circles: Vec<_> =
            document.descendants().filter(|node| node.has_tag_name("circle")).collect();
        assert_eq!(circles.len(), 7);
        for circle in circles {
            for (key, size) in [("cx", SIZE[0]), ("cy", SIZE[1])] {
                let place: f64 = circle.attribute(key).expect("set").parse().expect("a number");
                assert!((0.0..=size).contains(&place), "{key} {place}");
            }
        }
    }
}
