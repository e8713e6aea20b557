//! The page in a browser: everything on it is clicked once, and its effect seen on the wall.

use polyptych_client::glam::DVec3;
use polyptych_client::{
    AmbientOcclusion, Camera, DepthOfField, Fog, Glow, LitHours, OutputMode, Presentation,
    QualityBounds, RestRules, TestPattern, ToneMapper,
};
use rustix::process::Signal;

use super::page::Page;
use crate::harness::browser::Browser;
use crate::harness::local_wall::{ANY_PORT, small};
use crate::harness::scenes::town;
use crate::harness::wait;

/// A page that is logged in by the command's link.
pub fn open(page: &Page) -> Browser {
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
    let click = |query: &str| format!("document.querySelector(\"{query}\").click()");

    browser.value("document.querySelector('#open-form [name=path]').value = 'town.glb'");
    browser.value(&click("#open-form button"));
    browser.await_true("document.getElementById('scene-name').textContent === 'town'");
    check_curl(&mut browser);
    browser.await_true("document.getElementById('picture').naturalWidth >= 320");
    // The scene is named as soon as it is open, and the camera placed after that.
    await_shown(&page, "an overview", |shown| shown.camera != Camera::IDENTITY);

    check_steering(&page, &mut browser);

    let before = presentation(&page).camera;
    browser.value("document.querySelector('#store-form [name=name]').value = 'quay'");
    browser.value(&click("#store-form button"));
    browser.await_true("document.getElementById('views').value === 'quay'");
    page.local.client().set_camera(Camera::IDENTITY).expect("set");
    browser.value(&click("#show-view"));
    await_shown(&page, "the stored view", |shown| shown.camera == before);
    browser.value(&click("#remove-view"));
    browser.await_true("document.getElementById('views').value === ''");

    check_sight(&page, &mut browser);
    check_tour(&page, &mut browser);
    check_kept(&page, &mut browser);
    check_rest(&page, &mut browser);

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
    set(&mut browser, "pattern", "grid");
    await_shown(&page, "a pattern", |shown| shown.pattern == Some(TestPattern::Grid));
    set(&mut browser, "pattern", "");
    await_shown(&page, "no pattern", |shown| shown.pattern.is_none());
    set(&mut browser, "exposure", "2");
    await_shown(&page, "an exposure", |shown| shown.exposure == 4.0);
    browser.value(&click("#automatic"));
    await_shown(&page, "automatic", |shown| shown.is_exposure_automatic);
    check_light(&page, &mut browser);
    check_bounds(&page, &mut browser);
    set(&mut browser, "pace", "30");
    browser.value(&click("#set-pace"));
    let frame = || page.local.client().status().expect("a status").frame.0;
    let begin = frame();
    wait::until("frames", || (frame() > begin + 5).then_some(()));
    browser.value(&click("#close"));
    browser.await_true("document.getElementById('scene-name').textContent === 'none'");
    browser.await_true("document.getElementById('log').textContent.includes('no scene is shown')");

    browser.await_true("document.querySelector('#plots polyline').points.length > 2");
    check_accessibility(&mut browser);
    assert_eq!(browser.complaints, [""; 0], "errors of the page");
}

/// Checks what tools for accessibility call serious: controls without a name, text that is hard to
/// read, a focus that cannot be seen, a page without landmarks.
fn check_accessibility(browser: &mut Browser) {
    let unnamed = browser.value(
        "[...document.querySelectorAll('button, input, select, progress')].filter((of) => \
         !(of.textContent.trim() && of.tagName === 'BUTTON') && !of.labels?.length && \
         !of.getAttribute('aria-label')).map((of) => of.outerHTML)",
    );
    assert_eq!(unnamed, serde_json::json!([]), "controls without a name");
    let faint = browser.value(CONTRASTS);
    assert_eq!(faint, serde_json::json!([]), "text of less contrast than 4.5");
    let landmarks = browser.value(
        "[document.querySelectorAll('main').length, document.querySelectorAll('header').length, \
         [...document.querySelectorAll('section')].every((of) => of.getAttribute('aria-label')), \
         document.documentElement.lang, document.querySelectorAll('h1').length, \
         [...document.querySelectorAll('img')].every((of) => of.alt), \
         new Set([...document.querySelectorAll('[id]')].map((of) => of.id)).size === \
         document.querySelectorAll('[id]').length]",
    );
    assert_eq!(landmarks, serde_json::json!([1, 1, true, "en", 1, true, true]));
    browser.value("document.getElementById('close').focus({ focusVisible: true })");
    let outline = "getComputedStyle(document.getElementById('close'))";
    browser.await_true(&format!("{outline}.outlineStyle === 'solid'"));
    browser.await_true(&format!("parseFloat({outline}.outlineWidth) >= 2"));
}

