//! The core as the manager holds it: told through one function only, so that all it is told can
//! be recorded.

use std::collections::VecDeque;
use std::ops::Deref;

use polyptych_core::{Cluster, Effect, Input, Micros};

use crate::recorder::effect_digest::EffectDigest;
use crate::recorder::{ClusterConfig, Recorder};

/// A [`Cluster`] that can be asked anything, and told things by [`RecordedCluster::handle`] only.
#[derive(Debug)]
pub(crate) struct RecordedCluster {
    cluster: Cluster,
    outputs: VecDeque<Effect>,
    recorder: Option<Recorder>,
}

impl Deref for RecordedCluster {
    type Target = Cluster;

    fn deref(&self) -> &Cluster {
        &self.cluster
    }
}

impl RecordedCluster {
    /// A new core, recorded where there is a recorder.
    pub fn new(fresh: ClusterConfig, mut recorder: Option<Recorder>) -> Self {
        let cluster = fresh.to_cluster();
        if let Some(recorder) = &mut recorder {
            recorder.begin(fresh);
        }
        Self { cluster, outputs: VecDeque::new(), recorder }
    }

    /// Tells the core something.
    ///
    /// # Errors
    /// Why a server may not have its channels.
    pub fn handle(&mut self, now: Micros, input: Input) -> Result<(), String> {
        let Some(recorder) = &mut self.recorder else {
            let done = self.cluster.handle(now, input);
            self.outputs.extend(std::iter::from_fn(|| self.cluster.poll_effect()));
            return done;
        };
        recorder.input(&self.cluster, now, &input);
        let done = self.cluster.handle(now, input);
        let before = self.outputs.len();
        self.outputs.extend(std::iter::from_fn(|| self.cluster.poll_effect()));
        let refusal = done.as_ref().err().map(String::as_str);
        if let Some(decision) = EffectDigest::from_effects(self.outputs.range(before..), refusal) {
            recorder.decided(decision);
        }
        done
    }

    /// Returns a warning for an operator if the recording has failed.
    pub fn warning(&self) -> Option<String> {
        self.recorder.as_ref().and_then(Recorder::warning)
    }

    /// Returns the next effect that is to be carried out.
    pub fn poll_effect(&mut self) -> Option<Effect> {
        self.outputs.pop_front()
    }
}
