"""The camera, the viewer's head, views over the wall's picture, and tours."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Dict, List, Optional, Sequence, Tuple

from . import vectors
from .records import Quat, Vec3, decode


@dataclass(frozen=True)
class Camera:
    """The pose of display space in the world: ``world = position + rotation * (scale * display)``.

    It looks along its -Z with +Y up, as a glTF camera does.
    """

    #: The origin of display space, in world units.
    position: Vec3 = (0.0, 0.0, 0.0)
    #: A unit quaternion: x, y, z, w.
    rotation: Quat = vectors.NO_ROTATION
    #: World units per metre of display space; above 0.
    scale: float = 1.0

    @classmethod
    def look_at(
        cls,
        position: Sequence[float],
        target: Sequence[float],
        up: Sequence[float] = (0.0, 1.0, 0.0),
    ) -> Camera:
        """Returns a camera at ``position`` that looks at ``target``, with ``up`` upwards.

        If ``up`` is parallel to the view, or target and position coincide, some upright pose is
        chosen. World units count as metres; see :meth:`with_scale`.
        """
        at, upwards = vectors.vec3(position), vectors.vec3(up)
        backward = vectors.normalized(vectors.subtract(at, vectors.vec3(target))) or (0.0, 0.0, 1.0)
        across = vectors.cross(upwards, backward)
        right = vectors.normalized(across)
        if right is None or vectors.length(across) <= 1e-9 * vectors.length(upwards):
            # The axis that is farthest from the view.
            least = min(range(3), key=lambda axis: abs(backward[axis]))
            axis: Vec3 = (float(least == 0), float(least == 1), float(least == 2))
            right = vectors.normalized(vectors.cross(axis, backward)) or (1.0, 0.0, 0.0)
        rotation = vectors.from_axes(right, vectors.cross(backward, right), backward)
        return cls(at, rotation, 1.0)

    def with_scale(self, scale: float) -> Camera:
        """Returns the same pose with ``scale`` world units per metre of display space."""
        return replace(self, scale=float(scale))

    def world_from_display(self, display: Sequence[float]) -> Vec3:
        """Returns the point of the world where a point of display space, in metres, lies."""
        inner = vectors.scaled(vectors.vec3(display), self.scale)
        return vectors.add(self.position, vectors.rotated(self.rotation, inner))

    def moved_by(self, by_m: Sequence[float]) -> Camera:
        """Returns this camera moved along the axes of display space, in metres."""
        return replace(self, position=self.world_from_display(by_m))

    def turned_around(
        self, pivot: Sequence[float], up: Sequence[float], angle_rad: float
    ) -> Camera:
        """Returns this camera on an orbit about the axis through ``pivot`` along ``up``.

        The angle is counterclockwise as seen from above. The same camera if ``up`` has no
        direction.
        """
        axis, middle = vectors.normalized(vectors.vec3(up)), vectors.vec3(pivot)
        if axis is None:
            return self
        turn = vectors.about(axis, angle_rad)
        offset = vectors.rotated(turn, vectors.subtract(self.position, middle))
        rotation = vectors.unit(vectors.product(turn, self.rotation))
        return replace(self, position=vectors.add(middle, offset), rotation=rotation)

    def panned(self, eye: Sequence[float], up: Sequence[float], angle_rad: float) -> Camera:
        """Returns this camera turned to the left on the spot, about the axis through the eye."""
        return self.turned_around(self.world_from_display(eye), up, angle_rad)

    def towards(self, eye: Sequence[float], point: Sequence[float], share: float) -> Camera:
        """Returns this camera with the eye moved towards a point of the world.

        A share of 0 stays, 1 is there, below 0 goes away.
        """
        way = vectors.subtract(vectors.vec3(point), self.world_from_display(eye))
        return replace(self, position=vectors.add(self.position, vectors.scaled(way, share)))

    def with_eye_at(self, eye: Sequence[float], point: Sequence[float]) -> Camera:
        """Returns this camera with the eye, in metres of display space, at a point of the world."""
        inner = vectors.scaled(vectors.vec3(eye), self.scale)
        offset = vectors.rotated(self.rotation, inner)
        return replace(self, position=vectors.subtract(vectors.vec3(point), offset))


@dataclass(frozen=True)
class HeadPose:
    """The viewer's head in display space."""

    #: The middle between the eyes, in metres.
    position: Vec3
    #: A unit quaternion: x, y, z, w; ``None`` stays as it is.
    rotation: Optional[Quat] = None
    #: From the left eye to the right one, in metres; ``None`` stays as it is.
    eye_separation_m: Optional[float] = None


