"""What can go wrong between a program and its wall.

The classes have the names of the Rust client's errors. Where the manager gives a reason, it stands
unchanged in ``reason``. If :attr:`ClientError.is_outcome_unknown` is true, the request was sent and
may have been done; the client never sends it again.
"""

from __future__ import annotations


class ClientError(Exception):
    """The base of all errors of this package."""

    @property
    def is_outcome_unknown(self) -> bool:
        """Whether the request was sent and it is unknown whether it was done."""
        return False


class Unresolved(ClientError):
    """The address names no machine."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(
            f"{address} cannot be resolved ({reason}); write HOST:PORT, such as 127.0.0.1:7880, "
            "or HOST"
        )
        self.address, self.reason = address, reason


class NoManager(ClientError):
    """No program listens at the address."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(
            f"no manager at {address} ({reason}); start one with: polyptych manager --http "
            f"{address} WALL.toml"
        )
        self.address, self.reason = address, reason


class NoIntroduction(ClientError):
    """A program may listen at the address, but it does not answer."""

    def __init__(self, address: str, after_s: float) -> None:
        super().__init__(
            f"{address} did not introduce itself as a manager within {after_s:g} s; is the address "
            "right, and does a firewall stand between?"
        )
        self.address, self.after_s = address, after_s


class Token(ClientError):
    """The manager's secret cannot be read."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"no token to show to the manager: {reason}")
        self.reason = reason


class Keys(ClientError):
    """This client's keys cannot be used."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"no keys to show to the manager: {reason}")
        self.reason = reason


class NotSecured(ClientError):
    """The connection would not be encrypted, or the two ends do not trust each other."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(f"no secure connection to the manager at {address}: {reason}")
        self.address, self.reason = address, reason


class Refused(ClientError):
    """The manager does not accept this client."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(f"the manager at {address} refused this client: {reason}")
        self.address, self.reason = address, reason


class Handshake(ClientError):
    """The program at the address is no manager that this client understands."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(f"no manager that this client understands at {address}: {reason}")
        self.address, self.reason = address, reason


class Closed(ClientError):
    """The request was not sent: the client had been closed before."""

    def __init__(self, request: str, address: str, reason: str) -> None:
        super().__init__(
            f"cannot {request}: the connection to the manager at {address} has ended: {reason}"
        )
        self.request, self.address, self.reason = request, address, reason


class NotConnected(ClientError):
    """The request was not sent: the connection was lost, and did not come back in time."""

    def __init__(self, request: str, address: str, after_s: float, reason: str) -> None:
        super().__init__(
            f"cannot {request}: no connection to the manager at {address} within {after_s:g} s "
            f"({reason}); nothing was sent"
        )
        self.request, self.address, self.after_s, self.reason = request, address, after_s, reason


class ConnectionLost(ClientError):
    """The connection ended while the request was open."""

    def __init__(self, request: str, address: str, reason: str) -> None:
        super().__init__(
            f"the connection to the manager at {address} was lost ({reason}); whether it did "
            f'"{request}" is unknown'
        )
        self.request, self.address, self.reason = request, address, reason

    @property
    def is_outcome_unknown(self) -> bool:
        return True


class ManagerEnded(ClientError):
    """The manager ended while the request was open."""

    def __init__(self, request: str, address: str, reason: str) -> None:
        super().__init__(
            f'the manager at {address} ended ({reason}); whether it did "{request}" is unknown'
        )
        self.request, self.address, self.reason = request, address, reason

    @property
    def is_outcome_unknown(self) -> bool:
        return True


class TimedOut(ClientError):
    """No answer came in time."""

    def __init__(self, request: str, after_s: float) -> None:
        super().__init__(
            f'the manager did not answer "{request}" within {after_s:g} s; whether it was done is '
            "unknown; polyptych status shows which channels it waits for"
        )
        self.request, self.after_s = request, after_s

    @property
    def is_outcome_unknown(self) -> bool:
        return True


class Failed(ClientError):
    """The manager could not do it; the wall is as it was before."""

    def __init__(self, request: str, reason: str) -> None:
        super().__init__(f"cannot {request}: {reason}")
        self.request, self.reason = request, reason


class RequestTooLarge(ClientError):
    """The request is larger than the manager takes; nothing was done."""

    def __init__(self, request: str, reason: str) -> None:
        super().__init__(f"cannot {request}: {reason}")
        self.request, self.reason = request, reason


class CaptureTooLarge(ClientError):
    """A picture needs more memory than this client gives it."""

    def __init__(self, limit: int) -> None:
        super().__init__(
            f"the pictures of the wall take more than {limit} bytes; raise "
            "ConnectOptions.capture_bytes_max"
        )
        self.limit = limit


class MalformedPicture(ClientError):
    """The bytes of a picture do not fit its size."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"the manager sent pictures that don't fit their description: {reason}")
        self.reason = reason


class WrongAnswer(ClientError):
    """The manager's answer is not one to this request."""

    def __init__(self, request: str, answer: str) -> None:
        super().__init__(f'the manager answered "{request}" with something else: {answer}')
        self.request, self.answer = request, answer
