//! Every route once, with its effect on the wall as a client over TCP sees it.

use std::collections::BTreeSet;

use polyptych_client::OutputMode;
use polyptych_client::glam::DVec3;
use serde_json::{Value, json};

use super::page::Page;
use crate::harness::local_wall::small;
use crate::harness::scenes::town;

#[test]
fn every_route_does_what_the_request_of_tcp_does() {
    let wall = small(2, 1);
    let folder = town().parent().expect("a folder");
    let page = Page::start(&wall, &[folder], &["--record", "wall.rec"]);
    check_wall(&page);
    check_scene(&page);
    check_camera(&page);
    check_presentation(&page);
    check_requests(&page);
    check_session(&page);

    let description = page.ask("GET", "/openapi.json", None).value();
    let described: BTreeSet<(String, String)> = description["paths"]
        .as_object()
        .expect("paths")
        .iter()
        .flat_map(|(path, methods)| {
            let path = path.strip_prefix("/api/v1").expect("the base").to_owned();
            let methods = methods.as_object().expect("methods");
            methods.keys().map(move |method| (method.to_uppercase(), path.clone()))
        })
        .collect();
    assert_eq!(*page.asked.borrow(), described, "each route of the description is asked here");

    // What was asked over HTTP was recorded, and is decided again in the same way.
    let told = page.local.place.run(["stop", "--manager", &page.local.address]);
    told.succeeded();
    let replayed = page.local.place.run(["replay", "wall.rec"]).succeeded();
    assert!(replayed.contains("all the same"), "{replayed}");
    assert!(replayed.contains("set the camera") && replayed.contains("http "), "{replayed}");
}

fn check_wall(page: &Page) {
    let client = page.local.client();
    let status = page.route("GET", "/status", &[], None).value();
    let own = json!(client.status().expect("a status"));
    assert_eq!(status["channels"].as_array().map(Vec::len), Some(2));
    let keys = |of: &Value| of.as_object().expect("an object").keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&status), keys(&own));
    assert_eq!(status["epoch"], own["epoch"]);
    let wall = page.route("GET", "/wall", &[], None).value();
    assert_eq!(wall, json!(client.wall().expect("a wall")));
    let frame = page.route("POST", "/frame", &[], Some(json!({ "time_s": 2.5 }))).value();
    assert_eq!(frame["time_s"], 2.5);
    assert_eq!(client.status().expect("a status").frame.0, frame["frame"]);
    assert_eq!(page.route("GET", "/statistics", &[], None).value()["frames"], 1);
    page.route("POST", "/statistics/reset", &[], None).value();
    assert_eq!(page.route("GET", "/devices", &[], None).value(), json!([]));
    assert_eq!(page.route("GET", "/statistics", &[], None).value()["frames"], 0);
    page.route("PUT", "/pace", &[], Some(json!({ "rate": 1000.0, "is_free": true })))
        .refused(400, "not both");
    page.route("PUT", "/pace", &[], Some(json!({ "rate": 1e9 }))).refused(422, "a rate is");
    assert_eq!(page.route("PUT", "/pace", &[], None).value()["done"], true);
    let changes = json!({ "changes": [{ "Gain": [1.0, 0.5, 1.0] }] });
    page.route("POST", "/channels/{name}/calibration", &["front-1-1"], Some(changes)).value();
    let gain = client.wall().expect("a wall").channels[0].adjustment.color.gain;
    assert_eq!(gain, DVec3::new(1.0, 0.5, 1.0));
    let changes = json!({ "changes": [{ "Gain": [1.0, 1.0, 1.0] }] });
    page.route("POST", "/channels/{name}/calibration", &["front-1-1"], Some(changes)).value();
    for path in ["/wall.{format}", "/screens/{name}.{format}", "/channels/{name}.{format}"] {
        let names: &[&str] = match path {
            "/wall.{format}" => &["png"],
            "/screens/{name}.{format}" => &["front", "jpg"],
            _ => &["front-2-1", "rgba"],
        };
        let answer = page.route("GET", path, names, None);
        assert_eq!(answer.code, 200, "{path}");
        assert!(answer.body.len() > 100, "{path}");
    }
    check_capture(page);
    page.ask("GET", "/channels/attic.png", None).refused(404, "front-1-1, front-2-1");
}

