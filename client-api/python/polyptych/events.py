"""What the manager tells by itself: status, feedback of frames, and what happens in words."""

from __future__ import annotations

import http.client
import json
import time
from dataclasses import dataclass
from typing import Callable, Iterator, Optional, Tuple, Union

from .errors import (
    ClientError,
    ConnectionLost,
    ManagerEnded,
    NotConnected,
    TimedOut,
    WrongAnswer,
)
from .feedback import FrameFeedback, WallStatus
from .records import Mismatch, decode
from .transport import Call, Transport, retry_pauses

#: The time without any event after which a stream counts as lost, in seconds: the status comes
#: twice a second.
SILENCE_MAX_S = 10.0

_REQUEST = "watch events"

#: The errors of a stream that is lost.
_LOST = (OSError, http.client.HTTPException, ConnectionLost, ManagerEnded, TimedOut)


@dataclass(frozen=True)
class StatusEvent:
    """The wall's state, twice a second."""

    status: WallStatus


@dataclass(frozen=True)
class FeedbackEvent:
    """The feedback of a frame."""

    feedback: FrameFeedback


@dataclass(frozen=True)
class LogEvent:
    """What happened, in words."""

    text: str


@dataclass(frozen=True)
class LostEvent:
    """Events that this program did not read in time."""

    events: int


Event = Union[StatusEvent, FeedbackEvent, LogEvent, LostEvent]


class EventStream:
    """An iterator of events, over a connection of its own, until :meth:`close`.

    A stream that is lost is begun again: nothing is done twice by that, but what happened meanwhile
    is left out; :attr:`reconnects` counts these gaps. If there is no connection within the time of
    ``ReconnectPolicy.wait``, the iterator raises ``NotConnected``.
    """

    def __init__(self, connect: Callable[[], Transport], with_feedback: bool) -> None:
        self._transport = connect()
        self._path = "/events?feedback=true" if with_feedback else "/events"
        self._response: Optional[http.client.HTTPResponse] = None
        #: The number of times it was begun again. Nothing says what a gap has left out.
        self.reconnects = 0
        self._begin()

    def __enter__(self) -> EventStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Event]:
        return self

    def __next__(self) -> Event:
        options = self._transport.options
        pauses = retry_pauses(options.reconnect.wait)
        while True:
            try:
                event = self._parsed(*self._next_block())
            except (AttributeError, ValueError):
                # http.client fails so where another thread has closed the answer.
                self._transport.check_open(_REQUEST)
                raise
            except _LOST as error:
                self._transport.drop()
                self._response = None
                pause = next(pauses, None)
                if pause is None:
                    wait, reason = options.reconnect.wait, str(getattr(error, "reason", error))
                    raise NotConnected(_REQUEST, options.address, wait, reason) from None
                time.sleep(pause)
                continue
            if event is not None:
                return event

    def close(self) -> None:
        """Ends the stream, also under a thread that reads it.

        Reading it afterwards raises ``Closed``, and so does the reading that it ends.
        """
        self._transport.close("this program closed the stream")
        self._response = None

    def _begin(self) -> http.client.HTTPResponse:
        call = Call(_REQUEST, "GET", self._path, SILENCE_MAX_S)
        self._response = response = self._transport.open_stream(call)
        return response

    def _next_block(self) -> Tuple[str, str]:
        """The name and the data of the next event."""
        response = self._response
        if response is None:
            response = self._begin()
            self.reconnects += 1
        name, data = "message", list[str]()
        while True:
            line = response.readline().decode("utf-8", "replace")
            if not line:
                raise ConnectionLost(_REQUEST, self._transport.options.address, "it ended")
            line = line.rstrip("\r\n")
            if not line:
                return name, "\n".join(data)
            field, _, value = line.partition(":")
            value = value[1:] if value.startswith(" ") else value
            if field == "event":
                name = value
            elif field == "data":
                data.append(value)

    def _parsed(self, name: str, data: str) -> Optional[Event]:
        """The event, or ``None`` for one that this package does not know."""
        try:
            if name == "status":
                return StatusEvent(decode(WallStatus, json.loads(data), name))
            if name == "feedback":
                return FeedbackEvent(decode(FrameFeedback, json.loads(data), name))
            if name == "log":
                return LogEvent(str(json.loads(data)["text"]))
            if name == "lost":
                return LostEvent(int(json.loads(data)["events"]))
        except (Mismatch, ValueError, KeyError, TypeError) as error:
            self.close()
            raise WrongAnswer(_REQUEST, str(error)) from None
        return None


class FeedbackStream:
    """An iterator of the feedback of every frame that is shown after it was made.

    Frames that the program did not read in time are left out; :attr:`lost` counts them. Those of a
    time without a connection are left out too; :attr:`reconnects` counts such gaps.
    """

    def __init__(self, events: EventStream) -> None:
        self._events = events
        #: Events that were left out, since the program reads too slowly.
        self.lost = 0
        self._kept: list[FrameFeedback] = []
        self._await_subscription()

    def __enter__(self) -> FeedbackStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[FrameFeedback]:
        return self

    def __next__(self) -> FrameFeedback:
        if self._kept:
            return self._kept.pop(0)
        for event in self._events:
            if isinstance(event, FeedbackEvent):
                return event.feedback
            if isinstance(event, LostEvent):
                self.lost += event.events
        raise StopIteration

    @property
    def reconnects(self) -> int:
        """The number of times it was begun again, as :attr:`EventStream.reconnects`."""
        return self._events.reconnects

    def close(self) -> None:
        """Ends the stream, as :meth:`EventStream.close` does."""
        self._events.close()

    def _await_subscription(self) -> None:
        # The manager subscribes with the first status that it asks for after it has heard of this
        # stream; the one after that shows that it has.
        seen = 0
        try:
            while seen < 2:
                event = next(self._events)
                seen += isinstance(event, StatusEvent)
                if isinstance(event, FeedbackEvent):
                    self._kept.append(event.feedback)
        except ClientError:
            self.close()
            raise
