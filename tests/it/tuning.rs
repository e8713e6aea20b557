//! Test patterns and tuning, by the command, on a wall of processes.

use std::fs;

use image::RgbaImage;
use polyptych_client::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_client::glam::DVec2;
use polyptych_client::{ChannelState, Pacing, Wall};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::pictures::{color_count, read};
use crate::harness::place::TestDir;

/// The picture of the whole wall, as the command saves it.
fn shot(local: &LocalWall, name: &str) -> RgbaImage {
    let path = local.place.path(name);
    local.run(&["shot", path.to_str().expect("text")]).succeeded();
    read(&path)
}

/// Returns the number of pixels that differ between two pictures in these columns.
fn differing(a: &RgbaImage, b: &RgbaImage, columns: std::ops::Range<u32>) -> usize {
    let pairs = a.enumerate_pixels().zip(b.pixels());
    pairs.filter(|((x, _, a), b)| columns.contains(x) && a != b).count()
}

/// Another manager of this wall at the same place; the servers stay.
fn restarted(mut local: LocalWall, wall: &Wall) -> LocalWall {
    local.manager.kill();
    let LocalWall { place, address, servers, .. } = local;
    let mut local = LocalWall::manager(place, wall, &[], &address);
    local.servers = servers;
    await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
    local
}

