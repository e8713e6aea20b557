//! `polyptych wall save`: what was tuned on the running wall goes back into its file, which keeps
//! its comments, its layout and hand edits of what nobody tuned.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use polyptych_client::calibration_change::keys::{copy_key, differing_keys};
use polyptych_client::glam::{DMat3, DVec2, DVec3};
use polyptych_client::{TunedChannel, Wall, calibration_change};
use polyptych_files::output_file;
use polyptych_text::counted;
use polyptych_wall::channel_calibration::ControlGrid;
use polyptych_wall::{Channel, ChannelCalibration, TransferFunction};
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use super::super::{ManagerAddress, load_wall, say};
use crate::outputs;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    /// The wall file of the running wall
    file: PathBuf,
    #[command(flatten)]
    manager: ManagerAddress,
}

pub(in crate::cli) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    outputs::check_source(&arguments.file, true)?;
    let client = arguments.manager.connect()?;
    // The list first: a key that is tuned between the two requests is saved the next time.
    let tunings = client.tunings()?;
    let running = client.wall()?;
    let name = arguments.file.display();
    // A link stays a link: what it leads to is written.
    let path = fs::canonicalize(&arguments.file)
        .with_context(|| format!("cannot open {name}; give the file of the wall that runs"))?;
    // Size, coding and wall are looked at before anything is made of it.
    load_wall(&path)?;
    let before = fs::read_to_string(&path).with_context(|| format!("cannot read {name}"))?;
    let merged = with_adjustments(&before, &path, &running, &tunings)?;
    if merged.text != before {
        output_file::write_synced(&path, merged.text.as_bytes())
            .with_context(|| format!("cannot write {name}"))?;
        let channels = merged.channels.join(", ");
        say(format_args!("{name}: wrote the adjustment of {channels}"))?;
    } else if merged.kept.is_empty() {
        return say(format_args!("{name} says already what the wall is"));
    } else {
        say(format_args!("{name} says already what was tuned"))?;
    }
    merged.changes.iter().chain(&merged.kept).try_for_each(say)
}

/// A wall file with the tunings of the running wall.
#[derive(Default)]
struct Merged {
    text: String,
    /// The names of channels whose adjustment is written.
    channels: Vec<String>,
    /// A line for each key that is written, with the file's value before: it may be a hand edit.
    changes: Vec<String>,
    /// A line for each key in which the file differs from the wall though nobody tuned it.
    kept: Vec<String>,
}

/// Merges the keys that were tuned on the running wall into the text of a wall file. All others are
/// the file's, which may have been edited since the manager loaded it.
fn with_adjustments(
    text: &str,
    path: &Path,
    running: &Wall,
    tunings: &[TunedChannel],
) -> anyhow::Result<Merged> {
    let parse =
        |text: &str| polyptych_wall_file::parse(text, path).map_err(|error| anyhow!("{error}"));
    let described = parse(text)?;
    if let Some(difference) = difference(&described, running) {
        bail!("{} describes another wall than the one that runs: {difference}", path.display());
    }
    let mut document: DocumentMut = text.parse()?;
    let mut merged = Merged::default();
    let mut meant = Vec::new();
    for (before, now) in described.channels.iter().zip(&running.channels) {
        let name = &now.name;
        let tuned = tunings.iter().find(|tuned| tuned.channel == *name);
        let is_tuned =
            |key: &str| tuned.is_some_and(|tuned| tuned.keys.iter().any(|tuned| tuned == key));
        let mut adjustment = before.adjustment.clone();
        for key in differing_keys(&before.adjustment, &now.adjustment) {
            let [old, new] = [&before.adjustment, &now.adjustment].map(|of| value_words(key, of));
            if is_tuned(key) {
                copy_key(key, &now.adjustment, &mut adjustment);
                merged.changes.push(format!("{name}: {key} was {old} in the file, is {new} now"));
            } else {
                merged.kept.push(format!(
                    "{name}: {key} stays {old} in the file; it is {new} on the wall, where nobody \
                     tuned it"
                ));
            }
        }
        if adjustment != before.adjustment {
            let table = table_of(&mut document, name)
                .with_context(|| format!("{}: channel.{name} is no table", path.display()))?;
            adjust(table, &before.adjustment, &adjustment);
            merged.channels.push(name.clone());
        }
        meant.push(adjustment);
    }
    merged.text = document.to_string();
    let written = parse(&merged.text).context("what is tuned cannot be said in a wall file")?;
    if written.channels.iter().map(|channel| &channel.adjustment).ne(&meant) {
        bail!("what is tuned cannot be said in {}; nothing was written", path.display());
    }
    Ok(merged)
}

/// The value of a key for people.
fn value_words(key: &str, of: &ChannelCalibration) -> String {
    let width = |width: Option<f64>| width.map_or_else(|| "auto".to_owned(), |px| px.to_string());
    match key {
        "pin" => Value::from(of.pin.into_iter().map(pair).collect::<Array>()).to_string(),
        "bend" => match &of.bend {
            Some(bend) => format!("a grid of {}x{}", bend.points.x, bend.points.y),
            None => "off".to_owned(),
        },
        "edge.left" => width(of.edges.left),
        "edge.right" => width(of.edges.right),
        "edge.top" => width(of.edges.top),
        "edge.bottom" => width(of.edges.bottom),
        "gain" => light(of.color.gain).to_string(),
        "matrix" => matrix(of.color.matrix).to_string(),
        "leak" => of.color.leak.map_or_else(|| "auto".to_owned(), |of| light(of).to_string()),
        _ => match &of.color.curve {
            TransferFunction::Srgb => "srgb".to_owned(),
            TransferFunction::Gamma(gamma) => light(*gamma).to_string(),
            TransferFunction::Measured(_) => "a curve".to_owned(),
        },
    }
}

