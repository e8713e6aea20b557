//! Drawings of walls, read back by an XML parser and compared with the model.

use std::path::Path;

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, Screen, Surface, Wall};
use roxmltree::{Document, Node};

use super::*;

/// Rounding of numbers of a drawing, in its pixels.
const ROUNDING: f64 = 0.02;

/// Two projectors with keystone before a cylinder, of which the second one lights beside it.
const PROJECTORS: &str = r#"[wall]
name = "pair"
eye = [0.0, 1.6, 0.0]
[[screen]]
name = "round"
pixels = [288, 100]
[screen.cylinder]
radius = 3.0
degrees = [-60, 60]
height = [0.6, 2.6]
[[screen.channel]]
name = "left"
pixels = [96, 60]
projector = { position = [-1.0, 3.0, 0.2], look_at = [-1.1, 1.5, -2.6], degrees = [40, 30] }
[[screen.channel]]
name = "right"
pixels = [96, 60]
projector = { position = [1.0, 3.0, 0.2], look_at = [2.1, 1.5, -2.1], degrees = [60, 50] }
"#;

fn drawing_of(wall: &Wall) -> String {
    svg(wall.into(), &CheckReport::from_wall(wall))
}

fn config(name: &str) -> Wall {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name);
    polyptych_wall_file::load(&path).expect("a wall")
}

/// The elements of a class within a node.
fn of_class<'a>(node: Node<'a, 'a>, class: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.descendants().filter(move |node| {
        node.attribute("class").is_some_and(|has| has.split(' ').any(|word| word == class))
    })
}

fn numbers(node: Node<'_, '_>, key: &str) -> Vec<f64> {
    let text = node.attribute(key).unwrap_or_else(|| panic!("no {key}"));
    text.split(' ').map(|number| number.parse().expect("a number")).collect()
}

/// The points of all paths within a node.
fn points(node: Node<'_, '_>) -> Vec<DVec2> {
    let paths = node.descendants().filter_map(|node| node.attribute("d"));
    let point = |pair: &str| {
        let (x, y) = pair.split_once(' ').expect("two numbers");
        DVec2::new(x.parse().expect("x"), y.parse().expect("y"))
    };
    let pairs = |path: &str| {
        let pairs = path.split(['M', 'L', 'Z']).filter(|pair| !pair.is_empty());
        pairs.map(point).collect::<Vec<_>>()
    };
    paths.flat_map(pairs).collect()
}

/// Some node of a class with this attribute.
fn find<'a>(root: Node<'a, 'a>, class: &'a str, key: &'a str, value: &'a str) -> Node<'a, 'a> {
    let mut found = of_class(root, class).filter(|node| node.attribute(key) == Some(value));
    found.next().unwrap_or_else(|| panic!("no {class} with {key} {value}"))
}

#[test]
fn corners_of_screens_and_lenses_are_where_the_model_has_them() {
    let projectors = polyptych_wall_file::parse(PROJECTORS, "pair.toml".as_ref()).expect("a wall");
    for wall in [config("cave-4.toml"), config("panoramic-3.toml"), projectors] {
        let name = &wall.name;
        let text = drawing_of(&wall);
        let document = Document::parse(&text).expect("XML");
        for (view, side) in [("plan", Side::Above), ("side", Side::Right)] {
            let view = find(document.root(), "w-view", "data-view", view);
            let (origin, scale) = (numbers(view, "data-origin"), numbers(view, "data-scale")[0]);
            let place = |at: DVec3| DVec2::new(origin[0], origin[1]) + side.flat(at) * scale;
            let is_near = |list: &[DVec2], at: DVec3| {
                list.iter().any(|found| found.distance(place(at)) < ROUNDING)
            };
            for screen in &wall.screens {
                let drawn = points(find(view, "w-screen", "data-screen", &screen.name));
                for uv in [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE] {
                    let corner = screen.surface.display_from_uv(uv).expect("a corner");
                    assert!(is_near(&drawn, corner), "{name}: {} {uv}", screen.name);
                }
            }
            for (channel, lit) in wall.channels.iter().zip(lit_shapes((&wall).into())) {
                let ChannelKind::Projector(projector) = &channel.cover else { continue };
                let beam = find(view, "w-beam", "data-channel", &channel.name);
                let lens = of_class(view, "w-beam").count();
                assert_eq!(lens, wall.channels.len());
                let circle = beam.descendants().find(|n| n.has_tag_name("circle")).expect("a lens");
                let at = DVec2::new(numbers(circle, "cx")[0], numbers(circle, "cy")[0]);
                assert!(is_near(&[at], projector.position), "{}", channel.name);
                assert!(!lit.room.is_empty(), "{}", channel.name);
            }
        }
    }
}

