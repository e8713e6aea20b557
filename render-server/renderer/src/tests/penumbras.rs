//! Shadows of lights of some size, against rays that are cast from each pixel to all over the
//! light, in f64.

use glam::{DAffine3, DQuat, DVec2, DVec3, Vec3};
use polyptych_scene::ToneMapper;
use polyptych_wall::ShadowFilter;

use super::harness::{SceneFixture, look, pixel};
use super::lamp_shadows::{Lamp, Room, SIZE, chamber_views, ray};
use super::shadows::{PENUMBRAS, Stage, cube, entry, grey, sun, toward};
use crate::ViewDesc;
use crate::lamp_map::LAMP_RADIUS;
use crate::scene::Bounds;
use crate::shadow_cascades::{LightBasis, SUN_TANGENT};

/// Rays from each pixel.
const RAYS: u32 = 400;

/// What shines into a room.
#[derive(Clone, Copy)]
enum Source {
    /// By the direction towards it.
    Sun(DVec3),
    Lamp(Lamp),
}

impl Source {
    fn stage(&self, room: &Room, filter: ShadowFilter) -> Stage {
        let fixture = match self {
            Self::Lamp(lamp) => room.stage(std::slice::from_ref(lamp)),
            // Its ceiling would keep the sun out.
            Self::Sun(toward) => on_floor(&room.boxes, *toward),
        };
        Stage::new(fixture.build(), SIZE, filter)
    }

    /// The way from a place to a point of the light, at a place of the unit disc.
    fn way(&self, from: DVec3, disc: DVec2) -> DVec3 {
        let across = |way: DVec3, radius: f64| {
            let LightBasis { right, up, .. } = LightBasis::new(way);
            way + (right * disc.x + up * disc.y) * radius
        };
        match self {
            // Out of every room.
            Self::Sun(toward) => across(*toward, SUN_TANGENT) * 1e3,
            Self::Lamp(lamp) => across(lamp.at - from, LAMP_RADIUS),
        }
    }

    /// The part of the light that reaches a place; `None` where its normal faces away.
    fn visible(&self, room: &Room, (place, normal): (DVec3, DVec3)) -> Option<f64> {
        let above = place + normal * 1e-6;
        let middle = self.way(above, DVec2::ZERO);
        if normal.dot(middle.normalize()) < 0.1 {
            return None;
        }
        let is_free = |at: u32| {
            let part = (f64::from(at) + 0.5) / f64::from(RAYS);
            let disc = DVec2::from_angle(f64::from(at) * 2.399963) * part.sqrt();
            let way = self.way(above, disc);
            !room.boxes.iter().any(|of| entry(of, above, way).is_some_and(|along| along < 1.0))
        };
        let free = (0..RAYS).filter(|at| is_free(*at)).count();
        Some(free as f64 / f64::from(RAYS))
    }
}

/// Boxes on a floor in the light of a sun.
fn on_floor(boxes: &[Bounds], toward: DVec3) -> SceneFixture {
    let mut fixture = SceneFixture::new();
    fixture.desc.sky = Vec3::ZERO;
    let solid = fixture.material(grey());
    let shape = fixture.mesh(&cube(), Some(solid));
    let floor = Bounds { min: DVec3::new(-60.0, -1.0, -60.0), max: DVec3::new(60.0, 0.0, 60.0) };
    for of in boxes.iter().chain([&floor]) {
        let (half, center) = (of.half(), of.center());
        let at = DAffine3::from_scale_rotation_translation(half, DQuat::IDENTITY, center);
        fixture.node(shape, at);
    }
    sun(&mut fixture, toward);
    fixture
}

