//! The reference of the wall file, `docs/wall-file.md`: written from the schema's types and their
//! comments, with examples that are read here too.

use std::collections::BTreeSet;
use std::fmt::Write;

use serde_json::Value;

use super::*;

/// A section of the wall file.
struct Section {
    /// Its type in the schema.
    of: &'static str,
    /// The heading, as in a file.
    heading: &'static str,
    /// An example of the section.
    example: &'static str,
    /// The text before and after the example that makes it a whole file.
    around: [&'static str; 2],
}

const WALL: &str = "[wall]\nname = \"lab\"\n";
const FRONT: &str = "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\n\
                     size = [4.0, 1.125]\ncenter = [0.0, 1.6, -2.0]\n";
const TILES: &str = "[screen.tiles]\ncolumns = 2\npixels = [1920, 1080]\n";
const TILED: &str = "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\n\
                     size = [4.0, 1.125]\ncenter = [0.0, 1.6, -2.0]\n\
                     [screen.tiles]\ncolumns = 2\npixels = [1920, 1080]\n";
const CURVED: &str = "[wall]\nname = \"lab\"\n[[screen]]\nname = \"curve\"\npixels = [2400, 900]\n";
const THROWN: &str = "[[screen.channel]]\nname = \"curve\"\npixels = [1920, 1080]\n\
                      [screen.channel.projector]\nposition = [0.0, 2.0, 1.0]\n\
                      look_at = [0.0, 2.0, -2.0]\ndegrees = [60.0, 34.0]\n";

const TRACKED: &str = "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\n\
                       size = [4.0, 1.125]\ncenter = [0.0, 1.6, -2.0]\n\
                       [screen.tiles]\ncolumns = 2\npixels = [1920, 1080]\n\
                       [[device]]\nname = \"t\"\nkind = \"osc\"\nlisten = \"0.0.0.0:9000\"\n";

/// In the order in which a person writes them.
const SECTIONS: &[Section] = &[
    Section {
        of: "WallSection",
        heading: "[wall]",
        example: "[wall]\nname = \"lab\"\neye = [0.0, 1.6, 0.0]\nnear = 0.05\n",
        around: [
            "",
            "[[screen]]\nname = \"front\"\nsize = [4.0, 1.125]\ncenter = [0.0, 1.6, -2.0]\n\
                      [screen.tiles]\ncolumns = 2\npixels = [1920, 1080]\n",
        ],
    },
    Section {
        of: "ScreenSection",
        heading: "[[screen]]",
        example: "[[screen]]\nname = \"front\"\nsize = [4.0, 1.125]\ncenter = [0.0, 1.6, -2.0]\n",
        around: [WALL, TILES],
    },
    Section {
        of: "TilesSection",
        heading: "[screen.tiles]",
        example: "[screen.tiles]\ncolumns = 2\nrows = 1\npixels = [1920, 1080]\n\
                  bezel = [0.012, 0.0]\n",
        around: [FRONT, ""],
    },
    Section {
        of: "HiddenSection",
        heading: "[[screen.hidden]]",
        example: "[[screen.hidden]]\norigin = [0, 0]\npixels = [200, 1080]\n",
        around: [
            "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.125]\n\
             center = [0.0, 1.6, -2.0]\npixels = [2120, 1080]\n",
            "[[screen.channel]]\nname = \"left\"\norigin = [200, 0]\npixels = [1920, 1080]\n",
        ],
    },
    Section {
        of: "CylinderSection",
        heading: "[screen.cylinder]",
        example: "[screen.cylinder]\ncenter = [0.0, 1.5, 0.0]\nradius = 4.0\n\
                  degrees = [-60.0, 60.0]\nheight = [0.0, 3.0]\n",
        around: [CURVED, THROWN],
    },
    Section {
        of: "SphereSection",
        heading: "[screen.sphere]",
        example: "[screen.sphere]\ncenter = [0.0, 1.5, 0.0]\nradius = 4.0\n\
                  azimuth = [-60.0, 60.0]\nelevation = [-30.0, 30.0]\n",
        around: [CURVED, THROWN],
    },
    Section {
        of: "ChannelSection",
        heading: "[[screen.channel]]",
        example: "[[screen.channel]]\nname = \"left\"\norigin = [0, 0]\npixels = [1920, 1080]\n\
                  server = \"render-1\"\n",
        around: [
            "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\nsize = [2.0, 1.125]\n\
                  center = [0.0, 1.6, -2.0]\npixels = [1920, 1080]\n",
            "",
        ],
    },
    Section {
        of: "ProjectorSection",
        heading: "[screen.channel.projector]",
        example: "[screen.channel.projector]\nposition = [0.0, 2.0, 1.0]\n\
                  rotation = [0.0, 0.0, 0.0]\ndegrees = [60.0, 34.0]\n",
        around: [
            "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\nsize = [3.0, 1.6]\n\
                  center = [0.0, 2.0, -2.0]\npixels = [1920, 1024]\n[[screen.channel]]\n\
                  name = \"front\"\npixels = [1920, 1080]\n",
            "",
        ],
    },
    Section {
        of: "AdjustSection",
        heading: "[channel.NAME]",
        example: "[channel.front-1-1]\nturn = \"half\"\ngamma = 2.4\ngain = [1.0, 0.98, 0.95]\n\
                  pin = [[0.0, 0.0], [0.0, 0.0], [-2.5, 1.0], [0.0, 0.0]]\n",
        around: [TILED, ""],
    },
    Section {
        of: "BendSection",
        heading: "[channel.NAME.bend]",
        example: "[channel.front-1-1.bend]\npoints = [2, 2]\n\
                  moves = [[0.0, 0.0], [0.0, 0.0], [1.5, -0.5], [0.0, 0.0]]\n",
        around: [TILED, ""],
    },
    Section {
        of: "EdgesSection",
        heading: "[channel.NAME.edges]",
        example: "[channel.front-1-1.edges]\nright = 320.0\n",
        around: [
            "[wall]\nname = \"lab\"\n[[screen]]\nname = \"front\"\nsize = [4.0, 1.125]\n\
             center = [0.0, 1.6, -2.0]\n[screen.tiles]\ncolumns = 2\npixels = [1920, 1080]\n\
             overlap = [400, 0]\n",
            "",
        ],
    },
    Section {
        of: "BlendSection",
        heading: "[blend]",
        example: "[blend]\nexponent = 1.0\nleak = 0.003\n",
        around: [TILED, ""],
    },
    Section {
        of: "DeadlineSection",
        heading: "[deadline]",
        example: "[deadline]\nmin_ms = 50\nmax_ms = 2000\n",
        around: [TILED, ""],
    },
    Section {
        of: "SyncSection",
        heading: "[sync]",
        example: "[sync]\npipeline_depth = 0\nswap_lead_ms = 5\n",
        around: [TILED, ""],
    },
    Section {
        of: "BudgetSection",
        heading: "[budget]",
        example: "[budget]\ngpu_mib = 6144\nhost_mib = 1024\n",
        around: [TILED, ""],
    },
    Section {
        of: "NetworkSection",
        heading: "[network]",
        example: "[network]\nlisten = \"192.168.7.1:7878\"\nheartbeat_ms = 2000\n",
        around: [TILED, ""],
    },
    Section {
        of: "StorageSection",
        heading: "[storage]",
        example: "[storage]\nscenes = [\"scenes\", \"/srv/scenes\"]\n\
                  stores = [\"/mnt/blobs\", \"s3://walls/blobs\"]\n",
        around: [TILED, ""],
    },
    Section {
        of: "LaunchSection",
        heading: "[launch]",
        example: "[launch]\nmanager = \"operator@head\"\naddress = \"head.example:7878\"\n\
                  keys = \"/etc/polyptych/keys\"\noutput = \"fullscreen\"\n\
                  environment = { DISPLAY = \":0\" }\n",
        around: [TILED, ""],
    },
    Section {
        of: "ServerSection",
        heading: "[server.NAME]",
        example: "[server.front-1-1]\nhost = \"operator@render1\"\n\
                  environment = { XAUTHORITY = \"/run/user/1000/gdm/Xauthority\" }\n",
        around: [TILED, ""],
    },
    Section {
        of: "DeviceSection",
        heading: "[[device]]",
        example: "[[device]]\nname = \"tracker\"\nkind = \"osc\"\nlisten = \"0.0.0.0:9000\"\n",
        around: [TILED, "[device.head]\npose = \"/head\"\n"],
    },
    Section {
        of: "FrameSection",
        heading: "[device.frame]",
        example: "[device.frame]\naxes = [\"x\", \"z\", \"-y\"]\nunit = 0.001\n\
                  origin = [0.0, 0.0, -2.0]\n",
        around: [TRACKED, "[device.head]\npose = \"/head\"\n"],
    },
    Section {
        of: "HeadSection",
        heading: "[device.head]",
        example: "[device.head]\nposition = \"/head/position\"\nrotation = \"/head/angles\"\n\
                  form = \"euler-degrees\"\norder = \"yxz\"\neyes = [0.0, -0.06, -0.09]\n\
                  prediction_ms = 20\nbounds = [[-2.0, 1.0, -1.0], [2.0, 2.1, 3.0]]\n",
        around: [TRACKED, ""],
    },
    Section {
        of: "FlySection",
        heading: "[device.fly]",
        example: "[device.fly]\nforward = \"/wand/stick[1]\"\nturn = \"/wand/stick\"\n\
                  speed = 2.0\n",
        around: [TRACKED, ""],
    },
];

const HEAD: &str = "# The wall file, key by key

Written from the program's own types; `polyptych wall schema` prints the same for editors. Places
are in metres of display space: x right, y up, the viewer looks along −z. Angles are in degrees,
sizes of pictures in pixels. Every other key is refused, with the place and the nearest key that
there is. Whole files stand in [`configs`](../configs).
";

/// A comment as one line of a table.
fn line(value: &Value) -> String {
    let text = value["description"].as_str().unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

/// Describes the values that a key takes, in a few words.
fn takes(defs: &Value, of: &Value) -> String {
    if let Some(name) = of["$ref"].as_str().and_then(|path| path.rsplit('/').next()) {
        if let Some(section) = SECTIONS.iter().find(|section| section.of == name) {
            return format!("`{}`", section.heading);
        }
        return takes(defs, &defs[name]);
    }
    if let Some(word) = of["const"].as_str() {
        return format!("`\"{word}\"`");
    }
    for many in ["anyOf", "oneOf"] {
        if let Some(all) = of[many].as_array() {
            let all = all.iter().filter(|one| one["type"] != "null");
            let mut words: Vec<String> = Vec::new();
            for word in all.map(|one| takes(defs, one)) {
                if !words.contains(&word) {
                    words.push(word);
                }
            }
            return words.join(" or ");
        }
    }
    let kind = match &of["type"] {
        Value::Array(kinds) => kinds.iter().find(|kind| *kind != "null").unwrap_or(&Value::Null),
        kind => kind,
    };
    match kind.as_str() {
        Some("array") => {
            let item = of.get("items").map_or_else(String::new, |item| takes(defs, item));
            match of["maxItems"].as_u64() {
                Some(count) => format!("{count} × {item}"),
                None => format!("list of {item}"),
            }
        }
        Some("integer") => "whole number".into(),
        Some("boolean") => "`true` or `false`".into(),
        Some(other) => other.into(),
        None => panic!("no words for {of}"),
    }
}

/// The reference as it must stand in `docs`.
fn reference() -> String {
    let schema: Value = serde_json::from_str(&schema()).expect("a schema");
    let defs = &schema["$defs"];
    let mut text = HEAD.to_owned();
    for section in SECTIONS {
        let of = &defs[section.of];
        write!(text, "\n## `{}`\n\n{}\n\n", section.heading, line(of)).expect("text");
        text.push_str("| key | takes | default | what it is |\n|---|---|---|---|\n");
        let required = of["required"].as_array().cloned().unwrap_or_default();
        for (key, value) in of["properties"].as_object().expect("keys") {
            let default = match value.get("default") {
                _ if required.iter().any(|name| name == key) => "required".to_owned(),
                None | Some(Value::Null) => String::new(),
                Some(default) if default.is_object() => "as below".to_owned(),
                Some(default) => format!("`{default}`"),
            };
            let takes = takes(defs, value);
            writeln!(text, "| `{key}` | {takes} | {default} | {} |", line(value)).expect("text");
        }
        write!(text, "\n```toml\n{}```\n", section.example).expect("text");
    }
    text
}

#[test]
fn the_reference_in_docs_is_that_of_the_types() {
    let path = configs().join("../docs/wall-file.md");
    if std::env::var_os("UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::write(&path, reference()).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == reference(), "{} is stale: run with UPDATE_GOLDEN=1", path.display());
}

#[test]
fn every_section_stands_in_the_reference_and_its_example_is_read() {
    let schema: Value = serde_json::from_str(&schema()).expect("a schema");
    let defs = schema["$defs"].as_object().expect("types");
    let sections = defs.iter().filter(|(_, of)| of["type"] == "object").map(|(name, _)| name);
    let described: BTreeSet<&str> = SECTIONS.iter().map(|section| section.of).collect();
    assert_eq!(sections.map(String::as_str).collect::<BTreeSet<_>>(), described);
    for Section { heading, example, around: [before, after], .. } in SECTIONS {
        let text = format!("{before}{example}{after}");
        if let Err(error) = parse(&text, "example.toml".as_ref()) {
            panic!("{heading}: {error}\n{text}");
        }
    }
}
