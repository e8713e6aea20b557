//! Files that are not what they should be: each refused by name, with what would be right.

use super::maps::{self, Png, png};
use super::{MapFixture, MapUse, WARP};

/// Returns the error for a file with this name and these bytes.
fn refusal(name: &str, used_as: MapUse, bytes: &[u8]) -> String {
    let line = MapFixture::new().bake(name, used_as, bytes).expect_err("refused");
    assert!(line.contains(name), "it names the file: {line}");
    assert!(!line.contains('\n') && line.len() < 600, "{line}");
    line
}

#[track_caller]
fn says(line: &str, parts: &[&str]) {
    for part in parts {
        assert!(line.contains(part), "no '{part}' in: {line}");
    }
}

#[test]
fn broken_float_maps() {
    let good = maps::pfm([4, 2], 3, true, |x, y| [x as f32, y as f32, 1.0]);
    let warp = |bytes: &[u8]| refusal("w.pfm", WARP, bytes);
    let head = |text: &str| warp(&[text.as_bytes(), &good[good.len() - 96..]].concat());
    says(&head("Pf\n4 2\n-1.0\n"), &["one component", "PF"]);
    says(&head("pf4c\n4 2\n-1.0\n"), &["four components"]);
    says(&head("PF\n0 2\n-1.0\n"), &["width is '0'", "1 to 8192"]);
    says(&head("PF\n4 9000\n-1.0\n"), &["height is '9000'"]);
    says(&head("PF\n4 -2\n-1.0\n"), &["height is '-2'"]);
    says(&head("PF\n4 2\n0\n"), &["scale is '0'"]);
    says(&head("PF\n4 2\nnan\n"), &["scale is 'nan'"]);
    says(&head("PF\n4 3\n-1.0\n"), &["truncated", "96 bytes of 4 × 3", "144"]);
    says(&head("PF\n4 1\n-1.0\n"), &["follow its last pixel", "48"]);
    says(&warp(&good[..good.len() - 1]), &["truncated"]);
    says(&warp(b"PF"), &["begin with PF"]);
    says(&warp(b"PF\n"), &["width is ''"]);
    let unlit = maps::pfm([2, 2], 3, true, |_, _| [f32::NAN; 3]);
    says(&warp(&unlit), &["nothing is lit"]);
    let far = maps::pfm([2, 2], 3, true, |x, y| [x as f32, y as f32 * 5000.0, 1.0]);
    says(&warp(&far), &["pixel (0, 1) from the upper left", "in metres", "1000"]);
    let value = |x: u32, y: u32| [x as f32 - 1.5, y as f32 - 0.25, -2.0];
    for (is_little, from, to) in [(true, "-1.000000", "1.0"), (false, "1.0", "-1.0")] {
        let bytes = maps::pfm([4, 4], 3, is_little, value);
        let head = format!("PF\n4 4\n{from}\n").len();
        let swapped = [format!("PF\n4 4\n{to}\n").as_bytes(), &bytes[head..]].concat();
        says(&warp(&swapped), &["pixel (0, 0)", "the other order", "big-endian"]);
    }
}

#[test]
fn broken_obj_meshes() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n";
    let with = |faces: &str| refusal("m.obj", WARP, format!("{corners}{faces}").as_bytes());
    says(&with(""), &["no faces"]);
    says(&with("f 1 2 3\n"), &["line 9", "'1' has no UV"]);
    says(&with("f 1/1 2/2 3//3\n"), &["line 9", "'3//3' has no UV"]);
    says(&with("f 1/1 2/2\n"), &["line 9", "2 corners"]);
    says(&with("f 1/1 2/2 5/3\n"), &["'5/3' names a position of 4"]);
    says(&with("f 1/1 2/2 3/9\n"), &["'3/9' names a UV of 4"]);
    says(&with("f 1/1 2/2 0/3\n"), &["names a position"]);
    says(&with("f 1/1 2/2 x/3\n"), &["names a position"]);
    says(&with("v 1 2\n"), &["line 9", "too few numbers"]);
    says(&with("v 1 2 nan\n"), &["line 9", "'nan' is not a finite number"]);
    says(&with("v 1 2 5000\n"), &["line 9", "too far", "metres"]);
    says(&with("f 1/1 2/2 4/4\nf 1/1 3/3 4/4\n"), &["line 10", "turned over", "line 9"]);
    says(&with("f 1/1 1/1 1/1\n"), &["covers any of the picture"]);
    says(&with("vt 2 0\nvt 2 1\nf 1/5 2/6 3/5\n"), &["covers any of the picture"]);
}

/// Two sheets of one picture, one over the other, with the same winding.
#[test]
fn a_mesh_that_lies_over_itself() {
    let grid = maps::obj([8, 8], |u, v| ([u, v, 0.0], [u, v]));
    let sheet = "v 0 0 1\nv 1 0 1\nv 0 1 1\nvt 0.4 0.4\nvt 0.6 0.4\nvt 0.4 0.6\n";
    let text = format!("{grid}{sheet}f 82/82 84/84 83/83\n");
    says(&refusal("m.obj", MapUse::ScreenMesh, text.as_bytes()), &["lie over those of line"]);
    // The same grid alone meets itself on its edges only.
    MapFixture::new().bake("m.obj", MapUse::ScreenMesh, grid.as_bytes()).expect("no fold");
}

