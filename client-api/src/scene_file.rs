//! The file of a scene that is opened, with the scene that is meant if it has several.

/// A file in one of the manager's scene folders, and one of its scenes. A path is one as it is.
///
/// ```
/// use polyptych_client::SceneFile;
///
/// let town = SceneFile::from("town.glb");
/// let night = SceneFile::from("town.glb").scene("night");
/// assert_ne!(town, night);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFile {
    pub(crate) path: String,
    pub(crate) scene: Option<String>,
}

impl SceneFile {
    /// Names the scene of a file that has several, by its name, or by its number from 0 on if none
    /// has that name. Without it, the scene is opened that the file names, or else its first.
    #[must_use]
    pub fn scene(self, name: impl Into<String>) -> Self {
        Self { scene: Some(name.into()), ..self }
    }
}

impl<T: Into<String>> From<T> for SceneFile {
    fn from(path: T) -> Self {
        Self { path: path.into(), scene: None }
    }
}
