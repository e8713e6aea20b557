"""The wall: screens in display space, the channels that tile them, and the rays of their pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence, Tuple

from . import vectors
from .camera import Area, HeadPose, Projection, View
from .records import Quat, Vec2, Vec3, decode


class PickError(ValueError):
    """There is no ray through a place of the wall; the text says why."""


@dataclass(frozen=True)
class Plane:
    """A rectangle: three of its corners as the viewer sees it, in metres of display space."""

    lower_left: Vec3
    lower_right: Vec3
    upper_left: Vec3

    def point(self, u: float, v: float) -> Vec3:
        """Returns the point at (u, v): (0, 0) is the upper left, (1, 1) the lower right."""
        right = vectors.subtract(self.lower_right, self.lower_left)
        down = vectors.subtract(self.lower_left, self.upper_left)
        along = vectors.add(vectors.scaled(right, u), vectors.scaled(down, v))
        return vectors.add(self.upper_left, along)


@dataclass(frozen=True)
class Cylinder:
    """A patch of a cylinder. Azimuth 0 is at -Z of its own axes and grows to +X."""

    center: Vec3
    rotation: Quat
    radius_m: float
    #: Of the left and right edge as the viewer sees them.
    azimuth_rad: Tuple[float, float]
    #: Of the lower and the upper edge.
    height_m: Tuple[float, float]

    def point(self, u: float, v: float) -> Vec3:
        """Returns the point at (u, v): (0, 0) is the upper left, (1, 1) the lower right."""
        (left, right), (bottom, top) = self.azimuth_rad, self.height_m
        azimuth = left + (right - left) * u
        y = top + (bottom - top) * v
        own = (self.radius_m * math.sin(azimuth), y, -self.radius_m * math.cos(azimuth))
        return vectors.add(self.center, vectors.rotated(self.rotation, own))


@dataclass(frozen=True)
class Sphere:
    """A patch of a sphere. Azimuth 0 is at -Z of its own axes; elevation 0 on the equator."""

    center: Vec3
    rotation: Quat
    radius_m: float
    #: Of the left and right edge as the viewer sees them.
    azimuth_rad: Tuple[float, float]
    #: Of the lower and the upper edge.
    elevation_rad: Tuple[float, float]

    def point(self, u: float, v: float) -> Vec3:
        """Returns the point at (u, v): (0, 0) is the upper left, (1, 1) the lower right."""
        (left, right), (bottom, top) = self.azimuth_rad, self.elevation_rad
        azimuth, elevation = left + (right - left) * u, top + (bottom - top) * v
        out = math.cos(elevation)
        own = (out * math.sin(azimuth), math.sin(elevation), -out * math.cos(azimuth))
        offset = vectors.rotated(self.rotation, vectors.scaled(own, self.radius_m))
        return vectors.add(self.center, offset)


@dataclass(frozen=True)
class Screen:
    """A surface in display space, with the pixels that would cover all of it."""

    name: str
    #: ``{"Plane": ...}``, ``{"Cylinder": ...}``, ``{"Sphere": ...}`` or ``{"Mesh": file}``.
    surface: Dict[str, Any]
    #: Pixels across and down, those hidden behind bezels included.
    canvas: Tuple[int, int]

    def plane(self) -> Optional[Plane]:
        """Returns the screen's plane, if it is one."""
        inner = self.surface.get("Plane")
        return None if inner is None else decode(Plane, inner, f"screen {self.name}")

    def point(self, pixel: Sequence[float]) -> Optional[Vec3]:
        """Returns the point of display space, in metres, at a place of the canvas.

        The place is in pixels from the upper left. ``None`` for a screen whose shape stands in a
        file.
        """
        u, v = float(pixel[0]) / self.canvas[0], float(pixel[1]) / self.canvas[1]
        where = f"screen {self.name}"
        if "Plane" in self.surface:
            return decode(Plane, self.surface["Plane"], where).point(u, v)
        if "Cylinder" in self.surface:
            return decode(Cylinder, self.surface["Cylinder"], where).point(u, v)
        if "Sphere" in self.surface:
            return decode(Sphere, self.surface["Sphere"], where).point(u, v)
        return None


