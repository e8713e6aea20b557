//! Bounds of error and rate on walls of processes: coarser levels are drawn alike on all tiles, at
//! most as far off as was asked, and everything at its finest where no error is allowed.

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_client::{
    Assets, Camera, FrameFeedback, Material, MeshData, NewNode, QualityBounds, Transaction,
};
use serde_json::{Value, json};

use crate::harness::local_wall::{LocalWall, patient, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.5, 4.0), ..Camera::IDENTITY };

/// Cells along each side of the hilly sheet: 20,000 triangles.
const CELLS: u32 = 100;

/// A hilly sheet of 3 × 3 m, which coarser levels are worth it for.
fn hills() -> MeshData {
    let place = |index: u32| index as f32 / CELLS as f32 * 3.0 - 1.5;
    let height =
        |x: f32, z: f32| 0.12 * (5.0 * x).sin() * (4.0 * z).cos() + 0.001 * (31.0 * x).sin();
    let mut mesh = MeshData::default();
    for row in 0..=CELLS {
        for column in 0..=CELLS {
            let (x, z) = (place(column), place(row));
            mesh.positions.push(Vec3::new(x, height(x, z) - 0.4, z));
        }
    }
    for row in 0..CELLS {
        for column in 0..CELLS {
            let at = row * (CELLS + 1) + column;
            let below = at + CELLS + 1;
            mesh.indices.extend([at, below, at + 1, at + 1, below, below + 1]);
        }
    }
    mesh
}

/// A wall that shows the hills, which client and baker made.
fn wall_of_hills(columns: u32, rows: u32) -> LocalWall {
    let local = LocalWall::with_nothing(columns, rows);
    let mut assets = Assets::default();
    let color = Vec4::new(0.8, 0.5, 0.2, 1.0);
    let paint = assets.add_material(Material { base_color: color, ..Assets::matt() });
    let mesh = assets.add_mesh(hills(), Some(paint));
    let mut transaction = Transaction::default().with_assets(assets.to_source().expect("a source"));
    transaction.create(NewNode {
        mesh: Some(mesh),
        local: DAffine3::IDENTITY,
        ..NewNode::default()
    });
    local.client().commit(transaction).expect("made");
    local
}

fn bound(client: &Client, error_px: f64) {
    client.set_bounds(QualityBounds { error_px, ..QualityBounds::FINEST }).expect("set");
}

/// The picture at a bound, and what its frame says.
fn at_bound(local: &LocalWall, error_px: f64) -> (RgbaImage, FrameFeedback) {
    let client = local.client();
    bound(&client, error_px);
    let picture = screen_of(&shot(&client, VIEW));
    (picture, client.render_frame().expect("a frame"))
}

fn triangles(feedback: &FrameFeedback) -> u64 {
    feedback.channels.iter().map(|channel| channel.triangles).sum()
}

#[test]
fn all_tiles_draw_the_same_level_and_0_the_finest() {
    let [tiled, single] = [wall_of_hills(2, 2), wall_of_hills(1, 1)];
    let (finest, feedback) = at_bound(&single, 0.0);
    let all = triangles(&feedback);
    assert_eq!(feedback.detail.error_in_force_px, 0.0);
    assert_eq!(feedback.detail.largest_error_px, 0.0);
    let mut last = all;
    for error_px in [0.5, 2.0, 8.0] {
        let (whole, feedback) = at_bound(&single, error_px);
        assert!(triangles(&feedback) < last, "{} at {error_px} px", triangles(&feedback));
        last = triangles(&feedback);
        let detail = &feedback.detail;
        assert_eq!(detail.error_in_force_px, error_px);
        assert!(detail.largest_error_px > 0.0 && detail.largest_error_px <= error_px, "{detail:?}");
        assert!(detail.limiting_channel.is_some());
        assert!(whole != finest);
        let (tiles, feedback) = at_bound(&tiled, error_px);
        assert!(feedback.detail.largest_error_px <= error_px);
        check(&format!("tiles at {error_px} px"), &tiles, &whole, &SEAMS);
    }
    assert!(last * 10 < all, "{last} of {all} triangles at 8 px");
    let (again, feedback) = at_bound(&single, 0.0);
    check("finest", &again, &finest, &IDENTICAL);
    assert_eq!(triangles(&feedback), all);
}

