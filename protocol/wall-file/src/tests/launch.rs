//! Tests of `[launch]` and `[server.NAME]`.

use super::{BY_HAND, SMALLEST, check};
use crate::{LaunchOutput, parse_with_launch, to_toml};

#[test]
fn servers_have_what_holds_for_all_and_their_own() {
    let text = format!(
        "{BY_HAND}[launch]\nmanager = \"me@head\"\naddress = \"head:7000\"\n\
         environment = {{ DISPLAY = \":0\", A = \"1\" }}\nserver_arguments = [\"--no-occlusion\"]\n\
         [server.pc]\nhost = \"pc.example\"\nenvironment = {{ A = \"2\" }}\ngpus = 2\n\
         arguments = [\"--monitor\", \"DP-1\"]\n[server.a]\noutput = \"headless\"\n"
    );
    let (wall, launch) = parse_with_launch(&text, "w.toml".as_ref()).unwrap();
    assert_eq!(launch.manager_host.as_deref(), Some("me@head"));
    assert_eq!(launch.servers.keys().collect::<Vec<_>>(), ["a", "pc"]);
    let pc = &launch.servers["pc"];
    assert_eq!((pc.host.as_deref(), pc.gpus), (Some("pc.example"), 2));
    assert_eq!((pc.channels.len(), pc.environment["A"].as_str()), (1, "2"));
    assert_eq!(pc.arguments, ["--no-occlusion", "--monitor", "DP-1"]);
    assert_eq!(pc.output, Some(LaunchOutput::Fullscreen), "DISPLAY is there");
    let a = &launch.servers["a"];
    assert_eq!((a.output, a.host.as_ref()), (Some(LaunchOutput::Headless), None));
    assert_eq!(a.environment["A"], "1");
    let (again, plain) = parse_with_launch(&to_toml(&wall), "w.toml".as_ref()).unwrap();
    assert_eq!(again, wall);
    assert_eq!((plain.ssh.as_slice(), plain.servers["a"].output), (&["ssh".to_owned()][..], None));
}

#[test]
fn what_cannot_be_started_is_refused_with_its_key() {
    for (lines, expected) in [
        ("[server.other]\nhost = \"x\"\n", "9:9: server.other: no channel is drawn by"),
        ("[server.front]\nhost = \"-oProxyCommand=x\"\n", "10:1: server.front.host: \"-oProxy"),
        ("[server.front]\nhost = \"a b\"\n", "10:1: server.front.host: \"a b\" is no machine"),
        ("[server.front]\nhost = \"@b\"\n", "10:1: server.front.host: \"@b\" is no machine"),
        ("[server.front]\nhost = \"\"\n", "10:1: server.front.host: \"\" is no machine"),
        ("[server.front]\ngpus = 65\n", "10:1: server.front.gpus: a server cannot have 65 GPUs"),
        ("[launch]\nmanager = \"a;b\"\n", "10:1: launch.manager: \"a;b\" is no machine"),
        ("[launch]\naddress = \"head\"\n", "10:1: launch.address: \"head\" is no address"),
        ("[launch]\naddress = \"head:0\"\n", "10:1: launch.address: \"head:0\" is no address"),
        ("[launch]\nkeys = \"keys\"\n", "10:1: launch.keys: \"keys\" is no absolute path"),
        ("[launch]\nssh = []\n", "10:1: launch.ssh: the command is empty"),
        ("[launch]\nprogram = \"\"\n", "10:1: launch.program: the word is empty"),
        ("[launch]\nprogram = \"/a=b/p\"\n", "10:1: launch.program: \"/a=b/p\" has a \"=\""),
        (
            "[launch]\nserver_arguments = [\"a\\nb\"]\n",
            "10:21: launch.server_arguments[0]: the word",
        ),
        (
            "[launch]\nenvironment = { \"A B\" = \"1\" }\n",
            "10:1: launch.environment: \"A B\" is no",
        ),
        ("[launch]\noutput = \"screen\"\n", "10:10: launch.output: "),
        ("[launch]\nhost = \"a\"\n", "10:1: launch.host: there is no key"),
    ] {
        check(&format!("{SMALLEST}{lines}"), expected);
    }
}