/// Parts of a mesh beside the picture are not drawn: they may be folded, turned over and far away.
#[test]
fn only_the_picture_is_checked_for_folds() {
    let grid = maps::obj([8, 8], |u, v| ([u, v, 0.0], [u * 1.5 - 0.25, v * 1.5 - 0.25]));
    let beside = "v 0 0 1\nvt 1.05 0.2\nvt 1.2 0.2\nvt 1.05 0.4\nvt 900 900\n\
                  f 82/82 82/84 82/83\nf 82/82 82/83 82/84\nf 82/83 82/84 82/85\n";
    let text = format!("{grid}{beside}");
    MapFixture::new().bake("m.obj", WARP, text.as_bytes()).expect("no fold in the picture");
    let inside = text.replace("vt 1.05", "vt 0.05");
    says(&refusal("m.obj", WARP, inside.as_bytes()), &["line", "those of line"]);
}

#[test]
fn folded_bourke_meshes_name_their_node() {
    let node = |x: u32, y: u32| {
        let fold = if x == 2 { -1.2 } else { 0.0 };
        [f64::from(x) - 1.5 + fold, f64::from(y) - 1.0, 0.5, 0.5, 1.0]
    };
    let line = refusal("m.data", WARP, maps::bourke([4, 3], node).as_bytes());
    says(&line, &["line 4", "turned over", "line 3"]);
}

#[test]
fn a_mesh_with_holes_is_a_mesh() {
    let grid = maps::obj([6, 6], |u, v| ([u, v, 0.0], [u, v]));
    let lines: Vec<&str> = grid.lines().collect();
    let kept = lines.iter().enumerate().filter(|(i, _)| i % 3 != 2 || *i < 101);
    let text: Vec<&str> = kept.map(|(_, line)| *line).collect();
    assert!(text.len() < lines.len());
    MapFixture::new().bake("m.obj", WARP, text.join("\n").as_bytes()).expect("holes are no fault");
}

#[test]
fn broken_gltf_meshes() {
    let builder = super::Builder::triangle();
    let line = refusal("m.glb", MapUse::ScreenMesh, &builder.glb());
    says(&line, &["meshes[0].primitives[0]", "TEXCOORD_0"]);
    says(&refusal("m.gltf", MapUse::ScreenMesh, b"{\"asset\":"), &["truncated"]);
    says(&refusal("m.stl", MapUse::ScreenMesh, b"solid"), &["neither OBJ nor glTF"]);
}

#[test]
fn broken_bourke_meshes() {
    let node = |x: u32, y: u32| [f64::from(x), f64::from(y), 0.5, 0.5, 1.0];
    let good = maps::bourke([2, 2], node);
    let warp = |text: &str| refusal("m.data", WARP, text.as_bytes());
    says(&warp(&good.replacen('2', "1", 1)), &["line 1", "polar", "2, rectangular"]);
    says(&warp(&good.replacen('2', "7", 1)), &["line 1", "'7'"]);
    says(&warp("2\n1 9\n"), &["line 2", "'1 9'"]);
    says(&warp("2\n999999 999999\n"), &["line 2"]);
    says(&warp("2\n"), &["truncated", "nodes across"]);
    says(&warp("2\n2 2\n0 0 0 0 1\n"), &["truncated", "node 2 of 4"]);
    says(&warp(&format!("{good}0 0 0 0 1\n")), &["line 7", "follows the last of 4"]);
    says(&warp(&good.replace("0.5 0.5 1", "0.5 1")), &["line 3", "too few numbers"]);
    says(&warp(&good.replacen("0.5 0.5 1", "0.5 0.5 1.5", 1)), &["line 3", "out of range"]);
    says(&warp(&good.replace("0.5 1", "0.5 -1")), &["no cell", "lit"]);
    let line = refusal(
        "m.data",
        MapUse::Warp { aspect: None, dark_zeros: false, sgct_roles: false },
        good.as_bytes(),
    );
    says(&line, &["several shapes"]);
}

#[test]
fn broken_pictures() {
    let texels = [0u16; 16];
    let grey = Png { size: [4, 4], color: 0, bits: 8, gamma: None, texels: &texels };
    let bytes = png(&grey);
    let as_mask = |bytes: &[u8]| refusal("a.png", MapUse::Mask, bytes);
    says(&as_mask(&bytes[..40]), &["PNG"]);
    says(&as_mask(b"\xff\xd8\xff"), &["can't be decoded", "PNG"]);
    says(&as_mask(&png(&Png { gamma: Some(0), ..grey.clone() })), &["gAMA is 0"]);
    let giant = png(&Png { size: [9000, 4], ..grey.clone() });
    says(&as_mask(&giant), &["9000 × 4", "8192"]);
    let bomb = png(&Png { size: [8192, 8192], ..grey.clone() });
    says(&as_mask(&bomb), &["can't hold 8192 × 8192"]);
    let clear = png(&Png { size: [2, 4], color: 4, ..grey.clone() });
    says(&as_mask(&clear), &["pixel (0, 0)", "transparent"]);
    let as_uv = |bytes: &[u8]| refusal("a.png", WARP, bytes);
    says(&as_uv(&bytes), &["grey", "16 bits"]);
    let texels = [0u16; 12];
    let eight = Png { size: [2, 2], color: 2, bits: 8, gamma: None, texels: &texels };
    says(&as_uv(&png(&eight)), &["8 bits"]);
    says(&as_uv(&png(&Png { bits: 16, ..eight })), &["unlit", "blue is 0 everywhere"]);
}

#[test]
fn what_is_no_map_at_all() {
    says(&refusal("x.bin", WARP, b"?"), &["no kind of warp map", "PFM"]);
    says(&refusal("x.bin", WARP, b""), &["no kind of warp map"]);
    says(&refusal("w.mpcdi", WARP, b"PK\x03\x04"), &["archive", "polyptych wall import"]);
    let place = MapFixture::new();
    let store = &place.store;
    let path = place.folder.path().join("none.pfm");
    let none = super::bake_map(&path, WARP, store, &std::sync::atomic::AtomicBool::new(false));
    says(&none.expect_err("refused").to_string(), &["none.pfm", "readable"]);
}
