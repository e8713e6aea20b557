//! What surrounds scenes, and how light is shown.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_protocol::request::Request;
use polyptych_scene::ToneMapper;

pub fn environment() -> Environment {
    Environment { name: "studio.hdr".into(), blob: BlobHash([0x5e; 32]) }
}

pub fn lights() -> impl Iterator<Item = Request> {
    let sources = [
        EnvironmentSource::None,
        EnvironmentSource::File { path: "studio.hdr".into() },
        EnvironmentSource::Sky,
        EnvironmentSource::Baked(environment()),
    ];
    let tones = ToneMapper::ALL.map(Request::SetTone);
    sources.into_iter().map(Request::SetEnvironment).chain(tones)
}
