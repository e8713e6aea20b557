"""What programs learn of frames and channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Dict, Iterator, List, Optional, Tuple

from .camera import Camera, HeadPose, View


class ChannelState(str, Enum):
    """The state of a channel."""

    #: No server drives it.
    LOST = "lost"
    #: A server has claimed it and has not been sent the state yet.
    JOINING = "joining"
    #: Its server gets ready to draw the present revision.
    PREPARING = "preparing"
    #: It could draw; the next frame takes it in.
    READY = "ready"
    #: Frames wait for it.
    LIVE = "live"
    #: It missed a deadline; frames do not wait for it until it has caught up.
    LATE = "late"


class OutputMode(str, Enum):
    """What every display of the wall shows."""

    NORMAL = "normal"
    #: The wall's picture, and over it what the display is.
    IDENTIFY = "identify"
    BLANK = "blank"
    #: What it showed when the mode began.
    FREEZE = "freeze"


class TestPattern(str, Enum):
    """What every channel draws instead of the scene."""

    GRID = "grid"
    CHECKER = "checker"
    RAMP = "ramp"
    WEIGHTS = "weights"
    OVERLAP = "overlap"
    DENSITY = "density"
    FOCUS = "focus"
    COLOR_BARS = "color-bars"
    CROSSHAIR = "crosshair"
    BORDER = "border"


class ToneMapper(str, Enum):
    """The way from exposed light to what displays show."""

    NEUTRAL = "Neutral"
    ACES = "Aces"
    NONE = "None"


@dataclass(frozen=True)
class Fog:
    """Fog between the eye and what it sees."""

    #: World units through which 5 % of the light pass, at ``height``; above 0.
    visibility: float
    #: The Y at which it has this density, in world units.
    height: float = 0.0
    #: Half of the density is left with each so many units above; ``None``: the same everywhere.
    half_height: Optional[float] = None
    #: The share of red, green and blue that it scatters, 0 to 1.
    color: Tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Glow:
    """Light that spreads around what is bright."""

    #: The share of light that spreads, above 0 and up to 1.
    strength: float
    #: The width of the widest octave as seen by the viewer, in degrees, 0.1 to 7.
    width_degrees: float = 4.0


@dataclass(frozen=True)
class AmbientOcclusion:
    """Less of the light from all around in corners and gaps."""

    #: Nothing farther than this takes light from a place, in units of the world; above 0.
    radius: float


@dataclass(frozen=True)
class DepthOfField:
    """Blur of what is nearer or farther than a distance."""

    #: What is at this distance from the eye is sharp, in units of the world; above 0.
    focus: float
    #: The width of the lens, in units of the world; above 0.
    aperture: float


@dataclass(frozen=True)
class QualityBounds:
    """An upper bound of the error and a lower bound of the rate; the rate wins."""

    #: Pixels of the wall, 0 to 64; 0 draws the finest level of everything.
    error_px: float = 0.0
    #: Frames per second, 1 to 1000; ``None`` for no bound.
    rate_fps: Optional[float] = None


@dataclass(frozen=True)
class Skew:
    """How far the present calls of a channel lie behind those of the first one, in microseconds."""

    #: Frames that were compared.
    frames: int = 0
    p50_us: int = 0
    p99_us: int = 0
    max_us: int = 0
    #: The error of the server's estimate of the manager's clock; ``None`` before the first one.
    clock_error_us: Optional[int] = None


@dataclass(frozen=True)
class ChannelFeedback:
    """What a channel did for a frame."""

    name: str
    #: When the frame was swapped.
    state: ChannelState
    since_ms: int
    #: Why it is not live, where there is a reason.
    reason: Optional[str]
    #: Its own drawing time; ``None`` where it had not drawn when the frame was swapped.
    draw_us: Optional[int]
    triangles: int
    draw_calls: int
    skew: Skew

    def has_shown(self) -> bool:
        """Returns whether the channel was among those that were told to show the frame."""
        return self.draw_us is not None and self.state in (ChannelState.LIVE, ChannelState.LATE)


@dataclass(frozen=True)
class DrawnDetail:
    """The detail that a frame was drawn with."""

    #: The error bound in force, in pixels of the wall.
    error_in_force_px: float
    #: The largest error of what any channel drew or left out, in pixels of the wall.
    largest_error_px: float
    #: The channel that drew longest on the server that drew longest for all of its channels,
    #: of those that the frame waited for.
    limiting_channel: Optional[str]
    #: The pixels that were drawn along each side, as a share of the wall's: 0.25 to 1.
    resolution_scale: float
    #: Servers get a part of the scene ready that serves better where the wall is seen from.
    awaits_detail: bool


class Shown(Enum):
    """Which displays showed a frame."""

    BY_ALL = "by-all"
    BY_SOME = "by-some"
    BY_NONE = "by-none"


@dataclass(frozen=True)
class FrameFeedback:
    """What a frame became."""

    frame: int
    #: Scene time in seconds.
    time_s: float
    #: The state that it shows.
    revision: int
    #: From the frame command to the swap command, in microseconds.
    frame_us: int
    #: What of that the slowest channel did not draw.
    barrier_us: int
    #: Times that the mouse over a window has moved the wall's camera.
    navigations: int
    detail: DrawnDetail
    #: One for each channel of the wall, in the wall's order.
    channels: List[ChannelFeedback]

    def shown(self) -> Shown:
        """Returns which displays showed the frame; a wall without servers makes frames too."""
        shown = sum(1 for _ in self.shown_channels())
        if shown == 0:
            return Shown.BY_NONE
        return Shown.BY_ALL if shown == len(self.channels) else Shown.BY_SOME

    def is_complete(self) -> bool:
        """Returns whether every channel of the wall showed the frame."""
        return self.shown() is Shown.BY_ALL

    def shown_channels(self) -> Iterator[ChannelFeedback]:
        """Yields the channels that showed the frame, in the wall's order."""
        return (channel for channel in self.channels if channel.has_shown())

    def missing_channels(self) -> Iterator[ChannelFeedback]:
        """Yields the channels that did not show the frame, in the wall's order."""
        return (channel for channel in self.channels if not channel.has_shown())


