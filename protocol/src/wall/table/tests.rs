//! Walls in numbers and in text.

use super::text::thousands;
use super::*;
use crate::wall::file;

fn table(text: &str) -> WallTable {
    WallTable::of(&file::parse(text, "wall.toml".as_ref()).unwrap())
}

const TWO_BY_TWO: &str = r#"
    [wall]
    name = "wall"
    [[screen]]
    name = "front"
    size = [1.92, 1.08]
    center = [0.0, 0.0, -0.96]
    [screen.tiles]
    columns = 2
    rows = 2
    pixels = [960, 540]
"#;

#[test]
fn a_wall_in_numbers() {
    let table = table(TWO_BY_TWO);
    assert_eq!(table.pixels_total, 1920 * 1080);
    let channel = &table.channels[3];
    assert_eq!((channel.name.as_str(), channel.origin), ("front-2-2", [960, 540]));
    assert!((channel.size_m[0] - 0.96).abs() < 1e-12);
    // The middle of the tile is 0.27 m below the eye: its edges 0.96 m apart at 0.9973 m.
    let half = (0.96_f64 * 0.96 + 0.27 * 0.27).sqrt();
    assert!((channel.degrees[0] - (0.96 / half).atan().to_degrees()).abs() < 1e-9);
    assert_eq!(table.screens[0].eye_distance_m, 0.96);
    assert_eq!(table.warnings, [] as [String; 0]);
}

#[test]
fn a_pixel_at_the_foot_of_the_eye_has_the_angle_of_its_pitch() {
    let table = table(&TWO_BY_TWO.replace("columns = 2", "").replace("rows = 2", ""));
    // One tile of 960 × 540 on 1.92 × 1.08 m: 2 mm at 0.96 m.
    let expected = 1.0 / (2.0 * (0.001_f64 / 0.96).atan()).to_degrees();
    assert!((table.channels[0].pixels_per_degree / expected - 1.0).abs() < 1e-9);
}

#[test]
fn bezels_are_reported_with_their_rounding() {
    let text = format!("{TWO_BY_TWO}\nbezel = [0.0137, 0.0]");
    let table = table(&text);
    let bezel = table.screens[0].bezel.unwrap();
    assert_eq!((bezel.asked_m, bezel.pixels), ([0.0137, 0.0], [14, 0]));
    assert!((bezel.in_force_m[0] - 14.0 * 1.92 / 1934.0).abs() < 1e-12);
    assert!(table.to_string().contains("13.70 × 0.00 mm asked, 14 × 0 pixels in force"));
}

#[test]
fn odd_origins_and_uneven_pixels_are_warned_of() {
    let odd = table(&TWO_BY_TWO.replace("960, 540", "961, 540"));
    assert_eq!(odd.warnings.len(), 2, "{:?}", odd.warnings);
    assert!(odd.warnings[0].starts_with("channel front-2-1: its origin [961, 0] is odd"));
    let uneven = table(&TWO_BY_TWO.replace("960, 540", "960, 560"));
    assert!(uneven.warnings[0].contains("1.0000 mm wide and 0.9643 mm high, 3.7 % apart"));
}

#[test]
fn the_text_is_aligned() {
    let text = table(TWO_BY_TWO).to_string();
    let expected = "wall wall: 4 channels on 1 screen, 2,073,600 pixels, 1 sample per pixel\n";
    assert!(text.starts_with(expected), "{text}");
    let ends: Vec<usize> = text
        .lines()
        .filter(|line| line.ends_with("shared"))
        .map(|line| line.chars().count())
        .collect();
    assert!(ends.len() == 4 && ends.iter().all(|end| *end == ends[0]), "{text}");
    assert!(serde_json::to_string(&table(TWO_BY_TWO)).unwrap().contains("\"degrees\":["));
}

#[test]
fn thousands_are_grouped() {
    assert_eq!([0, 999, 1000, 2_073_600].map(thousands), ["0", "999", "1,000", "2,073,600"]);
}
