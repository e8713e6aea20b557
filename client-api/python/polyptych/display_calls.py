"""What a client does with light, displays, frames and calibration."""

from __future__ import annotations

from typing import Any, Dict, Optional, Sequence, Union

from .camera import Camera
from .feedback import (
    AmbientOcclusion,
    DepthOfField,
    Fog,
    Glow,
    FrameFeedback,
    LitHours,
    OutputMode,
    QualityBounds,
    Statistics,
    StoppedServers,
    TestPattern,
    ToneMapper,
    Tuned,
)
from .records import FilePath
from .requests import Requests


class DisplayCalls(Requests):
    """Calls about what displays show of the scene, and when."""

    def set_exposure(self, exposure: float) -> None:
        """Multiplies light before tone mapping, until another scene is opened."""
        self._do({"SetExposure": exposure})

    def set_automatic_exposure(self) -> None:
        """Exposes the wall by what it shows, until :meth:`set_exposure`."""
        self._do("SetAutomaticExposure")

    def set_environment(self, file: Optional[FilePath] = None, *, is_sky: bool = False) -> None:
        """Surrounds scenes by light, until it is set again; by that of their own with neither.

        The manager bakes a file or the sky first; this waits for it as long as the manager answers.

        :param file: an equirectangular ``.hdr`` in one of the manager's scene folders.
        :param is_sky: a clear sky, whose sun is where the scene's first directional light is.
        :raises ValueError: both are given.
        """
        if file is not None and is_sky:
            raise ValueError("give either file or is_sky, not both")
        source: Any = {"File": {"path": file}} if file is not None else "Sky" if is_sky else "None"
        self._do({"SetEnvironment": source})

    def set_tone(self, tone: Union[ToneMapper, str]) -> None:
        """Sets how exposed light becomes what displays show: ``Neutral``, ``Aces``, ``None``."""
        self._do({"SetTone": tone})

    def set_fog(self, fog: Optional[Fog]) -> None:
        """Lays fog over what cameras see; ``None`` takes it away. Returns once frames have it."""
        self._do({"SetFog": fog})

    def set_glow(self, glow: Optional[Glow]) -> None:
        """Spreads light around what is bright; ``None`` ends it. Returns once frames have it."""
        self._do({"SetGlow": glow})

    def set_ambient_occlusion(self, occlusion: Optional[AmbientOcclusion]) -> None:
        """Darkens corners and gaps; ``None`` ends it. Returns once frames have it."""
        self._do({"SetAmbientOcclusion": occlusion})

    def set_depth_of_field(self, depth_of_field: Optional[DepthOfField]) -> None:
        """Blurs what is nearer or farther than a distance; ``None`` ends it. Returns once frames
        have it."""
        self._do({"SetDepthOfField": depth_of_field})

    def set_bounds(self, bounds: QualityBounds) -> None:
        """Bounds the error and the rate of pictures, until it is set again."""
        self._do({"SetBounds": bounds})

    def render_frame(
        self, camera: Optional[Camera] = None, time_s: Optional[float] = None
    ) -> FrameFeedback:
        """Draws and shows one frame on all channels; returns what it became.

        A frame that no display showed is no error; see :meth:`FrameFeedback.shown`.

        :param camera: placed first, if given.
        :param time_s: scene time in seconds; without it the wall's own clock goes on.
        """
        asked = {"camera": camera, "time_s": time_s}
        return self._ask({"RenderFrame": asked}, "Frame", FrameFeedback)

    def redraw(self, camera: Optional[Camera] = None) -> FrameFeedback:
        """Draws a frame like :meth:`render_frame`, but on a paused wall with the scene time of the
        frame before, so that nothing else moves.

        :param camera: placed first, if given.
        """
        return self._ask({"Redraw": camera}, "Frame", FrameFeedback)

    def start_rendering(self, rate_fps: Optional[float] = None) -> None:
        """Lets the wall draw by itself, until :meth:`pause`.

        :param rate_fps: frames per second; as fast as the slowest channel if not given.
        """
        self._do({"Run": "Free" if rate_fps is None else {"Rate": float(rate_fps)}})

    def pause(self) -> None:
        """Stops the wall from drawing by itself; it goes on showing the last frame."""
        self._do("Pause")

    def set_output_mode(self, mode: Union[OutputMode, str]) -> FrameFeedback:
        """Changes what all displays show: ``normal``, ``identify``, ``blank`` or ``freeze``.

        Captures are as before, whatever displays show.
        """
        return self._ask({"SetDisplays": mode}, "Frame", FrameFeedback)

    def set_pattern(self, pattern: Union[TestPattern, str, None]) -> FrameFeedback:
        """Lets all channels draw a test pattern instead of the scene, or the scene again."""
        return self._ask({"SetPattern": pattern}, "Frame", FrameFeedback)

    def calibrate(self, channel: str, changes: Sequence[Dict[str, Any]]) -> Tuned:
        """Changes a channel's adjustment, all of it or nothing.

        :param changes: in the form of the wire, such as ``[{"Gain": [1.0, 0.9, 1.0]}]``.
        :raises Failed: a change cannot be; the reason names the key.
        """
        asked: Dict[str, Any] = {"channel": channel, "changes": list(changes)}
        return self._ask({"Tune": asked}, "Tuned", Tuned)

    def mark_point(self, channel: Optional[str], point: Optional[Dict[str, Any]] = None) -> None:
        """Lights a point of a channel over its test pattern; ``None`` lights no point.

        :param point: in the form of the wire: ``{"Corner": "upper-left"}``, ``{"Edge": "left"}``
            or ``{"Bend": {"column": 1, "row": 0}}``.
        """
        marker = None if channel is None else {"channel": channel, "point": point}
        self._do({"MarkPoint": marker})

    def set_rest(self, idle_s: Optional[float] = None, hours: Optional[LitHours] = None) -> None:
        """Sets when displays go dark by themselves; never with neither. The manager keeps it.

        :param idle_s: seconds without a request that changes what the wall shows.
        :param hours: the part of a day in which displays are lit.
        """
        self._do({"SetRest": {"idle_s": idle_s, "hours": hours}})

    def statistics(self, reset: bool = False) -> Statistics:
        """Returns what the frames took since the last reset; ``reset`` begins anew afterwards."""
        return self._ask({"Statistics": {"reset": reset}}, "Statistics", Statistics)

    def stop_with_servers(self) -> StoppedServers:
        """Ends all servers of the wall and then the manager; returns what became of the servers."""
        return self._ask("StopServers", "ServersStopped", StoppedServers)
