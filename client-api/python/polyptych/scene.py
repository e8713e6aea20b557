"""The open scene: its summary, its nodes, its animations, and what questions about it find."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Dict, List, Optional, Tuple, Union

from . import vectors
from .feedback import FrameFeedback
from .records import Mismatch, Vec3, decode, decode_fields
from .wall import Ray

#: The maximum number of nodes of one answer.
NODES_MAX = 1000

Attribute = Union[bool, float, str]


@dataclass(frozen=True)
class Bounds:
    """A box along the axes of the world."""

    min: Vec3
    max: Vec3

    def center(self) -> Vec3:
        """Returns the middle of the box."""
        return vectors.scaled(vectors.add(self.min, self.max), 0.5)

    def radius(self) -> float:
        """Returns half of its diagonal."""
        return vectors.length(vectors.subtract(self.max, self.min)) * 0.5


@dataclass(frozen=True)
class ClipSummary:
    """An animation of a scene."""

    name: str
    #: The time of its last key, in seconds.
    duration_s: float
    #: ``True`` where it is played unless something else is asked for.
    is_played: bool


@dataclass(frozen=True)
class ClipStatus:
    """The state of an animation."""

    clip: ClipSummary
    is_running: bool
    is_looping: bool
    #: Its time in the last frame, in seconds since its beginning.
    time_s: float
    #: Seconds of it in a second of scene time; negative for backwards.
    speed: float
    #: Its part beside other animations; 0 for one that moves nothing.
    weight: float


@dataclass(frozen=True)
class VariantList:
    """The variants of a scene."""

    names: List[str]
    #: The index of the one that is chosen; ``None`` for the materials of the file.
    chosen: Optional[int]


@dataclass(frozen=True)
class SceneSummary:
    """A scene as a client needs to know it."""

    name: str
    #: The revision that shows it.
    revision: int
    #: Around everything drawn; ``None`` for an empty scene.
    bounds: Optional[Bounds]
    #: Each instance counted.
    triangles: int
    #: What it needs of the renderer.
    features: Dict[str, Any]
    #: The exposure that the wall has from now on.
    exposure: float
    #: What of the file is not drawn, or not as it is there.
    notes: List[str] = field(default_factory=list)
    clips: List[ClipSummary] = field(default_factory=list)


@dataclass(frozen=True)
class SceneFileInfo:
    """A scene file of the manager."""

    #: The path by which it is opened.
    path: str
    bytes: int
    #: Seconds since 1970, UTC; 0 if it is not known.
    changed_at_s: int


@dataclass(frozen=True)
class SceneFileList:
    """The scene files in the manager's scene folders."""

    files: List[SceneFileInfo]
    #: ``True`` if there are more than could be listed.
    is_cut: bool


@dataclass(frozen=True)
class SavedScene:
    """An entry in the list of saved scenes; ``saved:NAME`` opens it."""

    name: str
    scene: str
    #: Nodes that are not as its file has them.
    edited_nodes: int
    #: Seconds since 1970, UTC.
    saved_at_s: int


@dataclass(frozen=True)
class LayerInfo:
    """A layer of the open scene."""

    name: str
    nodes: int
    visible: bool


class NodeKind(Enum):
    """A kind of node, by what it shows."""

    MESH = "Mesh"
    LINES = "Lines"
    POINTS = "Points"
    LIGHT = "Light"
    EMPTY = "Empty"
    LABEL = "Label"


def attribute_to_json(value: Optional[Attribute]) -> Any:
    """Returns an attribute as the wire has it."""
    if value is None:
        return None
    if isinstance(value, bool):
        return {"Bool": value}
    return {"Text": value} if isinstance(value, str) else {"Number": float(value)}


def attribute_from_json(value: Any, where: str) -> Attribute:
    """Returns an attribute of the wire as a plain value.

    :raises Mismatch: it is none.
    """
    members = decode(Dict[str, Any], value, where)
    for kind, inner in members.items():
        if kind in ("Bool", "Number", "Text") and isinstance(inner, (bool, int, float, str)):
            return inner
    raise Mismatch(f"{where} is {value!r}, no attribute")


@dataclass(frozen=True)
class NodeQuery:
    """Which nodes are asked for. All that is given must hold."""

    #: Of exactly this name.
    name: Optional[str] = None
    #: This one, and what hangs from it at any depth.
    below: Optional[int] = None
    #: A key, or a key and its value.
    attribute: Union[str, Tuple[str, Attribute], None] = None
    layer: Optional[str] = None
    kind: Optional[NodeKind] = None
    #: How many of those found are left out, from the first.
    skip: int = 0
    #: How many are given at most; never more than 1000.
    count: int = NODES_MAX

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        attribute: Any = None
        if isinstance(self.attribute, str):
            attribute = [self.attribute, None]
        elif self.attribute is not None:
            attribute = [self.attribute[0], attribute_to_json(self.attribute[1])]
        return {
            "name": self.name,
            "below": self.below,
            "attribute": attribute,
            "layer": self.layer,
            "kind": self.kind,
            "skip": self.skip,
            "count": self.count,
        }