/// In what two walls differ beside what can be tuned.
fn difference(file: &Wall, running: &Wall) -> Option<String> {
    if file.name != running.name {
        return Some(format!("its name is {:?}, not {:?}", file.name, running.name));
    }
    if file.screens != running.screens {
        return Some("its screens are others".to_owned());
    }
    if file.channels.len() != running.channels.len() {
        let counts = (file.channels.len(), running.channels.len());
        return Some(format!("it has {}, not {}", counted(counts.0, "channel"), counts.1));
    }
    let is_other = |(file, running): &(&Channel, &Channel)| {
        let adjustment = file.adjustment.clone();
        !calibration_change::differs_only_by_calibration(&adjustment, &running.adjustment)
            || **file != Channel { adjustment, ..(*running).clone() }
    };
    let (other, _) = file.channels.iter().zip(&running.channels).find(is_other)?;
    Some(format!("its channel {} is another", other.name))
}

/// `[channel.NAME]`, at the end of the file where there is none.
fn table_of<'a>(document: &'a mut DocumentMut, name: &str) -> Option<&'a mut dyn TableLike> {
    let mut all = Table::new();
    all.set_implicit(true);
    let all = document.as_table_mut().entry("channel").or_insert(Item::Table(all));
    let one = all.as_table_like_mut()?.entry(name).or_insert_with(|| Item::Table(Table::new()));
    one.as_table_like_mut()
}

/// Writes what differs, and nothing else.
fn adjust(table: &mut dyn TableLike, before: &ChannelCalibration, now: &ChannelCalibration) {
    if before.pin != now.pin {
        set(table, "pin", now.pin.into_iter().map(pair).collect::<Array>().into());
    }
    if before.bend != now.bend {
        match &now.bend {
            Some(bend) => set_bend(table, bend),
            None => drop(table.remove("bend")),
        }
    }
    let (old, new) = (&before.edges, &now.edges);
    for (name, old, new) in [
        ("left", old.left, new.left),
        ("right", old.right, new.right),
        ("top", old.top, new.top),
        ("bottom", old.bottom, new.bottom),
    ] {
        if old != new {
            set_edge(table, name, new);
        }
    }
    let (old, new) = (&before.color, &now.color);
    if old.gain != new.gain {
        set(table, "gain", light(new.gain));
    }
    if old.leak != new.leak {
        match new.leak {
            Some(leak) => set(table, "leak", light(leak)),
            None => drop(table.remove("leak")),
        }
    }
    if old.matrix != new.matrix {
        set(table, "matrix", matrix(new.matrix));
    }
    if old.curve != new.curve {
        table.remove("curve");
        match &new.curve {
            TransferFunction::Gamma(gamma) => set(table, "gamma", light(*gamma)),
            TransferFunction::Srgb | TransferFunction::Measured(_) => drop(table.remove("gamma")),
        }
    }
}

/// A value, with the comment and the spaces of the one that was there.
fn set(table: &mut dyn TableLike, key: &str, mut value: Value) {
    match table.get_mut(key) {
        Some(item) => {
            if let Some(old) = item.as_value() {
                value.decor_mut().clone_from(old.decor());
            }
            *item = Item::Value(value);
        }
        None => drop(table.insert(key, Item::Value(value))),
    }
}

fn inner<'a>(table: &'a mut dyn TableLike, key: &str) -> Option<&'a mut dyn TableLike> {
    let new = || Item::Value(Value::InlineTable(InlineTable::new()));
    table.entry(key).or_insert_with(new).as_table_like_mut()
}

fn set_edge(table: &mut dyn TableLike, name: &str, width: Option<f64>) {
    let Some(edges) = inner(table, "edges") else { return };
    match width {
        Some(width) => set(edges, name, width.into()),
        None => drop(edges.remove(name)),
    }
    if edges.is_empty() {
        table.remove("edges");
    }
}

fn set_bend(table: &mut dyn TableLike, bend: &ControlGrid) {
    let Some(inner) = inner(table, "bend") else { return };
    let points = bend.points.to_array().map(i64::from);
    set(inner, "points", points.into_iter().collect::<Array>().into());
    // A row of points to a line.
    let moves = bend.moves.iter().enumerate().map(|(at, to)| {
        let is_first = at % bend.points.x as usize == 0;
        pair(*to).decorated(if is_first { "\n    " } else { " " }, "")
    });
    let mut moves: Array = moves.collect();
    moves.set_trailing_comma(true);
    moves.set_trailing("\n");
    set(inner, "moves", moves.into());
}

fn pair(point: DVec2) -> Value {
    point.to_array().into_iter().collect::<Array>().into()
}

fn light(light: DVec3) -> Value {
    if light == DVec3::splat(light.x) {
        light.x.into()
    } else {
        light.to_array().into_iter().collect::<Array>().into()
    }
}

fn matrix(matrix: DMat3) -> Value {
    let rows = matrix.transpose().to_cols_array_2d();
    let row = |row: [f64; 3]| Value::from(row.into_iter().collect::<Array>());
    rows.map(row).into_iter().collect::<Array>().into()
}

#[cfg(test)]
mod tests;
