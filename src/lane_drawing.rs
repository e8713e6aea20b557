//! A recording as lanes over time in one SVG: the manager, each channel, each client.

use polyptych_client::ChannelState;
use polyptych_manager::replay::lanes::{Intervals, Lane, Lanes, Mark};
use polyptych_text::printable;

use crate::report_page::markup::{add, escaped, number};

const STYLE: &str = include_str!("lane_drawing/lanes.css");

/// Width of a drawing, and of the names.
const WIDTH: f64 = 1400.0;
const NAMES: f64 = 190.0;
const MARGIN: f64 = 24.0;

/// Height of the title and the times above the lanes, of a lane, and of the legend.
const HEAD: f64 = 76.0;
const LANE: f64 = 30.0;
const FOOT: f64 = 50.0;

/// Maximum number of lanes of channels, those with most trouble first, and of clients.
const CHANNELS_MAX: usize = 64;
const CLIENTS_MAX: usize = 32;

/// Intervals that are nearer to each other on paper become one.
const GAP_PX: f64 = 0.8;

/// Bars from this width on stay apart, with a gap after each.
const WIDE_PX: f64 = 4.0;

/// Letters of a name, and of the words beside a mark.
const NAME_LETTERS: usize = 28;
const WORD_LETTERS: usize = 60;

/// Width of a letter of these words.
const LETTER_PX: f64 = 5.0;

/// About how far times are from each other.
const TIME_PX: f64 = 110.0;

/// Meanings of classes.
const LEGEND: [(&str, &str); 7] = [
    ("l-frames", "frame: command to swap"),
    ("l-busy", "drawing; camera and frame requests"),
    ("l-shown", "shown; other requests"),
    ("l-late", "late; refused"),
    ("l-wait", "joining, preparing or late"),
    ("l-lost", "lost"),
    ("l-mark", "came, left, asked"),
];

/// Times on paper.
struct TimeAxis {
    from_s: f64,
    to_s: f64,
}

impl TimeAxis {
    fn place(&self, time_s: f64) -> f64 {
        let part = (time_s - self.from_s) / (self.to_s - self.from_s);
        NAMES + part.clamp(0.0, 1.0) * (WIDTH - NAMES - MARGIN)
    }

    /// Round times, with the digits that tell them apart.
    fn times(&self) -> Vec<(f64, String)> {
        let least = (self.to_s - self.from_s) / ((WIDTH - NAMES - MARGIN) / TIME_PX);
        let power = 10.0_f64.powf(least.log10().floor());
        let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
        let step = steps.into_iter().find(|step| *step >= least).unwrap_or(power * 10.0);
        let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
        let (first, last) = ((self.from_s / step).ceil(), (self.to_s / step).floor());
        let count = (last - first).clamp(0.0, 100.0) as u32;
        let time = |index: u32| (first + f64::from(index)) * step;
        (0..=count).map(|index| (time(index), format!("{:.digits$} s", time(index)))).collect()
    }
}

