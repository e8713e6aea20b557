//! Channels for both eyes over groups for one: each eye's weights add up, and its black is one.

use super::*;

/// A wall whose channels are for the eyes of these letters.
fn seen(canvas: [u32; 2], rects: &[(&str, [u32; 2], [u32; 2])]) -> Wall {
    let places: Vec<_> = rects.iter().map(|(_, origin, size)| (*origin, *size)).collect();
    let mut wall = tiles(canvas, &places);
    for (channel, (eye, ..)) in wall.channels.iter_mut().zip(rects) {
        channel.adjustment.eye = match *eye {
            "left" => Eye::Left,
            "right" => Eye::Right,
            _ => Eye::Center,
        };
    }
    wall
}

/// For an eye: what is the largest error of a sum of weights, and of light 0.3 on its black.
fn errors(wall: &Wall, eye: Eye) -> [f64; 2] {
    let canvas = wall.screens[0].canvas;
    let (maps, leak) = (maps(wall), wall.blend.leak);
    let most = BlendModel::new(wall).overlap_max() as f64;
    let places = (canvas.x * canvas.y) as usize;
    let (mut sums, mut shown) = (vec![0.0; places], vec![0.0; places]);
    let blend = BlendModel::new(wall);
    for ((id, channel), map) in wall.channel_ids().zip(&wall.channels).zip(&maps) {
        let multiply = blend.color(id).expect("a channel").made().x_axis.x;
        if ![Eye::Center, eye].contains(&channel.adjustment.eye) {
            continue;
        }
        for (x, y) in (0..channel.size.y).flat_map(|y| (0..channel.size.x).map(move |x| (x, y))) {
            let at = channel.origin + UVec2::new(x, y);
            let at = (at.y * canvas.x + at.x) as usize;
            let [factor, addend] = map.as_ref().map_or([1.0, 0.0], |map| map.texel(x, y, 0));
            sums[at] += factor;
            shown[at] += leak + (1.0 - leak) * (factor * multiply * 0.3 + addend);
        }
    }
    let worst = |values: &[f64], due: f64| {
        values.iter().filter(|v| **v != 0.0).map(|v| (v - due).abs()).fold(0.0, f64::max)
    };
    [worst(&sums, 1.0), worst(&shown, most * leak + (1.0 - most * leak) * 0.3)]
}

const HIGH: u32 = 30;

/// Two channels for each eye that divide the wall elsewhere, and one for both across the middle.
fn apart() -> Wall {
    seen(
        [120, HIGH],
        &[
            ("left", [0, 0], [70, HIGH]),
            ("right", [0, 0], [50, HIGH]),
            ("center", [30, 0], [60, HIGH]),
            ("left", [60, 0], [60, HIGH]),
            ("right", [44, 0], [76, HIGH]),
        ],
    )
}

#[test]
fn what_is_for_both_eyes_keeps_the_sums_of_both() {
    for exponent in [1.0, 2.5] {
        let mut wall = apart();
        wall.blend.exponent = exponent;
        for eye in [Eye::Left, Eye::Right] {
            let [sum, _] = errors(&wall, eye);
            println!("{eye:?}, exponent {exponent}: sums are off by {sum:.2e}");
            assert!(sum < SUM_ERROR_MAX, "{eye:?}: {sum}");
        }
    }
}

#[test]
fn black_is_one_black_for_both_eyes() {
    let mut wall = apart();
    wall.blend.leak = 0.01;
    assert_eq!(BlendModel::new(&wall).overlap_max(), 3);
    for eye in [Eye::Left, Eye::Right] {
        let [_, black] = errors(&wall, eye);
        println!("{eye:?}: black is off by {black:.2e}");
        assert!(black < 6e-5, "{eye:?}: {black}");
    }
}

/// Only the left eye's channel stops in the middle: what is for both must carry the right eye
/// alone there, so that the left eye's channel yields.
#[test]
fn one_eye_that_sees_nothing_else_has_all_of_what_is_for_both() {
    let rects = [
        ("left", [0, 0], [80, HIGH]),
        ("center", [40, 0], [60, HIGH]),
        ("right", [0, 0], [60, HIGH]),
    ];
    let wall = seen([100, HIGH], &rects);
    for eye in [Eye::Left, Eye::Right] {
        let [sum, _] = errors(&wall, eye);
        assert!(sum < SUM_ERROR_MAX, "{eye:?}: {sum}");
    }
    let map = blend_map(&wall, ChannelId(0), &ChannelMasks::default()).expect("a map");
    assert_eq!(map.texel(75, 10, 0)[0], 0.0, "it yields");
}

/// Both groups alike: as if there were one.
#[test]
fn groups_that_are_alike_weigh_as_one() {
    let rects = [
        ("left", [0, 0], [50, HIGH]),
        ("center", [30, 0], [50, HIGH]),
        ("right", [0, 0], [50, HIGH]),
    ];
    let both = maps(&seen([80, HIGH], &rects));
    let alone = maps(&seen([80, HIGH], &[("", [0, 0], [50, HIGH]), ("", [30, 0], [50, HIGH])]));
    assert_eq!(both[..2], alone);
    assert_eq!(both[0], both[2]);
}
