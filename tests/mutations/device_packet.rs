//! Damaged packets of OSC and streams of VRPN: whatever a device says, the head is one that can be.

use allocation_counter::measure;
use fastrand::Rng;
use polyptych_devices::Bridge;
use polyptych_devices::vrpn::{COOKIE, VrpnStream};
use polyptych_protocol::request::Request;
use polyptych_wall::Wall;

use crate::mutation::mutate;

const PACKETS: u64 = 60_000;

/// Maximum number of bytes that one packet may take, beside 64 for each of its own.
const HELD_ANYWAY: u64 = 64 << 10;

const WALL: &str = r#"
[wall]
name = "w"
[[screen]]
name = "front"
size = [2.0, 1.0]
center = [0.0, 0.0, -1.0]
[screen.tiles]
pixels = [200, 100]
[[device]]
name = "tracker"
kind = "osc"
listen = "127.0.0.1:9000"
[device.head]
position = "/p"
rotation = "/r"
prediction_ms = 30
bounds = [[-3.0, -3.0, -0.9], [3.0, 3.0, 3.0]]
[device.fly]
forward = "/s[1]"
"#;

fn floats(address: &str, numbers: &[f32]) -> Vec<u8> {
    let mut packet = address.as_bytes().to_vec();
    packet.resize((address.len() + 1).next_multiple_of(4), 0);
    let types = format!(",{}", "f".repeat(numbers.len()));
    packet.extend(types.as_bytes());
    packet.resize(packet.len() + 4 - types.len() % 4, 0);
    packet.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
    packet
}

fn bundle(elements: &[Vec<u8>]) -> Vec<u8> {
    let mut packet = b"#bundle\0\xea\x60\x5b\x31\0\0\0\0".to_vec();
    for element in elements {
        packet.extend((element.len() as u32).to_be_bytes());
        packet.extend(element);
    }
    packet
}

fn seeds() -> Vec<Vec<u8>> {
    let position = floats("/p", &[0.1, 0.2, 0.3]);
    let rotation = floats("/r", &[0.0, 0.6, 0.0, 0.8]);
    let all =
        b"/a\0\0,ihfdsbTFNI\0\0\0\0\0\x07\0\0\0\0\0\0\0\x07\x3f\x80\0\0\x3f\xf0\0\0\0\0\0\0hi\0\0\
        \0\0\0\x03abc\0";
    vec![
        bundle(&[position.clone(), rotation.clone()]),
        bundle(&[bundle(std::slice::from_ref(&position)), all.to_vec()]),
        floats("/s", &[0.0, 0.5]),
        position,
        rotation,
        all.to_vec(),
    ]
}

fn stream() -> Vec<u8> {
    let mut bytes = COOKIE.to_vec();
    let mut message = |sender: i32, kind: i32, body: &[u8]| {
        let head = [24 + body.len() as i32, 5, 6, sender, kind, 0];
        bytes.extend(head.iter().flat_map(|number| number.to_be_bytes()));
        bytes.extend(body);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
    };
    message(1, -1, b"\0\0\0\x09Tracker0\0");
    message(2, -2, b"\0\0\0\x16vrpn_Tracker Pos_Quat\0");
    let numbers = [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0_f64];
    let mut body = vec![0; 8];
    body.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
    message(1, 2, &body);
    message(1, 2, &body);
    bytes
}

#[test]
fn damaged_packets_move_the_head_to_where_it_can_be_or_not_at_all() {
    let wall: Wall = polyptych_wall_file::parse(WALL, "wall.toml".as_ref()).expect("a wall");
    let (seeds, from) = (seeds(), "127.0.0.1:5".parse().expect("an address"));
    let mut bridge = Bridge::new(&wall);
    let (mut heads, mut flights) = (0, 0);
    for number in 0..PACKETS {
        let mut rng = Rng::with_seed(crate::seed().wrapping_add(number));
        let now = number * 4_000;
        let mut packet = seeds[rng.usize(0..seeds.len())].clone();
        if rng.u8(0..4) != 0 {
            let other = &seeds[rng.usize(0..seeds.len())];
            mutate(&mut rng, &mut packet, other);
        }
        let taken = measure(|| bridge.handle_packet(now, 0, from, &packet));
        assert!(taken.bytes_max < HELD_ANYWAY + 64 * packet.len() as u64, "{number}: {taken:?}");
        bridge.handle_swap(now, 4_000);
        while let Some((purpose, request)) = bridge.poll_request(now) {
            match request {
                Request::SetHead(head) => {
                    let pose = head.apply(&wall.head());
                    assert_eq!(wall.check_head(&pose), Ok(()), "{number}");
                    heads += 1;
                }
                Request::Fly(flight) => {
                    assert!(flight.is_valid() && flight.offset_m.length() <= 0.2, "{flight:?}");
                    flights += 1;
                }
                _ => {}
            }
            bridge.handle_answer(now, purpose, Ok(()));
        }
        for event in bridge.take_events() {
            assert!(event.len() < 400 && !event.contains('\n'), "{event:?}");
        }
    }
    assert!(heads > PACKETS / 10 && flights > PACKETS / 10, "{heads} heads, {flights} flights");
}

#[test]
fn damaged_streams_of_vrpn_end_or_give_finite_poses() {
    let whole = stream();
    let mut poses = 0;
    for number in 0..PACKETS / 4 {
        let mut rng = Rng::with_seed(crate::seed().wrapping_add(number));
        let mut bytes = whole.clone();
        mutate(&mut rng, &mut bytes, &whole);
        let mut stream = VrpnStream::new("Tracker0", 0);
        for part in bytes.chunks(rng.usize(1..200)) {
            let Ok(readings) = stream.read(part) else { break };
            for pose in readings.into_iter().flatten() {
                let turn = pose.rotation.expect("VRPN has rotations");
                assert!(pose.position.is_finite() && turn.is_finite(), "{number}");
                poses += 1;
            }
        }
    }
    assert!(poses > PACKETS / 8, "{poses} poses");
}
