//! Equal commands give equal bytes, whichever server draws.

use polyptych_client::blocking::Client;
use polyptych_client::{Camera, Capture, ChannelState, Wall};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, shot, small};
use crate::harness::pictures::{IDENTICAL, check, color_count, image_of};
use crate::harness::place::TestDir;
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

/// Opens the town; gives a few poses of it.
fn open_town(client: &Client) -> Vec<Camera> {
    let summary = client.open_scene(town().display().to_string()).expect("opened");
    poses(&summary.bounds.expect("bounds")).into_iter().skip(1).step_by(2).collect()
}

fn start(wall: &Wall) -> (LocalWall, Client, Vec<Camera>) {
    let local = LocalWall::start(wall, &[town().parent().expect("a folder")]);
    let client = local.client();
    let poses = open_town(&client);
    (local, client, poses)
}

#[track_caller]
fn check_twins(name: &str, actual: &Capture, expected: &Capture) {
    assert_eq!(actual.channels.len(), expected.channels.len());
    for (a, b) in actual.channels.iter().zip(&expected.channels) {
        assert_eq!(a.name, b.name);
        check(&format!("twins {name} {}", a.name), &image_of(a), &image_of(b), &IDENTICAL);
    }
}

#[test]
fn one_server_for_all_channels_draws_what_one_for_each_draws() {
    let each = small(2, 2);
    let mut one = each.clone();
    one.channels.iter_mut().for_each(|channel| channel.server = "all".into());
    let (many, client_of_many, poses) = start(&each);
    let (single, client_of_one, _) = start(&one);
    assert_eq!((many.servers.len(), single.servers.len()), (4, 1));
    for (number, camera) in poses.into_iter().enumerate() {
        let [a, b] = [&client_of_many, &client_of_one].map(|client| shot(client, camera));
        assert!(a.channels.iter().any(|picture| color_count(&image_of(picture)) > 100));
        check_twins(&format!("servers {number}"), &a, &b);
    }
}

#[test]
fn a_picture_depends_on_no_earlier_one_and_on_no_start() {
    let (mut local, client, poses) = start(&small(2, 1));
    let first: Vec<Capture> = poses.iter().map(|camera| shot(&client, *camera)).collect();
    // The other way round: what was drawn before is another picture each time.
    for (number, camera) in poses.iter().enumerate().rev() {
        check_twins(&format!("history {number}"), &shot(&client, *camera), &first[number]);
    }
    // A server that has seen nothing of all this.
    let name = local.servers.keys().next().expect("a server").clone();
    local.servers.get_mut(&name).expect("the server").kill();
    local.await_lost(&client, &name);
    local.start_server(&name);
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    for (number, camera) in poses.iter().enumerate() {
        check_twins(&format!("restart {number}"), &shot(&client, *camera), &first[number]);
    }
}

#[test]
fn a_server_that_comes_late_draws_what_it_would_have_drawn() {
    let wall = small(2, 1);
    let (_complete, client, poses) = start(&wall);
    let expected = shot(&client, poses[0]);
    let folder = town().parent().expect("a folder");
    let mut late = LocalWall::manager(TestDir::new(), &wall, &[folder], ANY_PORT);
    let [early_one, late_one] = [0, 1].map(|channel| wall.channels[channel].server.clone());
    late.start_server(&early_one);
    let client = late.client();
    wait::until("the first channel", || {
        let status = client.status().expect("status");
        (status.channels[0].state == ChannelState::Ready).then_some(())
    });
    assert_eq!(open_town(&client).len(), poses.len());
    client.set_camera(poses[0]).expect("moved");
    let half = client.capture().expect("what is there");
    let [(missing, reason)] = &half.missing[..] else { panic!("{:?}", half.missing) };
    assert_eq!((missing, half.channels.len()), (&wall.channels[1].name, 1));
    assert!(reason.contains("no server"), "{reason}");
    late.start_server(&late_one);
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    check_twins("late", &shot(&client, poses[0]), &expected);
}
