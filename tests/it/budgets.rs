//! Walls whose servers may take less memory than the scene needs: they show it coarser, alike on
//! all tiles, and say by how much; what is near comes as the camera does. A budget that holds
//! everything changes nothing.

use image::RgbaImage;
use polyptych_client::blocking::Client;
use polyptych_client::glam::{DAffine3, DVec3};
use polyptych_client::{
    Camera, ChannelState, FrameFeedback, NodeId, QualityBounds, Transaction, Wall,
};
use serde_json::json;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, screen_of, shot, small};
use crate::harness::pictures::{IDENTICAL, SEAMS, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::wait;

const VIEW: Camera = Camera { position: DVec3::new(0.0, 0.8, 4.0), ..Camera::IDENTITY };

/// Cells along each side of a sheet of hills: 115,000 triangles.
const CELLS: u32 = 240;

/// Two sheets of hills beside each other, some 7 MiB.
fn hills() -> Gltf {
    sheets(4, |row, column| {
        let at = row * (CELLS + 1) + column;
        let below = at + CELLS + 1;
        vec![at, below, at + 1, at + 1, below, below + 1]
    })
}

/// Their rows as lines, of which there are no coarser levels: some 5 MiB.
fn lines() -> Gltf {
    sheets(1, |row, column| {
        let at = row * (CELLS + 1) + column;
        vec![at, at + 1]
    })
}

fn sheets(mode: u32, cell: impl Fn(u32, u32) -> Vec<u32>) -> Gltf {
    Gltf::triangle().with(|gltf| {
        gltf.bin.clear();
        for sheet in 0..2_u8 {
            let turn = f32::from(sheet) * 1.3;
            for (row, column) in (0..=CELLS).flat_map(|row| (0..=CELLS).map(move |c| (row, c))) {
                let [x, z] = [column, row].map(|at| at as f32 / CELLS as f32 * 3.0 - 1.5);
                let y = 0.12 * (5.0 * x + turn).sin() * (4.0 * z).cos() + 0.004 * (41.0 * x).sin();
                gltf.bin.extend([x, y - 0.4, z].map(f32::to_le_bytes).concat());
            }
        }
        let vertices = (CELLS + 1) * (CELLS + 1);
        let corners: Vec<u32> = (0..CELLS)
            .flat_map(|row| (0..CELLS).map(move |column| (row, column)))
            .flat_map(|(row, column)| cell(row, column))
            .collect();
        let first = gltf.bin.len();
        gltf.bin.extend(corners.iter().flat_map(|corner| corner.to_le_bytes()));
        let positions = |sheet: u32| {
            json!({ "bufferView": 0, "byteOffset": sheet * vertices * 12, "componentType": 5126,
                "count": vertices, "type": "VEC3" })
        };
        let indices = json!({ "bufferView": 1, "componentType": 5125, "count": corners.len(),
            "type": "SCALAR" });
        gltf.json["accessors"] = json!([positions(0), positions(1), indices]);
        gltf.json["bufferViews"] = json!([
            { "buffer": 0, "byteLength": first },
            { "buffer": 0, "byteOffset": first, "byteLength": corners.len() * 4 },
        ]);
        let mesh = |sheet: u32| {
            json!({ "primitives": [
                { "attributes": { "POSITION": sheet }, "indices": 2, "mode": mode },
            ] })
        };
        gltf.json["meshes"] = json!([mesh(0), mesh(1)]);
        gltf.json["nodes"] = json!([
            { "mesh": 0, "translation": [-1.6, 0.0, 0.0] },
            { "mesh": 1, "translation": [1.6, 0.0, -1.0] },
        ]);
        gltf.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    })
}

fn wall(columns: u32, gpu_mib: Option<u32>, host_mib: Option<u32>) -> Wall {
    let mut wall = small(columns, 1);
    (wall.budget.gpu_mib, wall.budget.host_mib) = (gpu_mib, host_mib);
    wall
}

/// A wall that shows the hills.
fn shown(wall: &Wall) -> LocalWall {
    let place = TestDir::new();
    place.write("lines.glb", lines().glb());
    place.write("apart.glb", hills_apart().glb());
    let folder = place.write("hills.glb", hills().glb()).parent().expect("a folder").to_owned();
    let local = LocalWall::start_in(place, wall, &[&folder], ANY_PORT);
    local.client().open_scene("hills.glb").expect("opened");
    local
}

/// The largest of all servers' bytes on the GPU.
fn gpu_bytes(client: &Client) -> u64 {
    let status = client.status().expect("a status");
    status.channels.iter().map(|channel| channel.scene_bytes).max().expect("a channel")
}

fn picture(local: &LocalWall) -> (RgbaImage, FrameFeedback) {
    picture_from(local, VIEW)
}

/// The picture from a place once all detail is there that the budget has for it.
fn picture_from(local: &LocalWall, camera: Camera) -> (RgbaImage, FrameFeedback) {
    let client = local.client();
    client.set_camera(camera).expect("set");
    let feedback = wait::until("all detail that there is room for", || {
        let feedback = client.render_frame().expect("a frame");
        (!feedback.detail.awaits_detail).then_some(feedback)
    });
    (screen_of(&shot(&client, camera)), feedback)
}

fn budget_warning(client: &Client) -> Option<String> {
    let status = client.status().expect("a status");
    status.warnings.into_iter().find(|warning| warning.contains("budget.gpu_mib"))
}

#[test]
fn a_budget_that_holds_all_changes_nothing() {
    let [plain, roomy] = [wall(1, None, None), wall(1, Some(1000), Some(64))].map(|of| shown(&of));
    let (whole, _) = picture(&plain);
    assert!(color_count(&whole) > 50);
    let (same, feedback) = picture(&roomy);
    check("all within the budgets", &same, &whole, &IDENTICAL);
    assert_eq!(feedback.detail.largest_error_px, 0.0);
    assert_eq!(gpu_bytes(&roomy.client()), gpu_bytes(&plain.client()));
    assert_eq!(budget_warning(&roomy.client()), None);
}

#[test]
fn less_memory_shows_coarser_levels_alike_on_all_tiles_and_says_the_error() {
    let mut last = (0, f64::INFINITY);
    for mib in [1, 3] {
        let [single, mut tiled] = [1, 2].map(|columns| shown(&wall(columns, Some(mib), None)));
        let (whole, feedback) = picture(&single);
        let (bytes, error_px) = (gpu_bytes(&single.client()), feedback.detail.largest_error_px);
        println!("{mib} MiB: {bytes} bytes, {error_px} px");
        assert!(bytes <= u64::from(mib) << 20 && bytes > last.0, "{bytes}");
        assert!(error_px > 0.0 && error_px < last.1, "{error_px}");
        last = (bytes, error_px);
        let warning = budget_warning(&single.client());
        let told = format!("the budget of {mib} MiB (budget.gpu_mib) holds detail of");
        assert_eq!(warning.is_some_and(|of| of.starts_with(&told)), error_px > 0.05);
        let (tiles, _) = picture(&tiled);
        check(&format!("tiles within {mib} MiB"), &tiles, &whole, &SEAMS);
        // A server that comes later holds the same.
        let client = tiled.client();
        tiled.servers.get_mut("front-2-1").expect("there").kill();
        tiled.await_lost(&client, "front-2-1");
        tiled.start_server("front-2-1");
        await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
        let (again, _) = picture(&tiled);
        check("after a server came again", &again, &tiles, &IDENTICAL);
        assert_eq!(gpu_bytes(&client), bytes);
        // Coarser levels than those that are left out are chosen as ever.
        let error_px = 40.0;
        client.set_bounds(QualityBounds { error_px, ..QualityBounds::FINEST }).expect("set");
        let detail = client.render_frame().expect("a frame").detail;
        assert!(detail.largest_error_px <= error_px.max(last.1 * 1.01), "{detail:?}");
    }
}

/// The sheets of hills, forty units from each other.
fn hills_apart() -> Gltf {
    hills().with(|gltf| {
        gltf.json["nodes"][0]["translation"] = json!([-20.0, 0.0, 0.0]);
        gltf.json["nodes"][1]["translation"] = json!([20.0, 0.0, 0.0]);
    })
}

/// Before the one on the left, and before that on the right.
const BEFORE: [Camera; 2] = [before(-20.0), before(20.0)];

const fn before(x: f64) -> Camera {
    Camera { position: DVec3::new(x, 0.5, 2.5), ..Camera::IDENTITY }
}

#[test]
fn detail_comes_where_the_camera_goes_within_the_budget_and_alike_everywhere() {
    let mib = 5;
    let [single, mut tiled] = [1, 2].map(|columns| {
        let local = shown(&wall(columns, Some(mib), None));
        local.client().open_scene("apart.glb").expect("opened");
        local
    });
    let mut last = None;
    for (turn, camera) in [BEFORE[0], BEFORE[1], BEFORE[0]].into_iter().enumerate() {
        let client = single.client();
        client.set_camera(camera).expect("set");
        let before = client.render_frame().expect("a frame").detail;
        let (whole, after) = picture_from(&single, camera);
        let [coarse, fine] = [before.largest_error_px, after.detail.largest_error_px];
        let bytes = gpu_bytes(&client);
        println!("{mib} MiB, camera {turn}: {coarse} px, then {fine} px, {bytes} bytes");
        assert!(before.awaits_detail && fine < 0.7 * coarse, "{coarse} px, then {fine} px");
        assert!(bytes <= u64::from(mib) << 20, "{bytes}");
        let (tiles, _) = picture_from(&tiled, camera);
        check("tiles beside each other", &tiles, &whole, &SEAMS);
        if let Some(seen) = last.replace(whole.clone()) {
            assert_ne!(seen, whole, "cameras see different sheets");
        }
    }
    // A server that comes later holds the same, by what the others were told last.
    let client = tiled.client();
    let (before, _) = picture_from(&tiled, BEFORE[0]);
    tiled.servers.get_mut("front-1-1").expect("there").kill();
    tiled.await_lost(&client, "front-1-1");
    tiled.start_server("front-1-1");
    await_states(&client, &[ChannelState::Live, ChannelState::Ready]);
    check("after a server came again", &picture_from(&tiled, BEFORE[0]).0, &before, &IDENTICAL);
}

#[test]
fn a_node_that_is_moved_to_the_camera_gets_its_detail() {
    let local = shown(&wall(1, Some(5), None));
    let client = local.client();
    client.open_scene("apart.glb").expect("opened");
    let (_, left) = picture_from(&local, BEFORE[0]);
    picture_from(&local, BEFORE[1]);
    // The sheet on the left comes where that on the right was, which goes far away.
    let mut change = Transaction::default();
    let at = |x: f64, z: f64| DAffine3::from_translation(DVec3::new(x, 0.0, z));
    change.set_transform(NodeId(1), at(0.0, -500.0));
    change.set_transform(NodeId(0), at(20.0, 0.0));
    client.commit(change).expect("moved");
    let (_, right) = picture_from(&local, BEFORE[1]);
    let [left, right] = [left, right].map(|of| of.detail.largest_error_px);
    println!("{left} px on the left, {right} px on the right");
    assert!(left > 0.0 && (right - left).abs() < 0.01 * left, "{left} and {right} px");
}

#[test]
fn a_budget_below_the_coarsest_is_refused_with_the_least_that_works() {
    let local = shown(&wall(1, Some(1), None));
    let before = picture(&local).0;
    let refused = local.client().open_scene("lines.glb").expect_err("too large");
    let reason = refused.to_string();
    for part in ["budget.gpu_mib is 1;", "write at least "] {
        assert!(reason.contains(part), "{part:?} is not in {reason:?}");
    }
    check("the scene before", &picture(&local).0, &before, &IDENTICAL);
    let least = reason
        .split("write at least ")
        .nth(1)
        .and_then(|rest| rest.split(|c: char| !c.is_ascii_digit()).next()?.parse::<u32>().ok());
    let least = least.unwrap_or_else(|| panic!("no number in {reason:?}"));
    let enough = shown(&wall(1, Some(least), None));
    enough.client().open_scene("lines.glb").expect("opened");
    assert!(gpu_bytes(&enough.client()) <= u64::from(least) << 20);
    let short = shown(&wall(1, Some(least - 1), None));
    assert!(short.client().open_scene("lines.glb").is_err());
}