fn check_capture(page: &Page) {
    let answer = page.route("GET", "/capture?width=48&format=rgba", &[], None);
    assert_eq!((answer.code, answer.header("content-type")), (200, Some("application/x-tar")));
    let size = |at: usize| {
        let digits = std::str::from_utf8(&answer.body[at + 124..at + 135]).expect("digits");
        usize::from_str_radix(digits, 8).expect("a size")
    };
    let (mut at, mut files) = (0, Vec::new());
    while answer.body[at] != 0 {
        let name = answer.body[at..at + 100].split(|byte| *byte == 0).next().expect("a name");
        files.push((String::from_utf8_lossy(name).into_owned(), size(at)));
        at += 512 + size(at).next_multiple_of(512);
    }
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let channels = ["channels/front-1-1.rgba", "channels/front-2-1.rgba"];
    assert_eq!(names, ["screens/front.rgba", channels[0], channels[1], "capture.json"]);
    assert_eq!((files[0].1, files[1].1), (48 * 27 * 4, 48 * 54 * 4));
    page.ask("GET", "/capture?format=gif", None).refused(400, "png, jpg or rgba");
}

fn check_scene(page: &Page) {
    let client = page.local.client();
    let open = |path: &str| page.route("POST", "/scene/open", &[], Some(json!({ "path": path })));
    open("attic.glb").refused(422, "attic.glb");
    open("../../etc/passwd").refused(422, "passwd");
    let files = page.route("GET", "/scene/files", &[], None).value();
    let files = files["files"].as_array().expect("files");
    assert!(files.iter().any(|of| of["path"] == "town.glb"), "{files:?}");
    assert_eq!(page.route("GET", "/scene/previews", &[], None).value(), json!([]));
    page.route("GET", "/scene/previews/{name}.{format}", &["town", "jpg"], None)
        .refused(404, "has no preview");
    let opened = open("town.glb").value();
    assert_eq!(opened["scene"]["name"], "town");
    assert_eq!(opened["frame"]["channels"][0]["state"], "live");
    let camera = client.status().expect("a status").presentation.camera;
    assert!(camera.position.length() > 10.0, "all of the town is seen: {camera:?}");
    let scene = page.route("GET", "/scene", &[], None).value();
    assert_eq!(scene["scene"], "town");
    let nodes = json!({ "name": null, "below": null, "attribute": null, "layer": null,
        "kind": null, "skip": 0, "count": 3 });
    let nodes = page.route("POST", "/scene/nodes", &[], Some(nodes)).value();
    let node = nodes["nodes"][0]["id"].clone();
    let hide = json!({ "base": null, "is_temporary": false, "assets": null,
        "edits": [{ "SetVisible": { "node": node, "visible": false } }] });
    page.route("POST", "/transaction", &[], Some(hide)).value();
    page.route("POST", "/transaction", &[], Some(json!({ "edits": [1] }))).refused(400, "line 1");
    assert_eq!(page.route("GET", "/scene/layers", &[], None).code, 200);
    assert_eq!(page.route("GET", "/scene/variants", &[], None).value()["names"], json!([]));
    page.route("PUT", "/scene/variant", &[], Some(json!({ "name": "red" })))
        .refused(422, "no variants");
    assert_eq!(page.route("GET", "/scene/animations", &[], None).value(), json!([]));
    let play = json!({ "clip": "walk", "action": "Pause" });
    page.route("POST", "/scene/animations", &[], Some(play)).refused(422, "");
    let middle = json!({ "screen": "front", "pixel": [240.5, 136.5] });
    let hit = page.route("POST", "/pick", &[], Some(middle)).value();
    assert!(hit["distance"].as_f64().is_some_and(|distance| distance > 1.0), "{hit}");
    page.ask("POST", "/pick", Some(&json!({ "screen": "attic", "pixel": [0, 0] })))
        .refused(422, "it has front");
    page.ask("POST", "/pick", Some(&json!({ "screen": "front", "pixel": [0, 999] })))
        .refused(422, "480 × 272 pixels");
    let file = page.route("GET", "/scene/export.glb", &[], None);
    assert_eq!((file.code, &file.body[..4]), (200, &b"glTF"[..]));
    let told = u32::from_le_bytes(file.body[8..12].try_into().expect("a length"));
    assert_eq!(file.body.len(), told as usize, "the whole file");
    page.ask("GET", "/scene/export.glb?saved=attic", None).refused(422, "no scene is saved");
    page.route("PUT", "/scene/saved/{name}", &["evening%20light"], None).value();
    let saved = page.route("GET", "/scene/saved", &[], None).value();
    assert_eq!(saved[0]["name"], "evening light");
    page.route("DELETE", "/scene/saved/{name}", &["evening%20light"], None).value();
    check_saved_sessions(page);
    page.route("PUT", "/environment", &[], Some(json!({ "is_sky": true }))).value();
    assert_eq!(client.status().expect("a status").environment.as_deref(), Some("sky"));
    page.route("PUT", "/environment", &[], Some(json!({}))).value();
    page.route("POST", "/scene/close", &[], None).value();
    assert_eq!(client.status().expect("a status").scene, None);
    open("town.glb").value();
}

