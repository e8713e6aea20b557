//! `report.html`: one file with tables and plots, without scripts.

use polyptych_wall::ShadowFilter;

use super::frame_samples::FrameCosts;
use super::scene_report::{BoundReport, RunInfo, SceneReport, shadows_name};
use crate::report_page::markup::{add, escaped, number};
use crate::report_page::plot::{Axis, Plot, Point, Scale, Series};
use crate::report_page::{self, add_facts, add_row, begin_table, end_table};

/// Bytes of a MiB.
const MIB: f64 = 1024.0 * 1024.0;

/// Returns the report of a run as an HTML file, which is well-formed XML below its first line.
pub(crate) fn page(run: &RunInfo, scenes: &[SceneReport]) -> String {
    let mut body = format!(
        "<h1>Speed against error</h1>\n\
         <p>What frames cost at each error bound, and how far their pictures are from those of \
         full detail. Measured by polyptych {}.</p>\n",
        run.version
    );
    add_run(&mut body, run, scenes);
    body.push_str(&meaning(run));
    for scene in scenes {
        add_scene(&mut body, scene);
    }
    report_page::page("Speed against error", &body)
}

fn add_run(body: &mut String, run: &RunInfo, scenes: &[SceneReport]) {
    let [width, height] = run.size;
    let rounds = polyptych_text::counted(run.repetitions, "round");
    let mut adapters: Vec<&str> =
        scenes.iter().map(|scene| scene.adapter.as_str()).filter(|name| !name.is_empty()).collect();
    adapters.dedup();
    let rows = [
        ("Date", run.date.clone()),
        ("Machine", format!("{}, {} cores, {}", run.processor, run.cores, run.system)),
        ("Graphics adapter", adapters.join("; ")),
        ("Wall", format!("{width} × {height} pixels in all, one server process")),
        ("Frames", format!("{} of each setting in each of {rounds}", run.frames)),
        ("Command", run.command.clone()),
    ];
    add_facts(body, &rows);
}

/// The meaning of the numbers.
fn meaning(run: &RunInfo) -> String {
    let is_random = run.random_views.is_some();
    let poses = run.poses.to_string() + if is_random { " random poses" } else { " poses" };
    let factor = run.supersampling;
    format!(
        "<details open=\"open\">\n<summary>What the numbers mean</summary>\n<dl>\n\
         <dt>Error bound</dt><dd>The error in pixels that is asked for; 0 is full detail.</dd>\n\
         <dt>Frame</dt><dd>Time from the frame command to the swap command: the median of all \
         frames, the range that half of them lie in, and the time that 95 % do not exceed. The \
         camera goes around the scene by 1° a frame. Settings take turns in every round.</dd>\n\
         <dt>Empty frame</dt><dd>The same wall and scene while only an empty node is shown: what a \
         frame costs without anything to draw.</dd>\n\
         <dt>Flat colour</dt><dd>The same geometry and poses without materials, textures and \
         lights: what no shading can be faster than.</dd>\n\
         <dt>Step of the load</dt><dd>A rate bound of 1.3 frames of one camera while the scene is \
         shown by one camera, by two on a half of the pixels each, and by one again. In time are \
         frames that took no longer than the bound's period.</dd>\n\
         <dt>Stated error</dt><dd>The largest error in pixels that the servers state for what they \
         drew or left out in any timed frame.</dd>\n\
         <dt>Silhouette</dt><dd>The largest distance in pixels between the outlines of the scene \
         at this bound and at full detail, in either direction, over {poses}. The outline \
         separates pixels that differ from the background; edges in front of other parts of the \
         scene are not in it. A feature that vanishes counts by how far its outline has to move to \
         close over it, which is half of its width. It is measured on pictures of \
         {factor} × {factor} pixels for each pixel, \
         so that the number is a whole multiple of 1/{factor} px along rows and columns, and can \
         exceed the true distance by that much.</dd>\n\
         <dt>FLIP</dt><dd>The difference that a viewer sees who alternates between both pictures, \
         from 0 to 1 (LDR-FLIP, Andersson et al. 2020, 67 pixels per degree): the mean over all \
         pixels and poses, and what 99 of 100 pixels do not exceed in the worst pose.</dd>\n\
         <dt>GPU and server</dt><dd>Textures and meshes on the GPU; resident memory of the server \
         process.</dd>\n</dl>\n</details>\n"
    )
}

