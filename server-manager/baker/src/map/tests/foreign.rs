//! MPCDI archives as other programs write them.

use glam::{DVec3, UVec2, Vec3};
use polyptych_wall::warp::{CalibrationMap, MapCoordinates};

use super::super::mpcdi::Profile;
use super::archives::{archive, halves, import, refused, values, with_xml};
use super::maps::{self, Entry, Png, png};
use super::{MapFixture, MapUse};

/// The entries of a good archive.
fn entries() -> Vec<Entry> {
    maps::mpcdi_entries("2d", [200, 100], &halves(f32::NAN))
}

fn mask_of(place: &MapFixture, file: &str) -> polyptych_wall::warp::Mask {
    let bytes = std::fs::read(place.folder.path().join(file)).expect("written");
    match place.bake("again.png", MapUse::Mask, &bytes).expect("a mask") {
        CalibrationMap::Mask(mask) => mask,
        CalibrationMap::Warp(_) => panic!("a warp"),
    }
}

/// §3.7: alpha, beta and region may have different sizes.
#[test]
fn masks_keep_sizes_of_their_own() {
    let mut regions = halves(f32::NAN);
    let texels: Vec<u16> = (0..16).map(|i| i * 17).collect();
    let small = png(&Png { size: [4, 4], color: 0, bits: 8, gamma: None, texels: &texels });
    regions[1].alpha = Some((small.clone(), 1.0));
    regions[1].beta = Some((small, 1.0));
    let (place, imported) = import(&archive("2d", &regions));
    let region = &imported.expect("imported").regions[1];
    for file in [&region.alpha, &region.beta] {
        let mask = mask_of(&place, file.as_ref().expect("a mask"));
        assert_eq!((mask.size, mask.at(3, 3)), (UVec2::splat(4), [65535; 3]));
        assert_eq!(mask.at(1, 0), [17 * 257; 3], "linear, as gammaEmbedded says");
    }
}

/// Masks of 16 bits and of colours keep both.
#[test]
fn masks_of_colours_and_sixteen_bits_keep_them() {
    let mut regions = halves(f32::NAN);
    let texels = [0, 65535, 32768, 1000, 2000, 3000];
    let wide = png(&Png { size: [2, 1], color: 2, bits: 16, gamma: None, texels: &texels });
    regions[0].alpha = Some((wide, 1.0));
    let from = "<componentDepth>1</componentDepth><bitDepth>8</bitDepth>\
                <gammaEmbedded>1<";
    let to = "<componentDepth>3</componentDepth><bitDepth>16</bitDepth><gammaEmbedded>1<";
    let (place, imported) = import(&with_xml("2d", &regions, from, to));
    let region = &imported.expect("imported").regions[0];
    let mask = mask_of(&place, region.alpha.as_ref().expect("an alpha"));
    assert_eq!([mask.at(0, 0), mask.at(1, 0)], [[0, 65535, 32768], [1000, 2000, 3000]]);
}

#[test]
fn a_text_of_another_name_or_place_is_taken_with_a_note() {
    let (_, plain) = import(&maps::zip(&entries()));
    assert_eq!(plain.expect("imported").notes, Vec::<String>::new());
    for name in ["MPCDI.XML", "wall/mpcdi.xml", "calibration.xml", "mpacs.xml"] {
        let mut all = entries();
        all[0].name = name.to_owned();
        if name == "wall/mpcdi.xml" {
            all[1..].iter_mut().for_each(|entry| entry.name = format!("wall/{}", entry.name));
        }
        // The text need not come first.
        all.rotate_left(1);
        let (_, imported) = import(&maps::zip(&all));
        let imported = imported.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(imported.regions.len(), 2);
        assert!(imported.notes[0].contains(name), "{:?}", imported.notes);
    }
    let mut two = entries();
    two[0].name = "a.xml".to_owned();
    two.push(Entry::new("b.xml", b"<MPCDI/>"));
    refused(&maps::zip(&two), &["several XML", "mpcdi.xml"]);
}

#[test]
fn entries_are_found_in_other_capitals_and_with_backslashes() {
    let mut all = entries();
    for entry in &mut all[1..] {
        entry.name = entry.name.to_uppercase().replace('/', "\\");
    }
    let (_, imported) = import(&maps::zip(&all));
    assert_eq!(imported.expect("imported").regions.len(), 2);
}

