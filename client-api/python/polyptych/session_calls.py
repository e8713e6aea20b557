"""Sessions: all that a wall shows, which the manager keeps under names."""

from __future__ import annotations

from typing import List

from .requests import Requests
from .session import OpenedSession, SavedSession


class SessionCalls(Requests):
    """Calls that save and open sessions."""

    def save_session(self, name: str) -> None:
        """Keeps all that the wall shows and how it shows it, in the place of what had that name.

        That is the scene with all that was changed of it, camera, head, views, stored views, tour,
        light, surroundings, bounds, modes and pace. Returns once it is on the manager's disk.
        """
        self._do({"SaveSession": {"name": name}})

    def open_session(self, name: str) -> OpenedSession:
        """Shows a saved session in the place of all that is shown, stored views too.

        Returns once every live channel can draw it.

        :raises Failed: there is none of this name; the reason has all there are.
        """
        return self._ask({"OpenSession": {"name": name}}, "SessionOpened", OpenedSession)

    def sessions(self) -> List[SavedSession]:
        """Returns the saved sessions, by name."""
        return self._ask("ListSessions", "Sessions", List[SavedSession])

    def remove_session(self, name: str) -> None:
        """Forgets a saved session."""
        self._do({"RemoveSession": {"name": name}})
