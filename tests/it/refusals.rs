//! Bad input gives a clear error, commands fail, and the wall stays as it was.

mod expansion;
mod peers;
mod scenes;
mod walls;
