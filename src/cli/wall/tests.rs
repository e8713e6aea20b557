//! Wall files that are written pass their own check, without a warning.

use clap::Parser;
use polyptych_wall_file::check_report::CheckReport;

use super::*;

#[derive(Debug, Parser)]
struct Line {
    #[command(subcommand)]
    wall: WallCommand,
}

fn text(line: &str) -> anyhow::Result<String> {
    let line = Line::try_parse_from(format!("wall {line}").split_whitespace())?;
    match &line.wall {
        WallCommand::Grid(arguments) => arguments.text(),
        WallCommand::Arch(arguments) => arguments.text(),
        WallCommand::Cylinder(arguments) => arguments.text(),
        WallCommand::Cave(arguments) => arguments.text(),
        WallCommand::Dome(arguments) => arguments.text(),
        _ => anyhow::bail!("it makes no wall"),
    }
}

fn table(line: &str) -> CheckReport {
    let text = text(line).unwrap_or_else(|error| panic!("{line}: {error}"));
    let wall = polyptych_wall_file::parse(&text, "wall.toml".as_ref());
    let table =
        CheckReport::from_wall(&wall.unwrap_or_else(|error| panic!("{line}: {error}\n{text}")));
    assert!(table.warnings.is_empty(), "{line}: {:?}", table.warnings);
    assert!(text.starts_with("# ") && text.contains("+--"), "{line}: a drawing\n{text}");
    table
}

#[test]
fn every_kind_has_defaults_that_check() {
    let count = |line: &str| table(line).channels.len();
    assert_eq!(["grid", "arch", "cylinder", "cave", "dome"].map(count), [4, 3, 14, 4, 5]);
}

#[test]
fn numbers_are_taken_as_they_are_given() {
    let grid = table("grid --columns 3 --rows 2 --width 1 --pixels 1000x500 --bezel 0.02x0.01");
    let [width, height] = grid.screens[0].size_m.expect("a size");
    assert!((width - 3.04).abs() < 1e-9 && (height - 1.01).abs() < 1e-9, "{width} {height}");
    assert_eq!(grid.screens[0].bezel.expect("a bezel").pixels, [20, 10]);
    let shared = table("grid --columns 3 --pixels 1920x1080 --overlap 288x162");
    assert_eq!(shared.screens[0].coverage[0].layers_max, 4);
    let round = table("cylinder --channels 14 --radius 3 --eye-height 1.7");
    assert!((round.channels[0].degrees.expect("seen")[0] - 360.0 / 14.0).abs() < 1e-9);
    assert_eq!(round.eye_m, [0.0, 1.7, 0.0]);
    let arch = table("arch --channels 5 --degrees 100 --radius 2 --name lab");
    assert_eq!(arch.name, "lab");
    for channel in &arch.channels {
        assert!((channel.degrees.expect("seen")[0] - 20.0).abs() < 1e-4, "{channel:?}");
    }
    assert!(
        table("cave --walls 6 --size 2.5").screens.iter().all(|s| s.eye_distance_m > Some(0.8))
    );
}

/// Projectors of a wall file, where nobody can stand, whose light nobody takes and that cover it.
fn projected(line: &str) -> CheckReport {
    let table = table(line);
    for channel in &table.channels {
        let projector = channel.projector.unwrap_or_else(|| panic!("{line}: {channel:?}"));
        assert!(projector.position_m[1] >= 2.0, "{line}: {channel:?}");
        assert!(channel.spill.expect("known") < 0.5, "{line}: {channel:?}");
    }
    for screen in &table.screens {
        assert_eq!(screen.coverage[0].covered, 1.0, "{line}: {table}");
    }
    table
}

#[test]
fn projectors_of_a_cylinder_cover_it_with_the_overlap_that_was_asked_for() {
    for (line, throw, percent) in [
        ("cylinder --projectors", 1.2, 15.0),
        ("cylinder --projectors --throw 1.2 --overlap 15", 1.2, 15.0),
        ("cylinder --projectors --channels 3 --degrees 120 --throw 0.8 --overlap 25", 0.8, 25.0),
        ("cylinder --projectors --channels 5 --degrees 200 --radius 5 --throw 1.6", 1.6, 15.0),
        ("cylinder --projectors --degrees 90 --pixels 1920x1200 --lens-shift 0", 1.2, 15.0),
        ("cylinder --projectors --degrees 180 --height 1.2 --mount-height 3.4", 1.2, 15.0),
    ] {
        let table = projected(line);
        let screen = &table.screens[0];
        let count = table.channels.len();
        for index in 1..count {
            let [a, b] = [index - 1, index].map(|at| table.channels[at].name.clone());
            let overlaps = &screen.coverage[0].overlaps;
            let found = overlaps.iter().find(|of| of.channels == [a.clone(), b.clone()]);
            let found = found.unwrap_or_else(|| panic!("{line}: {a} and {b} in {table}"));
            let width = found.patch.area / f64::from(screen.pixels[1]);
            let due = f64::from(table.channels[index].pixels[0]) * percent / 100.0;
            assert!(width > 0.95 * due, "{line}: {a} and {b} share {width} of {due} px");
        }
        let ratio = table.channels[0].projector.expect("a pose").throw_ratio;
        assert!((ratio / throw - 1.0).abs() < 1e-4, "{line}: {ratio}");
    }
}

