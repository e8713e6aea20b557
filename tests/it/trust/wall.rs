//! A wall that is encrypted from end to end, as an operator starts it.

use polyptych_client::blocking::Client;

use crate::harness::local_wall::{LocalWall, small};
use crate::harness::pictures::{color_count, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::{keys, wait};

#[test]
fn a_wall_with_keys_is_driven_by_all_commands() {
    let (place, wall) = (TestDir::new(), small(2, 1));
    keys::make(&place, &wall);
    let folder = town().parent().expect("a folder");
    let mut local = LocalWall::start_in(place, &wall, &[folder], "127.0.0.2:0");
    assert!(!local.place.token_file().exists(), "with keys there is no token");

    // Blobs have come over the bulk connections, and pictures go back over them.
    let opened = local.run(&["open", "town.glb"]).succeeded();
    assert!(opened.contains("triangles"), "{opened}");
    local.run(&["camera", "look-at", "-30,40,60", "0,5,-2"]).succeeded();
    let picture = local.place.path("wall.png");
    local.run(&["shot", picture.to_str().expect("text")]).succeeded();
    assert!(color_count(&read(&picture)) > 100);
    let table = local.run(&["status"]).succeeded();
    assert_eq!(table.matches("  live  ").count(), 2, "{table}");
    // The library is called as its certificate is.
    let client = local.client();
    let clients = client.status().expect("a status").clients;
    assert_eq!(clients, ["operator"]);
    for _ in 0..20 {
        client.render_frame().expect("a frame");
    }

    // Keys that are renewed while all runs are taken at the next connection.
    local.place.run(["keys", "--renew", "wall.toml"]).succeeded();
    let name = wall.channels[0].server.clone();
    local.servers.get_mut(&name).expect("it runs").kill();
    local.await_lost(&client, &name);
    local.start_server(&name);
    wait::until("it is back", || {
        let status = client.status().expect("a status");
        status.channels.iter().all(|c| c.reason.is_none() && c.pid.is_some()).then_some(())
    });
    let other = Client::connect_with(local.connect_options()).expect("renewed");
    other.render_frame().expect("a frame");
    drop((client, other));

    local.run(&["stop"]).succeeded();
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
    for server in local.servers.values_mut() {
        server.await_line(&["the manager has ended"]);
    }
}
