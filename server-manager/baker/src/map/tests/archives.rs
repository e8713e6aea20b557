//! MPCDI archives by another hand: what they become, and what is refused.

use std::sync::atomic::AtomicBool;

use glam::{DVec3, UVec2, Vec3};
use polyptych_wall::warp::{CalibrationMap, MapCoordinates, WarpGeometry};

use super::super::mpcdi::{self, Imported, Profile};
use super::maps::{self, Entry, Png, Region, png};
use super::{MapFixture, MapUse, WARP};

/// The left and the right half of a buffer of 200 × 100, each shown as it is.
pub(super) fn halves(third: f32) -> Vec<Region> {
    let size = [100, 50];
    let warp = |x: u32, y: u32| {
        let place = [(x as f32 + 0.5) / 100.0, (y as f32 + 0.5) / 50.0];
        [place[0], 1.0 - place[1], third]
    };
    let texels: Vec<u16> = (0..5000).map(|i| i % 256).collect();
    let mask = png(&Png { size, color: 0, bits: 8, gamma: None, texels: &texels });
    let region = |id: &str, x: f64| Region {
        id: id.to_owned(),
        size,
        part: [x, 0.25, 0.5, 0.5],
        frustum: None,
        warp: maps::pfm(size, 3, true, warp),
        unit: None,
        origin: None,
        alpha: Some((mask.clone(), 2.2)),
        beta: None,
    };
    vec![region("Left Projector", 0.0), region("right", 0.5)]
}

pub(super) fn archive(profile: &str, regions: &[Region]) -> Vec<u8> {
    maps::zip(&maps::mpcdi_entries(profile, [200, 100], regions))
}

pub(super) fn import(bytes: &[u8]) -> (MapFixture, Result<Imported, String>) {
    let place = MapFixture::new();
    let path = place.write("a.mpcdi", bytes);
    let imported = mpcdi::import(&path, place.folder.path(), &AtomicBool::new(false));
    (place, imported.map_err(|error| error.to_string()))
}

/// Returns the space and the values of a written warp map, read back as any warp map is.
pub(super) fn values(place: &MapFixture, file: Option<&String>) -> (MapCoordinates, Vec<Vec3>) {
    let file = file.expect("a warp");
    let bytes = std::fs::read(place.folder.path().join(file)).expect("written");
    let CalibrationMap::Warp(warp) = place.bake("again.pfm", WARP, &bytes).expect("a map") else {
        panic!("a mask")
    };
    let WarpGeometry::Grid(grid) = warp.shape else { panic!("a mesh") };
    (warp.space, grid.values)
}

/// Each pixel of a projector shows its own place of the canvas; the third number is not used.
#[test]
fn regions_of_profile_2d_become_places_of_the_canvas() {
    for third in [f32::NAN, 0.0, 7.0] {
        let (place, imported) = import(&archive("2d", &halves(third)));
        let imported = imported.expect("imported");
        assert_eq!(imported.profile, Profile::TwoD);
        assert_eq!(imported.buffers[0].size, UVec2::new(200, 100));
        let names: Vec<_> = imported.regions.iter().map(|region| region.name.as_str()).collect();
        assert_eq!(names, ["left-projector", "right"]);
        let right = &imported.regions[1];
        assert_eq!(right.part, (UVec2::new(100, 25), UVec2::new(100, 50)));
        let (space, values) = values(&place, right.warp.as_ref());
        assert_eq!(space, MapCoordinates::Canvas);
        for (i, value) in values.iter().enumerate() {
            let (x, y) = ((i % 100) as f32 + 0.5, (i / 100) as f32 + 0.5);
            let due = Vec3::new(0.5 + x / 200.0, 0.25 + y / 100.0, 0.0);
            assert!(value.distance(due) < 1e-6, "pixel {i}: {value}, {due}");
        }
    }
}

/// The gamma that the XML says holds, and the file that is written keeps the light.
#[test]
fn masks_of_an_archive_are_linear_light() {
    let (place, imported) = import(&archive("2d", &halves(f32::NAN)));
    let region = &imported.expect("imported").regions[0];
    let file = region.alpha.as_ref().expect("an alpha");
    let bytes = std::fs::read(place.folder.path().join(file)).expect("written");
    let Ok(CalibrationMap::Mask(mask)) = place.bake("again.png", MapUse::Mask, &bytes) else {
        panic!("no mask")
    };
    assert_eq!(mask.size, UVec2::new(100, 50));
    for i in 0..256u32 {
        let due = (f64::from(i) / 255.0).powf(2.2) * 65535.0;
        assert_eq!(mask.at(i % 100, i / 100), [due.round() as u16; 3], "stored {i}");
    }
    assert_eq!(region.beta, None);
}

