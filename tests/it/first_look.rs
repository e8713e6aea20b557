//! The first view of a scene that was opened: all of it, large, at a sensible brightness; and the
//! notes on parts that cannot be shown.

use image::{Rgba, RgbaImage};
use polyptych_client::Capture;
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DMat4, DVec3, Vec3};
use serde_json::{Value, json};

use crate::harness::local_wall::{LocalWall, of_repository, screen_of, small};
use crate::harness::model::{Model, Part};
use crate::harness::pictures::{color_count, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// A plate of this size in metres, red and without light.
fn plate(size: Vec3, at: DVec3) -> Gltf {
    let half = size / 2.0;
    let place = DMat4::from_translation(at);
    let top = Vec3::new(0.0, half.y, 0.0);
    let right = Vec3::new(half.x, 0.0, 0.0);
    let sheet = |middle: Vec3, up: Vec3| Part::rectangle(place, middle, right, up, Vec3::X);
    let front = sheet(Vec3::new(0.0, 0.0, half.z), top);
    Model::of(vec![sheet(top, Vec3::new(0.0, 0.0, -half.z)), front]).gltf()
}

fn is_red(pixel: Rgba<u8>) -> bool {
    pixel[0] > 120 && pixel[1] < 80 && pixel[2] < 80
}

/// Shares of width and height that the red part of a picture takes, and of its pixels.
fn red_part(picture: &RgbaImage) -> [f64; 3] {
    let red = picture.enumerate_pixels().filter(|(_, _, pixel)| is_red(**pixel));
    let (mut min, mut max, mut count) = ([u32::MAX; 2], [0; 2], 0u32);
    for (x, y, _) in red {
        (min, max) = ([min[0].min(x), min[1].min(y)], [max[0].max(x), max[1].max(y)]);
        count += 1;
    }
    assert!(count > 0, "nothing red is seen");
    let share = |i: usize, side: u32| f64::from(max[i] - min[i] + 1) / f64::from(side);
    let (width, height) = picture.dimensions();
    [share(0, width), share(1, height), f64::from(count) / f64::from(width * height)]
}

#[test]
fn a_flat_city_takes_the_width_of_a_wall_when_it_is_simulated() {
    let place = TestDir::new();
    let city = plate(Vec3::new(800.0, 12.0, 600.0), DVec3::new(6.4e6, 30.0, -2e5));
    let scene = place.write("city.glb", city.glb());
    let wall = of_repository("wall-3x1.toml");
    let mut simulation = Simulation::start(place, &wall, &scene, &["--frames", "1"]);
    simulation.process.finish(wait::LIMIT).succeeded();
    let picture = read(&simulation.place.path("out/wall.png"));
    let [width, height, area] = red_part(&picture);
    assert!(width > 0.98, "{width} of the width, {height} of the height, {area} of all pixels");
    assert!(area > 0.25, "{area} of all pixels");
}

/// A wall that opens scenes of a folder.
struct Stage {
    scenes: TestDir,
    local: LocalWall,
    client: Client,
}

impl Stage {
    fn new() -> Self {
        let scenes = TestDir::new();
        let folder = scenes.path("scenes");
        std::fs::create_dir(&folder).expect("a folder");
        let local = LocalWall::start(&small(2, 1), &[&folder]);
        let client = local.client();
        Self { scenes, local, client }
    }

    fn write(&self, name: &str, gltf: &Gltf) {
        self.scenes.write(&format!("scenes/{name}"), gltf.glb());
    }

    fn open(&self, arguments: &[&str]) -> RgbaImage {
        let all: Vec<&str> = ["open"].iter().chain(arguments).copied().collect();
        self.local.run(&all).succeeded();
        let capture: Capture = self.client.capture().expect("a picture");
        assert_eq!(capture.missing, []);
        screen_of(&capture)
    }
}

#[test]
fn an_opened_scene_touches_the_edges_of_the_wall_and_is_nowhere_cut_off() {
    let stage = Stage::new();
    for (name, size) in [
        ("tower.glb", Vec3::new(10.0, 300.0, 10.0)),
        ("city.glb", Vec3::new(1000.0, 4.0, 700.0)),
        ("coin.glb", Vec3::new(0.002, 0.0005, 0.002)),
    ] {
        stage.write(name, &plate(size, DVec3::new(-3.0, 0.25, 1e4)));
        let picture = stage.open(&[name, "--heading", "0"]);
        let [width, height, _] = red_part(&picture);
        assert!(width.max(height) > 0.97, "{name}: {width} × {height}");
        // Seen from +z, nothing of it lies beyond an edge: both ends of the edge pixels' rows are
        // as far from the edge across the wall.
        let columns = (0..picture.width())
            .filter(|&x| (0..picture.height()).any(|y| is_red(*picture.get_pixel(x, y))));
        let columns: Vec<u32> = columns.collect();
        let left = columns.first().copied().unwrap_or(0);
        let right = picture.width() - 1 - columns.last().copied().unwrap_or(0);
        assert!(left.abs_diff(right) <= 2, "{name}: {left} and {right} columns beside it");
    }
}

/// A ground of mid-grey below a sun of so many lux.
fn sunny(lux: f64) -> Gltf {
    let mut gltf = plate(Vec3::new(10.0, 0.0, 10.0), DVec3::ZERO);
    let grey = json!({ "baseColorFactor": [0.18, 0.18, 0.18, 1], "metallicFactor": 0 });
    gltf.json["materials"] = json!([{ "pbrMetallicRoughness": grey }]);
    for mesh in gltf.json["meshes"].as_array_mut().expect("a list") {
        let primitive = &mut mesh["primitives"][0];
        primitive["material"] = json!(0);
        primitive["attributes"].as_object_mut().expect("an object").remove("COLOR_0");
    }
    let light = json!({ "type": "directional", "intensity": lux });
    gltf.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
    let nodes = gltf.json["nodes"].as_array_mut().expect("a list");
    let half = std::f64::consts::FRAC_1_SQRT_2;
    nodes.push(json!({ "rotation": [-half, 0, 0, half],
        "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
    let sun = nodes.len() - 1;
    gltf.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(json!(sun));
    gltf
}

/// The code in the middle of a picture.
fn middle(picture: &RgbaImage) -> u8 {
    picture.get_pixel(picture.width() / 2, picture.height() / 2)[1]
}

#[test]
fn real_units_are_exposed_for_and_the_next_scene_is_not_dark() {
    let stage = Stage::new();
    for (name, lux) in [("plain.glb", 3.0), ("office.glb", 500.0), ("noon.glb", 100_000.0)] {
        stage.write(name, &sunny(lux));
    }
    let plain = stage.open(&["plain.glb"]);
    assert!((100..150).contains(&middle(&plain)), "{}", middle(&plain));
    for name in ["office.glb", "noon.glb"] {
        let lit = stage.open(&[name]);
        assert!((100..150).contains(&middle(&lit)), "{name}: {}", middle(&lit));
        let white = stage.open(&[name, "--exposure", "1"]);
        assert!(middle(&white) > 230, "{name}: what is asked for comes first");
        assert_eq!(stage.open(&["plain.glb"]), plain, "after {name}");
    }
    // Whoever opens a scene by the library gets the same, and is told the number.
    let summary = stage.client.open_scene("noon.glb").expect("opened");
    assert!((2e-5..5e-5).contains(&summary.exposure), "{}", summary.exposure);
    let library = screen_of(&stage.client.capture().expect("a picture"));
    assert!((100..150).contains(&middle(&library)), "{}", middle(&library));
    assert_eq!(stage.client.open_scene("plain.glb").expect("opened").exposure, 1.0);
}

#[test]
fn a_missing_image_shows_a_checker_and_an_empty_draco_file_is_refused() {
    let stage = Stage::new();
    let mut textured = plate(Vec3::new(10.0, 4.0, 10.0), DVec3::ZERO);
    for (i, mesh) in textured.json["meshes"].as_array_mut().expect("a list").iter_mut().enumerate()
    {
        let primitive = &mut mesh["primitives"][0];
        primitive["material"] = json!(0);
        let attributes = primitive["attributes"].as_object_mut().expect("an object");
        assert!(
            attributes.contains_key("TEXCOORD_0") && attributes.remove("COLOR_0").is_some(),
            "{i}"
        );
    }
    let texture = json!({ "baseColorTexture": { "index": 0 } });
    textured.json["materials"] =
        json!([{ "pbrMetallicRoughness": texture, "extensions": { "KHR_materials_unlit": {} } }]);
    textured.json["textures"] = json!([{ "source": 0 }]);
    textured.json["images"] = json!([{ "uri": "gone.webp" }]);
    stage.write("textured.glb", &textured);
    let picture = stage.open(&["textured.glb"]);
    let brightness = |y: u32| (0..picture.width()).map(move |x| (x, y));
    let places = brightness(picture.height() / 2).filter_map(|(x, y)| {
        let [r, g, b, _] = picture.get_pixel(x, y).0;
        (r == g && g == b).then_some(r)
    });
    let greys: Vec<u8> = places.collect();
    let (dark, light) = (greys.iter().min(), greys.iter().max());
    assert!(light > dark.map(|dark| dark + 30).as_ref(), "no checker: {dark:?} to {light:?}");
    assert!(color_count(&picture) > 2);

    let before = stage.client.status().expect("a status");
    let mut draco = Gltf::triangle();
    draco.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    for accessor in draco.json["accessors"].as_array_mut().expect("a list") {
        accessor.as_object_mut().expect("an object").remove("bufferView");
    }
    draco.json["meshes"][0]["primitives"][0]["extensions"] = json!({
        "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
    stage.write("draco.glb", &draco);
    stage.local.run(&["open", "draco.glb"]).failed(&["Draco", "nothing is left to draw"]);
    let after = stage.client.status().expect("a status");
    assert_eq!((before.revision, before.scene), (after.revision, after.scene));
}

#[test]
fn a_strict_bake_fails_where_a_note_says_what_is_not_drawn() {
    let place = TestDir::new();
    let mut milk = Gltf::triangle();
    let name = "KHR_materials_volume_scatter";
    milk.json["materials"] =
        json!([{ "extensions": { name: { "multiscatterColor": [1, 0, 0] } } }]);
    milk.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    milk.json["extensionsUsed"] = json!([name]);
    milk.json["extensionsRequired"] = json!([name]);
    place.write("milk.glb", milk.glb());
    place.write("plain.glb", Gltf::triangle().glb());
    let bake = |file, strict: &[&str]| place.run([&["bake", file, "-o", "baked"], strict].concat());
    assert!(bake("milk.glb", &[]).succeeded().contains(name));
    bake("milk.glb", &["--strict"]).failed(&[name, "milk.glb", "--strict"]);
    bake("plain.glb", &["--strict"]).succeeded();
    // A program is told what was baked too, with the notes in it and no words besides.
    let refused = bake("milk.glb", &["--strict", "--json"]);
    let line = refused.output.lines().find(|line| line.starts_with('{')).expect("JSON");
    let baked: Value = serde_json::from_str(line).expect("JSON");
    let note = baked["warnings"][0].as_str().expect("a note");
    assert!(note.contains(name) && baked["manifest"].is_string(), "{baked}");
    let is_noted = refused.output.lines().any(|line| line.starts_with("note: "));
    assert!(!is_noted, "{}", refused.output);
    refused.failed(&[name, "milk.glb", "--strict"]);
    let baked = bake("plain.glb", &["--strict", "--json"]).json();
    assert_eq!((&baked["warnings"], &baked["name"]), (&json!([]), &json!("plain")));
}
