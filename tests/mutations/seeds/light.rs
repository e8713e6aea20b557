//! The surroundings of scenes, and requests for the display of light.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::luminance::{FrameLuminance, LUMINANCE_COUNTS};
use polyptych_protocol::request::Request;
use polyptych_protocol::state_log::Operation;
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, LightEffects, ToneMapper};
use polyptych_wall::ChannelId;

use super::messages::EPOCH;

fn environment() -> Environment {
    Environment { name: "studio.hdr".into(), blob: BlobHash([0x5e; 32]) }
}

pub fn light_operations() -> [Operation; 2] {
    let effects =
        LightEffects { fog: true, glow: false, ambient_occlusion: true, depth_of_field: true };
    [Operation::SetEnvironment(Some(environment())), Operation::SetEffects(effects)]
}

pub fn lights() -> impl Iterator<Item = Request> {
    let sources = [
        EnvironmentSource::None,
        EnvironmentSource::File { path: "studio.hdr".into() },
        EnvironmentSource::Sky,
        EnvironmentSource::Baked(environment()),
    ];
    let tones = ToneMapper::ALL.map(Request::SetTone);
    sources.into_iter().map(Request::SetEnvironment).chain(tones).chain([
        Request::SetAutomaticExposure,
        Request::SetFog(None),
        Request::SetFog(Some(fog())),
        Request::SetGlow(None),
        Request::SetGlow(Some(Glow { strength: 0.125, width_degrees: 2.5 })),
        Request::SetAmbientOcclusion(None),
        Request::SetAmbientOcclusion(Some(AmbientOcclusion { radius: 0.75 })),
        Request::SetDepthOfField(None),
        Request::SetDepthOfField(Some(DepthOfField { focus: 7.5, aperture: 0.125 })),
    ])
}

pub fn fog() -> Fog {
    Fog { height: -2.0, half_height: Some(15.0), color: [0.9, 1.0, 0.8], ..Fog::even(400.0) }
}

pub fn luminance() -> FrameLuminance {
    let counts = vec![300; LUMINANCE_COUNTS];
    FrameLuminance { epoch: EPOCH, frame: FrameId(1), channel: ChannelId(0), counts }
}
