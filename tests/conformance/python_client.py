"""The Python package, for the conformance cases: each step by the method that it names."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

from step_failed import StepFailed

import polyptych
from polyptych.records import decode, encode

Arguments = Dict[str, Any]
Client = polyptych.Client


class PythonClient:
    """Calls the methods of :class:`polyptych.Client`."""

    has_status = False

    def __init__(self, address: str, token_file: str) -> None:
        self._client = Client.connect(address, token_file=Path(token_file), name="conformance")

    def request(self, request: Any) -> Any:
        """Sends a request of the wire."""
        return self._client.request(request)

    def call(self, step: Dict[str, Any]) -> Any:
        """Returns the answer to a step, in the form of the wire."""
        name, given = step["call"], step.get("with", {})
        try:
            if name in CALLS:
                answer = CALLS[name](self._client, given)
            else:
                answer = getattr(self._client, name)(**given)
        except polyptych.Failed as error:
            raise StepFailed("Failed", error.reason) from None
        except polyptych.ClientError as error:
            raise StepFailed(type(error).__name__, str(error)) from None
        if answer is None and name not in QUESTIONS:
            return {"done": True}
        return encode(answer)

    def picture(self, step: Dict[str, Any]) -> Tuple[int, int, bytes]:
        """Returns the picture of screen ``front``."""
        capture = self._client.capture(**step.get("with", {}))
        if capture.missing:
            raise StepFailed("Missing", repr(capture.missing))
        image = capture.screen("front")
        return image.width, image.height, image.rgba


def camera(given: Optional[Arguments]) -> Optional[polyptych.Camera]:
    """A camera of the wire, if there is one."""
    return None if given is None else decode(polyptych.Camera, given)


def commit(client: Client, given: Arguments) -> Any:
    """Commits a transaction that is made by its methods."""
    transaction = polyptych.Transaction()
    for name, *arguments in given["edits"]:
        if arguments and isinstance(arguments[0], dict):
            getattr(transaction, name)(**arguments[0])
        else:
            getattr(transaction, name)(*arguments)
    return client.commit(transaction)


def query(given: Arguments) -> polyptych.NodeQuery:
    """A query for nodes."""
    members = dict(given)
    attribute = members.pop("attribute")
    kind = members.pop("kind")
    if attribute is not None:
        key, value = attribute
        attribute = key if value is None else (key, next(iter(value.values())))
    kind = None if kind is None else polyptych.NodeKind(kind)
    return polyptych.NodeQuery(attribute=attribute, kind=kind, **members)


def ray_query(given: Arguments) -> polyptych.RayQuery:
    """A question for what a ray meets."""
    return decode(polyptych.RayQuery, given)


def in_region(client: Client, given: Arguments) -> Any:
    """Asks for the nodes in a region."""
    return client.find_in_region(*region_query(given))


def region_query(given: Arguments) -> Tuple[Any, polyptych.Relation, polyptych.NodeQuery]:
    """A region, a relation to it, and a query for nodes."""
    region: Any
    if "Sphere" in given["region"]:
        region = decode(polyptych.Ball, given["region"]["Sphere"])
    else:
        sides = given["region"]["Convex"]
        region = polyptych.Convex([(tuple(of["normal"]), of["offset"]) for of in sides])
    return region, polyptych.Relation(given["relation"]), query(given["query"])


def start_rendering(client: Client, given: Arguments) -> None:
    """Runs at a pace of the wire."""
    client.start_rendering(given["pace"]["Rate"])


def set_environment(client: Client, given: Arguments) -> None:
    """Sets surroundings of the wire."""
    client.set_environment(given["environment"]["File"]["path"])


def glow(given: Any) -> Optional[polyptych.Glow]:
    """A glow of the wire, if there is one."""
    return None if given is None else decode(polyptych.Glow, given)


def occlusion(given: Any) -> Optional[polyptych.AmbientOcclusion]:
    """An ambient occlusion of the wire, if there is one."""
    return None if given is None else decode(polyptych.AmbientOcclusion, given)


def focus(given: Any) -> Optional[polyptych.DepthOfField]:
    """A depth of field of the wire, if there is one."""
    return None if given is None else decode(polyptych.DepthOfField, given)


def fog(given: Any) -> Optional[polyptych.Fog]:
    """A fog of the wire, if there is one."""
    return None if given is None else decode(polyptych.Fog, given)


def views(given: Any) -> List[polyptych.View]:
    """Views of the wire."""
    return decode(List[polyptych.View], given)


#: Calls of which ``None`` is an answer.
QUESTIONS = ("cast_ray", "pick", "nearest_point", "first_between", "ground_below")

CALLS: Dict[str, Callable[[Client, Arguments], Any]] = {
    "render_frame": lambda client, given: client.render_frame(
        camera(given["camera"]), given["time_s"]
    ),
    "set_camera": lambda client, given: client.set_camera(
        decode(polyptych.Camera, given["camera"])
    ),
    "store_view": lambda client, given: client.store_view(given["name"], camera(given["camera"])),
    "set_head": lambda client, given: client.set_head(given["position"]),
    "set_views": lambda client, given: client.set_views(views(given["views"])),
    "set_fog": lambda client, given: client.set_fog(fog(given["fog"])),
    "set_glow": lambda client, given: client.set_glow(glow(given["glow"])),
    "set_ambient_occlusion": lambda client, given: client.set_ambient_occlusion(
        occlusion(given["ambient_occlusion"])
    ),
    "set_depth_of_field": lambda client, given: client.set_depth_of_field(
        focus(given["depth_of_field"])
    ),
    "set_bounds": lambda client, given: client.set_bounds(
        decode(polyptych.QualityBounds, given["bounds"])
    ),
    "set_environment": set_environment,
    "set_rest": lambda client, given: client.set_rest(
        given["idle_s"], decode(Optional[polyptych.LitHours], given["hours"])
    ),
    "start_rendering": start_rendering,
    "play_tour": lambda client, given: client.play_tour(decode(polyptych.Tour, given["tour"])),
    "commit": commit,
    "find_nodes": lambda client, given: client.find_nodes(query(given["query"])),
    "find_all_nodes": lambda client, given: client.find_all_nodes(query(given["query"])),
    "cast_ray": lambda client, given: client.cast_ray(ray_query(given["query"])),
    "find_in_region": in_region,
    "find_all_in_region": lambda client, given: client.find_all_in_region(*region_query(given)),
    "first_between": lambda client, given: client.first_between(given["from"], given["to"]),
    "is_in_sight": lambda client, given: client.is_in_sight(given["from"], given["to"]),
    "follow_node": lambda client, given: client.follow_node(
        decode(polyptych.Follow, given["follow"])
    ),
}
