//! Questions of a client about space in the open scene: what is in a region, what is near, what is
//! between two points.

use glam::{DVec2, DVec3};
use polyptych_protocol::node_query::{
    NearestPoint, NearestQuery, NodeInfo, NodePage, NodeQuery, RayHit, RayQuery, RegionQuery,
};
use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::walk_query::{WalkQuery, WalkedWay};
use polyptych_wall::pick_ray::{PickError, Ray};
use polyptych_wall::region::{Region, Relation};

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

/// Distance within which what a line of sight meets belongs to its end, as a share of the
/// coordinates and of the length: points that were picked lie on a surface, rounding apart.
const END_SHARE: f64 = 1e-9;

impl Client {
    /// Returns the nodes of the open scene whose triangles lie to a region as asked, a page of
    /// them. Nodes that are hidden or have no triangles are not found.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if no scene is open, the region is empty or has
    /// NaN, or the manager gives up because it takes too long.
    pub async fn find_in_region(&self, query: RegionQuery) -> Result<NodePage, ClientError> {
        match self.request(Request::FindInRegion(query)).await? {
            Response::Nodes(page) => Ok(page),
            other => Err(wrong_answer("find nodes in the region", &other)),
        }
    }

    /// Returns all nodes that match a query and whose triangles have this relation to a region, of
    /// one state of the scene, parents before their children.
    ///
    /// # Errors
    /// The errors of [`Client::find_in_region`] and [`Client::find_all_nodes`].
    pub async fn find_all_in_region(
        &self,
        region: Region,
        relation: Relation,
        query: NodeQuery,
    ) -> Result<Vec<NodeInfo>, ClientError> {
        self.find_all(query, Some((region, relation))).await
    }

    /// Returns the region that a rectangle of a screen shows, from its upper left to its lower
    /// right corner, as [`Client::pick`] counts pixels: a pyramid from the viewer's eye, or from
    /// the camera of the view that lies there.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if there is no such rectangle, if it shows more
    /// than one view, or if the screen is not a plane.
    pub async fn pick_region(
        &self,
        screen: &str,
        corners: [DVec2; 2],
    ) -> Result<Region, ClientError> {
        let (wall, presentation) = (self.wall().await?, self.presentation().await?);
        let views = presentation.all_views();
        let failed = |error: PickError| ClientError::Failed {
            request: "pick a region",
            reason: error.to_string(),
        };
        wall.pick_region(&views, &presentation.head, screen, corners).map_err(failed)
    }

    /// Returns the point of the open scene's triangles that is nearest to a point, if one is near
    /// enough.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if no scene is open, the query has NaN, or the
    /// manager gives up because it takes too long.
    pub async fn nearest_point(
        &self,
        query: NearestQuery,
    ) -> Result<Option<NearestPoint>, ClientError> {
        match self.request(Request::NearestPoint(query)).await? {
            Response::Nearest(point) => Ok(point),
            other => Err(wrong_answer("find the nearest point", &other)),
        }
    }

    /// Returns how far one comes on a way through the open scene: over its ground, at the height of
    /// the eye, and up to what stands in the way. [`Tour::along`](crate::Tour::along) makes a tour
    /// of it.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if no scene is open, the way or the walker cannot
    /// be, or the manager gives up because it takes too long.
    pub async fn find_way(&self, query: WalkQuery) -> Result<WalkedWay, ClientError> {
        match self.request(Request::FindWay(query)).await? {
            Response::Way(way) => Ok(*way),
            other => Err(wrong_answer("find a way", &other)),
        }
    }

    /// Returns what stands between two points of the world: what is met first from the one on.
    /// Surfaces in the points themselves are not between them. [`RayHit::distance`] is from the
    /// first point.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if no scene is open, or a point has NaN.
    pub async fn first_between(
        &self,
        from: DVec3,
        to: DVec3,
    ) -> Result<Option<RayHit>, ClientError> {
        let length = from.distance(to);
        let reach = from.abs().max(to.abs()).max_element().max(length);
        let (margin, direction) = (END_SHARE * reach, (to - from) / length);
        if length <= 2.0 * margin {
            return Ok(None);
        }
        let ray = Ray { origin: from + direction * margin, direction };
        let max_distance = Some(length - 2.0 * margin);
        let hit = self.cast_ray(RayQuery { max_distance, ..RayQuery::new(ray) }).await?;
        Ok(hit.map(|hit| RayHit { distance: hit.position.distance(from), ..hit }))
    }

    /// Returns whether nothing of the open scene stands between two points of the world, as
    /// [`Client::first_between`] says.
    ///
    /// # Errors
    /// The errors of [`Client::first_between`].
    pub async fn is_in_sight(&self, from: DVec3, to: DVec3) -> Result<bool, ClientError> {
        Ok(self.first_between(from, to).await?.is_none())
    }

    /// Returns what a point of the world stands over, if anything: what is met first in the
    /// direction of −Y. [`RayHit::distance`] is the height over it, 0 on the ground itself.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] if no scene is open, or the point has NaN.
    pub async fn ground_below(&self, point: DVec3) -> Result<Option<RayHit>, ClientError> {
        // From a little higher, so that ground that the point lies in is met.
        let origin = point + DVec3::Y * (END_SHARE * point.abs().max_element());
        let ray = Ray { origin, direction: DVec3::NEG_Y };
        let hit = self.cast_ray(RayQuery::new(ray)).await?;
        Ok(hit.map(|hit| RayHit { distance: (point.y - hit.position.y).max(0.0), ..hit }))
    }
}
