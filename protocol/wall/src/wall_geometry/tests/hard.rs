//! Maps as measurements make them at their worst.

use super::super::super::blend::MaskTexels;
use super::super::super::surface::Plane;
use super::super::super::warp::Mask;
use super::*;

const CANVAS: UVec2 = UVec2::new(100, 60);

/// Channels of 50 × 60 pixels on one plane of 100 × 60, each with a map of the canvas.
fn wall(maps: Vec<WarpGeometry>) -> (Wall, CalibrationMaps) {
    let plane = Plane::upright(DVec3::NEG_Z * 2.0, CANVAS.as_dvec2() / 50.0);
    let screen = Screen::new("front", Surface::Plane(plane), CANVAS);
    let channel = |index: usize| {
        let mut channel = Channel::tile(&format!("c{index}"), 0, UVec2::ZERO, UVec2::new(50, 60));
        channel.cover = ChannelKind::Map;
        channel.adjustment.warp = Some(index as u16);
        channel
    };
    let channels = (0..maps.len()).map(channel).collect();
    let mut wall = Wall::new("w", vec![screen], channels);
    let file = |shape| CalibrationMap::Warp(WarpMap { space: MapCoordinates::Canvas, shape });
    let files: Vec<_> = maps.into_iter().map(file).collect();
    let maps = with_files(&mut wall, CalibrationFileKind::Warp, &files);
    (wall, maps)
}

/// The left `share` of the canvas.
fn left(share: f64) -> impl Fn(DVec2) -> Option<DVec3> {
    move |place| Some(DVec3::new(place.x * share, place.y, 0.0))
}

/// White of every channel, on the canvas: which pixels have light, and how much.
fn white(wall: &Wall, shapes: &WallGeometry) -> Vec<Vec<Option<f64>>> {
    let of = ResolvedWall { wall, shapes };
    let codes: Vec<Vec<u8>> =
        wall.channels.iter().map(|c| vec![255; 4 * c.size.element_product() as usize]).collect();
    let ids = wall.channel_ids().zip(&codes);
    let pictures: Vec<_> = ids.map(|(channel, rgba)| DisplayImage { channel, rgba }).collect();
    let shown = LightComposite::new(of, 0, StereoEye::Left, &pictures);
    let row = |y| shown.row(y).into_iter().map(|light| light.map(|light| light.y)).collect();
    (0..wall.screens[0].canvas.y).map(row).collect()
}

