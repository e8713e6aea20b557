"""Camera poses that show a whole scene, on walls whose screen in front of the eye is a plane.

For curved screens :meth:`polyptych.Client.show_scene` lets the manager place the camera.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

from . import vectors
from .camera import Camera
from .records import Quat, Vec2, Vec3
from .scene import Bounds
from .wall import Screen, Wall

# The numbers and their reasons are those of the Rust client (camera.rs, window.rs).
_ELEVATION_RAD = 0.35
_NEAREST_MIN = 0.15
_NEAR_PLANES_MIN = 1.05
_COVERED_MIN = 0.9
_HALVINGS = 50


@dataclass(frozen=True)
class _Window:
    """A rectangle on a plane in front of the eye: its axes, its distance, tangents of its edges."""

    axes: Tuple[Vec3, Vec3, Vec3]
    distance_m: float
    low: Vec2
    high: Vec2


def fit_bounds(wall: Wall, bounds: Bounds, heading_rad: float) -> Camera:
    """Returns a camera that shows all of ``bounds``, as large as the wall can.

    The scene is seen from ``heading_rad`` around +Y (0 sees it from its +Z side) and 0.35 rad above
    the horizon. Bounds without extent count as a cube with a half diagonal of one unit.

    :raises ValueError: the screen in front of the eye is curved.
    """
    rotation, window = _rotation(heading_rad), _window_of_wall(wall)
    radius = bounds.radius() or 1.0
    half = [max((high - low) * 0.5 / radius, 0.0) for low, high in zip(bounds.min, bounds.max)]
    if half == [0.0, 0.0, 0.0]:
        half = [1.0 / math.sqrt(3.0)] * 3
    axes = [vectors.rotated(rotation, axis) for axis in window.axes]
    corners: List[Vec3] = []
    for signs in itertools.product((-1.0, 1.0), repeat=3):
        corner: Vec3 = (signs[0] * half[0], signs[1] * half[1], signs[2] * half[2])
        corners.append(_in_axes(axes, corner))
    center, metres = _fit(window, corners, wall.near_m)
    scale = radius / metres
    middle = vectors.add(wall.eye, _from_axes(window.axes, center))
    offset = vectors.rotated(rotation, vectors.scaled(middle, scale))
    return Camera(vectors.subtract(bounds.center(), offset), rotation, scale)


def orbit(wall: Wall, bounds: Bounds, heading_rad: float) -> Camera:
    """Returns a camera on a circle around ``bounds``, always from the same distance.

    The box's bounding sphere fits the shorter side of the screen in front of the eye.

    :raises ValueError: the screen in front of the eye is curved.
    """
    rotation, radius = _rotation(heading_rad), bounds.radius() or 1.0
    front = _front_screen(wall)
    middle, half_side_m = vectors.add(wall.eye, (0.0, 0.0, -1.0)), 0.5
    if front is not None:
        screen, middle = front
        half_side_m = min(_size_m(screen)) * 0.5
    distance_m = vectors.length(vectors.subtract(middle, wall.eye))
    radius_m = distance_m * math.sin(math.atan2(half_side_m, distance_m))
    scale = radius / radius_m if radius_m > 0.0 else radius
    offset = vectors.rotated(rotation, vectors.scaled(middle, scale))
    return Camera(vectors.subtract(bounds.center(), offset), rotation, scale)


def _rotation(heading_rad: float) -> Quat:
    across, up = math.cos(_ELEVATION_RAD), math.sin(_ELEVATION_RAD)
    outward = (math.sin(heading_rad) * across, up, math.cos(heading_rad) * across)
    return Camera.look_at(outward, (0.0, 0.0, 0.0)).rotation


def _in_axes(axes: Sequence[Vec3], point: Vec3) -> Vec3:
    return vectors.dot(axes[0], point), vectors.dot(axes[1], point), vectors.dot(axes[2], point)


def _from_axes(axes: Sequence[Vec3], point: Vec3) -> Vec3:
    parts = [vectors.scaled(axis, number) for axis, number in zip(axes, point)]
    return vectors.add(vectors.add(parts[0], parts[1]), parts[2])


def _fit(window: _Window, corners: Sequence[Vec3], near_m: float) -> Tuple[Vec3, float]:
    """The centre of a box in metres from the eye, and the metres that one unit takes."""
    d = window.distance_m
    sides = [
        _Side(
            [(corner[axis], corner[2]) for corner in corners],
            window.low[axis],
            window.high[axis],
            d,
        )
        for axis in (0, 1)
    ]
    nearest = max(corner[2] for corner in corners)
    metres = min(side.metres(0.0) for side in sides)
    if d - nearest * metres >= _NEAREST_MIN * d:
        return (sides[0].middle(metres), sides[1].middle(metres), -d), metres
    metres = min(side.metres_around_middle() for side in sides)
    uncut = (d - min(near_m * _NEAR_PLANES_MIN, d / 2.0)) / nearest
    if uncut > 0.0:
        metres = min(metres, uncut)
    middle = [(window.low[axis] + window.high[axis]) * d / 2.0 for axis in (0, 1)]
    return (middle[0], middle[1], -d), metres


@dataclass(frozen=True)
class _Side:
    """Two opposite edges of a window, and where the corners of a box lie between them."""

    corners: Sequence[Vec2]
    low: float
    high: float
    d: float

    def metres(self, margin: float) -> float:
        """The most metres that a unit can take for the corners to stay within both edges."""
        low, high = self._reach(margin)
        if low + high <= 0.0:
            return math.inf
        return (self.high - self.low - 2.0 * margin) * self.d / (low + high)

    def metres_around_middle(self) -> float:
        low, high = self._reach(0.0)
        most = max(low, high)
        return math.inf if most <= 0.0 else (self.high - self.low) / 2.0 * self.d / most

    def _reach(self, margin: float) -> Vec2:
        low, high = self.low + margin, self.high - margin
        left = max(0.0, *(-low * z - x for x, z in self.corners))
        right = max(0.0, *(x + high * z for x, z in self.corners))
        return left, right

    def middle(self, metres: float) -> float:
        """The place of the box's middle from which its corners are as far from both edges."""
        small, large = 0.0, (self.high - self.low) / 2.0
        for _ in range(_HALVINGS):
            between = (small + large) / 2.0
            if self.metres(between) >= metres:
                small = between
            else:
                large = between
        low, high = self._reach(small)
        return ((self.low + self.high) * self.d + (low - high) * metres) / 2.0


