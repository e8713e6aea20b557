"""The wall, as a program drives it."""

from __future__ import annotations

import dataclasses
import html
import io
import json
import logging
import os
import tarfile
import threading
from pathlib import Path, PurePath
from typing import Any, Callable, Dict, List, Optional, Tuple, Union
from urllib.parse import urlencode

from .camera_calls import CameraCalls
from .display_calls import DisplayCalls
from .errors import (
    ClientError,
    ConnectionLost,
    Failed,
    Handshake,
    MalformedPicture,
    ManagerEnded,
    RequestTooLarge,
    WrongAnswer,
)
from .events import EventStream, FeedbackStream
from .feedback import FrameFeedback, OpenProgress, WallStatus
from .image import Capture, Image, figure
from .options import ConnectOptions, Timeouts
from .query_calls import QueryCalls
from .records import FilePath, Mismatch, decode, encode
from .requests import WireRequest, brings_files, name_of, variant
from .scene import SceneSummary
from .scene_calls import SceneCalls
from .session_calls import SessionCalls
from .transport import Answer, Call, Transport
from .wall import Wall

#: The maximum size of a scene's name in the status, in bytes of UTF-8.
_NAME_BYTES_MAX = 64

#: The maximum size of a request, in bytes of JSON: the manager's own limit.
REQUEST_BYTES_MAX = 4 << 20

_PREVIEW_WIDTH = 960

#: Requests that are answered once all displays are ready for what they change.
_PREPARED = (
    "OpenScene",
    "OpenOutcome",
    "SetEnvironment",
    "SetFog",
    "SetGlow",
    "SetAmbientOcclusion",
    "SetDepthOfField",
)
_CAPTURE = "capture the wall"


