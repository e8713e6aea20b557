//! Random walls of every shape: what a wall file can say, in the order in which it is read.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DQuat, DVec2, DVec3, UVec2};
use polyptych_wall::camera::Camera;
use polyptych_wall::channel_calibration::{
    BitDepth, BlendWidths, ChannelCalibration, ColorCorrection, ControlGrid, TransferFunction,
};
use polyptych_wall::projector::Projector;
use polyptych_wall::surface::{Cylinder, Plane, Sphere, Surface};
use polyptych_wall::{
    Bezel, BlendConfig, CalibrationFile, CalibrationFileKind, Channel, ChannelKind, DeadlinePolicy,
    Eye, FrustumMode, MemoryBudget, Orientation, Ramps, Screen, ShadowFilter, StereoPacking,
    SyncPolicy, Wall,
};
use proptest::prelude::*;

/// A screen before the eye or around it, turned any way that faces it.
#[derive(Clone, Debug)]
struct Seed {
    form: u8,
    direction: [f64; 3],
    distance_m: f64,
    size_m: [f64; 2],
    degrees: [f64; 4],
    own: bool,
    columns: Vec<u32>,
    rows: Vec<u32>,
    gap: [u32; 2],
    bezel: bool,
    overlap: bool,
    both_eyes: bool,
    adjusts: Vec<Adjust>,
}

/// The adjustments to make, by numbers from 0 to 1.
#[derive(Clone, Debug)]
struct Adjust {
    kinds: u32,
    shares: [f64; 9],
    cover: u8,
}

fn seed() -> impl Strategy<Value = Seed> {
    let tiles = || prop::collection::vec(1u32..700, 1..5);
    let adjust = (any::<u32>(), prop::array::uniform9(0.0..1.0), 0u8..8)
        .prop_map(|(kinds, shares, cover)| Adjust { kinds, shares, cover });
    (
        (0u8..6, prop::array::uniform3(-1.0..1.0), 0.01..100.0),
        prop::array::uniform2(0.01..50.0),
        prop::array::uniform4(1.0..89.0),
        (tiles(), tiles(), prop::array::uniform2(0u32..20)),
        prop::array::uniform4(any::<bool>()),
        prop::collection::vec(adjust, 1..4),
    )
        .prop_map(|(place, size_m, degrees, (columns, rows, gap), flags, adjusts)| {
            let (form, direction, distance_m) = place;
            let [own, bezel, overlap, both_eyes] = flags;
            // A mesh's metres only its file knows; a bezel needs them.
            let bezel = bezel && form != 3 && !overlap;
            let both_eyes = both_eyes && !bezel;
            Seed {
                form,
                direction,
                distance_m,
                size_m,
                degrees,
                own,
                columns,
                rows,
                gap,
                bezel,
                overlap,
                both_eyes,
                adjusts,
            }
        })
}

/// Offsets of tiles along one side, and the side's length.
fn offsets(tiles: &[u32], gap: u32, overlap: bool) -> (Vec<u32>, u32) {
    let (mut at, mut end) = (0, 0);
    let offsets = tiles
        .iter()
        .map(|tile| {
            let begin = at;
            end = end.max(begin + tile);
            at = if overlap { begin + tile - gap.min(tile - 1) } else { begin + tile + gap };
            begin
        })
        .collect();
    (offsets, end)
}

fn surface(wall: &mut Wall, seed: &Seed, index: usize) -> Surface {
    let normal = DVec3::from(seed.direction).try_normalize().unwrap_or(DVec3::Z);
    let right = normal.any_orthonormal_vector();
    let up = normal.cross(right);
    let [a, b, c, d] = seed.degrees;
    // The eye stands within the curved ones.
    let center = wall.eye + DVec3::from(seed.direction) * seed.distance_m * 0.4;
    let rotation = match seed.gap[0] % 3 {
        0 => DQuat::IDENTITY,
        1 => DQuat::from_rotation_y(FRAC_PI_2),
        _ => DQuat::from_rotation_arc(DVec3::Z, normal),
    };
    match seed.form {
        1 => Surface::Cylinder(Cylinder {
            center,
            rotation,
            radius_m: seed.distance_m,
            azimuth_rad: [(-a * 2.0).to_radians(), (b * 2.0).to_radians()],
            height_m: [-c, d],
        }),
        2 => Surface::Sphere(Sphere {
            center,
            rotation,
            radius_m: seed.distance_m,
            azimuth_rad: [(-a).to_radians(), b.to_radians()],
            elevation_rad: [(-c).to_radians(), d.to_radians()],
        }),
        3 => Surface::Mesh(file(wall, CalibrationFileKind::ScreenMesh, index)),
        _ => {
            let half = DVec2::from(seed.size_m) / 2.0;
            let center = wall.eye - normal * seed.distance_m;
            Surface::Plane(Plane {
                lower_left: center - right * half.x - up * half.y,
                lower_right: center + right * half.x - up * half.y,
                upper_left: center - right * half.x + up * half.y,
            })
        }
    }
}

