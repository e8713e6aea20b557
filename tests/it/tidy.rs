//! The repository's own rules, held by reading its sources: what the compiler and the lints cannot
//! see. Each rule is a function from the tree of files to a list of offences.

mod code;
mod documents;
mod layers;
mod sources;
mod tree;

use tree::Tree;

type Rule = fn(&Tree) -> Vec<String>;

/// Shows all offences at once, so that one run is enough to mend them.
fn hold(rule: Rule) {
    let offences = rule(&Tree::of_repository());
    assert!(offences.is_empty(), "{} offences:\n{}", offences.len(), offences.join("\n"));
}

#[test]
fn no_crate_depends_on_what_it_must_not_know() {
    hold(layers::manifests);
}

#[test]
fn every_dependency_says_why_it_is_here() {
    hold(layers::reasons);
}

#[test]
fn every_file_says_what_it_is() {
    hold(sources::heads);
}

#[test]
fn files_and_lines_are_short() {
    hold(sources::lengths);
}

#[test]
fn files_are_named_for_what_is_in_them() {
    hold(sources::names);
}

#[test]
fn nothing_is_unfinished_or_switched_off() {
    hold(sources::code_refused);
}

#[test]
fn tests_do_not_sleep() {
    hold(sources::sleeps);
}

#[test]
fn no_file_names_a_path_of_one_machine() {
    hold(sources::machine_paths);
}

#[test]
fn required_files_exist() {
    hold(documents::required);
}

#[test]
fn architecture_is_short_and_names_every_folder() {
    hold(documents::architecture);
}

#[test]
fn every_limit_is_in_the_table() {
    hold(documents::limits);
}

#[test]
fn links_lead_to_files() {
    hold(documents::links);
}

/// A rule, a file that breaks it, and what the offence must say.
type Broken = (Rule, &'static str, &'static str, &'static str);

const BROKEN: &[Broken] = &[
    (
        layers::manifests,
        "server-manager/core/Cargo.toml",
        "[dependencies]\ntokio.workspace = true",
        ":2: tokio",
    ),
    (
        layers::manifests,
        "render-server/renderer/Cargo.toml",
        "[dependencies]\npolyptych-protocol.workspace = true",
        ":2: polyptych-protocol",
    ),
    (
        layers::manifests,
        "client-api/Cargo.toml",
        "[dependencies]\nwgpu.workspace = true",
        ":2: wgpu",
    ),
    (layers::manifests, "protocol/Cargo.toml", "[dependencies]\nglam = \"1\"", "versions"),
    (layers::reasons, "Cargo.toml", "[workspace.dependencies]\nglam = \"1\"", "glam: no comment"),
    (sources::heads, "src/a.rs", "fn a() {}", "src/a.rs: does not begin"),
    (sources::heads, "a/b.py", "import c", "a/b.py: does not begin"),
    (sources::names, "src/cli/utils.rs", "//! a", "src/cli/utils.rs: name it"),
    (sources::code_refused, "src/a.rs", "fn a() { todo!() }", "`todo!`"),
    (sources::code_refused, "src/a.rs", "unimplemented!()", "`unimplemented!`"),
    (sources::code_refused, "src/a.rs", "dbg!(a)", "`dbg!`"),
    (sources::code_refused, "tests/a.rs", "#[ignore = \"slow\"]", "`#[ignore`"),
    (sources::code_refused, "src/a.rs", "#[allow(dead_code)]", "`#[allow(`"),
    (sources::code_refused, "src/a.rs", "pub use b::*;", "name what it exports"),
    (sources::sleeps, "tests/it/a.rs", "thread::sleep(a)", "a.rs:1: `sleep(`"),
    (sources::sleeps, "src/a/tests.rs", "sleep(a).await", "tests.rs:1: `sleep(`"),
    (sources::sleeps, "src/a.rs", "a\n#[cfg(test)]\nmod tests {\nsleep(a)", "a.rs:4: `sleep(`"),
    (documents::required, "a.md", "", "CHANGELOG.md is missing"),
    (documents::architecture, "ARCHITECTURE.md", "`src`", "the folder `b`"),
    (documents::limits, "ARCHITECTURE.md", "A_MAX_OLD", "lacks A_MAX of"),
    (documents::links, "README.md", "a [b](docs/c.md#d)", "README.md:1: docs/c.md does not"),
    (documents::links, "README.md", "<img src=\"d.png\">", "README.md:1: d.png does not"),
];

#[test]
fn every_rule_sees_what_breaks_it() {
    let long_file = "//! a\n".repeat(501);
    let long_line = format!("// {}", "ä".repeat(98));
    let long_page = "a\n".repeat(151);
    let machine_path = format!("see /{}/main", "work");
    let made_here: [(Rule, &str, &str, &str); 4] = [
        (sources::lengths, "src/a.rs", &long_file, "501 lines, at most 500"),
        (sources::lengths, "src/a.wgsl", &long_line, "a.wgsl:1: 101 columns"),
        (documents::architecture, "ARCHITECTURE.md", &long_page, "151 lines, at most 150"),
        (sources::machine_paths, "a.toml", &machine_path, "a.toml:1: a path"),
    ];
    for (rule, path, text, expected) in BROKEN.iter().copied().chain(made_here) {
        let around = [("b/c.txt", ""), ("protocol/src/limits.rs", "pub const A_MAX: u8 = 1;")];
        let offences = rule(&Tree::of(&[around[0], around[1], (path, text)]));
        assert!(
            offences.iter().any(|offence| offence.contains(expected)),
            "{path} with {text:?} must give an offence with {expected:?}, not {offences:?}"
        );
    }
}

#[test]
fn rules_allow_what_only_looks_broken() {
    let allowed: &[Broken] = &[
        (
            layers::manifests,
            "server-manager/Cargo.toml",
            "[dependencies]\ntokio.workspace = true",
            "server-manager/Cargo.toml:",
        ),
        (sources::code_refused, "src/a.rs", "let a = \"todo!\"; // dbg!", "src/a.rs"),
        (sources::sleeps, "src/a.rs", "sleep(a)\n#[cfg(test)]\nmod tests {\nb", "src/a.rs"),
        (sources::machine_paths, "a.toml", "target/home/a ../home/b", "a.toml"),
        (documents::links, "README.md", "[a](b/c.txt) [d](#e) [f](https://g)", "README.md"),
    ];
    for (rule, path, text, unexpected) in allowed {
        let offences = rule(&Tree::of(&[("b/c.txt", ""), (path, text)]));
        assert!(
            !offences.iter().any(|offence| offence.contains(unexpected)),
            "{path} with {text:?} breaks no rule, but gives {offences:?}"
        );
    }
}
