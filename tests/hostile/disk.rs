//! Disks that are full or gone: what cannot be kept is said, and no frame waits for it.

use std::fs;
use std::path::Path;
use std::process::Command;

use polyptych_client::{ChannelState, Pacing};
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::wait;

#[test]
fn a_state_that_cannot_be_kept_is_said_in_the_answer_and_in_status() {
    let place = TestDir::new();
    let state = place.path("disk/wall.state");
    fs::create_dir_all(state.parent().expect("a folder")).expect("made");
    let path = state.display().to_string();
    let wall = small(1, 1);
    let more = ["--state", path.as_str()];
    let mut local = LocalWall::manager_with(place, &wall, &[], ANY_PORT, &more);
    local.start_server(&wall.channels[0].server.clone());
    let client = local.client();
    await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    let warnings = || {
        let status = local.run(&["status", "--json"]).succeeded();
        let status: Value = serde_json::from_str(&status).expect("JSON");
        assert!(status["memory_bytes"].as_u64() > Some(1 << 20), "{status}");
        let warnings = status["warnings"].as_array().expect("warnings").clone();
        warnings.iter().filter(|w| w.as_str().is_some_and(|w| w.contains(&path))).count()
    };
    assert_eq!(warnings(), 0);

    // A file stands in the place of the folder, as if the disk were gone.
    let disk = local.place.path("disk");
    let away = local.place.path("away");
    fs::rename(&disk, &away).expect("moved");
    fs::write(&disk, "").expect("written");
    let said = local.run(&["tune", &wall.channels[0].name, "gain=1,0.5,1"]).succeeded();
    assert!(said.contains("cannot write state file") && said.contains(&path), "{said}");
    assert_eq!(warnings(), 1, "once");
    let before = client.status().expect("status").frame;
    wait::until("frames meanwhile", || {
        (client.status().expect("status").frame.0 > before.0 + 30).then_some(())
    });
    assert_eq!(client.status().expect("status").channels[0].late, 0);

    // It is back, and what was tuned is kept without a further change.
    fs::remove_file(&disk).expect("removed");
    fs::rename(&away, &disk).expect("back");
    wait::until("the warning to end", || (warnings() == 0).then_some(()));
    local.manager.await_line(&["the state file was written again"]);
    local.manager.kill();
    let again = LocalWall::manager_with(local.place, &wall, &[], ANY_PORT, &more);
    let tuned = again.run(&["tune", &wall.channels[0].name, "--show"]).succeeded();
    assert!(tuned.contains("gain=1,0.5,1"), "{tuned}");
}

/// A file that may not grow fails as one on a full disk does.
#[test]
fn a_recording_that_breaks_off_is_said_in_status() {
    let place = TestDir::new();
    let wall = place.write("wall.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    let recording = place.path("wall.recording").display().to_string();
    let arguments = ["manager", "--listen", ANY_PORT, "--record", &recording];
    let manager = place.command(arguments.iter().map(Path::new).chain([wall.as_path()]));
    // 16 KiB hold the state, and no segment of a recording.
    let mut limited = Command::new("sh");
    limited.args(["-c", "trap '' XFSZ; ulimit -f 32; exec \"$@\"", "sh"]);
    limited.arg(manager.get_program()).args(manager.get_args()).current_dir(place.folder());
    for (name, value) in manager.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    let mut manager = Process::start("manager", &mut limited);
    let line = manager.await_line(&["manager listens", "address="]);
    let address = line.split("address=").nth(1).and_then(|rest| rest.split(' ').next());
    let address = address.expect("an address behind its name");
    wait::until("the warning", || {
        let said = place.run(["status", "--json", "--manager", address]);
        let status: Value = serde_json::from_str(&said.output).ok()?;
        let warnings = status["warnings"].as_array()?;
        warnings.iter().find(|w| w.as_str().is_some_and(|w| w.contains(&recording))).map(drop)
    });
}