fn add_scene(page: &mut String, scene: &SceneReport) {
    let name = escaped(&scene.scene);
    add(page, format_args!("<section>\n<h2>{name}</h2>\n"));
    if let Some(reason) = &scene.error {
        let reason = escaped(reason);
        add(page, format_args!("<p class=\"failure\">Not measured: {reason}</p>\n</section>\n"));
        return;
    }
    let triangles = number(scene.scene_triangles as f64);
    add(page, format_args!("<p>{}, {triangles} triangles.</p>\n", escaped(&scene.file)));
    for note in &scene.notes {
        add(page, format_args!("<p class=\"note\">Note: {}</p>\n", escaped(note)));
    }
    page.push_str("<div class=\"plots\">\n");
    for plot in plots(scene) {
        page.push_str(&plot.svg());
    }
    page.push_str("</div>\n");
    page.push_str(&bounds_table(scene));
    page.push_str(&other_table(scene));
    if let Some(reason) = &scene.flat_error {
        let reason = escaped(reason);
        add(page, format_args!("<p class=\"failure\">Flat colour: {reason}</p>\n"));
    }
    add_load_step(page, scene);
    add_peers(page, scene);
    page.push_str("</section>\n");
}

fn plots(scene: &SceneReport) -> [Plot; 4] {
    let marks: Vec<f64> = scene.bounds.iter().map(|bound| bound.error_bound_px).collect();
    let asked =
        || Axis { label: "error bound, px".into(), scale: Scale::Bound, marks: marks.clone() };
    let largest =
        |of: &dyn Fn(&BoundReport) -> f64| scene.bounds.iter().map(of).fold(0.0, f64::max);
    let times = scene.bounds.iter().map(|bound| time_point(bound.error_bound_px, &bound.frames));
    let empty_ms = scene.empty_frame.map_or(0.0, |frame| frame.frame_ms);
    let flat = |y: f64| ends(&marks).map(|x| Point { x, y, quartiles: None }).to_vec();
    let time = Plot {
        title: "Time of a frame".into(),
        x: asked(),
        y: Axis::linear("ms", largest(&|bound| bound.frames.frame_ms_spread.p75)),
        series: vec![
            series("median and quartiles", times.collect()),
            Series { is_guide: true, ..series("empty frame", flat(empty_ms)) },
        ],
    };
    let value = |of: &dyn Fn(&BoundReport) -> f64| {
        let point = |b: &BoundReport| Point { x: b.error_bound_px, y: of(b), quartiles: None };
        scene.bounds.iter().map(point).collect::<Vec<Point>>()
    };
    let triangles = |bound: &BoundReport| bound.frames.triangles as f64;
    let detail = Plot {
        title: "Triangles drawn".into(),
        x: asked(),
        y: Axis::linear("triangles", largest(&triangles)),
        series: vec![series("median frame", value(&triangles))],
    };
    let stated = |bound: &BoundReport| bound.frames.largest_error_px;
    let silhouette = |bound: &BoundReport| bound.silhouette_px.unwrap_or_default();
    let worst = largest(&|bound| silhouette(bound).max(stated(bound)));
    let mut errors = asked();
    errors.label = "error, px".into();
    // An error beyond the largest bound is shown, not cut off.
    while errors.marks.last().is_some_and(|&last| last < worst) {
        errors.marks.push(errors.marks.last().map_or(1.0, |last| (last * 2.0).max(1.0)));
    }
    let diagonal = ends(&marks).map(|x| Point { x, y: x, quartiles: None }).to_vec();
    let error = Plot {
        title: "Measured error".into(),
        x: asked(),
        y: errors,
        series: vec![
            series("silhouette", value(&silhouette)),
            series("stated", value(&stated)),
            Series { is_guide: true, ..series("as asked", diagonal) },
        ],
    };
    [time, detail, error, scaling(scene)]
}

