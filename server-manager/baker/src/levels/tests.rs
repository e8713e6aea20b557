//! Levels of surfaces made in code.