/// Returns the drawing of lanes as an SVG element with its own style, which is well-formed XML and
/// can stand alone or in a page. `about` says which recording it is.
pub(crate) fn svg(lanes: &Lanes, about: &str) -> String {
    let to_s = if lanes.to_s > lanes.from_s { lanes.to_s } else { lanes.from_s + 1e-3 };
    let axis = TimeAxis { from_s: lanes.from_s, to_s };
    let channels = worst(&lanes.channels);
    let clients = &lanes.clients[..lanes.clients.len().min(CLIENTS_MAX)];
    let rows = 1 + channels.len() + clients.len();
    let bottom = HEAD + LANE * rows as f64;
    let mut body = String::new();
    add_head(&mut body, lanes, about);
    add_times(&mut body, &axis, bottom);
    add_name(&mut body, HEAD, "manager", "");
    add_intervals(&mut body, &axis, &lanes.frames, "l-frames", [HEAD + 8.0, 14.0]);
    let mut top = HEAD + LANE;
    for lane in channels {
        add_states(&mut body, &axis, lane, top);
        let server = lane.server.as_ref().filter(|server| **server != lane.name);
        let server = server.map(|server| format!("on {server}")).unwrap_or_default();
        add_name(&mut body, top, &lane.name, &server);
        add_lane(&mut body, &axis, lane, top);
        top += LANE;
    }
    for lane in clients {
        add_name(&mut body, top, &lane.name, "client");
        add_lane(&mut body, &axis, lane, top);
        top += LANE;
    }
    add_legend(&mut body, lanes, bottom);
    let height = bottom + FOOT;
    let about = escaped(about);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"lanes\" width=\"{WIDTH}\" \
         height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{about}\" \
         data-from=\"{}\" data-to=\"{}\">\n<title>{about}</title>\n<style>\n{STYLE}</style>\n\
         <rect class=\"l-paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n{body}</svg>\n",
        lanes.from_s, lanes.to_s
    )
}

/// The lanes with most trouble, in the wall's order.
fn worst(lanes: &[Lane]) -> Vec<&Lane> {
    let trouble = |lane: &Lane| {
        let late: u64 = lane.late.list.iter().map(|(_, _, count)| count).sum();
        late + lane.marks.iter().filter(|mark| mark.is_trouble).count() as u64
            + lane.states.len() as u64
    };
    let mut order: Vec<usize> = (0..lanes.len()).collect();
    order.sort_by_key(|index| std::cmp::Reverse(trouble(&lanes[*index])));
    order.truncate(CHANNELS_MAX);
    order.sort_unstable();
    order.into_iter().map(|index| &lanes[index]).collect()
}

fn add_head(svg: &mut String, lanes: &Lanes, about: &str) {
    let frames: u64 = lanes.frames.list.iter().map(|(_, _, count)| count).sum();
    let text = format!(
        "part {}, {:.3} s to {:.3} s of manager time, frames: {frames}",
        lanes.part, lanes.from_s, lanes.to_s
    );
    let about = escaped(about);
    add(
        svg,
        format_args!(
            "<text class=\"l-head\" x=\"{MARGIN}\" y=\"28\">{about}</text>\n\
             <text x=\"{MARGIN}\" y=\"48\">{text}</text>\n"
        ),
    );
}

fn add_times(svg: &mut String, axis: &TimeAxis, bottom: f64) {
    let mut grid = String::new();
    for (time, text) in axis.times() {
        let x = axis.place(time);
        add(&mut grid, format_args!("M{x:.1} {HEAD}V{bottom}"));
        let y = HEAD - 6.0;
        add(svg, format_args!("<text class=\"l-time\" x=\"{x:.1}\" y=\"{y}\">{text}</text>\n"));
    }
    add(svg, format_args!("<path class=\"l-grid\" d=\"{grid}\"/>\n"));
}

fn add_name(svg: &mut String, top: f64, name: &str, below: &str) {
    let short: String = name.chars().take(NAME_LETTERS).collect();
    let (x, right) = (NAMES - 8.0, WIDTH - MARGIN);
    let text = escaped(&printable(&short));
    let y = if below.is_empty() { top + 19.0 } else { top + 14.0 };
    add(
        svg,
        format_args!(
            "<path class=\"l-line\" d=\"M{MARGIN} {top}H{right}\"/>\
             <text class=\"l-name\" x=\"{x}\" y=\"{y}\">{text}</text>\n"
        ),
    );
    if !below.is_empty() {
        let below: String = below.chars().take(NAME_LETTERS).collect();
        let (y, below) = (top + 25.0, escaped(&printable(&below)));
        add(
            svg,
            format_args!("<text class=\"l-name l-word\" x=\"{x}\" y=\"{y}\">{below}</text>\n"),
        );
    }
}

