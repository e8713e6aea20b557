//! A wall is stopped: with its servers or without, by a command or by a signal.

use polyptych_client::ChannelState;
use rustix::process::Signal;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::wait;

#[test]
fn servers_wait_quietly_for_the_next_manager() {
    let wall = small(2, 1);
    let mut local = LocalWall::start(&wall, &[]);
    let said = local.run(&["stop"]).succeeded();
    assert!(said.contains("wait for the next one") && said.contains("stop --servers"), "{said}");
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
    for server in local.servers.values_mut() {
        server.await_line(&["the manager has ended", "a client stopped the manager"]);
    }
    let LocalWall { place, address, servers, .. } = local;
    let mut again = LocalWall::manager(place, &wall, &[], &address);
    again.servers = servers;
    await_states(&again.client(), &[ChannelState::Ready, ChannelState::Live]);
    for (name, server) in &again.servers {
        let said = server.output();
        assert_eq!(said.matches("the manager has ended").count(), 1, "{name}: {said}");
        assert!(!said.contains("not connected"), "{name} tries quietly: {said}");
    }
    // A manager that is killed is another matter.
    again.manager.kill();
    for server in again.servers.values_mut() {
        server.await_line(&["not connected; trying again"]);
    }
}

#[test]
fn a_manager_that_is_asked_to_end_says_so_to_its_servers() {
    let mut local = LocalWall::start(&small(1, 1), &[]);
    for signal in [Signal::TERM, Signal::INT] {
        local.manager.signal(signal);
        assert_eq!(local.manager.finish(wait::SOON).code(), 0);
        for server in local.servers.values_mut() {
            server.await_line(&["the manager has ended", "the manager was ended"]);
        }
        let LocalWall { place, address, servers, .. } = local;
        local = LocalWall::manager(place, &small(1, 1), &[], &address);
        local.servers = servers;
        await_states(&local.client(), &[ChannelState::Ready, ChannelState::Live]);
    }
}

#[test]
fn stopped_servers_end_and_one_that_hangs_is_named() {
    let wall = small(3, 1);
    let mut local = LocalWall::start(&wall, &[]);
    let hung = wall.channels[1].server.clone();
    local.servers[&hung].signal(Signal::STOP);
    let said = local.run(&["stop", "--servers"]).failed(&["may still run", &hung, "goodbye"]);
    assert!(!said.contains(&wall.channels[0].server), "{said}");
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
    // Told while it stood still, it ends as soon as it goes on.
    local.servers[&hung].signal(Signal::CONT);
    for (name, server) in &mut local.servers {
        assert_eq!(server.finish(wait::SOON).code(), 0, "{name}: {}", server.output());
    }
}

#[test]
fn a_server_that_is_not_there_is_no_reason_not_to_end_the_others() {
    let wall = small(2, 1);
    let mut local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let here = wall.channels[0].server.clone();
    local.start_server(&here);
    let client = local.client();
    wait::until("the server that is there", || {
        let status = client.status().unwrap_or_else(|error| panic!("{error}"));
        (status.channels[0].state != ChannelState::Lost).then_some(())
    });
    let said = local.run(&["stop", "--servers"]).succeeded();
    assert!(said.contains("and 1 server with it"), "{said}");
    let absent = format!("not told to end: {}", wall.channels[1].server);
    assert!(said.contains(&absent), "{said}");
    for server in local.servers.values_mut() {
        assert_eq!(server.finish(wait::SOON).code(), 0, "{}", server.output());
    }
}
