//! The examples that stand at the end of every command's help.

use clap::Command;

/// Commands by their names, each with lines that can be typed.
const EXAMPLES: &[(&str, &[&str])] = &[
    ("demo", &["polyptych demo", "polyptych demo --seconds 60 --out pictures"]),
    (
        "simulate",
        &[
            "polyptych simulate configs/wall-2x2.toml town.glb --orbit",
            "polyptych simulate configs/single.toml town.glb --walk 0,9,-80 0,13,-120",
            "polyptych simulate configs/wall-3x1.toml --seconds 20 --rate 30 --windows",
            "polyptych simulate configs/wall-2x2.toml --fault \"at 30 kill front-1-1\"",
        ],
    ),
    (
        "manager",
        &[
            "polyptych manager configs/wall-2x2.toml",
            "polyptych manager wall.toml --listen 0.0.0.0:7878 --keys manager --scenes /data",
            "polyptych manager wall.toml --http 127.0.0.1:7880",
            "polyptych manager wall.toml --record wall.rec --metrics 127.0.0.1:9464 --log json",
        ],
    ),
    (
        "server",
        &[
            "polyptych server --manager 127.0.0.1:7878 --channel front-1-1",
            "polyptych server --manager wall.example --channel left --channel right --fullscreen",
            "polyptych server --manager wall.example --channel left --keys server-left",
        ],
    ),
    ("up", &["polyptych up wall.toml", "polyptych up wall.toml --json"]),
    (
        "unit",
        &[
            "polyptych unit systemd wall.toml -o units",
            "polyptych unit slurm wall.toml -o job",
            "polyptych unit kubernetes wall.toml -o manifests --image registry.example/polyptych",
            "polyptych unit container wall.toml -o image",
        ],
    ),
    (
        "open",
        &["polyptych open town.glb", "polyptych open lamp.gltf --heading 90 --exposure 0.0005"],
    ),
    (
        "animation play",
        &[
            "polyptych animation play",
            "polyptych animation play Walk --speed 0.5",
            "polyptych animation play Wave --weight 0.3 --once",
        ],
    ),
    ("animation pause", &["polyptych animation pause", "polyptych animation pause 2"]),
    ("animation seek", &["polyptych animation seek 1.5", "polyptych animation seek 0 Walk"]),
    ("animation list", &["polyptych animation list", "polyptych animation list --json"]),
    (
        "bound",
        &["polyptych bound --error 1", "polyptych bound --error 0.5 --rate 30", "polyptych bound"],
    ),
    (
        "environment",
        &[
            "polyptych environment studio.hdr",
            "polyptych environment sky",
            "polyptych environment none",
        ],
    ),
    ("exposure", &["polyptych exposure -1.5", "polyptych exposure auto"]),
    ("tone", &["polyptych tone aces", "polyptych tone"]),
    ("glow", &["polyptych glow 0.1", "polyptych glow 0.2 --width 6", "polyptych glow none"]),
    ("ambient-occlusion", &["polyptych ambient-occlusion 0.5", "polyptych ambient-occlusion none"]),
    ("depth-of-field", &["polyptych depth-of-field 12", "polyptych depth-of-field 12,0.5"]),
    ("fog", &["polyptych fog 800", "polyptych fog 120 --height 1 --half 6", "polyptych fog none"]),
    ("variant", &["polyptych variant list", "polyptych variant Red", "polyptych variant none"]),
    ("pick", &["polyptych pick front 960,540", "polyptych pick front 100,80 --json"]),
    ("query ray", &["polyptych query ray 0,1.7,20 0,0,-1 --max 100"]),
    ("query segment", &["polyptych query segment 0,1.7,20 12,30,-8"]),
    ("query ground", &["polyptych query ground 12,30,-8"]),
    ("query nearest", &["polyptych query nearest 12,30,-8 --within 5"]),
    ("query box", &["polyptych query box -10,0,-10 10,30,10 --relation inside"]),
    ("query sphere", &["polyptych query sphere 12,30,-8 5 --json"]),
    ("query prism", &["polyptych query prism 0,30 \"0,0 40,0 40,10 10,10 10,40 0,40\""]),
    ("query frustum", &["polyptych query frustum front 100,80 400,300 --below /house"]),
    (
        "scene tree",
        &["polyptych scene tree --below /house --json", "polyptych scene tree --layer plan-a"],
    ),
    (
        "scene import",
        &[
            "polyptych scene import boat.glb position=4,0,2 --parent /harbour",
            "polyptych scene import tower.gltf name=tower scale=0.01",
        ],
    ),
    ("rest", &["polyptych rest --after 1800 --hours 09:00-18:00", "polyptych rest --off"]),
    ("session save", &["polyptych session save evening"]),
    ("session open", &["polyptych session open evening"]),
    ("session list", &["polyptych session list", "polyptych session list --json"]),
    ("session delete", &["polyptych session delete evening"]),
    ("scene save", &["polyptych scene save evening"]),
    ("scene list", &["polyptych scene list", "polyptych scene list --json"]),
    (
        "scene export",
        &["polyptych scene export evening.glb", "polyptych scene export a.glb --saved evening"],
    ),
    ("scene remove", &["polyptych scene remove evening"]),
    ("scene layer", &["polyptych scene layer", "polyptych scene layer night hide"]),
    ("scene close", &["polyptych scene close"]),
    (
        "node add",
        &[
            "polyptych node add name=sign mesh=0 position=0,2,0 --parent /house",
            "polyptych node add name=crate mesh=box:0.5,0.5,0.5 color=#ff8000",
            "polyptych node add label=Harbour size=2 color=#ffffff position=0,8,0 facing=upright",
        ],
    ),
    (
        "node set",
        &[
            "polyptych node set /house/door rotation=80,0,0",
            "polyptych node set 12 visible=false attribute.note=broken",
            "polyptych node set /house layer=plan-a switch=roof",
            "polyptych node set sign facing=upright",
            "polyptych node set /house fill=wireframe shading=unlit highlight=#ff8800",
        ],
    ),
    ("node move", &["polyptych node move sign /tower", "polyptych node move 12 /"]),
    ("node remove", &["polyptych node remove /house/door"]),
    ("transaction", &["polyptych transaction night.json"]),
    ("camera look-at", &["polyptych camera look-at 40,25,90 0,5,0"]),
    ("camera pose", &["polyptych camera pose 0,1.7,10 0,0,0,1"]),
    (
        "camera walk",
        &[
            "polyptych camera walk 60,0,-5 --via 40,0,10 --ahead",
            "polyptych camera walk 0,30,0 --fly --speed 8",
        ],
    ),
    (
        "camera follow",
        &[
            "polyptych camera follow harbour/boat --from 0,6,20 --turning",
            "polyptych camera follow lighthouse --orbit 10",
        ],
    ),
    ("camera author", &["polyptych camera author", "polyptych camera author /deck/Bridge"]),
    ("camera list", &["polyptych camera list"]),
    ("camera stay", &["polyptych camera stay"]),
    (
        "eye",
        &["polyptych eye", "polyptych eye 0.2,1.7,0.4 --look 0,1.5,-3", "polyptych eye --reset"],
    ),
    (
        "view add",
        &[
            "polyptych view add 0,400,0 0,0,0 --up 0,0,-1 --ortho 250 --rect 0,0,960,1080",
            "polyptych view add 40,25,90 0,5,0 --fov 40 --screen front",
            "polyptych view add 40,25,90 0,5,0 --layers night --root /harbour --screen front",
        ],
    ),
    ("view list", &["polyptych view list", "polyptych view list --json"]),
    ("view save", &["polyptych view save quay"]),
    ("view go", &["polyptych view go quay", "polyptych view go quay --over 4"]),
    ("view remove", &["polyptych view remove quay"]),
    ("view clear", &["polyptych view clear"]),
    ("tour play", &["polyptych tour play harbour.json", "polyptych tour play way.json --paused"]),
    ("tour stop", &["polyptych tour stop", "polyptych tour stop --pause"]),
    ("shot", &["polyptych shot wall.png"]),
    (
        "film",
        &[
            "polyptych film harbour.mp4 --frames 900 --fps 30",
            "polyptych film pictures --frames 250 --fps 25 --from 10 --json",
        ],
    ),
    ("identify", &["polyptych identify", "polyptych identify --off"]),
    ("blank", &["polyptych blank", "polyptych blank --off"]),
    ("freeze", &["polyptych freeze", "polyptych freeze --off"]),
    ("pattern", &["polyptych pattern grid", "polyptych pattern --off"]),
    (
        "tune",
        &[
            "polyptych tune left pin.upper-left=+1.5,-0.5 gain=1,0.9,1",
            "polyptych tune left bend=5x5",
            "polyptych tune left --show",
        ],
    ),
    (
        "status",
        &[
            "polyptych status",
            "polyptych status --watch",
            "polyptych status --json --manager wall.example:7878",
        ],
    ),
    ("devices", &["polyptych devices wall.toml", "polyptych devices wall.toml --manager wall-pc"]),
    ("stop", &["polyptych stop", "polyptych stop --servers"]),
    (
        "login",
        &["polyptych login", "polyptych login --http 127.0.0.1:8080", "polyptych login --token"],
    ),
    ("keys", &["polyptych keys wall.toml", "polyptych keys wall.toml --client tracker --out keys"]),
    ("check", &["polyptych check wall.toml", "polyptych check wall.toml --json"]),
    ("prove", &["polyptych prove configs/wall-2x2.toml --out proof"]),
    ("wall grid", &["polyptych wall grid --columns 3 --rows 2 --bezel 0.01x0.01 -o wall.toml"]),
    ("wall arch", &["polyptych wall arch --channels 3 --degrees 120 -o wall.toml"]),
    ("wall cylinder", &["polyptych wall cylinder --channels 8 --degrees 240 -o wall.toml"]),
    ("wall cave", &["polyptych wall cave --walls 5 --size 3 -o wall.toml"]),
    ("wall dome", &["polyptych wall dome --channels 6 --radius 5 -o wall.toml"]),
    ("wall fisheye", &["polyptych wall fisheye --degrees 180 --tilt 27 --radius 5 -o dome"]),
    ("wall equirectangular", &["polyptych wall equirectangular --pixels 4096x2048 -o sphere"]),
    ("wall cube-map", &["polyptych wall cube-map --side 1024 -o cube"]),
    ("wall mirror", &["polyptych wall mirror --radius 5 --mirror 0,-0.2,4.6 -o dome"]),
    (
        "wall import",
        &[
            "polyptych wall import calibration.mpcdi -o wall --width 6 --distance 4",
            "polyptych wall import fisheye.json -o wall",
        ],
    ),
    ("wall save", &["polyptych wall save wall.toml"]),
    ("wall schema", &["polyptych wall schema"]),
    (
        "replay",
        &[
            "polyptych replay wall.rec",
            "polyptych replay wall.rec --keep lost-server --from 12 --to 15",
        ],
    ),
    ("scene town", &["polyptych scene town --blocks 8 --seed 3 -o town.glb"]),
    (
        "bake",
        &[
            "polyptych bake town.glb -o store",
            "polyptych bake helmet.glb -o store --strict",
            "polyptych bake town.glb -o store --upload s3://walls/blobs",
            "polyptych bake left.pfm -o store --as warp",
        ],
    ),
    (
        "bench",
        &[
            "polyptych bench town.glb helmet.glb --out report",
            "polyptych bench --size 1280x720 --error-bounds 0.5,2 --channels 4",
            "polyptych bench town.glb --size 640x360 --poses 1000 --random-views 7",
        ],
    ),
    (
        "gallery",
        &["polyptych gallery models", "polyptych gallery models -o all.png --size 640x360 --json"],
    ),
    ("bench barrier", &["polyptych bench barrier --servers 16 --frames 500"]),
    ("completions", &["polyptych completions bash", "polyptych completions fish"]),
    ("man", &["polyptych man -o man1"]),
];

