//! Effects of light: servers get ready for those that there were none of.

use polyptych_scene::{AmbientOcclusion, Fog, Glow, LightEffects};

use super::*;

const FOG: LightEffects = LightEffects { fog: true, ..LightEffects::NONE };

/// Returns whether a request was answered as done.
fn is_done(stage: &ClusterFixture, id: RequestId) -> bool {
    stage.replies.contains(&(id, Ok(Response::Done)))
}

#[test]
fn frames_have_an_effect_once_all_servers_are_ready_for_it() {
    let mut stage = ClusterFixture::new(2);
    let fog = |visibility| Request::SetFog(Some(Fog::even(visibility)));
    let first = stage.request(fog(90.0));
    assert!(!is_done(&stage, first), "no server is ready for it");
    stage.frames.clear();
    stage.order_frame();
    assert!(!stage.frames.is_empty());
    assert!(stage.frames.iter().all(|(_, frame)| frame.presentation.fog.is_none()));
    // Behind it, in turn.
    let second = stage.request(fog(50.0));
    assert!(!is_done(&stage, second));
    stage.prepare_all();
    assert!(is_done(&stage, first) && is_done(&stage, second));
    assert_eq!(stage.cluster.presentation.fog, Some(Fog::even(50.0)));
    assert_eq!(stage.cluster.shown.effects, FOG);

    // Other numbers need nothing of the servers.
    let revision = stage.cluster.shown.revision;
    let third = stage.request(fog(70.0));
    assert!(is_done(&stage, third) && stage.cluster.shown.revision == revision);

    let none = stage.request(Request::SetFog(None));
    assert!(!is_done(&stage, none), "frames without it need other pipelines");
    stage.prepare_all();
    assert!(is_done(&stage, none));
    assert_eq!(stage.cluster.shown.effects, LightEffects::NONE);
}

#[test]
fn effects_are_in_the_state_that_is_kept() {
    let mut stage = ClusterFixture::new(2);
    for request in [
        Request::SetGlow(Some(Glow::new(0.5))),
        Request::SetAmbientOcclusion(Some(AmbientOcclusion { radius: 0.5 })),
    ] {
        let id = stage.request(request);
        stage.prepare_all();
        assert!(is_done(&stage, id));
    }
    let memory = stage.memories.last().expect("remembered").clone();
    let restored = Cluster::restore(wall(2), Epoch(9), &memory);
    let effects =
        LightEffects { fog: false, glow: true, ambient_occlusion: true, ..LightEffects::NONE };
    assert_eq!((restored.shown.effects, restored.presentation.effects()), (effects, effects));
    assert_eq!(restored.shown.digest(), restored.shown_digest);
}

#[test]
fn an_effect_that_no_server_can_draw_is_refused_and_frames_stay_as_they_are() {
    let mut stage = ClusterFixture::new(2);
    let id = stage.request(Request::SetGlow(Some(Glow::new(0.5))));
    for (session, prepare) in std::mem::take(&mut stage.prepares) {
        let (epoch, revision, reason) = (Epoch(7), prepare.revision, "out of memory".to_owned());
        stage.say(session, ServerMessage::PrepareFailed { epoch, revision, reason });
    }
    let reply = stage.replies.iter().find(|(of, _)| *of == id).map(|(_, reply)| reply.clone());
    let refusal = reply.expect("an answer").expect_err("refused");
    assert!(refusal.reason.contains("out of memory"), "{refusal:?}");
    assert_eq!(stage.cluster.presentation.glow, None);
    assert_eq!(stage.cluster.shown.effects, LightEffects::NONE);
}

#[test]
fn an_effect_behind_a_session_that_is_refused_takes_no_other_effect_away() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::SetFog(Some(Fog::even(90.0))));
    stage.prepare_all();
    assert_eq!(stage.cluster.shown.effects, FOG);
    // The session has no fog.
    let session = stage.request(Request::OpenSession { name: "clear".into() });
    let job = stage.imports.pop().expect("read beside the core");
    let state = PersistentState::of_wall(&stage.cluster.wall);
    let clear = ImportedSession { scene: None, state, left_out: Vec::new() };
    stage.cluster.handle_session(stage.now, job, Ok(Box::new(clear)));
    stage.read();
    let glow = stage.request(Request::SetGlow(Some(Glow::new(0.5))));
    for (session, prepare) in std::mem::take(&mut stage.prepares) {
        let (epoch, revision, reason) = (Epoch(7), prepare.revision, "out of memory".to_owned());
        stage.say(session, ServerMessage::PrepareFailed { epoch, revision, reason });
    }
    assert!(stage.replies.iter().any(|(of, reply)| *of == session && reply.is_err()));
    stage.prepare_all();
    assert!(is_done(&stage, glow), "{:?}", stage.replies);
    let both = LightEffects { glow: true, ..FOG };
    let cluster = &stage.cluster;
    assert_eq!((cluster.shown.effects, cluster.presentation.effects()), (both, both));
}
