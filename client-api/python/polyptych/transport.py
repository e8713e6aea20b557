"""One HTTP connection to the manager: made when it is needed, checked, and never used twice for
the same request."""

from __future__ import annotations

import contextlib
import http.client
import ipaddress
import json
import os
import secrets
import selectors
import socket
import ssl
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterator, List, Mapping, Optional, Sequence, Tuple

from . import bearer, credentials
from .errors import (
    CaptureTooLarge,
    ClientError,
    Closed,
    ConnectionLost,
    Failed,
    Handshake,
    ManagerEnded,
    NoIntroduction,
    NoManager,
    NotConnected,
    NotSecured,
    Refused,
    RequestTooLarge,
    TimedOut,
    Unresolved,
)
from .options import ConnectOptions

BASE = "/api/v1"

_PAUSE_FIRST_S = 0.05
_PAUSE_MAX_S = 2.0
_PIECE_BYTES = 1 << 20
_JSON_BYTES_MAX = 256 << 20
#: The time without a request after which a connection is not used again. The manager closes one
#: after 30 s, which must not happen while a request is on its way.
_IDLE_MAX_S = 25.0
_WARNING = "polyptych-warning"


@dataclass(frozen=True)
class Answer:
    """An answer of the manager that is no refusal."""

    headers: Mapping[str, str]
    body: bytes
    #: What the manager says besides, such as that a change is not kept over a restart.
    warnings: Sequence[str] = ()


@dataclass(frozen=True)
class Call:
    """A request as it goes over the connection."""

    #: What is asked, as it stands behind "cannot".
    name: str
    method: str
    #: Behind ``/api/v1``.
    path: str
    timeout_s: float
    body: Optional[bytes] = None
    bytes_max: int = _JSON_BYTES_MAX
    #: Asked now and then while the answer is awaited: whether the time limit begins anew.
    is_going_on: Optional[Callable[[], bool]] = None
    #: The time between two of these questions, in seconds.
    period_s: float = 5.0


class Connection(http.client.HTTPConnection):
    """A connection to addresses that were looked up and checked, with TLS where there are keys."""

    def __init__(
        self,
        host: str,
        port: int,
        addresses: List[Tuple[Any, ...]],
        context: Optional[ssl.SSLContext],
        timeout_s: float,
    ) -> None:
        super().__init__(host, port, timeout=timeout_s)
        self._addresses, self._context = addresses, context
        # http.client forgets its own where an answer lasts until the connection ends.
        self._socket: Optional[socket.socket] = None

    def connect(self) -> None:
        """Connects to the first of the addresses that answers."""
        last: Optional[OSError] = None
        for family, kind, protocol, _, address in self._addresses:
            connected = socket.socket(family, kind, protocol)
            try:
                connected.settimeout(self.timeout)
                connected.connect(address)
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                _keep_alive(connected)
                if self._context is not None:
                    name = credentials.MANAGER_NAME
                    connected = self._context.wrap_socket(connected, server_hostname=name)
            except OSError as error:
                connected.close()
                last = error
                continue
            self.sock = self._socket = connected
            return
        raise last or OSError("the address names no machine")

    def end(self) -> None:
        """Closes the connection, and wakes a thread that reads from it."""
        if self._socket is not None:
            # Closing alone would wait for that thread. The method of TLS sockets would take the
            # encryption away while that thread uses it.
            with contextlib.suppress(OSError):
                socket.socket.shutdown(self._socket, socket.SHUT_RDWR)
        self.close()