#[test]
fn a_tuning_moves_the_picture_outlives_the_manager_and_is_saved() {
    let wall = small(2, 1);
    let [left, right] = [0, 1].map(|index: usize| wall.channels[index].name.clone());
    let local = LocalWall::start_in(TestDir::new(), &wall, &[], ANY_PORT);
    let path = local.place.path("wall.toml");
    let before = shot(&local, "none.png");
    local.run(&["pattern", "grid"]).succeeded();
    let status = local.run(&["status"]).succeeded();
    assert!(status.contains("pattern: grid, until: polyptych pattern --off"), "{status}");
    let grid = shot(&local, "grid.png");
    assert!(differing(&before, &grid, 0..480) > 10_000 && color_count(&grid) > 3);

    let said = local.run(&["tune", &left, "pin.upper-left=+10,6", "gamma=2.2"]).succeeded();
    assert!(said.contains("1 frame after the request"), "a paused wall: {said}");
    let tuned = shot(&local, "tuned.png");
    assert!(differing(&grid, &tuned, 0..240) > 1_000, "the lines have moved");
    assert_eq!(differing(&grid, &tuned, 240..480), 0, "the neighbour is as it was");
    let shown = local.run(&["tune", &left, "--show"]).succeeded();
    assert!(shown.contains("pin.upper-left=@10,6\n") && shown.contains("gamma=2.2"), "{shown}");

    let key = format!("{right}: pin.upper-left: the pins fold the picture");
    local.run(&["tune", &right, "pin.upper-left=200,200"]).failed(&[&key]);
    local.run(&["tune", "middle", "gamma=2"]).failed(&["no channel \"middle\"", &left]);

    let local = restarted(local, &wall);
    assert_eq!(shot(&local, "again.png"), tuned, "remembered, with the pattern");

    let text = fs::read_to_string(&path).expect("a wall file");
    fs::write(&path, format!("# The lab's wall.\n{text}")).expect("written");
    let said = local.run(&["wall", "save", path.to_str().expect("text")]).succeeded();
    assert!(said.contains(&left) && !said.contains(&right), "{said}");
    let saved = fs::read_to_string(&path).expect("a wall file");
    assert!(saved.starts_with("# The lab's wall.\n"), "{saved}");
    let said = local.run(&["wall", "save", path.to_str().expect("text")]).succeeded();
    assert!(said.contains("says already"), "{said}");
    let other = local.place.write("other.toml", saved.replace("\"small\"", "\"other\""));
    let other = other.to_str().expect("text").to_owned();
    local.run(&["wall", "save", &other]).failed(&["another wall", "its name is \"other\""]);

    let wall = polyptych_wall_file::load(&path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(wall.channels[0].adjustment.pin[0], DVec2::new(10.0, 6.0));
    let local = restarted(local, &wall);
    assert_eq!(shot(&local, "saved.png"), tuned, "the file says it now");
    local.run(&["pattern", "--off"]).succeeded();
    assert!(differing(&shot(&local, "off.png"), &tuned, 0..480) > 10_000);
}

#[test]
fn a_wall_that_runs_shows_tunings_on_all_channels_and_none_is_late() {
    let wall = small(2, 1);
    let local = LocalWall::start(&wall, &[]);
    let client = local.client();
    client.start_rendering(Pacing::Rate(30.0)).expect("running");
    let name = wall.channels[1].name.as_str();
    let nudge = || {
        let to = Offset::By(DVec2::new(0.1, 0.0));
        vec![CalibrationChange::Pin { corner: Corner::LowerRight, to }]
    };
    let mut frames: Vec<u64> =
        (0..50).map(|_| client.calibrate(name, nudge()).expect("tuned").frames).collect();
    frames.sort_unstable();
    println!("frames to a tuning: median {}, worst {}", frames[25], frames[49]);
    // As a slider sends them: nobody waits for the answer of the one before.
    let change = nudge();
    let request =
        || polyptych_client::Request::Tune { channel: name.to_owned(), changes: change.clone() };
    let pending: Vec<_> = (0..100).map(|_| client.submit(request()).expect("posted")).collect();
    for answer in pending {
        answer.wait().expect("each has its answer");
    }
    let pinned = client.wall().expect("the wall").channels[1].adjustment.pin[3].x;
    assert!((pinned - 15.0).abs() < 1e-9, "all steps add up: {pinned}");
    let status = client.status().expect("status");
    assert!(status.channels.iter().all(|channel| channel.late == 0), "{status:?}");
}

/// Two projectors on a round screen; one is tuned so far aside that it lights nothing. Its server
/// cannot have that, the other's could: nothing changes, nobody goes dark.
#[test]
fn a_tuning_that_one_server_cannot_show_is_refused_and_all_stay_live() {
    let text = r#"
        [wall]
        name = "round"
        [[screen]]
        name = "arc"
        pixels = [720, 240]
        [screen.cylinder]
        center = [0.0, 0.0, 0.0]
        radius = 3.0
        degrees = [-36.0, 36.0]
        height = [-0.8, 0.8]
        [[screen.channel]]
        name = "left"
        pixels = [160, 90]
        [screen.channel.projector]
        position = [0.0, 0.0, 0.0]
        rotation = [22, 0, 0]
        tangents = [-0.325, 0.325, -0.25, 0.25]
        [[screen.channel]]
        name = "right"
        pixels = [160, 90]
        [screen.channel.projector]
        position = [0.0, 0.0, 0.0]
        rotation = [-22, 0, 0]
        tangents = [-0.325, 0.325, -0.25, 0.25]
        "#;
    let wall = polyptych_wall_file::parse(text, "round.toml".as_ref())
        .unwrap_or_else(|error| panic!("{error}"));
    let local = LocalWall::start(&wall, &[]);
    let client = local.client();
    client.start_rendering(Pacing::Rate(30.0)).expect("running");
    await_states(&client, &[ChannelState::Live]);
    client.pause().expect("pausing");
    local.run(&["tune", "left", "gain=0.9"]).succeeded();
    let aside: Vec<_> = ["upper-left", "upper-right", "lower-left", "lower-right"]
        .map(|corner| format!("pin.{corner}=160,0"))
        .into();
    for _ in 0..3 {
        let mut tune = vec!["tune", "left"];
        tune.extend(aside.iter().map(String::as_str));
        let said = local.run(&tune).failed(&["nothing has changed", "channel left: none of its"]);
        assert_eq!(said.trim().lines().count(), 1, "{said}");
        let states: Vec<_> = client.status().expect("status").channels;
        assert!(states.iter().all(|channel| channel.state == ChannelState::Live), "{states:?}");
        // Of two refusals without a frame between them the second one sends who holds both the
        // state anew.
        client.render_frame().expect("a frame");
    }
    let said = local.run(&["tune", "left", "gain=0.8"]).succeeded();
    assert!(said.contains("after the request"), "{said}");
    let tuned = client.wall().expect("the wall");
    assert_eq!(tuned.channels[0].adjustment.color.gain.x, 0.8);
    assert_eq!(tuned.channels[0].adjustment.pin, [DVec2::ZERO; 4], "as before");
    let channels = client.status().expect("status").channels;
    assert!(channels.iter().all(|it| it.state == ChannelState::Live), "{channels:?}");
}
