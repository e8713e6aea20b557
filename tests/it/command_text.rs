//! The command's output for people and shells: help, schema, manuals, and files that it leaves
//! alone.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::wait;

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_schema_is_printed_as_it_stands_in_the_repository() {
    let printed = TestDir::new().run(["wall", "schema"]).succeeded();
    let kept = fs::read_to_string(repository().join("configs/wall.schema.json")).expect("a file");
    assert_eq!(printed.trim_end(), kept.trim_end());
    let schema: Value = serde_json::from_str(&printed).expect("JSON");
    assert_eq!(schema["title"], "Polyptych wall file");
}

#[test]
fn gpus_are_listed_and_one_that_is_not_there_is_refused_with_them() {
    let place = TestDir::new();
    let listed = place.run(["server", "--list-gpus"]).succeeded();
    let first = listed.lines().next().expect("a GPU").to_owned();
    assert!(first.contains("(vulkan") || first.contains("(gl"), "{first}");
    let server = ["server", "--manager", "127.0.0.1:9", "--channel", "a", "--headless", "--once"];
    let asked = |gpu: &str| place.run(server.iter().copied().chain(["--gpu", gpu]));
    asked("GTX 9999").failed(&["no GPU here is \"GTX 9999\"", &first]);
    assert!(asked("").output.contains("--gpu"));
    // By a part of its name in the other case it is found, and the server goes on to its manager.
    let name = first.split(" (").next().expect("a name").to_uppercase();
    asked(&name).failed(&["127.0.0.1:9"]);
}

#[test]
fn a_value_in_the_place_of_a_word_lists_the_words_in_every_command() {
    let place = TestDir::new();
    let wall = fs::read_to_string(repository().join("configs/single.toml")).expect("a file");
    let name = "channel.front";
    let header = if wall.contains(&format!("[{name}]")) { "" } else { "\n[channel.front]\n" };
    place.write("wall.toml", format!("{wall}{header}turn = 90\n"));
    let words = "found the number 90; write one of \"none\", \"left\", \"right\", \"half\"";
    for command in ["check", "manager", "simulate"] {
        let said = place.run([command, "wall.toml"]).failed(&["channel.front.turn", words]);
        assert!(!said.contains("wanted") && !said.contains("schema.json"), "{said}");
    }
}

#[test]
fn completions_and_manuals_name_every_command() {
    let place = TestDir::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = place.run(["completions", shell]).succeeded();
        for word in ["simulate", "completions", "manager"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    let script = place.write("c.bash", place.run(["completions", "bash"]).succeeded());
    let read = Command::new("bash").arg("-n").arg(&script).status().expect("bash");
    assert!(read.success(), "bash reads it");
    let said = place.run(["man", "-o", "man1"]).succeeded();
    assert!(said.contains("pages"), "{said}");
    for (page, words) in [("polyptych.1", "simulate"), ("polyptych-view-add.1", "ortho")] {
        let text = fs::read_to_string(place.path("man1").join(page)).expect("a page");
        assert!(text.contains(words) && text.contains("Examples"), "{page}: {text}");
    }
}

#[test]
fn sources_are_not_overwritten_without_force_and_pictures_are() {
    let place = TestDir::new();
    place.write("mine.glb", "edited");
    let town = ["scene", "town", "--blocks", "1", "-o", "mine.glb"];
    place.run(town).failed(&["mine.glb is there already", "--force"]);
    assert_eq!(fs::read(place.path("mine.glb")).expect("a file"), b"edited");
    place.run(town.iter().chain(&["--force"])).succeeded();
    assert!(fs::read(place.path("mine.glb")).expect("a file").starts_with(b"glTF"));
    std::os::unix::fs::symlink("nowhere.toml", place.path("link.toml")).expect("linked");
    place.write("wall.toml", "edited");
    for file in ["wall.toml", "link.toml"] {
        let grid = ["wall", "grid", "-o", file];
        place.run(grid).failed(&[file, "is there already", "--force"]);
    }
    place.run(["wall", "grid", "-o", "wall.toml", "--force"]).succeeded();
    let local = LocalWall::start_in(place, &small(1, 1), &[], ANY_PORT);
    local.place.write("wall.png", "an old picture");
    local.run(&["shot", "wall.png"]);
    assert!(fs::read(local.place.path("wall.png")).expect("a file").starts_with(b"\x89PNG"));
}

#[test]
fn a_variable_names_the_manager_for_clients_and_servers() {
    let wall = small(1, 1);
    let mut local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let channel = wall.channels[0].name.as_str();
    let run = |arguments: &[&str]| {
        let mut command = local.place.command(arguments);
        command.env("POLYPTYCH_MANAGER", &local.address);
        Process::start("polyptych", &mut command)
    };
    let mut server = run(&["server", "--with-parent", "--headless", "--channel", channel]);
    server.await_line(&["connected", &local.address]);
    let said = run(&["status"]).finish(wait::LIMIT).succeeded();
    assert!(said.contains("wall small"), "{said}");
    // What is typed comes before the variable.
    run(&["status", "--manager", "127.0.0.1:1"]).finish(wait::LIMIT).failed(&["127.0.0.1:1"]);
    run(&["stop", "--servers"]).finish(wait::LIMIT).succeeded();
    assert_eq!(server.finish(wait::SOON).code(), 0);
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
}

#[test]
fn a_server_without_a_runtime_folder_prints_no_complaint_of_its_libraries() {
    let wall = small(1, 1);
    let local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let channel = wall.channels[0].name.as_str();
    let arguments = ["server", "--with-parent", "--headless", "--channel", channel, "--manager"];
    let mut command = local.place.command(arguments);
    command.arg(&local.address).env_remove("XDG_RUNTIME_DIR");
    let mut server = Process::start("server", &mut command);
    let pid = server.pid();
    server.await_line(&["connected", &local.address]);
    let client = local.client();
    wait::until("the server's own process", || {
        let status = client.status().unwrap_or_else(|error| panic!("{error}"));
        (status.channels[0].pid == Some(pid)).then_some(())
    });
    assert!(!server.output().contains("XDG_RUNTIME_DIR"), "{}", server.output());
}

#[test]
fn run_asks_for_vulkan_before_every_command_that_draws() {
    for command in ["demo", "simulate", "server", "prove"] {
        let mut run = Command::new(repository().join("run"));
        run.arg(command).env("VK_DRIVER_FILES", "/nowhere.json").env_remove("VK_ICD_FILENAMES");
        let said = Process::start("run", &mut run).finish(wait::LIMIT);
        assert_ne!(said.code(), 0, "{}", said.output);
        assert!(said.output.contains("no Vulkan driver at /nowhere.json"), "{}", said.output);
    }
}