/// Text whose contrast with what lies behind it is below 4.5, by the formula of WCAG 2.2.
const CONTRASTS: &str = r"(() => {
    const parsed = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
    const light = ([r, g, b]) => [r, g, b].map((code) => code / 255).map((part) =>
        part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4)
        .reduce((sum, part, i) => sum + part * [0.2126, 0.7152, 0.0722][i], 0);
    const behind = (element) => {
        for (let at = element; at; at = at.parentElement) {
            const color = parsed(getComputedStyle(at).backgroundColor);
            if (color.length === 3 || color[3] === 1) return color;
        }
        return [255, 255, 255];
    };
    const isSeen = (of) => of.getClientRects().length && [...of.childNodes].some((node) =>
        node.nodeType === 3 && node.textContent.trim());
    return [...document.querySelectorAll('body *')].filter(isSeen).filter((of) => {
        const [a, b] = [parsed(getComputedStyle(of).color), behind(of)].map(light);
        return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5;
    }).map((of) => of.outerHTML);
})()";

/// The last action stands as a command, with the token of the manager, or with keys where it has
/// them.
fn check_curl(browser: &mut Browser) {
    let curl = browser.value("document.getElementById('curl').textContent");
    let curl = curl.as_str().expect("a line");
    assert!(curl.contains("login --token") && curl.contains("curl -X POST"), "{curl}");
    assert!(curl.ends_with("/api/v1/scene/open'"), "{curl}");
    let with_keys = browser.value(
        "import('/requests.js').then((of) => of.curlLine('GET', '/a', undefined, 'https://m'))",
    );
    assert_eq!(
        with_keys,
        "curl -X GET --cacert \"$POLYPTYCH_KEYS/authority.pem\" --cert \
         \"$POLYPTYCH_KEYS/cert.pem\" --key \"$POLYPTYCH_KEYS/key.pem\" 'https://m/a'"
    );
}

fn click(browser: &mut Browser, id: &str) {
    browser.value(&format!("document.getElementById('{id}').click()"));
}

fn fill(browser: &mut Browser, id: &str, value: &str) {
    browser.value(&format!("document.getElementById('{id}').value = '{value}'"));
}

fn submit(browser: &mut Browser, id: &str) {
    browser.value(&format!("document.getElementById('{id}').requestSubmit()"));
}

/// Sets a control, in one step: the page writes what is shown into those that are free.
fn set(browser: &mut Browser, id: &str, value: &str) {
    browser.value(&format!(
        "(() => {{ const of = document.getElementById('{id}'); of.value = '{value}'; \
         of.dispatchEvent(new Event('change')); }})()"
    ));
}

/// Tone mapper, fog, glow, ambient occlusion and depth of field are set by the number that is
/// written, which changes nothing else of them, and taken away.
fn check_light(page: &Page, browser: &mut Browser) {
    set(browser, "tone", "Aces");
    await_shown(page, "a tone mapper", |shown| shown.tone == ToneMapper::Aces);
    let layer = |visibility| Fog { half_height: Some(6.0), ..Fog::even(visibility) };
    page.local.client().set_fog(Some(layer(700.0))).expect("set");
    browser.await_true("document.getElementById('fog').value === '700'");
    set(browser, "fog", "800");
    await_shown(page, "fog", |shown| shown.fog == Some(layer(800.0)));
    set(browser, "glow", "0.25");
    await_shown(page, "glow", |shown| shown.glow == Some(Glow::new(0.25)));
    set(browser, "occlusion", "0.5");
    let occlusion = Some(AmbientOcclusion { radius: 0.5 });
    await_shown(page, "ambient occlusion", |shown| shown.ambient_occlusion == occlusion);
    set(browser, "focus", "12");
    let focus = Some(DepthOfField { focus: 12.0, aperture: 0.24 });
    await_shown(page, "depth of field", |shown| shown.depth_of_field == focus);
    for id in ["fog", "glow", "occlusion", "focus"] {
        set(browser, id, "");
    }
    await_shown(page, "none of them", |shown| {
        shown.fog.is_none()
            && shown.glow.is_none()
            && shown.ambient_occlusion.is_none()
            && shown.depth_of_field.is_none()
    });
    browser.await_true("document.getElementById('fog').value === ''");
}

