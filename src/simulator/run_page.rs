//! `report.html`: the run of a simulated wall as one page.

use std::collections::BTreeSet;

use image::RgbaImage;
use polyptych_client::{ChannelStatistics, FramePass};
use polyptych_text::counted;
use polyptych_wall::Wall;
use polyptych_wall_file::check_report::CheckReport;
use polyptych_wall_file::coverage::is_plain_tile;

use super::frame_series::{FrameSample, FrameSeries};
use super::run_report::RunReport;
use crate::report_page::embedded_image::EmbeddedImage;
use crate::report_page::heat_rows::HeatRows;
use crate::report_page::markup::{add, escaped, number};
use crate::report_page::plot::{Axis, Plot, Point, Series};
use crate::report_page::spread_plot::{Spread, SpreadPlot};
use crate::report_page::{self, add_facts, add_row, begin_table, end_table};
use crate::wall_drawing;

/// Maximum number of points of a line of a plot: more are drawn over each other.
const POINTS_MAX: usize = 300;

/// Maximum number of notes, and of faults, that are listed.
const LINES_MAX: usize = 64;

/// Maximum number of channels in the table; `report.json` has all.
const CHANNELS_MAX: usize = 256;

const MIB: f64 = 1024.0 * 1024.0;

/// Returns the page of a run, which is well-formed XML below its first line, with the last picture
/// of the wall.
///
/// # Errors
/// A picture without pixels.
pub(crate) fn page(
    wall: &Wall,
    report: &RunReport,
    series: &FrameSeries,
    picture: &RgbaImage,
) -> anyhow::Result<String> {
    let title = format!("Run of wall {}", report.wall);
    let mut body =
        format!("<h1>{}</h1>\n<p>{}.</p>\n", escaped(&title), escaped(&report.summary()));
    add_facts(&mut body, &facts(report));
    add_troubles(&mut body, report);
    body.push_str("<h2>The last frame</h2>\n");
    body.push_str(&EmbeddedImage::photograph(picture)?.svg("the wall's picture", &[]));
    add_frames(&mut body, series);
    add_channels(&mut body, report);
    body.push_str("<h2>The wall</h2>\n");
    // Numbers of others take seconds: who looks for them asks for them.
    if wall.files.is_empty() && wall.channels.iter().all(is_plain_tile) {
        body.push_str(&wall_drawing::svg(wall.into(), &CheckReport::from_wall(wall)));
    } else {
        body.push_str("<p class=\"note\">Drawn by polyptych check WALL.toml --svg FILE.</p>\n");
    }
    Ok(report_page::page(&title, &body))
}

fn facts(report: &RunReport) -> Vec<(&'static str, String)> {
    let all = &report.statistics;
    let ended = format!("{:?}", report.ended).to_lowercase();
    let bound = number(all.error_bound_px);
    let (force, least) = (all.error_in_force_px, all.resolution_scale.min);
    vec![
        ("Scene", report.scene.clone()),
        ("Needs", all.features.join(", ")),
        ("Graphics adapter", report.adapter.clone()),
        ("Ended", format!("{ended}; servers started again: {}", report.restarts)),
        (
            "Bounds",
            format!(
                "error asked for {bound} px; in force: median {} px, at most {} px; least \
                 resolution {least:.2}; largest stated error {} px",
                number(force.p50),
                number(force.max),
                number(all.largest_error_px)
            ),
        ),
        ("Swap skew", quantiles(all.swap_skew_us, "µs")),
        ("Late", all.late.to_string()),
        ("Limiting channel", all.limiting_channel.clone().unwrap_or_else(|| "none".into())),
        ("GPU memory", format!("{:.1} MiB", all.gpu_bytes as f64 / MIB)),
        ("Program", format!("polyptych {}", env!("CARGO_PKG_VERSION"))),
    ]
}

fn quantiles(of: polyptych_client::Quantiles, unit: &str) -> String {
    let [median, most, max] = [of.p50, of.p95, of.max].map(number);
    format!("median {median} {unit}, 95 % {most} {unit}, at most {max} {unit}")
}

/// Adds missing channels, notes, and the effects of faults.
fn add_troubles(body: &mut String, report: &RunReport) {
    for (channel, reason) in report.missing.iter().take(LINES_MAX) {
        let (channel, reason) = (escaped(channel), escaped(reason));
        add(
            body,
            format_args!(
                "<p class=\"failure\">Channel {channel} is missing in the picture: {reason}</p>\n"
            ),
        );
    }
    for note in report.notes.iter().take(LINES_MAX) {
        add(body, format_args!("<p class=\"note\">Note: {}</p>\n", escaped(note)));
    }
    if report.faults.is_empty() {
        return;
    }
    body.push_str("<h2>Faults</h2>\n<ul>\n");
    for fault in report.faults.iter().take(LINES_MAX) {
        add(body, format_args!("<li>{}</li>\n", escaped(&fault.line())));
    }
    body.push_str("</ul>\n");
    let more = report.faults.len().saturating_sub(LINES_MAX) as u64 + report.faults_unrecorded;
    if more > 0 {
        let text = counted(more, "more fault");
        add(body, format_args!("<p class=\"note\">{text}; see report.json</p>\n"));
    }
}

