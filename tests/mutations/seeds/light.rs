//! What surrounds scenes, and how light is shown.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::luminance::{FrameLuminance, LUMINANCE_COUNTS};
use polyptych_protocol::request::Request;
use polyptych_scene::ToneMapper;
use polyptych_wall::ChannelId;

use super::messages::EPOCH;

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
    sources
        .into_iter()
        .map(Request::SetEnvironment)
        .chain(tones)
        .chain([Request::SetAutomaticExposure])
}

pub fn luminance() -> FrameLuminance {
    let counts = vec![300; LUMINANCE_COUNTS];
    FrameLuminance { epoch: EPOCH, frame: FrameId(1), channel: ChannelId(0), counts }
}