@dataclass(frozen=True)
class Area:
    """A part of the wall: all of it, or a rectangle of one screen's canvas."""

    #: An index into the wall's screens; ``None`` for the whole wall.
    screen: Optional[int] = None
    #: x, y, width, height, in pixels from the upper left of the screen.
    rect: Tuple[int, int, int, int] = (0, 0, 0, 0)

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        if self.screen is None:
            return "Wall"
        return {"Screen": {"screen": self.screen, "rect": list(self.rect)}}

    @classmethod
    def from_json(cls, value: Any, where: str) -> Area:
        """Returns the area of the wire."""
        if value == "Wall":
            return cls()
        inner = decode(Dict[str, Any], value, where).get("Screen")
        members = decode(Dict[str, Any], inner, where)
        x, y, width, height = decode(List[int], members.get("rect"), f"{where}.rect")
        return cls(decode(int, members.get("screen"), f"{where}.screen"), (x, y, width, height))


@dataclass(frozen=True)
class Projection:
    """The way in which a view shows what its camera sees.

    ``Projection()`` is a window: what the viewer's eyes see through it.
    """

    #: The camera's own picture, from the lower to the upper edge, in radians.
    fov_y_rad: Optional[float] = None
    #: Parallel rays, a plan: what is shown from the lower to the upper edge, in metres.
    height_m: Optional[float] = None

    def to_json(self) -> Any:
        """Returns the form of the wire."""
        if self.fov_y_rad is not None:
            return {"Perspective": {"fov_y_rad": self.fov_y_rad}}
        if self.height_m is not None:
            return {"Orthographic": {"height_m": self.height_m}}
        return "Wall"

    @classmethod
    def from_json(cls, value: Any, where: str) -> Projection:
        """Returns the projection of the wire."""
        if value == "Wall":
            return cls()
        members = decode(Dict[str, Dict[str, float]], value, where)
        return cls(
            members.get("Perspective", {}).get("fov_y_rad"),
            members.get("Orthographic", {}).get("height_m"),
        )


@dataclass(frozen=True)
class View:
    """A camera's picture on a part of the wall."""

    camera: Camera
    area: Area = Area()
    projection: Projection = Projection()
    #: The only node that is shown, with all that hangs from it; ``None`` for all.
    root: Optional[int] = None
    #: The names of the layers that are shown; ``None`` for those that the scene shows.
    layers: Optional[List[str]] = None


@dataclass(frozen=True)
class StoredView:
    """A place of the camera that the manager keeps under a name."""

    name: str
    camera: Camera


class Easing(Enum):
    """The way in which a tour gets to a stop."""

    #: Along a curve, without a jerk.
    SMOOTH = "Smooth"
    #: Straight, at one speed.
    LINEAR = "Linear"


@dataclass(frozen=True)
class TourStop:
    """A place where a tour goes."""

    camera: Camera
    #: Seconds from the stop before to this one; 0 is a cut.
    travel_s: float
    #: Seconds at the stop.
    stay_s: float = 0.0
    easing: Easing = Easing.SMOOTH


@dataclass(frozen=True)
class Tour:
    """A way of the camera through stops, as a function of scene time."""

    stops: List[TourStop] = field(default_factory=list)
    is_loop: bool = False

    @classmethod
    def along(
        cls, camera: Camera, eye: Sequence[float], points: Sequence[Sequence[float]], speed: float
    ) -> Tour:
        """Returns a tour in straight lines at one speed, in world units per second, above 0.

        ``eye`` is the point of display space, in metres, that is at each of the points in turn.
        """
        at, stops = camera.world_from_display(eye), []
        for point in points:
            way = vectors.subtract(vectors.vec3(point), at)
            at = vectors.vec3(point)
            there = camera.with_eye_at(eye, at)
            stops.append(TourStop(there, vectors.length(way) / speed, easing=Easing.LINEAR))
        return cls(stops)


@dataclass(frozen=True)
class TourStatus:
    """The tour that is played, and the clock that it follows."""

    #: ``None`` where none is played.
    tour: Optional[Tour]
    #: The node that the camera follows instead.
    following: Optional[int]
    #: Scene time at which it began, in seconds; ``None`` before its first frame.
    began_s: Optional[float]
    #: Scene time of the last frame, in seconds.
    time_s: float
    #: ``"Free"`` or ``{"Rate": frames per second}``; ``None`` for a wall that is paused.
    pace: Any = None


@dataclass(frozen=True)
class Follow:
    """A node that the camera follows, and where the camera is to it."""

    node: int
    #: The place of display space relative to the node; ``None`` keeps what it is.
    camera: Optional[Camera] = None
    #: ``True`` turns the camera with the node.
    is_turning: bool = False
    #: Radians per second of scene time around the node; 0 stays.
    orbit_rad_per_s: float = 0.0