fn scaling(scene: &SceneReport) -> Plot {
    let marks: Vec<f64> = scene.channels.iter().map(|c| f64::from(c.channels)).collect();
    let frames = scene.channels.iter().map(|c| time_point(f64::from(c.channels), &c.frames));
    let drawing = scene.channels.iter().map(|c| Point {
        x: f64::from(c.channels),
        y: c.frames.draw_ms,
        quartiles: None,
    });
    let largest = scene.channels.iter().map(|c| c.frames.frame_ms_spread.p75.max(c.frames.draw_ms));
    Plot {
        title: "The same pixels on more channels".into(),
        x: Axis { label: "channels".into(), scale: Scale::Doublings, marks },
        y: Axis::linear("ms", largest.fold(0.0, f64::max)),
        series: vec![
            series("frame, with quartiles", frames.collect()),
            series("drawing, all channels", drawing.collect()),
        ],
    }
}

fn series(name: &str, points: Vec<Point>) -> Series {
    Series { name: name.into(), points, is_guide: false }
}

fn time_point(x: f64, frames: &FrameCosts) -> Point {
    let spread = &frames.frame_ms_spread;
    Point { x, y: frames.frame_ms, quartiles: Some([spread.p25, spread.p75]) }
}

/// The first and last number of a list; 0 of an empty one.
fn ends(list: &[f64]) -> [f64; 2] {
    [list.first(), list.last()].map(|end| end.copied().unwrap_or(0.0))
}

fn bounds_table(scene: &SceneReport) -> String {
    let full_ms = scene.bounds.first().map_or(0.0, |bound| bound.frames.frame_ms);
    let mut table = String::new();
    begin_table(
        &mut table,
        "One channel at each error bound",
        &[
            "Bound, px",
            "Frame, ms",
            "Quartiles",
            "95 %",
            "Of full detail",
            "Triangles",
            "Draw calls",
            "Stated error, px",
            "Silhouette, px",
            "FLIP, mean",
            "FLIP, 99 %",
            "GPU, MiB",
            "Server, MiB",
        ],
    );
    for bound in &scene.bounds {
        let (frames, spread) = (&bound.frames, &bound.frames.frame_ms_spread);
        let cells = [
            number(bound.error_bound_px),
            format!("{:.1}", frames.frame_ms),
            format!("{:.1} to {:.1}", spread.p25, spread.p75),
            format!("{:.1}", spread.p95),
            ratio(frames.frame_ms, full_ms),
            frames.triangles.to_string(),
            frames.draw_calls.to_string(),
            format!("{:.2}", frames.largest_error_px),
            bound.silhouette_px.map_or_else(|| "not seen".to_owned(), |px| format!("{px:.2}")),
            format!("{:.4}", bound.flip),
            format!("{:.4}", bound.flip_p99),
            format!("{:.1}", bound.memory.gpu_bytes as f64 / MIB),
            format!("{:.0}", bound.memory.server_bytes as f64 / MIB),
        ];
        add_row(&mut table, &cells);
    }
    end_table(&mut table);
    table
}