@dataclass(frozen=True)
class Channel:
    """An output image: a region of a screen."""

    name: str
    #: An index into the wall's screens.
    screen: int
    #: Its upper left pixel, from the upper left of the screen's canvas.
    origin: Tuple[int, int]
    #: Pixels across and down.
    size: Tuple[int, int]
    #: The server that drives it.
    server: str
    #: ``"Tile"`` for pixels of the canvas one to one.
    cover: Any = "Tile"
    #: The corrections of its picture for its display, in the form of the wire.
    adjustment: Dict[str, Any] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class Ray:
    """A half line in world space; its direction has any length but 0."""

    origin: Vec3
    direction: Vec3


@dataclass(frozen=True)
class Wall:
    """The whole display system that one wall file describes."""

    name: str
    screens: List[Screen]
    channels: List[Channel]
    #: The viewer's eye, in metres of display space.
    eye: Vec3
    near_m: float = 0.05
    eye_separation_m: float = 0.063
    #: Folders from which scenes may be opened.
    scenes: List[str] = field(default_factory=list)

    def has_right_eye(self) -> bool:
        """Returns whether the right eye sees a picture of its own on a screen."""
        adjustments = [channel.adjustment for channel in self.channels]
        return any(
            of.get("eye") == "right" or of.get("packing", "none") != "none" for of in adjustments
        )

    def pick_ray(
        self, views: Sequence[View], head: HeadPose, screen: str, pixel: Sequence[float]
    ) -> Ray:
        """Returns the ray that a pixel of a screen shows.

        It is that of the last of the views that covers the pixel. Pixels count from the upper left
        corner of the screen; the middle of the first is (0.5, 0.5).

        :raises PickError: there is no such pixel, or its point is not known here.
        """
        index = self._screen(screen)
        found, at = self.screens[index], (float(pixel[0]), float(pixel[1]))
        if not (0.0 <= at[0] <= found.canvas[0] and 0.0 <= at[1] <= found.canvas[1]):
            width, height = found.canvas
            raise PickError(
                f"[{at[0]:g}, {at[1]:g}] is not on screen {screen}, which has {width} × {height} "
                "pixels"
            )
        view = self.view_at(views, screen, at) or views[0]
        if view.projection == Projection():
            point = found.point(at)
            if point is None:
                raise PickError(f"screen {screen} is a mesh, whose points are not known here")
            origin = view.camera.world_from_display(head.position)
            direction = vectors.subtract(view.camera.world_from_display(point), origin)
        else:
            origin, direction = self._own_ray(view, found, at)
        if vectors.length(direction) == 0.0:
            raise PickError("the viewer's eye is at that very point of the screen")
        return Ray(origin, direction)

    def view_at(self, views: Sequence[View], screen: str, pixel: Sequence[float]) -> Optional[View]:
        """Returns the last of these views that covers a pixel of a screen."""
        index = self._screen(screen)
        for view in reversed(views):
            x, y, width, height = view.area.rect
            is_across = x <= pixel[0] < x + width and y <= pixel[1] < y + height
            if view.area.screen is None or (view.area.screen == index and is_across):
                return view
        return None

    def pick_region(
        self,
        views: Sequence[View],
        head: HeadPose,
        screen: str,
        corners: Sequence[Sequence[float]],
    ) -> List[Tuple[Vec3, float]]:
        """Returns the half spaces of the region that a rectangle of a screen shows.

        The rectangle goes from its upper left to its lower right corner; the region is a pyramid
        from the eye that goes on without an end. Each half space has the normal that points out of
        it, and its product with the points of the border.

        :raises PickError: there is no such rectangle, it shows more than one view, or the screen is
            not a plane.
        """
        begin, end = ((float(corner[0]), float(corner[1])) for corner in corners)
        if not (begin[0] < end[0] and begin[1] < end[1]):
            raise PickError(
                f"the rectangle from {list(begin)} to {list(end)} is empty; give its upper left "
                "corner first"
            )
        found = self.screens[self._screen(screen)]
        view = self._only_view(views, screen, begin, end)
        if view.projection == Projection() and found.plane() is None:
            raise PickError(
                f"screen {screen} is not a plane, so its rectangles show no pyramid; pick pixels "
                "of it"
            )
        # The last row and column end where the view does.
        right, bottom = _below(end[0]), _below(end[1])
        places = [begin, (begin[0], bottom), (right, bottom), (right, begin[1])]
        return _sides([self.pick_ray(views, head, screen, place) for place in places])

    def _only_view(self, views: Sequence[View], screen: str, begin: Vec2, end: Vec2) -> View:
        """The view of which alone a rectangle shows a part."""
        index = self._screen(screen)
        for view in reversed(views):
            if view.area.screen is None:
                return view
            x, y, width, height = view.area.rect
            is_beside = (
                x >= end[0] or y >= end[1] or x + width <= begin[0] or y + height <= begin[1]
            )
            if view.area.screen != index or is_beside:
                continue
            is_across = x <= begin[0] and x + width >= end[0]
            if is_across and y <= begin[1] and y + height >= end[1]:
                return view
            raise PickError(
                "the rectangle shows more than one view; give one that lies in a single view"
            )
        return views[0]

    def _screen(self, name: str) -> int:
        for index, screen in enumerate(self.screens):
            if screen.name == name:
                return index
        known = ", ".join(screen.name for screen in self.screens)
        raise PickError(f'the wall has no screen "{name}"; it has {known}')

    def _own_ray(self, view: View, screen: Screen, at: Vec2) -> Tuple[Vec3, Vec3]:
        """The ray of a view that is a camera's own picture."""
        plane = screen.plane()
        if plane is None or (view.area == Area() and len(self.screens) > 1):
            raise PickError(
                "cameras of their own are picked on one planar screen only; name its rectangle"
            )
        x, y, width, height = view.area.rect
        if view.area.screen is None:
            width, height = screen.canvas
        across = vectors.length(vectors.subtract(plane.lower_right, plane.lower_left))
        down = vectors.length(vectors.subtract(plane.upper_left, plane.lower_left))
        ratio = (across * width / screen.canvas[0]) / (down * height / screen.canvas[1])
        right = ((at[0] - x) / width - 0.5) * ratio
        up = 0.5 - (at[1] - y) / height
        start: Vec3 = (0.0, 0.0, 0.0)
        if view.projection.fov_y_rad is not None:
            reach = 2.0 * math.tan(view.projection.fov_y_rad / 2.0)
            through: Vec3 = (right * reach, up * reach, -1.0)
        else:
            height_m = view.projection.height_m or 0.0
            start = (right * height_m, up * height_m, 0.0)
            through = (start[0], start[1], -1.0)
        origin = view.camera.world_from_display(start)
        return origin, vectors.subtract(view.camera.world_from_display(through), origin)