class Transport:
    """The way to a manager. Not for several threads at once; :class:`Client` sees to that.

    Only :meth:`close` may be called while another thread uses it.
    """

    def __init__(self, options: ConnectOptions) -> None:
        self.options = options
        self._connection: Optional[Connection] = None
        self._was_connected = False
        self._close_reason: Optional[str] = None
        self._authorization: Optional[str] = None
        self._answered_at = 0.0
        #: The life of the manager that this connection is with, once it is introduced.
        self.epoch = ""
        #: The time in seconds, which only goes forwards.
        self.clock: Callable[[], float] = time.monotonic
        #: Checks who the manager is, on every new connection of the transport that it is given.
        self.introduce: Callable[[Transport], None] = lambda _: None

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection now."""
        return self._connection is not None and not _is_over(self._connection)

    def connect(self) -> None:
        """Connects, if there is no connection.

        :raises ClientError: there is no manager for this client; the text says why.
        """
        self._connected("connect")

    def close(self, reason: str) -> None:
        """Closes the connection for good. A thread that waits for an answer gets none."""
        self._close_reason = reason
        self.drop()

    def check_open(self, request: str) -> None:
        """Raises an error if the connection was closed for good.

        :raises Closed: :meth:`close` was called.
        """
        if self._close_reason is not None:
            raise Closed(request, self.options.address, self._close_reason) from None

    def drop(self) -> None:
        """Closes the connection; the next call makes another."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.end()

    def exchange(self, call: Call) -> Answer:
        """Sends a request once and returns its answer.

        :raises ClientError: see :mod:`polyptych.errors`.
        """
        connection = self._connected(call.name)
        return self._finish(connection, call)

    def open_stream(self, call: Call) -> http.client.HTTPResponse:
        """Sends a request and returns its answer, whose body goes on until it is closed.

        :raises ClientError: see :mod:`polyptych.errors`.
        """
        connection = self._connected(call.name)
        try:
            response = self._send(connection, call, time.monotonic() + call.timeout_s)
        except (OSError, http.client.HTTPException) as error:
            self.drop()
            raise self._lost(call, error) from None
        if response.status != http.client.OK:
            body = response.read(_PIECE_BYTES)
            self.drop()
            raise self._refusal(call, response.status, body)
        # http.client connects by itself where another thread has closed it before the request.
        self.check_open(call.name)
        return response

    def _connected(self, request: str) -> Connection:
        self.check_open(request)
        if self._connection is not None:
            is_idle = self.clock() - self._answered_at >= _IDLE_MAX_S
            if not is_idle and not _is_over(self._connection):
                return self._connection
            # Nothing was sent: the manager closes connections that are idle.
            self.drop()
        if not self._was_connected:
            return self._dial()
        wait, last = self.options.reconnect.wait, ""
        for pause in retry_pauses(wait):
            time.sleep(pause)
            self.check_open(request)
            try:
                return self._dial()
            except ClientError as error:
                last = str(error)
        raise NotConnected(request, self.options.address, wait, last)

    def _dial(self) -> Connection:
        """Connects, and checks that the manager is one that knows the token."""
        options = self.options
        try:
            host, port = options.host_and_port()
            addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except (OSError, ValueError, UnicodeError) as error:
            raise Unresolved(options.address, str(error)) from None
        context = None if options.keys is None else credentials.tls_context(options.keys)
        if context is None and not options.insecure:
            self._check_addresses(addresses)
        connection = Connection(host, port, list(addresses), context, options.timeouts.connect)
        try:
            connection.connect()
        except socket.timeout:
            raise NoIntroduction(options.address, options.timeouts.connect) from None
        except ssl.SSLError as error:
            raise NotSecured(options.address, str(error)) from None
        except OSError as error:
            raise NoManager(options.address, str(error)) from None
        self._connection, self._answered_at = connection, self.clock()
        try:
            # Another thread may have closed it while there was no connection to close.
            self.check_open("connect")
            self._authenticate()
            self.introduce(self)
        except BaseException:
            self.drop()
            raise
        self._was_connected = True
        return connection

    def _check_addresses(self, addresses: List[Any]) -> None:
        for entry in addresses:
            address = entry[4][0]
            if not ipaddress.ip_address(address.split("%")[0]).is_loopback:
                raise NotSecured(
                    self.options.address,
                    f"{address} is reached over a network, and without keys nothing is encrypted; "
                    "make keys with polyptych keys WALL.toml --client NAME and give keys=FOLDER, "
                    "or insecure=True on a network that you trust",
                )

    def _authenticate(self) -> None:
        """Lets the manager prove that it knows the token, and then shows what is made of it."""
        options = self.options
        self._authorization = None
        if options.keys is not None:
            return
        shown = options.bearer or (
            os.environ.get(credentials.BEARER_VARIABLE)
            if options.token is None and options.token_file is None
            else None
        )
        if shown:
            self._authorization = f"Bearer {credentials.checked_bearer(shown)}"
            return
        token = options.token
        if token is None:
            path = options.token_file or credentials.default_token_path(os.environ)
            token = credentials.read_token(Path(path))
        nonce = secrets.token_hex(16)
        body = json.dumps({"nonce": nonce}).encode()
        call = Call("log in", "POST", "/login/challenge", options.timeouts.connect, body)
        said = self.introduction(call)
        expected = bearer.manager_proof(token, str(said.get("nonce")), nonce)
        if not bearer.is_same(expected, str(said.get("proof"))):
            reason = "it does not know the token; it is another manager, or none"
            raise Handshake(options.address, reason)
        self._authorization = f"Bearer {bearer.bearer(token)}"

    def introduction(self, call: Call) -> Mapping[str, Any]:
        """Asks on a connection that was just made, and returns an object of JSON.

        :raises ClientError: what answers is no manager for this client.
        """
        assert self._connection is not None
        address = self.options.address
        try:
            answer = self._finish(self._connection, call)
            said = json.loads(answer.body)
        except TimedOut:
            raise NoIntroduction(address, call.timeout_s) from None
        except Failed as error:
            raise Refused(address, error.reason) from None
        except ConnectionLost as error:
            raise Handshake(address, error.reason) from None
        except ValueError as error:
            raise Handshake(address, f"its answer is no JSON: {error}") from None
        if not isinstance(said, dict):
            raise Handshake(address, "its answer is no object of JSON")
        return said

    def _finish(self, connection: Connection, call: Call) -> Answer:
        until = time.monotonic() + call.timeout_s
        try:
            response = self._send(connection, call, until)
            body = self._read(connection, response, call)
        except (OSError, http.client.HTTPException) as error:
            self.drop()
            raise self._lost(call, error) from None
        except BaseException as error:
            # An answer that was not read would be taken for that of the next request.
            self.drop()
            # Where another thread closes the connection, http.client may find nothing to read from.
            if isinstance(error, (AttributeError, ValueError)) and self._close_reason is not None:
                raise self._lost(call, error) from None
            raise
        self._answered_at = self.clock()
        if response.status != http.client.OK:
            raise self._refusal(call, response.status, body)
        headers = [(name.lower(), _text(value)) for name, value in response.getheaders()]
        warnings = [value for name, value in headers if name == _WARNING]
        return Answer(dict(headers), body, warnings)

    def _send(self, connection: Connection, call: Call, until: float) -> http.client.HTTPResponse:
        headers = {"User-Agent": _product(self.options.name)}
        if call.body is not None:
            headers["Content-Type"] = "application/json"
        if self._authorization is not None:
            headers["Authorization"] = self._authorization
        _limit(connection, until - time.monotonic())
        connection.request(call.method, BASE + call.path, call.body, headers)
        while call.is_going_on is not None and not is_readable(connection.sock, call.period_s):
            if call.is_going_on():
                until = time.monotonic() + call.timeout_s
            elif time.monotonic() > until:
                raise socket.timeout
        _limit(connection, until - time.monotonic())
        return connection.getresponse()

    def _read(
        self, connection: Connection, response: http.client.HTTPResponse, call: Call
    ) -> bytes:
        until = time.monotonic() + call.timeout_s
        pieces: List[bytes] = []
        expected = total = int(response.getheader("Content-Length") or 0)
        while total <= call.bytes_max:
            _limit(connection, until - time.monotonic())
            piece = response.read(_PIECE_BYTES)
            if not piece:
                body = b"".join(pieces)
                # Read in pieces, http.client says nothing of an end that comes too early.
                if len(body) < expected:
                    raise http.client.IncompleteRead(body, expected - len(body))
                return body
            pieces.append(piece)
            total = max(total, sum(map(len, pieces)))
        raise CaptureTooLarge(call.bytes_max)

    def _lost(self, call: Call, error: Exception) -> ClientError:
        if self._close_reason is not None:
            return ConnectionLost(call.name, self.options.address, self._close_reason)
        if isinstance(error, socket.timeout):
            return TimedOut(call.name, call.timeout_s)
        if isinstance(error, ssl.SSLError) and not self._was_connected:
            # With TLS 1.3 a certificate is refused with the first answer.
            return NotSecured(self.options.address, str(error))
        if isinstance(error, http.client.RemoteDisconnected):
            return ConnectionLost(call.name, self.options.address, "the manager closed it")
        if isinstance(error, (http.client.BadStatusLine, http.client.UnknownProtocol)):
            return Handshake(self.options.address, f"it does not speak HTTP: {error!r}")
        if isinstance(error, http.client.IncompleteRead):
            return ConnectionLost(call.name, self.options.address, "the answer broke off")
        return ConnectionLost(call.name, self.options.address, str(error) or repr(error))

    def _refusal(self, call: Call, status: int, body: bytes) -> ClientError:
        """The error of an answer that is a refusal, with the manager's text as it is."""
        try:
            reason = str(json.loads(body)["error"])
        except (ValueError, TypeError, KeyError):
            said = body[:200].decode("utf-8", "replace")
            return Handshake(self.options.address, f"it answers with status {status}: {said}")
        if status in (401, 403, 421):
            return Refused(self.options.address, reason)
        if status == 413:
            return RequestTooLarge(call.name, reason)
        if status == 504:
            self.drop()
            return ManagerEnded(call.name, self.options.address, reason)
        if status == 503 and ("the manager ended" in reason or "the manager ends" in reason):
            self.drop()
            return ManagerEnded(call.name, self.options.address, reason)
        return Failed(call.name, reason)