fn add_frames(body: &mut String, series: &FrameSeries) {
    if series.samples.is_empty() {
        body.push_str("<p class=\"failure\">No frame was drawn.</p>\n");
        return;
    }
    body.push_str("<h2>Frames over time</h2>\n<div class=\"plots\">\n");
    body.push_str(&time_plot(series).svg());
    body.push_str(&bounds_plot(series).svg());
    body.push_str("</div>\n");
    let times_s: Vec<f64> = series.samples.iter().map(|sample| sample.at_s).collect();
    let row = |(index, name): (usize, &String)| {
        let value =
            |sample: &FrameSample| sample.draw_ms.get(index).map_or(f64::NAN, |ms| f64::from(*ms));
        (name.clone(), series.samples.iter().map(value).collect())
    };
    let rows = series.names.iter().enumerate().map(row).collect();
    let title = "Drawing time of each channel".to_owned();
    let missing = "late, or not shown for another reason";
    body.push_str(&HeatRows { title, unit: "ms", missing, times_s, rows }.svg());
}

/// Returns the worst of a number in each of [`POINTS_MAX`] parts of a run.
fn worst(series: &FrameSeries, of: impl Fn(&FrameSample) -> f64) -> Vec<Point> {
    let step = series.samples.len().div_ceil(POINTS_MAX).max(1);
    let point = |part: &[FrameSample]| Point {
        x: part[0].at_s,
        y: part.iter().map(&of).fold(0.0, f64::max),
        quartiles: None,
    };
    series.samples.chunks(step).map(point).collect()
}

fn line(name: &str, points: Vec<Point>) -> Series {
    Series { name: name.into(), points, is_guide: false }
}

fn time_plot(series: &FrameSeries) -> Plot {
    let slowest = |sample: &FrameSample| {
        let drawn = sample.draw_ms.iter().copied().filter(|ms| ms.is_finite());
        f64::from(drawn.fold(0.0, f32::max))
    };
    let frames = worst(series, |sample| sample.frame_ms);
    let largest = frames.iter().map(|point| point.y).fold(0.0, f64::max);
    Plot {
        title: "Time of a frame, and of its slowest channel".into(),
        x: Axis::linear("seconds", series.samples.last().map_or(0.0, |last| last.at_s)),
        y: Axis::linear("ms", largest),
        series: vec![
            line("frame", frames),
            line("drawing", worst(series, slowest)),
            line("barrier", worst(series, |sample| sample.barrier_ms)),
        ],
    }
}

fn bounds_plot(series: &FrameSeries) -> Plot {
    let errors = worst(series, |sample| sample.error_in_force_px);
    let largest = errors.iter().map(|point| point.y).fold(1.0, f64::max);
    let left_out = worst(series, |sample| 1.0 - sample.resolution_scale);
    Plot {
        title: "Error bound in force, and pixels left out".into(),
        x: Axis::linear("seconds", series.samples.last().map_or(0.0, |last| last.at_s)),
        y: Axis::linear("px; share of a side", largest),
        series: vec![line("error bound, px", errors), line("share left out", left_out)],
    }
}

fn add_channels(body: &mut String, report: &RunReport) {
    let channels = &report.statistics.channels;
    body.push_str("<h2>Channels</h2>\n");
    let spread = |of: &dyn Fn(usize) -> polyptych_client::Quantiles| {
        let row = |index: usize| Spread {
            name: channels[index].name.clone(),
            values: of(index),
            bound: None,
        };
        (0..channels.len()).map(row).collect::<Vec<Spread>>()
    };
    let title = "Drawing time: median / 95 % / maximum".to_owned();
    body.push_str(
        &SpreadPlot { title, unit: "ms", rows: spread(&|at| channels[at].draw_ms) }.svg(),
    );
    let title = "Swap skew to the first channel: median / 95 % / maximum".to_owned();
    body.push_str(
        &SpreadPlot { title, unit: "µs", rows: spread(&|at| channels[at].swap_skew_us) }.svg(),
    );
    let headings = [
        "Channel",
        "State",
        "Frames shown",
        "Frame, ms",
        "95 %",
        "Late",
        "Longest gap, ms",
        "Clock off by, µs",
        "Triangles",
        "Draw calls",
        "Server, MiB",
    ];
    begin_table(body, "At the end of the run", &headings);
    for channel in channels.iter().take(CHANNELS_MAX) {
        let cells = [
            channel.name.clone(),
            channel.state.to_string(),
            channel.frames.to_string(),
            format!("{:.1}", channel.frame_ms.p50),
            format!("{:.1}", channel.frame_ms.p95),
            channel.late.to_string(),
            format!("{:.0}", channel.longest_gap_ms),
            channel.clock_error_us.to_string(),
            channel.triangles.to_string(),
            channel.draw_calls.to_string(),
            format!("{:.0}", channel.memory_bytes as f64 / MIB),
        ];
        add_row(body, &cells);
    }
    end_table(body);
    if channels.len() > CHANNELS_MAX {
        let more = channels.len() - CHANNELS_MAX;
        add(body, format_args!("<p class=\"note\">{more} more are in report.json.</p>\n"));
    }
    add_passes(body, channels);
}

/// Adds how long the passes of frames took, if that was measured: a row for each channel.
fn add_passes(body: &mut String, channels: &[ChannelStatistics]) {
    let passes: BTreeSet<FramePass> =
        channels.iter().flat_map(|channel| channel.passes_us.keys().copied()).collect();
    if passes.is_empty() {
        return;
    }
    let names = passes.iter().map(|pass| pass.name());
    let headings: Vec<&str> = std::iter::once("Channel").chain(names).collect();
    let title = "Passes of a frame: mean time on the GPU in milliseconds, of one frame in eight";
    begin_table(body, title, &headings);
    for channel in channels.iter().take(CHANNELS_MAX) {
        let time = |pass| match channel.passes_us.get(pass) {
            Some(us) => format!("{:.2}", *us as f64 / 1000.0),
            None => "–".to_owned(),
        };
        let cells: Vec<String> =
            std::iter::once(channel.name.clone()).chain(passes.iter().map(time)).collect();
        add_row(body, &cells);
    }
    end_table(body);
}