#[test]
fn channels_lie_on_their_canvas_pixel_by_pixel() {
    let wall = config("powerwall-overlap.toml");
    let text = drawing_of(&wall);
    let document = Document::parse(&text).expect("XML");
    let canvas = find(document.root(), "w-canvas", "data-screen", "front");
    let (origin, scale) = (numbers(canvas, "data-origin"), numbers(canvas, "data-scale"));
    for channel in &wall.channels {
        let mut drawn = canvas.descendants().filter(|node| node.has_tag_name("path"));
        let drawn = drawn.find(|node| node.attribute("data-channel") == Some(&channel.name));
        let drawn = points(drawn.expect("drawn"));
        let corner = channel.origin.as_dvec2();
        for at in [corner, corner + channel.size.as_dvec2()] {
            let due = DVec2::new(origin[0], origin[1]) + at * DVec2::new(scale[0], scale[1]);
            assert!(drawn.iter().any(|found| found.distance(due) < ROUNDING), "{}", channel.name);
        }
    }
    // Seven pairs side by side and four across corners, in all channels but the first.
    assert_eq!(of_class(canvas, "w-overlap").count(), 5);
    let texts: Vec<&str> = canvas.descendants().filter_map(|node| node.text()).collect();
    for due in ["288 px", "162 px", "50 : 50 %"] {
        assert!(texts.contains(&due), "{due} is not in {texts:?}");
    }
}

#[test]
fn every_wall_of_configs_is_well_formed_and_refers_to_nothing_outside() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let entries = std::fs::read_dir(folder).expect("configs").map(|entry| entry.expect("entry"));
    let paths = entries.map(|entry| entry.path());
    let mut count = 0;
    for path in paths.filter(|path| path.extension().is_some_and(|end| end == "toml")) {
        let name = path.file_name().and_then(|name| name.to_str()).expect("UTF-8").to_owned();
        count += 1;
        let text = drawing_of(&config(&name));
        let document = Document::parse(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
        for node in document.descendants() {
            let links = node.attributes().filter(|attribute| attribute.name().ends_with("href"));
            assert!(links.map(|link| link.value()).all(|link| link.starts_with('#')), "{name}");
            assert!(!node.has_tag_name("script") && !node.has_tag_name("image"), "{name}");
        }
        let ids: Vec<_> = document.descendants().filter_map(|n| n.attribute("id")).collect();
        let unique: std::collections::BTreeSet<_> = ids.iter().collect();
        assert_eq!(unique.len(), ids.len(), "{name}");
    }
    assert!(count >= 8, "{count} walls");
}

#[test]
fn a_thousand_channels_with_any_names_stay_small_and_legible_to_a_parser() {
    let size = UVec2::new(64, 48);
    let plane = Plane::upright(DVec3::new(0.0, 0.0, -8.0), DVec2::new(20.48, 15.36));
    let screen = Screen::new("<screen & \"more\">", Surface::Plane(plane), size * 32);
    let channel = |at: u32| {
        let name = if at == 0 { "<a & b>\u{1}".to_owned() } else { format!("tile-{at}") };
        Channel::tile(&name, 0, UVec2::new(at % 32, at / 32) * size, size)
    };
    let wall = Wall::new("a < b", vec![screen], (0..1024).map(channel).collect());
    let text = drawing_of(&wall);
    assert!(text.len() < 2 << 20, "{} bytes", text.len());
    let document = Document::parse(&text).expect("XML");
    assert_eq!(of_class(document.root(), "w-share").count(), 1024);
    let first = document.descendants().find_map(|node| node.attribute("data-channel"));
    assert_eq!(first, Some("<a & b>\u{fffd}"));
}

#[test]
fn what_no_channel_covers_shows_and_neighbours_differ_in_colour() {
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::ONE);
    let screen = Screen::new("front", Surface::Plane(plane), UVec2::splat(100));
    let tile = |name: &str, x: u32| Channel::tile(name, 0, UVec2::new(x, 0), UVec2::new(60, 50));
    let wall = Wall::new("half", vec![screen], vec![tile("a", 0), tile("b", 40)]);
    let text = drawing_of(&wall);
    let document = Document::parse(&text).expect("XML");
    // The rectangle of the canvas and a swatch of the legend.
    assert_eq!(of_class(document.root(), "w-gap").count(), 2);
    assert!(text.contains("not covered: 0.5 m²"), "the lower half");
    let colors = colors(&wall, &lit_shapes((&wall).into()));
    assert_ne!(colors[0], colors[1]);
}
