//! The scene of a file that is shown, of those that the file has.

use super::document::{Document, Scene};
use super::error::BakeError;

/// Maximum number of scenes that a message lists.
const LISTED_MAX: usize = 8;

/// Maximum number of characters of a scene's name in a message.
const NAME_CHARS_MAX: usize = 20;

/// The scene that is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SceneChoice {
    /// Its place in the file's list; `None` if the file has no scenes.
    pub index: Option<u32>,
    /// The caller named it.
    pub is_asked: bool,
}

impl SceneChoice {
    /// The scene with this name, or this number if none has the name; without a name, the scene
    /// that the file names, or else its first.
    ///
    /// # Errors
    /// A name that is not there, with those that are.
    pub(super) fn of(document: &Document, wanted: Option<&str>) -> Result<Self, BakeError> {
        let Some(wanted) = wanted else {
            if let Some(index) = document.scene {
                document.scenes.at(index, "scene")?;
            }
            let index = document.scene.or(document.scenes.first().map(|_| 0));
            return Ok(Self { index, is_asked: false });
        };
        let is_it = |scene: &Scene| !wanted.is_empty() && scene.name == wanted;
        let named = document.scenes.iter().position(is_it);
        let numbered = || wanted.parse().ok().filter(|at: &usize| *at < document.scenes.len());
        let Some(index) = named.or_else(numbered) else {
            let what = format!("there is no scene '{}'", short(wanted));
            let right = if document.scenes.is_empty() {
                "the file has no list of scenes; open it without --scene".to_owned()
            } else {
                format!("--scene takes a name or a number of {}", list(document))
            };
            return Err(BakeError::at("scenes", what, right));
        };
        // Lists of a file that can be read are far shorter.
        Ok(Self { index: u32::try_from(index).ok(), is_asked: true })
    }

    /// Returns what tells this choice from other choices of the same file: nothing if there is no
    /// other one.
    pub(super) fn key(self, document: &Document) -> Option<u32> {
        self.index.filter(|_| self.is_asked && document.scenes.len() > 1)
    }

    /// Returns the note that there are other scenes, unless the caller has chosen.
    pub(super) fn note(self, document: &Document) -> Option<String> {
        let index = self.index.filter(|_| !self.is_asked && document.scenes.len() > 1)?;
        let (count, all) = (document.scenes.len(), list(document));
        let this = title(document, index as usize);
        Some(format!("{count} scenes: {all}; this is {this}; --scene chooses another"))
    }
}

/// The names of the first scenes, and how many more there are.
fn list(document: &Document) -> String {
    let titles = (0..document.scenes.len()).take(LISTED_MAX).map(|at| title(document, at));
    let all: Vec<String> = titles.collect();
    let more = document.scenes.len() - all.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", all.join(", "))
}

/// Returns the text that chooses a scene: its name, or its number if it has none or an earlier one
/// has the name.
fn title(document: &Document, at: usize) -> String {
    let name = &document.scenes[at].name;
    let is_first = document.scenes.iter().position(|scene| scene.name == *name) == Some(at);
    if is_first && !name.trim().is_empty() { short(name) } else { at.to_string() }
}

/// The start of a name.
fn short(name: &str) -> String {
    match name.char_indices().nth(NAME_CHARS_MAX) {
        Some((end, _)) => format!("{}…", &name[..end]),
        None => name.to_owned(),
    }
}