/// One bound is set without the other, and not by text that is no number.
fn check_bounds(page: &Page, browser: &mut Browser) {
    set(browser, "error", "1.5");
    await_shown(page, "an error bound", |shown| shown.bounds.error_px == 1.5);
    // The page may have no status of the error bound yet.
    set(browser, "rate", "20");
    let both = QualityBounds { error_px: 1.5, rate_fps: Some(20.0) };
    await_shown(page, "a rate bound", |shown| shown.bounds == both);
    type_no_number(browser, "rate", "lowest rate");
    // An empty field has not changed then.
    type_no_number(browser, "glow", "glow");
    assert_eq!(presentation(page).bounds, both);
}

/// Types what is no number into a field; the page says so by the field's name.
fn type_no_number(browser: &mut Browser, id: &str, name: &str) {
    let field = format!("document.getElementById('{id}')");
    browser.value(&format!("{field}.focus()"));
    browser.call("Input.insertText", &serde_json::json!({ "text": "3-" }));
    // Keys take another way to the page than commands do.
    browser.await_true(&format!("{field}.validity.badInput"));
    browser.value(&format!("{field}.blur()"));
    let said = format!("document.getElementById('log').textContent.includes('{name}: write')");
    browser.await_true(&said);
}

/// A view lies over the half of the wall that was chosen, the head moves, and the camera flies.
fn check_sight(page: &Page, browser: &mut Browser) {
    page.ask("POST", "/scene/open", Some(&serde_json::json!({ "path": "town.glb" }))).value();
    let half = |is_right: bool| {
        let capture = page.local.client().capture_at(Some(1.0)).expect("pictures");
        let rows = capture.screens[0].rgba.chunks(480 * 4);
        let at = if is_right { 240 * 4 } else { 0 };
        rows.flat_map(|row| row[at..at + 240 * 4].to_vec()).collect::<Vec<u8>>()
    };
    let [left, right] = [false, true].map(half);
    let away = Camera { position: DVec3::new(0.0, 9e6, 0.0), ..presentation(page).camera };
    // What others store is listed before one is chosen, and used as it is stored then.
    page.local.client().store_view("away", None).expect("stored");
    fill(browser, "part-left", "50");
    browser.value("document.getElementById('part-view').focus()");
    browser.await_true("document.getElementById('part-view').options.length === 2");
    fill(browser, "part-view", "away");
    page.local.client().store_view("away", Some(away)).expect("stored");
    submit(browser, "part-form");
    await_shown(page, "a view over a part", |shown| shown.views.len() == 1);
    let area = polyptych_client::Area::Screen { screen: 0, rect: [240, 0, 240, 272] };
    assert_eq!(presentation(page).views[0].area, area);
    assert!(half(false) == left, "the left half stays");
    assert!(half(true) != right, "the right half shows the other view");
    browser.await_true("document.querySelectorAll('#parts button').length === 1");
    browser.value("document.querySelector('#parts button').click()");
    await_shown(page, "no view over a part", |shown| shown.views.is_empty());
    click(browser, "remove-parts");

    fill(browser, "head-x", "0.125");
    submit(browser, "head-form");
    await_shown(page, "a head", |shown| shown.head.position.x == 0.125);
    check_turn_in_flight(page, browser);
    fill(browser, "head-x", "0");
    submit(browser, "head-form");
    await_shown(page, "the head", |shown| shown.head.position.x == 0.0);

    click(browser, "fly");
    let before = presentation(page).camera;
    browser.value(
        "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', \
         { key: 'w', bubbles: true }))",
    );
    await_shown(page, "a flight", |shown| shown.camera.position != before.position);
    let now = presentation(page).camera;
    let way = (now.position - before.position) / before.scale;
    assert!((way - before.rotation * DVec3::NEG_Z * 0.25).length() < 1e-6, "ahead: {way}");
    assert!(now.rotation.angle_between(before.rotation) < 1e-6);
    click(browser, "orbit");
}

