//! Who knows nothing of whom: ARCHITECTURE.md's invariants as tables, and the rules that hold them.

use super::code::{code_of, lines_with, without_tests};
use super::tree::{Tree, is_in_module, is_test_file};

/// Words that must not stand in some modules' code.
struct Absence {
    words: &'static [&'static str],
    /// Modules: paths without `.rs`; their folders are meant too.
    within: &'static [&'static str],
    except: &'static [&'static str],
    /// Whether the tests of these modules may use the words.
    tests_may: bool,
    why: &'static str,
}

const ABSENCES: &[Absence] = &[
    Absence {
        words: &["polyptych_protocol", "tokio", "tokio_util", "winit"],
        within: &["render-server/src/renderer"],
        except: &[],
        tests_may: false,
        why: "the renderer knows no wire, no tasks and no windows; apply.rs translates for it",
    },
    Absence {
        words: &["tokio", "tokio_util", "TcpStream", "TcpListener", "Instant::now", "SystemTime"],
        within: &["server-manager/src/cluster", "server-manager/src/replay"],
        except: &[],
        tests_may: false,
        why: "the brain has no sockets and no clock, live or replayed: `now` is an argument",
    },
    Absence {
        words: &["tokio", "tokio_util", "TcpStream", "Instant::now", "SystemTime"],
        within: &["render-server/src/playback", "render-server/src/showing"],
        except: &[],
        tests_may: false,
        why: "what is drawn and shown is decided without sockets and without a clock",
    },
    Absence {
        words: &["tokio", "tokio_util"],
        within: &["server-manager/src"],
        except: &[
            "server-manager/src/run",            // accepts, starts tasks, drains
            "server-manager/src/delivery",       // pictures on their way to a client
            "server-manager/src/door",           // the handshake of every connection
            "server-manager/src/strangers",      // ends connections in the handshake
            "server-manager/src/requests",       // queues that connections fill
            "server-manager/src/memory/keeper",  // the thread that writes the state file
            "server-manager/src/session",        // what all connections have in common
            "server-manager/src/client_session", // a client's connection
            "server-manager/src/server_session", // a server's connection
            "server-manager/src/metrics",        // answers scrapes on a thread of its own
            "server-manager/src/bulk",           // blobs go out on their own connections
            "server-manager/src/import",         // the baker is a child process
        ],
        tests_may: true,
        why: "in the manager only the files that own a connection or a child process know tokio",
    },
    Absence {
        words: &["gltf::", "image::"],
        within: &["server-manager/src"],
        except: &["server-manager/src/bake"],
        tests_may: true,
        why: "foreign files are read by the baker only; everyone else reads blobs",
    },
    Absence {
        words: &["wgpu"],
        within: &["src", "protocol", "client-api", "server-manager"],
        except: &[],
        tests_may: false,
        why: "only render-server knows the GPU",
    },
    Absence {
        words: &["bincode"],
        within: &["src", "protocol", "client-api", "server-manager", "render-server", "tests"],
        except: &["protocol/src/codec"],
        tests_may: false,
        why: "the wire's encoding is named in protocol/src/codec.rs only, so that it can change",
    },
];

/// Dependencies that a crate must not have, not even for tests.
const DEPENDENCIES_REFUSED: &[(&str, &[&str])] = &[
    (
        "protocol/Cargo.toml",
        &["wgpu", "winit", "gltf", "image", "polyptych-client", "polyptych-manager"],
    ),
    (
        "client-api/Cargo.toml",
        &["wgpu", "winit", "gltf", "bincode", "polyptych-manager", "polyptych-render"],
    ),
    (
        "server-manager/Cargo.toml",
        &["wgpu", "winit", "bincode", "polyptych-client", "polyptych-render"],
    ),
    ("render-server/Cargo.toml", &["gltf", "bincode", "polyptych-client", "polyptych-manager"]),
    ("Cargo.toml", &["bincode", "winit"]),
];

/// No module uses what it is to know nothing of.
pub fn absences(tree: &Tree) -> Vec<String> {
    ABSENCES.iter().flat_map(|absence| offences_against(absence, tree)).collect()
}

