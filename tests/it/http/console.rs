//! The page in a browser: everything on it is clicked once, and its effect seen on the wall.

use polyptych_client::glam::DVec3;
use polyptych_client::{OutputMode, Presentation, TestPattern};
use rustix::process::Signal;

use super::page::Page;
use crate::harness::browser::Browser;
use crate::harness::local_wall::small;
use crate::harness::scenes::town;
use crate::harness::wait;

/// A page that is logged in by the command's link.
fn open(page: &Page) -> Browser {
    let mut browser = Browser::start(&page.local.place);
    let link = page.local.place.run(["login", "--http", &page.address]).succeeded();
    browser.open(link.trim());
    browser.await_true("location.pathname === '/' && location.search === ''");
    browser.await_true("!!document.querySelector('.channel.good')");
    browser
}

fn presentation(page: &Page) -> Presentation {
    page.local.client().status().expect("a status").presentation
}

/// Waits until the wall presents what is wanted.
#[track_caller]
fn await_shown(page: &Page, what: &str, is_it: impl Fn(&Presentation) -> bool) {
    wait::until(what, || is_it(&presentation(page)).then_some(()));
}

#[test]
fn every_control_of_the_page_does_what_it_says() {
    let folder = town().parent().expect("a folder");
    let page = Page::start(&small(2, 1), &[folder], &[]);
    let mut browser = open(&page);
    let set = |id: &str, value: &str| {
        format!(
            "(() => {{ const of = document.getElementById('{id}'); of.value = '{value}'; \
             of.dispatchEvent(new Event('change')); }})()"
        )
    };
    let click = |query: &str| format!("document.querySelector(\"{query}\").click()");

    browser.value("document.querySelector('#open-form [name=path]').value = 'town.glb'");
    browser.value(&click("#open-form button"));
    browser.await_true("document.getElementById('scene-name').textContent === 'town'");
    let curl = browser.value("document.getElementById('curl').textContent");
    let curl = curl.as_str().expect("a line");
    assert!(curl.contains("curl -X POST") && curl.contains("/api/v1/scene/open'"), "{curl}");
    browser.await_true("document.getElementById('picture').naturalWidth >= 320");

    check_steering(&page, &mut browser);

    let before = presentation(&page).camera;
    browser.value("document.querySelector('#store-form [name=name]').value = 'quay'");
    browser.value(&click("#store-form button"));
    browser.await_true("document.getElementById('views').value === 'quay'");
    page.local.client().set_camera(polyptych_client::Camera::IDENTITY).expect("set");
    browser.value(&click("#show-view"));
    await_shown(&page, "the stored view", |shown| shown.camera == before);
    browser.value(&click("#remove-view"));
    browser.await_true("document.getElementById('views').value === ''");

    for (mode, wanted) in [
        ("identify", OutputMode::Identify),
        ("freeze", OutputMode::Freeze),
        ("blank", OutputMode::Blank),
    ] {
        browser.value(&click(&format!("[data-mode={mode}]")));
        await_shown(&page, mode, |shown| shown.output_mode == wanted);
    }
    browser.await_true("document.querySelectorAll('.channel.bad').length === 2");
    browser.value(&click("[data-mode=normal]"));
    browser.await_true("document.querySelectorAll('.channel.bad').length === 0");
    browser.value(&set("pattern", "grid"));
    await_shown(&page, "a pattern", |shown| shown.pattern == Some(TestPattern::Grid));
    browser.value(&set("pattern", ""));
    await_shown(&page, "no pattern", |shown| shown.pattern.is_none());
    browser.value(&set("exposure", "2"));
    await_shown(&page, "an exposure", |shown| shown.exposure == 4.0);
    browser.value(&click("#automatic"));
    await_shown(&page, "automatic", |shown| shown.is_exposure_automatic);
    browser.value(&set("error", "1.5"));
    await_shown(&page, "an error bound", |shown| shown.bounds.error_px == 1.5);
    browser.value(&set("rate", "20"));
    await_shown(&page, "a rate bound", |shown| shown.bounds.rate_fps == Some(20.0));
    browser.value(&set("pace", "30"));
    browser.value(&click("#set-pace"));
    let frame = || page.local.client().status().expect("a status").frame.0;
    let begin = frame();
    wait::until("frames", || (frame() > begin + 5).then_some(()));
    browser.value(&click("#close"));
    browser.await_true("document.getElementById('scene-name').textContent === 'none'");
    browser.await_true("document.getElementById('log').textContent.includes('no scene is shown')");

    let unnamed = browser.value(
        "[...document.querySelectorAll('button, input, select, progress')].filter((of) => \
         !(of.textContent.trim() && of.tagName === 'BUTTON') && !of.labels?.length && \
         !of.getAttribute('aria-label')).map((of) => of.outerHTML)",
    );
    assert_eq!(unnamed, serde_json::json!([]), "controls without a name");
    assert_eq!(browser.complaints, [""; 0], "errors of the page");
}

/// Dragging, the wheel and keys move the camera around what it looks at.
fn check_steering(page: &Page, browser: &mut Browser) {
    let camera = || presentation(page).camera;
    let before = camera();
    let pivot = DVec3::new(0.0, 0.0, -1.304);
    browser.drag([300.0, 250.0], [420.0, 250.0]);
    await_shown(page, "a turn", |shown| shown.camera.rotation != before.rotation);
    let turned = camera();
    let apart = (turned.world_from_display(pivot) - before.world_from_display(pivot)).length();
    assert!(apart < 1e-6 * before.scale, "the middle of the wall stays: {apart}");
    assert!((turned.scale - before.scale).abs() < 1e-12);
    assert!((turned.rotation.length() - 1.0).abs() < 1e-9);
    let wheel = serde_json::json!({
        "type": "mouseWheel", "x": 300, "y": 250, "deltaX": 0, "deltaY": 120,
    });
    browser.call("Input.dispatchMouseEvent", &wheel);
    await_shown(page, "a zoom", |shown| shown.camera.scale > turned.scale * 1.05);
    let zoomed = camera();
    browser.value(
        "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', \
         { key: 'ArrowLeft', bubbles: true }))",
    );
    await_shown(page, "a key", |shown| shown.camera.rotation != zoomed.rotation);
}

#[test]
fn the_page_is_red_within_two_seconds_where_a_channel_is_gone() {
    let page = Page::start(&small(2, 1), &[], &[]);
    page.ask("POST", "/frame", Some(&serde_json::json!({}))).value();
    let mut browser = open(&page);
    browser.await_true("document.getElementById('health').className === 'good'");
    browser.value(
        "window.redAt = null; new MutationObserver(() => { \
         if (document.querySelector('.channel.bad') && !redAt) redAt = Date.now(); })\
         .observe(document.getElementById('channels'), { subtree: true, attributes: true })",
    );
    let server = page.local.wall().channels[0].server.clone();
    let began = browser.value("Date.now()").as_f64().expect("a time");
    page.local.servers[&server].signal(Signal::KILL);
    browser.await_true("redAt !== null");
    let after_ms = browser.value("redAt").as_f64().expect("a time") - began;
    // Two seconds, and what a busy machine takes to notice the end of a process.
    assert!(after_ms < 4000.0, "{after_ms} ms");
    let text = browser.value("document.getElementById('health').textContent");
    assert!(text.as_str().is_some_and(|text| text.contains("front-1-1 lost")), "{text}");
    // Without its manager nothing is believed any more.
    page.local.manager.signal(Signal::KILL);
    browser.await_true("document.querySelectorAll('.channel.bad').length === 2");
}
