"""Sessions: what the list of those that were saved has, and what comes of opening one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import List, Optional

from .scene import SceneSummary


@dataclass(frozen=True)
class SavedSession:
    """An entry in the list of saved sessions."""

    name: str
    #: The scene that was open, if one was.
    scene: Optional[str]
    #: Views that lay over the wall's own picture.
    views: int
    #: Places of the camera that were stored.
    stored_views: int
    #: Seconds since 1970, UTC.
    saved_at_s: int


@dataclass(frozen=True)
class OpenedSession:
    """A session that was opened."""

    #: The scene that it shows, if it shows one.
    scene: Optional[SceneSummary]
    #: The parts of it that do not fit this wall, each with its reason.
    left_out: List[str] = field(default_factory=list)
