"""What a client does with the camera and the head: places, views, tours."""

from __future__ import annotations

from typing import List, Optional, Sequence, Union

from . import vectors
from .camera import Camera, Follow, HeadPose, StoredView, Tour, TourStatus, View
from .requests import Requests


class CameraCalls(Requests):
    """Calls about what is looked at, and from where."""

    def set_camera(self, camera: Camera) -> None:
        """Places display space in the scene, from the next frame on.

        :raises Failed: the camera is none: not finite, no unit quaternion, or a scale of 0.
        """
        self._do({"SetCamera": camera})

    def look_at(
        self,
        position: Sequence[float],
        target: Sequence[float],
        up: Sequence[float] = (0.0, 1.0, 0.0),
    ) -> None:
        """Places the camera at ``position`` and turns it to ``target``; world units are metres."""
        self.set_camera(Camera.look_at(position, target, up))

    def set_head(self, head: Union[HeadPose, Sequence[float]]) -> None:
        """Moves the viewer's head, from the next frame on.

        :param head: a pose, or the point between the eyes in metres of display space.
        :raises Failed: one of the eyes would not see the front of a screen.
        """
        pose = head if isinstance(head, HeadPose) else HeadPose(vectors.vec3(head))
        self._do({"SetHead": pose})

    def set_views(self, views: Sequence[View]) -> None:
        """Lays views over the wall's own picture, later ones over earlier ones: at most 63."""
        self._do({"SetViews": list(views)})

    def clear_views(self) -> None:
        """Takes all views away, from the next frame on."""
        self.set_views([])

    def store_view(self, name: str, camera: Optional[Camera] = None) -> None:
        """Keeps a camera under a name; the present one if not given. It outlives the manager."""
        self._do({"StoreView": {"name": name, "camera": camera}})

    def remove_view(self, name: str) -> None:
        """Forgets a stored view.

        :raises Failed: there is none of this name; the reason has all there are.
        """
        self._do({"RemoveView": {"name": name}})

    def stored_views(self) -> List[StoredView]:
        """Returns the stored views, by name."""
        return self._ask("ListStoredViews", "StoredViews", List[StoredView])

    def play_tour(self, tour: Tour) -> None:
        """Lets the camera move through stops, as a function of scene time.

        A wall that is paused does not move by itself; see :meth:`start_rendering`.
        """
        self._do({"PlayTour": tour})

    def follow_node(self, follow: Follow) -> None:
        """Lets the camera follow a node, in the frame that moves it."""
        self._do({"FollowNode": follow})

    def stop_tour(self) -> None:
        """Ends the tour, or the following of a node; the camera stays where it is."""
        self._do("StopTour")

    def tour(self) -> TourStatus:
        """Returns how the tour stands, with the scene time and the pace that it follows."""
        return self._ask("DescribeTour", "Tour", TourStatus)