class Client(SceneCalls, SessionCalls, QueryCalls, CameraCalls, DisplayCalls):
    """A connection with a wall's manager, over its HTTP interface.

    The same calls drive one channel or thirty. Calls of several threads are done one after another;
    several clients work side by side. A connection that is lost is made again with the next call:
    a request that was sent fails once with an outcome that is unknown
    (:attr:`ClientError.is_outcome_unknown`) and is never repeated.

    Every call raises :class:`ClientError`: as the manager says (:class:`Failed`, after which the
    wall is as it was), or because no answer came (:class:`TimedOut`, :class:`ConnectionLost`,
    :class:`ManagerEnded`), or because nothing was sent (:class:`Closed`, :class:`NotConnected`).
    """

    def __init__(self, options: ConnectOptions) -> None:
        """Connects; see :meth:`connect`."""
        self._options = options
        self._lock = threading.RLock()
        self._is_closed = False
        self._wall_name: Optional[str] = None
        self._epoch = ""
        self._screens: Optional[Tuple[str, Wall]] = None
        # The last one is for the next call: while a call waits for its answer, another one stands
        # behind its own, for what is called meanwhile.
        self._transports = [self._new_transport()]
        self._transports[0].connect()

    @classmethod
    def connect(
        cls,
        address: str = "127.0.0.1:7880",
        *,
        token: Optional[str] = None,
        token_file: Union[str, Path, None] = None,
        bearer: Optional[str] = None,
        keys: Union[str, Path, None] = None,
        insecure: bool = False,
        name: str = "python",
        timeouts: Timeouts = Timeouts(),
    ) -> Client:
        """Connects to the manager that serves HTTP at ``address``.

        Without any of ``token``, ``token_file``, ``bearer`` and ``keys`` it shows the user's own
        token, as every command on the manager's machine does; see :class:`ConnectOptions`.

        :raises ClientError: the text says what would be right.
        """
        options = ConnectOptions(
            address=address,
            token=token,
            token_file=None if token_file is None else Path(token_file),
            bearer=bearer,
            insecure=insecure,
            name=name,
            timeouts=timeouts,
        )
        if keys is not None:
            options = dataclasses.replace(options, keys=Path(keys))
        return cls(options)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<polyptych.Client of wall {self._wall_name!r} at {self.address}>"

    @property
    def address(self) -> str:
        """The manager's host and port."""
        return self._options.address

    @property
    def wall_name(self) -> str:
        """The wall's name."""
        return self._wall_name or ""

    @property
    def epoch(self) -> str:
        """This life of the manager, 16 hexadecimal digits; another one after it was restarted."""
        return self._epoch

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection now; the next call makes one where there is none."""
        with self._lock:
            return self._transports[-1].is_connected

    def close(self) -> None:
        """Closes the connection for good. What is temporary of this client ends, and so does a call
        that another thread waits for, with :class:`ConnectionLost`, or :class:`Closed`."""
        # Without the lock, which that call holds.
        self._is_closed = True
        for transport in list(self._transports):
            transport.close("this program closed it")

    def request(self, request: WireRequest) -> Any:
        """Sends any request in the form of the wire, and returns its answer as JSON.

        ``wall.request({"SetExposure": 2.0})`` returns ``"Done"``; the other calls are this, typed.
        ``/api/v1/openapi.json`` has all requests.

        :raises ValueError: it is no request of the wire.
        """
        kind = variant(request)
        if kind == "OpenSession":
            # Its scene may be any of those that are being opened.
            return self._post_request(request, self._opening(None, None))
        timeouts = self._options.timeouts
        timeout_s = timeouts.open_scene if kind in _PREPARED else timeouts.other
        if brings_files(request):
            # Over HTTP nothing says how far a bake has come; the manager itself ends what hangs.
            return self._post_request(request, self._watched(timeout_s, lambda _: True))
        return self._post_request(request, Call("", "", "", timeout_s))

    def open_scene(
        self,
        path: FilePath,
        on_progress: Optional[Callable[[OpenProgress], None]] = None,
        scene: Union[str, int, None] = None,
    ) -> SceneSummary:
        """Shows a scene; returns once every live channel can draw it.

        :param path: a file in one of the manager's scene folders, or ``saved:NAME``.
        :param on_progress: called when the manager says how far it has come. It may call this
            client too: such calls go over another connection, which ends with this call.
        :param scene: the name, or the number from 0 on, of one of several scenes of the file.
        :raises Failed: it cannot be opened; the wall shows what it showed before.
        """
        request: WireRequest = {"OpenScene": {"path": path, "scene": _text_of(scene)}}
        given = self._post_request(request, self._opening(path, on_progress))
        return self._scene(given.get("SceneOpened") if isinstance(given, dict) else given)

    def show_scene(
        self, path: FilePath, heading_deg: float = 30.0, scene: Union[str, int, None] = None
    ) -> Tuple[SceneSummary, FrameFeedback]:
        """Opens a scene, places the camera so that all of it is seen, and draws a frame.

        The manager places the camera, on curved walls too, as ``polyptych open`` does.

        :param heading_deg: the direction from which the scene is seen, around +Y.
        :param scene: as for :meth:`open_scene`.
        """
        call = self._opening(path, None)
        asked = {"path": path, "scene": _text_of(scene), "heading_deg": float(heading_deg)}
        body = _body("open the scene", asked)
        call = dataclasses.replace(call, name="open the scene", method="POST", path="/scene/open")
        said = self._json(self._exchange(dataclasses.replace(call, body=body)), call.name)
        try:
            frame = decode(FrameFeedback, said["frame"], "frame")
        except (Mismatch, KeyError, TypeError) as error:
            raise WrongAnswer(call.name, str(error)) from None
        return self._scene(said["scene"]), frame

    def capture(self, time_s: Optional[float] = None, channels: bool = False) -> Capture:
        """Draws and shows one frame, and returns its pictures: each screen as it hangs on the wall.

        :param time_s: scene time in seconds; frames at equal steps of it make a film, however long
            each takes. Without it the wall's own clock goes on.
        :param channels: also each channel as its display has it, of the same frame.
        """
        with self._lock:
            wall = self._described()
            # The picture of the wall does not say which parts of it are for the right eye.
            if not channels and not wall.has_right_eye():
                whole, headers = self._picture("/wall.rgba", "wall", time_s)
                screens = _screens_of(wall, whole)
                if screens:
                    return Capture(whole.frame or 0, screens, [], self._missing(headers))
                # The manager was started again with another wall file.
                wall = self._described()
            capture = self._archived(wall, time_s)
        return capture if channels else dataclasses.replace(capture, channels=[])

    def preview(self, width: int = _PREVIEW_WIDTH, max_age_s: float = 1.0) -> Image:
        """Returns a small picture of the wall as it is, which all who ask share.

        It is of the next frame that the wall draws anyway, or of the last one drawn once more; it
        moves no clock.

        :param width: pixels across, at most 1920.
        :param max_age_s: the age that it may have, in seconds, up to 60.
        """
        query = {"width": width, "max_age_ms": max(1, round(1000.0 * max_age_s))}
        return self._picture("/wall.rgba", "wall", None, query)[0]

    def events(self, feedback: bool = False) -> EventStream:
        """Returns an iterator of the wall's status, twice a second, and of what happens in words.

        :param feedback: also what every frame became.
        """
        return EventStream(self._new_transport, feedback)

    def feedback(self) -> FeedbackStream:
        """Returns an iterator of what every frame becomes that is shown after this returns."""
        return FeedbackStream(self.events(feedback=True))

    def stop(self) -> None:
        """Ends the manager. Its goodbye instead of an answer is as good."""
        try:
            self._do("Stop")
        except (ManagerEnded, ConnectionLost):
            pass

    def _new_transport(self) -> Transport:
        transport = Transport(self._options)
        transport.introduce = self._introduce
        return transport

    def _introduce(self, transport: Transport) -> None:
        call = Call("read the status", "GET", "/status", self._options.timeouts.connect)
        said = transport.introduction(call)
        wall, epoch = str(said.get("wall")), str(said.get("epoch"))
        if self._wall_name not in (None, wall):
            raise Handshake(self.address, f"it drives wall {wall} now, not {self._wall_name}")
        self._wall_name, self._epoch = wall, epoch
        transport.epoch = epoch

    def _exchange(self, call: Call) -> Answer:
        with self._lock:
            transport = self._transports[-1]
            self._transports.append(self._new_transport())
            if self._is_closed:
                self.close()
            try:
                answer = transport.exchange(call)
            finally:
                self._transports.pop().drop()
        for warning in answer.warnings:
            _log(warning)
        return answer

    def _post_request(self, request: WireRequest, pattern: Call) -> Any:
        name = name_of(request)
        body = _body(name, request)
        call = dataclasses.replace(pattern, name=name, method="POST", path="/requests", body=body)
        said = self._json(self._exchange(call), name)
        if not isinstance(said, dict) or "response" not in said:
            raise WrongAnswer(name, f"{said!r}")
        for warning in said.get("warnings", []):
            _log(str(warning))
        return said["response"]

    def _json(self, answer: Answer, name: str) -> Any:
        try:
            return json.loads(answer.body)
        except ValueError as error:
            raise WrongAnswer(name, f"no JSON: {error}") from None

    def _scene(self, said: Any) -> SceneSummary:
        try:
            return decode(SceneSummary, said, "scene")
        except Mismatch as error:
            raise WrongAnswer("open the scene", str(error)) from None

    def _opening(
        self, path: Optional[FilePath], on_progress: Optional[Callable[[OpenProgress], None]]
    ) -> Call:
        """A call that waits as long as the manager opens this scene, or any without a path: the
        manager itself ends what hangs."""
        scene = _name_of(path)
        last: List[OpenProgress] = []

        def is_going_on(status: WallStatus) -> bool:
            found = [opening for opening in status.opening if scene in (None, opening.scene)]
            if not found:
                return False
            if on_progress is not None and last[-1:] != [found[0].progress]:
                last.append(found[0].progress)
                on_progress(found[0].progress)
            return True

        call = self._watched(self._options.timeouts.open_scene, is_going_on)
        return call if on_progress is None else dataclasses.replace(call, period_s=0.2)

    def _watched(self, timeout_s: float, is_going_on: Callable[[WallStatus], bool]) -> Call:
        """A call that asks over another connection for the status, while its answer is awaited, and
        whose time limit begins anew while the status says that it goes on."""

        def ask() -> bool:
            call = Call("read the status", "GET", "/status", self._options.timeouts.other)
            try:
                status = decode(WallStatus, json.loads(self._exchange(call).body))
            except (ClientError, Mismatch, ValueError):
                return False
            # Another life of the manager than that which was sent the call knows nothing of it.
            sent, asked = self._transports[-2:]
            return sent.epoch == asked.epoch and is_going_on(status)

        period_s = min(5.0, timeout_s / 4.0)
        return Call("", "", "", timeout_s, is_going_on=ask, period_s=period_s)

    def _described(self) -> Wall:
        """The wall's description, which lasts as long as its manager."""
        if self._screens is None or self._screens[0] != self._epoch:
            wall = self.wall()
            self._screens = (self._epoch, wall)
        return self._screens[1]

    def _archived(self, wall: Wall, time_s: Optional[float]) -> Capture:
        """All pictures of one frame."""
        answer = self._exchange(self._capturing("/capture", time_s, {"format": "rgba"}))
        screens, channels, missing = [], [], []
        try:
            with tarfile.open(fileobj=io.BytesIO(answer.body)) as archive:

                def read(file: str) -> bytes:
                    member = archive.extractfile(file)
                    return b"" if member is None else member.read()

                about = json.loads(read("capture.json"))
                frame = int(about["frame"])
                for of in about["pictures"]:
                    name, width, height = str(of["name"]), int(of["width"]), int(of["height"])
                    image = _whole(name, (width, height), read(of["file"]), frame)
                    (screens if of["is_screen"] else channels).append(image)
                missing = [(str(of["name"]), str(of["reason"])) for of in about["missing"]]
        except (tarfile.TarError, KeyError, TypeError, ValueError) as error:
            raise MalformedPicture(f"the wall came in no archive of pictures: {error}") from None
        # A stereo screen's second picture is not in a capture without channels either.
        named = {screen.name for screen in wall.screens}
        return Capture(frame, [of for of in screens if of.name in named], channels, missing)

    def _missing(self, headers: Any) -> List[Tuple[str, str]]:
        listed = str(headers.get("polyptych-missing", ""))
        if not listed:
            return []
        names = listed.split(", ")
        reasons = {channel.name: channel.reason for channel in self.status().channels}
        return [(name, reasons.get(name) or "it sent no picture") for name in names]

    def _picture(
        self,
        path: str,
        name: str,
        time_s: Optional[float],
        query: Optional[Dict[str, Any]] = None,
    ) -> Tuple[Image, Any]:
        answer = self._exchange(self._capturing(path, time_s, query or {}))
        try:
            width = int(answer.headers["polyptych-width"])
            height = int(answer.headers["polyptych-height"])
            frame = answer.headers.get("polyptych-frame")
            number = None if frame is None else int(frame)
        except (KeyError, ValueError) as error:
            raise MalformedPicture(f"{name} came without its size: {error}") from None
        return _whole(name, (width, height), answer.body, number), answer.headers

    def _capturing(self, path: str, time_s: Optional[float], query: Dict[str, Any]) -> Call:
        asked = dict(query)
        if time_s is not None:
            try:
                asked["time_s"] = encode(float(time_s))
            except ValueError as error:
                raise Failed(_CAPTURE, str(error)) from None
        return Call(
            _CAPTURE,
            "GET",
            f"{path}?{urlencode(asked)}" if asked else path,
            self._options.timeouts.capture,
            bytes_max=self._options.capture_bytes_max,
        )

    def _repr_png_(self) -> Optional[bytes]:
        """The wall as it stands, for programs that show no HTML."""
        try:
            return self.preview().to_png()
        except ClientError:
            return None

    def _repr_html_(self) -> str:
        """The wall as it stands: a preview, and the state of every channel."""
        try:
            status, picture = self.status(), self.preview()
        except ClientError as error:
            return f"<p>{html.escape(str(error))}</p>"
        scene = "no scene" if status.scene is None else f"scene {status.scene}"
        title = f"wall {status.wall}, {scene}, frame {status.frame}"
        rows = "".join(
            f"<tr><td>{html.escape(channel.name)}</td><td>{channel.state.value}</td>"
            f"<td>{html.escape(channel.reason or '')}</td></tr>"
            for channel in status.channels
        )
        return f"{figure(title, 'image/png', picture.to_png())}<table>{rows}</table>"


