//! A client's requests about the open scene: show it, change it, and query it.

use glam::DVec2;
use polyptych_protocol::feedback::Edited;
use polyptych_protocol::node_query::{
    LayerInfo, NODES_MAX, NodeInfo, NodePage, NodeQuery, RayHit, RayQuery, RegionQuery,
};
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{Request, Response, SceneSummary};
use polyptych_protocol::transaction::Transaction;
use polyptych_scene::{NodeId, SceneSubset};
use polyptych_wall::pick_ray::PickError;
use polyptych_wall::region::{Region, Relation};
use polyptych_wall::view::View;
use tokio::sync::watch;

use crate::client::Client;
use crate::connection_handle::Wanted;
use crate::error::{ClientError, wrong_answer};
use crate::scene_file::SceneFile;

/// Maximum number of attempts to read all nodes of a scene that is edited meanwhile.
const READ_TRIES: u32 = 8;

impl Client {
    /// Shows a scene; returns once every live channel can draw it. The wall's exposure becomes
    /// the one that suits the scene ([`SceneSummary::exposure`]).
    ///
    /// `file` is a path, absolute or relative to one of the manager's scene folders, in one of
    /// which it leads to a file on the manager's machine; [`SceneFile::scene`] chooses a scene of a
    /// file that has several.
    ///
    /// # Errors
    /// [`ClientError`]; where the scene can't be opened, the wall shows what it showed before.
    pub async fn open_scene(
        &self,
        file: impl Into<SceneFile>,
    ) -> Result<SceneSummary, ClientError> {
        self.open_scene_with(file, |_| {}).await
    }

    /// Opens a scene like [`Client::open_scene`], and calls `on_progress` with the manager's
    /// reports of progress: a few times a second at most, and only while this future is polled. Of
    /// the reports since the last call only the newest is passed on.
    ///
    /// The request may take [`crate::Timeouts::open_scene`] from each message about its progress
    /// on, so a large file may take longer than that.
    ///
    /// # Errors
    /// The errors of [`Client::open_scene`].
    pub async fn open_scene_with(
        &self,
        file: impl Into<SceneFile>,
        mut on_progress: impl FnMut(OpenProgress),
    ) -> Result<SceneSummary, ClientError> {
        let (sender, mut progress) = watch::channel(OpenProgress::NONE);
        let wanted = Wanted { progress: Some(sender), ..Wanted::default() };
        let SceneFile { path, scene } = file.into();
        let request = Request::OpenScene { path, scene };
        let mut pending = self.link.post(request, wanted)?;
        let reply = loop {
            tokio::select! {
                biased;
                reply = &mut pending => break reply?,
                Ok(()) = progress.changed() => on_progress(*progress.borrow_and_update()),
            }
        };
        match reply {
            Response::SceneOpened(summary) => Ok(summary),
            other => Err(wrong_answer("open the scene", &other)),
        }
    }

    /// Shows no scene.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn close_scene(&self) -> Result<(), ClientError> {
        self.done("close the scene", Request::CloseScene).await
    }

    /// Changes the open scene by all of these edits, on all displays from one frame on, or by none.
    /// Returns once that frame was swapped, which a paused wall draws for it. Transactions that
    /// come faster than frames are shown together. The manager remembers what was changed.
    ///
    /// Those of one client that bring assets are applied in the order in which they were sent. One
    /// without waits for those only that change a node, material, layer or variant that it changes
    /// too.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the edit that cannot be, or the node that was
    /// changed since [`Transaction::base`], by whomever, or says that another scene was opened
    /// while assets were read. The next base of a program that goes on changing a node is the
    /// [`Edited::revision`] of its own last transaction.
    pub async fn commit(&self, transaction: Transaction) -> Result<Edited, ClientError> {
        match self.request(Request::Edit(transaction)).await? {
            Response::Edited(edited) => Ok(edited),
            other => Err(wrong_answer("edit the scene", &other)),
        }
    }

    /// Returns the nodes of the open scene that a query asks for, a page of them.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where no scene is open.
    pub async fn find_nodes(&self, query: NodeQuery) -> Result<NodePage, ClientError> {
        match self.request(Request::FindNodes(query)).await? {
            Response::Nodes(page) => Ok(page),
            other => Err(wrong_answer("find nodes", &other)),
        }
    }

    /// Returns all nodes of the open scene that a query asks for, of one state of it, parents
    /// before their children.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where no scene is open, or it changes faster than
    /// it can be read.
    pub async fn find_all_nodes(&self, query: NodeQuery) -> Result<Vec<NodeInfo>, ClientError> {
        self.find_all(query, None).await
    }

    /// Returns all pages of a query together; in a region, where one is given.
    pub(crate) async fn find_all(
        &self,
        query: NodeQuery,
        within: Option<(Region, Relation)>,
    ) -> Result<Vec<NodeInfo>, ClientError> {
        let (mut nodes, mut revision, mut tries) = (Vec::new(), None, 0);
        loop {
            let skip = query.skip + nodes.len() as u64;
            let asked = NodeQuery { skip, count: NODES_MAX, ..query.clone() };
            let page = match within.clone() {
                None => self.find_nodes(asked).await?,
                Some((region, relation)) => {
                    self.find_in_region(RegionQuery { region, relation, nodes: asked }).await?
                }
            };
            if revision.replace(page.revision).is_some_and(|before| before != page.revision) {
                // The scene was edited between two pages: what was read is of no use.
                (nodes, revision) = (Vec::new(), None);
                tries += 1;
                if tries < READ_TRIES {
                    continue;
                }
                let reason = "the scene changes faster than it can be read; ask for less of it";
                return Err(ClientError::Failed { request: "find nodes", reason: reason.into() });
            }
            let is_end = page.nodes.is_empty();
            nodes.extend(page.nodes);
            if is_end || query.skip + nodes.len() as u64 >= page.found {
                return Ok(nodes);
            }
        }
    }

    /// Returns the layers of the open scene, by name.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where no scene is open.
    pub async fn layers(&self) -> Result<Vec<LayerInfo>, ClientError> {
        match self.request(Request::ListLayers).await? {
            Response::Layers(layers) => Ok(layers),
            other => Err(wrong_answer("list the layers", &other)),
        }
    }

    /// Returns what a ray meets first in the open scene, if anything.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where no scene is open, or the ray is none.
    pub async fn cast_ray(&self, query: RayQuery) -> Result<Option<RayHit>, ClientError> {
        match self.request(Request::CastRay(query)).await? {
            Response::Ray(hit) => Ok(hit),
            other => Err(wrong_answer("cast a ray", &other)),
        }
    }

    /// Returns what a pixel of a screen shows of the open scene, if anything: of the wall's own
    /// picture, or of the view that lies there. Pixels count from the upper left of the screen; the
    /// middle of the first is (0.5, 0.5).
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where no scene is open, or there is no such pixel.
    pub async fn pick(&self, screen: &str, pixel: DVec2) -> Result<Option<RayHit>, ClientError> {
        let (wall, presentation) = (self.wall().await?, self.presentation().await?);
        let views = presentation.all_views();
        let ray = wall.pick_ray(&views, &presentation.head, screen, pixel);
        let failed =
            |error: PickError| ClientError::Failed { request: "pick", reason: error.to_string() };
        let view = wall.view_at(&views, screen, pixel).cloned();
        let subset = view.map_or_else(SceneSubset::default, |View { root, layers, .. }| {
            SceneSubset { root: root.map(NodeId), layers }
        });
        self.cast_ray(RayQuery { subset, ..RayQuery::new(ray.map_err(failed)?) }).await
    }
}