/// Returns the command with examples in the help of it and of all commands below it.
pub(super) fn with_examples(command: Command) -> Command {
    below(command, "")
}

fn below(command: Command, above: &str) -> Command {
    let path = |name: &str| format!("{above} {name}").trim().to_owned();
    let named = |sub: Command| {
        let path = path(sub.get_name());
        below(sub, &path)
    };
    let is_it = |name: &str| {
        let rest = name.strip_prefix(above);
        rest.is_some_and(|rest| rest.is_empty() || above.is_empty() || rest.starts_with(' '))
    };
    let mine = EXAMPLES.iter().filter(|(name, _)| is_it(name)).collect::<Vec<_>>();
    let lines: Vec<&str> = match mine[..] {
        [(_, lines)] => lines.to_vec(),
        // A group of commands has the first line of each.
        _ if !above.is_empty() => {
            mine.iter().filter_map(|(_, lines)| lines.first().copied()).collect()
        }
        _ => vec!["polyptych demo", "polyptych check wall.toml", "polyptych help simulate"],
    };
    let text = format!("Examples:\n  {}", lines.join("\n  "));
    let text = match command.get_after_help() {
        Some(before) => format!("{before}\n\n{text}"),
        None => text,
    };
    command.mut_subcommands(named).after_help(text)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::super::{Cli, command};
    use super::*;

    /// All commands that can be run, by their names: those that have none below them, and those
    /// that need none of these.
    fn leaves(command: &Command, above: &str, found: &mut Vec<String>) {
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            let path = format!("{above} {}", sub.get_name()).trim().to_owned();
            leaves(sub, &path, found);
            if !sub.has_subcommands() || sub.is_args_conflicts_with_subcommands_set() {
                found.push(path);
            }
        }
    }

    /// The words of a line, as a shell parts them.
    fn words(line: &str) -> Vec<String> {
        let parts = line.split('"').enumerate();
        let words = parts.flat_map(|(index, part)| match index % 2 {
            0 => part.split_whitespace().map(str::to_owned).collect(),
            _ => vec![part.to_owned()],
        });
        words.collect()
    }

    #[test]
    fn every_command_has_examples_which_it_understands() {
        let mut commands = Vec::new();
        leaves(&Cli::command(), "", &mut commands);
        let named: Vec<&str> = EXAMPLES.iter().map(|(name, _)| *name).collect();
        for command in &commands {
            assert!(named.contains(&command.as_str()), "{command} has no example");
        }
        for (name, lines) in EXAMPLES {
            assert!(commands.iter().any(|command| command == name), "there is no command {name}");
            for line in *lines {
                assert!(line.starts_with(&format!("polyptych {name}")), "{name}: {line}");
                if let Err(error) = command().try_get_matches_from(words(line)) {
                    panic!("{line}: {error}");
                }
            }
        }
    }

    #[test]
    fn help_ends_with_examples_and_the_log_stands_behind_the_options() {
        let mut all = Vec::new();
        leaves(&Cli::command(), "", &mut all);
        for path in all {
            let mut whole = command();
            whole.build();
            let mut found = &mut whole;
            for name in path.split(' ') {
                found = found.find_subcommand_mut(name).expect("a command");
            }
            for help in [found.render_help(), found.render_long_help()] {
                let help = help.to_string();
                let at = |part: &str| help.find(part).unwrap_or_else(|| panic!("{part}: {help}"));
                let (own, log, examples) =
                    (at("--help"), at("\n      --log <LOG>"), at("\nExamples:\n  polyptych "));
                assert!(own < log && log < examples, "{path}: {help}");
            }
        }
    }
}
