//! The core written down between two inputs, so that a recording can begin in the middle.

use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::FrameId;
use polyptych_wall::Wall;
use serde::{Deserialize, Serialize, Serializer};

use super::{Cluster, SkewTracker, StatisticsCollector};

/// A core that was written down. It decides as the one that it was taken from; only what that one
/// had measured is gone.
#[derive(Debug, Deserialize)]
pub struct Checkpoint(Box<Cluster>);

/// The same, of a core that goes on.
#[derive(Debug)]
pub struct CheckpointOf<'a>(&'a Cluster);

impl Serialize for CheckpointOf<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_newtype_struct("Checkpoint", self.0)
    }
}

impl Serialize for Checkpoint {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        CheckpointOf(&self.0).serialize(serializer)
    }
}

impl Checkpoint {
    /// The core.
    pub fn into_cluster(self) -> Cluster {
        let mut cluster = *self.0;
        let channels = cluster.wall.channels.len();
        cluster.gathered = StatisticsCollector::new(channels);
        cluster.present_calls = SkewTracker::new(channels);
        cluster
    }
}

impl Cluster {
    /// This core, to be written down. All outputs were taken before.
    pub fn checkpoint(&self) -> CheckpointOf<'_> {
        CheckpointOf(self)
    }

    /// The wall that it drives.
    pub fn wall(&self) -> &Wall {
        &self.wall
    }

    /// The last frame that was begun.
    pub fn frame_begun(&self) -> FrameId {
        self.frame
    }

    /// Name, state, the state's reason and missed deadlines of every channel, in the wall's order.
    pub fn channel_states(&self) -> impl Iterator<Item = (&str, ChannelState, Option<&str>, u64)> {
        let channels = self.registry.channels();
        channels.map(|(_, c)| (c.name.as_str(), c.state, c.reason.as_deref(), c.late))
    }
}