def _below(number: float) -> float:
    """The largest number below this one, which is above 0."""
    mantissa, exponent = math.frexp(number)
    return number - math.ldexp(2.0**-53 if mantissa > 0.5 else 2.0**-54, exponent)


def _sides(rays: Sequence[Ray]) -> List[Tuple[Vec3, float]]:
    """The planes between neighbouring rays, and that of their origins where these differ."""
    ends = [vectors.add(ray.origin, ray.direction) for ray in rays]
    total = ends[0]
    for end in ends[1:]:
        total = vectors.add(total, end)
    middle = vectors.scaled(total, 1.0 / len(ends))
    planes = []
    for index, ray in enumerate(rays):
        along = vectors.subtract(ends[(index + 1) % len(ends)], ends[index])
        planes.append(_side(vectors.cross(along, ray.direction), ray.origin, middle))
    first = rays[0].origin
    floor = vectors.cross(
        vectors.subtract(rays[1].origin, first), vectors.subtract(rays[2].origin, first)
    )
    if floor != (0.0, 0.0, 0.0):
        planes.append(_side(floor, first, middle))
    return planes


def _side(normal: Vec3, through: Vec3, inner: Vec3) -> Tuple[Vec3, float]:
    """The half space of a plane through a point on whose one side the other point lies."""
    out = vectors.normalized(normal)
    if out is None:
        raise PickError("the viewer's eye is at that very point of the screen")
    if vectors.dot(out, vectors.subtract(inner, through)) > 0.0:
        out = vectors.scaled(out, -1.0)
    return out, vectors.dot(out, through)
