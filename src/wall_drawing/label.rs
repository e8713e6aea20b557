//! Labels that do not lie over each other.

use glam::DVec2;

use crate::report_page::markup::{add, escaped};

/// Width of a letter in heights of it, on average; of wide ones (CJK) 1.
const LETTER: f64 = 0.57;

/// Height of a line in heights of a letter.
const LINE: f64 = 1.25;

/// Width of the line of paper around letters, in heights of them, and at most.
const HALO: f64 = 0.27;
const HALO_MAX: f64 = 3.0;

/// The places of a drawing that labels have taken, as low and high corners.
#[derive(Debug, Default)]
pub(super) struct Labels {
    taken: Vec<[DVec2; 2]>,
}

/// A text of some lines, the first of which is a name.
#[derive(Clone, Debug)]
pub(super) struct Label {
    lines: Vec<String>,
    /// Height of its letters.
    size: f64,
}

/// Returns the approximate width of a line.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let letters = text.chars().map(|c| if (c as u32) < 0x1100 { LETTER } else { 1.0 });
    letters.sum::<f64>() * size
}

/// Returns a text that is no wider than this, cut with an ellipsis.
pub(super) fn shortened(text: &str, size: f64, width_max: f64) -> String {
    if width(text, size) <= width_max {
        return text.to_owned();
    }
    let mut short = String::new();
    for c in text.chars() {
        if width(&short, size) + 2.0 * size > width_max {
            break;
        }
        short.push(c);
    }
    short + "…"
}

impl Label {
    pub fn new(lines: impl IntoIterator<Item = String>, size: f64) -> Self {
        Self { lines: lines.into_iter().collect(), size }
    }

    /// Returns width and height.
    pub fn extent(&self) -> DVec2 {
        let widths = self.lines.iter().map(|line| width(line, self.size));
        let height = self.lines.len() as f64 * LINE * self.size;
        DVec2::new(widths.fold(0.0, f64::max), height)
    }

    /// Adds it to a drawing with its middle at a place.
    pub fn add_to(&self, svg: &mut String, middle: DVec2) {
        let top = middle.y - self.extent().y / 2.0;
        for (index, line) in self.lines.iter().enumerate() {
            let class = if index == 0 { "w-name" } else { "w-fact" };
            let y = top + (index as f64 + 0.8) * LINE * self.size;
            let (x, size, text) = (middle.x, self.size, escaped(line));
            let halo = (size * HALO).min(HALO_MAX);
            add(
                svg,
                format_args!(
                    "<text class=\"{class} w-middle\" x=\"{x:.1}\" y=\"{y:.1}\" \
                     style=\"font-size:{size:.1}px;stroke-width:{halo:.1}px\">{text}</text>\n"
                ),
            );
        }
    }
}

impl Labels {
    /// Keeps labels out of a rectangle.
    pub fn take(&mut self, low: DVec2, high: DVec2) {
        self.taken.push([low, high]);
    }

    /// Takes the first of some middles at which a label lies within `bounds` and over no other
    /// one.
    pub fn place(
        &mut self,
        label: &Label,
        bounds: [DVec2; 2],
        middles: impl IntoIterator<Item = DVec2>,
    ) -> Option<DVec2> {
        let half = label.extent() / 2.0;
        let is_free = |middle: &DVec2| {
            let (low, high) = (*middle - half, *middle + half);
            let is_in = low.cmpge(bounds[0]).all() && high.cmple(bounds[1]).all();
            let is_over = |[a, b]: &[DVec2; 2]| low.cmplt(*b).all() && a.cmplt(high).all();
            is_in && !self.taken.iter().any(is_over)
        };
        let found = middles.into_iter().find(is_free)?;
        self.take(found - half, found + half);
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_goes_where_none_is_or_nowhere() {
        let mut labels = Labels::default();
        let label = Label::new(["front".to_owned(), "4 × 3 m".to_owned()], 10.0);
        let bounds = [DVec2::ZERO, DVec2::splat(100.0)];
        let places = [DVec2::splat(50.0), DVec2::new(50.0, 80.0), DVec2::new(50.0, 99.0)];
        assert_eq!(labels.place(&label, bounds, places), Some(places[0]));
        assert_eq!(labels.place(&label, bounds, places), Some(places[1]));
        assert_eq!(labels.place(&label, bounds, places), None);
    }

    #[test]
    fn long_texts_are_cut_to_their_width() {
        let short = shortened(&"wide".repeat(40), 10.0, 60.0);
        assert!(short.ends_with('…') && width(&short, 10.0) <= 60.0, "{short}");
        assert_eq!(shortened("a", 10.0, 60.0), "a");
    }
}
