//! Random meshes through the baker, the check of a wall, and what servers prepare: screens cut
//! into random tiles, and warps around the border of a picture. Their points are compared with the
//! OBJ's own numbers in f64.

use std::fmt::Write as _;
use std::sync::Arc;

use glam::{DMat2, DVec2, DVec3};
use polyptych_files::blob::BlobStore;
use polyptych_wall::blend::{BlendModel, ChannelMasks, blend_map};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::surface::Plane;
use polyptych_wall::wall_geometry::{ResolvedWall, WallGeometry};
use polyptych_wall::warp::CalibrationMap;
use polyptych_wall::{
    CalibrationFile, CalibrationFileKind, Channel, ChannelKind, Screen, Surface, Wall,
    warp_mesh as wall_mesh,
};
use proptest::prelude::*;

use super::*;

/// Maximum error of a covered pixel's point, in pixels.
const ERROR_MAX_PX: f64 = 0.1;

/// Pixels from the rim of a mesh within which rounding decides what is lit.
const RIM_PX: f64 = 0.05;

/// Pixels of a picture that are looked at, across and down.
const LOOKS: u32 = 16;

/// A fault that a mesh has on purpose.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    /// A number of a vertex is none.
    NotANumber,
    /// Two neighbours have changed places.
    Folded,
    /// A row of vertices lies on the next one.
    Flat,
    /// A vertex is so far away that no wall is.
    Far,
}

/// A mesh as an OBJ has it.
#[derive(Clone, Debug)]
struct Obj {
    cells: [usize; 2],
    points: Vec<DVec3>,
    /// v up.
    uvs: Vec<DVec2>,
    fault: Fault,
}

impl Obj {
    fn text(&self) -> String {
        let mut text = String::new();
        for (point, uv) in self.points.iter().zip(&self.uvs) {
            let _ = writeln!(text, "v {} {} {}", point.x, point.y, point.z);
            let _ = writeln!(text, "vt {} {}", uv.x, uv.y);
        }
        for corners in self.triangles() {
            let [a, b, c] = corners.map(|corner| corner + 1);
            let _ = writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}");
        }
        text
    }

    fn triangles(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let across = self.cells[0] + 1;
        let cells = (0..self.cells[0] * self.cells[1])
            .map(move |cell| cell / self.cells[0] * across + cell % self.cells[0]);
        cells
            .flat_map(move |at| [[at, at + 1, at + across], [at + 1, at + across + 1, at + across]])
    }

    /// The point at a place of the picture from its upper left, and by how much it moves across
    /// and down the picture.
    fn at(&self, place: DVec2) -> Option<(DVec3, [DVec3; 2])> {
        self.triangles().find_map(|corners| {
            let place_of = |corner: usize| DVec2::new(self.uvs[corner].x, 1.0 - self.uvs[corner].y);
            let [p, q, r] = corners.map(place_of);
            let [a, b, c] = corners.map(|corner| self.points[corner]);
            let (to_q, to_r, to) = (q - p, r - p, place - p);
            let area = to_q.perp_dot(to_r);
            let (s, t) = (to.perp_dot(to_r) / area, to_q.perp_dot(to) / area);
            let slope =
                |by: DVec2| ((b - a) * by.perp_dot(to_r) + (c - a) * to_q.perp_dot(by)) / area;
            (s >= 0.0 && t >= 0.0 && s + t <= 1.0)
                .then(|| (a + (b - a) * s + (c - a) * t, [slope(DVec2::X), slope(DVec2::Y)]))
        })
    }
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        4 => Just(Fault::None),
        1 => Just(Fault::NotANumber),
        1 => Just(Fault::Folded),
        1 => Just(Fault::Flat),
        1 => Just(Fault::Far),
    ]
}

/// A hill before the viewer. Its places lie between two corners, are moved unevenly, and rounded
/// as programs print them.
fn obj(
    low: impl Strategy<Value = (f64, f64)>,
    high: impl Strategy<Value = (f64, f64)>,
) -> impl Strategy<Value = Obj> {
    let moves = prop::collection::vec((-0.2f64..0.2, -0.2f64..0.2, -0.01f64..0.01), 100);
    let rounding = prop::sample::select(vec![1e-5, 1e-3, 1e-12]);
    let kind = (fault(), any::<prop::sample::Index>(), rounding);
    ((1usize..9, 1usize..7), low, high, moves, kind).prop_map(
        |((across, down), low, high, moves, (fault, index, step))| {
            let (low, high) = (DVec2::from(low), DVec2::from(high));
            let mut obj = Obj { cells: [across, down], points: vec![], uvs: vec![], fault };
            for (at, by) in (0..(across + 1) * (down + 1)).zip(moves) {
                let cell = DVec2::new((at % (across + 1)) as f64, (at / (across + 1)) as f64);
                let cell = cell + DVec2::new(by.0, by.1);
                let place = low + (high - low) * cell / DVec2::new(across as f64, down as f64);
                let uv = ((DVec2::new(place.x, 1.0 - place.y)) / step).round() * step;
                obj.uvs.push(uv);
                obj.points.push(DVec3::new(uv.x * 2.0 - 1.0, uv.y - 0.5, by.2 - 2.0));
            }
            let at = index.index(obj.uvs.len());
            match fault {
                Fault::None => {}
                Fault::NotANumber => obj.points[at].y = f64::NAN,
                Fault::Folded => obj.uvs.swap(at - at % (across + 1), at - at % (across + 1) + 1),
                Fault::Flat => {
                    for column in 0..=across {
                        obj.uvs[column] = obj.uvs[column + across + 1];
                    }
                }
                Fault::Far => obj.points[at].x = 1e7,
            }
            obj
        },
    )
}

