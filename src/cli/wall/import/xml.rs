//! XML as a [`Tree`]: elements are objects, their attributes and child elements its values.
//!
//! A DTD is refused, and with it all entities but the five of XML itself.

use std::path::Path;

use anyhow::anyhow;
use roxmltree::{Document, Error, ParsingOptions};

use super::tree::{DEPTH_MAX, Node, Spot, Tree, Value};

/// Most elements, attributes and texts of a configuration.
const NODES_MAX: u32 = 1 << 16;

/// Reads an XML text; returns it with the name of its root element, in small letters.
pub(super) fn parse(path: &Path, text: &str) -> anyhow::Result<(Tree, String)> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: NODES_MAX, ..Default::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let at = error.pos();
        let (what, remedy) = match &error {
            Error::DtdDetected | Error::UnknownEntityReference(..) => (
                "it has a DTD or entities, which are refused".to_owned(),
                "remove <!DOCTYPE …> and write what the entities stand for",
            ),
            Error::NodesLimitReached => {
                (format!("it has more than {NODES_MAX} elements"), "give a configuration")
            }
            _ => {
                let what = error.to_string();
                let what = what.rsplit_once(" at ").map_or(what.as_str(), |(what, _)| what);
                (what.to_owned(), "mend the XML there")
            }
        };
        anyhow!("{}:{}:{}: file: {what}; {remedy}", path.display(), at.row, at.col)
    })?;
    let root = document.root_element();
    let node = element(&document, root, 0).ok_or_else(|| {
        let what = format!("elements lie in each other more than {DEPTH_MAX} deep");
        anyhow!("{}:1:1: file: {what}; flatten it", path.display())
    })?;
    let name = root.tag_name().name().to_lowercase();
    Ok((Tree::new(path, true, node), name))
}

/// `None` where elements lie too deep in each other.
fn element(document: &Document<'_>, from: roxmltree::Node<'_, '_>, depth: usize) -> Option<Node> {
    if depth > DEPTH_MAX {
        return None;
    }
    let spot = |offset: usize| {
        let at = document.text_pos_at(offset);
        Spot { line: at.row, column: at.col }
    };
    let mut entries = Vec::new();
    for attribute in from.attributes() {
        let value = Value::Text(attribute.value().to_owned());
        let node = Node { spot: spot(attribute.range().start), value };
        entries.push((attribute.name().to_lowercase(), node));
    }
    for child in from.children().filter(roxmltree::Node::is_element) {
        let name = child.tag_name().name().to_lowercase();
        entries.push((name, element(document, child, depth + 1)?));
    }
    let text = from.text().unwrap_or_default().trim();
    if !text.is_empty() {
        let node = Node { spot: spot(from.range().start), value: Value::Text(text.to_owned()) };
        entries.push(("#text".to_owned(), node));
    }
    Some(Node { spot: spot(from.range().start), value: Value::Object(entries) })
}