fn check_saved_sessions(page: &Page) {
    let client = page.local.client();
    page.route("PUT", "/sessions/{name}", &["evening"], None).value();
    assert_eq!(page.route("GET", "/sessions", &[], None).value()[0]["scene"], "town");
    client.set_camera(polyptych_client::Camera::IDENTITY).expect("set");
    let opened = page.route("POST", "/sessions/{name}/open", &["evening"], None).value();
    assert_eq!((&opened["scene"]["name"], &opened["left_out"]), (&json!("town"), &json!([])));
    let camera = client.status().expect("a status").presentation.camera;
    assert_ne!(camera, polyptych_client::Camera::IDENTITY);
    page.route("DELETE", "/sessions/{name}", &["evening"], None).value();
    page.ask("POST", "/sessions/evening/open", None).refused(422, "saved: none is");
}

fn check_camera(page: &Page) {
    let client = page.local.client();
    let look = json!({ "position": [1.0, 2.0, 3.0], "target": [1.0, 2.0, -3.0], "scale": 2.0 });
    page.route("PUT", "/camera", &[], Some(look)).value();
    let camera = client.status().expect("a status").presentation.camera;
    assert_eq!((camera.position, camera.scale), (DVec3::new(1.0, 2.0, 3.0), 2.0));
    assert!((camera.rotation * DVec3::NEG_Z - DVec3::NEG_Z).length() < 1e-12);
    let told = page.route("GET", "/camera", &[], None).value();
    assert_eq!(told, json!(camera));
    page.ask("PUT", "/camera", Some(&told)).value();
    for (body, code, part) in [
        (json!({ "position": [1.0, 2.0, 3.0] }), 400, "either a rotation or a target"),
        (json!({ "position": [1.0, 2.0] }), 400, "the body"),
        (json!({ "position": "here", "target": [0, 0, 0] }), 400, "invalid type: string"),
        (json!([]), 400, "the body is not what is asked for"),
        (json!({ "position": [0, 0, 0], "target": [0, 0, 0], "speed": 1 }), 400, "`speed`"),
        (json!({ "position": [0, 0, 0], "rotation": [0, 0, 0, 9] }), 422, "unit quaternion"),
        (json!({ "position": [0, 0, 0], "target": [0, 0, -1], "scale": -1 }), 422, "above 0"),
    ] {
        page.ask("PUT", "/camera", Some(&body)).refused(code, part);
    }
    let flight = json!({ "offset_m": [0.0, 0.0, -0.5], "turn_rad": [0.0, 0.0] });
    page.route("POST", "/camera/fly", &[], Some(flight)).value();
    let flown = client.status().expect("a status").presentation.camera;
    assert_eq!(flown.position, DVec3::new(1.0, 2.0, 2.0), "two world units are a metre");
    let back = json!({ "offset_m": [0.0, 0.0, 0.5], "turn_rad": [0.0, 0.0] });
    page.ask("POST", "/camera/fly", Some(&back)).value();
    let far = json!({ "offset_m": [1e300, 0.0, 0.0], "turn_rad": [0.0, 0.0] });
    page.ask("POST", "/camera/fly", Some(&far)).refused(422, "leads too far");
    let head = json!({ "position": [0.1, 0.0, 0.0], "rotation": null, "eye_separation_m": null });
    page.route("PUT", "/head", &[], Some(head)).value();
    assert_eq!(page.route("GET", "/head", &[], None).value()["position"], json!([0.1, 0.0, 0.0]));
    page.route("PUT", "/overlays", &[], Some(json!({ "views": [] }))).value();
    page.route("PUT", "/views/{name}", &["quay"], Some(json!({}))).value();
    page.ask("PUT", "/camera", Some(&json!({ "position": [9, 9, 9], "target": [0, 0, 0] })))
        .value();
    page.route("POST", "/views/{name}/show", &["quay"], None).value();
    assert_eq!(client.status().expect("a status").presentation.camera, camera);
    page.ask("POST", "/views/attic/show", None).refused(404, "there are: quay");
    assert_eq!(page.route("GET", "/views", &[], None).value()[0]["name"], "quay");
    page.route("DELETE", "/views/{name}", &["quay"], None).value();
    page.ask("DELETE", "/views/quay", None).refused(422, "quay");
    let stop = json!({ "camera": camera, "travel_s": 1.0 });
    page.route("PUT", "/tour", &[], Some(json!({ "stops": [stop], "is_loop": "no" })))
        .refused(400, "the body");
    assert_eq!(page.route("GET", "/tour", &[], None).value()["tour"], Value::Null);
    page.route("DELETE", "/tour", &[], None).value();
}

