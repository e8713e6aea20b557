//! Seeds of mutations: small valid inputs of every kind. The coverage-guided targets in
//! `tests/fuzz` begin from the same, and find these files by their paths.

#[path = "seeds/editing.rs"]
pub mod editing;
#[path = "seeds/light.rs"]
mod light;
#[path = "seeds/manifest.rs"]
pub mod manifest;
#[path = "seeds/maps.rs"]
pub mod maps;
#[path = "seeds/messages.rs"]
pub mod messages;
#[path = "seeds/scenes.rs"]
pub mod scenes;
#[path = "seeds/statistics.rs"]
mod statistics;
#[path = "seeds/walls.rs"]
pub mod walls;
