//! Plans of a wall of two servers.

use super::*;
use crate::launch::unit_file::UnitFiles;
use crate::launch::{container, kubernetes, slurm, systemd};

const WALL: &str = "[wall]\nname = \"w\"\n[[screen]]\nname = \"f\"\nsize = [2.0, 1.0]\n\
                    center = [0.0, 0.0, -1.0]\n[screen.tiles]\ncolumns = 2\npixels = [100, 100]\n\
                    servers = [\"a\", \"b\"]\n";

fn plan(lines: &str) -> anyhow::Result<LaunchPlan> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("w.toml");
    std::fs::write(&file, format!("{WALL}{lines}")).expect("written");
    LaunchPlan::load(&file)
}

#[track_caller]
fn address(lines: &str) -> Result<String, String> {
    plan(lines).expect(lines).manager_address().map_err(|error| error.to_string())
}

/// The text of the file at this path.
#[track_caller]
fn text_of<'u>(units: &'u UnitFiles, path: &str) -> &'u str {
    let file = units.files.iter().find(|file| file.path.to_str() == Some(path));
    &file.unwrap_or_else(|| panic!("no {path}")).text
}

#[test]
fn servers_are_told_an_address_that_they_reach() {
    let keys = "[launch]\nkeys = \"/k\"\n";
    let any = "[network]\nlisten = \"0.0.0.0:9000\"\n";
    assert_eq!(address("").as_deref(), Ok("127.0.0.1:7878"));
    assert_eq!(address(&format!("{keys}{any}")).as_deref(), Ok("127.0.0.1:9000"));
    let given = format!("{keys}address = \"head:1\"\n{any}[server.a]\nhost = \"r\"\n");
    assert_eq!(address(&given).as_deref(), Ok("head:1"));
    let fixed = format!("{keys}[network]\nlisten = \"10.0.0.1:9\"\n[server.a]\nhost = \"r\"\n");
    assert_eq!(address(&fixed).as_deref(), Ok("10.0.0.1:9"));
    let tunnel = "[launch]\naddress = \"[::1]:9\"\n[server.a]\nhost = \"r\"\n";
    assert_eq!(address(tunnel).as_deref(), Ok("[::1]:9"));
    // All on one machine, which may be another one; and this machine by another name.
    let there =
        "[launch]\nmanager = \"me@r\"\n[server.a]\nhost = \"r\"\n[server.b]\nhost = \"r\"\n";
    assert_eq!(address(there).as_deref(), Ok("127.0.0.1:7878"));
    let here = "[server.a]\nhost = \"root@localhost\"\n[server.b]\nhost = \"127.0.0.2\"\n";
    assert_eq!(address(here).as_deref(), Ok("127.0.0.1:7878"));
    for (lines, parts) in [
        (
            "[server.a]\nhost = \"r\"\n",
            ["launch.address", "server a runs on r", "127.0.0.1:7878 only"],
        ),
        (
            "[launch]\nmanager = \"r\"\n",
            ["launch.address", "server a runs on this", "head.example"],
        ),
        (any, ["network.listen", "nothing is encrypted", "keys = \"/FOLDER\""]),
        (
            "[launch]\naddress = \"head:7878\"\n[server.a]\nhost = \"r\"\n",
            ["launch.address", "head:7878, over a network", "keys = \"/FOLDER\""],
        ),
        (
            "[launch]\nkeys = \"/k\"\naddress = \"head:7878\"\n",
            ["network.listen", "127.0.0.1:7878 only", "listen = \"0.0.0.0:7878\""],
        ),
        ("[network]\nlisten = \"127.0.0.1:0\"\n", ["network.listen", "port 0", "7878"]),
    ] {
        let error = address(lines).expect_err(lines);
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
}

#[test]
fn command_lines_say_what_the_file_does() {
    let plan = plan(
        "[launch]\nkeys = \"/k/\"\nwall = \"/w.toml\"\n\
         manager_arguments = [\"--http\", \"127.0.0.1:80\"]\n[server.b]\nhost = \"me@r\"\n\
         output = \"fullscreen\"\ngpu = \"RTX A6000\"\narguments = [\"--monitor\", \"DP 1\"]\n",
    )
    .expect("a plan");
    let manager = "manager /w.toml --listen 127.0.0.1:7878 --keys /k/manager --http 127.0.0.1:80";
    assert_eq!(plan.manager_there().join(" "), manager);
    let server = plan.server_there("b", "h:1", LaunchOutput::Headless);
    let expected = "server --manager h:1 --name b --channel f-2-1 --fullscreen --gpu=RTX A6000 \
                    --keys /k/server-b \
                    --monitor DP 1";
    assert_eq!(server.join(" "), expected);
    let machines = plan.machines();
    let summary: Vec<_> =
        machines.iter().map(|it| (it.host, it.has_manager, it.servers.clone())).collect();
    assert_eq!(summary, [(None, true, vec!["a"]), (Some("me@r"), false, vec!["b"])]);
}

#[test]
fn users_of_one_machine_share_its_units_and_no_folder() {
    let plan = plan(
        "[launch]\nkeys = \"/k\"\nmanager = \"me@r\"\naddress = \"r:1\"\n\
         [network]\nlisten = \"0.0.0.0:1\"\n\
         [server.a]\nhost = \"you@r\"\n[server.b]\nhost = \"root@localhost\"\n",
    )
    .expect("a plan");
    let machines = plan.machines();
    let summary: Vec<_> =
        machines.iter().map(|it| (it.host, it.has_manager, it.servers.clone())).collect();
    assert_eq!(summary, [(Some("me@r"), true, vec!["a"]), (None, false, vec!["b"])]);
    let units = systemd::units(&plan).expect("units");
    let target = text_of(&units, "r/polyptych-w.target");
    assert!(target.contains("polyptych-w-manager.service polyptych-w-server-a.service"));
    for (path, user, folder, home) in [
        ("r/polyptych-w-manager", "me", "polyptych-me/polyptych", "%S/polyptych-me"),
        ("r/polyptych-w-server-a", "you", "polyptych-you/polyptych", "%S/polyptych-you"),
        ("here/polyptych-w-server-b", "root", "polyptych", "%S"),
    ] {
        let text = text_of(&units, &format!("{path}.service"));
        let owned = format!("User={user}\nStateDirectory={folder}\nCacheDirectory={folder}\n");
        assert!(text.contains(&owned), "{text}");
        assert!(text.contains(&format!("XDG_STATE_HOME={home} ")), "{text}");
    }
}

#[test]
fn servers_with_a_display_are_started_without_end() {
    let plan = plan("[server.a]\noutput = \"fullscreen\"\n[server.b]\ngpu = \"RTX\"\n");
    let plan = plan.expect("a plan");
    let units = systemd::units(&plan).expect("units");
    for (name, limit, pause) in [
        ("manager", "StartLimitBurst=5\n\n", "RestartSec=500ms\n"),
        ("server-a", "StartLimitIntervalSec=0\n\n", "RestartSec=2s\n"),
        ("server-b", "StartLimitBurst=5\n\n", "RestartSec=500ms\n"),
    ] {
        let text = text_of(&units, &format!("here/polyptych-w-{name}.service"));
        assert!(text.contains(limit) && text.contains(pause), "{text}");
    }
    let units = container::units(&plan, "i").expect("units");
    let compose = text_of(&units, "here/compose.yaml");
    let count = |part: &str| compose.matches(part).count();
    assert_eq!([count("\"on-failure\""), count("\"on-failure:5\"")], [1, 2], "{compose}");
    // The one draws on a display, the other on a GPU that it names.
    assert_eq!(count("/dev/dri"), 2, "{compose}");
}

#[test]
fn a_manager_in_a_pod_keeps_its_state_on_its_volume() {
    for (lines, is_named) in [
        ("insecure = true\n", true),
        ("insecure = true\nmanager_arguments = [\"--state=/s\"]\n", false),
        ("insecure = true\nmanager_arguments = [\"--state\", \"/s\"]\n", false),
        ("insecure = true\nmanager_arguments = [\"--afresh\"]\n", false),
        ("keys = \"/k\"\n", false),
    ] {
        let plan = plan(&format!("[launch]\n{lines}")).expect(lines);
        let units = kubernetes::units(&plan, "i").expect(lines);
        let manager = text_of(&units, "manager.yaml");
        assert_eq!(manager.contains("\"/var/lib/polyptych/wall.state\""), is_named, "{lines}");
    }
}

#[test]
fn a_job_asks_for_nodes_by_their_short_names() {
    for (host, nodes) in [
        ("r2", "#SBATCH --nodes=2\n#SBATCH --nodelist=r1,r2\n"),
        // An address names no node.
        ("10.0.0.2", "#SBATCH --nodes=2\n#SBATCH --signal"),
    ] {
        let lines = format!(
            "[launch]\nmanager = \"r1\"\n[server.a]\nhost = \"me@r1.example\"\n\
             [server.b]\nhost = {host:?}\n"
        );
        let units = slurm::units(&plan(&lines).expect(host)).expect(host);
        let script = text_of(&units, "polyptych-w.sh");
        assert!(script.contains(nodes), "{script}");
    }
}

#[test]
fn arguments_that_the_command_refuses_are_refused_before_anything_starts() {
    for (lines, parts) in [
        ("[launch]\nmanager_arguments = [\"--htpp\"]\n", ["launch.manager_arguments", "--htpp"]),
        ("[launch]\nserver_arguments = [\"x\"]\n", ["server_arguments", "'x'"]),
        ("[server.b]\narguments = [\"--present-delay\", \"5s\"]\n", ["server.b.arguments", "5s"]),
    ] {
        let error = plan(lines).expect_err(lines).to_string();
        assert!(error.contains("w.toml: "), "{error}");
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
}