def _window_of_wall(wall: Wall) -> _Window:
    ahead = _Window(
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), 1.0, (-0.5, -0.5), (0.5, 0.5)
    )
    front = _front_screen(wall)
    if front is None:
        return ahead
    corners = _lit_corners(wall, front[0])
    right = vectors.normalized(vectors.subtract(corners[1], corners[0]))
    if right is None:
        return ahead
    upwards = vectors.subtract(corners[2], corners[0])
    up = vectors.normalized(
        vectors.subtract(upwards, vectors.scaled(right, vectors.dot(upwards, right)))
    )
    if up is None:
        return ahead
    backward = vectors.cross(right, up)
    distance_m = vectors.dot(backward, vectors.subtract(wall.eye, corners[0]))
    if not distance_m > 0.0:
        return ahead
    axes = (right, up, backward)
    return _joined(wall, axes, distance_m, _tangents(axes, distance_m, wall.eye, corners))


def _tangents(
    axes: Sequence[Vec3], distance_m: float, eye: Vec3, corners: Sequence[Vec3]
) -> Tuple[Vec2, Vec2]:
    places = [_in_axes(axes, vectors.subtract(corner, eye)) for corner in corners]
    across = [place[0] / distance_m for place in places]
    down = [place[1] / distance_m for place in places]
    return (min(across), min(down)), (max(across), max(down))


def _joined(
    wall: Wall,
    axes: Tuple[Vec3, Vec3, Vec3],
    distance_m: float,
    own: Tuple[Vec2, Vec2],
) -> _Window:
    """The rectangle around all screens that lie in this plane, if they cover it."""
    (low, high), covered = own, 0.0
    for screen in wall.screens:
        if screen.plane() is None:
            continue
        corners = _lit_corners(wall, screen)
        depths = [vectors.dot(axes[2], vectors.subtract(wall.eye, corner)) for corner in corners]
        if any(abs(depth - distance_m) >= 1e-6 * max(distance_m, 1.0) for depth in depths):
            continue
        one_low, one_high = _tangents(axes, distance_m, wall.eye, corners)
        covered += _extent(one_low, one_high)
        low = (min(low[0], one_low[0]), min(low[1], one_low[1]))
        high = (max(high[0], one_high[0]), max(high[1], one_high[1]))
    if covered >= _COVERED_MIN * _extent(low, high):
        return _Window(axes, distance_m, low, high)
    return _Window(axes, distance_m, *own)


def _extent(low: Vec2, high: Vec2) -> float:
    return (high[0] - low[0]) * (high[1] - low[1])


def _front_screen(wall: Wall) -> Optional[Tuple[Screen, Vec3]]:
    """The screen that stands most in front of the eye, and the middle of its canvas."""
    front, most_ahead = None, -math.inf
    for screen in wall.screens:
        middle = screen.point((screen.canvas[0] / 2.0, screen.canvas[1] / 2.0))
        if middle is None:
            continue
        toward = vectors.normalized(vectors.subtract(middle, wall.eye))
        ahead = 0.0 if toward is None else -toward[2]
        if ahead > most_ahead + 1e-9:
            front, most_ahead = (screen, middle), ahead
    if front is not None and front[0].plane() is None:
        raise ValueError(
            f"screen {front[0].name} is curved; Client.show_scene lets the manager place the camera"
        )
    return front


def _lit_corners(wall: Wall, screen: Screen) -> List[Vec3]:
    """The lower left, lower right, upper left and upper right corner of what is lit."""
    index = wall.screens.index(screen)
    channels = [channel for channel in wall.channels if channel.screen == index]
    left, top, right, bottom = 0, 0, screen.canvas[0], screen.canvas[1]
    if channels and all(channel.cover == "Tile" for channel in channels):
        left = min(channel.origin[0] for channel in channels)
        top = min(channel.origin[1] for channel in channels)
        right = max(channel.origin[0] + channel.size[0] for channel in channels)
        bottom = max(channel.origin[1] + channel.size[1] for channel in channels)
    places = ((left, bottom), (right, bottom), (left, top), (right, top))
    points = [screen.point(place) for place in places]
    return [point for point in points if point is not None]


def _size_m(screen: Screen) -> Vec2:
    width, height = screen.canvas
    corners = [
        screen.point(place) or (0.0, 0.0, 0.0) for place in ((0, height), (width, height), (0, 0))
    ]
    across = vectors.length(vectors.subtract(corners[1], corners[0]))
    return across, vectors.length(vectors.subtract(corners[2], corners[0]))
