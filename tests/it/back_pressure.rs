//! Peers that flood, or that do not read: they are let go with a reason, the memory that they cost
//! has a limit, and the wall goes on for the others.

use std::io::Cursor;
use std::net::SocketAddr;
use std::path::Path;

use image::{ImageFormat, Rgb, RgbImage};
use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, Pacing};
use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret};
use polyptych_protocol::handshake_io::{MessageStream, send_hello};
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{Request, RequestMessage};
use polyptych_protocol::token;
use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small, start_server};
use crate::harness::place::TestDir;
use crate::harness::relay::Relay;
use crate::harness::scenes::{Gltf, town};
use crate::harness::{signals, wait};

/// Maximum growth of the manager's memory for one peer here: its outbox of 512 answers of a
/// kilobyte, a few pictures of a mebibyte, and the overhead of an allocator for both.
const GROWTH_BYTES_MAX: u64 = 48 << 20;

/// Longest time without a frame that still is "goes on": a quarter of the second after which
/// people call a picture frozen, and four times what a busy machine takes from a frame.
const GAP_MS_MAX: f64 = 250.0;

#[test]
fn a_client_that_floods_and_never_reads_is_let_go_and_others_do_not_notice() {
    let mut local = LocalWall::start(&small(2, 1), &[town().parent().expect("a folder")]);
    let client = running(&local);
    let before = memory_bytes(&local);
    let (sent, _held) = flood(&local, |_| Request::Status, 400_000);
    assert!(sent > 512, "a few hundred are no flood: {sent}");
    local.manager.await_line(&["client leaves", "it has read nothing for 10 s"]);
    check(&local, &client, before);
}

#[test]
fn pictures_that_nobody_reads_wait_in_a_bounded_space() {
    let local = LocalWall::start(&small(2, 1), &[town().parent().expect("a folder")]);
    let client = running(&local);
    let before = memory_bytes(&local);
    let runtime = runtime();
    let stream = runtime.block_on(async {
        let mut stream = connect(&local).await;
        stream.write_all(&call(0, Request::Subscribe(true))).await.expect("sent");
        // As many as one client may have under way: 64 MiB of pictures.
        for id in 1..=60 {
            stream.write_all(&call(id, Request::Capture { time_s: None })).await.expect("sent");
        }
        stream
    });
    for _ in 0..3 {
        assert_eq!(client.capture().expect("pictures for one who reads").missing, []);
    }
    let held = 60 << 20;
    check(&local, &client, before + held);
    drop(stream);
}

#[test]
fn a_scene_on_a_link_that_stands_still_holds_nobody_else() {
    let place = TestDir::new();
    let scenes = place.path("scenes");
    place.write("scenes/heavy.glb", heavy());
    let wall = small(2, 1);
    let mut local = LocalWall::manager(place, &wall, &[&scenes as &Path], ANY_PORT);
    let [quick, slow] = [0, 1].map(|index| wall.channels[index].server.clone());
    local.start_server(&quick);
    let client = running(&local);
    client.open_scene("heavy.glb").expect("opened");
    let before = memory_bytes(&local);
    let relay = Relay::holding_bulk_after(1 << 20, &local.address);
    let server = start_server(&local.place, &wall, &slow, &relay.address);
    local.servers.insert(slow, server);
    wait::until("the slow one gets ready", || {
        let status = client.status().expect("status");
        (status.channels[1].state == ChannelState::Preparing).then_some(())
    });
    client.statistics(true).expect("forgotten");
    let first = client.status().expect("status").frame;
    wait::until("frames meanwhile", || {
        let status = client.status().expect("status");
        assert_eq!(status.channels[1].state, ChannelState::Preparing, "its link stands still");
        (status.frame.0 > first.0 + 60).then_some(())
    });
    check(&local, &client, before);
    relay.release();
    await_states(&client, &[ChannelState::Live]);
}