/// A hole stays dark, and the other channel has all of the light there.
#[test]
fn a_hole_in_a_map_is_dark_and_another_channel_fills_it() {
    let is_hole = |place: DVec2| place.distance(DVec2::new(0.5, 0.5)) < 0.2;
    let holed = grid(UVec2::new(50, 60), |place| left(1.0)(place).filter(|_| !is_hole(place)));
    let (mut wall, maps) = wall(vec![holed, grid(UVec2::new(2, 2), left(1.0))]);
    let shapes = WallGeometry::new(&wall, &maps);
    let blend = BlendModel::new(ResolvedWall { wall: &wall, shapes: &shapes });
    let in_hole = blend.weights(ChannelId(1), DVec2::new(50.0, 30.0));
    assert_eq!(in_hole, [(ChannelId(1), 1.0)]);
    let beside = blend.weights(ChannelId(1), DVec2::new(10.0, 30.0));
    assert_eq!(beside.len(), 2);
    assert!((beside.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
    wall.channels.pop();
    let rows = white(&wall, &shapes);
    assert_eq!((rows[30][50], rows[30][5]), (None, Some(1.0)));
    let dark = rows.iter().flatten().filter(|light| light.is_none()).count() as f64;
    // An ellipse of 20 × 12 pixels, in whole pixels of the channel.
    let due = std::f64::consts::PI * 20.0 * 12.0;
    assert!((dark / due - 1.0).abs() < 0.02, "{dark}, of {due}");
}

/// A picture that runs to the middle and back shows each place twice: one of both counts.
#[test]
fn a_folded_map_has_one_pixel_for_each_place() {
    let folded = |place: DVec2| Some(DVec3::new(0.5 - (place.x - 0.5).abs(), place.y, 0.0));
    let (wall, maps) = wall(vec![grid(UVec2::new(51, 60), folded)]);
    let shapes = WallGeometry::new(&wall, &maps);
    let map =
        ResolvedWall { wall: &wall, shapes: &shapes }.channel_mapping(ChannelId(0)).expect("a map");
    for x in 1..49 {
        let canvas = DVec2::new(f64::from(x), 30.2);
        let pixel = map.pixel_from_canvas(canvas).expect("lit");
        let back = map.canvas_from_pixel(pixel).expect("lit");
        assert!(back.distance(canvas) < 1e-6, "{canvas}: {pixel}, {back}");
    }
    let rows = white(&wall, &shapes);
    assert_eq!((rows[30][25], rows[30][75]), (Some(1.0), None));
}

#[test]
fn a_map_may_leave_its_screen() {
    let wide = |place: DVec2| Some(DVec3::new(place.x * 3.0 - 1.0, place.y * 3.0 - 1.0, 0.0));
    let (wall, maps) = wall(vec![grid(UVec2::new(2, 2), wide)]);
    let shapes = WallGeometry::new(&wall, &maps);
    let map =
        ResolvedWall { wall: &wall, shapes: &shapes }.channel_mapping(ChannelId(0)).expect("a map");
    let outside = map.canvas_from_pixel(DVec2::new(1.0, 1.0)).expect("on the plane");
    assert!(outside.cmplt(DVec2::ZERO).all(), "{outside}");
    assert!(white(&wall, &shapes).iter().flatten().all(|light| *light == Some(1.0)));
}

/// A map of one point has no extent: nothing of the canvas is its, and nothing fails.
#[test]
fn a_map_of_one_point_lights_nothing() {
    let one = grid(UVec2::ONE, |_| Some(DVec3::new(0.5, 0.5, 0.0)));
    let none = grid(UVec2::new(3, 3), |_| None);
    for shape in [one, none] {
        let (wall, maps) = wall(vec![shape, grid(UVec2::new(2, 2), left(1.0))]);
        let shapes = WallGeometry::new(&wall, &maps);
        let of = ResolvedWall { wall: &wall, shapes: &shapes };
        assert_eq!(BlendModel::new(of).weights(ChannelId(1), DVec2::new(50.0, 30.0)).len(), 1);
        assert!(white(&wall, &shapes).iter().flatten().all(|light| *light == Some(1.0)));
    }
}

/// Ramps begin at the lit edges of a picture that has dark margins.
#[test]
fn ramps_run_along_what_is_lit() {
    let margin = |from: f64| {
        move |place: DVec2| {
            let at = (place.x - 0.2) / 0.6;
            let value = DVec3::new(from + at * 0.6, place.y, 0.0);
            (0.0..=1.0).contains(&at).then_some(value)
        }
    };
    let maps = [0.0, 0.4].map(|from| grid(UVec2::new(50, 60), margin(from)));
    let (wall, maps) = wall(maps.into());
    let shapes = WallGeometry::new(&wall, &maps);
    let blend = BlendModel::new(ResolvedWall { wall: &wall, shapes: &shapes });
    let [_, right, _, _] = blend.ramp_widths(ChannelId(0));
    let right = right.expect("a ramp");
    // A fifth of the canvas, of which 0.6 are 30 pixels, less the cells at both edges.
    assert!((8.0..10.5).contains(&right), "{right}");
    let weight = |x: f64| {
        let all = blend.weights(ChannelId(0), DVec2::new(x, 30.0));
        all.into_iter().find(|(id, _)| id.0 == 0).map_or(0.0, |(_, weight)| weight)
    };
    let [near, middle, far] = [43.0, 50.0, 57.0].map(weight);
    assert!(near > 0.9 && (0.4..0.6).contains(&middle) && far < 0.1, "{near} {middle} {far}");
}

/// Calibrations bring their blends as masks: nothing is shared twice.
#[test]
fn who_has_a_mask_shares_no_light_but_is_seen() {
    let maps = vec![grid(UVec2::new(2, 2), left(0.6)), grid(UVec2::new(2, 2), left(1.0))];
    let (mut wall, maps) = wall(maps);
    let shapes = WallGeometry::new(&wall, &maps);
    let count = |wall: &Wall| {
        BlendModel::new(ResolvedWall { wall, shapes: &shapes }).neighbours(ChannelId(0)).len()
    };
    assert_eq!(count(&wall), 1);
    wall.channels[1].adjustment.alpha = Some(0);
    assert_eq!(count(&wall), 0);
    let mask = Mask { size: UVec2::ONE, components: 1, texels: vec![32768] };
    let alpha = MaskTexels::new(mask.size, 1, &mask.texels);
    let masks = ChannelMasks { alpha, ..ChannelMasks::default() };
    let of = ResolvedWall { wall: &wall, shapes: &shapes };
    let light = blend_map(of, ChannelId(1), &masks).expect("a light map");
    assert!((light.texel(25, 30, 0)[0] - 0.5).abs() < 1e-4);
    assert_eq!(blend_map(of, ChannelId(0), &ChannelMasks::default()), None);
    assert_eq!(white(&wall, &shapes)[30][50], Some(2.0), "both are seen all the same");
    wall.channels[1].adjustment.edges.left = Some(5.0);
    assert_eq!(count(&wall), 1, "the wall file says that it has a ramp");
}
