//! Walls in numbers and in text.

mod hard;
mod random;

use super::text::thousands;
use super::*;

fn table(text: &str) -> CheckReport {
    CheckReport::from_wall(&crate::parse(text, "wall.toml".as_ref()).unwrap())
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
    assert!((channel.size_m.unwrap()[0] - 0.96).abs() < 1e-12);
    // The middle of the tile is 0.27 m below the eye: its edges 0.96 m apart at 0.9973 m.
    let half = (0.96_f64 * 0.96 + 0.27 * 0.27).sqrt();
    assert!((channel.degrees.unwrap()[0] - (0.96 / half).atan().to_degrees()).abs() < 1e-9);
    assert_eq!(table.screens[0].eye_distance_m, Some(0.96));
    assert_eq!(table.warnings, [] as [String; 0]);
}

#[test]
fn a_pixel_at_the_foot_of_the_eye_has_the_angle_of_its_pitch() {
    let table = table(&TWO_BY_TWO.replace("columns = 2", "").replace("rows = 2", ""));
    // One tile of 960 × 540 on 1.92 × 1.08 m: 2 mm at 0.96 m.
    let expected = 1.0 / (2.0 * (0.001_f64 / 0.96).atan()).to_degrees();
    assert!((table.channels[0].pixels_per_degree.unwrap() / expected - 1.0).abs() < 1e-9);
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

fn config(name: &str) -> CheckReport {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(name);
    CheckReport::from_wall(&crate::load(&path).unwrap())
}

#[test]
fn blends_of_a_channel_for_both_eyes_add_up_for_each() {
    let channels = [0, 90, 90].iter().enumerate().map(|(index, x)| {
        format!("[[screen.channel]]\nname = \"c{index}\"\norigin = [{x}, 0]\npixels = [110, 100]\n")
    });
    let text = "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.0]\n\
                center = [0.0, 0.0, -1.0]\npixels = [200, 100]\n"
        .to_owned()
        + &channels.collect::<String>()
        + "[channel.c1]\neye = \"left\"\n[channel.c2]\neye = \"right\"\n";
    let blends = table(&text).blends;
    assert_eq!(blends.len(), 2, "{blends:?}");
    assert!(blends.iter().all(|blend| (blend.light - 1.0).abs() < 1e-9), "{blends:?}");
}

#[test]
fn a_ramp_without_width_is_a_line_and_no_more_light() {
    let text = format!("{TWO_BY_TWO}\noverlap = [96, 0]");
    let mut wall = crate::parse(&text, "wall.toml".as_ref()).unwrap();
    // As someone may tune it on the running wall.
    let right = wall.channels.iter_mut().find(|channel| channel.name == "front-2-1").unwrap();
    right.adjustment.edges.left = Some(0.0);
    let table = CheckReport::from_wall(&wall);
    assert!(table.blends.iter().all(|blend| (blend.light - 1.0).abs() < 1e-9), "{table}");
    let line = table.warnings.iter().find(|line| line.contains("has no width"));
    assert!(line.is_some_and(|line| line.ends_with("its light ends in a line")), "{table}");
}

#[test]
fn overlaps_are_in_the_table() {
    let table = config("powerwall-overlap.toml");
    let coverage = &table.screens[0].coverage[0];
    assert_eq!((coverage.covered, coverage.layers_max, coverage.blends), (1.0, 4, true));
    let overlap = &coverage.overlaps[0];
    assert_eq!(overlap.patch.pixels, [288.0, 1080.0]);
    assert!((overlap.patch.size_m.unwrap()[0] - 0.288).abs() < 1e-9, "{overlap:?}");
    assert_eq!(table.warnings, [] as [String; 0]);
    let text = table.to_string();
    assert!(text.contains("coverage: 100.00 %, 4 channels at most over one place, 11 overlaps"));
    assert!(
        text.contains("overlap: front-1-1 and front-2-1, blended, 288 × 1080 pixels at [1632, 0]"),
        "{text}"
    );
}

#[test]
fn a_cylinder_in_numbers() {
    let table = config("cylinder-360.toml");
    assert_eq!((table.screens[0].surface, table.warnings.len()), ("cylinder", 0));
    for channel in &table.channels {
        assert!((channel.degrees.unwrap()[0] - 360.0 / 14.0).abs() < 1e-9, "{channel:?}");
        // A chord of each 32nd part of the strip.
        assert!((channel.size_m.unwrap()[0] - 6.0 * std::f64::consts::PI / 14.0).abs() < 1e-4);
        assert_eq!((channel.projection, channel.cover, channel.spill), ("warp", "tile", Some(0.0)));
        let [fewest, most] = channel.sampling.unwrap();
        assert!(fewest >= 0.999 && (1.0..1.5).contains(&most), "{channel:?}");
    }
    let expected = 16_800.0 / 360.0;
    assert!((table.channels[6].pixels_per_degree.unwrap() / expected - 1.0).abs() < 1e-3);
}

#[test]
fn five_projectors_cover_a_dome() {
    let table = config("dome-5.toml");
    let coverage = &table.screens[0].coverage[0];
    assert_eq!((coverage.covered, coverage.uncovered.len()), (1.0, 0), "{table}");
    assert_eq!(table.warnings, [] as [String; 0]);
    assert!(coverage.layers_max >= 3, "{coverage:?}");
    for channel in &table.channels {
        let [fewest, most] = channel.sampling.unwrap();
        assert!(fewest >= 1.0 && most < 2.5, "{channel:?}");
    }
    let spill: Vec<f64> = table.channels.iter().map(|channel| channel.spill.unwrap()).collect();
    // Below the springline there is no dome: as much for each of those around.
    assert!((0.01..0.03).contains(&spill[0]), "{spill:?}");
    assert!(spill[..4].iter().all(|share| (share - spill[0]).abs() < 1e-3), "{spill:?}");
    assert_eq!(spill[4], 0.0);
}

#[test]
fn what_textures_cannot_hold_is_warned_of() {
    let wall = crate::parse(TWO_BY_TWO, "wall.toml".as_ref()).unwrap();
    let mut table = CheckReport::from_wall(&wall);
    table.channels[1].sampling = Some([0.4, 3.0]);
    let said = warnings::warnings(&wall, &table.screens, &table.channels);
    let expected = "channel front-2-1: with textures of 8192 pixels it is drawn from 0.40 pixels \
                    for one of its own where they are fewest";
    assert!(said.len() == 1 && said[0].starts_with(expected), "{said:?}");
}

#[test]
fn what_does_not_look_its_best_is_warned_of() {
    let by_hand = |second: &str| {
        table(&format!(
            "[wall]\nname = \"w\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.0]\n\
             center = [0.0, 0.0, -1.0]\npixels = [200, 100]\n\
             [[screen.channel]]\nname = \"a\"\norigin = [0, 0]\npixels = [100, 100]\n\
             [[screen.channel]]\nname = \"b\"\n{second}\n"
        ))
        .warnings
    };
    assert_eq!(
        by_hand("origin = [90, 0]\npixels = [110, 100]"),
        ["screen front: channels a and b overlap, 10 × 100 pixels at [90, 0], 0.100 × 1.000 m: \
          they are blended there"]
    );
    let slip = by_hand("origin = [90, 0]\npixels = [100, 100]");
    assert_eq!(
        slip[0],
        "screen front: no channel shows 5.00 % of it, the largest part 10 × 100 pixels at \
         [190, 0], 0.100 × 1.000 m"
    );
    let sliver = by_hand("origin = [98, 0]\npixels = [102, 100]");
    assert!(sliver[0].ends_with("too narrow to be blended without a line"), "{sliver:?}");
    let beam = "pixels = [640, 480]\nprojector = { position = [0, 0, 2], look_at = [0, 0, -1], \
                degrees = [90, 90] }";
    let spilled = by_hand(beam);
    assert!(
        spilled.last().unwrap().starts_with("channel b: 95 % of its pixels miss screen front"),
        "{spilled:?}"
    );
}

#[test]
fn both_eyes_are_told_apart_and_files_not_guessed() {
    let eyes = TWO_BY_TWO.replace("columns = 2", "").replace("rows = 2", "");
    let mut wall = crate::parse(&eyes, "wall.toml".as_ref()).unwrap();
    let mut right = wall.channels[0].clone();
    (right.name, right.adjustment.eye) = ("right".into(), Eye::Right);
    wall.channels[0].adjustment.eye = Eye::Left;
    wall.channels.push(right);
    let text = CheckReport::from_wall(&wall).to_string();
    assert!(text.contains("coverage, left eye: 100.00 %, 1 channel at most"), "{text}");
    assert!(text.contains("coverage, right eye: 100.00 %"), "{text}");
    wall.files.push(polyptych_wall::CalibrationFile {
        path: "hull.obj".into(),
        kind: polyptych_wall::CalibrationFileKind::ScreenMesh,
        blob: None,
        is_for_one_eye: false,
        front: Vec::new(),
    });
    wall.screens[0].surface = Surface::Mesh(0);
    let table = CheckReport::from_wall(&wall);
    assert!(table.channels[0].degrees.is_none() && table.warnings.is_empty(), "{table}");
    let text = table.to_string();
    assert!(
        text.contains("screen front: mesh, 960 × 540 pixels\n") && text.contains("–"),
        "{text}"
    );
    let json = serde_json::to_string(&table).unwrap();
    assert!(!json.contains("null") && !json.contains("sampling"), "{json}");
    assert!(json.contains("\"unknown\":\"its calibration files were not read\""), "{json}");
}