#[test]
fn projectors_of_flat_screens_cover_them() {
    for line in [
        "grid --projectors",
        "grid --projectors --columns 3 --rows 1 --width 2 --throw 1.5 --overlap 20",
        "grid --projectors --columns 1 --rows 1 --width 4 --distance 6 --throw 2",
        "grid --projectors --columns 3 --rows 2 --throw 0.8 --overlap 15x10",
        "arch --projectors",
        "arch --projectors --channels 5 --degrees 150 --radius 4 --throw 0.8",
    ] {
        projected(line);
    }
}

#[test]
fn domes_have_no_holes_with_any_number_of_projectors() {
    for channels in [4, 5, 6, 7, 9, 12] {
        let table = projected(&format!("dome --channels {channels} --pixels 1600x1200"));
        assert!(table.screens[0].coverage[0].layers_max > 1, "{channels}: {table}");
        for channel in &table.channels {
            let [x, y, z] = channel.projector.expect("a pose").position_m;
            let [.., eye_z] = table.eye_m;
            assert!(x.hypot(z - eye_z) > 3.0 && y > table.eye_m[1], "at the rim: {channel:?}");
        }
    }
    projected("dome --channels 6 --radius 8 --overlap 10");
}

#[test]
fn projectors_that_cannot_be_are_refused_with_what_works() {
    for (line, what) in [
        ("cylinder --throw 1.2", "--throw is for projectors; add --projectors"),
        ("cylinder --projectors --channels 3 --throw 1.2", "cannot light this screen"),
        ("cylinder --projectors --mount-height 1.2", "where people are; 2 m or more works"),
        ("cylinder --projectors --overlap 288", "percent of a picture's side; 0 to 45 work"),
        ("dome --springline 1.6", "where people are; 2.5 m or more works"),
        ("dome --throw 3", "5 projectors with a throw ratio of 3:1 cannot light this screen"),
        ("grid --projectors --bezel 0.1x0.1", "cannot be used with"),
    ] {
        let error = text(line).expect_err(line).to_string();
        assert!(error.contains(what), "{line}: {error}");
    }
    // What is said to work does.
    for (refused, what) in [
        ("cylinder --projectors --channels 3 --throw 1.2", "too small"),
        (
            "grid --projectors --columns 3 --rows 2 --overlap 15x10 --lens-shift 0 --throw 0.8",
            "would miss the screen",
        ),
    ] {
        let error = text(refused).expect_err("no poses").to_string();
        assert!(error.contains(what), "{refused}: {error}");
        let works = error.rsplit("; ").next().expect("a remedy").split(", ");
        let mut tried = 0;
        for option in works.filter_map(|remedy| remedy.strip_suffix(" works")) {
            let (name, _) = option.split_once(' ').expect("an option and its value");
            let words: Vec<&str> = refused.split(' ').collect();
            let at = words.iter().position(|word| *word == name).expect("an option of the line");
            let line = [&words[..at], &[option], &words[at + 2..]].concat().join(" ");
            projected(&line);
            tried += 1;
        }
        assert!(tried > 0, "{error}");
    }
}

#[test]
fn numbers_that_make_no_wall() {
    for (line, what) in [
        ("grid --columns 0", "1..=1024"),
        ("grid --columns 33 --rows 32", "33 columns of 32 are 1056 channels"),
        ("grid --columns 200 --rows 200 --projectors", "are 40000 channels"),
        ("grid --pixels 1920", "WIDTHxHEIGHT"),
        ("grid --width -1", "unexpected argument"),
        ("grid --width nan", "not within 0.001"),
        ("grid --bezel 0.1x0.1 --overlap 2x2", "bezel"),
        ("arch --channels 1 --degrees 200", "1 screens over 200° are 200° each; 150 fit"),
        ("arch --degrees 361", "not within 1 to 360"),
        ("cylinder --overlap 1200", "1200 of 1200 pixels leave nothing"),
        ("cave --walls 7", "1..=6"),
        ("dome --channels 3", "4..=32"),
        ("dome --channels 32 --pixels 1920x100 --throw 1", "cannot light this screen"),
    ] {
        let error = text(line).expect_err(line).to_string();
        assert!(error.contains(what), "{line}: {error}");
    }
    // What only the wall file's own check knows.
    let text = text("cave --size 3 --eye-height 4").expect("a text");
    let error = polyptych_wall_file::parse(&text, "wall.toml".as_ref());
    assert!(error.is_ok(), "above the walls, but before all of them: {error:?}");
}