fn check_presentation(page: &Page) {
    let client = page.local.client();
    page.route("PUT", "/displays", &[], Some(json!({ "mode": "blank" }))).value();
    let shown = client.status().expect("a status").presentation;
    assert_eq!(shown.output_mode, OutputMode::Blank);
    page.ask("PUT", "/displays", Some(&json!({ "mode": "normal" }))).value();
    page.ask("PUT", "/displays", Some(&json!({ "mode": "off" }))).refused(400, "`normal`");
    page.route("PUT", "/pattern", &[], Some(json!({ "pattern": "grid" }))).value();
    page.ask("PUT", "/pattern", Some(&json!({ "pattern": null }))).value();
    let marker = json!({ "marker": { "channel": "front-1-1", "point": { "Edge": "left" } } });
    page.route("PUT", "/marker", &[], Some(marker)).value();
    page.ask("PUT", "/marker", Some(&json!({ "marker": null }))).value();
    page.route("PUT", "/rest", &[], Some(json!({ "idle_s": 3600.0 }))).value();
    assert_eq!(page.route("GET", "/rest", &[], None).value()["rules"]["idle_s"], 3600.0);
    let hours = json!({ "hours": { "from_min": 9999, "until_min": 0 } });
    page.ask("PUT", "/rest", Some(&hours)).refused(422, "0 to 1440");
    page.ask("PUT", "/rest", Some(&json!({}))).value();
    page.route("PUT", "/exposure", &[], Some(json!({ "stops": 1.0 }))).value();
    page.ask("PUT", "/exposure", Some(&json!({ "stops": 1e300 }))).refused(400, "stops are");
    page.ask("PUT", "/exposure", Some(&json!({ "factor": -1 }))).refused(422, "exposure is 0");
    // A number that f32 cannot hold.
    page.ask("PUT", "/exposure", Some(&json!({ "factor": 1e300 })))
        .refused(400, "number out of range");
    page.route("PUT", "/tone", &[], Some(json!({ "tone": "Aces" }))).value();
    page.route("PUT", "/fog", &[], Some(json!({ "fog": null }))).value();
    page.route("PUT", "/glow", &[], Some(json!({ "glow": null }))).value();
    let none = json!({ "ambient_occlusion": null });
    page.route("PUT", "/ambient_occlusion", &[], Some(none)).value();
    page.route("PUT", "/depth_of_field", &[], Some(json!({ "depth_of_field": null }))).value();
    let bounds = json!({ "error_px": 0.5, "rate_fps": null });
    page.route("PUT", "/bounds", &[], Some(bounds)).value();
    page.ask("PUT", "/bounds", Some(&json!({ "error_px": 1e308, "rate_fps": null })))
        .refused(422, "0 to 64");
    let shown = page.route("GET", "/presentation", &[], None).value();
    assert_eq!((&shown["exposure"], &shown["tone"]), (&json!(2.0), &json!("Aces")));
    assert_eq!(shown["bounds"]["error_px"], 0.5);
    assert_eq!(shown, json!(client.status().expect("a status").presentation));
}

fn check_requests(page: &Page) {
    let ask = |body: Value| page.route("POST", "/requests", &[], Some(body));
    let status = ask(json!("Status")).value();
    assert_eq!(status["response"]["Status"]["wall"], "small");
    assert_eq!(status["warnings"], json!([]));
    let done = ask(json!({ "SetExposure": 1.0 })).value();
    assert_eq!(done["response"], "Done");
    // Refusals are those of TCP, word for word.
    let client = page.local.client();
    let told = client.remove_view("attic").expect_err("no such view").to_string();
    let answer = ask(json!({ "RemoveView": { "name": "attic" } }));
    let refused: Value = serde_json::from_slice(&answer.body).expect("JSON");
    let reason = refused["error"].as_str().expect("a reason");
    assert!(answer.code == 422 && told.contains(reason), "{told:?} and {reason:?}");
    ask(json!("Explode")).refused(400, "unknown variant `Explode`");
    ask(json!({ "Capture": { "time_s": null } })).refused(400, "GET /api/v1/wall.png");
    ask(json!({ "Subscribe": true })).refused(400, "GET /api/v1/events");
}

fn check_session(page: &Page) {
    page.route("GET", "/openapi.json", &[], None).value();
    let nonce = json!({ "nonce": "0123456789abcdef" });
    let challenge = page.route("POST", "/login/challenge", &[], Some(nonce)).value();
    let code = json!({ "nonce": challenge["nonce"], "proof": challenge["proof"] });
    page.route("POST", "/login/code", &[], Some(code)).refused(401, "token");
    page.route("GET", "/live", &[], None).refused(426, "WebSocket");
    // A stream does not end by itself; `hostile` reads it.
    page.asked.borrow_mut().insert(("GET".into(), "/events".into()));
}