def retry_pauses(wait_s: float) -> Iterator[float]:
    """Yields the pause before each try, in seconds, until the next would begin after this time.

    The time begins with the first try, which has no pause.
    """
    until, pause = time.monotonic() + wait_s, 0.0
    while pause == 0.0 or time.monotonic() + pause <= until:
        yield pause
        pause = min(max(2.0 * pause, _PAUSE_FIRST_S), _PAUSE_MAX_S)


def _product(name: str) -> str:
    """A name as HTTP has it: a word of plain letters, digits and some signs."""
    kept = "".join(of if of.isascii() and (of.isalnum() or of in "._-") else "_" for of in name)
    return kept or "python"


def _text(header: str) -> str:
    """The text of a header, which http.client takes for Latin-1."""
    return header.encode("latin-1", "replace").decode("utf-8", "replace")


def _keep_alive(connected: socket.socket) -> None:
    """Lets the system ask a silent peer whether it is there: one that is gone without a word is
    noticed in half a minute, however long an answer may take."""
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 15), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
        if hasattr(socket, name):
            connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def _limit(connection: Connection, timeout_s: float) -> None:
    if timeout_s <= 0.0:
        raise socket.timeout
    if connection.sock is not None:
        connection.sock.settimeout(timeout_s)


def is_readable(connected: Optional[socket.socket], wait_s: float) -> bool:
    """Returns whether a socket has bytes, or ends, within this time in seconds."""
    # Where there is no socket, the answer says so.
    if connected is None:
        return True
    # select.select takes no socket of a program that has 1,024 files open.
    with selectors.DefaultSelector() as selector:
        selector.register(connected, selectors.EVENT_READ)
        return bool(selector.select(wait_s))


def _is_over(connection: Connection) -> bool:
    """Returns whether the manager has closed a connection on which no answer is awaited."""
    if connection.sock is None:
        return True
    try:
        connection.sock.settimeout(0.0)
        if isinstance(connection.sock, ssl.SSLSocket):
            connection.sock.recv(1)
        else:
            connection.sock.recv(1, socket.MSG_PEEK)
    except (BlockingIOError, ssl.SSLWantReadError):
        return False
    except OSError:
        return True
    # Its end, or bytes that nobody has asked for.
    return True