@dataclass(frozen=True)
class OpenProgress:
    """The progress of opening a scene."""

    #: ``waiting``, ``baking``, ``preparing`` or ``exporting``.
    stage: str
    #: 0 to 100 of that step.
    percent: int


@dataclass(frozen=True)
class Opening:
    """A scene that is being opened."""

    scene: str
    progress: OpenProgress


@dataclass(frozen=True)
class Presentation:
    """What the next frame presents."""

    camera: Camera
    head: HeadPose
    #: What lies over the wall's own picture.
    views: List[View]
    #: Light is multiplied by this before tone mapping.
    exposure: float
    output_mode: OutputMode
    pattern: Optional[TestPattern]
    bounds: QualityBounds
    tone: ToneMapper = ToneMapper.NEUTRAL
    is_exposure_automatic: bool = False
    fog: Optional[Fog] = None
    glow: Optional[Glow] = None
    ambient_occlusion: Optional[AmbientOcclusion] = None
    depth_of_field: Optional[DepthOfField] = None

    def all_views(self) -> List[View]:
        """Returns the wall's own picture, and what lies over it."""
        return [View(self.camera), *self.views]


@dataclass(frozen=True)
class ChannelStatus:
    """A channel as it stands."""

    name: str
    state: ChannelState
    since_ms: int
    reason: Optional[str]
    pid: Optional[int]
    address: Optional[str]
    #: What the server draws with.
    adapter: Optional[str]
    #: The last frame that it showed.
    frame: int
    revision: int
    #: Times that it missed a deadline.
    late: int
    draw_us: Optional[int]
    skew: Skew
    memory_bytes: int = 0
    scene_bytes: int = 0


@dataclass(frozen=True)
class LitHours:
    """The part of a day in which displays are lit, in minutes since midnight at the manager."""

    from_min: int
    #: The minute after the last; before ``from_min`` for hours across midnight.
    until_min: int


@dataclass(frozen=True)
class RestRules:
    """The rules by which displays go dark by themselves."""

    idle_s: Optional[float] = None
    hours: Optional[LitHours] = None


@dataclass(frozen=True)
class RestStatus:
    """The rules, and whether displays are dark by them."""

    rules: RestRules = RestRules()
    is_resting: bool = False


@dataclass(frozen=True)
class Quantiles:
    """Where a set of measurements lies."""

    count: int
    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class DeviceStatus:
    """A tracker, a wand or a pad of the wall file as it stands."""

    name: str
    #: ``waiting``, ``live`` or ``lost``.
    state: str
    since_ms: int
    #: The reason for its state, if it is not live.
    reason: Optional[str]
    #: Readings in the last second.
    rate_hz: float
    #: Readings that were ignored.
    refused: int
    #: From the arrival of a reading to the swap of the first frame that uses it, in milliseconds.
    latency_ms: Quantiles


@dataclass(frozen=True)
class LeaderStatus:
    """The manager that leads, where several share the wall."""

    #: How often the lease was taken, up to this manager.
    term: int
    #: Its address, process and machine, for people.
    holder: str


@dataclass(frozen=True)
class WallStatus:
    """The wall as it stands."""

    wall: str
    #: This life of the manager: 16 hexadecimal digits.
    epoch: str
    #: Changes so far.
    revision: int
    #: Of the state at that revision: 16 hexadecimal digits.
    digest: str
    #: The last frame that was swapped.
    frame: int
    scene: Optional[str]
    deadline_ms: float
    error_in_force_px: float
    presentation: Presentation
    channels: List[ChannelStatus]
    clients: List[str]
    warnings: List[str]
    #: What of the open scene is not drawn, or not as its file has it.
    notes: List[str] = field(default_factory=list)
    opening: List[Opening] = field(default_factory=list)
    memory_bytes: int = 0
    resolution_scale: float = 1.0
    environment: Optional[str] = None
    rest: RestStatus = RestStatus()
    #: The trackers, wands and pads of the wall file, in its order.
    devices: List[DeviceStatus] = field(default_factory=list)
    #: The manager that answers, where several share the wall.
    leader: Optional[LeaderStatus] = None


@dataclass(frozen=True)
class Statistics:
    """What the frames took since the statistics were last reset."""

    #: Frames swapped.
    frames: int
    #: Frames that every channel of the wall had drawn when they were swapped.
    complete: int
    seconds: float
    frame_ms: Quantiles
    draw_ms: Quantiles
    barrier_us: Quantiles
    swap_skew_us: Quantiles
    #: Deadlines missed, over all channels.
    late: int
    triangles: int
    #: One for each channel, as ``GET /api/v1/statistics`` gives it.
    channels: List[Dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Tuned:
    """What a calibration has become."""

    revision: int
    #: Frames that were begun from the request to the first one with it.
    frames: int
    feedback: FrameFeedback


@dataclass(frozen=True)
class StoppedServers:
    """What became of a wall's servers that were told to end, by name."""

    ended: List[str]
    silent: List[Tuple[str, str]]
    absent: List[str]