/// The index of a file, which may be named several times.
fn file(wall: &mut Wall, kind: CalibrationFileKind, number: usize) -> u16 {
    let path = format!("maps/{}.file", number % 3);
    let known = wall.files.iter().position(|file| file.path == path && file.kind == kind);
    known.unwrap_or_else(|| {
        wall.files.push(CalibrationFile {
            path,
            kind,
            blob: None,
            is_for_one_eye: false,
            front: Vec::new(),
        });
        wall.files.len() - 1
    }) as u16
}

/// The screen of a seed; its channels come when all screens are there, as a wall file's files are
/// counted.
fn add_screen(wall: &mut Wall, seed: &mut Seed) {
    let index = wall.screens.len();
    let surface = surface(wall, seed, index);
    let mut screen = Screen::new(&format!("screen.{index}"), surface, UVec2::ONE);
    if seed.bezel {
        // Equal tiles, and the metres that these pixels of bezel are.
        seed.columns = vec![seed.columns[0]; seed.columns.len()];
        seed.rows = vec![seed.rows[0]; seed.rows.len()];
        seed.gap = seed.gap.map(|gap| gap / 2 * 2);
    }
    let (_, width) = offsets(&seed.columns, seed.gap[0], seed.overlap);
    let (_, height) = offsets(&seed.rows, seed.gap[1], seed.overlap);
    screen.canvas = UVec2::new(width, height);
    let pixels = UVec2::from(seed.gap);
    let asked_m = screen.size_m() / screen.canvas.as_dvec2() * pixels.as_dvec2();
    screen.bezel = (seed.bezel && asked_m != DVec2::ZERO).then_some(Bezel { asked_m, pixels });
    wall.screens.push(screen);
}

fn add_channels(wall: &mut Wall, seed: &Seed, index: usize) {
    let (xs, _) = offsets(&seed.columns, seed.gap[0], seed.overlap);
    let (ys, _) = offsets(&seed.rows, seed.gap[1], seed.overlap);
    let eyes: &[Eye] = if seed.both_eyes { &[Eye::Left, Eye::Right] } else { &[Eye::Center] };
    for eye in eyes {
        for (y, row) in ys.iter().zip(&seed.rows) {
            for (x, column) in xs.iter().zip(&seed.columns) {
                let at = wall.channels.len();
                let (origin, size) = (UVec2::new(*x, *y), UVec2::new(*column, *row));
                let mut channel = Channel {
                    server: format!("server_{}", at / 3),
                    monitor: (at % 4 == 1).then(|| format!("DP-{at}")),
                    projection: if seed.own { FrustumMode::Own } else { FrustumMode::Shared },
                    ..Channel::tile(&format!("c-{}.{at}", at % 2), index as u16, origin, size)
                };
                adjust(wall, &mut channel, &seed.adjusts[at % seed.adjusts.len()], *eye);
                if !seed.bezel {
                    cover(wall, &mut channel, &seed.adjusts[at % seed.adjusts.len()]);
                }
                wall.channels.push(channel);
            }
        }
    }
}