/// In flight the camera turns about the viewer, who need not be at the wall's eye.
fn check_turn_in_flight(page: &Page, browser: &mut Browser) {
    click(browser, "fly");
    let before = presentation(page).camera;
    browser.value(
        "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', \
         { key: 'ArrowLeft', bubbles: true }))",
    );
    await_shown(page, "a turn", |shown| shown.camera.rotation != before.rotation);
    let Presentation { camera, head, .. } = presentation(page);
    let [from, to] = [before, camera].map(|of| of.world_from_display(head.position));
    assert!((to - from).length() < 1e-6 * before.scale, "the viewer stays: {from} to {to}");
}

/// All stored views are played one after the other, until it is stopped.
fn check_tour(page: &Page, browser: &mut Browser) {
    let client = page.local.client();
    // The page has not listed this one.
    client.store_view("here", None).expect("stored");
    click(browser, "play-tour");
    let tour = || client.tour().expect("a tour");
    wait::until("a tour", || tour().tour.filter(|tour| tour.stops.len() == 2));
    wait::until("frames of it", || tour().began_s);
    browser.await_true("document.getElementById('tour-state').textContent === 'playing 2 stops'");
    click(browser, "stop-tour");
    wait::until("the end of it", || tour().tour.is_none().then_some(()));
    client.pause().expect("paused");
}

