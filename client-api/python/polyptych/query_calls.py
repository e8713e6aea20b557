"""Questions of a client about the open scene."""

from __future__ import annotations

import dataclasses
from typing import List, Optional, Sequence, Tuple

from . import vectors
from .errors import Failed
from .feedback import Presentation, WallStatus
from .records import Vec3
from .requests import Requests
from .scene import (
    NODES_MAX,
    Convex,
    NearestPoint,
    NodeInfo,
    NodePage,
    NodeQuery,
    RayHit,
    RayQuery,
    Region,
    Relation,
    SceneSubset,
    WalkedWay,
    Walker,
)
from .wall import PickError, Ray, Wall

# As in the Rust client: the distance within which what a line of sight meets belongs to its end.
_END_SHARE = 1e-9
_READ_TRIES = 8


class QueryCalls(Requests):
    """Calls that ask, and change nothing."""

    def status(self) -> WallStatus:
        """Returns the wall's state: channels, servers, warnings."""
        return self._ask("Status", "Status", WallStatus)

    def wall(self) -> Wall:
        """Returns the wall's description: screens, channels, eye."""
        return self._ask("DescribeWall", "Wall", Wall)

    def presentation(self) -> Presentation:
        """Returns what the next frame presents: camera, head, views, exposure, and more."""
        return self.status().presentation

    def find_nodes(self, query: NodeQuery = NodeQuery()) -> NodePage:
        """Returns the nodes of the open scene that a query asks for, a page of them.

        :raises Failed: no scene is open.
        """
        return self._ask({"FindNodes": query}, "Nodes", NodePage)

    def find_all_nodes(self, query: NodeQuery = NodeQuery()) -> List[NodeInfo]:
        """Returns all nodes that a query asks for, of one state of the scene, parents first.

        :raises Failed: no scene is open, or it changes faster than it can be read.
        """
        return self._find_all(query, None)

    def find_in_region(
        self, region: Region, relation: Relation, query: NodeQuery = NodeQuery()
    ) -> NodePage:
        """Returns the nodes whose triangles lie to a region as asked, a page of them."""
        asked = {"region": region, "relation": relation, "nodes": query}
        return self._ask({"FindInRegion": asked}, "Nodes", NodePage)

    def find_all_in_region(
        self, region: Region, relation: Relation, query: NodeQuery = NodeQuery()
    ) -> List[NodeInfo]:
        """Returns all nodes whose triangles lie to a region as asked, of one state of the scene."""
        return self._find_all(query, (region, relation))

    def cast_ray(self, query: RayQuery) -> Optional[RayHit]:
        """Returns what a ray meets first in the open scene, if anything."""
        return self._ask({"CastRay": query}, "Ray", Optional[RayHit])  # type: ignore[arg-type]

    def pick(self, screen: str, pixel: Sequence[float]) -> Optional[RayHit]:
        """Returns what a pixel of a screen shows of the open scene, if anything.

        Pixels count from the upper left of the screen; the middle of the first is (0.5, 0.5).

        :raises Failed: no scene is open, or there is no such pixel.
        """
        wall, presentation = self.wall(), self.presentation()
        views, head = presentation.all_views(), presentation.head
        try:
            ray = wall.pick_ray(views, head, screen, pixel)
            view = wall.view_at(views, screen, pixel) or views[0]
        except PickError as error:
            raise Failed("pick", str(error)) from None
        return self.cast_ray(RayQuery(ray, subset=SceneSubset(view.root, view.layers)))

    def pick_region(self, screen: str, corners: Sequence[Sequence[float]]) -> Convex:
        """Returns the region that a rectangle of a screen shows: a pyramid from the viewer's eye.

        :param corners: the upper left and the lower right corner, in pixels as for :meth:`pick`.
        :raises Failed: there is no such rectangle, or the screen is not a plane.
        """
        wall, presentation = self.wall(), self.presentation()
        views, head = presentation.all_views(), presentation.head
        try:
            return Convex(wall.pick_region(views, head, screen, corners))
        except PickError as error:
            raise Failed("pick a region", str(error)) from None

    def nearest_point(
        self, point: Sequence[float], within: Optional[float] = None
    ) -> Optional[NearestPoint]:
        """Returns the point of the scene's triangles that is nearest to a point of the world.

        :param within: the maximum distance, in world units.
        """
        asked = {"point": vectors.vec3(point), "within": within}
        kind = Optional[NearestPoint]
        return self._ask({"NearestPoint": asked}, "Nearest", kind)  # type: ignore[arg-type]

    def first_between(self, start: Sequence[float], end: Sequence[float]) -> Optional[RayHit]:
        """Returns what stands between two points of the world, seen from the first one."""
        a, b = vectors.vec3(start), vectors.vec3(end)
        way = vectors.subtract(b, a)
        length = vectors.length(way)
        margin = _END_SHARE * max(*(abs(number) for number in (*a, *b)), length)
        if length <= 2.0 * margin:
            return None
        direction = vectors.scaled(way, 1.0 / length)
        origin = vectors.add(a, vectors.scaled(direction, margin))
        hit = self.cast_ray(RayQuery(Ray(origin, direction), length - 2.0 * margin))
        return _measured(hit, a)

    def is_in_sight(self, start: Sequence[float], end: Sequence[float]) -> bool:
        """Returns whether nothing of the open scene stands between two points of the world."""
        return self.first_between(start, end) is None

    def ground_below(self, point: Sequence[float]) -> Optional[RayHit]:
        """Returns what a point of the world stands over, in the direction of -Y, if anything."""
        x, y, z = vectors.vec3(point)
        origin = (x, y + _END_SHARE * max(abs(x), abs(y), abs(z)), z)
        hit = self.cast_ray(RayQuery(Ray(origin, (0.0, -1.0, 0.0))))
        if hit is None:
            return None
        return dataclasses.replace(hit, distance=max(y - hit.position[1], 0.0))

    def find_way(self, way: Sequence[Sequence[float]], walker: Walker) -> WalkedWay:
        """Returns how far one comes on a way through the open scene; see :class:`Walker`.

        :param way: 2 to 4096 points of the eye's way, in world space.
        """
        asked = {"way": [vectors.vec3(point) for point in way], "walker": walker}
        return self._ask({"FindWay": asked}, "Way", WalkedWay)

    def _find_all(
        self, query: NodeQuery, within: Optional[Tuple[Region, Relation]]
    ) -> List[NodeInfo]:
        for _ in range(_READ_TRIES):
            nodes = self._read_all(query, within)
            if nodes is not None:
                return nodes
        reason = "the scene changes faster than it can be read; ask for less of it"
        raise Failed("find nodes", reason)

    def _read_all(
        self, query: NodeQuery, within: Optional[Tuple[Region, Relation]]
    ) -> Optional[List[NodeInfo]]:
        """All pages together; ``None`` where the scene was edited between two of them."""
        nodes: List[NodeInfo] = []
        revision: Optional[int] = None
        while True:
            asked = dataclasses.replace(query, skip=query.skip + len(nodes), count=NODES_MAX)
            if within is None:
                page = self.find_nodes(asked)
            else:
                page = self.find_in_region(within[0], within[1], asked)
            if revision is not None and revision != page.revision:
                return None
            revision = page.revision
            nodes.extend(page.nodes)
            if not page.nodes or query.skip + len(nodes) >= page.found:
                return nodes


def _measured(hit: Optional[RayHit], start: Vec3) -> Optional[RayHit]:
    if hit is None:
        return None
    distance = vectors.length(vectors.subtract(hit.position, start))
    return dataclasses.replace(hit, distance=distance)
