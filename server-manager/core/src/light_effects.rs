//! Fog, glow, ambient occlusion and depth of field: servers make their pipelines before the first
//! frame that has them.

use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::state_log::Operation;
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, LightEffects};
use serde::{Deserialize, Serialize};

use super::change_queue::{ChangeOrigin, ChangeQueue};
use super::{ClientRequest, Cluster, Micros, SessionId, StateChange};

/// The setting of an effect that a client asks for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum EffectSetting {
    Fog(Option<Fog>),
    Glow(Option<Glow>),
    AmbientOcclusion(Option<AmbientOcclusion>),
    DepthOfField(Option<DepthOfField>),
}

impl EffectSetting {
    /// Returns the setting of a request; `None` for one that sets no effect.
    fn of(request: &Request) -> Option<Self> {
        match *request {
            Request::SetFog(fog) => Some(Self::Fog(fog)),
            Request::SetGlow(glow) => Some(Self::Glow(glow)),
            Request::SetAmbientOcclusion(of) => Some(Self::AmbientOcclusion(of)),
            Request::SetDepthOfField(of) => Some(Self::DepthOfField(of)),
            _ => None,
        }
    }

    fn fault(self) -> Option<String> {
        match self {
            Self::Fog(fog) => fog.and_then(|fog| fog.fault()),
            Self::Glow(glow) => glow.and_then(|glow| glow.fault()),
            Self::AmbientOcclusion(of) => of.and_then(|of| of.fault()),
            Self::DepthOfField(of) => of.and_then(|of| of.fault()),
        }
    }

    fn set(self, presentation: &mut Presentation) {
        match self {
            Self::Fog(fog) => presentation.fog = fog,
            Self::Glow(glow) => presentation.glow = glow,
            Self::AmbientOcclusion(of) => presentation.ambient_occlusion = of,
            Self::DepthOfField(of) => presentation.depth_of_field = of,
        }
    }

    /// Returns the effects that frames have once it is set.
    fn after(self, before: LightEffects) -> LightEffects {
        match self {
            Self::Fog(fog) => LightEffects { fog: fog.is_some(), ..before },
            Self::Glow(glow) => LightEffects { glow: glow.is_some(), ..before },
            Self::AmbientOcclusion(of) => {
                LightEffects { ambient_occlusion: of.is_some(), ..before }
            }
            Self::DepthOfField(of) => LightEffects { depth_of_field: of.is_some(), ..before },
        }
    }

    /// Returns the operations that set it, once it is its turn: `shown` are the effects of frames
    /// then, as a change before it may have been refused.
    pub fn operations(self, shown: LightEffects) -> Vec<Operation> {
        vec![Operation::SetEffects(self.after(shown))]
    }
}

impl ChangeQueue {
    /// Returns whether a change of effects is on its way, or waits.
    fn changes_effects(&self) -> bool {
        let mut changes = self.current().into_iter().chain(self.queued());
        changes.any(|change| {
            let is_of_effects = |of: &Operation| matches!(of, Operation::SetEffects(_));
            matches!(change.purpose, ChangeOrigin::LightEffect { .. })
                || change.operations.iter().any(is_of_effects)
        })
    }
}

impl Cluster {
    /// Sets an effect. Where servers have what it needs, the next frame has it; else it is answered
    /// once it is shown.
    ///
    /// # Errors
    /// Numbers that no effect has.
    pub(super) fn set_effect(
        &mut self,
        now: Micros,
        job: ClientRequest,
        request: &Request,
    ) -> Result<Option<Response>, String> {
        let setting = EffectSetting::of(request).ok_or("this sets no effect of light")?;
        if let Some(fault) = setting.fault() {
            return Err(fault);
        }
        let shown = self.shown.effects;
        if !self.changes.changes_effects() && setting.after(shown) == shown {
            setting.set(&mut self.presentation);
            return Ok(Some(Response::Done));
        }
        let purpose = ChangeOrigin::LightEffect { job, setting };
        self.request_change(now, StateChange { operations: Vec::new(), purpose });
        Ok(None)
    }

    /// Frames name the state whose servers have what an effect needs.
    pub(super) fn commit_effect(
        &mut self,
        now: Micros,
        (job, setting): (ClientRequest, EffectSetting),
        failed: &[(SessionId, String)],
    ) {
        // Before a frame begins, which has both.
        setting.set(&mut self.presentation);
        self.demote_unprepared(now, failed);
        // A wall that is paused shows it too.
        self.wants_frame |= !self.pacer.is_soon(now);
        self.persist();
        self.reply(job, Ok(Response::Done));
    }
}