def _text_of(scene: Union[str, int, None]) -> Optional[str]:
    """The name or the number of a scene, as the wire has both."""
    return None if scene is None else str(scene)


def _name_of(file: Optional[FilePath]) -> Optional[str]:
    """The name by which the manager tells of the opening of this file; `None` for any."""
    path = None if file is None else os.fspath(file)
    # A saved scene has first its own name and then that of its file.
    if path is None or path.startswith("saved:"):
        return None
    stem = PurePath(path).stem or path
    return stem.encode("utf-8", "replace")[:_NAME_BYTES_MAX].decode("utf-8", "ignore")


def _screens_of(wall: Wall, whole: Image) -> List[Image]:
    """The pictures of the screens, which stand side by side in that of the wall; none where their
    widths are others."""
    if sum(screen.canvas[0] for screen in wall.screens) != whole.width:
        return []
    images, left = [], 0
    for screen in wall.screens:
        width, height = screen.canvas
        images.append(whole.part(screen.name, left, 0, width, height))
        left += width
    return images


def _whole(name: str, size: Tuple[int, int], rgba: bytes, frame: Optional[int]) -> Image:
    width, height = size
    expected = 4 * width * height
    if len(rgba) != expected:
        raise MalformedPicture(
            f"{name} came with {len(rgba)} bytes; {width} x {height} pixels have {expected}"
        )
    return Image(name, width, height, rgba, frame)


def _body(name: str, value: Any) -> bytes:
    try:
        body = json.dumps(encode(value), allow_nan=False).encode()
    except ValueError as error:
        raise Failed(name, str(error)) from None
    if len(body) > REQUEST_BYTES_MAX:
        reason = f"it takes {len(body)} bytes, and a request has at most {REQUEST_BYTES_MAX}"
        raise RequestTooLarge(name, reason)
    return body


def _log(warning: str) -> None:
    logging.getLogger("polyptych").warning("%s", warning)