/// Steps from edge to edge of tiles, and of the gaps between them, in pixels.
fn cuts() -> impl Strategy<Value = Vec<(u32, u32)>> {
    prop::collection::vec((1u32..90, 0u32..20), 1..6)
}

/// From where to where tiles reach along a side, within it.
fn spans(cuts: &[(u32, u32)], side: u32) -> Vec<[u32; 2]> {
    let mut from = 0;
    let mut spans = Vec::new();
    for (length, gap) in cuts {
        let to = (from + length).min(side);
        if to > from {
            spans.push([from, to]);
        }
        from = to + gap;
    }
    spans
}

/// A wall with the file of a mesh, as the baker leaves it.
fn wall_of(
    obj: &Obj,
    place: &MapFixture,
    mut wall: Wall,
    kind: CalibrationFileKind,
) -> Result<Wall, String> {
    let used_as = if kind == CalibrationFileKind::ScreenMesh { MapUse::ScreenMesh } else { WARP };
    let path = place.write("a.obj", obj.text().as_bytes());
    let baked = bake_map(&path, used_as, &place.store, &AtomicBool::new(false));
    let baked = baked.map_err(|error| error.to_string())?;
    wall.files.push(CalibrationFile {
        path: "a.obj".into(),
        kind,
        blob: Some(baked.blob),
        is_for_one_eye: baked.is_for_one_eye,
        front: baked.front,
    });
    Ok(wall)
}

fn screen(canvas: UVec2, surface: Option<Surface>) -> Screen {
    let plane = Plane::upright(DVec3::new(0.0, 0.0, -2.0), DVec2::new(2.0, 1.0));
    Screen::new("s", surface.unwrap_or(Surface::Plane(plane)), canvas)
}

/// The files of a wall as the baker left them.
fn maps_of(wall: &Wall, blobs: &BlobStore) -> CalibrationMaps {
    let read = |hash| {
        let bytes = blobs.read(hash).map_err(|error| error.to_string())?.ok_or("gone")?;
        CalibrationMap::decode(&bytes).map(Arc::new)
    };
    CalibrationMaps::load(wall, read).expect("the baker's own")
}

/// Returns how many pixels an error of a point in metres is, where the next pixels across and down
/// are so far away: in units of the nearer of them, or along both, whichever is less. Pixels of a
/// picture of one column may be a hundred times as wide as high.
fn pixels_off(error: DVec3, [across, down]: [DVec3; 2]) -> f64 {
    let nearest = error.length() / across.length().min(down.length());
    let mixed = across.dot(down);
    let gram = DMat2::from_cols(
        DVec2::new(across.length_squared(), mixed),
        DVec2::new(mixed, down.length_squared()),
    );
    // Beyond all numbers where both directions are one.
    let along = gram.inverse() * DVec2::new(error.dot(across), error.dot(down));
    let rest = error - across * along.x - down * along.y;
    nearest.min(along.length() + rest.length() / across.length().min(down.length()))
}

/// Returns whether an error names a channel.
fn names(line: &str, channel: &Channel) -> bool {
    line.contains(&format!("channel {} ", channel.name))
}

/// Returns whether the OBJ has nothing where the middles of a channel's pixels are.
fn is_bare(obj: &Obj, channel: &Channel, kind: CalibrationFileKind, picture: UVec2) -> bool {
    let is_whole = kind == CalibrationFileKind::ScreenMesh;
    let origin = if is_whole { channel.origin } else { UVec2::ZERO };
    let mut pixels = (0..channel.size.y).flat_map(|y| (0..channel.size.x).map(move |x| [x, y]));
    pixels.all(|pixel| {
        let middle = (origin + UVec2::from(pixel)).as_dvec2() + 0.5;
        obj.at(middle / picture.as_dvec2()).is_none()
    })
}

