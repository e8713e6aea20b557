//! The environment of scenes: a change like any other, which all servers prepare.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_scene::{Fog, ToneMapper};

use super::*;

fn studio() -> Environment {
    Environment { name: "studio.hdr".into(), blob: BlobHash([7; 32]) }
}

#[test]
fn surroundings_are_shown_once_all_servers_have_them_and_are_kept() {
    let mut stage = ClusterFixture::new(2);
    let digest = stage.cluster.status(stage.now).digest;
    let id = stage.request(Request::SetEnvironment(EnvironmentSource::Baked(studio())));
    assert!(stage.replies.iter().all(|(of, _)| *of != id), "no server has them yet");
    assert_eq!(stage.cluster.status(stage.now).environment, None);
    stage.prepare_all();
    assert!(stage.replies.contains(&(id, Ok(Response::Done))), "{:?}", stage.replies);
    let status = stage.cluster.status(stage.now);
    assert_eq!(status.environment.as_deref(), Some("studio.hdr"));
    assert_ne!(status.digest, digest);
    // The next manager has them from the beginning.
    let memory = stage.memories.last().expect("remembered").clone();
    assert_eq!(memory.environment, Some(studio()));
    let wall = stage.cluster.wall.clone();
    let restored = Cluster::restore(wall, Epoch(9), &memory);
    assert_eq!(restored.status(0).environment, status.environment);
    assert_eq!(restored.shown.digest(), restored.shown_digest);

    let id = stage.request(Request::SetEnvironment(EnvironmentSource::None));
    stage.prepare_all();
    assert!(stage.replies.contains(&(id, Ok(Response::Done))), "{:?}", stage.replies);
    assert_eq!(stage.cluster.status(stage.now).environment, None);
    assert_eq!(stage.memories.last().expect("remembered").environment, None);
}

#[test]
fn what_was_not_baked_is_refused_and_tone_and_fog_are_kept() {
    let mut stage = ClusterFixture::new(2);
    for source in [EnvironmentSource::Sky, EnvironmentSource::File { path: "a.hdr".into() }] {
        let id = stage.request(Request::SetEnvironment(source));
        let is_refused = |(of, reply): &(RequestId, Result<_, _>)| *of == id && reply.is_err();
        assert!(stage.replies.iter().any(is_refused), "{:?}", stage.replies);
    }
    stage.request(Request::SetTone(ToneMapper::Aces));
    let fog = Some(Fog { half_height: Some(4.0), ..Fog::even(90.0) });
    stage.request(Request::SetFog(fog));
    stage.prepare_all();
    let wrong = stage.request(Request::SetFog(Some(Fog::even(-1.0))));
    let (of, reply) = stage.replies.pop().expect("an answer");
    assert!(of == wrong && reply.expect_err("refused").reason.contains("visibility"));
    stage.draw(&[0, 1], 20_000);
    stage.frames.clear();
    stage.order_frame();
    let frames = &stage.frames;
    assert!(!frames.is_empty());
    assert!(frames.iter().all(|(_, frame)| frame.presentation.tone == ToneMapper::Aces));
    assert!(frames.iter().all(|(_, frame)| frame.presentation.fog == fog));
    let memory = stage.memories.last().expect("remembered");
    assert_eq!((memory.presentation.tone, memory.presentation.fog), (ToneMapper::Aces, fog));
    let restored = Cluster::restore(wall(2), Epoch(7), memory);
    assert_eq!(restored.presentation.fog, fog);
}
