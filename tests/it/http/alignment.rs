//! Alignment on the page: points are dragged and moved by keys, lit on the display, and put back.

use polyptych_client::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_client::glam::{DVec2, UVec2};
use polyptych_client::{Image, TestPattern};
use polyptych_wall::ChannelCalibration;

use super::console::open;
use super::page::Page;
use crate::harness::browser::Browser;
use crate::harness::local_wall::{patient, tiled};
use crate::harness::wait;

fn adjustment(page: &Page) -> ChannelCalibration {
    page.local.client().wall().expect("a wall").channels[0].adjustment.clone()
}

#[track_caller]
fn await_adjusted(page: &Page, what: &str, is_it: impl Fn(&ChannelCalibration) -> bool) {
    wait::until(what, || is_it(&adjustment(page)).then_some(()));
}

/// The middle of what is lit red on the channel, in pixels.
fn lit(page: &Page) -> Option<DVec2> {
    let capture = page.local.client().capture().expect("pictures");
    let Image { width, rgba, .. } = &capture.channels[0];
    let is_red = |code: &[u8]| code[0] > 200 && code[1] < 80 && code[2] < 80;
    let red: Vec<usize> =
        rgba.chunks(4).enumerate().filter(|(_, code)| is_red(code)).map(|(at, _)| at).collect();
    let place = |at: &usize| {
        let (x, y) = (at % *width as usize, at / *width as usize);
        DVec2::new(x as f64 + 0.5, y as f64 + 0.5)
    };
    (!red.is_empty()).then(|| red.iter().map(place).sum::<DVec2>() / red.len() as f64)
}

fn handle(browser: &mut Browser, label: &str, work: &str) -> serde_json::Value {
    let find = format!("document.querySelector('[data-handle=\"{label}\"]')");
    browser.value(&format!("((of) => {{ {work} }})({find})"))
}

/// Holds the page's next calibration back until `release()`; those after it are not held.
const HOLD: &str = "(() => { const real = fetch; const held = new Promise((done) => { \
                    window.release = done; }); window.fetch = (...of) => { \
                    if (!String(of[0]).endsWith('/calibration')) return real(...of); \
                    window.fetch = real; return held.then(() => real(...of)); }; })()";

/// Refuses pictures of the channel from now on, and counts them in `asked`.
const REFUSE: &str = "(() => { window.real ??= fetch; window.asked = 0; \
                      window.fetch = (...of) => { \
                      if (!String(of[0]).includes('.jpg?width=960')) return real(...of); \
                      asked += 1; const body = JSON.stringify({ error: 'nobody draws' }); \
                      return Promise.resolve(new Response(body, { status: 503 })); }; })()";

/// Presses an arrow key on a point.
fn press(browser: &mut Browser, label: &str, key: &str) {
    let event = format!("new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }})");
    handle(browser, label, &format!("of.focus(); of.dispatchEvent({event});"));
}

#[test]
fn a_channel_is_aligned_on_its_picture() {
    let page = Page::start(&patient(tiled([2, 1], [192, 108])), &[], &[]);
    let mut browser = open(&page);
    // A pattern that was there before is not put back in the end: it may be another alignment's.
    page.local.client().set_pattern(Some(TestPattern::Checker)).expect("set");
    browser.await_true("document.getElementById('pattern').value === 'checker'");
    browser.value("document.getElementById('align-begin').click()");
    let pattern = || page.local.client().status().expect("a status").presentation.pattern;
    wait::until("the pattern", || (pattern() == Some(TestPattern::Grid)).then_some(()));
    browser.await_true("document.getElementById('align-picture').naturalWidth === 96");

    // A point that is chosen is lit where it is, and where it was put.
    let corner = "Corner lower-right";
    press(&mut browser, corner, "ArrowLeft");
    await_adjusted(&page, "a key", |of| of.pin[3] == DVec2::new(-1.0, 0.0));
    let at = |page: &Page, place: DVec2| {
        let near = |seen: &DVec2| seen.distance(place) < 4.0;
        wait::until(&format!("light at {place}"), || lit(page).filter(near));
    };
    at(&page, DVec2::new(95.0, 108.0));
    let drag = "of.scrollIntoView({ block: 'center' }); const r = of.getBoundingClientRect(); \
                return [r.x + r.width / 2, r.y + r.height / 2];";
    let from = handle(&mut browser, corner, drag);
    let [x, y] = [0, 1].map(|axis| from[axis].as_f64().expect("a place"));
    browser.drag([x, y], [x - 100.0, y - 60.0]);
    await_adjusted(&page, "a drag", |of| of.pin[3].x < -2.0 && of.pin[3].y < -2.0);
    let put = adjustment(&page).pin[3];
    assert!((put.x + 1.0) / put.y > 1.4, "as far as it was dragged: {put}");
    at(&page, DVec2::new(96.0, 108.0) + put);

    // A step that could not be taken back can still be.
    browser.value("window.real = fetch; window.fetch = () => Promise.reject(new Error('away'))");
    browser.value("document.getElementById('align-undo').click()");
    browser.await_true("document.getElementById('log').textContent.includes('does not answer')");
    browser.value("window.fetch = real");
    browser.value("document.getElementById('align-undo').click()");
    await_adjusted(&page, "undone", |of| of.pin[3] == DVec2::new(-1.0, 0.0));
    check_order(&page, &mut browser);
    press(&mut browser, "Bend point column 1, row 1", "ArrowDown");
    let moved = |of: &ChannelCalibration| of.bend.as_ref().map(|bend| bend.moves[4]);
    await_adjusted(&page, "a bend", |of| moved(of) == Some(DVec2::new(0.0, 1.0)));
    at(&page, DVec2::new(48.0, 55.0));

    browser.value("document.getElementById('align-revert').click()");
    await_adjusted(&page, "all is as it was", |of| *of == ChannelCalibration::default());
    // The page has read so too: what it reads later would take back a key that is pressed now.
    browser.await_true(
        "document.querySelector('[data-handle=\"Corner lower-right\"]')\
         .getAttribute('aria-label').endsWith(': 0.00, 0.00 pixels')",
    );
    press(&mut browser, "Corner upper-left", "ArrowRight");
    await_adjusted(&page, "kept", |of| of.pin[0] == DVec2::new(1.0, 0.0));
    // They are made before the alignment ends.
    let keys = "const key = { key: 'ArrowRight', bubbles: true }; \
                of.dispatchEvent(new KeyboardEvent('keydown', key)); \
                of.dispatchEvent(new KeyboardEvent('keydown', key)); \
                document.getElementById('align-keep').click();";
    handle(&mut browser, "Corner upper-left", keys);
    wait::until("no pattern", || pattern().is_none().then_some(()));
    let marker = page.local.client().status().expect("a status").presentation.marker;
    assert_eq!((marker, adjustment(&page).pin[0]), (None, DVec2::new(3.0, 0.0)));
    let curl = browser.value("document.getElementById('curl').textContent");
    assert!(curl.as_str().is_some_and(|line| line.contains("/api/v1/pattern'")), "{curl}");
    assert_eq!(browser.complaints, [""; 0], "errors of the page");
}