#[test]
fn bounds_are_typed_said_and_refused() {
    let local = wall_of_hills(1, 1);
    let said = |words: &[&str]| local.run(&[words, &["--json"]].concat()).json();
    let none = json!({
        "error_bound_px": 0.0,
        "rate_bound_fps": null,
        "error_in_force_px": 0.0,
        "resolution_scale": 1.0,
    });
    assert_eq!(said(&["bound"]), none);
    let set = said(&["bound", "--error", "1.5", "--rate", "30"]);
    assert_eq!((&set["error_bound_px"], &set["rate_bound_fps"]), (&json!(1.5), &json!(30.0)));
    // What is not given stays.
    let set = said(&["bound", "--error", "2"]);
    assert_eq!((&set["error_bound_px"], &set["rate_bound_fps"]), (&json!(2.0), &json!(30.0)));
    let set = said(&["bound", "--no-rate"]);
    assert_eq!((&set["error_bound_px"], &set["rate_bound_fps"]), (&json!(2.0), &Value::Null));
    let text = local.run(&["bound"]).succeeded();
    assert_eq!(text, "an error of at most 2 pixels, any rate; in force: 2.00 pixels");
    for (words, why) in [
        (&["bound", "--error=-1"], "0 to 64 pixels, not -1"),
        (&["bound", "--error=NaN"], "0 to 64 pixels, not NaN"),
        (&["bound", "--rate=0"], "1 to 1000 frames per second, not 0"),
    ] {
        let refused = local.run(words);
        assert!(refused.code() == 2 && refused.output.contains(why), "{}", refused.output);
    }
}

#[test]
fn a_simulated_wall_reports_its_bounds() {
    let arguments = ["--frames", "5", "--error-bound", "4", "--rate-bound", "1"];
    let mut simulation = Simulation::start(TestDir::new(), &small(2, 1), town(), &arguments);
    simulation.process.finish(wait::LIMIT).succeeded();
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_slice(&text).expect("JSON");
    assert_eq!(report["error_bound_px"], 4.0);
    let in_force = |key: &str| report["error_in_force_px"][key].as_f64().expect("a number");
    assert!(in_force("p50") >= 3.99 && in_force("max") >= in_force("p50"), "{report}");
    let largest = report["largest_error_px"].as_f64().expect("a number");
    assert!(largest > 0.0 && largest <= in_force("max"), "{largest}: {report}");
    let limiting = report["limiting_channel"].as_str().expect("a name");
    assert!(["front-1-1", "front-2-1"].contains(&limiting), "{limiting}");
    assert!(report["gpu_bytes"].as_u64() > Some(1 << 20), "{report}");
    assert_eq!(report["resolution_scale"], json!({ "p50": 1.0, "min": 1.0 }));
}

#[test]
fn a_rate_that_detail_does_not_keep_lowers_the_resolution_of_all_channels_and_is_reported() {
    let run = |arguments: &[&str]| {
        let arguments = [&["--frames", "60"], arguments].concat();
        let wall = patient(small(2, 1));
        let mut simulation = Simulation::start(TestDir::new(), &wall, town(), &arguments);
        let said = simulation.process.finish(wait::LIMIT).succeeded();
        let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
        let report: Value = serde_json::from_slice(&text).expect("JSON");
        (read(&simulation.place.path("out/wall.png")), report, said)
    };
    let (full, report, _) = run(&[]);
    assert_eq!(report["resolution_scale"], json!({ "p50": 1.0, "min": 1.0 }));
    // One channel takes 20 ms whatever it draws, and 9 ms are allowed.
    let slow = ["--rate-bound", "100", "--fault", "at 1 slow 20ms front-1-1"];
    let (reduced, report, _) = run(&slow);
    assert_eq!(report["resolution_scale"]["min"], 0.25, "{report}");
    assert_eq!(report["error_in_force_px"]["max"].as_f64().map(f64::round), Some(64.0), "{report}");
    assert_eq!(report["late"], 0, "{report}");
    assert_eq!(reduced.dimensions(), full.dimensions());
    // The other channel, which had the time, has as few pixels: rows of it change in steps.
    let (width, height) = full.dimensions();
    let changes = |picture: &RgbaImage, x: u32| {
        let rows = (1..height).filter(|&y| {
            let differ = |(a, b): (u8, u8)| a.abs_diff(b) > 24;
            let pixel = |y| picture.get_pixel(x, y).0;
            pixel(y).into_iter().zip(pixel(y - 1)).any(differ)
        });
        rows.count()
    };
    let total = |picture: &RgbaImage, from: u32| -> usize {
        (from..from + width / 2).map(|x| changes(picture, x)).sum()
    };
    for from in [0, width / 2] {
        let [sharp, soft] = [&full, &reduced].map(|picture| total(picture, from));
        assert!(soft * 2 < sharp, "columns from {from}: {soft} edges of {sharp} are left");
    }
}