/// A region without a warp shows its part of the buffer straight.
#[test]
fn empty_elements_are_left_out_with_a_note() {
    let regions = halves(f32::NAN);
    let path = "<path>right/warp.pfm</path>";
    for (from, to) in [(path, "<path/>"), (path, "<path>  </path>"), (path, "")] {
        let (place, imported) = import(&with_xml("2d", &regions, from, to));
        let imported = imported.expect("imported");
        assert_eq!(imported.notes.len(), 2, "{:?}", imported.notes);
        let (space, values) = values(&place, imported.regions[1].warp.as_ref());
        assert_eq!((space, values.len()), (MapCoordinates::Canvas, 4));
        // The middle of the upper left quarter of the right half, 0.25 to 0.75 high.
        assert!(values[0].distance(Vec3::new(0.625, 0.375, 0.0)) < 1e-6, "{}", values[0]);
    }
    let (from, to) = ("<gammaEmbedded>2.2</gammaEmbedded>", "<gammaEmbedded/>");
    import(&with_xml("2d", &regions, from, to)).1.expect("imported");
    let to = "<gammaEmbedded>2.2</gammaEmbedded></alphaMap><betaMap/><alphaMap>";
    let (_, imported) = import(&with_xml("2d", &regions, from, to));
    let imported = imported.expect("imported");
    assert!(imported.notes.iter().any(|note| note.contains("betaMap")), "{:?}", imported.notes);
}

#[test]
fn several_buffers_are_several_pictures() {
    let (from, to) = (
        "</region><region id=\"right\"",
        "</region></buffer><buffer id=\"Two\" xResolution=\
          \"640\" yResolution=\"480\"><region id=\"right\"",
    );
    let (place, imported) = import(&with_xml("2d", &halves(f32::NAN), from, to));
    let imported = imported.expect("imported");
    let buffers: Vec<_> =
        imported.buffers.iter().map(|buffer| (buffer.name.as_str(), buffer.size)).collect();
    assert_eq!(buffers, [("all", UVec2::new(200, 100)), ("two", UVec2::new(640, 480))]);
    let right = &imported.regions[1];
    assert_eq!((right.buffer, right.part), (1, (UVec2::new(320, 120), UVec2::new(320, 240))));
    let (_, values) = values(&place, right.warp.as_ref());
    assert!(values[0].distance(Vec3::new(0.5025, 0.255, 0.0)) < 1e-6, "{}", values[0]);
}

/// Offsets from where each pixel is would be one point, read as places.
#[test]
fn offsets_are_refused_and_steep_places_are_not() {
    let with = |value: &dyn Fn(f32, f32) -> [f32; 2]| {
        let mut regions = halves(f32::NAN);
        regions[0].warp = maps::pfm([100, 50], 3, true, |x, y| {
            let [u, v] = value((x as f32 + 0.5) / 100.0, 1.0 - (y as f32 + 0.5) / 50.0);
            [u, v, 0.0]
        });
        archive("2d", &regions)
    };
    let offsets: [&dyn Fn(f32, f32) -> [f32; 2]; 3] =
        [&|_, _| [0.0, 0.0], &|u, v| [0.01 * (u * 6.0).sin(), -0.02 * (v * 4.0).cos()], &|u, v| {
            [0.03 * u * (1.0 - u), 0.05 * v]
        }];
    for offset in offsets {
        refused(&with(offset), &["entry 'Left Projector/warp.pfm'", "offsets", "u and v"]);
    }
    let places: [&dyn Fn(f32, f32) -> [f32; 2]; 4] =
        [&|u, v| [u, v], &|u, v| [1.0 - v, u], &|u, v| [0.4 + 0.3 * u, 0.5 * v * v], &|u, v| {
            [1.2 * u - 0.1, 1.2 * v - 0.1 + 0.05 * (u * 3.0).sin()]
        }];
    for place in places {
        import(&with(place)).1.expect("imported");
    }
}

const FRAME: &str = "<coordinateFrame><posx>1.5</posx><posy>-2</posy><posz>3</posz>\
     <yawx>0</yawx><yawy>0</yawy><yawz>-1</yawz><pitchx>1</pitchx><pitchy>0</pitchy>\
     <pitchz>0</pitchz><rollx>0</rollx><rolly>1</rolly><rollz>0</rollz></coordinateFrame>";

/// z up and y ahead, as surveyors count: 2 m back, 1.5 m to the right, 3 m high.
#[test]
fn poses_of_profile_sl_are_projectors() {
    let mut regions = halves(f32::NAN);
    for region in &mut regions {
        region.frustum = Some([10.0, -5.0, 2.0, 12.0, -20.0, 10.0, -8.0]);
    }
    let with_frame =
        |frame: &str| with_xml("sl", &regions, "</frustum>", &format!("</frustum>{frame}"));
    let imported = import(&with_frame(FRAME)).1.expect("imported");
    assert_eq!(imported.profile, Profile::ShaderLamps);
    let region = &imported.regions[0];
    assert!(region.position.distance(DVec3::new(1.5, 3.0, 2.0)) < 1e-12, "{}", region.position);
    assert_eq!(region.warp, None);
    let [left, right, down, up] = region.pyramid.expect("a frustum").tangents();
    let due = [-20.0, 12.0, -8.0, 10.0].map(|degrees: f64| degrees.to_radians().tan());
    assert_eq!([left, right, down, up], due);
    let skew = FRAME.replace("<yawz>-1", "<yawz>-1.5");
    refused(&with_frame(&skew), &["coordinateFrame", "right angles"]);
    refused(&with_frame(&FRAME.replace(">1.5<", ">here<")), &["posx", "'here'"]);
}