/// Points in inches and feet, from the eye; with a frustum each.
#[test]
fn points_of_profile_3d_are_metres() {
    for (unit, metres) in [("mm", 0.001), ("cm", 0.01), ("in", 0.0254), ("ft", 0.3048), ("m", 1.0)]
    {
        let mut regions = halves(0.0);
        for region in &mut regions {
            region.warp = maps::pfm([100, 50], 3, false, |x, y| [x as f32, -(y as f32), -8.0]);
            region.unit = Some(unit.to_owned());
            region.origin = Some("idealEyePoint".to_owned());
            region.frustum = Some([0.0, 0.0, 0.0, 20.0, -20.0, 10.0, -10.0]);
        }
        let (place, imported) = import(&archive("3d", &regions));
        let imported = imported.expect("imported");
        assert_eq!((imported.profile, imported.notes.len()), (Profile::ThreeD, 0));
        let (space, values) = values(&place, imported.regions[0].warp.as_ref());
        assert_eq!(space, MapCoordinates::Display);
        let due = Vec3::new(99.0, -49.0, -8.0) * metres;
        assert!(values[4999].distance(due) < 1e-5, "{unit}: {}, {due}", values[4999]);
    }
}

/// Without points the warp is a place in the frustum's own picture, whose plane is known.
#[test]
fn a_frustum_of_profile_3d_is_a_plane() {
    let mut regions = halves(f32::NAN);
    for region in &mut regions {
        // To the right by a quarter turn, and up by half of one.
        region.frustum = Some([90.0, 0.0, 0.0, 45.0, -45.0, 45.0, 0.0]);
    }
    let (place, imported) = import(&archive("3d", &regions));
    let region = &imported.expect("imported").regions[1];
    let (space, values) = values(&place, region.warp.as_ref());
    assert_eq!(space, MapCoordinates::Canvas);
    assert!(values[0].distance(Vec3::new(0.005, 0.01, 0.0)) < 1e-6, "{}", values[0]);
    let eye = DVec3::new(1.0, 2.0, 3.0);
    let corners = mpcdi::corners(&region.pyramid.expect("a frustum"), eye, 2.0);
    let due = [[2.0, 0.0, -2.0], [2.0, 0.0, 2.0], [2.0, 2.0, -2.0]];
    for (corner, due) in corners.iter().zip(due) {
        assert!((*corner - eye).distance(DVec3::from(due)) < 1e-12, "{corner} {due:?}");
    }
}

#[test]
fn what_is_not_known_is_noted() {
    let mut regions = halves(0.0);
    for region in &mut regions {
        region.warp = maps::pfm([100, 50], 3, true, |x, y| [x as f32, y as f32, -8.0]);
        region.unit = Some("unkown".to_owned());
        region.origin = Some("floorCenter".to_owned());
        region.frustum = Some([0.0, 0.0, 0.0, 20.0, -20.0, 10.0, -10.0]);
    }
    let notes = import(&archive("3d", &regions)).1.expect("imported").notes;
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[0].contains("on the floor") && notes[1].contains("metres"), "{notes:?}");
}

#[track_caller]
pub(super) fn refused(bytes: &[u8], parts: &[&str]) {
    let (place, imported) = import(bytes);
    let line = imported.expect_err("refused");
    assert!(line.contains("a.mpcdi") && !line.contains('\n') && line.len() < 700, "{line}");
    for part in parts {
        assert!(line.contains(part), "no '{part}' in: {line}");
    }
    // Nothing lies beside the folder that was named.
    let above = place.folder.path().parent().expect("above").join("evil.pfm");
    assert!(!above.exists());
}

/// The archive with a text of its XML replaced.
pub(super) fn with_xml(profile: &str, regions: &[Region], from: &str, to: &str) -> Vec<u8> {
    let mut entries = maps::mpcdi_entries(profile, [200, 100], regions);
    let text = String::from_utf8(entries[0].packed.clone()).expect("text");
    assert!(text.contains(from), "{text}");
    entries[0] = Entry::new("mpcdi.xml", text.replace(from, to).as_bytes());
    maps::zip(&entries)
}

#[test]
fn profiles_that_cannot_be_read_are_refused_by_name() {
    let regions = halves(f32::NAN);
    refused(&archive("a3", &regions), &["MPCDI.profile", "a3", "2d, 3d or sl"]);
    refused(&archive("sl", &regions), &["region 'Left Projector'", "no frustum"]);
    refused(&archive("4d", &regions), &["'4d'"]);
    refused(&archive("3d", &regions), &["region 'Left Projector'", "no frustum"]);
    let version = with_xml("2d", &regions, "version=\"1.0\" date", "version=\"3.0\" date");
    refused(&version, &["MPCDI.version", "'3.0'", "1.0 or 2.0"]);
}