fn other_table(scene: &SceneReport) -> String {
    let full_ms = scene.bounds.first().map_or(0.0, |bound| bound.frames.frame_ms);
    let mut table = String::new();
    begin_table(
        &mut table,
        "The same pixels otherwise, at full detail",
        &[
            "Setting",
            "Frame, ms",
            "Quartiles",
            "95 %",
            "Of one channel",
            "Drawing, all channels, ms",
            "Draw calls",
        ],
    );
    let empty = scene.empty_frame.iter().map(|frames| ("empty frame".to_owned(), frames));
    let flat = scene.flat_frame.iter().map(|frames| ("flat colour".to_owned(), frames));
    let channels =
        scene.channels.iter().map(|c| (polyptych_text::counted(c.channels, "channel"), &c.frames));
    let samples = scene
        .samples
        .iter()
        .filter(|s| s.samples > 1)
        .map(|s| (format!("{} samples a pixel", s.samples), &s.frames));
    let other_shadows = scene.shadows.iter().filter(|s| s.shadows != ShadowFilter::default());
    let shadows = other_shadows.map(|s| (shadows_name(s.shadows).to_owned(), &s.frames));
    for (name, frames) in empty.chain(flat).chain(channels).chain(samples).chain(shadows) {
        let spread = &frames.frame_ms_spread;
        let cells = [
            name,
            format!("{:.1}", frames.frame_ms),
            format!("{:.1} to {:.1}", spread.p25, spread.p75),
            format!("{:.1}", spread.p95),
            ratio(frames.frame_ms, full_ms),
            format!("{:.1}", frames.draw_ms),
            frames.draw_calls.to_string(),
        ];
        add_row(&mut table, &cells);
    }
    end_table(&mut table);
    table
}

fn add_load_step(page: &mut String, scene: &SceneReport) {
    let Some(step) = &scene.load_step else { return };
    let rate = step.rate_bound_fps;
    let caption = format!("A step of the load, with a rate bound of {rate:.1} frames per second");
    begin_table(
        page,
        &caption,
        &[
            "Cameras",
            "Frames in time",
            "Frame, ms",
            "95 %",
            "Error in force, px",
            "Largest",
            "Resolution",
            "Least",
            "Triangles",
        ],
    );
    for phase in &step.phases {
        let share = 100.0 * f64::from(phase.in_time) / f64::from(phase.frames.max(1));
        let cells = [
            phase.cameras.to_string(),
            format!("{} of {} ({share:.0} %)", phase.in_time, phase.frames),
            format!("{:.1}", phase.frame_ms.p50),
            format!("{:.1}", phase.frame_ms.p95),
            format!("{:.2}", phase.error_in_force_px.p50),
            format!("{:.2}", phase.error_in_force_px.max),
            format!("{:.2}", phase.resolution_scale),
            format!("{:.2}", phase.resolution_scale_min),
            phase.triangles.to_string(),
        ];
        add_row(page, &cells);
    }
    end_table(page);
}

fn add_peers(page: &mut String, scene: &SceneReport) {
    if let Some(reason) = &scene.peers_error {
        let reason = escaped(reason);
        add(page, format_args!("<p class=\"failure\">Other renderers: {reason}</p>\n"));
    }
    if scene.peers.is_empty() {
        return;
    }
    let fastest = scene.peers.iter().filter_map(|peer| peer.frame_ms).fold(f64::INFINITY, f64::min);
    begin_table(
        page,
        "Renderers on the same poses at full detail, in one run of the kit",
        &["Renderer", "Frame, ms", "Of the fastest", "Medians of rounds"],
    );
    for peer in &scene.peers {
        let rounds: Vec<String> = peer.rounds_ms.iter().map(|ms| format!("{ms:.1}")).collect();
        let cells = [
            peer.name.clone(),
            peer.frame_ms.map_or("failed".into(), |ms| format!("{ms:.1}")),
            peer.frame_ms.map_or("–".into(), |ms| ratio(ms, fastest)),
            peer.error.clone().unwrap_or_else(|| rounds.join(", ")),
        ];
        add_row(page, &cells);
    }
    end_table(page);
}

fn ratio(value: f64, full: f64) -> String {
    if full > 0.0 { format!("{:.2}", value / full) } else { "–".into() }
}
