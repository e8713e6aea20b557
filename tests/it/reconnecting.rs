//! A program that drives a wall goes on when its manager is killed and started again.

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ClientError, ConnectOptions, ReconnectPolicy, Request};

use crate::harness::local_wall::{LocalWall, await_states, small};
use crate::harness::scenes::{poses, town};
use crate::harness::wait;

#[test]
fn an_orbit_and_its_feedback_outlive_the_manager() {
    let wall = small(2, 1);
    let folder = town().parent().expect("a folder");
    let mut local = LocalWall::start(&wall, &[folder]);
    let options =
        ConnectOptions { reconnect: Some(ReconnectPolicy::default()), ..local.connect_options() };
    let client = Client::connect_with(options).expect("connected");
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    let known = client.status().expect("status");
    let mut feedbacks = client.feedback().expect("a stream");
    let draw = |number: usize| client.render_frame_at(Some(poses(&bounds)[number % 4]), None);
    for number in 0..3 {
        let drawn = draw(number).expect("drawn");
        assert_eq!(feedbacks.next().map(|feedback| feedback.frame), Some(drawn.frame));
    }
    let open = client.submit(Request::Capture { time_s: None }).expect("posted");
    local.manager.kill();
    let error = open.wait().expect_err("nobody is there to answer");
    assert!(error.is_outcome_unknown() || matches!(error, ClientError::NotConnected { .. }));
    let LocalWall { place, address, servers, .. } = local;
    let mut local = LocalWall::manager(place, &wall, &[folder], &address);
    local.servers = servers;

    // The same handle: the orbit goes on, and the scene is there.
    let epoch = client.connected().expect("connected again");
    assert_ne!(epoch, known.epoch);
    let status = await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    assert_eq!((status.epoch, &status.scene), (epoch, &known.scene));
    let drawn = draw(3).expect("drawn by the new manager");
    assert!(drawn.channels.iter().all(|channel| channel.draw_us.is_some()), "{drawn:?}");
    let found = wait::within("the stream goes on", move || {
        let found = feedbacks.find(|feedback| feedback.frame == drawn.frame);
        found.map(|_| (feedbacks.reconnects(), feedbacks.epoch()))
    });
    assert_eq!(found, Some((1, epoch)));
}