/// That a wall of this mesh is refused with a reason or can be prepared, and shows then at each
/// pixel what the OBJ has there. `picture` is what its places are measured in.
fn check(
    obj: &Obj,
    wall: Wall,
    kind: CalibrationFileKind,
    picture: UVec2,
) -> Result<(), TestCaseError> {
    let place = MapFixture::new();
    let wall = match wall_of(obj, &place, wall, kind) {
        Ok(wall) => wall,
        Err(line) => {
            prop_assert!(obj.fault != Fault::None, "{line}");
            prop_assert!(line.contains("a.obj: ") && line.contains("would be right"), "{line}");
            return Ok(());
        }
    };
    prop_assert!(obj.fault != Fault::NotANumber && obj.fault != Fault::Far, "taken");
    let blobs = BlobStore::new(place.folder.path().join("store/blobs"));
    let maps = maps_of(&wall, &blobs);
    let shapes = WallGeometry::new(&wall, &maps);
    let shaped = ResolvedWall { wall: &wall, shapes: &shapes };
    let accepted = shaped.check_files(&maps);
    let size = picture.as_dvec2();
    let mut dark = Vec::new();
    for (id, channel) in wall.channel_ids().zip(&wall.channels) {
        let mesh = match shaped.drawn_mesh(&maps, id) {
            Ok(mesh) => mesh,
            Err(line) => {
                prop_assert!(accepted.is_err(), "{} was accepted: {line}", channel.name);
                dark.push(channel.name.clone());
                wall_mesh::WarpMesh::default()
            }
        };
        if accepted.is_ok() {
            // What a server prepares beside the mesh.
            let _ = blend_map(shaped, id, &ChannelMasks::default());
        }
        // The OBJ's triangles lie over each other: which of them is shown is chance.
        if obj.fault == Fault::Folded {
            continue;
        }
        let origin =
            if kind == CalibrationFileKind::ScreenMesh { channel.origin } else { UVec2::ZERO };
        for index in 0..LOOKS * LOOKS {
            let at = UVec2::new(index % LOOKS, index / LOOKS).as_dvec2() + DVec2::new(0.37, 0.61);
            let pixel = at / f64::from(LOOKS) * channel.size.as_dvec2();
            let due_at = |pixel: DVec2| {
                let place = (pixel + origin.as_dvec2()) / size;
                let is_on = place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all();
                obj.at(place).filter(|_| is_on)
            };
            match (due_at(pixel), mesh.point_at(pixel)) {
                (Some((due, slope)), Some(found)) => {
                    let off = pixels_off(found - due, [slope[0] / size.x, slope[1] / size.y]);
                    prop_assert!(off <= ERROR_MAX_PX, "{pixel}: {found}, not {due}");
                }
                (None, None) => {}
                (due, found) => {
                    let steps = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y];
                    let beside = steps.map(|by| due_at(pixel + by * RIM_PX).is_some());
                    let is_rim = beside.contains(&true) && beside.contains(&false);
                    prop_assert!(is_rim, "{} at {pixel}: {found:?}, not {due:?}", channel.name);
                }
            }
        }
    }
    match accepted {
        Ok(()) => {
            BlendModel::new(shaped);
        }
        Err(line) => {
            let parts = ["a.obj", "cannot be drawn: ", "; "];
            prop_assert!(parts.iter().all(|part| line.contains(part)), "{line}");
            // They do not reach everywhere; a sliver between middles of pixels is no picture.
            let has_sliver =
                wall.channels.iter().any(|of| names(&line, of) && is_bare(obj, of, kind, picture));
            prop_assert!(!dark.is_empty() || obj.fault != Fault::None || has_sliver, "{line}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn screens_of_random_meshes_in_random_tiles_are_drawn_or_refused(
        obj in obj((-0.3f64..0.3, -0.3f64..0.3), (0.7f64..1.4, 0.7f64..1.4)),
        columns in cuts(),
        rows in cuts(),
    ) {
        let canvas = UVec2::new(331, 197);
        let mut channels = Vec::new();
        for [top, bottom] in spans(&rows, canvas.y) {
            for [left, right] in spans(&columns, canvas.x) {
                let (from, to) = (UVec2::new(left, top), UVec2::new(right, bottom));
                let name = format!("tile-{left}-{top}");
                channels.push(Channel::tile(&name, 0, from, to - from));
            }
        }
        let wall = Wall::new("w", vec![screen(canvas, Some(Surface::Mesh(0)))], channels);
        check(&obj, wall, CalibrationFileKind::ScreenMesh, canvas)?;
    }

    #[test]
    fn random_warps_around_the_border_of_a_picture_are_drawn_or_refused(
        obj in obj((-3.0f64..0.5, -3.0f64..0.5), (0.6f64..4.0, 0.6f64..4.0)),
        size in (1u32..200, 1u32..200),
    ) {
        let size = UVec2::from(size);
        let mut channel = Channel::tile("c", 0, UVec2::ZERO, size);
        channel.cover = ChannelKind::Map;
        channel.adjustment.warp = Some(0);
        let wall = Wall::new("w", vec![screen(UVec2::new(320, 200), None)], vec![channel]);
        check(&obj, wall, CalibrationFileKind::Warp, size)?;
    }
}