/// Light of a code, of 1.
fn light(code: u8) -> f64 {
    let c = f64::from(code) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// The parts of the light that pixels have, as drawn and by rays.
fn parts(
    (room, source): (&Room, &Source),
    view: &ViewDesc,
    filter: ShadowFilter,
    pixels: impl Iterator<Item = [u32; 2]>,
) -> Vec<[f64; 2]> {
    let view = &ViewDesc { tone: ToneMapper::None, ..view.clone() };
    let mut stage = source.stage(room, filter);
    let drawn = stage.draw(view).0;
    let bright = stage.draw(&ViewDesc { has_shadows: false, ..view.clone() }).0;
    let part = |at: [u32; 2]| {
        let [drawn, bright] = [&drawn, &bright].map(|of| light(pixel(of, SIZE, at[0], at[1])[1]));
        let wanted = source.visible(room, room.hit(view.eye_in_world, ray(view, at)))?;
        (bright > 0.05).then_some([drawn / bright, wanted])
    };
    pixels.filter_map(part).collect()
}

/// Steps along a row between where a tenth and where nine tenths of the light are there.
fn width(parts: impl Iterator<Item = f64>) -> f64 {
    let parts: Vec<_> = parts.collect();
    let first = |level: f64| {
        let after = parts.iter().position(|part| *part >= level).unwrap();
        let [low, high] = [parts[after - 1], parts[after]];
        after as f64 - (high - level) / (high - low)
    };
    first(0.9) - first(0.1)
}

/// A sheet over one side of a floor, so high, with its edge at x = 0.
fn sheet(height: f64) -> Room {
    let walls = Bounds { min: DVec3::new(-60.0, 0.0, -60.0), max: DVec3::new(60.0, 40.0, 60.0) };
    let min = DVec3::new(-30.0, height, -30.0);
    let max = DVec3::new(0.0, height + 0.01, 30.0);
    Room { walls, boxes: vec![Bounds { min, max }] }
}

/// The width of a penumbra in pixels, drawn and by rays, on a floor seen from so high above.
fn widths(height: f64, source: &Source, from: f64) -> [f64; 2] {
    let room = sheet(height);
    let way = source.way(DVec3::ZERO, DVec2::ZERO);
    let edge = match source {
        Source::Sun(_) => DVec3::X * -(way.x / way.y * height),
        Source::Lamp(lamp) => {
            let along = lamp.at.y / (lamp.at.y - height);
            DVec3::X * (lamp.at.x - lamp.at.x * along)
        }
    };
    let view = look(edge + DVec3::new(0.0, from, 0.2 * from), edge, SIZE);
    let row = (0..SIZE[0]).map(|x| [x, SIZE[1] / 2]);
    let parts = parts((&room, source), &view, ShadowFilter::ContactHardening, row);
    assert_eq!(parts.len(), SIZE[0] as usize, "all of the row is lit by {height}");
    [0, 1].map(|of| width(parts.iter().map(|part| part[of])))
}

#[test]
fn penumbras_are_as_wide_as_those_of_the_light() {
    let mut worst = 0f64;
    let mut check = |name: String, [drawn, wanted]: [f64; 2]| {
        println!("{name}: {drawn:.1} pixels, by rays {wanted:.1}");
        assert!(wanted > 3.0, "{name}: too narrow to tell");
        worst = worst.max((drawn / wanted - 1.0).abs());
    };
    for height in [2.0, 4.0, 8.0, 16.0] {
        for elevation in [80.0, 50.0, 25.0] {
            let source = Source::Sun(toward(elevation, 90.0));
            let from = if height < 5.0 { 0.5 } else { 1.3 };
            check(format!("sun {elevation}° high, {height} m"), widths(height, &source, from));
        }
    }
    for height in [0.5, 1.0, 2.0, 3.0] {
        for across in [0.3, 2.0] {
            let at = DVec3::new(across, 4.0, 0.0);
            // Bright enough where the edge falls, at the same angle to the floor.
            let way = DVec3::new(across / (4.0 - height) * 4.0, 4.0, 0.0);
            let candela = 1.6 * way.length().powi(3) / way.y;
            for lamp in [Lamp::point(at, candela), Lamp::spot(at, at - way, 40.0, candela)] {
                let from = if height < 1.5 { 0.4 } else { 1.3 };
                let name = format!("{:?}, {across} m beside, {height} m", lamp.outer_deg);
                check(name, widths(height, &Source::Lamp(lamp), from));
            }
        }
    }
    println!("at most {:.1} % off", worst * 100.0);
    assert!(worst < 0.1);
}

/// The mean and the worst hundredth of how far the light of pixels is off.
fn errors(subject: (&Room, &Source), views: &[ViewDesc], filter: ShadowFilter) -> [f64; 2] {
    let mut errors = Vec::new();
    for view in views {
        let pixels = (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| [x, y]));
        // A ninth of them.
        let pixels = pixels.filter(|[x, y]| x % 3 == 1 && y % 3 == 1);
        let parts = parts(subject, view, filter, pixels);
        errors.extend(parts.iter().map(|[drawn, wanted]| (drawn.min(1.0) - wanted).abs()));
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 4000, "only {} pixels could be lit", errors.len());
    [errors.iter().sum::<f64>() / errors.len() as f64, errors[errors.len() * 99 / 100]]
}

#[test]
fn light_is_closer_to_that_of_rays_than_with_soft_edges() {
    let chamber = Room::chamber();
    // A tower with a balcony and a mast, so high that its penumbras are wider than pixels; the end
    // of its shadow, the middle of it, and its foot.
    let around = |at: [f64; 3], half: [f64; 3]| {
        let (at, half) = (DVec3::from(at), DVec3::from(half));
        Bounds { min: at - half, max: at + half }
    };
    let boxes = vec![
        around([0.0, 12.0, 0.0], [3.0, 12.0, 3.0]),
        around([0.0, 15.0, 4.0], [4.0, 0.2, 2.0]),
        around([1.0, 27.0, 1.0], [0.1, 3.0, 0.1]),
    ];
    let tower = Room { boxes, ..sheet(0.0) };
    let toward_sun = toward(35.0, 250.0);
    let below = |height: f64| -(toward_sun / toward_sun.y * height).with_y(0.0);
    let views: Vec<_> = [30.0, 24.0, 15.0, 3.0]
        .into_iter()
        .map(|height| look(below(height) + DVec3::new(1.0, 3.0, 5.0), below(height), SIZE))
        .collect();
    let lamp = Lamp::point(DVec3::new(0.31, -0.23, 0.17), 6.0);
    for (name, room, source, views) in [
        ("suns", &tower, Source::Sun(toward_sun), &views),
        ("lamps", &chamber, Source::Lamp(lamp), &chamber_views()),
    ] {
        let [soft, area] = PENUMBRAS.map(|filter| errors((room, &source), views, filter));
        println!("{name}: soft edges off by {soft:.4?}, penumbras by {area:.4?}");
        assert!(area[0] < 0.003 && area[0] < soft[0] * 0.25, "{name}: {area:?} and {soft:?}");
    }
}
