//! Damaged scenes through the baker: the JSON's numbers and lists, chunks, images and bytes; and
//! small files that ask for much.

use std::process::Command;
use std::time::{Duration, Instant};

use allocation_counter::measure;
use fastrand::Rng;
use serde_json::{Value, json};

use crate::mutation::mutate;
use crate::scene_file::{SceneFixture, with_place};
use crate::seeds::scenes::{self, Parts};

/// Each writes some twenty files.
const FILES: u64 = 1500;

/// Most that one bake of such a small file may hold at once: an accessor of four million zeros is
/// positions, normals, indices and more.
const HELD_MAX: u64 = 2 << 30;

/// Longest time for one file, on a machine that does something else too.
const FILE_TIME_MAX: Duration = Duration::from_mins(2);

#[test]
fn damaged_scenes_are_baked_or_refused_in_one_line() {
    let seeds = [scenes::everything(), scenes::triangle()];
    let mut baked = 0;
    for number in 0..FILES {
        let seed = crate::seed().wrapping_add(number);
        let mut rng = Rng::with_seed(seed);
        let which = usize::from(rng.u8(0..8) == 0);
        let bytes = damaged(&mut rng, &seeds[which]);
        let begin = Instant::now();
        let mut is_baked = false;
        let info = measure(|| is_baked = with_place(|place| place.check(&bytes)));
        assert!(info.bytes_max < HELD_MAX, "POLYPTYCH_SEED={seed}: {info:?}");
        let taken = begin.elapsed();
        assert!(taken < FILE_TIME_MAX, "POLYPTYCH_SEED={seed}: {taken:?}");
        baked += u64::from(is_baked);
    }
    let share = baked as f64 / FILES as f64;
    assert!((0.05..0.95).contains(&share), "{share} of the files are baked");
}

fn damaged(rng: &mut Rng, seed: &Parts) -> Vec<u8> {
    let mut parts = seed.clone();
    let which = rng.u8(0..8);
    if which < 5 {
        for _ in 0..rng.usize(1..4) {
            change_json(rng, &mut parts.json);
        }
    }
    if which == 5 || which == 6 {
        let before = parts.bin.clone();
        // As long as before, so that views still lie in it, and images reach their decoders.
        mutate(rng, &mut parts.bin, &before);
        parts.bin.resize(before.len(), 0);
    }
    if rng.u8(0..4) == 0 {
        return parts.gltf();
    }
    let mut bytes = parts.glb();
    if which == 7 {
        let other = bytes.clone();
        mutate(rng, &mut bytes, &other);
    }
    bytes
}

/// Replaces, removes or repeats one value somewhere in the tree.
fn change_json(rng: &mut Rng, json: &mut Value) {
    let mut at = json;
    for _ in 0..rng.usize(2..9) {
        let count = at.as_array().map(Vec::len).or(at.as_object().map(serde_json::Map::len));
        let Some(pick) = count.filter(|&count| count > 0).map(|count| rng.usize(0..count)) else {
            break;
        };
        let change_here = rng.u8(0..8);
        at = match at {
            Value::Array(list) => {
                match change_here {
                    0 => drop(list.remove(pick)),
                    1 => {
                        let copies = vec![list[pick].clone(); rng.usize(1..20)];
                        list.extend(copies);
                    }
                    _ => {}
                }
                let last = list.len().saturating_sub(1);
                let Some(next) = list.get_mut(pick.min(last)) else { return };
                next
            }
            Value::Object(map) => {
                let key = map.keys().nth(pick).cloned().unwrap_or_default();
                if change_here == 0 {
                    map.remove(&key);
                    return;
                }
                let Some(next) = map.get_mut(&key) else { return };
                next
            }
            _ => return,
        };
    }
    *at = match rng.u8(0..16) {
        0 => json!(0),
        1 => json!(-1),
        2 => json!(1),
        3 => json!(rng.u32(..)),
        4 => json!(u64::MAX),
        5 => json!(1u64 << 22),
        6 => json!(1e308),
        7 => json!(-1e-308),
        8 => json!(rng.u8(0..8)),
        9 => json!(5120 + i64::from(rng.u8(0..8))),
        10 => json!("VEC3"),
        11 => json!([]),
        12 => json!({}),
        13 => Value::Null,
        14 => json!(rng.f64() * 1e6),
        _ => json!(["KHR_materials_unlit", "../x", "\u{0}"]),
    };
}

/// Sixty parts of four million zeros each took more than a minute, from a kilobyte.
#[test]
fn a_small_file_cannot_ask_for_minutes() {
    let mut parts = scenes::triangle();
    let zeros = json!({ "componentType": 5126, "type": "VEC3", "count": 1 << 22 });
    parts.json["accessors"] = json!(vec![zeros; 60]);
    let attributes = |i: usize| json!({ "POSITION": i, "NORMAL": i, "COLOR_0": i });
    let primitive = |i: usize| json!({ "attributes": attributes(i), "mode": 0 });
    parts.json["meshes"] = json!([{ "primitives": (0..60).map(primitive).collect::<Vec<_>>() }]);
    let line = refusal(&parts);
    assert!(line.contains("primitives[0]") && line.contains("has no data"), "{line}");
}

/// A thousand images that are all the same few kilobytes took an hour.
#[test]
fn a_small_image_cannot_be_named_for_ever() {
    let mut parts = scenes::everything();
    let mut png = std::io::Cursor::new(Vec::new());
    let plain = image::GrayImage::new(4096, 4096);
    plain.write_to(&mut png, image::ImageFormat::Png).expect("encoded");
    let png = png.into_inner();
    let view = json!({ "buffer": 0, "byteOffset": parts.bin.len(), "byteLength": png.len() });
    parts.bin.extend(png);
    parts.json["buffers"] = json!([{ "byteLength": parts.bin.len() }]);
    let views = parts.json["bufferViews"].as_array_mut().expect("a list");
    views.push(view);
    let image = json!({ "bufferView": views.len() - 1 });
    parts.json["images"] = json!(vec![image; 40]);
    let texture = |i: usize| json!({ "source": i });
    parts.json["textures"] = json!((0..40).map(texture).collect::<Vec<_>>());
    let material = |i: usize| json!({ "emissiveTexture": { "index": i } });
    parts.json["materials"] = json!((0..40).map(material).collect::<Vec<_>>());
    let attributes = parts.json["meshes"][0]["primitives"][0]["attributes"].clone();
    let primitive = |i: usize| json!({ "attributes": attributes, "material": i });
    parts.json["meshes"] = json!([{ "primitives": (0..40).map(primitive).collect::<Vec<_>>() }]);
    let line = refusal(&parts);
    assert!(line.contains("images[") && line.contains("pixels"), "{line}");
}

/// Returns the error of the command, a process of its own with a limit, for a file that it refuses.
fn refusal(parts: &Parts) -> String {
    let place = SceneFixture::new();
    let (file, store) = (place.write(&parts.glb()), place.path("store"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_polyptych"));
    command.arg("bake").arg(file).arg("-o").arg(store).args(["--json", "--memory-mib", "4096"]);
    let output = command.output().expect("the command runs");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{text}");
    text.lines().last().unwrap_or_default().to_owned()
}
