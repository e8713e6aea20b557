//! Pictures over HTTP are those of `polyptych shot`, scaled or not.

use image::RgbaImage;
use polyptych_client::Pacing;
use serde_json::json;

use super::page::{Answer, Page};
use crate::harness::local_wall::small;
use crate::harness::pictures::{self, Difference, IDENTICAL};
use crate::harness::scenes::town;

fn image_of(answer: &Answer) -> RgbaImage {
    assert_eq!(answer.code, 200, "{}", answer.head);
    image::load_from_memory(&answer.body).expect("a picture").into_rgba8()
}

/// The mean light of boxes, in f64.
fn reference(image: &RgbaImage, width: u32) -> RgbaImage {
    let (from_x, from_y) = image.dimensions();
    let height = (f64::from(from_y) * f64::from(width) / f64::from(from_x)).round() as u32;
    let light = |code: u8| {
        let value = f64::from(code) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let code = |light: f64| {
        let value =
            if light <= 0.0031308 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
        (value * 255.0).round() as u8
    };
    RgbaImage::from_fn(width, height, |x, y| {
        let box_of = |n: u32, from: u32, to: u32| n * from / to..(n + 1) * from / to;
        let (mut sums, mut count) = ([0.0; 3], 0.0);
        for row in box_of(y, from_y, height) {
            for column in box_of(x, from_x, width) {
                let pixel = image.get_pixel(column, row);
                (0..3).for_each(|axis| sums[axis] += light(pixel[axis]));
                count += 1.0;
            }
        }
        let [red, green, blue] = sums.map(|sum| code(sum / count));
        image::Rgba([red, green, blue, 255])
    })
}

#[test]
fn pictures_are_those_of_the_command() {
    let folder = town().parent().expect("a folder");
    let page = Page::start(&small(2, 2), &[folder], &[]);
    let open = json!({ "path": "town.glb" });
    page.ask("POST", "/scene/open", Some(&open)).value();
    page.local.run(&["shot", "wall.png"]).succeeded();
    let shot = pictures::read(&page.local.place.path("wall.png"));

    let whole = page.ask("GET", "/wall.png", None);
    let size = |answer: &Answer| {
        let number = |name| answer.header(name).and_then(|text| text.parse::<u32>().ok());
        [number("polyptych-width"), number("polyptych-height")]
    };
    assert_eq!(size(&whole), [Some(480), Some(272)]);
    assert!(Difference::of(&image_of(&whole), &shot).holds(&IDENTICAL), "the whole wall");
    let screen = image_of(&page.ask("GET", "/screens/front.png", None));
    assert!(Difference::of(&screen, &shot).holds(&IDENTICAL), "its only screen");
    let raw = page.ask("GET", "/wall.rgba", None);
    assert_eq!(raw.body, shot.as_raw()[..], "its pixels");

    for width in [240, 100, 7, 1] {
        let small = image_of(&page.ask("GET", &format!("/wall.png?width={width}"), None));
        let difference = Difference::of(&small, &reference(&shot, width));
        assert!(difference.levels_max <= 1, "{width}: {difference:?}");
    }
    let wide = image_of(&page.ask("GET", "/wall.png?width=4000000000", None));
    assert_eq!(wide.dimensions(), (480, 272), "it is never made larger");
    let jpeg = image_of(&page.ask("GET", "/wall.jpg", None));
    let difference = Difference::of(&jpeg, &shot);
    assert!(difference.above_8 < difference.pixels / 10, "{difference:?}");
    let tile = image_of(&page.ask("GET", "/channels/front-1-2.png", None));
    let corner = image::imageops::crop_imm(&shot, 0, 136, 240, 136).to_image();
    assert!(Difference::of(&tile, &corner).holds(&IDENTICAL), "a tile");
    page.ask("GET", "/wall.png?width=0", None).refused(400, "1 or more");
    page.ask("GET", "/wall.png?width=-5", None).refused(400, "is a whole number");
    page.ask("GET", "/wall.png?size=5", None).refused(400, "there is no parameter");
    page.ask("GET", "/wall.png?time_s=inf", None).refused(422, "finite");
}

#[test]
fn previews_are_shared_and_show_the_last_frame() {
    let folder = town().parent().expect("a folder");
    let page = Page::start(&small(2, 1), &[folder], &[]);
    page.ask("POST", "/scene/open", Some(&json!({ "path": "town.glb" }))).value();
    let client = page.local.client();
    client.render_frame_at(None, Some(3.0)).expect("drawn");
    let before = client.status().expect("a status").frame.0;
    let preview = page.ask("GET", "/wall.png?max_age_ms=60000", None);
    for _ in 0..20 {
        assert_eq!(page.ask("GET", "/wall.png?max_age_ms=60000", None).body, preview.body);
    }
    let after = client.status().expect("a status").frame.0;
    assert_eq!(after, before + 1, "one frame for all of them");
    let capture = client.capture_at(Some(3.0)).expect("captured");
    let shown = crate::harness::local_wall::screen_of(&capture);
    assert!(Difference::of(&image_of(&preview), &shown).holds(&IDENTICAL), "the same moment");
    page.ask("GET", "/wall.png?max_age_ms=9&time_s=1", None).refused(400, "shared");

    // A small picture of a channel is a preview too: the wall's clock stays.
    let tile = page.ask("GET", "/channels/front-2-1.png?width=60", None);
    assert_eq!(image_of(&tile).dimensions(), (60, 68));
    assert_eq!(client.redraw(None).expect("drawn").time_s, 3.0, "no clock has moved");
    page.ask("GET", "/channels/none.png?width=60", None).refused(404, "front-1-1");

    // On a wall that runs a preview comes with a frame that it draws anyway.
    client.start_rendering(Pacing::Rate(20.0)).expect("runs");
    let small = page.ask("GET", "/wall.jpg?width=64&max_age_ms=1", None);
    assert_eq!(image_of(&small).dimensions(), (64, 36));
    client.pause().expect("pauses");
}