/// Adds intervals as bars between two heights, those that touch on paper as one.
fn add_intervals(
    svg: &mut String,
    axis: &TimeAxis,
    of: &Intervals,
    class: &str,
    [top, height]: [f64; 2],
) {
    let mut bars: Vec<(f64, f64)> = Vec::new();
    for (from, to, _) in &of.list {
        let (from, to) = (axis.place(*from), axis.place(*to));
        match bars.last_mut() {
            Some(last) if from - last.1 < GAP_PX && (last.1 - last.0).min(to - from) < WIDE_PX => {
                last.1 = last.1.max(to);
            }
            _ => bars.push((from, to)),
        }
    }
    if bars.is_empty() {
        return;
    }
    let bar = |(from, to): (f64, f64)| {
        let gap = if to - from < WIDE_PX { 0.0 } else { GAP_PX };
        let width = (to - from - gap).max(GAP_PX);
        format!("M{from:.1} {top}h{width:.1}v{height}h-{width:.1}z")
    };
    let data: String = bars.into_iter().map(bar).collect();
    add(svg, format_args!("<path class=\"{class}\" d=\"{data}\"/>\n"));
}

fn add_states(svg: &mut String, axis: &TimeAxis, lane: &Lane, top: f64) {
    let ends = lane.states.iter().skip(1).map(|(at, _)| *at).chain([axis.to_s]);
    for ((from, state), to) in lane.states.iter().zip(ends) {
        let class = match state {
            ChannelState::Live => continue,
            ChannelState::Lost => "l-lost",
            _ => "l-wait",
        };
        let (x, width) = (axis.place(*from), axis.place(to) - axis.place(*from));
        add(
            svg,
            format_args!(
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{top}\" width=\"{:.1}\" \
                 height=\"{LANE}\"><title>{state} from {from:.3} s to {to:.3} s</title></rect>\n",
                width.max(0.6)
            ),
        );
    }
}

fn add_lane(svg: &mut String, axis: &TimeAxis, lane: &Lane, top: f64) {
    add_intervals(svg, axis, &lane.busy, "l-busy", [top + 4.0, 7.0]);
    add_intervals(svg, axis, &lane.shown, "l-shown", [top + 12.0, 5.0]);
    add_intervals(svg, axis, &lane.late, "l-late", [top + 2.0, LANE - 4.0]);
    let marks = lane.marks.iter().filter(|mark| mark.at_s >= axis.from_s && mark.at_s <= axis.to_s);
    let marks: Vec<&Mark> = marks.collect();
    let mut end = WIDTH;
    if lane.marks_more > 0 {
        let text = format!("and {} more", number(lane.marks_more as f64));
        let (x, y) = (WIDTH - MARGIN, top + 26.5);
        end = x - LETTER_PX * text.chars().count() as f64;
        let class = "l-name l-word";
        add(svg, format_args!("<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{text}</text>\n"));
    }
    for (index, mark) in marks.iter().enumerate() {
        let (x, y) = (axis.place(mark.at_s), top + 23.5);
        let class = if mark.is_trouble { "l-trouble" } else { "l-mark" };
        let text = printable(&mark.text);
        let full = escaped(&text);
        add(
            svg,
            format_args!(
                "<path class=\"{class}\" d=\"M{x:.1} {:.1}l3 3l-3 3l-3 -3z\"><title>{:.3} s: \
                 {full}</title></path>\n",
                y - 3.0,
                mark.at_s
            ),
        );
        // Its words where there is room before the next one.
        let next = marks.get(index + 1).map_or(end, |next| axis.place(next.at_s).min(end));
        let room = ((next - x - 10.0) / LETTER_PX).max(0.0) as usize;
        let letters = text.chars().count().min(WORD_LETTERS);
        if room >= letters.min(12) && letters > 0 {
            let short: String = text.chars().take(room.min(WORD_LETTERS)).collect();
            add(
                svg,
                format_args!(
                    "<text class=\"l-word\" x=\"{:.1}\" y=\"{:.1}\">{}</text>\n",
                    x + 5.0,
                    y + 3.0,
                    escaped(&short)
                ),
            );
        }
    }
}