/// Scenes and sessions are saved, opened and removed.
fn check_kept(page: &Page, browser: &mut Browser) {
    let client = page.local.client();
    browser.value("document.querySelector('#save-scene-form [name=name]').value = 'evening'");
    submit(browser, "save-scene-form");
    browser.await_true("document.getElementById('saved').value === 'evening'");
    browser.value("document.querySelector('#save-session-form [name=name]').value = 'show'");
    submit(browser, "save-session-form");
    browser.await_true("document.getElementById('sessions').value === 'show'");
    let kept = presentation(page);
    client.close_scene().expect("closed");
    client.set_exposure(0.25).expect("set");
    click(browser, "open-session");
    await_shown(page, "the session", |shown| *shown == kept);
    browser.await_true("document.getElementById('scene-name').textContent === 'town'");
    click(browser, "open-saved");
    browser.await_true("document.getElementById('scene-name').textContent === 'evening'");
    click(browser, "remove-saved");
    browser.await_true("document.getElementById('saved').value === ''");
    click(browser, "remove-session");
    browser.await_true("document.getElementById('sessions').value === ''");
    client.save_session("of others").expect("saved");
    browser.value("document.getElementById('sessions').focus()");
    browser.await_true("document.getElementById('sessions').value === 'of others'");
    click(browser, "remove-session");
    browser.await_true("document.getElementById('sessions').value === ''");
    assert_eq!(client.sessions().expect("a list"), []);
    fill(browser, "files", "town.glb");
    browser.value("document.querySelector('[name=keep_camera]').checked = true");
    click(browser, "open-file");
    let line = browser.value("document.getElementById('curl').textContent");
    assert!(line.as_str().is_some_and(|line| line.contains(r#""keep_camera":true"#)), "{line}");
    browser.await_true("document.getElementById('scene-name').textContent === 'town'");
    // It has a picture once the wall has shown it while a page was open.
    browser.await_true(
        "fetch('/api/v1/scene/previews').then((of) => of.json()).then((of) => \
                        of.includes('town'))",
    );
    click(browser, "refresh-files");
    browser.await_true("document.getElementById('files-preview').naturalWidth === 240");
    // Of two files with one name it may be either's.
    browser.value("document.getElementById('files').add(new Option('', 'other/town.gltf'))");
    set(browser, "files", "town.glb");
    browser.await_true("document.getElementById('files-preview').hidden");
}

/// Rules by which displays go dark are set and taken away.
fn check_rest(page: &Page, browser: &mut Browser) {
    let rules = || page.local.client().status().expect("a status").rest.rules;
    for (id, value) in [("rest-idle", "30"), ("rest-from", "00:00"), ("rest-until", "23:59")] {
        fill(browser, id, value);
    }
    submit(browser, "rest-form");
    let hours = Some(LitHours { from_min: 0, until_min: 1439 });
    let wanted = RestRules { idle_s: Some(1800.0), hours };
    wait::until("rules", || (rules() == wanted).then_some(()));
    browser.await_true(
        "document.getElementById('rest-state').textContent.startsWith('Dark after 30 min')",
    );
    click(browser, "rest-off");
    wait::until("no rules", || (rules() == RestRules::default()).then_some(()));
    // What others set stands in the form, so that one part of it can be changed.
    let hours = Some(LitHours { from_min: 540, until_min: 1080 });
    let of_others = RestRules { idle_s: Some(900.0), hours };
    page.local.client().set_rest(of_others).expect("set");
    browser.await_true(
        "['rest-idle', 'rest-from', 'rest-until'].map((id) => document.getElementById(id).value)\
                        .join() === '15,09:00,18:00'",
    );
    // Half of the hours are none.
    fill(browser, "rest-until", "");
    submit(browser, "rest-form");
    browser.await_true("document.getElementById('log').textContent.includes('need both ends')");
    assert_eq!(rules(), of_others);
    page.local.client().set_rest(RestRules::default()).expect("set");
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
    check_lost_release(page, browser);
    let turned = camera();
    let wheel = serde_json::json!({
        "type": "mouseWheel", "x": 300, "y": 250, "deltaX": 0, "deltaY": 120,
    });
    browser.call("Input.dispatchMouseEvent", &wheel);
    await_shown(page, "a zoom", |shown| shown.camera.scale > turned.scale * 1.05);
    let zoomed = camera();
    let press = "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', \
                 { key: 'ArrowLeft', bubbles: true }))";
    browser.value(press);
    await_shown(page, "a key", |shown| shown.camera.rotation != zoomed.rotation);
    // A camera that others have just set, of which the page has no status yet.
    let moved = Camera { position: before.position + DVec3::X, ..before };
    page.local.client().set_camera(moved).expect("set");
    // A camera is set with its rotation normalized.
    let others = camera();
    browser.value(press);
    await_shown(page, "a key after others", |shown| shown.camera.rotation != others.rotation);
    let apart = (camera().world_from_display(pivot) - others.world_from_display(pivot)).length();
    assert!(apart < 1e-6 * before.scale, "from where others were: {apart}");
}

/// A mouse whose button was let go elsewhere moves nothing.
fn check_lost_release(page: &Page, browser: &mut Browser) {
    let before = presentation(page).camera;
    let mut mouse = |kind: &str, x: f64, button: &str, buttons: u32| {
        let event = serde_json::json!({
            "type": kind, "x": x, "y": 250, "button": button, "buttons": buttons, "clickCount": 1,
        });
        browser.call("Input.dispatchMouseEvent", &event);
    };
    mouse("mousePressed", 300.0, "right", 2);
    mouse("mouseMoved", 420.0, "none", 0);
    // It has its release now, so that what follows begins with a mouse without buttons.
    mouse("mouseReleased", 420.0, "right", 0);
    browser.value(
        "document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', \
         { key: '-', bubbles: true }))",
    );
    await_shown(page, "a zoom", |shown| shown.camera.scale != before.scale);
    let now = presentation(page).camera;
    assert!(now.rotation.angle_between(before.rotation) < 1e-6);
    let pivot = DVec3::new(0.0, 0.0, -1.304);
    let apart = (now.world_from_display(pivot) - before.world_from_display(pivot)).length();
    assert!(apart < 1e-6 * before.scale, "the middle of the wall stays: {apart}");
}

#[test]
fn the_page_is_red_within_two_seconds_where_a_channel_is_gone() {
    let page = Page::start(&small(2, 1), &[], &[]);
    page.ask("POST", "/frame", Some(&serde_json::json!({}))).value();
    let mut browser = open(&page);
    check_first_request(&page, &mut browser);
    browser.await_true("document.getElementById('health').className === 'good'");
    browser.value(
        "window.redAt = null; new MutationObserver(() => { \
         if (document.querySelector('.channel.bad') && !redAt) redAt = Date.now(); })\
         .observe(document.getElementById('channels'), { subtree: true, attributes: true })",
    );
    let rate = browser.value(RATE_OF_STATUSES_AT_ONCE);
    assert_eq!(rate.as_str().map(|text| text.contains(": 30.0,")), Some(true), "{rate}");
    let faults = browser.value(FAULTS_WHILE_IT_RUNS);
    assert_eq!(faults, serde_json::json!(["frozen", "", ""]));
    let server = page.local.wall().channels[0].server.clone();
    let began = browser.value("Date.now()").as_f64().expect("a time");
    page.local.servers[&server].signal(Signal::KILL);
    browser.await_true("redAt !== null");
    let after_ms = browser.value("redAt").as_f64().expect("a time") - began;
    assert!(after_ms < 2000.0, "{after_ms} ms");
    let text = browser.value("document.getElementById('health').textContent");
    assert!(text.as_str().is_some_and(|text| text.contains("front-1-1 lost")), "{text}");
    // Without its manager nothing is believed any more.
    page.local.manager.signal(Signal::KILL);
    browser.await_true("document.querySelectorAll('.channel.bad').length === 2");
    // A manager that comes after it may have another wall.
    let place = &page.local.place;
    let wall = place.write("other.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    let wall = wall.to_str().expect("text");
    let other = ["manager", "--listen", ANY_PORT, "--http", &page.address, wall];
    let _manager = place.start("other manager", other);
    browser.await_true("document.getElementById('align-channel').options.length === 1");
}

#[test]
fn warnings_stand_on_a_page_that_is_opened_after_they_began() {
    let text = format!(
        "{}\n[[device]]\nname = \"tracker\"\nkind = \"osc\"\nlisten = \"127.0.0.1:7000\"\n\
         [device.head]\npose = \"/head\"\n",
        polyptych_wall_file::to_toml(&small(1, 1))
    );
    let wall = polyptych_wall_file::parse(&text, "wall.toml".as_ref());
    let page = Page::start(&wall.unwrap_or_else(|error| panic!("{error}")), &[], &[]);
    // No bridge ever reads it.
    let is_told = |told: &String| told.contains("device tracker is waiting");
    let warnings = || page.local.client().status().expect("a status").warnings;
    wait::until("a warning", || warnings().iter().any(is_told).then_some(()));
    let mut browser = open(&page);
    let list = "document.getElementById('warnings')";
    browser.await_true(&format!("{list}.textContent.includes('device tracker is waiting')"));
    browser.await_true(&format!("{list}.getClientRects().length === 1"));
    browser.await_true("document.getElementById('health').className === 'wait'");
    browser.await_true("document.getElementById('health').textContent.includes('1 warning,')");
    // That an action was done with a warning is told, too.
    browser.value(ASK_WITH_A_WARNING);
    let log = "document.getElementById('log').textContent";
    browser.await_true(&format!("{log}.includes('warning: PUT /warned: nicht für immer')"));
    check_accessibility(&mut browser);
}

/// Asks for what is done with a warning, as it comes from the network: a character for each byte.
const ASK_WITH_A_WARNING: &str = r"(async () => {
    const real = window.fetch;
    const headers = { 'polyptych-warning': 'nicht f\u00c3\u00bcr immer' };
    window.fetch = (path, ...rest) =>
        path === '/warned' ? Promise.resolve(new Response('{}', { headers })) : real(path, ...rest);
    const { ask } = await import('/requests.js');
    await ask('PUT', '/warned');
    window.fetch = real;
})()";

/// A page whose first request has no answer asks again.
fn check_first_request(page: &Page, browser: &mut Browser) {
    let once = "window.real = fetch; window.fetch = () => { window.fetch = real; \
                return Promise.reject(new Error('away')); };";
    let script = serde_json::json!({ "source": once });
    browser.call("Page.addScriptToEvaluateOnNewDocument", &script);
    browser.open(&format!("http://{}/", page.address));
    browser.await_true("window.real === window.fetch && !!document.querySelector('.channel.good')");
}

/// The caption of the rate after two statuses that were told a second apart, and come at once.
const RATE_OF_STATUSES_AT_ONCE: &str = "Promise.all([import('/plots.js'), import('/state.js')])
    .then(([{ plot }, { state }]) => {
        const before = { ...state };
        for (const [frame, toldAt] of [[100, 5000], [130, 6000]]) {
            Object.assign(state, { status: { ...before.status, epoch: -1, frame }, toldAt });
            plot();
        }
        Object.assign(state, before);
        return document.getElementById('plots').lastChild.firstChild.textContent;
    })";

/// What is wrong with a channel that is live, getting ready or ready, if it has shown nothing for
/// long while the wall runs.
const FAULTS_WHILE_IT_RUNS: &str = "Promise.all([import('/health.js'), import('/state.js')]).then(
    ([{ fault }, { state }]) => {
        const before = { ...state };
        const status = { ...state.status, frame: 100 };
        Object.assign(state, { status, frameBefore: 50, statusAt: Date.now() });
        const channel = { frame: 3, revision: status.revision };
        const faults = ['live', 'preparing', 'ready'].map((of) => fault({ ...channel, state: of }));
        Object.assign(state, before);
        return faults;
    })";
