//! `polyptych gallery`: one sheet of pictures of many models.

use std::fs;

use rustix::process::Signal;
use serde_json::Value;

use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, town};
use crate::harness::{signals, wait};

#[test]
fn every_model_below_a_folder_is_on_the_sheet_or_its_refusal_is() {
    let place = TestDir::new();
    place.write("models/a.glb", Gltf::triangle().glb());
    place.write("models/deeper/b.glb", b"not a model");
    place.write("models/deeper/c.GLB", Gltf::triangle().glb());
    place.write("models/notes.txt", "no model");
    let finished = place.run([
        "gallery",
        "models",
        "-o",
        "all.png",
        "--columns",
        "3",
        "--size",
        "96x64",
        "--json",
    ]);
    // Both outputs are in one log: the error may stand before the list's last line.
    let is_list = |line: &&str| !line.starts_with("error: ");
    let output = finished.output.lines().filter(is_list).collect::<Vec<_>>().join("\n");
    finished.failed(&["1 of 3 models", "b.glb", "all.png"]);
    let json = &output[output.find('[').expect("a list")..=output.rfind(']').expect("its end")];
    let models: Value =
        serde_json::from_str(json).unwrap_or_else(|error| panic!("{error}: {json}"));
    let models = models.as_array().expect("a list");
    let names: Vec<_> =
        models.iter().map(|model| model["file"].as_str().expect("a file")).collect();
    assert_eq!(names, ["models/a.glb", "models/deeper/b.glb", "models/deeper/c.GLB"]);
    for (model, is_shown) in models.iter().zip([true, false, true]) {
        assert_eq!(model["error"].is_null(), is_shown, "{model}");
        assert_eq!(model["frame_ms"].is_number(), is_shown, "{model}");
        assert_eq!(model["triangles"], u64::from(is_shown), "{model}");
    }
    let sheet = image::open(place.path("all.png")).expect("a picture").to_rgba8();
    // Three pictures beside each other, above one line of text.
    assert_eq!(sheet.dimensions(), (3 * 96, 64 + 20));
    let colors_of = |index: u32| {
        let picture = image::imageops::crop_imm(&sheet, index * 96, 0, 96, 64).to_image();
        picture.pixels().map(|pixel| pixel.0).collect::<std::collections::HashSet<_>>()
    };
    assert!(colors_of(0).len() > 2, "a triangle before a background");
    assert_eq!(colors_of(0), colors_of(2), "the same model, the same picture");
    assert!(colors_of(0).is_disjoint(&colors_of(1)), "no picture of what was refused");
}

#[test]
fn what_cannot_become_a_sheet_is_refused_before_any_work() {
    let place = TestDir::new();
    place.write("one.glb", Gltf::triangle().glb());
    fs::create_dir(place.path("empty")).expect("a folder");
    for (arguments, reasons) in [
        (["gallery", "empty", "-o", "sheet.png"], ["empty", "no .gltf or .glb"]),
        (["gallery", "none", "-o", "sheet.png"], ["none", "cannot read"]),
        (["gallery", "one.glb", "-o", "sheet.jpg"], ["sheet.jpg", ".png"]),
        (["gallery", "one.glb", "-o", "no/sheet.png"], ["no/sheet.png", "cannot write"]),
        (["gallery", "one.glb", "--size", "90000x9"], ["90000", "--size"]),
    ] {
        place.run(arguments).failed(&reasons);
        assert!(!place.path("sheet.png").exists(), "{arguments:?}");
    }
}

#[test]
fn an_interrupted_gallery_keeps_what_it_has_and_ends_its_processes() {
    let place = TestDir::new();
    let mut models: Vec<String> = ["gallery", "--size", "32x32"].map(Into::into).to_vec();
    models.push(town().display().to_string());
    // More than are drawn before the signal comes.
    place.write("one.glb", Gltf::triangle().glb());
    models.extend(std::iter::repeat_n("one.glb".to_owned(), 5000));
    let mut process = place.start("gallery", models);
    process.await_line(&["of 5001", "one.glb"]);
    process.signal(Signal::INT);
    let finished = process.finish(wait::SOON);
    assert_eq!(finished.code(), 130, "{}", finished.output);
    assert!(finished.output.contains("interrupted"), "{}", finished.output);
    let left = wait::look_for(wait::SOON, || {
        signals::processes_of(place.folder()).is_empty().then_some(())
    });
    assert!(left.is_some(), "processes are left");
    assert!(place.path("sheet.png").exists());
}