fn add_legend(svg: &mut String, lanes: &Lanes, bottom: f64) {
    let mut x = MARGIN;
    let y = bottom + 22.0;
    for (class, text) in LEGEND {
        add(
            svg,
            format_args!(
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"18\" height=\"9\"/>\
                 <text x=\"{:.1}\" y=\"{y}\">{text}</text>\n",
                y - 8.0,
                x + 24.0
            ),
        );
        x += 52.0 + 5.8 * text.chars().count() as f64;
    }
    let hidden = lanes.channels.len().saturating_sub(CHANNELS_MAX)
        + lanes.clients.len().saturating_sub(CLIENTS_MAX);
    if hidden > 0 {
        let text = format!("lanes that are not drawn: {}", number(hidden as f64));
        let y = bottom + 42.0;
        add(svg, format_args!("<text x=\"{MARGIN}\" y=\"{y}\">{text}</text>\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn intervals(list: Vec<(f64, f64, u64)>) -> Intervals {
        let mut intervals = Intervals::default();
        intervals.list = list;
        intervals
    }

    fn lane(name: &str) -> Lane {
        Lane {
            name: name.to_owned(),
            server: Some("pc-1".to_owned()),
            states: vec![(1.0, ChannelState::Live), (3.0, ChannelState::Lost)],
            busy: intervals(vec![(1.0, 1.5, 1), (2.0, 2.5, 3)]),
            marks: vec![Mark { at_s: 3.0, is_trouble: true, text: "lost: <gone>\u{1b}".into() }],
            ..Lane::default()
        }
    }

    #[test]
    fn lanes_stand_at_their_times_and_any_text_is_well_formed() {
        let channels = (0..100).map(|index| lane(&format!("c<{index}>"))).collect();
        let lanes = Lanes {
            part: 1,
            from_s: 1.0,
            to_s: 5.0,
            frames: intervals(vec![(1.0, 2.0, 1)]),
            channels,
            clients: vec![Lane { marks_more: 17, ..lane("demo & more") }],
            ..Lanes::default()
        };
        let text = svg(&lanes, "a < b");
        let document = roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}"));
        let of_class = |class: &str| {
            document.descendants().filter(|n| n.attribute("class") == Some(class)).count()
        };
        assert_eq!(of_class("l-lost"), CHANNELS_MAX + 1, "and the legend");
        assert!(text.contains("lanes that are not drawn: 36"), "{text}");
        assert!(text.contains(">and 17 more</text>"), "{text}");
        let frames = document.descendants().find(|n| n.attribute("class") == Some("l-frames"));
        let data = frames.and_then(|node| node.attribute("d")).expect("a bar");
        // A quarter of the time, from the beginning on.
        let width = (WIDTH - NAMES - MARGIN) / 4.0 - GAP_PX;
        assert!(data.starts_with(&format!("M{NAMES:.1} ")), "{data}");
        assert!(data.contains(&format!("h{width:.1}v")), "{data}");
    }

    #[test]
    fn times_are_round_and_few() {
        for (from_s, to_s) in [(0.0, 0.01), (5.0, 65.0), (1e5, 1e5 + 7200.0)] {
            let times = TimeAxis { from_s, to_s }.times();
            assert!((3..=25).contains(&times.len()), "{from_s} {to_s}: {times:?}");
            assert!(times.iter().all(|(time, _)| *time >= from_s - 1e-9 && *time <= to_s + 1e-9));
        }
        let nothing = svg(&Lanes { from_s: 2.0, to_s: 2.0, ..Lanes::default() }, "empty");
        assert!(!nothing.contains("NaN"), "{nothing}");
    }
}