@dataclass(frozen=True)
class NodeInfo:
    """A node as it stands."""

    id: int
    #: ``None`` for one that hangs from the scene itself.
    parent: Optional[int]
    name: str
    depth: int
    #: Parent space from this node's space: the columns of 3 x 3, then the translation.
    local: List[float]
    #: World space from this node's space, in the same order.
    world: List[float]
    visible: bool
    mesh: Optional[int]
    light: Any
    #: By key: each is a bool, a float or a string.
    attributes: Dict[str, Any]
    #: Around its mesh in all its places, in world space.
    bounds: Optional[Bounds]
    own_layer: Optional[str] = None
    layer: Optional[str] = None
    switch: Optional[int] = None
    style: Any = None
    facing: Optional[str] = None

    @classmethod
    def from_json(cls, value: Any, where: str) -> NodeInfo:
        """Returns the node of the wire."""
        members = decode(Dict[str, Any], value, where)
        given = decode(Dict[str, Any], members.get("attributes", {}), f"{where}.attributes")
        attributes = {
            key: attribute_from_json(of, f"{where}.attributes.{key}") for key, of in given.items()
        }
        node: NodeInfo = decode_fields(cls, {**members, "attributes": attributes}, where)
        return node

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        attributes = {key: attribute_to_json(value) for key, value in self.attributes.items()}
        return {**vars(self), "attributes": attributes}


@dataclass(frozen=True)
class NodePage:
    """Nodes that were found, parents before their children."""

    revision: int
    #: How many there are in all.
    found: int
    nodes: List[NodeInfo]


@dataclass(frozen=True)
class SceneSubset:
    """A part of the scene."""

    #: Only what hangs from this node, the node itself among it; ``None`` for all.
    root: Optional[int] = None
    #: The layers that are shown; ``None`` for those that the scene shows.
    layers: Optional[List[str]] = None


@dataclass(frozen=True)
class RayQuery:
    """A question for what a ray meets."""

    ray: Ray
    #: In world units; ``None`` for a ray without an end.
    max_distance: Optional[float] = None
    subset: SceneSubset = SceneSubset()


@dataclass(frozen=True)
class RayHit:
    """The first triangle that a ray meets, from either side."""

    revision: int
    node: int
    name: str
    #: In world space.
    position: Vec3
    #: Out of the front of the triangle, of length 1.
    normal: Vec3
    #: From the ray's origin, in world units.
    distance: float
    is_front: bool
    material: Optional[int] = None


class Relation(Enum):
    """The relation of a node's triangles to a region."""

    INSIDE = "Inside"
    TOUCHES = "Touches"
    CONTAINS = "Contains"
    DISJOINT = "Disjoint"


@dataclass(frozen=True)
class Box:
    """A region: a box along the axes."""

    min: Vec3
    max: Vec3

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        return {"Box": {"min": self.min, "max": self.max}}


@dataclass(frozen=True)
class Ball:
    """A region: a ball. A radius of 0 is a point."""

    center: Vec3
    radius: float

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        return {"Sphere": {"center": self.center, "radius": self.radius}}


@dataclass(frozen=True)
class Prism:
    """A region: a vertical prism over a polygon of x and z."""

    polygon: List[Tuple[float, float]]
    low: float
    high: float

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        return {"Prism": {"polygon": self.polygon, "low": self.low, "high": self.high}}


@dataclass(frozen=True)
class Convex:
    """A region: the common part of half spaces, each the normal that points out and its offset."""

    half_spaces: List[Tuple[Vec3, float]]

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        halves = [{"normal": normal, "offset": offset} for normal, offset in self.half_spaces]
        return {"Convex": halves}


Region = Union[Box, Ball, Prism, Convex]


@dataclass(frozen=True)
class NearestPoint:
    """The point of the scene's triangles that is nearest to another point."""

    revision: int
    node: int
    name: str
    position: Vec3
    distance: float


@dataclass(frozen=True)
class Walker:
    """One who walks or flies; all in world units."""

    #: Above the ground; ``None`` flies.
    eye_height: Optional[float] = None
    #: The distance that is kept from everything; ``None`` passes through.
    radius: Optional[float] = None
    step_height: float = 0.0


@dataclass(frozen=True)
class WalkedWay:
    """The way that is possible."""

    revision: int
    points: List[Vec3]
    #: ``"Arrived"``, ``"NoGround"``, or what is in the way.
    end: Any

    def length(self) -> float:
        """Returns the length of the way, in world units."""
        pairs = zip(self.points, self.points[1:])
        return sum(vectors.length(vectors.subtract(b, a)) for a, b in pairs)


@dataclass(frozen=True)
class AssetNumbers:
    """The numbers that assets got: the first of each kind; the others follow."""

    first_mesh: int
    first_material: int
    first_texture: int


@dataclass(frozen=True)
class Edited:
    """What a transaction has become."""

    revision: int
    #: The nodes that it made, in the order of their creations.
    created: List[int]
    assets: Optional[AssetNumbers]
    #: Frames that were begun from the request to the first one with it.
    frames: int
    feedback: FrameFeedback
    notes: List[str] = field(default_factory=list)

    def node(self, node: int) -> Optional[int]:
        """Returns the node that a provisional number stands for, or the node itself."""
        if node < 1 << 63:
            return node
        index = node - (1 << 63)
        return self.created[index] if index < len(self.created) else None

    def mesh(self, mesh: int) -> Optional[int]:
        """Returns the mesh that a provisional number stands for, or the mesh itself."""
        if mesh < 1 << 31:
            return mesh
        return None if self.assets is None else self.assets.first_mesh + mesh - (1 << 31)
