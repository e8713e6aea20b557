"""The way of a request of the wire to its answer, which all calls of the client share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Dict, Type, TypeVar, Union

from .errors import WrongAnswer
from .records import Mismatch, decode

T = TypeVar("T")

#: A request in the form of the wire: ``"Status"``, or ``{"SetExposure": 2.0}``.
WireRequest = Union[str, Dict[str, Any]]

_NAMES: Dict[str, str] = {
    "OpenScene": "open the scene",
    "OpenOutcome": "open the scene",
    "CloseScene": "close the scene",
    "SetCamera": "set the camera",
    "SetHead": "set the head",
    "SetViews": "set the views",
    "SetExposure": "set the exposure",
    "RenderFrame": "render a frame",
    "Redraw": "render a frame",
    "Run": "run",
    "Pause": "pause",
    "Capture": "capture the wall",
    "Status": "read the status",
    "DescribeWall": "read the wall's description",
    "Statistics": "read the statistics",
    "Stop": "stop the manager",
    "StopServers": "stop the manager and its servers",
    "SetDisplays": "change the displays",
    "SetPattern": "change the pattern",
    "Tune": "tune the channel",
    "Edit": "edit the scene",
    "FindNodes": "find nodes",
    "CastRay": "cast a ray",
    "FindInRegion": "find nodes in the region",
    "NearestPoint": "find the nearest point",
    "StoreView": "store the view",
    "RemoveView": "remove the view",
    "ListStoredViews": "list the stored views",
    "PlayTour": "play the tour",
    "StopTour": "stop the tour",
    "DescribeTour": "read how the tour stands",
    "SaveScene": "save the scene",
    "ListSavedScenes": "list the saved scenes",
    "RemoveSavedScene": "remove the saved scene",
    "FollowNode": "follow the node",
    "FindWay": "find a way",
    "ListLayers": "list the layers",
    "SetBounds": "set the bounds",
    "ChangeClips": "play the animation",
    "ListClips": "list the animations",
    "SetEnvironment": "set the environment",
    "SetTone": "set the tone mapper",
    "ListVariants": "list the variants",
    "SetAutomaticExposure": "set the automatic exposure",
    "SetFog": "set the fog",
    "SetGlow": "set the glow",
    "SetAmbientOcclusion": "set the ambient occlusion",
    "SetDepthOfField": "set the depth of field",
    "SaveSession": "save the session",
    "OpenSession": "open the session",
    "ListSessions": "list the sessions",
    "RemoveSession": "remove the session",
    "MarkPoint": "mark the point",
    "ListSceneFiles": "list the scene files",
    "SetRest": "set the rest of the displays",
    "Fly": "fly the camera",
    "ReportDevices": "report the devices",
}


def variant(request: WireRequest) -> str:
    """Returns the name of a request's type, such as ``SetCamera``.

    :raises ValueError: it is no request of the wire.
    """
    if isinstance(request, str):
        return request
    if isinstance(request, dict) and len(request) == 1:
        return str(next(iter(request)))
    raise ValueError(
        f"{request!r} is no request; give a name, or an object with one name, such as "
        '{"SetExposure": 2.0}'
    )


def name_of(request: WireRequest) -> str:
    """Returns what a request does, as it stands behind "cannot"."""
    kind = variant(request)
    return _NAMES.get(kind, f"do {kind}")


def brings_files(request: WireRequest) -> bool:
    """Returns whether the manager bakes files for a request, before it does the rest."""
    kind = variant(request)
    asked: Any = next(iter(request.values())) if isinstance(request, dict) else None
    if kind == "Edit":
        edit = asked.to_json() if hasattr(asked, "to_json") else asked
        return isinstance(edit, dict) and edit.get("assets") is not None
    return kind == "SetEnvironment" and asked != "None"


class Requests(ABC):
    """The base of all groups of calls."""

    @abstractmethod
    def request(self, request: WireRequest) -> Any:
        """Sends any request and returns its answer as JSON."""

    def _ask(self, request: WireRequest, answer: str, kind: Type[T]) -> T:
        """Sends a request and returns its answer, which must be of this name and type."""
        inner = self._ask_plain(request, answer)
        try:
            return decode(kind, inner, answer)
        except Mismatch as error:
            raise WrongAnswer(name_of(request), str(error)) from None

    def _ask_plain(self, request: WireRequest, answer: str) -> Any:
        given = self.request(request)
        if isinstance(given, dict) and answer in given:
            return given[answer]
        kind = given if isinstance(given, str) else ", ".join(given or ["nothing"])
        raise WrongAnswer(name_of(request), str(kind))

    def _do(self, request: WireRequest) -> None:
        """Sends a request whose answer is that it was done."""
        given = self.request(request)
        if given != "Done":
            kind = given if isinstance(given, str) else ", ".join(given or ["nothing"])
            raise WrongAnswer(name_of(request), str(kind))
