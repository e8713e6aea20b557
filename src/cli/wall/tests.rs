//! Wall files that are written pass their own check, without a warning.

use clap::Parser;
use polyptych_protocol::wall::coverage::coverage;
use polyptych_protocol::wall::table::WallTable;

use super::*;

#[derive(Debug, Parser)]
struct Line {
    #[command(subcommand)]
    wall: Wall,
}

fn text(line: &str) -> anyhow::Result<String> {
    let line = Line::try_parse_from(format!("wall {line}").split_whitespace())?;
    match &line.wall {
        Wall::Grid(arguments) => arguments.text(),
        Wall::Arch(arguments) => arguments.text(),
        Wall::Cylinder(arguments) => arguments.text(),
        Wall::Cave(arguments) => arguments.text(),
        Wall::Dome(arguments) => arguments.text(),
        Wall::Import(_) | Wall::Save(_) => bail!("it reads a file"),
    }
}

fn table(line: &str) -> WallTable {
    let text = text(line).unwrap_or_else(|error| panic!("{line}: {error}"));
    let wall = file::parse(&text, "wall.toml".as_ref());
    let table = WallTable::of(&wall.unwrap_or_else(|error| panic!("{line}: {error}\n{text}")));
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
    let [width, height] = grid.screens[0].size_m;
    assert!((width - 3.04).abs() < 1e-9 && (height - 1.01).abs() < 1e-9, "{width} {height}");
    assert_eq!(grid.screens[0].bezel.expect("a bezel").pixels, [20, 10]);
    let shared = table("grid --columns 3 --pixels 1920x1080 --overlap 288x162");
    assert_eq!(shared.screens[0].coverage[0].layers_max, 4);
    let round = table("cylinder --channels 14 --radius 3 --eye-height 1.7");
    assert!((round.channels[0].degrees[0] - 360.0 / 14.0).abs() < 1e-9);
    assert_eq!(round.eye_m, [0.0, 1.7, 0.0]);
    let arch = table("arch --channels 5 --degrees 100 --radius 2 --name lab");
    assert_eq!(arch.name, "lab");
    for channel in &arch.channels {
        assert!((channel.degrees[0] - 20.0).abs() < 1e-4, "{channel:?}");
    }
    assert!(table("cave --walls 6 --size 2.5").screens.iter().all(|s| s.eye_distance_m > 0.8));
}

#[test]
fn domes_have_no_holes_with_any_number_of_projectors() {
    for channels in 4..=12 {
        let text = text(&format!("dome --channels {channels} --pixels 1600x1200"));
        let wall = file::parse(&text.expect("a text"), "wall.toml".as_ref()).expect("a wall");
        let found = &coverage(&wall, 0)[0];
        assert!(found.holes.is_empty() && found.layers_max > 1, "{channels}: {:?}", found.holes);
    }
}

#[test]
fn numbers_that_make_no_wall() {
    for (line, what) in [
        ("grid --columns 0", "1..=1024"),
        ("grid --pixels 1920", "WIDTHxHEIGHT"),
        ("grid --width -1", "unexpected argument"),
        ("grid --width nan", "not within 0.001"),
        ("grid --bezel 0.1x0.1 --overlap 2x2", "cannot be used with"),
        ("arch --channels 1 --degrees 200", "1 screens over 200° are 200° each; 150 fit"),
        ("arch --degrees 361", "not within 1 to 360"),
        ("cylinder --overlap 1200", "1200 of 1200 pixels leave nothing"),
        ("cave --walls 7", "1..=6"),
        ("dome --channels 3", "4..=32"),
        ("dome --channels 32 --pixels 1920x400", "give fewer --channels"),
    ] {
        let error = text(line).expect_err(line).to_string();
        assert!(error.contains(what), "{line}: {error}");
    }
    // What only the wall file's own check knows.
    let text = text("cave --size 3 --eye-height 4").expect("a text");
    let error = file::parse(&text, "wall.toml".as_ref());
    assert!(error.is_ok(), "above the walls, but before all of them: {error:?}");
}
