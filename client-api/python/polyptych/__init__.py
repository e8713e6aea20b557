"""Drive a wall of displays as if it were one window, over the manager's HTTP interface.

::

    import polyptych

    with polyptych.Client.connect("127.0.0.1:7880") as wall:
        scene = wall.open_scene("town.glb")
        wall.set_camera(polyptych.fit_bounds(wall.wall(), scene.bounds, 0.5))
        drawn = wall.render_frame()
        print(f"frame {drawn.frame} took {drawn.frame_us} us")
        wall.capture().screens[0].save("wall.png")

Concepts, names and errors are those of the Rust client. Lengths are metres of display space or
world units, as each says; angles are radians, times seconds; quaternions are x, y, z, w; pictures
are sRGB with rows from the top.
"""

from .camera import (
    Area,
    Camera,
    Easing,
    Follow,
    HeadPose,
    Projection,
    StoredView,
    Tour,
    TourStatus,
    TourStop,
    View,
)
from .client import Client
from .errors import (
    CaptureTooLarge,
    ClientError,
    Closed,
    ConnectionLost,
    Failed,
    Handshake,
    Keys,
    MalformedPicture,
    ManagerEnded,
    NoIntroduction,
    NoManager,
    NotConnected,
    NotSecured,
    Refused,
    RequestTooLarge,
    TimedOut,
    Token,
    Unresolved,
    WrongAnswer,
)
from .events import (
    Event,
    EventStream,
    FeedbackEvent,
    FeedbackStream,
    LogEvent,
    LostEvent,
    StatusEvent,
)
from .feedback import (
    AmbientOcclusion,
    ChannelFeedback,
    ChannelState,
    ChannelStatus,
    DepthOfField,
    DeviceStatus,
    Fog,
    FrameFeedback,
    Glow,
    LeaderStatus,
    LitHours,
    OpenProgress,
    OutputMode,
    Presentation,
    QualityBounds,
    RestRules,
    RestStatus,
    Shown,
    Statistics,
    StoppedServers,
    TestPattern,
    ToneMapper,
    Tuned,
    WallStatus,
)
from .fit import fit_bounds, orbit
from .image import Capture, Image
from .options import ConnectOptions, ReconnectPolicy, Timeouts
from .scene import (
    Ball,
    Bounds,
    Box,
    ClipStatus,
    Convex,
    Edited,
    LayerInfo,
    NearestPoint,
    NodeInfo,
    NodeKind,
    NodePage,
    NodeQuery,
    Prism,
    RayHit,
    RayQuery,
    Relation,
    SavedScene,
    SceneFileInfo,
    SceneFileList,
    SceneSubset,
    SceneSummary,
    VariantList,
    WalkedWay,
    Walker,
)
from .session import OpenedSession, SavedSession
from .transaction import Transaction, provisional_asset
from .vectors import placed, transform
from .wall import Channel, Ray, Screen, Wall

__all__ = [
    "AmbientOcclusion", "Area", "Ball", "Bounds", "Box", "Camera", "Capture", "CaptureTooLarge",
    "Channel", "ChannelFeedback", "ChannelState", "ChannelStatus", "Client", "ClientError",
    "ClipStatus", "Closed", "ConnectOptions", "ConnectionLost", "Convex", "DepthOfField",
    "DeviceStatus", "Easing", "Edited",
    "Event", "EventStream", "Failed", "FeedbackEvent", "FeedbackStream", "Fog", "Follow",
    "FrameFeedback", "Glow", "Handshake", "HeadPose", "Image", "Keys", "LayerInfo", "LeaderStatus",
    "LitHours", "LogEvent", "LostEvent", "MalformedPicture", "ManagerEnded", "NearestPoint",
    "NoIntroduction", "NoManager", "NodeInfo", "NodeKind", "NodePage", "NodeQuery", "NotConnected",
    "NotSecured", "OpenProgress", "OpenedSession", "OutputMode", "Presentation", "Prism",
    "Projection", "QualityBounds", "Ray", "RayHit", "RayQuery", "ReconnectPolicy", "Refused",
    "Relation", "RequestTooLarge", "RestRules", "RestStatus", "SavedScene", "SavedSession",
    "SceneFileInfo", "SceneFileList", "SceneSubset", "SceneSummary", "Screen", "Shown",
    "Statistics", "StatusEvent", "StoppedServers", "StoredView", "TestPattern", "TimedOut",
    "Timeouts", "Token", "ToneMapper", "Tour", "TourStatus", "TourStop", "Transaction", "Tuned",
    "Unresolved", "VariantList", "View", "WalkedWay", "Walker", "Wall", "WallStatus", "WrongAnswer",
    "fit_bounds", "orbit", "placed", "provisional_asset", "transform",
]  # fmt: skip