fn adjust(wall: &mut Wall, channel: &mut Channel, adjust: &Adjust, eye: Eye) {
    let asks = |bit: u32| adjust.kinds & (1 << bit) != 0;
    let size = channel.size.as_dvec2();
    let [a, b, c, d, e, f, g, h, i] = adjust.shares;
    let mut found = ChannelCalibration { eye, ..ChannelCalibration::default() };
    found.turn = [Orientation::None, Orientation::Left, Orientation::Right, Orientation::Half]
        [(adjust.kinds % 4) as usize];
    found.mirror = asks(2);
    if asks(3) && eye == Eye::Center {
        let packings =
            [StereoPacking::SideBySide, StereoPacking::TopBottom, StereoPacking::Anaglyph];
        found.packing = packings[(a * 3.0) as usize];
    }
    if asks(4) {
        let corners = [(a, b), (c, d), (e, f), (g, h)];
        found.pin = corners.map(|(x, y)| DVec2::new(x - 0.5, y - 0.5) * size * 0.1);
    }
    if asks(5) {
        let points = UVec2::new(2 + (a * 4.0) as u32, 2 + (b * 4.0) as u32);
        let step = size / points.as_dvec2() * 0.05;
        let moves = (0..points.element_product()).map(|at| {
            let at = f64::from(at);
            DVec2::new((at * c * 9.0).sin(), (at * d * 9.0).cos()) * step
        });
        found.bend = Some(ControlGrid { points, moves: moves.collect() });
    }
    if asks(6) {
        let some = |share: f64, side: f64| (share > 0.3).then_some(share * side);
        found.edges = BlendWidths {
            left: some(a, size.x),
            right: some(b, size.x),
            top: some(c, size.y),
            bottom: some(d, size.y),
        };
    }
    if asks(7) {
        found.color.matrix = DMat3::from_cols_array(&adjust.shares.map(|share| share * 2.0 - 0.5));
    }
    found.bits = if asks(12) { BitDepth::Ten } else { BitDepth::Eight };
    found.color = ColorCorrection {
        gain: if asks(8) { DVec3::new(a, b, if asks(9) { a } else { c }) } else { DVec3::ONE },
        curve: match (asks(10), asks(11)) {
            (false, _) => TransferFunction::Srgb,
            (true, false) => TransferFunction::Gamma(DVec3::new(1.0 + g, 1.0 + h, 1.0 + i)),
            (true, true) => {
                let middle = DVec3::new(g, h, if asks(9) { g } else { i });
                TransferFunction::Measured(vec![DVec3::ZERO, middle, DVec3::ONE])
            }
        },
        leak: asks(14).then(|| DVec3::new(a, b, if asks(9) { a } else { c }) * 0.1),
        ..found.color
    };
    let number = adjust.kinds as usize >> 16;
    channel.adjustment = found;
    // A warp file says what is covered.
    if adjust.cover == 0 {
        channel.adjustment.warp = Some(file(wall, CalibrationFileKind::Warp, number));
        (channel.cover, channel.projection) = (ChannelKind::Map, FrustumMode::Own);
    }
    let mut mask = |is_asked: bool, kind| is_asked.then(|| file(wall, kind, number));
    channel.adjustment.alpha = mask(asks(12), CalibrationFileKind::Alpha);
    channel.adjustment.beta = mask(asks(13), CalibrationFileKind::Beta);
    let adjustment = &mut channel.adjustment;
    if asks(13) && adjustment.alpha.is_some() && adjustment.edges == BlendWidths::default() {
        adjustment.ramps = Ramps::Alpha;
    }
}

/// Makes some channels a projector that stands at the eye and looks at the screen's middle.
fn cover(wall: &Wall, channel: &mut Channel, adjust: &Adjust) {
    if adjust.cover != 1 {
        return;
    }
    let screen = wall.screen_of(channel);
    let middle = screen.display_from_canvas(screen.canvas.as_dvec2() / 2.0).unwrap_or(DVec3::ZERO);
    let [a, b, c, d, ..] = adjust.shares.map(|share| share + 0.01);
    let projector = Projector {
        position: wall.eye,
        rotation: Camera::look_at(wall.eye, middle, DVec3::Y).rotation,
        tangents: [-a, b, -c, d],
    };
    channel.cover = ChannelKind::Projector(Box::new(projector));
    channel.projection = FrustumMode::Own;
}

fn budget() -> impl Strategy<Value = MemoryBudget> {
    let mib = |least| prop::option::of(least..=1u32 << 20);
    (mib(1), mib(64)).prop_map(|(gpu_mib, host_mib)| MemoryBudget { gpu_mib, host_mib })
}

fn shadows() -> impl Strategy<Value = ShadowFilter> {
    use ShadowFilter::{ContactHardening, Hard, Off, Soft};
    prop::sample::select(&[Off, Hard, Soft, ContactHardening][..])
}

/// A wall that a file can say.
pub(crate) fn wall() -> impl Strategy<Value = Wall> {
    (
        prop::collection::vec(seed(), 1..4),
        prop::array::uniform3(-100.0..100.0),
        (1e-6..1e3, any::<bool>(), 20u32..=60_000, "[ -~é]{1,12}"),
        (1.0..1e9, 1u32..=60_000, 1u32..=60_000, (0u32..=1, 0u32..=100, budget())),
        (0.0..1.0, 0.1..5.0, 0.0..0.1, any::<bool>(), shadows()),
    )
        .prop_map(|(mut seeds, eye, (near_m, many, heartbeat_ms, folder), deadline, light)| {
            let (factor, a, b, (pipeline_depth, swap_lead_ms, budget)) = deadline;
            let (eye_separation_m, exponent, leak, dither, shadows) = light;
            let mut wall = Wall {
                eye: DVec3::from(eye),
                eye_separation_m,
                near_m,
                samples: if many { 4 } else { 1 },
                blend: BlendConfig { exponent, leak },
                dither,
                shadows,
                deadline: DeadlinePolicy { factor, min_ms: a.min(b), max_ms: a.max(b) },
                sync: SyncPolicy { pipeline_depth, swap_lead_ms },
                heartbeat_ms,
                listen: "[::]:1".into(),
                budget,
                stores: vec![],
                scenes: vec![format!("/x{}", folder.replace(['/', '.'], ""))],
                ..Wall::new("random-wall", vec![], vec![])
            };
            for seed in &mut seeds {
                add_screen(&mut wall, seed);
            }
            for (index, seed) in seeds.iter().enumerate() {
                add_channels(&mut wall, seed, index);
            }
            wall
        })
}