/// A client that has the wall draw at 60 frames per second, and has measured nothing yet.
fn running(local: &LocalWall) -> Client {
    let client = local.client();
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    wait::until("a live channel", || {
        let channels = client.status().expect("status").channels;
        channels.iter().any(|channel| channel.state == ChannelState::Live).then_some(())
    });
    client.statistics(true).expect("forgotten");
    client
}

/// The wall went on, and the manager has not grown.
#[track_caller]
fn check(local: &LocalWall, client: &Client, before: u64) {
    let statistics = client.statistics(false).expect("statistics");
    let gap = statistics.channels[0].longest_gap_ms;
    assert!(gap < GAP_MS_MAX, "no frame for {gap} ms");
    let grown = memory_bytes(local).saturating_sub(before);
    println!("longest gap {gap:.0} ms; manager grown by {} KiB", grown >> 10);
    assert!(grown < GROWTH_BYTES_MAX, "the manager has grown by {} MiB", grown >> 20);
}

/// Sends requests and reads nothing, until the manager closes the connection or all are sent. Gives
/// how many, and the connection.
fn flood(local: &LocalWall, request: impl Fn(u64) -> Request, most: u64) -> (u64, TcpStream) {
    runtime().block_on(async {
        let mut stream = connect(local).await;
        for id in 0..most {
            if stream.write_all(&call(id, request(id))).await.is_err() {
                return (id, stream);
            }
        }
        (most, stream)
    })
}

fn call(id: u64, request: Request) -> Vec<u8> {
    polyptych_codec::framed(&polyptych_codec::encode(&RequestMessage::new(RequestId(id), request)))
        .to_vec()
}

fn runtime() -> tokio::runtime::Runtime {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    builder.enable_all().build().expect("a runtime")
}

/// A client's connection without a client library, which would read.
async fn connect(local: &LocalWall) -> TcpStream {
    let address: SocketAddr = local.address.parse().expect("an address");
    let token = token::read(&local.place.token_file()).expect("a token");
    let hello = ClientHello { name: "flood".into() };
    let stream = TcpStream::connect(address).await.expect("connected");
    let introduced = send_hello(stream, Role::Client, &Hello::Client(hello), &Secret(token)).await;
    let (frames, _): (MessageStream<TcpStream>, _) = introduced.expect("welcome");
    frames.into_inner()
}

/// A scene with a texture of some 20 MB, more than the system keeps in its socket buffers.
pub fn heavy() -> Vec<u8> {
    const SIDE: u32 = 2048;
    let mut random = fastrand::Rng::with_seed(3);
    let noise = RgbImage::from_fn(SIDE, SIDE, |_, _| Rgb([random.u8(..); 3]));
    let mut png = Cursor::new(Vec::new());
    noise.write_to(&mut png, ImageFormat::Png).expect("encoded");
    let png = png.into_inner();
    let mut gltf = Gltf::triangle();
    let uvs: Vec<u8> = [0.0_f32, 0.0, 1.0, 0.0, 0.0, 1.0].map(f32::to_le_bytes).concat();
    let uvs = gltf.accessor("VEC2", 5126, 3, &uvs);
    let view = json!({ "buffer": 0, "byteOffset": gltf.bin.len(), "byteLength": png.len() });
    gltf.bin.extend(png);
    let views = gltf.json["bufferViews"].as_array_mut().expect("a list");
    views.push(view);
    gltf.json["images"] = json!([{ "bufferView": views.len() - 1, "mimeType": "image/png" }]);
    gltf.json["textures"] = json!([{ "source": 0 }]);
    let texture = json!({ "baseColorTexture": { "index": 0 } });
    gltf.json["materials"] = json!([{ "pbrMetallicRoughness": texture }]);
    let primitive = &mut gltf.json["meshes"][0]["primitives"][0];
    primitive["material"] = json!(0);
    primitive["attributes"]["TEXCOORD_0"] = json!(uvs);
    gltf.glb()
}

/// Resident memory of the manager.
fn memory_bytes(local: &LocalWall) -> u64 {
    signals::memory_bytes_of(local.manager.pid()).expect("it runs")
}