fn offences_against(absence: &Absence, tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for module in absence.within {
        let mut files =
            tree.with_ending(&["rs"]).filter(|file| is_in_module(&file.path, module)).peekable();
        if files.peek().is_none() {
            offences.push(format!(
                "{module} has no source: if it moved, so does its row in tests/it/tidy/layers.rs"
            ));
        }
        for file in files {
            let is_excepted = absence.except.iter().any(|path| is_in_module(&file.path, path));
            if is_excepted || (absence.tests_may && is_test_file(&file.path)) {
                continue;
            }
            let code = code_of(&file.text);
            let code = if absence.tests_may { without_tests(&code) } else { &code };
            for word in absence.words {
                for line in lines_with(code, word) {
                    offences.push(format!("{}:{line}: `{word}`: {}", file.path, absence.why));
                }
            }
        }
    }
    offences
}

/// The renderer is written as if it were its own crate.
pub fn renderer_is_alone(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    let renderer = "render-server/src/renderer";
    for file in tree.with_ending(&["rs"]).filter(|file| is_in_module(&file.path, renderer)) {
        let code = code_of(&file.text);
        // So many steps up lead out of the renderer.
        let climb = "super::".repeat(file.path.split('/').count() - 2);
        let lines_before_tests = without_tests(&code).lines().count();
        for (number, line) in (1..).zip(code.lines()) {
            let leaves = line.match_indices("crate::").any(|(at, path)| {
                let rest = &line[at + path.len()..];
                lines_with(rest, "renderer").is_empty() || !rest.starts_with("renderer")
            });
            let climbs = number <= lines_before_tests && line.contains(&climb);
            if leaves || climbs {
                offences.push(format!(
                    "{}:{number}: {}: the renderer uses nothing of the crate around it",
                    file.path,
                    line.trim()
                ));
            }
        }
    }
    offences
}

/// No crate depends on what it is to know nothing of, and versions are named once.
pub fn manifests(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for (path, refused) in DEPENDENCIES_REFUSED {
        let text = match tree.required(path, "a crate's dependencies") {
            Ok(text) => text,
            Err(missing) => {
                offences.push(missing);
                continue;
            }
        };
        for (number, name, line) in dependencies(text, is_member_section) {
            if refused.contains(&name) {
                offences.push(format!("{path}:{number}: {name}: this crate must not know it"));
            }
            if !line.contains("workspace = true") {
                offences.push(format!(
                    "{path}:{number}: {name}: versions are named in the workspace's table only"
                ));
            }
        }
    }
    offences
}

/// Every crate that we take from others says why it is here.
pub fn reasons(tree: &Tree) -> Vec<String> {
    let text = match tree.required("Cargo.toml", "the workspace's dependencies") {
        Ok(text) => text,
        Err(missing) => return vec![missing],
    };
    let lines: Vec<&str> = text.lines().collect();
    dependencies(text, |section| section == "[workspace.dependencies]")
        .filter(|(_, _, line)| !line.contains("path ="))
        .filter(|(number, _, line)| {
            let before = number.checked_sub(2).map_or("", |index| lines[index]);
            !line.contains(" # ") && !before.starts_with('#')
        })
        .map(|(number, name, _)| format!("Cargo.toml:{number}: {name}: no comment says why"))
        .collect()
}

fn is_member_section(section: &str) -> bool {
    section.ends_with("dependencies]") && section != "[workspace.dependencies]"
}

/// Line number, name and line of every dependency in the sections that `is_wanted` picks.
fn dependencies(
    text: &str,
    is_wanted: impl Fn(&str) -> bool,
) -> impl Iterator<Item = (usize, &str, &str)> {
    let mut is_inside = false;
    (1..).zip(text.lines()).filter_map(move |(number, line)| {
        if line.starts_with('[') {
            is_inside = is_wanted(line.trim());
        }
        let is_entry = line.starts_with(|c: char| c.is_ascii_alphabetic());
        let name = line.split(['.', '=', ' ']).next()?;
        (is_inside && is_entry).then_some((number, name, line))
    })
}