/// The text alone, as programs write that keep the maps to themselves.
#[test]
fn a_text_alone_is_read() {
    let mut regions = halves(f32::NAN);
    for region in &mut regions {
        region.frustum = Some([0.0, 0.0, 0.0, 20.0, -20.0, 10.0, -10.0]);
    }
    let all = maps::mpcdi_entries("sl", [200, 100], &regions);
    let text = String::from_utf8(all[0].packed.clone()).expect("text");
    let start = text.find("<files>").expect("files");
    let bare = format!("\u{feff}{}</MPCDI>", &text[..start]);
    let imported = import(bare.as_bytes()).1.expect("imported");
    assert_eq!(imported.regions.len(), 2);
    refused(text.as_bytes(), &["no entry 'Left Projector/alphaMap.png'"]);
}

#[test]
fn lenses_that_are_not_plain_are_refused() {
    let mut regions = halves(f32::NAN);
    for region in &mut regions {
        region.frustum = Some([0.0, 0.0, 0.0, 20.0, -20.0, 10.0, -10.0]);
    }
    let with_lens = |value: &dyn Fn(f32, f32) -> [f32; 2]| {
        let mut all = maps::mpcdi_entries("sl", [200, 100], &regions);
        let text = String::from_utf8(all[0].packed.clone()).expect("text");
        let lens = "<distortionMap><path>lens.pfm</path></distortionMap></fileset>";
        all[0] = Entry::new("mpcdi.xml", text.replacen("</fileset>", lens, 1).as_bytes());
        let lens = maps::pfm([20, 10], 3, true, |x, y| {
            let [u, v] = value((x as f32 + 0.5) / 20.0, 1.0 - (y as f32 + 0.5) / 10.0);
            [u, v, 0.0]
        });
        all.push(Entry::new("lens.pfm", &lens));
        maps::zip(&all)
    };
    import(&with_lens(&|_, _| [0.0, 0.0])).1.expect("no lens is known");
    import(&with_lens(&|u, v| [u, v])).1.expect("a plain lens");
    refused(&with_lens(&|u, v| [u * u, v]), &["entry 'lens.pfm'", "not plain"]);
}

#[test]
fn entries_of_one_name_are_refused() {
    let mut all = entries();
    all.push(Entry::new("mpcdi.xml", b"<MPCDI/>"));
    refused(&maps::zip(&all), &["'mpcdi.xml' is there twice"]);
}

/// The archives that VESA's reference library writes, where they are there: alpha of colours,
/// beta of a size of its own, and a region that is a part of its buffer.
#[test]
#[cfg_attr(not(has_shared_files), ignore = "no assets and walls in ../shared")]
fn archives_of_the_reference_library_are_imported() {
    let walls = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/walls");
    let read = |name: &str| std::fs::read(walls.join(name));
    let flat = read("Media2D.mpcdi").expect("beside the repository");
    let (place, imported) = import(&flat);
    let region = &imported.expect("imported").regions[0];
    assert_eq!((region.size, region.part.0), (UVec2::new(300, 200), UVec2::new(3, 2)));
    let (space, values) = values(&place, region.warp.as_ref());
    assert_eq!((space, values.len()), (MapCoordinates::Canvas, 60_000));
    // The lowest row of the file is the first one: v is 0.995 there, and 0 at the top.
    let at = |x: usize, y: usize| values[y * 300 + x];
    let due = |u: f32, v: f32| Vec3::new(0.01 + u * 0.9, 1.0 - (0.07 + v * 0.92), 0.0);
    for (x, y) in [(0, 0), (299, 0), (0, 199), (299, 199), (250, 20)] {
        let due = due(x as f32 / 300.0, y as f32 / 200.0);
        assert!(at(x, y).distance(due) < 1e-6, "({x}, {y}): {}, not {due}", at(x, y));
    }
    let alpha = mask_of(&place, region.alpha.as_ref().expect("an alpha"));
    assert_eq!((alpha.size, alpha.components), (UVec2::new(300, 200), 3));
    let beta = mask_of(&place, region.beta.as_ref().expect("a beta"));
    assert_eq!((beta.size, beta.at(50, 50)), (UVec2::splat(100), [0; 3]));
    let solid = import(&read("Sim3D.mpcdi").expect("beside it")).1.expect("imported");
    assert_eq!((solid.profile, solid.regions.len()), (Profile::ThreeD, 1));
    assert!(solid.regions[0].pyramid.is_some());
    let lamp = import(&read("ShaderLamp.mpcdi").expect("beside it")).1.expect("imported");
    assert_eq!(lamp.regions[0].position, DVec3::new(0.0, -1.0, 0.0));
    refused(&read("Advanced3D.mpcdi").expect("beside it"), &["MPCDI.profile", "a3"]);
}