#[test]
fn handles_stand_where_the_display_lights_their_points() {
    let page = Page::start(&patient(tiled([2, 1], [192, 108])), &[], &[]);
    let client = page.local.client();
    let name = client.wall().expect("a wall").channels[0].name.clone();
    let (pin, moved) = (DVec2::new(12.0, 8.0), DVec2::new(10.0, 8.0));
    let changes = vec![
        CalibrationChange::Pin { corner: Corner::UpperLeft, to: Offset::To(pin) },
        CalibrationChange::Grid(Some(UVec2::splat(3))),
        CalibrationChange::Bend { column: 0, row: 0, to: Offset::To(moved) },
    ];
    client.calibrate(name, changes).expect("tuned");
    let mut browser = open(&page);
    browser.value("document.getElementById('align-begin').click()");
    browser.await_true("document.getElementById('align-picture').naturalWidth === 96");
    let find = "of.focus(); return [of.style.left, of.style.top].map(parseFloat);";
    for label in ["Corner upper-left", "Blend at the left edge", "Bend point column 0, row 0"] {
        let share = handle(&mut browser, label, find);
        let [x, y] = [0, 1].map(|axis| share[axis].as_f64().expect("a share in percent"));
        let place = DVec2::new(x, y) / 100.0 * DVec2::new(96.0, 108.0);
        let near = |seen: &DVec2| seen.distance(place) < 3.0;
        wait::until(&format!("{label} at {place}"), || lit(&page).filter(near));
    }
}

#[test]
fn a_refused_picture_is_said_once_until_there_is_one_again() {
    let page = Page::start(&patient(tiled([2, 1], [192, 108])), &[], &[]);
    let mut browser = open(&page);
    browser.value("document.getElementById('align-begin').click()");
    browser.await_true("document.getElementById('align-picture').naturalWidth === 96");
    let said = "[...document.getElementById('log').children].filter((line) => \
                line.textContent.includes('no picture of the channel: nobody draws')).length";
    for times in 1..=2 {
        browser.value(REFUSE);
        for _ in 0..3 {
            press(&mut browser, "Corner upper-left", "ArrowRight");
        }
        // One is asked for at a time: two of them were refused then.
        browser.await_true("asked >= 3");
        assert_eq!(browser.value(said), times);
        browser.value("window.before = document.getElementById('align-picture').src");
        browser.value("window.fetch = real");
        browser.await_true("document.getElementById('align-picture').src !== before");
    }
    assert_eq!(browser.complaints, [""; 0], "errors of the page");
}

/// While the first of several changes is slow, the others wait for it, and none is lost.
fn check_order(page: &Page, browser: &mut Browser) {
    browser.value(HOLD);
    press(browser, "Corner upper-left", "ArrowRight");
    browser.value("document.getElementById('align-undo').click()");
    press(browser, "Corner lower-left", "ArrowUp");
    // Nobody says how wide the overlap is: no step leads from there.
    for key in ["ArrowRight", "ArrowLeft", "ArrowUp"] {
        press(browser, "Blend at the right edge", key);
    }
    browser.value(
        "(() => { const of = document.getElementById('align-bend'); of.value = '3x3'; \
         of.dispatchEvent(new Event('change')); release(); })()",
    );
    browser.await_true("document.querySelectorAll('.handle.bend').length === 9");
    let made = adjustment(page);
    assert_eq!((made.pin[0], made.pin[2].y, made.edges.right), (DVec2::ZERO, -1.0, None));
    browser.await_true("document.getElementById('log').textContent.includes('as the overlap')");
}