#[test]
fn broken_texts_are_refused() {
    let regions = halves(f32::NAN);
    let with = |from: &str, to: &str| with_xml("2d", &regions, from, to);
    refused(&with("id=\"right\"", "id=\"Left Projector\""), &["there twice"]);
    refused(&with("region=\"right\"", "region=\"nobody\""), &["'nobody'", "not there"]);
    refused(&with("xsize=\"0.5\"", "xsize=\"0.8\""), &["part of the buffer"]);
    refused(&with("xsize=\"0.5\"", "xsize=\"nan\""), &["xsize", "'nan'", "a number"]);
    refused(&with("xResolution=\"100\"", "xResolution=\"0\""), &["xResolution", "8192"]);
    refused(&with("</MPCDI>", ""), &["not XML"]);
    refused(&with("<display>", "<none>"), &["not XML"]);
    refused(
        &with("<?xml version=\"1.0\" encoding=\"UTF-8\"?>", "<!DOCTYPE x [<!ENTITY a \"b\">]>"),
        &["DTD"],
    );
    refused(
        &with("Left Projector/warp.pfm", "../evil.pfm"),
        &["'../evil.pfm'", "out of the archive"],
    );
    refused(&with("Left Projector/warp.pfm", "/etc/passwd"), &["out of the archive"]);
    refused(&with("Left Projector/warp.pfm", "C:\\evil.pfm"), &["out of the archive"]);
    refused(&with("right/warp.pfm", "right/none.pfm"), &["no entry 'right/none.pfm'", "'right'"]);
    refused(&with("<gammaEmbedded>2.2<", "<gammaEmbedded>-1<"), &["gammaEmbedded", "'-1'"]);
    refused(&with("<bitDepth>8<", "<bitDepth>16<"), &["bitDepth is 8", "says 16"]);
    let unit = with_xml(
        "3d",
        &{
            let mut regions = halves(9.0);
            for region in &mut regions {
                region.unit = Some("furlong".into());
                region.frustum = Some([0.0, 0.0, 0.0, 20.0, -20.0, 10.0, -10.0]);
            }
            regions
        },
        "<files>",
        "<files>",
    );
    refused(&unit, &["geometricUnit", "'furlong'", "ft"]);
}

#[test]
fn broken_archives_are_refused() {
    let regions = halves(f32::NAN);
    let good = archive("2d", &regions);
    refused(b"no archive at all", &["can't be read as an archive"]);
    refused(&good[..good.len() / 2], &["can't be read as an archive"]);
    let mut entries = maps::mpcdi_entries("2d", [200, 100], &regions);
    entries.remove(0);
    refused(&maps::zip(&entries), &["no entry 'mpcdi.xml'"]);

    let mut entries = maps::mpcdi_entries("2d", [200, 100], &regions);
    entries[2].packed.truncate(100);
    refused(&maps::zip(&entries), &["entry 'Left Projector/warp.pfm'", "can't be read"]);
    let mut entries = maps::mpcdi_entries("2d", [200, 100], &regions);
    entries[2].crc ^= 1;
    refused(&maps::zip(&entries), &["entry 'Left Projector/warp.pfm'", "can't be read"]);

    let mut wrong = halves(f32::NAN);
    wrong[1].warp = wrong[1].warp[..5000].to_vec();
    refused(&archive("2d", &wrong), &["entry 'right/warp.pfm'", "truncated"]);
}

/// So many zeros in a 158th of the bytes.
fn bomb(name: &str, bytes: u32) -> Entry {
    Entry { packed: packed_zeros(bytes), method: 8, bytes, ..Entry::new(name, &[]) }
}

/// RFC 1951, 3.2.6: a zero, then runs of 258 from one byte before.
fn packed_zeros(bytes: u32) -> Vec<u8> {
    // From the lowest bit of each byte on: last block, fixed codes, the literal 0.
    let mut bits: Vec<bool> = vec![true, true, false];
    let code = |bits: &mut Vec<bool>, value: u32, count: u32| {
        bits.extend((0..count).rev().map(|i| value >> i & 1 == 1));
    };
    code(&mut bits, 0b0011_0000, 8);
    for _ in 0..(bytes - 1) / 258 {
        code(&mut bits, 0b1100_0101, 8);
        code(&mut bits, 0, 5);
    }
    code(&mut bits, 0, 7);
    let byte = |bits: &[bool]| bits.iter().rev().fold(0u8, |sum, &bit| sum << 1 | u8::from(bit));
    bits.chunks(8).map(byte).collect()
}

/// Entries that would inflate to more than they may: some state their size, others lie about it.
#[test]
fn bombs_end_before_they_are_memory() {
    let regions = halves(f32::NAN);
    let mut entries = maps::mpcdi_entries("2d", [200, 100], &regions);
    entries[0] = bomb("mpcdi.xml", 64 << 20);
    refused(&maps::zip(&entries), &["entry 'mpcdi.xml'", "67108864 bytes or more"]);
    entries[0].bytes = 100;
    refused(&maps::zip(&entries), &["entry 'mpcdi.xml'"]);
    let mut entries = maps::mpcdi_entries("2d", [200, 100], &regions);
    entries[2].bytes = u32::MAX;
    refused(&maps::zip(&entries), &["entry 'Left Projector/warp.pfm'", "4294967295 bytes"]);
}
