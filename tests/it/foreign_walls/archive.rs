//! MPCDI archives of one region in f64, by the standard (VESA, *MPCDI 2.0*).

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use glam::{DVec2, DVec3};

use super::reading::{FloatMap, Reading, float_map, middles};
use super::waves::Seat;

/// The files of an archive, by their names.
pub struct Archive {
    pub entries: BTreeMap<String, Vec<u8>>,
}

impl Archive {
    pub fn read(path: &Path) -> Self {
        let file = std::fs::File::open(path).expect("opened");
        let mut zip = zip::ZipArchive::new(file).expect("an archive");
        let mut entries = BTreeMap::new();
        for index in 0..zip.len() {
            let mut entry = zip.by_index(index).expect("an entry");
            let mut bytes = Vec::new();
            entry.read_to_end(&mut bytes).expect("unpacked");
            let name = entry.name().expect("a name").into_owned();
            entries.insert(name, bytes);
        }
        Self { entries }
    }

    /// Returns the reading of its only region on a screen, of which profile 2d says nothing, with
    /// light P·α·(1 − β) + β (§2.4).
    pub fn reading(&self, seat: &Seat) -> Reading {
        let text = std::str::from_utf8(&self.entries["mpcdi.xml"]).expect("text");
        let document = roxmltree::Document::parse(text).expect("XML");
        let node = |name: &str| {
            let found = document.descendants().find(|node| node.has_tag_name(name));
            found.unwrap_or_else(|| panic!("no {name}"))
        };
        let region = node("region");
        let attribute = |name: &str| {
            let text = region.attribute(name).unwrap_or_else(|| panic!("no {name}"));
            text.parse::<f64>().expect("a number")
        };
        let size = ["Xresolution", "Yresolution"].map(|name| attribute(name) as u32);
        let child = |node: roxmltree::Node<'_, '_>, name: &str| {
            let child = node.children().find(|child| child.has_tag_name(name));
            child.and_then(|child| Some(child.text()?.trim().to_owned()))
        };
        let number = |of: &str, name: &str| {
            let text = child(node(of), name).unwrap_or_else(|| panic!("no {name}"));
            text.parse::<f64>().expect("a number")
        };
        let file = |of: &str| &self.entries[&child(node(of), "path").expect("a path")];
        let frustum = || Frustum::new(|name| number("frustum", name));
        let warp = || float_map(file("geometryWarpFile"));
        let points: Vec<Option<DVec3>> = match node("MPCDI").attribute("profile") {
            // A part of the buffer, from its lower left; u to the right and v up in it.
            Some("2d") => {
                let (low, part) = (
                    DVec2::new(attribute("x"), attribute("y")),
                    DVec2::new(attribute("xsize"), attribute("ysize")),
                );
                let warp = warp();
                let point = |[u, v, _]: [f64; 3]| {
                    let place = low + DVec2::new(u, v) * part;
                    seat.point(place.x, place.y)
                };
                middles(size).map(|at| warp.at(at).map(point)).collect()
            }
            // A place in the picture of the frustum, whose eye is the viewer's.
            Some("3d") => {
                let (warp, frustum) = (warp(), frustum());
                let point = |[u, v, _]: [f64; 3]| seat.eye() + frustum.ray(u, v);
                middles(size).map(|at| warp.at(at).map(point)).collect()
            }
            // A projector; what its light meets is the screen.
            Some("sl") => {
                let axis = |name: &str| {
                    DVec3::from_array(
                        ["x", "y", "z"].map(|end| number("coordinateFrame", &[name, end].concat())),
                    )
                };
                // Yaw turns about the way down, pitch about the way right, roll ahead (§2.2.2).
                let from = axis("pos");
                let lens = DVec3::new(
                    from.dot(axis("pitch")),
                    -from.dot(axis("yaw")),
                    -from.dot(axis("roll")),
                );
                let frustum = frustum();
                let met = |at: DVec2| Some(seat.met(lens, frustum.ray(at.x, 1.0 - at.y)));
                middles(size).map(met).collect()
            }
            other => panic!("profile {other:?}"),
        };
        let [alpha, beta] = ["alphaMap", "betaMap"].map(|name| {
            let gamma = child(node(name), "gammaEmbedded").map(|text| text.parse().expect("gamma"));
            mask(file(name), gamma.unwrap_or(1.0))
        });
        let light = middles(size).map(|at| [&alpha, &beta].map(|mask| shade(mask, at))).collect();
        Reading { size, points, light }
    }
}

/// A viewing pyramid with its own axes in display space.
struct Frustum {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Tangents of its edges: left, right, down and up.
    edges: [f64; 4],
}

impl Frustum {
    /// Yaw turns to the right, pitch up and roll clockwise, in degrees, one after the other.
    fn new(number: impl Fn(&str) -> f64) -> Self {
        let [yaw, pitch, roll] = ["yaw", "pitch", "roll"].map(|name| number(name).to_radians());
        let forward = DVec3::new(yaw.sin() * pitch.cos(), pitch.sin(), -yaw.cos() * pitch.cos());
        let level = DVec3::new(yaw.cos(), 0.0, yaw.sin());
        let upright = level.cross(forward);
        Self {
            forward,
            right: level * roll.cos() - upright * roll.sin(),
            up: upright * roll.cos() + level * roll.sin(),
            edges: ["leftAngle", "rightAngle", "downAngle", "upAngle"]
                .map(|name| number(name).to_radians().tan()),
        }
    }

    /// The ray through a place of its picture, from 0 to 1, to the right and up.
    fn ray(&self, u: f64, v: f64) -> DVec3 {
        let [left, right, down, up] = self.edges;
        self.forward + self.right * (left + (right - left) * u) + self.up * (down + (up - down) * v)
    }
}

/// A PNG of 8 bits as linear light.
fn mask(bytes: &[u8], gamma: f64) -> FloatMap {
    let picture = image::load_from_memory(bytes).expect("a PNG").into_rgb8();
    let value = |pixel: &image::Rgb<u8>| pixel.0.map(|code| (f64::from(code) / 255.0).powf(gamma));
    FloatMap {
        size: [picture.width() as usize, picture.height() as usize],
        values: picture.pixels().map(value).collect(),
    }
}

/// The light of a mask that is stretched over its region (§3.7).
fn shade(mask: &FloatMap, place: DVec2) -> DVec3 {
    let size = DVec2::new(mask.size[0] as f64, mask.size[1] as f64);
    let inside = place.clamp(0.5 / size, 1.0 - 0.5 / size);
    DVec3::from_array(mask.at(inside).expect("numbers"))
}
