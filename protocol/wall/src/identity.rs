//! The identity of a wall: what it is, wherever its file lies and however its path was typed.

use polyptych_files::blob::BlobHash;

use super::{Surface, Wall};

impl Wall {
    /// Returns the same wall without paths: no scene and store folders, and files named by their
    /// content if they were baked. Equal for copies of a wall file in other folders.
    pub fn without_paths(&self) -> Self {
        let mut wall = self.clone();
        wall.scenes.clear();
        wall.stores.clear();
        for file in &mut wall.files {
            if let Some(blob) = file.blob {
                file.path = format!("content {blob}");
            }
        }
        wall
    }

    /// Returns the content of the file with this index, if it was baked.
    pub fn content_of(&self, file: Option<u16>) -> Option<BlobHash> {
        self.files.get(usize::from(file?))?.blob
    }

    /// Returns whether a screen of this wall has the same surface and canvas as one of another
    /// wall. Both are indices into `screens`.
    pub fn has_same_screen(&self, screen: u16, other: &Wall, of_other: u16) -> bool {
        let one = self.screens.get(usize::from(screen));
        let two = other.screens.get(usize::from(of_other));
        one.zip(two).is_some_and(|(one, two)| {
            let is_same_surface = match (&one.surface, &two.surface) {
                (Surface::Mesh(a), Surface::Mesh(b)) => {
                    self.content_of(Some(*a)) == other.content_of(Some(*b))
                }
                (a, b) => a == b,
            };
            is_same_surface && one.canvas == two.canvas
        })
    }
}
