//! Questions about space in the open scene, which wait.

use glam::{DVec2, DVec3};
use polyptych_protocol::node_query::{
    LayerInfo, NearestPoint, NearestQuery, NodeInfo, NodePage, NodeQuery, RayHit, RegionQuery,
};
use polyptych_protocol::walk_query::{WalkQuery, WalkedWay};
use polyptych_wall::region::{Region, Relation};

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::layers`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn layers(&self) -> Result<Vec<LayerInfo>, ClientError> {
        wait(self.inner.layers())
    }

    /// Blocking version of [`crate::Client::find_in_region`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn find_in_region(&self, query: RegionQuery) -> Result<NodePage, ClientError> {
        wait(self.inner.find_in_region(query))
    }

    /// Blocking version of [`crate::Client::find_all_in_region`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn find_all_in_region(
        &self,
        region: Region,
        relation: Relation,
        query: NodeQuery,
    ) -> Result<Vec<NodeInfo>, ClientError> {
        wait(self.inner.find_all_in_region(region, relation, query))
    }

    /// Blocking version of [`crate::Client::pick_region`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn pick_region(&self, screen: &str, corners: [DVec2; 2]) -> Result<Region, ClientError> {
        wait(self.inner.pick_region(screen, corners))
    }

    /// Blocking version of [`crate::Client::nearest_point`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn nearest_point(&self, query: NearestQuery) -> Result<Option<NearestPoint>, ClientError> {
        wait(self.inner.nearest_point(query))
    }

    /// Blocking version of [`crate::Client::find_way`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn find_way(&self, query: WalkQuery) -> Result<WalkedWay, ClientError> {
        wait(self.inner.find_way(query))
    }

    /// Blocking version of [`crate::Client::first_between`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn first_between(&self, from: DVec3, to: DVec3) -> Result<Option<RayHit>, ClientError> {
        wait(self.inner.first_between(from, to))
    }

    /// Blocking version of [`crate::Client::is_in_sight`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn is_in_sight(&self, from: DVec3, to: DVec3) -> Result<bool, ClientError> {
        wait(self.inner.is_in_sight(from, to))
    }

    /// Blocking version of [`crate::Client::ground_below`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn ground_below(&self, point: DVec3) -> Result<Option<RayHit>, ClientError> {
        wait(self.inner.ground_below(point))
    }
}
